/* Explaining data: what the simulation gets wrong, which physical cause that has, the model with
 * that cause in it, and what it gains on data it did not see. docs/explain.md says how it decides.
 */
#ifndef MECHKIT_EXPLAIN_H
#define MECHKIT_EXPLAIN_H

#include <stdbool.h>
#include <stddef.h>

#include "mechkit/data_check.h"
#include "mechkit/ident.h"
#include "mechkit/log.h"
#include "mechkit/model.h"
#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

#define MK_MAX_CAUSES 9
#define MK_MAX_LOG_VALUES 4
#define MK_MAX_RIVALS 12

enum mk_verdict {
    MK_VERDICT_NONE,       /* the model explains the data */
    MK_VERDICT_PARAMETERS, /* only values of base parameters were wrong */
    MK_VERDICT_EFFECT,     /* named causes */
    MK_VERDICT_PARTIAL,    /* named causes are sure, a significant rest is not explained */
    MK_VERDICT_UNKNOWN     /* a significant misfit that no entry of the catalogue explains */
};
const char *mk_verdict_name(enum mk_verdict verdict); /* "none", "parameters", ... */

struct mk_cause {
    const struct mk_effect_info *effect;
    int joint; /* 1-based; 0: no joint */
    double value[MK_MAX_EFFECT_PARAMETERS];
    double std_error[MK_MAX_EFFECT_PARAMETERS]; /* NaN: not determined, or not fitted */
    /* From log to log, of a value that every log has of its own; `value` is then the mean. 0: all
     * logs share it. */
    double spread[MK_MAX_EFFECT_PARAMETERS];
    /* Of the model without it against the one with it; > 0 speaks for it. Evidence are the
     * readings; where no model follows them, errors of free runs, one in 0.05 s (docs/explain.md).
     */
    double delta_bic;
    double p_value;    /* likelihood ratio, corrected for the number of causes tried */
    double confidence; /* 0..0.99, against its best rival */
    /* It has no name: a term of the library, or a law of friction whose size hangs on such a term
     * at its joint. */
    bool piece;
};

/* A parameter that differs from log to log, in one of them. */
struct mk_per_log {
    int log; /* number among those learned from */
    const struct mk_effect_info *effect;
    int joint, parameter;    /* of the effect */
    double value, std_error; /* of this log, in the parameter's unit */
    /* Only how far the logs are apart is known, and std_error is of that: what they have in common
     * stands for other parameters of the model as well. */
    bool mean_open;
};
#define MK_MAX_PER_LOG 128

/* Where the counter of a joint was zeroed in each log, where nothing in the given model depends on
 * it: a wheel, an arm that turns level, a carriage. Found from what repeats with the angle, and
 * known but for multiples of 1/`cycles` of a turn. The readings are shifted by it, so that all that
 * is told of the joint counts from the zero of the first log. */
#define MK_MAX_PLACES 64
struct mk_places {
    int joint;                       /* 1-based; 0: nothing of the kind was found */
    const struct mk_effect_info *by; /* what repeats with the angle */
    double cycles;
    int learned; /* so many of `count` are of logs learned from, the others of hold-out logs */
    int count;
    double shift[MK_MAX_PLACES], std_error[MK_MAX_PLACES]; /* rad or m, added to the readings */
};

struct mk_rival {
    const struct mk_effect_info *effect;
    int joint;
    int instead_of;   /* index of the cause it would replace */
    double delta_bic; /* of its model against the best one */
    bool distinguishable;
};

/* A cause that was asked whether it improves the prediction of data left out, seemed to, and did
 * not surely: no finding, but where to look. */
struct mk_suspect {
    const struct mk_effect_info *effect;
    int joint;    /* 1-based; 0: no joint */
    double share; /* of the gap of the training data that it closed when left out */
    int parts,
        better_in; /* logs (or blocks of them) that were left out; in how many it was better */
};
#define MK_MAX_SUSPECTS 5

/* What acted on the rig beyond the refitted model during one shooting interval (60 ms) of the
 * training data. */
struct mk_residual_torque {
    double t;                                  /* s from the start of its log */
    double q[MK_MAX_JOINTS], v[MK_MAX_JOINTS]; /* in the middle of the interval */
    double u;
    /* Mean residual torque in the equation of each joint, in the model's torque units (command
     * units, or N m where u_to_torque is 1). */
    double torque[MK_MAX_JOINTS];
};
#define MK_MAX_RESIDUAL_TORQUES 400

