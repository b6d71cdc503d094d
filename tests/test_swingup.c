/* The laws behind the swing-ups: feedback linearisation, energy pump, passivity, hand-over, and the
 * observer that all of them stand on. */
#include "suites.h"

#include <math.h>
#include <string.h>

#include "base/random.h"
#include "ctrl/balance.h"
#include "ctrl/link_pump.h"
#include "mechkit/design.h"
#include "support/closed.h"

static double draw(struct mk_random *r, double low, double high)
{
    return low + (high - low) * mk_random_uniform(r);
}

static void draw_state(struct mk_random *r, double *x)
{
    x[0] = draw(r, -M_PI, M_PI);
    x[1] = draw(r, -M_PI, M_PI);
    x[2] = draw(r, -10.0, 10.0);
    x[3] = draw(r, -15.0, 15.0);
}

static void frictionless(struct mk_model *m)
{
    int n = mk_plant(m->plant)->parameter_count;
    m->parameter[n - 1] = m->parameter[n - 2] = 0.0;
}

/* --- partial feedback linearisation ------------------------------------------------------ */

static const enum mk_plant_kind linearised[] = {MK_PLANT_PENDUBOT, MK_PLANT_FURUTA,
                                                MK_PLANT_CART_POLE, MK_PLANT_ACROBOT};
#define LINEARISED (int)(sizeof linearised / sizeof linearised[0])

START_TEST(feedback_linearisation_gives_the_motor_joint_the_acceleration_asked_for)
{
    struct mk_model m;
    mk_model_default(linearised[_i % LINEARISED], &m);
    int motor = mk_plant(m.plant)->motor_joint;
    if (_i < LINEARISED)
        frictionless(&m); /* as in the report; the law also takes the friction it believes */
    struct mk_random r = {7};
    for (int k = 0; k < 2000; k++) {
        double x[4], a[2];
        draw_state(&r, x);
        double v1 = draw(&r, -200.0, 200.0);
        double tau[2] = {0.0, 0.0};
        tau[motor] = mk_pfl_command(&m, x, v1);
        mk_plant_acceleration(&m, x, x + 2, tau, a);
        ck_assert_double_eq_tol(a[motor], v1, 1e-8);
    }
}
END_TEST

/* A cable at the free joint and a cubic spring accelerate the driven one through the link. */
START_TEST(feedback_linearisation_counts_what_pulls_at_the_free_joint)
{
    struct mk_model m;
    struct mk_error err = MK_ERROR_INIT;
    mk_model_default(linearised[_i], &m);
    int motor = mk_plant(m.plant)->motor_joint;
    static const char *const pulls[] = {"cable-stiffness", "custom"};
    static const double value[][2] = {{0.2, 0.5}, {0.01, 5.0}};
    for (int k = 0; k < 2; k++) {
        ck_assert_msg(mk_model_add_effect(&m, pulls[k], 2 - motor, &err) == MK_OK, "%s",
                      err.message);
        m.effect[k].value[0] = value[k][0];
        m.effect[k].value[1] = value[k][1];
    }
    struct mk_random r = {9};
    int within = 0; /* its limits */
    for (int k = 0; k < 2000; k++) {
        double x[MK_MAX_STATES] = {0.0}, dx[MK_MAX_STATES], u[MK_MAX_INPUTS] = {0.0, 0.0};
        draw_state(&r, x);
        double v1 = draw(&r, -200.0, 200.0);
        u[0] = mk_pfl_command(&m, x, v1);
        if (fabs(u[0]) > m.u_max)
            continue;
        mk_model_rhs(&m, 0.0, x, u, dx);
        ck_assert_double_eq_tol(dx[2 + motor], v1, 1e-7);
        within++;
    }
    ck_assert_int_gt(within, 100);
}
END_TEST

START_TEST(feedback_linearisation_is_the_reports_formula)
{
    /* (2.15) written out, with the parameters of (3.32) and without friction. */
    struct mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    frictionless(&m);
    const double *p = m.parameter;
    struct mk_random r = {11};
    for (int k = 0; k < 200; k++) {
        double x[4];
        draw_state(&r, x);
        double v1 = draw(&r, -50.0, 50.0), s2 = sin(x[1]), c2 = cos(x[1]);
        double d11 = p[0] + p[1] + 2 * p[2] * c2, d12 = p[1] + p[2] * c2, d22 = p[1];
        double c11 = -p[2] * s2 * x[3], c12 = -p[2] * s2 * (x[2] + x[3]), c21 = p[2] * s2 * x[2];
        double g2 = p[4] * m.g * cos(x[0] + x[1]), g1 = p[3] * m.g * cos(x[0]) + g2;
        double u = (d11 - d12 * d12 / d22) * v1 + (c11 - d12 * c21 / d22) * x[2] + c12 * x[3] + g1 -
                   d12 / d22 * g2;
        ck_assert_double_eq_tol(mk_pfl_command(&m, x, v1), u, 1e-9);
    }
}
END_TEST

