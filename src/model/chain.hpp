// Functions of numbers that carry derivatives: D has a value `v` of type D::Number, and
// chain(f, slope) gives f(x) with df/dx = slope.
#ifndef MECHKIT_MODEL_CHAIN_HPP
#define MECHKIT_MODEL_CHAIN_HPP

#include "model/scalar.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

template <class D, class Number = typename D::Number>
inline void sincos(const D &x, D &s, D &c)
{
    Number sv, cv;
    sincos(x.v, sv, cv);
    s = x.chain(sv, cv);
    c = x.chain(cv, -sv);
}
template <class D, class Number = typename D::Number>
inline D sin(const D &x)
{
    Number s, c;
    sincos(x.v, s, c);
    return x.chain(s, c);
}
template <class D, class Number = typename D::Number>
inline D cos(const D &x)
{
    Number s, c;
    sincos(x.v, s, c);
    return x.chain(c, -s);
}
template <class D, class Number = typename D::Number>
inline D tanh(const D &x)
{
    Number f = tanh(x.v);
    return x.chain(f, 1.0 - f * f);
}
template <class D, class Number = typename D::Number>
inline D exp(const D &x)
{
    Number f = exp(x.v);
    return x.chain(f, f);
}
template <class D, class Number = typename D::Number>
inline D sqrt(const D &x)
{
    Number f = sqrt(x.v);
    return x.chain(f, 0.5 / f);
}
template <class D, class = typename D::Number>
inline double value_of(const D &x)
{
    return value_of(x.v);
}

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
