/* MAT files of other people as tables: whatever numbers they hold, by name. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "exchange/scan_mat.h"
#include "exchange/source.h"

static int by_length(const void *a, const void *b)
{
    const struct mat_vector *x = a, *y = b;
    return (x->rows > y->rows) - (x->rows < y->rows);
}

/* The length of the column of that name; else the one that most columns have, of two the longer. */
static size_t usual_length(const struct mat_scan *c, const char *like)
{
    for (size_t i = 0; like && i < c->count; i++)
        if (strcmp(c->vector[i].name, like) == 0)
            return c->vector[i].rows;
    struct mat_vector *sorted = malloc(sizeof *sorted * (c->count + 1));
    size_t best = 0, votes = 0, same = 0;
    if (!sorted)
        return 0;
    if (c->count > 0)
        memcpy(sorted, c->vector, sizeof *sorted * c->count);
    qsort(sorted, c->count, sizeof *sorted, by_length);
    for (size_t i = 0; i < c->count; i++) {
        same = i > 0 && sorted[i].rows == sorted[i - 1].rows ? same + 1 : 1;
        if (same >= votes) {
            votes = same;
            best = sorted[i].rows;
        }
    }
    free(sorted);
    return best;
}

static enum mk_status as_table(struct mat_scan *c, const char *path, const char *like,
                               struct mk_table **out, struct mk_error *err)
{
    size_t rows = usual_length(c, like);
    struct mk_table *t = calloc(1, sizeof *t);
    if (t)
        t->column = calloc(c->count + 1, sizeof *t->column);
    if (!t || !t->column) {
        mk_table_free(t);
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for %s", path);
    }
    t->rows = rows;
    for (size_t i = 0; i < c->count; i++) {
        if (c->vector[i].rows != rows) {
            char why[64];
            snprintf(why, sizeof why, "%zu values, not %zu", c->vector[i].rows, rows);
            mat_scan_leave_out(c, c->vector[i].name, why);
            continue;
        }
        struct mk_table_column *column = &t->column[t->count++];
        snprintf(column->name, sizeof column->name, "%s", c->vector[i].name);
        column->data = c->vector[i].data;
        c->vector[i].data = NULL;
    }
    if (rows < 2) {
        mk_table_free(t);
        return mk_error_at(err, MK_ERR_PARSE, path, 0, 0, "no vectors of numbers in this MAT file");
    }
    strcpy(t->left_out, c->left_out);
    *out = t;
    return MK_OK;
}

/* Version 7.3 is HDF5 with a MAT header before it, whose bytes 124 to 127 are 0x0200 and "MI", in
 * the byte order of the machine that wrote it. */
static bool is_version_73(const char *path)
{
    unsigned char header[128] = {0};
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    ssize_t n = fd < 0 ? -1 : read(fd, header, sizeof header);
    if (fd >= 0)
        close(fd);
    return n == (ssize_t)sizeof header && header[124] + header[125] == 2 &&
           (header[124] == 2 || header[125] == 2);
}

enum mk_status source_read_mat(const char *path, const char *like, struct mk_table **out,
                               struct mk_error *err)
{
    struct stat kind;
    *out = NULL;
    if (stat(path, &kind) != 0)
        return mk_error_errno(err, errno, path, "cannot read");
    if (!S_ISREG(kind.st_mode))
        return mk_error_errno(err, S_ISDIR(kind.st_mode) ? EISDIR : ESPIPE, path, "cannot read");
    struct mat_scan c;
    enum mk_status st =
        (is_version_73(path) ? mat_scan_apart : mat_scan)(path, (size_t)kind.st_size, &c, err);
    if (st == MK_OK)
        st = as_table(&c, path, like, out, err);
    mat_scan_free(&c);
    return st;
}
