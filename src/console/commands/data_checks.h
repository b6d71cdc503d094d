/* Logs as the subcommands read them, and the data check's findings on the terminal. */
#ifndef MECHKIT_CONSOLE_COMMANDS_DATA_CHECKS_H
#define MECHKIT_CONSOLE_COMMANDS_DATA_CHECKS_H

#include <stdio.h>

#include "mechkit/data_check.h"

/* Reads logs; says on standard error where a last line is incomplete. Those read are the caller's
 * also on failure. */
MK_NODISCARD enum mk_status log_read_all(const char *const *paths, size_t count,
                                         struct mk_log **logs, struct mk_error *err);

/* Even times for logs whose times the check doubts for their scatter. */
void log_take_even_times(struct mk_log **logs, size_t count, const struct mk_model *model);

/* Two lines a finding: what is wrong, where, and what to do. Nothing where there is none. */
void data_checks_print(FILE *out, const struct mk_data_check *check);

/* Says the findings on standard error. */
void data_checks_warn(const struct mk_data_check *check);
/* The same for what goes on whatever they are: nothing is fatal there, but some is certain. */
void data_checks_tell(const struct mk_data_check *check);

/* Says the findings on standard error at once, before a fit or a search takes its time. An exit
 * code: EXIT_RUN_FAILED where one is fatal and nothing is forced. */
MK_NODISCARD int data_checks_say(const struct mk_data_check *check, bool force);

#endif
