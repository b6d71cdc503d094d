/* What ends a run for good, in real time: the cable is pulled in mid run and put back, through the
 * session that command files and the screen use, without restarting anything; the host is killed in
 * mid swing-up. */
#include "suites.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "console/script/session.h"
#include "driver/tcp.h"
#include "emu/bench.h"
#include "support/files.h"

#define RATE_HZ 200.0
#define SHOWN_S 0.05
#define TRIES 8 /* a busy machine may lose the run to its own stalls */

static struct mk_model model;
static struct mk_clock clock_;
static struct emu_bench bench;
static struct session session;
static struct mk_error err;

/* A parallel port does not tell that nobody is plugged in any more: exchanges fail. */
static const struct {
    const char *bus;
    enum mk_fault fault;
} rows[] = {{"usb", MK_FAULT_UNPLUGGED},
            {"parport", MK_FAULT_LINK},
            {"tcp", MK_FAULT_UNPLUGGED},
            {"serial", MK_FAULT_UNPLUGGED}};
#define ROWS ((int)(sizeof rows / sizeof rows[0]))

static void open_session(const char *bus)
{
    mk_model_default(MK_PLANT_PENDUBOT, &model);
    mk_clock_init_monotonic(&clock_);
    const struct mk_board_config config = {.model = &model, .clock = &clock_};
    emu_bench_init(&bench, bus, &config);
    const struct session_options options = {.board = bus,
                                            .device = bench.device,
                                            .out = scratch("runs"),
                                            .rate_hz = RATE_HZ,
                                            .seed = 1};
    err = (struct mk_error)MK_ERROR_INIT;
    ck_assert_msg(session_open(&session, &options, &err) == MK_OK, "%s", err.message);
}

static void teardown(void)
{
    session_close(&session);
    emu_bench_free(&bench);
}

static enum mk_fault fault_now(void)
{
    struct mk_loop_snapshot s;
    mk_loop_get_snapshot(session.loop, &s);
    return s.fault;
}

/* Sets up, starts, lets it swing. False: the machine was too busy; the links then come to rest. */
static bool get_going(void)
{
    ck_assert_msg(session_setup(&session, "pendubot-mid", &err) == MK_OK, "%s", err.message);
    bool well = session_start(&session, &err) == MK_OK;
    if (well) {
        usleep(300000);
        well = fault_now() == MK_FAULT_NONE;
    }
    if (!well)
        usleep(700000);
    return well;
}

/* Between the last reading and the fault, by the log; NAN: the machine itself stood still. */
static double time_to_fault(const struct mk_log *log)
{
    const double *t = mk_log_get(log, "t"), *flags = mk_log_get(log, "flags");
    double last = 0.0;
    for (size_t k = 0; k < log->rows; k++) {
        if ((int)flags[k] & MK_FLAG_FAULT)
            return t[k] - last;
        if (((int)flags[k] & MK_FLAG_LOST) == 0)
            last = t[k];
        else if ((int)flags[k] & MK_FLAG_OVERRUN)
            return (double)NAN;
    }
    return INFINITY;
}

static void log_is_complete(int64_t unplugged_after_ms, enum mk_fault fault)
{
    struct mk_log *log;
    ck_assert_msg(mk_log_read(session.log_path, &log, &err) == MK_OK, "%s", err.message);
    const double *t = mk_log_get(log, "t"), *flags = mk_log_get(log, "flags");
    ck_assert(!log->truncated);
    ck_assert_ptr_nonnull(strstr(mk_log_find_meta(log, "fault"), mk_fault_name(fault)));
    /* Up to the last sample that the board gave, and the one that found it gone. */
    ck_assert_double_ge(t[log->rows - 1], 1e-3 * (double)unplugged_after_ms - 0.05);
    ck_assert((int)flags[log->rows - 1] & MK_FLAG_FAULT);
    double shown_s = time_to_fault(log);
    ck_assert_msg(isnan(shown_s) || shown_s <= SHOWN_S, "fault after %g s", shown_s);
    mk_log_free(log);
}

