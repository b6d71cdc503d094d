/* Transfers: bytes out and in, in bounded time. */
#include <string.h>
#include <time.h>

#include "driver/usb_priv.h"

#define CANCEL_NS 50000000 /* the kernel gives a cancelled transfer back at once */

int64_t mk_usb_now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

/* Lets libusb work until *done, or something has happened, or the deadline. */
static void handle_events(struct mk_usb *u, int *done, int64_t deadline_ns)
{
    int64_t left_ns = deadline_ns - mk_usb_now_ns();
    if (left_ns < 0)
        left_ns = 0;
    struct timeval wait = {left_ns / 1000000000, left_ns % 1000000000 / 1000};
    (void)libusb_handle_events_timeout_completed(u->context, &wait, done);
}

/* --- reading -----------------------------------------------------------------------------------
 */

static void submit_read(struct mk_usb_read *r)
{
    int rc = libusb_submit_transfer(r->transfer);
    r->under_way = rc == LIBUSB_SUCCESS;
    if (rc == LIBUSB_ERROR_NO_DEVICE)
        r->usb->gone = true;
}

static void keep(struct mk_usb *u, const uint8_t *bytes, size_t n)
{
    if (n > sizeof u->buffer - u->used) {
        u->overrun += (uint32_t)n;
        return;
    }
    memcpy(u->buffer + u->used, bytes, n);
    u->used += n;
}

void LIBUSB_CALL mk_usb_read_done(struct libusb_transfer *t)
{
    struct mk_usb_read *r = t->user_data;
    struct mk_usb *u = r->usb;
    r->under_way = false;
    switch (t->status) {
    case LIBUSB_TRANSFER_COMPLETED:
        keep(u, r->bytes, (size_t)t->actual_length);
        submit_read(r);
        break;
    case LIBUSB_TRANSFER_STALL:
        u->halted_in = true;
        u->garbled = true;
        break;
    case LIBUSB_TRANSFER_NO_DEVICE:
        u->gone = true;
        break;
    case LIBUSB_TRANSFER_CANCELLED:
        break;
    default: /* overflow, bus error: what came is of no use; the next look starts the read again */
        u->garbled = true;
        break;
    }
}

void mk_usb_start_reads(struct mk_usb *u)
{
    if (u->halted_in) /* whether the board is gone a read that is started says */
        (void)libusb_clear_halt(u->handle, u->endpoint_in);
    u->halted_in = false;
    for (int i = 0; i < MK_USB_READS && !u->gone; i++)
        if (!u->read[i].under_way)
            submit_read(&u->read[i]);
}

static void discard_handed(struct mk_usb *u)
{
    memmove(u->buffer, u->buffer + u->handed, u->used - u->handed);
    u->used -= u->handed;
    u->handed = 0;
}

static enum mk_status usb_receive(void *link, const uint8_t **bytes, size_t *n, int64_t deadline_ns)
{
    struct mk_usb *u = link;
    discard_handed(u);
    /* Even after the deadline one look: it may be us who were late. */
    for (bool looked = false; u->used == 0; looked = true) {
        if (u->gone)
            return MK_ERR_NODEV;
        if (u->garbled) {
            u->garbled = false;
            mk_usb_start_reads(u);
            return MK_ERR_PROTO;
        }
        if (looked && mk_usb_now_ns() >= deadline_ns)
            return MK_ERR_TIMEOUT;
        handle_events(u, NULL, deadline_ns);
    }
    *bytes = u->buffer;
    *n = u->handed = u->used;
    return MK_OK;
}

/* --- writing -----------------------------------------------------------------------------------
 */

void LIBUSB_CALL mk_usb_write_done(struct libusb_transfer *t)
{
    struct mk_usb *u = t->user_data;
    u->write_done = 1;
}

static void cancel_write(struct mk_usb *u)
{
    int64_t deadline_ns = mk_usb_now_ns() + CANCEL_NS;
    (void)libusb_cancel_transfer(u->write);
    while (!u->write_done && mk_usb_now_ns() < deadline_ns)
        handle_events(u, &u->write_done, deadline_ns);
}

static enum mk_status write_result(struct mk_usb *u, size_t n)
{
    switch (u->write->status) {
    case LIBUSB_TRANSFER_COMPLETED:
        return u->write->actual_length == (int)n ? MK_OK : MK_ERR_PROTO;
    case LIBUSB_TRANSFER_STALL:
        u->halted_out = true;
        return MK_ERR_PROTO;
    case LIBUSB_TRANSFER_NO_DEVICE:
        u->gone = true;
        return MK_ERR_NODEV;
    case LIBUSB_TRANSFER_CANCELLED:
    case LIBUSB_TRANSFER_TIMED_OUT:
        return MK_ERR_TIMEOUT;
    default:
        return MK_ERR_PROTO;
    }
}

/* Before a write: what the last one left behind. */
static enum mk_status make_ready(struct mk_usb *u)
{
    discard_handed(u);
    if (!u->write_done) /* a cancelled write that the kernel did not give back yet */
        cancel_write(u);
    if (u->halted_out) /* whether the board is gone the write says */
        (void)libusb_clear_halt(u->handle, u->endpoint_out);
    u->halted_out = false;
    if (u->garbled) {
        u->garbled = false;
        mk_usb_start_reads(u);
    }
    if (u->gone)
        return MK_ERR_NODEV;
    return u->write_done ? MK_OK : MK_ERR_TIMEOUT;
}

static enum mk_status usb_send(void *link, const uint8_t *bytes, size_t n, int64_t deadline_ns)
{
    struct mk_usb *u = link;
    enum mk_status st = make_ready(u);
    if (st != MK_OK)
        return st;
    memcpy(u->write_bytes, bytes, n);
    u->write->length = (int)n;
    u->write_done = 0;
    int rc = libusb_submit_transfer(u->write);
    if (rc != LIBUSB_SUCCESS) {
        u->write_done = 1;
        u->gone = u->gone || rc == LIBUSB_ERROR_NO_DEVICE;
        return u->gone ? MK_ERR_NODEV : MK_ERR_PROTO;
    }
    while (!u->write_done && mk_usb_now_ns() < deadline_ns)
        handle_events(u, &u->write_done, deadline_ns);
    if (!u->write_done)
        cancel_write(u);
    return u->write_done ? write_result(u, n) : MK_ERR_TIMEOUT;
}

const struct mk_link_ops mk_usb_link = {usb_send, usb_receive};

/* --- ending ------------------------------------------------------------------------------------
 */

static bool reads_under_way(const struct mk_usb *u)
{
    for (int i = 0; i < MK_USB_READS; i++)
        if (u->read[i].under_way)
            return true;
    return false;
}

bool mk_usb_stop_transfers(struct mk_usb *u)
{
    int64_t deadline_ns = mk_usb_now_ns() + 20 * (int64_t)CANCEL_NS;
    if (!u->write_done)
        cancel_write(u);
    for (int i = 0; i < MK_USB_READS; i++)
        if (u->read[i].under_way)
            (void)libusb_cancel_transfer(u->read[i].transfer);
    while (reads_under_way(u) && mk_usb_now_ns() < deadline_ns)
        handle_events(u, NULL, mk_usb_now_ns() + CANCEL_NS);
    return u->write_done && !reads_under_way(u);
}
