#include "investigate/journal.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "mechkit/json.h"

#define JOURNAL "journal.json"
#define FORMAT 1

static const char *const kinds[EXPERIMENT_KINDS] = {"first", "rivals", "rest", "know", "test"};
static const char *const states[EXPERIMENT_STATES] = {"planned", "run", "judged", "learned"};

const char *experiment_kind_name(enum experiment_kind kind)
{
    return kinds[kind];
}

const char *journal_file(const struct journal *j, char buf[JOURNAL_PATH], const char *name)
{
    if (snprintf(buf, JOURNAL_PATH, "%s/%s", j->folder, name) >= JOURNAL_PATH)
        buf[0] = '\0';
    return buf;
}

const char *journal_name(char buf[64], int number, const char *end)
{
    snprintf(buf, 64, "exp-%02d%s", number + 1, end);
    return buf;
}

/* --- one description for both ways ------------------------------------------------------------
 * A field is written or read by the same line, so that neither way can forget it. */

struct both {
    cJSON *at;
    bool reading, failed;
};

static void text(struct both *b, const char *key, char *value, size_t size)
{
    if (!b->reading) {
        b->failed |= !cJSON_AddStringToObject(b->at, key, value);
        return;
    }
    const char *found = cJSON_GetStringValue(cJSON_GetObjectItem(b->at, key));
    b->failed |= !found || strlen(found) >= size;
    snprintf(value, size, "%s", found ? found : "");
}

#define TEXT(b, of, field) text(b, #field, (of)->field, sizeof(of)->field)

/* null is NAN. */
static void number(struct both *b, const char *key, double *value)
{
    if (!b->reading) {
        b->failed |= !cJSON_AddItemToObject(b->at, key, mk_json_number(*value));
        return;
    }
    const cJSON *found = cJSON_GetObjectItem(b->at, key);
    b->failed |= !cJSON_IsNumber(found) && !cJSON_IsNull(found);
    *value = cJSON_IsNumber(found) ? found->valuedouble : (double)NAN;
}

static void numbers(struct both *b, const char *key, double *value, int count)
{
    if (!b->reading) {
        b->failed |= !cJSON_AddItemToObject(b->at, key, mk_json_numbers(value, (size_t)count));
        return;
    }
    const cJSON *list = cJSON_GetObjectItem(b->at, key);
    b->failed |= cJSON_GetArraySize(list) != count;
    for (int i = 0; i < count; i++) {
        const cJSON *found = cJSON_GetArrayItem(list, i);
        value[i] = cJSON_IsNumber(found) ? found->valuedouble : (double)NAN;
    }
}

static void yes_no(struct both *b, const char *key, bool *value)
{
    if (!b->reading) {
        b->failed |= !cJSON_AddBoolToObject(b->at, key, *value);
        return;
    }
    const cJSON *found = cJSON_GetObjectItem(b->at, key);
    b->failed |= !cJSON_IsBool(found);
    *value = cJSON_IsTrue(found);
}

/* One of a list of words. */
static void word(struct both *b, const char *key, int *value, const char *const *list, int count)
{
    char found[32] = "";
    if (!b->reading) {
        b->failed |= !cJSON_AddStringToObject(b->at, key, list[*value]);
        return;
    }
    text(b, key, found, sizeof found);
    for (*value = 0; *value < count && strcmp(list[*value], found) != 0; (*value)++)
        ;
    if (*value == count) {
        b->failed = true;
        *value = 0;
    }
}

static struct both inside(struct both *b, const char *key)
{
    struct both in = {.reading = b->reading};
    in.at = b->reading ? cJSON_GetObjectItem(b->at, key) : cJSON_AddObjectToObject(b->at, key);
    in.failed = !in.at;
    return in;
}

/* A list: its i-th object; `count` is read from it. */
static cJSON *list_of(struct both *b, const char *key, int *count, int most)
{
    cJSON *list = b->reading ? cJSON_GetObjectItem(b->at, key) : cJSON_AddArrayToObject(b->at, key);
    if (b->reading)
        *count = cJSON_GetArraySize(list);
    b->failed |= !cJSON_IsArray(list) || *count > most;
    if (*count > most)
        *count = most;
    return list;
}

static struct both element(struct both *b, cJSON *list, int i)
{
    struct both in = {.reading = b->reading};
    in.at = b->reading ? cJSON_GetArrayItem(list, i) : cJSON_CreateObject();
    in.failed = !in.at;
    if (!b->reading && !cJSON_AddItemToArray(list, in.at))
        in.failed = true;
    return in;
}

