/* The board's side of the protocol: requests, safety, panel. */
#include "suites.h"

#include <stdlib.h>
#include <string.h>

#include "base/random.h"
#include "support/device_bench.h"

/* --- requests ----------------------------------------------------------------------------------
 */

START_TEST(hello_says_who_is_there)
{
    struct mk_frame f = ask(MK_MSG_HELLO, NULL, 0);
    ck_assert_uint_eq(f.length, MK_HELLO_SIZE);
    ck_assert_uint_eq(f.payload[MK_HELLO_VERSION], MK_FRAME_VERSION);
    ck_assert_uint_eq(f.payload[MK_HELLO_COUNTER_BITS], 24);
    ck_assert_uint_eq(f.payload[MK_HELLO_ENCODERS], 2);
    ck_assert_uint_eq(mk_get32(f.payload + MK_HELLO_CPR + 4), 2000);
    ck_assert_uint_eq(mk_get32(f.payload + MK_HELLO_U_MAX), 10 * VOLT);
    ck_assert_str_eq((const char *)f.payload + MK_HELLO_SERIAL, "MK-7");
    unsigned caps = mk_get32(f.payload + MK_HELLO_CAPABILITIES);
    ck_assert_uint_eq(caps, 63);
}
END_TEST

START_TEST(nothing_moves_before_hello)
{
    must_refuse(MK_REFUSED_STATE, ask_number(MK_MSG_EXCHANGE, 5 * VOLT));
    ck_assert_int_eq(hw.micro, 0);
    greet();
    ck_assert_int_eq(exchange(5 * VOLT).micro, 5 * VOLT);
}
END_TEST

START_TEST(a_board_that_is_switched_on_again_has_forgotten_its_host_and_its_fault)
{
    greet();
    number(MK_MSG_WATCHDOG, 20);
    exchange(5 * VOLT);
    mk_device_trip(&device, MK_WIRE_FAULT_AMPLIFIER);
    hw.micro = 5 * VOLT;
    switch_on();
    ck_assert_int_eq(hw.micro, 0);
    must_refuse(MK_REFUSED_STATE, ask_number(MK_MSG_EXCHANGE, VOLT));
    pass(1000 * MS);
    greet();
    ck_assert_uint_eq(exchange(VOLT).fault, MK_WIRE_FAULT_NONE);
}
END_TEST

START_TEST(a_hello_that_is_refused_is_no_greeting)
{
    uint8_t zeros[17] = {0};
    must_refuse(MK_REFUSED_LENGTH, ask(MK_MSG_HELLO, zeros, sizeof zeros));
    must_refuse(MK_REFUSED_STATE, ask_number(MK_MSG_EXCHANGE, VOLT));
    ck_assert_int_eq(hw.micro, 0);
}
END_TEST

START_TEST(hello_switches_the_motor_off_and_takes_any_sequence)
{
    greet();
    exchange(5 * VOLT);
    sequence = 3;
    greet();
    ck_assert_int_eq(hw.micro, 0);
    ck_assert_int_eq(exchange(1 * VOLT).micro, 1 * VOLT);
}
END_TEST

START_TEST(an_exchange_reads_first_and_commands_then)
{
    greet();
    hw.count[0] = 17;
    hw.count[1] = -5;
    hw.now_ns = 42;
    struct reading r = exchange(-3 * VOLT);
    ck_assert_int_eq(r.count[0], 17);
    ck_assert_int_eq(r.count[1], -5);
    ck_assert_uint_eq(r.t_ns, 42);
    ck_assert_int_eq(r.micro, -3 * VOLT);
    ck_assert_uint_eq(r.status, 0);
    ck_assert_uint_eq(exchange(0).exchanges, r.exchanges + 1);
    must(MK_MSG_ZERO, NULL, 0);
    ck_assert_int_eq(exchange(0).count[0], 0);
}
END_TEST

START_TEST(commands_are_cut_at_the_limit_and_the_status_says_so)
{
    greet();
    struct reading r = exchange(INT32_MAX);
    ck_assert_int_eq(r.micro, 10 * VOLT);
    ck_assert_uint_eq(r.status, MK_WIRE_ST_SATURATED);
    ck_assert_int_eq(exchange(INT32_MIN).micro, -10 * VOLT);
    hw.weak = 2 * VOLT;
    r = exchange(5 * VOLT);
    ck_assert_int_eq(r.micro, 2 * VOLT);
    ck_assert_uint_eq(r.status, MK_WIRE_ST_SATURATED);
}
END_TEST

