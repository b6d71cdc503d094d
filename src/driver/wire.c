#include "driver/wire.h"

#include "driver/standalone.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#define REQUEST_TRIES 3
#define REQUEST_NS 40000000
#define HELLO_NS 100000000
#define SAFE_TRIES 2
#define SAFE_NS 10000000
/* What is there already is looked at even past a deadline, for it may be us who were late; but a
 * board that never stops talking must not hold its host. */
#define LATE_LOOKS 4
/* A board whose clock is stepped has no motor that would have to wait for an answer, but a
 * simulation that may be slow. */
#define STEPPED_NS 1000000000
#define STEP_NS 100000000 /* longest step asked for; the simulation's own pieces are as long */
#define CPR_MAX 100000000 /* as in model files and mappings */

static int64_t monotonic_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static const char *message_name(enum mk_message type)
{
    static const struct {
        enum mk_message type;
        const char *name;
    } names[] = {
        {MK_MSG_HELLO, "hello"},       {MK_MSG_ZERO, "zero counters"},
        {MK_MSG_WATCHDOG, "watchdog"}, {MK_MSG_EXCHANGE, "exchange"},
        {MK_MSG_SAFE, "motor off"},    {MK_MSG_CLEAR, "clear fault"},
        {MK_MSG_STATE, "state"},       {MK_MSG_LCD, "LCD"},
        {MK_MSG_LEDS, "LEDs"},         {MK_MSG_STREAM, "stream"},
        {MK_MSG_COMMAND, "command"},   {MK_MSG_STEP, "step"},
        {MK_MSG_SETUP, "setup"},       {MK_MSG_GAINS, "gains"},
        {MK_MSG_START, "start"},       {MK_MSG_HALT, "halt"},
        {MK_MSG_UPLOAD, "upload"},
    };
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++)
        if (names[i].type == type)
            return names[i].name;
    return "request";
}

const char *mk_wire_fault_text(uint16_t fault)
{
    switch (fault) {
    case MK_WIRE_FAULT_NONE:
        return "no fault";
    case MK_WIRE_FAULT_WATCHDOG:
        return "the watchdog saw no exchange in time";
    case MK_WIRE_FAULT_LINE:
        return "too many broken messages on the line: check cable and plugs";
    case MK_WIRE_FAULT_STREAM:
        return "the host did not keep up with the samples";
    case MK_WIRE_FAULT_TRAVEL:
        return "a joint left its travel limits";
    case MK_WIRE_FAULT_COMMAND:
        return "the board's controller gave no number";
    case MK_WIRE_FAULT_AMPLIFIER:
        return "the amplifier reports a fault";
    default:
        return "a fault of the electronics";
    }
}

/* --- frames out and in ----------------------------------------------------------------------- */

static enum mk_status send_frame(struct mk_wire *w, enum mk_message type, const uint8_t *payload,
                                 size_t length, int64_t deadline_ns)
{
    uint8_t bytes[MK_FRAME_MAX];
    const struct mk_frame f = {MK_FRAME_VERSION, (uint8_t)type, (uint16_t)length, w->sequence,
                               payload};
    size_t n = mk_frame_encode(&f, bytes);
    return w->ops->send(w->link, bytes, n, deadline_ns);
}

static enum mk_status other_version(struct mk_wire *w, int version)
{
    return mk_error_set(&w->trouble, MK_ERR_NOTSUP,
                        "the board speaks protocol version %d, this program version %d: update the "
                        "older one",
                        version, MK_FRAME_VERSION);
}

/* The layout of a frame, and a refusal's payload, are those of every version. What other payloads
 * mean in another version nobody knows, whenever they come. */
static enum mk_status next_frame(struct mk_wire *w, struct mk_frame *out, int64_t deadline_ns)
{
    int late = 0;
    while (!mk_decoder_next(&w->decoder, &w->rest, &w->rest_size, out)) {
        enum mk_status st = late > LATE_LOOKS
                                ? MK_ERR_TIMEOUT
                                : w->ops->receive(w->link, &w->rest, &w->rest_size, deadline_ns);
        if (st != MK_OK) {
            w->rest_size = 0;
            return st;
        }
        late += monotonic_ns() >= deadline_ns;
    }
    if (out->version != MK_FRAME_VERSION && out->type != MK_MSG_REFUSED)
        return other_version(w, out->version);
    return MK_OK;
}

