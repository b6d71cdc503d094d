#include "emu/stream.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "driver/serial.h"
#include "driver/tcp.h"
#include "driver/wire.h"
#include "emu/node.h"
#include "suites.h"
#include "support/files.h"

#define BLOCK_NS (MK_WIRE_EXCHANGE_NS + 100000) /* a little longer than an exchange waits */

static int64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

/* --- plugging: the lock is held ----------------------------------------------------------------
 */

static void hang_up(struct emu_stream *s)
{
    if (s->fd >= 0)
        close(s->fd);
    s->fd = -1;
    s->line.chunks = 0;
    s->heard_size = 0;
    s->blocked = false;
}

static void open_port(struct emu_stream *s)
{
    struct mk_error err = MK_ERROR_INIT;
    char bound[80];
    const char *where = s->device[0] ? s->device : "127.0.0.1:0";
    enum mk_status st = mk_tcp_listen(where, &s->listening, bound, sizeof bound, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    snprintf(s->device, sizeof s->device, "%s", bound);
}

/* Raw from the beginning: nothing is echoed before a host has opened it. */
static void open_terminal(struct emu_stream *s)
{
    struct termios t;
    s->fd = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    ck_assert_int_ge(s->fd, 0);
    ck_assert_int_eq(grantpt(s->fd) | unlockpt(s->fd) | tcgetattr(s->fd, &t), 0);
    mk_serial_make_raw(&t);
    ck_assert_int_eq(tcsetattr(s->fd, TCSANOW, &t), 0);
    snprintf(s->device, sizeof s->device, "%s", scratch("ttyEMU0"));
    unlink(s->device);
    ck_assert_int_eq(symlink(ptsname(s->fd), s->device), 0);
}

/* --- answers -------------------------------------------------------------------------------------
 */

/* What a line makes of a chunk that a bus would have failed to carry. */
static void spoil(struct emu_chunk *c)
{
    switch (c->fault) {
    case EMU_FAULT_STALL_IN: /* nothing comes */
        c->size = 0;
        break;
    case EMU_FAULT_OVERFLOW: /* something else, and too much of it */
        for (size_t i = 0; i < sizeof c->bytes; i++)
            c->bytes[i] = (uint8_t)(91 * i + 5);
        c->size = sizeof c->bytes;
        break;
    case EMU_FAULT_ERROR_IN: /* every other byte is missing */
        for (size_t i = 0; 2 * i < c->size; i++)
            c->bytes[i] = c->bytes[2 * i];
        c->size /= 2;
        break;
    default:
        break;
    }
    c->fault = EMU_FAULT_NONE;
}

/* Whether the host has something to read now. */
static bool say(struct emu_stream *s)
{
    bool said = false;
    size_t room = s->cut > 0 ? s->cut : sizeof s->heard;
    struct emu_chunk *c;
    while (s->fd >= 0 && room > 0 && (c = emu_line_next(&s->line)) != NULL) {
        spoil(c);
        size_t n = c->size < room ? c->size : room;
        ssize_t k = n > 0 ? write(s->fd, c->bytes, n) : 0;
        if (k < 0)
            return said;
        said = said || k > 0;
        memmove(c->bytes, c->bytes + k, c->size - (size_t)k);
        c->size -= (size_t)k;
        room -= (size_t)k;
        if (c->size == 0)
            emu_line_drop(&s->line);
        else if (s->cut == 0)
            return said; /* the kernel takes no more for now */
    }
    return said;
}

/* --- requests ------------------------------------------------------------------------------------
 */

static void hear(struct emu_stream *s)
{
    size_t room = sizeof s->heard - s->heard_size;
    ssize_t k = room > 0 ? read(s->fd, s->heard + s->heard_size, room) : -1;
    if (k > 0)
        s->heard_size += (size_t)k;
    /* A pseudo-terminal says EIO until somebody has opened its other end. */
    if (s->kind == EMU_TCP && (k == 0 || (k < 0 && room > 0 && errno != EAGAIN)))
        hang_up(s);
}

/* Size of the first frame heard; 0: it is not whole yet. */
static size_t first_frame(const struct emu_stream *s)
{
    if (s->heard_size < MK_FRAME_HEADER)
        return 0;
    size_t n = MK_FRAME_HEADER + mk_get16(s->heard + 8) + MK_FRAME_TRAILER;
    ck_assert_uint_le(n, MK_FRAME_MAX); /* the host is in order */
    return s->heard_size >= n ? n : 0;
}

/* Acts out the plan for a request of n bytes. False: nobody takes it for now. */
static bool take(struct emu_stream *s, size_t n)
{
    bool again = s->blocked;
    enum emu_fault fault = EMU_FAULT_NONE;
    if (again && now_ns() < s->blocked_until_ns)
        return false;
    s->blocked = false;
    if (!again)
        fault = emu_line_fault(&s->line);
    switch (fault) {
    case EMU_FAULT_UNPLUG:
        s->plugged = false;
        if (s->listening >= 0)
            close(s->listening);
        s->listening = -1;
        if (s->kind == EMU_PTY)
            unlink(s->device);
        hang_up(s);
        return false;
    case EMU_FAULT_BLOCK_OUT:
        s->blocked = true;
        s->blocked_until_ns = now_ns() + BLOCK_NS;
        return false;
    case EMU_FAULT_STALL_OUT:
    case EMU_FAULT_ERROR_OUT: /* swallowed */
        break;
    default:
        emu_line_send(&s->line, s->heard, n, fault);
        break;
    }
    memmove(s->heard, s->heard + n, s->heard_size - n);
    s->heard_size -= n;
    return true;
}

/* --- the pump ------------------------------------------------------------------------------------
 */

/* A board that streams: its time passes while somebody waits; simulated time as soon as the last
 * sample has been answered. Returns for how many ms to wait at most, -1: for ever. */
static int let_time_pass(struct emu_stream *s)
{
    struct mk_emulated *e = s->timed;
    if (!e || !e->device.stream_us || s->line.chunks > 0)
        return -1;
    int64_t next = e->opened_ns + (int64_t)e->device.stream_next_ns;
    if (e->clock->ops->simulated && e->device.stream_answered == e->device.stream_sample)
        mk_clock_sleep_until(e->clock, next);
    (void)mk_emulated_run(e);
    emu_line_collect(&s->line, EMU_FAULT_NONE);
    int64_t left_ns = e->opened_ns + (int64_t)e->device.stream_next_ns - mk_clock_now_ns(e->clock);
    return left_ns < 1000000 ? 1 : (int)(left_ns / 1000000);
}

static struct emu_wish pump(void *ctx)
{
    struct emu_stream *s = ctx;
    struct emu_wish wish = {.fd = -1, .limit_ms = -1};
    char peer[80];
    size_t n;
    pthread_mutex_lock(&s->lock);
    if (s->plugged && s->kind == EMU_TCP) {
        int fd = mk_tcp_accept(s->listening, peer, sizeof peer);
        if (fd >= 0) { /* one that comes is one that the last has made way for */
            hang_up(s);
            s->fd = fd;
        }
    }
    if (s->plugged && s->fd >= 0)
        hear(s);
    while (s->fd >= 0 && (n = first_frame(s)) > 0 && take(s, n))
        continue;
    if (s->fd >= 0) {
        wish.limit_ms = let_time_pass(s);
        wish.said = say(s);
        wish.fd = s->fd;
    }
    /* What is withheld comes in its time though nobody asks. */
    if (s->blocked && (wish.limit_ms < 0 || wish.limit_ms > 1))
        wish.limit_ms = 1;
    pthread_mutex_unlock(&s->lock);
    return wish;
}

/* --- its life ------------------------------------------------------------------------------------
 */

void emu_stream_init(struct emu_stream *s, enum emu_stream_kind kind, struct emu_board board)
{
    memset(s, 0, sizeof *s);
    pthread_mutex_init(&s->lock, NULL);
    s->kind = kind;
    s->line.board = board;
    s->fd = s->listening = -1;
    emu_stream_plug(s);
    emu_pump(pump, s);
}

void emu_stream_plug(struct emu_stream *s)
{
    pthread_mutex_lock(&s->lock);
    if (!s->plugged && s->kind == EMU_TCP)
        open_port(s);
    else if (!s->plugged)
        open_terminal(s);
    s->plugged = true;
    pthread_mutex_unlock(&s->lock);
}

void emu_stream_unplug(struct emu_stream *s)
{
    pthread_mutex_lock(&s->lock);
    hang_up(s);
    if (s->listening >= 0)
        close(s->listening);
    s->listening = -1;
    if (s->plugged && s->kind == EMU_PTY)
        unlink(s->device);
    s->plugged = false;
    pthread_mutex_unlock(&s->lock);
}

void emu_stream_free(struct emu_stream *s)
{
    emu_pump(NULL, NULL);
    emu_stream_unplug(s);
    pthread_mutex_destroy(&s->lock);
}
