/* Signals and speed estimates. */
#include "suites.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mechkit/signal.h"
#include "mechkit/velocity.h"
#include "support/files.h"

static double value(const char *text, double t)
{
    struct mk_signal *s;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_signal_create(text, &s, &err) == MK_OK, "%s: %s", text, err.message);
    ck_assert_str_eq(mk_signal_text(s), text);
    double x = mk_signal_at(s, t);
    mk_signal_destroy(s);
    return x;
}

START_TEST(expressions_mean_what_mathematics_means)
{
    double t = 0.37;
    struct {
        const char *text;
        double want;
    } cases[] = {{"1.5*sin(6*t)", 1.5 * sin(6 * t)},
                 {"2.5*sin(t) - cos(4*t)", 2.5 * sin(t) - cos(4 * t)},
                 {"-2^2", -4},
                 {"2^3^2", 512},
                 {"2^-1", 0.5},
                 {"1 - 2 - 3", -4},
                 {"12/3/2", 2},
                 {"1 + 2*3", 7},
                 {"(1 + 2)*3", 9},
                 {"--3", 3},
                 {"+pi", M_PI},
                 {"1e-3*t", 1e-3 * t},
                 {"min(1, max(t, 2))", 1},
                 {"abs(-t) + sign(-t)", t - 1},
                 {"exp(log(3)) + sqrt(4) + tan(t) + tanh(t)", 5 + tan(t) + tanh(t)},
                 {"step(0.3) + 10*step(0.4)", 1},
                 {"ramp(0.07)", 0.3},
                 {"pulse(0.3, 0.4) + pulse(0.1, 0.3)", 1},
                 {"square(1)", 1},
                 {"square(1.5)", -1},
                 {"saw(1)", 2 * 0.37 - 1}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        ck_assert_msg(fabs(value(cases[i].text, t) - cases[i].want) < 1e-12, "%s", cases[i].text);
}
END_TEST

START_TEST(a_chirp_sweeps_its_frequency_and_stays)
{
    for (double t = 0; t < 8; t += 0.01) {
        double cycles = t < 5 ? t + 0.5 * 3 * t * t / 5 : 5 + 7.5 + 4 * (t - 5);
        ck_assert_double_eq_tol(value("chirp(1, 4, 5)", t), sin(2 * M_PI * cycles), 1e-9);
    }
}
END_TEST

START_TEST(a_multisine_is_periodic_flat_and_bounded)
{
    double peak = 0, power = 0, cosine[12] = {0}, sine[12] = {0};
    int n = 2000;
    for (int i = 0; i < n; i++) {
        double t = i * 4.0 / n, x = value("multisine(0.25, 8, 3)", t);
        ck_assert_double_eq_tol(value("multisine(0.25, 8, 3)", t + 4.0), x, 1e-9);
        peak = fmax(peak, fabs(x));
        power += x * x / n;
        for (int k = 0; k < 12; k++) {
            cosine[k] += x * cos(2 * M_PI * 0.25 * k * t) * 2 / n;
            sine[k] += x * sin(2 * M_PI * 0.25 * k * t) * 2 / n;
        }
    }
    double first = hypot(cosine[1], sine[1]);
    for (int k = 2; k <= 8; k++)
        ck_assert_double_eq_tol(hypot(cosine[k], sine[k]), first, 1e-9);
    ck_assert_double_lt(hypot(cosine[9], sine[9]), 1e-9);
    ck_assert(peak < 1.6 && peak > 0.8 && power > 0.2);
    ck_assert_double_ne(value("multisine(0.25, 8, 4)", 1.0), value("multisine(0.25, 8, 3)", 1.0));
}
END_TEST

START_TEST(noise_is_repeatable_bounded_and_continuous)
{
    double before = value("noise(5, 1)", 0), lowest = 0, highest = 0;
    for (double t = 0.001; t < 5; t += 0.001) {
        double x = value("noise(5, 1)", t);
        ck_assert_double_lt(fabs(x - before), 0.05);
        lowest = fmin(lowest, x), highest = fmax(highest, x);
        before = x;
    }
    ck_assert(lowest < -0.5 && highest > 0.5 && lowest >= -1 && highest <= 1);
    ck_assert_double_eq(value("noise(5, 1)", 1.234), value("noise(5, 1)", 1.234));
}
END_TEST

START_TEST(mistakes_are_refused_at_their_character)
{
    struct {
        const char *text;
        int column;
    } cases[] = {{"", 1},      {"1 +", 4},      {"1.5 sin(t)", 5}, {"foo(1)", 1}, {"1 + x", 5},
                 {"sin()", 1}, {"sin(1,2)", 1}, {"(1", 3},         {"1)", 2},     {"2 ** 3", 4},
                 {"1..2", 1},  {"sin t", 1},    {"chirp(1,2)", 1}, {"t t", 3},    {"#", 1}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct mk_signal *s;
        struct mk_error err = MK_ERROR_INIT;
        ck_assert_msg(mk_signal_create(cases[i].text, &s, &err) == MK_ERR_PARSE, "%s",
                      cases[i].text);
        ck_assert_msg(err.column == cases[i].column, "%s: %d: %s", cases[i].text, err.column,
                      err.message);
        ck_assert_ptr_null(s);
    }
}
END_TEST

START_TEST(deep_nesting_and_random_text_do_no_harm)
{
    char text[5000];
    struct mk_signal *s;
    struct mk_error err = MK_ERROR_INIT;
    memset(text, '(', 4999);
    text[4999] = 0;
    ck_assert_int_eq(mk_signal_create(text, &s, &err), MK_ERR_PARSE);
    memset(text, '-', 4999);
    ck_assert_int_eq(mk_signal_create(text, &s, &err), MK_ERR_PARSE);
    text[0] = 0;
    for (int i = 0; i < 600; i++)
        strcat(text, "1+");
    strcat(text, "1");
    ck_assert_int_eq(mk_signal_create(text, &s, &err), MK_ERR_PARSE);
    static const char alphabet[] = "0123456789.+-*/^()t,sincoexp @e";
    srand(5);
    for (int i = 0; i < 20000; i++) {
        int n = rand() % 24;
        for (int k = 0; k < n; k++)
            text[k] = alphabet[1 + rand() % (int)(sizeof alphabet - 2)];
        text[n] = 0;
        if (text[strspn(text, " ")] != '@' && mk_signal_create(text, &s, NULL) == MK_OK) {
            (void)mk_signal_at(s, 0.5);
            mk_signal_destroy(s);
        }
    }
}
END_TEST

START_TEST(a_sampled_signal_holds_its_values_and_ends_in_zero)
{
    char text[300];
    struct mk_error err = MK_ERROR_INIT;
    struct mk_signal *s;
    snprintf(text, sizeof text, "@%s", scratch_text("u.csv", "t,u\n0,1\n0.1,-2\n0.3,4\n"));
    double at[] = {-0.1, 0, 0.0999, 0.1, 0.2999, 0.3, 0.31}, want[] = {0, 1, 1, -2, -2, 4, 0};
    for (int i = 0; i < 7; i++)
        ck_assert_double_eq(value(text, at[i]), want[i]);
    ck_assert_int_eq(mk_signal_create(text, &s, &err), MK_OK);
    ck_assert_double_eq(mk_signal_duration(s), 0.3);
    mk_signal_destroy(s);
    snprintf(text, sizeof text, "@%s", scratch_text("v.csv", "t,v\n0,1\n"));
    ck_assert_int_eq(mk_signal_create(text, &s, &err), MK_ERR_PARSE);
    ck_assert_int_eq(mk_signal_create("@/no/such/file", &s, &err), MK_ERR_NOTFOUND);
}
END_TEST

/* --- speed ------------------------------------------------------------------------------- */

#define COUNT (2 * M_PI / 4000)

static double quantised(double q)
{
    return floor(q / COUNT + 0.5) * COUNT;
}

/* rms speed error on a swing of 1 rad at 1 Hz, 500 Hz, 4000 counts. */
static double rms_error(enum mk_velocity_kind kind, double bandwidth)
{
    struct mk_velocity est;
    struct mk_velocity_config c = {kind, 0.002, bandwidth, COUNT, 40.0};
    double sum = 0.0, w = 2 * M_PI;
    int n = 0;
    ck_assert_int_eq(mk_velocity_init(&est, &c), MK_OK);
    for (int k = 0; k < 2500; k++) {
        double t = k * 0.002, v = mk_velocity_step(&est, quantised(sin(w * t)));
        if (t > 1.0)
            sum += pow(v - w * cos(w * t), 2), n++;
    }
    return sqrt(sum / n);
}

START_TEST(observers_beat_the_report_s_filter)
{
    double best_filter = INFINITY, best_tracking = INFINITY;
    for (double f = 2; f < 120; f *= 1.2) {
        best_filter = fmin(best_filter, rms_error(MK_VELOCITY_FILTER, f));
        best_tracking = fmin(best_tracking, rms_error(MK_VELOCITY_TRACKING, f));
    }
    double kalman = rms_error(MK_VELOCITY_KALMAN, 0);
    ck_assert_msg(best_tracking < 0.95 * best_filter, "%g %g", best_tracking, best_filter);
    ck_assert_msg(kalman < 0.6 * best_filter, "%g %g", kalman, best_filter);
}
END_TEST

START_TEST(a_constant_speed_is_found_without_error)
{
    for (int kind = 0; kind < MK_VELOCITY_COUNT; kind++) {
        struct mk_velocity est;
        struct mk_velocity_config c = {(enum mk_velocity_kind)kind, 0.002, 20, COUNT, 40.0};
        ck_assert_int_eq(mk_velocity_init(&est, &c), MK_OK);
        double v = 0;
        for (int k = 0; k < 2000; k++) {
            bool dropped = k > 500 && k % 50 < 3; /* gaps do not hurt */
            v = mk_velocity_step(&est, dropped ? (double)NAN : 5.0 * k * 0.002);
        }
        ck_assert_double_eq_tol(v, 5.0, 1e-6);
        mk_velocity_reset(&est);
        ck_assert_double_eq(mk_velocity_step(&est, 3.0), 0.0);
        ck_assert_int_eq(mk_velocity_by_name(mk_velocity_name(c.kind)), kind);
    }
}
END_TEST

START_TEST(speed_settings_that_make_no_sense_are_refused)
{
    struct mk_velocity est;
    struct mk_velocity_config c = {MK_VELOCITY_TRACKING, 0.0, 20, COUNT, 40.0};
    ck_assert_int_eq(mk_velocity_init(&est, &c), MK_ERR_RANGE);
    c.dt_s = 0.002, c.bandwidth_hz = NAN;
    ck_assert_int_eq(mk_velocity_init(&est, &c), MK_ERR_RANGE);
    c.kind = MK_VELOCITY_COUNT;
    ck_assert_int_eq(mk_velocity_init(&est, &c), MK_ERR_INVALID);
}
END_TEST

Suite *suite_signal(void)
{
    Suite *s = suite_create("signal");
    TCase *t = tcase_create("signals");
    tcase_set_timeout(t, 20);
    tcase_add_test(t, expressions_mean_what_mathematics_means);
    tcase_add_test(t, a_chirp_sweeps_its_frequency_and_stays);
    tcase_add_test(t, a_multisine_is_periodic_flat_and_bounded);
    tcase_add_test(t, noise_is_repeatable_bounded_and_continuous);
    tcase_add_test(t, mistakes_are_refused_at_their_character);
    tcase_add_test(t, deep_nesting_and_random_text_do_no_harm);
    tcase_add_test(t, a_sampled_signal_holds_its_values_and_ends_in_zero);
    tcase_add_test(t, observers_beat_the_report_s_filter);
    tcase_add_test(t, a_constant_speed_is_found_without_error);
    tcase_add_test(t, speed_settings_that_make_no_sense_are_refused);
    suite_add_tcase(s, t);
    return s;
}
