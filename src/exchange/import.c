/* Logs from other people's files: by a mapping, or by what the columns are called. */
#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/text.h"
#include "exchange/source.h"
#include "exchange/unit.h"
#include "mechkit/exchange.h"
#include "mechkit/number.h"
#include "mechkit/sim.h"

#define SHOWN (4 * 64) /* a name, with every byte of it escaped */

static bool ends_with(const char *text, const char *end)
{
    size_t n = strlen(text), m = strlen(end);
    return n >= m && strcmp(text + n - m, end) == 0;
}

static const struct mk_table_column *column_of(const struct mk_table *table, const char *from);

/* A mapping that says no unit means that of the column's header, "Arm angle [deg]", if the header
 * has one of that quantity. A factor in the place of a unit is one: sign = 0.0015 of counts. */
static void take_units(const struct mk_table *table, struct mk_import_map *map)
{
    for (int i = 0; i < map->count; i++) {
        struct mk_import_column *c = &map->column[i];
        const struct mk_table_column *from = column_of(table, c->from);
        const struct unit *unit = from && *from->unit ? unit_by_name(from->unit) : NULL;
        enum quantity quantity =
            quantity_of_joint_column(c->to, map->joint_linear, mk_plant(map->rig)->motor_joint);
        if (unit && !*c->unit && fabs(c->sign) == 1.0 && quantity != QUANTITY_COMMAND &&
            unit_size(unit, quantity, 0.0) > 0.0 && strcmp(unit->name, native_unit(quantity)) != 0)
            snprintf(c->unit, sizeof c->unit, "%s", unit->name);
    }
}

enum mk_status mk_import_open(const char *path, struct mk_import_map *map, struct mk_table **out,
                              struct mk_error *err)
{
    if (ends_with(path, ".mat")) {
        const struct mk_import_column *t = mk_import_map_find(map, "t");
        return source_read_mat(path, t ? t->from : NULL, out, err);
    }
    struct source_format format = {map->separator, map->decimal};
    enum mk_status st = source_read_text(path, &format, out, err);
    if (st == MK_OK) {
        map->separator = format.separator;
        map->decimal = format.decimal;
        take_units(*out, map);
    }
    return st;
}

/* --- guessing ---------------------------------------------------------------------------- */

/* "Theta 1 [deg]", "run.signals.theta_1" become "theta1"; the unit is known already. */
static void plain_name(const struct mk_table_column *c, char out[64])
{
    const char *dot = strrchr(c->name, '.');
    const char *from = dot ? dot + 1 : c->name;
    size_t length = strcspn(from, "[("), n = 0;
    if (*c->unit && strlen(from) == length) {
        const char *score = strrchr(from, '_');
        length = score && score > from ? (size_t)(score - from) : length;
    }
    for (size_t i = 0; i < length && n < 63; i++)
        if (isalnum((unsigned char)from[i]))
            out[n++] = (char)tolower((unsigned char)from[i]);
    out[n] = '\0';
}

struct alias {
    const char *to;
    const char *names; /* blank before and after each */
};

static const struct alias aliases[] = {
    {"t", " t time timestamp times seconds sec zeit tijd clock "},
    {"q1", " q1 theta1 th1 phi1 pos1 position1 angle1 joint1 shoulder shoulderpos shoulderangle "
           "arm armangle "},
    {"q2", " q2 theta2 th2 phi2 pos2 position2 angle2 joint2 elbow elbowpos elbowangle "
           "pendulum pendulumangle pend "},
    {"dq1", " dq1 qd1 vel1 velocity1 omega1 thetadot1 dtheta1 speed1 shouldervel "},
    {"dq2", " dq2 qd2 vel2 velocity2 omega2 thetadot2 dtheta2 speed2 elbowvel "},
    {"tau1", " tau1 torque1 tor1 shouldertorque shouldertau "},
    {"tau2", " tau2 torque2 tor2 elbowtorque elbowtau "},
    {"tau", " tau torque motortorque "},
    {"u1", " u1 command1 input1 "},
    {"u2", " u2 command2 input2 "},
    {"u", " u command input control voltage current motorvoltage motorcurrent vm um im "},
};

/* Names that mean one thing on one rig and another on the next. */
static const struct alias one_joint[] = {
    {"q1", " q theta phi pos position angle alpha wheel wheelangle "},
    {"dq1", " dq qd vel velocity omega speed thetadot wheelspeed "},
};
static const struct alias two_joints[] = {
    {"q1", " theta phi "},
    {"q2", " alpha beta wheel wheelangle "},
};

