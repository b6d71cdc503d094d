/* Mapping files: which column of a foreign file is what. */
#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/ini_file.h"
#include "base/out_file.h"
#include "base/text.h"
#include "exchange/source.h"
#include "exchange/unit.h"
#include "mechkit/exchange.h"
#include "mechkit/number.h"

struct mk_import_column *mk_import_map_find(struct mk_import_map *map, const char *to)
{
    for (int i = 0; i < map->count; i++)
        if (strcmp(map->column[i].to, to) == 0)
            return &map->column[i];
    return NULL;
}

bool map_can_name(const char *column)
{
    size_t n = strlen(column);
    if (n == 0 || column[0] == ';' || column[0] == ' ' || column[n - 1] == ' ' ||
        strstr(column, " ;"))
        return false;
    for (const char *at = column; *at; at++)
        if (iscntrl((unsigned char)*at))
            return false;
    return true;
}

/* --- reading ----------------------------------------------------------------------------- */

struct reader {
    const char *path;
    int line; /* of the entry in hand */
    struct mk_import_map map;
    bool has_rig;
    enum mk_status status;
    struct mk_error *err;
};

static bool refuse(struct reader *r, const char *what, const char *section, const char *key)
{
    r->status =
        mk_error_at(r->err, MK_ERR_PARSE, r->path, r->line, 0, "[%s] %s: %s", section, key, what);
    return false;
}

static bool refuse_kind(struct reader *r, const char *key)
{
    char what[200];
    snprintf(what, sizeof what, "expected %s", mk_plant_names());
    return refuse(r, what, "rig", key);
}

/* `known`: the keys of the section, with commas. */
static bool refuse_key(struct reader *r, const char *known, const char *section, const char *key)
{
    struct mk_meant meant = {.word = key};
    char names[200], text[320], hint[80], *rest = names, *name;
    snprintf(names, sizeof names, "%s", known);
    while ((name = strsep(&rest, ", ")) != NULL)
        if (*name)
            mk_meant_try(&meant, name);
    if (meant.name)
        snprintf(text, sizeof text, "unknown key%s", mk_meant_text(&meant, hint, sizeof hint));
    else
        snprintf(text, sizeof text, "unknown key: %s", known);
    return refuse(r, text, section, key);
}

static bool finite_number(const char *text, double *out)
{
    double value;
    if (!mk_parse_double_z(text, &value) || !isfinite(value))
        return false;
    *out = value;
    return true;
}

/* Of one joint or two; a second one that is not there is 0. */
static bool counts_per_turn(const char *text, int out[2])
{
    int n = 0;
    for (out[1] = 0; n < 2; n++) {
        char *end;
        errno = 0;
        long count = strtol(text, &end, 10);
        if (end == text)
            break;
        if (errno || count < 1 || count > 100000000)
            return false;
        out[n] = (int)count;
        text = end;
    }
    return n > 0 && text[strspn(text, " \t,")] == '\0';
}

/* As counts_per_turn, of sizes. */
static bool counts_sizes(const char *text, double out[2])
{
    int n = 0;
    for (out[1] = 0.0; n < 2; n++) {
        text += strspn(text, " \t,");
        size_t length = strcspn(text, " \t,");
        if (length == 0)
            break;
        if (!mk_parse_double(text, text + length, &out[n]) || !(out[n] > 0.0) || !(out[n] < 1e3))
            return false;
        text += length;
    }
    return n > 0 && text[strspn(text, " \t,")] == '\0';
}

static bool joint_units(const char *text, bool linear[2])
{
    int n = 0;
    for (linear[1] = false; n < 2; n++) {
        text += strspn(text, " \t,");
        size_t length = strcspn(text, " \t,");
        if (length == 0)
            break;
        linear[n] = length == 1 && text[0] == 'm';
        if (!linear[n] && !(length == 3 && strncmp(text, "rad", 3) == 0))
            return false;
        text += length;
    }
    return n > 0 && text[strspn(text, " \t,")] == '\0';
}