static enum mk_status refused(struct mk_wire *w, const struct mk_frame *f)
{
    enum mk_message type = f->length > 0 ? (enum mk_message)f->payload[0] : MK_MSG_REFUSED;
    const char *name = message_name(type);
    switch (f->length > 1 ? f->payload[1] : 0) {
    case MK_REFUSED_VERSION:
        return other_version(w, f->length > 2 ? f->payload[2] : f->version);
    case MK_REFUSED_RANGE:
        return mk_error_set(&w->trouble, MK_ERR_RANGE, "the board refuses '%s': out of range",
                            name);
    case MK_REFUSED_STATE:
        /* An exchange is welcome in every state but before HELLO: the board has restarted, and
         * with it its counters. */
        if (type == MK_MSG_EXCHANGE) {
            w->gone = true;
            return mk_error_set(&w->trouble, MK_ERR_NODEV, "the board has restarted");
        }
        return mk_error_set(&w->trouble, MK_ERR_STATE, "the board refuses '%s' in this state",
                            name);
    case MK_REFUSED_UNKNOWN:
    case MK_REFUSED_NOTSUP:
        return mk_error_set(&w->trouble, MK_ERR_NOTSUP, "this board has no '%s'", name);
    default:
        return mk_error_set(&w->trouble, MK_ERR_PROTO, "the board did not understand '%s'", name);
    }
}

/* Waits for the answer to the newest request; older ones, and samples, pass by. */
static enum mk_status await_answer(struct mk_wire *w, enum mk_message type, struct mk_frame *answer,
                                   int64_t deadline_ns)
{
    for (int late = 0; late <= LATE_LOOKS; late += monotonic_ns() >= deadline_ns) {
        enum mk_status st = next_frame(w, answer, deadline_ns);
        if (st != MK_OK)
            return st;
        if (answer->sequence == w->sequence) {
            if (answer->type == (type | MK_MSG_ANSWER))
                return MK_OK;
            if (answer->type == MK_MSG_REFUSED)
                return refused(w, answer);
        }
    }
    return MK_ERR_TIMEOUT;
}

static enum mk_status describe(struct mk_wire *w, enum mk_status st, enum mk_message type,
                               int tries, int64_t timeout_ns)
{
    const char *name = message_name(type);
    switch (st) {
    case MK_ERR_TIMEOUT:
        return mk_error_set(&w->trouble, st, "no answer to '%s' within %d x %.0f ms", name, tries,
                            (double)timeout_ns * 1e-6);
    case MK_ERR_PROTO:
        return mk_error_set(&w->trouble, st, "the answer to '%s' got lost on the way", name);
    case MK_ERR_NODEV:
        return mk_error_set(&w->trouble, st, "the board is gone: check plug and power, then setup");
    default:
        return mk_error_set(&w->trouble, st, "'%s' failed", name);
    }
}

/* The motor goes off without waiting for a board that has just been waited for in vain. */
static bool hurries(const struct mk_wire *w, enum mk_message type)
{
    return type == MK_MSG_SAFE && (w->gone || w->unanswered);
}

static enum mk_status request(struct mk_wire *w, enum mk_message type, const uint8_t *payload,
                              size_t length, int tries, int64_t timeout_ns, struct mk_frame *answer)
{
    struct mk_frame ignored;
    enum mk_status st = MK_ERR_NODEV;
    if (w->clock && !hurries(w, type))
        timeout_ns = STEPPED_NS;
    w->trouble.status = MK_OK;
    w->sequence++;
    /* What a board that has forgotten us does it does by itself, but the motor is not left to that:
     * a link that is gone says so again. */
    for (int k = 0; k < tries && (!w->gone || type == MK_MSG_SAFE); k++) {
        int64_t deadline_ns = monotonic_ns() + timeout_ns;
        st = send_frame(w, type, payload, length, deadline_ns);
        if (st == MK_OK)
            st = await_answer(w, type, answer ? answer : &ignored, deadline_ns);
        w->unanswered = st == MK_ERR_TIMEOUT;
        if (st == MK_ERR_NODEV)
            w->gone = true;
        /* Refused: asking again would not help. */
        if (st == MK_OK || w->trouble.status != MK_OK)
            return st;
    }
    return describe(w, w->gone ? MK_ERR_NODEV : st, type, tries, timeout_ns);
}

