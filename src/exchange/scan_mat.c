/* What the variables of a MAT file hold, in this process. */
#include <matio.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/text.h"
#include "exchange/scan_mat.h"

#define MAX_DEPTH 8
#define PATH_SIZE 160
#define ELEMENTS_A_BYTE 1100 /* zlib makes no more than 1032 bytes of one */
#define MAX_SIGNALS                                                                                \
    64 /* of one matrix; more than that is a picture or a table of something else                  \
        */

void mat_scan_leave_out(struct mat_scan *c, const char *name, const char *why)
{
    static const char rest[] = ", ...";
    char more[256], shown[256];
    size_t n = strlen(c->left_out), room = sizeof c->left_out - n;
    snprintf(more, sizeof more, "%s%s (%s)", n ? ", " : "", mk_show_text(shown, sizeof shown, name),
             why);
    if (strlen(more) + sizeof rest <= room)
        strcpy(c->left_out + n, more);
    else if (n == 0)
        strcpy(c->left_out, "...");
    else if (room >= sizeof rest && strncmp(c->left_out + n - 3, "...", 3) != 0)
        strcpy(c->left_out + n, rest);
}

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

/* Saturates: what a damaged file claims may be beyond any number. */
static size_t elements_of(const matvar_t *v)
{
    size_t n = v->rank > 0 && v->dims;
    for (int i = 0; n && i < v->rank; i++)
        if (__builtin_mul_overflow(n, v->dims[i], &n))
            return SIZE_MAX;
    return n;
}

/* One with numbers for all that its dimensions promise. */
static bool is_numeric(const matvar_t *v)
{
    return v->class_type >= MAT_C_DOUBLE && v->class_type <= MAT_C_UINT64 && !v->isComplex &&
           v->rank == 2 && v->data &&
           v->nbytes / Mat_SizeOfClass((int)v->class_type) >= elements_of(v);
}

static bool make_room(struct mat_scan *c)
{
    if (c->count < c->room)
        return true;
    size_t room = c->room ? 2 * c->room : 64;
    struct mat_vector *more = realloc(c->vector, sizeof *more * room);
    if (!more)
        return false;
    c->vector = more;
    c->room = room;
    return true;
}

/* `rows` values from `first`, `stride` apart. */
static void add(struct mat_scan *c, const char *name, const matvar_t *v, size_t first,
                size_t stride, size_t rows)
{
    if (strlen(name) >= sizeof c->vector->name) {
        mat_scan_leave_out(c, name, "too long a name");
        return;
    }
    double *data = malloc(sizeof *data * rows);
    if (!data || !make_room(c)) {
        free(data);
        c->failed = true;
        return;
    }
    for (size_t i = 0; i < rows; i++)
        data[i] = element(v, first + i * stride);
    struct mat_vector *f = &c->vector[c->count++];
    strcpy(f->name, name);
    f->rows = rows;
    f->data = data;
}

/* Signals lie along the longer side. */
static void add_matrix(struct mat_scan *c, const char *name, const matvar_t *v)
{
    size_t rows = v->dims[0], columns = v->dims[1];
    bool lying = columns > rows;
    size_t signals = lying ? rows : columns, length = lying ? columns : rows;
    if (length < 2 || signals == 0)
        return;
    if (signals == 1) {
        add(c, name, v, 0, 1, length);
        return;
    }
    if (signals > MAX_SIGNALS) {
        char why[64];
        snprintf(why, sizeof why, "%zu x %zu", rows, columns);
        mat_scan_leave_out(c, name, why);
        return;
    }
    for (size_t k = 0; k < signals; k++) {
        char one[PATH_SIZE + 32];
        snprintf(one, sizeof one, lying ? "%s(%zu,:)" : "%s(:,%zu)", name, k + 1);
        add(c, one, v, lying ? k : k * rows, lying ? rows : 1, length);
    }
}

/* "run.q1"; of a struct array "run(1).q1", "run(2).q1", ...; of cells "run{1}.q1". */
static void walk(struct mat_scan *c, const char *name, matvar_t *v, int depth)
{
    char path[PATH_SIZE];
    if (!v || depth > MAX_DEPTH || c->failed)
        return;
    if (is_numeric(v))
        add_matrix(c, name, v);
    if (!v->data)
        return;
    if (v->class_type == MAT_C_CELL)
        for (size_t i = 0; i < elements_of(v); i++) {
            snprintf(path, sizeof path, "%s{%zu}", name, i + 1);
            walk(c, path, Mat_VarGetCell(v, (int)i), depth + 1);
        }
    if (v->class_type != MAT_C_STRUCT)
        return;
    char *const *fields = Mat_VarGetStructFieldnames(v);
    unsigned count = fields ? Mat_VarGetNumberOfFields(v) : 0; /* a damaged file has none */
    for (size_t i = 0; i < elements_of(v); i++)
        for (unsigned k = 0; k < count; k++) {
            if (elements_of(v) == 1)
                snprintf(path, sizeof path, "%s.%s", name, fields[k]);
            else
                snprintf(path, sizeof path, "%s(%zu).%s", name, i + 1, fields[k]);
            walk(c, path, Mat_VarGetStructFieldByIndex(v, k, i), depth + 1);
        }
}

/* Whether a file of this size can hold what it claims: matio makes room before it reads. */
static bool can_hold(matvar_t *v, size_t *left, int depth)
{
    size_t n = elements_of(v);
    if (n > *left)
        return false;
    *left -= n;
    size_t children = 0;
    if (v->class_type == MAT_C_CELL)
        children = n;
    else if (v->class_type == MAT_C_STRUCT &&
             __builtin_mul_overflow(n, Mat_VarGetNumberOfFields(v), &children))
        return false;
    if (children == 0 || depth > MAX_DEPTH || !v->data)
        return true;
    for (size_t i = 0; i < children; i++) {
        matvar_t *child = ((matvar_t **)v->data)[i];
        if (child && !can_hold(child, left, depth + 1))
            return false;
    }
    return true;
}

enum mk_status mat_scan(const char *path, size_t size, struct mat_scan *c, struct mk_error *err)
{
    *c = (struct mat_scan){0};
    mat_t *mat = Mat_Open(path, MAT_ACC_RDONLY);
    if (!mat)
        return mk_error_at(err, MK_ERR_PARSE, path, 0, 0, "no MAT file, or none of this kind");
    size_t left = (size + 1) * ELEMENTS_A_BYTE;
    for (matvar_t *v; (v = Mat_VarReadNextInfo(mat)) != NULL; Mat_VarFree(v))
        if (!can_hold(v, &left, 0) || Mat_VarReadDataAll(mat, v) != 0)
            mat_scan_leave_out(c, v->name ? v->name : "", "cannot be read");
        else
            walk(c, v->name ? v->name : "", v, 0);
    Mat_Close(mat);
    return c->failed ? mk_error_set(err, MK_ERR_NOMEM, "no memory for %s", path) : MK_OK;
}

void mat_scan_free(struct mat_scan *c)
{
    for (size_t i = 0; i < c->count; i++)
        free(c->vector[i].data);
    free(c->vector);
    *c = (struct mat_scan){0};
}
