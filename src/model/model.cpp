// Evaluation of models for C: thin shells over the templates.
#include "mechkit/model.h"

#include <cmath>
#include <cstdio>
#include <cstring>

#include "model/dual.hpp"
#include "model/state.hpp"

using namespace mk;

const char *mk_input_name(enum mk_input input)
{
    return input == MK_INPUT_COMMANDED ? "commanded" : "measured";
}

void mk_model_default(enum mk_plant_kind kind, mk_model *out)
{
    const mk_plant_info *plant = mk_plant(kind);
    *out = {};
    out->plant = plant->kind;
    out->g = 9.81;
    out->u_max = plant->u_max > 0.0 ? plant->u_max : 10.0;
    out->u_to_torque = plant->u_to_torque > 0.0 ? plant->u_to_torque : 0.00494;
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        mk_model_set_linear(out, j, plant->joint_motion[j] == MK_JOINT_SLIDES, nullptr);
    for (int i = 0; i < plant->parameter_count; i++)
        out->parameter[i] = plant->parameter[i].initial;
    out->rtol = 1e-8;
    out->atol = 1e-10;
}

static enum mk_status check_value(const mk_parameter_info *p, double value, const char *owner,
                                  mk_error *err)
{
    if (value >= p->min && value <= p->max && std::isfinite(value))
        return MK_OK;
    if (p->max > 1e300)
        return mk_error_set(err, MK_ERR_RANGE, "%s%s = %g is outside its range: %s %g", owner,
                            p->name, value, "it must be finite and at least", p->min);
    return mk_error_set(err, MK_ERR_RANGE, "%s%s = %g is outside its range %g .. %g", owner,
                        p->name, value, p->min, p->max);
}

// The mass matrix is positive definite everywhere when its smallest determinant is.
static enum mk_status check_mass(const mk_model *m, mk_error *err)
{
    double sides[2];
    with_plant(m->plant, [&](auto plant) { plant.mass_sides(m->parameter, sides); });
    if (sides[0] > sides[1])
        return MK_OK;
    return mk_error_set(err, MK_ERR_RANGE, "%s (mass matrix): %g against %g",
                        mk_plant(m->plant)->mass_rule, sides[0], sides[1]);
}

enum mk_status mk_model_check(const mk_model *m, mk_error *err)
{
    const mk_plant_info *plant = mk_plant(m->plant);
    if (!plant)
        return mk_error_set(err, MK_ERR_INVALID, "unknown kind of plant");
    for (int i = 0; i < plant->parameter_count; i++) {
        enum mk_status st = check_value(&plant->parameter[i], m->parameter[i], "", err);
        if (st != MK_OK)
            return st;
    }
    for (int i = 0; i < m->effect_count; i++) {
        const mk_effect_info *info = mk_effect(m->effect[i].index);
        char owner[64];
        snprintf(owner, sizeof owner, "%s: ", info->name);
        for (int k = 0; k < info->parameter_count; k++) {
            enum mk_status st = check_value(&info->parameter[k], m->effect[i].value[k], owner, err);
            if (st != MK_OK)
                return st;
        }
    }
    return check_mass(m, err);
}

// --- sizes ---------------------------------------------------------------------------------------

int mk_model_joints(const mk_model *model)
{
    return mk_plant(model->plant)->joints;
}

static int sum_over_effects(const mk_model *model, int mk_effect_info::*count)
{
    int n = 0;
    for (int i = 0; i < model->effect_count; i++)
        n += mk_effect(model->effect[i].index)->*count;
    return n;
}

int mk_model_state_count(const mk_model *model)
{
    return 2 * mk_model_joints(model) + sum_over_effects(model, &mk_effect_info::state_count);
}

int mk_model_event_count(const mk_model *model)
{
    return sum_over_effects(model, &mk_effect_info::event_count);
}

int mk_model_parameter_count(const mk_model *model)
{
    return mk_plant(model->plant)->parameter_count +
           sum_over_effects(model, &mk_effect_info::parameter_count);
}

