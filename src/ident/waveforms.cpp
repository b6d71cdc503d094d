#include "ident/waveforms.hpp"

#include <cmath>

#include "mechkit/number.h"

namespace mk
{

namespace
{

// To so many decimals: what goes into a file is read by people, too.
double rounded(double x, double decimals)
{
    double unit = std::pow(10.0, decimals);
    return std::round(x * unit) / unit;
}

std::string number(double x)
{
    char text[MK_NUMBER_MAX];
    mk_format_double(text, x);
    return text;
}

} // namespace

Series::Series(double w, const Eigen::VectorXd &amplitudes, double q_start)
    : omega(w), offset(q_start)
{
    long more = amplitudes.size() / 2;
    a.assign((size_t)more + 1, 0.0);
    b.assign((size_t)more + 1, 0.0);
    for (long i = 0; i < more; i++) {
        size_t l = (size_t)i + 1; // harmonic l + 1
        double lw = (double)(l + 1) * omega;
        a[l] = lw * amplitudes(i);
        b[l] = lw * amplitudes(more + i);
        a[0] -= a[l];
        b[0] -= (double)(l + 1) * b[l];
    }
    for (size_t l = 0; l < b.size(); l++)
        offset += b[l] / ((double)(l + 1) * omega);
}

void Series::at(double t, double &q, double &v, double &acc) const
{
    q = offset;
    v = acc = 0.0;
    for (size_t l = 0; l < a.size(); l++) {
        double lw = (double)(l + 1) * omega, s = std::sin(lw * t), c = std::cos(lw * t);
        q += (a[l] * s - b[l] * c) / lw;
        v += a[l] * c + b[l] * s;
        acc += lw * (b[l] * c - a[l] * s);
    }
}

Multisine::Multisine(double u_limit, double w, const Eigen::VectorXd &x)
    : limit(u_limit), omega(rounded(w, 5)),
      coefficients(x.unaryExpr([](double c) { return rounded(c, 4); }))
{
}

double Multisine::at(double t) const
{
    double sum = 0.0;
    for (long i = 0; i + 1 < coefficients.size(); i += 2) {
        double phase = omega * (double)(i / 2 + 1) * t;
        sum += coefficients(i) * std::sin(phase) + coefficients(i + 1) * std::cos(phase);
    }
    return limit * std::tanh(sum);
}

std::string Multisine::text() const
{
    std::string out = number(limit) + "*tanh(";
    for (long i = 0; i < coefficients.size(); i++) {
        double c = coefficients(i);
        if (i > 0 && c >= 0.0)
            out += '+';
        std::string phase = number(rounded(omega * (double)(i / 2 + 1), 5));
        out += number(c) + (i % 2 ? "*cos(" : "*sin(") + phase + "*t)";
    }
    return out + ")";
}

} // namespace mk
