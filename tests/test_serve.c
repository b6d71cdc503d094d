/* mechkit serve as whoever hides a rig behind it, and whoever drives that rig, meet it: two
 * programs and a line between them. What became of the motor is what the serving side says. */
#include "suites.h"

#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "driver/serve.h"
#include "driver/tcp.h"
#include "emu/node.h"
#include "mechkit/log.h"
#include "support/files.h"
#include "support/program.h"
#include "support/wall.h"

#define TRIES 8 /* a busy machine may lose a run in real time to its own stalls */

static const char *const lines[] = {"127.0.0.1:0", "pty"};
#define LINES 2

static char said[16384];
static char log_path[256], device[128];
static const char *board;
static pid_t server, client;

/* Starts a program of its own, its output in a file. */
static pid_t start(const char *output, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
static pid_t start(const char *output, const char *fmt, ...)
{
    char command[2048] = "exec ";
    va_list args;
    va_start(args, fmt);
    vsnprintf(command + 5, sizeof command - 5, fmt, args);
    va_end(args);
    pid_t pid = fork();
    ck_assert_int_ge(pid, 0);
    if (pid > 0)
        return pid;
    int fd = open(output, O_WRONLY | O_CREAT | O_TRUNC, 0600);
    dup2(fd, STDOUT_FILENO);
    dup2(fd, STDERR_FILENO);
    execl("/bin/sh", "sh", "-c", command, (char *)NULL);
    _exit(127);
}

/* Exit code, or minus the signal. */
static int end_of(pid_t *pid)
{
    int status;
    ck_assert_int_eq(waitpid(*pid, &status, 0), *pid);
    *pid = 0;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

static const char *server_said(void)
{
    static char text[16384];
    FILE *f = fopen(log_path, "r");
    size_t n = f ? fread(text, 1, sizeof text - 1, f) : 0;
    text[n] = '\0';
    if (f)
        fclose(f);
    return text;
}

/* Waits until the server has said it; NULL: it has not. */
static const char *server_says(const char *text)
{
    double end = wall_s() + 20.0;
    const char *at;
    while (!(at = strstr(server_said(), text)) && wall_s() < end)
        usleep(5000);
    return at;
}

static void serve(const char *where, const char *options)
{
    snprintf(log_path, sizeof log_path, "%s", scratch("serve.txt"));
    unlink(log_path); /* what an earlier one said is not to be read for this one's */
    server = start(log_path, "%s serve --listen %s %s", MK_TEST_APP, where, options);
    const char *at = server_says("--device ");
    ck_assert_msg(at != NULL, "%s", server_said());
    snprintf(device, sizeof device, "%s", at + 9);
    device[strcspn(device, "\n")] = '\0';
    board = strcmp(where, "pty") == 0 ? "serial" : "tcp";
}

static void teardown(void)
{
    pid_t *all[] = {&server, &client};
    for (int i = 0; i < 2; i++)
        if (*all[i] > 0) {
            kill(*all[i], SIGKILL);
            waitpid(*all[i], NULL, 0);
            *all[i] = 0;
        }
}

static const char *wheel(void)
{
    return MK_SOURCE_DIR "/models/inertia-wheel.ini";
}

/* Pushes a wheel for a long time. */
static const char *pushing(void)
{
    return scratch_text("push.cmd", "setup open-loop\ninput 2\nstart\nwait 60\nhalt\nquit\n");
}

/* A client in real time that drives when this returns. */
static void push(void)
{
    char options[300];
    snprintf(options, sizeof options, "--model %s", wheel());
    client = start(scratch("client.txt"), "%s run %s --board %s --device %s %s --rate 200 --out %s",
                   MK_TEST_APP, pushing(), board, device, options, scratch("push"));
    ck_assert_ptr_nonnull(server_says("client"));
    usleep(800000);
}

/* --- what it says ---------------------------------------------------------------------------- */

START_TEST(what_it_cannot_do_is_told)
{
    ck_assert_int_eq(run_mechkit(said, sizeof said, "serve --listen nowhere"), 2);
    ck_assert_ptr_nonnull(strstr(said, "no port"));
    ck_assert_int_eq(run_mechkit(said, sizeof said, "serve --listen 127.0.0.1:99999"), 2);
    ck_assert_int_eq(run_mechkit(said, sizeof said, "serve --model nowhere.ini"), 3);
    ck_assert_int_eq(run_mechkit(said, sizeof said, "serve too much"), 2);
    serve(lines[0], "");
    ck_assert_int_eq(run_mechkit(said, sizeof said, "serve --listen %s", device), 1);
    ck_assert_ptr_nonnull(strstr(said, "another program listens"));
}
END_TEST

START_TEST(a_signal_ends_it_with_the_motor_off)
{
    static const int signals[] = {SIGINT, SIGTERM};
    char options[300];
    snprintf(options, sizeof options, "--model %s", wheel());
    serve(lines[_i / 2], options);
    push();
    kill(server, signals[_i % 2]);
    ck_assert_int_eq(end_of(&server), 0);
    ck_assert_ptr_nonnull(strstr(server_said(), ": command 0, was"));
    ck_assert_int_eq(end_of(&client), 1); /* unplugged */
}
END_TEST

START_TEST(once_is_for_one_client)
{
    serve(lines[_i], "--once");
    run_mechkit(said, sizeof said, "doctor --board %s --device %s --fast", board, device);
    ck_assert_msg(strstr(said, "answers") != NULL, "%s", said);
    ck_assert_int_eq(end_of(&server), 0);
    ck_assert_ptr_nonnull(strstr(server_said(), "left after"));
}
END_TEST

START_TEST(a_second_client_is_turned_away_and_harms_nobody)
{
    char options[300];
    int code = 0;
    snprintf(options, sizeof options, "--model %s", wheel());
    for (int tries = 0; code != 1; tries++) {
        ck_assert_int_lt(tries, TRIES);
        teardown();
        serve(lines[0], options);
        push();
        code = run_mechkit(said, sizeof said, "run %s --board %s --device %s %s --out %s",
                           scratch_text("look.cmd", "setup open-loop\nquit\n"), board, device,
                           options, scratch("look"));
        if (strstr(server_said(), "left after"))
            code = 0; /* the machine was too busy for the first */
    }
    ck_assert_msg(strstr(said, "does another program use the board?") != NULL, "%s", said);
    ck_assert_ptr_nonnull(strstr(server_said(), "turned away"));
}
END_TEST

/* --- as fast as it goes ---------------------------------------------------------------------- */

/* The rows of a log, without what is said of it. */
static char *rows_of(const char *path)
{
    char *text = slurp_file(path), *out = text;
    ck_assert_ptr_nonnull(text);
    for (char *line = text; *line;) {
        size_t n = strcspn(line, "\n");
        n += line[n] == '\n';
        if (*line != '#') {
            memmove(out, line, n);
            out += n;
        }
        line += n;
    }
    *out = '\0';
    return text;
}

static const char *swing(void)
{
    return scratch_text("swing.cmd",
                        "model " MK_SOURCE_DIR "/models/pendubot.ini\n"
                        "setup pendubot-mid\nstart\nwait-until balanced within 5\nhalt\n"
                        "save swing.csv\nsetup open-loop\ninput 2*sin(5*t)\nstart\n"
                        "wait 2\nhalt\nsave free.csv\nquit\n");
}

static void run_swing(const char *name, const char *options)
{
    ck_assert_msg(run_mechkit(said, sizeof said, "run %s --fast --quiet --out %s %s", swing(),
                              scratch(name), options) == 0,
                  "%s", said);
}

/* Twice: a run leaves nothing behind for the next. */
START_TEST(a_fast_run_on_a_served_rig_is_that_of_the_virtual_board)
{
    static const char *const logs[] = {"swing.csv", "free.csv"};
    char options[300], path[64];
    serve(lines[_i % 2], "--seed 1");
    run_swing("here", _i / 2 ? "--stream" : "");
    snprintf(options, sizeof options, "--board %s --device %s %s", board, device,
             _i / 2 ? "--stream" : "");
    for (int round = 0; round < 2; round++) {
        snprintf(path, sizeof path, "there%d", round);
        run_swing(path, options);
        for (int k = 0; k < 2; k++) {
            snprintf(path, sizeof path, "here/%s", logs[k]);
            char *here = rows_of(scratch(path));
            snprintf(path, sizeof path, "there%d/%s", round, logs[k]);
            char *there = rows_of(scratch(path));
            ck_assert_uint_gt(strlen(here), 10000);
            ck_assert_msg(strcmp(here, there) == 0, "%s differs", logs[k]);
            free(here);
            free(there);
        }
    }
}
END_TEST

START_TEST(doctor_and_standalone_go_by_steps_too)
{
    serve(lines[_i], "");
    run_mechkit(said, sizeof said, "doctor --fast --drive --board %s --device %s", board, device);
    ck_assert_msg(strstr(said, "ok       watchdog") && strstr(said, "ok       cable drag"), "%s",
                  said);
    int code = run_mechkit(said, sizeof said,
                           "standalone pendubot-mid --fast --seconds 5 --board %s --device %s "
                           "--out %s",
                           board, device, scratch("arrays.csv"));
    ck_assert_msg(code == 0 && strstr(said, "in phase balance"), "%s", said);
}
END_TEST

START_TEST(what_does_not_say_it_is_simulated_is_not_run_fast)
{
    ck_assert_int_eq(run_mechkit(said, sizeof said, "run %s --fast --board usb", swing()), 2);
    ck_assert_ptr_nonnull(strstr(said, "real time only: leave out --fast"));
}
END_TEST

/* Served runs end, with a name, when the server is no more. */
START_TEST(a_fast_run_whose_server_dies_ends_with_a_complete_log)
{
    struct mk_log *log;
    struct mk_error err = MK_ERROR_INIT;
    const char *script = scratch_text(
        "long.cmd",
        "model " MK_SOURCE_DIR
        "/models/pendubot.ini\nsetup open-loop\ninput sin(5*t)\nstart\nwait 100000\nhalt\nquit\n");
    serve(lines[_i], "");
    client = start(scratch("client.txt"), "%s run %s --fast --board %s --device %s --out %s",
                   MK_TEST_APP, script, board, device, scratch("dies"));
    ck_assert_ptr_nonnull(server_says("steps the clock"));
    usleep(300000);
    kill(server, SIGKILL);
    ck_assert_int_eq(end_of(&server), -SIGKILL);
    ck_assert_int_eq(end_of(&client), 1);
    ck_assert_msg(mk_log_read(scratch("dies/run-001.csv"), &log, &err) == MK_OK, "%s", err.message);
    ck_assert(!log->truncated);
    ck_assert_ptr_nonnull(strstr(mk_log_find_meta(log, "fault"), "unplugged"));
    mk_log_free(log);
}
END_TEST

/* --- the motor ------------------------------------------------------------------------------- */

/* The newest command in force that the server told of: what it was when the client left; NAN: it
 * has not told. */
static bool told_of_command(double *now, double *was)
{
    const char *at = NULL, *next = server_said();
    while ((next = strstr(next, ": command ")) != NULL)
        at = next++;
    return at && sscanf(at, ": command %lf, was %lf", now, was) == 2;
}

START_TEST(a_client_that_is_killed_leaves_the_motor_off)
{
    char options[300];
    double now = 1.0, was = 0.0;
    snprintf(options, sizeof options, "--model %s", wheel());
    for (int tries = 0; was == 0.0; tries++) {
        ck_assert_msg(tries < TRIES, "%s", server_said());
        teardown();
        serve(lines[_i], options);
        push();
        kill(client, SIGKILL);
        waitpid(client, NULL, 0);
        client = 0;
        ck_assert_ptr_nonnull(server_says("left after"));
        ck_assert(told_of_command(&now, &was));
    }
    ck_assert_double_eq(was, 2.0); /* it drove to the last */
    ck_assert_double_eq(now, 0.0);
}
END_TEST

/* A process that stands still keeps its line open: only the watchdog can know. */
START_TEST(a_client_that_falls_silent_loses_the_motor_to_the_watchdog)
{
    char options[300];
    double now = 1.0, was = 1.0;
    snprintf(options, sizeof options, "--model %s", wheel());
    /* Again where the machine was too busy for the client before it was stopped. */
    for (int tries = 0; tries < 5; tries++) {
        if (tries > 0)
            teardown();
        serve(lines[_i], options);
        push();
        kill(client, SIGSTOP);
        ck_assert_ptr_nonnull(server_says("motor off: the watchdog saw no exchange in time"));
        if (!strstr(server_said(), "left after"))
            break;
    }
    ck_assert_ptr_null(strstr(server_said(), "left after"));
    kill(client, SIGKILL);
    ck_assert_ptr_nonnull(server_says("left after"));
    const char *first = strstr(server_said(), "motor off");
    ck_assert(first && !strstr(first + 1, "motor off")); /* told once */
    ck_assert_ptr_null(strstr(server_said(), "steps the clock"));
    ck_assert(told_of_command(&now, &was));
    ck_assert_double_eq(was, 0.0);
    ck_assert_double_eq(now, 0.0);
}
END_TEST

/* The other way round: a board that is silent, and one that is gone. */
START_TEST(a_server_that_stands_still_or_dies_ends_the_run_by_its_name)
{
    static const struct {
        int number;
        const char *fault;
    } rows[] = {{SIGSTOP, "link"}, {SIGKILL, "unplugged"}};
    struct mk_log *log = NULL;
    char options[300];
    bool seen = false;
    snprintf(options, sizeof options, "--model %s", wheel());
    for (int tries = 0; !seen; tries++) {
        ck_assert_int_lt(tries, TRIES);
        teardown();
        run_command(NULL, 0, "rm -rf %s", scratch("push"));
        serve(lines[_i % 2], options);
        push();
        kill(server, rows[_i / 2].number);
        ck_assert_int_eq(end_of(&client), 1);
        if (mk_log_read(scratch("push/run-001.csv"), &log, NULL) != MK_OK)
            continue;
        ck_assert(!log->truncated);
        const char *fault = mk_log_find_meta(log, "fault");
        seen = fault && strstr(fault, rows[_i / 2].fault);
        mk_log_free(log);
    }
}
END_TEST

/* What counts as a turn here is half of one there. */
START_TEST(a_model_with_other_counts_a_turn_is_refused)
{
    char other[300], options[400];
    snprintf(other, sizeof other, "%s",
             scratch_text("half.ini", "[rig]\nkind = inertia-wheel\nencoder_cpr = 2000\n"
                                      "[parameters]\np1 = 0.1\np2 = 0.1\np3 = 0.1\n"));
    snprintf(options, sizeof options, "--model %s", wheel());
    serve("127.0.0.1:0", options);
    ck_assert_int_ne(run_mechkit(said, sizeof said,
                                 "run %s --board tcp --device %s --model %s --out %s", pushing(),
                                 device, other, scratch("half")),
                     0);
    ck_assert_msg(strstr(said, "half.ini: encoder_cpr of joint 1 is 2000, but the board counts "
                               "4000 a turn") != NULL,
                  "%s", said);
}
END_TEST

/* --- a simulation that fails ------------------------------------------------------------------ */

static struct {
    struct mk_server *server;
    volatile int stop;
    int failures;
    bool mended;
} ill;

/* On the server's thread: the rig fails as soon as the first client is there. */
static void fall_ill(void *user, const char *line)
{
    (void)user;
    if (strncmp(line, "client", 6) == 0 && !strstr(line, "left") && ill.failures++ == 0)
        mk_serve_emulated(ill.server)->failed = true;
    ill.mended = ill.mended || strstr(line, "put back to its start");
}

static void *serve_the_ill(void *user)
{
    (void)user;
    return mk_serve_run(ill.server, NULL) == MK_OK ? NULL : &ill;
}

START_TEST(a_simulation_that_fails_ends_its_client_and_serves_the_next)
{
    struct mk_error err = MK_ERROR_INIT;
    struct mk_model model;
    struct mk_clock clock;
    struct mk_board *first = NULL, *second = NULL;
    struct mk_board_sample s;
    pthread_t thread;
    void *result;
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &model);
    mk_clock_init_simulated(&clock);
    const struct mk_serve_config config = {
        .model = &model, .listen = "127.0.0.1:0", .stop = &ill.stop, .say = fall_ill};
    ck_assert_int_eq(mk_serve_open(&config, &ill.server, &err), MK_OK);
    const struct mk_board_config way = {
        .model = &model, .clock = &clock, .device = mk_serve_device(ill.server)};
    ck_assert_int_eq(pthread_create(&thread, NULL, serve_the_ill, NULL), 0);
    ck_assert_int_ne(mk_board_open(mk_board_backend_by_name("tcp"), &way, &first, &err), MK_OK);
    enum mk_status st = mk_board_open(mk_board_backend_by_name("tcp"), &way, &second, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    ck_assert_int_eq(mk_board_exchange(second, 1.0, &s), MK_OK);
    ck_assert_double_eq(s.u_applied, 1.0);
    mk_board_close(second);
    __atomic_store_n(&ill.stop, 1, __ATOMIC_RELAXED);
    pthread_join(thread, &result);
    ck_assert_ptr_null(result);
    ck_assert(ill.mended);
    mk_serve_close(ill.server);
}
END_TEST

/* --- on a thread of these tests ----------------------------------------------------------------
 */

static struct {
    struct mk_server *server;
    pthread_t thread;
    volatile int stop;
    atomic_uint waits; /* that it has begun */
    atomic_bool left;  /* a client has */
    char said[256];    /* of it */
} own;

static void note_who_left(void *user, const char *line)
{
    (void)user;
    if (!strstr(line, "left after"))
        return;
    snprintf(own.said, sizeof own.said, "%s", line);
    atomic_store(&own.left, true);
}

static void *serve_here(void *user)
{
    (void)user;
    return mk_serve_run(own.server, NULL) == MK_OK ? NULL : &own;
}

static struct emu_wish count_wait(void *ctx)
{
    (void)ctx;
    atomic_fetch_add(&own.waits, 1);
    return (struct emu_wish){.fd = -1, .limit_ms = -1};
}

static void begin_serving(const struct mk_model *model, const char *where)
{
    struct mk_error err = MK_ERROR_INIT;
    const struct mk_serve_config config = {
        .model = model, .listen = where, .stop = &own.stop, .say = note_who_left};
    own.stop = 0;
    atomic_store(&own.left, false);
    ck_assert_int_eq(mk_serve_open(&config, &own.server, &err), MK_OK);
    emu_pump(count_wait, NULL);
    ck_assert_int_eq(pthread_create(&own.thread, NULL, serve_here, NULL), 0);
}

/* It is still there to be looked at, until it is closed. */
static void stop_serving(void)
{
    void *result;
    __atomic_store_n(&own.stop, 1, __ATOMIC_RELAXED);
    pthread_join(own.thread, &result);
    ck_assert_ptr_null(result);
    emu_pump(NULL, NULL);
}

/* A look whether a terminal has been opened is due every 20 ms, nothing else is. */
static void it_sleeps(void)
{
    double begun = wall_s();
    unsigned before = atomic_load(&own.waits);
    usleep(200000);
    double passed = wall_s() - begun;
    ck_assert_double_le((double)(atomic_load(&own.waits) - before), passed / 0.020 + 10.0);
}

/* No client, one that has stepped the clock and lets it stand, and none again. */
START_TEST(a_server_that_has_nothing_to_do_sleeps)
{
    struct mk_error err = MK_ERROR_INIT;
    struct mk_model model;
    struct mk_clock clock;
    struct mk_board *b = NULL;
    struct mk_board_sample s;
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &model);
    mk_clock_init_simulated(&clock);
    begin_serving(&model, lines[_i]);
    it_sleeps();
    const struct mk_board_config way = {
        .model = &model, .clock = &clock, .device = mk_serve_device(own.server)};
    enum mk_status st =
        mk_board_open(mk_board_backend_by_name(mk_serve_board(own.server)), &way, &b, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    ck_assert_int_eq(mk_board_exchange(b, 1.0, &s), MK_OK);
    ck_assert_double_eq(s.u_applied, 1.0);
    it_sleeps();
    mk_board_close(b);
    it_sleeps();
    stop_serving();
    mk_serve_close(own.server);
}
END_TEST

/* Sends a request and waits for its answer. */
static void request(int fd, enum mk_message type, uint32_t value, size_t n)
{
    static uint32_t sequence;
    static struct mk_decoder d;
    uint8_t payload[4], bytes[MK_FRAME_MAX];
    mk_put32(payload, value);
    const struct mk_frame f = {MK_FRAME_VERSION, (uint8_t)type, (uint16_t)n, ++sequence, payload};
    struct mk_frame answer = {0};
    size_t size = mk_frame_encode(&f, bytes);
    ck_assert_int_eq(write(fd, bytes, size), (ssize_t)size);
    mk_decoder_reset(&d);
    for (const double end = wall_s() + 20.0; answer.type == 0;) {
        struct pollfd p = {.fd = fd, .events = POLLIN};
        ck_assert_double_lt(wall_s(), end);
        ssize_t k = poll(&p, 1, 1000) == 1 ? read(fd, bytes, sizeof bytes) : 0;
        const uint8_t *at = bytes;
        size_t left = k > 0 ? (size_t)k : 0;
        (void)mk_decoder_next(&d, &at, &left, &answer);
    }
    ck_assert_uint_eq(answer.type, type | MK_MSG_ANSWER);
}

static int call_server(void)
{
    struct mk_error err = MK_ERROR_INIT;
    int fd;
    if (strcmp(mk_serve_board(own.server), "tcp") == 0)
        ck_assert_int_eq(mk_tcp_connect(mk_serve_device(own.server), &fd, &err), MK_OK);
    else
        fd = open(mk_serve_device(own.server), O_RDWR | O_NOCTTY | O_NONBLOCK);
    return fd;
}

/* Without a word, and without a watchdog that would see to it. */
START_TEST(a_client_that_hangs_up_while_it_drives_leaves_the_motor_off)
{
    struct mk_model model;
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &model);
    begin_serving(&model, lines[_i]);
    int fd = call_server();
    request(fd, MK_MSG_HELLO, 0, 0);
    request(fd, MK_MSG_WATCHDOG, 0, 4);
    request(fd, MK_MSG_EXCHANGE, 2 * MK_WIRE_MICRO, 4);
    close(fd);
    for (const double end = wall_s() + 20.0; !atomic_load(&own.left) && wall_s() < end;)
        usleep(1000);
    stop_serving();
    ck_assert_msg(strstr(own.said, "left after 1 exchanges: command 0, was 2") != NULL, "%s",
                  own.said);
    ck_assert_double_eq(mk_serve_emulated(own.server)->u, 0.0);
    mk_serve_close(own.server);
}
END_TEST

/* By name, for whoever looks at it knows its clients by theirs. */
START_TEST(a_client_is_told_by_the_address_that_it_calls_from)
{
    struct mk_model model;
    struct sockaddr_in from;
    socklen_t size = sizeof from;
    char expected[64];
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &model);
    begin_serving(&model, "127.0.0.1:0");
    int fd = call_server();
    request(fd, MK_MSG_HELLO, 0, 0);
    ck_assert_int_eq(getsockname(fd, (struct sockaddr *)&from, &size), 0);
    snprintf(expected, sizeof expected, "client 127.0.0.1:%d left after 0 exchanges",
             ntohs(from.sin_port));
    close(fd);
    for (const double end = wall_s() + 20.0; !atomic_load(&own.left) && wall_s() < end;)
        usleep(1000);
    stop_serving();
    ck_assert_msg(strncmp(own.said, expected, strlen(expected)) == 0, "%s", own.said);
    mk_serve_close(own.server);
}
END_TEST

