/* The faults that end a run: every one turns the motor off, in the log and in the plant, is told to
 * the board, and is in the log. The loop is that of support/bench.h; boards that deny what they do
 * are in test_loop_lies, starts that are refused in test_loop_start. */
#include "suites.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "ctrl/loop_priv.h"
#include "mechkit/loop.h"
#include "support/bench.h"
#include "support/files.h"

/* --- what stops the motor -------------------------------------------------------------------- */

/* Starts, drives, expects `fault`; the motor is off in the row that shows it and in the plant. */
static void expect_fault(enum mk_fault fault)
{
    struct mk_error err = MK_ERROR_INIT;
    bench_start();
    ck_assert_int_eq(mk_loop_wait(bench.loop, 5, NULL, NULL, NULL, &err), MK_ERR_FAULT);
    ck_assert_ptr_nonnull(strstr(err.message, mk_fault_name(fault)));
    ck_assert_int_eq(bench_look().state, MK_LOOP_FAULTED);
    ck_assert_msg(bench_look().fault == fault, "%s", mk_fault_name(bench_look().fault));
    ck_assert_int_eq(bench_wait_for(1), MK_ERR_FAULT);
    ck_assert_int_eq(mk_loop_start(bench.loop, NULL, NULL, 0, NULL), MK_ERR_STATE);
    bench_halt();
    ck_assert_int_eq(bench_look().fault, fault);

    struct mk_log *log = bench_read_log();
    const double *u = mk_log_get(log, "u"), *flags = mk_log_get(log, "flags");
    char noted[64], where[16] = "";
    if (bench_look().fault_joint > 0)
        snprintf(where, sizeof where, " joint %d", bench_look().fault_joint);
    snprintf(noted, sizeof noted, "%s%s at ", mk_fault_name(fault), where);
    ck_assert_ptr_nonnull(strstr(mk_log_find_meta(log, "fault"), noted));
    bool seen = false;
    for (size_t k = 0; k < log->rows; k++) {
        seen = seen || ((int)flags[k] & MK_FLAG_FAULT);
        if (seen)
            ck_assert_double_eq(u[k], 0.0);
    }
    ck_assert(seen);
    mk_log_free(log);
    bench_assert_motor_is_off();

    mk_loop_acknowledge(bench.loop);
    ck_assert_int_eq(bench_look().state, MK_LOOP_IDLE);
    ck_assert_int_eq(bench_look().fault, MK_FAULT_NONE);
}

START_TEST(travel_stops_the_motor)
{
    bench.config.limits.q_max[0] = -M_PI_2 + 0.2;
    bench_build_driving(NULL, 6);
    expect_fault(MK_FAULT_TRAVEL);
}
END_TEST

START_TEST(speed_stops_the_motor)
{
    bench_use_plant(MK_PLANT_INERTIA_WHEEL);
    bench.config.limits.v_max[0] = 100;
    bench_build_driving(NULL, 6);
    expect_fault(MK_FAULT_SPEED);
}
END_TEST

START_TEST(a_jumping_encoder_stops_the_motor)
{
    bench_build_driving("at 100 jump 2 by 500", 1);
    expect_fault(MK_FAULT_JUMP);
    ck_assert_int_eq(bench_look().fault_joint, 0);
}
END_TEST

START_TEST(a_stuck_encoder_stops_the_motor)
{
    bench_build_driving("at 0 stuck 1", 9);
    expect_fault(MK_FAULT_STUCK);
}
END_TEST

/* A board whose motor is wired the wrong way round: the virtual one with its command negated. */
static enum mk_status reversed_exchange(struct mk_board *board, double u,
                                        struct mk_board_sample *out)
{
    enum mk_status st = bench.own->exchange(board, -u, out);
    out->u_applied = u;
    return st;
}

START_TEST(a_motor_wired_backwards_stops)
{
    bench_use_plant(MK_PLANT_INERTIA_WHEEL);
    bench_build(NULL);
    bench_override_board()->exchange = reversed_exchange;
    bench_set_law(5, 1, 1e18);
    bench_run_into(MK_FAULT_RUNAWAY, 1);
    ck_assert_double_lt(bench_look().fault_t, 0.05);
    bench_halt();
    bench_restore_board();
    bench_assert_motor_is_off();
}
END_TEST

