/* Spec files of sweeps. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/in_file.h"
#include "base/ini_file.h"
#include "base/text.h"
#include "experiment/sweep.h"
#include "mechkit/number.h"

static const struct sweep_kind *const kinds[] = {&sweep_robustness, &sweep_basin, &sweep_explain};
#define KINDS (sizeof kinds / sizeof kinds[0])

/* --- values -------------------------------------------------------------------------------- */

static char *next_word(char **save, char *text, const char *separators)
{
    char *word = strtok_r(text, separators, save);
    if (!word)
        return NULL;
    word += strspn(word, " \t");
    for (size_t n = strlen(word); n > 0 && strchr(" \t", word[n - 1]);)
        word[--n] = '\0';
    return word;
}

/* Takes " log" from the end of a text; whether it was there. */
static bool take_log(char *text)
{
    const size_t n = strlen(text);
    if (n <= 4 || strcmp(text + n - 4, " log") != 0)
        return false;
    text[n - 4] = '\0';
    return true;
}

/* Three numbers between colons, and no more. */
static bool three_numbers(char *text, double out[3])
{
    char *save = NULL;
    for (int i = 0; i < 3; i++) {
        const char *part = next_word(&save, i ? NULL : text, ":");
        if (!part || !mk_parse_double_z(part, &out[i]))
            return false;
    }
    return next_word(&save, NULL, ":") == NULL;
}

/* "low : high : count", even steps, or even ratios where "log" follows. */
static bool read_range(const char *text, struct sweep_axis *a)
{
    char copy[MK_INI_TEXT];
    double part[3];
    snprintf(copy, sizeof copy, "%s", text);
    const bool log = take_log(copy);
    if (!three_numbers(copy, part))
        return false;
    const double low = part[0], high = part[1], count = part[2];
    if (!isfinite(low) || !isfinite(high) || count != floor(count) || count < 2.0 ||
        count > SWEEP_VALUES || (log && !(low > 0.0 && high > 0.0)))
        return false;
    a->count = (int)count;
    for (int i = 0; i < a->count; i++) {
        double share = i / (count - 1.0);
        a->value[i] = log ? low * pow(high / low, share) : low + (high - low) * share;
    }
    return true;
}

static bool read_numbers(const char *text, struct sweep_axis *a)
{
    char copy[MK_INI_TEXT], *save = NULL;
    if (strchr(text, ':'))
        return read_range(text, a);
    snprintf(copy, sizeof copy, "%s", text);
    for (char *word = next_word(&save, copy, ","); word; word = next_word(&save, NULL, ","))
        if (a->count == SWEEP_VALUES || !mk_parse_double_z(word, &a->value[a->count]) ||
            !isfinite(a->value[a->count++]))
            return false;
    return a->count > 0;
}

static bool read_words(const char *text, struct sweep_axis *a)
{
    char copy[MK_INI_TEXT], *save = NULL;
    snprintf(copy, sizeof copy, "%s", text);
    for (char *word = next_word(&save, copy, ","); word; word = next_word(&save, NULL, ",")) {
        if (!*word || strlen(word) >= SWEEP_WORD || a->count == SWEEP_VALUES)
            return false;
        strcpy(a->word[a->count++], word);
    }
    return a->count > 0;
}

static enum mk_status check_numbers(const struct sweep *s, const struct sweep_axis *a,
                                    struct mk_error *err)
{
    for (int i = 0; a->key && i < a->count; i++) {
        double x = a->value[i];
        if (x < a->key->min || x > a->key->max || (a->key->type == SWEEP_WHOLE && x != floor(x)))
            return sweep_refuse(s, a, err, "%g: expected %s from %g to %g", x,
                                a->key->type == SWEEP_WHOLE ? "whole numbers" : "numbers",
                                a->key->min, a->key->max);
    }
    return MK_OK;
}

