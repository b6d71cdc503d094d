#include "explain/search/sharpness.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "explain/policy.hpp"

namespace mk::sharpness
{

mk_model with_sharpness(const mk_model &model, double times)
{
    mk_model out = model;
    const double own = model.friction_sharpness;
    const int motor = mk_plant(model.plant)->motor_joint + 1;
    for (int i = 0; i < out.effect_count; i++) {
        if (out.effect[i].joint != motor)
            continue;
        const mk_effect_info &info = *mk_effect(out.effect[i].index);
        for (int k = 0; k < info.parameter_count; k++)
            if (std::strcmp(info.parameter[k].name, "sharpness") == 0 &&
                out.effect[i].value[k] == own)
                out.effect[i].value[k] *= times;
    }
    out.friction_sharpness *= times;
    return out;
}

bool has_dry_friction(const mk_model &model)
{
    return model.parameter[mk_plant(model.plant)->parameter_count - 1] > 0.0;
}

// A fit with k = times that of `from`, at its process noise.
static bool fit_with(Search &search, const Hypothesis &from, double times, Hypothesis &out)
{
    return search.refit_at(with_sharpness(from.point.model, times), from, from.process_noise, out);
}

void come_nearer(Search &search, Hypothesis &h, double last)
{
    constexpr double FIRST_STEP = 1.4;
    Hypothesis next;
    for (double step = FIRST_STEP; step > last; step = std::sqrt(step))
        for (const double times : {step, 1.0 / step})
            if (fit_with(search, h, times, next) && next.quadratic.nlml < h.quadratic.nlml) {
                h = std::move(next);
                break;
            }
}

// By factors of two, first up, as long as nlml falls; then nearer. What an error of the model cost
// goes with 1/k, so that the first factor gains half of what there is: where it gains less than
// FIRST_SHARE of what is asked for, the others are not asked.
bool adapt(Search &search, double given, double least, Hypothesis &h)
{
    constexpr double FIRST_SHARE = 0.25;
    if (!has_dry_friction(h.point.model) || mk_model_hides_joint(&h.point.model))
        return false;
    Hypothesis best = h, next;
    const auto in_range = [&](double k) {
        return k >= FEWEST * given * (1.0 - 1e-9) && k <= MOST * given * (1.0 + 1e-9);
    };
    const auto gain = [&] { return h.quadratic.nlml - best.quadratic.nlml; };
    for (const double times : {2.0, 0.5}) {
        bool goes_on = true;
        while (goes_on && in_range(best.point.model.friction_sharpness * times) &&
               fit_with(search, best, times, next) && next.quadratic.nlml < best.quadratic.nlml) {
            best = std::move(next);
            goes_on = gain() >= FIRST_SHARE * least;
        }
        if (gain() > 0.0)
            break;
    }
    if (gain() < least)
        return false;
    h = std::move(best);
    come_nearer(search, h, ROUGHLY);
    return true;
}

// Roughly at first, then finely, since k is known better at a lower process noise; at least once.
bool adapt_and_refit(Search &search, double given, Hypothesis &h)
{
    constexpr int ROUNDS = 3;
    Hypothesis nearer = h, next;
    const double a_reading = h.process_noise > policy::SAYS_NOTHING ? policy::SHARPNESS_SAYS_FAR
                                                                    : policy::SHARPNESS_SAYS;
    const double least = std::max(policy::ACCEPT_FURTHER, a_reading * search.readings());
    if (!adapt(search, given, least, nearer))
        return false;
    bool adapted = false;
    for (int round = 0; round < ROUNDS; round++) {
        if (!search.refit(nearer.point.model, &nearer, next) ||
            next.penalised_nlml >= h.penalised_nlml - 1.0)
            break;
        h = std::move(next);
        adapted = true;
        if (round > 0 && search.complete(h))
            break;
        nearer = h;
        come_nearer(search, nearer, FINELY);
    }
    return adapted;
}

} // namespace mk::sharpness
