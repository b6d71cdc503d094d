/* Equations of motion against independent truth: bodies as clouds of point masses, whose Lagrangian
 * is differentiated numerically, and what the report and its errata print. */
#include "suites.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mechkit/ctrl.h"
#include "mechkit/measure.h"
#include "mechkit/model.h"
#include "model/plant_facts.h"

#define G 9.81

static double uniform(double low, double high)
{
    return low + (high - low) * (rand() / (double)RAND_MAX);
}

/* --- bodies ------------------------------------------------------------------------------ */

/* A rod of mass m from s0 to s1 along its axis, as points whose first three moments are exact. */
#define POINTS 3
struct rod {
    double m, at[POINTS], weight[POINTS];
};

static struct rod rod(double m, double s0, double s1)
{
    /* 3-point Gauss: exact for polynomials up to degree 5 along the rod. */
    double mid = 0.5 * (s0 + s1), half = 0.5 * (s1 - s0), x = sqrt(0.6);
    return (struct rod){m, {mid - half * x, mid, mid + half * x}, {5.0 / 18, 8.0 / 18, 5.0 / 18}};
}
static double moment(struct rod r, int power)
{
    double sum = 0.0;
    for (int i = 0; i < POINTS; i++)
        sum += r.m * r.weight[i] * pow(r.at[i], power);
    return sum;
}

static struct rod link1, link2, wheel;
static double length1 = 0.2;

static void make_bodies(void)
{
    link1 = rod(0.3, -0.02, length1);
    link2 = rod(0.2, -0.03, 0.25);
    wheel = rod(0.25, -0.06, 0.06); /* a bar that spins: a wheel as far as inertia goes */
}

typedef void position(enum mk_plant_kind kind, int body, double s, const double *q, double *r);

/* Cartesian position (z up) of the point at s on body 1 or 2. */
static void point(enum mk_plant_kind kind, int body, double s, const double *q, double *r)
{
    double a = q[0], b = q[1];
    memset(r, 0, 3 * sizeof *r);
    switch (kind) {
    case MK_PLANT_PENDULUM: /* from the downward vertical */
        r[0] = s * sin(a), r[2] = -s * cos(a);
        break;
    case MK_PLANT_CART_POLE: /* the pole from upright, towards the carriage's positive side */
        r[0] = a, r[2] = 0.0;
        if (body == 2)
            r[0] += s * sin(b), r[2] = s * cos(b);
        break;
    case MK_PLANT_ACROBOT:
    case MK_PLANT_PENDUBOT: /* from the horizontal */
        if (body == 1)
            r[0] = s * cos(a), r[2] = s * sin(a);
        else
            r[0] = length1 * cos(a) + s * cos(a + b), r[2] = length1 * sin(a) + s * sin(a + b);
        break;
    case MK_PLANT_REACTION_WHEEL:
        if (body == 1)
            r[0] = s * sin(a), r[2] = -s * cos(a);
        else
            r[0] = length1 * sin(a) + s * cos(a + b), r[2] = -length1 * cos(a) + s * sin(a + b);
        break;
    case MK_PLANT_FURUTA:
        if (body == 1) {
            r[0] = s * cos(a), r[1] = s * sin(a);
        } else {
            r[0] = length1 * cos(a) - s * sin(a) * sin(b);
            r[1] = length1 * sin(a) + s * cos(a) * sin(b);
            r[2] = s * cos(b);
        }
        break;
    default: /* inertia wheel */
        r[0] = s * cos(a), r[1] = s * sin(a);
    }
}

static double lagrangian_part(enum mk_plant_kind kind, int body, struct rod bar, const double *q,
                              const double *v, double sign)
{
    double sum = 0.0, h = 1e-5;
    for (int i = 0; i < POINTS; i++) {
        double ahead[3], behind[3], here[3], qa[2], qb[2], speed2 = 0.0;
        for (int j = 0; j < 2; j++)
            qa[j] = q[j] + h * v[j], qb[j] = q[j] - h * v[j];
        point(kind, body, bar.at[i], qa, ahead);
        point(kind, body, bar.at[i], qb, behind);
        point(kind, body, bar.at[i], q, here);
        for (int k = 0; k < 3; k++)
            speed2 += pow((ahead[k] - behind[k]) / (2 * h), 2);
        double m = bar.m * bar.weight[i];
        sum += 0.5 * m * speed2 + sign * m * G * here[2];
    }
    return sum;
}

