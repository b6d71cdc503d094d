/* MAT files, written with matio (read_mat.c reads them).
 *
 * A value is built bottom up and handed to its struct, which then owns it; freeing the variable
 * frees the tree. Building stops at the first failure (`failed`), so that the code that says what
 * goes where need not look after each call.
 */
#include <ctype.h>
#include <errno.h>
#include <limits.h>
#include <matio.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "base/out_file.h"
#include "base/temporary.h"
#include "mechkit/exchange.h"
#include "mechkit/number.h"

struct builder {
    bool failed;
};

/* MATLAB names: a letter, then letters, digits and _; at most 63. */
static void field_name(const char *text, char out[64])
{
    size_t n = 0;
    if (!isalpha((unsigned char)*text))
        out[n++] = 'x';
    for (; *text && n < 63; text++)
        out[n++] = isalnum((unsigned char)*text) ? *text : '_';
    out[n] = '\0';
}

static matvar_t *made(struct builder *b, matvar_t *v)
{
    b->failed |= v == NULL;
    return v;
}

static matvar_t *matrix(struct builder *b, const double *data, size_t rows, size_t columns)
{
    size_t dims[2] = {rows, columns};
    double none = 0.0;
    /* matio copies unless told not to, and takes a pointer to what it will only read. */
    return made(b, Mat_VarCreate(NULL, MAT_C_DOUBLE, MAT_T_DOUBLE, 2, dims,
                                 data ? (void *)(size_t)data : &none, 0));
}

static matvar_t *number(struct builder *b, double value)
{
    return matrix(b, &value, 1, 1);
}

/* Bytes of the character that begins there, 0 where there is none of UTF-8. */
static size_t character(const unsigned char *c)
{
    size_t n = c[0] < 0x80                   ? 1
               : c[0] >= 0xc2 && c[0] < 0xe0 ? 2
               : (c[0] & 0xf0) == 0xe0       ? 3
               : c[0] >= 0xf0 && c[0] < 0xf5 ? 4
                                             : 0;
    for (size_t i = 1; i < n; i++)
        if ((c[i] & 0xc0) != 0x80)
            return 0;
    return n;
}

/* What is no UTF-8, a log of another encoding, would make the whole file unreadable. */
static matvar_t *text(struct builder *b, const char *value)
{
    size_t n = strlen(value), dims[2] = {n > 0 ? 1 : 0, n};
    char *copy = strdup(value);
    for (size_t i = 0; copy && i < n;) {
        size_t length = character((const unsigned char *)copy + i);
        if (length == 0)
            copy[i] = '?';
        i += length ? length : 1;
    }
    matvar_t *out = copy ? Mat_VarCreate(NULL, MAT_C_CHAR, MAT_T_UTF8, 2, dims, copy, 0) : NULL;
    free(copy);
    return made(b, out);
}

static matvar_t *structure(struct builder *b, size_t count)
{
    size_t dims[2] = {1, count};
    return made(b, Mat_VarCreateStruct(NULL, 2, dims, NULL, 0));
}

static bool has_field(matvar_t *owner, const char *field)
{
    char *const *names = Mat_VarGetStructFieldnames(owner);
    unsigned count = Mat_VarGetNumberOfFields(owner);
    for (unsigned i = 0; i < count; i++)
        if (strcmp(names[i], field) == 0)
            return true;
    return false;
}

/* Gives `value` to element `index` of `owner` under `name`; the first of two of one name stays. */
static void put_at(struct builder *b, matvar_t *owner, size_t index, const char *name,
                   matvar_t *value)
{
    char field[64];
    field_name(name, field);
    if (b->failed || !owner || !value) {
        Mat_VarFree(value);
        b->failed = true;
        return;
    }
    if (Mat_VarGetStructFieldByName(owner, field, index)) {
        Mat_VarFree(value);
        return;
    }
    if (!has_field(owner, field) && Mat_VarAddStructField(owner, field) != 0) {
        Mat_VarFree(value);
        b->failed = true;
        return;
    }
    Mat_VarSetStructFieldByName(owner, field, index, value);
}

