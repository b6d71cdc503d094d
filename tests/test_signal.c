/* Signals: what expressions mean, where mistakes are, samples from files. */
#include "suites.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ctrl/signal_priv.h"
#include "mechkit/signal.h"
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

START_TEST(every_function_of_time_is_its_closed_form)
{
    static const double times[] = {-1.3, -0.25, 0.0, 0.1, 0.37, 0.5, 0.75, 1.0, 2.75};
    for (size_t k = 0; k < sizeof times / sizeof times[0]; k++) {
        double t = times[k], whole = t - floor(t);
        struct {
            const char *text;
            double want;
        } cases[] = {{"t", t},
                     {"sin(2*t)", sin(2 * t)},
                     {"cos(2*t)", cos(2 * t)},
                     {"tan(t/3)", tan(t / 3)},
                     {"exp(-t)", exp(-t)},
                     {"log(t + 2)", log(t + 2)},
                     {"sqrt(t + 2)", sqrt(t + 2)},
                     {"abs(t)", fabs(t)},
                     {"sign(t)", t > 0   ? 1
                                 : t < 0 ? -1
                                         : 0},
                     {"tanh(15*t)", tanh(15 * t)},
                     {"min(t, 0.2)", t < 0.2 ? t : 0.2},
                     {"max(t, 0.2)", t > 0.2 ? t : 0.2},
                     {"t^2", t * t},
                     {"step(0.5)", t >= 0.5},
                     {"ramp(0.5)", t > 0.5 ? t - 0.5 : 0},
                     {"pulse(0.1, 0.5)", t >= 0.1 && t < 0.5},
                     {"square(1)", whole < 0.5 ? 1 : -1},
                     {"saw(1)", 2 * whole - 1},
                     {"step(t - 1) + step(t + 1)", 1}};
        for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
            ck_assert_msg(fabs(value(cases[i].text, t) - cases[i].want) < 1e-12, "%s at %g",
                          cases[i].text, t);
    }
}
END_TEST

