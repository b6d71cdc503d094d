/* Errors on standard error, one line first, and the exit code that goes with them. */
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "base/text.h"
#include "console/commands/sub.h"

#define NAMES_SHOWN 8 /* at a time; more than any line has */

const char *show_name(const char *name)
{
    static char shown[NAMES_SHOWN][2048];
    static unsigned turn;
    const unsigned i = turn++ % NAMES_SHOWN;
    return mk_show_text(shown[i], sizeof shown[i], name);
}

void print_lines(FILE *out, const char *text)
{
    char line[4096], shown[4 * sizeof line];
    for (const char *at = text; at; at = *at ? at + 1 : NULL) {
        const size_t n = strcspn(at, "\n");
        snprintf(line, sizeof line, "%.*s", (int)n, at);
        fprintf(out, "%s\n", mk_show_text(shown, sizeof shown, line));
        at += n;
    }
}

/* What a file had in it may be part of the message: it must not steer the terminal, and must be
 * text. A name is of one line, whatever is in it. */
static void print(const struct mk_error *err)
{
    char text[1024];
    struct mk_error one_line = *err;
    if (strchr(err->file, '\n'))
        mk_show_text(one_line.file, sizeof one_line.file, err->file);
    mk_error_format(&one_line, text, sizeof text);
    fputs("mechkit: ", stderr);
    print_lines(stderr, text);
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
    char text[1024], shown[4 * sizeof text];
    va_list args;
    va_start(args, fmt);
    vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    fprintf(stderr, "mechkit: %s (see mechkit %s%s--help)\n",
            mk_show_text(shown, sizeof shown, text), name, *name ? " " : "");
    return EXIT_WRONG_USAGE;
}

int report_error_of(const struct mk_error *err, const char *out)
{
    return out && strcmp(err->file, out) == 0 ? report_output_error(err) : report_error(err);
}
