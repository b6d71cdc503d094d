/* Frames: what goes in comes out, whatever the pieces, and nothing else ever does. */
#include "suites.h"

#include <stdlib.h>
#include <string.h>

#include "base/random.h"
#include "driver/standalone.h"
#include "driver/wire.h"

static struct mk_random rng;
static struct mk_decoder decoder;

static void setup(void)
{
    rng.state = 7;
    mk_decoder_reset(&decoder);
}

static uint8_t random_byte(void)
{
    return (uint8_t)(mk_random_next(&rng) >> 24);
}

static size_t below(size_t n)
{
    return (size_t)(mk_random_next(&rng) >> 11) % n;
}

struct message {
    struct mk_frame frame;
    uint8_t payload[MK_FRAME_PAYLOAD_MAX];
};

static void make_message(struct message *m, uint32_t sequence)
{
    m->frame = (struct mk_frame){.version = MK_FRAME_VERSION,
                                 .type = random_byte(),
                                 .sequence = sequence,
                                 .length = (uint16_t)below(MK_FRAME_PAYLOAD_MAX + 1),
                                 .payload = m->payload};
    for (int i = 0; i < m->frame.length; i++)
        m->payload[i] = random_byte();
}

static void ck_assert_same(const struct mk_frame *a, const struct mk_frame *b)
{
    ck_assert_uint_eq(a->type, b->type);
    ck_assert_uint_eq(a->sequence, b->sequence);
    ck_assert_uint_eq(a->length, b->length);
    ck_assert_mem_eq(a->payload, b->payload, a->length);
}

START_TEST(checks_are_the_published_ones)
{
    const uint8_t *digits = (const uint8_t *)"123456789";
    ck_assert_uint_eq(mk_crc16(digits, 9), 0x29b1);
    ck_assert_uint_eq(mk_crc32(digits, 9), 0xcbf43926);
}
END_TEST

START_TEST(the_layout_is_the_documented_one)
{
    uint8_t payload[2] = {0xaa, 0xbb}, out[MK_FRAME_MAX];
    struct mk_frame f = {1, 0x04, 2, 0x01020304, payload};
    static const uint8_t head[] = {'M', 'K', 1, 4, 4, 3, 2, 1, 2, 0};
    ck_assert_uint_eq(mk_frame_encode(&f, out), 18);
    ck_assert_mem_eq(out, head, sizeof head);
    ck_assert_mem_eq(out + 12, payload, 2);
}
END_TEST

START_TEST(a_payload_that_is_too_long_is_no_frame)
{
    uint8_t payload[MK_FRAME_PAYLOAD_MAX + 1] = {0}, out[MK_FRAME_MAX];
    struct mk_frame f = {1, 4, sizeof payload, 1, payload};
    ck_assert_uint_eq(mk_frame_encode(&f, out), 0);
}
END_TEST

START_TEST(frames_come_out_whatever_the_pieces)
{
    static uint8_t stream[200 * MK_FRAME_MAX];
    static struct message sent[200];
    size_t size = 0, got = 0;
    for (uint32_t k = 0; k < 200; k++) {
        make_message(&sent[k], k);
        size += mk_frame_encode(&sent[k].frame, stream + size);
    }
    for (size_t at = 0; at < size;) {
        size_t n = 1 + below(_i == 0 ? 1 : 300);
        const uint8_t *p = stream + at;
        n = n < size - at ? n : size - at;
        at += n;
        struct mk_frame f;
        while (mk_decoder_next(&decoder, &p, &n, &f))
            ck_assert_same(&f, &sent[got++].frame);
    }
    ck_assert_uint_eq(got, 200);
    ck_assert_uint_eq(decoder.broken + decoder.skipped, 0);
}
END_TEST

/* Garbage before a frame costs nothing but itself, even when it holds the beginning of a header. */
START_TEST(the_decoder_finds_its_way_after_garbage)
{
    for (uint32_t k = 0; k < 2000; k++) {
        uint8_t stream[MK_FRAME_MAX + 64];
        struct message m;
        make_message(&m, k);
        size_t n = below(60);
        for (size_t i = 0; i < n; i++)
            stream[i] = below(3) ? random_byte() : (uint8_t) "MK\x01"[below(3)];
        const uint32_t skipped = decoder.skipped + (uint32_t)n;
        n += mk_frame_encode(&m.frame, stream + n);
        const uint8_t *p = stream;
        struct mk_frame f;
        ck_assert(mk_decoder_next(&decoder, &p, &n, &f));
        ck_assert_same(&f, &m.frame);
        ck_assert_uint_eq(decoder.skipped, skipped);
        ck_assert(!mk_decoder_next(&decoder, &p, &n, &f));
    }
}
END_TEST

