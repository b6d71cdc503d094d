/* Clocks: the machine's, and one that jumps. */
#include "suites.h"

#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/time.h>

#include "driver/step_clock.h"
#include "mechkit/clock.h"

START_TEST(simulated_time_jumps_and_never_runs_back)
{
    struct mk_clock c;
    mk_clock_init_simulated(&c);
    ck_assert(c.ops->simulated);
    ck_assert_str_eq(c.ops->name, "simulated");
    ck_assert(mk_clock_now_ns(&c) == 0);
    mk_clock_sleep_until(&c, 3600000000000);
    ck_assert(mk_clock_now_ns(&c) == 3600000000000);
    mk_clock_sleep_until(&c, 5);
    ck_assert(mk_clock_now_ns(&c) == 3600000000000);
}
END_TEST

START_TEST(the_monotonic_clock_sleeps_until_its_deadline)
{
    struct mk_clock c;
    mk_clock_init_monotonic(&c);
    ck_assert(!c.ops->simulated);
    int64_t deadline = mk_clock_now_ns(&c) + 2000000;
    mk_clock_sleep_until(&c, deadline);
    ck_assert(mk_clock_now_ns(&c) >= deadline);
}
END_TEST

START_TEST(a_deadline_that_has_passed_does_not_wait)
{
    struct mk_clock c;
    mk_clock_init_monotonic(&c);
    int64_t before = mk_clock_now_ns(&c);
    static const int64_t passed[] = {1, 0, -1, -5000000000, INT64_MIN};
    for (size_t i = 0; i < sizeof passed / sizeof passed[0]; i++)
        mk_clock_sleep_until(&c, passed[i]);
    mk_clock_sleep_until(&c, before);
    int64_t after = mk_clock_now_ns(&c);
    ck_assert(after >= before && after - before < 1000000000);
}
END_TEST

static volatile sig_atomic_t alarms;

static void on_alarm(int number)
{
    (void)number;
    alarms++;
}

START_TEST(a_signal_does_not_cut_the_sleep_short)
{
    struct mk_clock c;
    struct sigaction act = {.sa_handler = on_alarm};
    sigaction(SIGALRM, &act, NULL);
    mk_clock_init_monotonic(&c);
    int64_t deadline = mk_clock_now_ns(&c) + 50000000;
    struct itimerval timer = {.it_interval = {0, 5000}, .it_value = {0, 5000}};
    setitimer(ITIMER_REAL, &timer, NULL);
    mk_clock_sleep_until(&c, deadline);
    int64_t woke = mk_clock_now_ns(&c);
    setitimer(ITIMER_REAL, &(struct itimerval){0}, NULL);
    ck_assert_int_gt(alarms, 0);
    ck_assert(woke >= deadline);
}
END_TEST

static void *watch(void *user)
{
    const struct mk_clock *c = user;
    int64_t last = 0, now = 0;
    while (now < 100000) {
        now = mk_clock_now_ns(c);
        if (now < last)
            return user;
        last = now;
    }
    return NULL;
}

START_TEST(another_thread_may_watch_simulated_time)
{
    struct mk_clock c;
    pthread_t thread;
    void *ran_back;
    mk_clock_init_simulated(&c);
    ck_assert_int_eq(pthread_create(&thread, NULL, watch, &c), 0);
    for (int64_t t = 1; t <= 100000; t++)
        mk_clock_sleep_until(&c, t);
    pthread_join(thread, &ran_back);
    ck_assert_ptr_null(ran_back);
}
END_TEST

/* Whoever looks at it sees one time go on, held or not. */
START_TEST(a_clock_that_is_held_stands_is_stepped_and_goes_on_from_there)
{
    const int64_t second = 1000000000;
    struct mk_clock machine;
    struct mk_step_clock c;
    memset(&c, 0xff, sizeof c);
    mk_step_clock_init(&c);
    mk_clock_init_monotonic(&machine);
    int64_t begin = mk_clock_now_ns(&c.clock);
    ck_assert_int_lt(llabs(mk_clock_now_ns(&machine) - begin), second);
    mk_step_clock_hold(&c, true);
    int64_t held = mk_clock_now_ns(&c.clock);
    ck_assert(held >= begin && held < begin + second);
    mk_clock_sleep_until(&machine, mk_clock_now_ns(&machine) + second / 100);
    ck_assert(mk_clock_now_ns(&c.clock) == held);
    mk_clock_sleep_until(&c.clock, held + 100 * second);
    ck_assert(mk_clock_now_ns(&c.clock) == held + 100 * second);
    mk_clock_sleep_until(&c.clock, held); /* never back */
    ck_assert(mk_clock_now_ns(&c.clock) == held + 100 * second);

    mk_step_clock_hold(&c, false);
    int64_t now = mk_clock_now_ns(&c.clock), then = mk_clock_now_ns(&machine);
    ck_assert(now >= held + 100 * second && now < held + 101 * second);
    mk_clock_sleep_until(&c.clock, now + second / 50);
    ck_assert(mk_clock_now_ns(&c.clock) >= now + second / 50);
    int64_t slept = mk_clock_now_ns(&machine) - then;
    ck_assert(slept >= second / 50 && slept < 2 * second);
    /* And held once more. */
    mk_step_clock_hold(&c, true);
    ck_assert(mk_clock_now_ns(&c.clock) >= now + second / 50);
    ck_assert(mk_clock_now_ns(&c.clock) < held + 103 * second);
}
END_TEST

Suite *suite_clock(void)
{
    Suite *s = suite_create("clock");
    TCase *t = tcase_create("core");
    tcase_set_timeout(t, 30);
    tcase_add_test(t, simulated_time_jumps_and_never_runs_back);
    tcase_add_test(t, the_monotonic_clock_sleeps_until_its_deadline);
    tcase_add_test(t, a_deadline_that_has_passed_does_not_wait);
    tcase_add_test(t, a_signal_does_not_cut_the_sleep_short);
    tcase_add_test(t, another_thread_may_watch_simulated_time);
    tcase_add_test(t, a_clock_that_is_held_stands_is_stepped_and_goes_on_from_there);
    suite_add_tcase(s, t);
    return s;
}
