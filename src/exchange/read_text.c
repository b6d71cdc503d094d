/* Text files of other programs: separators, decimal commas, headers and units as they come. */
#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/line_source.h"
#include "exchange/source.h"
#include "exchange/unit.h"
#include "mechkit/number.h"

#define MAX_COLUMNS 256

struct reader {
    struct mk_line_source lines;
    struct source_format format;
    struct mk_table *table;
    size_t room; /* rows that the columns have memory for */
    struct mk_error *err;
};

/* --- fields ------------------------------------------------------------------------------ */

static struct mk_span trimmed(struct mk_span s)
{
    while (s.begin < s.end && isspace((unsigned char)*s.begin))
        s.begin++;
    while (s.end > s.begin && isspace((unsigned char)s.end[-1]))
        s.end--;
    if (s.end - s.begin >= 2 && *s.begin == '"' && s.end[-1] == '"')
        s.begin++, s.end--;
    return s;
}

/* The next field of *rest, trimmed; false when there is none. Blanks in a row are one separator. */
static bool next_field(struct mk_span *rest, char separator, struct mk_span *field)
{
    if (!rest->begin)
        return false;
    if (separator == ' ')
        while (rest->begin < rest->end && isspace((unsigned char)*rest->begin))
            rest->begin++;
    if (separator == ' ' && rest->begin == rest->end)
        return false;
    const char *c = rest->begin;
    bool quoted = false;
    for (; c < rest->end; c++) {
        quoted ^= *c == '"';
        if (!quoted && (separator == ' ' ? isspace((unsigned char)*c) : *c == separator))
            break;
    }
    *field = trimmed((struct mk_span){rest->begin, c});
    rest->begin = c < rest->end ? c + 1 : NULL;
    return true;
}

static bool number_in(struct mk_span field, char decimal, double *value)
{
    char text[64];
    size_t n = (size_t)(field.end - field.begin);
    if (n == 0 || n >= sizeof text)
        return false;
    memcpy(text, field.begin, n);
    text[n] = '\0';
    char *comma = decimal == ',' ? strchr(text, ',') : NULL;
    if (comma)
        *comma = '.';
    return mk_parse_double(text, text + n, value);
}

static size_t count_of(struct mk_span line, char c)
{
    size_t n = 0;
    for (const char *p = line.begin; p < line.end; p++)
        n += *p == c;
    return n;
}

/* From a line of data or names: tabs and semicolons separate nothing else than fields; commas may
 * also be decimal. */
static void find_format(struct source_format *f, struct mk_span line)
{
    if (!f->separator) {
        if (count_of(line, '\t') > 0)
            f->separator = '\t';
        else if (count_of(line, ';') > 0)
            f->separator = ';';
        else
            f->separator = count_of(line, ',') > 0 ? ',' : ' ';
    }
}

/* As long as the decimal sign is not known, both are numbers where commas do not separate fields.
 */
static char either_decimal(const struct source_format *f)
{
    return f->decimal ? f->decimal : f->separator == ',' ? '.' : ',';
}

static bool has_numbers_only(struct mk_span line, const struct source_format *f)
{
    struct mk_span field;
    double value;
    size_t numbers = 0;
    while (next_field(&line, f->separator, &field)) {
        if (field.begin == field.end)
            continue;
        if (!number_in(field, either_decimal(f), &value))
            return false;
        numbers++;
    }
    return numbers > 0;
}

/* --- names and units --------------------------------------------------------------------- */

/* Known ways to write units. */
static const char *canonical_unit(const char *text)
{
    static const char *const same[][2] = {
        {"sec", "s"},           {"seconds", "s"},     {"msec", "ms"},       {"milliseconds", "ms"},
        {"usec", "us"},         {"degrees", "deg"},   {"degree", "deg"},    {"radians", "rad"},
        {"revolutions", "rev"}, {"rad/sec", "rad/s"}, {"deg/sec", "deg/s"}, {"N.m", "Nm"},
        {"N*m", "Nm"},          {"N m", "Nm"},        {"nm", "Nm"},         {"mN m", "mNm"}};
    for (size_t i = 0; i < sizeof same / sizeof same[0]; i++)
        if (strcmp(text, same[i][0]) == 0)
            return same[i][1];
    return unit_by_name(text) ? text : NULL;
}

/* Takes a unit off a name: "angle [deg]", "time (ms)", "theta_deg". */
static void split_unit(struct mk_table_column *c)
{
    size_t n = strlen(c->name);
    char *open = strpbrk(c->name, "[(");
    if (open && n > 0 && (c->name[n - 1] == ']' || c->name[n - 1] == ')') && open > c->name) {
        char inside[64];
        snprintf(inside, sizeof inside, "%.*s", (int)(c->name + n - open - 2), open + 1);
        const char *unit = canonical_unit(inside);
        if (unit)
            snprintf(c->unit, sizeof c->unit, "%s", unit);
        return;
    }
    const char *score = strrchr(c->name, '_');
    const char *unit = score && score > c->name ? canonical_unit(score + 1) : NULL;
    if (unit)
        snprintf(c->unit, sizeof c->unit, "%s", unit);
}

static enum mk_status add_column(struct reader *r, struct mk_span name)
{
    struct mk_table *t = r->table;
    if (t->count == MAX_COLUMNS)
        return mk_error_at(r->err, MK_ERR_PARSE, r->lines.path, r->lines.line, 0,
                           "more than %d columns", MAX_COLUMNS);
    struct mk_table_column *c = &t->column[t->count];
    memset(c, 0, sizeof *c);
    if (name.begin < name.end)
        snprintf(c->name, sizeof c->name, "%.*s", (int)(name.end - name.begin), name.begin);
    else
        snprintf(c->name, sizeof c->name, "%zu", t->count + 1);
    split_unit(c);
    t->count++;
    return MK_OK;
}

