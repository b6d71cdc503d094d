#include "explain/causes.hpp"

#include <algorithm>

namespace mk
{

namespace
{

constexpr size_t MOST = 3;            // causes looked for
constexpr double CATALOGUE = 10.0;    // by how much a library term must beat the catalogue
constexpr double IMMATERIAL = 2.0e-3; // drift that does not matter within a second of free run
constexpr double ROUGH = 2.0e-2;      // drift that contact may leave,
constexpr double SMALL_PART = 0.02;   // at most this share of the refitted model's

// The first of a field, catalogue before library unless the library is clearly better.
size_t pick(const std::vector<Hypothesis> &field)
{
    for (size_t i = 0; i < field.size(); i++)
        if (!is_library(field[i].added.effect))
            return field[i].score < field[0].score + CATALOGUE ? i : 0;
    return 0;
}
} // namespace

bool CauseSearch::matters(double drift)
{
    return drift > IMMATERIAL;
}

void CauseSearch::run()
{
    search.polish(refit, true);
    best = refit;
    while (rounds.size() < MOST && !search.cancelled) {
        // Nameless terms that already follow the data will not become a name.
        bool nameless = std::any_of(rounds.begin(), rounds.end(), [](const Round &r) {
            return is_library(r.field[0].added.effect);
        });
        if (nameless && follows(best))
            return;
        // On top of a play every trial is slow, and little is left that is not the play's own.
        if (mk_model_hides_joint(&best.point.model) && !rounds.empty())
            return;
        Round round;
        double needed = rounds.empty() ? ENOUGH : AGAIN;
        round.field = search.extend(best, nullptr, !follows(best));
        // If something little is there, what is slow to fit may be it as well.
        if (follows(best) && !round.field.empty() && round.field[0].score < best.score - needed)
            round.field = search.extend(best, nullptr, true);
        most_tried = std::max(most_tried, search.tried());
        if (round.field.empty())
            return;
        size_t chosen = pick(round.field);
        // A nameless term on top of named causes that already follow the data names nothing.
        bool idle =
            !rounds.empty() && follows(best) && is_library(round.field[chosen].added.effect);
        if (idle || round.field[chosen].score > best.score - needed)
            return;
        std::swap(round.field[0], round.field[chosen]);
        search.polish(round.field[0], true);
        const Hypothesis before = best;
        best = round.field[0];
        rounds.push_back(std::move(round));
        if (rounds.size() > 1 && idle_without_last(before))
            return;
        if (rounds.size() == 2)
            reconsider();
    }
}

// Whether the causes so far do as well without the latest one once they are given its fit to
// start from: then it is dropped.
bool CauseSearch::idle_without_last(const Hypothesis &before)
{
    Hypothesis without;
    if (!remove(rounds.size() - 1, without))
        return false;
    search.polish(without, true);
    if (without.score - best.score >= AGAIN)
        return false;
    best = without.score < before.score ? without : before;
    best.added = before.added;
    rounds.pop_back();
    return true;
}

// What a model that follows its data leaves does not matter within a second of free run.
// Contact leaves a little more, by the instants at which a simulation or a rig touches.
bool CauseSearch::follows(const Hypothesis &h) const
{
    bool touches = mk_model_event_count(&h.point.model) > mk_model_event_count(&model);
    double rough = mk_model_hides_joint(&h.point.model) ? 5.0 * ROUGH : ROUGH;
    double most = touches ? std::min(rough, SMALL_PART * refit.drift) : 0.0;
    return h.drift <= std::max(IMMATERIAL, most);
}

// An earlier choice was made while another cause was still missing: would something else be
// better in its place now, or nothing?
void CauseSearch::reconsider()
{
    for (size_t i = 0; i + 1 < rounds.size(); i++) {
        Hypothesis without;
        if (!remove(i, without))
            continue;
        std::vector<Candidate> others;
        for (const Round &r : rounds)
            for (const Hypothesis &h : r.field)
                others.push_back(h.added);
        std::vector<Hypothesis> field = search.extend(without, &others, true);
        if (field.empty())
            continue;
        size_t chosen = pick(field);
        std::swap(field[0], field[chosen]);
        search.polish(field[0], true);
        if (without.score < field[0].score + ENOUGH && without.score < best.score + ENOUGH) {
            best = without; // not needed any more
            rounds.erase(rounds.begin() + (std::ptrdiff_t)i);
            i--;
            continue;
        }
        bool better = field[0].score < best.score - 1e-6;
        if (better) {
            // The new one sits last in the model; rounds follow the model's order.
            best = field[0];
            rounds.erase(rounds.begin() + (std::ptrdiff_t)i);
            rounds.push_back({std::move(field)});
        } else {
            rounds[i].field = std::move(field);
        }
    }
}

bool CauseSearch::remove(size_t cause, Hypothesis &without)
{
    mk_model m = best.point.model;
    int at = model.effect_count + (int)cause;
    for (int e = at; e + 1 < m.effect_count; e++)
        m.effect[e] = m.effect[e + 1];
    m.effect_count--;
    return search.refit(m, &best, without);
}

// Rivals near the best get the same care as the best before they are compared.
void CauseSearch::polish_rivals()
{
    constexpr double NEAR = 25.0;
    for (Round &r : rounds) {
        for (size_t i = 1; i < r.field.size() && i <= 3; i++)
            if (r.field[i].score < r.field[0].score + NEAR)
                search.polish(r.field[i], false);
        std::stable_sort(
            r.field.begin() + 1, r.field.end(),
            [](const Hypothesis &a, const Hypothesis &b) { return a.score < b.score; });
    }
    if (rounds.size() == 1 && rounds[0].field.size() > 1 &&
        !is_library(rounds[0].field[1].added.effect) &&
        rounds[0].field[1].score < rounds[0].field[0].score) {
        std::swap(rounds[0].field[0], rounds[0].field[1]);
        best = rounds[0].field[0];
    }
}

} // namespace mk
