/* Feed-forward from the effects of the nominal model: a controller's law is written for the
 * textbook plant, and this makes the rig look like one.
 *
 * Around each step of the law
 *  - readings are corrected for what the model says about the encoders;
 *  - the command in force is told as the one that would do the same to the law's world, so that
 *    the law's own observer predicts what happens;
 *  - the law's wish becomes the command that accelerates the motor joint of the full model as the
 *    wish would accelerate that of the law's world.
 *
 * What is made up for: effects that a command can cancel (the table in compensate.c), where they
 * leave the other joint's equation alone. The law's world is the textbook plant with what remains:
 * a tilted base, a cable or a spring at the free joint. Balancing setups hold the equilibrium of
 * that world and predict with it (balance.h). The laws of effects stand in src/model, not here:
 * all of this evaluates the model. After creation everything is RT.
 */
#ifndef MECHKIT_CTRL_COMPENSATE_H
#define MECHKIT_CTRL_COMPENSATE_H

#include "ctrl/observer.h"
#include "mechkit/ctrl.h"

/* Row of a setup's table; a setup without it gets no feed-forward. 0 switches all of it off, but
 * for gains that were designed for what is believed. */
#define MK_COMPENSATE_ROW                                                                          \
    "compensate", "", "share of the believed model's effects made up for by feed-forward", 0.0,    \
        1.0, 1.0, false

struct mk_compensator {
    struct mk_model plant;   /* the law's world: base parameters and what remains */
    struct mk_model full;    /* and the effects that a command can make up for */
    struct mk_model nominal; /* all of it, for the readings */
    double dt;
    bool corrects_readings;

    struct mk_observer observer;  /* of the law's world */
    double ahead[MK_CTRL_STATES]; /* the same when the next command will act */
    double effect[MK_MAX_STATES]; /* states of `full`, of which those of the joints are scratch */
    double last_q[MK_MAX_JOINTS];
};

/* *out is NULL when the nominal model has nothing to make up for. */
MK_NODISCARD enum mk_status mk_compensator_create(const struct mk_model *nominal, double dt,
                                                  struct mk_compensator **out,
                                                  struct mk_error *err);
void mk_compensator_destroy(struct mk_compensator *c);

void mk_compensator_reset(struct mk_compensator *c);
/* What the law is to see of `in`; and from its wish, *out, the command. RT. */
void mk_compensator_before(struct mk_compensator *c, const struct mk_ctrl_input *in,
                           struct mk_ctrl_input *seen);
void mk_compensator_after(struct mk_compensator *c, const struct mk_ctrl_input *in, double share,
                          struct mk_ctrl_output *out);

/* The parts ----------------------------------------------------------------------------------- */

/* The effects of `nominal` that a command can make up for, on its base parameters. */
void mk_compensated_model(const struct mk_model *nominal, struct mk_model *out);

/* What else of it the law can know beforehand, on its base parameters: torques and the frame that
 * they act in, but nothing with a memory. It is the world that the law predicts with. */
void mk_remaining_model(const struct mk_model *nominal, struct mk_model *out);

/* Command under which the motor joint of `full` accelerates in state x as that of `plant` does
 * under `wish`; the limit where that takes more than there is. At most MK_COMPENSATE_EVALUATIONS of
 * the model. RT. */
#define MK_COMPENSATE_EVALUATIONS 52
double mk_compensate(const struct mk_model *full, const struct mk_model *plant, double t,
                     const double *x, double wish);

#endif
