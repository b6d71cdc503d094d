/* What passes between whoever runs a loop and its thread while the run goes on: parameters and
 * signals one way, whole and in one sample, snapshots the other. The loop is that of
 * support/bench.h. */
#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ctrl/loop_priv.h"
#include "mechkit/loop.h"
#include "support/bench.h"

START_TEST(new_parameters_take_effect_together_in_one_sample)
{
    bench_build(NULL);
    bench_set_law(1, 2, 1e18);
    bench_start();
    bench_wait_for(0.1);
    bench_set_law(-0.5, 3, 1e18);
    bench_wait_for(0.1);
    bench_halt();
    struct mk_log *log = bench_read_log();
    const double *u = mk_log_get(log, "u"), *flags = mk_log_get(log, "flags");
    for (size_t k = 1; k < log->rows; k++) {
        ck_assert_double_eq(u[k], k <= 50 ? 2.0 : -1.5); /* never 6 or -1 */
        ck_assert_int_eq(((int)flags[k] & MK_FLAG_PARAMS) != 0, k == 50);
    }
    ck_assert_ptr_nonnull(
        strstr(mk_log_find_meta(log, "changed"), "at 0.100000 s: bias=-0.5 scale=3"));
    mk_log_free(log);
}
END_TEST

/* The bench's law takes its bias from the signal, where there is one. */
START_TEST(another_signal_takes_effect_in_one_sample_and_is_logged)
{
    struct mk_signal *first, *second;
    ck_assert_int_eq(mk_signal_create("1", &first, NULL), MK_OK);
    ck_assert_int_eq(mk_signal_create("3*step(0)", &second, NULL), MK_OK);
    bench_build(NULL);
    bench_set_law(0, 0.5, 1e18);
    ck_assert_int_eq(mk_loop_set_signal(bench.loop, first, NULL), MK_OK);
    bench_start();
    bench_wait_for(0.1);
    ck_assert_int_eq(mk_loop_set_signal(bench.loop, second, NULL), MK_OK);
    bench_wait_for(0.1);
    bench_halt();
    struct mk_log *log = bench_read_log();
    const double *u = mk_log_get(log, "u"), *flags = mk_log_get(log, "flags");
    for (size_t k = 1; k < log->rows; k++) {
        ck_assert_double_eq(u[k], k <= 50 ? 0.5 : 1.5);
        ck_assert_int_eq((int)flags[k] & (MK_FLAG_SIGNAL | MK_FLAG_PARAMS),
                         k == 50 ? MK_FLAG_SIGNAL : 0);
    }
    ck_assert_str_eq(mk_log_find_meta(log, "reference"), "1");
    ck_assert_str_eq(mk_log_find_meta(log, "changed"), "at 0.100000 s: reference 3*step(0)");
    mk_log_free(log);
    bench_drop_loop();
    mk_signal_destroy(first);
    mk_signal_destroy(second);
}
END_TEST

/* Which is that of the controller when the run begins, whatever the run before had. */
START_TEST(parameters_that_change_in_a_run_leave_its_signal_alone)
{
    struct mk_signal *first, *second;
    ck_assert_int_eq(mk_signal_create("1", &first, NULL), MK_OK);
    ck_assert_int_eq(mk_signal_create("3", &second, NULL), MK_OK);
    bench_use_plant(MK_PLANT_INERTIA_WHEEL); /* which may turn when a run begins */
    bench_build(NULL);
    for (int run = 0; run < 2; run++) {
        const double level = run == 0 ? 1.0 : 3.0;
        bench_set_law(0, 0.5, 1e18);
        ck_assert_int_eq(mk_loop_set_signal(bench.loop, run == 0 ? first : second, NULL), MK_OK);
        bench_start();
        bench_wait_for(0.1);
        bench_set_law(0, 0.25, 1e18);
        bench_wait_for(0.1);
        bench_halt();
        struct mk_log *log = bench_read_log();
        const double *u = mk_log_get(log, "u");
        for (size_t k = 1; k < log->rows; k++)
            ck_assert_double_eq(u[k], level * (k <= 50 ? 0.5 : 0.25));
        mk_log_free(log);
    }
    bench_drop_loop();
    mk_signal_destroy(first);
    mk_signal_destroy(second);
}
END_TEST

/* Another bias for every sample, up to the 300th. */
static bool change_the_bias(const struct mk_loop_snapshot *s, void *user)
{
    (void)user;
    if (s->ticks <= 300)
        bench_set_law(1e-3 * (double)s->ticks, 1, 1e18);
    return false;
}

