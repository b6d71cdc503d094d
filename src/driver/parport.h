/* The parallel-port link: frames over /dev/parportN, by ppdev.
 *
 * EPP where port and board have it: bytes out and in by single cycles, and the board pulls nFault
 * low while it has something to say. Else IEEE 1284's older ways, whose handshakes the kernel does:
 * out in compatibility mode, in by byte mode (a port whose data lines can be turned round) or
 * nibble mode (any port), with a negotiation for each change of direction.
 */
#ifndef MECHKIT_DRIVER_PARPORT_H
#define MECHKIT_DRIVER_PARPORT_H

#include "driver/wire.h"

enum mk_parport_mode { MK_PARPORT_EPP, MK_PARPORT_BYTE, MK_PARPORT_NIBBLE };

struct mk_parport {
    int fd; /* -1: closed */
    bool claimed;
    enum mk_parport_mode mode;
    bool reverse; /* byte and nibble mode: the port is turned inwards */
    uint8_t buffer[MK_FRAME_MAX];
};

extern const struct mk_link_ops mk_parport_link;

const char *mk_parport_mode_name(enum mk_parport_mode mode);

/* Claims the port `device` (NULL: the first of /dev/parport0 .. 3 that opens) for itself alone.
 * MK_ERR_NOTFOUND, MK_ERR_PERM, MK_ERR_BUSY, ... with what to do about it. */
enum mk_status mk_parport_open(struct mk_parport *p, const char *device, struct mk_error *err);
/* Back to compatibility mode, released, closed. */
void mk_parport_close(struct mk_parport *p);

/* Ports that are there; at most `max`. Returns how many. A board behind one shows only when it is
 * greeted. */
int mk_parport_find(struct mk_board_found *out, int max);

#endif
