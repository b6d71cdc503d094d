// Free runs as least squares: what a fit to some logs says of another one, and what effects
// remember. Data are those of an independent simulator.
#include "ident/free_runs.hpp"
#include "ident/thin_record.hpp"

#include "suites.h"

#include <cmath>
#include <cstring>
#include <vector>

#include "mechkit/ident.h"
#include "sim/effect_memory.hpp"
#include "support/cases.hpp"

namespace
{

constexpr size_t LOGS = 4;
constexpr double WINDOW = 0.5; // s

truth::OwnedLog record(const std::vector<truth::Effect> &effects, uint64_t seed)
{
    return truth::usual_log(MK_PLANT_PENDULUM, effects, seed);
}

struct Runs {
    std::vector<truth::OwnedLog> logs;
    std::vector<std::vector<const mk_log *>> folds;
    mk_model model;

    explicit Runs(const std::vector<truth::Effect> &effects)
    {
        mk_model_default(MK_PLANT_PENDULUM, &model);
        for (size_t i = 0; i < LOGS; i++) {
            logs.push_back(record(effects, 31 + i));
            folds.push_back({logs.back().get()});
        }
    }
};

const truth::Effect DRAG = {"quadratic-drag", 1, {{"coefficient", 1e-3}}};

} // namespace

// The model lacks an air brake, so that folds differ in what they want of its parameters. What a
// window counts is as in the fit to all logs, so it is known to within a fifth.
START_TEST(what_a_fit_to_the_other_logs_leaves_is_known_without_making_it)
{
    const Runs runs({DRAG});
    mk::FreeRuns all(runs.folds, runs.model, WINDOW, 1);
    mk::RunPoint point = all.start(runs.model);
    const std::vector<int> free = mk::fitted_parameters(runs.model);
    mk::RunQuadraticModel quadratic;
    all.take_scale(point);
    ck_assert(all.minimise(point, free, 20, 1, quadratic));
    mk::HeldOutFigures left_out;
    ck_assert(all.left_out(point, quadratic, free, false, left_out));
    for (size_t f = 0; f < LOGS; f++) {
        std::vector<std::vector<const mk_log *>> others = runs.folds, one = {runs.folds[f]};
        others.erase(others.begin() + (std::ptrdiff_t)f);
        mk::FreeRuns rest(others, runs.model, WINDOW, 1), alone(one, runs.model, WINDOW, 1);
        mk::RunPoint fitted = rest.start(point.model);
        mk::RunQuadraticModel unused, there;
        rest.take_scale(fitted);
        ck_assert(rest.minimise(fitted, free, 20, 1, unused));
        mk::RunPoint judged = alone.start(fitted.model);
        ck_assert(alone.linearise(judged, free, true, 1, there));
        double made = 0.0, said = 0.0;
        for (const mk::WindowQuadratic &w : there.window)
            made += w.squares[0];
        for (size_t w = 0; w < left_out.window.size(); w++)
            said += left_out.log[w] == (int)f ? left_out.part[0][w] : 0.0;
        double counts = all.relative(0, mk_model_count(&runs.model, 0));
        made *= counts * counts;
        ck_assert_msg(std::fabs(said - made) < 0.2 * made, "fold %zu: %g said, %g made", f, said,
                      made);
    }
}
END_TEST

START_TEST(the_law_that_is_missing_is_what_the_left_out_logs_ask_for)
{
    const Runs runs({DRAG});
    mk::FreeRuns all(runs.folds, runs.model, WINDOW, 1);
    double left[3];
    const char *const laws[] = {nullptr, "quadratic-drag", "torque-offset"};
    for (int i = 0; i < 3; i++) {
        mk_model m = runs.model;
        if (laws[i])
            ck_assert_int_eq(mk_model_add_effect(&m, laws[i], 1, nullptr), MK_OK);
        mk::RunPoint point = all.start(m);
        if (i == 0)
            all.take_scale(point);
        mk::RunQuadraticModel quadratic;
        mk::HeldOutFigures f;
        const std::vector<int> free = mk::fitted_parameters(m);
        ck_assert(all.minimise(point, free, 20, 1, quadratic));
        ck_assert(all.left_out(point, quadratic, free, false, f));
        left[i] = f.square[0];
    }
    ck_assert_msg(left[1] < 0.05 * left[0], "drag leaves %g of %g", left[1], left[0]);
    ck_assert_msg(left[2] > 0.5 * left[0], "an offset leaves %g of %g", left[2], left[0]);
}
END_TEST

