// The simulation handle (mechkit/sim.h): command edges, delays, energy; solvers do the rest.
//
// A model is dx/dt = f(t, x, u), its readings h(t, x). Three things lie between that and a solver.
//     edges    u is held from sample to sample (zero-order hold) and jumps at the edges. Between
//              two edges u is constant and f smooth, but for the switching of effects, so that a
//              solver runs from edge to edge and never over one.
//     delays   A command given at t acts from t + d on, d the sum of all input delays; those on
//              their way are kept in a ring, in the order of time. A reading of joint j shows the
//              state at t - age_j; past states are kept in another ring.
//     energy   The work of the motors is integrated beside the states,
//                  dW/dt = u_0 v_m + u_1 v_2 ,   W = 0 at the reset ,
//              as the last value of y = (x, W), in torque units x rad; u are the commands after
//              limit and effects, v_m the motor's speed, v_2 that of joint 2, where a second motor
//              acts. With T + V the energy of the plant,
//                  loss = W - (T + V - (T + V)(reset)) ,
//              which is what friction and effects have taken.
//
// The solvers (sim/integrator.hpp) see the command in force as System::u. Where they go on they
// rely on what came before: `fresh` says that state, model or command have jumped, and that the
// next run begins with a restart.
#include "mechkit/sim.h"

#include <cmath>
#include <cstring>
#include <new>

#include "sim/integrator.hpp"

using mk::Integrator;
using mk::SolverRow;
using mk::System;

namespace
{

// At a delay of 1 s and 2 kHz this many commands are on their way; with room to spare.
constexpr int EDGES = 4096;

const SolverRow rows[] = {
    {MK_SOLVER_CVODE_ADAMS, "cvode-adams", true, mk::create_cvode_adams},
    {MK_SOLVER_CVODE_BDF, "cvode-bdf", true, mk::create_cvode_bdf},
    {MK_SOLVER_ARKODE_ERK, "arkode-erk", true, mk::create_arkode_erk},
    {MK_SOLVER_DOP853, "dop853", false, mk::create_dop853},
};

// Delayed readings look this many advances back at most.
constexpr int HISTORY = 2048;

// A state as it was; x has as many values as the model has states.
struct Past {
    double t;
    double x[MK_MAX_STATES];
};

// Command u comes into force at t.
struct Edge {
    double t;
    double u[MK_MAX_INPUTS];
};

} // namespace

struct mk_sim {
    System system;
    Integrator *integrator;
    double t, delay;
    double y[MK_MAX_STATES + 1];
    double issued[MK_MAX_INPUTS]; // the newest command, perhaps not yet in force
    double energy0;               // kinetic + potential at reset
    bool ready, fresh;            // reset has been called; the solver must be restarted
    Edge edge[EDGES];             // commands on their way, a ring
    int first, count;
    double age[MK_MAX_JOINTS]; // of each joint's reading
    Past *past;                // ring of earlier states; NULL when nothing is late
    int past_next, past_count;
};

namespace mk
{

const SolverRow *solver_row(enum mk_solver kind)
{
    // Measured over samples of 2 ms (make bench): a one-step method beats the multistep ones, which
    // lose their history at every edge of the command.
    if (kind == MK_SOLVER_DEFAULT)
        kind = MK_SOLVER_ARKODE_ERK;
    for (const SolverRow &row : rows)
        if (row.kind == kind)
            return &row;
    return nullptr;
}

} // namespace mk

const char *mk_solver_name(enum mk_solver solver)
{
    if (solver == MK_SOLVER_DEFAULT)
        return "default";
    const SolverRow *row = mk::solver_row(solver);
    return row ? row->name : "?";
}

enum mk_solver mk_solver_by_name(const char *name)
{
    for (int i = 0; i < MK_SOLVER_COUNT; i++)
        if (strcmp(mk_solver_name(static_cast<enum mk_solver>(i)), name) == 0)
            return static_cast<enum mk_solver>(i);
    return MK_SOLVER_COUNT;
}

// How old each joint's reading is. The delays of all its effects add up; joint 0 stands for all
// joints.
static void find_ages(mk_sim *sim)
{
    const mk_model &m = sim->system.model;
    sim->age[0] = sim->age[1] = 0.0;
    for (int e = 0; e < m.effect_count; e++) {
        if (!(mk_effect(m.effect[e].index)->stages & MK_STAGE_SENSOR_DELAY))
            continue;
        for (int j = 0; j < mk_model_joints(&m); j++)
            if (m.effect[e].joint == 0 || m.effect[e].joint == j + 1)
                sim->age[j] += m.effect[e].value[0];
    }
}

