/* What all logs of an investigation say together. */
#include <math.h>

#include "investigate/investigation.h"
#include "investigate/learn.h"
#include "investigate/zeros.h"

#define WINDOW_S INVESTIGATION_WINDOW_S
#define BETTER 0.8 /* of the rest: what is left with the arm's direction free */
#define AGREES 3.0 /* times the noise: a log that is foretold */
#define ODD 8.0    /* one that is not */

enum mk_status investigation_read_log(struct investigation *v, int number, struct doubt *doubt,
                                      struct mk_error *err)
{
    char name[64], path[JOURNAL_PATH];
    if (v->log[number])
        return MK_OK;
    return learn_read_log(journal_file(v->j, path, journal_name(name, number, ".csv")),
                          &v->j->experiment[number], &v->j->given, &v->log[number], doubt, err);
}

static enum mk_status explain_logs(struct investigation *v, const struct mk_log *const *logs,
                                   size_t n, bool turned, struct mk_explanation *e,
                                   struct mk_error *err)
{
    struct mk_model from;
    const struct mk_explain_options options = {
        .threads = v->o->threads, .progress = investigation_goes_on, .progress_context = v};
    if (!turned || !zeros_turned(&v->j->given, n > 1, &from))
        zeros_free(&v->j->given, n > 1, &from);
    return mk_explain(&from, logs, n, NULL, 0, &options, e, err);
}

/* By how many times the noise the extended model is wrong, of the joint where that is most. */
static double left_over(const struct investigation *v, const struct mk_explanation *e)
{
    double noise[MK_MAX_JOINTS], worst = 0.0;
    learn_noise(&v->j->given, e, noise);
    for (int j = 0; j < mk_model_joints(&v->j->given); j++)
        worst = fmax(worst, e->budget.extended[j] / fmax(noise[j], e->budget.noise[j]));
    return worst;
}

/* The logs that are learned from; number[i]: of which experiment. */
struct logs {
    const struct mk_log *log[JOURNAL_EXPERIMENTS];
    int number[JOURNAL_EXPERIMENTS];
    size_t n;
};

static enum mk_status gather(struct investigation *v, int count, struct logs *out,
                             struct mk_error *err)
{
    enum mk_status st = MK_OK;
    out->n = 0;
    for (int i = 0; i < count && st == MK_OK; i++)
        if (v->j->experiment[i].used) {
            st = investigation_read_log(v, i, NULL, err);
            out->log[out->n] = v->log[i];
            out->number[out->n++] = i;
        }
    return st;
}

/* Where a rest is left, an arm may have been zeroed in another direction than that of the law. */
static void try_turned(struct investigation *v, const struct logs *logs)
{
    struct mk_model ignored;
    int joint;
    if (v->turned || !learn_has_rest(v->e, &joint) || !zeros_turned(&v->j->given, false, &ignored))
        return;
    if (explain_logs(v, logs->log, logs->n, true, v->other, NULL) == MK_OK &&
        left_over(v, v->other) < BETTER * left_over(v, v->e)) {
        *v->e = *v->other;
        v->turned = true;
    }
}

static size_t largest(const double *x, size_t n)
{
    size_t most = 0;
    for (size_t i = 1; i < n; i++)
        most = x[i] > x[most] ? i : most;
    return most;
}

/* Whether the model foretells all logs but the one at `odd`, and not that one. */
static bool all_but(const struct investigation *v, const struct mk_explanation *e,
                    const struct logs *logs, size_t odd)
{
    double noise[MK_MAX_JOINTS], error[JOURNAL_EXPERIMENTS], others = 0.0;
    learn_noise(&v->j->given, e, noise);
    struct mk_model model = e->extended;
    zeros_vary(&model, &v->j->given);
    if (!learn_errors(&model, logs->log, logs->n, noise, WINDOW_S, error))
        return false;
    for (size_t i = 0; i < logs->n; i++)
        others = i == odd ? others : fmax(others, error[i]);
    return others < AGREES && error[odd] > ODD;
}

/* One log of several may tell of somebody who was at the rig. It is left out, once, where what the
 * others say foretells all of them and not it. */
static void leave_odd_out(struct investigation *v, const struct logs *logs)
{
    struct journal *j = v->j;
    double noise[MK_MAX_JOINTS], error[JOURNAL_EXPERIMENTS];
    struct logs others = {.n = 0};
    for (int i = 0; i < j->count; i++)
        if (j->experiment[i].left_out)
            return;
    learn_noise(&j->given, v->e, noise);
    if (logs->n < 3 || !learn_errors(&v->e->extended, logs->log, logs->n, noise, WINDOW_S, error))
        return;
    const size_t odd = largest(error, logs->n);
    if (error[odd] < ODD)
        return;
    for (size_t i = 0; i < logs->n; i++)
        if (i != odd)
            others.log[others.n++] = logs->log[i];
    if (explain_logs(v, others.log, others.n, v->turned, v->other, NULL) != MK_OK ||
        !all_but(v, v->other, logs, odd))
        return;
    struct experiment *x = &j->experiment[logs->number[odd]];
    *v->e = *v->other;
    x->used = false;
    x->left_out = true;
    journal_put(x->came,
                " Left out: the others agree with each other and not with it. Was somebody at the "
                "rig?");
    investigation_say(
        v, "  experiment %d is left out: the others agree with each other and not with it",
        logs->number[odd] + 1);
}

enum mk_status investigation_explain(struct investigation *v, int count, struct mk_error *err)
{
    struct logs logs;
    enum mk_status st = gather(v, count, &logs, err);
    v->explained = false;
    if (st != MK_OK || logs.n == 0)
        return st;
    st = explain_logs(v, logs.log, logs.n, v->turned, v->e, err);
    v->explained = st == MK_OK;
    if (v->explained) {
        try_turned(v, &logs);
        leave_odd_out(v, &logs);
    }
    if (investigation_cancelled(v))
        return mk_error_set(err, MK_ERR_INTR, "ended by a signal, motor off");
    if (v->explained) {
        v->model = v->e->extended;
        zeros_vary(&v->model, &v->j->given);
    }
    return st;
}
