/* Reading logs: streamed line by line (plain or gzip), so that memory is the columns alone. */
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include "base/log_priv.h"
#include "mechkit/number.h"

#define CHUNK ((size_t)1 << 16)
#define LINE_MAX_BYTES ((size_t)1 << 20) /* beyond that it is no text file */

struct reader {
    const char *path;
    struct mk_error *err;
    gzFile file;
    char *buffer; /* one line and what was read beyond it */
    size_t size, begin, end;
    bool at_end;
    int line;        /* number of the current line */
    bool terminated; /* the current line ended in a newline */
    struct mk_log *log;
    size_t capacity; /* rows there is room for */
    int time_column;
    double last_time;
    bool ours; /* has mechkit-log metadata: complete lines end in a newline */
};

static enum mk_status fail(struct reader *r, enum mk_status status, int column, const char *what)
{
    return mk_error_at(r->err, status, r->path, r->line, column, "%s", what);
}

static enum mk_status no_memory(struct reader *r)
{
    return mk_error_at(r->err, MK_ERR_NOMEM, r->path, 0, 0, "out of memory");
}

/* --- lines ------------------------------------------------------------------------------- */

static enum mk_status fill(struct reader *r)
{
    if (r->begin > 0) {
        memmove(r->buffer, r->buffer + r->begin, r->end - r->begin);
        r->end -= r->begin;
        r->begin = 0;
    }
    if (r->size - r->end < CHUNK) {
        if (r->end > LINE_MAX_BYTES)
            return fail(r, MK_ERR_PARSE, 0, "the line is longer than 1 MiB: this is no log");
        char *more = realloc(r->buffer, r->size + CHUNK);
        if (!more)
            return no_memory(r);
        r->buffer = more;
        r->size += CHUNK;
    }
    int n = gzread(r->file, r->buffer + r->end, (unsigned)CHUNK);
    if (n < 0 || (n == 0 && !gzeof(r->file))) {
        int code = 0;
        const char *why = gzerror(r->file, &code);
        return mk_error_at(r->err, MK_ERR_IO, r->path, 0, 0, "cannot read: %s",
                           code == Z_ERRNO ? strerror(errno) : why);
    }
    if (n == 0) {
        int code = 0;
        gzerror(r->file, &code);
        if (code == Z_BUF_ERROR)
            return mk_error_at(r->err, MK_ERR_IO, r->path, 0, 0,
                               "the compressed file ends in the middle: it is damaged");
        r->at_end = true;
    }
    r->end += (size_t)n;
    return MK_OK;
}

/* The next line, without its end, in [*text, *stop). MK_ERR_NOTFOUND at the end of the file. */
static enum mk_status next_line(struct reader *r, char **text, char **stop)
{
    size_t looked = 0;
    for (;;) {
        char *from = r->buffer + r->begin + looked;
        char *newline = memchr(from, '\n', r->end - r->begin - looked);
        looked = r->end - r->begin;
        if (!newline && !r->at_end) {
            enum mk_status st = fill(r);
            if (st != MK_OK)
                return st;
            continue;
        }
        if (!newline && looked == 0)
            return MK_ERR_NOTFOUND;
        *text = r->buffer + r->begin;
        *stop = newline ? newline : r->buffer + r->end;
        r->terminated = newline != NULL;
        r->begin = (size_t)(*stop - r->buffer) + (newline ? 1 : 0);
        r->line++;
        if (memchr(*text, '\0', (size_t)(*stop - *text)))
            return fail(r, MK_ERR_PARSE, 0, "a zero byte: this is no text file");
        if (*stop > *text && (*stop)[-1] == '\r')
            --*stop;
        if (r->line == 1 && *stop - *text >= 3 && memcmp(*text, "\xef\xbb\xbf", 3) == 0)
            *text += 3;
        return MK_OK;
    }
}

static bool is_blank(const char *a, const char *b)
{
    while (a < b && (*a == ' ' || *a == '\t'))
        a++;
    return a == b;
}

static void trim(const char **a, const char **b)
{
    while (*a < *b && (**a == ' ' || **a == '\t'))
        ++*a;
    while (*b > *a && ((*b)[-1] == ' ' || (*b)[-1] == '\t'))
        --*b;
}

/* --- metadata and header ----------------------------------------------------------------- */

static enum mk_status on_comment(struct reader *r, const char *a, const char *b)
{
    const char *colon = memchr(a, ':', (size_t)(b - a));
    const char *key = a + 1, *key_end = colon ? colon : a + 1;
    const char *value = colon ? colon + 1 : a + 1, *value_end = b;
    trim(&key, &key_end);
    trim(&value, &value_end);
    enum mk_status st = mk_log_append_meta(r->log, key, (size_t)(key_end - key), value,
                                           (size_t)(value_end - value));
    if (st == MK_OK && mk_log_find_meta(r->log, "mechkit-log"))
        r->ours = true;
    return st == MK_OK ? MK_OK : no_memory(r);
}

