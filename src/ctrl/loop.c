/* The tick, and what the host thread may ask of a loop. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "ctrl/loop_priv.h"

#define TURN_RAD (2.0 * 3.14159265358979323846)

/* After a fault the run goes on for so long with the motor off, so that the log shows what the rig
 * did; a board that is gone or a log that cannot be written ends it at once. */
#define TAIL_S 0.2

/* How many skipped samples the speed estimators are told of one by one. */
#define EXTRAPOLATE_MAX 20u

/* --- the tick (RT) --------------------------------------------------------------------------- */

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
    (void)loop->board->ops->safe_state(loop->board);
    r->u_next = r->u_held = 0.0;
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
        s->flags |= MK_FLAG_OVERRUN;
        count_up(&loop->overruns, 1);
    }
    int64_t late_ns = now > deadline ? now - deadline : 0;
    if (r->missed > 0 || (double)late_ns > 0.5e9 * loop->dt) {
        s->flags |= MK_FLAG_LATE;
        count_up(&loop->late, 1);
    }
    s->tick = r->tick;
    s->t = (double)r->tick / loop->config.rate_hz;
    /* Of an overrun the whole delay is told, not what is left of it modulo the period. */
    double skipped_ns = (double)r->missed * 1e9 * loop->dt;
    s->late_us = ((double)late_ns + skipped_ns) / 1e3;
    mk_histogram_add(&loop->lateness, late_ns + (int64_t)skipped_ns);
}

/* Parameters change only here, all of them together. */
static void take_mail(struct mk_loop *loop, struct mk_sample *s)
{
    struct mk_ctrl *ctrl = loop->ctrl;
    if (!atomic_load_explicit(&loop->mail_waits, memory_order_acquire))
        return;
    memcpy(ctrl->value, loop->mail, sizeof ctrl->value);
    atomic_store_explicit(&loop->mail_waits, false, memory_order_release);
    if (ctrl->ops->changed)
        ctrl->ops->changed(ctrl);
    s->flags |= MK_FLAG_PARAMS;
    if (loop->writer.log) {
        struct mk_loop_change change = {.t = s->t};
        memcpy(change.value, ctrl->value, sizeof change.value);
        (void)mk_ring_push(loop->writer.changes, &change); /* the row's flag remains */
    }
}

/* A good reading: unwraps the counters and advances the speed estimates. */
static void take_reading(struct mk_loop *loop, const struct mk_board_sample *b, struct mk_sample *s)
{
    struct mk_loop_run *r = &loop->run;
    uint32_t step = b->sequence - r->sequence;
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

static void exchange(struct mk_loop *loop, struct mk_sample *s)
{
    struct mk_loop_run *r = &loop->run;
    struct mk_board_sample b = {0};
    for (uint64_t k = 0; k < r->missed && k < EXTRAPOLATE_MAX; k++)
        for (int j = 0; j < loop->plant->joints; j++)
            mk_velocity_step(&r->speed[j], NAN);

    enum mk_status st = mk_board_exchange(loop->board, r->u_next, &b);
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
    double limit = loop->board->u_max;
    if (fabs(out.u) > limit)
        s->flags |= MK_FLAG_SATURATED;
    r->u_next = fmax(-limit, fmin(limit, out.u));
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
            if (loop->safety.fault == MK_FAULT_NONE)
                mk_loop_trip(loop, MK_FAULT_LOG, s->t, 0);
        }
    }
    shown->state = loop->safety.fault ? MK_LOOP_FAULTED : MK_LOOP_RUNNING;
    shown->sample = *s;
    shown->ticks++;
    shown->late += (s->flags & MK_FLAG_LATE) != 0;
    shown->overruns += (s->flags & MK_FLAG_OVERRUN) != 0;
    shown->lost += (s->flags & MK_FLAG_LOST) != 0;
    follow_phase(shown, s);
    mk_loop_publish(loop);
}

