/* The USB back end on a port that is not there: which board, who may, plugging, streaming. What
 * every back end promises is in test_board.c, what goes wrong on the way in test_bus_faults.c. */
#include "suites.h"

#include <signal.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "driver/usb.h"
#include "emu/bench.h"
#include "mechkit/loop.h"

static struct mk_model model;
static struct mk_clock clock_;
static struct mk_board_config config;
static struct mk_board *board;
static struct emu_bench bench;
static struct mk_error err;

static void setup(void)
{
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &model);
    mk_clock_init_simulated(&clock_);
    config = (struct mk_board_config){.model = &model, .clock = &clock_};
    board = NULL;
    err = (struct mk_error)MK_ERROR_INIT;
    emu_bench_init(&bench, "usb", &config);
}

static void teardown(void)
{
    mk_board_close(board);
    emu_bench_free(&bench);
}

static enum mk_status try_open(const char *device)
{
    config.device = device;
    return mk_board_open(&bench.ops, &config, &board, &err);
}

static void must_open(const char *device)
{
    enum mk_status st = try_open(device);
    ck_assert_msg(st == MK_OK, "%s", err.message);
}

static enum mk_status trade(double u)
{
    struct mk_board_sample s;
    mk_clock_sleep_until(&clock_, mk_clock_now_ns(&clock_) + 2000000);
    return mk_board_exchange(board, u, &s);
}

/* --- which board -------------------------------------------------------------------------------
 */

START_TEST(a_board_is_found_by_serial_number_among_several)
{
    struct mk_emulated other;
    struct emu_usb port;
    struct mk_board_identity id;
    ck_assert_int_eq(mk_emulated_init(&other, &config, "emulated", "MK-0002", &err), MK_OK);
    emu_usb_init(&port, 2, "MK-0002", emu_board_of(&other));
    emu_usb_plug(&port);
    static const char *const device[] = {"MK-0002", "1209:0001:MK-0002", "MK-0001"};
    static const char *const serial[] = {"MK-0002", "MK-0002", "MK-0001"};
    for (int k = 0; k < 3; k++) {
        must_open(device[k]);
        ck_assert_int_eq(board->ops->identify(board, &id, &err), MK_OK);
        ck_assert_str_eq(id.serial, serial[k]);
        mk_board_close(board);
        board = NULL;
    }
    must_open("1209:0001"); /* any of them */
    mk_board_close(board);
    board = NULL;
    struct mk_board_found found[4];
    ck_assert_int_eq(mk_usb_find(NULL, found, 4, &err), 2);
    bool second = strcmp(found[1].device, "MK-0002") == 0; /* in whatever order */
    ck_assert_str_eq(found[second].device, "MK-0002");
    ck_assert_str_eq(found[!second].device, "MK-0001");
    ck_assert_str_eq(found[second].name, "emulated board");
    ck_assert_int_eq(found[second].status, MK_OK);
    emu_usb_free(&port);
    mk_emulated_free(&other);
}
END_TEST

START_TEST(a_board_that_is_not_there_is_not_found)
{
    static const char *const device[] = {"MK-9", "1209:0002", "1209:0001:MK-9"};
    for (int k = 0; k < 3; k++) {
        ck_assert_int_eq(try_open(device[k]), MK_ERR_NOTFOUND);
        ck_assert_ptr_nonnull(strstr(err.message, "plugged in"));
        ck_assert_ptr_null(board);
    }
    emu_usb_unplug(&bench.usb);
    ck_assert_int_eq(try_open(NULL), MK_ERR_NOTFOUND);
    ck_assert_int_eq(mk_usb_find(NULL, NULL, 0, &err), 0);
}
END_TEST

/* --- who may ------------------------------------------------------------------------------------
 */

START_TEST(without_permission_the_message_names_the_udev_rule)
{
    struct mk_board_found found;
    bench.usb.denied = true;
    ck_assert_int_eq(try_open(NULL), MK_ERR_PERM);
    ck_assert_ptr_nonnull(strstr(err.message, "udev rule"));
    ck_assert_int_eq(mk_usb_find(NULL, &found, 1, &err), 1);
    ck_assert_int_eq(found.status, MK_ERR_PERM);
    ck_assert_ptr_nonnull(strstr(found.note, "udev rule"));
    bench.usb.denied = false;
    must_open(NULL);
}
END_TEST

START_TEST(a_board_in_use_elsewhere_is_busy)
{
    bench.usb.taken = true;
    ck_assert_int_eq(try_open(NULL), MK_ERR_BUSY);
    ck_assert_ptr_nonnull(strstr(err.message, "another program"));
    bench.usb.taken = false;
    must_open(NULL);
}
END_TEST

