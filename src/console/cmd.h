/* The commands: one table for command files, and for keys and prompt of a screen. */
#ifndef MECHKIT_CONSOLE_CMD_H
#define MECHKIT_CONSOLE_CMD_H

#include <stdbool.h>

#include "console/session.h"

#define CMD_MAX_ARGS 40

struct cmd {
    const char *name;
    const char *usage; /* arguments, as shown to people */
    const char *help;  /* one line */
    int min_args, max_args;
    bool raw; /* the rest of the line is one argument, quotes and all */
    /* Checks arguments without running; NULL: nothing beyond their number. */
    enum mk_status (*check)(int argc, char **argv, struct mk_error *err);
    /* argv[0] is the first argument. */
    enum mk_status (*exec)(struct session *s, int argc, char **argv, struct mk_error *err);
};

/* Table of commands; NULL out of range / unknown. */
const struct cmd *cmd_at(int index);
const struct cmd *cmd_by_name(const char *name);

/* One line, split and checked. Memory is the caller's `line`, which is cut into pieces. */
struct cmd_line {
    const struct cmd *cmd; /* NULL: an empty line or a comment */
    int argc;
    char *argv[CMD_MAX_ARGS];
};
/* MK_ERR_PARSE for an unknown command, wrong number of arguments, open quotes, bad arguments. */
MK_NODISCARD enum mk_status cmd_parse(char *line, struct cmd_line *out, struct mk_error *err);

/* `quit` returns this positive value; everything else MK_OK or an error. */
enum { CMD_QUIT = 1 };
int cmd_execute(struct session *s, struct cmd_line *line, struct mk_error *err);

#endif