bool mk_loop_tick(struct mk_loop *loop)
{
    struct mk_loop_run *r = &loop->run;
    struct mk_sample s = {.ref = NAN};
    await_deadline(loop, &s);
    int64_t begin_ns = mk_clock_now_ns(loop->board->clock);
    bool was_well = loop->safety.fault == MK_FAULT_NONE;

    /* Reasons to stop that are known before the exchange: its command is already 0. */
    if (atomic_load_explicit(&loop->estop, memory_order_relaxed))
        mk_safety_latch(&loop->safety, MK_FAULT_ESTOP, s.t, 0);
    if (atomic_load_explicit(&loop->writer.status, memory_order_acquire) != MK_OK)
        mk_safety_latch(&loop->safety, MK_FAULT_LOG, s.t, 0);
    if (loop->safety.fault)
        r->u_next = 0.0;

    exchange(loop, &s);
    take_mail(loop, &s);
    if (!loop->safety.fault)
        step_controller(loop, &s);
    if (loop->safety.fault) {
        s.flags |= MK_FLAG_FAULT;
        s.phase = MK_PHASE_IDLE;
        r->u_next = 0.0;
        if (was_well) {
            mk_loop_trip(loop, loop->safety.fault, s.t, loop->safety.fault_joint);
            s.u = 0.0; /* the exchange's command lasted for microseconds */
        }
    }
    hand_over(loop, &s);
    mk_histogram_add(&loop->busy, mk_clock_now_ns(loop->board->clock) - begin_ns);
    r->tick++;
    return r->tick < r->end_tick;
}

void mk_loop_begin_ticks(struct mk_loop *loop)
{
    loop->run.t0_ns = mk_clock_now_ns(loop->board->clock);
    /* In real time the first sample gets a period to wake up properly. */
    if (!loop->simulated)
        loop->run.t0_ns += (int64_t)(1e9 * loop->dt);
}

void mk_loop_end_ticks(struct mk_loop *loop)
{
    (void)loop->board->ops->safe_state(loop->board);
    atomic_store_explicit(&loop->ended, true, memory_order_release);
}

/* --- the host thread ------------------------------------------------------------------------- */

void mk_loop_config_default(const struct mk_model *model, struct mk_loop_config *out)
{
    memset(out, 0, sizeof *out);
    out->rate_hz = MK_LOOP_RATE_HZ;
    out->velocity.kind = MK_VELOCITY_TRACKING;
    out->velocity.accel_radps2 = 100.0;
    mk_safety_default(model, 1.0 / out->rate_hz, &out->limits);
    out->watchdog_ms = 20;
    out->priority = 80;
    out->ring_samples = 8192;
}

static enum mk_status prepare_joints(struct mk_loop *loop, struct mk_error *err)
{
    enum mk_status st = loop->board->ops->identify(loop->board, &loop->identity, err);
    if (st != MK_OK)
        return st;
    for (int j = 0; j < loop->plant->joints; j++) {
        int cpr = loop->identity.encoder_cpr[j];
        if (cpr <= 0)
            cpr = loop->ctrl->model.encoder_cpr[j];
        loop->identity.encoder_cpr[j] = cpr;
        loop->rad_per_count[j] = TURN_RAD / cpr;
        struct mk_velocity_config v = loop->config.velocity;
        v.dt_s = loop->dt;
        v.count_rad = loop->rad_per_count[j];
        st = mk_velocity_init(&loop->run.speed[j], &v);
        if (st != MK_OK)
            return mk_error_set(err, st, "the speed estimator's settings are not possible");
    }
    return MK_OK;
}

static enum mk_status check_config(const struct mk_ctrl *ctrl, const struct mk_loop_config *config,
                                   struct mk_error *err)
{
    if (!(config->rate_hz >= MK_LOOP_RATE_MIN_HZ && config->rate_hz <= MK_LOOP_RATE_MAX_HZ))
        return mk_error_set(err, MK_ERR_RANGE, "the rate is %g Hz, it must be %g .. %g",
                            config->rate_hz, MK_LOOP_RATE_MIN_HZ, MK_LOOP_RATE_MAX_HZ);
    if (fabs(ctrl->dt * config->rate_hz - 1.0) > 1e-9)
        return mk_error_set(err, MK_ERR_INVALID,
                            "the controller is made for %g s a sample, the loop for %g", ctrl->dt,
                            1.0 / config->rate_hz);
    return MK_OK;
}

