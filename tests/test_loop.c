/* The control loop on boards that behave: order, log, parameters, real time. */
#include "suites.h"

#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "ctrl/loop_priv.h"
#include "mechkit/loop.h"
#include "mechkit/rig.h"
#include "support/bench.h"
#include "support/heap.h"

/* --- the order of things --------------------------------------------------------------------- */

START_TEST(a_run_goes_through_its_states)
{
    bench_build(NULL);
    ck_assert_int_eq(bench_look().state, MK_LOOP_IDLE);
    bench_start();
    ck_assert_int_eq(bench_look().state, MK_LOOP_RUNNING);
    ck_assert_int_eq(mk_loop_start(bench.loop, NULL, NULL, 0, NULL), MK_ERR_STATE);
    ck_assert_int_eq(bench_wait_for(0.5), MK_OK);
    ck_assert_uint_eq(bench_look().ticks, 250);
    ck_assert_double_eq_tol(bench_look().caught_t, 0.2, 1e-12);
    ck_assert_double_eq_tol(bench_look().balanced_since, 0.2, 1e-12);
    bench_halt();
    ck_assert_int_eq(bench_look().state, MK_LOOP_IDLE);
    bench_halt();
    bench_start();
    ck_assert_uint_eq(bench_look().ticks, 0);
}
END_TEST

START_TEST(a_loop_refuses_what_it_cannot_run)
{
    bench_build(NULL);
    struct mk_loop *loop = NULL;
    struct mk_error err = MK_ERROR_INIT;
    bench.config.rate_hz = 5000;
    ck_assert_int_eq(mk_loop_create(bench.board, &bench.ctrl, &bench.config, &loop, &err),
                     MK_ERR_RANGE);
    bench.config.rate_hz = 1000; /* the controller is made for 500 */
    ck_assert_int_eq(mk_loop_create(bench.board, &bench.ctrl, &bench.config, &loop, &err),
                     MK_ERR_INVALID);
    ck_assert_ptr_null(loop);
    ck_assert_int_eq(mk_loop_start(bench.loop, "/nonexistent/x.csv", NULL, 0, &err),
                     MK_ERR_NOTFOUND);
    ck_assert_int_eq(bench_look().state, MK_LOOP_IDLE);
    ck_assert_int_eq(mk_loop_wait(bench.loop, NAN, NULL, NULL, NULL, &err), MK_ERR_RANGE);
}
END_TEST

START_TEST(a_tick_allocates_nothing)
{
    struct mk_signal *signal;
    ck_assert_int_eq(mk_signal_create("0.1*sin(6*t)+0.01*noise(5,1)", &signal, NULL), MK_OK);
    bench_use_plant((enum mk_plant_kind)_i);
    bench_build("at 50 drop; at 60 delay 5ms; at 70 jump 1 by 1");
    ck_assert_int_eq(mk_loop_start(bench.loop, NULL, NULL, 0, NULL), MK_OK);
    bench_wait_for(0.01);
    bench_set_law(2, 1, 1e18);
    ck_assert_int_eq(mk_loop_set_signal(bench.loop, signal, NULL), MK_OK);
    unsigned long before = heap_allocations();
    enum mk_status st = bench_wait_for(0.5);
    unsigned long after = heap_allocations();
    bench_drop_loop();
    mk_signal_destroy(signal);
    ck_assert_int_eq(st, MK_OK);
    ck_assert_uint_eq(after, before);
    /* The counting itself works (volatile: the compiler leaves out what nobody looks at): */
    void *volatile block = malloc(1 + (size_t)_i);
    free(block);
    ck_assert_int_eq(heap_allocations() > before, heap_is_counted());
}
END_TEST

static bool reached_tick_50(const struct mk_loop_snapshot *s, void *user)
{
    (void)user;
    return s->sample.tick >= 50;
}

static bool never(const struct mk_loop_snapshot *s, void *user)
{
    (void)s;
    (void)user;
    return false;
}

START_TEST(waiting_ends_with_its_condition_its_time_or_a_cancel)
{
    volatile int cancel = 0;
    bench_build(NULL);
    bench_start();
    ck_assert_int_eq(mk_loop_wait(bench.loop, 1, reached_tick_50, NULL, NULL, NULL), MK_OK);
    ck_assert_uint_eq(bench_look().sample.tick, 50);
    ck_assert_int_eq(mk_loop_wait(bench.loop, 0.1, never, NULL, &cancel, NULL), MK_ERR_TIMEOUT);
    ck_assert_uint_eq(bench_look().sample.tick, 100);
    cancel = 1;
    ck_assert_int_eq(mk_loop_wait(bench.loop, 0.1, NULL, NULL, &cancel, NULL), MK_ERR_INTR);
}
END_TEST

