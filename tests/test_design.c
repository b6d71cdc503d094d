/* Gain design against the report's numbers, against SciPy's (solve_continuous_are,
 * solve_discrete_are, the sampled cost by Gauss quadrature), and against the equations that the
 * results must satisfy. */
#include "suites.h"

#include <complex.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "mechkit/design.h"

/* Pendubot (3.32) linearised by the formulas of appendix 2, g = 9.80, state [q1 dq1 q2 dq2]. */
static void pendubot(bool top, double *a, double *b)
{
    double p1 = 0.0540, p2 = 0.0540, p3 = 0.0286, p4 = 0.7805, p5 = 0.3284, g = 9.80;
    double d = p1 * p2 - p3 * p3, s = top ? 1.0 : -1.0;
    memset(a, 0, 16 * sizeof *a);
    a[1] = a[11] = 1.0;
    a[4] = s * g * (p2 * p4 - p3 * p5) / d;
    a[6] = -s * g * p3 * p5 / d;
    a[12] = top ? g * (-p2 * p4 - p3 * p4 + p3 * p5 + p1 * p5) / d
                : g * (-p3 * p4 - p3 * p5 + p2 * p4 + p1 * p5) / d;
    a[14] = g * p5 * (p1 + s * p3) / d;
    b[0] = b[2] = 0.0;
    b[1] = p2 / d;
    b[3] = (-p2 - s * p3) / d;
}

/* Q = diag(10, 1, 10, 1): with r = 0.5 the problem of all comparisons with SciPy. */
static const double weights[16] = {10, 0, 0, 0, 0, 1, 0, 0, 0, 0, 10, 0, 0, 0, 0, 1};

static double uniform(void)
{
    return 2.0 * rand() / RAND_MAX - 1.0;
}

static void random_system(int n, double *a, double *b)
{
    for (int i = 0; i < n * n; i++)
        a[i] = 3 * uniform();
    for (int i = 0; i < n; i++)
        b[i] = uniform();
}

/* Q = C'C: symmetric, not indefinite. */
static void random_weights(int n, double *q)
{
    double c[64];
    for (int i = 0; i < n * n; i++)
        c[i] = uniform();
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            q[i * n + j] = 0;
            for (int l = 0; l < n; l++)
                q[i * n + j] += c[l * n + i] * c[l * n + j];
        }
}

/* One mode out of reach, hidden by rotations of the coordinates. */
static void random_unreachable(int n, double *a, double *b)
{
    random_system(n, a, b);
    memset(&a[(n - 1) * n], 0, (n - 1) * sizeof *a);
    b[n - 1] = 0;
    for (int turn = 0; turn < 3 * n; turn++) {
        int p = rand() % n, q = (p + 1 + rand() % (n - 1)) % n;
        double c = cos(turn), s = sin(turn), x = b[p], y = b[q];
        b[p] = c * x - s * y, b[q] = s * x + c * y;
        for (int j = 0; j < n; j++) {
            x = a[p * n + j], y = a[q * n + j];
            a[p * n + j] = c * x - s * y, a[q * n + j] = s * x + c * y;
        }
        for (int j = 0; j < n; j++) {
            x = a[j * n + p], y = a[j * n + q];
            a[j * n + p] = c * x - s * y, a[j * n + q] = s * x + c * y;
        }
    }
}

static void multiply(int n, const double *x, const double *y, double *out)
{
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            out[i * n + j] = 0;
            for (int l = 0; l < n; l++)
                out[i * n + j] += x[i * n + l] * y[l * n + j];
        }
}

static double largest(int count, const double *x)
{
    double most = 0;
    for (int i = 0; i < count; i++)
        most = fmax(most, fabs(x[i]));
    return most;
}

static void close_loop(int n, const double *a, const double *b, const double *k, double *out)
{
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            out[i * n + j] = a[i * n + j] - b[i] * k[j];
}

/* Coefficients c[0..n] (c[n] = 1) of det(s I - M) by Faddeev and LeVerrier: no eigenvalues. */
static void characteristic(int n, const double *m, double *c)
{
    double x[64] = {0}, mx[64];
    c[n] = 1.0;
    for (int k = 1; k <= n; k++) {
        multiply(n, m, x, mx);
        for (int i = 0; i < n * n; i++)
            x[i] = mx[i] + (i % (n + 1) == 0 ? c[n - k + 1] : 0.0);
        multiply(n, m, x, mx);
        c[n - k] = 0;
        for (int i = 0; i < n; i++)
            c[n - k] -= mx[i * n + i] / k;
    }
}

