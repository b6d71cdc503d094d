// Between the true angles and the readings.
#ifndef MECHKIT_MODEL_EFFECTS_SENSOR_HPP
#define MECHKIT_MODEL_EFFECTS_SENSOR_HPP

#include "model/effect.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

// The rig did not hang straight down when the counters were zeroed.
struct EncoderOffset {
    static constexpr mk_effect_info info = {
        "encoder-offset",
        "q_meas = q + offset",
        "zeroing error",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_MEASUREMENT,
        ALL_PLANTS,
        0,
        0,
        1,
        {{"offset", "rad", "offset of the reading", -INF, INF, 0.0}}};
    static constexpr mk_effect_words words = {
        "a zero that is off", "The counters were zeroed where friction left the joint hanging.",
        "Zero against a stop, or swing the joint through before it is zeroed."};
    template <class S>
    static void measure(Frame<S> &, const EffectArgs<S> &e, S *y)
    {
        y[e.j] += e.p[0];
    }
};

// Wrong counts per revolution.
struct EncoderScale {
    static constexpr mk_effect_info info = {"encoder-scale",
                                            "q_meas = (1 + a) q",
                                            "disc with another count",
                                            MK_EFFECT_JOINT_ANY,
                                            MK_STAGE_MEASUREMENT,
                                            ALL_PLANTS,
                                            0,
                                            0,
                                            1,
                                            {{"ratio", "", "a", -0.5, 0.5, 0.01}}};
    static constexpr mk_effect_words words = {
        "an encoder whose counts per turn are off",
        "A wrong number of counts, or a slipping coupling.",
        "Turn the joint by one whole turn and read the counts; correct encoder_cpr."};
    template <class S>
    static void measure(Frame<S> &, const EffectArgs<S> &e, S *y)
    {
        y[e.j] += e.p[0] * y[e.j];
    }
};

// The disc is not centred on its shaft.
struct EncoderEccentricity {
    static constexpr mk_effect_info info = {
        "encoder-eccentricity",
        "q_meas = q + A sin(q + phi)",
        "eccentric code disc",
        MK_EFFECT_JOINT_ANY,
        MK_STAGE_MEASUREMENT,
        ALL_PLANTS,
        0,
        0,
        2,
        {{"amplitude", "rad", "A", 0.0, 0.5, 0.01},
         {"phase", "rad", "phi", -INF, INF, 0.0, MK_FIT_ANGLE}}};
    static constexpr mk_effect_words words = {"an encoder that sits off its axis",
                                              "The disc's centre is not on the shaft's.",
                                              "Mount the disc anew, or keep it in the model."};
    template <class S>
    static void measure(Frame<S> &f, const EffectArgs<S> &e, S *y)
    {
        y[e.j] += e.p[0] * sin(f.m.q[e.j] + e.p[1]);
    }
};

// The reading is old; the simulation looks it up in the past.
struct SensorDelay {
    static constexpr mk_effect_info info = {
        "sensor-delay",
        "q_meas(t) = q(t - delay)",
        "latched counters, bus",
        MK_EFFECT_JOINT_OPTIONAL,
        MK_STAGE_SENSOR_DELAY,
        ALL_PLANTS,
        0,
        0,
        1,
        {{"delay", "s", "age of the reading", 0.0, 1.0, 0.005}}};
    static constexpr mk_effect_words words = {
        "readings that are old", "Filters or transmission between the encoder and the log.",
        "Time-stamp at the source; let the observer take the age into account."};
};

// Lost pulses: the reading slips by a step now and then, at instants nobody can predict. The
// virtual rig slips; a prediction does not.
struct MissedCounts {
    static constexpr mk_effect_info info = {"missed-counts",
                                            "the reading slips by step at some instants",
                                            "encoder pulses lost to noise",
                                            MK_EFFECT_JOINT_ANY,
                                            0,
                                            ALL_PLANTS,
                                            0,
                                            0,
                                            2,
                                            {{"step", "rad", "size of a slip", -INF, INF, 0.01},
                                             {"rate", "1/s", "slips per second", 0.0, INF, 0.3}}};
    static constexpr mk_effect_words words = {
        "missed counts",
        "An encoder that turns faster than its electronics count, a loose plug, noise on its "
        "lines.",
        "Look at plugs and shields; count up to an index mark."};
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
