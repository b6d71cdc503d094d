/* Boards behind TCP: what an address is, who is found under it in time and who is not, and what is
 * said of a peer that is no board. The names go through a resolver of the test's own (getaddrinfo
 * below stands before libc's); the connections are the kernel's. */
#include "suites.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "driver/resolve.h"
#include "driver/tcp.h"
#include "support/files.h"
#include "support/remote.h"
#include "support/wall.h"

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
        ck_assert_int_eq(mk_tcp_parse(rows[i].text, false, &a, &remote.err), MK_OK);
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
        ck_assert_msg(remote_try_open("tcp", rows[i].text) == MK_ERR_USAGE, "%s", rows[i].text);
        remote_says(rows[i].why);
        remote_says("[::1]:7000");
    }
    ck_assert_int_eq(remote_try_open("tcp", "lab\033[2J-pc"), MK_ERR_USAGE);
    remote_says("'lab\\x1b[2J-pc': there is no port");
    ck_assert_int_eq(remote_try_open("tcp", NULL), MK_ERR_USAGE);
    remote_says("--device HOST:PORT");
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
    const bool number = hints && hints->ai_flags & AI_NUMERICHOST;
    if (!number)
        sleep((unsigned)atomic_load(&resolver_takes_s));
    if (!number && host &&
        strcmp(host, "localhost") == 0) /* without a file of hosts it is unknown */
        host = "127.0.0.1";
    return next(host, port, hints, out);
}

START_TEST(a_resolver_that_does_not_answer_is_given_up_in_time)
{
    char bound[80], device_[96];
    atomic_store(&resolver_takes_s, MK_TCP_CONNECT_S + 2);
    double start = wall_s();
    ck_assert_int_eq(remote_try_open("tcp", "localhost:7000"), MK_ERR_TIMEOUT);
    ck_assert_double_le(wall_s() - start, MK_TCP_CONNECT_S + 1.0);
    remote_says("no address of host 'localhost'");
    start = wall_s();
    ck_assert_int_eq(remote_try_open("tcp", "127.0.0.1:1"),
                     MK_ERR_NOTFOUND); /* a number asks nobody */
    ck_assert_double_le(wall_s() - start, 1.0);
    sleep(3); /* it answers at last, to nobody */
    atomic_store(&resolver_takes_s, 0);
    int listening, fd;
    ck_assert_int_eq(mk_tcp_listen("localhost:0", &listening, bound, sizeof bound, &remote.err),
                     MK_OK);
    snprintf(device_, sizeof device_, "localhost%s", strrchr(bound, ':'));
    ck_assert_int_eq(mk_tcp_connect(device_, &fd, &remote.err), MK_OK);
    close(fd);
    close(listening);
}
END_TEST

START_TEST(what_is_longer_than_any_name_or_port_is_not_asked_for)
{
    struct addrinfo *list = NULL;
    char name[300] = "";
    memset(name, 'a', 256);
    ck_assert_int_eq(mk_resolve(name, "7000", 0, INT64_MAX, &list), EAI_MEMORY);
    memset(name, 'a', sizeof name - 1);
    ck_assert_int_eq(mk_resolve(name, "7000", 0, INT64_MAX, &list), EAI_MEMORY);
    ck_assert_int_eq(mk_resolve("localhost", "00007000", 0, INT64_MAX, &list), EAI_MEMORY);
    ck_assert_int_eq(mk_resolve("localhost", "0000000000007000", 0, INT64_MAX, &list), EAI_MEMORY);
    ck_assert_ptr_null(list);
}
END_TEST

/* --- connections ----------------------------------------------------------------------------- */

static int listen_at(const char *where, char *bound, size_t size)
{
    int fd;
    enum mk_status st = mk_tcp_listen(where, &fd, bound, size, &remote.err);
    ck_assert_msg(st == MK_OK, "%s", remote.err.message);
    return fd;
}

