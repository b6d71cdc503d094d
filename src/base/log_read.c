/* Reads a log line by line: only the columns stay in memory, and they grow as rows come. */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/line_source.h"
#include "base/log_priv.h"
#include "mechkit/number.h"

#define SHOWN 40 /* characters of the file that a message repeats */
/* What one log may have, far above any rig's. A small compressed file can claim millions of either:
 * every line of metadata is kept, and every name is compared with all others. */
#define META_MAX_LINES 100000
#define META_MAX_BYTES (1u << 24)
#define COLUMNS_MAX 4096
/* Of empty lines, and lines of commas alone: as much as metadata, and for every row another KB. */
#define SKIPPED_MAX_BYTES META_MAX_BYTES
#define SKIPPED_A_ROW 1024u
/* s, over three years: no rig runs for so long, and times that far apart are not seconds. */
#define BEGAN_BEFORE_MAX 1e8
#define BEGINS_KEY "begins_s"

struct reader {
    struct mk_line_source source;
    struct mk_log *log;
    bool *known;   /* by column: only numbers */
    bool *textual; /* by column: text from the first row on */
    size_t time_column;
    size_t room_rows;
    size_t taken;         /* fields of the current row that are stored */
    size_t meta_bytes;    /* of keys and values so far */
    size_t skipped_bytes; /* of lines that say nothing */
    double begins;        /* of the run, s; where begins_line is not 0 */
    int begins_line;
    bool ours;        /* says mechkit-log: its complete lines end in a newline */
    bool start_again; /* a column turned out to be text after rows of numbers */
};

#define FAIL(r, field, ...)                                                                        \
    mk_error_at((r)->source.err, MK_ERR_PARSE, (r)->source.path, (r)->source.line, (int)(field),   \
                __VA_ARGS__)

/* What a file needs that another program wrote. */
#define FOREIGN "; if another program wrote it: mechkit import makes a log of it"

static enum mk_status no_memory(struct reader *r)
{
    return mk_error_at(r->source.err, MK_ERR_NOMEM, r->source.path, r->source.line, 0,
                       "out of memory");
}

/* A line that says nothing. A small compressed file can have gigabytes of them. */
static enum mk_status skip(struct reader *r, struct mk_span line)
{
    r->skipped_bytes += (size_t)(line.end - line.begin) + 1;
    if (r->skipped_bytes / SKIPPED_A_ROW <= SKIPPED_MAX_BYTES / SKIPPED_A_ROW + r->log->rows)
        return MK_OK;
    return FAIL(r, 0, "more than %u MB of empty lines: a log has rows of numbers",
                SKIPPED_MAX_BYTES >> 20);
}

/* Text of the file for a message: short and printable. */
static const char *shown(struct mk_span s, char out[SHOWN + 4])
{
    size_t n = 0;
    for (; s.begin < s.end && n < SHOWN; s.begin++)
        out[n++] = *s.begin >= ' ' && *s.begin < 0x7f ? *s.begin : '?';
    strcpy(out + n, s.begin < s.end ? "..." : "");
    return out;
}

static struct mk_span trimmed(struct mk_span s)
{
    while (s.begin < s.end && (*s.begin == ' ' || *s.begin == '\t'))
        s.begin++;
    while (s.end > s.begin && (s.end[-1] == ' ' || s.end[-1] == '\t'))
        s.end--;
    return s;
}

/* The field from `at` on; s.end is where its comma or the end of the line is. */
static struct mk_span field_at(const char *at, const char *line_end)
{
    const char *comma = memchr(at, ',', (size_t)(line_end - at));
    return (struct mk_span){at, comma ? comma : line_end};
}

static size_t count_fields(struct mk_span line)
{
    size_t n = 1;
    for (const char *p = line.begin; p < line.end; p++)
        n += *p == ',';
    return n;
}

/* --- metadata and header -------------------------------------------------------------- */

/* `# begins_s: T`; the first one counts. */
static enum mk_status take_begins(struct reader *r, struct mk_span value)
{
    if (r->begins_line)
        return MK_OK;
    r->begins_line = r->source.line;
    if (mk_parse_double(value.begin, value.end, &r->begins) && isfinite(r->begins))
        return MK_OK;
    return FAIL(r, 0,
                BEGINS_KEY ": '%s' is no time: expected when the run began, in s on the axis of t, "
                           "or no such line",
                shown(value, (char[SHOWN + 4]){0}));
}

