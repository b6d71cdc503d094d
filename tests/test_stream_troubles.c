/* Every kind of request to a board behind a line, with every kind of trouble: each ends in time and
 * with a name, and the motor, looked at on the far side, goes off. The board is an emulated one on
 * the clock of the test (support/remote.h), or with a clock of its own that the host steps. */
#include "suites.h"

#include "driver/wire.h"
#include "support/remote.h"
#include "support/wall.h"

/* The board is told to drive, and has a watchdog of 20 ms. */
static void drive(double u, struct mk_board_sample *s)
{
    remote_must(remote.board->ops->set_watchdog(remote.board, 20, &remote.err));
    remote_must(mk_board_exchange(remote.board, u, s));
}

/* --- every kind of request, every kind of trouble -------------------------------------------- */

static enum mk_status do_hello(struct mk_wire *w)
{
    return mk_wire_request(w, MK_MSG_HELLO, NULL, 0, 3, 40000000, NULL);
}
static enum mk_status do_zero(struct mk_wire *w)
{
    (void)w;
    return remote.board->ops->zero_counters(remote.board, &remote.err);
}
static enum mk_status do_watchdog(struct mk_wire *w)
{
    (void)w;
    return remote.board->ops->set_watchdog(remote.board, 20, &remote.err);
}
static enum mk_status do_exchange(struct mk_wire *w)
{
    struct mk_board_sample s;
    (void)w;
    return mk_board_exchange(remote.board, 2.0, &s);
}
static enum mk_status do_safe(struct mk_wire *w)
{
    (void)w;
    return remote.board->ops->safe_state(remote.board);
}
static enum mk_status do_clear(struct mk_wire *w)
{
    return mk_wire_clear(w, &remote.err);
}
static enum mk_status do_state(struct mk_wire *w)
{
    struct mk_wire_state s;
    return mk_wire_state(w, &s, &remote.err);
}
static enum mk_status do_lcd(struct mk_wire *w)
{
    return mk_wire_lcd(w, 0, "hello", &remote.err);
}
static enum mk_status do_leds(struct mk_wire *w)
{
    return mk_wire_leds(w, 5, &remote.err);
}
static enum mk_status do_stream(struct mk_wire *w)
{
    (void)w;
    return remote.board->ops->stream(remote.board, 2000, &remote.err);
}
static enum mk_status do_command(struct mk_wire *w)
{
    struct mk_wire_reading r;
    uint32_t number;
    enum mk_status st = mk_wire_answer_sample(w, 0, 2.0);
    return st == MK_OK ? mk_wire_next_sample(w, 20000000, &number, &r) : st;
}
static enum mk_status do_setup(struct mk_wire *w)
{
    int gains;
    return mk_wire_setup(w, MK_CONTROLLER_PI_SPEED, 2000, 1, &gains, &remote.err);
}
static enum mk_status do_gains(struct mk_wire *w)
{
    const float gains[3] = {0.2f, 1.0f, 30.0f};
    return mk_wire_gains(w, 0, gains, 3, &remote.err);
}
static enum mk_status do_start(struct mk_wire *w)
{
    return mk_wire_start(w, &remote.err);
}
static enum mk_status do_halt(struct mk_wire *w)
{
    return mk_wire_halt(w, &remote.err);
}
static enum mk_status do_upload(struct mk_wire *w)
{
    struct mk_standalone_record r[4];
    int got;
    return mk_wire_upload(w, 0, r, 4, &got, &remote.err);
}

/* What has to come before it, none of it in trouble. */
enum before { DRIVEN, STREAMING, SET_UP, STARTED };