// Whether a reading may be late, now or with other values (mk_sim_set_values).
static bool may_read_late(const mk_model &m)
{
    bool may = false;
    for (int e = 0; e < m.effect_count; e++)
        may |= (mk_effect(m.effect[e].index)->stages & MK_STAGE_SENSOR_DELAY) != 0;
    return may;
}

// The present state becomes the newest of the ring, and the oldest is lost where it is full. Called
// once for each run of the solver, so also at every edge on the way.
static void remember(mk_sim *sim)
{
    if (!sim->past)
        return;
    Past &p = sim->past[sim->past_next];
    p.t = sim->t;
    memcpy(p.x, sim->y, sizeof(double) * (size_t)sim->system.states);
    sim->past_next = (sim->past_next + 1) % HISTORY;
    if (sim->past_count < HISTORY)
        sim->past_count++;
}

// All memory is taken here; the ring of past states only where a reading is late. The integrator
// keeps a reference to sim->system, so that it is destroyed first.
enum mk_status mk_sim_create(const mk_model *model, const mk_sim_config *config, mk_sim **out,
                             mk_error *err)
{
    *out = nullptr;
    enum mk_status st = mk_model_check(model, err);
    if (st != MK_OK)
        return st;
    const SolverRow *row = mk::solver_row(config ? config->solver : MK_SOLVER_DEFAULT);
    if (!row)
        return mk_error_set(err, MK_ERR_INVALID, "unknown solver");
    if (!row->any_model && !mk_model_is_smooth(model))
        return mk_error_set(err, MK_ERR_NOTSUP,
                            "solver %s is for models without contact and states of effects",
                            row->name);
    mk_sim *sim = new (std::nothrow) mk_sim();
    if (!sim)
        return mk_error_set(err, MK_ERR_NOMEM, "out of memory");
    System &s = sim->system;
    s.model = *model;
    s.compiled = mk::compile<double>(*model);
    s.states = mk_model_state_count(model);
    s.events = mk_model_event_count(model);
    s.rtol = config && config->rtol > 0.0 ? config->rtol : model->rtol;
    s.atol = config && config->atol > 0.0 ? config->atol : model->atol;
    sim->delay = mk_model_command_delay(model);
    find_ages(sim);
    const bool late = may_read_late(sim->system.model);
    sim->past = late ? new (std::nothrow) Past[HISTORY] : nullptr;
    sim->integrator = row->create(s, err);
    if (!sim->integrator || (late && !sim->past)) {
        mk_sim_destroy(sim);
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for the simulation");
    }
    *out = sim;
    return MK_OK;
}

void mk_sim_destroy(mk_sim *sim)
{
    if (!sim)
        return;
    delete sim->integrator;
    delete[] sim->past;
    delete sim;
}

// The same plant and effects at the same joints, so that states and their order stay what they
// are. Commands on their way keep the times that the old delay gave them. Nothing changes on
// failure.
enum mk_status mk_sim_set_values(mk_sim *sim, const mk_model *model, mk_error *err)
{
    const mk_model &now = sim->system.model;
    bool same = now.plant == model->plant && now.effect_count == model->effect_count;
    for (int e = 0; same && e < model->effect_count; e++)
        same = now.effect[e].index == model->effect[e].index &&
               now.effect[e].joint == model->effect[e].joint;
    if (!same)
        return mk_error_set(err, MK_ERR_INVALID, "values of a model with other effects");
    enum mk_status st = mk_model_check(model, err);
    if (st != MK_OK)
        return st;
    sim->system.model = *model;
    sim->system.compiled = mk::compile<double>(*model);
    sim->delay = mk_model_command_delay(model);
    find_ages(sim);
    sim->fresh = true;
    return MK_OK;
}

// T + V of the plant without its effects, torque units x rad: what effects store (a spring, a
// moving base) counts as loss.
static double mechanical_energy(const mk_sim *sim)
{
    const mk_model *m = &sim->system.model;
    const double *q = sim->y, *v = sim->y + mk_model_joints(m);
    return mk_plant_kinetic(m, q, v) + mk_plant_potential(m, q);
}

