#include "ident/track.hpp"

#include <algorithm>
#include <cmath>
#include <new>

#include "mechkit/signals.h"
#include "sim/period.hpp"

namespace mk
{

namespace
{

// Factor on the jerk's intensity. At 1 the smoother's bend at friction's reversals pulls a
// pendubot's p1 off by 0.15 %, four times what 30 runs leave of the noise; at 5 by 0.03 %.
constexpr double ROUGHNESS = 5.0;
// A hole of one row is bridged, a longer one ends what can be used.
constexpr double LONGEST_GAP = 2.5;

// Even times and, between them, the times of readings that are off; which rows are the even ones.
struct Grid {
    double start, period;
    size_t rows;
    double time(size_t i) const { return start + period * (double)i; }
};

void demand(enum mk_status status)
{
    if (status != MK_OK) // rows were counted: what can fail is memory
        throw std::bad_alloc();
}

// Readings with the grid's times among them, smoothed.
struct Merged {
    std::vector<double> t, q;
    std::vector<char> even;

    Merged(const Grid &grid, const mk_record &r, const double *angle)
    {
        size_t most = grid.rows + r.rows / 8;
        t.reserve(most), q.reserve(most), even.reserve(most);
        size_t i = 0;
        for (size_t k = 0; k < r.rows; k++) {
            // A reading within a hundredth of a period of a grid time counts as taken then.
            while (i < grid.rows && grid.time(i) < r.t[k] - 0.01 * grid.period)
                add(grid.time(i++), NAN, true);
            if (i < grid.rows && grid.time(i) < r.t[k] + 0.01 * grid.period)
                add(grid.time(i++), angle[k], true);
            else if (!std::isnan(angle[k]))
                add(r.t[k], angle[k], false);
        }
        while (i < grid.rows)
            add(grid.time(i++), NAN, true);
    }
    void add(double time, double reading, bool is_even)
    {
        t.push_back(time), q.push_back(reading), even.push_back(is_even);
    }
    void keep_even(std::vector<double> &x) const
    {
        size_t n = 0;
        for (size_t k = 0; k < x.size(); k++)
            if (even[k])
                x[n++] = x[k];
        x.resize(n);
        x.shrink_to_fit();
    }
};

void smooth_joint(const Grid &grid, const mk_record &r, int j, Track &out)
{
    Merged m(grid, r, r.q[j]);
    size_t n = m.t.size();
    out.q[j].resize(n), out.v[j].resize(n), out.a[j].resize(n);
    mk_smooth_options options = {};
    options.roughness = ROUGHNESS;
    mk_smooth_figures found;
    demand(mk_smooth(m.t.data(), m.q.data(), n, &options, out.q[j].data(), out.v[j].data(),
                     out.a[j].data(), nullptr, &found));
    out.noise[j] = found.noise;
    for (std::vector<double> *x : {&out.q[j], &out.v[j], &out.a[j]})
        m.keep_even(*x);
}

// Marks rows between values that are far apart.
void mark_holes(const Grid &grid, const mk_record &r, const double *x, std::vector<char> &measured)
{
    double last = -HUGE_VAL;
    for (size_t k = 0; k <= r.rows; k++) {
        if (k < r.rows && std::isnan(x[k]))
            continue;
        double now = k < r.rows ? r.t[k] : HUGE_VAL;
        if (now - last > LONGEST_GAP * grid.period) {
            double from = std::max(0.0, (last - grid.start) / grid.period + 0.5);
            double to = std::min((double)grid.rows, (now - grid.start) / grid.period - 0.5);
            for (double i = std::ceil(from); i < to; i++)
                measured[(size_t)i] = 0;
        }
        last = now;
    }
}

// Mean of the command over the period from each grid time on; across a missing row a straight line.
std::vector<double> command(const Grid &grid, const mk_record &r, const double *u, double limit)
{
    std::vector<double> out(grid.rows, 0.0);
    auto value = [&](size_t k) { return std::clamp(u[k], -limit, limit); };
    size_t k = 0, next = 0;
    for (size_t i = 0; i < grid.rows; i++) {
        double now = grid.time(i), end = now + grid.period, sum = 0.0, at = now;
        while (at < end - 1e-9 * grid.period) {
            while (next < r.rows && (r.t[next] <= at + 0.01 * grid.period || std::isnan(u[next]))) {
                k = std::isnan(u[next]) ? k : next;
                next++;
            }
            double until = next < r.rows ? std::min(end, r.t[next]) : end;
            double held = std::isnan(u[k]) ? 0.0 : value(k);
            double age = (at - r.t[k]) / grid.period;
            if (next < r.rows && age > 0.98)
                held += (value(next) - held) * (at - r.t[k]) / (r.t[next] - r.t[k]);
            sum += held * (until - at);
            at = until;
        }
        out[i] = sum / grid.period;
    }
    return out;
}

} // namespace

Track track_of_record(const mk_record &r, const mk_model &model)
{
    Track out;
    Grid grid = {r.t[0], median_period(r.t, r.rows), 0};
    grid.rows = (size_t)std::floor((r.t[r.rows - 1] - r.t[0]) / grid.period + 0.5) + 1;
    grid.rows = std::min(grid.rows, 4 * r.rows); // a log that slept is no longer than its readings
    out.period = grid.period;
    out.joints = mk_model_joints(&model);
    out.measured.assign(grid.rows, 1);
    for (int j = 0; j < out.joints; j++) {
        smooth_joint(grid, r, j, out);
        mark_holes(grid, r, r.q[j], out.measured);
    }
    for (int i = 0; i < MK_MAX_INPUTS; i++) {
        if (!r.u[i])
            continue;
        out.u[i] = command(grid, r, r.u[i], i == 0 ? model.u_max : HUGE_VAL);
        mark_holes(grid, r, r.u[i], out.measured);
    }
    return out;
}

} // namespace mk
