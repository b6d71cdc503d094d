// Linear methods: regressions on a plant's regressor, or on its energy balance.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>

#include <Eigen/Dense>

#include "ident/method.hpp"
#include "ident/motion.hpp"

namespace mk
{

namespace
{

constexpr double UNKNOWN = std::numeric_limits<double>::quiet_NaN();
constexpr double DEFAULT_CUTOFF_HZ = 10.0;
constexpr double ENERGY_SPAN_S = 0.1;

using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Sums that a regression needs, gathered over the rows of all logs: nothing grows with them.
struct Equations {
    Eigen::MatrixXd normal;
    Eigen::VectorXd right;
    double square = 0.0;
    size_t rows = 0;
};

// One equation y = x p at a row of a motion; false where the row holds none.
struct Row {
    Eigen::VectorXd x;
    double y;
};

struct Regression {
    const IdentProblem &problem;
    std::vector<Motion> motions;
    std::vector<int> free;
    int base, equations; // parameters of the plant; equations a row
    bool energy;
    double weight[MK_MAX_JOINTS] = {1.0, 1.0};

    explicit Regression(const IdentProblem &p, bool by_energy) : problem(p), energy(by_energy)
    {
        double cutoff = p.options.cutoff_hz > 0.0 ? p.options.cutoff_hz : DEFAULT_CUTOFF_HZ;
        const mk_plant_info *plant = mk_plant(p.model.plant);
        base = plant->parameter_count;
        equations = energy ? 1 : plant->joints;
        for (const mk_record &record : p.records)
            motions.push_back(motion_of_record(record, p.model, cutoff));
        for (int i = 0; i < base; i++)
            if (!p.options.fixed[i])
                free.push_back(i);
    }

    // Held parameters move to the right-hand side.
    Row reduce(const double *phi, double y) const
    {
        Row row = {Eigen::VectorXd((long)free.size()), y};
        for (int i = 0; i < base; i++)
            if (std::find(free.begin(), free.end(), i) == free.end())
                row.y -= phi[i] * problem.model.parameter[i];
        for (size_t i = 0; i < free.size(); i++)
            row.x((long)i) = phi[free[i]];
        return row;
    }

    // Calls visit(equation, row, starts a new log) for every row that was measured.
    template <class Visit>
    void each(Visit visit) const
    {
        for (const Motion &m : motions)
            energy ? each_energy(m, visit) : each_torque(m, visit);
    }

