// Shooting and fits: derivatives against differences, trajectories against SUNDIALS, estimates
// against the truth.
#include "suites.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "ident/fit_log.hpp"
#include "mechkit/ident.h"
#include "mechkit/loop.h"
#include "sim/shoot.hpp"

namespace
{

// A command held over samples, a model, and what shooting makes of them.
struct Bench {
    mk_model model;
    std::vector<double> t, u, zero, one;
    std::vector<double> residual, jac, x_end, jac_end;
    std::vector<int> free;
    std::vector<double> scale;
    double step = 2e-3; // longest, s
    bool close = false;

    explicit Bench(enum mk_plant_kind kind, double period = 0.004, int rows = 126)
    {
        mk_model_default(kind, &model);
        for (int k = 0; k < rows; k++) {
            t.push_back(period * k);
            u.push_back(1.5 * std::sin(6.0 * t.back()) + 0.4 * std::sin(31.0 * t.back()));
        }
        zero.assign(t.size(), 0.0);
        one.assign(t.size(), 1.0);
    }
    mk::ShootTask task(const std::vector<double> &x, bool derivatives)
    {
        int ns = mk_model_state_count(&model), n = (int)free.size();
        static mk::ShootData data;
        data = {};
        data.rows = t.size();
        data.t = t.data();
        data.u[0] = u.data();
        for (int j = 0; j < mk_model_joints(&model); j++)
            data.q[j] = zero.data(), data.w[j] = one.data();
        int columns = derivatives ? ns + n : 0;
        residual.assign(4 * t.size(), 0.0);
        jac.assign(4 * t.size() * (size_t)(ns + n), 0.0);
        x_end.assign((size_t)ns, 0.0);
        jac_end.assign((size_t)(ns * (ns + n)), 0.0);
        scale.assign(free.size(), 1.0);
        mk::ShootTask k = {};
        k.model = &model;
        k.data = &data;
        k.begin = 0.0;
        k.end = t.back();
        k.last = true;
        k.x = x.data();
        k.step = step;
        k.close = close;
        k.free_count = derivatives ? n : 0;
        k.free = free.data();
        k.scale = scale.data();
        k.columns = columns;
        k.x_end = x_end.data();
        k.jac_end = jac_end.data();
        k.row_capacity = residual.size();
        k.residual = residual.data();
        k.jac = jac.data();
        return k;
    }
    std::vector<double> predicted(const std::vector<double> &x)
    {
        mk::ShootTask k = task(x, false);
        mk::shoot(k);
        ck_assert(k.finite);
        std::vector<double> y(residual.begin(), residual.begin() + (long)k.row_count);
        for (double &r : y)
            r = -r;
        return y;
    }
};

void add(mk_model &m, const char *name, int joint, std::initializer_list<double> values)
{
    mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_model_add_effect(&m, name, joint, &err) == MK_OK, "%s", err.message);
    int i = 0;
    for (double v : values)
        m.effect[m.effect_count - 1].value[i++] = v;
}

struct Off {
    double most = 0.0; // relative to 1 + the column's largest derivative
    int column = 0;
};

// Derivatives by everything against central differences of the same trajectory.
Off derivatives_off(Bench &b, std::vector<double> x)
{
    Off worst;
    int ns = mk_model_state_count(&b.model), np = mk_model_parameter_count(&b.model);
    b.free.clear();
    for (int i = 0; i < np; i++)
        b.free.push_back(i);
    mk::ShootTask k = b.task(x, true);
    mk::shoot(k);
    ck_assert(k.finite);
    size_t rows = k.row_count;
    std::vector<double> jac = b.jac;
    for (int c = 0; c < ns + np; c++) {
        std::vector<double> y[2];
        double v = c < ns ? x[(size_t)c] : mk_model_parameter(&b.model, c - ns);
        double h = 1e-6 * std::fmax(std::fabs(v), 1e-2);
        for (int side = 0; side < 2; side++) {
            double moved = v + (side ? h : -h);
            mk_model kept = b.model;
            std::vector<double> x1 = x;
            if (c < ns)
                x1[(size_t)c] = moved;
            else
                mk_model_set_parameter(&b.model, c - ns, moved);
            y[side] = b.predicted(x1);
            b.model = kept;
        }
        double largest = 0.0, off = 0.0;
        ck_assert_uint_eq(y[0].size(), rows);
        for (size_t r = 0; r < rows; r++) {
            double difference = (y[1][r] - y[0][r]) / (2.0 * h);
            largest = std::fmax(largest, std::fabs(difference));
            off = std::fmax(off, std::fabs(difference - jac[r * (size_t)(ns + np) + (size_t)c]));
        }
        if (off > worst.most * (1.0 + largest))
            worst = {off / (1.0 + largest), c};
    }
    return worst;
}

void check_derivatives(Bench &b, std::vector<double> x, double tolerance)
{
    const Off off = derivatives_off(b, x);
    ck_assert_msg(off.most <= tolerance, "column %d: off by %g", off.column, off.most);
}

} // namespace

