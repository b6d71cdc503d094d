// Forward-mode derivatives by many variables of which most expressions see few: only those that
// are not zero by structure are kept and computed. B is what numbers are made of: double, or
// Pack<W> for W evaluations side by side.
#ifndef MECHKIT_MODEL_SPARSE_DUAL_HPP
#define MECHKIT_MODEL_SPARSE_DUAL_HPP

#include <stdint.h>
#include <type_traits>

#include "model/chain.hpp"
#include "model/simd.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

// The compiler does not see that `mask` guards what is not set.
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif

template <class B>
struct SparseDual {
    using Number = B;
    static constexpr int MOST = 32;

    B v;
    uint32_t mask; // bit i: d[i] holds the derivative by variable i; else that is zero
    B d[MOST];

    // Implicit: constants mix freely with variables in laws.
    SparseDual() : v(0.0), mask(0) {}
    SparseDual(const B &value) : v(value), mask(0) {}
    template <class T, class = std::enable_if_t<std::is_same_v<T, double> && !std::is_same_v<T, B>>>
    SparseDual(T value) : v(value), mask(0)
    {
    }
    SparseDual(const SparseDual &x) : v(x.v), mask(x.mask) { copy(x); }
    SparseDual &operator=(const SparseDual &x)
    {
        v = x.v;
        mask = x.mask;
        copy(x);
        return *this;
    }

    // Makes it variable i.
    void seed(int i, const B &slope)
    {
        mask |= 1u << i;
        d[i] = slope;
    }
    // f(x) with df/dx = slope.
    SparseDual chain(const B &f, const B &slope) const
    {
        SparseDual r(f);
        r.mask = mask;
        each(mask, [&](int i) { r.d[i] = slope * d[i]; });
        return r;
    }
    SparseDual &operator+=(const SparseDual &b)
    {
        v += b.v;
        each(b.mask & mask, [&](int i) { d[i] += b.d[i]; });
        each(b.mask & ~mask, [&](int i) { d[i] = b.d[i]; });
        mask |= b.mask;
        return *this;
    }
    SparseDual &operator-=(const SparseDual &b)
    {
        v -= b.v;
        each(b.mask & mask, [&](int i) { d[i] -= b.d[i]; });
        each(b.mask & ~mask, [&](int i) { d[i] = -b.d[i]; });
        mask |= b.mask;
        return *this;
    }
    SparseDual &operator*=(const SparseDual &b) { return *this = *this * b; }
    SparseDual operator-() const { return chain(-v, B(-1.0)); }
    friend SparseDual operator+(const SparseDual &a, const SparseDual &b)
    {
        SparseDual r(a.v + b.v);
        r.mask = a.mask | b.mask;
        each(a.mask & b.mask, [&](int i) { r.d[i] = a.d[i] + b.d[i]; });
        each(a.mask & ~b.mask, [&](int i) { r.d[i] = a.d[i]; });
        each(b.mask & ~a.mask, [&](int i) { r.d[i] = b.d[i]; });
        return r;
    }
    friend SparseDual operator-(const SparseDual &a, const SparseDual &b)
    {
        SparseDual r(a.v - b.v);
        r.mask = a.mask | b.mask;
        each(a.mask & b.mask, [&](int i) { r.d[i] = a.d[i] - b.d[i]; });
        each(a.mask & ~b.mask, [&](int i) { r.d[i] = a.d[i]; });
        each(b.mask & ~a.mask, [&](int i) { r.d[i] = -b.d[i]; });
        return r;
    }
    friend SparseDual operator*(const SparseDual &a, const SparseDual &b)
    {
        SparseDual r(a.v * b.v);
        r.mask = a.mask | b.mask;
        each(a.mask & b.mask, [&](int i) { r.d[i] = a.v * b.d[i] + b.v * a.d[i]; });
        each(a.mask & ~b.mask, [&](int i) { r.d[i] = b.v * a.d[i]; });
        each(b.mask & ~a.mask, [&](int i) { r.d[i] = a.v * b.d[i]; });
        return r;
    }
    friend SparseDual operator/(const SparseDual &a, const SparseDual &b)
    {
        B inv = 1.0 / b.v, f = a.v * inv, by = -(f * inv);
        SparseDual r(f);
        r.mask = a.mask | b.mask;
        each(a.mask & b.mask, [&](int i) { r.d[i] = inv * a.d[i] + by * b.d[i]; });
        each(a.mask & ~b.mask, [&](int i) { r.d[i] = inv * a.d[i]; });
        each(b.mask & ~a.mask, [&](int i) { r.d[i] = by * b.d[i]; });
        return r;
    }
    friend SparseDual operator+(SparseDual a, const B &b) { return a.v += b, a; }
    friend SparseDual operator+(const B &b, SparseDual a) { return a.v += b, a; }
    friend SparseDual operator-(SparseDual a, const B &b) { return a.v -= b, a; }
    friend SparseDual operator-(const B &b, const SparseDual &a)
    {
        return a.chain(b - a.v, B(-1.0));
    }
    friend SparseDual operator*(const SparseDual &a, const B &b) { return a.chain(a.v * b, b); }
    friend SparseDual operator*(const B &b, const SparseDual &a) { return a.chain(a.v * b, b); }
    friend SparseDual operator/(const SparseDual &a, const B &b) { return a * (1.0 / b); }

