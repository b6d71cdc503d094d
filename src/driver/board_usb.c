/* The USB board: the wire protocol over libusb. What the slots do is in wire.c, how bytes travel in
 * usb_link.c. */
#include "driver/backends.h"
#include "driver/usb.h"

struct usb_board {
    struct mk_wire wire; /* first: the slots of wire.h find it there */
    struct mk_usb usb;
};

static int usb_find(struct mk_board_found *out, int max, struct mk_error *err)
{
    return mk_usb_find(NULL, out, max, err);
}

static enum mk_status usb_open(struct mk_board *board, const struct mk_board_config *config,
                               struct mk_error *err)
{
    struct usb_board *b = board->priv;
    enum mk_status st = mk_usb_open(&b->usb, config->device, err);
    if (st != MK_OK)
        return st;
    st = mk_wire_open(&b->wire, &mk_usb_link, &b->usb, err);
    if (st == MK_OK)
        st = mk_wire_check_model(&b->wire, config->model, err);
    if (st != MK_OK)
        mk_usb_close(&b->usb);
    return st;
}

static void usb_close(struct mk_board *board)
{
    struct usb_board *b = board->priv;
    mk_usb_close(&b->usb);
}

const struct mk_board_ops mk_board_usb_ops = {
    .name = "usb",
    .help = "a board on USB; --device SERIAL, VID:PID or VID:PID:SERIAL",
    .capabilities = MK_BOARD_CAP_WATCHDOG | MK_BOARD_CAP_TIMESTAMP,
    .private_size = sizeof(struct usb_board),
    .find = usb_find,
    .open = usb_open,
    MK_WIRE_BOARD_SLOTS,
    .close = usb_close,
};
