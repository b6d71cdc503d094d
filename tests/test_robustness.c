/* Trials of the whole chain on rigs that are off the model. */
#include "suites.h"

#include <math.h>
#include <string.h>

#include "experiment/robustness.h"
#include "mechkit/json.h"
#include "support/files.h"
#include "support/program.h"

#define BALANCING_COUNT 6
static const struct {
    const char *setup;
    enum mk_plant_kind plant;
} balancing[BALANCING_COUNT] = {
    {"pendubot-mid", MK_PLANT_PENDUBOT},         {"pendubot-top", MK_PLANT_PENDUBOT},
    {"reaction-wheel", MK_PLANT_REACTION_WHEEL}, {"furuta", MK_PLANT_FURUTA},
    {"cart-pole", MK_PLANT_CART_POLE},           {"acrobot", MK_PLANT_ACROBOT}};

static struct trial run(int setup, const struct trial_spread *spread, uint64_t seed)
{
    struct mk_model nominal;
    struct mk_error err = MK_ERROR_INIT;
    struct trial t;
    mk_model_default(balancing[setup].plant, &nominal);
    enum mk_status st =
        trial_run(mk_ctrl_setup_by_name(balancing[setup].setup), &nominal, spread, seed, &t, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    return t;
}

START_TEST(the_nominal_rig_is_caught_in_four_seconds_and_held_for_twenty)
{
    struct trial_spread spread;
    trial_spread_default(&spread);
    struct trial t = run(_i, &spread, 0);
    ck_assert_msg(t.end == TRIAL_HELD, "%s %s", trial_end_name(t.end), t.fault);
    ck_assert_double_lt(t.caught_s, 4.0);
    ck_assert_double_lt(t.tilt_rad, 0.03);
    ck_assert_int_eq(t.falls, 0);
}
END_TEST

START_TEST(rigs_off_the_model_are_caught_and_held)
{
    struct trial_spread spread;
    trial_spread_default(&spread);
    int held = 0;
    for (uint64_t seed = 1; seed <= 8; seed++) {
        struct trial t = run(_i, &spread, seed);
        held += t.end == TRIAL_HELD;
        ck_assert_double_le(t.u_peak, t.rig.u_max);
    }
    ck_assert_int_ge(held, 7);
}
END_TEST

START_TEST(faster_and_slower_loops_balance_too)
{
    static const double rate_hz[] = {250.0, 1000.0};
    for (int i = 0; i < 2; i++) {
        struct trial_spread spread;
        trial_spread_default(&spread);
        spread.rate_hz = rate_hz[i];
        spread.delay_samples = 0;
        spread.parameters = spread.friction = 0.02;
        struct trial t = run(_i, &spread, 5);
        ck_assert_msg(t.end == TRIAL_HELD, "%g Hz: %s %s", rate_hz[i], trial_end_name(t.end),
                      t.fault);
    }
}
END_TEST

START_TEST(a_seed_means_the_same_rig_and_the_same_run)
{
    struct trial_spread spread;
    trial_spread_default(&spread);
    struct trial a = run(_i, &spread, 3), b = run(_i, &spread, 3), c = run(_i, &spread, 4);
    ck_assert_mem_eq(&a.rig, &b.rig, sizeof a.rig);
    ck_assert_double_eq(a.caught_s, b.caught_s);
    ck_assert_double_eq(a.travel_rad, b.travel_rad);
    ck_assert_double_ne(a.rig.parameter[0], c.rig.parameter[0]);
}
END_TEST

START_TEST(rigs_are_off_by_no_more_than_was_said)
{
    struct trial_spread spread;
    struct mk_model nominal, rig;
    trial_spread_default(&spread);
    mk_model_default(MK_PLANT_PENDUBOT, &nominal);
    double widest[2] = {0.0, 0.0};
    for (uint64_t seed = 1; seed <= 200; seed++) {
        ck_assert_int_eq(trial_rig(&nominal, &spread, seed, &rig, NULL), MK_OK);
        for (int i = 0; i < 7; i++) {
            double off = fabs(rig.parameter[i] / nominal.parameter[i] - 1.0);
            ck_assert_double_le(off, i < 5 ? 0.1 : 0.3);
            widest[i >= 5] = fmax(widest[i >= 5], off);
        }
        ck_assert_int_eq(rig.effect_count, 3); /* two encoders, one delay */
        ck_assert_double_eq_tol(mk_model_command_delay(&rig), 0.002, 1e-15);
    }
    ck_assert_double_gt(widest[0], 0.095);
    ck_assert_double_gt(widest[1], 0.285);
    /* Far off, some draws are of no rig; others take their place. */
    spread.parameters = 0.4;
    for (uint64_t seed = 1; seed <= 2000; seed++)
        ck_assert_int_eq(trial_rig(&nominal, &spread, seed, &rig, NULL), MK_OK);
    ck_assert_int_eq(trial_rig(&nominal, &spread, 0, &rig, NULL), MK_OK);
    ck_assert_mem_eq(&rig, &nominal, sizeof rig);
}
END_TEST

START_TEST(a_rig_that_cannot_be_caught_is_told_so)
{
    struct trial_spread spread;
    trial_spread_default(&spread);
    spread.delay_samples = 60; /* 0.12 s */
    struct trial t = run(_i, &spread, 1);
    ck_assert_int_ne(t.end, TRIAL_HELD);
    ck_assert(isnan(t.caught_s));
}
END_TEST

START_TEST(one_rig_is_not_called_rigs)
{
    char out[8192];
    ck_assert_int_eq(run_mechkit(out, sizeof out, "robustness --setup furuta --seeds 1"), 0);
    ck_assert_msg(strstr(out, "1 rig a setup: ") != NULL, "%s", out);
}
END_TEST

START_TEST(figures_on_standard_output_are_json_alone)
{
    static char out[20000];
    struct mk_error err = MK_ERROR_INIT;
    cJSON *root = NULL;
    ck_assert_int_eq(run_mechkit(out, sizeof out, "robustness --setup furuta --seeds 1 --json -"),
                     0);
    ck_assert_msg(mk_json_read(scratch_text("figures.json", out), &root, &err) == MK_OK, "%s",
                  err.message);
    ck_assert_int_eq(cJSON_GetArraySize(root), 1);
    cJSON_Delete(root);
}
END_TEST

Suite *suite_robustness(void)
{
    Suite *s = suite_create("robustness");
    TCase *t = tcase_create("trials");
    tcase_set_timeout(t, 300);
    tcase_add_loop_test(t, the_nominal_rig_is_caught_in_four_seconds_and_held_for_twenty, 0, 1);
    tcase_add_loop_test(t, faster_and_slower_loops_balance_too, 0, 1);
    tcase_add_loop_test(t, a_seed_means_the_same_rig_and_the_same_run, 0, 1);
    tcase_add_test(t, one_rig_is_not_called_rigs);
    tcase_add_test(t, figures_on_standard_output_are_json_alone);
    tcase_add_test(t, rigs_are_off_by_no_more_than_was_said);
    tcase_add_loop_test(t, a_rig_that_cannot_be_caught_is_told_so, 0, BALANCING_COUNT);
    suite_add_tcase(s, t);

    t = tcase_create("many rigs");
    tcase_set_timeout(t, 300);
    tcase_set_tags(t, "long");
    tcase_add_loop_test(t, the_nominal_rig_is_caught_in_four_seconds_and_held_for_twenty, 1,
                        BALANCING_COUNT);
    tcase_add_loop_test(t, faster_and_slower_loops_balance_too, 1, BALANCING_COUNT);
    tcase_add_loop_test(t, a_seed_means_the_same_rig_and_the_same_run, 1, BALANCING_COUNT);
    tcase_add_loop_test(t, rigs_off_the_model_are_caught_and_held, 0, BALANCING_COUNT);
    suite_add_tcase(s, t);
    return s;
}
