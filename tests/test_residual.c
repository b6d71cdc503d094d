/* Encoders that lie, found by the nominal model; and rigs that are off the model, left alone. */
#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "ctrl/ctrl_rig.h"
#include "ctrl/residual.h"
#include "experiment/robustness.h"
#include "mechkit/loop.h"
#include "support/bench.h"

#define DT 0.002

/* --- whole runs --- */

#define SETUP_COUNT 4
static const struct {
    const char *setup;
    enum mk_plant_kind plant;
} setups[SETUP_COUNT] = {{"pendubot-mid", MK_PLANT_PENDUBOT},
                         {"pendubot-top", MK_PLANT_PENDUBOT},
                         {"reaction-wheel", MK_PLANT_REACTION_WHEEL},
                         {"furuta", MK_PLANT_FURUTA}};

/* Runs a setup on the nominal virtual rig under a fault script for at most `seconds`. */
static struct mk_loop_snapshot run_setup(const char *name, double rate_hz, const char *faults,
                                         double seconds)
{
    const struct mk_ctrl_ops *setup = mk_ctrl_setup_by_name(name);
    struct mk_error err = MK_ERROR_INIT;
    struct mk_model model;
    struct mk_clock clock;
    struct mk_ctrl *ctrl = NULL;
    struct mk_board *board = NULL;
    struct mk_loop *loop = NULL;
    struct mk_loop_config config;
    struct mk_loop_snapshot last;
    mk_model_default(mk_ctrl_first_rig(setup), &model);
    mk_clock_init_simulated(&clock);
    mk_loop_config_default(&model, &config);
    config.rate_hz = rate_hz;
    const struct mk_board_config board_config = {
        .model = &model, .clock = &clock, .fault_script = faults};
    ck_assert_int_eq(
        mk_board_open(mk_board_backend_by_name("virtual"), &board_config, &board, &err), MK_OK);
    ck_assert_int_eq(mk_ctrl_create(setup, &model, 1.0 / rate_hz, NULL, &ctrl, &err), MK_OK);
    ck_assert_int_eq(mk_loop_create(board, ctrl, &config, &loop, &err), MK_OK);
    ck_assert_int_eq(mk_loop_start(loop, NULL, NULL, 0, &err), MK_OK);
    enum mk_status st = mk_loop_wait(loop, seconds, NULL, NULL, NULL, &err);
    mk_loop_get_snapshot(loop, &last);
    ck_assert_int_eq(st, last.fault ? MK_ERR_FAULT : MK_OK);
    mk_loop_destroy(loop);
    mk_ctrl_destroy(ctrl);
    mk_board_close(board);
    return last;
}

static struct mk_loop_snapshot run_at(double rate_hz, int setup, const char *faults, double seconds)
{
    return run_setup(setups[setup].setup, rate_hz, faults, seconds);
}

static struct mk_loop_snapshot run_with(int setup, const char *faults, double seconds)
{
    return run_at(1.0 / DT, setup, faults, seconds);
}

/* Seconds that docs/safety.md promises: while a rig swings up or is caught, and while it is held so
 * quietly that the other encoder alone balances it. */
#define FOUND_SWINGING_S 0.35
#define FOUND_HELD_S 6.0

/* Where the other encoder has not counted for a while either, nobody can tell which is dead. */
static bool is_named(const struct mk_loop_snapshot *end, int joint)
{
    return end->fault_joint == joint || end->fault_joint == 0;
}

START_TEST(a_dead_encoder_of_either_joint_of_every_setup_stops_the_motor)
{
    static const int at[] = {500, 1500, 4000};
    for (int joint = 1; joint <= 2; joint++)
        for (size_t k = 0; k < sizeof at / sizeof at[0]; k++) {
            char script[40];
            snprintf(script, sizeof script, "at %d stuck %d", at[k], joint);
            struct mk_loop_snapshot end = run_with(_i, script, at[k] * DT + FOUND_HELD_S);
            double took_s = end.fault_t - at[k] * DT;
            ck_assert_msg(end.fault == MK_FAULT_STUCK && is_named(&end, joint),
                          "%s, %s: %s, joint %d", setups[_i].setup, script,
                          mk_fault_name(end.fault), end.fault_joint);
            ck_assert_msg(took_s <= (at[k] == 500 ? FOUND_SWINGING_S : FOUND_HELD_S),
                          "%s, %s: after %.3f s", setups[_i].setup, script, took_s);
            ck_assert_double_eq(end.sample.u, 0.0);
        }
}
END_TEST

/* A supply that fails takes both encoders with it. */
#define FOUND_BOTH_S 1.5

static const char *const balancing[] = {"furuta",  "pendubot-mid",   "pendubot-top",
                                        "acrobot", "reaction-wheel", "cart-pole"};
#define BALANCING_COUNT ((int)(sizeof balancing / sizeof balancing[0]))

