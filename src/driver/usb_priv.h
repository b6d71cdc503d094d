/* The two halves of the USB link: usb.c finds, opens and closes; usb_link.c transfers. */
#ifndef MECHKIT_DRIVER_USB_PRIV_H
#define MECHKIT_DRIVER_USB_PRIV_H

#include "driver/usb.h"

int64_t mk_usb_now_ns(void); /* CLOCK_MONOTONIC */

/* Where a device is: "bus 1 device 4 port 2.1". `port`, `depth`: hubs on the way, and its own; none
 * where depth is negative. What does not fit is cut off. */
void mk_usb_place(char *out, size_t size, int bus, int address, const uint8_t *port, int depth);

/* Puts every read that is not under way, clearing a halt first. */
void mk_usb_start_reads(struct mk_usb *u);
void LIBUSB_CALL mk_usb_write_done(struct libusb_transfer *t);
void LIBUSB_CALL mk_usb_read_done(struct libusb_transfer *t);
/* Cancels everything and waits for its end. False: the kernel keeps a transfer (and so its memory).
 */
bool mk_usb_stop_transfers(struct mk_usb *u);

#endif
