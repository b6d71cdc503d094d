/* The cable is pulled in mid run, in real time, and put back: through the session that command
 * files and the screen use, without restarting anything. */
#include "suites.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "console/session.h"
#include "emu/bench.h"
#include "support/files.h"

#define TRIES 8 /* a busy machine may lose the run to its own stalls */

static struct mk_model model;
static struct mk_clock clock_;
static struct emu_bench bench;
static struct session session;
static struct mk_error err;

static void setup(void)
{
    mk_model_default(MK_PLANT_PENDUBOT, &model);
    mk_clock_init_monotonic(&clock_);
    const struct mk_board_config config = {.model = &model, .clock = &clock_};
    const struct session_options options = {
        .board = "usb", .out = scratch("runs"), .rate_hz = 100.0, .seed = 1};
    emu_bench_init(&bench, "usb", &config);
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

/* Sets up, starts, lets it swing. False: the machine was too busy. */
static bool get_going(void)
{
    ck_assert_msg(session_setup(&session, "pendubot-mid", &err) == MK_OK, "%s", err.message);
    if (session_start(&session, &err) != MK_OK)
        return false;
    usleep(300000);
    return fault_now() == MK_FAULT_NONE;
}

static void log_is_complete(int64_t unplugged_after_ms)
{
    struct mk_log *log;
    ck_assert_msg(mk_log_read(session.log_path, &log, &err) == MK_OK, "%s", err.message);
    const double *t = mk_log_get(log, "t"), *flags = mk_log_get(log, "flags");
    ck_assert(!log->truncated);
    ck_assert_ptr_nonnull(strstr(mk_log_find_meta(log, "fault"), "unplugged"));
    /* Up to the last sample that the board gave, and the one that found it gone. */
    ck_assert_double_ge(t[log->rows - 1], 1e-3 * (double)unplugged_after_ms - 0.05);
    ck_assert((int)flags[log->rows - 1] & MK_FLAG_FAULT);
    mk_log_free(log);
}

START_TEST(a_pulled_cable_is_shown_logged_and_forgiven)
{
    int tries = 0;
    while (!get_going())
        ck_assert_int_lt(++tries, TRIES);
    emu_usb_unplug(&bench.usb);
    int64_t pulled_ns = mk_clock_now_ns(&clock_), shown_ns = pulled_ns;
    while (fault_now() == MK_FAULT_NONE && shown_ns - pulled_ns < 2000000000) {
        usleep(200);
        shown_ns = mk_clock_now_ns(&clock_);
    }
    ck_assert_int_eq(fault_now(), MK_FAULT_UNPLUGGED);
    if (getenv("MECHKIT_CAMPAIGN"))
        printf("pulled cable: fault shown after %.1f ms\n", 1e-6 * (double)(shown_ns - pulled_ns));
    ck_assert_int_eq(session_halt(&session, &err), MK_OK);
    log_is_complete(300);
    mk_clock_sleep_until(&clock_, pulled_ns + 60000000);
    ck_assert_int_eq(mk_emulated_run(&bench.board), MK_OK);
    ck_assert_double_eq(bench.board.u, 0.0); /* the board's watchdog, with nobody there */

    ck_assert_int_eq(session_setup(&session, "pendubot-mid", &err), MK_ERR_NOTFOUND);
    mk_clock_sleep_until(&clock_, pulled_ns + 100000000);
    emu_usb_plug(&bench.usb);
    ck_assert_msg(session_setup(&session, "pendubot-mid", &err) == MK_OK, "%s", err.message);
    struct mk_board_sample s;
    ck_assert_int_eq(mk_board_exchange(session.board, 0.0, &s), MK_OK);
}
END_TEST

Suite *suite_replug(void)
{
    Suite *s = suite_create("replug");
    TCase *t = tcase_create("replug");
    tcase_add_checked_fixture(t, setup, teardown);
    tcase_set_timeout(t, 60);
    tcase_add_test(t, a_pulled_cable_is_shown_logged_and_forgiven);
    suite_add_tcase(s, t);
    return s;
}