static void put(struct builder *b, matvar_t *owner, const char *name, matvar_t *value)
{
    put_at(b, owner, 0, name, value);
}

/* A 1 x count cell array of texts. */
static matvar_t *texts(struct builder *b, const struct mk_table *table,
                       const char *(*pick)(const struct mk_table_column *))
{
    size_t dims[2] = {1, table->count};
    matvar_t *cell = made(b, Mat_VarCreate(NULL, MAT_C_CELL, MAT_T_CELL, 2, dims, NULL, 0));
    for (size_t i = 0; cell && i < table->count; i++)
        Mat_VarSetCell(cell, (int)i, text(b, pick(&table->column[i])));
    return cell;
}

static const char *name_of(const struct mk_table_column *c)
{
    return c->name;
}

static const char *unit_of(const struct mk_table_column *c)
{
    return c->unit;
}

/* --- what is in a log ----------------------------------------------------------------------- */

static void put_columns(struct builder *b, matvar_t *run, size_t index, const struct mk_log *log,
                        const struct mk_table *table)
{
    matvar_t *signals = structure(b, 1), *units = structure(b, 1);
    size_t cells = table->rows * table->count;
    double *y = malloc(sizeof(double) * (cells ? cells : 1));
    b->failed |= !y;
    for (size_t i = 0; !b->failed && i < table->count; i++) {
        const struct mk_table_column *c = &table->column[i];
        put(b, signals, c->name, matrix(b, c->data, table->rows, 1));
        put(b, units, c->name, text(b, c->unit));
        memcpy(y + i * table->rows, c->data, sizeof(double) * table->rows);
    }
    put_at(b, run, index, "time", matrix(b, mk_log_get(log, "t"), log->rows, 1));
    put_at(b, run, index, "signals", signals);
    put_at(b, run, index, "units", units);
    put_at(b, run, index, "Y", y ? matrix(b, y, table->rows, table->count) : NULL);
    put_at(b, run, index, "Y_names", texts(b, table, name_of));
    put_at(b, run, index, "Y_units", texts(b, table, unit_of));
    free(y);
}

/* "48.2 5.25 62.4" as a row; what is no number ends it. */
static matvar_t *row_of_numbers(struct builder *b, const char *list)
{
    double value[64];
    size_t n = 0;
    while (list && n < 64) {
        list += strspn(list, " ");
        const char *end = list + strcspn(list, " ");
        if (end == list || !mk_parse_double(list, end, &value[n]))
            break;
        n++;
        list = end;
    }
    return matrix(b, value, n > 0 ? 1 : 0, n);
}

/* "kp=150 kd=21" as a struct of numbers. */
static matvar_t *struct_of_settings(struct builder *b, const char *list)
{
    matvar_t *out = structure(b, 1);
    while (list && *list) {
        list += strspn(list, " ");
        const char *end = list + strcspn(list, " ");
        const char *equals = memchr(list, '=', (size_t)(end - list));
        double value;
        if (equals && mk_parse_double(equals + 1, end, &value)) {
            char name[64];
            snprintf(name, sizeof name, "%.*s", (int)(equals - list), list);
            put(b, out, name, number(b, value));
        }
        list = end;
    }
    return out;
}

static matvar_t *metadata(struct builder *b, const struct mk_log *log)
{
    matvar_t *out = structure(b, 1);
    for (size_t i = 0; i < log->meta_count; i++)
        if (*log->meta[i].key)
            put(b, out, log->meta[i].key, text(b, log->meta[i].value));
    return out;
}

