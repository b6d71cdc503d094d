#include "investigate/runs.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/origin.h"
#include "investigate/nudge.h"
#include "mechkit/design.h"
#include "mechkit/log.h"
#include "mechkit/signal.h"

#define REST_S 1.5 /* without motion */
#define REST_MOST_S 300.0
#define REST_RAD 0.003
#define MIDDLE_S 5.0 /* at most, for a moment to begin at */
#define PATIENCE_S 60.0
#define REST_LATER_RAD 0.0097 /* after so long: what the loop's own check lets pass */
#define WHEEL_RAD 0.05
#define SAY_EVERY_S 0.5
#define LOST_SHARE 0.3   /* of the exchanges, at most, */
#define LOST_LEAST 100   /* once there were so many */
#define CALM_AFTER_S 8.0 /* of swinging on; then on for so long, off for so long, .. */
#define CALM_S 8.0
#define CALM_PAUSE_S 4.0
#define CALM_SHARE 0.2 /* of u_max, at most */
#define CALM_FILTER 0.2
#define CALM_LOOK_S 1.0    /* after the motor went off, before a swing is measured */
#define CALM_SMALL_RAD 0.6 /* from its one end to the other */
#define CALM_GROWS 1.3
#define CALM_HELPS 0.8
#define CALM_BOOST 0.02 /* of the command's limit, more each time */
#define CALM_WATCHDOG_MS 20
#define WANDERED_RAD 0.03 /* from where the first run began */
#define LEAD_RADPS 0.5    /* so fast back */
#define LEAD_SERVO 18.0   /* rad/s */
#define LEAD_SHARE 0.5    /* of u_max, at most */
#define SETTLING_S 1.0    /* after a catch */
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

/* The limit of the command: the operator's, where it is less than the rig's. */
static double strongest(const struct rig *r)
{
    return isfinite(r->limits.u_max) ? fmin(r->given->u_max, r->limits.u_max) : r->given->u_max;
}

