/* How fast a model changes by itself: what decides how small the steps of a solver must be. */
#ifndef MECHKIT_SIM_STIFFNESS_H
#define MECHKIT_SIM_STIFFNESS_H

#include "mechkit/model.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Above this rate a sample of 2 ms takes so many steps that a virtual rig falls behind time. */
#define MK_FASTEST_RATE 1e6 /* 1/s */

/* The largest |eigenvalue| of the model's Jacobian, in 1/s, hanging at rest and in motion by 10
 * rad/s (times the joint's scale) of either joint either way. */
double mk_model_fastest_rate(const struct mk_model *model);

/* MK_ERR_RANGE names the effect without which the model would be the slowest. */
MK_NODISCARD enum mk_status mk_model_check_stiffness(const struct mk_model *model,
                                                     struct mk_error *err);

#ifdef __cplusplus
}
#endif

#endif