/* --- the energy pump
 * ------------------------------------------------------------------------------ */

START_TEST(link_energy_is_zero_upright_and_minus_two_hanging)
{
    static const struct {
        enum mk_plant_kind plant;
        double hanging[4], upright[4];
    } rows[] = {{MK_PLANT_PENDUBOT, {-M_PI / 2, 0, 0, 0}, {-M_PI / 2, M_PI, 0, 0}},
                {MK_PLANT_PENDUBOT, {M_PI / 2, M_PI, 0, 0}, {M_PI / 2, 0, 0, 0}},
                {MK_PLANT_FURUTA, {1, M_PI, 0, 0}, {-2, 0, 0, 0}}};
    for (size_t i = 0; i < 3; i++) {
        struct mk_model m;
        mk_model_default(rows[i].plant, &m);
        ck_assert_double_eq_tol(mk_link_energy(&m, rows[i].hanging), -2.0, 1e-12);
        ck_assert_double_eq_tol(mk_link_energy(&m, rows[i].upright), 0.0, 1e-12);
    }
}
END_TEST

START_TEST(the_pump_drives_the_link_energy_towards_upright_from_either_side)
{
    /* Only the pump, no hold, no centring; link 1 at rest, so that all of dE/dt is the pump's. */
    static const double row[MK_PUMP_ROWS] = {
        [MK_PUMP_STRENGTH] = 50.0, [MK_PUMP_GAIN] = 10.0,  [MK_PUMP_REACH] = 10.0,
        [MK_PUMP_PATIENCE] = 1e9,  [MK_PUMP_HOLD_P] = 0.0, [MK_PUMP_HOLD_D] = 1e-9,
        [MK_PUMP_SPEED] = 1.0};
    struct mk_model m;
    mk_model_default(_i ? MK_PLANT_FURUTA : MK_PLANT_PENDUBOT, &m);
    struct mk_random r = {3};
    int pumped = 0;
    for (int k = 0; k < 3000; k++) {
        double x[4], a[2], later[4];
        draw_state(&r, x);
        x[2] = 0.0;
        double energy = mk_link_energy(&m, x);
        double tau[2] = {mk_pfl_command(&m, x, mk_link_pump(&m, x, 0.0, 0.0, 0.0, row)), 0.0};
        mk_plant_acceleration(&m, x, x + 2, tau, a);
        const double h = 1e-6;
        for (int j = 0; j < 2; j++) {
            later[j] = x[j] + h * x[2 + j] + 0.5 * h * h * a[j];
            later[2 + j] = x[2 + j] + h * a[j];
        }
        double rate = (mk_link_energy(&m, later) - energy) / h;
        if (energy < -1.8 && fabs(x[3]) < 0.4)
            continue; /* the first push from rest has no direction to miss */
        ck_assert_msg(rate * energy <= 1e-3, "E %g dE/dt %g", energy, rate);
        pumped += fabs(rate) > 0.5;
    }
    ck_assert_int_gt(pumped, 1000);
}
END_TEST

START_TEST(the_pump_changes_its_strength_when_it_was_patient_for_long_enough)
{
    static const double row[MK_PUMP_ROWS] = {
        [MK_PUMP_STRENGTH] = 40.0, [MK_PUMP_GAIN] = 1000.0, [MK_PUMP_REACH] = 10.0,
        [MK_PUMP_PATIENCE] = 2.0,  [MK_PUMP_HOLD_P] = 0.0,  [MK_PUMP_HOLD_D] = 1.0,
        [MK_PUMP_SPEED] = 1.0};
    struct mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    const double x[4] = {-M_PI / 2, 0.0, 0.0, 5.0};
    static const double expected[] = {-40.0, -30.0, -50.0, -36.0, -40.0};
    for (int turn = 0; turn < 5; turn++)
        ck_assert_double_eq_tol(mk_link_pump(&m, x, -M_PI / 2, 2.0 * turn + 1.0, 0.0, row),
                                expected[turn], 1e-9);
}
END_TEST

