// Friction at a joint. Torques as in docs/effects.md; v is the joint's speed, S_k(v) = tanh(15 v).
#ifndef MECHKIT_MODEL_EFFECTS_FRICTION_HPP
#define MECHKIT_MODEL_EFFECTS_FRICTION_HPP

#include "model/effect.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

struct Viscous {
    static constexpr mk_effect_info info = {
        "viscous",
        "-c v",
        "Meesters 2004 (2.2)",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_TORQUE,
        ALL_PLANTS,
        0,
        0,
        1,
        {{"coefficient", "N m s/rad", "viscous friction c", 0.0, INF, 0.005}}};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.tau[e.j] -= e.p[0] * f.m.v[e.j];
    }
};

struct Coulomb {
    static constexpr mk_effect_info info = {
        "coulomb",
        "-F S_k(v)",
        "Meesters 2004 (2.2), (2.3)",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_TORQUE,
        ALL_PLANTS,
        0,
        0,
        1,
        {{"level", "N m", "Coulomb friction F", 0.0, INF, 0.01}}};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.tau[e.j] -= e.p[0] * smooth_sign(f.m.v[e.j]);
    }
};

// Extra friction near rest that fades with speed; what is left of it is Coulomb's.
struct Stribeck {
    static constexpr mk_effect_info info = {
        "stribeck",
        "-Fs exp(-(v/vs)^2) S_k(v), on top of Coulomb",
        "Armstrong-Helouvry, Dupont, Canudas de Wit 1994",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_TORQUE,
        ALL_PLANTS,
        0,
        0,
        2,
        {{"level", "N m", "excess friction at rest Fs", 0.0, INF, 0.1},
         {"velocity", "rad/s", "Stribeck speed vs", 1e-6, INF, 1.0}}};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        const S &v = f.m.v[e.j];
        S r = v / e.p[1];
        f.tau[e.j] -= e.p[0] * exp(-(r * r)) * smooth_sign(v);
    }
};

struct QuadraticDrag {
    static constexpr mk_effect_info info = {
        "quadratic-drag",
        "-d v |v|",
        "drag of a blunt body at high Reynolds number",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_TORQUE,
        ALL_PLANTS,
        0,
        0,
        1,
        {{"coefficient", "N m s^2/rad^2", "drag d", 0.0, INF, 1e-3}}};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        const S &v = f.m.v[e.j];
        f.tau[e.j] -= e.p[0] * v * fabs(v);
    }
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
