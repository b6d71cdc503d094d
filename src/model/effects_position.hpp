// Torques that depend on where a joint is.
#ifndef MECHKIT_MODEL_EFFECTS_POSITION_HPP
#define MECHKIT_MODEL_EFFECTS_POSITION_HPP

#include "model/effect.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

// The encoder cable to the fixed base pulls the joint back (Meesters 2004, section 2.2 and 5).
struct CableStiffness {
    static constexpr mk_effect_info info = {
        "cable-stiffness",
        "-s (q - q0), cable to the fixed base",
        "Meesters 2004, 2.2 and 3.3",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_TORQUE,
        ALL_PLANTS,
        0,
        0,
        2,
        {{"stiffness", "N m/rad", "stiffness s", 0.0, INF, 0.1},
         {"rest", "rad", "angle q0 where the cable is slack", -INF, INF, 0.0}}};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.tau[e.j] -= e.p[0] * (f.m.q[e.j] - e.p[1]);
    }
};

// Detent torque of the motor's magnets.
struct Cogging {
    static constexpr mk_effect_info info = {
        "cogging",
        "-A sin(n q + phi)",
        "motor detent torque",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_TORQUE,
        ALL_PLANTS,
        0,
        0,
        3,
        {{"amplitude", "N m", "amplitude A", 0.0, INF, 0.05},
         {"cycles", "1/rev", "periods per revolution n (integer)", 1.0, 1000.0, 4.0},
         {"phase", "rad", "phase phi", -INF, INF, 0.0}}};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.tau[e.j] -= e.p[0] * sin(e.p[1] * f.m.q[e.j] + e.p[2]);
    }
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
