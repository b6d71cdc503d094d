/* What the files of the commands share. */
#ifndef MECHKIT_CONSOLE_CMD_PRIV_H
#define MECHKIT_CONSOLE_CMD_PRIV_H

#include "console/cmd.h"

/* A finite number; MK_ERR_PARSE says what it was. */
enum mk_status cmd_number(const char *text, double *out, struct mk_error *err);
/* MK_ERR_STATE before the first `setup`. */
enum mk_status cmd_need_setup(const struct session *s, struct mk_error *err);
/* Where a safety limit is kept, by its name; NULL: there is none. */
double *cmd_limit_at(struct session *s, const char *name);

enum mk_status cmd_do_gains(struct session *s, int argc, char **argv, struct mk_error *err);
enum mk_status cmd_do_set(struct session *s, int argc, char **argv, struct mk_error *err);
enum mk_status cmd_do_limit(struct session *s, int argc, char **argv, struct mk_error *err);
enum mk_status cmd_do_identify(struct session *s, int argc, char **argv, struct mk_error *err);
enum mk_status cmd_do_explain(struct session *s, int argc, char **argv, struct mk_error *err);
enum mk_status cmd_do_compare(struct session *s, int argc, char **argv, struct mk_error *err);
enum mk_status cmd_do_replay(struct session *s, int argc, char **argv, struct mk_error *err);
enum mk_status cmd_do_record(struct session *s, int argc, char **argv, struct mk_error *err);
/* Around each command while `record` is on: its line, after a pause as long as the run was left
 * alone, is made before it is executed, which cuts conditions to pieces, and written if it
 * succeeds.
 */
void cmd_record_line(struct session *s, const struct cmd_line *line, char *text, size_t size);
void cmd_record(struct session *s, const char *text);

#endif
