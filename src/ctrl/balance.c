#include "ctrl/balance.h"

#include <string.h>

#include "ctrl/track.h"
#include "mechkit/design.h"

#define N MK_CTRL_STATES
#define USUAL_LIMIT 10.0 /* of the command; what `r` is meant for */

static double param(const struct mk_balance *b, const struct mk_ctrl *ctrl, int row)
{
    return ctrl->value[b->first + row];
}

/* The law's world is the one that the nominal model has, or the textbook's. RT. */
static void see(struct mk_balance *b, const struct mk_ctrl *ctrl, bool remaining)
{
    b->world = remaining ? b->remaining : ctrl->model;
    b->world.effect_count = remaining ? b->remaining.effect_count : 0;
    b->roa.model = &b->world;
    b->roa.really = remaining ? &b->equilibria : NULL;
    b->lift.free_joint = remaining ? b->equilibria.free_joint : -1;
}

/* The gains are made for the turn that the setup is for. Where a spring has been wound up they may
 * hold less, or nothing: then nothing is to be caught there. */
static void estimate_other_turns(struct mk_balance *b)
{
    const int home = MK_WINDINGS / 2, f = b->equilibria.free_joint;
    for (int k = 0; k < MK_WINDINGS && f >= 0; k++) {
        struct mk_standing *there = &b->equilibria.winding[k];
        struct mk_roa roa = b->roa;
        roa.equilibrium[f] += 2.0 * M_PI * (k - home);
        if (k == home || !there->found)
            continue;
        there->found = mk_roa_estimate(&roa, NULL) == MK_OK;
        there->level = there->found ? fmin(1.0, roa.level / b->roa.level) : 0.0;
    }
}

/* False: the nominal model has nothing that remains, or the law holds nothing in it. Then the law
 * goes on as if it were the textbook plant. */
static bool estimate_in_what_remains(struct mk_balance *b, const struct mk_ctrl *ctrl)
{
    mk_remaining_model(&ctrl->model, &b->remaining);
    if (b->remaining.effect_count == 0)
        return false;
    mk_equilibria_find(&b->remaining, ctrl->equilibrium, &b->equilibria);
    see(b, ctrl, true);
    if (!mk_equilibria_at(&b->equilibria, ctrl->equilibrium)->found ||
        mk_roa_estimate(&b->roa, NULL) != MK_OK)
        return false;
    estimate_other_turns(b);
    mk_lift_find(&b->remaining, ctrl->equilibrium, &b->equilibria, &b->lift);
    return true;
}

enum mk_status mk_balance_prepare(struct mk_balance *b, struct mk_ctrl *ctrl,
                                  const double *equilibrium, const double *p, mk_roa_law law,
                                  struct mk_error *err)
{
    ctrl->balances = true;
    memcpy(ctrl->equilibrium, equilibrium, sizeof ctrl->equilibrium);
    b->roa.law = law;
    b->roa.user = ctrl;
    b->roa.dt = ctrl->dt;
    memcpy(b->roa.equilibrium, equilibrium, sizeof b->roa.equilibrium);
    memcpy(b->roa.limit, b->fallen, sizeof b->roa.limit);
    memcpy(b->roa.p, p, sizeof b->roa.p);
    ctrl->roa = &b->roa;
    b->bent = estimate_in_what_remains(b, ctrl);
    see(b, ctrl, b->bent);
    return b->bent ? MK_OK : mk_roa_estimate(&b->roa, err);
}

void mk_balance_reset(struct mk_balance *b)
{
    mk_observer_reset(&b->observer);
}

void mk_balance_changed(struct mk_balance *b, const struct mk_ctrl *ctrl)
{
    bool effects = param(b, ctrl, MK_BALANCE_COMPENSATE) > 0.0;
    see(b, ctrl, effects && b->bent);
    mk_observer_init(&b->observer, &b->world, ctrl->dt, param(b, ctrl, MK_BALANCE_OBSERVER));
    if (effects)
        b->observer.delays = mk_delays_of(&ctrl->model, ctrl->dt);
}

bool mk_balance_observe(struct mk_balance *b, const struct mk_ctrl *ctrl,
                        const struct mk_ctrl_input *in, double *x)
{
    mk_observer_step(&b->observer, in, x);
    mk_observer_ahead(&b->observer, x, ctrl->dt * param(b, ctrl, MK_BALANCE_LEAD));
    for (int i = 0; i < N; i++)
        if (!(fabs(x[i]) < 1e6)) {
            mk_observer_reset(&b->observer);
            return false;
        }
    return true;
}

double mk_balance_lean(const struct mk_balance *b, const double *x, int joint)
{
    return b->roa.really ? mk_equilibria_at(b->roa.really, x)->shift[joint] : 0.0;
}

bool mk_balance_follow(const struct mk_balance *b, const struct mk_ctrl *ctrl,
                       const struct mk_ctrl_input *in, const double *x, double *u)
{
    /* x is `lead` samples ahead; one of them passes until the command acts. */
    double ahead = (param(b, ctrl, MK_BALANCE_LEAD) - 1.0) * ctrl->dt;
    return mk_track_follow(ctrl->track, x, in->t, ahead, u);
}