static struct rod second_body(enum mk_plant_kind kind)
{
    return kind == MK_PLANT_REACTION_WHEEL ? wheel : link2;
}

/* sign -1: Lagrangian T - V; +1: energy T + V. */
static double cloud(enum mk_plant_kind kind, const double *q, const double *v, double sign)
{
    double sum =
        lagrangian_part(kind, 1, kind == MK_PLANT_INERTIA_WHEEL ? wheel : link1, q, v, sign);
    if (mk_plant(kind)->joints == 2)
        sum += lagrangian_part(kind, 2, second_body(kind), q, v, sign);
    return sum;
}

/* Base parameters of those bodies, by their definitions. */
static struct mk_model model_of(enum mk_plant_kind kind)
{
    struct mk_model m;
    mk_model_default(kind, &m);
    m.g = G;
    double m2 = link2.m, *p = m.parameter;
    switch (kind) {
    case MK_PLANT_PENDULUM:
        p[0] = moment(link1, 2), p[1] = moment(link1, 1) * G;
        break;
    case MK_PLANT_CART_POLE:
        p[0] = link1.m + m2;
        p[1] = moment(link2, 1);
        p[2] = moment(link2, 2);
        break;
    case MK_PLANT_ACROBOT:
    case MK_PLANT_PENDUBOT:
        p[0] = moment(link1, 2) + m2 * length1 * length1;
        p[1] = moment(link2, 2);
        p[2] = length1 * moment(link2, 1);
        p[3] = moment(link1, 1) + m2 * length1;
        p[4] = moment(link2, 1);
        break;
    case MK_PLANT_REACTION_WHEEL:
        p[0] = moment(link1, 2) + wheel.m * length1 * length1;
        p[1] = moment(wheel, 2);
        p[2] = moment(link1, 1) + wheel.m * length1;
        break;
    case MK_PLANT_FURUTA:
        p[0] = moment(link1, 2) + m2 * length1 * length1;
        p[1] = 2.0 * length1 * moment(link2, 1);
        p[2] = moment(link2, 2) / 4.0;
        p[3] = moment(link2, 1);
        break;
    default:
        p[0] = moment(wheel, 2);
    }
    int np = mk_plant(kind)->parameter_count;
    p[np - 2] = p[np - 1] = 0.0;
    return m;
}

/* Generalised forces by Lagrange's equations, every derivative taken numerically. */
static void lagrange(enum mk_plant_kind kind, const double *q, const double *v, const double *a,
                     double *tau)
{
    double h = 1e-4;
    for (int j = 0; j < mk_plant(kind)->joints; j++) {
        double momentum[2], dldq[2];
        for (int side = 0; side < 2; side++) {
            double dt = side ? h : -h, qs[2], vs[2], l[2];
            for (int i = 0; i < 2; i++)
                qs[i] = q[i] + v[i] * dt + 0.5 * a[i] * dt * dt, vs[i] = v[i] + a[i] * dt;
            for (int s = 0; s < 2; s++) {
                double vp[2] = {vs[0], vs[1]};
                vp[j] += s ? 1e-2 : -1e-2; /* L is quadratic in speed: any step is exact */
                l[s] = cloud(kind, qs, vp, -1.0);
            }
            momentum[side] = (l[1] - l[0]) / 2e-2;
            double qp[2] = {q[0], q[1]};
            qp[j] += side ? h : -h;
            dldq[side] = cloud(kind, qp, v, -1.0);
        }
        tau[j] = (momentum[1] - momentum[0]) / (2 * h) - (dldq[1] - dldq[0]) / (2 * h);
    }
}

START_TEST(equations_of_motion_are_those_of_point_masses)
{
    enum mk_plant_kind kind = (enum mk_plant_kind)_i;
    make_bodies();
    srand(7);
    struct mk_model m = model_of(kind);
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(mk_model_check(&m, &err), MK_OK);
    for (int trial = 0; trial < 50; trial++) {
        double q[2], v[2], a[2], want[2], got[2];
        for (int j = 0; j < 2; j++)
            q[j] = uniform(-4, 4), v[j] = uniform(-6, 6), a[j] = uniform(-30, 30);
        if (mk_plant(kind)->joints == 1)
            q[1] = v[1] = a[1] = 0.0;
        lagrange(kind, q, v, a, want);
        mk_plant_inverse_dynamics(&m, q, v, a, got);
        for (int j = 0; j < mk_plant(kind)->joints; j++)
            ck_assert_double_eq_tol(got[j], want[j], 2e-5 * (1.0 + fabs(want[j])));
        double energy = mk_plant_kinetic(&m, q, v) + mk_plant_potential(&m, q);
        double rest = mk_plant_potential(&m, q) - (cloud(kind, q, (double[2]){0, 0}, 1.0));
        ck_assert_double_eq_tol(energy, cloud(kind, q, v, 1.0) + rest, 1e-7);
    }
}
END_TEST

