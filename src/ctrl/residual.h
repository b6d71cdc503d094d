/* Readings held against the nominal model: what one encoder says cannot be true if, of what the
 * others say and what the motor is told, the model says otherwise by more than it can be wrong.
 *
 *  - An encoder that stands still. As long as a reading does not change by a single count, its
 *    joint is taken at its word: it rests there. The model says how it would accelerate from rest
 *    under the command in force and the motion read from the other joint, and by how much that may
 *    be wrong: parameters, friction, the other joint's speed, torques that it knows nothing of.
 *    What is left of the acceleration beyond all of this is integrated twice. When the joint must
 *    have moved by many counts and has moved by none, its encoder is dead, its coupling loose, or
 *    the joint is blocked. A joint that was moving when its reading froze begins with the speed
 *    that it had.
 *  - All encoders that stand still at once, as when their common supply fails. Then no reading says
 *    that anything moves, and the rig is taken at its word: it is at rest. So gravity, friction and
 *    the command must be in balance in every equation of motion. A rig that is balanced with
 *    so little command that this says nothing is nudged.
 *  - A motor joint that something else drives: it gains speed that neither the command nor the
 *    model gives it.
 *  - An encoder that jumps. From one sample to the next a joint goes on at its speed, give or take
 *    what the motor, the model's error and the encoder's noise can change; where samples are
 *    lost on the way, which is when counts are lost too, for so much longer.
 *
 * Caller's memory; everything RT.
 */
#ifndef MECHKIT_CTRL_RESIDUAL_H
#define MECHKIT_CTRL_RESIDUAL_H

#include "mechkit/safety.h"

#define MK_RESIDUAL_PAST 6 /* readings of which a speed is the difference */

/* The least speed that a joint must have one way, and the least way that it must have gone. */
struct mk_residual_sure {
    double speed, way;
};

struct mk_residual_sway {
    struct mk_residual_sure sure[2]; /* up, down */
    double still_s;                  /* for how long no count has come */
    double other_v;                  /* the other joint's speed a sample ago */
    double mean_a;                   /* what is taken for constant */
    double speed, way;       /* that the joint must have, and must have gone, above the corner */
    double mean_way, square; /* of the way: mean, and mean square about it */
};

struct mk_residual_joint {
    double past[MK_RESIDUAL_PAST];   /* readings, the newest at [0], in the joint's unit */
    int known;                       /* of them */
    double speed_age;                /* of the speed that they show, in samples .. */
    int aged;                        /* .. for so many more of them */
    bool fresh;                      /* the newest reading differs from the one before */
    struct mk_residual_sure sure[2]; /* up, down */
    struct mk_residual_sway sway;
    double smooth_v; /* its speed, with the noise of counts that samples further apart have */
    double model_v;  /* the model's speed, the motor joint's */
    double noise2;   /* mean square of what the last readings do not lead to */
};

/* Readings of which none has changed. */
struct mk_residual_rest {
    struct mk_residual_sure row[MK_MAX_JOINTS][2]; /* of each equation of motion: up, down */
    double still_s;                                /* for how long, of a rig that is balanced */
    bool nudges; /* .. and the command that is given instead of the controller's */
    double nudge_u;
};

struct mk_residual {
    const struct mk_model *model; /* borrowed */
    const struct mk_safety_limits *limits;
    struct mk_model plant; /* the same without its effects */
    bool smooth;           /* none of them has states of its own */
    struct mk_residual_joint joint[MK_MAX_JOINTS];
    struct mk_residual_rest rest;
    bool balances;     /* the controller says that it holds an equilibrium; the caller's to say */
    double u;          /* in force since the last sample */
    double drives_for; /* s that the motor still counts as driving */
};

/* Keeps both pointers. */
void mk_residual_init(struct mk_residual *r, const struct mk_model *model,
                      const struct mk_safety_limits *limits);
/* Begins anew, as at the start of a run. */
void mk_residual_reset(struct mk_residual *r);
/* One good sample at `t`: readings, their speeds, and the command in force from now on; `dt` is the
 * time since the last good one. STUCK, JUMP or DRIVEN and its joint (1-based; 0: of all), or NONE.
 */
enum mk_fault mk_residual_step(struct mk_residual *r, double t, double dt, const double *q,
                               const double *v, double u, int *joint);
/* What to give the motor when the controller wants u: that, or a nudge. */
double mk_residual_command(const struct mk_residual *r, double u);

#endif
