/* Safety limits. Each check is a few comparisons on the newest sample, cheap enough to run all of
 * them every tick; the first fault is latched and later ones do not overwrite its cause. */
#include "mechkit/safety.h"

#include <math.h>
#include <string.h>

#define TURN_RAD (2.0 * 3.14159265358979323846)

/* How far the motor joint goes before its direction counts: far enough to be out of noise and play,
 * near enough that gravity cannot yet outweigh runaway_u. */
#define RUNAWAY_TRAVEL_RAD 0.05

/* A joint that must have gone so far while no count came from it has an encoder that is dead. */
#define STILL_WAY_RAD 0.02
#define STILL_WAY_COUNTS 3.0

const char *mk_fault_name(enum mk_fault fault)
{
    switch (fault) {
#define FAULT_NAME(name, text, help)                                                               \
    case MK_FAULT_##name:                                                                          \
        return text;
        MK_FAULT_LIST(FAULT_NAME)
#undef FAULT_NAME
    case MK_FAULT_COUNT:
        break;
    }
    return "?";
}

const char *mk_fault_text(enum mk_fault fault)
{
    switch (fault) {
#define FAULT_TEXT(name, text, help)                                                               \
    case MK_FAULT_##name:                                                                          \
        return help;
        MK_FAULT_LIST(FAULT_TEXT)
#undef FAULT_TEXT
    case MK_FAULT_COUNT:
        break;
    }
    return "unknown fault";
}

void mk_safety_default(const struct mk_model *model, double dt, struct mk_safety_limits *out)
{
    const struct mk_plant_info *plant = mk_plant(model->plant);
    *out = (struct mk_safety_limits){.dt_s = dt,
                                     .stuck_s = 0.3,
                                     .stuck_u = 0.8 * model->u_max,
                                     .runaway_s = 0.003,
                                     .runaway_u = 0.1 * model->u_max,
                                     .model_share = 0.25,
                                     .model_reserve = 0.03 * model->u_max,
                                     .late_limit = 10,
                                     .lost_limit = 5,
                                     .stale_limit = 5};
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        bool there = j < plant->joints;
        bool either = there && plant->joint_motion[j] == MK_JOINT_EITHER;
        double size = there ? mk_model_joint_scale(model, j) : 1.0;
        double travel = there ? plant->joint_travel[j] : (double)INFINITY;
        double count = there ? mk_model_count(model, j) : 0.0;
        double speed = there ? plant->joint_speed[j] : 0.0;
        out->q_min[j] = plant->rest[j] - travel * (either ? size : 1.0);
        out->q_max[j] = plant->rest[j] + travel * (either ? size : 1.0);
        out->v_max[j] = speed * (either ? size : 1.0);
        out->jump_rad[j] = 1.25 * out->v_max[j] * dt + 4.0 * count;
        out->rest_tolerance[j] = plant->joint_is_level[j] ? (double)INFINITY : 0.1 * size;
        out->still_way[j] = fmax(STILL_WAY_RAD * size, STILL_WAY_COUNTS * count);
    }
}

void mk_safety_init(struct mk_safety *s, const struct mk_model *model,
                    const struct mk_safety_limits *limits)
{
    const struct mk_plant_info *plant = mk_plant(model->plant);
    memset(s, 0, sizeof *s);
    s->limits = *limits;
    s->joints = plant->joints;
    s->motor_joint = plant->motor_joint;
    memcpy(s->linear, model->joint_linear, sizeof s->linear);
    s->runaway_travel = RUNAWAY_TRAVEL_RAD * mk_model_joint_scale(model, plant->motor_joint);
}

void mk_safety_clear(struct mk_safety *s)
{
    struct mk_safety fresh = {.limits = s->limits,
                              .joints = s->joints,
                              .motor_joint = s->motor_joint,
                              .runaway_travel = s->runaway_travel};
    memcpy(fresh.linear, s->linear, sizeof fresh.linear);
    *s = fresh;
}

enum mk_fault mk_safety_latch(struct mk_safety *s, enum mk_fault fault, double t, int joint)
{
    if (s->fault == MK_FAULT_NONE && fault != MK_FAULT_NONE) {
        s->fault = fault;
        s->fault_t = t;
        s->fault_joint = joint;
    }
    return s->fault;
}