    template <class F>
    static void each(uint32_t bits, F &&f)
    {
        for (; bits; bits &= bits - 1)
            f(__builtin_ctz(bits));
    }

  private:
    void copy(const SparseDual &x)
    {
        each(mask, [&](int i) { d[i] = x.d[i]; });
    }
};

// Where B is not double, plain numbers mix too.
#define MK_DUAL_AND_NUMBER(op)                                                                     \
    template <int W>                                                                               \
    inline SparseDual<Pack<W>> operator op(const SparseDual<Pack<W>> &a, double b)                 \
    {                                                                                              \
        return a op Pack<W>(b);                                                                    \
    }                                                                                              \
    template <int W>                                                                               \
    inline SparseDual<Pack<W>> operator op(double b, const SparseDual<Pack<W>> &a)                 \
    {                                                                                              \
        return Pack<W>(b) op a;                                                                    \
    }
MK_DUAL_AND_NUMBER(+)
MK_DUAL_AND_NUMBER(-)
MK_DUAL_AND_NUMBER(*)
#undef MK_DUAL_AND_NUMBER
template <int W>
inline SparseDual<Pack<W>> operator/(const SparseDual<Pack<W>> &a, double b)
{
    return a * (1.0 / b);
}
template <class B>
inline SparseDual<B> operator/(double b, const SparseDual<B> &a)
{
    B inv = 1.0 / a.v, f = b * inv;
    return a.chain(f, -(f * inv));
}

template <class B>
inline SparseDual<B> fabs(const SparseDual<B> &x)
{
    return x.chain(fabs(x.v), if_positive(-x.v, B(-1.0), B(1.0)));
}
template <class B>
inline SparseDual<B> if_positive(const SparseDual<B> &x, const SparseDual<B> &a,
                                 const SparseDual<B> &b)
{
    if constexpr (std::is_same_v<B, double>) {
        return x.v > 0.0 ? a : b;
    } else {
        const B none(0.0);
        SparseDual<B> r(if_positive(x.v, a.v, b.v));
        r.mask = a.mask | b.mask;
        SparseDual<B>::each(a.mask & b.mask,
                            [&](int i) { r.d[i] = if_positive(x.v, a.d[i], b.d[i]); });
        SparseDual<B>::each(a.mask & ~b.mask,
                            [&](int i) { r.d[i] = if_positive(x.v, a.d[i], none); });
        SparseDual<B>::each(b.mask & ~a.mask,
                            [&](int i) { r.d[i] = if_positive(x.v, none, b.d[i]); });
        return r;
    }
}

// Written in place: neither s nor c is x.
template <class B>
inline void sincos(const SparseDual<B> &x, SparseDual<B> &s, SparseDual<B> &c)
{
    sincos(x.v, s.v, c.v);
    const B falling = -s.v;
    s.mask = c.mask = x.mask;
    SparseDual<B>::each(x.mask, [&](int i) {
        s.d[i] = c.v * x.d[i];
        c.d[i] = falling * x.d[i];
    });
}

// sum += a b, and with it sum' += a' b + a b'.
template <class B>
inline void add_product(SparseDual<B> &sum, const SparseDual<B> &a, const SparseDual<B> &b)
{
    const uint32_t mask = a.mask | b.mask;
    sum.v += a.v * b.v;
    SparseDual<B>::each(mask & ~sum.mask, [&](int i) { sum.d[i] = B(0.0); });
    sum.mask |= mask;
    SparseDual<B>::each(a.mask, [&](int i) { sum.d[i] += b.v * a.d[i]; });
    SparseDual<B>::each(b.mask, [&](int i) { sum.d[i] += a.v * b.d[i]; });
}

// Accelerations as in rhs.hpp. D a = r gives D da = dr - dD a: the equations are solved, not
// differentiated.
template <class B>
inline void solve_joints(int joints, const SparseDual<B> &m11, const SparseDual<B> &m12,
                         const SparseDual<B> &m22, const SparseDual<B> &r1, const SparseDual<B> &r2,
                         SparseDual<B> *a)
{
    if (joints == 1) {
        a[0] = r1 / m11;
        a[1] = SparseDual<B>(0.0);
        return;
    }
    const B inv = 1.0 / (m11.v * m22.v - m12.v * m12.v);
    const B i11 = m22.v * inv, i12 = -(m12.v * inv), i22 = m11.v * inv;
    const B a1 = (m22.v * r1.v - m12.v * r2.v) * inv, a2 = (m11.v * r2.v - m12.v * r1.v) * inv;
    a[0].v = a1, a[1].v = a2;
    a[0].mask = a[1].mask = m11.mask | m12.mask | m22.mask | r1.mask | r2.mask;
    SparseDual<B>::each(a[0].mask, [&](int i) {
        B s1(0.0), s2(0.0);
        if (r1.mask >> i & 1u)
            s1 = r1.d[i];
        if (r2.mask >> i & 1u)
            s2 = r2.d[i];
        if (m11.mask >> i & 1u)
            s1 -= a1 * m11.d[i];
        if (m12.mask >> i & 1u)
            s1 -= a2 * m12.d[i], s2 -= a1 * m12.d[i];
        if (m22.mask >> i & 1u)
            s2 -= a2 * m22.d[i];
        a[0].d[i] = i11 * s1 + i12 * s2;
        a[1].d[i] = i12 * s1 + i22 * s2;
    });
}

#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic pop
#endif

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