static bool on_source(struct reader *r, const char *key, const char *value)
{
    if (strcmp(key, "separator") == 0) {
        if (strcmp(value, "tab") == 0)
            r->map.separator = '\t';
        else if (strcmp(value, "space") == 0)
            r->map.separator = ' ';
        else if (strcmp(value, "comma") == 0 || strcmp(value, ",") == 0)
            r->map.separator = ',';
        else if (strcmp(value, "semicolon") == 0)
            r->map.separator = ';';
        else
            return refuse(r, "expected comma, semicolon, tab or space", "source", key);
        return true;
    }
    if (strcmp(key, "decimal") == 0) {
        if (strcmp(value, "point") != 0 && strcmp(value, "comma") != 0)
            return refuse(r, "expected point or comma", "source", key);
        r->map.decimal = *value == 'p' ? '.' : ',';
        return true;
    }
    return refuse_key(r, "separator, decimal", "source", key);
}

static bool on_rig(struct reader *r, const char *key, const char *value)
{
    if (strcmp(key, "kind") == 0) {
        const struct mk_plant_info *plant = mk_plant_by_name(value);
        if (!plant)
            return refuse_kind(r, key);
        r->map.rig = plant->kind;
        for (int j = 0; j < plant->joints; j++)
            r->map.joint_linear[j] |= plant->joint_motion[j] == MK_JOINT_SLIDES;
        r->has_rig = true;
        return true;
    }
    if (strcmp(key, "u_to_torque") == 0)
        return (finite_number(value, &r->map.u_to_torque) && r->map.u_to_torque > 0.0) ||
               refuse(r, "expected N m per unit of command, above 0", "rig", key);
    if (strcmp(key, "encoder_cpr") == 0)
        return counts_per_turn(value, r->map.encoder_cpr) ||
               refuse(r, "expected counts per revolution of each joint, 1 .. 1e8", "rig", key);
    if (strcmp(key, "encoder_resolution") == 0)
        return counts_sizes(value, r->map.encoder_resolution) ||
               refuse(r, "expected the size of a count of each joint, in rad or m", "rig", key);
    if (strcmp(key, "joint_unit") == 0)
        return joint_units(value, r->map.joint_linear) ||
               refuse(r, "expected rad or m for each joint", "rig", key);
    if (strcmp(key, "input") == 0) {
        r->map.no_input = strcmp(value, "none") == 0;
        return r->map.no_input || refuse(r,
                                         "expected none (nothing drove the rig), or no such key: "
                                         "the command is then the column [u] or [tau]",
                                         "rig", key);
    }
    return refuse_key(r, "kind, joint_unit, u_to_torque, encoder_cpr, encoder_resolution, input",
                      "rig", key);
}

/* Where the name of a source column of that key goes; NULL: it is no such key. */
static char *source_name(struct mk_import_column *c, const char *key)
{
    return strcmp(key, "column") == 0  ? c->from
           : strcmp(key, "plus") == 0  ? c->plus
           : strcmp(key, "minus") == 0 ? c->minus
                                       : NULL;
}

static bool take_unit(struct reader *r, struct mk_import_column *c, const char *section,
                      const char *key, const char *value)
{
    const struct unit *unit = unit_by_name(value);
    enum quantity quantity =
        quantity_of_joint_column(section, r->map.joint_linear, mk_plant(r->map.rig)->motor_joint);
    const bool counts =
        unit_is_counts(value) && (quantity == QUANTITY_ANGLE || quantity == QUANTITY_LENGTH);
    if (!counts && (!unit || unit_size(unit, quantity, 1.0) == 0.0)) {
        char text[160];
        snprintf(text, sizeof text, "%s is no unit of %s: %s ([rig] joint_unit comes first)", value,
                 section, units_of(quantity));
        return refuse(r, text, section, key);
    }
    snprintf(c->unit, sizeof c->unit, "%s", value);
    return true;
}

