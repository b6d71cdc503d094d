// Fit: the way to the minimum, and from drift to drift.
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

constexpr double EXACTING = 0.02; // drift below which errors of the integration show
// Gains far below what evidence is weighed in: again and again they are kinks of friction, not
// progress.
constexpr double CREEP = 0.1;

namespace
{

// What the next step would gain if the cost were as its picture.
double promise(const mk_model &model, const std::vector<int> &free, const FitPicture &p)
{
    const Stepper stepper(model, free);
    const VectorXd step = stepper.parameters(stepper.solve(p, 1e-4));
    return p.relief + p.gradient.dot(step) - 0.5 * step.dot(p.information * step);
}

} // namespace

bool Fit::step(const mk_model &model, const FitPicture &picture, const std::vector<int> &free,
               mk_model &out)
{
    constexpr double TRACE = 1e-6; // damping: parameters may be collinear
    constexpr int HALVINGS = 6;
    const Stepper stepper(model, free);
    VectorXd step = stepper.solve(picture, TRACE);
    for (int i = 0; i <= HALVINGS; i++, step *= 0.5) {
        out = model;
        stepper.apply(out, step);
        if (mk_model_check(&out, nullptr) == MK_OK)
            return true;
    }
    return false;
}

bool Fit::minimise(FitPoint &point, const std::vector<int> &free)
{
    int creeping = 0;
    left = 0.0;
    double damping = 1e-4;
    converged = false;
    iterations = 0;
    const double most_work = std::min(work_done + options.max_passes, settled_by);
    FitPicture p = picture(point, free);
    if (!p.finite || !std::isfinite(p.cost))
        return false;
    point.cost = start_cost = p.cost;
    while (iterations < options.max_iterations && !converged && work_done < most_work) {
        left = promise(point.model, free, p);
        if (left < 0.1 * options.tolerance) {
            converged = true;
            break;
        }
        iterations++;
        if (progress && !progress(progress_context, 0.0, "fitting")) {
            cancelled = true;
            return true;
        }
        Stepper stepper(point.model, free);
        bool accepted = false;
        double length = 1.0, state_damping = 0.0;
        for (int attempt = 0; attempt < 14 && !accepted && work_done < most_work; attempt++) {
            FitPoint trial = point;
            VectorXd step = length * stepper.solve(p, damping);
            stepper.apply(trial.model, step);
            step = stepper.parameters(step);
            bool possible = mk_model_check(&trial.model, nullptr) == MK_OK;
            if (possible) {
                substitute(trial, step, length);
                trial.cost = cost(trial);
            }
            if (possible && trial.cost < point.cost + 1e-9) {
                accepted = true;
                double gain = point.cost - trial.cost;
                left -= gain;
                creeping = gain < CREEP ? creeping + 1 : 0;
                converged =
                    creeping >= 3 || (gain < options.tolerance * (1.0 + 1e-6 * point.cost) &&
                                      damping < 1.0 && length > 0.3);
                point = std::move(trial);
                damping = std::max(damping * 0.1, 1e-9);
                continue;
            }
            // Damping shortens and turns the step: that of the parameters first, then the states'
            // too, in the end the whole.
            damping = std::max(damping * 10.0, 1e-6);
            bool contact = mk_model_event_count(&point.model) > 0;
            if (attempt >= 2 && contact) {
                state_damping = std::max(10.0 * state_damping, 1e-3);
                shoot_all(point, free, true);
                p = eliminate(point, free, state_damping);
                add_surprise(point, free, p);
            }
            if (attempt >= (contact ? 7 : 2))
                length *= 0.4;
        }
        if (!accepted) {
            converged = true; // no way down at this precision
            break;
        }
        if (!converged) {
            p = picture(point, free);
            if (!p.finite)
                return false;
        }
    }
    return true;
}

