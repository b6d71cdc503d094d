#include "ctrl/equilibrium.h"

#include <math.h>
#include <string.h>

#define STEPS 40
#define FARTHEST 0.6 /* rad, and share of the limit: beyond, nothing is near by any more */
#define RIDGE 1e-8   /* more than differences are wrong by */
#define UNKNOWNS (MK_MAX_JOINTS + 1) /* angles, then the command in shares of its limit */

struct search {
    const struct mk_model *model;
    int n;       /* joints */
    bool driven; /* may there be a command? */
};

/* Accelerations at rest. */
static void rest_acceleration(const struct search *s, const double *y, double *a)
{
    static const double still[MK_MAX_JOINTS];
    double x[MK_MAX_STATES], dx[MK_MAX_STATES];
    double u[MK_MAX_INPUTS] = {s->driven ? y[s->n] * s->model->u_max : 0.0, 0.0};
    mk_model_initial_state(s->model, y, still, x);
    mk_model_rhs(s->model, 0.0, x, u, dx);
    memcpy(a, dx + s->n, (size_t)s->n * sizeof *a);
}

static void jacobian_at(const struct search *s, const double *y,
                        double jacobian[MK_MAX_JOINTS][UNKNOWNS])
{
    const double h = 1e-6;
    for (int k = 0; k <= s->n; k++) {
        double z[UNKNOWNS], above[MK_MAX_JOINTS], below[MK_MAX_JOINTS];
        memcpy(z, y, sizeof z);
        z[k] = y[k] + h;
        rest_acceleration(s, z, above);
        z[k] = y[k] - h;
        rest_acceleration(s, z, below);
        for (int j = 0; j < s->n; j++)
            jacobian[j][k] = (above[j] - below[j]) / (2.0 * h);
    }
}

/* Of all d with J d = b the shortest, J' (J J')^-1 b; rows of length 1. The little that is added to
 * the diagonal passes over directions that change nothing: a wheel may stand at any angle. */
static void shortest(int n, double jacobian[MK_MAX_JOINTS][UNKNOWNS], const double *b, double *d)
{
    double g[MK_MAX_JOINTS][MK_MAX_JOINTS] = {{RIDGE, 0.0}, {0.0, n > 1 ? RIDGE : 1.0}};
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            for (int k = 0; k <= n; k++)
                g[i][j] += jacobian[i][k] * jacobian[j][k];
    double det = g[0][0] * g[1][1] - g[0][1] * g[1][0], second = n > 1 ? b[1] : 0.0;
    double w[MK_MAX_JOINTS] = {(g[1][1] * b[0] - g[0][1] * second) / det,
                               (g[0][0] * second - g[1][0] * b[0]) / det};
    for (int k = 0; k <= n; k++) {
        d[k] = 0.0;
        for (int i = 0; i < n; i++)
            d[k] += jacobian[i][k] * w[i];
    }
}

/* One step of Newton's method at nominal + d, the shortest there is. Returns how far off it was
 * before, in rad. */
static double improve(const struct search *s, const double *nominal, double *d)
{
    double y[UNKNOWNS], a[MK_MAX_JOINTS], b[MK_MAX_JOINTS], jacobian[MK_MAX_JOINTS][UNKNOWNS];
    double step[UNKNOWNS], off = 0.0;
    for (int k = 0; k <= s->n; k++)
        y[k] = d[k] + (k < s->n ? nominal[k] : 0.0);
    rest_acceleration(s, y, a);
    jacobian_at(s, y, jacobian);
    for (int j = 0; j < s->n; j++) {
        double length = 1e-300;
        for (int k = 0; k <= s->n; k++)
            length = hypot(length, jacobian[j][k]);
        b[j] = -a[j] / length;
        off = fmax(off, fabs(b[j]));
        for (int k = 0; k <= s->n; k++)
            jacobian[j][k] /= length;
    }
    shortest(s->n, jacobian, b, step);
    for (int k = 0; k <= s->n; k++)
        d[k] += step[k];
    return off;
}

bool mk_nearest_equilibrium(const struct mk_model *model, const double *nominal, bool driven,
                            double *q, double *u)
{
    struct search s = {model, mk_model_joints(model), driven};
    double d[UNKNOWNS] = {0.0}, off = INFINITY;
    for (int i = 0; i < STEPS && off > 1e-13; i++)
        off = improve(&s, nominal, d);
    bool found = off <= 1e-8;
    for (int k = 0; k <= s.n; k++)
        found = found && fabs(d[k]) < FARTHEST;
    for (int j = 0; j < s.n; j++)
        q[j] = nominal[j] + (found ? d[j] : 0.0);
    *u = found && driven ? d[s.n] * model->u_max : 0.0;
    return found;
}

static struct mk_standing one_of(const struct mk_model *model, const double *nominal)
{
    double q[MK_MAX_JOINTS];
    struct mk_standing e = {{0.0, 0.0}, 0.0, false, 0.0};
    e.found = mk_nearest_equilibrium(model, nominal, true, q, &e.u);
    for (int j = 0; j < mk_model_joints(model); j++)
        e.shift[j] = q[j] - nominal[j];
    e.level = e.found ? 1.0 : 0.0;
    return e;
}

void mk_equilibria_find(const struct mk_model *model, const double *nominal,
                        struct mk_equilibria *out)
{
    memset(out, 0, sizeof *out);
    out->free_joint = mk_model_joints(model) > 1 ? 1 - mk_plant(model->plant)->motor_joint : -1;
    for (int k = 0; k < MK_WINDINGS; k++) {
        double at[MK_MAX_JOINTS];
        memcpy(at, nominal, sizeof at);
        if (out->free_joint >= 0)
            at[out->free_joint] += 2.0 * M_PI * (k - MK_WINDINGS / 2);
        out->winding[k] = one_of(model, at);
    }
    out->upright = out->free_joint >= 0 ? nominal[out->free_joint] : 0.0;
}

const struct mk_standing *mk_equilibria_at(const struct mk_equilibria *e, const double *q)
{
    if (e->free_joint < 0)
        return &e->winding[MK_WINDINGS / 2];
    double turns = round((q[e->free_joint] - e->upright) / (2.0 * M_PI));
    if (!isfinite(turns))
        return &e->nowhere;
    turns = fmax(-MK_WINDINGS / 2, fmin(turns, MK_WINDINGS / 2));
    return &e->winding[(int)turns + MK_WINDINGS / 2];
}