static const char *known_as(const char *name, const struct alias *list, size_t count)
{
    char wanted[72];
    snprintf(wanted, sizeof wanted, " %s ", name);
    for (size_t i = 0; i < count; i++)
        if (strstr(list[i].names, wanted))
            return list[i].to;
    return NULL;
}

static const char *meaning(const char *name, int joints)
{
    const char *to = known_as(name, aliases, sizeof aliases / sizeof aliases[0]);
    if (!to && joints == 1)
        to = known_as(name, one_joint, sizeof one_joint / sizeof one_joint[0]);
    if (!to && joints == 2)
        to = known_as(name, two_joints, sizeof two_joints / sizeof two_joints[0]);
    return to;
}

/* A column goes by its number where a mapping cannot have its name, unless that means another. */
static void call_column(const struct mk_table *table, const struct mk_table_column *c, char *from,
                        size_t size)
{
    if (!map_can_name(c->name)) {
        snprintf(from, size, "%zu", (size_t)(c - table->column) + 1);
        if (column_of(table, from) == c)
            return;
    }
    snprintf(from, size, "%s", c->name);
}

static void add_guess(struct mk_import_map *map, const struct mk_table *table,
                      const struct mk_table_column *c, const char *to)
{
    if (map->count == MK_IMPORT_COLUMNS || mk_import_map_find(map, to))
        return;
    struct mk_import_column *out = &map->column[map->count++];
    *out = (struct mk_import_column){.sign = 1.0};
    snprintf(out->to, sizeof out->to, "%s", to);
    call_column(table, c, out->from, sizeof out->from);
    const struct unit *unit = *c->unit ? unit_by_name(c->unit) : NULL;
    enum quantity quantity =
        quantity_of_joint_column(to, map->joint_linear, mk_plant(map->rig)->motor_joint);
    if (unit && unit_size(unit, quantity, 1.0) > 0.0 &&
        strcmp(unit->name, native_unit(quantity)) != 0)
        snprintf(out->unit, sizeof out->unit, "%s", unit->name);
}

/* Room for the names of a file's columns, as far as a message goes. */
#define LISTED 300

static void list_columns(const struct mk_table *table, char list[LISTED])
{
    char name[SHOWN];
    list[0] = '\0';
    for (size_t i = 0; i < table->count && strlen(list) < 200; i++)
        snprintf(list + strlen(list), LISTED - strlen(list), "%s%s", i ? ", " : "",
                 mk_show_text(name, sizeof name, table->column[i].name));
}

static enum mk_status not_recognised(const struct mk_table *table, const char *path,
                                     const char *what, struct mk_error *err)
{
    char list[LISTED];
    list_columns(table, list);
    return mk_error_at(err, MK_ERR_PARSE, path, 0, 0,
                       "which column is %s? Say so in a mapping; there are: %s%s%s", what, list,
                       *table->left_out ? "; left out: " : "", table->left_out);
}

enum mk_status mk_import_guess(const struct mk_table *table, const char *path,
                               struct mk_import_map *map, struct mk_error *err)
{
    int joints = mk_plant(map->rig)->joints;
    map->count = 0;
    for (size_t i = 0; i < table->count; i++) {
        char name[64];
        plain_name(&table->column[i], name);
        const char *to = meaning(name, joints);
        bool second = to && strchr(to, '2');
        if (to && (joints == 2 || !second))
            add_guess(map, table, &table->column[i], to);
    }
    static const char *const commands[] = {"u", "u1", "tau", "tau1"};
    bool has_command = false;
    for (size_t i = 0; i < sizeof commands / sizeof commands[0]; i++)
        has_command |= mk_import_map_find(map, commands[i]) != NULL;
    if (!mk_import_map_find(map, "t"))
        return not_recognised(table, path, "time", err);
    if (!mk_import_map_find(map, "q1"))
        return not_recognised(table, path, "the angle of joint 1", err);
    if (joints == 2 && !mk_import_map_find(map, "q2"))
        return not_recognised(table, path, "the angle of joint 2", err);
    return has_command ? MK_OK
                       : not_recognised(table, path,
                                        "the motor's command (if nothing drove the rig, a mapping "
                                        "says [rig] input = none)",
                                        err);
}

/* --- applying ---------------------------------------------------------------------------- */

