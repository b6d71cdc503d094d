// The acrobot: the pendubot's two links with the motor at the elbow (Spong, The swing up control
// problem for the acrobot, 1995). The law is the pendubot's; the motor and its friction act on
// joint 2, against link 1, and link 1 hangs freely.
#ifndef MECHKIT_MODEL_PLANT_ACROBOT_HPP
#define MECHKIT_MODEL_PLANT_ACROBOT_HPP

#include "model/plant_pendubot.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

struct Acrobot : Pendubot {
    static constexpr mk_plant_info info = [] {
        mk_plant_info i = Pendubot::info;
        i.kind = MK_PLANT_ACROBOT;
        i.name = "acrobot";
        i.help = "two links, the motor at the elbow";
        i.source = "Spong 1995; Meesters 2004 (2.5), (2.6) with the torque at joint 2";
        i.motor_joint = 1;
        i.joint_travel[0] = PLANT_FREE_TRAVEL;
        i.joint_travel[1] = PLANT_CABLE_TRAVEL;
        i.equilibrium_count = 2;
        i.equilibrium[0] = {"hanging", {-PLANT_PI / 2, 0.0}, nullptr};
        i.equilibrium[1] = {"top", {PLANT_PI / 2, 0.0}, "acrobot"};
        i.equilibrium[2] = {};
        i.unsuited[0] = "base-compliance"; // the motor pushes link 1, not the base
        return i;
    }();
    // Link 1 in its bearing, with what link 2 pulls along it.
    template <class S>
    static S bearing_load(const Motion<S> &m, const S *p, double g)
    {
        S w = m.w1 + m.v[1];
        return p[0] * m.w1 * m.w1 + p[2] * w * w * cos(m.q[1]) - p[3] * g * sin(m.qg1);
    }
    // The pivot of link 2 is moved by gravity and link 1, not by the motor.
    static bool free_link(const double *, double, const double *, mk_free_link *) { return false; }
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
