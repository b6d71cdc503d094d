/* Controllers on the board itself, as the original kit had them: gains down, start, halt, arrays
 * up. The board runs on a simulated rig, the host reaches it through the virtual wire. */
#include "suites.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "ctrl/link_pump.h"
#include "driver/standalone.h"
#include "driver/standalone_laws.h"
#include "driver/wire.h"
#include "mechkit/log.h"
#include "mechkit/rig.h"
#include "support/files.h"
#include "support/program.h"
#include "support/spawn.h"

static struct mk_model model;
static struct mk_clock clock_;
static struct mk_board *board;
static struct mk_wire *wire;
static struct mk_error err;

static void use_rig(enum mk_plant_kind plant)
{
    mk_model_default(plant, &model);
    mk_clock_init_simulated(&clock_);
    const struct mk_board_config config = {.model = &model, .clock = &clock_};
    err = (struct mk_error)MK_ERROR_INIT;
    ck_assert_int_eq(mk_board_open(mk_board_backend_by_name("virtual"), &config, &board, &err),
                     MK_OK);
    wire = board->priv;
    /* Nobody is there but these tests, which look when they like. */
    ck_assert_int_eq(board->ops->set_watchdog(board, 0, &err), MK_OK);
    ck_assert_int_eq(board->ops->zero_counters(board, &err), MK_OK);
}

static void teardown(void)
{
    mk_board_close(board);
    board = NULL;
}

static void pass_s(double s)
{
    mk_clock_sleep_until(&clock_, mk_clock_now_ns(&clock_) + (int64_t)llround(s * 1e9));
}

static struct mk_wire_state look(void)
{
    struct mk_wire_state s;
    ck_assert_int_eq(mk_wire_state(wire, &s, &err), MK_OK);
    return s;
}

static int choose(enum mk_controller c)
{
    int gains = 0;
    ck_assert_msg(mk_wire_setup(wire, c, 2000, 1, &gains, &err) == MK_OK, "%s", err.message);
    return gains;
}

static void start(void)
{
    ck_assert_msg(mk_wire_start(wire, &err) == MK_OK, "%s", err.message);
}

static double true_state(int i)
{
    return mk_rig_state(mk_board_virtual_rig(board))[i];
}

/* --- the kit's setups
 * ------------------------------------------------------------------------------- */

static const struct {
    enum mk_controller controller;
    enum mk_plant_kind plant;
    int joint;     /* that stands upright */
    double target; /* sum of the angles up to it */
} setups[] = {
    {MK_CONTROLLER_PENDUBOT_MID, MK_PLANT_PENDUBOT, 1, M_PI_2},
    {MK_CONTROLLER_PENDUBOT_TOP, MK_PLANT_PENDUBOT, 1, M_PI_2},
    {MK_CONTROLLER_REACTION_WHEEL, MK_PLANT_REACTION_WHEEL, 0, M_PI},
    {MK_CONTROLLER_FURUTA, MK_PLANT_FURUTA, 1, 0.0},
};

static double tilt(int i)
{
    double q = true_state(setups[i].joint);
    if (setups[i].plant == MK_PLANT_PENDUBOT)
        q += true_state(0);
    return remainder(q - setups[i].target, 2.0 * M_PI);
}

START_TEST(the_board_swings_up_and_balances_by_itself)
{
    use_rig(setups[_i].plant);
    choose(setups[_i].controller);
    start();
    pass_s(15.0); /* nobody asks: the cable may be out */
    for (int k = 0; k < 50; k++) {
        pass_s(0.1);
        ck_assert_double_lt(fabs(tilt(_i)), 0.1);
    }
    struct mk_wire_state s = look();
    ck_assert_uint_eq(s.phase, MK_STANDALONE_BALANCE);
    ck_assert_uint_eq(s.status & MK_WIRE_ST_STANDALONE, MK_WIRE_ST_STANDALONE);
    ck_assert_uint_eq(s.fault, MK_WIRE_FAULT_NONE);
    ck_assert_int_eq(mk_wire_halt(wire, &err), MK_OK);
    pass_s(5.0);
    ck_assert_double_gt(fabs(tilt(_i)), 0.5);
}
END_TEST