/* `line` begins with '#'. Without a colon it is a plain comment: kept, with an empty key. */
static enum mk_status take_meta(struct reader *r, struct mk_span line)
{
    struct mk_span all = trimmed((struct mk_span){line.begin + 1, line.end});
    const char *colon = memchr(all.begin, ':', (size_t)(all.end - all.begin));
    struct mk_span key = {all.begin, all.begin};
    if (colon) {
        key = trimmed((struct mk_span){all.begin, colon});
        all = trimmed((struct mk_span){colon + 1, all.end});
    }
    size_t key_length = (size_t)(key.end - key.begin);
    size_t length = (size_t)(all.end - all.begin);
    r->meta_bytes += key_length + length;
    if (r->log->meta_count >= META_MAX_LINES || r->meta_bytes > META_MAX_BYTES)
        return FAIL(r, 0,
                    "more than %d lines or %u MB of comments and metadata: a log has rows of "
                    "numbers",
                    META_MAX_LINES, META_MAX_BYTES >> 20);
    if (mk_log_append_meta(r->log, key.begin, key_length, all.begin, length) != MK_OK)
        return no_memory(r);
    const struct mk_log_meta *m = &r->log->meta[r->log->meta_count - 1];
    if (strcmp(m->key, BEGINS_KEY) == 0)
        return take_begins(r, all);
    if (strcmp(m->key, MK_LOG_VERSION_KEY) != 0)
        return MK_OK;
    r->ours = true;
    if (strcmp(m->value, MK_LOG_VERSION) != 0)
        return FAIL(r, 0, "log format version '%s': this program reads version " MK_LOG_VERSION,
                    shown(all, (char[SHOWN + 4]){0}));
    return MK_OK;
}

static bool has_control_characters(struct mk_span s)
{
    for (; s.begin < s.end; s.begin++)
        if ((unsigned char)*s.begin < ' ' || *s.begin == 0x7f)
            return true;
    return false;
}

static enum mk_status check_name(struct reader *r, struct mk_span name, size_t column)
{
    char text[SHOWN + 4];
    double number;
    size_t length = (size_t)(name.end - name.begin);
    if (length == 0)
        return FAIL(r, column + 1, "a column without a name in the header line");
    if (has_control_characters(name))
        return FAIL(r, column + 1, "'%s' cannot name a column: is this a log?", shown(name, text));
    if (mk_parse_double(name.begin, name.end, &number) && !isnan(number))
        return FAIL(r, column + 1,
                    "the number %s where the header line should name a column, as in t,q1,q2,u",
                    shown(name, text));
    for (size_t i = 0; i < column; i++) {
        const char *other = r->log->columns[i].name;
        if (strlen(other) == length && memcmp(other, name.begin, length) == 0)
            return FAIL(r, column + 1, "column '%s' is there twice; the first is column %zu", other,
                        i + 1);
    }
    return MK_OK;
}

/* A header without `t`: what might have been meant. */
static enum mk_status no_time(struct reader *r, struct mk_span line)
{
    char text[SHOWN + 4];
    size_t length = (size_t)(line.end - line.begin);
    if (memchr(line.begin, ';', length) || memchr(line.begin, '\t', length))
        return FAIL(r, 0, "fields are separated by commas, but the header line is '%s'" FOREIGN,
                    shown(line, text));
    return FAIL(r, 0, "the header line names no column t (time in seconds): '%s'" FOREIGN,
                shown(line, text));
}

/* Some programs put names in quotes. */
static struct mk_span unquoted(struct mk_span s)
{
    bool quoted = s.end - s.begin >= 2 && *s.begin == '"' && s.end[-1] == '"';
    return quoted ? (struct mk_span){s.begin + 1, s.end - 1} : s;
}

