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
    memset(&obs->delays, 0, sizeof obs->delays);
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
    if (model->effect_count > 0) { /* a rig with one joint has its speed in x[1] there */
        double z[MK_MAX_STATES] = {0.0}, rate[MK_MAX_STATES];
        double input[MK_MAX_INPUTS] = {u, 0.0};
        int n = mk_model_joints(model);
        for (int j = 0; j < n; j++) {
            z[j] = x[j];
            z[n + j] = x[MK_MAX_JOINTS + j];
        }
        mk_model_rhs(model, 0.0, z, input, rate);
        for (int j = 0; j < n; j++) {
            dx[j] = rate[j];
            dx[MK_MAX_JOINTS + j] = rate[n + j];
        }
        return;
    }
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
    for (int i = 0; i < MK_OBSERVER_PAST; i++)
        obs->u[i] = 0.0; /* a run begins with the motor off */
    obs->primed = true;
}

static void correct(struct mk_observer *obs, const struct mk_ctrl_input *in)
{
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        double residual = in->q[j] + obs->delays.more[j] * obs->x[2 + j] - obs->x[j];
        obs->x[j] += obs->gain_q * residual;
        obs->x[2 + j] += obs->gain_v * residual;
    }
}

struct mk_delays mk_delays_of(const struct mk_model *nominal, double dt)
{
    int n = mk_model_joints(nominal);
    double read[MK_MAX_JOINTS] = {0.0, 0.0}, most = (MK_OBSERVER_PAST - 2) * dt;
    for (int i = 0; i < nominal->effect_count; i++) {
        const struct mk_effect_use *use = &nominal->effect[i];
        for (int j = 0; j < n; j++)
            if ((mk_effect(use->index)->stages & MK_STAGE_SENSOR_DELAY) &&
                (use->joint == 0 || use->joint == j + 1))
                read[j] += use->value[0];
    }
    double common = n > 1 ? fmin(read[0], read[1]) : read[0];
    struct mk_delays d = {fmin(mk_model_command_delay(nominal) + common, most), {0.0, 0.0}};
    for (int j = 0; j < n; j++)
        d.more[j] = read[j] - common;
    return d;
}

/* The delay is m + f samples: what a reading shows was done by the command of m + 1 ticks ago for
 * the first f of the sample, and then by that of m ticks ago. */
static void split(const struct mk_observer *obs, int *m, double *f)
{
    double ticks = obs->delays.all / obs->dt;
    *m = (int)floor(ticks);
    *f = ticks - *m;
}

/* From one tick to the next, before the command of the next is known. */
static void advance(struct mk_observer *obs)
{
    int m;
    double f;
    split(obs, &m, &f);
    if (f > 0.0)
        mk_ctrl_predict(obs->model, obs->x, obs->u[m + 1], f * obs->dt);
    mk_ctrl_predict(obs->model, obs->x, obs->u[m], (1.0 - f) * obs->dt);
}

static void remember(struct mk_observer *obs, double u)
{
    memmove(obs->u + 1, obs->u, (MK_OBSERVER_PAST - 1) * sizeof obs->u[0]);
    obs->u[0] = u;
}

void mk_observer_ahead(const struct mk_observer *obs, double *x, double lead_s)
{
    int m;
    double f;
    split(obs, &m, &f);
    if (f > 0.0)
        mk_ctrl_predict(obs->model, x, obs->u[m + 1], f * obs->dt);
    for (; m > 0; m--)
        mk_ctrl_predict(obs->model, x, obs->u[m], obs->dt);
    mk_ctrl_predict(obs->model, x, obs->u[0], lead_s);
}

void mk_observer_step(struct mk_observer *obs, const struct mk_ctrl_input *in, double *x)
{
    uint64_t ticks = in->tick - obs->tick;
    if (!obs->primed || ticks > MAX_BRIDGED_TICKS) {
        start_at(obs, in);
    } else {
        for (uint64_t i = 0; i < ticks; i++) {
            advance(obs);
            if (i + 1 < ticks)
                remember(obs, obs->u[0]);
        }
        correct(obs, in);
    }
    obs->tick = in->tick;
    remember(obs, in->u);
    memcpy(x, obs->x, sizeof obs->x);
}