bool mk_model_hides_joint(const mk_model *model)
{
    constexpr unsigned between = MK_STAGE_STATE | MK_STAGE_MEASUREMENT;
    for (int e = 0; e < model->effect_count; e++)
        if ((mk_effect(model->effect[e].index)->stages & between) == between)
            return true;
    return false;
}

bool mk_model_is_smooth(const mk_model *model)
{
    return mk_model_event_count(model) == 0 &&
           mk_model_state_count(model) == 2 * mk_model_joints(model);
}

static enum mk_status check_fit(const mk_model *model, const mk_effect_info *info, int joint,
                                mk_error *err)
{
    const mk_plant_info *plant = mk_plant(model->plant);
    if (!(info->plants & (1u << model->plant)))
        return mk_error_set(err, MK_ERR_INVALID, "effect '%s' makes no sense on the %s", info->name,
                            plant->name);
    if (info->joint_rule == MK_EFFECT_JOINT_NONE && joint != 0)
        return mk_error_set(err, MK_ERR_INVALID, "effect '%s' acts on the rig: leave out joint",
                            info->name);
    bool needs = info->joint_rule == MK_EFFECT_JOINT_ANY;
    if (joint < (needs ? 1 : 0) || joint > plant->joints)
        return mk_error_set(err, MK_ERR_INVALID, "effect '%s' needs joint = 1%s, not %d",
                            info->name, plant->joints > 1 ? " or 2" : "", joint);
    return MK_OK;
}

enum mk_status mk_model_add_effect(mk_model *model, const char *name, int joint, mk_error *err)
{
    int index = 0;
    while (name && mk_effect(index) && strcmp(mk_effect(index)->name, name) != 0)
        index++;
    const mk_effect_info *info = name ? mk_effect(index) : nullptr;
    if (!info)
        return mk_error_set(err, MK_ERR_NOTFOUND, "there is no effect '%s'", name ? name : "");
    enum mk_status st = check_fit(model, info, joint, err);
    if (st != MK_OK)
        return st;
    if (model->effect_count >= MK_MAX_EFFECTS)
        return mk_error_set(err, MK_ERR_RANGE, "a model has at most %d effects", MK_MAX_EFFECTS);
    mk_effect_use *use = &model->effect[model->effect_count];
    int states = mk_model_state_count(model) + info->state_count;
    int events = mk_model_event_count(model) + info->event_count;
    if (states > MK_MAX_STATES || events > MK_MAX_EVENTS)
        return mk_error_set(err, MK_ERR_RANGE, "too many effects with states or switching");
    *use = {};
    use->index = index;
    use->joint = joint;
    for (int i = 0; i < info->parameter_count; i++)
        use->value[i] = strcmp(info->parameter[i].name, mk::SHARPNESS.name) == 0
                            ? mk_model_sharpness(model, joint - 1)
                            : info->parameter[i].initial;
    model->effect_count++;
    return MK_OK;
}

double mk_model_command_delay(const mk_model *model)
{
    double delay = 0.0;
    for (int i = 0; i < model->effect_count; i++)
        if (mk_effect(model->effect[i].index)->stages & MK_STAGE_COMMAND_DELAY)
            delay += model->effect[i].value[0];
    return delay;
}

// --- evaluation ----------------------------------------------------------------------------------

void mk_model_initial_state(const mk_model *model, const double *q, const double *v, double *x)
{
    initial_state(compile<double>(*model), q, v, x);
}

void mk_model_rhs(const mk_model *model, double t, const double *x, const double *u, double *dx)
{
    Compiled<double> c = compile<double>(*model);
    rhs(c, t, x, u, dx);
}

void mk_model_events(const mk_model *model, double t, const double *x, const double *u, double *g)
{
    Compiled<double> c = compile<double>(*model);
    Frame<double> f;
    frame_begin(f, c, t, x, u);
    for (int i = 0; i < c.effect_count; i++)
        if (auto *events = effect_ops<double>(c.effect[i].index).events)
            events(f, args_of(c.effect[i], x), g + c.effect[i].event);
}

