#include "support/closed.h"

#include <check.h>
#include <math.h>
#include <string.h>

static enum mk_plant_kind plant_of(const struct mk_ctrl_ops *ops)
{
    int kind = 0;
    while (!(ops->plants & (1u << kind)))
        kind++;
    return (enum mk_plant_kind)kind;
}

void closed_open(struct closed *c, const char *setup, const struct mk_signal *signal)
{
    const struct mk_ctrl_ops *ops = mk_ctrl_setup_by_name(setup);
    ck_assert_ptr_nonnull(ops);
    struct mk_model rig;
    mk_model_default(plant_of(ops), &rig);
    closed_open_rig(c, setup, &rig, signal);
}

void closed_open_rig(struct closed *c, const char *setup, const struct mk_model *rig,
                     const struct mk_signal *signal)
{
    struct mk_error err = MK_ERROR_INIT;
    memset(c, 0, sizeof *c);
    c->rig = *rig;
    c->dt = 0.002;
    ck_assert_msg(
        mk_ctrl_create(mk_ctrl_setup_by_name(setup), rig, c->dt, signal, &c->ctrl, &err) == MK_OK,
        "%s", err.message);
    ck_assert_msg(mk_sim_create(rig, NULL, &c->sim, &err) == MK_OK, "%s", err.message);
    struct mk_velocity_config speed = {.kind = MK_VELOCITY_TRACKING, .dt_s = c->dt};
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        ck_assert_int_eq(mk_velocity_init(&c->speed[j], &speed), MK_OK);
    const double *rest = mk_plant(rig->plant)->rest;
    closed_put(c, rest[0], rest[1], 0.0, 0.0);
    c->in.t = -c->dt;
    c->in.dt = c->dt;
    c->in.tick = (uint64_t)-1;
    c->next_u = 0.0;
}

void closed_close(struct closed *c)
{
    mk_ctrl_destroy(c->ctrl);
    mk_sim_destroy(c->sim);
}

void closed_put(struct closed *c, double q1, double q2, double v1, double v2)
{
    double q[MK_MAX_JOINTS] = {q1, q2}, v[MK_MAX_JOINTS] = {v1, v2}, x[MK_MAX_STATES];
    mk_model_initial_state(&c->rig, q, v, x);
    ck_assert_int_eq(mk_sim_reset(c->sim, mk_sim_time(c->sim), x, NULL), MK_OK);
}

void closed_set(struct closed *c, const char *name, double value)
{
    int index = mk_ctrl_param_index(c->ctrl->ops, name);
    ck_assert_int_ge(index, 0);
    ck_assert_int_eq(mk_ctrl_check(c->ctrl->ops, index, value, NULL), MK_OK);
    c->ctrl->value[index] = value;
    if (c->ctrl->ops->changed)
        c->ctrl->ops->changed(c->ctrl);
}

const double *closed_state(const struct closed *c)
{
    return mk_sim_state(c->sim);
}

static void read_joints(struct closed *c)
{
    const double *x = mk_sim_state(c->sim);
    int joints = mk_model_joints(&c->rig);
    for (int j = 0; j < joints; j++) {
        double count = mk_model_count(&c->rig, j);
        double rest = mk_plant(c->rig.plant)->rest[j];
        double reading = rest + count * floor((x[j] - rest) / count);
        c->in.v[j] = mk_velocity_step(&c->speed[j], reading);
        c->in.q[j] = reading;
        if (c->exact) {
            c->in.q[j] = x[j];
            c->in.v[j] = x[joints + j];
        }
    }
}

void closed_tick(struct closed *c)
{
    c->in.tick++;
    c->in.t = (double)c->in.tick * c->dt;
    c->in.u = c->next_u;
    read_joints(c);
    mk_ctrl_step(c->ctrl, &c->in, &c->out);
    ck_assert_msg(isfinite(c->out.u), "the command is not a number at %g s", c->in.t);

    struct mk_error err = MK_ERROR_INIT;
    double u[MK_MAX_INPUTS] = {c->in.u, 0.0};
    enum mk_status st = mk_sim_advance(c->sim, mk_sim_time(c->sim) + c->dt, u, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    c->next_u = fmin(fmax(c->out.u, -c->rig.u_max), c->rig.u_max);
}

void closed_run(struct closed *c, double seconds)
{
    for (long k = lround(seconds / c->dt); k > 0; k--)
        closed_tick(c);
}

double closed_until(struct closed *c, enum mk_phase phase, double seconds)
{
    for (long k = lround(seconds / c->dt); k > 0; k--) {
        closed_tick(c);
        if (c->out.phase == phase)
            return c->in.t;
    }
    return INFINITY;
}

bool closed_stays(struct closed *c, enum mk_phase phase, double seconds)
{
    for (long k = lround(seconds / c->dt); k > 0; k--) {
        closed_tick(c);
        if (c->out.phase != phase)
            return false;
    }
    return true;
}
