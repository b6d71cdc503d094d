// The search for what is missing, by likelihood: hypotheses are fitted, screened and compared.
//
// A hypothesis is a model with its fit (ident/fit.hpp). Models compare by
//     penalised nlml = nlml + k/2 log N ,
// half of the Bayesian information criterion (G. Schwarz 1978): k parameters, N = reading_count the
// independent readings (sum of w^2). Less is better; a difference of 1 is one of log likelihood.
//
// extend() goes through four stages, each with fewer candidates and more work for each: 1. linear
// candidates are screened by a score test (screen, trials.cpp); 2. the best of them and all others
// are tried for a few iterations (try_all, trials.cpp); 3. the best of those compete in full fits,
// process noise by process noise (compete, full_fits.cpp); 4. one hypothesis for each cause is
// left, best first.
//
// Work is counted in passes over the data, not timed: what is left out for want of it does not
// depend on the machine.
#include "explain/search/search.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <mutex>

#include "base/parallel.hpp"
#include "explain/evidence/innovations.hpp"
#include "ident/scale.hpp"

namespace mk
{

namespace
{

// Process noise from which fits come down, rad/s per sqrt(s).
constexpr double LOOSEST = 10.0;
// And at which candidates are tried, at least.
constexpr double TRIAL_NOISE = 0.01;
// Cost beyond that of a fit to the same data from which another one is no rival, in log likelihood
// before its readings' noise follows: with r^2 times the residuals' squares and N readings it is
//     N/2 (r^2 - 1)  before,  N ln r  after
// the noise was taken for r times as much, which is hundreds where the former is this.
constexpr double FAR_BEHIND = 1000.0;
// Loss of log likelihood a reading that no further fit makes up for.
constexpr double LOST_SHARE = 0.3;

} // namespace

// N is counted once: sum of w^2 over all readings of the data, the same for all hypotheses, so that
// their penalties compare.
Search::Search(std::vector<const FitLog *> logs_in, const SearchOptions &options_in)
    : logs(std::move(logs_in)), options(options_in)
{
    reading_count = independent_readings(logs);
    if (options.given)
        data = data_range(*options.given, logs);
}

bool Search::several_logs() const
{
    return std::any_of(logs.begin(), logs.end(),
                       [&](const FitLog *log) { return log->source != logs[0]->source; });
}

// Once true, `cancelled` stays true. May be called from any thread.
bool Search::tick(double done, const char *what)
{
    std::lock_guard<std::mutex> lock(talk);
    if (options.progress && !options.progress(options.progress_context, done, what))
        cancelled = true;
    return !cancelled;
}

FitOptions Search::fit_options() const
{
    FitOptions o;
    o.threads = options.threads;
    o.near = options.given;
    o.masses = options.masses;
    o.interval = options.interval;
    return o;
}

// k counts the fitted parameters and the spreads.
void Search::finish(Fit &fit, Hypothesis &h) const
{
    h.process_noise = fit.options.process_noise[0];
    h.penalised_nlml = penalised(h.quadratic, h.point.model, h.free_count);
}

// BIC / 2 = nlml + k ln(N) / 2, k the free parameters and the spreads of own values: a spread is
// estimated like any parameter.
double Search::penalised(const QuadraticModel &quadratic, const mk_model &model, int free) const
{
    return quadratic.nlml + penalty(free + (int)own_parameters(model).size());
}

// Continuation over the process noise from `first` down to TIGHTEST
// (Fit::continue_over_process_noise). False, with `out` of no use, where no process noise has a
// minimum. Ranges of the data, from which candidates start, are taken anew for the model.
bool Search::refit(const mk_model &model, const Hypothesis *from, Hypothesis &out,
                   double process_noise)
{
    FitOptions o = fit_options();
    o.max_passes = mk_model_hides_joint(&model) ? 1000.0 : 300.0;
    Fit fit(logs, o);
    out.point = from ? fit.adopt(from->point, model) : fit.start(model);
    std::vector<int> free = fitted_parameters(model);
    out.free_count = (int)free.size();
    data = data_range(model, logs);
    // From a fit: ten times its process noise, so that the states may find another place, or as
    // much as is said. Anew: the loosest.
    const double first =
        from ? std::min(LOOSEST, std::max({10.0 * from->process_noise, process_noise, 0.1}))
             : LOOSEST;
    bool fitted = fit.continue_over_process_noise(out.point, free, first, TIGHTEST, out.quadratic);
    work += fit.work_done;
    if (!fitted)
        return false;
    finish(fit, out);
    return true;
}

// One solve at one process noise: cheap, and comparable with `from` only where that was fitted at
// the same one. There it is given up where it stays far behind. False where it fails.
bool Search::refit_at(const mk_model &model, const Hypothesis &from, double process_noise,
                      Hypothesis &out, double worth)
{
    FitOptions o = fit_options();
    o.max_passes = 300.0;
    o.worth = worth;
    if (process_noise == from.process_noise)
        o.worth = std::min(worth, from.point.cost + FAR_BEHIND);
    Fit fit(logs, o);
    out.point = fit.adopt(from.point, model);
    std::vector<int> free = fitted_parameters(model);
    out.free_count = (int)free.size();
    bool fitted = fit.solve_at(out.point, free, process_noise, out.quadratic);
    work += fit.work_done;
    if (fitted)
        finish(fit, out);
    return fitted;
}

// No parameter is free: states, noise and process noise alone. The process noise falls by threes
// from `most` as long as nlml falls with it.
// `out` has the point of least nlml. Its penalised nlml is not set: free_count is that of the
// model, but nothing was fitted that a penalty would be for. False where already the first process
// noise cannot be solved.
bool Search::follow(const mk_model &model, const Hypothesis *from, double most, Hypothesis &out)
{
    FitOptions o = fit_options();
    o.max_passes = 100.0;
    Fit fit(logs, o);
    FitPoint point = from ? fit.adopt(from->point, model) : fit.start(model);
    out.free_count = (int)fitted_parameters(model).size();
    bool any = false;
    for (double process_noise = std::max(most, TIGHTEST); process_noise > 0.9 * TIGHTEST;
         process_noise /= 3.0) {
        QuadraticModel quadratic;
        if (!fit.solve_at(point, {}, process_noise, quadratic) ||
            (any && quadratic.nlml >= out.quadratic.nlml))
            break;
        any = true;
        out.point = point;
        out.quadratic = quadratic;
        out.process_noise = process_noise;
    }
    work += fit.work_done;
    return any;
}

// The penalised nlml of h rises by EVEN (below) at most: other results are not taken.
void Search::polish(Hypothesis &h, bool process_noise_too)
{
    FitOptions o = fit_options();
    o.max_iterations = 25;
    o.tolerance = 1e-2;
    o.max_passes = 600.0;
    // One shooting interval a log has no process noise to tighten step by step: it comes to its
    // optimum at once.
    if (mk_model_hides_joint(&h.point.model))
        o.max_iterations = 60;
    Fit fit(logs, o);
    polish(fit, h, process_noise_too);
    work += fit.work_done;
}

void Search::polish(Fit &fit, Hypothesis &h, bool process_noise_too) const
{
    FitPoint point = h.point;
    QuadraticModel quadratic;
    std::vector<int> free = fitted_parameters(point.model);
    // The process noise is part of the estimate: a coarser one would leave something for a next
    // cause to gain.
    auto try_process_noise = [&](double process_noise, double slack) {
        if (process_noise < 0.9 * TIGHTEST || process_noise > 1.1 * LOOSEST ||
            !fit.solve_at(point, free, process_noise, quadratic))
            return false;
        double penalised_nlml = penalised(quadratic, point.model, (int)free.size());
        bool better = penalised_nlml < h.penalised_nlml + slack;
        if (better) {
            h.point = point;
            h.quadratic = quadratic;
            h.process_noise = process_noise;
            h.penalised_nlml = penalised_nlml;
        }
        return better;
    };
    // A one-dimensional search over the process noise D by factors of three, from where h is.
    // Downwards first, as long as penalised nlml stays within EVEN of the least seen; upwards where
    // there was nothing below.
    try_process_noise(h.process_noise, 0.0);
    if (!process_noise_too)
        return;
    // Where the motion is chaotic, a trajectory of a whole log leads nowhere.
    if (mk_model_hides_joint(&h.point.model)) {
        fit.options.hidden_interval = 1.0;
        point = fit.start(h.point.model);
        std::copy(std::begin(h.point.noise), std::end(h.point.noise), std::begin(point.noise));
        try_process_noise(0.03, 0.0);
        return;
    }
    // Of process noises that the data cannot tell apart the least is meant: it leaves nothing to
    // explain.
    constexpr double EVEN = 0.5;
    bool lower = false;
    double least = h.penalised_nlml;
    while (try_process_noise(h.process_noise / 3.0, least + EVEN - h.penalised_nlml)) {
        least = std::min(least, h.penalised_nlml);
        lower = true;
    }
    point = h.point;
    while (!lower && try_process_noise(h.process_noise * 3.0, 0.0))
        continue;
}

// k/2 log N.
double Search::penalty(int parameters) const
{
    return 0.5 * parameters * std::log(std::max(reading_count, 2.0));
}

// A model that follows its data most likely lacks nothing that stores or strikes; of what remains,
// the mildest start will do.
bool Search::is_slow(const std::vector<Candidate> &all, size_t i)
{
    const bool first = i == 0 || !same_cause(all[i - 1], all[i]);
    return !first || all[i].effect->state_count > 0;
}

// Of a candidate that is not linear.
bool Search::worth_trying(const std::vector<Candidate> &all, size_t i, const ExtendOptions &how)
{
    if (how.only)
        return true;
    return is_slow(all, i) ? how.thorough : !how.slow_only;
}

// Of a trial: one thread, since trials run side by side; a tolerance of 0.3 in log likelihood,
// below any threshold that its gain is held against.
FitOptions Search::trial_options(double process_noise) const
{
    FitOptions loose = fit_options();
    loose.threads = 1;
    loose.tolerance = 0.3;
    loose.max_passes = 150.0;
    for (double &d : loose.process_noise)
        d = process_noise;
    return loose;
}

// No fit but that of the base at its minimum (screen, trials.cpp).
std::vector<double> Search::promises(const Hypothesis &base, const std::vector<Candidate> &some)
{
    const FitOptions loose = trial_options(std::max(base.process_noise, TRIAL_NOISE));
    std::vector<double> gain(some.size(), -HUGE_VAL);
    screen(at_minimum(base, loose), loose, some, gain);
    return gain;
}

// The four stages of the head. Gains are in log likelihood, after the penalty, at the process noise
// of `loose`. Backlash has a search of its own (try_backlash) and meets the others in the full
// fits.
std::vector<Hypothesis> Search::extend(const Hypothesis &base, const ExtendOptions &how)
{
    const std::vector<Candidate> all = candidates_for(base, how);
    tried_count = (int)all.size();
    // Full fits begin at a process noise of 0.1; unless what is missing is small.
    const double small = how.process_noise > 0.0 ? how.process_noise : base.process_noise;
    const FitOptions loose =
        trial_options(how.small ? small : std::max(base.process_noise, TRIAL_NOISE));
    const Hypothesis start = at_minimum(base, loose);
    std::vector<double> gain(all.size(), -HUGE_VAL);
    if (!how.slow_only)
        screen(start, loose, all, gain);
    std::vector<Trial> trials;
    std::vector<Candidate> backlashes;
    for (size_t i : worth_a_trial(all, gain, how)) {
        if (is_backlash(all[i].effect)) {
            backlashes.push_back(all[i]);
            continue;
        }
        trials.emplace_back();
        trials.back().candidate = all[i];
    }
    try_all(start, loose, trials);
    try_backlash(start, loose, backlashes, how, trials);
    return compete(base, how.acceptance, how.small ? small : std::max(base.process_noise, 0.1),
                   worth_a_full_fit(trials, how));
}

std::vector<Hypothesis> Search::best_of_each(std::vector<Hypothesis> all)
{
    std::vector<Hypothesis> one_each;
    std::stable_sort(all.begin(), all.end(), [](const Hypothesis &a, const Hypothesis &b) {
        return a.penalised_nlml < b.penalised_nlml;
    });
    for (Hypothesis &h : all)
        if (std::none_of(one_each.begin(), one_each.end(),
                         [&](const Hypothesis &o) { return same_cause(o.added, h.added); }))
            one_each.push_back(std::move(h));
    return one_each;
}

// `only`: those, whatever kind they are, and none of them by its slope: all are tried.
std::vector<Candidate> Search::candidates_for(const Hypothesis &base,
                                              const ExtendOptions &how) const
{
    std::vector<Candidate> all = how.only ? *how.only : candidates(base.point.model, data);
    const auto other_kind = [&](const Candidate &c) {
        return is_backlash(c.effect) != (how.kind == Kind::backlash);
    };
    if (!how.only)
        all.erase(std::remove_if(all.begin(), all.end(), other_kind), all.end());
    for (Candidate &c : all)
        c.linear = c.linear && !how.only;
    return all;
}

// The base once more at the process noise that candidates are tried at: at its minimum the base's
// own parameters have no slope, and what a trial gains is the candidate's.
Hypothesis Search::at_minimum(const Hypothesis &base, const FitOptions &loose)
{
    Hypothesis start = base;
    Fit fit(logs, loose);
    fit.options.threads = options.threads;
    fit.minimise(start.point, fitted_parameters(start.point.model));
    work += fit.work_done;
    return start;
}

// Numbers of those that promise anything, the most promising first.
static std::vector<size_t> by_promise(const std::vector<double> &gain)
{
    std::vector<size_t> order;
    for (size_t i = 0; i < gain.size(); i++)
        if (std::isfinite(gain[i]))
            order.push_back(i);
    std::sort(order.begin(), order.end(), [&](size_t a, size_t b) { return gain[a] > gain[b]; });
    return order;
}

// Linear candidates by what their slope promises, the best start of each, the most promising first;
// and all others.
// Three classes have room of their own: 0, effects of the catalogue; 1, terms of the library; 2,
// effects with states. A resonance that promises less than what is asked for is left out where what
// is missing is small. Candidates that are not linear have no promise; worth_trying() chooses them.
std::vector<size_t> Search::worth_a_trial(const std::vector<Candidate> &all,
                                          const std::vector<double> &gain,
                                          const ExtendOptions &how) const
{
    constexpr double LEAST_SHARE = 0.02; // of the best promise: at most the next thing to be found
    const std::vector<size_t> order = by_promise(gain);
    std::vector<size_t> tries;
    const double least_promise = order.empty() ? 0.0 : LEAST_SHARE * gain[order[0]];
    // Terms of the library are many, starts of a resonance too; they must not crowd out the rest.
    int room[3] = {options.full_fits + 2, options.full_fits / 2, 3};
    for (size_t i : order) {
        if (gain[i] < least_promise && !how.only)
            break;
        const bool resonance = all[i].effect->state_count > 0;
        const bool faint = resonance && how.small && gain[i] < how.least;
        int &left = room[resonance ? 2 : is_library(all[i].effect)];
        const auto same = [&](size_t k) { return same_start(all[k], all[i]); };
        if (faint || left == 0 || std::any_of(tries.begin(), tries.end(), same))
            continue;
        tries.push_back(i);
        left--;
    }
    for (size_t i = 0; i < all.size(); i++)
        if (!all[i].linear && worth_trying(all, i, how))
            tries.push_back(i);
    return tries;
}

// The trials that came furthest, best first, one for each start: no more than options.full_fits,
// and of terms of the library no more than MOST_TERMS.
// A few iterations from a start far off do not show everything: a trial that is BEHIND the base is
// left out from the third one on only. Where what is missing is small (`how.small`) it has to have
// gained how.least. One that lost LOST_SHARE a reading is left out in any case.
std::vector<Search::Trial> Search::worth_a_full_fit(std::vector<Trial> &trials,
                                                    const ExtendOptions &how) const
{
    constexpr int MOST_TERMS = 3;
    constexpr double BEHIND = 3.0; // log likelihood behind the base, once two are in
    std::sort(trials.begin(), trials.end(),
              [](const Trial &a, const Trial &b) { return a.gain > b.gain; });
    std::vector<Trial> chosen;
    int terms = 0;
    for (Trial &t : trials) {
        if ((int)chosen.size() >= options.full_fits)
            break;
        if (!std::isfinite(t.gain) || t.gain < -LOST_SHARE * reading_count)
            continue; // could not even be started, or is lost
        const bool hopeless =
            how.small ? t.gain < how.least : t.gain < -BEHIND && chosen.size() >= 2;
        const auto same = [&](const Trial &f) { return same_start(f.candidate, t.candidate); };
        const bool term = is_library(t.candidate.effect);
        if (hopeless || (term && terms >= MOST_TERMS) ||
            std::any_of(chosen.begin(), chosen.end(), same))
            continue;
        terms += term;
        chosen.push_back(std::move(t));
    }
    return chosen;
}

std::vector<Candidate> Search::starts(const mk_model &model, const char *effect, int joint) const
{
    std::vector<Candidate> some;
    for (const Candidate &c : candidates(model, data))
        if (c.joint == joint && std::strcmp(c.effect->name, effect) == 0)
            some.push_back(c);
    return some;
}

// Nothing is left to be explained: the process noise ended at its least, one-step predictions leave
// white noise, and the fitted noise of the readings is near their scatter.
bool Search::complete(const Hypothesis &h) const
{
    constexpr double FLOOR = 1.5 * TIGHTEST;
    // What stays the same from row to row, as a wrong zero, does not show in how one row follows
    // from another.
    constexpr double MORE = 1.5;
    return h.process_noise <= FLOOR && leaves_white_noise(logs, h) &&
           beyond_scatter(logs, h.point.noise) < MORE;
}

// One interval a log has one node, whose state and the parameters are all that the trajectory of
// the whole log depends on: a fit that is near the scatter there misses nothing that shows.
bool Search::meets_readings(const Hypothesis &h) const
{
    constexpr double MORE = 1.5;
    return std::all_of(h.point.nodes.begin(), h.point.nodes.end(),
                       [](const ShootingNodes &n) { return n.row.size() == 1; }) &&
           beyond_scatter(logs, h.point.noise) < MORE;
}

// The size of the added effect (its parameter number added.size) has gone to an end of its range:
// off, at its least or largest value, or beyond the candidate's own limit. In parts of the size's
// usual value, `off` is below 1e-7.
bool Search::discredited(const Hypothesis &h)
{
    const mk_effect_use &last = h.point.model.effect[h.point.model.effect_count - 1];
    const mk_parameter_info &size = mk_effect(last.index)->parameter[h.added.size];
    const double value = last.value[h.added.size], unit = std::max(size.initial, 1e-6);
    bool off = size.min == 0.0 && value < 1e-7 * unit;
    bool at_end = (size.min != 0.0 && value <= size.min) || value >= size.max;
    return off || at_end || std::fabs(value) > h.added.most;
}

// Whether shape k of a cause, the model's last effect, is within FAR times the range of its starts.
// Of the shape s_k and the range [low, high] of its starts, true if
//     low / FAR <= s_k <= high FAR ,   s_k / |size| in the place of s_k if both scale with torque .
// A centre (MK_FIT_CENTRE) is held against AWAY. What is fixed, whole numbers, phases, and shapes
// of either sign have no order of magnitude: true.
static bool is_near_starts(const mk_model &model, const Candidate &cause, int k,
                           const std::vector<Candidate> &starts)
{
    // FAR: factor beyond all starts of a cause. AWAY: rad.
    constexpr double FAR = 3.0, AWAY = 12.0;
    const mk_effect_use &use = model.effect[model.effect_count - 1];
    const mk_parameter_info &info = cause.effect->parameter[k];
    // Turns of the joint: a spring that rests that far away is a constant torque.
    if (info.fit == MK_FIT_CENTRE)
        return std::fabs(use.value[k]) <= AWAY;
    if (info.fit != MK_FIT_FREE || info.min < 0.0)
        return true;
    const int first = mk_model_parameter_count(&model) - cause.effect->parameter_count;
    const bool by_size =
        scales_with_torque(model, first + cause.size) && scales_with_torque(model, first + k);
    const auto shape_of = [&](const double *value) {
        return by_size ? value[k] / std::fabs(value[cause.size]) : value[k];
    };
    double low = HUGE_VAL, high = 0.0;
    for (const Candidate &c : starts)
        if (same_cause(c, cause))
            low = std::min(low, shape_of(c.value)), high = std::max(high, shape_of(c.value));
    const double now = shape_of(use.value);
    const bool known = low > 0.0 && low < HUGE_VAL;
    return !known || (now >= low / FAR && now <= high * FAR);
}

// Whether a fit has left the cause what it is: the size has one, and no shape has gone far beyond
// where the search for it starts. A law whose shape has is another one: a cable that never yields a
// spring, a friction that changes over hours a constant. A shape that scales with torque as the
// size does counts by the size: bristles that bend by half a turn before they slide are a cable,
// however strong.
bool Search::plausible(const mk_model &model, const Candidate &cause,
                       const std::vector<Candidate> &starts)
{
    Hypothesis h;
    h.added = cause;
    h.point.model = model;
    if (discredited(h))
        return false;
    for (int k = 0; k < cause.effect->parameter_count; k++)
        if (k != cause.size && !is_near_starts(model, cause, k, starts))
            return false;
    return true;
}

// Standard error of a parameter over its value, from the covariance of the fit (Cramer-Rao). 0
// where it is not fitted. Of an amplitude with a phase, or a stiffness with a centre, these are
// held: a sin(q + b) vanishes along its own direction, in which base parameters that stand in for
// one of its two components say nothing of the other.
double Search::relative_error(const Hypothesis &h, int effect, int parameter)
{
    const mk_model &m = h.point.model;
    const mk_effect_info &info = *mk_effect(m.effect[effect].index);
    int first = mk_plant(m.plant)->parameter_count;
    for (int e = 0; e < effect; e++)
        first += mk_effect(m.effect[e].index)->parameter_count;
    const std::vector<int> all = fitted_parameters(m);
    std::vector<int> free;
    std::vector<long> kept;
    for (size_t i = 0; i < all.size(); i++) {
        const int k = all[i] - first;
        const bool own = k >= 0 && k < info.parameter_count;
        if (parameter == 0 && own &&
            (info.parameter[k].fit == MK_FIT_ANGLE || info.parameter[k].fit == MK_FIT_CENTRE))
            continue;
        free.push_back(all[i]);
        kept.push_back((long)i);
    }
    const auto place = std::find(free.begin(), free.end(), first + parameter);
    if (place == free.end())
        return 0.0;
    QuadraticModel held;
    held.information = h.quadratic.information(kept, kept);
    const long i = place - free.begin();
    const double error = std::sqrt(Fit::covariance(m, held, free)(i, i));
    const double relative = error / std::fabs(m.effect[effect].value[parameter]);
    return std::isfinite(relative) ? relative : HUGE_VAL;
}

} // namespace mk
