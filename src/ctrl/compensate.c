#include "ctrl/compensate.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "ctrl/ctrl_priv.h"

#define OBSERVER_HZ 35.0 /* as the balancing setups have it */
#define LEAD_SAMPLES 1.5 /* the board's sample, and half of one more: as theirs */
#define WILD 1e6         /* a state beyond it is no state of a rig */

/* --- which effects ------------------------------------------------------------------------- */

/* States at which an effect shows which equations it enters. */
#define PROBES 4
static const double probe[PROBES][4] = {
    {0.4, -1.1, 0.7, 1.3}, {-0.9, 0.3, -1.9, 0.6}, {2.1, 1.7, 0.2, -0.8}, {-2.6, 2.2, 3.1, -2.3}};
#define PROBE_MEMORY 0.01
#define PROBE_COMMAND 1.7

/* Torque that `model`, one effect on a plant, adds in the equation of `joint` (0-based). */
static double added_torque(const struct mk_model *model, const double *at, int joint)
{
    int n = mk_model_joints(model);
    double x[MK_MAX_STATES], dx[MK_MAX_STATES], tau[MK_MAX_JOINTS];
    double u[MK_MAX_INPUTS] = {PROBE_COMMAND, 0.0};
    for (int i = 0; i < MK_MAX_STATES; i++)
        x[i] = i < 2 * n ? at[i] : PROBE_MEMORY;
    mk_model_rhs(model, 1.0, x, u, dx);
    mk_plant_inverse_dynamics(model, x, x + n, dx + n, tau);
    return tau[joint];
}

/* A command acts in the equation of the motor joint: what enters another one is out of its reach,
 * such as the weight of an eccentric wheel, which the link below carries. */
static bool leaves_other_joint(const struct mk_model *model)
{
    int n = mk_model_joints(model), motor = mk_plant(model->plant)->motor_joint;
    for (int j = 0; j < n; j++)
        for (int i = 0; i < PROBES && j != motor; i++)
            if (fabs(added_torque(model, probe[i], j)) > 1e-9 * model->u_max)
                return false;
    return true;
}

/* Not for delays and lags, which have to be known before; not for limits, beyond which there is
 * nothing; not for contact. Within its limits `back-emf-limit` asks for nothing. */
static bool can_make_up_for(const struct mk_model *nominal, const struct mk_effect_use *use)
{
    struct mk_model alone = *nominal;
    if (!mk_effect(use->index)->invertible)
        return false;
    alone.effect_count = 1;
    alone.effect[0] = *use;
    return leaves_other_joint(&alone);
}

/* `nominal` with those of its effects that `keep` says. */
static void filter(const struct mk_model *nominal, struct mk_model *out,
                   bool (*keep)(const struct mk_model *, const struct mk_effect_use *))
{
    *out = *nominal;
    out->effect_count = 0;
    for (int i = 0; i < nominal->effect_count; i++)
        if (keep(nominal, &nominal->effect[i]))
            out->effect[out->effect_count++] = nominal->effect[i];
}

void mk_compensated_model(const struct mk_model *nominal, struct mk_model *out)
{
    filter(nominal, out, can_make_up_for);
}

/* --- the command --------------------------------------------------------------------------- */

static double motor_acceleration(const struct mk_model *model, double t, const double *x, double u)
{
    double dx[MK_MAX_STATES], input[MK_MAX_INPUTS] = {u, 0.0};
    mk_model_rhs(model, t, x, input, dx);
    return dx[mk_model_joints(model) + mk_plant(model->plant)->motor_joint];
}

/* Acceleration of the plant's motor joint is affine in the command. */
struct line {
    double at_zero, slope;
};

static struct line plant_line(const struct mk_model *plant, double t, const double *x)
{
    double zero = motor_acceleration(plant, t, x, 0.0);
    double most = motor_acceleration(plant, t, x, plant->u_max);
    return (struct line){zero, (most - zero) / plant->u_max};
}

#define STEPS 47 /* every third halves the bracket; most laws are straight and take 2 or 3 */
#define CLOSE 1e-11

