#include "suites.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mechkit/board.h"
#include "mechkit/rig.h"

#define COUNTS_PER_RAD (4000.0 / (2.0 * M_PI))

static struct mk_model model;
static struct mk_rig_config config;
static struct mk_rig *rig;

static void make(enum mk_plant_kind kind)
{
    struct mk_error err = MK_ERROR_INIT;
    mk_model_default(kind, &model);
    ck_assert_int_eq(mk_rig_create(&model, &config, &rig, &err), MK_OK);
}

static void setup(void)
{
    mk_rig_config_default(&config);
    rig = NULL;
}

static void teardown(void)
{
    mk_rig_destroy(rig);
}

static void advance(double dt_s, double u)
{
    ck_assert_int_eq(mk_rig_advance(rig, dt_s, u, NULL), MK_OK);
}

START_TEST(a_hanging_rig_reads_zero_and_stays)
{
    for (int kind = 0; kind < MK_PLANT_COUNT; kind++) {
        int32_t count[MK_MAX_JOINTS];
        make((enum mk_plant_kind)kind);
        advance(0.5, 0.0);
        mk_rig_counts(rig, count);
        ck_assert_int_eq(count[0], 0);
        ck_assert_int_eq(count[1], 0);
        mk_rig_destroy(rig);
        rig = NULL;
    }
}
END_TEST

START_TEST(a_count_is_the_nearest_step_of_the_angle)
{
    make(MK_PLANT_PENDUBOT);
    for (int k = 0; k < 200; k++) {
        int32_t count[MK_MAX_JOINTS];
        advance(0.005, 2.0 * sin(0.03 * k));
        mk_rig_counts(rig, count);
        const double *x = mk_rig_state(rig);
        ck_assert_int_eq(count[0], lround((x[0] + M_PI_2) * COUNTS_PER_RAD));
        ck_assert_int_eq(count[1], lround(x[1] * COUNTS_PER_RAD));
    }
    ck_assert_double_eq_tol(mk_rig_time(rig), 1.0, 1e-9);
}
END_TEST

START_TEST(zeroing_takes_the_place_where_the_rig_is)
{
    int32_t count[MK_MAX_JOINTS];
    make(MK_PLANT_INERTIA_WHEEL);
    advance(0.1, 5.0);
    mk_rig_counts(rig, count);
    ck_assert_int_gt(count[0], 100);
    mk_rig_zero(rig);
    mk_rig_counts(rig, count);
    ck_assert_int_eq(count[0], 0);
}
END_TEST

START_TEST(a_start_off_rest_is_zero_at_power_up)
{
    int32_t count[MK_MAX_JOINTS];
    config.start[0] = 2.0 / COUNTS_PER_RAD;
    make(MK_PLANT_PENDULUM);
    mk_rig_counts(rig, count);
    ck_assert_int_eq(count[0], 0);
    ck_assert_double_eq_tol(mk_rig_state(rig)[0], 2.0 / COUNTS_PER_RAD, 1e-12);
}
END_TEST

START_TEST(an_encoder_offset_survives_zeroing)
{
    struct mk_error err = MK_ERROR_INIT;
    int32_t count[MK_MAX_JOINTS];
    mk_model_default(MK_PLANT_PENDUBOT, &model);
    ck_assert_int_eq(mk_model_add_effect(&model, "encoder-offset", 2, &err), MK_OK);
    model.effect[0].value[0] = 10.0 / COUNTS_PER_RAD;
    ck_assert_int_eq(mk_rig_create(&model, &config, &rig, &err), MK_OK);
    mk_rig_zero(rig);
    mk_rig_counts(rig, count);
    ck_assert_int_eq(count[1], 10);
}
END_TEST

