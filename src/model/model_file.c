/* Model files: [rig], [parameters], [stderr], [simulation] and [effect.NAME] sections. */
#include "base/text.h"
#include "mechkit/model.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/ini_file.h"
#include "base/out_file.h"
#include "mechkit/number.h"

struct reader {
    struct mk_ini *file;
    const char *path;
    bool *unknown; /* by number: the value is `?`; NULL: all are needed */
    struct mk_error *err;
};

static struct mk_ini_entry *find(struct reader *r, const char *section, const char *key)
{
    return mk_ini_find(r->file, section, key);
}

/* --- values ------------------------------------------------------------------------------ */

static enum mk_status get_number(struct reader *r, struct mk_ini_entry *e, double *out)
{
    e->used = true;
    if (!mk_parse_double_z(e->value, out) || !isfinite(*out))
        return mk_ini_refuse(r->file, e, r->err, "a finite number");
    return MK_OK;
}

/* Ends the key of a parameter's spread from log to log. */
#define SPREAD "_spread"

static enum mk_status too_large(struct reader *r, const struct mk_ini_entry *e, const char *help)
{
    return mk_error_at(r->err, MK_ERR_RANGE, r->path, e->line, 0,
                       "%s = %s: no rig has more than %g%s%s%s", e->key, e->value,
                       MK_PARAMETER_MOST, help[0] ? " (" : "", help, help[0] ? ")" : "");
}

/* `?`: a value that is not known. *out keeps the usual one. */
static enum mk_status leave_open(struct reader *r, struct mk_ini_entry *e,
                                 const struct mk_parameter_info *p, int number)
{
    e->used = true;
    if (p->fit == MK_FIT_FIXED || p->fit == MK_FIT_INTEGER)
        return mk_ini_refuse(r->file, e, r->err, "a number: no fit finds this one");
    if (!r->unknown)
        return mk_error_at(r->err, MK_ERR_RANGE, r->path, e->line, 0,
                           "%s in [%s] is `?`, not known, and its value is needed here: mechkit "
                           "identify finds it from a log",
                           e->key, e->section);
    r->unknown[number] = true;
    return MK_OK;
}

/* Of parameter `number` of the model. */
static enum mk_status get_ranged(struct reader *r, struct mk_ini_entry *e,
                                 const struct mk_parameter_info *p, int number, double *out)
{
    if (strcmp(e->value, "?") == 0)
        return leave_open(r, e, p, number);
    enum mk_status st = get_number(r, e, out);
    if (st != MK_OK)
        return st;
    if (p->fit == MK_FIT_INTEGER && *out != floor(*out))
        return mk_ini_refuse(r->file, e, r->err, "a whole number");
    if (*out >= p->min && *out <= p->max)
        return MK_OK;
    if (p->max >= MK_PARAMETER_MOST && fabs(*out) > MK_PARAMETER_MOST)
        return too_large(r, e, p->help);
    if (p->max >= MK_PARAMETER_MOST)
        return mk_error_at(r->err, MK_ERR_RANGE, r->path, e->line, 0,
                           "%s = %s: must be at least %g (%s)", e->key, e->value, p->min, p->help);
    return mk_error_at(r->err, MK_ERR_RANGE, r->path, e->line, 0,
                       "%s = %s: must be between %g and %g (%s)", e->key, e->value, p->min, p->max,
                       p->help);
}

/* A positive number that may be left out. */
static enum mk_status get_positive(struct reader *r, const char *section, const char *key,
                                   double most, double *out)
{
    struct mk_ini_entry *e = find(r, section, key);
    if (!e)
        return MK_OK;
    enum mk_status st = get_number(r, e, out);
    if (st == MK_OK && !(*out > 0.0))
        return mk_error_at(r->err, MK_ERR_RANGE, r->path, e->line, 0, "%s = %s: must be positive",
                           key, e->value);
    if (st == MK_OK && *out > most)
        return too_large(r, e, "");
    return st;
}

