#include "explain/search.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <mutex>

#include "base/parallel.hpp"

namespace mk
{

namespace
{

constexpr double LOOSEST = 10.0, TIGHTEST = 1e-4; // drift, rad/s per sqrt(s)
constexpr double TIGHTER = 1.0 / 30.0;            // from one drift to the next
constexpr int QUICK_ITERATIONS = 5;
constexpr double FAR_BEHIND = 40.0; // log likelihood at the same drift

bool same_place(const Candidate &a, const Candidate &b)
{
    if (a.effect != b.effect || a.joint != b.joint)
        return false;
    // Terms of the library are causes of their own.
    int term = mk_effect_parameter_index(a.effect, "term");
    return term < 0 || a.value[term] == b.value[term];
}

// A point with the states of further effects, at rest; the others stay as they were fitted.
FitPoint with_states(const FitPoint &from, const mk_model &model)
{
    FitPoint point = from;
    point.model = model;
    const long all = mk_model_state_count(&model), joints = mk_model_joints(&model);
    for (FitNodes &nodes : point.nodes) {
        const long known = nodes.x.rows();
        nodes.x.conservativeResize(all, Eigen::NoChange);
        for (long i = 0; i < nodes.x.cols() && known < all; i++) {
            double rest[MK_MAX_STATES];
            mk_model_initial_state(&model, &nodes.x(0, i), &nodes.x(joints, i), rest);
            for (long s = known; s < all; s++)
                nodes.x(s, i) = rest[s];
        }
    }
    return point;
}

// Starts of the same cause that are worth a try each: resonances apart.
bool same_start(const Candidate &a, const Candidate &b)
{
    bool resonance = a.effect->state_count > 0;
    return same_place(a, b) &&
           !(resonance && std::fabs(std::log(a.value[0] / b.value[0])) > std::log(1.3));
}

} // namespace

Search::Search(std::vector<const FitLog *> logs_in, const SearchOptions &options_in)
    : logs(std::move(logs_in)), options(options_in)
{
    for (const FitLog *log : logs)
        for (int j = 0; j < log->joints; j++)
            for (double w : log->weight[j])
                reading_count += w * w;
}

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
    return o;
}

void Search::finish(Fit &fit, Hypothesis &h) const
{
    h.drift = fit.options.drift[0];
    h.score = h.picture.evidence + 0.5 * h.free_count * std::log(std::max(reading_count, 2.0));
}

bool Search::refit(const mk_model &model, const Hypothesis *from, Hypothesis &out)
{
    FitOptions o = fit_options();
    o.max_passes = 1000.0;
    Fit fit(logs, o);
    out.point = from ? fit.adopt(from->point, model) : fit.start(model);
    std::vector<int> free = fitted_parameters(model);
    out.free_count = (int)free.size();
    data = data_range(model, logs);
    double first = from ? std::min(LOOSEST, std::max(10.0 * from->drift, 0.1)) : LOOSEST;
    bool fitted = fit.descend(out.point, free, first, TIGHTEST, out.picture);
    work += fit.work_done;
    if (!fitted)
        return false;
    finish(fit, out);
    return true;
}

bool Search::refit_at(const mk_model &model, const Hypothesis &from, double drift, Hypothesis &out)
{
    FitOptions o = fit_options();
    o.max_passes = 300.0;
    Fit fit(logs, o);
    out.point = fit.adopt(from.point, model);
    std::vector<int> free = fitted_parameters(model);
    out.free_count = (int)free.size();
    bool fitted = fit.settle(out.point, free, drift, out.picture);
    work += fit.work_done;
    if (fitted)
        finish(fit, out);
    return fitted;
}

void Search::polish(Hypothesis &h, bool drift_too)
{
    FitOptions o = fit_options();
    o.max_iterations = 25;
    o.tolerance = 1e-2;
    o.max_passes = 600.0;
    // One stretch a log has no drift to tighten step by step: it comes to its optimum at once.
    if (mk_model_hides_joint(&h.point.model))
        o.max_iterations = 60;
    Fit fit(logs, o);
    polish(fit, h, drift_too);
    work += fit.work_done;
}

