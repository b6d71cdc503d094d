// Free runs over windows of logs as least squares (ident/free_runs.hpp).
//
// About a point, window w's squared error of joint j is a quadratic in a step d of the scaled
// parameters, its start state eliminated (sim/window_fit.hpp):
//     S_wj(d) = S_wj - 2 g_wj'd + d'H_wj d .
// In the code: squares[j], g[j], H[j] of a WindowQuadratic, in counts^2; before[j] is the squared
// error at the point's own start state. The cost of a point is
//     cost = sum_w nu n_w / 2 rho(e_w) + priors ,   e_w = sum_j S_wj / s_j^2 / n_w ,
//     rho(e) = k log(1 + e / k) ,
// with n_w the window's readings of all joints, s_j^2 = scale[j] the usual squared error of a
// reading, and nu = `independent` the share of readings that are independent errors: what a model
// lacks hardly changes within SAME_ERROR, so that readings closer together count as one. rho keeps
// windows that no model predicts from deciding (USUAL_UP_TO is k).
//
// Folds are groups of logs. Their quadratics are added up fold by fold (normal_of), own values of
// each fold eliminated (eliminate_own), and summed (whole). Leaving fold f out of the sum, one
// Gauss-Newton step and the quadratics of f's own windows give at once what a fit to all other
// folds would leave in f (left_out): cross-validation without further fits.
#include "ident/free_runs.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <new>

#include "base/dense.hpp"
#include "base/parallel.hpp"
#include "ident/stepper.hpp"

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
// Variance of a reading that is rounded to counts, counts^2: uniform over one count.
constexpr double ROUNDING = 1.0 / 12.0;
// Share of the windows that may fail to run before a point is refused.
constexpr double MOST_LOST = 0.1;
// Damping relative to the diagonal: parameters may be collinear.
constexpr double TRACE = 1e-6;
// Least time for which a command is held, s; faster ones are averaged.
constexpr double HELD = 0.004;
// Of the integration, s.
constexpr double LONGEST_STEP = 0.005;

// Places of the wanted parameters among the free ones.
std::vector<long> columns_of(const std::vector<int> &wanted, const std::vector<int> &free)
{
    std::vector<long> columns;
    for (int number : wanted)
        columns.push_back(std::find(free.begin(), free.end(), number) - free.begin());
    return columns;
}

// A command held from each row to the next one, as its means over stretches of HELD:
//     mean = sum_k u_k (t_(k+1) - t_k) / (t_last - t_first) .
// Its integral over each stretch is kept, so that the rig's momentum is: what a rig makes of the
// edges between does not show in a free run, and each costs a step.
std::vector<double> smoothed(const double *u, const mk_record &record)
{
    constexpr double NEARLY = 0.95; // times are not read to the last digit
    std::vector<double> out(u, u + record.rows);
    for (size_t first = 0, last; first + 1 < record.rows; first = last) {
        double sum = 0.0;
        for (last = first;
             last + 1 < record.rows && record.t[last] - record.t[first] < NEARLY * HELD; last++)
            sum += u[last] * (record.t[last + 1] - record.t[last]);
        const double mean = sum / (record.t[last] - record.t[first]);
        if (std::isfinite(mean))
            std::fill(out.begin() + (std::ptrdiff_t)first, out.begin() + (std::ptrdiff_t)last,
                      mean);
    }
    return out;
}

} // namespace

// p'Ap/2 - a'p of a fold in the wanted parameters, and what own values b make of it: b = M (beta -
// K'p) once they are eliminated.
struct FreeRuns::Normal {
    MatrixXd A;
    VectorXd a;
    MatrixXd M, K;
    VectorXd beta;
};

// A step: in the stepper's coordinates, as scaled parameters see it, and of the own values.
struct FreeRuns::Step {
    VectorXd coordinates, scaled; // of the parameters
    std::vector<VectorXd> own;    // by fold, scaled
};