START_TEST(gains_can_be_exchanged_while_it_runs)
{
    use_rig(MK_PLANT_INERTIA_WHEEL);
    ck_assert_int_eq(choose(MK_CONTROLLER_PI_SPEED), 3);
    start();
    pass_s(5.0);
    ck_assert_double_eq_tol(true_state(1), 50.0, 0.5);
    const float reference = -20.0f;
    ck_assert_int_eq(mk_wire_gains(wire, 2, &reference, 1, &err), MK_OK);
    pass_s(5.0);
    ck_assert_double_eq_tol(true_state(1), -20.0, 0.5);
}
END_TEST

START_TEST(a_wheel_is_held_at_its_speed_when_its_counter_wraps)
{
    use_rig(MK_PLANT_INERTIA_WHEEL);
    ck_assert_int_eq(choose(MK_CONTROLLER_PI_SPEED), 3);
    const float reference = 100.0f;
    ck_assert_int_eq(mk_wire_gains(wire, 2, &reference, 1, &err), MK_OK);
    start();
    pass_s(10.0);
    /* 2^23 counts of 4000 a turn are reached after 132 s. */
    for (int k = 0; k < 1300; k++) {
        pass_s(0.1);
        ck_assert_double_eq_tol(true_state(1), 100.0, 0.5);
    }
    ck_assert_double_gt(true_state(0), 13177.0);
}
END_TEST

START_TEST(gains_that_are_none_are_refused_and_change_nothing)
{
    use_rig(MK_PLANT_INERTIA_WHEEL);
    const float bad[] = {1.0f, NAN, 2.0f};
    ck_assert_int_eq(mk_wire_gains(wire, 0, bad, 1, &err), MK_ERR_RANGE); /* nothing chosen */
    choose(MK_CONTROLLER_PI_SPEED);
    ck_assert_int_eq(mk_wire_gains(wire, 0, bad, 3, &err), MK_ERR_RANGE);
    ck_assert_int_eq(mk_wire_gains(wire, 3, bad, 1, &err), MK_ERR_RANGE);
    ck_assert_int_eq(mk_wire_gains(wire, 0, bad, 25, &err), MK_ERR_RANGE);
    start();
    pass_s(5.0);
    ck_assert_double_eq_tol(true_state(1), 50.0, 0.5);
}
END_TEST

/* More than a billion units is taken for none, either way. */
START_TEST(a_law_whose_command_is_none_is_a_fault_and_the_motor_is_off)
{
    static const float laws[][3] = {{9e8f, 0.0f, 1000.0f}, {-9e8f, 0.0f, 1000.0f}};
    use_rig(MK_PLANT_INERTIA_WHEEL);
    ck_assert_int_eq(choose(MK_CONTROLLER_PI_SPEED), 3);
    start();
    pass_s(5.0);
    ck_assert_int_eq(mk_wire_gains(wire, 0, laws[_i], 3, &err), MK_OK);
    pass_s(0.01);
    const struct mk_wire_state s = look();
    ck_assert_uint_eq(s.fault, MK_WIRE_FAULT_COMMAND);
    ck_assert_uint_eq(s.status & MK_WIRE_ST_STANDALONE, 0);
    const double speed = true_state(1);
    pass_s(2.0);
    ck_assert_double_lt(true_state(1), 0.9 * speed); /* it runs down */
}
END_TEST

START_TEST(the_arrays_come_up_whole)
{
    static struct mk_standalone_record r[600];
    int gains, got = 0, n = 0;
    use_rig(MK_PLANT_INERTIA_WHEEL);
    ck_assert_int_eq(mk_wire_setup(wire, MK_CONTROLLER_PI_SPEED, 2000, 5, &gains, &err), MK_OK);
    start();
    pass_s(2.0);
    ck_assert_int_eq(mk_wire_halt(wire, &err), MK_OK);
    do {
        ck_assert_int_eq(mk_wire_upload(wire, (uint32_t)n, r + n, 600 - n, &got, &err), MK_OK);
        n += got;
    } while (got > 0);
    ck_assert_uint_eq((uint32_t)n, look().recorded);
    ck_assert_int_eq(n, 201); /* both ends */
    for (int k = 0; k < n; k++) {
        ck_assert_uint_eq(r[k].sample, 5u * (uint32_t)k);
        ck_assert_int_eq(r[k].count[1], 0); /* there is no second joint */
        ck_assert_uint_eq(r[k].phase, MK_STANDALONE_TRACK);
        ck_assert_int_le(r[k].micro, 10 * MK_WIRE_MICRO);
        if (k > 0)
            ck_assert_int_ge(r[k].count[0], r[k - 1].count[0]);
    }
    ck_assert_int_eq(r[0].count[0], 0);
    ck_assert_int_eq(mk_wire_upload(wire, 10000, r, 1, &got, &err), MK_ERR_RANGE);
}
END_TEST

