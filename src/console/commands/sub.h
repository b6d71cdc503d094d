/* Subcommands of the program: one row each in subcommands.c. */
#ifndef MECHKIT_CONSOLE_COMMANDS_SUB_H
#define MECHKIT_CONSOLE_COMMANDS_SUB_H

#include <stdbool.h>
#include <stdio.h>

#include "mechkit/status.h"

/* Exit codes (docs/formats.md). */
enum { EXIT_OK = 0, EXIT_RUN_FAILED = 1, EXIT_WRONG_USAGE = 2, EXIT_BAD_FILE = 3 };

struct option_row;

struct subcommand {
    const char *name;
    const char *summary;               /* one line for the list */
    const char *synopsis;              /* what follows "mechkit NAME"; a line each way to call it */
    const char *about;                 /* paragraphs before the options in --help */
    const struct option_row *options;  /* NULL: none (console/options.h) */
    const char *notes;                 /* after the options; may be NULL */
    const char *argument;              /* what an argument without dashes is, as "log" */
    bool argument_is_name;             /* not a file to be read, which no output may replace */
    int least, most;                   /* of them */
    int (*run)(int argc, char **argv); /* argv[0] is the subcommand's name; returns an exit code */
};

/* The subcommands in the order of the list; NULL after the last. */
const struct subcommand *subcommand_at(int index);

extern const struct subcommand sub_boards, sub_console, sub_design, sub_doctor, sub_excite,
    sub_explain, sub_export, sub_identify, sub_import, sub_investigate, sub_measure, sub_plot,
    sub_robustness, sub_run, sub_serve, sub_simulate, sub_standalone, sub_summary, sub_sweep;

/* A name that comes from outside, as of a file or a column, as it may be printed: what a terminal
 * would take for a command is written \x1b. Static storage of 8 names in turn, for one thread. */
const char *show_name(const char *name);
/* Prints lines with such names in them, and ends the last one. */
void print_lines(FILE *out, const char *text);

/* Prints "mechkit: FILE:LINE: message" to stderr and returns the exit code for that status: bad
 * input files give 3, the rest 1. */
int report_error(const struct mk_error *err);
/* The same where the file is one to be written: no bad input. */
int report_output_error(const struct mk_error *err);
/* How a subcommand ends: EXIT_OK, or what report_output_error (it was `writing` already) or
 * report_error give. */
int report_end(enum mk_status st, bool writing, const struct mk_error *err);
/* report_output_error where the error is about the output `out` (NULL: none), else report_error. */
int report_error_of(const struct mk_error *err, const char *out);
/* Prints "mechkit: message (see mechkit NAME --help)"; returns 2. */
int report_usage(const char *name, const char *fmt, ...) MK_PRINTF(2, 3);

#endif