static enum mk_status take_header(struct reader *r, struct mk_span line)
{
    struct mk_log *log = r->log;
    size_t count = count_fields(line);
    if (memchr(line.begin, '\0', (size_t)(line.end - line.begin)))
        return FAIL(r, 0, "a zero byte instead of column names: this is no text file");
    if (count > COLUMNS_MAX)
        return FAIL(r, 0, "%zu columns: a log has at most %d", count, COLUMNS_MAX);
    log->columns = calloc(count, sizeof *log->columns);
    if (!r->known)
        r->known = calloc(2 * count, sizeof *r->known);
    if (!log->columns || !r->known)
        return no_memory(r);
    r->textual = r->known + count;
    r->time_column = count;
    const char *at = line.begin;
    for (size_t i = 0; i < count; i++) {
        struct mk_span field = field_at(at, line.end);
        struct mk_span name = unquoted(trimmed(field));
        enum mk_status st = check_name(r, name, i);
        if (st != MK_OK)
            return st;
        char *copy = strndup(name.begin, (size_t)(name.end - name.begin));
        if (!copy)
            return no_memory(r);
        log->columns[log->column_count++].name = copy;
        r->known[i] = mk_log_column_is_known(copy);
        if (strcmp(copy, "t") == 0)
            r->time_column = i;
        at = field.end + 1;
    }
    return r->time_column < count ? MK_OK : no_time(r, line);
}

/* --- columns -------------------------------------------------------------------------- */

static bool resize(struct mk_log *log, size_t rows)
{
    for (size_t i = 0; i < log->column_count; i++) {
        struct mk_log_column *c = &log->columns[i];
        void *data = c->text ? realloc(c->text, rows * sizeof *c->text)
                             : realloc(c->data, rows * sizeof *c->data);
        if (!data)
            return false;
        if (c->text)
            c->text = data;
        else
            c->data = data;
    }
    return true;
}

static enum mk_status make_room(struct reader *r)
{
    if (r->log->rows < r->room_rows)
        return MK_OK;
    size_t rows = r->room_rows ? r->room_rows + r->room_rows / 2 : 1024;
    if (!resize(r->log, rows))
        return no_memory(r);
    r->room_rows = rows;
    return MK_OK;
}

/* A column of numbers becomes one of text. Its cells so far come back from the numbers, which is
 * not to the letter; so it happens before the first row, or where the file cannot be read again. */
static enum mk_status make_textual(struct reader *r, size_t column)
{
    struct mk_log_column *c = &r->log->columns[column];
    char **text = calloc(r->room_rows, sizeof *text);
    bool complete = text;
    for (size_t row = 0; complete && row < r->log->rows; row++) {
        char number[MK_NUMBER_MAX];
        mk_format_double(number, c->data[row]);
        text[row] = strdup(isnan(c->data[row]) ? "" : number);
        complete = text[row];
    }
    if (!complete) {
        for (size_t row = 0; text && row < r->log->rows; row++)
            free(text[row]);
        free(text);
        return no_memory(r);
    }
    free(c->data);
    c->data = NULL;
    c->text = text;
    return MK_OK;
}

/* A whole number that a double cannot hold (a time in ns, an identifier) would not survive. One
 * that it can hold may be a double that we wrote. */
static bool loses_digits(struct mk_span cell, double value)
{
    char held[DBL_MAX_10_EXP + 2];
    size_t length = (size_t)(cell.end - cell.begin);
    if (length <= 15 || memchr(cell.begin, '.', length) || fabs(value) < 9007199254740992.0)
        return false;
    while (cell.begin < cell.end &&
           (*cell.begin == '+' || *cell.begin == '-' || *cell.begin == '0'))
        cell.begin++;
    for (const char *p = cell.begin; p < cell.end; p++)
        if (*p < '0' || *p > '9')
            return false; /* an exponent, inf */
    length = (size_t)(cell.end - cell.begin);
    return !isfinite(value) || snprintf(held, sizeof held, "%.0f", fabs(value)) != (int)length ||
           memcmp(held, cell.begin, length) != 0;
}

static enum mk_status take_unknown_text(struct reader *r, size_t column)
{
    r->textual[column] = true;
    if (r->log->rows == 0 || !r->source.can_rewind)
        return make_textual(r, column);
    r->start_again = true;
    return MK_OK;
}

static enum mk_status take_text(struct reader *r, size_t column, struct mk_span field)
{
    struct mk_log_column *c = &r->log->columns[column];
    char *copy = strndup(field.begin, (size_t)(field.end - field.begin));
    if (!copy)
        return no_memory(r);
    c->text[r->log->rows] = copy;
    return MK_OK;
}

