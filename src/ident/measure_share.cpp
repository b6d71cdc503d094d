// What the simple experiments share: sections of logs, means, a regression, lists of results.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "base/dense.hpp"
#include "ident/measure.hpp"

namespace mk
{

namespace
{

constexpr double UNKNOWN = std::numeric_limits<double>::quiet_NaN();

// Least-squares parabola through the readings of rows [first, last); false: too few.
bool parabola(const mk_record &rec, size_t first, size_t last, Section &p)
{
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    double middle = 0.5 * (p.begin + p.end), half = 0.5 * (p.end - p.begin), base = UNKNOWN;
    double u = 0.0, square = 0.0;
    size_t readings = 0, commands = 0;
    for (size_t k = first; k < last; k++) {
        double q = rec.q[0][k];
        if (!rec.u[0] || !std::isnan(rec.u[0][k])) {
            u += rec.u[0] ? rec.u[0][k] : 0.0;
            commands++;
        }
        if (std::isnan(q))
            continue;
        if (std::isnan(base))
            base = q;
        double s = (rec.t[k] - middle) / half;
        Eigen::Vector3d row(1.0, s, s * s);
        normal += row * row.transpose();
        right += (q - base) * row;
        square += (q - base) * (q - base);
        readings++;
    }
    if (readings < 8 || commands == 0)
        return false;
    Eigen::Vector3d c = dense::solve_symmetric(normal, Eigen::VectorXd(right));
    p.q = base + c(0);
    p.v = c(1) / half;
    p.a = 2.0 * c(2) / (half * half);
    p.v_begin = p.v - p.a * half;
    p.v_end = p.v + p.a * half;
    p.u = u / (double)commands;
    p.misfit = std::sqrt(std::max(0.0, square - c.dot(right)) / (double)readings);
    return c.allFinite();
}

} // namespace

std::vector<Section> cut(const MeasureProblem &problem, double seconds)
{
    std::vector<Section> pieces;
    for (size_t l = 0; l < problem.records.size(); l++) {
        const mk_record &rec = problem.records[l];
        size_t first = 0;
        while (first + 1 < rec.rows) {
            size_t last = first + 1;
            while (last < rec.rows && rec.t[last] < rec.t[first] + seconds - 1e-9)
                last++;
            if (last == rec.rows)
                break; // an unfinished piece
            Section p = {};
            p.log = l;
            p.begin = rec.t[first];
            p.end = rec.t[last];
            if (parabola(rec, first, last, p))
                pieces.push_back(p);
            first = last;
        }
    }
    return pieces;
}

mk_quantity weighted_mean(const std::vector<double> &value, const std::vector<double> &error)
{
    mk_quantity q = {};
    double weights = 0.0, sum = 0.0, chi2 = 0.0;
    for (size_t i = 0; i < value.size(); i++) {
        double w = 1.0 / (error[i] * error[i]);
        weights += w;
        sum += w * value[i];
    }
    q.value = sum / weights;
    for (size_t i = 0; i < value.size(); i++)
        chi2 += std::pow((value[i] - q.value) / error[i], 2);
    double inflate = value.size() > 1 ? std::sqrt(chi2 / (double)(value.size() - 1)) : 1.0;
    q.std_error = std::max(1.0, inflate) / std::sqrt(weights);
    return q;
}

Regressed regress_plain(const Eigen::MatrixXd &x, const Eigen::VectorXd &y)
{
    Regressed r;
    r.determined = false;
    if (x.rows() <= x.cols())
        return r;
    Eigen::VectorXd scale = x.colwise().norm().transpose().cwiseMax(1e-300);
    Eigen::MatrixXd unit = x * scale.cwiseInverse().asDiagonal();
    Eigen::VectorXd b;
    if (!dense::least_squares(unit, y, 1e-6, b))
        return r;
    r.value = scale.cwiseInverse().cwiseProduct(b);
    r.residual = y - dense::product(x, r.value);
    double variance = r.residual.squaredNorm() / (double)(x.rows() - x.cols());
    Eigen::MatrixXd inverse = dense::inverse(dense::transpose_product(unit, unit));
    r.covariance =
        variance * scale.cwiseInverse().asDiagonal() * inverse * scale.cwiseInverse().asDiagonal();
    r.determined = true;
    return r;
}

void add_quantity(mk_measurement &out, const char *name, const char *unit, double value,
                  double std_error, double given)
{
    if (out.quantity_count == MK_MAX_QUANTITIES)
        return;
    mk_quantity &q = out.quantity[out.quantity_count++];
    snprintf(q.name, sizeof q.name, "%s", name);
    q.unit = unit;
    q.value = value;
    q.std_error = std_error;
    q.given = given;
}

void add_run(mk_measurement &out, size_t log, double begin, double end, double x, double y,
             double misfit)
{
    if (out.run_count < MK_MAX_RUNS)
        out.run[out.run_count++] = {log, begin, end, x, y, misfit};
}

void add_warning(mk_measurement &out, const std::string &text)
{
    if (out.warning_count < MK_MAX_MEASURE_WARNINGS)
        snprintf(out.warning[out.warning_count++], sizeof out.warning[0], "%s", text.c_str());
}

} // namespace mk
