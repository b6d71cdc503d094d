// The report's filter and differentiation (chapter 3).
#include "mechkit/signals.h"

#include <algorithm>
#include <cmath>
#include <new>
#include <vector>

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

} // namespace

enum mk_status mk_filter_zero_phase(const double *x, size_t rows, double period_s, double cutoff_hz,
                                    double *out)
try {
    if (!(period_s > 0.0) || !(cutoff_hz > 0.0))
        return MK_ERR_INVALID;
    if (rows < 3 || cutoff_hz * period_s >= 0.5) {
        std::copy_n(x, rows, out);
        return MK_OK;
    }
    Biquad f = butterworth(cutoff_hz, period_s);
    size_t pad = std::min(rows - 1, (size_t)std::ceil(6.0 / (cutoff_hz * period_s)));
    std::vector<double> y(rows + 2 * pad);
    for (size_t k = 0; k < pad; k++) {
        y[k] = 2.0 * x[0] - x[pad - k];
        y[pad + rows + k] = 2.0 * x[rows - 1] - x[rows - 2 - k];
    }
    std::copy_n(x, rows, y.begin() + (long)pad);
    for (int pass = 0; pass < 2; pass++) {
        run_filter(f, y);
        std::reverse(y.begin(), y.end());
    }
    std::copy_n(y.begin() + (long)pad, rows, out);
    return MK_OK;
} catch (const std::bad_alloc &) {
    return MK_ERR_NOMEM;
}

enum mk_status mk_differentiate(const double *q, size_t rows, double period_s, double cutoff_hz,
                                double *q_out, double *v, double *a)
{
    if (rows < 3)
        return MK_ERR_RANGE;
    enum mk_status st =
        mk_filter_zero_phase(q, rows, period_s, cutoff_hz > 0.0 ? cutoff_hz : MK_CUTOFF_HZ, q_out);
    if (st != MK_OK)
        return st;
    for (size_t k = 1; k + 1 < rows; k++) {
        v[k] = (q_out[k + 1] - q_out[k - 1]) / (2.0 * period_s);
        a[k] = (q_out[k + 1] - 2.0 * q_out[k] + q_out[k - 1]) / (period_s * period_s);
    }
    v[0] = v[1], a[0] = a[1];
    v[rows - 1] = v[rows - 2], a[rows - 1] = a[rows - 2];
    return MK_OK;
}
