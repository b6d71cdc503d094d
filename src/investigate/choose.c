/* What is run next: the first experiment, one that tells rival causes apart, one that looks at what
 * has no name, one that makes parameters known better, or a test. plan.cpp finds the input of each.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/origin.h"
#include "investigate/investigation.h"
#include "investigate/learn.h"
#include "investigate/plan.h"
#include "investigate/zeros.h"

#define WINDOW_S INVESTIGATION_WINDOW_S
#define WORTH 0.5         /* nats that an experiment must be expected to gain */
#define CAUTION 0.6       /* of the command's limit, after each fault of the rig */
#define INSIDE 0.85       /* of what the operator allows a joint is what is planned for */
#define SPREAD_FIRST 0.1  /* how far a textbook's values may be off */
#define SPREAD_LATER 0.03 /* those of a model that was fitted */
#define PROCESS_NOISE 1e-3

/* --- limits ----------------------------------------------------------------------------------- */

/* The operator's, else the usual ones of an excitation; less after faults. */
static void plan_within(const struct investigation *v, struct plan_limits *l)
{
    const struct plan_limits *asked = &v->j->settings.limits;
    const struct mk_plant_info *plant = mk_plant(v->j->given.plant);
    struct mk_excite_options usual;
    mk_excite_default(&v->j->given, &usual);
    l->u_max = isfinite(asked->u_max) ? fmin(asked->u_max, v->j->given.u_max) : usual.u_max;
    l->u_max *= pow(CAUTION, investigation_faults(v->j));
    for (int k = 0; k < MK_MAX_JOINTS; k++) {
        const double rest = k < plant->joints ? plant->rest[k] : 0.0;
        l->q_min[k] =
            isfinite(asked->q_min[k]) ? rest + INSIDE * (asked->q_min[k] - rest) : usual.q_min[k];
        l->q_max[k] =
            isfinite(asked->q_max[k]) ? rest + INSIDE * (asked->q_max[k] - rest) : usual.q_max[k];
        /* A run is predicted from its own zero; what ends somewhere ends there all the same. */
        const bool track = k < plant->joints && plant->joint_motion[k] == MK_JOINT_SLIDES;
        l->q_min[k] -= track || isfinite(asked->q_min[k]) ? v->rig.origin[k] : 0.0;
        l->q_max[k] -= track || isfinite(asked->q_max[k]) ? v->rig.origin[k] : 0.0;
        l->v_max[k] = isfinite(asked->v_max[k]) ? INSIDE * asked->v_max[k] : usual.v_max[k];
    }
}

static void ask(struct investigation *v, struct plan_query *q)
{
    const struct journal *j = v->j;
    v->planned = zeros_left_out(&v->model, &j->given);
    *q = (struct plan_query){.model = &v->planned,
                             .spread = v->explained ? SPREAD_LATER : SPREAD_FIRST,
                             .seconds = j->settings.seconds,
                             .rate_hz = j->settings.rate_hz,
                             .process_noise = PROCESS_NOISE,
                             .tries = j->settings.tries,
                             .threads = v->o->threads,
                             .seed = j->settings.seed,
                             .progress = investigation_goes_on,
                             .progress_context = v};
    plan_within(v, &q->limits);
    learn_noise(&j->given, v->explained ? v->e : NULL, q->noise);
    for (int i = 0; i < j->count; i++)
        if (j->experiment[i].used) {
            q->past[q->past_count] = j->experiment[i].input;
            q->past_s[q->past_count++] = j->experiment[i].ran_s;
        }
    for (int i = 0; v->explained && i < v->e->suspect_count; i++)
        q->suspect[q->suspect_count++] =
            (struct plan_suspect){v->e->suspect[i].effect, v->e->suspect[i].joint};
}

/* --- choosing --------------------------------------------------------------------------------- */

static void take(struct experiment *x, const struct plan *p)
{
    snprintf(x->input, sizeof x->input, "%s", p->input);
}

