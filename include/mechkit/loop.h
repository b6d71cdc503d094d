/* The control loop: one tick = exchange with the board, estimate speeds, check safety, step the
 * controller, publish the sample. In real time the ticks run in a thread of their own (SCHED_FIFO
 * and locked memory when permitted) on absolute deadlines; on a simulated clock the same ticks run
 * in the caller's thread as fast as they go. The tick allocates, locks and prints nothing; samples
 * leave through a ring to the writer, which is a thread in real time and the caller in simulated
 * time.
 *
 * States:  idle --start--> running --halt--> idle
 *                             |--fault--> faulted --acknowledge--> idle
 * In every state but running the command is zero.
 *
 * All functions are for one host thread; none is RT.
 */
#ifndef MECHKIT_LOOP_H
#define MECHKIT_LOOP_H

#include <stdbool.h>
#include <stdint.h>

#include "mechkit/board.h"
#include "mechkit/ctrl.h"
#include "mechkit/log.h"
#include "mechkit/ring.h"
#include "mechkit/safety.h"
#include "mechkit/velocity.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

#define MK_LOOP_RATE_MIN_HZ 100.0
#define MK_LOOP_RATE_MAX_HZ 2000.0
#define MK_LOOP_RATE_HZ 500.0
#define MK_LOOP_WAIT_MAX_S 1e7

enum mk_sample_flag {                   /* column `flags` of the log */
                      MK_FLAG_LATE = 1, /* woke more than half a period after its deadline */
                      MK_FLAG_OVERRUN =
                          2, /* the deadline of the next sample had already passed: skipped ones */
                      MK_FLAG_LOST = 4,       /* the exchange failed: no reading in this row */
                      MK_FLAG_GAP = 8,        /* the board's sequence number jumped */
                      MK_FLAG_SATURATED = 16, /* the wish was beyond u_max */
                      MK_FLAG_PARAMS = 32,    /* new parameters took effect at this sample */
                      MK_FLAG_FAULT = 64,     /* a fault is latched */
                      MK_FLAG_SIGNAL = 128    /* another signal took effect at this sample */
};

struct mk_sample { /* one row of the log */
    uint64_t tick;
    double t;
    double q[MK_MAX_JOINTS], v[MK_MAX_JOINTS];
    int32_t count[MK_MAX_JOINTS]; /* unwrapped */
    double u, ref;
    double late_us;
    enum mk_phase phase;
    uint32_t flags;
};

enum mk_loop_state { MK_LOOP_IDLE, MK_LOOP_RUNNING, MK_LOOP_FAULTED };

struct mk_loop_config {
    double rate_hz;
    /* dt, count filled in by the loop; the acceleration in rad/s^2, of a slide times its scale */
    struct mk_velocity_config velocity;
    struct mk_safety_limits limits; /* made for their dt_s; fitted to the loop's */
    unsigned watchdog_ms;           /* default 20 */
    int priority;                   /* SCHED_FIFO priority, default 80; 0: do not ask */
    size_t ring_samples;            /* default 8192 */
    /* Every sample (struct mk_sample) is pushed here too, for somebody who watches; what does not
     * fit is left out. NULL: nobody. Kept, not owned. */
    struct mk_ring *tap;
    /* The board's clock makes the ticks, where the board can (mk_board_ops.stream); the period must
     * be whole microseconds. After a fault, for the rest of the log, the host's does. */
    bool stream;
    /* The counters read 0 where the links hang: an earlier loop on this board has found that
     * (mk_loop_is_zeroed). The first start keeps this zero, as later ones do. */
    bool zeroed;
    /* The start gives up when it becomes true, MK_ERR_INTR; NULL: never. Kept, not owned. */
    const volatile int *cancel;
};
/* The values above that are said to be a default, speeds by a tracking observer, and the limits of
 * mk_safety_default at MK_LOOP_RATE_HZ. */
void mk_loop_config_default(const struct mk_model *model, struct mk_loop_config *out);

struct mk_loop_stats {
    uint64_t ticks, late, overruns, lost, gaps, dropped; /* dropped: ring full; 0 in a good run */
    double late_p50_us, late_p99_us, late_p999_us, late_max_us;
    double busy_mean_us, busy_max_us; /* time a tick takes */
    bool realtime;                    /* SCHED_FIFO was granted */
    bool memory_locked;
    char note[160]; /* why not, and what to do; "" when all was granted */
};

