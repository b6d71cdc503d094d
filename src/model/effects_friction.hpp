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
        {{"coefficient", "N m s/rad", "viscous friction c", 0.0, INF, 0.005}},
        true};
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
        {{"level", "N m", "Coulomb friction F", 0.0, INF, 0.01}},
        true};
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
         {"velocity", "rad/s", "Stribeck speed vs", 1e-6, INF, 1.0}},
        true};
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
        {{"coefficient", "N m s^2/rad^2", "drag d", 0.0, INF, 1e-3}},
        true};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        const S &v = f.m.v[e.j];
        f.tau[e.j] -= e.p[0] * v * fabs(v);
    }
};

// More Coulomb friction one way than the other, none at rest (report (2.4): 0.3399 and 0.3575).
struct CoulombAsymmetry {
    static constexpr mk_effect_info info = {
        "coulomb-asymmetry",
        "-(dF/2) S_k(v)^2: dF more friction forwards than backwards",
        "Meesters 2004 (2.4)",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_TORQUE,
        ALL_PLANTS,
        0,
        0,
        1,
        {{"difference", "N m", "forwards minus backwards dF", -INF, INF, 0.02}},
        true};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        S s = smooth_sign(f.m.v[e.j]);
        f.tau[e.j] -= 0.5 * e.p[0] * s * s;
    }
};

// Bristles that bend before they slip: state z is their deflection.
struct Stiction {
    static constexpr mk_effect_info info = {
        "stiction",
        "LuGre: sigma0 z + sigma1 dz/dt, dz/dt = v - sigma0 |v| z / g",
        "Canudas de Wit, Olsson, Astrom, Lischinsky 1995",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_TORQUE | MK_STAGE_STATE,
        ALL_PLANTS,
        1,
        0,
        3,
        {{"stiffness", "N m/rad", "bristle stiffness sigma0", 1e-9, INF, 5.0},
         {"damping", "N m s/rad", "bristle damping sigma1", 0.0, INF, 0.05},
         {"level", "N m", "friction when sliding g", 1e-9, INF, 0.05}},
        true};
    template <class S>
    static S bend_rate(const Frame<S> &f, const EffectArgs<S> &e)
    {
        const S &v = f.m.v[e.j];
        return v - e.p[0] * fabs(v) * e.z[0] / e.p[2];
    }
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.tau[e.j] -= e.p[0] * e.z[0] + e.p[1] * bend_rate(f, e);
    }
    template <class S>
    static void derivative(Frame<S> &f, const EffectArgs<S> &e, S *dz)
    {
        dz[0] = bend_rate(f, e);
    }
    template <class S>
    static void init(Frame<S> &, const EffectArgs<S> &, S *z)
    {
        z[0] = S(0.0);
    }
    template <class S>
    static double rate(const Frame<S> &f, const EffectArgs<S> &e)
    {
        double inertia = least_inertia(f, e.j), stiffness = value_of(e.p[0]);
        return stiffness * fabs(value_of(f.m.v[e.j])) / value_of(e.p[2]) +
               ::sqrt(stiffness / inertia) + value_of(e.p[1]) / inertia;
    }
};

// Gears and bearings rub more under load.
struct LoadFriction {
    static constexpr mk_effect_info info = {
        "load-friction",
        "-mu |torque of the motor on joint j| S_k(v)",
        "Coulomb friction of a loaded gear",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_TORQUE,
        ALL_PLANTS,
        0,
        0,
        1,
        {{"coefficient", "", "friction per torque mu", 0.0, 1.0, 0.05}},
        true};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        const S &load = e.j == f.c->motor ? f.command[0] : f.command[1];
        f.tau[e.j] -= e.p[0] * fabs(load) * smooth_sign(f.m.v[e.j]);
    }
};

// Grease warms up: the Coulomb friction of the motor joint changes over the run.
struct FrictionDrift {
    static constexpr mk_effect_info info = {
        "friction-drift",
        "Coulomb level of the motor joint times 1 + change (1 - exp(-t/T))",
        "warming lubricant",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_FRAME,
        ALL_PLANTS,
        0,
        0,
        2,
        {{"change", "", "final change, a fraction", -1.0, INF, 0.2},
         {"time-constant", "s", "T", 1e-3, INF, 4.0}},
        true};
    template <class S>
    static void frame(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.coulomb_scale += e.p[0] * (1.0 - exp(-f.t / e.p[1]));
    }
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
