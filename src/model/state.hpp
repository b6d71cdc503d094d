// A whole model beside its right-hand side: the state at rest, and the mass matrix with effects.
#ifndef MECHKIT_MODEL_STATE_HPP
#define MECHKIT_MODEL_STATE_HPP

#include "model/rhs.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

// State with the joints at q, v and every effect at rest.
template <class S>
inline void initial_state(const Compiled<S> &c, const S *q, const S *v, S *x)
{
    S u[MK_MAX_INPUTS] = {S(0.0), S(0.0)};
    for (int i = 0; i < c.state_count; i++)
        x[i] = S(0.0);
    for (int j = 0; j < c.joints; j++) {
        x[j] = q[j];
        x[c.joints + j] = v[j];
    }
    Frame<S> f;
    frame_begin(f, c, S(0.0), x, u);
    for (int i = 0; i < c.effect_count; i++)
        if (auto *init = effect_ops<S>(c.at(i).index).init)
            init(f, args_of(c.at(i), static_cast<const S *>(x)), x + c.at(i).state);
}

// What a torque at a joint meets: m11, m12, m22.
template <class S>
inline void mass_matrix(const Compiled<S> &c, const S &t, const S *x, S *m)
{
    Frame<S> f;
    S u[MK_MAX_INPUTS] = {S(0.0), S(0.0)};
    frame_begin(f, c, t, x, u);
    Assembler<S> sum(c.p);
    with_plant(c.plant, [&](auto law) { law.law(f.m, c.g, sum); });
    f.m11 = sum.m11, f.m12 = sum.m12, f.m22 = sum.m22;
    for (int i = 0; i < c.effect_count; i++)
        if (auto *stage = effect_ops<S>(c.at(i).index).inertia)
            stage(f, args_of(c.at(i), x));
    m[0] = f.m11, m[1] = f.m12, m[2] = f.m22;
}

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