static bool on_column(struct reader *r, const char *section, const char *key, const char *value)
{
    struct mk_import_column *c = mk_import_map_find(&r->map, section);
    if (!c) {
        if (r->map.count == MK_IMPORT_COLUMNS || strlen(section) >= sizeof c->to)
            return refuse(r, "too many columns, or too long a name", section, key);
        c = &r->map.column[r->map.count++];
        *c = (struct mk_import_column){.sign = 1.0};
        snprintf(c->to, sizeof c->to, "%s", section);
    }
    char *name = source_name(c, key);
    if (name) {
        if (strlen(value) >= sizeof c->from)
            return refuse(r, "too long a name", section, key);
        strcpy(name, value);
        return true;
    }
    if (strcmp(key, "unit") == 0)
        return take_unit(r, c, section, key, value);
    if (strcmp(key, "sign") == 0)
        return (finite_number(value, &c->sign) && c->sign != 0.0) ||
               refuse(r, "expected 1, -1 or another factor", section, key);
    if (strcmp(key, "offset") == 0)
        return finite_number(value, &c->offset) || refuse(r, "expected a number", section, key);
    return refuse_key(r, "column, plus, minus, unit, sign, offset", section, key);
}

static bool on_entry(struct reader *r, const char *section, const char *key, const char *value)
{
    if (!*section)
        return refuse(r, "a key before the first [section]", section, key);
    for (const char *at = value; *at; at++)
        if (iscntrl((unsigned char)*at))
            return refuse(r, "there is a control character in the value", section, key);
    if (*value == ';') /* with a blank before it, as it would be written, a comment begins */
        return refuse(r, "a value cannot begin with ; (a column also goes by its number)", section,
                      key);
    if (strcmp(section, "source") == 0)
        return on_source(r, key, value);
    if (strcmp(section, "rig") == 0)
        return on_rig(r, key, value);
    return on_column(r, section, key, value);
}

/* Every section but [rig] and [source] is a column of a log; one without keys is a column that
 * somebody forgot to fill in. */
static enum mk_status check_section(const struct reader *r, const struct mk_ini *ini,
                                    const struct mk_ini_section *s)
{
    if (strcmp(s->name, "rig") == 0 || strcmp(s->name, "source") == 0)
        return MK_OK;
    if (strlen(s->name) >= sizeof r->map.column[0].to)
        return mk_error_at(r->err, MK_ERR_PARSE, r->path, s->line, 0,
                           "too long a name of a column: at most 31 characters");
    return mk_ini_first(ini, s->name)
               ? MK_OK
               : mk_error_at(r->err, MK_ERR_PARSE, r->path, s->line, 0,
                             "[%s] column is missing: the section has no keys", s->name);
}

/* The section or key without which a mapping says too little; NULL: all are there. */
static const char *missing_part(struct reader *r)
{
    if (!r->has_rig)
        return "[rig] kind";
    if (!mk_import_map_find(&r->map, "t"))
        return "[t]";
    if (!mk_import_map_find(&r->map, "q1"))
        return "[q1]";
    return mk_plant(r->map.rig)->joints > 1 && !mk_import_map_find(&r->map, "q2") ? "[q2]" : NULL;
}

/* What turns is counted by the turn, what slides by the metre, and nothing in two ways. */
static enum mk_status check_joints(const struct reader *r)
{
    struct mk_model rig;
    struct mk_error why = MK_ERROR_INIT;
    mk_model_default(r->map.rig, &rig);
    for (int j = 0; j < mk_model_joints(&rig); j++) {
        if (mk_model_set_linear(&rig, j, r->map.joint_linear[j], &why) != MK_OK)
            return mk_error_at(r->err, MK_ERR_PARSE, r->path, 0, 0, "[rig] joint_unit: %s",
                               why.message);
        if (r->map.joint_linear[j] && r->map.encoder_cpr[j] > 0)
            return mk_error_at(r->err, MK_ERR_PARSE, r->path, 0, 0,
                               "[rig] encoder_cpr: joint %d slides, give encoder_resolution, the "
                               "size of a count in m",
                               j + 1);
    }
    if (r->map.encoder_cpr[0] > 0 && r->map.encoder_resolution[0] > 0.0)
        return mk_error_at(r->err, MK_ERR_PARSE, r->path, 0, 0,
                           "[rig] encoder_cpr and encoder_resolution say the same thing: give one");
    return MK_OK;
}

