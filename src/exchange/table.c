/* Tables: columns of a log in units of one's own, and CSV for other programs. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/out_file.h"
#include "exchange/unit.h"
#include "mechkit/exchange.h"
#include "mechkit/number.h"
#include "mechkit/sim.h"

double mk_log_u_to_torque(const struct mk_log *log, const struct mk_model *model)
{
    if (!mk_log_get(log, "u") && !mk_log_get(log, "u1") &&
        (mk_log_get(log, "tau") || mk_log_get(log, "tau1")))
        return 1.0;
    double value = 0.0;
    const char *text = mk_log_find_meta(log, "u_to_torque");
    if (text && mk_parse_double_z(text, &value) && value > 0.0)
        return value;
    return model ? model->u_to_torque : 0.0;
}

void mk_table_free(struct mk_table *table)
{
    if (!table)
        return;
    for (size_t i = 0; i < table->count; i++)
        free(table->column[i].data);
    free(table->column);
    free(table);
}

/* --- choosing ---------------------------------------------------------------------------- */

/* What a column holds, after what the log says about its joints. */
static enum quantity quantity_in(const struct mk_log *log, const char *name)
{
    bool linear[MK_MAX_JOINTS];
    const char *rig = mk_log_find_meta(log, "rig");
    const struct mk_plant_info *plant = rig ? mk_plant_by_name(rig) : NULL;
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        linear[j] = mk_record_joint_slides(log, j);
    return quantity_of_joint_column(name, linear, plant ? plant->motor_joint : 0);
}

/* How many native units a unit of one's own is. */
static enum mk_status size_of_unit(const char *column, const char *unit_name,
                                   enum quantity quantity, double u_to_torque, double *size,
                                   struct mk_error *err)
{
    const struct unit *unit = unit_by_name(unit_name);
    *size = unit ? unit_size(unit, quantity, u_to_torque) : 0.0;
    if (*size != 0.0)
        return MK_OK;
    if (unit && quantity == QUANTITY_COMMAND && u_to_torque <= 0.0)
        return mk_error_set(err, MK_ERR_USAGE,
                            "%s:%s: the log does not say how many N m a unit of command is: "
                            "give --model",
                            column, unit_name);
    return mk_error_set(err, MK_ERR_USAGE, "%s:%s: the units of %s are: %s", column, unit_name,
                        column, units_of(quantity));
}

static enum mk_status add_column(struct mk_table *table, const struct mk_log *log, const char *name,
                                 const char *unit_name, double u_to_torque, struct mk_error *err)
{
    const double *data = mk_log_get(log, name);
    if (!data)
        return mk_error_set(err, MK_ERR_USAGE, "%s has no column of numbers '%s'",
                            log->path ? log->path : "the log", name);
    enum quantity quantity = quantity_in(log, name);
    const char *native = native_unit(quantity);
    double size = 1.0;
    bool own = unit_name && *unit_name && strcmp(unit_name, native) != 0;
    enum mk_status st =
        own ? size_of_unit(name, unit_name, quantity, u_to_torque, &size, err) : MK_OK;
    if (st != MK_OK)
        return st;
    struct mk_table_column *c = &table->column[table->count];
    snprintf(c->name, sizeof c->name, "%s", name);
    snprintf(c->unit, sizeof c->unit, "%s", own ? unit_name : native);
    c->own_unit = own;
    c->data = malloc(sizeof(double) * (table->rows ? table->rows : 1));
    if (!c->data)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for the table");
    table->count++;
    for (size_t r = 0; r < table->rows; r++)
        c->data[r] = data[r] / size;
    return MK_OK;
}

static enum mk_status add_listed(struct mk_table *table, const struct mk_log *log, char *list,
                                 double u_to_torque, struct mk_error *err)
{
    enum mk_status st = MK_OK;
    char *rest = NULL;
    for (char *item = strtok_r(list, ",", &rest); item && st == MK_OK;
         item = strtok_r(NULL, ",", &rest)) {
        while (*item == ' ')
            item++;
        char *unit = strchr(item, ':');
        if (unit)
            *unit++ = '\0';
        st = add_column(table, log, item, unit, u_to_torque, err);
    }
    return st == MK_OK && table->count == 0 ? mk_error_set(err, MK_ERR_USAGE, "which columns?")
                                            : st;
}

static enum mk_status add_all(struct mk_table *table, const struct mk_log *log, double u_to_torque,
                              struct mk_error *err)
{
    enum mk_status st = MK_OK;
    for (size_t i = 0; st == MK_OK && i < log->column_count; i++)
        if (log->columns[i].data)
            st = add_column(table, log, log->columns[i].name, NULL, u_to_torque, err);
    return st;
}

enum mk_status mk_table_from_log(const struct mk_log *log, const char *columns, double u_to_torque,
                                 struct mk_table **out, struct mk_error *err)
{
    struct mk_table *table = calloc(1, sizeof *table);
    char *list = columns ? strdup(columns) : NULL;
    size_t room = log->column_count;
    for (const char *c = columns; c && *c; c++)
        room += *c == ',';
    *out = NULL;
    if (table)
        table->column = calloc(room + 1, sizeof *table->column);
    enum mk_status st;
    if (!table || !table->column || (columns && !list)) {
        st = mk_error_set(err, MK_ERR_NOMEM, "no memory for the table");
    } else {
        table->rows = log->rows;
        st = list ? add_listed(table, log, list, u_to_torque, err)
                  : add_all(table, log, u_to_torque, err);
    }
    free(list);
    if (st == MK_OK)
        *out = table;
    else
        mk_table_free(table);
    return st;
}

/* --- CSV --------------------------------------------------------------------------------- */

static void put_header(FILE *f, const struct mk_table *table, const struct mk_log *meta,
                       char separator)
{
    for (size_t i = 0; meta && i < meta->meta_count; i++) {
        const struct mk_log_meta *m = &meta->meta[i];
        fprintf(f, "# %s%s%s\n", m->key, *m->key ? ": " : "", m->value);
    }
    for (size_t i = 0; i < table->count; i++) {
        const struct mk_table_column *c = &table->column[i];
        if (i > 0)
            fputc(separator, f);
        fputs(c->name, f);
        if (c->own_unit)
            fputc('_', f);
        for (const char *u = c->own_unit ? c->unit : ""; *u; u++)
            fputs(*u == '/' ? "_per_" : (char[]){*u, '\0'}, f);
    }
    fputc('\n', f);
}

static void put_cell(FILE *f, double value, char separator)
{
    char text[MK_NUMBER_MAX];
    if (isnan(value))
        return;
    mk_format_double(text, value);
    char *point = separator == ';' ? strchr(text, '.') : NULL;
    if (point)
        *point = ',';
    fputs(text, f);
}

enum mk_status mk_table_write_csv(const char *path, const struct mk_table *table,
                                  const struct mk_log *meta, char separator, struct mk_error *err)
{
    struct mk_out_text out;
    enum mk_status st = mk_out_text_open(&out, path, err);
    if (st != MK_OK)
        return st;
    put_header(out.stream, table, meta, separator);
    for (size_t r = 0; r < table->rows; r++)
        for (size_t i = 0; i < table->count; i++) {
            put_cell(out.stream, table->column[i].data[r], separator);
            fputc(i + 1 < table->count ? separator : '\n', out.stream);
        }
    return mk_out_text_save(&out, err);
}
