/* The tick: one sample from deadline to hand-over. All but mk_loop_begin_ticks is RT: it
 * allocates, locks and prints nothing. */
#include <math.h>
#include <string.h>

#include "ctrl/loop_priv.h"

/* After a fault the run goes on for so long with the motor off, so that the log shows what the rig
 * did; a board that is gone or does not answer, or a log that cannot be written, ends it at once.
 */
#define TAIL_S 0.2

/* How many skipped samples the speed estimators are told of one by one. */
#define EXTRAPOLATE_MAX 20u

void mk_loop_publish(struct mk_loop *loop)
{
    struct mk_loop_snapshot *s = &loop->run.shown;
    s->fault = loop->safety.fault;
    s->fault_t = loop->safety.fault_t;
    s->fault_joint = loop->safety.fault_joint;
    mk_publish_put(loop->published, s);
}

void mk_loop_trip(struct mk_loop *loop, enum mk_fault fault, double t, int joint)
{
    struct mk_loop_run *r = &loop->run;
    mk_safety_latch(&loop->safety, fault, t, joint);
    r->shown.unconfirmed = loop->board->ops->safe_state(loop->board) != MK_OK;
    r->u_next = r->u_held = 0.0;
    if (r->streaming) /* that has ended it; the tail goes by the host's clock */
        r->t0_ns =
            mk_clock_now_ns(loop->board->clock) - (int64_t)((double)r->tick * 1e9 * loop->dt);
    r->streaming = false;
    bool useless = fault == MK_FAULT_UNPLUGGED || fault == MK_FAULT_LOG;
    uint64_t tail = useless ? 0 : (uint64_t)llround(TAIL_S / loop->dt);
    r->end_tick = r->tick + 1 + tail;
}

static void count_up(atomic_ullong *counter, uint64_t n)
{
    atomic_store_explicit(counter, atomic_load_explicit(counter, memory_order_relaxed) + n,
                          memory_order_relaxed);
}

static int64_t deadline_of(const struct mk_loop *loop, uint64_t tick)
{
    return loop->run.t0_ns + (int64_t)((double)tick * 1e9 / loop->config.rate_hz + 0.5);
}

static void note_overrun(struct mk_loop *loop, struct mk_sample *s)
{
    s->flags |= MK_FLAG_OVERRUN;
    count_up(&loop->overruns, 1);
}

/* Of an overrun the whole delay is told, not what is left of it modulo the period. */
static void note_time(struct mk_loop *loop, struct mk_sample *s, int64_t late_ns)
{
    struct mk_loop_run *r = &loop->run;
    if (r->missed > 0 || (double)late_ns > 0.5e9 * loop->dt) {
        s->flags |= MK_FLAG_LATE;
        count_up(&loop->late, 1);
    }
    int64_t whole_ns = late_ns + (int64_t)((double)r->missed * 1e9 * loop->dt);
    s->late_us = (double)whole_ns / 1e3;
    mk_histogram_add(&loop->lateness, whole_ns);
}

/* Sleeps to the next deadline. Deadlines that have passed whole are skipped: the time they were for
 * is gone, and catching up would only crowd the samples that follow. */
static void await_deadline(struct mk_loop *loop, struct mk_sample *s)
{
    struct mk_loop_run *r = &loop->run;
    int64_t deadline = deadline_of(loop, r->tick);
    mk_clock_sleep_until(loop->board->clock, deadline);
    int64_t now = mk_clock_now_ns(loop->board->clock);
    r->missed = 0;
    if (now >= deadline_of(loop, r->tick + 1)) {
        r->missed = (uint64_t)((double)(now - deadline) * 1e-9 * loop->config.rate_hz);
        if (r->missed == 0)
            r->missed = 1;
        r->tick += r->missed;
        deadline = deadline_of(loop, r->tick);
        note_overrun(loop, s);
    }
    note_time(loop, s, now > deadline ? now - deadline : 0);
    r->begin_ns = now;
}

/* --- the board's clock ---------------------------------------------------------------------------
 */

/* The board's clock may run slower than the host's by so much: then the fastest sample so far is
 * not for ever the measure of the later ones. */
#define DRIFT_PPM 200

static uint64_t tick_of(const struct mk_loop *loop, const struct mk_board_sample *b)
{
    double t = (double)(b->board_ns - loop->run.zero_ns) * 1e-9;
    return t > 0.0 ? (uint64_t)llround(t * loop->config.rate_hz) : 0;
}

/* A board whose clock stands still, or leaps, would make the host wait for ever, or be years late:
 * so many old samples at a time, and so far ahead, are looked at. */
#define OLD_SAMPLES_MAX 16
#define AHEAD_MAX_S 2.0