/* How large a count is, where a column has counts. */
static enum mk_status check_counts(const struct reader *r)
{
    for (int i = 0; i < r->map.count; i++) {
        const struct mk_import_column *c = &r->map.column[i];
        const int joint = c->to[1] == '2';
        if (unit_is_counts(c->unit) && !(r->map.encoder_cpr[joint] > 0) &&
            !(r->map.encoder_resolution[joint] > 0.0))
            return mk_error_at(r->err, MK_ERR_PARSE, r->path, 0, 0,
                               "[%s] unit = %s: how large is one? Give [rig] %s", c->to, c->unit,
                               r->map.joint_linear[joint] ? "encoder_resolution, in m"
                                                          : "encoder_cpr, counts a turn");
    }
    return MK_OK;
}

static bool has_command(struct mk_import_map *map)
{
    static const char *const commands[] = {"u", "u1", "tau", "tau1"};
    for (size_t i = 0; i < sizeof commands / sizeof commands[0]; i++)
        if (mk_import_map_find(map, commands[i]))
            return true;
    return false;
}

static enum mk_status check(struct reader *r)
{
    const bool commanded = has_command(&r->map);
    if (commanded && r->map.no_input)
        return mk_error_at(r->err, MK_ERR_PARSE, r->path, 0, 0,
                           "[rig] input = none, but there is a column for the command: one of the "
                           "two is wrong");
    const char *missing = missing_part(r);
    if (missing)
        return mk_error_at(r->err, MK_ERR_PARSE, r->path, 0, 0, "%s is missing", missing);
    enum mk_status st = check_joints(r);
    if (st == MK_OK)
        st = check_counts(r);
    if (st != MK_OK)
        return st;
    if (!commanded && !r->map.no_input)
        return mk_error_at(
            r->err, MK_ERR_PARSE, r->path, 0, 0,
            "[u] (or [tau]) is missing; if nothing drove the rig, say input = none in "
            "[rig]");
    for (int i = 0; i < r->map.count; i++)
        if (!*r->map.column[i].from)
            return mk_error_at(r->err, MK_ERR_PARSE, r->path, 0, 0, "[%s] column is missing",
                               r->map.column[i].to);
    return MK_OK;
}

enum mk_status mk_import_map_read(const char *path, struct mk_import_map *out, struct mk_error *err)
{
    struct reader r = {.path = path, .err = err};
    struct mk_ini *ini;
    r.status = mk_ini_read(path, "the mapping", MK_INI_COMMENTS_APART, &ini, err);
    if (r.status != MK_OK)
        return r.status;
    for (int i = 0; r.status == MK_OK && i < ini->sections; i++)
        r.status = check_section(&r, ini, &ini->section[i]);
    for (int i = 0; r.status == MK_OK && i < ini->count; i++) {
        const struct mk_ini_entry *e = &ini->entry[i];
        r.line = e->line;
        (void)on_entry(&r, e->section, e->key, e->value);
    }
    mk_ini_free(ini);
    if (r.status == MK_OK)
        r.status = check(&r);
    if (r.status == MK_OK)
        *out = r.map;
    return r.status;
}

/* --- writing ----------------------------------------------------------------------------- */

static void put_comment(FILE *f, const char *comment)
{
    for (const char *line = comment; line && *line;) {
        size_t n = strcspn(line, "\n");
        fprintf(f, "# %.*s\n", (int)n, line);
        line += n + (line[n] == '\n');
    }
}

