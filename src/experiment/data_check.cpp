// mk_data_check_logs: which checks are made of which logs, and the list of what they find.
#include "mechkit/data_check.h"

#include <new>
#include <vector>

#include "base/parallel.hpp"
#include "experiment/findings.hpp"
#include "sim/record_check.hpp"

namespace mk
{

namespace
{

constexpr size_t FEWEST_ROWS = 20, FEWEST_TO_EXPLAIN = 40;

double least_seconds(const mk_model &model, enum mk_data_use use)
{
    return use == MK_DATA_HOLD_OUT ? least_to_hold_out(model) : least_to_explain(model);
}

void check_length(const CheckedLog &c, enum mk_data_use use, Findings &out)
{
    const double least = least_seconds(c.model, use), is = duration_of(c.record);
    const char *motion = "";
    const double slowest = slowest_motion(c.model, &motion);
    if (is >= least || use == MK_DATA_EXPLAIN) // of those, all together must be enough
        return;
    if (use == MK_DATA_HOLD_OUT)
        out.doubt(text("%.3g s are too short to measure a gain on, and are left out", is),
                  text("give a hold-out of %.2g s at least, better %.2g s", least, 10.0 * least));
    else
        out.doubt(text("%.3g s say little: %s takes %.2g s", is, motion, slowest),
                  text("record %.2g s at least, better %.2g s", least, 10.0 * least));
}

void check_all(const CheckedLog &c, enum mk_data_use use, Findings &out)
{
    check_extremes(c, out);
    if (use == MK_DATA_SIMULATE) {
        check_metadata(c, out);
        return;
    }
    check_columns(c, out);
    check_metadata(c, out);
    check_length(c, use, out);
    check_mapping(c, out);
}

enum mk_status take_record(const mk_model &model, const mk_log &log, enum mk_data_use use,
                           mk_record &record, mk_error *err)
{
    const enum mk_status st = mk_record_from_log(&log, &model, &record, err);
    if (st != MK_OK)
        return st;
    if (use == MK_DATA_SIMULATE)
        return check_finite(record, model, log, err);
    const size_t fewest = use == MK_DATA_IDENTIFY ? FEWEST_ROWS : FEWEST_TO_EXPLAIN;
    return check_record(record, model, log, fewest, err);
}

// All logs that are searched in must last for as long as the rig takes to show what it does.
enum mk_status check_total(const mk_model &model, const char *path, double seconds, mk_error *err)
{
    const double least = least_to_explain(model);
    const char *motion = "";
    const double slowest = slowest_motion(model, &motion);
    if (seconds >= least)
        return MK_OK;
    return mk_error_at(err, MK_ERR_RANGE, path, 0, 0,
                       "%.3g s of data explain nothing: %s takes %.2g s. Record %.2g s at least, "
                       "better %.2g s",
                       seconds, motion, slowest, least, 10.0 * least);
}

enum mk_status none_is_used(const mk_log &first, enum mk_data_use use, bool moves, mk_error *err)
{
    if (!moves)
        return mk_error_at(err, MK_ERR_RANGE, first.path, 0, 0,
                           "nothing moves in this log: there is nothing to %s",
                           use == MK_DATA_HOLD_OUT ? "measure on" : "learn from it");
    return mk_error_at(err, MK_ERR_RANGE, first.path, 0, 0,
                       "too short to measure a gain on: give a longer log with --holdout");
}

} // namespace

} // namespace mk

const char *mk_data_severity_name(enum mk_data_severity severity)
{
    return severity == MK_DATA_FATAL ? "fatal" : "doubt";
}

const mk_data_finding *mk_data_check_fatal(const mk_data_check *check)
{
    return check->count > 0 && check->finding[0].severity == MK_DATA_FATAL ? check->finding
                                                                           : nullptr;
}

bool mk_data_check_uses(const mk_model *model, const mk_log *log, enum mk_data_use use)
{
    mk_record record;
    if (mk_record_from_log(log, model, &record, nullptr) != MK_OK)
        return false;
    return mk::record_moves(record, *model) &&
           (use != MK_DATA_HOLD_OUT || mk::duration_of(record) >= mk::least_to_hold_out(*model));
}

enum mk_status mk_data_check_logs(const mk_model *model, const mk_log *const *logs, size_t count,
                                  enum mk_data_use use, int threads, mk_data_check *check,
                                  mk_error *err)
try {
    using namespace mk;
    const bool learns = use != MK_DATA_SIMULATE;
    std::vector<mk_record> record(count);
    enum mk_status st = MK_OK;
    for (size_t i = 0; i < count && st == MK_OK; i++)
        st = take_record(*model, *logs[i], use, record[i], err);
    if (st != MK_OK)
        return st;
    double seconds = 0.0;
    size_t used = 0;
    bool moves = false;
    std::vector<mk_data_check> found(count);
    parallel_for(threads_for(threads), count, [&](size_t i) {
        found[i] = {};
        Findings out(found[i], *logs[i]);
        if (learns && !record_moves(record[i], *model))
            out.doubt("nothing moves in this log, and it is left out",
                      "check that the motor was on and the encoders were read");
        else
            check_all({*logs[i], *model, record[i]}, use, out);
    });
    for (size_t i = 0; i < count; i++) {
        Findings::append(*check, found[i]);
        moves = moves || record_moves(record[i], *model);
        if (learns && !record_moves(record[i], *model))
            continue;
        used += mk_data_check_uses(model, logs[i], use);
        seconds += duration_of(record[i]);
    }
    if (learns && count > 0 && used == 0)
        return none_is_used(*logs[0], use, moves, err);
    return use == MK_DATA_EXPLAIN ? check_total(*model, logs[0]->path, seconds, err) : MK_OK;
} catch (const std::bad_alloc &) {
    return mk_error_set(err, MK_ERR_NOMEM, "no memory to check the data");
}
