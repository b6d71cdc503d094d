/* What every back end promises, checked on each; then what is special to the virtual board. A new
 * back end joins by a row in `boards`. */
#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "emu/bench.h"
#include "mechkit/board.h"
#include "mechkit/rig.h"

static const char *const boards[] = {"null",         "virtual",        "usb", "parport",
                                     "parport-byte", "parport-nibble", "tcp", "serial",
                                     "serial-cut",   "tcp-stepped"};
#define BOARD_COUNT ((int)(sizeof boards / sizeof boards[0]))

static struct mk_model model;
static struct mk_clock clock_;
static struct mk_board_config config;
static struct mk_board *board;
static struct emu_bench bench;

static void setup(void)
{
    mk_model_default(MK_PLANT_PENDUBOT, &model);
    mk_clock_init_simulated(&clock_);
    config = (struct mk_board_config){.model = &model, .clock = &clock_};
    board = NULL;
    memset(&bench, 0, sizeof bench);
}

static void teardown(void)
{
    mk_board_close(board);
    emu_bench_free(&bench);
}

static void open_board(const char *name)
{
    struct mk_error err = MK_ERROR_INIT;
    if (!bench.ops.name)
        emu_bench_init(&bench, name, &config);
    config.device = bench.device;
    const struct mk_board_ops *ops = bench.line ? &bench.ops : mk_board_backend_by_name(name);
    enum mk_status st = mk_board_open(ops, &config, &board, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
}

/* The row of the table; "parport-byte" is a parallel port all the same. */
static const struct mk_board_ops *back_end(int i)
{
    char name[32] = "";
    sscanf(boards[i], "%31[^-]", name);
    return mk_board_backend_by_name(name);
}

/* The rig goes on meanwhile: what it does shall not cost an exchange its time. */
static void pass_ms(double ms)
{
    mk_clock_sleep_until(&clock_, mk_clock_now_ns(&clock_) + (int64_t)llround(ms * 1e6));
    if (bench.line)
        ck_assert_int_eq(mk_emulated_run(&bench.board), MK_OK);
}

/* One exchange that must succeed, 2 ms after the last. */
static struct mk_board_sample trade(double u)
{
    struct mk_board_sample s;
    pass_ms(2);
    ck_assert_int_eq(mk_board_exchange(board, u, &s), MK_OK);
    return s;
}

static enum mk_status trade_status(double u)
{
    struct mk_board_sample s;
    pass_ms(2);
    return mk_board_exchange(board, u, &s);
}

/* --- the contract ---------------------------------------------------------------------------- */

START_TEST(a_back_end_can_be_found_and_describes_itself)
{
    const struct mk_board_ops *ops = back_end(_i);
    ck_assert_ptr_nonnull(ops);
    ck_assert_ptr_eq(strstr(boards[_i], ops->name), boards[_i]);
    ck_assert_uint_gt(strlen(ops->help), 10);
    bool listed = false;
    for (int i = 0; mk_board_backend(i); i++)
        listed = listed || mk_board_backend(i) == ops;
    ck_assert(listed);
    ck_assert_int_eq((ops->capabilities & MK_BOARD_CAP_WATCHDOG) != 0, ops->set_watchdog != NULL);
}
END_TEST

START_TEST(a_board_says_who_it_is)
{
    struct mk_board_identity id;
    open_board(boards[_i]);
    ck_assert_int_eq(board->ops->identify(board, &id, NULL), MK_OK);
    ck_assert_uint_gt(strlen(id.name), 0);
    if (bench.line)
        ck_assert_str_eq(id.serial, "MK-0001");
    ck_assert_int_ge(id.counter_bits, 8);
    ck_assert_int_le(id.counter_bits, 32);
}
END_TEST

START_TEST(opening_and_closing_can_be_repeated)
{
    for (int k = 0; k < 3; k++) {
        open_board(boards[_i]);
        trade(1.0);
        mk_board_close(board);
        board = NULL;
    }
}
END_TEST

START_TEST(counters_read_zero_after_zeroing_at_rest)
{
    open_board(boards[_i]);
    ck_assert_int_eq(board->ops->zero_counters(board, NULL), MK_OK);
    struct mk_board_sample s = trade(0.0);
    ck_assert_int_eq(s.count[0], 0);
    ck_assert_int_eq(s.count[1], 0);
}
END_TEST

START_TEST(each_exchange_counts_and_its_time_goes_on)
{
    open_board(boards[_i]);
    struct mk_board_sample before = trade(0.0);
    for (int k = 0; k < 20; k++) {
        struct mk_board_sample s = trade(0.1 * k);
        ck_assert_uint_eq(s.sequence, before.sequence + 1);
        if (board->ops->capabilities & MK_BOARD_CAP_TIMESTAMP)
            ck_assert_int_gt(s.board_ns, before.board_ns);
        before = s;
    }
}
END_TEST

START_TEST(a_board_tells_the_command_in_force)
{
    open_board(boards[_i]);
    for (double u = -10; u <= 10; u += 2.5)
        ck_assert_double_eq(trade(u).u_applied, u);
}
END_TEST

START_TEST(commands_that_are_none_are_refused)
{
    static const double bad[] = {NAN, INFINITY, -INFINITY, 10.001, -10.001};
    struct mk_board_sample s;
    open_board(boards[_i]);
    for (int k = 0; k < 5; k++) {
        ck_assert_double_eq(trade(5.0).u_applied, 5.0);
        ck_assert_int_eq(mk_board_exchange(board, bad[k], &s), MK_ERR_RANGE);
    }
    ck_assert_double_eq(trade(1.0).u_applied, 1.0);
}
END_TEST

START_TEST(safe_state_works_at_any_time_and_clears_nothing)
{
    open_board(boards[_i]);
    ck_assert_int_eq(board->ops->safe_state(board), MK_OK);
    uint32_t sequence = trade(3.0).sequence;
    ck_assert_int_eq(board->ops->safe_state(board), MK_OK);
    ck_assert_int_eq(board->ops->safe_state(board), MK_OK);
    ck_assert_uint_eq(trade(0.0).sequence, sequence + 1);
}
END_TEST

START_TEST(the_watchdog_can_be_set_cleared_and_switched_off)
{
    open_board(boards[_i]);
    if (!board->ops->set_watchdog)
        return;
    ck_assert_int_eq(board->ops->set_watchdog(board, 20, NULL), MK_OK);
    ck_assert_double_eq(trade(2.0).u_applied, 2.0);
    pass_ms(30);
    struct mk_board_sample s = trade(2.0);
    ck_assert(s.status & MK_BOARD_ST_WATCHDOG);
    ck_assert_double_eq(s.u_applied, 0.0);
    ck_assert(trade(2.0).status & MK_BOARD_ST_WATCHDOG); /* latched */
    ck_assert_int_eq(board->ops->set_watchdog(board, 0, NULL), MK_OK);
    ck_assert_uint_eq(trade(2.0).status, 0);
    pass_ms(1000);
    s = trade(2.0);
    ck_assert_uint_eq(s.status, 0);
    ck_assert_double_eq(s.u_applied, 2.0);
}
END_TEST

START_TEST(a_handle_needs_a_model_and_a_clock)
{
    const struct mk_board_ops *ops = back_end(_i);
    config.clock = NULL;
    ck_assert_int_eq(mk_board_open(ops, &config, &board, NULL), MK_ERR_INVALID);
    config.clock = &clock_;
    config.model = NULL;
    ck_assert_int_eq(mk_board_open(ops, &config, &board, NULL), MK_ERR_INVALID);
    ck_assert_int_eq(mk_board_open(NULL, &config, &board, NULL), MK_ERR_INVALID);
    ck_assert_ptr_null(board);
    config.model = &model;
    model.u_max = 0.0;
    ck_assert_int_eq(mk_board_open(ops, &config, &board, NULL), MK_ERR_INVALID);
}
END_TEST

/* There is one of each kind: a name could only be meant for another board. */
START_TEST(a_board_without_others_of_its_kind_takes_no_device)
{
    static const char *const alone[] = {"virtual", "null"};
    struct mk_error err = MK_ERROR_INIT;
    config.device = "127.0.0.1:7000";
    ck_assert_int_eq(mk_board_open(mk_board_backend_by_name(alone[_i]), &config, &board, &err),
                     MK_ERR_INVALID);
    ck_assert_msg(strstr(err.message, "leave out --device"), "%s", err.message);
    config.device = NULL;
    ck_assert_int_eq(mk_board_open(mk_board_backend_by_name(alone[_i]), &config, &board, &err),
                     MK_OK);
}
END_TEST

START_TEST(unknown_back_ends_are_not_found)
{
    ck_assert_ptr_null(mk_board_backend_by_name("warp-drive"));
    ck_assert_ptr_null(mk_board_backend(-1));
    ck_assert_ptr_null(mk_board_backend(1000));
}
END_TEST

START_TEST(a_board_without_simulated_time_refuses_it)
{
    struct mk_board_ops slow = *mk_board_backend_by_name("null");
    slow.capabilities = 0;
    ck_assert_int_eq(mk_board_open(&slow, &config, &board, NULL), MK_ERR_NOTSUP);
}
END_TEST

START_TEST(counters_are_subtracted_the_short_way_round)
{
    ck_assert_int_eq(mk_counter_difference(-8388608, 8388607, 24), 1);
    ck_assert_int_eq(mk_counter_difference(8388607, -8388608, 24), -1);
    ck_assert_int_eq(mk_counter_difference(5, -3, 24), 8);
    ck_assert_int_eq(mk_counter_difference(INT32_MIN, INT32_MAX, 32), 1);
    ck_assert_int_eq(mk_counter_difference(-128, 127, 8), 1);
}
END_TEST

/* --- the virtual board ----------------------------------------------------------------------- */

static void open_virtual(const char *faults)
{
    config.fault_script = faults;
    open_board("virtual");
    /* The script's samples count from here. */
    ck_assert_int_eq(board->ops->set_watchdog(board, 0, NULL), MK_OK);
}

static double speed(void)
{
    return mk_rig_state(mk_board_virtual_rig(board))[1];
}

static void use_wheel(void)
{
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &model);
    model.parameter[1] = model.parameter[2] = 0.0; /* no friction: speed = impulse / inertia */
}

