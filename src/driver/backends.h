/* The rows of the table of back ends, one per board_*.c. */
#ifndef MECHKIT_DRIVER_BACKENDS_H
#define MECHKIT_DRIVER_BACKENDS_H

#include "mechkit/board.h"

extern const struct mk_board_ops mk_board_virtual_ops;
extern const struct mk_board_ops mk_board_usb_ops;
extern const struct mk_board_ops mk_board_parport_ops;
extern const struct mk_board_ops mk_board_tcp_ops;
extern const struct mk_board_ops mk_board_serial_ops;
extern const struct mk_board_ops mk_board_null_ops;

#endif
