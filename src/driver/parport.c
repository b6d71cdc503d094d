#include "driver/parport.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/parport.h>
#include <linux/ppdev.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <time.h>
#include <unistd.h>

#define PORTS 4
#define KERNEL_PATIENCE_US 3000 /* of the kernel's handshakes */
#define SPIN_NS 1000000         /* then it sleeps between looks */
#define NAP_NS 100000

static int64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

const char *mk_parport_mode_name(enum mk_parport_mode mode)
{
    static const char *const name[] = {"EPP", "byte mode", "nibble mode"};
    return name[mode];
}

/* --- transfers ---------------------------------------------------------------------------------
 */

static enum mk_status from_errno(int why)
{
    switch (why) {
    case ENODEV:
    case ENXIO:
    case EBADF:
        return MK_ERR_NODEV;
    case EAGAIN:
    case ETIMEDOUT:
        return MK_ERR_TIMEOUT;
    default:
        return MK_ERR_PROTO;
    }
}

static int negotiate(const struct mk_parport *p, int mode)
{
    int rc;
    do
        rc = ioctl(p->fd, PPNEGOT, &mode);
    while (rc != 0 && errno == EINTR);
    return rc == 0 ? 0 : errno;
}

/* Byte and nibble mode: which way the data lines work. */
static int turn(struct mk_parport *p, bool reverse)
{
    if (p->mode == MK_PARPORT_EPP || p->reverse == reverse)
        return 0;
    int inwards = p->mode == MK_PARPORT_BYTE ? IEEE1284_MODE_BYTE : IEEE1284_MODE_NIBBLE;
    int why = negotiate(p, reverse ? inwards : IEEE1284_MODE_COMPAT);
    if (why == 0)
        p->reverse = reverse;
    return why;
}

/* Between two looks at a board that has nothing to say yet. */
static void wait_a_little(int64_t since_ns)
{
    const struct timespec nap = {.tv_nsec = NAP_NS};
    if (now_ns() - since_ns > SPIN_NS)
        nanosleep(&nap, NULL);
}

static enum mk_status parport_send(void *link, const uint8_t *bytes, size_t n, int64_t deadline_ns)
{
    struct mk_parport *p = link;
    int64_t start_ns = now_ns();
    size_t sent = 0;
    int why = turn(p, false);
    while (why == 0 && sent < n) {
        ssize_t k = write(p->fd, bytes + sent, n - sent);
        if (k > 0) {
            sent += (size_t)k;
        } else if (k < 0 && errno != EAGAIN && errno != EINTR) {
            why = errno;
        } else if (now_ns() >= deadline_ns) {
            why = ETIMEDOUT;
        } else {
            wait_a_little(start_ns);
        }
    }
    /* ENXIO from a negotiation is the board not answering it, not the port having gone. */
    return why == 0 ? MK_OK : why == ENXIO ? MK_ERR_PROTO : from_errno(why);
}

/* What the board has to say by now: the number of bytes, 0 for nothing, or a negative errno. */
static ssize_t read_now(struct mk_parport *p)
{
    unsigned char status = 0;
    if (p->mode == MK_PARPORT_EPP) {
        if (ioctl(p->fd, PPRSTATUS, &status) != 0)
            return -errno;
        if (status & PARPORT_STATUS_ERROR) /* nFault high: nothing */
            return 0;
    }
    int why = turn(p, true);
    if (why != 0)
        return why == ENXIO ? -EPROTO : -why;
    ssize_t n = read(p->fd, p->buffer, sizeof p->buffer);
    if (n < 0 && (errno == EAGAIN || errno == EINTR))
        n = 0;
    return n < 0 ? -errno : n;
}

static enum mk_status parport_receive(void *link, const uint8_t **bytes, size_t *n,
                                      int64_t deadline_ns)
{
    struct mk_parport *p = link;
    int64_t start_ns = now_ns();
    for (;;) {
        ssize_t got = read_now(p);
        if (got < 0)
            return from_errno((int)-got);
        if (got > 0) {
            *bytes = p->buffer;
            *n = (size_t)got;
            return MK_OK;
        }
        if (now_ns() >= deadline_ns)
            return MK_ERR_TIMEOUT;
        wait_a_little(start_ns);
    }
}

const struct mk_link_ops mk_parport_link = {parport_send, parport_receive};

/* --- opening -----------------------------------------------------------------------------------
 */

