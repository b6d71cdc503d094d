// The time-optimal swing-up: the shortest duration for which solve() meets the goal
// (ctrl/swingup_solve.hpp has the problem of fixed duration).
//
//     T* = min { n h :  x_0 at rest hanging, x_n = goal, |u_k| <= u_lim }
//
// is the search for the least n for which a problem of fixed duration has a solution. Fixed
// durations are smooth problems, with free end time as an outer loop; a bang-bang command need not
// be guessed. Solutions are local: which of several swing-ups (numbers of swings, ways round) a
// start leads to depends on the start, and whether it leads to any depends little on it where the
// time is ample. So
//
// 1. all starts are tried at an ample duration (different_solutions); what they end in are a few
// different swing-ups; 2. each of those is shortened, a few per cent at a time, with the last
// solution stretched over the new time as its start, until the bound on the command leaves no other
// (shorten); 3. the shortest is solved again on finer intervals, then with a part of the command
// held in reserve for the feedback, and at last on the samples of the loop, with some slack
// (design).
#include "mechkit/swingup.h"

#include <algorithm>
#include <cmath>
#include <new>

#include "base/parallel.hpp"
#include "ctrl/swingup_solve.hpp"
#include "mechkit/loop.h"

using namespace mk::swing;

namespace
{

// Interval of the search, s.
constexpr double COARSE_S = 0.02;
// Longest step of the integration meanwhile, s.
constexpr double SEARCH_STEP_S = 5e-3;
// Largest error at the goal while searching, in units of Problem::unit: 0.1 mrad, 1 mrad/s of a
// link.
constexpr double TOLERANCE = 1e-4;
// The same of the trajectory that is handed out.
constexpr double FINE = 1e-7;
// Iterations between two updates of the multipliers.
constexpr int ITERATIONS = 30;
// r of the problem, 1/s.
constexpr double SMOOTHNESS = 0.1;
// Share of the rig's limits on travel and speed that is used.
constexpr double OF_LIMITS = 0.9;
// First duration tried, s; it grows by AMPLE until starts lead somewhere, up to LONGEST_S.
constexpr double FIRST_S = 1.0;
constexpr double LONGEST_S = 12.0;
constexpr double AMPLE = 1.3;
// Share of the starts that must lead somewhere for a duration to be ample.
constexpr double AMPLE_SHARE = 0.25;
// Share of the duration by which it is shortened at first, and that at which shortening ends.
constexpr double SHORTEN = 0.06;
constexpr double RESOLUTION = 0.004;
// Intervals of a path that is shortened, about.
constexpr double INTERVALS = 400.0;
// Relative difference of effort below which two solutions are one.
constexpr double SAME = 0.01;
// Different swing-ups that are shortened.
constexpr size_t KEPT = 4;
constexpr int THREADS = 2;

struct Candidate {
    Path path;
    State goal;
    double effort = HUGE_VAL; // integral of (u / u_lim)^2

    double seconds(double h) const { return (double)path.u.size() * h; }
};

// sum_k h (u_k / u_lim)^2, the integral of the squared command in units of the limit, s. It tells
// solutions apart.
double effort_of(const Path &path, double limit, double h)
{
    double sum = 0.0;
    for (double u : path.u)
        sum += h * (u / limit) * (u / limit);
    return sum;
}

// The command of `from` over n intervals instead: u(t / T) is kept, sampled in the middle of each
// interval.
std::vector<double> stretched(const std::vector<double> &from, size_t n)
{
    std::vector<double> u(n);
    for (size_t i = 0; i < n; i++) {
        double at = ((double)i + 0.5) * (double)from.size() / (double)n;
        u[i] = from[std::min(from.size() - 1, (size_t)at)];
    }
    return u;
}

bool solve_over(Problem problem, const Candidate &from, size_t n, double tolerance, Candidate &out)
{
    problem.goal = from.goal;
    Candidate trial = {{stretched(from.path.u, n), {}, 0.0, 0.0}, from.goal, 0.0};
    if (!solve(problem, tolerance, ITERATIONS, trial.path))
        return false;
    trial.effort = effort_of(trial.path, problem.limit, problem.h);
    out = trial;
    return true;
}

// The shortest swing-up that `c` can be shortened to. Each step takes `share` of the intervals
// away; where that fails the share is halved, down to RESOLUTION or one interval.
void shorten(const Problem &problem, double first, Candidate &c)
{
    for (double share = first; share >= RESOLUTION;) {
        size_t n = c.path.u.size();
        size_t fewer = std::min((size_t)((double)n * (1.0 - share)), n - 1);
        if (fewer < 4)
            return;
        if (solve_over(problem, c, fewer, TOLERANCE, c))
            continue;
        if (fewer == n - 1)
            return;
        share *= 0.5;
    }
}

Problem problem_of(const Dynamics &d, int equilibrium, double limit, double h)
{
    const mk_model &model = d.model;
    const mk_plant_info *plant = mk_plant(model.plant);
    Problem p = {};
    p.dynamics = &d;
    p.limit = limit;
    p.h = h;
    p.smoothness = SMOOTHNESS;
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        // A wheel may stand anywhere; speeds count by what 10 rad/s are to a link and 100 to a
        // wheel.
        bool wheel = mk_model_turns_freely(&model, j);
        double scale = mk_model_joint_scale(&model, j);
        double unit = plant->joint_motion[j] == MK_JOINT_SLIDES ? 1.0 : scale;
        p.start(j) = plant->rest[j];
        p.goal(j) = plant->equilibrium[equilibrium].q[j];
        p.unit(j) = wheel ? HUGE_VAL : scale;
        p.unit(2 + j) = (wheel ? 100.0 : 10.0) * scale;
        p.low(j) = plant->rest[j] - OF_LIMITS * plant->joint_travel[j] * unit;
        p.high(j) = plant->rest[j] + OF_LIMITS * plant->joint_travel[j] * unit;
        p.high(2 + j) = OF_LIMITS * plant->joint_speed[j] * unit;
        p.low(2 + j) = -p.high(2 + j);
    }
    return p;
}