START_TEST(a_pulled_cable_is_shown_logged_and_forgiven)
{
    int tries = 0;
    open_session(rows[_i].bus);
    while (!get_going())
        ck_assert_int_lt(++tries, TRIES);
    emu_bench_unplug(&bench);
    int64_t pulled_ns = mk_clock_now_ns(&clock_), shown_ns = pulled_ns;
    while (fault_now() == MK_FAULT_NONE && shown_ns - pulled_ns < 2000000000) {
        usleep(200);
        shown_ns = mk_clock_now_ns(&clock_);
    }
    ck_assert_int_eq(fault_now(), rows[_i].fault);
    if (getenv("MECHKIT_CAMPAIGN"))
        printf("pulled cable, %s: fault shown after %.1f ms\n", rows[_i].bus,
               1e-6 * (double)(shown_ns - pulled_ns));
    ck_assert_int_eq(session_halt(&session, &err), MK_OK);
    log_is_complete(300, rows[_i].fault);
    mk_clock_sleep_until(&clock_, pulled_ns + 60000000);
    ck_assert_int_eq(mk_emulated_run(&bench.board), MK_OK);
    ck_assert_double_eq(bench.board.u, 0.0); /* the board's watchdog, with nobody there */

    ck_assert_int_eq(session_setup(&session, "pendubot-mid", &err), MK_ERR_NOTFOUND);
    mk_clock_sleep_until(&clock_, pulled_ns + 100000000);
    emu_bench_plug(&bench);
    ck_assert_msg(session_setup(&session, "pendubot-mid", &err) == MK_OK, "%s", err.message);
    struct mk_board_sample s;
    ck_assert_int_eq(mk_board_exchange(session.board, 0.0, &s), MK_OK);
}
END_TEST

/* --- the host is killed -------------------------------------------------------------------------
 * The board and its rig go on in another process, and tell when the torque ended. */

#define WATCHDOG_MS 20 /* the loop's own choice */
#define KILL_AFTER 300 /* requests: past the first swing */
#define SILENCE_MAX_NS 10000000

/* The board's clock. While the host lives, no silence of it counts more than 10 ms: a busy machine
 * that stands still must not fire the watchdog in the host's stead. From the kill on it is the
 * machine's. */
static struct {
    struct mk_clock clock;
    struct mk_clock machine;
    int64_t heard_ns, stood_ns;
    bool host_lives;
} far;

static int64_t far_now(const struct mk_clock *clock)
{
    (void)clock;
    int64_t now_ns = mk_clock_now_ns(&far.machine),
            excess_ns = now_ns - far.heard_ns - SILENCE_MAX_NS;
    return now_ns - far.stood_ns - (far.host_lives && excess_ns > 0 ? excess_ns : 0);
}

static void far_sleep_until(struct mk_clock *clock, int64_t deadline_ns)
{
    (void)clock;
    mk_clock_sleep_until(&far.machine, deadline_ns + far.stood_ns);
}

static void far_init(void)
{
    static const struct mk_clock_ops ops = {"far", false, far_now, far_sleep_until};
    memset(&far, 0, sizeof far);
    far.clock.ops = &ops;
    mk_clock_init_monotonic(&far.machine);
    far.heard_ns = mk_clock_now_ns(&far.machine);
    far.host_lives = true;
}

static void far_heard(void)
{
    int64_t now_ns = far_now(&far.clock);
    far.heard_ns = mk_clock_now_ns(&far.machine);
    far.stood_ns = far.heard_ns - now_ns;
}

static void socket_receive(void *ctx, const uint8_t *bytes, size_t n)
{
    if (send(*(int *)ctx, bytes, n, 0) < 0)
        _exit(3);
}
static size_t socket_take(void *ctx, uint8_t *bytes, size_t size)
{
    ssize_t n = recv(*(int *)ctx, bytes, size, 0);
    return n > 0 ? (size_t)n : 0;
}

