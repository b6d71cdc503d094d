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

/* The equilibria of a rig near a textbook one, by the turns that its free joint has made: a cable
 * there, or a wave of one turn that is read off an angle, pulls differently after a turn, and a
 * link that has been swung up to the left stands elsewhere than one that came from the right. */
#define MK_WINDINGS 7 /* three turns either way; those beyond are taken for the last */

struct mk_standing {
    double shift[MK_MAX_JOINTS]; /* rad: less the textbook one */
    double u;                    /* command that holds it */
    bool found;                  /* false: there is none near, and the other numbers are 0 */
    double level; /* of a region of attraction there, over that of the textbook one; 1 at first */
};

struct mk_equilibria {
    int free_joint; /* 0-based; -1: a rig without one, whose turns do not count */
    double upright; /* its angle in the textbook equilibrium */
    struct mk_standing winding[MK_WINDINGS], nowhere;
};

/* Those of `model` near `nominal`, by mk_nearest_equilibrium. */
void mk_equilibria_find(const struct mk_model *model, const double *nominal,
                        struct mk_equilibria *out);
/* The one of the turn in which joint angles q are. RT. */
const struct mk_standing *mk_equilibria_at(const struct mk_equilibria *e, const double *q);

#endif
