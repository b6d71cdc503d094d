/* The clock of a run as a small table: the machine's monotonic clock, or simulated time that jumps
 * to whatever is waited for. The loop, the virtual board and the fault script see only this table,
 * so an hour of control takes seconds and gives the same numbers each time. */
#ifndef MECHKIT_CLOCK_H
#define MECHKIT_CLOCK_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

struct mk_clock;

struct mk_clock_ops {
    const char *name;
    bool simulated;
    int64_t (*now_ns)(const struct mk_clock *clock); /* RT; monotonic */
    /* Returns at or after `deadline_ns` (absolute); at once when it has passed. RT. */
    void (*sleep_until)(struct mk_clock *clock, int64_t deadline_ns);
};

struct mk_clock {
    const struct mk_clock_ops *ops;
    int64_t now_ns; /* simulated clock only; written by the one thread that sleeps on it */
};

/* CLOCK_MONOTONIC with absolute clock_nanosleep. */
void mk_clock_init_monotonic(struct mk_clock *clock);
/* Simulated time from 0. */
void mk_clock_init_simulated(struct mk_clock *clock);

static inline int64_t mk_clock_now_ns(const struct mk_clock *clock)
{
    return clock->ops->now_ns(clock);
}
static inline void mk_clock_sleep_until(struct mk_clock *clock, int64_t deadline_ns)
{
    clock->ops->sleep_until(clock, deadline_ns);
}

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