START_TEST(the_plant_takes_each_command_from_its_exchange_on)
{
    use_wheel();
    open_virtual(NULL);
    double a = 5.0 / model.parameter[0];
    trade(5.0);
    ck_assert_double_eq(speed(), 0.0);
    trade(-5.0);
    ck_assert_double_eq_tol(speed(), a * 0.002, 1e-6);
    trade(0.0);
    ck_assert_double_eq_tol(speed(), 0.0, 1e-6);
}
END_TEST

START_TEST(the_watchdog_bites_at_its_time_though_nobody_looks)
{
    use_wheel();
    open_virtual(NULL);
    ck_assert_int_eq(board->ops->set_watchdog(board, 20, NULL), MK_OK);
    trade(5.0);
    pass_ms(500);
    ck_assert_double_eq_tol(speed(), 5.0 / model.parameter[0] * 0.020, 1e-5);
    ck_assert(trade(5.0).status & MK_BOARD_ST_WATCHDOG);
    trade(5.0);
    ck_assert_double_eq_tol(speed(), 5.0 / model.parameter[0] * 0.020, 1e-5);
}
END_TEST

START_TEST(an_exchange_in_time_keeps_the_watchdog_quiet)
{
    open_virtual(NULL);
    ck_assert_int_eq(board->ops->set_watchdog(board, 2, NULL), MK_OK);
    for (int k = 0; k < 100; k++)
        ck_assert_uint_eq(trade(0.1).status, 0); /* every 2 ms: just in time */
}
END_TEST

