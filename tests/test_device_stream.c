/* The board's side of the protocol: samples that it streams by its clock, and a clock that the host
 * steps. */
#include "suites.h"

#include <string.h>

#include "support/device_bench.h"

/* --- streaming ---------------------------------------------------------------------------------
 */

/* The samples that the board sends while `ns` pass. */
static int streamed(uint64_t ns, struct reading *last)
{
    struct mk_frame f;
    hw.sent_size = 0;
    for (uint64_t step = ns / 20; ns > 0; ns -= step)
        pass(step);
    const uint8_t *p = hw.sent;
    size_t n = hw.sent_size;
    int count = 0;
    mk_decoder_reset(&host);
    while (mk_decoder_next(&host, &p, &n, &f)) {
        ck_assert_uint_eq(f.type, MK_MSG_SAMPLE);
        *last = parse(f.payload);
        count++;
    }
    return count;
}

static void command(uint32_t sample, int32_t micro)
{
    uint8_t p[8];
    mk_put32(p, sample);
    mk_put32(p + 4, (uint32_t)micro);
    ck_assert_uint_eq(ask(MK_MSG_COMMAND, p, 8).type, 0);
}

START_TEST(streamed_samples_come_by_the_boards_clock_and_carry_the_answers)
{
    struct reading r;
    greet();
    number(MK_MSG_WATCHDOG, 20);
    number(MK_MSG_STREAM, 1000);
    uint64_t before = hw.now_ns;
    for (uint32_t k = 0; k < 50; k++) {
        ck_assert_int_eq(streamed(k ? MS : 20, &r), 1); /* the first one at once */
        ck_assert_uint_lt(r.t_ns - before - k * MS, MS / 20);
        ck_assert_uint_eq(r.status, MK_WIRE_ST_STREAMING);
        ck_assert_int_eq(r.micro, k ? (int)(k - 1) * 1000 : 0);
        command(k, (int)k * 1000);
    }
    number(MK_MSG_STREAM, 0);
    ck_assert_int_eq(streamed(10 * MS, &r), 0);
}
END_TEST

START_TEST(a_host_that_falls_silent_stops_the_stream_and_the_motor)
{
    struct reading r;
    greet();
    number(MK_MSG_WATCHDOG, 0);
    number(MK_MSG_STREAM, 1000);
    streamed(MS, &r);
    command(0, 5 * VOLT);
    ck_assert_int_eq(hw.micro, 0);
    streamed(MS, &r);
    ck_assert_int_eq(hw.micro, 5 * VOLT);
    ck_assert_int_le(streamed(100 * MS, &r), 9);
    ck_assert_int_eq(hw.micro, 0);
    ck_assert_uint_eq(exchange(VOLT).fault, MK_WIRE_FAULT_STREAM);
}
END_TEST

START_TEST(an_answer_that_waits_for_its_sample_is_guarded_though_nobody_set_the_watchdog)
{
    struct reading r;
    greet();
    number(MK_MSG_STREAM, 1000);
    ck_assert_int_eq(streamed(20, &r), 1);
    command(0, 5 * VOLT);
    pass(30 * MS); /* the board was busy with something else */
    ck_assert_int_eq(hw.micro, 0);
    ck_assert_uint_eq(exchange(VOLT).fault, MK_WIRE_FAULT_WATCHDOG);
}
END_TEST

START_TEST(a_stream_that_begins_anew_drops_the_answer_that_waits)
{
    struct reading r;
    greet();
    number(MK_MSG_WATCHDOG, 0);
    number(MK_MSG_STREAM, 1000);
    ck_assert_int_eq(streamed(20, &r), 1);
    command(0, 5 * VOLT);
    number(MK_MSG_STREAM, 1000);
    ck_assert_int_eq(streamed(20, &r), 1);
    ck_assert_int_eq(hw.micro, 0);
    ck_assert_int_eq(streamed(MS, &r), 1);
    ck_assert_int_eq(hw.micro, 0);
}
END_TEST

