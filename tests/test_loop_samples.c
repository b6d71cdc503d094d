/* The samples of a run, by the clock of the host and by that of a board that streams: one that is
 * lost or late costs its row and no more, and the figures of a run count it. The loop is that of
 * support/bench.h. */
#include "suites.h"

#include <math.h>
#include <string.h>

#include "ctrl/loop_priv.h"
#include "mechkit/loop.h"
#include "support/bench.h"

/* --- by the host's clock --------------------------------------------------------------------- */

START_TEST(a_lost_exchange_leaves_a_marked_empty_row)
{
    bench_build("at 20 drop 2; at 40 mute");
    struct mk_log *log = bench_log_of_run(0.2);
    const double *q = mk_log_get(log, "q1"), *flags = mk_log_get(log, "flags");
    ck_assert_uint_eq(log->rows, 100);
    for (size_t k = 0; k < log->rows; k++) {
        bool lost = k == 20 || k == 21 || k == 40;
        ck_assert_int_eq(isnan(q[k]) != 0, lost);
        ck_assert_int_eq((int)flags[k], lost ? MK_FLAG_LOST : 0);
    }
    struct mk_loop_stats stats;
    mk_loop_get_stats(bench.loop, &stats);
    ck_assert_uint_eq(stats.lost, 3);
    ck_assert_uint_eq(stats.gaps, 0);
    mk_log_free(log);
}
END_TEST

START_TEST(a_lost_exchange_leaves_a_row_without_readings_of_either_joint)
{
    bench_build("at 50 drop");
    struct mk_log *log = bench_log_of_run(0.2);
    ck_assert(isnan(mk_log_get(log, "q1")[50]) && isnan(mk_log_get(log, "q2")[50]));
    ck_assert(!isnan(mk_log_get(log, "q1")[51]) && !isnan(mk_log_get(log, "q2")[51]));
    mk_log_free(log);
}
END_TEST

static int exchanges;

/* The answer of tick 20 is lost, and before the one of tick 40 the board has an exchange that
 * nobody knows of. The watch before the start takes 100. */
static enum mk_status exchange_with_a_stranger(struct mk_board *board, double u,
                                               struct mk_board_sample *out)
{
    const int k = exchanges++ - 100;
    if (k == 40)
        (void)bench.own->exchange(board, u, out);
    enum mk_status st = bench.own->exchange(board, u, out);
    return k == 20 ? MK_ERR_TIMEOUT : st;
}

START_TEST(an_exchange_that_nobody_knows_of_is_a_gap_and_a_lost_one_is_not)
{
    bench_build(NULL);
    exchanges = 0;
    bench_override_board()->exchange = exchange_with_a_stranger;
    struct mk_log *log = bench_log_of_run(0.2);
    const double *flags = mk_log_get(log, "flags");
    for (size_t k = 0; k < log->rows; k++)
        ck_assert_int_eq((int)flags[k], k == 20 ? MK_FLAG_LOST : k == 40 ? MK_FLAG_GAP : 0);
    struct mk_loop_stats stats;
    mk_loop_get_stats(bench.loop, &stats);
    ck_assert_uint_eq(stats.lost, 1);
    ck_assert_uint_eq(stats.gaps, 1);
    mk_log_free(log);
    bench_restore_board();
}
END_TEST

