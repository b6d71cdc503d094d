/* A whole log to a file, plain or compressed. */
#include <errno.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <zlib.h>

#include "base/log_priv.h"
#include "base/number_priv.h"
#include "base/out_file.h"
#include "mechkit/number.h"

#define CHUNK (1u << 16)

/* The out file, and the compressor before it when the name ends in .gz. */
struct sink {
    struct mk_out_file file;
    gzFile gz;
    struct mk_error *err;
};

/* `number` is what zlib says; errno counts where that is Z_ERRNO. */
static enum mk_status gz_failure(struct sink *s, int number)
{
    int failure = number == Z_ERRNO ? errno : number == Z_MEM_ERROR ? ENOMEM : EIO;
    return mk_error_errno(s->err, failure, s->file.path, "cannot write");
}

static enum mk_status sink_open(struct sink *s, const char *path, struct mk_error *err)
{
    *s = (struct sink){.err = err};
    enum mk_status st = mk_out_file_open(&s->file, path, err);
    if (st != MK_OK || !mk_log_path_is_compressed(path))
        return st;
    int own = dup(s->file.fd); /* gzclose closes it; commit still needs the other */
    s->gz = own >= 0 ? gzdopen(own, "wb6") : NULL;
    if (s->gz)
        return MK_OK;
    st = mk_error_errno(err, own >= 0 ? ENOMEM : errno, path, "cannot write");
    if (own >= 0)
        close(own);
    mk_out_file_abandon(&s->file);
    return st;
}

static enum mk_status sink_write(struct sink *s, const char *data, size_t size)
{
    if (!s->gz)
        return mk_out_file_write(&s->file, data, size, s->err);
    while (size > 0) {
        unsigned part = size < CHUNK ? (unsigned)size : CHUNK;
        if (gzwrite(s->gz, data, part) != (int)part) {
            int number;
            gzerror(s->gz, &number);
            return gz_failure(s, number);
        }
        data += part;
        size -= part;
    }
    return MK_OK;
}

/* Closes whatever happened before; `st` is that. */
static enum mk_status sink_close(struct sink *s, enum mk_status st)
{
    if (s->gz) {
        int closed = gzclose_w(s->gz);
        if (closed != Z_OK && st == MK_OK)
            st = gz_failure(s, closed);
    }
    return mk_out_file_finish(&s->file, st, s->err);
}

static enum mk_status no_memory(const char *path, struct mk_error *err)
{
    return mk_error_at(err, MK_ERR_NOMEM, path, 0, 0, "out of memory");
}

/* The header line; the row of names is checked on the way. */
static enum mk_status put_header(struct mk_lines *lines, const char *path, const struct mk_log *log,
                                 struct mk_error *err)
{
    const char **names = malloc((log->column_count + 1) * sizeof *names);
    if (!names)
        return no_memory(path, err);
    for (size_t i = 0; i < log->column_count; i++)
        names[i] = log->columns[i].name;
    const char *bad;
    const char *problem = mk_log_names_problem(names, log->column_count, &bad);
    enum mk_status st = MK_OK;
    if (problem)
        st = mk_error_at(err, MK_ERR_INVALID, path, 0, 0, "column '%s' %s", bad, problem);
    else
        mk_lines_names(lines, names, log->column_count);
    free(names);
    return st;
}

/* Room that a row needs at most. */
static size_t row_size(const struct mk_log *log, size_t row)
{
    size_t size = log->column_count * MK_NUMBER_MAX + MK_FIELD_ROOM;
    for (size_t i = 0; i < log->column_count; i++)
        if (log->columns[i].text)
            size += strlen(log->columns[i].text[row]);
    return size;
}

static void put_row(struct mk_lines *lines, const struct mk_log *log, size_t row)
{
    char *at = mk_lines_reserve(lines, row_size(log, row));
    if (!at)
        return;
    for (size_t i = 0; i < log->column_count; i++) {
        const struct mk_log_column *column = &log->columns[i];
        char separator = i + 1 < log->column_count ? ',' : '\n';
        if (column->text) {
            at = stpcpy(at, column->text[row]);
            *at++ = separator;
        } else {
            at = mk_format_field(at, column->data[row], separator);
        }
    }
    lines->used = (size_t)(at - lines->text);
}

static enum mk_status put_rows(struct sink *s, struct mk_lines *lines, const struct mk_log *log)
{
    for (size_t row = 0; row < log->rows; row++) {
        put_row(lines, log, row);
        if (lines->used < CHUNK)
            continue;
        enum mk_status st = sink_write(s, lines->text, lines->used);
        if (st != MK_OK)
            return st;
        lines->used = 0;
    }
    if (lines->failed)
        return no_memory(s->file.path, s->err);
    return sink_write(s, lines->text, lines->used);
}

enum mk_status mk_log_write(const char *path, const struct mk_log *log, struct mk_error *err)
{
    struct mk_lines lines = {0};
    struct sink s;
    mk_lines_preamble(&lines, log->meta, log->meta_count);
    enum mk_status st = put_header(&lines, path, log, err);
    if (st == MK_OK)
        st = sink_open(&s, path, err);
    if (st == MK_OK)
        st = sink_close(&s, put_rows(&s, &lines, log));
    mk_lines_free(&lines);
    return st;
}
