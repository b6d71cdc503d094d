// The Furuta pendulum: a pendulum at the end of a horizontal arm on the motor's shaft. Report
// (2.62)-(2.63) as corrected in errata 2.23, 2.24, 7.3; q1 arm, q2 pendulum from upright. The
// report never measured one: the parameters are the pendubot's links on a horizontal arm.
#ifndef MECHKIT_MODEL_PLANT_FURUTA_HPP
#define MECHKIT_MODEL_PLANT_FURUTA_HPP

#include "model/plant.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

struct Furuta : Plant {
    static constexpr mk_plant_info info = [] {
        mk_plant_info i = {};
        i.kind = MK_PLANT_FURUTA;
        i.name = "furuta";
        i.help = "a pendulum at the end of a horizontal arm on the motor's shaft";
        i.source = "Meesters 2004 (2.62), (2.63); errata 2.23, 2.24, 7.3";
        i.joints = 2;
        i.joint_is_level[0] = true;
        i.joint_travel[0] = PLANT_CABLE_TRAVEL;
        i.joint_travel[1] = PLANT_FREE_TRAVEL;
        i.joint_speed[0] = i.joint_speed[1] = PLANT_LINK_SPEED;
        i.rest[1] = PLANT_PI;
        i.lean[1] = 1.0;
        i.parameter_count = 6;
        i.mass_count = 4;
        i.parameter[0] = {"p1",       "kg m^2",  "J1 + m1 lc1^2 + m2 L1^2 of the arm",
                          PLANT_TINY, PLANT_INF, 0.0540};
        i.parameter[1] = {"p2",       "kg m^2",  "2 m2 L1 lc2 (thin rod: m2 L1 L2)",
                          -PLANT_INF, PLANT_INF, 0.0572};
        i.parameter[2] = {"p3",       "kg m^2",  "(J2 + m2 lc2^2) / 4 (thin rod: J2)",
                          PLANT_TINY, PLANT_INF, 0.0135};
        i.parameter[3] = {"p4", "kg m", "m2 lc2", -PLANT_INF, PLANT_INF, 0.3284};
        i.parameter[4] = {"p5", "N m s/rad", "viscous friction of the motor joint",
                          0.0,  PLANT_INF,   0.1346};
        i.parameter[5] = {"p6", "N m",     "Coulomb friction of the motor joint",
                          0.0,  PLANT_INF, 0.2014};
        i.mass_rule = "16 p1 p3 must be larger than p2^2";
        i.own[0] = "arm"; // of base-tilt
        i.equilibrium_count = 2;
        i.equilibrium[0] = {"hanging", {0.0, PLANT_PI}, nullptr};
        i.equilibrium[1] = {"top", {0.0, 0.0}, "furuta"};
        return i;
    }();
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
    static void mass_sides(const double *p, double sides[2])
    {
        sides[0] = 16.0 * p[0] * p[2], sides[1] = p[1] * p[1];
    }
    static double body_inertia(const double *p, int j) { return j == 0 ? p[0] : 4.0 * p[2]; }
    static double least_inertia(const double *p, int j)
    {
        double a = p[0], b = 4.0 * p[2], c = 0.5 * p[1];
        double det = a * b - c * c;
        return det > 0.0 ? det / (j == 0 ? b : a) : 0.1 * (j == 0 ? a : b);
    }
    template <class S>
    static S gap_inertia(const S *p, int)
    {
        return 4.0 * p[2];
    }
    // First moment of arm and pendulum about the vertical axis, from the base parameters of uniform
    // rods: lc2 = 3 p3 / p4, L1 = p2 / (2 p4).
    template <class S>
    static S arm_moment(const S *p)
    {
        S lc2 = 3.0 * p[2] / p[3], l1 = p[1] / (2.0 * p[3]);
        S tip = p[3] / lc2 * l1;
        return tip + 1.5 * (p[0] - tip * l1) / l1;
    }
    // Tilted about the arm's zero direction, the arm feels gravity too. Potential
    // g sin(tilt) (k sin a + p4 sin b cos a) + g cos(tilt) p4 cos b, with k = e[1] times the first
    // moment of uniform rods: where the arm's mass sits, p1 to p4 do not say.
    template <class S>
    static void tilt(const Motion<S> &m, const S *p, double g, const S *e, S *tau)
    {
        S sa, ca, sb, cb, st, ct;
        sincos(m.q[0], sa, ca);
        sincos(m.q[1], sb, cb);
        sincos(e[0], st, ct);
        S side = g * st;
        tau[0] -= side * (e[1] * arm_moment(p) * ca - p[3] * sb * sa);
        tau[1] -= side * p[3] * cb * ca + g * (1.0 - ct) * p[3] * sb;
    }
    static bool free_link(const double *p, double g, const double *x, mk_free_link *out)
    {
        double inertia = 4.0 * p[2], weight = p[3] * g, w = x[3];
        out->energy = 0.5 * inertia * w * w / weight + ::cos(x[1]) - 1.0;
        out->speed = w * ::sqrt(inertia / weight);
        out->coupling = ::cos(x[1]);
        return true;
    }
    // From the front, at the tip of the arm.
    static int sketch(const double *q, mk_stroke *s)
    {
        s[0] = {MK_STROKE_DIAL, 0, q[0], 1.0};
        s[1] = {MK_STROKE_GROUND, 0, 0.0, 0.0};
        s[2] = {MK_STROKE_ROD, 1, PLANT_PI - q[1], 1.9};
        return 3;
    }
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