START_TEST(a_repeated_request_is_answered_again_but_acts_once)
{
    greet();
    uint8_t p[4];
    mk_put32(p, VOLT);
    uint32_t seq = ++sequence;
    uint32_t first = parse(send_frame(1, MK_MSG_EXCHANGE, seq, p, 4).payload).exchanges;
    hw.count[0] = 99;
    struct reading again = parse(send_frame(1, MK_MSG_EXCHANGE, seq, p, 4).payload);
    ck_assert_uint_eq(again.exchanges, first);
    ck_assert_int_eq(again.count[0], 0);
    ck_assert_uint_eq(exchange(0).exchanges, first + 1);
}
END_TEST

START_TEST(a_late_request_does_not_undo_a_newer_one)
{
    greet();
    uint8_t p[4];
    mk_put32(p, 9 * VOLT);
    uint32_t old = ++sequence;
    exchange(1 * VOLT);
    ck_assert_uint_eq(send_frame(1, MK_MSG_EXCHANGE, old, p, 4).type, 0);
    ck_assert_int_eq(hw.micro, 1 * VOLT);
    ck_assert_uint_eq(mk_get32(ask(MK_MSG_STATE, NULL, 0).payload + MK_STATE_STALE), 1);
}
END_TEST

START_TEST(sequence_numbers_may_wrap)
{
    sequence = UINT32_MAX - 2;
    greet();
    for (int k = 0; k < 6; k++)
        ck_assert_int_eq(exchange(k * VOLT).micro, k * VOLT);
}
END_TEST

START_TEST(another_version_is_refused_with_the_motor_off)
{
    greet();
    exchange(5 * VOLT);
    struct mk_frame f = send_frame(2, MK_MSG_EXCHANGE, ++sequence, NULL, 0);
    must_refuse(MK_REFUSED_VERSION, f);
    ck_assert_uint_eq(f.payload[2], MK_FRAME_VERSION);
    ck_assert_int_eq(hw.micro, 0);
}
END_TEST

START_TEST(what_is_no_request_is_refused_by_name)
{
    uint8_t zeros[32] = {0};
    greet();
    must_refuse(MK_REFUSED_UNKNOWN, ask((enum mk_message)0x7e, NULL, 0));
    must_refuse(MK_REFUSED_LENGTH, ask(MK_MSG_EXCHANGE, zeros, 3));
    must_refuse(MK_REFUSED_LENGTH, ask(MK_MSG_EXCHANGE, zeros, 5));
    must_refuse(MK_REFUSED_LENGTH, ask(MK_MSG_LCD, zeros, 22));
    must_refuse(MK_REFUSED_RANGE, ask_number(MK_MSG_WATCHDOG, MK_WATCHDOG_MAX_MS + 1));
    must_refuse(MK_REFUSED_RANGE, ask_number(MK_MSG_STREAM, MK_STREAM_MIN_US - 1));
}
END_TEST

static bool takes(struct mk_frame f)
{
    return (f.type & MK_MSG_ANSWER) && f.type != MK_MSG_REFUSED;
}

static struct mk_frame ask_setup(uint8_t controller, uint8_t record_every, uint32_t period_us)
{
    uint8_t p[8] = {controller, record_every};
    mk_put32(p + 4, period_us);
    return ask(MK_MSG_SETUP, p, sizeof p);
}