static void finding(struct both *b, struct journal_finding *f)
{
    TEXT(b, f, verdict);
    numbers(b, "given", f->given, MK_MAX_JOINTS);
    numbers(b, "refit", f->refit, MK_MAX_JOINTS);
    numbers(b, "extended", f->extended, MK_MAX_JOINTS);
    numbers(b, "noise", f->noise, MK_MAX_JOINTS);
    number(b, "closed", &f->closed);
    TEXT(b, f, rest);
    TEXT(b, f, open);
    cJSON *list = list_of(b, "budget", &f->items, JOURNAL_ITEMS);
    for (int i = 0; i < f->items; i++) {
        struct both in = element(b, list, i);
        text(&in, "name", f->item[i].name, sizeof f->item[i].name);
        number(&in, "share", &f->item[i].share);
        number(&in, "low", &f->item[i].low);
        number(&in, "high", &f->item[i].high);
        b->failed |= in.failed;
    }
    list = list_of(b, "causes", &f->causes, JOURNAL_ITEMS);
    for (int i = 0; i < f->causes; i++) {
        struct both in = element(b, list, i);
        text(&in, "cause", f->cause[i], sizeof f->cause[i]);
        b->failed |= in.failed;
    }
}

static void one_experiment(struct both *b, struct experiment *x)
{
    int kind = (int)x->kind, state = (int)x->state;
    word(b, "kind", &kind, kinds, EXPERIMENT_KINDS);
    word(b, "state", &state, states, EXPERIMENT_STATES);
    x->kind = (enum experiment_kind)kind;
    x->state = (enum experiment_state)state;
    TEXT(b, x, input);
    number(b, "seconds", &x->seconds);
    TEXT(b, x, why);
    TEXT(b, x, expected);
    TEXT(b, x, came);
    TEXT(b, x, planned_at);
    TEXT(b, x, run_at);
    numbers(b, "origin", x->origin, MK_MAX_JOINTS);
    number(b, "ran_s", &x->ran_s);
    yes_no(b, "broken_off", &x->broken_off);
    yes_no(b, "used", &x->used);
    if (!b->reading || cJSON_HasObjectItem(b->at, "left_out")) /* older journals */
        yes_no(b, "left_out", &x->left_out);
    TEXT(b, x, fault);
    number(b, "window_s", &x->window_s);
    numbers(b, "error", x->error, MK_MAX_JOINTS);
    numbers(b, "noise", x->noise, MK_MAX_JOINTS);
    numbers(b, "whole", x->whole, MK_MAX_JOINTS);
    yes_no(b, "passed", &x->passed);
    number(b, "rig_s", &x->rig_s);
    number(b, "compute_s", &x->compute_s);
    struct both in = inside(b, "finding");
    finding(&in, &x->finding);
    b->failed |= in.failed;
}

static void one_control(struct both *b, struct journal_control *c)
{
    TEXT(b, c, setup);
    TEXT(b, c, nominal);
    TEXT(b, c, log);
    yes_no(b, "held", &c->held);
    number(b, "caught_s", &c->caught_s);
    number(b, "sway", &c->sway);
    number(b, "effort", &c->effort);
    TEXT(b, c, fault);
}

static void settings(struct both *b, struct journal_settings *s)
{
    double seed = (double)s->seed, tries = s->tries;
    TEXT(b, s, board);
    TEXT(b, s, device);
    TEXT(b, s, rig);
    yes_no(b, "fast", &s->fast);
    yes_no(b, "stream", &s->stream);
    number(b, "seconds", &s->seconds);
    number(b, "rate_hz", &s->rate_hz);
    number(b, "seed", &seed);
    number(b, "u_max", &s->limits.u_max);
    numbers(b, "q_min", s->limits.q_min, MK_MAX_JOINTS);
    numbers(b, "q_max", s->limits.q_max, MK_MAX_JOINTS);
    numbers(b, "v_max", s->limits.v_max, MK_MAX_JOINTS);
    number(b, "model_off", &s->model_off);
    number(b, "tries", &tries);
    s->seed = (uint64_t)seed;
    s->tries = (int)tries;
}

static bool everything(struct both *b, struct journal *j)
{
    double format = FORMAT;
    number(b, "mechkit-journal", &format);
    if (format != FORMAT)
        return false;
    TEXT(b, j, program);
    TEXT(b, j, begun_at);
    text(b, "model", j->model_path, sizeof j->model_path);
    struct both in = inside(b, "settings");
    settings(&in, &j->settings);
    b->failed |= in.failed;
    TEXT(b, j, looked_at);
    TEXT(b, j, looked);
    number(b, "look_s", &j->look_s);
    cJSON *list = list_of(b, "experiments", &j->count, JOURNAL_EXPERIMENTS);
    for (int i = 0; i < j->count; i++) {
        in = element(b, list, i);
        one_experiment(&in, &j->experiment[i]);
        b->failed |= in.failed;
    }
    TEXT(b, j, stopped);
    TEXT(b, j, stopped_why);
    TEXT(b, j, final_model);
    list = list_of(b, "control", &j->controls, JOURNAL_CONTROLS);
    for (int i = 0; i < j->controls; i++) {
        in = element(b, list, i);
        one_control(&in, &j->control[i]);
        b->failed |= in.failed;
    }
    number(b, "control_s", &j->control_s);
    return !b->failed;
}