static enum mk_status get_joint_units(struct reader *r, struct mk_model *m)
{
    struct mk_ini_entry *e = find(r, "rig", "joint_unit");
    if (!e)
        return MK_OK;
    e->used = true;
    const char *at = e->value;
    for (int j = 0; j < mk_model_joints(m); j++) {
        at += strspn(at, " \t,");
        size_t length = strcspn(at, " \t,");
        bool metre = length == 1 && at[0] == 'm', radian = length == 3 && !strncmp(at, "rad", 3);
        if (!metre && !radian)
            return mk_ini_refuse(r->file, e, r->err, "rad or m for each joint");
        struct mk_error why = MK_ERROR_INIT;
        if (mk_model_set_linear(m, j, metre, &why) != MK_OK)
            return mk_error_at(r->err, MK_ERR_PARSE, r->path, e->line, 0, "%s", why.message);
        at += length;
    }
    if (at[strspn(at, " \t,")])
        return mk_ini_refuse(r->file, e, r->err, "rad or m for each joint");
    return MK_OK;
}

#define MOST_COUNTS 1e8 /* per revolution; of no encoder there is */

/* One number for each joint, or one for all; `got` (may be NULL) says whether the key is there. */
static enum mk_status get_each(struct reader *r, const char *key, const char *wanted,
                               const struct mk_model *m, double least, double most,
                               double out[MK_MAX_JOINTS], bool *got)
{
    struct mk_ini_entry *e = find(r, "rig", key);
    *got = e != NULL;
    if (!e)
        return MK_OK;
    e->used = true;
    const char *at = e->value;
    int n = 0;
    while (n < MK_MAX_JOINTS) {
        at += strspn(at, " \t,");
        size_t length = strcspn(at, " \t,");
        if (length == 0 || !mk_parse_double(at, at + length, &out[n]))
            break;
        if (!(out[n] >= least && out[n] <= most))
            return mk_error_at(r->err, MK_ERR_RANGE, r->path, e->line, 0,
                               "%s = %s: must be %g .. %g", key, e->value, least, most);
        at += length;
        n++;
    }
    if (at[strspn(at, " \t,")] || n < 1)
        return mk_ini_refuse(r->file, e, r->err, wanted);
    if (n == 1 && mk_model_joints(m) == 2)
        out[1] = out[0];
    return MK_OK;
}

/* An encoder by its counts a revolution, or by the size of a count. */
static enum mk_status get_counts(struct reader *r, struct mk_model *m)
{
    double cpr[MK_MAX_JOINTS], size[MK_MAX_JOINTS];
    bool has_cpr, has_size;
    enum mk_status st = get_each(r, "encoder_cpr", "one whole number for each joint", m, 1.0,
                                 MOST_COUNTS, cpr, &has_cpr);
    if (st == MK_OK)
        st = get_each(r, "encoder_resolution", "the size of a count for each joint", m, 1e-12, 1e3,
                      size, &has_size);
    if (st != MK_OK)
        return st;
    const struct mk_ini_entry *e = find(r, "rig", has_cpr ? "encoder_cpr" : "encoder_resolution");
    if (has_cpr && has_size)
        return mk_error_at(r->err, MK_ERR_PARSE, r->path, e->line, 0,
                           "encoder_cpr and encoder_resolution say the same thing: give one");
    for (int j = 0; j < mk_model_joints(m); j++) {
        if (has_size) {
            m->encoder_resolution[j] = size[j];
            m->encoder_cpr[j] = 0;
        } else if (has_cpr && m->joint_linear[j]) {
            return mk_error_at(r->err, MK_ERR_PARSE, r->path, e->line, 0,
                               "joint %d slides: a revolution has no meaning there, give "
                               "encoder_resolution, the size of a count in m",
                               j + 1);
        } else if (has_cpr && cpr[j] != floor(cpr[j])) {
            return mk_error_at(r->err, MK_ERR_PARSE, r->path, e->line, 0,
                               "encoder_cpr = %s: expected one whole number for each joint",
                               e->value);
        } else if (has_cpr) {
            m->encoder_cpr[j] = (int)cpr[j];
        }
    }
    return MK_OK;
}

/* `motor = none`: nothing drives the rig. Without the key a motor does. */
static enum mk_status get_motor(struct reader *r, struct mk_model *m)
{
    struct mk_ini_entry *e = find(r, "rig", "motor");
    if (!e)
        return MK_OK;
    e->used = true;
    m->no_motor = strcmp(e->value, "none") == 0;
    return m->no_motor ? MK_OK
                       : mk_ini_refuse(r->file, e, r->err, "none, or no such key on a driven rig");
}