START_TEST(what_is_at_a_bound_is_taken_and_what_is_beyond_it_is_not)
{
    static const struct {
        uint32_t us;
        bool taken;
    } rows[] = {{MK_STREAM_MIN_US - 1, false},
                {MK_STREAM_MIN_US, true},
                {MK_STREAM_MAX_US, true},
                {MK_STREAM_MAX_US + 1, false}};
    greet();
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        ck_assert_int_eq(takes(ask_number(MK_MSG_STREAM, rows[i].us)), rows[i].taken);
        pass(0); /* its first sample, if it has one */
        must(MK_MSG_SAFE, NULL, 0);
        ck_assert_int_eq(takes(ask_setup(MK_CONTROLLER_PI_SPEED, 1, rows[i].us)), rows[i].taken);
    }
    must_refuse(MK_REFUSED_RANGE, ask_setup(MK_CONTROLLER_PI_SPEED, 0, 1000));
    must_refuse(MK_REFUSED_RANGE, ask_setup(MK_CONTROLLER_COUNT, 1, 1000));
    ck_assert(takes(ask(MK_MSG_LCD, (const uint8_t *)"\001\x1f \x7e\x7f", 5)));
    ck_assert_str_eq(hw.lcd[1], "? ~?");
    ck_assert(takes(ask(MK_MSG_LCD, (const uint8_t *)"\000twenty characters...", 21)));
    ck_assert_str_eq(hw.lcd[0], "twenty characters...");
}
END_TEST

static struct mk_frame ask_gain(uint8_t first, float value)
{
    uint8_t p[6] = {first, 1};
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    mk_put32(p + 2, bits);
    return ask(MK_MSG_GAINS, p, sizeof p);
}

START_TEST(gains_are_as_many_as_the_controller_has_and_no_larger_than_they_may_be)
{
    const float most = 9.9e8f;
    greet();
    ck_assert_uint_eq(ask_setup(MK_CONTROLLER_PI_SPEED, 1, 1000).payload[0], 3);
    ck_assert(takes(ask_gain(2, most)) && takes(ask_gain(2, -most)));
    ck_assert(device.standalone.gain[2] == -most);
    must_refuse(MK_REFUSED_RANGE, ask_gain(3, 1.0f));
    must_refuse(MK_REFUSED_RANGE, ask_gain(2, 1e9f));
    must_refuse(MK_REFUSED_RANGE, ask_gain(2, -1e9f));
    ck_assert(device.standalone.gain[2] == -most);
}
END_TEST

static struct mk_frame ask_records(uint32_t first, uint8_t n)
{
    uint8_t p[5];
    mk_put32(p, first);
    p[4] = n;
    return ask(MK_MSG_UPLOAD, p, sizeof p);
}

START_TEST(records_come_from_the_one_that_was_asked_for_on)
{
    greet();
    ck_assert(takes(ask_setup(MK_CONTROLLER_PI_SPEED, 1, 1000)));
    must(MK_MSG_START, NULL, 0);
    for (int k = 0; k < 5; k++) {
        hw.count[0] = 10 + k;
        pass(k ? MS : 0);
    }
    must(MK_MSG_HALT, NULL, 0);
    ck_assert_uint_eq(device.standalone.recorded, 5);
    struct mk_frame f = ask_records(2, 2);
    ck_assert_uint_eq(mk_get32(f.payload), 2);
    ck_assert_uint_eq(f.payload[4], 2);
    ck_assert_uint_eq(f.length, MK_UPLOAD_HEADER + 2 * MK_RECORD_SIZE);
    ck_assert_uint_eq(mk_get32(f.payload + MK_UPLOAD_HEADER + 4), 12);
    ck_assert_uint_eq(ask_records(2, MK_UPLOAD_MAX).payload[4], 3); /* all that there are */
    ck_assert_uint_eq(ask_records(5, 1).payload[4], 0);
    must_refuse(MK_REFUSED_RANGE, ask_records(6, 1));
    must_refuse(MK_REFUSED_RANGE, ask_records(0, MK_UPLOAD_MAX + 1));
}
END_TEST

