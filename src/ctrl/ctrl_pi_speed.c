/* Setup pi-speed: PI control of the inertia wheel's speed.
 *
 *     e = r - v,   u = kp e + ki integral(e) + J dr/dt + c f(r)
 *
 * r is the reference signal (steps and ramps), or the parameter `speed` when there is none. The
 * wheel is p1 dv/dt + f(v) = u (report 2.1, errata 2.1): with kp = 2 w J - p2 and ki = J w^2 both
 * poles lie at -w. The integral is clamped at the limit of the command (no wind-up), so Coulomb
 * friction and its asymmetry cost no steady-state error; c is the share of the nominal friction
 * that is fed forward.
 */
#include "ctrl/compensate.h"
#include "ctrl/ctrl_priv.h"

enum { KP, KI, SPEED, FRICTION, COMPENSATE, PARAM_COUNT };

#define POLE_RADPS 10.0
#define MOST_GAIN 1e7 /* of a rig of tons in N s/m; a bound against slips of the keyboard */

struct pi_speed {
    double integral; /* command units */
    double last_ref; /* rad/s; NAN before the first sample */
};

static enum mk_status pi_speed_create(struct mk_ctrl *ctrl, struct mk_error *err)
{
    (void)err;
    double inertia = ctrl->model.parameter[0], viscous = ctrl->model.parameter[1];
    ctrl->value[KP] = fmax(2.0 * POLE_RADPS * inertia - viscous, POLE_RADPS * inertia);
    ctrl->value[KI] = inertia * POLE_RADPS * POLE_RADPS;
    ctrl->value[SPEED] *= mk_model_joint_scale(&ctrl->model, 0);
    return MK_OK;
}

static void pi_speed_reset(struct mk_ctrl *ctrl)
{
    struct pi_speed *s = ctrl->priv;
    s->integral = 0.0;
    s->last_ref = NAN;
}

static double reference(const struct mk_ctrl *ctrl, double t)
{
    double r = ctrl->ref ? mk_signal_at(ctrl->ref, t) : ctrl->value[SPEED];
    return isfinite(r) ? r : 0.0;
}

/* Slope of the reference, for ramps; a step has none that a motor could follow. */
static double reference_slope(struct pi_speed *s, double r, double dt, double limit)
{
    double slope = isnan(s->last_ref) ? 0.0 : (r - s->last_ref) / dt;
    s->last_ref = r;
    return fabs(slope) <= limit ? slope : 0.0;
}

static void pi_speed_step(struct mk_ctrl *ctrl, const struct mk_ctrl_input *in,
                          struct mk_ctrl_output *out)
{
    struct pi_speed *s = ctrl->priv;
    double limit = ctrl->model.u_max, inertia = ctrl->model.parameter[0];
    double r = reference(ctrl, isfinite(in->t) ? in->t : 0.0);
    out->ref = r;
    out->phase = MK_PHASE_TRACK;
    out->u = 0.0;
    if (!mk_ctrl_input_ok(ctrl, in))
        return;

    double dt = in->dt > 0.0 ? in->dt : ctrl->dt; /* more where samples were missed */
    double slope = reference_slope(s, r, dt, limit / inertia);
    double error = r - in->v[0];
    double feed = inertia * slope + ctrl->value[FRICTION] * mk_plant_friction(&ctrl->model, r);
    double wish = ctrl->value[KP] * error + s->integral + feed;

    /* The integral stands still while the command is at its limit and the error pushes further. */
    if (fabs(wish) < limit || wish * error < 0.0)
        s->integral += ctrl->value[KI] * error * dt;
    s->integral = mk_clamp(s->integral, -limit, limit);
    out->u = wish;
}

const struct mk_ctrl_ops mk_ctrl_pi_speed = {
    .name = "pi-speed",
    .help = "PI control of the inertia wheel's speed; steps and ramps",
    .plants = MK_CTRL_PLANT(INERTIA_WHEEL),
    .output = "dq1",
    .takes_signal = true,
    .private_size = sizeof(struct pi_speed),
    .param_count = PARAM_COUNT,
    .param =
        {
            [KP] = {"kp", "s/rad", "gain on the speed error", 0.0, MOST_GAIN, NAN, true},
            [KI] = {"ki", "1/rad", "gain on its integral", 0.0, MOST_GAIN, NAN, true},
            [SPEED] = {"speed", "rad/s", "reference when there is no signal", -1000.0, 1000.0, 50.0,
                       false},
            [FRICTION] = {"friction", "", "share of the believed friction fed forward", 0.0, 1.0,
                          0.0, false},
            [COMPENSATE] = {MK_COMPENSATE_ROW},
        },
    .create = pi_speed_create,
    .reset = pi_speed_reset,
    .step = pi_speed_step,
};