START_TEST(a_late_answer_skips_samples_and_says_so)
{
    bench_build("at 20 delay 5ms; at 40 delay 1200us; at 60 drop");
    struct mk_log *log = bench_log_of_run(0.2);
    const double *tick = mk_log_get(log, "tick"), *flags = mk_log_get(log, "flags"),
                 *late = mk_log_get(log, "late_us"), *t = mk_log_get(log, "t");
    /* Tick 20 ends at 45 ms: the deadline of 21 (42 ms) and that of 22 (44 ms) have passed. */
    ck_assert_double_eq(tick[20], 20);
    ck_assert_double_eq(tick[21], 22);
    ck_assert_double_eq(t[21], 0.044);
    ck_assert_int_eq((int)flags[21], MK_FLAG_OVERRUN | MK_FLAG_LATE);
    ck_assert_double_eq_tol(late[21], 3000.0, 1e-6);
    ck_assert_double_eq(tick[22], 23);
    ck_assert_int_eq((int)flags[22], 0);
    /* 1.2 ms of 2 delay nobody. */
    for (size_t k = 22; k < log->rows; k++)
        ck_assert_double_eq(late[k], 0.0);
    /* The script counts exchanges, so a tick that is skipped moves what follows. */
    ck_assert_int_eq((int)flags[60], MK_FLAG_LOST);
    ck_assert_double_eq(tick[60], 61);
    const struct mk_loop_snapshot shown = bench_look();
    ck_assert_uint_eq(shown.late, 1);
    ck_assert_uint_eq(shown.overruns, 1);
    ck_assert_uint_eq(shown.lost, 1);
    mk_log_free(log);
}
END_TEST

/* Of 2 ms the deadline of tick 21 has passed by one, and a little more. */
START_TEST(a_sample_is_late_that_is_late_by_more_than_half_a_period)
{
    static const struct {
        const char *faults;
        int flags;
    } rows[] = {{"at 20 delay 3ms", 0}, {"at 20 delay 3000.01us", MK_FLAG_LATE}};
    bench_build(rows[_i].faults);
    struct mk_log *log = bench_log_of_run(0.1);
    ck_assert_double_eq(mk_log_get(log, "tick")[21], 21);
    ck_assert_double_eq_tol(mk_log_get(log, "late_us")[21], 1000.0, 0.02);
    ck_assert_int_eq((int)mk_log_get(log, "flags")[21], rows[_i].flags);
    mk_log_free(log);
    ck_assert_uint_eq(bench_look().late, (unsigned)_i);
}
END_TEST

START_TEST(an_answer_that_is_late_by_several_samples_skips_them_all)
{
    /* Tick 20 ends at 49 ms: the deadlines of 21 to 24 have passed, the first 7 ms ago. */
    bench_build("at 20 delay 9ms");
    struct mk_log *log = bench_log_of_run(0.2);
    ck_assert_double_eq(mk_log_get(log, "tick")[21], 24);
    ck_assert_double_eq_tol(mk_log_get(log, "late_us")[21], 7000.0, 1e-6);
    ck_assert_double_eq(mk_log_get(log, "tick")[22], 25);
    mk_log_free(log);
}
END_TEST

/* A second reader, beside the log; one that does not read holds nobody up. Where a reading is lost
 * the counters stand where they stood. */
START_TEST(who_listens_gets_every_sample_that_there_is_room_for)
{
    struct mk_ring *tap;
    struct mk_sample s;
    ck_assert_int_eq(mk_ring_create(64, sizeof s, &tap), MK_OK);
    bench.config.tap = tap;
    bench_build_driving("at 20 drop", 3.0);
    bench_run(0.2);
    ck_assert_uint_eq(bench_look().ticks, 100);
    uint64_t k = 0;
    int32_t before = 0;
    for (; mk_ring_pop(tap, &s); k++) {
        ck_assert_uint_eq(s.tick, k);
        ck_assert_uint_eq(s.flags, k == 20 ? MK_FLAG_LOST : 0);
        ck_assert(k < 20 || s.count[0] != 0);
        ck_assert(k != 20 || s.count[0] == before);
        before = s.count[0];
    }
    ck_assert_uint_eq(k, 64);
    mk_ring_destroy(tap);
}
END_TEST

