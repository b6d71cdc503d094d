/* Linearised rigs in the order in which the command `gains` takes its gains. */
#ifndef MECHKIT_EXPERIMENT_LINEAR_H
#define MECHKIT_EXPERIMENT_LINEAR_H

#include "mechkit/model.h"

#define LINEAR_STATES 4

/* State: q1 dq1 q2 dq2; a wheel's angle, which no law needs, is left out. */
struct linear {
    int n;
    double a[LINEAR_STATES * LINEAR_STATES], b[LINEAR_STATES];
    const char *state[LINEAR_STATES];
};

void linear_at(const struct mk_model *model, const double *q, bool friction, struct linear *out);
/* The setup that holds a rig at an equilibrium, and the equilibrium that a setup holds; NULL: none.
 */
const char *linear_setup(enum mk_plant_kind plant, const char *equilibrium);
const struct mk_equilibrium *linear_equilibrium(enum mk_plant_kind plant, const char *setup);

#endif