START_TEST(time_passes_for_the_rig_when_nothing_runs)
{
    bench_build(NULL);
    bench_start();
    bench_set_law(3, 1, 1e18);
    bench_wait_for(0.1);
    bench_halt();
    double t = mk_rig_time(mk_board_virtual_rig(bench.board));
    ck_assert_int_eq(bench_wait_for(2.0), MK_OK);
    ck_assert_double_eq_tol(mk_rig_time(mk_board_virtual_rig(bench.board)), t + 2.0, 1e-6);
}
END_TEST

/* --- by the board's clock -------------------------------------------------------------------- */

START_TEST(a_board_that_cannot_stream_is_refused)
{
    struct mk_loop *loop = NULL;
    struct mk_error err = MK_ERROR_INIT;
    bench_build_on("null");
    bench.config.stream = true;
    ck_assert_int_eq(mk_loop_create(bench.board, &bench.ctrl, &bench.config, &loop, &err),
                     MK_ERR_NOTSUP);
    ck_assert_ptr_nonnull(strstr(err.message, "null"));
    ck_assert_ptr_null(loop);
}
END_TEST

START_TEST(a_period_of_a_fraction_of_a_microsecond_is_refused)
{
    struct mk_loop *loop = NULL;
    struct mk_error err = MK_ERROR_INIT;
    bench_build(NULL);
    bench.config.stream = true;
    bench.config.rate_hz = 300.0;
    bench.ctrl.dt = 1.0 / 300.0;
    ck_assert_int_eq(mk_loop_create(bench.board, &bench.ctrl, &bench.config, &loop, &err),
                     MK_ERR_RANGE);
    ck_assert_ptr_null(loop);
}
END_TEST

/* Two runs that differ in whose clock made them: the same rows. */
START_TEST(the_boards_clock_and_ours_make_the_same_run)
{
    struct mk_log *log[2];
    for (int k = 0; k < 2; k++) {
        bench.config.stream = k == 1;
        bench_build(NULL);
        bench_start();
        bench_set_law(2, 1, 1e18);
        ck_assert_int_eq(bench_wait_for(0.5), MK_OK);
        bench_halt();
        log[k] = bench_read_log();
        bench_teardown();
        bench_setup();
    }
    ck_assert_ptr_null(mk_log_find_meta(log[0], "clock"));
    ck_assert_str_eq(mk_log_find_meta(log[1], "clock"), "board");
    ck_assert_uint_eq(log[0]->rows, log[1]->rows);
    for (const char *const *name = (const char *const[]){"t", "q1", "q2", "u", "flags", NULL};
         *name; name++)
        for (size_t i = 0; i < log[0]->rows; i++)
            ck_assert_double_eq(mk_log_get(log[0], *name)[i], mk_log_get(log[1], *name)[i]);
    mk_log_free(log[0]);
    mk_log_free(log[1]);
}
END_TEST

/* What was lost is a row without a reading, and the ticks stay those of the board's time. */
START_TEST(a_lost_sample_costs_one_row_and_no_time)
{
    bench.config.stream = true;
    bench_build("at 50 drop; at 60 mute");
    struct mk_log *log = bench_log_of_run(0.5);
    const double *tick = mk_log_get(log, "tick"), *flags = mk_log_get(log, "flags");
    int lost = 0;
    for (size_t i = 0; i < log->rows; i++) {
        lost += ((int)flags[i] & MK_FLAG_LOST) != 0;
        ck_assert_double_eq(tick[i], (double)i);
    }
    ck_assert_int_eq(lost, 2);
    mk_log_free(log);
}
END_TEST

START_TEST(a_fault_ends_the_stream_and_the_log_shows_what_followed)
{
    static const struct {
        const char *script;
        enum mk_fault fault;
    } rows[] = {{"at 50 alarm", MK_FAULT_BOARD},
                {"at 50 disconnect", MK_FAULT_UNPLUGGED},
                {"at 50 jump 2 by 500", MK_FAULT_JUMP}};
    bench.config.stream = true;
    bench_build(rows[_i].script);
    bench_start();
    bench_set_law(1, 1, 1e18);
    ck_assert_int_eq(bench_wait_for(1.0), MK_ERR_FAULT);
    ck_assert_int_eq(bench_look().fault, rows[_i].fault);
    bench_halt();
    /* Where nobody hears the host any more it is the board's watchdog. */
    mk_clock_sleep_until(&bench.clock, mk_clock_now_ns(&bench.clock) + 25000000);
    bench_assert_motor_is_off();
    struct mk_log *log = bench_read_log();
    bool tail = rows[_i].fault != MK_FAULT_UNPLUGGED;
    ck_assert_uint_ge(log->rows, tail ? 150 : 50);
    mk_log_free(log);
}
END_TEST

