// What the rig stands on.
#ifndef MECHKIT_MODEL_EFFECTS_MOUNT_HPP
#define MECHKIT_MODEL_EFFECTS_MOUNT_HPP

#include "model/effect.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

// Gravity is turned by `angle` counter-clockwise in the plane of joint 1. A Furuta pendulum tilts
// about its arm's zero direction: the arm then feels gravity too.
struct BaseTilt {
    static constexpr mk_effect_info info = {"base-tilt",
                                            "gravity turned by angle in the plane of q1",
                                            "rig not levelled",
                                            MK_EFFECT_JOINT_NONE,
                                            MK_STAGE_FRAME | MK_STAGE_TORQUE,
                                            ALL_PLANTS & ~on_plant(MK_PLANT_INERTIA_WHEEL),
                                            0,
                                            0,
                                            1,
                                            {{"angle", "rad", "angle", -1.6, 1.6, 0.01}}};
    static constexpr mk_effect_words words = {"a base that is tilted",
                                              "The table or the foot is not level.",
                                              "Level it with a spirit level."};
    template <class S>
    static void frame(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.m.qg1 -= e.p[0];
    }
    // First moment of arm and pendulum about the vertical axis, from the base parameters of uniform
    // rods: lc2 = 3 p3 / p4, L1 = p2 / (2 p4).
    template <class S>
    static S arm_moment(const Compiled<S> &c)
    {
        S lc2 = 3.0 * c.p[2] / c.p[3], l1 = c.p[1] / (2.0 * c.p[3]);
        S tip = c.p[3] / lc2 * l1;
        return tip + 1.5 * (c.p[0] - tip * l1) / l1;
    }
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        if (f.c->plant != MK_PLANT_FURUTA)
            return;
        S sa, ca, sb, cb, st, ct;
        sincos(f.m.q[0], sa, ca);
        sincos(f.m.q[1], sb, cb);
        sincos(e.p[0], st, ct);
        // Potential g sin(tilt) (k sin a + p4 sin b cos a) + g cos(tilt) p4 cos b.
        S side = f.c->g * st;
        f.tau[0] -= side * (arm_moment(*f.c) * ca - f.c->p[3] * sb * sa);
        f.tau[1] -= side * f.c->p[3] * cb * ca + f.c->g * (1.0 - ct) * f.c->p[3] * sb;
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
        ALL_PLANTS & ~on_plant(MK_PLANT_REACTION_WHEEL),
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
        f.base_acceleration -=
            w * w * e.z[0] + 2.0 * e.p[1] * w * e.z[1] + e.p[2] * f.motor_torque / f.c->p[0];
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
