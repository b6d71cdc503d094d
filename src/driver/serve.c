#include "driver/serve.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "driver/serial.h"
#include "driver/tcp.h"
#include "driver/wire.h"

#define IDLE_NS 100000000 /* longest sleep: the rig goes on in pieces of it */
#define PRIORITY 70       /* below the loop of a host on the same machine, which waits for it */
#define READS 16          /* at most before others have their turn: a client may never stop */
#define LOOK_NS 20000000  /* between two looks whether a pseudo-terminal has been opened */

struct mk_server {
    struct mk_serve_config config;
    struct mk_model model;
    struct mk_step_clock clock;
    struct mk_emulated board;
    char device[80];
    int listening; /* TCP; -1 else */
    int terminal;  /* the pseudo-terminal's master; -1 else */

    int client; /* descriptor; -1: nobody */
    char peer[80];
    int served;                    /* clients that have gone */
    uint32_t exchanges;            /* before this client */
    uint16_t fault;                /* told last */
    bool stepped;                  /* told that this client steps the clock */
    uint8_t out[8 * MK_FRAME_MAX]; /* to the client, whole frames but for the first */
    size_t out_size;
};

static void say(const struct mk_server *s, const char *fmt, ...) MK_PRINTF(2, 3);
static void say(const struct mk_server *s, const char *fmt, ...)
{
    char line[256];
    va_list args;
    if (!s->config.say)
        return;
    va_start(args, fmt);
    vsnprintf(line, sizeof line, fmt, args);
    va_end(args);
    s->config.say(s->config.user, line);
}

/* A board answers at once; so does this one where the system grants it. A client that steps the
 * clock waits for whatever the simulation takes, and there it must not keep others off. */
static void hurry(bool urgent)
{
    const struct sched_param p = {.sched_priority = urgent ? PRIORITY : 0};
    (void)pthread_setschedparam(pthread_self(), urgent ? SCHED_FIFO : SCHED_OTHER, &p);
}

/* --- clients -----------------------------------------------------------------------------------
 */

static void welcome(struct mk_server *s, int fd, const char *peer)
{
    s->client = fd;
    s->out_size = 0;
    s->exchanges = s->board.device.exchanges;
    snprintf(s->peer, sizeof s->peer, "%s", peer);
    say(s, "client %s", s->peer);
}

/* The plug is out: the motor goes off at once, though the watchdog would see to it. */
static void part(struct mk_server *s)
{
    (void)mk_emulated_run(&s->board);
    double before = s->board.u;
    mk_device_hang_up(&s->board.device);
    if (s->client != s->terminal)
        close(s->client);
    s->client = -1;
    s->board.sent_size = s->out_size = 0;
    s->served++;
    say(s, "client %s left after %u exchanges: command %g, was %g", s->peer,
        s->board.device.exchanges - s->exchanges, s->board.u, before);
}

/* Somebody else has the board. */
static void turn_away(struct mk_server *s, int fd, const char *peer)
{
    close(fd);
    say(s, "client %s turned away: %s has the board", peer, s->peer);
}

static void accept_clients(struct mk_server *s)
{
    char peer[80];
    int fd;
    while ((fd = mk_tcp_accept(s->listening, peer, sizeof peer)) >= 0) {
        if (s->client >= 0)
            turn_away(s, fd, peer);
        else
            welcome(s, fd, peer);
    }
}

/* A pseudo-terminal tells that nobody has its other end open. */
static void look_at_terminal(struct mk_server *s)
{
    struct pollfd p = {.fd = s->terminal, .events = POLLIN};
    if (s->client < 0 && poll(&p, 1, 0) >= 0 && !(p.revents & POLLHUP))
        welcome(s, s->terminal, s->device);
}

/* --- bytes -------------------------------------------------------------------------------------
 */

/* What the client does not take in time is lost whole frames at a time: the board's own buffer
 * drops what does not fit. */
static void send_out(struct mk_server *s)
{
    for (;;) {
        s->out_size +=
            mk_emulated_take(&s->board, s->out + s->out_size, sizeof s->out - s->out_size);
        if (s->out_size == 0 || s->client < 0)
            return;
        ssize_t k = s->client == s->terminal ? write(s->client, s->out, s->out_size)
                                             : send(s->client, s->out, s->out_size, MSG_NOSIGNAL);
        if (k <= 0)
            return; /* full for now, or gone, which reading finds out */
        memmove(s->out, s->out + k, s->out_size - (size_t)k);
        s->out_size -= (size_t)k;
    }
}

/* False: the client is gone. */
static bool take_in(struct mk_server *s)
{
    uint8_t bytes[4 * MK_FRAME_MAX];
    ssize_t k = 1;
    for (int i = 0; i < READS && (k = read(s->client, bytes, sizeof bytes)) > 0; i++) {
        if (mk_emulated_receive(&s->board, bytes, (size_t)k) != MK_OK)
            return true; /* the simulation has failed: seen to by whoever calls */
        send_out(s);
    }
    return k > 0 || (k < 0 && (errno == EAGAIN || errno == EINTR));
}

/* --- the board ---------------------------------------------------------------------------------
 */