static enum mk_status read_names(struct reader *r, struct mk_span line, bool named)
{
    struct mk_span field;
    enum mk_status st = MK_OK;
    while (st == MK_OK && next_field(&line, r->format.separator, &field))
        st = add_column(r, named ? field : (struct mk_span){NULL, NULL});
    return st;
}

/* The unit that a field of its own names, with or without brackets; NULL: none. */
static const char *unit_in(struct mk_span field)
{
    char text[32];
    if (field.begin < field.end && strchr("[(", *field.begin))
        field.begin++, field.end -= field.end > field.begin;
    snprintf(text, sizeof text, "%.*s", (int)(field.end - field.begin), field.begin);
    return canonical_unit(text);
}

/* Whether a line below the names is about units: it names one, or has no number. Else it is a row,
 * whatever text there is in it. */
static bool is_about_units(struct mk_span line, const struct source_format *f)
{
    struct mk_span field;
    double value;
    bool numbers = false;
    while (next_field(&line, f->separator, &field)) {
        if (unit_in(field))
            return true;
        numbers |= number_in(field, either_decimal(f), &value);
    }
    return !numbers;
}

static void read_units(struct reader *r, struct mk_span line)
{
    struct mk_span field;
    for (size_t i = 0; next_field(&line, r->format.separator, &field) && i < r->table->count; i++) {
        const char *unit = unit_in(field);
        if (unit)
            snprintf(r->table->column[i].unit, sizeof r->table->column[i].unit, "%s", unit);
    }
}

/* --- rows -------------------------------------------------------------------------------- */

static bool make_room(struct reader *r)
{
    if (r->table->rows < r->room)
        return true;
    size_t room = r->room ? 2 * r->room : 1024;
    for (size_t i = 0; i < r->table->count; i++) {
        double *more = realloc(r->table->column[i].data, sizeof(double) * room);
        if (!more)
            return false;
        r->table->column[i].data = more;
    }
    r->room = room;
    return true;
}

/* Ways to say that there is no value, beside nan and nothing. */
static bool is_missing(struct mk_span field)
{
    static const char *const words[] = {"", "NA", "N/A", "null", "NULL", "None", "-"};
    size_t n = (size_t)(field.end - field.begin);
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++)
        if (strlen(words[i]) == n && memcmp(field.begin, words[i], n) == 0)
            return true;
    return false;
}

/* A column of text may well be there; only one that is taken for numbers must not have any. */
static void note_text(struct mk_table_column *c, struct mk_span field, int line)
{
    if (c->text_line || is_missing(field))
        return;
    c->text_line = line;
    snprintf(c->text, sizeof c->text, "%.*s", (int)(field.end - field.begin), field.begin);
}

static enum mk_status read_row(struct reader *r, struct mk_span line)
{
    struct mk_span field;
    struct mk_table *t = r->table;
    size_t n = 0;
    if (!make_room(r))
        return mk_error_set(r->err, MK_ERR_NOMEM, "no memory for %s", r->lines.path);
    while (next_field(&line, r->format.separator, &field)) {
        double value = (double)NAN;
        if (n == t->count) {
            if (field.begin == field.end)
                continue; /* a separator at the end of the line */
            return mk_error_at(r->err, MK_ERR_PARSE, r->lines.path, r->lines.line, (int)n + 1,
                               "more fields than the %zu columns have names", t->count);
        }
        if (!r->format.decimal && r->format.separator != ',' &&
            memchr(field.begin, ',', (size_t)(field.end - field.begin)))
            r->format.decimal = ',';
        if (!number_in(field, r->format.decimal, &value))
            note_text(&t->column[n], field, r->lines.line);
        t->column[n++].data[t->rows] = value;
    }
    while (n < t->count)
        t->column[n++].data[t->rows] = (double)NAN;
    t->rows++;
    return MK_OK;
}

static enum mk_status read_line(struct reader *r, struct mk_span line)
{
    struct mk_span text = trimmed(line);
    if (text.begin == text.end || *text.begin == '#' || *text.begin == '%')
        return MK_OK;
    find_format(&r->format, line);
    bool numbers = has_numbers_only(line, &r->format);
    if (r->table->count == 0) {
        enum mk_status st = read_names(r, line, !numbers);
        return st == MK_OK && numbers ? read_row(r, line) : st;
    }
    if (r->table->rows == 0 && !numbers && is_about_units(line, &r->format)) {
        read_units(r, line);
        return MK_OK;
    }
    return read_row(r, line);
}

enum mk_status source_read_text(const char *path, struct source_format *format,
                                struct mk_table **out, struct mk_error *err)
{
    struct reader r = {.format = *format, .err = err};
    struct mk_span line;
    bool more = true;
    *out = NULL;
    enum mk_status st = mk_line_source_open(&r.lines, path, err);
    if (st != MK_OK)
        return st;
    r.table = calloc(1, sizeof *r.table);
    if (r.table)
        r.table->column = calloc(MAX_COLUMNS, sizeof *r.table->column);
    if (!r.table || !r.table->column)
        st = mk_error_set(err, MK_ERR_NOMEM, "no memory for %s", path);
    while (st == MK_OK && (st = mk_line_source_next(&r.lines, &line, &more)) == MK_OK && more)
        st = read_line(&r, line);
    if (st == MK_OK && r.table->rows < 2)
        st = mk_error_at(err, MK_ERR_PARSE, path, r.lines.line, 0, "no rows of numbers");
    mk_line_source_close(&r.lines);
    if (st != MK_OK) {
        mk_table_free(r.table);
        return st;
    }
    *format = r.format;
    if (!format->decimal)
        format->decimal = '.';
    *out = r.table;
    return MK_OK;
}