/* --- a clock that is stepped --------------------------------------------------------------------
 */

/* Now, by the board's clock, if it followed ours to the end. */
static int64_t board_now_ns(const struct mk_wire *w)
{
    return mk_clock_now_ns(w->clock) + w->ahead_ns;
}

static enum mk_status step(struct mk_wire *w, int64_t to_ns)
{
    uint8_t payload[8];
    struct mk_frame f;
    mk_put64(payload, (uint64_t)to_ns);
    enum mk_status st =
        request(w, MK_MSG_STEP, payload, sizeof payload, REQUEST_TRIES, STEPPED_NS, &f);
    if (st == MK_OK && f.length < 8)
        st = mk_error_set(&w->trouble, MK_ERR_PROTO, "the board's answer to 'step' is malformed");
    if (st == MK_OK)
        w->at_ns = (int64_t)mk_get64(f.payload);
    return st;
}

/* Steps until the board's clock stands `margin_ns` before `to_ns`, or later. */
static enum mk_status step_near(struct mk_wire *w, int64_t to_ns, int64_t margin_ns)
{
    enum mk_status st = MK_OK;
    while (st == MK_OK && to_ns - w->at_ns > margin_ns) {
        int64_t before_ns = w->at_ns;
        st = step(w, to_ns - w->at_ns > STEP_NS ? w->at_ns + STEP_NS : to_ns);
        if (st == MK_OK && w->at_ns <= before_ns)
            st = mk_error_set(&w->trouble, MK_ERR_PROTO, "the board's clock does not follow");
    }
    return st;
}

enum mk_status mk_wire_request(struct mk_wire *w, enum mk_message type, const uint8_t *payload,
                               size_t length, int tries, int64_t timeout_ns,
                               struct mk_frame *answer)
{
    /* An exchange takes its time with it. The motor goes off even if the clock does not follow. */
    enum mk_status st = MK_OK;
    if (w->clock && type != MK_MSG_HELLO && type != MK_MSG_EXCHANGE && !hurries(w, type))
        st = step_near(w, board_now_ns(w), 0);
    if (st != MK_OK && type != MK_MSG_SAFE)
        return st;
    return request(w, type, payload, length, tries, timeout_ns, answer);
}

enum mk_status mk_wire_follow(struct mk_wire *w, struct mk_clock *clock, struct mk_error *err)
{
    if (!(w->capabilities & MK_WIRE_CAP_STEP))
        return mk_error_set(err, MK_ERR_NOTSUP,
                            "this board does not say that it is simulated, so it runs in real time "
                            "only: leave out --fast");
    enum mk_status st = step(w, 0);
    if (st != MK_OK) {
        if (err)
            *err = w->trouble;
        return st;
    }
    w->clock = clock;
    w->ahead_ns = w->at_ns - mk_clock_now_ns(clock);
    return MK_OK;
}

/* --- requests ---------------------------------------------------------------------------------
 */

/* As above, as patient as a request outside the loop may be, with the reason in *err. */
static enum mk_status ask(struct mk_wire *w, enum mk_message type, const uint8_t *payload,
                          size_t length, struct mk_frame *answer, struct mk_error *err)
{
    enum mk_status st =
        mk_wire_request(w, type, payload, length, REQUEST_TRIES, REQUEST_NS, answer);
    if (st != MK_OK && err)
        *err = w->trouble;
    return st;
}

/* --- hello ------------------------------------------------------------------------------------ */

static void copy_text(char *to, size_t size, const uint8_t *from)
{
    size_t n = 0;
    while (n < MK_HELLO_TEXT && n + 1 < size && from[n] >= 0x20 && from[n] < 0x7f)
        n++;
    memcpy(to, from, n);
    to[n] = '\0';
}

/* The version comes first, in an identity of any length: what follows it is of that version. */
static enum mk_status check_hello(struct mk_wire *w, const struct mk_frame *f)
{
    if (f->length > MK_HELLO_VERSION && f->payload[MK_HELLO_VERSION] != MK_FRAME_VERSION)
        return other_version(w, f->payload[MK_HELLO_VERSION]);
    if (f->length < MK_HELLO_SIZE)
        return mk_error_set(&w->trouble, MK_ERR_PROTO, "the board's hello is malformed");
    return MK_OK;
}

