// SIMD lanes: W doubles that travel together, by GCC's vector extensions. Sine, cosine, exp and
// tanh are inlined polynomials (coefficients: S. L. Moshier, Cephes Mathematical Library 2.8), good
// to 2 units in the last place; the same source serves plain doubles, where inlining hides their
// latency.
#ifndef MECHKIT_MODEL_SIMD_HPP
#define MECHKIT_MODEL_SIMD_HPP

#include <stdint.h>
#include <string.h>
#if defined(__AVX__)
#include <immintrin.h>
#endif

#include "model/scalar.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

// The compiler wants the size of a vector as a plain number.
template <int W>
struct Register;
#define MK_REGISTER(lanes)                                                                         \
    template <>                                                                                    \
    struct Register<lanes> {                                                                       \
        typedef double Vector __attribute__((vector_size((lanes)*8)));                             \
        typedef uint64_t Bits __attribute__((vector_size((lanes)*8)));                             \
    };
MK_REGISTER(2)
MK_REGISTER(4)
MK_REGISTER(8)
#undef MK_REGISTER

template <int W>
struct Pack {
    using Vector = typename Register<W>::Vector;
    using Bits = typename Register<W>::Bits;
    Vector v;

    Pack() = default;
    Pack(double x) : v(x - Vector{}) {} // implicit: constants mix freely with lanes in laws
    Pack(Vector x) : v(x) {}

    double operator[](int lane) const { return v[lane]; }
    void set(int lane, double x) { v[lane] = x; }

    Pack &operator+=(Pack b) { return v += b.v, *this; }
    Pack &operator-=(Pack b) { return v -= b.v, *this; }
    Pack &operator*=(Pack b) { return v *= b.v, *this; }
    Pack operator-() const { return Pack(-v); }
    friend Pack operator+(Pack a, Pack b) { return Pack(a.v + b.v); }
    friend Pack operator-(Pack a, Pack b) { return Pack(a.v - b.v); }
    friend Pack operator*(Pack a, Pack b) { return Pack(a.v * b.v); }
    friend Pack operator/(Pack a, Pack b) { return Pack(a.v / b.v); }
};

// What the polynomials need of a lane type beyond arithmetic.
template <int W>
inline typename Pack<W>::Bits bits_of(Pack<W> x)
{
    typename Pack<W>::Bits b;
    memcpy(&b, &x.v, sizeof b);
    return b;
}
inline uint64_t bits_of(double x)
{
    uint64_t b;
    memcpy(&b, &x, sizeof b);
    return b;
}
template <int W>
inline Pack<W> from_bits(typename Pack<W>::Bits b, Pack<W>)
{
    typename Pack<W>::Vector v;
    memcpy(&v, &b, sizeof v);
    return Pack<W>(v);
}
inline double from_bits(uint64_t b, double)
{
    double x;
    memcpy(&x, &b, sizeof x);
    return x;
}
// a where the mask's lanes are -1, b where they are 0.
template <int W>
inline Pack<W> select(typename Pack<W>::Bits mask, Pack<W> a, Pack<W> b)
{
    return from_bits((mask & bits_of(a)) | (~mask & bits_of(b)), a);
}
inline double select(uint64_t mask, double a, double b)
{
    return mask ? a : b;
}

template <int W>
inline Pack<W> if_positive(const Pack<W> &x, const Pack<W> &a, const Pack<W> &b)
{
    return Pack<W>(x.v > 0.0 ? a.v : b.v);
}
template <int W>
inline Pack<W> fabs(const Pack<W> &x)
{
    return from_bits(bits_of(x) & (UINT64_MAX >> 1), x);
}
template <int W>
inline Pack<W> sqrt(const Pack<W> &x)
{
    Pack<W> r;
    for (int i = 0; i < W; i++)
        r.v[i] = __builtin_sqrt(x.v[i]);
    return r;
}
// Over the lanes; no number where one of them is none.
inline double largest(double x)
{
    return x;
}
template <int W>
inline double largest(const Pack<W> &x)
{
    double m = x.v[0];
    for (int i = 1; i < W; i++)
        m = x.v[i] > m || x.v[i] != x.v[i] ? x.v[i] : m;
    return m;
}
template <int W>
inline double add_up(const Pack<W> &a)
{
    double sum = a[0];
    for (int i = 1; i < W; i++)
        sum += a[i];
    return sum;
}
template <int W>
inline double value_of(const Pack<W> &x)
{
    return x.v[0];
}