START_TEST(a_second_run_counts_its_samples_from_the_start_again)
{
    struct mk_standalone_record r[2];
    int gains, got = 0;
    use_rig(MK_PLANT_INERTIA_WHEEL);
    ck_assert_int_eq(mk_wire_setup(wire, MK_CONTROLLER_PI_SPEED, 2000, 5, &gains, &err), MK_OK);
    for (int run = 0; run < 2; run++) {
        start();
        pass_s(0.107); /* not a whole number of records */
        ck_assert_int_eq(mk_wire_halt(wire, &err), MK_OK);
        ck_assert_int_eq(mk_wire_upload(wire, 0, r, 2, &got, &err), MK_OK);
        ck_assert_int_eq(got, 2);
        ck_assert_uint_eq(r[0].sample, 0);
        ck_assert_uint_eq(r[1].sample, 5);
    }
}
END_TEST

/* --- who may do what
 * -------------------------------------------------------------------------------- */

START_TEST(while_the_board_controls_commands_of_the_host_do_not_act)
{
    struct mk_board_sample s;
    use_rig(MK_PLANT_INERTIA_WHEEL);
    choose(MK_CONTROLLER_PI_SPEED);
    start();
    for (int k = 0; k < 100; k++) {
        pass_s(0.02);
        ck_assert_int_eq(mk_board_exchange(board, -10.0, &s), MK_OK);
    }
    ck_assert_double_gt(true_state(1), 40.0);
    ck_assert_int_eq(board->ops->zero_counters(board, &err), MK_ERR_STATE);
    int gains;
    ck_assert_int_eq(mk_wire_setup(wire, MK_CONTROLLER_PI_SPEED, 2000, 1, &gains, &err),
                     MK_ERR_STATE);
    ck_assert_int_eq(mk_wire_stream(wire, 2000, &err), MK_ERR_STATE);
    ck_assert_int_eq(board->ops->safe_state(board), MK_OK);
    ck_assert_uint_eq(look().status & MK_WIRE_ST_STANDALONE, 0);
}
END_TEST

START_TEST(a_guarded_run_ends_when_the_guard_falls_silent)
{
    use_rig(MK_PLANT_INERTIA_WHEEL);
    ck_assert_int_eq(board->ops->set_watchdog(board, 200, &err), MK_OK);
    choose(MK_CONTROLLER_PI_SPEED);
    start();
    for (int k = 0; k < 20; k++) {
        pass_s(0.1);
        ck_assert_uint_eq(look().fault, MK_WIRE_FAULT_NONE);
    }
    pass_s(0.5);
    ck_assert_uint_eq(look().fault, MK_WIRE_FAULT_WATCHDOG);
    ck_assert_uint_eq(look().status & MK_WIRE_ST_STANDALONE, 0);
    ck_assert_int_eq(mk_wire_start(wire, &err), MK_ERR_STATE);
}
END_TEST

START_TEST(a_link_that_goes_round_and_round_is_a_fault)
{
    use_rig(MK_PLANT_FURUTA);
    choose(MK_CONTROLLER_FURUTA);
    const float away[] = {-5.0f, -1.0f, -1.0f, 0.0f}; /* drives the arm round for good */
    const float at_once[] = {1e6f, 4.0f, 1e6f};       /* balances wherever it is */
    ck_assert_int_eq(mk_wire_gains(wire, 0, away, 4, &err), MK_OK);
    ck_assert_int_eq(mk_wire_gains(wire, 19, at_once, 3, &err), MK_OK);
    start();
    pass_s(20.0);
    ck_assert_uint_eq(look().fault, MK_WIRE_FAULT_TRAVEL);
}
END_TEST