START_TEST(derivatives_are_those_of_the_trajectory)
{
    Bench b((enum mk_plant_kind)_i);
    std::vector<double> x((size_t)mk_model_state_count(&b.model), 0.1);
    check_derivatives(b, x, 2.5e-2);
}
END_TEST

START_TEST(close_derivatives_come_closer_with_the_square_of_the_step)
{
    Bench b(MK_PLANT_PENDUBOT, 0.01, 30);
    b.close = true;
    const std::vector<double> x = {0.1, 0.2, 4.0, 5.0};
    double most[2];
    for (const int i : {0, 1}) {
        b.step = i ? 5e-3 : 10e-3;
        most[i] = derivatives_off(b, x).most;
    }
    ck_assert_double_lt(most[1], 2e-3);
    ck_assert_msg(most[0] > 3.0 * most[1] && most[0] < 6.0 * most[1], "%g, then %g", most[0],
                  most[1]);
}
END_TEST

START_TEST(derivatives_by_delays_lags_and_bristles_are_exact)
{
    Bench b(MK_PLANT_PENDUBOT);
    add(b.model, "input-delay", 0, {0.0057});
    add(b.model, "sensor-delay", 2, {0.0031});
    add(b.model, "actuator-lag", 0, {0.011});
    add(b.model, "stiction", 2, {2.0, 0.02, 0.05});
    std::vector<double> x((size_t)mk_model_state_count(&b.model), 0.05);
    x[0] = -1.4;
    check_derivatives(b, x, 1e-2);
}
END_TEST

START_TEST(derivatives_through_contact_include_its_instant)
{
    Bench b(MK_PLANT_PENDULUM);
    add(b.model, "end-stop", 1, {0.15, 60.0, 0.4});
    std::vector<double> x = {0.05, 2.5};
    check_derivatives(b, x, 1e-4);
    // Close ones miss where the stop lets go, a kink within a step; without the instants of contact
    // they would be off by 0.2.
    b.close = true;
    check_derivatives(b, x, 3e-2);
}
END_TEST

namespace
{

// Everything that a stretch hands in.
struct Harvest {
    std::vector<double> residual, jac, x_end, jac_end;
};

// Stretches of unlike length, start and course; every one with its own log.
void check_side_by_side(const mk_model &model, bool close)
{
    constexpr int COUNT = 21;
    mk_model m = model;
    int ns = mk_model_state_count(&m), np = mk_model_parameter_count(&m);
    std::vector<Bench> bench;
    std::vector<std::vector<double>> x;
    for (int i = 0; i < COUNT; i++) {
        bench.emplace_back((enum mk_plant_kind)m.plant, 0.004, 12 + 7 * (i % 5));
        bench.back().model = m;
        bench.back().close = close;
        for (int p = 0; p < np; p++)
            bench.back().free.push_back(p);
        x.emplace_back((size_t)ns, 0.0);
        x.back()[0] = 0.3 * std::sin(1.0 + i);
        x.back()[(size_t)mk_model_joints(&m)] = 2.0 * std::cos(2.0 * i);
    }
    std::vector<mk::ShootTask> together;
    std::vector<mk::ShootData> data((size_t)COUNT);
    std::vector<Harvest> alone;
    for (size_t i = 0; i < (size_t)COUNT; i++) {
        mk::ShootTask k = bench[i].task(x[i], true);
        mk::shoot(k);
        ck_assert(k.finite);
        bench[i].residual.resize(k.row_count);
        alone.push_back({bench[i].residual, bench[i].jac, bench[i].x_end, bench[i].jac_end});
        k = bench[i].task(x[i], true);
        data[i] = *k.data; // the one that tasks share is overwritten
        k.data = &data[i];
        k.model = &m;
        together.push_back(k);
    }
    mk::shoot(together.data(), COUNT);
    for (size_t i = 0; i < (size_t)COUNT; i++) {
        ck_assert(together[i].finite);
        ck_assert_uint_eq(together[i].row_count, alone[i].residual.size());
        // Instruction sets contract products in their own ways.
        auto same = [&](const std::vector<double> &a, const std::vector<double> &b, size_t n,
                        const char *what) {
            for (size_t r = 0; r < n; r++)
                ck_assert_msg(std::fabs(a[r] - b[r]) <= 1e-8 * (1.0 + std::fabs(b[r])),
                              "stretch %zu, %s[%zu]: %.12g, not %.12g", i, what, r, a[r], b[r]);
        };
        same(bench[i].residual, alone[i].residual, alone[i].residual.size(), "residual");
        same(bench[i].x_end, alone[i].x_end, (size_t)ns, "x_end");
        same(bench[i].jac_end, alone[i].jac_end, alone[i].jac_end.size(), "jac_end");
        same(bench[i].jac, alone[i].jac, alone[i].residual.size() * (size_t)(ns + np), "jac");
    }
}

} // namespace

START_TEST(stretches_side_by_side_come_out_as_if_alone)
{
    mk_model m;
    mk_model_default((enum mk_plant_kind)_i, &m);
    for (const bool close : {false, true})
        check_side_by_side(m, close);
}
END_TEST

