#include "ctrl/lift.h"

#include <math.h>
#include <string.h>

#include "ctrl/ctrl_priv.h"
#include "model/plant_facts.h"

#define POINTS (MK_WINDINGS * MK_LIFT_PER_TURN + 1)
#define STEP (2.0 * M_PI / MK_LIFT_PER_TURN)

/* Torque at rest that the effects of `model` put on the free joint: D a + h of the plant, a what
 * the whole model accelerates by with the motor off. */
static double torque_at(const struct mk_model *model, const double *q, int joint)
{
    static const double still[MK_MAX_JOINTS];
    int n = mk_model_joints(model);
    double x[MK_MAX_STATES], dx[MK_MAX_STATES], tau[MK_MAX_JOINTS];
    double u[MK_MAX_INPUTS] = {0.0, 0.0};
    mk_model_initial_state(model, q, still, x);
    mk_model_rhs(model, 0.0, x, u, dx);
    mk_plant_inverse_dynamics(model, x, x + n, dx + n, tau);
    return tau[joint];
}

/* Energy at rest as the swing-ups count it: of the free link about its pivot, or of the rig. */
static double textbook_energy(const struct mk_model *model, const double *q, double weight)
{
    const double x[2 * MK_MAX_JOINTS] = {q[0], q[1], 0.0, 0.0};
    struct mk_free_link link;
    return mk_plant_free_link(model, x, &link) ? weight * link.energy
                                               : mk_plant_potential(model, q);
}

/* Trapezoids: U(k + 1) = U(k) - h (tau(k) + tau(k + 1)) / 2. */
static void integrate(const struct mk_model *model, const double *nominal, struct mk_lift *out)
{
    double q[MK_MAX_JOINTS], last = 0.0;
    memcpy(q, nominal, sizeof q);
    out->first = nominal[out->free_joint] - MK_WINDINGS * M_PI;
    out->potential[0] = 0.0;
    for (int k = 0; k < POINTS; k++) {
        q[out->free_joint] = out->first + STEP * k;
        double tau = torque_at(model, q, out->free_joint);
        if (k > 0)
            out->potential[k] = out->potential[k - 1] - 0.5 * STEP * (last + tau);
        last = tau;
    }
}

/* A joint beyond the turns that are known is taken to be in the last of them. */
static double within(const struct mk_lift *lift, double q)
{
    double turns = (q - lift->first) / (2.0 * M_PI);
    if (turns < 0.0)
        return q - 2.0 * M_PI * floor(turns);
    return turns < MK_WINDINGS ? q : q - 2.0 * M_PI * (floor(turns) - (MK_WINDINGS - 1));
}

static double potential_at(const struct mk_lift *lift, double q)
{
    double place = mk_clamp((q - lift->first) / STEP, 0.0, POINTS - 1.0);
    int k = (int)fmin(floor(place), POINTS - 2.0);
    return lift->potential[k] + (place - k) * (lift->potential[k + 1] - lift->potential[k]);
}

/* Of the two uprights between which the joint hangs the energy of the lower one, which a link that
 * swings between them reaches first; beyond the last, its own. */
static double aim_at(const struct mk_lift *lift, double q)
{
    int above = 0;
    while (above < MK_WINDINGS && q >= lift->angle[above])
        above++;
    double left = lift->upright[above > 0 ? above - 1 : 0];
    double right = lift->upright[above < MK_WINDINGS ? above : MK_WINDINGS - 1];
    return fmin(left, right);
}

void mk_lift_find(const struct mk_model *remaining, const double *nominal,
                  const struct mk_equilibria *equilibria, struct mk_lift *out)
{
    memset(out, 0, sizeof *out);
    out->free_joint = -1;
    if (remaining->effect_count == 0 || equilibria->free_joint < 0)
        return;
    const int f = out->free_joint = equilibria->free_joint;
    double below[MK_MAX_JOINTS], q[MK_MAX_JOINTS];
    memcpy(below, nominal, sizeof below);
    below[f] += M_PI;
    out->weight =
        0.5 * (mk_plant_potential(remaining, nominal) - mk_plant_potential(remaining, below));
    integrate(remaining, nominal, out);
    double base = textbook_energy(remaining, nominal, out->weight);
    for (int k = 0; k < MK_WINDINGS; k++) {
        for (int j = 0; j < MK_MAX_JOINTS; j++)
            q[j] = nominal[j] + equilibria->winding[k].shift[j];
        q[f] += 2.0 * M_PI * (k - MK_WINDINGS / 2);
        out->angle[k] = q[f];
        out->upright[k] =
            textbook_energy(remaining, q, out->weight) - base + potential_at(out, q[f]);
    }
    for (int k = MK_WINDINGS / 2 + 1; k < MK_WINDINGS; k++) { /* outwards, both ways */
        const int l = MK_WINDINGS - 1 - k;
        if (!equilibria->winding[k].found)
            out->upright[k] = out->upright[k - 1];
        if (!equilibria->winding[l].found)
            out->upright[l] = out->upright[l + 1];
    }
}

double mk_lift_energy(const struct mk_lift *lift, const double *q)
{
    if (lift->free_joint < 0 || !isfinite(q[lift->free_joint]))
        return 0.0;
    double angle = within(lift, q[lift->free_joint]);
    return potential_at(lift, angle) - aim_at(lift, angle);
}

double mk_lift_share(const struct mk_lift *lift, const double *q)
{
    return lift->free_joint < 0 ? 0.0 : mk_lift_energy(lift, q) / lift->weight;
}