static void tell_news(struct mk_server *s)
{
    const struct mk_device *d = &s->board.device;
    if (d->fault != s->fault && d->fault != MK_WIRE_FAULT_NONE)
        say(s, "motor off: %s", mk_wire_fault_text(d->fault));
    s->fault = d->fault;
    if (d->stepped && !s->stepped)
        say(s, "client %s steps the clock; the rig begins anew", s->peer);
    if (d->stepped != s->stepped)
        hurry(!d->stepped);
    s->stepped = d->stepped;
}

/* The rig's motion has left what can be simulated. A client is not told numbers that are none. */
static void mend(struct mk_server *s)
{
    say(s, "the simulation has failed: the rig is put back to its start");
    if (s->client >= 0)
        part(s);
    mk_emulated_begin_anew(&s->board);
}

static void live(struct mk_server *s)
{
    bool here = s->client < 0 || take_in(s);
    bool well = mk_emulated_run(&s->board) == MK_OK;
    tell_news(s);
    send_out(s);
    if (!well)
        mend(s);
    else if (!here)
        part(s);
}

/* Until something comes in or falls due. */
static void await(struct mk_server *s)
{
    uint64_t event = mk_device_next_event(&s->board.device);
    int64_t wait_ns = s->terminal >= 0 && s->client < 0 ? LOOK_NS : IDLE_NS;
    struct pollfd p[2] = {{.fd = s->client, .events = POLLIN},
                          {.fd = s->listening, .events = POLLIN}};
    if (s->out_size > 0)
        p[0].events |= POLLOUT;
    if (!s->clock.held && event < INT64_MAX) {
        int64_t left_ns =
            s->board.opened_ns + (int64_t)event - mk_clock_now_ns(&s->clock.clock) + 1;
        wait_ns = left_ns < 0 ? 0 : left_ns < wait_ns ? left_ns : wait_ns;
    }
    const struct timespec wait = {wait_ns / 1000000000, wait_ns % 1000000000};
    (void)ppoll(p, 2, &wait, NULL);
}

enum mk_status mk_serve_run(struct mk_server *s, struct mk_error *err)
{
    (void)err;
    hurry(true);
    while (!(s->config.stop && __atomic_load_n(s->config.stop, __ATOMIC_RELAXED)) &&
           !(s->config.once && s->served > 0)) {
        await(s);
        live(s); /* first: one who comes back has hung up before */
        if (s->listening >= 0)
            accept_clients(s);
        else
            look_at_terminal(s);
    }
    hurry(false);
    return MK_OK;
}

/* --- opening -----------------------------------------------------------------------------------
 */

/* Raw before anybody opens it, so that nothing is echoed; opened and closed once, so that it knows
 * that nobody has it. */
static enum mk_status open_terminal(struct mk_server *s, struct mk_error *err)
{
    struct termios t;
    s->terminal = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (s->terminal < 0 || grantpt(s->terminal) != 0 || unlockpt(s->terminal) != 0 ||
        ptsname_r(s->terminal, s->device, sizeof s->device) != 0)
        return mk_error_errno(err, errno, NULL, "cannot make a pseudo-terminal");
    int other = open(s->device, O_RDWR | O_NOCTTY | O_CLOEXEC);
    bool well = other >= 0 && tcgetattr(other, &t) == 0;
    if (well) {
        mk_serial_make_raw(&t);
        well = tcsetattr(other, TCSANOW, &t) == 0;
    }
    if (!well)
        mk_error_errno(err, errno, s->device, "cannot set up the pseudo-terminal");
    if (other >= 0)
        close(other);
    return well ? MK_OK : err ? err->status : MK_ERR_IO;
}

enum mk_status mk_serve_open(const struct mk_serve_config *config, struct mk_server **out,
                             struct mk_error *err)
{
    struct mk_server *s = calloc(1, sizeof *s);
    *out = NULL;
    if (!s)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for a board");
    s->config = *config;
    s->model = *config->model;
    s->listening = s->terminal = s->client = -1;
    mk_step_clock_init(&s->clock);
    const struct mk_board_config board = {
        .model = &s->model, .clock = &s->clock.clock, .seed = config->seed};
    enum mk_status st = mk_emulated_init(&s->board, &board, "mechkit serve", "", err);
    if (st == MK_OK) {
        mk_emulated_allow_steps(&s->board, &s->clock);
        st = strcmp(config->listen, MK_SERVE_PTY) == 0
                 ? open_terminal(s, err)
                 : mk_tcp_listen(config->listen, &s->listening, s->device, sizeof s->device, err);
    }
    if (st != MK_OK) {
        mk_serve_close(s);
        return st;
    }
    *out = s;
    return MK_OK;
}

const char *mk_serve_board(const struct mk_server *s)
{
    return s->terminal >= 0 ? "serial" : "tcp";
}

const char *mk_serve_device(const struct mk_server *s)
{
    return s->device;
}

struct mk_emulated *mk_serve_emulated(struct mk_server *s)
{
    return &s->board;
}

void mk_serve_close(struct mk_server *s)
{
    if (!s)
        return;
    if (s->client >= 0)
        part(s);
    if (s->listening >= 0)
        close(s->listening);
    if (s->terminal >= 0)
        close(s->terminal);
    if (s->board.rig)
        mk_emulated_free(&s->board);
    free(s);
}