static matvar_t *model_struct(struct builder *b, const struct mk_model *model)
{
    matvar_t *out = structure(b, 1), *parameters = structure(b, 1);
    matvar_t *effects = structure(b, (size_t)model->effect_count);
    const struct mk_plant_info *plant = mk_plant(model->plant);
    double cpr[MK_MAX_JOINTS], count[MK_MAX_JOINTS], linear[MK_MAX_JOINTS];
    for (int j = 0; j < plant->joints; j++) {
        cpr[j] = model->encoder_cpr[j];
        count[j] = mk_model_count(model, j);
        linear[j] = model->joint_linear[j];
    }
    for (int i = 0; i < plant->parameter_count; i++)
        put(b, parameters, plant->parameter[i].name, number(b, model->parameter[i]));
    for (int i = 0; i < model->effect_count; i++) {
        const struct mk_effect_use *use = &model->effect[i];
        const struct mk_effect_info *info = mk_effect(use->index);
        matvar_t *values = structure(b, 1);
        for (int k = 0; k < info->parameter_count; k++)
            put(b, values, info->parameter[k].name, number(b, use->value[k]));
        put_at(b, effects, (size_t)i, "name", text(b, info->name));
        put_at(b, effects, (size_t)i, "joint", number(b, use->joint));
        put_at(b, effects, (size_t)i, "parameters", values);
    }
    put(b, out, "kind", text(b, plant->name));
    put(b, out, "g", number(b, model->g));
    put(b, out, "u_max", number(b, model->u_max));
    put(b, out, "u_to_torque", number(b, model->u_to_torque));
    put(b, out, "friction_sharpness", number(b, model->friction_sharpness));
    put(b, out, "joint_linear", matrix(b, linear, 1, (size_t)plant->joints));
    put(b, out, "encoder_cpr", matrix(b, cpr, 1, (size_t)plant->joints));
    put(b, out, "encoder_count", matrix(b, count, 1, (size_t)plant->joints));
    put(b, out, "parameters", parameters);
    put(b, out, "effects", effects);
    return out;
}

static void put_run(struct builder *b, matvar_t *all, size_t index, const struct mk_mat_run *run)
{
    const char *rig = mk_log_find_meta(run->log, "rig");
    if (!rig && run->model)
        rig = mk_plant(run->model->plant)->name;
    put_at(b, all, index, "name", text(b, run->name ? run->name : ""));
    put_at(b, all, index, "rig", text(b, rig ? rig : ""));
    put_columns(b, all, index, run->log, run->table);
    put_at(b, all, index, "gains", row_of_numbers(b, mk_log_find_meta(run->log, "gains")));
    put_at(b, all, index, "parameters",
           struct_of_settings(b, mk_log_find_meta(run->log, "parameters")));
    put_at(b, all, index, "metadata", metadata(b, run->log));
    put_at(b, all, index, "model",
           run->model ? model_struct(b, run->model) : matrix(b, NULL, 0, 0));
}

/* --- writing ----------------------------------------------------------------------------- */

/* Brings what was prepared in the file `from` to its place. */
static enum mk_status copy_out(const char *from, const char *path, struct mk_error *err)
{
    char block[65536];
    size_t n;
    struct mk_out_file file;
    FILE *in = fopen(from, "rb");
    if (!in)
        return mk_error_errno(err, errno, from, "cannot read");
    enum mk_status st = mk_out_file_open(&file, path, err);
    if (st != MK_OK) {
        fclose(in);
        return st;
    }
    while (st == MK_OK && (n = fread(block, 1, sizeof block, in)) > 0)
        st = mk_out_file_write(&file, block, n, err);
    if (st == MK_OK && ferror(in))
        st = mk_error_set(err, MK_ERR_IO, "cannot read %s", from);
    fclose(in);
    return mk_out_file_finish(&file, st, err);
}

/* matio does not notice a full disk, and HDF5 does not survive one: there has to be room for all of
 * it, as if nothing were compressed, before they begin. */
