// The search by predictions of data left out (explain/search/prediction_search.hpp).
//
// A cause is asked by two figures, both of free runs (ident/free_runs.cpp):
//     carried    what a fit to all folds but one leaves in that one, with the cause against
//                without, window by window (explain/evidence/carry_over.cpp): whether it is there;
//     L          penalised nlml of independent errors, nlml + k/2 log N: which of several it is.
// N are the independent errors (one in 0.05 s), k the fitted parameters and spreads.
//
// The road: screen() asks all candidates cheaply; add_one() fits the most promising in full, and of
// those whose carried figures are enough takes the one of least L; exchange() tries in the place of
// each cause what came next when it was found; decide() leaves out each cause with all others
// fitted again, drops the weakest that is not missed, and has other laws of friction in the place
// of each that stays; claim() asks data that chose nothing.
#include "explain/search/prediction_search.hpp"

#include <algorithm>
#include <cmath>

#include "base/parallel.hpp"
#include "explain/evidence/resamples.hpp"
#include "explain/policy.hpp"

namespace mk
{

namespace
{

// Causes of a round that are fitted in full.
constexpr size_t MOST_FULL_FITS = 6;
// Progress that is shown meanwhile, as far as anybody can tell.
constexpr double DONE = 0.6;
constexpr const char *ASKING = "asking what predicts";
// Iterations of a full fit, of one that starts where its model was fitted before, and of a trial.
constexpr int FULL_ITERATIONS = 16, REFIT_ITERATIONS = 4, TRIAL_ITERATIONS = 3;

// Those of the free parameters that belong to an effect, by number.
std::vector<int> range_of(const mk_model &model, int effect, const std::vector<int> &free)
{
    int first = mk_plant(model.plant)->parameter_count;
    for (int e = 0; e < effect; e++)
        first += mk_effect(model.effect[e].index)->parameter_count;
    const int last = first + mk_effect(model.effect[effect].index)->parameter_count;
    std::vector<int> inside;
    for (int number : free)
        if (number >= first && number < last)
            inside.push_back(number);
    return inside;
}

bool same_values(const Candidate &a, const Candidate &b)
{
    return same_cause(a, b) && a.spread == b.spread &&
           std::equal(a.value, a.value + a.effect->parameter_count, b.value);
}

bool has_own_values(const RunFit &fit)
{
    return !own_parameters(fit.point.model).empty();
}

} // namespace

PredictionSearch::PredictionSearch(Search &search_in, FreeRuns &runs_in, const mk_model &base_in)
    : search(search_in), runs(runs_in), base(base_in), threads(search_in.settings().threads),
      own_effects((size_t)base_in.effect_count)
{
}

// [0]: errors of whole folds; [1]: of their second halves, for comparisons in which a model has own
// values.
bool PredictionSearch::leave_out(const std::vector<int> &wanted, RunFit &fit) const
{
    return runs.left_out(fit.point, fit.quadratic, wanted, false, fit.left_out[0]) &&
           runs.left_out(fit.point, fit.quadratic, wanted, true, fit.left_out[1]);
}

bool PredictionSearch::fit(const RunPoint &from, const mk_model &model, int iterations,
                           int threads_now, RunFit &out) const
{
    if (!search.tick(DONE, ASKING))
        return false;
    out.point = runs.adopt(from, model, threads_now);
    const std::vector<int> free = fitted_parameters(model);
    out.fine = runs.minimise(out.point, free, iterations, threads_now, out.quadratic) &&
               leave_out(free, out);
    return out.fine;
}

Carried PredictionSearch::compare(const RunFit &with, const RunFit &less) const
{
    // Own values are learnt on first halves, and then all are judged on the second.
    const bool half = has_own_values(with) || has_own_values(less);
    return carry_over::compare(with.left_out[half], less.left_out[half], refit.left_out[half],
                               floor, mk_model_joints(&base));
}

// `model`: the best one and this cause, last. A shape says little before the size is about right:
// it is held until then.
bool PredictionSearch::fit_added(const mk_model &model, const Candidate &cause, int iterations,
                                 RunFit &out) const
{
    RunPoint from = best.point;
    mk_model begun = model;
    // The size first, the shape held at its start; then both, from there.
    if (cause.shape >= 0) {
        std::vector<int> free = fitted_parameters(model);
        const int held =
            mk_model_parameter_count(&model) - cause.effect->parameter_count + cause.shape;
        free.erase(std::remove(free.begin(), free.end(), held), free.end());
        RunQuadraticModel quadratic;
        quadratic.stride = out.quadratic.stride;
        RunPoint sized = runs.adopt(best.point, model, 1);
        if (runs.minimise(sized, free, iterations, 1, quadratic)) {
            begun = sized.model;
            from = std::move(sized);
        }
    }
    return fit(from, begun, iterations, 1, out);
}

// sqrt(mean_j (nrmse_j / floor_j)^2) of the best model on data left out.
double PredictionSearch::times_noise() const
{
    double sum = 0.0, n = 0.0;
    for (int j = 0; j < mk_model_joints(&base); j++)
        if (floor[j] > 0.0)
            sum += std::pow(best.left_out[has_own_values(best)].nrmse(j) / floor[j], 2), n += 1.0;
    return n > 0.0 ? std::sqrt(sum / n) : 0.0;
}

double PredictionSearch::closed() const
{
    const bool half = has_own_values(best);
    double sum = 0.0, n = 0.0;
    for (int j = 0; j < mk_model_joints(&base); j++)
        if (refit.left_out[half].nrmse(j) > 0.0)
            sum += 1.0 - std::pow(best.left_out[half].nrmse(j) / refit.left_out[half].nrmse(j), 2),
                n += 1.0;
    return n > 0.0 ? sum / n : 0.0;
}

// The base fitted, and what errors are usual taken from it. floor: what the readings' noise leaves
// of a joint's nrmse.
bool PredictionSearch::start()
{
    RunPoint from = runs.start(base);
    runs.take_scale(from);
    refit.point = from;
    if (!converge(refit))
        return false;
    for (int j = 0; j < mk_model_joints(&base); j++)
        floor[j] = runs.relative(j, least_scatter(search.training(), j));
    all = search.candidates_of(base);
    best = refit;
    return true;
}

bool PredictionSearch::take(const PredictionSearch &found)
{
    std::vector<std::vector<Candidate>> ranked;
    for (size_t i = 0; i < found.causes.size(); i++)
        ranked.push_back(found.contenders(i));
    const mk_model &theirs = found.best.point.model;
    if (!take(theirs, theirs.effect + found.own_effects, ranked, found.most_tried))
        return false;
    suspects = found.suspects;
    hopeless = found.hopeless;
    return true;
}

bool PredictionSearch::take(const mk_model &values, const mk_effect_use *effects,
                            const std::vector<std::vector<Candidate>> &ranked, int tried)
{
    if (!start())
        return false;
    most_tried = tried;
    if (ranked.empty())
        return true;
    mk_model m = base;
    std::copy_n(values.parameter, MK_MAX_PARAMETERS, m.parameter);
    for (size_t i = 0; i < ranked.size(); i++) {
        if (m.effect_count == MK_MAX_EFFECTS)
            return false;
        m.effect[m.effect_count++] = effects[i];
        causes.push_back({ranked[i][0], {}, {}, {}});
        runners_up.emplace_back(ranked[i].begin() + 1, ranked[i].end());
    }
    best.point = runs.start(m);
    return converge(best);
}

bool PredictionSearch::confirm(const PredictionSearch &found)
{
    if (!take(found) || !exchange(causes.size()))
        return false;
    decide();
    return true;
}

bool PredictionSearch::go_on()
{
    while (causes.size() < policy::MOST_PREDICTING && !search.cancelled &&
           times_noise() > policy::AT_NOISE && add_one())
        continue;
    // Of the last one all others were asked just now.
    return exchange(causes.empty() ? 0 : causes.size() - 1);
}

Carried PredictionSearch::against(const PredictionSearch &other, double &gain) const
{
    gain = other.penalised_nlml(other.best) - penalised_nlml(best);
    return compare(best, other.best);
}

std::vector<Candidate> PredictionSearch::contenders(size_t cause) const
{
    std::vector<Candidate> ranked = {causes[cause].cause};
    ranked.insert(ranked.end(), runners_up[cause].begin(), runners_up[cause].end());
    return ranked;
}

// Those that vanish with their size, several together, from the quadratics of the windows about a
// point where each is next to nothing (its cost changes by less than SAME). For each, the columns
// of the base's parameters and its own say what fits to all folds but one would leave: no candidate
// is fitted.
void PredictionSearch::screen_group(const std::vector<Candidate> &group, const RunFit &less,
                                    std::vector<Asked> &out) const
{
    if (!search.tick(DONE, ASKING))
        return;
    constexpr double SAME = 0.5; // log likelihood: the runs stay where they are
    // The base's parameters, all of them wanted beside each member's.
    const std::vector<int> own = fitted_parameters(best.point.model);
    const double now = runs.cost(less.point, less.quadratic);
    RunPoint point;
    RunQuadraticModel quadratic;
    quadratic.stride = less.quadratic.stride;
    std::vector<const Candidate *> members;
    for (double share = 1e-3; share > 1e-10; share *= 1e-3) {
        mk_model model = best.point.model;
        members.clear();
        for (const Candidate &given : group) {
            Candidate c = given;
            c.value[c.size] *= share;
            mk_model more;
            if (with_candidate(model, c, more)) {
                model = more;
                members.push_back(&given);
            }
        }
        point = runs.adopt_traces(less.point, model, 1);
        if (!runs.linearise(point, fitted_parameters(model), false, 1, quadratic))
            return;
        if (std::fabs(runs.cost(point, quadratic) - now) < SAME)
            break;
    }
    for (size_t i = 0; i < members.size(); i++) {
        const Candidate &c = *members[i];
        const int effect = best.point.model.effect_count + (int)i;
        std::vector<int> wanted = own;
        for (int number : range_of(point.model, effect, quadratic.free)) {
            // The shape of a resonance has no slope where it is next to nothing.
            const bool is_size =
                number == range_of(point.model, effect, quadratic.free)[0] + c.size;
            if (c.effect->state_count == 0 || is_size)
                wanted.push_back(number);
        }
        RunFit with;
        with.point = point;
        with.quadratic = quadratic;
        if (leave_out(wanted, with))
            out.push_back({c, compare(with, less)});
    }
}

void PredictionSearch::screen_linear(const std::vector<Candidate> &some, const RunFit &less,
                                     std::vector<Asked> &out) const
{
    constexpr size_t TOGETHER = 6;
    std::vector<std::vector<Candidate>> groups;
    for (const Candidate &c : some) {
        const bool alone = c.effect->state_count > 0;
        if (groups.empty() || alone || groups.back().size() == TOGETHER ||
            groups.back()[0].effect->state_count > 0)
            groups.emplace_back();
        groups.back().push_back(c);
    }
    std::vector<std::vector<Asked>> each(groups.size());
    parallel_for(threads, groups.size(), [&](size_t g) { screen_group(groups[g], less, each[g]); });
    for (const std::vector<Asked> &group : each)
        out.insert(out.end(), group.begin(), group.end());
}

// All others, fitted for a few iterations from where they start. A start that is no better in the
// mean is not tried again in later rounds (hopeless).
void PredictionSearch::screen_others(const std::vector<Candidate> &some, const RunFit &less,
                                     std::vector<Asked> &out)
{
    std::vector<Asked> each(some.size());
    std::vector<char> fine(some.size(), 0);
    parallel_for(threads, some.size(), [&](size_t i) {
        mk_model model;
        RunFit with;
        with.quadratic.stride = less.quadratic.stride;
        if (!with_candidate(best.point.model, some[i], model) ||
            !fit_added(model, some[i], TRIAL_ITERATIONS, with))
            return;
        each[i] = {some[i], compare(with, less)};
        const mk_effect_use &use = with.point.model.effect[model.effect_count - 1];
        std::copy_n(use.value, some[i].effect->parameter_count, each[i].cause.value);
        fine[i] = 1;
    });
    for (size_t i = 0; i < some.size(); i++) {
        const Carried &c = each[i].carried;
        if (fine[i] && c.mean < 0.0)
            out.push_back(each[i]);
        if (!fine[i] || c.mean >= 0.0)
            hopeless.push_back(some[i]);
    }
}

// Whether the added cause is still itself, and leaves the rig what it weighs.
bool PredictionSearch::plausible(const RunFit &fit) const
{
    const MassRange *masses = search.settings().masses;
    return Search::plausible(fit.point.model, fit.cause, all) &&
           (!masses || masses->holds(fit.point.model));
}

bool PredictionSearch::was_hopeless(const Candidate &cause) const
{
    return std::any_of(hopeless.begin(), hopeless.end(),
                       [&](const Candidate &c) { return same_values(c, cause); });
}

constexpr double FAINT = 0.3; // standard errors that a cause must show to be fitted in full

// The best start of every cause that might carry over, the best first by that order.
template <class Order>
static std::vector<Asked> best_starts(std::vector<Asked> asked, Order better)
{
    std::sort(asked.begin(), asked.end(), better);
    std::vector<Asked> some;
    for (const Asked &a : asked)
        if (a.carried.mean < -FAINT * a.carried.error && a.carried.judged &&
            std::none_of(some.begin(), some.end(),
                         [&](const Asked &b) { return same_cause(a.cause, b.cause); }))
            some.push_back(a);
    return some;
}

// One of these and one of those, no cause twice.
static std::vector<Asked> in_turn(const std::vector<Asked> &these, const std::vector<Asked> &those)
{
    std::vector<Asked> all;
    for (size_t i = 0; i < these.size(); i++)
        for (const Asked &a : {these[i], those[i]})
            if (std::none_of(all.begin(), all.end(),
                             [&](const Asked &b) { return same_cause(a.cause, b.cause); }))
                all.push_back(a);
    return all;
}

// Those to fit in full: the most promising causes, and of the first few whose law has a shape a
// second start beside the best one, if its shape is another one. A few iterations on some of the
// windows do not say which of the two minima is the lower one.
static std::vector<Asked> to_be_fitted(const std::vector<Asked> &promising,
                                       const std::vector<Asked> &all)
{
    constexpr size_t MOST_SECOND = 2;
    constexpr double ANOTHER_SHAPE = 1.5; // factor between shapes
    std::vector<Asked> some(promising.begin(),
                            promising.begin() +
                                (std::ptrdiff_t)std::min(promising.size(), MOST_FULL_FITS));
    const size_t causes = some.size();
    size_t second = 0;
    for (size_t i = 0; i < causes && second < MOST_SECOND; i++) {
        const Candidate &first = some[i].cause;
        if (first.shape < 0)
            continue;
        const auto is_second = [&](const Asked &a) {
            const double ratio = a.cause.value[first.shape] / first.value[first.shape];
            return same_cause(a.cause, first) && a.carried.mean < 0.0 &&
                   (ratio > ANOTHER_SHAPE || ratio < 1.0 / ANOTHER_SHAPE);
        };
        const Asked *best = nullptr;
        for (const Asked &a : all)
            if (is_second(a) && (!best || a.carried.mean < best->carried.mean))
                best = &a;
        if (best)
            some.push_back(*best), second++;
    }
    return some;
}

// What might carry over, the most promising first: by the mean log ratio of windows (what is better
// in most of them), and by the share of the gap (what takes away most of the error, be it in a
// few), in turn.
std::vector<Asked> PredictionSearch::screen(const std::function<bool(const Candidate &)> &wanted)
{
    // Over a window frequencies are told apart less finely than over a log.
    constexpr int SKIPPED = 3;
    // Candidates are asked on one in so many windows.
    constexpr size_t EVERY = 3;
    int resonances = 0;
    std::vector<Candidate> linear, others;
    std::vector<Candidate> possible = search.candidates_of(best.point.model);
    if (search.several_logs()) {
        const std::vector<Candidate> own = with_own_places(possible);
        possible.insert(possible.end(), own.begin(), own.end());
    }
    for (const Candidate &c : possible) {
        if (is_library(c.effect) || is_backlash(c.effect) || !wanted(c) ||
            (c.effect->state_count > 0 && c.linear && ++resonances % SKIPPED != 0))
            continue;
        if (c.linear)
            linear.push_back(c);
        else if (!was_hopeless(c))
            others.push_back(c);
    }
    most_tried = std::max(most_tried, (int)(linear.size() + others.size()));
    // The best model on the windows that candidates are asked on: it knows no more of them than
    // they do.
    std::vector<Asked> asked;
    RunFit less;
    less.point = best.point;
    less.quadratic.stride = EVERY;
    if (!runs.linearise(less.point, fitted_parameters(less.point.model), true, threads,
                        less.quadratic) ||
        !leave_out(less.quadratic.free, less))
        return {};
    screen_linear(linear, less, asked);
    screen_others(others, less, asked);
    const auto by_windows = [](const Asked &a, const Asked &b) {
        return a.carried.mean < b.carried.mean;
    };
    const auto by_share = [](const Asked &a, const Asked &b) {
        return a.carried.share > b.carried.share;
    };
    return to_be_fitted(in_turn(best_starts(asked, by_windows), best_starts(asked, by_share)),
                        asked);
}

// All of `asked` beside the best model, fitted in full, the likeliest first; of two starts of a
// cause the likelier.
std::vector<RunFit> PredictionSearch::fit_in_full(const std::vector<Asked> &asked) const
{
    std::vector<RunFit> fits(asked.size()), fine;
    parallel_for(threads, fits.size(), [&](size_t i) {
        RunFit &f = fits[i];
        mk_model model;
        f.cause = asked[i].cause;
        if (!with_candidate(best.point.model, f.cause, model) ||
            !fit_added(model, f.cause, FULL_ITERATIONS, f))
            return;
        f.carried = compare(f, best);
        f.fine = plausible(f);
        const mk_effect_use &use = f.point.model.effect[f.point.model.effect_count - 1];
        std::copy_n(use.value, f.cause.effect->parameter_count, f.cause.value);
    });
    std::sort(fits.begin(), fits.end(), [this](const RunFit &x, const RunFit &y) {
        return x.fine && y.fine ? penalised_nlml(x) < penalised_nlml(y) : x.fine && !y.fine;
    });
    for (RunFit &f : fits)
        if (f.fine && std::none_of(fine.begin(), fine.end(), [&](const RunFit &other) {
                return same_cause(other.cause, f.cause);
            }))
            fine.push_back(std::move(f));
    return fine;
}

// Of those that carry over the likeliest: what is left out says whether, and of few logs hardly
// which one rather than another.
bool PredictionSearch::add_one()
{
    std::vector<RunFit> full_fits = fit_in_full(screen([](const Candidate &) { return true; }));
    const double now = penalised_nlml(best);
    const auto may_stay = [&](const RunFit &f) {
        return carry_over::enough(f.carried, 1, now - penalised_nlml(f), policy::PART_TO_GO_ON);
    };
    // full_fits are sorted by L: the first that may stay is the likeliest.
    auto chosen = std::find_if(full_fits.begin(), full_fits.end(), may_stay);
    // Of two that are as likely the one with fewer parameters: it says the same with less.
    for (auto f = chosen; f != full_fits.end(); ++f)
        if (f->quadratic.free.size() < chosen->quadratic.free.size() && may_stay(*f) &&
            penalised_nlml(*f) < penalised_nlml(*chosen) + policy::BETTER_IN_PLACE)
            chosen = f;
    suspects.clear();
    for (const RunFit &f : full_fits)
        if (f.carried.mean < 0.0 && f.carried.share > 0.0)
            suspects.push_back({f.cause, f.carried});
    if (chosen == full_fits.end())
        return false;
    Carrier carrier = {chosen->cause, chosen->carried, {}, {}};
    runners_up.emplace_back();
    // Those that came next and would have been promising by themselves are kept for exchange() and
    // as rivals.
    for (const RunFit &f : full_fits)
        if (&f != &*chosen && runners_up.back().size() < policy::RIVALS &&
            carry_over::promising(f.carried))
            runners_up.back().push_back(f.cause);
    best = std::move(*chosen);
    causes.push_back(carrier);
    return converge(best);
}

// Fits on until nothing is gained any more: a fit that is still under way makes whatever is added
// to it look good, by the further steps. Errors that were usual before hide what is left, so each
// round is in units of those that are usual now.
bool PredictionSearch::converge(RunFit &at) const
{
    constexpr int MOST_ROUNDS = 3;
    constexpr double SAME = 0.05; // of the logarithm of usual squared errors
    const std::vector<int> free = fitted_parameters(at.point.model);
    for (int i = 0; i < MOST_ROUNDS; i++) {
        if (runs.take_scale(at.point) < SAME && i > 0)
            break;
        if (!search.tick(DONE, ASKING) || !runs.converge(at.point, free, threads, at.quadratic))
            return false;
    }
    return leave_out(free, at);
}

// A cause was chosen while others were missing, or on fewer data: one of those that nearly did as
// well then may be the better one beside what was found since. Of the first `count`.
bool PredictionSearch::exchange(size_t count)
{
    for (size_t i = 0; i < count && !search.cancelled; i++) {
        std::vector<Candidate> &others = runners_up[i];
        std::vector<RunFit> fits(others.size());
        // They are few, and one may take as long as all others: all threads for each.
        for (size_t k = 0; k < others.size(); k++) {
            mk_model model;
            if (has_cause(others[k]) || !with_candidate(without(i), others[k], model) ||
                !fit(best.point, model, FULL_ITERATIONS, threads, fits[k]))
                continue;
            fits[k].cause = others[k];
            fits[k].fine = plausible(fits[k]);
        }
        size_t chosen = fits.size();
        // A runner-up takes the place of a cause where L is less by policy::BETTER_IN_PLACE.
        double least = penalised_nlml(best) - policy::BETTER_IN_PLACE;
        for (size_t k = 0; k < fits.size(); k++)
            if (fits[k].fine && penalised_nlml(fits[k]) < least)
                least = penalised_nlml(fits[k]), chosen = k;
        if (chosen == fits.size())
            continue;
        std::vector<Candidate> left = others;
        left[chosen] = causes[i].cause;
        put_in_place(i, std::move(fits[chosen]), std::move(left));
        i--;
        count--;
        if (!converge(best))
            return false;
    }
    return true;
}

// `fit`, which has another cause in the place of this one, becomes the best. The new cause sits
// last in the model; causes follow the model's order.
void PredictionSearch::put_in_place(size_t cause, RunFit fit, std::vector<Candidate> next)
{
    Carrier carrier = {fit.cause, {}, {}, {}};
    best = std::move(fit);
    causes.erase(causes.begin() + (std::ptrdiff_t)cause);
    runners_up.erase(runners_up.begin() + (std::ptrdiff_t)cause);
    causes.push_back(std::move(carrier));
    runners_up.push_back(std::move(next));
}

// The friction of a joint is one question: which law was found early was found while others were
// missing, and nobody would have asked for the right one then. In the place of each all laws of
// friction at its joint are asked once more, beside all other causes (causes[i].without): those
// that promise more than the law itself, policy::RIVALS at most, are fitted in full, and the
// likeliest takes its place where L is less by policy::BETTER_IN_PLACE. True where one has.
bool PredictionSearch::reconsider_frictions()
{
    for (size_t i = 0; i < causes.size() && !search.cancelled; i++) {
        const Candidate law = causes[i].cause;
        if (!causes[i].without.fine || !is_friction(law.effect, law.value))
            continue;
        RunFit with = std::move(best);
        best = causes[i].without;
        std::vector<Asked> ahead = screen([&](const Candidate &c) {
            return c.joint == law.joint && is_friction(c.effect, c.value);
        });
        const auto itself = std::find_if(ahead.begin(), ahead.end(),
                                         [&](const Asked &a) { return same_cause(a.cause, law); });
        ahead.resize(std::min((size_t)(itself - ahead.begin()), policy::RIVALS));
        std::vector<RunFit> fits = fit_in_full(ahead);
        best = std::move(with);
        if (fits.empty() ||
            penalised_nlml(fits[0]) > penalised_nlml(best) - policy::BETTER_IN_PLACE)
            continue;
        put_in_place(i, std::move(fits[0]), {law});
        converge(best);
        return true; // what others are without it is known no longer
    }
    return false;
}

bool PredictionSearch::has_cause(const Candidate &cause) const
{
    return std::any_of(causes.begin(), causes.end(),
                       [&](const Carrier &c) { return same_cause(c.cause, cause); });
}

mk_model PredictionSearch::without(size_t cause) const
{
    mk_model m = best.point.model;
    for (int e = (int)(own_effects + cause); e + 1 < m.effect_count; e++)
        m.effect[e] = m.effect[e + 1];
    m.effect_count--;
    return m;
}

// What is left without each cause, all others fitted again, and what the cause says of data left
// out against that.
void PredictionSearch::leave_out_each()
{
    for (size_t i = 0; i < causes.size(); i++) {
        RunFit &less = causes[i].without;
        less = {};
        const mk_model m = without(i);
        // Without the cause the states of the windows stay, unless the cause has some: then they
        // are found anew.
        const bool same = mk_model_state_count(&m) == mk_model_state_count(&best.point.model);
        if (fit(same ? best.point : runs.start(m), m, same ? REFIT_ITERATIONS : FULL_ITERATIONS,
                threads, less))
            causes[i].carried = compare(best, less);
    }
}

// Whether the data leave it open how large a cause is.
bool PredictionSearch::has_open_size(size_t cause) const
{
    const Candidate &c = causes[cause].cause;
    Hypothesis h;
    h.point.model = best.point.model;
    judge(best, h);
    const int effect = (int)(own_effects + cause);
    return !(h.point.model.effect[effect].spread[c.size] > 0.0) &&
           Search::relative_error(h, effect, c.size) >= 1.0;
}

// Causes that no longer carry over beside those found after them, or whose size is open. With L(i)
// the best model without cause i, all others fitted again, cause i stays if
//     carried is enough for as many causes as are asked, L(i) - L(best) being its gain ,
//     it closes a part of the gap that is worth naming ,
//     the standard error of its size is below the size.
// Of those that do not, the one of least gain goes, and the others are asked again: they may make
// up for it.
void PredictionSearch::leave_out_idle()
{
    while (!causes.empty() && !search.cancelled) {
        leave_out_each();
        size_t weakest = causes.size();
        double least = HUGE_VAL;
        for (size_t i = 0; i < causes.size(); i++) {
            if (!causes[i].without.fine)
                continue;
            const Carried &c = causes[i].carried;
            const double gain = penalised_nlml(causes[i].without) - penalised_nlml(best);
            const bool stays = carry_over::enough(c, (int)causes.size(), gain) &&
                               carry_over::worth_naming(c) && !has_open_size(i);
            if (!stays && gain < least)
                least = gain, weakest = i;
        }
        if (weakest == causes.size())
            return;
        eliminate(weakest);
    }
}

// A single cause is not asked again: all others were asked in its place.
void PredictionSearch::decide()
{
    constexpr int MOST_CHANGES = 3;
    leave_out_idle();
    for (int i = 0; i < MOST_CHANGES && causes.size() > 1 && reconsider_frictions(); i++)
        leave_out_idle();
}

void PredictionSearch::eliminate(size_t cause)
{
    suspects.push_back({causes[cause].cause, causes[cause].carried});
    best = std::move(causes[cause].without);
    causes.erase(causes.begin() + (std::ptrdiff_t)cause);
    runners_up.erase(runners_up.begin() + (std::ptrdiff_t)cause);
    // The way from a model with causes may lead to a base that was not reached from the given one.
    if (causes.empty() && penalised_nlml(best) < penalised_nlml(refit))
        refit = best;
}

// sum_j (MSE_j(less) - MSE_j(with)) / MSE_j(refit), or of a resample.
static double gain_of(const HeldOutFigures &with, const HeldOutFigures &less,
                      const HeldOutFigures &refit, int joints, const Times *times)
{
    double sum = 0.0;
    for (int j = 0; j < joints; j++)
        if (refit.square[j] > 0.0)
            sum += (mean_square(less, j, times) - mean_square(with, j, times)) /
                   mean_square(refit, j, nullptr);
    return sum;
}

// Of the windows' log ratios, those that are known, of a resample.
static double mean_of(const std::vector<double> &ratios, const Times &times)
{
    double sum = 0.0, n = 0.0;
    for (size_t w = 0; w < std::min(times.size(), ratios.size()); w++)
        if (!std::isnan(ratios[w]))
            sum += times[w] * ratios[w], n += times[w];
    return n > 0.0 ? sum / n : 0.0;
}

// Whether held-out data hardly notice.
static bool is_silent(const Interval &i)
{
    return i.low > -policy::WORSE_FOLD && i.high < policy::WORSE_FOLD;
}

// The cause without which held-out data are predicted as well within what chance would do, if any.
// With MSE_j the mean squared error of joint j, of the best model (with), without the cause (less)
// and refitted,
//     gain  = sum_j (MSE_j(less) - MSE_j(with)) / MSE_j(refit) ,
//     ratio = mean over windows of log(with / less) ,
// and 90 % intervals of both from resamples of logs and windows, it is confirmed if
//     the interval of gain is above 0 , or
//     gain > 0 and the interval of ratio is below 0 , or
//     no fold was worse, the likelihood leaves no doubt, and gain > policy::SHOWS a joint , or
//     the same, and both intervals are within policy::WORSE_FOLD of 0 .
// A few windows make up most of the squares, hence the second; two logs more are too few for an
// interval, hence the third; and what held-out data do not show, as a limit that they do not meet,
// they have no say against, hence the last. Of several that are not, the one of least gain.
size_t PredictionSearch::least_confirmed(const HeldOut &held) const
{
    const int joints = mk_model_joints(&base);
    HeldOutFigures before, with;
    size_t weakest = causes.size();
    if (held.figures(refit.point.model, before, nullptr) != MK_OK ||
        held.figures(best.point.model, with, nullptr) != MK_OK)
        return weakest;
    double least = HUGE_VAL;
    for (size_t i = 0; i < causes.size(); i++) {
        HeldOutFigures less;
        if (!causes[i].without.fine ||
            held.figures(causes[i].without.point.model, less, nullptr) != MK_OK)
            continue;
        const auto gain = [&](const Times *times) {
            return gain_of(with, less, before, joints, times);
        };
        const std::vector<double> ratios = carry_over::log_ratios(with, less);
        const std::vector<Interval> sure = intervals_of(with, [&](const Times &times) {
            return std::vector<double>{gain(&times), mean_of(ratios, times)};
        });
        // A few windows make up most of the squares: that it is better on the whole, and surely so
        // in the usual window, confirms it as well. So does that it clearly shows, of a cause that
        // has to be in all logs that were learnt from: two logs more are too few for an interval.
        const Carried &c = causes[i].carried;
        const double more = gain(nullptr);
        const bool everywhere =
            c.worse == 0 &&
            penalised_nlml(causes[i].without) - penalised_nlml(best) > policy::NO_DOUBT;
        const bool confirmed = sure[0].low > 0.0 || (more > 0.0 && sure[1].high < 0.0) ||
                               (everywhere && (more > policy::SHOWS * joints ||
                                               (is_silent(sure[0]) && is_silent(sure[1]))));
        if (!confirmed && more < least)
            least = more, weakest = i;
    }
    return weakest;
}

void PredictionSearch::claim(const HeldOut &held)
{
    for (size_t i; !search.cancelled && (i = least_confirmed(held)) < causes.size();) {
        eliminate(i);
        leave_out_each();
    }
    face_rivals();
}

// The runners-up of each cause in its place, beside all others.
void PredictionSearch::face_rivals()
{
    for (size_t i = 0; i < causes.size(); i++) {
        const RunFit &less = causes[i].without;
        for (const Candidate &rival : runners_up[i]) {
            mk_model m;
            RunFit faced;
            faced.cause = rival;
            if (!has_cause(rival) && less.fine && with_candidate(less.point.model, rival, m) &&
                fit(less.point, m, FULL_ITERATIONS, threads, faced) && plausible(faced))
                causes[i].rivals.push_back(std::move(faced));
        }
    }
}

double PredictionSearch::penalised_nlml(const RunFit &fit) const
{
    Hypothesis h;
    judge(fit, h);
    return h.penalised_nlml;
}

void PredictionSearch::judge(const RunFit &fit, Hypothesis &out) const
{
    judge_by_runs(runs, fit.point, fit.quadratic, out);
}

// Puts the figures of free runs where a fit by likelihood has its own: information, nlml and
//     L = nlml + k/2 log N .
void judge_by_runs(const FreeRuns &runs, const RunPoint &point, const RunQuadraticModel &quadratic,
                   Hypothesis &out)
{
    const QuadraticModel said = runs.information(point, quadratic);
    out.quadratic.information = said.information;
    out.quadratic.gradient = said.gradient;
    out.quadratic.nlml = said.nlml;
    out.free_count = (int)quadratic.free.size();
    const double numbers =
        (double)quadratic.free.size() + (double)own_parameters(point.model).size();
    out.penalised_nlml = said.nlml + 0.5 * numbers * std::log(runs.independent_errors());
}

} // namespace mk
