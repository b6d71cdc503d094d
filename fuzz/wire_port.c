/* /dev/parport0 with a board behind it that does what the fuzzer's bytes say. Takes the places of
 * the system's calls in the host's code (Makefile). */
#include <errno.h>
#include <fcntl.h>
#include <linux/parport.h>
#include <linux/ppdev.h>
#include <stdarg.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "wire_talk.h"

#define PORT 1000

/* Mostly 0. */
static int result(void)
{
    static const int codes[] = {EIO, ENODEV, ENXIO, EAGAIN, EINTR, ETIMEDOUT, EBUSY, ENOTTY, EPERM};
    uint8_t b = talk_byte();
    if (b < 0xe0)
        return 0;
    errno = codes[b % (sizeof codes / sizeof codes[0])];
    return -1;
}

int open(const char *path, int flags, ...)
{
    (void)path, (void)flags;
    return result() == 0 ? PORT : -1;
}
int close(int fd)
{
    (void)fd;
    return 0;
}
int ioctl(int fd, unsigned long request, ...)
{
    va_list args;
    va_start(args, request);
    void *to = va_arg(args, void *);
    va_end(args);
    (void)fd;
    talk_pass(1000);
    if (request == PPGETMODES) {
        uint8_t b = talk_byte();
        *(unsigned *)to = (b & 1 ? 0 : PARPORT_MODE_EPP) | (b & 2 ? PARPORT_MODE_TRISTATE : 0);
    }
    if (request == PPRSTATUS)
        *(unsigned char *)to = talk_byte() == 0xff ? PARPORT_STATUS_ERROR : 0;
    return result();
}
ssize_t read(int fd, void *out, size_t size)
{
    size_t n = 0;
    (void)fd;
    talk_pass(1000);
    switch (talk_say(out, size, &n)) {
    case TALK_BYTES:
        return (ssize_t)n;
    case TALK_GONE:
        errno = ENODEV;
        return -1;
    case TALK_GARBLED:
        errno = EIO;
        return -1;
    default:
        talk_pass(1000000);
        errno = EAGAIN;
        return -1;
    }
}
ssize_t write(int fd, const void *bytes, size_t size)
{
    (void)fd;
    uint8_t b = talk_byte();
    talk_pass(1000);
    if (b >= 0xe0 && result() != 0)
        return -1;
    size_t n = b & 1 && size > 1 ? size / 2 : size;
    talk_heard(bytes, n);
    return (ssize_t)n;
}