enum mk_status mk_wire_open(struct mk_wire *w, const struct mk_link_ops *ops, void *link,
                            struct mk_error *err)
{
    memset(w, 0, sizeof *w);
    w->ops = ops;
    w->link = link;
    /* Answers to whoever was here before must not look like answers to us. */
    w->sequence = (uint32_t)(monotonic_ns() >> 10);
    struct mk_frame f;
    enum mk_status st = mk_wire_request(w, MK_MSG_HELLO, NULL, 0, REQUEST_TRIES, HELLO_NS, &f);
    if (st == MK_OK)
        st = check_hello(w, &f);
    if (st != MK_OK) {
        if (err)
            *err = w->trouble;
        return st;
    }
    struct mk_board_identity *id = &w->identity;
    copy_text(id->name, sizeof id->name, f.payload + MK_HELLO_PRODUCT);
    copy_text(id->firmware, sizeof id->firmware, f.payload + MK_HELLO_FIRMWARE);
    copy_text(id->serial, sizeof id->serial, f.payload + MK_HELLO_SERIAL);
    id->counter_bits = f.payload[MK_HELLO_COUNTER_BITS];
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        id->encoder_cpr[j] = (int32_t)mk_get32(f.payload + MK_HELLO_CPR + 4 * j);
    w->capabilities = mk_get32(f.payload + MK_HELLO_CAPABILITIES);
    w->u_max = (double)(int32_t)mk_get32(f.payload + MK_HELLO_U_MAX) / MK_WIRE_MICRO;
    if (id->counter_bits < 8 || id->counter_bits > 32)
        return mk_error_set(err, MK_ERR_PROTO, "the board claims counters of %d bits",
                            id->counter_bits);
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        if (id->encoder_cpr[j] < 0 || id->encoder_cpr[j] > CPR_MAX)
            return mk_error_set(err, MK_ERR_PROTO,
                                "the board claims %d counts a turn for encoder %d: 1 to %d, or 0 "
                                "when it does not know",
                                id->encoder_cpr[j], j + 1, CPR_MAX);
    return MK_OK;
}

/* --- requests -------------------------------------------------------------------------------- */

static void put_command(uint8_t *p, double u)
{
    mk_put32(p, (uint32_t)(int32_t)lround(u * MK_WIRE_MICRO));
}

static enum mk_status parse_reading(const struct mk_frame *f, struct mk_wire_reading *out)
{
    if (f->length < MK_READING_SIZE)
        return MK_ERR_PROTO;
    const uint8_t *p = f->payload;
    out->status = mk_get16(p + MK_READING_STATUS);
    out->fault = mk_get16(p + MK_READING_FAULT);
    out->sample = (struct mk_board_sample){
        .board_ns = (int64_t)mk_get64(p + MK_READING_TIME),
        .status = out->status & (MK_WIRE_ST_WATCHDOG | MK_WIRE_ST_SATURATED | MK_WIRE_ST_FAULT |
                                 MK_WIRE_ST_STANDALONE),
        .sequence = mk_get32(p + MK_READING_EXCHANGES),
        .u_applied = (double)(int32_t)mk_get32(p + MK_READING_APPLIED) / MK_WIRE_MICRO};
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        out->sample.count[j] = (int32_t)mk_get32(p + MK_READING_COUNT + 4 * j);
    return MK_OK;
}

enum mk_status mk_wire_exchange(struct mk_wire *w, double u, struct mk_wire_reading *out)
{
    uint8_t payload[MK_EXCHANGE_AT_SIZE];
    struct mk_frame f;
    size_t n = MK_EXCHANGE_SIZE;
    put_command(payload, u);
    if (w->clock) {
        enum mk_status st = step_near(w, board_now_ns(w), STEP_NS);
        if (st != MK_OK)
            return st;
        mk_put64(payload + n, (uint64_t)board_now_ns(w));
        n = MK_EXCHANGE_AT_SIZE;
    }
    enum mk_status st = mk_wire_request(w, MK_MSG_EXCHANGE, payload, n, 1, MK_WIRE_EXCHANGE_NS, &f);
    if (st == MK_OK)
        st = parse_reading(&f, out);
    if (st == MK_OK && w->clock)
        w->at_ns = out->sample.board_ns;
    return st;
}

