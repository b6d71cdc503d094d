#include "ident/information.hpp"

#include <algorithm>
#include <cmath>

#include "base/dense.hpp"
#include "ident/fit.hpp"
#include "sim/shoot.hpp"

namespace mk
{

namespace
{

using Eigen::MatrixXd;
using Eigen::VectorXd;

// Standard deviations before the experiment: so large that the readings decide.
constexpr double STATE_PRIOR = 1.0, PARAMETER_PRIOR = 30.0;

// Runs the model from shooting interval to shooting interval with derivatives by the state at the
// shooting interval's start and by the parameters, and carries a square root of their joint
// covariance along (a Kalman filter around the predicted trajectory: P. Maybeck, Stochastic Models,
// vol. 1, ch. 7).
class Forecast
{
  public:
    Forecast(const mk_model &m, const std::vector<double> &command, double dt,
             const std::vector<int> &numbers, const InformationOptions &o)
        : model(m), u(command), period(dt), free(numbers), options(o), joints(mk_model_joints(&m)),
          ns(mk_model_state_count(&m)), np((long)numbers.size()), zero(command.size(), 0.0),
          x(VectorXd::Zero(ns)), root(MatrixXd::Zero(ns + np, ns + np)),
          sensitivity(MatrixXd::Zero(np, np)), chain(MatrixXd::Zero(ns, np))
    {
        for (int number : free)
            scale.push_back(Fit::scale_of(m, number));
        for (size_t k = 0; k < u.size(); k++)
            t.push_back((double)k * period);
        for (int j = 0; j < joints; j++)
            weight[j].assign(u.size(), std::sqrt(o.readings_a_row) / o.noise[j]);
        const double still[MK_MAX_JOINTS] = {0.0, 0.0};
        mk_model_initial_state(&m, mk_plant(m.plant)->rest, still, x.data());
        root.diagonal().head(2 * joints).setConstant(STATE_PRIOR);
        root.diagonal().tail(np).setConstant(PARAMETER_PRIOR);
        lay_task();
    }

    PredictedExperiment run()
    {
        PredictedExperiment out;
        size_t per = std::max<size_t>(2, (size_t)std::lround(options.interval / period));
        for (size_t first = 0; first + 1 < u.size(); first += per) {
            size_t last = std::min(first + per, u.size() - 1);
            task.begin = t[first];
            task.end = t[last];
            task.last = last + 1 == u.size();
            task.x = x.data();
            shoot(task);
            if (!task.finite || !Eigen::Map<VectorXd>(x_end.data(), ns).allFinite())
                return {};
            keep_readings(out);
            learn();
            carry(t[last] - t[first]);
        }
        judge(out);
        return out;
    }

  private:
    const mk_model &model;
    const std::vector<double> &u;
    double period;
    const std::vector<int> &free;
    const InformationOptions &options;
    int joints;
    long ns, np;
    std::vector<double> t, zero, weight[MK_MAX_JOINTS], scale;
    VectorXd x;
    MatrixXd root;        // covariance of (state, parameters) = root root'
    MatrixXd sensitivity; // of all readings to the parameters, squared, start state known
    MatrixXd chain;       // of the state to the parameters
    std::vector<double> x_end, jac_end, residual, jac;
    std::vector<int> joint;
    ShootData data = {};
    ShootTask task = {};

    void lay_task()
    {
        data.rows = u.size();
        data.t = t.data();
        data.u[0] = u.data();
        data.u[1] = zero.data();
        for (int j = 0; j < joints; j++) {
            data.q[j] = zero.data();
            data.w[j] = weight[j].data();
        }
        size_t columns = (size_t)(ns + np);
        size_t rows = ((size_t)std::lround(options.interval / period) + 4) * (size_t)joints;
        x_end.resize((size_t)ns);
        jac_end.resize((size_t)ns * columns);
        residual.resize(rows);
        jac.resize(rows * columns);
        joint.resize(rows);
        task.model = &model;
        task.data = &data;
        task.step = options.step;
        task.free_count = (int)np;
        task.free = free.data();
        task.scale = scale.data();
        task.columns = (int)columns;
        task.x_end = x_end.data();
        task.jac_end = jac_end.data();
        task.row_capacity = rows;
        task.residual = residual.data();
        task.jac = jac.data();
        task.joint_of = joint.data();
    }

