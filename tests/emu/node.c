/* What libraries call is open, __open_2 and so on, by what they were built with: all are here. */
#undef _FORTIFY_SOURCE
#include "emu/node.h"

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdint.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/vfs.h>
#include <time.h>
#include <unistd.h>

#define NODES 8
#define FILES 64
#define DESCRIPTORS 1024
#define SYSFS_MAGIC 0x62656572
#define EXPORT __attribute__((visibility("default")))

/* The function of that name behind ours. */
#define NEXT(name)                                                                                 \
    ({                                                                                             \
        static _Atomic(__typeof__(&name)) next;                                                    \
        __typeof__(&name) f = atomic_load(&next);                                                  \
        if (!f) {                                                                                  \
            f = (__typeof__(&name))dlsym(RTLD_NEXT, #name);                                        \
            atomic_store(&next, f);                                                                \
        }                                                                                          \
        f;                                                                                         \
    })

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static struct emu_node *nodes[NODES];
static struct emu_file *files[FILES];
static _Atomic(struct emu_node *) of_descriptor[DESCRIPTORS];
static struct {
    int (*call)(void *ctx, int timeout_ms);
    void *ctx;
} hook;

static struct {
    struct emu_wish (*call)(void *ctx);
    void *ctx;
} pump;

static struct emu_node *node_of(int fd)
{
    return fd >= 0 && fd < DESCRIPTORS ? atomic_load(&of_descriptor[fd]) : NULL;
}

static void set_slot(void **slots, int count, void *from, void *to)
{
    pthread_mutex_lock(&lock);
    for (int i = 0; i < count; i++)
        if (slots[i] == from) {
            slots[i] = to;
            break;
        }
    pthread_mutex_unlock(&lock);
}

void emu_node_add(struct emu_node *node)
{
    node->write_fd = node->read_fd = -1;
    set_slot((void **)nodes, NODES, NULL, node);
}

void emu_node_remove(struct emu_node *node)
{
    set_slot((void **)nodes, NODES, node, NULL);
}

void emu_file_add(struct emu_file *file)
{
    set_slot((void **)files, FILES, NULL, file);
}

void emu_file_remove(struct emu_file *file)
{
    set_slot((void **)files, FILES, file, NULL);
}

void emu_poll_hook(int (*call)(void *ctx, int timeout_ms), void *ctx)
{
    hook.call = call;
    hook.ctx = ctx;
}

void emu_pump(struct emu_wish (*call)(void *ctx), void *ctx)
{
    pump.call = call;
    pump.ctx = ctx;
}

void emu_node_ready(struct emu_node *node, bool ready)
{
    char bytes[8];
    if (node->read_fd < 0 || node->write_fd < 0 || ready == !node->full)
        return;
    if (ready)
        while (NEXT(read)(node->read_fd, bytes, sizeof bytes) > 0)
            ;
    else if (NEXT(write)(node->write_fd, "", 1) != 1)
        return;
    node->full = !ready;
}

void emu_node_hang_up(struct emu_node *node)
{
    if (node->read_fd >= 0)
        NEXT(close)(node->read_fd);
    node->read_fd = -1;
}

/* --- open ----------------------------------------------------------------------------------------
 */

/* A pipe whose end for writing has the lowest descriptor that is free, as what is opened has. */
static int open_pipe(int ends[2])
{
    int made[2];
    if (pipe2(made, O_CLOEXEC | O_NONBLOCK) != 0)
        return -1;
    ends[0] = fcntl(made[0], F_DUPFD_CLOEXEC, made[1] + 1);
    ends[1] = dup3(made[1], made[0], O_CLOEXEC);
    NEXT(close)(made[1]);
    return ends[0] >= 0 && ends[1] >= 0 ? 0 : -1;
}

static int open_node(struct emu_node *node)
{
    int ends[2];
    int why = node->ops->open ? node->ops->open(node->ctx) : 0;
    if (why < 0 || node->write_fd >= 0) {
        errno = why < 0 ? -why : EBUSY;
        return -1;
    }
    if (open_pipe(ends) != 0)
        return -1;
    /* One page: a page that holds a byte takes no more writers, which is "not ready". */
    fcntl(ends[1], F_SETPIPE_SZ, 4096);
    node->read_fd = ends[0];
    node->write_fd = ends[1];
    node->full = false;
    emu_node_ready(node, false);
    atomic_store(&of_descriptor[ends[1]], node);
    return ends[1];
}

static int open_file(const struct emu_file *file)
{
    int fd = memfd_create("emu", MFD_CLOEXEC);
    if (fd >= 0 && NEXT(write)(fd, file->bytes, file->size) == (ssize_t)file->size)
        lseek(fd, 0, SEEK_SET);
    return fd;
}

#define NOT_OURS (-2)
static int open_ours(const char *path)
{
    struct emu_node *node = NULL;
    struct emu_file *file = NULL;
    pthread_mutex_lock(&lock);
    for (int i = 0; i < NODES; i++)
        if (nodes[i] && strcmp(nodes[i]->path, path) == 0)
            node = nodes[i];
    for (int i = 0; i < FILES; i++)
        if (files[i] && strcmp(files[i]->path, path) == 0)
            file = files[i];
    pthread_mutex_unlock(&lock);
    if (node)
        return open_node(node);
    return file ? open_file(file) : NOT_OURS;
}

#define DEFINE_OPEN(name)                                                                          \
    EXPORT int name(const char *path, int flags, ...)                                              \
    {                                                                                              \
        int fd = open_ours(path);                                                                  \
        mode_t mode = 0;                                                                           \
        if (fd != NOT_OURS)                                                                        \
            return fd;                                                                             \
        if (flags & (O_CREAT | __O_TMPFILE)) {                                                     \
            va_list args;                                                                          \
            va_start(args, flags);                                                                 \
            mode = va_arg(args, mode_t);                                                           \
            va_end(args);                                                                          \
        }                                                                                          \
        return NEXT(name)(path, flags, mode);                                                      \
    }
DEFINE_OPEN(open)
DEFINE_OPEN(open64)

int __open_2(const char *path, int flags);
EXPORT int __open_2(const char *path, int flags)
{
    return open(path, flags);
}
int __open64_2(const char *path, int flags);
EXPORT int __open64_2(const char *path, int flags)
{
    return open64(path, flags);
}

/* --- everything else -----------------------------------------------------------------------------
 */

static ssize_t as_errno(ssize_t result)
{
    if (result >= 0)
        return result;
    errno = (int)-result;
    return -1;
}

EXPORT int ioctl(int fd, unsigned long request, ...)
{
    va_list args;
    va_start(args, request);
    void *arg = va_arg(args, void *);
    va_end(args);
    struct emu_node *node = node_of(fd);
    if (!node)
        return NEXT(ioctl)(fd, request, arg);
    return (int)as_errno(node->ops->ioctl(node->ctx, (unsigned)request, arg));
}

EXPORT ssize_t read(int fd, void *bytes, size_t n)
{
    struct emu_node *node = node_of(fd);
    if (!node)
        return NEXT(read)(fd, bytes, n);
    return as_errno(node->ops->read ? node->ops->read(node->ctx, bytes, n) : -EINVAL);
}

ssize_t __read_chk(int fd, void *bytes, size_t n, size_t size);
EXPORT ssize_t __read_chk(int fd, void *bytes, size_t n, size_t size)
{
    if (n > size)
        __builtin_trap();
    return read(fd, bytes, n);
}

EXPORT ssize_t write(int fd, const void *bytes, size_t n)
{
    struct emu_node *node = node_of(fd);
    if (!node)
        return NEXT(write)(fd, bytes, n);
    return as_errno(node->ops->write ? node->ops->write(node->ctx, bytes, n) : -EINVAL);
}

EXPORT int close(int fd)
{
    struct emu_node *node = node_of(fd);
    if (node) {
        atomic_store(&of_descriptor[fd], NULL);
        if (node->ops->close)
            node->ops->close(node->ctx);
        emu_node_hang_up(node);
        node->write_fd = -1;
    }
    return NEXT(close)(fd);
}

EXPORT int poll(struct pollfd *fds, nfds_t n, int timeout_ms)
{
    bool ours = false;
    for (nfds_t i = 0; i < n; i++)
        ours = ours || node_of(fds[i].fd);
    if (!ours || !hook.call)
        return NEXT(poll)(fds, n, timeout_ms);
    for (;;) {
        int limit_ms = hook.call(hook.ctx, timeout_ms);
        bool cut = limit_ms >= 0 && (timeout_ms < 0 || limit_ms < timeout_ms);
        int ready = NEXT(poll)(fds, n, cut ? limit_ms : timeout_ms);
        if (ready != 0 || !cut)
            return ready;
        if (timeout_ms > 0)
            timeout_ms -= limit_ms;
    }
}

static int64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

#define ARRIVAL_NS INT64_C(2000000000)

/* One sleep of the loop below: 0 when the far end is to be called again, or the time is over. */
static int wait_for_both(struct pollfd *fds, nfds_t n, const struct emu_wish *wish, int64_t left_ns,
                         const sigset_t *mask)
{
    struct pollfd both[8];
    const struct timespec wait = {left_ns / 1000000000, left_ns % 1000000000};
    if (n + 1 > sizeof both / sizeof both[0])
        __builtin_trap();
    memcpy(both, fds, n * sizeof fds[0]);
    both[n] = (struct pollfd){.fd = wish->fd, .events = POLLIN};
    int ready = NEXT(ppoll)(both, n + 1, &wait, mask);
    memcpy(fds, both, n * sizeof fds[0]);
    return ready > 0 ? ready - (both[n].revents != 0) : ready;
}

EXPORT int ppoll(struct pollfd *fds, nfds_t n, const struct timespec *timeout, const sigset_t *mask)
{
    if (!pump.call)
        return NEXT(ppoll)(fds, n, timeout, mask);
    int64_t wait_ns =
        timeout ? (int64_t)timeout->tv_sec * 1000000000 + timeout->tv_nsec : 1000000000000;
    int64_t end_ns = now_ns() + wait_ns;
    for (;;) {
        struct emu_wish wish = pump.call(pump.ctx);
        int64_t left_ns = end_ns - now_ns(), limit_ns = wish.limit_ms * INT64_C(1000000);
        if (wish.said && left_ns < ARRIVAL_NS) {
            end_ns += ARRIVAL_NS - left_ns;
            left_ns = ARRIVAL_NS;
        }
        if (wish.limit_ms >= 0 && limit_ns < left_ns)
            left_ns = limit_ns;
        int ready = wait_for_both(fds, n, &wish, left_ns > 0 ? left_ns : 0, mask);
        if (ready != 0 || now_ns() >= end_ns)
            return ready;
    }
}

/* Containers may have no sysfs; libusb asks for its magic number. */
EXPORT int statfs(const char *path, struct statfs *out)
{
    int result = NEXT(statfs)(path, out);
    if (strcmp(path, "/sys") != 0)
        return result;
    out->f_type = SYSFS_MAGIC;
    return 0;
}
