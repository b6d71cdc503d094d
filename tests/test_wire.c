/* The host's side of the protocol, with a board behind the link that says what a test has it say:
 * what becomes of its answers and refusals, what is sent again and how long it is waited for. */
#include "suites.h"

#include <string.h>
#include <time.h>

#include "driver/standalone.h"
#include "driver/wire.h"

#define MS INT64_C(1000000)

/* The board. Unless `says` is set it answers every request with `payload`. */
static struct {
    uint8_t payload[MK_FRAME_PAYLOAD_MAX];
    uint16_t length;
    uint8_t says;           /* type of the answer, if it is another one */
    bool mute;              /* it says nothing */
    enum mk_status sending; /* of the line, as long as it is not MK_OK */
    bool follows;           /* its clock goes where it is told to */
    int sent;               /* requests */
    uint8_t type;           /* of the last one, */
    uint32_t sequence;
    uint8_t asked[MK_FRAME_PAYLOAD_MAX];
    size_t asked_length;
    int64_t patience_ns; /* the time that its answer had */
} board;

static struct mk_wire wire;
static struct mk_clock clock_;
static struct mk_error err;

static int64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static enum mk_status take(void *link, const uint8_t *bytes, size_t n, int64_t deadline_ns)
{
    struct mk_frame f = {0};
    static struct mk_decoder d;
    (void)link, (void)deadline_ns;
    board.sent++;
    mk_decoder_reset(&d);
    ck_assert(mk_decoder_next(&d, &bytes, &n, &f));
    board.type = f.type;
    board.sequence = f.sequence;
    board.asked_length = f.length;
    memcpy(board.asked, f.payload, f.length);
    return board.sending;
}

static enum mk_status answer(void *link, const uint8_t **bytes, size_t *n, int64_t deadline_ns)
{
    static uint8_t said[MK_FRAME_MAX];
    (void)link;
    board.patience_ns = deadline_ns - now_ns();
    if (board.mute)
        return MK_ERR_TIMEOUT;
    if (board.type == MK_MSG_STEP && board.follows) {
        memcpy(board.payload, board.asked, 8);
        board.length = 8;
    }
    const uint8_t type = board.says ? board.says : board.type | MK_MSG_ANSWER;
    const struct mk_frame f = {MK_FRAME_VERSION, type, board.length, board.sequence, board.payload};
    *n = mk_frame_encode(&f, said);
    *bytes = said;
    return MK_OK;
}

static const struct mk_link_ops ops = {take, answer};

static void setup(void)
{
    memset(&board, 0, sizeof board);
    memset(&wire, 0, sizeof wire);
    err = (struct mk_error)MK_ERROR_INIT;
    wire.ops = &ops;
    mk_clock_init_simulated(&clock_);
}

static void refuse(uint8_t type, uint8_t why)
{
    board.says = MK_MSG_REFUSED;
    board.payload[0] = type;
    board.payload[1] = why;
    board.payload[2] = MK_FRAME_VERSION + 2;
    board.length = 3;
}

static void it_says(const char *text)
{
    ck_assert_msg(strstr(err.message, text) != NULL, "no '%s' in: %s", text, err.message);
}

/* --- requests -------------------------------------------------------------------------------- */

START_TEST(a_request_that_is_not_answered_is_sent_three_times_and_named)
{
    board.mute = true;
    ck_assert_int_eq(mk_wire_clear(&wire, &err), MK_ERR_TIMEOUT);
    ck_assert_int_eq(board.sent, 3);
    it_says("no answer to 'clear fault' within 3 x 40 ms");
    ck_assert(wire.unanswered);
    board.mute = false;
    ck_assert_int_eq(mk_wire_clear(&wire, &err), MK_OK);
    ck_assert_int_eq(board.sent, 4);
    ck_assert(!wire.unanswered);
}
END_TEST