// With u_past in force since ever nothing is on its way, and past states begin anew. Where x is not
// finite, MK_ERR_NUMERIC; y is then overwritten in part.
enum mk_status mk_sim_reset(mk_sim *sim, double t, const double *x, const double *u_past)
{
    for (int i = 0; i < sim->system.states; i++) {
        if (!std::isfinite(x[i]))
            return MK_ERR_NUMERIC;
        sim->y[i] = x[i];
    }
    sim->y[sim->system.states] = 0.0;
    for (int i = 0; i < MK_MAX_INPUTS; i++)
        sim->system.u[i] = sim->issued[i] = u_past ? u_past[i] : 0.0;
    sim->t = t;
    sim->first = sim->count = 0;
    sim->ready = sim->fresh = true;
    sim->past_next = sim->past_count = 0;
    remember(sim);
    sim->energy0 = mechanical_energy(sim);
    return MK_OK;
}

// Bit by bit: a command that is repeated is no edge, and costs no restart.
static bool differs(const double *a, const double *b)
{
    return memcmp(a, b, sizeof(double) * MK_MAX_INPUTS) != 0;
}

static void put_in_force(mk_sim *sim, const double *u)
{
    if (!differs(sim->system.u, u))
        return;
    memcpy(sim->system.u, u, sizeof sim->system.u);
    sim->fresh = true;
}

// Integrates y from sim->t to t_end under the command in force. After a failure time stays where it
// was, and the simulation has to be reset.
static enum mk_status run_to(mk_sim *sim, double t_end, mk_error *err)
{
    // Solvers refuse intervals at the resolution of time itself; nothing happens in those.
    if (t_end - sim->t <= 1e-13 * std::fmax(1.0, std::fabs(t_end))) {
        sim->t = t_end;
        return MK_OK;
    }
    if (sim->fresh) {
        if (sim->integrator->restart(sim->t, sim->y) != MK_OK)
            return mk_error_set(err, MK_ERR_NUMERIC, "the solver cannot start at t = %g", sim->t);
        sim->fresh = false;
    }
    enum mk_status st = sim->integrator->advance(t_end, sim->y, err);
    if (st == MK_OK)
        sim->t = t_end;
    else
        sim->ready = false;
    if (st == MK_OK)
        remember(sim);
    return st;
}

// A command given at time t: in force at once without a delay, else an edge at t + d. MK_ERR_RANGE
// where the ring is full. Edges are in the order of time: where d has become shorter
// (mk_sim_set_values) a command waits for those that were given before it.
static enum mk_status issue(mk_sim *sim, double t, const double *u, mk_error *err)
{
    if (sim->delay <= 0.0 && sim->count == 0) {
        put_in_force(sim, u);
        return MK_OK;
    }
    if (!differs(sim->issued, u))
        return MK_OK;
    if (sim->count == EDGES)
        return mk_error_set(err, MK_ERR_RANGE, "more than %d commands wait in the input delay",
                            EDGES);
    const double last = sim->count ? sim->edge[(sim->first + sim->count - 1) % EDGES].t : t;
    Edge &e = sim->edge[(sim->first + sim->count++) % EDGES];
    e.t = std::fmax(t + sim->delay, last);
    memcpy(e.u, u, sizeof e.u);
    memcpy(sim->issued, u, sizeof sim->issued);
    return MK_OK;
}

// What was given at t <= now acts already if t + d <= now. Of several such the last one told is in
// force.
enum mk_status mk_sim_issued_before(mk_sim *sim, double t, const double *u, mk_error *err)
{
    if (!sim->ready || t > sim->t)
        return mk_error_set(err, MK_ERR_STATE, "earlier commands are told between reset and now");
    if (t + sim->delay > sim->t)
        return issue(sim, t, u, err);
    memcpy(sim->issued, u, sizeof sim->issued);
    put_in_force(sim, u);
    return MK_OK;
}

// From edge to edge: run to the first one on its way, put its command in force, and so on while
// there are edges up to t_end; then to t_end. An edge at t_end itself is in force afterwards, so
// that mk_sim_applied() tells it.
enum mk_status mk_sim_advance(mk_sim *sim, double t_end, const double *u, mk_error *err)
{
    if (!sim->ready)
        return mk_error_set(err, MK_ERR_STATE, "the simulation must be reset first");
    for (int i = 0; i < MK_MAX_INPUTS; i++)
        if (!std::isfinite(u[i]))
            return mk_error_set(err, MK_ERR_INVALID, "the command is not a finite number");
    if (!(t_end >= sim->t))
        return mk_error_set(err, MK_ERR_INVALID, "time runs backwards: %g to %g", sim->t, t_end);
    enum mk_status st = issue(sim, sim->t, u, err);
    while (st == MK_OK && sim->count > 0 && sim->edge[sim->first].t <= t_end) {
        const Edge e = sim->edge[sim->first];
        sim->first = (sim->first + 1) % EDGES;
        sim->count--;
        st = run_to(sim, e.t, err);
        put_in_force(sim, e.u);
    }
    return st == MK_OK ? run_to(sim, t_end, err) : st;
}

