#include "driver/device.h"

#include <string.h>

#define LINE_ERROR_RISE 8u
#define LINE_ERROR_LIMIT 64u /* one broken frame in nine, for a while */
#define STREAM_BACKLOG 8u    /* samples that may wait for their answer */

/* A handler's result when it refuses: less than 0. */
static int refuse(enum mk_refusal why)
{
    return -(int)why;
}

/* --- the motor ------------------------------------------------------------------------------- */

static void apply(struct mk_device *d, int32_t micro)
{
    int32_t limit = d->info.u_max_micro;
    int32_t allowed = micro > limit ? limit : micro < -limit ? -limit : micro;
    if (d->fired || d->fault)
        allowed = 0;
    d->micro = micro;
    d->applied = d->hal->apply(d->hal->user, allowed);
}

static void motor_off(struct mk_device *d)
{
    d->stream_us = 0;
    d->stream_micro = 0;
    d->standalone.running = false;
    apply(d, 0);
}

void mk_device_trip(struct mk_device *d, uint16_t fault)
{
    if (d->fault == MK_WIRE_FAULT_NONE) {
        d->fault = fault;
        d->fault_ns = d->hal->now_ns(d->hal->user);
    }
    motor_off(d);
}

static void feed(struct mk_device *d)
{
    d->fed_ns = d->hal->now_ns(d->hal->user);
}

static void set_watchdog(struct mk_device *d, uint32_t ms)
{
    d->watchdog_ns = (uint64_t)ms * 1000000u;
}

static uint16_t status_bits(const struct mk_device *d)
{
    return (uint16_t)((d->fired ? MK_WIRE_ST_WATCHDOG : 0u) |
                      (d->applied != d->micro ? MK_WIRE_ST_SATURATED : 0u) |
                      (d->fault > MK_WIRE_FAULT_WATCHDOG ? MK_WIRE_ST_FAULT : 0u) |
                      (d->stream_us ? MK_WIRE_ST_STREAMING : 0u) |
                      (d->standalone.running ? MK_WIRE_ST_STANDALONE : 0u));
}

/* --- sending --------------------------------------------------------------------------------- */

static void send_answer(struct mk_device *d, uint8_t type, const uint8_t *payload, size_t length)
{
    const struct mk_frame f = {MK_FRAME_VERSION, type, (uint16_t)length, d->sequence, payload};
    d->answer_size = mk_frame_encode(&f, d->answer);
    d->hal->send(d->hal->user, d->answer, d->answer_size);
}

static void send_refusal(struct mk_device *d, uint8_t type, enum mk_refusal why)
{
    const uint8_t payload[3] = {type, (uint8_t)why, MK_FRAME_VERSION};
    send_answer(d, MK_MSG_REFUSED, payload, sizeof payload);
}

/* --- readings -------------------------------------------------------------------------------- */

/* Latches counters and time, then lets the command act: the order is the contract. */
static void take_reading(struct mk_device *d, int32_t micro, uint8_t *out)
{
    int32_t count[MK_WIRE_JOINTS] = {0};
    d->hal->read_counters(d->hal->user, count);
    uint64_t now = d->hal->now_ns(d->hal->user);
    if (!d->standalone.running)
        apply(d, micro);
    for (int j = 0; j < MK_WIRE_JOINTS; j++)
        mk_put32(out + MK_READING_COUNT + 4 * j, (uint32_t)count[j]);
    mk_put64(out + MK_READING_TIME, now);
    mk_put32(out + MK_READING_APPLIED, (uint32_t)d->applied);
    mk_put16(out + MK_READING_STATUS, status_bits(d));
    mk_put16(out + MK_READING_FAULT, d->fault);
    mk_put32(out + MK_READING_EXCHANGES, d->exchanges++);
}

/* --- requests: each fills the answer's payload and returns its length, or refuses ------------- */

static void run_freely(struct mk_device *d)
{
    if (d->stepped)
        d->hal->run_freely(d->hal->user);
    d->stepped = false;
}

