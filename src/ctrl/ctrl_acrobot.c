/* Setup acrobot: energy swing-up and balance of two links with the motor at the elbow.
 *
 * Swing-up (Spong, Energy based control of a class of underactuated mechanical systems, IFAC 1996):
 * collocated partial feedback linearisation makes a2 = v2, and
 *     v2 = -kp q2 - kd dq2 - A sat(k (E_top - E) dq1)
 * bends the elbow against the motion of link 1 while energy is missing, and with it when there is
 * too much, so that link 2 comes to rest along link 1 as E reaches its value at the top. At rest
 * below there is no motion to bend against: the first push. A run that has not been caught for
 * `patience` seconds goes on with another strength. Balance: u = -K (x - x_top), K an LQR of the
 * nominal model without friction. */
#include "ctrl/balance.h"
#include "ctrl/link_pump.h"

enum {
    K_Q1,
    K_DQ1,
    K_Q2,
    K_DQ2,
    PUMP,
    PUMP_GAIN,
    HOLD_P,
    HOLD_D,
    PATIENCE,
    BOX_Q1,
    BOX_Q2,
    BALANCE,
    PARAM_COUNT = BALANCE + MK_BALANCE_ROWS
};

struct acrobot {
    struct mk_balance balance;
    enum mk_phase phase;
    double swing_from; /* s: when this swing-up began */
};

/* LQR weights on q1, q2, dq1, dq2 and on u, by trials on rigs that are off the model: with little
 * weight on the elbow it leans by tenths of a radian where the encoders' zeros are counts off. */
static const double weight[MK_CTRL_STATES] = {1.0, 30.0, 0.1, 0.1};
#define WEIGHT_U 0.3

static double law(const void *user, const double *x)
{
    const struct mk_ctrl *ctrl = user;
    const struct acrobot *s = ctrl->priv;
    const double *k = ctrl->value;
    double e[MK_CTRL_STATES];
    mk_roa_error(&s->balance.roa, x, e);
    double feedback = k[K_Q1] * e[0] + k[K_DQ1] * e[2] + k[K_Q2] * e[1] + k[K_DQ2] * e[3];
    return k[BALANCE + MK_BALANCE_FRICTION] * mk_plant_friction(&ctrl->model, x[3]) - feedback +
           mk_roa_hold(&s->balance.roa, x);
}

static bool in_box(const struct mk_ctrl *ctrl, const double *x)
{
    const struct acrobot *s = ctrl->priv;
    double e[MK_CTRL_STATES];
    mk_roa_error(&s->balance.roa, x, e);
    return fabs(e[0]) < ctrl->value[BOX_Q1] && fabs(e[1]) < ctrl->value[BOX_Q2];
}

static enum mk_status acrobot_create(struct mk_ctrl *ctrl, struct mk_error *err)
{
    static const double upright[MK_MAX_JOINTS] = {0.5 * M_PI, 0.0};
    struct acrobot *s = ctrl->priv;
    double k[MK_CTRL_STATES], p[MK_CTRL_STATES * MK_CTRL_STATES];
    enum mk_status st = mk_balance_design(ctrl, upright, weight, WEIGHT_U, k, p, err);
    if (st != MK_OK)
        return st;
    ctrl->value[K_Q1] = k[0];
    ctrl->value[K_Q2] = k[1];
    ctrl->value[K_DQ1] = k[2];
    ctrl->value[K_DQ2] = k[3];

    s->balance.first = BALANCE;
    s->balance.in_box = in_box;
    s->balance.fallen[0] = 0.8;
    s->balance.fallen[1] = 1.6;
    return mk_balance_prepare(&s->balance, ctrl, upright, p, law, err);
}

static void acrobot_reset(struct mk_ctrl *ctrl)
{
    struct acrobot *s = ctrl->priv;
    mk_balance_reset(&s->balance);
    s->phase = MK_PHASE_SWINGUP;
    s->swing_from = NAN;
}

static void acrobot_changed(struct mk_ctrl *ctrl)
{
    struct acrobot *s = ctrl->priv;
    mk_balance_changed(&s->balance, ctrl);
}