START_TEST(streaming_in_real_time_keeps_the_boards_rate)
{
    bench_use_real_time(500);
    bench.config.stream = true;
    bench_build(NULL);
    bench_start();
    ck_assert_int_eq(bench_wait_for(0.4), MK_OK);
    ck_assert_uint_ge(bench_look().sample.tick, 199);
    bench_halt();
    struct mk_log *log = bench_read_log();
    const double *tick = mk_log_get(log, "tick"), *t = mk_log_get(log, "t");
    for (size_t i = 1; i < log->rows; i++) {
        ck_assert_double_gt(tick[i], tick[i - 1]);
        ck_assert_double_eq_tol(t[i], tick[i] / 500.0, 1e-9);
    }
    mk_log_free(log);
}
END_TEST

/* --- what the log says ----------------------------------------------------------------------- */

START_TEST(row_k_holds_the_command_applied_from_k_on)
{
    bench_use_plant(MK_PLANT_INERTIA_WHEEL);
    bench_build(NULL);
    bench_set_law(4, 1, 1e18);
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

START_TEST(the_log_of_an_axis_that_slides_has_its_units)
{
    bench_use_plant(MK_PLANT_CART_POLE);
    bench_build(NULL);
    struct mk_log *log = bench_log_of_run(0.1);
    ck_assert_str_eq(mk_log_find_meta(log, "joint_unit"), "m rad");
    mk_log_free(log);
}
END_TEST

/* Speed of joint 1 at tick `tick` of a run that accelerates, on a board with those faults. */
static double speed_at(const char *faults, double tick)
{
    double speed = NAN;
    mk_clock_init_simulated(&bench.clock);
    bench_build(faults);
    bench_set_law(3.0, 1, 1e18);
    bench_run(0.1);
    bench_drop_loop();
    struct mk_log *log = bench_read_log();
    const double *at = mk_log_get(log, "tick"), *v = mk_log_get(log, "dq1");
    for (size_t k = 0; k < log->rows; k++)
        speed = at[k] == tick ? v[k] : speed;
    mk_log_free(log);
    return speed;
}

START_TEST(default_limits_hold_at_any_rate_of_the_loop)
{
    bench_use_plant(MK_PLANT_INERTIA_WHEEL);
    bench.config.rate_hz = 100; /* the limits are for 500 */
    bench_build(NULL);
    bench_set_law(8, 1, 1e18);
    bench_start();
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_loop_wait(bench.loop, 5, NULL, NULL, NULL, &err) == MK_OK, "%s", err.message);
    ck_assert_double_gt(bench_look().sample.v[0], 400);
}
END_TEST

START_TEST(the_kalman_filter_expects_of_a_slide_what_its_unit_makes_usual)
{
    bench_use_plant(MK_PLANT_CART_POLE);
    bench.config.velocity.kind = MK_VELOCITY_KALMAN;
    bench_build(NULL);
    const struct mk_velocity *speed = bench.loop->run.speed;
    double usual = bench.config.velocity.accel_radps2;
    ck_assert_double_eq_tol(speed[0].config.accel_radps2,
                            usual * mk_model_joint_scale(&bench.model, 0), 1e-12);
    ck_assert_double_eq(speed[1].config.accel_radps2, usual);
}
END_TEST

START_TEST(after_skipped_samples_speeds_are_those_of_a_run_without)
{
    double whole = speed_at(NULL, 22), skipped = speed_at("at 20 delay 5ms", 22);
    ck_assert_double_gt(whole, 0.5);
    /* The late answer was read a millisecond after its tick; one step of the estimator too many or
     * too few would make a third. */
    ck_assert_msg(fabs(skipped - whole) < 0.15 * whole, "%g, not %g rad/s", skipped, whole);
}
END_TEST