/* `input = measured` or `commanded`; without the key nobody has said it. */
static enum mk_status get_input(struct reader *r, struct mk_model *m)
{
    struct mk_ini_entry *e = find(r, "rig", "input");
    if (!e)
        return MK_OK;
    e->used = true;
    for (int i = MK_INPUT_MEASURED; i < MK_INPUT_COUNT; i++)
        if (strcmp(e->value, mk_input_name((enum mk_input)i)) == 0) {
            m->input = (enum mk_input)i;
            return MK_OK;
        }
    return mk_ini_refuse(r->file, e, r->err, "measured or commanded");
}

/* Beyond these a simulation says nothing of the model, and its steps know no bound. */
#define MOST_RTOL 0.1 /* share of a state */
#define MOST_ATOL 0.1 /* in a state's unit: rad, rad/s, m, m/s */

static enum mk_status get_tolerance(struct reader *r, const char *key, double most, double *out)
{
    struct mk_ini_entry *e = find(r, "simulation", key);
    if (!e)
        return MK_OK;
    enum mk_status st = get_number(r, e, out);
    if (st == MK_OK && !(*out > 0.0 && *out <= most))
        return mk_error_at(r->err, MK_ERR_RANGE, r->path, e->line, 0,
                           "%s = %s: must be positive, and at most %g", key, e->value, most);
    return st;
}

/* --- sections ---------------------------------------------------------------------------- */

static enum mk_status read_rig(struct reader *r, struct mk_model *m)
{
    struct mk_ini_entry *kind = find(r, "rig", "kind");
    if (!kind)
        return mk_error_at(r->err, MK_ERR_PARSE, r->path, 0, 0,
                           "[rig] kind is missing: which rig is it?");
    kind->used = true;
    const struct mk_plant_info *plant = mk_plant_by_name(kind->value);
    if (!plant)
        return mk_error_at(r->err, MK_ERR_PARSE, r->path, kind->line, 0, "kind = '%s': expected %s",
                           kind->value, mk_plant_names());
    mk_model_default(plant->kind, m);
    enum mk_status st = get_joint_units(r, m);
    if (st == MK_OK)
        st = get_positive(r, "rig", "g", MK_PARAMETER_MOST, &m->g);
    if (st == MK_OK)
        st = get_positive(r, "rig", "u_max", HUGE_VAL, &m->u_max);
    if (st == MK_OK)
        st = get_positive(r, "rig", "u_to_torque", MK_PARAMETER_MOST, &m->u_to_torque);
    if (st == MK_OK)
        st =
            get_positive(r, "rig", "friction_sharpness", MK_PARAMETER_MOST, &m->friction_sharpness);
    if (st == MK_OK)
        st = get_counts(r, m);
    if (st == MK_OK)
        st = get_motor(r, m);
    if (st == MK_OK)
        st = get_input(r, m);
    if (st == MK_OK)
        st = get_tolerance(r, "rtol", MOST_RTOL, &m->rtol);
    if (st == MK_OK)
        st = get_tolerance(r, "atol", MOST_ATOL, &m->atol);
    return st;
}

static enum mk_status read_parameters(struct reader *r, struct mk_model *m)
{
    const struct mk_plant_info *plant = mk_plant(m->plant);
    for (int i = 0; i < plant->parameter_count; i++) {
        const struct mk_parameter_info *p = &plant->parameter[i];
        struct mk_ini_entry *e = find(r, "parameters", p->name);
        if (!e)
            return mk_error_at(r->err, MK_ERR_PARSE, r->path, 0, 0,
                               "[parameters] %s is missing: the %s needs p1 .. p%d", p->name,
                               plant->name, plant->parameter_count);
        enum mk_status st = get_ranged(r, e, p, i, &m->parameter[i]);
        if (st != MK_OK)
            return st;
        e = find(r, "stderr", p->name);
        if (e && (st = get_number(r, e, &m->parameter_stderr[i])) != MK_OK)
            return st;
        if (m->parameter_stderr[i] < 0.0)
            return mk_error_at(r->err, MK_ERR_RANGE, r->path, e->line, 0,
                               "%s = %s: a standard error is not negative", e->key, e->value);
    }
    return MK_OK;
}

#define EFFECT_DIGITS 3 /* of the number of a second effect of the same name, at most */

