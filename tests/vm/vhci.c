/* Stands in for emu/usb.c where there is a kernel to ask: the same boards with the same plans of
 * faults, plugged into the kernel's own bus. vhci_hcd takes one end of a socket and speaks USB/IP
 * over it; a thread here is the device at the other end. Enumeration, usbfs, sysfs and what libusb
 * makes of them are then the real ones. Needs root and the module vhci-hcd. */
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "emu/usb.h"
#include "suites.h"

#define HUB "/sys/devices/platform/vhci_hcd.0/"
#define PORTS 4
#define PENDING 32
#define TRANSFER_MAX 4096
#define SPEED_HIGH 3
/* A process that dies gives its descriptors back from the last one down. The socket has to go
 * before libusb's node, which waits for answers to what it cancels. */
#define LAST_DESCRIPTOR 900
#define SETTLE_MS 5000 /* the kernel's time for plugging in or out */

/* --- USB/IP (the kernel's Documentation/usb/usbip_protocol.rst) ---------------------------------
 */

enum { CMD_SUBMIT = 1, CMD_UNLINK, RET_SUBMIT, RET_UNLINK };

/* All big-endian. `a` .. `e` of a request: flags (or the unlinked number), length, start frame,
 * packets, interval; of an answer: status, length, ... */
struct header {
    uint32_t command, number, device, in, endpoint, a, b, c, d, e;
    uint8_t setup[8];
};
_Static_assert(sizeof(struct header) == 48, "as on the wire");

struct pending {
    uint32_t number, length;
};

struct list {
    struct pending at[PENDING];
    int count;
};

struct port {
    struct emu_usb *usb; /* NULL: free */
    int index, fd;
    pthread_t server;
    pid_t owner; /* whose thread it is: not that of a process forked since */
    bool plugged, halted_out, halted_in;
    struct list waiting, blocked; /* IN transfers; OUT transfers that are not taken */
};

static struct port ports[PORTS];

static struct port *port_of(const struct emu_usb *u)
{
    for (int i = 0; i < PORTS; i++)
        if (ports[i].usb == u)
            return &ports[i];
    return NULL;
}

static bool read_all(int fd, void *bytes, size_t n)
{
    for (size_t k = 0; k < n;) {
        ssize_t got = recv(fd, (char *)bytes + k, n - k, 0);
        if (got <= 0)
            return false;
        k += (size_t)got;
    }
    return true;
}

static void answer(const struct port *p, uint32_t command, uint32_t number, int status,
                   const void *data, size_t length, bool in)
{
    uint8_t bytes[sizeof(struct header) + TRANSFER_MAX];
    struct header h = {.command = htonl(command),
                       .number = htonl(number),
                       .a = htonl((uint32_t)status),
                       .b = htonl((uint32_t)length),
                       .d = 0xffffffff};
    size_t n = sizeof h;
    memcpy(bytes, &h, sizeof h);
    if (in && length > 0) {
        memcpy(bytes + n, data, length);
        n += length;
    }
    (void)send(p->fd, bytes, n, MSG_NOSIGNAL); /* unplugged: nobody listens */
}

static void finish(const struct port *p, uint32_t number, int status, const void *data,
                   size_t length, bool in)
{
    answer(p, RET_SUBMIT, number, status, data, length, in);
}

static void add(struct list *l, uint32_t number, uint32_t length)
{
    if (l->count < PENDING)
        l->at[l->count++] = (struct pending){number, length};
}

static struct pending take(struct list *l, int i)
{
    struct pending t = l->at[i];
    l->count--;
    memmove(l->at + i, l->at + i + 1, (size_t)(l->count - i) * sizeof l->at[0]);
    return t;
}

static bool forget(struct list *l, uint32_t number)
{
    for (int i = 0; i < l->count; i++)
        if (l->at[i].number == number) {
            (void)take(l, i);
            return true;
        }
    return false;
}

/* --- the device; its lock is held ---------------------------------------------------------------
 */

static void pump(struct port *p)
{
    struct emu_usb *u = p->usb;
    const struct emu_chunk *c;
    while (p->waiting.count > 0 && p->halted_in)
        finish(p, take(&p->waiting, 0).number, -EPIPE, NULL, 0, true);
    while (p->waiting.count > 0 && !p->halted_in && (c = emu_line_next(&u->line)) != NULL) {
        struct pending t = take(&p->waiting, 0);
        int status = c->fault == EMU_FAULT_STALL_IN   ? -EPIPE
                     : c->fault == EMU_FAULT_ERROR_IN ? -EPROTO
                     : c->fault == EMU_FAULT_OVERFLOW ? -EOVERFLOW
                     : c->size > (size_t)t.length     ? -EOVERFLOW
                                                      : 0;
        p->halted_in = status == -EPIPE;
        finish(p, t.number, status, c->bytes, status ? 0 : c->size, true);
        emu_line_drop(&u->line);
    }
}

static bool put(const char *file, const char *text)
{
    int fd = open(file, O_WRONLY | O_CLOEXEC);
    bool well = fd >= 0 && write(fd, text, strlen(text)) == (ssize_t)strlen(text);
    if (fd >= 0)
        close(fd);
    return well;
}

