#include "investigate/learn.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "investigate/zeros.h"
#include "mechkit/log.h"
#include "mechkit/signal.h"
#include "mechkit/sim.h"

#define TOLERATED 2.0 /* times the noise */

/* --- predictions ------------------------------------------------------------------------------ */

/* What the model would read from rest under commands u at times t, nothing fitted: columns t, q1,
 * (q2,) u. `origin`: where its rest reads otherwise than the plant's; `counted`: in whole counts.
 */
static enum mk_status read_model(const struct mk_model *model, const double *origin,
                                 const double *t, const double *u, size_t rows, bool counted,
                                 struct mk_log **out, struct mk_error *err)
{
    const int joints = mk_model_joints(model);
    const double still[MK_MAX_JOINTS] = {0};
    double *own_t = NULL, *own_u = NULL, *q[MK_MAX_JOINTS] = {NULL, NULL};
    double at[MK_MAX_JOINTS], x[MK_MAX_STATES], y[MK_MAX_JOINTS];
    struct mk_sim *sim = NULL;
    enum mk_status st = mk_log_create(rows, out);
    bool made = st == MK_OK && (own_t = mk_log_add_column(*out, "t")) != NULL;
    for (int j = 0; made && j < joints; j++)
        made = (q[j] = mk_log_add_column(*out, mk_log_angle(j))) != NULL;
    made = made && (own_u = mk_log_add_column(*out, "u")) != NULL;
    if (!made)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for a prediction");
    for (int j = 0; j < joints; j++)
        y[j] = mk_plant(model->plant)->rest[j] + origin[j];
    mk_model_unmeasure(model, 0.0, y, at);
    mk_model_initial_state(model, at, still, x);
    st = mk_sim_create(model, NULL, &sim, err);
    if (st == MK_OK)
        st = mk_sim_reset(sim, t[0], x, NULL);
    for (size_t k = 0; st == MK_OK && k < rows; k++) {
        const double held[MK_MAX_INPUTS] = {isfinite(u[k]) ? u[k] : 0.0, 0.0};
        own_t[k] = t[k];
        own_u[k] = held[0];
        mk_sim_measure(sim, y);
        for (int j = 0; j < joints; j++) {
            const double count = mk_model_count(model, j);
            q[j][k] = counted && count > 0.0 ? round(y[j] / count) * count : y[j];
        }
        if (k + 1 < rows)
            st = mk_sim_advance(sim, t[k + 1], held, err);
    }
    mk_sim_destroy(sim);
    return st;
}

/* Adds `times` origins to the angles. */
static void shift(struct mk_log *log, const struct mk_model *model, const double *origin,
                  double times)
{
    for (int j = 0; j < mk_model_joints(model); j++)
        mk_log_shift(log, mk_log_angle(j), times * origin[j]);
}

enum mk_status learn_read_log(const char *path, const struct experiment *x,
                              const struct mk_model *model, struct mk_log **out,
                              struct doubt *doubt, struct mk_error *err)
{
    const enum mk_status st = mk_log_read(path, out, err);
    if (st == MK_OK) {
        const struct doubt found = doubt_cut(*out, model);
        if (doubt)
            *doubt = found;
        shift(*out, model, x->origin, 1.0);
    }
    return st;
}

/* From rest nobody knows a log's own values. */
static struct mk_model without_own_values(const struct mk_model *model)
{
    struct mk_model shared = *model;
    for (int e = 0; e < shared.effect_count; e++)
        memset(shared.effect[e].spread, 0, sizeof shared.effect[e].spread);
    return shared;
}