/* Far more than a terminal holds. */
START_TEST(a_client_that_reads_late_gets_whole_answers_and_is_served_on)
{
    enum { ASKED = 5000 };
    static struct mk_decoder d;
    struct mk_model model;
    uint8_t bytes[4096];
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &model);
    begin_serving(&model, "pty");
    int fd = call_server();
    request(fd, MK_MSG_HELLO, 0, 0);
    for (int k = 0; k < ASKED; k++) {
        const struct mk_frame hello = {MK_FRAME_VERSION, MK_MSG_HELLO, 0, 1000 + (uint32_t)k, NULL};
        const size_t size = mk_frame_encode(&hello, bytes);
        const double end = wall_s() + 20.0;
        while (write(fd, bytes, size) != (ssize_t)size && wall_s() < end)
            usleep(1000);
    }
    mk_decoder_reset(&d);
    for (struct pollfd p = {.fd = fd, .events = POLLIN}; poll(&p, 1, 500) == 1;) {
        const ssize_t k = read(fd, bytes, sizeof bytes);
        const uint8_t *at = bytes;
        size_t left = k > 0 ? (size_t)k : 0;
        struct mk_frame answer;
        while (mk_decoder_next(&d, &at, &left, &answer))
            ck_assert_uint_eq(answer.type, MK_MSG_HELLO | MK_MSG_ANSWER);
    }
    ck_assert_uint_eq(d.broken + d.skipped, 0);
    ck_assert_uint_gt(d.frames, 10);
    ck_assert_uint_lt(d.frames, ASKED);
    request(fd, MK_MSG_HELLO, 0, 0);
    close(fd);
    stop_serving();
    mk_serve_close(own.server);
}
END_TEST

