#include "ident/excite_cost.hpp"
#include "base/dense.hpp"

#include <algorithm>
#include <cmath>

namespace mk
{

using Eigen::VectorXd;

static constexpr double PI = 3.14159265358979323846;

double excess(double value, double limit)
{
    return std::max(0.0, value / limit - 1.0);
}

double beyond_limits(const mk_model &model, const mk_excite_options &o, const Extent &e)
{
    const mk_plant_info *plant = mk_plant(model.plant);
    double sum = 0.0;
    for (int j = 0; j < plant->joints; j++) {
        sum += excess(e.v_max[j], o.v_max[j]);
        if (plant->joint_is_wheel[j])
            continue;
        double range = o.q_max[j] - o.q_min[j];
        sum += std::max(0.0, e.q_max[j] - o.q_max[j]) / range;
        sum += std::max(0.0, o.q_min[j] - e.q_min[j]) / range;
    }
    return sum;
}

double Led::condition(bool scaled) const
{
    VectorXd s = VectorXd::Ones(normal.rows());
    if (scaled)
        s = normal.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    Eigen::MatrixXd m = s.asDiagonal() * normal * s.asDiagonal();
    VectorXd e = dense::eigenvalues(m);
    return e(0) > 0.0 ? std::sqrt(e(e.size() - 1) / e(0)) : HUGE_VAL;
}

Led lead(const mk_model &model, const Series &series, int points)
{
    long np = mk_plant(model.plant)->parameter_count;
    Led led;
    led.normal = Eigen::MatrixXd::Zero(np, np);
    VectorXd row(np);
    for (int k = 0; k < points; k++) {
        double q, v, a, u;
        series.at(2.0 * PI / series.omega * k / points, q, v, a);
        mk_plant_regressor(&model, &q, &v, &a, row.data());
        mk_plant_inverse_dynamics(&model, &q, &v, &a, &u);
        led.normal.selfadjointView<Eigen::Lower>().rankUpdate(row);
        led.u_max = std::max(led.u_max, std::fabs(u));
        Extent &e = led.extent;
        e.q_min[0] = k ? std::min(e.q_min[0], q) : q;
        e.q_max[0] = k ? std::max(e.q_max[0], q) : q;
        e.v_max[0] = std::max(e.v_max[0], std::fabs(v));
    }
    led.normal = led.normal.selfadjointView<Eigen::Lower>();
    return led;
}

Extent extent_of(const PredictedExperiment &f)
{
    Extent e;
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        e.q_min[j] = f.q_min[j];
        e.q_max[j] = f.q_max[j];
        e.v_max[j] = f.v_max[j];
    }
    return e;
}

double value_of(enum mk_excite_criterion criterion, const Eigen::MatrixXd &covariance)
{
    VectorXd variance = covariance.diagonal();
    double n = (double)variance.size();
    if (criterion == MK_EXCITE_WORST)
        return std::sqrt(variance.maxCoeff());
    if (criterion == MK_EXCITE_A)
        return std::sqrt(variance.sum() / n);
    VectorXd unit = variance.cwiseMax(1e-300).cwiseSqrt();
    Eigen::MatrixXd correlation =
        unit.cwiseInverse().asDiagonal() * covariance * unit.cwiseInverse().asDiagonal();
    double log_det = 0.0;
    VectorXd pivots = dense::pivots(correlation);
    for (long i = 0; i < variance.size(); i++)
        log_det += std::log(unit(i)) + 0.5 * std::log(std::max(pivots(i), 1e-30));
    return std::exp(log_det / n);
}

} // namespace mk
