/* The parallel port back end on a port that is not there: which mode, who may, and that it is given
 * back. What every back end promises is in test_board.c, faults on the way in test_bus_faults.c. */
#include "suites.h"

#include <fcntl.h>
#include <linux/parport.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "driver/parport.h"
#include "emu/bench.h"

static struct mk_model model;
static struct mk_clock clock_;
static struct mk_board_config config;
static struct mk_board *board;
static struct emu_bench bench;
static struct mk_error err;

static void setup(void)
{
    mk_model_default(MK_PLANT_PENDUBOT, &model);
    mk_clock_init_simulated(&clock_);
    config = (struct mk_board_config){.model = &model, .clock = &clock_};
    board = NULL;
    err = (struct mk_error)MK_ERROR_INIT;
    memset(&bench, 0, sizeof bench);
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

START_TEST(the_fastest_common_mode_is_taken)
{
    static const struct {
        const char *bench;
        unsigned port;
        enum mk_parport_mode mode;
    } rows[] = {
        {"parport", ~0u, MK_PARPORT_EPP},
        {"parport", PARPORT_MODE_PCSPP | PARPORT_MODE_TRISTATE, MK_PARPORT_BYTE},
        {"parport", PARPORT_MODE_PCSPP, MK_PARPORT_NIBBLE},
        {"parport-byte", ~0u, MK_PARPORT_BYTE},
        {"parport-nibble", ~0u, MK_PARPORT_NIBBLE},
        {"parport-byte", PARPORT_MODE_PCSPP, MK_PARPORT_NIBBLE},
    };
    struct mk_parport port;
    emu_bench_init(&bench, rows[_i].bench, &config);
    bench.pp.port_modes = rows[_i].port;
    ck_assert_int_eq(mk_parport_open(&port, NULL, &err), MK_OK);
    ck_assert_str_eq(mk_parport_mode_name(port.mode), mk_parport_mode_name(rows[_i].mode));
    mk_parport_close(&port);
}
END_TEST

/* Data goes both ways in it: to turn the port round, for every exchange, would take the time that
 * EPP is there to save. */
START_TEST(a_port_in_epp_mode_stays_in_it)
{
    struct mk_board_sample s;
    emu_bench_init(&bench, "parport", &config);
    ck_assert_int_eq(try_open(NULL), MK_OK);
    for (int k = 0; k < 3; k++) {
        ck_assert_int_eq(mk_board_exchange(board, 1.0, &s), MK_OK);
        ck_assert_int_eq(bench.pp.mode, IEEE1284_MODE_EPP);
    }
}
END_TEST

START_TEST(the_port_is_held_alone_and_given_back)
{
    emu_bench_init(&bench, "parport", &config);
    for (int k = 0; k < 2; k++) {
        ck_assert_int_eq(try_open("/dev/parport0"), MK_OK);
        ck_assert(bench.pp.excl && bench.pp.claimed);
        bench.pp.released_in = -1;
        mk_board_close(board);
        board = NULL;
        ck_assert(!bench.pp.excl && !bench.pp.claimed);
        ck_assert_int_eq(bench.pp.released_in, IEEE1284_MODE_COMPAT);
    }
}
END_TEST

/* It would wait for seconds where a board does not shake hands. */
START_TEST(the_kernel_waits_for_a_board_no_longer_than_an_exchange_may_take)
{
    struct mk_parport port;
    emu_bench_init(&bench, "parport", &config);
    ck_assert_int_gt(bench.pp.patience_us, MK_WIRE_EXCHANGE_NS / 1000);
    ck_assert_int_eq(mk_parport_open(&port, NULL, &err), MK_OK);
    ck_assert_int_gt(bench.pp.patience_us, 0);
    ck_assert_int_le(bench.pp.patience_us, MK_WIRE_EXCHANGE_NS / 1000);
    mk_parport_close(&port);
}
END_TEST

START_TEST(it_is_given_back_when_opening_fails)
{
    emu_bench_init(&bench, "parport", &config);
    model.u_max = 11.0;
    ck_assert_int_eq(try_open(NULL), MK_ERR_RANGE);
    ck_assert(!bench.pp.claimed);
    ck_assert_int_eq(bench.pp.node.write_fd, -1);
}
END_TEST

START_TEST(what_stands_in_the_way_is_named)
{
    emu_bench_init(&bench, "parport", &config);
    ck_assert_int_eq(try_open("/dev/parport3"), MK_ERR_NOTFOUND);
    ck_assert_ptr_nonnull(strstr(err.message, "modprobe"));
    ck_assert_int_eq(try_open("/dev/null"), MK_ERR_NOTFOUND);
    ck_assert_ptr_nonnull(strstr(err.message, "no parallel port"));
    bench.pp.denied = true;
    ck_assert_int_eq(try_open(NULL), MK_ERR_PERM);
    ck_assert_ptr_nonnull(strstr(err.message, "udev rule"));
    bench.pp.denied = false;
    bench.pp.taken = true;
    ck_assert_int_eq(try_open(NULL), MK_ERR_BUSY);
    ck_assert_ptr_nonnull(strstr(err.message, "rmmod lp"));
    bench.pp.taken = false;
    bench.pp.unplugged = true;
    ck_assert_int_eq(try_open(NULL), MK_ERR_NOTFOUND);
    ck_assert_ptr_nonnull(strstr(err.message, "plugged in"));
    bench.pp.unplugged = false;
    ck_assert_int_eq(try_open(NULL), MK_OK);
}
END_TEST

START_TEST(ports_are_listed)
{
    struct mk_board_found found[4];
    ck_assert_int_eq(mk_parport_find(found, 4), 0);
    emu_bench_init(&bench, "parport", &config);
    ck_assert_int_eq(mk_parport_find(found, 4), 1);
    ck_assert_str_eq(found[0].device, "/dev/parport0");
    ck_assert_int_eq(found[0].status, MK_OK);
    ck_assert_int_eq(mk_parport_find(NULL, 0), 1); /* counted all the same */
    bench.pp.denied = true;
    ck_assert_int_eq(mk_parport_find(found, 4), 1);
    ck_assert_int_eq(found[0].status, MK_ERR_PERM);
}
END_TEST

START_TEST(a_port_that_is_not_listed_is_opened_by_its_name_alone)
{
    struct mk_board_found found[4];
    emu_bench_init(&bench, "parport", &config);
    snprintf(bench.pp.path, sizeof bench.pp.path, "/dev/parport3");
    ck_assert_int_eq(mk_parport_find(found, 4), 1);
    ck_assert_int_eq(try_open(NULL), MK_OK);
    mk_board_close(board);
    board = NULL;
    snprintf(bench.pp.path, sizeof bench.pp.path, "/dev/parport4");
    ck_assert_int_eq(mk_parport_find(found, 4), 0);
    ck_assert_int_eq(try_open(NULL), MK_ERR_NOTFOUND);
    ck_assert_int_eq(try_open("/dev/parport4"), MK_OK);
}
END_TEST

/* The first file that it opens has the descriptor 0 then. */
START_TEST(a_program_without_standard_input_has_its_port_too)
{
    struct mk_board_sample s;
    struct mk_board_found found[4];
    emu_bench_init(&bench, "parport", &config);
    int kept = dup(STDIN_FILENO);
    close(STDIN_FILENO);
    ck_assert_int_eq(mk_parport_find(found, 4), 1);
    ck_assert_int_eq(found[0].status, MK_OK);
    ck_assert_int_eq(try_open(NULL), MK_OK);
    ck_assert_int_eq(bench.pp.node.write_fd, STDIN_FILENO);
    ck_assert_int_eq(mk_board_exchange(board, 1.0, &s), MK_OK);
    mk_board_close(board);
    board = NULL;
    ck_assert(!bench.pp.claimed);
    ck_assert_int_eq(bench.pp.node.write_fd, -1);
    dup2(kept, STDIN_FILENO);
    close(kept);
}
END_TEST

/* Even past the deadline there is one look, at a board that has nothing to say and takes nothing.
 */
START_TEST(silence_at_the_port_is_over_at_its_deadline)
{
    static const char *const benches[] = {"parport", "parport-byte", "parport-nibble"};
    const uint8_t *bytes, byte = 0;
    size_t n;
    struct mk_parport port;
    emu_bench_init(&bench, benches[_i], &config);
    ck_assert_int_eq(mk_parport_open(&port, NULL, &err), MK_OK);
    ck_assert_int_eq(mk_parport_link.receive(&port, &bytes, &n, 0), MK_ERR_TIMEOUT);
    bench.pp.blocked_until_ns = INT64_MAX;
    ck_assert_int_eq(mk_parport_link.send(&port, &byte, 1, 0), MK_ERR_TIMEOUT);
    mk_parport_close(&port);
}
END_TEST

static int64_t read_clock(clockid_t which)
{
    struct timespec t;
    clock_gettime(which, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

/* After a millisecond, for an answer and for a board that takes nothing: of 50 it uses few. */
START_TEST(a_host_that_waits_at_the_port_sleeps)
{
    const uint8_t *bytes, byte = 0;
    size_t n;
    struct mk_parport port;
    emu_bench_init(&bench, "parport", &config);
    ck_assert_int_eq(mk_parport_open(&port, NULL, &err), MK_OK);
    bench.pp.blocked_until_ns = INT64_MAX;
    for (int sends = 0; sends < 2; sends++) {
        const int64_t begun_ns = read_clock(CLOCK_MONOTONIC);
        const int64_t used_ns = read_clock(CLOCK_THREAD_CPUTIME_ID);
        ck_assert_int_eq(sends ? mk_parport_link.send(&port, &byte, 1, begun_ns + 50000000)
                               : mk_parport_link.receive(&port, &bytes, &n, begun_ns + 50000000),
                         MK_ERR_TIMEOUT);
        ck_assert_int_ge(read_clock(CLOCK_MONOTONIC) - begun_ns, 50000000);
        ck_assert_int_lt(read_clock(CLOCK_THREAD_CPUTIME_ID) - used_ns, 25000000);
    }
    mk_parport_close(&port);
}
END_TEST

/* Nobody says so on a parallel port: requests stay unanswered. */
START_TEST(a_board_that_is_switched_off_loses_samples_and_comes_back)
{
    struct mk_board_sample s;
    emu_bench_init(&bench, _i ? "parport-nibble" : "parport", &config);
    ck_assert_int_eq(try_open(NULL), MK_OK);
    ck_assert_int_eq(mk_board_exchange(board, 1.0, &s), MK_OK);
    bench.pp.unplugged = true;
    for (int k = 0; k < 3; k++) {
        enum mk_status st = mk_board_exchange(board, 1.0, &s);
        ck_assert(st == MK_ERR_PROTO || st == MK_ERR_TIMEOUT);
    }
    bench.pp.unplugged = false;
    ck_assert_int_eq(mk_board_exchange(board, 1.0, &s), MK_OK);
}
END_TEST

/* The port says so by ENXIO, which from a port that is gone means something else. */
START_TEST(a_board_that_refuses_a_negotiation_for_a_moment_is_not_taken_for_gone)
{
    struct mk_board_sample s;
    emu_bench_init(&bench, _i ? "parport-nibble" : "parport-byte", &config);
    ck_assert_int_eq(try_open(NULL), MK_OK);
    ck_assert_int_eq(mk_board_exchange(board, 1.0, &s), MK_OK);
    unsigned modes = bench.pp.board_modes;
    bench.pp.board_modes = 0;
    ck_assert_int_eq(mk_board_exchange(board, 1.0, &s), MK_ERR_PROTO);
    bench.pp.board_modes = modes;
    ck_assert_int_eq(mk_board_exchange(board, 1.0, &s), MK_OK);
}
END_TEST

Suite *suite_parport(void)
{
    Suite *s = suite_create("parport");
    TCase *t = tcase_create("parport");
    tcase_add_checked_fixture(t, setup, teardown);
    tcase_add_loop_test(t, the_fastest_common_mode_is_taken, 0, 6);
    tcase_add_loop_test(t, a_board_that_refuses_a_negotiation_for_a_moment_is_not_taken_for_gone, 0,
                        2);
    tcase_add_test(t, a_port_in_epp_mode_stays_in_it);
    tcase_add_test(t, the_port_is_held_alone_and_given_back);
    tcase_add_test(t, the_kernel_waits_for_a_board_no_longer_than_an_exchange_may_take);
    tcase_add_test(t, it_is_given_back_when_opening_fails);
    tcase_add_test(t, what_stands_in_the_way_is_named);
    tcase_add_test(t, ports_are_listed);
    tcase_add_test(t, a_port_that_is_not_listed_is_opened_by_its_name_alone);
    tcase_add_test(t, a_program_without_standard_input_has_its_port_too);
    tcase_add_loop_test(t, silence_at_the_port_is_over_at_its_deadline, 0, 3);
    tcase_add_test(t, a_host_that_waits_at_the_port_sleeps);
    tcase_add_loop_test(t, a_board_that_is_switched_off_loses_samples_and_comes_back, 0, 2);
    suite_add_tcase(s, t);
    return s;
}
