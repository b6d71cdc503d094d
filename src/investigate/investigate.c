#include "investigate/investigate.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "base/origin.h"
#include "investigate/investigation.h"
#include "investigate/learn.h"
#include "investigate/notebook.h"
#include "investigate/nudge.h"
#include "investigate/runs.h"
#include "investigate/salvage.h"
#include "investigate/zeros.h"
#include "mechkit/log.h"

#define WINDOW_S INVESTIGATION_WINDOW_S
#define LEAST_S 1.0       /* of a log that is learned from */
#define WORTH 0.5         /* nats that an experiment must be expected to gain */
#define MOST_FAULTS 3     /* of the rig */
#define CAUTION 0.6       /* after each of them */
#define INSIDE 0.85       /* of what the operator allows a joint is what is planned for */
#define SPREAD_FIRST 0.1  /* how far a textbook's values may be off */
#define SPREAD_LATER 0.03 /* those of a model that was fitted */
#define PROCESS_NOISE 1e-3
#define NO_COUNT_RAD 1e-3 /* an encoder that counts no more than that stands still */
#define CATCH_S 10.0
#define HOLD_S 6.0

static double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static enum mk_status save(struct investigation *v, struct mk_error *err)
{
    enum mk_status st = journal_save(v->j, err);
    return st == MK_OK ? notebook_write(v->j, err) : st;
}

static struct experiment *last_of(const struct investigation *v)
{
    return v->j->count > 0 ? &v->j->experiment[v->j->count - 1] : NULL;
}

/* Those that the budget counts: what was broken off from outside is not one. */
static int counted(const struct journal *j)
{
    int n = 0;
    for (int i = 0; i < j->count; i++)
        n += !j->experiment[i].broken_off;
    return n;
}

static int faults_of(const struct journal *j)
{
    int n = 0;
    for (int i = 0; i < j->count; i++)
        n += j->experiment[i].fault[0] != '\0' && !j->experiment[i].broken_off;
    return n;
}

static double spent_s(const struct journal *j)
{
    double s = j->look_s;
    for (int i = 0; i < j->count; i++)
        s += j->experiment[i].rig_s + j->experiment[i].compute_s;
    return s;
}

/* --- limits ----------------------------------------------------------------------------------- */

