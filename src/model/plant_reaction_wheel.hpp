// The reaction wheel: a free pendulum that carries the motor with a wheel. Report (2.19)-(2.21)
// with q2 relative to the pendulum (errata 2.12): row 2 is p2 (a1 + a2) = u - f; row 1 minus row 2
// is p1 a1 + p3 g sin q1 = -(u - f).
#ifndef MECHKIT_MODEL_PLANT_REACTION_WHEEL_HPP
#define MECHKIT_MODEL_PLANT_REACTION_WHEEL_HPP

#include "model/plant.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

struct ReactionWheel : Plant {
    static constexpr mk_plant_info info = [] {
        mk_plant_info i = {};
        i.kind = MK_PLANT_REACTION_WHEEL;
        i.name = "reaction-wheel";
        i.help = "a free pendulum that carries the motor with a wheel";
        i.source = "Meesters 2004 (2.19)-(2.21), section 3.4; errata 3.18";
        i.joints = 2;
        i.motor_joint = 1;
        i.joint_is_wheel[1] = true;
        i.joints_parallel = true;
        i.joint_travel[0] = PLANT_FREE_TRAVEL;
        i.joint_travel[1] = HUGE_VAL;
        i.joint_speed[0] = PLANT_LINK_SPEED;
        i.joint_speed[1] = PLANT_WHEEL_SPEED;
        i.lean[0] = 1.0;
        i.parameter_count = 5;
        i.mass_count = 3;
        i.parameter[0] = {"p1", "kg m^2", "J1 + m1 lc1^2 + m2 L1^2", PLANT_TINY, PLANT_INF, 0.8544};
        i.parameter[1] = {"p2",       "kg m^2",  "inertia of wheel and rotor",
                          PLANT_TINY, PLANT_INF, 0.0045};
        i.parameter[2] = {"p3", "kg m", "m1 lc1 + m2 L1", -PLANT_INF, PLANT_INF, 6.864};
        i.parameter[3] = {"p4", "N m s/rad", "viscous friction of the motor",
                          0.0,  PLANT_INF,   0.0112};
        i.parameter[4] = {"p5", "N m", "Coulomb friction of the motor", 0.0, PLANT_INF, 0.3487};
        i.equilibrium_count = 2;
        i.equilibrium[0] = {"hanging", {0.0, 0.0}, nullptr};
        i.equilibrium[1] = {"top", {PLANT_PI, 0.0}, "reaction-wheel"};
        i.unsuited[0] = "base-compliance"; // the motor pushes the pendulum, not the base
        i.measures[0] = "swing";
        return i;
    }();
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
    static double body_inertia(const double *p, int j) { return p[j]; }
    static double least_inertia(const double *p, int j)
    {
        return j == 0 ? p[0] : p[1] * p[0] / (p[0] + p[1]);
    }
    template <class S>
    static S gap_inertia(const S *p, int)
    {
        return p[1];
    }
    // Friction locks the wheel to the pendulum.
    static bool swing(const double *p, double g, mk_free_swing *out)
    {
        *out = {p[2] * g, p[0] + p[1], p[1], 1, "p1 + p2"};
        return true;
    }
    static int sketch(const double *q, mk_stroke *s)
    {
        s[0] = {MK_STROKE_GROUND, 0, 0.0, 0.0};
        s[1] = {MK_STROKE_ROD, 0, q[0], 1.4};
        s[2] = {MK_STROKE_WHEEL, 1, q[0] + q[1], 0.5};
        return 3;
    }
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
