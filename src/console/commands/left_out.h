/* What is left out of logs: told, and applied. */
#ifndef MECHKIT_CONSOLE_COMMANDS_LEFT_OUT_H
#define MECHKIT_CONSOLE_COMMANDS_LEFT_OUT_H

#include <stdio.h>

#include "mechkit/ident.h"

/* The options --from, --to and --keep-all of a subcommand, whose struct options has them in
 * `field`, a struct mk_row_choice; `more`: what else --keep-all keeps. */
#define LEFT_OUT_OPTIONS(field, more)                                                              \
    {"from",                                                                                       \
     OPTION_CALL(field.from_s),                                                                    \
     "S",                                                                                          \
     "only rows from S seconds after a log's first one on",                                        \
     .take = left_out_take_seconds,                                                                \
     .wants = "seconds, 0 or more"},                                                               \
        {"to", OPTION_NUMBER(field.to_s), "S",                                                     \
         "only rows up to S seconds after a log's first one", .wants = "seconds above 0"},         \
    {                                                                                              \
        "keep-all", OPTION_FLAG(field.keep_all), NULL,                                             \
            "also stretches in which somebody's hand, or a collision, takes part" more             \
    }
bool left_out_take_seconds(const char *value, void *target);

/* Foreign contact, on standard error. */
void left_out_warn(const struct mk_left_out *all, int count);
/* All of it, a line each. */
void left_out_print(FILE *out, const struct mk_left_out *all, int count);
/* Puts copies in the place of those logs, numbered from `first` on, of which something is left
 * out. */
MK_NODISCARD enum mk_status left_out_apply(struct mk_log **logs, size_t log_count, size_t first,
                                           const struct mk_left_out *all, int count,
                                           struct mk_error *err);

#endif
