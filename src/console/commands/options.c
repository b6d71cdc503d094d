#include "console/commands/options.h"

#include "base/text.h"

#include <getopt.h>
#include <limits.h>
#include <math.h>
#include <string.h>
#include <sys/stat.h>

#include "mechkit/number.h"

#define MAX_ROWS 40
#define WIDTH 96      /* of --help */
#define MAX_INDENT 22 /* where the texts of options begin, at most */

static int row_count(const struct subcommand *sub)
{
    int n = 0;
    while (sub->options && sub->options[n].name)
        n++;
    return n;
}

/* --- values --------------------------------------------------------------------------------- */

static bool in_range(const struct option_row *row, double x)
{
    if (row->low == 0.0 && row->high == 0.0)
        return x > 0.0 && isfinite(x);
    return x >= row->low && x <= row->high && isfinite(x);
}

static bool take_number(const struct option_row *row, const char *value, double *out)
{
    return mk_parse_double_z(value, out) && in_range(row, *out) &&
           (row->kind == OPTION_KIND_NUMBER || *out == floor(*out));
}

static void what_fits(const struct option_row *row, char *text, size_t size)
{
    const char *what = row->kind == OPTION_KIND_NUMBER ? "a number" : "a whole number";
    if (row->wants)
        snprintf(text, size, "%s", row->wants);
    else if (row->low == 0.0 && row->high == 0.0)
        snprintf(text, size, "%s above 0", what);
    else if (isinf(row->high))
        snprintf(text, size, "%s from %.15g on", what, row->low);
    else
        snprintf(text, size, "%s from %.15g to %.15g", what, row->low, row->high);
}

bool option_take_range(const char *value, void *target)
{
    struct option_range *r = target;
    const char *colon = strchr(value, ':');
    return colon && mk_parse_double(value, colon, &r->low) &&
           mk_parse_double_z(colon + 1, &r->high) && isfinite(r->low) && isfinite(r->high) &&
           r->low < r->high;
}

int option_numbers(const char *list, double *out, int most)
{
    int n = 0;
    for (const char *at = list + strspn(list, " \t,"); *at; at += strspn(at, " \t,")) {
        const size_t length = strcspn(at, " \t,");
        if (n == most || !mk_parse_double(at, at + length, &out[n]) || !isfinite(out[n]))
            return -1;
        n++;
        at += length;
    }
    return n;
}

static int take(const struct subcommand *sub, const struct option_row *row, const char *value,
                void *target)
{
    void *field = (char *)target + row->target;
    struct option_texts *texts = field;
    double x = 0.0;
    bool fits = true;
    switch (row->kind) {
    case OPTION_KIND_FLAG:
        *(bool *)field = true;
        break;
    case OPTION_KIND_TEXT:
        *(const char **)field = value;
        break;
    case OPTION_KIND_OUTPUT:
    case OPTION_KIND_FIGURES:
        if (!*value)
            return report_usage(sub->name, "--%s: the name is empty", row->name);
        if (is_standard_output(value) && row->kind == OPTION_KIND_OUTPUT)
            return report_usage(sub->name,
                                "--%s -: expected a name; this does not go to standard output "
                                "(./- is a file of that name)",
                                row->name);
        *(const char **)field = value;
        break;
    case OPTION_KIND_TEXTS:
        if (texts->count == OPTION_TEXTS_MAX)
            return report_usage(sub->name, "at most %d times --%s", OPTION_TEXTS_MAX, row->name);
        texts->text[texts->count++] = value;
        break;
    case OPTION_KIND_CALL:
        fits = row->take(value, field);
        break;
    default:
        fits = take_number(row, value, &x);
        if (row->kind == OPTION_KIND_NUMBER)
            *(double *)field = x;
        else if (fits && row->kind == OPTION_KIND_COUNT)
            *(int *)field = (int)x;
        else if (fits)
            *(uint64_t *)field = (uint64_t)x;
    }
    if (fits)
        return EXIT_OK;
    char wants[160];
    what_fits(row, wants, sizeof wants);
    return report_usage(sub->name, "--%s %s: expected %s", row->name, value, wants);
}

/* --- what is not understood ----------------------------------------------------------------- */