START_TEST(safe_state_stops_the_plants_motor_at_once)
{
    use_wheel();
    open_virtual(NULL);
    trade(5.0);
    pass_ms(1);
    ck_assert_int_eq(board->ops->safe_state(board), MK_OK);
    pass_ms(100);
    ck_assert_double_eq_tol(speed(), 5.0 / model.parameter[0] * 0.001, 1e-6);
}
END_TEST

START_TEST(a_refused_command_stops_the_plants_motor)
{
    use_wheel();
    open_virtual(NULL);
    trade(5.0);
    ck_assert_int_eq(trade_status(NAN), MK_ERR_RANGE);
    double v = speed();
    pass_ms(100);
    ck_assert_double_eq_tol(speed(), v, 1e-9);
}
END_TEST

START_TEST(a_dropped_request_leaves_the_old_command)
{
    use_wheel();
    open_virtual("at 1 drop");
    trade(5.0);
    ck_assert_int_eq(trade_status(-5.0), MK_ERR_TIMEOUT);
    pass_ms(2);
    ck_assert_double_eq_tol(speed(), 5.0 / model.parameter[0] * 0.004, 1e-6);
}
END_TEST

START_TEST(a_mute_board_obeys_all_the_same)
{
    use_wheel();
    open_virtual("at 1 mute");
    trade(5.0);
    ck_assert_int_eq(trade_status(0.0), MK_ERR_TIMEOUT);
    pass_ms(50);
    ck_assert_double_eq_tol(speed(), 5.0 / model.parameter[0] * 0.002, 1e-6);
    ck_assert_uint_eq(trade(0.0).sequence, 2); /* the board did count it */
}
END_TEST