START_TEST(stretches_side_by_side_switch_and_shift_each_at_its_own_instant)
{
    mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    add(m, "end-stop", 1, {0.05, 60.0, 0.4});
    add(m, "backlash", 2, {0.02, 80.0, 0.2});
    add(m, "input-delay", 0, {0.0057});
    add(m, "sensor-delay", 2, {0.0031});
    add(m, "stiction", 1, {2.0, 0.02, 0.05});
    for (const bool close : {false, true})
        check_side_by_side(m, close);
}
END_TEST

// More derivatives than one pass has room for.
START_TEST(derivatives_by_forty_columns_are_exact)
{
    Bench b(MK_PLANT_PENDULUM);
    for (int i = 0; i < MK_MAX_EFFECTS; i++)
        add(b.model, "cogging", 1, {0.01 + 0.002 * i, 1.0 + i, 0.3 * i});
    std::vector<double> x = {0.2, 0.5};
    check_derivatives(b, x, 1e-4);
}
END_TEST

// Against the plain sums, of columns that fill registers and that do not, of more rows than go
// together.
START_TEST(normal_equations_are_the_sums_of_products_of_the_rows_of_a_joint)
{
    for (int columns : {1, 7, 8, 21, mk::GRAM_MAX_COLUMNS})
        for (int joint : {-1, 0, 1}) {
            const int rows = 75;
            std::vector<double> a((size_t)(rows * columns)), got((size_t)(columns * columns), NAN);
            std::vector<int> joint_of;
            for (size_t i = 0; i < a.size(); i++)
                a[i] = std::sin(0.7 * (double)(i * i % 1013));
            for (int i = 0; i < rows; i++)
                joint_of.push_back(i % 3 == 1);
            mk::gram({a.data(), rows, columns, joint < 0 ? nullptr : joint_of.data(), joint},
                     got.data());
            for (int c = 0; c < columns; c++)
                for (int d = 0; d < columns; d++) {
                    double sum = 0.0;
                    for (int i = 0; i < rows; i++)
                        if (joint < 0 || joint_of[(size_t)i] == joint)
                            sum += a[(size_t)(i * columns + c)] * a[(size_t)(i * columns + d)];
                    ck_assert_double_eq_tol(got[(size_t)(c * columns + d)], sum, 1e-12);
                }
        }
}
END_TEST

START_TEST(trajectories_agree_with_sundials)
{
    Bench b((enum mk_plant_kind)_i);
    int ns = mk_model_state_count(&b.model);
    std::vector<double> x((size_t)ns, 0.1);
    (void)b.predicted(x);
    mk_sim *sim = nullptr;
    mk_error err = MK_ERROR_INIT;
    mk_sim_config config = {MK_SOLVER_CVODE_ADAMS, 1e-11, 1e-12};
    ck_assert_int_eq(mk_sim_create(&b.model, &config, &sim, &err), MK_OK);
    ck_assert_int_eq(mk_sim_reset(sim, 0.0, x.data(), nullptr), MK_OK);
    for (size_t k = 0; k + 1 < b.t.size(); k++) {
        double u[2] = {b.u[k], 0.0};
        ck_assert_int_eq(mk_sim_advance(sim, b.t[k + 1], u, &err), MK_OK);
    }
    // A tenth of a count of a 4000 line encoder, over half a second.
    for (int i = 0; i < mk_model_joints(&b.model); i++)
        ck_assert_double_eq_tol(b.x_end[(size_t)i], mk_sim_state(sim)[i], 1.6e-4);
    mk_sim_destroy(sim);
}
END_TEST

// --- output error
// ----------------------------------------------------------------------------------

namespace
{

double normal(unsigned &seed)
{
    double sum = -6.0;
    for (int i = 0; i < 12; i++) {
        seed = seed * 1664525u + 1013904223u;
        sum += (double)(seed >> 8) / 16777216.0;
    }
    return sum;
}

// A log of the model under a multisine, by SUNDIALS, with normal noise on the readings.
mk_log *record(const mk_model &model, double seconds, double rate, double noise, unsigned seed)
{
    size_t rows = (size_t)(seconds * rate);
    mk_log *log = nullptr;
    ck_assert_int_eq(mk_log_create(rows, &log), MK_OK);
    double *t = mk_log_add_column(log, "t");
    double *q[2] = {mk_log_add_column(log, "q1"), nullptr};
    int n = mk_model_joints(&model);
    if (n > 1)
        q[1] = mk_log_add_column(log, "q2");
    double *u = mk_log_add_column(log, "u");
    mk_sim *sim = nullptr;
    mk_error err = MK_ERROR_INIT;
    double x[MK_MAX_STATES], zero[2] = {0.0, 0.0};
    mk_model_initial_state(&model, mk_plant(model.plant)->rest, zero, x);
    ck_assert_int_eq(mk_sim_create(&model, nullptr, &sim, &err), MK_OK);
    ck_assert_int_eq(mk_sim_reset(sim, 0.0, x, nullptr), MK_OK);
    for (size_t k = 0; k < rows; k++) {
        double y[2];
        t[k] = (double)k / rate;
        u[k] = 2.0 * std::sin(6.0 * t[k]) + 1.5 * std::sin(13.1 * t[k] + 1.0);
        mk_sim_measure(sim, y);
        for (int j = 0; j < n; j++)
            q[j][k] = y[j] + noise * normal(seed);
        double command[2] = {u[k], 0.0};
        ck_assert_int_eq(mk_sim_advance(sim, (double)(k + 1) / rate, command, &err), MK_OK);
    }
    mk_sim_destroy(sim);
    return log;
}

} // namespace

