/* MAT files of other people as tables: whatever numbers they hold, by name. */
#include <errno.h>
#include <matio.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "exchange/source.h"

#define MAX_COLUMNS 1024
#define MAX_DEPTH 8

struct found {
    char name[64];
    size_t rows;
    double *data; /* a copy */
};

struct collector {
    struct found *found;
    size_t count;
    bool failed;
};

static double element(const matvar_t *v, size_t i)
{
    switch (v->class_type) {
    case MAT_C_DOUBLE:
        return ((const double *)v->data)[i];
    case MAT_C_SINGLE:
        return (double)((const float *)v->data)[i];
    case MAT_C_INT64:
        return (double)((const mat_int64_t *)v->data)[i];
    case MAT_C_UINT64:
        return (double)((const mat_uint64_t *)v->data)[i];
    case MAT_C_INT32:
        return (double)((const mat_int32_t *)v->data)[i];
    case MAT_C_UINT32:
        return (double)((const mat_uint32_t *)v->data)[i];
    case MAT_C_INT16:
        return (double)((const mat_int16_t *)v->data)[i];
    case MAT_C_UINT16:
        return (double)((const mat_uint16_t *)v->data)[i];
    case MAT_C_INT8:
        return (double)((const mat_int8_t *)v->data)[i];
    default:
        return (double)((const mat_uint8_t *)v->data)[i];
    }
}

static bool is_numeric(const matvar_t *v)
{
    return v->class_type >= MAT_C_DOUBLE && v->class_type <= MAT_C_UINT64 && !v->isComplex &&
           v->rank == 2 && v->data;
}

static void add(struct collector *c, const char *name, const matvar_t *v, size_t first, size_t rows)
{
    if (c->count == MAX_COLUMNS)
        return;
    struct found *f = &c->found[c->count];
    f->data = malloc(sizeof(double) * rows);
    if (!f->data) {
        c->failed = true;
        return;
    }
    snprintf(f->name, sizeof f->name, "%s", name);
    f->rows = rows;
    for (size_t i = 0; i < rows; i++)
        f->data[i] = element(v, first + i);
    c->count++;
}

static void add_matrix(struct collector *c, const char *name, const matvar_t *v)
{
    size_t rows = v->dims[0], columns = v->dims[1];
    if (rows == 1 || columns == 1) {
        if (rows * columns > 1)
            add(c, name, v, 0, rows * columns);
        return;
    }
    for (size_t k = 0; k < columns && rows > 0; k++) {
        char column[96];
        snprintf(column, sizeof column, "%s(:,%zu)", name, k + 1);
        add(c, column, v, k * rows, rows);
    }
}

static void walk(struct collector *c, const char *name, matvar_t *v, int depth)
{
    if (!v || depth > MAX_DEPTH)
        return;
    if (is_numeric(v))
        add_matrix(c, name, v);
    if (v->class_type != MAT_C_STRUCT || !v->data)
        return;
    /* Of a struct array the first element: one log at a time. */
    char *const *fields = Mat_VarGetStructFieldnames(v);
    unsigned count = Mat_VarGetNumberOfFields(v);
    for (unsigned i = 0; i < count; i++) {
        char path[128];
        snprintf(path, sizeof path, "%s.%s", name, fields[i]);
        walk(c, path, Mat_VarGetStructFieldByIndex(v, i, 0), depth + 1);
    }
}

/* The length that most columns have. */
static size_t usual_length(const struct collector *c)
{
    size_t best = 0, votes = 0;
    for (size_t i = 0; i < c->count; i++) {
        size_t same = 0;
        for (size_t k = 0; k < c->count; k++)
            same += c->found[k].rows == c->found[i].rows;
        if (same > votes || (same == votes && c->found[i].rows > best)) {
            votes = same;
            best = c->found[i].rows;
        }
    }
    return best;
}

static enum mk_status as_table(struct collector *c, const char *path, struct mk_table **out,
                               struct mk_error *err)
{
    size_t rows = usual_length(c);
    struct mk_table *t = calloc(1, sizeof *t);
    if (t)
        t->column = calloc(c->count + 1, sizeof *t->column);
    if (!t || !t->column || c->failed) {
        mk_table_free(t);
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for %s", path);
    }
    t->rows = rows;
    for (size_t i = 0; i < c->count; i++) {
        if (c->found[i].rows != rows)
            continue;
        struct mk_table_column *column = &t->column[t->count++];
        snprintf(column->name, sizeof column->name, "%s", c->found[i].name);
        column->data = c->found[i].data;
        c->found[i].data = NULL;
    }
    if (rows < 2) {
        mk_table_free(t);
        return mk_error_at(err, MK_ERR_PARSE, path, 0, 0, "no vectors of numbers in this MAT file");
    }
    *out = t;
    return MK_OK;
}

enum mk_status source_read_mat(const char *path, struct mk_table **out, struct mk_error *err)
{
    struct stat kind;
    if (stat(path, &kind) == 0 && S_ISDIR(kind.st_mode))
        return mk_error_errno(err, EISDIR, path, "cannot read");
    struct collector c = {.found = calloc(MAX_COLUMNS, sizeof *c.found)};
    mat_t *mat = c.found ? Mat_Open(path, MAT_ACC_RDONLY) : NULL;
    *out = NULL;
    if (!mat) {
        free(c.found);
        return mk_error_at(err, MK_ERR_PARSE, path, 0, 0, "no MAT file, or none of this kind");
    }
    for (matvar_t *v; (v = Mat_VarReadNext(mat)) != NULL; Mat_VarFree(v))
        walk(&c, v->name ? v->name : "", v, 0);
    Mat_Close(mat);
    enum mk_status st = as_table(&c, path, out, err);
    for (size_t i = 0; i < c.count; i++)
        free(c.found[i].data);
    free(c.found);
    return st;
}
