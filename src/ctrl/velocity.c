#include "mechkit/velocity.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

static const char *const names[MK_VELOCITY_COUNT] = {"filter", "tracking", "kalman"};

const char *mk_velocity_name(enum mk_velocity_kind kind)
{
    return (unsigned)kind < MK_VELOCITY_COUNT ? names[kind] : "?";
}

enum mk_velocity_kind mk_velocity_by_name(const char *name)
{
    int k = 0;
    while (k < MK_VELOCITY_COUNT && strcmp(names[k], name) != 0)
        k++;
    return (enum mk_velocity_kind)k;
}

/* First-order low-pass, exact for a held input: gain[0] = 1 - exp(-2 pi f dt). */
static void init_filter(struct mk_velocity *est)
{
    est->gain[0] = 1.0 - exp(-2.0 * M_PI * est->config.bandwidth_hz * est->config.dt_s);
}

/* Critically damped observer of angle and speed: both poles of the sampled error at exp(-w dt).
 * q += dt v; e = y - q; q += gain[0] e; v += gain[1] e. It lags an accelerating joint by 2 / w. */
static void init_tracking(struct mk_velocity *est)
{
    double dt = est->config.dt_s, z = exp(-2.0 * M_PI * est->config.bandwidth_hz * dt);
    est->gain[0] = 1.0 - z * z;
    est->gain[1] = (1.0 - z) * (1.0 - z) / dt;
}

/* Stationary gains of a Kalman filter (R. E. Kalman 1960) for x = [q v a], a changing by a random
 * jerk held over each sample: iterates the Riccati recursion until it stands still. Measurement
 * noise is rounding, count^2 / 12; the jerk lets the acceleration change by its usual size within
 * 20 ms. */
static void init_kalman(struct mk_velocity *est)
{
    double dt = est->config.dt_s, a = est->config.accel_radps2;
    double r = est->config.count_rad * est->config.count_rad / 12.0;
    double f[3][3] = {{1, dt, dt * dt / 2}, {0, 1, dt}, {0, 0, 1}};
    double g[3] = {dt * dt * dt / 6, dt * dt / 2, dt}, q = a * a / 0.02 * dt / (dt * dt);
    double p[3][3] = {{r, 0, 0}, {0, a * a * dt * dt, 0}, {0, 0, a * a}};
    for (int step = 0; step < 20000; step++) {
        double fp[3][3] = {{0}}, m[3][3], k[3];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                for (int l = 0; l < 3; l++)
                    fp[i][j] += f[i][l] * p[l][j];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                m[i][j] = g[i] * g[j] * q;
                for (int l = 0; l < 3; l++)
                    m[i][j] += fp[i][l] * f[j][l];
            }
        double change = 0.0;
        for (int i = 0; i < 3; i++) {
            k[i] = m[i][0] / (m[0][0] + r);
            change = fmax(change, fabs(k[i] - est->gain[i]) / (fabs(k[i]) + 1e-300));
            est->gain[i] = k[i];
        }
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                p[i][j] = m[i][j] - k[i] * m[0][j];
        if (change < 1e-12)
            break;
    }
}

static bool positive(double x)
{
    return x > 0.0 && isfinite(x);
}

enum mk_status mk_velocity_init(struct mk_velocity *est, const struct mk_velocity_config *config)
{
    memset(est, 0, sizeof *est);
    est->config = *config;
    if ((unsigned)config->kind >= MK_VELOCITY_COUNT)
        return MK_ERR_INVALID;
    if (!positive(config->dt_s) || !(config->bandwidth_hz >= 0.0) ||
        !isfinite(config->bandwidth_hz))
        return MK_ERR_RANGE;
    if (est->config.bandwidth_hz == 0.0)
        est->config.bandwidth_hz = 0.08 / config->dt_s;
    switch (config->kind) {
    case MK_VELOCITY_FILTER:
        init_filter(est);
        break;
    case MK_VELOCITY_TRACKING:
        init_tracking(est);
        break;
    case MK_VELOCITY_KALMAN:
        if (!positive(config->count_rad) || !positive(config->accel_radps2))
            return MK_ERR_RANGE;
        init_kalman(est);
        break;
    case MK_VELOCITY_COUNT:
        break;
    }
    return MK_OK;
}

void mk_velocity_reset(struct mk_velocity *est)
{
    est->q = est->v = est->a = est->last = 0.0;
    est->primed = 0;
}

static void start(struct mk_velocity *est, double q)
{
    est->q = est->last = q;
    est->v = est->a = 0.0;
    est->primed = 1;
}

static void step_filter(struct mk_velocity *est, double q)
{
    if (isnan(q)) {
        est->q += est->v * est->config.dt_s;
        return;
    }
    /* After dropped samples the quotient spans the gap in one: primed counts its length. */
    double raw = (q - est->last) / (est->config.dt_s * est->primed);
    est->v += est->gain[0] * (raw - est->v);
    est->q = est->last = q;
}

static void step_observer(struct mk_velocity *est, double q)
{
    double dt = est->config.dt_s;
    est->q += dt * est->v + 0.5 * dt * dt * est->a;
    est->v += dt * est->a;
    if (isnan(q))
        return;
    double e = q - est->q;
    est->q += est->gain[0] * e;
    est->v += est->gain[1] * e;
    est->a += est->gain[2] * e; /* 0 for the tracking observer */
}

double mk_velocity_step(struct mk_velocity *est, double q)
{
    if (est->primed == 0) {
        if (!isnan(q))
            start(est, q);
        return est->v;
    }
    if (est->config.kind == MK_VELOCITY_FILTER) {
        step_filter(est, q);
        est->primed = isnan(q) ? est->primed + 1 : 1;
    } else {
        step_observer(est, q);
    }
    return est->v;
}