START_TEST(output_error_finds_the_parameters_of_every_plant)
{
    mk_model truth, given;
    mk_model_default((enum mk_plant_kind)_i, &truth);
    given = truth;
    for (int p = 0; p < mk_plant(truth.plant)->parameter_count; p++)
        given.parameter[p] *= p % 2 ? 1.12 : 0.9;
    mk_log *log = record(truth, 4.0, 250.0, 2e-4, 7u);
    static mk_ident_result r;
    mk_error err = MK_ERROR_INIT;
    mk_ident_options options = {};
    options.threads = 1;
    ck_assert_msg(mk_identify(&given, &log, 1, &options, &r, &err) == MK_OK, "%s", err.message);
    for (int p = 0; p < mk_plant(truth.plant)->parameter_count; p++) {
        ck_assert_msg(r.parameter[p].std_error < 0.1 * truth.parameter[p], "%s +- %g",
                      r.parameter[p].name, r.parameter[p].std_error);
        ck_assert_msg(std::fabs(r.parameter[p].value - truth.parameter[p]) <
                          4.0 * r.parameter[p].std_error,
                      "%s = %g +- %g, not %g", r.parameter[p].name, r.parameter[p].value,
                      r.parameter[p].std_error, truth.parameter[p]);
    }
    mk_log_free(log);
}
END_TEST

START_TEST(output_error_fits_effects_too)
{
    mk_model truth, given;
    mk_model_default(MK_PLANT_PENDULUM, &truth);
    add(truth, "quadratic-drag", 1, {0.02});
    add(truth, "input-delay", 0, {0.006});
    given = truth;
    given.effect[0].value[0] = 0.001;
    given.effect[1].value[0] = 0.001;
    mk_log *log = record(truth, 4.0, 250.0, 2e-4, 3u);
    static mk_ident_result r;
    mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_identify(&given, &log, 1, nullptr, &r, &err) == MK_OK, "%s", err.message);
    ck_assert_str_eq(r.parameter[4].name, "effect.quadratic-drag.coefficient");
    ck_assert_double_eq_tol(r.parameter[4].value, 0.02, 4.0 * r.parameter[4].std_error);
    ck_assert_double_eq_tol(r.parameter[5].value, 0.006, 4.0 * r.parameter[5].std_error);
    ck_assert_double_lt(r.parameter[5].std_error, 2e-4);
    mk_log_free(log);
}
END_TEST

START_TEST(intervals_of_output_error_hold_the_truth_as_often_as_they_say)
{
    mk_model truth;
    mk_model_default(MK_PLANT_PENDULUM, &truth);
    int inside = 0, all = 0;
    for (unsigned draw = 0; draw < 40; draw++) {
        mk_log *log = record(truth, 2.0, 100.0, 1e-3, 100u + draw);
        static mk_ident_result r;
        mk_error err = MK_ERROR_INIT;
        mk_ident_options options = {};
        options.threads = 1;
        ck_assert_int_eq(mk_identify(&truth, &log, 1, &options, &r, &err), MK_OK);
        for (int p = 0; p < 4; p++, all++)
            inside += std::fabs(r.parameter[p].value - truth.parameter[p]) <
                      1.96 * r.parameter[p].std_error;
        mk_log_free(log);
    }
    // 95 % of 160; four standard deviations either way.
    ck_assert_int_ge(inside, (int)(all * 0.88));
}
END_TEST

// A swing of known phase: its amplitude as the weights of the readings make it, error over
// standard error.
static double amplitude_error(double jitter, bool rounded)
{
    constexpr double AMPLITUDE = 0.4, COUNT = 2.0 * M_PI / 4000.0;
    constexpr int ROWS = 1000000;
    mk_model model;
    mk_model_default(MK_PLANT_PENDULUM, &model);
    std::vector<double> t, q, u(ROWS, 0.0);
    unsigned seed = 5u;
    for (int k = 0; k < ROWS; k++) {
        t.push_back(0.005 * k);
        double x = AMPLITUDE * std::sin(3.0 * t.back()) + jitter * COUNT * normal(seed);
        q.push_back(rounded ? COUNT * std::round(x / COUNT) : x);
    }
    mk_record record = {};
    record.rows = ROWS;
    record.t = t.data(), record.q[0] = q.data(), record.u[0] = u.data();
    mk::FitLog log = mk::fit_log(record, model, 0, ROWS);
    double right = 0.0, square = 0.0, noise = COUNT * std::hypot(jitter, rounded ? 0.289 : 0.0);
    for (int k = 0; k < ROWS; k++) {
        double s = std::sin(3.0 * t[(size_t)k]), w = log.weight[0][(size_t)k];
        right += w * w * s * q[(size_t)k];
        square += w * w * s * s;
    }
    ck_assert_double_gt(square, 0.9 * 0.5 * ROWS);
    return (right / square - AMPLITUDE) * std::sqrt(square) / noise;
}