/* Who looks into the log between two waits finds what was waited for. */
START_TEST(after_a_wait_in_simulated_time_its_rows_are_in_the_file)
{
    bench_build(NULL);
    bench_start();
    for (int k = 1; k <= 3; k++) {
        bench_wait_for(0.1);
        struct mk_log *log = bench_read_log();
        ck_assert_uint_eq(log->rows, 50 * k);
        mk_log_free(log);
    }
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
    bench_build(NULL);
    bench_set_law(10, 1, 1e18);
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

START_TEST(new_parameters_take_effect_together_in_one_sample)
{
    bench_build(NULL);
    bench_set_law(1, 2, 1e18);
    bench_start();
    bench_wait_for(0.1);
    bench_set_law(-0.5, 3, 1e18);
    bench_wait_for(0.1);
    bench_halt();
    struct mk_log *log = bench_read_log();
    const double *u = mk_log_get(log, "u"), *flags = mk_log_get(log, "flags");
    for (size_t k = 1; k < log->rows; k++) {
        ck_assert_double_eq(u[k], k <= 50 ? 2.0 : -1.5); /* never 6 or -1 */
        ck_assert_int_eq(((int)flags[k] & MK_FLAG_PARAMS) != 0, k == 50);
    }
    ck_assert_ptr_nonnull(
        strstr(mk_log_find_meta(log, "changed"), "at 0.100000 s: bias=-0.5 scale=3"));
    mk_log_free(log);
}
END_TEST

/* The bench's law takes its bias from the signal, where there is one. */
START_TEST(another_signal_takes_effect_in_one_sample_and_is_logged)
{
    struct mk_signal *first, *second;
    ck_assert_int_eq(mk_signal_create("1", &first, NULL), MK_OK);
    ck_assert_int_eq(mk_signal_create("3*step(0)", &second, NULL), MK_OK);
    bench_build(NULL);
    bench_set_law(0, 0.5, 1e18);
    ck_assert_int_eq(mk_loop_set_signal(bench.loop, first, NULL), MK_OK);
    bench_start();
    bench_wait_for(0.1);
    ck_assert_int_eq(mk_loop_set_signal(bench.loop, second, NULL), MK_OK);
    bench_wait_for(0.1);
    bench_halt();
    struct mk_log *log = bench_read_log();
    const double *u = mk_log_get(log, "u"), *flags = mk_log_get(log, "flags");
    for (size_t k = 1; k < log->rows; k++) {
        ck_assert_double_eq(u[k], k <= 50 ? 0.5 : 1.5);
        ck_assert_int_eq((int)flags[k] & (MK_FLAG_SIGNAL | MK_FLAG_PARAMS),
                         k == 50 ? MK_FLAG_SIGNAL : 0);
    }
    ck_assert_str_eq(mk_log_find_meta(log, "reference"), "1");
    ck_assert_str_eq(mk_log_find_meta(log, "changed"), "at 0.100000 s: reference 3*step(0)");
    mk_log_free(log);
    bench_drop_loop();
    mk_signal_destroy(first);
    mk_signal_destroy(second);
}
END_TEST

/* Another bias for every sample, up to the 300th. */
static bool change_the_bias(const struct mk_loop_snapshot *s, void *user)
{
    (void)user;
    if (s->ticks <= 300)
        bench_set_law(1e-3 * (double)s->ticks, 1, 1e18);
    return false;
}

/* More of them between two writes than the log keeps: those it has are right, and of the others it
 * says that they were. */
START_TEST(every_change_of_parameters_is_noted_at_its_time_however_many_there_are)
{
    bench_build(NULL);
    bench_set_law(0, 1, 1e18);
    bench_start();
    ck_assert_int_eq(mk_loop_wait(bench.loop, 0.7, change_the_bias, NULL, NULL, NULL),
                     MK_ERR_TIMEOUT);
    bench_set_law(4, 1, 1e18);
    bench_wait_for(0.1);
    bench_halt();
    struct mk_log *log = bench_read_log();
    int tick = 0, known = 0;
    for (size_t m = 0; m < log->meta_count; m++) {
        char expected[48];
        const char *value = log->meta[m].value;
        if (strcmp(log->meta[m].key, "changed") != 0)
            continue;
        tick = tick == 300 ? 350 : tick + 1;
        snprintf(expected, sizeof expected, "at %.6f s: ", 0.002 * tick);
        ck_assert_msg(strncmp(value, expected, strlen(expected)) == 0, "%d: %s", tick, value);
        if (strstr(value, "not known"))
            continue;
        known++;
        const char *bias = strstr(value, "bias=");
        ck_assert_msg(bias && atof(bias + 5) == (tick == 350 ? 4.0 : 1e-3 * tick), "%s", value);
    }
    ck_assert_int_eq(tick, 350);
    ck_assert_int_ge(known, 257);
    mk_log_free(log);
}
END_TEST

START_TEST(parameters_and_signal_changed_at_once_are_both_taken)
{
    struct mk_signal *signal;
    ck_assert_int_eq(mk_signal_create("2", &signal, NULL), MK_OK);
    bench_build(NULL);
    bench_set_law(1, 1, 1e18);
    bench_start();
    bench_wait_for(0.1);
    ck_assert_int_eq(mk_loop_set_signal(bench.loop, signal, NULL), MK_OK);
    bench_set_law(1, 0.25, 1e18);
    bench_wait_for(0.1);
    ck_assert_double_eq(bench_look().sample.u, 0.5);
    bench_halt();
    struct mk_log *log = bench_read_log();
    const double *flags = mk_log_get(log, "flags");
    ck_assert_int_eq((int)flags[50], MK_FLAG_PARAMS | MK_FLAG_SIGNAL);
    mk_log_free(log);
    bench_drop_loop();
    mk_signal_destroy(signal);
}
END_TEST

START_TEST(parameters_out_of_range_change_nothing)
{
    const double bad[PARAM_COUNT] = {1e10, 1, 1e18};
    struct mk_error err = MK_ERROR_INIT;
    bench_build(NULL);
    bench_start();
    ck_assert_int_eq(mk_loop_set_params(bench.loop, bad, PARAM_COUNT, &err), MK_ERR_RANGE);
    ck_assert_ptr_nonnull(strstr(err.message, "bias"));
    ck_assert_int_eq(mk_loop_set_params(bench.loop, bad, 1, &err), MK_ERR_INVALID);
    bench_wait_for(0.1);
    ck_assert_double_eq(bench_look().sample.u, 0.0);
}
END_TEST

START_TEST(a_wish_beyond_the_limit_is_cut_and_marked)
{
    bench_build(NULL);
    bench_set_law(25, 1, 1e18);
    bench_start();
    bench_wait_for(0.01);
    ck_assert_double_eq(bench_look().sample.u, 10.0);
    ck_assert(bench_look().sample.flags & MK_FLAG_SATURATED);
}
END_TEST

START_TEST(a_lost_exchange_leaves_a_marked_empty_row)
{
    bench_build("at 20 drop 2; at 40 mute");
    struct mk_log *log = bench_log_of_run(0.2);
    const double *q = mk_log_get(log, "q1"), *flags = mk_log_get(log, "flags");
    ck_assert_uint_eq(log->rows, 100);
    for (size_t k = 0; k < log->rows; k++) {
        bool lost = k == 20 || k == 21 || k == 40;
        ck_assert_int_eq(isnan(q[k]) != 0, lost);
        ck_assert_int_eq((int)flags[k], lost ? MK_FLAG_LOST : 0);
    }
    struct mk_loop_stats stats;
    mk_loop_get_stats(bench.loop, &stats);
    ck_assert_uint_eq(stats.lost, 3);
    ck_assert_uint_eq(stats.gaps, 0);
    mk_log_free(log);
}
END_TEST

START_TEST(a_late_answer_skips_samples_and_says_so)
{
    bench_build("at 20 delay 5ms; at 40 delay 1200us; at 60 drop");
    struct mk_log *log = bench_log_of_run(0.2);
    const double *tick = mk_log_get(log, "tick"), *flags = mk_log_get(log, "flags"),
                 *late = mk_log_get(log, "late_us"), *t = mk_log_get(log, "t");
    /* Tick 20 ends at 45 ms: the deadline of 21 (42 ms) and that of 22 (44 ms) have passed. */
    ck_assert_double_eq(tick[20], 20);
    ck_assert_double_eq(tick[21], 22);
    ck_assert_double_eq(t[21], 0.044);
    ck_assert_int_eq((int)flags[21], MK_FLAG_OVERRUN | MK_FLAG_LATE);
    ck_assert_double_eq_tol(late[21], 3000.0, 1e-6);
    ck_assert_double_eq(tick[22], 23);
    ck_assert_int_eq((int)flags[22], 0);
    /* 1.2 ms of 2 delay nobody. */
    for (size_t k = 22; k < log->rows; k++)
        ck_assert_double_eq(late[k], 0.0);
    /* The script counts exchanges, so a tick that is skipped moves what follows. */
    ck_assert_int_eq((int)flags[60], MK_FLAG_LOST);
    ck_assert_double_eq(tick[60], 61);
    mk_log_free(log);
}
END_TEST

/* --- real time ------------------------------------------------------------------------------- */

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
    struct mk_log *log = bench_read_log();
    ck_assert_uint_gt(log->rows, 300);
    mk_log_free(log);
}
END_TEST

