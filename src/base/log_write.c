/* Writing logs: whole, or row by row while a run goes on. */
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <zlib.h>

#include "base/log_priv.h"
#include "mechkit/number.h"

#define BUFFER ((size_t)1 << 16)

/* Text on its way to a file descriptor or a compressor; only whole lines are handed over. */
struct sink {
    int fd;
    gzFile gz; /* instead of fd */
    char *buffer;
    size_t used, size;
    size_t line; /* where the line being written began */
    off_t good;  /* bytes of whole lines on disk */
    int failed;  /* errno of the first failure; 0: none */
};

static bool sink_reserve(struct sink *s, size_t more)
{
    if (s->failed)
        return false;
    if (s->used + more <= s->size)
        return true;
    size_t size = s->size * 2 > s->used + more ? s->size * 2 : s->used + more + BUFFER;
    char *buffer = realloc(s->buffer, size);
    if (!buffer) {
        s->failed = ENOMEM;
        return false;
    }
    s->buffer = buffer;
    s->size = size;
    return true;
}

static void sink_put(struct sink *s, const char *text, size_t n)
{
    if (!sink_reserve(s, n))
        return;
    memcpy(s->buffer + s->used, text, n);
    s->used += n;
}

static void sink_text(struct sink *s, const char *text)
{
    sink_put(s, text, strlen(text));
}

/* NaN is an empty field. */
static void sink_number(struct sink *s, double value)
{
    if (isnan(value) || !sink_reserve(s, MK_NUMBER_MAX))
        return;
    s->used += mk_format_double(s->buffer + s->used, value);
}

/* Metadata must stay on its line. */
static void sink_meta(struct sink *s, const char *key, const char *value)
{
    sink_text(s, "# ");
    size_t from = s->used;
    sink_text(s, key);
    if (*key)
        sink_text(s, ": ");
    sink_text(s, value);
    for (size_t i = from; i < s->used && !s->failed; i++)
        if (s->buffer[i] == '\n' || s->buffer[i] == '\r')
            s->buffer[i] = ' ';
}

static int write_fd(struct sink *s, const char *at, size_t n)
{
    while (n > 0) {
        ssize_t done = write(s->fd, at, n);
        if (done < 0 && errno == EINTR)
            continue;
        if (done < 0)
            return errno;
        at += done;
        n -= (size_t)done;
    }
    return 0;
}

static void sink_flush(struct sink *s)
{
    if (s->failed || s->line == 0)
        return;
    if (s->gz) {
        if (gzwrite(s->gz, s->buffer, (unsigned)s->line) != (int)s->line)
            s->failed = errno ? errno : EIO;
    } else if ((s->failed = write_fd(s, s->buffer, s->line)) != 0) {
        /* A full disk must not leave half a line: cut back to the last whole one. */
        if (s->good >= 0 && ftruncate(s->fd, s->good) != 0)
            s->good = -1;
        return;
    }
    s->good += (off_t)s->line;
    memmove(s->buffer, s->buffer + s->line, s->used - s->line);
    s->used -= s->line;
    s->line = 0;
}

static void sink_end_line(struct sink *s)
{
    sink_put(s, "\n", 1);
    s->line = s->used;
    if (s->used >= BUFFER)
        sink_flush(s);
}

static bool sink_open(struct sink *s, int fd, bool compressed)
{
    *s = (struct sink){.fd = fd, .buffer = malloc(2 * BUFFER), .size = 2 * BUFFER};
    if (compressed && s->buffer && !(s->gz = gzdopen(fd, "wb6"))) {
        free(s->buffer);
        s->buffer = NULL;
    }
    return s->buffer != NULL;
}

/* Everything to disk; returns the errno of the first failure. */
static int sink_close(struct sink *s)
{
    sink_flush(s);
    if (s->gz) {
        int copy = dup(s->fd); /* gzclose closes its own; fsync wants one */
        if (gzclose(s->gz) != Z_OK && !s->failed)
            s->failed = errno ? errno : EIO;
        s->fd = copy;
    }
    if (s->fd >= 0) {
        if (fsync(s->fd) != 0 && errno != EINVAL && errno != EROFS && !s->failed)
            s->failed = errno;
        if (close(s->fd) != 0 && !s->failed)
            s->failed = errno;
    }
    free(s->buffer);
    return s->failed;
}

/* --- a whole log ------------------------------------------------------------------------- */