START_TEST(an_answer_whose_stream_has_ended_needs_no_guard)
{
    struct reading r;
    greet();
    number(MK_MSG_STREAM, 1000);
    ck_assert_int_eq(streamed(20, &r), 1);
    command(0, 5 * VOLT);
    must(MK_MSG_SAFE, NULL, 0);
    pass(1000 * MS);
    ck_assert_uint_eq(device.fault, MK_WIRE_FAULT_NONE);
}
END_TEST

START_TEST(a_stream_begins_and_ends_with_the_motor_off)
{
    struct reading r;
    greet();
    exchange(5 * VOLT);
    number(MK_MSG_STREAM, 1000);
    ck_assert_int_eq(hw.micro, 0);
    streamed(20, &r);
    command(0, 5 * VOLT);
    streamed(MS, &r);
    ck_assert_int_eq(hw.micro, 5 * VOLT);
    number(MK_MSG_STREAM, 0);
    ck_assert_int_eq(hw.micro, 0);
}
END_TEST

/* The watchdog is fed by what begins a stream, and by each answer. */
START_TEST(a_host_that_answers_its_samples_is_not_missed)
{
    struct reading r;
    greet();
    number(MK_MSG_WATCHDOG, 20);
    pass(15 * MS);
    number(MK_MSG_STREAM, 15000);
    for (uint32_t k = 0; k < 5; k++) {
        ck_assert_int_eq(streamed(k ? 15 * MS : 20, &r), 1);
        command(k, VOLT);
    }
    ck_assert_uint_eq(device.fault, MK_WIRE_FAULT_NONE);
    pass(21 * MS);
    ck_assert_uint_eq(device.fault, MK_WIRE_FAULT_WATCHDOG);
}
END_TEST

/* Eight samples may wait for their answer, and the ninth is not taken. */
START_TEST(as_many_samples_wait_for_an_answer_as_may)
{
    struct reading r;
    greet();
    number(MK_MSG_WATCHDOG, 0);
    number(MK_MSG_STREAM, 1000);
    ck_assert_int_eq(streamed(20, &r), 1);
    for (int k = 1; k < 8; k++)
        ck_assert_int_eq(streamed(MS, &r), 1);
    ck_assert_uint_eq(device.fault, MK_WIRE_FAULT_NONE);
    ck_assert_int_eq(streamed(MS, &r), 0);
    ck_assert_uint_eq(device.fault, MK_WIRE_FAULT_STREAM);
}
END_TEST

START_TEST(an_answer_to_a_sample_that_never_was_is_refused)
{
    uint8_t p[8] = {0};
    struct reading r;
    greet();
    must_refuse(MK_REFUSED_STATE, ask(MK_MSG_COMMAND, p, 8));
    number(MK_MSG_STREAM, 1000);
    ck_assert_int_eq(streamed(20, &r), 1);
    mk_put32(p, 7);
    must_refuse(MK_REFUSED_STATE, ask(MK_MSG_COMMAND, p, 8));
    mk_put32(p, 1); /* the next one */
    must_refuse(MK_REFUSED_STATE, ask(MK_MSG_COMMAND, p, 8));
}
END_TEST

/* --- samples that are late ---------------------------------------------------------------------
 */

/* Whole periods, to the nanosecond: the sample of that moment is the late one. */
START_TEST(of_samples_that_a_busy_board_was_late_for_one_is_taken)
{
    greet();
    number(MK_MSG_WATCHDOG, 0);
    number(MK_MSG_STREAM, 1000);
    pass(0);
    for (uint64_t late = 1; late < 4; late++) {
        pass(late * MS);
        ck_assert_uint_eq(mk_device_next_event(&device), hw.now_ns + MS);
        hw.sent_size = 0;
        pass(0);
        ck_assert_uint_eq(hw.sent_size, 0);
        command(device.stream_sample - 1, 0);
    }
    number(MK_MSG_STREAM, 0);
    ck_assert(mk_standalone_setup(&device.standalone, MK_CONTROLLER_PI_SPEED, 2000, 1));
    must(MK_MSG_START, NULL, 0);
    pass(0);
    for (uint32_t late = 1; late < 4; late++) {
        pass(2 * late * MS);
        ck_assert_uint_eq(mk_device_next_event(&device), hw.now_ns + 2 * MS);
        pass(0);
        ck_assert_uint_eq(device.standalone.recorded, 1 + late);
    }
}
END_TEST

