/* Speed estimates from quantised angles: lag, noise, gaps, and the comparison of the three. */
#include "suites.h"

#include <math.h>
#include <stdbool.h>

#include "mechkit/velocity.h"

#define DT 0.002                /* 500 Hz */
#define COUNT (2 * M_PI / 4000) /* 4000 counts a turn */

static double quantised(double q)
{
    return floor(q / COUNT + 0.5) * COUNT;
}

/* `tune` is the bandwidth [Hz]; for the Kalman filter the usual acceleration [rad/s^2]. */
static struct mk_velocity estimator(enum mk_velocity_kind kind, double tune)
{
    bool kalman = kind == MK_VELOCITY_KALMAN;
    struct mk_velocity_config c = {kind, DT, kalman ? 0.0 : tune, COUNT, kalman ? tune : 1.0};
    struct mk_velocity est;
    ck_assert_int_eq(mk_velocity_init(&est, &c), MK_OK);
    return est;
}

/* rms of the speed on a swing of 1 rad at `hz`: `noise` is what rounding to counts adds (the
 * estimators are linear), `error` is everything, lag as well. */
static void swing(enum mk_velocity_kind kind, double tune, double hz, double *noise, double *error)
{
    struct mk_velocity rounded = estimator(kind, tune), exact = rounded;
    double w = 2 * M_PI * hz, noise2 = 0, error2 = 0;
    int n = 0;
    for (int k = 0; k < 4000; k++) {
        double q = sin(w * k * DT), v = mk_velocity_step(&rounded, quantised(q));
        double clean = mk_velocity_step(&exact, q);
        if (k * DT < 2.0)
            continue;
        noise2 += pow(v - clean, 2);
        error2 += pow(v - w * cos(w * k * DT), 2);
        n++;
    }
    *noise = sqrt(noise2 / n);
    *error = sqrt(error2 / n);
}

/* The error when tuned for this much noise, which grows with `tune`. */
static double error_at_noise(enum mk_velocity_kind kind, double hz, double wanted)
{
    bool kalman = kind == MK_VELOCITY_KALMAN;
    double low = kalman ? 1e-2 : 0.5, high = kalman ? 1e4 : 200, noise, error;
    for (int i = 0; i < 40; i++) {
        double middle = sqrt(low * high);
        swing(kind, middle, hz, &noise, &error);
        *(noise < wanted ? &low : &high) = middle;
    }
    ck_assert_double_eq_tol(noise, wanted, 0.02 * wanted);
    return error;
}

START_TEST(observers_beat_the_report_s_filter_at_equal_noise)
{
    static const double noises[] = {0.02, 0.04, 0.08}; /* rad/s rms */
    for (double hz = 1; hz <= 2; hz++)
        for (int i = 0; i < 3; i++) {
            double filter = error_at_noise(MK_VELOCITY_FILTER, hz, noises[i]);
            double tracking = error_at_noise(MK_VELOCITY_TRACKING, hz, noises[i]);
            double kalman = error_at_noise(MK_VELOCITY_KALMAN, hz, noises[i]);
            ck_assert_msg(tracking < 0.85 * filter, "%g %g", tracking, filter);
            ck_assert_msg(kalman < 0.5 * filter, "%g %g", kalman, filter);
            ck_assert_msg(kalman < tracking, "%g %g", kalman, tracking);
        }
}
END_TEST

START_TEST(observers_beat_the_filter_at_its_best)
{
    double filter = INFINITY, tracking = INFINITY, noise, error;
    for (double f = 2; f < 120; f *= 1.2) {
        swing(MK_VELOCITY_FILTER, f, 1.0, &noise, &error);
        filter = fmin(filter, error);
        swing(MK_VELOCITY_TRACKING, f, 1.0, &noise, &error);
        tracking = fmin(tracking, error);
    }
    swing(MK_VELOCITY_KALMAN, 40.0, 1.0, &noise, &error);
    ck_assert_msg(tracking < 0.95 * filter, "%g %g", tracking, filter);
    ck_assert_msg(error < 0.6 * filter, "%g %g", error, filter);
}
END_TEST

START_TEST(the_lag_behind_an_accelerating_joint_is_the_one_of_theory)
{
    /* Lag in seconds on q = a t^2 / 2; the difference quotient itself lags by half a sample. */
    double hz = 20, a = 30, z = exp(-2 * M_PI * hz * DT);
    double lag[MK_VELOCITY_COUNT] = {DT * z / (1 - z) + DT / 2, DT * (1 + z) / (1 - z) - DT / 2, 0};
    for (int kind = 0; kind < MK_VELOCITY_COUNT; kind++) {
        struct mk_velocity est = estimator((enum mk_velocity_kind)kind, hz);
        double v = 0;
        for (int k = 0; k <= 2000; k++)
            v = mk_velocity_step(&est, 0.5 * a * pow(k * DT, 2));
        ck_assert_double_eq_tol((a * 2000 * DT - v) / a, lag[kind], 1e-7);
    }
}
END_TEST

START_TEST(the_kalman_filter_forgets_a_wrong_start)
{
    struct mk_velocity est = estimator(MK_VELOCITY_KALMAN, 40.0);
    est.primed = 1, est.q = 1, est.v = 10, est.a = 100;
    for (int k = 0; k < 1000; k++)
        mk_velocity_step(&est, 0.0);
    ck_assert_double_lt(fabs(est.q) + fabs(est.v) + fabs(est.a), 1e-9);
}
END_TEST

