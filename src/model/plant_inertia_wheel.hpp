// The inertia wheel: a wheel on the motor's shaft, or a carriage that the motor drives, which has
// the same law. Report (2.1): p1 a1 + f = u.
#ifndef MECHKIT_MODEL_PLANT_INERTIA_WHEEL_HPP
#define MECHKIT_MODEL_PLANT_INERTIA_WHEEL_HPP

#include "model/plant.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

struct InertiaWheel : Plant {
    static constexpr mk_plant_info info = [] {
        mk_plant_info i = {};
        i.kind = MK_PLANT_INERTIA_WHEEL;
        i.name = "inertia-wheel";
        i.help = "a wheel on the motor's shaft";
        i.source = "Meesters 2004 (2.1), (2.4)";
        i.joints = 1;
        i.joint_is_wheel[0] = true;
        i.joint_motion[0] = MK_JOINT_EITHER;
        i.joint_travel[0] = HUGE_VAL;
        i.joint_speed[0] = PLANT_WHEEL_SPEED;
        i.parameter_count = 3;
        i.mass_count = 1;
        i.parameter[0] = {"p1",       "kg m^2",  "inertia J of wheel and shaft",
                          PLANT_TINY, PLANT_INF, 0.0045};
        i.parameter[1] = {"p2", "N m s/rad", "viscous friction", 0.0, PLANT_INF, 0.0112};
        i.parameter[2] = {"p3", "N m", "Coulomb friction", 0.0, PLANT_INF, 0.3487};
        i.equilibrium_count = 1;
        i.equilibrium[0] = {"rest", {0.0, 0.0}, nullptr};
        i.unsuited[0] = "base-tilt";
        i.measures[0] = "friction";
        i.measures[1] = "inertia";
        return i;
    }();
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
    static double body_inertia(const double *p, int) { return p[0]; }
    static double least_inertia(const double *p, int) { return p[0]; }
    template <class S>
    static S gap_inertia(const S *p, int)
    {
        return p[0];
    }
    static int sketch(const double *q, mk_stroke *s)
    {
        s[0] = {MK_STROKE_WHEEL, 0, q[0], 1.8};
        return 1;
    }
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
