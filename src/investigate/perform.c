/* One experiment on its way: run, judged by the prediction that was written down before, learned
 * from. */
#include <stdio.h>
#include <string.h>

#include "base/origin.h"
#include "investigate/investigation.h"
#include "investigate/learn.h"
#include "investigate/salvage.h"
#include "mechkit/data_check.h"
#include "mechkit/log.h"

#define LEAST_S 1.0 /* of a log that is learned from */
#define STARTS 3    /* of a run, at most */

/* --- running ---------------------------------------------------------------------------------- */

/* From rest. A rig that moves again as the run is to begin, as one whose encoder stood still while
 * it came to rest, is waited for once more. */
static enum mk_status run_from_rest(struct investigation *v, struct experiment *x,
                                    struct rig_run *run, struct mk_error *err)
{
    enum mk_status st = MK_OK;
    for (int i = 0; i < STARTS; i++) {
        st = rig_rest(&v->rig, err);
        if (st != MK_OK)
            return st;
        (void)mk_date_text(x->run_at);
        memcpy(x->origin, v->rig.origin, sizeof x->origin);
        /* Where its log is counted from: a program that is killed cannot say it later. */
        st = investigation_save(v, err);
        if (st == MK_OK)
            st = rig_experiment(&v->rig, run, x->input, x->seconds, err);
        if (st != MK_ERR_FAULT || run->fault != MK_FAULT_NOT_HANGING)
            break;
    }
    return st;
}

/* The experiment on the rig. `ran`: some of it was run, and is in the log. A fault of the board,
 * not of the rig, is an error. */
static enum mk_status run_on_rig(struct investigation *v, struct experiment *x, const char *path,
                                 bool *ran, struct mk_error *err)
{
    struct journal *j = v->j;
    const double begin = rig_seconds(&v->rig);
    struct rig_run run = {
        .nominal = &v->model, .model_off = v->explained ? 0.0 : j->settings.model_off, .log = path};
    enum mk_status st = run_from_rest(v, x, &run, err);
    x->ran_s = run.ran_s;
    snprintf(x->fault, sizeof x->fault, "%s", run.fault_text);
    x->broken_off = st != MK_OK || rig_fault_is_of_the_board(run.fault);
    x->rig_s += rig_seconds(&v->rig) - begin;
    *ran = !x->broken_off || x->ran_s > 0.0;
    if (st == MK_OK && run.fault && x->broken_off)
        return mk_error_set(err, MK_ERR_FAULT,
                            "experiment %d: fault %s; motor off. When that is put right, the same "
                            "command goes on",
                            j->count, run.fault_text);
    return st;
}

enum mk_status investigation_run(struct investigation *v, struct mk_error *err)
{
    struct journal *j = v->j;
    struct experiment *x = investigation_last(v);
    char name[64], path[JOURNAL_PATH];
    bool found, ran = true;
    journal_file(j, path, journal_name(name, j->count - 1, ".csv"));
    enum mk_status st = salvage_log(x, path, &found, err);
    if (st != MK_OK)
        return st;
    if (found)
        investigation_say(v, "  its log is there: %.3g of %.3g s", x->ran_s, x->seconds);
    else
        st = run_on_rig(v, x, path, &ran, err);
    if (!ran)
        return st; /* it is still planned */
    x->state = EXPERIMENT_RUN;
    if (x->fault[0])
        investigation_say(v, "  stopped: %s", x->fault);
    /* The disk may be full: the log alone then says that it was run. */
    struct mk_error late = MK_ERROR_INIT;
    enum mk_status saved = investigation_save(v, &late);
    if (st == MK_OK && saved != MK_OK && err)
        *err = late;
    return st == MK_OK ? saved : st;
}

/* --- judging and learning --------------------------------------------------------------------- */

/* Runs that faults of the rig stopped just before may have been stopped by the same: nobody knows
 * since when the motor gave nothing. */
static void doubt_runs_before(struct journal *j)
{
    for (int i = j->count - 2; i >= 0; i--) {
        struct experiment *x = &j->experiment[i];
        if (!x->fault[0] || x->broken_off || !x->used)
            break;
        x->used = false;
        x->finding = (struct journal_finding){.verdict = ""};
        journal_put(x->came, " Left out: the motor may have given nothing towards its end.");
    }
}