static bool is_next(const struct mk_loop *loop, const struct mk_board_sample *b)
{
    double ahead_s = (double)b->board_ns * 1e-9 - (double)loop->run.zero_ns * 1e-9 -
                     (double)loop->run.tick * loop->dt;
    return ahead_s > -0.5 * loop->dt && ahead_s < AHEAD_MAX_S;
}

/* Waits for the board's next sample: its time says which tick this is. One that comes after its row
 * has been written off is let go. */
static enum mk_status await_sample(struct mk_loop *loop, struct mk_board_sample *b,
                                   struct mk_sample *s)
{
    const uint32_t ended = MK_BOARD_ST_WATCHDOG | MK_BOARD_ST_FAULT;
    struct mk_loop_run *r = &loop->run;
    enum mk_status st;
    r->missed = 0;
    int looks = 0;
    do
        st = mk_board_exchange(loop->board, r->u_next, b);
    while (st == MK_OK && !(b->status & ended) && r->timed && tick_of(loop, b) < r->tick &&
           ++looks < OLD_SAMPLES_MAX);
    r->begin_ns = mk_clock_now_ns(loop->board->clock);
    if (st != MK_OK || (b->status & ended))
        return st;
    if (r->timed && !is_next(loop, b))
        return MK_ERR_PROTO;
    int64_t ahead_ns = r->begin_ns - b->board_ns, drift_ns = (int64_t)(DRIFT_PPM * 1e3 * loop->dt);
    if (!r->timed) {
        r->timed = true;
        r->zero_ns = b->board_ns - (int64_t)((double)r->tick * 1e9 * loop->dt);
        r->ahead_ns = ahead_ns;
    }
    r->missed = tick_of(loop, b) - r->tick;
    r->tick += r->missed;
    if (r->missed > 0)
        note_overrun(loop, s);
    r->ahead_ns = ahead_ns < r->ahead_ns + drift_ns ? ahead_ns : r->ahead_ns + drift_ns;
    note_time(loop, s, ahead_ns - r->ahead_ns);
    return st;
}

/* --- one sample ----------------------------------------------------------------------------------
 */

static void place(const struct mk_loop *loop, struct mk_sample *s)
{
    s->tick = loop->run.tick;
    s->t = (double)s->tick / loop->config.rate_hz;
}

/* Parameters and signal change only here, all of them together. */
void mk_loop_take_mail(struct mk_loop *loop, struct mk_sample *s)
{
    struct mk_ctrl *ctrl = loop->ctrl;
    if (!atomic_load_explicit(&loop->mail_waits, memory_order_acquire))
        return;
    struct mk_loop_change change = {.t = s->t, .now = loop->mail};
    atomic_store_explicit(&loop->mail_waits, false, memory_order_release);
    if (memcmp(ctrl->value, change.now.value, sizeof ctrl->value) != 0)
        s->flags |= MK_FLAG_PARAMS;
    if (ctrl->ref != change.now.signal)
        s->flags |= MK_FLAG_SIGNAL;
    memcpy(ctrl->value, change.now.value, sizeof ctrl->value);
    ctrl->ref = change.now.signal;
    if (ctrl->ops->changed && (s->flags & MK_FLAG_PARAMS))
        ctrl->ops->changed(ctrl);
    change.flags = s->flags & (MK_FLAG_PARAMS | MK_FLAG_SIGNAL);
    if (loop->writer.log && change.flags)
        (void)mk_ring_push(loop->writer.changes, &change); /* the row's flag remains */
}

/* Exchanges that the board may have counted since the last good one and nobody saw. */
static uint64_t unseen(const struct mk_loop_run *r)
{
    return (uint64_t)r->lost_since + (r->streaming ? r->missed : 0);
}

/* A good reading: unwraps the counters and advances the speed estimates. */
static void take_reading(struct mk_loop *loop, const struct mk_board_sample *b, struct mk_sample *s)
{
    struct mk_loop_run *r = &loop->run;
    uint32_t step = b->sequence - r->sequence;
    const struct mk_board_watch_sample sample = {
        .reading = b, .sent = r->u_next, .unseen = unseen(r), .host_ns = r->begin_ns};
    mk_safety_latch(&loop->safety, mk_board_watch_step(&r->watch, &sample), s->t, 0);
    if (step < 1 || step > 1u + (uint32_t)r->lost_since) {
        s->flags |= MK_FLAG_GAP;
        count_up(&loop->gaps, 1);
    }
    r->sequence = b->sequence;
    r->lost_since = 0;
    for (int j = 0; j < loop->plant->joints; j++) {
        r->total[j] += mk_counter_difference(b->count[j], r->raw[j], loop->identity.counter_bits);
        r->raw[j] = b->count[j];
        s->count[j] = r->total[j];
        s->q[j] = loop->plant->rest[j] + r->total[j] * loop->rad_per_count[j];
        s->v[j] = mk_velocity_step(&r->speed[j], s->q[j]);
    }
    s->u = b->u_applied;
}

