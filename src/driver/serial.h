/* Serial ports: a UART, a USB serial adapter, a USB CDC-ACM board, a pseudo-terminal. Opened raw,
 * for this program alone, and left as they were found. */
#ifndef MECHKIT_DRIVER_SERIAL_H
#define MECHKIT_DRIVER_SERIAL_H

#include <termios.h>

#include "mechkit/board.h"

/* Bits per second where --device says none. A CDC-ACM board has no such thing and ignores it. */
#define MK_SERIAL_BAUD 921600

struct mk_serial {
    int fd; /* -1: closed; not blocking */
    struct termios before;
};

/* PATH or PATH,BAUD; NULL: the port, where there is just one (mk_serial_find). MK_ERR_NOTFOUND,
 * MK_ERR_PERM, MK_ERR_BUSY, MK_ERR_USAGE (not a serial port), ... with what to do about it. */
MK_NODISCARD enum mk_status mk_serial_open(struct mk_serial *s, const char *device,
                                           struct mk_error *err);
void mk_serial_close(struct mk_serial *s);

/* USB serial ports that are there; at most `max`. Returns how many. None is opened: that alone
 * resets some boards. What is behind one shows only when it is greeted. */
int mk_serial_find(struct mk_board_found *out, int max);
/* The same in other folders than /dev and /sys/class/tty. */
int mk_serial_find_in(const char *dev, const char *sys, struct mk_board_found *out, int max);

/* Raw: bytes go through as they are, nothing is echoed or waited for. */
void mk_serial_make_raw(struct termios *t);

#endif
