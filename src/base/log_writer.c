/* A log that grows while a run goes on. Rows are formatted into one buffer; write(2) gets whole
 * lines only, so that whatever ends the program leaves whole lines in the file. */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/log_priv.h"
#include "base/number_priv.h"
#include "base/out_file.h"
#include "mechkit/number.h"

#define BUFFER (1u << 16)

struct mk_log_writer {
    char *path;
    int fd;
    size_t column_count;
    off_t written; /* bytes of whole lines in the file */
    struct mk_lines lines;
    struct mk_error failure; /* the first one; it stays */
};

static enum mk_status report(const struct mk_log_writer *w, struct mk_error *err)
{
    if (err && w->failure.status != MK_OK)
        *err = w->failure;
    return w->failure.status;
}

static enum mk_status hand_over(struct mk_log_writer *w)
{
    if (w->failure.status != MK_OK)
        return w->failure.status;
    if (w->lines.failed)
        return mk_error_at(&w->failure, MK_ERR_NOMEM, w->path, 0, 0, "out of memory");
    if (w->lines.used == 0)
        return MK_OK;
    size_t done;
    int failure = mk_write_all(w->fd, w->lines.text, w->lines.used, &done);
    if (failure) {
        /* Part of a line at the end would be read as a crash: keep the whole ones. */
        const char *last = done ? memrchr(w->lines.text, '\n', done) : NULL;
        w->written += last ? last + 1 - w->lines.text : 0;
        (void)!ftruncate(w->fd, w->written);
        return mk_error_errno(&w->failure, failure, w->path, "cannot write the log");
    }
    w->written += (off_t)done;
    w->lines.used = 0;
    return MK_OK;
}

static enum mk_status check_names(const char *path, const char *const *columns, size_t count,
                                  struct mk_error *err)
{
    const char *bad;
    const char *problem = mk_log_names_problem(columns, count, &bad);
    if (!problem)
        return MK_OK;
    return mk_error_at(err, MK_ERR_INVALID, path, 0, 0, "column '%s' %s", bad, problem);
}

static enum mk_status open_file(struct mk_log_writer *w, bool overwrite, struct mk_error *err)
{
    int how = O_WRONLY | O_CREAT | O_CLOEXEC | (overwrite ? O_TRUNC : O_EXCL);
    w->fd = open(w->path, how, 0666);
    if (w->fd >= 0)
        return MK_OK;
    if (errno == EEXIST)
        return mk_error_at(err, MK_ERR_IO, w->path, 0, 0,
                           "the file exists already: choose another name or allow overwriting it");
    return mk_error_errno(err, errno, w->path, "cannot write the log");
}

enum mk_status mk_log_writer_open(const char *path, bool overwrite, const struct mk_log_meta *meta,
                                  size_t meta_count, const char *const *columns,
                                  size_t column_count, struct mk_log_writer **out,
                                  struct mk_error *err)
{
    *out = NULL;
    enum mk_status st = check_names(path, columns, column_count, err);
    if (st != MK_OK)
        return st;
    struct mk_log_writer *w = calloc(1, sizeof *w);
    if (w)
        w->path = strdup(path);
    if (!w || !w->path || !mk_lines_reserve(&w->lines, 2 * BUFFER)) {
        st = mk_error_at(err, MK_ERR_NOMEM, path, 0, 0, "out of memory");
        goto fail;
    }
    w->column_count = column_count;
    st = open_file(w, overwrite, err);
    if (st != MK_OK)
        goto fail;
    mk_lines_preamble(&w->lines, meta, meta_count);
    mk_lines_names(&w->lines, columns, column_count);
    st = mk_log_writer_flush(w, err);
    if (st != MK_OK) {
        close(w->fd);
        goto fail;
    }
    *out = w;
    return MK_OK;
fail:
    if (w) {
        mk_lines_free(&w->lines);
        free(w->path);
        free(w);
    }
    return st;
}

enum mk_status mk_log_writer_row(struct mk_log_writer *w, const double *values)
{
    if (w->failure.status != MK_OK)
        return w->failure.status;
    char *at = mk_lines_reserve(&w->lines, w->column_count * MK_NUMBER_MAX + MK_FIELD_ROOM);
    if (!at)
        return hand_over(w);
    size_t last = w->column_count - 1;
    for (size_t i = 0; i < last; i++)
        at = mk_format_field(at, values[i], ',');
    at = mk_format_field(at, values[last], '\n');
    w->lines.used = (size_t)(at - w->lines.text);
    return w->lines.used < BUFFER ? MK_OK : hand_over(w);
}

enum mk_status mk_log_writer_note(struct mk_log_writer *w, const char *key, const char *value)
{
    if (w->failure.status != MK_OK)
        return w->failure.status;
    if (!key[0] || strpbrk(key, ":\r\n"))
        return MK_ERR_INVALID;
    mk_lines_meta(&w->lines, key, value);
    return w->lines.used < BUFFER && !w->lines.failed ? MK_OK : hand_over(w);
}

enum mk_status mk_log_writer_flush(struct mk_log_writer *w, struct mk_error *err)
{
    hand_over(w);
    return report(w, err);
}

enum mk_status mk_log_writer_close(struct mk_log_writer *w, struct mk_error *err)
{
    if (!w)
        return MK_OK;
    hand_over(w);
    int failure = mk_close_written(w->fd, mk_sync(w->fd));
    if (failure && w->failure.status == MK_OK)
        mk_error_errno(&w->failure, failure, w->path, "cannot write the log");
    enum mk_status st = report(w, err);
    mk_lines_free(&w->lines);
    free(w->path);
    free(w);
    return st;
}