/* No reading: the row says so, the estimates go on. */
static void miss_reading(struct mk_loop *loop, struct mk_sample *s)
{
    struct mk_loop_run *r = &loop->run;
    s->flags |= MK_FLAG_LOST;
    count_up(&loop->lost, 1);
    r->lost_since++;
    mk_board_watch_miss(&r->watch, r->u_next);
    for (int j = 0; j < loop->plant->joints; j++) {
        s->q[j] = NAN;
        s->v[j] = mk_velocity_step(&r->speed[j], NAN);
        s->count[j] = r->total[j];
    }
    s->u = r->u_held; /* a command that got lost leaves the old one in force */
}

/* Faults that the exchange itself shows. */
static void check_link(struct mk_loop *loop, enum mk_status st, uint32_t board_status, double t)
{
    struct mk_safety *safety = &loop->safety;
    bool lost = st == MK_ERR_TIMEOUT || st == MK_ERR_PROTO;
    enum mk_fault fault = MK_FAULT_NONE;
    if (st == MK_ERR_NODEV)
        fault = MK_FAULT_UNPLUGGED;
    else if (st == MK_ERR_RANGE)
        fault = MK_FAULT_COMMAND;
    else if ((st != MK_OK && !lost) || (board_status & MK_BOARD_ST_FAULT))
        fault = MK_FAULT_BOARD;
    else if (board_status & MK_BOARD_ST_WATCHDOG)
        fault = MK_FAULT_WATCHDOG;
    mk_safety_latch(safety, fault, t, 0);
    mk_safety_link(safety, t, lost);
}

static void check_model(struct mk_loop *loop, const struct mk_sample *s)
{
    int joint = 0;
    loop->residual.balances = loop->run.shown.sample.phase == MK_PHASE_BALANCE;
    enum mk_fault fault =
        mk_residual_step(&loop->residual, s->t, loop->run.since_good, s->q, s->v, s->u, &joint);
    mk_safety_latch(&loop->safety, fault, s->t, joint);
}

static void exchange(struct mk_loop *loop, struct mk_sample *s)
{
    struct mk_loop_run *r = &loop->run;
    struct mk_board_sample b = {0};
    enum mk_status st;
    if (r->streaming)
        st = await_sample(loop, &b, s);
    else
        st = mk_board_exchange(loop->board, r->u_next, &b);
    place(loop, s);
    for (uint64_t k = 0; k < r->missed && k < EXTRAPOLATE_MAX; k++)
        for (int j = 0; j < loop->plant->joints; j++)
            mk_velocity_step(&r->speed[j], NAN);
    if (st == MK_OK)
        take_reading(loop, &b, s);
    else
        miss_reading(loop, s);
    r->u_held = s->u;
    r->since_good += loop->dt * (double)(1 + r->missed);
    check_link(loop, st, b.status, s->t);
    mk_safety_timing(&loop->safety, s->t, (s->flags & MK_FLAG_LATE) != 0);
    if (st == MK_OK) {
        mk_safety_check(&loop->safety, s->t, r->since_good, s->q, s->v, s->u);
        if (loop->has_rig)
            check_model(loop, s);
        r->since_good = 0.0;
    }
}

static void step_controller(struct mk_loop *loop, struct mk_sample *s)
{
    struct mk_loop_run *r = &loop->run;
    struct mk_ctrl_input in = {
        .t = s->t, .dt = loop->dt * (double)(1 + r->missed), .tick = s->tick, .u = s->u};
    for (int j = 0; j < loop->plant->joints; j++) {
        in.q[j] = isnan(s->q[j]) ? r->speed[j].q : s->q[j];
        in.v[j] = s->v[j];
    }
    struct mk_ctrl_output out = {.ref = NAN};
    mk_ctrl_step(loop->ctrl, &in, &out);
    s->ref = out.ref;
    s->phase = out.phase;
    if (!isfinite(out.u)) {
        mk_safety_latch(&loop->safety, MK_FAULT_COMMAND, s->t, 0);
        return;
    }
    double limit = loop->board->u_max, u = mk_residual_command(&loop->residual, out.u);
    if (fabs(u) > limit)
        s->flags |= MK_FLAG_SATURATED;
    r->u_next = fmax(-limit, fmin(limit, u));
}