enum mk_status learn_write_prediction(const char *path, const struct mk_model *model,
                                      const struct experiment *x, double rate_hz,
                                      struct mk_error *err)
{
    const size_t rows = (size_t)lround(x->seconds * rate_hz) + 1;
    const struct mk_model shared = without_own_values(model);
    struct mk_signal *signal = NULL;
    struct mk_log *predicted = NULL;
    double *t = malloc(2 * rows * sizeof *t);
    double *u = t ? t + rows : NULL;
    enum mk_status st = t ? mk_signal_create(x->input, &signal, err)
                          : mk_error_set(err, MK_ERR_NOMEM, "no memory for a prediction");
    for (size_t k = 0; st == MK_OK && k < rows; k++) {
        t[k] = (double)k / rate_hz;
        u[k] = fmax(-model->u_max, fmin(model->u_max, mk_signal_at(signal, t[k])));
    }
    if (st == MK_OK)
        st = read_model(&shared, x->origin, t, u, rows, false, &predicted, err);
    if (st == MK_OK)
        shift(predicted, model, x->origin, -1.0);
    if (st == MK_OK)
        st = mk_log_set_meta(predicted, "prediction_of", x->input);
    if (st == MK_OK)
        st = mk_log_write(path, predicted, err);
    mk_signal_destroy(signal);
    mk_log_free(predicted);
    free(t);
    return st;
}

/* What a right model would be wrong by: start states that are fitted to whole counts where friction
 * is stiff cost more than the noise of the readings. No more than three times that. */
static void raise_noise(struct experiment *x, const struct mk_model *model,
                        const struct mk_log *log)
{
    const double most = 3.0;
    const struct mk_predict_options options = {.window_s = x->window_s};
    struct mk_predict_figures figures;
    const struct mk_model shared = without_own_values(model);
    const double *t = mk_log_get(log, "t"), *u = mk_log_get(log, "u");
    struct mk_log *own = NULL, *windows = NULL;
    if (t && u && read_model(&shared, x->origin, t, u, log->rows, true, &own, NULL) == MK_OK &&
        mk_predict(&shared, own, &options, &windows, &figures, NULL, NULL) == MK_OK)
        for (int j = 0; j < mk_model_joints(model); j++)
            x->noise[j] = fmax(x->noise[j], fmin(figures.rms[j], most * x->noise[j]));
    mk_log_free(own);
    mk_log_free(windows);
}

static double difference(const struct mk_log *a, const struct mk_log *b, const char *column)
{
    const double *x = mk_log_get(a, column), *y = mk_log_get(b, column);
    double sum = 0.0, n = 0.0;
    for (size_t k = 0; x && y && k < a->rows && k < b->rows; k++)
        if (isfinite(x[k]) && isfinite(y[k])) {
            sum += (x[k] - y[k]) * (x[k] - y[k]);
            n += 1.0;
        }
    return n > 0.0 ? sqrt(sum / n) : (double)NAN;
}

double learn_worst(const struct experiment *x, const struct mk_model *model, int *joint)
{
    double worst = 0.0;
    *joint = 0;
    for (int j = 0; j < mk_model_joints(model); j++) {
        const double times = x->error[j] / x->noise[j];
        if (!(times <= worst)) {
            worst = times;
            *joint = j;
        }
    }
    return worst;
}

enum mk_status learn_judge(struct experiment *x, const struct mk_model *model, const char *log_path,
                           const char *prediction_path, struct mk_error *err)
{
    struct mk_log *log = NULL, *written = NULL, *windows = NULL;
    const struct mk_predict_options options = {.window_s = x->window_s};
    struct mk_predict_figures figures;
    size_t failed = 0;
    enum mk_status st = learn_read_log(log_path, x, model, &log, NULL, err);
    if (st == MK_OK)
        st = learn_read_log(prediction_path, x, model, &written, NULL, err);
    if (st == MK_OK)
        st = mk_predict(model, log, &options, &windows, &figures, &failed, err);
    if (st == MK_OK)
        raise_noise(x, model, log);
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        const bool there = st == MK_OK && j < mk_model_joints(model);
        x->error[j] = there ? figures.rms[j] : (double)NAN;
        x->whole[j] = there ? difference(log, written, mk_log_angle(j)) : (double)NAN;
    }
    int joint;
    x->passed = st == MK_OK && failed == 0 && learn_worst(x, model, &joint) <= TOLERATED;
    mk_log_free(log);
    mk_log_free(written);
    mk_log_free(windows);
    return st;
}

