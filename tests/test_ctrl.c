/* The table of setups and its checks; the setups that follow a signal; what every step promises. */
#include "suites.h"

#include <math.h>
#include <string.h>

#include "support/closed.h"

static const char *const balancing[] = {"pendubot-mid", "pendubot-top", "reaction-wheel", "furuta"};
#define BALANCING_COUNT 4

/* --- the table -------------------------------------------------------------------------------- */

START_TEST(every_setup_is_found_by_its_name_and_its_rows_make_sense)
{
    int count = 0;
    for (const struct mk_ctrl_ops *ops; (ops = mk_ctrl_setup(count)) != NULL; count++) {
        ck_assert_ptr_eq(mk_ctrl_setup_by_name(ops->name), ops);
        ck_assert_uint_ne(ops->plants, 0);
        ck_assert_int_le(ops->param_count, MK_CTRL_MAX_PARAMS);
        for (int i = 0; i < ops->param_count; i++) {
            const struct mk_ctrl_param *p = &ops->param[i];
            ck_assert_msg(p->name && p->unit && p->help, "%s: row %d", ops->name, i);
            ck_assert_int_eq(mk_ctrl_param_index(ops, p->name), i); /* no name twice */
            ck_assert_msg(isnan(p->initial) || mk_ctrl_check(ops, i, p->initial, NULL) == MK_OK,
                          "%s: %s", ops->name, p->name);
        }
    }
    ck_assert_int_gt(count, 0);
    ck_assert_ptr_null(mk_ctrl_setup(-1));
    ck_assert_ptr_null(mk_ctrl_setup_by_name("pendubot"));
}
END_TEST

START_TEST(gains_come_in_the_order_of_the_report)
{
    static const struct {
        const char *setup, *gain[4];
    } rows[] = {{"pendubot-mid", {"k_q1", "k_dq1", "k_q2", "k_dq2"}},
                {"pendubot-top", {"k_q1", "k_dq1", "k_q2", "k_dq2"}},
                {"reaction-wheel", {"k_pp", "k_dp", "k_dr", NULL}},
                {"furuta", {"k_a", "k_da", "k_b", "k_db"}},
                {"pi-speed", {"kp", "ki", NULL, NULL}}};
    for (size_t r = 0; r < sizeof rows / sizeof rows[0]; r++) {
        const struct mk_ctrl_ops *ops = mk_ctrl_setup_by_name(rows[r].setup);
        int n = 0;
        for (int i = 0; i < ops->param_count; i++) {
            if (!ops->param[i].gain)
                continue;
            ck_assert_msg(n < 4 && rows[r].gain[n], "%s has too many gains", ops->name);
            ck_assert_str_eq(ops->param[i].name, rows[r].gain[n]);
            n++;
        }
        ck_assert_int_eq(n, mk_ctrl_gain_count(ops));
    }
}
END_TEST

START_TEST(a_parameter_out_of_its_range_is_refused_with_the_range)
{
    struct mk_error err = MK_ERROR_INIT;
    const struct mk_ctrl_ops *ops = mk_ctrl_setup_by_name("pendubot-mid");
    int level = mk_ctrl_param_index(ops, "level");
    ck_assert_int_eq(mk_ctrl_check(ops, level, 0.5, &err), MK_OK);
    ck_assert_int_eq(mk_ctrl_check(ops, level, 1.5, &err), MK_ERR_RANGE);
    ck_assert_ptr_nonnull(strstr(err.message, "level = 1.5 is outside 0.01 .. 1"));
    ck_assert_int_eq(mk_ctrl_check(ops, level, NAN, &err), MK_ERR_RANGE);
    ck_assert_int_eq(mk_ctrl_check(ops, -1, 0.5, &err), MK_ERR_NOTFOUND);
    ck_assert_int_eq(mk_ctrl_check(ops, ops->param_count, 0.5, &err), MK_ERR_NOTFOUND);
}
END_TEST

