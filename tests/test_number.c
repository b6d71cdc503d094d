/* Numbers as text: exact, short, whatever the locale. */
#include "suites.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mechkit/number.h"
#include "support/comma_locale.h"

static uint64_t bits(double x)
{
    uint64_t b;
    memcpy(&b, &x, sizeof b);
    return b;
}

static double next_random(uint64_t *s)
{
    double x;
    *s ^= *s << 13, *s ^= *s >> 7, *s ^= *s << 17;
    memcpy(&x, s, sizeof x);
    return x;
}

/* Text of a number that must read back as itself. */
static const char *exact_text(double x)
{
    static char text[MK_NUMBER_MAX];
    double y = 0.0;
    size_t n = mk_format_double(text, x);
    ck_assert_uint_eq(n, strlen(text));
    ck_assert_uint_lt(n, MK_NUMBER_MAX);
    ck_assert_msg(mk_parse_double_z(text, &y), "%s", text);
    ck_assert_msg(bits(x) == bits(y), "%s", text);
    return text;
}

START_TEST(a_double_written_and_read_is_the_same_double)
{
    uint64_t seed = 88172645463325252u;
    for (int i = 0; i < 200000; i++) {
        double x = next_random(&seed); /* any bits: subnormals and huge numbers as well */
        if (isnan(x))
            continue;
        ck_assert_ptr_null(strchr(exact_text(x), ','));
        exact_text(trunc(fmod(x, 1e17)));
    }
    static const double special[] = {0.0,
                                     -0.0,
                                     INFINITY,
                                     -INFINITY,
                                     5e-324,
                                     -5e-324,
                                     2.2250738585072014e-308,
                                     1.7976931348623157e308,
                                     -1.7976931348623157e308,
                                     9007199254740993.0,
                                     999999999999999.0,
                                     1e15,
                                     -1e15,
                                     0.1 + 0.2};
    for (size_t i = 0; i < sizeof special / sizeof special[0]; i++)
        exact_text(special[i]);
}
END_TEST

START_TEST(the_text_is_short_and_whole_numbers_have_no_exponent)
{
    static const struct {
        double value;
        const char *text;
    } rows[] = {
        {0.0, "0"},          {-0.0, "-0"},       {0.1, "0.1"},
        {-1.5, "-1.5"},      {100000, "100000"}, {-3000000, "-3000000"},
        {1e22, "1e+22"},     {1e-7, "1e-07"},    {-1.5707963267949, "-1.5707963267949"},
        {NAN, "nan"},        {-NAN, "nan"},      {INFINITY, "inf"},
        {-INFINITY, "-inf"},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        char text[MK_NUMBER_MAX];
        mk_format_double(text, rows[i].value);
        ck_assert_str_eq(text, rows[i].text);
    }
}
END_TEST

/* The shortest text of a number below 1e15 that is not whole: with the fewest digits that read
 * back, as the C library rounds them, and without an exponent unless that is shorter. */
static void shortest_text(double x, char *text, size_t size)
{
    char scientific[40], digits[20];
    int precision = 0, count = 0;
    do
        snprintf(scientific, sizeof scientific, "%.*e", precision, fabs(x));
    while (strtod(scientific, NULL) != fabs(x) && precision++ < 17);
    for (const char *c = scientific; *c != 'e'; c++)
        if (*c != '.')
            digits[count++] = *c;
    const int scale = atoi(strchr(scientific, 'e') + 1);
    const char *sign = signbit(x) ? "-" : "";
    if (scale >= 0)
        snprintf(text, size, "%s%.*s.%.*s", sign, scale + 1, digits, count - scale - 1,
                 digits + scale + 1);
    else if (-scale + 1 + count <= (int)strlen(scientific))
        snprintf(text, size, "%s0.%.*s%.*s", sign, -scale - 1, "0000", count, digits);
    else
        snprintf(text, size, "%s%s", sign, scientific);
}

static void expect_shortest(double x)
{
    char text[64];
    shortest_text(x, text, sizeof text);
    ck_assert_str_eq(exact_text(x), text);
}

START_TEST(no_number_has_more_digits_than_it_takes)
{
    uint64_t seed = 88172645463325252u;
    for (int i = 0; i < 200000; i++) {
        const double share = (double)(int64_t)bits(next_random(&seed)) * 0x1p-63;
        const int power = (int)(bits(next_random(&seed)) % 140) - 95;
        const double few = trunc(1000.0 * share) / 1000.0, half = trunc(share * 0x1p20) * 0x1p-21;
        const double all[] = {share,
                              few,
                              ldexp(share, power),
                              ldexp(half, power), /* of 20 bits: often in the middle */
                              10.0 * share,
                              few * pow(10.0, power / 10),
                              nextafter(ldexp(1.0, power), 0.0)};
        for (size_t k = 0; k < sizeof all / sizeof all[0]; k++)
            if (all[k] != trunc(all[k]) && fabs(all[k]) < 1e15)
                expect_shortest(all[k]);
    }
    expect_shortest(1e-30);
    expect_shortest(nextafter(1e-30, 0.0));
    expect_shortest(nextafter(1e15, 0.0));
    /* Below a power of two numbers are twice as dense: what the C library rounds to may be beyond
     * the half of a step there, where another one with as few digits is within that above. */
    for (int power = -99; power < 0; power++) {
        char text[64];
        const double x = ldexp(1.0, power);
        shortest_text(x, text, sizeof text);
        ck_assert_uint_le(strlen(exact_text(x)), strlen(text));
    }
    ck_assert_str_eq(exact_text(0x1p-77), "6.617444900424222e-24");
}
END_TEST

