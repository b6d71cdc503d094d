/* Who looks after the motor when the screen cannot: signals, a terminal that stands still, a crash.
 * A thread of its own takes all signals that would end or stop the program. */
#ifndef MECHKIT_CONSOLE_COMMANDS_GUARD_H
#define MECHKIT_CONSOLE_COMMANDS_GUARD_H

#include <stdbool.h>

#include "mechkit/status.h"

struct host;

/* A screen that has not said anything for so long has let go of the motor. */
#define GUARD_PATIENCE_S 3.0

/* Before any other thread is created: the signals are the guard's from here on. */
void guard_take_signals(void);
/* Looks after `host` until guard_stop. `restore` gives the terminal back (async-signal-safe). One a
 * process. MK_ERR_NOMEM. */
MK_NODISCARD enum mk_status guard_start(struct host *host, void (*restore)(void),
                                        struct mk_error *err);
void guard_stop(void);

/* The screen is alive: at every picture. */
void guard_beat(void);
/* A signal that ends the program has come (its name), or NULL. */
const char *guard_wants_end(void);
/* SIGTSTP has come since the last question. */
bool guard_wants_stop(void);
/* The program is about to end by a crash: other threads have a moment left. */
bool guard_crashed(void);

#endif
