#include "mechkit/clock.h"

#include <errno.h>
#include <time.h>

static int64_t monotonic_now(const struct mk_clock *clock)
{
    (void)clock;
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static void monotonic_sleep_until(struct mk_clock *clock, int64_t deadline_ns)
{
    (void)clock;
    struct timespec t = {.tv_sec = (time_t)(deadline_ns / 1000000000),
                         .tv_nsec = (long)(deadline_ns % 1000000000)};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR)
        continue;
}

/* Other threads may look at the time while the one that sleeps on it moves it. */
static int64_t simulated_now(const struct mk_clock *clock)
{
    return __atomic_load_n(&clock->now_ns, __ATOMIC_ACQUIRE);
}

static void simulated_sleep_until(struct mk_clock *clock, int64_t deadline_ns)
{
    if (deadline_ns > clock->now_ns)
        __atomic_store_n(&clock->now_ns, deadline_ns, __ATOMIC_RELEASE);
}

void mk_clock_init_monotonic(struct mk_clock *clock)
{
    static const struct mk_clock_ops ops = {"monotonic", false, monotonic_now,
                                            monotonic_sleep_until};
    clock->ops = &ops;
    clock->now_ns = 0;
}

void mk_clock_init_simulated(struct mk_clock *clock)
{
    static const struct mk_clock_ops ops = {"simulated", true, simulated_now,
                                            simulated_sleep_until};
    clock->ops = &ops;
    clock->now_ns = 0;
}
