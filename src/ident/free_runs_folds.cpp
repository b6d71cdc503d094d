// Free runs: the quadratics of the windows added up by fold, own values of each fold eliminated,
// and what they say of parameters, of spreads and of the folds that are left out.
//
// Leaving fold f out of the sum, one Gauss-Newton step and the quadratics of f's own windows give
// at once what a fit to all other folds would leave in f (left_out): cross-validation without
// further fits. ident/free_runs.cpp has the symbols.
#include <algorithm>
#include <cmath>

#include "base/dense.hpp"
#include "ident/free_runs_priv.hpp"
#include "ident/stepper.hpp"

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace mk
{

// --- the quadratic of a fold ---

// A and a of a fold: Gauss-Newton's terms of its windows,
//     A = sum_w sum_j rho'(e_w) nu / s_j^2 H_wj ,   a likewise of g_wj .
// Both are for the columns `columns` of the quadratics, n x n and n; `first_half` takes the windows
// of first halves of logs only. Windows that cannot be run, or were left out by the stride, add
// nothing.
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
// `information` and `gradient` are for the `wanted` parameters in scaled units; cost and nlml are
// not set.
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
        p.information += part.A - dense::product_transpose(dense::product(part.K, part.M), part.K);
        p.gradient += part.a - dense::product(part.K, dense::product(part.M, part.beta));
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

// --- what the folds say ---

// Spread of own values by expectation and maximisation: given the data b is normal with mean b0 and
// covariance M (parameters held), so that
//     spread^2 = E[b^2] = 1/folds sum_f (b_f^2 + scale^2 M_f) .
// Changes the spreads of the model and, with them, the cost of the point.
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
                square =
                    unit * (q.squares[j] - 2.0 * q.g[j].dot(d) + d.dot(dense::product(q.H[j], d)));
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
// Errors are predictions by quadratics, with no run of a model: as good as the step is small. False
// where a system without some fold has no finite solution.
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
            const VectorXd b = dense::product(
                begin.M, VectorXd(begin.beta - dense::transpose_product(begin.K, step)));
            for (size_t i = 0; i < own.size(); i++)
                step(place[i]) += b((long)i);
        }
        add_errors(quadratic, columns, f, halves, step, out);
    }
    return true;
}

} // namespace mk