/* Neither a run nor a stream begins in the other, and none of them while a fault is there. */
START_TEST(what_cannot_be_now_is_refused_and_changes_nothing)
{
    greet();
    must_refuse(MK_REFUSED_STATE, ask(MK_MSG_START, NULL, 0)); /* of what? */
    ck_assert(takes(ask_setup(MK_CONTROLLER_PI_SPEED, 1, 1000)));
    number(MK_MSG_STREAM, 1000);
    pass(0);
    must_refuse(MK_REFUSED_STATE, ask(MK_MSG_START, NULL, 0));
    must_refuse(MK_REFUSED_STATE, ask_setup(MK_CONTROLLER_PI_SPEED, 1, 1000));
    number(MK_MSG_STREAM, 0);
    must(MK_MSG_START, NULL, 0);
    must_refuse(MK_REFUSED_STATE, ask(MK_MSG_START, NULL, 0));
    must_refuse(MK_REFUSED_STATE, ask_setup(MK_CONTROLLER_PI_SPEED, 1, 1000));
    must_refuse(MK_REFUSED_STATE, ask_number(MK_MSG_STREAM, 1000));
    must_refuse(MK_REFUSED_STATE, ask(MK_MSG_ZERO, NULL, 0));
    ck_assert(device.standalone.running);
    must(MK_MSG_HALT, NULL, 0);
    mk_device_trip(&device, MK_WIRE_FAULT_AMPLIFIER);
    must_refuse(MK_REFUSED_STATE, ask(MK_MSG_START, NULL, 0));
    must(MK_MSG_CLEAR, NULL, 0);
    must(MK_MSG_START, NULL, 0);
    must(MK_MSG_HALT, NULL, 0);
    device.info.cpr[0] = 0;
    must_refuse(MK_REFUSED_NOTSUP, ask_setup(MK_CONTROLLER_PI_SPEED, 1, 1000));
}
END_TEST

START_TEST(a_host_of_another_version_has_to_greet_anew)
{
    greet();
    must_refuse(MK_REFUSED_VERSION, send_frame(2, MK_MSG_EXCHANGE, ++sequence, NULL, 0));
    must_refuse(MK_REFUSED_STATE, ask_number(MK_MSG_EXCHANGE, VOLT));
    greet();
    ck_assert_int_eq(exchange(VOLT).micro, VOLT);
}
END_TEST

START_TEST(what_has_no_answer_has_none_when_it_comes_again)
{
    uint8_t p[8] = {0};
    greet();
    number(MK_MSG_STREAM, 1000);
    pass(0);
    ck_assert_uint_eq(ask(MK_MSG_COMMAND, p, sizeof p).type, 0);
    ck_assert_uint_eq(send_frame(MK_FRAME_VERSION, MK_MSG_COMMAND, sequence, p, sizeof p).type, 0);
    ck_assert_uint_eq(device.repeated, 1);
}
END_TEST

/* --- safety ------------------------------------------------------------------------------------
 */

START_TEST(the_watchdog_zeroes_and_stays_until_it_is_set_anew)
{
    greet();
    number(MK_MSG_WATCHDOG, 20);
    exchange(5 * VOLT);
    pass(20 * MS);
    ck_assert_int_eq(hw.micro, 5 * VOLT);
    ck_assert_uint_eq(mk_device_next_event(&device), hw.now_ns + 1);
    pass(1);
    ck_assert_int_eq(hw.micro, 0);
    struct reading r = exchange(5 * VOLT);
    ck_assert_uint_eq(r.status & MK_WIRE_ST_WATCHDOG, MK_WIRE_ST_WATCHDOG);
    ck_assert_uint_eq(r.fault, MK_WIRE_FAULT_WATCHDOG);
    ck_assert_int_eq(hw.micro, 0);
    ck_assert_uint_eq(mk_get32(ask(MK_MSG_STATE, NULL, 0).payload + MK_STATE_BITES), 1);
    number(MK_MSG_WATCHDOG, 0);
    ck_assert_int_eq(exchange(5 * VOLT).micro, 5 * VOLT);
    pass(3600000 * MS);
    ck_assert_int_eq(hw.micro, 5 * VOLT);
}
END_TEST

START_TEST(a_host_that_set_no_watchdog_is_guarded_all_the_same)
{
    greet();
    number(MK_MSG_WATCHDOG, 0); /* of an earlier host, which is gone */
    greet();
    exchange(0);
    pass(1000 * MS); /* a motor that is off needs no guard */
    ck_assert_uint_eq(exchange(5 * VOLT).status, 0);
    pass(MK_WATCHDOG_DEFAULT_MS * MS);
    ck_assert_int_eq(hw.micro, 5 * VOLT);
    ck_assert_uint_eq(mk_device_next_event(&device), hw.now_ns + 1);
    pass(1);
    ck_assert_int_eq(hw.micro, 0);
    ck_assert_uint_eq(exchange(5 * VOLT).fault, MK_WIRE_FAULT_WATCHDOG);
}
END_TEST

