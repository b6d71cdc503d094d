/* Setups pendubot-mid and pendubot-top: swing link 2 up onto a hanging or a standing link 1.
 *
 * Balance (report 4.1): u = -K (x - x_eq), x = [q1 dq1 q2 dq2], predicted to when u acts. K is an
 * LQR of the nominal model; Meesters' (4.6), (4.7) and the designers' (4.12), (4.14) are taken
 * by `gains`.
 *
 * Swing-up, by `method`:
 *  0  energy of link 2 (link_pump.h), the default: it sees what link 2 does, tries again by itself,
 *     and catches 98 % or more of rigs whose parameters are 10 % off.
 *  1  Meesters': partial feedback linearisation tracks a path of link 1. mid: one period of
 *     a sin(w t) - pi/2, then -pi/2 (2.18, errata 2.10); top: `back` open loop in the wrong
 *     direction for `back_time`, then a step to pi/2. Nothing feeds back link 2, so a path that
 *     missed cannot mend it: after `attempt` seconds the energy method goes on from there.
 *
 * Hand-over: balance.h, with Meesters' box of angles and |u| (2.2).
 */
#include <string.h>

#include "ctrl/balance.h"
#include "ctrl/link_pump.h"

enum {
    K_Q1,
    K_DQ1,
    K_Q2,
    K_DQ2,
    METHOD,
    KP,
    KD,
    PATH_SIZE, /* mid: amplitude a; top: command `back` */
    PATH_TIME, /* mid: frequency w; top: how long */
    ATTEMPT,
    BOX_Q1,
    BOX_Q2,
    BOX_U,
    BALANCE,
    PUMP = BALANCE + MK_BALANCE_ROWS,
    PARAM_COUNT = PUMP + MK_PUMP_ROWS
};

enum { METHOD_ENERGY = 0, METHOD_REPORT = 1 };

struct pendubot {
    struct mk_balance balance;
    bool top;
    double target; /* of link 1, rad */
    enum mk_phase phase;
    double swing_from; /* s: when this swing-up began */
    bool first;        /* attempt of this run */
};

/* LQR weights on q1, q2, dq1, dq2 and on u: cheap control where the unstable modes are fast (top),
 * little weight on link 1, which has room. Chosen by success over perturbed models. */
static const double weight_mid[MK_CTRL_STATES] = {0.3, 8.0, 0.3, 0.25};
static const double weight_top[MK_CTRL_STATES] = {1.2, 10.0, 0.35, 0.45};
#define WEIGHT_U_MID 0.1
#define WEIGHT_U_TOP 0.04

/* u = -K e, and the share of friction to compensate, at the state x. */
static double law(const void *user, const double *x)
{
    const struct mk_ctrl *ctrl = user;
    const struct pendubot *s = ctrl->priv;
    const double *k = ctrl->value;
    double e[MK_CTRL_STATES];
    mk_roa_error(&s->balance.roa, x, e);
    double feedback = k[K_Q1] * e[0] + k[K_DQ1] * e[2] + k[K_Q2] * e[1] + k[K_DQ2] * e[3];
    return k[BALANCE + MK_BALANCE_FRICTION] * mk_plant_friction(&ctrl->model, x[2]) - feedback +
           mk_roa_hold(&s->balance.roa, x);
}

/* Meesters' conditions for the linear law to take over (2.2). */
static bool in_box(const struct mk_ctrl *ctrl, const double *x)
{
    const struct pendubot *s = ctrl->priv;
    double e[MK_CTRL_STATES];
    mk_roa_error(&s->balance.roa, x, e);
    return fabs(e[0]) < ctrl->value[BOX_Q1] && fabs(e[1]) < ctrl->value[BOX_Q2] &&
           fabs(law(ctrl, x)) < ctrl->value[BOX_U];
}

