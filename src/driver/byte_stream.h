/* A link over any stream of bytes that the system has a descriptor of: a TCP connection, a serial
 * port, a pseudo-terminal. Who opens it (tcp.h, serial.h) is of no concern here; what the bytes
 * mean is wire.h's.
 *
 * The descriptor does not block: both directions wait by ppoll, until their deadline. A stream
 * loses nothing by itself and keeps the order, but it may cut, and it may deliver late: what was
 * written before a deadline passed still arrives.
 */
#ifndef MECHKIT_DRIVER_BYTE_STREAM_H
#define MECHKIT_DRIVER_BYTE_STREAM_H

#include "driver/wire.h"

struct mk_byte_stream {
    int fd;      /* not blocking */
    bool socket; /* else a terminal */
    bool gone;   /* the other end has closed it, or the device was unplugged */
    uint8_t buffer[2 * MK_FRAME_MAX];
};

extern const struct mk_link_ops mk_byte_stream_link;

/* Owns nothing: whoever opened the descriptor closes it. */
void mk_byte_stream_init(struct mk_byte_stream *s, int fd);

#endif
