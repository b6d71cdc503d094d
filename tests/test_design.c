/* Gain design against the report's numbers and against the equations the results must satisfy. */
#include "suites.h"

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

static double uniform(void)
{
    return 2.0 * rand() / RAND_MAX - 1.0;
}

START_TEST(both_inverted_positions_are_controllable)
{
    double a[16], b[4], condition;
    for (int top = 0; top < 2; top++) {
        pendubot(top, a, b);
        ck_assert_int_eq(mk_design_controllability(4, a, b, 0, &condition), 4);
        ck_assert(condition > 1.0 && isfinite(condition));
    }
    double apart[4] = {-1, 0, 0, -2}, first[2] = {1, 0};
    ck_assert_int_eq(mk_design_controllability(2, apart, first, 0, NULL), 1);
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
    static const double gains[2][4] = {{122.61, 13.11, 152.29, 19.88},
                                       {-160.78, -26.92, -158.72, -20.81}};
    static const double real[2][4] = {{-80.59, -7.06, -4.55, -4.55},
                                      {-110.62, -6.42, -6.42, -2.95}};
    double a[16], b[4], re[4], im[4];
    struct mk_error err = MK_ERROR_INIT;
    for (int top = 0; top < 2; top++) {
        pendubot(top, a, b);
        ck_assert_int_eq(mk_design_poles(4, a, b, gains[top], re, im, &err), MK_OK);
        for (int i = 0; i < 4; i++)
            ck_assert_double_eq_tol(re[i], real[top][i], 0.02);
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
}
END_TEST

START_TEST(placed_poles_are_where_they_should_be)
{
    srand(11);
    struct mk_error err = MK_ERROR_INIT;
    for (int n = 1; n <= MK_DESIGN_MAX; n++)
        for (int trial = 0; trial < 20; trial++) {
            double a[64], b[8], k[8], re[8], im[8], got_re[8], got_im[8];
            for (int i = 0; i < n * n; i++)
                a[i] = 3 * uniform();
            for (int i = 0; i < n; i++)
                b[i] = uniform();
            for (int i = 0; i < n; i += 2) {
                bool pair = i + 1 < n && trial % 2;
                re[i] = -1.0 - 0.7 * i, im[i] = pair ? 1.5 : 0.0;
                if (i + 1 < n)
                    re[i + 1] = pair ? re[i] : re[i] - 0.35, im[i + 1] = -im[i];
            }
            ck_assert_int_eq(mk_design_place(n, a, b, re, im, k, &err), MK_OK);
            ck_assert_int_eq(mk_design_poles(n, a, b, k, got_re, got_im, &err), MK_OK);
            for (int i = 0; i < n; i++) {
                double best = INFINITY;
                for (int j = 0; j < n; j++)
                    best = fmin(best, hypot(got_re[j] - re[i], got_im[j] - im[i]));
                ck_assert_double_lt(best, 1e-5 * (1 + n * n));
            }
        }
}
END_TEST

/* |A'P + PA - PBB'P/r + Q| */
static double riccati_residual(int n, const double *a, const double *b, const double *q, double r,
                               const double *p)
{
    double worst = 0.0, pb[8] = {0};
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            pb[i] += p[i * n + j] * b[j];
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            double sum = q[i * n + j] - pb[i] * pb[j] / r;
            for (int l = 0; l < n; l++)
                sum += a[l * n + i] * p[l * n + j] + p[i * n + l] * a[l * n + j];
            worst = fmax(worst, fabs(sum));
        }
    return worst;
}