START_TEST(what_does_not_depend_on_time_is_computed_once)
{
    struct {
        const char *text;
        int instructions;
    } cases[] = {{"2*pi*3 + sin(1)^-2", 1},
                 {"-(3)", 1},
                 {"min(1, max(2, 3))", 1},
                 {"2*pi*t", 3},
                 {"t*2*3", 5},
                 {"sin(2*3)*step(1 + 1)", 4},
                 {"step(1)", 2},
                 {"t", 1}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct mk_signal *s;
        ck_assert_int_eq(mk_signal_create(cases[i].text, &s, NULL), MK_OK);
        ck_assert_msg(s->count == cases[i].instructions, "%s: %d", cases[i].text, s->count);
        mk_signal_destroy(s);
    }
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
    ck_assert(peak < 1.27 && peak > 0.99 && power > 0.3);
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

START_TEST(deep_nesting_and_great_length_are_refused)
{
    char text[5000];
    struct mk_signal *s;
    struct mk_error err = MK_ERROR_INIT;
    static const char *const openings[] = {"(", "-", "+", "sin(", "2^", "min(1,", "1+("};
    for (size_t k = 0; k < sizeof openings / sizeof openings[0]; k++) {
        size_t n = strlen(openings[k]);
        for (size_t at = 0; at + n < sizeof text; at += n)
            strcpy(text + at, openings[k]);
        ck_assert_int_eq(mk_signal_create(text, &s, &err), MK_ERR_PARSE);
        ck_assert_msg(strstr(err.message, "deep"), "%s: %s", openings[k], err.message);
    }
    text[0] = 0;
    for (int i = 0; i < 600; i++)
        strcat(text, "t+");
    strcat(text, "t");
    ck_assert_int_eq(mk_signal_create(text, &s, &err), MK_ERR_PARSE);
    ck_assert_ptr_nonnull(strstr(err.message, "long"));
    for (char *c = text; *c; c++)
        if (*c == 't')
            *c = '1';
    ck_assert_double_eq(value(text, 0.0), 601.0);
    /* Twenty parentheses are no reason to complain. */
    ck_assert_double_eq(value("((((((((((((((((((((t))))))))))))))))))))", 3.0), 3.0);
}
END_TEST

START_TEST(random_text_does_no_harm)
{
    static const char alphabet[] = "0123456789.+-*/^()t,sincoexpe ";
    char text[40];
    int good = 0;
    srand(5);
    for (int i = 0; i < 40000; i++) {
        struct mk_signal *s;
        struct mk_error err = MK_ERROR_INIT;
        int n = rand() % 24;
        for (int k = 0; k < n; k++)
            text[k] = i % 4 ? alphabet[rand() % (sizeof alphabet - 1)] : (char)(1 + rand() % 255);
        text[n] = 0;
        if (text[strspn(text, " \t")] == '@')
            continue;
        enum mk_status st = mk_signal_create(text, &s, &err);
        if (st == MK_OK) {
            good++;
            (void)mk_signal_at(s, 0.5);
            mk_signal_destroy(s);
        } else {
            ck_assert_int_eq(st, MK_ERR_PARSE);
            ck_assert_ptr_null(s);
            ck_assert(err.column >= 1 && err.column <= n + 1 && err.message[0]);
        }
    }
    ck_assert_int_gt(good, 100);
}
END_TEST

/* Grows a random expression along the grammar, writes it to *at and returns its value at t: what
 * the parser makes of the text must have the same value. */
struct growth {
    char *at;
    double t;
};

static double grow_sum(struct growth *g, int depth);

static void put(struct growth *g, const char *text)
{
    g->at += sprintf(g->at, rand() % 3 ? "%s" : " %s ", text);
}

static double grow_primary(struct growth *g, int depth)
{
    static double (*const calls[])(double) = {sin, cos, tanh, fabs, exp};
    static const char *const names[] = {"sin(", "cos(", "tanh(", "abs(", "exp("};
    int kind = depth > 0 ? rand() % 5 : rand() % 3;
    char number[16];
    if (kind == 0) {
        snprintf(number, sizeof number, "%.3g", 0.01 + 3.0 * rand() / RAND_MAX);
        put(g, number);
        return strtod(number, NULL);
    }
    if (kind < 3) {
        put(g, kind == 1 ? "t" : "pi");
        return kind == 1 ? g->t : M_PI;
    }
    int call = rand() % 5;
    put(g, kind == 3 ? names[call] : "(");
    double inner = grow_sum(g, depth - 1);
    put(g, ")");
    return kind == 3 ? calls[call](inner) : inner;
}

static double grow_unary(struct growth *g, int depth)
{
    if (depth > 0 && rand() % 6 == 0) {
        put(g, "-");
        return -grow_unary(g, depth - 1);
    }
    double base = grow_primary(g, depth);
    if (depth <= 0 || rand() % 5)
        return base;
    put(g, "^");
    return pow(base, grow_unary(g, depth - 1));
}

static double grow_product(struct growth *g, int depth)
{
    double x = grow_unary(g, depth);
    while (rand() % 3 == 0) {
        bool times = rand() % 2;
        put(g, times ? "*" : "/");
        double y = grow_unary(g, depth - 1);
        x = times ? x * y : x / y;
    }
    return x;
}

static double grow_sum(struct growth *g, int depth)
{
    double x = grow_product(g, depth);
    while (rand() % 3 == 0) {
        bool plus = rand() % 2;
        put(g, plus ? "+" : "-");
        double y = grow_product(g, depth - 1);
        x = plus ? x + y : x - y;
    }
    return x;
}

START_TEST(random_expressions_have_the_value_of_their_tree)
{
    static char text[1 << 16];
    int compared = 0;
    srand(6);
    for (int i = 0; i < 20000; i++) {
        struct growth g = {text, 3.0 * rand() / RAND_MAX};
        struct mk_signal *s;
        struct mk_error err = MK_ERROR_INIT;
        double want = grow_sum(&g, 4);
        if (mk_signal_create(text, &s, &err) != MK_OK) {
            ck_assert_msg(strstr(err.message, "long") != NULL, "%s: %s", text, err.message);
            continue;
        }
        double got = mk_signal_at(s, g.t);
        ck_assert_msg(isnan(want) ? isnan(got)
                                  : got == want || fabs(got - want) <= 1e-9 * fabs(want),
                      "%s at %g: %.17g, not %.17g", text, g.t, got, want);
        compared += isfinite(want);
        mk_signal_destroy(s);
    }
    ck_assert_int_gt(compared, 15000);
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

Suite *suite_signal(void)
{
    Suite *s = suite_create("signal");
    TCase *t = tcase_create("signals");
    tcase_set_timeout(t, 20);
    tcase_add_test(t, expressions_mean_what_mathematics_means);
    tcase_add_test(t, every_function_of_time_is_its_closed_form);
    tcase_add_test(t, what_does_not_depend_on_time_is_computed_once);
    tcase_add_test(t, a_chirp_sweeps_its_frequency_and_stays);
    tcase_add_test(t, a_multisine_is_periodic_flat_and_bounded);
    tcase_add_test(t, noise_is_repeatable_bounded_and_continuous);
    tcase_add_test(t, mistakes_are_refused_at_their_character);
    tcase_add_test(t, deep_nesting_and_great_length_are_refused);
    tcase_add_test(t, random_text_does_no_harm);
    tcase_add_test(t, random_expressions_have_the_value_of_their_tree);
    tcase_add_test(t, a_sampled_signal_holds_its_values_and_ends_in_zero);
    suite_add_tcase(s, t);
    return s;
}