START_TEST(a_second_at_1_khz_loses_nothing)
{
    struct mk_loop_stats stats;
    bench_use_real_time(1000);
    bench_build(NULL);
    bench_set_law(1, 1, 1e18);
    bench_run(1.0);
    mk_loop_get_stats(bench.loop, &stats);
    struct mk_log *log = bench_read_log();
    const double *tick = mk_log_get(log, "tick"), *t = mk_log_get(log, "t"),
                 *flags = mk_log_get(log, "flags");
    /* Every sample made is in the log, and every one that was not made is marked. */
    ck_assert_uint_eq(stats.ticks, log->rows);
    ck_assert_uint_eq(stats.lost + stats.gaps + stats.dropped, 0);
    ck_assert_double_ge(t[log->rows - 1], 0.999);
    for (size_t k = 1; k < log->rows; k++) {
        bool skipped = tick[k] != tick[k - 1] + 1;
        ck_assert_int_eq(skipped, ((int)flags[k] & MK_FLAG_OVERRUN) != 0);
        ck_assert_double_eq(t[k], tick[k] / 1000);
    }
    ck_assert_double_le(stats.late_p50_us, stats.late_p99_us);
    ck_assert_double_le(stats.late_p99_us, stats.late_p999_us);
    ck_assert_double_le(stats.late_p999_us, stats.late_max_us);
    ck_assert_str_eq(mk_log_find_meta(log, "realtime"), stats.note[0] ? stats.note : "granted");
    mk_log_free(log);
}
END_TEST

