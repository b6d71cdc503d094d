/* Energy that a rig has beside the textbook plant's: a spring or a cable at the free joint, a
 * weight, a tilted base take and give energy that a swing-up by energy has to count.
 *
 * With the driven joint where the setup wants it and everything at rest, what remains in the
 * nominal model (mk_remaining_model) puts a torque tau(q) on the free joint; its potential is
 * U(q) = - integral of tau dq. A link hangs between two uprights, and these may lie at different
 * heights: a cable is wound up one way. A swing-up aims at the lower one, which is reached first
 * with an energy that is the same on either side of hanging; there energy counts from. Of a turn in
 * which nothing can be held the height is that of the next one towards the middle: the swing-up
 * lets go of what is too much for that one and comes back.
 *
 * A joint angle counts from the driven link. Where that swings, too, U is of the angle that there
 * will be when it is back: what it winds up on its way it unwinds, and the link keeps nothing of
 * it. */
#ifndef MECHKIT_CTRL_LIFT_H
#define MECHKIT_CTRL_LIFT_H

#include "ctrl/equilibrium.h"

#define MK_LIFT_PER_TURN 64

struct mk_lift {
    int free_joint; /* 0-based; -1: there is nothing to count */
    double first;   /* rad: angle of potential[0] */
    double potential[MK_WINDINGS * MK_LIFT_PER_TURN + 1]; /* half a turn beyond the last upright */
    double angle[MK_WINDINGS];   /* rad: of the joint in the equilibrium of a turn, rising */
    double upright[MK_WINDINGS]; /* energy of the equilibrium of a turn, above the textbook one's */
    double weight;               /* m g l of the free link: half of what lies between up and down */
};

/* `remaining` without effects gives one that is 0 everywhere. */
void mk_lift_find(const struct mk_model *remaining, const double *nominal,
                  const struct mk_equilibria *equilibria, struct mk_lift *out);
/* To be added to the textbook plant's energy at joint angles q, in units of the command times rad,
 * or in shares of m g l. RT. */
double mk_lift_energy(const struct mk_lift *lift, const double *q);
double mk_lift_share(const struct mk_lift *lift, const double *q);

#endif