static void put_number(FILE *f, const char *key, double value)
{
    char text[MK_NUMBER_MAX];
    mk_format_double(text, value);
    fprintf(f, "%s = %s\n", key, text);
}

static void put_text(FILE *f, const char *key, const char *text)
{
    if (*text)
        fprintf(f, "%s = %s\n", key, text);
}

/* [source], where something is known of the file's signs. */
static void put_source(FILE *f, const struct mk_import_map *map)
{
    const char *separator = map->separator == ','    ? "comma"
                            : map->separator == ';'  ? "semicolon"
                            : map->separator == '\t' ? "tab"
                                                     : "space";
    if (!map->separator && !map->decimal)
        return;
    fputs("[source]\n", f);
    if (map->separator)
        put_text(f, "separator", separator);
    if (map->decimal)
        put_text(f, "decimal", map->decimal == ',' ? "comma" : "point");
    fputc('\n', f);
}

/* The size of a count of every joint, in the way that the mapping has it. */
static void put_counts(FILE *f, const struct mk_import_map *map)
{
    const int joints = mk_plant(map->rig)->joints;
    if (map->encoder_cpr[0] > 0) {
        fprintf(f, "encoder_cpr = %d", map->encoder_cpr[0]);
        if (map->encoder_cpr[1] > 0)
            fprintf(f, " %d", map->encoder_cpr[1]);
        fputc('\n', f);
    }
    if (map->encoder_resolution[0] > 0.0) {
        char text[MK_NUMBER_MAX];
        fprintf(f, "encoder_resolution =");
        for (int j = 0; j < joints && map->encoder_resolution[j] > 0.0; j++) {
            mk_format_double(text, map->encoder_resolution[j]);
            fprintf(f, " %s", text);
        }
        fputc('\n', f);
    }
}

static void put_rig(FILE *f, const struct mk_import_map *map)
{
    fprintf(f, "[rig]\nkind = %s\n", mk_plant(map->rig)->name);
    if (map->u_to_torque > 0.0)
        put_number(f, "u_to_torque", map->u_to_torque);
    put_counts(f, map);
    if (map->joint_linear[0] || map->joint_linear[1]) {
        fprintf(f, "joint_unit =");
        for (int j = 0; j < mk_plant(map->rig)->joints; j++)
            fputs(map->joint_linear[j] ? " m" : " rad", f);
        fputc('\n', f);
    }
    if (map->no_input)
        put_text(f, "input", "none");
}

static void put_column(FILE *f, const struct mk_import_column *c)
{
    fprintf(f, "\n[%s]\ncolumn = %s\n", c->to, c->from);
    put_text(f, "plus", c->plus);
    put_text(f, "minus", c->minus);
    put_text(f, "unit", c->unit);
    if (c->sign != 1.0)
        put_number(f, "sign", c->sign);
    if (c->offset != 0.0)
        put_number(f, "offset", c->offset);
}

static void put_map(FILE *f, const struct mk_import_map *map)
{
    put_source(f, map);
    put_rig(f, map);
    for (int i = 0; i < map->count; i++)
        put_column(f, &map->column[i]);
}

static bool can_name_sources(const struct mk_import_column *c)
{
    return map_can_name(c->from) && (!*c->plus || map_can_name(c->plus)) &&
           (!*c->minus || map_can_name(c->minus));
}

enum mk_status mk_import_map_write(const char *path, const struct mk_import_map *map,
                                   const char *comment, struct mk_error *err)
{
    struct mk_out_text out;
    for (int i = 0; i < map->count; i++)
        if (!can_name_sources(&map->column[i]))
            return mk_error_at(err, MK_ERR_USAGE, path, 0, 0,
                               "the name of the column for %s cannot stand in a mapping: rename "
                               "the column",
                               map->column[i].to);
    enum mk_status st = mk_out_text_open(&out, path, err);
    if (st != MK_OK)
        return st;
    put_comment(out.stream, comment);
    put_map(out.stream, map);
    return mk_out_text_save(&out, err);
}