START_TEST(a_delayed_answer_takes_its_time)
{
    open_virtual("at 1 delay 5ms");
    trade(0.0);
    int64_t before = mk_clock_now_ns(&clock_);
    trade(0.0);
    ck_assert_int_eq(mk_clock_now_ns(&clock_) - before, 7000000);
    before = mk_clock_now_ns(&clock_);
    trade(0.0);
    ck_assert_int_eq(mk_clock_now_ns(&clock_) - before, 2000000);
}
END_TEST

START_TEST(a_stuck_counter_stands_still_and_then_catches_up)
{
    use_wheel();
    open_virtual("at 50 stuck 1 for 20");
    int32_t held = 0, count = 0;
    for (int k = 0; k < 100; k++) {
        count = trade(5.0).count[0];
        if (k == 50)
            held = count;
        if (k >= 50 && k < 70)
            ck_assert_int_eq(count, held);
    }
    const double *x = mk_rig_state(mk_board_virtual_rig(board));
    ck_assert_int_eq(count, lround(x[0] * 4000 / (2 * M_PI)));
}
END_TEST

START_TEST(a_stuck_counter_can_be_zeroed)
{
    use_wheel();
    open_virtual("at 50 stuck 1");
    for (int k = 0; k < 60; k++)
        trade(5.0);
    ck_assert_int_gt(trade(5.0).count[0], 100);
    ck_assert_int_eq(board->ops->zero_counters(board, NULL), MK_OK);
    ck_assert_int_eq(trade(5.0).count[0], 0);
}
END_TEST

START_TEST(a_jump_stays_until_the_counters_are_zeroed)
{
    open_virtual("at 2 jump 2 by -300; at 3 jump 2 by 100");
    ck_assert_int_eq(trade(0).count[1], 0);
    ck_assert_int_eq(trade(0).count[1], 0);
    ck_assert_int_eq(trade(0).count[1], -300);
    ck_assert_int_eq(trade(0).count[1], -200);
    ck_assert_int_eq(trade(0).count[1], -200);
    ck_assert_int_eq(trade(0).count[0], 0);
    ck_assert_int_eq(board->ops->zero_counters(board, NULL), MK_OK);
    ck_assert_int_eq(trade(0).count[1], 0);
}
END_TEST

START_TEST(noise_comes_and_goes_with_its_rule)
{
    open_virtual("from 10 to 110 noise 5");
    double square = 0;
    for (int k = 0; k < 200; k++) {
        int32_t c = trade(0).count[0];
        if (k < 10 || k >= 110)
            ck_assert_int_eq(c, 0);
        square += (double)c * c;
    }
    ck_assert_double_eq_tol(sqrt(square / 100), 5.0, 1.5);
}
END_TEST

START_TEST(a_weak_amplifier_shows_in_status_and_plant)
{
    use_wheel();
    open_virtual("from 0 to 2 saturate 2");
    struct mk_board_sample s = trade(-5.0);
    ck_assert_double_eq(s.u_applied, -2.0);
    ck_assert(s.status & MK_BOARD_ST_SATURATED);
    ck_assert_uint_eq(trade(1.0).status, 0);
    ck_assert_double_eq_tol(speed(), -2.0 / model.parameter[0] * 0.002, 1e-6);
    ck_assert_double_eq(trade(-5.0).u_applied, -5.0);
}
END_TEST