START_TEST(a_request_that_is_refused_is_not_sent_again_and_says_why)
{
    static const struct {
        uint8_t why;
        enum mk_status st;
        const char *says;
    } rows[] = {
        {MK_REFUSED_VERSION, MK_ERR_NOTSUP, "speaks protocol version 3, this program version 1"},
        {MK_REFUSED_UNKNOWN, MK_ERR_NOTSUP, "this board has no 'LEDs'"},
        {MK_REFUSED_NOTSUP, MK_ERR_NOTSUP, "this board has no 'LEDs'"},
        {MK_REFUSED_LENGTH, MK_ERR_PROTO, "did not understand 'LEDs'"},
        {MK_REFUSED_RANGE, MK_ERR_RANGE, "refuses 'LEDs': out of range"},
        {MK_REFUSED_STATE, MK_ERR_STATE, "refuses 'LEDs' in this state"},
        {99, MK_ERR_PROTO, "did not understand 'LEDs'"},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        setup();
        refuse(MK_MSG_LEDS, rows[i].why);
        ck_assert_int_eq(mk_wire_leds(&wire, 1, &err), rows[i].st);
        ck_assert_int_eq(board.sent, 1);
        it_says(rows[i].says);
        ck_assert(!wire.gone);
    }
}
END_TEST

/* A refusal is read as far as it goes. */
START_TEST(a_refusal_that_is_cut_short_is_one_all_the_same)
{
    static const struct {
        uint16_t length;
        uint8_t why;
        enum mk_status st;
        const char *says;
    } rows[] = {
        {0, MK_REFUSED_RANGE, MK_ERR_PROTO, "did not understand 'request'"},
        {1, MK_REFUSED_RANGE, MK_ERR_PROTO, "did not understand 'LEDs'"},
        {2, MK_REFUSED_RANGE, MK_ERR_RANGE, "refuses 'LEDs': out of range"},
        {2, MK_REFUSED_VERSION, MK_ERR_NOTSUP, "speaks protocol version 1"},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        setup();
        refuse(MK_MSG_LEDS, rows[i].why);
        board.length = rows[i].length;
        ck_assert_int_eq(mk_wire_leds(&wire, 1, &err), rows[i].st);
        it_says(rows[i].says);
    }
}
END_TEST

START_TEST(a_board_that_knows_no_exchange_any_more_has_restarted_and_is_gone)
{
    struct mk_wire_reading reading;
    refuse(MK_MSG_EXCHANGE, MK_REFUSED_STATE);
    ck_assert_int_eq(mk_wire_exchange(&wire, 1.0, &reading), MK_ERR_NODEV);
    ck_assert_ptr_nonnull(strstr(wire.trouble.message, "the board has restarted"));
    ck_assert(wire.gone);
}
END_TEST

/* But for the motor: a link that comes back takes it off. */
START_TEST(a_link_that_has_gone_is_not_asked_again)
{
    struct mk_wire_reading reading;
    struct mk_board slots = {.priv = &wire};
    uint32_t number;
    board.sending = MK_ERR_NODEV;
    ck_assert_int_eq(mk_wire_leds(&wire, 1, &err), MK_ERR_NODEV);
    it_says("the board is gone");
    ck_assert_int_eq(board.sent, 1);
    board.sending = MK_OK;
    ck_assert_int_eq(mk_wire_leds(&wire, 1, &err), MK_ERR_NODEV);
    it_says("the board is gone");
    ck_assert_int_eq(mk_wire_answer_sample(&wire, 0, 1.0), MK_ERR_NODEV);
    ck_assert_int_eq(mk_wire_next_sample(&wire, 0, &number, &reading), MK_ERR_NODEV);
    ck_assert_int_eq(board.sent, 1);
    ck_assert_int_eq(mk_wire_board_safe(&slots), MK_OK);
    ck_assert_int_eq(board.sent, 2);
    ck_assert_uint_eq(board.type, MK_MSG_SAFE);
}
END_TEST

