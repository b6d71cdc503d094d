/* A board on an emulated USB port: what usbfs, sysfs and udev show of it, with a plan of faults.
 * The board behind it is the emulated one (driver/emulated.h) or anything else that takes bytes.
 * In a virtual machine (make check-vm) vm/vhci.c has the same functions, over the real kernel. */
#ifndef MECHKIT_TESTS_EMU_USB_H
#define MECHKIT_TESTS_EMU_USB_H

#include <linux/usbdevice_fs.h>
#include <pthread.h>
#include <stdint.h>

#include "emu/line.h"
#include "emu/node.h"

#define EMU_USB_VENDOR 0x1209
#define EMU_USB_PRODUCT 0x0001
#define EMU_USB_OUT 0x01
#define EMU_USB_IN 0x81

#define EMU_URBS 16
#define EMU_USB_FILES 5

#define EMU_PLUGS 8 /* times that a board can be plugged in; the last ones are remembered */

struct emu_urbs {
    struct usbdevfs_urb *urb[EMU_URBS];
    int count;
};

/* From plugging in to the closing of the last descriptor: a program may still hold the node of a
 * board that has been unplugged, and plugged in again, since. */
struct emu_plug {
    struct emu_usb *usb;
    struct emu_node node;
    char path[64];
    bool live;
    bool halted_out, halted_in;
    struct emu_urbs waiting, done; /* IN transfers; completed ones of both directions */
    struct emu_urbs blocked;       /* OUT transfers that the endpoint does not take */
};

struct emu_usb {
    struct emu_line line;
    struct mk_emulated *timed; /* for streaming: whose time passes while a caller polls; or NULL */
    char serial[24];
    bool denied, taken; /* no permission; claimed by another program */
    bool driver_bound;  /* a kernel driver sits on the interface */
    bool driver_aside;  /* it did, and comes back when the interface is released */
    bool keeps_blocked; /* what is cancelled and blocked is not given back yet */
    int taken_fd;       /* in a virtual machine: that other program's */

    pthread_mutex_t lock;
    struct emu_plug plug[EMU_PLUGS];
    struct emu_plug *now; /* NULL: unplugged */
    int address;
    char name[16], text[EMU_USB_FILES][16], file_path[EMU_USB_FILES][80];
    uint8_t descriptors[64];
    struct emu_file file[EMU_USB_FILES];
};

void emu_usb_init(struct emu_usb *u, int port, const char *serial, struct emu_board board);
void emu_usb_free(struct emu_usb *u);
void emu_usb_plug(struct emu_usb *u);
void emu_usb_unplug(struct emu_usb *u);

/* No permission for the node; another program has claimed the interface; a kernel driver has. */
void emu_usb_deny(struct emu_usb *u, bool denied);
void emu_usb_take(struct emu_usb *u, bool taken);
void emu_usb_bind_driver(struct emu_usb *u, bool bound);
/* The kernel has no configuration in force: the device is there and none of its endpoints is. */
void emu_usb_configure(struct emu_usb *u, bool configured);

/* What is blocked comes back as cancelled, and what is cancelled from now on at once. */
void emu_usb_give_back(struct emu_usb *u);

/* A descriptor as a request asks for it: its type (1 device, 2 configuration, 3 string; ALL: the
 * first two, as sysfs shows them) and index. Returns its size, or a negative errno. */
#define EMU_USB_ALL 0
int emu_usb_descriptor(const struct emu_usb *u, int type, int index, uint8_t *out, size_t size);

#endif
