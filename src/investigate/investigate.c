/* The road of an investigation: the journal is opened, the rig looked at, and experiments are
 * chosen, run, judged and learned from until one says that it is over. Each step writes the
 * journal, so that a program that was ended goes on where it was. */
#include "investigate/investigate.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/origin.h"
#include "investigate/investigation.h"
#include "mechkit/log.h"

/* --- the road --------------------------------------------------------------------------------- */

static enum mk_status step(struct investigation *v, struct mk_error *err)
{
    const struct experiment *x = investigation_last(v);
    if (!x || x->state == EXPERIMENT_LEARNED)
        return investigation_choose(v, err);
    if (x->state == EXPERIMENT_PLANNED)
        return investigation_run(v, err);
    return x->state == EXPERIMENT_RUN ? investigation_judge(v, err) : investigation_learn(v, err);
}

static enum mk_status go_on(struct investigation *v, struct mk_error *err)
{
    struct journal *j = v->j;
    enum mk_status st = j->looked_at[0] ? MK_OK : investigation_look(v, err);
    if (st == MK_OK)
        rig_let_calm(&v->rig);
    while (st == MK_OK && !j->stopped[0]) {
        if (investigation_cancelled(v))
            return mk_error_set(err, MK_ERR_INTR, "ended by a signal, motor off");
        const struct experiment *x = investigation_last(v);
        if (x && x->state == EXPERIMENT_LEARNED && investigation_is_over(v)) {
            investigation_say(v, "%s", j->stopped_why);
            snprintf(j->final_model, sizeof j->final_model, "model.ini");
            st = investigation_save(v, err);
        } else {
            st = step(v, err);
        }
    }
    if (st == MK_OK && v->o->control)
        st = investigation_control(v, err);
    return st;
}

/* What a journal knows is not calculated again but for the explanation, which is not kept. */
static enum mk_status take_up(struct investigation *v, struct mk_error *err)
{
    struct journal *j = v->j;
    char path[JOURNAL_PATH];
    int known = 0; /* experiments that were learned from */
    for (int i = 0; i < j->count; i++)
        if (j->experiment[i].state == EXPERIMENT_LEARNED && j->experiment[i].finding.verdict[0])
            known = i + 1;
    if (strcmp(j->stopped, "budget") == 0 && investigation_counted(j) < v->o->experiments &&
        investigation_spent_s(j) < 60.0 * v->o->minutes)
        j->stopped[0] = j->stopped_why[0] = '\0';
    enum mk_status st = known > 0 ? investigation_explain(v, known, err) : MK_OK;
    /* A log may have been left out since the model was written. */
    if (st == MK_OK && v->explained && !j->stopped[0])
        st = mk_model_write(journal_file(j, path, "model.ini"), &v->model,
                            "mechkit investigate: the model as it is known so far", err);
    return st;
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
        return mk_error_set(err, MK_ERR_USAGE,
                            "--board %s: there is no such board; `mechkit boards` lists them",
                            s->board);
    const bool virtual = (ops->capabilities & MK_BOARD_CAP_SIMULATED) != 0;
    if (s->fast && !mk_board_may_be_fast(ops))
        return mk_error_set(err, MK_ERR_USAGE, "--fast: board %s runs by the clock", s->board);
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
