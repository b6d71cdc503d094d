#include "emu/pp.h"

#include <errno.h>
#include <linux/parport.h>
#include <linux/ppdev.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <time.h>

#include "driver/wire.h"

#define BLOCK_NS (MK_WIRE_EXCHANGE_NS + 100000) /* a little longer than an exchange waits */

static int64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

/* --- the port ----------------------------------------------------------------------------------
 */

static int negotiate(struct emu_pp *p, int mode)
{
    unsigned bit = mode == IEEE1284_MODE_EPP      ? EMU_PP_EPP
                   : mode == IEEE1284_MODE_BYTE   ? EMU_PP_BYTE
                   : mode == IEEE1284_MODE_NIBBLE ? EMU_PP_NIBBLE
                                                  : 0;
    if (p->unplugged && mode != IEEE1284_MODE_COMPAT)
        return -EIO; /* nobody answers the negotiation */
    if (mode != IEEE1284_MODE_COMPAT && !(p->board_modes & bit))
        return -ENXIO;
    p->mode = mode;
    return 0;
}

/* A board that streams: its time passes while somebody looks; simulated time as soon as the last
 * sample has been answered. */
static void let_time_pass(struct emu_pp *p)
{
    struct mk_emulated *e = p->timed;
    if (!e || !e->device.stream_us || p->line.chunks > 0)
        return;
    if (e->clock->ops->simulated && e->device.stream_answered == e->device.stream_sample)
        mk_clock_sleep_until(e->clock, e->opened_ns + (int64_t)e->device.stream_next_ns);
    (void)mk_emulated_run(e);
    emu_line_collect(&p->line, EMU_FAULT_NONE);
}

static int claim(struct emu_pp *p)
{
    if (p->claimed)
        return -EINVAL;
    if (p->taken)
        return -ENXIO;
    p->claimed = p->registered = true;
    return 0;
}

static int pp_ioctl(void *ctx, unsigned long request, void *arg)
{
    struct emu_pp *p = ctx;
    switch (request) { /* what works unclaimed */
    case PPCLAIM:
        return claim(p);
    case PPEXCL:
        if (p->registered && !p->excl)
            return -EINVAL; /* too late */
        p->excl = true;
        return 0;
    case PPGETMODES:
        *(unsigned *)arg = p->port_modes;
        return 0;
    case PPSETMODE:
        p->mode = *(int *)arg;
        return 0;
    default:
        break;
    }
    if (!p->claimed)
        return -EINVAL;
    switch (request) {
    case PPRELEASE:
        p->claimed = false;
        p->released_in = p->mode;
        return 0;
    case PPNEGOT:
        return negotiate(p, *(int *)arg);
    case PPSETTIME:
        p->patience_us =
            1000000 * (int64_t)((struct timeval *)arg)->tv_sec + ((struct timeval *)arg)->tv_usec;
        return 0;
    case PPRSTATUS:
        let_time_pass(p);
        *(unsigned char *)arg = emu_line_next(&p->line) ? 0 : PARPORT_STATUS_ERROR;
        return 0;
    default:
        return -EINVAL; /* as ppdev says to what it does not know */
    }
}

static ssize_t pp_write(void *ctx, const void *bytes, size_t n)
{
    struct emu_pp *p = ctx;
    if (!p->claimed)
        return -EINVAL;
    if (n > MK_FRAME_MAX || p->unplugged)
        return p->mode == IEEE1284_MODE_EPP ? -EIO : -EAGAIN;
    if (p->mode != IEEE1284_MODE_EPP && p->mode != IEEE1284_MODE_COMPAT)
        return -EIO;
    if (now_ns() < p->blocked_until_ns)
        return -EAGAIN;
    enum emu_fault fault = emu_line_fault(&p->line);
    switch (fault) {
    case EMU_FAULT_UNPLUG:
        p->unplugged = true;
        p->line.chunks = 0;
        return -EIO;
    case EMU_FAULT_BLOCK_OUT:
        p->blocked_until_ns = now_ns() + BLOCK_NS;
        return -EAGAIN;
    case EMU_FAULT_STALL_OUT:
    case EMU_FAULT_ERROR_OUT:
        return -EIO;
    default:
        emu_line_send(&p->line, bytes, n, fault);
        return (ssize_t)n;
    }
}

static ssize_t pp_read(void *ctx, void *bytes, size_t n)
{
    struct emu_pp *p = ctx;
    if (!p->claimed)
        return -EINVAL;
    if (p->mode == IEEE1284_MODE_COMPAT)
        return -EIO; /* nothing comes in that way */
    let_time_pass(p);
    struct emu_chunk *c = emu_line_next(&p->line);
    if (!c)
        return -EAGAIN;
    bool broken = c->fault == EMU_FAULT_STALL_IN || c->fault == EMU_FAULT_OVERFLOW ||
                  c->fault == EMU_FAULT_ERROR_IN;
    size_t k = c->size < n ? c->size : n;
    memcpy(bytes, c->bytes, k);
    memmove(c->bytes, c->bytes + k, c->size - k);
    c->size -= k;
    if (broken || c->size == 0)
        emu_line_drop(&p->line);
    return broken ? -EIO : (ssize_t)k;
}

static int pp_open(void *ctx)
{
    struct emu_pp *p = ctx;
    return p->denied ? -EACCES : 0;
}

static void pp_close(void *ctx)
{
    struct emu_pp *p = ctx;
    p->claimed = p->registered = p->excl = false;
    p->mode = IEEE1284_MODE_COMPAT;
}

static const struct emu_node_ops ops = {
    .open = pp_open, .ioctl = pp_ioctl, .read = pp_read, .write = pp_write, .close = pp_close};

void emu_pp_init(struct emu_pp *p, int number, unsigned board_modes, struct emu_board board)
{
    memset(p, 0, sizeof *p);
    p->line.board = board;
    p->board_modes = board_modes;
    p->port_modes = PARPORT_MODE_PCSPP | PARPORT_MODE_TRISTATE | PARPORT_MODE_EPP;
    p->mode = IEEE1284_MODE_COMPAT;
    p->patience_us = 5000000; /* as in the kernel, until it is told otherwise */
    p->released_in = -1;
    snprintf(p->path, sizeof p->path, "/dev/parport%d", number);
    p->node = (struct emu_node){.path = p->path, .ops = &ops, .ctx = p};
    emu_node_add(&p->node);
}

void emu_pp_free(struct emu_pp *p)
{
    emu_node_remove(&p->node);
}