static void put_log(struct sink *s, const struct mk_log *log)
{
    if (!mk_log_find_meta(log, "mechkit-log")) {
        sink_meta(s, "mechkit-log", "1");
        sink_end_line(s);
    }
    for (size_t i = 0; i < log->meta_count; i++) {
        sink_meta(s, log->meta[i].key, log->meta[i].value);
        sink_end_line(s);
    }
    for (size_t c = 0; c < log->column_count; c++) {
        sink_text(s, c ? "," : "");
        sink_text(s, log->columns[c].name);
    }
    sink_end_line(s);
    for (size_t r = 0; r < log->rows && !s->failed; r++) {
        for (size_t c = 0; c < log->column_count; c++) {
            const struct mk_log_column *column = &log->columns[c];
            if (c)
                sink_put(s, ",", 1);
            if (column->text)
                sink_text(s, column->text[r]);
            else
                sink_number(s, column->data[r]);
        }
        sink_end_line(s);
    }
}

enum mk_status mk_log_write(const char *path, const struct mk_log *log, struct mk_error *err)
{
    size_t size = strlen(path) + 16;
    char *temporary = malloc(size);
    if (!temporary)
        return mk_error_at(err, MK_ERR_NOMEM, path, 0, 0, "out of memory");
    snprintf(temporary, size, "%s.tmp%d", path, (int)getpid());
    int why = 0;
    int fd = open(temporary, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    struct sink s;
    if (fd < 0) {
        why = errno;
    } else if (!sink_open(&s, fd, mk_log_path_is_compressed(path))) {
        why = ENOMEM;
        close(fd);
    } else {
        put_log(&s, log);
        why = sink_close(&s);
    }
    if (!why && rename(temporary, path) != 0)
        why = errno;
    if (fd >= 0 && why)
        unlink(temporary);
    free(temporary);
    return why ? mk_error_errno(err, why, path, "cannot write the log") : MK_OK;
}

/* --- row by row -------------------------------------------------------------------------- */

struct mk_log_writer {
    struct sink sink;
    size_t column_count;
    char *path;
};

static void put_start(struct sink *s, const struct mk_log_meta *meta, size_t meta_count,
                      const char *const *columns, size_t column_count)
{
    bool has_version = false;
    for (size_t i = 0; i < meta_count; i++)
        has_version = has_version || strcmp(meta[i].key, "mechkit-log") == 0;
    if (!has_version) {
        sink_meta(s, "mechkit-log", "1");
        sink_end_line(s);
    }
    for (size_t i = 0; i < meta_count; i++) {
        sink_meta(s, meta[i].key, meta[i].value);
        sink_end_line(s);
    }
    for (size_t c = 0; c < column_count; c++) {
        sink_text(s, c ? "," : "");
        sink_text(s, columns[c]);
    }
    sink_end_line(s);
}

enum mk_status mk_log_writer_open(const char *path, bool overwrite, const struct mk_log_meta *meta,
                                  size_t meta_count, const char *const *columns,
                                  size_t column_count, struct mk_log_writer **out,
                                  struct mk_error *err)
{
    *out = NULL;
    int flags = O_WRONLY | O_CREAT | O_CLOEXEC | (overwrite ? O_TRUNC : O_EXCL);
    int fd = open(path, flags, 0666);
    if (fd < 0)
        return mk_error_errno(err, errno, path, "cannot write the log");
    struct mk_log_writer *w = calloc(1, sizeof *w);
    char *copy = strdup(path);
    if (!w || !copy || !sink_open(&w->sink, fd, false)) {
        free(w);
        free(copy);
        close(fd);
        return mk_error_at(err, MK_ERR_NOMEM, path, 0, 0, "out of memory");
    }
    w->path = copy;
    w->column_count = column_count;
    put_start(&w->sink, meta, meta_count, columns, column_count);
    enum mk_status st = mk_log_writer_flush(w, err);
    if (st != MK_OK)
        mk_log_writer_close(w, NULL);
    else
        *out = w;
    return st;
}

static enum mk_status result(const struct mk_log_writer *w, struct mk_error *err)
{
    if (!w->sink.failed)
        return MK_OK;
    return mk_error_errno(err, w->sink.failed, w->path, "cannot write the log");
}

enum mk_status mk_log_writer_row(struct mk_log_writer *w, const double *values)
{
    for (size_t c = 0; c < w->column_count; c++) {
        if (c)
            sink_put(&w->sink, ",", 1);
        sink_number(&w->sink, values[c]);
    }
    sink_end_line(&w->sink);
    return result(w, NULL);
}

enum mk_status mk_log_writer_note(struct mk_log_writer *w, const char *key, const char *value)
{
    sink_meta(&w->sink, key, value);
    sink_end_line(&w->sink);
    return result(w, NULL);
}

enum mk_status mk_log_writer_flush(struct mk_log_writer *w, struct mk_error *err)
{
    sink_flush(&w->sink);
    return result(w, err);
}

enum mk_status mk_log_writer_close(struct mk_log_writer *w, struct mk_error *err)
{
    if (!w)
        return MK_OK;
    sink_close(&w->sink);
    enum mk_status st = result(w, err);
    free(w->path);
    free(w);
    return st;
}