START_TEST(one_flipped_bit_loses_that_frame_and_no_other)
{
    struct message m, next;
    uint8_t first[MK_FRAME_MAX], second[MK_FRAME_MAX];
    make_message(&m, 1);
    m.frame.length = 40;
    make_message(&next, 2);
    size_t size = mk_frame_encode(&m.frame, first), more = mk_frame_encode(&next.frame, second);
    for (size_t bit = 0; bit < 8 * size; bit++) {
        first[bit / 8] ^= (uint8_t)(1u << bit % 8);
        mk_decoder_reset(&decoder);
        struct mk_frame f;
        const uint8_t *p = first, *q = second;
        size_t n = size, left = more;
        ck_assert(!mk_decoder_next(&decoder, &p, &n, &f));
        ck_assert_msg(mk_decoder_next(&decoder, &q, &left, &f), "bit %zu", bit);
        ck_assert_same(&f, &next.frame);
        first[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
}
END_TEST

START_TEST(a_length_beyond_the_limit_is_not_believed)
{
    uint8_t bytes[MK_FRAME_HEADER] = {'M', 'K', 1, 4, 0, 0, 0, 0, 0xff, 0xff};
    mk_put16(bytes + 10, mk_crc16(bytes, 10));
    const uint8_t *p = bytes;
    size_t n = sizeof bytes;
    struct mk_frame f;
    ck_assert(!mk_decoder_next(&decoder, &p, &n, &f));
    ck_assert_uint_eq(decoder.broken, 1);
    ck_assert_uint_eq(decoder.used, 0);
}
END_TEST

START_TEST(noise_is_never_taken_for_a_frame)
{
    uint8_t bytes[512];
    for (int k = 0; k < 20000; k++) {
        for (size_t i = 0; i < sizeof bytes; i++)
            bytes[i] = below(4) ? random_byte() : (uint8_t) "MK\x01\x04"[below(4)];
        const uint8_t *p = bytes;
        size_t n = sizeof bytes;
        struct mk_frame f;
        ck_assert(!mk_decoder_next(&decoder, &p, &n, &f));
        ck_assert_uint_lt(decoder.used, MK_FRAME_MAX);
    }
}
END_TEST

/* --- the host's side: a board that never stops talking ------------------------------------------
 */

/* What it says over and over; 0: garbage. */
static const uint8_t babble[] = {0, MK_MSG_STATE | MK_MSG_ANSWER, MK_MSG_SAMPLE};
#define BABBLES ((int)sizeof babble)

static enum mk_status take_anything(void *link, const uint8_t *bytes, size_t n, int64_t deadline_ns)
{
    (void)link;
    (void)bytes;
    (void)n;
    (void)deadline_ns;
    return MK_OK;
}

static enum mk_status talk(void *link, const uint8_t **bytes, size_t *n, int64_t deadline_ns)
{
    static uint8_t said[MK_FRAME_MAX], reading[MK_READING_SIZE];
    uint8_t type = *(const uint8_t *)link;
    const struct mk_frame f = {MK_FRAME_VERSION, type, sizeof reading, 7, reading};
    (void)deadline_ns;
    memset(said, 'M', sizeof said);
    *n = type ? mk_frame_encode(&f, said) : sizeof said;
    *bytes = said;
    return MK_OK;
}

START_TEST(a_board_that_never_stops_talking_does_not_hold_the_host)
{
    static const struct mk_link_ops ops = {take_anything, talk};
    uint8_t type = babble[_i];
    struct mk_wire wire = {.ops = &ops, .link = &type};
    struct mk_board board = {.priv = &wire};
    struct mk_board_sample sample;
    enum mk_status in_time = type == MK_MSG_SAMPLE ? MK_OK : MK_ERR_TIMEOUT;
    ck_assert_int_eq(mk_wire_board_exchange(&board, 0.0, &sample), MK_ERR_TIMEOUT);
    wire.stream_us = 1000;
    ck_assert_int_eq(mk_wire_board_exchange(&board, 0.0, &sample), in_time);
}
END_TEST

/* The answer to a setup: so many gains as the link says. */
static enum mk_status promise(void *link, const uint8_t **bytes, size_t *n, int64_t deadline_ns)
{
    static uint8_t said[MK_FRAME_MAX];
    const struct mk_frame f = {MK_FRAME_VERSION, MK_MSG_SETUP | MK_MSG_ANSWER, 1, 7, link};
    (void)deadline_ns;
    *n = mk_frame_encode(&f, said);
    *bytes = said;
    return MK_OK;
}

START_TEST(a_board_cannot_promise_more_gains_than_there_are)
{
    static const struct mk_link_ops ops = {take_anything, promise};
    static const struct {
        uint8_t gains;
        enum mk_status st;
    } boards[] = {{0, MK_OK},
                  {MK_STANDALONE_GAINS, MK_OK},
                  {MK_STANDALONE_GAINS + 1, MK_ERR_PROTO},
                  {255, MK_ERR_PROTO}};
    for (size_t i = 0; i < sizeof boards / sizeof boards[0]; i++) {
        uint8_t gains = boards[i].gains;
        struct mk_wire wire = {.ops = &ops, .link = &gains, .sequence = 6};
        struct mk_error err = MK_ERROR_INIT;
        int got = -1;
        ck_assert_int_eq(mk_wire_setup(&wire, 1, 2000, 1, &got, &err), boards[i].st);
        ck_assert_int_eq(got, boards[i].st == MK_OK ? gains : -1);
        ck_assert_int_eq(err.message[0] != '\0', boards[i].st != MK_OK);
    }
}
END_TEST

/* Answers every request in a frame of the version that it is told. */
static uint32_t asked;
static uint8_t asked_type;

static enum mk_status note_request(void *link, const uint8_t *bytes, size_t n, int64_t deadline_ns)
{
    (void)link, (void)n, (void)deadline_ns;
    asked_type = bytes[3];
    asked = mk_get32(bytes + 4);
    return MK_OK;
}

static enum mk_status answer_in_version(void *link, const uint8_t **bytes, size_t *n,
                                        int64_t deadline_ns)
{
    static uint8_t said[MK_FRAME_MAX], hello[MK_HELLO_SIZE];
    const struct mk_frame f = {*(const uint8_t *)link, asked_type | MK_MSG_ANSWER, sizeof hello,
                               asked, hello};
    (void)deadline_ns;
    hello[MK_HELLO_VERSION] = MK_FRAME_VERSION;
    hello[MK_HELLO_COUNTER_BITS] = 24;
    *n = mk_frame_encode(&f, said);
    *bytes = said;
    return MK_OK;
}

START_TEST(a_hello_in_a_frame_of_another_version_is_refused)
{
    static const struct mk_link_ops ops = {note_request, answer_in_version};
    struct mk_wire wire;
    struct mk_error err = MK_ERROR_INIT;
    uint8_t version = MK_FRAME_VERSION;
    ck_assert_int_eq(mk_wire_open(&wire, &ops, &version, &err), MK_OK);
    version++;
    ck_assert_int_eq(mk_wire_open(&wire, &ops, &version, &err), MK_ERR_NOTSUP);
    ck_assert_ptr_nonnull(strstr(err.message, "protocol version 2"));
}
END_TEST

/* A board whose identity says another version than its frames; `link` is the identity's length. */
static uint8_t identity_version;

static enum mk_status answer_with_identity(void *link, const uint8_t **bytes, size_t *n,
                                           int64_t deadline_ns)
{
    static uint8_t said[MK_FRAME_MAX], hello[MK_HELLO_SIZE];
    const struct mk_frame f = {MK_FRAME_VERSION, asked_type | MK_MSG_ANSWER,
                               *(const uint16_t *)link, asked, hello};
    (void)deadline_ns;
    hello[MK_HELLO_VERSION] = identity_version;
    hello[MK_HELLO_COUNTER_BITS] = 24;
    *n = mk_frame_encode(&f, said);
    *bytes = said;
    return MK_OK;
}

START_TEST(an_identity_of_another_version_is_refused_whatever_its_length)
{
    static const struct mk_link_ops ops = {note_request, answer_with_identity};
    static const struct {
        uint8_t version;
        uint16_t length;
        enum mk_status st;
        const char *says;
    } boards[] = {
        {MK_FRAME_VERSION, MK_HELLO_SIZE, MK_OK, ""},
        {MK_FRAME_VERSION, MK_HELLO_SIZE - 1, MK_ERR_PROTO, "hello is malformed"},
        {MK_FRAME_VERSION, 0, MK_ERR_PROTO, "hello is malformed"},
        {MK_FRAME_VERSION + 1, MK_HELLO_SIZE, MK_ERR_NOTSUP, "speaks protocol version 2, this"},
        {MK_FRAME_VERSION + 1, 4, MK_ERR_NOTSUP, "speaks protocol version 2, this"},
        {0, MK_HELLO_SIZE, MK_ERR_NOTSUP, "speaks protocol version 0, this"},
    };
    for (size_t i = 0; i < sizeof boards / sizeof boards[0]; i++) {
        struct mk_wire wire;
        struct mk_error err = MK_ERROR_INIT;
        uint16_t length = boards[i].length;
        identity_version = boards[i].version;
        ck_assert_int_eq(mk_wire_open(&wire, &ops, &length, &err), boards[i].st);
        ck_assert_msg(strstr(err.message, boards[i].says) != NULL, "%s", err.message);
    }
}
END_TEST

START_TEST(an_answer_or_a_sample_in_another_version_is_no_reading_even_in_mid_run)
{
    static const struct mk_link_ops ops = {note_request, answer_in_version};
    struct mk_wire wire;
    struct mk_board board = {.priv = &wire};
    struct mk_board_sample sample;
    struct mk_error err = MK_ERROR_INIT;
    uint8_t version = MK_FRAME_VERSION;
    ck_assert_int_eq(mk_wire_open(&wire, &ops, &version, &err), MK_OK);
    ck_assert_int_eq(mk_wire_board_exchange(&board, 0.0, &sample), MK_OK);
    version++;
    ck_assert_int_eq(mk_wire_board_exchange(&board, 0.0, &sample), MK_ERR_NOTSUP);
    uint32_t number;
    struct mk_wire_reading reading;
    asked_type = MK_MSG_SAMPLE;
    ck_assert_int_eq(mk_wire_next_sample(&wire, 1000000, &number, &reading), MK_ERR_NOTSUP);
}
END_TEST

/* Bytes that never make a frame, one at a time, for as long as somebody asks. */
static enum mk_status drip(void *link, const uint8_t **bytes, size_t *n, int64_t deadline_ns)
{
    static const uint8_t byte = 'K';
    (void)deadline_ns;
    ++*(int *)link;
    *bytes = &byte;
    *n = 1;
    return MK_OK;
}

START_TEST(garbage_past_the_deadline_is_looked_at_a_few_times_only)
{
    static const struct mk_link_ops ops = {take_anything, drip};
    int looks = 0;
    uint32_t number;
    struct mk_wire_reading reading;
    struct mk_wire wire = {.ops = &ops, .link = &looks};
    ck_assert_int_eq(mk_wire_next_sample(&wire, -1, &number, &reading), MK_ERR_TIMEOUT);
    ck_assert_int_le(looks, 8);
    ck_assert_int_ge(looks, 1);
}
END_TEST

Suite *suite_frame(void)
{
    Suite *s = suite_create("frame");
    TCase *t = tcase_create("frame");
    tcase_add_checked_fixture(t, setup, NULL);
    tcase_add_test(t, checks_are_the_published_ones);
    tcase_add_test(t, the_layout_is_the_documented_one);
    tcase_add_test(t, a_payload_that_is_too_long_is_no_frame);
    tcase_add_loop_test(t, frames_come_out_whatever_the_pieces, 0, 2);
    tcase_add_test(t, the_decoder_finds_its_way_after_garbage);
    tcase_add_test(t, one_flipped_bit_loses_that_frame_and_no_other);
    tcase_add_test(t, a_length_beyond_the_limit_is_not_believed);
    tcase_add_test(t, noise_is_never_taken_for_a_frame);
    tcase_add_loop_test(t, a_board_that_never_stops_talking_does_not_hold_the_host, 0, BABBLES);
    tcase_add_test(t, a_hello_in_a_frame_of_another_version_is_refused);
    tcase_add_test(t, an_identity_of_another_version_is_refused_whatever_its_length);
    tcase_add_test(t, an_answer_or_a_sample_in_another_version_is_no_reading_even_in_mid_run);
    tcase_add_test(t, garbage_past_the_deadline_is_looked_at_a_few_times_only);
    tcase_add_test(t, a_board_cannot_promise_more_gains_than_there_are);
    suite_add_tcase(s, t);
    return s;
}