START_TEST(a_state_is_told_as_it_comes_and_no_shorter)
{
    struct mk_wire_state s;
    for (size_t i = 0; i < MK_STATE_SIZE; i++)
        board.payload[i] = (uint8_t)(i + 1);
    board.length = MK_STATE_SIZE;
    ck_assert_int_eq(mk_wire_state(&wire, &s, &err), MK_OK);
    ck_assert_uint_eq(s.status, 0x0201);
    ck_assert_uint_eq(s.fault, 0x0403);
    ck_assert_uint_eq(s.fault_ns, 0x0c0b0a0908070605);
    ck_assert_uint_eq(s.now_ns, 0x14131211100f0e0d);
    ck_assert_uint_eq(s.broken, 0x18171615);
    ck_assert_uint_eq(s.stale, 0x1c1b1a19);
    ck_assert_uint_eq(s.repeated, 0x201f1e1d);
    ck_assert_uint_eq(s.bites, 0x24232221);
    ck_assert_uint_eq(s.exchanges, 0x28272625);
    ck_assert_uint_eq(s.recorded, 0x2c2b2a29);
    ck_assert_uint_eq(s.switches, 0x2d);
    ck_assert_uint_eq(s.controller, 0x2e);
    ck_assert_uint_eq(s.phase, 0x2f);
    board.length = MK_STATE_SIZE - 1;
    ck_assert_int_eq(mk_wire_state(&wire, &s, &err), MK_ERR_PROTO);
    it_says("state is malformed");
}
END_TEST

START_TEST(a_reading_is_told_as_it_comes_and_no_shorter)
{
    struct mk_wire_reading r;
    for (size_t i = 0; i < MK_READING_SIZE; i++)
        board.payload[i] = (uint8_t)(i + 1);
    mk_put32(board.payload + MK_READING_APPLIED, (uint32_t)-2500000);
    mk_put16(board.payload + MK_READING_STATUS, 0xffff);
    board.length = MK_READING_SIZE;
    ck_assert_int_eq(mk_wire_exchange(&wire, -2.5, &r), MK_OK);
    ck_assert_int_eq((int32_t)mk_get32(board.asked), -2500000);
    ck_assert_uint_eq(board.asked_length, MK_EXCHANGE_SIZE);
    ck_assert_int_eq(r.sample.count[0], 0x04030201);
    ck_assert_int_eq(r.sample.count[1], 0x08070605);
    ck_assert_int_eq(r.sample.board_ns, 0x100f0e0d0c0b0a09);
    ck_assert_double_eq(r.sample.u_applied, -2.5);
    ck_assert_uint_eq(r.status, 0xffff);
    ck_assert_uint_eq(r.sample.status, MK_BOARD_ST_WATCHDOG | MK_BOARD_ST_SATURATED |
                                           MK_BOARD_ST_FAULT | MK_BOARD_ST_OWN);
    ck_assert_uint_eq(r.fault, 0x1817);
    ck_assert_uint_eq(r.sample.sequence, 0x1c1b1a19);
    board.length = MK_READING_SIZE - 1;
    ck_assert_int_eq(mk_wire_exchange(&wire, 0.0, &r), MK_ERR_PROTO);
}
END_TEST

START_TEST(a_line_of_the_display_is_cut_at_its_width)
{
    ck_assert_int_eq(mk_wire_lcd(&wire, 1, "twenty-one characters", &err), MK_OK);
    ck_assert_uint_eq(board.asked_length, 1 + MK_LCD_COLUMNS);
    ck_assert_uint_eq(board.asked[0], 1);
    ck_assert_mem_eq(board.asked + 1, "twenty-one character", MK_LCD_COLUMNS);
    ck_assert_int_eq(mk_wire_lcd(&wire, 0, "few", &err), MK_OK);
    ck_assert_uint_eq(board.asked_length, 4);
}
END_TEST

START_TEST(a_board_that_streamed_is_asked_again_when_its_motor_is_off)
{
    struct mk_board slots = {.priv = &wire};
    struct mk_board_sample s;
    ck_assert_int_eq(mk_wire_board_stream(&slots, 2000, &err), MK_OK);
    ck_assert_uint_eq(mk_get32(board.asked), 2000);
    ck_assert_int_eq(mk_wire_board_safe(&slots), MK_OK);
    board.length = MK_READING_SIZE;
    ck_assert_int_eq(mk_wire_board_exchange(&slots, 1.0, &s), MK_OK);
    ck_assert_uint_eq(board.type, MK_MSG_EXCHANGE);
    ck_assert_int_eq(board.sent, 3);
}
END_TEST

