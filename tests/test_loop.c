/* The control loop on boards that behave, misbehave and vanish. */
#include "suites.h"

#include <errno.h>
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "mechkit/loop.h"
#include "mechkit/rig.h"
#include "support/heap.h"

/* --- a controller that does what a test wants ------------------------------------------------ */

enum { BIAS, SCALE, BREAK_AT, PARAM_COUNT };

/* u = bias * scale, or NaN from tick break_at on. Phase balance from tick 100 on. */
static void law_step(struct mk_ctrl *ctrl, const struct mk_ctrl_input *in,
                     struct mk_ctrl_output *out)
{
    out->u = ctrl->value[BIAS] * ctrl->value[SCALE];
    out->ref = (double)in->tick;
    out->phase = in->tick >= 100 ? MK_PHASE_BALANCE : MK_PHASE_SWINGUP;
    if ((double)in->tick >= ctrl->value[BREAK_AT])
        out->u = NAN;
}

static void law_reset(struct mk_ctrl *ctrl)
{
    (void)ctrl;
}

static const struct mk_ctrl_ops law = {
    .name = "test-law",
    .help = "constant command",
    .plants = (1u << MK_PLANT_COUNT) - 1u,
    .param_count = PARAM_COUNT,
    .param = {{"bias", "", "", -1e9, 1e9, 0.0, true},
              {"scale", "", "", -1e9, 1e9, 1.0, true},
              {"break_at", "", "", 0.0, 1e18, 1e18, false}},
    .reset = law_reset,
    .step = law_step,
};

/* --- one rig with a loop around it ----------------------------------------------------------- */

struct bench {
    struct mk_model model;
    struct mk_clock clock;
    struct mk_board *board;
    struct mk_ctrl ctrl;
    struct mk_loop_config config;
    struct mk_board_config board_config;
    struct mk_loop *loop;
    char path[64];
};
static struct bench b;

static void setup(void)
{
    memset(&b, 0, sizeof b);
    mk_model_default(MK_PLANT_PENDUBOT, &b.model);
    mk_clock_init_simulated(&b.clock);
    mk_loop_config_default(&b.model, &b.config);
    b.board_config.model = &b.model;
    b.board_config.clock = &b.clock;
    snprintf(b.path, sizeof b.path, "/tmp/mechkit-test-loop-XXXXXX");
    int fd = mkstemp(b.path);
    ck_assert_int_ge(fd, 0);
    close(fd);
}

static void drop_loop(void)
{
    mk_loop_destroy(b.loop);
    mk_board_close(b.board);
    b.loop = NULL;
    b.board = NULL;
}

static void teardown(void)
{
    drop_loop();
    unlink(b.path);
}

static void use_plant(enum mk_plant_kind kind)
{
    mk_model_default(kind, &b.model);
    mk_safety_default(&b.model, 1.0 / b.config.rate_hz, &b.config.limits);
}

/* Wall-clock tests run on shared machines: only what they are about may trip. */
static void use_real_time(double rate_hz)
{
    mk_clock_init_monotonic(&b.clock);
    b.config.rate_hz = rate_hz;
    mk_safety_default(&b.model, 1.0 / rate_hz, &b.config.limits);
    b.config.limits.late_limit = 1000000;
    b.config.watchdog_ms = 0;
}

