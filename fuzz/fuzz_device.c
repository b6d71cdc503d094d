/* libFuzzer: the board's side of the protocol. The input is a script of steps: raw bytes,
 * well-formed messages with any content (a fuzzer does not find checksums), time, alarms. After
 * every step the rules of docs/safety.md must hold. */
#include <stdlib.h>
#include <string.h>

#include "driver/device.h"

#define LIMIT (10 * MK_WIRE_MICRO)

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static struct board {
    uint64_t now_ns;
    int32_t count[2];
    int32_t micro;
    uint16_t alarm;
} hw;

static void must(int holds)
{
    if (!holds)
        abort();
}

static uint64_t now(void *user)
{
    (void)user;
    return hw.now_ns;
}
static void read_counters(void *user, int32_t count[MK_WIRE_JOINTS])
{
    (void)user;
    memcpy(count, hw.count, sizeof hw.count);
}
static void zero_counters(void *user)
{
    (void)user;
    memset(hw.count, 0, sizeof hw.count);
}
static int32_t apply(void *user, int32_t micro)
{
    (void)user;
    must(micro <= LIMIT && micro >= -LIMIT);
    return hw.micro = micro;
}
static void send(void *user, const uint8_t *bytes, size_t n)
{
    struct mk_decoder d;
    struct mk_frame f;
    (void)user;
    mk_decoder_reset(&d);
    must(n >= MK_FRAME_HEADER + MK_FRAME_TRAILER && n <= MK_FRAME_MAX);
    must(mk_decoder_next(&d, &bytes, &n, &f) && n == 0);
}
static uint16_t alarm_now(void *user)
{
    (void)user;
    return hw.alarm;
}
static void lcd(void *user, unsigned row, const char text[MK_LCD_COLUMNS + 1])
{
    (void)user;
    must(row < MK_LCD_ROWS && strlen(text) <= MK_LCD_COLUMNS);
}
static void leds(void *user, uint8_t mask)
{
    (void)user;
    (void)mask;
}

static const struct mk_device_hal hal = {.now_ns = now,
                                         .read_counters = read_counters,
                                         .zero_counters = zero_counters,
                                         .apply = apply,
                                         .send = send,
                                         .alarm = alarm_now,
                                         .lcd = lcd,
                                         .leds = leds};

static void check(const struct mk_device *d)
{
    must(d->decoder.used < MK_FRAME_MAX);
    must(d->greeted || hw.micro == 0);
    must((!d->fault && !d->fired) || hw.micro == 0);
    must(d->standalone.recorded <= MK_STANDALONE_RECORDS);
    must(!(d->stream_us && d->standalone.running));
    must(!d->greeted || d->watched || d->watchdog_ns > 0);
    if (d->watchdog_ns && hw.now_ns > d->fed_ns + d->watchdog_ns)
        must(hw.micro == 0);
}

/* One step of the script; returns how many bytes of it were used. */
static size_t step(struct mk_device *d, const uint8_t *p, size_t size, uint32_t *sequence)
{
    uint8_t bytes[MK_FRAME_MAX], payload[128] = {0};
    size_t n = size > 2 ? p[1] % 100 : 0;
    n = n < size - 2 ? n : size - 2;
    switch (p[0] & 7) {
    case 0: /* raw bytes */
        mk_device_receive(d, p + 2, n);
        return 2 + n;
    case 1: /* time passes, joints move */
        hw.now_ns += (uint64_t)p[1] << (p[0] >> 3 & 31);
        hw.count[p[1] & 1] += (int32_t)p[1] - 128;
        mk_device_poll(d);
        return 2;
    case 2:
        hw.alarm = p[1] & 1 ? MK_WIRE_FAULT_AMPLIFIER : 0;
        mk_device_poll(d);
        return 2;
    default: { /* a message: type, payload */
        const struct mk_frame f = {(uint8_t)(p[0] >> 3 == 31 ? 2 : MK_FRAME_VERSION), n ? p[2] : 0,
                                   (uint16_t)(n ? n - 1 : 0),
                                   *sequence += (uint32_t)((p[0] & 7) - 4), payload};
        if (n)
            memcpy(payload, p + 3, n - 1);
        mk_device_receive(d, bytes, mk_frame_encode(&f, bytes));
        return 2 + n;
    }
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct mk_device d;
    const struct mk_device_info info = {
        .cpr = {4000, 4000}, .encoders = 2, .counter_bits = 24, .u_max_micro = LIMIT};
    uint32_t sequence = 1;
    memset(&hw, 0, sizeof hw);
    mk_device_init(&d, &hal, &info);
    while (size >= 2) {
        size_t used = step(&d, data, size, &sequence);
        check(&d);
        data += used;
        size -= used;
    }
    return 0;
}
