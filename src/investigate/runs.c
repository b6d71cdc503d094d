#include "investigate/runs.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/origin.h"
#include "investigate/nudge.h"
#include "mechkit/log.h"
#include "mechkit/signal.h"

#define REST_S 1.5 /* without motion */
#define REST_MOST_S 300.0
#define REST_RAD 0.003
#define WHEEL_RAD 0.05
#define SAY_EVERY_S 0.5
#define SETTLING_S 1.0 /* after a catch */
#define STEP_RADPS 20.0

enum mk_status rig_open(struct rig *r, const struct mk_board_ops *ops,
                        const struct mk_board_config *config, bool fast, struct mk_error *err)
{
    struct mk_board_config c = *config;
    if (fast)
        mk_clock_init_simulated(&r->clock);
    else
        mk_clock_init_monotonic(&r->clock);
    c.clock = &r->clock;
    return mk_board_open(ops, &c, &r->board, err);
}

void rig_close(struct rig *r)
{
    mk_board_close(r->board);
    r->board = NULL;
}

double rig_seconds(const struct rig *r)
{
    return 1e-9 * (double)mk_clock_now_ns(&r->clock);
}

static bool cancelled(const struct rig *r)
{
    return r->cancel && __atomic_load_n(r->cancel, __ATOMIC_ACQUIRE);
}

static enum mk_status interrupted(struct mk_error *err)
{
    return mk_error_set(err, MK_ERR_INTR, "ended by a signal, motor off");
}

static void tell(const struct rig *r, double done, const char *what)
{
    if (r->progress)
        (void)r->progress(r->progress_context, done, what);
}

/* --- rest ------------------------------------------------------------------------------------- */

struct stillness {
    double low[MK_MAX_JOINTS], high[MK_MAX_JOINTS];
    double since_s;
    int moves; /* 1-based joint that moved last */
};

static void look(struct stillness *s, const struct rig *r, const double *q, double t, bool fresh)
{
    const struct mk_plant_info *plant = mk_plant(r->given->plant);
    bool moved = fresh;
    for (int j = 0; j < plant->joints; j++) {
        const double least = plant->joint_is_wheel[j] ? WHEEL_RAD : REST_RAD;
        s->low[j] = fmin(s->low[j], q[j]);
        s->high[j] = fmax(s->high[j], q[j]);
        if (s->high[j] - s->low[j] > least) {
            moved = true;
            s->moves = j + 1;
        }
    }
    for (int j = 0; moved && j < plant->joints; j++)
        s->low[j] = s->high[j] = q[j];
    if (moved)
        s->since_s = t;
}

enum mk_status rig_rest(struct rig *r, struct mk_error *err)
{
    struct rig_watch w;
    struct stillness s = {.moves = 0};
    rig_motor_off(r->board);
    rig_watch_begin(&w, r->board, r->given);
    const double begin = rig_seconds(r);
    double said = 0.0;
    for (bool first = true;; first = false) {
        if (cancelled(r))
            return interrupted(err);
        if (!rig_watch_step(&w, 0.0))
            return mk_error_set(err, MK_ERR_NODEV,
                                "the board fell silent while the rig came to rest: check cable and "
                                "power");
        const double t = rig_seconds(r) - begin;
        look(&s, r, w.q, t, first);
        if (t - s.since_s >= REST_S)
            return MK_OK;
        if (t > REST_MOST_S)
            return mk_error_set(err, MK_ERR_TIMEOUT,
                                "joint %d does not come to rest within %.0f s: calm it by hand, "
                                "then give the same command again",
                                s.moves, REST_MOST_S);
        if (t - said > SAY_EVERY_S) {
            said = t;
            tell(r, t / REST_MOST_S, "coming to rest");
        }
    }
}

/* --- one run ---------------------------------------------------------------------------------- */

bool rig_fault_is_of_the_board(enum mk_fault fault)
{
    switch (fault) {
    case MK_FAULT_OVERRUN:
    case MK_FAULT_LINK:
    case MK_FAULT_UNPLUGGED:
    case MK_FAULT_WATCHDOG:
    case MK_FAULT_BOARD:
    case MK_FAULT_DISOBEYED:
    case MK_FAULT_STALE:
    case MK_FAULT_LOG:
    case MK_FAULT_ESTOP:
        return true;
    default:
        return false;
    }
}

