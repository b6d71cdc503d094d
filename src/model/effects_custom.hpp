// Torques that the catalogue has no name for: a coefficient times one term of a library. A sum of
// them states what a regression found in data; each is carried by model files like any other
// effect.
#ifndef MECHKIT_MODEL_EFFECTS_CUSTOM_HPP
#define MECHKIT_MODEL_EFFECTS_CUSTOM_HPP

#include "model/effect.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

// q, v: angle from rest and speed of the joint; w: speed of the other joint; u: the motor's
// command.
struct Custom {
    static constexpr mk_effect_info info = {
        "custom",
        "-c f(q, v, w, u), f by number",
        "discrepancy models: Kaheman, Kaiser, Strom, Kutz, Brunton 2019",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_TORQUE,
        ALL_PLANTS,
        0,
        0,
        2,
        {{"coefficient", "", "c", -INF, INF, 0.0},
         {"term", "", "number of f", 1.0, 18.0, 1.0, MK_FIT_FIXED}},
        true};
    template <class S>
    static S term(const Frame<S> &f, int j, int number)
    {
        const S &v = f.m.v[j], &w = f.m.v[1 - j];
        S q = f.m.q[j] - mk_plant(f.c->plant)->rest[j];
        const S &u = f.command[0];
        switch (number) {
        case 1:
            return v * v * v;
        case 2:
            return v * v * v * fabs(v);
        case 3:
            return smooth_sign(v) * w * w;
        case 4:
            return smooth_sign(v) * v * v * v * v;
        case 5:
            return q * q * q;
        case 6:
            return q * fabs(q);
        case 7:
            return w;
        case 8:
            return smooth_sign(w);
        case 9:
            return w * fabs(w);
        case 10:
            return v * w * w;
        case 11:
            return S(1.0);
        case 12:
            return u * fabs(u);
        case 13:
            return u * u * u;
        case 14:
            return v * q * q;
        case 15:
            return smooth_sign(v) * q * q;
        case 16:
            return v * fabs(w);
        case 17:
            return smooth_sign(v) * (v + w) * (v + w);
        default: // with a slope at rest
            return v / sqrt(sqrt(v * v + 1e-4));
        }
    }
    // The terms as people read them, in the same letters.
    static const char *text(int number)
    {
        static const char *const all[] = {"v^3",
                                          "v^3*abs(v)",
                                          "sign(v)*w^2",
                                          "sign(v)*v^4",
                                          "q^3",
                                          "q*abs(q)",
                                          "w",
                                          "sign(w)",
                                          "w*abs(w)",
                                          "v*w^2",
                                          "1",
                                          "u*abs(u)",
                                          "u^3",
                                          "v*q^2",
                                          "sign(v)*q^2",
                                          "v*abs(w)",
                                          "sign(v)*(v+w)^2",
                                          "sign(v)*sqrt(abs(v))"};
        return all[number >= 1 && number <= 18 ? number - 1 : 17];
    }
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.tau[e.j] -= e.p[0] * term(f, e.j, (int)value_of(e.p[1]));
    }
};

// The same with a phase: -A f sin(n q + phi).
struct CustomWave {
    static constexpr mk_effect_info info = {
        "custom-wave",
        "-A f sin(angle + phi), f and angle by number",
        "discrepancy models: Kaheman, Kaiser, Strom, Kutz, Brunton 2019",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_TORQUE,
        ALL_PLANTS,
        0,
        0,
        4,
        {{"amplitude", "", "A", 0.0, INF, 0.0},
         {"phase", "rad", "phi", -INF, INF, 0.0, MK_FIT_ANGLE},
         {"term", "", "number of f and angle", 1.0, 8.0, 1.0, MK_FIT_FIXED},
         {"frequency", "Hz", "of a term in time", 0.0, 1000.0, 1.0, MK_FIT_FREE, true}},
        true};
    static constexpr int IN_TIME = 8;
    // Up to the phase.
    static const char *text(int number)
    {
        static const char *const all[] = {"sign(v)*sin(q",   "v*sin(q",     "sign(v)*sin(a",
                                          "sign(v)*sin(2*q", "v*sin(2*q",   "v*abs(v)*sin(q",
                                          "w*sin(q",         "sin(2*pi*f*t"};
        return all[number >= 1 && number <= IN_TIME ? number - 1 : IN_TIME - 1];
    }
    template <class S>
    static S wave(const Frame<S> &f, const EffectArgs<S> &e)
    {
        const S &v = f.m.v[e.j], &q = f.m.q[e.j];
        switch ((int)value_of(e.p[2])) {
        case 1:
            return smooth_sign(v) * sin(q + e.p[1]);
        case 2:
            return v * sin(q + e.p[1]);
        case 3:
            return smooth_sign(v) * sin(f.m.q[0] + f.m.q[1] + e.p[1]);
        case 4:
            return smooth_sign(v) * sin(2.0 * q + e.p[1]);
        case 5:
            return v * sin(2.0 * q + e.p[1]);
        case 6:
            return v * fabs(v) * sin(q + e.p[1]);
        case 7:
            return f.m.v[1 - e.j] * sin(q + e.p[1]);
        default:
            return sin(TWO_PI * e.p[3] * f.t + e.p[1]);
        }
    }
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.tau[e.j] -= e.p[0] * wave(f, e);
    }
};

// What draws a link to a place or pushes it away from there, and is not felt elsewhere: a magnet, a
// dent in a bearing. -A x/w e^(-x^2/(2 w^2)), x the way to it, once around.
struct CustomWell {
    static constexpr mk_effect_info info = {
        "custom-well",
        "-(A/w) sin(q - c) exp(-(1 - cos(q - c))/w^2)",
        "gradient of a von Mises bell",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_TORQUE,
        ALL_PLANTS,
        0,
        0,
        3,
        {{"amplitude", "N m", "A, 1.65 times the largest torque", -INF, INF, 0.0},
         {"centre", "rad", "c", -INF, INF, 0.0},
         {"width", "rad", "w, from the centre to the largest torque", 0.02, 2.0, 0.4}},
        true};
    template <class S>
    static void torque(Frame<S> &f, const EffectArgs<S> &e)
    {
        const S x = f.m.q[e.j] - e.p[1], &w = e.p[2];
        f.tau[e.j] -= e.p[0] / w * sin(x) * exp((cos(x) - 1.0) / (w * w));
    }
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
