// Which effects a model lacks: found one after another by likelihood, and earlier ones
// reconsidered.
//
// A greedy forward search with backward steps. With L the penalised nlml of a hypothesis
// (search.cpp; less is better), a cause is added if the best extension of the best model has
//     L(best) - L(extension) >= policy::ACCEPT_FIRST ,   policy::ACCEPT_FURTHER for all but the
//     first .
// With Gaussian noise a difference of 12 beyond the penalty is far beyond what some hundred
// candidates reach by chance (docs/explain.md, "How it decides", 4).
//
// A forward search goes wrong where one cause stands in for another that is still missing. Seven
// steps answer that:
//     idle_without_last   the model does as well without the latest cause, if it starts from the
//                         fit with it: the cause is dropped;
//     reconsider          with the later cause there, something else, or nothing, may be better in
//                         the place of an earlier one;
//     try_runners_up      a first cause that leads to no model that follows its data gives way to
//                         those that came next;
//     name_terms          in the place of a term without a name the catalogue is asked again, with
//                         what was found after it beside;
//     drop_idle           at the end, any cause without which the fit does as well goes;
//     face_rivals_of      the nearest rivals of earlier causes are asked again beside all others;
//     unbend              a law that has bent into another one gives way to that.
//
// Process noise says how much a model misses. Its thresholds are intensities in rad/s per sqrt(s):
// right models end at 1e-4, and what is below policy::IMMATERIAL does not matter within a second of
// free run.
//
// What a cause could be besides, once it leads (consider_...), is in causes_forms.cpp; simpler laws
// in a cause's place are in causes_simpler.cpp.
//
// In `best` the effects of the given model come first (model.effect_count of them), then the
// causes, in the order of `rounds`.
#include "explain/search/causes.hpp"

#include <algorithm>
#include <cstring>
#include <iterator>

#include "explain/policy.hpp"

