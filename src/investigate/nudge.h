/* A rig looked at from outside, before any controller drives it: its joints watched sample by
 * sample, and what two short pushes of the motor say about its wiring. Works on the board interface
 * and the board's clock alone. Motions are since the watch began; those of a joint that slides are
 * in units of mk_model_joint_scale. */
#ifndef MECHKIT_INVESTIGATE_NUDGE_H
#define MECHKIT_INVESTIGATE_NUDGE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mechkit/board.h"

#define RIG_WATCH_RATE_HZ 500.0

struct rig_watch {
    struct mk_board *board;
    struct mk_clock *clock;
    int joints, bits;
    double count[MK_MAX_JOINTS]; /* its size */
    int32_t raw[MK_MAX_JOINTS];
    double q[MK_MAX_JOINTS];
    double u; /* applied */
    int64_t next_ns;
    bool primed;
    int asked, lost; /* exchanges; of them those without an answer in time */
};

void rig_watch_begin(struct rig_watch *w, struct mk_board *board, const struct mk_model *model);
/* One sample under the command u. False: the board is of no more use. */
bool rig_watch_step(struct rig_watch *w, double u);

/* Motor off, watchdog off. */
void rig_motor_off(struct mk_board *board);
/* What the model's own rig would do: a virtual board in simulated time. NULL: none can be made. */
struct mk_board *rig_model_board(const struct mk_model *model, struct mk_clock *clock);

/* How a rig would answer that is wired in another way. */
struct rig_wiring {
    bool swapped; /* the encoders */
    int sign[MK_MAX_JOINTS];
};

#define RIG_PUSH_SHARE 0.3 /* of the command's limit */
#define RIG_MISFIT 0.8     /* beyond it no wiring explains the answer */

struct rig_nudge {
    double moved[MK_MAX_JOINTS];    /* half the difference of the two pushes */
    double expected[MK_MAX_JOINTS]; /* of the model */
    double misfit;                  /* of the best wiring, relative, 0 .. 2 */
    struct rig_wiring wiring;
};

/* Two short pushes of 30 % of the command's limit, one each way, 3 s apart. False: cancelled (NULL:
 * never), or the board tripped. The motor is off afterwards. */
bool rig_nudge(struct mk_board *board, const struct mk_model *model, const volatile int *cancel,
               struct rig_nudge *out);
/* What joints moved by, each in its unit: "+0.0154 m and -0.0300 rad". */
#define RIG_MOTION_TEXT 80
const char *rig_motion_text(const struct mk_model *model, const double moved[MK_MAX_JOINTS],
                            char *buf, size_t size);
/* The wiring is as the model has it. */
bool rig_nudge_is_well(const struct rig_nudge *n);

#endif
