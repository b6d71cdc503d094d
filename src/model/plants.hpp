// The five plants. Each law stands here once and nowhere else.
//
// Every plant is linear in its base parameters p_i and in its accelerations:
//     sum_i p_i (D_i(q) a + h_i(q, v)) = right-hand side,
// so a law states, term by term, what p_i is multiplied with: entries of the symmetric mass matrix
// (d11, d12, d22) and of h = C v + G (h1, h2). A "sink" receives the terms: Assembler sums them to
// D and h, Regressor keeps them apart as columns of Phi. Rows are in Lagrangian form: row j is the
// equation of the generalised coordinate q_j, so a torque inside joint j appears in row j alone.
//
// bearing_load is the force that the bearing of the passive joint takes along the link that hangs
// on it, outwards positive, times the lever of that link's centre of mass: of a point mass that
// swings as the link does, from its weight and from what holds it on its path. The part of the
// other joint's acceleration, which friction itself would change, is left out.
//
// Friction of the motor joint has the same form on every plant (the last two parameters) and is
// added by the model (rhs.hpp): what turns with the motor's shaft need not be the joint (backlash).
//
// Sources: Meesters 2004, chapter 2 and appendix 1, as corrected in docs/theory.md.
#ifndef MECHKIT_MODEL_PLANTS_HPP
#define MECHKIT_MODEL_PLANTS_HPP

#include "mechkit/model.h"
#include "model/scalar.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

// What a law sees of the motion. w1 and qg1 differ from v[0] and q[0] only on a base that moves or
// is tilted.
template <class S>
struct Motion {
    S q[2], v[2]; // joint angles and speeds
    S w1;         // inertial speed of joint 1's body
    S qg1;        // angle of joint 1's body against gravity, in the convention of q1
};

template <class S>
inline Motion<S> motion_of(int joints, const S *q, const S *v)
{
    Motion<S> m;
    m.q[0] = q[0];
    m.v[0] = v[0];
    m.q[1] = joints > 1 ? q[1] : S(0.0);
    m.v[1] = joints > 1 ? v[1] : S(0.0);
    m.w1 = m.v[0];
    m.qg1 = m.q[0];
    return m;
}

// --- sinks ---------------------------------------------------------------------------------------

template <class S>
struct Assembler {
    const S *p;
    S m11 = S(0.0), m12 = S(0.0), m22 = S(0.0), f1 = S(0.0), f2 = S(0.0);
    explicit Assembler(const S *parameters) : p(parameters) {}
    void d11(int i) { m11 += p[i]; }
    void d12(int i) { m12 += p[i]; }
    void d22(int i) { m22 += p[i]; }
    void d11(int i, const S &c) { m11 += p[i] * c; }
    void d12(int i, const S &c) { m12 += p[i] * c; }
    void d22(int i, const S &c) { m22 += p[i] * c; }
    void h1(int i, const S &c) { f1 += p[i] * c; }
    void h2(int i, const S &c) { f2 += p[i] * c; }
};

template <class S>
struct Regressor {
    S a1, a2;
    S phi[2][MK_MAX_PARAMETERS] = {};
    Regressor(const S &acc1, const S &acc2) : a1(acc1), a2(acc2) {}
    void d11(int i) { phi[0][i] += a1; }
    void d12(int i) { phi[0][i] += a2, phi[1][i] += a1; }
    void d22(int i) { phi[1][i] += a2; }
    void d11(int i, const S &c) { phi[0][i] += c * a1; }
    void d12(int i, const S &c) { phi[0][i] += c * a2, phi[1][i] += c * a1; }
    void d22(int i, const S &c) { phi[1][i] += c * a2; }
    void h1(int i, const S &c) { phi[0][i] += c; }
    void h2(int i, const S &c) { phi[1][i] += c; }
};

// --- laws ----------------------------------------------------------------------------------------

// p1 a1 + f = u. Report (2.1).
struct InertiaWheel {
    static constexpr int joints = 1;
    template <class S, class Sink>
    static void law(const Motion<S> &, double, Sink &o)
    {
        o.d11(0);
    }
    template <class S>
    static S potential(const S *, const S *, double)
    {
        return S(0.0);
    }
    template <class S>
    static S bearing_load(const Motion<S> &, const S *, double)
    {
        return S(0.0); // no passive joint
    }
};