namespace mk
{

namespace
{

// The first of a ranking of extensions, catalogue before library unless the library is ahead by
// `enough` (log likelihood).
// Returns the place of the best hypothesis of the catalogue if it is less than `enough` behind the
// first one, else 0. `ranked` is not empty, best first.
size_t pick(const std::vector<Hypothesis> &ranked, double enough)
{
    for (size_t i = 0; i < ranked.size(); i++)
        if (!is_library(ranked[i].added.effect))
            return ranked[i].penalised_nlml < ranked[0].penalised_nlml + enough ? i : 0;
    return 0;
}

void drop_terms(std::vector<Hypothesis> &ranked)
{
    ranked.erase(std::remove_if(ranked.begin(), ranked.end(),
                                [](const Hypothesis &h) { return is_library(h.added.effect); }),
                 ranked.end());
}

} // namespace

bool CauseSearch::all_named() const
{
    return std::none_of(rounds.begin(), rounds.end(),
                        [](const Round &r) { return is_library(r.ranked[0].added.effect); });
}

// From the refitted model on. `refit` is polished first: all gains are counted from it.
void CauseSearch::run()
{
    search.polish(refit, true);
    best = refit;
    rounds.clear();
    look_further();
}

// With the threshold at 0 gives_up() is false for any cause that gained something. Goes on beside
// the causes that are there.
void CauseSearch::run_to_the_end()
{
    gives_up_below = 0.0;
    look_further();
}

void CauseSearch::look_further()
{
    add_causes(policy::MOST_CAUSES);
    if (gives_up()) // something else will say what is missing
        return;
    try_runners_up();
    name_terms();
    drop_idle();
    sharpen_friction();
    simplify();
    // The rivals of the last one competed with all others beside.
    face_rivals_of(rounds.empty() ? 0 : rounds.size() - 1);
    unbend();
}

// Causes that were found by predictions become rounds. Their contenders are models with that cause
// alone and no fit, until face_rivals() fits them beside all others. False where the model cannot
// follow the states with less process noise than policy::FAR_FROM_DATA, or likelihood does not
// count after the fit; then rounds are as they were, but `best` may not be.
bool CauseSearch::go_on(const PredictionSearch &found)
{
    const RunFit &all = found.extended();
    // The states and process noise of the causes' model, then all parameters, by likelihood.
    Hypothesis there;
    if (!follow_with_sharpness(all.point.model, there) ||
        there.process_noise > policy::FAR_FROM_DATA ||
        !search.refit(there.point.model, &there, best))
        return false;
    search.polish(best, true);
    adapt_sharpness();
    if (!likelihood_counts(best))
        return false;
    before = best;
    near = true;
    most_tried = std::max(most_tried, found.tried());
    rounds.clear();
    for (size_t i = 0; i < found.causes.size(); i++) {
        Round round;
        for (const Candidate &cause : found.contenders(i)) {
            Hypothesis h;
            h.added = cause;
            if (with_candidate(refit.point.model, cause, h.point.model))
                round.ranked.push_back(std::move(h));
        }
        round.ranked[0].point.model = best.point.model;
        rounds.push_back(std::move(round));
    }
    add_causes(policy::MOST_FURTHER_CAUSES);
    drop_idle();
    sharpen_friction();
    simplify();
    face_rivals_of(rounds.size());
    unbend();
    return true;
}

// Up to `most` causes; and more where the latest one leads on, or the model is near enough to its
// data that likelihood is, or will be, the right judge of the next.
bool CauseSearch::may_add(size_t most) const
{
    const bool few = rounds.size() < most;
    const bool leads_on = latest_leads_on() || best.process_noise <= policy::FAR_FROM_DATA;
    return (few || (leads_on && rounds.size() < policy::MOST_FURTHER_CAUSES)) &&
           !search.cancelled && search.work_done() < policy::MOST_WORK;
}

// Whether nothing more is to be asked beside what was found.
bool CauseSearch::is_done() const
{
    if (search.complete(best))
        return true;
    // Nameless terms that already follow the data will not become a name.
    if (!all_named() && follows(best))
        return true;
    // On top of backlash every trial is slow, and little is left that is not the backlash's own.
    return mk_model_hides_joint(&best.point.model) && !rounds.empty();
}

// What competes for the next cause, that which earns a name first; false where nothing does.
// Up to four extensions of `best`, each asked only where the one before leaves it open:
//     usual      all but backlash, and nothing that is slow to fit where `best` follows its data ,
//     thorough   what is slow to fit as well, if something was found without it ,
//     rare       at a process noise below what matters, if nothing earned a name (find_rare) ,
//     backlash   unless what was found explains the data, or leads on to what does .
// The last two are asked only where what is missing is not small. Where the result is true
// ranked[0] is the choice, polished.
bool CauseSearch::find_next(std::vector<Hypothesis> &ranked)
{
    const double needed = rounds.empty() ? policy::ACCEPT_FIRST : policy::ACCEPT_FURTHER;
    ExtendOptions how;
    how.thorough = !near && !follows(best);
    // Where it is small, trials and full fits begin at the process noise of `best`, not at a larger
    // one.
    how.small = !how.thorough || (!rounds.empty() && best.process_noise <= policy::NEGLIGIBLE);
    how.least = policy::SHOWN_BY_TRIAL * needed;
    ranked = search.extend(best, how);
    // If something little is there, what is slow to fit may be it as well.
    if (!how.thorough && !ranked.empty() &&
        ranked[0].penalised_nlml < best.penalised_nlml - needed) {
        how.thorough = how.slow_only = true;
        std::vector<Hypothesis> slow = search.extend(best, how);
        std::move(slow.begin(), slow.end(), std::back_inserter(ranked));
        ranked = Search::best_of_each(std::move(ranked));
        how.slow_only = false;
    }
    most_tried = std::max(most_tried, search.tried());
    bool found = choose(ranked, needed) || (!how.small && find_rare(how, needed, ranked));
    if (how.thorough && !how.small && !(found && leaves_no_backlash(ranked[0])))
        found = consider_backlash(ranked, needed) || found;
    return found;
}

// Whether backlash need not be asked beside what leads: that explains the data, or is a further
// cause that has brought the model much nearer to them. Backlash hides in no such model, and is
// asked again where one stays as far as it was.
bool CauseSearch::leaves_no_backlash(const Hypothesis &leader) const
{
    return search.complete(leader) || (!rounds.empty() && is_nearer(leader, best));
}

// Whether the latest cause has brought the model much nearer to its data, or explains so much of
// them that others may show now.
bool CauseSearch::latest_leads_on() const
{
    return rounds.empty() || is_nearer(best, before) ||
           before.penalised_nlml - best.penalised_nlml >
               policy::LIKELIHOOD_SAYS_LITTLE * search.readings();
}

bool CauseSearch::is_nearer(const Hypothesis &h, const Hypothesis &earlier)
{
    return h.process_noise < policy::NEARER * earlier.process_noise;
}

// Trials that leave a model more process noise than it needs do not show what is rare and small. At
// a process noise below what matters a rare effect cannot hide in it.
bool CauseSearch::find_rare(ExtendOptions how, double needed, std::vector<Hypothesis> &ranked)
{
    if (best.process_noise > policy::FAINT)
        return false;
    how.small = true;
    how.process_noise = 0.5 * policy::IMMATERIAL;
    std::vector<Hypothesis> closer = search.extend(best, how);
    const bool found = choose(closer, needed);
    if (found)
        ranked = std::move(closer);
    return found;
}

// The forward search. In each turn the winner of find_next() is held against other forms of the
// same cause (its other joint, bristles in place of dry friction, own places), becomes `best` and a
// round, and is dropped again if the model does as well without it. What is known of models without
// a cause is forgotten, since all others have changed. Ends where nothing gains enough, where all
// is explained, or where likelihood gives up. The second cause is the first one that can show an
// earlier choice to be wrong: reconsider().
void CauseSearch::add_causes(size_t most)
{
    bool freed = false;
    while (may_add(most) && !is_done()) {
        Round round;
        if (!find_next(round.ranked))
            return;
        consider_other_joint(round.ranked);
        consider_bristles(round.ranked);
        consider_own_places(round.ranked);
        if (rounds.empty())
            first = round.ranked;
        before = best;
        best = round.ranked[0];
        forget_lacks();
        rounds.push_back(std::move(round));
        adapt_sharpness();
        if (idle_without_last()) {
            // Without any cause the first fit was only stuck: once more from where it is now.
            if (!rounds.empty() || freed)
                return;
            freed = true;
            continue;
        }
        if (gives_up())
            return;
        if (rounds.size() == 2 && search.work_done() < policy::MUCH_WORK)
            reconsider();
    }
}

// The best model still says nothing within a shooting interval, and its causes gained too little a
// reading for likelihood to be the right judge, or two of them have not brought it nearer to its
// data: predictions are asked in its place (prediction_search.cpp). What two causes hide together
// may show with the second one only; that is asked where few logs can be left out.
bool CauseSearch::gives_up() const
{
    if (gives_up_below > 0.0 && is_hopeless())
        return true;
    const double gain = refit.penalised_nlml - best.penalised_nlml;
    const bool gains_little = gain < gives_up_below * search.readings();
    const bool stays_away = gives_up_below > 0.0 && rounds.size() >= 2 && !is_nearer(best, refit);
    return rounds.size() >= give_up_after && best.process_noise >= policy::SAYS_NOTHING &&
           (gains_little || stays_away);
}

// The best model says nothing within a shooting interval, and its causes gained next to nothing.
bool CauseSearch::is_hopeless() const
{
    return !rounds.empty() && best.process_noise >= policy::SAYS_NOTHING &&
           refit.penalised_nlml - best.penalised_nlml <
               policy::LIKELIHOOD_SAYS_NOTHING * search.readings();
}

// Of a model that does not follow its data the fitted noise holds what the model misses. The
// readings' own scatter is then the better figure, where it is less.
double CauseSearch::noise(int joint) const
{
    const double fitted = best.point.noise[joint];
    return follows(best) ? fitted : std::min(fitted, least_scatter(search.training(), joint));
}

// `judge` puts the figures of free runs in the place of likelihoods, so that L compares by them.
// False where one of both models cannot be followed over the data of this search; there are no
// rounds then. Afterwards rounds, carried and the effects of `best` are in the order of
// other.causes.
bool CauseSearch::take_over(const PredictionSearch &other)
{
    best = refit;
    rounds.clear();
    suspects = other.suspects;
    most_tried = std::max(most_tried, other.tried());
    const Hypothesis from = refit;
    if (!search.follow(other.refitted().point.model, &from, from.process_noise, refit) ||
        !search.follow(other.extended().point.model, &from, from.process_noise, best))
        return false;
    other.judge(other.refitted(), refit);
    other.judge(other.extended(), best);
    for (const Carrier &carrier : other.causes) {
        Round round;
        round.ranked.push_back(best);
        round.ranked[0].added = carrier.cause;
        for (const RunFit &rival : carrier.rivals) {
            Hypothesis h;
            h.added = rival.cause;
            h.point.model = rival.point.model;
            other.judge(rival, h);
            round.ranked.push_back(std::move(h));
        }
        Hypothesis less;
        other.judge(carrier.without, less);
        round.lack = lack_of(less);
        rounds.push_back(std::move(round));
        carried.push_back(carrier.carried);
    }
    return true;
}

// Of each cause the chosen candidate and policy::RIVALS runners-up. `best` itself does not change.
bool CauseSearch::hand_over(PredictionSearch &other) const
{
    std::vector<std::vector<Candidate>> ranked;
    for (const Round &round : rounds) {
        ranked.emplace_back();
        for (size_t i = 0; i < round.ranked.size() && i <= policy::RIVALS; i++)
            ranked.back().push_back(round.ranked[i].added);
    }
    return other.take(best.point.model, best.point.model.effect + model.effect_count, ranked,
                      most_tried);
}

// Whether the process noise D is at most policy::FAINT.
bool CauseSearch::likelihood_counts(const Hypothesis &h)
{
    return h.process_noise <= policy::FAINT;
}

// The runners-up of a cause in its place, beside all others.
// Afterwards the round has `best` first and up to policy::RIVALS rivals, each fitted in the place
// of the cause, with all other causes there, at the process noise of `best`, or the one that suits
// it where it comes as near. Library terms, causes that `best` has already, and fits that switch
// their rival off are left out.
void CauseSearch::face_rivals(size_t cause)
{
    std::vector<Hypothesis> &ranked = rounds[cause].ranked;
    std::vector<Hypothesis> faced = {best};
    faced[0].added = ranked[0].added;
    for (size_t k = 1; k < ranked.size() && faced.size() <= policy::RIVALS && !search.cancelled;
         k++) {
        const Candidate &rival = ranked[k].added;
        if (is_library(rival.effect) || has_cause(rival))
            continue;
        mk_model m = best.point.model;
        mk_effect_use &use = m.effect[model.effect_count + (int)cause];
        use = ranked[k].point.model.effect[ranked[k].point.model.effect_count - 1];
        Hypothesis h;
        if (!search.refit_at(m, best, best.process_noise, h) || Search::discredited(h))
            continue;
        h.added = rival;
        // Of two that do as well at one process noise the right one does with less of it.
        if (!follows(best) && h.penalised_nlml < best.penalised_nlml + policy::INSEPARABLE)
            search.polish(h, true);
        faced.push_back(std::move(h));
    }
    ranked = std::move(faced);
}

// Those of the first `count` causes; one that is clearly likelier in its place,
//     L(rival) < L(best) - policy::INSEPARABLE ,
// takes it, and then the others are asked again.
void CauseSearch::face_rivals_of(size_t count)
{
    constexpr int PASSES = 2;
    bool changed = true, exchanged = false;
    for (int pass = 0; pass < PASSES && changed; pass++) {
        changed = false;
        for (size_t i = 0; i < count && !search.cancelled; i++) {
            face_rivals(i);
            std::vector<Hypothesis> &ranked = rounds[i].ranked;
            const auto likeliest = std::min_element(ranked.begin(), ranked.end(),
                                                    [](const Hypothesis &a, const Hypothesis &b) {
                                                        return a.penalised_nlml < b.penalised_nlml;
                                                    });
            if (likeliest->penalised_nlml >= best.penalised_nlml - policy::INSEPARABLE)
                continue;
            std::iter_swap(ranked.begin(), likeliest);
            best = ranked[0];
            forget_lacks();
            changed = exchanged = true;
        }
    }
    for (size_t i = 0; i < count; i++) { // what is `best` now leads them all
        Round &round = rounds[i];
        const Candidate cause = round.ranked[0].added;
        round.ranked = led_by(cause, std::move(round.ranked));
    }
    // A rival may be likelier than a cause that nothing needs, and be needed no more itself.
    if (exchanged)
        drop_idle();
}

bool CauseSearch::has_cause(const Candidate &c) const
{
    return std::any_of(rounds.begin(), rounds.end(), [&](const Round &r) {
        return r.ranked[0].added.effect == c.effect && r.ranked[0].added.joint == c.joint;
    });
}

// The first cause was chosen while another one was missing, and led to no model that follows the
// data: what came next may have been the right one.
// Not where `best` says nothing within a shooting interval (policy::SAYS_NOTHING), nor with
// backlash, where every fit is slow. `first` is copied, since add_causes() may write it.
void CauseSearch::try_runners_up()
{
    if (rounds.empty() || follows(best) || best.process_noise >= policy::SAYS_NOTHING ||
        mk_model_hides_joint(&best.point.model))
        return;
    const std::vector<Hypothesis> ranked = first;
    size_t tried = 0;
    for (size_t i = 1; i < ranked.size() && tried < policy::RIVALS; i++) {
        if (is_library(ranked[i].added.effect) ||
            ranked[i].penalised_nlml > refit.penalised_nlml - policy::ACCEPT_FIRST ||
            search.work_done() > policy::MUCH_WORK || search.cancelled)
            continue;
        tried++;
        // The search once more from the runner-up; what it finds replaces all of what was found if
        // L is less by policy::ACCEPT_FIRST and the data are followed, or stays for the next
        // runner-up to beat.
        const std::vector<Round> kept = rounds;
        const Hypothesis kept_best = best, kept_before = before;
        rounds.resize(1);
        rounds[0] = {ranked, {}};
        std::swap(rounds[0].ranked[0], rounds[0].ranked[i]);
        before = refit;
        best = rounds[0].ranked[0];
        add_causes(policy::MOST_FURTHER_CAUSES);
        const bool better = best.penalised_nlml < kept_best.penalised_nlml - policy::ACCEPT_FIRST;
        if (better && follows(best))
            return;
        if (!better) {
            rounds = kept;
            best = kept_best;
            before = kept_before;
        }
    }
}

// A term without a name was the best of all while another cause was missing, and could stand in for
// two. Beside the others something of the catalogue takes its place if
//     L(named) < L(best) + policy::BETTER_THAN_CATALOGUE .
// The last cause is left out: it was chosen with all others there. A name has to be plausible
// beside being likely enough.
void CauseSearch::name_terms()
{
    bool named = false;
    for (size_t i = 0; i + 1 < rounds.size() && !search.cancelled; i++) {
        Hypothesis without;
        if (!is_library(rounds[i].ranked[0].added.effect) ||
            mk_model_hides_joint(&best.point.model) || search.work_done() > policy::MUCH_WORK ||
            !remove(i, without))
            continue;
        std::vector<Hypothesis> ranked = search.extend(without, {});
        drop_terms(ranked);
        if (!choose(ranked, -HUGE_VAL) ||
            ranked[0].penalised_nlml > best.penalised_nlml + policy::BETTER_THAN_CATALOGUE ||
            !Search::plausible(ranked[0].point.model, ranked[0].added,
                               search.candidates_of(without.point.model)))
            continue;
        put_in_place(i, std::move(ranked), without);
        named = true;
        i--;
    }
    if (named)
        add_causes(policy::MOST_CAUSES);
}

// The first of a ranking takes a cause's place. It sits last in the model, and rounds follow the
// model's order.
// `without` is the model without the cause, from which `ranked` grew; it is what the new cause is
// measured by.
void CauseSearch::put_in_place(size_t cause, std::vector<Hypothesis> ranked,
                               const Hypothesis &without)
{
    best = ranked[0];
    rounds.erase(rounds.begin() + (std::ptrdiff_t)cause);
    forget_lacks();
    rounds.push_back({std::move(ranked), lack_of(without)});
}

// Whether the causes so far do as well without the latest one once they are given its fit to start
// from: then it is dropped. With L_0 the model without it, as it was before or as fitted from
// there, whichever is less, it stays if
//     L_0 - L(best) >= policy::ACCEPT_FIRST   (policy::ACCEPT_FURTHER) .
// A better start shows that the earlier fit was stuck, not that the cause is there.
// True where the cause was dropped; best is then the model before it, fitted from the better of
// both starts. Where the only cause is asked, and the model without it fits better from the new
// start, that fit becomes `refit` as well.
bool CauseSearch::idle_without_last()
{
    Hypothesis without;
    // A joint that was hidden has no states to start from.
    if (mk_model_hides_joint(&best.point.model))
        return false;
    const bool fitted =
        search.refit_at(removed(rounds.size() - 1), best, before.process_noise, without);
    // A better start than the one before leads further at other process noises too.
    if (fitted && without.penalised_nlml < before.penalised_nlml - 1.0)
        search.polish(without, true);
    if (fitted && without.penalised_nlml < before.penalised_nlml) {
        without.added = before.added;
        before = without;
        if (rounds.size() == 1)
            refit = before;
    }
    rounds.back().lack = lack_of(before);
    if (before.penalised_nlml - best.penalised_nlml >=
        (rounds.size() == 1 ? policy::ACCEPT_FIRST : policy::ACCEPT_FURTHER))
        return false;
    best = before;
    rounds.pop_back();
    if (rounds.size() == 1)
        rounds[0].ranked[0] = best;
    return true;
}

// A cause that stood in for what was found after it: the fit as it is, without it, does as well.
// Where the data leave its size open, other values may have gone far off with it: then the model
// without it is fitted from loose states.
// At least one cause stays. The index steps back after each removal, since the causes behind it
// move up.
void CauseSearch::drop_idle()
{
    for (size_t i = 0; i < rounds.size() && rounds.size() > 1 && !search.cancelled; i++) {
        if (has_sure_size(i))
            continue;
        Hypothesis without;
        const auto idle = [&] {
            return without.penalised_nlml <= best.penalised_nlml + policy::ACCEPT_FIRST;
        };
        if (!(fit_without(i, without) && idle()) &&
            !(has_open_size(i) && remove(i, without) && idle()))
            continue;
        search.polish(without, true);
        shed(i, std::move(without));
        i--;
    }
}

// Standard error of the size over the size >= policy::OPEN_SIZE: the data hardly tell it from
// nothing.
bool CauseSearch::has_open_size(size_t cause) const
{
    const int at = model.effect_count + (int)cause;
    return Search::relative_error(best, at, rounds[cause].ranked[0].added.size) >=
           policy::OPEN_SIZE;
}

// Of a law that vanishes with its size: standard error of the size over the size, z = 1 / that, is
// so small that to take it off costs z^2 / 2 or about (Wald), far beyond policy::ACCEPT_FIRST.
bool CauseSearch::has_sure_size(size_t cause) const
{
    const Candidate &law = rounds[cause].ranked[0].added;
    const int at = model.effect_count + (int)cause;
    const double error = law.linear ? Search::relative_error(best, at, law.size) : 0.0;
    return error > 0.0 && error <= policy::SURE_SIZE;
}

// One solve from `best` at its own process noise: cheap, but near the place where the cause left
// it.
bool CauseSearch::fit_without(size_t cause, Hypothesis &without)
{
    return search.refit_at(removed(cause), best, best.process_noise, without);
}

// `without` becomes `best`. The order of the other causes stays, and with it that of rounds and
// carried; the last round is led by what is `best` now.
void CauseSearch::shed(size_t cause, Hypothesis without)
{
    best = std::move(without);
    forget_lacks();
    rounds.erase(rounds.begin() + (std::ptrdiff_t)cause);
    if (cause < carried.size())
        carried.erase(carried.begin() + (std::ptrdiff_t)cause);
    Round &last = rounds.back();
    const Candidate latest = last.ranked[0].added;
    last.ranked = led_by(latest, std::move(last.ranked));
}

// Whether what a model leaves does not matter within a second of free run: its process noise is at
// most policy::IMMATERIAL. A model with contact may leave more, by the instants at which a
// simulation or a rig touches:
//     min(policy::CONTACT_LEAVES, policy::CONTACT_SHARE D_refit) ,   5 policy::CONTACT_LEAVES in
//     place of policy::CONTACT_LEAVES with backlash ,
// D_refit the refitted model's process noise, or meet its readings in one shooting interval a log.
bool CauseSearch::follows(const Hypothesis &h) const
{
    bool touches = mk_model_event_count(&h.point.model) > mk_model_event_count(&model);
    double rough = mk_model_hides_joint(&h.point.model) ? 5.0 * policy::CONTACT_LEAVES
                                                        : policy::CONTACT_LEAVES;
    double most = touches ? std::min(rough, policy::CONTACT_SHARE * refit.process_noise) : 0.0;
    return h.process_noise <= std::max(policy::IMMATERIAL, most) ||
           (touches && search.meets_readings(h));
}

// Brings what is to be named to the front of the ranking; false if nothing there earns a name.
// True with ranked[0] the choice: named if a name is near enough to the best, polished, not
// switched off, and L(ranked[0]) <= L(best) - needed before it was polished. Hypotheses that
// polishing switches off are erased; `ranked` may be empty afterwards. needed = -HUGE_VAL takes the
// best there is.
bool CauseSearch::choose(std::vector<Hypothesis> &ranked, double needed)
{
    if (near)
        drop_terms(ranked); // a trifle without a name
    while (!ranked.empty()) {
        // A term that leaves the model far from its data has bent to what else is missing.
        const double gain = best.penalised_nlml - ranked[0].penalised_nlml;
        const double enough =
            follows(ranked[0])
                ? policy::BETTER_THAN_CATALOGUE
                : std::max(policy::BETTER_THAN_CATALOGUE, policy::BETTER_THAN_CATALOGUE_FAR * gain);
        size_t chosen = pick(ranked, enough);
        // A nameless term on top of named causes that already follow the data names nothing.
        bool idle = !rounds.empty() && follows(best) && is_library(ranked[chosen].added.effect);
        if (idle || ranked[chosen].penalised_nlml > best.penalised_nlml - needed)
            return false;
        std::swap(ranked[0], ranked[chosen]);
        search.polish(ranked[0], true);
        if (!Search::discredited(ranked[0]))
            return true;
        ranked.erase(ranked.begin());
    }
    return false;
}

void CauseSearch::forget_lacks()
{
    for (Round &round : rounds)
        round.lack.reset();
}

// Nothing came near this cause: the distance to its nearest rival is more than all that was found
// after it gained,
//     min L(rival) - L(cause) > L(cause) - L(best) ,
// and the data are explained. Then no rival can overtake it with the same further causes.
bool CauseSearch::stands_alone(const Round &round) const
{
    const Hypothesis &chosen = round.ranked[0];
    double nearest = HUGE_VAL;
    for (size_t i = 1; i < round.ranked.size(); i++)
        nearest = std::min(nearest, round.ranked[i].penalised_nlml - chosen.penalised_nlml);
    return follows(best) && nearest > chosen.penalised_nlml - best.penalised_nlml;
}

// A ranking with the best model in first place, as the one that has this cause, and those that have
// as many causes.
std::vector<Hypothesis> CauseSearch::led_by(const Candidate &cause,
                                            std::vector<Hypothesis> ranked) const
{
    ranked.erase(std::remove_if(ranked.begin(), ranked.end(),
                                [&](const Hypothesis &h) {
                                    return same_cause(h.added, cause) ||
                                           h.point.model.effect_count !=
                                               best.point.model.effect_count;
                                }),
                 ranked.end());
    ranked.insert(ranked.begin(), best);
    ranked[0].added = cause;
    return ranked;
}

// An earlier choice was made while another cause was still missing. For each cause but the last:
// the model without it, refitted, and from there all that ever competed. With L_less the model
// without it and L_rival the best of those,
//     L_less < min(L_rival, L(best)) + policy::ACCEPT_FIRST   the cause is not needed any more ,
//     L_rival < L(best)                               the rival takes its place .
// What takes a cause's place may be any cause that competed in any round, refitted from the model
// without it; nothing that was never asked. The last cause was chosen with all others there.
void CauseSearch::reconsider()
{
    for (size_t i = 0; i + 1 < rounds.size(); i++) {
        Hypothesis without;
        if (stands_alone(rounds[i]) || !remove(i, without))
            continue;
        std::vector<Candidate> others;
        for (const Round &r : rounds)
            for (const Hypothesis &h : r.ranked)
                others.push_back(h.added);
        ExtendOptions how;
        how.only = &others;
        std::vector<Hypothesis> ranked = search.extend(without, how);
        const bool led = choose(ranked, -HUGE_VAL);
        const double leader = led ? ranked[0].penalised_nlml : HUGE_VAL;
        if (without.penalised_nlml < std::min(leader, best.penalised_nlml) + policy::ACCEPT_FIRST) {
            best = without; // not needed any more
            forget_lacks();
            rounds.erase(rounds.begin() + (std::ptrdiff_t)i);
            i--;
            continue;
        }
        if (!led)
            continue;
        // What takes a cause's place must be what its name says, not a law bent into another one.
        const bool better = ranked[0].penalised_nlml < best.penalised_nlml - 1e-6 &&
                            Search::plausible(ranked[0].point.model, ranked[0].added,
                                              search.candidates_of(removed(i)));
        if (better)
            put_in_place(i, std::move(ranked), without);
        else
            rounds[i] = {led_by(rounds[i].ranked[0].added, std::move(ranked)), lack_of(without)};
    }
}

// `best`'s model without the effect of a cause; its own effects come first.
mk_model CauseSearch::removed(size_t cause) const
{
    mk_model m = best.point.model;
    int at = model.effect_count + (int)cause;
    for (int e = at; e + 1 < m.effect_count; e++)
        m.effect[e] = m.effect[e + 1];
    m.effect_count--;
    return m;
}

// What a model lacks takes no more process noise than the model without any cause does. One that
// ends further from the data than that model was stuck on its way from the best one's values, and
// is fitted anew from that model's.
// `without` is the better of the fits that were made. False where none could be.
bool CauseSearch::remove(size_t cause, Hypothesis &without)
{
    mk_model less = removed(cause);
    const bool fitted = search.refit(less, &best, without, refit.process_noise);
    if (fitted && without.penalised_nlml <= refit.penalised_nlml)
        return true;
    Hypothesis anew;
    std::copy_n(refit.point.model.parameter, MK_MAX_PARAMETERS, less.parameter);
    if (!search.refit(less, nullptr, anew) ||
        (fitted && anew.penalised_nlml >= without.penalised_nlml))
        return fitted;
    without = std::move(anew);
    return true;
}

// L and nlml without a cause, for the evidence that it is given. Known from the search, or, of two
// causes, from a rival of this cause's round that is the other cause alone; else by a fit.
Lack CauseSearch::without(size_t cause)
{
    if (rounds.size() == 1)
        return lack_of(refit);
    if (rounds[cause].lack)
        return *rounds[cause].lack;
    // Of two causes the other one alone may have been a rival of this one.
    const Candidate &other = rounds[cause == 0].ranked[0].added;
    for (const Hypothesis &h : rounds[cause].ranked)
        if (rounds.size() == 2 && h.added.effect == other.effect && h.added.joint == other.joint &&
            h.point.model.effect_count + 1 == best.point.model.effect_count)
            return lack_of(h);
    Hypothesis less;
    rounds[cause].lack = lack_of(remove(cause, less) ? less : refit);
    return *rounds[cause].lack;
}

// A rival that got lost on its way starts again from where the best one ended.
// Requires one round, whose cause is the last effect of both models. A worse fit changes nothing.
void CauseSearch::warm_start(Hypothesis &rival)
{
    mk_model m = best.point.model;
    m.effect[m.effect_count - 1] = rival.point.model.effect[m.effect_count - 1];
    Hypothesis again;
    if (!search.refit_at(m, best, best.process_noise, again) ||
        again.penalised_nlml > rival.penalised_nlml)
        return;
    again.added = rival.added;
    rival = std::move(again);
}

// The first three rivals of each round; the best one had this care when it was chosen. Afterwards
// the rivals are sorted, and of a single cause a rival that is clearly likelier leads.
void CauseSearch::polish_rivals()
{
    // Log likelihood behind the best within which a rival is polished, and within which its process
    // noise is, too.
    constexpr double NEAR = 50.0, BESIDE = 25.0;
    for (Round &r : rounds) {
        for (size_t i = 1; i < r.ranked.size() && i <= 3; i++) {
            if (rounds.size() == 1 && follows(best) &&
                r.ranked[i].penalised_nlml > best.penalised_nlml + NEAR)
                warm_start(r.ranked[i]);
            const double behind = r.ranked[i].penalised_nlml - r.ranked[0].penalised_nlml;
            const bool hides = mk_model_hides_joint(&r.ranked[i].point.model);
            if (behind < NEAR)
                search.polish(r.ranked[i], behind < BESIDE && !hides);
        }
        std::stable_sort(r.ranked.begin() + 1, r.ranked.end(),
                         [](const Hypothesis &a, const Hypothesis &b) {
                             return a.penalised_nlml < b.penalised_nlml;
                         });
    }
    // What differs by less is the same thing by another name: the first stays. A term of the
    // library is one of many.
    constexpr double BETTER = 1.0, BETTER_TERM = 5.0;
    if (rounds.size() == 1 && rounds[0].ranked.size() > 1 &&
        rounds[0].ranked[1].penalised_nlml <
            rounds[0].ranked[0].penalised_nlml -
                (is_library(rounds[0].ranked[1].added.effect) ? BETTER_TERM : BETTER))
        let_lead(1);
}

void CauseSearch::let_lead(size_t rival)
{
    std::swap(rounds[0].ranked[0], rounds[0].ranked[rival]);
    best = rounds[0].ranked[0];
    simplify();
}

} // namespace mk
