/* Sweeps of explain: from which size on is an effect named, on which rig? Every run makes up logs
 * of a rig that has the effect and whose parameters are off, and gives them to explain with the
 * model that has neither (docs/sweep.md).
 *
 * A run with seed s is
 *     rig     p_i = given_i (1 + r_i) ,  r_i uniform within the spread of masses or of friction ,
 *             and the effect, its first parameter the size of the case ;
 *     logs    n to learn from and one held out, each by the virtual rig under a multisine of its
 *             own phases, in whole counts of its encoders ;
 *     answer  what mk_explain() makes of them with the given model ,
 * and its outcome says whether the hidden effect was named. All draws follow from s, the same at
 * every point of the sweep: sizes are compared on the same rigs and commands.
 *
 * The rigs are simulated by the models that explain searches with, so that a sweep measures whether
 * effects can be told apart in such data, not whether the models are right.
 */
#include "explain/sweep_explain.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/random.h"
#include "experiment/robustness.h"
#include "experiment/sweep.h"
#include "mechkit/loop.h"
#include "mechkit/rig.h"
#include "mechkit/signal.h"

/* CLEAN: the case of a rig in which nothing is hidden. */
#define LOGS_MAX 8
#define CLEAN "none"

static const struct sweep_key keys[] = {
    {"rig", "kind", SWEEP_WORDS, 0, 0},
    {"spread", "parameters", SWEEP_NUMBER, 0.0, 0.5},
    {"spread", "friction", SWEEP_NUMBER, 0.0, 0.9},
    {"record", "seconds", SWEEP_NUMBER, 2.0, 120.0},
    {"record", "logs", SWEEP_WHOLE, 1.0, LOGS_MAX},
    {"record", "rate", SWEEP_NUMBER, MK_LOOP_RATE_MIN_HZ, MK_LOOP_RATE_MAX_HZ},
    {"record", "amplitude", SWEEP_NUMBER, 1e-6, 1e6},
    {"record", "noise", SWEEP_NUMBER, 0.0, 100.0},
    {NULL, NULL, SWEEP_NUMBER, 0, 0}};

/* --- the spec ------------------------------------------------------------------------------- */

/* "viscous@2" to its row of the catalogue (NULL: unknown, or none) and joint. */
static const struct mk_effect_info *effect_of(const char *name, int *joint)
{
    char copy[SWEEP_WORD];
    snprintf(copy, sizeof copy, "%s", name);
    char *at = strchr(copy, '@'), *end = at;
    *joint = at ? (int)strtol(at + 1, &end, 10) : 0;
    if (at && (end == at + 1 || *end))
        return NULL;
    if (at)
        *at = '\0';
    return mk_effect_by_name(copy);
}

/* Every [rig] kind has to be a plant's name. */
static enum mk_status check_rigs(const struct sweep *s, struct mk_error *err)
{
    int at = sweep_find(s, "rig.kind");
    if (at < 0)
        return mk_error_at(err, MK_ERR_PARSE, s->path, 0, 0,
                           "[rig] kind is missing: on which rigs are effects to be hidden?");
    for (int i = 0; i < s->axis[at].count; i++)
        if (!mk_plant_by_name(s->axis[at].word[i]))
            return sweep_refuse(s, &s->axis[at], err, "'%s': expected %s", s->axis[at].word[i],
                                mk_plant_names());
    return MK_OK;
}

/* Can it be on every rig of the sweep, with all its values? */
static enum mk_status check_effect(const struct sweep *s, const struct sweep_axis *a,
                                   struct mk_error *err)
{
    const struct sweep_axis *rigs = &s->axis[sweep_find(s, "rig.kind")];
    const char *name = strchr(a->name, '.') + 1;
    int joint;
    const struct mk_effect_info *info = effect_of(name, &joint);
    if (strcmp(name, CLEAN) == 0)
        return MK_OK;
    if (!info)
        return sweep_refuse(s, a, err,
                            "there is no such effect: expected NAME or NAME@JOINT of "
                            "docs/effects.md, or none");
    const struct mk_parameter_info *p = &info->parameter[0];
    for (int i = 0; i < a->count; i++)
        if (a->value[i] < p->min || a->value[i] > p->max)
            return sweep_refuse(s, a, err, "%g: %s is from %g to %g", a->value[i], p->name, p->min,
                                p->max);
    for (int i = 0; i < rigs->count; i++) {
        struct mk_model m = s->model[mk_plant_by_name(rigs->word[i])->kind];
        struct mk_error why = MK_ERROR_INIT;
        if (mk_model_add_effect(&m, info->name, joint, &why) != MK_OK)
            return sweep_refuse(s, a, err, "%s", why.message);
    }
    return MK_OK;
}

