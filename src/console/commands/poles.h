/* Where the gains of a setup put the poles of the loop that it closes. */
#ifndef MECHKIT_CONSOLE_COMMANDS_POLES_H
#define MECHKIT_CONSOLE_COMMANDS_POLES_H

#include <stdbool.h>

#include "mechkit/ctrl.h"

#define POLES_MAX 4

struct poles {
    int n; /* 0: not known for this setup */
    /* Rates of the sampled loop with the command acting a sample late, 1/s, slowest first:
     * ln(z)/dt; the pole of the delay itself is left out while it is the fastest. */
    double re[POLES_MAX], im[POLES_MAX];
    bool stable;
    char at[16]; /* the equilibrium */
};

/* Of the nominal model without friction, with these values of the setup's parameters. */
void poles_of_setup(const struct mk_ctrl_ops *setup, const struct mk_model *nominal, double dt,
                    const double *value, struct poles *out);

#endif