START_TEST(the_longest_watchdog_is_taken_and_a_longer_one_is_refused)
{
    greet();
    number(MK_MSG_WATCHDOG, MK_WATCHDOG_MAX_MS);
    must_refuse(MK_REFUSED_RANGE, ask_number(MK_MSG_WATCHDOG, MK_WATCHDOG_MAX_MS + 1));
}
END_TEST

START_TEST(a_watchdog_that_is_set_begins_to_count_then)
{
    greet();
    pass(1000 * MS);
    number(MK_MSG_WATCHDOG, 20);
    pass(20 * MS);
    ck_assert_uint_eq(device.fault, MK_WIRE_FAULT_NONE);
    pass(1);
    ck_assert_uint_eq(device.fault, MK_WIRE_FAULT_WATCHDOG);
}
END_TEST

START_TEST(a_watchdog_that_has_bitten_says_so_alone)
{
    greet();
    number(MK_MSG_WATCHDOG, 20);
    pass(20 * MS + 1);
    ck_assert_uint_eq(exchange(0).status, MK_WIRE_ST_WATCHDOG);
    number(MK_MSG_WATCHDOG, 20);
    struct reading r = exchange(0);
    ck_assert_uint_eq(r.status, 0);
    ck_assert_uint_eq(r.fault, MK_WIRE_FAULT_NONE);
    mk_device_trip(&device, MK_WIRE_FAULT_AMPLIFIER);
    number(MK_MSG_WATCHDOG, 20);
    ck_assert_uint_eq(exchange(0).fault, MK_WIRE_FAULT_AMPLIFIER); /* that is not its own */
}
END_TEST

START_TEST(a_fault_that_is_cleared_gives_the_host_its_time_again)
{
    greet();
    number(MK_MSG_WATCHDOG, 20);
    pass(1000 * MS);
    must(MK_MSG_CLEAR, NULL, 0);
    pass(20 * MS);
    ck_assert_uint_eq(device.fault, MK_WIRE_FAULT_NONE);
    pass(1);
    ck_assert_uint_eq(device.fault, MK_WIRE_FAULT_WATCHDOG);
}
END_TEST

START_TEST(only_exchanges_feed_the_watchdog)
{
    greet();
    number(MK_MSG_WATCHDOG, 20);
    exchange(5 * VOLT);
    for (int k = 0; k < 6; k++) {
        pass(5 * MS);
        ask(MK_MSG_STATE, NULL, 0);
    }
    ck_assert_int_eq(hw.micro, 0);
}
END_TEST

START_TEST(a_fault_keeps_cause_and_time_until_it_is_cleared)
{
    greet();
    exchange(5 * VOLT);
    hw.now_ns = 777;
    hw.alarm = MK_WIRE_FAULT_AMPLIFIER;
    mk_device_poll(&device);
    ck_assert_int_eq(hw.micro, 0);
    hw.alarm = 0;
    hw.now_ns = 5000;
    mk_device_trip(&device, MK_WIRE_FAULT_LINE); /* later: does not replace the first */
    struct reading r = exchange(5 * VOLT);
    ck_assert_uint_eq(r.status, MK_WIRE_ST_FAULT | MK_WIRE_ST_SATURATED);
    ck_assert_int_eq(r.micro, 0);
    struct mk_frame f = ask(MK_MSG_STATE, NULL, 0);
    ck_assert_uint_eq(mk_get16(f.payload + MK_STATE_FAULT), MK_WIRE_FAULT_AMPLIFIER);
    ck_assert_uint_eq(mk_get64(f.payload + MK_STATE_FAULT_TIME), 777);
    must(MK_MSG_CLEAR, NULL, 0);
    ck_assert_int_eq(hw.micro, 0);
    ck_assert_int_eq(exchange(5 * VOLT).micro, 5 * VOLT);
}
END_TEST

static void send_broken(void)
{
    uint8_t bytes[MK_FRAME_MAX], p[4] = {0};
    const struct mk_frame f = {1, MK_MSG_EXCHANGE, 4, ++sequence, p};
    size_t n = mk_frame_encode(&f, bytes);
    bytes[n - 1] ^= 1;
    mk_device_receive(&device, bytes, n);
}

