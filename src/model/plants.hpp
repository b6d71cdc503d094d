// The list of plants. plant.hpp says what each file of the list states.
#ifndef MECHKIT_MODEL_PLANTS_HPP
#define MECHKIT_MODEL_PLANTS_HPP

#include "model/plant_acrobot.hpp"
#include "model/plant_cart_pole.hpp"
#include "model/plant_furuta.hpp"
#include "model/plant_inertia_wheel.hpp"
#include "model/plant_pendubot.hpp"
#include "model/plant_pendulum.hpp"
#include "model/plant_reaction_wheel.hpp"

// In the order of enum mk_plant_kind.
#define MK_PLANT_TABLE(X)                                                                          \
    X(InertiaWheel)                                                                                \
    X(Pendulum)                                                                                    \
    X(Pendubot)                                                                                    \
    X(ReactionWheel)                                                                               \
    X(Furuta)                                                                                      \
    X(CartPole)                                                                                    \
    X(Acrobot)

namespace mk
{
inline namespace MK_KERNEL_NS
{

// Calls f with the plant of `kind`, e.g. with_plant(kind, [&](auto law) { law.law(m, g, sink); }).
template <class F>
inline auto with_plant(enum mk_plant_kind kind, F &&f)
{
    switch (kind) {
#define MK_PLANT_CASE(P)                                                                           \
    case P::info.kind:                                                                             \
        return f(P{});
        MK_PLANT_TABLE(MK_PLANT_CASE)
#undef MK_PLANT_CASE
    case MK_PLANT_COUNT:
        break;
    }
    return f(Pendubot{});
}

// Whether a list of a row has this name.
constexpr bool plant_lists(const char *const (&list)[MK_MAX_PLANT_NAMES], const char *name)
{
    for (const char *entry : list) {
        const char *a = entry ? entry : "", *b = name;
        while (*a && *a == *b)
            a++, b++;
        if (entry && *a == *b)
            return true;
    }
    return false;
}

// The plants that an effect makes sense on, and those that allow a measurement: bits 1u << kind.
constexpr unsigned plants_suited_to(const char *effect)
{
    unsigned plants = 0;
#define MK_PLANT_SUITS(P) plants |= plant_lists(P::info.unsuited, effect) ? 0u : 1u << P::info.kind;
    MK_PLANT_TABLE(MK_PLANT_SUITS)
#undef MK_PLANT_SUITS
    return plants;
}
// Those on which a parameter of an effect does something; 0: all.
constexpr unsigned plants_that_own(const char *parameter)
{
    unsigned plants = 0;
#define MK_PLANT_OWNS(P) plants |= plant_lists(P::info.own, parameter) ? 1u << P::info.kind : 0u;
    MK_PLANT_TABLE(MK_PLANT_OWNS)
#undef MK_PLANT_OWNS
    return plants;
}
constexpr unsigned plants_measured_by(const char *measurement)
{
    unsigned plants = 0;
#define MK_PLANT_MEASURED(P)                                                                       \
    plants |= plant_lists(P::info.measures, measurement) ? 1u << P::info.kind : 0u;
    MK_PLANT_TABLE(MK_PLANT_MEASURED)
#undef MK_PLANT_MEASURED
    return plants;
}

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
