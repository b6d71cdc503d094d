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

#endif