/* An axis "case.NAME" of words or numbers with room for SWEEP_VALUES; sweep_free() frees it. */
static enum mk_status new_axis(struct sweep *s, const char *name, bool words,
                               struct sweep_axis **out, struct mk_error *err)
{
    static const struct sweep_key made = {"case", "", SWEEP_WORDS, 0, 0};
    if (s->axis_count == SWEEP_AXES)
        return mk_error_at(err, MK_ERR_PARSE, s->path, 0, 0, "more than %d keys", SWEEP_AXES);
    struct sweep_axis *a = *out = &s->axis[s->axis_count++];
    *a = (struct sweep_axis){.key = &made};
    snprintf(a->name, sizeof a->name, "case.%s", name);
    a->word = words ? calloc(SWEEP_VALUES, sizeof *a->word) : NULL;
    a->value = words ? NULL : calloc(SWEEP_VALUES, sizeof *a->value);
    return a->word || a->value ? MK_OK : mk_error_set(err, MK_ERR_NOMEM, "no memory for a sweep");
}

/* The keys of [effects] become one axis: a case each, with its size. The two axes turn together
 * (with_last), so that an effect meets its own sizes only:
 *     viscous@2 = 1, 2 ;  backlash@1 = 3     ->     (viscous@2, 1), (viscous@2, 2), (backlash@1, 3)
 * . The axes of the section go, and the others move up. */
static enum mk_status gather_cases(struct sweep *s, struct mk_error *err)
{
    struct sweep_axis *effect, *size;
    int given = s->axis_count, kept = 0;
    enum mk_status st = new_axis(s, "effect", true, &effect, err);
    if (st == MK_OK)
        st = new_axis(s, "size", false, &size, err);
    if (st != MK_OK)
        return st;
    size->with_last = true;
    for (int i = 0; i < given; i++) {
        struct sweep_axis *a = &s->axis[i];
        for (int k = 0; !a->key && k < a->count; k++) {
            if (effect->count == SWEEP_VALUES)
                return sweep_refuse(s, a, err, "more than %d cases", SWEEP_VALUES);
            snprintf(effect->word[effect->count++], SWEEP_WORD, "%s", strchr(a->name, '.') + 1);
            size->value[size->count++] = a->value[k];
        }
    }
    if (effect->count == 0)
        return mk_error_at(err, MK_ERR_PARSE, s->path, 0, 0,
                           "[effects] is missing: which effects are to be hidden, of which sizes?");
    for (int i = 0; i < s->axis_count; i++) {
        if (s->axis[i].key)
            s->axis[kept++] = s->axis[i];
        else
            free(s->axis[i].value);
    }
    s->axis_count = kept;
    return MK_OK;
}

static enum mk_status prepare(struct sweep *s, struct mk_error *err)
{
    enum mk_status st = check_rigs(s, err);
    for (int i = 0; i < s->axis_count && st == MK_OK; i++)
        if (!s->axis[i].key)
            st = check_effect(s, &s->axis[i], err);
    return st == MK_OK ? gather_cases(s, err) : st;
}

/* --- a case --------------------------------------------------------------------------------- */

/* How a log is made: length s, samples/s, amplitude of the command in command units, jitter of the
 * readings in counts, and the seed of jitter and phases. `rig` is borrowed. */
struct recording {
    const struct mk_model *rig;
    double seconds, rate_hz, amplitude, noise;
    uint64_t seed;
};

/* What a log of a real rig says in its metadata. */
static enum mk_status describe(struct mk_log *log, const struct recording *r)
{
    char text[64];
    enum mk_status st = mk_record_describe_joints(log, r->rig, true);
    if (st == MK_OK)
        st = mk_log_set_meta(log, "rig", mk_plant(r->rig->plant)->name);
    snprintf(text, sizeof text, "%g", r->rate_hz);
    return st == MK_OK ? mk_log_set_meta(log, "sample_rate_hz", text) : st;
}

/* Rows k = 0, 1, ... at t_k = k T, T the period. A row is read before its command acts, and that is
 * held to the next row:
 *     q_j = rest_j + count_j (size of a count) ,   u_k = clip(signal(t_k), u_max) .
 * Counters are zeroed where the rig hangs. */