START_TEST(noise_does_not_decide_what_a_reading_weighs)
{
    ck_assert_double_lt(std::fabs(amplitude_error(0.4, true)), 3.0);
    ck_assert_double_lt(std::fabs(amplitude_error(0.3, false)), 3.0);
}
END_TEST

// Slow swings of so many counts to either side, 25 readings a count: what all readings of a count
// weigh that is passed on the way, and of one at which the swing turns.
static void weigh_a_count(int counts, double &passed, double &turned)
{
    constexpr double COUNT = 2.0 * M_PI / 4000.0;
    const int rows = 20 * 100 * counts;
    mk_model model;
    mk_model_default(MK_PLANT_PENDULUM, &model);
    std::vector<double> t, q, u((size_t)rows, 0.0);
    for (int k = 0; k < rows; k++) {
        const double turns = (double)k / (100 * counts), part = turns - std::floor(turns);
        const double x = counts * (part < 0.5 ? 4.0 * part - 1.0 : 3.0 - 4.0 * part);
        t.push_back(0.005 * k);
        q.push_back(COUNT * std::round(0.99 * x));
    }
    mk_record record = {};
    record.rows = (size_t)rows;
    record.t = t.data(), record.q[0] = q.data(), record.u[0] = u.data();
    const mk::FitLog log = mk::fit_log(record, model, 0, (size_t)rows);
    passed = turned = 0.0;
    // A whole stay at 0 and at the end, in the middle of the log.
    for (int at : {0, counts}) {
        double sum = 0.0, stays = 0.0;
        for (size_t k = 1; k < (size_t)rows; k++)
            if (std::lround(q[k] / COUNT) == at) {
                sum += log.weight[0][k] * log.weight[0][k];
                stays += std::lround(q[k - 1] / COUNT) != at;
            }
        (at == 0 ? passed : turned) = sum / stays;
    }
}

/* A row that came late, and whose command is missing as well: nobody knows how far off it is, and
 * yet its doubt is a number, or the piece of the log would count for nothing. */
START_TEST(a_late_row_without_a_command_leaves_a_doubt_that_is_a_number)
{
    constexpr size_t ROWS = 100, AT = 50;
    mk_model model;
    mk_model_default(MK_PLANT_PENDULUM, &model);
    std::vector<double> t, q, u, flags(ROWS, 0.0);
    for (size_t k = 0; k < ROWS; k++) {
        t.push_back(0.005 * (double)k);
        q.push_back(std::sin(4.0 * t[k]));
        u.push_back(k < AT ? -1.0 : 1.0);
    }
    flags[AT] = MK_FLAG_LATE;
    u[AT] = std::nan("");
    mk_record record = {};
    record.rows = ROWS;
    record.t = t.data(), record.q[0] = q.data(), record.u[0] = u.data();
    record.flags = flags.data();
    const mk::FitLog log = mk::fit_log(record, model, 0, ROWS);
    for (size_t k = 0; k < log.rows(); k++)
        ck_assert_msg(std::isfinite(log.doubt[k]) && std::isfinite(log.u[0][k]), "row %zu", k);
}
END_TEST

START_TEST(rounding_evens_out_on_a_way_of_many_counts_and_not_of_few)
{
    double passed, turned;
    weigh_a_count(2, passed, turned); // -1, 0 and 1 are passed
    ck_assert_double_eq_tol(passed, 3.0, 0.1);
    ck_assert_double_eq_tol(turned, 1.0, 0.1);
    weigh_a_count(40, passed, turned);
    ck_assert_double_eq_tol(passed, 8.0, 0.3);
    ck_assert_double_eq_tol(turned, 1.0, 0.1);
}
END_TEST

START_TEST(a_motion_that_repeats_itself_is_known_by_its_counts)
{
    constexpr double COUNT = 2.0 * M_PI / 4000.0;
    constexpr int ROWS = 10000, PERIOD = 200;
    mk_model model;
    mk_model_default(MK_PLANT_PENDULUM, &model);
    for (bool repeats : {true, false}) {
        std::vector<double> t, q, u(ROWS, 0.0);
        for (int k = 0; k < ROWS; k++) {
            double turn = (double)k / PERIOD;
            t.push_back(0.005 * k);
            turn += repeats ? 0.0 : 2e-3 * turn * turn;
            q.push_back(COUNT * std::round(std::sin(2.0 * M_PI * turn) / COUNT));
        }
        mk_record record = {};
        record.rows = ROWS;
        record.t = t.data(), record.q[0] = q.data(), record.u[0] = u.data();
        mk::FitLog log = mk::fit_log(record, model, 0, ROWS);
        ck_assert_double_eq(log.repeating[0], 1.0);
        size_t visits = mk::usual_visits({&log});
        ck_assert_msg(repeats ? visits >= ROWS / PERIOD - 1 : visits <= 2, "%zu visits", visits);
    }
}
END_TEST