FreeRuns::FreeRuns(const std::vector<std::vector<const mk_log *>> &given, const mk_model &near_in,
                   double window_s, int threads_in)
    : folds(given.size()), near(near_in), threads(std::max(1, threads_in))
{
    for (size_t f = 0; f < given.size(); f++)
        for (const mk_log *log : given[f]) {
            Log l = {{}, {}, (int)f, {}};
            if (mk_record_from_log(log, &near, &l.record, nullptr) != MK_OK)
                continue;
            logs.push_back(std::move(l));
            Log &made = logs.back();
            for (int i = 0; i < MK_MAX_INPUTS; i++)
                if (made.record.u[i]) {
                    made.u[i] = smoothed(made.record.u[i], made.record);
                    made.record.u[i] = made.u[i].data();
                }
        }
    double seconds = 0.0, rows = 0.0;
    for (size_t i = 0; i < logs.size(); i++) {
        add_windows((int)i, window_s);
        seconds += logs[i].record.t[logs[i].record.rows - 1] - logs[i].record.t[0];
        rows += (double)logs[i].record.rows;
    }
    // nu = T / (N SAME_ERROR): one independent error in SAME_ERROR, but no more than one a reading.
    independent = std::min(1.0, seconds / std::max(rows, 1.0) / SAME_ERROR);
    parallel_for(threads, logs.size(),
                 [&](size_t i) { logs[i].way = way_of(logs[i].record, near); });
    measure_readings();
}

// Cuts a log into windows of window_s. A window ends where rows that are left out begin or end.
void FreeRuns::add_windows(int log, double window_s)
{
    const mk_record &r = logs[(size_t)log].record;
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
            for (size_t k = 0; k < log.record.rows; k++) {
                const double q = log.record.q[j][k];
                if (std::isfinite(q))
                    sum += q, squares += q * q, n += 1.0;
            }
        const double mean = sum / std::max(n, 1.0);
        deviation[j] = std::sqrt(std::max(squares / std::max(n, 1.0) - mean * mean, 0.0)) /
                       mk_model_count(&near, j);
    }
}

// Windows whose runs share a model, in parts of nearly the same size.
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

// What the start states of a log are found with. Commands that repeat take no steps of their own
// (edges_differ); along the way (logs[].way) effects with a memory are run if there are any.
FreeRuns::Finder FreeRuns::finder_of(const RunPoint &point, const mk_model &model, size_t log) const
{
    std::unique_ptr<mk_start_finder> finder = basic_finder(logs[log].record, model);
    finder->step = LONGEST_STEP;
    finder->edges_differ = true;
    if (remembers(model))
        finder->way = logs[log].way;
    if (log < point.usual.size())
        finder->usual = point.usual[log];
    return finder;
}

std::vector<FreeRuns::Finder> FreeRuns::finders_of(const RunPoint &point,
                                                   const std::vector<mk_model> &models,
                                                   int threads_now) const
{
    std::vector<Finder> finders(logs.size());
    parallel_for(threads_now, logs.size(),
                 [&](size_t l) { finders[l] = finder_of(point, models[(size_t)logs[l].fold], l); });
    return finders;
}

// What effects remember at the start of every window.
void FreeRuns::recall(RunPoint &point, int threads_now) const
{
    // z: states of effects at the start of each window, from a run along the readings before it;
    // usual: how much each varies over the log. Both belong to the point's parameters, so that they
    // are made anew with them.
    point.z.clear();
    point.usual.clear();
    if (!remembers(point.model))
        return;
    const std::vector<mk_model> models = models_of(point);
    std::vector<VectorXd> usual(logs.size());
    point.z.resize(windows.size());
    parallel_for(threads_now, logs.size(), [&](size_t l) {
        const Finder finder = finder_of(point, models[(size_t)logs[l].fold], l);
        remember(*finder);
        usual[l] = finder->usual;
        for (size_t w = 0; w < windows.size(); w++)
            if (windows[w].log == (int)l)
                point.z[w] = remembered(*finder, windows[w].first);
    });
    point.usual = std::move(usual);
}

RunPoint FreeRuns::start(const mk_model &model) const
{
    RunPoint point;
    point.model = model;
    point.own.assign(folds, VectorXd::Zero((long)own_parameters(model).size()));
    find_states(point, threads);
    return point;
}

