#include "experiment/robustness.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/random.h"
#include "ctrl/equilibrium.h"
#include "mechkit/board.h"
#include "mechkit/loop.h"
#include "mechkit/rig.h"
#include "mechkit/swingup.h"

#define STILL_RAD 0.1  /* tilt beyond this while held is not balancing */
#define SETTLING_S 1.0 /* after the catch */
#define NOMINAL_HOLD_S 20.0
#define NOMINAL_CATCH_S 4.0

void trial_spread_default(struct trial_spread *out)
{
    *out = (struct trial_spread){
        .parameters = 0.1,
        .friction = 0.3,
        .offset_counts = 2.0,
        .delay_samples = 1,
        .rate_hz = MK_LOOP_RATE_HZ,
        .catch_s = 15.0,
        .hold_s = 10.0,
    };
}

const char *trial_end_name(enum trial_end end)
{
    switch (end) {
    case TRIAL_HELD:
        return "held";
    case TRIAL_NEVER_CAUGHT:
        return "never caught";
    case TRIAL_FELL:
        return "caught and fell";
    case TRIAL_NOT_STILL:
        return "held, but not still";
    case TRIAL_FAULT:
        return "fault";
    }
    return "?";
}

static double signed_tilt(enum mk_plant_kind kind, const double *q)
{
    const struct mk_plant_info *plant = mk_plant(kind);
    const double *top = plant->equilibrium[plant->equilibrium_count - 1].q;
    double angle = 0.0;
    for (int j = 0; j < plant->joints; j++)
        angle += plant->lean[j] * (q[j] - top[j]);
    return remainder(angle, 2.0 * M_PI);
}

double trial_tilt(enum mk_plant_kind plant, const double *q)
{
    return fabs(signed_tilt(plant, q));
}

static double off_by(struct mk_random *random, double share)
{
    return share * (2.0 * mk_random_uniform(random) - 1.0);
}

static enum mk_status add_effect(struct mk_model *rig, const char *name, int joint, double value,
                                 struct mk_error *err)
{
    enum mk_status st = mk_model_add_effect(rig, name, joint, err);
    if (st == MK_OK)
        rig->effect[rig->effect_count - 1].value[0] = value;
    return st;
}

/* Parameters that are far off may be of no rig at all, with a mass matrix that is not one: then
 * others are drawn. */
static enum mk_status draw_parameters(const struct mk_model *nominal,
                                      const struct trial_spread *spread, struct mk_random *random,
                                      struct mk_model *out, struct mk_error *err)
{
    const int tries = 1000;
    const struct mk_plant_info *plant = mk_plant(nominal->plant);
    enum mk_status st = MK_ERR_RANGE;
    for (int k = 0; k < tries && st == MK_ERR_RANGE; k++) {
        for (int i = 0; i < plant->parameter_count; i++) {
            bool friction = i >= plant->mass_count;
            out->parameter[i] =
                nominal->parameter[i] *
                (1.0 + off_by(random, friction ? spread->friction : spread->parameters));
        }
        st = mk_model_check(out, err);
    }
    return st;
}

enum mk_status trial_rig(const struct mk_model *nominal, const struct trial_spread *spread,
                         uint64_t seed, struct mk_model *out, struct mk_error *err)
{
    *out = *nominal;
    if (seed == 0)
        return MK_OK;
    const struct mk_plant_info *plant = mk_plant(nominal->plant);
    struct mk_random random = {seed};
    enum mk_status st = draw_parameters(nominal, spread, &random, out, err);
    for (int j = 0; j < plant->joints && st == MK_OK; j++) {
        st = add_effect(out, "encoder-offset", j + 1,
                        off_by(&random, spread->offset_counts) * mk_model_count(out, j), err);
    }
    if (st == MK_OK && spread->delay_samples > 0)
        st = add_effect(out, "input-delay", 0, spread->delay_samples / spread->rate_hz, err);
    return st == MK_OK ? mk_model_check(out, err) : st;
}

enum mk_status trial_make_changes(const struct trial_spread *spread, struct mk_ctrl *ctrl,
                                  struct mk_error *err)
{
    for (int i = 0; i < spread->change_count; i++) {
        const struct trial_change *c = &spread->change[i];
        enum mk_status st = mk_ctrl_check(ctrl->ops, c->index, c->value, err);
        if (st != MK_OK)
            return st;
        ctrl->value[c->index] = c->value;
    }
    if (spread->change_count > 0 && ctrl->ops->changed)
        ctrl->ops->changed(ctrl);
    return MK_OK;
}