/* Ten turns; what is no number is out of it, and a wheel turns as far as it likes. */
START_TEST(the_end_of_the_travel_is_out_of_it_either_way)
{
    static const struct {
        float link, wheel;
        bool out;
    } rows[] = {{62.9f, 0.0f, false}, {-62.9f, 0.0f, false},  {63.0f, 0.0f, true},
                {-63.0f, 0.0f, true}, {1e6f, 0.0f, true},     {-1e6f, 0.0f, true},
                {NAN, 0.0f, true},    {INFINITY, 0.0f, true}, {0.0f, 1e6f, false},
                {0.0f, -1e6f, false}, {0.0f, NAN, false},     {63.0f, 63.0f, true}};
    static struct mk_standalone s;
    ck_assert(mk_standalone_setup(&s, MK_CONTROLLER_REACTION_WHEEL, 2000, 1));
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        s.angle[0] = rows[i].link;
        s.angle[1] = rows[i].wheel;
        ck_assert_msg(mk_standalone_out_of_travel(&s) == rows[i].out, "row %zu", i);
    }
}
END_TEST

/* At rest so far from upright, in the phase before: a link that balances may go further than where
 * it is taken over. */
START_TEST(a_board_balances_from_its_box_on_until_the_link_has_fallen)
{
    enum { SWING = MK_STANDALONE_SWINGUP, HOLD = MK_STANDALONE_BALANCE };
    static const struct {
        enum mk_controller law;
        uint32_t before;
        float off[MK_WIRE_JOINTS];
        uint32_t after;
    } rows[] = {{MK_CONTROLLER_REACTION_WHEEL, MK_STANDALONE_IDLE, {0.02f}, HOLD},
                {MK_CONTROLLER_REACTION_WHEEL, SWING, {-0.02f}, HOLD},
                {MK_CONTROLLER_REACTION_WHEEL, SWING, {0.1f}, SWING},
                {MK_CONTROLLER_REACTION_WHEEL, HOLD, {0.1f}, HOLD},
                {MK_CONTROLLER_REACTION_WHEEL, HOLD, {-0.79f}, HOLD},
                {MK_CONTROLLER_REACTION_WHEEL, HOLD, {0.81f}, SWING},
                {MK_CONTROLLER_REACTION_WHEEL, HOLD, {3.1f}, SWING},
                {MK_CONTROLLER_FURUTA, MK_STANDALONE_IDLE, {0.0f, 0.05f}, HOLD},
                {MK_CONTROLLER_FURUTA, SWING, {0.0f, 0.5f}, SWING},
                {MK_CONTROLLER_FURUTA, SWING, {1.1f, 0.0f}, SWING},
                {MK_CONTROLLER_FURUTA, HOLD, {0.0f, -0.5f}, HOLD},
                {MK_CONTROLLER_FURUTA, HOLD, {2.4f, 0.0f}, HOLD},
                {MK_CONTROLLER_FURUTA, HOLD, {2.6f, 0.0f}, SWING},
                {MK_CONTROLLER_FURUTA, HOLD, {0.0f, 1.3f}, SWING}};
    static struct mk_standalone s;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        const int link = rows[i].law == MK_CONTROLLER_FURUTA; /* that stands upright */
        float q[MK_WIRE_JOINTS] = {rows[i].off[0], rows[i].off[1]};
        q[link] += (float)M_PI;
        ck_assert(mk_standalone_setup(&s, rows[i].law, 2000, 1));
        mk_standalone_start(&s, 0);
        s.phase = rows[i].before;
        (void)mk_standalone_step(&s, q);
        ck_assert_msg(s.phase == rows[i].after, "row %zu: phase %u", i, s.phase);
    }
}
END_TEST

/* Three poles at exp(-120 dt): what a step of an angle leaves of itself after n samples is known,
 * as is that nothing is left of a steady acceleration. */