/* The operator's, else the usual ones of an excitation; less after faults. */
static void plan_within(const struct investigation *v, struct plan_limits *l)
{
    const struct plan_limits *asked = &v->j->settings.limits;
    const struct mk_plant_info *plant = mk_plant(v->j->given.plant);
    struct mk_excite_options usual;
    mk_excite_default(&v->j->given, &usual);
    l->u_max = isfinite(asked->u_max) ? fmin(asked->u_max, v->j->given.u_max) : usual.u_max;
    l->u_max *= pow(CAUTION, faults_of(v->j));
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

/* --- looking at the rig ----------------------------------------------------------------------- */

static bool an_encoder_is_dead(const struct rig_nudge *n, int joints)
{
    for (int j = 0; j < joints; j++)
        if (fabs(n->moved[j]) < NO_COUNT_RAD && fabs(n->expected[j]) > 10.0 * NO_COUNT_RAD)
            return true;
    return false;
}

static enum mk_status wrong_wiring(const struct rig_nudge *n, const struct mk_model *model,
                                   struct mk_error *err)
{
    char moved[RIG_MOTION_TEXT], expected[RIG_MOTION_TEXT];
    if (n->misfit > RIG_MISFIT)
        return mk_error_set(err, MK_ERR_EXPECT,
                            "a short push moved the joints by %s, the model says %s, and no wiring "
                            "explains that: is this the model of this rig? encoders plugged in? "
                            "power supply on?",
                            rig_motion_text(model, n->moved, moved, sizeof moved),
                            rig_motion_text(model, n->expected, expected, sizeof expected));
    for (int j = 0; j < mk_model_joints(model); j++)
        if (fabs(n->moved[j]) < NO_COUNT_RAD && fabs(n->expected[j]) > 10.0 * NO_COUNT_RAD)
            return mk_error_set(err, MK_ERR_EXPECT,
                                "encoder %d did not count as a short push moved its joint by "
                                "%+.4f %s, as the model says: is this the model of this rig? its "
                                "plug and cable?",
                                j + 1, n->expected[j] * mk_model_joint_scale(model, j),
                                mk_model_unit(model, j, "rad"));
    if (n->wiring.swapped)
        return mk_error_set(err, MK_ERR_EXPECT,
                            "the encoders are swapped: exchange their plugs at the board");
    if (n->wiring.sign[0] < 0 && n->wiring.sign[1] < 0)
        return mk_error_set(err, MK_ERR_EXPECT,
                            "the motor turns backwards: exchange its two wires");
    return mk_error_set(err, MK_ERR_EXPECT,
                        "encoder %d counts backwards: exchange its A and B wires",
                        n->wiring.sign[0] < 0 ? 1 : 2);
}

static enum mk_status look_at_rig(struct investigation *v, struct mk_error *err)
{
    struct rig_nudge n;
    struct journal *j = v->j;
    const double begin = rig_seconds(&v->rig);
    enum mk_status st = rig_rest(&v->rig, err);
    if (st != MK_OK)
        return st;
    struct mk_model gentle = j->given; /* the push stays within the operator's limit, too */
    if (isfinite(j->settings.limits.u_max))
        gentle.u_max = fmin(gentle.u_max, j->settings.limits.u_max / RIG_PUSH_SHARE);
    if (!rig_nudge(v->rig.board, &gentle, v->o->cancel, &n))
        return investigation_cancelled(v)
                   ? mk_error_set(err, MK_ERR_INTR, "ended by a signal, motor off")
                   : mk_error_set(err, MK_ERR_FAULT,
                                  "the first short push was broken off, the board "
                                  "tripped: check cable and power");
    const int joints = mk_model_joints(&j->given);
    if (!rig_nudge_is_well(&n) || an_encoder_is_dead(&n, joints))
        return wrong_wiring(&n, &j->given, err);
    const int motor = mk_plant(j->given.plant)->motor_joint;
    const double size = mk_model_joint_scale(&j->given, motor);
    snprintf(j->looked, sizeof j->looked,
             "The links hang still; a short push moved joint %d by %+.4f %s, both ways, the model "
             "says %+.4f: motor and encoders are wired as the model has it.",
             motor + 1, n.moved[motor] * size, mk_model_unit(&j->given, motor, "rad"),
             n.expected[motor] * size);
    (void)mk_date_text(j->looked_at);
    j->look_s = rig_seconds(&v->rig) - begin;
    investigation_say(v, "%s", j->looked);
    return save(v, err);
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
    const int done = counted(v->j);
    const double each = done > 0 ? spent_s(v->j) / done : 0.0;
    return done >= v->o->experiments - 1 || v->j->count >= JOURNAL_EXPERIMENTS - 1 ||
           spent_s(v->j) + 2.0 * each > 60.0 * v->o->minutes;
}

/* Plans the next experiment and writes down what the model predicts. */
static enum mk_status plan_next(struct investigation *v, struct mk_error *err)
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
    const double begin = now_s();
    x->seconds = j->settings.seconds;
    x->window_s = WINDOW_S;
    if (!v->explained)
        st = choose_first(v, x, err);
    else if (budget_is_nearly_spent(v))
        choose_test(v, x, true);
    else if (!choose_rivals(v, x) && !choose_rest(v, x) && !choose_known(v, x))
        choose_test(v, x, false);
    if (st != MK_OK)
        return st;
    learn_noise(&j->given, v->explained ? v->e : NULL, x->noise);
    st = learn_write_prediction(
        journal_file(j, path, journal_name(name, j->count, "-prediction.csv")), &v->model, x,
        j->settings.rate_hz, err);
    if (st == MK_OK)
        st = mk_model_write(journal_file(j, path, journal_name(name, j->count, "-model.ini")),
                            &v->model, "the model before this experiment was run", err);
    if (st != MK_OK)
        return st;
    (void)mk_date_text(x->planned_at);
    x->compute_s = now_s() - begin;
    j->count++;
    investigation_say(v, "Experiment %d (%s): %s", j->count, experiment_kind_name(x->kind), x->why);
    investigation_say(v, "  input %s", x->input);
    investigation_say(v, "  expected: %s", x->expected);
    return save(v, err);
}

