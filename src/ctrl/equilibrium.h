/* Equilibria of a whole model, effects included. */
#ifndef MECHKIT_CTRL_EQUILIBRIUM_H
#define MECHKIT_CTRL_EQUILIBRIUM_H

#include <stdbool.h>

#include "mechkit/model.h"

/* Where the model stands still near `nominal`, and the command *u that holds it; with the motor off
 * (*u = 0) unless `driven`. Of the many that a command makes, the one that steps of Newton's method
 * lead to, each the shortest in rad and shares of the command's limit. False when there is
 * none near by (0.6 rad, and that share of the command): then *q is `nominal`, *u is 0. Effects
 * with a memory are at rest. Allocates nothing; takes some hundred evaluations of the model. */
bool mk_nearest_equilibrium(const struct mk_model *model, const double *nominal, bool driven,
                            double *q, double *u);

#endif
