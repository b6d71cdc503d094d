// Evidence that carries over to data that were not fitted, on errors that are made up.
#include "explain/evidence/carry_over.hpp"

#include "suites.h"

#include <cmath>
#include <vector>

#include "mechkit/sim.h"

namespace
{

constexpr size_t WINDOWS = 6; // a fold
constexpr double NO_FLOOR[MK_MAX_JOINTS] = {0.0, 0.0};

// Errors of one joint in folds of WINDOWS windows each: `error` of a fold, in every other window a
// little more and a little less.
mk::HeldOutFigures figures(const std::vector<double> &error, double unrest = 0.05)
{
    mk::HeldOutFigures f;
    for (size_t fold = 0; fold < error.size(); fold++)
        for (size_t w = 0; w < WINDOWS; w++) {
            const double square = error[fold] * (w % 2 ? 1.0 + unrest : 1.0 - unrest);
            f.window.push_back(square);
            f.part[0].push_back(square);
            f.part[1].push_back(0.0);
            f.log.push_back((int)fold);
            f.square[0] += square;
            f.rows[0] += 1.0;
        }
    return f;
}

// Log likelihood that a cause gains: more than by chance; and more than can be doubted.
constexpr double LIKELY = 10.0, WITHOUT_DOUBT = 100.0;

mk::Carried compared(const std::vector<double> &with, const std::vector<double> &without)
{
    const mk::HeldOutFigures less = figures(without);
    return mk::carry_over::compare(figures(with, 0.02), less, less, NO_FLOOR, 1);
}

} // namespace

START_TEST(a_cause_that_helps_in_every_fold_carries_over)
{
    const mk::Carried c = compared({0.5, 0.6, 0.55, 0.5}, {1.0, 1.0, 1.0, 1.0});
    ck_assert_int_eq(c.folds, 4);
    ck_assert_int_eq(c.better, 4);
    ck_assert_double_eq_tol(c.share, 1.0 - (0.5 + 0.6 + 0.55 + 0.5) / 4.0, 1e-9);
    ck_assert(mk::carry_over::promising(c));
    ck_assert(mk::carry_over::enough(c, 1, LIKELY));
    ck_assert_double_gt(c.inclusion, 0.99);
}
END_TEST

START_TEST(what_helps_one_fold_and_hurts_the_others_does_not)
{
    const mk::Carried c = compared({0.01, 1.2, 1.3, 1.2}, {1.0, 1.0, 1.0, 1.0});
    ck_assert_double_lt(c.mean, 0.0); // in the mean it looks well
    ck_assert(!mk::carry_over::promising(c));
    ck_assert(!mk::carry_over::enough(c, 1, LIKELY));
}
END_TEST

START_TEST(a_cause_that_does_not_show_in_some_folds_is_not_worse_there)
{
    // Where nothing is missed, more parameters scatter more about nothing.
    const mk::Carried c = compared({0.01, 2e-3, 0.02, 2e-3}, {1.0, 1e-3, 1.0, 1e-3});
    ck_assert_int_eq(c.better, 2);
    ck_assert_int_eq(c.worse, 0);
    ck_assert(mk::carry_over::enough(c, 4, LIKELY));
}
END_TEST

START_TEST(a_gain_of_no_size_is_no_cause_however_sure)
{
    const mk::Carried c = compared({0.97, 0.97, 0.97, 0.97}, {1.0, 1.0, 1.0, 1.0});
    ck_assert_double_lt(c.mean, -2.0 * c.error);
    ck_assert(!mk::carry_over::promising(c));
}
END_TEST

START_TEST(half_of_the_least_share_is_enough_to_be_tried_beside_others)
{
    const mk::Carried c = compared({0.96, 0.96, 0.96, 0.96}, {1.0, 1.0, 1.0, 1.0});
    ck_assert(!mk::carry_over::enough(c, 1, WITHOUT_DOUBT));
    ck_assert(mk::carry_over::enough(c, 1, WITHOUT_DOUBT, 0.5));
    const mk::Carried less = compared({0.98, 0.98, 0.98, 0.98}, {1.0, 1.0, 1.0, 1.0});
    ck_assert(!mk::carry_over::enough(less, 1, WITHOUT_DOUBT, 0.5));
}
END_TEST

// Most of the gap is closed; of what is left two thirds go.
START_TEST(a_part_of_a_small_rest_is_a_finding_near_the_noise_alone)
{
    const mk::HeldOutFigures refit = figures({1.0, 1.0, 1.0, 1.0});
    const mk::HeldOutFigures less = figures({0.03, 0.03, 0.03, 0.03});
    const mk::HeldOutFigures with = figures({0.01, 0.01, 0.01, 0.01});
    const double near[MK_MAX_JOINTS] = {0.05, 0.05}, far[MK_MAX_JOINTS] = {1e-4, 1e-4};
    const mk::Carried c = mk::carry_over::compare(with, less, refit, near, 1);
    ck_assert(mk::carry_over::enough(c, 1, WITHOUT_DOUBT));
    ck_assert(mk::carry_over::worth_naming(c));
    const mk::Carried d = mk::carry_over::compare(with, less, refit, far, 1);
    ck_assert(mk::carry_over::enough(d, 1, WITHOUT_DOUBT));
    ck_assert(!mk::carry_over::worth_naming(d));
    // A good part of the gap is one however far the noise is.
    ck_assert(mk::carry_over::worth_naming(mk::carry_over::compare(less, refit, refit, far, 1)));
}
END_TEST

