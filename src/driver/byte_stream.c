#include "driver/byte_stream.h"

#include <errno.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

static int64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

/* Until the descriptor is ready, something has happened to it, or the deadline. */
static void await(const struct mk_byte_stream *s, short events, int64_t deadline_ns)
{
    int64_t left_ns = deadline_ns - now_ns();
    struct pollfd p = {.fd = s->fd, .events = events};
    if (left_ns < 0)
        left_ns = 0;
    const struct timespec wait = {.tv_sec = (time_t)(left_ns / 1000000000),
                                  .tv_nsec = (long)(left_ns % 1000000000)};
    (void)ppoll(&p, 1, &wait, NULL);
}

/* Neither a stream nor a line comes back to life: whatever is not "later" is the end. */
static enum mk_status from_errno(struct mk_byte_stream *s, int why)
{
    switch (why) {
    case EAGAIN:
    case EINTR:
        return MK_OK;
    case ENOBUFS:
    case ENOMEM:
        return MK_ERR_PROTO; /* of the system for now */
    default:
        s->gone = true;
        return MK_ERR_NODEV;
    }
}

/* A peer that has closed must not end the program: MSG_NOSIGNAL; terminals send no SIGPIPE. */
static ssize_t put(const struct mk_byte_stream *s, const uint8_t *bytes, size_t n)
{
    return s->socket ? send(s->fd, bytes, n, MSG_NOSIGNAL) : write(s->fd, bytes, n);
}

static enum mk_status stream_send(void *link, const uint8_t *bytes, size_t n, int64_t deadline_ns)
{
    struct mk_byte_stream *s = link;
    size_t sent = 0;
    for (;;) {
        if (s->gone)
            return MK_ERR_NODEV;
        ssize_t k = put(s, bytes + sent, n - sent);
        enum mk_status st = k < 0 ? from_errno(s, errno) : MK_OK;
        if (st != MK_OK)
            return st;
        sent += k > 0 ? (size_t)k : 0;
        if (sent == n)
            return MK_OK;
        /* A frame that stays unfinished is found out by its checks. */
        if (now_ns() >= deadline_ns)
            return MK_ERR_TIMEOUT;
        await(s, POLLOUT, deadline_ns);
    }
}

static enum mk_status stream_receive(void *link, const uint8_t **bytes, size_t *n,
                                     int64_t deadline_ns)
{
    struct mk_byte_stream *s = link;
    /* Even after the deadline one wait, of no time: it may be us who were late. */
    for (bool waited = false;; waited = true) {
        if (s->gone)
            return MK_ERR_NODEV;
        ssize_t k = read(s->fd, s->buffer, sizeof s->buffer);
        if (k > 0) {
            *bytes = s->buffer;
            *n = (size_t)k;
            return MK_OK;
        }
        enum mk_status st = from_errno(s, k < 0 ? errno : EPIPE); /* 0: the other end has closed */
        if (st != MK_OK)
            return st;
        if (waited && now_ns() >= deadline_ns)
            return MK_ERR_TIMEOUT;
        await(s, POLLIN, deadline_ns);
    }
}

const struct mk_link_ops mk_byte_stream_link = {stream_send, stream_receive};

void mk_byte_stream_init(struct mk_byte_stream *s, int fd)
{
    int type;
    socklen_t size = sizeof type;
    memset(s, 0, sizeof *s);
    s->fd = fd;
    s->socket = getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) == 0;
}