static void set_limits(const struct rig *r, const struct rig_run *run, struct mk_loop_config *c)
{
    mk_safety_default(run->believed, 1.0 / c->rate_hz, &c->limits);
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        c->limits.q_min[j] = fmax(c->limits.q_min[j], r->limits.q_min[j]);
        c->limits.q_max[j] = fmin(c->limits.q_max[j], r->limits.q_max[j]);
        c->limits.v_max[j] = fmin(c->limits.v_max[j], r->limits.v_max[j]);
    }
    if (run->model_off > 0.0)
        c->limits.model_share = run->model_off;
}

struct under_way {
    struct mk_ctrl *ctrl;
    struct mk_loop *loop;
    struct mk_signal *signal;
};

/* Everything made and started. */
static enum mk_status begin(struct rig *r, const struct rig_run *run,
                            const struct mk_ctrl_ops *setup, const char *input, struct under_way *u,
                            struct mk_error *err)
{
    struct mk_loop_config config;
    struct mk_model believed = *run->believed;
    char date[MK_DATE_TEXT];
    char key[] = "date";
    (void)mk_date_text(date);
    const struct mk_log_meta meta[] = {{key, date}};
    *u = (struct under_way){NULL, NULL, NULL};
    if (isfinite(r->limits.u_max))
        believed.u_max = fmin(believed.u_max, r->limits.u_max);
    mk_loop_config_default(&believed, &config);
    config.rate_hz = r->rate_hz;
    config.stream = r->stream;
    config.cancel = r->cancel;
    set_limits(r, run, &config);
    enum mk_status st = input ? mk_signal_create(input, &u->signal, err) : MK_OK;
    if (st == MK_OK)
        st = mk_ctrl_create(setup, &believed, 1.0 / r->rate_hz, u->signal, &u->ctrl, err);
    if (st == MK_OK)
        st = mk_loop_create(r->board, u->ctrl, &config, &u->loop, err);
    if (st == MK_OK)
        st = mk_loop_start(u->loop, run->log, meta, 1, err);
    return st;
}

/* The loop's own end: motor off, log whole. */
static enum mk_status finish(struct under_way *u, struct rig_run *run, enum mk_status st,
                             struct mk_error *err)
{
    struct mk_loop_snapshot last = {.fault = MK_FAULT_NONE};
    struct mk_error late = MK_ERROR_INIT;
    if (u->loop) {
        enum mk_status halted = mk_loop_halt(u->loop, &late);
        mk_loop_get_snapshot(u->loop, &last);
        if (halted != MK_OK && (st == MK_OK || st == MK_ERR_FAULT)) {
            st = halted;
            if (err)
                *err = late;
        }
    }
    run->ran_s = last.ticks ? last.sample.t : 0.0;
    run->fault = last.fault;
    if (last.fault && last.fault_joint > 0)
        snprintf(run->fault_text, sizeof run->fault_text, "%s, joint %d, at %.2f s",
                 mk_fault_name(last.fault), last.fault_joint, last.fault_t);
    else if (last.fault)
        snprintf(run->fault_text, sizeof run->fault_text, "%s at %.2f s", mk_fault_name(last.fault),
                 last.fault_t);
    mk_loop_destroy(u->loop);
    mk_ctrl_destroy(u->ctrl);
    mk_signal_destroy(u->signal);
    return st;
}

struct telling {
    const struct rig *rig;
    double seconds, said;
};

/* A condition that says how far the run is, and is never met. */
static bool never(const struct mk_loop_snapshot *s, void *user)
{
    struct telling *telling = user;
    if (s->sample.t - telling->said > SAY_EVERY_S) {
        telling->said = s->sample.t;
        tell(telling->rig, s->sample.t / telling->seconds, "running");
    }
    return false;
}

enum mk_status rig_experiment(struct rig *r, struct rig_run *run, const char *input, double seconds,
                              struct mk_error *err)
{
    struct under_way u;
    run->fault_text[0] = '\0';
    enum mk_status st = begin(r, run, mk_ctrl_setup_by_name("open-loop"), input, &u, err);
    const bool ran = st == MK_OK;
    struct telling telling = {r, seconds, 0.0};
    if (ran)
        st = mk_loop_wait(u.loop, seconds, never, &telling, r->cancel, err);
    if (st == MK_ERR_TIMEOUT && ran)
        st = MK_OK;
    st = finish(&u, run, st, err);
    if (st == MK_ERR_FAULT && ran)
        st = MK_OK;
    return st;
}

