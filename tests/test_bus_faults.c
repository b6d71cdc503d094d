/* The fault campaign: a short run over each bus, once for every fault at every request of it. Each
 * time the run must come to an end, the motor must be off afterwards, every error must have a name,
 * the log must be whole, and the board must work again. */
#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "emu/bench.h"
#include "mechkit/loop.h"
#include "support/files.h"
#include "support/wall.h"

#define RATE_HZ 100.0
#define DRIVE_S 0.1
#define WATCHDOG_NS 20000000

static struct mk_model model;
static struct mk_clock clock_;
static struct emu_bench bench;
static struct mk_signal *push;

static const char *const buses[] = {"usb", "parport", "parport-nibble", "tcp", "serial"};
#define BUSES ((int)(sizeof buses / sizeof buses[0]))
#define KINDS (EMU_FAULT_COUNT - 1)

struct outcome {
    enum mk_status status; /* of the first step that failed */
    enum mk_status halted; /* MK_OK, or the board could not be heard to switch the motor off */
    struct mk_error err;
    bool logged;
    double seconds;
};

static enum mk_status drive(struct mk_board *board, struct mk_ctrl *ctrl, struct outcome *o)
{
    struct mk_loop_config config;
    struct mk_loop *loop = NULL;
    mk_loop_config_default(&model, &config);
    config.rate_hz = RATE_HZ;
    mk_safety_default(&model, 1.0 / RATE_HZ, &config.limits);
    enum mk_status st = mk_loop_create(board, ctrl, &config, &loop, &o->err);
    if (st == MK_OK) {
        st = mk_loop_start(loop, scratch("run.csv"), NULL, 0, &o->err);
        o->logged = st == MK_OK;
    }
    if (st == MK_OK)
        st = mk_loop_wait(loop, DRIVE_S, NULL, NULL, NULL, &o->err);
    struct mk_error late = MK_ERROR_INIT;
    if (loop)
        o->halted = mk_loop_halt(loop, &late);
    ck_assert_msg(o->halted == MK_OK ||
                      (o->halted == MK_ERR_IO && strstr(late.message, "has not confirmed")),
                  "%s", late.message);
    mk_loop_destroy(loop);
    return st;
}

/* Open, start, drive, halt, close. */
static struct outcome short_run(void)
{
    struct outcome o = {.status = MK_OK, .halted = MK_OK, .err = MK_ERROR_INIT};
    struct mk_board_config config = {.model = &model, .clock = &clock_, .device = bench.device};
    struct mk_board *board = NULL;
    struct mk_ctrl *ctrl = NULL;
    double start = wall_s();
    ck_assert_int_eq(mk_ctrl_create(mk_ctrl_setup_by_name("open-loop"), &model, 1.0 / RATE_HZ, push,
                                    &ctrl, NULL),
                     MK_OK);
    o.status = mk_board_open(&bench.ops, &config, &board, &o.err);
    if (o.status == MK_OK)
        o.status = drive(board, ctrl, &o);
    mk_board_close(board);
    mk_ctrl_destroy(ctrl);
    o.seconds = wall_s() - start;
    return o;
}

static void motor_is_off(void)
{
    mk_clock_sleep_until(&clock_, mk_clock_now_ns(&clock_) + WATCHDOG_NS + 2);
    ck_assert_int_eq(mk_emulated_run(&bench.board), MK_OK);
    ck_assert_double_eq(bench.board.u, 0.0);
}

/* A fault ends a run with rows up to the end and its name; a run that survived has none. */
static void log_is_whole(const struct outcome *o)
{
    struct mk_log *log = NULL;
    struct mk_error err = MK_ERROR_INIT;
    if (!o->logged)
        return;
    ck_assert_msg(mk_log_read(scratch("run.csv"), &log, &err) == MK_OK, "%s", err.message);
    ck_assert(!log->truncated);
    ck_assert_int_eq(mk_log_find_meta(log, "fault") != NULL, o->status == MK_ERR_FAULT);
    const double *tick = mk_log_get(log, "tick");
    for (size_t k = 0; k < log->rows; k++)
        ck_assert_double_eq(tick[k], (double)k);
    if (o->status == MK_OK)
        ck_assert_uint_ge(log->rows, (size_t)lround(DRIVE_S * RATE_HZ));
    mk_log_free(log);
}

static void works_again(enum emu_fault fault)
{
    emu_line_arm(bench.line, EMU_FAULT_NONE, 0, 0);
    if (fault == EMU_FAULT_UNPLUG)
        emu_bench_plug(&bench);
    struct outcome o = short_run();
    ck_assert_msg(o.status == MK_OK, "%s", o.err.message);
    ck_assert_int_eq(o.halted, MK_OK);
}

static void setup(void)
{
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &model);
    mk_clock_init_simulated(&clock_);
    ck_assert_int_eq(mk_signal_create("2", &push, NULL), MK_OK);
}

static void sit_at(const char *bus)
{
    const struct mk_board_config config = {.model = &model, .clock = &clock_};
    emu_bench_init(&bench, bus, &config);
}