// A spring whose rest lies elsewhere in every log: its own value is learnt from a log's first half.
// What was usual before a cause was found must not hide what the next one gains.
START_TEST(what_errors_say_of_a_model_does_not_depend_on_what_was_usual)
{
    const Runs runs({DRAG});
    mk::FreeRuns all(runs.folds, runs.model, WINDOW, 1);
    const std::vector<int> free = mk::fitted_parameters(runs.model);
    mk::RunPoint far = all.start(runs.model), near = far;
    for (int i = 0; i < mk_plant(MK_PLANT_PENDULUM)->parameter_count; i++)
        far.model.parameter[i] *= 1.5;
    mk::RunQuadraticModel quadratic;
    ck_assert(all.linearise(near, free, true, 1, quadratic));
    near.cost = all.cost(near, quadratic);
    const mk::QuadraticModel before = all.information(near, quadratic);
    all.take_scale(far);
    const mk::QuadraticModel after = all.information(near, quadratic);
    ck_assert_double_eq_tol(before.nlml, after.nlml, 1e-9 * std::fabs(before.nlml));
    ck_assert_double_lt(all.cost(near, quadratic), 0.9 * near.cost); // while the cost does
}
END_TEST

// Somebody touches the rig: free runs from there are far off, whatever the model.
START_TEST(a_window_that_nobody_predicts_does_not_decide)
{
    constexpr double KICK = 0.5; // rad, for a tenth of a second
    Runs runs({});
    double inertia[2];
    for (const bool kicked : {false, true}) {
        mk_log &log = *runs.logs[1];
        for (size_t c = 0; c < log.column_count && kicked; c++)
            for (size_t k = log.rows / 2; k < log.rows / 2 + log.rows / 40; k++)
                if (std::strcmp(log.columns[c].name, "q1") == 0)
                    log.columns[c].data[k] += KICK;
        const mk::FreeRuns all(runs.folds, runs.model, WINDOW, 1);
        mk::RunPoint point = all.start(runs.model);
        mk::RunQuadraticModel quadratic;
        ck_assert(all.converge(point, mk::fitted_parameters(runs.model), 1, quadratic));
        inertia[kicked] = point.model.parameter[0];
    }
    ck_assert_msg(std::fabs(inertia[1] / inertia[0] - 1.0) < 0.01, "inertia %g, with a kick %g",
                  inertia[0], inertia[1]);
}
END_TEST

// Parameters are far off at first, and with them the states that runs start from.
START_TEST(a_settled_fit_gains_nothing_from_states_that_are_found_anew)
{
    std::vector<truth::OwnedLog> logs;
    std::vector<std::vector<const mk_log *>> folds;
    for (size_t i = 0; i < LOGS; i++) {
        logs.push_back(
            truth::usual_log(MK_PLANT_PENDUBOT, {{"coulomb", 2, {{"level", 0.003}}}}, 61 + i));
        folds.push_back({logs.back().get()});
    }
    mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    const std::vector<int> free = mk::fitted_parameters(m);
    mk::FreeRuns all(folds, m, WINDOW, 1);
    for (int i = 0; i < mk_plant(MK_PLANT_PENDUBOT)->parameter_count; i++)
        m.parameter[i] *= i % 2 ? 1.3 : 0.7;
    mk::RunPoint point = all.start(m);
    all.take_scale(point);
    mk::RunQuadraticModel quadratic, there;
    ck_assert(all.converge(point, free, 1, quadratic));
    mk::RunPoint anew = all.start(point.model);
    ck_assert(all.minimise(anew, free, 20, 1, there));
    ck_assert_double_gt(anew.cost, point.cost - 1.0);
}
END_TEST

START_TEST(a_value_of_a_logs_own_comes_from_its_first_half)
{
    std::vector<truth::OwnedLog> logs;
    std::vector<std::vector<const mk_log *>> folds;
    const double rest[LOGS] = {0.3, -0.2, 0.1, -0.4};
    for (size_t i = 0; i < LOGS; i++) {
        logs.push_back(
            record({{"cable-stiffness", 1, {{"stiffness", 0.02}, {"rest", rest[i]}}}}, 41 + i));
        folds.push_back({logs.back().get()});
    }
    mk_model m;
    mk_model_default(MK_PLANT_PENDULUM, &m);
    ck_assert_int_eq(mk_model_add_effect(&m, "cable-stiffness", 1, nullptr), MK_OK);
    m.effect[0].value[0] = 0.01;
    m.effect[0].value[1] = 0.0;
    mk_model own = m;
    own.effect[0].spread[1] = 0.1;
    mk::FreeRuns runs(folds, m, WINDOW, 1);
    double left[2];
    for (int i = 0; i < 2; i++) {
        const mk_model &one = i ? own : m;
        mk::RunPoint point = runs.start(one);
        if (i == 0)
            runs.take_scale(point);
        mk::RunQuadraticModel quadratic;
        mk::HeldOutFigures f;
        const std::vector<int> free = mk::fitted_parameters(one);
        ck_assert(runs.minimise(point, free, 30, 1, quadratic));
        ck_assert(runs.left_out(point, quadratic, free, true, f));
        const double rounding = runs.relative(0, mk_model_count(&m, 0));
        left[i] = f.square[0] - f.rows[0] * rounding * rounding / 12.0;
        if (i == 1) {
            const double spread = point.model.effect[0].spread[1];
            ck_assert_msg(spread > 0.15 && spread < 0.5, "spread %g rad", spread);
        }
    }
    ck_assert_msg(left[1] < 0.1 * left[0], "own rests leave %g of %g", left[1], left[0]);
}
END_TEST

