/* The commands: one table for command files, and for keys and prompt of a screen. */
#ifndef MECHKIT_CONSOLE_SCRIPT_CMD_H
#define MECHKIT_CONSOLE_SCRIPT_CMD_H

#include <stdbool.h>

#include "console/script/session.h"

#define CMD_MAX_ARGS 40
#define CMD_TEXT 1024 /* of a line */

/* What the lines before have chosen, as far as it is known without a board. */
struct cmd_known {
    const char *folder; /* of the command file; NULL or "": none */
    bool keep_model;    /* the command `model` is left aside */
    bool have_setup, have_model, have_nominal;
    const struct mk_ctrl_ops *setup;             /* NULL: not known which */
    const struct mk_plant_info *model, *nominal; /* their rigs; NULL: not known */
    bool may_write_logs, may_write_models;       /* which later lines read */
    bool running;                                /* between start and halt */
    double run_s;                                /* how far the run is at least */
    char signal[CMD_TEXT]; /* expression that `input` or `ref` gave; "": none, or a file */
};

struct cmd {
    const char *name;
    const char *usage; /* arguments, as shown to people */
    const char *help;  /* one line */
    int min_args, max_args;
    bool raw; /* the rest of the line is one argument, quotes and all */
    /* Checks arguments without running, and takes over into *known what they choose. `known` NULL:
     * nothing is known; what follows from it is left to `exec`. NULL: nothing beyond their number.
     */
    enum mk_status (*check)(struct cmd_known *known, int argc, char **argv, struct mk_error *err);
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
/* Fails for an unknown command, wrong number of arguments, open quotes, bad arguments. */
MK_NODISCARD enum mk_status cmd_parse(char *line, struct cmd_known *known, struct cmd_line *out,
                                      struct mk_error *err);
/* Names of the safety limits; NULL out of range. */
const char *cmd_limit_name(int index);

/* `quit` returns this positive value; everything else MK_OK or an error. */
enum { CMD_QUIT = 1 };
int cmd_execute(struct session *s, struct cmd_line *line, struct mk_error *err);

#endif