static void follow_phase(struct mk_loop_snapshot *shown, const struct mk_sample *s)
{
    if (s->phase != MK_PHASE_BALANCE) {
        shown->balanced_since = NAN;
        return;
    }
    if (isnan(shown->balanced_since))
        shown->balanced_since = s->t;
    if (isnan(shown->caught_t))
        shown->caught_t = s->t;
}

static void hand_over(struct mk_loop *loop, const struct mk_sample *s)
{
    struct mk_loop_snapshot *shown = &loop->run.shown;
    count_up(&loop->ticks, 1);
    if (loop->writer.log) {
        struct mk_loop_record record = {
            .sample = *s, .fault = loop->safety.fault, .fault_joint = loop->safety.fault_joint};
        if (!mk_ring_push(loop->writer.samples, &record)) {
            count_up(&loop->dropped, 1);
            /* The writer has been standing still for the whole ring. */
            if (loop->safety.fault == MK_FAULT_NONE) {
                shown->at_fault = *s;
                mk_loop_trip(loop, MK_FAULT_LOG, s->t, 0);
            }
        }
    }
    if (loop->config.tap)
        (void)mk_ring_push(loop->config.tap, s);
    shown->state = loop->safety.fault ? MK_LOOP_FAULTED : MK_LOOP_RUNNING;
    shown->sample = *s;
    shown->ticks++;
    shown->late += (s->flags & MK_FLAG_LATE) != 0;
    shown->overruns += (s->flags & MK_FLAG_OVERRUN) != 0;
    shown->lost += (s->flags & MK_FLAG_LOST) != 0;
    follow_phase(shown, s);
    mk_loop_publish(loop);
}

/* After a fault: so many exchanges in a row have failed that there is nothing to be logged. */
static bool tells_nothing(const struct mk_loop *loop)
{
    return loop->safety.fault != MK_FAULT_NONE &&
           (int64_t)loop->run.lost_since >= loop->config.limits.lost_limit;
}

bool mk_loop_tick(struct mk_loop *loop)
{
    struct mk_loop_run *r = &loop->run;
    struct mk_sample s = {.ref = NAN};
    if (!r->streaming)
        await_deadline(loop, &s);
    place(loop, &s);
    bool was_well = loop->safety.fault == MK_FAULT_NONE;

    /* Reasons to stop that are known before the exchange: its command is already 0. */
    if (atomic_load_explicit(&loop->estop, memory_order_relaxed))
        mk_safety_latch(&loop->safety, MK_FAULT_ESTOP, s.t, 0);
    if (atomic_load_explicit(&loop->writer.status, memory_order_acquire) != MK_OK)
        mk_safety_latch(&loop->safety, MK_FAULT_LOG, s.t, 0);
    if (loop->safety.fault)
        r->u_next = 0.0;

    exchange(loop, &s);
    mk_loop_take_mail(loop, &s);
    if (!loop->safety.fault)
        step_controller(loop, &s);
    if (loop->safety.fault) {
        s.flags |= MK_FLAG_FAULT;
        s.phase = MK_PHASE_IDLE;
        r->u_next = 0.0;
        if (was_well) {
            r->shown.at_fault = s;
            mk_loop_trip(loop, loop->safety.fault, s.t, loop->safety.fault_joint);
            s.u = 0.0; /* the exchange's command lasted for microseconds */
        }
    }
    hand_over(loop, &s);
    mk_histogram_add(&loop->busy, mk_clock_now_ns(loop->board->clock) - r->begin_ns);
    r->tick++;
    return r->tick < r->end_tick && !tells_nothing(loop);
}

/* Before the first tick, so the one function here that is not RT: what it asks of the board may
 * fail with a message. */
enum mk_status mk_loop_begin_ticks(struct mk_loop *loop, struct mk_error *err)
{
    const struct mk_board_ops *ops = loop->board->ops;
    enum mk_status st = MK_OK;
    if (ops->set_watchdog)
        st = ops->set_watchdog(loop->board, loop->config.watchdog_ms, err);
    if (st == MK_OK && loop->config.stream) {
        st = ops->stream(loop->board, (uint32_t)lround(1e6 * loop->dt), err);
        loop->run.streaming = st == MK_OK;
    }
    mk_board_watch_reset(&loop->run.watch, loop->run.streaming, loop->config.limits.stale_limit);
    loop->run.t0_ns = mk_clock_now_ns(loop->board->clock);
    /* In real time the first sample gets a period to wake up properly. */
    if (!loop->simulated)
        loop->run.t0_ns += (int64_t)(1e9 * loop->dt);
    return st;
}

void mk_loop_end_ticks(struct mk_loop *loop)
{
    loop->run.shown.unconfirmed = loop->board->ops->safe_state(loop->board) != MK_OK;
    atomic_store_explicit(&loop->ended, true, memory_order_release);
}
