#include "driver/tcp.h"

#include <errno.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "base/text.h"
#include "driver/resolve.h"

#define BACKLOG 4
/* A client whose machine has vanished is given up after about half a minute. */
#define IDLE_S 15
#define PROBE_S 5
#define PROBES 3

static int64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

/* --- addresses ---------------------------------------------------------------------------------
 */

static enum mk_status wrong_address(const char *text, const char *why, struct mk_error *err)
{
    char shown[128];
    mk_show_text(shown, sizeof shown, text);
    return mk_error_set(err, MK_ERR_USAGE,
                        "'%s': %s; an address is HOST:PORT, such as 127.0.0.1:7000, "
                        "lab-pc:7000 or [::1]:7000",
                        shown, why);
}

static bool is_port(const char *text, bool any_port)
{
    size_t n = strlen(text);
    long port = n > 0 && n <= 5 && strspn(text, "0123456789") == n ? strtol(text, NULL, 10) : -1;
    return port >= (any_port ? 0 : 1) && port <= 65535;
}

enum mk_status mk_tcp_parse(const char *text, bool any_port, struct mk_tcp_address *out,
                            struct mk_error *err)
{
    const char *host = text, *end, *port;
    if (text[0] == '[') {
        host = text + 1;
        end = strchr(host, ']');
        if (!end || end[1] != ':')
            return wrong_address(text, "after [ come an IPv6 address, ], : and the port", err);
        port = end + 2;
    } else {
        end = strrchr(text, ':');
        if (!end)
            return wrong_address(text, "there is no port", err);
        if (memchr(text, ':', (size_t)(end - text)))
            return wrong_address(text, "an IPv6 address goes into brackets", err);
        port = end + 1;
    }
    size_t n = (size_t)(end - host);
    if (n == 0 || n >= sizeof out->host)
        return wrong_address(text, n == 0 ? "there is no host" : "the host's name is too long",
                             err);
    if (!is_port(port, any_port))
        return wrong_address(
            text, any_port ? "a port is 0 (any) to 65535" : "a port is a number from 1 to 65535",
            err);
    memcpy(out->host, host, n);
    out->host[n] = '\0';
    snprintf(out->port, sizeof out->port, "%s", port);
    return MK_OK;
}

static enum mk_status look_up(const struct mk_tcp_address *a, int flags, int64_t deadline_ns,
                              struct addrinfo **out, struct mk_error *err)
{
    int rc = mk_resolve(a->host, a->port, flags, deadline_ns, out);
    if (rc == 0)
        return MK_OK;
    char shown[128];
    mk_show_text(shown, sizeof shown, a->host);
    return mk_error_set(err, rc == EAI_AGAIN ? MK_ERR_TIMEOUT : MK_ERR_NOTFOUND,
                        "no address of host '%s': %s", shown,
                        rc == EAI_SYSTEM ? strerror(errno) : gai_strerror(rc));
}

/* "127.0.0.1:7000" or "[::1]:7000". */
static void name_of(const struct sockaddr *address, socklen_t length, char *out, size_t size)
{
    char host[INET6_ADDRSTRLEN + 32] = "?", port[8] = "?";
    (void)getnameinfo(address, length, host, sizeof host, port, sizeof port,
                      NI_NUMERICHOST | NI_NUMERICSERV);
    snprintf(out, size, address->sa_family == AF_INET6 ? "[%s]:%s" : "%s:%s", host, port);
}

static void send_at_once(int fd)
{
    const int on = 1;
    (void)setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
}

/* --- connecting --------------------------------------------------------------------------------
 */

/* Waits for a connection under way: 0, or why there is none. */
static int await_connection(int fd, int64_t deadline_ns)
{
    int why = 0;
    socklen_t size = sizeof why;
    struct pollfd p = {.fd = fd, .events = POLLOUT};
    for (;;) {
        int64_t left_ns = deadline_ns - now_ns();
        if (left_ns <= 0)
            return ETIMEDOUT;
        const struct timespec wait = {.tv_sec = (time_t)(left_ns / 1000000000),
                                      .tv_nsec = (long)(left_ns % 1000000000)};
        int ready = ppoll(&p, 1, &wait, NULL);
        if (ready > 0)
            return getsockopt(fd, SOL_SOCKET, SO_ERROR, &why, &size) == 0 ? why : errno;
        if (ready < 0 && errno != EINTR)
            return errno;
    }
}

/* 0 and *fd, or why not. */
static int connect_to(const struct addrinfo *a, int64_t deadline_ns, int *fd)
{
    int s = socket(a->ai_family, a->ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC, a->ai_protocol);
    if (s < 0)
        return errno;
    int why = connect(s, a->ai_addr, a->ai_addrlen) == 0 ? 0 : errno;
    if (why == EINPROGRESS || why == EINTR)
        why = await_connection(s, deadline_ns);
    if (why == 0) {
        send_at_once(s);
        *fd = s;
    } else {
        close(s);
    }
    return why;
}