static int on_hello(struct mk_device *d, const struct mk_frame *f, uint8_t *out)
{
    (void)f;
    const struct mk_device_info *info = &d->info;
    const struct mk_device_hal *hal = d->hal;
    motor_off(d);
    run_freely(d);
    d->greeted = true;
    d->line_errors = 0;
    set_watchdog(d, MK_WATCHDOG_DEFAULT_MS);
    d->watched = false;
    memset(out, 0, MK_HELLO_SIZE);
    out[MK_HELLO_VERSION] = MK_FRAME_VERSION;
    out[MK_HELLO_COUNTER_BITS] = info->counter_bits;
    out[MK_HELLO_ENCODERS] = info->encoders;
    mk_put32(out + MK_HELLO_CAPABILITIES,
             MK_WIRE_CAP_WATCHDOG | MK_WIRE_CAP_STREAM | MK_WIRE_CAP_STANDALONE |
                 (hal->lcd ? MK_WIRE_CAP_LCD : 0u) | (hal->leds ? MK_WIRE_CAP_LEDS : 0u) |
                 (hal->switches ? MK_WIRE_CAP_DIP : 0u) | (hal->step ? MK_WIRE_CAP_STEP : 0u));
    for (int j = 0; j < MK_WIRE_JOINTS; j++)
        mk_put32(out + MK_HELLO_CPR + 4 * j, (uint32_t)info->cpr[j]);
    mk_put32(out + MK_HELLO_U_MAX, (uint32_t)info->u_max_micro);
    memcpy(out + MK_HELLO_PRODUCT, info->product, MK_HELLO_TEXT);
    memcpy(out + MK_HELLO_FIRMWARE, info->firmware, MK_HELLO_TEXT);
    memcpy(out + MK_HELLO_SERIAL, info->serial, MK_HELLO_TEXT);
    return MK_HELLO_SIZE;
}

static int on_zero(struct mk_device *d, const struct mk_frame *f, uint8_t *out)
{
    (void)f;
    (void)out;
    if (d->standalone.running)
        return refuse(MK_REFUSED_STATE);
    d->hal->zero_counters(d->hal->user);
    return 0;
}

static int on_watchdog(struct mk_device *d, const struct mk_frame *f, uint8_t *out)
{
    (void)out;
    uint32_t ms = mk_get32(f->payload);
    if (ms > MK_WATCHDOG_MAX_MS)
        return refuse(MK_REFUSED_RANGE);
    set_watchdog(d, ms);
    d->watched = true;
    d->fired = false;
    if (d->fault == MK_WIRE_FAULT_WATCHDOG)
        d->fault = MK_WIRE_FAULT_NONE;
    feed(d);
    return 0;
}

/* 0, or a refusal. */
static int step(struct mk_device *d, uint64_t ns)
{
    uint64_t now = d->hal->now_ns(d->hal->user);
    if (ns > now && ns - now > MK_STEP_MAX_NS)
        return refuse(MK_REFUSED_RANGE);
    d->stepped = true;
    d->hal->step(d->hal->user, ns);
    return 0;
}

static int on_step(struct mk_device *d, const struct mk_frame *f, uint8_t *out)
{
    int refused = d->hal->step ? step(d, mk_get64(f->payload)) : refuse(MK_REFUSED_NOTSUP);
    if (refused < 0)
        return refused;
    mk_put64(out, d->hal->now_ns(d->hal->user));
    return 8;
}

/* With a time, where the host steps the clock; a host that does and a board that does not know are
 * strangers to each other: the board has restarted. */
static int on_exchange(struct mk_device *d, const struct mk_frame *f, uint8_t *out)
{
    if (f->length != MK_EXCHANGE_SIZE) {
        if (f->length != MK_EXCHANGE_AT_SIZE || !d->hal->step)
            return refuse(MK_REFUSED_LENGTH);
        int refused = d->stepped ? step(d, mk_get64(f->payload + MK_EXCHANGE_SIZE))
                                 : refuse(MK_REFUSED_STATE);
        if (refused < 0)
            return refused;
    }
    feed(d);
    take_reading(d, (int32_t)mk_get32(f->payload), out);
    return MK_READING_SIZE;
}