// Start states fitted to the readings of every window, with the point's own values.
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

// Where a search for a window's start state begins: what its readings and the past say. False where
// they say nothing.
bool FreeRuns::first_state(const mk_start_finder &finder, const RunPoint &point, size_t window,
                           VectorXd &x) const
{
    const Window &w = windows[window];
    if (mk_record_state_at(&logs[(size_t)w.log].record, finder.model, 0, w.last, w.first, 0,
                           x.data(), nullptr) != MK_OK)
        return false;
    if (!point.z.empty())
        x.tail(point.z[window].size()) = point.z[window];
    return true;
}

// Windows that share a model, from start states as the pass has them; a pass that ends worse than
// the one before it leaves what that found.
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
            fits.back().expect(point.z[w]);
        x.push_back(point.x[w]);
        if (pass == Pass::ANEW)
            first_state(finder, point, w, x.back());
    }
    if (pass == Pass::NEAR)
        WindowFit::solve_near(fits, x);
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

double FreeRuns::take_scale(RunPoint &point)
{
    RunQuadraticModel quadratic;
    double change = 0.0, usual[MK_MAX_JOINTS];
    if (!linearise(point, {}, true, threads, quadratic))
        return change;
    usual_errors(quadratic, usual);
    for (int j = 0; j < mk_model_joints(&near); j++) {
        change = std::max(change, std::fabs(std::log(usual[j] / scale[j])));
        scale[j] = usual[j];
    }
    return change;
}

double FreeRuns::relative(int joint, double error) const
{
    const double sd = deviation[joint] * mk_model_count(&near, joint);
    return sd > 0.0 ? error / sd : 0.0;
}

// Priors, as residuals (Fit::surprise, ident/fit.cpp). Base parameters are somewhere near the given
// ones. The shape of an effect (a yield, a speed, a time) is known by its order of magnitude:
//     f = log(p / p_initial) / SPREAD ,   df/d(scaled p) = scale / (p SPREAD) .
// Far from it the law is another one, as a cable that never yields is a spring, and data that leave
// it open would let it go there.
double FreeRuns::surprise(const mk_model &model, int number, double &slope) const
{
    // Standard deviation of the logarithm: a factor of 5.
    constexpr double SPREAD = 1.6;
    if (number < mk_plant(model.plant)->parameter_count)
        return Fit::surprise(near, model, number, slope);
    slope = 0.0;
    char name[64];
    const mk_parameter_info *info = mk_model_parameter_info(&model, number, name, sizeof name);
    const double now = mk_model_parameter(&model, number);
    if (info->fit != MK_FIT_FREE || !(info->min > 0.0) || !(info->initial > 0.0) || !(now > 0.0))
        return 0.0;
    slope = Fit::scale_of(model, number) / (now * SPREAD);
    return std::log(now / info->initial) / SPREAD;
}

//     sum_folds sum_i (b_i / spread_i)^2 / 2 + sum_free f^2 / 2 .
double FreeRuns::prior(const RunPoint &point, const std::vector<int> &free) const
{
    double sum = 0.0;
    const std::vector<int> own = own_parameters(point.model);
    for (const VectorXd &b : point.own)
        for (size_t i = 0; i < own.size(); i++) {
            const double off = b((long)i) / mk_model_parameter_spread(&point.model, own[i]);
            sum += 0.5 * off * off;
        }
    for (int number : free) {
        double slope;
        const double off = surprise(point.model, number, slope);
        sum += 0.5 * off * off;
    }
    return sum;
}

// Errors of windows differ by orders of magnitude: some begin where nobody predicts. A sum of
// squares would be about those alone. A window of n readings and mean squared error e, in units of
// what is usual, counts
//     n/2 rho(e) ,   rho(e) = k log(1 + e / k) ,
// which is n/2 e where errors are usual, and their logarithm where they are far from it (Student's
// distribution with a scale of its own in every window: K. Lange, R. Little, J. Taylor, JASA 84,
// 1989). Its slope by any d is that of n/2 e, times
//     rho'(e) = 1 / (1 + e / k) ,
// so that Gauss-Newton becomes iteratively reweighted least squares with rho' as a window's weight.
constexpr double USUAL_UP_TO = 10.0; // k