void Search::polish(Fit &fit, Hypothesis &h, bool drift_too) const
{
    FitPoint point = h.point;
    FitPicture picture;
    std::vector<int> free = fitted_parameters(point.model);
    // The drift is part of the estimate: a coarser one would leave something for a next cause to
    // gain.
    auto try_drift = [&](double drift) {
        if (drift < 0.9 * TIGHTEST || drift > 1.1 * LOOSEST ||
            !fit.settle(point, free, drift, picture))
            return false;
        double score = picture.evidence + penalty((int)free.size());
        bool better = score < h.score;
        if (better) {
            h.point = point;
            h.picture = picture;
            h.drift = drift;
            h.score = score;
        }
        return better;
    };
    try_drift(h.drift);
    if (!drift_too)
        return;
    // Where the motion is chaotic, a trajectory of a whole log leads nowhere.
    for (double stretch : {4.0, 1.0}) {
        if (!mk_model_hides_joint(&h.point.model))
            break;
        fit.options.hidden_stretch = stretch;
        point = fit.start(h.point.model);
        std::copy(std::begin(h.point.noise), std::end(h.point.noise), std::begin(point.noise));
        try_drift(0.03);
    }
    if (mk_model_hides_joint(&h.point.model))
        return;
    bool lower = false;
    while (try_drift(h.drift / 3.0))
        lower = true;
    point = h.point;
    while (!lower && try_drift(h.drift * 3.0))
        continue;
}

// Gain in log likelihood that each linear candidate promises, from the slope of the cost where the
// candidate is next to nothing. Many are looked at in one pass.
void Search::screen(const Hypothesis &base, const FitOptions &loose,
                    const std::vector<Candidate> &all, std::vector<double> &gain)
{
    // What has states is looked at alone.
    constexpr size_t TOGETHER = 6;
    std::vector<std::vector<size_t>> group;
    for (size_t i = 0; i < all.size(); i++) {
        if (!all[i].linear)
            continue;
        bool alone = all[i].effect->state_count > 0;
        if (alone || group.empty() || group.back().size() == TOGETHER ||
            all[group.back()[0]].effect->state_count > 0)
            group.emplace_back();
        group.back().push_back(i);
    }
    const size_t groups = group.size();
    const std::vector<int> own = fitted_parameters(base.point.model);
    std::atomic<size_t> done{0};
    std::vector<double> spent(groups, 0.0);
    Fit here(logs, loose);
    here.options.threads = options.threads;
    here.coarsen(base.point);
    work += here.work_done;
    parallel_for(options.threads, groups, [&](size_t g) {
        mk_model model;
        std::vector<size_t> members;
        std::vector<int> free;
        FitPicture p;
        Fit fit(logs, loose);
        fit.coarsen_as(here);
        // So little of each that the trajectory stays where it is.
        for (double share = 1e-3; share > 1e-13; share *= 1e-3) {
            model = base.point.model;
            members.clear();
            for (size_t k : group[g]) {
                Candidate c = all[k];
                c.value[c.size] *= share;
                mk_model more;
                if (with_candidate(model, c, more)) {
                    model = more;
                    members.push_back(k);
                }
            }
            FitPoint point = with_states(base.point, model);
            free = fitted_parameters(model);
            p = fit.picture(point, free);
            if (p.finite && std::fabs(p.cost - base.point.cost) < 0.5)
                break;
        }
        spent[g] = fit.work_done;
        if (!p.finite)
            return;
        int first = mk_plant(model.plant)->parameter_count;
        for (int e = 0; e < model.effect_count; e++) {
            int count = mk_effect(model.effect[e].index)->parameter_count;
            int member = e - base.point.model.effect_count;
            if (member >= 0) {
                const Candidate &c = all[members[(size_t)member]];
                // The shape of a resonance has no slope where it is next to nothing.
                bool size_only = c.effect->state_count > 0;
                std::vector<int> wanted = own;
                for (int number : free)
                    if (number >= first && number < first + count &&
                        (!size_only || number == first + c.size))
                        wanted.push_back(number);
                gain[members[(size_t)member]] =
                    promised(p, free, wanted) - penalty((int)(wanted.size() - own.size()));
            }
            first += count;
        }
        tick(0.3 * (double)++done / (double)groups, "screening causes");
    });
    for (double one : spent)
        work += one;
}

double Search::penalty(int parameters) const
{
    return 0.5 * parameters * std::log(std::max(reading_count, 2.0));
}

// Second-order reduction of the cost if only the wanted parameters move.
double Search::promised(const FitPicture &p, const std::vector<int> &free,
                        const std::vector<int> &wanted)
{
    std::vector<long> place;
    for (int number : wanted)
        place.push_back(std::find(free.begin(), free.end(), number) - free.begin());
    long n = (long)place.size();
    Eigen::MatrixXd h(n, n);
    Eigen::VectorXd g(n);
    for (long i = 0; i < n; i++) {
        g(i) = p.gradient(place[(size_t)i]);
        for (long k = 0; k < n; k++)
            h(i, k) = p.information(place[(size_t)i], place[(size_t)k]);
    }
    // Scaled to unit diagonal with a trace of damping: candidates may be collinear with the base.
    Eigen::VectorXd root = h.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    Eigen::MatrixXd unit = root.asDiagonal() * h * root.asDiagonal();
    unit.diagonal().array() += 1e-9;
    Eigen::VectorXd scaled = root.asDiagonal() * g;
    return 0.5 * scaled.dot(unit.ldlt().solve(scaled));
}

