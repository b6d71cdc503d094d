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
    template <class S>
    static void measure(Frame<S> &, const EffectArgs<S> &e, S *y)
    {
        y[e.j] += e.p[0];
    }
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