START_TEST(a_command_that_is_no_number_stops_the_motor)
{
    bench_build(NULL);
    bench_set_law(2, 1, 100);
    expect_fault(MK_FAULT_COMMAND);
}
END_TEST

/* Though it is the controller that tripped it, which had said that it balances. */
START_TEST(no_sample_of_a_fault_is_shown_as_balanced)
{
    bench_build(NULL);
    bench_set_law(0, 1, 120);
    bench_run_into(MK_FAULT_COMMAND, 1);
    ck_assert_int_eq(bench_look().at_fault.tick, 120);
    ck_assert_int_eq(bench_look().at_fault.phase, MK_PHASE_IDLE);
    bench_halt();
    struct mk_log *log = bench_read_log();
    const double *phase = mk_log_get(log, "phase"), *tick = mk_log_get(log, "tick");
    ck_assert_double_eq(phase[119], MK_PHASE_BALANCE);
    for (size_t k = 120; k < log->rows; k++)
        ck_assert_msg(phase[k] == MK_PHASE_IDLE, "tick %g: phase %g", tick[k], phase[k]);
    mk_log_free(log);
}
END_TEST

START_TEST(late_samples_in_a_row_stop_the_motor)
{
    bench_build("from 100 to 200 delay 3500us");
    bench.config.watchdog_ms = 0;
    bench_set_law(2, 1, 1e18);
    expect_fault(MK_FAULT_OVERRUN);
}
END_TEST

START_TEST(a_broken_link_stops_the_motor)
{
    bench_build_driving("at 100 drop 5", 2);
    expect_fault(MK_FAULT_LINK);
}
END_TEST

START_TEST(the_watchdog_stops_the_motor_when_the_loop_stalls)
{
    bench.config.limits.late_limit = 1000;
    bench_build_driving("at 100 delay 100ms", 2);
    expect_fault(MK_FAULT_WATCHDOG);
}
END_TEST

START_TEST(a_fault_of_the_board_stops_the_motor)
{
    bench_build_driving("at 100 alarm for 1", 2);
    expect_fault(MK_FAULT_BOARD);
}
END_TEST

START_TEST(an_unplugged_board_ends_the_run)
{
    bench_build_driving("at 100 disconnect", 2);
    bench_run_into(MK_FAULT_UNPLUGGED, 1);
    ck_assert_double_eq_tol(bench_look().fault_t, 0.2, 1e-12);
    bench_halt();
    /* Nobody reaches the board any more: its watchdog does. */
    mk_clock_sleep_until(&bench.clock, mk_clock_now_ns(&bench.clock) + 25000000);
    bench_assert_motor_is_off();
    mk_loop_acknowledge(bench.loop);
    ck_assert_int_eq(mk_loop_start(bench.loop, NULL, NULL, 0, NULL), MK_ERR_FAULT);
    ck_assert_int_eq(bench_look().fault, MK_FAULT_UNPLUGGED);
}
END_TEST

START_TEST(a_halt_turns_the_motor_off_without_help_of_the_watchdog)
{
    bench.config.watchdog_ms = 0;
    bench_build_driving(NULL, 2);
    bench_start();
    ck_assert_int_eq(bench_wait_for(0.1), MK_OK);
    ck_assert_double_eq(bench_look().sample.u, 2.0);
    bench_halt();
    bench_assert_motor_is_off();
}
END_TEST

START_TEST(the_stop_button_stops_the_motor)
{
    bench_build_driving(NULL, 2);
    bench_start();
    bench_wait_for(0.2);
    mk_loop_estop(bench.loop);
    ck_assert_int_eq(bench_wait_for(1), MK_ERR_FAULT);
    ck_assert_int_eq(bench_look().fault, MK_FAULT_ESTOP);
    ck_assert_double_eq_tol(bench_look().fault_t, 0.2, 1e-12);
    bench_halt();
    bench_assert_motor_is_off();
    mk_loop_acknowledge(bench.loop);
    ck_assert_int_eq(bench_look().state, MK_LOOP_IDLE);
}
END_TEST

/* --- what a fault does to the board ---------------------------------------------------------- */

