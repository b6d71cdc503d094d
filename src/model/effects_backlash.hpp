// Mechanical backlash: two bodies with a gap between them.
#ifndef MECHKIT_MODEL_EFFECTS_BACKLASH_HPP
#define MECHKIT_MODEL_EFFECTS_BACKLASH_HPP

#include "model/effect.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

// The joint's coordinate is the heavy side; the effect's states z = [angle, speed] are the light
// side, which carries the encoder. Between them a gap of `width` and, beyond it, a spring and
// damper that push but never pull.
//
// Pendubot, Furuta (joint 2): the light side is the shaft with the encoder's disc, with a little
// dry friction of its own against link 1, so that the reading follows the link with hysteresis.
// Inertia wheel, reaction wheel: the light side is the motor's rotor, which takes the motor's
// torque and friction and drives the wheel through the gap. Its inertia is part of the plant's
// parameter.
struct Backlash {
    static constexpr mk_effect_info info = {
        "backlash",
        "dead zone of total width between a joint's two halves, contact spring-damper beyond it",
        "Nordin, Gutman 2002; Meesters 2004, 2.2",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_FRAME | MK_STAGE_TORQUE | MK_STAGE_INERTIA | MK_STAGE_STATE | MK_STAGE_EVENT |
            MK_STAGE_MEASUREMENT,
        ALL_PLANTS,
        2,
        2,
        5,
        {{"width", "rad", "full gap", 0.0, 3.2, 0.02},
         {"stiffness", "N m/rad", "contact stiffness", 1e-9, INF, 100.0},
         {"damping", "N m s/rad", "contact damping", 0.0, INF, 0.15},
         {"share", "", "the light side's share of the joint's inertia", 1e-4, 0.9, 0.08,
          MK_FIT_FREE, true},
         {"drag", "rad/s^2", "dry friction of the encoder's shaft over its inertia", 0.0, INF, 3.8,
          MK_FIT_FREE, true}}};
    static constexpr mk_effect_words words = {
        "backlash", "Clearance of a gear, coupling or key.",
        "Hold the motor and move the link by hand; take up the clearance, or preload it."};

    template <class S>
    static bool drives(const Frame<S> &f, const EffectArgs<S> &e)
    {
        return e.j == f.c->motor;
    }
    template <class S>
    static S light_inertia(const Frame<S> &f, const EffectArgs<S> &e)
    {
        return e.p[3] * with_plant(f.c->plant, [&](auto plant) {
                   return plant.template gap_inertia<S>(f.c->p, e.j);
               });
    }
    // Whether the light side turns about the same axis as link 1, which carries it: not where the
    // axes cross (Furuta) or joint 1 slides.
    template <class S>
    static bool rides(const Frame<S> &f, const EffectArgs<S> &e)
    {
        return e.j == 1 && f.c->parallel;
    }
    // Torque on the light side from outside the gap: the motor's, or the friction of the shaft.
    template <class S>
    static S drive(const Frame<S> &f, const EffectArgs<S> &e)
    {
        return drives(f, e)
                   ? f.motor_torque
                   : -light_inertia(f, e) * e.p[4] * smooth_sign(f.c->sharpness[e.j], e.z[1]);
    }
    // Torque that the light side puts on the heavy side.
    template <class S>
    static S contact(const Frame<S> &f, const EffectArgs<S> &e)
    {
        S gap = 0.5 * e.p[0], d = e.z[0] - f.m.q[e.j], rate = e.z[1] - f.m.v[e.j];
        S above = e.p[1] * (d - gap) + e.p[2] * rate;
        S below = e.p[1] * (d + gap) + e.p[2] * rate;
        S zero = S(0.0);
        S push = if_positive(d - gap, if_positive(above, above, zero), zero);
        S pull = if_positive(-(d + gap), if_positive(-below, below, zero), zero);
        return push + pull;
    }
    template <class S>
    static void frame(Frame<S> &f, const EffectArgs<S> &e)
    {
        if (drives(f, e)) {
            f.motor_speed = e.z[1];
            f.motor_detached = true;
        }
    }
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        S force = contact(f, e);
        f.tau[e.j] += force;
        // What accelerates a light side that rides on link 1 pushes link 1 back.
        if (rides(f, e))
            f.tau[0] -= drive(f, e) - force;
    }
    template <class S>
    static void inertia(Frame<S> &f, const EffectArgs<S> &e)
    {
        S light = light_inertia(f, e);
        if (rides(f, e)) {
            f.m11 -= light;
            f.m12 -= light;
        }
        (e.j == 0 ? f.m11 : f.m22) -= light;
    }
    template <class S>
    static void derivative(Frame<S> &f, const EffectArgs<S> &e, S *dz)
    {
        dz[0] = e.z[1];
        dz[1] = (drive(f, e) - contact(f, e)) / light_inertia(f, e);
        if (rides(f, e))
            dz[1] -= f.a[0];
    }
    template <class S>
    static void init(Frame<S> &f, const EffectArgs<S> &e, S *z)
    {
        z[0] = f.m.q[e.j];
        z[1] = f.m.v[e.j];
    }
    template <class S>
    static void events(Frame<S> &f, const EffectArgs<S> &e, S *g)
    {
        S gap = 0.5 * e.p[0], d = e.z[0] - f.m.q[e.j];
        g[0] = d - gap;
        g[1] = d + gap;
    }
    template <class S>
    static void measure(Frame<S> &, const EffectArgs<S> &e, S *y)
    {
        y[e.j] = e.z[0];
    }
    template <class S>
    static double rate(const Frame<S> &f, const EffectArgs<S> &e)
    {
        double light = value_of(light_inertia(f, e)), friction = 0.0;
        if (drives(f, e)) {
            double k = f.c->sharpness[e.j], turn = value_of(smooth_sign(k, e.z[1]));
            int coulomb = mk_plant(f.c->plant)->parameter_count - 1;
            friction = k * value_of(f.c->p[coulomb]) * (1.0 - turn * turn) / light;
        }
        return 1.5 * ::sqrt(value_of(e.p[1]) / light) + value_of(e.p[2]) / light + friction;
    }
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
