/* Logs in memory. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/log_priv.h"

bool mk_log_column_is_known(const char *name)
{
    static const char *const known[] = {
        "t",     "q1",     "q2",      "u",        "tau",     "u1",       "u2",
        "tau1",  "tau2",   "dq1",     "dq2",      "enc1",    "enc2",     "ref",
        "phase", "tick",   "late_us", "flags",    "tau_cmd", "tau1_cmd", "tau2_cmd",
        "u_cmd", "u1_cmd", "u2_cmd",  "left_out",
    };
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
        if (strcmp(known[i], name) == 0)
            return true;
    return false;
}

enum mk_status mk_log_create(size_t rows, struct mk_log **out)
{
    *out = calloc(1, sizeof **out);
    if (!*out)
        return MK_ERR_NOMEM;
    (*out)->rows = rows;
    return MK_OK;
}

void mk_log_free(struct mk_log *log)
{
    if (!log)
        return;
    for (size_t c = 0; c < log->column_count; c++) {
        struct mk_log_column *column = &log->columns[c];
        for (size_t r = 0; column->text && r < log->rows; r++)
            free(column->text[r]);
        free(column->text);
        free(column->data);
        free(column->name);
    }
    for (size_t i = 0; i < log->meta_count; i++) {
        free(log->meta[i].key);
        free(log->meta[i].value);
    }
    free(log->columns);
    free(log->meta);
    free(log->path);
    free(log);
}

double *mk_log_add_column(struct mk_log *log, const char *name)
{
    struct mk_log_column *columns =
        realloc(log->columns, (log->column_count + 1) * sizeof *columns);
    if (!columns)
        return NULL;
    log->columns = columns;
    struct mk_log_column *column = &columns[log->column_count];
    *column = (struct mk_log_column){.name = strdup(name),
                                     .data = malloc((log->rows + 1) * sizeof(double))};
    if (!column->name || !column->data) {
        free(column->name);
        free(column->data);
        return NULL;
    }
    for (size_t r = 0; r < log->rows; r++)
        column->data[r] = (double)NAN;
    log->column_count++;
    return column->data;
}

const double *mk_log_get(const struct mk_log *log, const char *name)
{
    for (size_t c = 0; c < log->column_count; c++)
        if (strcmp(log->columns[c].name, name) == 0)
            return log->columns[c].data;
    return NULL;
}

void mk_log_shift(struct mk_log *log, const char *name, double by)
{
    for (size_t c = 0; c < log->column_count; c++)
        if (strcmp(log->columns[c].name, name) == 0 && log->columns[c].data)
            for (size_t k = 0; k < log->rows; k++)
                log->columns[c].data[k] += by;
}

void mk_log_replace(struct mk_log *log, const char *name, const double *values)
{
    for (size_t c = 0; c < log->column_count; c++)
        if (strcmp(log->columns[c].name, name) == 0 && log->columns[c].data)
            memcpy(log->columns[c].data, values, log->rows * sizeof *values);
}

static const char *const joint_column[][2] = {{"q1", "dq1"}, {"q2", "dq2"}};

static const char *of_joint(int joint, int which)
{
    const int joints = (int)(sizeof joint_column / sizeof joint_column[0]);
    return joint >= 0 && joint < joints ? joint_column[joint][which] : "";
}

const char *mk_log_angle(int joint)
{
    return of_joint(joint, 0);
}

const char *mk_log_speed(int joint)
{
    return of_joint(joint, 1);
}

const char *mk_log_find_meta(const struct mk_log *log, const char *key)
{
    for (size_t i = 0; i < log->meta_count; i++)
        if (strcmp(log->meta[i].key, key) == 0)
            return log->meta[i].value;
    return NULL;
}

enum mk_status mk_log_append_meta(struct mk_log *log, const char *key, size_t key_length,
                                  const char *value, size_t value_length)
{
    /* Grows at the powers of two: the count alone tells the room. */
    size_t n = log->meta_count;
    if ((n & (n - 1)) == 0) {
        struct mk_log_meta *meta = realloc(log->meta, (n ? 2 * n : 1) * sizeof *meta);
        if (!meta)
            return MK_ERR_NOMEM;
        log->meta = meta;
    }
    struct mk_log_meta line = {strndup(key, key_length), strndup(value, value_length)};
    if (!line.key || !line.value) {
        free(line.key);
        free(line.value);
        return MK_ERR_NOMEM;
    }
    log->meta[log->meta_count++] = line;
    return MK_OK;
}

enum mk_status mk_log_set_meta(struct mk_log *log, const char *key, const char *value)
{
    if (!key[0] || strpbrk(key, ":\r\n"))
        return MK_ERR_INVALID;
    for (size_t i = 0; i < log->meta_count; i++) {
        if (strcmp(log->meta[i].key, key) != 0)
            continue;
        char *copy = strdup(value);
        if (!copy)
            return MK_ERR_NOMEM;
        free(log->meta[i].value);
        log->meta[i].value = copy;
        return MK_OK;
    }
    return mk_log_append_meta(log, key, strlen(key), value, strlen(value));
}

bool mk_log_path_is_compressed(const char *path)
{
    size_t n = strlen(path);
    return n > 3 && strcmp(path + n - 3, ".gz") == 0;
}
