#include "console/robustness.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/random.h"
#include "mechkit/board.h"
#include "mechkit/loop.h"

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

double trial_tilt(enum mk_plant_kind plant, const double *q)
{
    double angle = plant == MK_PLANT_PENDUBOT         ? q[0] + q[1] - 0.5 * M_PI
                   : plant == MK_PLANT_REACTION_WHEEL ? q[0] - M_PI
                                                      : q[1];
    return fabs(remainder(angle, 2.0 * M_PI));
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

enum mk_status trial_rig(const struct mk_model *believed, const struct trial_spread *spread,
                         uint64_t seed, struct mk_model *out, struct mk_error *err)
{
    *out = *believed;
    if (seed == 0)
        return MK_OK;
    const struct mk_plant_info *plant = mk_plant(believed->plant);
    struct mk_random random = {seed};
    for (int i = 0; i < plant->parameter_count; i++) {
        bool friction = i >= plant->parameter_count - 2; /* of every plant the last two */
        out->parameter[i] *=
            1.0 + off_by(&random, friction ? spread->friction : spread->parameters);
    }
    enum mk_status st = MK_OK;
    for (int j = 0; j < plant->joints && st == MK_OK; j++) {
        double count_rad = 2.0 * M_PI / out->encoder_cpr[j];
        st = add_effect(out, "encoder-offset", j + 1,
                        off_by(&random, spread->offset_counts) * count_rad, err);
    }
    if (st == MK_OK && spread->delay_samples > 0)
        st = add_effect(out, "input-delay", 0, spread->delay_samples / spread->rate_hz, err);
    return st == MK_OK ? mk_model_check(out, err) : st;
}

/* What the samples of a run add up to. */
struct watch {
    struct trial *trial;
    const double *rest;
    double catch_s, hold_s;
    bool balancing, caught;
    double since_s; /* of the present catch */
};

static void note_extremes(struct watch *w, const struct mk_sample *s)
{
    struct trial *t = w->trial;
    t->u_peak = fmax(t->u_peak, fabs(s->u));
    t->travel_rad = fmax(t->travel_rad, fabs(s->q[0] - w->rest[0]));
    if (w->balancing && s->t >= w->since_s + SETTLING_S)
        t->tilt_rad = fmax(t->tilt_rad, trial_tilt(t->rig.plant, s->q));
}

/* True when the run can end: held for long enough, or no more chance of it. */
static bool decided(const struct mk_loop_snapshot *snap, void *user)
{
    struct watch *w = user;
    const struct mk_sample *s = &snap->sample;
    bool balancing = s->phase == MK_PHASE_BALANCE;
    if (balancing && !w->balancing) {
        w->since_s = s->t;
        w->trial->tilt_rad = 0.0;
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
        snprintf(t->fault, sizeof t->fault, "%s, joint %d, at %.2f s", mk_fault_name(last->fault),
                 last->fault_joint, last->fault_t);
    } else if (!held) {
        t->end = w->caught ? TRIAL_FELL : TRIAL_NEVER_CAUGHT;
    } else {
        t->end = t->tilt_rad <= STILL_RAD ? TRIAL_HELD : TRIAL_NOT_STILL;
        t->caught_s = w->since_s;
    }
}

/* Runs until it is decided. Time over, condition not met and faults are outcomes. */
static enum mk_status run_loop(struct mk_board *board, struct mk_ctrl *ctrl, struct watch *w,
                               const struct trial_spread *spread, struct mk_error *err)
{
    struct mk_loop_config config;
    struct mk_loop *loop = NULL;
    mk_loop_config_default(&ctrl->model, &config);
    config.rate_hz = spread->rate_hz;
    mk_safety_default(&ctrl->model, 1.0 / spread->rate_hz, &config.limits);
    enum mk_status st = mk_loop_create(board, ctrl, &config, &loop, err);
    if (st == MK_OK)
        st = mk_loop_start(loop, NULL, NULL, 0, err);
    if (st == MK_OK) {
        struct mk_loop_snapshot last;
        st = mk_loop_wait(loop, w->catch_s + w->hold_s + 1.0, decided, w, NULL, err);
        mk_loop_get_snapshot(loop, &last);
        judge(w, &last, w->trial);
        if (st == MK_ERR_TIMEOUT || st == MK_ERR_FAULT)
            st = MK_OK;
    }
    mk_loop_destroy(loop);
    return st;
}

enum mk_status trial_run(const struct mk_ctrl_ops *setup, const struct mk_model *believed,
                         const struct trial_spread *spread, uint64_t seed, struct trial *out,
                         struct mk_error *err)
{
    memset(out, 0, sizeof *out);
    out->seed = seed;
    out->caught_s = NAN;
    struct watch watch = {.trial = out,
                          .rest = mk_plant(believed->plant)->rest,
                          .catch_s = seed ? spread->catch_s : NOMINAL_CATCH_S,
                          .hold_s = seed ? spread->hold_s : NOMINAL_HOLD_S};
    struct mk_clock clock;
    struct mk_board *board = NULL;
    struct mk_ctrl *ctrl = NULL;
    mk_clock_init_simulated(&clock);
    enum mk_status st = trial_rig(believed, spread, seed, &out->rig, err);
    if (st == MK_OK) {
        struct mk_board_config config = {.model = &out->rig, .clock = &clock, .seed = seed};
        st = mk_board_open(mk_board_backend_by_name("virtual"), &config, &board, err);
    }
    if (st == MK_OK)
        st = mk_ctrl_create(setup, believed, 1.0 / spread->rate_hz, NULL, &ctrl, err);
    if (st == MK_OK)
        st = run_loop(board, ctrl, &watch, spread, err);
    mk_ctrl_destroy(ctrl);
    mk_board_close(board);
    return st;
}