/* What one-step predictions miss, held against something that is known then. */
struct mk_residual_test {
    int joint;                /* whose readings */
    const char *with;         /* "itself": whiteness by the first 20 autocorrelations; "q1", "dq1",
                                 "sign(dq1)", ..., "u", "t": correlation. Static. */
    double before, after;     /* of the refitted and of the best model: rms autocorrelation, or
                                 correlation, -1..1 */
    double p_before, p_after; /* probability of as much by chance (Ljung-Box; Fisher's z) */
};
#define MK_MAX_RESIDUAL_TESTS 20

/* The smallest size of a cause that these data would have shown: at which it would be named. */
struct mk_detection_limit {
    const struct mk_effect_info *effect;
    int joint;     /* 1-based; 0: no joint */
    int parameter; /* of the effect: its size */
    double least;  /* in the parameter's unit */
};
#define MK_MAX_DETECTION_LIMITS 32

/* An experiment that would tell the best hypothesis from a rival. */
struct mk_next_experiment {
    int rival;      /* index; -1: none was looked for */
    char input[64]; /* signal (mechkit/signal.h) from rest; empty: none within the limits does */
    double seconds;
    double odds;   /* expected log likelihood ratio, the loser fitted again */
    char why[320]; /* a sentence */
};

/* What a controller makes of it: medians over runs on a virtual rig that is the extended model. */
struct mk_control_figures {
    double held;     /* share of the runs that were caught and held, or had no fault; 0 as well
                        where the first two were not, and the others not made */
    double caught_s; /* NAN: never, or nothing to catch */
    double error;    /* rms: sway of the upright link about its mean, rad; speed control: rad/s */
    double off;      /* rms of joint 1 from where the setup holds it, rad; NAN: nowhere */
    double effort;   /* rms of the command while held */
    double peak;     /* of the command */
};
/* By what the controller believes. */
struct mk_control_gain {
    const char *setup; /* static */
    int runs;
    struct mk_control_figures given, refit, extended;
};
#define MK_MAX_CONTROL_GAINS 2

/* What a part of the gap between the refitted model and the readings is due to. */
struct mk_budget_item {
    int cause;        /* index into cause[]; -1: another one */
    int log_value;    /* index into log_value[]; -1: another one */
    bool input;       /* the other column of the command, with its delay and lag */
    double share;     /* of the gap, what it closes in all orders of adding causes (Shapley): 0 to
                         `closed`, where that is above 0 */
    double low, high; /* 90 % interval of the share, by resampling the held-out logs */
    double inclusion; /* share of resamples of the training logs that choose it; NaN: not asked */
    double rms[MK_MAX_JOINTS]; /* error of a free run with this item and those before it */
};
#define MK_MAX_BUDGET (MK_MAX_CAUSES + MK_MAX_LOG_VALUES + 1)

/* Free runs on held-out data: what the simulation gets wrong, what that is due to and what is left.
 * Errors are root mean squares by joint, in rad or m. */
struct mk_budget {
    double given[MK_MAX_JOINTS], refit[MK_MAX_JOINTS], extended[MK_MAX_JOINTS];
    double noise[MK_MAX_JOINTS]; /* of the readings */
    double closed; /* of the gap between refit and noise, in squares, mean over the joints */
    int item_count;
    struct mk_budget_item
        item[MK_MAX_BUDGET]; /* the largest share first; they sum up to `closed` */
    double rest;             /* 1 - closed */
    int rest_joint;          /* 1-based, of most of the rest; 0: there is none beyond the noise */
    int goes_with_count;
    const char *goes_with[3]; /* what the rest is correlated with: "sign(dq1)", ... Static. */
};

/* How long a stage of the search took. */
struct mk_stage_time {
    const char *name; /* "refit", "search", ... Static. */
    double seconds;
};
#define MK_MAX_STAGES 16

struct mk_explain_options {
    /* Parameters of which the model's value says nothing (mk_model_read_open). */
    bool unknown[MK_MAX_FIT_PARAMETERS];
    int threads;     /* 0: as many as there are processors */
    bool next;       /* look for a next experiment even where nothing is left open */
    double window_s; /* of the free runs that figures are given for; 0: 1 s */
    double most_s;   /* of data to search in, in windows spread evenly over the logs; 0: 30 s;
                        HUGE_VAL: all. The time that a search takes grows with it. */
    /* What mk_data_check_logs said of the logs (MK_DATA_EXPLAIN) and the hold-out logs
     * (MK_DATA_HOLD_OUT); NULL: it is asked. */
    const struct mk_data_check *data_check;
    bool force; /* searches in spite of a fatal finding */
    /* Where an extension is offered, fills `control`: the rig's set-ups are tried on a virtual rig
     * that is the extended model (some seconds). False: `control_count` is 0. */
    bool control;
    struct mk_row_choice rows;
    mk_progress_fn progress;
    void *progress_context;
};

