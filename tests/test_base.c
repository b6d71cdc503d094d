/* Numbers, ring, clocks, JSON. */
#include "suites.h"

#include <locale.h>
#include <math.h>
#include <pthread.h>
#include <sched.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "mechkit/clock.h"
#include "mechkit/json.h"
#include "mechkit/number.h"
#include "mechkit/ring.h"
#include "support/files.h"

static uint64_t bits(double x)
{
    uint64_t b;
    memcpy(&b, &x, sizeof b);
    return b;
}

static uint64_t next_random(uint64_t *s)
{
    *s ^= *s << 13, *s ^= *s >> 7, *s ^= *s << 17;
    return *s;
}

START_TEST(a_double_written_and_read_is_the_same_double)
{
    uint64_t seed = 88172645463325252u;
    for (int i = 0; i < 200000; i++) {
        uint64_t b = next_random(&seed);
        double x, y;
        char text[MK_NUMBER_MAX];
        memcpy(&x, &b, sizeof x);
        if (isnan(x))
            continue;
        size_t n = mk_format_double(text, x);
        ck_assert_uint_eq(n, strlen(text));
        ck_assert(mk_parse_double_z(text, &y));
        ck_assert_msg(bits(x) == bits(y), "%s", text);
    }
    double special[] = {0.0, -0.0, INFINITY, -INFINITY, 5e-324, 1.7976931348623157e308};
    for (int i = 0; i < 6; i++) {
        char text[MK_NUMBER_MAX];
        double y;
        mk_format_double(text, special[i]);
        ck_assert(mk_parse_double_z(text, &y));
        ck_assert(bits(special[i]) == bits(y));
    }
}
END_TEST

START_TEST(text_that_is_no_number_is_refused)
{
    double x = 7.0;
    const char *bad[] = {"", " ", "1,5", "1.5.2", "0x10", "1e", "--1", "+-1", "1 2", "abc", "+"};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        ck_assert_msg(!mk_parse_double_z(bad[i], &x), "'%s'", bad[i]);
    ck_assert_double_eq(x, 7.0);
    const char *good[] = {"1", " +2.5 ", "-3e-2", ".5", "5.", "1E3"};
    double want[] = {1, 2.5, -0.03, 0.5, 5, 1000};
    for (int i = 0; i < 6; i++) {
        ck_assert_msg(mk_parse_double_z(good[i], &x), "'%s'", good[i]);
        ck_assert_double_eq(x, want[i]);
    }
    ck_assert(mk_parse_double_z("nan", &x) && isnan(x));
    ck_assert(mk_parse_double_z("1e999", &x) && isinf(x));
    ck_assert(mk_parse_double_z("-1e-999", &x) && x == 0.0);
}
END_TEST

START_TEST(the_locale_does_not_matter)
{
    char text[MK_NUMBER_MAX];
    double x;
    const char *tried[] = {"de_DE.UTF-8", "fr_FR.UTF-8", "nl_NL.UTF-8"};
    for (int i = 0; i < 3; i++)
        if (setlocale(LC_ALL, tried[i]))
            break;
    mk_format_double(text, 1.5);
    ck_assert_str_eq(text, "1.5");
    ck_assert(mk_parse_double_z("1.5", &x) && x == 1.5);
}
END_TEST

/* --- ring -------------------------------------------------------------------------------- */

START_TEST(a_ring_gives_back_in_order_and_says_when_full_or_empty)
{
    struct mk_ring *ring;
    ck_assert_int_eq(mk_ring_create(5, sizeof(int), &ring), MK_OK);
    ck_assert_uint_eq(mk_ring_capacity(ring), 8);
    int x;
    ck_assert(!mk_ring_pop(ring, &x));
    for (int round = 0; round < 100; round++) {
        for (int i = 0; i < 8; i++)
            ck_assert(mk_ring_push(ring, &i));
        ck_assert(!mk_ring_push(ring, &x));
        ck_assert_uint_eq(mk_ring_count(ring), 8);
        for (int i = 0; i < 8; i++)
            ck_assert(mk_ring_pop(ring, &x) && x == i);
    }
    mk_ring_destroy(ring);
    ck_assert_int_eq(mk_ring_create(0, 4, &ring), MK_ERR_INVALID);
    ck_assert_int_eq(mk_ring_create(SIZE_MAX, 4, &ring), MK_ERR_INVALID);
}
END_TEST

#define HANDED 200000

struct record {
    int64_t i, square;
};