/* Speed of joint 1 at tick `tick` of a run that accelerates, on a board with those faults. */
static double speed_at(const char *faults, double tick)
{
    double speed = NAN;
    mk_clock_init_simulated(&bench.clock);
    bench_build_driving(faults, 3.0);
    bench_run(0.1);
    bench_drop_loop();
    struct mk_log *log = bench_read_log();
    const double *at = mk_log_get(log, "tick"), *v = mk_log_get(log, "dq1");
    for (size_t k = 0; k < log->rows; k++)
        speed = at[k] == tick ? v[k] : speed;
    mk_log_free(log);
    return speed;
}

START_TEST(after_skipped_samples_speeds_are_those_of_a_run_without)
{
    double whole = speed_at(NULL, 22), skipped = speed_at("at 20 delay 5ms", 22);
    ck_assert_double_gt(whole, 0.5);
    /* The late answer was read a millisecond after its tick; one step of the estimator too many or
     * too few would make a third. */
    ck_assert_msg(fabs(skipped - whole) < 0.15 * whole, "%g, not %g rad/s", skipped, whole);
}
END_TEST

START_TEST(after_missed_ticks_the_law_is_told_how_much_time_went_by)
{
    bench_build("at 100 delay 7ms; at 200 delay 5ms");
    bench_start();
    ck_assert_int_eq(bench_wait_for(1), MK_OK);
    struct mk_loop_stats stats;
    mk_loop_get_stats(bench.loop, &stats);
    ck_assert_uint_eq(stats.overruns, 2);
    ck_assert_uint_lt(stats.ticks, 500);
    ck_assert_double_eq_tol(bench.told_s, bench_look().sample.t + 0.002, 1e-9);
}
END_TEST

/* --- by the board's clock -------------------------------------------------------------------- */

START_TEST(a_board_that_cannot_stream_is_refused)
{
    struct mk_loop *loop = NULL;
    struct mk_error err = MK_ERROR_INIT;
    bench_build_on("null");
    bench.config.stream = true;
    ck_assert_int_eq(mk_loop_create(bench.board, &bench.ctrl, &bench.config, &loop, &err),
                     MK_ERR_NOTSUP);
    ck_assert_ptr_nonnull(strstr(err.message, "null"));
    ck_assert_ptr_null(loop);
}
END_TEST

START_TEST(a_period_of_a_fraction_of_a_microsecond_is_refused)
{
    struct mk_loop *loop = NULL;
    struct mk_error err = MK_ERROR_INIT;
    bench_build(NULL);
    bench.config.stream = true;
    bench.config.rate_hz = 300.0;
    bench.ctrl.dt = 1.0 / 300.0;
    ck_assert_int_eq(mk_loop_create(bench.board, &bench.ctrl, &bench.config, &loop, &err),
                     MK_ERR_RANGE);
    ck_assert_ptr_null(loop);
}
END_TEST

/* Two runs that differ in whose clock made them: the same rows. */
START_TEST(the_boards_clock_and_ours_make_the_same_run)
{
    struct mk_log *log[2];
    for (int k = 0; k < 2; k++) {
        bench.config.stream = k == 1;
        bench_build(NULL);
        bench_start();
        bench_set_law(2, 1, 1e18);
        ck_assert_int_eq(bench_wait_for(0.5), MK_OK);
        bench_halt();
        log[k] = bench_read_log();
        bench_teardown();
        bench_setup();
    }
    ck_assert_ptr_null(mk_log_find_meta(log[0], "clock"));
    ck_assert_str_eq(mk_log_find_meta(log[1], "clock"), "board");
    ck_assert_uint_eq(log[0]->rows, log[1]->rows);
    for (const char *const *name = (const char *const[]){"t", "q1", "q2", "u", "flags", NULL};
         *name; name++)
        for (size_t i = 0; i < log[0]->rows; i++)
            ck_assert_double_eq(mk_log_get(log[0], *name)[i], mk_log_get(log[1], *name)[i]);
    mk_log_free(log[0]);
    mk_log_free(log[1]);
}
END_TEST