static enum mk_status open_error(struct mk_error *err, int why, const char *path)
{
    switch (why) {
    case ENOENT:
    case ENODEV:
    case ENXIO:
        return mk_error_set(
            err, MK_ERR_NOTFOUND,
            "no parallel port %s: modprobe ppdev parport_pc; is the port switched on "
            "in the firmware setup?",
            path);
    case EACCES:
    case EPERM:
        return mk_error_set(
            err, MK_ERR_PERM,
            "no permission for %s: install the udev rule (docs/boards.md), join its "
            "group, log in again",
            path);
    default:
        return mk_error_errno(err, why, path, "cannot open the parallel port");
    }
}

static enum mk_status open_device(struct mk_parport *p, const char *device, struct mk_error *err)
{
    char path[32];
    int why = ENOENT;
    for (int i = 0; i < (device ? 1 : PORTS); i++) {
        snprintf(path, sizeof path, "/dev/parport%d", i);
        p->fd = open(device ? device : path, O_RDWR | O_NONBLOCK | O_CLOEXEC);
        if (p->fd >= 0)
            return MK_OK;
        if (errno != ENOENT)
            why = errno;
    }
    return open_error(err, why, device ? device : "/dev/parport0");
}

static enum mk_status claim(struct mk_parport *p, struct mk_error *err)
{
    const struct timeval patience = {.tv_usec = KERNEL_PATIENCE_US};
    if (ioctl(p->fd, PPEXCL) != 0 || ioctl(p->fd, PPCLAIM) != 0) {
        if (errno == ENOTTY)
            return mk_error_set(err, MK_ERR_NOTFOUND,
                                "this device is no parallel port: try /dev/parport0");
        return mk_error_set(err, errno == ENXIO || errno == EBUSY ? MK_ERR_BUSY : MK_ERR_IO,
                            "cannot claim the parallel port: another program or driver holds it "
                            "(rmmod lp?): %s",
                            strerror(errno));
    }
    p->claimed = true;
    (void)ioctl(p->fd, PPSETTIME, &patience);
    return MK_OK;
}

/* The fastest way that port and board have in common. */
static enum mk_status choose_mode(struct mk_parport *p, struct mk_error *err)
{
    unsigned modes = 0;
    int why = 0;
    (void)ioctl(p->fd, PPGETMODES, &modes);
    if (modes & PARPORT_MODE_EPP) {
        p->mode = MK_PARPORT_EPP;
        why = negotiate(p, IEEE1284_MODE_EPP);
        if (why == 0)
            return MK_OK;
        (void)negotiate(p, IEEE1284_MODE_COMPAT);
    }
    for (int m = MK_PARPORT_BYTE; m <= MK_PARPORT_NIBBLE; m++) {
        if (m == MK_PARPORT_BYTE && !(modes & PARPORT_MODE_TRISTATE))
            continue;
        p->mode = (enum mk_parport_mode)m;
        p->reverse = false;
        why = turn(p, true);
        if (why == 0)
            why = turn(p, false);
        if (why == 0)
            return MK_OK;
        (void)negotiate(p, IEEE1284_MODE_COMPAT);
    }
    return mk_error_set(err, MK_ERR_NOTFOUND,
                        "no board answers at the parallel port: plugged in and switched on? (%s)",
                        strerror(why));
}

enum mk_status mk_parport_open(struct mk_parport *p, const char *device, struct mk_error *err)
{
    memset(p, 0, sizeof *p);
    enum mk_status st = open_device(p, device, err);
    if (st == MK_OK)
        st = claim(p, err);
    if (st == MK_OK)
        st = choose_mode(p, err);
    if (st != MK_OK)
        mk_parport_close(p);
    return st;
}

void mk_parport_close(struct mk_parport *p)
{
    if (p->fd < 0)
        return;
    if (p->claimed) {
        (void)negotiate(p, IEEE1284_MODE_COMPAT);
        (void)ioctl(p->fd, PPRELEASE);
    }
    close(p->fd);
    p->fd = -1;
}

int mk_parport_find(struct mk_board_found *out, int max)
{
    int n = 0;
    for (int i = 0; i < PORTS; i++) {
        struct mk_error err = MK_ERROR_INIT;
        struct mk_board_found f = {.name = "parallel port"};
        snprintf(f.device, sizeof f.device, "/dev/parport%d", i);
        int fd = open(f.device, O_RDWR | O_NONBLOCK | O_CLOEXEC);
        if (fd < 0 && errno == ENOENT)
            continue;
        if (fd < 0) {
            f.status = open_error(&err, errno, f.device);
            snprintf(f.note, sizeof f.note, "%.255s", err.message);
        } else {
            close(fd);
        }
        if (n < max)
            out[n] = f;
        n++;
    }
    return n;
}