struct mk_loop_snapshot {
    enum mk_loop_state state;
    struct mk_sample sample; /* the newest */
    enum mk_fault fault;
    double fault_t;
    int fault_joint;
    struct mk_sample at_fault; /* the sample that tripped it; a fault of the start has none */
    bool unconfirmed;          /* the board has not answered that its motor is off then */
    uint64_t ticks, late, overruns, lost;
    double balanced_since; /* s; NAN when not balancing now */
    double caught_t;       /* s; first time of BALANCE in this run, NAN: never */
};

struct mk_loop;

/* Keeps board and ctrl (not owned). MK_ERR_RANGE (rate), MK_ERR_NOTSUP (stream), MK_ERR_NOMEM. */
MK_NODISCARD enum mk_status mk_loop_create(struct mk_board *board, struct mk_ctrl *ctrl,
                                           const struct mk_loop_config *config,
                                           struct mk_loop **out, struct mk_error *err);
/* Halts first. NULL allowed. */
void mk_loop_destroy(struct mk_loop *loop);

/* Checks that the links hang (fault NOT_HANGING), opens the log (NULL: none), starts the ticks.
 * MK_ERR_STATE when running or faulted, MK_ERR_FAULT when a check fails. */
MK_NODISCARD enum mk_status mk_loop_start(struct mk_loop *loop, const char *log_path,
                                          const struct mk_log_meta *meta, size_t meta_count,
                                          struct mk_error *err);
/* Motor off, ticks ended, log complete and closed. MK_OK also when idle. MK_ERR_NOSPACE or
 * MK_ERR_IO when the log could not be completed (the motor is off all the same); MK_ERR_IO too when
 * the board has not answered that the motor is off, with a log that is complete. */
MK_NODISCARD enum mk_status mk_loop_halt(struct mk_loop *loop, struct mk_error *err);

/* Lets the run go on for `seconds` of its own time, or until `until` (may be NULL) returns true for
 * a snapshot. Returns MK_OK (condition met, or time over without one), MK_ERR_TIMEOUT (time over,
 * condition not met), MK_ERR_FAULT (a fault ended the run), MK_ERR_INTR (*cancel became true;
 * may be NULL). */
MK_NODISCARD enum mk_status mk_loop_wait(struct mk_loop *loop, double seconds,
                                         bool (*until)(const struct mk_loop_snapshot *, void *),
                                         void *user, const volatile int *cancel,
                                         struct mk_error *err);

/* Hands all parameters to the loop; they take effect together between two samples. At once when not
 * running. MK_ERR_RANGE names the parameter. MK_ERR_BUSY: the last ones are not taken yet. */
MK_NODISCARD enum mk_status mk_loop_set_params(struct mk_loop *loop, const double *value, int count,
                                               struct mk_error *err);

/* Hands another reference or open-loop signal (NULL: none) to the loop, in place of the
 * controller's `ref`; it takes effect between two samples and sees the time since the start of the
 * run. At once when not running. Borrowed: this one and the ones before it must live until the run
 * has been halted. MK_ERR_BUSY: what was handed in last is not taken yet. */
MK_NODISCARD enum mk_status mk_loop_set_signal(struct mk_loop *loop, const struct mk_signal *signal,
                                               struct mk_error *err);

/* The last sample, as a whole and at any time; one thread may ask. An emergency stop that was
 * pressed while nothing runs shows at once. */
void mk_loop_get_snapshot(const struct mk_loop *loop, struct mk_loop_snapshot *out);
/* What the ticks of the last run were like so far; counters are read one by one while it goes on.
 */
void mk_loop_get_stats(const struct mk_loop *loop, struct mk_loop_stats *out);
/* A start has zeroed the counters where the links hang, and no fault has put them in doubt since.
 */
bool mk_loop_is_zeroed(const struct mk_loop *loop);
/* Operator's stop: zero torque, fault E-STOP. Async-signal-safe. */
void mk_loop_estop(struct mk_loop *loop);
/* Clears a latched fault. */
void mk_loop_acknowledge(struct mk_loop *loop);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