START_TEST(lqr_solves_its_riccati_equation)
{
    struct mk_error err = MK_ERROR_INIT;
    /* Double integrator, Q = I, r = 1: K = [1, sqrt 3]. */
    double di[4] = {0, 1, 0, 0}, db[2] = {0, 1}, eye[4] = {1, 0, 0, 1}, k[4], p[16];
    ck_assert_int_eq(mk_design_lqr(2, di, db, eye, 1.0, k, p, &err), MK_OK);
    ck_assert_double_eq_tol(k[0], 1.0, 1e-12);
    ck_assert_double_eq_tol(k[1], sqrt(3.0), 1e-12);
    for (int top = 0; top < 2; top++) {
        double a[16], b[4], q[16] = {0}, re[4], im[4];
        pendubot(top, a, b);
        q[0] = q[10] = 10, q[5] = q[15] = 1;
        ck_assert_int_eq(mk_design_lqr(4, a, b, q, 0.5, k, p, &err), MK_OK);
        double size = 0;
        for (int i = 0; i < 16; i++)
            size = fmax(size, fabs(p[i]));
        ck_assert_double_lt(riccati_residual(4, a, b, q, 0.5, p), 1e-8 * size * size);
        ck_assert_int_eq(mk_design_poles(4, a, b, k, re, im, &err), MK_OK);
        ck_assert_double_lt(re[3], 0.0);
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
}
END_TEST

START_TEST(discrete_lqr_is_a_fixed_point_and_tends_to_the_continuous_one)
{
    struct mk_error err = MK_ERROR_INIT;
    double a[16], b[4], q[16] = {0}, k[5], kd[5], p[25];
    pendubot(true, a, b);
    q[0] = q[10] = 10, q[5] = q[15] = 1;
    ck_assert_int_eq(mk_design_lqr(4, a, b, q, 0.5, k, p, &err), MK_OK);
    ck_assert_int_eq(mk_design_lqrd(4, a, b, q, 0.5, 1e-5, 0, kd, p, &err), MK_OK);
    for (int i = 0; i < 4; i++)
        ck_assert_double_eq_tol(kd[i], k[i], 2e-3 * fabs(k[i]));
    /* One sample of delay: the gains look ahead, the loop with the delay is stable. */
    double ad[16], bd[4], closed[25] = {0}, h = 0.002;
    ck_assert_int_eq(mk_design_lqrd(4, a, b, q, 0.5, h, 1, kd, p, &err), MK_OK);
    ck_assert_int_eq(mk_design_c2d(4, a, b, h, ad, bd, &err), MK_OK);
    for (int i = 0; i < 4; i++) {
        memcpy(&closed[i * 5], &ad[i * 4], 4 * sizeof *ad);
        closed[i * 5 + 4] = bd[i];
    }
    for (int j = 0; j < 5; j++)
        closed[20 + j] = -kd[j];
    double re[5], im[5];
    ck_assert_int_eq(mk_design_poles(5, closed, closed, NULL, re, im, &err), MK_OK);
    for (int i = 0; i < 5; i++)
        ck_assert_double_lt(hypot(re[i], im[i]), 1.0);
}
END_TEST

START_TEST(lyapunov_solutions_satisfy_their_equation)
{
    struct mk_error err = MK_ERROR_INIT;
    double a[4] = {-1, 2, 0, -3}, q[4] = {2, 0, 0, 4}, p[4];
    ck_assert_int_eq(mk_design_lyapunov(2, a, q, p, &err), MK_OK);
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2; j++) {
            double sum = q[i * 2 + j];
            for (int l = 0; l < 2; l++)
                sum += a[l * 2 + i] * p[l * 2 + j] + p[i * 2 + l] * a[l * 2 + j];
            ck_assert_double_eq_tol(sum, 0.0, 1e-12);
        }
    double unstable[4] = {1, 0, 0, -1};
    ck_assert_int_eq(mk_design_lyapunov(2, unstable, q, p, &err), MK_ERR_NUMERIC);
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
    tcase_add_test(t, both_inverted_positions_are_controllable);
    tcase_add_test(t, the_report_s_gains_come_out_of_both_methods);
    tcase_add_test(t, the_designers_poles_are_those_of_the_report);
    tcase_add_test(t, reaction_wheel_poles_and_the_transient_free_gains);
    tcase_add_test(t, placed_poles_are_where_they_should_be);
    tcase_add_test(t, lqr_solves_its_riccati_equation);
    tcase_add_test(t, discretisation_is_exact_for_held_inputs);
    tcase_add_test(t, discrete_lqr_is_a_fixed_point_and_tends_to_the_continuous_one);
    tcase_add_test(t, lyapunov_solutions_satisfy_their_equation);
    tcase_add_test(t, designs_that_cannot_be_are_refused_with_a_reason);
    suite_add_tcase(s, t);
    return s;
}
