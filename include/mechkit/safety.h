/* Safety limits and faults of a run. A fault zeroes the motor, is latched with its cause and time,
 * and survives until it is acknowledged. Caller's memory; everything RT-safe. */
#ifndef MECHKIT_SAFETY_H
#define MECHKIT_SAFETY_H

#include <stdbool.h>
#include <stdint.h>

#include "mechkit/model.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

#define MK_FAULT_LIST(X)                                                                           \
    X(NONE, "none", "no fault")                                                                    \
    X(TRAVEL, "travel", "a joint left its travel limits")                                          \
    X(SPEED, "speed", "a joint moved faster than its limit")                                       \
    X(JUMP, "encoder-jump", "an encoder jumped further than a joint can move in a sample")         \
    X(STUCK, "encoder-stuck", "an encoder stands still although its joint must move")              \
    X(RUNAWAY, "runaway", "the motor joint runs away against the sign of the command")             \
    X(DRIVEN, "driven", "the motor joint gains speed that its command does not give it")           \
    X(COMMAND, "command", "the controller returned a command that is not a number")                \
    X(OVERRUN, "overrun", "too many samples came late")                                            \
    X(LINK, "link", "too many exchanges with the board failed")                                    \
    X(UNPLUGGED, "unplugged", "the board is gone, or has restarted")                               \
    X(WATCHDOG, "watchdog", "the board's watchdog fired")                                          \
    X(BOARD, "board", "the board reports a fault")                                                 \
    X(DISOBEYED, "disobeyed",                                                                      \
      "the board drives the motor otherwise than it was told, or by a controller of its own")      \
    X(STALE, "stale", "the board's exchange numbers or its clock do not go on as they must")       \
    X(LOG, "log", "the log cannot be written")                                                     \
    X(NOT_HANGING, "not-hanging", "the links do not hang straight down")                           \
    X(ESTOP, "e-stop", "stopped by the operator")

enum mk_fault {
#define MK_FAULT_ENUM(name, text, help) MK_FAULT_##name,
    MK_FAULT_LIST(MK_FAULT_ENUM)
#undef MK_FAULT_ENUM
        MK_FAULT_COUNT
};
const char *mk_fault_name(enum mk_fault fault); /* "encoder-jump" */
/* What the fault means, half a sentence for people. Static. */
const char *mk_fault_text(enum mk_fault fault);

struct mk_safety_limits {
    double dt_s;                                       /* sample time that the limits are for */
    double q_min[MK_MAX_JOINTS], q_max[MK_MAX_JOINTS]; /* rad; +-INFINITY: none */
    double v_max[MK_MAX_JOINTS];                       /* rad/s */
    double jump_rad[MK_MAX_JOINTS];                    /* largest believable change in dt_s */
    double stuck_s;                                    /* no count for so long .. */
    double stuck_u;   /* .. at |u| above this: stuck; motor joint only */
    double runaway_s; /* motor joint leaving its rest against u after so long .. */
    double runaway_u; /* .. of |u| above this with one sign */
    /* How far the nominal model may be off before a reading that contradicts it is a fault
     * (docs/safety.md); from a share of 1 on readings are not held against the model. */
    double model_share;              /* of every parameter */
    double model_reserve;            /* torque at every joint that it knows nothing of */
    double still_way[MK_MAX_JOINTS]; /* an unmoved joint that must have gone so far: STUCK */
    /* Late samples in a row that latch OVERRUN, failed exchanges in a row that latch LINK; and as
     * many that good ones do not make up for (mk_safety_level). */
    int late_limit, lost_limit;
    int stale_limit; /* readings in a row that do not go on: STALE, by such a level too */
    double
        rest_tolerance[MK_MAX_JOINTS]; /* pre-start: how far from hanging, rad (not for wheels) */
};
/* Limits that fit a rig at sample time dt. */
void mk_safety_default(const struct mk_model *model, double dt, struct mk_safety_limits *out);

struct mk_safety {
    struct mk_safety_limits limits;
    int joints, motor_joint;
    bool linear[MK_MAX_JOINTS]; /* its position is in m and has no turns */
    double runaway_travel;      /* of the motor joint, before its direction counts, in its unit */
    enum mk_fault fault;        /* latched */
    double fault_t;             /* s since start */
    int fault_joint;            /* 1-based; 0: none */
    double last_q[MK_MAX_JOINTS];
    double last_u;
    double stuck_for; /* s without a count under a hard command */
    double drive_for; /* s under a command of one sign */
    double run_from;  /* angle of the motor joint at its first sample, rad */
    bool sign_known;  /* the motor joint has left its rest: RUNAWAY is settled for this run */
    int late, lost;   /* levels */
    bool primed;
};

/* Begins without a fault and without history; the limits are copied. RT. */
void mk_safety_init(struct mk_safety *s, const struct mk_model *model,
                    const struct mk_safety_limits *limits);
/* Acknowledges: clears the fault and the history. */
void mk_safety_clear(struct mk_safety *s);
/* Latches `fault` unless one is latched already; returns the latched one. */
enum mk_fault mk_safety_latch(struct mk_safety *s, enum mk_fault fault, double t, int joint);
/* Looks at one good sample: angles, speeds, and the command in force from now on; `dt` is the time
 * since the last good one. TRAVEL, SPEED, JUMP, STUCK, RUNAWAY. Returns the latched fault. */
enum mk_fault mk_safety_check(struct mk_safety *s, double t, double dt, const double *q,
                              const double *v, double u);
/* A level that leaks: a bad sample raises it by `rise`, a good one lowers it by 1, not below 0. It
 * reaches limit * rise after `limit` bad ones in a row, and in the end wherever more than one in
 * 1 + rise is bad. */
#define MK_SAFETY_RISE_LATE 1 /* more than every second */
#define MK_SAFETY_RISE_LOST 4 /* more than every fifth */
static inline int mk_safety_level(int level, bool bad, int rise)
{
    if (bad)
        return level + rise;
    return level > 0 ? level - 1 : 0;
}
/* Whether the sample at time t (s) was late, by such a level: OVERRUN. Returns the latched fault.
 */
enum mk_fault mk_safety_timing(struct mk_safety *s, double t, bool late);
/* Whether the exchange at time t (s) failed, by such a level: LINK. Returns the latched fault. */
enum mk_fault mk_safety_link(struct mk_safety *s, double t, bool lost);
/* Before start: NOT_HANGING when a joint is away from rest; sets fault_joint. */
enum mk_fault mk_safety_check_rest(struct mk_safety *s, const double *q, const double *rest,
                                   const bool *is_wheel);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
