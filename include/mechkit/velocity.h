/* Speed from sampled encoder angles. A table of estimators; caller's memory, RT-safe throughout.
 *
 * `filter`: Meesters' way (appendix 6): difference quotient, then a first-order low-pass.
 * `tracking`: second-order tracking observer (phase-locked loop) with a given bandwidth: angle and
 * speed without the lag of a differentiator; critically damped.
 * `kalman`: constant-acceleration Kalman filter whose noise is the quantisation (count^2 / 12) and
 * whose process noise is the acceleration a rig can make; gains become stationary at init.
 */
#ifndef MECHKIT_VELOCITY_H
#define MECHKIT_VELOCITY_H

#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

enum mk_velocity_kind {
    MK_VELOCITY_FILTER,
    MK_VELOCITY_TRACKING,
    MK_VELOCITY_KALMAN,
    MK_VELOCITY_COUNT
};
/* The name as command files have it; "?" out of range. Static. */
const char *mk_velocity_name(enum mk_velocity_kind kind);
enum mk_velocity_kind mk_velocity_by_name(const char *name); /* MK_VELOCITY_COUNT: unknown */

struct mk_velocity_config {
    enum mk_velocity_kind kind;
    double dt_s;         /* sample time, > 0 */
    double bandwidth_hz; /* filter: cut-off; tracking: natural frequency; 0: 0.08 / dt_s */
    double count_rad;    /* kalman: one count; > 0 */
    double accel_radps2; /* kalman: usual acceleration; > 0 */
};

struct mk_velocity {
    struct mk_velocity_config config;
    double gain[3];
    double q, v, a;
    double last;
    int primed; /* 0: no reading yet; else samples since the last reading */
};

/* MK_ERR_INVALID, MK_ERR_RANGE. */
MK_NODISCARD enum mk_status mk_velocity_init(struct mk_velocity *est,
                                             const struct mk_velocity_config *config);
/* Forgets the past; the next step starts at rest at its angle. */
void mk_velocity_reset(struct mk_velocity *est);
/* One more angle (rad, unwrapped). NaN: no reading, the estimate is extrapolated. Returns the
 * speed; est->q and est->v hold the estimates at this sample. */
double mk_velocity_step(struct mk_velocity *est, double q);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