START_TEST(potential_is_what_gravity_comes_from)
{
    enum mk_plant_kind kind = (enum mk_plant_kind)_i;
    make_bodies();
    srand(8);
    struct mk_model m = model_of(kind);
    for (int trial = 0; trial < 20; trial++) {
        double q[2] = {uniform(-4, 4), uniform(-4, 4)}, zero[2] = {0, 0}, tau[2];
        mk_plant_inverse_dynamics(&m, q, zero, zero, tau);
        for (int j = 0; j < mk_plant(kind)->joints; j++) {
            double ahead[2] = {q[0], q[1]}, behind[2] = {q[0], q[1]};
            ahead[j] += 1e-5, behind[j] -= 1e-5;
            double slope = (mk_plant_potential(&m, ahead) - mk_plant_potential(&m, behind)) / 2e-5;
            ck_assert_double_eq_tol(tau[j], slope, 1e-8);
        }
    }
}
END_TEST

START_TEST(regressor_times_parameters_is_the_torque)
{
    enum mk_plant_kind kind = (enum mk_plant_kind)_i;
    struct mk_model m;
    mk_model_default(kind, &m);
    int n = mk_plant(kind)->joints, np = mk_plant(kind)->parameter_count;
    srand(9);
    for (int trial = 0; trial < 50; trial++) {
        double q[2], v[2], a[2], tau[2], phi[2 * MK_MAX_PARAMETERS];
        for (int j = 0; j < 2; j++)
            q[j] = uniform(-4, 4), v[j] = uniform(-1, 1), a[j] = uniform(-30, 30);
        mk_plant_inverse_dynamics(&m, q, v, a, tau);
        mk_plant_regressor(&m, q, v, a, phi);
        for (int i = 0; i < n; i++) {
            double sum = 0.0;
            for (int k = 0; k < np; k++)
                sum += phi[i * np + k] * m.parameter[k];
            ck_assert_double_eq_tol(sum, tau[i], 1e-12 * (1.0 + fabs(tau[i])));
        }
    }
}
END_TEST

START_TEST(acceleration_inverts_inverse_dynamics)
{
    enum mk_plant_kind kind = (enum mk_plant_kind)_i;
    struct mk_model m;
    mk_model_default(kind, &m);
    srand(10);
    for (int trial = 0; trial < 50; trial++) {
        double q[2], v[2], a[2], tau[2], back[2];
        for (int j = 0; j < 2; j++)
            q[j] = uniform(-4, 4), v[j] = uniform(-9, 9), a[j] = uniform(-30, 30);
        mk_plant_inverse_dynamics(&m, q, v, a, tau);
        mk_plant_acceleration(&m, q, v, tau, back);
        for (int j = 0; j < mk_plant(kind)->joints; j++)
            ck_assert_double_eq_tol(back[j], a[j], 1e-9);
    }
}
END_TEST

/* --- the report's print ------------------------------------------------------------------ */

START_TEST(pendubot_regressor_is_that_of_the_corrected_report)
{
    struct mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    double q[2] = {0.3, -0.8}, v[2] = {1.1, -2.3}, a[2] = {4.0, 7.0}, phi[14], g = m.g;
    mk_plant_regressor(&m, q, v, a, phi);
    double want[14] = {a[0],
                       a[0] + a[1],
                       cos(q[1]) * (2 * a[0] + a[1]) - sin(q[1]) * (2 * v[0] * v[1] + v[1] * v[1]),
                       g * cos(q[0]),
                       g * cos(q[0] + q[1]),
                       v[0],
                       1.0 - 2.0 / (exp(30.0 * v[0]) + 1.0),
                       0,
                       a[0] + a[1],
                       cos(q[1]) * a[0] + sin(q[1]) * v[0] * v[0],
                       0,
                       g * cos(q[0] + q[1]),
                       0,
                       0};
    for (int i = 0; i < 14; i++)
        ck_assert_double_eq_tol(phi[i], want[i], 1e-12);
}
END_TEST