/* --- running ---------------------------------------------------------------------------------- */

static enum mk_status run_it(struct investigation *v, struct mk_error *err)
{
    struct journal *j = v->j;
    struct experiment *x = last_of(v);
    char name[64], path[JOURNAL_PATH];
    bool found;
    journal_file(j, path, journal_name(name, j->count - 1, ".csv"));
    enum mk_status st = salvage_log(x, path, &found, err);
    if (st != MK_OK)
        return st;
    if (found)
        investigation_say(v, "  its log is there: %.3g of %.3g s", x->ran_s, x->seconds);
    if (!found) {
        const double begin = rig_seconds(&v->rig);
        struct rig_run run = {.nominal = &v->model,
                              .model_off = v->explained ? 0.0 : j->settings.model_off,
                              .log = path};
        st = rig_rest(&v->rig, err);
        if (st != MK_OK)
            return st;
        (void)mk_date_text(x->run_at);
        memcpy(x->origin, v->rig.origin, sizeof x->origin);
        st = rig_experiment(&v->rig, &run, x->input, x->seconds, err);
        x->ran_s = run.ran_s;
        snprintf(x->fault, sizeof x->fault, "%s", run.fault_text);
        x->broken_off = st != MK_OK || rig_fault_is_of_the_board(run.fault);
        x->rig_s += rig_seconds(&v->rig) - begin;
        if (st == MK_OK && run.fault && x->broken_off)
            st = mk_error_set(err, MK_ERR_FAULT,
                              "experiment %d: fault %s; motor off. When that is put right, the "
                              "same command goes on",
                              j->count, run.fault_text);
        if (x->broken_off && x->ran_s <= 0.0)
            return st; /* nothing was run: it is still planned */
    }
    x->state = EXPERIMENT_RUN;
    if (x->fault[0])
        investigation_say(v, "  stopped: %s", x->fault);
    /* The disk may be full: the log alone then says that it was run. */
    struct mk_error late = MK_ERROR_INIT;
    enum mk_status saved = save(v, &late);
    if (st == MK_OK && saved != MK_OK && err)
        *err = late;
    return st == MK_OK ? saved : st;
}

/* --- judging and learning --------------------------------------------------------------------- */

/* Nobody is to go on with a rig whose motor gives nothing; the experiment does not count. */
static enum mk_status tell_dead_motor(struct investigation *v, struct experiment *x, double command,
                                      struct mk_error *err)
{
    x->used = x->passed = false;
    x->broken_off = true;
    x->state = EXPERIMENT_LEARNED;
    journal_put(x->came, "Nothing moved: nothing is learned from it.");
    const enum mk_status st = save(v, err);
    return st != MK_OK ? st
                       : mk_error_set(err, MK_ERR_EXPECT,
                                      "experiment %d: nothing moved, though the command went "
                                      "over %.2g: power supply, fuse, cables? When that "
                                      "is put right, the same command goes on",
                                      v->j->count, command);
}

