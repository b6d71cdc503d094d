/* Data checks: whether measured logs can be what they are taken for, before anything is learned
 * from them. One list of findings, each with what is wrong and what to do about it; all that
 * mechkit doubts of data is in it. mk_identify and mk_explain ask for it themselves, end where a
 * finding is fatal, and carry the list in their results.
 *
 * Not RT-safe (allocates). Pure: several threads may check at once.
 */
#ifndef MECHKIT_DATA_CHECK_H
#define MECHKIT_DATA_CHECK_H

#include <stdbool.h>
#include <stddef.h>

#include "mechkit/log.h"
#include "mechkit/model.h"
#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

enum mk_data_severity {
    MK_DATA_DOUBT, /* may be wrong, or costs accuracy: to be looked at */
    MK_DATA_FATAL  /* would make every later answer meaningless: a flipped sign, swapped columns, a
                      wrong unit, where that is certain */
};

struct mk_data_finding {
    char file[256]; /* path of the log */
    int line;       /* in it, 1-based; 0: all of it */
    enum mk_data_severity severity;
    char what[320];   /* what is wrong: a sentence without a full stop */
    char remedy[320]; /* what to do about it */
};

#define MK_MAX_DATA_FINDINGS 48

/* Fatal findings first, else in the order of the logs. What goes beyond the room is left out,
 * doubts first. */
struct mk_data_check {
    int count;
    struct mk_data_finding finding[MK_MAX_DATA_FINDINGS];
};

/* What logs are for. */
enum mk_data_use {
    MK_DATA_SIMULATE, /* values only: no look at how the rig moves */
    MK_DATA_IDENTIFY,
    MK_DATA_EXPLAIN,
    MK_DATA_HOLD_OUT /* to measure on */
};

/* Appends to *check (the caller zeroes it first) what is found in logs of the rig that `model` is
 * of. A log that is left out is a doubt. MK_ERR_PARSE: a log does not fit the model; MK_ERR_RANGE:
 * values that no rig has, too few of them, too short a time, or none of the logs moves: such data
 * cannot be used, forced or not. MK_ERR_NOMEM. Logs are checked side by side on `threads` (0: as
 * many as there are processors); the findings are the same. */
MK_NODISCARD enum mk_status mk_data_check_logs(const struct mk_model *model,
                                               const struct mk_log *const *logs, size_t count,
                                               enum mk_data_use use, int threads,
                                               struct mk_data_check *check, struct mk_error *err);

/* Whether a log is used, and not left out because nothing moves in it or, to measure on, because it
 * is too short. A log that fits the model. */
bool mk_data_check_uses(const struct mk_model *model, const struct mk_log *log,
                        enum mk_data_use use);

/* Gives the rows of a log even times where the check doubts theirs: where they scatter about even
 * steps and the readings are at least twice as smooth at those. Steps over rows that were dropped
 * stay. False: the log is as it was; it does not fit the model, its times are right, one would move
 * by more than a step, or there is no memory. */
bool mk_data_take_even_times(const struct mk_model *model, struct mk_log *log);

/* The first fatal finding, NULL: there is none. Of `check`. */
const struct mk_data_finding *mk_data_check_fatal(const struct mk_data_check *check);

/* "doubt", "fatal". Static. */
const char *mk_data_severity_name(enum mk_data_severity severity);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