static struct {
    int safe, zeroed, exchanges;
    int safe_at_exchange[400]; /* how often SAFE had been asked for by then */
    double u[400];             /* the command that went with it */
} heard;

static enum mk_status hear_exchange(struct mk_board *board, double u, struct mk_board_sample *out)
{
    if (heard.exchanges < 400) {
        heard.safe_at_exchange[heard.exchanges] = heard.safe;
        heard.u[heard.exchanges] = u;
    }
    heard.exchanges++;
    return bench.own->exchange(board, u, out);
}

static enum mk_status hear_safe(struct mk_board *board)
{
    heard.safe++;
    return bench.own->safe_state(board);
}

static enum mk_status hear_zero(struct mk_board *board, struct mk_error *err)
{
    heard.zeroed++;
    return bench.own->zero_counters(board, err);
}

static void listen_to_the_board(void)
{
    memset(&heard, 0, sizeof heard);
    struct mk_board_ops *ops = bench_override_board();
    ops->exchange = hear_exchange;
    ops->safe_state = hear_safe;
    ops->zero_counters = hear_zero;
}

START_TEST(the_board_is_told_to_be_safe_in_the_tick_of_the_fault)
{
    bench_build("at 50 jump 2 by 500");
    listen_to_the_board();
    bench_run_into(MK_FAULT_JUMP, 1);
    ck_assert_int_eq(bench_look().fault_joint, 2);
    int at = 100 + 50; /* after the watch before the start */
    ck_assert_int_eq(heard.safe_at_exchange[at], 0);
    ck_assert_int_eq(heard.safe_at_exchange[at + 1], 1);
    bench_restore_board();
}
END_TEST

START_TEST(after_an_emergency_stop_no_command_goes_out_any_more)
{
    bench_build_driving(NULL, 0.5);
    listen_to_the_board();
    bench_start();
    ck_assert_int_eq(bench_wait_for(0.1), MK_OK);
    const int next = heard.exchanges;
    ck_assert_double_eq(heard.u[next - 1], 0.5);
    mk_loop_estop(bench.loop);
    ck_assert_int_eq(bench_wait_for(1), MK_ERR_FAULT);
    ck_assert_int_gt(heard.exchanges, next);
    for (int k = next; k < heard.exchanges && k < 400; k++)
        ck_assert_double_eq(heard.u[k], 0.0);
    bench_restore_board();
}
END_TEST

static enum mk_status deaf_to_safe(struct mk_board *board)
{
    (void)bench.own->safe_state(board);
    return MK_ERR_TIMEOUT;
}

START_TEST(a_halt_that_the_board_does_not_confirm_is_told)
{
    struct mk_error err = MK_ERROR_INIT;
    bench_build(NULL);
    bench_override_board()->safe_state = deaf_to_safe;
    bench_start();
    ck_assert_int_eq(mk_loop_halt(bench.loop, &err), MK_ERR_IO);
    ck_assert_msg(strstr(err.message, "not confirmed that the motor is off"), "%s", err.message);
    bench_restore_board();
    bench_start();
    ck_assert_int_eq(mk_loop_halt(bench.loop, &err), MK_OK);
}
END_TEST

START_TEST(counters_are_zeroed_again_after_faults_that_put_them_in_doubt)
{
    static const enum mk_fault doubtful[] = {MK_FAULT_JUMP,      MK_FAULT_STUCK, MK_FAULT_RUNAWAY,
                                             MK_FAULT_LINK,      MK_FAULT_BOARD, MK_FAULT_UNPLUGGED,
                                             MK_FAULT_DISOBEYED, MK_FAULT_STALE};
    bench_build(NULL);
    listen_to_the_board();
    for (int f = MK_FAULT_NONE + 1; f < MK_FAULT_COUNT; f++) {
        bool doubted = false;
        for (size_t i = 0; i < sizeof doubtful / sizeof doubtful[0]; i++)
            doubted = doubted || doubtful[i] == (enum mk_fault)f;
        bench_start(); /* knows its zero */
        bench_halt();
        heard.zeroed = 0;
        mk_safety_latch(&bench.loop->safety, (enum mk_fault)f, 0.0, 0);
        mk_loop_acknowledge(bench.loop);
        bench_start();
        bench_halt();
        ck_assert_msg(heard.zeroed == doubted, "after %s: zeroed %d times",
                      mk_fault_name((enum mk_fault)f), heard.zeroed);
    }
    bench_restore_board();
}
END_TEST