static void teardown(void)
{
    mk_signal_destroy(push);
    emu_bench_free(&bench);
}

/* Faults that go on for so many requests, from every `stride`th on. The tests take every seventh
 * request, others with each kind; `make fault-campaign` takes all. */
static const struct plan {
    unsigned count, stride;
} plans[] = {{1, 7}, {7, 23}};

static void campaign(const char *bus, enum emu_fault fault, struct plan plan)
{
    emu_line_arm(bench.line, EMU_FAULT_NONE, 0, 0);
    struct outcome good = short_run();
    ck_assert_msg(good.status == MK_OK, "%s", good.err.message);
    ck_assert_int_eq(good.halted, MK_OK);
    unsigned requests = bench.line->requests, injected = 0, ended = 0, off = 0, survived = 0;
    bool all = getenv("MECHKIT_CAMPAIGN") != NULL;
    unsigned stride = all ? 1 : plan.stride, begin = all ? 0 : (unsigned)fault % stride;
    for (unsigned first = begin; first < requests; first += stride) {
        emu_line_arm(bench.line, fault, first, plan.count);
        struct outcome o = short_run();
        injected += bench.line->injected > 0;
        ck_assert_double_lt(o.seconds, 5.0);
        ended++;
        if (o.status == MK_OK)
            survived++;
        else
            ck_assert_msg(strlen(o.err.message) > 10, "%s at %u: %s", emu_fault_text(fault), first,
                          mk_status_name(o.status));
        motor_is_off();
        off++;
        log_is_whole(&o);
        works_again(fault);
    }
    ck_assert_uint_eq(injected, ended);
    ck_assert_uint_eq(off, ended);
    if (all)
        printf("%-14s %-30s x%u: injected %2u, survived %2u, motor off %2u; run unharmed %2u\n",
               bus, emu_fault_text(fault), plan.count, injected, ended, off, survived);
}

START_TEST(no_fault_at_any_request_leaves_the_motor_on)
{
    int kind = _i % KINDS, plan = _i / KINDS % 2, bus = _i / KINDS / 2;
    sit_at(buses[bus]);
    campaign(buses[bus], (enum emu_fault)(1 + kind), plans[plan]);
}
END_TEST

/* One lost exchange is a lost sample, not the end of the run. */
START_TEST(a_single_fault_of_an_exchange_costs_one_sample)
{
    static const enum emu_fault kinds[] = {
        EMU_FAULT_LOSE_REQUEST, EMU_FAULT_LOSE_ANSWER, EMU_FAULT_SHORT_REQUEST,
        EMU_FAULT_SHORT_ANSWER, EMU_FAULT_STALL_OUT,   EMU_FAULT_STALL_IN,
        EMU_FAULT_BLOCK_OUT,    EMU_FAULT_LATE_ANSWER, EMU_FAULT_OVERFLOW,
        EMU_FAULT_FLIP_REQUEST, EMU_FAULT_FLIP_ANSWER, EMU_FAULT_ERROR_OUT,
        EMU_FAULT_ERROR_IN,     EMU_FAULT_REORDER};
    struct mk_board_config config = {.model = &model, .clock = &clock_};
    struct mk_board *board;
    struct mk_board_sample s;
    sit_at(buses[_i]);
    config.device = bench.device;
    ck_assert_int_eq(mk_board_open(&bench.ops, &config, &board, NULL), MK_OK);
    for (size_t k = 0; k < sizeof kinds / sizeof kinds[0]; k++) {
        /* Whether a port that is busy for a while costs a sample is a matter of microseconds. */
        if (kinds[k] == EMU_FAULT_BLOCK_OUT && _i > 0)
            continue;
        emu_line_arm(bench.line, kinds[k], 1, 1);
        int lost = 0;
        for (int n = 0; n < 6; n++) {
            enum mk_status st = mk_board_exchange(board, (double)n, &s);
            lost += st != MK_OK;
            if (st == MK_OK)
                ck_assert_double_eq(s.u_applied, (double)n);
            else
                ck_assert_msg(st == MK_ERR_TIMEOUT || st == MK_ERR_PROTO, "%s",
                              emu_fault_text(kinds[k]));
        }
        ck_assert_msg(lost == 1, "%s: %d lost", emu_fault_text(kinds[k]), lost);
        ck_assert_double_eq(bench.board.u, 5.0);
    }
    mk_board_close(board);
}
END_TEST

Suite *suite_bus_faults(void)
{
    Suite *s = suite_create("bus_faults");
    TCase *t = tcase_create("bus_faults");
    tcase_add_checked_fixture(t, setup, teardown);
    tcase_set_timeout(t, 60);
    tcase_add_loop_test(t, a_single_fault_of_an_exchange_costs_one_sample, 0, BUSES);
    tcase_add_loop_test(t, no_fault_at_any_request_leaves_the_motor_on, 0, BUSES * 2 * KINDS);
    suite_add_tcase(s, t);
    return s;
}