    // Readings were given as 0: what is left is the prediction.
    void keep_readings(PredictedExperiment &out) const
    {
        for (size_t i = 0; i < task.row_count; i++) {
            int j = joint[i];
            out.q[j].push_back(-residual[i] / weight[j][0]);
        }
    }

    void learn()
    {
        // A column for each reading.
        const MatrixXd rows = Eigen::Map<MatrixXd>(jac.data(), ns + np, (long)task.row_count);
        const MatrixXd seen = dense::transpose_product(rows, root);
        MatrixXd gain = MatrixXd::Identity(ns + np, ns + np);
        gain += dense::transpose_product(seen, seen);
        root = dense::solve_by_root(gain, root.transpose()).transpose().eval();

        MatrixXd direct = rows.bottomRows(np).transpose();
        direct += dense::transpose_product(rows.topRows(ns), chain);
        sensitivity += dense::transpose_product(direct, direct);
    }

    void carry(double dt)
    {
        const MatrixXd end = Eigen::Map<MatrixXd>(jac_end.data(), ns + np, ns); // transposed
        MatrixXd wide = MatrixXd::Zero(ns + np, ns + np + 2 * joints);
        wide.topLeftCorner(ns, ns + np) = dense::transpose_product(end, root);
        wide.block(ns, 0, np, ns + np) = root.bottomRows(np);
        // A random walk of the speed over dt, and the angle that it makes.
        for (int j = 0; j < joints; j++) {
            double variance =
                options.process_noise * mk_model_joint_scale(&model, j) * std::sqrt(dt);
            long column = ns + np + 2 * j;
            wide(joints + j, column) = variance;
            wide(j, column) = 0.5 * dt * variance;
            wide(j, column + 1) = dt * variance / std::sqrt(12.0);
        }
        root = dense::lower_root(wide, ns + np);
        chain = dense::transpose_product(end.topRows(ns), chain) + end.bottomRows(np).transpose();
        x = Eigen::Map<VectorXd>(x_end.data(), ns);
    }

    static double condition_of(const MatrixXd &square)
    {
        VectorXd e = dense::eigenvalues(square);
        return e(0) > 0.0 ? std::sqrt(e(e.size() - 1) / e(0)) : HUGE_VAL;
    }

    void judge(PredictedExperiment &out) const
    {
        const MatrixXd below = root.bottomRows(np);
        out.covariance = dense::product_transpose(below, below);
        VectorXd unit = sensitivity.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
        VectorXd physical = Eigen::Map<const VectorXd>(scale.data(), np).cwiseInverse();
        out.condition_scaled = condition_of(unit.asDiagonal() * sensitivity * unit.asDiagonal());
        out.condition = condition_of(physical.asDiagonal() * sensitivity * physical.asDiagonal());
        for (int j = 0; j < joints; j++) {
            const std::vector<double> &q = out.q[j];
            auto ends = std::minmax_element(q.begin(), q.end());
            out.q_min[j] = *ends.first;
            out.q_max[j] = *ends.second;
            for (size_t k = 1; k < q.size(); k++)
                out.v_max[j] = std::max(out.v_max[j], std::fabs(q[k] - q[k - 1]) / period);
        }
    }
};

} // namespace

PredictedExperiment predict_experiment(const mk_model &model, const std::vector<double> &u,
                                       double period, const std::vector<int> &free,
                                       const InformationOptions &options)
{
    return Forecast(model, u, period, free, options).run();
}

} // namespace mk
