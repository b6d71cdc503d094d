// Fit: parameters with a value of their own in every log, which are random effects.
//
// The value that log l sees is mean + b_l with b_l ~ N(0, spread^2). The mean is one of the free
// parameters; the b_l are eliminated source by source, after the states of the source's logs
// (eliminate_own), and the spread is where the likelihood with the b_l integrated out is largest
// (update_spreads). J. Pinheiro, D. Bates: Mixed-Effects Models in S and S-PLUS, 2000.
#include <algorithm>
#include <cmath>

#include "base/dense.hpp"
#include "ident/fit_priv.hpp"

namespace mk
{

using Eigen::MatrixXd;
using Eigen::VectorXd;

std::vector<int> own_parameters(const mk_model &model)
{
    std::vector<int> own;
    if (!mk_model_has_own_values(&model))
        return own;
    for (int i = 0; i < mk_model_parameter_count(&model); i++)
        if (mk_model_parameter_spread(&model, i) > 0.0)
            own.push_back(i);
    return own;
}

mk_model model_of_source(const FitPoint &point, int source)
{
    mk_model m = point.model;
    const std::vector<int> own = own_parameters(m);
    for (size_t i = 0; i < own.size(); i++) {
        const mk_parameter_info *info = mk_model_parameter_info(&m, own[i], nullptr, 0);
        const double more =
            (size_t)source < point.own.size() ? point.own[(size_t)source]((long)i) : 0.0;
        const double value = mk_model_parameter(&m, own[i]) + more;
        mk_model_set_parameter(&m, own[i], std::min(std::max(value, info->min), info->max));
        mk_model_set_parameter_spread(&m, own[i], 0.0);
    }
    return m;
}

const mk_model &Fit::model_of(const FitPoint &point, size_t log) const
{
    return point.own.empty() ? point.model : data[log].model;
}

// Prior of the own values, b ~ N(0, spread^2): 1/2 sum (b / spread)^2.
double Fit::own_cost(const FitPoint &point) const
{
    double sum = 0.0;
    const std::vector<int> own = own_parameters(point.model);
    for (const VectorXd &b : point.own)
        for (size_t i = 0; i < own.size(); i++)
            sum += 0.5 * std::pow(b((long)i) / mk_model_parameter_spread(&point.model, own[i]), 2);
    return sum;
}

// Eliminates the own values b of each source. Its logs see p + E b in place of p, E the columns of
// unity that pick the means (`place`), so their quadratic p'D p/2 - d'p becomes one in (p, b). With
// b0 the own values now, spread s and everything in scaled units, u = scale / s, the prior of b0 +
// b adds
//     1/2 (b0/s + u b)^2 = b0^2 / (2 s^2) + (b0/s) u b + u^2 b^2 / 2 .
// So b is normal given p, and with K = D E
//     P    = (E'D E + u^2)^-1 ,   beta = E'd - u b0/s ,   b = P (beta - K'p) ,
//     D   <- D - K P K' ,         d <- d - K P beta .
// The integral over b gives log|P^-1| / 2 - sum log u for nlml (u is the norm of the prior in
// scaled units) and takes beta'P beta / 2 off the cost.
void Fit::eliminate_own(const FitPoint &point, const std::vector<int> &free, QuadraticModel &out)
{
    const std::vector<int> own = own_parameters(point.model);
    for (size_t n = 0; n < sources.size(); n++) {
        Source &s = sources[n];
        if (s.d.size() == 0)
            continue; // no piece of this log is fitted
        for (size_t i = 0; i < own.size(); i++)
            for (size_t f = 0; f < free.size(); f++)
                if (free[f] == own[i])
                    s.place.push_back((long)f), s.which.push_back(i);
        out.information += s.D;
        out.gradient += s.d;
        if (s.place.empty())
            continue;
        const long count = (long)s.place.size();
        MatrixXd M(count, count);
        s.K.resize(s.D.rows(), count);
        s.beta.resize(count);
        for (long i = 0; i < count; i++) {
            s.K.col(i) = s.D.col(s.place[(size_t)i]);
            s.beta(i) = s.d(s.place[(size_t)i]);
            for (long k = 0; k < count; k++)
                M(i, k) = s.D(s.place[(size_t)i], s.place[(size_t)k]);
        }
        for (size_t i = 0; i < s.place.size(); i++) {
            const int number = own[s.which[i]];
            const double unit =
                scale_of(point.model, number) / mk_model_parameter_spread(&point.model, number);
            M((long)i, (long)i) += unit * unit;
            s.beta((long)i) -= point.own[n]((long)s.which[i]) /
                               mk_model_parameter_spread(&point.model, number) * unit;
            out.log_determinant -= std::log(unit);
        }
        out.log_determinant += dense::invert_positive(M, s.P);
        const MatrixXd KP = dense::product(s.K, s.P);
        out.information -= dense::product_transpose(KP, s.K);
        out.gradient -= dense::product(KP, s.beta);
        out.state_decrease += 0.5 * s.beta.dot(dense::product(s.P, s.beta));
    }
}

// Covariance of the parameters where the means of own values are known: inverse of the information
// without their rows and columns, which are 0 in it.
MatrixXd Fit::with_means_held(const MatrixXd &information) const
{
    std::vector<bool> is_mean((size_t)information.rows(), false);
    for (const Source &s : sources)
        for (long at : s.place)
            is_mean[(size_t)at] = true;
    std::vector<long> others;
    for (long i = 0; i < information.rows(); i++)
        if (!is_mean[(size_t)i])
            others.push_back(i);
    MatrixXd all = MatrixXd::Zero(information.rows(), information.cols());
    all(others, others) = inverse_of(information(others, others));
    return all;
}

namespace
{

// What the error of an own value is made of: b = P (beta - K'p), M = -P K'. Scaled units.
struct Shares {
    double P, unit;
    VectorXd M;
};

// Of values b_1 .. b_n of one parameter, with C the covariance of what is not a mean, the
// difference from their average has
//     var (b_l - mean b) = (1 - 1/n)^2 P_l + sum_(k != l) P_k / n^2 + m C m' ,   m = M_l - mean M .
void add_apart_errors(const MatrixXd &C, const std::vector<Shares> &shares,
                      std::vector<OwnValue> &all)
{
    for (size_t l = 0; l < all.size(); l++) {
        double n = 0.0, others = 0.0;
        VectorXd mean = VectorXd::Zero(C.rows());
        for (size_t k = 0; k < all.size(); k++)
            if (all[k].number == all[l].number) {
                n += 1.0, mean += shares[k].M;
                others += k == l ? 0.0 : shares[k].P;
            }
        const VectorXd m = shares[l].M - mean / n;
        const double variance = (1.0 - 1.0 / n) * (1.0 - 1.0 / n) * shares[l].P + others / (n * n) +
                                m.dot(dense::product(C, m));
        all[l].apart_error = shares[l].unit * std::sqrt(std::max(variance, 0.0));
    }
}

} // namespace

std::vector<OwnValue> Fit::own_values(const FitPoint &point, const QuadraticModel &quadratic) const
{
    std::vector<OwnValue> all;
    std::vector<Shares> shares; // in the order of `all`
    const std::vector<int> own = own_parameters(point.model);
    const MatrixXd cov = own.empty() ? MatrixXd() : inverse_of(quadratic.information);
    for (size_t n = 0; n < sources.size(); n++) {
        const Source &s = sources[n];
        if (s.place.empty())
            continue;
        // Given p, b = P (beta - K'p) with covariance P; p itself has the covariance `cov`. So
        //     var b       = P + M cov M' ,              M = -P K' ,
        //     var (p + b) = P + (E' + M) cov (E' + M)' ,
        // E' + M being row i of M with 1 added in the column of its own mean.
        const MatrixXd by = -dense::product_transpose(s.P, s.K);
        for (size_t i = 0; i < s.place.size(); i++) {
            const long k = (long)i;
            const double unit = scale_of(point.model, own[s.which[i]]);
            VectorXd of_b = by.row(k), of_value = of_b;
            of_value(s.place[i]) += 1.0;
            OwnValue v;
            v.number = own[s.which[i]];
            v.source = (int)n;
            v.deviation = point.own[n]((long)s.which[i]);
            const auto error = [&](const VectorXd &of) {
                return unit * std::sqrt(std::max(s.P(k, k) + of.dot(dense::product(cov, of)), 0.0));
            };
            v.deviation_error = error(of_b);
            v.value = mk_model_parameter(&point.model, v.number) + v.deviation;
            v.std_error = error(of_value);
            all.push_back(v);
            shares.push_back({s.P(k, k), unit, of_b});
        }
    }
    if (!all.empty())
        add_apart_errors(with_means_held(quadratic.information), shares, all);
    return all;
}

// Spread of largest marginal likelihood, by the fixed point of D. MacKay, Neural Computation 4,
// 1992:
//     spread^2 = sum_l b_l^2 / gamma ,   gamma = sum_l (1 - var b_l / spread^2) ,
// gamma counting how many of the own values the data determine rather than the prior. With well
// determined values and a free mean gamma is the number of logs less one: the sample variance. One
// round changes a spread by a factor of 10 at most, and `gamma` near 0 is kept at 1e-3.
double Fit::update_spreads(FitPoint &point, const QuadraticModel &quadratic)
{
    // Least spread, of the parameter's scale: logs that do not differ end there, next to no spread.
    constexpr double LEAST = 1e-3;
    double change = 0.0;
    const std::vector<OwnValue> values = own_values(point, quadratic);
    for (int number : own_parameters(point.model)) {
        const double before = mk_model_parameter_spread(&point.model, number);
        double squares = 0.0, determined = 0.0;
        int count = 0;
        for (const OwnValue &v : values) {
            if (v.number != number)
                continue;
            squares += v.deviation * v.deviation;
            determined += std::max(1.0 - std::pow(v.deviation_error / before, 2), 0.0);
            count++;
        }
        // One log tells nothing about how logs differ.
        if (count < 2)
            continue;
        const double least = LEAST * scale_of(point.model, number);
        const double next = std::max(std::sqrt(squares / std::max(determined, 1e-3)), least);
        const double now = std::min(std::max(next, 0.1 * before), 10.0 * before);
        change = std::max(change, std::fabs(now / before - 1.0));
        mk_model_set_parameter_spread(&point.model, number, now);
    }
    return change;
}

} // namespace mk