START_TEST(fast_motion_is_no_noise_of_the_readings_where_another_log_is_slow)
{
    constexpr double COUNT = 2.0 * M_PI / 4000.0;
    constexpr int ROWS = 2000;
    mk_model model;
    mk_model_default(MK_PLANT_PENDULUM, &model);
    std::vector<mk::FitLog> logs;
    for (double rate : {0.1, 150.0}) { // rad/s
        std::vector<double> t, q, u(ROWS, 0.0);
        for (int k = 0; k < ROWS; k++) {
            t.push_back(0.005 * k);
            q.push_back(COUNT * std::round(0.2 * std::sin(rate * t.back()) / COUNT));
        }
        mk_record record = {};
        record.rows = ROWS;
        record.t = t.data(), record.q[0] = q.data(), record.u[0] = u.data();
        logs.push_back(mk::fit_log(record, model, 0, ROWS));
    }
    const double rounding = COUNT / std::sqrt(12.0);
    ck_assert_double_gt(mk::scatter_of({&logs[0], &logs[1]}, 0), 3.0 * rounding);
    ck_assert_double_lt(mk::least_scatter({&logs[0], &logs[1]}, 0), 1.1 * rounding);
}
END_TEST

START_TEST(the_beginning_of_a_log_is_the_log_up_to_then)
{
    constexpr int ROWS = 200;
    mk_model model;
    mk_model_default(MK_PLANT_PENDULUM, &model);
    std::vector<double> t, q, u;
    for (int k = 0; k < ROWS; k++)
        t.push_back(0.005 * k), q.push_back(std::sin(0.02 * k)), u.push_back(k % 7);
    mk_record record = {};
    record.rows = ROWS;
    record.t = t.data(), record.q[0] = q.data(), record.u[0] = u.data();
    const mk::FitLog log = mk::fit_log(record, model, 0, ROWS);
    for (double seconds : {0.0, 0.1, 0.5024, 1e9}) {
        const mk::FitLog part = mk::beginning_of(log, seconds);
        const size_t rows = seconds > 1.0 ? ROWS : (size_t)(seconds / 0.005 + 1e-9) + 1;
        ck_assert_uint_eq(part.rows(), rows);
        ck_assert_uint_eq(part.q[0].size(), rows);
        ck_assert_uint_eq(part.weight[0].size(), rows);
        ck_assert_uint_eq(part.u[0].size(), rows);
        ck_assert(std::equal(part.q[0].begin(), part.q[0].end(), log.q[0].begin()));
        ck_assert(std::equal(part.u[0].begin(), part.u[0].end(), log.u[0].begin()));
        ck_assert_double_le(part.duration(), seconds);
        ck_assert_int_eq(part.joints, log.joints);
        ck_assert_double_eq(part.period, log.period);
    }
}
END_TEST

// A friction that rises with time rises in a piece of a log as it does there in the whole log.
START_TEST(a_piece_of_a_log_keeps_the_time_of_the_log)
{
    constexpr size_t ROWS = 251, MIDDLE = 125;
    Bench b(MK_PLANT_PENDULUM, 0.004, (int)ROWS);
    b.model.parameter[mk_plant(MK_PLANT_PENDULUM)->parameter_count - 1] = 0.3; // Coulomb friction
    add(b.model, "friction-drift", 1, {2.0, 0.2});
    mk_record record = {};
    record.rows = ROWS;
    record.t = b.t.data(), record.q[0] = b.zero.data(), record.u[0] = b.u.data();
    const mk::FitLog whole = mk::fit_log(record, b.model, 0, ROWS),
                     piece = mk::fit_log(record, b.model, MIDDLE, ROWS, 3);
    ck_assert_int_eq(whole.source, 0);
    ck_assert_double_eq(whole.start, 0.0);
    ck_assert_int_eq(piece.source, 3);
    ck_assert_double_eq_tol(piece.start, b.t[MIDDLE], 1e-12);
    const double x0[2] = {0.5, 0.0};
    double middle[2], end[2], from_piece[2];
    auto shoot_over = [&](const mk::FitLog &log, double stop, const double *x, double *x_end) {
        mk::ShootData data = {};
        data.rows = log.rows(), data.start = log.start, data.t = log.t.data();
        data.u[0] = log.u[0].data(), data.q[0] = log.q[0].data();
        const std::vector<double> weight(log.rows(), 0.0);
        data.w[0] = weight.data();
        mk::ShootTask k = {};
        k.model = &b.model, k.data = &data, k.end = stop, k.x = x, k.x_end = x_end, k.step = 1e-3;
        mk::shoot(k);
        ck_assert(k.finite);
    };
    shoot_over(whole, b.t[MIDDLE], x0, middle);
    shoot_over(whole, b.t[ROWS - 1], x0, end);
    shoot_over(piece, b.t[ROWS - 1] - b.t[MIDDLE], middle, from_piece);
    for (int s = 0; s < 2; s++)
        ck_assert_double_eq_tol(from_piece[s], end[s], 1e-9);
}
END_TEST