START_TEST(speeds_are_estimated_without_ringing_and_without_lagging_behind)
{
    static struct mk_standalone s;
    const double dt = 0.002, z = exp(-120.0 * dt);
    ck_assert(mk_standalone_setup(&s, MK_CONTROLLER_PENDUBOT_MID, 2000, 1));
    mk_standalone_start(&s, 0);
    for (int n = -1; n < 60; n++, s.sample++) {
        const float q[MK_WIRE_JOINTS] = {n < 0 ? 0.0f : 1.0f, n < 0 ? 0.0f : -0.5f};
        (void)mk_standalone_step(&s, q);
        /* The inverse transform of (1 - z^-1)^2 / (1 - p z^-1)^3. */
        double off = 0.0;
        for (int k = 0, weight[] = {1, -2, 1}; k < 3; k++)
            off += n < k ? 0.0 : weight[k] * 0.5 * (n - k + 1) * (n - k + 2) * pow(z, n - k);
        off *= z * z * z;
        ck_assert_double_eq_tol((double)s.angle[0], n < 0 ? 0.0 : 1.0 - off, 1e-4);
        ck_assert_double_eq_tol((double)s.angle[1], n < 0 ? 0.0 : -0.5 * (1.0 - off), 1e-4);
    }
    mk_standalone_start(&s, 0);
    for (; s.sample < 150; s.sample++) {
        const double t = dt * s.sample;
        const float q[MK_WIRE_JOINTS] = {(float)(10.0 * t * t), (float)(-5.0 * t * t)};
        (void)mk_standalone_step(&s, q);
    }
    ck_assert_double_eq_tol((double)s.speed[0], 20.0 * 149 * dt, 0.02);
    ck_assert_double_eq_tol((double)s.speed[1], -10.0 * 149 * dt, 0.02);
}
END_TEST

/* What a board did before says nothing of what comes. */
START_TEST(a_controller_that_is_chosen_or_started_anew_begins_from_nothing)
{
    static struct mk_standalone s;
    const int32_t count[MK_WIRE_JOINTS] = {0, 0};
    const float rest[MK_WIRE_JOINTS] = {0.1f, 0.1f}, gone[MK_WIRE_JOINTS] = {3.0f, -2.0f};
    for (int c = MK_CONTROLLER_NONE + 1; c < MK_CONTROLLER_COUNT; c++) {
        float first[2];
        for (int run = 0; run < 2; run++) {
            ck_assert(mk_standalone_setup(&s, (enum mk_controller)c, 2000, 1));
            ck_assert(!s.running);
            ck_assert_uint_eq(s.recorded, 0);
            ck_assert_uint_eq(s.phase, MK_STANDALONE_IDLE);
            mk_standalone_start(&s, 0);
            first[run] = mk_standalone_step(&s, rest);
            for (int k = 0; k < 5000; k++) {
                mk_standalone_record(&s, count, 0);
                (void)mk_standalone_step(&s, gone);
            }
            ck_assert_uint_eq(s.recorded, MK_STANDALONE_RECORDS);
            mk_standalone_start(&s, 0);
            ck_assert(mk_standalone_step(&s, rest) == first[run]);
        }
        ck_assert(first[0] == first[1]);
    }
    ck_assert_int_eq(mk_standalone_gain_count(MK_CONTROLLER_NONE), 0);
    ck_assert_int_eq(mk_standalone_gain_count(MK_CONTROLLER_COUNT), 0);
}
END_TEST

/* Gains in the order of docs/protocol.md. */
enum {
    PUMP = 11,
    SHARPNESS,
    REACH,
    HOLD_P,
    HOLD_D,
    HOLD_SPEED,
    CENTRE_P,
    CENTRE_D,
    BOX,
    BOX_U = 21
};

/* Two laws in two precisions, of the same energy by the same equations: on the way up, about to
 * turn, beyond the reach, and at rest below, where each gives the first push. */