static const struct {
    const char *name;
    enum mk_status (*ask)(struct mk_wire *w);
    enum before before;
    bool once; /* tried once: one fault is enough */
} requests[] = {
    {"hello", do_hello, DRIVEN, false},       {"zero", do_zero, DRIVEN, false},
    {"watchdog", do_watchdog, DRIVEN, false}, {"exchange", do_exchange, DRIVEN, true},
    {"safe", do_safe, DRIVEN, false},         {"clear", do_clear, DRIVEN, false},
    {"state", do_state, DRIVEN, false},       {"lcd", do_lcd, DRIVEN, false},
    {"leds", do_leds, DRIVEN, false},         {"stream", do_stream, DRIVEN, false},
    {"command", do_command, STREAMING, true}, {"setup", do_setup, DRIVEN, false},
    {"gains", do_gains, SET_UP, false},       {"start", do_start, SET_UP, false},
    {"halt", do_halt, STARTED, false},        {"upload", do_upload, STARTED, false},
};
#define REQUESTS (sizeof requests / sizeof requests[0])

static const enum emu_fault troubles[] = {
    EMU_FAULT_UNPLUG,       EMU_FAULT_STALL_OUT,    EMU_FAULT_STALL_IN,    EMU_FAULT_SHORT_REQUEST,
    EMU_FAULT_SHORT_ANSWER, EMU_FAULT_FLIP_REQUEST, EMU_FAULT_FLIP_ANSWER, EMU_FAULT_LATE_ANSWER,
    EMU_FAULT_OVERFLOW,     EMU_FAULT_BLOCK_OUT};
#define TROUBLES ((int)(sizeof troubles / sizeof troubles[0]))

/* The motor drives, by the host or by the board's own controller. */
static void prepare(struct mk_wire *w, enum before before)
{
    struct mk_board_sample s;
    drive(2.0, &s);
    if (before == STREAMING)
        remote_must(remote.board->ops->stream(remote.board, 2000, &remote.err));
    if (before == STREAMING)
        remote_must(mk_board_exchange(remote.board, 2.0, &s));
    if (before >= SET_UP) {
        remote_must(do_setup(w));
        remote_must(do_gains(w));
    }
    if (before == STARTED) {
        remote_must(do_start(w));
        mk_clock_sleep_until(&remote.clock, mk_clock_now_ns(&remote.clock) + 10000000);
    }
    ck_assert_int_eq(mk_emulated_run(&remote.bench.board), MK_OK);
    if (before != STREAMING)
        ck_assert_double_ne(remote.bench.board.u, 0.0);
}

/* The host says no more: the far side by itself, as long as the watchdog may take. */
static void the_motor_goes_off(const char *request, enum emu_fault fault)
{
    mk_clock_sleep_until(&remote.clock, mk_clock_now_ns(&remote.clock) + 21000000);
    ck_assert_int_eq(mk_emulated_run(&remote.bench.board), MK_OK);
    ck_assert_msg(remote.bench.board.u == 0.0, "%s at '%s': the motor is on", emu_fault_text(fault),
                  request);
}

START_TEST(trouble_at_any_kind_of_request_ends_in_time_with_a_name_and_the_motor_off)
{
    enum emu_fault fault = troubles[_i % TROUBLES];
    const char *line = _i / TROUBLES ? "serial" : "tcp";
    for (size_t k = 0; k < 2 * REQUESTS; k++) {
        size_t r = k / 2;
        bool for_good = k % 2;
        remote_sit_at(line);
        struct mk_wire *w = mk_wire_of(remote.board);
        prepare(w, requests[r].before);
        emu_line_arm(remote.bench.line, fault, 0, for_good ? 1000 : 1);
        double start = wall_s();
        enum mk_status st = requests[r].ask(w);
        ck_assert_msg(remote.bench.line->injected > 0, "%s at '%s' was not tried",
                      emu_fault_text(fault), requests[r].name);
        ck_assert_double_le(wall_s() - start, 1.0);
        if (fault == EMU_FAULT_UNPLUG)
            ck_assert_msg(st == MK_ERR_NODEV, "unplugged at '%s': %s", requests[r].name,
                          mk_status_name(st));
        else if (!for_good && !requests[r].once)
            ck_assert_msg(st == MK_OK, "once %s at '%s': %s", emu_fault_text(fault),
                          requests[r].name, mk_status_name(st));
        if (fault == EMU_FAULT_UNPLUG) /* and what comes after it */
            ck_assert_int_eq(do_safe(w), MK_ERR_NODEV);
        the_motor_goes_off(requests[r].name, fault);
        remote_teardown();
        remote_setup();
    }
}
END_TEST

