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
    static constexpr mk_effect_words words = {
        "a command that acts late",
        "Computation and transmission between the controller and the amplifier.",
        "Shorten the loop, or let the controller predict over the delay."};
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
    static constexpr mk_effect_words words = {
        "a torque that fades with speed", "The supply's voltage: the motor's back-EMF uses it up.",
        "Stay below that speed, or raise the supply."};
    template <class S>
    static void command(Frame<S> &f, const EffectArgs<S> &e)
    {
        S left = 1.0 - fabs(f.motor_speed) / e.p[1];
        S limit = e.p[0] * if_positive(left, left, S(0.0));
        f.command[0] = clamp(f.command[0], S(-limit), limit);
    }
};

// The amplifier ignores small commands.
struct Deadband {
    static constexpr mk_effect_info info = {"deadband",
                                            "nothing inside +-b, u -+ b outside",
                                            "dead zone of an amplifier",
                                            MK_EFFECT_JOINT_NONE,
                                            MK_STAGE_COMMAND,
                                            ALL_PLANTS,
                                            0,
                                            0,
                                            1,
                                            {{"width", "N m", "half width b", 0.0, INF, 0.1}},
                                            true};
    static constexpr mk_effect_words words = {
        "a dead zone", "An amplifier or bridge that gives nothing at small commands.",
        "Add the width of the dead zone to the command, by its sign."};
    template <class S>
    static void command(Frame<S> &f, const EffectArgs<S> &e)
    {
        S u = f.command[0], zero = S(0.0);
        f.command[0] =
            if_positive(u - e.p[0], u - e.p[0], if_positive(-u - e.p[0], u + e.p[0], zero));
    }
};

// The torque is not what u_to_torque says: another amplifier setting, a torque read from a current.
struct TorqueScale {
    static constexpr mk_effect_info info = {"torque-scale",
                                            "gain 1 + a",
                                            "scale of an amplifier or of a torque reading",
                                            MK_EFFECT_JOINT_NONE,
                                            MK_STAGE_COMMAND,
                                            ALL_PLANTS,
                                            0,
                                            0,
                                            1,
                                            {{"ratio", "", "a", -0.99, 100.0, 0.0}},
                                            true};
    static constexpr mk_effect_words words = {
        "another torque for each command",
        "An amplifier's setting, the torque constant, or the scale of a reading.",
        "Measure the torque constant (measure torque), or the current."};
    template <class S>
    static void command(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.command[0] += e.p[0] * f.command[0];
    }
};

// Two halves of a push-pull stage.
struct GainAsymmetry {
    static constexpr mk_effect_info info = {"gain-asymmetry",
                                            "gain 1 + a for u > 0, 1 - a for u < 0",
                                            "push-pull output stage",
                                            MK_EFFECT_JOINT_NONE,
                                            MK_STAGE_COMMAND,
                                            ALL_PLANTS,
                                            0,
                                            0,
                                            1,
                                            {{"ratio", "", "a", -1.0, 1.0, 0.02}},
                                            true};
    static constexpr mk_effect_words words = {
        "a gain that differs between the directions",
        "The two halves of a bridge, or an offset before a saturating stage.",
        "Measure the current at equal commands of either sign."};
    template <class S>
    static void command(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.command[0] += e.p[0] * fabs(f.command[0]);
    }
};

// The motor warms, its magnets weaken. Time counts from the start of the log.
struct GainDrift {
    static constexpr mk_effect_info info = {"gain-drift",
                                            "gain 1 - a (1 - exp(-t/T))",
                                            "warming motor",
                                            MK_EFFECT_JOINT_NONE,
                                            MK_STAGE_COMMAND,
                                            ALL_PLANTS,
                                            0,
                                            0,
                                            2,
                                            {{"loss", "", "final loss a", -1.0, 1.0, 0.05},
                                             {"time-constant", "s", "T", 1e-3, INF, 4.0}},
                                            true};
    static constexpr mk_effect_words words = {
        "a gain that falls while the rig runs",
        "A motor or amplifier that warms up, a battery that empties.",
        "Run it warm before measuring; look at the supply."};
    template <class S>
    static void command(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.command[0] -= e.p[0] * (1.0 - exp(-f.t / e.p[1])) * f.command[0];
    }
};