/* --- what the log says of it ----------------------------------------------------------------- */

/* Each exchange of the tail would be waited for in vain, a second in simulated time. */
START_TEST(a_board_that_does_not_answer_has_no_tail)
{
    bench_build_driving("from 100 to 1000 drop", 2);
    expect_fault(MK_FAULT_LINK);
    ck_assert_uint_eq(bench_rows_logged(), 105);
}
END_TEST

/* It stops answering in the tail. */
START_TEST(a_tail_ends_when_the_board_stops_answering)
{
    bench_build_driving("at 100 jump 2 by 500; from 130 to 1000 drop", 2);
    expect_fault(MK_FAULT_JUMP);
    ck_assert_uint_eq(bench_rows_logged(), 135);
}
END_TEST

START_TEST(after_a_fault_the_log_shows_what_the_rig_did)
{
    bench_build_driving("at 100 jump 2 by 500", 3);
    bench_run_into(MK_FAULT_JUMP, 1);
    bench_halt();
    ck_assert_uint_eq(bench_rows_logged(), 101 + 100); /* 0.2 s */
}
END_TEST

/* Who reads the log of a program that was killed later finds the fault where it happened. */
START_TEST(a_fault_is_noted_before_the_row_that_shows_it)
{
    bench_build_driving("at 100 jump 2 by 500", 3);
    bench_run_into(MK_FAULT_JUMP, 1);
    bench_halt();
    char *text = slurp_file(bench.path);
    const char *note = strstr(text, "\n# fault: encoder-jump"), *row = strstr(text, "\n0.2,");
    ck_assert(note && row && note < row);
    ck_assert_ptr_null(strstr(note + 1, "\n# fault:"));
    const char *before = strstr(text, "\n0.198,");
    ck_assert(before && before < note);
    free(text);
}
END_TEST

START_TEST(every_run_that_a_fault_ends_has_it_in_its_log)
{
    bench_build(NULL);
    for (int run = 0; run < 3; run++) {
        bench_start();
        ck_assert_int_eq(bench_wait_for(0.1), MK_OK);
        if (run != 1)
            mk_loop_estop(bench.loop);
        ck_assert_int_eq(bench_wait_for(0.1), run != 1 ? MK_ERR_FAULT : MK_OK);
        bench_halt();
        mk_loop_acknowledge(bench.loop);
        struct mk_log *log = bench_read_log();
        const char *noted = mk_log_find_meta(log, "fault");
        ck_assert_int_eq(noted != NULL, run != 1);
        ck_assert(!noted || strncmp(noted, "e-stop at 0.1", 13) == 0);
        mk_log_free(log);
    }
}
END_TEST

START_TEST(a_stop_that_no_sample_sees_any_more_is_noted_in_the_log)
{
    bench_build_driving(NULL, 2);
    bench_start();
    bench_wait_for(0.2);
    mk_loop_estop(bench.loop);
    bench_halt();
    ck_assert_int_eq(bench_look().state, MK_LOOP_FAULTED);
    ck_assert_int_eq(bench_look().fault, MK_FAULT_ESTOP);
    struct mk_log *log = bench_read_log();
    ck_assert_str_eq(mk_log_find_meta(log, "fault"), "e-stop at 0.1980 s");
    mk_log_free(log);
    mk_loop_acknowledge(bench.loop);
    ck_assert_int_eq(bench_look().state, MK_LOOP_IDLE);
}
END_TEST

START_TEST(a_log_that_falls_behind_says_so_when_it_has_caught_up)
{
    /* The writer looks every 20 ms. */
    bench_use_real_time(1000);
    bench.config.ring_samples = 4;
    bench_build(NULL);
    bench_start();
    ck_assert_int_eq(bench_wait_for(5), MK_ERR_FAULT);
    struct mk_loop_snapshot last = bench_look();
    ck_assert_int_eq(last.fault, MK_FAULT_LOG);
    ck_assert_double_eq(last.at_fault.t, last.fault_t);
    bench_halt();
    struct mk_log *log = bench_read_log();
    ck_assert_ptr_nonnull(mk_log_find_meta(log, "fault"));
    ck_assert_int_eq(strncmp(mk_log_find_meta(log, "fault"), "log at ", 7), 0);
    mk_log_free(log);
}
END_TEST

