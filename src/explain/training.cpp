#include "explain/training.hpp"

#include <algorithm>
#include <cmath>
#include <new>

#include "ident/period.hpp"

namespace mk
{

namespace
{

constexpr size_t FEWEST = 40;          // rows of a log
constexpr double A_RUN = 15.0;         // s of a log that are worth having
constexpr double LONGEST_PERIOD = 0.2; // s; no rig here can be followed with readings farther apart

// Rows [first, last) of a log, with its metadata and the columns a model needs.
OwnedLog slice(const mk_log &log, size_t first, size_t last)
{
    mk_log *made = nullptr;
    if (mk_log_create(last - first, &made) != MK_OK)
        throw std::bad_alloc();
    OwnedLog out(made);
    for (size_t c = 0; c < log.column_count; c++) {
        if (!log.columns[c].data)
            continue;
        double *data = mk_log_add_column(made, log.columns[c].name);
        if (!data)
            throw std::bad_alloc();
        std::copy(log.columns[c].data + first, log.columns[c].data + last, data);
    }
    for (size_t m = 0; m < log.meta_count; m++)
        if (log.meta[m].key[0] &&
            mk_log_set_meta(made, log.meta[m].key, log.meta[m].value) == MK_ERR_NOMEM)
            throw std::bad_alloc();
    return out;
}

// What a log tells without a hole in it.
Piece longest_piece(const mk_record &record, size_t rows)
{
    Piece longest = {0, 0};
    double hole = 0.0;
    for (const Piece &piece : pieces_of(record, rows, hole))
        if (piece.last - piece.first > longest.last - longest.first)
            longest = piece;
    return longest;
}

// A column that is to be learned from, or measured on.
enum mk_status check_column(const double *x, const char *name, const mk_log &log, mk_error *err)
{
    bool any = false;
    for (size_t k = 0; k < log.rows; k++) {
        if (std::isinf(x[k]))
            return mk_error_at(err, MK_ERR_RANGE, log.path, log.first_row_line + (int)k, 0,
                               "%s is infinite; a missing value is an empty field or nan", name);
        any = any || !std::isnan(x[k]);
    }
    return any ? MK_OK : mk_error_at(err, MK_ERR_RANGE, log.path, 0, 0, "%s has no values", name);
}

enum mk_status check_log(const mk_log &log, const mk_model &model, mk_record &record, mk_error *err)
{
    static const char *const angles[MK_MAX_JOINTS] = {"q1", "q2"};
    enum mk_status st = mk_record_from_log(&log, &model, &record, err);
    if (st != MK_OK)
        return st;
    if (record.rows < FEWEST)
        return mk_error_at(err, MK_ERR_RANGE, log.path, 0, 0,
                           "%zu rows are too few to explain anything: %zu at least", record.rows,
                           FEWEST);
    const double period = median_period(record.t, record.rows);
    if (period > LONGEST_PERIOD)
        return mk_error_at(
            err, MK_ERR_RANGE, log.path, 0, 0,
            "readings %.3g s apart show nothing of how a rig moves: is t in seconds?", period);
    for (int j = 0; j < mk_model_joints(&model) && st == MK_OK; j++)
        st = check_column(record.q[j], angles[j], log, err);
    for (int i = 0; i < MK_MAX_INPUTS && st == MK_OK; i++)
        if (record.u[i])
            st = check_column(record.u[i], i ? "the second command" : "the command", log, err);
    return st;
}

enum mk_status check_motion(const FitLog &log, const mk_log *source, const char *what,
                            mk_error *err)
{
    for (int j = 0; j < log.joints; j++) {
        double low = HUGE_VAL, high = -HUGE_VAL;
        for (double q : log.q[j])
            if (!std::isnan(q))
                low = std::min(low, q), high = std::max(high, q);
        if (high - low >= 5.0 * log.count[j])
            return MK_OK;
    }
    return mk_error_at(err, MK_ERR_RANGE, source->path, 0, 0,
                       "nothing moves in this log: there is nothing to %s", what);
}

} // namespace

enum mk_status TrainingData::load(const mk_model &model, const mk_explain_options &options,
                                  const mk_log *const *given, size_t count,
                                  const mk_log *const *holdouts, size_t holdout_count,
                                  mk_explanation &out, mk_error *err)
{
    held.assign(holdouts, holdouts + holdout_count);
    enum mk_status st = MK_OK;
    for (size_t i = 0; i < holdout_count; i++) { // before a search that may take minutes
        mk_record record;
        st = check_log(*holdouts[i], model, record, err);
        if (st == MK_OK)
            st = check_motion(fit_log(record, model, 0, record.rows), holdouts[i], "measure on",
                              err);
        if (st != MK_OK)
            return st;
    }
    for (size_t i = 0; i < count; i++) {
        mk_record record;
        st = check_log(*given[i], model, record, err);
        if (st != MK_OK)
            return st;
        size_t last = record.rows;
        if (holdout_count == 0 && i + 1 == count) {
            last = record.rows - record.rows / 4;
            out.held_back = true;
            out.held_from = record.t[last] - record.t[0];
            made.push_back(slice(*given[i], last, record.rows));
            held.push_back(made.back().get());
        }
        used.push_back(longest_piece(record, last));
        if (used[i].last - used[i].first < FEWEST)
            return mk_error_at(err, MK_ERR_RANGE, given[i]->path, 0, 0,
                               "no %zu rows without a long hole in them: too few to explain "
                               "anything",
                               FEWEST);
        logs.push_back(fit_log(record, model, used[i].first, used[i].last));
        out.given_s += logs.back().duration();
        st = check_motion(logs.back(), given[i], "explain", err);
        if (st != MK_OK)
            return st;
    }
    if (out.given_s > options.most_s)
        st = take_part(model, options.most_s, given, err);
    for (const FitLog &log : logs)
        out.searched_s += log.duration();
    return st;
}

// Of logs evenly over all the beginnings: effects may depend on the time since the start.
enum mk_status TrainingData::take_part(const mk_model &model, double most_s,
                                       const mk_log *const *given, mk_error *err)
{
    const size_t count = logs.size();
    const double wanted = std::max(most_s, (double)FEWEST * logs[0].period);
    size_t kept = (size_t)std::max(1.0, std::min((double)count, wanted / A_RUN));
    double share = wanted / (double)kept;
    std::vector<FitLog> part;
    for (size_t i = 0; i < kept; i++) {
        const size_t log = i * count / kept;
        mk_record record;
        enum mk_status st = mk_record_from_log(given[log], &model, &record, err);
        if (st != MK_OK)
            return st;
        const double seconds = std::min(share, logs[log].duration());
        size_t last = used[log].first;
        while (last < used[log].last && record.t[last] - record.t[used[log].first] <= seconds)
            last++;
        part.push_back(fit_log(record, model, used[log].first, last));
    }
    logs = std::move(part);
    return MK_OK;
}

} // namespace mk