/* "effect.NAME" or "effect.NAME.2" to NAME; false when it is no such section. */
static bool effect_name(const char *section, char name[MK_INI_TEXT])
{
    if (strncmp(section, "effect.", 7) != 0)
        return false;
    strcpy(name, section + 7);
    char *dot = strchr(name, '.');
    if (dot) {
        const size_t digits = strspn(dot + 1, "0123456789");
        if (digits == 0 || digits > EFFECT_DIGITS || dot[1 + digits])
            return false;
        *dot = '\0';
    }
    return true;
}

static enum mk_status unknown_effect(struct reader *r, int line, const char *name)
{
    char known[1000] = "", text[80];
    struct mk_meant meant = {.word = name};
    for (int i = 0; i < mk_effect_count(); i++) {
        size_t used = strlen(known);
        snprintf(known + used, sizeof known - used, "%s%s", i ? ", " : "", mk_effect(i)->name);
        mk_meant_try(&meant, mk_effect(i)->name);
    }
    return mk_error_at(r->err, MK_ERR_PARSE, r->path, line, 0, "there is no effect '%s'%s%s %s",
                       name, mk_meant_text(&meant, text, sizeof text),
                       meant.name ? " There are" : "; there are", known);
}

/* KEY_spread = S: every log has a value of its own, S from log to log. */
static enum mk_status get_spread(struct reader *r, const char *section,
                                 const struct mk_parameter_info *p, double *out)
{
    char key[MK_INI_TEXT];
    snprintf(key, sizeof key, "%s" SPREAD, p->name);
    struct mk_ini_entry *e = find(r, section, key);
    if (!e)
        return MK_OK;
    enum mk_status st = get_number(r, e, out);
    if (st == MK_OK && !mk_parameter_may_differ(p))
        return mk_error_at(r->err, MK_ERR_PARSE, r->path, e->line, 0,
                           "%s: %s cannot differ from log to log (%s)", e->key, p->name, p->help);
    if (st == MK_OK && *out < 0.0)
        return mk_error_at(r->err, MK_ERR_RANGE, r->path, e->line, 0,
                           "%s = %s: a standard deviation from log to log is at least 0", e->key,
                           e->value);
    return st == MK_OK && *out > MK_PARAMETER_MOST ? too_large(r, e, "") : st;
}

/* Where a section says what it is: its first key, or itself when it has none. */
static int line_of(const struct reader *r, const struct mk_ini_section *section)
{
    const struct mk_ini_entry *first = mk_ini_first(r->file, section->name);
    return first ? first->line : section->line;
}

/* A parameter of an effect that the file does not have, unless under a name that is near to it. */
static enum mk_status missing(struct reader *r, const struct mk_ini_section *section,
                              const struct mk_parameter_info *p)
{
    struct mk_meant meant = {.word = p->name};
    for (int i = 0; i < r->file->count; i++) {
        const struct mk_ini_entry *e = &r->file->entry[i];
        if (!e->used && strcmp(e->section, section->name) == 0)
            mk_meant_try(&meant, e->key);
    }
    if (meant.name)
        return mk_error_at(r->err, MK_ERR_PARSE, r->path, line_of(r, section), 0,
                           "[%s] has an unknown key '%s': did you mean %s? (%s)", section->name,
                           meant.name, p->name, p->help);
    return mk_error_at(r->err, MK_ERR_PARSE, r->path, line_of(r, section), 0,
                       "[%s] %s is missing (%s)", section->name, p->name, p->help);
}

static enum mk_status missing_joint(struct reader *r, const struct mk_model *m,
                                    const struct mk_ini_section *section)
{
    return mk_error_at(r->err, MK_ERR_PARSE, r->path, line_of(r, section), 0,
                       "[%s] joint is missing: joint = 1%s", section->name,
                       mk_model_joints(m) > 1 ? " or 2" : "");
}

