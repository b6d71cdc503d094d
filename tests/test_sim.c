/* Simulation against an integrator of the tests' own (classical Runge-Kutta at fine steps), closed
 * forms and conservation laws. */
#include "suites.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mechkit/sim.h"

static struct mk_sim *make(const struct mk_model *m, enum mk_solver solver, double tol)
{
    struct mk_sim *sim;
    struct mk_error err = MK_ERROR_INIT;
    struct mk_sim_config c = {solver, tol, tol * 1e-2};
    ck_assert_msg(mk_sim_create(m, &c, &sim, &err) == MK_OK, "%s", err.message);
    return sim;
}

static void start(struct mk_sim *sim, const struct mk_model *m, const double *q, const double *v)
{
    double x[MK_MAX_STATES];
    mk_model_initial_state(m, q, v, x);
    ck_assert_int_eq(mk_sim_reset(sim, 0.0, x, NULL), MK_OK);
}

static void advance(struct mk_sim *sim, double t, double u)
{
    struct mk_error err = MK_ERROR_INIT;
    double command[2] = {u, 0.0};
    ck_assert_msg(mk_sim_advance(sim, t, command, &err) == MK_OK, "%s", err.message);
}

/* One classical Runge-Kutta step. */
static void rk4(const struct mk_model *m, double *x, double u, double h)
{
    int n = mk_model_state_count(m);
    double k[4][MK_MAX_STATES], y[MK_MAX_STATES], command[2] = {u, 0.0};
    static const double at[4] = {0.0, 0.5, 0.5, 1.0};
    for (int s = 0; s < 4; s++) {
        for (int i = 0; i < n; i++)
            y[i] = x[i] + (s ? at[s] * h * k[s - 1][i] : 0.0);
        mk_model_rhs(m, 0.0, y, command, k[s]);
    }
    for (int i = 0; i < n; i++)
        x[i] += h / 6.0 * (k[0][i] + 2 * k[1][i] + 2 * k[2][i] + k[3][i]);
}

static const enum mk_solver all_solvers[] = {MK_SOLVER_CVODE_ADAMS, MK_SOLVER_CVODE_BDF,
                                             MK_SOLVER_ARKODE_ERK, MK_SOLVER_DOP853};
static const enum mk_solver event_solvers[] = {MK_SOLVER_CVODE_ADAMS, MK_SOLVER_CVODE_BDF,
                                               MK_SOLVER_ARKODE_ERK};

START_TEST(every_solver_agrees_with_a_fine_fixed_step_integrator)
{
    enum mk_plant_kind kind = (enum mk_plant_kind)_i;
    struct mk_model m;
    mk_model_default(kind, &m);
    const struct mk_plant_info *plant = mk_plant(kind);
    double v[2] = {0.4, -0.3};
    for (size_t s = 0; s < 4; s++) {
        struct mk_sim *sim = make(&m, all_solvers[s], 1e-10);
        start(sim, &m, plant->rest, v);
        double x[MK_MAX_STATES];
        mk_model_initial_state(&m, plant->rest, v, x);
        for (int k = 0; k < 500; k++) {
            double u = 1.5 * sin(6.0 * 0.004 * k);
            advance(sim, (k + 1) * 0.004, u);
            for (int i = 0; i < 40; i++)
                rk4(&m, x, u, 1e-4);
        }
        for (int i = 0; i < 2 * plant->joints; i++)
            ck_assert_msg(fabs(mk_sim_state(sim)[i] - x[i]) < 2e-6 * (1 + fabs(x[i])),
                          "%s %s state %d: %g", plant->name, mk_solver_name(all_solvers[s]), i,
                          mk_sim_state(sim)[i] - x[i]);
        mk_sim_destroy(sim);
    }
}
END_TEST