START_TEST(furuta_regressor_is_that_of_the_corrected_report)
{
    struct mk_model m;
    mk_model_default(MK_PLANT_FURUTA, &m);
    double q[2] = {0.3, -0.8}, v[2] = {1.1, -2.3}, a[2] = {4.0, 7.0}, phi[12];
    double s = sin(q[1]), c = cos(q[1]), s2 = sin(2 * q[1]);
    mk_plant_regressor(&m, q, v, a, phi);
    double want[12] = {a[0],
                       0.5 * (c * a[1] - s * v[1] * v[1]),
                       4 * s * s * a[0] + 4 * s2 * v[0] * v[1],
                       0,
                       v[0],
                       tanh(15 * v[0]),
                       0,
                       0.5 * c * a[0],
                       4 * a[1] - 2 * s2 * v[0] * v[0],
                       -m.g * s,
                       0,
                       0};
    for (int i = 0; i < 12; i++)
        ck_assert_double_eq_tol(phi[i], want[i], 1e-12);
}
END_TEST

START_TEST(reaction_wheel_has_the_report_s_two_equations)
{
    struct mk_model m;
    mk_model_default(MK_PLANT_REACTION_WHEEL, &m);
    double *p = m.parameter, q[2] = {0.7, 3.0}, v[2] = {0.5, -20.0}, u = 1.3, tau[2] = {0, u}, a[2];
    mk_plant_acceleration(&m, q, v, tau, a);
    double f = p[3] * v[1] + p[4] * tanh(15 * v[1]);
    ck_assert_double_eq_tol(p[0] * a[0] + p[2] * m.g * sin(q[0]), -(u - f), 1e-10);
    ck_assert_double_eq_tol(p[1] * (a[0] + a[1]), u - f, 1e-10);
    /* Friction never puts energy in (errata 6.3). */
    ck_assert_double_gt(f * v[1], 0.0);
}
END_TEST

START_TEST(pendubot_linearisation_is_that_of_appendix_2)
{
    struct mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    m.g = 9.80; /* as the report's numbers (errata 4.1) */
    double mid[2] = {-M_PI / 2, M_PI}, top[2] = {M_PI / 2, 0}, a[16], b[4];
    double printed[2][6] = {{-153, 43.87, 131.6, 38.96, 25.738, -12.107},
                            {153, -43.87, -174.4, 126.71, 25.738, -39.37}};
    for (int i = 0; i < 2; i++) {
        mk_plant_linearise(&m, i ? top : mid, false, a, b);
        double got[6] = {a[2 * 4 + 0], a[2 * 4 + 1], a[3 * 4 + 0], a[3 * 4 + 1], b[2], b[3]};
        for (int k = 0; k < 6; k++)
            ck_assert_double_eq_tol(got[k], printed[i][k], 0.06);
        ck_assert_double_eq(a[0 * 4 + 2], 1.0);
        ck_assert_double_eq(a[1 * 4 + 3], 1.0);
    }
    double *p = m.parameter, det = p[0] * p[1] - p[2] * p[2];
    mk_plant_linearise(&m, mid, false, a, b);
    ck_assert_double_eq_tol(a[2 * 4], m.g * (p[2] * p[4] - p[1] * p[3]) / det, 1e-9);
    ck_assert_double_eq_tol(a[3 * 4 + 1], m.g * p[4] * (p[0] - p[2]) / det, 1e-9);
}
END_TEST

