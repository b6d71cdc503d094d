#include "explain/search/missed_counts.hpp"
#include "explain/policy.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace mk
{

namespace
{

constexpr int SIDE = 6; // readings on either side

// A parabola through the readings on one side of an edge.
struct Side {
    double value = 0.0, leverage = 0.0, squares = 0.0; // at the edge; of the residuals
    int readings = 0;                                  // 0: too few
};

// `direction` +1 behind the edge, -1 before, which is half a sample away from the nearest reading.
Side side_of(const std::vector<double> &q, size_t nearest, int direction)
{
    Eigen::Matrix<double, SIDE, 3> powers;
    Eigen::Matrix<double, SIDE, 1> y;
    Side side;
    for (int i = 0; i < SIDE; i++) {
        double x = 0.5 + i, reading = q[nearest + (size_t)(direction * i)];
        bool there = !std::isnan(reading);
        powers.row(i) << there, there * x, there * x * x;
        y(i) = there ? reading : 0.0;
        side.readings += there;
    }
    if (side.readings < SIDE - 1)
        return {};
    const Eigen::Matrix3d inverse = (powers.transpose() * powers).inverse();
    const Eigen::Vector3d fit = inverse * (powers.transpose() * y);
    side.value = fit(0);
    side.leverage = inverse(0, 0);
    side.squares = (y - powers * fit).squaredNorm();
    return side;
}

struct Jump {
    double size = 0.0;         // of the reading before a row to that row, motion apart, rad
    double significance = 0.0; // over its standard error
};

std::vector<Jump> jumps(const std::vector<double> &q, double count)
{
    std::vector<Jump> d(q.size());
    for (size_t k = SIDE; k + SIDE < q.size(); k++) {
        const Side after = side_of(q, k, +1), before = side_of(q, k - 1, -1);
        if (after.readings == 0 || before.readings == 0)
            continue;
        double scatter = (after.squares + before.squares) / (after.readings + before.readings - 6);
        double variance = std::max(scatter, count * count / 12.0);
        d[k].size = after.value - before.value;
        d[k].significance =
            std::fabs(d[k].size) / std::sqrt(variance * (after.leverage + before.leverage));
    }
    return d;
}

// The step from the reading before row k to that at it beyond the motion on both sides. A reading
// that is missing is made up for by the next one outward.
double step_at(const std::vector<double> &q, size_t k)
{
    auto reading = [&](size_t row, int outward) {
        return std::isnan(q[row]) ? row + (size_t)outward : row;
    };
    const size_t before = reading(k - 1, -1), far_before = reading(k - 4, -1);
    const size_t after = reading(k, +1), far_after = reading(k + 3, +1);
    const double speed = 0.5 * ((q[before] - q[far_before]) / (double)(before - far_before) +
                                (q[far_after] - q[after]) / (double)(far_after - after));
    return q[after] - q[before] - speed * (double)(after - before);
}

// Least squares of the readings around the edge before row k; terms(x) are functions of the samples
// from the edge.
template <int TERMS>
struct Around {
    Eigen::Matrix<double, TERMS, 1> coefficient;
    double squares; // that are left

    template <class F>
    Around(const std::vector<double> &q, size_t k, F &&terms)
    {
        constexpr int ALL = 2 * SIDE;
        Eigen::Matrix<double, ALL, TERMS> columns;
        Eigen::Matrix<double, ALL, 1> y;
        for (int i = 0; i < ALL; i++) {
            const double reading = q[k - SIDE + (size_t)i], there = !std::isnan(reading);
            columns.row(i) = there * terms(i - SIDE + 0.5);
            y(i) = there > 0.0 ? reading : 0.0;
        }
        coefficient = columns.colPivHouseholderQr().solve(y);
        squares = (y - columns * coefficient).squaredNorm();
    }
};

using FiveTerms = Eigen::Matrix<double, 1, 5>;

// A step, and a parabola that may bend otherwise behind it.
Around<5> step_around(const std::vector<double> &q, size_t k)
{
    return Around<5>(q, k, [](double x) {
        FiveTerms row;
        const double behind = x > 0.0 ? 1.0 : 0.0;
        row << behind, 1.0, x, x * x, behind * x * x;
        return row;
    });
}

// How many times better such a step explains the readings than an impulse does, after which the
// joint is where it was, moving at another speed: of impulses somewhere between the rows beside the
// edge the best one. `count`: of the encoder; nobody sees less.
double step_over_impulse(const std::vector<double> &q, size_t k, double step_squares, double count)
{
    const double unseen = 2 * SIDE * count * count / 12.0;
    double impulse = HUGE_VAL;
    for (double at = -1.5; at <= 1.5; at += 0.25)
        impulse = std::min(impulse, Around<5>(q, k, [at](double x) {
                                        FiveTerms row;
                                        const double behind = std::max(x - at, 0.0);
                                        row << 1.0, x, x * x, behind, behind * behind;
                                        return row;
                                    }).squares);
    return (impulse + unseen) / (step_squares + unseen);
}

double usual(const std::vector<Jump> &d)
{
    std::vector<double> size;
    for (const Jump &x : d)
        size.push_back(x.significance);
    auto at = size.begin() + (std::ptrdiff_t)(size.size() * 9 / 10);
    std::nth_element(size.begin(), at, size.end());
    return *at;
}

} // namespace

bool is_step_of(double step, double size, double count)
{
    return std::fabs(std::fabs(step) - size) < 0.25 * size + 2.0 * count;
}

// Of steps those of the one size that most have, made equal; none where most are of other sizes:
// then they are something else. `count`: of the encoder.
static std::vector<MissedCount> of_one_size(const std::vector<MissedCount> &found, double count)
{
    std::vector<MissedCount> same;
    if (found.empty())
        return same;
    std::vector<double> size;
    for (const MissedCount &s : found)
        size.push_back(std::fabs(s.step));
    std::nth_element(size.begin(), size.begin() + (std::ptrdiff_t)(size.size() / 2), size.end());
    const double typical = size[size.size() / 2];
    for (const MissedCount &s : found)
        if (is_step_of(s.step, typical, count))
            same.push_back(s);
    if (2 * same.size() < found.size() + 1)
        same.clear();
    double mean = 0.0;
    for (const MissedCount &s : same)
        mean += std::fabs(s.step) / (double)same.size();
    for (MissedCount &s : same)
        s.step = std::copysign(mean, s.step);
    return same;
}

std::vector<MissedCount> find_missed_counts(const std::vector<const FitLog *> &logs, int j)
{
    std::vector<MissedCount> found;
    for (size_t l = 0; l < logs.size(); l++) {
        const std::vector<double> &q = logs[l]->q[j];
        if (q.size() < 4 * SIDE)
            continue;
        const std::vector<Jump> d = jumps(q, logs[l]->count[j]);
        const double limit =
            std::max(policy::STEP_SIGNIFICANT, policy::STEP_OUTSTANDING * usual(d));
        for (size_t k = SIDE; k + SIDE < q.size(); k++) {
            bool peak = d[k].significance > limit &&
                        std::fabs(d[k].size) > policy::STEP_COUNTS * logs[l]->count[j];
            for (size_t i = k - SIDE; i <= k + SIDE && peak; i++)
                peak = d[i].significance <= d[k].significance;
            // The step sits between two readings, not over several, and is all that differs there:
            // a turn that no parabola follows has another.
            if (!peak || std::fabs(step_at(q, k) - d[k].size) >= 0.4 * std::fabs(d[k].size))
                continue;
            const double count = logs[l]->count[j];
            const Around<5> around = step_around(q, k);
            found.push_back({l, k, around.coefficient(0),
                             step_over_impulse(q, k, around.squares, count),
                             std::fabs(around.coefficient(0))});
        }
    }
    return found.empty() ? found : of_one_size(found, logs[0]->count[j]);
}

bool surely_steps(const std::vector<MissedCount> &found)
{
    const auto distinct = std::count_if(found.begin(), found.end(), [](const MissedCount &s) {
        return s.distinct > policy::STEP_DISTINCT;
    });
    return found.size() >= policy::FEWEST_STEPS &&
           (double)distinct >= policy::STEPS_DISTINCT * (double)found.size();
}

FitLog with_corrected_counts(const FitLog &log, size_t index, int j,
                             const std::vector<MissedCount> &missed)
{
    FitLog out = log;
    for (const MissedCount &s : missed)
        if (s.log == index)
            for (size_t k = s.row; k < out.q[j].size(); k++)
                out.q[j][k] -= s.step;
    return out;
}

} // namespace mk