START_TEST(the_board_swings_links_up_by_the_law_of_the_host)
{
    static const struct {
        enum mk_controller law;
        enum mk_plant_kind plant;
        double target;
    } rows[] = {{MK_CONTROLLER_PENDUBOT_MID, MK_PLANT_PENDUBOT, -M_PI_2},
                {MK_CONTROLLER_PENDUBOT_TOP, MK_PLANT_PENDUBOT, M_PI_2},
                {MK_CONTROLLER_FURUTA, MK_PLANT_FURUTA, 0.0}};
    static const double off[][4] = {{0.3, 0.7, 1.1, -2.3}, {-0.8, 2.6, -3.7, 1.9},
                                    {0.2, -1.4, 0.4, 6.1}, {-0.1, 1.9, -0.2, 0.3},
                                    {1.6, 0.5, 2.1, 3.2},  {-1.5, -2.9, 0.3, -4.0},
                                    {1.1, 3.0, -0.6, -8.0}};
    static struct mk_standalone s;
    const struct mk_plant_info *plant = mk_plant(rows[_i].plant);
    mk_model_default(rows[_i].plant, &model);
    ck_assert(mk_standalone_setup(&s, rows[_i].law, 2000, 1));
    s.gain[SHARPNESS] = 0.9f; /* so that a pump is not all or nothing */
    s.gain[BOX_U] = 0.0f;
    const double row[MK_PUMP_ROWS] = {s.gain[PUMP],
                                      s.gain[SHARPNESS],
                                      0.0,
                                      s.gain[REACH],
                                      1.5,
                                      s.gain[HOLD_P],
                                      s.gain[HOLD_D],
                                      s.gain[HOLD_SPEED],
                                      s.gain[CENTRE_P],
                                      s.gain[CENTRE_D]};
    for (size_t k = 0; k <= sizeof off / sizeof off[0]; k++)
        for (uint32_t turn = 0; turn < 5; turn++) {
            double x[4] = {plant->rest[0], plant->rest[1], 0.02, -0.01};
            for (int i = 0; k > 0 && i < 4; i++)
                x[i] = off[k - 1][i] + (i == 0 ? rows[_i].target : 0.0);
            for (int j = 0; j < MK_WIRE_JOINTS; j++) {
                s.angle[j] = (float)(x[j] - plant->rest[j]);
                s.speed[j] = (float)x[2 + j];
            }
            s.phase = MK_STANDALONE_SWINGUP;
            s.sample = 750 * turn + 10; /* the strength changes after a second and a half */
            const double since_s = 0.002 * s.sample;
            const double want = mk_pfl_command(
                &model, x, mk_link_pump(&model, x, rows[_i].target, since_s, 0.0, row));
            const double got = mk_laws[rows[_i].law]->step(&s);
            ck_assert_uint_eq(s.phase, MK_STANDALONE_SWINGUP);
            ck_assert_msg(fabs(got - want) < 1e-4 * (1.0 + fabs(want)),
                          "state %zu, turn %u: %g, not %g", k, turn, got, want);
        }
}
END_TEST

/* Report (2.27), (2.31), within the command that there is; a push where there is no direction, and
 * the motor's friction beside all of it. States are th, dth and the wheel's speed on the pendulum.
 */
START_TEST(the_board_pumps_a_pendulum_with_its_wheel_by_the_law_of_the_report)
{
    static const double state[][3] = {{0.0, 0.0, 0.0},   {0.03, 0.05, 3.0},  {0.03, -0.05, -3.0},
                                      {0.5, 1.0, 20.0},  {-1.9, 2.5, -60.0}, {2.4, -3.1, 150.0},
                                      {-2.8, -0.4, 5.0}, {3.1, 5.9, 80.0},   {2.9, -7.0, -120.0},
                                      {1.2, 0.02, 0.3},  {-2.0, 4.0, 449.0}, {-1.0, -8.4, 330.0}};
    enum { P1 = 3, P3 = 5, VISCOUS, COULOMB, K_E = 8, K_V, K_U, KICK, WHEEL_BOX = 13 };
    static struct mk_standalone s;
    ck_assert(mk_standalone_setup(&s, MK_CONTROLLER_REACTION_WHEEL, 2000, 1));
    s.gain[K_U] = 0.05f; /* so that some of it is within the limit */
    s.gain[WHEEL_BOX] = 0.0f;
    double k[MK_STANDALONE_GAINS];
    for (int i = 0; i < MK_STANDALONE_GAINS; i++)
        k[i] = s.gain[i];
    for (size_t i = 0; i < sizeof state / sizeof state[0]; i++) {
        const double th = state[i][0], v = state[i][1], relative = state[i][2], w = v + relative;
        const double weight = k[P3] * 9.81, top = 2.0 * weight;
        const double energy = 0.5 * k[P1] * v * v + weight * (1.0 - cos(th));
        double want = -k[K_U] * (k[K_V] * w - k[K_E] * (energy - top) * v);
        want = fmin(fmax(want, -k[KICK]), k[KICK]);
        if (energy < 0.004 * top)
            want = v > 0.0 ? -k[KICK] : k[KICK];
        want += k[VISCOUS] * relative + k[COULOMB] * tanh(15.0 * relative);
        s.angle[0] = (float)th;
        s.speed[0] = (float)v;
        s.speed[1] = (float)relative;
        s.phase = MK_STANDALONE_SWINGUP;
        s.going_round = false;
        const double got = mk_laws[MK_CONTROLLER_REACTION_WHEEL]->step(&s);
        ck_assert_msg(fabs(got - want) < 1e-3, "state %zu: %g, not %g", i, got, want);
        ck_assert(!s.going_round);
    }
}
END_TEST