START_TEST(linearisation_agrees_with_finite_differences)
{
    enum mk_plant_kind kind = (enum mk_plant_kind)_i;
    struct mk_model m;
    mk_model_default(kind, &m);
    int n = mk_plant(kind)->joints, ns = 2 * n;
    for (int e = 0; e < mk_plant(kind)->equilibrium_count; e++) {
        const double *q = mk_plant(kind)->equilibrium[e].q;
        double a[16], b[4], zero[2] = {0, 0}, hold[2], h = 1e-7;
        mk_plant_linearise(&m, q, true, a, b);
        mk_plant_inverse_dynamics(&m, q, zero, zero, hold);
        for (int col = 0; col <= ns; col++) {
            double d[2][MK_MAX_STATES];
            for (int s = 0; s < 2; s++) {
                double x[MK_MAX_STATES] = {q[0], n > 1 ? q[1] : 0.0, 0, 0};
                double u[2] = {hold[mk_plant(kind)->motor_joint], 0};
                if (col < ns)
                    x[col] += s ? h : -h;
                else
                    u[0] += s ? h : -h;
                mk_model_rhs(&m, 0, x, u, d[s]);
            }
            for (int row = 0; row < ns; row++) {
                double slope = (d[1][row] - d[0][row]) / (2 * h);
                double got = col < ns ? a[row * ns + col] : b[row];
                ck_assert_double_eq_tol(got, slope, 1e-5 * (1.0 + fabs(slope)));
            }
        }
    }
}
END_TEST

START_TEST(small_swings_have_the_published_frequency)
{
    struct mk_model m;
    mk_model_default(MK_PLANT_REACTION_WHEEL, &m);
    m.g = 9.80;
    ck_assert_double_eq_tol(sqrt(m.parameter[2] * m.g / m.parameter[0]) / (2 * M_PI), 1.4122, 1e-4);
}
END_TEST

/* --- cart-pole and acrobot: closed forms ------------------------------------------------- */

/* Frequency of small oscillations of two free joints about q, from the numerical linearisation
 * without friction: the larger of -a's two eigenvalues, as a rate. */
static double small_frequency(const struct mk_model *m, const double *q)
{
    double a[16], b[4];
    mk_plant_linearise(m, q, false, a, b);
    double s = -(a[2 * 4] + a[3 * 4 + 1]), d = a[2 * 4] * a[3 * 4 + 1] - a[2 * 4 + 1] * a[3 * 4];
    return sqrt(0.5 * s + sqrt(fmax(0.25 * s * s - d, 0.0)));
}

START_TEST(a_free_carriage_makes_its_pole_swing_faster)
{
    struct mk_model m;
    mk_model_default(MK_PLANT_CART_POLE, &m);
    double *p = m.parameter, hanging[2] = {0.3, M_PI};
    /* With no force the centre of mass stays: the pole swings about a point above it. */
    double want = sqrt(p[0] * p[1] * m.g / (p[0] * p[2] - p[1] * p[1]));
    ck_assert_double_eq_tol(small_frequency(&m, hanging), want, 1e-9 * want);
    p[0] = 1e9; /* a carriage that nothing moves */
    ck_assert_double_eq_tol(small_frequency(&m, hanging), sqrt(p[1] * m.g / p[2]), 1e-6);
}
END_TEST

START_TEST(a_carriage_that_is_pulled_pulls_its_pole_after_it)
{
    struct mk_model m;
    mk_model_default(MK_PLANT_CART_POLE, &m);
    double *p = m.parameter, up[2] = {0.0, 0.0}, still[2] = {0.0, 0.0}, tau[2] = {1.0, 0.0}, a[2];
    p[3] = p[4] = 0.0;
    mk_plant_acceleration(&m, up, still, tau, a);
    ck_assert_double_eq_tol(a[0], p[2] / (p[0] * p[2] - p[1] * p[1]), 1e-12);
    ck_assert_double_eq_tol(a[1], -p[1] / p[2] * a[0], 1e-12); /* the tip stays behind */
    double leans[2] = {0.0, 0.1};
    mk_plant_acceleration(&m, leans, still, still, a);
    ck_assert(a[1] > 0.0 && a[0] < 0.0); /* falls on, and the carriage slips back */
}
END_TEST

START_TEST(a_tilted_track_pulls_the_whole_mass_down_it)
{
    struct mk_model m;
    struct mk_error err = MK_ERROR_INIT;
    mk_model_default(MK_PLANT_CART_POLE, &m);
    ck_assert_int_eq(mk_model_add_effect(&m, "base-tilt", 0, &err), MK_OK);
    const double tilt = 0.2;
    m.effect[0].value[0] = tilt;
    /* With the pole held in the direction of gravity the rig slides as one body. */
    double x[4] = {0.4, M_PI + tilt, 0.0, 0.0}, dx[4], u[2] = {0.0, 0.0};
    u[0] = m.parameter[0] * m.g * sin(tilt);
    mk_model_rhs(&m, 0.0, x, u, dx);
    ck_assert_double_eq_tol(dx[2], 0.0, 1e-12);
    ck_assert_double_eq_tol(dx[3], 0.0, 1e-12);
}
END_TEST

