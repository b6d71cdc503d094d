// Other forms of the cause that leads a ranking: laws that a search does not reach from its own
// starts, but from what it has found (explain/search/causes.hpp).
//
// Backlash, where nothing else explains the data, and its other widths; a shake in the equation of
// the other joint; bristles in the place of dry friction; a place that differs from log to log.
// Each is fitted from where the leader is, and leads if its L is less.
#include "explain/search/causes.hpp"

#include <algorithm>
#include <cstring>

#include "explain/policy.hpp"
#include "explain/search/log_values.hpp"
#include "model/effects_custom.hpp"

namespace mk
{

// Backlash, where nothing else explains the data. True if it is the better choice.
// All that came near stays in the ranking, behind the leader and sorted, so that it can be a rival.
bool CauseSearch::consider_backlash(std::vector<Hypothesis> &ranked, double needed)
{
    ExtendOptions how;
    how.kind = Kind::backlash;
    // Beside causes that were found, and one more, it is asked from where the fit is.
    how.afresh = rounds.empty() || ranked.empty();
    const double leader = ranked.empty() ? HUGE_VAL : ranked[0].penalised_nlml;
    how.acceptance = leader;
    std::vector<Hypothesis> backlashes = search.extend(best, how);
    // Carrying a fit on until it stands still takes long, and makes up for little.
    constexpr double FAR_BEHIND = 200.0, SHARE = 0.1; // log likelihood, of the leader's gain
    const double most = leader + std::max(FAR_BEHIND, SHARE * (best.penalised_nlml - leader));
    backlashes.erase(std::remove_if(backlashes.begin(), backlashes.end(),
                                    [&](const Hypothesis &h) { return h.penalised_nlml > most; }),
                     backlashes.end());
    const bool chosen = choose(backlashes, needed);
    if (chosen)
        consider_other_widths(backlashes[0]);
    const bool better = chosen && backlashes[0].penalised_nlml < leader;
    ranked.insert(better ? ranked.begin() : ranked.end(), backlashes.begin(), backlashes.end());
    if (!ranked.empty())
        std::stable_sort(ranked.begin() + 1, ranked.end(),
                         [](const Hypothesis &a, const Hypothesis &b) {
                             return a.penalised_nlml < b.penalised_nlml;
                         });
    return better;
}

// The likelihood of backlash's width has many optima: one for each width at which as many of the
// strokes across it are met. Where the readings are not met, others are tried from there, with what
// the starts of the same backlash hold fixed.
// Tried are all pairs of a factor on the width as found and a drag of the starts, except the one
// that is there. A better fit (by policy::ACCEPT_FIRST) is what the next pairs are fitted from, but
// widths stay multiples of the one that was found first.
void CauseSearch::consider_other_widths(Hypothesis &backlash)
{
    constexpr double FACTORS[] = {1.0, 3.0, 10.0, 1.0 / 3.0};
    if (search.meets_readings(backlash) || search.cancelled)
        return;
    const Candidate found = backlash.added;
    const mk_effect_use from = backlash.point.model.effect[backlash.point.model.effect_count - 1];
    std::vector<double> drags; // what differs between the starts of one backlash
    const int drag = mk_effect_parameter_index(found.effect, "drag");
    for (const Candidate &start : search.starts(best.point.model, found.effect->name, found.joint))
        if (std::find(drags.begin(), drags.end(), start.value[drag]) == drags.end())
            drags.push_back(start.value[drag]);
    for (double held : drags)
        for (double factor : FACTORS) {
            mk_model m = backlash.point.model;
            mk_effect_use &use = m.effect[m.effect_count - 1];
            use = from;
            use.value[found.size] *= factor;
            use.value[drag] = held;
            Hypothesis h;
            const bool same = factor == 1.0 && held == from.value[drag];
            if (same || search.cancelled ||
                !search.refit_at(m, backlash, backlash.process_noise, h) ||
                h.penalised_nlml > backlash.penalised_nlml - policy::ACCEPT_FIRST)
                continue;
            h.added = found;
            search.polish(h, true);
            if (!Search::discredited(h))
                backlash = std::move(h);
        }
}

// A shake was looked for at each joint with frequencies some way apart: once one is found, it may
// be the other equation's.
// Only a wave in time of a rig with two joints. The same wave at the other joint starts from the
// values that were found, and leads if its L is less.
void CauseSearch::consider_other_joint(std::vector<Hypothesis> &ranked)
{
    if (ranked.empty() || mk_model_joints(&model) != 2)
        return;
    const Candidate &wave = ranked[0].added;
    const int term = mk_effect_parameter_index(wave.effect, "term");
    if (std::strcmp(wave.effect->name, "custom-wave") != 0 ||
        wave.value[term] != CustomWave::IN_TIME)
        return;
    const mk_model &found = ranked[0].point.model;
    Candidate other = wave;
    std::copy_n(found.effect[found.effect_count - 1].value, other.effect->parameter_count,
                other.value);
    other.joint = 3 - other.joint;
    const std::vector<Candidate> only = {other};
    ExtendOptions how;
    how.only = &only;
    std::vector<Hypothesis> again = search.extend(best, how);
    if (again.empty())
        return;
    search.polish(again[0], true);
    if (!Search::discredited(again[0]) && again[0].penalised_nlml < ranked[0].penalised_nlml)
        ranked.insert(ranked.begin(), again[0]);
}

// Dry friction comes to its level at once; bristles that are too soft do not, and start again from
// where it is.
// Requires a ranking that is not empty. What was dry friction stays in the ranking, behind the
// bristles if they are likelier; other starts of bristles are erased from it.
void CauseSearch::consider_bristles(std::vector<Hypothesis> &ranked)
{
    const Candidate dry = ranked[0].added;
    if (std::strcmp(dry.effect->name, "coulomb") != 0 || search.complete(ranked[0]))
        return;
    Hypothesis leader = ranked[0];
    for (const Candidate &start : search.starts(best.point.model, "stiction", dry.joint)) {
        Hypothesis h;
        h.added = start;
        mk_model less = ranked[0].point.model, more;
        const double level = less.effect[less.effect_count - 1].value[dry.size];
        // Bristles at the level of dry friction that was found: all their parameters are torques
        // per something, and scale by the same ratio.
        const double ratio = level / start.value[mk_effect_parameter_index(start.effect, "level")];
        for (double &value : h.added.value)
            value *= ratio;
        less.effect_count--;
        if (!with_candidate(less, h.added, more) ||
            !search.refit_at(more, ranked[0], ranked[0].process_noise, h))
            continue;
        search.polish(h, true);
        if (!Search::discredited(h) && h.penalised_nlml < leader.penalised_nlml)
            leader = h;
    }
    if (leader.added.effect == dry.effect)
        return;
    ranked.erase(
        std::remove_if(ranked.begin(), ranked.end(),
                       [&](const Hypothesis &h) { return same_cause(h.added, leader.added); }),
        ranked.end());
    ranked.insert(ranked.begin(), leader);
}

// What is put up by hand before each log is not at the same place in all of them.
// The place gets a spread (ident/fit_own.cpp). It is kept if the likelihood asks for it and the
// places differ by more than they are uncertain (differ, log_values.cpp); the last effect is the
// latest cause.
void CauseSearch::consider_own_places(std::vector<Hypothesis> &ranked)
{
    mk_model own;
    Hypothesis h;
    if (!search.several_logs() || search.complete(ranked[0]) ||
        !with_own_place(ranked[0].point.model, own) ||
        !search.refit_at(own, ranked[0], ranked[0].process_noise, h) ||
        h.penalised_nlml > ranked[0].penalised_nlml - policy::ACCEPT_FIRST ||
        !differ(search.training(), h, search.usual_options()).back())
        return;
    h.added = ranked[0].added;
    ranked[0] = std::move(h);
}

} // namespace mk