static enum mk_status judge(struct investigation *v, struct mk_error *err)
{
    struct journal *j = v->j;
    struct experiment *x = last_of(v);
    struct mk_model foretold;
    double command;
    char name[64], log[JOURNAL_PATH], prediction[JOURNAL_PATH], path[JOURNAL_PATH];
    journal_file(j, log, journal_name(name, j->count - 1, ".csv"));
    journal_file(j, prediction, journal_name(name, j->count - 1, "-prediction.csv"));
    journal_file(j, path, journal_name(name, j->count - 1, "-model.ini"));
    enum mk_status st = mk_model_read(path, &foretold, err);
    x->came[0] = '\0';
    x->used = false;
    if (st == MK_OK && x->ran_s >= LEAST_S) {
        st = investigation_read_log(v, j->count - 1, err);
        x->used =
            st == MK_OK && mk_data_check_uses(&j->given, v->log[j->count - 1], MK_DATA_EXPLAIN);
    } else if (st == MK_OK) {
        (void)!investigation_read_log(v, j->count - 1,
                                      NULL); /* too short to learn from, perhaps for a reason */
    }
    if (st != MK_OK)
        return st;
    if (v->log[j->count - 1] &&
        learn_motor_is_dead(v->log[j->count - 1], &j->given, prediction, &command))
        return tell_dead_motor(v, x, command, err);
    if (x->used && learn_judge(x, &foretold, log, prediction, NULL) == MK_OK) {
        journal_put(x->came, "Free runs of %.2g s from the model before were wrong by",
                    x->window_s);
        for (int k = 0; k < mk_model_joints(&j->given); k++)
            journal_put(x->came, "%s %.3g times the noise at joint %d (%.3g %s)", k ? " and" : "",
                        x->error[k] / x->noise[k], k + 1, 1e3 * x->error[k],
                        mk_model_unit(&j->given, k, "mrad"));
        journal_put(x->came, ".");
    } else {
        x->passed = false;
        journal_put(x->came, x->used ? "The model before cannot follow it."
                                     : "Too short, or nothing moved: nothing is learned from it.");
    }
    x->passed = x->passed && !x->broken_off && !x->fault[0];
    if (x->kind == EXPERIMENT_TEST)
        journal_put(x->came, x->passed ? " Passed." : " Not passed.");
    x->state = EXPERIMENT_JUDGED;
    investigation_say(v, "  came: %s", x->came);
    return save(v, err);
}

static enum mk_status learn(struct investigation *v, struct mk_error *err)
{
    struct journal *j = v->j;
    struct experiment *x = last_of(v);
    const double begin = now_s();
    /* Nothing is fitted to a test that was passed. */
    const bool kept_out = x->passed && x->kind == EXPERIMENT_TEST;
    enum mk_status st = kept_out ? MK_OK : investigation_explain(v, j->count, err);
    if ((st == MK_ERR_NUMERIC || st == MK_ERR_RANGE) && x->used) {
        x->used = false;
        journal_put(x->came, " No model follows it: nothing is learned from it.");
        st = investigation_explain(v, j->count, err);
    }
    if (st != MK_OK)
        return st;
    if (v->explained && !kept_out) {
        char path[JOURNAL_PATH];
        const char *name = "model.ini";
        learn_finding(v->e, &j->given, &x->finding);
        st = mk_model_write(journal_file(j, path, name), &v->model,
                            "mechkit investigate: the model as it is known so far", err);
        if (st != MK_OK)
            return st;
        for (int i = 0; i < x->finding.causes; i++)
            investigation_say(v, "  learned: %s", x->finding.cause[i]);
        if (x->finding.causes == 0)
            investigation_say(v, "  learned: verdict %s", x->finding.verdict);
    }
    x->compute_s += now_s() - begin;
    x->state = EXPERIMENT_LEARNED;
    return save(v, err);
}

/* --- the end ---------------------------------------------------------------------------------- */

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

/* Whether it is over; says so in the journal. */
static bool is_over(struct investigation *v)
{
    struct journal *j = v->j;
    const struct experiment *x = last_of(v);
    if (!x)
        return false;
    if (x->kind == EXPERIMENT_TEST && x->passed)
        stop(j, "validated",
             "A fresh experiment was predicted to within %.2g times its noise, by a model that was "
             "written down before it was run.",
             worst_of(v, x));
    else if (faults_of(j) >= MOST_FAULTS)
        stop(j, "faults", "%d experiments were stopped by faults of the rig, the last by %s.",
             faults_of(j), x->fault);
    else if (counted(j) >= v->o->experiments || j->count >= JOURNAL_EXPERIMENTS)
        stop(j, "budget", "The budget of %d experiments is spent.%s", v->o->experiments,
             x->kind == EXPERIMENT_TEST ? " The last test was not passed." : "");
    else if (spent_s(j) > 60.0 * v->o->minutes)
        stop(j, "budget", "The budget of %.3g minutes is spent.%s", v->o->minutes,
             x->kind == EXPERIMENT_TEST ? " The last test was not passed." : "");
    else if (goes_in_circles(j))
        stop(j, "no-gain",
             "Two tests in a row were not passed, at last by %.2g times the noise, and no "
             "experiment within the limits is expected to say why.",
             worst_of(v, x));
    return j->stopped[0] != '\0';
}

/* --- control ---------------------------------------------------------------------------------- */