namespace poly
{

// Adding and taking away this rounds to an integer, whose low bits are then those of the sum.
constexpr double ROUND = 0x1.8p52;
// Beyond this the reduction of an angle loses digits, and lanes go through libm one by one.
constexpr double LARGE = 1e5;

template <class T>
inline void sincos(const T &x, T &s, T &c)
{
    T shifted = x * 0.63661977236758134308 + ROUND, n = shifted - ROUND;
    auto quadrant = bits_of(shifted);
    // pi/2 in parts. A fused n times the first one is not rounded; else the first two have trailing
    // zeros, so that n times them is exact.
#ifdef __FMA__
    T r = x - n * 1.57079632679489655800;
    r = r - n * 6.12323399573676603587e-17;
#else
    T r = x - n * 1.57079625129699707031;
    r = r - n * 7.54978941586159635336e-8;
    r = r - n * 5.39030285815811905290e-15;
#endif
    // Polynomials by pairs of terms (G. Estrin 1960), which do not wait for each other.
    const T z = r * r, z2 = z * z;
    const T ps = ((1.58962301576546568060e-10 * z - 2.50507477628578072866e-8) * z2 +
                  (2.75573136213857245213e-6 * z - 1.98412698295895385996e-4)) *
                     z2 +
                 (8.33333333332211858878e-3 * z - 1.66666666666666307295e-1);
    const T pc = ((-1.13585365213876817300e-11 * z + 2.08757008419747316778e-9) * z2 +
                  (-2.75573141792967388112e-7 * z + 2.48015872888517045348e-5)) *
                     z2 +
                 (-1.38888888888730564116e-3 * z + 4.16666666666665929218e-2);
    T sine = r + r * z * ps, cosine = 1.0 - 0.5 * z + z2 * pc;
    auto swap = -(quadrant & 1);
    T first = select(swap, cosine, sine), second = select(swap, sine, cosine);
    s = from_bits(bits_of(first) ^ ((quadrant & 2) << 62), first);
    c = from_bits(bits_of(second) ^ (((quadrant + 1) & 2) << 62), second);
}

// exp(r) = (q + p) / (q - p), x = n ln 2 + r; gives p, q and 2^n.
template <class T>
inline void exp_parts(const T &x, T &p, T &q, T &power)
{
    T shifted = x * 1.4426950408889634073599 + ROUND, n = shifted - ROUND;
    T r = x - n * 6.93145751953125e-1;
    r = r - n * 1.42860682030941723212e-6;
    T z = r * r;
    p = r * ((1.26177193074810590878e-4 * z + 3.02994407707441961300e-2) * z + 1.0);
    q = (3.00198505138664455042e-6 * z + 2.52448340349684104192e-3) * (z * z) +
        (2.27265548208155028766e-1 * z + 2.0);
    power = from_bits((bits_of(shifted) + 1023) << 52, r);
}

template <class T>
inline T exp(const T &x)
{
    // Within these bounds 2^n is a normal number; exp is 0 or larger than any torque beyond.
    T p, q, power, bounded = clamp(x, T(-708.0), T(709.0));
    exp_parts(bounded, p, q, power);
    T value = power * ((q + p) / (q - p));
    return if_positive(T(-708.0) - x, T(0.0), value);
}

// (e^2x - 1) / (e^2x + 1) over one division; exact near 0, where e^2x - 1 is 2 p without rounding.
template <class T>
inline T tanh(const T &x)
{
    T p, q, power, bounded = clamp(2.0 * x, T(-44.0), T(44.0));
    exp_parts(bounded, p, q, power);
    T up = power * (q + p), down = q - p;
    // With n = 0 the difference is 2 p, exactly; computed as such by the order of the sums.
    T difference = (power - 1.0) * q + (power + 1.0) * p;
    return difference / (up + down);
}

} // namespace poly

#ifdef MK_ISA
inline void sincos(double x, double &s, double &c)
{
    if (__builtin_expect(!(__builtin_fabs(x) < poly::LARGE), 0))
        s = ::sin(x), c = ::cos(x);
    else
        poly::sincos(x, s, c);
}
inline double sin(double x)
{
    double s, c;
    sincos(x, s, c);
    return s;
}
inline double cos(double x)
{
    double s, c;
    sincos(x, s, c);
    return c;
}
inline double tanh(double x)
{
    return poly::tanh(x);
}
#endif

// Whether a lane is too large for the polynomials, or no number.
template <int W>
inline bool any_large(const Pack<W> &x)
{
#if defined(__AVX512DQ__)
    if constexpr (W == 8)
        return _mm512_cmp_pd_mask(fabs(x).v, Pack<W>(poly::LARGE).v, _CMP_NLT_UQ) != 0;
#endif
#if defined(__AVX__)
    if constexpr (W == 4)
        return _mm256_movemask_pd(_mm256_cmp_pd(fabs(x).v, Pack<W>(poly::LARGE).v, _CMP_NLT_UQ)) !=
               0;
#endif
    bool any = false;
    for (int i = 0; i < W; i++)
        any |= !(__builtin_fabs(x.v[i]) < poly::LARGE);
    return any;
}
template <int W>
inline void sincos(const Pack<W> &x, Pack<W> &s, Pack<W> &c)
{
    poly::sincos(x, s, c);
    if (__builtin_expect(any_large(x), 0))
        for (int i = 0; i < W; i++)
            s.v[i] = ::sin(x.v[i]), c.v[i] = ::cos(x.v[i]);
}
#if defined(MK_ISA) && defined(__AVX__)
template <int N>
inline void sincos(const double (&x)[N], double (&s)[N], double (&c)[N])
{
    static_assert(N <= 4, "lanes for more angles");
    Pack<4> angle(x[N - 1]), sine, cosine;
    for (int i = 0; i < N; i++)
        angle.set(i, x[i]);
    poly::sincos(angle, sine, cosine);
    for (int i = 0; i < N; i++)
        s[i] = sine[i], c[i] = cosine[i];
    if (__builtin_expect(any_large(angle), 0))
        for (int i = 0; i < N; i++)
            s[i] = ::sin(x[i]), c[i] = ::cos(x[i]);
}
#endif
template <int W>
inline Pack<W> sin(const Pack<W> &x)
{
    Pack<W> s, c;
    sincos(x, s, c);
    return s;
}
template <int W>
inline Pack<W> cos(const Pack<W> &x)
{
    Pack<W> s, c;
    sincos(x, s, c);
    return c;
}
template <int W>
inline Pack<W> tanh(const Pack<W> &x)
{
    return poly::tanh(x);
}
template <int W>
inline Pack<W> exp(const Pack<W> &x)
{
    return poly::exp(x);
}

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
