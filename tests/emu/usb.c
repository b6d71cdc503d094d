#include "emu/usb.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>

#include "emu/udev.h"

/* --- transfers; the lock is held
 * --------------------------------------------------------------------- */

static void finish(struct emu_plug *p, struct usbdevfs_urb *urb, int status, size_t length)
{
    urb->status = status;
    urb->actual_length = (int)length;
    if (p->done.count < EMU_URBS)
        p->done.urb[p->done.count++] = urb;
    emu_node_ready(&p->node, true);
}

static struct usbdevfs_urb *take_urb(struct emu_urbs *list, int index)
{
    struct usbdevfs_urb *urb = list->urb[index];
    list->count--;
    memmove(list->urb + index, list->urb + index + 1,
            (size_t)(list->count - index) * sizeof list->urb[0]);
    return urb;
}

/* Answers a transfer that waits for bytes with the oldest chunk. */
static void complete_in(struct emu_usb *u, const struct emu_chunk *c)
{
    struct emu_plug *p = u->now;
    struct usbdevfs_urb *urb = take_urb(&p->waiting, 0);
    int status = 0;
    size_t n = c->size;
    if (c->fault == EMU_FAULT_STALL_IN) {
        p->halted_in = true;
        status = -EPIPE;
    } else if (c->fault == EMU_FAULT_OVERFLOW || n > (size_t)urb->buffer_length) {
        status = -EOVERFLOW;
    } else if (c->fault == EMU_FAULT_ERROR_IN) {
        status = -EPROTO;
    }
    if (status != 0)
        n = 0;
    memcpy(urb->buffer, c->bytes, n);
    finish(p, urb, status, n);
    emu_line_drop(&u->line);
}

static void pump(struct emu_usb *u)
{
    struct emu_plug *p = u->now;
    const struct emu_chunk *c;
    while (p->waiting.count > 0 && p->halted_in)
        finish(p, take_urb(&p->waiting, 0), -EPIPE, 0);
    while (p->waiting.count > 0 && !p->halted_in && (c = emu_line_next(&u->line)) != NULL)
        complete_in(u, c);
}

static void unplug(struct emu_usb *u)
{
    struct emu_plug *p = u->now;
    while (p->waiting.count > 0)
        finish(p, take_urb(&p->waiting, 0), -ESHUTDOWN, 0);
    while (p->blocked.count > 0)
        finish(p, take_urb(&p->blocked, 0), -ESHUTDOWN, 0);
    p->live = false;
    u->now = NULL;
    u->line.chunks = 0;
    emu_node_hang_up(&p->node);
    emu_node_remove(&p->node);
    for (int i = 0; i < EMU_USB_FILES; i++)
        emu_file_remove(&u->file[i]);
    emu_udev_unplug(u->name);
}

static int submit_out(struct emu_usb *u, struct usbdevfs_urb *urb)
{
    struct emu_plug *p = u->now;
    size_t n = (size_t)urb->buffer_length;
    if (n > MK_FRAME_MAX)
        return -EINVAL;
    if (p->halted_out) {
        finish(p, urb, -EPIPE, 0);
        return 0;
    }
    enum emu_fault fault = emu_line_fault(&u->line);
    switch (fault) {
    case EMU_FAULT_UNPLUG:
        unplug(u);
        return -ENODEV;
    case EMU_FAULT_BLOCK_OUT:
        if (p->blocked.count < EMU_URBS) /* until it is discarded */
            p->blocked.urb[p->blocked.count++] = urb;
        return 0;
    case EMU_FAULT_STALL_OUT:
        p->halted_out = true;
        finish(p, urb, -EPIPE, 0);
        return 0;
    case EMU_FAULT_ERROR_OUT:
        finish(p, urb, -EPROTO, 0);
        return 0;
    default:
        emu_line_send(&u->line, urb->buffer, n, fault);
        break;
    }
    finish(p, urb, 0, fault == EMU_FAULT_SHORT_REQUEST ? n / 2 : n);
    pump(u);
    return 0;
}

static int submit_control(struct emu_usb *u, struct usbdevfs_urb *urb)
{
    const uint8_t *setup = urb->buffer;
    uint8_t answer[128];
    int wanted = setup[6] | setup[7] << 8, n = -EPIPE;
    if (setup[0] == 0x80 && setup[1] == 6)
        n = emu_usb_descriptor(u, setup[3], setup[2], answer, sizeof answer);
    if (n > wanted)
        n = wanted;
    if (n > 0)
        memcpy((uint8_t *)urb->buffer + 8, answer, (size_t)n);
    finish(u->now, urb, n < 0 ? n : 0, n < 0 ? 0 : (size_t)n);
    return 0;
}

