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

// A term as people read it, and how it grows: by the powers of its factors.
struct CustomTerm {
    const char *text; // q, v: angle from rest and speed of the joint; w: speed of the other joint;
                      // u: the motor's command; t: time
    double v, w = 0.0, q = 0.0, u = 0.0, t = 0.0;
};

struct Custom {
    static constexpr int TERMS = 23;
    static constexpr mk_effect_info info = {
        "custom",
        "-c f(q, v, w, u, t), f by number",
        "discrepancy models: Kaheman, Kaiser, Strom, Kutz, Brunton 2019",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_TORQUE,
        ALL_PLANTS,
        0,
        0,
        2,
        {{"coefficient", "", "c", -INF, INF, 0.0},
         {"term", "", "number of f", 1.0, TERMS, 1.0, MK_FIT_FIXED}},
        true};
    static constexpr mk_effect_words words = {};
    static const CustomTerm &about(int number)
    {
        static const CustomTerm all[TERMS] = {{"v^3", 3},
                                              {"v^3*abs(v)", 4},
                                              {"sign(v)*w^2", 0, 2},
                                              {"sign(v)*v^4", 4},
                                              {"q^3", 0, 0, 3},
                                              {"q*abs(q)", 0, 0, 2},
                                              {"w", 0, 1},
                                              {"sign(w)", 0, 0},
                                              {"w*abs(w)", 0, 2},
                                              {"v*w^2", 1, 2},
                                              {"1", 0},
                                              {"u*abs(u)", 0, 0, 0, 2},
                                              {"u^3", 0, 0, 0, 3},
                                              {"v*q^2", 1, 0, 2},
                                              {"sign(v)*q^2", 0, 0, 2},
                                              {"v*abs(w)", 1, 1},
                                              {"sign(v)*(v+w)^2", 0, 2},
                                              {"sign(v)*sqrt(abs(v))", 0.5},
                                              {"abs(v)", 1},
                                              {"u*abs(v)", 1, 0, 0, 1},
                                              {"t", 0, 0, 0, 0, 1},
                                              {"v*t", 1, 0, 0, 0, 1},
                                              {"sign(v)*t", 0, 0, 0, 0, 1}};
        return all[number >= 1 && number <= TERMS ? number - 1 : 0];
    }
    template <class S>
    static S term(const Frame<S> &f, int j, int number)
    {
        const S &v = f.m.v[j], &w = f.m.v[1 - j];
        S q = f.m.q[j] - mk_plant(f.c->plant)->rest[j];
        const S &u = f.command[0];
        const double k = f.c->sharpness[j];
        switch (number) {
        default:
            return v * v * v;
        case 2:
            return v * v * v * fabs(v);
        case 3:
            return smooth_sign(k, v) * w * w;
        case 4:
            return smooth_sign(k, v) * v * v * v * v;
        case 5:
            return q * q * q;
        case 6:
            return q * fabs(q);
        case 7:
            return w;
        case 8:
            return smooth_sign(f.c->sharpness[1 - j], w);
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
            return smooth_sign(k, v) * q * q;
        case 16:
            return v * fabs(w);
        case 17:
            return smooth_sign(k, v) * (v + w) * (v + w);
        case 18: // with a slope at rest
            return v / sqrt(sqrt(v * v + 1e-4));
        case 19:
            return fabs(v);
        case 20:
            return u * fabs(v);
        case 21:
            return f.t;
        case 22:
            return v * f.t;
        case 23:
            return smooth_sign(k, v) * f.t;
        }
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
    static constexpr mk_effect_words words = {};
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
        const double k = f.c->sharpness[e.j];
        switch ((int)value_of(e.p[2])) {
        case 1:
            return smooth_sign(k, v) * sin(q + e.p[1]);
        case 2:
            return v * sin(q + e.p[1]);
        case 3:
            return smooth_sign(k, v) * sin(f.m.q[0] + f.m.q[1] + e.p[1]);
        case 4:
            return smooth_sign(k, v) * sin(2.0 * q + e.p[1]);
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
    static constexpr mk_effect_words words = {};
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