START_TEST(an_acrobot_is_a_pendubot_with_its_motor_at_the_elbow)
{
    struct mk_model elbow, shoulder;
    mk_model_default(MK_PLANT_ACROBOT, &elbow);
    mk_model_default(MK_PLANT_PENDUBOT, &shoulder);
    double q[2] = {0.4, -1.1}, v[2] = {2.0, -3.0}, a[2], b[2], u = 1.7;
    double tau[2] = {0.0, u}, *p = elbow.parameter;
    memcpy(shoulder.parameter, p, sizeof elbow.parameter);
    mk_plant_acceleration(&elbow, q, v, tau, a);
    /* The pendubot's own friction sits at the shoulder: take it back, and put the elbow's on. */
    tau[0] = p[5] * v[0] + p[6] * tanh(15 * v[0]);
    tau[1] = u - (p[5] * v[1] + p[6] * tanh(15 * v[1]));
    mk_plant_acceleration(&shoulder, q, v, tau, b);
    for (int j = 0; j < 2; j++)
        ck_assert_double_eq_tol(a[j], b[j], 1e-10);
    double x[4] = {q[0], q[1], v[0], v[1]}, dx[4], command[2] = {u, 0.0};
    mk_model_rhs(&elbow, 0.0, x, command, dx);
    for (int j = 0; j < 2; j++)
        ck_assert_double_eq_tol(dx[2 + j], a[j], 1e-10);
}
END_TEST

/* --- what every plant has ---------------------------------------------------------------- */

static void check_names(const struct mk_plant_info *plant)
{
    for (int k = 0; k < MK_MAX_PLANT_NAMES && plant->unsuited[k]; k++) {
        const struct mk_effect_info *effect = mk_effect_by_name(plant->unsuited[k]);
        ck_assert_msg(effect != NULL, "%s: no effect %s", plant->name, plant->unsuited[k]);
        ck_assert(!(effect->plants & (1u << plant->kind)));
    }
    for (int k = 0; k < MK_MAX_PLANT_NAMES && plant->measures[k]; k++) {
        const struct mk_measure_info *measure = mk_measure_by_name(plant->measures[k]);
        ck_assert_msg(measure != NULL, "%s: no measurement %s", plant->name, plant->measures[k]);
        ck_assert(measure->plants & (1u << plant->kind));
    }
    for (int k = 0; k < plant->equilibrium_count; k++) {
        const char *setup = plant->equilibrium[k].setup;
        const struct mk_ctrl_ops *ops = setup ? mk_ctrl_setup_by_name(setup) : NULL;
        ck_assert_msg(!setup || ops, "%s: no setup %s", plant->name, setup);
        ck_assert(!ops || ops->plants == 1u << plant->kind);
    }
}

START_TEST(the_names_in_a_plant_s_row_are_of_things_that_there_are)
{
    check_names(mk_plant((enum mk_plant_kind)_i));
    ck_assert_ptr_nonnull(strstr(mk_plant_names(), mk_plant((enum mk_plant_kind)_i)->name));
}
END_TEST

START_TEST(what_a_plant_says_of_itself_goes_with_its_law)
{
    enum mk_plant_kind kind = (enum mk_plant_kind)_i;
    const struct mk_plant_info *plant = mk_plant(kind);
    struct mk_model m;
    struct mk_error err = MK_ERROR_INIT;
    mk_model_default(kind, &m);
    ck_assert_msg(mk_model_check(&m, &err) == MK_OK, "%s", err.message);
    double zero[2] = {0.0, 0.0}, mass[4], hold[2], here[2] = {plant->rest[0], plant->rest[1]};
    for (int e = 0; e < plant->equilibrium_count; e++) {
        mk_plant_mass(&m, plant->equilibrium[e].q, zero, mass, hold);
        for (int j = 0; j < plant->joints; j++)
            ck_assert_double_eq_tol(hold[j], 0.0, 1e-12);
    }
    ck_assert_int_eq(memcmp(plant->rest, plant->equilibrium[0].q, sizeof plant->rest), 0);
    for (int j = 0; j < plant->joints; j++) {
        double low = mk_plant_potential(&m, here), lowest = low;
        ck_assert_double_gt(mk_plant_body_inertia(&m, j), 0.0);
        for (int side = -1; side <= 1; side += 2) {
            here[j] = plant->rest[j] + 0.3 * side;
            lowest = fmin(lowest, mk_plant_potential(&m, here));
            bool flat = fabs(mk_plant_potential(&m, here) - low) < 1e-12;
            bool anywhere = plant->joint_is_level[j] || plant->joint_is_wheel[j];
            ck_assert_msg(flat == anywhere, "%s, joint %d", plant->name, j + 1);
        }
        here[j] = plant->rest[j];
        ck_assert_double_ge(lowest, low - 1e-12); /* it hangs where the row says */
    }
}
END_TEST

