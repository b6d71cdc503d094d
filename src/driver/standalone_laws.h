/* The laws that the board's own controllers follow, one a setup of the original kit. Gains and
 * their order: docs/protocol.md. */
#ifndef MECHKIT_DRIVER_STANDALONE_LAWS_H
#define MECHKIT_DRIVER_STANDALONE_LAWS_H

#include "driver/standalone.h"

struct mk_law {
    int gains;
    float initial[MK_STANDALONE_GAINS]; /* for the kit's rigs */
    bool wheel[MK_WIRE_JOINTS];         /* turns as far as it likes */
    /* One sample, from s->angle and s->speed; sets s->phase. Returns the command wished for. */
    float (*step)(struct mk_standalone *s);
};

extern const struct mk_law *const mk_laws[MK_CONTROLLER_COUNT]; /* NULL where there is none */

#endif