double mk_compensate(const struct mk_model *full, const struct mk_model *plant, double t,
                     const double *x, double wish)
{
    double low = -plant->u_max, high = plant->u_max;
    struct line line = plant_line(plant, t, x);
    double u = mk_clamp(wish, low, high);
    double target = line.at_zero + line.slope * u, close = CLOSE * line.slope * plant->u_max;
    double r = motor_acceleration(full, t, x, u) - target;
    if (!(fabs(r) > close))
        return u;
    double r_low = motor_acceleration(full, t, x, low) - target;
    double r_high = motor_acceleration(full, t, x, high) - target;
    if (!(r_high - r_low > close)) /* the command does nothing, or nothing finite */
        return u;
    if (r_low >= 0.0 || r_high <= 0.0)
        return r_low >= 0.0 ? low : high;
    double next = u - r / line.slope;
    for (int i = 0; i < STEPS && fabs(r) > close; i++) {
        if (r < 0.0)
            low = u, r_low = r;
        else
            high = u, r_high = r;
        if (i > 0)
            next = low - r_low * (high - low) / (r_high - r_low);
        bool inside = next > low && next < high;
        u = inside && i % 3 != 2 ? next : 0.5 * (low + high);
        r = motor_acceleration(full, t, x, u) - target;
    }
    return u;
}

/* The other way: command that does to the law's world what u does to the rig. */
static double told_to_law(const struct mk_compensator *c, double t, const double *x, double u)
{
    struct line line = plant_line(&c->plant, t, x);
    return (motor_acceleration(&c->full, t, x, u) - line.at_zero) / line.slope;
}

/* --- the law's world ----------------------------------------------------------------------- */

static bool remains(const struct mk_model *nominal, const struct mk_effect_use *use)
{
    unsigned stages = mk_effect(use->index)->stages;
    return (stages & (MK_STAGE_FRAME | MK_STAGE_TORQUE)) && !(stages & MK_STAGE_STATE) &&
           !can_make_up_for(nominal, use);
}

void mk_remaining_model(const struct mk_model *nominal, struct mk_model *out)
{
    filter(nominal, out, remains);
}

static bool known(const struct mk_model *nominal, const struct mk_effect_use *use)
{
    return remains(nominal, use) || can_make_up_for(nominal, use);
}

/* --- around a step of the law -------------------------------------------------------------- */

enum mk_status mk_compensator_create(const struct mk_model *nominal, double dt,
                                     struct mk_compensator **out, struct mk_error *err)
{
    *out = NULL;
    struct mk_compensator *c = calloc(1, sizeof *c);
    if (!c)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for feed-forward");
    c->nominal = *nominal;
    c->dt = dt;
    mk_remaining_model(nominal, &c->plant);
    filter(nominal, &c->full, known);
    for (int i = 0; i < nominal->effect_count; i++)
        if (mk_effect(nominal->effect[i].index)->stages & MK_STAGE_MEASUREMENT)
            c->corrects_readings = true;
    if (c->full.effect_count == 0 && !c->corrects_readings) {
        mk_compensator_destroy(c);
        return MK_OK;
    }
    mk_observer_init(&c->observer, &c->plant, dt, OBSERVER_HZ);
    c->observer.delays = mk_delays_of(nominal, dt);
    mk_compensator_reset(c);
    *out = c;
    return MK_OK;
}

void mk_compensator_destroy(struct mk_compensator *c)
{
    free(c);
}

void mk_compensator_reset(struct mk_compensator *c)
{
    mk_observer_reset(&c->observer);
}

/* True angles and speeds for readings; one over the slope of each encoder's law scales its speed.
 */
static void correct_readings(const struct mk_compensator *c, struct mk_ctrl_input *in)
{
    const double h = 1e-4; /* rad */
    int n = mk_model_joints(&c->nominal);
    double q[MK_MAX_JOINTS], x[MK_MAX_STATES], above[MK_MAX_JOINTS], below[MK_MAX_JOINTS];
    static const double still[MK_MAX_JOINTS];
    mk_model_unmeasure(&c->nominal, in->t, in->q, q);
    mk_model_initial_state(&c->nominal, q, still, x);
    for (int j = 0; j < n; j++)
        x[j] = q[j] + h;
    mk_model_measure(&c->nominal, in->t, x, above);
    for (int j = 0; j < n; j++)
        x[j] = q[j] - h;
    mk_model_measure(&c->nominal, in->t, x, below);
    for (int j = 0; j < n; j++) {
        double slope = (above[j] - below[j]) / (2.0 * h);
        in->q[j] = q[j];
        in->v[j] = slope > 0.1 ? in->v[j] / slope : in->v[j];
    }
}

