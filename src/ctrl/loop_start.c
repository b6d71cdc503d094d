/* What comes before the first tick: are the links at rest, is the log open, is the thread ready. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "ctrl/loop_priv.h"

/* The links are watched for so long. A link at the turning point of a swing stands still for a
 * moment; within this time a swing of 0.03 rad shows even then. */
#define TURN_RAD (2.0 * 3.14159265358979323846)
#define REST_S 0.2
#define REST_BLOCKS 4

/* Each exchange lets a virtual rig live through the time since the last one. On a machine too busy
 * for that it takes longer from sample to sample: the watch gives up after so long. */
#define REST_LIMIT_S 5.0

/* Largest wander of a block's mean that still counts as hanging still: five counts or so. */
#define REST_MOTION_RAD 0.008

struct rest_watch {
    double sum[REST_BLOCKS][MK_MAX_JOINTS];
    int samples[REST_BLOCKS];
    int lost;
    struct mk_board_sample last;
};

static enum mk_status link_failed(struct mk_loop *loop, enum mk_status st, struct mk_error *err)
{
    enum mk_fault fault = MK_FAULT_BOARD;
    if (st == MK_ERR_NODEV)
        fault = MK_FAULT_UNPLUGGED;
    else if (st == MK_ERR_TIMEOUT || st == MK_ERR_PROTO)
        fault = MK_FAULT_LINK;
    mk_safety_latch(&loop->safety, fault, 0.0, 0);
    return mk_loop_fault_error(loop->safety.fault, 0.0, 0, err);
}

/* The safety latches a fault of the start, and it is the error. */
static enum mk_status latch(struct mk_loop *loop, enum mk_fault fault, double value,
                            struct mk_error *err)
{
    mk_safety_latch(&loop->safety, fault, value, 0);
    return mk_loop_fault_error(fault, value, 0, err);
}

/* Whether somebody, or the time that it takes, ends the watch. */
static enum mk_status may_watch_on(struct mk_loop *loop, double since_s, struct mk_error *err)
{
    if (atomic_load_explicit(&loop->estop, memory_order_relaxed))
        return latch(loop, MK_FAULT_ESTOP, 0.0, err);
    if (loop->config.cancel && __atomic_load_n(loop->config.cancel, __ATOMIC_RELAXED))
        return mk_error_set(err, MK_ERR_INTR, "interrupted");
    return since_s > REST_LIMIT_S ? latch(loop, MK_FAULT_OVERRUN, since_s, err) : MK_OK;
}

/* One exchange with command 0. `lost`: it brought no sample, and not too many were lost in a row.
 */
static enum mk_status watch_once(struct mk_loop *loop, struct rest_watch *w, bool *lost,
                                 struct mk_error *err)
{
    enum mk_status st = mk_board_exchange(loop->board, 0.0, &w->last);
    *lost = st == MK_ERR_TIMEOUT || st == MK_ERR_PROTO;
    w->lost = *lost ? w->lost + 1 : 0;
    if (w->lost >= loop->config.limits.lost_limit || (st != MK_OK && !*lost))
        return link_failed(loop, st, err);
    bool listens = !(w->last.status & MK_BOARD_ST_OWN);
    if (!*lost && !(listens && mk_board_watch_obeys(0.0, w->last.u_applied)))
        return latch(loop, MK_FAULT_DISOBEYED, 0.0, err);
    return MK_OK;
}

/* Readings at the run's rate, command 0. */
static enum mk_status watch_links(struct mk_loop *loop, struct rest_watch *w, struct mk_error *err)
{
    struct mk_clock *clock = loop->board->clock;
    int n = (int)(REST_S * loop->config.rate_hz);
    int64_t t0_ns = mk_clock_now_ns(clock);
    int32_t first[MK_MAX_JOINTS] = {0};
    bool have = false, lost;
    for (int k = 0; k < n; k++) {
        mk_clock_sleep_until(clock, t0_ns + (int64_t)(k * 1e9 / loop->config.rate_hz));
        enum mk_status st =
            may_watch_on(loop, 1e-9 * (double)(mk_clock_now_ns(clock) - t0_ns), err);
        if (st == MK_OK)
            st = watch_once(loop, w, &lost, err);
        if (st != MK_OK)
            return st;
        if (lost)
            continue;
        if (!have)
            memcpy(first, w->last.count, sizeof first);
        have = true;
        int block = k * REST_BLOCKS / n;
        w->samples[block]++;
        for (int j = 0; j < loop->plant->joints; j++)
            w->sum[block][j] +=
                mk_counter_difference(w->last.count[j], first[j], loop->identity.counter_bits);
    }
    return have ? MK_OK : link_failed(loop, MK_ERR_TIMEOUT, err);
}