START_TEST(a_full_disk_stops_the_motor_and_is_reported)
{
    pid_t pid = fork();
    ck_assert_int_ge(pid, 0);
    if (pid == 0) {
        const struct rlimit small = {60000, 60000};
        signal(SIGXFSZ, SIG_IGN);
        setrlimit(RLIMIT_FSIZE, &small);
        bench_build_driving(NULL, 2);
        if (mk_loop_start(bench.loop, bench.path, NULL, 0, NULL) != MK_OK)
            _exit(1);
        enum mk_status st = MK_OK;
        for (int k = 0; k < 100 && st == MK_OK; k++)
            st = bench_wait_for(0.1);
        if (st != MK_ERR_FAULT || bench_look().fault != MK_FAULT_LOG)
            _exit(2);
        if (bench_look().sample.u != 0.0)
            _exit(3);
        if (mk_loop_halt(bench.loop, NULL) != MK_ERR_NOSPACE)
            _exit(4);
        _exit(bench_look().state == MK_LOOP_FAULTED ? 0 : 5);
    }
    int status;
    ck_assert_int_eq(waitpid(pid, &status, 0), pid);
    ck_assert_msg(WIFEXITED(status) && WEXITSTATUS(status) == 0, "status %x", status);
    ck_assert_uint_gt(bench_rows_logged(), 300);
}
END_TEST

Suite *suite_loop_faults(void)
{
    Suite *s = suite_create("loop_faults");
    TCase *t = tcase_create("faults");
    tcase_add_checked_fixture(t, bench_setup, bench_teardown);
    tcase_set_timeout(t, 20);
    tcase_add_test(t, travel_stops_the_motor);
    tcase_add_test(t, speed_stops_the_motor);
    tcase_add_test(t, a_jumping_encoder_stops_the_motor);
    tcase_add_test(t, a_stuck_encoder_stops_the_motor);
    tcase_add_test(t, a_motor_wired_backwards_stops);
    tcase_add_test(t, a_command_that_is_no_number_stops_the_motor);
    tcase_add_test(t, no_sample_of_a_fault_is_shown_as_balanced);
    tcase_add_test(t, late_samples_in_a_row_stop_the_motor);
    tcase_add_test(t, a_broken_link_stops_the_motor);
    tcase_add_test(t, the_watchdog_stops_the_motor_when_the_loop_stalls);
    tcase_add_test(t, a_fault_of_the_board_stops_the_motor);
    tcase_add_test(t, an_unplugged_board_ends_the_run);
    tcase_add_test(t, a_halt_turns_the_motor_off_without_help_of_the_watchdog);
    tcase_add_test(t, the_stop_button_stops_the_motor);
    tcase_add_test(t, the_board_is_told_to_be_safe_in_the_tick_of_the_fault);
    tcase_add_test(t, after_an_emergency_stop_no_command_goes_out_any_more);
    tcase_add_test(t, a_halt_that_the_board_does_not_confirm_is_told);
    tcase_add_test(t, counters_are_zeroed_again_after_faults_that_put_them_in_doubt);
    tcase_add_test(t, a_board_that_does_not_answer_has_no_tail);
    tcase_add_test(t, a_tail_ends_when_the_board_stops_answering);
    tcase_add_test(t, after_a_fault_the_log_shows_what_the_rig_did);
    tcase_add_test(t, a_fault_is_noted_before_the_row_that_shows_it);
    tcase_add_test(t, every_run_that_a_fault_ends_has_it_in_its_log);
    tcase_add_test(t, a_stop_that_no_sample_sees_any_more_is_noted_in_the_log);
    tcase_add_test(t, a_log_that_falls_behind_says_so_when_it_has_caught_up);
    tcase_add_test(t, a_full_disk_stops_the_motor_and_is_reported);
    suite_add_tcase(s, t);
    return s;
}