/* State of `full` for joints at x, by MK_MAX_JOINTS, and effects with memory as in z. */
static void full_state(const struct mk_compensator *c, const double *x, double *z)
{
    int n = mk_model_joints(&c->full);
    for (int j = 0; j < n; j++) {
        z[j] = x[j];
        z[n + j] = x[MK_MAX_JOINTS + j];
    }
}

/* Lets the effects with memory follow a motion: one linearly implicit Euler step each, which stays
 * bounded however stiff a bristle is. */
static void follow(const struct mk_model *full, double t, double *z, double dt)
{
    int states = mk_model_state_count(full), first = 2 * mk_model_joints(full);
    double rate[MK_MAX_STATES], moved[MK_MAX_STATES], u[MK_MAX_INPUTS] = {0.0, 0.0};
    if (first == states)
        return;
    mk_model_rhs(full, t, z, u, rate);
    for (int i = first; i < states; i++) {
        double h = 1e-6 * fmax(1e-3, fabs(z[i])), was = z[i];
        z[i] = was + h;
        mk_model_rhs(full, t, z, u, moved);
        double slope = fmin((moved[i] - rate[i]) / h, 0.0);
        z[i] = was;
        rate[i] /= 1.0 - dt * slope;
    }
    for (int i = first; i < states; i++)
        z[i] += dt * rate[i];
}

/* The observed motion since the last tick, and what it did to the effects with memory. */
static void track(struct mk_compensator *c, const struct mk_ctrl_input *in, bool begins,
                  const double *x)
{
    int n = mk_model_joints(&c->full);
    double dt = in->dt > 0.0 ? in->dt : c->dt;
    if (begins) {
        double q[MK_MAX_JOINTS], v[MK_MAX_JOINTS] = {0.0, 0.0};
        for (int j = 0; j < n; j++)
            q[j] = x[j];
        mk_model_initial_state(&c->full, q, v, c->effect);
    } else {
        full_state(c, x, c->effect);
        for (int j = 0; j < n; j++) /* by the way made, so that none of it gets lost */
            c->effect[n + j] = (x[j] - c->last_q[j]) / dt;
        follow(&c->full, in->t, c->effect, dt);
    }
    memcpy(c->last_q, x, sizeof c->last_q);
}

void mk_compensator_before(struct mk_compensator *c, const struct mk_ctrl_input *in,
                           struct mk_ctrl_input *seen)
{
    double x[MK_CTRL_STATES];
    *seen = *in;
    if (c->corrects_readings)
        correct_readings(c, seen);
    bool begins = !c->observer.primed;
    mk_observer_step(&c->observer, seen, x);
    track(c, in, begins, x);
    memcpy(c->ahead, x, sizeof x);
    mk_observer_ahead(&c->observer, c->ahead, 0.0);
    full_state(c, c->ahead, c->effect);
    seen->u = told_to_law(c, in->t, c->effect, in->u);
    c->observer.u[0] = seen->u;
    mk_ctrl_predict(&c->plant, c->ahead, seen->u, LEAD_SAMPLES * c->dt);
}

static bool usable(const struct mk_compensator *c)
{
    for (int i = 0; i < MK_CTRL_STATES; i++)
        if (!(fabs(c->ahead[i]) < WILD))
            return false;
    return true;
}

void mk_compensator_after(struct mk_compensator *c, const struct mk_ctrl_input *in, double share,
                          struct mk_ctrl_output *out)
{
    double wish = out->u;
    if (!usable(c)) {
        mk_compensator_reset(c);
        return;
    }
    double z[MK_MAX_STATES], lead = LEAD_SAMPLES * c->dt;
    memcpy(z, c->effect, sizeof z);
    full_state(c, c->ahead, z);
    follow(&c->full, in->t + lead, z, lead);
    double u = mk_compensate(&c->full, &c->plant, in->t + lead, z, wish);
    wish = mk_clamp(wish, -c->plant.u_max, c->plant.u_max);
    if (isfinite(u))
        out->u = wish + share * (u - wish);
}