START_TEST(a_kernel_driver_on_the_interface_is_put_aside)
{
    bench.usb.driver_bound = true;
    must_open(NULL);
    ck_assert_int_eq(trade(1.0), MK_OK);
}
END_TEST

START_TEST(a_model_beyond_the_boards_limit_is_refused)
{
    model.u_max = 11.0;
    ck_assert_int_eq(try_open(NULL), MK_ERR_RANGE);
    ck_assert_ptr_nonnull(strstr(err.message, "11"));
}
END_TEST

/* Anything libusb can say has a code of ours and a text that tells what to do. */
START_TEST(every_libusb_error_has_a_meaning)
{
    for (int code = LIBUSB_ERROR_IO; code >= LIBUSB_ERROR_NOT_SUPPORTED; code--) {
        ck_assert_int_lt(mk_usb_error(&err, code, "test"), MK_OK);
        ck_assert_ptr_null(strstr(err.message, "unknown kind"));
        ck_assert_ptr_nonnull(strstr(err.message, libusb_error_name(code)));
        ck_assert_int_eq(err.os_code, code);
    }
    ck_assert_int_eq(mk_usb_error(&err, LIBUSB_ERROR_OTHER, "test"), MK_ERR_IO);
}
END_TEST

/* --- plugging ------------------------------------------------------------------------------------
 */

START_TEST(an_unplugged_board_is_gone_and_one_that_is_plugged_in_again_works)
{
    struct mk_board_sample s;
    for (int k = 0; k < 3; k++) {
        must_open(NULL);
        ck_assert_int_eq(trade(5.0), MK_OK);
        emu_usb_unplug(&bench.usb);
        ck_assert_int_eq(trade(5.0), MK_ERR_NODEV);
        ck_assert_int_eq(mk_board_exchange(board, 5.0, &s), MK_ERR_NODEV);
        ck_assert_int_eq(board->ops->safe_state(board), MK_ERR_NODEV);
        ck_assert_int_eq(board->ops->zero_counters(board, &err), MK_ERR_NODEV);
        ck_assert_ptr_nonnull(strstr(err.message, "gone"));
        emu_usb_plug(&bench.usb); /* while the old handle is still open, as in life */
        ck_assert_int_eq(trade(5.0), MK_ERR_NODEV);
        mk_board_close(board);
        board = NULL;
    }
    must_open(NULL);
    ck_assert_int_eq(trade(5.0), MK_OK);
}
END_TEST

START_TEST(a_board_that_restarts_is_gone_until_it_is_opened_again)
{
    must_open(NULL);
    ck_assert_int_eq(trade(5.0), MK_OK);
    mk_emulated_restart(&bench.board);
    ck_assert_int_eq(trade(5.0), MK_ERR_NODEV);
    ck_assert_double_eq(bench.board.u, 0.0);
    mk_board_close(board);
    must_open(NULL);
    ck_assert_int_eq(trade(5.0), MK_OK);
}
END_TEST

/* --- streaming -----------------------------------------------------------------------------------
 */

START_TEST(streamed_samples_arrive_and_their_answers_act)
{
    must_open(NULL);
    struct mk_wire *wire = board->priv;
    struct mk_wire_reading r;
    uint32_t number;
    int64_t before_ns = 0;
    ck_assert_int_eq(board->ops->set_watchdog(board, 20, &err), MK_OK);
    ck_assert_int_eq(mk_wire_stream(wire, 2000, &err), MK_OK);
    for (uint32_t k = 0; k < 200; k++) {
        ck_assert_int_eq(mk_wire_next_sample(wire, 1000000000, &number, &r), MK_OK);
        ck_assert_uint_eq(number, k);
        ck_assert_uint_eq(r.status, MK_WIRE_ST_STREAMING);
        if (k > 0)
            ck_assert_int_eq(r.sample.board_ns - before_ns, 2000000);
        ck_assert_double_eq(r.sample.u_applied, k ? (double)((k - 1) % 7) : 0.0);
        before_ns = r.sample.board_ns;
        ck_assert_int_eq(mk_wire_answer_sample(wire, number, (double)(k % 7)), MK_OK);
    }
    ck_assert_int_eq(mk_wire_stream(wire, 0, &err), MK_OK);
    ck_assert_int_eq(trade(1.0), MK_OK);
}
END_TEST

START_TEST(the_panel_is_reached_through_the_bus)
{
    must_open(NULL);
    struct mk_wire_state state;
    bench.board.switches = 5;
    ck_assert_int_eq(mk_wire_lcd(board->priv, 0, "hello, longer than twenty", &err), MK_OK);
    ck_assert_str_eq(bench.board.lcd[0], "hello, longer than t");
    ck_assert_int_eq(mk_wire_leds(board->priv, 3, &err), MK_OK);
    ck_assert_uint_eq(bench.board.leds, 3);
    ck_assert_int_eq(mk_wire_state(board->priv, &state, &err), MK_OK);
    ck_assert_uint_eq(state.switches, 5);
    ck_assert_int_eq(mk_wire_lcd(board->priv, 2, "", &err), MK_ERR_RANGE);
}
END_TEST