static void detach(struct port *p)
{
    char text[8];
    snprintf(text, sizeof text, "%d", p->index);
    p->usb->line.chunks = 0;
    p->waiting.count = p->blocked.count = 0;
    (void)put(HUB "detach", text);
}

static void bulk_out(struct port *p, uint32_t number, const uint8_t *bytes, size_t n)
{
    struct emu_usb *u = p->usb;
    if (p->halted_out) {
        finish(p, number, -EPIPE, NULL, 0, false);
        return;
    }
    enum emu_fault fault = emu_line_fault(&u->line);
    switch (fault) {
    case EMU_FAULT_UNPLUG:
        detach(p);
        return;
    case EMU_FAULT_BLOCK_OUT:
        add(&p->blocked, number, (uint32_t)n);
        return;
    case EMU_FAULT_STALL_OUT:
        p->halted_out = true;
        finish(p, number, -EPIPE, NULL, 0, false);
        return;
    case EMU_FAULT_ERROR_OUT:
        finish(p, number, -EPROTO, NULL, 0, false);
        return;
    default:
        emu_line_send(&u->line, bytes, n, fault);
        break;
    }
    finish(p, number, 0, NULL, fault == EMU_FAULT_SHORT_REQUEST ? n / 2 : n, false);
    pump(p);
}

/* CLEAR_FEATURE of an endpoint's halt, SET_CONFIGURATION, GET_STATUS, descriptors. */
static void control(struct port *p, uint32_t number, const uint8_t *s)
{
    uint8_t data[256] = {0};
    bool in = (s[0] & 0x80) != 0;
    int wanted = s[6] | s[7] << 8, n = -EPIPE;
    if (s[0] == 0x02 && s[1] == 1) {
        *(s[4] & 0x80 ? &p->halted_in : &p->halted_out) = false;
        n = 0;
    } else if ((s[0] == 0 && s[1] == 9) || (s[0] == 1 && s[1] == 11)) {
        n = 0;
    } else if (in && s[1] == 0) {
        n = 2;
    } else if (s[0] == 0x80 && s[1] == 6) {
        n = emu_usb_descriptor(p->usb, s[3], s[2], data, sizeof data);
    }
    if (n > wanted)
        n = wanted;
    finish(p, number, n < 0 ? n : 0, data, n < 0 ? 0 : (size_t)n, in);
}

static void unlink_transfer(struct port *p, uint32_t number, uint32_t which)
{
    bool found = forget(&p->waiting, which) || forget(&p->blocked, which);
    answer(p, RET_UNLINK, number, found ? -ECONNRESET : 0, NULL, 0, false);
}

static void serve_one(struct port *p, const struct header *h, const uint8_t *bytes)
{
    uint32_t number = ntohl(h->number), length = ntohl(h->b);
    if (ntohl(h->command) == CMD_UNLINK) {
        unlink_transfer(p, number, ntohl(h->a));
    } else if (h->endpoint == 0) {
        control(p, number, h->setup);
    } else if (!h->in) {
        bulk_out(p, number, bytes, length);
    } else {
        add(&p->waiting, number, length);
        pump(p);
    }
}

/* While a board streams, its time goes on by itself; simulated time as soon as the last sample has
 * been answered. Returns for how long nothing will happen, ms; -1: for ever. */
static int let_time_pass(struct port *p)
{
    struct mk_emulated *e = p->usb->timed;
    if (!e || !e->device.stream_us)
        return -1;
    int64_t next_ns = e->opened_ns + (int64_t)e->device.stream_next_ns;
    bool answered = e->device.stream_answered == e->device.stream_sample;
    if (e->clock->ops->simulated && answered && p->waiting.count > 0)
        mk_clock_sleep_until(e->clock, next_ns);
    (void)mk_emulated_run(e);
    emu_line_collect(&p->usb->line, EMU_FAULT_NONE);
    pump(p);
    return 1;
}

static void *server(void *arg)
{
    struct port *p = arg;
    struct emu_usb *u = p->usb;
    uint8_t bytes[TRANSFER_MAX];
    for (;;) {
        struct header h;
        struct pollfd readable = {.fd = p->fd, .events = POLLIN};
        pthread_mutex_lock(&u->lock);
        int wait_ms = let_time_pass(p);
        pthread_mutex_unlock(&u->lock);
        if (poll(&readable, 1, wait_ms) == 0)
            continue;
        if (!read_all(p->fd, &h, sizeof h))
            return NULL;
        bool data = ntohl(h.command) == CMD_SUBMIT && !h.in;
        uint32_t n = data ? ntohl(h.b) : 0;
        if (n > sizeof bytes || !read_all(p->fd, bytes, n))
            return NULL;
        pthread_mutex_lock(&u->lock);
        serve_one(p, &h, bytes);
        pthread_mutex_unlock(&u->lock);
    }
}

/* --- plugging -----------------------------------------------------------------------------------
 */