/* 1-based joint that moved; 0: none. Wheels may turn. */
static int moving_joint(const struct mk_loop *loop, const struct rest_watch *w)
{
    for (int j = 0; j < loop->plant->joints; j++) {
        double low = INFINITY, high = -INFINITY;
        for (int b = 0; b < REST_BLOCKS; b++) {
            if (w->samples[b] == 0)
                continue;
            double mean = w->sum[b][j] / w->samples[b] * loop->rad_per_count[j];
            low = fmin(low, mean);
            high = fmax(high, mean);
        }
        if (!loop->plant->joint_is_wheel[j] &&
            high - low > REST_MOTION_RAD * mk_model_joint_scale(&loop->ctrl->model, j))
            return j + 1;
    }
    return 0;
}

/* The run counts from rest: links keep their zero but lose whole turns; what rests anywhere
 * (wheels, the Furuta arm) starts at zero. */
static void set_origin(struct mk_loop *loop, const struct mk_board_sample *b)
{
    struct mk_loop_run *r = &loop->run;
    r->sequence = b->sequence;
    r->lost_since = 0;
    for (int j = 0; j < loop->plant->joints; j++) {
        bool anywhere =
            loop->plant->joint_is_wheel[j] || isinf(loop->config.limits.rest_tolerance[j]);
        double turn = TURN_RAD / loop->rad_per_count[j]; /* counts */
        int64_t turns = loop->ctrl->model.joint_linear[j] ? 0 : llround(b->count[j] / turn);
        r->raw[j] = b->count[j]; /* of wide counters beyond their range */
        r->total[j] = anywhere ? 0 : (int32_t)(b->count[j] - llround((double)turns * turn));
        mk_velocity_reset(&r->speed[j]);
        mk_velocity_step(&r->speed[j], loop->plant->rest[j] + r->total[j] * loop->rad_per_count[j]);
    }
}

enum mk_status mk_loop_check_rest(struct mk_loop *loop, struct mk_error *err)
{
    /* The first time nobody knows where zero is: the rig is taken to hang, if only it is still. */
    bool fresh = !loop->host.zeroed;
    if (fresh) {
        enum mk_status st = loop->board->ops->zero_counters(loop->board, err);
        if (st != MK_OK)
            return st == MK_ERR_NODEV ? link_failed(loop, st, err) : st;
    }
    struct rest_watch w = {0};
    enum mk_status st = watch_links(loop, &w, err);
    if (st != MK_OK)
        return st;
    int moving = moving_joint(loop, &w);
    if (moving) {
        mk_safety_latch(&loop->safety, MK_FAULT_NOT_HANGING, 0.0, moving);
        return mk_error_set(err, MK_ERR_FAULT,
                            "fault %s: joint %d moves; wait until the links hang still",
                            mk_fault_name(MK_FAULT_NOT_HANGING), moving);
    }
    double q[MK_MAX_JOINTS] = {0};
    for (int j = 0; j < loop->plant->joints; j++)
        q[j] = loop->plant->rest[j] + w.last.count[j] * loop->rad_per_count[j];
    if (mk_safety_check_rest(&loop->safety, q, loop->plant->rest, loop->plant->joint_is_wheel)) {
        int j = loop->safety.fault_joint;
        const struct mk_model *model = &loop->ctrl->model;
        double off = q[j - 1] - loop->plant->rest[j - 1];
        off = model->joint_linear[j - 1] ? off : remainder(off, TURN_RAD);
        return mk_error_set(err, MK_ERR_FAULT, "fault %s: joint %d is %.3f %s away from %s",
                            mk_fault_name(MK_FAULT_NOT_HANGING), j, off,
                            mk_model_unit(model, j - 1, "rad"),
                            model->joint_linear[j - 1] ? "its rest" : "hanging straight down");
    }
    loop->host.zeroed = true;
    set_origin(loop, &w.last);
    return MK_OK;
}

