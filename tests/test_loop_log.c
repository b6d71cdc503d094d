/* What the log of a run says: its rows, its columns, what made it; the same in every run that is
 * the same, and readable when the program was killed. The loop is that of support/bench.h. */
#include "suites.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "ctrl/loop_priv.h"
#include "mechkit/loop.h"
#include "mechkit/sim.h"
#include "support/bench.h"

START_TEST(row_k_holds_the_command_applied_from_k_on)
{
    bench_use_plant(MK_PLANT_INERTIA_WHEEL);
    bench_build_driving(NULL, 4);
    struct mk_log *log = bench_log_of_run(0.2);
    const double *u = mk_log_get(log, "u"), *q = mk_log_get(log, "q1"), *t = mk_log_get(log, "t");
    ck_assert_uint_eq(log->rows, 100);
    ck_assert_double_eq(u[0], 0.0);
    ck_assert_double_eq(u[1], 4.0);

    /* An independent simulation driven by the log's own u (zero-order hold) passes through q. */
    struct mk_sim *sim;
    const double x0[] = {0, 0};
    ck_assert_int_eq(mk_sim_create(&bench.model, NULL, &sim, NULL), MK_OK);
    ck_assert_int_eq(mk_sim_reset(sim, 0.0, x0, NULL), MK_OK);
    for (size_t k = 0; k + 1 < log->rows; k++) {
        const double command[MK_MAX_INPUTS] = {u[k], 0};
        ck_assert_double_eq_tol(mk_sim_state(sim)[0], q[k], 0.51 * 2 * M_PI / 4000);
        ck_assert_int_eq(mk_sim_advance(sim, t[k + 1], command, NULL), MK_OK);
    }
    ck_assert_double_gt(mk_sim_state(sim)[0], 1.0);
    mk_sim_destroy(sim);
    mk_log_free(log);
}
END_TEST

/* The test's law says its tick, and that it balances from tick 100 on. */
START_TEST(a_row_has_the_reference_and_the_phase_that_its_law_says)
{
    bench_build(NULL);
    struct mk_log *log = bench_log_of_run(0.3);
    const double *ref = mk_log_get(log, "ref"), *phase = mk_log_get(log, "phase");
    ck_assert_uint_eq(log->rows, 150);
    for (size_t k = 0; k < log->rows; k++) {
        ck_assert_double_eq(ref[k], (double)k);
        ck_assert_double_eq(phase[k], k < 100 ? MK_PHASE_SWINGUP : MK_PHASE_BALANCE);
    }
    mk_log_free(log);
}
END_TEST

START_TEST(the_log_says_what_made_it)
{
    char key[] = "operator", value[] = "Ada", rig[] = "rig", kind[] = "my own words";
    char board[200];
    const struct mk_log_meta meta[] = {{key, value}, {rig, kind}};
    bench_build(NULL);
    bench_set_law(0.5, 2, 1e18);
    snprintf(bench.loop->identity.serial, sizeof bench.loop->identity.serial, "A17");
    ck_assert_int_eq(mk_loop_start(bench.loop, bench.path, meta, 2, NULL), MK_OK);
    bench_wait_for(0.1);
    bench_halt();
    struct mk_log *log = bench_read_log();
    ck_assert_str_eq(mk_log_find_meta(log, "operator"), "Ada");
    ck_assert_str_eq(mk_log_find_meta(log, "rig"), "my own words");
    ck_assert_str_eq(mk_log_find_meta(log, "sample_rate_hz"), "500");
    ck_assert_str_eq(mk_log_find_meta(log, "encoder_cpr"), "4000 4000");
    ck_assert_ptr_null(mk_log_find_meta(log, "joint_unit"));
    ck_assert_ptr_null(mk_log_find_meta(log, "encoder_resolution"));
    ck_assert_str_eq(mk_log_find_meta(log, "u_to_torque"), "0.00494");
    ck_assert_str_eq(mk_log_find_meta(log, "u_max"), "10");
    ck_assert_str_eq(mk_log_find_meta(log, "setup"), "test-law");
    ck_assert_str_eq(mk_log_find_meta(log, "gains"), "0.5 2");
    ck_assert_ptr_nonnull(
        strstr(mk_log_find_meta(log, "parameters"), "bias=0.5 scale=2 break_at="));
    snprintf(board, sizeof board, "%s, %s, serial A17", bench.loop->identity.name,
             bench.loop->identity.firmware);
    ck_assert_str_eq(mk_log_find_meta(log, "board"), board);
    ck_assert_ptr_nonnull(strstr(board, "virtual"));
    ck_assert_ptr_nonnull(strstr(mk_log_find_meta(log, "program"), MK_VERSION));
    ck_assert_str_eq(mk_log_find_meta(log, "realtime"), "simulated time");
    ck_assert_str_eq(mk_log_find_meta(log, "velocity"), "tracking");
    ck_assert_str_eq(mk_log_find_meta(log, "phases"), "0 idle, 1 swing-up, 2 balance, 3 track");
    ck_assert_ptr_null(mk_log_find_meta(log, "reference"));
    ck_assert_ptr_null(mk_log_find_meta(log, "clock"));
    ck_assert_ptr_nonnull(strstr(mk_log_find_meta(log, "summary"), "50 samples, 0 late"));
    static const char *const columns[] = {"t",    "q1",  "q2",    "u",    "dq1",     "dq2",  "enc1",
                                          "enc2", "ref", "phase", "tick", "late_us", "flags"};
    ck_assert_uint_eq(log->column_count, 13);
    for (int i = 0; i < 13; i++)
        ck_assert_str_eq(log->columns[i].name, columns[i]);
    mk_log_free(log);
}
END_TEST