/* --- hello ----------------------------------------------------------------------------------- */

static void greet_as(uint8_t bits, int32_t cpr1, int32_t cpr2)
{
    memset(board.payload, 0, sizeof board.payload);
    board.payload[MK_HELLO_VERSION] = MK_FRAME_VERSION;
    board.payload[MK_HELLO_COUNTER_BITS] = bits;
    mk_put32(board.payload + MK_HELLO_CPR, (uint32_t)cpr1);
    mk_put32(board.payload + MK_HELLO_CPR + 4, (uint32_t)cpr2);
    board.length = MK_HELLO_SIZE;
}

START_TEST(counters_and_counts_a_turn_that_cannot_be_are_refused)
{
    static const struct {
        uint8_t bits;
        int32_t cpr[2];
        const char *says; /* NULL: it is taken */
    } rows[] = {
        {8, {0, 0}, NULL},
        {32, {100000000, 100000000}, NULL},
        {7, {0, 0}, "counters of 7 bits"},
        {33, {0, 0}, "counters of 33 bits"},
        {24, {-1, 0}, "-1 counts a turn for encoder 1"},
        {24, {0, 100000001}, "100000001 counts a turn for encoder 2"},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        greet_as(rows[i].bits, rows[i].cpr[0], rows[i].cpr[1]);
        ck_assert_int_eq(mk_wire_open(&wire, &ops, NULL, &err),
                         rows[i].says ? MK_ERR_PROTO : MK_OK);
        if (rows[i].says)
            it_says(rows[i].says);
        ck_assert_int_eq(wire.identity.encoder_cpr[1], rows[i].cpr[1]);
    }
}
END_TEST

START_TEST(what_a_board_calls_itself_ends_where_it_is_no_text)
{
    greet_as(24, 4000, 2000);
    memset(board.payload + MK_HELLO_PRODUCT, 'p', MK_HELLO_TEXT); /* no zero at the end */
    memcpy(board.payload + MK_HELLO_FIRMWARE, "1.0 ~\x7f!", 7);
    memcpy(board.payload + MK_HELLO_SERIAL, "A\x1f!", 3);
    mk_put32(board.payload + MK_HELLO_U_MAX, (uint32_t)12500000);
    mk_put32(board.payload + MK_HELLO_CAPABILITIES, 0x12345678);
    ck_assert_int_eq(mk_wire_open(&wire, &ops, NULL, &err), MK_OK);
    ck_assert_str_eq(wire.identity.name, "pppppppppppppppppppppppp");
    ck_assert_str_eq(wire.identity.firmware, "1.0 ~");
    ck_assert_str_eq(wire.identity.serial, "A");
    ck_assert_int_eq(wire.identity.encoder_cpr[0], 4000);
    ck_assert_int_eq(wire.identity.counter_bits, 24);
    ck_assert_double_eq(wire.u_max, 12.5);
    ck_assert_uint_eq(wire.capabilities, 0x12345678);
}
END_TEST

/* --- a clock that is stepped ------------------------------------------------------------------ */

static void follow_at(int64_t board_ns)
{
    wire.capabilities = MK_WIRE_CAP_STEP;
    mk_put64(board.payload, (uint64_t)board_ns);
    board.length = 8;
    ck_assert_int_eq(mk_wire_follow(&wire, &clock_, &err), MK_OK);
}

START_TEST(a_board_that_is_stepped_is_waited_for_as_long_as_a_simulation_may_take)
{
    ck_assert_int_eq(mk_wire_leds(&wire, 1, &err), MK_OK);
    ck_assert_int_le(board.patience_ns, 40 * MS);
    follow_at(0);
    board.follows = true;
    ck_assert_int_eq(mk_wire_leds(&wire, 1, &err), MK_OK);
    ck_assert_int_gt(board.patience_ns, 100 * MS); /* a second, less a stall of this machine */
}
END_TEST