static bool suits(const struct mk_ctrl_ops *setup, const struct mk_model *model)
{
    return (setup->plants & (1u << model->plant)) && mk_ctrl_param_index(setup, "compensate") >= 0;
}

static bool done_already(const struct journal *j, const char *setup, const char *nominal)
{
    for (int i = 0; i < j->controls; i++)
        if (strcmp(j->control[i].setup, setup) == 0 && strcmp(j->control[i].nominal, nominal) == 0)
            return true;
    return false;
}

/* Where nothing is caught, a speed is held. */
static const char *how_it_held(const struct journal_control *c, const struct mk_model *given,
                               char *buf, size_t size)
{
    const int motor = mk_plant(given->plant)->motor_joint;
    if (!c->held)
        snprintf(buf, size, "not held");
    else if (isfinite(c->caught_s))
        snprintf(buf, size, "held, caught after %.3g s, sway %.3g mrad, rms command %.3g",
                 c->caught_s, 1e3 * c->sway, c->effort);
    else
        snprintf(buf, size, "held, off by %.3g %s rms, rms command %.3g", c->sway,
                 mk_model_unit(given, motor, "rad/s"), c->effort);
    return buf;
}

static enum mk_status try_setup(struct investigation *v, const struct mk_ctrl_ops *setup,
                                const struct mk_model *nominal, const char *name,
                                struct mk_error *err)
{
    struct journal *j = v->j;
    char path[JOURNAL_PATH];
    if (j->controls >= JOURNAL_CONTROLS || done_already(j, setup->name, name))
        return MK_OK;
    struct journal_control c = {.caught_s = NAN};
    snprintf(c.setup, sizeof c.setup, "%s", setup->name);
    snprintf(c.nominal, sizeof c.nominal, "%s", name);
    snprintf(c.log, sizeof c.log, "control-%s-%s.csv", setup->name, name);
    /* A log of a run that was killed is kept. */
    for (int i = 2; i < 100 && access(journal_file(j, path, c.log), F_OK) == 0; i++)
        snprintf(c.log, sizeof c.log, "control-%s-%s-%d.csv", setup->name, name, i);
    struct rig_run run = {.nominal = nominal, .log = journal_file(j, path, c.log)};
    struct rig_figures f;
    const double begin = rig_seconds(&v->rig);
    enum mk_status st = rig_rest(&v->rig, err);
    if (st == MK_OK)
        st = rig_control(&v->rig, &run, setup, CATCH_S, HOLD_S, &f, err);
    if (st != MK_OK)
        return st;
    if (rig_fault_is_of_the_board(run.fault))
        return mk_error_set(err, MK_ERR_FAULT,
                            "setup %s: fault %s; motor off. When that is put right, the same "
                            "command goes on",
                            setup->name, run.fault_text);
    c.held = f.held;
    c.caught_s = f.caught_s;
    c.sway = f.sway;
    c.effort = f.effort;
    snprintf(c.fault, sizeof c.fault, "%s", run.fault_text);
    j->control[j->controls++] = c;
    j->control_s += rig_seconds(&v->rig) - begin;
    char held[120];
    investigation_say(v, "  %s, believing the %s model: %s%s%s", setup->name, name,
                      how_it_held(&c, &j->given, held, sizeof held), c.fault[0] ? "; " : "",
                      c.fault);
    return save(v, err);
}

static enum mk_status control(struct investigation *v, struct mk_error *err)
{
    const struct mk_ctrl_ops *setup;
    enum mk_status st = MK_OK;
    for (int i = 0; st == MK_OK && (setup = mk_ctrl_setup(i)) != NULL; i++) {
        if (!suits(setup, &v->j->given))
            continue;
        st = try_setup(v, setup, &v->j->given, "given", err);
        if (st == MK_OK)
            st = try_setup(v, setup, &v->model, "final", err);
    }
    return st;
}

/* --- the road --------------------------------------------------------------------------------- */

static enum mk_status step(struct investigation *v, struct mk_error *err)
{
    const struct experiment *x = last_of(v);
    if (!x || x->state == EXPERIMENT_LEARNED)
        return plan_next(v, err);
    if (x->state == EXPERIMENT_PLANNED)
        return run_it(v, err);
    return x->state == EXPERIMENT_RUN ? judge(v, err) : learn(v, err);
}

