/* Setup reaction-wheel: passivity-based swing-up and balance of the reaction-wheel pendulum.
 *
 * Below, th = q1 is the pendulum from the downward vertical, w = dq1 + dq2 the absolute speed of
 * the wheel (errata 2.12: the encoder sits on the pendulum), E the energy of the pendulum alone.
 *
 * Swing-up (Meesters (2.27), (2.31)): u = -k_u y, y = k_v w - k_e (E - E_ref) dth, E_ref = 2 p3 g.
 * With it S = k_v p2 w^2 / 2 + k_e (E - E_ref)^2 / 2 never grows, nor does it with |u| limited:
 * dS/dt = y u <= 0. The motor's friction, f of the relative speed dq2, is added to u.
 *
 * Balance: u = -k_pp (th - pi) - k_dp dth - k_dr w. The swing-up arrives along dth = -omega_p
 * (th - pi); that line is an eigenvector of the balanced loop, and the hand-over free of
 * transients, when k_pp = omega_p k_dp (2.60). Nothing else is needed (errata 5.4): k_dp and k_dr
 * place the other two poles, the roots of
 *     s^2 + (k_dr/p2 - k_dp/p1 - omega_p) s - omega_p k_dr/p2.
 * `designers` takes the designers' gains (4.16) instead, which miss that condition.
 */
#include <string.h>

#include "ctrl/balance.h"
#include "mechkit/design.h"

enum {
    K_PP,
    K_DP,
    K_DR,
    DESIGNERS,
    K_E,
    K_V,
    K_U,
    SWING_FRICTION,
    KICK,
    WHEEL_LIMIT,
    BOX,
    BALANCE,
    PARAM_COUNT = BALANCE + MK_BALANCE_ROWS
};

/* The two poles that k_dp and k_dr place: frequency, damping ratio. */
#define POLE_RADPS 9.0
#define POLE_DAMPING 0.7

/* Of E_ref: below, the swing-up law has no direction to push in. */
#define AT_REST 0.004

static const double designers_gains[3] = {-400.0, -35.0, -0.07}; /* Meesters (4.16) */

struct reaction_wheel {
    struct mk_balance balance;
    enum mk_phase phase;
    bool going_round;
    double gain[3]; /* in force: k_pp, k_dp, k_dr */
};

static double law(const void *user, const double *x)
{
    const struct mk_ctrl *ctrl = user;
    const struct reaction_wheel *s = ctrl->priv;
    double e[MK_CTRL_STATES];
    mk_roa_error(&s->balance.roa, x, e);
    double feedback = s->gain[0] * e[0] + s->gain[1] * x[2] + s->gain[2] * (x[2] + x[3]);
    return ctrl->value[BALANCE + MK_BALANCE_FRICTION] * mk_plant_friction(&ctrl->model, x[3]) -
           feedback + mk_roa_hold(&s->balance.roa, x);
}

/* Report (2.61). */
static bool in_box(const struct mk_ctrl *ctrl, const double *x)
{
    return fabs(mk_wrap(x[0] - M_PI)) < ctrl->value[BOX];
}

static void design_gains(struct mk_ctrl *ctrl)
{
    const double *p = ctrl->model.parameter;
    double omega_p = sqrt(p[2] * ctrl->model.g / p[0]);
    double k_dr = -POLE_RADPS * POLE_RADPS * p[1] / omega_p;
    double k_dp = p[0] * (k_dr / p[1] - omega_p - 2.0 * POLE_DAMPING * POLE_RADPS);
    ctrl->value[K_PP] = omega_p * k_dp;
    ctrl->value[K_DP] = k_dp;
    ctrl->value[K_DR] = k_dr;
}

/* P of the balanced loop in (th, dth, w), written in joint order. */
static enum mk_status lyapunov_form(const struct mk_ctrl *ctrl, double *p, struct mk_error *err)
{
    const double *par = ctrl->model.parameter, *k = ctrl->value;
    double weight = par[2] * ctrl->model.g;
    /* clang-format off */
    double a[9] = {0.0,                            1.0,                0.0,
                   (weight + k[K_PP]) / par[0],    k[K_DP] / par[0],   k[K_DR] / par[0],
                   -k[K_PP] / par[1],             -k[K_DP] / par[1],  -k[K_DR] / par[1]};
    double q[9] = {1.0, 0.0, 0.0, 0.0, par[0] / weight, 0.0, 0.0, 0.0, 1e-6};
    /* (th, dth, w) of [q1 q2 v1 v2] */
    static const double t[3][MK_CTRL_STATES] = {{1, 0, 0, 0}, {0, 0, 1, 0}, {0, 0, 1, 1}};
    /* clang-format on */
    double small[9];
    enum mk_status st = mk_design_lyapunov(3, a, q, small, err);
    if (st != MK_OK)
        return st;
    for (int i = 0; i < MK_CTRL_STATES; i++)
        for (int j = 0; j < MK_CTRL_STATES; j++) {
            double sum = 0.0;
            for (int m = 0; m < 3; m++)
                for (int n = 0; n < 3; n++)
                    sum += t[m][i] * small[3 * m + n] * t[n][j];
            p[MK_CTRL_STATES * i + j] = sum;
        }
    return MK_OK;
}

static void reaction_wheel_changed(struct mk_ctrl *ctrl)
{
    struct reaction_wheel *s = ctrl->priv;
    const double *gains = ctrl->value[DESIGNERS] > 0.5 ? designers_gains : &ctrl->value[K_PP];
    memcpy(s->gain, gains, sizeof s->gain);
    mk_balance_changed(&s->balance, ctrl);
}