/* Energy that is missing to stand at the top, in shares of what lies between hanging and top. */
static double missing_energy(const struct mk_model *model, const struct mk_lift *lift,
                             const double *x)
{
    static const double top[MK_MAX_JOINTS] = {0.5 * M_PI, 0.0};
    static const double below[MK_MAX_JOINTS] = {-0.5 * M_PI, 0.0};
    double high = mk_plant_potential(model, top), low = mk_plant_potential(model, below);
    double energy =
        mk_plant_kinetic(model, x, x + 2) + mk_plant_potential(model, x) + mk_lift_energy(lift, x);
    return (high - energy) / (high - low);
}

static double swing_up(const struct mk_ctrl *ctrl, const double *x, double since_s)
{
    static const double strength[] = {1.1, 0.9, 1.0, 1.2};
    unsigned turn = (unsigned)fmin(since_s / ctrl->value[PATIENCE], 1e6) % 4u;
    const struct acrobot *s = ctrl->priv;
    double missing = missing_energy(&ctrl->model, &s->balance.lift, x);
    double pump = mk_clamp(ctrl->value[PUMP_GAIN] * missing * x[2], -1.0, 1.0);
    if (fabs(x[2]) < 0.05 && fabs(x[3]) < 0.05 && missing > 0.95)
        pump = 1.0;
    double v2 = -ctrl->value[PUMP] * strength[turn] * pump - ctrl->value[HOLD_P] * x[1] -
                ctrl->value[HOLD_D] * x[3];
    return mk_pfl_command(&s->balance.world, x, v2);
}

static void acrobot_step(struct mk_ctrl *ctrl, const struct mk_ctrl_input *in,
                         struct mk_ctrl_output *out)
{
    struct acrobot *s = ctrl->priv;
    out->u = 0.0;
    out->ref = 0.0;
    out->phase = s->phase;
    double x[MK_CTRL_STATES];
    if (!mk_ctrl_input_ok(ctrl, in) || !mk_balance_observe(&s->balance, ctrl, in, x))
        return;

    enum mk_phase before = s->phase;
    s->phase = mk_balance_phase(&s->balance, ctrl, before, x);
    if (isnan(s->swing_from) || before == MK_PHASE_BALANCE)
        s->swing_from = in->t;

    out->phase = s->phase;
    if (s->phase == MK_PHASE_BALANCE)
        out->u = law(ctrl, x);
    else if (mk_balance_follow(&s->balance, ctrl, in, x, &out->u))
        s->swing_from = in->t;
    else
        out->u = swing_up(ctrl, x, in->t - s->swing_from);
    out->ref += mk_balance_lean(&s->balance, x, 0);
}

const struct mk_ctrl_ops mk_ctrl_acrobot =
    {
        .name = "acrobot",
        .help = "acrobot: both links up",
        .plants = MK_CTRL_PLANT(ACROBOT),
        .private_size = sizeof(struct acrobot),
        .param_count = PARAM_COUNT,
        .param =
            {
                [K_Q1] = {"k_q1", "1/rad", "gain on the angle of link 1", -1e5, 1e5, NAN, true},
                [K_DQ1] = {"k_dq1", "s/rad", "gain on its speed", -1e5, 1e5, NAN, true},
                [K_Q2] = {"k_q2", "1/rad", "gain on the angle of link 2", -1e5, 1e5, NAN, true},
                [K_DQ2] = {"k_dq2", "s/rad", "gain on its speed", -1e5, 1e5, NAN, true},
                [PUMP] = {"pump", "rad/s^2", "acceleration of the elbow that pumps energy", 0.0,
                          1000.0, 260.0, false},
                [PUMP_GAIN] = {"pump_gain", "s/rad", "how sharply the pump switches", 0.01, 1000.0,
                               2.0, false},
                [HOLD_P] = {"hold_p", "1/s^2", "stiffness with which link 2 is held along link 1",
                            0.0, 2000.0, 120.0, false},
                [HOLD_D] = {"hold_d", "1/s", "damping of that", 0.0, 200.0, 6.0, false},
                [PATIENCE] = {"patience", "s", "not caught for so long: pump with another strength",
                              0.5, 60.0, 3.0, false},
                [BOX_Q1] = {"box_q1", "rad", "box for the hand-over: link 1", 0.0, 3.0, 0.15,
                            false},
                [BOX_Q2] = {"box_q2", "rad", "box for the hand-over: link 2", 0.0, 3.0, 0.3, false},
                MK_BALANCE_PARAMS(BALANCE, 0.5, 0.6, 0.5, 0.3),
            },
        .create = acrobot_create,
        .reset = acrobot_reset,
        .changed = acrobot_changed,
        .step = acrobot_step,
};