START_TEST(a_sketch_has_a_stroke_for_every_joint)
{
    enum mk_plant_kind kind = (enum mk_plant_kind)_i;
    struct mk_stroke s[MK_SKETCH_MAX];
    double q[2] = {0.3, -0.7};
    int count = mk_plant_sketch(kind, q, s);
    unsigned joints = 0;
    ck_assert(count >= 1 && count <= MK_SKETCH_MAX);
    for (int i = 0; i < count; i++)
        if (s[i].kind != MK_STROKE_GROUND)
            joints |= 1u << s[i].joint;
    ck_assert_uint_eq(joints, (1u << mk_plant(kind)->joints) - 1u);
}
END_TEST

START_TEST(a_mass_matrix_that_is_none_is_refused_in_the_plant_s_own_words)
{
    enum mk_plant_kind kind = (enum mk_plant_kind)_i;
    const struct mk_plant_info *plant = mk_plant(kind);
    struct mk_model m;
    struct mk_error err = MK_ERROR_INIT;
    mk_model_default(kind, &m);
    if (!plant->mass_rule)
        return;
    m.parameter[0] *= 1e-6;
    ck_assert_int_eq(mk_model_check(&m, &err), MK_ERR_RANGE);
    ck_assert_msg(strstr(err.message, plant->mass_rule), "%s", err.message);
}
END_TEST

Suite *suite_plants(void)
{
    Suite *s = suite_create("plants");
    TCase *t = tcase_create("equations");
    tcase_add_loop_test(t, equations_of_motion_are_those_of_point_masses, 0, MK_PLANT_COUNT);
    tcase_add_loop_test(t, potential_is_what_gravity_comes_from, 0, MK_PLANT_COUNT);
    tcase_add_loop_test(t, regressor_times_parameters_is_the_torque, 0, MK_PLANT_COUNT);
    tcase_add_loop_test(t, acceleration_inverts_inverse_dynamics, 0, MK_PLANT_COUNT);
    tcase_add_loop_test(t, linearisation_agrees_with_finite_differences, 0, MK_PLANT_COUNT);
    tcase_add_test(t, pendubot_regressor_is_that_of_the_corrected_report);
    tcase_add_test(t, furuta_regressor_is_that_of_the_corrected_report);
    tcase_add_test(t, reaction_wheel_has_the_report_s_two_equations);
    tcase_add_test(t, pendubot_linearisation_is_that_of_appendix_2);
    tcase_add_test(t, small_swings_have_the_published_frequency);
    tcase_add_test(t, a_free_carriage_makes_its_pole_swing_faster);
    tcase_add_test(t, a_carriage_that_is_pulled_pulls_its_pole_after_it);
    tcase_add_test(t, a_tilted_track_pulls_the_whole_mass_down_it);
    tcase_add_test(t, an_acrobot_is_a_pendubot_with_its_motor_at_the_elbow);
    suite_add_tcase(s, t);
    t = tcase_create("rows");
    tcase_add_loop_test(t, the_names_in_a_plant_s_row_are_of_things_that_there_are, 0,
                        MK_PLANT_COUNT);
    tcase_add_loop_test(t, what_a_plant_says_of_itself_goes_with_its_law, 0, MK_PLANT_COUNT);
    tcase_add_loop_test(t, a_sketch_has_a_stroke_for_every_joint, 0, MK_PLANT_COUNT);
    tcase_add_loop_test(t, a_mass_matrix_that_is_none_is_refused_in_the_plant_s_own_words, 0,
                        MK_PLANT_COUNT);
    suite_add_tcase(s, t);
    return s;
}