static double in_proportion(double e)
{
    return USUAL_UP_TO * std::log1p(e / USUAL_UP_TO);
}

static double weight_of(double e)
{
    return 1.0 / (1.0 + e / USUAL_UP_TO);
}

// e_w: mean squared error of a window in units of what is usual, joints together. LOST where it
// cannot be run.
double FreeRuns::error_of(const WindowQuadratic &q, const double *squares) const
{
    constexpr double LOST = 1e3; // a window that cannot be run
    double sum = 0.0, n = 0.0;
    for (int j = 0; j < mk_model_joints(&near); j++)
        if (q.finite)
            sum += squares[j] / scale[j], n += (double)q.readings[j];
    return n > 0.0 ? sum / n : LOST;
}

// n_w, readings that are missing counted in: a window costs the same by its length whether it can
// be run or not.
double FreeRuns::rows_of(size_t window) const
{
    return (double)((windows[window].last - windows[window].first) *
                    (size_t)mk_model_joints(&near));
}

// sum_w nu n_w / 2 rho(e_w) + priors, from the point's own start states.
double FreeRuns::cost(const RunPoint &point, const RunQuadraticModel &quadratic) const
{
    double sum = prior(point, quadratic.free);
    for (size_t w = 0; w < windows.size(); w += quadratic.stride) {
        const WindowQuadratic &q = quadratic.window[w];
        sum += 0.5 * independent * rows_of(w) * in_proportion(error_of(q, q.before));
    }
    return sum;
}

// Scale s_j^2 of largest likelihood, joint by joint. With N_j readings, the terms in it,
//     sum_w n_w / 2 rho(e_w) + sum_j N_j / 2 log s_j^2 ,
// are least where
//     s_j^2 = sum_w rho'(e_w) S_wj / N_j ,
// the mean over all readings of their windows' weights times their squares. The weights depend on
// s_j^2: ROUNDS of the fixed point, the first with all weights 1. No less than what rounding makes.
void FreeRuns::usual_errors(const RunQuadraticModel &quadratic, double *usual) const
{
    constexpr int ROUNDS = 20;
    const int joints = mk_model_joints(&near);
    for (int round = 0; round < ROUNDS; round++) {
        double squares[MK_MAX_JOINTS] = {0.0, 0.0}, n[MK_MAX_JOINTS] = {0.0, 0.0};
        for (size_t w = 0; w < windows.size(); w += quadratic.stride) {
            const WindowQuadratic &q = quadratic.window[w];
            if (!q.finite)
                continue;
            double e = 0.0, all = 0.0;
            for (int j = 0; j < joints; j++)
                e += round > 0 ? q.before[j] / usual[j] : 0.0, all += (double)q.readings[j];
            for (int j = 0; j < joints; j++) {
                squares[j] += weight_of(e / std::max(all, 1.0)) * q.before[j];
                n[j] += (double)q.readings[j];
            }
        }
        for (int j = 0; j < joints; j++)
            usual[j] = std::max(squares[j] / std::max(n[j], 1.0), ROUNDING);
    }
}

// Negative log likelihood of the readings with the scale at its best:
//     sum_w nu n_w / 2 (mean_j log s_j^2 + rho(e_w)) .
// It does not depend on scale[], so that points with other scales compare. Windows that cannot be
// run are as bad as the worst of those that can.
double FreeRuns::surprise_of_readings(const RunQuadraticModel &quadratic) const
{
    double usual[MK_MAX_JOINTS], worst = 0.0, sum = 0.0;
    usual_errors(quadratic, usual);
    const int joints = mk_model_joints(&near);
    for (const bool finite : {true, false})
        for (size_t w = 0; w < windows.size(); w += quadratic.stride) {
            const WindowQuadratic &q = quadratic.window[w];
            if (q.finite != finite)
                continue;
            double e = 0.0, n = 0.0, log_usual = 0.0;
            for (int j = 0; j < joints; j++) {
                e += finite ? q.before[j] / usual[j] : 0.0;
                n += finite ? (double)q.readings[j] : 0.0;
                log_usual += std::log(usual[j]);
            }
            e = n > 0.0 ? e / n : worst;
            worst = std::max(worst, e);
            sum += 0.5 * independent * rows_of(w) * (log_usual / joints + in_proportion(e));
        }
    return sum;
}