/* What a report was made of and how; texts are the caller's. */
struct mk_origin {
    const char *date;    /* ISO 8601, UTC */
    const char *command; /* as it was typed */
    const char *model;   /* file */
    const char *const *logs;
    size_t log_count;
};

struct mk_explanation {
    enum mk_verdict verdict;
    int cause_count;
    /* First the one without which held-out data are predicted worst, pieces last; for "unknown":
     * what the structure consists of. */
    struct mk_cause cause[MK_MAX_CAUSES];
    int piece_count; /* of the causes */
    /* What differs from log to log, found before any cause: causes too, each with a spread. The
     * refitted model has one value for all logs, that is none; `extended` has them. */
    int log_value_count;
    struct mk_cause log_value[MK_MAX_LOG_VALUES];
    int per_log_count;
    struct mk_per_log per_log[MK_MAX_PER_LOG];
    struct mk_places places;
    /* How far dry friction can hold each joint from where it would hang, rad; NaN: it hangs
     * nowhere. That is how far off a zero may be that is taken there. */
    double held_off[MK_MAX_JOINTS];
    /* Which of the logs' columns drives the rig, found before all else where they have both. If it
     * is not the given model's (`changed`) that is a finding: `refit` has the given column,
     * `extended` the other, with the delay and the lag that are told here. */
    struct mk_input_comparison input;
    int rival_count;
    struct mk_rival rival[MK_MAX_RIVALS]; /* nearest first */
    int suspect_count;
    struct mk_suspect
        suspect[MK_MAX_SUSPECTS]; /* likeliest first; none of them is among the causes */
    bool partly_named; /* verdict unknown, but its terms are entries of the catalogue: they explain
                          a part */
    char structure[512]; /* of the residual torque when unknown, e.g. "joint 2: -0.013 dq2|dq2|" */

    /* extended: what to use from now on. With the causes in it if `offered`; else, because they
     * predict held-out data worse or there are none, the refitted model (verdict none: the given).
     */
    struct mk_model given, refit, extended;
    bool offered;
    /* No command acts in the logs: all inertias, weights, frictions and stiffnesses may be
     * multiplied by one number. Parameter `scale_holder` has kept its given value, all others,
     * those of causes too, and their standard errors are counted in it. */
    bool scale_free;
    int scale_holder;
    /* Base parameters of which no value was given: in `given` they have what the fit began with. */
    bool unknown[MK_MAX_PARAMETERS];
    double
        std_error[MK_MAX_PARAMETERS]; /* of the fitted base parameters (`extended`, or `refit`) */
    double noise[MK_MAX_JOINTS];      /* of the readings, rad */
    /* Process noise of the speeds that each model needs to follow the data, rad/s per sqrt(s): how
     * much it lacks. */
    double process_noise_refit, process_noise_extended;
    /* In log likelihood: of refitting (from the estimate's covariance), of the causes on top. */
    double gain_refit, gain_extended;
    int tried; /* causes looked at */

    /* Of the logs, then of the hold-out logs, numbered on. */
    int left_out_count;
    struct mk_left_out left_out[MK_MAX_LEFT_OUT];
    double given_s, searched_s; /* data to learn from, and what of it was searched in */
    double window_s;
    bool held_back; /* no hold-out logs were given: the end of the last log was held back, of one
                       that ends at rest the end of its motion */
    double held_from, held_to; /* s from its start, where that begins and ends */
    double before[MK_MAX_JOINTS], refitted[MK_MAX_JOINTS], after[MK_MAX_JOINTS];
    double floor[MK_MAX_JOINTS]; /* nrmse on the hold-out; floor: of the readings' own noise */
    struct mk_budget budget;
    /* As `after`, but on the training data: where held-out data are predicted far worse than they
     * are read; else 0. In shares of the held-out readings' deviation, like the others. */
    double trained[MK_MAX_JOINTS];
    /* The largest command in the held-out data over the largest one in those to learn from; 0: none
     * acts there. */
    double command_beyond;
    /* Missed counts that were corrected in the held-out data before anything was measured on them.
     */
    int held_counts_corrected;
    double declined[MK_MAX_JOINTS]; /* of an extension that is not offered; else 0 */
    double closed;
    int residual_torque_count;
    struct mk_residual_torque residual_torque[MK_MAX_RESIDUAL_TORQUES];
    double missing[MK_MAX_JOINTS]; /* rms of the residual torque in each equation, same units */
    /* One-step predictions of the readings by both models with the process noise that the best one
     * needs: rms error over its predicted standard deviation, 1 for a right model; 0: not found. */
    double one_step_refit[MK_MAX_JOINTS], one_step_extended[MK_MAX_JOINTS];
    int residual_test_count;
    struct mk_residual_test residual_test[MK_MAX_RESIDUAL_TESTS];
    /* Of causes that were looked for and not found, in the order of the catalogue. */
    int detection_limit_count;
    struct mk_detection_limit detection_limit[MK_MAX_DETECTION_LIMITS];
    struct mk_next_experiment next;
    /* Of trials of controllers on a virtual board, where options.control asks for them. */
    int control_count;
    struct mk_control_gain control[MK_MAX_CONTROL_GAINS];
    struct mk_data_check data_check; /* what is doubted of the logs */
    double seconds;
    int stage_count; /* in the order in which they were first entered */
    struct mk_stage_time stage[MK_MAX_STAGES];
    /* Filled in by who knows, for the reports; mk_explain leaves it at NULL. The caller's, and it
     * must stay as long as reports are written. */
    const struct mk_origin *origin;
};