START_TEST(a_setup_refuses_a_rig_that_it_is_not_for)
{
    struct mk_error err = MK_ERROR_INIT;
    struct mk_ctrl *ctrl;
    struct mk_model furuta;
    mk_model_default(MK_PLANT_FURUTA, &furuta);
    const struct mk_ctrl_ops *top = mk_ctrl_setup_by_name("pendubot-top");
    ck_assert_int_eq(mk_ctrl_create(top, &furuta, 0.002, NULL, &ctrl, &err), MK_ERR_INVALID);
    ck_assert_str_eq(err.message, "setup pendubot-top is for pendubot, not for furuta");
    ck_assert_ptr_null(ctrl);
    const struct mk_ctrl_ops *right = mk_ctrl_setup_by_name("furuta");
    ck_assert_int_eq(mk_ctrl_create(right, &furuta, 0.0, NULL, &ctrl, &err), MK_ERR_RANGE);
    ck_assert_int_eq(mk_ctrl_create(right, &furuta, NAN, NULL, &ctrl, &err), MK_ERR_RANGE);
    furuta.parameter[0] = -1.0;
    ck_assert_int_eq(mk_ctrl_create(right, &furuta, 0.002, NULL, &ctrl, &err), MK_ERR_RANGE);
    mk_ctrl_destroy(NULL);
}
END_TEST

START_TEST(gains_are_designed_for_the_believed_model_also_in_si_units)
{
    /* The same rig in N m instead of command units: u_max shrinks by k, gains with it. */
    const double k = 0.00494;
    for (int s = 0; s < BALANCING_COUNT; s++) {
        struct closed c;
        closed_open(&c, balancing[s], NULL);
        struct mk_model si = c.rig;
        const struct mk_plant_info *plant = mk_plant(si.plant);
        for (int i = 0; i < plant->parameter_count; i++)
            si.parameter[i] *= k;
        si.u_max *= k;
        si.u_to_torque = 1.0;
        struct mk_ctrl *ctrl;
        ck_assert_int_eq(mk_ctrl_create(c.ctrl->ops, &si, c.dt, NULL, &ctrl, NULL), MK_OK);
        for (int i = 0; i < c.ctrl->ops->param_count; i++)
            if (c.ctrl->ops->param[i].gain)
                ck_assert_double_eq_tol(ctrl->value[i] / (k * c.ctrl->value[i]), 1.0, 1e-6);
        mk_ctrl_destroy(ctrl);
        closed_close(&c);
    }
}
END_TEST

/* --- open loop --------------------------------------------------------------------------- */

static struct mk_signal *signal_of(const char *text)
{
    struct mk_signal *signal;
    ck_assert_int_eq(mk_signal_create(text, &signal, NULL), MK_OK);
    return signal;
}

START_TEST(open_loop_applies_the_signal_at_its_own_time)
{
    struct mk_signal *signal = signal_of("1.5*sin(6*t)");
    struct closed c;
    closed_open(&c, "open-loop", signal);
    closed_tick(&c); /* tick 0: nothing was known before, so nothing acts */
    for (int k = 1; k < 500; k++) {
        closed_tick(&c);
        ck_assert_double_eq_tol(c.in.u, 1.5 * sin(6.0 * c.in.t), 1e-12);
        ck_assert_int_eq(c.out.phase, MK_PHASE_TRACK);
    }
    closed_close(&c);
    mk_signal_destroy(signal);
}
END_TEST

START_TEST(open_loop_without_a_number_drives_nothing)
{
    struct mk_signal *signal = signal_of("sqrt(-1)");
    struct closed c;
    closed_open(&c, "open-loop", signal);
    closed_run(&c, 0.1);
    ck_assert_double_eq(c.out.u, 0.0);
    closed_close(&c);
    closed_open(&c, "open-loop", NULL);
    closed_run(&c, 0.1);
    ck_assert_double_eq(c.out.u, 0.0);
    closed_close(&c);
    mk_signal_destroy(signal);
}
END_TEST

/* --- speed control ----------------------------------------------------------------------- */

START_TEST(pi_speed_follows_a_step_within_two_percent)
{
    struct mk_signal *signal = signal_of("50*step(0.5)");
    struct closed c;
    closed_open(&c, "pi-speed", signal);
    closed_run(&c, 3.0);
    for (int k = 0; k < 500; k++) {
        closed_tick(&c);
        ck_assert_double_eq(c.out.ref, 50.0);
        ck_assert_double_eq_tol(closed_state(&c)[1], 50.0, 1.0);
    }
    closed_close(&c);
    mk_signal_destroy(signal);
}
END_TEST

