/* Boards behind TCP connections and serial ports: who is found and who is not, what is said of it,
 * what a line does that is slow, silent, full, cut or closed; and every kind of request with every
 * kind of trouble, with the motor looked at on the far side. */
#include "suites.h"

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "driver/byte_stream.h"
#include "driver/serial.h"
#include "driver/tcp.h"
#include "emu/bench.h"
#include "support/files.h"

static struct mk_error err;
static struct mk_model model;
static struct mk_clock clock_;
static struct emu_bench bench;
static struct mk_board *board;

static void setup(void)
{
    err = (struct mk_error)MK_ERROR_INIT;
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &model);
    mk_clock_init_simulated(&clock_);
    memset(&bench, 0, sizeof bench);
    board = NULL;
}

static void teardown(void)
{
    mk_board_close(board);
    emu_bench_free(&bench);
}

static double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int64_t in_ms(double ms)
{
    return (int64_t)(now_s() * 1e9 + ms * 1e6);
}

static void says(const char *text)
{
    ck_assert_msg(strstr(err.message, text) != NULL, "no '%s' in: %s", text, err.message);
}

static void sit_at(const char *line)
{
    struct mk_board_config config = {.model = &model, .clock = &clock_};
    emu_bench_init(&bench, line, &config);
    config.device = bench.device;
    enum mk_status st = mk_board_open(&bench.ops, &config, &board, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
}

/* What `mechkit` does with --board NAME --device DEVICE, in real time. */
static enum mk_status try_open(const char *name, const char *device)
{
    struct mk_clock real;
    mk_clock_init_monotonic(&real);
    const struct mk_board_config config = {.model = &model, .clock = &real, .device = device};
    return mk_board_open(mk_board_backend_by_name(name), &config, &board, &err);
}

/* --- addresses ------------------------------------------------------------------------------- */

START_TEST(addresses_are_host_and_port)
{
    static const struct {
        const char *text, *host, *port;
    } rows[] = {{"127.0.0.1:7000", "127.0.0.1", "7000"},
                {"lab-pc:1", "lab-pc", "1"},
                {"[::1]:65535", "::1", "65535"},
                {"[fe80::1%eth0]:7000", "fe80::1%eth0", "7000"}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct mk_tcp_address a;
        ck_assert_int_eq(mk_tcp_parse(rows[i].text, false, &a, &err), MK_OK);
        ck_assert_str_eq(a.host, rows[i].host);
        ck_assert_str_eq(a.port, rows[i].port);
    }
}
END_TEST

START_TEST(what_is_no_address_is_told_with_what_would_be_one)
{
    static const struct {
        const char *text, *why;
    } rows[] = {{"lab-pc", "no port"},     {"lab-pc:", "a port is"},   {":7000", "no host"},
                {"lab-pc:http", "a port"}, {"lab-pc:0", "a port is"},  {"lab-pc:65536", "a port"},
                {"::1:7000", "brackets"},  {"[::1]7000", "after ["},   {"[::1", "after ["},
                {"[]:7000", "no host"},    {"lab-pc:+7000", "a port"}, {"", "no port"}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        ck_assert_msg(try_open("tcp", rows[i].text) == MK_ERR_USAGE, "%s", rows[i].text);
        says(rows[i].why);
        says("[::1]:7000");
    }
    ck_assert_int_eq(try_open("tcp", NULL), MK_ERR_USAGE);
    says("--device HOST:PORT");
}
END_TEST

/* --- names ----------------------------------------------------------------------------------- */

/* Stands before libc's: a resolver whose servers do not answer. */
static atomic_int resolver_takes_s;

__attribute__((visibility("default"))) int
getaddrinfo(const char *host, const char *port, const struct addrinfo *hints, struct addrinfo **out)
{
    int (*next)(const char *, const char *, const struct addrinfo *, struct addrinfo **) =
        (__typeof__(next))dlsym(RTLD_NEXT, "getaddrinfo");
    if (!(hints && hints->ai_flags & AI_NUMERICHOST))
        sleep((unsigned)atomic_load(&resolver_takes_s));
    return next(host, port, hints, out);
}

START_TEST(a_resolver_that_does_not_answer_is_given_up_in_time)
{
    char bound[80], device_[96];
    atomic_store(&resolver_takes_s, MK_TCP_CONNECT_S + 2);
    double start = now_s();
    ck_assert_int_eq(try_open("tcp", "localhost:7000"), MK_ERR_TIMEOUT);
    ck_assert_double_le(now_s() - start, MK_TCP_CONNECT_S + 1.0);
    says("no address of host 'localhost'");
    start = now_s();
    ck_assert_int_eq(try_open("tcp", "127.0.0.1:1"), MK_ERR_NOTFOUND); /* a number asks nobody */
    ck_assert_double_le(now_s() - start, 1.0);
    sleep(3); /* it answers at last, to nobody */
    atomic_store(&resolver_takes_s, 0);
    int listening, fd;
    ck_assert_int_eq(mk_tcp_listen("localhost:0", &listening, bound, sizeof bound, &err), MK_OK);
    snprintf(device_, sizeof device_, "localhost%s", strrchr(bound, ':'));
    ck_assert_int_eq(mk_tcp_connect(device_, &fd, &err), MK_OK);
    close(fd);
    close(listening);
}
END_TEST

/* --- connections ----------------------------------------------------------------------------- */

static int listen_at(const char *where, char *bound, size_t size)
{
    int fd;
    enum mk_status st = mk_tcp_listen(where, &fd, bound, size, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    return fd;
}

START_TEST(connections_go_to_names_and_to_both_kinds_of_addresses)
{
    static const char *const wheres[] = {"127.0.0.1:0", "[::1]:0", "localhost:0"};
    char bound[80], device[96], peer[80];
    for (size_t i = 0; i < sizeof wheres / sizeof wheres[0]; i++) {
        int listening, fd;
        if (mk_tcp_listen(wheres[i], &listening, bound, sizeof bound, &err) != MK_OK) {
            fprintf(stderr, "streams: %s skipped: %s\n", wheres[i], err.message);
            continue; /* a machine without IPv6 */
        }
        snprintf(device, sizeof device, "%s", bound);
        if (strncmp(wheres[i], "localhost", 9) == 0)
            snprintf(device, sizeof device, "localhost%s", strrchr(bound, ':'));
        ck_assert_msg(mk_tcp_connect(device, &fd, &err) == MK_OK, "%s", err.message);
        int on = 0;
        socklen_t size = sizeof on;
        ck_assert_int_eq(getsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, &size), 0);
        ck_assert_int_ne(on, 0);
        ck_assert_int_ne(fcntl(fd, F_GETFL) & O_NONBLOCK, 0);
        int far = mk_tcp_accept(listening, peer, sizeof peer);
        ck_assert_int_ge(far, 0);
        ck_assert_int_eq(getsockopt(far, IPPROTO_TCP, TCP_NODELAY, &on, &size), 0);
        ck_assert_int_ne(on, 0);
        ck_assert_ptr_nonnull(strrchr(peer, ':'));
        close(far);
        close(fd);
        close(listening);
    }
}
END_TEST

START_TEST(where_nobody_listens_is_told)
{
    char bound[80];
    close(listen_at("127.0.0.1:0", bound, sizeof bound));
    ck_assert_int_eq(try_open("tcp", bound), MK_ERR_NOTFOUND);
    says(bound);
    says("nobody listens");
    ck_assert_int_eq(try_open("tcp", "no-such-host.invalid:7000"), MK_ERR_NOTFOUND);
    says("no-such-host.invalid");
}
END_TEST

/* A queue that is full takes no connection, and says nothing. */
START_TEST(a_connection_that_does_not_come_about_is_given_up_in_time)
{
    struct sockaddr_in a = {.sin_family = AF_INET, .sin_addr = {htonl(INADDR_LOOPBACK)}};
    socklen_t size = sizeof a;
    int listening = socket(AF_INET, SOCK_STREAM, 0);
    char device[40];
    ck_assert_int_eq(bind(listening, (struct sockaddr *)&a, sizeof a), 0);
    ck_assert_int_eq(listen(listening, 0), 0);
    ck_assert_int_eq(getsockname(listening, (struct sockaddr *)&a, &size), 0);
    for (int i = 0; i < 4; i++)
        (void)connect(socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK, 0), (struct sockaddr *)&a,
                      sizeof a);
    snprintf(device, sizeof device, "127.0.0.1:%d", ntohs(a.sin_port));
    double start = now_s();
    ck_assert_int_eq(try_open("tcp", device), MK_ERR_TIMEOUT);
    says("no connection to");
    ck_assert_double_le(now_s() - start, MK_TCP_CONNECT_S + 1.0);
}
END_TEST