enum mk_status mk_wire_state(struct mk_wire *w, struct mk_wire_state *out, struct mk_error *err)
{
    struct mk_frame f;
    enum mk_status st = ask(w, MK_MSG_STATE, NULL, 0, &f, err);
    if (st != MK_OK)
        return st;
    if (f.length < MK_STATE_SIZE)
        return mk_error_set(err, MK_ERR_PROTO, "the board's state is malformed");
    const uint8_t *p = f.payload;
    *out = (struct mk_wire_state){
        .status = mk_get16(p + MK_STATE_STATUS),
        .fault = mk_get16(p + MK_STATE_FAULT),
        .fault_ns = mk_get64(p + MK_STATE_FAULT_TIME),
        .now_ns = mk_get64(p + MK_STATE_TIME),
        .broken = mk_get32(p + MK_STATE_BROKEN),
        .stale = mk_get32(p + MK_STATE_STALE),
        .repeated = mk_get32(p + MK_STATE_REPEATED),
        .bites = mk_get32(p + MK_STATE_BITES),
        .exchanges = mk_get32(p + MK_STATE_EXCHANGES),
        .recorded = mk_get32(p + MK_STATE_RECORDED),
        .switches = p[MK_STATE_SWITCHES],
        .controller = p[MK_STATE_CONTROLLER],
        .phase = p[MK_STATE_PHASE],
    };
    return MK_OK;
}

enum mk_status mk_wire_clear(struct mk_wire *w, struct mk_error *err)
{
    return ask(w, MK_MSG_CLEAR, NULL, 0, NULL, err);
}

enum mk_status mk_wire_lcd(struct mk_wire *w, unsigned row, const char *text, struct mk_error *err)
{
    uint8_t payload[1 + MK_LCD_COLUMNS] = {(uint8_t)row};
    size_t n = strnlen(text, MK_LCD_COLUMNS);
    memcpy(payload + 1, text, n);
    return ask(w, MK_MSG_LCD, payload, 1 + n, NULL, err);
}

enum mk_status mk_wire_leds(struct mk_wire *w, uint8_t mask, struct mk_error *err)
{
    return ask(w, MK_MSG_LEDS, &mask, 1, NULL, err);
}

/* --- streaming ------------------------------------------------------------------------------- */

enum mk_status mk_wire_stream(struct mk_wire *w, uint32_t period_us, struct mk_error *err)
{
    uint8_t payload[4];
    mk_put32(payload, period_us);
    return ask(w, MK_MSG_STREAM, payload, sizeof payload, NULL, err);
}

/* A step on a stream goes out behind the answer to a sample, and nobody waits between the two. */
static bool is_before_step(const struct mk_wire *w, const struct mk_frame *f)
{
    return w->clock && f->sequence + 1 == w->sequence;
}

enum mk_status mk_wire_next_sample(struct mk_wire *w, int64_t timeout_ns, uint32_t *number,
                                   struct mk_wire_reading *out)
{
    int64_t deadline_ns = monotonic_ns() + timeout_ns;
    struct mk_frame f;
    for (int late = 0; late <= LATE_LOOKS; late += monotonic_ns() >= deadline_ns) {
        enum mk_status st = w->gone ? MK_ERR_NODEV : next_frame(w, &f, deadline_ns);
        if (st == MK_ERR_NODEV)
            w->gone = true;
        if (st != MK_OK)
            return st;
        if (f.type == MK_MSG_SAMPLE) {
            *number = f.sequence;
            return parse_reading(&f, out);
        }
        if (f.type == MK_MSG_REFUSED && (f.sequence == w->sequence || is_before_step(w, &f)))
            return refused(w, &f);
    }
    return MK_ERR_TIMEOUT;
}

/* Sends what nobody waits to be answered. */
static enum mk_status post(struct mk_wire *w, enum mk_message type, const uint8_t *payload,
                           size_t length, int64_t timeout_ns)
{
    if (w->gone)
        return MK_ERR_NODEV;
    w->sequence++;
    return send_frame(w, type, payload, length, monotonic_ns() + timeout_ns);
}

enum mk_status mk_wire_answer_sample(struct mk_wire *w, uint32_t number, double u)
{
    uint8_t payload[8];
    mk_put32(payload, number);
    put_command(payload + 4, u);
    return post(w, MK_MSG_COMMAND, payload, sizeof payload, MK_WIRE_EXCHANGE_NS);
}

/* Where the board's clock follows ours, its next sample waits for the clock, and ours for it. The
 * sample comes before the answer to the step, which nobody waits for. */
