// The pendubot: two links with the motor at the shoulder. Report (2.5), (2.6), appendix A1.1; F13
// as in errata 3.9. q1 from the horizontal, q2 relative to link 1.
#ifndef MECHKIT_MODEL_PLANT_PENDUBOT_HPP
#define MECHKIT_MODEL_PLANT_PENDUBOT_HPP

#include "model/plant.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

struct Pendubot : Plant {
    static constexpr mk_plant_info info = [] {
        mk_plant_info i = {};
        i.kind = MK_PLANT_PENDUBOT;
        i.name = "pendubot";
        i.help = "two links, the motor at the shoulder";
        i.source = "Meesters 2004 (2.5), (2.6), (3.32)";
        i.joints = 2;
        i.joints_parallel = true;
        i.joint_travel[0] = PLANT_CABLE_TRAVEL;
        i.joint_travel[1] = PLANT_FREE_TRAVEL;
        i.joint_speed[0] = i.joint_speed[1] = PLANT_LINK_SPEED;
        i.rest[0] = -PLANT_PI / 2;
        i.lean[0] = i.lean[1] = 1.0;
        i.parameter_count = 7;
        i.mass_count = 5;
        i.parameter[0] = {"p1", "kg m^2", "m1 lc1^2 + m2 L1^2 + J1", PLANT_TINY, PLANT_INF, 0.0540};
        i.parameter[1] = {"p2", "kg m^2", "m2 lc2^2 + J2", PLANT_TINY, PLANT_INF, 0.0540};
        i.parameter[2] = {"p3", "kg m^2", "m2 L1 lc2", -PLANT_INF, PLANT_INF, 0.0286};
        i.parameter[3] = {"p4", "kg m", "m1 lc1 + m2 L1", -PLANT_INF, PLANT_INF, 0.7805};
        i.parameter[4] = {"p5", "kg m", "m2 lc2", -PLANT_INF, PLANT_INF, 0.3284};
        i.parameter[5] = {"p6", "N m s/rad", "viscous friction of the motor joint",
                          0.0,  PLANT_INF,   0.1346};
        i.parameter[6] = {"p7", "N m",     "Coulomb friction of the motor joint",
                          0.0,  PLANT_INF, 0.2014};
        i.mass_rule = "p1 p2 must be larger than p3^2";
        i.equilibrium_count = 3;
        i.equilibrium[0] = {"hanging", {-PLANT_PI / 2, 0.0}, nullptr};
        i.equilibrium[1] = {"mid", {-PLANT_PI / 2, PLANT_PI}, "pendubot-mid"};
        i.equilibrium[2] = {"top", {PLANT_PI / 2, 0.0}, "pendubot-top"};
        return i;
    }();
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
    static void mass_sides(const double *p, double sides[2])
    {
        sides[0] = p[0] * p[1], sides[1] = p[2] * p[2];
    }
    static double body_inertia(const double *p, int j) { return j == 0 ? p[0] + p[1] : p[1]; }
    static double least_inertia(const double *p, int j)
    {
        double det = p[0] * p[1] - p[2] * p[2];
        return det / (j == 0 ? p[1] : p[0] + p[1] + 2.0 * ::fabs(p[2]));
    }
    template <class S>
    static S gap_inertia(const S *p, int j)
    {
        return p[j == 0 ? 0 : 1];
    }
    static bool free_link(const double *p, double g, const double *x, mk_free_link *out)
    {
        double inertia = p[1], weight = p[4] * g, w = x[2] + x[3];
        out->energy = 0.5 * inertia * w * w / weight + ::sin(x[0] + x[1]) - 1.0;
        out->speed = w * ::sqrt(inertia / weight);
        out->coupling = ::cos(x[1]);
        return true;
    }
    static int sketch(const double *q, mk_stroke *s)
    {
        s[0] = {MK_STROKE_GROUND, 0, 0.0, 0.0};
        s[1] = {MK_STROKE_LINK, 0, q[0] + 0.5 * PLANT_PI, 1.0};
        s[2] = {MK_STROKE_ROD, 1, q[0] + q[1] + 0.5 * PLANT_PI, 0.95};
        return 3;
    }
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