/* --- the line between the two ------------------------------------------------------------------
 */

/* Buses are emulated in the host's process, and what arrives there goes on by a pair of sockets;
 * TCP and serial lines are the kernel's own. */
struct far_line {
    int far_fd, host_fd; /* -1: opened by name */
    char device[80];     /* "": the first */
};

static void line_open(struct far_line *l, const char *bus)
{
    int ends[2];
    *l = (struct far_line){-1, -1, ""};
    if (strcmp(bus, "tcp") == 0) {
        ck_assert_int_eq(
            mk_tcp_listen("127.0.0.1:0", &l->far_fd, l->device, sizeof l->device, NULL), MK_OK);
    } else if (strcmp(bus, "serial") == 0) {
        l->far_fd = posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC);
        ck_assert_int_eq(grantpt(l->far_fd) | unlockpt(l->far_fd), 0);
        snprintf(l->device, sizeof l->device, "%s", ptsname(l->far_fd));
    } else {
        ck_assert_int_eq(socketpair(AF_UNIX, SOCK_SEQPACKET, 0, ends), 0);
        l->far_fd = ends[0];
        l->host_fd = ends[1];
    }
}

/* The board's side, when the host's is in other hands. */
static void line_take(struct far_line *l, const char *bus)
{
    char peer[80];
    if (l->host_fd >= 0)
        close(l->host_fd);
    if (strcmp(bus, "tcp") != 0)
        return;
    int listening = l->far_fd;
    while ((l->far_fd = mk_tcp_accept(listening, peer, sizeof peer)) < 0)
        usleep(1000);
    fcntl(l->far_fd, F_SETFL, 0); /* it waits for what comes */
    close(listening);
}

/* 0: the host is gone. A pseudo-terminal that nobody has opened yet looks the same. */
static ssize_t line_read(const struct far_line *l, uint8_t *bytes, size_t size, bool heard)
{
    ssize_t n;
    while ((n = read(l->far_fd, bytes, size)) < 0 && errno == EIO && !heard)
        usleep(1000);
    return n > 0 ? n : 0;
}

/* --- the host, a process of its own ------------------------------------------------------------
 */

static void plug_in(const char *bus, int *fd)
{
    static struct emu_usb usb;
    static struct emu_pp pp;
    if (*fd < 0)
        return;
    const struct emu_board board = {fd, socket_receive, socket_take};
    if (strcmp(bus, "usb") == 0) {
        emu_usb_init(&usb, 3, "far", board);
        emu_usb_plug(&usb);
    } else {
        emu_pp_init(&pp, 0, EMU_PP_EPP, board);
    }
}

/* Swings up until somebody kills it; the motor is never switched off by this side. */
static void swing_up(const char *bus, struct far_line *l)
{
    struct mk_board_config board_config = {
        .model = &model, .clock = &clock_, .device = l->device[0] ? l->device : NULL};
    struct mk_board *board;
    struct mk_ctrl *ctrl;
    struct mk_loop *loop;
    struct mk_loop_config config;
    plug_in(bus, &l->host_fd);
    mk_loop_config_default(&model, &config);
    config.rate_hz = RATE_HZ;
    mk_safety_default(&model, 1.0 / RATE_HZ, &config.limits);
    config.limits.late_limit = 1000000;
    config.limits.lost_limit = 1000000;
    config.limits.stale_limit = 1000000; /* the far board's clock stands while nobody asks */
    if (mk_board_open(mk_board_backend_by_name(bus), &board_config, &board, NULL) != MK_OK ||
        mk_ctrl_create(mk_ctrl_setup_by_name("pendubot-mid"), &model, 1.0 / RATE_HZ, NULL, &ctrl,
                       NULL) != MK_OK ||
        mk_loop_create(board, ctrl, &config, &loop, NULL) != MK_OK ||
        mk_loop_start(loop, NULL, NULL, 0, NULL) != MK_OK)
        _exit(1);
    for (;;)
        pause();
}