/* Length of a header's name before its unit: of "Arm angle [deg]" that of "Arm angle". */
static size_t length_without_unit(const char *name)
{
    size_t n = strcspn(name, "[(");
    while (n > 0 && name[n - 1] == ' ')
        n--;
    return n;
}

/* The only column that is called so but for its unit; NULL: there is none, or there are several. */
static const struct mk_table_column *column_without_unit(const struct mk_table *table,
                                                         const char *from)
{
    const struct mk_table_column *found = NULL;
    size_t n = strlen(from);
    for (size_t i = 0; i < table->count; i++) {
        const struct mk_table_column *c = &table->column[i];
        if (n == 0 || length_without_unit(c->name) != n || strncmp(c->name, from, n) != 0)
            continue;
        if (found)
            return NULL;
        found = c;
    }
    return found;
}

static const struct mk_table_column *column_of(const struct mk_table *table, const char *from)
{
    for (size_t i = 0; i < table->count; i++)
        if (strcmp(table->column[i].name, from) == 0)
            return &table->column[i];
    const struct mk_table_column *named = column_without_unit(table, from);
    double number;
    if (named)
        return named;
    if (mk_parse_double_z(from, &number) && number >= 1.0 && number <= (double)table->count &&
        number == floor(number))
        return &table->column[(size_t)number - 1];
    return NULL;
}

static enum mk_status no_such_column(const struct mk_table *table, const char *path, const char *to,
                                     const char *wanted, struct mk_error *err)
{
    char list[LISTED], name[SHOWN];
    list_columns(table, list);
    return mk_error_at(
        err, MK_ERR_PARSE, path, 0, 0,
        "there is no column '%s', from which the mapping takes %s; there are: %s%s%s",
        mk_show_text(name, sizeof name, wanted), to, list, *table->left_out ? "; left out: " : "",
        table->left_out);
}

static enum mk_status check_source(const struct mk_table *table, const char *path, const char *to,
                                   const char *wanted, struct mk_error *err)
{
    const struct mk_table_column *from = column_of(table, wanted);
    char name[SHOWN], text[SHOWN];
    size_t same = 0;
    if (!from)
        return no_such_column(table, path, to, wanted, err);
    for (size_t i = 0; i < table->count; i++)
        same += strcmp(table->column[i].name, wanted) == 0;
    if (same > 1)
        return mk_error_at(err, MK_ERR_PARSE, path, 0, 0,
                           "%zu columns are called %s: which is %s? A mapping can say so by its "
                           "number, column = %zu for the first",
                           same, mk_show_text(name, sizeof name, wanted), to,
                           (size_t)(from - table->column) + 1);
    if (from->text_line)
        return mk_error_at(err, MK_ERR_PARSE, path, from->text_line, 0,
                           "'%s' in column %s is no number; a missing value is an empty field, nan "
                           "or NA",
                           mk_show_text(text, sizeof text, from->text),
                           mk_show_text(name, sizeof name, from->name));
    return MK_OK;
}

/* The columns that a column of the log is made of: itself, what is added, what is subtracted. */
static enum mk_status find_sources(const struct mk_table *table, const char *path,
                                   const struct mk_import_column *c,
                                   const struct mk_table_column *source[3], struct mk_error *err)
{
    const char *const names[3] = {c->from, c->plus, c->minus};
    enum mk_status st = MK_OK;
    for (int i = 0; i < 3 && st == MK_OK; i++) {
        if (!*names[i] && i > 0)
            continue;
        st = check_source(table, path, c->to, names[i], err);
        source[i] = column_of(table, names[i]);
    }
    return st;
}

/* A unit of an entry in the unit of the log's column. */
static double size_in_log(const struct mk_import_map *map, const struct mk_import_column *c,
                          enum quantity quantity)
{
    if (unit_is_counts(c->unit)) {
        struct mk_model rig;
        map_model(map, &rig);
        return mk_model_count(&rig, c->to[1] == '2');
    }
    const struct unit *unit = *c->unit ? unit_by_name(c->unit) : NULL;
    return unit ? unit_size(unit, quantity, map->u_to_torque) : 1.0;
}

