#include "driver/step_clock.h"

#include <string.h>

static int64_t machine_now_ns(void)
{
    struct mk_clock machine;
    mk_clock_init_monotonic(&machine);
    return mk_clock_now_ns(&machine);
}

static int64_t step_now(const struct mk_clock *clock)
{
    const struct mk_step_clock *c = (const struct mk_step_clock *)(const void *)clock;
    return c->held ? clock->now_ns : machine_now_ns() - c->behind_ns;
}

static void step_sleep_until(struct mk_clock *clock, int64_t deadline_ns)
{
    struct mk_step_clock *c = (struct mk_step_clock *)(void *)clock;
    struct mk_clock machine;
    if (c->held) {
        clock->now_ns = deadline_ns > clock->now_ns ? deadline_ns : clock->now_ns;
        return;
    }
    mk_clock_init_monotonic(&machine);
    mk_clock_sleep_until(&machine, deadline_ns + c->behind_ns);
}

void mk_step_clock_init(struct mk_step_clock *c)
{
    static const struct mk_clock_ops ops = {"step", false, step_now, step_sleep_until};
    memset(c, 0, sizeof *c);
    c->clock.ops = &ops;
}

void mk_step_clock_hold(struct mk_step_clock *c, bool held)
{
    int64_t now_ns = mk_clock_now_ns(&c->clock);
    c->clock.now_ns = now_ns;
    c->behind_ns = machine_now_ns() - now_ns;
    c->held = held;
}