START_TEST(energy_is_conserved_without_friction_and_drive)
{
    enum mk_plant_kind kind = (enum mk_plant_kind)_i;
    struct mk_model m;
    mk_model_default(kind, &m);
    int np = mk_plant(kind)->parameter_count;
    m.parameter[np - 2] = m.parameter[np - 1] = 0.0;
    struct mk_sim *sim = make(&m, MK_SOLVER_DEFAULT, 1e-12);
    double q[2] = {2.0, 1.3}, v[2] = {3.0, -2.0};
    start(sim, &m, q, v);
    struct mk_energy first, last;
    ck_assert_int_eq(mk_sim_energy(sim, &first), MK_OK);
    for (int k = 1; k <= 500; k++)
        advance(sim, k * 0.01, 0.0);
    ck_assert_int_eq(mk_sim_energy(sim, &last), MK_OK);
    double before = first.kinetic + first.potential, after = last.kinetic + last.potential;
    ck_assert_double_eq_tol(after, before, 1e-7 * (1.0 + fabs(before)));
    ck_assert_double_eq_tol(last.loss, before - after, 1e-12 * (1.0 + fabs(before)));
    mk_sim_destroy(sim);
}
END_TEST

START_TEST(the_energy_balance_closes_with_friction_and_drive)
{
    struct mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    struct mk_sim *sim = make(&m, MK_SOLVER_DEFAULT, 1e-11);
    double v[2] = {0, 0}, loss = 0.0, h = 0.0005;
    start(sim, &m, mk_plant(m.plant)->rest, v);
    struct mk_energy e;
    double before = 0.0;
    for (int k = 0; k < 8000; k++) {
        advance(sim, (k + 1) * h, 1.5 * sin(6.0 * h * k));
        double w = mk_sim_state(sim)[2], power = mk_plant_friction(&m, w) * w;
        loss += 0.5 * h * (before + power); /* trapezoid over what friction takes */
        before = power;
    }
    ck_assert_int_eq(mk_sim_energy(sim, &e), MK_OK);
    ck_assert_double_gt(e.work, 0.1);
    ck_assert_double_eq_tol(e.loss, loss, 1e-4 * loss);
    mk_sim_destroy(sim);
}
END_TEST

/* --- edges ------------------------------------------------------------------------------- */

/* A frictionless wheel under steps of u: speed and angle are sums of closed forms. */
static struct mk_model bare_wheel(void)
{
    struct mk_model m;
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &m);
    m.parameter[0] = 0.5;
    m.parameter[1] = m.parameter[2] = 0.0;
    return m;
}

START_TEST(zero_order_hold_edges_are_exact)
{
    struct mk_model m = bare_wheel();
    double u[] = {1, -2, 0.5, 10, -10}, t[] = {0.003, 0.0041, 0.02, 0.0207, 0.05};
    for (size_t s = 0; s < 3; s++) {
        struct mk_sim *sim = make(&m, event_solvers[s], 1e-10);
        start(sim, &m, (double[2]){0, 0}, (double[2]){0, 0});
        double q = 0, v = 0, now = 0;
        for (int i = 0; i < 5; i++) {
            double dt = t[i] - now, a = u[i] / 0.5;
            q += v * dt + 0.5 * a * dt * dt;
            v += a * dt;
            now = t[i];
            advance(sim, now, u[i]);
            ck_assert_double_eq_tol(mk_sim_state(sim)[0], q, 1e-9 * (1 + fabs(q)));
            ck_assert_double_eq_tol(mk_sim_state(sim)[1], v, 1e-9 * (1 + fabs(v)));
        }
        mk_sim_destroy(sim);
    }
}
END_TEST