/* --- a clock that the host steps ----------------------------------------------------------------
 */

static int freed;

static void step_to(void *user, uint64_t ns)
{
    struct electronics *e = user;
    for (uint64_t event; (event = mk_device_next_event(&device)) <= ns;) {
        e->now_ns = event > e->now_ns ? event : e->now_ns;
        mk_device_poll(&device);
    }
    e->now_ns = ns > e->now_ns ? ns : e->now_ns;
}

static void run_freely(void *user)
{
    (void)user;
    freed++;
}

static void be_simulated(void)
{
    hal.step = step_to;
    hal.run_freely = run_freely;
    freed = 0;
    greet();
}

static struct mk_frame step(uint64_t ns)
{
    uint8_t p[8];
    mk_put64(p, ns);
    return ask(MK_MSG_STEP, p, sizeof p);
}

static struct mk_frame exchange_at(int32_t micro, uint64_t ns)
{
    uint8_t p[12];
    mk_put32(p, (uint32_t)micro);
    mk_put64(p + 4, ns);
    return ask(MK_MSG_EXCHANGE, p, sizeof p);
}

START_TEST(a_real_board_refuses_to_be_stepped)
{
    greet();
    must_refuse(MK_REFUSED_NOTSUP, step(0));
    must_refuse(MK_REFUSED_LENGTH, exchange_at(VOLT, 0));
    ck_assert_int_eq(hw.micro, 0);
}
END_TEST

START_TEST(a_simulated_board_says_so_and_goes_by_steps)
{
    be_simulated();
    unsigned caps = mk_get32(ask(MK_MSG_HELLO, NULL, 0).payload + MK_HELLO_CAPABILITIES);
    ck_assert_uint_eq(caps, 63 + MK_WIRE_CAP_STEP);
    hw.now_ns = 5 * MS;
    ck_assert_uint_eq(mk_get64(step(0).payload), 5 * MS); /* where it stands */
    ck_assert_uint_eq(mk_get64(step(9 * MS).payload), 9 * MS);
    ck_assert_uint_eq(mk_get64(step(7 * MS).payload), 9 * MS); /* it never goes back */
    struct reading r = parse(exchange_at(3 * VOLT, 11 * MS).payload);
    ck_assert_uint_eq(r.t_ns, 11 * MS);
    ck_assert_int_eq(r.micro, 3 * VOLT);
    must_refuse(MK_REFUSED_RANGE, step(11 * MS + MK_STEP_MAX_NS + 1));
    must_refuse(MK_REFUSED_RANGE, exchange_at(0, UINT64_MAX));
    ck_assert_uint_eq(hw.now_ns, 11 * MS);
    ck_assert_int_eq(hw.micro, 3 * VOLT);
    ck_assert_uint_eq(mk_get64(step(11 * MS + MK_STEP_MAX_NS).payload), 11 * MS + MK_STEP_MAX_NS);
}
END_TEST

START_TEST(what_is_due_within_a_step_is_done_at_its_time)
{
    be_simulated();
    number(MK_MSG_WATCHDOG, 20);
    step(0);
    exchange_at(3 * VOLT, 2 * MS);
    step(500 * MS);
    ck_assert_int_eq(hw.micro, 0);
    ck_assert_uint_eq(device.fault, MK_WIRE_FAULT_WATCHDOG);
    ck_assert_uint_eq(device.fault_ns, 22 * MS + 1);
}
END_TEST