START_TEST(encoders_that_die_together_stop_the_motor_of_every_setup)
{
    static const int at[] = {0, 400, 1500, 3000};
    for (size_t k = 0; k < sizeof at / sizeof at[0]; k++) {
        char script[60];
        snprintf(script, sizeof script, "at %d stuck 1; at %d stuck 2", at[k], at[k]);
        struct mk_loop_snapshot end =
            run_setup(balancing[_i], 1.0 / DT, script, at[k] * DT + FOUND_BOTH_S);
        ck_assert_msg(end.fault == MK_FAULT_STUCK, "%s, %s: %s", balancing[_i], script,
                      mk_fault_name(end.fault));
        ck_assert_double_eq(end.sample.u, 0.0);
    }
}
END_TEST

START_TEST(an_encoder_that_slips_by_fifty_counts_stops_the_motor_at_once)
{
    for (int joint = 1; joint <= 2; joint++) {
        char script[40];
        snprintf(script, sizeof script, "at 4000 jump %d by 50", joint);
        struct mk_loop_snapshot end = run_with(_i, script, 9.0);
        ck_assert_msg(end.fault == MK_FAULT_JUMP, "%s, %s: %s", setups[_i].setup, script,
                      mk_fault_name(end.fault));
        ck_assert_int_eq(end.fault_joint, joint);
        ck_assert_double_eq_tol(end.fault_t, 8.0, 1e-9);
    }
}
END_TEST

/* Samples get lost when counts do: before the slip, with it, or every now and then all the time. */
START_TEST(an_encoder_that_slips_while_samples_are_lost_stops_the_motor_at_once)
{
    static const char *const lost[] = {
        "at 3999 drop 2", "at 4000 drop", "at 3998 drop; at 4000 drop",
        "at 4000 drop 3", "at 3995 mute", "at 3999 drop"};
    for (size_t k = 0; k < sizeof lost / sizeof lost[0]; k++)
        for (int joint = 1; joint <= 2; joint++) {
            char script[80];
            /* What the motor can do to a wheel within three samples is more than a hundred counts.
             */
            bool wheel = mk_plant(setups[_i].plant)->joint_is_wheel[joint - 1];
            snprintf(script, sizeof script, "%s; at 4000 jump %d by %d", lost[k], joint,
                     wheel ? -300 : -80);
            struct mk_loop_snapshot end = run_with(_i, script, 9.0);
            ck_assert_msg(end.fault == MK_FAULT_JUMP && end.fault_joint == joint, "%s, %s: %s",
                          setups[_i].setup, script, mk_fault_name(end.fault));
            ck_assert_double_le(end.fault_t, 8.0 + 3 * DT + 1e-9);
        }
}
END_TEST

/* Three in a row and a single one behind them, again and again from the start to the catch. */
START_TEST(lost_samples_are_no_jump)
{
    enum { RULES = 60, APART = 73 };
    static char script[40 * RULES];
    size_t n = 0;
    for (int k = 0; k < RULES; k++)
        n += (size_t)snprintf(script + n, sizeof script - n, "%sat %d drop %d", k ? ";" : "",
                              20 + APART * (k / 2) + k % 2 * 5, k % 2 ? 1 : 3);
    struct mk_loop_snapshot end = run_setup(balancing[_i], 1.0 / DT, script, 12.0);
    ck_assert_msg(end.fault == MK_FAULT_NONE, "%s: %s at %.3f s", balancing[_i],
                  mk_fault_name(end.fault), end.fault_t);
}
END_TEST

START_TEST(rigs_that_are_off_the_model_are_not_stopped)
{
    struct trial_spread spread;
    trial_spread_default(&spread);
    for (uint64_t seed = 1; seed <= 12; seed++) {
        struct mk_model nominal;
        struct trial t;
        mk_model_default(setups[_i].plant, &nominal);
        ck_assert_int_eq(
            trial_run(mk_ctrl_setup_by_name(setups[_i].setup), &nominal, &spread, seed, &t, NULL),
            MK_OK);
        ck_assert_msg(strncmp(t.fault, "encoder", 7) != 0, "%s, seed %d: %s", setups[_i].setup,
                      (int)seed, t.fault);
    }
}
END_TEST

static const double rates_hz[] = {MK_LOOP_RATE_MIN_HZ, 150.0, MK_LOOP_RATE_MAX_HZ};
#define RATE_COUNT ((int)(sizeof rates_hz / sizeof rates_hz[0]))

START_TEST(rigs_are_not_stopped_at_the_slowest_and_the_fastest_rate)
{
    static const char *const names[] = {"pendubot-mid", "pendubot-top", "reaction-wheel",
                                        "furuta",       "cart-pole",    "acrobot"};
    struct trial_spread spread;
    trial_spread_default(&spread);
    spread.rate_hz = rates_hz[_i];
    for (size_t k = 0; k < sizeof names / sizeof names[0]; k++)
        for (uint64_t seed = 1; seed <= 3; seed++) {
            const struct mk_ctrl_ops *setup = mk_ctrl_setup_by_name(names[k]);
            struct mk_model nominal;
            struct trial t;
            mk_model_default(mk_ctrl_first_rig(setup), &nominal);
            ck_assert_int_eq(trial_run(setup, &nominal, &spread, seed, &t, NULL), MK_OK);
            ck_assert_msg(t.end != TRIAL_FAULT, "%s, seed %d: %s", names[k], (int)seed, t.fault);
        }
}
END_TEST

