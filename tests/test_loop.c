/* The control loop from its start to its end, on boards that behave: what it goes through, what it
 * refuses, who may wait for it and stop it, in simulated time and in real time. The loop is that of
 * support/bench.h, whose law does what a test asks for. */
#include "suites.h"

#include <math.h>
#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <time.h>

#include "ctrl/loop_priv.h"
#include "mechkit/loop.h"
#include "mechkit/rig.h"
#include "support/bench.h"
#include "support/heap.h"

/* --- the order of things --------------------------------------------------------------------- */

START_TEST(a_run_goes_through_its_states)
{
    bench_build(NULL);
    ck_assert_int_eq(bench_look().state, MK_LOOP_IDLE);
    bench_start();
    ck_assert_int_eq(bench_look().state, MK_LOOP_RUNNING);
    ck_assert_int_eq(mk_loop_start(bench.loop, NULL, NULL, 0, NULL), MK_ERR_STATE);
    ck_assert_int_eq(bench_wait_for(0.5), MK_OK);
    ck_assert_uint_eq(bench_look().ticks, 250);
    ck_assert_double_eq_tol(bench_look().caught_t, 0.2, 1e-12);
    ck_assert_double_eq_tol(bench_look().balanced_since, 0.2, 1e-12);
    ck_assert_int_eq(bench_look().sample.phase, MK_PHASE_BALANCE);
    bench_halt();
    ck_assert_int_eq(bench_look().state, MK_LOOP_IDLE);
    ck_assert_int_eq(bench_look().sample.phase, MK_PHASE_IDLE);
    bench_halt();
    bench_start();
    ck_assert_uint_eq(bench_look().ticks, 0);
}
END_TEST

START_TEST(a_rig_that_falls_is_not_shown_as_balanced_any_more)
{
    bench_build(NULL);
    bench.ctrl.value[FALL_AT] = 150;
    bench_start();
    ck_assert_int_eq(bench_wait_for(0.25), MK_OK);
    ck_assert_double_eq_tol(bench_look().balanced_since, 0.2, 1e-12);
    ck_assert_int_eq(bench_wait_for(0.25), MK_OK);
    ck_assert(isnan(bench_look().balanced_since));
    ck_assert_double_eq_tol(bench_look().caught_t, 0.2, 1e-12); /* the first time stays */
}
END_TEST

START_TEST(a_loop_refuses_what_it_cannot_run)
{
    bench_build(NULL);
    struct mk_loop *loop = NULL;
    struct mk_error err = MK_ERROR_INIT;
    bench.config.rate_hz = 5000;
    ck_assert_int_eq(mk_loop_create(bench.board, &bench.ctrl, &bench.config, &loop, &err),
                     MK_ERR_RANGE);
    bench.config.rate_hz = 1000; /* the controller is made for 500 */
    ck_assert_int_eq(mk_loop_create(bench.board, &bench.ctrl, &bench.config, &loop, &err),
                     MK_ERR_INVALID);
    bench.config.rate_hz = 500;
    bench.config.ring_samples = SIZE_MAX;
    ck_assert_int_eq(mk_loop_create(bench.board, &bench.ctrl, &bench.config, &loop, &err),
                     MK_ERR_INVALID);
    ck_assert_str_eq(err.message, "no memory for the control loop");
    ck_assert_ptr_null(loop);
    ck_assert_int_eq(mk_loop_start(bench.loop, "/nonexistent/x.csv", NULL, 0, &err),
                     MK_ERR_NOTFOUND);
    ck_assert_int_eq(bench_look().state, MK_LOOP_IDLE);
    ck_assert_int_eq(mk_loop_wait(bench.loop, NAN, NULL, NULL, NULL, &err), MK_ERR_RANGE);
}
END_TEST

static bool reached_tick_50(const struct mk_loop_snapshot *s, void *user)
{
    (void)user;
    return s->sample.tick >= 50;
}

static bool never(const struct mk_loop_snapshot *s, void *user)
{
    (void)s;
    (void)user;
    return false;
}

START_TEST(waiting_ends_with_its_condition_its_time_or_a_cancel)
{
    volatile int cancel = 0;
    bench_build(NULL);
    bench_start();
    ck_assert_int_eq(mk_loop_wait(bench.loop, 1, reached_tick_50, NULL, NULL, NULL), MK_OK);
    ck_assert_uint_eq(bench_look().sample.tick, 50);
    ck_assert_int_eq(mk_loop_wait(bench.loop, 0.1, never, NULL, &cancel, NULL), MK_ERR_TIMEOUT);
    ck_assert_uint_eq(bench_look().sample.tick, 100);
    cancel = 1;
    ck_assert_int_eq(mk_loop_wait(bench.loop, 0.1, NULL, NULL, &cancel, NULL), MK_ERR_INTR);
}
END_TEST

