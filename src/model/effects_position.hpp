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
         {"rest", "rad", "angle q0 where the cable is slack", -INF, INF, 0.0, MK_FIT_CENTRE}},
        true};
    static constexpr mk_effect_words words = {
        "a cable that pulls like a spring",
        "The encoder's or motor's cable twists as the joint turns.",
        "Lead the cable through the axis, or tie it with more slack."};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.tau[e.j] -= e.p[0] * (f.m.q[e.j] - e.p[1]);
    }
};

// Something pulls one way wherever the joint is: a counterweight, a biased amplifier, a brush.
struct TorqueOffset {
    static constexpr mk_effect_info info = {"torque-offset",
                                            "a constant torque",
                                            "offset of a drive: Janot, Gautier, Brunot 2019",
                                            MK_EFFECT_JOINT_ANY,
                                            MK_STAGE_TORQUE,
                                            ALL_PLANTS,
                                            0,
                                            0,
                                            1,
                                            {{"level", "N m", "torque", -INF, INF, 0.01}},
                                            true};
    static constexpr mk_effect_words words = {
        "a constant torque", "A biased amplifier, or a weight that is not balanced.",
        "Look at the amplifier's output at command 0; trim its offset."};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.tau[e.j] += e.p[0];
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
         {"cycles", "1/rev", "periods per revolution n (integer)", 1.0, 1000.0, 4.0,
          MK_FIT_INTEGER},
         {"phase", "rad", "phase phi", -INF, INF, 0.0, MK_FIT_ANGLE}},
        true};
    static constexpr mk_effect_words words = {
        "torque that repeats with the angle", "Magnets and slots of the motor, teeth of a gear.",
        "Turn the joint slowly by hand with the motor unpowered: it snaps from place to place."};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.tau[e.j] -= e.p[0] * sin(e.p[1] * f.m.q[e.j] + e.p[2]);
    }
};

// A cable that creeps when it is bent: Bouc-Wen with exponent 2.
struct CableHysteresis {
    static constexpr mk_effect_info info = {
        "cable-hysteresis",
        "-s z, dz/dt = v - |v| z |z| / zy^2",
        "Bouc 1967; Wen 1976",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_TORQUE | MK_STAGE_STATE,
        ALL_PLANTS,
        1,
        0,
        2,
        {{"stiffness", "N m/rad", "stiffness s", 0.0, INF, 0.3},
         {"yield", "rad", "largest deflection zy", 1e-6, INF, 0.15}},
        true};
    static constexpr mk_effect_words words = {
        "a pull with hysteresis",
        "A stiff cable whose strands rub on each other, or a gear or bearing that gives before it "
        "slides.",
        "Take the cable off and log again: if it stays it is the gear or the bearing."};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.tau[e.j] -= e.p[0] * e.z[0];
    }
    template <class S>
    static void derivative(Frame<S> &f, const EffectArgs<S> &e, S *dz)
    {
        const S &v = f.m.v[e.j];
        S r = e.z[0] / e.p[1];
        dz[0] = v - fabs(v) * r * fabs(r);
    }
    template <class S>
    static void init(Frame<S> &, const EffectArgs<S> &, S *z)
    {
        z[0] = S(0.0);
    }
    template <class S>
    static double rate(const Frame<S> &f, const EffectArgs<S> &e)
    {
        return 2.0 * fabs(value_of(f.m.v[e.j])) / value_of(e.p[1]);
    }
};

// An eccentric mass on a link or wheel. Its weight acts through every joint below it.
struct Imbalance {
    static constexpr mk_effect_info info = {
        "imbalance",
        "-m sin(q_abs - phi), q_abs the absolute angle of the body",
        "eccentric mass m g r",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_TORQUE,
        ALL_PLANTS,
        0,
        0,
        2,
        {{"moment", "N m", "moment of the mass's weight m", 0.0, INF, 0.02},
         {"phase", "rad", "its direction phi", -INF, INF, 0.0, MK_FIT_ANGLE}},
        true};
    static constexpr mk_effect_words words = {
        "an eccentric mass", "A wheel or a link whose centre of mass is off its axis.",
        "Let it hang freely: it comes to rest at one angle; balance it there."};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        // A pendulum on an arm that turns level hangs in a plane of its own.
        bool parallel = f.c->parallel;
        S angle = e.j == 0 ? f.m.qg1 : parallel ? f.m.qg1 + f.m.q[1] : f.m.q[1];
        S weight = e.p[0] * sin(angle - e.p[1]);
        f.tau[e.j] -= weight;
        if (e.j == 1 && parallel)
            f.tau[0] -= weight;
    }
};

// A stop beyond which a spring and damper push back, never pull.
struct EndStop {
    static constexpr mk_effect_info info = {
        "end-stop",
        "q > limit: -(k (q - limit) + c v), pushing only",
        "one-sided contact",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_TORQUE | MK_STAGE_EVENT,
        ALL_PLANTS,
        0,
        1,
        3,
        {{"limit", "rad", "travel limit", -INF, INF, 1.0},
         {"stiffness", "N m/rad", "stiffness k", 0.0, INF, 50.0},
         {"damping", "N m s/rad", "damping c", 0.0, INF, 0.5}}};
    static constexpr mk_effect_words words = {
        "a stop", "A mechanical end of travel, or a cable that goes taut.",
        "Look where the joint is held, and keep set points away from it."};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        S depth = f.m.q[e.j] - e.p[0], zero = S(0.0);
        S push = e.p[1] * depth + e.p[2] * f.m.v[e.j];
        f.tau[e.j] -= if_positive(depth, if_positive(push, push, zero), zero);
    }
    template <class S>
    static void events(Frame<S> &f, const EffectArgs<S> &e, S *g)
    {
        g[0] = f.m.q[e.j] - e.p[0];
    }
    template <class S>
    static double rate(const Frame<S> &f, const EffectArgs<S> &e)
    {
        if (value_of(f.m.q[e.j]) < value_of(e.p[0]) - 0.2)
            return 0.0;
        double inertia = least_inertia(f, e.j);
        return ::sqrt(value_of(e.p[1]) / inertia) + value_of(e.p[2]) / inertia;
    }
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