START_TEST(a_strayed_link_1_goes_home_before_it_pumps_again)
{
    struct mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    const struct mk_ctrl_ops *ops = mk_ctrl_setup_by_name("pendubot-top");
    double row[MK_PUMP_ROWS];
    for (int i = 0; i < MK_PUMP_ROWS; i++)
        row[i] = ops->param[mk_ctrl_param_index(ops, "pump") + i].initial;
    for (double error = 1.3; error < 9.0; error += 0.5) {
        double there[4] = {M_PI / 2 + error, 1.0, 0.0, 3.0};
        double back[4] = {M_PI / 2 - error, 1.0, 0.0, 3.0};
        ck_assert_double_lt(mk_link_pump(&m, there, M_PI / 2, 0.0, 0.0, row), -10.0);
        ck_assert_double_gt(mk_link_pump(&m, back, M_PI / 2, 0.0, 0.0, row), 10.0);
    }
}
END_TEST

/* --- reaction wheel
 * --------------------------------------------------------------------------------- */

static double storage(const struct closed *c, double k_e, double k_v)
{
    const double *p = c->rig.parameter, *x = closed_state(c);
    double weight = p[2] * c->rig.g, wheel = x[2] + x[3];
    double energy = 0.5 * p[0] * x[2] * x[2] + weight * (1.0 - cos(x[0]));
    return 0.5 * k_v * p[1] * wheel * wheel + 0.5 * k_e * pow(energy - 2.0 * weight, 2);
}

START_TEST(the_passive_swing_up_never_lets_the_storage_function_grow)
{
    /* Report (2.32). The law is continuous in the report and sampled with a delay here: per sample
     * the function may not grow by more than a sample's delay explains. */
    struct closed c;
    struct mk_model rig;
    mk_model_default(MK_PLANT_REACTION_WHEEL, &rig);
    frictionless(&rig);
    closed_open_rig(&c, "reaction-wheel", &rig, NULL);
    c.exact = true;
    /* Below the saturation: a gain small enough that the law is smooth over a sample. */
    closed_set(&c, "k_u", 1e-5);
    closed_set(&c, "guard", 0);
    closed_set(&c, "box", 0);
    closed_set(&c, "wheel_limit", 5000);
    closed_put(&c, 1.0, 0.0, 2.0, 5.0);
    closed_tick(&c);
    double before = storage(&c, 4000.0, 4.0), first = before;
    for (int k = 0; k < 5000; k++) {
        closed_tick(&c);
        double now = storage(&c, 4000.0, 4.0);
        ck_assert_msg(now <= before * (1.0 + 1e-7), "grew by %g of %g at %g s", now - before,
                      before, c.in.t);
        before = now;
    }
    ck_assert_double_lt(before, 0.5 * first);
    closed_close(&c);
}
END_TEST

START_TEST(the_passive_swing_up_pushes_against_its_output_also_when_limited)
{
    /* dS/dt = y u <= 0 for the limited command as well (report (2.31), (2.32)). */
    struct closed c;
    struct mk_model rig;
    mk_model_default(MK_PLANT_REACTION_WHEEL, &rig);
    frictionless(&rig);
    closed_open_rig(&c, "reaction-wheel", &rig, NULL);
    closed_set(&c, "guard", 0);
    closed_set(&c, "box", 0);
    closed_set(&c, "lead", 0);
    struct mk_random r = {5};
    for (int k = 0; k < 2000; k++) {
        struct mk_ctrl_input in = {.dt = c.dt};
        struct mk_ctrl_output out;
        in.q[0] = draw(&r, -3.0, 3.0);
        in.v[0] = draw(&r, -15.0, 15.0);
        in.v[1] = draw(&r, -300.0, 300.0);
        mk_ctrl_reset(c.ctrl);
        mk_ctrl_step(c.ctrl, &in, &out);
        const double *p = rig.parameter;
        double weight = p[2] * rig.g, wheel = in.v[0] + in.v[1];
        double energy = 0.5 * p[0] * in.v[0] * in.v[0] + weight * (1.0 - cos(in.q[0]));
        if (energy < 0.01 * weight)
            continue; /* the push from rest */
        double y = 4.0 * wheel - 4000.0 * (energy - 2.0 * weight) * in.v[0];
        ck_assert_double_le(y * out.u, 0.0);
        ck_assert_double_le(fabs(out.u), rig.u_max);
    }
    closed_close(&c);
}
END_TEST

