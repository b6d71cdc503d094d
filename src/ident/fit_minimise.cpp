// Fit: the way to the minimum, and from drift to drift.
#include <algorithm>
#include <cmath>
#include <utility>

#include "base/dense.hpp"
#include "ident/fit_priv.hpp"

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

// Steps of the parameters. They are taken in coordinates in which the model is as linear as can be:
// amplitude and phase as sine and cosine parts, stiffness and rest position as stiffness and offset
// torque. Coordinates that would leave their range stop at its end.
class Stepper
{
  public:
    Stepper(const mk_model &m, const std::vector<int> &f) : model(m), free(f)
    {
        long n = (long)f.size();
        scale.resize(n), low.resize(n), high.resize(n);
        for (long i = 0; i < n; i++) {
            char name[64];
            int number = f[(size_t)i];
            const mk_parameter_info *info = mk_model_parameter_info(&m, number, name, sizeof name);
            double v = mk_model_parameter(&m, number);
            scale(i) = Fit::scale_of(m, number);
            low(i) = (info->min - v) / scale(i);
            high(i) = (info->max - v) / scale(i);
            // What cannot be nothing (a time constant, a speed) is known by its order of magnitude:
            // no straight line reaches far in it.
            if (info->min > 0.0) {
                low(i) = std::max(low(i), (1.0 / FARTHEST - 1.0) * v / scale(i));
                high(i) = std::min(high(i), (FARTHEST - 1.0) * v / scale(i));
            }
        }
        turn.setIdentity(n, n);
        find_pairs();
    }
    VectorXd solve(const FitPicture &p, double damping) const
    {
        MatrixXd information = turn.transpose() * p.information * turn;
        VectorXd gradient = turn.transpose() * p.gradient;
        long n = gradient.size();
        VectorXd step = VectorXd::Zero(n);
        std::vector<bool> held((size_t)n, false);
        for (long round = 0; round <= n; round++) {
            std::vector<long> open;
            for (long i = 0; i < n; i++)
                if (!held[(size_t)i])
                    open.push_back(i);
            long m = (long)open.size();
            if (m == 0)
                break;
            MatrixXd H(m, m);
            VectorXd g(m);
            for (long i = 0; i < m; i++) {
                g(i) = gradient(open[(size_t)i]);
                for (long j = 0; j < n; j++)
                    if (held[(size_t)j])
                        g(i) -= information(open[(size_t)i], j) * step(j);
                for (long j = 0; j < m; j++)
                    H(i, j) = information(open[(size_t)i], open[(size_t)j]);
                H(i, i) += damping * std::max(H(i, i), 1e-12) + 1e-12;
            }
            VectorXd s = dense::solve_symmetric(H, g);
            bool inside = true;
            for (long i = 0; i < m; i++) {
                long k = open[(size_t)i];
                step(k) = std::min(std::max(s(i), low(k)), high(k));
                if (step(k) != s(i)) {
                    held[(size_t)k] = true;
                    inside = false;
                }
            }
            if (inside)
                break;
        }
        return step;
    }
    // The same step as the kernel's scaled parameters see it, to first order.
    VectorXd parameters(const VectorXd &step) const { return turn * step; }
    void apply(mk_model &m, const VectorXd &step) const
    {
        std::vector<double> v;
        for (long i = 0; i < step.size(); i++)
            v.push_back(mk_model_parameter(&m, free[(size_t)i]) + step(i) * scale(i));
        for (const Pair &p : pairs) {
            double a = mk_model_parameter(&m, free[(size_t)p.size]);
            double b = mk_model_parameter(&m, free[(size_t)p.other]);
            double da = step(p.size) * scale(p.size), db = step(p.other) * scale(p.size);
            double &size = v[(size_t)p.size], &other = v[(size_t)p.other];
            if (p.polar) {
                double x = a * std::cos(b) + da, y = a * std::sin(b) + db;
                size = std::hypot(x, y);
                other = std::atan2(y, x);
            } else {
                size = std::max(a + da, 1e-3 * scale(p.size));
                other = p.reference + (a * (b - p.reference) + db) / size;
            }
        }
        for (long i = 0; i < step.size(); i++) {
            char name[64];
            int number = free[(size_t)i];
            const mk_parameter_info *info = mk_model_parameter_info(&m, number, name, sizeof name);
            mk_model_set_parameter(&m, number,
                                   std::min(std::max(v[(size_t)i], info->min), info->max));
        }
    }

  private:
    static constexpr double FARTHEST = 2.5; // times its value, in one step
    struct Pair {
        long size, other; // places in `free`
        bool polar;
        double reference;
    };
    const mk_model &model;
    const std::vector<int> &free;
    VectorXd scale, low, high; // of the step
    MatrixXd turn;             // d(scaled parameters) / d(step)
    std::vector<Pair> pairs;

    long place_of(int number) const
    {
        auto it = std::find(free.begin(), free.end(), number);
        return it == free.end() ? -1 : (long)(it - free.begin());
    }
    void find_pairs()
    {
        int first = mk_plant(model.plant)->parameter_count;
        for (int e = 0; e < model.effect_count; e++) {
            const mk_effect_info *info = mk_effect(model.effect[e].index);
            for (int k = 1; k < info->parameter_count; k++) {
                bool polar = info->parameter[k].fit == MK_FIT_ANGLE;
                bool centre = info->parameter[k].fit == MK_FIT_CENTRE;
                long size = place_of(first), other = place_of(first + k);
                if ((polar || centre) && size >= 0 && other >= 0)
                    add(e, size, other, polar);
            }
            first += info->parameter_count;
        }
    }
    void add(int e, long size, long other, bool polar)
    {
        int j = std::max(model.effect[e].joint - 1, 0);
        Pair p = {size, other, polar, mk_plant(model.plant)->rest[j]};
        double a = mk_model_parameter(&model, free[(size_t)size]);
        double b = mk_model_parameter(&model, free[(size_t)other]);
        double s = scale(size), t = scale(other);
        a = std::max(std::fabs(a), 1e-6 * s);
        if (polar) {
            turn(size, size) = std::cos(b);
            turn(size, other) = std::sin(b);
            turn(other, size) = -std::sin(b) / a * s / t;
            turn(other, other) = std::cos(b) / a * s / t;
            low(size) = -HUGE_VAL, high(size) = HUGE_VAL;
        } else {
            turn(other, size) = -(b - p.reference) / a * s / t;
            turn(other, other) = 1.0 / a * s / t;
        }
        low(other) = -HUGE_VAL, high(other) = HUGE_VAL;
        pairs.push_back(p);
    }
};

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
