/* What the host thread may ask of a loop. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "ctrl/loop_priv.h"

#define TURN_RAD (2.0 * 3.14159265358979323846)

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
        const struct mk_model *model = &loop->ctrl->model;
        int cpr = loop->identity.encoder_cpr[j];
        if (cpr <= 0 || model->encoder_cpr[j] == 0)
            cpr = model->encoder_cpr[j];
        loop->identity.encoder_cpr[j] = cpr;
        loop->rad_per_count[j] = cpr > 0 ? TURN_RAD / cpr : mk_model_count(model, j);
        struct mk_velocity_config v = loop->config.velocity;
        v.dt_s = loop->dt;
        v.count_rad = loop->rad_per_count[j];
        v.accel_radps2 *= mk_model_joint_scale(model, j);
        st = mk_velocity_init(&loop->run.speed[j], &v);
        if (st != MK_OK)
            return mk_error_set(err, st, "the speed estimator's settings are not possible");
    }
    return MK_OK;
}

static enum mk_status check_stream(const struct mk_board *board, double rate_hz,
                                   struct mk_error *err)
{
    double period_us = 1e6 / rate_hz;
    if (!board->ops->stream)
        return mk_error_set(err, MK_ERR_NOTSUP, "board %s does not sample by its own clock",
                            board->ops->name);
    if (fabs(period_us - round(period_us)) > 1e-6)
        return mk_error_set(err, MK_ERR_RANGE,
                            "a board's clock makes whole microseconds: %g Hz is not possible, "
                            "%g Hz is",
                            rate_hz, 1e6 / round(period_us));
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

/* Limits that were made for another sample time: in a longer one a joint goes further. */
static void fit_limits(struct mk_safety_limits *limits, double dt)
{
    for (int j = 0; j < MK_MAX_JOINTS && limits->dt_s > 0.0; j++)
        limits->jump_rad[j] *= dt / limits->dt_s;
    limits->dt_s = dt;
}

enum mk_status mk_loop_create(struct mk_board *board, struct mk_ctrl *ctrl,
                              const struct mk_loop_config *config, struct mk_loop **out,
                              struct mk_error *err)
{
    *out = NULL;
    enum mk_status st = check_config(ctrl, config, err);
    if (st == MK_OK && config->stream)
        st = check_stream(board, config->rate_hz, err);
    if (st != MK_OK)
        return st;
    struct mk_loop *loop = calloc(1, sizeof *loop);
    if (!loop)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for the control loop");
    loop->board = board;
    loop->ctrl = ctrl;
    loop->config = *config;
    fit_limits(&loop->config.limits, 1.0 / config->rate_hz);
    loop->plant = mk_plant(ctrl->model.plant);
    loop->dt = 1.0 / config->rate_hz;
    loop->simulated = board->clock->ops->simulated;
    loop->host.dma_latency_fd = -1;
    loop->host.zeroed = config->zeroed;
    loop->has_rig = !(board->ops->capabilities & MK_BOARD_CAP_NO_RIG);
    mk_safety_init(&loop->safety, &ctrl->model, &loop->config.limits);
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
    /* The thread is gone: its side of the snapshot is ours. */
    struct mk_loop_snapshot *shown = &loop->run.shown;
    /* A stop that no sample has seen any more. */
    if (atomic_load_explicit(&loop->estop, memory_order_relaxed))
        mk_safety_latch(&loop->safety, MK_FAULT_ESTOP, shown->sample.t, 0);
    enum mk_status st = mk_loop_writer_finish(loop, err);

    shown->state = loop->safety.fault ? MK_LOOP_FAULTED : MK_LOOP_IDLE;
    shown->sample.u = 0.0;
    shown->sample.phase = MK_PHASE_IDLE;
    shown->balanced_since = NAN;
    mk_loop_publish(loop);
    /* Parameters that came too late for a sample hold from the next start. */
    if (atomic_load_explicit(&loop->mail_waits, memory_order_acquire)) {
        struct mk_sample none = {0};
        mk_loop_take_mail(loop, &none);
    }
    if (st == MK_OK && shown->unconfirmed && !shown->fault)
        return mk_error_set(err, MK_ERR_IO,
                            "the board has not confirmed that the motor is off, and its watchdog "
                            "has to see to that; the log is complete");
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
    return cancel && __atomic_load_n(cancel, __ATOMIC_RELAXED);
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
    struct mk_loop_snapshot s = *mk_publish_get(loop->published);
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
    if (!(seconds >= 0.0 && seconds <= MK_LOOP_WAIT_MAX_S))
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

/* Mail may be put in; it holds what is in force. With simulated time mail that waits has not been
 * looked at, so it may be changed. */
static enum mk_status open_mailbox(struct mk_loop *loop, struct mk_error *err)
{
    if (!loop->simulated && !mailbox_is_free(loop))
        return mk_error_set(err, MK_ERR_BUSY, "the loop has not taken the last change yet");
    return MK_OK;
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
    if (!loop->host.running) {
        memcpy(loop->ctrl->value, value, sizeof *value * (size_t)count);
        if (ops->changed)
            ops->changed(loop->ctrl);
        return MK_OK;
    }
    enum mk_status st = open_mailbox(loop, err);
    if (st != MK_OK)
        return st;
    memcpy(loop->mail.value, value, sizeof *value * (size_t)count);
    atomic_store_explicit(&loop->mail_waits, true, memory_order_release);
    return MK_OK;
}

enum mk_status mk_loop_set_signal(struct mk_loop *loop, const struct mk_signal *signal,
                                  struct mk_error *err)
{
    if (!loop->host.running) {
        loop->ctrl->ref = signal;
        return MK_OK;
    }
    enum mk_status st = open_mailbox(loop, err);
    if (st != MK_OK)
        return st;
    loop->mail.signal = signal;
    atomic_store_explicit(&loop->mail_waits, true, memory_order_release);
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

bool mk_loop_is_zeroed(const struct mk_loop *loop)
{
    return loop->host.zeroed;
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
    case MK_FAULT_DISOBEYED:
    case MK_FAULT_STALE:
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