/* A board that forgot its host refuses exchanges, as after a restart; one that lies goes on
 * driving. The line is there, so SAFE goes out. */
START_TEST(a_board_that_refuses_every_exchange_is_told_to_take_the_motor_off)
{
    struct mk_board_sample s;
    remote_sit_at("tcp");
    remote_must(remote.board->ops->set_watchdog(remote.board, 0, &remote.err));
    remote_must(mk_board_exchange(remote.board, 2.0, &s));
    mk_wire_of(remote.board)->gone = true; /* what such a refusal is taken for */
    remote.board->gone = true;
    ck_assert_int_eq(mk_board_exchange(remote.board, 2.0, &s), MK_ERR_NODEV);
    ck_assert_double_eq(remote.bench.board.u, 2.0);
    remote_must(do_safe(mk_wire_of(remote.board)));
    ck_assert_double_eq(remote.bench.board.u, 0.0);
}
END_TEST

/* --- a clock that is stepped ----------------------------------------------------------------- */

static void pass_ms(int ms)
{
    mk_clock_sleep_until(&remote.clock, mk_clock_now_ns(&remote.clock) + ms * INT64_C(1000000));
}

START_TEST(trouble_with_a_step_costs_one_sample_and_the_clocks_stay_together)
{
    static const enum emu_fault once[] = {EMU_FAULT_LOSE_REQUEST, EMU_FAULT_LOSE_ANSWER,
                                          EMU_FAULT_FLIP_REQUEST, EMU_FAULT_SHORT_ANSWER,
                                          EMU_FAULT_TWICE_REQUEST};
    struct mk_board_sample first, s;
    remote_sit_at("tcp-stepped");
    drive(1.0, &first);
    int64_t start_ns = mk_clock_now_ns(&remote.clock);
    emu_line_arm(remote.bench.line, once[_i], 1, 1);
    for (int k = 1, lost = 0; k <= 8; k++) {
        pass_ms(2);
        enum mk_status st = mk_board_exchange(remote.board, 1.0, &s);
        lost += st != MK_OK;
        ck_assert_int_le(lost, once[_i] != EMU_FAULT_TWICE_REQUEST);
        if (st == MK_OK)
            ck_assert_int_eq(s.board_ns - first.board_ns,
                             mk_clock_now_ns(&remote.clock) - start_ns);
    }
    ck_assert_uint_eq(remote.bench.line->injected, 1);
    ck_assert_double_eq(remote.bench.board.u, 1.0);
}
END_TEST

/* Time stands for the board as long as nobody steps it; that the line has closed it sees all the
 * same (test_serve), and the host that comes next finds the motor off. */
START_TEST(a_stepped_board_that_is_unplugged_is_gone_at_any_kind_of_request)
{
    for (size_t r = 0; r < REQUESTS; r++) {
        if (requests[r].before == STREAMING || requests[r].ask == do_hello)
            continue;
        remote_sit_at("tcp-stepped");
        struct mk_wire *w = mk_wire_of(remote.board);
        struct mk_board_sample s;
        drive(2.0, &s);
        pass_ms(2);
        emu_line_arm(remote.bench.line, EMU_FAULT_UNPLUG, 0, 1);
        ck_assert_msg(requests[r].ask(w) == MK_ERR_NODEV, "%s", requests[r].name);
        ck_assert_int_eq(do_safe(w), MK_ERR_NODEV);
        remote_close();
        emu_bench_plug(&remote.bench);
        remote_must(remote_open());
        ck_assert_double_eq(remote.bench.board.u, 0.0);
        remote_teardown();
        remote_setup();
    }
}
END_TEST