enum mk_status mk_loop_create(struct mk_board *board, struct mk_ctrl *ctrl,
                              const struct mk_loop_config *config, struct mk_loop **out,
                              struct mk_error *err)
{
    *out = NULL;
    enum mk_status st = check_config(ctrl, config, err);
    if (st != MK_OK)
        return st;
    struct mk_loop *loop = calloc(1, sizeof *loop);
    if (!loop)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for the control loop");
    loop->board = board;
    loop->ctrl = ctrl;
    loop->config = *config;
    loop->config.limits.dt_s = 1.0 / config->rate_hz;
    loop->plant = mk_plant(ctrl->model.plant);
    loop->dt = 1.0 / config->rate_hz;
    loop->simulated = board->clock->ops->simulated;
    loop->host.dma_latency_fd = -1;
    mk_safety_init(&loop->safety, &ctrl->model, &loop->config.limits);
    mk_histogram_clear(&loop->lateness);
    mk_histogram_clear(&loop->busy);

    loop->published = malloc(sizeof *loop->published);
    st = loop->published ? MK_OK : mk_error_set(err, MK_ERR_NOMEM, "no memory for the loop");
    size_t ring = config->ring_samples ? config->ring_samples : 8192;
    if (st == MK_OK)
        st = mk_ring_create(ring, sizeof(struct mk_loop_record), &loop->writer.samples);
    if (st == MK_OK)
        st = mk_ring_create(256, sizeof(struct mk_loop_change), &loop->writer.changes);
    if (st == MK_OK)
        st = prepare_joints(loop, err);
    else
        mk_error_set(err, st, "no memory for the control loop");
    if (st != MK_OK) {
        mk_loop_destroy(loop);
        return st;
    }
    mk_publish_init(loop->published);
    loop->run.shown = (struct mk_loop_snapshot){.balanced_since = NAN, .caught_t = NAN};
    mk_loop_publish(loop);
    *out = loop;
    return MK_OK;
}

/* Motor off, ticks ended, log closed. */
static enum mk_status end_run(struct mk_loop *loop, struct mk_error *err)
{
    if (!loop->host.running)
        return MK_OK;
    atomic_store_explicit(&loop->stop, true, memory_order_relaxed);
    if (loop->simulated)
        mk_loop_end_ticks(loop);
    else
        mk_loop_thread_join(loop);
    loop->host.running = false;
    enum mk_status st = mk_loop_writer_finish(loop, err);

    /* The thread is gone: its side of the snapshot is ours. */
    struct mk_loop_snapshot *shown = &loop->run.shown;
    shown->state = loop->safety.fault ? MK_LOOP_FAULTED : MK_LOOP_IDLE;
    shown->sample.u = 0.0;
    shown->sample.phase = MK_PHASE_IDLE;
    shown->balanced_since = NAN;
    mk_loop_publish(loop);
    /* Parameters that came too late for a sample hold from the next start. */
    if (atomic_load_explicit(&loop->mail_waits, memory_order_acquire)) {
        struct mk_sample none = {0};
        take_mail(loop, &none);
    }
    return st;
}

void mk_loop_destroy(struct mk_loop *loop)
{
    if (!loop)
        return;
    end_run(loop, NULL);
    mk_loop_thread_release(loop);
    mk_ring_destroy(loop->writer.samples);
    mk_ring_destroy(loop->writer.changes);
    free(loop->published);
    free(loop);
}

enum mk_status mk_loop_halt(struct mk_loop *loop, struct mk_error *err)
{
    return end_run(loop, err);
}