// A and a of a fold: Gauss-Newton's terms of its windows,
//     A = sum_w sum_j rho'(e_w) nu / s_j^2 H_wj ,   a likewise of g_wj .
FreeRuns::Normal FreeRuns::normal_of(const RunQuadraticModel &quadratic,
                                     const std::vector<long> &columns, size_t fold,
                                     bool first_half) const
{
    const long n = (long)columns.size();
    Normal out;
    out.A = MatrixXd::Zero(n, n);
    out.a = VectorXd::Zero(n);
    for (size_t w = 0; w < windows.size(); w++) {
        const WindowQuadratic &q = quadratic.window[w];
        if (windows[w].fold != (int)fold || !q.finite || (first_half && windows[w].second_half))
            continue;
        // Weight of iteratively reweighted least squares, from the errors at the point: rho'(e_w).
        const double share = weight_of(error_of(q, q.before));
        for (int j = 0; j < mk_model_joints(&near); j++) {
            const double weight = share * independent / scale[j];
            for (long i = 0; i < n; i++) {
                out.a(i) += weight * q.g[j](columns[(size_t)i]);
                for (long k = 0; k < n; k++)
                    out.A(i, k) += weight * q.H[j](columns[(size_t)i], columns[(size_t)k]);
            }
        }
    }
    return out;
}

// Own values b = b0 + db with the prior |b / spread|^2 / 2: with E the columns of their means,
//     K = A E ,  M = (E'AE + D)^-1 ,  beta = E'a - D b0 ,  D = (scale / spread)^2 ,
// A - K M K' and a - K M beta are left, as in Fit::eliminate_own (ident/fit_own.cpp). Here beta =
// E'a; pull_of_prior() gives D b0.
void FreeRuns::eliminate_own(const RunPoint &point, const std::vector<int> &wanted, Normal &n) const
{
    const std::vector<int> own = own_parameters(point.model);
    const long m = (long)own.size();
    n.M = MatrixXd::Zero(m, m);
    n.K = MatrixXd::Zero((long)wanted.size(), m);
    n.beta = VectorXd::Zero(m);
    if (m == 0)
        return;
    const std::vector<long> place = columns_of(own, wanted);
    MatrixXd inner = MatrixXd::Zero(m, m);
    for (long i = 0; i < m; i++) {
        const double unit = Fit::scale_of(point.model, own[(size_t)i]) /
                            mk_model_parameter_spread(&point.model, own[(size_t)i]);
        n.K.col(i) = n.A.col(place[(size_t)i]);
        n.beta(i) = n.a(place[(size_t)i]);
        inner(i, i) += unit * unit;
        for (long k = 0; k < m; k++)
            inner(i, k) += n.A(place[(size_t)i], place[(size_t)k]);
    }
    // inner = E'AE + D: the information of own values, readings and prior together.
    n.M = dense::inverse(inner);
}

// b0 in units of the parameters' scales.
static VectorXd scaled_own(const RunPoint &point, size_t fold)
{
    const std::vector<int> own = own_parameters(point.model);
    VectorXd b = point.own[fold];
    for (size_t i = 0; i < own.size(); i++)
        b((long)i) /= Fit::scale_of(point.model, own[i]);
    return b;
}

// D b0.
static VectorXd pull_of_prior(const RunPoint &point, size_t fold)
{
    const std::vector<int> own = own_parameters(point.model);
    VectorXd pull = scaled_own(point, fold);
    for (size_t i = 0; i < own.size(); i++) {
        const double unit =
            Fit::scale_of(point.model, own[i]) / mk_model_parameter_spread(&point.model, own[i]);
        pull((long)i) *= unit * unit;
    }
    return pull;
}