/* Coefficients of the polynomial with these roots. */
static void from_roots(int n, const double *re, const double *im, double *c)
{
    double complex z[9] = {1};
    for (int i = 0; i < n; i++)
        for (int j = i + 1; j >= 0; j--)
            z[j] = (j > 0 ? z[j - 1] : 0) - CMPLX(re[i], im[i]) * (j <= i ? z[j] : 0);
    for (int i = 0; i <= n; i++)
        c[i] = creal(z[i]);
}

START_TEST(both_inverted_positions_are_controllable)
{
    double a[16], b[4], condition;
    for (int top = 0; top < 2; top++) {
        pendubot(top, a, b);
        ck_assert_int_eq(mk_design_controllability(4, a, b, 0, &condition), 4);
        ck_assert(condition > 1.0 && condition < 1000.0);
    }
}
END_TEST

START_TEST(a_mode_out_of_reach_is_found_however_hidden)
{
    double re[8], im[8] = {0}, k[8];
    for (int i = 0; i < 8; i++)
        re[i] = -1 - i;
    srand(3);
    for (int n = 2; n <= MK_DESIGN_MAX; n++)
        for (int trial = 0; trial < 50; trial++) {
            double a[64], b[8], condition;
            struct mk_error err = MK_ERROR_INIT;
            random_unreachable(n, a, b);
            ck_assert_int_lt(mk_design_controllability(n, a, b, 1e-12, &condition), n);
            ck_assert_double_gt(condition, 1e12);
            ck_assert_int_eq(mk_design_place(n, a, b, re, im, k, &err), MK_ERR_NUMERIC);
            ck_assert_ptr_nonnull(strstr(err.message, "not controllable"));
            ck_assert_int_eq(mk_design_ackermann(n, a, b, re, im, k, &err), MK_ERR_NUMERIC);
        }
}
END_TEST

START_TEST(a_weak_motor_is_still_a_motor)
{
    struct mk_error err = MK_ERROR_INIT;
    double a[4] = {0, 1, 4, 0}, b[2] = {0, 1e-14}, re[2] = {-2, -3}, im[2] = {0}, k[2];
    ck_assert_int_eq(mk_design_controllability(2, a, b, 0, NULL), 2);
    ck_assert_int_eq(mk_design_place(2, a, b, re, im, k, &err), MK_OK);
    ck_assert_double_eq_tol(k[0] * 1e-14, 10.0, 1e-9);
    ck_assert_double_eq_tol(k[1] * 1e-14, 5.0, 1e-9);
}
END_TEST

START_TEST(the_report_s_gains_come_out_of_both_methods)
{
    /* (4.6), (4.7) to the digits of errata 4.3. */
    static const double want[2][4] = {{48.232, 5.250, 62.400, 7.858},
                                      {-61.270, -10.465, -62.400, -7.858}};
    double a[16], b[4], k[4], re[4] = {-10, -10, -10, -10}, im[4] = {0};
    struct mk_error err = MK_ERROR_INIT;
    for (int top = 0; top < 2; top++) {
        pendubot(top, a, b);
        ck_assert_int_eq(mk_design_ackermann(4, a, b, re, im, k, &err), MK_OK);
        for (int i = 0; i < 4; i++)
            ck_assert_double_eq_tol(k[i], want[top][i], 1e-3);
        ck_assert_int_eq(mk_design_place(4, a, b, re, im, k, &err), MK_OK);
        for (int i = 0; i < 4; i++)
            ck_assert_double_eq_tol(k[i], want[top][i], 1e-3);
    }
}
END_TEST

START_TEST(the_designers_poles_are_those_of_the_report)
{
    /* Gains (4.12), (4.14); poles of errata 4.4. */
    static const double gains[2][4] = {{122.61, 13.11, 152.29, 19.88},
                                       {-160.78, -26.92, -158.72, -20.81}};
    static const double real[2][4] = {{-80.59, -7.06, -4.55, -4.55},
                                      {-110.62, -6.42, -6.42, -2.95}};
    static const double imag[2][4] = {{0, 0, -6.22, 6.22}, {0, -2.08, 2.08, 0}};
    double a[16], b[4], re[4], im[4];
    struct mk_error err = MK_ERROR_INIT;
    for (int top = 0; top < 2; top++) {
        pendubot(top, a, b);
        ck_assert_int_eq(mk_design_poles(4, a, b, gains[top], re, im, &err), MK_OK);
        for (int i = 0; i < 4; i++) {
            ck_assert_double_eq_tol(re[i], real[top][i], 0.02);
            ck_assert_double_eq_tol(im[i], imag[top][i], 0.02);
        }
    }
}
END_TEST