bool rig_rests_anywhere(const struct mk_model *model, int joint)
{
    const struct mk_plant_info *plant = mk_plant(model->plant);
    return plant->joint_is_wheel[joint] || plant->joint_is_level[joint];
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
        const double link = t < PATIENCE_S ? REST_RAD : REST_LATER_RAD;
        const double least = plant->joint_is_wheel[j] ? WHEEL_RAD : link;
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

/* A run takes its zero at its start: links that still swing by a count or two pass where they hang.
 */
static bool in_the_middle(const struct stillness *s, const struct rig *r, const double *q)
{
    for (int j = 0; j < mk_model_joints(r->given); j++) {
        const double count = mk_model_count(r->given, j) / mk_model_joint_scale(r->given, j);
        if (!rig_rests_anywhere(r->given, j) &&
            fabs(q[j] - 0.5 * (s->low[j] + s->high[j])) > 0.6 * count)
            return false;
    }
    return true;
}

/* The gain of a brake at the motor joint under which the slowest motion about hanging dies out
 * fastest: too little hardly brakes, too much locks the joint and the other swings on. */
static double best_brake(const struct mk_plant_info *plant, const double *a, const double *b,
                         double inertia)
{
    const int n = 2 * plant->joints;
    double best = 0.0, gain = 0.0;
    for (double rate = 0.1; rate < 40.0; rate *= 1.3) { /* 1/s, of the joint alone */
        double k[2 * MK_MAX_JOINTS] = {0}, re[2 * MK_MAX_JOINTS], im[2 * MK_MAX_JOINTS];
        double slowest = INFINITY;
        k[plant->joints + plant->motor_joint] = rate * inertia;
        if (mk_design_poles(n, a, b, k, re, im, NULL) != MK_OK)
            continue;
        for (int i = 0; i < n; i++)
            if (hypot(re[i], im[i]) > 1e-3) /* where it rests does not matter */
                slowest = fmin(slowest, -re[i]);
        if (slowest > best) {
            best = slowest;
            gain = rate * inertia;
        }
    }
    return gain;
}

void rig_let_calm(struct rig *r)
{
    const struct mk_plant_info *plant = mk_plant(r->given->plant);
    const int n = 2 * plant->joints, motor = plant->motor_joint;
    double a[4 * MK_MAX_JOINTS * MK_MAX_JOINTS], b[2 * MK_MAX_JOINTS];
    double q[4 * MK_MAX_JOINTS * MK_MAX_JOINTS] = {0};
    double mass[MK_MAX_JOINTS * MK_MAX_JOINTS], h[MK_MAX_JOINTS], still[MK_MAX_JOINTS] = {0};
    mk_plant_linearise(r->given, plant->rest, false, a, b);
    mk_plant_mass(r->given, plant->rest, still, mass, h);
    r->brake = best_brake(plant, a, b, mass[motor * (plant->joints + 1)]);
    for (int j = 0; j < plant->joints; j++) {
        const double size = mk_model_joint_scale(r->given, j);
        const bool anywhere = plant->joint_is_level[j] || plant->joint_is_wheel[j];
        q[j * (n + 1)] = (anywhere ? 0.05 : 100.0) / (size * size);
        q[(plant->joints + j) * (n + 1)] = (anywhere ? 0.01 : 1.0) / (size * size);
    }
    const double most = CALM_SHARE * strongest(r);
    r->calms = mk_design_lqrd(n, a, b, q, 1.0 / (most * most), 1.0 / RIG_WATCH_RATE_HZ, 0, r->calm,
                              NULL, NULL) == MK_OK;
}

/* What a rig that swings is calmed by. */
struct calming {
    double low[MK_MAX_JOINTS], high[MK_MAX_JOINTS]; /* while the motor was off last */
    double before[MK_MAX_JOINTS], speed[MK_MAX_JOINTS];
    bool feedback; /* of the state; else a brake */
    double boost;  /* command beyond the model's dry friction that it takes to move the joint */
    double swing;  /* the largest, as the motor went on the last time; 0: it was not yet */
    double off_s;  /* since when the motor is off */
};

static void follow(struct calming *c, const struct rig_watch *w, bool driven, double t)
{
    for (int j = 0; j < w->joints; j++) {
        c->speed[j] += CALM_FILTER * ((w->q[j] - c->before[j]) * RIG_WATCH_RATE_HZ - c->speed[j]);
        c->before[j] = w->q[j];
        if (driven)
            continue;
        if (t - c->off_s < CALM_LOOK_S) {
            c->low[j] = c->high[j] = w->q[j];
        } else {
            c->low[j] = fmin(c->low[j], w->q[j]);
            c->high[j] = fmax(c->high[j], w->q[j]);
        }
    }
}

static double swing_of(const struct calming *c, const struct mk_plant_info *plant)
{
    double most = 0.0;
    for (int j = 0; j < plant->joints; j++)
        if (!plant->joint_is_wheel[j] && !plant->joint_is_level[j])
            most = fmax(most, c->high[j] - c->low[j]);
    return most;
}

static double calming_command(const struct rig *r, const struct calming *c)
{
    const struct mk_plant_info *plant = mk_plant(r->given->plant);
    const int motor = plant->motor_joint;
    const double most = CALM_SHARE * strongest(r);
    double u = -r->brake * c->speed[motor] * mk_model_joint_scale(r->given, motor);
    if (c->feedback) {
        u = 0.0;
        for (int j = 0; j < plant->joints; j++) {
            const double size = mk_model_joint_scale(r->given, j);
            const double middle = 0.5 * (c->low[j] + c->high[j]);
            u -= r->calm[j] * (c->before[j] - middle) * size;
            u -= r->calm[plant->joints + j] * c->speed[j] * size;
        }
        const double dry = r->given->parameter[plant->parameter_count - 1] + c->boost;
        if (dry > 0.0)
            u += dry * tanh(u / (0.2 * dry));
    }
    return fmax(-most, fmin(most, u));
}

static bool calms_now(double t)
{
    return t > CALM_AFTER_S && fmod(t - CALM_AFTER_S, CALM_S + CALM_PAUSE_S) < CALM_S;
}

/* The board guards what is sent from here on. */
static enum mk_status switch_on(struct rig *r, struct mk_error *err)
{
    const struct mk_board_ops *ops = r->board->ops;
    return ops->set_watchdog ? ops->set_watchdog(r->board, CALM_WATCHDOG_MS, err) : MK_OK;
}

/* The motor goes on or off. */
static enum mk_status switch_motor(struct rig *r, struct calming *c, bool on, double t,
                                   struct mk_error *err)
{
    const double swing = swing_of(c, mk_plant(r->given->plant));
    if (!on) {
        c->off_s = t;
        rig_motor_off(r->board);
        return MK_OK;
    }
    const bool before = c->swing > 0.0;
    r->calms = !(before && swing > CALM_GROWS * c->swing);
    /* What hardly helped is not done again: dry friction or a dead zone holds the joint. */
    const bool stuck = before && swing > CALM_HELPS * c->swing;
    if (stuck && c->feedback)
        c->boost += CALM_BOOST * strongest(r);
    c->feedback = c->feedback || stuck || swing < CALM_SMALL_RAD;
    c->swing = swing;
    return r->calms ? switch_on(r, err) : MK_OK;
}

#define LONG_BITS 24

/* Counters at rest. Between two counts a reading flickers, and a count off at every zero is a place
 * that wanders: the count that most readings say is the mean's nearest. */
struct counters {
    double sum[MK_MAX_JOINTS];
    int readings;
    double since_s; /* when the rest began that they are of */
};

static void count_at_rest(struct counters *c, const struct rig_watch *w, double since_s)
{
    if (c->since_s != since_s)
        *c = (struct counters){.since_s = since_s};
    for (int j = 0; j < w->joints; j++)
        c->sum[j] += w->raw[j];
    c->readings++;
}

static void note_origin(struct rig *r, const struct rig_watch *w, const struct counters *c)
{
    for (int j = 0; j < w->joints; j++)
        if (r->framed && w->bits >= LONG_BITS && rig_rests_anywhere(r->given, j))
            r->origin[j] =
                r->zeroed_at[j] + round(c->sum[j] / c->readings) * mk_model_count(r->given, j);
}

/* Who hears nothing would take it for rest. */
static enum mk_status hears(const struct rig_watch *w, struct mk_error *err)
{
    if (w->asked < LOST_LEAST || w->lost <= LOST_SHARE * w->asked)
        return MK_OK;
    return mk_error_set(err, MK_ERR_TIMEOUT,
                        "the board answered %d of %d exchanges in time: it, or the line, is too "
                        "slow for %.0f samples a second. A nearer or idler machine, or, where the "
                        "rig is simulated and its clock can be stepped, --fast",
                        w->asked - w->lost, w->asked, RIG_WATCH_RATE_HZ);
}

/* The watch of a rig that comes to rest. */
struct resting {
    struct rig_watch w;
    struct stillness s;
    struct calming c;
    struct counters n;
    bool driven;   /* the motor was on in the last step */
    double said_s; /* when it was told last */
};

/* One exchange, with a calming command where that is due, and what the readings say. */
static enum mk_status rest_step(struct rig *r, struct resting *now, double t, bool first,
                                struct mk_error *err)
{
    const bool drives = r->calms && calms_now(t);
    if (cancelled(r))
        return interrupted(err);
    enum mk_status st = drives != now->driven ? switch_motor(r, &now->c, drives, t, err) : MK_OK;
    if (st != MK_OK)
        return st;
    if (!rig_watch_step(&now->w, drives && r->calms ? calming_command(r, &now->c) : 0.0))
        return mk_error_set(err, MK_ERR_NODEV,
                            "the board fell silent while the rig came to rest: check cable and "
                            "power. The same command goes on");
    st = hears(&now->w, err);
    if (st != MK_OK)
        return st;
    follow(&now->c, &now->w, drives, t);
    look(&now->s, r, now->w.q, t, first || drives || now->driven);
    count_at_rest(&now->n, &now->w, now->s.since_s);
    now->driven = drives;
    return MK_OK;
}

/* It stands still; for longer where that is not in the middle of its swing. */
static bool rests(const struct resting *now, const struct rig *r, double t)
{
    const double still_s = t - now->s.since_s;
    return still_s >= REST_S &&
           (in_the_middle(&now->s, r, now->w.q) || still_s >= REST_S + MIDDLE_S);
}

static enum mk_status until_still(struct rig *r, struct mk_error *err)
{
    struct resting now = {.n.since_s = -1.0};
    const double begin = rig_seconds(r);
    rig_watch_begin(&now.w, r->board, r->given);
    for (bool first = true;; first = false) {
        const double t = rig_seconds(r) - begin;
        enum mk_status st = rest_step(r, &now, t, first, err);
        if (st != MK_OK)
            return st;
        if (rests(&now, r, t)) {
            note_origin(r, &now.w, &now.n);
            return MK_OK;
        }
        if (t > REST_MOST_S)
            return mk_error_set(err, MK_ERR_TIMEOUT,
                                "joint %d does not come to rest within %.0f s: calm it by hand, "
                                "then give the same command again",
                                now.s.moves, REST_MOST_S);
        if (t - now.said_s > SAY_EVERY_S) {
            now.said_s = t;
            tell(r, t / REST_MOST_S, now.driven ? "calming the rig" : "coming to rest");
        }
    }
}

/* Leads a motor joint that rests anywhere back to where the first run began, slowly, as the doctor
 * sweeps: runs of a carriage that wanders would come to the ends of its track. */
static enum mk_status lead_back(struct rig *r, struct mk_error *err)
{
    const struct mk_plant_info *plant = mk_plant(r->given->plant);
    const int motor = plant->motor_joint;
    const double size = mk_model_joint_scale(r->given, motor);
    const double away = r->origin[motor] / size, most = LEAD_SHARE * strongest(r);
    const double seconds = fabs(away) / LEAD_RADPS;
    double mass[MK_MAX_JOINTS * MK_MAX_JOINTS], h[MK_MAX_JOINTS], still[MK_MAX_JOINTS] = {0};
    mk_plant_mass(r->given, plant->rest, still, mass, h);
    const double inertia = mass[motor * (plant->joints + 1)] * size;
    const double kp = inertia * LEAD_SERVO * LEAD_SERVO, kd = 1.4 * inertia * LEAD_SERVO;
    double speed = 0.0, before = 0.0;
    struct rig_watch w;
    enum mk_status st = switch_on(r, err);
    if (st != MK_OK)
        return st;
    rig_watch_begin(&w, r->board, r->given);
    bool well = true;
    for (int k = 0; well && k < (int)((seconds + 1.0) * RIG_WATCH_RATE_HZ); k++) {
        if (cancelled(r))
            return interrupted(err);
        const double share = fmin(1.0, k / RIG_WATCH_RATE_HZ / seconds);
        speed += CALM_FILTER * ((w.q[motor] - before) * RIG_WATCH_RATE_HZ - speed);
        before = w.q[motor];
        const double u = kp * (-share * away - w.q[motor]) - kd * speed;
        well = rig_watch_step(&w, k > 0 ? fmax(-most, fmin(most, u)) : 0.0);
    }
    rig_motor_off(r->board);
    return well ? MK_OK
                : mk_error_set(err, MK_ERR_NODEV,
                               "the board tripped, or is gone, while joint %d was led back: "
                               "check cable and power. The same command goes on",
                               motor + 1);
}

static bool has_wandered(const struct rig *r)
{
    const struct mk_plant_info *plant = mk_plant(r->given->plant);
    const int motor = plant->motor_joint;
    return r->calms && plant->joint_is_level[motor] &&
           fabs(r->origin[motor]) > WANDERED_RAD * mk_model_joint_scale(r->given, motor);
}

enum mk_status rig_rest(struct rig *r, struct mk_error *err)
{
    rig_motor_off(r->board);
    enum mk_status st = until_still(r, err);
    if (st == MK_OK && has_wandered(r)) {
        st = lead_back(r, err);
        rig_motor_off(r->board);
        if (st == MK_OK)
            st = until_still(r, err);
    }
    rig_motor_off(r->board);
    return st;
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
    mk_safety_default(run->nominal, 1.0 / c->rate_hz, &c->limits);
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        c->limits.q_min[j] = fmax(c->limits.q_min[j], r->limits.q_min[j]);
        c->limits.q_max[j] = fmin(c->limits.q_max[j], r->limits.q_max[j]);
        c->limits.v_max[j] = fmin(c->limits.v_max[j], r->limits.v_max[j]);
    }
    for (int j = 0; j < mk_model_joints(run->nominal); j++) {
        c->limits.q_min[j] -= r->origin[j];
        c->limits.q_max[j] -= r->origin[j];
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
    struct mk_model nominal = *run->nominal;
    char date[MK_DATE_TEXT];
    char key[] = "date";
    (void)mk_date_text(date);
    const struct mk_log_meta meta[] = {{key, date}};
    *u = (struct under_way){NULL, NULL, NULL};
    nominal.u_max = fmin(nominal.u_max, strongest(r));
    mk_loop_config_default(&nominal, &config);
    config.rate_hz = r->rate_hz;
    config.stream = r->stream;
    config.cancel = r->cancel;
    set_limits(r, run, &config);
    enum mk_status st = input ? mk_signal_create(input, &u->signal, err) : MK_OK;
    if (st == MK_OK)
        st = mk_ctrl_create(setup, &nominal, 1.0 / r->rate_hz, u->signal, &u->ctrl, err);
    if (st == MK_OK)
        st = mk_loop_create(r->board, u->ctrl, &config, &u->loop, err);
    if (st == MK_OK)
        st = mk_loop_start(u->loop, run->log, meta, 1, err);
    if (st == MK_OK) {
        memcpy(r->zeroed_at, r->origin, sizeof r->zeroed_at);
        r->framed = true;
    }
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
    if (last.fault)
        mk_fault_line(last.fault, last.fault_joint, last.fault_t, run->fault_text);
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