static enum mk_status choose_first(struct investigation *v, struct experiment *x,
                                   struct mk_error *err)
{
    struct plan_query q;
    struct plan p;
    ask(v, &q);
    enum mk_status st = plan_first(&q, &p, err);
    if (st != MK_OK)
        return st;
    x->kind = EXPERIMENT_FIRST;
    take(x, &p);
    journal_put(x->why,
                "Only a textbook model is known. Within the limits, on it and on models up to "
                "%.0f %% off, this input tells most about its parameters and about friction where "
                "no motor is.",
                100.0 * SPREAD_FIRST);
    journal_put(x->expected,
                "Relative standard errors of %.2g %% at most (%s), if only values are wrong.",
                100.0 * p.after, p.about);
    return MK_OK;
}

/* Causes that the data cannot tell apart. */
static bool choose_rivals(struct investigation *v, struct experiment *x)
{
    const struct mk_next_experiment *next = &v->e->next;
    struct plan_query q;
    char why[sizeof next->why];
    if (!next->input[0])
        return false;
    ask(v, &q);
    for (int i = 0; i < q.past_count; i++)
        if (strcmp(q.past[i], next->input) == 0)
            return false;
    if (!plan_keeps(&q, next->input))
        return false;
    x->kind = EXPERIMENT_RIVALS;
    snprintf(x->input, sizeof x->input, "%s", next->input);
    snprintf(why, sizeof why, "%s", next->why);
    char *colon = strchr(why, ':'); /* "backlash at joint 2 or coulomb at joint 2: ..." */
    if (colon)
        *colon = '\0';
    journal_put(x->why,
                "The data cannot tell %s. Of the family of inputs this one favours the right one "
                "most, the other fitted again.",
                why);
    journal_put(x->expected, "The right one favoured by %.3g in log likelihood.", next->odds);
    return true;
}

/* A rest without a name. */
static bool choose_rest(struct investigation *v, struct experiment *x)
{
    int joint;
    struct plan_query q;
    struct plan p;
    const struct mk_budget *b = &v->e->budget;
    if (!learn_has_rest(v->e, &joint))
        return false;
    ask(v, &q);
    const char *with = b->goes_with_count > 0 ? b->goes_with[0] : NULL;
    if (!plan_probe(&q, with, &p))
        return false;
    x->kind = EXPERIMENT_REST;
    take(x, &p);
    journal_put(x->why,
                "Free runs on data that were held back are wrong by %.2g times the noise at joint "
                "%d, and that has no name yet.",
                b->extended[joint] / q.noise[joint], joint + 1);
    if (with)
        journal_put(x->why, " It goes with %s.", with);
    journal_put(x->why, " Next look: %s.", p.kind);
    journal_put(x->expected,
                "Wrong again, by as much or more, and in a way that says more of the cause.");
    return true;
}

/* Whether anything in the model is known worse than `base` or, of a cause, `effect`. */
static bool poorly_known(const struct mk_explanation *e)
{
    const double base = 0.02, effect = 0.2;
    for (int i = 0; i < mk_plant(e->given.plant)->parameter_count; i++)
        if (e->std_error[i] > base * fabs(e->extended.parameter[i]))
            return true;
    for (int c = 0; c < e->cause_count; c++)
        if (e->cause[c].std_error[0] > effect * fabs(e->cause[c].value[0]))
            return true;
    return false;
}

static bool choose_known(struct investigation *v, struct experiment *x)
{
    struct plan_query q;
    struct plan p;
    if (!poorly_known(v->e))
        return false;
    ask(v, &q);
    if (!plan_telling(&q, &p) || p.gain < WORTH)
        return false;
    x->kind = EXPERIMENT_KNOW;
    take(x, &p);
    journal_put(x->why,
                "%s is known to %.2g %% only. Of the family of inputs this one (%s) tells most.",
                p.about, 100.0 * p.before, p.kind);
    journal_put(x->expected, "%s known to %.2g %%; in all %.2g nats less unknown.", p.about,
                100.0 * p.after, p.gain);
    return true;
}

