/* Setup open-loop: the command is a signal, an expression in t or samples from a file. */
#include "ctrl/ctrl_priv.h"

enum { SCALE, PARAM_COUNT };

static void open_loop_reset(struct mk_ctrl *ctrl)
{
    (void)ctrl;
}

/* What is computed at tick k acts from tick k+1 on, so the signal is read one sample ahead: the log
 * then shows u = signal(t) in every row, and a recorded t,u file plays back at its own times. */
static void open_loop_step(struct mk_ctrl *ctrl, const struct mk_ctrl_input *in,
                           struct mk_ctrl_output *out)
{
    double wish = ctrl->ref ? mk_signal_at(ctrl->ref, in->t + ctrl->dt) : 0.0;
    out->u = isfinite(wish) ? ctrl->value[SCALE] * wish : 0.0;
    out->ref = NAN;
    out->phase = MK_PHASE_TRACK;
}

const struct mk_ctrl_ops mk_ctrl_open_loop = {
    .name = "open-loop",
    .help = "the command is a signal: an expression in t, or a file of t,u",
    .plants = MK_CTRL_ANY_PLANT,
    .takes_signal = true,
    .param_count = PARAM_COUNT,
    .param =
        {
            [SCALE] = {"scale", "", "factor on the signal", -100.0, 100.0, 1.0, false},
        },
    .reset = open_loop_reset,
    .step = open_loop_step,
};