// The state of a cable with hysteresis at the start of a window is what the whole run up to there
// makes of it, not what would fit the window best.
START_TEST(what_an_effect_remembers_comes_from_all_readings_before_the_window)
{
    constexpr double STIFFNESS = 0.05, YIELD = 0.4;
    const truth::OwnedLog log =
        record({{"cable-hysteresis", 1, {{"stiffness", STIFFNESS}, {"yield", YIELD}}}}, 51);
    mk_model m;
    mk_record r;
    mk_model_default(MK_PLANT_PENDULUM, &m);
    ck_assert_int_eq(mk_model_add_effect(&m, "cable-hysteresis", 1, nullptr), MK_OK);
    m.effect[0].value[0] = STIFFNESS;
    m.effect[0].value[1] = YIELD;
    ck_assert_int_eq(mk_record_from_log(log.get(), &m, &r, nullptr), MK_OK);
    std::unique_ptr<mk_start_finder> finder = mk::basic_finder(r, m);
    finder->way = mk::way_of(r, m);
    mk::remember(*finder);
    // The law along the readings, by small steps: dz = dq - |dq| z |z| / yield^2.
    double z = 0.0, worst = 0.0, most = 0.0;
    for (size_t k = 1; k < r.rows; k++) {
        const double dq = r.q[0][k] - r.q[0][k - 1];
        z += dq - std::fabs(dq) * z * std::fabs(z) / (YIELD * YIELD);
        most = std::max(most, std::fabs(z));
        if (k % 50 == 0)
            worst = std::max(worst, std::fabs(mk::remembered(*finder, k)(0) - z));
    }
    ck_assert_double_gt(most, 0.2 * YIELD);
    ck_assert_msg(worst < 0.03 * most, "off by %g rad of %g", worst, most);
}
END_TEST

// Two cables, so that the memory has two states that do not know of each other, and a model that
// lacks something. Central differences of the memory itself, each found from rest.
START_TEST(what_an_effect_remembers_has_the_derivatives_of_its_differences)
{
    const truth::OwnedLog log = record({DRAG}, 52);
    mk_model m;
    mk_record r;
    mk_model_default(MK_PLANT_PENDULUM, &m);
    for (int e = 0; e < 2; e++) {
        ck_assert_int_eq(mk_model_add_effect(&m, "cable-hysteresis", 1, nullptr), MK_OK);
        m.effect[e].value[0] = 0.05;
        m.effect[e].value[1] = e ? 0.3 : 0.9;
    }
    ck_assert_int_eq(mk_record_from_log(log.get(), &m, &r, nullptr), MK_OK);
    const std::vector<int> parameters = mk::fitted_parameters(m);
    const std::vector<double> units(parameters.size(), 1.0);
    const std::shared_ptr<const mk::Way> way = mk::way_of(r, m);
    const auto memory_of = [&](const mk_model &model, const std::vector<int> &by) {
        std::unique_ptr<mk_start_finder> finder = mk::basic_finder(r, model);
        finder->way = way;
        mk::remember(*finder, by, std::vector<double>(by.size(), 1.0));
        return finder->memory;
    };
    const mk::Memory at = memory_of(m, parameters);
    const long p = (long)parameters.size(), places = at.z.cols();
    for (long i = 0; i < p; i++) {
        const int number = parameters[(size_t)i];
        const double step = 1e-3 * std::max(std::fabs(mk_model_parameter(&m, number)), 0.01);
        mk_model less = m, more = m;
        mk_model_set_parameter(&less, number, mk_model_parameter(&m, number) - step);
        mk_model_set_parameter(&more, number, mk_model_parameter(&m, number) + step);
        const Eigen::MatrixXd differences =
            (memory_of(more, {}).z - memory_of(less, {}).z) / (2.0 * step);
        double worst = 0.0;
        for (long k = 0; k < places; k++)
            worst = std::max(worst, (at.slope.col(p * k + i) - differences.col(k)).norm());
        const double most = differences.colwise().norm().maxCoeff();
        ck_assert_msg(worst < 0.02 * most + 1e-9, "parameter %d: off by %g of %g", number, worst,
                      most);
    }
}
END_TEST

