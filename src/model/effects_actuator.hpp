// Between the command in the log and the torque on the rig.
#ifndef MECHKIT_MODEL_EFFECTS_ACTUATOR_HPP
#define MECHKIT_MODEL_EFFECTS_ACTUATOR_HPP

#include "model/effect.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

// The simulation shifts the command; there is nothing to evaluate here.
struct InputDelay {
    static constexpr mk_effect_info info = {"input-delay",
                                            "u acts late",
                                            "dead time of bus, amplifier and sampling",
                                            MK_EFFECT_JOINT_NONE,
                                            MK_STAGE_COMMAND_DELAY,
                                            ALL_PLANTS,
                                            0,
                                            0,
                                            1,
                                            {{"delay", "s", "delay", 0.0, 1.0, 0.005}}};
};

// The current amplifier runs out of voltage: the torque it can make falls linearly with the speed
// of the motor (a limit apart from |u| <= u_max; errata 2.3).
struct BackEmfLimit {
    static constexpr mk_effect_info info = {
        "back-emf-limit",
        "|torque| <= stall (1 - |w| / w0), w the motor's speed",
        "DC motor at limited voltage",
        MK_EFFECT_JOINT_NONE,
        MK_STAGE_COMMAND,
        ALL_PLANTS,
        0,
        0,
        2,
        {{"stall", "N m", "limit at rest", 0.0, INF, 10.0},
         {"no-load-speed", "rad/s", "speed w0 where nothing is left", 1e-6, INF, 100.0}}};
    template <class S>
    static void command(Frame<S> &f, const EffectArgs<S> &e)
    {
        S left = 1.0 - fabs(f.motor_speed) / e.p[1];
        S limit = e.p[0] * if_positive(left, left, S(0.0));
        f.command[0] = clamp(f.command[0], S(-limit), limit);
    }
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