static int submit(struct emu_usb *u, struct usbdevfs_urb *urb)
{
    if (urb->type == USBDEVFS_URB_TYPE_CONTROL)
        return submit_control(u, urb);
    if (urb->endpoint == EMU_USB_OUT)
        return submit_out(u, urb);
    struct emu_urbs *waiting = &u->now->waiting;
    if (urb->endpoint != EMU_USB_IN || waiting->count == EMU_URBS)
        return -ENOENT;
    waiting->urb[waiting->count++] = urb;
    pump(u);
    return 0;
}

static int discard(struct emu_plug *p, const void *urb)
{
    struct emu_urbs *const lists[] = {&p->waiting, &p->blocked};
    for (int k = 0; k < 2; k++)
        for (int i = 0; i < lists[k]->count; i++)
            if (lists[k]->urb[i] == urb) {
                if (k == 0 || !p->usb->keeps_blocked)
                    finish(p, take_urb(lists[k], i), -ENOENT, 0);
                return 0;
            }
    return -EINVAL;
}

static int reap(struct emu_plug *p, void **out)
{
    if (p->done.count == 0)
        return p->live ? -EAGAIN : -ENODEV;
    *out = take_urb(&p->done, 0);
    if (p->done.count == 0 && p->live)
        emu_node_ready(&p->node, false);
    return 0;
}

static int claim(struct emu_usb *u, unsigned interface)
{
    if (interface != 0)
        return -ENOENT;
    return u->taken || u->driver_bound ? -EBUSY : 0;
}

/* --- the node
 * ---------------------------------------------------------------------------------------- */

static int control(struct emu_plug *p, unsigned long request, void *arg)
{
    struct emu_usb *u = p->usb;
    switch (request) {
    case USBDEVFS_REAPURBNDELAY:
        return reap(p, arg);
    case USBDEVFS_DISCARDURB:
        return discard(p, arg);
    default:
        break;
    }
    if (!p->live)
        return -ENODEV;
    switch (request) {
    case USBDEVFS_GET_CAPABILITIES:
        *(uint32_t *)arg = USBDEVFS_CAP_ZERO_PACKET | USBDEVFS_CAP_BULK_CONTINUATION |
                           USBDEVFS_CAP_NO_PACKET_SIZE_LIM | USBDEVFS_CAP_BULK_SCATTER_GATHER |
                           USBDEVFS_CAP_REAP_AFTER_DISCONNECT;
        return 0;
    case USBDEVFS_CLAIMINTERFACE:
        return claim(u, *(unsigned *)arg);
    case USBDEVFS_DISCONNECT_CLAIM:
        u->driver_aside = u->driver_aside || u->driver_bound;
        u->driver_bound = false;
        return claim(u, ((struct usbdevfs_disconnect_claim *)arg)->interface);
    case USBDEVFS_RELEASEINTERFACE:
    case USBDEVFS_SETCONFIGURATION:
    case USBDEVFS_SETINTERFACE:
    case USBDEVFS_RESET:
        return 0;
    case USBDEVFS_GETDRIVER:
        return u->driver_bound ? 0 : -ENODATA;
    case USBDEVFS_IOCTL: /* reattaching the kernel driver when released */
        u->driver_bound = u->driver_aside;
        u->driver_aside = false;
        return u->driver_bound ? 1 : -ENODATA;
    case USBDEVFS_CLEAR_HALT:
        if (*(unsigned *)arg & 0x80)
            p->halted_in = false;
        else
            p->halted_out = false;
        return 0;
    case USBDEVFS_SUBMITURB:
        return submit(u, arg);
    default:
        return -ENOTTY;
    }
}

static int node_ioctl(void *ctx, unsigned long request, void *arg)
{
    struct emu_plug *p = ctx;
    pthread_mutex_lock(&p->usb->lock);
    int result = control(p, request, arg);
    pthread_mutex_unlock(&p->usb->lock);
    return result;
}

static int node_open(void *ctx)
{
    struct emu_plug *p = ctx;
    return p->usb->denied ? -EACCES : 0;
}

static void node_close(void *ctx)
{
    struct emu_plug *p = ctx;
    p->waiting.count = p->done.count = 0;
    p->halted_in = p->halted_out = false;
}

static const struct emu_node_ops node_ops = {
    .open = node_open, .ioctl = node_ioctl, .close = node_close};

/* --- streaming: emulated time passes while somebody polls
 * -------------------------------------------- */