// The torque constant changes as the rotor turns.
struct TorqueRipple {
    static constexpr mk_effect_info info = {
        "torque-ripple",
        "gain 1 + a sin(n q1 + phi)",
        "motor with few commutator bars",
        MK_EFFECT_JOINT_NONE,
        MK_STAGE_COMMAND,
        ALL_PLANTS,
        0,
        0,
        3,
        {{"ratio", "", "amplitude a", 0.0, 1.0, 0.05},
         {"cycles", "1/rev", "periods per revolution n (integer)", 1.0, 1000.0, 1.0,
          MK_FIT_INTEGER},
         {"phase", "rad", "phase phi", -INF, INF, 0.0, MK_FIT_ANGLE}},
        true};
    static constexpr mk_effect_words words = {
        "a gain that varies with the angle", "Commutation of the motor.",
        "Measure the current against the angle at a constant command."};
    template <class S>
    static void command(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.command[0] += e.p[0] * sin(e.p[1] * f.m.q[0] + e.p[2]) * f.command[0];
    }
};

// Current follows the command with a first-order lag; the states are what the motors get. A rig
// with two motors has the same drive at both joints; one with a single motor has 0 as the other
// state.
struct ActuatorLag {
    static constexpr mk_effect_info info = {"actuator-lag",
                                            "du_motor/dt = (u - u_motor) / T",
                                            "current loop of an amplifier",
                                            MK_EFFECT_JOINT_NONE,
                                            MK_STAGE_COMMAND | MK_STAGE_STATE,
                                            ALL_PLANTS,
                                            MK_MAX_INPUTS,
                                            0,
                                            1,
                                            {{"time-constant", "s", "T", 1e-5, 10.0, 0.01}}};
    static constexpr mk_effect_words words = {
        "a motor that follows its command with a lag",
        "The motor's inductance, or a filter in the amplifier.",
        "Look at the amplifier's bandwidth; let the controller take the lag into account."};
    template <class S>
    static void command(Frame<S> &f, const EffectArgs<S> &e)
    {
        for (int i = 0; i < MK_MAX_INPUTS; i++) {
            f.lag_input[i] = f.command[i];
            f.command[i] = e.z[i];
        }
    }
    template <class S>
    static void derivative(Frame<S> &f, const EffectArgs<S> &e, S *dz)
    {
        for (int i = 0; i < MK_MAX_INPUTS; i++)
            dz[i] = (f.lag_input[i] - e.z[i]) / e.p[0];
    }
    template <class S>
    static void init(Frame<S> &, const EffectArgs<S> &, S *z)
    {
        for (int i = 0; i < MK_MAX_INPUTS; i++)
            z[i] = S(0.0);
    }
    template <class S>
    static double rate(const Frame<S> &, const EffectArgs<S> &e)
    {
        return 1.0 / value_of(e.p[0]);
    }
};

// The amplifier's own limit, lower than the command's.
struct Saturation {
    static constexpr mk_effect_info info = {"saturation",
                                            "|u| <= limit",
                                            "current limit",
                                            MK_EFFECT_JOINT_NONE,
                                            MK_STAGE_COMMAND,
                                            ALL_PLANTS,
                                            0,
                                            0,
                                            1,
                                            {{"limit", "N m", "limit", 0.0, INF, 8.0}}};
    static constexpr mk_effect_words words = {"a torque that is cut off",
                                              "A current limit of the amplifier.",
                                              "Raise the limit, or tell the controller: u_max."};
    template <class S>
    static void command(Frame<S> &f, const EffectArgs<S> &e)
    {
        f.command[0] = clamp(f.command[0], S(-e.p[0]), e.p[0]);
    }
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