/* A change whose row found no room any more waits for that row to the end of its run. */
START_TEST(a_change_that_a_log_had_no_room_for_is_not_in_the_next_one)
{
    bench.config.ring_samples = 4;
    bench_build_driving(NULL, 0);
    bench_start();
    for (int k = 0; k < 4; k++)
        ck_assert(mk_loop_tick(bench.loop));
    bench_set_law(1, 1, 1e18);
    (void)mk_loop_tick(bench.loop);
    ck_assert_int_eq(bench_look().fault, MK_FAULT_LOG);
    bench_halt();
    mk_loop_acknowledge(bench.loop);
    struct mk_log *log = bench_log_of_run(0.1);
    ck_assert_ptr_null(mk_log_find_meta(log, "changed"));
    mk_log_free(log);
}
END_TEST

/* More of them between two writes than the log keeps: those it has are right, and of the others it
 * says that they were. */
START_TEST(every_change_of_parameters_is_noted_at_its_time_however_many_there_are)
{
    bench_build_driving(NULL, 0);
    bench_start();
    ck_assert_int_eq(mk_loop_wait(bench.loop, 0.7, change_the_bias, NULL, NULL, NULL),
                     MK_ERR_TIMEOUT);
    bench_set_law(4, 1, 1e18);
    bench_wait_for(0.1);
    bench_halt();
    struct mk_log *log = bench_read_log();
    int tick = 0, known = 0;
    for (size_t m = 0; m < log->meta_count; m++) {
        char expected[48];
        const char *value = log->meta[m].value;
        if (strcmp(log->meta[m].key, "changed") != 0)
            continue;
        tick = tick == 300 ? 350 : tick + 1;
        snprintf(expected, sizeof expected, "at %.6f s: ", 0.002 * tick);
        ck_assert_msg(strncmp(value, expected, strlen(expected)) == 0, "%d: %s", tick, value);
        if (strstr(value, "not known"))
            continue;
        known++;
        const char *bias = strstr(value, "bias=");
        ck_assert_msg(bias && atof(bias + 5) == (tick == 350 ? 4.0 : 1e-3 * tick), "%s", value);
    }
    ck_assert_int_eq(tick, 350);
    ck_assert_int_ge(known, 257);
    mk_log_free(log);
}
END_TEST

START_TEST(parameters_and_signal_changed_at_once_are_both_taken)
{
    struct mk_signal *signal;
    ck_assert_int_eq(mk_signal_create("2", &signal, NULL), MK_OK);
    bench_build_driving(NULL, 1);
    bench_start();
    bench_wait_for(0.1);
    ck_assert_int_eq(mk_loop_set_signal(bench.loop, signal, NULL), MK_OK);
    bench_set_law(1, 0.25, 1e18);
    bench_wait_for(0.1);
    ck_assert_double_eq(bench_look().sample.u, 0.5);
    bench_halt();
    struct mk_log *log = bench_read_log();
    const double *flags = mk_log_get(log, "flags");
    ck_assert_int_eq((int)flags[50], MK_FLAG_PARAMS | MK_FLAG_SIGNAL);
    mk_log_free(log);
    bench_drop_loop();
    mk_signal_destroy(signal);
}
END_TEST

static int told_of_change;

static void law_changed(struct mk_ctrl *ctrl)
{
    told_of_change++;
    ck_assert_double_eq(ctrl->value[BIAS], 10.0 * told_of_change); /* the new ones are there */
}

/* A law that has made something of its parameters has to make it anew. */
START_TEST(a_law_is_told_of_new_parameters_before_a_run_and_in_it)
{
    bench_build(NULL);
    const struct mk_ctrl_ops *own = bench.ctrl.ops;
    struct mk_ctrl_ops told = *own;
    told.changed = law_changed;
    told_of_change = 0;
    bench.ctrl.ops = &told;
    bench_set_law(10, 0, 1e18);
    ck_assert_int_eq(told_of_change, 1);
    bench_start();
    bench_wait_for(0.1);
    ck_assert_int_eq(told_of_change, 1);
    bench_set_law(20, 0, 1e18);
    bench_wait_for(0.1);
    ck_assert_int_eq(told_of_change, 2);
    bench_halt();
    bench.ctrl.ops = own;
}
END_TEST

START_TEST(parameters_out_of_range_change_nothing)
{
    const double bad[PARAM_COUNT] = {1e10, 1, 1e18, 1e18};
    struct mk_error err = MK_ERROR_INIT;
    bench_build(NULL);
    bench_start();
    ck_assert_int_eq(mk_loop_set_params(bench.loop, bad, PARAM_COUNT, &err), MK_ERR_RANGE);
    ck_assert_ptr_nonnull(strstr(err.message, "bias"));
    ck_assert_int_eq(mk_loop_set_params(bench.loop, bad, 1, &err), MK_ERR_INVALID);
    bench_wait_for(0.1);
    ck_assert_double_eq(bench_look().sample.u, 0.0);
}
END_TEST