static int on_safe(struct mk_device *d, const struct mk_frame *f, uint8_t *out)
{
    (void)f;
    (void)out;
    motor_off(d);
    return 0;
}

static int on_clear(struct mk_device *d, const struct mk_frame *f, uint8_t *out)
{
    (void)f;
    (void)out;
    motor_off(d);
    d->fault = MK_WIRE_FAULT_NONE;
    d->fault_ns = 0;
    d->fired = false;
    d->line_errors = 0;
    feed(d);
    return 0;
}

static int on_state(struct mk_device *d, const struct mk_frame *f, uint8_t *out)
{
    (void)f;
    /* Whoever asks after a stand-alone run guards it. */
    if (d->standalone.running)
        feed(d);
    memset(out, 0, MK_STATE_SIZE);
    mk_put16(out + MK_STATE_STATUS, status_bits(d));
    mk_put16(out + MK_STATE_FAULT, d->fault);
    mk_put64(out + MK_STATE_FAULT_TIME, d->fault_ns);
    mk_put64(out + MK_STATE_TIME, d->hal->now_ns(d->hal->user));
    mk_put32(out + MK_STATE_BROKEN, d->decoder.broken);
    mk_put32(out + MK_STATE_STALE, d->stale);
    mk_put32(out + MK_STATE_REPEATED, d->repeated);
    mk_put32(out + MK_STATE_BITES, d->bites);
    mk_put32(out + MK_STATE_EXCHANGES, d->exchanges);
    mk_put32(out + MK_STATE_RECORDED, d->standalone.recorded);
    if (d->hal->switches)
        out[MK_STATE_SWITCHES] = d->hal->switches(d->hal->user);
    out[MK_STATE_CONTROLLER] = (uint8_t)d->standalone.controller;
    out[MK_STATE_PHASE] = (uint8_t)d->standalone.phase;
    return MK_STATE_SIZE;
}

static int on_lcd(struct mk_device *d, const struct mk_frame *f, uint8_t *out)
{
    (void)out;
    if (!d->hal->lcd)
        return refuse(MK_REFUSED_NOTSUP);
    if (f->payload[0] >= MK_LCD_ROWS)
        return refuse(MK_REFUSED_RANGE);
    char text[MK_LCD_COLUMNS + 1] = "";
    for (int i = 1; i < f->length; i++)
        text[i - 1] = f->payload[i] >= 0x20 && f->payload[i] < 0x7f ? (char)f->payload[i] : '?';
    d->hal->lcd(d->hal->user, f->payload[0], text);
    return 0;
}

static int on_leds(struct mk_device *d, const struct mk_frame *f, uint8_t *out)
{
    (void)out;
    if (!d->hal->leds)
        return refuse(MK_REFUSED_NOTSUP);
    d->hal->leds(d->hal->user, f->payload[0]);
    return 0;
}

static int on_stream(struct mk_device *d, const struct mk_frame *f, uint8_t *out)
{
    (void)out;
    uint32_t us = mk_get32(f->payload);
    if (us != 0 && (us < MK_STREAM_MIN_US || us > MK_STREAM_MAX_US))
        return refuse(MK_REFUSED_RANGE);
    if (d->standalone.running)
        return refuse(MK_REFUSED_STATE);
    apply(d, 0);
    d->stream_us = us;
    d->stream_micro = 0;
    d->stream_sample = d->stream_answered = 0;
    d->stream_next_ns = d->hal->now_ns(d->hal->user);
    feed(d);
    return 0;
}

/* Acts with the next sample, which shows what became of it: so the time from a sample to its
 * command is one period, whatever the line and the host take of it. */