/* A reference that is longer than all that is said of a run may be is cut, and so is a change to
 * it; more words of the caller than there is room for are left out. */
START_TEST(what_there_is_no_room_for_is_cut_and_the_log_is_whole)
{
    enum { TERMS = 2500, WORDS = 70 };
    static char text[2 * TERMS], key[WORDS][16];
    static struct mk_log_meta meta[WORDS];
    struct mk_signal *signal;
    for (int i = 0; i < TERMS; i++)
        memcpy(text + 2 * i, i + 1 < TERMS ? "0+" : "0", 2);
    for (int i = 0; i < WORDS; i++) {
        snprintf(key[i], sizeof key[i], "word%d", i);
        meta[i] = (struct mk_log_meta){key[i], key[i]};
    }
    ck_assert_int_eq(mk_signal_create(text, &signal, NULL), MK_OK);
    bench_build(NULL);
    bench.ctrl.ref = signal;
    bench_start();
    bench_wait_for(0.1);
    ck_assert_int_eq(mk_loop_set_signal(bench.loop, NULL, NULL), MK_OK);
    bench_wait_for(0.1);
    ck_assert_int_eq(mk_loop_set_signal(bench.loop, signal, NULL), MK_OK);
    bench_wait_for(0.1);
    bench_halt();
    struct mk_log *log = bench_read_log();
    const char *reference = mk_log_find_meta(log, "reference");
    ck_assert_uint_gt(strlen(reference), 3000);
    ck_assert_int_eq(strncmp(text, reference, strlen(reference)), 0);
    ck_assert_str_eq(mk_log_find_meta(log, "sample_rate_hz"), "500");
    ck_assert_str_eq(mk_log_find_meta(log, "program"), "");
    ck_assert_uint_eq(log->rows, 150);
    mk_log_free(log);
    bench.ctrl.ref = NULL;
    ck_assert_int_eq(mk_loop_start(bench.loop, bench.path, meta, WORDS, NULL), MK_OK);
    bench_wait_for(0.1);
    bench_halt();
    log = bench_read_log();
    ck_assert_str_eq(mk_log_find_meta(log, "word0"), "word0");
    ck_assert_str_eq(mk_log_find_meta(log, "word63"), "word63");
    ck_assert_ptr_null(mk_log_find_meta(log, "word64"));
    ck_assert_ptr_null(mk_log_find_meta(log, "setup"));
    mk_log_free(log);
    mk_signal_destroy(signal);
}
END_TEST

START_TEST(the_log_of_an_axis_that_slides_has_its_units)
{
    bench_use_plant(MK_PLANT_CART_POLE);
    bench_build(NULL);
    struct mk_log *log = bench_log_of_run(0.1);
    ck_assert_str_eq(mk_log_find_meta(log, "joint_unit"), "m rad");
    mk_log_free(log);
}
END_TEST