/* Only the motor goes off without waiting for the board again. */
START_TEST(a_stepped_board_that_did_not_answer_once_is_stepped_and_waited_for_as_before)
{
    struct mk_board slots = {.priv = &wire};
    follow_at(0);
    board.follows = true;
    ck_assert_int_eq(mk_wire_board_safe(&slots), MK_OK);
    ck_assert_int_gt(board.patience_ns, 100 * MS);
    board.mute = true;
    ck_assert_int_eq(mk_wire_leds(&wire, 1, &err), MK_ERR_TIMEOUT);
    ck_assert_int_eq(mk_wire_board_safe(&slots), MK_ERR_TIMEOUT);
    ck_assert_int_le(board.patience_ns, 10 * MS);
    board.mute = false;
    mk_clock_sleep_until(&clock_, mk_clock_now_ns(&clock_) + 2 * MS);
    board.sent = 0;
    ck_assert_int_eq(mk_wire_leds(&wire, 1, &err), MK_OK);
    ck_assert_int_eq(board.sent, 2);
    ck_assert_int_gt(board.patience_ns, 100 * MS);
    ck_assert_int_eq(wire.at_ns, 2 * MS);
}
END_TEST

START_TEST(a_board_whose_clock_does_not_follow_is_told)
{
    follow_at(5 * MS);
    mk_clock_sleep_until(&clock_, mk_clock_now_ns(&clock_) + 2 * MS);
    ck_assert_int_eq(mk_wire_leds(&wire, 1, &err), MK_ERR_PROTO); /* it stands at 5 ms */
    it_says("the board's clock does not follow");
    ck_assert_int_eq(board.sent, 2);
    board.length = 7;
    ck_assert_int_eq(mk_wire_leds(&wire, 1, &err), MK_ERR_PROTO);
    it_says("answer to 'step' is malformed");
}
END_TEST

START_TEST(a_clock_that_is_stepped_is_set_to_now_in_steps_that_are_not_too_long)
{
    const int64_t begun_ns = mk_clock_now_ns(&clock_);
    follow_at(5 * MS);
    board.follows = true;
    board.sent = 0;
    mk_clock_sleep_until(&clock_, begun_ns + 250 * MS);
    ck_assert_int_eq(mk_wire_leds(&wire, 1, &err), MK_OK);
    ck_assert_int_eq(wire.at_ns, 255 * MS);
    ck_assert_int_eq(board.sent, 3 + 1);
    ck_assert_int_eq(mk_wire_leds(&wire, 1, &err), MK_OK); /* it stands there already */
    ck_assert_int_eq(board.sent, 3 + 2);
}
END_TEST

/* --- stand-alone control ---------------------------------------------------------------------- */

START_TEST(gains_are_sent_as_they_are_and_no_more_than_there_may_be)
{
    float gain[MK_STANDALONE_GAINS + 1] = {1.5f};
    float back;
    gain[MK_STANDALONE_GAINS - 1] = -0.25f;
    ck_assert_int_eq(mk_wire_gains(&wire, 0, gain, MK_STANDALONE_GAINS, &err), MK_OK);
    ck_assert_uint_eq(board.asked_length, 2 + 4 * MK_STANDALONE_GAINS);
    ck_assert_uint_eq(board.asked[0], 0);
    ck_assert_uint_eq(board.asked[1], MK_STANDALONE_GAINS);
    const uint32_t bits = mk_get32(board.asked + 2 + 4 * (MK_STANDALONE_GAINS - 1));
    memcpy(&back, &bits, sizeof back);
    ck_assert_double_eq((double)back, -0.25);
    ck_assert_int_eq(mk_wire_gains(&wire, 3, gain, 0, &err), MK_OK);
    ck_assert_int_eq(board.sent, 2);
    ck_assert_int_eq(mk_wire_gains(&wire, -1, gain, 1, &err), MK_ERR_RANGE);
    ck_assert_int_eq(mk_wire_gains(&wire, 0, gain, -1, &err), MK_ERR_RANGE);
    ck_assert_int_eq(mk_wire_gains(&wire, 0, gain, MK_STANDALONE_GAINS + 1, &err), MK_ERR_RANGE);
    ck_assert_int_eq(board.sent, 2);
}
END_TEST