START_TEST(a_log_that_says_nothing_is_refused)
{
    mk_model m;
    mk_model_default(MK_PLANT_PENDULUM, &m);
    mk_log *log = nullptr;
    ck_assert_int_eq(mk_log_create(100, &log), MK_OK);
    double *t = mk_log_add_column(log, "t"), *q = mk_log_add_column(log, "q1");
    double *u = mk_log_add_column(log, "u");
    for (int k = 0; k < 100; k++)
        t[k] = 0.01 * k, q[k] = 0.0, u[k] = 0.0;
    static mk_ident_result r;
    mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(mk_identify(&m, &log, 1, nullptr, &r, &err), MK_ERR_RANGE);
    ck_assert_ptr_nonnull(strstr(err.message, "nothing moves"));
    mk_ident_options options = {};
    options.method = "guessing";
    ck_assert_int_eq(mk_identify(&m, &log, 1, &options, &r, &err), MK_ERR_NOTFOUND);
    mk_log_free(log);
}
END_TEST

// Logged every millisecond, a command that changes every four is the one that is logged so.
// Of a run that nothing goes before the first readings of a late sensor show the time before it.
// Next to no delay changes next to nothing, and a longer one is met by derivatives that are exact.
START_TEST(readings_of_the_time_before_a_run_count_as_others_do)
{
    Bench prompt(MK_PLANT_PENDUBOT, 0.04, 8), late(MK_PLANT_PENDUBOT, 0.04, 8);
    add(late.model, "sensor-delay", 0, {1e-7});
    const std::vector<double> x = {0.3, -0.2, 1.5, -2.0};
    mk::ShootTask one = prompt.task(x, false), other = late.task(x, false);
    other.first_row = 0, other.end_row = late.t.size();
    mk::shoot(one);
    mk::shoot(other);
    ck_assert(one.finite && other.finite);
    ck_assert_uint_eq(one.row_count, other.row_count);
    for (size_t i = 0; i < one.row_count; i++)
        ck_assert_double_eq_tol(prompt.residual[i], late.residual[i], 1e-5);
    constexpr double DELAY = 0.004;
    late.model.effect[0].value[0] = DELAY;
    mk::ShootTask far = late.task(x, true);
    far.first_row = 0, far.end_row = late.t.size();
    mk::shoot(far);
    ck_assert_uint_eq(far.row_count, one.row_count);
    // The same from where a run ends that has taken as long as the reading is late: the first
    // reading shows where that one began.
    mk::ShootTask before = prompt.task(x, false);
    before.end = DELAY;
    mk::shoot(before);
    const std::vector<double> there = prompt.x_end;
    mk::ShootTask after = late.task(there, false);
    after.first_row = 0, after.end_row = late.t.size();
    mk::shoot(after);
    ck_assert_double_eq_tol(-late.residual[0], x[0], 2e-5);
    ck_assert_double_gt(std::fabs(there[0] - x[0]), 4e-3);
    far = late.task(x, true);
    far.first_row = 0, far.end_row = late.t.size();
    mk::shoot(far);
    for (int side = 0; side < 2; side++) {
        // By the start state's speeds: central differences of what the first reading shows.
        double y[2];
        for (int k = 0; k < 2; k++) {
            std::vector<double> moved = x;
            moved[2 + (size_t)side] += k ? 1e-5 : -1e-5;
            Bench again(MK_PLANT_PENDUBOT, 0.04, 8);
            add(again.model, "sensor-delay", 0, {DELAY});
            mk::ShootTask t = again.task(moved, false);
            t.first_row = 0, t.end_row = again.t.size();
            mk::shoot(t);
            y[k] = -again.residual[0];
        }
        ck_assert_double_eq_tol(late.jac[2 + (size_t)side], (y[1] - y[0]) / 2e-5, 1e-6);
    }
}
END_TEST

// A drive that follows its command within a tenth of a millisecond is as good as one that is at
// once, however far apart the edges of the command are.
START_TEST(a_stiff_lag_is_resolved_between_edges_that_are_far_apart)
{
    Bench prompt(MK_PLANT_PENDUBOT, 0.04, 12), lag(MK_PLANT_PENDUBOT, 0.04, 12);
    add(lag.model, "actuator-lag", 0, {1e-4});
    std::vector<double> x = {0.3, -0.2, 1.5, -2.0};
    const std::vector<double> y = prompt.predicted(x);
    x.resize((size_t)mk_model_state_count(&lag.model), prompt.u[0]); // the drive follows already
    const std::vector<double> z = lag.predicted(x);
    ck_assert_uint_eq(y.size(), z.size());
    for (size_t i = 0; i < y.size(); i++)
        ck_assert_double_eq_tol(y[i], z[i], 0.02 * std::fmax(1.0, std::fabs(y[i])));
}
END_TEST