// Sum over all folds but one (`but`; none where it is their number), own values eliminated, and the
// priors of the parameters: (df/dp)^2 to the information, -f df/dp to the gradient.
QuadraticModel FreeRuns::whole(const RunPoint &point, const std::vector<int> &wanted,
                               const std::vector<Normal> &parts, size_t but) const
{
    const long n = (long)wanted.size();
    QuadraticModel p;
    p.information = MatrixXd::Zero(n, n);
    p.gradient = VectorXd::Zero(n);
    for (size_t f = 0; f < parts.size(); f++) {
        if (f == but)
            continue;
        const Normal &part = parts[f];
        p.information += part.A - part.K * part.M * part.K.transpose();
        p.gradient += part.a - part.K * (part.M * part.beta);
    }
    for (long i = 0; i < n; i++) {
        double slope = 0.0;
        const double off = surprise(point.model, wanted[(size_t)i], slope);
        p.information(i, i) += slope * slope;
        p.gradient(i) -= slope * off;
    }
    return p;
}

// The Normal of every fold, own values eliminated: beta = E'a - D b0.
std::vector<FreeRuns::Normal> FreeRuns::normals_of(const RunPoint &point,
                                                   const RunQuadraticModel &quadratic,
                                                   const std::vector<int> &wanted) const
{
    const std::vector<long> columns = columns_of(wanted, quadratic.free);
    std::vector<Normal> parts;
    for (size_t f = 0; f < folds; f++) {
        parts.push_back(normal_of(quadratic, columns, f, false));
        eliminate_own(point, wanted, parts.back());
        parts.back().beta -= pull_of_prior(point, f);
    }
    return parts;
}

// Spread of own values by expectation and maximisation: given the data b is normal with mean b0 and
// covariance M (parameters held), so that
//     spread^2 = E[b^2] = 1/folds sum_f (b_f^2 + scale^2 M_f) .
void FreeRuns::update_spreads(RunPoint &point, const RunQuadraticModel &quadratic) const
{
    const std::vector<int> own = own_parameters(point.model);
    if (own.empty())
        return;
    const std::vector<Normal> parts = normals_of(point, quadratic, quadratic.free);
    for (size_t i = 0; i < own.size(); i++) {
        const double unit = Fit::scale_of(point.model, own[i]);
        double sum = 0.0;
        for (size_t f = 0; f < folds; f++)
            sum += std::pow(point.own[f]((long)i), 2) + unit * unit * parts[f].M((long)i, (long)i);
        mk_model_set_parameter_spread(&point.model, own[i], std::sqrt(sum / (double)folds));
    }
    point.cost = cost(point, quadratic);
}

// (H + lambda diag H) d = g within the ranges, then the own values by back substitution,
//     db = M (beta - K'd) .
FreeRuns::Step FreeRuns::step_of(const RunPoint &point, const RunQuadraticModel &quadratic,
                                 double damping) const
{
    const std::vector<Normal> parts = normals_of(point, quadratic, quadratic.free);
    // The stepper solves in coordinates of its own; `scaled` is the same step in the units of the
    // quadratics.
    const Stepper stepper(point.model, quadratic.free);
    Step step;
    step.coordinates = stepper.solve(whole(point, quadratic.free, parts, folds), damping);
    step.scaled = stepper.parameters(step.coordinates);
    for (const Normal &part : parts)
        step.own.push_back(part.M * (part.beta - part.K.transpose() * step.scaled));
    return step;
}