/* What was lost is a row without a reading, and the ticks stay those of the board's time. */
START_TEST(a_lost_sample_costs_one_row_and_no_time)
{
    bench.config.stream = true;
    bench_build("at 50 drop; at 60 mute");
    struct mk_log *log = bench_log_of_run(0.5);
    const double *tick = mk_log_get(log, "tick"), *flags = mk_log_get(log, "flags");
    int lost = 0;
    for (size_t i = 0; i < log->rows; i++) {
        lost += ((int)flags[i] & MK_FLAG_LOST) != 0;
        ck_assert_double_eq(tick[i], (double)i);
    }
    ck_assert_int_eq(lost, 2);
    mk_log_free(log);
}
END_TEST

START_TEST(a_stream_whose_first_samples_are_lost_begins_at_its_own_time)
{
    bench.config.stream = true;
    bench_build("at 0 drop 2");
    struct mk_log *log = bench_log_of_run(0.2);
    const double *tick = mk_log_get(log, "tick"), *flags = mk_log_get(log, "flags");
    ck_assert_uint_ge(log->rows, 99);
    for (size_t i = 0; i < log->rows; i++) {
        ck_assert_double_eq(tick[i], (double)i);
        ck_assert_int_eq((int)flags[i], i < 2 ? MK_FLAG_LOST : 0);
    }
    mk_log_free(log);
}
END_TEST

/* The virtual board, with a clock that was started ten seconds after ours. */
static enum mk_status behind_exchange(struct mk_board *board, double u, struct mk_board_sample *out)
{
    enum mk_status st = bench.own->exchange(board, u, out);
    out->board_ns -= 10000000000;
    return st;
}

START_TEST(a_board_whose_clock_is_behind_ours_is_not_late_for_it)
{
    bench.config.stream = true;
    bench_build(NULL);
    bench_override_board()->exchange = behind_exchange;
    struct mk_log *log = bench_log_of_run(0.2);
    const double *late = mk_log_get(log, "late_us"), *flags = mk_log_get(log, "flags");
    for (size_t i = 0; i < log->rows; i++) {
        ck_assert_double_eq_tol(late[i], 0.0, 1e-6);
        ck_assert_int_eq((int)flags[i], 0);
    }
    mk_log_free(log);
    bench_restore_board();
}
END_TEST

START_TEST(a_second_run_of_a_stream_is_timed_anew)
{
    bench.config.stream = true;
    bench_build(NULL);
    for (int run = 0; run < 2; run++) {
        struct mk_log *log = bench_log_of_run(0.2);
        const double *tick = mk_log_get(log, "tick"), *flags = mk_log_get(log, "flags");
        ck_assert_uint_ge(log->rows, 100);
        for (size_t i = 0; i < log->rows; i++) {
            ck_assert_double_eq(tick[i], (double)i);
            ck_assert_int_eq((int)flags[i], 0);
        }
        mk_log_free(log);
    }
}
END_TEST

START_TEST(a_fault_ends_the_stream_and_the_log_shows_what_followed)
{
    static const struct {
        const char *script;
        enum mk_fault fault;
    } rows[] = {{"at 50 alarm", MK_FAULT_BOARD},
                {"at 50 disconnect", MK_FAULT_UNPLUGGED},
                {"at 50 jump 2 by 500", MK_FAULT_JUMP}};
    bench.config.stream = true;
    bench_build(rows[_i].script);
    const int64_t begun_ns = mk_clock_now_ns(&bench.clock);
    bench_start();
    bench_set_law(1, 1, 1e18);
    ck_assert_int_eq(bench_wait_for(1.0), MK_ERR_FAULT);
    ck_assert_int_eq(bench_look().fault, rows[_i].fault);
    /* The watch before the start takes 0.2 s, and as long goes the run on where that tells
     * something.
     */
    const bool tail = rows[_i].fault != MK_FAULT_UNPLUGGED;
    ck_assert_double_eq_tol(1e-9 * (double)(mk_clock_now_ns(&bench.clock) - begun_ns),
                            0.2 + bench_look().fault_t + (tail ? 0.2 : 0.0), 0.011);
    bench_halt();
    /* Where nobody hears the host any more it is the board's watchdog. */
    mk_clock_sleep_until(&bench.clock, mk_clock_now_ns(&bench.clock) + 25000000);
    bench_assert_motor_is_off();
    struct mk_log *log = bench_read_log();
    ck_assert_uint_ge(log->rows, tail ? 150 : 50);
    mk_log_free(log);
}
END_TEST