START_TEST(a_wish_beyond_the_limit_is_cut_and_marked)
{
    bench_build_driving(NULL, 25);
    bench_start();
    bench_wait_for(0.01);
    ck_assert_double_eq(bench_look().sample.u, 10.0);
    ck_assert(bench_look().sample.flags & MK_FLAG_SATURATED);
}
END_TEST

START_TEST(a_wish_at_the_limit_is_granted_and_not_marked)
{
    bench_build_driving(NULL, -10);
    bench_start();
    bench_wait_for(0.01);
    ck_assert_double_eq(bench_look().sample.u, -10.0);
    ck_assert_uint_eq(bench_look().sample.flags & MK_FLAG_SATURATED, 0);
}
END_TEST

START_TEST(gains_change_while_a_real_time_run_goes_on)
{
    bench_use_real_time(1000);
    bench_build(NULL);
    bench_set_law(0, 0, 1e18);
    bench_start();
    /* Products of a consistent pair are +1 or -1; a torn pair would give another. */
    for (int k = 0; k < 40; k++) {
        bench_set_law(k % 2 ? 2 : -4, k % 2 ? 0.5 : 0.25, 1e18);
        struct mk_loop_snapshot s = bench_look();
        ck_assert(s.sample.u == 0 || fabs(s.sample.u) == 1.0);
        ck_assert_int_eq(bench_wait_for(0.003), MK_OK);
    }
    bench_halt();
    struct mk_log *log = bench_read_log();
    const double *u = mk_log_get(log, "u"), *flags = mk_log_get(log, "flags");
    int changes = 0;
    for (size_t k = 0; k < log->rows; k++) {
        ck_assert(u[k] == 0 || fabs(u[k]) == 1.0);
        changes += ((int)flags[k] & MK_FLAG_PARAMS) != 0;
    }
    ck_assert_int_ge(changes, 20);
    mk_log_free(log);
}
END_TEST

START_TEST(a_reader_gets_the_newest_snapshot_and_it_stays_while_it_is_read)
{
    static struct mk_publish p;
    static struct mk_loop_snapshot put;
    memset(&p, _i ? 0xff : 0, sizeof p);
    mk_publish_init(&p);
    const struct mk_loop_snapshot *got = mk_publish_get(&p);
    for (put.ticks = 1; put.ticks < 20; put.ticks++) {
        ck_assert_uint_eq(got->ticks, (put.ticks - 1) / 3 * 3);
        mk_publish_put(&p, &put);
        ck_assert_uint_eq(got->ticks, (put.ticks - 1) / 3 * 3);
        for (int again = 0; put.ticks % 3 == 0 && again < 2; again++) {
            got = mk_publish_get(&p);
            ck_assert_uint_eq(got->ticks, put.ticks);
        }
    }
}
END_TEST

Suite *suite_loop_params(void)
{
    Suite *s = suite_create("loop_params");
    TCase *t = tcase_create("simulated time");
    tcase_add_checked_fixture(t, bench_setup, bench_teardown);
    tcase_set_timeout(t, 20);
    tcase_add_test(t, new_parameters_take_effect_together_in_one_sample);
    tcase_add_test(t, another_signal_takes_effect_in_one_sample_and_is_logged);
    tcase_add_test(t, parameters_that_change_in_a_run_leave_its_signal_alone);
    tcase_add_test(t, every_change_of_parameters_is_noted_at_its_time_however_many_there_are);
    tcase_add_test(t, a_change_that_a_log_had_no_room_for_is_not_in_the_next_one);
    tcase_add_test(t, parameters_and_signal_changed_at_once_are_both_taken);
    tcase_add_test(t, a_law_is_told_of_new_parameters_before_a_run_and_in_it);
    tcase_add_test(t, parameters_out_of_range_change_nothing);
    tcase_add_test(t, a_wish_beyond_the_limit_is_cut_and_marked);
    tcase_add_test(t, a_wish_at_the_limit_is_granted_and_not_marked);
    tcase_add_loop_test(t, a_reader_gets_the_newest_snapshot_and_it_stays_while_it_is_read, 0, 2);
    suite_add_tcase(s, t);

    t = tcase_create("real time");
    tcase_add_checked_fixture(t, bench_setup, bench_teardown);
    tcase_set_timeout(t, 30);
    tcase_add_test(t, gains_change_while_a_real_time_run_goes_on);
    suite_add_tcase(s, t);
    return s;
}