static void forget_last_run(struct mk_loop *loop)
{
    struct mk_loop_run *r = &loop->run;
    r->tick = 0;
    r->end_tick = UINT64_MAX;
    r->u_next = r->u_held = 0.0;
    r->since_good = 0.0;
    r->missed = 0;
    r->streaming = r->timed = false;
    r->shown = (struct mk_loop_snapshot){.balanced_since = NAN, .caught_t = NAN};
    atomic_ullong *counters[] = {&loop->ticks, &loop->late, &loop->overruns,
                                 &loop->lost,  &loop->gaps, &loop->dropped};
    for (size_t i = 0; i < sizeof counters / sizeof counters[0]; i++)
        atomic_store_explicit(counters[i], 0, memory_order_relaxed);
    atomic_store_explicit(&loop->stop, false, memory_order_relaxed);
    atomic_store_explicit(&loop->ended, false, memory_order_relaxed);
    mk_histogram_clear(&loop->lateness);
    mk_histogram_clear(&loop->busy);
    mk_safety_clear(&loop->safety);
    mk_residual_init(&loop->residual, &loop->ctrl->model, &loop->config.limits);
    mk_ctrl_reset(loop->ctrl);
    loop->mail.signal = loop->ctrl->ref;
    memcpy(loop->mail.value, loop->ctrl->value, sizeof loop->mail.value);
}

static enum mk_status begin_realtime(struct mk_loop *loop, struct mk_error *err)
{
    enum mk_status st = mk_loop_writer_spawn(&loop->writer, err);
    if (st == MK_OK)
        st = mk_loop_thread_go(loop, false, err);
    else
        (void)mk_loop_thread_go(loop, true, NULL);
    return st;
}

static enum mk_status refuse(struct mk_loop *loop, enum mk_status st)
{
    (void)loop->board->ops->safe_state(loop->board);
    loop->run.shown.state = loop->safety.fault ? MK_LOOP_FAULTED : MK_LOOP_IDLE;
    mk_loop_publish(loop);
    return st;
}

enum mk_status mk_loop_start(struct mk_loop *loop, const char *log_path,
                             const struct mk_log_meta *meta, size_t meta_count,
                             struct mk_error *err)
{
    struct mk_loop_snapshot now;
    mk_loop_get_snapshot(loop, &now);
    if (now.state == MK_LOOP_FAULTED)
        return mk_error_set(err, MK_ERR_STATE, "fault %s is latched: acknowledge it first",
                            mk_fault_name(now.fault));
    if (loop->host.running)
        return mk_error_set(err, MK_ERR_STATE, "the loop runs already");

    forget_last_run(loop);
    enum mk_status st = mk_loop_check_rest(loop, err);
    if (st != MK_OK)
        return refuse(loop, st);

    /* The thread first: the log says whether it was granted real time. */
    if (!loop->simulated && (st = mk_loop_thread_create(loop, err)) != MK_OK)
        return refuse(loop, st);
    st = mk_loop_writer_open(loop, log_path, meta, meta_count, err);
    if (st != MK_OK) {
        if (!loop->simulated)
            (void)mk_loop_thread_go(loop, true, NULL);
        return refuse(loop, st);
    }
    loop->run.shown.state = MK_LOOP_RUNNING;
    mk_loop_publish(loop);
    /* Simulated time needs no thread: the ticks are made by whoever waits. */
    st = loop->simulated ? mk_loop_begin_ticks(loop, err) : begin_realtime(loop, err);
    if (st != MK_OK) {
        (void)mk_loop_writer_finish(loop, NULL);
        return refuse(loop, st);
    }
    loop->host.running = true;
    return MK_OK;
}