static enum mk_status take_field(struct reader *r, size_t column, struct mk_span field)
{
    struct mk_log_column *c = &r->log->columns[column];
    if (c->text)
        return take_text(r, column, field);
    double value = NAN;
    struct mk_span cell = trimmed(field);
    bool number = cell.begin == cell.end || mk_parse_double(cell.begin, cell.end, &value);
    if (r->known[column] && !number)
        return FAIL(r, column + 1,
                    "'%s' is not a number (column %s); a missing value is an empty field or nan",
                    shown(field, (char[SHOWN + 4]){0}), c->name);
    if (!r->known[column] && (!number || r->textual[column] || loses_digits(cell, value))) {
        enum mk_status st = take_unknown_text(r, column);
        return st != MK_OK || r->start_again ? st : take_text(r, column, field);
    }
    c->data[r->log->rows] = value;
    return MK_OK;
}

/* --- rows ----------------------------------------------------------------------------- */

static enum mk_status check_time(struct reader *r)
{
    const double *t = r->log->columns[r->time_column].data;
    size_t row = r->log->rows, field = r->time_column + 1;
    char now[MK_NUMBER_MAX], before[MK_NUMBER_MAX];
    if (isnan(t[row]))
        return FAIL(r, field, "the time is missing");
    if (isinf(t[row]))
        return FAIL(r, field, "the time is infinite");
    if (row == 0 || t[row] > t[row - 1])
        return MK_OK;
    mk_format_double(now, t[row]);
    mk_format_double(before, t[row - 1]);
    return FAIL(r, field, "time must increase from row to row: %s s follows %s s", now, before);
}

/* Whether the last line, which has no newline, stops before its end. A log of our own always ends
 * in one; in others a field is missing, or what is left of it is no number. */
static bool is_cut_off(const struct reader *r, struct mk_span line)
{
    const struct mk_log *log = r->log;
    if (r->ours || memchr(line.begin, '\0', (size_t)(line.end - line.begin)) ||
        count_fields(line) < log->column_count || line.end[-1] == ',')
        return true;
    const char *at = line.begin;
    for (size_t i = 0; i < log->column_count; i++) {
        struct mk_span field = field_at(at, line.end), cell = trimmed(field);
        double value;
        bool numeric = r->known[i] || (log->rows > 0 && !log->columns[i].text);
        if (numeric && cell.begin < cell.end && !mk_parse_double(cell.begin, cell.end, &value))
            return true;
        at = field.end + 1;
    }
    return false;
}

static enum mk_status take_fields(struct reader *r, struct mk_span line)
{
    size_t count = r->log->column_count, fields = count_fields(line);
    if (fields != count)
        return FAIL(r, fields < count ? fields : count + 1,
                    "the row has %zu field%s, the header names %zu", fields, fields == 1 ? "" : "s",
                    count);
    enum mk_status st = make_room(r);
    const char *at = line.begin;
    for (size_t i = 0; i < count && st == MK_OK && !r->start_again; i++) {
        struct mk_span field = field_at(at, line.end);
        st = take_field(r, i, field);
        r->taken += st == MK_OK && !r->start_again;
        at = field.end + 1;
    }
    return st;
}

/* The text of a row that is not going to count. */
static void drop_row(struct reader *r)
{
    for (size_t i = 0; i < r->taken; i++)
        if (r->log->columns[i].text)
            free(r->log->columns[i].text[r->log->rows]);
}

/* A sample that was dropped and left only its commas. */
static bool is_blank(struct mk_span line)
{
    while (line.begin < line.end && (*line.begin == ',' || *line.begin == ' '))
        line.begin++;
    return line.begin == line.end;
}

static enum mk_status take_row(struct reader *r, struct mk_span line)
{
    if (r->source.unterminated && is_cut_off(r, line)) {
        r->log->truncated = true;
        return MK_OK;
    }
    if (memchr(line.begin, '\0', (size_t)(line.end - line.begin)))
        return FAIL(r, 0, "a zero byte in the row: the file is damaged here, or is no text file");
    if (is_blank(line) && count_fields(line) == r->log->column_count)
        return skip(r, line);
    r->taken = 0;
    enum mk_status st = take_fields(r, line);
    if (st == MK_OK && !r->start_again)
        st = check_time(r);
    if (st != MK_OK || r->start_again) {
        drop_row(r);
        return st;
    }
    if (r->log->rows++ == 0)
        r->log->first_row_line = r->source.line;
    return MK_OK;
}