    template <class Visit>
    void each_torque(const Motion &m, Visit visit) const;
    template <class Visit>
    void each_energy(const Motion &m, Visit visit) const;
    Equations gather() const;
};

void sample(const Motion &m, size_t k, double *q, double *v, double *a)
{
    for (int j = 0; j < m.joints; j++)
        q[j] = m.q[j][k], v[j] = m.v[j][k], a[j] = m.a[j][k];
}

// A fifth of a second at the ends, at most a tenth of the log, is left to the filter.
size_t margin(const Motion &m)
{
    return std::max<size_t>(1, std::min((size_t)(0.2 / m.period), m.rows() / 10));
}

template <class Visit>
void Regression::each_torque(const Motion &m, Visit visit) const
{
    double q[MK_MAX_JOINTS] = {}, v[MK_MAX_JOINTS] = {}, a[MK_MAX_JOINTS] = {};
    double phi[MK_MAX_JOINTS * MK_MAX_PARAMETERS];
    int motor = mk_plant(problem.model.plant)->motor_joint;
    for (size_t k = margin(m), begin = k; k + begin < m.rows(); k++) {
        if (!m.measured[k])
            continue;
        sample(m, k, q, v, a);
        mk_plant_regressor(&problem.model, q, v, a, phi);
        for (int j = 0; j < m.joints; j++) {
            double tau = j == motor && !m.u[0].empty() ? m.u[0][k] : 0.0;
            if (j == 1 && !m.u[1].empty())
                tau += m.u[1][k];
            visit(j, reduce(phi + j * base, tau), k == begin);
        }
    }
}

// Energies are linear in the parameters: that of parameter i is the energy of the unit vector.
void unit_energies(const mk_model &model, int base, const double *q, const double *v, double *out)
{
    mk_model unit = model;
    for (int i = 0; i < base; i++) {
        for (int k = 0; k < base; k++)
            unit.parameter[k] = k == i ? 1.0 : 0.0;
        out[i] = mk_plant_kinetic(&unit, q, v) + mk_plant_potential(&unit, q);
    }
}

// What was stored between two samples and what friction took equals the motors' work. The balance
// needs no accelerations.
template <class Visit>
void Regression::each_energy(const Motion &m, Visit visit) const
{
    double q[MK_MAX_JOINTS] = {}, v[MK_MAX_JOINTS] = {}, a[MK_MAX_JOINTS] = {};
    const double still[MK_MAX_JOINTS] = {};
    double before[MK_MAX_PARAMETERS], after[MK_MAX_PARAMETERS], row[MK_MAX_PARAMETERS];
    double moving[MK_MAX_JOINTS * MK_MAX_PARAMETERS];
    int motor = mk_plant(problem.model.plant)->motor_joint;
    size_t span = std::max<size_t>(1, (size_t)std::lround(ENERGY_SPAN_S / m.period));
    for (size_t k = margin(m), begin = k; k + span + begin < m.rows(); k += span) {
        double loss[MK_MAX_PARAMETERS] = {}, work = 0.0;
        bool whole = true;
        for (size_t i = k; i <= k + span; i++) {
            double w = (i == k || i == k + span ? 0.5 : 1.0) * m.period;
            sample(m, i, q, v, a);
            mk_plant_regressor(&problem.model, q, v, still, moving);
            for (int p = 0; p < base; p++)
                loss[p] += w * v[motor] * moving[motor * base + p];
            work += m.u[0].empty() ? 0.0 : w * m.u[0][i] * v[motor];
            work += m.u[1].empty() ? 0.0 : w * m.u[1][i] * v[1];
            whole = whole && m.measured[i];
        }
        sample(m, k, q, v, a);
        unit_energies(problem.model, base, q, v, before);
        sample(m, k + span, q, v, a);
        unit_energies(problem.model, base, q, v, after);
        int friction = base - 2; // the last two parameters of every plant
        for (int p = 0; p < base; p++)
            row[p] = p >= friction ? loss[p] : after[p] - before[p];
        if (whole)
            visit(0, reduce(row, work), k == begin);
    }
}

Equations Regression::gather() const
{
    long n = (long)free.size();
    Equations e;
    e.normal = Eigen::MatrixXd::Zero(n, n);
    e.right = Eigen::VectorXd::Zero(n);
    each([&](int j, const Row &r, bool) {
        double w = weight[j] * weight[j];
        e.normal.selfadjointView<Eigen::Lower>().rankUpdate(r.x, w);
        e.right += w * r.y * r.x;
        e.square += w * r.y * r.y;
        e.rows++;
    });
    e.normal = e.normal.selfadjointView<Eigen::Lower>();
    return e;
}

double condition(const Eigen::MatrixXd &normal)
{
    Eigen::VectorXd e = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(normal).eigenvalues();
    return e(0) > 0.0 ? std::sqrt(e(e.size() - 1) / e(0)) : HUGE_VAL;
}

// Filtered residuals hang together over the filter's memory: scores are summed over blocks longer
// than that, and the blocks' scatter gives the errors (the sandwich of White, in Bartlett's way).
Eigen::MatrixXd score_scatter(const Regression &g, const Eigen::VectorXd &p)
{
    long n = (long)g.free.size(), in_block = 0, blocks = 0;
    double cutoff =
        g.problem.options.cutoff_hz > 0.0 ? g.problem.options.cutoff_hz : DEFAULT_CUTOFF_HZ;
    double step = g.energy ? ENERGY_SPAN_S : g.motions[0].period;
    long length = std::max(1L, std::lround(5.0 / cutoff / step)) * g.equations;
    Eigen::MatrixXd scatter = Eigen::MatrixXd::Zero(n, n);
    Eigen::VectorXd score = Eigen::VectorXd::Zero(n);
    auto close = [&] {
        scatter += score * score.transpose();
        score.setZero();
        in_block = 0;
        blocks++;
    };
    g.each([&](int j, const Row &r, bool) {
        score += g.weight[j] * g.weight[j] * (r.y - r.x.dot(p)) * r.x;
        if (++in_block == length)
            close();
    });
    close();
    return scatter * ((double)blocks / (double)std::max(1L, blocks - n));
}

void warn(mk_ident_result &r, const std::string &text)
{
    if (r.warning_count < MK_MAX_FIT_WARNINGS)
        snprintf(r.warning[r.warning_count++], sizeof r.warning[0], "%s", text.c_str());
}

void fill(const Regression &g, const Eigen::VectorXd &p, const Eigen::MatrixXd &cov,
          mk_ident_result &r)
{
    for (size_t i = 0; i < g.free.size(); i++) {
        mk_ident_parameter &out = r.parameter[g.free[i]];
        out.value = p((long)i);
        double variance = cov((long)i, (long)i);
        out.std_error = std::isfinite(variance) && variance >= 0.0 ? std::sqrt(variance) : UNKNOWN;
        out.excited = out.std_error < std::fabs(out.value);
        mk_model_set_parameter(&r.model, g.free[i], out.value);
        if (!out.excited)
            warn(r, std::string("the data say little about ") + out.name +
                        ": excite it more or fix it");
        for (size_t k = 0; k < g.free.size(); k++)
            r.covariance[g.free[i] * r.parameter_count + g.free[k]] = cov((long)i, (long)k);
    }
    for (int i = 0; i < r.parameter_count; i++)
        r.parameter[i].fixed = std::find(g.free.begin(), g.free.end(), i) == g.free.end();
}

// Each equation by the scatter of its own residuals.
void weigh(Regression &g, const Eigen::VectorXd &p)
{
    double sum[MK_MAX_JOINTS] = {}, count[MK_MAX_JOINTS] = {};
    g.each([&](int j, const Row &r, bool) {
        sum[j] += std::pow(r.y - r.x.dot(p), 2);
        count[j] += 1.0;
    });
    for (int j = 0; j < g.equations; j++)
        g.weight[j] = 1.0 / std::sqrt(std::max(sum[j] / std::max(count[j], 1.0), 1e-24));
}

enum mk_status regress(const IdentProblem &problem, mk_ident_result &r, mk_error *err, bool energy,
                       int rounds)
{
    Regression g(problem, energy);
    if (g.free.empty())
        return mk_error_set(err, MK_ERR_RANGE, "every parameter is held: there is nothing to fit");
    Eigen::VectorXd p, scale;
    Eigen::MatrixXd unit;
    Equations e;
    for (r.iterations = 0; r.iterations < rounds; r.iterations++) {
        if (r.iterations > 0)
            weigh(g, p);
        e = g.gather();
        if (e.rows < 2 * g.free.size())
            return mk_error_set(err, MK_ERR_RANGE, "%zu equations are too few for %zu parameters",
                                e.rows, g.free.size());
        scale = e.normal.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
        unit = scale.asDiagonal() * e.normal * scale.asDiagonal();
        r.condition_number_scaled = condition(unit);
        if (!(r.condition_number_scaled < 1e7))
            return mk_error_set(err, MK_ERR_RANGE,
                                "these data cannot tell the parameters apart: move every joint, or "
                                "hold some parameters");
        p = scale.cwiseProduct(unit.ldlt().solve(scale.cwiseProduct(e.right)));
    }
    Eigen::MatrixXd inverse = scale.asDiagonal() *
                              unit.ldlt().solve(Eigen::MatrixXd::Identity(p.size(), p.size())) *
                              scale.asDiagonal();
    r.condition_number = condition(e.normal);
    r.cost = e.square - p.dot(e.right);
    r.rows = e.rows;
    r.converged = true;
    for (double &noise : r.noise)
        noise = UNKNOWN;
    fill(g, p, inverse * score_scatter(g, p) * inverse, r);
    if (problem.model.effect_count > 0)
        warn(r, "effects of the model are left out: this method knows the plant alone");
    if (mk_model_check(&r.model, err) != MK_OK)
        return mk_error_set(err, MK_ERR_NUMERIC,
                            "the parameters that fit best make no physical rig: the data do not "
                            "determine them; try output-error");
    return MK_OK;
}

enum mk_status run_sls(const IdentProblem &problem, mk_ident_result &r, mk_error *err)
{
    return regress(problem, r, err, false, 1);
}

enum mk_status run_wls(const IdentProblem &problem, mk_ident_result &r, mk_error *err)
{
    return regress(problem, r, err, false, 3);
}

enum mk_status run_energy(const IdentProblem &problem, mk_ident_result &r, mk_error *err)
{
    return regress(problem, r, err, true, 1);
}

} // namespace

const IdentMethod method_sls = {
    {"sls", "least squares on filtered derivatives", "report, ch. 3", false}, run_sls};
const IdentMethod method_wls = {
    {"wls", "the same, each equation weighted by its residuals", "report, ch. 3", false}, run_wls};
const IdentMethod method_energy = {
    {"energy", "energy balance between samples, no accelerations", "report, errata 6.11", false},
    run_energy};

} // namespace mk