/* --- a setup ---------------------------------------------------------------------------------- */

struct catching {
    double catch_s, hold_s;
    bool balances;
};

static bool decided(const struct mk_loop_snapshot *s, void *user)
{
    const struct catching *c = user;
    if (!c->balances)
        return s->sample.t >= c->hold_s;
    if (!isnan(s->balanced_since))
        return s->sample.t - s->balanced_since >= c->hold_s;
    return s->sample.t > c->catch_s;
}

/* Readings of the upright link. */
static double lean(const struct mk_plant_info *plant, const double *const *q, size_t k)
{
    const double *top = plant->equilibrium[plant->equilibrium_count - 1].q;
    double angle = 0.0;
    for (int joint = 0; joint < plant->joints; joint++)
        angle += plant->lean[joint] * (q[joint][k] - top[joint]);
    return remainder(angle, 2.0 * M_PI);
}

static enum mk_status figures(const struct rig *r, const struct rig_run *run, double from_s,
                              bool balances, struct rig_figures *out, struct mk_error *err)
{
    const struct mk_plant_info *plant = mk_plant(r->given->plant);
    struct mk_log *log = NULL;
    enum mk_status st = mk_log_read(run->log, &log, err);
    if (st != MK_OK)
        return st;
    const double *t = mk_log_get(log, "t"), *u = mk_log_get(log, "u");
    const double *q[MK_MAX_JOINTS] = {mk_log_get(log, "q1"), mk_log_get(log, "q2")};
    const double *speed = mk_log_get(log, "dq1"), *ref = mk_log_get(log, "ref");
    double n = 0.0, sum = 0.0, square = 0.0, effort = 0.0;
    for (size_t k = 0; t && u && q[0] && k < log->rows; k++) {
        double x = 0.0;
        if (t[k] < from_s)
            continue;
        if (balances)
            x = lean(plant, q, k);
        else if (speed && ref)
            x = speed[k] - ref[k];
        if (!isfinite(x))
            continue;
        n += 1.0;
        sum += x;
        square += x * x;
        effort += u[k] * u[k];
    }
    mk_log_free(log);
    const double mean = balances && n > 0.0 ? sum / n : 0.0;
    out->sway = n > 0.0 ? sqrt(fmax(square / n - mean * mean, 0.0)) : (double)NAN;
    out->effort = n > 0.0 ? sqrt(effort / n) : (double)NAN;
    return MK_OK;
}

enum mk_status rig_control(struct rig *r, struct rig_run *run, const struct mk_ctrl_ops *setup,
                           double catch_s, double hold_s, struct rig_figures *out,
                           struct mk_error *err)
{
    struct under_way u;
    struct catching c = {catch_s, hold_s, true};
    struct mk_loop_snapshot last = {.balanced_since = NAN, .caught_t = NAN};
    char steps[48];
    const int motor = mk_plant(r->given->plant)->motor_joint;
    snprintf(steps, sizeof steps, "%.9g*square(0.25)",
             STEP_RADPS * mk_model_joint_scale(r->given, motor));
    *out = (struct rig_figures){false, NAN, NAN, NAN};
    run->fault_text[0] = '\0';
    enum mk_status st = begin(r, run, setup, setup->takes_signal ? steps : NULL, &u, err);
    const bool ran = st == MK_OK;
    if (ran) {
        c.balances = u.ctrl->balances;
        st = mk_loop_wait(u.loop, catch_s + hold_s + 1.0, decided, &c, r->cancel, err);
        mk_loop_get_snapshot(u.loop, &last);
    }
    st = finish(&u, run, st, err);
    if (ran && (st == MK_ERR_FAULT || st == MK_ERR_TIMEOUT))
        st = MK_OK;
    if (st != MK_OK)
        return st;
    const bool held = !isnan(last.balanced_since) && last.sample.t - last.balanced_since >= hold_s;
    out->held = run->fault == MK_FAULT_NONE && (held || !c.balances);
    if (out->held && c.balances)
        out->caught_s = last.balanced_since;
    return out->held ? figures(r, run, c.balances ? last.balanced_since + SETTLING_S : 0.0,
                               c.balances, out, err)
                     : MK_OK;
}