START_TEST(an_input_delay_shifts_every_edge)
{
    struct mk_model m = bare_wheel();
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(mk_model_add_effect(&m, "input-delay", 0, &err), MK_OK);
    m.effect[0].value[0] = 0.0035; /* one period and three quarters */
    struct mk_sim *sim = make(&m, MK_SOLVER_DEFAULT, 1e-10);
    start(sim, &m, (double[2]){0, 0}, (double[2]){0, 0});
    double u[6] = {1, 3, -2, 4, 0, 1}, speed = 0.0, applied[2];
    for (int k = 0; k < 6; k++) {
        advance(sim, (k + 1) * 0.002, u[k]);
        /* In [0.002 k, 0.002 (k+1)) the command is u[k-2] for 1.5 ms, then u[k-1]. */
        speed += (k >= 2 ? u[k - 2] : 0) * 0.0015 / 0.5 + (k >= 1 ? u[k - 1] : 0) * 0.0005 / 0.5;
        ck_assert_double_eq_tol(mk_sim_state(sim)[1], speed, 1e-12);
    }
    mk_sim_applied(sim, applied);
    ck_assert_double_eq(applied[0], 0.0); /* u[4] */
    mk_sim_destroy(sim);
}
END_TEST

/* The same commands without a delay, given when they come into force. */
START_TEST(an_input_delay_is_exact_between_samples_for_both_motors)
{
    const double late = 0.0037, period = 0.002;
    enum { ROWS = 200 };
    struct mk_model m, delayed;
    struct mk_error err = MK_ERROR_INIT;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    delayed = m;
    ck_assert_int_eq(mk_model_add_effect(&delayed, "input-delay", 0, &err), MK_OK);
    delayed.effect[0].value[0] = late;
    struct mk_sim *a = make(&delayed, MK_SOLVER_DEFAULT, 1e-11),
                  *b = make(&m, MK_SOLVER_DEFAULT, 1e-11);
    const double none[2] = {0.0, 0.0};
    start(a, &delayed, mk_plant(m.plant)->rest, none);
    start(b, &m, mk_plant(m.plant)->rest, none);
    ck_assert_int_eq(mk_sim_advance(b, late, none, &err), MK_OK);
    for (int k = 0; k < ROWS; k++) {
        const double t = period * k, u[2] = {1.5 * sin(9.0 * t), 0.8 * cos(7.0 * t)};
        ck_assert_int_eq(mk_sim_advance(a, t + period, u, &err), MK_OK);
        ck_assert_int_eq(mk_sim_advance(b, t + period + late, u, &err), MK_OK);
    }
    ck_assert_int_eq(mk_sim_advance(a, period * ROWS + late, none, &err), MK_OK);
    for (int i = 0; i < 4; i++)
        ck_assert_double_eq_tol(mk_sim_state(a)[i], mk_sim_state(b)[i], 1e-6);
    mk_sim_destroy(a);
    mk_sim_destroy(b);
}
END_TEST

/* A run that is taken up in the middle goes on as it went. */
START_TEST(a_run_goes_on_with_the_commands_that_are_on_their_way)
{
    struct mk_model m = bare_wheel();
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(mk_model_add_effect(&m, "input-delay", 0, &err), MK_OK);
    m.effect[0].value[0] = 0.0051;
    struct mk_sim *sim = make(&m, MK_SOLVER_DEFAULT, 1e-10),
                  *again = make(&m, MK_SOLVER_DEFAULT, 1e-10);
    start(sim, &m, (double[2]){0, 0}, (double[2]){0, 0});
    for (int k = 0; k < 10; k++)
        advance(sim, (k + 1) * 0.002, sin(1.7 * k));
    const double first[2] = {sin(1.7 * 7), 0}; /* given at 14 ms, in force from 19.1 ms on */
    ck_assert_int_eq(mk_sim_reset(again, 0.02, mk_sim_state(sim), first), MK_OK);
    for (int k = 7; k < 10; k++) {
        const double u[2] = {sin(1.7 * k), 0};
        ck_assert_int_eq(mk_sim_issued_before(again, k * 0.002, u, &err), MK_OK);
    }
    const double later[2] = {1, 0};
    ck_assert_int_eq(mk_sim_issued_before(again, 0.03, later, &err), MK_ERR_STATE);
    advance(sim, 0.03, 1.0);
    advance(again, 0.03, 1.0);
    for (int i = 0; i < 2; i++)
        ck_assert_double_eq_tol(mk_sim_state(again)[i], mk_sim_state(sim)[i], 1e-12);
    mk_sim_destroy(sim);
    mk_sim_destroy(again);
}
END_TEST

