#include "fuzz_mat.h"

#include <matio.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define DEPTH 10      /* one more than is looked at, and some */
#define ELEMENTS 4096 /* of an array of numbers */
#define CHILDREN 24   /* of structs and cells, all fields of all elements */
#define VARIABLES 24

struct bytes {
    const uint8_t *at;
    size_t left;
};

static uint8_t take(struct bytes *b)
{
    if (b->left == 0)
        return 0;
    b->left--;
    return *b->at++;
}

/* A name that the import knows, or what the bytes say. */
static void take_name(struct bytes *b, char name[80])
{
    static const char *const known[] = {"t", "q1",   "q2",  "u",       "tau",    "run",
                                        "Y", "time", "dq1", "signals", "theta_1"};
    uint8_t which = take(b);
    if (which < 0xc0) {
        snprintf(name, 80, "%s", known[which % (sizeof known / sizeof known[0])]);
        return;
    }
    size_t n = 1 + which % 0x40;
    for (size_t i = 0; i < n; i++) {
        uint8_t c = take(b);
        name[i] = (char)(c ? c : 'x');
    }
    name[n] = '\0';
}

/* Numbers that rise, or any. */
static void fill(struct bytes *b, void *data, size_t elements, size_t size, int class_type)
{
    bool any = (take(b) & 1) != 0;
    double *x = data;
    float *y = data;
    for (size_t i = 0; any && i < elements * size; i++)
        ((uint8_t *)data)[i] = take(b);
    for (size_t i = 0; !any && i < elements; i++)
        if (class_type == MAT_C_DOUBLE)
            x[i] = 0.01 * (double)i;
        else if (class_type == MAT_C_SINGLE)
            y[i] = 0.01f * (float)i;
        else
            memset((uint8_t *)data + i * size, (int)(i & 0x7f), 1);
}

static matvar_t *numbers(struct bytes *b, const char *name, int class_type, int rank, size_t *dims)
{
    static const enum matio_types types[] = {
        [MAT_C_CHAR] = MAT_T_UINT8,    [MAT_C_DOUBLE] = MAT_T_DOUBLE, [MAT_C_SINGLE] = MAT_T_SINGLE,
        [MAT_C_INT8] = MAT_T_INT8,     [MAT_C_UINT8] = MAT_T_UINT8,   [MAT_C_INT16] = MAT_T_INT16,
        [MAT_C_UINT16] = MAT_T_UINT16, [MAT_C_INT32] = MAT_T_INT32,   [MAT_C_UINT32] = MAT_T_UINT32,
        [MAT_C_INT64] = MAT_T_INT64,   [MAT_C_UINT64] = MAT_T_UINT64};
    size_t elements = 1, size = class_type == MAT_C_CHAR ? 1 : Mat_SizeOfClass(class_type);
    for (int i = 0; i < rank; i++)
        elements *= dims[i];
    if (elements > ELEMENTS)
        return NULL;
    uint8_t how = take(b);
    void *re = calloc(elements + 1, size), *im = calloc(elements + 1, size);
    matvar_t *v = NULL;
    if (re && im) {
        fill(b, re, elements, size, class_type);
        mat_complex_split_t both = {re, im};
        bool is_complex = how % 8 == 1 && elements > 0 && class_type != MAT_C_CHAR;
        v = Mat_VarCreate(name, (enum matio_classes)class_type, types[class_type], rank, dims,
                          is_complex ? (void *)&both : re,
                          is_complex                                  ? MAT_F_COMPLEX
                          : how % 8 == 2 && class_type == MAT_C_UINT8 ? MAT_F_LOGICAL
                                                                      : 0);
    }
    free(re);
    free(im);
    return v;
}

static matvar_t *variable(struct bytes *b, const char *name, int depth);

static matvar_t *structure(struct bytes *b, const char *name, int depth, int rank, size_t *dims)
{
    char text[4][80];
    const char *fields[4];
    size_t elements = 1;
    unsigned count = take(b) % 5;
    for (int i = 0; i < rank; i++)
        elements *= dims[i];
    if (elements * count > CHILDREN)
        return NULL;
    for (unsigned k = 0; k < count; k++) {
        take_name(b, text[k]);
        fields[k] = text[k];
    }
    matvar_t *v = Mat_VarCreateStruct(name, rank, dims, fields, count);
    for (size_t i = 0; v && v->data && i < elements; i++)
        for (unsigned k = 0; k < count; k++) {
            matvar_t *field = variable(b, fields[k], depth + 1);
            if (field)
                Mat_VarSetStructFieldByIndex(v, k, i, field);
        }
    return v;
}

static matvar_t *cells(struct bytes *b, const char *name, int depth, int rank, size_t *dims)
{
    matvar_t *cell[CHILDREN + 1] = {NULL};
    size_t elements = 1;
    for (int i = 0; i < rank; i++)
        elements *= dims[i];
    if (elements > CHILDREN)
        return NULL;
    for (size_t i = 0; i < elements; i++)
        cell[i] = variable(b, NULL, depth + 1);
    return Mat_VarCreate(name, MAT_C_CELL, MAT_T_CELL, rank, dims, cell, 0);
}

static matvar_t *variable(struct bytes *b, const char *name, int depth)
{
    size_t dims[4];
    uint8_t kind = take(b);
    int rank = kind & 0x80 ? 2 + (kind >> 5 & 3) % 3 : 2;
    for (int i = 0; i < rank; i++) {
        uint8_t d = take(b);
        dims[i] = d < 0xf0 ? d % 12 : d - 0x80u; /* now and then more than is taken for signals */
    }
    switch (kind & 0x1f) {
    case 0:
        return NULL;
    case MAT_C_CELL:
        return depth < DEPTH ? cells(b, name, depth, rank, dims) : NULL;
    case MAT_C_STRUCT:
        return depth < DEPTH ? structure(b, name, depth, rank, dims) : NULL;
    case MAT_C_CHAR:
    case MAT_C_DOUBLE:
    case MAT_C_SINGLE:
    case MAT_C_INT8:
    case MAT_C_UINT8:
    case MAT_C_INT16:
    case MAT_C_UINT16:
    case MAT_C_INT32:
    case MAT_C_UINT32:
    case MAT_C_INT64:
    case MAT_C_UINT64:
        return numbers(b, name, kind & 0x1f, rank, dims);
    default: /* a signal standing, which is what there is most of */
        dims[0] = 8;
        dims[1] = 1;
        return numbers(b, name, MAT_C_DOUBLE, 2, dims);
    }
}

bool fuzz_mat(const char *path, const uint8_t *data, size_t size)
{
    struct bytes b = {data, size};
    uint8_t how = take(&b);
    char name[80];
    unlink(path);
    mat_t *mat = Mat_CreateVer(path, NULL, how & 1 ? MAT_FT_MAT4 : MAT_FT_MAT5);
    if (!mat)
        return false;
    for (int i = 0; i < VARIABLES && b.left > 0; i++) {
        take_name(&b, name);
        matvar_t *v = variable(&b, name, 0);
        if (v)
            (void)Mat_VarWrite(mat, v, MAT_COMPRESSION_NONE); /* the other way leaks in matio */
        Mat_VarFree(v);
    }
    Mat_Close(mat);
    return true;
}
