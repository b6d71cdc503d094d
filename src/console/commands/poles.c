#include "console/commands/poles.h"

#include <complex.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "experiment/linear.h"
#include "mechkit/design.h"

#define N (LINEAR_STATES + 1) /* with the command of the sample before */

struct loop {
    int n;
    double a[LINEAR_STATES * LINEAR_STATES], b[LINEAR_STATES];
    double k[LINEAR_STATES];
};

/* The gains of a setup, in the order of `gains`. */
static void take_gains(const struct mk_ctrl_ops *setup, const double *value, struct loop *l)
{
    int n = 0;
    for (int i = 0; i < setup->param_count && n < LINEAR_STATES; i++)
        if (setup->param[i].gain)
            l->k[n++] = value[i];
}

static bool balancing_loop(const struct mk_ctrl_ops *setup, const struct mk_model *model,
                           const double *value, struct loop *l, struct poles *out)
{
    const struct mk_equilibrium *eq = linear_equilibrium(model->plant, setup->name);
    int designers = mk_ctrl_param_index(setup, "designers");
    if (!eq || (designers >= 0 && value[designers] > 0.5))
        return false; /* other gains are in force than those in the table */
    struct linear lin;
    linear_at(model, eq->q, false, &lin);
    l->n = lin.n;
    memcpy(l->a, lin.a, sizeof l->a);
    memcpy(l->b, lin.b, sizeof l->b);
    take_gains(setup, value, l);
    snprintf(out->at, sizeof out->at, "%s", eq->name);
    return true;
}

/* Speed and integral of its error: dv/dt = (u - p2 v)/p1, u = -kp v - ki s. */
static bool speed_loop(const struct mk_ctrl_ops *setup, const struct mk_model *model,
                       const double *value, struct loop *l, struct poles *out)
{
    if (strcmp(setup->name, "pi-speed") != 0)
        return false;
    *l = (struct loop){.n = 2,
                       .a = {-model->parameter[1] / model->parameter[0], 0.0, 1.0, 0.0},
                       .b = {1.0 / model->parameter[0], 0.0}};
    take_gains(setup, value, l);
    snprintf(out->at, sizeof out->at, "any speed");
    return true;
}

/* x+ = Ad x + Bd w, w+ = -K x: the command acts a sample late. */
static bool sampled_poles(const struct loop *l, double dt, double *re, double *im)
{
    double ad[LINEAR_STATES * LINEAR_STATES], bd[LINEAR_STATES], m[N * N] = {0}, none[N] = {0};
    int n = l->n, wide = n + 1;
    if (mk_design_c2d(n, l->a, l->b, dt, ad, bd, NULL) != MK_OK)
        return false;
    for (int i = 0; i < n; i++) {
        memcpy(&m[i * wide], &ad[i * n], sizeof *ad * (size_t)n);
        m[i * wide + n] = bd[i];
        m[n * wide + i] = -l->k[i];
    }
    return mk_design_poles(wide, m, none, NULL, re, im, NULL) == MK_OK;
}

static int by_speed(const void *a, const void *b)
{
    const double complex *x = a, *y = b;
    double dx = creal(*x), dy = creal(*y);
    if (dx != dy)
        return dx > dy ? -1 : 1;
    return cimag(*x) > cimag(*y) ? -1 : cimag(*x) < cimag(*y);
}

void poles_of_setup(const struct mk_ctrl_ops *setup, const struct mk_model *nominal, double dt,
                    const double *value, struct poles *out)
{
    struct loop l = {.n = 0};
    double re[N], im[N];
    memset(out, 0, sizeof *out);
    if (!balancing_loop(setup, nominal, value, &l, out) &&
        !speed_loop(setup, nominal, value, &l, out))
        return;
    if (!sampled_poles(&l, dt, re, im))
        return;
    double complex rate[N];
    for (int i = 0; i <= l.n; i++) {
        double complex z = CMPLX(re[i], im[i]);
        rate[i] = clog(cabs(z) > 1e-300 ? z : 1e-300) / dt;
    }
    qsort(rate, (size_t)l.n + 1, sizeof *rate, by_speed);
    out->n = l.n;
    /* The delay's own pole comes last, unless the gains have mixed it up with the others. */
    out->stable = true;
    for (int i = 0; i <= l.n; i++)
        out->stable = out->stable && creal(rate[i]) < 0.0;
    for (int i = 0; i < l.n; i++) {
        out->re[i] = creal(rate[i]);
        out->im[i] = cimag(rate[i]);
    }
}
