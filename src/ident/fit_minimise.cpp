// Fit: the way to the minimum at a given process noise, and from one process noise to the next.
//
// Three loops lie inside each other.
//
// 1. minimise(): Levenberg-Marquardt on the quadratic model that ident/fit.cpp makes,
//     cost(d) = cost - g'd + d'H d / 2 ,
//     (H + lambda diag H) d = g   within the parameters' ranges,
// with g = gradient, H = information, lambda = damping. ident/stepper.hpp solves it in coordinates
// in which models are nearly linear; the states follow by back substitution.
//
// 2. solve_at(): alternates the minimum with what belongs to it: the integration step, the
// readings' noise sigma_j, and the spreads of own values.
//
// 3. continue_over_process_noise(): a continuation (homotopy) in the process-noise intensity D. At
// a large D the trajectory may jump at every shooting node, and the cost is nearly quadratic. D
// then falls by factors of ten, each minimum the start of the next, and the D with the least nlml
// is the result. The nlml has the norms of D in it, so that a large D pays for its freedom: a right
// model ends with next to none.
#include <algorithm>
#include <cmath>
#include <utility>

#include "base/dense.hpp"
#include "ident/fit_priv.hpp"
#include "ident/stepper.hpp"

namespace mk
{

using Eigen::MatrixXd;
using Eigen::VectorXd;

// Process-noise intensity below which errors of the integration show, rad/s per sqrt(s).
constexpr double EXACTING = 0.02;
// Gain of a step, in log likelihood, that is far below what evidence is weighed in: again and again
// such gains are kinks of friction, not progress.
constexpr double CREEP = 0.1;

namespace
{

// Decrease that the quadratic model promises for the full step d, with the states at their best:
//     state_decrease + g'd - d'H d / 2 .
double promise(const mk_model &model, const std::vector<int> &free, const QuadraticModel &p)
{
    const Stepper stepper(model, free);
    const VectorXd step = stepper.parameters(stepper.solve(p, 1e-4));
    return p.state_decrease + p.gradient.dot(step) - 0.5 * step.dot(p.information * step);
}

} // namespace

bool Fit::step(const mk_model &model, const QuadraticModel &quadratic, const std::vector<int> &free,
               mk_model &out)
{
    // Damping relative to diag H: parameters may be collinear. A step that makes no rig (a mass
    // matrix that is not positive definite) is halved.
    constexpr double TRACE = 1e-6;
    constexpr int HALVINGS = 6;
    const Stepper stepper(model, free);
    VectorXd step = stepper.solve(quadratic, TRACE);
    for (int i = 0; i <= HALVINGS; i++, step *= 0.5) {
        out = model;
        stepper.apply(out, step);
        if (mk_model_check(&out, nullptr) == MK_OK)
            return true;
    }
    return false;
}

// Where a minimisation stands between its steps.
struct Fit::Descent {
    double damping = 1e-4; // of Levenberg and Marquardt, relative to the diagonal of H
    int creeping = 0;      // steps in a row that gained less than CREEP
    double most_work;      // work_done at which it ends
    // What the latest steps gained, the last one first.
    double gains[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL};
};

// Whether all iterations that are left would have to gain more than the best of the latest steps
// did to come to what is worth the work:
//     cost - (iterations left) max(gains) > worth .
// Far from a minimum gains come and go in fits and starts; hence the best of several.
bool Fit::is_hopeless(const FitPoint &point, const Descent &d) const
{
    const double pace = *std::max_element(std::begin(d.gains), std::end(d.gains));
    return point.cost - pace * (options.max_iterations - iterations) > options.worth;
}

// Ends when one of these holds: the quadratic model promises less than a tenth of the tolerance; a
// step gains less than the tolerance although it was hardly damped or shortened; three steps in a
// row gain less than CREEP; no trial step goes down; iterations or work are used up. The last is no
// convergence. False at once where even the whole step of the first quadratic model would leave
//     cost - left > OUT_OF_REACH worth .
bool Fit::minimise(FitPoint &point, const std::vector<int> &free)
{
    // In 96 such fits of seven rigs those that came within 100 of the log likelihood that they were
    // held against had 1.1 here at most, from as far off as 1e8; those with 20 or more ended
    // thousands behind it.
    constexpr double OUT_OF_REACH = 30.0;
    Descent d;
    d.most_work = std::min(work_done + options.max_passes, work_limit);
    left = 0.0;
    converged = false;
    iterations = 0;
    QuadraticModel p = quadratic(point, free);
    if (!p.finite || !std::isfinite(p.cost))
        return false;
    point.cost = start_cost = p.cost;
    bool moved = false; // since p was taken
    while (iterations < options.max_iterations && !converged && work_done < d.most_work) {
        if (moved && !(p = quadratic(point, free)).finite)
            return false;
        left = promise(point.model, free, p);
        if (!moved && point.cost - left > OUT_OF_REACH * options.worth)
            return false;
        converged = left < 0.1 * options.tolerance;
        if (converged)
            break;
        iterations++;
        if (progress && !progress(progress_context, 0.0, "fitting")) {
            cancelled = true;
            return true;
        }
        if (!step_down(point, free, p, d)) {
            converged = work_done < d.most_work; // no way down at this precision, or out of work
            break;
        }
        moved = true;
        if (is_hopeless(point, d))
            return false;
    }
    return true;
}

// One step that lowers the cost, by up to 14 attempts. Any decrease will do; the reduction of the
// quadratic model is not compared with it. The damping falls and rises by factors of ten.
bool Fit::step_down(FitPoint &point, const std::vector<int> &free, QuadraticModel &p, Descent &d)
{
    constexpr int ATTEMPTS = 14;
    const bool contact = mk_model_event_count(&point.model) > 0;
    const Stepper stepper(point.model, free);
    // `length` in (0, 1] shortens the whole step. `state_damping` is lambda for the states' own
    // diagonal: it needs another elimination, since the states are eliminated before p.
    double length = 1.0, state_damping = 0.0;
    for (int attempt = 0; attempt < ATTEMPTS && work_done < d.most_work; attempt++) {
        FitPoint trial = point;
        const VectorXd step = length * stepper.solve(p, d.damping);
        stepper.apply(trial.model, step);
        if (mk_model_check(&trial.model, nullptr) == MK_OK) {
            substitute(trial, stepper.parameters(step), length);
            trial.cost = cost(trial);
            // 1e-9 lets a step at the minimum pass that is equal but for rounding.
            if (trial.cost < point.cost + 1e-9) {
                accept(point, std::move(trial), length, d);
                return true;
            }
        }
        // Damping shortens and turns the step: that of the parameters first. Where contact makes
        // the cost kink in the states as well, theirs follows after two attempts. In the end the
        // whole step is shortened.
        d.damping = std::max(d.damping * 10.0, 1e-6);
        if (attempt >= 2 && contact) {
            state_damping = std::max(10.0 * state_damping, 1e-3);
            shoot_all(point, free, true);
            p = eliminate(point, free, state_damping);
            add_surprise(point, free, p);
        }
        if (attempt >= (contact ? 7 : 2))
            length *= 0.4;
    }
    return false;
}

void Fit::accept(FitPoint &point, FitPoint trial, double length, Descent &d)
{
    const double gain = point.cost - trial.cost;
    left -= gain;
    std::copy_backward(std::begin(d.gains), std::end(d.gains) - 1, std::end(d.gains));
    d.gains[0] = gain;
    d.creeping = gain < CREEP ? d.creeping + 1 : 0;
    converged = d.creeping >= 3 || (gain < options.tolerance * (1.0 + 1e-6 * point.cost) &&
                                    d.damping < 1.0 && length > 0.3);
    point = std::move(trial);
    d.damping = std::max(d.damping * 0.1, 1e-9);
}

// To the minimum as it is with the point's own step. Where that is short, the way is gone with long
// steps, corrected by what the short ones change at its start:
//     r(p) ~ r_h(p) + (r_short - r_h)(p0) ,
// and the correction stays in force. It is taken anew, up to ROUNDS times, where the cost fell by
// FAR or more: it then belongs to a point far away.
bool Fit::minimise_finely(FitPoint &point, const std::vector<int> &free)
{
    // Gain from p0, in log likelihood, beyond which its correction does not hold.
    constexpr double FAR = 100.0;
    constexpr int ROUNDS = 4;
    // What touches at other instants does not differ by a correction.
    if (mk_model_event_count(&point.model) > 0)
        return minimise(point, free) && !cancelled;
    for (int round = 0; round < ROUNDS; round++) {
        coarsen(point);
        if (!minimise(point, free) || cancelled)
            return false;
        if (!correction || start_cost - point.cost < FAR)
            break;
    }
    // Slopes of long steps do not lead to the minimum where a law has kinks.
    if (correction && left > CREEP) {
        correction.reset();
        return minimise(point, free) && !cancelled;
    }
    return true;
}

// Shortens the step h by the factor s = SHORTER until that changes the cost no more; false when it
// was short enough. A model that is pushed hard is spared the last of it.
bool Fit::refine_step(FitPoint &point, bool needs_process_noise)
{
    // Contact changes with every step length a little; its instants are found anyway.
    const bool contact = mk_model_event_count(&point.model) > 0;
    // `shortest`: least step, s. `much`: change of the cost, in log likelihood, below which the
    // step is short enough.
    const double shortest = needs_process_noise ? 2.5e-3
                            : contact           ? 5e-4
                                                : 2e-4,
                 much = needs_process_noise ? 10.0 : 1.0;
    if (!(point.step > 0.0))
        point.step = longest_step(point.model);
    double now = point.cost;
    const auto kept_correction = std::exchange(correction, nullptr);
    bool refined = false;
    while (point.step > shortest) {
        const double kept = point.step;
        point.step *= SHORTER;
        const double finer = cost(point), change = std::fabs(finer - now);
        if (!(change > much)) {
            point.step = kept;
            break;
        }
        refined = true;
        now = finer;
        // The next change is less than s^2 times this one if errors fall by h^2 or faster. Where
        // friction bends sharply within a step they fall by h^2, else by h^4 (the classical
        // Runge-Kutta method).
        if (change * SHORTER * SHORTER < much)
            break;
    }
    if (!refined)
        correction = kept_correction;
    return refined;
}

bool Fit::solve_at(FitPoint &point, const std::vector<int> &free, double process_noise,
                   QuadraticModel &result)
{
    for (double &d : options.process_noise)
        d = process_noise;
    // All ways to the minimum together, of what one may cost.
    constexpr double SHARE = 1.5;
    work_limit = work_done + SHARE * options.max_passes;
    const bool needs_process_noise = process_noise >= EXACTING;
    if (needs_process_noise)
        point.step = longest_step(point.model);
    bool found = minimise_finely(point, free);
    // What the step length changes must not be taken for what the model lacks.
    if (found && refine_step(point, needs_process_noise))
        found = minimise_finely(point, free);
    // The noise belongs to the estimate; a second round where it changed.
    if (found && update_noise(point) > 0.02)
        // What the step length changes must not be taken for what the model lacks: a finer step has
        // its own minimum.
        found = minimise_finely(point, free);
    if (found)
        result = quadratic(point, free);
    // Own values: minimum and spreads in turn, as MacKay's fixed point (update_spreads) needs both.
    // Ends where no spread changes by more than SAME_SPREAD, relative.
    constexpr int SPREAD_ROUNDS = 4;
    constexpr double SAME_SPREAD = 0.02;
    for (int round = 0; found && !point.own.empty() && round < SPREAD_ROUNDS; round++) {
        if (!result.finite || update_spreads(point, result) < SAME_SPREAD)
            break;
        found = minimise_finely(point, free);
        if (found)
            result = quadratic(point, free);
    }
    correction.reset();
    work_limit = HUGE_VAL;
    return found && result.finite;
}

bool Fit::solve_directly(FitPoint &point, const std::vector<int> &free, double first, double last,
                         QuadraticModel &result)
{
    // Factor on the process noise by which the slope of nlml is asked for.
    constexpr double MORE = 1.5;
    // Ratio of the fitted noise to the readings' own scatter above which a model is doubted.
    constexpr double NOISY = 3.0;
    // Iterations that a direct way may take: where it is right it takes few.
    constexpr int ITERATIONS = 12;
    const int usual = std::exchange(options.max_iterations, ITERATIONS);
    // Two conditions for nlml(D) to be least at D = last: it is less there than at `first`, and it
    // rises from `last` to MORE last.
    QuadraticModel above;
    above.nlml = HUGE_VAL;
    bool found = (first < MORE * last || solve_at(point, free, first, above)) &&
                 solve_at(point, free, last, result) && converged && result.nlml < above.nlml;
    options.max_iterations = usual;
    // What a model is off by may pass for noise where there is no process noise to take it.
    if (!found || beyond_scatter(logs, point.noise) > NOISY)
        return false;
    // Slope by D. At a minimum the cost does not change with states and parameters to first order
    // (envelope theorem), so that they need not be fitted again: the derivatives from the last
    // shooting give nlml at the larger process noise at once.
    for (double &d : options.process_noise)
        d = MORE * last;
    const QuadraticModel more = eliminate(point, free, 0.0);
    found = total_cost(point) + more.log_determinant > result.nlml;
    for (double &d : options.process_noise)
        d = last;
    return found;
}

int Fit::rises(double rise, double readings)
{
    constexpr double RISEN = 2.0, RISEN_FAR = 0.05; // log likelihood, and a reading
    if (rise > std::max(RISEN, RISEN_FAR * readings))
        return RISES_IN_A_ROW;
    return rise > RISEN ? 1 : 0;
}

// Ends where nlml has risen, or where no minimum is found: the data cannot be followed with so
// little process noise.
bool Fit::continue_over_process_noise(FitPoint &point, const std::vector<int> &free, double first,
                                      double last, QuadraticModel &result)
{
    const double readings = independent_readings(logs);
    FitPoint trial = point;
    bool any = false;
    double best_process_noise = first;
    int worse = 0;
    for (double process_noise = first; process_noise > 0.9 * last && worse < RISES_IN_A_ROW;
         process_noise *= 0.1) {
        QuadraticModel p;
        if (!solve_at(trial, free, process_noise, p))
            break;
        if (!any || p.nlml < result.nlml) {
            result = p;
            point = trial;
            best_process_noise = process_noise;
            worse = 0;
            any = true;
        } else {
            worse += rises(p.nlml - result.nlml, readings);
        }
    }
    for (double &d : options.process_noise)
        d = best_process_noise;
    return any;
}

} // namespace mk
