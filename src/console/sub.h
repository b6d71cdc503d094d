/* Subcommands of the program: one row each in main.c. */
#ifndef MECHKIT_CONSOLE_SUB_H
#define MECHKIT_CONSOLE_SUB_H

#include <stdbool.h>

#include "mechkit/status.h"

/* Exit codes (docs/formats.md). */
enum { EXIT_OK = 0, EXIT_RUN_FAILED = 1, EXIT_WRONG_USAGE = 2, EXIT_BAD_FILE = 3 };

struct subcommand {
    const char *name;
    const char *summary;               /* one line for the list */
    const char *help;                  /* text of `mechkit NAME --help` */
    int (*run)(int argc, char **argv); /* argv[0] is the subcommand's name; returns an exit code */
};

int sub_run(int argc, char **argv);
int sub_console(int argc, char **argv);
int sub_simulate(int argc, char **argv);
int sub_design(int argc, char **argv);
int sub_summary(int argc, char **argv);
int sub_plot(int argc, char **argv);
int sub_robustness(int argc, char **argv);
int sub_identify(int argc, char **argv);
int sub_explain(int argc, char **argv);
int sub_boards(int argc, char **argv);
int sub_doctor(int argc, char **argv);
int sub_standalone(int argc, char **argv);
int sub_excite(int argc, char **argv);
int sub_measure(int argc, char **argv);
int sub_export(int argc, char **argv);
int sub_import(int argc, char **argv);

/* Prints "mechkit: FILE:LINE: message" to stderr and returns the exit code for that status: bad
 * input files give 3, the rest 1. */
int report_error(const struct mk_error *err);
/* Prints "mechkit: message (see mechkit NAME --help)"; returns 2. */
int report_usage(const char *name, const char *fmt, ...) MK_PRINTF(2, 3);

#endif
