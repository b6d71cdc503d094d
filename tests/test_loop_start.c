/* The watch before the start, with the motor off: links that move, links away from rest, boards
 * that do not answer, a machine that is too slow. A run that is not started says why. The loop is
 * that of support/bench.h. */
#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "mechkit/loop.h"
#include "mechkit/rig.h"
#include "support/bench.h"

/* --- what keeps it from starting ------------------------------------------------------------- */

START_TEST(a_stop_pressed_before_the_start_prevents_it)
{
    bench_build(NULL);
    mk_loop_estop(bench.loop);
    ck_assert_int_eq(bench_look().fault, MK_FAULT_ESTOP);
    ck_assert_int_eq(mk_loop_start(bench.loop, NULL, NULL, 0, NULL), MK_ERR_STATE);
    mk_loop_acknowledge(bench.loop);
    bench_start();
}
END_TEST

START_TEST(a_start_that_is_interrupted_is_given_up)
{
    static volatile int interrupted;
    interrupted = 1;
    bench.config.cancel = &interrupted;
    bench_build(NULL);
    ck_assert_int_eq(mk_loop_start(bench.loop, NULL, NULL, 0, NULL), MK_ERR_INTR);
    ck_assert_int_eq(bench_look().state, MK_LOOP_IDLE);
    interrupted = 0;
    bench_start();
}
END_TEST

/* The virtual board with its first exchanges failing. */
static struct {
    enum mk_status with;
    int first, exchanges;
} failing;

static enum mk_status failing_exchange(struct mk_board *board, double u,
                                       struct mk_board_sample *out)
{
    if (failing.exchanges++ < failing.first)
        return failing.with;
    return bench.own->exchange(board, u, out);
}

static enum mk_status start_over(enum mk_status with, int first)
{
    failing.with = with;
    failing.first = first;
    failing.exchanges = 0;
    bench_override_board()->exchange = failing_exchange;
    enum mk_status st = mk_loop_start(bench.loop, NULL, NULL, 0, NULL);
    if (st == MK_OK)
        bench_halt();
    bench_restore_board();
    return st;
}

START_TEST(a_link_that_is_broken_at_the_start_says_how)
{
    static const struct {
        enum mk_status with;
        enum mk_fault fault;
        bool at_once;
    } row[] = {{MK_ERR_TIMEOUT, MK_FAULT_LINK, false},
               {MK_ERR_PROTO, MK_FAULT_LINK, false},
               {MK_ERR_NODEV, MK_FAULT_UNPLUGGED, true},
               {MK_ERR_IO, MK_FAULT_BOARD, true}};
    for (size_t i = 0; i < sizeof row / sizeof row[0]; i++) {
        bench_build(NULL);
        int most = bench.config.limits.lost_limit;
        ck_assert_int_eq(start_over(row[i].with, 1000000), MK_ERR_FAULT);
        ck_assert_int_eq(bench_look().fault, row[i].fault);
        ck_assert_int_eq(failing.exchanges, row[i].at_once ? 1 : most);
        mk_loop_acknowledge(bench.loop);
        if (!row[i].at_once)
            ck_assert_int_eq(start_over(row[i].with, most - 1), MK_OK);
        bench_drop_loop();
    }
}
END_TEST

/* The virtual board on a machine that is too busy for it: an exchange takes a tenth of a second. */
static enum mk_status slow_exchange(struct mk_board *board, double u, struct mk_board_sample *out)
{
    mk_clock_sleep_until(board->clock, mk_clock_now_ns(board->clock) + 100000000);
    return bench.own->exchange(board, u, out);
}

START_TEST(a_start_that_the_machine_is_too_slow_for_is_given_up)
{
    struct mk_error err = MK_ERROR_INIT;
    bench_build(NULL);
    bench_override_board()->exchange = slow_exchange;
    ck_assert_int_eq(mk_loop_start(bench.loop, NULL, NULL, 0, &err), MK_ERR_FAULT);
    ck_assert_msg(strstr(err.message, "overrun") != NULL, "%s", err.message);
    ck_assert_int_eq(bench_look().fault, MK_FAULT_OVERRUN);
    ck_assert_double_lt(1e-9 * (double)mk_clock_now_ns(bench.board->clock), 6.0);
    bench_restore_board();
    bench_assert_motor_is_off();
    mk_loop_acknowledge(bench.loop);
    bench_start();
    ck_assert_int_eq(bench_wait_for(0.1), MK_OK);
}
END_TEST

/* --- links at rest --------------------------------------------------------------------------- */