START_TEST(a_taken_port_is_told)
{
    char bound[80], other[80];
    int first = listen_at("127.0.0.1:0", bound, sizeof bound), second;
    ck_assert_int_eq(mk_tcp_listen(bound, &second, other, sizeof other, &err), MK_ERR_BUSY);
    says("another program");
    close(first);
}
END_TEST

/* --- peers that are no boards ---------------------------------------------------------------- */

START_TEST(a_peer_that_says_nothing_is_no_board)
{
    char bound[80];
    int listening = listen_at("127.0.0.1:0", bound, sizeof bound);
    double start = now_s();
    ck_assert_int_eq(try_open("tcp", bound), MK_ERR_TIMEOUT);
    says("no answer to 'hello'");
    /* It has 3 s to boot; a busy machine is given as long again. */
    ck_assert_double_le(now_s() - start, 6.0);
    close(listening);
}
END_TEST

/* Takes one connection in a process of its own and answers it with `text`, then closes. */
static pid_t talk(int listening, const char *text, size_t n, int times)
{
    pid_t pid = fork();
    if (pid != 0)
        return pid;
    char peer[80], heard[64];
    int fd;
    while ((fd = mk_tcp_accept(listening, peer, sizeof peer)) < 0)
        usleep(500);
    fcntl(fd, F_SETFL, 0);
    if (n > 0 && read(fd, heard, sizeof heard) < 0)
        _exit(1);
    for (int i = 0; i < times && send(fd, text, n, MSG_NOSIGNAL) > 0; i++)
        continue;
    close(fd);
    _exit(0);
}

START_TEST(a_peer_that_closes_at_once_is_told_and_no_signal_comes)
{
    char bound[80];
    int listening = listen_at("127.0.0.1:0", bound, sizeof bound);
    signal(SIGPIPE, SIG_DFL); /* as in a program that has not thought of it */
    pid_t pid = talk(listening, "", 0, 0);
    ck_assert_int_eq(try_open("tcp", bound), MK_ERR_BUSY);
    says("closed the connection");
    kill(pid, SIGKILL);
    close(listening);
}
END_TEST