static enum mk_status pendubot_create(struct mk_ctrl *ctrl, struct mk_error *err)
{
    struct pendubot *s = ctrl->priv;
    s->top = ctrl->ops == &mk_ctrl_pendubot_top;
    s->target = s->top ? 0.5 * M_PI : -0.5 * M_PI;
    double equilibrium[MK_MAX_JOINTS] = {s->target, s->top ? 0.0 : M_PI};
    double k[MK_CTRL_STATES], p[MK_CTRL_STATES * MK_CTRL_STATES];
    enum mk_status st = mk_balance_design(ctrl, equilibrium, s->top ? weight_top : weight_mid,
                                          s->top ? WEIGHT_U_TOP : WEIGHT_U_MID, k, p, err);
    if (st != MK_OK)
        return st;
    ctrl->value[K_Q1] = k[0];
    ctrl->value[K_Q2] = k[1];
    ctrl->value[K_DQ1] = k[2];
    ctrl->value[K_DQ2] = k[3];

    s->balance.first = BALANCE;
    s->balance.in_box = in_box;
    s->balance.fallen[0] = 2.5;
    s->balance.fallen[1] = 1.2;
    return mk_balance_prepare(&s->balance, ctrl, equilibrium, p, law, err);
}

static void pendubot_reset(struct mk_ctrl *ctrl)
{
    struct pendubot *s = ctrl->priv;
    mk_balance_reset(&s->balance);
    s->phase = MK_PHASE_SWINGUP;
    s->swing_from = NAN;
    s->first = true;
}

static void pendubot_changed(struct mk_ctrl *ctrl)
{
    struct pendubot *s = ctrl->priv;
    mk_balance_changed(&s->balance, ctrl);
}

/* Meesters' path of link 1 at `t` seconds: angle, speed, acceleration (2.18). */
static void path(const struct mk_ctrl *ctrl, double t, double *q, double *v, double *a)
{
    const struct pendubot *s = ctrl->priv;
    double size = ctrl->value[PATH_SIZE], w = ctrl->value[PATH_TIME];
    *q = s->target;
    *v = *a = 0.0;
    if (s->top || t > 2.0 * M_PI / w)
        return;
    *q += size * sin(w * t);
    *v = size * w * cos(w * t);
    *a = -size * w * w * sin(w * t);
}

static double report_command(const struct mk_ctrl *ctrl, const double *x, double t, double *ref)
{
    const struct pendubot *s = ctrl->priv;
    if (s->top && t < ctrl->value[PATH_TIME])
        return ctrl->value[PATH_SIZE];
    double q, v, a;
    path(ctrl, t, &q, &v, &a);
    *ref = q;
    double v1 = a + ctrl->value[KD] * (v - x[2]) + ctrl->value[KP] * (q - x[0]);
    return mk_pfl_command(&s->balance.world, x, v1);
}

static double swing_up(struct mk_ctrl *ctrl, const double *x, double t, double *ref)
{
    struct pendubot *s = ctrl->priv;
    bool report = lround(ctrl->value[METHOD]) == METHOD_REPORT && s->first;
    double attempt = report ? ctrl->value[ATTEMPT] : 0.0;
    double since = t - s->swing_from;
    *ref = s->target;
    if (since < attempt)
        return report_command(ctrl, x, since, ref);
    /* What joint 2 will be wound by when link 1 is back where it is held. */
    const double in_place[MK_MAX_JOINTS] = {s->target, x[1] + x[0] - s->target};
    double v1 = mk_link_pump(&ctrl->model, x, s->target, since - attempt,
                             mk_lift_share(&s->balance.lift, in_place), &ctrl->value[PUMP]);
    return mk_pfl_command(&s->balance.world, x, v1);
}

static void pendubot_step(struct mk_ctrl *ctrl, const struct mk_ctrl_input *in,
                          struct mk_ctrl_output *out)
{
    struct pendubot *s = ctrl->priv;
    out->u = 0.0;
    out->ref = s->target;
    out->phase = s->phase;
    double x[MK_CTRL_STATES];
    if (!mk_ctrl_input_ok(ctrl, in) || !mk_balance_observe(&s->balance, ctrl, in, x))
        return;

    enum mk_phase before = s->phase;
    s->phase = mk_balance_phase(&s->balance, ctrl, before, x);
    if (before == MK_PHASE_BALANCE && s->phase == MK_PHASE_SWINGUP) {
        s->first = false;
        s->swing_from = in->t;
    }
    if (isnan(s->swing_from))
        s->swing_from = in->t;

