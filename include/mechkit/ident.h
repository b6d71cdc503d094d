/* Identification: a model's parameters from measured logs.
 *
 * Methods are a table (docs/identification.md). The report's linear methods regress filtered
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
int mk_ident_method_count(void);
const struct mk_ident_method_info *mk_ident_method(int index); /* NULL out of range; static */
const struct mk_ident_method_info *mk_ident_method_by_name(const char *name);

/* Called now and then from the thread that called mk_identify: `done` in 0..1, what is being done.
 * Returning false stops the fit (MK_ERR_INTR). */
typedef bool (*mk_progress_fn)(void *context, double done, const char *what);

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
    double noise[MK_MAX_JOINTS]; /* standard deviation of the readings' noise, rad; NaN unknown */
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

/* Value of parameter `index` of a model, numbered as above (range checked by the caller). */
double mk_model_parameter(const struct mk_model *model, int index);
void mk_model_set_parameter(struct mk_model *model, int index, double value);
/* Its standard deviation from log to log; 0 where all logs share it, as base parameters always are.
 */
double mk_model_parameter_spread(const struct mk_model *model, int index);
void mk_model_set_parameter_spread(struct mk_model *model, int index, double spread);
/* Its row: unit, range; name written to `name`. */
const struct mk_parameter_info *mk_model_parameter_info(const struct mk_model *model, int index,
                                                        char *name, size_t size);
/* A row's unit as it is in this model: where u_to_torque is not 1, torques are in units of the
 * command, "u" ("N m s/rad" is "u s/rad"). Static. */
const char *mk_model_unit(const struct mk_model *model, const char *unit);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