static enum mk_status connect_error(const char *device, int why, struct mk_error *err)
{
    switch (why) {
    case ECONNREFUSED:
        return mk_error_set(err, MK_ERR_NOTFOUND,
                            "nobody listens at %s: is the board switched on, or `mechkit serve` "
                            "running, and is this its address?",
                            device);
    case ETIMEDOUT:
        return mk_error_set(err, MK_ERR_TIMEOUT,
                            "no connection to %s within %d s: address, network, firewall?", device,
                            MK_TCP_CONNECT_S);
    default:
        return mk_error_set(err, MK_ERR_NOTFOUND, "no connection to %s: %s", device, strerror(why));
    }
}

enum mk_status mk_tcp_connect(const char *device, int *fd, struct mk_error *err)
{
    struct mk_tcp_address address;
    struct addrinfo *list, *a;
    *fd = -1;
    if (!device)
        return mk_error_set(err, MK_ERR_USAGE,
                            "a board over TCP has to be named: --device HOST:PORT, such as "
                            "127.0.0.1:7000 or [::1]:7000");
    int64_t end_ns = now_ns() + MK_TCP_CONNECT_S * INT64_C(1000000000);
    enum mk_status st = mk_tcp_parse(device, false, &address, err);
    if (st == MK_OK)
        st = look_up(&address, 0, end_ns, &list, err);
    if (st != MK_OK)
        return st;
    int why = EADDRNOTAVAIL, left = 0;
    for (a = list; a; a = a->ai_next)
        left++;
    /* One address that does not answer leaves the others their share of the time. */
    for (a = list; a && *fd < 0; a = a->ai_next, left--)
        why = connect_to(a, now_ns() + (end_ns - now_ns()) / left, fd);
    freeaddrinfo(list);
    return *fd >= 0 ? MK_OK : connect_error(device, why, err);
}

/* --- listening ---------------------------------------------------------------------------------
 */

static int listen_at(const struct addrinfo *a, int *fd)
{
    const int on = 1;
    int s = socket(a->ai_family, a->ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC, a->ai_protocol);
    if (s < 0)
        return errno;
    (void)setsockopt(s, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    if (bind(s, a->ai_addr, a->ai_addrlen) == 0 && listen(s, BACKLOG) == 0) {
        *fd = s;
        return 0;
    }
    int why = errno;
    close(s);
    return why;
}

enum mk_status mk_tcp_listen(const char *where, int *fd, char *bound, size_t size,
                             struct mk_error *err)
{
    struct mk_tcp_address address;
    struct addrinfo *list, *a;
    struct sockaddr_storage own;
    socklen_t length = sizeof own;
    *fd = -1;
    enum mk_status st = mk_tcp_parse(where, true, &address, err);
    if (st == MK_OK)
        st = look_up(&address, AI_PASSIVE, now_ns() + MK_TCP_CONNECT_S * INT64_C(1000000000), &list,
                     err);
    if (st != MK_OK)
        return st;
    int why = EADDRNOTAVAIL;
    for (a = list; a && *fd < 0; a = a->ai_next)
        why = listen_at(a, fd);
    freeaddrinfo(list);
    if (*fd < 0 && why == EADDRINUSE)
        return mk_error_set(err, MK_ERR_BUSY,
                            "another program listens at %s: stop it, or let the system choose a "
                            "port with %s:0",
                            where, strchr(address.host, ':') ? "[...]" : address.host);
    if (*fd < 0)
        return mk_error_errno(err, why, NULL, "cannot listen at %s", where);
    if (getsockname(*fd, (struct sockaddr *)&own, &length) == 0)
        name_of((struct sockaddr *)&own, length, bound, size);
    else
        snprintf(bound, size, "%s", where);
    return MK_OK;
}

static void watch_for_silence(int fd)
{
    const int on = 1, idle = IDLE_S, probe = PROBE_S, probes = PROBES;
    (void)setsockopt(fd, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof on);
    (void)setsockopt(fd, IPPROTO_TCP, TCP_KEEPIDLE, &idle, sizeof idle);
    (void)setsockopt(fd, IPPROTO_TCP, TCP_KEEPINTVL, &probe, sizeof probe);
    (void)setsockopt(fd, IPPROTO_TCP, TCP_KEEPCNT, &probes, sizeof probes);
}

int mk_tcp_accept(int listening, char *peer, size_t size)
{
    struct sockaddr_storage from;
    socklen_t length = sizeof from;
    int fd = accept4(listening, (struct sockaddr *)&from, &length, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (fd < 0)
        return -1;
    send_at_once(fd);
    watch_for_silence(fd);
    name_of((struct sockaddr *)&from, length, peer, size);
    return fd;
}