void mk_model_measure(const mk_model *model, double t, const double *x, double *y)
{
    Compiled<double> c = compile<double>(*model);
    measure(c, t, x, y);
}

void mk_model_unmeasure(const mk_model *model, double t, const double *y, double *q)
{
    int n = mk_model_joints(model);
    double v[MK_MAX_JOINTS] = {0.0, 0.0}, x[MK_MAX_STATES], reading[MK_MAX_JOINTS];
    for (int j = 0; j < n; j++)
        q[j] = y[j];
    // Readings are angles plus something small: the iteration contracts at once.
    for (int i = 0; i < 50; i++) {
        mk_model_initial_state(model, q, v, x);
        mk_model_measure(model, t, x, reading);
        double worst = 0.0;
        for (int j = 0; j < n; j++) {
            double e = y[j] - reading[j];
            q[j] += e;
            worst = std::fmax(worst, std::fabs(e));
        }
        if (worst < 1e-15)
            break;
    }
}

// --- the textbook plant --------------------------------------------------------------------------

// A copy without effects, so that the plant functions mean the plant alone.
static Compiled<double> compile_plant(const mk_model *model)
{
    mk_model bare = *model;
    bare.effect_count = 0;
    return compile<double>(bare);
}

void mk_plant_mass(const mk_model *model, const double *q, const double *v, double *mass, double *h)
{
    Compiled<double> c = compile_plant(model);
    Motion<double> m = motion_of(c.joints, q, v);
    Assembler<double> sum(c.p);
    with_plant(c.plant, [&](auto law) { law.law(m, c.g, sum); });
    double f[2] = {sum.f1, sum.f2};
    f[c.motor] += motor_friction(c, m.v[c.motor], 1.0);
    mass[0] = sum.m11;
    h[0] = f[0];
    if (c.joints == 2) {
        mass[1] = mass[2] = sum.m12;
        mass[3] = sum.m22;
        h[1] = f[1];
    }
}

void mk_plant_inverse_dynamics(const mk_model *model, const double *q, const double *v,
                               const double *a, double *tau)
{
    double mass[4], h[2];
    int n = mk_model_joints(model);
    mk_plant_mass(model, q, v, mass, h);
    for (int i = 0; i < n; i++) {
        tau[i] = h[i];
        for (int j = 0; j < n; j++)
            tau[i] += mass[i * n + j] * a[j];
    }
}

void mk_plant_regressor(const mk_model *model, const double *q, const double *v, const double *a,
                        double *phi)
{
    const mk_plant_info *plant = mk_plant(model->plant);
    int n = plant->joints, np = plant->parameter_count;
    Motion<double> m = motion_of(n, q, v);
    Regressor<double> r(a[0], n > 1 ? a[1] : 0.0);
    with_plant(model->plant, [&](auto law) { law.law(m, model->g, r); });
    r.phi[plant->motor_joint][np - 2] = m.v[plant->motor_joint];
    r.phi[plant->motor_joint][np - 1] =
        smooth_sign(model->friction_sharpness, m.v[plant->motor_joint]);
    for (int i = 0; i < n; i++)
        memcpy(phi + i * np, r.phi[i], sizeof(double) * static_cast<size_t>(np));
}

void mk_plant_acceleration(const mk_model *model, const double *q, const double *v,
                           const double *tau, double *a)
{
    double mass[4] = {1, 0, 0, 1}, h[2] = {0, 0}, acc[2];
    int n = mk_model_joints(model);
    mk_plant_mass(model, q, v, mass, h);
    solve_joints(n, mass[0], mass[1], mass[3], tau[0] - h[0], n > 1 ? tau[1] - h[1] : 0.0, acc);
    for (int j = 0; j < n; j++)
        a[j] = acc[j];
}

double mk_plant_kinetic(const mk_model *model, const double *q, const double *v)
{
    double mass[4], h[2], sum = 0.0;
    int n = mk_model_joints(model);
    mk_plant_mass(model, q, v, mass, h);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            sum += 0.5 * v[i] * mass[i * n + j] * v[j];
    return sum;
}

