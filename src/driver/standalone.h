/* Controllers that run on the board itself, as the original kit's did: the host downloads gains,
 * starts and halts them, and fetches the recorded arrays afterwards. Portable C in single
 * precision, part of the board's side of the protocol (device.h). docs/protocol.md lists
 * controllers and gains.
 */
#ifndef MECHKIT_DRIVER_STANDALONE_H
#define MECHKIT_DRIVER_STANDALONE_H

#include <stdbool.h>
#include <stdint.h>

#include "driver/protocol.h"

#define MK_STANDALONE_GAINS 24
#ifndef MK_STANDALONE_RECORDS
#define MK_STANDALONE_RECORDS 4096 /* 20 bytes each; a smaller board sets its own number */
#endif

enum mk_controller {
    MK_CONTROLLER_NONE = 0,
    MK_CONTROLLER_PENDUBOT_MID = 1,
    MK_CONTROLLER_PENDUBOT_TOP = 2,
    MK_CONTROLLER_REACTION_WHEEL = 3,
    MK_CONTROLLER_FURUTA = 4,
    MK_CONTROLLER_PI_SPEED = 5,
    MK_CONTROLLER_COUNT
};

/* Phases as in the log. */
enum { MK_STANDALONE_IDLE, MK_STANDALONE_SWINGUP, MK_STANDALONE_BALANCE, MK_STANDALONE_TRACK };

struct mk_standalone_record {
    uint32_t sample;
    int32_t count[MK_WIRE_JOINTS];
    int32_t micro; /* command in force from this sample on */
    uint32_t phase;
};

struct mk_standalone {
    enum mk_controller controller;
    uint32_t period_us;
    uint32_t record_every; /* samples a record */
    float gain[MK_STANDALONE_GAINS];
    bool running;

    uint64_t next_ns;
    uint32_t sample;
    uint32_t phase;
    int32_t raw[MK_WIRE_JOINTS];   /* counters as read last */
    int32_t total[MK_WIRE_JOINTS]; /* counts from rest, unwrapped; of a wheel less whole turns */
    float angle[MK_WIRE_JOINTS];   /* filtered, rad from rest */
    float speed[MK_WIRE_JOINTS];
    float acceleration[MK_WIRE_JOINTS];
    float integral;
    bool going_round;

    uint32_t recorded;
    struct mk_standalone_record record[MK_STANDALONE_RECORDS];
};

/* Number of gains a controller takes; 0 for one that is not there. */
int mk_standalone_gain_count(enum mk_controller controller);
/* Chooses a controller with its default gains, halted. False: there is none of that number. */
bool mk_standalone_setup(struct mk_standalone *s, enum mk_controller controller, uint32_t period_us,
                         uint32_t record_every);
void mk_standalone_start(struct mk_standalone *s, uint64_t now_ns);
/* Where a joint is, rad from rest, by its counter of so many bits and counts a turn; once a sample.
 * Counters wrap. A wheel's angle, for which no law asks, loses its whole turns: it would outgrow a
 * float. */
float mk_standalone_follow(struct mk_standalone *s, int joint, int32_t count, int bits,
                           int32_t cpr);
/* One sample: angles from rest (rad) in, command wished for (command units) out. */
float mk_standalone_step(struct mk_standalone *s, const float q[MK_WIRE_JOINTS]);
/* True when a link is so far from rest that something must have broken. */
bool mk_standalone_out_of_travel(const struct mk_standalone *s);
void mk_standalone_record(struct mk_standalone *s, const int32_t count[MK_WIRE_JOINTS],
                          int32_t micro);

#endif
