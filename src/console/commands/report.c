/* Errors on standard error, one line first, and the exit code that goes with them. */
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "base/text.h"
#include "console/commands/sub.h"

/* What a file had in it may be part of the message: it must not steer the terminal, and must be
 * text. */
static void print(const struct mk_error *err)
{
    char text[1024], shown[4 * sizeof text], *rest = text, *line;
    mk_error_format(err, text, sizeof text);
    fputs("mechkit: ", stderr);
    while ((line = strsep(&rest, "\n")) != NULL)
        fprintf(stderr, "%s\n", mk_show_text(shown, sizeof shown, line));
}

int report_output_error(const struct mk_error *err)
{
    print(err);
    return err->status == MK_ERR_USAGE ? EXIT_WRONG_USAGE : EXIT_RUN_FAILED;
}

int report_end(enum mk_status st, bool writing, const struct mk_error *err)
{
    if (st == MK_OK)
        return EXIT_OK;
    return writing ? report_output_error(err) : report_error(err);
}

int report_error(const struct mk_error *err)
{
    print(err);
    switch (err->status) {
    case MK_ERR_PARSE:
    case MK_ERR_RANGE:
    case MK_ERR_NOTFOUND:
        return EXIT_BAD_FILE;
    case MK_ERR_IO:
    case MK_ERR_PERM:
        return err->file[0] ? EXIT_BAD_FILE : EXIT_RUN_FAILED;
    case MK_ERR_USAGE:
        return EXIT_WRONG_USAGE;
    default:
        return EXIT_RUN_FAILED;
    }
}

int report_usage(const char *name, const char *fmt, ...)
{
    va_list args;
    va_start(args, fmt);
    fputs("mechkit: ", stderr);
    vfprintf(stderr, fmt, args);
    va_end(args);
    fprintf(stderr, " (see mechkit %s%s--help)\n", name, *name ? " " : "");
    return EXIT_WRONG_USAGE;
}

int report_error_of(const struct mk_error *err, const char *out)
{
    return out && strcmp(err->file, out) == 0 ? report_output_error(err) : report_error(err);
}
