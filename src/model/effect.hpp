// The effect framework: what an effect may touch, and the table that makes effects callable over
// any scalar. An effect is a struct in a file of its family (effects_*.hpp) with
//     static constexpr mk_effect_info info          its row: name, law, parameters, stages
// and, for each stage flag set in info.stages, the template function of that stage:
//     FRAME        frame(f, e)         moves or tilts the base, says what the motor's shaft does
//     COMMAND      command(f, e)       changes f.command[0] (limited already), or f.motor_gain
//     TORQUE       torque(f, e)        adds to f.tau[j], the right-hand side of joint j's equation
//     INERTIA      inertia(f, e)       adds to the mass matrix
//     STATE        derivative(f, e, dz), init(f, e, z)
//     EVENT        events(f, e, g)     surfaces where the law switches
//     MEASUREMENT  measure(f, e, y)    changes readings
// and, if it makes the model stiffer, rate(f, e): how fast its fastest motion is, 1/s.
// Delays have a stage flag and a parameter; the simulation applies them. docs/adding.md shows how
// to add one.
#ifndef MECHKIT_MODEL_EFFECT_HPP
#define MECHKIT_MODEL_EFFECT_HPP

#include "mechkit/model.h"
#include <type_traits>

#include "model/plants.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

// A model with its numbers as scalars S and its effects resolved.
template <class S>
struct Compiled {
    enum mk_plant_kind plant;
    bool parallel; // the joints' axes: row joints_parallel of the plant
    int joints, motor, parameter_count, mass_count, state_count, event_count, effect_count;
    double g, u_max;
    double sharpness[MK_MAX_JOINTS]; // k of S_k(v) for laws that have none of their own
    S p[MK_MAX_PARAMETERS];
    struct Effect {
        int index, joint; // joint 0-based, -1: none
        int state, event; // offsets
        S p[MK_MAX_EFFECT_PARAMETERS];
    } effect[MK_MAX_EFFECTS];
    int acting[MK_MAX_EFFECTS]; // places in `effect` in the order in which they act
    const Effect &at(int i) const { return effect[acting[i]]; }
};

// One evaluation, as it passes through the stages.
template <class S>
struct Frame {
    const Compiled<S> *c;
    S t;
    Motion<S> m;
    S command[MK_MAX_INPUTS]; // in force at the rig, after delay
    S motor_speed;            // of the motor's shaft: the motor joint's, unless there is backlash
    S coulomb_scale;          // factor on the plant's own Coulomb friction
    S motor_torque;           // command minus friction of the motor joint
    bool motor_detached;      // an effect passes the motor's torque on by itself
    S tau[2];                 // right-hand sides
    S m11, m12, m22;          // mass matrix
    S lag_input[2];           // commands before the actuators' lag
    S a[2];                   // accelerations, known from the derivative stage on
    S base_acceleration;      // of a rocking base, about joint 1's axis
    bool base_moves;          // it is not 0: accelerate_base() was called

    void accelerate_base(const S &by)
    {
        base_acceleration += by;
        base_moves = true;
    }
};

template <class S>
struct EffectArgs {
    int j;      // joint, 0-based
    const S *p; // parameters
    const S *z; // states
};

template <class S>
struct EffectOps {
    void (*frame)(Frame<S> &, const EffectArgs<S> &);
    void (*command)(Frame<S> &, const EffectArgs<S> &);
    void (*torque)(Frame<S> &, const EffectArgs<S> &);
    void (*inertia)(Frame<S> &, const EffectArgs<S> &);
    void (*derivative)(Frame<S> &, const EffectArgs<S> &, S *dz);
    void (*init)(Frame<S> &, const EffectArgs<S> &, S *z);
    void (*events)(Frame<S> &, const EffectArgs<S> &, S *g);
    void (*measure)(Frame<S> &, const EffectArgs<S> &, S *y);
    double (*rate)(const Frame<S> &, const EffectArgs<S> &);
};

template <class E, class S, class = void>
struct HasRate : std::false_type {
};
template <class E, class S>
struct HasRate<E, S, std::void_t<decltype(&E::template rate<S>)>> : std::true_type {
};

template <class E, class S>
constexpr EffectOps<S> effect_ops_of()
{
    EffectOps<S> ops = {};
    if constexpr ((E::info.stages & MK_STAGE_FRAME) != 0)
        ops.frame = &E::template frame<S>;
    if constexpr ((E::info.stages & MK_STAGE_COMMAND) != 0)
        ops.command = &E::template command<S>;
    if constexpr ((E::info.stages & MK_STAGE_TORQUE) != 0)
        ops.torque = &E::template torque<S>;
    if constexpr ((E::info.stages & MK_STAGE_INERTIA) != 0)
        ops.inertia = &E::template inertia<S>;
    if constexpr ((E::info.stages & MK_STAGE_STATE) != 0) {
        ops.derivative = &E::template derivative<S>;
        ops.init = &E::template init<S>;
    }
    if constexpr ((E::info.stages & MK_STAGE_EVENT) != 0)
        ops.events = &E::template events<S>;
    if constexpr ((E::info.stages & MK_STAGE_MEASUREMENT) != 0)
        ops.measure = &E::template measure<S>;
    if constexpr (HasRate<E, S>::value)
        ops.rate = &E::template rate<S>;
    return ops;
}

// Short-hands for the rows. A plant that an effect makes no sense on says so in its own row.
constexpr unsigned ALL_PLANTS = (1u << MK_PLANT_COUNT) - 1u;
constexpr double INF = MK_PARAMETER_MOST;
// The sharpness of a friction law's sign. A model gives it the joint's own when the effect is
// added.
constexpr mk_parameter_info SHARPNESS = {"sharpness",  "s/rad", "k of S_k(v) = tanh(k v)",
                                         1e-3,         INF,     MK_FRICTION_SHARPNESS_TURNING,
                                         MK_FIT_FIXED, true};

// The least inertia that a torque at joint j meets, over all positions (for rates).
template <class S>
inline double least_inertia(const Frame<S> &f, int j)
{
    double p[MK_MAX_PARAMETERS];
    for (int i = 0; i < f.c->parameter_count; i++)
        p[i] = value_of(f.c->p[i]);
    return with_plant(f.c->plant, [&](auto plant) { return plant.least_inertia(p, j); });
}

constexpr double TWO_PI = 6.283185307179586476925286766559;

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
