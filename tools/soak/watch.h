/* The soak's eyes: a back end that looks at every command on its way to the virtual board, and a
 * clock that jumps as a suspended machine's does. */
#ifndef MECHKIT_TOOLS_SOAK_WATCH_H
#define MECHKIT_TOOLS_SOAK_WATCH_H

#include <stdbool.h>

#include "console/script/session.h"

/* What must never be; the first one is kept. */
struct violation {
    char text[400];
    bool seen;
};
void violate(struct violation *v, const char *fmt, ...) MK_PRINTF(2, 3);

/* Puts the watching back end under a session that was just opened: one session at a time. */
void watch_session(struct session *s, struct violation *v);
/* Whether the board's motor may turn: commanded, and not made safe since. */
bool watch_motor_on(void);
/* The motor must be off unless the loop runs. */
void watch_check(struct session *s, struct violation *v, const char *when);

/* A session in real time from now on has a clock that can be stepped; after every `setup`. */
void watch_clock(struct session *s);
void watch_step_clock(double seconds);

#endif