START_TEST(the_report_s_rounded_gains_spread_the_fourfold_pole)
{
    /* (4.6), (4.7) as printed; errata 4.3 says how far they spread. */
    static const double gains[2][4] = {{48.23, 5.25, 62.4, 7.86}, {-61.3, -10.47, -62.4, -7.86}};
    double a[16], b[4], re[4], im[4];
    struct mk_error err = MK_ERROR_INIT;
    for (int top = 0; top < 2; top++) {
        pendubot(top, a, b);
        ck_assert_int_eq(mk_design_poles(4, a, b, gains[top], re, im, &err), MK_OK);
        for (int i = 0; i < 4; i++)
            ck_assert_double_lt(hypot(re[i] + 10, im[i]), 3.0);
        ck_assert_double_gt(hypot(re[0] + 10, im[0]), 0.5);
    }
}
END_TEST

START_TEST(reaction_wheel_poles_and_the_transient_free_gains)
{
    double p1 = 0.8544, p2 = 0.0045, p3 = 6.864, g = 9.80, w = sqrt(p3 * g / p1);
    double a[9] = {0, 1, 0, w * w, 0, 0, 0, 0, 0}, b[3] = {0, -1 / p1, 1 / p2}, re[3], im[3];
    struct mk_error err = MK_ERROR_INIT;
    double designers[3] = {-400, -35, -0.07};
    ck_assert_int_eq(mk_design_poles(3, a, b, designers, re, im, &err), MK_OK);
    ck_assert_double_eq_tol(re[0], -10.68, 0.01);
    ck_assert_double_eq_tol(fabs(im[0]), 13.75, 0.01);
    ck_assert_double_eq_tol(re[2], -4.04, 0.01);
    double ours[3] = {-400, -400 / w, -0.07}; /* k_pp = omega_p k_dp */
    ck_assert_int_eq(mk_design_poles(3, a, b, ours, re, im, &err), MK_OK);
    ck_assert_double_eq_tol(re[0], -22.1, 0.05);
    ck_assert_double_eq_tol(re[1], -w, 1e-6);
    ck_assert_double_eq_tol(re[2], -6.25, 0.01);
    double softer[3] = {-35 * w, -35, -0.07};
    ck_assert_double_eq_tol(softer[0], -310.6, 0.05);
    ck_assert_int_eq(mk_design_poles(3, a, b, softer, re, im, &err), MK_OK);
    ck_assert_double_eq_tol(re[0], -w, 1e-6);
    ck_assert_double_eq_tol(re[1], -8.27, 0.01);
    ck_assert_double_eq_tol(fabs(im[1]), 8.35, 0.01);
}
END_TEST

/* Poles in [-4, -1], every other trial in complex pairs. */
static void wanted_poles(int n, bool pairs, double *re, double *im)
{
    for (int i = 0; i < n; i++) {
        bool paired = pairs && i - i % 2 + 1 < n;
        re[i] = -1.0 - 0.4 * (paired ? i - i % 2 : i);
        im[i] = !paired ? 0.0 : i % 2 ? -1.5 : 1.5;
    }
}

START_TEST(placement_gives_the_wanted_characteristic_polynomial)
{
    struct mk_error err = MK_ERROR_INIT;
    srand(11);
    for (int n = 1; n <= MK_DESIGN_MAX; n++)
        for (int trial = 0; trial < 40; trial++) {
            double a[64], b[8], closed[64], k[8], re[8], im[8], got[9], want[9];
            random_system(n, a, b);
            wanted_poles(n, trial % 2, re, im);
            from_roots(n, re, im, want);
            ck_assert_int_eq(mk_design_place(n, a, b, re, im, k, &err), MK_OK);
            close_loop(n, a, b, k, closed);
            characteristic(n, closed, got);
            /* Large gains cost digits, here and in Ackermann's formula alike. */
            double loss = 1e-14 * pow(1 + largest(n * n, closed), 3) * largest(n + 1, want);
            for (int i = 0; i <= n; i++)
                ck_assert_msg(fabs(got[i] - want[i]) < loss, "n %d trial %d c%d %g %g (%g)", n,
                              trial, i, got[i], want[i], loss);
        }
}
END_TEST