/* A second for an exchange, and nothing for SAFE behind one that was waited for in vain. */
START_TEST(a_stepped_board_that_falls_silent_is_not_waited_for_again)
{
    struct mk_board_sample s;
    remote_sit_at("tcp-stepped");
    drive(2.0, &s);
    emu_line_arm(remote.bench.line, EMU_FAULT_LOSE_ANSWER, 0, 1000);
    pass_ms(2);
    ck_assert_int_eq(mk_board_exchange(remote.board, 2.0, &s), MK_ERR_TIMEOUT);
    double start = wall_s();
    ck_assert_int_eq(do_safe(mk_wire_of(remote.board)), MK_ERR_TIMEOUT);
    ck_assert_double_le(wall_s() - start, 0.5);
    ck_assert_double_eq(remote.bench.board.u, 0.0);
}
END_TEST

START_TEST(a_long_wait_is_stepped_in_pieces_and_its_watchdog_fires_in_time)
{
    struct mk_board_sample s;
    remote_sit_at("tcp-stepped");
    drive(2.0, &s);
    int64_t fed_ns = s.board_ns;
    pass_ms(60000);
    remote_must(mk_board_exchange(remote.board, 2.0, &s));
    ck_assert_uint_ne(s.status & MK_BOARD_ST_WATCHDOG, 0);
    ck_assert_double_eq(s.u_applied, 0.0);
    ck_assert_int_eq(s.board_ns - fed_ns, 60000 * INT64_C(1000000));
    ck_assert_int_eq((int64_t)remote.bench.board.device.fault_ns - fed_ns,
                     20 * INT64_C(1000000) + 1);
}
END_TEST

/* Time that a request took of the board alone would be the watchdog's, and no sample's. */
START_TEST(a_request_takes_a_stepped_board_to_its_time_and_no_further)
{
    struct mk_board_sample s;
    struct mk_wire_state state;
    remote_sit_at("tcp-stepped");
    drive(2.0, &s);
    const int64_t fed_ns = s.board_ns;
    for (int k = 1; k <= 300; k++) {
        pass_ms(2);
        if (k % 100 == 0)
            remote_must(mk_wire_state(mk_wire_of(remote.board), &state, &remote.err));
        remote_must(mk_board_exchange(remote.board, 2.0, &s));
        ck_assert_int_eq(s.board_ns - fed_ns, k * INT64_C(2000000));
        ck_assert_uint_eq(s.status & MK_BOARD_ST_WATCHDOG, 0);
    }
}
END_TEST

Suite *suite_stream_troubles(void)
{
    Suite *s = suite_create("stream_troubles");
    TCase *t = tcase_create("stream troubles");
    tcase_add_checked_fixture(t, remote_setup, remote_teardown);
    tcase_set_timeout(t, 60);
    tcase_add_loop_test(t,
                        trouble_at_any_kind_of_request_ends_in_time_with_a_name_and_the_motor_off,
                        0, 2 * TROUBLES);
    tcase_add_test(t, a_board_that_refuses_every_exchange_is_told_to_take_the_motor_off);
    tcase_add_loop_test(t, trouble_with_a_step_costs_one_sample_and_the_clocks_stay_together, 0, 5);
    tcase_add_test(t, a_stepped_board_that_is_unplugged_is_gone_at_any_kind_of_request);
    tcase_add_test(t, a_stepped_board_that_falls_silent_is_not_waited_for_again);
    tcase_add_test(t, a_request_takes_a_stepped_board_to_its_time_and_no_further);
    tcase_add_test(t, a_long_wait_is_stepped_in_pieces_and_its_watchdog_fires_in_time);
    suite_add_tcase(s, t);
    return s;
}
