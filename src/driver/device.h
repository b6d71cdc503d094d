/* The board's side of the wire protocol, as it would run in the board's firmware: portable C
 * without heap, operating system or globals. Whoever ports it supplies the table of hardware
 * functions and calls mk_device_receive with the bytes that arrive and mk_device_poll at least
 * every millisecond (or when mk_device_next_event says so). The emulated boards run this very code.
 *
 * The motor is off unless a host, or a stand-alone controller that was started, keeps it on: after
 * HELLO, SAFE, a watchdog that fired and any fault the command is 0, and a latched fault keeps it
 * there until CLEAR.
 */
#ifndef MECHKIT_DRIVER_DEVICE_H
#define MECHKIT_DRIVER_DEVICE_H

#include "driver/protocol.h"
#include "driver/standalone.h"

/* The electronics. `user` is passed along; slots marked optional may be NULL. */
struct mk_device_hal {
    void *user;
    uint64_t (*now_ns)(void *user);
    void (*read_counters)(void *user, int32_t count[MK_WIRE_JOINTS]); /* sign-extended */
    void (*zero_counters)(void *user);
    /* Takes over a command, |micro| <= u_max_micro; returns what the amplifier really gives. */
    int32_t (*apply)(void *user, int32_t micro);
    void (*send)(void *user, const uint8_t *bytes, size_t n);
    /* A fault of the electronics (enum mk_wire_fault, 64 and up), 0 when all is well. Optional. */
    uint16_t (*alarm)(void *user);
    void (*lcd)(void *user, unsigned row, const char text[MK_LCD_COLUMNS + 1]); /* optional */
    void (*leds)(void *user, uint8_t mask);                                     /* optional */
    uint8_t (*switches)(void *user);                                            /* optional */
    /* A simulated board. The clock goes on to `ns`, with mk_device_poll whenever something is due,
     * and stands from then on until it is stepped again. Optional. */
    void (*step)(void *user, uint64_t ns);
    /* It runs by itself again. With step. */
    void (*run_freely)(void *user);
};

struct mk_device_info {
    char product[MK_HELLO_TEXT + 1];
    char firmware[MK_HELLO_TEXT + 1];
    char serial[MK_HELLO_TEXT + 1];
    int32_t cpr[MK_WIRE_JOINTS];
    uint8_t encoders;
    uint8_t counter_bits;
    int32_t u_max_micro;
};

struct mk_device {
    const struct mk_device_hal *hal;
    struct mk_device_info info;

    int32_t micro;   /* command wished for */
    int32_t applied; /* command in force */
    uint16_t fault;  /* enum mk_wire_fault, latched */
    uint64_t fault_ns;

    uint64_t watchdog_ns; /* 0: off */
    bool watched;         /* the host has set it */
    uint64_t fed_ns;
    bool fired;

    uint32_t stream_us; /* period; 0: off */
    uint64_t stream_next_ns;
    uint32_t stream_sample;   /* number of the next one */
    uint32_t stream_answered; /* samples up to here are answered */
    int32_t stream_micro;     /* the newest answer: acts with the next sample */

    struct mk_standalone standalone;
    bool stepped; /* the host steps the clock */

    struct mk_decoder decoder;
    unsigned line_errors; /* rises by 8 a broken frame, falls by 1 a good one */
    bool greeted;         /* sequence numbers mean something */
    uint32_t sequence;    /* of the newest request */
    uint32_t stale, repeated, bites, exchanges;
    uint8_t answer[MK_FRAME_MAX]; /* to the newest request, for its repetition */
    size_t answer_size;
};

void mk_device_init(struct mk_device *d, const struct mk_device_hal *hal,
                    const struct mk_device_info *info);
/* Bytes from the host, cut anywhere. Answers go out through hal->send before this returns. */
void mk_device_receive(struct mk_device *d, const uint8_t *bytes, size_t n);
/* What is due by now: watchdog, streamed samples, stand-alone control, alarms. */
void mk_device_poll(struct mk_device *d);
/* When mk_device_poll has something to do next, ns of the board's clock; UINT64_MAX: never. */
uint64_t mk_device_next_event(const struct mk_device *d);
/* The host has hung up: motor off, at once and not only when the watchdog sees it; a clock that was
 * stepped runs again. Nothing but HELLO is taken from here on. */
void mk_device_hang_up(struct mk_device *d);
/* Latches a fault (the first one stays) and switches the motor off. */
void mk_device_trip(struct mk_device *d, uint16_t fault);

#endif