static enum mk_status step_to_sample(struct mk_wire *w)
{
    uint8_t payload[8];
    mk_clock_sleep_until(w->clock, w->next_ns - w->ahead_ns);
    mk_put64(payload, (uint64_t)w->next_ns);
    return post(w, MK_MSG_STEP, payload, sizeof payload, STEPPED_NS);
}

/* Of several samples that wait the newest counts: the time of the others is gone. */
static enum mk_status take_newest(struct mk_wire *w, struct mk_wire_reading *out)
{
    int64_t patience_ns =
        w->clock ? STEPPED_NS : (int64_t)w->stream_us * 1000 + MK_WIRE_EXCHANGE_NS;
    enum mk_status stepped = w->clock ? step_to_sample(w) : MK_OK;
    if (stepped != MK_OK)
        return stepped;
    int64_t deadline_ns = monotonic_ns() + patience_ns;
    enum mk_status st = mk_wire_next_sample(w, patience_ns, &w->newest, out);
    struct mk_frame f;
    if (st != MK_OK)
        return st;
    w->any = true;
    while (monotonic_ns() < deadline_ns && next_frame(w, &f, 0) == MK_OK)
        if (f.type == MK_MSG_SAMPLE && parse_reading(&f, out) == MK_OK)
            w->newest = f.sequence;
    w->at_ns = out->sample.board_ns;
    w->next_ns = w->at_ns + (int64_t)w->stream_us * 1000;
    return MK_OK;
}

/* The board streams no longer: its status says why. */
static enum mk_status why_it_ended(struct mk_wire *w, struct mk_wire_reading *out)
{
    w->stream_us = 0;
    enum mk_status st = mk_wire_exchange(w, 0.0, out);
    bool told = (out->status & (MK_WIRE_ST_WATCHDOG | MK_WIRE_ST_FAULT)) != 0;
    return st == MK_OK && !told ? MK_ERR_STATE : st;
}

/* An exchange with a board that streams: the answer to its last sample, then the next one. The same
 * answer again does no harm; it finds out whether the board is still there. */
static enum mk_status stream_exchange(struct mk_wire *w, double u, struct mk_wire_reading *out)
{
    enum mk_status st = w->any ? mk_wire_answer_sample(w, w->newest, u) : MK_OK;
    if (st != MK_ERR_NODEV) /* a command that did not get out shows in the sample */
        st = take_newest(w, out);
    return st == MK_ERR_STATE ? why_it_ended(w, out) : st;
}

/* --- stand-alone control -------------------------------------------------------------------------
 */

enum mk_status mk_wire_setup(struct mk_wire *w, int controller, uint32_t period_us,
                             unsigned record_every, int *gains, struct mk_error *err)
{
    uint8_t payload[8] = {(uint8_t)controller, (uint8_t)record_every};
    struct mk_frame f;
    mk_put32(payload + 4, period_us);
    enum mk_status st = ask(w, MK_MSG_SETUP, payload, sizeof payload, &f, err);
    if (st != MK_OK)
        return st;
    int n = f.length > 0 ? f.payload[0] : 0;
    if (n > MK_STANDALONE_GAINS)
        return mk_error_set(err, MK_ERR_PROTO, "the board claims %d gains, more than %d", n,
                            MK_STANDALONE_GAINS);
    *gains = n;
    return MK_OK;
}

enum mk_status mk_wire_gains(struct mk_wire *w, int first, const float *value, int n,
                             struct mk_error *err)
{
    uint8_t payload[2 + 4 * MK_STANDALONE_GAINS] = {(uint8_t)first, (uint8_t)n};
    if (first < 0 || n < 0 || n > MK_STANDALONE_GAINS)
        return mk_error_set(err, MK_ERR_RANGE, "%d gains from %d on are too many", n, first);
    for (int i = 0; i < n; i++) {
        uint32_t bits;
        memcpy(&bits, &value[i], sizeof bits);
        mk_put32(payload + 2 + 4 * i, bits);
    }
    return ask(w, MK_MSG_GAINS, payload, 2 + 4 * (size_t)n, NULL, err);
}

enum mk_status mk_wire_start(struct mk_wire *w, struct mk_error *err)
{
    return ask(w, MK_MSG_START, NULL, 0, NULL, err);
}