START_TEST(pi_speed_needs_no_right_friction)
{
    /* The rig rubs 30 % more than is believed, and more forwards than backwards. */
    struct mk_signal *signal = signal_of("-50+100*step(3)");
    struct closed c;
    closed_open(&c, "pi-speed", signal);
    mk_sim_destroy(c.sim);
    c.rig.parameter[1] *= 1.3;
    c.rig.parameter[2] *= 1.3;
    ck_assert_int_eq(mk_model_add_effect(&c.rig, "coulomb", 1, NULL), MK_OK);
    ck_assert_int_eq(mk_sim_create(&c.rig, NULL, &c.sim, NULL), MK_OK);
    closed_put(&c, 0.0, 0.0, 0.0, 0.0);
    closed_run(&c, 2.9);
    ck_assert_double_eq_tol(closed_state(&c)[1], -50.0, 1.0);
    closed_run(&c, 3.0);
    ck_assert_double_eq_tol(closed_state(&c)[1], 50.0, 1.0);
    closed_close(&c);
    mk_signal_destroy(signal);
}
END_TEST

START_TEST(pi_speed_follows_a_ramp_without_lag)
{
    struct mk_signal *signal = signal_of("20*t");
    struct closed c;
    closed_open(&c, "pi-speed", signal);
    closed_run(&c, 4.0);
    ck_assert_double_eq_tol(closed_state(&c)[1], 20.0 * mk_sim_time(c.sim), 1.0);
    closed_close(&c);
    mk_signal_destroy(signal);
}
END_TEST

START_TEST(pi_speed_feeds_a_ramp_forward_the_same_after_missed_samples)
{
    struct mk_signal *ramp;
    struct mk_model model;
    struct mk_ctrl *ctrl;
    struct mk_ctrl_output out;
    const double dt = 0.002;
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &model);
    ck_assert_int_eq(mk_signal_create("20*t", &ramp, NULL), MK_OK);
    ck_assert_int_eq(
        mk_ctrl_create(mk_ctrl_setup_by_name("pi-speed"), &model, dt, ramp, &ctrl, NULL), MK_OK);
    static const int ticks[] = {0, 1, 2, 5, 6};
    for (size_t i = 0; i < sizeof ticks / sizeof ticks[0]; i++) {
        const int missed = i ? ticks[i] - ticks[i - 1] - 1 : 0;
        struct mk_ctrl_input in = {
            .t = ticks[i] * dt, .dt = dt * (1 + missed), .tick = (uint64_t)ticks[i]};
        in.v[0] = 20.0 * in.t; /* it follows */
        mk_ctrl_step(ctrl, &in, &out);
        if (i > 0)
            ck_assert_double_eq_tol(out.u, model.parameter[0] * 20.0, 1e-9);
    }
    mk_ctrl_destroy(ctrl);
    mk_signal_destroy(ramp);
}
END_TEST

START_TEST(pi_speed_does_not_wind_up_at_the_limit)
{
    /* 2000 rad/s is out of reach; after it, 50 rad/s must come without a long detour. */
    struct mk_signal *signal = signal_of("2000*pulse(0, 3)+50*step(3)");
    struct closed c;
    closed_open(&c, "pi-speed", signal);
    closed_run(&c, 3.0);
    double lowest = INFINITY;
    for (int k = 0; k < 1500; k++) {
        closed_tick(&c);
        lowest = fmin(lowest, closed_state(&c)[1]);
    }
    ck_assert_double_eq_tol(closed_state(&c)[1], 50.0, 1.0);
    ck_assert_msg(lowest > 25.0, "undershoot to %g rad/s", lowest);
    closed_close(&c);
    mk_signal_destroy(signal);
}
END_TEST

START_TEST(pi_speed_without_a_signal_holds_its_parameter)
{
    struct closed c;
    closed_open(&c, "pi-speed", NULL);
    closed_set(&c, "speed", -30.0);
    closed_run(&c, 3.0);
    ck_assert_double_eq_tol(closed_state(&c)[1], -30.0, 0.6);
    closed_close(&c);
}
END_TEST

/* --- every step -------------------------------------------------------------------------- */

/* Feeds a spoilt input once and checks that the command is a number. */
static void spoil(struct closed *c, int what)
{
    struct mk_ctrl_input in = c->in;
    struct mk_ctrl_output out;
    double bad = what % 2 ? (double)NAN : (double)INFINITY;
    double *field[] = {&in.q[0], &in.q[1], &in.v[0], &in.v[1], &in.u, &in.t};
    *field[what % 6] = bad;
    mk_ctrl_step(c->ctrl, &in, &out);
    ck_assert_msg(isfinite(out.u), "%s: field %d", c->ctrl->ops->name, what);
}

START_TEST(no_reading_makes_a_command_that_is_not_a_number)
{
    const struct mk_ctrl_ops *ops = mk_ctrl_setup(_i);
    struct closed c;
    closed_open(&c, ops->name, NULL);
    for (int k = 0; k < 3000; k++) {
        closed_tick(&c);
        if (k % 50 == 7)
            for (int what = 0; what < 12; what++)
                spoil(&c, what);
    }
    closed_close(&c);
}
END_TEST

