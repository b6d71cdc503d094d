/* Simulation: integration of a model under a sampled command, and free-run prediction of a log.
 *
 * The command is held between the edges it is given at (zero-order hold); integration stops exactly
 * at every edge, also at those that an input delay has shifted. Solvers are a table: SUNDIALS'
 * CVODE and ARKODE (events by root finding), and an explicit Dormand-Prince 8(5,3) for smooth
 * models.
 *
 * Handles: one thread at a time. After mk_sim_create, advancing allocates nothing.
 */
#ifndef MECHKIT_SIM_H
#define MECHKIT_SIM_H

#include <stdint.h>

#include "mechkit/log.h"
#include "mechkit/model.h"
#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

enum mk_solver {
    MK_SOLVER_DEFAULT, /* ARKODE's explicit method: over short samples it beat the multistep ones */
    MK_SOLVER_CVODE_ADAMS,
    MK_SOLVER_CVODE_BDF,
    MK_SOLVER_ARKODE_ERK,
    MK_SOLVER_DOP853, /* smooth models only, else MK_ERR_NOTSUP */
    MK_SOLVER_COUNT
};

/* The name as files and options have it; "?" out of range. Static. */
const char *mk_solver_name(enum mk_solver solver);
/* MK_SOLVER_COUNT when the name is unknown. */
enum mk_solver mk_solver_by_name(const char *name);

struct mk_sim_config {
    enum mk_solver solver;
    double rtol, atol; /* 0: the model's */
};

struct mk_sim_stats {
    uint64_t steps, rhs_evaluations, events, restarts;
};

struct mk_sim;

/* Copies the model. config NULL: defaults. MK_ERR_NOMEM, MK_ERR_NOTSUP, MK_ERR_RANGE (model). */
MK_NODISCARD enum mk_status mk_sim_create(const struct mk_model *model,
                                          const struct mk_sim_config *config, struct mk_sim **out,
                                          struct mk_error *err);
void mk_sim_destroy(struct mk_sim *sim); /* NULL allowed */

/* Puts the simulation at time t in state x (mk_model_state_count values) with the command history
 * `u_past` (2 values, held since ever; NULL: 0). */
MK_NODISCARD enum mk_status mk_sim_reset(struct mk_sim *sim, double t, const double *x,
                                         const double *u_past);

/* From now on with other values of the same plant and effects (mk_sim_create's checks hold for them
 * too); commands that are on their way keep their times, and later ones come after
 * them. Allocates nothing. MK_ERR_INVALID for
 * another structure, MK_ERR_RANGE. */
MK_NODISCARD enum mk_status mk_sim_set_values(struct mk_sim *sim, const struct mk_model *model,
                                              struct mk_error *err);

/* After a reset, before advancing, in the order of time: that the command u (2 values) was issued
 * at t (<= now). What the model's input delay still holds back of it comes into force later.
 * MK_ERR_STATE before a reset or for a time to come, MK_ERR_RANGE when too many commands are on
 * their way. */
MK_NODISCARD enum mk_status mk_sim_issued_before(struct mk_sim *sim, double t, const double *u,
                                                 struct mk_error *err);

/* Advances to t_end (> now) while the command issued from now on is u (2 values, held). What acts
 * on the rig is that command after the model's input delay. MK_ERR_NUMERIC when the solver gives
 * up. */
MK_NODISCARD enum mk_status mk_sim_advance(struct mk_sim *sim, double t_end, const double *u,
                                           struct mk_error *err);

/* Time that the simulation is at, s. */
double mk_sim_time(const struct mk_sim *sim);
const double *mk_sim_state(const struct mk_sim *sim); /* borrowed, valid until the next call */
/* What the encoders would read now, before quantisation (sensor delays included). */
void mk_sim_measure(const struct mk_sim *sim, double *y);
/* The command that acts on the rig now, after delay and limit (2 values). */
void mk_sim_applied(const struct mk_sim *sim, double *u);
/* Work of the integrator since the simulation was made. */
void mk_sim_get_stats(const struct mk_sim *sim, struct mk_sim_stats *out);

/* --- energy bookkeeping --------------------------------------------------------------------- */

struct mk_energy {
    double kinetic, potential; /* of the plant, torque units x rad */
    double work;               /* done by the motor since reset */
    double loss;               /* taken by friction and effects since reset */
};
/* kinetic + potential - (their sum at reset) = work - loss, to the tolerance: `work` is integrated
 * beside the states, `loss` is what is missing. MK_ERR_STATE before reset. */
MK_NODISCARD enum mk_status mk_sim_energy(const struct mk_sim *sim, struct mk_energy *out);

/* --- fast paths for smooth models ----------------------------------------------------------- */

/* Integrates `count` copies of a model from t0 over `samples` intervals of length dt.
 * model[i], x0[i * ns], u[(i * samples + k) * 2] (held; NULL: use `drive`), results
 * x[(i * (samples + 1) + k) * ns]. All models must be of one plant and smooth.
 * `drive` (may be NULL) instead gives u(t) as amplitude * sin(omega t + phase), continuous. */