START_TEST(a_dead_encoder_stops_the_motor_at_the_slowest_and_the_fastest_rate)
{
    const double rate_hz = rates_hz[_i], died_s = 3.0;
    for (int setup = 0; setup < SETUP_COUNT; setup++)
        for (int joint = 1; joint <= 2; joint++) {
            char script[40];
            snprintf(script, sizeof script, "at %d stuck %d", (int)(died_s * rate_hz), joint);
            struct mk_loop_snapshot end = run_at(rate_hz, setup, script, died_s + FOUND_HELD_S);
            ck_assert_msg(end.fault == MK_FAULT_STUCK && is_named(&end, joint),
                          "%g Hz, %s, %s: %s, joint %d", rate_hz, setups[setup].setup, script,
                          mk_fault_name(end.fault), end.fault_joint);
        }
}
END_TEST

START_TEST(noise_of_two_counts_is_no_jump)
{
    struct mk_loop_snapshot end = run_with(_i, "from 2000 to 6000 noise 2", 13.0);
    ck_assert_msg(end.fault == MK_FAULT_NONE, "%s: %s at %.3f s", setups[_i].setup,
                  mk_fault_name(end.fault), end.fault_t);
}
END_TEST

START_TEST(a_wheel_that_friction_holds_is_not_stopped)
{
    bench_use_plant(MK_PLANT_INERTIA_WHEEL);
    bench_build_driving(NULL, 0.35); /* Coulomb friction: 0.3487 */
    bench_start();
    ck_assert_int_eq(bench_wait_for(20), MK_OK);
}
END_TEST

START_TEST(a_model_that_may_be_off_by_all_of_it_stops_nothing)
{
    bench.config.limits.model_share = 1.0;
    bench_build_driving("at 0 stuck 2", 3);
    bench_start();
    ck_assert_int_eq(bench_wait_for(2), MK_OK);
}
END_TEST

/* --- sample by sample --- */

static struct mk_model model;
static struct mk_safety_limits limits;
static struct mk_residual residual;
static double now;

static void watch(enum mk_plant_kind kind)
{
    mk_model_default(kind, &model);
    mk_safety_default(&model, DT, &limits);
    mk_residual_init(&residual, &model, &limits);
    now = 0.0;
}

static enum mk_fault look(double dt, double q1, double q2, double u, int *joint)
{
    const double q[MK_MAX_JOINTS] = {q1, q2}, v[MK_MAX_JOINTS] = {0.0, 0.0};
    now += dt;
    return mk_residual_step(&residual, now, dt, q, v, u, joint);
}

/* Samples until the fault; at most 2000. */
static int samples_until(enum mk_fault fault, double q1, double q2, double u, int *joint)
{
    for (int k = 0; k < 2000; k++) {
        enum mk_fault found = look(DT, q1, q2, u, joint);
        if (found != MK_FAULT_NONE) {
            ck_assert_int_eq(found, fault);
            return k;
        }
    }
    return 2000;
}

START_TEST(a_link_that_nothing_holds_up_cannot_rest_while_the_motor_drives)
{
    int joint = 0;
    watch(MK_PLANT_PENDUBOT);
    /* Link 1 turns so that its reading lives; link 2 is said to stand out sideways. */
    int n = 0;
    for (enum mk_fault f = MK_FAULT_NONE; f == MK_FAULT_NONE && n < 2000; n++)
        f = look(DT, -M_PI_2 + 0.002 * n, 1.0, 1.0, &joint);
    ck_assert_int_lt(n, 50);
    ck_assert_int_eq(joint, 2);
}
END_TEST

START_TEST(a_rig_that_is_held_by_hand_with_the_motor_off_is_left_alone)
{
    int joint = 0;
    watch(MK_PLANT_PENDUBOT);
    ck_assert_int_eq(samples_until(MK_FAULT_STUCK, -M_PI_2, 1.0, 0.0, &joint), 2000);
    ck_assert_int_lt(samples_until(MK_FAULT_STUCK, -M_PI_2, 1.0, 1.0, &joint), 100);
}
END_TEST

START_TEST(links_at_rest_under_a_weak_command_are_left_alone)
{
    int joint = 0;
    watch(MK_PLANT_PENDUBOT);
    ck_assert_int_eq(samples_until(MK_FAULT_STUCK, -M_PI_2, 0.0, 0.3, &joint), 2000);
}
END_TEST

/* A base that is tilted, or a zero that is off, pulls at links that rest all the same. */
START_TEST(links_that_rest_where_the_model_has_them_pulled_a_little_are_left_alone)
{
    int joint = 0;
    watch(MK_PLANT_PENDUBOT);
    ck_assert_int_eq(samples_until(MK_FAULT_STUCK, -M_PI_2 + 0.01, 0.01, 0.3, &joint), 2000);
    watch(MK_PLANT_PENDUBOT);
    ck_assert_int_eq(samples_until(MK_FAULT_STUCK, -M_PI_2 - 0.01, -0.01, 0.3, &joint), 2000);
}
END_TEST