static void *press_stop(void *arg)
{
    struct mk_loop *loop = arg;
    const struct timespec pause = {.tv_nsec = 100000000};
    nanosleep(&pause, NULL);
    mk_loop_estop(loop);
    return NULL;
}

START_TEST(another_thread_can_stop_a_real_time_run)
{
    pthread_t presser;
    bench_use_real_time(1000);
    bench_build(NULL);
    bench_set_law(2, 1, 1e18);
    bench_start();
    ck_assert_int_eq(pthread_create(&presser, NULL, press_stop, bench.loop), 0);
    ck_assert_int_eq(bench_wait_for(20), MK_ERR_FAULT);
    pthread_join(presser, NULL);
    ck_assert_int_eq(bench_look().fault, MK_FAULT_ESTOP);
    ck_assert_double_eq(bench_look().sample.u, 0.0);
    bench_halt();
}
END_TEST

START_TEST(gains_change_while_a_real_time_run_goes_on)
{
    bench_use_real_time(1000);
    bench_build(NULL);
    bench_set_law(0, 0, 1e18);
    bench_start();
    /* Products of a consistent pair are +1 or -1; a torn pair would give another. */
    for (int k = 0; k < 40; k++) {
        bench_set_law(k % 2 ? 2 : -4, k % 2 ? 0.5 : 0.25, 1e18);
        struct mk_loop_snapshot s = bench_look();
        ck_assert(s.sample.u == 0 || fabs(s.sample.u) == 1.0);
        ck_assert_int_eq(bench_wait_for(0.003), MK_OK);
    }
    bench_halt();
    struct mk_log *log = bench_read_log();
    const double *u = mk_log_get(log, "u"), *flags = mk_log_get(log, "flags");
    int changes = 0;
    for (size_t k = 0; k < log->rows; k++) {
        ck_assert(u[k] == 0 || fabs(u[k]) == 1.0);
        changes += ((int)flags[k] & MK_FLAG_PARAMS) != 0;
    }
    ck_assert_int_ge(changes, 20);
    mk_log_free(log);
}
END_TEST

START_TEST(a_real_time_run_can_be_unplugged)
{
    bench_use_real_time(1000);
    bench_build("at 100 disconnect");
    bench_set_law(1, 1, 1e18);
    bench_run_into(MK_FAULT_UNPLUGGED, 10);
    bench_halt();
}
END_TEST

START_TEST(destroying_a_running_loop_turns_the_motor_off)
{
    bench_use_real_time(500);
    bench_build(NULL);
    bench_set_law(2, 1, 1e18);
    bench_start();
    ck_assert_int_eq(bench_wait_for(0.05), MK_OK);
    mk_loop_destroy(bench.loop);
    bench.loop = NULL;
    struct mk_board_sample s;
    ck_assert_int_eq(mk_board_exchange(bench.board, 0.0, &s), MK_OK);
    ck_assert_double_eq(s.u_applied, 0.0);
    struct mk_log *log = bench_read_log();
    ck_assert_ptr_nonnull(mk_log_find_meta(log, "summary"));
    mk_log_free(log);
}
END_TEST

START_TEST(a_start_that_is_interrupted_is_given_up)
{
    static volatile int interrupted;
    interrupted = 1;
    bench.config.cancel = &interrupted;
    bench_build(NULL);
    ck_assert_int_eq(mk_loop_start(bench.loop, NULL, NULL, 0, NULL), MK_ERR_INTR);
    ck_assert_int_eq(bench_look().state, MK_LOOP_IDLE);
    interrupted = 0;
    bench_start();
}
END_TEST

START_TEST(after_missed_ticks_the_law_is_told_how_much_time_went_by)
{
    bench_build("at 100 delay 7ms; at 200 delay 5ms");
    bench_start();
    ck_assert_int_eq(bench_wait_for(1), MK_OK);
    struct mk_loop_stats stats;
    mk_loop_get_stats(bench.loop, &stats);
    ck_assert_uint_eq(stats.overruns, 2);
    ck_assert_uint_lt(stats.ticks, 500);
    ck_assert_double_eq_tol(bench.told_s, bench_look().sample.t + 0.002, 1e-9);
}
END_TEST