/* A wheel that is held by hand: the integral grows until it asks for all that there is by itself.
 */
START_TEST(the_integral_of_a_speed_that_is_not_reached_ends_at_the_whole_command)
{
    static struct mk_standalone s;
    for (int side = -1; side <= 1; side += 2) {
        ck_assert(mk_standalone_setup(&s, MK_CONTROLLER_PI_SPEED, 2000, 1));
        mk_standalone_start(&s, 0);
        s.gain[2] = (float)side * 50.0f;
        for (int k = 1; k <= 200; k++) {
            const double want = 0.15 * 50.0 + fmin(0.75 * 50.0 * 0.002 * k, 10.0);
            const double got = mk_laws[MK_CONTROLLER_PI_SPEED]->step(&s);
            ck_assert_double_eq_tol(got, side * want, 1e-3);
        }
    }
}
END_TEST

/* Over the top at 6 rad/s with the wheel at its limit already, which would be so for ever. */
START_TEST(a_pendulum_that_goes_round_is_brought_back_by_the_board)
{
    static struct mk_standalone s;
    struct mk_rig_config config;
    struct mk_rig *rig;
    mk_model_default(MK_PLANT_REACTION_WHEEL, &model);
    mk_rig_config_default(&config);
    config.start[0] = M_PI;
    config.start_v[0] = 6.0;
    config.start_v[1] = 500.0;
    ck_assert_int_eq(mk_rig_create(&model, &config, &rig, &err), MK_OK);
    ck_assert(mk_standalone_setup(&s, MK_CONTROLLER_REACTION_WHEEL, 2000, 1));
    mk_standalone_start(&s, 0);
    const double *x = mk_rig_state(rig);
    bool round = false;
    for (; s.sample < 7000 && !(round && s.phase == MK_STANDALONE_BALANCE); s.sample++) {
        const float q[MK_WIRE_JOINTS] = {(float)x[0], (float)x[1]};
        float u = mk_standalone_step(&s, q);
        round = round || s.going_round;
        ck_assert_int_eq(mk_rig_advance(rig, 0.002, u, &err), MK_OK);
    }
    ck_assert(round);
    ck_assert_uint_lt(s.sample, 7000);
    ck_assert_double_lt(fabs(x[0]), 20.0 * M_PI);
    mk_rig_destroy(rig);
}
END_TEST

START_TEST(only_what_is_there_can_be_chosen)
{
    int gains;
    use_rig(MK_PLANT_PENDUBOT);
    ck_assert_int_eq(mk_wire_start(wire, &err), MK_ERR_STATE);
    ck_assert_int_eq(mk_wire_setup(wire, MK_CONTROLLER_NONE, 2000, 1, &gains, &err), MK_ERR_RANGE);
    ck_assert_int_eq(mk_wire_setup(wire, 99, 2000, 1, &gains, &err), MK_ERR_RANGE);
    ck_assert_int_eq(mk_wire_setup(wire, 1, 10, 1, &gains, &err), MK_ERR_RANGE);
    ck_assert_int_eq(mk_wire_setup(wire, 1, 2000, 0, &gains, &err), MK_ERR_RANGE);
}
END_TEST

/* --- from the command line --- */