// Where the free joint may arrive: at the equilibrium or a turn either way, if it is no wheel and
// no farther than about a turn from where it hangs.
std::vector<State> goals_of(const Problem &p)
{
    const int free = 1 - p.dynamics->motor;
    std::vector<State> goals;
    bool wheel = std::isinf(p.unit(free));
    for (int turn = wheel ? 0 : -1; turn <= (wheel ? 0 : 1); turn++) {
        State goal = p.goal;
        goal(free) += 2.0 * M_PI * turn;
        if (std::fabs(goal(free) - p.start(free)) <= 2.1 * M_PI)
            goals.push_back(goal);
    }
    return goals;
}

// First guesses: u = 0.8 u_lim sin(pi (m t / T + phase / 2)), m half waves in T, at rates below, at
// and above those at which links swing.
std::vector<Candidate> starts_of(const Problem &p, size_t n)
{
    static const double half_waves_per_s[] = {1.5, 3.0, 4.5};
    std::vector<Candidate> starts;
    for (const State &goal : goals_of(p))
        for (double rate : half_waves_per_s)
            for (int phase = 0; phase < 2; phase++) {
                Candidate c = {{std::vector<double>(n), {}, 0.0, 0.0}, goal, HUGE_VAL};
                double waves = std::round(rate * (double)n * p.h);
                for (size_t i = 0; i < n; i++) {
                    double angle = M_PI * (waves * ((double)i + 0.5) / (double)n + 0.5 * phase);
                    c.path.u[i] = 0.8 * p.limit * std::sin(angle);
                }
                starts.push_back(c);
            }
    return starts;
}

// Solves from every start; the solutions by rising effort, each of them once. None where fewer than
// a share of AMPLE_SHARE of the starts leads to one: then the duration is not ample.
std::vector<Candidate> different_solutions(const Problem &problem, size_t n)
{
    std::vector<Candidate> starts = starts_of(problem, n);
    std::vector<char> solved(starts.size());
    mk::parallel_for(THREADS, starts.size(), [&](size_t i) {
        Candidate start = starts[i];
        solved[i] = solve_over(problem, start, n, TOLERANCE, starts[i]);
    });
    if ((double)std::count(solved.begin(), solved.end(), 1) < AMPLE_SHARE * (double)solved.size())
        return {};
    std::sort(starts.begin(), starts.end(),
              [](const Candidate &a, const Candidate &b) { return a.effort < b.effort; });
    std::vector<Candidate> different;
    for (const Candidate &c : starts)
        if (std::isfinite(c.effort) && different.size() < KEPT &&
            (different.empty() || c.effort > different.back().effort * (1.0 + SAME)))
            different.push_back(c);
    return different;
}

// The shortest at the coarse interval. False: none was found.
bool search(const Problem &problem, Candidate &best)
{
    std::vector<Candidate> found;
    for (double ample = FIRST_S; found.empty() && ample < LONGEST_S; ample *= AMPLE)
        found = different_solutions(problem, (size_t)std::lround(ample / problem.h));
    if (found.empty())
        return false;
    mk::parallel_for(THREADS, found.size(), [&](size_t i) { shorten(problem, SHORTEN, found[i]); });
    best =
        *std::min_element(found.begin(), found.end(), [](const Candidate &a, const Candidate &b) {
            return a.path.u.size() < b.path.u.size();
        });
    return true;
}

// From intervals of problem `from` to those of problem `to`, whose bound may be lower: longer until
// it is solved, then shortened.
bool refine(const Problem &from, const Problem &to, const Candidate &start, Candidate &out)
{
    double seconds = start.seconds(from.h);
    for (; seconds < LONGEST_S; seconds *= 1.03)
        if (solve_over(to, start, (size_t)std::ceil(seconds / to.h), TOLERANCE, out)) {
            shorten(to, SHORTEN / 3.0, out);
            return true;
        }
    return false;
}