START_TEST(swinging_links_do_not_start)
{
    struct mk_error err = MK_ERROR_INIT;
    bench.board_config.start[0] = 0.1;
    bench_build(NULL);
    ck_assert_int_eq(mk_loop_start(bench.loop, NULL, NULL, 0, &err), MK_ERR_FAULT);
    ck_assert_ptr_nonnull(strstr(err.message, "moves"));
    ck_assert_int_eq(bench_look().fault, MK_FAULT_NOT_HANGING);
    ck_assert_int_eq(bench_look().state, MK_LOOP_FAULTED);
    bench_assert_motor_is_off();
    /* Friction brings them to rest. */
    mk_loop_acknowledge(bench.loop);
    ck_assert_int_eq(bench_wait_for(60), MK_OK);
    bench_start();
}
END_TEST

/* The virtual board with one link that creeps, by counts a sample. */
static struct {
    int joint, counts, exchanges;
} creep;

static enum mk_status creeping_exchange(struct mk_board *board, double u,
                                        struct mk_board_sample *out)
{
    enum mk_status st = bench.own->exchange(board, u, out);
    out->count[creep.joint] += creep.counts * creep.exchanges++;
    return st;
}

START_TEST(a_link_that_moves_either_way_is_named_and_not_started)
{
    char expected[64];
    struct mk_error err = MK_ERROR_INIT;
    bench_build(NULL);
    bench_override_board()->exchange = creeping_exchange;
    creep.joint = _i / 2;
    creep.counts = _i % 2 ? 1 : -1;
    creep.exchanges = 0;
    enum mk_status st = mk_loop_start(bench.loop, NULL, NULL, 0, &err);
    bench_restore_board();
    ck_assert_int_eq(st, MK_ERR_FAULT);
    ck_assert_int_eq(bench_look().fault, MK_FAULT_NOT_HANGING);
    ck_assert_int_eq(bench_look().fault_joint, creep.joint + 1);
    snprintf(expected, sizeof expected, "joint %d moves", creep.joint + 1);
    ck_assert_msg(strstr(err.message, expected) != NULL, "%s", err.message);
}
END_TEST

START_TEST(a_link_held_away_from_rest_does_not_start_again)
{
    struct mk_error err = MK_ERROR_INIT;
    bench_build_on("null");
    bench_run(0.1);
    /* Rest is known now; pretend that it was somewhere else. */
    bench.config.limits.rest_tolerance[1] = -1.0;
    mk_loop_destroy(bench.loop);
    ck_assert_int_eq(mk_loop_create(bench.board, &bench.ctrl, &bench.config, &bench.loop, &err),
                     MK_OK);
    ck_assert_int_eq(mk_loop_start(bench.loop, NULL, NULL, 0, &err), MK_ERR_FAULT);
    ck_assert_ptr_nonnull(strstr(err.message, "joint 2"));
}
END_TEST

/* The virtual board with one link held 300 counts and three turns from where it is. */
static int held_joint;

static enum mk_status held_exchange(struct mk_board *board, double u, struct mk_board_sample *out)
{
    enum mk_status st = bench.own->exchange(board, u, out);
    out->count[held_joint] += 300 + 3 * bench.model.encoder_cpr[held_joint];
    return st;
}

START_TEST(a_start_says_which_link_is_how_far_from_rest)
{
    char expected[64];
    struct mk_error err = MK_ERROR_INIT;
    bench_build(NULL);
    bench_run(0.1);
    held_joint = _i;
    bench_override_board()->exchange = held_exchange;
    ck_assert_int_eq(mk_loop_start(bench.loop, NULL, NULL, 0, &err), MK_ERR_FAULT);
    bench_restore_board();
    ck_assert_int_eq(bench_look().fault, MK_FAULT_NOT_HANGING);
    snprintf(expected, sizeof expected, "joint %d is 0.471 rad away", held_joint + 1);
    ck_assert_msg(strstr(err.message, expected) != NULL, "%s", err.message);
}
END_TEST

/* The virtual board with link 1 at rest after 2048 turns of 4096 counts, where counters of 24 bits
 * wrap: a trembling of one count goes from one end of their range to the other. */
static enum mk_status wrapping_exchange(struct mk_board *board, double u,
                                        struct mk_board_sample *out)
{
    static bool odd;
    const int32_t top = 1 << (MK_COUNTER_BITS - 1);
    enum mk_status st = bench.own->exchange(board, u, out);
    odd = !odd;
    out->count[0] = odd ? top - 1 : -top;
    return st;
}

START_TEST(a_link_that_rests_where_its_counter_wraps_starts)
{
    struct mk_error err = MK_ERROR_INIT;
    bench.model.encoder_cpr[0] = 4096;
    bench_build(NULL);
    bench_run(0.1); /* zero is known now */
    bench_override_board()->exchange = wrapping_exchange;
    ck_assert_msg(mk_loop_start(bench.loop, NULL, NULL, 0, &err) == MK_OK, "%s", err.message);
    ck_assert_int_eq(bench_wait_for(0.1), MK_OK);
    ck_assert_double_eq_tol(bench_look().sample.q[0], -M_PI_2, 0.002);
    bench_halt();
    bench_restore_board();
}
END_TEST