static enum mk_status check_room(int fd, size_t size, const char *path, struct mk_error *err)
{
    struct statvfs disk;
    struct rlimit limit;
    if (getrlimit(RLIMIT_FSIZE, &limit) == 0 && limit.rlim_cur < size)
        return mk_error_errno(err, EFBIG, path, "cannot write");
    if (fstatvfs(fd, &disk) == 0 && (double)disk.f_bavail * (double)disk.f_frsize < (double)size)
        return mk_error_at(err, MK_ERR_IO, path, 0, 0,
                           "cannot write: this takes up to %zu kB where it is put together, and "
                           "%.0f kB are free there",
                           size / 1024, (double)disk.f_bavail * (double)disk.f_frsize / 1024.0);
    return MK_OK;
}

/* A file beside the target; where that is no regular file, in a folder for such things. */
static int open_scratch(const char *path, char *name, size_t size)
{
    struct stat info;
    const char *folder = getenv("TMPDIR");
    if (stat(path, &info) == 0 && !S_ISREG(info.st_mode))
        snprintf(name, size, "%s/mechkit-mat", folder && *folder ? folder : "/tmp");
    else
        snprintf(name, size, "%s", path);
    mk_temporary_clean(name);
    size_t n = strlen(name);
    snprintf(name + n, size - n, ".%ld-XXXXXX.tmp", (long)getpid());
    return mkstemps(name, 4);
}

static enum mk_status write_scratch(const char *name, enum mk_mat_version version, matvar_t *all,
                                    struct mk_error *err)
{
    mat_t *mat = Mat_CreateVer(name, "MATLAB MAT-file, written by mechkit " MK_VERSION,
                               version == MK_MAT_73 ? MAT_FT_MAT73 : MAT_FT_MAT5);
    if (!mat)
        return mk_error_set(err, MK_ERR_NOTSUP, "this matio cannot write that version of MAT file");
    enum mk_status st = MK_OK;
    if (Mat_VarWrite(mat, all, MAT_COMPRESSION_ZLIB) != 0)
        st = mk_error_set(err, MK_ERR_IO, "matio cannot write %s", name);
    if (Mat_Close(mat) != 0 && st == MK_OK)
        st = mk_error_set(err, MK_ERR_IO, "matio cannot write %s", name);
    return st;
}

static enum mk_status write_variable(const char *path, enum mk_mat_version version, matvar_t *all,
                                     struct mk_error *err)
{
    enum { OVERHEAD = 1 << 17 }; /* bytes of a file beyond its numbers; HDF5's groups are large */
    if (strlen(path) > PATH_MAX - 64)
        return mk_error_errno(err, ENAMETOOLONG, path, "cannot write");
    char *name = malloc(PATH_MAX);
    if (!name)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for %s", path);
    int fd = open_scratch(path, name, PATH_MAX);
    if (fd < 0) {
        const int why = errno;
        free(name);
        return mk_error_errno(err, why, path, "cannot write");
    }
    mk_temporary_add(name);
    enum mk_status st = check_room(fd, 2 * Mat_VarGetSize(all) + OVERHEAD, path, err);
    close(fd);
    if (st == MK_OK)
        st = write_scratch(name, version, all, err);
    if (st == MK_OK)
        st = copy_out(name, path, err);
    unlink(name);
    mk_temporary_done(name);
    return st;
}

enum mk_status mk_mat_write(const char *path, enum mk_mat_version version, const char *variable,
                            const struct mk_mat_run *runs, size_t count, struct mk_error *err)
{
    struct builder b = {false};
    char name[64];
    size_t dims[2] = {1, count};
    field_name(variable, name);
    matvar_t *all = made(&b, Mat_VarCreateStruct(name, 2, dims, NULL, 0));
    for (size_t i = 0; !b.failed && i < count; i++)
        put_run(&b, all, i, &runs[i]);
    enum mk_status st = b.failed ? mk_error_set(err, MK_ERR_NOMEM, "no memory for %s", path)
                                 : write_variable(path, version, all, err);
    Mat_VarFree(all);
    return st;
}
