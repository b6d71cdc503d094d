/* A bench with an emulated board on it, plugged into a bus. For boards on real buses, which run in
 * real time only, it makes a back end that accepts a simulated clock as well: the emulated board
 * lives on that clock, so the whole chain through the bus is repeatable and fast. */
#ifndef MECHKIT_TESTS_EMU_BENCH_H
#define MECHKIT_TESTS_EMU_BENCH_H

#include "emu/pp.h"
#include "emu/stream.h"
#include "emu/usb.h"
#include "mechkit/board.h"

struct emu_bench {
    struct mk_emulated board;
    struct emu_usb usb;
    struct emu_pp pp;
    struct emu_stream stream;
    bool stepped;
    struct mk_step_clock clock; /* of a board that is stepped */
    struct emu_line *line;      /* of the bus it is on */
    const char *device;         /* for mk_board_config; NULL: the first is the one */
    struct mk_board_ops ops;    /* of the back end, FAST added */
};

/* `back_end`: "usb", "parport" (EPP), "parport-byte" or "parport-nibble" (a board that agrees to no
 * more), "tcp" (a connection of this machine with itself), "serial" (a pseudo-terminal),
 * "serial-cut" (of an answer twelve bytes at a time can be read), "tcp-stepped" (a board with a
 * clock of its own, which the host steps), or one that needs no bench ("virtual", "null"). */
void emu_bench_init(struct emu_bench *b, const char *back_end,
                    const struct mk_board_config *config);
/* Plugs in again what the plan has unplugged. */
void emu_bench_plug(struct emu_bench *b);
/* Pulls the cable. */
void emu_bench_unplug(struct emu_bench *b);
void emu_bench_free(struct emu_bench *b);

#endif