/* With a delay that has become shorter, or has gone, a command would overtake the one before it and
 * time would run backwards. */
START_TEST(a_delay_that_becomes_shorter_lets_no_command_overtake_another)
{
    for (int gone = 0; gone < 2; gone++) {
        struct mk_model m = bare_wheel();
        struct mk_error err = MK_ERROR_INIT;
        double applied[2];
        ck_assert_int_eq(mk_model_add_effect(&m, "input-delay", 0, &err), MK_OK);
        m.effect[0].value[0] = 0.010;
        struct mk_sim *sim = make(&m, MK_SOLVER_DEFAULT, 1e-10);
        start(sim, &m, (double[2]){0, 0}, (double[2]){0, 0});
        advance(sim, 0.002, 4.0); /* in force from 10 ms on */
        m.effect[0].value[0] = gone ? 0.0 : 0.001;
        ck_assert_int_eq(mk_sim_set_values(sim, &m, &err), MK_OK);
        for (int k = 1; k < 20; k++) {
            const double before = mk_sim_time(sim);
            advance(sim, (k + 1) * 0.002, 1.0);
            ck_assert_double_gt(mk_sim_time(sim), before);
        }
        /* 1.0 was given at 2 ms and waits for the 4.0. */
        ck_assert_double_eq_tol(mk_sim_state(sim)[1], 0.030 * 1.0 / 0.5, 1e-9);
        mk_sim_applied(sim, applied);
        ck_assert_double_eq(applied[0], 1.0);
        mk_sim_destroy(sim);
    }
}
END_TEST

START_TEST(a_reading_that_becomes_late_is_read_late)
{
    struct mk_model m = bare_wheel();
    struct mk_error err = MK_ERROR_INIT;
    double y[2];
    ck_assert_int_eq(mk_model_add_effect(&m, "sensor-delay", 0, &err), MK_OK);
    m.effect[0].value[0] = 0.0;
    struct mk_sim *sim = make(&m, MK_SOLVER_DEFAULT, 1e-10);
    m.effect[0].value[0] = 0.004;
    ck_assert_int_eq(mk_sim_set_values(sim, &m, &err), MK_OK);
    start(sim, &m, (double[2]){0, 0}, (double[2]){2.0, 0}); /* without a force the speed stays */
    for (int k = 0; k < 10; k++)
        advance(sim, (k + 1) * 0.002, 0.0);
    mk_sim_measure(sim, y);
    ck_assert_double_eq_tol(y[0], 2.0 * (0.020 - 0.004), 1e-9);
    mk_sim_destroy(sim);
}
END_TEST

/* --- events ------------------------------------------------------------------------------ */

START_TEST(a_body_rattles_in_its_gap_with_the_period_of_the_closed_form)
{
    /* Rotor and wheel, no friction, no damping: free flight across the gap, half a period of the
     * contact spring at each side. */
    struct mk_model m = bare_wheel();
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(mk_model_add_effect(&m, "backlash", 1, &err), MK_OK);
    m.effect[0].value[3] = 0.2; /* the rotor's share */
    double *p = m.effect[0].value, w = 4.0;
    p[0] = 0.02, p[1] = 200.0, p[2] = 0.0;
    double rotor = 0.2 * 0.5, load = 0.8 * 0.5, reduced = rotor * load / (rotor + load);
    double period = 2.0 * (p[0] / w + M_PI * sqrt(reduced / p[1]));
    for (size_t s = 0; s < 3; s++) {
        struct mk_sim *sim = make(&m, event_solvers[s], 1e-10);
        double x[4] = {0, 0, 0, w}; /* wheel at rest, rotor flying from the middle of the gap */
        ck_assert_int_eq(mk_sim_reset(sim, 0.0, x, NULL), MK_OK);
        for (int k = 1; k <= 100; k++)
            advance(sim, k * period / 10.0, 0.0);
        const double *y = mk_sim_state(sim);
        struct mk_sim_stats stats;
        mk_sim_get_stats(sim, &stats);
        ck_assert_double_eq_tol(y[2] - y[0], 0.0, 1e-5);
        ck_assert_double_eq_tol(y[3] - y[1], w, 1e-3);
        ck_assert_double_eq_tol(load * y[1] + rotor * y[3], rotor * w, 1e-7);
        ck_assert_int_ge((int)stats.events, 39);
        mk_sim_destroy(sim);
    }
}
END_TEST