// A few iterations of a full fit from a candidate's start.
bool Search::try_out(const Hypothesis &base, const FitOptions &loose, const Candidate &candidate,
                     double reference, Trial &trial)
{
    mk_model model;
    if (!with_candidate(base.point.model, candidate, model))
        return false;
    std::vector<int> free = fitted_parameters(model);
    FitPoint p;
    // A trajectory that is chaotic is cut into pieces that are not.
    bool contact = candidate.effect->event_count > 0 && candidate.effect->state_count > 0;
    double best = HUGE_VAL;
    for (double stretch : {loose.hidden_stretch, 2.0}) {
        Fit fit(logs, loose);
        fit.options.hidden_stretch = stretch;
        // A resonance goes from one optimum to the next.
        if (candidate.linear && candidate.effect->state_count > 0)
            fit.options.max_iterations *= 2;
        FitPoint trial_point = fit.adopt(base.point, model);
        if (fit.minimise(trial_point, free) && trial_point.cost < best) {
            best = trial_point.cost;
            p = std::move(trial_point);
        }
        trial.work += fit.work_done;
        if (!contact)
            break;
    }
    if (!std::isfinite(best))
        return false;
    int extra = (int)(free.size() - fitted_parameters(base.point.model).size());
    double gain = reference - p.cost - penalty(extra);
    if (!(gain > trial.gain))
        return false;
    trial.gain = gain;
    trial.candidate = candidate;
    trial.point = std::move(p);
    return true;
}

// A model that follows its data most likely lacks nothing that stores or strikes; of what remains,
// the mildest start will do.
bool Search::worth_trying(const std::vector<Candidate> &all, size_t i)
{
    bool first = i == 0 || !same_place(all[i - 1], all[i]);
    return first && all[i].effect->state_count == 0;
}

std::vector<Hypothesis> Search::extend(const Hypothesis &base, const ExtendOptions &how)
{
    std::vector<Candidate> all = how.only ? *how.only : candidates(base.point.model, data);
    for (Candidate &c : all)
        c.linear = c.linear && !how.only;
    tried_count = (int)all.size();
    FitOptions loose = fit_options();
    loose.threads = 1;
    for (double &d : loose.drift)
        d = how.small ? base.drift : std::max(base.drift, 0.01);
    loose.max_iterations = QUICK_ITERATIONS;
    loose.tolerance = 0.3;
    loose.max_passes = 150.0;
    Hypothesis start = base;
    {
        Fit fit(logs, loose);
        fit.options.threads = options.threads;
        fit.minimise(start.point, fitted_parameters(start.point.model));
        work += fit.work_done;
    }
    std::vector<double> gain(all.size(), -HUGE_VAL);
    screen(start, loose, all, gain);

    // Linear candidates: the best start of each, the most promising first. All others are tried.
    std::vector<size_t> order, tries;
    for (size_t i = 0; i < all.size(); i++)
        if (std::isfinite(gain[i]))
            order.push_back(i);
    std::sort(order.begin(), order.end(), [&](size_t a, size_t b) { return gain[a] > gain[b]; });
    // Terms of the library are many, starts of a resonance too; they must not crowd out the rest.
    int room[3] = {options.finalists + 2, options.finalists / 2, 3};
    for (size_t i : order) {
        bool same = std::any_of(tries.begin(), tries.end(),
                                [&](size_t k) { return same_start(all[k], all[i]); });
        const bool resonance = all[i].effect->state_count > 0;
        if (resonance && how.small && gain[i] < how.least)
            continue;
        int &left = room[resonance ? 2 : is_library(all[i].effect)];
        if (!same && left > 0) {
            tries.push_back(i);
            left--;
        }
    }
    for (size_t i = 0; i < all.size(); i++)
        if (!all[i].linear && (how.only || how.thorough || worth_trying(all, i)))
            tries.push_back(i);
    // What takes longest goes first, so that no thread is left with it alone at the end.
    std::stable_sort(tries.begin(), tries.end(), [&](size_t a, size_t b) {
        return all[a].effect->event_count + all[a].effect->state_count >
               all[b].effect->event_count + all[b].effect->state_count;
    });
    std::vector<Trial> trials(tries.size());
    std::atomic<size_t> done{0};
    parallel_for(options.threads, tries.size(), [&](size_t k) {
        if (cancelled)
            return;
        try_out(start, loose, all[tries[k]], start.point.cost, trials[k]);
        tick(0.3 + 0.4 * (double)++done / (double)tries.size(), "trying causes");
    });
    for (const Trial &t : trials)
        work += t.work;
    std::sort(trials.begin(), trials.end(),
              [](const Trial &a, const Trial &b) { return a.gain > b.gain; });
    std::vector<Trial> finalists;
    int terms = 0; // of the library
    for (Trial &t : trials) {
        if (!std::isfinite(t.gain))
            continue; // could not even be started
        bool seen = false;
        for (const Trial &f : finalists)
            seen = seen || same_start(f.candidate, t.candidate);
        bool hopeless = how.small ? t.gain < how.least : t.gain < -3.0 && finalists.size() >= 2;
        bool library = is_library(t.candidate.effect);
        bool full = (int)finalists.size() >= options.finalists || (library && terms >= 3);
        if (seen || hopeless || full)
            continue;
        terms += library;
        finalists.push_back(std::move(t));
    }
    return compete(how.small ? base.drift : std::max(base.drift, 0.1), finalists);
}