START_TEST(a_lost_exchange_leaves_a_row_without_readings_of_either_joint)
{
    bench_build("at 50 drop");
    struct mk_log *log = bench_log_of_run(0.2);
    ck_assert(isnan(mk_log_get(log, "q1")[50]) && isnan(mk_log_get(log, "q2")[50]));
    ck_assert(!isnan(mk_log_get(log, "q1")[51]) && !isnan(mk_log_get(log, "q2")[51]));
    mk_log_free(log);
}
END_TEST

START_TEST(a_run_begins_with_figures_of_its_own)
{
    struct mk_loop_stats stats;
    bench_build("at 50 drop 2; at 100 delay 7ms");
    bench_start();
    ck_assert_int_eq(bench_wait_for(0.5), MK_OK);
    mk_loop_get_stats(bench.loop, &stats);
    ck_assert_uint_eq(stats.lost, 2);
    ck_assert_uint_gt(stats.overruns, 0);
    ck_assert_uint_gt(stats.late, 0);
    bench_halt();
    bench_start(); /* of simulated time no tick has been made yet */
    mk_loop_get_stats(bench.loop, &stats);
    ck_assert_uint_eq(stats.ticks + stats.late + stats.overruns + stats.lost + stats.gaps, 0);
    ck_assert_double_eq(stats.late_max_us, 0.0);
}
END_TEST

/* As many values do not exceed it, and it is not above them by more than the width of a bin. */
START_TEST(a_reader_gets_the_newest_snapshot_and_it_stays_while_it_is_read)
{
    static struct mk_publish p;
    static struct mk_loop_snapshot put;
    memset(&p, _i ? 0xff : 0, sizeof p);
    mk_publish_init(&p);
    const struct mk_loop_snapshot *got = mk_publish_get(&p);
    for (put.ticks = 1; put.ticks < 20; put.ticks++) {
        ck_assert_uint_eq(got->ticks, (put.ticks - 1) / 3 * 3);
        mk_publish_put(&p, &put);
        ck_assert_uint_eq(got->ticks, (put.ticks - 1) / 3 * 3);
        for (int again = 0; put.ticks % 3 == 0 && again < 2; again++) {
            got = mk_publish_get(&p);
            ck_assert_uint_eq(got->ticks, put.ticks);
        }
    }
}
END_TEST

START_TEST(a_percentile_is_within_a_bin_of_the_value_that_it_stands_for)
{
    static struct mk_histogram h;
    mk_histogram_clear(&h);
    ck_assert_double_eq(mk_histogram_percentile_us(&h, 0.5), 0.0);
    ck_assert_double_eq(mk_histogram_mean_us(&h), 0.0);
    double sum = 0.0;
    for (int i = 1; i <= 1000; i++) {
        int64_t ns = (int64_t)i * i * i; /* 1 ns .. 1 s */
        mk_histogram_add(&h, ns);
        sum += (double)ns * 1e-3;
    }
    for (int i = 10; i <= 1000; i += 10) {
        double exact = 1e-3 * (double)i * i * i, told = mk_histogram_percentile_us(&h, i / 1000.0);
        ck_assert_double_ge(told, exact * (1.0 - 1e-12));
        ck_assert_double_le(told, exact * (1.0 + 1.0 / (1 << MK_HISTOGRAM_SUB_BITS)));
    }
    ck_assert_double_eq(mk_histogram_percentile_us(&h, 1.0), 1e6);
    ck_assert_double_eq(mk_histogram_max_us(&h), 1e6);
    ck_assert_double_eq_tol(mk_histogram_mean_us(&h), sum / 1000.0, 1e-6);
    /* Short times have bins of their own. */
    for (int ns = 1; ns < 2 << MK_HISTOGRAM_SUB_BITS; ns++) {
        mk_histogram_clear(&h);
        mk_histogram_add(&h, ns);
        mk_histogram_add(&h, 1000000);
        ck_assert_double_eq_tol(mk_histogram_percentile_us(&h, 0.5), 1e-3 * ns, 1e-9);
    }
    /* What is longer than any bin, and what is before its time. */
    mk_histogram_clear(&h);
    mk_histogram_add(&h, -5);
    ck_assert_double_eq(mk_histogram_percentile_us(&h, 1.0), 0.0);
    mk_histogram_add(&h, INT64_MAX);
    ck_assert_double_eq(mk_histogram_percentile_us(&h, 0.5), 0.0);
    mk_histogram_add(&h, INT64_C(1) << 40); /* the first that is too long */
    ck_assert_double_gt(mk_histogram_percentile_us(&h, 0.6), 1e6);
    ck_assert_double_eq_tol(mk_histogram_max_us(&h), 1e-3 * (double)INT64_MAX, 1.0);
    ck_assert_double_gt(mk_histogram_percentile_us(&h, 1.0), 1e6);
}
END_TEST

