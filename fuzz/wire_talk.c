#include "wire_talk.h"

#include <string.h>
#include <time.h>

#include "driver/protocol.h"

#define LOOK_NS 100000

static struct {
    const uint8_t *at;
    size_t left;
    int64_t now_ns;
    struct mk_decoder decoder;
    struct mk_frame request;
    uint32_t sample;
    bool for_ever; /* says the last again and again */
    bool gone;
    uint8_t said[2 * MK_FRAME_MAX]; /* not taken yet, from `from` on */
    size_t size, from;
} talk;

void talk_begin(const uint8_t *data, size_t size)
{
    memset(&talk, 0, sizeof talk);
    talk.at = data;
    talk.left = size;
    talk.now_ns = 1000000000;
    mk_decoder_reset(&talk.decoder);
}

uint8_t talk_byte(void)
{
    if (talk.left == 0)
        return 0;
    talk.left--;
    return *talk.at++;
}

bool talk_ended(void)
{
    return talk.left == 0;
}

int64_t talk_now_ns(void)
{
    return talk.now_ns;
}

void talk_pass(int64_t ns)
{
    talk.now_ns += ns > 0 ? ns : 0;
}

/* Takes the places of the C library's in the host's code (Makefile). */
int clock_gettime(clockid_t id, struct timespec *t)
{
    (void)id;
    talk_pass(LOOK_NS);
    t->tv_sec = talk.now_ns / 1000000000;
    t->tv_nsec = talk.now_ns % 1000000000;
    return 0;
}

int nanosleep(const struct timespec *wanted, struct timespec *left)
{
    (void)left;
    talk_pass(wanted->tv_nsec);
    return 0;
}

void talk_heard(const uint8_t *bytes, size_t n)
{
    struct mk_frame f;
    while (mk_decoder_next(&talk.decoder, &bytes, &n, &f))
        talk.request = f;
}

/* A frame with a payload from the bytes, whole and with right checks. */
static void say_frame(uint8_t how, uint8_t type, uint32_t sequence)
{
    uint8_t payload[MK_FRAME_PAYLOAD_MAX];
    size_t n = talk_byte() % (sizeof payload + 1);
    for (size_t i = 0; i < n; i++)
        payload[i] = talk_byte();
    const struct mk_frame f = {(uint8_t)(how & 0x80 ? 2 : MK_FRAME_VERSION), type, (uint16_t)n,
                               sequence, payload};
    talk.size = mk_frame_encode(&f, talk.said);
}

/* The answer to the last request as a board in its senses gives it, but for what the bytes say. */
static void say_answer(uint8_t how)
{
    static const struct {
        uint8_t type;
        uint8_t size;
    } sizes[] = {{MK_MSG_HELLO, MK_HELLO_SIZE},
                 {MK_MSG_EXCHANGE, MK_READING_SIZE},
                 {MK_MSG_STATE, MK_STATE_SIZE},
                 {MK_MSG_SETUP, 1}};
    uint8_t payload[MK_FRAME_PAYLOAD_MAX] = {0};
    size_t n = 0;
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++)
        if (sizes[i].type == talk.request.type)
            n = sizes[i].size;
    if (talk.request.type == MK_MSG_HELLO) {
        payload[MK_HELLO_VERSION] = MK_FRAME_VERSION;
        payload[MK_HELLO_COUNTER_BITS] = 24;
        mk_put32(payload + MK_HELLO_U_MAX, 10 * MK_WIRE_MICRO);
        memset(payload + MK_HELLO_PRODUCT, 'x', MK_HELLO_TEXT);
    }
    for (int k = how >> 3 & 7; k > 0 && n > 0; k--) {
        size_t place = talk_byte() % n;
        payload[place] = talk_byte();
    }
    const struct mk_frame f = {MK_FRAME_VERSION, talk.request.type | MK_MSG_ANSWER, (uint16_t)n,
                               talk.request.sequence, payload};
    talk.size = mk_frame_encode(&f, talk.said);
}

static void say_raw(void)
{
    size_t n = talk_byte();
    for (talk.size = 0; talk.size < n && !talk_ended(); talk.size++)
        talk.said[talk.size] = talk_byte();
}

static enum talk_event next_thing(void)
{
    uint8_t how = talk_byte();
    talk.from = 0;
    switch (how & 7) {
    case 0:
        say_answer(how);
        break;
    case 1:
        say_frame(how, talk.request.type | MK_MSG_ANSWER, talk.request.sequence);
        break;
    case 2:
        say_frame(how, MK_MSG_SAMPLE, talk.sample += how >> 3 & 3);
        break;
    case 3:
        say_frame(how, MK_MSG_REFUSED, talk.request.sequence);
        break;
    case 4:
        say_frame(how, talk_byte(), talk.request.sequence - 1 + (how >> 3 & 3));
        break;
    case 5:
        say_raw();
        break;
    case 6:
        return how >> 3 == 31 ? TALK_GONE : how >> 3 & 1 ? TALK_GARBLED : TALK_SILENCE;
    default: /* the last one again, and again */
        talk.for_ever = how >> 3 == 31;
        break;
    }
    return TALK_BYTES;
}

enum talk_event talk_say(uint8_t *out, size_t room, size_t *n)
{
    if (talk.gone)
        return TALK_GONE;
    if (talk.for_ever) {
        talk.from = 0;
    } else if (talk.from == talk.size) {
        enum talk_event e = talk_ended() ? TALK_SILENCE : next_thing();
        talk.gone = e == TALK_GONE;
        if (e != TALK_BYTES)
            return e;
    }
    size_t left = talk.size - talk.from;
    if (left == 0)
        return TALK_SILENCE;
    *n = left < room ? left : room;
    memcpy(out, talk.said + talk.from, *n);
    talk.from += *n;
    return TALK_BYTES;
}
