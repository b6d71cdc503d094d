#include "ctrl/observer.h"

#include <string.h>

#include "ctrl/ctrl_priv.h"

/* Ticks that may be bridged by the model; after more the readings start afresh. */
#define MAX_BRIDGED_TICKS 10

void mk_observer_init(struct mk_observer *obs, const struct mk_model *model, double dt,
                      double bandwidth_hz)
{
    /* Both poles of the sampled error at exp(-w dt). */
    double pole = exp(-2.0 * M_PI * bandwidth_hz * dt);
    obs->model = model;
    obs->dt = dt;
    obs->gain_q = 1.0 - pole * pole;
    obs->gain_v = (1.0 - pole) * (1.0 - pole) / dt;
}

void mk_observer_reset(struct mk_observer *obs)
{
    obs->primed = false;
}

static void derivative(const struct mk_model *model, const double *x, double u, double *dx)
{
    double tau[MK_MAX_JOINTS] = {0.0, 0.0};
    tau[mk_plant(model->plant)->motor_joint] = u;
    dx[0] = x[2];
    dx[1] = x[3];
    mk_plant_acceleration(model, x, x + 2, tau, dx + 2);
}

void mk_ctrl_predict(const struct mk_model *model, double *x, double u, double dt)
{
    double slope[MK_CTRL_STATES] = {0.0}, middle[MK_CTRL_STATES]; /* one joint: half of it is 0 */
    u = mk_clamp(u, -model->u_max, model->u_max);
    derivative(model, x, u, slope);
    for (int i = 0; i < MK_CTRL_STATES; i++)
        middle[i] = x[i] + 0.5 * dt * slope[i];
    derivative(model, middle, u, slope);
    for (int i = 0; i < MK_CTRL_STATES; i++)
        x[i] += dt * slope[i];
}

static void start_at(struct mk_observer *obs, const struct mk_ctrl_input *in)
{
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        obs->x[j] = in->q[j];
        obs->x[2 + j] = in->v[j];
    }
    obs->primed = true;
}

static void correct(struct mk_observer *obs, const struct mk_ctrl_input *in)
{
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        double residual = in->q[j] - obs->x[j];
        obs->x[j] += obs->gain_q * residual;
        obs->x[2 + j] += obs->gain_v * residual;
    }
}

void mk_observer_step(struct mk_observer *obs, const struct mk_ctrl_input *in, double *x)
{
    uint64_t ticks = in->tick - obs->tick;
    if (!obs->primed || ticks > MAX_BRIDGED_TICKS) {
        start_at(obs, in);
    } else {
        for (uint64_t i = 0; i < ticks; i++)
            mk_ctrl_predict(obs->model, obs->x, obs->u, obs->dt);
        correct(obs, in);
    }
    obs->tick = in->tick;
    obs->u = in->u;
    memcpy(x, obs->x, sizeof obs->x);
}