START_TEST(ackermann_agrees_with_the_robust_method_on_small_systems)
{
    struct mk_error err = MK_ERROR_INIT;
    srand(12);
    for (int n = 1; n <= 5; n++)
        for (int trial = 0; trial < 40; trial++) {
            double a[64], b[8], k[8], other[8], re[8], im[8];
            random_system(n, a, b);
            wanted_poles(n, trial % 2, re, im);
            ck_assert_int_eq(mk_design_place(n, a, b, re, im, k, &err), MK_OK);
            ck_assert_int_eq(mk_design_ackermann(n, a, b, re, im, other, &err), MK_OK);
            for (int i = 0; i < n; i++)
                ck_assert_double_eq_tol(other[i], k[i], 1e-8 * (1 + largest(n, k)));
        }
}
END_TEST

START_TEST(poles_that_stay_where_they_are_need_no_gain)
{
    struct mk_error err = MK_ERROR_INIT;
    double a[16], b[4], k[4], re[4], im[4];
    for (int top = 0; top < 2; top++) {
        pendubot(top, a, b);
        ck_assert_int_eq(mk_design_poles(4, a, b, NULL, re, im, &err), MK_OK);
        ck_assert_int_eq(mk_design_place(4, a, b, re, im, k, &err), MK_OK);
        ck_assert_double_lt(largest(4, k), 1e-9);
    }
}
END_TEST

/* |A'P + PA - PBB'P/r + Q| relative to its largest term. */
static double riccati_residual(int n, const double *a, const double *b, const double *q, double r,
                               const double *p)
{
    double worst = 0.0, size = 0.0, pb[8] = {0};
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            pb[i] += p[i * n + j] * b[j];
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            double ap = 0, quadratic = pb[i] * pb[j] / r;
            for (int l = 0; l < n; l++)
                ap += a[l * n + i] * p[l * n + j] + p[i * n + l] * a[l * n + j];
            worst = fmax(worst, fabs(ap - quadratic + q[i * n + j]));
            size = fmax(size, fmax(fabs(quadratic), fabs(q[i * n + j])));
        }
    return worst / size;
}

/* |A'P(A - BK) + Q - P| relative to P: the equation with K = (r + B'PB)^-1 B'PA put in. */
static double discrete_residual(int n, const double *a, const double *b, const double *q,
                                const double *k, const double *p)
{
    double closed[81], at[81], pc[81], apc[81], worst = 0.0;
    close_loop(n, a, b, k, closed);
    for (int i = 0; i < n * n; i++)
        at[i] = a[i % n * n + i / n];
    multiply(n, p, closed, pc);
    multiply(n, at, pc, apc);
    for (int i = 0; i < n * n; i++)
        worst = fmax(worst, fabs(apc[i] + q[i] - p[i]));
    return worst / largest(n * n, p);
}

START_TEST(lqr_gains_are_those_of_scipy)
{
    static const double want[2][4] = {
        {79.98322121091094, 8.12722104022278, 97.55712353887064, 12.481022167777365},
        {-128.2066061614824, -21.272223189587873, -125.93050383352401, -16.141557783104073}};
    struct mk_error err = MK_ERROR_INIT;
    double a[16], b[4], k[4], p[16];
    for (int top = 0; top < 2; top++) {
        pendubot(top, a, b);
        ck_assert_int_eq(mk_design_lqr(4, a, b, weights, 0.5, k, p, &err), MK_OK);
        ck_assert_double_lt(riccati_residual(4, a, b, weights, 0.5, p), 1e-9);
        for (int i = 0; i < 4; i++)
            ck_assert_double_eq_tol(k[i], want[top][i], 1e-8 * fabs(want[top][i]));
    }
    /* Double integrator, Q = I, r = 1: K = [1, sqrt 3]. */
    double di[4] = {0, 1, 0, 0}, db[2] = {0, 1}, eye[4] = {1, 0, 0, 1};
    ck_assert_int_eq(mk_design_lqr(2, di, db, eye, 1.0, k, NULL, &err), MK_OK);
    ck_assert_double_eq_tol(k[0], 1.0, 1e-12);
    ck_assert_double_eq_tol(k[1], sqrt(3.0), 1e-12);
}
END_TEST