    out->phase = s->phase;
    if (s->phase == MK_PHASE_BALANCE)
        out->u = law(ctrl, x);
    else if (mk_balance_follow(&s->balance, ctrl, in, x, &out->u))
        s->swing_from = in->t;
    else
        out->u = swing_up(ctrl, x, in->t, &out->ref);
    out->ref += mk_balance_lean(&s->balance, x, 0);
}

/* clang-format off */
#define COMMON_PARAMS(kp, kd, box_u)                                                               \
    [K_Q1] = {"k_q1", "1/rad", "gain on the angle of link 1", -1e4, 1e4, NAN, true},               \
    [K_DQ1] = {"k_dq1", "s/rad", "gain on its speed", -1e4, 1e4, NAN, true},                       \
    [K_Q2] = {"k_q2", "1/rad", "gain on the angle of link 2", -1e4, 1e4, NAN, true},               \
    [K_DQ2] = {"k_dq2", "s/rad", "gain on its speed", -1e4, 1e4, NAN, true},                       \
    [METHOD] = {"method", "", "swing-up: 0 energy of link 2, 1 Meesters' path", 0, 1, 0, false},\
    [KP] = {"kp", "1/s^2", "Meesters' path: gain on the angle of link 1", 0, 1e4, kp, false},       \
    [KD] = {"kd", "1/s", "Meesters' path: gain on its speed", 0, 1e3, kd, false},                   \
    [ATTEMPT] = {"attempt", "s", "Meesters' path: then the energy method", 0, 60, 2.5, false},      \
    [BOX_Q1] = {"box_q1", "rad", "Meesters' box: link 1", 0, 3, 0.2, false},                        \
    [BOX_Q2] = {"box_q2", "rad", "Meesters' box: link 2", 0, 3, 0.3, false},                        \
    [BOX_U] = {"box_u", "", "Meesters' box: command of the linear law", 0, 1e4, box_u, false}
/* clang-format on */

#define COMMON_OPS                                                                                 \
    .plants = MK_CTRL_PLANT(PENDUBOT), .private_size = sizeof(struct pendubot), .output = "q1",    \
    .param_count = PARAM_COUNT, .create = pendubot_create, .reset = pendubot_reset,                \
    .changed = pendubot_changed, .step = pendubot_step

const struct mk_ctrl_ops mk_ctrl_pendubot_mid = {
    .name = "pendubot-mid",
    .help = "pendubot: link 2 up on the hanging link 1",
    COMMON_OPS,
    .param =
        {
            COMMON_PARAMS(150.0, 21.0, 80.0),
            [PATH_SIZE] = {"path_a", "rad", "Meesters' path: amplitude", -3.0, 3.0, 1.65, false},
            [PATH_TIME] = {"path_omega", "rad/s", "Meesters' path: frequency", 0.1, 50.0, 5.5,
                           false},
            MK_BALANCE_PARAMS(BALANCE, 0.0, 0.6, 0.6, 0.4),
            MK_PUMP_PARAMS(PUMP, 50.0, 11.0, 0.0, 1.5, 165.0, 7.5, 10.5, 8.0, 2.2),
        },
};

const struct mk_ctrl_ops mk_ctrl_pendubot_top = {
    .name = "pendubot-top",
    .help = "pendubot: both links up",
    COMMON_OPS,
    .param =
        {
            COMMON_PARAMS(350.0, 24.3, 120.0),
            [PATH_SIZE] = {"back", "", "Meesters' path: command in the wrong direction", -10.0,
                           10.0, -3.0, false},
            [PATH_TIME] = {"back_time", "s", "Meesters' path: how long", 0.0, 5.0, 0.51, false},
            MK_BALANCE_PARAMS(BALANCE, 0.0, 0.8, 0.8, 0.4),
            MK_PUMP_PARAMS(PUMP, 58.0, 19.0, 0.0, 1.5, 325.0, 15.0, 6.0, 37.0, 7.5),
        },
};