bool Search::vanished(const Hypothesis &h)
{
    const mk_effect_use &last = h.point.model.effect[h.point.model.effect_count - 1];
    const mk_parameter_info &size = mk_effect(last.index)->parameter[h.added.size];
    return size.min == 0.0 && last.value[h.added.size] < 1e-7 * std::max(size.initial, 1e-6);
}

// Full fits, drift by drift side by side: who falls far behind at a drift is not carried on.
std::vector<Hypothesis> Search::compete(double first, std::vector<Trial> &finalists)
{
    struct Runner {
        Hypothesis best;
        FitPoint point;
        std::vector<int> free;
        double now = HUGE_VAL, work = 0.0;
        int worse = 0;
        bool running = true;
    };
    std::vector<Runner> runners(finalists.size());
    for (size_t i = 0; i < runners.size(); i++) {
        runners[i].best.added = finalists[i].candidate;
        runners[i].best.score = HUGE_VAL;
        runners[i].point = std::move(finalists[i].point);
        runners[i].free = fitted_parameters(runners[i].point.model);
        runners[i].best.free_count = (int)runners[i].free.size();
    }
    double stages = std::log(first / TIGHTEST) / std::log(1.0 / TIGHTER) + 1.0;
    int stage = 0;
    for (double drift = first; drift > 0.9 * TIGHTEST && !cancelled; drift *= TIGHTER, stage++) {
        // Threads that have no runner of their own help the others.
        const auto running = std::count_if(runners.begin(), runners.end(),
                                           [](const Runner &r) { return r.running; });
        const int helpers = std::max(1, options.threads / std::max(1, (int)running));
        parallel_for(options.threads, runners.size(), [&](size_t i) {
            Runner &r = runners[i];
            if (!r.running)
                return;
            FitOptions o = fit_options();
            o.max_iterations = mk_model_event_count(&r.point.model) > 1 ? 6 : 20;
            o.max_passes = 400.0;
            o.threads = helpers;
            Fit fit(logs, o);
            FitPicture p;
            r.running = fit.settle(r.point, r.free, drift, p);
            r.work += fit.work_done;
            r.now = r.running ? p.evidence + penalty((int)r.free.size()) : HUGE_VAL;
            if (r.now < r.best.score) {
                r.best.point = r.point;
                r.best.picture = p;
                r.best.drift = drift;
                r.best.score = r.now;
                r.worse = 0;
            } else if (r.now > r.best.score + 2.0) {
                r.running = r.running && ++r.worse < 2;
            }
        });
        double leader = HUGE_VAL;
        for (const Runner &r : runners)
            leader = std::min(leader, r.now);
        for (Runner &r : runners)
            r.running = r.running && r.now < leader + FAR_BEHIND;
        tick(0.7 + 0.3 * (stage + 1) / stages, "fitting causes");
    }
    std::vector<Hypothesis> out;
    for (Runner &r : runners) {
        work += r.work;
        if (std::isfinite(r.best.score) && !vanished(r.best))
            out.push_back(std::move(r.best));
    }
    std::sort(out.begin(), out.end(),
              [](const Hypothesis &a, const Hypothesis &b) { return a.score < b.score; });
    std::vector<Hypothesis> one_each;
    for (Hypothesis &h : out)
        if (std::none_of(one_each.begin(), one_each.end(),
                         [&](const Hypothesis &o) { return same_place(o.added, h.added); }))
            one_each.push_back(std::move(h));
    return one_each;
}

} // namespace mk
