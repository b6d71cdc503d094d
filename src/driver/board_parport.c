/* The board at a parallel port: the wire protocol over ppdev. What the slots do is in wire.c, how
 * bytes travel in parport.c. */
#include "driver/backends.h"
#include "driver/parport.h"

struct parport_board {
    struct mk_wire wire; /* first: the slots of wire.h find it there */
    struct mk_parport port;
};

static int parport_find(struct mk_board_found *out, int max, struct mk_error *err)
{
    (void)err;
    return mk_parport_find(out, max);
}

static enum mk_status parport_open(struct mk_board *board, const struct mk_board_config *config,
                                   struct mk_error *err)
{
    struct parport_board *b = board->priv;
    enum mk_status st = mk_parport_open(&b->port, config->device, err);
    if (st != MK_OK)
        return st;
    st = mk_wire_open(&b->wire, &mk_parport_link, &b->port, err);
    if (st == MK_OK)
        st = mk_wire_check_model(&b->wire, config->model, err);
    if (st != MK_OK)
        mk_parport_close(&b->port);
    return st;
}

static void parport_close(struct mk_board *board)
{
    struct parport_board *b = board->priv;
    mk_parport_close(&b->port);
}

const struct mk_board_ops mk_board_parport_ops = {
    .name = "parport",
    .help = "a board at a parallel port; --device /dev/parportN",
    .capabilities = MK_BOARD_CAP_WATCHDOG | MK_BOARD_CAP_TIMESTAMP,
    .private_size = sizeof(struct parport_board),
    .find = parport_find,
    .open = parport_open,
    MK_WIRE_BOARD_SLOTS,
    .close = parport_close,
};
