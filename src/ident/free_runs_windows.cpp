// Free runs: logs cut into windows, and the windows run about a point.
//
// A window begins from a state of its own, which its readings give (sim/window_fit.hpp); what
// effects remember there comes from a run along the readings before it (recall). linearise() is
// what the rest stands on: the squared errors of every window as quadratics in the parameters,
// start states eliminated.
#include <algorithm>
#include <cmath>
#include <memory>

#include "base/parallel.hpp"
#include "ident/free_runs_priv.hpp"
#include "sim/effect_memory.hpp"

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace mk
{

namespace
{

// Time over which a model's error hardly changes, s.
constexpr double SAME_ERROR = 0.05;
// Least rows of a window.
constexpr size_t FEWEST_ROWS = 12;
// Windows at most that are shot side by side.
constexpr size_t TOGETHER = 24;
// Share of the windows that may fail to run before a point is refused.
constexpr double MOST_LOST = 0.1;
// What passes within this time does not show in a free run, s: commands are averaged over it, and
// one reading of each joint is taken in it.
constexpr double HELD = 0.004;
// Stretches of a window at least, however short it is.
constexpr double FEWEST_STRETCHES = 25.0;
// Of the integration, s.
constexpr double LONGEST_STEP = 0.005;

} // namespace

// --- logs and windows ---

// A log that is none of the model's is passed over. What lies within a stretch, a rig's answer to
// the edges of a command and the noise of single readings, costs steps and says nothing of what a
// model lacks over a window.
FreeRuns::FreeRuns(const std::vector<std::vector<const mk_log *>> &given, const mk_model &near_in,
                   double window_s, int threads_in, const MassRange *masses_in)
    : folds(given.size()), near(near_in), masses(masses_in), threads(std::max(1, threads_in))
{
    const double held = std::min(HELD, window_s / FEWEST_STRETCHES);
    for (size_t f = 0; f < given.size(); f++)
        for (const mk_log *log : given[f]) {
            mk_record whole;
            if (mk_record_from_log(log, &near, &whole, nullptr) != MK_OK)
                continue;
            logs.push_back({thinned(whole, mk_model_joints(&near), held), (int)f, {}});
        }
    double seconds = 0.0, rows = 0.0;
    for (size_t i = 0; i < logs.size(); i++) {
        add_windows((int)i, window_s);
        seconds += logs[i].thin.record.t[logs[i].thin.record.rows - 1] - logs[i].thin.record.t[0];
        rows += (double)logs[i].thin.record.rows;
    }
    // nu = T / (N SAME_ERROR): one independent error in SAME_ERROR, but no more than one a reading.
    independent = std::min(1.0, seconds / std::max(rows, 1.0) / SAME_ERROR);
    parallel_for(threads, logs.size(), [&](size_t i) {
        std::vector<size_t> begins;
        for (const Window &w : windows)
            if (w.log == (int)i)
                begins.push_back(w.first);
        logs[i].way = way_of(logs[i].thin.record, near, begins);
    });
    measure_readings();
}

// Cuts a log into windows of window_s. A window ends where rows that are left out begin or end.
// Windows lie side by side, in the order of logs and of time. None is made of fewer than
// FEWEST_ROWS rows, nor of rows that are left out.
void FreeRuns::add_windows(int log, double window_s)
{
    const mk_record &r = logs[(size_t)log].thin.record;
    // Halves of a log by its time, rows that are left out counted in: window w is of the second
    // half if it begins there.
    const double middle = 0.5 * (r.t[0] + r.t[r.rows - 1]);
    const auto out = [&r](size_t k) { return r.left_out && r.left_out[k] != 0.0; };
    for (size_t first = 0, last; first < r.rows; first = last) {
        last = first + 1;
        while (last < r.rows && r.t[last] - r.t[first] < window_s && out(last) == out(first))
            last++;
        if (last - first >= FEWEST_ROWS && !out(first))
            windows.push_back({log, logs[(size_t)log].fold, first, last, r.t[first] >= middle});
    }
}

// Standard deviation of each joint's readings about their mean over all logs, in counts: the unit
// of the figures that left_out() reports.
void FreeRuns::measure_readings()
{
    for (int j = 0; j < mk_model_joints(&near); j++) {
        double sum = 0.0, squares = 0.0, n = 0.0;
        for (const Log &log : logs)
            for (size_t k = 0; k < log.thin.record.rows; k++) {
                const double q = log.thin.record.q[j][k];
                if (std::isfinite(q))
                    sum += q, squares += q * q, n += 1.0;
            }
        const double mean = sum / std::max(n, 1.0);
        deviation[j] = std::sqrt(std::max(squares / std::max(n, 1.0) - mean * mean, 0.0)) /
                       mk_model_count(&near, j);
    }
}

// Windows whose runs share a model, in parts of nearly the same size.
// `which` is in the order of the windows, and so of folds. Every part has at most TOGETHER windows;
// n windows make ceil(n / TOGETHER) parts that differ by one window at most. Parts do not depend on
// the number of threads.
std::vector<std::vector<size_t>> FreeRuns::together(const RunPoint &point,
                                                    const std::vector<size_t> &which) const
{
    std::vector<std::vector<size_t>> parts;
    // With own values every fold has another model, and only its own windows can share a kernel
    // call.
    const bool one_model = own_parameters(point.model).empty();
    for (size_t first = 0, last; first < which.size(); first = last) {
        last = first + 1;
        while (last < which.size() &&
               (one_model || windows[which[last]].fold == windows[which[first]].fold))
            last++;
        const size_t count = (last - first + TOGETHER - 1) / TOGETHER;
        for (size_t i = 0; i < count; i++)
            parts.emplace_back(which.begin() + (std::ptrdiff_t)(first + i * (last - first) / count),
                               which.begin() +
                                   (std::ptrdiff_t)(first + (i + 1) * (last - first) / count));
    }
    return parts;
}

// The model of every fold, with its own values in it.
// theta_f = theta + b_f within the parameter's range, and no spread any more: a model of its own
// for each fold.
std::vector<mk_model> FreeRuns::models_of(const RunPoint &point) const
{
    std::vector<mk_model> models(folds, point.model);
    const std::vector<int> own = own_parameters(point.model);
    for (size_t f = 0; f < folds; f++) {
        mk_model &m = models[f];
        for (size_t i = 0; i < own.size(); i++) {
            char name[64];
            const mk_parameter_info *info = mk_model_parameter_info(&m, own[i], name, sizeof name);
            const double value = mk_model_parameter(&m, own[i]) + point.own[f]((long)i);
            mk_model_set_parameter(&m, own[i], std::min(std::max(value, info->min), info->max));
        }
        for (int e = 0; e < m.effect_count; e++)
            std::fill(std::begin(m.effect[e].spread), std::end(m.effect[e].spread), 0.0);
    }
    return models;
}

// --- start states ---

// What the start states of a log are found with. Commands that repeat take no steps of their own
// (edges_differ); along the way (logs[].way) effects with a memory are run if there are any.
FreeRuns::Finder FreeRuns::finder_of(const RunPoint &point, const mk_model &model, size_t log) const
{
    std::unique_ptr<mk_start_finder> finder = basic_finder(logs[log].thin.record, model);
    finder->step = LONGEST_STEP;
    finder->edges_differ = true;
    if (remembers(model))
        finder->way = logs[log].way;
    if (log < point.memory.size())
        finder->memory.usual = point.memory[log].usual;
    return finder;
}

// One of each log; they refer to `models`.
std::vector<FreeRuns::Finder> FreeRuns::finders_of(const RunPoint &point,
                                                   const std::vector<mk_model> &models,
                                                   int threads_now) const
{
    std::vector<Finder> finders(logs.size());
    parallel_for(threads_now, logs.size(),
                 [&](size_t l) { finders[l] = finder_of(point, models[(size_t)logs[l].fold], l); });
    return finders;
}

// By number, those of the effects that have states of their own.
static std::vector<int> remembering_parameters(const mk_model &model)
{
    std::vector<int> numbers;
    int number = mk_plant(model.plant)->parameter_count;
    for (int e = 0; e < model.effect_count; e++) {
        const mk_effect_info *info = mk_effect(model.effect[e].index);
        for (int i = 0; i < info->parameter_count; i++, number++)
            if (info->state_count > 0)
                numbers.push_back(number);
    }
    return numbers;
}

// dz/dp of a window by the parameters `free`; those of which none is known are 0.
Eigen::MatrixXd FreeRuns::memory_slope(const RunPoint &point, size_t window,
                                       const std::vector<int> &free) const
{
    MatrixXd slope = MatrixXd::Zero(point.z[window].size(), (long)free.size());
    for (size_t i = 0; i < free.size(); i++)
        for (size_t k = 0; k < point.remembering.size(); k++)
            if (point.remembering[k] == free[i])
                slope.col((long)i) = point.dz[window].col((long)k);
    return slope;
}

// What effects remember at the start of every window.
void FreeRuns::recall(RunPoint &point, int threads_now) const
{
    // z: states of effects at the start of each window, from a run along the readings before it.
    // It belongs to the point's parameters and is made anew with them; the memory that is there, of
    // others, is what the run begins with.
    point.z.clear();
    point.dz.clear();
    point.remembering.clear();
    if (!remembers(point.model)) {
        point.memory.clear();
        return;
    }
    point.remembering = remembering_parameters(point.model);
    std::vector<double> unit;
    for (int number : point.remembering)
        unit.push_back(Fit::scale_of(point.model, number));
    const std::vector<mk_model> models = models_of(point);
    std::vector<Memory> memory(logs.size());
    point.z.resize(windows.size());
    point.dz.resize(windows.size());
    parallel_for(threads_now, logs.size(), [&](size_t l) {
        const Finder finder = finder_of(point, models[(size_t)logs[l].fold], l);
        if (l < point.memory.size())
            finder->memory = std::move(point.memory[l]);
        remember(*finder, point.remembering, unit);
        const long own = mk_model_state_count(&point.model) - 2 * mk_model_joints(&point.model);
        for (size_t w = 0; w < windows.size(); w++) {
            if (windows[w].log != (int)l)
                continue;
            // Without a place of the way, as in a log without readings, nothing is known.
            point.z[w] = VectorXd::Zero(own);
            point.dz[w] = MatrixXd::Zero(own, (long)unit.size());
            if (finder->memory.z.cols() > 0)
                point.z[w] = remembered(*finder, windows[w].first, &point.dz[w]);
        }
        memory[l] = std::move(finder->memory);
    });
    point.memory = std::move(memory);
}

// Where a search for a window's start state begins: what its readings and the past say. False where
// they say nothing.
bool FreeRuns::first_state(const mk_start_finder &finder, const RunPoint &point, size_t window,
                           VectorXd &x) const
{
    const Window &w = windows[window];
    if (mk_record_state_at(&logs[(size_t)w.log].thin.record, finder.model, 0, w.last, w.first, 0,
                           x.data(), nullptr) != MK_OK)
        return false;
    if (!point.z.empty())
        x.tail(point.z[window].size()) = point.z[window];
    return true;
}

// Start states fitted to the readings of every window, with the point's own values.
// x of a window that cannot be run even over a short beginning stays where the search began.
void FreeRuns::find_states(RunPoint &point, int threads_now) const
{
    point.x.assign(windows.size(), VectorXd::Zero(mk_model_state_count(&point.model)));
    recall(point, threads_now);
    const std::vector<mk_model> models = models_of(point);
    const std::vector<Finder> finders = finders_of(point, models, threads_now);
    // Windows without enough readings to begin with keep the state 0.
    std::vector<size_t> begun;
    for (size_t w = 0; w < windows.size(); w++)
        if (first_state(*finders[(size_t)windows[w].log], point, w, point.x[w]))
            begun.push_back(w);
    const std::vector<std::vector<size_t>> parts = together(point, begun);
    parallel_for(threads_now, parts.size(), [&](size_t part) {
        std::vector<WindowFit> fits;
        std::vector<VectorXd> x;
        for (size_t w : parts[part]) {
            fits.emplace_back(*finders[(size_t)windows[w].log], windows[w].first, windows[w].last);
            x.push_back(point.x[w]);
        }
        WindowFit::solve(fits, x);
        for (size_t i = 0; i < x.size(); i++)
            point.x[parts[part][i]] = x[i];
    });
}

// Own values begin at their means. The cost stays unknown (infinite) until a quadratic is there.
RunPoint FreeRuns::start(const mk_model &model) const
{
    RunPoint point;
    point.model = model;
    point.own.assign(folds, VectorXd::Zero((long)own_parameters(model).size()));
    find_states(point, threads);
    return point;
}

// States of effects that the model adds, or remembers otherwise, are those of a run along the
// readings (recall); angles and speeds at the start of the windows stay.
RunPoint FreeRuns::adopt(const RunPoint &from, const mk_model &model, int threads_now) const
{
    const long own = (long)own_parameters(model).size(), measured = 2 * mk_model_joints(&model);
    RunPoint point = from;
    point.model = model;
    point.cost = HUGE_VAL;
    for (VectorXd &b : point.own)
        if (b.size() != own)
            b = VectorXd::Zero(own);
    recall(point, threads_now);
    for (size_t w = 0; w < windows.size(); w++) {
        point.x[w].conservativeResize(mk_model_state_count(&model));
        if (!point.z.empty())
            point.x[w].tail(point.x[w].size() - measured) = point.z[w];
    }
    return point;
}

// With as many states and own values in both models nothing is run; else as adopt().
RunPoint FreeRuns::adopt_traces(const RunPoint &from, const mk_model &model, int threads_now) const
{
    if (mk_model_state_count(&model) != mk_model_state_count(&from.model) ||
        own_parameters(model).size() != own_parameters(from.model).size())
        return adopt(from, model, threads_now);
    RunPoint point = from;
    point.model = model;
    point.cost = HUGE_VAL;
    return point;
}

// --- quadratics of the windows ---

// Whether the start state is not where it fits the window best. The linear step of the start state
// alone promises to lower the squared error from `before` to `squares`; more than a tenth of it is
// too much.
bool FreeRuns::off_its_best(const WindowQuadratic &q) const
{
    constexpr double A_LITTLE = 0.1;
    double before = 0.0, after = 0.0;
    for (int j = 0; j < mk_model_joints(&near); j++)
        before += q.finite ? q.before[j] : 0.0, after += q.finite ? q.squares[j] : 0.0;
    return !q.finite || before > (1.0 + A_LITTLE) * after;
}

// Windows that share a model, from start states as the pass has them; a pass that ends worse than
// the one before it leaves what that found.
// Writes point.x and out.window of these windows alone, so that parts may go on different threads.
void FreeRuns::linearise_some(RunPoint &point, const std::vector<Finder> &finders,
                              const std::vector<double> &unit, const std::vector<size_t> &which,
                              Pass pass, RunQuadraticModel &out) const
{
    std::vector<WindowFit> fits;
    std::vector<VectorXd> x;
    for (size_t w : which) {
        const mk_start_finder &finder = *finders[(size_t)windows[w].log];
        fits.emplace_back(finder, windows[w].first, windows[w].last);
        fits.back().differentiate_by(out.free, unit);
        if (!point.z.empty())
            fits.back().expect(point.z[w], memory_slope(point, w, out.free));
        x.push_back(point.x[w]);
        if (pass == Pass::ANEW)
            first_state(finder, point, w, x.back());
    }
    if (pass == Pass::NEAR)
        WindowFit::solve_near(fits, x, WindowFit::Care::rough);
    if (pass == Pass::ANEW)
        WindowFit::solve(fits, x);
    std::vector<WindowQuadratic> some;
    WindowFit::linearise(fits, x, some);
    for (size_t i = 0; i < which.size(); i++) {
        // The first two passes replace what was there; ANEW only where it is better.
        const size_t w = which[i];
        if (pass < Pass::ANEW ||
            error_of(some[i], some[i].squares) < error_of(out.window[w], out.window[w].squares)) {
            point.x[w] = x[i];
            out.window[w] = std::move(some[i]);
        }
    }
}

// Start states as they are, then fitted from there where they are not at their best, and anew where
// that leads nowhere.
// `free` may be empty: then errors and start states alone are found. Without `converge` there is
// the first pass only. point.x changes to the states that the quadratics are about; windows that
// are left out by the stride have none (not finite) and keep their states. False where more than
// MOST_LOST of the windows that were looked at cannot be run.
bool FreeRuns::linearise(RunPoint &point, const std::vector<int> &free, bool converge,
                         int threads_now, RunQuadraticModel &out) const
{
    // Mean squared error, in units of the usual one, of a window whose start state is looked for
    // anew.
    constexpr double LOST = 30.0;
    out.free = free;
    out.window.assign(windows.size(), {});
    std::vector<double> unit;
    for (int number : free)
        unit.push_back(Fit::scale_of(point.model, number));
    const std::vector<mk_model> models = models_of(point);
    const std::vector<Finder> finders = finders_of(point, models, threads_now);
    std::vector<size_t> which;
    for (size_t w = 0; w < windows.size(); w += out.stride)
        which.push_back(w);
    for (Pass pass : {Pass::AS_THEY_ARE, Pass::NEAR, Pass::ANEW}) {
        const std::vector<std::vector<size_t>> parts = together(point, which);
        parallel_for(threads_now, parts.size(), [&](size_t part) {
            linearise_some(point, finders, unit, parts[part], pass, out);
        });
        std::vector<size_t> left;
        for (size_t w : which) {
            const WindowQuadratic &q = out.window[w];
            if (converge &&
                (pass == Pass::AS_THEY_ARE ? off_its_best(q) : error_of(q, q.squares) > LOST))
                left.push_back(w);
        }
        which = std::move(left);
    }
    // Of too many lost windows the others say nothing about the model.
    double lost = 0.0, all = 0.0;
    for (size_t w = 0; w < windows.size(); w += out.stride)
        lost += !out.window[w].finite, all += 1.0;
    return lost <= MOST_LOST * all;
}

} // namespace mk
