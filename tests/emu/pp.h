/* A board at an emulated parallel port: what ppdev shows of it, errors as the real ppdev's
 * (Linux 6.1), with a plan of faults. One program at a time can hold the node. */
#ifndef MECHKIT_TESTS_EMU_PP_H
#define MECHKIT_TESTS_EMU_PP_H

#include <stdatomic.h>

#include "emu/line.h"
#include "emu/node.h"

struct emu_pp {
    struct emu_line line;
    struct mk_emulated *timed; /* for streaming: whose time passes as a caller looks; or NULL */
    struct emu_node node;
    char path[24];
    unsigned port_modes;  /* PARPORT_MODE_*: what the port can do */
    unsigned board_modes; /* IEEE1284_MODE_*, one bit each: what the board agrees to */
    bool denied, taken;   /* no permission; claimed by another driver */
    bool excl, claimed;
    bool registered;          /* has been claimed since it was opened */
    int mode;                 /* IEEE1284_MODE_* negotiated */
    int64_t patience_us;      /* of the kernel's handshakes */
    int released_in;          /* the mode in which it was released; -1: it has not been */
    int64_t blocked_until_ns; /* takes no request before; CLOCK_MONOTONIC */
    atomic_bool unplugged;    /* by whoever tests, while a loop runs */
};

#define EMU_PP_EPP 1u
#define EMU_PP_BYTE 2u
#define EMU_PP_NIBBLE 4u

/* `board_modes` as above; the port can do all. */
void emu_pp_init(struct emu_pp *p, int number, unsigned board_modes, struct emu_board board);
void emu_pp_free(struct emu_pp *p);

#endif