static enum mk_status add_named_column(struct reader *r, const char *a, const char *b, int number)
{
    trim(&a, &b);
    if (b - a >= 2 && *a == '"' && b[-1] == '"')
        a++, b--;
    double number_value;
    if (a == b)
        return fail(r, MK_ERR_PARSE, number, "a column without a name in the header line");
    if (mk_parse_double(a, b, &number_value) && !isnan(number_value))
        return fail(r, MK_ERR_PARSE, number,
                    "a number where the header line should name a column, e.g. t,q1,q2,u");
    char *name = strndup(a, (size_t)(b - a));
    if (!name)
        return no_memory(r);
    enum mk_status st = MK_OK;
    for (size_t c = 0; c < r->log->column_count; c++)
        if (strcmp(r->log->columns[c].name, name) == 0)
            st = mk_error_at(r->err, MK_ERR_PARSE, r->path, r->line, number,
                             "column '%s' is there twice", name);
    if (st == MK_OK && !mk_log_add_column(r->log, name))
        st = no_memory(r);
    if (st == MK_OK && strcmp(name, "t") == 0)
        r->time_column = number - 1;
    free(name);
    return st;
}

static enum mk_status on_header(struct reader *r, const char *a, const char *b)
{
    for (int number = 1;; number++) {
        const char *comma = memchr(a, ',', (size_t)(b - a));
        enum mk_status st = add_named_column(r, a, comma ? comma : b, number);
        if (st != MK_OK)
            return st;
        if (!comma)
            break;
        a = comma + 1;
    }
    if (r->time_column < 0)
        return fail(r, MK_ERR_PARSE, 0, "the header line names no column t (time in seconds)");
    return MK_OK;
}

/* --- rows -------------------------------------------------------------------------------- */

static bool is_known(const char *name)
{
    static const char *const known[] = {
        "t",     "q1",   "q2",      "u",     "tau",     "u1",       "u2",
        "tau1",  "tau2", "dq1",     "dq2",   "enc1",    "enc2",     "ref",
        "phase", "tick", "late_us", "flags", "tau_cmd", "tau1_cmd", "tau2_cmd"};
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
        if (strcmp(known[i], name) == 0)
            return true;
    return false;
}

static enum mk_status grow(struct reader *r)
{
    size_t capacity = r->capacity ? r->capacity * 2 : 1024;
    for (size_t c = 0; c < r->log->column_count; c++) {
        struct mk_log_column *column = &r->log->columns[c];
        double *data = realloc(column->data, capacity * sizeof *data);
        if (!data)
            return no_memory(r);
        column->data = data;
        if (!column->text)
            continue;
        char **text = realloc(column->text, capacity * sizeof *text);
        if (!text)
            return no_memory(r);
        column->text = text;
    }
    r->capacity = capacity;
    return MK_OK;
}

/* A column that turned out to hold text: what was read as numbers becomes text again. */
static enum mk_status make_text_column(struct reader *r, struct mk_log_column *column)
{
    char **text = calloc(r->capacity, sizeof *text);
    if (!text)
        return no_memory(r);
    column->text = text;
    for (size_t i = 0; i < r->log->rows; i++) {
        char number[MK_NUMBER_MAX] = "";
        if (!isnan(column->data[i]))
            mk_format_double(number, column->data[i]);
        if (!(text[i] = strdup(number)))
            return no_memory(r);
    }
    return MK_OK;
}

static enum mk_status bad_cell(struct reader *r, const struct mk_log_column *column, int number,
                               const char *a, const char *b)
{
    int n = b - a > 40 ? 40 : (int)(b - a);
    return mk_error_at(r->err, MK_ERR_PARSE, r->path, r->line, number,
                       "'%.*s' is not a number (column %s)", n, a, column->name);
}

static enum mk_status on_cell(struct reader *r, size_t c, const char *a, const char *b)
{
    struct mk_log_column *column = &r->log->columns[c];
    size_t row = r->log->rows;
    double value = (double)NAN;
    bool number = is_blank(a, b) || mk_parse_double(a, b, &value);
    if (!number && is_known(column->name))
        return bad_cell(r, column, (int)c + 1, a, b);
    if (!number && !column->text) {
        enum mk_status st = make_text_column(r, column);
        if (st != MK_OK)
            return st;
    }
    column->data[row] = value;
    if (column->text && !(column->text[row] = strndup(a, (size_t)(b - a))))
        return no_memory(r);
    return MK_OK;
}

static void drop_row_text(struct reader *r)
{
    for (size_t c = 0; c < r->log->column_count; c++) {
        struct mk_log_column *column = &r->log->columns[c];
        if (column->text) {
            free(column->text[r->log->rows]);
            column->text[r->log->rows] = NULL;
        }
    }
}

static int count_fields(const char *a, const char *b)
{
    int n = 1;
    for (; a < b; a++)
        n += *a == ',';
    return n;
}