START_TEST(a_ramp_is_followed_without_error_also_across_gaps)
{
    for (int kind = 0; kind < MK_VELOCITY_COUNT; kind++) {
        struct mk_velocity est = estimator((enum mk_velocity_kind)kind, 20.0);
        for (int k = 0; k < 3000; k++) {
            double q = 5.0 * k * DT;
            bool dropped = k > 500 && k % 50 < 7;
            double v = mk_velocity_step(&est, dropped ? (double)NAN : q);
            ck_assert_double_eq(v, est.v);
            if (k < 1000)
                continue;
            ck_assert_double_eq_tol(v, 5.0, 1e-6);
            ck_assert_double_eq_tol(est.q, q, 1e-6);
        }
    }
}
END_TEST

START_TEST(rounding_leaves_bounded_noise_on_a_joint_at_rest)
{
    /* Flicker between two counts, as of a joint that rests on an edge. */
    for (int kind = 0; kind < MK_VELOCITY_COUNT; kind++) {
        struct mk_velocity est = estimator((enum mk_velocity_kind)kind, 20.0);
        double worst = 0;
        for (int k = 0; k < 2000; k++) {
            double v = mk_velocity_step(&est, k % 2 ? COUNT : 0.0);
            if (k > 1000)
                worst = fmax(worst, fabs(v));
        }
        ck_assert_double_lt(worst, 0.25 * COUNT / DT);
        ck_assert_double_eq_tol(est.q, COUNT / 2, COUNT);
    }
}
END_TEST

START_TEST(nothing_is_estimated_before_the_first_reading_nor_kept_by_a_reset)
{
    for (int kind = 0; kind < MK_VELOCITY_COUNT; kind++) {
        struct mk_velocity est = estimator((enum mk_velocity_kind)kind, 20.0);
        ck_assert_double_eq(mk_velocity_step(&est, NAN), 0.0);
        ck_assert_double_eq(mk_velocity_step(&est, -1.5), 0.0);
        ck_assert_double_eq(est.q, -1.5);
        struct mk_velocity fresh = estimator((enum mk_velocity_kind)kind, 20.0);
        for (int k = 0; k < 100; k++)
            mk_velocity_step(&est, 0.1 * k * k);
        mk_velocity_reset(&est);
        for (int k = 0; k < 100; k++)
            ck_assert_double_eq(mk_velocity_step(&est, sin(0.1 * k)),
                                mk_velocity_step(&fresh, sin(0.1 * k)));
    }
}
END_TEST

START_TEST(estimators_have_names)
{
    for (int kind = 0; kind < MK_VELOCITY_COUNT; kind++)
        ck_assert_int_eq(mk_velocity_by_name(mk_velocity_name((enum mk_velocity_kind)kind)), kind);
    ck_assert_int_eq(mk_velocity_by_name("wishful"), MK_VELOCITY_COUNT);
}
END_TEST

START_TEST(speed_settings_that_make_no_sense_are_refused)
{
    struct mk_velocity est;
    struct mk_velocity_config good = {MK_VELOCITY_KALMAN, DT, 20, COUNT, 40.0}, c;
    double bad[] = {0.0, -1.0, NAN, INFINITY};
    ck_assert_int_eq(mk_velocity_init(&est, &good), MK_OK);
    for (int i = 0; i < 4; i++) {
        c = good, c.dt_s = bad[i];
        ck_assert_int_eq(mk_velocity_init(&est, &c), MK_ERR_RANGE);
        c = good, c.count_rad = bad[i];
        ck_assert_int_eq(mk_velocity_init(&est, &c), MK_ERR_RANGE);
        c = good, c.accel_radps2 = bad[i];
        ck_assert_int_eq(mk_velocity_init(&est, &c), MK_ERR_RANGE);
        c = good, c.bandwidth_hz = bad[i];
        ck_assert_int_eq(mk_velocity_init(&est, &c), i == 0 ? MK_OK : MK_ERR_RANGE);
    }
    c = good, c.kind = MK_VELOCITY_COUNT;
    ck_assert_int_eq(mk_velocity_init(&est, &c), MK_ERR_INVALID);
}
END_TEST

Suite *suite_velocity(void)
{
    Suite *s = suite_create("velocity");
    TCase *t = tcase_create("estimators");
    tcase_set_timeout(t, 20);
    tcase_add_test(t, observers_beat_the_report_s_filter_at_equal_noise);
    tcase_add_test(t, observers_beat_the_filter_at_its_best);
    tcase_add_test(t, the_lag_behind_an_accelerating_joint_is_the_one_of_theory);
    tcase_add_test(t, the_kalman_filter_forgets_a_wrong_start);
    tcase_add_test(t, a_ramp_is_followed_without_error_also_across_gaps);
    tcase_add_test(t, rounding_leaves_bounded_noise_on_a_joint_at_rest);
    tcase_add_test(t, nothing_is_estimated_before_the_first_reading_nor_kept_by_a_reset);
    tcase_add_test(t, estimators_have_names);
    tcase_add_test(t, speed_settings_that_make_no_sense_are_refused);
    suite_add_tcase(s, t);
    return s;
}