static enum mk_status add_axis(struct sweep *s, const struct sweep_key *key,
                               const struct mk_ini *ini, const struct mk_ini_entry *e,
                               struct mk_error *err)
{
    if (s->axis_count == SWEEP_AXES)
        return mk_error_at(err, MK_ERR_PARSE, s->path, e->line, 0, "more than %d keys", SWEEP_AXES);
    struct sweep_axis *a = &s->axis[s->axis_count++];
    bool words = key && key->type == SWEEP_WORDS;
    a->key = key;
    a->line = e->line;
    if (snprintf(a->name, sizeof a->name, "%s.%s", e->section, e->key) >= (int)sizeof a->name)
        return mk_error_at(err, MK_ERR_PARSE, s->path, e->line, 0, "too long a name");
    a->word = words ? calloc(SWEEP_VALUES, sizeof *a->word) : NULL;
    a->value = words ? NULL : calloc(SWEEP_VALUES, sizeof *a->value);
    if (!a->word && !a->value)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for a sweep");
    if (words)
        return read_words(e->value, a) ? MK_OK : mk_ini_refuse(ini, e, err, "words with commas");
    if (!read_numbers(e->value, a))
        return mk_ini_refuse(ini, e, err,
                             "a number, numbers with commas, or low : high : count (count from 2 "
                             "to 1000; `log` behind it: even ratios)");
    return check_numbers(s, a, err);
}

/* --- sections ------------------------------------------------------------------------------ */

static bool known_section(const struct sweep *s, const char *section)
{
    bool known = strcmp(section, "sweep") == 0 || strcmp(section, "rig") == 0 ||
                 (s->kind->free_section && strcmp(section, s->kind->free_section) == 0);
    for (const struct sweep_key *k = s->kind->key; k->section && !known; k++)
        known = strcmp(section, k->section) == 0;
    return known;
}

static enum mk_status unknown_key(const struct sweep *s, const struct mk_ini_entry *e,
                                  struct mk_error *err)
{
    char known[600] = "", hint[80];
    struct mk_meant meant = {.word = e->key};
    const bool section = known_section(s, e->section);
    for (const struct sweep_key *k = s->kind->key; k->section; k++) {
        size_t used = strlen(known);
        if (strcmp(k->key, e->key) != 0) /* the same key elsewhere is in the list */
            mk_meant_try(&meant, k->key);
        snprintf(known + used, sizeof known - used, "%s[%s] %s", used ? ", " : "", k->section,
                 k->key);
    }
    if (s->kind->free_section)
        snprintf(known + strlen(known), sizeof known - strlen(known), ", [%s] ...",
                 s->kind->free_section);
    return mk_error_at(err, MK_ERR_PARSE, s->path, e->line, 0,
                       section ? "unknown key '%s' in [%s]%s; a sweep of %s has %s"
                               : "unknown key '%s' in unknown section [%s]%s; a sweep of %s has %s",
                       e->key, e->section, mk_meant_text(&meant, hint, sizeof hint), s->kind->name,
                       known);
}

static enum mk_status read_axes(struct sweep *s, struct mk_ini *ini, struct mk_error *err)
{
    enum mk_status st = MK_OK;
    for (int i = 0; i < ini->count && st == MK_OK; i++) {
        struct mk_ini_entry *e = &ini->entry[i];
        if (e->used)
            continue;
        const struct sweep_key *k = s->kind->key;
        while (k->section && (strcmp(k->section, e->section) != 0 || strcmp(k->key, e->key) != 0))
            k++;
        bool is_free = s->kind->free_section && strcmp(e->section, s->kind->free_section) == 0;
        st = k->section || is_free ? add_axis(s, k->section ? k : NULL, ini, e, err)
                                   : unknown_key(s, e, err);
    }
    return st;
}

