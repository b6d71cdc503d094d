#include "ident/motion.hpp"

#include <algorithm>
#include <cmath>

namespace mk
{

namespace
{

struct Biquad {
    double b0, b1, b2, a1, a2;
};

Biquad butterworth(double cutoff_hz, double period)
{
    double w = std::tan(M_PI * cutoff_hz * period), k = 1.0 / (1.0 + std::sqrt(2.0) * w + w * w);
    return {w * w * k, 2.0 * w * w * k, w * w * k, 2.0 * (w * w - 1.0) * k,
            (1.0 - std::sqrt(2.0) * w + w * w) * k};
}

// Starts as if the first value had lasted for ever.
void run_filter(const Biquad &f, std::vector<double> &x)
{
    double s1 = x[0] * (1.0 - f.b0), s2 = x[0] * (f.b2 - f.a2);
    for (double &value : x) {
        double y = f.b0 * value + s1;
        s1 = f.b1 * value - f.a1 * y + s2;
        s2 = f.b2 * value - f.a2 * y;
        value = y;
    }
}

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

// Central differences of first and second order; the end rows repeat their neighbours.
void differentiate(const std::vector<double> &q, double h, std::vector<double> &v,
                   std::vector<double> &a)
{
    size_t n = q.size();
    v.resize(n);
    a.resize(n);
    for (size_t k = 1; k + 1 < n; k++) {
        v[k] = (q[k + 1] - q[k - 1]) / (2.0 * h);
        a[k] = (q[k + 1] - 2.0 * q[k] + q[k - 1]) / (h * h);
    }
    v[0] = v[1], a[0] = a[1], v[n - 1] = v[n - 2], a[n - 1] = a[n - 2];
}

} // namespace

std::vector<double> butterworth_zero_phase(const std::vector<double> &x, double cutoff_hz,
                                           double period)
{
    if (x.size() < 3 || cutoff_hz * period >= 0.5)
        return x;
    Biquad f = butterworth(cutoff_hz, period);
    size_t n = x.size(), pad = std::min(n - 1, (size_t)std::ceil(6.0 / (cutoff_hz * period)));
    std::vector<double> y(n + 2 * pad);
    for (size_t k = 0; k < pad; k++) {
        y[k] = 2.0 * x[0] - x[pad - k];
        y[pad + n + k] = 2.0 * x[n - 1] - x[n - 2 - k];
    }
    std::copy(x.begin(), x.end(), y.begin() + (long)pad);
    for (int pass = 0; pass < 2; pass++) {
        run_filter(f, y);
        std::reverse(y.begin(), y.end());
    }
    return std::vector<double>(y.begin() + (long)pad, y.begin() + (long)(pad + n));
}

Motion motion_of_record(const mk_record &r, const mk_model &model, double cutoff_hz)
{
    Motion m;
    m.period = median_period(r);
    m.joints = mk_model_joints(&model);
    size_t n = (size_t)std::floor((r.t[r.rows - 1] - r.t[0]) / m.period + 0.5) + 1;
    n = std::min(n, 4 * r.rows); // a log that slept for hours is no longer than its readings
    m.measured.assign(n, 1);
    for (int j = 0; j < m.joints; j++) {
        m.q[j] =
            butterworth_zero_phase(even_rows(r, r.q[j], m.period, m.measured), cutoff_hz, m.period);
        differentiate(m.q[j], m.period, m.v[j], m.a[j]);
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
        m.u[i] = butterworth_zero_phase(u, cutoff_hz, m.period);
    }
    return m;
}

} // namespace mk
