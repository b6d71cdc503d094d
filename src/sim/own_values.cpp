// The own values b of a log, b ~ N(0, spread^2) about the model's means, from free runs over
// windows of its beginning:
//     b = argmin sum_w c_w min_{x_w} |W (y_w - h(x_w, b))|^2 + |b / spread|^2 .
// The start state x_w of each window is a nuisance and is eliminated from its normal equations. A
// window in which the model is far off says little: c_w = 1 / (typical + its own mean square
// error), by iteratively reweighted least squares (Cauchy's function), and readings closer together
// than the model's error changes count as one.
#include "sim/own_values.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <memory>
#include <new>
#include <vector>

#include "base/dense.hpp"
#include "sim/effect_memory.hpp"

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace
{

constexpr double SAME_ERROR = 0.05; // s over which a model's error hardly changes
constexpr double SETTLED = 1e-3;    // step, in standard errors
constexpr int MOST_STEPS = 12;
constexpr size_t FEWEST_ROWS = 12; // of a window

// A parameter with a value of its own: where it is, and its number as in mechkit/ident.h.
struct Own {
    int effect, parameter, number;
    double mean, spread;
};

std::vector<Own> own_of(const mk_model &model)
{
    std::vector<Own> all;
    int number = mk_plant(model.plant)->parameter_count;
    for (int e = 0; e < model.effect_count; e++) {
        const mk_effect_use &use = model.effect[e];
        const int count = mk_effect(use.index)->parameter_count;
        for (int k = 0; k < count; k++)
            if (use.spread[k] > 0.0)
                all.push_back({e, k, number + k, use.value[k], use.spread[k]});
        number += count;
    }
    return all;
}

struct Window {
    size_t first, last;
    VectorXd x;
    bool runs = false;
    double error = HUGE_VAL; // mean square by row, counts^2
};

class Estimate
{
  public:
    Estimate(mk_start_finder &finder, const mk_model &model, const mk_record &record, size_t rows,
             double window_s)
        : f(finder), given(model), now(model), own(own_of(model))
    {
        for (const Own &o : own)
            number.push_back(o.number), unit.push_back(o.spread);
        for (Own &o : own)
            now.effect[o.effect].spread[o.parameter] = 0.0;
        f.model = &now;
        b = VectorXd::Zero((long)own.size());
        const double period = (f.t[rows - 1] - f.t[0]) / (double)std::max<size_t>(rows - 1, 1);
        together = std::max(1.0, SAME_ERROR / period);
        for (size_t first = 0; first < rows;) {
            size_t last = first + 1;
            const double *left_out = record.left_out; // where a window ends
            while (last < rows && f.t[last] - f.t[first] < window_s &&
                   !(left_out && left_out[last - 1] != left_out[last]))
                last++;
            if (last - first >= FEWEST_ROWS && !(left_out && left_out[first] != 0.0))
                window.push_back({first, last, {}, false, HUGE_VAL});
            first = last;
        }
    }

    void run()
    {
        solve_windows();
        for (int i = 0; i < MOST_STEPS && take_typical(); i++) {
            const VectorXd step = next_step(), from = b;
            if (!improve(from, step)) {
                set(from);
                break;
            }
            if (std::sqrt(step.dot(precision * step)) < SETTLED)
                break;
        }
        if (take_typical())
            next_step(); // the precision where it ended
    }
    const mk_model &model() const { return now; }
    int report(mk_own_estimate *found) const
    {
        const MatrixXd cov = precision.size() ? mk::dense::inverse(precision)
                                              : MatrixXd::Identity(b.size(), b.size());
        int count = 0;
        for (const Own &o : own) {
            if (count == MK_MAX_OWN_ESTIMATES)
                break;
            const double error = o.spread * std::sqrt(std::max(cov(count, count), 0.0));
            found[count++] = {o.effect, o.parameter, now.effect[o.effect].value[o.parameter],
                              error};
        }
        return count;
    }

  private:
    mk_start_finder &f;
    const mk_model &given;
    mk_model now;
    std::vector<Own> own;
    std::vector<int> number;
    std::vector<double> unit;
    VectorXd b; // in spreads
    MatrixXd precision;
    std::vector<Window> window;
    double typical = 0.0;     // mean square error of a reading, counts^2
    double together;          // readings that share one model error
    double independent = 1.0; // errors per reading

    void set(const VectorXd &values)
    {
        b = values;
        for (size_t i = 0; i < own.size(); i++) {
            const Own &o = own[i];
            const mk_parameter_info &info =
                mk_effect(given.effect[o.effect].index)->parameter[o.parameter];
            const double value = o.mean + o.spread * b((long)i);
            now.effect[o.effect].value[o.parameter] = std::min(std::max(value, info.min), info.max);
        }
    }
    // Start states of all windows at the values as they are: of those that ran before from where
    // they were.
    void solve_windows()
    {
        for (const bool near : {true, false})
            solve_some(near);
        for (Window &w : window)
            w.runs = std::isfinite(w.error);
    }
    void solve_some(bool near)
    {
        std::vector<mk::WindowFit> fits;
        std::vector<VectorXd> states;
        std::vector<size_t> of;
        fits.reserve(window.size());
        for (size_t i = 0; i < window.size(); i++) {
            Window &w = window[i];
            if (w.runs != near)
                continue;
            if (w.x.size() == 0)
                w.x = VectorXd::Zero(mk_model_state_count(&now));
            w.error = HUGE_VAL;
            if (!near && !mk::first_guess(f, w.last, w.first, w.x))
                continue;
            fits.emplace_back(f, w.first, w.last);
            states.push_back(w.x);
            of.push_back(i);
        }
        const std::vector<char> solved =
            near ? mk::WindowFit::solve_near(fits, states, mk::WindowFit::Care::usual)
                 : mk::WindowFit::solve(fits, states);
        const std::vector<double> squares = mk::WindowFit::costs(fits, states);
        for (size_t k = 0; k < of.size(); k++) {
            Window &w = window[of[k]];
            w.x = states[k];
            if (solved[k])
                w.error = squares[k] / (double)(w.last - w.first);
        }
    }
    // The median window sets the scale of errors that are usual; false if none runs.
    bool take_typical()
    {
        // What the readings' noise makes is new in every reading, the rest is the model's.
        constexpr double NOISE = 0.25; // counts^2: rounding and some jitter
        std::vector<double> errors;
        for (const Window &w : window)
            if (w.runs)
                errors.push_back(w.error);
        if (errors.empty())
            return false;
        const auto middle = errors.begin() + (long)errors.size() / 2;
        std::nth_element(errors.begin(), middle, errors.end());
        typical = std::max(*middle, NOISE);
        independent = typical / (NOISE + together * (typical - NOISE));
        return true;
    }
    double cost() const
    {
        constexpr double LOST = 1e6; // times the usual: as far off as can be
        double sum = 0.5 * b.squaredNorm();
        for (const Window &w : window)
            sum += 0.5 * independent * (double)(w.last - w.first) *
                   std::log1p(std::min(w.error / typical, LOST));
        return sum;
    }
    // Along a step, as far as it lowers the cost.
    bool improve(const VectorXd &from, const VectorXd &step)
    {
        const double before = cost();
        const std::vector<Window> kept = window;
        for (double share = 1.0; share > 0.1; share *= 0.5) {
            set(from + share * step);
            solve_windows();
            if (cost() < before)
                return true;
            window = kept;
        }
        return false;
    }
    // Gauss-Newton: the windows' normal equations without their start states, and the prior.
    VectorXd next_step()
    {
        const long n = b.size();
        precision = MatrixXd::Identity(n, n);
        VectorXd g = -b;
        std::vector<mk::WindowFit> fits;
        std::vector<VectorXd> x;
        std::vector<double> error;
        for (const Window &w : window)
            if (w.runs) {
                fits.emplace_back(f, w.first, w.last);
                fits.back().differentiate_by(number, unit);
                x.push_back(w.x);
                error.push_back(w.error);
            }
        std::vector<mk::WindowNormal> normals;
        const std::vector<char> fine = mk::WindowFit::normals_at(fits, x, normals);
        for (size_t w = 0; w < fits.size(); w++) {
            if (!fine[w])
                continue;
            const mk::WindowNormal &e = normals[w];
            const long ns = x[w].size();
            MatrixXd states = e.H.topLeftCorner(ns, ns);
            states.diagonal() *= 1.0 + 1e-9;
            states.diagonal().array() += 1e-9;
            const MatrixXd K = e.H.topRightCorner(ns, n);
            // K and the gradient in one go.
            MatrixXd both(ns, n + 1);
            both.leftCols(n) = K;
            both.col(n) = e.g.head(ns);
            const MatrixXd solved = mk::dense::solve_symmetric(states, both);
            const double weight = independent / (typical + error[w]);
            precision += weight * (e.H.bottomRightCorner(n, n) -
                                   mk::dense::transpose_product(K, MatrixXd(solved.leftCols(n))));
            g += weight * (e.g.tail(n) - mk::dense::transpose_product(K, VectorXd(solved.col(n))));
        }
        return mk::dense::solve_symmetric(precision, g);
    }
};

} // namespace

enum mk_status mk_find_own_values(const mk_record *record, const mk_model *model, size_t rows,
                                  double window_s, mk_model *out, mk_own_estimate *found,
                                  int *count, mk_error *err)
try {
    std::unique_ptr<mk_start_finder, void (*)(mk_start_finder *)> finder(
        mk_start_finder_create(record, model), mk_start_finder_destroy);
    if (!finder)
        throw std::bad_alloc();
    Estimate estimate(*finder, *model, *record, rows, window_s);
    estimate.run();
    *out = estimate.model();
    *count = estimate.report(found);
    return MK_OK;
} catch (const std::bad_alloc &) {
    return mk_error_set(err, MK_ERR_NOMEM, "no memory for what a log has of its own");
}