START_TEST(lqr_solves_its_riccati_equation_and_stabilises)
{
    struct mk_error err = MK_ERROR_INIT;
    srand(21);
    for (int n = 1; n <= MK_DESIGN_MAX; n++)
        for (int trial = 0; trial < 30; trial++) {
            double a[64], b[8], q[64], k[8], p[64], re[8], im[8], r = trial % 3 ? 1.0 : 0.01;
            random_system(n, a, b);
            random_weights(n, q);
            ck_assert_int_eq(mk_design_lqr(n, a, b, q, r, k, p, &err), MK_OK);
            ck_assert_double_lt(riccati_residual(n, a, b, q, r, p), 1e-7);
            ck_assert_int_eq(mk_design_poles(n, a, b, k, re, im, &err), MK_OK);
            ck_assert_double_lt(re[n - 1], 0.0);
        }
}
END_TEST

START_TEST(discretisation_is_exact_for_held_inputs)
{
    struct mk_error err = MK_ERROR_INIT;
    double a[4] = {0, 1, -4, 0}, b[2] = {0, 2}, ad[4], bd[2], h = 0.3; /* oscillator at 2 rad/s */
    ck_assert_int_eq(mk_design_c2d(2, a, b, h, ad, bd, &err), MK_OK);
    ck_assert_double_eq_tol(ad[0], cos(2 * h), 1e-14);
    ck_assert_double_eq_tol(ad[1], sin(2 * h) / 2, 1e-14);
    ck_assert_double_eq_tol(bd[0], (1 - cos(2 * h)) / 2, 1e-14);
    ck_assert_double_eq_tol(bd[1], sin(2 * h), 1e-14);
    double di[4] = {0, 1, 0, 0}; /* A singular: no formula with its inverse */
    ck_assert_int_eq(mk_design_c2d(2, di, b, h, ad, bd, &err), MK_OK);
    ck_assert_double_eq_tol(ad[1], h, 1e-15);
    ck_assert_double_eq_tol(bd[0], h * h, 1e-15);
    double fast[4] = {1e4, 0, 0, 1};
    ck_assert_int_eq(mk_design_c2d(2, fast, b, h, ad, bd, &err), MK_ERR_NUMERIC);
    ck_assert_int_eq(mk_design_c2d(2, a, b, 0.0, ad, bd, &err), MK_ERR_INVALID);
}
END_TEST

START_TEST(discrete_lqr_gains_are_those_of_scipy)
{
    static const double want[2][4] = {
        {75.85453521842545, 7.746015007860925, 92.86853699840621, 11.87121928801554},
        {-117.83554916526417, -19.604350645060983, -116.3949417640725, -14.9034511832164}};
    struct mk_error err = MK_ERROR_INIT;
    double a[16], b[4], ad[16], bd[4], k[4], p[16], one = 1.0;
    for (int top = 0; top < 2; top++) {
        pendubot(top, a, b);
        ck_assert_int_eq(mk_design_c2d(4, a, b, 0.002, ad, bd, &err), MK_OK);
        ck_assert_int_eq(mk_design_dlqr(4, ad, bd, weights, 0.5, k, p, &err), MK_OK);
        for (int i = 0; i < 4; i++)
            ck_assert_double_eq_tol(k[i], want[top][i], 1e-7 * fabs(want[top][i]));
    }
    /* x+ = x + u, q = r = 1: P is the golden ratio, K = 1/P. */
    ck_assert_int_eq(mk_design_dlqr(1, &one, &one, &one, 1.0, k, p, &err), MK_OK);
    ck_assert_double_eq_tol(p[0], (1 + sqrt(5.0)) / 2, 1e-14);
    ck_assert_double_eq_tol(k[0], 2 / (1 + sqrt(5.0)), 1e-14);
}
END_TEST

