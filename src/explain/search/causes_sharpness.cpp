// Causes that stand in for dry friction whose sign is sharper than the model has it
// (explain/search/sharpness.hpp).
#include <algorithm>
#include <cmath>
#include <cstring>

#include "explain/policy.hpp"
#include "explain/search/causes.hpp"
#include "explain/search/sharpness.hpp"

namespace mk
{

// `h` with a k that gains policy::ACCEPT_FURTHER; false where none does. `best` is not asked twice.
bool CauseSearch::gains_by_sharpness(Hypothesis &h)
{
    if (h.penalised_nlml == sharp_enough)
        return false;
    const double asked = h.penalised_nlml;
    if (sharpness::adapt(search, model.friction_sharpness, policy::ACCEPT_FURTHER, h))
        return true;
    sharp_enough = asked;
    return false;
}

// k is a value of the model like others: a new cause shows it better. Of a model that is far from
// its data it says nothing.
void CauseSearch::adapt_sharpness()
{
    if (best.process_noise > policy::FAR_FROM_DATA || !gains_by_sharpness(best))
        return;
    search.polish(best, true);
    lead_latest();
}

// The latest round is led by what is `best` now.
void CauseSearch::lead_latest()
{
    if (rounds.empty())
        return;
    std::vector<Hypothesis> &ranked = rounds.back().ranked;
    const Candidate latest = ranked[0].added;
    ranked = led_by(latest, std::move(ranked));
}

// Rivals that were fitted with another k are no rivals: once more, with that of `best`.
void CauseSearch::face_rivals_with_sharpness()
{
    const double k = best.point.model.friction_sharpness;
    const auto with_another = [&](const Hypothesis &h) {
        return h.point.model.friction_sharpness != k;
    };
    if (std::any_of(rounds.begin(), rounds.end(), [&](const Round &r) {
            return std::any_of(r.ranked.begin() + 1, r.ranked.end(), with_another);
        }))
        face_rivals_of(rounds.size());
}

// A model that comes from free runs, which hardly see how friction changes its sign, follows the
// data with the k of which it does so best.
bool CauseSearch::follow_with_sharpness(const mk_model &with, Hypothesis &out)
{
    if (!search.follow(with, nullptr, policy::SAYS_NOTHING, out))
        return false;
    Hypothesis next;
    for (double times = 2.0; times <= sharpness::MOST && sharpness::has_dry_friction(with);
         times *= 2.0) {
        if (!search.follow(sharpness::with_sharpness(with, times), nullptr, policy::SAYS_NOTHING,
                           next) ||
            next.quadratic.nlml > out.quadratic.nlml - policy::ACCEPT_FURTHER)
            break;
        out = std::move(next);
    }
    return true;
}

// `best` without a cause and with the larger k that stands in for it best: at a process noise at
// which even a k that is far off follows the data, and then at its own. False where at the former
// none comes near the cause,
//     nlml(with k) - nlml(best) > policy::SHARPNESS_COMES_NEAR a reading .
bool CauseSearch::fit_sharper_without(size_t cause, Hypothesis &sharper)
{
    constexpr double LOOSER = 10.0;
    constexpr int ROUNDS = 4;
    const double loose = LOOSER * best.process_noise;
    const mk_model less = removed(cause);
    Hypothesis with_cause, h;
    if (!search.refit_at(best.point.model, best, loose, with_cause))
        return false;
    const double most =
        with_cause.quadratic.nlml + policy::SHARPNESS_COMES_NEAR * search.readings();
    // N ln r in nlml is N/2 (r^2 - 1) in cost, before the readings' noise follows; more than once
    // that, since a k that is a factor of two off comes near as well.
    constexpr double ROOM = 4.0;
    const double worth =
        with_cause.point.cost +
        ROOM * 0.5 * std::expm1(2.0 * policy::SHARPNESS_COMES_NEAR) * search.readings();
    // nlml falls towards the best k and rises beyond it; one that is far off may be out of reach.
    double last = HUGE_VAL;
    for (double times = 2.0; times <= sharpness::MOST && !search.cancelled; times *= 2.0) {
        const bool fitted =
            search.refit_at(sharpness::with_sharpness(less, times), best, loose, h, worth);
        if (!fitted && last == HUGE_VAL)
            continue;
        if (!fitted || h.quadratic.nlml > last)
            break;
        last = h.quadratic.nlml;
        sharper = std::move(h);
    }
    if (!(last < most))
        return false;
    // The lower the process noise, the better is k known.
    search.polish(sharper, true);
    for (int round = 0; round < ROUNDS && !search.cancelled; round++) {
        const double nlml = sharper.quadratic.nlml;
        sharpness::come_nearer(search, sharper,
                               round == 0 ? sharpness::ROUGHLY : sharpness::FINELY);
        search.polish(sharper, true);
        if (sharper.quadratic.nlml > nlml - 1.0)
            break;
    }
    return true;
}

// `best` with a larger k: as it is, or without one of the laws of the same friction, number `law`
// (the number of causes: none), whichever is likelier. False where no k gains.
bool CauseSearch::sharper_without_law(Hypothesis &sharper, size_t &law)
{
    const int motor = mk_plant(model.plant)->motor_joint + 1;
    law = rounds.size();
    sharper = best;
    bool found = gains_by_sharpness(sharper);
    double least = found ? sharper.penalised_nlml : best.penalised_nlml + policy::NO_DOUBT;
    for (size_t i = 0; i < rounds.size() && !search.cancelled; i++) {
        const Candidate &cause = rounds[i].ranked[0].added;
        Hypothesis without;
        if (cause.joint != motor || !is_friction(cause.effect, cause.value) ||
            !fit_sharper_without(i, without) || without.penalised_nlml >= least)
            continue;
        least = without.penalised_nlml;
        sharper = std::move(without);
        law = i;
        found = true;
    }
    return found;
}

// Laws that differ only in slow motion could not be told apart before. In the place of each cause
// at the motor's joint the others at that joint whose size has its unit are fitted, as large, with
// either sign. True where one that is likelier took a place.
bool CauseSearch::exchange_laws()
{
    bool changed = false;
    for (size_t i = 0; i < rounds.size() && !search.cancelled; i++) {
        const Candidate law = rounds[i].ranked[0].added;
        if (law.joint != mk_plant(model.plant)->motor_joint + 1)
            continue;
        const char *unit = law.effect->parameter[law.size].unit;
        for (const Candidate &other : search.candidates_of(removed(i)))
            if (other.joint == law.joint && other.linear && !is_library(other.effect) &&
                other.effect->state_count == 0 && !has_cause(other) &&
                std::strcmp(other.effect->parameter[other.size].unit, unit) == 0)
                changed = take_place(i, other) || changed;
    }
    return changed;
}

// The law in the place of a cause, if it is likelier there.
bool CauseSearch::take_place(size_t cause, const Candidate &law)
{
    mk_model m = best.point.model, with;
    mk_effect_use &use = m.effect[model.effect_count + (int)cause];
    const double size = use.value[rounds[cause].ranked[0].added.size];
    bool taken = false;
    for (const double sign : {1.0, -1.0}) {
        Candidate as_large = law;
        Hypothesis h;
        as_large.value[law.size] = sign * size;
        if (!with_candidate(removed(cause), as_large, with))
            continue;
        use = with.effect[with.effect_count - 1];
        if (!search.refit_at(m, best, best.process_noise, h) || Search::discredited(h) ||
            h.penalised_nlml > best.penalised_nlml - 1.0)
            continue;
        h.added = law;
        best = std::move(h);
        rounds[cause].ranked = led_by(law, std::move(rounds[cause].ranked));
        forget_lacks();
        taken = true;
    }
    return taken;
}

// Causes without which the fit does as well once k has followed.
void CauseSearch::drop_idle_beside_sharpness(double step)
{
    for (size_t i = 0; i < rounds.size() && rounds.size() > 1 && !search.cancelled; i++) {
        Hypothesis without;
        if (!fit_without(i, without))
            continue;
        sharpness::come_nearer(search, without, step);
        if (without.penalised_nlml > best.penalised_nlml + policy::ACCEPT_FIRST)
            continue;
        search.polish(without, true);
        shed(i, std::move(without));
        i--;
    }
}

// What stands in for a sharper sign of dry friction gives way to it. Then k, which was followed
// roughly while causes were added, is refined beside them, and `refit` gets it as well: what it
// explains is no cause's share.
void CauseSearch::sharpen_friction()
{
    find_sharpness();
    if (best.point.model.friction_sharpness != refit.point.model.friction_sharpness) {
        sharpness::come_nearer(search, best, sharpness::FINELY);
        search.polish(best, true);
        refit_with_sharpness();
    }
    lead_latest();
    face_rivals_with_sharpness();
}

// `refit` with the k of `best`. False where it cannot be fitted; then it stays.
bool CauseSearch::refit_with_sharpness()
{
    mk_model with_k = refit.point.model;
    with_k.friction_sharpness = best.point.model.friction_sharpness;
    Hypothesis again;
    if (!search.refit(with_k, &refit, again))
        return false;
    refit = std::move(again);
    return true;
}

// Where a larger k gains beside the causes, or in the place of a law of friction among them, the
// other laws are asked with it, and k is refined beside those. What that leads to is taken where
//     L(with k) < L(without) - policy::ACCEPT_FURTHER ,
// or L(without) with fewer causes, and brings the model near its data; then `refit` has that k as
// well.
void CauseSearch::find_sharpness()
{
    constexpr int ROUNDS = 2;
    if (rounds.empty() || best.process_noise >= policy::SAYS_NOTHING ||
        mk_model_hides_joint(&best.point.model))
        return;
    Hypothesis sharper;
    size_t law;
    if (!sharper_without_law(sharper, law))
        return;
    const std::vector<Round> kept = rounds;
    const Hypothesis kept_best = best, kept_refit = refit;
    best = std::move(sharper);
    if (law < rounds.size())
        rounds.erase(rounds.begin() + (std::ptrdiff_t)law);
    forget_lacks();
    for (int i = 0; i < ROUNDS && refit_with_sharpness(); i++) {
        const bool changed = exchange_laws();
        sharpness::come_nearer(search, best, sharpness::FINELY);
        search.polish(best, true);
        if (!changed)
            break;
    }
    drop_idle_beside_sharpness(sharpness::FINELY);
    exchange_laws();
    const double gain = kept_best.penalised_nlml - best.penalised_nlml - search.penalty(1);
    if (!likelihood_counts(best) ||
        gain < (rounds.size() < kept.size() ? 0.0 : policy::ACCEPT_FURTHER) ||
        !refit_with_sharpness()) {
        rounds = kept;
        best = kept_best;
        refit = kept_refit;
        return;
    }
    // A single cause that stood in for nothing but that.
    if (rounds.size() == 1 && refit.penalised_nlml < best.penalised_nlml + policy::ACCEPT_FIRST) {
        best = refit;
        rounds.clear();
    }
}

} // namespace mk
