/* Device nodes that are not there: this program's own open, ioctl, read, write, close, poll and
 * statfs stand before libc's, for libraries as well. A path or file descriptor that belongs to a
 * node here goes to its table of functions, on the caller's thread; everything else passes through.
 *
 * So the drivers' real code (libusb's, ours for the parallel port) runs against emulated boards, in
 * one process, without root, kernel modules or a helper process, and under sanitizers.
 */
#ifndef MECHKIT_TESTS_EMU_NODE_H
#define MECHKIT_TESTS_EMU_NODE_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>

struct emu_node_ops {
    /* All return what the system call would, errors as negative errno. Optional but ioctl. */
    int (*open)(void *ctx); /* asked before; 0 or an error */
    int (*ioctl)(void *ctx, unsigned long request, void *arg);
    ssize_t (*read)(void *ctx, void *bytes, size_t n);
    ssize_t (*write)(void *ctx, const void *bytes, size_t n);
    void (*close)(void *ctx);
};

/* A node: the descriptor that a caller gets is the writing end of a pipe, so that poll works: full
 * is "nothing ready", empty is POLLOUT, and closing the reading end is POLLERR, as after unplugging
 * a USB device. */
struct emu_node {
    const char *path;
    const struct emu_node_ops *ops;
    void *ctx;
    int write_fd, read_fd; /* -1: closed */
    bool full;
};
void emu_node_add(struct emu_node *node);
void emu_node_remove(struct emu_node *node);
void emu_node_ready(struct emu_node *node, bool ready);
void emu_node_hang_up(struct emu_node *node);

/* Plain files that are not there (sysfs attributes): contents of `path`. */
struct emu_file {
    const char *path;
    const void *bytes;
    size_t size;
};
void emu_file_add(struct emu_file *file);
void emu_file_remove(struct emu_file *file);

/* Called before every poll of a thread that has a node open: lets emulated time pass and returns
 * for how many ms at most to sleep until something may happen by itself; -1: no limit. */
void emu_poll_hook(int (*hook)(void *ctx, int timeout_ms), void *ctx);

/* The far end of a line that is the kernel's own: called before every ppoll of any thread, on
 * whatever descriptors, until it is NULL, and again when it wants to. */
struct emu_wish {
    int fd;       /* when there is something to read from it; -1: none */
    int limit_ms; /* after so long at the latest; -1: no limit */
    /* It has said something: the caller waits for it to arrive, past its timeout as well, for a
     * pseudo-terminal's bytes travel on a thread of the kernel that a busy machine may hold up. */
    bool said;
};
void emu_pump(struct emu_wish (*pump)(void *ctx), void *ctx);

#endif
