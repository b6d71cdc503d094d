#include "ctrl/link_pump.h"

#include "ctrl/ctrl_priv.h"
#include "model/plant_facts.h"

static struct mk_free_link free_link(const struct mk_model *model, const double *x)
{
    struct mk_free_link l = {0.0, 0.0, 0.0};
    mk_plant_free_link(model, x, &l);
    return l;
}

double mk_link_energy(const struct mk_model *model, const double *x)
{
    return free_link(model, x).energy;
}

static double driven_acceleration(const struct mk_model *world, const double *x, double u)
{
    double dx[MK_MAX_STATES], z[MK_MAX_STATES] = {x[0], x[1], x[2], x[3]};
    double input[MK_MAX_INPUTS] = {u, 0.0};
    mk_model_rhs(world, 0.0, z, input, dx);
    return dx[MK_MAX_JOINTS + mk_plant(world->plant)->motor_joint];
}

/* a1 = a0 + s u: what pulls at the free joint accelerates the driven one, too. */
static double command_in_world(const struct mk_model *world, const double *x, double v1)
{
    double a0 = driven_acceleration(world, x, 0.0);
    double s = (driven_acceleration(world, x, world->u_max) - a0) / world->u_max;
    return (v1 - a0) / s;
}

double mk_pfl_command(const struct mk_model *model, const double *x, double v1)
{
    if (model->effect_count > 0)
        return command_in_world(model, x, v1);
    double d[4], h[2];
    int m = mk_plant(model->plant)->motor_joint, o = 1 - m; /* driven and free */
    mk_plant_mass(model, x, x + 2, d, h);
    /* The free row gives a_o = -(d_om v1 + h_o) / d_oo; put into the other: report (2.15), (2.16).
     */
    double ratio = d[1] / d[3 * o];
    return (d[3 * m] - ratio * d[2]) * v1 + h[m] - ratio * h[o];
}

/* At rest below there is nothing to pump on: the first push. */
static bool at_rest_below(const struct mk_free_link *l)
{
    return fabs(l->speed) < 0.04 && l->energy < -1.8;
}

double mk_link_pump(const struct mk_model *model, const double *x, double target, double since_s,
                    double lift, const double *row)
{
    static const double strength[] = {1.0, 0.75, 1.25, 0.9};
    static const double energy[] = {0.0, 0.05, -0.05, 0.1};
    unsigned turn = (unsigned)fmin(since_s / row[MK_PUMP_PATIENCE], 1e6) % 4u;

    struct mk_free_link l = free_link(model, x);
    double error = x[0] - target, v = x[2];
    double hold_p = row[MK_PUMP_HOLD_P], hold_d = row[MK_PUMP_HOLD_D], speed = row[MK_PUMP_SPEED];
    double hold = hold_d * (mk_clamp(-hold_p / hold_d * error, -speed, speed) - v);
    if (fabs(error) > row[MK_PUMP_REACH])
        return hold;

    double excess = l.energy + lift - row[MK_PUMP_ENERGY] - energy[turn];
    double pump = mk_clamp(row[MK_PUMP_GAIN] * excess * l.speed * l.coupling, -1.0, 1.0);
    if (at_rest_below(&l))
        pump = -1.0;
    return row[MK_PUMP_STRENGTH] * strength[turn] * pump + (1.0 - fabs(pump)) * hold -
           row[MK_PUMP_CENTRE_P] * error - row[MK_PUMP_CENTRE_D] * v;
}