START_TEST(discrete_lqr_solves_its_riccati_equation_and_stabilises)
{
    struct mk_error err = MK_ERROR_INIT;
    srand(22);
    for (int n = 1; n <= MK_DESIGN_MAX; n++)
        for (int trial = 0; trial < 30; trial++) {
            double a[64], b[8], q[64], k[8], p[64], closed[64], re[8], im[8];
            random_system(n, a, b);
            for (int i = 0; i < n * n; i++)
                a[i] *= 0.5;
            random_weights(n, q);
            ck_assert_int_eq(mk_design_dlqr(n, a, b, q, 0.5, k, p, &err), MK_OK);
            ck_assert_double_lt(discrete_residual(n, a, b, q, k, p), 1e-7);
            close_loop(n, a, b, k, closed);
            ck_assert_int_eq(mk_design_poles(n, closed, b, NULL, re, im, &err), MK_OK);
            for (int i = 0; i < n; i++)
                ck_assert_double_lt(hypot(re[i], im[i]), 1.0);
        }
}
END_TEST

START_TEST(sampled_gains_are_those_of_scipy_with_and_without_delay)
{
    static const double want[2][4] = {
        {75.89129943875346, 7.749334621432492, 92.91015290943369, 11.876646160398113},
        {-117.985407554283, -19.628387791307166, -116.53226094960334, -14.921307153019285}};
    static const double late[2][5] = {{76.64640582897563, 7.901871886126176, 94.52955683789084,
                                       12.064081205158512, 0.11299631819411707},
                                      {-118.78140394224718, -19.86515619944454, -118.61056454056668,
                                       -15.156443509998455, 0.16764596255660005}};
    struct mk_error err = MK_ERROR_INIT;
    double a[16], b[4], k[5], p[25];
    for (int top = 0; top < 2; top++) {
        pendubot(top, a, b);
        ck_assert_int_eq(mk_design_lqrd(4, a, b, weights, 0.5, 0.002, 0, k, p, &err), MK_OK);
        for (int i = 0; i < 4; i++)
            ck_assert_double_eq_tol(k[i], want[top][i], 1e-7 * fabs(want[top][i]));
        ck_assert_int_eq(mk_design_lqrd(4, a, b, weights, 0.5, 0.002, 1, k, p, &err), MK_OK);
        for (int i = 0; i < 5; i++)
            ck_assert_double_eq_tol(k[i], late[top][i], 1e-7 * fabs(late[top][i]));
    }
}
END_TEST

START_TEST(fast_sampling_gives_the_continuous_gains)
{
    struct mk_error err = MK_ERROR_INIT;
    double a[16], b[4], k[4], sampled[4];
    pendubot(true, a, b);
    ck_assert_int_eq(mk_design_lqr(4, a, b, weights, 0.5, k, NULL, &err), MK_OK);
    ck_assert_int_eq(mk_design_lqrd(4, a, b, weights, 0.5, 1e-5, 0, sampled, NULL, &err), MK_OK);
    for (int i = 0; i < 4; i++)
        ck_assert_double_eq_tol(sampled[i], k[i], 2e-3 * fabs(k[i]));
}
END_TEST

START_TEST(a_loop_with_a_delay_is_stable_and_its_cost_is_the_promised_one)
{
    /* [x u]+ of the loop with K; P must be the sum of the costs of all samples to come. */
    struct mk_error err = MK_ERROR_INIT;
    double a[16], b[4], ad[16], bd[4], k[5], p[25], h = 0.002;
    pendubot(true, a, b);
    ck_assert_int_eq(mk_design_lqrd(4, a, b, weights, 0.5, h, 1, k, p, &err), MK_OK);
    ck_assert_int_eq(mk_design_c2d(4, a, b, h / 20, ad, bd, &err), MK_OK);
    double x[5] = {0.01, 0, -0.02, 0.1, 0.3}, promised = 0, cost = 0, start = fabs(x[0]);
    for (int i = 0; i < 25; i++)
        promised += x[i / 5] * p[i] * x[i % 5];
    for (int sample = 0; sample < 5000; sample++) {
        double next = 0;
        for (int i = 0; i < 5; i++)
            next -= k[i] * x[i];
        for (int fine = 0; fine < 20; fine++) {
            double y[4], rate[2];
            for (int i = 0; i < 4; i++) {
                y[i] = bd[i] * x[4];
                for (int j = 0; j < 4; j++)
                    y[i] += ad[i * 4 + j] * x[j];
            }
            rate[0] = 10 * (x[0] * x[0] + x[2] * x[2]) + x[1] * x[1] + x[3] * x[3];
            rate[1] = 10 * (y[0] * y[0] + y[2] * y[2]) + y[1] * y[1] + y[3] * y[3];
            cost += h / 20 * (0.5 * (rate[0] + rate[1]) + 0.5 * x[4] * x[4]);
            memcpy(x, y, sizeof y);
        }
        x[4] = next;
    }
    ck_assert_double_lt(fabs(x[0]), 1e-6 * start);
    ck_assert_double_eq_tol(cost, promised, 1e-5 * promised);
}
END_TEST