START_TEST(a_rig_of_one_joint_has_no_columns_of_a_second)
{
    bench_use_plant(MK_PLANT_PENDULUM);
    bench_build(NULL);
    struct mk_log *log = bench_log_of_run(0.1);
    ck_assert_ptr_nonnull(mk_log_get(log, "enc1"));
    ck_assert_ptr_null(mk_log_get(log, "q2"));
    ck_assert_uint_eq(log->column_count, 10);
    mk_log_free(log);
}
END_TEST

static int said_cpr[MK_MAX_JOINTS];

static enum mk_status other_identify(struct mk_board *board, struct mk_board_identity *out,
                                     struct mk_error *err)
{
    enum mk_status st = bench.own->identify(board, out, err);
    memcpy(out->encoder_cpr, said_cpr, sizeof said_cpr);
    return st;
}

/* The log of a rig whose board says so many counts a turn of its two encoders. */
static struct mk_log *log_of_board_with(enum mk_plant_kind kind, int cpr1, int cpr2)
{
    bench_use_plant(kind);
    bench_build(NULL);
    said_cpr[0] = cpr1;
    said_cpr[1] = cpr2;
    mk_loop_destroy(bench.loop);
    bench_override_board()->identify = other_identify;
    ck_assert_int_eq(mk_loop_create(bench.board, &bench.ctrl, &bench.config, &bench.loop, NULL),
                     MK_OK);
    return bench_log_of_run(0.1);
}

START_TEST(a_board_knows_its_encoders_better_than_the_model_if_it_knows_them)
{
    struct mk_log *log = log_of_board_with(MK_PLANT_PENDUBOT, 0, 2000);
    ck_assert_str_eq(mk_log_find_meta(log, "encoder_cpr"), "4000 2000");
    mk_log_free(log);
}
END_TEST

/* By the turn of what it rolls on: the model alone has the size of a count. */
START_TEST(an_axis_that_slides_is_counted_as_the_model_has_it_whatever_the_board_says)
{
    struct mk_log *log = log_of_board_with(MK_PLANT_CART_POLE, 2000, 4000);
    ck_assert_int_eq(bench.model.encoder_cpr[0], 0);
    ck_assert_double_eq_tol(atof(mk_log_find_meta(log, "encoder_resolution")),
                            mk_model_count(&bench.model, 0), 1e-12);
    mk_log_free(log);
}
END_TEST

/* Who looks into the log between two waits finds what was waited for. */
START_TEST(after_a_wait_in_simulated_time_its_rows_are_in_the_file)
{
    bench_build(NULL);
    bench_start();
    for (int k = 1; k <= 3; k++) {
        bench_wait_for(0.1);
        ck_assert_uint_eq(bench_rows_logged(), 50 * k);
    }
}
END_TEST

/* Nobody but the one who waits takes samples from the ring then. */
START_TEST(a_run_in_simulated_time_that_is_longer_than_the_ring_is_logged_whole)
{
    bench.config.ring_samples = 64;
    bench_build(NULL);
    struct mk_log *log = bench_log_of_run(2.0);
    ck_assert_uint_eq(log->rows, 1000);
    ck_assert_ptr_nonnull(strstr(mk_log_find_meta(log, "summary"), "0 not logged"));
    mk_log_free(log);
}
END_TEST

static char *slurp(const char *path, size_t *size)
{
    FILE *f = fopen(path, "rb");
    ck_assert_ptr_nonnull(f);
    char *data = malloc(1 << 22);
    *size = fread(data, 1, 1 << 22, f);
    fclose(f);
    return data;
}

static char *noisy_run(uint64_t seed, size_t *size)
{
    mk_clock_init_simulated(&bench.clock);
    bench.board_config.seed = seed;
    bench.board_config.count_noise = 1.0;
    bench_build("at 300 drop 2; at 400 delay 3ms; from 500 to 600 noise 2");
    bench_start();
    bench_set_law(1.5, 1, 1e18);
    bench_wait_for(1.0);
    bench_set_law(-1.5, 1, 1e18);
    bench_wait_for(1.0);
    bench_halt();
    bench_drop_loop();
    return slurp(bench.path, size);
}

