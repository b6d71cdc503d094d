#include "experiment/basin.h"

#include <math.h>
#include <string.h>

#include "mechkit/sim.h"
#include "mechkit/velocity.h"

#define SEEN_BEFORE 100 /* samples */

/* A controller on a simulated rig, with a board's timeline: what is computed from the readings of a
 * sample acts from the next one on. */
struct bench {
    struct mk_ctrl *ctrl;
    struct mk_sim *sim;
    const struct mk_model *rig;
    struct mk_velocity speed[MK_MAX_JOINTS];
    struct mk_ctrl_input in;
    struct mk_ctrl_output out;
};

static void read_encoders(struct bench *b)
{
    double y[MK_MAX_JOINTS];
    const double *rest = mk_plant(b->rig->plant)->rest;
    mk_sim_measure(b->sim, y);
    for (int j = 0; j < mk_model_joints(b->rig); j++) {
        double count = mk_model_count(b->rig, j);
        b->in.q[j] = rest[j] + count * floor((y[j] - rest[j]) / count);
        b->in.v[j] = mk_velocity_step(&b->speed[j], b->in.q[j]);
    }
}

static enum mk_status tick(struct bench *b, struct mk_error *err)
{
    double u[MK_MAX_INPUTS] = {b->in.u, 0.0};
    read_encoders(b);
    mk_ctrl_step(b->ctrl, &b->in, &b->out);
    enum mk_status st = mk_sim_advance(b->sim, mk_sim_time(b->sim) + b->in.dt, u, err);
    b->in.tick++;
    b->in.t = (double)b->in.tick * b->in.dt;
    b->in.u = fmin(fmax(b->out.u, -b->rig->u_max), b->rig->u_max);
    return st;
}

static enum mk_status put_rig(struct bench *b, const double *equilibrium,
                              const struct basin_start *start)
{
    double q[MK_MAX_JOINTS], v[MK_MAX_JOINTS], x[MK_MAX_STATES];
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        q[j] = equilibrium[j] + start->off[j];
        v[j] = start->off[MK_MAX_JOINTS + j];
    }
    mk_model_initial_state(b->rig, q, v, x);
    struct mk_velocity_config speed = {.kind = MK_VELOCITY_TRACKING, .dt_s = b->in.dt};
    enum mk_status st = mk_sim_reset(b->sim, 0.0, x, NULL);
    for (int j = 0; j < MK_MAX_JOINTS && st == MK_OK; j++) {
        st = mk_velocity_init(&b->speed[j], &speed);
        /* The estimator has seen the rig come at that speed. */
        for (int k = SEEN_BEFORE; k > 0 && st == MK_OK; k--)
            mk_velocity_step(&b->speed[j], q[j] - k * b->in.dt * v[j]);
    }
    return st;
}

static enum mk_status watch(struct bench *b, const struct basin_start *start, struct basin_run *out,
                            struct mk_error *err)
{
    enum mk_status st = MK_OK;
    out->end = BASIN_NOT_CAUGHT;
    out->caught_s = NAN;
    while (st == MK_OK && b->in.t <= start->within_s + start->hold_s) {
        double t = b->in.t;
        st = tick(b, err);
        bool balancing = b->out.phase == MK_PHASE_BALANCE;
        out->u_peak = fmax(out->u_peak, fabs(b->in.u));
        out->tilt_rad = fmax(out->tilt_rad, trial_tilt(b->rig->plant, mk_sim_state(b->sim)));
        if (isnan(out->caught_s) && balancing)
            out->caught_s = t;
        else if (isnan(out->caught_s) ? t > start->within_s : !balancing)
            break;
        if (balancing && t - out->caught_s >= start->hold_s) {
            out->end = BASIN_HELD;
            return st;
        }
    }
    if (!isnan(out->caught_s))
        out->end = BASIN_FELL;
    return st;
}

enum mk_status basin_run(const struct mk_ctrl_ops *setup, const struct mk_model *nominal,
                         const struct trial_spread *spread, const struct basin_start *start,
                         uint64_t seed, struct basin_run *out, struct mk_error *err)
{
    struct mk_model rig;
    struct bench b = {.rig = &rig, .in = {.dt = 1.0 / spread->rate_hz}};
    memset(out, 0, sizeof *out);
    enum mk_status st = trial_rig(nominal, spread, seed, &rig, err);
    if (st == MK_OK)
        st = mk_ctrl_create(setup, nominal, b.in.dt, NULL, &b.ctrl, err);
    if (st == MK_OK)
        st = trial_make_changes(spread, b.ctrl, err);
    if (st == MK_OK)
        st = mk_sim_create(&rig, NULL, &b.sim, err);
    if (st == MK_OK)
        st = put_rig(&b, linear_equilibrium(nominal->plant, setup->name)->q, start);
    if (st == MK_OK) {
        mk_ctrl_reset(b.ctrl);
        st = watch(&b, start, out, err);
    }
    mk_ctrl_destroy(b.ctrl);
    mk_sim_destroy(b.sim);
    return st;
}