/* One without keys has no entry that could be found wrong. */
static enum mk_status check_sections(const struct sweep *s, const struct mk_ini *ini,
                                     struct mk_error *err)
{
    for (int i = 0; i < ini->sections; i++)
        if (!known_section(s, ini->section[i].name))
            return mk_error_at(err, MK_ERR_PARSE, s->path, ini->section[i].line, 0,
                               "unknown section [%s]: a sweep of %s has no such",
                               ini->section[i].name, s->kind->name);
    return MK_OK;
}

static enum mk_status read_whole(struct mk_ini *ini, const char *key, double min, double max,
                                 double *out, struct mk_error *err)
{
    struct mk_ini_entry *e = mk_ini_find(ini, "sweep", key);
    if (!e)
        return MK_OK;
    e->used = true;
    if (mk_parse_double_z(e->value, out) && *out >= min && *out <= max && *out == floor(*out))
        return MK_OK;
    char want[80];
    snprintf(want, sizeof want, "a whole number from %.0f to %.0f", min, max);
    return mk_ini_refuse(ini, e, err, want);
}

static enum mk_status read_sweep(struct sweep *s, struct mk_ini *ini, struct mk_error *err)
{
    struct mk_ini_entry *e = mk_ini_find(ini, "sweep", "kind");
    if (!e)
        return mk_error_at(err, MK_ERR_PARSE, s->path, 0, 0,
                           "[sweep] kind is missing: robustness, basin or explain");
    e->used = true;
    for (size_t i = 0; i < KINDS; i++)
        if (strcmp(e->value, kinds[i]->name) == 0)
            s->kind = kinds[i];
    if (!s->kind)
        return mk_ini_refuse(ini, e, err, "robustness, basin or explain");
    double runs = s->kind->default_runs, seed = 1.0;
    enum mk_status st = read_whole(ini, "runs", 1.0, SWEEP_RUNS_MAX, &runs, err);
    if (st == MK_OK)
        st = read_whole(ini, "seed", 0.0, 9e15, &seed, err);
    if (st != MK_OK)
        return st;
    s->runs = (int)runs;
    s->seed = (uint64_t)seed;
    return MK_OK;
}

/* [rig] model = files, one a kind of rig, beside the spec. */
static enum mk_status read_models(struct sweep *s, struct mk_ini *ini, struct mk_error *err)
{
    for (int kind = 0; kind < MK_PLANT_COUNT; kind++)
        mk_model_default((enum mk_plant_kind)kind, &s->model[kind]);
    struct mk_ini_entry *e = mk_ini_find(ini, "rig", "model");
    if (!e)
        return MK_OK;
    e->used = true;
    char copy[MK_INI_TEXT], path[700], *save = NULL;
    snprintf(copy, sizeof copy, "%s", e->value);
    const char *slash = strrchr(s->path, '/');
    for (char *word = next_word(&save, copy, ","); word; word = next_word(&save, NULL, ",")) {
        struct mk_model m;
        snprintf(path, sizeof path, "%.*s%s",
                 slash && *word != '/' ? (int)(slash - s->path + 1) : 0, s->path, word);
        enum mk_status st = mk_in_file_check(path, "the model", err);
        if (st == MK_OK)
            st = mk_model_read(path, &m, err);
        if (st != MK_OK)
            return st;
        if (s->own_model[m.plant])
            return mk_ini_refuse(ini, e, err, "one model a kind of rig");
        s->own_model[m.plant] = true;
        s->model_path[m.plant] = strdup(path);
        if (!s->model_path[m.plant])
            return mk_error_set(err, MK_ERR_NOMEM, "no memory for a sweep");
        s->model[m.plant] = m;
    }
    return MK_OK;
}

static enum mk_status count_runs(struct sweep *s, struct mk_error *err)
{
    s->points = 1;
    for (int i = 0; i < s->axis_count; i++) {
        s->points *= s->axis[i].with_last ? 1 : (size_t)s->axis[i].count;
        if (s->points * (size_t)s->runs > SWEEP_RUNS_MAX)
            return sweep_refuse(s, &s->axis[i], err, "with this key there are more than %d runs",
                                SWEEP_RUNS_MAX);
    }
    s->total = s->points * (size_t)s->runs;
    return MK_OK;
}

