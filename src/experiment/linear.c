#include "experiment/linear.h"

#include <string.h>

/* mk_plant_linearise's order [q1 q2 dq1 dq2] to that of `gains`. The reaction wheel's law is on
 * absolute angles (report 2.3): its third state is dq1 + dq2. */
void linear_at(const struct mk_model *model, const double *q, bool friction, struct linear *out)
{
    static const char *const names[] = {"q1", "dq1", "q2", "dq2"};
    const struct mk_plant_info *plant = mk_plant(model->plant);
    int n = plant->joints, ns = 2 * n, order[LINEAR_STATES], count = 0;
    double a[LINEAR_STATES * LINEAR_STATES], b[LINEAR_STATES];
    mk_plant_linearise(model, q, friction, a, b);
    for (int j = 0; j < n; j++) {
        if (!plant->joint_is_wheel[j]) {
            out->state[count] = names[2 * j];
            order[count++] = j;
        }
        out->state[count] = names[2 * j + 1];
        order[count++] = n + j;
    }
    out->n = count;
    for (int i = 0; i < count; i++) {
        for (int j = 0; j < count; j++)
            out->a[i * count + j] = a[order[i] * ns + order[j]];
        out->b[i] = b[order[i]];
    }
    if (n != 2 || !plant->joint_is_wheel[1])
        return;
    /* z3 = x2 + x3: row 3 += row 2, then column 2 -= column 3. */
    out->state[2] = "dq1+dq2";
    for (int j = 0; j < 3; j++)
        out->a[6 + j] += out->a[3 + j];
    out->b[2] += out->b[1];
    for (int i = 0; i < 3; i++)
        out->a[i * 3 + 1] -= out->a[i * 3 + 2];
}

const char *linear_setup(enum mk_plant_kind kind, const char *equilibrium)
{
    const struct mk_plant_info *plant = mk_plant(kind);
    for (int k = 0; k < plant->equilibrium_count; k++)
        if (strcmp(plant->equilibrium[k].name, equilibrium) == 0)
            return plant->equilibrium[k].setup;
    return NULL;
}

const struct mk_equilibrium *linear_equilibrium(enum mk_plant_kind kind, const char *setup)
{
    const struct mk_plant_info *plant = mk_plant(kind);
    for (int k = 0; k < plant->equilibrium_count; k++)
        if (plant->equilibrium[k].setup && strcmp(plant->equilibrium[k].setup, setup) == 0)
            return &plant->equilibrium[k];
    return NULL;
}