/* Logs in which nothing moves are left out, and hold-out logs that are too short as well.
 * `holdout_count` may be 0. On success *out is filled. MK_ERR_PARSE, MK_ERR_RANGE (too little data,
 * no motion), MK_ERR_EXPECT (a fatal finding of the data check), MK_ERR_NUMERIC (the model cannot
 * follow the data at all), MK_ERR_INTR, MK_ERR_NOMEM. The same input gives the same answer,
 * whatever the number of threads. */
MK_NODISCARD enum mk_status mk_explain(const struct mk_model *model,
                                       const struct mk_log *const *logs, size_t log_count,
                                       const struct mk_log *const *holdouts, size_t holdout_count,
                                       const struct mk_explain_options *options,
                                       struct mk_explanation *out, struct mk_error *err);

/* An item of the budget in words, without a verb: "cogging at joint 1, amplitude 0.107 +- 0.0002 N
 * m", or of a term without a name its formula. Cut to `size` bytes. */
void mk_budget_item_name(const struct mk_explanation *e, const struct mk_budget_item *item,
                         char *text, size_t size);
/* What a setup does worse when it believes the extended model than when it believes the refitted or
 * the given one, by its trial: "holds fewer runs", "catches later" (by a quarter and 0.5 s), "sways
 * more" or "follows less closely" (by a quarter, and 0.5 mrad or 0.05 rad/s); *believing is then
 * which, "refitted" or "given". NULL: nothing. Static. */
const char *mk_control_gain_worse(const struct mk_control_gain *gain, const char **believing);
/* True where one of the setups that were tried does: then the model is none for controllers. */
bool mk_explanation_misleads_control(const struct mk_explanation *explanation);
/* Whether the given model predicts the held-out data far better than the one refitted to the logs:
 * then those are hardly of the same rig, or their signs, units or columns differ. */
bool mk_explanation_doubts_logs(const struct mk_explanation *explanation);
/* True where what was found explains the training data, be it nothing, and held-out data are
 * predicted ten times worse than they are read, and far worse than the training data are. At an
 * unstable equilibrium a free run grows from the smallest error at its start, in all logs alike. */
bool mk_explanation_misses_held_out(const struct mk_explanation *explanation);
/* True where the data to learn from are followed, those held out are predicted ten times worse than
 * they are read, and their commands are a fifth larger than any to learn from: a limit or a stop
 * that only these meet is in no model. */
bool mk_explanation_goes_beyond(const struct mk_explanation *explanation);
/* Whether an inertia or a moment (base parameter i) is beyond a third or three times of what was
 * given, in a model that leaves a rest: then something that the model lacks may be in its place. */
bool mk_explanation_doubts_mass(const struct mk_explanation *explanation, int i);
/* Whether what has a name closes all but a tenth of the gap, so that what has none is small. */
bool mk_explanation_leaves_little(const struct mk_explanation *explanation);

/* Writes report.json (docs/formats.md, section 3). `holdout_names` are the files' names. */
MK_NODISCARD enum mk_status mk_explanation_write_json(const struct mk_explanation *explanation,
                                                      const char *path,
                                                      const char *const *holdout_names,
                                                      size_t holdout_count, struct mk_error *err);

/* Writes the next experiment as a command file; `model` is the model file to name in it. Nothing is
 * written where there is none. */
MK_NODISCARD enum mk_status mk_explanation_write_next(const struct mk_explanation *explanation,
                                                      const char *path, const char *model,
                                                      struct mk_error *err);

/* Writes report.html, self-contained, with plots; `log` is a held-out log to show the models on. */
MK_NODISCARD enum mk_status mk_explanation_write_html(const struct mk_explanation *explanation,
                                                      const char *path, const struct mk_log *log,
                                                      struct mk_error *err);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