/* FNV-1a; everything goes in as text, so that padding and byte order stay out. */
static void mix(uint64_t *hash, const char *text)
{
    do
        *hash = (*hash ^ (unsigned char)*text) * 0x100000001b3u;
    while (*text++);
}

static void mix_number(uint64_t *hash, double value)
{
    char text[MK_NUMBER_MAX];
    mk_format_double(text, value);
    mix(hash, text);
}

static void mix_model(uint64_t *hash, const struct mk_model *m)
{
    mix(hash, mk_plant(m->plant)->name);
    mix_number(hash, m->g);
    mix_number(hash, m->u_max);
    mix_number(hash, m->u_to_torque);
    mix_number(hash, m->rtol);
    mix_number(hash, m->atol);
    mix_number(hash, m->friction_sharpness);
    for (int j = 0; j < mk_model_joints(m); j++) {
        mix_number(hash, m->joint_linear[j]);
        mix_number(hash, mk_model_count(m, j));
    }
    for (int i = 0; i < mk_plant(m->plant)->parameter_count; i++)
        mix_number(hash, m->parameter[i]);
    for (int i = 0; i < m->effect_count; i++) {
        const struct mk_effect_info *info = mk_effect(m->effect[i].index);
        mix(hash, info->name);
        mix_number(hash, m->effect[i].joint);
        for (int k = 0; k < info->parameter_count; k++) {
            mix_number(hash, m->effect[i].value[k]);
            mix_number(hash, m->effect[i].spread[k]);
        }
    }
}

static void take_fingerprint(struct sweep *s)
{
    char text[SWEEP_WORD];
    s->fingerprint = 0xcbf29ce484222325u;
    mix(&s->fingerprint, MK_VERSION);
    mix(&s->fingerprint, s->kind->name);
    mix_number(&s->fingerprint, s->runs);
    mix_number(&s->fingerprint, (double)s->seed);
    for (int i = 0; i < s->axis_count; i++) {
        mix(&s->fingerprint, s->axis[i].name);
        for (int k = 0; k < s->axis[i].count; k++)
            mix(&s->fingerprint, sweep_value_text(&s->axis[i], k, text));
    }
    for (int kind = 0; kind < MK_PLANT_COUNT; kind++)
        if (s->own_model[kind])
            mix_model(&s->fingerprint, &s->model[kind]);
}

enum mk_status sweep_read(const char *path, struct sweep *out, struct mk_error *err)
{
    struct mk_ini *ini = NULL;
    memset(out, 0, sizeof *out);
    if (snprintf(out->path, sizeof out->path, "%s", path) >= (int)sizeof out->path)
        return mk_error_set(err, MK_ERR_RANGE, "%s: too long a path", path);
    enum mk_status st = mk_ini_read(out->path, "the sweep", MK_INI_COMMENTS_ANYWHERE, &ini, err);
    if (st == MK_OK)
        st = read_sweep(out, ini, err);
    if (st == MK_OK)
        st = read_models(out, ini, err);
    if (st == MK_OK)
        st = read_axes(out, ini, err);
    if (st == MK_OK)
        st = check_sections(out, ini, err);
    if (st == MK_OK)
        st = out->kind->prepare(out, err);
    if (st == MK_OK)
        st = count_runs(out, err);
    if (st == MK_OK)
        take_fingerprint(out);
    mk_ini_free(ini);
    return st;
}

void sweep_free(struct sweep *s)
{
    for (int i = 0; i < s->axis_count; i++) {
        free(s->axis[i].value);
        free(s->axis[i].word);
    }
    s->axis_count = 0;
    for (int kind = 0; kind < MK_PLANT_COUNT; kind++) {
        free(s->model_path[kind]);
        s->model_path[kind] = NULL;
    }
}
