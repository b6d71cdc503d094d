// Inertia that the textbook plant lacks.
#ifndef MECHKIT_MODEL_EFFECTS_INERTIA_HPP
#define MECHKIT_MODEL_EFFECTS_INERTIA_HPP

#include "model/effect.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

// A rotor behind a gear turns with its joint alone, many times faster: it adds to D_jj and to
// nothing else.
struct ReflectedInertia {
    static constexpr mk_effect_info info = {
        "reflected-inertia",
        "-J a_j: adds J to D_jj",
        "rotor inertia times the square of the gear ratio",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_INERTIA,
        ALL_PLANTS,
        0,
        0,
        1,
        {{"inertia", "kg m^2", "reflected inertia J", 0.0, INF, 1e-3}},
        true};
    static constexpr mk_effect_words words = {"inertia of a rotor behind a gear",
                                              "The motor's rotor turns faster by the gear's ratio.",
                                              "Keep it in the model."};
    template <class S>
    static void inertia(Frame<S> &f, const EffectArgs<S> &e)
    {
        if (e.j == 0)
            f.m11 += e.p[0];
        else
            f.m22 += e.p[0];
    }
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