static void *produce(void *user)
{
    for (int64_t i = 0; i < HANDED; i++) {
        struct record r = {i, i * i};
        while (!mk_ring_push(user, &r))
            sched_yield();
    }
    return NULL;
}

START_TEST(nothing_is_lost_or_torn_between_two_threads)
{
    struct mk_ring *ring;
    pthread_t thread;
    ck_assert_int_eq(mk_ring_create(64, sizeof(struct record), &ring), MK_OK);
    ck_assert_int_eq(pthread_create(&thread, NULL, produce, ring), 0);
    for (int64_t i = 0; i < HANDED; i++) {
        struct record r;
        while (!mk_ring_pop(ring, &r))
            sched_yield();
        ck_assert(r.i == i && r.square == i * i);
    }
    pthread_join(thread, NULL);
    mk_ring_destroy(ring);
}
END_TEST

/* --- clocks ------------------------------------------------------------------------------ */

START_TEST(simulated_time_jumps_and_never_runs_back)
{
    struct mk_clock c;
    mk_clock_init_simulated(&c);
    ck_assert(mk_clock_now_ns(&c) == 0);
    mk_clock_sleep_until(&c, 3600000000000);
    ck_assert(mk_clock_now_ns(&c) == 3600000000000);
    mk_clock_sleep_until(&c, 5);
    ck_assert(mk_clock_now_ns(&c) == 3600000000000);
}
END_TEST

START_TEST(the_monotonic_clock_sleeps_until_its_deadline)
{
    struct mk_clock c;
    mk_clock_init_monotonic(&c);
    int64_t deadline = mk_clock_now_ns(&c) + 2000000;
    mk_clock_sleep_until(&c, deadline);
    ck_assert(mk_clock_now_ns(&c) >= deadline);
    mk_clock_sleep_until(&c, deadline - 1000000); /* past: returns at once */
}
END_TEST

/* --- JSON -------------------------------------------------------------------------------- */

START_TEST(json_keeps_numbers_exact_and_writes_null_for_nan)
{
    struct mk_error err = MK_ERROR_INIT;
    cJSON *root = cJSON_CreateObject(), *back;
    cJSON_AddItemToObject(root, "third", mk_json_number(1.0 / 3.0));
    cJSON_AddItemToObject(root, "none", mk_json_number(NAN));
    double row[] = {1, 2.5, INFINITY};
    cJSON_AddItemToObject(root, "row", mk_json_numbers(row, 3));
    const char *path = scratch("a.json");
    ck_assert_int_eq(mk_json_write(path, root, &err), MK_OK);
    ck_assert_int_eq(mk_json_read(path, &back, &err), MK_OK);
    ck_assert(cJSON_GetObjectItem(back, "third")->valuedouble == 1.0 / 3.0);
    ck_assert(cJSON_IsNull(cJSON_GetObjectItem(back, "none")));
    ck_assert_int_eq(cJSON_GetArraySize(cJSON_GetObjectItem(back, "row")), 3);
    cJSON_Delete(root);
    cJSON_Delete(back);
    ck_assert_int_eq(mk_json_write("/dev/full", NULL, &err), MK_ERR_NOMEM);
}
END_TEST

START_TEST(broken_json_is_refused_with_its_place)
{
    struct mk_error err = MK_ERROR_INIT;
    cJSON *back;
    const char *path = scratch_text("b.json", "{\n  \"a\": 1,\n  \"b\": oops\n}\n");
    ck_assert_int_eq(mk_json_read(path, &back, &err), MK_ERR_PARSE);
    ck_assert_int_eq(err.line, 3);
    ck_assert_int_eq(mk_json_read(scratch("none.json"), &back, &err), MK_ERR_NOTFOUND);
}
END_TEST

Suite *suite_base(void)
{
    Suite *s = suite_create("base");
    TCase *t = tcase_create("core");
    tcase_set_timeout(t, 30);
    tcase_add_test(t, a_double_written_and_read_is_the_same_double);
    tcase_add_test(t, text_that_is_no_number_is_refused);
    tcase_add_test(t, the_locale_does_not_matter);
    tcase_add_test(t, a_ring_gives_back_in_order_and_says_when_full_or_empty);
    tcase_add_test(t, nothing_is_lost_or_torn_between_two_threads);
    tcase_add_test(t, simulated_time_jumps_and_never_runs_back);
    tcase_add_test(t, the_monotonic_clock_sleeps_until_its_deadline);
    tcase_add_test(t, json_keeps_numbers_exact_and_writes_null_for_nan);
    tcase_add_test(t, broken_json_is_refused_with_its_place);
    suite_add_tcase(s, t);
    return s;
}