static enum mk_status fill(struct mk_log *log, size_t rows, const struct recording *r,
                           struct mk_rig *rig, const struct mk_signal *signal, struct mk_error *err)
{
    const struct mk_plant_info *plant = mk_plant(r->rig->plant);
    double *t = mk_log_add_column(log, "t"), *q[MK_MAX_JOINTS] = {NULL}, *u = NULL;
    bool fine = t != NULL;
    for (int j = 0; j < plant->joints; j++)
        fine = (q[j] = mk_log_add_column(log, mk_log_angle(j))) && fine;
    fine = (u = mk_log_add_column(log, "u")) && fine;
    enum mk_status st = fine ? describe(log, r) : MK_ERR_NOMEM;
    if (st != MK_OK)
        return mk_error_set(err, st, "no memory for a log");
    for (size_t k = 0; k < rows && st == MK_OK; k++) {
        int32_t count[MK_MAX_JOINTS];
        mk_rig_counts(rig, count);
        t[k] = (double)k / r->rate_hz;
        for (int j = 0; j < plant->joints; j++)
            q[j][k] = plant->rest[j] + count[j] * mk_model_count(r->rig, j);
        u[k] = fmax(-r->rig->u_max, fmin(r->rig->u_max, mk_signal_at(signal, t[k])));
        st = mk_rig_advance(rig, 1.0 / r->rate_hz, u[k], err);
    }
    return st;
}

/* What the virtual rig's encoders say under a multisine of 12 harmonics of 0.37 Hz, up to 4.4 Hz:
 * slow enough for a full swing and fast enough for inertia to count. Its phases follow from the
 * seed. *out is the caller's, also after a failure (NULL if it was not made). */
static enum mk_status make_log(const struct recording *r, struct mk_log **out, struct mk_error *err)
{
    char text[80];
    struct mk_rig *rig = NULL;
    struct mk_signal *signal = NULL;
    struct mk_rig_config config;
    size_t rows = (size_t)lround(r->seconds * r->rate_hz);
    mk_rig_config_default(&config);
    config.seed = r->seed;
    config.count_noise = r->noise;
    snprintf(text, sizeof text, "%.17g * multisine(0.37, 12, %u)", r->amplitude,
             (unsigned)(r->seed % 1000003u));
    *out = NULL;
    enum mk_status st = mk_signal_create(text, &signal, err);
    if (st == MK_OK)
        st = mk_rig_create(r->rig, &config, &rig, err);
    if (st == MK_OK && mk_log_create(rows, out) != MK_OK)
        st = mk_error_set(err, MK_ERR_NOMEM, "no memory for a log");
    if (st == MK_OK)
        st = fill(*out, rows, r, rig, signal, err);
    mk_rig_destroy(rig);
    mk_signal_destroy(signal);
    return st;
}

/* The rig: parameters off (trial_rig, without delay and with encoders zeroed right), the effect in.
 * Its first parameter has the size of the case, all others their defaults. */
static enum mk_status make_rig(const struct sweep *s, size_t index, struct mk_model *out,
                               struct mk_error *err)
{
    struct trial_spread spread = {.parameters = sweep_number(s, index, "spread.parameters", 0.05),
                                  .friction = sweep_number(s, index, "spread.friction", 0.15)};
    const struct mk_plant_info *plant = mk_plant_by_name(sweep_word(s, index, "rig.kind", ""));
    enum mk_status st = trial_rig(&s->model[plant->kind], &spread, sweep_seed(s, index), out, err);
    int joint;
    const struct mk_effect_info *info = effect_of(sweep_word(s, index, "case.effect", ""), &joint);
    if (st == MK_OK && info)
        st = mk_model_add_effect(out, info->name, joint, err);
    if (st == MK_OK && info)
        out->effect[out->effect_count - 1].value[0] = sweep_number(s, index, "case.size", 0.0);
    return st;
}

/* --- what explain says ---------------------------------------------------------------------- */

/* The right effect at the wrong joint is not it. */
static bool is_it(const struct mk_effect_info *said, int said_joint,
                  const struct mk_effect_info *hidden, int joint)
{
    return said == hidden && said_joint == joint;
}

/* Causes are named where there is no rest beside them, and where there is one. */
static bool names_causes(const struct mk_explanation *e)
{
    return e->verdict == MK_VERDICT_EFFECT || e->verdict == MK_VERDICT_PARTIAL;
}

/* The order of the questions matters: only where causes are named do they count. */
enum sweep_outcome sweep_judge(const struct mk_explanation *e, const struct mk_effect_info *hidden,
                               int joint)
{
    if (!hidden)
        return names_causes(e) || e->verdict == MK_VERDICT_UNKNOWN ? SWEEP_WRONG : SWEEP_RIGHT;
    if (!names_causes(e))
        return e->verdict == MK_VERDICT_UNKNOWN ? SWEEP_UNKNOWN : SWEEP_MISSED;
    if (is_it(e->cause[0].effect, e->cause[0].joint, hidden, joint))
        return SWEEP_RIGHT;
    for (int i = 1; i < e->cause_count; i++)
        if (is_it(e->cause[i].effect, e->cause[i].joint, hidden, joint))
            return SWEEP_TIED;
    for (int i = 0; i < e->rival_count; i++)
        if (!e->rival[i].distinguishable &&
            is_it(e->rival[i].effect, e->rival[i].joint, hidden, joint))
            return SWEEP_TIED;
    return SWEEP_WRONG;
}