// A cable whose yield is wrong: where a window begins the cable has a past, which changes with the
// yield. The slope of the cost by the yield counts that in; central differences, with start states
// settled at each yield, do not know of slopes.
START_TEST(the_slope_of_the_cost_counts_in_what_effects_remember)
{
    constexpr double YIELD = 0.8, STEP = 0.04;
    const truth::Effect cable = {"cable-hysteresis", 1, {{"stiffness", 0.05}, {"yield", 0.4}}};
    const Runs given({cable});
    mk_model m = given.model;
    ck_assert_int_eq(mk_model_add_effect(&m, "cable-hysteresis", 1, nullptr), MK_OK);
    m.effect[0].value[0] = 0.05;
    mk::FreeRuns runs(given.folds, m, WINDOW, 1);
    const std::vector<int> yield = {mk_model_parameter_count(&m) - 1};
    double cost[3], slope = 0.0;
    for (int i = 0; i < 3; i++) {
        m.effect[0].value[1] = YIELD + (i - 1) * STEP;
        mk::RunPoint point = runs.start(m);
        mk::RunQuadraticModel quadratic;
        ck_assert(runs.minimise(point, yield, 0, 1, quadratic));
        cost[i] = point.cost;
        if (i == 1)
            slope = -runs.information(point, quadratic).gradient(0) /
                    mk::Fit::scale_of(point.model, yield[0]);
    }
    const double difference = (cost[2] - cost[0]) / (2.0 * STEP);
    ck_assert_msg(std::fabs(slope / difference - 1.0) < 0.1, "slope %g, differences %g", slope,
                  difference);
}
END_TEST

// From a start state that stays, dS/dp = -2 J'r to the accuracy of differences. Derivatives that
// are only close are off by 3e-4, as much as parameters that make up for each other differ.
START_TEST(what_a_window_says_of_parameters_is_the_slope_of_its_squares)
{
    constexpr double STEP = 1e-5, LONGEST_STEP = 5e-3;
    constexpr size_t FROM = 50, ROWS = 120;
    const Runs given({});
    mk_model m = given.model;
    mk_record log;
    ck_assert_int_eq(mk_record_from_log(given.folds[0][0], &m, &log, nullptr), MK_OK);
    const std::vector<int> free = {0, 1, 2};
    const std::vector<double> unit(free.size(), 1.0);
    const auto finder_of = [&](const mk_model &model) {
        std::unique_ptr<mk_start_finder> finder = mk::basic_finder(log, model);
        finder->step = LONGEST_STEP;
        return finder;
    };
    const std::unique_ptr<mk_start_finder> finder = finder_of(m);
    std::vector<mk::WindowFit> fits;
    fits.emplace_back(*finder, FROM, FROM + ROWS);
    fits[0].differentiate_by(free, unit);
    const std::vector<Eigen::VectorXd> x = {Eigen::Vector2d(1.0, 2.0)};
    std::vector<mk::WindowNormal> said;
    ck_assert(mk::WindowFit::normals_at(fits, x, said)[0]);
    for (size_t i = 0; i < free.size(); i++) {
        double squares[2];
        for (const int side : {0, 1}) {
            mk_model moved = m;
            const double value = mk_model_parameter(&m, free[i]);
            mk_model_set_parameter(&moved, free[i], value * (side ? 1.0 + STEP : 1.0 - STEP));
            const std::unique_ptr<mk_start_finder> there = finder_of(moved);
            squares[side] = mk::WindowFit(*there, FROM, FROM + ROWS).cost(x[0]);
        }
        const double difference =
            (squares[1] - squares[0]) / (2.0 * STEP * mk_model_parameter(&m, free[i]));
        const double slope = -2.0 * said[0].g(2 + (long)i);
        ck_assert_msg(std::fabs(slope / difference - 1.0) < 1e-5, "parameter %d: %.9g, not %.9g",
                      free[i], slope, difference);
    }
}
END_TEST