static enum mk_status go_on(struct investigation *v, struct mk_error *err)
{
    struct journal *j = v->j;
    enum mk_status st = j->looked_at[0] ? MK_OK : look_at_rig(v, err);
    if (st == MK_OK)
        rig_let_calm(&v->rig);
    while (st == MK_OK && !j->stopped[0]) {
        if (investigation_cancelled(v))
            return mk_error_set(err, MK_ERR_INTR, "ended by a signal, motor off");
        const struct experiment *x = last_of(v);
        if (x && x->state == EXPERIMENT_LEARNED && is_over(v)) {
            investigation_say(v, "%s", j->stopped_why);
            snprintf(j->final_model, sizeof j->final_model, "model.ini");
            st = save(v, err);
        } else {
            st = step(v, err);
        }
    }
    if (st == MK_OK && v->o->control)
        st = control(v, err);
    return st;
}

/* What a journal knows is not calculated again but for the explanation, which is not kept. */
static enum mk_status take_up(struct investigation *v, struct mk_error *err)
{
    struct journal *j = v->j;
    int known = 0; /* experiments that were learned from */
    for (int i = 0; i < j->count; i++)
        if (j->experiment[i].state == EXPERIMENT_LEARNED && j->experiment[i].finding.verdict[0])
            known = i + 1;
    if (strcmp(j->stopped, "budget") == 0 && counted(j) < v->o->experiments &&
        spent_s(j) < 60.0 * v->o->minutes)
        j->stopped[0] = j->stopped_why[0] = '\0';
    return known > 0 ? investigation_explain(v, known, err) : MK_OK;
}

/* --- beginning -------------------------------------------------------------------------------- */

void investigate_default(struct investigate_options *out)
{
    *out = (struct investigate_options){.experiments = 8, .minutes = 60.0};
    struct journal_settings *s = &out->settings;
    snprintf(s->board, sizeof s->board, "virtual");
    s->seconds = 10.0;
    s->rate_hz = MK_LOOP_RATE_HZ;
    s->seed = 1;
    s->model_off = 0.5;
    s->tries = 400;
    s->limits.u_max = NAN;
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        s->limits.q_min[j] = s->limits.q_max[j] = s->limits.v_max[j] = NAN;
}

/* The journal of the folder, or a new one. */
static enum mk_status open_journal(struct investigation *v, struct mk_error *err)
{
    const struct investigate_options *o = v->o;
    struct journal *j = v->j;
    struct mk_model model = {0};
    bool found;
    char path[JOURNAL_PATH];
    enum mk_status st = o->model ? mk_model_read(o->model, &model, err) : MK_OK;
    if (st == MK_OK)
        st = journal_open(j, o->folder, !o->resume, &found, err);
    if (st != MK_OK)
        return st;
    if (!found && o->resume)
        return mk_error_at(err, MK_ERR_NOTFOUND, o->folder, 0, 0,
                           "there is no journal.json in it: no investigation has begun here");
    if (found && !o->resume) {
        const char *other = journal_another(j, &model, &o->settings);
        if (other)
            return mk_error_at(err, MK_ERR_STATE, o->folder, 0, 0,
                               "has an investigation with another %s: give another --out, or "
                               "--resume to go on with that one",
                               other);
    }
    if (found) {
        const char *device = o->settings.device;
        if (device[0] && strcmp(device, j->settings.device) != 0) {
            investigation_say(v, "The rig is now at %s, it was at %s.", device, j->settings.device);
            snprintf(j->settings.device, sizeof j->settings.device, "%s", device);
        }
        return MK_OK;
    }
    snprintf(j->program, sizeof j->program, "mechkit " MK_VERSION);
    (void)mk_date_text(j->begun_at);
    snprintf(j->model_path, sizeof j->model_path, "%s", o->model);
    j->given = model;
    j->settings = o->settings;
    st = mk_model_write(journal_file(j, path, "given.ini"), &model,
                        "the model that the investigation began with", err);
    return st == MK_OK ? journal_save(j, err) : st;
}

/* A board knows its encoders: where the model has other counts a turn, the board is believed, as by
 * the loop that writes the logs. */