/* `code` is getopt's optopt: a letter, a row that was given a value it does not take, or 0. */
static int report_unknown(const struct subcommand *sub, int code, const char *given)
{
    char word[64];
    if (code >= 256)
        return report_usage(sub->name, "--%s takes no value", sub->options[code - 256].name);
    if (code > 0)
        return report_usage(sub->name, "unknown option '-%c'", code);
    snprintf(word, sizeof word, "%.*s", (int)strcspn(given, "="), given);
    struct mk_meant meant = {.word = word + strspn(word, "-")};
    for (int i = 0; i < row_count(sub); i++)
        mk_meant_try(&meant, sub->options[i].name);
    if (meant.name)
        return report_usage(sub->name, "unknown option '%s': did you mean --%s?", word, meant.name);
    return report_usage(sub->name, "unknown option '%s'", word);
}

static int report_missing_value(const struct subcommand *sub, const struct option_row *row)
{
    return report_usage(sub->name, "--%s needs a value: --%s %s", row->name, row->name,
                        row->argument);
}

/* --- what is written must not be what is read ------------------------------------------------ */

static bool is_output(const struct option_row *row)
{
    return row->kind == OPTION_KIND_OUTPUT || row->kind == OPTION_KIND_FIGURES;
}

/* Whether an option that is no output names this file. */
static bool is_read_by(const struct option_row *row, const void *target, const char *path)
{
    const void *field = (const char *)target + row->target;
    const struct option_texts *texts = field;
    if (row->kind == OPTION_KIND_TEXT)
        return same_file(*(const char *const *)field, path);
    for (size_t i = 0; row->kind == OPTION_KIND_TEXTS && i < texts->count; i++)
        if (same_file(texts->text[i], path))
            return true;
    return false;
}

/* Whether two outputs that are not there yet would come to be one file. NULL: there is none. */
static bool same_new_file(const char *a, const char *b)
{
    char folder[2][PATH_MAX];
    const char *path[2] = {a, b}, *name[2];
    struct stat s[2];
    if (!a || !b || stat(a, &s[0]) == 0 || stat(b, &s[1]) == 0)
        return false;
    for (int i = 0; i < 2; i++) {
        const char *slash = strrchr(path[i], '/');
        name[i] = slash ? slash + 1 : path[i];
        int length = slash ? (int)(slash - path[i]) + 1 : 0;
        if (length >= PATH_MAX)
            return false;
        snprintf(folder[i], sizeof folder[i], "%.*s", length ? length : 1, length ? path[i] : ".");
        if (stat(folder[i], &s[i]) != 0)
            return false;
    }
    return strcmp(name[0], name[1]) == 0 && s[0].st_dev == s[1].st_dev &&
           s[0].st_ino == s[1].st_ino;
}

static int check_output(const struct subcommand *sub, const struct option_row *output,
                        const void *target, const struct arguments *rest)
{
    const char *path = *(const char *const *)((const char *)target + output->target);
    if (!path || is_standard_output(path))
        return EXIT_OK;
    bool read = false;
    for (int i = 0; i < rest->count && !sub->argument_is_name; i++)
        read = read || same_file(rest->text[i], path);
    for (const struct option_row *row = sub->options; row->name; row++) {
        const bool replaced = output->replaces && strcmp(output->replaces, row->name) == 0;
        read = read || (!replaced && is_read_by(row, target, path));
        const char *const *other = (const char *const *)((const char *)target + row->target);
        if (row < output && is_output(row) &&
            (same_file(*other, path) || same_new_file(*other, path)))
            return report_usage(sub->name, "--%s %s: --%s goes to that file", output->name, path,
                                row->name);
    }
    return read ? report_usage(sub->name, "--%s %s: that is a file to be read", output->name, path)
                : EXIT_OK;
}

/* --- the command line ----------------------------------------------------------------------- */

static int check_arguments(const struct subcommand *sub, const struct arguments *rest)
{
    if (rest->count < sub->least)
        return report_usage(sub->name, "which %s?", sub->argument);
    if (rest->count <= sub->most)
        return EXIT_OK;
    if (sub->most > 1)
        return report_usage(sub->name, "at most %d %ss", sub->most, sub->argument);
    if (sub->most == 1)
        return report_usage(sub->name, "one %s at a time: '%s' is too much", sub->argument,
                            rest->text[1]);
    return report_usage(sub->name, "'%s' is too much", rest->text[0]);
}