START_TEST(a_storm_of_broken_frames_is_a_fault_and_a_rare_one_is_not)
{
    greet();
    for (int k = 0; k < 400; k++) {
        exchange(5 * VOLT);
        if (k % 20 == 0)
            send_broken();
    }
    ck_assert_int_eq(hw.micro, 5 * VOLT);
    int storm = 0;
    while (hw.micro != 0 && storm < 100) {
        exchange(5 * VOLT);
        exchange(5 * VOLT);
        send_broken();
        storm++;
    }
    ck_assert_int_le(storm, 12);
    ck_assert_uint_eq(exchange(0).fault, MK_WIRE_FAULT_LINE);
    must(MK_MSG_CLEAR, NULL, 0); /* and the storm is forgotten */
    ck_assert_int_eq(exchange(VOLT).micro, VOLT);
}
END_TEST

START_TEST(a_greeting_forgets_the_broken_frames_of_an_earlier_host)
{
    for (int k = 0; k < 3; k++) {
        greet();
        for (int i = 0; i < 6; i++)
            send_broken();
    }
    ck_assert_uint_eq(exchange(VOLT).fault, MK_WIRE_FAULT_NONE);
    ck_assert_int_eq(hw.micro, VOLT);
}
END_TEST

/* Bytes of any kind: whatever they are, the command stays within its limit (apply checks), and
 * hello brings the board back. */
START_TEST(no_bytes_whatever_upset_the_board)
{
    static const uint8_t types[] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 16, 17, 18, 19, 20, 99};
    struct mk_random rng = {.state = 5};
    for (int k = 0; k < 60000; k++) {
        uint8_t payload[64], bytes[MK_FRAME_MAX];
        uint64_t r = mk_random_next(&rng);
        for (size_t i = 0; i < sizeof payload; i++)
            payload[i] = r >> 62 ? (uint8_t)mk_random_next(&rng) : (uint8_t)(r >> 40 & 3);
        const struct mk_frame f = {1, types[r % sizeof types], (uint16_t)(r >> 8 & 31),
                                   sequence += (r >> 16 & 7) > 0, payload};
        size_t n = mk_frame_encode(&f, bytes);
        if ((r >> 20 & 31) == 0)
            bytes[(r >> 25) % n] ^= (uint8_t)(1u << (r >> 33 & 7));
        hw.sent_size = 0;
        mk_device_receive(&device, bytes, (r >> 50 & 63) == 0 ? n / 2 : n);
        hw.sent_size = 0;
        hw.now_ns += r >> 45 & 0xfffff;
        mk_device_poll(&device);
    }
    hw.sent_size = 0;
    for (int k = 0; k < 3; k++) /* bytes of a frame cut short may swallow the first */
        ask(MK_MSG_HELLO, NULL, 0);
    must(MK_MSG_CLEAR, NULL, 0);
    must(MK_MSG_HELLO, NULL, 0);
    number(MK_MSG_WATCHDOG, 0);
    ck_assert_int_eq(exchange(VOLT).micro, VOLT);
}
END_TEST

/* --- panel -------------------------------------------------------------------------------------
 */

START_TEST(display_lights_and_switches_are_at_hand)
{
    greet();
    must(MK_MSG_LCD, (const uint8_t *)"\001balanced \x90", 11);
    ck_assert_str_eq(hw.lcd[1], "balanced ?");
    must_refuse(MK_REFUSED_RANGE, ask(MK_MSG_LCD, (const uint8_t *)"\002x", 2));
    must(MK_MSG_LEDS, (const uint8_t *)"\005", 1);
    ck_assert_uint_eq(hw.leds, 5);
    hw.switches = 6;
    ck_assert_uint_eq(ask(MK_MSG_STATE, NULL, 0).payload[MK_STATE_SWITCHES], 6);
}
END_TEST

