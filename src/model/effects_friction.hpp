// Friction at a joint. Torques as in docs/effects.md; v is the joint's speed, S_k(v) = tanh(k v)
// with the sharpness k of the effect.
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
    static constexpr mk_effect_words words = {
        "viscous friction", "Lubricant, bearings with grease, or the motor's back-EMF.",
        "Keep it in the model; it is harmless for control."};
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
        2,
        {{"level", "N m", "Coulomb friction F", 0.0, INF, 0.01}, SHARPNESS},
        true,
        true};
    static constexpr mk_effect_words words = {
        "dry friction", "Seals, brushes, preloaded bearings or gears.",
        "Let the controller make up for it, or relieve the preload."};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.tau[e.j] -= e.p[0] * smooth_sign(e.p[1], f.m.v[e.j]);
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
        3,
        {{"level", "N m", "excess friction at rest Fs", 0.0, INF, 0.1},
         {"velocity", "rad/s", "Stribeck speed vs", 1e-6, INF, 1.0},
         SHARPNESS},
        true,
        true};
    static constexpr mk_effect_words words = {
        "Stribeck friction",
        "Grease that carries only above a certain speed: friction falls as the joint starts to "
        "move.",
        "Avoid slow reversals, or use a thinner lubricant; a controller should make up for it with "
        "dither or a model."};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        const S &v = f.m.v[e.j];
        S r = v / e.p[1];
        f.tau[e.j] -= e.p[0] * exp(-(r * r)) * smooth_sign(e.p[2], v);
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
    static constexpr mk_effect_words words = {
        "drag that grows with the square of the speed", "Air on a link or a wheel.",
        "Keep it in the model; a smaller face or a lower speed lessens it."};
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
        2,
        {{"difference", "N m", "forwards minus backwards dF", -INF, INF, 0.02}, SHARPNESS},
        true};
    static constexpr mk_effect_words words = {
        "dry friction that differs between the directions",
        "A ball screw, a seal or a brush that is loaded to one side.",
        "Turn the joint slowly both ways by hand or at constant speed and compare the torques."};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        S s = smooth_sign(e.p[1], f.m.v[e.j]);
        f.tau[e.j] -= 0.5 * e.p[0] * s * s;
    }
};

// More viscous friction one way than the other.
struct ViscousAsymmetry {
    static constexpr mk_effect_info info = {
        "viscous-asymmetry",
        "-(dc/2) |v|: dc more viscous friction forwards than backwards",
        "Janot, Gautier, Brunot 2019: the friction of a ball screw's axis",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_TORQUE,
        ALL_PLANTS,
        0,
        0,
        1,
        {{"difference", "N m s/rad", "forwards minus backwards dc", -INF, INF, 0.001}},
        true};
    static constexpr mk_effect_words words = {
        "viscous friction that differs between the directions",
        "A drive whose gain or a screw whose load differs by direction.",
        "Run constant speeds both ways and compare the torques."};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.tau[e.j] -= 0.5 * e.p[0] * fabs(f.m.v[e.j]);
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
        true,
        true};
    static constexpr mk_effect_words words = {
        "stiction with presliding", "Contacts that give like bristles before they slide.",
        "Small oscillations about rest show it; let controllers cross zero speed quickly."};
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

// Gears and bearings rub more under load. At the motor joint the load is the motor's torque. At a
// passive joint it is what presses on the bearing along the link, times the lever of the link's
// centre of mass, so that it is in units of torque as well and mu is a number: the bearing's radius
// over that lever times its coefficient of friction. A motor there adds its torque.
struct LoadFriction {
    static constexpr mk_effect_info info = {
        "load-friction",
        "-mu |load| S_k(v): torque of the motor, at a passive joint the force on its bearing",
        "Coulomb friction of a loaded gear or bearing",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_TORQUE,
        ALL_PLANTS,
        0,
        0,
        2,
        {{"coefficient", "", "friction per load mu", 0.0, 1.0, 0.05}, SHARPNESS},
        true};
    static constexpr mk_effect_words words = {
        "friction that grows with the load",
        "Gears or bearings that are pressed together by the torque that they carry.",
        "Compare free swings with driven ones; a larger bearing or better alignment lessens it."};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.tau[e.j] -= e.p[0] * load(f, e.j) * smooth_sign(e.p[1], f.m.v[e.j]);
    }
    template <class S>
    static S load(const Frame<S> &f, int j)
    {
        if (j == f.c->motor)
            return fabs(f.command[0]);
        return fabs(f.command[1]) + fabs(with_plant(f.c->plant, [&](auto law) {
                   return law.bearing_load(f.m, f.c->p, f.c->g);
               }));
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
    static constexpr mk_effect_words words = {"friction that changes while the rig warms up",
                                              "Cold lubricant.",
                                              "Run the rig for some minutes before measuring."};
    template <class S>
    static void frame(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.coulomb_scale += e.p[0] * (1.0 - exp(-f.t / e.p[1]));
    }
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
