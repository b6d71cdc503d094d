#include "ident/motion.hpp"

#include <algorithm>
#include <cmath>
#include <new>

#include "mechkit/signals.h"

namespace mk
{

namespace
{

double median_period(const mk_record &r)
{
    std::vector<double> d(r.rows - 1);
    for (size_t k = 0; k + 1 < r.rows; k++)
        d[k] = r.t[k + 1] - r.t[k];
    std::nth_element(d.begin(), d.begin() + (long)(d.size() / 2), d.end());
    return d[d.size() / 2];
}

// Values at even times; `measured` falls to 0 where the nearest readings are far apart.
std::vector<double> even_rows(const mk_record &r, const double *x, double period,
                              std::vector<char> &measured)
{
    std::vector<double> out(measured.size(), 0.0);
    size_t left = SIZE_MAX, next = 0;
    for (size_t i = 0; i < out.size(); i++) {
        double t = r.t[0] + period * (double)i;
        while (next < r.rows && (std::isnan(x[next]) || r.t[next] < t)) {
            left = std::isnan(x[next]) ? left : next;
            next++;
        }
        size_t right = next < r.rows ? next : left, from = left == SIZE_MAX ? right : left;
        if (right == SIZE_MAX)
            break;
        double gap = r.t[right] - r.t[from];
        out[i] = gap > 0.0 ? x[from] + (x[right] - x[from]) * (t - r.t[from]) / gap : x[right];
        measured[i] = measured[i] && gap < 1.75 * period;
    }
    return out;
}

// What can fail on rows that were checked is memory.
void demand(enum mk_status status)
{
    if (status != MK_OK)
        throw std::bad_alloc();
}

} // namespace

Motion motion_of_record(const mk_record &r, const mk_model &model, double cutoff_hz)
{
    Motion m;
    m.period = median_period(r);
    m.joints = mk_model_joints(&model);
    size_t n = (size_t)std::floor((r.t[r.rows - 1] - r.t[0]) / m.period + 0.5) + 1;
    n = std::min(n, 4 * r.rows); // a log that slept for hours is no longer than its readings
    m.measured.assign(n, 1);
    for (int j = 0; j < m.joints; j++) {
        m.q[j] = even_rows(r, r.q[j], m.period, m.measured);
        m.v[j].resize(n), m.a[j].resize(n);
        demand(mk_differentiate(m.q[j].data(), n, m.period, cutoff_hz, m.q[j].data(), m.v[j].data(),
                                m.a[j].data()));
    }
    for (int i = 0; i < MK_MAX_INPUTS; i++) {
        if (!r.u[i])
            continue;
        std::vector<double> u = even_rows(r, r.u[i], m.period, m.measured);
        if (i == 0)
            for (double &x : u)
                x = std::clamp(x, -model.u_max, model.u_max);
        // A command holds to the next row: a second difference sees half of either side.
        for (size_t k = n - 1; k > 0; k--)
            u[k] = 0.5 * (u[k] + u[k - 1]);
        m.u[i].resize(n);
        demand(mk_filter_zero_phase(u.data(), n, m.period, cutoff_hz, m.u[i].data()));
    }
    return m;
}

} // namespace mk