// 1 kHz, joint 1 read in every row and joint 2 in every fifth, rows 10 to 12 left out, one command
// missing.
START_TEST(a_thinned_record_keeps_the_commands_integral_and_a_reading_of_every_joint)
{
    constexpr size_t ROWS = 41;
    constexpr double HELD = 0.004;
    double t[ROWS], u[ROWS], q[2][ROWS], out[ROWS] = {};
    for (size_t k = 0; k < ROWS; k++) {
        t[k] = 1e-3 * (double)k;
        u[k] = std::sin(0.9 * (double)k);
        q[0][k] = (double)k;
        q[1][k] = k % 5 == 2 ? (double)k : (double)NAN;
        out[k] = k >= 10 && k < 13;
    }
    u[21] = (double)NAN;
    mk_record r = {};
    r.rows = ROWS;
    r.t = t, r.q[0] = q[0], r.q[1] = q[1], r.u[0] = u, r.left_out = out;
    const mk::ThinRecord thin = mk::thinned(r, 2, HELD);
    const mk_record &made = thin.record;
    ck_assert_uint_lt(made.rows, ROWS);
    double given = 0.0, kept = 0.0;
    for (size_t k = 0; k + 1 < ROWS; k++)
        given += k >= 21 && k < 25 ? 0.0 : 1e-3 * u[k]; // the stretch with a command missing
    size_t readings[2] = {};
    for (size_t k = 0; k < made.rows; k++) {
        const size_t row = (size_t)std::lround(made.t[k] * 1e3);
        ck_assert(made.left_out[k] == out[row]);
        for (int j = 0; j < 2; j++)
            if (!std::isnan(made.q[j][k])) {
                ck_assert(made.q[j][k] == (double)row);
                readings[j]++;
            }
        if (k + 1 < made.rows && (row < 21 || row >= 25))
            kept += made.u[0][k] * (made.t[k + 1] - made.t[k]);
        ck_assert(std::isfinite(made.u[0][k]));
    }
    ck_assert_double_eq_tol(kept, given, 1e-12);
    // Stretches of four rows, two of the parts beside rows 10 to 12, and those.
    ck_assert_uint_ge(readings[0], 10);
    ck_assert_uint_le(readings[0], 12);
    ck_assert_uint_eq(readings[1], 8);
    // Rows that are further apart than that stay as they are.
    for (double &time : t)
        time *= 5.0;
    const mk::ThinRecord same = mk::thinned(r, 2, HELD);
    ck_assert_uint_eq(same.record.rows, ROWS);
    ck_assert_double_eq(same.record.u[0][7], u[7]);
}
END_TEST

START_TEST(a_log_without_readings_says_nothing_of_what_effects_remember)
{
    Runs given({DRAG});
    double *q = const_cast<double *>(mk_log_get(given.logs[0].get(), "q1"));
    std::fill(q, q + given.logs[0]->rows, (double)NAN);
    mk_model m = given.model;
    ck_assert_int_eq(mk_model_add_effect(&m, "cable-hysteresis", 1, nullptr), MK_OK);
    const mk::FreeRuns runs(given.folds, m, WINDOW, 1);
    const mk::RunPoint point = runs.start(m);
    ck_assert_uint_eq(point.z.size(), point.x.size());
    ck_assert_double_eq(point.z[0](0), 0.0);
}
END_TEST

extern "C" Suite *suite_free_runs(void)
{
    Suite *s = suite_create("free_runs");
    TCase *t = tcase_create("windows");
    tcase_set_timeout(t, 60);
    tcase_add_test(t, what_a_fit_to_the_other_logs_leaves_is_known_without_making_it);
    tcase_add_test(t, the_law_that_is_missing_is_what_the_left_out_logs_ask_for);
    tcase_add_test(t, what_errors_say_of_a_model_does_not_depend_on_what_was_usual);
    tcase_add_test(t, a_window_that_nobody_predicts_does_not_decide);
    tcase_add_test(t, a_settled_fit_gains_nothing_from_states_that_are_found_anew);
    tcase_add_test(t, a_value_of_a_logs_own_comes_from_its_first_half);
    tcase_add_test(t, what_an_effect_remembers_comes_from_all_readings_before_the_window);
    tcase_add_test(t, what_an_effect_remembers_has_the_derivatives_of_its_differences);
    tcase_add_test(t, a_thinned_record_keeps_the_commands_integral_and_a_reading_of_every_joint);
    tcase_add_test(t, a_log_without_readings_says_nothing_of_what_effects_remember);
    tcase_add_test(t, the_slope_of_the_cost_counts_in_what_effects_remember);
    tcase_add_test(t, what_a_window_says_of_parameters_is_the_slope_of_its_squares);
    suite_add_tcase(s, t);
    return s;
}