static int let_time_pass(void *ctx, int timeout_ms)
{
    struct emu_usb *u = ctx;
    struct mk_emulated *e = u->timed;
    int wait_ms = -1;
    (void)timeout_ms;
    pthread_mutex_lock(&u->lock);
    if (u->now && e->device.stream_us) {
        const struct emu_urbs *done = &u->now->done;
        int64_t next = e->opened_ns + (int64_t)e->device.stream_next_ns;
        bool answered = e->device.stream_answered == e->device.stream_sample;
        if (e->clock->ops->simulated && done->count == 0 && answered)
            mk_clock_sleep_until(e->clock, next);
        (void)mk_emulated_run(e);
        emu_line_collect(&u->line, EMU_FAULT_NONE);
        pump(u);
        int64_t left_ns = next - mk_clock_now_ns(e->clock);
        wait_ms = done->count > 0 || left_ns < 1000000 ? 0 : (int)(left_ns / 1000000);
        if (wait_ms == 0 && done->count == 0)
            wait_ms = 1;
    }
    pthread_mutex_unlock(&u->lock);
    return wait_ms;
}

/* --- plugging
 * ---------------------------------------------------------------------------------------- */

void emu_usb_init(struct emu_usb *u, int port, const char *serial, struct emu_board board)
{
    memset(u, 0, sizeof *u);
    pthread_mutex_init(&u->lock, NULL);
    u->line.board = board;
    u->address = 10 * port;
    snprintf(u->serial, sizeof u->serial, "%s", serial);
    snprintf(u->name, sizeof u->name, "1-%d", port);
}

static void add_file(struct emu_usb *u, int i, const char *attribute, const void *bytes, size_t n)
{
    snprintf(u->file_path[i], sizeof u->file_path[i], "/sys/bus/usb/devices/%s/%s", u->name,
             attribute);
    u->file[i] = (struct emu_file){u->file_path[i], bytes, n};
    emu_file_add(&u->file[i]);
}

static void add_number(struct emu_usb *u, int i, const char *attribute, int value)
{
    int n = snprintf(u->text[i], sizeof u->text[i], "%d\n", value);
    add_file(u, i, attribute, u->text[i], (size_t)n);
}

/* Each time at another address, as a hub would. */
void emu_usb_plug(struct emu_usb *u)
{
    struct emu_plug *p = &u->plug[u->address++ % EMU_PLUGS];
    *p = (struct emu_plug){.usb = u, .live = true};
    snprintf(p->path, sizeof p->path, "/dev/bus/usb/001/%03d", u->address);
    p->node = (struct emu_node){.path = p->path, .ops = &node_ops, .ctx = p};
    pthread_mutex_lock(&u->lock);
    u->now = p;
    pthread_mutex_unlock(&u->lock);
    emu_node_add(&p->node);
    add_number(u, 0, "busnum", 1);
    add_number(u, 1, "devnum", u->address);
    add_number(u, 2, "speed", 480);
    add_number(u, 3, "bConfigurationValue", 1);
    int n = emu_usb_descriptor(u, EMU_USB_ALL, 0, u->descriptors, sizeof u->descriptors);
    add_file(u, 4, "descriptors", u->descriptors, (size_t)n);
    if (u->timed)
        emu_poll_hook(let_time_pass, u);
    emu_udev_plug(u->name, p->path);
}

void emu_usb_deny(struct emu_usb *u, bool denied)
{
    u->denied = denied;
}

void emu_usb_take(struct emu_usb *u, bool taken)
{
    u->taken = taken;
}

void emu_usb_bind_driver(struct emu_usb *u, bool bound)
{
    u->driver_bound = bound;
}

/* An attribute of what is not configured is empty. */
void emu_usb_configure(struct emu_usb *u, bool configured)
{
    u->file[3].size = configured ? strlen(u->text[3]) : 0;
}

void emu_usb_give_back(struct emu_usb *u)
{
    pthread_mutex_lock(&u->lock);
    while (u->now->blocked.count > 0)
        finish(u->now, take_urb(&u->now->blocked, 0), -ENOENT, 0);
    u->keeps_blocked = false;
    pthread_mutex_unlock(&u->lock);
}

void emu_usb_unplug(struct emu_usb *u)
{
    pthread_mutex_lock(&u->lock);
    if (u->now)
        unplug(u);
    pthread_mutex_unlock(&u->lock);
}

void emu_usb_free(struct emu_usb *u)
{
    emu_usb_unplug(u);
    if (u->timed)
        emu_poll_hook(NULL, NULL);
    pthread_mutex_destroy(&u->lock);
}
