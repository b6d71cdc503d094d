/* The control loop from inside. loop_tick.c is the tick; loop.c what the host thread calls;
 * loop_start.c what comes before the first tick; loop_thread.c the real-time thread; loop_writer.c
 * the way of samples into the log; loop_stats.c the figures.
 *
 * Who may touch what while a run goes on in real time:
 *   - `run` and everything it reaches belongs to the loop thread;
 *   - the mailbox, the published snapshot, the histogram and the flags are the only doors;
 *   - `host` belongs to the thread that calls the public functions.
 * On a simulated clock the host thread is the loop thread.
 */
#ifndef MECHKIT_CTRL_LOOP_PRIV_H
#define MECHKIT_CTRL_LOOP_PRIV_H

#include <pthread.h>
#include <semaphore.h>
#include <stdatomic.h>

#include "ctrl/board_watch.h"
#include "ctrl/residual.h"
#include "mechkit/loop.h"
#include "mechkit/ring.h"

/* --- figures: loop_stats.c ------------------------------------------------------------------- */

/* Times in bins that grow with the value: 32 a factor of two, so a percentile is within 3 %. One
 * writer; readers see each bin whole. */
#define MK_HISTOGRAM_SUB_BITS 5
#define MK_HISTOGRAM_BINS ((40 - MK_HISTOGRAM_SUB_BITS + 1) << MK_HISTOGRAM_SUB_BITS)
struct mk_histogram {
    atomic_uint bin[MK_HISTOGRAM_BINS];
    atomic_ullong max_ns;
    atomic_ullong sum_ns;
    atomic_ullong count;
};
void mk_histogram_clear(struct mk_histogram *h);
void mk_histogram_add(struct mk_histogram *h, int64_t ns); /* RT; one writer */
/* Upper edge of the bin in which the fraction `p` of all values is reached, us; 0 when empty. */
double mk_histogram_percentile_us(const struct mk_histogram *h, double p);
double mk_histogram_mean_us(const struct mk_histogram *h);
double mk_histogram_max_us(const struct mk_histogram *h);

/* --- publication: loop_stats.c --------------------------------------------------------------- */

/* Newest value from one writer to one reader, neither ever waiting: three slots, of which each side
 * owns one and the third changes hands by an atomic exchange. */
struct mk_publish {
    struct mk_loop_snapshot slot[3];
    atomic_uint middle;   /* index of the free slot; bit 2: it is newer than the reader's */
    unsigned back, front; /* writer's, reader's */
};
void mk_publish_init(struct mk_publish *p);
void mk_publish_put(struct mk_publish *p, const struct mk_loop_snapshot *value); /* RT */
const struct mk_loop_snapshot *mk_publish_get(struct mk_publish *p);

/* --- the log of a run: loop_writer.c --------------------------------------------------------- */

struct mk_loop_record { /* what goes through the ring */
    struct mk_sample sample;
    enum mk_fault fault;
    int fault_joint;
};
struct mk_loop_mail { /* what the controller is to go by */
    double value[MK_CTRL_MAX_PARAMS];
    const struct mk_signal *signal; /* lives until the run has been halted */
};
struct mk_loop_change { /* what took effect at `t`; of the flags those that say which of it */
    double t;
    uint32_t flags;
    struct mk_loop_mail now;
};

struct mk_loop_writer {
    struct mk_log_writer *log; /* NULL: the run is not logged, samples are thrown away */
    struct mk_ring *samples;
    struct mk_ring *changes;
    struct mk_loop_change next; /* the first of the changes whose row has not come yet, */
    bool next_waits;            /* if there is one */
    const struct mk_ctrl_ops *setup;
    int joints;
    bool fault_noted;
    pthread_t thread;
    bool threaded;
    atomic_bool stop;
    atomic_int status; /* enum mk_status of the log; the loop looks at it every tick */
};
/* Opens the log with all that the run is made of. */
enum mk_status mk_loop_writer_open(struct mk_loop *loop, const char *path,
                                   const struct mk_log_meta *meta, size_t meta_count,
                                   struct mk_error *err);
/* Starts the thread that drains the ring (real time only). */
enum mk_status mk_loop_writer_spawn(struct mk_loop_writer *w, struct mk_error *err);
/* Writes all that waits in the ring. */
void mk_loop_writer_drain(struct mk_loop_writer *w);
/* Ends the thread, drains, appends the summary, closes. Reports the first failure of the run. */
enum mk_status mk_loop_writer_finish(struct mk_loop *loop, struct mk_error *err);