double mk_plant_potential(const mk_model *model, const double *q)
{
    return with_plant(model->plant,
                      [&](auto law) { return law.potential(model->parameter, q, model->g); });
}

double mk_plant_friction(const mk_model *model, double v)
{
    return motor_friction(compile_plant(model), v, 1.0);
}

// --- derivatives ---------------------------------------------------------------------------------

void mk_plant_linearise(const mk_model *model, const double *q, bool friction, double *a_out,
                        double *b_out)
{
    using D = Dual<5>; // q1 q2 v1 v2 u
    mk_model bare = *model;
    bare.effect_count = 0;
    const mk_plant_info *plant = mk_plant(model->plant);
    int n = plant->joints;
    if (!friction)
        bare.parameter[plant->mass_count] = bare.parameter[plant->mass_count + 1] = 0.0;
    // The command that holds the position balances the plant's gravity at the motor joint.
    double zero[2] = {0.0, 0.0}, mass[4], hold[2];
    mk_plant_mass(&bare, q, zero, mass, hold);
    bare.u_max = HUGE_VAL;
    Compiled<D> c = compile<D>(bare);
    D x[4], u[2] = {D::variable(hold[plant->motor_joint], 4), D(0.0)}, dx[4];
    for (int j = 0; j < n; j++) {
        x[j] = D::variable(q[j], j);
        x[n + j] = D::variable(0.0, 2 + j);
    }
    rhs(c, D(0.0), x, u, dx);
    for (int i = 0; i < 2 * n; i++) {
        for (int j = 0; j < n; j++) {
            a_out[i * 2 * n + j] = dx[i].d[j];
            a_out[i * 2 * n + n + j] = dx[i].d[2 + j];
        }
        b_out[i] = dx[i].d[4];
    }
}

namespace
{

constexpr int CHUNK = 8;
using Chunk = Dual<CHUNK>;

// Where the derivative with respect to variable k goes: states, inputs, parameters in a row.
struct Jacobian {
    int ns, np;
    double *dfdx, *dfdu, *dfdp;
    void put(int row, int k, double value) const
    {
        if (k < ns) {
            if (dfdx)
                dfdx[row * ns + k] = value;
        } else if (k < ns + MK_MAX_INPUTS) {
            if (dfdu)
                dfdu[row * MK_MAX_INPUTS + k - ns] = value;
        } else if (dfdp) {
            dfdp[row * np + k - ns - MK_MAX_INPUTS] = value;
        }
    }
};

void seed(Chunk &value, int k, int first)
{
    if (k >= first && k < first + CHUNK)
        value.d[k - first] = 1.0;
}

} // namespace

void mk_model_jacobian(const mk_model *model, double t, const double *x, const double *u,
                       double *dfdx, double *dfdu, double *dfdp)
{
    Jacobian out = {mk_model_state_count(model), mk_model_parameter_count(model), dfdx, dfdu, dfdp};
    int total = out.ns + MK_MAX_INPUTS + out.np;
    for (int first = 0; first < total; first += CHUNK) {
        Compiled<Chunk> c = compile<Chunk>(*model);
        Chunk xs[MK_MAX_STATES], us[MK_MAX_INPUTS], dx[MK_MAX_STATES];
        int k = 0;
        for (int i = 0; i < out.ns; i++, k++)
            xs[i] = x[i], seed(xs[i], k, first);
        for (int i = 0; i < MK_MAX_INPUTS; i++, k++)
            us[i] = u[i], seed(us[i], k, first);
        for (int i = 0; i < c.parameter_count; i++, k++)
            seed(c.p[i], k, first);
        for (int e = 0; e < c.effect_count; e++)
            for (int i = 0; i < mk_effect(c.effect[e].index)->parameter_count; i++, k++)
                seed(c.effect[e].p[i], k, first);
        rhs(c, Chunk(t), xs, us, dx);
        for (int row = 0; row < out.ns; row++)
            for (int i = first; i < first + CHUNK && i < total; i++)
                out.put(row, i, dx[row].d[i - first]);
    }
}