/* Poles of the frictionless loop in (th, dth, w); true when one of them is `pole`. */
static bool has_pole(const struct mk_model *m, const double *k, double pole)
{
    const double *p = m->parameter;
    double a[9] = {0, 1, 0, p[2] * m->g / p[0], 0, 0, 0, 0, 0};
    double b[3] = {0, -1.0 / p[0], 1.0 / p[1]}, re[3], im[3];
    ck_assert_int_eq(mk_design_poles(3, a, b, k, re, im, NULL), MK_OK);
    bool found = false;
    for (int i = 0; i < 3; i++) {
        ck_assert_double_lt(re[i], 0.0);
        found = found || hypot(re[i] - pole, im[i]) < 1e-6 * fabs(pole);
    }
    return found;
}

START_TEST(the_hand_over_is_free_of_transients_by_default_and_not_with_the_designers_gains)
{
    struct closed c;
    closed_open(&c, "reaction-wheel", NULL);
    const double *p = c.rig.parameter;
    double omega_p = sqrt(p[2] * c.rig.g / p[0]);
    double k[3];
    for (int i = 0; i < 3; i++)
        k[i] = c.ctrl->value[i];
    ck_assert_double_eq_tol(k[0], omega_p * k[1], 1e-9);
    ck_assert(has_pole(&c.rig, k, -omega_p));
    /* Errata 5.4: k_dr is free. */
    k[2] *= 0.5;
    ck_assert(has_pole(&c.rig, k, -omega_p));
    static const double designers[3] = {-400.0, -35.0, -0.07};
    ck_assert(!has_pole(&c.rig, designers, -omega_p));
    closed_close(&c);
}
END_TEST

START_TEST(the_line_of_arrival_is_kept_by_the_balanced_loop)
{
    /* Started on dth = -omega_p (th - pi), w = 0, the frictionless loop stays on that line. */
    struct closed c;
    struct mk_model rig;
    mk_model_default(MK_PLANT_REACTION_WHEEL, &rig);
    frictionless(&rig);
    closed_open_rig(&c, "reaction-wheel", &rig, NULL);
    c.exact = true;
    closed_set(&c, "lead", 1.0);
    double omega_p = sqrt(rig.parameter[2] * rig.g / rig.parameter[0]);
    closed_put(&c, M_PI - 0.05, 0.0, 0.05 * omega_p, -0.05 * omega_p);
    for (int k = 0; k < 250; k++) {
        closed_tick(&c);
        ck_assert_int_eq(c.out.phase, MK_PHASE_BALANCE);
        const double *x = closed_state(&c);
        ck_assert_double_eq_tol(x[2], -omega_p * (x[0] - M_PI), 0.01);
        ck_assert_double_lt(fabs(x[2] + x[3]), 2.0); /* the wheel is not asked for anything */
    }
    closed_close(&c);
}
END_TEST

START_TEST(the_designers_gains_are_a_parameter)
{
    struct closed c, twin;
    closed_open(&c, "reaction-wheel", NULL);
    closed_open(&twin, "reaction-wheel", NULL);
    closed_set(&c, "designers", 1);
    closed_set(&twin, "k_pp", -400.0);
    closed_set(&twin, "k_dp", -35.0);
    closed_set(&twin, "k_dr", -0.07);
    ck_assert_double_lt(closed_until(&c, MK_PHASE_BALANCE, 5.0), 5.0);
    ck_assert_double_lt(closed_until(&twin, MK_PHASE_BALANCE, 5.0), 5.0);
    ck_assert_double_eq(c.out.u, twin.out.u);
    closed_close(&c);
    closed_close(&twin);
}
END_TEST

START_TEST(a_pendulum_that_goes_round_is_brought_back)
{
    struct closed c;
    closed_open(&c, "reaction-wheel", NULL);
    /* Over the top at 6 rad/s with the wheel near its limit already. */
    closed_put(&c, M_PI, 0.0, 6.0, 500.0);
    double caught = closed_until(&c, MK_PHASE_BALANCE, 14.0);
    ck_assert_double_lt(caught, 14.0);
    ck_assert_double_lt(fabs(closed_state(&c)[0]), 20.0 * M_PI);
    closed_close(&c);
}
END_TEST

/* --- observer
 * --------------------------------------------------------------------------------------- */