START_TEST(a_time_that_nobody_can_wait_is_refused)
{
    const double times[] = {-1.0, 2.0 * MK_LOOP_WAIT_MAX_S, INFINITY, NAN};
    bench_build(NULL);
    for (size_t i = 0; i < sizeof times / sizeof times[0]; i++)
        ck_assert_int_eq(bench_wait_for(times[i]), MK_ERR_RANGE);
    ck_assert_int_eq(mk_clock_now_ns(&bench.clock), 0);
}
END_TEST

START_TEST(time_passes_for_the_rig_when_nothing_runs)
{
    bench_build(NULL);
    bench_start();
    bench_set_law(3, 1, 1e18);
    bench_wait_for(0.1);
    bench_halt();
    double t = mk_rig_time(mk_board_virtual_rig(bench.board));
    ck_assert_int_eq(bench_wait_for(2.0), MK_OK);
    ck_assert_double_eq_tol(mk_rig_time(mk_board_virtual_rig(bench.board)), t + 2.0, 1e-6);
}
END_TEST

/* --- what it takes and what it is set to ----------------------------------------------------- */

START_TEST(a_tick_allocates_nothing)
{
    struct mk_signal *signal;
    ck_assert_int_eq(mk_signal_create("0.1*sin(6*t)+0.01*noise(5,1)", &signal, NULL), MK_OK);
    bench_use_plant((enum mk_plant_kind)_i);
    bench_build("at 50 drop; at 60 delay 5ms; at 70 jump 1 by 1");
    ck_assert_int_eq(mk_loop_start(bench.loop, NULL, NULL, 0, NULL), MK_OK);
    bench_wait_for(0.01);
    bench_set_law(2, 1, 1e18);
    ck_assert_int_eq(mk_loop_set_signal(bench.loop, signal, NULL), MK_OK);
    unsigned long before = heap_allocations();
    enum mk_status st = bench_wait_for(0.5);
    unsigned long after = heap_allocations();
    bench_drop_loop();
    mk_signal_destroy(signal);
    ck_assert_int_eq(st, MK_OK);
    ck_assert_uint_eq(after, before);
    /* The counting itself works (volatile: the compiler leaves out what nobody looks at): */
    void *volatile block = malloc(1 + (size_t)_i);
    free(block);
    ck_assert_int_eq(heap_allocations() > before, heap_is_counted());
}
END_TEST

START_TEST(default_limits_hold_at_any_rate_of_the_loop)
{
    bench_use_plant(MK_PLANT_INERTIA_WHEEL);
    bench.config.rate_hz = 100; /* the limits are for 500 */
    bench_build_driving(NULL, 8);
    bench_start();
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_loop_wait(bench.loop, 5, NULL, NULL, NULL, &err) == MK_OK, "%s", err.message);
    ck_assert_double_gt(bench_look().sample.v[0], 400);
}
END_TEST

START_TEST(the_kalman_filter_expects_of_a_slide_what_its_unit_makes_usual)
{
    bench_use_plant(MK_PLANT_CART_POLE);
    bench.config.velocity.kind = MK_VELOCITY_KALMAN;
    bench_build(NULL);
    const struct mk_velocity *speed = bench.loop->run.speed;
    double usual = bench.config.velocity.accel_radps2;
    ck_assert_double_eq_tol(speed[0].config.accel_radps2,
                            usual * mk_model_joint_scale(&bench.model, 0), 1e-12);
    ck_assert_double_eq(speed[1].config.accel_radps2, usual);
}
END_TEST

/* --- real time ------------------------------------------------------------------------------- */