/* Both links of the pendubot, or the acrobot, at rest as they hang, said to stay there. */
START_TEST(links_that_hang_cannot_rest_while_the_motor_drives)
{
    static const enum mk_plant_kind kinds[] = {MK_PLANT_PENDUBOT, MK_PLANT_ACROBOT};
    static const double u[] = {1.0, 2.0, 3.33, 4.4, 6.0, 7.5, -7.5};
    for (size_t k = 0; k < 2; k++)
        for (size_t i = 0; i < sizeof u / sizeof u[0]; i++) {
            int joint = -1;
            watch(kinds[k]);
            int n = samples_until(MK_FAULT_STUCK, -M_PI_2, 0.0, u[i], &joint);
            ck_assert_msg(n * DT < 0.2, "%s, u %g: after %.3f s", mk_plant(kinds[k])->name, u[i],
                          n * DT);
            ck_assert_int_eq(joint, 0);
        }
}
END_TEST

/* Gravity holds link 1 against the motor, and the model knows that. */
START_TEST(links_that_rest_where_gravity_holds_the_motors_torque_are_left_alone)
{
    int joint = 0;
    watch(MK_PLANT_PENDUBOT);
    const double q[MK_MAX_JOINTS] = {-M_PI_2 + 0.5, -0.5}; /* link 2 hangs straight down */
    const double held = model.parameter[3] * model.g * cos(q[0]);
    ck_assert_double_gt(held, 3.0);
    ck_assert_int_eq(samples_until(MK_FAULT_STUCK, q[0], q[1], held, &joint), 2000);
}
END_TEST

/* A torque of its own that the model has holds link 1 against the motor, whichever way it acts. */
START_TEST(links_that_rest_where_an_effect_of_the_model_may_hold_them_are_left_alone)
{
    for (int k = 0; k < 2; k++) {
        int joint = 0;
        watch(MK_PLANT_PENDUBOT);
        ck_assert_int_eq(mk_model_add_effect(&model, "torque-offset", 1, NULL), MK_OK);
        model.effect[0].value[0] = k ? 1.0 : -1.0;
        mk_residual_init(&residual, &model, &limits);
        ck_assert_int_eq(samples_until(MK_FAULT_STUCK, -M_PI_2, 0.0, 1.0, &joint), 2000);
        ck_assert_int_lt(samples_until(MK_FAULT_STUCK, -M_PI_2, 0.0, 4.0, &joint), 100);
    }
}
END_TEST

/* Its dry friction is nothing at rest and all of it in the slowest motion. */
START_TEST(a_wheel_that_an_effect_of_its_model_would_brake_is_left_alone)
{
    int joint = 0;
    watch(MK_PLANT_INERTIA_WHEEL);
    ck_assert_int_eq(mk_model_add_effect(&model, "coulomb", 1, NULL), MK_OK);
    model.effect[0].value[0] = 5.0;
    model.parameter[0] = 1.0; /* so heavy that it would be slow for long */
    mk_residual_init(&residual, &model, &limits);
    ck_assert_int_eq(samples_until(MK_FAULT_STUCK, 0.0, 0.0, 4.0, &joint), 2000);
    ck_assert_int_lt(samples_until(MK_FAULT_STUCK, 0.0, 0.0, 9.5, &joint), 1000);
}
END_TEST

/* 5 N m brake it the one way round, and 1 N m the other. */
START_TEST(a_wheel_that_an_effect_of_its_model_would_brake_one_way_round_is_left_alone_there)
{
    for (int side = -1; side <= 1; side += 2) {
        int joint = 0;
        watch(MK_PLANT_INERTIA_WHEEL);
        ck_assert_int_eq(mk_model_add_effect(&model, "coulomb", 1, NULL), MK_OK);
        ck_assert_int_eq(mk_model_add_effect(&model, "coulomb-asymmetry", 1, NULL), MK_OK);
        model.effect[0].value[0] = 3.0;
        model.effect[1].value[0] = side * 4.0;
        model.parameter[0] = 1.0;
        mk_residual_init(&residual, &model, &limits);
        ck_assert_int_eq(samples_until(MK_FAULT_STUCK, 0.0, 0.0, side * 4.0, &joint), 2000);
        ck_assert_int_lt(samples_until(MK_FAULT_STUCK, 0.0, 0.0, side * 9.5, &joint), 1000);
    }
}
END_TEST

/* Samples until link 1 of a pendubot, whose reading stands still while link 2 sways, is said to be
 * stuck; the estimate of its speed lags and says `v1`. */
static int samples_until_a_sway_is_missed(double v1, double amplitude)
{
    watch(MK_PLANT_PENDUBOT);
    for (int k = 0; k < 1000; k++) {
        int joint = 0;
        const double phase = 12.0 * DT * k;
        const double q[MK_MAX_JOINTS] = {-M_PI_2, 0.5 + amplitude * sin(phase)};
        const double v[MK_MAX_JOINTS] = {v1, 12.0 * amplitude * cos(phase)};
        enum mk_fault f = mk_residual_step(&residual, DT * k, DT, q, v, 0.3, &joint);
        if (f != MK_FAULT_NONE)
            return k;
    }
    return 1000;
}