START_TEST(whole_turns_are_forgotten_between_runs)
{
    bench.config.limits.v_max[0] = bench.config.limits.v_max[1] = 200;
    bench.config.limits.jump_rad[0] = bench.config.limits.jump_rad[1] = 3;
    bench_build_driving(NULL, 10);
    bench_start();
    struct mk_error err = MK_ERROR_INIT;
    enum mk_status st = mk_loop_wait(bench.loop, 0.5, NULL, NULL, NULL, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    bench_halt();
    ck_assert_int_eq(bench_wait_for(120), MK_OK);
    double rest = mk_rig_state(mk_board_virtual_rig(bench.board))[0] + M_PI_2;
    bench_set_law(0, 1, 1e18);
    bench_start();
    ck_assert_int_eq(bench_wait_for(0.01), MK_OK);
    ck_assert_double_eq_tol(bench_look().sample.q[0], -M_PI_2 + remainder(rest, 2 * M_PI), 0.001);
    ck_assert_double_gt(fabs(rest), 3.0);
}
END_TEST

/* A wheel, and an arm that is level: where they came to rest is of no account. */
START_TEST(what_rests_anywhere_begins_each_run_at_zero)
{
    static const enum mk_plant_kind plants[] = {MK_PLANT_INERTIA_WHEEL, MK_PLANT_FURUTA};
    bench_use_plant(plants[_i]);
    bench_build_driving(NULL, 1.0);
    bench_start();
    ck_assert_int_eq(bench_wait_for(0.3), MK_OK);
    bench_halt();
    ck_assert_int_eq(bench_wait_for(120), MK_OK);
    const double rests_at = mk_rig_state(mk_board_virtual_rig(bench.board))[0];
    ck_assert_double_gt(fabs(remainder(rests_at, 2 * M_PI)), 0.1);
    bench_set_law(0, 1, 1e18);
    bench_start();
    ck_assert_int_eq(bench_wait_for(0.01), MK_OK);
    ck_assert_double_eq_tol(bench_look().sample.q[0], mk_plant(plants[_i])->rest[0], 0.01);
}
END_TEST

/* The virtual board with the exchanges between two numbers failing. */
static struct {
    int from, to, exchanges;
} gap;

static enum mk_status gapped_exchange(struct mk_board *board, double u, struct mk_board_sample *out)
{
    const int k = gap.exchanges++;
    return k >= gap.from && k < gap.to ? MK_ERR_TIMEOUT : bench.own->exchange(board, u, out);
}

/* Two short of what stops a run at the end of the first, two at the beginning of the second. The
 * watch before the start takes 100 exchanges. */
START_TEST(what_one_run_has_lost_does_not_count_in_the_next)
{
    const int most = bench.config.limits.lost_limit;
    ck_assert_int_gt(most, 2);
    bench_build(NULL);
    bench_override_board()->exchange = gapped_exchange;
    gap.exchanges = 0;
    gap.from = 100 + 50 - (most - 1);
    gap.to = 100 + 50;
    bench_run(0.1);
    ck_assert_uint_eq(bench_look().lost, (unsigned)most - 1);
    gap.exchanges = 0;
    gap.from = 100;
    gap.to = 102;
    bench_run(0.1);
    ck_assert_uint_eq(bench_look().lost, 2);
    bench_restore_board();
}
END_TEST

Suite *suite_loop_start(void)
{
    Suite *s = suite_create("loop_start");
    TCase *t = tcase_create("start");
    tcase_add_checked_fixture(t, bench_setup, bench_teardown);
    tcase_set_timeout(t, 20);
    tcase_add_test(t, a_stop_pressed_before_the_start_prevents_it);
    tcase_add_test(t, a_start_that_is_interrupted_is_given_up);
    tcase_add_test(t, a_link_that_is_broken_at_the_start_says_how);
    tcase_add_test(t, a_start_that_the_machine_is_too_slow_for_is_given_up);
    tcase_add_test(t, swinging_links_do_not_start);
    tcase_add_loop_test(t, a_link_that_moves_either_way_is_named_and_not_started, 0, 4);
    tcase_add_test(t, a_link_held_away_from_rest_does_not_start_again);
    tcase_add_loop_test(t, a_start_says_which_link_is_how_far_from_rest, 0, 2);
    tcase_add_test(t, a_link_that_rests_where_its_counter_wraps_starts);
    tcase_add_test(t, whole_turns_are_forgotten_between_runs);
    tcase_add_loop_test(t, what_rests_anywhere_begins_each_run_at_zero, 0, 2);
    tcase_add_test(t, what_one_run_has_lost_does_not_count_in_the_next);
    suite_add_tcase(s, t);
    return s;
}