/* How far a column goes in its first rows. */
static double extent(const struct mk_log *log, const char *column, size_t rows)
{
    const double *x = mk_log_get(log, column);
    double low = INFINITY, high = -INFINITY;
    for (size_t k = 0; x && k < log->rows && k < rows; k++)
        if (isfinite(x[k])) {
            low = fmin(low, x[k]);
            high = fmax(high, x[k]);
        }
    return high > low ? high - low : 0.0;
}

bool learn_motor_is_dead(const char *log_path, const struct mk_model *model,
                         const char *prediction_path, double *command)
{
    const double still = 2.0, moves = 20.0; /* counts */
    const int motor = mk_plant(model->plant)->motor_joint;
    const double count = mk_model_count(model, motor);
    struct mk_log *log = NULL, *predicted = NULL;
    bool dead = false;
    *command = 0.0;
    if (mk_log_read(log_path, &log, NULL) == MK_OK &&
        mk_log_read(prediction_path, &predicted, NULL) == MK_OK) {
        *command = extent(log, "u", log->rows);
        dead = extent(log, mk_log_angle(motor), log->rows) <= still * count &&
               extent(predicted, mk_log_angle(motor), log->rows) > moves * count;
    }
    mk_log_free(log);
    mk_log_free(predicted);
    return dead;
}

bool learn_errors(const struct mk_model *model, const struct mk_log *const *logs, size_t n,
                  const double noise[MK_MAX_JOINTS], double window_s, double *error)
{
    const struct mk_predict_options options = {.window_s = window_s};
    for (size_t i = 0; i < n; i++) {
        struct mk_predict_figures figures;
        struct mk_log *windows = NULL;
        if (mk_predict(model, logs[i], &options, &windows, &figures, NULL, NULL) != MK_OK)
            return false;
        mk_log_free(windows);
        error[i] = 0.0;
        for (int j = 0; j < mk_model_joints(model); j++)
            error[i] = fmax(error[i], figures.rms[j] / noise[j]);
    }
    return true;
}

/* --- explanations ----------------------------------------------------------------------------- */

void learn_noise(const struct mk_model *model, const struct mk_explanation *e,
                 double noise[MK_MAX_JOINTS])
{
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        noise[j] = mk_model_count(model, j) / sqrt(12.0);
    for (int j = 0; e && j < mk_model_joints(model); j++)
        if (isfinite(e->noise[j]))
            noise[j] = fmax(noise[j], e->noise[j]);
}

bool learn_has_rest(const struct mk_explanation *e, int *joint)
{
    double noise[MK_MAX_JOINTS], worst = 0.0;
    learn_noise(&e->given, e, noise);
    *joint = 0;
    for (int j = 0; j < mk_model_joints(&e->given); j++) {
        const double times = e->budget.extended[j] / fmax(noise[j], e->budget.noise[j]);
        if (times > worst) {
            worst = times;
            *joint = j;
        }
    }
    return worst > TOLERATED || e->verdict == MK_VERDICT_UNKNOWN ||
           e->verdict == MK_VERDICT_PARTIAL;
}

static void name_cause(const struct mk_explanation *e, const struct mk_cause *c, char *text,
                       size_t size)
{
    int n = snprintf(text, size, "%s", c->effect->name);
    if (c->joint > 0)
        n += snprintf(text + n, size - (size_t)n, " at joint %d", c->joint);
    for (int k = 0; k < c->effect->parameter_count && (size_t)n < size; k++) {
        const struct mk_parameter_info *p = &c->effect->parameter[k];
        if (mk_parameter_goes_without_saying(p, e->given.plant))
            continue;
        n += snprintf(text + n, size - (size_t)n, "%s%s %.4g", k ? ", " : ": ", p->name,
                      c->value[k]);
        if (isfinite(c->std_error[k]) && (size_t)n < size)
            n += snprintf(text + n, size - (size_t)n, " +- %.2g", c->std_error[k]);
        if (p->unit[0] && (size_t)n < size)
            n += snprintf(text + n, size - (size_t)n, " %s",
                          mk_effect_parameter_unit(&e->given, c->joint, p));
    }
}