START_TEST(a_peer_that_talks_of_other_things_for_ever_is_no_board)
{
    static char noise[4096];
    char bound[80];
    int listening = listen_at("127.0.0.1:0", bound, sizeof bound);
    for (size_t i = 0; i < sizeof noise; i++)
        noise[i] = (char)(i % 7 ? 'M' : 'K');
    pid_t pid = talk(listening, noise, sizeof noise, 1 << 30);
    double start = now_s();
    enum mk_status st = try_open("tcp", bound);
    ck_assert_msg(st == MK_ERR_TIMEOUT, "%s: %s", mk_status_name(st), err.message);
    ck_assert_double_le(now_s() - start, 5.0);
    kill(pid, SIGKILL);
    close(listening);
}
END_TEST

/* --- the link -------------------------------------------------------------------------------- */

static void no_block(const int fd[2])
{
    fcntl(fd[0], F_SETFL, O_NONBLOCK);
    fcntl(fd[1], F_SETFL, O_NONBLOCK);
}

/* What does not fit is over at its deadline; when the peer reads again, whole frames come through.
 */
START_TEST(a_peer_that_does_not_read_holds_nobody_up)
{
    int fd[2];
    uint8_t frame[MK_FRAME_MAX], payload[MK_FRAME_PAYLOAD_MAX] = {0};
    const struct mk_frame f = {MK_FRAME_VERSION, MK_MSG_LCD, sizeof payload, 7, payload};
    size_t n = mk_frame_encode(&f, frame);
    struct mk_byte_stream s;
    enum mk_status st = MK_OK;
    ck_assert_int_eq(socketpair(AF_UNIX, SOCK_STREAM, 0, fd), 0);
    no_block(fd);
    mk_byte_stream_init(&s, fd[0]);
    for (int i = 0; i < 1000000 && st == MK_OK; i++)
        st = mk_byte_stream_link.send(&s, frame, n, in_ms(5));
    ck_assert_int_eq(st, MK_ERR_TIMEOUT);
    for (int i = 0; i < 20; i++) {
        double start = now_s();
        ck_assert_int_eq(mk_byte_stream_link.send(&s, frame, n, in_ms(5)), MK_ERR_TIMEOUT);
        ck_assert_double_ge(now_s() - start, 0.004);
        ck_assert_double_le(now_s() - start, 0.5);
    }
    static struct mk_decoder d;
    uint8_t bytes[4096];
    uint32_t before = 0;
    ssize_t k;
    for (int round = 0; round < 2; round++) {
        before = d.frames;
        while ((k = read(fd[1], bytes, sizeof bytes)) > 0) {
            const uint8_t *p = bytes;
            size_t left = (size_t)k;
            struct mk_frame got;
            while (mk_decoder_next(&d, &p, &left, &got))
                ck_assert_uint_eq(got.length, sizeof payload);
        }
        if (round == 0)
            for (int i = 0; i < 3; i++)
                ck_assert_int_eq(mk_byte_stream_link.send(&s, frame, n, in_ms(5)), MK_OK);
    }
    ck_assert_uint_ge(d.frames - before, 3);
    close(fd[0]);
    close(fd[1]);
}
END_TEST

/* Stands before libc's: a line that takes so many bytes at a time; 0: as many as there are. */
static atomic_size_t line_takes;

__attribute__((visibility("default"))) ssize_t send(int fd, const void *bytes, size_t n, int flags)
{
    ssize_t (*next)(int, const void *, size_t, int) = (__typeof__(next))dlsym(RTLD_NEXT, "send");
    size_t most = atomic_load(&line_takes);
    return next(fd, bytes, most > 0 && n > most ? most : n, flags);
}

START_TEST(a_request_that_goes_out_in_pieces_arrives_whole)
{
    int fd[2];
    struct mk_byte_stream s;
    uint8_t out[200], in[sizeof out];
    ck_assert_int_eq(socketpair(AF_UNIX, SOCK_STREAM, 0, fd), 0);
    no_block(fd);
    mk_byte_stream_init(&s, fd[0]);
    for (size_t i = 0; i < sizeof out; i++)
        out[i] = (uint8_t)(7 * i + 3);
    atomic_store(&line_takes, 9);
    ck_assert_int_eq(mk_byte_stream_link.send(&s, out, sizeof out, in_ms(5000)), MK_OK);
    atomic_store(&line_takes, 0);
    ck_assert_int_eq(read(fd[1], in, sizeof in), sizeof in);
    ck_assert_mem_eq(in, out, sizeof out);
    ck_assert_int_eq(read(fd[1], in, sizeof in), -1);
    close(fd[0]);
    close(fd[1]);
}
END_TEST

START_TEST(what_was_said_before_the_end_is_still_heard)
{
    int fd[2];
    struct mk_byte_stream s;
    const uint8_t *bytes;
    size_t n;
    signal(SIGPIPE, SIG_DFL);
    ck_assert_int_eq(socketpair(AF_UNIX, SOCK_STREAM, 0, fd), 0);
    no_block(fd);
    mk_byte_stream_init(&s, fd[0]);
    ck_assert_int_eq(write(fd[1], "last words", 10), 10);
    close(fd[1]);
    ck_assert_int_eq(mk_byte_stream_link.receive(&s, &bytes, &n, 0), MK_OK);
    ck_assert_uint_eq(n, 10);
    ck_assert_int_eq(mk_byte_stream_link.receive(&s, &bytes, &n, in_ms(1000)), MK_ERR_NODEV);
    ck_assert_int_eq(mk_byte_stream_link.send(&s, (const uint8_t *)"x", 1, in_ms(1000)),
                     MK_ERR_NODEV);
    close(fd[0]);
}
END_TEST