START_TEST(the_largest_system_may_have_a_delay)
{
    struct mk_error err = MK_ERROR_INIT;
    double a[64], b[8], q[64], k[9], p[81];
    srand(23);
    random_system(8, a, b);
    random_weights(8, q);
    ck_assert_int_eq(mk_design_lqrd(8, a, b, q, 1.0, 0.002, 1, k, p, &err), MK_OK);
    ck_assert_int_eq(mk_design_lqrd(8, a, b, q, 1.0, 0.002, 2, k, p, &err), MK_ERR_INVALID);
}
END_TEST

START_TEST(lyapunov_solutions_satisfy_their_equation)
{
    struct mk_error err = MK_ERROR_INIT;
    srand(31);
    for (int n = 1; n <= MK_DESIGN_MAX; n++)
        for (int trial = 0; trial < 20; trial++) {
            double a[64], b[8], none[8] = {0}, q[64], p[64];
            random_system(n, a, b);
            for (int i = 0; i < n; i++)
                a[i * n + i] -= 3.0 * n; /* Gershgorin: stable */
            random_weights(n, q);
            ck_assert_int_eq(mk_design_lyapunov(n, a, q, p, &err), MK_OK);
            ck_assert_double_lt(riccati_residual(n, a, none, q, 1.0, p), 1e-12);
        }
}
END_TEST

START_TEST(lyapunov_refuses_what_does_not_decay)
{
    struct mk_error err = MK_ERROR_INIT;
    double q[4] = {2, 0, 0, 4}, p[4], skew[4] = {1, 1, 0, 1}, stable[4] = {-1, 2, 0, -3};
    double unstable[4] = {1, 0, 0, -1}, marginal[4] = {0, 1, 0, -1}, opposite[4] = {2, 0, 0, -2};
    ck_assert_int_eq(mk_design_lyapunov(2, unstable, q, p, &err), MK_ERR_NUMERIC);
    ck_assert_int_eq(mk_design_lyapunov(2, marginal, q, p, &err), MK_ERR_NUMERIC);
    ck_assert_int_eq(mk_design_lyapunov(2, opposite, q, p, &err), MK_ERR_NUMERIC);
    ck_assert_int_eq(mk_design_lyapunov(2, stable, skew, p, &err), MK_ERR_INVALID);
    q[0] = NAN;
    ck_assert_int_eq(mk_design_lyapunov(2, stable, q, p, &err), MK_ERR_INVALID);
}
END_TEST

START_TEST(optimal_feedback_that_does_not_exist_is_refused_with_the_mode)
{
    struct mk_error err = MK_ERROR_INIT;
    double k[2], eye[4] = {1, 0, 0, 1}, none[4] = {0}, b[2] = {1, 0}, push[2] = {0, 1};
    double grows[4] = {-1, 0, 0, 2}, drifts[4] = {0, 1, 0, 0}, drifts_d[4] = {1, 0.01, 0, 1};
    ck_assert_int_eq(mk_design_lqr(2, grows, b, eye, 1.0, k, NULL, &err), MK_ERR_NUMERIC);
    ck_assert_ptr_nonnull(strstr(err.message, "B does not reach the mode at 2"));
    ck_assert_int_eq(mk_design_dlqr(2, grows, b, eye, 1.0, k, NULL, &err), MK_ERR_NUMERIC);
    ck_assert_int_eq(mk_design_lqr(2, drifts, push, none, 1.0, k, NULL, &err), MK_ERR_NUMERIC);
    ck_assert_ptr_nonnull(strstr(err.message, "Q does not see the mode at 0"));
    ck_assert_int_eq(mk_design_dlqr(2, drifts_d, push, none, 1.0, k, NULL, &err), MK_ERR_NUMERIC);
    /* Out of reach but decaying: the rest is still optimised. */
    double decays[4] = {1, 0, 0, -1};
    ck_assert_int_eq(mk_design_lqr(2, decays, b, eye, 1.0, k, NULL, &err), MK_OK);
    ck_assert_double_eq_tol(k[0], 1 + sqrt(2.0), 1e-12);
    ck_assert_double_eq_tol(k[1], 0.0, 1e-12);
    /* Unseen but growing: mirrored into the left half plane at the least cost. */
    ck_assert_int_eq(mk_design_lqr(1, (double[]){3.0}, b, none, 1.0, k, NULL, &err), MK_OK);
    ck_assert_double_eq_tol(k[0], 6.0, 1e-12);
}
END_TEST