START_TEST(a_sway_that_a_reading_does_not_show_is_missed_whatever_its_speed_estimate_says)
{
    ck_assert_int_eq(samples_until_a_sway_is_missed(0.0, 0.03), 1000);
    const int found = samples_until_a_sway_is_missed(0.0, 0.04);
    ck_assert_int_lt(found, 300);
    ck_assert_int_eq(samples_until_a_sway_is_missed(6.0, 0.04), found);
    ck_assert_int_eq(samples_until_a_sway_is_missed(-6.0, 0.04), found);
}
END_TEST

/* Samples until link 2 of a pendubot that weighs nothing, and of which all is known but its speed,
 * must have moved, and 30 if it need not: link 1 turns at 10 rad/s by its readings, and link 2
 * rests if that is `true_v`. */
static int samples_of_a_link_that_rests_at(double true_v)
{
    watch(MK_PLANT_PENDUBOT);
    model.g = 0.0;
    model.parameter[mk_plant(model.plant)->parameter_count - 1] = 0.0;
    limits.model_share = limits.model_reserve = 0.0;
    mk_residual_init(&residual, &model, &limits);
    const double v[MK_MAX_JOINTS] = {10.0, 0.0}, w[MK_MAX_JOINTS] = {true_v, 0.0};
    double q[MK_MAX_JOINTS] = {0.0, 0.5}, tau[MK_MAX_JOINTS] = {0.0, 0.0};
    double coasting[MK_MAX_JOINTS], driven[MK_MAX_JOINTS];
    mk_plant_acceleration(&model, q, w, tau, coasting);
    tau[0] = 1.0;
    mk_plant_acceleration(&model, q, w, tau, driven);
    const double u = coasting[1] / (coasting[1] - driven[1]);
    for (int k = 0; k < 30; k++) {
        int joint = 0;
        q[0] = v[0] * DT * k;
        enum mk_fault f = mk_residual_step(&residual, DT * k, DT, q, v, u, &joint);
        if (f == MK_FAULT_STUCK && joint == 2)
            return k;
    }
    return 30;
}

START_TEST(a_speed_is_believed_to_a_tenth_and_half_a_radian_a_second)
{
    ck_assert_int_eq(samples_of_a_link_that_rests_at(10.0), 30);
    ck_assert_int_eq(samples_of_a_link_that_rests_at(8.5), 30);
    ck_assert_int_eq(samples_of_a_link_that_rests_at(11.5), 30);
    ck_assert_int_lt(samples_of_a_link_that_rests_at(14.0), 30);
}
END_TEST

/* A dead supply at an upright that needs no command: readings that stay as they are whatever the
 * motor does. */
START_TEST(a_link_that_stands_upright_is_nudged_and_has_no_encoder_if_that_does_not_move_it)
{
    int joint = -1, n = 0;
    watch(MK_PLANT_PENDUBOT);
    residual.balances = true;
    for (enum mk_fault f = MK_FAULT_NONE; f == MK_FAULT_NONE && n < 2000; n++) {
        double u = mk_residual_command(&residual, 0.0);
        f = look(DT, -M_PI_2, M_PI, u, &joint);
        ck_assert(n * DT > 0.99 || u == 0.0);
        ck_assert_double_le(fabs(u), 0.15 * model.u_max);
    }
    ck_assert_int_eq(joint, 0);
    ck_assert(n * DT > 1.0 && n * DT < 1.3);
    watch(MK_PLANT_PENDUBOT); /* by hand, with the motor off */
    ck_assert_int_eq(samples_until(MK_FAULT_STUCK, -M_PI_2, M_PI, 0.0, &joint), 2000);
    ck_assert_double_eq(mk_residual_command(&residual, 0.25), 0.25);
}
END_TEST

START_TEST(a_nudge_ends_with_a_count_and_away_from_the_nearer_end_of_the_travel)
{
    const double from[] = {-M_PI_2 - 1.0, -M_PI_2 + 1.0};
    for (int k = 0; k < 2; k++) {
        int joint = 0, n = 0;
        watch(MK_PLANT_PENDUBOT);
        model.parameter[3] = model.parameter[4] = 1e-3; /* weightless, so that it may rest there */
        mk_residual_init(&residual, &model, &limits);
        residual.balances = true;
        for (; !residual.rest.nudges && n < 2000; n++)
            look(DT, from[k], M_PI, 0.0, &joint);
        double u = mk_residual_command(&residual, 0.25);
        ck_assert(fabs(u) > 0.25 && (u > 0.0) == (k == 0));
        look(DT, from[k], M_PI + mk_model_count(&model, 1), u, &joint);
        ck_assert_double_eq(mk_residual_command(&residual, 0.25), 0.25);
    }
}
END_TEST

