/* Setup cart-pole: energy swing-up and balance of the pole on a carriage.
 *
 * Swing-up: the energy of the pole is pumped through the acceleration of the carriage
 * (link_pump.h), which turns back to the middle beyond `reach`: the track has ends. Balance: u = -K
 * [x dx b db], b from the upward vertical, K an LQR of the nominal model without friction. The
 * carriage may go anywhere on the track, so the run ends by the safety limits and not by this law.
 */
#include "ctrl/balance.h"
#include "ctrl/link_pump.h"

enum {
    K_X,
    K_DX,
    K_B,
    K_DB,
    BOX_B,
    BALANCE,
    PUMP = BALANCE + MK_BALANCE_ROWS,
    PARAM_COUNT = PUMP + MK_PUMP_ROWS
};

struct cart_pole {
    struct mk_balance balance;
    enum mk_phase phase;
    double swing_from; /* s: when this swing-up began */
};

/* LQR weights on x (m), b (rad), their speeds and u: a tenth of a metre costs what a tenth of a
 * radian does. Found by trials on rigs that are off the model. */
static const double weight[MK_CTRL_STATES] = {60.0, 60.0, 3.0, 0.5};
#define WEIGHT_U 0.1

static double law(const void *user, const double *x)
{
    const struct mk_ctrl *ctrl = user;
    const struct cart_pole *s = ctrl->priv;
    const double *k = ctrl->value;
    double e[MK_CTRL_STATES];
    mk_roa_error(&s->balance.roa, x, e);
    double feedback = k[K_X] * e[0] + k[K_DX] * e[2] + k[K_B] * e[1] + k[K_DB] * e[3];
    return k[BALANCE + MK_BALANCE_FRICTION] * mk_plant_friction(&ctrl->model, x[2]) - feedback +
           mk_roa_hold(&s->balance.roa, x);
}

static bool in_box(const struct mk_ctrl *ctrl, const double *x)
{
    return fabs(mk_wrap(x[1])) < ctrl->value[BOX_B];
}

static enum mk_status cart_pole_create(struct mk_ctrl *ctrl, struct mk_error *err)
{
    static const double upright[MK_MAX_JOINTS] = {0.0, 0.0};
    struct cart_pole *s = ctrl->priv;
    double k[MK_CTRL_STATES], p[MK_CTRL_STATES * MK_CTRL_STATES];
    enum mk_status st = mk_balance_design(ctrl, upright, weight, WEIGHT_U, k, p, err);
    if (st != MK_OK)
        return st;
    ctrl->value[K_X] = k[0];
    ctrl->value[K_B] = k[1];
    ctrl->value[K_DX] = k[2];
    ctrl->value[K_DB] = k[3];

    s->balance.first = BALANCE;
    s->balance.in_box = in_box;
    s->balance.fallen[0] = mk_plant(ctrl->model.plant)->joint_travel[0];
    s->balance.fallen[1] = 1.2;
    return mk_balance_prepare(&s->balance, ctrl, upright, p, law, err);
}

static void cart_pole_reset(struct mk_ctrl *ctrl)
{
    struct cart_pole *s = ctrl->priv;
    mk_balance_reset(&s->balance);
    s->phase = MK_PHASE_SWINGUP;
    s->swing_from = NAN;
}

static void cart_pole_changed(struct mk_ctrl *ctrl)
{
    struct cart_pole *s = ctrl->priv;
    mk_balance_changed(&s->balance, ctrl);
}

static void cart_pole_step(struct mk_ctrl *ctrl, const struct mk_ctrl_input *in,
                           struct mk_ctrl_output *out)
{
    struct cart_pole *s = ctrl->priv;
    out->u = 0.0;
    out->ref = 0.0;
    out->phase = s->phase;
    double x[MK_CTRL_STATES];
    if (!mk_ctrl_input_ok(ctrl, in) || !mk_balance_observe(&s->balance, ctrl, in, x))
        return;

    enum mk_phase before = s->phase;
    s->phase = mk_balance_phase(&s->balance, ctrl, before, x);
    out->ref += mk_balance_lean(&s->balance, x, 0);
    if (isnan(s->swing_from) || before == MK_PHASE_BALANCE)
        s->swing_from = in->t;

    out->phase = s->phase;
    if (s->phase == MK_PHASE_BALANCE) {
        out->u = law(ctrl, x);
    } else if (mk_balance_follow(&s->balance, ctrl, in, x, &out->u)) {
        s->swing_from = in->t;
    } else {
        double v1 = mk_link_pump(&ctrl->model, x, 0.0, in->t - s->swing_from,
                                 mk_lift_share(&s->balance.lift, x), &ctrl->value[PUMP]);
        out->u = mk_pfl_command(&s->balance.world, x, v1);
    }
}

const struct mk_ctrl_ops mk_ctrl_cart_pole = {
    .name = "cart-pole",
    .help = "cart-pole: the pole up, the carriage in the middle",
    .plants = MK_CTRL_PLANT(CART_POLE),
    .private_size = sizeof(struct cart_pole),
    .param_count = PARAM_COUNT,
    .param =
        {
            [K_X] = {"k_x", "1/m", "gain on the place of the carriage", -1e5, 1e5, NAN, true},
            [K_DX] = {"k_dx", "s/m", "gain on its speed", -1e5, 1e5, NAN, true},
            [K_B] = {"k_b", "1/rad", "gain on the angle of the pole", -1e5, 1e5, NAN, true},
            [K_DB] = {"k_db", "s/rad", "gain on its speed", -1e5, 1e5, NAN, true},
            [BOX_B] = {"box_b", "rad", "box for the hand-over: the pole", 0.0, 3.0, 0.3, false},
            MK_BALANCE_PARAMS(BALANCE, 0.7, 0.5, 0.65, 0.3),
            MK_PUMP_ROWS_OF(PUMP, "m", "the carriage", 4.5, 5.0, 0.0, 0.25, 4.0, 60.0, 12.0, 1.0,
                            4.0, 0.5),
        },
    .create = cart_pole_create,
    .reset = cart_pole_reset,
    .changed = cart_pole_changed,
    .step = cart_pole_step,
};