START_TEST(the_more_models_were_asked_the_surer_one_must_be)
{
    const mk::Carried c = compared({0.5, 0.7, 0.5, 0.65, 0.5, 0.6, 1.1, 0.55},
                                   {1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0});
    ck_assert(mk::carry_over::enough(c, 1, LIKELY));
    ck_assert(!mk::carry_over::enough(c, 1000, LIKELY));
}
END_TEST

// How much of it is gone differs from fold to fold; that it is gone does not.
START_TEST(what_is_better_in_every_fold_is_sure_though_folds_differ_in_how_much)
{
    const mk::Carried c = compared({0.1, 0.4, 0.02, 0.5}, {1.0, 1.0, 1.0, 1.0});
    ck_assert_double_gt(c.mean, -4.0 * c.error);
    ck_assert(mk::carry_over::enough(c, 4, LIKELY));
    const mk::Carried one_worse = compared({0.1, 1.1, 0.02, 0.5}, {1.0, 1.0, 1.0, 1.0});
    ck_assert(!mk::carry_over::enough(one_worse, 4, LIKELY));
}
END_TEST

// A log that is not of one kind with the others may be as it was without the cause.
START_TEST(one_fold_of_four_has_no_veto_where_the_likelihood_leaves_no_doubt)
{
    const mk::Carried c = compared({0.6, 0.25, 1.1, 0.7}, {1.0, 1.0, 1.0, 1.0});
    ck_assert(!mk::carry_over::enough(c, 2, LIKELY));
    ck_assert(mk::carry_over::enough(c, 2, WITHOUT_DOUBT));
    const mk::Carried two = compared({0.3, 0.25, 1.1, 1.1}, {1.0, 1.0, 1.0, 1.0});
    ck_assert(!mk::carry_over::enough(two, 2, WITHOUT_DOUBT));
}
END_TEST

START_TEST(where_the_likelihood_leaves_no_doubt_folds_in_which_nothing_shows_have_no_vote)
{
    // One window of six in two folds of four: too few for windows to be sure.
    mk::HeldOutFigures with = figures({1.0, 1.0, 1.0, 1.0}, 0.0), less = with;
    for (size_t fold : {0, 1})
        with.part[0][fold * WINDOWS] = with.window[fold * WINDOWS] = 0.01, with.square[0] -= 0.99;
    const mk::Carried c = mk::carry_over::compare(with, less, less, NO_FLOOR, 1);
    ck_assert_int_eq(c.better, 2);
    ck_assert_int_eq(c.worse, 0);
    ck_assert(!mk::carry_over::enough(c, 1, LIKELY));
    ck_assert(mk::carry_over::enough(c, 1, WITHOUT_DOUBT));
}
END_TEST

START_TEST(where_the_likelihood_leaves_no_doubt_one_window_that_missed_most_is_enough)
{
    // A limit that is met once, by chance hardly in a second fold, and costs a trifle elsewhere:
    // the mean is within its standard error of nothing.
    mk::HeldOutFigures less = figures({1.0, 1.0, 1.0, 1.0}, 0.0);
    less.part[0][0] = less.window[0] = 3.0, less.square[0] += 2.0;
    mk::HeldOutFigures with = less;
    const auto becomes = [&](size_t w, double square) {
        with.square[0] += square - with.window[w];
        with.part[0][w] = with.window[w] = square;
    };
    becomes(0, 0.03);
    becomes(WINDOWS, 0.97);
    for (size_t w = 2 * WINDOWS; w < 4 * WINDOWS; w++)
        becomes(w, 1.01);
    const mk::Carried c = mk::carry_over::compare(with, less, less, NO_FLOOR, 1);
    ck_assert_int_eq(c.better, 2);
    ck_assert_int_eq(c.worse, 0);
    ck_assert(!mk::carry_over::promising(c));
    ck_assert(!mk::carry_over::enough(c, 1, LIKELY));
    ck_assert(mk::carry_over::enough(c, 1, WITHOUT_DOUBT));
}
END_TEST

START_TEST(what_the_likelihood_does_not_ask_for_is_no_cause_however_it_predicts)
{
    const mk::Carried c = compared({0.5, 0.6, 0.55, 0.5}, {1.0, 1.0, 1.0, 1.0});
    ck_assert(!mk::carry_over::enough(c, 1, 1.0));
}
END_TEST