// p1 a1 + p2 sin q1 + f = u. Report (3.13), q1 from the downward vertical (errata 3.4).
struct Pendulum {
    static constexpr int joints = 1;
    template <class S, class Sink>
    static void law(const Motion<S> &m, double, Sink &o)
    {
        o.d11(0);
        o.h1(1, sin(m.qg1));
    }
    template <class S>
    static S potential(const S *p, const S *q, double)
    {
        return p[1] * (1.0 - cos(q[0]));
    }
    template <class S>
    static S bearing_load(const Motion<S> &, const S *, double)
    {
        return S(0.0); // no passive joint
    }
};

// Report (2.5), (2.6), appendix A1.1; F13 as in errata 3.9.
struct Pendubot {
    static constexpr int joints = 2;
    template <class S, class Sink>
    static void law(const Motion<S> &m, double g, Sink &o)
    {
        const S angle[3] = {m.q[1], m.qg1, m.qg1 + m.q[1]};
        S sine[3], cosine[3];
        sincos(angle, sine, cosine);
        const S s2 = sine[0], c2 = cosine[0], gc1 = g * cosine[1], gc12 = g * cosine[2];
        o.d11(0);
        o.d11(1), o.d12(1), o.d22(1);
        o.d11(2, 2.0 * c2), o.d12(2, c2);
        o.h1(2, -s2 * m.v[1] * (2.0 * m.w1 + m.v[1])), o.h2(2, s2 * m.w1 * m.w1);
        o.h1(3, gc1);
        o.h1(4, gc12), o.h2(4, gc12);
    }
    template <class S>
    static S potential(const S *p, const S *q, double g)
    {
        return g * (p[3] * sin(q[0]) + p[4] * sin(q[0] + q[1]));
    }
    template <class S>
    static S bearing_load(const Motion<S> &m, const S *p, double g)
    {
        S w = m.w1 + m.v[1];
        return p[1] * w * w + p[2] * m.w1 * m.w1 * cos(m.q[1]) - p[4] * g * sin(m.qg1 + m.q[1]);
    }
};

// Report (2.19)-(2.21) with q2 relative to the pendulum (errata 2.12): row 2 is p2 (a1 + a2) = u -
// f; row 1 minus row 2 is p1 a1 + p3 g sin q1 = -(u - f).
struct ReactionWheel {
    static constexpr int joints = 2;
    template <class S, class Sink>
    static void law(const Motion<S> &m, double g, Sink &o)
    {
        o.d11(0);
        o.d11(1), o.d12(1), o.d22(1);
        o.h1(2, g * sin(m.qg1));
    }
    template <class S>
    static S potential(const S *p, const S *q, double g)
    {
        return p[2] * g * (1.0 - cos(q[0]));
    }
    template <class S>
    static S bearing_load(const Motion<S> &m, const S *p, double g)
    {
        return p[0] * m.w1 * m.w1 + p[2] * g * cos(m.qg1);
    }
};

// Report (2.62)-(2.63) as corrected in errata 2.23, 2.24, 7.3; q1 arm, q2 pendulum from upright.
struct Furuta {
    static constexpr int joints = 2;
    template <class S, class Sink>
    static void law(const Motion<S> &m, double g, Sink &o)
    {
        S s, c;
        sincos(m.q[1], s, c);
        S sin2b = 2.0 * s * c;
        o.d11(0);
        o.d12(1, 0.5 * c), o.h1(1, -0.5 * s * m.v[1] * m.v[1]);
        o.d11(2, 4.0 * s * s), o.d22(2, S(4.0));
        o.h1(2, 4.0 * sin2b * m.w1 * m.v[1]), o.h2(2, -2.0 * sin2b * m.w1 * m.w1);
        o.h2(3, -g * s);
    }
    template <class S>
    static S potential(const S *p, const S *q, double g)
    {
        return p[3] * g * cos(q[1]);
    }
    template <class S>
    static S bearing_load(const Motion<S> &m, const S *p, double g)
    {
        S s, c;
        sincos(m.q[1], s, c);
        return 4.0 * p[2] * (m.v[1] * m.v[1] + m.w1 * m.w1 * s * s) - p[3] * g * c;
    }
};

// Calls f with the law of `kind`, e.g. with_plant(kind, [&](auto law) { law.law(m, g, sink); }).
template <class F>
inline auto with_plant(enum mk_plant_kind kind, F &&f)
{
    switch (kind) {
    case MK_PLANT_INERTIA_WHEEL:
        return f(InertiaWheel{});
    case MK_PLANT_PENDULUM:
        return f(Pendulum{});
    case MK_PLANT_REACTION_WHEEL:
        return f(ReactionWheel{});
    case MK_PLANT_FURUTA:
        return f(Furuta{});
    case MK_PLANT_PENDUBOT:
    case MK_PLANT_COUNT:
        break;
    }
    return f(Pendubot{});
}

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