START_TEST(streaming_in_real_time_keeps_the_boards_rate)
{
    bench_use_real_time(500);
    bench.config.stream = true;
    bench_build(NULL);
    bench_start();
    ck_assert_int_eq(bench_wait_for(0.4), MK_OK);
    ck_assert_uint_ge(bench_look().sample.tick, 199);
    bench_halt();
    struct mk_log *log = bench_read_log();
    const double *tick = mk_log_get(log, "tick"), *t = mk_log_get(log, "t");
    for (size_t i = 1; i < log->rows; i++) {
        ck_assert_double_gt(tick[i], tick[i - 1]);
        ck_assert_double_eq_tol(t[i], tick[i] / 500.0, 1e-9);
    }
    mk_log_free(log);
}
END_TEST

/* --- figures --------------------------------------------------------------------------------- */

START_TEST(a_run_begins_with_figures_of_its_own)
{
    struct mk_loop_stats stats;
    bench_build("at 50 drop 2; at 100 delay 7ms");
    bench_start();
    ck_assert_int_eq(bench_wait_for(0.5), MK_OK);
    mk_loop_get_stats(bench.loop, &stats);
    ck_assert_uint_eq(stats.lost, 2);
    ck_assert_uint_gt(stats.overruns, 0);
    ck_assert_uint_gt(stats.late, 0);
    bench_halt();
    bench_start(); /* of simulated time no tick has been made yet */
    mk_loop_get_stats(bench.loop, &stats);
    ck_assert_uint_eq(stats.ticks + stats.late + stats.overruns + stats.lost + stats.gaps, 0);
    ck_assert_double_eq(stats.late_max_us, 0.0);
}
END_TEST

/* As many values do not exceed it, and it is not above them by more than the width of a bin. */
START_TEST(a_percentile_is_within_a_bin_of_the_value_that_it_stands_for)
{
    static struct mk_histogram h;
    mk_histogram_clear(&h);
    ck_assert_double_eq(mk_histogram_percentile_us(&h, 0.5), 0.0);
    ck_assert_double_eq(mk_histogram_mean_us(&h), 0.0);
    double sum = 0.0;
    for (int i = 1; i <= 1000; i++) {
        int64_t ns = (int64_t)i * i * i; /* 1 ns .. 1 s */
        mk_histogram_add(&h, ns);
        sum += (double)ns * 1e-3;
    }
    for (int i = 10; i <= 1000; i += 10) {
        double exact = 1e-3 * (double)i * i * i, told = mk_histogram_percentile_us(&h, i / 1000.0);
        ck_assert_double_ge(told, exact * (1.0 - 1e-12));
        ck_assert_double_le(told, exact * (1.0 + 1.0 / (1 << MK_HISTOGRAM_SUB_BITS)));
    }
    ck_assert_double_eq(mk_histogram_percentile_us(&h, 1.0), 1e6);
    ck_assert_double_eq(mk_histogram_max_us(&h), 1e6);
    ck_assert_double_eq_tol(mk_histogram_mean_us(&h), sum / 1000.0, 1e-6);
    /* Short times have bins of their own. */
    for (int ns = 1; ns < 2 << MK_HISTOGRAM_SUB_BITS; ns++) {
        mk_histogram_clear(&h);
        mk_histogram_add(&h, ns);
        mk_histogram_add(&h, 1000000);
        ck_assert_double_eq_tol(mk_histogram_percentile_us(&h, 0.5), 1e-3 * ns, 1e-9);
    }
    /* What is longer than any bin, and what is before its time. */
    mk_histogram_clear(&h);
    mk_histogram_add(&h, -5);
    ck_assert_double_eq(mk_histogram_percentile_us(&h, 1.0), 0.0);
    mk_histogram_add(&h, INT64_MAX);
    ck_assert_double_eq(mk_histogram_percentile_us(&h, 0.5), 0.0);
    mk_histogram_add(&h, INT64_C(1) << 40); /* the first that is too long */
    ck_assert_double_gt(mk_histogram_percentile_us(&h, 0.6), 1e6);
    ck_assert_double_eq_tol(mk_histogram_max_us(&h), 1e-3 * (double)INT64_MAX, 1.0);
    ck_assert_double_gt(mk_histogram_percentile_us(&h, 1.0), 1e6);
}
END_TEST

