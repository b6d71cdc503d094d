// Causes that say more than the data do, or other things than their names.
#include <algorithm>
#include <cstring>

#include "explain/policy.hpp"
#include "explain/search/causes.hpp"

namespace mk
{

// Whether the data leave a parameter of the law open beside its size.
bool CauseSearch::has_open_shape(size_t cause) const
{
    const int at = model.effect_count + (int)cause;
    const mk_effect_info &info = *mk_effect(best.point.model.effect[at].index);
    for (int k = 0; k < info.parameter_count; k++)
        if (k != rounds[cause].ranked[0].added.size && info.parameter[k].fit == MK_FIT_FREE &&
            Search::relative_error(best, at, k) >= policy::OPEN_SIZE)
            return true;
    return false;
}

// A law with a parameter that the data leave open, now that all other causes are there, says what a
// simpler one of the same joint says: a Stribeck friction whose speed is beyond all others is a
// Coulomb friction.
void CauseSearch::simplify()
{
    for (size_t i = 0; i < rounds.size() && !search.cancelled; i++) {
        if (mk_model_hides_joint(&best.point.model) || !has_open_shape(i))
            continue;
        const Candidate law = rounds[i].ranked[0].added;
        for (const Candidate &start : search.candidates_of(removed(i)))
            if (Hypothesis h; is_simpler(start, law) && !has_cause(start) &&
                              fit_simpler(i, start, h) && h.penalised_nlml <= best.penalised_nlml)
                say_simpler(i, std::move(h));
    }
}

// Fewer parameters and no more states at the same joint; a term of the library names nothing, and
// backlash is no simpler law of anything.
bool CauseSearch::is_simpler(const Candidate &a, const Candidate &b)
{
    return a.joint == b.joint && !is_library(a.effect) && !is_backlash(a.effect) &&
           a.effect->state_count <= b.effect->state_count &&
           a.effect->parameter_count < b.effect->parameter_count;
}

// What a cause is simplified to, `start` in its place, from where `best` is. A size in the same
// unit starts as large.
bool CauseSearch::fit_simpler(size_t cause, const Candidate &start, Hypothesis &simpler)
{
    const Candidate &law = rounds[cause].ranked[0].added;
    mk_model m = best.point.model, with;
    mk_effect_use &use = m.effect[model.effect_count + (int)cause];
    Candidate as_large = start;
    if (std::strcmp(start.effect->parameter[start.size].unit,
                    law.effect->parameter[law.size].unit) == 0)
        as_large.value[start.size] = use.value[law.size];
    if (!with_candidate(removed(cause), as_large, with))
        return false;
    use = with.effect[with.effect_count - 1];
    const bool fitted = search.refit_at(m, best, best.process_noise, simpler);
    simpler.added = start;
    return fitted;
}

// A simpler law takes a cause's place.
void CauseSearch::say_simpler(size_t cause, Hypothesis simpler)
{
    rounds[cause].ranked = led_by(simpler.added, std::move(rounds[cause].ranked));
    best = std::move(simpler);
    forget_lacks();
}

// Whether a cause is not what its name says: Search::plausible.
bool CauseSearch::is_bent(size_t cause) const
{
    const Candidate &law = rounds[cause].ranked[0].added;
    mk_model m = removed(cause);
    const std::vector<Candidate> starts = search.candidates_of(m);
    m.effect[m.effect_count++] = best.point.model.effect[model.effect_count + (int)cause];
    return !is_library(law.effect) && !Search::plausible(m, law, starts);
}

size_t CauseSearch::bent_count() const
{
    size_t count = 0;
    for (size_t i = 0; i < rounds.size(); i++)
        count += is_bent(i);
    return count;
}

// The likeliest of the simpler laws in a cause's place; false: there is none.
bool CauseSearch::likeliest_simpler(size_t cause, Hypothesis &likeliest)
{
    bool any = false;
    const Candidate law = rounds[cause].ranked[0].added;
    for (const Candidate &start : search.candidates_of(removed(cause))) {
        Hypothesis h;
        if (!is_simpler(start, law) || has_cause(start) || !fit_simpler(cause, start, h) ||
            Search::discredited(h) || (any && h.penalised_nlml >= likeliest.penalised_nlml))
            continue;
        likeliest = std::move(h);
        any = true;
    }
    return any;
}

// A law that has bent into another one, as a Stribeck friction that falls by a hundredth over all
// speeds there are, stands for a simpler law and something that is missing. The simpler one takes
// its place, and causes are added beside it. With L the penalised nlml, as before if
//     L(simpler) - L(bent) > max(policy::BETTER_THAN_CATALOGUE,
//                                policy::BETTER_THAN_CATALOGUE_FAR (L(without) - L(bent))) ,
// or if as many laws are not what they are called.
void CauseSearch::unbend()
{
    for (size_t i = 0; i < rounds.size() && !search.cancelled; i++) {
        Hypothesis simpler;
        if (mk_model_hides_joint(&best.point.model) || !is_bent(i) ||
            !likeliest_simpler(i, simpler))
            continue;
        const double gain = without(i).penalised_nlml - best.penalised_nlml;
        const double enough =
            std::max(policy::BETTER_THAN_CATALOGUE, policy::BETTER_THAN_CATALOGUE_FAR * gain);
        const std::vector<Round> kept = rounds;
        const Hypothesis kept_best = best, kept_before = before;
        const size_t bent = bent_count();
        say_simpler(i, std::move(simpler));
        add_causes(policy::MOST_FURTHER_CAUSES);
        drop_idle();
        if (best.penalised_nlml <= kept_best.penalised_nlml + enough && bent_count() < bent)
            continue;
        rounds = kept;
        best = kept_best;
        before = kept_before;
    }
}

} // namespace mk