// The point after a step. Start states follow as the windows' quadratics have it: x + shift -
// follow d, d with the own values of the window's fold added to their means.
RunPoint FreeRuns::moved(const RunPoint &from, const RunQuadraticModel &quadratic,
                         const Step &step) const
{
    RunPoint to = from;
    const std::vector<int> own = own_parameters(from.model);
    const std::vector<long> place = columns_of(own, quadratic.free);
    Stepper(from.model, quadratic.free).apply(to.model, step.coordinates);
    for (size_t f = 0; f < folds; f++)
        for (size_t i = 0; i < own.size(); i++)
            to.own[f]((long)i) += step.own[f]((long)i) * Fit::scale_of(from.model, own[i]);
    for (size_t w = 0; w < windows.size(); w++) {
        const WindowQuadratic &q = quadratic.window[w];
        if (!q.finite)
            continue;
        VectorXd d = step.scaled;
        for (size_t i = 0; i < own.size(); i++)
            d(place[i]) += step.own[(size_t)windows[w].fold]((long)i);
        to.x[w] += q.shift - q.follow * d;
    }
    return to;
}

// Levenberg-Marquardt. Any decrease of the cost is taken; the damping then falls by EASIER, else it
// rises by HARDER. Spreads are updated with every step that is taken.
bool FreeRuns::minimise(RunPoint &point, const std::vector<int> &free, int iterations,
                        int threads_now, RunQuadraticModel &quadratic) const
{
    // Gain of a step, in log likelihood, below which it ends.
    constexpr double SETTLED = 0.05;
    constexpr double FIRST = 1e-2, HARDER = 10.0, EASIER = 0.1, MOST_DAMPING = 50.0;
    if (!linearise(point, free, true, threads_now, quadratic))
        return false;
    point.cost = cost(point, quadratic);
    double damping = FIRST, gain = HUGE_VAL;
    for (int i = 0; i < iterations && gain > SETTLED && damping < MOST_DAMPING; i++) {
        // Parameters, own values and start states move together.
        RunPoint trial = moved(point, quadratic, step_of(point, quadratic, damping));
        RunQuadraticModel there;
        there.stride = quadratic.stride;
        trial.cost = HUGE_VAL;
        // A trial on some of the windows is not worth a run along all that was before them.
        if (quadratic.stride == 1)
            recall(trial, threads_now);
        if (mk_model_check(&trial.model, nullptr) == MK_OK &&
            linearise(trial, free, true, threads_now, there))
            trial.cost = cost(trial, there);
        if (!(trial.cost < point.cost)) {
            damping = std::max(FIRST, HARDER * damping);
            continue;
        }
        gain = point.cost - trial.cost;
        damping = std::max(TRACE, EASIER * damping);
        point = std::move(trial);
        quadratic = std::move(there);
        update_spreads(point, quadratic);
    }
    return true;
}

// Levenberg-Marquardt may end where start states are stuck in minima of their own. So these are
// found anew from the readings, and it goes on from there as long as that gains SAME_COST.
bool FreeRuns::converge(RunPoint &point, const std::vector<int> &free, int threads_now,
                        RunQuadraticModel &quadratic) const
{
    constexpr int MOST_ROUNDS = 4, MOST_ITERATIONS = 30;
    // Gain, in log likelihood, that start states found anew must bring.
    constexpr double SAME_COST = 1.0;
    if (!minimise(point, free, MOST_ITERATIONS, threads_now, quadratic))
        return false;
    for (int i = 1; i < MOST_ROUNDS; i++) {
        RunPoint anew = point;
        find_states(anew, threads_now);
        RunQuadraticModel there;
        if (!linearise(anew, free, true, threads_now, there) ||
            cost(anew, there) > point.cost - SAME_COST)
            break;
        point = std::move(anew);
        if (!minimise(point, free, MOST_ITERATIONS, threads_now, quadratic))
            return false;
    }
    return true;
}

// The sum over all folds: the information of the parameters, and nlml of the point.
QuadraticModel FreeRuns::information(const RunPoint &point,
                                     const RunQuadraticModel &quadratic) const
{
    const std::vector<Normal> parts = normals_of(point, quadratic, quadratic.free);
    QuadraticModel out = whole(point, quadratic.free, parts, folds);
    // Own values integrated out (Laplace): log|M^-1| / 2, and the norm of their prior,
    // log(spread / scale). Of M the diagonal is used: exact for one own value; of several, their
    // correlations are left out.
    out.cost = out.nlml = surprise_of_readings(quadratic) + prior(point, quadratic.free);
    const std::vector<int> own = own_parameters(point.model);
    for (const Normal &part : parts)
        for (size_t i = 0; i < own.size(); i++)
            out.nlml += std::log(mk_model_parameter_spread(&point.model, own[i]) /
                                 Fit::scale_of(point.model, own[i])) -
                        0.5 * std::log(part.M((long)i, (long)i));
    out.finite = true;
    return out;
}