static enum mk_status believe_counters(struct investigation *v, struct mk_error *err)
{
    struct mk_board_identity id = {.counter_bits = 0};
    struct mk_model *given = &v->j->given;
    char path[JOURNAL_PATH];
    bool other = false;
    enum mk_status st = v->rig.board->ops->identify(v->rig.board, &id, err);
    for (int k = 0; st == MK_OK && k < mk_model_joints(given); k++) {
        const int model = given->encoder_cpr[k], board = id.encoder_cpr[k];
        if (model <= 0 || board <= 0 || model == board)
            continue;
        investigation_say(
            v, "The board counts %d a turn at joint %d, the model has %d: the board is believed.",
            board, k + 1, model);
        given->encoder_cpr[k] = v->model.encoder_cpr[k] = board;
        other = true;
    }
    return other ? mk_model_write(journal_file(v->j, path, "given.ini"), given,
                                  "the model that the investigation began with, with the counts "
                                  "a turn that the board tells",
                                  err)
                 : st;
}

static enum mk_status open_board(struct investigation *v, struct mk_error *err)
{
    const struct journal_settings *s = &v->j->settings;
    const struct mk_board_ops *ops = mk_board_backend_by_name(s->board);
    if (!ops)
        return mk_error_set(err, MK_ERR_USAGE, "there is no board '%s'", s->board);
    const bool virtual = (ops->capabilities & MK_BOARD_CAP_SIMULATED) != 0;
    if (s->fast && !mk_board_may_be_fast(ops))
        return mk_error_set(err, MK_ERR_USAGE, "board %s runs by the clock: without --fast",
                            s->board);
    if (s->rig[0] && !virtual)
        return mk_error_set(err, MK_ERR_USAGE,
                            "--rig says what the virtual board simulates; board %s has a rig",
                            s->board);
    v->simulated = v->j->given;
    enum mk_status st = s->rig[0] ? mk_model_read(s->rig, &v->simulated, err) : MK_OK;
    if (st == MK_OK && v->simulated.plant != v->j->given.plant)
        st = mk_error_at(err, MK_ERR_RANGE, s->rig, 0, 0, "is a %s, the model that is given a %s",
                         mk_plant(v->simulated.plant)->name, mk_plant(v->j->given.plant)->name);
    if (st != MK_OK)
        return st;
    v->rig.given = &v->j->given;
    v->rig.rate_hz = s->rate_hz;
    v->rig.stream = s->stream;
    v->rig.limits = s->limits;
    v->rig.cancel = v->o->cancel;
    v->rig.progress = investigation_goes_on;
    v->rig.progress_context = v;
    const struct mk_board_config config = {.model = &v->simulated,
                                           .seed = s->seed + (uint64_t)v->j->count,
                                           .fault_script = v->o->faults,
                                           .device = s->device[0] ? s->device : NULL};
    st = rig_open(&v->rig, ops, &config, s->fast, err);
    return st == MK_OK ? believe_counters(v, err) : st;
}

static bool needs_the_rig(const struct investigation *v)
{
    return !v->j->stopped[0] || v->o->control;
}

enum mk_status investigate(const struct investigate_options *options, struct journal *out,
                           struct mk_error *err)
{
    struct investigation *v = calloc(1, sizeof *v);
    struct mk_explanation *e = calloc(2, sizeof *e);
    enum mk_status st = MK_OK;
    out->lock = -1;
    if (!v || !e)
        st = mk_error_set(err, MK_ERR_NOMEM, "no memory for an investigation");
    if (st == MK_OK) {
        *v = (struct investigation){.o = options, .j = out, .e = e, .other = e + 1};
        st = open_journal(v, err);
    }
    if (st == MK_OK) {
        v->model = out->given;
        st = take_up(v, err);
    }
    if (st == MK_OK && needs_the_rig(v)) {
        st = open_board(v, err);
        if (st == MK_OK)
            st = go_on(v, err);
        rig_close(&v->rig);
    }
    for (int i = 0; v && i < JOURNAL_EXPERIMENTS; i++)
        mk_log_free(v->log[i]);
    free(v);
    free(e);
    journal_close(out);
    return st;
}
