#include "explain/training.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <new>

#include "sim/record_check.hpp"

namespace mk
{

namespace
{

constexpr size_t FEWEST = 40;  // rows of a log
constexpr double MOTION = 5.0; // counts: less is rest
constexpr double A_RUN = 15.0; // s of a log that are worth having

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

enum mk_status check_log(const mk_log &log, const mk_model &model, mk_record &record, mk_error *err)
{
    enum mk_status st = mk_record_from_log(&log, &model, &record, err);
    return st == MK_OK ? check_record(record, model, log, FEWEST, err) : st;
}

// The row behind the last one where a joint is not yet where it stays to the end.
size_t end_of_motion(const mk_record &record, const mk_model &model)
{
    size_t end = 0;
    for (int j = 0; j < mk_model_joints(&model); j++) {
        const double *q = record.q[j];
        const double enough = MOTION * 2.0 * M_PI / model.encoder_cpr[j];
        double last = std::numeric_limits<double>::quiet_NaN();
        for (size_t k = record.rows; k-- > end;) {
            if (std::isnan(last))
                last = q[k];
            if (std::fabs(q[k] - last) >= enough) {
                end = k + 1;
                break;
            }
        }
    }
    return end;
}

enum mk_status check_motion(const FitLog &log, const mk_log *source, const char *what,
                            mk_error *err)
{
    for (int j = 0; j < log.joints; j++) {
        double low = HUGE_VAL, high = -HUGE_VAL;
        for (double q : log.q[j])
            if (!std::isnan(q))
                low = std::min(low, q), high = std::max(high, q);
        if (high - low >= MOTION * log.count[j])
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
            st = hold_back(*given[i], record, model, last, out, err);
            if (st != MK_OK)
                return st;
        }
        used.push_back(longest_piece(record, last));
        if (used[i].last - used[i].first < FEWEST)
            return mk_error_at(err, MK_ERR_RANGE, given[i]->path, 0, 0,
                               "no %zu rows without a long hole in them: too few to explain "
                               "anything",
                               FEWEST);
        logs.push_back(fit_log(record, model, used[i].first, used[i].last, (int)i));
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

// The last quarter of a log, [last, rows); of one that ends at rest, the last quarter of its
// motion.
enum mk_status TrainingData::hold_back(const mk_log &log, const mk_record &record,
                                       const mk_model &model, size_t &last, mk_explanation &out,
                                       mk_error *err)
{
    enum mk_status st = check_motion(fit_log(record, model, 0, record.rows), &log, "explain", err);
    if (st != MK_OK)
        return st;
    size_t end = record.rows;
    const size_t moved = end_of_motion(record, model);
    if (moved < end - end / 4)
        end = moved;
    last = end - end / 4;
    if (end == record.rows && last < FEWEST)
        return mk_error_at(err, MK_ERR_RANGE, log.path, 0, 0,
                           "%zu rows are too few to explain anything and hold a quarter of them "
                           "back: %zu without those, or give another log with --holdout",
                           record.rows, FEWEST);
    const double seconds = record.t[end - 1] - record.t[last], least = least_to_hold_out(model);
    if (seconds < least)
        return mk_error_at(err, MK_ERR_RANGE, log.path, 0, 0,
                           "the last quarter of the motion, %.2g s, is too short to measure a gain "
                           "on: %.2g s at least, or give another log with --holdout",
                           seconds, least);
    const FitLog part = fit_log(record, model, last, std::max(end, last + 2));
    st = end - last < 2 ? MK_ERR_RANGE : check_motion(part, &log, "measure on", nullptr);
    if (st != MK_OK)
        return mk_error_at(err, MK_ERR_RANGE, log.path, 0, 0,
                           "too little moves in this log to hold a part of it back and measure "
                           "on it: give another log with --holdout");
    out.held_back = true;
    out.held_from = record.t[last] - record.t[0];
    out.held_to = record.t[end - 1] - record.t[0];
    made.push_back(slice(log, last, end));
    held.push_back(made.back().get());
    return MK_OK;
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
        part.push_back(fit_log(record, model, used[log].first, last, (int)log));
    }
    logs = std::move(part);
    return MK_OK;
}

} // namespace mk