START_TEST(silence_is_over_at_its_deadline)
{
    int fd[2];
    struct mk_byte_stream s;
    const uint8_t *bytes;
    size_t n;
    ck_assert_int_eq(socketpair(AF_UNIX, SOCK_STREAM, 0, fd), 0);
    no_block(fd);
    mk_byte_stream_init(&s, fd[0]);
    double start = now_s();
    ck_assert_int_eq(mk_byte_stream_link.receive(&s, &bytes, &n, in_ms(3.5)), MK_ERR_TIMEOUT);
    ck_assert_double_ge(now_s() - start, 0.0034);
    ck_assert_double_le(now_s() - start, 0.5);
    ck_assert_int_eq(mk_byte_stream_link.receive(&s, &bytes, &n, 0), MK_ERR_TIMEOUT);
    close(fd[0]);
    close(fd[1]);
}
END_TEST

START_TEST(answers_that_come_a_byte_at_a_time_are_put_together)
{
    struct mk_board_sample s;
    sit_at(_i == 0 ? "tcp" : "serial");
    bench.stream.cut = 1;
    for (int k = 0; k < 20; k++) {
        int tries = 0; /* 44 looks: a busy machine may take too long over them */
        while (mk_board_exchange(board, 0.25 * k, &s) != MK_OK)
            ck_assert_int_lt(++tries, 20);
        ck_assert_double_eq(s.u_applied, 0.25 * k);
    }
}
END_TEST

START_TEST(a_board_that_does_not_say_it_is_simulated_is_not_driven_in_simulated_time)
{
    const char *name = _i == 0 ? "tcp" : "serial";
    struct mk_board_config config = {.model = &model, .clock = &clock_};
    emu_bench_init(&bench, name, &config);
    config.device = bench.device;
    ck_assert_int_eq(mk_board_open(mk_board_backend_by_name(name), &config, &board, &err),
                     MK_ERR_NOTSUP);
    says("does not say that it is simulated");
    says("leave out --fast");
    ck_assert_ptr_null(board);
    ck_assert_double_eq(bench.board.u, 0.0);
}
END_TEST

/* --- serial ports ---------------------------------------------------------------------------- */

START_TEST(a_device_of_another_kind_is_told)
{
    static const struct {
        const char *path, *kind;
    } rows[] = {{"folder", "a folder"},
                {"file", "a plain file"},
                {"pipe", "a pipe"},
                {"/dev/null", "another device"}};
    mkdir(scratch("folder"), 0755);
    scratch_text("file", "text");
    ck_assert_int_eq(mkfifo(scratch("pipe"), 0600), 0);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        const char *path = rows[i].path[0] == '/' ? rows[i].path : scratch(rows[i].path);
        ck_assert_int_eq(try_open("serial", path), MK_ERR_USAGE);
        says(rows[i].kind);
        says("not a serial port");
    }
    ck_assert_int_eq(try_open("serial", scratch("nothing")), MK_ERR_NOTFOUND);
    says("plugged in");
    ck_assert_int_eq(try_open("serial", ""), MK_ERR_USAGE);
    if (mk_serial_find(NULL, 0) > 0)
        return; /* a machine with ports: which of them is the first is none of ours */
    ck_assert_int_eq(try_open("serial", NULL), MK_ERR_NOTFOUND);
    says("/dev/ttyACM*");
}
END_TEST

START_TEST(a_device_of_another_kind_is_not_kept_open)
{
    struct mk_serial s = {.fd = 0};
    int free_before = dup(STDIN_FILENO);
    close(free_before);
    ck_assert_int_eq(mk_serial_open(&s, "/dev/null", &err), MK_ERR_USAGE);
    ck_assert_int_eq(s.fd, -1);
    int free_after = dup(STDIN_FILENO);
    close(free_after);
    ck_assert_int_eq(free_after, free_before);
}
END_TEST

START_TEST(the_terminal_of_the_program_itself_is_not_taken_for_a_board)
{
    struct emu_board none = {0};
    int status;
    emu_stream_init(&bench.stream, EMU_PTY, none);
    pid_t pid = fork();
    if (pid == 0) {
        setsid();
        int own = open(bench.stream.device, O_RDWR);
        bool told = own >= 0 && try_open("serial", bench.stream.device) == MK_ERR_USAGE &&
                    strstr(err.message, "the terminal that this program runs in");
        _exit(told ? 0 : 1);
    }
    ck_assert_int_eq(waitpid(pid, &status, 0), pid);
    ck_assert_int_eq(status, 0);
    emu_stream_free(&bench.stream);
}
END_TEST