/* What one joint alone can do wrong. The jump comes first: it is also a wrong speed. */
static enum mk_fault check_joint(const struct mk_safety *s, int j, double dt, double q, double v)
{
    const struct mk_safety_limits *lim = &s->limits;
    double samples = dt > lim->dt_s && lim->dt_s > 0.0 ? dt / lim->dt_s : 1.0;
    if (s->primed && !(fabs(q - s->last_q[j]) <= lim->jump_rad[j] * samples))
        return MK_FAULT_JUMP;
    if (!(fabs(v) <= lim->v_max[j]))
        return MK_FAULT_SPEED;
    if (!(q >= lim->q_min[j] && q <= lim->q_max[j]))
        return MK_FAULT_TRAVEL;
    return MK_FAULT_NONE;
}

/* No count for a while under a hard command: a dead encoder, a loose coupling or a blocked joint;
 * all are reasons to stop. */
static bool check_stuck(struct mk_safety *s, double dt, double q)
{
    bool still = q == s->last_q[s->motor_joint];
    bool hard = fabs(s->last_u) >= s->limits.stuck_u;
    s->stuck_for = still && hard ? s->stuck_for + dt : 0.0;
    return s->stuck_for >= s->limits.stuck_s;
}

/* A motor or encoder wired the wrong way round shows in the first motion from rest: near the rest
 * nothing but the motor moves the joint, so it must leave in the direction of the command. Later on
 * gravity and the other link may well drive it against the command. */
static bool check_runaway(struct mk_safety *s, double dt, double q, double u)
{
    if (s->sign_known)
        return false;
    bool drives = fabs(s->last_u) >= s->limits.runaway_u;
    s->drive_for = drives ? s->drive_for + dt : 0.0;
    double moved = q - s->run_from;
    if (fabs(moved) > s->runaway_travel) {
        s->sign_known = true;
        return s->drive_for >= s->limits.runaway_s && moved * s->last_u < 0.0;
    }
    if (u * s->last_u < 0.0)
        s->drive_for = 0.0;
    return false;
}

enum mk_fault mk_safety_check(struct mk_safety *s, double t, double dt, const double *q,
                              const double *v, double u)
{
    for (int j = 0; j < s->joints; j++)
        mk_safety_latch(s, check_joint(s, j, dt, q[j], v[j]), t, j + 1);

    int m = s->motor_joint;
    if (!s->primed) {
        s->run_from = q[m];
    } else {
        if (check_stuck(s, dt, q[m]))
            mk_safety_latch(s, MK_FAULT_STUCK, t, m + 1);
        if (check_runaway(s, dt, q[m], u))
            mk_safety_latch(s, MK_FAULT_RUNAWAY, t, m + 1);
    }
    memcpy(s->last_q, q, (size_t)s->joints * sizeof *q);
    s->last_u = u;
    s->primed = true;
    return s->fault;
}

enum mk_fault mk_safety_timing(struct mk_safety *s, double t, bool late)
{
    s->late = mk_safety_level(s->late, late, MK_SAFETY_RISE_LATE);
    if (s->late >= s->limits.late_limit * MK_SAFETY_RISE_LATE)
        mk_safety_latch(s, MK_FAULT_OVERRUN, t, 0);
    return s->fault;
}

enum mk_fault mk_safety_link(struct mk_safety *s, double t, bool lost)
{
    s->lost = mk_safety_level(s->lost, lost, MK_SAFETY_RISE_LOST);
    if (s->lost >= s->limits.lost_limit * MK_SAFETY_RISE_LOST)
        mk_safety_latch(s, MK_FAULT_LINK, t, 0);
    return s->fault;
}

enum mk_fault mk_safety_check_rest(struct mk_safety *s, const double *q, const double *rest,
                                   const bool *is_wheel)
{
    for (int j = 0; j < s->joints; j++) {
        if (is_wheel[j])
            continue;
        /* Whole turns do not matter to a link that hangs. */
        double off = q[j] - rest[j];
        off = s->linear[j] ? off : remainder(off, TURN_RAD);
        if (!(fabs(off) <= s->limits.rest_tolerance[j]))
            mk_safety_latch(s, MK_FAULT_NOT_HANGING, 0.0, j + 1);
    }
    return s->fault;
}
