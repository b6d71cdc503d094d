/* The ring between the loop and its writer. */
#include "suites.h"

#include <pthread.h>
#include <sched.h>
#include <stdint.h>

#include "mechkit/ring.h"

START_TEST(a_ring_gives_back_in_order_and_says_when_full_or_empty)
{
    struct mk_ring *ring;
    ck_assert_int_eq(mk_ring_create(5, sizeof(int), &ring), MK_OK);
    ck_assert_uint_eq(mk_ring_capacity(ring), 8);
    int x = 0;
    ck_assert(!mk_ring_pop(ring, &x));
    for (int round = 0; round < 100; round++) {
        for (int i = 0; i < 8; i++)
            ck_assert(mk_ring_push(ring, &i));
        ck_assert(!mk_ring_push(ring, &x));
        ck_assert_uint_eq(mk_ring_count(ring), 8);
        for (int i = 0; i < 8; i++) {
            ck_assert(mk_ring_pop(ring, &x) && x == i);
            ck_assert_uint_eq(mk_ring_count(ring), 7 - i);
        }
    }
    mk_ring_destroy(ring);
}
END_TEST

START_TEST(a_partly_filled_ring_wraps_without_losing_its_place)
{
    struct mk_ring *ring;
    ck_assert_int_eq(mk_ring_create(4, 3, &ring), MK_OK); /* records of an odd size */
    unsigned char in = 0, out = 0, record[3];
    for (int step = 0; step < 1000; step++) {
        for (int i = 0; i < 1 + step % 4; i++) {
            unsigned char put[3] = {in, (unsigned char)~in, 7};
            in += mk_ring_push(ring, put);
        }
        for (int i = 0; i < 1 + step % 3 && mk_ring_pop(ring, record); i++, out++)
            ck_assert(record[0] == out && record[1] == (unsigned char)~out && record[2] == 7);
    }
    ck_assert_uint_eq(mk_ring_count(ring), (unsigned char)(in - out));
    mk_ring_destroy(ring);
}
END_TEST

START_TEST(a_ring_that_cannot_be_is_refused)
{
    struct mk_ring *ring;
    int mark;
    void *set = &mark;
    static const struct {
        size_t capacity, record_size;
    } bad[] = {{0, 4}, {4, 0}, {SIZE_MAX, 4}, {4, SIZE_MAX}, {SIZE_MAX / 2, SIZE_MAX / 2}};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        ring = set;
        ck_assert_int_eq(mk_ring_create(bad[i].capacity, bad[i].record_size, &ring),
                         MK_ERR_INVALID);
        ck_assert_ptr_null(ring);
    }
    mk_ring_destroy(NULL);
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
        ck_assert_uint_le(mk_ring_count(ring), 64);
    }
    pthread_join(thread, NULL);
    ck_assert_uint_eq(mk_ring_count(ring), 0);
    mk_ring_destroy(ring);
}
END_TEST

Suite *suite_ring(void)
{
    Suite *s = suite_create("ring");
    TCase *t = tcase_create("core");
    tcase_set_timeout(t, 30);
    tcase_add_test(t, a_ring_gives_back_in_order_and_says_when_full_or_empty);
    tcase_add_test(t, a_partly_filled_ring_wraps_without_losing_its_place);
    tcase_add_test(t, a_ring_that_cannot_be_is_refused);
    tcase_add_test(t, nothing_is_lost_or_torn_between_two_threads);
    suite_add_tcase(s, t);
    return s;
}
