// The cart-pole: a free pole on a carriage that the motor drives along a level track. q1 the
// carriage in m, q2 the pole from the upward vertical, towards +q1. With the pole's centre of mass
// at q1 + l sin q2, l cos q2 (Florian, Correct equations for the dynamics of the cart-pole system,
// 2007):
//     p1 a1 + p2 (cos q2 a2 - sin q2 v2^2) + f = u,
//     p2 cos q2 a1 + p3 a2 - p2 g sin q2 = 0.
// The parameters are those of a small rig of the lecture hall: a carriage of 0.7 kg on a track of
// 1 m, a rod of 0.12 kg and 0.5 m.
#ifndef MECHKIT_MODEL_PLANT_CART_POLE_HPP
#define MECHKIT_MODEL_PLANT_CART_POLE_HPP

#include "model/plant.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

struct CartPole : Plant {
    static constexpr mk_plant_info info = [] {
        mk_plant_info i = {};
        i.kind = MK_PLANT_CART_POLE;
        i.name = "cart-pole";
        i.help = "a free pole on a carriage that the motor drives along a track";
        i.source = "Florian 2007 (23), (24) without friction of the pole";
        i.joints = 2;
        i.joint_is_level[0] = true;
        i.joint_motion[0] = MK_JOINT_SLIDES;
        i.joint_travel[0] = 0.45; // m: half the track, less the carriage
        i.joint_travel[1] = PLANT_FREE_TRAVEL;
        i.joint_speed[0] = 5.0; // m/s
        i.joint_speed[1] = PLANT_LINK_SPEED;
        i.rest[1] = PLANT_PI;
        i.lean[1] = 1.0;
        i.u_max = 10.0;      // N
        i.u_to_torque = 1.0; // the command is the force
        i.parameter_count = 5;
        i.mass_count = 3;
        i.parameter[0] = {
            "p1",       "kg m^2",  "mass of carriage, pole and what turns with the motor",
            PLANT_TINY, PLANT_INF, 0.82};
        i.parameter[1] = {"p2",       "kg m",    "first moment m2 lc2 of the pole",
                          -PLANT_INF, PLANT_INF, 0.03};
        i.parameter[2] = {"p3",       "kg m^2",  "J2 + m2 lc2^2 of the pole about its pivot",
                          PLANT_TINY, PLANT_INF, 0.01};
        i.parameter_joint[2] = 1;
        i.parameter[3] = {"p4", "N m s/rad", "viscous friction of carriage and motor",
                          0.0,  PLANT_INF,   3.0};
        i.parameter[4] = {"p5", "N m", "Coulomb friction of the carriage", 0.0, PLANT_INF, 0.3};
        i.mass_rule = "p1 p3 must be larger than p2^2";
        i.equilibrium_count = 2;
        i.equilibrium[0] = {"hanging", {0.0, PLANT_PI}, nullptr};
        i.equilibrium[1] = {"top", {0.0, 0.0}, "cart-pole"};
        return i;
    }();
    static constexpr int joints = 2;
    template <class S, class Sink>
    static void law(const Motion<S> &m, double g, Sink &o)
    {
        S s, c;
        sincos(m.q[1], s, c);
        o.d11(0);
        o.d12(1, c), o.h1(1, -s * m.v[1] * m.v[1]), o.h2(1, -g * s);
        o.d22(2);
    }
    template <class S>
    static S potential(const S *p, const S *q, double g)
    {
        return p[1] * g * cos(q[1]);
    }
    template <class S>
    static S bearing_load(const Motion<S> &m, const S *p, double g)
    {
        return p[2] * m.v[1] * m.v[1] - p[1] * g * cos(m.q[1]);
    }
    static void mass_sides(const double *p, double sides[2])
    {
        sides[0] = p[0] * p[2], sides[1] = p[1] * p[1];
    }
    static double body_inertia(const double *p, int j) { return j == 0 ? p[0] : p[2]; }
    static double least_inertia(const double *p, int j)
    {
        return (p[0] * p[2] - p[1] * p[1]) / (j == 0 ? p[2] : p[0]);
    }
    template <class S>
    static S gap_inertia(const S *p, int j)
    {
        return j == 0 ? p[0] : p[2];
    }
    // The track rises towards +q1 by e[0]. Potential
    // g sin(tilt) (p1 q1 + p2 sin q2) + g cos(tilt) p2 cos q2.
    template <class S>
    static void tilt(const Motion<S> &m, const S *p, double g, const S *e, S *tau)
    {
        S sb, cb, st, ct;
        sincos(m.q[1], sb, cb);
        sincos(e[0], st, ct);
        tau[0] -= g * st * p[0];
        tau[1] -= g * st * p[1] * cb + g * (1.0 - ct) * p[1] * sb;
    }
    static bool free_link(const double *p, double g, const double *x, mk_free_link *out)
    {
        double inertia = p[2], weight = p[1] * g, w = x[3];
        out->energy = 0.5 * inertia * w * w / weight + ::cos(x[1]) - 1.0;
        out->speed = w * ::sqrt(inertia / weight);
        out->coupling = ::cos(x[1]);
        return true;
    }
    // The track's half is as long as the pole.
    static int sketch(const double *q, mk_stroke *s)
    {
        s[0] = {MK_STROKE_CARRIAGE, 0, 0.0, 1.5 * q[0] / info.joint_travel[0]};
        s[1] = {MK_STROKE_ROD, 1, PLANT_PI - q[1], 1.6};
        return 2;
    }
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
