// The scalar a law is evaluated over: double here; Pack<W> (SIMD lanes) in simd.hpp, Dual<N> and
// SparseDual<B> (derivatives) in dual.hpp and sparse_dual.hpp overload the same few functions. Laws
// are written over `class S` and use arithmetic and the functions below only, so that one source
// gives values, derivatives and batches.
//
// Everything lives in a namespace per instruction set: the fast kernel is compiled several times
// with different flags, and the linker must never mix the results.
#ifndef MECHKIT_MODEL_SCALAR_HPP
#define MECHKIT_MODEL_SCALAR_HPP

#include <math.h>

#ifdef MK_ISA
#define MK_CONCAT2(a, b) a##b
#define MK_CONCAT(a, b) MK_CONCAT2(a, b)
#define MK_KERNEL_NS MK_CONCAT(isa_, MK_ISA)
#else
#define MK_KERNEL_NS plain
#endif

namespace mk
{
inline namespace MK_KERNEL_NS
{

#ifdef MK_ISA
// In the fast kernel the polynomials of simd.hpp serve plain doubles too: inlined, their latency
// overlaps with the rest of a right-hand side.
void sincos(double x, double &s, double &c);
double sin(double x);
double cos(double x);
double tanh(double x);
#else
inline void sincos(double x, double &s, double &c)
{
    ::sincos(x, &s, &c);
}
inline double sin(double x)
{
    return ::sin(x);
}
inline double cos(double x)
{
    return ::cos(x);
}
inline double tanh(double x)
{
    return ::tanh(x);
}
#endif
inline double exp(double x)
{
    return ::exp(x);
}
inline double sqrt(double x)
{
    return ::sqrt(x);
}
inline double fabs(double x)
{
    return ::fabs(x);
}
inline double value_of(double x)
{
    return x;
} // the number itself, without derivatives

// Of several angles: side by side they hide each other's latency. The kernel takes those of one
// right-hand side as lanes.
template <class S, int N>
inline void sincos(const S (&x)[N], S (&s)[N], S (&c)[N])
{
    for (int i = 0; i < N; i++)
        sincos(x[i], s[i], c[i]);
}
#if defined(MK_ISA) && defined(__AVX__)
template <int N>
void sincos(const double (&x)[N], double (&s)[N], double (&c)[N]);
#endif
// Four in a row. The kernel stores them at once: a wide load that follows would wait for four small
// stores.
template <class S>
inline void write(S *to, const S &a, const S &b, const S &c, const S &d)
{
    to[0] = a, to[1] = b, to[2] = c, to[3] = d;
}
#ifdef MK_ISA
inline void write(double *to, double a, double b, double c, double d)
{
    typedef double V __attribute__((vector_size(32)));
    V v = {a, b, c, d};
    __builtin_memcpy(to, &v, sizeof v);
}
#endif

// sum += a b. Numbers that carry derivatives have their own, without the product in between.
template <class S>
inline void add_product(S &sum, const S &a, const S &b)
{
    sum += a * b;
}

// a where x > 0, else b; both are evaluated.
inline double if_positive(double x, double a, double b)
{
    return x > 0.0 ? a : b;
}

template <class S>
inline S clamp(const S &x, const S &low, const S &high)
{
    S upper = if_positive(x - high, high, x);
    return if_positive(low - upper, low, upper);
}
// Written as the processor's own minimum and maximum, which keep what is no number.
inline double clamp(double x, double low, double high)
{
    const double upper = high < x ? high : x;
    return upper < low ? low : upper;
}

// Smooth sign S_k(v) = tanh(k v); report (2.3) with the speed as argument (errata 2.4).
template <class K, class S>
inline S smooth_sign(const K &k, const S &v)
{
    return tanh(k * v);
}

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
