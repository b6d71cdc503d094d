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

enum mk_status mk_balance_prepare(struct mk_balance *b, struct mk_ctrl *ctrl,
                                  const double *equilibrium, const double *p, mk_roa_law law,
                                  struct mk_error *err)
{
    ctrl->balances = true;
    memcpy(ctrl->equilibrium, equilibrium, sizeof ctrl->equilibrium);
    b->roa.model = &ctrl->model;
    b->roa.law = law;
    b->roa.user = ctrl;
    b->roa.dt = ctrl->dt;
    memcpy(b->roa.equilibrium, equilibrium, sizeof b->roa.equilibrium);
    memcpy(b->roa.limit, b->fallen, sizeof b->roa.limit);
    memcpy(b->roa.p, p, sizeof b->roa.p);
    ctrl->roa = &b->roa;
    return mk_roa_estimate(&b->roa, err);
}

void mk_balance_reset(struct mk_balance *b)
{
    mk_observer_reset(&b->observer);
}

void mk_balance_changed(struct mk_balance *b, const struct mk_ctrl *ctrl)
{
    mk_observer_init(&b->observer, &ctrl->model, ctrl->dt, param(b, ctrl, MK_BALANCE_OBSERVER));
}

bool mk_balance_observe(struct mk_balance *b, const struct mk_ctrl *ctrl,
                        const struct mk_ctrl_input *in, double *x)
{
    mk_observer_step(&b->observer, in, x);
    mk_ctrl_predict(&ctrl->model, x, in->u, ctrl->dt * param(b, ctrl, MK_BALANCE_LEAD));
    for (int i = 0; i < N; i++)
        if (!(fabs(x[i]) < 1e6)) {
            mk_observer_reset(&b->observer);
            return false;
        }
    return true;
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
 * that doubt a catch is made on the first tick that the believed model forgives, at the very edge.
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

enum mk_status mk_balance_design(const struct mk_ctrl *ctrl, const double *equilibrium,
                                 const double *weight, double r, double *k, double *p,
                                 struct mk_error *err)
{
    double a[N * N], b[N], q[N * N] = {0.0};
    mk_plant_linearise(&ctrl->model, equilibrium, false, a, b);
    for (int i = 0; i < N; i++)
        q[N * i + i] = weight[i];
    /* In shares of the command's limit, so that a model in N m gets the same design. */
    double share = USUAL_LIMIT / ctrl->model.u_max;
    return mk_design_lqrd(N, a, b, q, r * share * share, ctrl->dt, 0, k, p, err);
}
