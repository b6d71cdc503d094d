/* Estimated region of attraction of a balancing law: the hand-over guard beside the report's box.
 *
 * The estimate is a level set { e : e' P e <= level } of the error e from the equilibrium. P comes
 * from the design (Riccati or Lyapunov); the level is calibrated when the controller is created, by
 * simulating the nominal model under the law with everything that makes the region small: the
 * limit of the command, friction, the one sample of delay. Directions are drawn from a fixed
 * sequence, so the level is the same each time.
 *
 * A level set is easily checked and easily trusted, but an ellipsoid is a poor fit of a region
 * that is long in the directions that fall towards the equilibrium. mk_roa_leads_in() enlarges it:
 * a state belongs to the region too if the nominal model, under the law, carries it into the level
 * set within the horizon.
 *
 * States in joint order [q1 q2 v1 v2]; a row of P that is zero leaves a coordinate out (the angle
 * of a wheel). Estimation allocates nothing but is not RT; the checks are.
 */
#ifndef MECHKIT_CTRL_ROA_H
#define MECHKIT_CTRL_ROA_H

#include <stdbool.h>

#include "ctrl/equilibrium.h"
#include "ctrl/observer.h"
#include "mechkit/model.h"
#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The command that the law asks for in state x (absolute), delay already made up for. */
typedef double (*mk_roa_law)(const void *user, const double *x);

struct mk_roa {
    const struct mk_model *model; /* believed; borrowed */
    mk_roa_law law;
    const void *user;                   /* of the law; borrowed */
    double dt;                          /* s */
    double equilibrium[MK_MAX_JOINTS];  /* of the textbook plant */
    const struct mk_equilibria *really; /* and what they are in `model`; NULL: the same; borrowed */
    double limit[MK_MAX_JOINTS]; /* rad: beyond this error a run counts as lost; 0: no limit */
    double p[MK_CTRL_STATES * MK_CTRL_STATES];
    double level; /* set by mk_roa_estimate */
};

/* Calibrates the level; everything else is filled in by the caller. MK_ERR_NUMERIC when P is not
 * positive or no level recovers. */
MK_NODISCARD enum mk_status mk_roa_estimate(struct mk_roa *roa, struct mk_error *err);

/* Command that holds the equilibrium where x is, for laws to add. */
double mk_roa_hold(const struct mk_roa *roa, const double *x);

/* Error of x from the equilibrium of the turn that it is in. The free joint may arrive turns away
 * and its angle is wrapped; the driven one carries a cable and its turns count. */
void mk_roa_error(const struct mk_roa *roa, const double *x, double *e);
double mk_roa_value(const struct mk_roa *roa, const double *e); /* e' P e */

/* Is x in the level set, shrunk to `share` of the level? */
bool mk_roa_holds(const struct mk_roa *roa, const double *x, double share);

/* Does the nominal model carry x into it within `horizon_s`, with no more than `u_share` of the
 * command? What is held back is for what the model does not know. */
bool mk_roa_leads_in(const struct mk_roa *roa, const double *x, double share, double horizon_s,
                     double u_share);

#ifdef __cplusplus
}
#endif
#endif