START_TEST(a_histogram_that_is_cleared_has_forgotten_everything)
{
    static struct mk_histogram h;
    mk_histogram_clear(&h);
    mk_histogram_add(&h, 8000000);
    mk_histogram_clear(&h);
    mk_histogram_add(&h, 1000);
    ck_assert_double_eq_tol(mk_histogram_mean_us(&h), 1.0, 1e-9);
    ck_assert_double_eq_tol(mk_histogram_max_us(&h), 1.0, 1e-9);
    ck_assert_double_le(mk_histogram_percentile_us(&h, 1.0), 1.1);
}
END_TEST

Suite *suite_loop_samples(void)
{
    Suite *s = suite_create("loop_samples");
    TCase *t = tcase_create("simulated time");
    tcase_add_checked_fixture(t, bench_setup, bench_teardown);
    tcase_set_timeout(t, 20);
    tcase_add_test(t, a_lost_exchange_leaves_a_marked_empty_row);
    tcase_add_test(t, a_lost_exchange_leaves_a_row_without_readings_of_either_joint);
    tcase_add_test(t, an_exchange_that_nobody_knows_of_is_a_gap_and_a_lost_one_is_not);
    tcase_add_test(t, a_late_answer_skips_samples_and_says_so);
    tcase_add_loop_test(t, a_sample_is_late_that_is_late_by_more_than_half_a_period, 0, 2);
    tcase_add_test(t, an_answer_that_is_late_by_several_samples_skips_them_all);
    tcase_add_test(t, who_listens_gets_every_sample_that_there_is_room_for);
    tcase_add_test(t, after_skipped_samples_speeds_are_those_of_a_run_without);
    tcase_add_test(t, after_missed_ticks_the_law_is_told_how_much_time_went_by);
    tcase_add_test(t, a_board_that_cannot_stream_is_refused);
    tcase_add_test(t, a_period_of_a_fraction_of_a_microsecond_is_refused);
    tcase_add_test(t, the_boards_clock_and_ours_make_the_same_run);
    tcase_add_test(t, a_lost_sample_costs_one_row_and_no_time);
    tcase_add_test(t, a_stream_whose_first_samples_are_lost_begins_at_its_own_time);
    tcase_add_test(t, a_board_whose_clock_is_behind_ours_is_not_late_for_it);
    tcase_add_test(t, a_second_run_of_a_stream_is_timed_anew);
    tcase_add_loop_test(t, a_fault_ends_the_stream_and_the_log_shows_what_followed, 0, 3);
    tcase_add_test(t, a_run_begins_with_figures_of_its_own);
    tcase_add_test(t, a_percentile_is_within_a_bin_of_the_value_that_it_stands_for);
    tcase_add_test(t, a_histogram_that_is_cleared_has_forgotten_everything);
    suite_add_tcase(s, t);

    t = tcase_create("real time");
    tcase_add_checked_fixture(t, bench_setup, bench_teardown);
    tcase_set_timeout(t, 30);
    tcase_add_test(t, streaming_in_real_time_keeps_the_boards_rate);
    suite_add_tcase(s, t);
    return s;
}