START_TEST(connections_go_to_names_and_to_both_kinds_of_addresses)
{
    static const char *const wheres[] = {"127.0.0.1:0", "[::1]:0", "localhost:0"};
    char bound[80], device[96], peer[80];
    for (size_t i = 0; i < sizeof wheres / sizeof wheres[0]; i++) {
        int listening, fd;
        if (mk_tcp_listen(wheres[i], &listening, bound, sizeof bound, &remote.err) != MK_OK) {
            fprintf(stderr, "streams: %s skipped: %s\n", wheres[i], remote.err.message);
            continue; /* a machine without IPv6 */
        }
        snprintf(device, sizeof device, "%s", bound);
        if (strncmp(wheres[i], "localhost", 9) == 0)
            snprintf(device, sizeof device, "localhost%s", strrchr(bound, ':'));
        ck_assert_msg(mk_tcp_connect(device, &fd, &remote.err) == MK_OK, "%s", remote.err.message);
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

/* Nothing comes from a machine that was switched off, not even that it has gone. */
START_TEST(a_client_whose_machine_is_gone_is_found_out_within_half_a_minute)
{
    static const int options[] = {TCP_KEEPIDLE, TCP_KEEPINTVL, TCP_KEEPCNT};
    char bound[80], peer[80];
    int listening = listen_at("127.0.0.1:0", bound, sizeof bound), fd, value[3], on = 0;
    ck_assert_int_eq(mk_tcp_connect(bound, &fd, &remote.err), MK_OK);
    int far = mk_tcp_accept(listening, peer, sizeof peer);
    socklen_t size = sizeof on;
    ck_assert_int_eq(getsockopt(far, SOL_SOCKET, SO_KEEPALIVE, &on, &size), 0);
    ck_assert_int_ne(on, 0);
    for (int i = 0; i < 3; i++)
        ck_assert_int_eq(getsockopt(far, IPPROTO_TCP, options[i], &value[i], &size), 0);
    ck_assert_int_le(value[0] + value[1] * value[2], 30);
    close(far);
    close(fd);
    close(listening);
}
END_TEST

START_TEST(a_board_that_is_closed_has_no_connection_left)
{
    remote_sit_at("tcp");
    const int open = open_files();
    remote_close();
    ck_assert_int_lt(open_files(), open);
}
END_TEST

START_TEST(where_nobody_listens_is_told)
{
    char bound[80];
    close(listen_at("127.0.0.1:0", bound, sizeof bound));
    ck_assert_int_eq(remote_try_open("tcp", bound), MK_ERR_NOTFOUND);
    remote_says(bound);
    remote_says("nobody listens");
    ck_assert_int_eq(remote_try_open("tcp", "no-such-host.invalid:7000"), MK_ERR_NOTFOUND);
    remote_says("no-such-host.invalid");
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
    double start = wall_s();
    ck_assert_int_eq(remote_try_open("tcp", device), MK_ERR_TIMEOUT);
    remote_says("no connection to");
    ck_assert_double_le(wall_s() - start, MK_TCP_CONNECT_S + 1.0);
}
END_TEST

/* An address of the documentation's, which no machine has. */
START_TEST(an_address_that_is_somebody_else_s_is_not_listened_at)
{
    char bound[80];
    int fd;
    enum mk_status st = mk_tcp_listen("192.0.2.1:7000", &fd, bound, sizeof bound, &remote.err);
    ck_assert(st != MK_OK && st != MK_ERR_BUSY);
    ck_assert_int_eq(fd, -1);
    remote_says("cannot listen at 192.0.2.1:7000");
}
END_TEST

START_TEST(a_taken_port_is_told)
{
    char bound[80], other[80];
    int first = listen_at("127.0.0.1:0", bound, sizeof bound), second;
    ck_assert_int_eq(mk_tcp_listen(bound, &second, other, sizeof other, &remote.err), MK_ERR_BUSY);
    remote_says("another program");
    close(first);
}
END_TEST

/* --- peers that are no boards ---------------------------------------------------------------- */

START_TEST(a_peer_that_says_nothing_is_no_board)
{
    char bound[80];
    int listening = listen_at("127.0.0.1:0", bound, sizeof bound);
    double start = wall_s();
    ck_assert_int_eq(remote_try_open("tcp", bound), MK_ERR_TIMEOUT);
    remote_says("no answer to 'hello'");
    /* It has 3 s to boot; a busy machine is given as long again. */
    ck_assert_double_le(wall_s() - start, 6.0);
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
    ck_assert_int_eq(remote_try_open("tcp", bound), MK_ERR_BUSY);
    remote_says("closed the connection");
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
    double start = wall_s();
    enum mk_status st = remote_try_open("tcp", bound);
    ck_assert_msg(st == MK_ERR_TIMEOUT, "%s: %s", mk_status_name(st), remote.err.message);
    ck_assert_double_le(wall_s() - start, 5.0);
    kill(pid, SIGKILL);
    close(listening);
}
END_TEST

Suite *suite_tcp(void)
{
    Suite *s = suite_create("tcp");
    TCase *t = tcase_create("tcp");
    tcase_add_checked_fixture(t, remote_setup, remote_teardown);
    tcase_set_timeout(t, 60);
    tcase_add_test(t, addresses_are_host_and_port);
    tcase_add_test(t, what_is_no_address_is_told_with_what_would_be_one);
    tcase_add_test(t, a_resolver_that_does_not_answer_is_given_up_in_time);
    tcase_add_test(t, what_is_longer_than_any_name_or_port_is_not_asked_for);
    tcase_add_test(t, connections_go_to_names_and_to_both_kinds_of_addresses);
    tcase_add_test(t, a_client_whose_machine_is_gone_is_found_out_within_half_a_minute);
    tcase_add_test(t, a_board_that_is_closed_has_no_connection_left);
    tcase_add_test(t, where_nobody_listens_is_told);
    tcase_add_test(t, a_connection_that_does_not_come_about_is_given_up_in_time);
    tcase_add_test(t, an_address_that_is_somebody_else_s_is_not_listened_at);
    tcase_add_test(t, a_taken_port_is_told);
    tcase_add_test(t, a_peer_that_says_nothing_is_no_board);
    tcase_add_test(t, a_peer_that_closes_at_once_is_told_and_no_signal_comes);
    tcase_add_test(t, a_peer_that_talks_of_other_things_for_ever_is_no_board);
    suite_add_tcase(s, t);
    return s;
}