START_TEST(the_same_seed_gives_the_same_log_byte_for_byte)
{
    size_t n1, n2, n3;
    char *one = noisy_run(11, &n1), *two = noisy_run(11, &n2), *three = noisy_run(12, &n3);
    ck_assert_uint_gt(n1, 50000);
    ck_assert_uint_eq(n1, n2);
    ck_assert_mem_eq(one, two, n1);
    ck_assert(n1 != n3 || memcmp(one, three, n1) != 0);
    free(one);
    free(two);
    free(three);
}
END_TEST

START_TEST(angles_go_on_across_the_wrap_of_the_counter)
{
    /* 800 rad/s at 4 million counts a turn pass 2^23 every 16 ms; see both kinds of wrap. */
    bench_use_plant(MK_PLANT_INERTIA_WHEEL);
    bench.model.encoder_cpr[0] = 1000000;
    bench.config.limits.jump_rad[0] = 5.0;
    bench_build_driving(NULL, 10);
    struct mk_log *log = bench_log_of_run(0.5);
    const double *enc = mk_log_get(log, "enc1"), *q = mk_log_get(log, "q1");
    size_t last = log->rows - 1;
    ck_assert_double_gt(enc[last], 2.0 * (1 << 23));
    for (size_t k = 1; k < log->rows; k++)
        ck_assert_double_ge(q[k], q[k - 1]);
    ck_assert_double_eq_tol(q[last], enc[last] * 2 * M_PI / 1e6, 1e-9);
    mk_log_free(log);
}
END_TEST

START_TEST(a_killed_run_leaves_a_readable_log)
{
    int ready[2];
    ck_assert_int_eq(pipe(ready), 0);
    pid_t pid = fork();
    ck_assert_int_ge(pid, 0);
    if (pid == 0) {
        bench_use_real_time(1000);
        bench_build(NULL);
        if (mk_loop_start(bench.loop, bench.path, NULL, 0, NULL) != MK_OK ||
            bench_wait_for(0.5) != MK_OK || write(ready[1], "x", 1) != 1)
            _exit(1);
        (void)!bench_wait_for(60);
        _exit(2);
    }
    char c;
    close(ready[1]);
    ck_assert_int_eq(read(ready[0], &c, 1), 1);
    close(ready[0]);
    kill(pid, SIGKILL);
    int status;
    ck_assert_int_eq(waitpid(pid, &status, 0), pid);
    ck_assert(WIFSIGNALED(status));
    ck_assert_uint_gt(bench_rows_logged(), 300);
}
END_TEST

Suite *suite_loop_log(void)
{
    Suite *s = suite_create("loop_log");
    TCase *t = tcase_create("simulated time");
    tcase_add_checked_fixture(t, bench_setup, bench_teardown);
    tcase_set_timeout(t, 20);
    tcase_add_test(t, row_k_holds_the_command_applied_from_k_on);
    tcase_add_test(t, a_row_has_the_reference_and_the_phase_that_its_law_says);
    tcase_add_test(t, the_log_says_what_made_it);
    tcase_add_test(t, what_there_is_no_room_for_is_cut_and_the_log_is_whole);
    tcase_add_test(t, the_log_of_an_axis_that_slides_has_its_units);
    tcase_add_test(t, a_rig_of_one_joint_has_no_columns_of_a_second);
    tcase_add_test(t, a_board_knows_its_encoders_better_than_the_model_if_it_knows_them);
    tcase_add_test(t, an_axis_that_slides_is_counted_as_the_model_has_it_whatever_the_board_says);
    tcase_add_test(t, after_a_wait_in_simulated_time_its_rows_are_in_the_file);
    tcase_add_test(t, a_run_in_simulated_time_that_is_longer_than_the_ring_is_logged_whole);
    tcase_add_test(t, the_same_seed_gives_the_same_log_byte_for_byte);
    tcase_add_test(t, angles_go_on_across_the_wrap_of_the_counter);
    suite_add_tcase(s, t);

    t = tcase_create("real time");
    tcase_add_checked_fixture(t, bench_setup, bench_teardown);
    tcase_set_timeout(t, 30);
    tcase_add_test(t, a_killed_run_leaves_a_readable_log);
    suite_add_tcase(s, t);
    return s;
}
