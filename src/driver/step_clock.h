/* The clock of a simulated board that a host may step (STEP in docs/protocol.md): the machine's
 * monotonic clock, until it is held; held, it stands and moves only to what is waited for. It never
 * goes back. */
#ifndef MECHKIT_DRIVER_STEP_CLOCK_H
#define MECHKIT_DRIVER_STEP_CLOCK_H

#include "mechkit/clock.h"

struct mk_step_clock {
    struct mk_clock clock; /* first; now_ns: where it is held */
    bool held;
    int64_t behind_ns; /* the machine's clock minus this one, while it runs */
};

void mk_step_clock_init(struct mk_step_clock *c);
void mk_step_clock_hold(struct mk_step_clock *c, bool held);

#endif