static void name_rest(const struct mk_explanation *e, char *text, size_t size)
{
    const struct mk_budget *b = &e->budget;
    int joint;
    text[0] = '\0';
    if (!learn_has_rest(e, &joint))
        return;
    int n = snprintf(text, size, "%.0f %% of the gap, at joint %d", 100.0 * b->rest, joint + 1);
    for (int i = 0; i < b->goes_with_count && (size_t)n < size; i++)
        n += snprintf(text + n, size - (size_t)n, "%s%s", i ? ", " : "; goes with ",
                      b->goes_with[i]);
}

static void name_open(const struct mk_explanation *e, char *text, size_t size)
{
    int n = 0;
    text[0] = '\0';
    for (int i = 0; i < e->rival_count && (size_t)n < size; i++)
        if (!e->rival[i].distinguishable) {
            const struct mk_rival *r = &e->rival[i];
            n += snprintf(text + n, size - (size_t)n, "%s%s", n ? "; " : "", r->effect->name);
            if (r->joint > 0 && (size_t)n < size)
                n += snprintf(text + n, size - (size_t)n, " at joint %d", r->joint);
            if ((size_t)n < size && r->instead_of >= 0 && r->instead_of < e->cause_count)
                n += snprintf(text + n, size - (size_t)n, " instead of %s",
                              e->cause[r->instead_of].effect->name);
        }
}

/* A zero that is off is a cause of its own where the rest of the model leaves nothing. */
static void name_zeros(const struct mk_explanation *e, const struct mk_model *given,
                       struct journal_finding *out)
{
    double offset;
    int joint;
    for (int j = 0; j < mk_model_joints(given) && out->causes < JOURNAL_ITEMS; j++) {
        if (learn_has_rest(e, &joint) || !zeros_are_off(e, given, j, &offset))
            continue;
        snprintf(out->cause[out->causes++], sizeof out->cause[0],
                 "encoder-offset at joint %d: offset %.4g %s", j + 1, offset,
                 mk_model_unit(given, j, "rad"));
        snprintf(out->verdict, sizeof out->verdict, "%s", mk_verdict_name(MK_VERDICT_EFFECT));
    }
}

void learn_finding(const struct mk_explanation *e, const struct mk_model *given,
                   struct journal_finding *out)
{
    const struct mk_budget *b = &e->budget;
    *out = (struct journal_finding){.closed = b->closed};
    snprintf(out->verdict, sizeof out->verdict, "%s", mk_verdict_name(e->verdict));
    memcpy(out->given, b->given, sizeof out->given);
    memcpy(out->refit, b->refit, sizeof out->refit);
    memcpy(out->extended, b->extended, sizeof out->extended);
    memcpy(out->noise, b->noise, sizeof out->noise);
    for (int i = 0; i < b->item_count && out->items < JOURNAL_ITEMS; i++) {
        struct journal_item *item = &out->item[out->items++];
        mk_budget_item_name(e, &b->item[i], item->name, sizeof item->name);
        item->share = b->item[i].share;
        item->low = b->item[i].low;
        item->high = b->item[i].high;
    }
    const bool claimed = e->offered || e->verdict == MK_VERDICT_EFFECT;
    for (int i = 0; claimed && i < e->cause_count && out->causes < JOURNAL_ITEMS; i++)
        name_cause(e, &e->cause[i], out->cause[out->causes++], sizeof out->cause[0]);
    for (int i = 0; i < e->log_value_count && out->causes < JOURNAL_ITEMS; i++) {
        char *text = out->cause[out->causes++];
        name_cause(e, &e->log_value[i], text, sizeof out->cause[0] - 32);
        strncat(text, ", another in every log", sizeof out->cause[0] - strlen(text) - 1);
    }
    name_zeros(e, given, out);
    name_rest(e, out->rest, sizeof out->rest);
    name_open(e, out->open, sizeof out->open);
}