// nu times the number of readings.
double FreeRuns::independent_errors() const
{
    double rows = 0.0;
    for (const Window &w : windows)
        rows += (double)(w.last - w.first);
    return rows * independent * mk_model_joints(&near);
}

// Squared errors of a fold's windows after a step d, over the variance of the readings:
//     (S_wj - 2 g_wj'd + d'H_wj d) / deviation_j^2 ,
// no less, in a window's sum, than what rounding makes: a quadratic may go below 0 far from its
// point. A window that cannot be run counts 0, which is: not judged.
void FreeRuns::add_errors(const RunQuadraticModel &quadratic, const std::vector<long> &columns,
                          size_t fold, bool halves, const VectorXd &step, HeldOutFigures &out) const
{
    VectorXd d = VectorXd::Zero((long)quadratic.free.size());
    for (size_t i = 0; i < columns.size(); i++)
        d(columns[i]) = step((long)i);
    for (size_t w = 0; w < windows.size(); w++) {
        if (windows[w].fold != (int)fold || (halves && !windows[w].second_half))
            continue;
        const WindowQuadratic &q = quadratic.window[w];
        double sum = 0.0;
        for (int j = 0; j < MK_MAX_JOINTS; j++) {
            double square = 0.0;
            if (q.finite && j < mk_model_joints(&near) && deviation[j] > 0.0) {
                const double n = (double)q.readings[j], unit = 1.0 / (deviation[j] * deviation[j]);
                square = unit * (q.squares[j] - 2.0 * q.g[j].dot(d) + d.dot(q.H[j] * d));
                out.square[j] += square;
                out.rows[j] += n;
                sum += std::max(square, n * ROUNDING * unit);
            }
            out.part[j].push_back(square);
        }
        out.window.push_back(sum);
        out.log.push_back((int)fold);
    }
}

// Leave-one-fold-out by the quadratics. For each fold f, the step d_f of a fit to all other folds,
// from the sum without f; then f's own errors there. Of parameters with own values, those of f come
// from the first halves of its logs given d_f, and (with `halves`) its second halves are judged.
bool FreeRuns::left_out(const RunPoint &point, const RunQuadraticModel &quadratic,
                        const std::vector<int> &wanted, bool halves, HeldOutFigures &out) const
{
    const std::vector<long> columns = columns_of(wanted, quadratic.free);
    const std::vector<int> own = own_parameters(point.model);
    const std::vector<long> place = columns_of(own, wanted);
    const std::vector<Normal> parts = normals_of(point, quadratic, wanted);
    const Stepper stepper(point.model, wanted);
    out = {};
    for (size_t f = 0; f < folds; f++) {
        // d_f: the minimum of the sum without fold f, one Gauss-Newton step from the point, whose
        // start states and parameters were fitted to all folds. What f itself gave to them is taken
        // back to first order.
        VectorXd step = stepper.parameters(stepper.solve(whole(point, wanted, parts, f), TRACE));
        if (!step.allFinite())
            return false;
        if (!own.empty()) {
            // db of fold f from its first halves, given d_f: db = M (beta - K'd_f).
            Normal begin = normal_of(quadratic, columns, f, true);
            eliminate_own(point, wanted, begin);
            begin.beta -= pull_of_prior(point, f);
            const VectorXd b = begin.M * (begin.beta - begin.K.transpose() * step);
            for (size_t i = 0; i < own.size(); i++)
                step(place[i]) += b((long)i);
        }
        add_errors(quadratic, columns, f, halves, step, out);
    }
    return true;
}

} // namespace mk
