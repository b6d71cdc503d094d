/* Identification: a model's parameters from measured logs.
 *
 * Methods are a table (docs/identification.md). Meesters' linear methods regress filtered
 * derivatives on the plant's regressor and fit the base parameters; `output-error` fits the
 * measured angles themselves by maximum likelihood, effects of the model included.
 *
 * Parameters of a fit are numbered: base parameters first, then those of the effects in order;
 * names are "p1" and "effect.backlash.width" ("effect.coulomb.2.level" for a second one).
 */
#ifndef MECHKIT_IDENT_H
#define MECHKIT_IDENT_H

#include <stdbool.h>
#include <stddef.h>

#include "mechkit/data_check.h"
#include "mechkit/log.h"
#include "mechkit/model.h"
#include "mechkit/sim.h"
#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

#define MK_MAX_FIT_WARNINGS 16

struct mk_ident_method_info {
    const char *name;   /* "output-error" */
    const char *help;   /* one line */
    const char *source; /* equation or paper */
    bool fits_effects;  /* false: only the base parameters */
};
/* How many methods there are: indices 0 .. count - 1. */
int mk_ident_method_count(void);
const struct mk_ident_method_info *mk_ident_method(int index); /* NULL out of range; static */
/* The method of that name; NULL: unknown, or no name. Static. */
const struct mk_ident_method_info *mk_ident_method_by_name(const char *name);

/* Called now and then from the thread that called mk_identify: `done` in 0..1, what is being done.
 * Returning false stops the fit (MK_ERR_INTR). */
typedef bool (*mk_progress_fn)(void *context, double done, const char *what);

/* --- rows that are left out ------------------------------------------------------------------ */

/* Which rows of logs are used; all zero: those in which the rig is on its own. Times are s from the
 * first row of each log. */
struct mk_row_choice {
    double from_s, to_s; /* only rows between; to_s 0: up to the end */
    bool keep_all;       /* foreign contact is kept */
};

struct mk_left_out {
    size_t log;          /* number among those given */
    double from_s, to_s; /* s from its first row */
    double log_s;        /* how long the whole log is */
    int joint;           /* foreign contact: in whose equation, 1-based; 0: was not asked for */
    char file[128];      /* the log's path, "" without one */
    char why[160];       /* half a sentence */
};
#define MK_MAX_LEFT_OUT 256

/* What is left out of logs: rows that were not asked for, and stretches of foreign contact, as a
 * hand or a kick (docs/identification.md), which are looked for in all logs together. `out` has
 * room for MK_MAX_LEFT_OUT. MK_ERR_PARSE (a log does not fit the model), MK_ERR_RANGE (of a log
 * nothing was asked for, or there are too many stretches), MK_ERR_NOMEM. */
MK_NODISCARD enum mk_status mk_find_left_out(const struct mk_model *model,
                                             const struct mk_log *const *logs, size_t log_count,
                                             const struct mk_row_choice *choice,
                                             struct mk_left_out *out, int *count,
                                             struct mk_error *err);
/* A copy of log number `number` without its angles in these rows, which a column `left_out` marks
 * with 1: fits and predictions pass over them. *out is NULL where none of them is left out. The
 * caller frees it. MK_ERR_NOMEM. */
MK_NODISCARD enum mk_status mk_leave_out(const struct mk_log *log, size_t number,
                                         const struct mk_left_out *left_out, int count,
                                         struct mk_log **out, struct mk_error *err);

/* --- fits ------------------------------------------------------------------------------------ */

struct mk_ident_options {
    const char *method; /* NULL: "output-error" */
    /* Linear methods: equations are averaged over windows of 1 / cutoff_hz, which pass half of that
     * frequency's amplitude; 0: 3 Hz. */
    double cutoff_hz;
    /* Parameters held at the model's value, by number as above. */
    bool fixed[MK_MAX_FIT_PARAMETERS];
    /* Parameters of which the model's value says nothing (mk_model_read_open). */
    bool unknown[MK_MAX_FIT_PARAMETERS];
    int threads; /* 0: as many as there are processors */
    /* What mk_data_check_logs said of these logs for MK_DATA_IDENTIFY; NULL: it is asked. */
    const struct mk_data_check *data_check;
    bool force; /* fits in spite of a fatal finding */
    struct mk_row_choice rows;
    mk_progress_fn progress;
    void *progress_context;
};

struct mk_ident_parameter {
    char name[64];
    const char *unit;      /* static */
    double initial, value; /* initial: as given, NaN where that was unknown */
    double std_error;      /* NaN: not determined by the data */
    double crb;            /* Cramer-Rao bound on the standard error at the estimate; NaN unknown */
    bool fixed;            /* was not fitted */
    bool at_bound;         /* of its physical range */
    bool excited;          /* the data say something about it */
};

/* What a log has of its own of a parameter whose spread from log to log is above 0. */
struct mk_own_value {
    int parameter; /* its number */
    size_t log;    /* number of the log among those given */
    double value, std_error;
};
#define MK_MAX_OWN_VALUES 256

/* What data tell about a parameter where the scale is free: how it compares with the held one. */
struct mk_ident_ratio {
    char name[132]; /* "p2/p1" */
    char unit[24];  /* SI, "1/s^2"; the same in command units */
    int parameter;  /* number of the first */
    double value;
    double std_error; /* NaN: not determined by the data */
};