static void build_on(const char *backend)
{
    struct mk_error err = MK_ERROR_INIT;
    enum mk_status st =
        mk_board_open(mk_board_backend_by_name(backend), &b.board_config, &b.board, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    b.ctrl = (struct mk_ctrl){.ops = &law, .model = b.model, .dt = 1.0 / b.config.rate_hz};
    for (int i = 0; i < PARAM_COUNT; i++)
        b.ctrl.value[i] = law.param[i].initial;
    st = mk_loop_create(b.board, &b.ctrl, &b.config, &b.loop, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
}

static void build(const char *faults)
{
    b.board_config.fault_script = faults;
    build_on("virtual");
}

static void start(void)
{
    struct mk_error err = MK_ERROR_INIT;
    enum mk_status st = mk_loop_start(b.loop, b.path, NULL, 0, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
}

static enum mk_status wait_for(double seconds)
{
    return mk_loop_wait(b.loop, seconds, NULL, NULL, NULL, NULL);
}

static struct mk_loop_snapshot look(void)
{
    struct mk_loop_snapshot s;
    mk_loop_get_snapshot(b.loop, &s);
    return s;
}

static void set_law(double bias, double scale, double break_at)
{
    const double value[PARAM_COUNT] = {bias, scale, break_at};
    ck_assert_int_eq(mk_loop_set_params(b.loop, value, PARAM_COUNT, NULL), MK_OK);
}

static struct mk_log *read_log(void)
{
    struct mk_log *log = NULL;
    struct mk_error err = MK_ERROR_INIT;
    enum mk_status st = mk_log_read(b.path, &log, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    return log;
}

/* The plant's own word: it slows down and nothing drives it. */
static void assert_motor_is_off(void)
{
    struct mk_rig *rig = mk_board_virtual_rig(b.board);
    double x[MK_MAX_STATES];
    memcpy(x, mk_rig_state(rig), sizeof(double) * 4);
    struct mk_sim *free_run;
    const double u[MK_MAX_INPUTS] = {0, 0};
    ck_assert_int_eq(mk_sim_create(&b.model, NULL, &free_run, NULL), MK_OK);
    ck_assert_int_eq(mk_sim_reset(free_run, 0.0, x, NULL), MK_OK);
    ck_assert_int_eq(mk_sim_advance(free_run, 0.1, u, NULL), MK_OK);
    mk_clock_sleep_until(&b.clock, mk_clock_now_ns(&b.clock) + 100000000);
    const double *now = mk_rig_state(mk_board_virtual_rig(b.board));
    int n = 2 * mk_model_joints(&b.model);
    for (int i = 0; i < n; i++)
        ck_assert_double_eq_tol(now[i], mk_sim_state(free_run)[i], 1e-5 * (1 + fabs(now[i])));
    mk_sim_destroy(free_run);
}

/* --- the order of things --------------------------------------------------------------------- */

START_TEST(a_run_goes_through_its_states)
{
    build(NULL);
    ck_assert_int_eq(look().state, MK_LOOP_IDLE);
    start();
    ck_assert_int_eq(look().state, MK_LOOP_RUNNING);
    ck_assert_int_eq(mk_loop_start(b.loop, NULL, NULL, 0, NULL), MK_ERR_STATE);
    ck_assert_int_eq(wait_for(0.5), MK_OK);
    ck_assert_uint_eq(look().ticks, 250);
    ck_assert_double_eq_tol(look().caught_t, 0.2, 1e-12);
    ck_assert_double_eq_tol(look().balanced_since, 0.2, 1e-12);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
    ck_assert_int_eq(look().state, MK_LOOP_IDLE);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
    start();
    ck_assert_uint_eq(look().ticks, 0);
}
END_TEST

START_TEST(a_loop_refuses_what_it_cannot_run)
{
    build(NULL);
    struct mk_loop *loop = NULL;
    struct mk_error err = MK_ERROR_INIT;
    b.config.rate_hz = 5000;
    ck_assert_int_eq(mk_loop_create(b.board, &b.ctrl, &b.config, &loop, &err), MK_ERR_RANGE);
    b.config.rate_hz = 1000; /* the controller is made for 500 */
    ck_assert_int_eq(mk_loop_create(b.board, &b.ctrl, &b.config, &loop, &err), MK_ERR_INVALID);
    ck_assert_ptr_null(loop);
    ck_assert_int_eq(mk_loop_start(b.loop, "/nonexistent/x.csv", NULL, 0, &err), MK_ERR_NOTFOUND);
    ck_assert_int_eq(look().state, MK_LOOP_IDLE);
    ck_assert_int_eq(mk_loop_wait(b.loop, NAN, NULL, NULL, NULL, &err), MK_ERR_RANGE);
}
END_TEST

START_TEST(a_tick_allocates_nothing)
{
    use_plant((enum mk_plant_kind)_i);
    build("at 50 drop; at 60 delay 5ms; at 70 jump 1 by 1");
    ck_assert_int_eq(mk_loop_start(b.loop, NULL, NULL, 0, NULL), MK_OK);
    wait_for(0.01);
    set_law(2, 1, 1e18);
    unsigned long before = heap_allocations();
    enum mk_status st = wait_for(0.5);
    unsigned long after = heap_allocations();
    ck_assert_int_eq(st, MK_OK);
    ck_assert_uint_eq(after, before);
    /* The counting itself works: */
    free(malloc(1 + (size_t)_i));
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
    build(NULL);
    start();
    ck_assert_int_eq(mk_loop_wait(b.loop, 1, reached_tick_50, NULL, NULL, NULL), MK_OK);
    ck_assert_uint_eq(look().sample.tick, 50);
    ck_assert_int_eq(mk_loop_wait(b.loop, 0.1, never, NULL, &cancel, NULL), MK_ERR_TIMEOUT);
    ck_assert_uint_eq(look().sample.tick, 100);
    cancel = 1;
    ck_assert_int_eq(mk_loop_wait(b.loop, 0.1, NULL, NULL, &cancel, NULL), MK_ERR_INTR);
}
END_TEST

START_TEST(time_passes_for_the_rig_when_nothing_runs)
{
    build(NULL);
    start();
    set_law(3, 1, 1e18);
    wait_for(0.1);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
    double t = mk_rig_time(mk_board_virtual_rig(b.board));
    ck_assert_int_eq(wait_for(2.0), MK_OK);
    ck_assert_double_eq_tol(mk_rig_time(mk_board_virtual_rig(b.board)), t + 2.0, 1e-6);
}
END_TEST

/* --- what the log says ----------------------------------------------------------------------- */

START_TEST(row_k_holds_the_command_applied_from_k_on)
{
    use_plant(MK_PLANT_INERTIA_WHEEL);
    build(NULL);
    set_law(4, 1, 1e18);
    start();
    wait_for(0.2);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
    struct mk_log *log = read_log();
    const double *u = mk_log_get(log, "u"), *q = mk_log_get(log, "q1"), *t = mk_log_get(log, "t");
    ck_assert_uint_eq(log->rows, 100);
    ck_assert_double_eq(u[0], 0.0);
    ck_assert_double_eq(u[1], 4.0);

    /* An independent simulation driven by the log's own u (zero-order hold) passes through q. */
    struct mk_sim *sim;
    const double x0[] = {0, 0};
    ck_assert_int_eq(mk_sim_create(&b.model, NULL, &sim, NULL), MK_OK);
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
    const struct mk_log_meta meta[] = {{key, value}, {rig, kind}};
    build(NULL);
    set_law(0.5, 2, 1e18);
    ck_assert_int_eq(mk_loop_start(b.loop, b.path, meta, 2, NULL), MK_OK);
    wait_for(0.1);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
    struct mk_log *log = read_log();
    ck_assert_str_eq(mk_log_find_meta(log, "operator"), "Ada");
    ck_assert_str_eq(mk_log_find_meta(log, "rig"), "my own words");
    ck_assert_str_eq(mk_log_find_meta(log, "sample_rate_hz"), "500");
    ck_assert_str_eq(mk_log_find_meta(log, "encoder_cpr"), "4000 4000");
    ck_assert_str_eq(mk_log_find_meta(log, "u_to_torque"), "0.00494");
    ck_assert_str_eq(mk_log_find_meta(log, "u_max"), "10");
    ck_assert_str_eq(mk_log_find_meta(log, "setup"), "test-law");
    ck_assert_str_eq(mk_log_find_meta(log, "gains"), "0.5 2");
    ck_assert_ptr_nonnull(
        strstr(mk_log_find_meta(log, "parameters"), "bias=0.5 scale=2 break_at="));
    ck_assert_ptr_nonnull(strstr(mk_log_find_meta(log, "board"), "virtual"));
    ck_assert_ptr_nonnull(strstr(mk_log_find_meta(log, "program"), MK_VERSION));
    ck_assert_str_eq(mk_log_find_meta(log, "realtime"), "simulated time");
    ck_assert_ptr_nonnull(strstr(mk_log_find_meta(log, "summary"), "50 samples, 0 late"));
    static const char *const columns[] = {"t",    "q1",  "q2",    "u",    "dq1",     "dq2",  "enc1",
                                          "enc2", "ref", "phase", "tick", "late_us", "flags"};
    ck_assert_uint_eq(log->column_count, 13);
    for (int i = 0; i < 13; i++)
        ck_assert_str_eq(log->columns[i].name, columns[i]);
    mk_log_free(log);
}
END_TEST

START_TEST(a_rig_of_one_joint_has_no_columns_of_a_second)
{
    use_plant(MK_PLANT_PENDULUM);
    build(NULL);
    start();
    wait_for(0.1);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
    struct mk_log *log = read_log();
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
    mk_clock_init_simulated(&b.clock);
    b.board_config.seed = seed;
    b.board_config.count_noise = 1.0;
    build("at 300 drop 2; at 400 delay 3ms; from 500 to 600 noise 2");
    start();
    set_law(1.5, 1, 1e18);
    wait_for(1.0);
    set_law(-1.5, 1, 1e18);
    wait_for(1.0);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
    drop_loop();
    return slurp(b.path, size);
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
    use_plant(MK_PLANT_INERTIA_WHEEL);
    b.model.encoder_cpr[0] = 1000000;
    b.config.limits.jump_rad[0] = 5.0;
    build(NULL);
    set_law(10, 1, 1e18);
    start();
    ck_assert_int_eq(wait_for(0.5), MK_OK);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
    struct mk_log *log = read_log();
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
    build(NULL);
    set_law(1, 2, 1e18);
    start();
    wait_for(0.1);
    set_law(-0.5, 3, 1e18);
    wait_for(0.1);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
    struct mk_log *log = read_log();
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

START_TEST(parameters_out_of_range_change_nothing)
{
    const double bad[PARAM_COUNT] = {1e10, 1, 1e18};
    struct mk_error err = MK_ERROR_INIT;
    build(NULL);
    start();
    ck_assert_int_eq(mk_loop_set_params(b.loop, bad, PARAM_COUNT, &err), MK_ERR_RANGE);
    ck_assert_ptr_nonnull(strstr(err.message, "bias"));
    ck_assert_int_eq(mk_loop_set_params(b.loop, bad, 1, &err), MK_ERR_INVALID);
    wait_for(0.1);
    ck_assert_double_eq(look().sample.u, 0.0);
}
END_TEST

START_TEST(a_wish_beyond_the_limit_is_cut_and_marked)
{
    build(NULL);
    set_law(25, 1, 1e18);
    start();
    wait_for(0.01);
    ck_assert_double_eq(look().sample.u, 10.0);
    ck_assert(look().sample.flags & MK_FLAG_SATURATED);
}
END_TEST

START_TEST(a_lost_exchange_leaves_a_marked_empty_row)
{
    build("at 20 drop 2; at 40 mute");
    start();
    ck_assert_int_eq(wait_for(0.2), MK_OK);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
    struct mk_log *log = read_log();
    const double *q = mk_log_get(log, "q1"), *flags = mk_log_get(log, "flags");
    ck_assert_uint_eq(log->rows, 100);
    for (size_t k = 0; k < log->rows; k++) {
        bool lost = k == 20 || k == 21 || k == 40;
        ck_assert_int_eq(isnan(q[k]) != 0, lost);
        ck_assert_int_eq((int)flags[k], lost ? MK_FLAG_LOST : 0);
    }
    struct mk_loop_stats stats;
    mk_loop_get_stats(b.loop, &stats);
    ck_assert_uint_eq(stats.lost, 3);
    ck_assert_uint_eq(stats.gaps, 0);
    mk_log_free(log);
}
END_TEST

START_TEST(a_late_answer_skips_samples_and_says_so)
{
    build("at 20 delay 5ms; at 40 delay 1200us");
    start();
    ck_assert_int_eq(wait_for(0.2), MK_OK);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
    struct mk_log *log = read_log();
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
    mk_log_free(log);
}
END_TEST

/* --- faults ---------------------------------------------------------------------------------- */

/* Starts, drives, expects `fault`; the motor is off in the row that shows it and in the plant. */
static void expect_fault(enum mk_fault fault)
{
    struct mk_error err = MK_ERROR_INIT;
    start();
    ck_assert_int_eq(mk_loop_wait(b.loop, 5, NULL, NULL, NULL, &err), MK_ERR_FAULT);
    ck_assert_ptr_nonnull(strstr(err.message, mk_fault_name(fault)));
    ck_assert_int_eq(look().state, MK_LOOP_FAULTED);
    ck_assert_msg(look().fault == fault, "%s", mk_fault_name(look().fault));
    ck_assert_int_eq(wait_for(1), MK_ERR_FAULT);
    ck_assert_int_eq(mk_loop_start(b.loop, NULL, NULL, 0, NULL), MK_ERR_STATE);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
    ck_assert_int_eq(look().fault, fault);

    struct mk_log *log = read_log();
    const double *u = mk_log_get(log, "u"), *flags = mk_log_get(log, "flags");
    ck_assert_ptr_nonnull(strstr(mk_log_find_meta(log, "fault"), mk_fault_name(fault)));
    bool seen = false;
    for (size_t k = 0; k < log->rows; k++) {
        seen = seen || ((int)flags[k] & MK_FLAG_FAULT);
        if (seen)
            ck_assert_double_eq(u[k], 0.0);
    }
    ck_assert(seen);
    mk_log_free(log);
    assert_motor_is_off();

    mk_loop_acknowledge(b.loop);
    ck_assert_int_eq(look().state, MK_LOOP_IDLE);
    ck_assert_int_eq(look().fault, MK_FAULT_NONE);
}

START_TEST(travel_stops_the_motor)
{
    b.config.limits.q_max[0] = -M_PI_2 + 0.2;
    build(NULL);
    set_law(6, 1, 1e18);
    expect_fault(MK_FAULT_TRAVEL);
}
END_TEST

START_TEST(speed_stops_the_motor)
{
    use_plant(MK_PLANT_INERTIA_WHEEL);
    b.config.limits.v_max[0] = 100;
    build(NULL);
    set_law(6, 1, 1e18);
    expect_fault(MK_FAULT_SPEED);
}
END_TEST

START_TEST(a_jumping_encoder_stops_the_motor)
{
    build("at 100 jump 2 by 500");
    set_law(1, 1, 1e18);
    expect_fault(MK_FAULT_JUMP);
    ck_assert_int_eq(look().fault_joint, 0);
}
END_TEST

START_TEST(a_stuck_encoder_stops_the_motor)
{
    build("at 0 stuck 1");
    set_law(9, 1, 1e18);
    expect_fault(MK_FAULT_STUCK);
}
END_TEST

/* A board whose motor is wired the wrong way round: the virtual one with its command negated. */
static enum mk_status reversed_exchange(struct mk_board *board, double u,
                                        struct mk_board_sample *out)
{
    enum mk_status st = mk_board_backend_by_name("virtual")->exchange(board, -u, out);
    out->u_applied = u;
    return st;
}

START_TEST(a_motor_wired_backwards_stops)
{
    use_plant(MK_PLANT_INERTIA_WHEEL);
    build(NULL);
    struct mk_board_ops reversed = *b.board->ops;
    const struct mk_board_ops *straight = b.board->ops;
    reversed.exchange = reversed_exchange;
    b.board->ops = &reversed;
    set_law(5, 1, 1e18);
    start();
    ck_assert_int_eq(wait_for(1), MK_ERR_FAULT);
    ck_assert_int_eq(look().fault, MK_FAULT_RUNAWAY);
    ck_assert_double_lt(look().fault_t, 0.05);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
    b.board->ops = straight;
    assert_motor_is_off();
}
END_TEST

START_TEST(a_command_that_is_no_number_stops_the_motor)
{
    build(NULL);
    set_law(2, 1, 100);
    expect_fault(MK_FAULT_COMMAND);
}
END_TEST

START_TEST(late_samples_in_a_row_stop_the_motor)
{
    build("from 100 to 200 delay 3500us");
    b.config.watchdog_ms = 0;
    set_law(2, 1, 1e18);
    expect_fault(MK_FAULT_OVERRUN);
}
END_TEST

START_TEST(a_broken_link_stops_the_motor)
{
    build("at 100 drop 5");
    set_law(2, 1, 1e18);
    expect_fault(MK_FAULT_LINK);
}
END_TEST

START_TEST(an_unplugged_board_ends_the_run)
{
    build("at 100 disconnect");
    set_law(2, 1, 1e18);
    start();
    ck_assert_int_eq(wait_for(1), MK_ERR_FAULT);
    ck_assert_int_eq(look().fault, MK_FAULT_UNPLUGGED);
    ck_assert_double_eq_tol(look().fault_t, 0.2, 1e-12);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
    /* Nobody reaches the board any more: its watchdog does. */
    mk_clock_sleep_until(&b.clock, mk_clock_now_ns(&b.clock) + 25000000);
    assert_motor_is_off();
    mk_loop_acknowledge(b.loop);
    ck_assert_int_eq(mk_loop_start(b.loop, NULL, NULL, 0, NULL), MK_ERR_FAULT);
    ck_assert_int_eq(look().fault, MK_FAULT_UNPLUGGED);
}
END_TEST

START_TEST(the_watchdog_stops_the_motor_when_the_loop_stalls)
{
    b.config.limits.late_limit = 1000;
    build("at 100 delay 100ms");
    set_law(2, 1, 1e18);
    expect_fault(MK_FAULT_WATCHDOG);
}
END_TEST

START_TEST(a_fault_of_the_board_stops_the_motor)
{
    build("at 100 alarm for 1");
    set_law(2, 1, 1e18);
    expect_fault(MK_FAULT_BOARD);
}
END_TEST

START_TEST(the_stop_button_stops_the_motor)
{
    build(NULL);
    set_law(2, 1, 1e18);
    start();
    wait_for(0.2);
    mk_loop_estop(b.loop);
    ck_assert_int_eq(wait_for(1), MK_ERR_FAULT);
    ck_assert_int_eq(look().fault, MK_FAULT_ESTOP);
    ck_assert_double_eq_tol(look().fault_t, 0.2, 1e-12);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
    assert_motor_is_off();
    mk_loop_acknowledge(b.loop);
    ck_assert_int_eq(look().state, MK_LOOP_IDLE);
}
END_TEST

START_TEST(a_stop_pressed_before_the_start_prevents_it)
{
    build(NULL);
    mk_loop_estop(b.loop);
    ck_assert_int_eq(look().fault, MK_FAULT_ESTOP);
    ck_assert_int_eq(mk_loop_start(b.loop, NULL, NULL, 0, NULL), MK_ERR_STATE);
    mk_loop_acknowledge(b.loop);
    start();
}
END_TEST

START_TEST(swinging_links_do_not_start)
{
    struct mk_error err = MK_ERROR_INIT;
    b.board_config.start[0] = 0.1;
    build(NULL);
    ck_assert_int_eq(mk_loop_start(b.loop, NULL, NULL, 0, &err), MK_ERR_FAULT);
    ck_assert_ptr_nonnull(strstr(err.message, "moves"));
    ck_assert_int_eq(look().fault, MK_FAULT_NOT_HANGING);
    ck_assert_int_eq(look().state, MK_LOOP_FAULTED);
    assert_motor_is_off();
    /* Friction brings them to rest. */
    mk_loop_acknowledge(b.loop);
    ck_assert_int_eq(wait_for(60), MK_OK);
    start();
}
END_TEST

START_TEST(a_link_held_away_from_rest_does_not_start_again)
{
    struct mk_error err = MK_ERROR_INIT;
    build_on("null");
    start();
    wait_for(0.1);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
    /* Rest is known now; pretend that it was somewhere else. */
    b.config.limits.rest_tolerance[1] = -1.0;
    mk_loop_destroy(b.loop);
    ck_assert_int_eq(mk_loop_create(b.board, &b.ctrl, &b.config, &b.loop, &err), MK_OK);
    ck_assert_int_eq(mk_loop_start(b.loop, NULL, NULL, 0, &err), MK_ERR_FAULT);
    ck_assert_ptr_nonnull(strstr(err.message, "joint 2"));
}
END_TEST

START_TEST(whole_turns_are_forgotten_between_runs)
{
    b.config.limits.v_max[0] = b.config.limits.v_max[1] = 200;
    b.config.limits.jump_rad[0] = b.config.limits.jump_rad[1] = 3;
    build(NULL);
    set_law(10, 1, 1e18);
    start();
    struct mk_error err = MK_ERROR_INIT;
    enum mk_status st = mk_loop_wait(b.loop, 0.5, NULL, NULL, NULL, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
    ck_assert_int_eq(wait_for(120), MK_OK);
    double rest = mk_rig_state(mk_board_virtual_rig(b.board))[0] + M_PI_2;
    set_law(0, 1, 1e18);
    start();
    wait_for(0.01);
    ck_assert_double_eq_tol(look().sample.q[0], -M_PI_2 + remainder(rest, 2 * M_PI), 0.001);
    ck_assert_double_gt(fabs(rest), 3.0);
}
END_TEST

START_TEST(after_a_fault_the_log_shows_what_the_rig_did)
{
    build("at 100 jump 2 by 500");
    set_law(3, 1, 1e18);
    start();
    ck_assert_int_eq(wait_for(1), MK_ERR_FAULT);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
    struct mk_log *log = read_log();
    ck_assert_uint_eq(log->rows, 101 + 100); /* 0.2 s */
    mk_log_free(log);
}
END_TEST

/* --- processes that end badly ---------------------------------------------------------------- */

START_TEST(a_full_disk_stops_the_motor_and_is_reported)
{
    pid_t pid = fork();
    ck_assert_int_ge(pid, 0);
    if (pid == 0) {
        const struct rlimit small = {60000, 60000};
        signal(SIGXFSZ, SIG_IGN);
        setrlimit(RLIMIT_FSIZE, &small);
        build(NULL);
        set_law(2, 1, 1e18);
        if (mk_loop_start(b.loop, b.path, NULL, 0, NULL) != MK_OK)
            _exit(1);
        enum mk_status st = MK_OK;
        for (int k = 0; k < 100 && st == MK_OK; k++)
            st = wait_for(0.1);
        if (st != MK_ERR_FAULT || look().fault != MK_FAULT_LOG)
            _exit(2);
        if (look().sample.u != 0.0)
            _exit(3);
        if (mk_loop_halt(b.loop, NULL) != MK_ERR_NOSPACE)
            _exit(4);
        _exit(look().state == MK_LOOP_FAULTED ? 0 : 5);
    }
    int status;
    ck_assert_int_eq(waitpid(pid, &status, 0), pid);
    ck_assert_msg(WIFEXITED(status) && WEXITSTATUS(status) == 0, "status %x", status);
    struct mk_log *log = read_log();
    ck_assert_uint_gt(log->rows, 300);
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
        use_real_time(1000);
        build(NULL);
        if (mk_loop_start(b.loop, b.path, NULL, 0, NULL) != MK_OK || wait_for(0.5) != MK_OK ||
            write(ready[1], "x", 1) != 1)
            _exit(1);
        (void)!wait_for(60);
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
    struct mk_log *log = read_log();
    ck_assert_uint_gt(log->rows, 300);
    mk_log_free(log);
}
END_TEST

/* --- real time ------------------------------------------------------------------------------- */

START_TEST(a_second_at_1_khz_loses_nothing)
{
    struct mk_loop_stats stats;
    use_real_time(1000);
    build(NULL);
    set_law(1, 1, 1e18);
    start();
    ck_assert_int_eq(wait_for(1.0), MK_OK);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
    mk_loop_get_stats(b.loop, &stats);
    struct mk_log *log = read_log();
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
    use_real_time(1000);
    build(NULL);
    set_law(2, 1, 1e18);
    start();
    ck_assert_int_eq(pthread_create(&presser, NULL, press_stop, b.loop), 0);
    ck_assert_int_eq(wait_for(20), MK_ERR_FAULT);
    pthread_join(presser, NULL);
    ck_assert_int_eq(look().fault, MK_FAULT_ESTOP);
    ck_assert_double_eq(look().sample.u, 0.0);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
}
END_TEST

START_TEST(gains_change_while_a_real_time_run_goes_on)
{
    use_real_time(1000);
    build(NULL);
    set_law(0, 0, 1e18);
    start();
    /* Products of a consistent pair are +1 or -1; a torn pair would give another. */
    for (int k = 0; k < 40; k++) {
        set_law(k % 2 ? 2 : -4, k % 2 ? 0.5 : 0.25, 1e18);
        struct mk_loop_snapshot s = look();
        ck_assert(s.sample.u == 0 || fabs(s.sample.u) == 1.0);
        ck_assert_int_eq(wait_for(0.003), MK_OK);
    }
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
    struct mk_log *log = read_log();
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
    use_real_time(1000);
    build("at 100 disconnect");
    set_law(1, 1, 1e18);
    start();
    ck_assert_int_eq(wait_for(10), MK_ERR_FAULT);
    ck_assert_int_eq(look().fault, MK_FAULT_UNPLUGGED);
    ck_assert_int_eq(mk_loop_halt(b.loop, NULL), MK_OK);
}
END_TEST

START_TEST(destroying_a_running_loop_turns_the_motor_off)
{
    use_real_time(500);
    build(NULL);
    set_law(2, 1, 1e18);
    start();
    ck_assert_int_eq(wait_for(0.05), MK_OK);
    mk_loop_destroy(b.loop);
    b.loop = NULL;
    struct mk_board_sample s;
    ck_assert_int_eq(mk_board_exchange(b.board, 0.0, &s), MK_OK);
    ck_assert_double_eq(s.u_applied, 0.0);
    struct mk_log *log = read_log();
    ck_assert_ptr_nonnull(mk_log_find_meta(log, "summary"));
    mk_log_free(log);
}
END_TEST

static void add_faults(TCase *t)
{
    tcase_add_test(t, travel_stops_the_motor);
    tcase_add_test(t, speed_stops_the_motor);
    tcase_add_test(t, a_jumping_encoder_stops_the_motor);
    tcase_add_test(t, a_stuck_encoder_stops_the_motor);
    tcase_add_test(t, a_motor_wired_backwards_stops);
    tcase_add_test(t, a_command_that_is_no_number_stops_the_motor);
    tcase_add_test(t, late_samples_in_a_row_stop_the_motor);
    tcase_add_test(t, a_broken_link_stops_the_motor);
    tcase_add_test(t, an_unplugged_board_ends_the_run);
    tcase_add_test(t, the_watchdog_stops_the_motor_when_the_loop_stalls);
    tcase_add_test(t, a_fault_of_the_board_stops_the_motor);
    tcase_add_test(t, the_stop_button_stops_the_motor);
    tcase_add_test(t, a_stop_pressed_before_the_start_prevents_it);
    tcase_add_test(t, swinging_links_do_not_start);
    tcase_add_test(t, a_link_held_away_from_rest_does_not_start_again);
    tcase_add_test(t, whole_turns_are_forgotten_between_runs);
    tcase_add_test(t, after_a_fault_the_log_shows_what_the_rig_did);
    tcase_add_test(t, a_full_disk_stops_the_motor_and_is_reported);
}

Suite *suite_loop(void)
{
    Suite *s = suite_create("loop");
    TCase *t = tcase_create("simulated time");
    tcase_add_checked_fixture(t, setup, teardown);
    tcase_set_timeout(t, 20);
    tcase_add_test(t, a_run_goes_through_its_states);
    tcase_add_test(t, a_loop_refuses_what_it_cannot_run);
    tcase_add_loop_test(t, a_tick_allocates_nothing, 0, MK_PLANT_COUNT);
    tcase_add_test(t, waiting_ends_with_its_condition_its_time_or_a_cancel);
    tcase_add_test(t, time_passes_for_the_rig_when_nothing_runs);
    tcase_add_test(t, row_k_holds_the_command_applied_from_k_on);
    tcase_add_test(t, the_log_says_what_made_it);
    tcase_add_test(t, a_rig_of_one_joint_has_no_columns_of_a_second);
    tcase_add_test(t, the_same_seed_gives_the_same_log_byte_for_byte);
    tcase_add_test(t, angles_go_on_across_the_wrap_of_the_counter);
    tcase_add_test(t, new_parameters_take_effect_together_in_one_sample);
    tcase_add_test(t, parameters_out_of_range_change_nothing);
    tcase_add_test(t, a_wish_beyond_the_limit_is_cut_and_marked);
    tcase_add_test(t, a_lost_exchange_leaves_a_marked_empty_row);
    tcase_add_test(t, a_late_answer_skips_samples_and_says_so);
    suite_add_tcase(s, t);

    t = tcase_create("faults");
    tcase_add_checked_fixture(t, setup, teardown);
    tcase_set_timeout(t, 20);
    add_faults(t);
    suite_add_tcase(s, t);

    t = tcase_create("real time");
    tcase_add_checked_fixture(t, setup, teardown);
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