/* Adds the effect of a section to the model, at the joint that the section gives. */
static enum mk_status add_effect(struct reader *r, struct mk_model *m,
                                 const struct mk_ini_section *section, const char *name)
{
    double joint = 0.0;
    struct mk_error why = MK_ERROR_INIT;
    struct mk_ini_entry *e = find(r, section->name, "joint");
    enum mk_status st = e ? get_number(r, e, &joint) : MK_OK;
    if (st != MK_OK)
        return st;
    if (!e && mk_effect_by_name(name)->joint_rule == MK_EFFECT_JOINT_ANY)
        return missing_joint(r, m, section);
    if (joint != floor(joint) || fabs(joint) > 100.0)
        return mk_ini_refuse(r->file, e, r->err, "a joint number");
    st = mk_model_add_effect(m, name, (int)joint, &why);
    return st == MK_OK ? MK_OK
                       : mk_error_at(r->err, st == MK_ERR_INVALID ? MK_ERR_PARSE : st, r->path,
                                     e ? e->line : line_of(r, section), 0, "%s", why.message);
}

/* Number (mechkit/ident.h) of the first parameter of the effect that was added last. */
static int first_number_of_last(const struct mk_model *m)
{
    int number = mk_plant(m->plant)->parameter_count;
    for (int k = 0; k + 1 < m->effect_count; k++)
        number += mk_effect(m->effect[k].index)->parameter_count;
    return number;
}

static enum mk_status read_effect(struct reader *r, struct mk_model *m,
                                  const struct mk_ini_section *section)
{
    char name[MK_INI_TEXT];
    effect_name(section->name, name);
    const struct mk_effect_info *info = mk_effect_by_name(name);
    if (!info)
        return unknown_effect(r, line_of(r, section), name);
    enum mk_status st = add_effect(r, m, section, name);
    if (st != MK_OK)
        return st;
    struct mk_effect_use *use = &m->effect[m->effect_count - 1];
    const int first_number = first_number_of_last(m);
    for (int i = 0; i < info->parameter_count; i++) {
        if (!mk_parameter_applies(&info->parameter[i], m->plant))
            continue; /* whoever sets it is told that there is no such key */
        struct mk_ini_entry *e = find(r, section->name, info->parameter[i].name);
        if (!e && info->parameter[i].optional)
            continue;
        if (!e)
            return missing(r, section, &info->parameter[i]);
        st = get_ranged(r, e, &info->parameter[i], first_number + i, &use->value[i]);
        if (st == MK_OK)
            st = get_spread(r, section->name, &info->parameter[i], &use->spread[i]);
        if (st != MK_OK)
            return st;
    }
    return MK_OK;
}

/* A section without keys is an effect as well: whose parameters are missing, or all left out. */
static enum mk_status read_effects(struct reader *r, struct mk_model *m)
{
    char name[MK_INI_TEXT];
    for (int i = 0; i < r->file->sections; i++) {
        const struct mk_ini_section *section = &r->file->section[i];
        if (!effect_name(section->name, name))
            continue;
        enum mk_status st = read_effect(r, m, section);
        if (st != MK_OK)
            return st;
    }
    return MK_OK;
}

/* Keys of [rig] and [simulation]; [parameters], [stderr] and effects have names of their own. */
static const char *const plain_keys[] = {
    "kind",  "g",     "u_max",      "u_to_torque", "encoder_cpr",        "encoder_resolution",
    "motor", "input", "joint_unit", "rtol",        "friction_sharpness", "atol"};

static void try_names(struct mk_meant *meant, const struct mk_parameter_info *p, int count)
{
    for (int i = 0; i < count; i++)
        mk_meant_try(meant, p[i].name);
}

static enum mk_status unknown_key(struct reader *r, const struct mk_model *m,
                                  const struct mk_ini_entry *e)
{
    struct mk_meant meant = {.word = e->key};
    const struct mk_plant_info *plant = mk_plant(m->plant);
    char name[MK_INI_TEXT], text[80];
    if (effect_name(e->section, name)) {
        const struct mk_effect_info *info = mk_effect_by_name(name);
        mk_meant_try(&meant, "joint");
        if (info)
            try_names(&meant, info->parameter, info->parameter_count);
    } else if (strcmp(e->section, "parameters") == 0 || strcmp(e->section, "stderr") == 0) {
        try_names(&meant, plant->parameter, plant->parameter_count);
    } else {
        for (size_t i = 0; i < sizeof plain_keys / sizeof plain_keys[0]; i++)
            mk_meant_try(&meant, plain_keys[i]);
    }
    return mk_error_at(r->err, MK_ERR_PARSE, r->path, e->line, 0, "unknown key '%s' in [%s]%s",
                       e->key, e->section, mk_meant_text(&meant, text, sizeof text));
}