/* --- the board ----------------------------------------------------------------------------------
 */

/* Serves the host and kills it after so many requests. */
static void serve(struct mk_emulated *e, const struct far_line *l, pid_t host)
{
    uint8_t bytes[MK_FRAME_MAX];
    ssize_t n;
    for (int k = 0; (n = line_read(l, bytes, sizeof bytes, k > 0)) > 0; k++) {
        far_heard();
        (void)mk_emulated_receive(e, bytes, (size_t)n);
        size_t size = mk_emulated_take(e, bytes, sizeof bytes);
        if (size > 0 && write(l->far_fd, bytes, size) < 0)
            break;
        if (k >= KILL_AFTER && e->u != 0.0 && far.host_lives) {
            kill(host, SIGKILL);
            far.host_lives = false;
        }
    }
}

START_TEST(a_host_that_is_killed_loses_the_motor_within_the_watchdogs_time)
{
    int status;
    struct far_line line;
    struct mk_emulated e;
    mk_model_default(MK_PLANT_PENDUBOT, &model);
    mk_clock_init_monotonic(&clock_);
    far_init();
    const struct mk_board_config config = {.model = &model, .clock = &far.clock};
    ck_assert_int_eq(mk_emulated_init(&e, &config, "far", "far", &err), MK_OK);
    line_open(&line, rows[_i].bus);
    pid_t host = fork();
    if (host == 0) {
        close(line.far_fd);
        swing_up(rows[_i].bus, &line);
    }
    line_take(&line, rows[_i].bus);
    signal(SIGPIPE, SIG_IGN);
    serve(&e, &line, host);
    ck_assert_int_eq(waitpid(host, &status, 0), host);
    ck_assert_msg(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL, "status %d", status);
    /* In mid swing-up: it moves, and the motor drives. */
    const double *x = mk_rig_state(e.rig);
    ck_assert_double_gt(fabs(x[2]) + fabs(x[3]), 0.1);
    ck_assert_double_ne(e.u, 0.0);
    ck_assert_uint_eq(e.device.fault, MK_WIRE_FAULT_NONE);

    int64_t fed_ns = e.opened_ns + (int64_t)e.device.fed_ns;
    mk_clock_sleep_until(&far.clock, fed_ns + (WATCHDOG_MS + 1) * INT64_C(1000000));
    ck_assert_int_eq(mk_emulated_run(&e), MK_OK);
    ck_assert_double_eq(e.u, 0.0);
    ck_assert_uint_eq(e.device.fault, MK_WIRE_FAULT_WATCHDOG);
    /* From the plant's side: the command ended that long after the last exchange, to a nanosecond.
     */
    int64_t off_ns = (int64_t)(e.device.fault_ns - e.device.fed_ns);
    ck_assert_int_eq(off_ns, WATCHDOG_MS * INT64_C(1000000) + 1);
    if (getenv("MECHKIT_CAMPAIGN"))
        printf("host killed in mid swing-up, %s: torque 0 %.6f ms after the last exchange, "
               "watchdog %d ms\n",
               rows[_i].bus, 1e-6 * (double)off_ns, WATCHDOG_MS);
    mk_emulated_free(&e);
    close(line.far_fd);
}
END_TEST

Suite *suite_replug(void)
{
    Suite *s = suite_create("replug");
    TCase *t = tcase_create("replug");
    tcase_add_checked_fixture(t, NULL, teardown);
    tcase_set_timeout(t, 60);
    tcase_add_loop_test(t, a_pulled_cable_is_shown_logged_and_forgiven, 0, ROWS);
    suite_add_tcase(s, t);
    TCase *killed = tcase_create("killed");
    tcase_set_timeout(killed, 30);
    tcase_add_loop_test(killed, a_host_that_is_killed_loses_the_motor_within_the_watchdogs_time, 0,
                        ROWS);
    suite_add_tcase(s, killed);
    return s;
}