START_TEST(a_spoilt_reading_is_forgotten)
{
    /* One lost sample in twenty while balancing does not cost the balance. */
    struct closed c;
    closed_open(&c, balancing[_i], NULL);
    ck_assert_double_lt(closed_until(&c, MK_PHASE_BALANCE, 5.0), 5.0);
    for (int k = 0; k < 2500; k++) {
        closed_tick(&c);
        if (k % 20 == 3)
            spoil(&c, k / 20);
        ck_assert_int_eq(c.out.phase, MK_PHASE_BALANCE);
    }
    closed_close(&c);
}
END_TEST

START_TEST(wild_readings_make_finite_commands)
{
    struct closed c;
    closed_open(&c, balancing[_i], NULL);
    struct mk_ctrl_input in = {.dt = c.dt};
    struct mk_ctrl_output out;
    static const double wild[] = {0.0, 1e3, -1e6, 1e9, 1e-300, -M_PI};
    for (int k = 0; k < 600; k++) {
        in.tick += 1 + (uint64_t)(k % 7 == 0) * 100;
        in.t = (double)in.tick * c.dt;
        in.q[0] = wild[k % 6];
        in.q[1] = wild[(k / 6) % 6];
        in.v[0] = wild[(k / 36) % 6];
        in.v[1] = wild[(k / 5) % 6];
        mk_ctrl_step(c.ctrl, &in, &out);
        ck_assert_msg(isfinite(out.u), "step %d", k);
    }
    closed_close(&c);
}
END_TEST

START_TEST(reset_makes_the_same_run_again)
{
    const struct mk_ctrl_ops *ops = mk_ctrl_setup(_i);
    struct mk_signal *signal = signal_of("3*sin(4*t)");
    double u[2][1500];
    struct closed c;
    closed_open(&c, ops->name, signal);
    for (int run = 0; run < 2; run++) {
        struct closed again;
        closed_open(&again, ops->name, signal);
        struct mk_ctrl *fresh = again.ctrl;
        again.ctrl = c.ctrl; /* used before in the second run */
        mk_ctrl_reset(again.ctrl);
        for (int k = 0; k < 1500; k++) {
            closed_tick(&again);
            u[run][k] = again.out.u;
        }
        again.ctrl = fresh;
        closed_close(&again);
    }
    ck_assert_mem_eq(u[0], u[1], sizeof u[0]);
    closed_close(&c);
    mk_signal_destroy(signal);
}
END_TEST

Suite *suite_ctrl(void)
{
    Suite *s = suite_create("ctrl");
    TCase *t = tcase_create("table");
    tcase_add_test(t, every_setup_is_found_by_its_name_and_its_rows_make_sense);
    tcase_add_test(t, gains_come_in_the_order_of_the_report);
    tcase_add_test(t, a_parameter_out_of_its_range_is_refused_with_the_range);
    tcase_add_test(t, a_setup_refuses_a_rig_that_it_is_not_for);
    tcase_add_test(t, gains_are_designed_for_the_believed_model_also_in_si_units);
    suite_add_tcase(s, t);

    t = tcase_create("signals");
    tcase_set_timeout(t, 60);
    tcase_add_test(t, open_loop_applies_the_signal_at_its_own_time);
    tcase_add_test(t, open_loop_without_a_number_drives_nothing);
    tcase_add_test(t, pi_speed_follows_a_step_within_two_percent);
    tcase_add_test(t, pi_speed_needs_no_right_friction);
    tcase_add_test(t, pi_speed_follows_a_ramp_without_lag);
    tcase_add_test(t, pi_speed_feeds_a_ramp_forward_the_same_after_missed_samples);
    tcase_add_test(t, pi_speed_does_not_wind_up_at_the_limit);
    tcase_add_test(t, pi_speed_without_a_signal_holds_its_parameter);
    suite_add_tcase(s, t);

    t = tcase_create("step");
    tcase_set_timeout(t, 120);
    tcase_add_loop_test(t, no_reading_makes_a_command_that_is_not_a_number, 0, 6);
    tcase_add_loop_test(t, a_spoilt_reading_is_forgotten, 0, BALANCING_COUNT);
    tcase_add_loop_test(t, wild_readings_make_finite_commands, 0, BALANCING_COUNT);
    tcase_add_loop_test(t, reset_makes_the_same_run_again, 0, 6);
    suite_add_tcase(s, t);
    return s;
}