START_TEST(a_histogram_that_is_cleared_has_forgotten_everything)
{
    static struct mk_histogram h;
    mk_histogram_clear(&h);
    mk_histogram_add(&h, 8000000);
    mk_histogram_clear(&h);
    mk_histogram_add(&h, 1000);
    ck_assert_double_eq_tol(mk_histogram_mean_us(&h), 1.0, 1e-9);
    ck_assert_double_eq_tol(mk_histogram_max_us(&h), 1.0, 1e-9);
    ck_assert_double_le(mk_histogram_percentile_us(&h, 1.0), 1.1);
}
END_TEST

Suite *suite_loop(void)
{
    Suite *s = suite_create("loop");
    TCase *t = tcase_create("simulated time");
    tcase_add_checked_fixture(t, bench_setup, bench_teardown);
    tcase_set_timeout(t, 20);
    tcase_add_test(t, a_run_goes_through_its_states);
    tcase_add_test(t, a_loop_refuses_what_it_cannot_run);
    tcase_add_loop_test(t, a_tick_allocates_nothing, 0, MK_PLANT_COUNT);
    tcase_add_test(t, a_board_that_cannot_stream_is_refused);
    tcase_add_test(t, a_period_of_a_fraction_of_a_microsecond_is_refused);
    tcase_add_test(t, the_boards_clock_and_ours_make_the_same_run);
    tcase_add_test(t, a_lost_sample_costs_one_row_and_no_time);
    tcase_add_loop_test(t, a_fault_ends_the_stream_and_the_log_shows_what_followed, 0, 3);
    tcase_add_test(t, streaming_in_real_time_keeps_the_boards_rate);
    tcase_add_test(t, waiting_ends_with_its_condition_its_time_or_a_cancel);
    tcase_add_test(t, time_passes_for_the_rig_when_nothing_runs);
    tcase_add_test(t, row_k_holds_the_command_applied_from_k_on);
    tcase_add_test(t, the_log_says_what_made_it);
    tcase_add_test(t, after_a_wait_in_simulated_time_its_rows_are_in_the_file);
    tcase_add_test(t, a_rig_of_one_joint_has_no_columns_of_a_second);
    tcase_add_test(t, the_log_of_an_axis_that_slides_has_its_units);
    tcase_add_test(t, default_limits_hold_at_any_rate_of_the_loop);
    tcase_add_test(t, the_kalman_filter_expects_of_a_slide_what_its_unit_makes_usual);
    tcase_add_test(t, after_skipped_samples_speeds_are_those_of_a_run_without);
    tcase_add_test(t, the_same_seed_gives_the_same_log_byte_for_byte);
    tcase_add_test(t, angles_go_on_across_the_wrap_of_the_counter);
    tcase_add_test(t, new_parameters_take_effect_together_in_one_sample);
    tcase_add_test(t, another_signal_takes_effect_in_one_sample_and_is_logged);
    tcase_add_test(t, every_change_of_parameters_is_noted_at_its_time_however_many_there_are);
    tcase_add_test(t, parameters_and_signal_changed_at_once_are_both_taken);
    tcase_add_test(t, parameters_out_of_range_change_nothing);
    tcase_add_test(t, a_wish_beyond_the_limit_is_cut_and_marked);
    tcase_add_test(t, a_lost_exchange_leaves_a_marked_empty_row);
    tcase_add_test(t, a_late_answer_skips_samples_and_says_so);
    tcase_add_test(t, a_start_that_is_interrupted_is_given_up);
    tcase_add_test(t, after_missed_ticks_the_law_is_told_how_much_time_went_by);
    tcase_add_test(t, a_lost_exchange_leaves_a_row_without_readings_of_either_joint);
    tcase_add_test(t, a_run_begins_with_figures_of_its_own);
    tcase_add_loop_test(t, a_reader_gets_the_newest_snapshot_and_it_stays_while_it_is_read, 0, 2);
    tcase_add_test(t, a_percentile_is_within_a_bin_of_the_value_that_it_stands_for);
    tcase_add_test(t, a_histogram_that_is_cleared_has_forgotten_everything);
    suite_add_tcase(s, t);

    t = tcase_create("real time");
    tcase_add_checked_fixture(t, bench_setup, bench_teardown);
    tcase_set_timeout(t, 30);
    tcase_add_test(t, a_second_at_1_khz_loses_nothing);
    tcase_add_test(t, another_thread_can_stop_a_real_time_run);
    tcase_add_test(t, gains_change_while_a_real_time_run_goes_on);
    tcase_add_test(t, a_real_time_run_can_be_unplugged);
    tcase_add_test(t, destroying_a_running_loop_turns_the_motor_off);
    tcase_add_test(t, a_killed_run_leaves_a_readable_log);
    suite_add_tcase(s, t);
    return s;
}
