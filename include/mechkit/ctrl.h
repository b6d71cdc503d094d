/* Controllers ("setups"): a table of small structs over one step function.
 *
 * A controller sees angles and speeds of the joints at tick k and returns the command that will be
 * applied at tick k+1 (the board's one sample of delay, mechkit/board.h). It believes a model,
 * which need not be that of the rig. Creation allocates everything; reset and step are RT-safe.
 *
 * Angles: as in docs/formats.md; q2 of the pendubot and the pendulum angles are unwrapped as the
 * encoders count them; controllers wrap errors themselves. Speeds rad/s, commands in command units.
 */
#ifndef MECHKIT_CTRL_H
#define MECHKIT_CTRL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mechkit/model.h"
#include "mechkit/signal.h"
#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

#define MK_CTRL_MAX_PARAMS 32

enum mk_phase {
    MK_PHASE_IDLE = 0,    /* command 0 */
    MK_PHASE_SWINGUP = 1, /* the non-linear controller drives */
    MK_PHASE_BALANCE = 2, /* caught: the linear law holds an equilibrium */
    MK_PHASE_TRACK = 3    /* following a reference, or open loop */
};
const char *mk_phase_name(enum mk_phase phase); /* "idle", "swing-up", "balance", "track" */

/* One row of a controller's parameters. Gains are the rows with `gain` set, in the order in which
 * the command `gains` takes them; the others are set by name. */
struct mk_ctrl_param {
    const char *name; /* "k1", "omega" */
    const char *unit;
    const char *help;
    double min, max;
    double initial; /* Meesters' or designed value for the default model; NAN: designed from the
                       nominal model at creation */
    bool gain;
};

struct mk_ctrl_input {
    double t;  /* s since start */
    double dt; /* s, sample time */
    uint64_t tick;
    double q[MK_MAX_JOINTS];
    double v[MK_MAX_JOINTS];
    double u; /* command in force now, until tick k+1 */
};

struct mk_ctrl_output {
    double u;   /* wish; the loop limits it to +-u_max */
    double ref; /* what the controller wants of its main output, for the log; NAN: nothing */
    enum mk_phase phase;
};

struct mk_ctrl;

struct mk_ctrl_ops {
    const char *name; /* as in `setup NAME` */
    const char *help;
    unsigned plants; /* bit (1u << enum mk_plant_kind) */
    /* Column of the log that mk_ctrl_output.ref is the reference of: "q1", "dq1". NULL: none. */
    const char *output;
    bool takes_signal; /* goes by mk_ctrl.ref; others take no notice of it */
    size_t private_size;
    int param_count;
    struct mk_ctrl_param param[MK_CTRL_MAX_PARAMS];
    /* Fills the NAN initial values from the nominal model (gain design) and prepares the private
     * memory. Not RT. Optional. */
    enum mk_status (*create)(struct mk_ctrl *ctrl, struct mk_error *err);
    /* Before start: forget everything but parameters. RT. */
    void (*reset)(struct mk_ctrl *ctrl);
    /* New parameters have been taken over between two samples. RT. Optional. */
    void (*changed)(struct mk_ctrl *ctrl);
    void (*step)(struct mk_ctrl *ctrl, const struct mk_ctrl_input *in, struct mk_ctrl_output *out);
    void (*destroy)(struct mk_ctrl *ctrl); /* optional; the core frees ctrl itself */
};

struct mk_compensator;
struct mk_roa;
struct mk_track;

struct mk_ctrl {
    const struct mk_ctrl_ops *ops;
    struct mk_model model; /* believed */
    double dt;             /* sample time, s */
    double value[MK_CTRL_MAX_PARAMS];
    const struct mk_signal *ref; /* reference or open-loop signal; may be NULL; borrowed */
    bool balances;               /* a setup that holds an equilibrium says so when it is created */
    double equilibrium[MK_MAX_JOINTS];  /* which one, rad: that of the textbook plant */
    struct mk_compensator *compensator; /* of the believed effects; NULL: there are none */
    const struct mk_roa *roa; /* of a setup that balances: where its law takes over; else NULL */
    struct mk_track *track;   /* a swing-up that is followed (mechkit/swingup.h); NULL: none */
    void *priv;
};

/* Table of setups, index from 0; NULL out of range. Static. */
const struct mk_ctrl_ops *mk_ctrl_setup(int index);
/* The setup of that name ("acrobot" ...); NULL: unknown. Static. */
const struct mk_ctrl_ops *mk_ctrl_setup_by_name(const char *name);

/* MK_ERR_INVALID when the setup is not for this plant (the message says which rigs it is for),
 * MK_ERR_NUMERIC when gains cannot be designed. `signal` is kept, not owned. */
MK_NODISCARD enum mk_status mk_ctrl_create(const struct mk_ctrl_ops *ops,
                                           const struct mk_model *nominal, double dt,
                                           const struct mk_signal *signal, struct mk_ctrl **out,
                                           struct mk_error *err);
/* Frees a controller and what it made, not its signal. NULL allowed. */
void mk_ctrl_destroy(struct mk_ctrl *ctrl);

int mk_ctrl_param_index(const struct mk_ctrl_ops *ops, const char *name); /* -1: none */
/* How many of the setup's parameters are gains, which the command `gains` sets together. */
int mk_ctrl_gain_count(const struct mk_ctrl_ops *ops);
/* Checks one value against its row; MK_ERR_RANGE says the range. */
MK_NODISCARD enum mk_status mk_ctrl_check(const struct mk_ctrl_ops *ops, int index, double value,
                                          struct mk_error *err);

/* Forgets the past, before the first sample of a run; parameters and reference stay. RT. */
void mk_ctrl_reset(struct mk_ctrl *ctrl);
/* The command for one sample. The law sees the rig as its base parameters describe it: what the
 * nominal model has in effects is made up for, as far as it can be, by the share `compensate` of
 * setups that have such a row (docs/theory.md, section 6). RT. */
void mk_ctrl_step(struct mk_ctrl *ctrl, const struct mk_ctrl_input *in, struct mk_ctrl_output *out);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