/* vhci_hcd's first hub is bus 1 on a machine without other buses. */
static void sysfs_path(const struct port *p, const char *attribute, char *out, size_t size)
{
    snprintf(out, size, "/sys/bus/usb/devices/1-%d%s", p->index + 1, attribute);
}

static void settle(const struct port *p, bool there)
{
    char path[80];
    sysfs_path(p, "/bConfigurationValue", path, sizeof path);
    for (int ms = 0; ms < SETTLE_MS; ms += 5) {
        char value = 0;
        int fd = open(path, O_RDONLY | O_CLOEXEC);
        if (fd >= 0 && read(fd, &value, 1) != 1)
            value = 0;
        if (fd >= 0)
            close(fd);
        if (there ? value == '1' : fd < 0)
            return;
        usleep(5000);
    }
    ck_abort_msg("the kernel did not see port %d %s", p->index, there ? "filled" : "emptied");
}

void emu_usb_init(struct emu_usb *u, int port, const char *serial, struct emu_board board)
{
    memset(u, 0, sizeof *u);
    pthread_mutex_init(&u->lock, NULL);
    u->line.board = board;
    snprintf(u->serial, sizeof u->serial, "%s", serial);
    ports[port] = (struct port){.usb = u, .index = port, .fd = -1};
}

void emu_usb_plug(struct emu_usb *u)
{
    struct port *p = port_of(u);
    int ends[2];
    char text[48];
    emu_usb_unplug(u); /* the plan may have pulled it */
    ck_assert_int_eq(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends), 0);
    p->fd = fcntl(ends[1], F_DUPFD_CLOEXEC, LAST_DESCRIPTOR);
    close(ends[1]);
    p->halted_in = p->halted_out = false;
    p->owner = getpid();
    ck_assert_int_eq(pthread_create(&p->server, NULL, server, p), 0);
    snprintf(text, sizeof text, "%d %d %d %d", p->index, ends[0], (1 << 16) + 2 + p->index,
             SPEED_HIGH);
    ck_assert_msg(put(HUB "attach", text), "vhci_hcd: %s", strerror(errno));
    close(ends[0]);
    p->plugged = true;
    settle(p, true);
}

void emu_usb_unplug(struct emu_usb *u)
{
    struct port *p = port_of(u);
    if (!p->plugged)
        return;
    p->plugged = false;
    pthread_mutex_lock(&u->lock);
    detach(p);
    pthread_mutex_unlock(&u->lock);
    shutdown(p->fd, SHUT_RDWR);
    if (p->owner == getpid())
        pthread_join(p->server, NULL);
    close(p->fd);
    settle(p, false);
}

void emu_usb_free(struct emu_usb *u)
{
    emu_usb_deny(u, false);
    emu_usb_take(u, false);
    emu_usb_unplug(u);
    emu_usb_bind_driver(u, false);
    pthread_mutex_destroy(&u->lock);
    port_of(u)->usb = NULL;
}

/* --- who may ------------------------------------------------------------------------------------
 */

static int open_node(const struct port *p)
{
    char path[80], number[8] = "";
    sysfs_path(p, "/devnum", path, sizeof path);
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd >= 0 && read(fd, number, sizeof number - 1) < 0)
        number[0] = '\0';
    if (fd >= 0)
        close(fd);
    snprintf(path, sizeof path, "/dev/bus/usb/001/%03d", atoi(number));
    return open(path, O_RDWR | O_CLOEXEC);
}

/* Nobody in particular may not open root's node. */
void emu_usb_deny(struct emu_usb *u, bool denied)
{
    if (denied != u->denied)
        ck_assert_int_eq(seteuid(denied ? 65534 : 0), 0);
    u->denied = denied;
}

void emu_usb_take(struct emu_usb *u, bool taken)
{
    unsigned interface = 0;
    if (taken && u->taken_fd < 1) {
        u->taken_fd = open_node(port_of(u));
        ck_assert_int_eq(ioctl(u->taken_fd, USBDEVFS_CLAIMINTERFACE, &interface), 0);
    } else if (!taken && u->taken_fd > 0) {
        close(u->taken_fd);
        u->taken_fd = 0;
    }
}

void emu_usb_configure(struct emu_usb *u, bool configured)
{
    char path[80];
    sysfs_path(port_of(u), "/bConfigurationValue", path, sizeof path);
    ck_assert(put(path, configured ? "1" : "-1"));
}

/* The kernel gives back what is cancelled by itself. */
void emu_usb_give_back(struct emu_usb *u)
{
    u->keeps_blocked = false;
}

/* The serial converters' driver takes any device with bulk endpoints that it is told to. */
void emu_usb_bind_driver(struct emu_usb *u, bool bound)
{
    if (bound == u->driver_bound)
        return;
    u->driver_bound = bound;
    if (bound) {
        int fd = open("/modules/usbserial.ko", O_RDONLY | O_CLOEXEC);
        ck_assert_int_eq(syscall(SYS_finit_module, fd, "vendor=0x1209 product=0x0001", 0), 0);
        close(fd);
        usleep(200000);
    } else {
        syscall(SYS_delete_module, "usbserial", O_NONBLOCK);
    }
}
