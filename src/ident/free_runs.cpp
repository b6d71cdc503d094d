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
// lacks hardly changes within 0.05 s, so that readings closer together count as one. rho keeps
// windows that no model predicts from deciding (USUAL_UP_TO is k).
//
// The windows and their quadratics are made in ident/free_runs_windows.cpp. Folds are groups of
// logs; ident/free_runs_folds.cpp adds the quadratics up fold by fold (normal_of), eliminates the
// own values of each fold (eliminate_own) and sums (whole). Here are the cost, its priors and the
// way to its minimum.
#include "ident/free_runs_priv.hpp"

#include <algorithm>
#include <cmath>

#include "base/dense.hpp"
#include "ident/stepper.hpp"

using Eigen::VectorXd;

namespace mk
{

std::vector<long> columns_of(const std::vector<int> &wanted, const std::vector<int> &free)
{
    std::vector<long> columns;
    for (int number : wanted)
        columns.push_back(std::find(free.begin(), free.end(), number) - free.begin());
    return columns;
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
        return Fit::surprise(near, masses, model, number, slope);
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

double weight_of(double e)
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
        step.own.push_back(dense::product(
            part.M, VectorXd(part.beta - dense::transpose_product(part.K, step.scaled))));
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
        if (!to.z.empty())
            to.z[w] += memory_slope(from, w, quadratic.free) * d;
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

} // namespace mk
