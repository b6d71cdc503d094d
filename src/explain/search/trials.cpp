// Candidates on trial: what the slope of the likelihood promises, and a few iterations of a fit.
//
// A linear candidate vanishes with its size parameter s: at s = 0 the model is the base. With the
// cost's gradient g (of the negative log likelihood, with sign reversed) and information H at s
// near 0, states eliminated, the gain in log likelihood that a Gauss-Newton step promises is
//     gain = g'H^-1 g / 2 - k/2 log N ,
// over the base's parameters and the candidate's together: half of Rao's score statistic (C. R. Rao
// 1948), less the penalty for the candidate's k parameters. One shooting of all data with
// derivatives screens several candidates.
//
// Others (contact, delays, bristles) have no slope that says anything at s = 0; they are tried from
// several starts.
#include <algorithm>
#include <atomic>
#include <cmath>

#include "base/dense.hpp"
#include "base/parallel.hpp"
#include "explain/search/backlash_search.hpp"
#include "explain/search/search.hpp"

namespace mk
{

namespace
{

// Iterations of all starts, and further ones of those that go on.
constexpr int FIRST_ITERATIONS = 2, QUICK_ITERATIONS = 5;
// Iterations of a resonance's size alone.
constexpr int ITERATIONS_OF_SIZE = 3;

// A point with the states of further effects, at rest; the others stay as they were fitted.
FitPoint with_states(const FitPoint &from, const mk_model &model)
{
    FitPoint point = from;
    point.model = model;
    const long all = mk_model_state_count(&model), joints = mk_model_joints(&model);
    for (ShootingNodes &nodes : point.nodes) {
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

} // namespace

// Numbers of linear candidates that share a model, each next to nothing. One with states is looked
// at alone.
// One model with six candidates costs one shooting with the columns of all six. A state of its own
// would make all of them carry more columns.
static std::vector<std::vector<size_t>> linear_groups(const std::vector<Candidate> &all)
{
    constexpr size_t TOGETHER = 6;
    std::vector<std::vector<size_t>> group;
    for (size_t i = 0; i < all.size(); i++) {
        if (!all[i].linear)
            continue;
        const bool alone = all[i].effect->state_count > 0;
        if (alone || group.empty() || group.back().size() == TOGETHER ||
            all[group.back()[0]].effect->state_count > 0)
            group.emplace_back();
        group.back().push_back(i);
    }
    return group;
}

// A model with so little of each candidate of a group that the trajectory stays where it is: the
// cost changes by less than SAME_COST. Not with nothing of it, where a derivative by the shape
// would be 0 as well. False where there is none.
// On success `members` are the candidates that fit into the model, in its order, `free` its fitted
// parameters, the base's first, and `quadratic` is about the base's states with those of the
// candidates at rest. Shares of the candidates' sizes are tried from 1e-6 down by factors of 1e-3.
bool Search::Slope::find(const Hypothesis &base, const std::vector<Candidate> &all,
                         const std::vector<size_t> &group, Fit &fit)
{
    constexpr double SAME_COST = 0.5, FIRST_SHARE = 1e-6, LEAST_SHARE = 1e-13, LESS = 1e-3;
    for (double share = FIRST_SHARE; share > LEAST_SHARE; share *= LESS) {
        model = base.point.model;
        members.clear();
        for (size_t k : group) {
            Candidate c = all[k];
            c.value[c.size] *= share;
            mk_model more;
            if (with_candidate(model, c, more)) {
                model = more;
                members.push_back(k);
            }
        }
        // Columns: the base's own parameters and those of all members.
        FitPoint point = with_states(base.point, model);
        free = fitted_parameters(model);
        quadratic = fit.quadratic(point, free);
        if (quadratic.finite && std::fabs(quadratic.cost - base.point.cost) < SAME_COST)
            break;
    }
    return quadratic.finite;
}

// Gain in log likelihood that each linear candidate promises. Their columns of H and g are looked
// at one candidate at a time: members of a group do not compete, each is looked at with the base
// alone, as if the others were held at nothing.
void Search::screen(const Hypothesis &base, const FitOptions &loose,
                    const std::vector<Candidate> &all, std::vector<double> &gain)
{
    const std::vector<std::vector<size_t>> group = linear_groups(all);
    const size_t groups = group.size();
    const std::vector<int> own = fitted_parameters(base.point.model);
    std::atomic<size_t> done{0};
    std::vector<double> spent(groups, 0.0);
    Fit here(logs, loose);
    here.options.threads = options.threads;
    here.coarsen(base.point);
    work += here.work_done;
    parallel_for(options.threads, groups, [&](size_t g) {
        Fit fit(logs, loose);
        fit.coarsen_as(here);
        Slope slope;
        const bool found = slope.find(base, all, group[g], fit);
        spent[g] = fit.work_done;
        if (!found)
            return;
        // Number of the first parameter of member k: members follow the base in the order of the
        // model.
        int first = mk_model_parameter_count(&base.point.model);
        for (size_t k : slope.members) {
            const int count = all[k].effect->parameter_count;
            // The shape of a resonance has no slope where it is next to nothing.
            const bool size_only = all[k].effect->state_count > 0;
            std::vector<int> wanted = own;
            for (int number : slope.free)
                if (number >= first && number < first + count &&
                    (!size_only || number == first + all[k].size))
                    wanted.push_back(number);
            gain[k] = promised(slope.quadratic, slope.free, wanted) -
                      penalty((int)(wanted.size() - own.size()));
            first += count;
        }
        tick(0.3 * (double)++done / (double)groups, "screening causes");
    });
    for (double one : spent)
        work += one;
}

// Second-order reduction of the cost if only the wanted parameters move: g'H^-1 g / 2 of their rows
// and columns. With R = diag(H)^(-1/2) the matrix U = R H R has a unit diagonal; 1e-9 is added to
// it, since candidates may be collinear with the base:
//     (R g)' (U + 1e-9)^-1 (R g) / 2 .
double Search::promised(const QuadraticModel &p, const std::vector<int> &free,
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
    return 0.5 * scaled.dot(dense::solve_symmetric(unit, scaled));
}

// Numbers of `free` less the shape of the candidate, the model's last effect: its parameters but
// its size, and what makes one vector with that (a phase, a centre).
std::vector<int> Search::without_shape(std::vector<int> free, const mk_model &model,
                                       const Candidate &candidate)
{
    const mk_effect_info &info = *candidate.effect;
    const int first = mk_model_parameter_count(&model) - info.parameter_count;
    const auto is_shape = [&](int number) {
        const int k = number - first;
        return k >= 0 && k != candidate.size && info.parameter[k].fit == MK_FIT_FREE;
    };
    free.erase(std::remove_if(free.begin(), free.end(), is_shape), free.end());
    return free;
}

// A few iterations of a full fit from a candidate's start, or from where an earlier trial left it.
// False, with a gain of -infinity, where the candidate does not fit in or the fit fails. Else
// `trial` has the point and
//     gain = cost(base) - cost(trial) - k/2 log N ,
//     hope = gain + what the last quadratic model still promises .
bool Search::try_out(const Hypothesis &base, const FitOptions &loose, const TryOptions &how,
                     Trial &trial)
{
    const Candidate &start = trial.candidate;
    mk_model model;
    trial.gain = trial.hope = -HUGE_VAL;
    if (!with_candidate(base.point.model, start, model))
        return false;
    std::vector<int> free = fitted_parameters(model);
    // k, the parameters that the candidate adds, whether or not they are all free in this trial.
    const int extra = (int)(free.size() - fitted_parameters(base.point.model).size());
    if (how.size_only && start.shape > 0) {
        int shape = mk_model_parameter_count(&model) - start.effect->parameter_count + start.shape;
        free.erase(std::remove(free.begin(), free.end(), shape), free.end());
    }
    Fit fit(logs, loose);
    // A second call goes on from where the first one ended.
    FitPoint p = trial.begun ? trial.point : fit.adopt(base.point, model);
    // A resonance comes to its size first, where its frequency starts; both at once go astray along
    // the valley in which they make up for each other. Then it goes from one optimum to the next.
    const bool resonance = start.linear && start.effect->state_count > 0;
    if (resonance && !trial.begun) {
        fit.options.max_iterations = ITERATIONS_OF_SIZE;
        fit.minimise(p, without_shape(free, model, start));
    }
    fit.options.max_iterations = resonance ? 2 * how.iterations : how.iterations;
    const bool fitted = fit.minimise(p, free);
    trial.work += fit.work_done;
    if (!fitted || !std::isfinite(p.cost))
        return false;
    // Costs, not nlml: both are at the same process noise and reading noise.
    trial.gain = base.point.cost - p.cost - penalty(extra);
    trial.hope = trial.gain + fit.left;
    trial.point = std::move(p);
    trial.begun = true;
    return true;
}

// Whether a start has less to hope for than the best start of its cause, which hopes for `ahead`,
// by CLOSE (log likelihood) and by SHARE of that, or comes to nothing beside the best of all.
static bool is_behind(double hope, double ahead, double best_of_all)
{
    constexpr double SHARE = 0.5, CLOSE = 20.0;
    constexpr double HOPELESS = 0.03; // of the best of all
    const double least = HOPELESS * best_of_all;
    return hope < ahead - (ahead > 0.0 ? std::max(CLOSE, SHARE * ahead) : 0.0) ||
           (hope < least && least > CLOSE);
}

// Who goes on, by what is to be hoped for. Of several starts of one cause those that are not
// behind; of what is left the first `most`, and all resonances, which are few. Starts of a law that
// is linear in its size are apart (frequencies, places) and not held against each other. Contact
// may begin far off: two starts of it go on in any case.
void Search::thin_out(std::vector<Trial> &trials, size_t most)
{
    std::sort(trials.begin(), trials.end(),
              [](const Trial &a, const Trial &b) { return a.hope > b.hope; });
    const double best_of_all = trials.empty() ? 0.0 : trials[0].hope;
    std::vector<Trial> left;
    for (Trial &t : trials) {
        auto beside = [&](const Trial &other) { return same_cause(other.candidate, t.candidate); };
        // The first of its cause in `left` is the best, since trials are sorted.
        auto best = std::find_if(left.begin(), left.end(), beside);
        const bool several = !t.candidate.linear && best != left.end();
        const bool resonance = t.candidate.linear && t.candidate.effect->state_count > 0;
        const bool touches = t.candidate.effect->event_count > 0 &&
                             std::count_if(left.begin(), left.end(), beside) < 2;
        const bool behind = (several && is_behind(t.hope, best->hope, best_of_all)) ||
                            (left.size() >= most && !resonance);
        if (behind && !touches)
            work += t.work;
        else
            left.push_back(std::move(t));
    }
    trials = std::move(left);
}

// Whether a start that is not linear is one of several of its cause.
bool Search::has_others_beside(const std::vector<Trial> &trials, size_t one)
{
    const Candidate &c = trials[one].candidate;
    return !c.linear && std::count_if(trials.begin(), trials.end(), [&](const Trial &other) {
                            return same_cause(other.candidate, c);
                        }) > 1;
}

// All starts for little, then the promising ones for more. Trials are in another order afterwards,
// and those that thin_out() gave up are gone; their work is counted.
void Search::try_all(const Hypothesis &start, const FitOptions &loose, std::vector<Trial> &trials)
{
    // So many times those that get a full fit: what a few iterations promise is not what more give.
    constexpr size_t GO_ON = 2;
    std::atomic<size_t> done{0};
    const auto go = [&](const TryOptions &how, double from, double to) {
        // What takes longest goes first, so that no thread is left with it alone at the end.
        std::stable_sort(trials.begin(), trials.end(), [](const Trial &a, const Trial &b) {
            const mk_effect_info *one = a.candidate.effect, *other = b.candidate.effect;
            return one->event_count + one->state_count > other->event_count + other->state_count;
        });
        done = 0;
        parallel_for(options.threads, trials.size(), [&](size_t k) {
            TryOptions one = how;
            one.size_only = how.size_only && has_others_beside(trials, k);
            if (!cancelled)
                try_out(start, loose, one, trials[k]);
            tick(from + (to - from) * (double)++done / (double)trials.size(), "trying causes");
        });
    };
    go({FIRST_ITERATIONS, true}, 0.3, 0.5);
    thin_out(trials, GO_ON * (size_t)options.full_fits);
    go({QUICK_ITERATIONS, false}, 0.5, 0.7);
    for (const Trial &t : trials)
        work += t.work;
}

// Backlash is fitted over longer and longer beginnings of the logs (backlash_search.hpp) and
// compares by nlml.
void Search::try_backlash(const Hypothesis &start, const FitOptions &loose,
                          const std::vector<Candidate> &backlashes, const ExtendOptions &how,
                          std::vector<Trial> &trials)
{
    if (backlashes.empty() || cancelled)
        return;
    BacklashSearch search(logs, loose, start.point, std::min(start.quadratic.nlml, how.acceptance));
    search.afresh = how.afresh;
    for (BacklashFit &fit : search.run(backlashes, options.threads, [&](double done) {
             return tick(0.3 + 0.4 * done, "trying backlash");
         })) {
        Trial t;
        t.candidate = fit.start;
        const size_t extra =
            fitted_parameters(fit.point.model).size() - fitted_parameters(start.point.model).size();
        t.gain = start.quadratic.nlml - fit.nlml - penalty((int)extra);
        t.point = std::move(fit.point);
        t.begun = true;
        trials.push_back(std::move(t));
    }
    work += search.work;
}

} // namespace mk