/* Columns said, value, confidence, closed: the causes joined by +, as "viscous@2+coulomb@1", or the
 * verdict where no effect is claimed; the first parameter of the first cause and its confidence,
 * both empty without one; the share of the gap that the extension closes on the held-out log. */
static void describe_answer(const struct mk_explanation *e, char text[SWEEP_LINE])
{
    const bool claims = names_causes(e);
    if (!claims)
        snprintf(text, SWEEP_LINE, "%s", mk_verdict_name(e->verdict));
    for (int i = 0; claims && i < e->cause_count; i++) {
        size_t used = strlen(text);
        snprintf(text + used, SWEEP_LINE / 2 - used, "%s%s", i ? "+" : "",
                 e->cause[i].effect->name);
        used = strlen(text);
        if (e->cause[i].joint)
            snprintf(text + used, SWEEP_LINE / 2 - used, "@%d", e->cause[i].joint);
    }
    sweep_put(text, 1, claims ? e->cause[0].value[0] : (double)NAN);
    sweep_put(text, 2, claims ? e->cause[0].confidence : (double)NAN);
    sweep_put(text, 3, e->closed);
}

/* Gives the logs to explain, the last one held out, with the given model: neither the parameters of
 * the rig nor the effect. One thread, since the runs of a sweep go side by side. An explanation is
 * too large for a thread's stack. */
static enum mk_status ask(const struct sweep *s, size_t index, struct mk_log *const *logs,
                          size_t count, int *outcome, char text[SWEEP_LINE], struct mk_error *err)
{
    struct mk_explanation *e = calloc(1, sizeof *e);
    if (!e)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for an explanation");
    struct mk_explain_options options = {.threads = 1};
    const struct mk_log *given[LOGS_MAX + 1];
    const struct mk_plant_info *plant = mk_plant_by_name(sweep_word(s, index, "rig.kind", ""));
    for (size_t i = 0; i < count; i++)
        given[i] = logs[i];
    enum mk_status st = mk_explain(&s->model[plant->kind], given, count - 1, &given[count - 1], 1,
                                   &options, e, err);
    int joint;
    const struct mk_effect_info *hidden =
        effect_of(sweep_word(s, index, "case.effect", ""), &joint);
    if (st == MK_OK) {
        *outcome = (int)sweep_judge(e, hidden, joint);
        describe_answer(e, text);
    } else if (st == MK_ERR_NUMERIC || st == MK_ERR_RANGE) { /* an answer too */
        *outcome = SWEEP_FAILED;
        snprintf(text, SWEEP_LINE, "%s,,,", mk_strerror(st));
        st = MK_OK;
    }
    free(e);
    return st;
}

/* One run of the sweep, which owns its logs. Seeds of the logs are drawn one after another from the
 * run's, so that the first ones are the same whatever their number. */
static enum mk_status run(const struct sweep *s, size_t index, int *outcome, char text[SWEEP_LINE],
                          struct mk_error *err)
{
    struct mk_model rig;
    struct mk_log *log[LOGS_MAX + 1] = {NULL};
    size_t count = 1 + (size_t)sweep_number(s, index, "record.logs", 2.0); /* one held out */
    enum mk_status st = make_rig(s, index, &rig, err);
    struct recording r = {.rig = &rig,
                          .seconds = sweep_number(s, index, "record.seconds", 10.0),
                          .rate_hz = sweep_number(s, index, "record.rate", MK_LOOP_RATE_HZ),
                          .amplitude = sweep_number(s, index, "record.amplitude", 0.35 * rig.u_max),
                          .noise = sweep_number(s, index, "record.noise", 0.0)};
    struct mk_random random = {sweep_seed(s, index)};
    for (size_t i = 0; i < count && st == MK_OK; i++) {
        r.seed = mk_random_next(&random);
        st = make_log(&r, &log[i], err);
    }
    if (st == MK_OK)
        st = ask(s, index, log, count, outcome, text, err);
    for (size_t i = 0; i < count; i++)
        mk_log_free(log[i]);
    return st;
}

const struct sweep_kind sweep_explain = {
    .name = "explain",
    .key = keys,
    .free_section = "effects",
    .default_runs = 10,
    .batch = 1,
    .outcome = {"right", "tied", "wrong", "missed", "unknown", "failed"},
    .successes = 2,
    .columns = "said,value,confidence,closed",
    .prepare = prepare,
    .run = run,
};