START_TEST(the_recorded_arrays_last_for_the_whole_run_or_it_is_refused_before_it_begins)
{
    char said[4096];
    const char *out = scratch("standalone.csv");
    struct mk_log *log;
    ck_assert_int_eq(
        run_mechkit(said, sizeof said, "standalone pi-speed --fast --seconds 30 --out %s", out), 0);
    ck_assert_int_eq(mk_log_read(out, &log, NULL), MK_OK);
    ck_assert_double_ge(mk_log_get(log, "t")[log->rows - 1], 29.9);
    mk_log_free(log);
    ck_assert_int_eq(remove(out), 0);
    ck_assert_int_eq(run_mechkit(said, sizeof said,
                                 "standalone pi-speed --fast --seconds 2089 --out %s 2>&1", out),
                     2);
    ck_assert_msg(strstr(said, "the board's arrays last for 2088 s at 500 Hz") != NULL, "%s", said);
    ck_assert_int_ne(access(out, F_OK), 0);
}
END_TEST

START_TEST(a_signal_halts_the_board_and_what_it_recorded_is_kept)
{
    static const int numbers[] = {SIGINT, SIGTERM, SIGHUP};
    char csv[256], out[256], errors[256];
    snprintf(csv, sizeof csv, "%s", scratch("i.csv"));
    snprintf(out, sizeof out, "%s", scratch("i.out"));
    snprintf(errors, sizeof errors, "%s", scratch("i.err"));
    const char *const argv[] = {"mechkit", "standalone", "pi-speed", "--seconds",
                                "60",      "--out",      csv,        NULL};
    pid_t child = spawn(argv, out, errors);
    usleep(3000000); /* rest is looked for first, for half a second */
    kill(child, numbers[_i]);
    struct outcome o = finish(child, out, errors);
    ck_assert_msg(o.code == 1 && strstr(o.err, "interrupted; the motor is off"), "%d %s", o.code,
                  o.err);
    struct mk_log *log;
    ck_assert_int_eq(mk_log_read(csv, &log, NULL), MK_OK);
    double end = mk_log_get(log, "t")[log->rows - 1];
    ck_assert_msg(end > 0.5 && end < 30.0, "%g", end);
    mk_log_free(log);
}
END_TEST

Suite *suite_standalone(void)
{
    Suite *s = suite_create("standalone");
    TCase *t = tcase_create("standalone");
    tcase_add_checked_fixture(t, NULL, teardown);
    tcase_add_loop_test(t, the_board_swings_up_and_balances_by_itself, 0, 4);
    tcase_add_test(t, gains_can_be_exchanged_while_it_runs);
    tcase_add_test(t, a_wheel_is_held_at_its_speed_when_its_counter_wraps);
    tcase_add_test(t, gains_that_are_none_are_refused_and_change_nothing);
    tcase_add_loop_test(t, a_law_whose_command_is_none_is_a_fault_and_the_motor_is_off, 0, 2);
    tcase_add_test(t, the_arrays_come_up_whole);
    tcase_add_test(t, a_second_run_counts_its_samples_from_the_start_again);
    tcase_add_test(t, while_the_board_controls_commands_of_the_host_do_not_act);
    tcase_add_test(t, a_guarded_run_ends_when_the_guard_falls_silent);
    tcase_add_test(t, a_link_that_goes_round_and_round_is_a_fault);
    tcase_add_test(t, the_end_of_the_travel_is_out_of_it_either_way);
    tcase_add_test(t, a_board_balances_from_its_box_on_until_the_link_has_fallen);
    tcase_add_test(t, speeds_are_estimated_without_ringing_and_without_lagging_behind);
    tcase_add_test(t, a_controller_that_is_chosen_or_started_anew_begins_from_nothing);
    tcase_add_loop_test(t, the_board_swings_links_up_by_the_law_of_the_host, 0, 3);
    tcase_add_test(t, the_board_pumps_a_pendulum_with_its_wheel_by_the_law_of_the_report);
    tcase_add_test(t, the_integral_of_a_speed_that_is_not_reached_ends_at_the_whole_command);
    tcase_add_test(t, a_pendulum_that_goes_round_is_brought_back_by_the_board);
    tcase_add_test(t, only_what_is_there_can_be_chosen);
    suite_add_tcase(s, t);
    TCase *commands = tcase_create("commands");
    tcase_add_test(commands,
                   the_recorded_arrays_last_for_the_whole_run_or_it_is_refused_before_it_begins);
    tcase_add_loop_test(commands, a_signal_halts_the_board_and_what_it_recorded_is_kept, 0, 3);
    tcase_set_timeout(commands, 30);
    suite_add_tcase(s, commands);
    return s;
}