/* Opening its port resets it: eight greetings are lost, longer than one request is patient. */
START_TEST(a_board_that_still_boots_is_waited_for)
{
    struct mk_board_config config = {.model = &model, .clock = &clock_};
    emu_bench_init(&bench, "serial", &config);
    config.device = bench.device;
    emu_line_arm(bench.line, EMU_FAULT_LOSE_REQUEST, 0, 8);
    enum mk_status st = mk_board_open(&bench.ops, &config, &board, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    ck_assert_uint_eq(bench.line->injected, 8);
    mk_board_close(board);
    board = NULL;
    emu_line_arm(bench.line, EMU_FAULT_LOSE_REQUEST, 0, 1000);
    double start = now_s();
    ck_assert_int_eq(mk_board_open(&bench.ops, &config, &board, &err), MK_ERR_TIMEOUT);
    says("no answer to 'hello'");
    ck_assert_double_le(now_s() - start, 5.0);
}
END_TEST

START_TEST(a_rate_that_is_none_or_too_slow_is_told)
{
    static const char *const rates[] = {"9600", "115200", "fast", "", "-230400", "99999999999"};
    char device[128];
    sit_at("serial");
    for (size_t i = 0; i < sizeof rates / sizeof rates[0]; i++) {
        struct mk_serial s;
        snprintf(device, sizeof device, "%s,%s", bench.device, rates[i]);
        ck_assert_int_eq(mk_serial_open(&s, device, &err), MK_ERR_USAGE);
        says("230400, 460800");
    }
}
END_TEST

START_TEST(a_port_is_raw_while_it_is_open_and_then_as_it_was)
{
    struct mk_serial s;
    struct termios before, during, after;
    struct emu_board none = {0};
    char device[128];
    emu_stream_init(&bench.stream, EMU_PTY, none);
    snprintf(device, sizeof device, "%s,460800", bench.stream.device);
    int other = open(bench.stream.device, O_RDWR | O_NOCTTY);
    ck_assert_int_eq(tcgetattr(other, &before), 0);
    before.c_lflag |= ICANON | ECHO;
    before.c_oflag |= OPOST;
    before.c_cflag |= CSTOPB;
    ck_assert_int_eq(tcsetattr(other, TCSANOW, &before), 0);
    ck_assert_msg(mk_serial_open(&s, device, &err) == MK_OK, "%s", err.message);
    ck_assert_int_eq(tcgetattr(other, &during), 0);
    ck_assert_uint_eq(during.c_lflag & (ICANON | ECHO | ISIG | IEXTEN), 0);
    ck_assert_uint_eq(during.c_iflag & (IXON | IXOFF | ICRNL | INLCR | ISTRIP | BRKINT), 0);
    ck_assert_uint_eq(during.c_oflag & OPOST, 0);
    ck_assert_uint_eq(during.c_cflag & (CSIZE | CSTOPB | PARENB), CS8);
    ck_assert_uint_eq(cfgetospeed(&during), B460800);
    mk_serial_close(&s);
    ck_assert_int_eq(tcgetattr(other, &after), 0);
    ck_assert_uint_eq(after.c_lflag, before.c_lflag);
    ck_assert_uint_eq(after.c_oflag, before.c_oflag);
    ck_assert_uint_eq(after.c_cflag, before.c_cflag);
    close(other);
    emu_stream_free(&bench.stream);
}
END_TEST

START_TEST(a_port_that_is_in_use_is_told_and_left_alone)
{
    struct mk_board_sample sample;
    sit_at("serial");
    struct mk_board *first = board;
    ck_assert_int_eq(try_open("serial", bench.device), MK_ERR_BUSY);
    says("another program uses");
    board = first;
    ck_assert_int_eq(mk_board_exchange(board, 1.0, &sample), MK_OK);
    ck_assert_double_eq(sample.u_applied, 1.0);
}
END_TEST

START_TEST(ports_are_listed_with_the_name_of_what_is_plugged_in)
{
    struct mk_board_found f[4];
    static const char *const folders[] = {"dev",
                                          "sys",
                                          "sys/ttyACM0",
                                          "sys/ttyACM0/board",
                                          "sys/ttyACM0/board/device",
                                          "sys/ttyUSB3",
                                          "sys/ttyUSB3/adapter",
                                          "sys/ttyUSB3/adapter/if0",
                                          "sys/ttyUSB3/adapter/if0/port"};
    char dev[256], sys[256];
    for (size_t i = 0; i < sizeof folders / sizeof folders[0]; i++)
        mkdir(scratch(folders[i]), 0755);
    scratch_text("dev/ttyACM0", "");
    scratch_text("dev/ttyUSB3", "");
    scratch_text("dev/ttyS0", "");
    scratch_text("sys/ttyACM0/board/product", "Rig controller\033[2J\n");
    scratch_text("sys/ttyUSB3/adapter/product", "FT232R USB UART\n");
    ck_assert_int_eq(symlink("board/device", scratch("sys/ttyACM0/device")), 0);
    ck_assert_int_eq(symlink("adapter/if0/port", scratch("sys/ttyUSB3/device")), 0);
    snprintf(dev, sizeof dev, "%s", scratch("dev"));
    snprintf(sys, sizeof sys, "%s", scratch("sys"));
    ck_assert_int_eq(mk_serial_find_in(dev, sys, f, 4), 2);
    ck_assert_ptr_nonnull(strstr(f[0].device, "/dev/ttyACM0"));
    ck_assert_str_eq(f[0].name, "Rig controller\\x1b[2J");
    ck_assert_str_eq(f[1].name, "FT232R USB UART");
    ck_assert_int_eq(f[0].status, MK_OK);
    ck_assert_int_eq(mk_serial_find_in(dev, sys, f, 1), 2); /* more than there is room for */
    ck_assert_int_eq(mk_serial_find_in("/nowhere", sys, f, 4), 0);
}
END_TEST

/* --- every kind of request, every kind of trouble -------------------------------------------- */

static enum mk_status do_hello(struct mk_wire *w)
{
    return mk_wire_request(w, MK_MSG_HELLO, NULL, 0, 3, 40000000, NULL);
}
static enum mk_status do_zero(struct mk_wire *w)
{
    (void)w;
    return board->ops->zero_counters(board, &err);
}
static enum mk_status do_watchdog(struct mk_wire *w)
{
    (void)w;
    return board->ops->set_watchdog(board, 20, &err);
}
static enum mk_status do_exchange(struct mk_wire *w)
{
    struct mk_board_sample s;
    (void)w;
    return mk_board_exchange(board, 2.0, &s);
}
static enum mk_status do_safe(struct mk_wire *w)
{
    (void)w;
    return board->ops->safe_state(board);
}
static enum mk_status do_clear(struct mk_wire *w)
{
    return mk_wire_clear(w, &err);
}
static enum mk_status do_state(struct mk_wire *w)
{
    struct mk_wire_state s;
    return mk_wire_state(w, &s, &err);
}
static enum mk_status do_lcd(struct mk_wire *w)
{
    return mk_wire_lcd(w, 0, "hello", &err);
}
static enum mk_status do_leds(struct mk_wire *w)
{
    return mk_wire_leds(w, 5, &err);
}
static enum mk_status do_stream(struct mk_wire *w)
{
    (void)w;
    return board->ops->stream(board, 2000, &err);
}
static enum mk_status do_command(struct mk_wire *w)
{
    struct mk_wire_reading r;
    uint32_t number;
    enum mk_status st = mk_wire_answer_sample(w, 0, 2.0);
    return st == MK_OK ? mk_wire_next_sample(w, 20000000, &number, &r) : st;
}
static enum mk_status do_setup(struct mk_wire *w)
{
    int gains;
    return mk_wire_setup(w, MK_CONTROLLER_PI_SPEED, 2000, 1, &gains, &err);
}
static enum mk_status do_gains(struct mk_wire *w)
{
    const float gains[3] = {0.2f, 1.0f, 30.0f};
    return mk_wire_gains(w, 0, gains, 3, &err);
}
static enum mk_status do_start(struct mk_wire *w)
{
    return mk_wire_start(w, &err);
}
static enum mk_status do_halt(struct mk_wire *w)
{
    return mk_wire_halt(w, &err);
}
static enum mk_status do_upload(struct mk_wire *w)
{
    struct mk_standalone_record r[4];
    int got;
    return mk_wire_upload(w, 0, r, 4, &got, &err);
}

/* What has to come before it, none of it in trouble. */
enum before { DRIVEN, STREAMING, SET_UP, STARTED };

static const struct {
    const char *name;
    enum mk_status (*ask)(struct mk_wire *w);
    enum before before;
    bool once; /* tried once: one fault is enough */
} requests[] = {
    {"hello", do_hello, DRIVEN, false},       {"zero", do_zero, DRIVEN, false},
    {"watchdog", do_watchdog, DRIVEN, false}, {"exchange", do_exchange, DRIVEN, true},
    {"safe", do_safe, DRIVEN, false},         {"clear", do_clear, DRIVEN, false},
    {"state", do_state, DRIVEN, false},       {"lcd", do_lcd, DRIVEN, false},
    {"leds", do_leds, DRIVEN, false},         {"stream", do_stream, DRIVEN, false},
    {"command", do_command, STREAMING, true}, {"setup", do_setup, DRIVEN, false},
    {"gains", do_gains, SET_UP, false},       {"start", do_start, SET_UP, false},
    {"halt", do_halt, STARTED, false},        {"upload", do_upload, STARTED, false},
};
#define REQUESTS (sizeof requests / sizeof requests[0])

static const enum emu_fault troubles[] = {
    EMU_FAULT_UNPLUG,       EMU_FAULT_STALL_OUT,    EMU_FAULT_STALL_IN,    EMU_FAULT_SHORT_REQUEST,
    EMU_FAULT_SHORT_ANSWER, EMU_FAULT_FLIP_REQUEST, EMU_FAULT_FLIP_ANSWER, EMU_FAULT_LATE_ANSWER,
    EMU_FAULT_OVERFLOW,     EMU_FAULT_BLOCK_OUT};
#define TROUBLES ((int)(sizeof troubles / sizeof troubles[0]))

static void must(enum mk_status st)
{
    ck_assert_msg(st == MK_OK, "%s: %s", mk_status_name(st), err.message);
}

/* The motor drives, by the host or by the board's own controller. */
static void prepare(struct mk_wire *w, enum before before)
{
    struct mk_board_sample s;
    must(board->ops->set_watchdog(board, 20, &err));
    must(mk_board_exchange(board, 2.0, &s));
    if (before == STREAMING)
        must(board->ops->stream(board, 2000, &err));
    if (before == STREAMING)
        must(mk_board_exchange(board, 2.0, &s));
    if (before >= SET_UP) {
        must(do_setup(w));
        must(do_gains(w));
    }
    if (before == STARTED) {
        must(do_start(w));
        mk_clock_sleep_until(&clock_, mk_clock_now_ns(&clock_) + 10000000);
    }
    ck_assert_int_eq(mk_emulated_run(&bench.board), MK_OK);
    if (before != STREAMING)
        ck_assert_double_ne(bench.board.u, 0.0);
}

/* The host says no more: the far side by itself, as long as the watchdog may take. */
static void the_motor_goes_off(const char *request, enum emu_fault fault)
{
    mk_clock_sleep_until(&clock_, mk_clock_now_ns(&clock_) + 21000000);
    ck_assert_int_eq(mk_emulated_run(&bench.board), MK_OK);
    ck_assert_msg(bench.board.u == 0.0, "%s at '%s': the motor is on", emu_fault_text(fault),
                  request);
}

START_TEST(trouble_at_any_kind_of_request_ends_in_time_with_a_name_and_the_motor_off)
{
    enum emu_fault fault = troubles[_i % TROUBLES];
    const char *line = _i / TROUBLES ? "serial" : "tcp";
    for (size_t k = 0; k < 2 * REQUESTS; k++) {
        size_t r = k / 2;
        bool for_good = k % 2;
        sit_at(line);
        struct mk_wire *w = mk_wire_of(board);
        prepare(w, requests[r].before);
        emu_line_arm(bench.line, fault, 0, for_good ? 1000 : 1);
        double start = now_s();
        enum mk_status st = requests[r].ask(w);
        ck_assert_msg(bench.line->injected > 0, "%s at '%s' was not tried", emu_fault_text(fault),
                      requests[r].name);
        ck_assert_double_le(now_s() - start, 1.0);
        if (fault == EMU_FAULT_UNPLUG)
            ck_assert_msg(st == MK_ERR_NODEV, "unplugged at '%s': %s", requests[r].name,
                          mk_status_name(st));
        else if (!for_good && !requests[r].once)
            ck_assert_msg(st == MK_OK, "once %s at '%s': %s", emu_fault_text(fault),
                          requests[r].name, mk_status_name(st));
        if (fault == EMU_FAULT_UNPLUG) /* and what comes after it */
            ck_assert_int_eq(do_safe(w), MK_ERR_NODEV);
        the_motor_goes_off(requests[r].name, fault);
        teardown();
        setup();
    }
}
END_TEST

/* --- a clock that is stepped ------------------------------------------------------------------ */

static void sit_at_stepped(void)
{
    struct mk_board_config config = {.model = &model, .clock = &clock_};
    emu_bench_init(&bench, "tcp-stepped", &config);
    config.device = bench.device;
    enum mk_status st = mk_board_open(&bench.ops, &config, &board, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
}

static void pass_ms(int ms)
{
    mk_clock_sleep_until(&clock_, mk_clock_now_ns(&clock_) + ms * INT64_C(1000000));
}

START_TEST(trouble_with_a_step_costs_one_sample_and_the_clocks_stay_together)
{
    static const enum emu_fault once[] = {EMU_FAULT_LOSE_REQUEST, EMU_FAULT_LOSE_ANSWER,
                                          EMU_FAULT_FLIP_REQUEST, EMU_FAULT_SHORT_ANSWER,
                                          EMU_FAULT_TWICE_REQUEST};
    struct mk_board_sample first, s;
    sit_at_stepped();
    must(board->ops->set_watchdog(board, 20, &err));
    must(mk_board_exchange(board, 1.0, &first));
    int64_t start_ns = mk_clock_now_ns(&clock_);
    emu_line_arm(bench.line, once[_i], 1, 1);
    for (int k = 1, lost = 0; k <= 8; k++) {
        pass_ms(2);
        enum mk_status st = mk_board_exchange(board, 1.0, &s);
        lost += st != MK_OK;
        ck_assert_int_le(lost, once[_i] != EMU_FAULT_TWICE_REQUEST);
        if (st == MK_OK)
            ck_assert_int_eq(s.board_ns - first.board_ns, mk_clock_now_ns(&clock_) - start_ns);
    }
    ck_assert_uint_eq(bench.line->injected, 1);
    ck_assert_double_eq(bench.board.u, 1.0);
}
END_TEST

/* Time stands for the board as long as nobody steps it; that the line has closed it sees all the
 * same (test_serve), and the host that comes next finds the motor off. */
START_TEST(a_stepped_board_that_is_unplugged_is_gone_at_any_kind_of_request)
{
    for (size_t r = 0; r < REQUESTS; r++) {
        if (requests[r].before == STREAMING || requests[r].ask == do_hello)
            continue;
        sit_at_stepped();
        struct mk_wire *w = mk_wire_of(board);
        struct mk_board_sample s;
        must(board->ops->set_watchdog(board, 20, &err));
        must(mk_board_exchange(board, 2.0, &s));
        pass_ms(2);
        emu_line_arm(bench.line, EMU_FAULT_UNPLUG, 0, 1);
        ck_assert_msg(requests[r].ask(w) == MK_ERR_NODEV, "%s", requests[r].name);
        ck_assert_int_eq(do_safe(w), MK_ERR_NODEV);
        mk_board_close(board);
        board = NULL;
        emu_bench_plug(&bench);
        struct mk_board_config config = {.model = &model, .clock = &clock_, .device = bench.device};
        must(mk_board_open(&bench.ops, &config, &board, &err));
        ck_assert_double_eq(bench.board.u, 0.0);
        teardown();
        setup();
    }
}
END_TEST

/* A board that forgot its host refuses exchanges, as after a restart; one that lies goes on
 * driving. The line is there, so SAFE goes out. */
START_TEST(a_board_that_refuses_every_exchange_is_told_to_take_the_motor_off)
{
    struct mk_board_sample s;
    sit_at("tcp");
    must(board->ops->set_watchdog(board, 0, &err));
    must(mk_board_exchange(board, 2.0, &s));
    mk_wire_of(board)->gone = true; /* what such a refusal is taken for */
    board->gone = true;
    ck_assert_int_eq(mk_board_exchange(board, 2.0, &s), MK_ERR_NODEV);
    ck_assert_double_eq(bench.board.u, 2.0);
    must(do_safe(mk_wire_of(board)));
    ck_assert_double_eq(bench.board.u, 0.0);
}
END_TEST

/* A second for an exchange, and nothing for SAFE behind one that was waited for in vain. */
START_TEST(a_stepped_board_that_falls_silent_is_not_waited_for_again)
{
    struct mk_board_sample s;
    sit_at_stepped();
    must(board->ops->set_watchdog(board, 20, &err));
    must(mk_board_exchange(board, 2.0, &s));
    emu_line_arm(bench.line, EMU_FAULT_LOSE_ANSWER, 0, 1000);
    pass_ms(2);
    ck_assert_int_eq(mk_board_exchange(board, 2.0, &s), MK_ERR_TIMEOUT);
    double start = now_s();
    ck_assert_int_eq(do_safe(mk_wire_of(board)), MK_ERR_TIMEOUT);
    ck_assert_double_le(now_s() - start, 0.5);
    ck_assert_double_eq(bench.board.u, 0.0);
}
END_TEST

START_TEST(a_long_wait_is_stepped_in_pieces_and_its_watchdog_fires_in_time)
{
    struct mk_board_sample s;
    sit_at_stepped();
    must(board->ops->set_watchdog(board, 20, &err));
    must(mk_board_exchange(board, 2.0, &s));
    int64_t fed_ns = s.board_ns;
    pass_ms(60000);
    must(mk_board_exchange(board, 2.0, &s));
    ck_assert_uint_ne(s.status & MK_BOARD_ST_WATCHDOG, 0);
    ck_assert_double_eq(s.u_applied, 0.0);
    ck_assert_int_eq(s.board_ns - fed_ns, 60000 * INT64_C(1000000));
    ck_assert_int_eq((int64_t)bench.board.device.fault_ns - fed_ns, 20 * INT64_C(1000000) + 1);
}
END_TEST

Suite *suite_streams(void)
{
    Suite *s = suite_create("streams");
    TCase *t = tcase_create("streams");
    tcase_add_checked_fixture(t, setup, teardown);
    tcase_set_timeout(t, 60);
    tcase_add_test(t, addresses_are_host_and_port);
    tcase_add_test(t, what_is_no_address_is_told_with_what_would_be_one);
    tcase_add_test(t, a_resolver_that_does_not_answer_is_given_up_in_time);
    tcase_add_test(t, connections_go_to_names_and_to_both_kinds_of_addresses);
    tcase_add_test(t, where_nobody_listens_is_told);
    tcase_add_test(t, a_connection_that_does_not_come_about_is_given_up_in_time);
    tcase_add_test(t, a_taken_port_is_told);
    tcase_add_test(t, a_peer_that_says_nothing_is_no_board);
    tcase_add_test(t, a_peer_that_closes_at_once_is_told_and_no_signal_comes);
    tcase_add_test(t, a_peer_that_talks_of_other_things_for_ever_is_no_board);
    tcase_add_test(t, a_peer_that_does_not_read_holds_nobody_up);
    tcase_add_test(t, a_request_that_goes_out_in_pieces_arrives_whole);
    tcase_add_test(t, what_was_said_before_the_end_is_still_heard);
    tcase_add_test(t, silence_is_over_at_its_deadline);
    tcase_add_loop_test(t, answers_that_come_a_byte_at_a_time_are_put_together, 0, 2);
    tcase_add_loop_test(
        t, a_board_that_does_not_say_it_is_simulated_is_not_driven_in_simulated_time, 0, 2);
    tcase_add_test(t, a_device_of_another_kind_is_told);
    tcase_add_test(t, a_device_of_another_kind_is_not_kept_open);
    tcase_add_test(t, the_terminal_of_the_program_itself_is_not_taken_for_a_board);
    tcase_add_test(t, a_board_that_still_boots_is_waited_for);
    tcase_add_test(t, a_rate_that_is_none_or_too_slow_is_told);
    tcase_add_test(t, a_port_is_raw_while_it_is_open_and_then_as_it_was);
    tcase_add_test(t, a_port_that_is_in_use_is_told_and_left_alone);
    tcase_add_test(t, ports_are_listed_with_the_name_of_what_is_plugged_in);
    tcase_add_loop_test(t,
                        trouble_at_any_kind_of_request_ends_in_time_with_a_name_and_the_motor_off,
                        0, 2 * TROUBLES);
    tcase_add_loop_test(t, trouble_with_a_step_costs_one_sample_and_the_clocks_stay_together, 0, 5);
    tcase_add_test(t, a_stepped_board_that_is_unplugged_is_gone_at_any_kind_of_request);
    tcase_add_test(t, a_board_that_refuses_every_exchange_is_told_to_take_the_motor_off);
    tcase_add_test(t, a_stepped_board_that_falls_silent_is_not_waited_for_again);
    tcase_add_test(t, a_long_wait_is_stepped_in_pieces_and_its_watchdog_fires_in_time);
    suite_add_tcase(s, t);
    return s;
}