static enum mk_status take_line(struct reader *r, struct mk_span line)
{
    struct mk_span content = trimmed(line);
    if (content.begin == content.end)
        return skip(r, line);
    if (*content.begin != '#')
        return r->log->column_count ? take_row(r, line) : take_header(r, line);
    if (!r->source.unterminated || !r->ours)
        return take_meta(r, content);
    r->log->truncated = true;
    return MK_OK;
}

/* --- the whole ------------------------------------------------------------------------ */

/* Rows are left out where somebody marked them: an empty mark is none. */
static void clear_empty_marks(struct mk_log *log)
{
    for (size_t i = 0; i < log->column_count; i++) {
        struct mk_log_column *c = &log->columns[i];
        for (size_t k = 0; strcmp(c->name, "left_out") == 0 && k < log->rows; k++)
            if (isnan(c->data[k]))
                c->data[k] = 0.0;
    }
}

/* A run that begins behind its first row, or ages before it, is on another axis than t. */
static enum mk_status check_begins(const struct reader *r)
{
    const double first = r->log->columns[r->time_column].data[0];
    char begins[MK_NUMBER_MAX], first_row[MK_NUMBER_MAX];
    if (!r->begins_line || (r->begins <= first && r->begins >= first - BEGAN_BEFORE_MAX))
        return MK_OK;
    mk_format_double(begins, r->begins);
    mk_format_double(first_row, first);
    return mk_error_at(r->source.err, MK_ERR_PARSE, r->source.path, r->begins_line, 0,
                       BEGINS_KEY ": %s s is %s: expected a time on the axis of t, not later than "
                                  "the first row (%s s) and at most %g s before it",
                       begins, r->begins > first ? "later than the first row" : "too long ago",
                       first_row, BEGAN_BEFORE_MAX);
}

static enum mk_status end_log(struct reader *r)
{
    const char *missing = NULL;
    if (r->log->column_count == 0)
        missing = "no header line: expected column names such as t,q1,q2,u";
    else if (r->log->rows == 0 && r->log->truncated)
        missing = "the log has no rows: the only one is incomplete";
    else if (r->log->rows == 0)
        missing = "the log has no rows";
    if (missing)
        return mk_error_at(r->source.err, MK_ERR_PARSE, r->source.path, 0, 0, "%s", missing);
    enum mk_status st = check_begins(r);
    if (st != MK_OK)
        return st;
    clear_empty_marks(r->log);
    return resize(r->log, r->log->rows) ? MK_OK : no_memory(r);
}

static enum mk_status read_lines(struct reader *r)
{
    enum mk_status st;
    bool more = true;
    do {
        struct mk_span line;
        st = mk_line_source_next(&r->source, &line, &more);
        if (st == MK_OK && more)
            st = take_line(r, line);
    } while (st == MK_OK && more && !r->start_again);
    return st;
}

static enum mk_status read_log(struct reader *r)
{
    for (;;) {
        if (mk_log_create(0, &r->log) != MK_OK || !(r->log->path = strdup(r->source.path)))
            return no_memory(r);
        enum mk_status st = read_lines(r);
        if (st != MK_OK || !r->start_again)
            return st == MK_OK ? end_log(r) : st;
        mk_log_free(r->log);
        r->log = NULL;
        st = mk_line_source_rewind(&r->source);
        if (st != MK_OK)
            return st;
        r->room_rows = 0;
        r->start_again = r->ours = false;
        r->meta_bytes = 0;
        r->skipped_bytes = 0;
        r->begins_line = 0;
    }
}

enum mk_status mk_log_read(const char *path, struct mk_log **out, struct mk_error *err)
{
    struct reader r = {0};
    *out = NULL;
    enum mk_status st = mk_line_source_open(&r.source, path, err);
    if (st != MK_OK)
        return st;
    st = read_log(&r);
    mk_line_source_close(&r.source);
    free(r.known);
    if (st == MK_OK)
        *out = r.log;
    else
        mk_log_free(r.log);
    return st;
}
