// The pendulum: one link on the motor's shaft. Report (3.13), q1 from the downward vertical (errata
// 3.4): p1 a1 + p2 sin q1 + f = u.
#ifndef MECHKIT_MODEL_PLANT_PENDULUM_HPP
#define MECHKIT_MODEL_PLANT_PENDULUM_HPP

#include "model/plant.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

struct Pendulum : Plant {
    static constexpr mk_plant_info info = [] {
        mk_plant_info i = {};
        i.kind = MK_PLANT_PENDULUM;
        i.name = "pendulum";
        i.help = "one link on the motor's shaft";
        i.source = "Meesters 2004 (3.13), (3.25)";
        i.joints = 1;
        i.joint_travel[0] = PLANT_FREE_TRAVEL;
        i.joint_speed[0] = PLANT_LINK_SPEED;
        i.lean[0] = 1.0;
        i.parameter_count = 4;
        i.mass_count = 2;
        i.parameter[0] = {"p1",       "kg m^2",  "inertia J about the shaft",
                          PLANT_TINY, PLANT_INF, 0.0624};
        i.parameter[1] = {"p2", "N m", "gravity torque m g l", 0.0, PLANT_INF, 7.0408};
        i.parameter[2] = {"p3", "N m s/rad", "viscous friction", 0.0, PLANT_INF, 0.0111};
        i.parameter[3] = {"p4", "N m", "Coulomb friction", 0.0, PLANT_INF, 0.3575};
        i.equilibrium_count = 2;
        i.equilibrium[0] = {"hanging", {0.0, 0.0}, nullptr};
        i.equilibrium[1] = {"top", {PLANT_PI, 0.0}, nullptr};
        i.unsuited[0] = "backlash";
        i.measures[0] = "swing";
        i.measures[1] = "torque";
        return i;
    }();
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
    static double body_inertia(const double *p, int) { return p[0]; }
    static double least_inertia(const double *p, int) { return p[0]; }
    template <class S>
    static S gap_inertia(const S *p, int)
    {
        return p[0];
    }
    static bool swing(const double *p, double, mk_free_swing *out)
    {
        *out = {p[1], p[0], 0.0, -1, "p1"};
        return true;
    }
    static int sketch(const double *q, mk_stroke *s)
    {
        s[0] = {MK_STROKE_GROUND, 0, 0.0, 0.0};
        s[1] = {MK_STROKE_ROD, 0, q[0], 1.9};
        return 2;
    }
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