double mk_sim_time(const mk_sim *sim)
{
    return sim->t;
}

const double *mk_sim_state(const mk_sim *sim)
{
    return sim->y;
}

// The state x (the model's states) at time t in the past, between two that are remembered: `before`
// at t_0 and `after` at t_1. With h = t_1 - t_0, s = (t - t_0) / h and r = 1 - s,
//     x_i = r x_i(t_0) + s x_i(t_1)                                        all but the angles ,
//     q_j = (1 + 2s) r^2 q_j(t_0) + s^2 (3 - 2s) q_j(t_1) + h s r (r v_j(t_0) - s v_j(t_1)) ,
// the cubic Hermite polynomial, whose values and slopes at both ends are those remembered: its
// error falls with h^4. Before the first one, and behind the newest, q goes on evenly with the
// speed there and the rest stays. Before the reset the rig is taken to have moved evenly.
static void recall(const mk_sim *sim, double t, double *x)
{
    const int n = sim->system.states, joints = mk_model_joints(&sim->system.model);
    // From the newest backwards to the first one that is not later than t.
    const Past *after = nullptr, *before = nullptr;
    for (int i = 1; i <= sim->past_count && !before; i++) {
        const Past *p = &sim->past[(sim->past_next + HISTORY - i) % HISTORY];
        if (p->t <= t)
            before = p;
        else
            after = p;
    }
    const Past *only = before ? before : after;
    double dt = t - only->t;
    memcpy(x, only->x, sizeof(double) * (size_t)n);
    if (before && after) {
        double h = after->t - before->t, s = dt / h, r = 1.0 - s;
        for (int i = 0; i < n; i++)
            x[i] = r * before->x[i] + s * after->x[i];
        for (int j = 0; j < joints; j++)
            x[j] = (1.0 + 2.0 * s) * r * r * before->x[j] + s * s * (3.0 - 2.0 * s) * after->x[j] +
                   h * s * r * (r * before->x[joints + j] - s * after->x[joints + j]);
    } else {
        for (int j = 0; j < joints; j++)
            x[j] += dt * x[joints + j];
    }
}

// y_j = h_j(t - age_j, x(t - age_j)). Each joint may have an age of its own, so that each is read
// from a state of its own.
void mk_sim_measure(const mk_sim *sim, double *y)
{
    const mk_model *m = &sim->system.model;
    mk_model_measure(m, sim->t, sim->y, y);
    for (int j = 0; sim->past && j < mk_model_joints(m); j++) {
        if (!(sim->age[j] > 0.0))
            continue;
        double x[MK_MAX_STATES], then[MK_MAX_JOINTS];
        recall(sim, sim->t - sim->age[j], x);
        mk_model_measure(m, sim->t - sim->age[j], x, then);
        y[j] = then[j];
    }
}

void mk_sim_applied(const mk_sim *sim, double *u)
{
    double limit = sim->system.model.u_max;
    u[0] = std::fmin(std::fmax(sim->system.u[0], -limit), limit);
    u[1] = sim->system.u[1];
}

void mk_sim_get_stats(const mk_sim *sim, mk_sim_stats *out)
{
    sim->integrator->stats(out);
}

// Kinetic and potential energy are those of the plant (docs/theory.md, section 2); W comes from the
// integration, the loss is what is missing.
enum mk_status mk_sim_energy(const mk_sim *sim, mk_energy *out)
{
    if (!sim->ready)
        return MK_ERR_STATE;
    const mk_model *m = &sim->system.model;
    const double *q = sim->y, *v = sim->y + mk_model_joints(m);
    out->kinetic = mk_plant_kinetic(m, q, v);
    out->potential = mk_plant_potential(m, q);
    out->work = sim->y[sim->system.states];
    out->loss = out->work - (out->kinetic + out->potential - sim->energy0);
    return MK_OK;
}
