#include "explain/training.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <new>
#include <numeric>
#include <utility>

#include "sim/record_check.hpp"

namespace mk
{

namespace
{

constexpr size_t FEWEST = 40;  // rows of a log
constexpr double MOTION = 5.0; // counts: less is rest
// Of long logs windows are searched. They cost a start state each.
constexpr double WINDOW = 5.0;          // s: some swings
constexpr double SHORTEST_WINDOW = 1.0; // s: with more logs than this allows some have none

// What a log tells between holes, in parts that are worth searching in.
std::vector<Piece> worthwhile_pieces(const mk_record &record, size_t rows)
{
    double hole = 0.0;
    std::vector<Piece> pieces = pieces_of(record, rows, hole);
    pieces.erase(std::remove_if(pieces.begin(), pieces.end(),
                                [](const Piece &p) { return p.last - p.first < FEWEST; }),
                 pieces.end());
    return pieces;
}

// A piece of a log as given.
struct Part {
    int log;
    mk_record record;
    Piece rows;
    double seconds() const { return record.t[rows.last - 1] - record.t[rows.first]; }
};

// How many windows each part gets, as its length is, and one at least where that leaves them long
// enough.
std::vector<size_t> window_counts(const std::vector<Part> &parts, double all_s, double most_s)
{
    const double most = std::max(1.0, std::floor(most_s / SHORTEST_WINDOW));
    const double usual = std::max(1.0, std::round(most_s / WINDOW));
    const bool each = (double)parts.size() <= most;
    const double together = each ? usual : most;
    std::vector<size_t> counts;
    double before = 0.0; // s
    for (const Part &part : parts) {
        const double after = before + part.seconds();
        const double share =
            std::round(after / all_s * together) - std::round(before / all_s * together);
        counts.push_back((size_t)std::max(each ? 1.0 : 0.0, share));
        before = after;
    }
    return counts;
}

// Windows of one length, spread evenly over all parts and over all of each; of a part that is no
// longer than its windows all of it.
std::vector<Part> windows_over(const std::vector<Part> &parts, double all_s, double most_s)
{
    const std::vector<size_t> counts = window_counts(parts, all_s, most_s);
    const size_t all = std::accumulate(counts.begin(), counts.end(), (size_t)0);
    const double length = most_s / (double)std::max<size_t>(1, all);
    std::vector<Part> windows;
    for (size_t i = 0; i < parts.size(); i++) {
        const Part &part = parts[i];
        const size_t rows = part.rows.last - part.rows.first, count = counts[i];
        const size_t wanted =
            std::max(FEWEST, (size_t)std::ceil((double)rows * length / part.seconds()));
        if (wanted * count >= rows) {
            windows.push_back(part);
            continue;
        }
        for (size_t k = 0; k < count; k++) {
            const size_t middle = part.rows.first + rows * (2 * k + 1) / (2 * count);
            const size_t first = middle - wanted / 2;
            windows.push_back({part.log, part.record, {first, first + wanted}});
        }
    }
    return windows;
}

// All parts, or windows of them where the last fit would take too long.
std::vector<Part> no_more_rows(const std::vector<Part> &parts, double all_s)
{
    constexpr size_t MOST_ROWS = 300000;
    size_t rows = 0;
    for (const Part &part : parts)
        rows += part.rows.last - part.rows.first;
    return rows <= MOST_ROWS ? parts
                             : windows_over(parts, all_s, all_s * (double)MOST_ROWS / (double)rows);
}

enum mk_status check_log(const mk_log &log, const mk_model &model, mk_record &record, mk_error *err)
{
    enum mk_status st = mk_record_from_log(&log, &model, &record, err);
    return st == MK_OK ? check_record(record, model, log, FEWEST, err) : st;
}

// From the first row that is not left out to behind the last one.
std::pair<size_t, size_t> kept_rows(const mk_record &record)
{
    size_t first = 0, last = record.rows;
    while (record.left_out && first < last && record.left_out[first] != 0.0)
        first++;
    while (record.left_out && last > first && record.left_out[last - 1] != 0.0)
        last--;
    return {first, last};
}

// The row behind the last one where a joint is not yet where it stays to the end.
size_t end_of_motion(const mk_record &record, const mk_model &model)
{
    size_t end = 0;
    for (int j = 0; j < mk_model_joints(&model); j++) {
        const double *q = record.q[j];
        const double enough = MOTION * mk_model_count(&model, j);
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
    std::vector<Part> parts;
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
        const std::vector<Piece> pieces = worthwhile_pieces(record, last);
        if (pieces.empty())
            return mk_error_at(err, MK_ERR_RANGE, given[i]->path, 0, 0,
                               "no %zu rows without a long hole in them: too few to explain "
                               "anything",
                               FEWEST);
        st = check_motion(fit_log(record, model, pieces.front().first, pieces.back().last),
                          given[i], "explain", err);
        if (st != MK_OK)
            return st;
        for (const Piece &piece : pieces) {
            parts.push_back({(int)i, record, piece});
            out.given_s += parts.back().seconds();
        }
    }
    if (out.given_s > options.most_s) {
        for (const Part &p : no_more_rows(parts, out.given_s)) {
            whole.push_back(fit_log(p.record, model, p.rows.first, p.rows.last, p.log));
            made.push_back(rows_of_log(*given[p.log], p.rows.first, p.rows.last));
            whole_rows.push_back(made.back().get());
        }
        parts = windows_over(parts, out.given_s, options.most_s);
    }
    for (const Part &p : parts) {
        logs.push_back(fit_log(p.record, model, p.rows.first, p.rows.last, p.log));
        out.searched_s += logs.back().duration();
        made.push_back(rows_of_log(*given[p.log], p.rows.first, p.rows.last));
        rows.push_back(made.back().get());
    }
    return st;
}

std::vector<std::vector<const mk_log *>> TrainingData::rows_by_log() const
{
    const std::vector<const mk_log *> &all = whole.empty() ? rows : whole_rows;
    const std::vector<FitLog> &of = whole.empty() ? logs : whole;
    std::vector<std::vector<const mk_log *>> by_log;
    for (size_t i = 0; i < all.size(); i++) {
        if (i == 0 || of[i].source != of[i - 1].source)
            by_log.emplace_back();
        by_log.back().push_back(all[i]);
    }
    return by_log;
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
    const auto [begin, kept] = kept_rows(record);
    size_t end = kept;
    const size_t moved = end_of_motion(record, model);
    if (moved < end - (end - begin) / 4)
        end = std::max(moved, begin);
    last = end - (end - begin) / 4;
    if (end == kept && last - begin < FEWEST)
        return mk_error_at(err, MK_ERR_RANGE, log.path, 0, 0,
                           "%zu row%s too few to explain anything and hold a quarter of them "
                           "back: %zu without those, or give another log with --holdout",
                           record.rows, record.rows == 1 ? " is" : "s are", FEWEST);
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
    made.push_back(rows_of_log(log, last, end));
    held.push_back(made.back().get());
    return MK_OK;
}

} // namespace mk