enum mk_status trial_hang(const struct mk_model *model, struct mk_model *rig, double *start_rad,
                          struct mk_error *err)
{
    const struct mk_plant_info *plant = mk_plant(model->plant);
    double q[MK_MAX_JOINTS], u;
    *rig = *model;
    if (!mk_nearest_equilibrium(model, plant->rest, false, q, &u))
        return mk_error_set(err, MK_ERR_NUMERIC, "this %s hangs nowhere near straight down",
                            plant->name);
    enum mk_status st = MK_OK;
    for (int j = 0; j < plant->joints; j++) {
        start_rad[j] = q[j] - plant->rest[j];
        if (st == MK_OK && fabs(start_rad[j]) > 1e-9)
            st = add_effect(rig, "encoder-offset", j + 1, start_rad[j], err);
    }
    return st;
}

/* Sums for figures of what is held. */
struct held {
    double samples, tilt, tilt2, off2, u2, track2;
};

/* What the samples of a run add up to. */
struct watch {
    struct trial *trial;
    const double *rest;
    const double *equilibrium;
    struct mk_board *board;
    struct held held;
    double catch_s, hold_s;
    bool tracks; /* a speed: there is nothing to catch */
    bool balancing, caught;
    double since_s; /* of the present catch */
};

static void add_held(struct watch *w, const struct mk_sample *s)
{
    const double *q = mk_rig_state(mk_board_virtual_rig(w->board));
    const struct mk_plant_info *plant = mk_plant(w->trial->rig.plant);
    int motor = plant->motor_joint;
    double tilt = signed_tilt(plant->kind, q), off = q[motor] - w->equilibrium[motor];
    struct held *h = &w->held;
    h->samples += 1.0;
    h->tilt += tilt;
    h->tilt2 += tilt * tilt;
    h->off2 += plant->joint_is_wheel[motor] ? tilt * tilt : off * off;
    h->u2 += s->u * s->u;
}

static void note_held(const struct watch *w, struct trial *t)
{
    const struct held *h = &w->held;
    if (h->samples < 1.0)
        return;
    t->effort = sqrt(h->u2 / h->samples);
    if (w->tracks) {
        t->track_radps = sqrt(h->track2 / h->samples);
        return;
    }
    double mean = h->tilt / h->samples;
    t->sway_rad = sqrt(fmax(h->tilt2 / h->samples - mean * mean, 0.0));
    t->off_rad = sqrt(h->off2 / h->samples);
}

static void note_extremes(struct watch *w, const struct mk_sample *s)
{
    struct trial *t = w->trial;
    t->u_peak = fmax(t->u_peak, fabs(s->u));
    t->travel_rad = fmax(t->travel_rad, fabs(s->q[0] - w->rest[0]));
    if (w->balancing && s->t >= w->since_s + SETTLING_S)
        t->tilt_rad = fmax(t->tilt_rad, trial_tilt(t->rig.plant, s->q));
    if (w->balancing && s->t >= w->since_s + SETTLING_S)
        add_held(w, s);
}

static bool tracked(struct watch *w, const struct mk_sample *s)
{
    double error = mk_rig_state(mk_board_virtual_rig(w->board))[1] - s->ref;
    w->held.samples += 1.0;
    w->held.track2 += isfinite(error) ? error * error : 0.0;
    w->held.u2 += s->u * s->u;
    return s->t >= w->hold_s;
}

/* True when the run can end: held for long enough, or no more chance of it. */
static bool decided(const struct mk_loop_snapshot *snap, void *user)
{
    struct watch *w = user;
    const struct mk_sample *s = &snap->sample;
    bool balancing = s->phase == MK_PHASE_BALANCE;
    if (w->tracks) {
        note_extremes(w, s);
        return tracked(w, s);
    }
    if (balancing && !w->balancing) {
        w->since_s = s->t;
        w->trial->tilt_rad = 0.0;
        w->held = (struct held){0};
    }
    w->trial->falls += w->balancing && !balancing;
    w->caught = w->caught || balancing;
    w->balancing = balancing;
    note_extremes(w, s);
    if (balancing)
        return w->since_s > w->catch_s || s->t - w->since_s >= w->hold_s;
    return s->t > w->catch_s;
}