/* Nobody is to go on with a rig whose motor gives nothing; the experiment does not count. */
static enum mk_status tell_dead_motor(struct investigation *v, struct experiment *x, double command,
                                      struct mk_error *err)
{
    x->used = x->passed = false;
    x->broken_off = true;
    x->state = EXPERIMENT_LEARNED;
    journal_put(x->came, "Nothing moved: nothing is learned from it.");
    doubt_runs_before(v->j);
    const enum mk_status st = investigation_save(v, err);
    return st != MK_OK ? st
                       : mk_error_set(err, MK_ERR_EXPECT,
                                      "experiment %d: nothing moved, though the command went "
                                      "over %.2g: power supply, fuse, cables? When that "
                                      "is put right, the same command goes on",
                                      v->j->count, command);
}

/* How long a log is, as far as it can be believed. */
static double lasts(const struct mk_log *log)
{
    const double *t = mk_log_get(log, "t");
    return t && log->rows > 0 ? t[log->rows - 1] - t[0] : 0.0;
}

/* No fault was seen while it ran: it is one all the same. */
static void tell_doubt(const struct investigation *v, struct experiment *x, const struct doubt *d)
{
    if (d->joint == 0 || x->fault[0])
        return;
    snprintf(x->fault, sizeof x->fault, "encoder-stuck, joint %d, at %.2f s, as its log shows",
             d->joint, d->at_s);
    investigation_say(
        v,
        "  in doubt: the reading of joint %d stood still from %.2f s on, faster than "
        "the joint can stop: is a wire of its encoder loose? Learned from up to there",
        d->joint, d->at_s);
}

/* Reads the log, and decides whether it is learned from. */
static enum mk_status read_result(struct investigation *v, struct experiment *x,
                                  struct mk_error *err)
{
    const int number = v->j->count - 1;
    x->used = false;
    if (x->ran_s < LEAST_S)
        return MK_OK;
    struct doubt doubt = {0, 0.0};
    enum mk_status st = investigation_read_log(v, number, &doubt, err);
    tell_doubt(v, x, &doubt);
    x->used = st == MK_OK && lasts(v->log[number]) >= LEAST_S &&
              mk_data_check_uses(&v->j->given, v->log[number], MK_DATA_EXPLAIN);
    return st;
}

/* By how much the prediction was wrong, and whether that passes. */
static void compare_with_prediction(const struct investigation *v, struct experiment *x,
                                    const struct mk_model *foretold, const char *log,
                                    const char *prediction)
{
    const struct mk_model *given = &v->j->given;
    if (x->used && learn_judge(x, foretold, log, prediction, NULL) == MK_OK) {
        journal_put(x->came, "Free runs of %.2g s from the model before were wrong by",
                    x->window_s);
        for (int k = 0; k < mk_model_joints(given); k++)
            journal_put(x->came, "%s %.3g times the noise at joint %d (%.3g %s)", k ? " and" : "",
                        x->error[k] / x->noise[k], k + 1, 1e3 * x->error[k],
                        mk_model_unit(given, k, "mrad"));
        journal_put(x->came, ".");
    } else {
        x->passed = false;
        journal_put(x->came, x->used ? "The model before cannot follow it."
                                     : "Too short, or nothing moved: nothing is learned from it.");
    }
    x->passed = x->passed && !x->broken_off && !x->fault[0];
    if (x->kind == EXPERIMENT_TEST)
        journal_put(x->came, x->passed ? " Passed." : " Not passed.");
}

enum mk_status investigation_judge(struct investigation *v, struct mk_error *err)
{
    struct journal *j = v->j;
    struct experiment *x = investigation_last(v);
    struct mk_model foretold;
    double command;
    char name[64], log[JOURNAL_PATH], prediction[JOURNAL_PATH], path[JOURNAL_PATH];
    journal_file(j, log, journal_name(name, j->count - 1, ".csv"));
    journal_file(j, prediction, journal_name(name, j->count - 1, "-prediction.csv"));
    journal_file(j, path, journal_name(name, j->count - 1, "-model.ini"));
    x->came[0] = '\0';
    x->used = false;
    enum mk_status st = mk_model_read(path, &foretold, err);
    if (st == MK_OK)
        st = read_result(v, x, err);
    if (st != MK_OK)
        return st;
    if (learn_motor_is_dead(log, &j->given, prediction, &command))
        return tell_dead_motor(v, x, command, err);
    compare_with_prediction(v, x, &foretold, log, prediction);
    x->state = EXPERIMENT_JUDGED;
    investigation_say(v, "  came: %s", x->came);
    return investigation_save(v, err);
}

enum mk_status investigation_learn(struct investigation *v, struct mk_error *err)
{
    struct journal *j = v->j;
    struct experiment *x = investigation_last(v);
    const double begin = investigation_now_s();
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
    x->compute_s += investigation_now_s() - begin;
    x->state = EXPERIMENT_LEARNED;
    return investigation_save(v, err);
}