enum mk_status mk_loop_fault_error(enum mk_fault fault, double t, int joint, struct mk_error *err)
{
    char where[24] = "";
    if (joint > 0)
        snprintf(where, sizeof where, ", joint %d", joint);
    return mk_error_set(err, MK_ERR_FAULT, "fault %s at %.4g s%s: %s", mk_fault_name(fault), t,
                        where, mk_fault_text(fault));
}

static enum mk_status fault_of(const struct mk_loop_snapshot *s, struct mk_error *err)
{
    return mk_loop_fault_error(s->fault, s->fault_t, s->fault_joint, err);
}

static bool cancelled(const volatile int *cancel)
{
    return cancel && *cancel;
}

/* Simulated time: the waiting thread makes the samples itself. */
static enum mk_status wait_simulated(struct mk_loop *loop, double seconds,
                                     bool (*until)(const struct mk_loop_snapshot *, void *),
                                     void *user, const volatile int *cancel, struct mk_error *err)
{
    struct mk_loop_run *r = &loop->run;
    uint64_t last = r->tick + (uint64_t)ceil(seconds * loop->config.rate_hz - 1e-6);
    size_t full = mk_ring_capacity(loop->writer.samples) / 2;
    while (r->tick < last || r->shown.fault) {
        if (cancelled(cancel))
            return mk_error_set(err, MK_ERR_INTR, "interrupted");
        bool more = mk_loop_tick(loop);
        if (!more || mk_ring_count(loop->writer.samples) >= full)
            mk_loop_writer_drain(&loop->writer);
        if (!more) {
            mk_loop_end_ticks(loop);
            return fault_of(&r->shown, err);
        }
        if (until && !r->shown.fault && until(&r->shown, user))
            return MK_OK;
    }
    mk_loop_writer_drain(&loop->writer);
    return until ? mk_error_set(err, MK_ERR_TIMEOUT, "not within %g s", seconds) : MK_OK;
}

static void nap(long ns)
{
    const struct timespec ts = {.tv_nsec = ns};
    nanosleep(&ts, NULL);
}

/* Real time: looks at the newest sample every 2 ms. */
static enum mk_status wait_realtime(struct mk_loop *loop, double seconds,
                                    bool (*until)(const struct mk_loop_snapshot *, void *),
                                    void *user, const volatile int *cancel, struct mk_error *err)
{
    struct mk_loop_snapshot s;
    mk_loop_get_snapshot(loop, &s);
    uint64_t seen = s.ticks;
    double end_t = (s.ticks ? s.sample.t : 0.0) + seconds;
    for (;;) {
        if (cancelled(cancel))
            return mk_error_set(err, MK_ERR_INTR, "interrupted");
        bool ended = atomic_load_explicit(&loop->ended, memory_order_acquire);
        mk_loop_get_snapshot(loop, &s);
        if (ended)
            return s.fault ? fault_of(&s, err) : MK_OK;
        if (until && s.ticks != seen && !s.fault && until(&s, user))
            return MK_OK;
        if (s.ticks && s.sample.t >= end_t && !s.fault)
            break;
        seen = s.ticks;
        nap(2000000);
    }
    return until ? mk_error_set(err, MK_ERR_TIMEOUT, "not within %g s", seconds) : MK_OK;
}

/* No run: time passes all the same, and the virtual rig goes on. */
static enum mk_status wait_idle(struct mk_loop *loop, double seconds, const volatile int *cancel,
                                struct mk_error *err)
{
    struct mk_clock *clock = loop->board->clock;
    int64_t end_ns = mk_clock_now_ns(clock) + (int64_t)(seconds * 1e9);
    if (loop->simulated)
        mk_clock_sleep_until(clock, end_ns);
    while (mk_clock_now_ns(clock) < end_ns) {
        if (cancelled(cancel))
            return mk_error_set(err, MK_ERR_INTR, "interrupted");
        nap(2000000);
    }
    return MK_OK;
}