static void judge(const struct watch *w, const struct mk_loop_snapshot *last, struct trial *t)
{
    bool held =
        w->balancing && w->since_s <= w->catch_s && last->sample.t - w->since_s >= w->hold_s;
    if (last->fault != MK_FAULT_NONE) {
        t->end = TRIAL_FAULT;
        mk_fault_line(last->fault, last->fault_joint, last->fault_t, t->fault);
    } else if (w->tracks) {
        t->end = TRIAL_HELD;
    } else if (!held) {
        t->end = w->caught ? TRIAL_FELL : TRIAL_NEVER_CAUGHT;
    } else {
        t->end = t->tilt_rad <= STILL_RAD ? TRIAL_HELD : TRIAL_NOT_STILL;
        t->caught_s = w->since_s;
    }
}

/* Runs until it is decided. Time over, condition not met and faults are outcomes. */
static enum mk_status run_loop(struct mk_ctrl *ctrl, struct watch *w, double rate_hz,
                               struct mk_error *err)
{
    struct mk_loop_config config;
    struct mk_loop *loop = NULL;
    mk_loop_config_default(&ctrl->model, &config);
    config.rate_hz = rate_hz;
    mk_safety_default(&ctrl->model, 1.0 / rate_hz, &config.limits);
    enum mk_status st = mk_loop_create(w->board, ctrl, &config, &loop, err);
    if (st == MK_OK)
        st = mk_loop_start(loop, NULL, NULL, 0, err);
    if (st == MK_OK || st == MK_ERR_FAULT) { /* links that do not hang still are an outcome too */
        struct mk_loop_snapshot last;
        if (st == MK_OK)
            st = mk_loop_wait(loop, w->catch_s + w->hold_s + 1.0, decided, w, NULL, err);
        mk_loop_get_snapshot(loop, &last);
        judge(w, &last, w->trial);
        note_held(w, w->trial);
        if (st == MK_ERR_TIMEOUT || st == MK_ERR_FAULT)
            st = MK_OK;
    }
    mk_loop_destroy(loop);
    return st;
}

enum mk_status trial_run_on(struct mk_ctrl *ctrl, const struct trial_setting *setting,
                            struct trial *out, struct mk_error *err)
{
    memset(out, 0, sizeof *out);
    out->seed = setting->seed;
    out->rig = *setting->rig;
    out->caught_s = out->sway_rad = out->off_rad = out->effort = out->track_radps = NAN;
    struct mk_clock clock;
    mk_clock_init_simulated(&clock);
    struct mk_board_config config = {.model = setting->rig,
                                     .clock = &clock,
                                     .seed = setting->seed,
                                     .count_noise = setting->count_noise};
    memcpy(config.start, setting->start_rad, sizeof config.start);
    struct watch watch = {.trial = out,
                          .rest = mk_plant(setting->rig->plant)->rest,
                          .equilibrium = ctrl->equilibrium,
                          .tracks = !ctrl->balances,
                          .catch_s = setting->catch_s,
                          .hold_s = setting->hold_s};
    enum mk_status st =
        mk_board_open(mk_board_backend_by_name("virtual"), &config, &watch.board, err);
    if (st == MK_OK)
        st = run_loop(ctrl, &watch, setting->rate_hz, err);
    mk_board_close(watch.board);
    return st;
}

enum mk_status trial_run(const struct mk_ctrl_ops *setup, const struct mk_model *nominal,
                         const struct trial_spread *spread, uint64_t seed, struct trial *out,
                         struct mk_error *err)
{
    struct mk_model rig;
    struct mk_ctrl *ctrl = NULL;
    struct trial_setting setting = {.rig = &rig,
                                    .rate_hz = spread->rate_hz,
                                    .catch_s = seed ? spread->catch_s : NOMINAL_CATCH_S,
                                    .hold_s = seed ? spread->hold_s : NOMINAL_HOLD_S,
                                    .seed = seed};
    enum mk_status st = trial_rig(nominal, spread, seed, &rig, err);
    if (st == MK_OK)
        st = mk_ctrl_create(setup, nominal, 1.0 / spread->rate_hz, NULL, &ctrl, err);
    if (st == MK_OK && spread->swingup)
        st = mk_ctrl_load_swingup(ctrl, spread->swingup, err);
    if (st == MK_OK)
        st = trial_make_changes(spread, ctrl, err);
    if (st == MK_OK)
        st = trial_run_on(ctrl, &setting, out, err);
    mk_ctrl_destroy(ctrl);
    return st;
}
