/* The USB link: frames over one pair of bulk endpoints, by libusb's asynchronous transfers, on the
 * caller's thread. Several reads are always under way, so that an answer never waits for the host
 * to ask for it; a write or a wait is given up at its deadline.
 *
 * libusb allocates a few bytes a transfer inside itself; nothing here does after opening.
 */
#ifndef MECHKIT_DRIVER_USB_H
#define MECHKIT_DRIVER_USB_H

#include <libusb.h>

#include "driver/wire.h"

/* A test PID of pid.codes, for boards that have no number of their own yet. */
#define MK_USB_VENDOR 0x1209
#define MK_USB_PRODUCT 0x0001

#define MK_USB_READS 4
#define MK_USB_READ_SIZE 512
#define MK_USB_BUFFER 4096

struct mk_usb;

struct mk_usb_read {
    struct mk_usb *usb;
    struct libusb_transfer *transfer;
    bool under_way;
    uint8_t bytes[MK_USB_READ_SIZE];
};

struct mk_usb {
    libusb_context *context;
    libusb_device_handle *handle;
    uint8_t endpoint_in, endpoint_out;
    bool claimed;
    bool gone; /* unplugged */
    bool halted_in, halted_out;
    bool garbled; /* a read failed since the last look */
    libusb_hotplug_callback_handle watch;
    bool watching;

    struct mk_usb_read read[MK_USB_READS];
    struct libusb_transfer *write;
    int write_done; /* as libusb wants it: 0 while under way */
    uint8_t write_bytes[MK_FRAME_MAX];

    uint8_t buffer[MK_USB_BUFFER]; /* received */
    size_t used, handed; /* bytes in the buffer; of these, given to the caller last time */
    uint32_t overrun;    /* bytes that nobody took in time */
};

extern const struct mk_link_ops mk_usb_link;

/* Finds the board that `device` names (NULL: the first; SERIAL, VID:PID or VID:PID:SERIAL, hex),
 * and claims it. MK_ERR_NOTFOUND, MK_ERR_PERM, MK_ERR_BUSY, ... with what to do about it. */
enum mk_status mk_usb_open(struct mk_usb *u, const char *device, struct mk_error *err);
void mk_usb_close(struct mk_usb *u);

/* Boards on the bus that `device` (may be NULL) names; at most `max`. Returns how many there are,
 * or a negative mk_status. */
int mk_usb_find(const char *device, struct mk_board_found *out, int max, struct mk_error *err);

/* Reports a libusb error: our code, libusb's number, what happened and what to do. */
enum mk_status mk_usb_error(struct mk_error *err, int code, const char *doing);

#endif
