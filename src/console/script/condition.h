/* Conditions on the state of a run, for `expect` and `wait-until`:
 *
 *     balanced             caught and held since at least half a second
 *     running, idle, faulted, no-fault, or a fault's name (e.g. encoder-jump)
 *     |q2| < 0.1           comparison of sums of names and numbers; |..| is the absolute value
 *     dq1 within 2% of 50  or: within 0.5 of ref
 *     A and B              all of them
 *
 * Names: t q1 q2 dq1 dq2 u ref late overruns lost ticks caught (time of the first catch). A name
 * without a value (ref of an open loop) makes a comparison false.
 */
#ifndef MECHKIT_CONSOLE_SCRIPT_CONDITION_H
#define MECHKIT_CONSOLE_SCRIPT_CONDITION_H

#include <stdbool.h>

#include "mechkit/loop.h"

/* Checks the text; MK_ERR_PARSE with err->column = 1-based character. */
MK_NODISCARD enum mk_status condition_check(const char *text, struct mk_error *err);
/* Evaluates a text that condition_check accepts. */
bool condition_holds(const char *text, const struct mk_loop_snapshot *snapshot);

#endif