static int on_command(struct mk_device *d, const struct mk_frame *f, uint8_t *out)
{
    (void)out;
    uint32_t sample = mk_get32(f->payload);
    if (!d->stream_us || sample >= d->stream_sample)
        return refuse(MK_REFUSED_STATE);
    d->stream_answered = sample + 1;
    d->stream_micro = (int32_t)mk_get32(f->payload + 4);
    feed(d);
    return 0;
}

static int on_setup(struct mk_device *d, const struct mk_frame *f, uint8_t *out)
{
    uint32_t period_us = mk_get32(f->payload + 4);
    if (d->standalone.running || d->stream_us)
        return refuse(MK_REFUSED_STATE);
    if (period_us < MK_STREAM_MIN_US || period_us > MK_STREAM_MAX_US || f->payload[1] == 0)
        return refuse(MK_REFUSED_RANGE);
    if (d->info.cpr[0] <= 0)
        return refuse(MK_REFUSED_NOTSUP);
    if (!mk_standalone_setup(&d->standalone, (enum mk_controller)f->payload[0], period_us,
                             f->payload[1]))
        return refuse(MK_REFUSED_RANGE);
    out[0] = (uint8_t)mk_standalone_gain_count(d->standalone.controller);
    return 1;
}

static float float_of(uint32_t bits)
{
    float x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* All or none: a value that is no number leaves the gains as they were. */
static int on_gains(struct mk_device *d, const struct mk_frame *f, uint8_t *out)
{
    (void)out;
    struct mk_standalone *s = &d->standalone;
    int first = f->payload[0], n = f->payload[1];
    if (f->length != 2 + 4 * n)
        return refuse(MK_REFUSED_LENGTH);
    if (first + n > mk_standalone_gain_count(s->controller))
        return refuse(MK_REFUSED_RANGE);
    for (int i = 0; i < n; i++) {
        float x = float_of(mk_get32(f->payload + 2 + 4 * i));
        if (!(x > -1e9f && x < 1e9f))
            return refuse(MK_REFUSED_RANGE);
    }
    for (int i = 0; i < n; i++)
        s->gain[first + i] = float_of(mk_get32(f->payload + 2 + 4 * i));
    return 0;
}

static int on_start(struct mk_device *d, const struct mk_frame *f, uint8_t *out)
{
    (void)f;
    (void)out;
    struct mk_standalone *s = &d->standalone;
    if (s->controller == MK_CONTROLLER_NONE || s->running || d->stream_us || d->fault || d->fired)
        return refuse(MK_REFUSED_STATE);
    mk_standalone_start(s, d->hal->now_ns(d->hal->user));
    feed(d);
    return 0;
}

static int on_upload(struct mk_device *d, const struct mk_frame *f, uint8_t *out)
{
    const struct mk_standalone *s = &d->standalone;
    uint32_t first = mk_get32(f->payload), n = f->payload[4];
    if (n > MK_UPLOAD_MAX || first > s->recorded)
        return refuse(MK_REFUSED_RANGE);
    n = s->recorded - first < n ? s->recorded - first : n;
    mk_put32(out, first);
    out[4] = (uint8_t)n;
    uint8_t *p = out + MK_UPLOAD_HEADER;
    for (uint32_t i = 0; i < n; i++, p += MK_RECORD_SIZE) {
        const struct mk_standalone_record *r = &s->record[first + i];
        mk_put32(p, r->sample);
        mk_put32(p + 4, (uint32_t)r->count[0]);
        mk_put32(p + 8, (uint32_t)r->count[1]);
        mk_put32(p + 12, (uint32_t)r->micro);
        mk_put32(p + 16, r->phase);
    }
    return (int)(MK_UPLOAD_HEADER + n * MK_RECORD_SIZE);
}

static const struct request {
    uint8_t type;
    uint8_t shortest, longest; /* payload */
    int (*handle)(struct mk_device *d, const struct mk_frame *f, uint8_t *out);
} requests[] = {
    {MK_MSG_EXCHANGE, MK_EXCHANGE_SIZE, MK_EXCHANGE_AT_SIZE, on_exchange},
    {MK_MSG_COMMAND, 8, 8, on_command},
    {MK_MSG_HELLO, 0, 16, on_hello},
    {MK_MSG_ZERO, 0, 0, on_zero},
    {MK_MSG_WATCHDOG, 4, 4, on_watchdog},
    {MK_MSG_SAFE, 0, 0, on_safe},
    {MK_MSG_CLEAR, 0, 0, on_clear},
    {MK_MSG_STATE, 0, 0, on_state},
    {MK_MSG_LCD, 1, 1 + MK_LCD_COLUMNS, on_lcd},
    {MK_MSG_LEDS, 1, 1, on_leds},
    {MK_MSG_STREAM, 4, 4, on_stream},
    {MK_MSG_STEP, 8, 8, on_step},
    {MK_MSG_SETUP, 8, 8, on_setup},
    {MK_MSG_GAINS, 2, 2 + 4 * MK_STANDALONE_GAINS, on_gains},
    {MK_MSG_START, 0, 0, on_start},
    {MK_MSG_HALT, 0, 0, on_safe},
    {MK_MSG_UPLOAD, 5, 5, on_upload},
};
#define REQUEST_COUNT (sizeof requests / sizeof requests[0])

static void execute(struct mk_device *d, const struct mk_frame *f)
{
    uint8_t payload[MK_FRAME_PAYLOAD_MAX];
    int result = refuse(MK_REFUSED_UNKNOWN);
    for (size_t i = 0; i < REQUEST_COUNT; i++) {
        if (requests[i].type != f->type)
            continue;
        bool fits = f->length >= requests[i].shortest && f->length <= requests[i].longest;
        result = fits ? requests[i].handle(d, f, payload) : refuse(MK_REFUSED_LENGTH);
        break;
    }
    if (result < 0)
        send_refusal(d, f->type, (enum mk_refusal)(-result));
    else if (f->type != MK_MSG_COMMAND)
        send_answer(d, f->type | MK_MSG_ANSWER, payload, (size_t)result);
}

/* A late request must not undo a newer one, and a repeated one must not act twice. */
static void on_frame(struct mk_device *d, const struct mk_frame *f)
{
    bool hello = f->type == MK_MSG_HELLO;
    int32_t step = (int32_t)(f->sequence - d->sequence);
    if (f->version == MK_FRAME_VERSION && d->greeted && !hello && step <= 0) {
        if (step == 0) {
            d->repeated++;
            if (d->answer_size > 0)
                d->hal->send(d->hal->user, d->answer, d->answer_size);
        } else {
            d->stale++;
        }
        return;
    }
    d->sequence = f->sequence;
    d->answer_size = 0;
    if (f->version != MK_FRAME_VERSION) {
        d->greeted = false;
        motor_off(d);
        send_refusal(d, f->type, MK_REFUSED_VERSION);
    } else if (!d->greeted && !hello) {
        send_refusal(d, f->type, MK_REFUSED_STATE);
    } else {
        execute(d, f);
    }
}

void mk_device_hang_up(struct mk_device *d)
{
    motor_off(d);
    run_freely(d);
    d->greeted = false;
    set_watchdog(d, MK_WATCHDOG_DEFAULT_MS);
    d->watched = false; /* it is silent from here on, and may be */
    mk_decoder_reset(&d->decoder);
}

void mk_device_receive(struct mk_device *d, const uint8_t *bytes, size_t n)
{
    struct mk_frame f;
    mk_device_poll(d);
    uint32_t before = d->decoder.broken + d->decoder.skipped;
    while (mk_decoder_next(&d->decoder, &bytes, &n, &f)) {
        if (d->line_errors > 0)
            d->line_errors--;
        on_frame(d, &f);
    }
    if (d->decoder.broken + d->decoder.skipped != before)
        d->line_errors += LINE_ERROR_RISE;
    if (d->line_errors >= LINE_ERROR_LIMIT)
        mk_device_trip(d, MK_WIRE_FAULT_LINE);
}

/* --- what time brings ------------------------------------------------------------------------ */

/* Of a host that set no time every command is guarded, in force or waiting for its sample, but not
 * the silence between them. */
static bool watchdog_waits(const struct mk_device *d)
{
    bool commanded = d->micro != 0 || d->stream_micro != 0 || d->standalone.running;
    return d->watchdog_ns > 0 && !d->fired && (d->watched || commanded);
}

static void stream(struct mk_device *d, uint64_t now)
{
    uint8_t payload[MK_READING_SIZE], out[MK_FRAME_MAX];
    if (d->stream_sample - d->stream_answered >= STREAM_BACKLOG) {
        mk_device_trip(d, MK_WIRE_FAULT_STREAM);
        return;
    }
    take_reading(d, d->stream_micro, payload);
    const struct mk_frame f = {MK_FRAME_VERSION, MK_MSG_SAMPLE, sizeof payload, d->stream_sample++,
                               payload};
    /* Samples that could not be taken in time are left out, not crowded together. */
    do
        d->stream_next_ns += (uint64_t)d->stream_us * 1000u;
    while (d->stream_next_ns <= now);
    d->hal->send(d->hal->user, out, mk_frame_encode(&f, out));
}

static void control(struct mk_device *d, uint64_t now)
{
    struct mk_standalone *s = &d->standalone;
    int32_t count[MK_WIRE_JOINTS] = {0};
    float q[MK_WIRE_JOINTS];
    d->hal->read_counters(d->hal->user, count);
    for (int j = 0; j < MK_WIRE_JOINTS; j++) {
        int32_t cpr = d->info.cpr[j] > 0 ? d->info.cpr[j] : d->info.cpr[0];
        q[j] = mk_standalone_follow(s, j, count[j], d->info.counter_bits, cpr);
    }
    float u = mk_standalone_step(s, q), limit = (float)d->info.u_max_micro / MK_WIRE_MICRO;
    if (!(u > -1e9f && u < 1e9f)) {
        mk_device_trip(d, MK_WIRE_FAULT_COMMAND);
        return;
    }
    if (mk_standalone_out_of_travel(s)) {
        mk_device_trip(d, MK_WIRE_FAULT_TRAVEL);
        return;
    }
    u = u > limit ? limit : u < -limit ? -limit : u;
    apply(d, (int32_t)(u * MK_WIRE_MICRO));
    mk_standalone_record(s, count, d->applied);
    do
        s->next_ns += (uint64_t)s->period_us * 1000u;
    while (s->next_ns <= now);
}

void mk_device_poll(struct mk_device *d)
{
    uint64_t now = d->hal->now_ns(d->hal->user);
    uint16_t alarm = d->hal->alarm ? d->hal->alarm(d->hal->user) : 0;
    if (alarm)
        mk_device_trip(d, alarm);
    if (watchdog_waits(d) && now > d->fed_ns + d->watchdog_ns) {
        d->fired = true;
        d->bites++;
        mk_device_trip(d, MK_WIRE_FAULT_WATCHDOG);
    }
    if (d->stream_us && now >= d->stream_next_ns)
        stream(d, now);
    if (d->standalone.running && now >= d->standalone.next_ns)
        control(d, now);
}

uint64_t mk_device_next_event(const struct mk_device *d)
{
    uint64_t next = UINT64_MAX;
    if (watchdog_waits(d))
        next = d->fed_ns + d->watchdog_ns + 1;
    if (d->stream_us && d->stream_next_ns < next)
        next = d->stream_next_ns;
    if (d->standalone.running && d->standalone.next_ns < next)
        next = d->standalone.next_ns;
    return next;
}

void mk_device_init(struct mk_device *d, const struct mk_device_hal *hal,
                    const struct mk_device_info *info)
{
    memset(d, 0, sizeof *d);
    d->hal = hal;
    d->info = *info;
    mk_decoder_reset(&d->decoder);
    apply(d, 0);
}