struct mk_sine {
    double amplitude, omega, phase;
};
struct mk_batch {
    const struct mk_model *model;
    int model_count;
    double t0, dt;
    int samples;
    const double *x0;
    const double *u;
    const struct mk_sine *drive;
    double rtol, atol; /* 0: 1e-8, 1e-10 */
    double *x;
    uint64_t steps; /* out: accepted steps of all lanes */
};
/* MK_ERR_NOTSUP for models with states or events, MK_ERR_INVALID for mixed plants,
 * MK_ERR_NUMERIC when a step size underflows. */
MK_NODISCARD enum mk_status mk_simulate_batch(struct mk_batch *batch, struct mk_error *err);

/* --- prediction of a log -------------------------------------------------------------------- */

/* What a log says in the model's terms: the columns found under their various names. */
struct mk_record {
    size_t rows;
    const double *t;                /* s, borrowed from the log */
    double begins;                  /* t at which the run began, from which effects count the time:
                                       of the first row, or as the log's metadata say */
    const double *q[MK_MAX_JOINTS]; /* rad; NaN where a sample was dropped */
    /* Commands; NULL: 0 throughout. u[1] is NULL with one motor, u[0] where nothing drives the rig.
     */
    const double *u[MK_MAX_INPUTS];
    const double *late_us;  /* how late each exchange was; NULL: the log does not say, or
                               the board's own clock made the samples, on time */
    bool board_clock;       /* it did */
    const double *left_out; /* other than 0 in rows that are left out (mk_leave_out): they have
                               no readings, and no motion goes on across them; NULL: none */
    const double *flags;    /* as of mechkit/loop.h; NULL: the log has none */
    double u_to_torque;     /* 1 when the log has tau */
    bool si;                /* the log has tau */
};
/* Finds t, q1, q2, u | tau | u1,u2 | tau1,tau2 in a log for `model`, the command's column with _cmd
 * at its end where the model's input is the commanded one. A log needs no command where its
 * metadata say `input: none` or the model has no motor. MK_ERR_PARSE names what is missing, or that
 * the log is of another rig, or that it has a command where there is said to be none. */
MK_NODISCARD enum mk_status mk_record_from_log(const struct mk_log *log,
                                               const struct mk_model *model, struct mk_record *out,
                                               struct mk_error *err);

/* Whether a log says that joint (0-based) slides: its position is in m. */
bool mk_record_joint_slides(const struct mk_log *log, int joint);
/* Writes what the model says about joints and encoders into a log's metadata (joint_unit where a
 * joint slides; encoder_cpr or encoder_resolution if `counts`). MK_ERR_NOMEM. */
MK_NODISCARD enum mk_status mk_record_describe_joints(struct mk_log *log,
                                                      const struct mk_model *model, bool counts);

/* Start state at row `row` by a local polynomial fit to the angles over at most +-`half` rows (0:
 * the widest that the noise of the readings can explain), robust to dropped rows; one-sided at the
 * ends of [first, last). MK_ERR_RANGE when there are fewer than 4 readings. */
MK_NODISCARD enum mk_status mk_record_state_at(const struct mk_record *rec,
                                               const struct mk_model *model, size_t first,
                                               size_t last, size_t row, int half, double *x,
                                               struct mk_error *err);

struct mk_predict_options {
    double window_s; /* 0: one free run from the first row */
    /* Figures of the second half of the log only, as they always are of a model with own values:
     * so that other models can be held beside it. */
    bool second_half;
    struct mk_sim_config sim;
};
/* What a log has of its own of a parameter with a spread (struct mk_effect_use). */
struct mk_own_estimate {
    int effect, parameter;   /* model->effect[effect].value[parameter] */
    double value, std_error; /* its own value, in the parameter's unit */
};
#define MK_MAX_OWN_ESTIMATES 12
struct mk_predict_figures {
    double rms[MK_MAX_JOINTS];   /* rad, over rows with a reading from from_s on */
    double nrmse[MK_MAX_JOINTS]; /* rms / std of these readings */
    size_t windows;
    size_t rows;   /* compared */
    double from_s; /* s from the first row; 0 where all rows count */
    int own_count;
    struct mk_own_estimate own[MK_MAX_OWN_ESTIMATES];
};
/* Free-run prediction. Rows that are left out have none: a window ends before them, and the next
 * one begins behind them. Parameters with a spread get the values that the first half of the log
 * says (least squares of free runs over its windows, with the spread as prior); the figures are
 * then those of the windows that begin in the second half. *out gets columns t, q1, (q2,) dq1,
 * (dq2,) and `window` when windowed; the caller frees it. A window in which the solver fails is
 * filled with NaN from there on and counted in *failed (may be NULL). */
MK_NODISCARD enum mk_status mk_predict(const struct mk_model *model, const struct mk_log *log,
                                       const struct mk_predict_options *options,
                                       struct mk_log **out, struct mk_predict_figures *figures,
                                       size_t *failed, struct mk_error *err);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
