/* Excitation: the input that tells most about a rig's parameters, within limits.
 *
 * Two kinds of criterion. By condition number (report 3.1.2): a rig with a motor on its only joint
 * is led along a Fourier series whose regressor is best conditioned. By information (any rig): the
 * command itself is a multisine, and what counts is the covariance that an estimate from its
 * readings can have at best (Cramer-Rao), foreseen by running the model. docs/identification.md.
 */
#ifndef MECHKIT_EXCITE_H
#define MECHKIT_EXCITE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mechkit/ident.h"
#include "mechkit/log.h"
#include "mechkit/model.h"
#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

#define MK_EXCITE_MAX_HARMONICS 12
#define MK_EXCITE_RIGS 4

enum mk_excite_criterion {
    MK_EXCITE_WORST,     /* largest relative standard error */
    MK_EXCITE_A,         /* sum of their squares: trace of the covariance */
    MK_EXCITE_D,         /* their product: determinant of the covariance */
    MK_EXCITE_CONDITION, /* condition number of the regressor, columns scaled to unit norm */
    MK_EXCITE_CONDITION_UNSCALED,
    MK_EXCITE_CRITERION_COUNT
};
const char *mk_excite_criterion_name(enum mk_excite_criterion criterion); /* "worst", "a", ... */
/* MK_EXCITE_CRITERION_COUNT when the name is unknown. */
enum mk_excite_criterion mk_excite_criterion_by_name(const char *name);

struct mk_excite_options {
    enum mk_excite_criterion criterion;
    double seconds; /* how long; a trajectory takes as many whole periods as fit */
    double rate_hz; /* of the loop that will run it */
    int harmonics;  /* 2 .. MK_EXCITE_MAX_HARMONICS */
    /* Limits. Angles as the log has them; not for wheels. */
    double u_max;
    double q_min[MK_MAX_JOINTS], q_max[MK_MAX_JOINTS];
    double v_max[MK_MAX_JOINTS];
    double noise[MK_MAX_JOINTS]; /* standard deviation of a reading, rad */
    /* Process noise of the speeds, rad/s per sqrt(s): how far the rig is from its model. */
    double process_noise;
    /* How far the parameters may be off, relative: the input must do well on the mean of the model
     * and MK_EXCITE_RIGS models drawn around it, and keep to the limits on all. 0: trust the model.
     * Information criteria only. */
    double spread;
    bool fixed[MK_MAX_FIT_PARAMETERS]; /* parameters that will not be fitted (mechkit/ident.h) */
    const char *against;               /* signal to compare with; NULL: u_max sin(6 t) */
    int evaluations;                   /* most inputs to try */
    uint64_t seed;
    int threads; /* 0: as many as there are processors */
    mk_progress_fn progress;
    void *progress_context;
};
/* Options that suit a model: the condition number where there is a motor on every joint, else the
 * worst error; limits well inside those of a run (mechkit/safety.h), encoder noise. */
void mk_excite_default(const struct mk_model *model, struct mk_excite_options *out);

/* What an input does and tells. */
struct mk_excite_figures {
    double std_error[MK_MAX_FIT_PARAMETERS]; /* relative; NaN: held or not in the model */
    double worst, a, d;                      /* their largest, root mean square, geometric mean */
    double condition, condition_scaled;      /* of the sensitivities of the readings */
    double u_max;
    double q_min[MK_MAX_JOINTS], q_max[MK_MAX_JOINTS], v_max[MK_MAX_JOINTS];
};

struct mk_excitation {
    struct mk_model model;
    enum mk_excite_criterion criterion;
    double seconds, rate_hz;
    char input[1024]; /* the multisine as a signal (mechkit/signal.h); empty for a trajectory */
    /* The plan: columns t, u; of a trajectory q1, dq1, ddq1 too. */
    struct mk_log *plan;
    double period; /* of a trajectory, s; NaN */
    /* Of the regressor along a trajectory (report 3.1.2); NaN for a multisine. */
    double regressor_condition, regressor_condition_scaled;
    struct mk_excite_figures figures;
    double worst_of_rigs; /* largest relative error on any model within `spread`; NaN without */
    char against[256];
    struct mk_excite_figures against_figures; /* NaN where that input runs away */
    int evaluations;
    double seconds_taken;
};

/* MK_ERR_RANGE (an option), MK_ERR_NOTSUP (a condition criterion for a rig with a joint without
 * motor), MK_ERR_PARSE (`against`), MK_ERR_NUMERIC (no input keeps to the limits), MK_ERR_INTR,
 * MK_ERR_NOMEM. The same options give the same answer whatever the number of threads. On success
 * the caller owns what is in *out: mk_excitation_clear. */
MK_NODISCARD enum mk_status mk_excite(const struct mk_model *model,
                                      const struct mk_excite_options *options,
                                      struct mk_excitation *out, struct mk_error *err);
void mk_excitation_clear(struct mk_excitation *excitation); /* frees the plan */

/* Writes a command file that runs it, "NAME.cmd"; a trajectory's command goes to NAME.csv beside
 * it. `model` is the model file to name in it. */
MK_NODISCARD enum mk_status mk_excitation_write(const struct mk_excitation *excitation,
                                                const char *path, const char *model,
                                                struct mk_error *err);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
