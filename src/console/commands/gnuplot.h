/* gnuplot, which draws. */
#ifndef MECHKIT_CONSOLE_COMMANDS_GNUPLOT_H
#define MECHKIT_CONSOLE_COMMANDS_GNUPLOT_H

#include <stdbool.h>
#include <stdio.h>

#include "mechkit/status.h"

/* Runs the script that `write` writes. What it draws goes to the file `path`, which is replaced as
 * a whole (NULL: to standard output). MK_ERR_NOTSUP: not installed; MK_ERR_EXPECT: it failed, the
 * message says why; MK_ERR_NOSPACE and the like of the file. */
MK_NODISCARD enum mk_status gnuplot_run(const char *path,
                                        enum mk_status (*write)(FILE *f, const void *user,
                                                                struct mk_error *err),
                                        const void *user, struct mk_error *err);
/* Whether there is a gnuplot to be started, before work that takes long. MK_ERR_NOTSUP. */
MK_NODISCARD enum mk_status gnuplot_check(struct mk_error *err);
/* Text in a double-quoted string that stands for itself: nothing in it is substituted, and what is
 * no UTF-8 is written \\x1b. Cut at 1000 bytes. */
void gnuplot_quote(FILE *f, const char *text);
/* The terminal for FILE.svg or FILE.png. */
void gnuplot_picture(FILE *f, const char *path, int width, int height);

#endif