static enum mk_status apply_column(const struct mk_table *table, const char *path,
                                   const struct mk_import_map *map,
                                   const struct mk_import_column *c, struct mk_log *log,
                                   struct mk_error *err)
{
    enum quantity quantity =
        quantity_of_joint_column(c->to, map->joint_linear, mk_plant(map->rig)->motor_joint);
    double size = size_in_log(map, c, quantity);
    const struct mk_table_column *source[3] = {NULL, NULL, NULL};
    enum mk_status st = find_sources(table, path, c, source, err);
    if (st != MK_OK)
        return st;
    if (size == 0.0 && quantity == QUANTITY_COMMAND)
        return mk_error_at(
            err, MK_ERR_PARSE, path, 0, 0,
            "%s in %s: how many N m is a unit of command? Give [rig] u_to_torque, or "
            "call the column tau",
            c->to, c->unit);
    double *data = mk_log_add_column(log, c->to);
    if (!data)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for %s", path);
    for (size_t r = 0; r < table->rows; r++) {
        double value = source[0]->data[r];
        if (source[1])
            value += source[1]->data[r];
        if (source[2])
            value -= source[2]->data[r];
        data[r] = c->sign * size * value + c->offset;
        if (isinf(data[r]) && quantity != QUANTITY_TIME)
            return mk_error_at(err, MK_ERR_PARSE, path, 0, 0,
                               "row %zu: %s is infinite; a missing value is an empty field, nan "
                               "or NA",
                               r + 1, c->to);
    }
    return MK_OK;
}

static enum mk_status check_time(struct mk_log *log, const char *path, struct mk_error *err)
{
    double *t = log->columns[0].data, zero = t[0];
    for (size_t r = 0; r < log->rows; r++) {
        double since = t[r] - zero; /* infinite also between two that are not */
        if (!isfinite(since) || (r > 0 && !(since > t[r - 1])))
            return mk_error_at(err, MK_ERR_PARSE, path, 0, 0,
                               "row %zu: time %s: is this the right column?", r + 1,
                               isnan(t[r])        ? "is missing"
                               : !isfinite(since) ? "is infinite"
                                                  : "does not increase");
        t[r] = since;
    }
    return MK_OK;
}

/* The rig of a map: its plant, how its joints move and what their encoders count. */
void map_model(const struct mk_import_map *map, struct mk_model *out)
{
    mk_model_default(map->rig, out);
    for (int j = 0; j < mk_plant(map->rig)->joints; j++) {
        (void)mk_model_set_linear(out, j, map->joint_linear[j], NULL);
        if (map->encoder_resolution[j] > 0.0) {
            out->encoder_resolution[j] = map->encoder_resolution[j];
            out->encoder_cpr[j] = 0;
        } else if (map->encoder_cpr[j] > 0) {
            out->encoder_cpr[j] = map->encoder_cpr[j];
        }
    }
}

static enum mk_status describe(const struct mk_import_map *map, struct mk_log *log)
{
    char number[MK_NUMBER_MAX];
    struct mk_model rig;
    map_model(map, &rig);
    enum mk_status st = mk_log_set_meta(log, "rig", mk_plant(map->rig)->name);
    if (st == MK_OK && map->no_input)
        st = mk_log_set_meta(log, "input", "none");
    if (st == MK_OK && map->u_to_torque > 0.0) {
        mk_format_double(number, map->u_to_torque);
        st = mk_log_set_meta(log, "u_to_torque", number);
    }
    bool counts = map->encoder_cpr[0] > 0 || map->encoder_resolution[0] > 0.0;
    return st == MK_OK ? mk_record_describe_joints(log, &rig, counts) : st;
}

enum mk_status mk_import_apply(const struct mk_table *table, const char *path,
                               const struct mk_import_map *map, struct mk_log **out,
                               struct mk_error *err)
{
    struct mk_log *log = NULL;
    *out = NULL;
    enum mk_status st = mk_log_create(table->rows, &log);
    if (st != MK_OK)
        return mk_error_set(err, st, "no memory for %s", path);
    /* Time first, whatever the order of the map. */
    for (int pass = 0; pass < 2; pass++)
        for (int i = 0; st == MK_OK && i < map->count; i++)
            if ((strcmp(map->column[i].to, "t") == 0) == (pass == 0))
                st = apply_column(table, path, map, &map->column[i], log, err);
    if (st == MK_OK)
        st = check_time(log, path, err);
    if (st == MK_OK && describe(map, log) != MK_OK)
        st = mk_error_set(err, MK_ERR_NOMEM, "no memory for %s", path);
    if (st == MK_OK)
        *out = log;
    else
        mk_log_free(log);
    return st;
}
