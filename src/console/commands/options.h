/* Options of the subcommands: one table each, which parses the command line, writes the text of
 * --help, and so what man pages and completion know.
 *
 * A subcommand has a `struct options` that the rows fill in:
 *
 *     static const struct option_row option_rows[] = {
 *         {"out", OPTION_OUTPUT(out), "FILE", "where it goes", .required = true},
 *         {"rate", OPTION_NUMBER(rate_hz), "HZ", "samples per second", 100, 2000},
 *         {"fast", OPTION_FLAG(fast), NULL, "in simulated time"},
 *         {0}};
 */
#ifndef MECHKIT_CONSOLE_COMMANDS_OPTIONS_H
#define MECHKIT_CONSOLE_COMMANDS_OPTIONS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "console/commands/sub.h"

enum option_kind {
    OPTION_KIND_FLAG,
    OPTION_KIND_TEXT,
    OPTION_KIND_TEXTS,
    OPTION_KIND_OUTPUT,
    OPTION_KIND_FIGURES,
    OPTION_KIND_NUMBER,
    OPTION_KIND_COUNT,
    OPTION_KIND_SEED,
    OPTION_KIND_CALL
};

#define OPTION_TEXTS_MAX 64

/* Values of an option that may be repeated. */
struct option_texts {
    const char *text[OPTION_TEXTS_MAX];
    size_t count;
};

struct option_row {
    const char *name; /* "out" for --out; NULL ends a table */
    enum option_kind kind;
    size_t target;        /* offset in struct options */
    const char *argument; /* what --help calls the value; NULL: there is none */
    const char *help;     /* wrapped where it is printed; a \n starts a line of its own */
    double low, high;     /* numbers and counts: range, inclusive; both 0: any above 0 */
    /* OPTION_CALL: takes the value over; false when it does not fit. */
    bool (*take)(const char *value, void *target);
    const char *wants; /* what would fit, for the error; NULL: made from the range */
    bool required;
    const char *replaces; /* an output: the option whose file it may take the place of */
};

/* Kind and target of a row; a field of another type does not compile. */
#define OPTION_FIELD(type, field)                                                                  \
    offsetof(struct options, field) +                                                              \
        0 * sizeof(char[_Generic(((struct options *)0)->field, type : 1)])
#define OPTION_FLAG(field) .kind = OPTION_KIND_FLAG, .target = OPTION_FIELD(bool, field)
#define OPTION_TEXT(field) .kind = OPTION_KIND_TEXT, .target = OPTION_FIELD(const char *, field)
/* Path of a file or folder to be written: neither empty nor "-", which is no file; of figures,
 * which go to standard output too, it may be "-". No output may be a file that another option or an
 * argument names. */
#define OPTION_OUTPUT(field) .kind = OPTION_KIND_OUTPUT, .target = OPTION_FIELD(const char *, field)
#define OPTION_FIGURES(field)                                                                      \
    .kind = OPTION_KIND_FIGURES, .target = OPTION_FIELD(const char *, field)
#define OPTION_TEXTS(field)                                                                        \
    .kind = OPTION_KIND_TEXTS, .target = OPTION_FIELD(struct option_texts, field)
#define OPTION_NUMBER(field) .kind = OPTION_KIND_NUMBER, .target = OPTION_FIELD(double, field)
#define OPTION_COUNT(field) .kind = OPTION_KIND_COUNT, .target = OPTION_FIELD(int, field)
#define OPTION_SEED(field) .kind = OPTION_KIND_SEED, .target = OPTION_FIELD(uint64_t, field)
#define OPTION_CALL(field) .kind = OPTION_KIND_CALL, .target = offsetof(struct options, field)

/* LOW:HIGH, finite and in this order; for OPTION_CALL. */
struct option_range {
    double low, high; /* low NaN: not given */
};
bool option_take_range(const char *value, void *target);
/* Numbers of a list, divided by blanks and commas, all of them finite. How many; -1: something else
 * is among them, or there are more than `most`. */
int option_numbers(const char *list, double *out, int most);

/* What is left of a command line: file names and the like. */
struct arguments {
    char **text;
    int count;
};

/* Fills `target`, a struct options with its defaults in place, from a command line. Returns
 * EXIT_OK, or 2 when a usage error was reported: an option that is not there (with the one that may
 * have been meant), a value that is missing or does not fit, a required option left out, too few or
 * too many arguments, an output that would take the place of an input or of another output. The
 * order of argv changes: options first. */
int options_parse(const struct subcommand *sub, int argc, char **argv, void *target,
                  struct arguments *rest);

/* Text of `mechkit NAME --help`. */
void options_help(const struct subcommand *sub, FILE *out);

/* Whether the path of an output is "-". NULL: there is no such output. */
bool is_standard_output(const char *path);
/* Whether two paths lead to one file that exists: what is read must not be written over. */
bool same_file(const char *a, const char *b);

#endif