// A wheel under a command that turns it round, in radians and as a slide on which a radian is a
// centimetre: reversals are resolved alike.
START_TEST(a_slide_is_stepped_through_its_reversals_as_a_wheel_is)
{
    constexpr double METRES = 0.01; // a radian
    std::vector<double> y[2];
    size_t steps[2] = {0, 0};
    for (int slides = 0; slides < 2; slides++) {
        Bench b(MK_PLANT_INERTIA_WHEEL, 0.005, 200);
        mk_model &m = b.model;
        if (slides)
            ck_assert_int_eq(mk_model_set_linear(&m, 0, true, nullptr), MK_OK);
        // J' = J / METRES, c' = c / METRES: the same motion, in another unit.
        const double unit = slides ? METRES : 1.0;
        m.parameter[0] = 0.012 / unit;
        m.parameter[1] = 0.02 / unit;
        m.parameter[2] = 0.5;
        for (size_t k = 0; k < b.u.size(); k++)
            b.u[k] = 1.5 * std::cos(40.0 * b.t[k]);
        const std::vector<double> rest = {0.0, 0.0};
        mk::ShootTask k = b.task(rest, false);
        k.step = 5e-3;
        mk::shoot(k);
        ck_assert(k.finite);
        for (size_t i = 0; i < k.row_count; i++)
            y[slides].push_back(-b.residual[i] / unit);
        steps[slides] = (size_t)k.steps;
    }
    ck_assert_uint_eq(steps[0], steps[1]);
    for (size_t i = 0; i < y[0].size(); i++)
        ck_assert_double_eq_tol(y[0][i], y[1][i], 1e-9);
}
END_TEST

START_TEST(a_command_that_says_the_same_again_takes_no_step_and_changes_nothing)
{
    constexpr int HELD = 4;
    Bench slow(MK_PLANT_PENDUBOT, 0.004, 126);
    Bench fast(MK_PLANT_PENDUBOT, 0.001, 125 * HELD + 1);
    for (size_t k = 0; k < fast.t.size(); k++)
        fast.u[k] = slow.u[k / HELD];
    const std::vector<double> x = {0.3, -0.2, 0.0, 0.0};
    mk::ShootTask a = slow.task(x, false);
    a.step = 5e-3;
    mk::shoot(a);
    mk::ShootTask b = fast.task(x, false);
    b.step = 5e-3;
    b.edges_differ = true;
    mk::shoot(b);
    ck_assert(a.finite && b.finite);
    ck_assert_int_eq((int)b.steps, (int)a.steps);
    for (size_t i = 0; i < x.size(); i++)
        ck_assert_double_eq_tol(fast.x_end[i], slow.x_end[i], 1e-12);
}
END_TEST

Suite *suite_shoot(void)
{
    Suite *s = suite_create("shoot");
    TCase *t = tcase_create("derivatives");
    tcase_add_loop_test(t, derivatives_are_those_of_the_trajectory, 0, MK_PLANT_COUNT);
    tcase_add_test(t, a_command_that_says_the_same_again_takes_no_step_and_changes_nothing);
    tcase_add_test(t, a_slide_is_stepped_through_its_reversals_as_a_wheel_is);
    tcase_add_test(t, a_stiff_lag_is_resolved_between_edges_that_are_far_apart);
    tcase_add_test(t, readings_of_the_time_before_a_run_count_as_others_do);
    tcase_add_test(t, close_derivatives_come_closer_with_the_square_of_the_step);
    tcase_add_test(t, derivatives_by_delays_lags_and_bristles_are_exact);
    tcase_add_test(t, derivatives_through_contact_include_its_instant);
    tcase_add_loop_test(t, trajectories_agree_with_sundials, 0, MK_PLANT_COUNT);
    tcase_add_loop_test(t, stretches_side_by_side_come_out_as_if_alone, 0, MK_PLANT_COUNT);
    tcase_add_test(t, stretches_side_by_side_switch_and_shift_each_at_its_own_instant);
    tcase_add_test(t, derivatives_by_forty_columns_are_exact);
    tcase_add_test(t, normal_equations_are_the_sums_of_products_of_the_rows_of_a_joint);
    suite_add_tcase(s, t);
    t = tcase_create("output-error");
    tcase_set_timeout(t, 60);
    tcase_add_loop_test(t, output_error_finds_the_parameters_of_every_plant, 0, MK_PLANT_COUNT);
    tcase_add_test(t, output_error_fits_effects_too);
    tcase_add_test(t, intervals_of_output_error_hold_the_truth_as_often_as_they_say);
    tcase_add_test(t, noise_does_not_decide_what_a_reading_weighs);
    tcase_add_test(t, a_late_row_without_a_command_leaves_a_doubt_that_is_a_number);
    tcase_add_test(t, rounding_evens_out_on_a_way_of_many_counts_and_not_of_few);
    tcase_add_test(t, fast_motion_is_no_noise_of_the_readings_where_another_log_is_slow);
    tcase_add_test(t, a_motion_that_repeats_itself_is_known_by_its_counts);
    tcase_add_test(t, the_beginning_of_a_log_is_the_log_up_to_then);
    tcase_add_test(t, a_piece_of_a_log_keeps_the_time_of_the_log);
    tcase_add_test(t, a_log_that_says_nothing_is_refused);
    suite_add_tcase(s, t);
    return s;
}