/* --- clients that are none ------------------------------------------------------------------- */

START_TEST(noise_and_clients_that_come_and_go_do_no_harm)
{
    uint8_t noise[600];
    serve(lines[0], "");
    for (int k = 0; k < 40; k++) {
        int fd;
        struct mk_error err = MK_ERROR_INIT;
        ck_assert_msg(mk_tcp_connect(device, &fd, &err) == MK_OK, "%s", err.message);
        for (size_t i = 0; i < sizeof noise; i++)
            noise[i] = (uint8_t)(i % 5 == 0 ? 'M' : i % 5 == 1 ? 'K' : 31 * i + 7 * (size_t)k);
        (void)send(fd, noise, (size_t)(15 * k), MSG_NOSIGNAL);
        close(fd);
    }
    for (int tries = 0;; tries++) {
        run_mechkit(said, sizeof said, "doctor --fast --board tcp --device %s", device);
        if (strstr(said, "ok       watchdog"))
            break;
        ck_assert_msg(tries < TRIES, "%s", said);
        usleep(100000);
    }
}
END_TEST

Suite *suite_serve(void)
{
    Suite *s = suite_create("serve");
    TCase *t = tcase_create("serve");
    tcase_add_checked_fixture(t, NULL, teardown);
    tcase_set_timeout(t, 120);
    tcase_add_test(t, what_it_cannot_do_is_told);
    tcase_add_loop_test(t, a_signal_ends_it_with_the_motor_off, 0, 2 * LINES);
    tcase_add_loop_test(t, once_is_for_one_client, 0, LINES);
    tcase_add_test(t, a_second_client_is_turned_away_and_harms_nobody);
    tcase_add_loop_test(t, a_fast_run_on_a_served_rig_is_that_of_the_virtual_board, 0, 2 * LINES);
    tcase_add_loop_test(t, doctor_and_standalone_go_by_steps_too, 0, LINES);
    tcase_add_test(t, what_does_not_say_it_is_simulated_is_not_run_fast);
    tcase_add_loop_test(t, a_fast_run_whose_server_dies_ends_with_a_complete_log, 0, LINES);
    tcase_add_loop_test(t, a_client_that_is_killed_leaves_the_motor_off, 0, LINES);
    tcase_add_loop_test(t, a_client_that_falls_silent_loses_the_motor_to_the_watchdog, 0, LINES);
    tcase_add_loop_test(t, a_server_that_stands_still_or_dies_ends_the_run_by_its_name, 0,
                        2 * LINES);
    tcase_add_test(t, a_model_with_other_counts_a_turn_is_refused);
    tcase_add_test(t, a_simulation_that_fails_ends_its_client_and_serves_the_next);
    tcase_add_loop_test(t, a_server_that_has_nothing_to_do_sleeps, 0, LINES);
    tcase_add_loop_test(t, a_client_that_hangs_up_while_it_drives_leaves_the_motor_off, 0, LINES);
    tcase_add_test(t, a_client_is_told_by_the_address_that_it_calls_from);
    tcase_add_test(t, a_client_that_reads_late_gets_whole_answers_and_is_served_on);
    tcase_add_test(t, noise_and_clients_that_come_and_go_do_no_harm);
    suite_add_tcase(s, t);
    return s;
}
