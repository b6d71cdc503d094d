/* Boards behind a stream of bytes: TCP and serial ports. What the slots do is in wire.c, how bytes
 * travel in byte_stream.c; the two rows differ in who opens the stream. */
#include <unistd.h>

#include "driver/backends.h"
#include "driver/byte_stream.h"
#include "driver/serial.h"
#include "driver/tcp.h"

/* A board at a serial port may take that long to answer, and a simulation that begins anew. */
#define BOOT_NS INT64_C(3000000000)

struct stream_board {
    struct mk_wire wire; /* first: the slots of wire.h find it there */
    struct mk_byte_stream stream;
    struct mk_serial serial; /* serial ports only */
};

/* Who is at the other end of a descriptor that has just been opened? */
static enum mk_status greet(struct stream_board *b, int fd, const struct mk_board_config *config,
                            struct mk_error *err)
{
    mk_byte_stream_init(&b->stream, fd);
    enum mk_status st = mk_wire_open(&b->wire, &mk_byte_stream_link, &b->stream, err);
    return st == MK_OK ? mk_wire_check_model(&b->wire, config->model, err) : st;
}

/* Opening a serial port resets some boards, and a boot loader has its say first. */
static enum mk_status greet_patiently(struct stream_board *b, int fd,
                                      const struct mk_board_config *config, struct mk_error *err)
{
    struct mk_clock clock;
    enum mk_status st;
    mk_clock_init_monotonic(&clock);
    int64_t end_ns = mk_clock_now_ns(&clock) + BOOT_NS;
    do
        st = greet(b, fd, config, err);
    while (st == MK_ERR_TIMEOUT && mk_clock_now_ns(&clock) < end_ns);
    return st;
}

/* --- TCP ---------------------------------------------------------------------------------------
 */

static enum mk_status tcp_open(struct mk_board *board, const struct mk_board_config *config,
                               struct mk_error *err)
{
    struct stream_board *b = board->priv;
    int fd;
    enum mk_status st = mk_tcp_connect(config->device, &fd, err);
    if (st != MK_OK)
        return st;
    st = greet_patiently(b, fd, config, err);
    if (st == MK_OK)
        return MK_OK;
    if (b->stream.gone)
        st = mk_error_set(err, MK_ERR_BUSY,
                          "%s closed the connection without a word: does another program use the "
                          "board?",
                          config->device);
    close(fd);
    return st;
}

static void tcp_close(struct mk_board *board)
{
    struct stream_board *b = board->priv;
    close(b->stream.fd);
}

const struct mk_board_ops mk_board_tcp_ops = {
    .name = "tcp",
    .help = "a board over TCP, or a rig served by `mechkit serve`; --device HOST:PORT",
    .capabilities = MK_BOARD_CAP_WATCHDOG | MK_BOARD_CAP_TIMESTAMP | MK_BOARD_CAP_ADDRESSED,
    .private_size = sizeof(struct stream_board),
    .open = tcp_open,
    MK_WIRE_BOARD_SLOTS,
    .close = tcp_close,
    .follow = mk_wire_board_follow,
};

/* --- serial ports ------------------------------------------------------------------------------
 */

static int serial_find(struct mk_board_found *out, int max, struct mk_error *err)
{
    (void)err;
    return mk_serial_find(out, max);
}

static enum mk_status serial_open(struct mk_board *board, const struct mk_board_config *config,
                                  struct mk_error *err)
{
    struct stream_board *b = board->priv;
    enum mk_status st = mk_serial_open(&b->serial, config->device, err);
    if (st != MK_OK)
        return st;
    st = greet_patiently(b, b->serial.fd, config, err);
    if (st != MK_OK)
        mk_serial_close(&b->serial);
    return st;
}

static void serial_close(struct mk_board *board)
{
    struct stream_board *b = board->priv;
    mk_serial_close(&b->serial);
}

const struct mk_board_ops mk_board_serial_ops = {
    .name = "serial",
    .help = "a board at a serial port, USB's included; --device /dev/ttyACM0 or PATH,BAUD",
    .capabilities = MK_BOARD_CAP_WATCHDOG | MK_BOARD_CAP_TIMESTAMP,
    .private_size = sizeof(struct stream_board),
    .find = serial_find,
    .open = serial_open,
    MK_WIRE_BOARD_SLOTS,
    .close = serial_close,
    .follow = mk_wire_board_follow,
};