START_TEST(a_nudge_ends_when_the_controller_holds_the_upright_no_more)
{
    int joint = 0;
    watch(MK_PLANT_PENDUBOT);
    residual.balances = true;
    for (int n = 0; !residual.rest.nudges && n < 2000; n++)
        look(DT, -M_PI_2, M_PI, 0.0, &joint);
    double u = mk_residual_command(&residual, 0.0);
    ck_assert_double_ne(u, 0.0);
    look(DT, -M_PI_2, M_PI, u, &joint); /* the motor drives now */
    residual.balances = false;
    look(DT, -M_PI_2, M_PI, u, &joint);
    ck_assert_double_eq(mk_residual_command(&residual, 0.25), 0.25);
}
END_TEST

START_TEST(a_nudge_is_no_command_of_the_next_run)
{
    int joint = 0;
    watch(MK_PLANT_PENDUBOT);
    residual.balances = true;
    for (int n = 0; !residual.rest.nudges && n < 2000; n++)
        look(DT, -M_PI_2, M_PI, 0.0, &joint);
    ck_assert_double_ne(mk_residual_command(&residual, 0.25), 0.25);
    mk_residual_init(&residual, &model, &limits);
    ck_assert_double_eq(mk_residual_command(&residual, 0.25), 0.25);
}
END_TEST

/* Its bearing may hold a link upright, and friction the other one: then a nudge moves it. */
START_TEST(a_rig_that_rests_while_it_is_balanced_is_nudged_and_left_alone)
{
    bench_build(NULL);
    bench_start(); /* hangs, and the law says that it balances and gives nothing */
    ck_assert_int_eq(bench_wait_for(10), MK_OK);
    bench_drop_loop();
    struct mk_log *log = bench_read_log();
    double most = 0.0, sum = 0.0;
    const double *u = mk_log_get(log, "u");
    for (size_t k = 0; k < log->rows; k++) {
        most = fmax(most, fabs(u[k]));
        sum += u[k] != 0.0;
    }
    mk_log_free(log);
    ck_assert(most > 0.05 * bench.model.u_max && most < 0.15 * bench.model.u_max);
    ck_assert_double_lt(sum * DT, 0.5);
}
END_TEST

START_TEST(lost_samples_do_not_clear_what_is_known_of_a_dead_encoder)
{
    int joint = 0, n = 0;
    watch(MK_PLANT_INERTIA_WHEEL);
    for (enum mk_fault f = MK_FAULT_NONE; f == MK_FAULT_NONE && n < 2000; n++)
        f = look(n % 3 ? DT : 2 * DT, 0.0, 0.0, 5.0, &joint);
    ck_assert_int_lt(n, 30);
}
END_TEST

/* Short pushes, none of which need move it by much, with rests in which it may come to a stop. */
START_TEST(pushes_that_a_joint_may_have_stopped_between_do_not_add_up)
{
    int joint = 0;
    watch(MK_PLANT_INERTIA_WHEEL);
    const int enough = samples_until(MK_FAULT_STUCK, 0.0, 0.0, 2.0, &joint);
    ck_assert_int_gt(enough, 5);
    watch(MK_PLANT_INERTIA_WHEEL);
    for (int push = 0; push < 20; push++)
        for (int k = 0; k < enough + 200; k++) {
            const double u = k < enough / 2 ? 2.0 : 0.0;
            ck_assert_msg(look(DT, 0.0, 0.0, u, &joint) == MK_FAULT_NONE, "push %d of %d samples",
                          push, enough / 2);
        }
}
END_TEST

/* What a motor gives beyond its friction sets a heavier wheel in motion later. */
START_TEST(a_wheel_that_is_a_quarter_heavier_than_its_model_has_the_time_to_move)
{
    int joint = 0;
    watch(MK_PLANT_INERTIA_WHEEL);
    model.parameter[0] = 1.0;
    mk_residual_init(&residual, &model, &limits);
    const double u = model.u_max, inertia = 1.25 * model.parameter[0];
    const double t = DT * samples_until(MK_FAULT_STUCK, 0.0, 0.0, u, &joint);
    const double way = 0.5 * (u - model.parameter[2]) / inertia * t * t;
    ck_assert_msg(way > limits.still_way[0], "%g s: %g rad", t, way);
    ck_assert_double_lt(t, 1.0);
}
END_TEST

START_TEST(a_wheel_that_stops_dead_at_full_speed_has_lost_its_encoder)
{
    int joint = 0, n = 0;
    watch(MK_PLANT_REACTION_WHEEL);
    for (int k = 0; k < 50; k++)
        ck_assert_int_eq(look(DT, 0.001 * k, 0.4 * k, 0.5, &joint), MK_FAULT_NONE);
    enum mk_fault f = MK_FAULT_NONE;
    for (; f == MK_FAULT_NONE && n < 100; n++)
        f = look(DT, 0.05 + 0.001 * n, 0.4 * 49, 0.5, &joint);
    ck_assert_int_lt(n, 5);
    ck_assert_int_eq(joint, 2);
}
END_TEST