START_TEST(the_observer_knows_speeds_where_a_filter_lags)
{
    struct closed c;
    closed_open(&c, "furuta", NULL);
    struct mk_observer obs;
    mk_observer_init(&obs, &c.rig, c.dt, 35.0);
    mk_observer_reset(&obs);
    double filter = 0.0, observer = 0.0;
    int n = 0;
    for (int k = 0; k < 900; k++) { /* the swing-up */
        double truth[4], x[4];
        memcpy(truth, closed_state(&c), sizeof truth);
        closed_tick(&c);
        mk_observer_step(&obs, &c.in, x);
        if (k < 50)
            continue;
        for (int j = 2; j < 4; j++, n++) {
            filter += pow(c.in.v[j - 2] - truth[j], 2);
            observer += pow(x[j] - truth[j], 2);
        }
    }
    ck_assert_double_lt(sqrt(observer / n), 0.15);
    ck_assert_double_gt(sqrt(filter / n), 3.0 * sqrt(observer / n));
    closed_close(&c);
}
END_TEST

START_TEST(prediction_agrees_with_the_simulation)
{
    struct closed c;
    closed_open(&c, "pendubot-top", NULL);
    struct mk_random r = {9};
    for (int k = 0; k < 200; k++) {
        double x[4], u = draw(&r, -12.0, 12.0);
        draw_state(&r, x);
        closed_put(&c, x[0], x[1], x[2], x[3]);
        mk_ctrl_predict(&c.rig, x, u, 0.002);
        double command[2] = {u, 0.0};
        ck_assert_int_eq(mk_sim_advance(c.sim, mk_sim_time(c.sim) + 0.002, command, NULL), MK_OK);
        for (int i = 0; i < 4; i++)
            ck_assert_double_eq_tol(x[i], closed_state(&c)[i], i < 2 ? 1e-4 : 5e-2);
    }
    closed_close(&c);
}
END_TEST

START_TEST(the_observer_bridges_samples_that_were_lost)
{
    struct closed c;
    closed_open(&c, "pendubot-mid", NULL);
    struct mk_observer obs;
    mk_observer_init(&obs, &c.rig, c.dt, 35.0);
    mk_observer_reset(&obs);
    double worst = 0.0, x[4];
    for (int k = 0; k < 900; k++) {
        double truth[4];
        memcpy(truth, closed_state(&c), sizeof truth);
        closed_tick(&c);
        if (k % 4 == 1 || k % 4 == 2)
            continue; /* never seen: two of four */
        struct mk_ctrl_input in = c.in;
        mk_observer_step(&obs, &in, x);
        if (k > 100 && k % 4 == 0) /* the tick after a seen one */
            worst = fmax(worst, fabs(x[3] - truth[3]));
    }
    ck_assert_msg(worst < 1.5, "%g rad/s", worst);
    closed_close(&c);
}
END_TEST

Suite *suite_swingup(void)
{
    Suite *s = suite_create("swingup");
    TCase *t = tcase_create("links");
    tcase_add_loop_test(t, feedback_linearisation_gives_the_motor_joint_the_acceleration_asked_for,
                        0, 2 * LINEARISED);
    tcase_add_loop_test(t, feedback_linearisation_counts_what_pulls_at_the_free_joint, 0,
                        LINEARISED);
    tcase_add_test(t, feedback_linearisation_is_the_reports_formula);
    tcase_add_test(t, link_energy_is_zero_upright_and_minus_two_hanging);
    tcase_add_loop_test(t, the_pump_drives_the_link_energy_towards_upright_from_either_side, 0, 2);
    tcase_add_test(t, the_pump_changes_its_strength_when_it_was_patient_for_long_enough);
    tcase_add_test(t, a_strayed_link_1_goes_home_before_it_pumps_again);
    suite_add_tcase(s, t);

    t = tcase_create("reaction wheel");
    tcase_set_timeout(t, 60);
    tcase_add_test(t, the_passive_swing_up_never_lets_the_storage_function_grow);
    tcase_add_test(t, the_passive_swing_up_pushes_against_its_output_also_when_limited);
    tcase_add_test(t,
                   the_hand_over_is_free_of_transients_by_default_and_not_with_the_designers_gains);
    tcase_add_test(t, the_line_of_arrival_is_kept_by_the_balanced_loop);
    tcase_add_test(t, the_designers_gains_are_a_parameter);
    tcase_add_test(t, a_pendulum_that_goes_round_is_brought_back);
    suite_add_tcase(s, t);

    t = tcase_create("observer");
    tcase_set_timeout(t, 60);
    tcase_add_test(t, the_observer_knows_speeds_where_a_filter_lags);
    tcase_add_test(t, prediction_agrees_with_the_simulation);
    tcase_add_test(t, the_observer_bridges_samples_that_were_lost);
    suite_add_tcase(s, t);
    return s;
}