static bool lost(const struct mk_balance *b, const double *x)
{
    double e[N];
    mk_roa_error(&b->roa, x, e);
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        if (b->fallen[j] > 0.0 && fabs(e[j]) > b->fallen[j])
            return true;
    return false;
}

/* In the region of attraction, also if the speeds are not quite what the observer says. Without
 * that doubt a catch is made on the first tick that the nominal model forgives, at the very edge.
 */
static bool in_region(const struct mk_balance *b, const struct mk_ctrl *ctrl, const double *x)
{
    static const double sign[] = {0.0, 1.0, -1.0};
    double doubt = param(b, ctrl, MK_BALANCE_DOUBT);
    for (int i = 0; i < 3; i++) {
        double scale = 1.0 + sign[i] * doubt;
        double y[N] = {x[0], x[1], scale * x[2], scale * x[3]};
        if (!mk_roa_leads_in(&b->roa, y, param(b, ctrl, MK_BALANCE_LEVEL),
                             param(b, ctrl, MK_BALANCE_HORIZON),
                             1.0 - param(b, ctrl, MK_BALANCE_RESERVE)))
            return false;
    }
    return true;
}

static bool may_take_over(const struct mk_balance *b, const struct mk_ctrl *ctrl, const double *x)
{
    int guard = (int)lround(param(b, ctrl, MK_BALANCE_GUARD));
    if (guard != MK_GUARD_ROA && !b->in_box(ctrl, x))
        return false;
    return guard == MK_GUARD_BOX || in_region(b, ctrl, x);
}

enum mk_phase mk_balance_phase(const struct mk_balance *b, const struct mk_ctrl *ctrl,
                               enum mk_phase phase, const double *x)
{
    if (phase == MK_PHASE_BALANCE)
        return lost(b, x) ? MK_PHASE_SWINGUP : MK_PHASE_BALANCE;
    return !lost(b, x) && may_take_over(b, ctrl, x) ? MK_PHASE_BALANCE : MK_PHASE_SWINGUP;
}

/* Accelerations at rest. */
static void rest_acceleration(const struct mk_model *world, const double *q, double u, double *a)
{
    static const double still[MK_MAX_JOINTS];
    double x[MK_MAX_STATES], dx[MK_MAX_STATES], input[MK_MAX_INPUTS] = {u, 0.0};
    mk_model_initial_state(world, q, still, x);
    mk_model_rhs(world, 0.0, x, input, dx);
    memcpy(a, dx + MK_MAX_JOINTS, MK_MAX_JOINTS * sizeof *a);
}

/* x' = A x + B u of the law's world about where it stands, by differences of what it accelerates by
 * at rest: dv'/dq and dv'/du. What goes with the speeds is left out, as the plant's friction is.
 * False when it stands nowhere near. */
static bool linearise_world(const struct mk_model *world, const double *nominal, double *a,
                            double *b)
{
    const double h = 1e-5, step_u = 1e-3 * world->u_max;
    double q[MK_MAX_JOINTS], u, above[MK_MAX_JOINTS], below[MK_MAX_JOINTS];
    if (!mk_nearest_equilibrium(world, nominal, true, q, &u))
        return false;
    memset(a, 0, N * N * sizeof *a);
    for (int k = 0; k < MK_MAX_JOINTS; k++) {
        double at = q[k];
        q[k] = at + h;
        rest_acceleration(world, q, u, above);
        q[k] = at - h;
        rest_acceleration(world, q, u, below);
        q[k] = at;
        a[N * k + MK_MAX_JOINTS + k] = 1.0;
        for (int j = 0; j < MK_MAX_JOINTS; j++)
            a[N * (MK_MAX_JOINTS + j) + k] = (above[j] - below[j]) / (2.0 * h);
    }
    rest_acceleration(world, q, u + step_u, above);
    rest_acceleration(world, q, u - step_u, below);
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        b[j] = 0.0;
        b[MK_MAX_JOINTS + j] = (above[j] - below[j]) / (2.0 * step_u);
    }
    return true;
}

enum mk_status mk_balance_design(const struct mk_ctrl *ctrl, const double *equilibrium,
                                 const double *weight, double r, double *k, double *p,
                                 struct mk_error *err)
{
    double a[N * N], b[N], q[N * N] = {0.0};
    struct mk_model world;
    for (int i = 0; i < N; i++)
        q[N * i + i] = weight[i];
    /* In shares of the command's limit, so that a model in N m gets the same design. */
    double share = USUAL_LIMIT / ctrl->model.u_max;
    r *= share * share;
    mk_remaining_model(&ctrl->model, &world);
    if (world.effect_count > 0 && linearise_world(&world, equilibrium, a, b) &&
        mk_design_lqrd(N, a, b, q, r, ctrl->dt, 0, k, p, NULL) == MK_OK)
        return MK_OK;
    mk_plant_linearise(&ctrl->model, equilibrium, false, a, b);
    return mk_design_lqrd(N, a, b, q, r, ctrl->dt, 0, k, p, err);
}
