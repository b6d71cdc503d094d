#include "support/bench.h"

#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "mechkit/rig.h"

/* u = bias * scale, or NaN from tick break_at on. Phase balance from tick 100 to fall_at. */
static void law_step(struct mk_ctrl *ctrl, const struct mk_ctrl_input *in,
                     struct mk_ctrl_output *out)
{
    bench.told_s += in->dt;
    double bias = ctrl->ref ? mk_signal_at(ctrl->ref, in->t) : ctrl->value[BIAS];
    out->u = bias * ctrl->value[SCALE];
    out->ref = (double)in->tick;
    const bool up = in->tick >= 100 && (double)in->tick < ctrl->value[FALL_AT];
    out->phase = up ? MK_PHASE_BALANCE : MK_PHASE_SWINGUP;
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
              {"break_at", "", "", 0.0, 1e18, 1e18, false},
              {"fall_at", "", "", 0.0, 1e18, 1e18, false}},
    .reset = law_reset,
    .step = law_step,
};

struct bench bench;

void bench_setup(void)
{
    memset(&bench, 0, sizeof bench);
    mk_model_default(MK_PLANT_PENDUBOT, &bench.model);
    mk_clock_init_simulated(&bench.clock);
    mk_loop_config_default(&bench.model, &bench.config);
    bench.board_config.model = &bench.model;
    bench.board_config.clock = &bench.clock;
    snprintf(bench.path, sizeof bench.path, "/tmp/mechkit-test-loop-XXXXXX");
    int fd = mkstemp(bench.path);
    ck_assert_int_ge(fd, 0);
    close(fd);
}

void bench_drop_loop(void)
{
    mk_loop_destroy(bench.loop);
    mk_board_close(bench.board);
    bench.loop = NULL;
    bench.board = NULL;
    bench.own = NULL;
}

void bench_teardown(void)
{
    bench_drop_loop();
    unlink(bench.path);
}

void bench_use_plant(enum mk_plant_kind kind)
{
    mk_model_default(kind, &bench.model);
    mk_safety_default(&bench.model, 1.0 / bench.config.rate_hz, &bench.config.limits);
}

/* Wall-clock tests run on shared machines: only what they are about may trip. */
void bench_use_real_time(double rate_hz)
{
    mk_clock_init_monotonic(&bench.clock);
    bench.config.rate_hz = rate_hz;
    mk_safety_default(&bench.model, 1.0 / rate_hz, &bench.config.limits);
    bench.config.limits.late_limit = 1000000;
    bench.config.watchdog_ms = 0;
}

void bench_build_on(const char *backend)
{
    struct mk_error err = MK_ERROR_INIT;
    enum mk_status st =
        mk_board_open(mk_board_backend_by_name(backend), &bench.board_config, &bench.board, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    bench.ctrl =
        (struct mk_ctrl){.ops = &law, .model = bench.model, .dt = 1.0 / bench.config.rate_hz};
    for (int i = 0; i < PARAM_COUNT; i++)
        bench.ctrl.value[i] = law.param[i].initial;
    st = mk_loop_create(bench.board, &bench.ctrl, &bench.config, &bench.loop, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
}

void bench_build(const char *faults)
{
    bench.board_config.fault_script = faults;
    bench_build_on("virtual");
}

void bench_build_driving(const char *faults, double u)
{
    bench_build(faults);
    bench_set_law(u, 1, 1e18);
}

void bench_start(void)
{
    struct mk_error err = MK_ERROR_INIT;
    enum mk_status st = mk_loop_start(bench.loop, bench.path, NULL, 0, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
}

enum mk_status bench_wait_for(double seconds)
{
    return mk_loop_wait(bench.loop, seconds, NULL, NULL, NULL, NULL);
}

struct mk_loop_snapshot bench_look(void)
{
    struct mk_loop_snapshot s;
    mk_loop_get_snapshot(bench.loop, &s);
    return s;
}

void bench_halt(void)
{
    ck_assert_int_eq(mk_loop_halt(bench.loop, NULL), MK_OK);
}

void bench_run(double seconds)
{
    bench_start();
    ck_assert_int_eq(bench_wait_for(seconds), MK_OK);
    bench_halt();
}

struct mk_log *bench_log_of_run(double seconds)
{
    bench_run(seconds);
    return bench_read_log();
}

void bench_run_into(enum mk_fault fault, double within_s)
{
    bench_start();
    ck_assert_int_eq(bench_wait_for(within_s), MK_ERR_FAULT);
    ck_assert_msg(bench_look().fault == fault, "%s", mk_fault_name(bench_look().fault));
}

struct mk_board_ops *bench_override_board(void)
{
    bench.own = bench.board->ops;
    bench.ops = *bench.own;
    bench.board->ops = &bench.ops;
    return &bench.ops;
}

void bench_restore_board(void)
{
    bench.board->ops = bench.own;
}

void bench_set_law(double bias, double scale, double break_at)
{
    const double value[PARAM_COUNT] = {bias, scale, break_at, bench.ctrl.value[FALL_AT]};
    ck_assert_int_eq(mk_loop_set_params(bench.loop, value, PARAM_COUNT, NULL), MK_OK);
}

struct mk_log *bench_read_log(void)
{
    struct mk_log *log = NULL;
    struct mk_error err = MK_ERROR_INIT;
    enum mk_status st = mk_log_read(bench.path, &log, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    return log;
}

size_t bench_rows_logged(void)
{
    struct mk_log *log = bench_read_log();
    size_t rows = log->rows;
    mk_log_free(log);
    return rows;
}

/* The plant's own word: it slows down and nothing drives it. */
void bench_assert_motor_is_off(void)
{
    struct mk_rig *rig = mk_board_virtual_rig(bench.board);
    double x[MK_MAX_STATES];
    memcpy(x, mk_rig_state(rig), sizeof(double) * 4);
    struct mk_sim *free_run;
    const double u[MK_MAX_INPUTS] = {0, 0};
    ck_assert_int_eq(mk_sim_create(&bench.model, NULL, &free_run, NULL), MK_OK);
    ck_assert_int_eq(mk_sim_reset(free_run, 0.0, x, NULL), MK_OK);
    ck_assert_int_eq(mk_sim_advance(free_run, 0.1, u, NULL), MK_OK);
    mk_clock_sleep_until(&bench.clock, mk_clock_now_ns(&bench.clock) + 100000000);
    const double *now = mk_rig_state(mk_board_virtual_rig(bench.board));
    int n = 2 * mk_model_joints(&bench.model);
    for (int i = 0; i < n; i++)
        ck_assert_double_eq_tol(now[i], mk_sim_state(free_run)[i], 1e-5 * (1 + fabs(now[i])));
    mk_sim_destroy(free_run);
}