static bool known_section(const char *section)
{
    static const char *const sections[] = {"rig", "parameters", "stderr", "simulation"};
    char name[MK_INI_TEXT];
    for (size_t k = 0; k < sizeof sections / sizeof sections[0]; k++)
        if (strcmp(sections[k], section) == 0)
            return true;
    return effect_name(section, name);
}

static enum mk_status unknown_section(struct reader *r, int line, const char *section)
{
    return mk_error_at(r->err, MK_ERR_PARSE, r->path, line, 0,
                       "unknown section [%s]: expected rig, parameters, stderr, simulation, "
                       "effect.NAME or effect.NAME.2 (to .999)",
                       section);
}

static enum mk_status reject_unused(struct reader *r, const struct mk_model *m)
{
    for (int i = 0; i < r->file->count; i++) {
        const struct mk_ini_entry *e = &r->file->entry[i];
        if (!e->used)
            return known_section(e->section) ? unknown_key(r, m, e)
                                             : unknown_section(r, e->line, e->section);
    }
    for (int i = 0; i < r->file->sections; i++) {
        const struct mk_ini_section *s = &r->file->section[i];
        if (!known_section(s->name))
            return unknown_section(r, s->line, s->name);
    }
    return MK_OK;
}

/* Usual values in place of unknown ones, beside known ones of another size, may make no rig: larger
 * inertias and smaller couplings do. */
static void reconcile(struct mk_model *m, const bool *unknown)
{
    const struct mk_plant_info *plant = mk_plant(m->plant);
    for (int attempt = 0; attempt < 12 && mk_model_check(m, NULL) != MK_OK; attempt++)
        for (int i = 0; i < plant->parameter_count; i++)
            if (unknown[i])
                m->parameter[i] *= plant->parameter[i].min > 0.0 ? 10.0 : 0.1;
}

static enum mk_status interpret(struct reader *r, struct mk_model *m)
{
    enum mk_status st = read_rig(r, m);
    if (st == MK_OK)
        st = read_parameters(r, m);
    if (st == MK_OK)
        st = read_effects(r, m);
    if (st == MK_OK)
        st = reject_unused(r, m);
    if (st != MK_OK)
        return st;
    if (r->unknown)
        reconcile(m, r->unknown);
    struct mk_error why = MK_ERROR_INIT;
    st = mk_model_check(m, &why);
    if (st != MK_OK)
        return mk_error_at(r->err, st, r->path, 0, 0, "%s", why.message);
    return MK_OK;
}

enum mk_status mk_model_read(const char *path, struct mk_model *out, struct mk_error *err)
{
    return mk_model_read_open(path, out, NULL, err);
}

enum mk_status mk_model_read_open(const char *path, struct mk_model *out, bool *unknown,
                                  struct mk_error *err)
{
    struct reader r = {.path = path, .unknown = unknown, .err = err};
    struct mk_model model;
    for (int i = 0; unknown && i < MK_MAX_FIT_PARAMETERS; i++)
        unknown[i] = false;
    enum mk_status st = mk_ini_read(path, "the model", MK_INI_COMMENTS_ANYWHERE, &r.file, err);
    if (st == MK_OK)
        st = interpret(&r, &model);
    if (st == MK_OK)
        *out = model;
    mk_ini_free(r.file);
    return st;
}

/* --- writing ----------------------------------------------------------------------------- */

static void put(FILE *f, const char *key, double value)
{
    char text[MK_NUMBER_MAX];
    mk_format_double(text, value);
    fprintf(f, "%s = %s\n", key, text);
}

/* What a file without the key means. */
static struct mk_model left_out(const struct mk_model *m)
{
    struct mk_model usual;
    mk_model_default(m->plant, &usual);
    for (int j = 0; j < mk_model_joints(m); j++)
        if (usual.joint_linear[j] != m->joint_linear[j])
            (void)mk_model_set_linear(&usual, j, m->joint_linear[j], NULL);
    return usual;
}

/* Whether a parameter has the value that it has when it is left out: one that follows from the
 * rig. Others are written all the same. */