/* Time must be there and increase; a row that is empty altogether is a dropped sample without one.
 */
static enum mk_status check_time(struct reader *r, bool *skip)
{
    double t = r->log->columns[r->time_column].data[r->log->rows];
    *skip = false;
    if (!isfinite(t)) {
        for (size_t c = 0; c < r->log->column_count; c++)
            if (!isnan(r->log->columns[c].data[r->log->rows]))
                return fail(r, MK_ERR_PARSE, r->time_column + 1, "the time is missing");
        *skip = true;
        return MK_OK;
    }
    if (r->log->rows > 0 && !(t > r->last_time))
        return mk_error_at(r->err, MK_ERR_PARSE, r->path, r->line, r->time_column + 1,
                           "time must increase: %.10g s after %.10g s", t, r->last_time);
    r->last_time = t;
    return MK_OK;
}

static enum mk_status on_row(struct reader *r, const char *a, const char *b)
{
    size_t columns = r->log->column_count;
    int fields = count_fields(a, b);
    if ((size_t)fields != columns)
        return mk_error_at(r->err, MK_ERR_PARSE, r->path, r->line,
                           fields < (int)columns ? fields : (int)columns + 1,
                           "the row has %d fields, the header names %zu", fields, columns);
    if (r->log->rows == r->capacity) {
        enum mk_status st = grow(r);
        if (st != MK_OK)
            return st;
    }
    for (size_t c = 0; c < columns; c++)
        if (r->log->columns[c].text)
            r->log->columns[c].text[r->log->rows] = NULL;
    for (size_t c = 0; c < columns; c++) {
        const char *comma = memchr(a, ',', (size_t)(b - a));
        enum mk_status st = on_cell(r, c, a, comma ? comma : b);
        if (st != MK_OK) {
            drop_row_text(r);
            return st;
        }
        a = comma ? comma + 1 : b;
    }
    bool skip;
    enum mk_status st = check_time(r, &skip);
    if (st != MK_OK || skip) {
        drop_row_text(r);
        return st;
    }
    if (r->log->rows == 0)
        r->log->first_row_line = r->line;
    r->log->rows++;
    return MK_OK;
}

/* --- the whole file ---------------------------------------------------------------------- */

static enum mk_status on_line(struct reader *r, const char *a, const char *b)
{
    if (is_blank(a, b))
        return MK_OK;
    if (*a == '#')
        return on_comment(r, a, b);
    if (r->log->column_count == 0)
        return on_header(r, a, b);
    /* A crash leaves half a line; ours always end in a newline, others may leave out the last one.
     */
    if (!r->terminated && r->ours) {
        r->log->truncated = true;
        return MK_OK;
    }
    enum mk_status st = on_row(r, a, b);
    if (st == MK_ERR_PARSE && !r->terminated && r->log->rows > 0) {
        if (r->err)
            *r->err = (struct mk_error)MK_ERROR_INIT;
        r->log->truncated = true;
        st = MK_OK;
    }
    return st;
}

static enum mk_status read_all(struct reader *r)
{
    char *text, *stop;
    enum mk_status st;
    while ((st = next_line(r, &text, &stop)) == MK_OK) {
        st = on_line(r, text, stop);
        if (st != MK_OK)
            return st;
    }
    if (st != MK_ERR_NOTFOUND)
        return st;
    if (r->log->column_count == 0)
        return mk_error_at(r->err, MK_ERR_PARSE, r->path, 0, 0,
                           "no header line: expected column names such as t,q1,q2,u");
    if (r->log->rows == 0)
        return mk_error_at(r->err, MK_ERR_PARSE, r->path, 0, 0, "the log has no rows");
    return MK_OK;
}

static enum mk_status open_file(struct reader *r)
{
    struct stat info;
    int fd = open(r->path, O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return mk_error_errno(r->err, errno, r->path, "cannot open the log");
    if (fstat(fd, &info) == 0 && S_ISDIR(info.st_mode)) {
        close(fd);
        return mk_error_at(r->err, MK_ERR_IO, r->path, 0, 0, "this is a directory, not a log");
    }
    r->file = gzdopen(fd, "rb");
    if (!r->file) {
        close(fd);
        return no_memory(r);
    }
    gzbuffer(r->file, 1 << 17);
    return MK_OK;
}

enum mk_status mk_log_read(const char *path, struct mk_log **out, struct mk_error *err)
{
    struct reader r = {.path = path, .err = err, .time_column = -1};
    *out = NULL;
    enum mk_status st = open_file(&r);
    if (st != MK_OK)
        return st;
    st = mk_log_create(0, &r.log);
    if (st == MK_OK) {
        r.log->path = strdup(path);
        r.buffer = malloc(r.size = 2 * CHUNK);
        st = r.buffer && r.log->path ? read_all(&r) : no_memory(&r);
    }
    free(r.buffer);
    gzclose(r.file);
    if (st == MK_OK)
        *out = r.log;
    else
        mk_log_free(r.log);
    return st;
}
