#include "explain/slips.hpp"

#include <algorithm>
#include <cmath>

namespace mk
{

namespace
{

constexpr int SIDE = 6;             // readings on either side
constexpr double COUNTS = 4.0;      // smallest step, in counts
constexpr double OUTSTANDING = 8.0; // over the usual disagreement of both sides

// Value at the edge of a parabola through SIDE readings, `direction` +1 behind the edge, -1 before;
// NaN where readings are missing. The edge is half a sample away from the nearest.
double edge(const std::vector<double> &q, size_t nearest, int direction)
{
    double s[5] = {0.0}, b[3] = {0.0};
    for (int i = 0; i < SIDE; i++) {
        double x = 0.5 + i, y = q[nearest + (size_t)(direction * i)];
        if (std::isnan(y))
            continue;
        double p = 1.0;
        for (int k = 0; k < 5; k++, p *= x) {
            s[k] += p;
            if (k < 3)
                b[k] += p * y;
        }
    }
    if (s[0] < 5.0)
        return std::nan("");
    // Cramer's rule for the constant term.
    auto det = [](double a, double e, double c, double d, double f, double g, double h, double i,
                  double j) {
        return a * (f * j - g * i) - e * (d * j - g * h) + c * (d * i - f * h);
    };
    double whole = det(s[0], s[1], s[2], s[1], s[2], s[3], s[2], s[3], s[4]);
    return det(b[0], s[1], s[2], b[1], s[2], s[3], b[2], s[3], s[4]) / whole;
}

std::vector<double> jumps(const std::vector<double> &q)
{
    std::vector<double> d(q.size(), 0.0);
    for (size_t k = SIDE; k + SIDE < q.size(); k++) {
        double jump = edge(q, k, +1) - edge(q, k - 1, -1);
        d[k] = std::isnan(jump) ? 0.0 : jump;
    }
    return d;
}

double usual(const std::vector<double> &d)
{
    std::vector<double> size;
    for (double x : d)
        size.push_back(std::fabs(x));
    auto at = size.begin() + (std::ptrdiff_t)(size.size() * 9 / 10);
    std::nth_element(size.begin(), at, size.end());
    return *at;
}

} // namespace

std::vector<Slip> find_slips(const std::vector<const FitLog *> &logs, int j)
{
    std::vector<Slip> found;
    for (size_t l = 0; l < logs.size(); l++) {
        const std::vector<double> &q = logs[l]->q[j];
        if (q.size() < 4 * SIDE)
            continue;
        std::vector<double> d = jumps(q);
        double limit = std::max(COUNTS * logs[l]->count[j], OUTSTANDING * usual(d));
        for (size_t k = SIDE; k + SIDE < q.size(); k++) {
            bool peak = std::fabs(d[k]) > limit;
            for (size_t i = k - SIDE; i <= k + SIDE && peak; i++)
                peak = std::fabs(d[i]) <= std::fabs(d[k]);
            // The step sits between two readings, not over several.
            double motion = (q[k - 1] - q[k - 4] + q[k + 3] - q[k]) / 6.0;
            if (peak && std::fabs(q[k] - q[k - 1] - motion) > 0.6 * std::fabs(d[k]))
                found.push_back({l, k, d[k]});
        }
    }
    if (found.empty())
        return found;
    // One step size; what differs is something else.
    std::vector<double> size;
    for (const Slip &s : found)
        size.push_back(std::fabs(s.step));
    std::nth_element(size.begin(), size.begin() + (std::ptrdiff_t)(size.size() / 2), size.end());
    double typical = size[size.size() / 2], tolerance = 0.25 * typical + 2.0 * logs[0]->count[j];
    std::vector<Slip> same;
    for (const Slip &s : found)
        if (std::fabs(std::fabs(s.step) - typical) < tolerance)
            same.push_back(s);
    if (2 * same.size() < found.size() + 1)
        same.clear();
    double mean = 0.0;
    for (const Slip &s : same)
        mean += std::fabs(s.step) / (double)same.size();
    for (Slip &s : same)
        s.step = std::copysign(mean, s.step);
    return same;
}

FitLog without_slips(const FitLog &log, size_t index, int j, const std::vector<Slip> &slips)
{
    FitLog out = log;
    for (const Slip &s : slips)
        if (s.log == index)
            for (size_t k = s.row; k < out.q[j].size(); k++)
                out.q[j][k] -= s.step;
    return out;
}

} // namespace mk
