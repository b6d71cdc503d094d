/* State estimate of a two-joint rig by the believed model, and prediction with it.
 *
 * The speeds that come with the readings are a filter's: at 40 Hz bandwidth they lag by about
 * 8 ms, which at the accelerations of a swing-up (100 rad/s^2) is 0.8 rad/s, more than a catch
 * forgives. This observer moves the state on by the believed model under the command that was in
 * force, and corrects it by the angles read: what the model knows of the acceleration does not
 * lag. States are in joint order, [q1 q2 v1 v2]. Everything is RT-safe.
 */
#ifndef MECHKIT_CTRL_OBSERVER_H
#define MECHKIT_CTRL_OBSERVER_H

#include <stdbool.h>

#include "mechkit/ctrl.h"

#ifdef __cplusplus
extern "C" {
#endif

#define MK_CTRL_STATES 4

struct mk_observer {
    const struct mk_model *model; /* borrowed */
    double dt;                    /* s */
    double gain_q, gain_v;        /* of the correction; gain_v in 1/s */
    double x[MK_CTRL_STATES];     /* at the last tick */
    double u;                     /* in force from the last tick on */
    uint64_t tick;
    bool primed;
};

/* Critically damped correction with natural frequency `bandwidth_hz`. */
void mk_observer_init(struct mk_observer *obs, const struct mk_model *model, double dt,
                      double bandwidth_hz);
void mk_observer_reset(struct mk_observer *obs);
/* One more tick; x receives the state at its readings. */
void mk_observer_step(struct mk_observer *obs, const struct mk_ctrl_input *in, double *x);

/* Moves x on by `dt` seconds under command u (limited to +-u_max): one midpoint step. */
void mk_ctrl_predict(const struct mk_model *model, double *x, double u, double dt);

#ifdef __cplusplus
}
#endif
#endif
