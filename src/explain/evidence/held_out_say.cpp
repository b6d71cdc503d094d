// What held-out data say of causes while they can still be exchanged
// (explain/evidence/held_out_say.hpp).
#include "explain/evidence/held_out_say.hpp"

#include <utility>

#include "explain/policy.hpp"

namespace mk
{

// With L the penalised nlml, rival i may lead if
//     L_i <= L_0 + policy::INSEPARABLE ,
// it has a name and as many effects, and its errors on held-out data are clearly less than
// those of the best so far. Of a single cause only: of several the others would have to be
// fitted anew.
void let_held_out_choose(CauseSearch &causes, const HeldOut &held)
{
    if (causes.rounds.size() != 1)
        return;
    std::vector<Hypothesis> &ranked = causes.rounds[0].ranked;
    HeldOutFigures best;
    if (is_library(ranked[0].added.effect) ||
        held.figures(ranked[0].point.model, best, nullptr) != MK_OK)
        return;
    size_t chosen = 0;
    for (size_t i = 1; i < ranked.size(); i++) {
        HeldOutFigures other;
        // A ranking may be from when there was another cause beside.
        if (is_library(ranked[i].added.effect) ||
            ranked[i].point.model.effect_count != ranked[0].point.model.effect_count ||
            ranked[i].penalised_nlml > ranked[0].penalised_nlml + policy::INSEPARABLE ||
            held.figures(ranked[i].point.model, other, nullptr) != MK_OK ||
            !clearly_worse(best, other))
            continue;
        best = other;
        chosen = i;
    }
    if (chosen > 0)
        causes.let_lead(chosen);
}

// All may stay where the model with them predicts held-out data no worse than the refitted one,
// in the sum of squares and by windows. Else the cause goes without which that sum is least, if
// it is below that of the refitted model. False where all may stay, or none is better left out.
static bool reject_one(CauseSearch &causes, const HeldOut &held, const HeldOutFigures &refitted)
{
    HeldOutFigures all, least = refitted;
    const bool runs = held.figures(causes.best.point.model, all, nullptr) == MK_OK;
    if (runs && all.total() <= refitted.total() && !clearly_worse(all, refitted))
        return false;
    Hypothesis better;
    size_t at = causes.rounds.size();
    for (size_t i = 0; i < causes.rounds.size(); i++) {
        Hypothesis less;
        HeldOutFigures left;
        if (!causes.fit_without(i, less) ||
            held.figures(less.point.model, left, nullptr) != MK_OK ||
            left.total() >= least.total() || clearly_worse(left, refitted))
            continue;
        least = left;
        better = std::move(less);
        at = i;
    }
    if (at == causes.rounds.size())
        return false;
    causes.shed(at, std::move(better));
    return true;
}

void reject_misleading(CauseSearch &causes, const HeldOut &held)
{
    HeldOutFigures refitted;
    if (causes.explained() || held.figures(causes.refit.point.model, refitted, nullptr) != MK_OK)
        return;
    while (causes.rounds.size() > 1 && reject_one(causes, held, refitted))
        continue;
}

} // namespace mk
