#include "watch.h"

#include <math.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>

void violate(struct violation *v, const char *fmt, ...)
{
    va_list args;
    if (v->seen)
        return;
    v->seen = true;
    va_start(args, fmt);
    vsnprintf(v->text, sizeof v->text, fmt, args);
    va_end(args);
}

/* --- the board ------------------------------------------------------------------------------ */

/* A back end has no place for a context of its own: there is one watched session. */
static struct {
    const struct mk_board_ops *board;
    struct mk_board_ops ops;
    struct session *session;
    struct violation *violation;
    atomic_bool on;
    atomic_bool not_allowed; /* the motor was driven while the loop did not run */
    atomic_bool too_much;
} watched;

static enum mk_status exchange(struct mk_board *board, double u, struct mk_board_sample *out)
{
    struct mk_loop_snapshot snap;
    if (!(fabs(u) <= board->u_max))
        atomic_store(&watched.too_much, true);
    if (u != 0.0 && watched.session->loop) {
        mk_loop_get_snapshot(watched.session->loop, &snap);
        /* The tick that sees a fault publishes it afterwards: the next one must be quiet. */
        if (snap.state == MK_LOOP_FAULTED)
            atomic_store(&watched.not_allowed, true);
    }
    enum mk_status st = watched.board->exchange(board, u, out);
    atomic_store(&watched.on, u != 0.0);
    return st;
}

static enum mk_status safe_state(struct mk_board *board)
{
    enum mk_status st = watched.board->safe_state(board);
    atomic_store(&watched.on, false);
    return st;
}

static void close_board(struct mk_board *board)
{
    if (atomic_load(&watched.on))
        violate(watched.violation, "the board was closed with the motor on");
    watched.board->close(board);
}

void watch_session(struct session *s, struct violation *v)
{
    watched.board = mk_board_backend_by_name("virtual");
    watched.ops = *watched.board;
    watched.ops.exchange = exchange;
    watched.ops.safe_state = safe_state;
    watched.ops.close = close_board;
    watched.session = s;
    watched.violation = v;
    atomic_store(&watched.on, false);
    atomic_store(&watched.not_allowed, false);
    atomic_store(&watched.too_much, false);
    s->backend = &watched.ops;
}

bool watch_motor_on(void)
{
    return atomic_load(&watched.on);
}

void watch_check(struct session *s, struct violation *v, const char *when)
{
    struct mk_loop_snapshot snap = {.state = MK_LOOP_IDLE};
    if (s->loop)
        mk_loop_get_snapshot(s->loop, &snap);
    if (snap.state != MK_LOOP_RUNNING && watch_motor_on())
        violate(v, "%s: the motor is on and the loop does not run", when);
    if (atomic_load(&watched.not_allowed))
        violate(v, "%s: the motor was driven after a fault", when);
    if (atomic_load(&watched.too_much))
        violate(v, "%s: a command beyond the limit, or none at all, reached the board", when);
}

/* --- the clock ------------------------------------------------------------------------------ */

static _Atomic int64_t ahead_ns; /* of the machine's monotonic clock; only grows */

static int64_t now_ns(const struct mk_clock *clock)
{
    struct mk_clock machine;
    (void)clock;
    mk_clock_init_monotonic(&machine);
    return machine.ops->now_ns(&machine) + atomic_load(&ahead_ns);
}

static void sleep_until(struct mk_clock *clock, int64_t deadline_ns)
{
    struct mk_clock machine;
    (void)clock;
    mk_clock_init_monotonic(&machine);
    machine.ops->sleep_until(&machine, deadline_ns - atomic_load(&ahead_ns));
}

void watch_clock(struct session *s)
{
    static const struct mk_clock_ops stepped = {
        .name = "stepped", .simulated = false, .now_ns = now_ns, .sleep_until = sleep_until};
    s->clock.ops = &stepped;
}

void watch_step_clock(double seconds)
{
    atomic_fetch_add(&ahead_ns, (int64_t)(seconds * 1e9));
}