START_TEST(nothing_is_to_be_closed_where_the_refitted_model_is_at_the_noise)
{
    const double floor[MK_MAX_JOINTS] = {1.0, 0.0};
    const mk::HeldOutFigures refit = figures({1.0, 1.0, 1.0, 1.0});
    const mk::Carried c =
        mk::carry_over::compare(figures({0.5, 0.5, 0.5, 0.5}), refit, refit, floor, 1);
    ck_assert(!c.judged);
}
END_TEST

START_TEST(better_in_all_logs_or_by_two_standard_errors_is_surely_better)
{
    const mk::HeldOutFigures one = figures({1.0, 1.0, 1.0, 1.0});
    // Far apart, each for the better.
    ck_assert(mk::surely_better(mk::ratio_by_log(figures({0.05, 0.9, 0.8, 0.9}), one)));
    ck_assert(mk::surely_better(mk::ratio_by_log(figures({0.5, 0.5, 0.5, 1.01, 0.5, 0.5}),
                                                 figures({1.0, 1.0, 1.0, 1.0, 1.0, 1.0}))));
    ck_assert(!mk::surely_better(mk::ratio_by_log(figures({0.05, 1.1, 0.8, 0.9}), one)));
    // Both of two logs, and that not by a few of their windows alone.
    const mk::HeldOutFigures two = figures({1.0, 1.0});
    ck_assert(mk::surely_better(mk::ratio_by_log(figures({0.5, 0.6}), two)));
    ck_assert(!mk::surely_better(mk::ratio_by_log(figures({0.9, 0.85}, 0.6), two)));
    ck_assert(!mk::surely_better(mk::ratio_by_log(figures({0.98, 0.97, 0.96, 0.97}), one)));
}
END_TEST

/* --- parts of logs --------------------------------------------------------------------------- */

START_TEST(a_part_of_a_log_knows_when_the_run_began)
{
    constexpr size_t ROWS = 400, FIRST = 100;
    mk_model m;
    mk_record record;
    mk_log *log = nullptr;
    mk_model_default(MK_PLANT_PENDULUM, &m);
    ck_assert_int_eq(mk_log_create(ROWS, &log), MK_OK);
    double *t = mk_log_add_column(log, "t"), *q = mk_log_add_column(log, "q1");
    double *u = mk_log_add_column(log, "u");
    for (size_t k = 0; k < ROWS; k++) {
        t[k] = 5.0 + 0.01 * (double)k;
        q[k] = std::sin(3.0 * t[k]);
        u[k] = 0.0;
    }
    const mk::OwnedLog part = mk::rows_of_log(*log, FIRST, ROWS);
    ck_assert_int_eq(mk_record_from_log(part.get(), &m, &record, nullptr), MK_OK);
    ck_assert_uint_eq(record.rows, ROWS - FIRST);
    ck_assert_double_eq_tol(record.begins, 5.0, 1e-12);
    ck_assert_double_eq_tol(mk::fit_log(record, m, 0, record.rows).start, 1.0, 1e-12);
    // And a part of the part.
    const mk::OwnedLog less = mk::rows_of_log(*part, FIRST, ROWS - FIRST);
    ck_assert_int_eq(mk_record_from_log(less.get(), &m, &record, nullptr), MK_OK);
    ck_assert_double_eq_tol(mk::fit_log(record, m, 0, record.rows).start, 2.0, 1e-12);
    mk_log_free(log);
}
END_TEST

extern "C" Suite *suite_carry_over(void)
{
    Suite *s = suite_create("carry_over");
    TCase *t = tcase_create("folds");
    tcase_add_test(t, a_cause_that_helps_in_every_fold_carries_over);
    tcase_add_test(t, what_helps_one_fold_and_hurts_the_others_does_not);
    tcase_add_test(t, a_cause_that_does_not_show_in_some_folds_is_not_worse_there);
    tcase_add_test(t, a_gain_of_no_size_is_no_cause_however_sure);
    tcase_add_test(t, half_of_the_least_share_is_enough_to_be_tried_beside_others);
    tcase_add_test(t, what_is_better_in_every_fold_is_sure_though_folds_differ_in_how_much);
    tcase_add_test(t, a_part_of_a_small_rest_is_a_finding_near_the_noise_alone);
    tcase_add_test(t, the_more_models_were_asked_the_surer_one_must_be);
    tcase_add_test(t, one_fold_of_four_has_no_veto_where_the_likelihood_leaves_no_doubt);
    tcase_add_test(t,
                   where_the_likelihood_leaves_no_doubt_folds_in_which_nothing_shows_have_no_vote);
    tcase_add_test(t, where_the_likelihood_leaves_no_doubt_one_window_that_missed_most_is_enough);
    tcase_add_test(t, what_the_likelihood_does_not_ask_for_is_no_cause_however_it_predicts);
    tcase_add_test(t, nothing_is_to_be_closed_where_the_refitted_model_is_at_the_noise);
    tcase_add_test(t, better_in_all_logs_or_by_two_standard_errors_is_surely_better);
    tcase_add_test(t, a_part_of_a_log_knows_when_the_run_began);
    suite_add_tcase(s, t);
    return s;
}
