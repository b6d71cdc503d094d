// Forward-mode derivatives: a value and N partial derivatives that travel together.
#ifndef MECHKIT_MODEL_DUAL_HPP
#define MECHKIT_MODEL_DUAL_HPP

#include "model/scalar.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

template <int N>
struct Dual {
    double v = 0.0;
    double d[N] = {};

    Dual() = default;
    Dual(double value) : v(value) {} // implicit: constants mix freely with variables in laws

    static Dual variable(double value, int index)
    {
        Dual x(value);
        x.d[index] = 1.0;
        return x;
    }
    // f(x) with df/dx = slope.
    Dual chain(double f, double slope) const
    {
        Dual r(f);
        for (int i = 0; i < N; i++)
            r.d[i] = slope * d[i];
        return r;
    }
    Dual &operator+=(const Dual &b)
    {
        v += b.v;
        for (int i = 0; i < N; i++)
            d[i] += b.d[i];
        return *this;
    }
    Dual &operator-=(const Dual &b)
    {
        v -= b.v;
        for (int i = 0; i < N; i++)
            d[i] -= b.d[i];
        return *this;
    }
    Dual &operator*=(const Dual &b) { return *this = *this * b; }
    Dual operator-() const { return chain(-v, -1.0); }
    friend Dual operator+(Dual a, const Dual &b) { return a += b; }
    friend Dual operator-(Dual a, const Dual &b) { return a -= b; }
    friend Dual operator*(const Dual &a, const Dual &b)
    {
        Dual r(a.v * b.v);
        for (int i = 0; i < N; i++)
            r.d[i] = a.v * b.d[i] + b.v * a.d[i];
        return r;
    }
    friend Dual operator/(const Dual &a, const Dual &b)
    {
        double inv = 1.0 / b.v, f = a.v * inv;
        Dual r(f);
        for (int i = 0; i < N; i++)
            r.d[i] = (a.d[i] - f * b.d[i]) * inv;
        return r;
    }
    friend Dual operator+(Dual a, double b) { return a.v += b, a; }
    friend Dual operator+(double b, Dual a) { return a.v += b, a; }
    friend Dual operator-(Dual a, double b) { return a.v -= b, a; }
    friend Dual operator-(double b, const Dual &a) { return a.chain(b - a.v, -1.0); }
    friend Dual operator*(const Dual &a, double b) { return a.chain(a.v * b, b); }
    friend Dual operator*(double b, const Dual &a) { return a.chain(a.v * b, b); }
    friend Dual operator/(const Dual &a, double b) { return a * (1.0 / b); }
};

template <int N>
inline void sincos(const Dual<N> &x, Dual<N> &s, Dual<N> &c)
{
    double sv, cv;
    sincos(x.v, sv, cv);
    s = x.chain(sv, cv);
    c = x.chain(cv, -sv);
}
template <int N>
inline Dual<N> sin(const Dual<N> &x)
{
    double s, c;
    sincos(x.v, s, c);
    return x.chain(s, c);
}
template <int N>
inline Dual<N> cos(const Dual<N> &x)
{
    double s, c;
    sincos(x.v, s, c);
    return x.chain(c, -s);
}
template <int N>
inline Dual<N> tanh(const Dual<N> &x)
{
    double f = tanh(x.v);
    return x.chain(f, 1.0 - f * f);
}
template <int N>
inline Dual<N> exp(const Dual<N> &x)
{
    double f = exp(x.v);
    return x.chain(f, f);
}
template <int N>
inline Dual<N> sqrt(const Dual<N> &x)
{
    double f = sqrt(x.v);
    return x.chain(f, 0.5 / f);
}
template <int N>
inline Dual<N> fabs(const Dual<N> &x)
{
    return x.v < 0.0 ? -x : x;
}
template <int N>
inline double value_of(const Dual<N> &x)
{
    return x.v;
}
template <int N>
inline Dual<N> if_positive(const Dual<N> &x, const Dual<N> &a, const Dual<N> &b)
{
    return x.v > 0.0 ? a : b;
}

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
