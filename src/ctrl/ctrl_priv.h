/* What the setups share: their rows of the table, and small helpers. Private to src/ctrl. */
#ifndef MECHKIT_CTRL_PRIV_H
#define MECHKIT_CTRL_PRIV_H

#include <math.h>
#include <stdbool.h>

#include "mechkit/ctrl.h"

extern const struct mk_ctrl_ops mk_ctrl_pendubot_mid;
extern const struct mk_ctrl_ops mk_ctrl_pendubot_top;
extern const struct mk_ctrl_ops mk_ctrl_reaction_wheel;
extern const struct mk_ctrl_ops mk_ctrl_furuta;
extern const struct mk_ctrl_ops mk_ctrl_cart_pole;
extern const struct mk_ctrl_ops mk_ctrl_acrobot;
extern const struct mk_ctrl_ops mk_ctrl_pi_speed;
extern const struct mk_ctrl_ops mk_ctrl_open_loop;

#define MK_CTRL_PLANT(kind) (1u << MK_PLANT_##kind)
#define MK_CTRL_ANY_PLANT ((1u << MK_PLANT_COUNT) - 1u)

/* Difference of two angles, the short way round: (-pi, pi]. */
static inline double mk_wrap(double angle)
{
    double r = remainder(angle, 2.0 * M_PI);
    return r <= -M_PI ? r + 2.0 * M_PI : r;
}

static inline double mk_clamp(double x, double low, double high)
{
    return x < low ? low : x > high ? high : x;
}

/* Readings that a law can work with: no step may let a NaN into what it remembers. */
static inline bool mk_ctrl_input_ok(const struct mk_ctrl *ctrl, const struct mk_ctrl_input *in)
{
    bool ok = isfinite(in->t) && isfinite(in->u);
    for (int j = 0; j < mk_model_joints(&ctrl->model); j++)
        ok = ok && isfinite(in->q[j]) && isfinite(in->v[j]);
    return ok;
}

#endif
