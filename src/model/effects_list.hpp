// The table of effects: one row each. The order is the order in which they act within a stage,
// whatever their order in a model.
#ifndef MECHKIT_MODEL_EFFECTS_LIST_HPP
#define MECHKIT_MODEL_EFFECTS_LIST_HPP

#include "model/effects_actuator.hpp"
#include "model/effects_backlash.hpp"
#include "model/effects_custom.hpp"
#include "model/effects_friction.hpp"
#include "model/effects_inertia.hpp"
#include "model/effects_mount.hpp"
#include "model/effects_position.hpp"
#include "model/effects_sensor.hpp"

#define MK_EFFECT_TABLE(X)                                                                         \
    X(BaseTilt)                                                                                    \
    X(BaseCompliance)                                                                              \
    X(Viscous)                                                                                     \
    X(Coulomb)                                                                                     \
    X(CoulombAsymmetry)                                                                            \
    X(ViscousAsymmetry)                                                                            \
    X(Stribeck)                                                                                    \
    X(QuadraticDrag)                                                                               \
    X(Stiction)                                                                                    \
    X(LoadFriction)                                                                                \
    X(FrictionDrift)                                                                               \
    X(CableStiffness)                                                                              \
    X(CableHysteresis)                                                                             \
    X(TorqueOffset)                                                                                \
    X(Cogging)                                                                                     \
    X(Imbalance)                                                                                   \
    X(EndStop)                                                                                     \
    X(ReflectedInertia)                                                                            \
    X(Backlash)                                                                                    \
    X(InputDelay)                                                                                  \
    X(ActuatorLag)                                                                                 \
    X(Deadband)                                                                                    \
    X(TorqueScale)                                                                                 \
    X(GainAsymmetry)                                                                               \
    X(GainDrift)                                                                                   \
    X(TorqueRipple)                                                                                \
    X(Saturation)                                                                                  \
    X(BackEmfLimit)                                                                                \
    X(EncoderScale)                                                                                \
    X(EncoderEccentricity)                                                                         \
    X(EncoderOffset)                                                                               \
    X(SensorDelay)                                                                                 \
    X(MissedCounts)                                                                                \
    X(Custom)                                                                                      \
    X(CustomWave)                                                                                  \
    X(CustomWell)

namespace mk
{
inline namespace MK_KERNEL_NS
{

template <class S>
inline const EffectOps<S> &effect_ops(int index)
{
#define MK_EFFECT_OPS(E) effect_ops_of<E, S>(),
    static constexpr EffectOps<S> table[] = {MK_EFFECT_TABLE(MK_EFFECT_OPS)};
#undef MK_EFFECT_OPS
    return table[index];
}

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
