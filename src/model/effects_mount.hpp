// What the rig stands on.
#ifndef MECHKIT_MODEL_EFFECTS_MOUNT_HPP
#define MECHKIT_MODEL_EFFECTS_MOUNT_HPP

#include "model/effect.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

// Gravity is turned by `angle` counter-clockwise in the plane of joint 1. What that does beside
// turning qg1 the plant says: a Furuta pendulum tilts about its arm's zero direction, and the arm
// then feels gravity too, as much as its mass sits far out.
struct BaseTilt {
    static constexpr mk_effect_info info = {
        "base-tilt",
        "gravity turned by angle in the plane of q1",
        "rig not levelled",
        MK_EFFECT_JOINT_NONE,
        MK_STAGE_FRAME | MK_STAGE_TORQUE,
        ALL_PLANTS,
        0,
        0,
        2,
        {{"angle", "rad", "angle", -1.6, 1.6, 0.01},
         {"arm", "", "first moment of the arm over that of a uniform rod", -10.0, 10.0, 1.0,
          MK_FIT_FREE, true}}};
    static constexpr mk_effect_words words = {"a base that is tilted",
                                              "The table or the foot is not level.",
                                              "Level it with a spirit level."};
    template <class S>
    static void frame(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.m.qg1 -= e.p[0];
    }
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        with_plant(f.c->plant, [&](auto plant) { plant.tilt(f.m, f.c->p, f.c->g, e.p, f.tau); });
    }
};

// The base rocks on a torsion spring about joint 1's axis, pushed back by the motor joint's torque.
// States: its angle and speed.
struct BaseCompliance {
    static constexpr mk_effect_info info = {
        "base-compliance",
        "oscillator driven by minus the motor joint's torque, added to the inertial angle of q1",
        "one mode of a table",
        MK_EFFECT_JOINT_NONE,
        MK_STAGE_FRAME | MK_STAGE_TORQUE | MK_STAGE_STATE,
        ALL_PLANTS,
        2,
        0,
        3,
        {{"frequency", "Hz", "natural frequency", 0.2, 1000.0, 8.0},
         {"damping-ratio", "", "damping ratio", 0.0, 2.0, 0.05},
         {"gain", "", "p1 over the inertia of the base", 0.0, INF, 0.05}}};
    static constexpr mk_effect_words words = {"a base that rocks", "A table or stand that gives.",
                                              "Clamp it to something heavy and measure again."};
    template <class S>
    static void frame(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.m.qg1 += e.z[0];
        f.m.w1 += e.z[1];
    }
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        S w = TWO_PI * e.p[0];
        f.accelerate_base(
            -(w * w * e.z[0] + 2.0 * e.p[1] * w * e.z[1] + e.p[2] * f.motor_torque / f.c->p[0]));
    }
    template <class S>
    static void derivative(Frame<S> &f, const EffectArgs<S> &e, S *dz)
    {
        dz[0] = e.z[1];
        dz[1] = f.base_acceleration;
    }
    template <class S>
    static void init(Frame<S> &, const EffectArgs<S> &, S *z)
    {
        z[0] = z[1] = S(0.0);
    }
    template <class S>
    static double rate(const Frame<S> &, const EffectArgs<S> &e)
    {
        return TWO_PI * value_of(e.p[0]);
    }
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