static enum mk_status reaction_wheel_create(struct mk_ctrl *ctrl, struct mk_error *err)
{
    static const double upright[MK_MAX_JOINTS] = {M_PI, 0.0};
    struct reaction_wheel *s = ctrl->priv;
    double p[MK_CTRL_STATES * MK_CTRL_STATES];
    s->balance.first = BALANCE;
    s->balance.in_box = in_box;
    s->balance.fallen[0] = 0.8;
    design_gains(ctrl);
    reaction_wheel_changed(ctrl);
    enum mk_status st = lyapunov_form(ctrl, p, err);
    return st == MK_OK ? mk_balance_prepare(&s->balance, ctrl, upright, p, law, err) : st;
}

static void reaction_wheel_reset(struct mk_ctrl *ctrl)
{
    struct reaction_wheel *s = ctrl->priv;
    mk_balance_reset(&s->balance);
    s->phase = MK_PHASE_SWINGUP;
    s->going_round = false;
}

/* A pendulum that has gone over the top goes round for ever once the wheel is at its limit:
 * friction eats the command and drags the pendulum along. The wheel can give back only what it
 * takes, so it must take where the pendulum is fast, below, and give where it is slow, above. */
static double stop_going_round(const struct mk_ctrl *ctrl, const double *x)
{
    double way = copysign(1.0, x[2]);
    double wheel = way * (x[2] + x[3]) / (0.5 * ctrl->value[WHEEL_LIMIT]);
    return way * ctrl->model.u_max * mk_clamp(3.0 * (cos(x[0]) - wheel), -1.0, 1.0);
}

static double swing_up(struct mk_ctrl *ctrl, const double *x)
{
    struct reaction_wheel *s = ctrl->priv;
    const struct mk_model *m = &ctrl->model;
    const double *k = ctrl->value;
    double weight = m->parameter[2] * m->g, e_ref = 2.0 * weight;
    double energy = 0.5 * m->parameter[0] * x[2] * x[2] + weight * (1.0 - cos(x[0])) +
                    mk_lift_energy(&s->balance.lift, x);
    bool over = energy > e_ref, at_limit = fabs(x[2] + x[3]) > k[WHEEL_LIMIT];
    s->going_round = over && (s->going_round || at_limit);
    if (s->going_round)
        return stop_going_round(ctrl, x);
    double u;
    if (energy < AT_REST * e_ref) {
        /* The origin belongs to the largest invariant set: push, then on with the swing. */
        u = x[2] > 0.0 ? -k[KICK] : k[KICK];
    } else {
        double y = k[K_V] * (x[2] + x[3]) - k[K_E] * (energy - e_ref) * x[2];
        u = mk_clamp(-k[K_U] * y, -m->u_max, m->u_max);
    }
    return u + k[SWING_FRICTION] * mk_plant_friction(m, x[3]);
}

static void reaction_wheel_step(struct mk_ctrl *ctrl, const struct mk_ctrl_input *in,
                                struct mk_ctrl_output *out)
{
    struct reaction_wheel *s = ctrl->priv;
    out->u = 0.0;
    out->ref = M_PI;
    out->phase = s->phase;
    double x[MK_CTRL_STATES];
    if (!mk_ctrl_input_ok(ctrl, in) || !mk_balance_observe(&s->balance, ctrl, in, x))
        return;

    s->phase = mk_balance_phase(&s->balance, ctrl, s->phase, x);
    out->phase = s->phase;
    out->ref += mk_balance_lean(&s->balance, x, 0);
    if (s->phase == MK_PHASE_BALANCE)
        out->u = law(ctrl, x);
    else if (!mk_balance_follow(&s->balance, ctrl, in, x, &out->u))
        out->u = swing_up(ctrl, x);
}

const struct mk_ctrl_ops mk_ctrl_reaction_wheel =
    {
        .name = "reaction-wheel",
        .help = "reaction-wheel pendulum: the pendulum up",
        .plants = MK_CTRL_PLANT(REACTION_WHEEL),
        .output = "q1",
        .private_size = sizeof(struct reaction_wheel),
        .param_count = PARAM_COUNT,
        .param =
            {
                [K_PP] = {"k_pp", "1/rad", "gain on the pendulum's angle", -1e4, 1e4, NAN, true},
                [K_DP] = {"k_dp", "s/rad", "gain on its speed", -1e4, 1e4, NAN, true},
                [K_DR] = {"k_dr", "s/rad", "gain on the wheel's absolute speed", -10.0, 10.0, NAN,
                          true},
                [DESIGNERS] = {"designers", "", "1: the designers' gains (4.16) instead of these",
                               0.0, 1.0, 0.0, false},
                [K_E] = {"k_e", "", "swing-up: weight of the pendulum's energy", 0.0, 1e6, 4000.0,
                         false},
                [K_V] = {"k_v", "", "swing-up: weight of the wheel's speed", 0.0, 1e4, 4.0, false},
                [K_U] = {"k_u", "", "swing-up: gain", 0.0, 1e3, 0.4, false},
                [SWING_FRICTION] = {"swing_friction", "",
                                    "share of the believed friction compensated while swinging up",
                                    0.0, 1.0, 1.0, false},
                [KICK] = {"kick", "", "command that starts the swing from rest", -10.0, 10.0, 10.0,
                          false},
                [WHEEL_LIMIT] = {"wheel_limit", "rad/s",
                                 "wheel speed at which going round is broken off", 50.0, 5000.0,
                                 450.0, false},
                [BOX] = {"box", "rad", "Meesters' box for the hand-over", 0.0, 3.0, 0.5, false},
                MK_BALANCE_PARAMS(BALANCE, 0.8, 0.7, 0.5, 0.15),
            },
        .create = reaction_wheel_create,
        .reset = reaction_wheel_reset,
        .changed = reaction_wheel_changed,
        .step = reaction_wheel_step,
};
