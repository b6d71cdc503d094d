/* The same swing-up over every bus, in simulated time, sampled by the host's clock or by the
 * board's: all carry the same numbers, so the runs are the same, sample for sample. */
#include "suites.h"

#include <stdio.h>
#include <string.h>

#include "emu/bench.h"
#include "mechkit/loop.h"
#include "support/files.h"

#define SECONDS 4.0

static const char *const buses[] = {"usb",    "parport",    "parport-byte", "parport-nibble", "tcp",
                                    "serial", "serial-cut", "tcp-stepped",  "virtual"};
#define BUSES ((int)(sizeof buses / sizeof buses[0]))

static struct mk_model model;

static void must(enum mk_status st, const struct mk_error *err)
{
    ck_assert_msg(st == MK_OK, "%s: %s", mk_status_name(st), err->message);
}

/* Swings up and balances; the log is the caller's. */
static struct mk_log *swing_up(const char *bus, bool stream)
{
    static struct emu_bench bench;
    struct mk_clock clock;
    struct mk_error err = MK_ERROR_INIT;
    struct mk_board *board;
    struct mk_ctrl *ctrl;
    struct mk_loop *loop;
    struct mk_log *log;
    struct mk_loop_config loop_config;
    struct mk_loop_snapshot end;
    char name[32];
    mk_clock_init_simulated(&clock);
    struct mk_board_config config = {.model = &model, .clock = &clock};
    emu_bench_init(&bench, bus, &config);
    config.device = bench.device;
    must(mk_board_open(&bench.ops, &config, &board, &err), &err);
    mk_loop_config_default(&model, &loop_config);
    loop_config.stream = stream;
    must(mk_ctrl_create(mk_ctrl_setup_by_name("pendubot-mid"), &model, 1.0 / loop_config.rate_hz,
                        NULL, &ctrl, &err),
         &err);
    must(mk_loop_create(board, ctrl, &loop_config, &loop, &err), &err);
    snprintf(name, sizeof name, "%s.csv", bus);
    must(mk_loop_start(loop, scratch(name), NULL, 0, &err), &err);
    must(mk_loop_wait(loop, SECONDS, NULL, NULL, NULL, &err), &err);
    mk_loop_get_snapshot(loop, &end);
    ck_assert_int_eq(end.sample.phase, MK_PHASE_BALANCE);
    must(mk_loop_halt(loop, &err), &err);
    mk_loop_destroy(loop);
    mk_ctrl_destroy(ctrl);
    mk_board_close(board);
    emu_bench_free(&bench);
    must(mk_log_read(scratch(name), &log, &err), &err);
    return log;
}

static void runs_are_the_same(const char *bus, bool stream)
{
    static const char *const columns[] = {"t", "q1", "q2", "dq1", "dq2", "u", "phase", "flags"};
    mk_model_default(MK_PLANT_PENDUBOT, &model);
    struct mk_log *here = swing_up("virtual", false), *there = swing_up(bus, stream);
    ck_assert_uint_eq(here->rows, there->rows);
    ck_assert_uint_ge(here->rows, (size_t)(SECONDS * 500));
    for (size_t c = 0; c < sizeof columns / sizeof columns[0]; c++) {
        const double *a = mk_log_get(here, columns[c]), *b = mk_log_get(there, columns[c]);
        for (size_t k = 0; k < here->rows; k++)
            ck_assert_msg(a[k] == b[k], "%s, row %zu: %.17g over %s, %.17g on the virtual board",
                          columns[c], k, b[k], bus, a[k]);
    }
    mk_log_free(here);
    mk_log_free(there);
}

START_TEST(a_run_is_the_same_over_every_bus)
{
    runs_are_the_same(buses[_i], false);
}
END_TEST

START_TEST(a_run_by_the_boards_clock_is_the_same)
{
    runs_are_the_same(buses[_i], true);
}
END_TEST

Suite *suite_bus_runs(void)
{
    Suite *s = suite_create("bus_runs");
    TCase *t = tcase_create("bus_runs");
    tcase_set_timeout(t, 60);
    tcase_add_loop_test(t, a_run_is_the_same_over_every_bus, 0, BUSES - 1);
    tcase_add_loop_test(t, a_run_by_the_boards_clock_is_the_same, 0, BUSES);
    suite_add_tcase(s, t);
    return s;
}