START_TEST(records_are_taken_as_many_as_were_asked_for_and_whole)
{
    static const struct {
        int asked, told, whole;
        enum mk_status st;
    } rows[] = {{2, 2, 2, MK_OK},        {2, 0, 0, MK_OK},        {2, 1, 1, MK_OK},
                {2, 3, 3, MK_ERR_PROTO}, {2, 2, 1, MK_ERR_PROTO}, {2, 1, 2, MK_ERR_PROTO}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct mk_standalone_record r[4];
        int got = -1;
        for (size_t k = 0; k < sizeof board.payload; k++)
            board.payload[k] = (uint8_t)k;
        board.payload[4] = (uint8_t)rows[i].told;
        board.length = (uint16_t)(MK_UPLOAD_HEADER + rows[i].whole * MK_RECORD_SIZE);
        ck_assert_int_eq(mk_wire_upload(&wire, 7, r, rows[i].asked, &got, &err), rows[i].st);
        ck_assert_uint_eq(mk_get32(board.asked), 7);
        ck_assert_uint_eq(board.asked[4], (unsigned)rows[i].asked);
        ck_assert_int_eq(got, rows[i].st == MK_OK ? rows[i].told : -1);
        for (int k = 0; k < got; k++) {
            const uint8_t *p = board.payload + MK_UPLOAD_HEADER + k * MK_RECORD_SIZE;
            ck_assert_uint_eq(r[k].sample, mk_get32(p));
            ck_assert_int_eq(r[k].count[0], (int32_t)mk_get32(p + 4));
            ck_assert_int_eq(r[k].count[1], (int32_t)mk_get32(p + 8));
            ck_assert_int_eq(r[k].micro, (int32_t)mk_get32(p + 12));
            ck_assert_uint_eq(r[k].phase, mk_get32(p + 16));
        }
    }
    struct mk_standalone_record most[MK_UPLOAD_MAX + 1];
    int got;
    board.length = MK_UPLOAD_HEADER - 1;
    ck_assert_int_eq(mk_wire_upload(&wire, 0, most, MK_UPLOAD_MAX + 1, &got, &err), MK_ERR_PROTO);
    ck_assert_uint_eq(board.asked[4], MK_UPLOAD_MAX);
}
END_TEST

Suite *suite_wire(void)
{
    Suite *s = suite_create("wire");
    TCase *t = tcase_create("wire");
    tcase_add_checked_fixture(t, setup, NULL);
    tcase_add_test(t, a_request_that_is_not_answered_is_sent_three_times_and_named);
    tcase_add_test(t, a_request_that_is_refused_is_not_sent_again_and_says_why);
    tcase_add_test(t, a_refusal_that_is_cut_short_is_one_all_the_same);
    tcase_add_test(t, a_board_that_knows_no_exchange_any_more_has_restarted_and_is_gone);
    tcase_add_test(t, a_link_that_has_gone_is_not_asked_again);
    tcase_add_test(t, a_state_is_told_as_it_comes_and_no_shorter);
    tcase_add_test(t, a_reading_is_told_as_it_comes_and_no_shorter);
    tcase_add_test(t, a_line_of_the_display_is_cut_at_its_width);
    tcase_add_test(t, a_board_that_streamed_is_asked_again_when_its_motor_is_off);
    tcase_add_test(t, counters_and_counts_a_turn_that_cannot_be_are_refused);
    tcase_add_test(t, what_a_board_calls_itself_ends_where_it_is_no_text);
    tcase_add_test(t, a_board_that_is_stepped_is_waited_for_as_long_as_a_simulation_may_take);
    tcase_add_test(t, a_stepped_board_that_did_not_answer_once_is_stepped_and_waited_for_as_before);
    tcase_add_test(t, a_board_whose_clock_does_not_follow_is_told);
    tcase_add_test(t, a_clock_that_is_stepped_is_set_to_now_in_steps_that_are_not_too_long);
    tcase_add_test(t, gains_are_sent_as_they_are_and_no_more_than_there_may_be);
    tcase_add_test(t, records_are_taken_as_many_as_were_asked_for_and_whole);
    suite_add_tcase(s, t);
    return s;
}