START_TEST(an_alarm_is_a_fault_that_the_board_keeps_until_the_next_run)
{
    open_virtual("at 1 alarm for 1");
    ck_assert_uint_eq(trade(1.0).status, 0);
    for (int k = 0; k < 3; k++) {
        struct mk_board_sample s = trade(1.0);
        ck_assert(s.status & MK_BOARD_ST_FAULT);
        ck_assert_double_eq(s.u_applied, 0.0);
    }
    ck_assert_int_eq(board->ops->set_watchdog(board, 0, NULL), MK_OK);
    ck_assert_uint_eq(trade(1.0).status, 0);
}
END_TEST

START_TEST(an_unplugged_board_stays_gone_but_its_watchdog_works)
{
    use_wheel();
    open_virtual("at 1 disconnect");
    ck_assert_int_eq(board->ops->set_watchdog(board, 20, NULL), MK_OK);
    struct mk_board_identity id;
    trade(5.0);
    for (int k = 0; k < 3; k++)
        ck_assert_int_eq(trade_status(5.0), MK_ERR_NODEV);
    ck_assert_int_eq(board->ops->identify(board, &id, NULL), MK_ERR_NODEV);
    ck_assert_int_eq(board->ops->zero_counters(board, NULL), MK_ERR_NODEV);
    ck_assert_int_eq(board->ops->set_watchdog(board, 0, NULL), MK_ERR_NODEV);
    ck_assert_int_eq(board->ops->safe_state(board), MK_ERR_NODEV);
    pass_ms(100);
    ck_assert_double_eq_tol(speed(), 5.0 / model.parameter[0] * 0.020, 1e-5);
}
END_TEST

/* The time of older samples is gone; to answer them would let the board wait for more and more. */
START_TEST(a_host_that_is_slower_than_the_stream_answers_the_newest_sample)
{
    struct mk_board_sample s;
    open_virtual(NULL);
    ck_assert_int_eq(board->ops->set_watchdog(board, 100, NULL), MK_OK);
    ck_assert_int_eq(board->ops->stream(board, 2000, NULL), MK_OK);
    for (int k = 0; k < 50; k++) {
        pass_ms(k ? 8 : 2);
        ck_assert_int_eq(mk_board_exchange(board, 0.1 * k, &s), MK_OK);
        ck_assert_uint_eq(s.status & (MK_BOARD_ST_WATCHDOG | MK_BOARD_ST_FAULT), 0);
        if (k > 1)
            ck_assert_double_eq_tol(s.u_applied, 0.1 * (k - 1), 1e-6);
    }
}
END_TEST

START_TEST(a_stream_that_the_watchdog_ended_says_so)
{
    struct mk_board_sample s = {.status = 0};
    open_virtual(NULL);
    ck_assert_int_eq(board->ops->set_watchdog(board, 20, NULL), MK_OK);
    ck_assert_int_eq(board->ops->stream(board, 2000, NULL), MK_OK);
    ck_assert_int_eq(trade_status(1.0), MK_OK);
    pass_ms(500);
    for (int k = 0; k < 3 && !(s.status & MK_BOARD_ST_WATCHDOG); k++)
        ck_assert_int_eq(mk_board_exchange(board, 1.0, &s), MK_OK);
    ck_assert_uint_ne(s.status & MK_BOARD_ST_WATCHDOG, 0);
    ck_assert_double_eq(s.u_applied, 0.0);
}
END_TEST

START_TEST(the_script_starts_with_the_run)
{
    config.fault_script = "at 1 drop";
    open_board("virtual");
    for (int k = 0; k < 5; k++)
        trade(0.0);
    for (int run = 0; run < 2; run++) {
        ck_assert_int_eq(board->ops->set_watchdog(board, 0, NULL), MK_OK);
        trade(0.0);
        ck_assert_int_eq(trade_status(0.0), MK_ERR_TIMEOUT);
        trade(0.0);
    }
}
END_TEST

START_TEST(a_bad_script_does_not_open)
{
    struct mk_error err = MK_ERROR_INIT;
    config.fault_script = "at 5 explode";
    ck_assert_int_eq(mk_board_open(mk_board_backend_by_name("virtual"), &config, &board, &err),
                     MK_ERR_PARSE);
    ck_assert_ptr_null(board);
    ck_assert_int_eq(err.line, 1);
}
END_TEST

START_TEST(only_the_virtual_board_has_a_rig)
{
    open_board("null");
    ck_assert_ptr_null(mk_board_virtual_rig(board));
}
END_TEST

