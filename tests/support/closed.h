/* A controller closed on a plainly simulated plant, with the exchange timeline of a board: what is
 * computed from the readings of tick k acts from tick k+1 on. Angles are counted in whole counts,
 * speeds come from the loop's usual estimator. Functions fail the test when something goes wrong.
 */
#ifndef MECHKIT_TESTS_SUPPORT_CLOSED_H
#define MECHKIT_TESTS_SUPPORT_CLOSED_H

#include <stdbool.h>

#include "mechkit/ctrl.h"
#include "mechkit/sim.h"
#include "mechkit/velocity.h"

struct closed {
    struct mk_ctrl *ctrl;
    struct mk_sim *sim;
    struct mk_velocity speed[MK_MAX_JOINTS];
    struct mk_model rig;
    double dt;
    struct mk_ctrl_input in;   /* of the last tick */
    struct mk_ctrl_output out; /* of the last tick */
    double next_u;
    bool exact; /* give the controller the true state instead of readings */
};

/* Rig of the setup with default parameters, hanging; believed is the same; 500 Hz. `signal` may be
 * NULL and is kept. */
void closed_open(struct closed *c, const char *setup, const struct mk_signal *signal);
/* The same with a rig of one's own (which the controller believes too). */
void closed_open_rig(struct closed *c, const char *setup, const struct mk_model *rig,
                     const struct mk_signal *signal);
void closed_close(struct closed *c);

/* Puts the plant into a state; angles and speeds per joint. */
void closed_put(struct closed *c, double q1, double q2, double v1, double v2);
void closed_set(struct closed *c, const char *name, double value);

void closed_tick(struct closed *c);
void closed_run(struct closed *c, double seconds);
/* Runs until the phase is `phase`; returns the time of that tick, INFINITY if not within. */
double closed_until(struct closed *c, enum mk_phase phase, double seconds);
/* Ticks for so long; true if every tick was in `phase`. */
bool closed_stays(struct closed *c, enum mk_phase phase, double seconds);

const double *closed_state(const struct closed *c); /* true q, v */

#endif
