#include "support/device_bench.h"

#include <check.h>
#include <stdlib.h>
#include <string.h>

struct electronics hw;
struct mk_device device;
struct mk_device_hal hal;
uint32_t sequence;

static uint64_t now_ns(void *user)
{
    return ((struct electronics *)user)->now_ns;
}
static void read_counters(void *user, int32_t count[MK_WIRE_JOINTS])
{
    memcpy(count, ((struct electronics *)user)->count, sizeof hw.count);
}
static void zero_counters(void *user)
{
    memset(((struct electronics *)user)->count, 0, sizeof hw.count);
}
static int32_t apply(void *user, int32_t micro)
{
    struct electronics *e = user;
    ck_assert_int_le(abs(micro), 10 * VOLT);
    e->micro = micro > e->weak ? e->weak : micro;
    return e->micro;
}
static void send_bytes(void *user, const uint8_t *bytes, size_t n)
{
    struct electronics *e = user;
    ck_assert_uint_le(n, sizeof e->sent - e->sent_size);
    memcpy(e->sent + e->sent_size, bytes, n);
    e->sent_size += n;
    e->answers++;
}
static uint16_t alarm_now(void *user)
{
    return ((struct electronics *)user)->alarm;
}
static void lcd(void *user, unsigned row, const char text[MK_LCD_COLUMNS + 1])
{
    strcpy(((struct electronics *)user)->lcd[row], text);
}
static void leds(void *user, uint8_t mask)
{
    ((struct electronics *)user)->leds = mask;
}
static uint8_t switches(void *user)
{
    return ((struct electronics *)user)->switches;
}

void switch_on(void)
{
    const struct mk_device_info info = {.product = "bench",
                                        .firmware = "1.0",
                                        .serial = "MK-7",
                                        .cpr = {4000, 2000},
                                        .encoders = 2,
                                        .counter_bits = 24,
                                        .u_max_micro = 10 * VOLT};
    mk_device_init(&device, &hal, &info);
}

void set_up_device(void)
{
    memset(&hw, 0, sizeof hw);
    hw.weak = 100 * VOLT;
    hal = (struct mk_device_hal){.user = &hw,
                                 .now_ns = now_ns,
                                 .read_counters = read_counters,
                                 .zero_counters = zero_counters,
                                 .apply = apply,
                                 .send = send_bytes,
                                 .alarm = alarm_now,
                                 .lcd = lcd,
                                 .leds = leds,
                                 .switches = switches};
    sequence = 100;
    switch_on();
}

/* --- the host, by hand -------------------------------------------------------------------------
 */

static uint8_t answer_bytes[4096];
struct mk_decoder host;

/* Sends one frame and decodes the first answer; type 0 when there is none. */
struct mk_frame send_frame(uint8_t version, uint8_t type, uint32_t seq, const uint8_t *payload,
                           size_t n)
{
    uint8_t bytes[MK_FRAME_MAX];
    const struct mk_frame f = {version, type, (uint16_t)n, seq, payload};
    hw.sent_size = 0;
    hw.answers = 0;
    mk_device_receive(&device, bytes, mk_frame_encode(&f, bytes));
    memcpy(answer_bytes, hw.sent, hw.sent_size);
    const uint8_t *p = answer_bytes;
    size_t left = hw.sent_size;
    struct mk_frame answer = {0};
    mk_decoder_reset(&host);
    if (!mk_decoder_next(&host, &p, &left, &answer))
        answer.type = 0;
    return answer;
}

struct mk_frame ask(enum mk_message type, const uint8_t *payload, size_t n)
{
    return send_frame(MK_FRAME_VERSION, (uint8_t)type, ++sequence, payload, n);
}

void must(enum mk_message type, const uint8_t *payload, size_t n)
{
    struct mk_frame f = ask(type, payload, n);
    ck_assert_uint_eq(f.type, type | MK_MSG_ANSWER);
    ck_assert_uint_eq(f.sequence, sequence);
}

void must_refuse(enum mk_refusal why, struct mk_frame f)
{
    ck_assert_uint_eq(f.type, MK_MSG_REFUSED);
    ck_assert_uint_eq(f.payload[1], why);
}

struct mk_frame ask_number(enum mk_message type, uint32_t value)
{
    uint8_t p[4];
    mk_put32(p, value);
    return ask(type, p, 4);
}

void number(enum mk_message type, uint32_t value)
{
    struct mk_frame f = ask_number(type, value);
    ck_assert_uint_eq(f.type, type | MK_MSG_ANSWER);
    ck_assert_uint_eq(f.sequence, sequence);
}

struct reading parse(const uint8_t *p)
{
    return (struct reading){{(int32_t)mk_get32(p), (int32_t)mk_get32(p + 4)},
                            (int32_t)mk_get32(p + MK_READING_APPLIED),
                            mk_get64(p + MK_READING_TIME),
                            mk_get16(p + MK_READING_STATUS),
                            mk_get16(p + MK_READING_FAULT),
                            mk_get32(p + MK_READING_EXCHANGES)};
}

struct reading exchange(int32_t micro)
{
    struct mk_frame f = ask_number(MK_MSG_EXCHANGE, (uint32_t)micro);
    ck_assert_uint_eq(f.type, MK_MSG_EXCHANGE | MK_MSG_ANSWER);
    ck_assert_uint_eq(f.length, MK_READING_SIZE);
    return parse(f.payload);
}

void greet(void)
{
    must(MK_MSG_HELLO, NULL, 0);
}

void pass(uint64_t ns)
{
    hw.now_ns += ns;
    mk_device_poll(&device);
}