START_TEST(an_hour_unwatched_is_simulated_when_somebody_looks)
{
    open_virtual(NULL);
    trade(3.0);
    pass_ms(200);
    ck_assert_int_eq(board->ops->safe_state(board), MK_OK);
    pass_ms(3600e3);
    trade(0.0);
    ck_assert_double_eq_tol(mk_rig_time(mk_board_virtual_rig(board)), 3600.204, 1e-6);
    ck_assert_double_eq_tol(speed(), 0.0, 1e-6);
}
END_TEST

Suite *suite_board(void)
{
    Suite *s = suite_create("board");
    TCase *t = tcase_create("contract");
    tcase_add_checked_fixture(t, setup, teardown);
    tcase_add_loop_test(t, a_back_end_can_be_found_and_describes_itself, 0, BOARD_COUNT);
    tcase_add_loop_test(t, a_board_says_who_it_is, 0, BOARD_COUNT);
    tcase_add_loop_test(t, opening_and_closing_can_be_repeated, 0, BOARD_COUNT);
    tcase_add_loop_test(t, counters_read_zero_after_zeroing_at_rest, 0, BOARD_COUNT);
    tcase_add_loop_test(t, each_exchange_counts_and_its_time_goes_on, 0, BOARD_COUNT);
    tcase_add_loop_test(t, a_board_tells_the_command_in_force, 0, BOARD_COUNT);
    tcase_add_loop_test(t, commands_that_are_none_are_refused, 0, BOARD_COUNT);
    tcase_add_loop_test(t, safe_state_works_at_any_time_and_clears_nothing, 0, BOARD_COUNT);
    tcase_add_loop_test(t, the_watchdog_can_be_set_cleared_and_switched_off, 0, BOARD_COUNT);
    tcase_add_loop_test(t, a_handle_needs_a_model_and_a_clock, 0, BOARD_COUNT);
    tcase_add_loop_test(t, a_board_without_others_of_its_kind_takes_no_device, 0, 2);
    tcase_add_test(t, unknown_back_ends_are_not_found);
    tcase_add_test(t, a_board_without_simulated_time_refuses_it);
    tcase_add_test(t, counters_are_subtracted_the_short_way_round);
    suite_add_tcase(s, t);

    t = tcase_create("virtual");
    tcase_set_timeout(t, 120); /* an hour is integrated, maybe on a busy machine */
    tcase_add_checked_fixture(t, setup, teardown);
    tcase_add_test(t, the_plant_takes_each_command_from_its_exchange_on);
    tcase_add_test(t, the_watchdog_bites_at_its_time_though_nobody_looks);
    tcase_add_test(t, an_exchange_in_time_keeps_the_watchdog_quiet);
    tcase_add_test(t, safe_state_stops_the_plants_motor_at_once);
    tcase_add_test(t, a_refused_command_stops_the_plants_motor);
    tcase_add_test(t, a_dropped_request_leaves_the_old_command);
    tcase_add_test(t, a_mute_board_obeys_all_the_same);
    tcase_add_test(t, a_delayed_answer_takes_its_time);
    tcase_add_test(t, a_stuck_counter_stands_still_and_then_catches_up);
    tcase_add_test(t, a_stuck_counter_can_be_zeroed);
    tcase_add_test(t, a_jump_stays_until_the_counters_are_zeroed);
    tcase_add_test(t, noise_comes_and_goes_with_its_rule);
    tcase_add_test(t, a_weak_amplifier_shows_in_status_and_plant);
    tcase_add_test(t, an_alarm_is_a_fault_that_the_board_keeps_until_the_next_run);
    tcase_add_test(t, an_unplugged_board_stays_gone_but_its_watchdog_works);
    tcase_add_test(t, a_host_that_is_slower_than_the_stream_answers_the_newest_sample);
    tcase_add_test(t, a_stream_that_the_watchdog_ended_says_so);
    tcase_add_test(t, the_script_starts_with_the_run);
    tcase_add_test(t, a_bad_script_does_not_open);
    tcase_add_test(t, only_the_virtual_board_has_a_rig);
    tcase_add_test(t, an_hour_unwatched_is_simulated_when_somebody_looks);
    suite_add_tcase(s, t);
    return s;
}