struct mk_ident_result {
    struct mk_model model; /* fitted: values, spreads and standard errors filled in */
    char method[24];
    int parameter_count;
    struct mk_ident_parameter parameter[MK_MAX_FIT_PARAMETERS];
    /* Row-major, parameter_count squared; rows of parameters that were fixed are 0. */
    double covariance[MK_MAX_FIT_PARAMETERS * MK_MAX_FIT_PARAMETERS];
    double condition_number;        /* of the stacked regressor or sensitivity matrix */
    double condition_number_scaled; /* the same with columns scaled to unit norm */
    double cost;                    /* what the method minimises, at the estimate */
    /* Standard deviation of the readings' noise, in the joint's unit; NaN unknown. Where the model
     * does not follow the data (a warning says so) no more than what the readings scatter: what it
     * misses is no noise. */
    double noise[MK_MAX_JOINTS];
    int own_count;
    struct mk_own_value own[MK_MAX_OWN_VALUES]; /* by log; what does not fit is left out */
    /* Data without a torque show ratios of inertias, weights, frictions and stiffnesses alone, for
     * all of them may be multiplied by one number. Parameter `scale_holder` then keeps its given
     * value; standard errors of the others are NaN, or follow from that of the held one if the
     * model has it, and the covariance is that at the held value. */
    bool scale_free;
    int scale_holder;
    int ratio_count;
    struct mk_ident_ratio ratio[MK_MAX_FIT_PARAMETERS];
    int iterations;
    bool converged;
    size_t rows; /* readings used */
    int left_out_count;
    struct mk_left_out left_out[MK_MAX_LEFT_OUT];
    int warning_count;
    char warning[MK_MAX_FIT_WARNINGS][320];
    struct mk_data_check data_check; /* what is doubted of the logs */
    double seconds;                  /* wall clock */
};

/* Fits `model` to `logs`; one in which nothing moves is left out. On failure *out is untouched.
 * MK_ERR_PARSE (a log does not fit the model), MK_ERR_RANGE (too few rows, no motion in any log,
 * nothing to fit), MK_ERR_EXPECT (a fatal finding of the data check), MK_ERR_NUMERIC (no
 * convergence to anything), MK_ERR_NOTFOUND (method), MK_ERR_INTR, MK_ERR_NOMEM. Pure: logs and
 * model are read only; several calls may run at the same time. */
MK_NODISCARD enum mk_status mk_identify(const struct mk_model *model,
                                        const struct mk_log *const *logs, size_t log_count,
                                        const struct mk_ident_options *options,
                                        struct mk_ident_result *out, struct mk_error *err);

/* Which column drives a model, as a hypothesis (docs/identification.md, "Which column drives it").
 */
struct mk_input_comparison {
    bool made;           /* false: there was nothing to compare; all else is 0 */
    enum mk_input taken; /* measured or commanded: the one that predicts logs that were left out
                            surely better; else what the model says, or measured */
    bool changed;        /* that is not what the model says */
    int logs, better;    /* left out in turn; in how many the commanded column predicts better */
    double window_s;     /* of the free runs over them */
    /* Their nrmse, by column: [MK_INPUT_MEASURED], [MK_INPUT_COMMANDED]. */
    double nrmse[MK_INPUT_COUNT][MK_MAX_JOINTS];
    /* Squared error with the commanded column over that with the measured one: geometric mean over
     * windows, then over logs, and the standard error of its logarithm. */
    double ratio, log_error;
    /* How late the command acts and with which time constant its drive follows, s, as fitted to all
     * logs; 0 where it has none. */
    double delay, delay_error, lag, lag_error;
    struct mk_model
        model; /* the given one with the taken column, and delay and lag if it is late */
    struct mk_model fitted[MK_INPUT_COUNT]; /* by column, to all logs */
};

/* Whether a log has both columns of the command of such a rig. */
bool mk_log_has_both_inputs(const struct mk_log *log, const struct mk_model *model);

/* Fits free runs of the model with either column to all logs, and judges them by what fits to all
 * but one would leave in that one, every log once (of long logs the middles). `options`: fixed,
 * unknown, threads, progress. MK_ERR_RANGE where there are not two logs at least that have both
 * columns and in which something moves, MK_ERR_NUMERIC (cannot be fitted), MK_ERR_INTR,
 * MK_ERR_NOMEM. Pure, as mk_identify. */
MK_NODISCARD enum mk_status mk_compare_inputs(const struct mk_model *model,
                                              const struct mk_log *const *logs, size_t log_count,
                                              const struct mk_ident_options *options,
                                              struct mk_input_comparison *out,
                                              struct mk_error *err);

/* Value of parameter `index` of a model, numbered as above (range checked by the caller). */
double mk_model_parameter(const struct mk_model *model, int index);
/* Sets it to any value: ranges are mk_model_check's. The index is checked by the caller. */
void mk_model_set_parameter(struct mk_model *model, int index, double value);
/* Its standard deviation from log to log; 0 where all logs share it, as base parameters always are.
 */
double mk_model_parameter_spread(const struct mk_model *model, int index);
/* Sets the standard deviation from log to log, in the parameter's unit, at least 0; base parameters
 * have none and stay as they are. */
void mk_model_set_parameter_spread(struct mk_model *model, int index, double spread);
/* Its row: unit, range; name written to `name`. */
const struct mk_parameter_info *mk_model_parameter_info(const struct mk_model *model, int index,
                                                        char *name, size_t size);
/* Its unit in this model (mk_model_unit at the joint that it belongs to). Static. */
const char *mk_model_parameter_unit(const struct mk_model *model, int index);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
