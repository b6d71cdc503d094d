// Backlash by a progressive horizon (explain/search/backlash_search.hpp).
//
// An attempt is a candidate's start with the other parameters as the fit, the given model or a fit
// in short intervals has them (From). Every attempt is fitted by likelihood to the first R seconds
// of all logs, one shooting interval a log, and goes on from there to the next R:
//     R = FIRST, then LONGER R until an attempt follows its readings, FAR_LONGER R from there on .
// Compared is the negative log likelihood a reading,
//     nlml / N ,   N = sum w^2 the independent readings of the beginnings ,
// since sums over different R do not compare. After each R places(R) attempts are left (thin_out).
// From R = TELLING on backlash shows whether it is one: an attempt that followed its readings then
// and loses PARTED a reading on a longer beginning has parted from them.
//
// The best MOST_FITS are fitted to the whole of the logs (conclude), in shorter intervals where
// they parted, and what does not beat `least` is dropped.
#include "explain/search/backlash_search.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/parallel.hpp"

namespace mk
{

namespace
{

// Of all fits here, rad/s per sqrt(s):
constexpr double PROCESS_NOISE = 3.0; // next to no use for it in one shooting interval a log
// Beginnings of the logs, s: the first, and from one to the next before and after an attempt
// follows.
constexpr double FIRST = 0.7, LONGER = 1.5, FAR_LONGER = 2.0;
constexpr double TELLING = 1.5;        // after which backlash shows whether it is one
constexpr double NOISY = 2.0;          // noise over scatter of what does not follow
constexpr double PARTED = 0.1;         // log likelihood a reading that a longer beginning may cost
constexpr double SHORT_INTERVAL = 1.0; // s, where trajectories of whole logs lead nowhere

// Attempts that go on after a beginning.
size_t places(double reach)
{
    return reach < 1.0 ? 6 : reach < TELLING ? 4 : reach < 4.0 ? 2 : 1;
}

// Log likelihood a reading by which an attempt may be behind what is to be beaten.
double allowance(double reach)
{
    return reach < 1.0 ? 1.0 : reach < TELLING ? 0.5 : 0.0;
}

// Noise and first states of a fit to the same logs.
// Both have one column a log at least, and the same states. The integration step goes along.
void take_over(const FitPoint &from, FitPoint &to)
{
    std::copy(std::begin(from.noise), std::end(from.noise), std::begin(to.noise));
    to.step = from.step;
    for (size_t l = 0; l < to.nodes.size(); l++)
        to.nodes[l].x.col(0) = from.nodes[l].x.col(0);
}

// The gap's width as fitted. The backlash is the model's last effect.
double size_of(const FitPoint &point, const Candidate &backlash)
{
    return point.model.effect[point.model.effect_count - 1].value[backlash.size];
}

} // namespace

// One start on its way through the beginnings.
struct BacklashSearch::Attempt {
    Candidate start = {};
    // Where the other parameters and the first states begin.
    From from = From::refit;
    FitPoint point;
    std::vector<int> free;
    double nlml = HUGE_VAL; // a reading
    double work = 0.0;      // in passes over the data
    bool running = true;
    // The beginning that it follows best, of those that tell something.
    double best = HUGE_VAL, reach = 0.0;
    // Its point, from which a fit in shorter intervals begins if the attempt parts later on.
    FitPoint best_point;
    bool follows = false; // it
    bool parted = false;  // from the readings after it