/* What a hanging rig reads just after zeroing is its encoder's zero. */
START_TEST(every_zeroing_draws_values_that_logs_have_of_their_own)
{
    enum { N = 2000 };
    struct mk_error err = MK_ERROR_INIT;
    double sum = 0, squares = 0;
    int32_t first[2][MK_MAX_JOINTS] = {{0}};
    mk_model_default(MK_PLANT_PENDULUM, &model);
    ck_assert_int_eq(mk_model_add_effect(&model, "encoder-offset", 1, &err), MK_OK);
    model.effect[0].value[0] = 0.05;
    model.effect[0].spread[0] = 0.03;
    config.seed = 7;
    for (int again = 0; again < 2; again++) {
        ck_assert_int_eq(mk_rig_create(&model, &config, &rig, &err), MK_OK);
        mk_rig_counts(rig, first[again]);
        if (again == 0)
            mk_rig_destroy(rig);
    }
    ck_assert_int_eq(first[0][0], first[1][0]); /* the seed repeats them */
    for (int k = 0; k < N; k++) {
        int32_t count[MK_MAX_JOINTS];
        mk_rig_zero(rig);
        mk_rig_counts(rig, count);
        const double zero = mk_rig_model(rig)->effect[0].value[0];
        ck_assert_int_eq(count[0], lround(zero * COUNTS_PER_RAD));
        ck_assert(!mk_model_has_own_values(mk_rig_model(rig)));
        sum += zero, squares += zero * zero;
    }
    const double mean = sum / N, sd = sqrt(squares / N - mean * mean);
    ck_assert_double_eq_tol(mean, 0.05, 5 * 0.03 / sqrt(N));
    ck_assert_double_eq_tol(sd, 0.03, 5 * 0.03 / sqrt(2.0 * N));
}
END_TEST

START_TEST(counters_wrap_at_24_bits)
{
    /* 9000 rad/s without friction pass 2^23 counts after 1.46 s. */
    int32_t count[MK_MAX_JOINTS], last = 0;
    int64_t total = 0;
    config.start_v[0] = 9000.0;
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &model);
    model.parameter[1] = model.parameter[2] = 0.0;
    ck_assert_int_eq(mk_rig_create(&model, &config, &rig, NULL), MK_OK);
    bool wrapped = false;
    for (int k = 0; k < 200; k++) {
        advance(0.01, 0.0);
        mk_rig_counts(rig, count);
        ck_assert_int_ge(count[0], -(1 << 23));
        ck_assert_int_lt(count[0], 1 << 23);
        wrapped = wrapped || count[0] < last;
        total += mk_counter_difference(count[0], last, 24);
        last = count[0];
    }
    ck_assert(wrapped);
    ck_assert_int_eq(total, lround(mk_rig_state(rig)[0] * COUNTS_PER_RAD));
}
END_TEST

START_TEST(the_amplifier_saturates)
{
    make(MK_PLANT_INERTIA_WHEEL);
    advance(0.1, 1e6);
    double v_limited = mk_rig_state(rig)[1];
    ck_assert_int_eq(mk_rig_restart(rig, NULL), MK_OK);
    advance(0.1, model.u_max);
    ck_assert_double_eq(v_limited, mk_rig_state(rig)[1]);
    ck_assert_double_gt(v_limited, 0.0);
}
END_TEST

START_TEST(no_time_changes_nothing_and_backwards_is_refused)
{
    make(MK_PLANT_PENDUBOT);
    advance(0.1, 3.0);
    double q = mk_rig_state(rig)[0];
    advance(0.0, -3.0);
    ck_assert_double_eq(mk_rig_state(rig)[0], q);
    ck_assert_int_eq(mk_rig_advance(rig, -1e-3, 0.0, NULL), MK_ERR_RANGE);
    ck_assert_int_eq(mk_rig_advance(rig, NAN, 0.0, NULL), MK_ERR_RANGE);
}
END_TEST

static void play(int32_t *out, int n)
{
    for (int k = 0; k < n; k++) {
        advance(0.002, 4.0 * sin(0.02 * k));
        mk_rig_counts(rig, &out[k * MK_MAX_JOINTS]);
    }
}