/* --- refusals ---------------------------------------------------------------------------- */

START_TEST(nonsense_is_refused)
{
    struct mk_model m = bare_wheel();
    struct mk_error err = MK_ERROR_INIT;
    struct mk_sim *sim = make(&m, MK_SOLVER_DEFAULT, 1e-8);
    double u[2] = {0, 0}, bad[2] = {NAN, 0}, x[2] = {0, INFINITY};
    ck_assert_int_eq(mk_sim_advance(sim, 1.0, u, &err), MK_ERR_STATE);
    ck_assert_int_eq(mk_sim_reset(sim, 0, x, NULL), MK_ERR_NUMERIC);
    start(sim, &m, (double[2]){0, 0}, (double[2]){0, 0});
    ck_assert_int_eq(mk_sim_advance(sim, 1.0, bad, &err), MK_ERR_INVALID);
    ck_assert_int_eq(mk_sim_advance(sim, -1.0, u, &err), MK_ERR_INVALID);
    mk_sim_destroy(sim);
    m.parameter[0] = -1.0;
    ck_assert_int_eq(mk_sim_create(&m, NULL, &sim, &err), MK_ERR_RANGE);
    ck_assert_ptr_null(sim);
    struct mk_model play = bare_wheel();
    struct mk_sim_config smooth = {.solver = MK_SOLVER_DOP853};
    ck_assert_int_eq(mk_model_add_effect(&play, "backlash", 1, &err), MK_OK);
    ck_assert_int_eq(mk_sim_create(&play, &smooth, &sim, &err), MK_ERR_NOTSUP);
    ck_assert_int_eq(mk_solver_by_name("euler"), MK_SOLVER_COUNT);
    ck_assert_int_eq(mk_solver_by_name("cvode-bdf"), MK_SOLVER_CVODE_BDF);
}
END_TEST

Suite *suite_sim(void)
{
    Suite *s = suite_create("sim");
    TCase *t = tcase_create("integration");
    tcase_set_timeout(t, 20);
    tcase_add_loop_test(t, every_solver_agrees_with_a_fine_fixed_step_integrator, 0,
                        MK_PLANT_COUNT);
    tcase_add_loop_test(t, energy_is_conserved_without_friction_and_drive, 0, MK_PLANT_COUNT);
    tcase_add_test(t, the_energy_balance_closes_with_friction_and_drive);
    tcase_add_test(t, zero_order_hold_edges_are_exact);
    tcase_add_test(t, an_input_delay_shifts_every_edge);
    tcase_add_test(t, an_input_delay_is_exact_between_samples_for_both_motors);
    tcase_add_test(t, a_run_goes_on_with_the_commands_that_are_on_their_way);
    tcase_add_test(t, a_delay_that_becomes_shorter_lets_no_command_overtake_another);
    tcase_add_test(t, a_reading_that_becomes_late_is_read_late);
    tcase_add_test(t, a_body_rattles_in_its_gap_with_the_period_of_the_closed_form);
    tcase_add_test(t, nonsense_is_refused);
    suite_add_tcase(s, t);
    return s;
}