    // Ends of the same way.
    // The same optimum reached twice: likelihoods within 1e-3 a reading, widths within 2 %.
    bool beside(const Attempt &other) const
    {
        const double width = size_of(point, start), wide = size_of(other.point, other.start);
        return std::fabs(nlml - other.nlml) < 1e-3 && std::fabs(width - wide) < 0.02 * wide;
    }
};

// A fit without the backlash may have bent the base parameters far off.
// `given` starts from the given base parameters in its place. `intervals` fits a few iterations in
// intervals of SHORT_INTERVAL first, so that a trajectory that is off is caught again, and takes
// over what that says of parameters, noise and first states. All attempts then have one node a log,
// at its start, whatever they began with. running is false where the backlash does not fit into the
// model or that first fit fails.
void BacklashSearch::begin(Attempt &a) const
{
    mk_model model;
    a.running = with_candidate(base.model, a.start, model);
    if (!a.running)
        return;
    if (a.from == From::given && loose.near)
        std::copy_n(loose.near->parameter, mk_plant(model.plant)->parameter_count, model.parameter);
    a.free = fitted_parameters(model);
    Fit fit(logs, loose);
    if (a.from == From::intervals) {
        fit.options.hidden_interval = SHORT_INTERVAL;
        fit.options.max_iterations = 6;
        fit.options.max_passes = 100.0;
        FitPoint cut = fit.adopt(base, model);
        QuadraticModel quadratic;
        a.running = fit.solve_at(cut, a.free, PROCESS_NOISE, quadratic);
        fit.options.hidden_interval = loose.hidden_interval;
        a.point = fit.adopt(base, cut.model);
        take_over(cut, a.point);
    } else {
        a.point = fit.adopt(base, model);
    }
    a.work = fit.work_done;
    for (ShootingNodes &nodes : a.point.nodes) {
        nodes.row.resize(1);
        nodes.x = Eigen::MatrixXd(nodes.x.leftCols(1));
    }
}

// One beginning of length `reach`, from the point that the shorter one left. A failed fit ends the
// attempt with infinite nlml. Before TELLING the latest beginning always replaces the one before as
// `best`, since so short ones prove nothing; from there on only a better one does. Work is counted
// in passes over the whole of the logs, so that a beginning counts by its share of the readings.
void BacklashSearch::advance(Attempt &a, const std::vector<const FitLog *> &part, double reach,
                             int threads) const
{
    FitOptions o = loose;
    o.max_iterations = 10;
    o.max_passes = 200.0;
    o.tolerance = 1e-3;
    o.threads = threads;
    Fit fit(part, o);
    QuadraticModel quadratic;
    a.running = fit.solve_at(a.point, a.free, PROCESS_NOISE, quadratic);
    a.nlml = a.running ? quadratic.nlml / independent_readings(part) : HUGE_VAL;
    a.work += fit.work_done * independent_readings(part) / independent_readings(logs);
    const bool told = reach >= TELLING;
    a.parted = told && a.follows && a.nlml > a.best + PARTED;
    a.running = a.running && !a.parted;
    if (a.nlml < a.best || !told) {
        a.best = a.nlml;
        a.best_point = a.point;
        a.reach = reach;
        // The fitted noise is near what the readings scatter: nothing large is missed.
        a.follows = beyond_scatter(part, a.point.noise) < NOISY;
    }
}

// To all of the logs. Where exact trajectories part from the readings after a while all the same,
// in short intervals.
// `out` has the better of two: the attempt as it is, if it came to the ends of the logs; and a fit
// from its best beginning in intervals of half the time over which it followed, SHORT_INTERVAL at
// least. True where that beats `least`.
bool BacklashSearch::conclude(const Attempt &a, int threads, BacklashFit &out)
{
    FitOptions o = loose;
    o.threads = threads;
    Fit fit(logs, o);
    out.start = a.start;
    out.nlml = a.parted ? HUGE_VAL : a.nlml * independent_readings(logs);
    out.point = fit.adopt(base, a.point.model);
    take_over(a.point, out.point);
    if (a.parted || !a.follows) {
        fit.options.hidden_interval = std::max(SHORT_INTERVAL, 0.5 * a.reach);
        FitPoint cut = fit.adopt(base, a.best_point.model);
        take_over(a.best_point, cut);
        QuadraticModel quadratic;
        if (fit.solve_at(cut, a.free, PROCESS_NOISE, quadratic) && quadratic.nlml < out.nlml) {
            out.point = std::move(cut);
            out.nlml = quadratic.nlml;
        }
    }
    work += fit.work_done;
    return out.nlml < least;
}

// Of attempts in the order of their scores: who goes on.
// An attempt ends where it is a twin of a better one, where places(R) better ones are left, where
// another follows its readings and it does not, or where
//     nlml / N > least / N_all + allowance(R) .
// Returns how many go on. `attempts` are sorted, best first.
size_t BacklashSearch::thin_out(std::vector<Attempt> &attempts, double reach, bool followed) const
{
    const double most = least / independent_readings(logs) + allowance(reach);
    size_t left = 0;
    for (size_t i = 0; i < attempts.size(); i++) {
        Attempt &a = attempts[i];
        for (size_t k = 0; k < i && a.running; k++)
            a.running = !attempts[k].running || !attempts[k].beside(a);
        const bool behind = followed && !a.follows;
        a.running = a.running && left < places(reach) && !behind && !(a.nlml > most);
        left += a.running;
    }
    return left;
}

// All starts from the refit; afresh from the given values as well, and the middle one over short
// intervals.
std::vector<BacklashSearch::Attempt>
BacklashSearch::attempts_from(const std::vector<Candidate> &starts) const
{
    std::vector<Attempt> attempts;
    for (size_t i = 0; i < starts.size(); i++)
        for (From from : {From::refit, From::given, From::intervals})
            if (from == From::refit ||
                (afresh && (from == From::given || i == starts.size() / 2))) {
                attempts.emplace_back();
                attempts.back().start = starts[i];
                attempts.back().from = from;
            }
    return attempts;
}

// Those that are still running, fitted to a longer beginning of the logs; the likeliest first.
void BacklashSearch::advance_all(std::vector<Attempt> &attempts, double reach, int threads) const
{
    std::vector<FitLog> beginning;
    std::vector<const FitLog *> part;
    for (const FitLog *log : logs)
        beginning.push_back(beginning_of(*log, reach));
    for (const FitLog &log : beginning)
        part.push_back(&log);
    const auto running =
        std::count_if(attempts.begin(), attempts.end(), [](const Attempt &a) { return a.running; });
    const int helpers = std::max(1, threads / std::max(1, (int)running));
    parallel_for(threads, attempts.size(), [&](size_t i) {
        if (attempts[i].running)
            advance(attempts[i], part, reach, helpers);
    });
    std::stable_sort(attempts.begin(), attempts.end(),
                     [](const Attempt &a, const Attempt &b) { return a.nlml < b.nlml; });
}

// Whether all have parted from the readings within so short a beginning that it may have led them
// astray.
bool BacklashSearch::led_astray(const std::vector<Attempt> &attempts)
{
    const double furthest =
        std::accumulate(attempts.begin(), attempts.end(), 0.0, [](double most, const Attempt &a) {
            return std::max(most, a.parted ? a.reach : 0.0);
        });
    return furthest > 0.0 && furthest < TELLING;
}

// The best few, fitted to the whole of the logs.
// Attempts that are still running come first, then those that went furthest. Of optima within EVEN
// (log likelihood) of each other the best one stays.
std::vector<BacklashFit> BacklashSearch::conclude_all(std::vector<Attempt> &attempts, int threads)
{
    constexpr size_t MOST_FITS = 2;
    std::stable_sort(attempts.begin(), attempts.end(), [](const Attempt &a, const Attempt &b) {
        return a.running > b.running || (a.running == b.running && a.reach > b.reach);
    });
    std::vector<BacklashFit> found;
    for (const Attempt &a : attempts) {
        work += a.work;
        BacklashFit one;
        if ((a.running || a.parted) && found.size() < MOST_FITS && conclude(a, threads, one))
            found.push_back(std::move(one));
    }
    std::sort(found.begin(), found.end(),
              [](const BacklashFit &a, const BacklashFit &b) { return a.nlml < b.nlml; });
    // From several starts to the same place.
    constexpr double EVEN = 5.0;
    std::vector<BacklashFit> apart;
    for (BacklashFit &f : found)
        if (std::none_of(apart.begin(), apart.end(),
                         [&](const BacklashFit &o) { return f.nlml < o.nlml + EVEN; }))
            apart.push_back(std::move(f));
    return apart;
}

// Stages: begin all attempts; beginnings of growing length until one is the whole of the longest
// log; the best to the end. `go_on` is told log(R / FIRST) / log(longest / FIRST), which grows
// evenly with the stages. Where `afresh` and all have parted early, the attempts begin once more at
// the next length; their first fits are not counted twice. Empty where `go_on` says so.
std::vector<BacklashFit> BacklashSearch::run(const std::vector<Candidate> &starts, int threads,
                                             const std::function<bool(double)> &go_on)
{
    std::vector<Attempt> attempts = attempts_from(starts);
    double longest = 0.0;
    for (const FitLog *log : logs)
        longest = std::max(longest, log->duration());
    // Short intervals take longest.
    parallel_for(threads, attempts.size(),
                 [&](size_t i) { begin(attempts[attempts.size() - 1 - i]); });
    const std::vector<Attempt> fresh = attempts;
    bool whole = false, followed = false, again = false;
    for (double reach = FIRST; !whole; reach *= followed ? FAR_LONGER : LONGER) {
        whole = reach >= longest;
        if (!go_on(std::log(reach / FIRST) / std::log(std::max(longest / FIRST, 2.0))))
            return {};
        advance_all(attempts, reach, threads);
        const bool told = reach >= TELLING;
        followed = told && std::any_of(attempts.begin(), attempts.end(),
                                       [](const Attempt &a) { return a.running && a.follows; });
        const size_t left = thin_out(attempts, reach, followed);
        // What says little may lead astray: once more from here.
        const bool ended = told && left == 0 && !whole;
        if (afresh && ended && !again && led_astray(attempts)) {
            again = true;
            attempts.insert(attempts.end(), fresh.begin(), fresh.end());
            std::for_each(fresh.begin(), fresh.end(), [&](const Attempt &a) { work -= a.work; });
        }
    }
    return conclude_all(attempts, threads);
}

} // namespace mk