/* The hardest test; where every input was run, the first once more. */
static void choose_test(struct investigation *v, struct experiment *x, bool at_the_end)
{
    struct plan_query q;
    struct plan p;
    int joint;
    const bool rest = learn_has_rest(v->e, &joint);
    ask(v, &q);
    x->kind = EXPERIMENT_TEST;
    if (plan_test(&q, &p)) {
        take(x, &p);
        journal_put(x->why,
                    "%s Under this input (%s), of all that keep to the limits, the prediction is "
                    "least sure of itself: the hardest test. Nothing is fitted to it before it is "
                    "judged.",
                    at_the_end ? "The budget ends with a test."
                    : rest
                        ? "What is left has no name, and no other look within the limits says more."
                        : "The model explains all that was run.",
                    p.kind);
    } else {
        snprintf(x->input, sizeof x->input, "%s", v->j->experiment[0].input);
        journal_put(x->why, "No other input keeps to the limits: the first one again, as a test.");
    }
    const char *sep = "Free runs of ";
    journal_put(x->expected,
                "%s%.2g s from the model as it was written down are within twice the noise:", sep,
                WINDOW_S);
    for (int k = 0; k < mk_model_joints(&v->model); k++)
        journal_put(x->expected, "%s %.2g %s at joint %d", k ? "," : "", 2e3 * q.noise[k],
                    mk_model_unit(&v->model, k, "mrad"), k + 1);
    journal_put(x->expected, ".");
}

/* Room for one more that is no test, and its test. */
static bool budget_is_nearly_spent(const struct investigation *v)
{
    const int done = investigation_counted(v->j);
    const double each = done > 0 ? investigation_spent_s(v->j) / done : 0.0;
    return done >= v->o->experiments - 1 || v->j->count >= JOURNAL_EXPERIMENTS - 1 ||
           investigation_spent_s(v->j) + 2.0 * each > 60.0 * v->o->minutes;
}

/* What is run next, and what the model predicts of it. */
static enum mk_status plan_next(struct investigation *v, struct experiment *x, struct mk_error *err)
{
    const struct journal *j = v->j;
    char name[64], path[JOURNAL_PATH];
    enum mk_status st = MK_OK;
    if (!v->explained)
        st = choose_first(v, x, err);
    else if (budget_is_nearly_spent(v))
        choose_test(v, x, true);
    else if (!choose_rivals(v, x) && !choose_rest(v, x) && !choose_known(v, x))
        choose_test(v, x, false);
    if (st != MK_OK)
        return st;
    learn_noise(&j->given, v->explained ? v->e : NULL, x->noise);
    return learn_write_prediction(
        journal_file(j, path, journal_name(name, j->count, "-prediction.csv")), &v->model, x,
        j->settings.rate_hz, err);
}

/* A model that makes nonsense of its logs may run away where it is simulated: then what was given
 * is gone on from, as if nothing were known. */
static enum mk_status plan_from_what_was_given(struct investigation *v, struct experiment *x,
                                               struct mk_error *err)
{
    investigation_say(v, "What explains the logs so far cannot be simulated: the next experiment "
                         "is planned from the model that was given.");
    x->why[0] = x->expected[0] = '\0';
    v->explained = false;
    v->model = v->j->given;
    return plan_next(v, x, err);
}

enum mk_status investigation_choose(struct investigation *v, struct mk_error *err)
{
    struct journal *j = v->j;
    char name[64], path[JOURNAL_PATH];
    struct experiment *x = &j->experiment[j->count];
    memset(x, 0, sizeof *x);
    /* Where it rests is part of what is predicted. */
    const double rig_begin = rig_seconds(&v->rig);
    enum mk_status st = rig_rest(&v->rig, err);
    if (st != MK_OK)
        return st;
    memcpy(x->origin, v->rig.origin, sizeof x->origin);
    x->rig_s = rig_seconds(&v->rig) - rig_begin;
    const double begin = investigation_now_s();
    x->seconds = j->settings.seconds;
    x->window_s = WINDOW_S;
    st = plan_next(v, x, err);
    if (st == MK_ERR_NUMERIC && v->explained)
        st = plan_from_what_was_given(v, x, err);
    if (st == MK_OK)
        st = mk_model_write(journal_file(j, path, journal_name(name, j->count, "-model.ini")),
                            &v->model, "the model before this experiment was run", err);
    if (st != MK_OK)
        return st;
    (void)mk_date_text(x->planned_at);
    x->compute_s = investigation_now_s() - begin;
    j->count++;
    investigation_say(v, "Experiment %d (%s): %s", j->count, experiment_kind_name(x->kind), x->why);
    investigation_say(v, "  input %s", x->input);
    investigation_say(v, "  expected: %s", x->expected);
    return investigation_save(v, err);
}