START_TEST(a_step_that_comes_twice_is_one)
{
    uint8_t p[12];
    be_simulated();
    step(0);
    mk_put32(p, 2 * VOLT);
    mk_put64(p + 4, 4 * MS);
    struct reading first = parse(ask(MK_MSG_EXCHANGE, p, 12).payload);
    hw.count[0] = 77;
    struct reading again =
        parse(send_frame(MK_FRAME_VERSION, MK_MSG_EXCHANGE, sequence, p, 12).payload);
    ck_assert_uint_eq(again.exchanges, first.exchanges);
    ck_assert_int_eq(again.count[0], first.count[0]);
}
END_TEST

/* As after a loss of power: the host that stepped learns that nobody follows it any more. */
START_TEST(a_greeting_lets_the_clock_run_and_a_time_is_refused_then)
{
    be_simulated();
    must_refuse(MK_REFUSED_STATE, exchange_at(VOLT, 0));
    step(0);
    exchange_at(VOLT, 0);
    ck_assert_int_eq(freed, 0);
    greet();
    ck_assert_int_eq(freed, 1);
    must_refuse(MK_REFUSED_STATE, exchange_at(VOLT, 0));
    greet();
    ck_assert_int_eq(freed, 1);
    exchange(VOLT); /* without a time, as ever */
}
END_TEST

START_TEST(a_host_that_hangs_up_leaves_the_motor_off_at_once)
{
    be_simulated();
    number(MK_MSG_WATCHDOG, 0);
    step(0);
    exchange_at(4 * VOLT, 1 * MS);
    ck_assert_int_eq(hw.micro, 4 * VOLT);
    mk_device_hang_up(&device);
    ck_assert_int_eq(hw.micro, 0);
    ck_assert_int_eq(freed, 1);
    must_refuse(MK_REFUSED_STATE, ask_number(MK_MSG_EXCHANGE, 0));
    greet();
    exchange(VOLT);
}
END_TEST

START_TEST(a_host_that_has_hung_up_is_not_missed_by_the_watchdog)
{
    greet();
    number(MK_MSG_WATCHDOG, 20);
    exchange(VOLT);
    mk_device_hang_up(&device);
    pass(1000 * MS);
    ck_assert_uint_eq(mk_device_next_event(&device), UINT64_MAX);
    greet();
    ck_assert_uint_eq(exchange(VOLT).fault, MK_WIRE_FAULT_NONE);
    ck_assert_int_eq(hw.micro, VOLT);
}
END_TEST
Suite *suite_device_stream(void)
{
    Suite *s = suite_create("device_stream");
    TCase *t = tcase_create("device_stream");
    tcase_add_checked_fixture(t, set_up_device, NULL);
    tcase_add_test(t, streamed_samples_come_by_the_boards_clock_and_carry_the_answers);
    tcase_add_test(t, a_host_that_falls_silent_stops_the_stream_and_the_motor);
    tcase_add_test(t,
                   an_answer_that_waits_for_its_sample_is_guarded_though_nobody_set_the_watchdog);
    tcase_add_test(t, a_stream_that_begins_anew_drops_the_answer_that_waits);
    tcase_add_test(t, of_samples_that_a_busy_board_was_late_for_one_is_taken);
    tcase_add_test(t, an_answer_to_a_sample_that_never_was_is_refused);
    tcase_add_test(t, an_answer_whose_stream_has_ended_needs_no_guard);
    tcase_add_test(t, a_stream_begins_and_ends_with_the_motor_off);
    tcase_add_test(t, a_host_that_answers_its_samples_is_not_missed);
    tcase_add_test(t, as_many_samples_wait_for_an_answer_as_may);
    tcase_add_test(t, a_real_board_refuses_to_be_stepped);
    tcase_add_test(t, a_simulated_board_says_so_and_goes_by_steps);
    tcase_add_test(t, what_is_due_within_a_step_is_done_at_its_time);
    tcase_add_test(t, a_step_that_comes_twice_is_one);
    tcase_add_test(t, a_greeting_lets_the_clock_run_and_a_time_is_refused_then);
    tcase_add_test(t, a_host_that_hangs_up_leaves_the_motor_off_at_once);
    tcase_add_test(t, a_host_that_has_hung_up_is_not_missed_by_the_watchdog);
    suite_add_tcase(s, t);
    return s;
}
