/* Command files: parsed whole before the first command runs, so that a typing error in the last
 * line does not end an experiment in its middle.
 *
 *     repeat N ... end     blocks, nested
 *     source FILE          another file, relative to the one it is in
 */
#ifndef MECHKIT_CONSOLE_SCRIPT_CMDFILE_H
#define MECHKIT_CONSOLE_SCRIPT_CMDFILE_H

#include <stddef.h>

#include "mechkit/status.h"

struct session;
struct cmd_known;
struct cmdfile;

/* Reads and checks a file ("-": standard input). `known`: what is chosen before its first line.
 * Every error is handed to `report` (in order, with file and line); returns the first one. */
MK_NODISCARD enum mk_status cmdfile_read(const char *path, const struct cmd_known *known,
                                         void (*report)(void *user, const struct mk_error *err),
                                         void *user, struct cmdfile **out, struct mk_error *err);
/* The same as `source` does: a file only, no pipe and no standard input, which may keep whoever
 * reads them waiting. */
MK_NODISCARD enum mk_status cmdfile_source(const char *path, const struct cmd_known *known,
                                           void (*report)(void *user, const struct mk_error *err),
                                           void *user, struct cmdfile **out, struct mk_error *err);
void cmdfile_free(struct cmdfile *file);
size_t cmdfile_command_count(const struct cmdfile *file);

/* Executes it. The first failing command ends it: *err has the script's file and line. So does a
 * session that is cancelled, before the next step: MK_ERR_INTR, the motor is off. */
MK_NODISCARD enum mk_status cmdfile_execute(const struct cmdfile *file, struct session *s,
                                            struct mk_error *err);

#endif
