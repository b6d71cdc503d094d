/* A fault in words: what tripped, with its value and its limit. */
#ifndef MECHKIT_CONSOLE_SCRIPT_FAULT_TEXT_H
#define MECHKIT_CONSOLE_SCRIPT_FAULT_TEXT_H

#include <stddef.h>

#include "mechkit/loop.h"

#define FAULT_VALUE_SIZE 240

/* "dq1 61.3 rad/s, limit 60 rad/s" of the fault that a snapshot holds; "" where no reading tripped
 * it. Returns buf. */
const char *fault_value(const struct mk_loop_snapshot *snap, const struct mk_safety_limits *limits,
                        const struct mk_model *model, char *buf, size_t size);

#endif