enum mk_status mk_wire_halt(struct mk_wire *w, struct mk_error *err)
{
    return ask(w, MK_MSG_HALT, NULL, 0, NULL, err);
}

enum mk_status mk_wire_upload(struct mk_wire *w, uint32_t first, struct mk_standalone_record *out,
                              int max, int *got, struct mk_error *err)
{
    uint8_t payload[5];
    struct mk_frame f;
    mk_put32(payload, first);
    payload[4] = (uint8_t)(max < MK_UPLOAD_MAX ? max : MK_UPLOAD_MAX);
    enum mk_status st = ask(w, MK_MSG_UPLOAD, payload, sizeof payload, &f, err);
    if (st != MK_OK)
        return st;
    int n = f.length >= MK_UPLOAD_HEADER ? f.payload[4] : -1;
    if (n < 0 || n > max || f.length != MK_UPLOAD_HEADER + n * MK_RECORD_SIZE)
        return mk_error_set(err, MK_ERR_PROTO, "the board's records are malformed");
    const uint8_t *p = f.payload + MK_UPLOAD_HEADER;
    for (int i = 0; i < n; i++, p += MK_RECORD_SIZE)
        out[i] = (struct mk_standalone_record){mk_get32(p),
                                               {(int32_t)mk_get32(p + 4), (int32_t)mk_get32(p + 8)},
                                               (int32_t)mk_get32(p + 12),
                                               mk_get32(p + 16)};
    *got = n;
    return MK_OK;
}

/* --- slots of the board interface --------------------------------------------------------------
 */

struct mk_wire *mk_wire_of(struct mk_board *board)
{
    return board->ops->identify == mk_wire_board_identify ? board->priv : NULL;
}

enum mk_status mk_wire_check_model(const struct mk_wire *w, const struct mk_model *model,
                                   struct mk_error *err)
{
    if (model->u_max > w->u_max)
        return mk_error_set(err, MK_ERR_RANGE,
                            "the model's u_max %g is beyond the %g that this board gives",
                            model->u_max, w->u_max);
    return MK_OK;
}

enum mk_status mk_wire_board_identify(struct mk_board *board, struct mk_board_identity *out,
                                      struct mk_error *err)
{
    struct mk_wire *w = board->priv;
    /* Asked for, not remembered: the point is that somebody is there. */
    struct mk_wire_state state;
    enum mk_status st = mk_wire_state(w, &state, err);
    if (st == MK_OK)
        *out = w->identity;
    return st;
}

enum mk_status mk_wire_board_zero(struct mk_board *board, struct mk_error *err)
{
    return ask(board->priv, MK_MSG_ZERO, NULL, 0, NULL, err);
}

enum mk_status mk_wire_board_exchange(struct mk_board *board, double u, struct mk_board_sample *out)
{
    struct mk_wire *w = board->priv;
    struct mk_wire_reading reading = {0};
    enum mk_status st =
        w->stream_us ? stream_exchange(w, u, &reading) : mk_wire_exchange(w, u, &reading);
    if (st == MK_OK)
        *out = reading.sample;
    return st;
}

enum mk_status mk_wire_board_stream(struct mk_board *board, uint32_t period_us,
                                    struct mk_error *err)
{
    struct mk_wire *w = board->priv;
    enum mk_status st = mk_wire_stream(w, period_us, err);
    w->stream_us = st == MK_OK ? period_us : 0;
    w->any = false;
    w->next_ns = w->at_ns; /* the first comes at once */
    return st;
}

enum mk_status mk_wire_board_safe(struct mk_board *board)
{
    struct mk_wire *w = board->priv;
    w->stream_us = 0;
    return mk_wire_request(w, MK_MSG_SAFE, NULL, 0, SAFE_TRIES, SAFE_NS, NULL);
}

enum mk_status mk_wire_board_watchdog(struct mk_board *board, unsigned timeout_ms,
                                      struct mk_error *err)
{
    struct mk_wire *w = board->priv;
    enum mk_status st = mk_wire_clear(w, err);
    if (st != MK_OK)
        return st;
    uint8_t payload[4];
    mk_put32(payload, timeout_ms);
    return ask(w, MK_MSG_WATCHDOG, payload, sizeof payload, NULL, err);
}

enum mk_status mk_wire_board_follow(struct mk_board *board, struct mk_error *err)
{
    return mk_wire_follow(board->priv, board->clock, err);
}