/* At 50 rad/s and under a command that friction holds: its speed alone says that it must go on. */
START_TEST(a_wheel_that_stops_dead_while_its_motor_gives_little_has_lost_its_encoder)
{
    int joint = 0;
    watch(MK_PLANT_INERTIA_WHEEL);
    for (int k = 0; k < 50; k++)
        ck_assert_int_eq(look(DT, 0.1 * k, 0.0, 0.3, &joint), MK_FAULT_NONE);
    ck_assert_double_lt(0.3, model.parameter[2]);
    ck_assert_int_lt(samples_until(MK_FAULT_STUCK, 0.1 * 49, 0.0, 0.3, &joint), 5);
}
END_TEST

/* 30 rad/s, which takes a few samples to be sure of. */
START_TEST(a_wheel_that_stops_dead_is_found_as_soon_either_way_round)
{
    int joint = 0, took[2];
    for (int side = 0; side < 2; side++) {
        const double way = side == 0 ? 1.0 : -1.0;
        watch(MK_PLANT_INERTIA_WHEEL);
        for (int k = 0; k < 50; k++)
            ck_assert_int_eq(look(DT, way * 0.06 * k, 0.0, way * 0.5, &joint), MK_FAULT_NONE);
        took[side] = samples_until(MK_FAULT_STUCK, way * 0.06 * 49, 0.0, way * 0.5, &joint);
    }
    ck_assert_int_gt(took[0], 1);
    ck_assert_int_lt(took[0], 10);
    ck_assert_int_eq(took[1], took[0]);
}
END_TEST

/* An estimate of speed lags: at the speed it still tells, friction may well hold the motor's
 * balance, but a joint that stands still has none. */
START_TEST(a_joint_whose_reading_stands_still_is_judged_as_one_at_rest)
{
    watch(MK_PLANT_INERTIA_WHEEL);
    const double u = 5.0, friction = model.parameter[1], coulomb = model.parameter[2];
    const double q[MK_MAX_JOINTS] = {0.0, 0.0}, v[MK_MAX_JOINTS] = {(u - coulomb) / friction, 0.0};
    enum mk_fault fault = MK_FAULT_NONE;
    int joint = 0, n = 0;
    for (; fault == MK_FAULT_NONE && n < 100; n++)
        fault = mk_residual_step(&residual, DT * n, DT, q, v, u, &joint);
    ck_assert_int_eq(fault, MK_FAULT_STUCK);
    ck_assert_int_lt(n, 30);
}
END_TEST

/* At 50 rad/s, eight samples are lost, and the second one behind them slips by less than went by in
 * the gap: the speed is that of a sample, however long the gap. */
START_TEST(a_wheel_that_slips_right_behind_lost_samples_has_jumped)
{
    for (int side = -1; side <= 1; side += 2) {
        int joint = 0, k = 0;
        watch(MK_PLANT_INERTIA_WHEEL);
        for (; k < 50; k++)
            ck_assert_int_eq(look(DT, 0.1 * k, 0.0, 0.5, &joint), MK_FAULT_NONE);
        k += 8;
        ck_assert_int_eq(look(9 * DT, 0.1 * k, 0.0, 0.5, &joint), MK_FAULT_NONE);
        ck_assert_int_eq(look(DT, 0.1 * (k + 1), 0.0, 0.5, &joint), MK_FAULT_NONE);
        ck_assert_int_eq(look(DT, 0.1 * (k + 2) + side * 0.45, 0.0, 0.5, &joint), MK_FAULT_JUMP);
        ck_assert_int_eq(joint, 1);
    }
}
END_TEST

/* A wheel that dry friction of so many N m brakes, after a step back against its motion. */
static enum mk_fault step_back(double friction, double rad)
{
    int joint = 0;
    watch(MK_PLANT_INERTIA_WHEEL);
    ck_assert_int_eq(mk_model_add_effect(&model, "coulomb", 1, NULL), MK_OK);
    model.effect[0].value[0] = friction;
    mk_residual_init(&residual, &model, &limits);
    for (int k = 0; k < 50; k++)
        ck_assert_int_eq(look(DT, 0.01 * k, 0.0, 0.5, &joint), MK_FAULT_NONE);
    return look(DT, 0.01 * 50 - rad, 0.0, 0.5, &joint);
}

START_TEST(what_the_motor_or_an_effect_of_the_model_can_do_within_a_sample_is_no_jump)
{
    ck_assert_int_eq(step_back(0.0, 0.065), MK_FAULT_NONE);
    ck_assert_int_eq(step_back(0.0, 0.1), MK_FAULT_JUMP);
    ck_assert_int_eq(step_back(50.0, 0.1), MK_FAULT_NONE);
    ck_assert_int_eq(step_back(50.0, 0.3), MK_FAULT_JUMP);
}
END_TEST

START_TEST(a_link_that_rebounds_from_a_stop_has_not_jumped)
{
    int joint = 0;
    double q = 0.0, v = 5.0;
    watch(MK_PLANT_PENDUBOT);
    for (int k = 0; k < 100; k++) {
        if (q > 0.5)
            v = -5.0;
        q += v * DT;
        ck_assert_int_eq(look(DT, -M_PI_2 + 0.002 * k, q, 1.0, &joint), MK_FAULT_NONE);
    }
}
END_TEST

