/* A board's side of the protocol on electronics made of a few variables, and a host by hand. One of
 * each, for the suites of the device. */
#ifndef MK_TESTS_DEVICE_BENCH_H
#define MK_TESTS_DEVICE_BENCH_H

#include "driver/device.h"

#define MS 1000000ull
#define VOLT (MK_WIRE_MICRO) /* one command unit */

extern struct electronics {
    uint64_t now_ns;
    int32_t count[MK_WIRE_JOINTS];
    int32_t micro, weak; /* command in force; what a weak amplifier gives at most */
    uint16_t alarm;
    char lcd[MK_LCD_ROWS][MK_LCD_COLUMNS + 1];
    uint8_t leds, switches;
    uint8_t sent[4096];
    size_t sent_size;
    int answers;
} hw;
extern struct mk_device device;
extern struct mk_device_hal hal;
extern uint32_t sequence; /* of the host's latest request */
extern struct mk_decoder host;

/* Everything at rest, and the board switched on. */
void set_up_device(void);
void switch_on(void);

/* Sends one frame and decodes the first answer; type 0 when there is none. */
struct mk_frame send_frame(uint8_t version, uint8_t type, uint32_t seq, const uint8_t *payload,
                           size_t n);
struct mk_frame ask(enum mk_message type, const uint8_t *payload, size_t n);
struct mk_frame ask_number(enum mk_message type, uint32_t value);
/* The same, which must be answered. */
void must(enum mk_message type, const uint8_t *payload, size_t n);
void number(enum mk_message type, uint32_t value);
void must_refuse(enum mk_refusal why, struct mk_frame f);
void greet(void);

struct reading {
    int32_t count[2], micro;
    uint64_t t_ns;
    unsigned status, fault;
    uint32_t exchanges;
};

struct reading parse(const uint8_t *p);
struct reading exchange(int32_t micro);

/* Time goes by, and the board looks after itself. */
void pass(uint64_t ns);

#endif