/* --- the host dies
 * --------------------------------------------------------------------------------- */

/* Long, so that a busy machine does not do it instead. */
#define KILL_WATCHDOG_MS 400
#define KILL_AFTER 100 /* requests */

/* The board lives in the parent, which answers over a socket; the host is a child with libusb. */
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

static void drive_until_killed(int fd)
{
    struct emu_usb port;
    struct mk_board_sample s;
    mk_clock_init_monotonic(&clock_);
    emu_usb_unplug(&bench.usb);
    emu_usb_init(&port, 3, "far", (struct emu_board){&fd, socket_receive, socket_take});
    emu_usb_plug(&port);
    if (try_open("far") != MK_OK ||
        board->ops->set_watchdog(board, KILL_WATCHDOG_MS, NULL) != MK_OK)
        _exit(1);
    for (;;) {
        if (mk_board_exchange(board, 8.0, &s) != MK_OK)
            _exit(2);
        mk_clock_sleep_until(&clock_, mk_clock_now_ns(&clock_) + 1000000);
    }
}

/* Serves the child and kills it after so many requests. */
static void serve(struct mk_emulated *e, int fd, pid_t child)
{
    uint8_t bytes[MK_FRAME_MAX];
    ssize_t n;
    for (int k = 0; (n = recv(fd, bytes, sizeof bytes, 0)) > 0; k++) {
        (void)mk_emulated_receive(e, bytes, (size_t)n);
        size_t size = mk_emulated_take(e, bytes, sizeof bytes);
        (void)send(fd, bytes, size, MSG_NOSIGNAL);
        if (k == KILL_AFTER)
            kill(child, SIGKILL);
    }
}

START_TEST(a_host_that_is_killed_loses_the_motor_within_the_watchdogs_time)
{
    int ends[2], status;
    struct mk_emulated e;
    mk_clock_init_monotonic(&clock_);
    ck_assert_int_eq(mk_emulated_init(&e, &config, "far", "far", &err), MK_OK);
    ck_assert_int_eq(socketpair(AF_UNIX, SOCK_SEQPACKET, 0, ends), 0);
    pid_t child = fork();
    if (child == 0) {
        close(ends[0]);
        drive_until_killed(ends[1]);
    }
    close(ends[1]);
    serve(&e, ends[0], child);
    ck_assert_int_eq(waitpid(child, &status, 0), child);
    ck_assert(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
    ck_assert_double_eq(e.u, 8.0);

    int64_t fed_ns = e.opened_ns + (int64_t)e.device.fed_ns;
    mk_clock_sleep_until(&clock_, fed_ns + (KILL_WATCHDOG_MS + 10) * INT64_C(1000000));
    ck_assert_int_eq(mk_emulated_run(&e), MK_OK);
    ck_assert_double_eq(e.u, 0.0);
    ck_assert_uint_eq(e.device.fault, MK_WIRE_FAULT_WATCHDOG);
    /* From the plant's side: the command ended that long after the last exchange, to a nanosecond.
     */
    ck_assert_int_eq((int64_t)(e.device.fault_ns - e.device.fed_ns),
                     KILL_WATCHDOG_MS * INT64_C(1000000) + 1);
    mk_emulated_free(&e);
    close(ends[0]);
}
END_TEST

Suite *suite_usb(void)
{
    Suite *s = suite_create("usb");
    TCase *t = tcase_create("usb");
    tcase_add_checked_fixture(t, setup, teardown);
    tcase_add_test(t, a_board_is_found_by_serial_number_among_several);
    tcase_add_test(t, a_board_that_is_not_there_is_not_found);
    tcase_add_test(t, without_permission_the_message_names_the_udev_rule);
    tcase_add_test(t, a_board_in_use_elsewhere_is_busy);
    tcase_add_test(t, a_kernel_driver_on_the_interface_is_put_aside);
    tcase_add_test(t, a_model_beyond_the_boards_limit_is_refused);
    tcase_add_test(t, every_libusb_error_has_a_meaning);
    tcase_add_test(t, an_unplugged_board_is_gone_and_one_that_is_plugged_in_again_works);
    tcase_add_test(t, a_board_that_restarts_is_gone_until_it_is_opened_again);
    tcase_add_test(t, streamed_samples_arrive_and_their_answers_act);
    tcase_add_test(t, the_panel_is_reached_through_the_bus);
    tcase_add_test(t, a_host_that_is_killed_loses_the_motor_within_the_watchdogs_time);
    suite_add_tcase(s, t);
    return s;
}