Suite *suite_residual(void)
{
    Suite *s = suite_create("residual");
    TCase *t = tcase_create("runs");
    tcase_add_checked_fixture(t, bench_setup, bench_teardown);
    tcase_set_timeout(t, 60);
    tcase_add_loop_test(t, a_dead_encoder_of_either_joint_of_every_setup_stops_the_motor, 0, 1);
    tcase_add_loop_test(t, encoders_that_die_together_stop_the_motor_of_every_setup, 0,
                        BALANCING_COUNT);
    tcase_add_loop_test(t, an_encoder_that_slips_by_fifty_counts_stops_the_motor_at_once, 0,
                        SETUP_COUNT);
    tcase_add_loop_test(t, an_encoder_that_slips_while_samples_are_lost_stops_the_motor_at_once, 0,
                        SETUP_COUNT);
    tcase_add_loop_test(t, lost_samples_are_no_jump, 0, BALANCING_COUNT);
    tcase_add_loop_test(t, rigs_are_not_stopped_at_the_slowest_and_the_fastest_rate, 0, RATE_COUNT);
    tcase_add_loop_test(t, a_dead_encoder_stops_the_motor_at_the_slowest_and_the_fastest_rate, 0,
                        RATE_COUNT);
    tcase_add_loop_test(t, noise_of_two_counts_is_no_jump, 0, SETUP_COUNT);
    tcase_add_test(t, a_wheel_that_friction_holds_is_not_stopped);
    tcase_add_test(t, a_rig_that_rests_while_it_is_balanced_is_nudged_and_left_alone);
    tcase_add_test(t, a_model_that_may_be_off_by_all_of_it_stops_nothing);
    suite_add_tcase(s, t);
    t = tcase_create("many runs");
    tcase_add_checked_fixture(t, bench_setup, bench_teardown);
    tcase_set_timeout(t, 60);
    tcase_set_tags(t, "long");
    tcase_add_loop_test(t, a_dead_encoder_of_either_joint_of_every_setup_stops_the_motor, 1,
                        SETUP_COUNT);
    tcase_add_loop_test(t, rigs_that_are_off_the_model_are_not_stopped, 0, SETUP_COUNT);
    suite_add_tcase(s, t);
    t = tcase_create("samples");
    tcase_add_test(t, a_link_that_nothing_holds_up_cannot_rest_while_the_motor_drives);
    tcase_add_test(t, a_rig_that_is_held_by_hand_with_the_motor_off_is_left_alone);
    tcase_add_test(t, links_at_rest_under_a_weak_command_are_left_alone);
    tcase_add_test(t, links_that_rest_where_the_model_has_them_pulled_a_little_are_left_alone);
    tcase_add_test(t, links_that_hang_cannot_rest_while_the_motor_drives);
    tcase_add_test(t, links_that_rest_where_gravity_holds_the_motors_torque_are_left_alone);
    tcase_add_test(t, links_that_rest_where_an_effect_of_the_model_may_hold_them_are_left_alone);
    tcase_add_test(t, a_wheel_that_an_effect_of_its_model_would_brake_is_left_alone);
    tcase_add_test(
        t, a_wheel_that_an_effect_of_its_model_would_brake_one_way_round_is_left_alone_there);
    tcase_add_test(t,
                   a_sway_that_a_reading_does_not_show_is_missed_whatever_its_speed_estimate_says);
    tcase_add_test(t, a_speed_is_believed_to_a_tenth_and_half_a_radian_a_second);
    tcase_add_test(
        t, a_link_that_stands_upright_is_nudged_and_has_no_encoder_if_that_does_not_move_it);
    tcase_add_test(t, a_nudge_ends_with_a_count_and_away_from_the_nearer_end_of_the_travel);
    tcase_add_test(t, a_nudge_ends_when_the_controller_holds_the_upright_no_more);
    tcase_add_test(t, a_nudge_is_no_command_of_the_next_run);
    tcase_add_test(t, lost_samples_do_not_clear_what_is_known_of_a_dead_encoder);
    tcase_add_test(t, pushes_that_a_joint_may_have_stopped_between_do_not_add_up);
    tcase_add_test(t, a_wheel_that_is_a_quarter_heavier_than_its_model_has_the_time_to_move);
    tcase_add_test(t, a_wheel_that_stops_dead_at_full_speed_has_lost_its_encoder);
    tcase_add_test(t, a_wheel_that_stops_dead_while_its_motor_gives_little_has_lost_its_encoder);
    tcase_add_test(t, a_wheel_that_stops_dead_is_found_as_soon_either_way_round);
    tcase_add_test(t, a_joint_whose_reading_stands_still_is_judged_as_one_at_rest);
    tcase_add_test(t, a_wheel_that_slips_right_behind_lost_samples_has_jumped);
    tcase_add_test(t, what_the_motor_or_an_effect_of_the_model_can_do_within_a_sample_is_no_jump);
    tcase_add_test(t, a_link_that_rebounds_from_a_stop_has_not_jumped);
    suite_add_tcase(s, t);
    return s;
}