/* A board's memory is not told: neither switches that are not there nor what is kept for later. */
START_TEST(what_a_state_has_no_value_for_is_0)
{
    hal.switches = NULL;
    memset(device.info.product, 'x', MK_HELLO_TEXT);
    memset(device.info.firmware, 'x', MK_HELLO_TEXT);
    memset(device.info.serial, 'x', MK_HELLO_TEXT);
    must(MK_MSG_HELLO, NULL, 0); /* its answer is longer, and was made where this one is */
    struct mk_frame f = ask(MK_MSG_STATE, NULL, 0);
    ck_assert_uint_eq(f.length, MK_STATE_SIZE);
    ck_assert_uint_eq(f.payload[MK_STATE_SWITCHES], 0);
    ck_assert_uint_eq(f.payload[MK_STATE_SIZE - 1], 0);
}
END_TEST

START_TEST(a_board_without_a_panel_says_so)
{
    hal.lcd = NULL;
    hal.leds = NULL;
    hal.switches = NULL;
    struct mk_frame f = ask(MK_MSG_HELLO, NULL, 0);
    ck_assert_uint_eq(mk_get32(f.payload + MK_HELLO_CAPABILITIES) & 28, 0);
    must_refuse(MK_REFUSED_NOTSUP, ask(MK_MSG_LCD, (const uint8_t *)"\001", 1));
    must_refuse(MK_REFUSED_NOTSUP, ask(MK_MSG_LEDS, (const uint8_t *)"\001", 1));
}
END_TEST
Suite *suite_device(void)
{
    Suite *s = suite_create("device");
    TCase *t = tcase_create("device");
    tcase_add_checked_fixture(t, set_up_device, NULL);
    tcase_add_test(t, hello_says_who_is_there);
    tcase_add_test(t, nothing_moves_before_hello);
    tcase_add_test(t, a_board_that_is_switched_on_again_has_forgotten_its_host_and_its_fault);
    tcase_add_test(t, a_hello_that_is_refused_is_no_greeting);
    tcase_add_test(t, hello_switches_the_motor_off_and_takes_any_sequence);
    tcase_add_test(t, an_exchange_reads_first_and_commands_then);
    tcase_add_test(t, commands_are_cut_at_the_limit_and_the_status_says_so);
    tcase_add_test(t, a_repeated_request_is_answered_again_but_acts_once);
    tcase_add_test(t, a_late_request_does_not_undo_a_newer_one);
    tcase_add_test(t, sequence_numbers_may_wrap);
    tcase_add_test(t, another_version_is_refused_with_the_motor_off);
    tcase_add_test(t, what_is_no_request_is_refused_by_name);
    tcase_add_test(t, what_is_at_a_bound_is_taken_and_what_is_beyond_it_is_not);
    tcase_add_test(t, gains_are_as_many_as_the_controller_has_and_no_larger_than_they_may_be);
    tcase_add_test(t, records_come_from_the_one_that_was_asked_for_on);
    tcase_add_test(t, what_cannot_be_now_is_refused_and_changes_nothing);
    tcase_add_test(t, a_host_of_another_version_has_to_greet_anew);
    tcase_add_test(t, what_has_no_answer_has_none_when_it_comes_again);
    tcase_add_test(t, a_watchdog_that_has_bitten_says_so_alone);
    tcase_add_test(t, a_fault_that_is_cleared_gives_the_host_its_time_again);
    tcase_add_test(t, the_watchdog_zeroes_and_stays_until_it_is_set_anew);
    tcase_add_test(t, a_host_that_set_no_watchdog_is_guarded_all_the_same);
    tcase_add_test(t, the_longest_watchdog_is_taken_and_a_longer_one_is_refused);
    tcase_add_test(t, a_watchdog_that_is_set_begins_to_count_then);
    tcase_add_test(t, only_exchanges_feed_the_watchdog);
    tcase_add_test(t, a_fault_keeps_cause_and_time_until_it_is_cleared);
    tcase_add_test(t, a_storm_of_broken_frames_is_a_fault_and_a_rare_one_is_not);
    tcase_add_test(t, a_greeting_forgets_the_broken_frames_of_an_earlier_host);
    tcase_add_test(t, no_bytes_whatever_upset_the_board);
    tcase_add_test(t, display_lights_and_switches_are_at_hand);
    tcase_add_test(t, what_a_state_has_no_value_for_is_0);
    tcase_add_test(t, a_board_without_a_panel_says_so);
    suite_add_tcase(s, t);
    return s;
}