START_TEST(numbers_are_read_in_every_usual_form)
{
    static const struct {
        const char *text;
        double value;
    } rows[] = {
        {"1", 1},
        {" +2.5 ", 2.5},
        {"-3e-2", -0.03},
        {".5", 0.5},
        {"5.", 5},
        {"1E3", 1000},
        {"\t7\t", 7},
        {"7\r", 7},
        {"007", 7},
        {"+.5e+1", 5},
        {"inf", INFINITY},
        {"-INF", -INFINITY},
        {"+Infinity", INFINITY},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        double x = 0.0;
        ck_assert_msg(mk_parse_double_z(rows[i].text, &x), "'%s'", rows[i].text);
        ck_assert_msg(x == rows[i].value, "'%s' gave %g", rows[i].text, x);
    }
    static const char *const nans[] = {"nan", "NaN", "-nan", "+NAN"};
    for (size_t i = 0; i < sizeof nans / sizeof nans[0]; i++) {
        double x = 0.0;
        ck_assert_msg(mk_parse_double_z(nans[i], &x) && isnan(x), "'%s'", nans[i]);
    }
}
END_TEST

START_TEST(text_that_is_no_number_is_refused_and_touches_nothing)
{
    double x = 7.0;
    static const char *const bad[] = {"",     " ",     "1,5",   "1.5.2",   "0x10", "1e",   "1e+",
                                      "--1",  "+-1",   "-+1",   "1 2",     "abc",  "+",    "-",
                                      ".",    "e5",    "nanx",  "nan(1)",  "in",   "infi", "- 1",
                                      "1.5f", "1_000", "1'000", "\xc2\xb5"};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        ck_assert_msg(!mk_parse_double_z(bad[i], &x), "'%s'", bad[i]);
    ck_assert_double_eq(x, 7.0);
    /* The end counts, not a NUL. */
    const char *text = "12,5";
    ck_assert(mk_parse_double(text, text + 2, &x) && x == 12.0);
    ck_assert(!mk_parse_double(text, text + 3, &x));
    ck_assert(!mk_parse_double(text, text, &x));
}
END_TEST

START_TEST(what_no_double_holds_becomes_infinity_or_zero)
{
    static const struct {
        const char *text;
        double value;
    } rows[] = {
        {"1e999", INFINITY},
        {"-1e999", -INFINITY},
        {"1e-999", 0.0},
        {"-1e-999", -0.0},
        {"0.001e400", INFINITY},
        {"1000e-400", 0.0},
        {"1e99999999999999999999", INFINITY},
        {"1e-99999999999999999999", 0.0},
        {"0e99999999999999999999", 0.0},
    };
    double x;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        ck_assert_msg(mk_parse_double_z(rows[i].text, &x), "'%s'", rows[i].text);
        ck_assert_msg(bits(x) == bits(rows[i].value), "'%s' gave %g", rows[i].text, x);
    }
    /* Size decides, not the sign of the exponent. */
    char text[512];
    memset(text, '9', 400);
    strcpy(text + 400, "e-5");
    ck_assert(mk_parse_double_z(text, &x) && isinf(x));
    memset(text, '0', 400);
    memcpy(text, "0.", 2);
    strcpy(text + 400, "1e+5");
    ck_assert(mk_parse_double_z(text, &x) && x == 0.0);
}
END_TEST

START_TEST(a_locale_with_a_decimal_comma_does_not_matter)
{
    char text[MK_NUMBER_MAX];
    double x;
    if (!use_comma_locale())
        return;
    snprintf(text, sizeof text, "%.1f", 1.5);
    ck_assert_str_eq(text, "1,5"); /* the locale is on */
    mk_format_double(text, 1234567.5);
    ck_assert_str_eq(text, "1234567.5");
    ck_assert(mk_parse_double_z("1.5", &x) && x == 1.5);
    ck_assert(!mk_parse_double_z("1,5", &x));
}
END_TEST

Suite *suite_number(void)
{
    Suite *s = suite_create("number");
    TCase *t = tcase_create("text");
    tcase_set_timeout(t, 30);
    tcase_add_test(t, a_double_written_and_read_is_the_same_double);
    tcase_add_test(t, the_text_is_short_and_whole_numbers_have_no_exponent);
    tcase_add_test(t, no_number_has_more_digits_than_it_takes);
    tcase_add_test(t, numbers_are_read_in_every_usual_form);
    tcase_add_test(t, text_that_is_no_number_is_refused_and_touches_nothing);
    tcase_add_test(t, what_no_double_holds_becomes_infinity_or_zero);
    tcase_add_test(t, a_locale_with_a_decimal_comma_does_not_matter);
    suite_add_tcase(s, t);
    return s;
}
