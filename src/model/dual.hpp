// Forward-mode derivatives: a value and N partial derivatives that travel together.
#ifndef MECHKIT_MODEL_DUAL_HPP
#define MECHKIT_MODEL_DUAL_HPP

#include "model/chain.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

template <int N>
struct Dual {
    using Number = double;

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
inline Dual<N> fabs(const Dual<N> &x)
{
    return x.v < 0.0 ? -x : x;
}
template <int N>
inline Dual<N> if_positive(const Dual<N> &x, const Dual<N> &a, const Dual<N> &b)
{
    return x.v > 0.0 ? a : b;
}

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