// To the minimum as it is with the point's own step. Where that is short, the way is gone with long
// steps, corrected by what the short ones change at its start, and the correction stays in force.
bool Fit::minimise_finely(FitPoint &point, const std::vector<int> &free)
{
    constexpr double FAR = 100.0; // gain from a point at which its correction does not hold
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

// Shortens the step until that changes the cost no more; false when it was short enough. A model
// that is pushed hard is spared the last of it.
bool Fit::refine_step(FitPoint &point, bool pushed)
{
    // Contact changes with every step length a little; its instants are found anyway.
    const bool contact = mk_model_event_count(&point.model) > 0;
    const double shortest = pushed ? 2.5e-3 : contact ? 5e-4 : 2e-4, much = pushed ? 10.0 : 1.0;
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
        // Where friction bends sharply errors fall by the square of the step, else faster.
        if (change * SHORTER * SHORTER < much)
            break;
    }
    if (!refined)
        correction = kept_correction;
    return refined;
}

bool Fit::settle(FitPoint &point, const std::vector<int> &free, double drift, FitPicture &result)
{
    for (double &d : options.drift)
        d = drift;
    // All ways to the minimum together.
    constexpr double SHARE = 1.5; // of what one may cost
    settled_by = work_done + SHARE * options.max_passes;
    const bool pushed = drift >= EXACTING;
    if (pushed)
        point.step = longest_step(point.model);
    bool found = minimise_finely(point, free);
    // What the step length changes must not be taken for what the model lacks.
    if (found && refine_step(point, pushed))
        found = minimise_finely(point, free);
    // The noise belongs to the estimate; a second round where it changed.
    if (found && update_noise(point) > 0.02)
        found = minimise_finely(point, free);
    if (found)
        result = picture(point, free);
    constexpr int SPREAD_ROUNDS = 4;
    constexpr double SAME_SPREAD = 0.02;
    for (int round = 0; found && !point.own.empty() && round < SPREAD_ROUNDS; round++) {
        if (!result.finite || update_spreads(point, result) < SAME_SPREAD)
            break;
        found = minimise_finely(point, free);
        if (found)
            result = picture(point, free);
    }
    correction.reset();
    settled_by = HUGE_VAL;
    return found && result.finite;
}

bool Fit::plunge(FitPoint &point, const std::vector<int> &free, double first, double last,
                 FitPicture &result)
{
    constexpr double MORE = 1.5; // drift, to see whether the data ask for it
    constexpr double NOISY = 3.0;
    constexpr int ITERATIONS = 12;
    const int usual = std::exchange(options.max_iterations, ITERATIONS);
    FitPicture above;
    above.evidence = HUGE_VAL;
    bool found = (first < MORE * last || settle(point, free, first, above)) &&
                 settle(point, free, last, result) && converged && result.evidence < above.evidence;
    options.max_iterations = usual;
    // What a model is off by may pass for noise where there is no drift to take it.
    if (!found || beyond_scatter(logs, point.noise) > NOISY)
        return false;
    // States and parameters are where the cost does not change with them: it tells at once how the
    // evidence goes with the drift.
    for (double &d : options.drift)
        d = MORE * last;
    const FitPicture more = eliminate(point, free, 0.0);
    found = total_cost(point) + more.volume > result.evidence;
    for (double &d : options.drift)
        d = last;
    return found;
}

bool Fit::descend(FitPoint &point, const std::vector<int> &free, double first, double last,
                  FitPicture &result)
{
    FitPoint trial = point;
    bool any = false;
    double best_drift = first;
    int worse = 0;
    for (double drift = first; drift > 0.9 * last && worse < 2; drift *= 0.1) {
        FitPicture p;
        if (!settle(trial, free, drift, p))
            break;
        if (!any || p.evidence < result.evidence) {
            result = p;
            point = trial;
            best_drift = drift;
            worse = 0;
            any = true;
        } else if (p.evidence > result.evidence + 2.0) {
            worse++;
        }
    }
    for (double &d : options.drift)
        d = best_drift;
    return any;
}

} // namespace mk
