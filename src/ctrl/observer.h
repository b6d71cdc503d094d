/* State estimate of a two-joint rig by the nominal model, and prediction with it.
 *
 * The speeds that come with the readings are a filter's: at 40 Hz bandwidth they lag by about
 * 8 ms, which at the accelerations of a swing-up (100 rad/s^2) is 0.8 rad/s, more than a catch
 * forgives. This observer moves the state on by the nominal model under the command that was in
 * force, and corrects it by the angles read: what the model knows of the acceleration does not
 * lag. Where the nominal model has delays, it runs in the time that the readings show, under the
 * commands of that time, and is predicted from there. States are in joint order, [q1 q2 v1 v2].
 * Everything is RT-safe.
 */
#ifndef MECHKIT_CTRL_OBSERVER_H
#define MECHKIT_CTRL_OBSERVER_H

#include <stdbool.h>

#include "mechkit/ctrl.h"

#ifdef __cplusplus
extern "C" {
#endif

#define MK_CTRL_STATES 4

/* Commands that are remembered: for delays of so many samples. */
#define MK_OBSERVER_PAST 24

/* What acts late, and what is read late, by the nominal model. */
struct mk_delays {
    double all;                 /* s: from a command until every reading shows it */
    double more[MK_MAX_JOINTS]; /* s: what the reading of a joint is older than that */
};
/* Of effects with a delay; as much of it as an observer at `dt` remembers. */
struct mk_delays mk_delays_of(const struct mk_model *nominal, double dt);

struct mk_observer {
    const struct mk_model *model; /* borrowed */
    struct mk_delays delays;      /* none at first */
    double dt;                    /* s */
    double gain_q, gain_v;        /* of the correction; gain_v in 1/s */
    double x[MK_CTRL_STATES];     /* at the last tick, as old as the readings are */
    double u[MK_OBSERVER_PAST];   /* in force from the last tick on, from the one before, .. */
    uint64_t tick;
    bool primed;
};

/* Critically damped correction with natural frequency `bandwidth_hz`. */
void mk_observer_init(struct mk_observer *obs, const struct mk_model *model, double dt,
                      double bandwidth_hz);
void mk_observer_reset(struct mk_observer *obs);
/* One more tick; x receives the state at its readings. */
void mk_observer_step(struct mk_observer *obs, const struct mk_ctrl_input *in, double *x);
/* Moves x from there to `lead_s` after the last tick in the time of the rig: through what is on its
 * way, commands that have been given and do not show yet, and then on under the last one. */
void mk_observer_ahead(const struct mk_observer *obs, double *x, double lead_s);

/* Moves x on by `dt` seconds under command u (limited to +-u_max): one midpoint step. Of the
 * model's effects those without a memory act, as they do at time 0. */
void mk_ctrl_predict(const struct mk_model *model, double *x, double u, double dt);

#ifdef __cplusplus
}
#endif
#endif
