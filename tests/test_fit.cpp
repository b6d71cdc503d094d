// The fit of multiple shooting: what it computes once and what it must compute again.
#include "ident/fit.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "suites.h"

namespace
{

// Readings of a pendubot that no model makes: two sums of sines, with a digit of their own.
struct Swings {
    std::vector<double> t, u, q[2];
    mk_model model;
    mk::FitLog log;

    Swings()
    {
        mk_model_default(MK_PLANT_PENDUBOT, &model);
        for (int k = 0; k < 400; k++) {
            const double s = 0.005 * k;
            t.push_back(s);
            u.push_back(std::sin(5.0 * s));
            q[0].push_back(-M_PI / 2 + 0.4 * std::sin(4.0 * s) + 1e-3 * std::sin(977.0 * s));
            q[1].push_back(0.3 * std::sin(6.0 * s + 1.0) + 2e-3 * std::sin(1013.0 * s));
        }
        mk_record record = {};
        record.rows = t.size();
        record.t = t.data(), record.u[0] = u.data();
        record.q[0] = q[0].data(), record.q[1] = q[1].data();
        log = mk::fit_log(record, model, 0, record.rows);
    }
};

// Largest difference of two quadratic models, relative to their own size.
double difference(const mk::QuadraticModel &a, const mk::QuadraticModel &b)
{
    ck_assert(a.finite && b.finite);
    return std::max({(a.information - b.information).norm() / b.information.norm(),
                     (a.gradient - b.gradient).norm() / b.gradient.norm(),
                     std::fabs(a.nlml - b.nlml) / std::fabs(b.nlml)});
}

} // namespace

// Work of a fit, in passes over the data, that a quadratic model takes.
static double work_of(mk::Fit &fit, const mk::FitPoint &point, mk::QuadraticModel &quadratic)
{
    const double before = fit.work_done;
    quadratic = fit.quadratic(point, mk::fitted_parameters(point.model));
    return fit.work_done - before;
}

START_TEST(derivatives_of_a_point_are_taken_once)
{
    const Swings swings;
    mk::Fit fit({&swings.log}, {});
    const mk::FitPoint point = fit.start(swings.model);
    mk::QuadraticModel first, again;
    const double once = work_of(fit, point, first);
    // What is tried beside the point does not take them away.
    mk::FitPoint beside = point;
    beside.model.parameter[0] *= 1.1;
    (void)fit.cost(beside);
    ck_assert_double_lt(work_of(fit, point, again), 0.4 * once);
    ck_assert_double_lt(difference(again, first), 1e-12);
}
END_TEST

// The slopes of readings do not change with their noise: what they weigh does.
START_TEST(derivatives_that_are_known_count_at_the_noise_that_is_now)
{
    const Swings swings;
    mk::Fit fit({&swings.log}, {}), fresh({&swings.log}, {});
    mk::FitPoint point = fit.start(swings.model);
    mk::QuadraticModel known, anew;
    const double once = work_of(fit, point, known);
    point.noise[0] *= 3.0, point.noise[1] *= 0.5;
    ck_assert_double_lt(work_of(fit, point, known), 0.4 * once);
    (void)work_of(fresh, point, anew);
    ck_assert_double_lt(difference(known, anew), 1e-9);
}
END_TEST

// i: what is another.
START_TEST(derivatives_of_another_point_are_taken_anew)
{
    const Swings swings;
    mk::Fit fit({&swings.log}, {}), fresh({&swings.log}, {});
    mk::FitPoint point = fit.start(swings.model);
    mk::QuadraticModel found, anew;
    const double once = work_of(fit, point, found);
    if (_i == 0)
        point.model.parameter[1] *= 1.05;
    else if (_i == 1)
        point.nodes[0].x(1, 3) += 0.1;
    else if (_i == 2)
        point.step = 1e-3;
    else
        ck_assert_int_eq(mk_model_add_effect(&point.model, "torque-scale", 0, nullptr), MK_OK);
    ck_assert_double_gt(work_of(fit, point, found), 0.9 * once);
    (void)work_of(fresh, point, anew);
    ck_assert_double_eq(difference(found, anew), 0.0);
}
END_TEST

// From a point nearby what the best values come to is reached, and a thousandth of it is not: no
// model makes these readings.
START_TEST(a_minimisation_ends_at_once_where_what_is_worth_it_is_out_of_reach)
{
    const Swings swings;
    mk::Fit whole({&swings.log}, {});
    mk::FitPoint best = whole.start(swings.model);
    const std::vector<int> free = mk::fitted_parameters(best.model);
    ck_assert(whole.minimise(best, free));
    best.model.parameter[0] *= 1.1;
    double work = 0.0;
    for (const double share : {1.01, 1e-3}) {
        mk::Fit fit({&swings.log}, {});
        mk::FitPoint point = best;
        fit.options.worth = share * best.cost;
        const bool fitted = fit.minimise(point, free);
        ck_assert_msg(fitted == (share > 1.0), "%g: cost %g of %g", share, point.cost, best.cost);
        if (fitted)
            work = fit.work_done;
        else
            ck_assert_double_lt(fit.work_done, 0.7 * work);
    }
}
END_TEST

extern "C" Suite *suite_fit(void)
{
    Suite *s = suite_create("fit");
    TCase *t = tcase_create("derivatives");
    tcase_add_test(t, derivatives_of_a_point_are_taken_once);
    tcase_add_test(t, derivatives_that_are_known_count_at_the_noise_that_is_now);
    tcase_add_loop_test(t, derivatives_of_another_point_are_taken_anew, 0, 4);
    suite_add_tcase(s, t);
    TCase *work = tcase_create("work");
    tcase_add_test(work, a_minimisation_ends_at_once_where_what_is_worth_it_is_out_of_reach);
    suite_add_tcase(s, work);
    return s;
}
