/* A board on an emulated USB port: what usbfs, sysfs and udev show of it, with a plan of faults.
 * The board behind it is the emulated one (driver/emulated.h) or anything else that takes bytes. */
#ifndef MECHKIT_TESTS_EMU_USB_H
#define MECHKIT_TESTS_EMU_USB_H

#include <linux/usbdevice_fs.h>
#include <pthread.h>
#include <stdint.h>

#include "driver/emulated.h"
#include "emu/node.h"

#define EMU_USB_VENDOR 0x1209
#define EMU_USB_PRODUCT 0x0001

/* What can go wrong with request number n, or with the answer to it. */
#define EMU_FAULTS(X)                                                                              \
    X(LOSE_REQUEST, "request lost")                                                                \
    X(LOSE_ANSWER, "answer lost")                                                                  \
    X(SHORT_REQUEST, "request cut short")                                                          \
    X(SHORT_ANSWER, "answer cut short")                                                            \
    X(STALL_OUT, "stall out")                                                                      \
    X(STALL_IN, "stall in")                                                                        \
    X(BLOCK_OUT, "endpoint does not take the request")                                             \
    X(LATE_ANSWER, "answer comes after the next request")                                          \
    X(OVERFLOW, "overflow")                                                                        \
    X(GARBAGE, "garbage before the answer")                                                        \
    X(FLIP_REQUEST, "a bit of the request flips")                                                  \
    X(FLIP_ANSWER, "a bit of the answer flips")                                                    \
    X(ERROR_OUT, "bus error out")                                                                  \
    X(ERROR_IN, "bus error in")                                                                    \
    X(TWICE_REQUEST, "request twice")                                                              \
    X(TWICE_ANSWER, "answer twice")                                                                \
    X(REORDER, "request overtaken by the next")                                                    \
    X(UNPLUG, "unplugged")

enum emu_fault {
    EMU_FAULT_NONE,
#define EMU_FAULT_ENUM(name, text) EMU_FAULT_##name,
    EMU_FAULTS(EMU_FAULT_ENUM)
#undef EMU_FAULT_ENUM
        EMU_FAULT_COUNT
};
const char *emu_fault_text(enum emu_fault fault);

/* Where the bytes go. */
struct emu_board {
    void *ctx;
    void (*receive)(void *ctx, const uint8_t *bytes, size_t n);
    size_t (*take)(void *ctx, uint8_t *bytes, size_t size);
};
struct emu_board emu_board_of(struct mk_emulated *board);

#define EMU_CHUNKS 16
#define EMU_CHUNK_SIZE (2 * MK_FRAME_MAX)
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
    struct emu_board board;
    struct mk_emulated *timed; /* for streaming: whose time passes while a caller polls; or NULL */
    char serial[24];
    bool denied, taken; /* no permission; claimed by another program */
    bool driver_bound;  /* a kernel driver sits on the interface */

    /* The plan: `count` requests from number `first` on (requests are counted from arming). */
    enum emu_fault fault;
    unsigned first, count, requests;
    unsigned injected;

    pthread_mutex_t lock;
    struct emu_plug plug[EMU_PLUGS];
    struct emu_plug *now; /* NULL: unplugged */
    int address;
    char name[16], text[EMU_USB_FILES][16], file_path[EMU_USB_FILES][80];
    struct emu_file file[EMU_USB_FILES];
    struct emu_chunk {
        uint8_t bytes[EMU_CHUNK_SIZE];
        size_t size;
        enum emu_fault fault;
    } chunk[EMU_CHUNKS]; /* from the board, oldest first */
    int chunks;
    uint8_t kept[EMU_CHUNK_SIZE]; /* the request that the next one overtakes */
    size_t kept_size;
};

void emu_usb_init(struct emu_usb *u, int port, const char *serial, struct emu_board board);
void emu_usb_free(struct emu_usb *u);
void emu_usb_plug(struct emu_usb *u);
void emu_usb_unplug(struct emu_usb *u);
void emu_usb_arm(struct emu_usb *u, enum emu_fault fault, unsigned first, unsigned count);

#endif
