// Fit: the local quadratic model with the states eliminated, and the way back to the states.
//
// About a point the cost is a quadratic in the steps (dx_i, dp) whose matrix is block tridiagonal
// in the states, with p as a border (ident/fit.cpp has the cost). eliminate_log() takes the states
// out one after the other, which is an information filter; substitute() is the smoother of
// J. Rauch, F. Tung, C. Striebel 1965. What is left between them is a dense quadratic in dp.
//
// Decompositions are those of base/dense.hpp.
#include <cmath>

#include "base/dense.hpp"
#include "ident/fit_priv.hpp"

namespace mk
{

using dense::product;
using dense::product_transpose;
using dense::transpose_product;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Eliminates the states of one log, first to last. Before interval i, all that earlier intervals
// say of the step x of node i and of the parameters p is the quadratic
//     x'A x/2 + x'C p - a'x  +  p'D p/2 - d'p .
// A is ns x ns, C is ns x nf, and D, d are out.information and out.gradient, which gather what is
// left of p. One interval takes three operations.
//
// 1. Add the interval's normal equations: blocks of J'J to A, C, D and of J'r to a, d.
//
// 2. Eliminate x. Given p, x ~ N(P (a - C p), P) with P = A^-1. Put in, this leaves
//     D <- D - C'P C ,   d <- d - C'P a .
//
// 3. Carry on through x_next = c + F x + B p + w, w ~ N(0, Q). Given p, x_next is normal with
//     mean        mu + G p ,   mu = c + F P a ,   G = B - F P C ,
//     covariance  S = F P F' + Q ,
// which in the form above is, for the next node,
//     A = S^-1 ,   C = -S^-1 G ,   a = S^-1 mu ,   D += G'S^-1 G ,   d -= G'S^-1 mu .
// Only S is inverted, never Q: next to no process noise is no trouble.
//
// Laplace's integral over the states (for nlml) has the determinant of the whole state matrix H_xx
// and the norms of the continuity defects. They come along without H_xx ever being formed, because
// |A| |Q + F A^-1 F'| = |Q| |A + F'Q^-1 F|:
//     1/2 log|H_xx| + 1/2 sum_i log|Q_i| = 1/2 sum_i (log|A_i| + log|S_i|) .
//
// With p held, the cost falls by out.state_decrease when the states step to their best:
//     sum_i (a'P a + c'Q^-1 c - mu'S^-1 mu) / 2 .
//
// `damping` is Levenberg-Marquardt's on the states, in units of what the interval's own readings
// say.
void Fit::eliminate_log(const FitPoint &point, size_t l, double damping, QuadraticModel &out)
{
    MatrixXd &D = out.information;
    VectorXd &d = out.gradient;
    const long ns = mk_model_state_count(&point.model), nf = d.size();
    const int joints = mk_model_joints(&point.model);
    const VectorXd freedom = state_freedom(point.model);
    VectorXd x0 = point.nodes[l].x.col(0);
    double rest[MK_MAX_STATES];
    mk_model_initial_state(&model_of(point, l), x0.data(), x0.data() + joints, rest);
    // Before the first interval: the prior of effects' states. 1e-9 (a standard deviation of 3e4)
    // keeps A regular where no reading sees a state.
    MatrixXd A = MatrixXd::Identity(ns, ns) * 1e-9, C = MatrixXd::Zero(ns, nf);
    VectorXd a = VectorXd::Zero(ns);
    for (long s = 2 * joints; s < ns; s++) {
        double std = HIDDEN_STD * freedom(s);
        A(s, s) += 1.0 / (std * std);
        a(s) += (rest[s] - x0(s)) / (std * std);
    }
    for (size_t i = 0; i < work[l].size(); i++) {
        Segment &s = work[l][i];
        // Taken at another noise, they go with 1/sigma_j^2.
        for (int j = 0; j < joints; j++) {
            const double share = std::pow(slopes->point.noise[j] / point.noise[j], 2);
            A += share * s.normal[j].topLeftCorner(ns, ns);
            C += share * s.normal[j].topRightCorner(ns, nf);
            D += share * s.normal[j].bottomRightCorner(nf, nf);
            a += share * s.right[j].head(ns);
            if (damping > 0.0)
                A.diagonal() += damping * share * s.normal[j].diagonal().head(ns);
            d += share * s.right[j].tail(nf);
        }
        // invert_positive returns log sqrt(determinant), half of the logarithm that the formula
        // has.
        out.log_determinant += dense::invert_positive(A, s.P);
        s.C = C;
        s.a = a;
        const MatrixXd CP = transpose_product(C, s.P);
        D -= product(CP, C);
        d -= product(CP, a);
        out.state_decrease += 0.5 * a.dot(product(s.P, a));
        if (s.last)
            break;
        s.F = s.jac_end.topRows(ns).transpose();
        const MatrixXd &F = s.F;
        MatrixXd B = s.jac_end.bottomRows(nf).transpose();
        VectorXd gap = s.x_end - point.nodes[l].x.col((long)i + 1);
        const MatrixXd FP = product(F, s.P);
        MatrixXd S = product_transpose(FP, F);
        const VectorXd variance = process_variance(point, l, i);
        S.diagonal() += variance;
        out.log_determinant += dense::invert_positive(S, s.A_next);
        s.mu = gap + product(FP, a);
        out.state_decrease += 0.5 * (gap.cwiseAbs2().cwiseQuotient(variance).sum() -
                                     s.mu.dot(product(s.A_next, s.mu)));
        s.G = B - product(FP, C);
        const MatrixXd GA = transpose_product(s.G, s.A_next);
        D += product(GA, s.G);
        d -= product(GA, s.mu);
        A = s.A_next;
        C = -product(s.A_next, s.G);
        a = product(s.A_next, s.mu);
    }
}

QuadraticModel Fit::eliminate(const FitPoint &point, const std::vector<int> &free, double damping)
{
    QuadraticModel out;
    // Sum over logs. Where parameters have own values, the logs of one source see other values of p
    // than those of the next: their quadratics are first added by source, and the own values
    // eliminated from each. A trajectory that ran away has no derivatives: `finite` stays false.
    const long nf = (long)free.size();
    out.information.setZero(nf, nf);
    out.gradient.setZero(nf);
    for (const std::vector<Segment> &segments : work)
        for (const Segment &s : segments)
            if (!s.finite)
                return out;
    sources.assign(point.own.size(), {});
    for (size_t l = 0; l < logs.size(); l++) {
        if (sources.empty()) {
            eliminate_log(point, l, damping, out);
            continue;
        }
        QuadraticModel part;
        part.information.setZero(nf, nf);
        part.gradient.setZero(nf);
        eliminate_log(point, l, damping, part);
        out.log_determinant += part.log_determinant;
        out.state_decrease += part.state_decrease;
        Source &source = sources[(size_t)logs[l]->source];
        if (source.d.size() == 0)
            source.D = part.information, source.d = part.gradient;
        else
            source.D += part.information, source.d += part.gradient;
    }
    eliminate_own(point, free, out);
    // Rounding makes D a little unsymmetric; LDL' reads one half of it.
    MatrixXd &D = out.information;
    D = 0.5 * (D + D.transpose().eval());
    for (size_t l = 0; l < logs.size(); l++)
        for (int j = 0; j < mk_model_joints(&point.model); j++)
            for (double w : logs[l]->weight[j])
                out.log_determinant += w * w * std::log(point.noise[j]);
    out.finite = D.allFinite() && out.gradient.allFinite() && std::isfinite(out.log_determinant);
    return out;
}

// Moves the states and the own values along with a step of the parameters, last node to first (the
// smoother of Rauch, Tung, Striebel). With the next node's step known,
//     dx_i = P (a - C dp + F' S^-1 (dx_(i+1) - mu - G dp)) ;
// the last interval has no such term. `step` is dp as it is taken, already shortened to `length` of
// the full one: a, mu and beta, which are not proportional to dp, are shortened here, so that all
// unknowns go the same share of the way.
void Fit::substitute(FitPoint &point, const VectorXd &step, double length) const
{
    std::vector<VectorXd> own_step; // of the parameters as a source sees them
    const std::vector<int> own = own_parameters(point.model);
    for (size_t n = 0; n < sources.size(); n++) {
        const Source &s = sources[n];
        VectorXd seen = step;
        if (!s.place.empty()) {
            const VectorXd b =
                product(s.P, VectorXd(length * s.beta - transpose_product(s.K, step)));
            for (size_t i = 0; i < s.place.size(); i++) {
                seen(s.place[i]) += b((long)i);
                point.own[n]((long)s.which[i]) +=
                    b((long)i) * scale_of(point.model, own[s.which[i]]);
            }
        }
        own_step.push_back(std::move(seen));
    }
    for (size_t l = 0; l < logs.size(); l++) {
        const VectorXd &by = own_step.empty() ? step : own_step[(size_t)logs[l]->source];
        VectorXd next;
        for (size_t i = work[l].size(); i-- > 0;) {
            const Segment &s = work[l][i];
            VectorXd right = length * s.a - product(s.C, by);
            if (!s.last) {
                const VectorXd rest = next - length * s.mu - product(s.G, by);
                right += transpose_product(s.F, product(s.A_next, rest));
            }
            next = product(s.P, right);
            point.nodes[l].x.col((long)i) += next;
        }
    }
}

} // namespace mk
