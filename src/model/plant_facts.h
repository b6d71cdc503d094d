/* What other folders ask of a plant beside its row: answered by the plant's own file
 * (plant_<name>.hpp). Private to src/. All of it is RT-safe. */
#ifndef MECHKIT_MODEL_PLANT_FACTS_H
#define MECHKIT_MODEL_PLANT_FACTS_H

#include "mechkit/model.h"

#ifdef __cplusplus
extern "C" {
#endif

/* About what a force at `joint` (0-based) has to move, for starting values. */
double mk_plant_body_inertia(const struct mk_model *model, int joint);

/* The free link as a pendulum on a pivot that the motor moves. */
struct mk_free_link {
    double energy;   /* in m g l; 0 upright and at rest, -2 hanging */
    double speed;    /* absolute, over the frequency of small swings */
    double coupling; /* with the acceleration of the motor joint, -1 .. 1 */
};
/* In state x (joint order); false where the motor moves no pivot of a free link. */
bool mk_plant_free_link(const struct mk_model *model, const double *x, struct mk_free_link *out);

/* A plant that swings freely: `moment` is m g l, `inertia` what its frequency gives with it. */
struct mk_free_swing {
    double moment, inertia;
    double carried;   /* part of the inertia that friction holds to the pendulum: no parameter[0] */
    int locked_joint; /* 0-based joint that must stand still for that; -1: none */
    const char *name; /* of the inertia, in base parameters: "p1 + p2" */
};
bool mk_plant_free_swing(const struct mk_model *model, struct mk_free_swing *out);

/* A plant as a stick figure, seen from the front. Strokes follow one another: each begins where the
 * one before ended. Lengths are in units in which the rig is about 2 high; angles in rad from the
 * downward vertical, counter-clockwise. */
enum mk_stroke_kind {
    MK_STROKE_GROUND,   /* the mark of what stands still */
    MK_STROKE_LINK,     /* a wide hollow link */
    MK_STROKE_ROD,      /* a thin link */
    MK_STROKE_WHEEL,    /* of radius `length`, with a spoke; ends where it began */
    MK_STROKE_DIAL,     /* an arm that turns level, from above, beside the figure; ends there too */
    MK_STROKE_CARRIAGE, /* on a track, `length` to the right */
};
struct mk_stroke {
    enum mk_stroke_kind kind;
    int joint; /* 0-based, whose body it is */
    double angle, length;
};
#define MK_SKETCH_MAX 4
/* The strokes at joint angles q; returns how many. */
int mk_plant_sketch(enum mk_plant_kind kind, const double *q, struct mk_stroke *out);

#ifdef __cplusplus
}
#endif
#endif