int options_parse(const struct subcommand *sub, int argc, char **argv, void *target,
                  struct arguments *rest)
{
    struct option names[MAX_ROWS + 1] = {{0}};
    bool given[MAX_ROWS] = {false};
    int count = row_count(sub), c;
    for (int i = 0; i < count && i < MAX_ROWS; i++)
        names[i] = (struct option){sub->options[i].name,
                                   sub->options[i].argument ? required_argument : no_argument, NULL,
                                   i + 256}; /* no letter: there are no short options */
    opterr = 0;
    optind = 0; /* GNU: start anew */
    while ((c = getopt_long(argc, argv, ":", names, NULL)) != -1) {
        if (c == ':')
            return report_missing_value(sub, &sub->options[optopt - 256]);
        if (c == '?')
            return report_unknown(sub, optopt, argv[optind - 1]);
        given[c - 256] = true;
        int code = take(sub, &sub->options[c - 256], optarg, target);
        if (code != EXIT_OK)
            return code;
    }
    *rest = (struct arguments){argv + optind, argc - optind};
    for (int i = 0; i < count; i++)
        if (sub->options[i].required && !given[i])
            return report_usage(sub->name, "--%s is missing: --%s %s", sub->options[i].name,
                                sub->options[i].name, sub->options[i].argument);
    int code = check_arguments(sub, rest);
    for (int i = 0; i < count && code == EXIT_OK; i++)
        if (is_output(&sub->options[i]))
            code = check_output(sub, &sub->options[i], target, rest);
    return code;
}

/* --- help ----------------------------------------------------------------------------------- */

/* Words of a text from column `indent` on, in lines of WIDTH. */
static void put_wrapped(FILE *out, const char *text, int indent)
{
    int column = indent;
    while (*text) {
        int word = (int)strcspn(text, " \n");
        if (column > indent && column + 1 + word > WIDTH) {
            fprintf(out, "\n%*s", indent, "");
            column = indent;
        } else if (column > indent) {
            fputc(' ', out);
            column++;
        }
        fwrite(text, 1, (size_t)word, out);
        column += word;
        text += word;
        if (*text == '\n') {
            fprintf(out, "\n%*s", indent, "");
            column = indent;
        }
        text += *text != '\0';
    }
    fputc('\n', out);
}

/* "--out FILE" as it stands in --help. */
static int row_head(const struct option_row *row, char *text, size_t size)
{
    return snprintf(text, size, "  --%s%s%s", row->name, row->argument ? " " : "",
                    row->argument ? row->argument : "");
}

static void put_rows(const struct subcommand *sub, FILE *out)
{
    char head[80];
    int indent = 0, count = row_count(sub);
    for (int i = 0; i < count; i++) {
        int length = row_head(&sub->options[i], head, sizeof head) + 2;
        indent = length > indent && length <= MAX_INDENT ? length : indent;
    }
    for (int i = 0; i < count; i++) {
        int length = row_head(&sub->options[i], head, sizeof head);
        fputs(head, out);
        if (length + 2 > indent)
            fprintf(out, "\n%*s", indent, "");
        else
            fprintf(out, "%*s", indent - length, "");
        put_wrapped(out, sub->options[i].help, indent);
    }
}

void options_help(const struct subcommand *sub, FILE *out)
{
    const char *line = sub->synopsis;
    for (int i = 0; line; i++) {
        int length = (int)strcspn(line, "\n");
        fprintf(out, "%s mechkit %s%s%.*s\n", i == 0 ? "usage:" : "      ", sub->name,
                length ? " " : "", length, line);
        line = line[length] ? line + length + 1 : NULL;
    }
    fprintf(out, "\n%s\n", sub->about);
    if (row_count(sub) > 0)
        fputc('\n', out);
    put_rows(sub, out);
    if (sub->notes)
        fprintf(out, "\n%s\n", sub->notes);
}

bool is_standard_output(const char *path)
{
    return path && strcmp(path, "-") == 0;
}

bool same_file(const char *a, const char *b)
{
    struct stat x, y;
    return a && b && stat(a, &x) == 0 && stat(b, &y) == 0 && S_ISREG(x.st_mode) &&
           x.st_dev == y.st_dev && x.st_ino == y.st_ino;
}
