/* When an investigation is over: a test was passed, the budget is spent, the rig is at fault too
 * often, or nothing more is gained. */
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "investigate/investigation.h"
#include "investigate/learn.h"

#define MOST_FAULTS 3 /* of the rig */

static void stop(struct journal *j, const char *how, const char *format, ...) MK_PRINTF(3, 4);
static void stop(struct journal *j, const char *how, const char *format, ...)
{
    va_list args;
    va_start(args, format);
    vsnprintf(j->stopped_why, sizeof j->stopped_why, format, args);
    va_end(args);
    snprintf(j->stopped, sizeof j->stopped, "%s", how);
}

/* Did learning from a test that was not passed change what the model consists of? */
static bool same_causes(const struct journal_finding *a, const struct journal_finding *b)
{
    if (a->causes != b->causes || strcmp(a->verdict, b->verdict) != 0)
        return false;
    for (int i = 0; i < a->causes; i++) {
        const size_t n = strcspn(a->cause[i], ":");
        if (strcspn(b->cause[i], ":") != n || strncmp(a->cause[i], b->cause[i], n) != 0)
            return false;
    }
    return true;
}

static const struct journal_finding *finding_before(const struct journal *j, int number)
{
    for (int i = number - 1; i >= 0; i--)
        if (j->experiment[i].finding.verdict[0])
            return &j->experiment[i].finding;
    return NULL;
}

static double worst_of(const struct investigation *v, const struct experiment *x)
{
    int joint;
    return learn_worst(x, &v->j->given, &joint);
}

/* Two tests in a row that were not passed and taught nothing new. */
static bool goes_in_circles(const struct journal *j)
{
    int failed = 0;
    for (int i = j->count - 1; i >= 0 && j->experiment[i].kind == EXPERIMENT_TEST; i--) {
        const struct journal_finding *before = finding_before(j, i);
        if (j->experiment[i].passed || !before || !same_causes(before, &j->experiment[i].finding))
            break;
        failed++;
    }
    return failed >= 2;
}

bool investigation_is_over(struct investigation *v)
{
    struct journal *j = v->j;
    const struct experiment *x = investigation_last(v);
    if (!x)
        return false;
    if (x->kind == EXPERIMENT_TEST && x->passed)
        stop(j, "validated",
             "A fresh experiment was predicted to within %.2g times its noise, by a model that was "
             "written down before it was run.",
             worst_of(v, x));
    else if (investigation_faults(j) >= MOST_FAULTS)
        stop(j, "faults", "%d experiments were stopped by faults of the rig, the last by %s.",
             investigation_faults(j), x->fault);
    else if (investigation_counted(j) >= v->o->experiments || j->count >= JOURNAL_EXPERIMENTS)
        stop(j, "budget", "The budget of %d experiments is spent.%s", v->o->experiments,
             x->kind == EXPERIMENT_TEST ? " The last test was not passed." : "");
    else if (investigation_spent_s(j) > 60.0 * v->o->minutes)
        stop(j, "budget", "The budget of %.3g minutes is spent.%s", v->o->minutes,
             x->kind == EXPERIMENT_TEST ? " The last test was not passed." : "");
    else if (goes_in_circles(j))
        stop(j, "no-gain",
             "Two tests in a row were not passed, at last by %.2g times the noise, and no "
             "experiment within the limits is expected to say why.",
             worst_of(v, x));
    return j->stopped[0] != '\0';
}