START_TEST(a_second_at_1_khz_loses_nothing)
{
    struct mk_loop_stats stats;
    bench_use_real_time(1000);
    bench_build_driving(NULL, 1);
    bench_run(1.0);
    mk_loop_get_stats(bench.loop, &stats);
    struct mk_log *log = bench_read_log();
    const double *tick = mk_log_get(log, "tick"), *t = mk_log_get(log, "t"),
                 *flags = mk_log_get(log, "flags");
    /* Every sample made is in the log, and every one that was not made is marked. */
    ck_assert_uint_eq(stats.ticks, log->rows);
    ck_assert_uint_eq(stats.lost + stats.gaps + stats.dropped, 0);
    ck_assert_double_ge(t[log->rows - 1], 0.999);
    for (size_t k = 1; k < log->rows; k++) {
        bool skipped = tick[k] != tick[k - 1] + 1;
        ck_assert_int_eq(skipped, ((int)flags[k] & MK_FLAG_OVERRUN) != 0);
        ck_assert_double_eq(t[k], tick[k] / 1000);
    }
    ck_assert_double_le(stats.late_p50_us, stats.late_p99_us);
    ck_assert_double_le(stats.late_p99_us, stats.late_p999_us);
    ck_assert_double_le(stats.late_p999_us, stats.late_max_us);
    ck_assert_str_eq(mk_log_find_meta(log, "realtime"), stats.note[0] ? stats.note : "granted");
    mk_log_free(log);
}
END_TEST

static void *press_stop(void *arg)
{
    struct mk_loop *loop = arg;
    const struct timespec pause = {.tv_nsec = 100000000};
    nanosleep(&pause, NULL);
    mk_loop_estop(loop);
    return NULL;
}

START_TEST(another_thread_can_stop_a_real_time_run)
{
    pthread_t presser;
    bench_use_real_time(1000);
    bench_build_driving(NULL, 2);
    bench_start();
    ck_assert_int_eq(pthread_create(&presser, NULL, press_stop, bench.loop), 0);
    ck_assert_int_eq(bench_wait_for(20), MK_ERR_FAULT);
    pthread_join(presser, NULL);
    ck_assert_int_eq(bench_look().fault, MK_FAULT_ESTOP);
    ck_assert_double_eq(bench_look().sample.u, 0.0);
    bench_halt();
}
END_TEST

START_TEST(a_real_time_run_can_be_unplugged)
{
    bench_use_real_time(1000);
    bench_build_driving("at 100 disconnect", 1);
    bench_run_into(MK_FAULT_UNPLUGGED, 10);
    bench_halt();
}
END_TEST

START_TEST(destroying_a_running_loop_turns_the_motor_off)
{
    bench_use_real_time(500);
    bench_build_driving(NULL, 2);
    bench_start();
    ck_assert_int_eq(bench_wait_for(0.05), MK_OK);
    mk_loop_destroy(bench.loop);
    bench.loop = NULL;
    struct mk_board_sample s;
    ck_assert_int_eq(mk_board_exchange(bench.board, 0.0, &s), MK_OK);
    ck_assert_double_eq(s.u_applied, 0.0);
    struct mk_log *log = bench_read_log();
    ck_assert_ptr_nonnull(mk_log_find_meta(log, "summary"));
    mk_log_free(log);
}
END_TEST

Suite *suite_loop(void)
{
    Suite *s = suite_create("loop");
    TCase *t = tcase_create("simulated time");
    tcase_add_checked_fixture(t, bench_setup, bench_teardown);
    tcase_set_timeout(t, 20);
    tcase_add_test(t, a_run_goes_through_its_states);
    tcase_add_test(t, a_rig_that_falls_is_not_shown_as_balanced_any_more);
    tcase_add_test(t, a_loop_refuses_what_it_cannot_run);
    tcase_add_test(t, waiting_ends_with_its_condition_its_time_or_a_cancel);
    tcase_add_test(t, a_time_that_nobody_can_wait_is_refused);
    tcase_add_test(t, time_passes_for_the_rig_when_nothing_runs);
    tcase_add_loop_test(t, a_tick_allocates_nothing, 0, MK_PLANT_COUNT);
    tcase_add_test(t, default_limits_hold_at_any_rate_of_the_loop);
    tcase_add_test(t, the_kalman_filter_expects_of_a_slide_what_its_unit_makes_usual);
    suite_add_tcase(s, t);

    t = tcase_create("real time");
    tcase_add_checked_fixture(t, bench_setup, bench_teardown);
    tcase_set_timeout(t, 30);
    tcase_add_test(t, a_second_at_1_khz_loses_nothing);
    tcase_add_test(t, another_thread_can_stop_a_real_time_run);
    tcase_add_test(t, a_real_time_run_can_be_unplugged);
    tcase_add_test(t, destroying_a_running_loop_turns_the_motor_off);
    suite_add_tcase(s, t);
    return s;
}