/* --- the loop -------------------------------------------------------------------------------- */

struct mk_loop_run {   /* the loop thread's */
    uint64_t tick;     /* of the sample being made */
    int64_t t0_ns;     /* deadline of tick 0 */
    uint64_t end_tick; /* first tick that is not made: UINT64_MAX until a fault sets the tail */
    double u_next;     /* command for the next exchange */
    double u_held;     /* command in force, as far as is known */
    int lost_since;    /* exchanges lost since the last good one */
    uint64_t missed;   /* ticks skipped just now */
    bool streaming;    /* the board's clock makes the ticks */
    bool timed;        /* one of its samples has come, so that the next two are known */
    int64_t zero_ns;   /* board's clock at tick 0 */
    int64_t ahead_ns;  /* host's clock minus the board's, as of the fastest sample */
    int64_t begin_ns;  /* when the work of this tick began */
    double since_good; /* s since the last good sample */
    uint32_t sequence;
    struct mk_board_watch watch;
    int32_t raw[MK_MAX_JOINTS];   /* counter as read last */
    int32_t total[MK_MAX_JOINTS]; /* counts from the zero of this run, unwrapped */
    struct mk_velocity speed[MK_MAX_JOINTS];
    struct mk_loop_snapshot shown; /* state published after each tick */
};

struct mk_loop {
    struct mk_board *board;
    struct mk_ctrl *ctrl;
    struct mk_loop_config config;
    const struct mk_plant_info *plant;
    struct mk_board_identity identity;
    double dt;
    double rad_per_count[MK_MAX_JOINTS];
    bool simulated;

    struct mk_safety safety; /* the loop thread's while running */
    struct mk_residual residual;
    bool has_rig; /* the board's counters are of something that moves */
    struct mk_loop_run run;

    /* Doors between the threads. */
    atomic_bool stop;         /* host: end the run */
    atomic_bool ended;        /* loop: no more ticks will come */
    atomic_bool estop;        /* anybody, a signal handler included */
    atomic_bool mail_waits;   /* host sets, loop clears */
    struct mk_loop_mail mail; /* the host's while mail_waits is false */
    struct mk_publish *published;
    atomic_ullong late, overruns, lost, gaps, dropped, ticks;
    struct mk_histogram lateness, busy;

    struct {          /* the host thread's */
        bool running; /* between start and halt */
        bool zeroed;  /* the counters have been zeroed at a hanging rest */
        bool realtime, memory_locked;
        char note[160];
        int dma_latency_fd;
        pthread_t thread;
        sem_t ready, go;
        bool abandoned;  /* go without running */
        int sched_error; /* errno of asking for SCHED_FIFO */
        enum mk_status prologue;
        struct mk_error prologue_error;
    } host;
    struct mk_loop_writer writer;
};

/* Waits for the next deadline and makes one sample. False: the run is over. RT. */
bool mk_loop_tick(struct mk_loop *loop);
/* Watchdog set, board's clock started or the first deadline set. Before the first tick: not RT. */
enum mk_status mk_loop_begin_ticks(struct mk_loop *loop, struct mk_error *err);
/* Zero torque and nothing more to come. RT. */
void mk_loop_end_ticks(struct mk_loop *loop);
/* Latches a fault and zeroes the motor at once. RT. */
void mk_loop_trip(struct mk_loop *loop, enum mk_fault fault, double t, int joint);
/* Takes over parameters and signal that wait in the mailbox, marking the sample. RT. */
void mk_loop_take_mail(struct mk_loop *loop, struct mk_sample *s);
/* Puts fault and state into the snapshot. RT. */
void mk_loop_publish(struct mk_loop *loop);

/* Zeroes the counters if need be and looks whether the links hang still: loop_start.c. */
enum mk_status mk_loop_check_rest(struct mk_loop *loop, struct mk_error *err);
enum mk_status mk_loop_fault_error(enum mk_fault fault, double t, int joint, struct mk_error *err);

/* Creates the real-time thread, which waits before its first tick; then lets it go (or, abandoned,
 * end); and waits for its end: loop_thread.c. */
enum mk_status mk_loop_thread_create(struct mk_loop *loop, struct mk_error *err);
enum mk_status mk_loop_thread_go(struct mk_loop *loop, bool abandon, struct mk_error *err);
void mk_loop_thread_join(struct mk_loop *loop);
/* Undoes what the process was given for real time. */
void mk_loop_thread_release(struct mk_loop *loop);

#endif