START_TEST(designs_that_cannot_be_are_refused_with_a_reason)
{
    struct mk_error err = MK_ERROR_INIT;
    double a[4] = {1, 0, 0, 2}, b[2] = {1, 0}, re[2] = {-1, -2}, im[2] = {0, 0}, k[2];
    ck_assert_int_eq(mk_design_place(2, a, b, re, im, k, &err), MK_ERR_NUMERIC);
    ck_assert_ptr_nonnull(strstr(err.message, "controllable"));
    ck_assert_int_eq(mk_design_ackermann(2, a, b, re, im, k, &err), MK_ERR_NUMERIC);
    im[0] = 1.0;
    ck_assert_int_eq(mk_design_place(2, a, b, re, im, k, &err), MK_ERR_INVALID);
    double q[4] = {1, 0, 0, 1}, p[4], bad[4] = {NAN, 0, 0, 0}, minus[4] = {-1, 0, 0, 1};
    ck_assert_int_eq(mk_design_lqr(2, a, b, q, 1.0, k, p, &err), MK_ERR_NUMERIC);
    ck_assert_int_eq(mk_design_lqr(2, bad, b, q, 1.0, k, p, &err), MK_ERR_INVALID);
    ck_assert_int_eq(mk_design_lqr(2, a, b, minus, 1.0, k, p, &err), MK_ERR_INVALID);
    ck_assert_int_eq(mk_design_lqr(2, a, b, q, 0.0, k, p, &err), MK_ERR_INVALID);
    ck_assert_int_eq(mk_design_lqr(9, a, b, q, 1.0, k, p, &err), MK_ERR_INVALID);
}
END_TEST

Suite *suite_design(void)
{
    Suite *s = suite_create("design");
    TCase *t = tcase_create("gains");
    tcase_set_timeout(t, 20);
    tcase_add_test(t, both_inverted_positions_are_controllable);
    tcase_add_test(t, a_mode_out_of_reach_is_found_however_hidden);
    tcase_add_test(t, a_weak_motor_is_still_a_motor);
    tcase_add_test(t, the_report_s_gains_come_out_of_both_methods);
    tcase_add_test(t, the_designers_poles_are_those_of_the_report);
    tcase_add_test(t, the_report_s_rounded_gains_spread_the_fourfold_pole);
    tcase_add_test(t, reaction_wheel_poles_and_the_transient_free_gains);
    tcase_add_test(t, placement_gives_the_wanted_characteristic_polynomial);
    tcase_add_test(t, ackermann_agrees_with_the_robust_method_on_small_systems);
    tcase_add_test(t, poles_that_stay_where_they_are_need_no_gain);
    tcase_add_test(t, lqr_gains_are_those_of_scipy);
    tcase_add_test(t, lqr_solves_its_riccati_equation_and_stabilises);
    tcase_add_test(t, discretisation_is_exact_for_held_inputs);
    tcase_add_test(t, discrete_lqr_gains_are_those_of_scipy);
    tcase_add_test(t, discrete_lqr_solves_its_riccati_equation_and_stabilises);
    tcase_add_test(t, sampled_gains_are_those_of_scipy_with_and_without_delay);
    tcase_add_test(t, fast_sampling_gives_the_continuous_gains);
    tcase_add_test(t, a_loop_with_a_delay_is_stable_and_its_cost_is_the_promised_one);
    tcase_add_test(t, the_largest_system_may_have_a_delay);
    tcase_add_test(t, lyapunov_solutions_satisfy_their_equation);
    tcase_add_test(t, lyapunov_refuses_what_does_not_decay);
    tcase_add_test(t, optimal_feedback_that_does_not_exist_is_refused_with_the_mode);
    tcase_add_test(t, designs_that_cannot_be_are_refused_with_a_reason);
    suite_add_tcase(s, t);
    return s;
}