START_TEST(the_same_seed_gives_the_same_counts)
{
    enum { N = 500 };
    static int32_t a[N * MK_MAX_JOINTS], b[N * MK_MAX_JOINTS];
    config.seed = 7;
    config.count_noise = 1.5;
    make(MK_PLANT_PENDUBOT);
    play(a, N);
    ck_assert_int_eq(mk_rig_restart(rig, NULL), MK_OK);
    play(b, N);
    ck_assert_mem_eq(a, b, sizeof a);

    mk_rig_destroy(rig);
    make(MK_PLANT_PENDUBOT);
    play(b, N);
    ck_assert_mem_eq(a, b, sizeof a);

    mk_rig_destroy(rig);
    config.seed = 8;
    make(MK_PLANT_PENDUBOT);
    play(b, N);
    ck_assert_mem_ne(a, b, sizeof a);
}
END_TEST

START_TEST(count_noise_has_the_spread_asked_for)
{
    enum { N = 20000 };
    double sum = 0, square = 0;
    config.count_noise = 3.0;
    config.seed = 1;
    make(MK_PLANT_PENDUBOT);
    for (int k = 0; k < N; k++) {
        int32_t count[MK_MAX_JOINTS];
        mk_rig_counts(rig, count);
        sum += count[0];
        square += (double)count[0] * count[0];
    }
    /* Quantisation adds 1/12. The limits are five standard errors wide. */
    ck_assert_double_eq_tol(sum / N, 0.0, 5.0 * 3.0 / sqrt(N));
    ck_assert_double_eq_tol(square / N, 9.0 + 1.0 / 12.0, 5.0 * 9.0 * sqrt(2.0 / N));
}
END_TEST

/* Effects at values that their ranges allow and no solver follows. */
START_TEST(a_model_that_is_too_stiff_to_be_followed_is_refused_by_name)
{
    static const struct {
        const char *effect;
        int at;
        double value, bearable;
    } stiff[] = {
        {"viscous", 0, 1e6, 10.0}, {"stiction", 0, 1e6, 50.0}, {"cable-hysteresis", 1, 1e-6, 1e-3}};
    for (size_t i = 0; i < sizeof stiff / sizeof stiff[0]; i++) {
        struct mk_error err = MK_ERROR_INIT;
        mk_model_default(MK_PLANT_PENDUBOT, &model);
        ck_assert_int_eq(mk_model_add_effect(&model, "coulomb", 2, &err), MK_OK);
        ck_assert_int_eq(mk_model_add_effect(&model, stiff[i].effect, 1, &err), MK_OK);
        model.effect[1].value[stiff[i].at] = stiff[i].value;
        ck_assert_int_eq(mk_rig_create(&model, &config, &rig, &err), MK_ERR_RANGE);
        ck_assert_ptr_null(rig);
        ck_assert_msg(strstr(err.message, stiff[i].effect) != NULL, "%s", err.message);
        model.effect[1].value[stiff[i].at] = stiff[i].bearable;
        ck_assert_msg(mk_rig_create(&model, &config, &rig, &err) == MK_OK, "%s", err.message);
        mk_rig_destroy(rig);
        rig = NULL;
    }
}
END_TEST

Suite *suite_rig(void)
{
    Suite *s = suite_create("rig");
    TCase *t = tcase_create("counters");
    tcase_add_checked_fixture(t, setup, teardown);
    tcase_add_test(t, a_hanging_rig_reads_zero_and_stays);
    tcase_add_test(t, a_count_is_the_nearest_step_of_the_angle);
    tcase_add_test(t, zeroing_takes_the_place_where_the_rig_is);
    tcase_add_test(t, a_start_off_rest_is_zero_at_power_up);
    tcase_add_test(t, an_encoder_offset_survives_zeroing);
    tcase_add_test(t, every_zeroing_draws_values_that_logs_have_of_their_own);
    tcase_add_test(t, counters_wrap_at_24_bits);
    tcase_add_test(t, the_amplifier_saturates);
    tcase_add_test(t, no_time_changes_nothing_and_backwards_is_refused);
    tcase_add_test(t, the_same_seed_gives_the_same_counts);
    tcase_add_test(t, count_noise_has_the_spread_asked_for);
    tcase_add_test(t, a_model_that_is_too_stiff_to_be_followed_is_refused_by_name);
    suite_add_tcase(s, t);
    return s;
}