mk_swingup *allocate(size_t count)
{
    mk_swingup *s = new mk_swingup();
    try {
        s->count = count;
        s->u = new double[count];
        s->x = new double[(count + 1) * MK_SWINGUP_STATES];
    } catch (...) {
        mk_swingup_free(s);
        throw;
    }
    return s;
}

enum mk_status check(const mk_model *model, int equilibrium, const mk_swingup_options *o,
                     mk_error *err)
{
    enum mk_status st = mk_model_check(model, err);
    if (st != MK_OK)
        return st;
    const mk_plant_info *plant = mk_plant(model->plant);
    if (model->no_motor || plant->joints != 2 || equilibrium < 0 ||
        equilibrium >= plant->equilibrium_count || !plant->equilibrium[equilibrium].setup)
        return mk_error_set(err, MK_ERR_NOTSUP, "there is nothing to swing up on this %s",
                            plant->name);
    if (!(o->rate_hz >= MK_LOOP_RATE_MIN_HZ && o->rate_hz <= MK_LOOP_RATE_MAX_HZ))
        return mk_error_set(err, MK_ERR_RANGE, "a rate of %g Hz is outside %g .. %g", o->rate_hz,
                            (double)MK_LOOP_RATE_MIN_HZ, (double)MK_LOOP_RATE_MAX_HZ);
    if (!(o->reserve >= 0.0 && o->reserve <= 0.6) || !(o->slack >= 0.0 && o->slack <= 1.0))
        return mk_error_set(err, MK_ERR_RANGE,
                            "reserve %g, slack %g: the reserve is 0 .. 0.6, the slack 0 .. 1",
                            o->reserve, o->slack);
    return MK_OK;
}

enum mk_status design(const mk_model *model, int equilibrium, const mk_swingup_options *o,
                      mk_swingup **out, mk_error *err)
{
    // `limit` leaves the share `reserve` of the command to the feedback that follows the
    // trajectory.
    Dynamics d(*model, SEARCH_STEP_S), exact(*model);
    const double dt = 1.0 / o->rate_hz, limit = (1.0 - o->reserve) * model->u_max;
    Problem coarse = problem_of(d, equilibrium, model->u_max, COARSE_S);
    Candidate rough, optimum, best;
    bool found = search(coarse, rough);
    // As fine as the samples where these are not very many.
    const double h = dt * std::max(1.0, std::round(rough.seconds(COARSE_S) / INTERVALS / dt));
    Problem fine = problem_of(d, equilibrium, model->u_max, h);
    Problem kept = problem_of(d, equilibrium, limit, h);
    if (!found || !refine(coarse, fine, rough, optimum) || !refine(fine, kept, optimum, best))
        return mk_error_set(err, MK_ERR_NUMERIC,
                            "no swing-up was found within %g s with |u| <= %g: is the motor strong "
                            "enough?",
                            LONGEST_S, limit);
    // Samples of the loop, the duration longer by the slack; one more per cent at a time where that
    // cannot be solved to FINE.
    size_t n = (size_t)std::ceil(best.seconds(h) * (1.0 + o->slack) / dt);
    kept.h = dt;
    kept.dynamics = &exact;
    for (; !solve_over(kept, best, n, FINE, best); n += std::max(n / 100, (size_t)1))
        if ((double)n * dt > LONGEST_S)
            return mk_error_set(err, MK_ERR_NUMERIC, "the swing-up was not found to the end");
    mk_swingup *s = allocate(n);
    s->model = d.model;
    s->model.u_max = model->u_max;
    s->equilibrium = equilibrium;
    s->rate_hz = o->rate_hz;
    s->limit = limit;
    s->optimum_s = optimum.seconds(h);
    std::copy(best.path.u.begin(), best.path.u.end(), s->u);
    for (size_t k = 0; k <= n; k++)
        std::copy(best.path.x[k].data(), best.path.x[k].data() + MK_SWINGUP_STATES,
                  s->x + k * MK_SWINGUP_STATES);
    *out = s;
    return MK_OK;
}

} // namespace

void mk_swingup_default(struct mk_swingup_options *out)
{
    *out = {MK_LOOP_RATE_HZ, 0.25, 0.1};
}

void mk_swingup_free(struct mk_swingup *swingup)
{
    if (!swingup)
        return;
    delete[] swingup->u;
    delete[] swingup->x;
    delete swingup;
}

enum mk_status mk_swingup_design(const mk_model *model, int equilibrium,
                                 const mk_swingup_options *options, mk_swingup **out, mk_error *err)
{
    *out = nullptr;
    enum mk_status st = check(model, equilibrium, options, err);
    if (st != MK_OK)
        return st;
    try {
        return design(model, equilibrium, options, out, err);
    } catch (const std::bad_alloc &) {
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for a swing-up");
    } catch (...) {
        return mk_error_set(err, MK_ERR_NUMERIC, "the search for a swing-up failed");
    }
}
