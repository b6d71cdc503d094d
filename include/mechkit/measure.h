/* Simple experiments, each for a number or two that theory relates to what is seen (report 2.1,
 * 3.2, 3.4): friction from runs at constant speed, inertia from runs at constant acceleration, the
 * natural frequency of free swings, the motor's torque constant from a slow sweep.
 * docs/identification.md.
 */
#ifndef MECHKIT_MEASURE_H
#define MECHKIT_MEASURE_H

#include <stdbool.h>
#include <stddef.h>

#include "mechkit/log.h"
#include "mechkit/model.h"
#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

#define MK_MAX_QUANTITIES 12
#define MK_MAX_RUNS 400
#define MK_MAX_MEASURE_WARNINGS 8

struct mk_measure_info {
    const char *name;   /* "friction" */
    const char *help;   /* one line */
    const char *source; /* section of the report */
    unsigned plants;    /* bit (1u << enum mk_plant_kind) */
    /* What each piece of the logs gives: headings of run[].x, .y; units. */
    const char *x_name, *x_unit, *y_name, *y_unit;
    const char *known; /* what `known` is, with unit; NULL: not used */
};
/* How many kinds of measurement there are: indices 0 .. count - 1. */
int mk_measure_count(void);
const struct mk_measure_info *mk_measure_kind(int index); /* NULL out of range; static */
/* The kind of that name; NULL: unknown. Static. */
const struct mk_measure_info *mk_measure_by_name(const char *name);

struct mk_measure_options {
    double known; /* in SI, weighed or computed from a drawing; 0: not known */
    int threads;  /* 0: as many as there are processors */
};

struct mk_quantity {
    char name[40];
    const char *unit; /* static; torques in the model's units */
    double value;
    double std_error; /* NaN: unknown */
    double given;     /* what the model says; NaN: nothing */
};

/* One piece of a log: a constant speed, a ramp, a swing. */
struct mk_measure_run {
    size_t log;          /* index */
    double begin, end;   /* s */
    double x, y, misfit; /* misfit: of y to the result; NaN: does not apply */
};

struct mk_measurement {
    const struct mk_measure_info *kind;
    /* The given model with what was measured in the place of its values. */
    struct mk_model model;
    int quantity_count;
    struct mk_quantity quantity[MK_MAX_QUANTITIES];
    int run_count; /* at most MK_MAX_RUNS are kept; all are used */
    struct mk_measure_run run[MK_MAX_RUNS];
    int warning_count;
    char warning[MK_MAX_MEASURE_WARNINGS][160];
};

/* MK_ERR_NOTFOUND (kind), MK_ERR_NOTSUP (not of this rig), MK_ERR_PARSE (a log does not fit the
 * model), MK_ERR_RANGE (the logs do not show such an experiment), MK_ERR_NUMERIC, MK_ERR_NOMEM.
 * Pure.
 */
MK_NODISCARD enum mk_status mk_measure(const char *kind, const struct mk_model *model,
                                       const struct mk_log *const *logs, size_t log_count,
                                       const struct mk_measure_options *options,
                                       struct mk_measurement *out, struct mk_error *err);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
