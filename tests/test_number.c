/* Numbers as text: exact, short, whatever the locale. */
#include "suites.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
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
    tcase_add_test(t, numbers_are_read_in_every_usual_form);
    tcase_add_test(t, text_that_is_no_number_is_refused_and_touches_nothing);
    tcase_add_test(t, what_no_double_holds_becomes_infinity_or_zero);
    tcase_add_test(t, a_locale_with_a_decimal_comma_does_not_matter);
    suite_add_tcase(s, t);
    return s;
}
