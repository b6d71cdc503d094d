/* Options that `run` and `console` share. */
#ifndef MECHKIT_CONSOLE_SESSION_ARGS_H
#define MECHKIT_CONSOLE_SESSION_ARGS_H

#include <getopt.h>

#include "console/session.h"

/* Rows of getopt_long's table. */
/* clang-format off */
#define SESSION_ARGS                                                                               \
    {"board", required_argument, NULL, 'b'}, {"device", required_argument, NULL, 'd'},             \
    {"model", required_argument, NULL, 'm'}, {"believe", required_argument, NULL, 'B'},            \
    {"out", required_argument, NULL, 'o'}, {"rate", required_argument, NULL, 'r'},                 \
    {"seed", required_argument, NULL, 's'}, {"fast", no_argument, NULL, 'f'}
/* clang-format on */

/* Takes over one of them: true if `c` is one; *code is EXIT_OK, or the exit code of a usage error
 * that has been reported for `command`. */
bool session_take_arg(const char *command, int c, const char *value, struct session_options *o,
                      int *code);

#endif