enum mk_status mk_loop_wait(struct mk_loop *loop, double seconds,
                            bool (*until)(const struct mk_loop_snapshot *, void *), void *user,
                            const volatile int *cancel, struct mk_error *err)
{
    struct mk_loop_snapshot s;
    mk_loop_get_snapshot(loop, &s);
    if (!(seconds >= 0.0 && seconds <= 1e7))
        return mk_error_set(err, MK_ERR_RANGE, "cannot wait %g s", seconds);
    if (loop->host.running && !atomic_load_explicit(&loop->ended, memory_order_acquire))
        return loop->simulated ? wait_simulated(loop, seconds, until, user, cancel, err)
                               : wait_realtime(loop, seconds, until, user, cancel, err);
    if (s.state == MK_LOOP_FAULTED)
        return fault_of(&s, err);
    enum mk_status st = wait_idle(loop, seconds, cancel, err);
    if (st == MK_OK && until)
        return mk_error_set(err, MK_ERR_TIMEOUT, "nothing runs that could fulfil the condition");
    return st;
}

/* The loop takes its mail once a sample; a slow sample is waited for. */
static bool mailbox_is_free(struct mk_loop *loop)
{
    for (int k = 0; k < 50; k++) {
        if (!atomic_load_explicit(&loop->mail_waits, memory_order_acquire) ||
            atomic_load_explicit(&loop->ended, memory_order_acquire))
            return true;
        nap(1000000);
    }
    return false;
}

enum mk_status mk_loop_set_params(struct mk_loop *loop, const double *value, int count,
                                  struct mk_error *err)
{
    const struct mk_ctrl_ops *ops = loop->ctrl->ops;
    if (count != ops->param_count)
        return mk_error_set(err, MK_ERR_INVALID, "setup %s has %d parameters, not %d", ops->name,
                            ops->param_count, count);
    for (int i = 0; i < count; i++) {
        enum mk_status st = mk_ctrl_check(ops, i, value[i], err);
        if (st != MK_OK)
            return st;
    }
    /* With simulated time the last ones have not been looked at, so they may be replaced. */
    if (loop->host.running && !loop->simulated && !mailbox_is_free(loop))
        return mk_error_set(err, MK_ERR_BUSY, "the loop has not taken the last parameters yet");
    memcpy(loop->mail, value, sizeof *value * (size_t)count);
    if (loop->host.running) {
        atomic_store_explicit(&loop->mail_waits, true, memory_order_release);
        return MK_OK;
    }
    memcpy(loop->ctrl->value, loop->mail, sizeof loop->ctrl->value);
    if (ops->changed)
        ops->changed(loop->ctrl);
    return MK_OK;
}

void mk_loop_get_snapshot(const struct mk_loop *loop, struct mk_loop_snapshot *out)
{
    *out = *mk_publish_get(loop->published);
    /* A stop pressed while nothing runs is a fault at once. */
    bool pressed = atomic_load_explicit(&loop->estop, memory_order_relaxed);
    if (!loop->host.running && pressed && !out->fault) {
        out->state = MK_LOOP_FAULTED;
        out->fault = MK_FAULT_ESTOP;
    }
}

void mk_loop_estop(struct mk_loop *loop)
{
    atomic_store_explicit(&loop->estop, true, memory_order_relaxed);
}

void mk_loop_acknowledge(struct mk_loop *loop)
{
    /* A fault while the tail is still being logged: end the run first. */
    if (loop->host.running && mk_publish_get(loop->published)->fault)
        end_run(loop, NULL);
    if (loop->host.running)
        return;
    /* After these the counters cannot be trusted any more. */
    switch (loop->safety.fault) {
    case MK_FAULT_JUMP:
    case MK_FAULT_STUCK:
    case MK_FAULT_RUNAWAY:
    case MK_FAULT_LINK:
    case MK_FAULT_UNPLUGGED:
    case MK_FAULT_BOARD:
        loop->host.zeroed = false;
        break;
    default:
        break;
    }
    atomic_store_explicit(&loop->estop, false, memory_order_relaxed);
    mk_safety_clear(&loop->safety);
    loop->run.shown.state = MK_LOOP_IDLE;
    mk_loop_publish(loop);
}