/* --- the file --------------------------------------------------------------------------------- */

enum mk_status journal_save(const struct journal *j, struct mk_error *err)
{
    char path[JOURNAL_PATH];
    struct both b = {.at = cJSON_CreateObject()};
    /* The same lines read: what they are given to write stays as it is. */
    struct journal *same = (struct journal *)(uintptr_t)j;
    enum mk_status st = MK_OK;
    if (!b.at || !everything(&b, same))
        st = mk_error_set(err, MK_ERR_NOMEM, "no memory for the journal");
    if (st == MK_OK)
        st = mk_json_write(journal_file(j, path, JOURNAL), b.at, err);
    cJSON_Delete(b.at);
    return st;
}

static enum mk_status load(struct journal *j, const char *path, struct mk_error *err)
{
    struct both b = {.reading = true};
    char given[JOURNAL_PATH];
    enum mk_status st = mk_json_read(path, &b.at, err);
    if (st == MK_OK && !everything(&b, j))
        st = mk_error_at(err, MK_ERR_PARSE, path, 0, 0,
                         "is no journal of an investigation by this version of mechkit: move the "
                         "file, or give another --out");
    if (st == MK_OK)
        st = mk_model_read(journal_file(j, given, "given.ini"), &j->given, err);
    cJSON_Delete(b.at);
    return st;
}

static enum mk_status make_folder(const char *folder, struct mk_error *err)
{
    if (mkdir(folder, 0777) == 0 || errno == EEXIST)
        return MK_OK;
    return mk_error_errno(err, errno, folder, "cannot make the folder");
}

enum mk_status journal_open(struct journal *j, const char *folder, bool make, bool *found,
                            struct mk_error *err)
{
    char path[JOURNAL_PATH];
    memset(j, 0, sizeof *j);
    j->lock = -1;
    *found = false;
    if (!folder[0] || snprintf(j->folder, sizeof j->folder, "%s", folder) >= JOURNAL_PATH - 64)
        return mk_error_set(err, MK_ERR_USAGE,
                            "--out or --resume: the folder's name is empty or too long");
    enum mk_status st = make ? make_folder(folder, err) : MK_OK;
    if (st != MK_OK)
        return st;
    j->lock = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (j->lock < 0)
        return mk_error_errno(err, errno, folder, "cannot open the folder of the investigation");
    if (flock(j->lock, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
        st = mk_error_at(err, MK_ERR_BUSY, folder, 0, 0,
                         "another process is at this investigation: wait for it, or give another "
                         "--out");
    if (st == MK_OK && access(journal_file(j, path, JOURNAL), F_OK) == 0) {
        *found = true;
        st = load(j, path, err);
    }
    if (st != MK_OK)
        journal_close(j);
    return st;
}

void journal_close(struct journal *j)
{
    if (j->lock >= 0)
        close(j->lock);
    j->lock = -1;
}

void journal_put(char text[JOURNAL_TEXT], const char *format, ...)
{
    const size_t used = strlen(text);
    va_list args;
    va_start(args, format);
    vsnprintf(text + used, JOURNAL_TEXT - used, format, args);
    va_end(args);
}

/* --- another investigation -------------------------------------------------------------------- */

static bool same_number(double a, double b)
{
    return (isnan(a) && isnan(b)) || fabs(a - b) <= 1e-12 * fabs(a);
}

static bool same_model(const struct mk_model *a, const struct mk_model *b)
{
    bool same = a->plant == b->plant && a->effect_count == b->effect_count &&
                same_number(a->g, b->g) && same_number(a->u_max, b->u_max) &&
                same_number(a->u_to_torque, b->u_to_torque);
    for (int i = 0; i < mk_model_parameter_count(a) && same; i++)
        same = same_number(mk_model_parameter(a, i), mk_model_parameter(b, i));
    for (int e = 0; e < a->effect_count && same; e++)
        same = a->effect[e].index == b->effect[e].index && a->effect[e].joint == b->effect[e].joint;
    return same;
}

const char *journal_another(const struct journal *j, const struct mk_model *model,
                            const struct journal_settings *s)
{
    const struct journal_settings *a = &j->settings;
    bool limits = same_number(a->limits.u_max, s->limits.u_max);
    for (int k = 0; k < MK_MAX_JOINTS; k++)
        limits = limits && same_number(a->limits.q_min[k], s->limits.q_min[k]) &&
                 same_number(a->limits.q_max[k], s->limits.q_max[k]) &&
                 same_number(a->limits.v_max[k], s->limits.v_max[k]);
    if (!same_model(&j->given, model))
        return "model";
    if (strcmp(a->board, s->board) != 0)
        return "board";
    if (strcmp(a->rig, s->rig) != 0)
        return "rig";
    if (!limits)
        return "limits";
    if (!same_number(a->seconds, s->seconds) || !same_number(a->rate_hz, s->rate_hz) ||
        a->stream != s->stream || a->seed != s->seed)
        return "seconds, rate, seed or stream";
    return NULL;
}
