/* Signals: the zero-phase filter, both differentiators, the smoother's covariance. */
#include "suites.h"

#include <cmath>
#include <cstring>
#include <memory>
#include <random>
#include <vector>

#include "mechkit/signals.h"

namespace
{

constexpr double H = 0.005;

struct Samples {
    std::vector<double> t, q, v, a;
};

/* Two sines as they are; the readings get noise. */
Samples swing(size_t rows)
{
    Samples s;
    for (size_t k = 0; k < rows; k++) {
        double t = H * (double)k;
        s.t.push_back(t);
        s.q.push_back(0.5 * sin(6 * t) + 0.2 * cos(11 * t));
        s.v.push_back(3 * cos(6 * t) - 2.2 * sin(11 * t));
        s.a.push_back(-18 * sin(6 * t) - 24.2 * cos(11 * t));
    }
    return s;
}

std::vector<double> noisy(const std::vector<double> &x, double noise, unsigned seed)
{
    std::mt19937 random(seed);
    std::normal_distribution<double> normal(0, noise);
    std::vector<double> y = x;
    for (double &value : y)
        value += normal(random);
    return y;
}

/* Gain of the filter's middle at a frequency, by projection; `phase` in rad. */
double gain_at(double hz, double cutoff, double *phase)
{
    std::vector<double> x(4000), y(4000);
    double c = 0, s = 0;
    for (size_t k = 0; k < x.size(); k++)
        x[k] = sin(2 * M_PI * hz * H * (double)k);
    ck_assert_int_eq(mk_filter_zero_phase(x.data(), x.size(), H, cutoff, y.data()), MK_OK);
    for (size_t k = 1000; k < 3000; k++) {
        s += y[k] * sin(2 * M_PI * hz * H * (double)k) / 1000;
        c += y[k] * cos(2 * M_PI * hz * H * (double)k) / 1000;
    }
    *phase = atan2(c, s);
    return hypot(c, s);
}

START_TEST(the_filter_has_the_squared_butterworth_gain_and_no_phase)
{
    for (double hz : {1.0, 5.0, 10.0, 20.0}) {
        /* Bilinear Butterworth: |H|^2 = 1 / (1 + (tan(w h / 2) / tan(wc h / 2))^4). */
        double ratio = tan(M_PI * hz * H) / tan(M_PI * 10 * H), phase;
        ck_assert_double_eq_tol(gain_at(hz, 10.0, &phase), 1 / (1 + pow(ratio, 4)), 1e-9);
        ck_assert_double_eq_tol(phase, 0.0, 1e-9);
    }
}
END_TEST

START_TEST(the_filter_passes_a_straight_line)
{
    std::vector<double> x(300), y(300);
    for (size_t k = 0; k < x.size(); k++)
        x[k] = 3.0 - 0.01 * (double)k;
    ck_assert_int_eq(mk_filter_zero_phase(x.data(), x.size(), H, 10.0, y.data()), MK_OK);
    for (size_t k = 0; k < x.size(); k++)
        ck_assert_double_eq_tol(y[k], x[k], 1e-9);
}
END_TEST

START_TEST(the_filter_refuses_a_cut_off_that_is_none)
{
    double x[4] = {0, 1, 2, 3};
    ck_assert_int_eq(mk_filter_zero_phase(x, 4, H, 0.0, x), MK_ERR_INVALID);
    ck_assert_int_eq(mk_filter_zero_phase(x, 4, -H, 10.0, x), MK_ERR_INVALID);
    ck_assert_int_eq(mk_differentiate(x, 2, H, 10.0, x, x, x), MK_ERR_RANGE);
}
END_TEST

START_TEST(the_reports_differentiation_finds_slow_motion)
{
    Samples s = swing(2000);
    std::vector<double> q(2000), v(2000), a(2000);
    ck_assert_int_eq(mk_differentiate(s.q.data(), 2000, H, 40.0, q.data(), v.data(), a.data()),
                     MK_OK);
    for (size_t k = 200; k < 1800; k++) {
        ck_assert_double_eq_tol(q[k], s.q[k], 2e-3);
        ck_assert_double_eq_tol(v[k], s.v[k], 2e-2);
        ck_assert_double_eq_tol(a[k], s.a[k], 0.2);
    }
}
END_TEST

/* Errors of the smoother over many draws in units of the standard deviations that it states, for
 * white jerk, which is what it takes the motion for. */
START_TEST(the_smoothers_covariance_is_that_of_its_errors)
{
    const double noise = 1e-3, jerk = 30.0;
    const size_t rows = 400;
    double square[3] = {0, 0, 0}, count = 0;
    for (unsigned draw = 0; draw < 60; draw++) {
        std::mt19937 random(draw);
        std::normal_distribution<double> normal;
        /* White jerk held over a hundredth of a step: its integral is that of white noise. */
        const int fine = 20;
        std::vector<double> t, q, v, a;
        double x[3] = {0, 0, 0}, h = H / fine;
        for (size_t k = 0; k < rows; k++) {
            t.push_back(H * (double)k), q.push_back(x[0]), v.push_back(x[1]), a.push_back(x[2]);
            for (int i = 0; i < fine; i++) {
                double j = jerk * normal(random) / sqrt(h);
                x[0] += h * x[1] + h * h / 2 * x[2] + h * h * h / 6 * j;
                x[1] += h * x[2] + h * h / 2 * j;
                x[2] += h * j;
            }
        }
        std::vector<double> y = noisy(q, noise, draw + 1000), cov(rows * MK_SMOOTH_COV);
        std::vector<double> qs(rows), vs(rows), as(rows);
        mk_smooth_options o = {noise, jerk, 0};
        ck_assert_int_eq(mk_smooth(t.data(), y.data(), rows, &o, qs.data(), vs.data(), as.data(),
                                   cov.data(), nullptr),
                         MK_OK);
        for (size_t k = 20; k < rows; k += 40) {
            const double *c = &cov[k * MK_SMOOTH_COV];
            square[0] += pow(qs[k] - q[k], 2) / c[0];
            square[1] += pow(vs[k] - v[k], 2) / c[3];
            square[2] += pow(as[k] - a[k], 2) / c[5];
            count++;
        }
    }
    for (double s : square)
        ck_assert_double_eq_tol(s / count, 1.0, 0.2);
}
END_TEST

START_TEST(the_smoother_finds_the_noise_of_the_readings)
{
    const double noise = 1e-3;
    Samples s = swing(2000);
    std::vector<double> y = noisy(s.q, noise, 1), q(2000), v(2000), cov(2000 * MK_SMOOTH_COV);
    mk_smooth_figures found;
    ck_assert_int_eq(mk_smooth(s.t.data(), y.data(), 2000, nullptr, q.data(), v.data(), nullptr,
                               cov.data(), &found),
                     MK_OK);
    ck_assert_double_eq_tol(found.noise, noise, 0.1 * noise);
    ck_assert_uint_eq(found.readings, 2000);
    for (size_t k = 50; k < 1950; k++) {
        ck_assert_double_eq_tol(q[k], s.q[k], 6 * sqrt(cov[k * MK_SMOOTH_COV]));
        ck_assert_double_eq_tol(v[k], s.v[k], 6 * sqrt(cov[k * MK_SMOOTH_COV + 3]));
        ck_assert_double_lt(sqrt(cov[k * MK_SMOOTH_COV]), 0.7 * noise);
    }
}
END_TEST

START_TEST(the_smoother_takes_uneven_rows_and_holes_as_they_are)
{
    Samples s = swing(3000);
    std::mt19937 random(3);
    std::uniform_real_distribution<double> uniform(-0.4, 0.4);
    for (size_t k = 0; k < 3000; k++) {
        double t = s.t[k] += H * uniform(random);
        s.q[k] = 0.5 * sin(6 * t) + 0.2 * cos(11 * t);
        s.v[k] = 3 * cos(6 * t) - 2.2 * sin(11 * t);
    }
    std::vector<double> y = noisy(s.q, 1e-4, 1), v(3000), cov(3000 * MK_SMOOTH_COV);
    for (size_t k = 1000; k < 1010; k++)
        y[k] = NAN;
    ck_assert_int_eq(mk_smooth(s.t.data(), y.data(), 3000, nullptr, y.data(), v.data(), nullptr,
                               cov.data(), nullptr),
                     MK_OK);
    for (size_t k = 100; k < 2900; k++)
        ck_assert_double_eq_tol(v[k], s.v[k], 6 * sqrt(cov[k * MK_SMOOTH_COV + 3]));
    ck_assert_double_gt(cov[1005 * MK_SMOOTH_COV], 10 * cov[900 * MK_SMOOTH_COV]);
}
END_TEST

/* Long data are smoothed in blocks: the seams must not show. */
START_TEST(the_smoothers_blocks_leave_no_seams)
{
    Samples s = swing(9000);
    std::vector<double> y = noisy(s.q, 1e-3, 1), whole(9000), part(600);
    mk_smooth_options o = {1e-3, 300.0, 0};
    ck_assert_int_eq(
        mk_smooth(s.t.data(), y.data(), 9000, &o, whole.data(), nullptr, nullptr, nullptr, nullptr),
        MK_OK);
    size_t first = 2048 - 300;
    ck_assert_int_eq(
        mk_smooth(&s.t[first], &y[first], 600, &o, part.data(), nullptr, nullptr, nullptr, nullptr),
        MK_OK);
    for (size_t k = 250; k < 350; k++)
        ck_assert_double_eq_tol(whole[first + k], part[k], 1e-9);
}
END_TEST

START_TEST(the_smoother_refuses_too_little_and_time_that_stands)
{
    double t[6] = {0, 1, 2, 3, 3, 4}, q[6] = {0, NAN, 1, 2, 3, NAN}, out[6];
    ck_assert_int_eq(mk_smooth(t, q, 6, nullptr, out, nullptr, nullptr, nullptr, nullptr),
                     MK_ERR_RANGE);
    t[4] = 3.5;
    ck_assert_int_eq(mk_smooth(t, q, 6, nullptr, out, nullptr, nullptr, nullptr, nullptr),
                     MK_ERR_RANGE);
}
END_TEST

/* --- repeated runs --- */

struct FreeLog {
    void operator()(mk_log *log) const { mk_log_free(log); }
};
using Log = std::unique_ptr<mk_log, FreeLog>;

/* A pendulum's log of the swing under a command of its own, begun `late` rows into it. */
Log run_of(size_t late, double noise, unsigned seed)
{
    const size_t rows = 600;
    mk_log *log;
    std::mt19937 random(seed);
    std::normal_distribution<double> normal(0, noise);
    ck_assert_int_eq(mk_log_create(rows, &log), MK_OK);
    double *t = mk_log_add_column(log, "t"), *q = mk_log_add_column(log, "q1");
    double *u = mk_log_add_column(log, "u");
    Samples s = swing(rows + late);
    for (size_t k = 0; k < rows; k++) {
        double time = s.t[k + late];
        t[k] = 5.0 + H * (double)k;
        q[k] = s.q[k + late] + normal(random);
        u[k] = 1.5 * sin(6 * time) + sin(time * time);
    }
    return Log(log);
}

struct Averaged {
    mk_repeats *r = nullptr;
    enum mk_status status;
    explicit Averaged(const std::vector<Log> &logs)
    {
        mk_model m;
        mk_model_default(MK_PLANT_PENDULUM, &m);
        std::vector<const mk_log *> views;
        for (const Log &log : logs)
            views.push_back(log.get());
        status = mk_average_runs(&m, views.data(), views.size(), &r, nullptr);
    }
    ~Averaged() { mk_repeats_free(r); }
};

START_TEST(a_mean_of_runs_has_less_noise_and_says_how_much_there_was)
{
    std::vector<Log> logs;
    for (unsigned i = 0; i < 30; i++)
        logs.push_back(run_of(0, 1e-3, i));
    Averaged a(logs);
    ck_assert_int_eq(a.status, MK_OK);
    ck_assert_int_eq(a.r->signals, 2);
    Samples s = swing(600);
    const double *q = mk_log_get(a.r->mean, "q1");
    double square = 0;
    for (size_t k = 0; k < 600; k++)
        square += pow(q[k] - s.q[k], 2) / 600;
    ck_assert_double_eq_tol(sqrt(square), 1e-3 / sqrt(30), 0.1e-3 / sqrt(30));
    ck_assert_double_eq_tol(sqrt(a.r->pooled[0]), 1e-3, 0.05e-3);
    ck_assert_double_eq_tol(a.r->pooled[3], 0.0, 1e-12); /* the command is the same every time */
    double sum = 0;
    for (size_t k = 0; k < 600; k++)
        sum += a.r->covariance[4 * k] / 600;
    ck_assert_double_eq_tol(sum, a.r->pooled[0], 1e-12);
}
END_TEST

START_TEST(runs_that_were_started_late_are_aligned)
{
    std::vector<Log> logs;
    logs.push_back(run_of(40, 1e-3, 1));
    logs.push_back(run_of(0, 1e-3, 2));
    logs.push_back(run_of(73, 1e-3, 3));
    Averaged a(logs);
    ck_assert_int_eq(a.status, MK_OK);
    ck_assert_double_eq_tol(a.r->shift_s[1], 40 * H, 1e-9);
    ck_assert_double_eq_tol(a.r->shift_s[2], -33 * H, 1e-9);
    ck_assert_double_lt(sqrt(a.r->pooled[0]), 1.3e-3);
}
END_TEST

START_TEST(dropped_rows_are_left_out_of_a_mean)
{
    std::vector<Log> logs;
    for (unsigned i = 0; i < 3; i++)
        logs.push_back(run_of(0, 0, i));
    logs[1]->columns[1].data[100] = NAN;
    for (size_t i = 0; i < 3; i++)
        logs[i]->columns[1].data[200] = NAN;
    Averaged a(logs);
    ck_assert_int_eq(a.status, MK_OK);
    const double *q = mk_log_get(a.r->mean, "q1");
    ck_assert_double_eq_tol(q[100], swing(101).q[100], 1e-12);
    ck_assert(std::isnan(q[200]));
    ck_assert(std::isnan(a.r->covariance[4 * 200]));
    ck_assert_double_eq_tol(a.r->covariance[4 * 100], 0.0, 1e-20);
}
END_TEST

START_TEST(a_mean_of_one_run_or_of_different_rates_is_refused)
{
    std::vector<Log> logs;
    logs.push_back(run_of(0, 0, 1));
    ck_assert_int_eq(Averaged(logs).status, MK_ERR_RANGE);
    logs.push_back(run_of(0, 0, 1));
    for (size_t k = 0; k < logs[1]->rows; k++)
        logs[1]->columns[0].data[k] *= 2;
    ck_assert_int_eq(Averaged(logs).status, MK_ERR_RANGE);
}
END_TEST

} // namespace

Suite *suite_signals(void)
{
    Suite *s = suite_create("signals");
    TCase *c = tcase_create("all");
    suite_add_tcase(s, c);
    tcase_add_test(c, the_filter_has_the_squared_butterworth_gain_and_no_phase);
    tcase_add_test(c, the_filter_passes_a_straight_line);
    tcase_add_test(c, the_filter_refuses_a_cut_off_that_is_none);
    tcase_add_test(c, the_reports_differentiation_finds_slow_motion);
    tcase_add_test(c, the_smoothers_covariance_is_that_of_its_errors);
    tcase_add_test(c, the_smoother_finds_the_noise_of_the_readings);
    tcase_add_test(c, the_smoother_takes_uneven_rows_and_holes_as_they_are);
    tcase_add_test(c, the_smoothers_blocks_leave_no_seams);
    tcase_add_test(c, the_smoother_refuses_too_little_and_time_that_stands);
    tcase_add_test(c, a_mean_of_runs_has_less_noise_and_says_how_much_there_was);
    tcase_add_test(c, runs_that_were_started_late_are_aligned);
    tcase_add_test(c, dropped_rows_are_left_out_of_a_mean);
    tcase_add_test(c, a_mean_of_one_run_or_of_different_rates_is_refused);
    return s;
}