static bool goes_without_saying(const struct mk_model *m, const struct mk_effect_use *use, int k)
{
    const struct mk_parameter_info *p = &mk_effect(use->index)->parameter[k];
    struct mk_model alone = *m;
    alone.effect_count = 0;
    return mk_parameter_goes_without_saying(p, m->plant) &&
           mk_model_add_effect(&alone, mk_effect(use->index)->name, use->joint, NULL) == MK_OK &&
           alone.effect[0].value[k] == use->value[k];
}

static void write_effects(FILE *f, const struct mk_model *m)
{
    for (int i = 0; i < m->effect_count; i++) {
        const struct mk_effect_use *use = &m->effect[i];
        const struct mk_effect_info *info = mk_effect(use->index);
        int nth = 1;
        for (int k = 0; k < i; k++)
            nth += m->effect[k].index == use->index;
        if (nth == 1)
            fprintf(f, "\n[effect.%s]\n", info->name);
        else
            fprintf(f, "\n[effect.%s.%d]\n", info->name, nth);
        if (use->joint > 0)
            fprintf(f, "joint = %d\n", use->joint);
        for (int k = 0; k < info->parameter_count; k++) {
            if (!goes_without_saying(m, use, k))
                put(f, info->parameter[k].name, use->value[k]);
            if (use->spread[k] > 0.0) {
                char key[MK_INI_TEXT];
                snprintf(key, sizeof key, "%s" SPREAD, info->parameter[k].name);
                put(f, key, use->spread[k]);
            }
        }
    }
}

static void write_joints(FILE *f, const struct mk_model *m)
{
    int n = mk_model_joints(m);
    const char *gap = "";
    if (m->joint_linear[0] || m->joint_linear[1]) {
        fprintf(f, "joint_unit =");
        for (int j = 0; j < n; j++)
            fprintf(f, m->joint_linear[j] ? " m" : " rad");
        fprintf(f, "\n");
    }
    if (m->friction_sharpness != left_out(m).friction_sharpness)
        put(f, "friction_sharpness", m->friction_sharpness);
    bool sizes = false;
    for (int j = 0; j < n; j++)
        sizes = sizes || m->encoder_cpr[j] == 0;
    fprintf(f, sizes ? "encoder_resolution = " : "encoder_cpr = ");
    for (int j = 0; j < n; j++, gap = " ") {
        char text[MK_NUMBER_MAX];
        mk_format_double(text, sizes ? mk_model_count(m, j) : m->encoder_cpr[j]);
        fprintf(f, "%s%s", gap, text);
    }
    fprintf(f, "\n");
}

static void write_model(FILE *f, const struct mk_model *m, const char *comment)
{
    const struct mk_plant_info *plant = mk_plant(m->plant);
    for (const char *at = comment; at && *at;) {
        size_t n = strcspn(at, "\n");
        fprintf(f, "# %.*s\n", (int)n, at);
        at += n + (at[n] == '\n');
    }
    fprintf(f, "[rig]\nkind = %s\n", plant->name);
    put(f, "g", m->g);
    put(f, "u_max", m->u_max);
    put(f, "u_to_torque", m->u_to_torque);
    write_joints(f, m);
    if (m->no_motor)
        fprintf(f, "motor = none\n");
    if (m->input != MK_INPUT_UNSAID)
        fprintf(f, "input = %s\n", mk_input_name(m->input));
    fprintf(f, "\n[parameters]\n");
    bool errors = false;
    for (int i = 0; i < plant->parameter_count; i++) {
        put(f, plant->parameter[i].name, m->parameter[i]);
        errors = errors || m->parameter_stderr[i] > 0.0;
    }
    if (errors) {
        fprintf(f, "\n[stderr]\n");
        for (int i = 0; i < plant->parameter_count; i++)
            if (m->parameter_stderr[i] > 0.0)
                put(f, plant->parameter[i].name, m->parameter_stderr[i]);
    }
    fprintf(f, "\n[simulation]\n");
    put(f, "rtol", m->rtol);
    put(f, "atol", m->atol);
    write_effects(f, m);
}

enum mk_status mk_model_write(const char *path, const struct mk_model *model, const char *comment,
                              struct mk_error *err)
{
    struct mk_out_text out;
    enum mk_status st = mk_out_text_open(&out, path, err);
    if (st != MK_OK)
        return st;
    write_model(out.stream, model, comment);
    return mk_out_text_save(&out, err);
}
