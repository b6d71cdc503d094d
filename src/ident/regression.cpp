#include "ident/regression.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <limits>
#include <new>
#include <string>

#include "ident/repeats.hpp"
#include "ident/whiten.hpp"

namespace mk
{

namespace
{

constexpr double UNKNOWN = std::numeric_limits<double>::quiet_NaN();
constexpr double DEFAULT_CUTOFF_HZ = 3.0;
constexpr double ROWS_PER_WINDOW = 10.0;

// Sums over all rows; nothing grows with the data.
struct Sums {
    Eigen::MatrixXd normal; // X' W X
    Eigen::VectorXd right;  // X' W y
    Eigen::MatrixXd spread; // X' W S W X, S the covariance of all rows' errors
    double square = 0.0;    // y' W y
    double expected = 0.0;  // of the errors' own e' W e
    Block residual;         // sum of e e' at the parameters of the round before
    size_t rows = 0;

    Sums(long n, int equations)
        : normal(Eigen::MatrixXd::Zero(n, n)), right(Eigen::VectorXd::Zero(n)), spread(normal),
          residual(Block::Zero(equations, equations))
    {
    }
};

// A row that later ones may share readings with.
struct Past {
    WeakRow row;
    Eigen::MatrixXd weighted; // W X
};

// Covariance of two rows' errors; the readings' noise is white.
using NoiseMap = std::vector<double> (WeakRow::*)[MAX_EQUATIONS][MK_MAX_JOINTS];
Block covariance(const WeakRow &a, const WeakRow &b, NoiseMap map, int equations, int joints)
{
    Block c = Block::Zero(equations, equations);
    size_t shift = a.centre - b.centre; // a is not before b
    for (int e = 0; e < equations; e++)
        for (int f = 0; f < equations; f++)
            for (int j = 0; j < joints; j++) {
                const std::vector<double> &x = (a.*map)[e][j], &y = (b.*map)[f][j];
                for (size_t i = shift; i < y.size(); i++)
                    c(e, f) += x[i - shift] * y[i];
            }
    return c;
}

class Regression
{
  public:
    Regression(const LinearMethod &m, const IdentProblem &p)
        : method(m), problem(p), model(p.model),
          form(m.energy ? energy_balance(p.model) : torque_equations(p.model))
    {
        double cutoff = p.options.cutoff_hz > 0.0 ? p.options.cutoff_hz : DEFAULT_CUTOFF_HZ;
        window = {1.0 / cutoff, ROWS_PER_WINDOW};
        for (int i = 0; i < mk_plant(model.plant)->parameter_count; i++)
            if (!p.options.fixed[i])
                free.push_back(i);
    }

    enum mk_status run(mk_ident_result &r, mk_error *err);

    std::vector<int> free;

  private:
    const LinearMethod &method;
    const IdentProblem &problem;
    mk_model model; // at the parameters of the round before
    WeakForm form;
    WeakWindow window;
    std::vector<Track> tracks;
    Block residual;

    Sums gather(int round) const;
    void add(const WeakRow &row, const Block &weight, const std::deque<Past> &past,
             Eigen::MatrixXd &weighted, Sums &sums) const;
    Eigen::MatrixXd reduced(const WeakRow &row) const;
    Eigen::VectorXd parameters() const;
    enum mk_status solve(const Sums &sums, Eigen::VectorXd &p, Eigen::MatrixXd &inverse,
                         mk_ident_result &r, mk_error *err) const;
    void fill(const Sums &sums, const Eigen::VectorXd &p, const Eigen::MatrixXd &inverse,
              mk_ident_result &r) const;
};

// Columns of the free parameters, then the right-hand side, to which held parameters move.
Eigen::MatrixXd Regression::reduced(const WeakRow &row) const
{
    long n = (long)free.size();
    Eigen::MatrixXd out(form.equations, n + 1);
    for (int e = 0; e < form.equations; e++) {
        double y = row.y[e];
        for (int i = 0; i < mk_plant(model.plant)->parameter_count; i++)
            if (problem.options.fixed[i])
                y -= row.x[e][i] * problem.model.parameter[i];
        for (long i = 0; i < n; i++)
            out(e, i) = row.x[e][free[(size_t)i]];
        out(e, n) = y;
    }
    return out;
}

Eigen::VectorXd Regression::parameters() const
{
    Eigen::VectorXd p((long)free.size());
    for (size_t i = 0; i < free.size(); i++)
        p((long)i) = model.parameter[free[i]];
    return p;
}

// One row with its own weight; its errors' covariance with the rows before goes to the spread.
void Regression::add(const WeakRow &row, const Block &weight, const std::deque<Past> &past,
                     Eigen::MatrixXd &weighted, Sums &sums) const
{
    Eigen::MatrixXd values = reduced(row);
    long n = (long)free.size();
    auto x = values.leftCols(n);
    auto y = values.col(n);
    weighted = weight * x;
    sums.normal += x.transpose() * weighted;
    sums.right += weighted.transpose() * y;
    sums.square += y.dot(weight * y);
    Block self = covariance(row, row, &WeakRow::noise, form.equations, mk_model_joints(&model));
    sums.spread += weighted.transpose() * self * weighted;
    sums.expected += (weight * self).trace();
    for (const Past &other : past) {
        Block s =
            covariance(row, other.row, &WeakRow::noise, form.equations, mk_model_joints(&model));
        Eigen::MatrixXd half = weighted.transpose() * s * other.weighted;
        sums.spread += half + half.transpose();
    }
}

Sums Regression::gather(int round) const
{
    long n = (long)free.size();
    int joints = mk_model_joints(&model);
    Sums sums(n, form.equations);
    Eigen::VectorXd before = parameters();
    std::deque<Past> past; // nearest first
    Whitener whitener;
    size_t band = 0;
    each_weak_row(form, model, tracks, window, [&](const WeakRow &row) {
        if (row.starts_log)
            past.clear(), whitener.clear();
        size_t reach = row.noise[0][0].size();
        while (!past.empty() && row.centre - past.back().row.centre >= reach)
            past.pop_back();
        band = std::max(band, past.size());
        Eigen::MatrixXd values = reduced(row), weighted;
        Eigen::VectorXd left = values.col(n) - values.leftCols(n) * before;
        sums.residual += left * left.transpose();
        sums.rows++;
        Block self = covariance(row, row, &WeakRow::noise, form.equations, joints);
        if (round == 0 || !method.whole) {
            RowNoise noise = {self, Block(), residual};
            if (round > 0)
                noise.angles = covariance(row, row, &WeakRow::angle_noise, form.equations, joints);
            Block identity = Block::Identity(form.equations, form.equations);
            add(row, round == 0 ? identity : method.weight(noise), past, weighted, sums);
        } else {
            std::vector<Block> shared;
            for (const Past &other : past)
                shared.push_back(
                    covariance(row, other.row, &WeakRow::noise, form.equations, joints));
            Eigen::MatrixXd white = whitener.push(values, shared, self);
            sums.normal += white.leftCols(n).transpose() * white.leftCols(n);
            sums.right += white.leftCols(n).transpose() * white.col(n);
            sums.square += white.col(n).squaredNorm();
            sums.expected += form.equations;
        }
        past.push_front({row, weighted});
    });
    if (round > 0 && method.whole)
        sums.spread = sums.normal;
    return sums;
}

double condition(const Eigen::MatrixXd &normal)
{
    Eigen::VectorXd e = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(normal).eigenvalues();
    return e(0) > 0.0 ? std::sqrt(e(e.size() - 1) / e(0)) : HUGE_VAL;
}

enum mk_status Regression::solve(const Sums &sums, Eigen::VectorXd &p, Eigen::MatrixXd &inverse,
                                 mk_ident_result &r, mk_error *err) const
{
    if (sums.rows * (size_t)form.equations < 2 * free.size())
        return mk_error_set(err, MK_ERR_RANGE,
                            "%zu windows of %.3g s are too few for %zu parameters", sums.rows,
                            window.seconds, free.size());
    Eigen::VectorXd scale = sums.normal.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    Eigen::MatrixXd unit = scale.asDiagonal() * sums.normal * scale.asDiagonal();
    double scaled = condition(unit);
    if (!(scaled < 1e7))
        return mk_error_set(err, MK_ERR_RANGE,
                            "these data cannot tell the parameters apart: move every joint, or "
                            "hold some parameters");
    if (!(sums.square > 0.0))
        return mk_error_set(err, MK_ERR_RANGE,
                            "the command is 0 throughout: free motion shows ratios of parameters "
                            "only; hold one of them");
    if (r.iterations == 0) {
        r.condition_number = condition(sums.normal);
        r.condition_number_scaled = scaled;
    }
    p = scale.cwiseProduct(unit.ldlt().solve(scale.cwiseProduct(sums.right)));
    inverse = scale.asDiagonal() *
              unit.ldlt().solve(Eigen::MatrixXd::Identity(p.size(), p.size())) * scale.asDiagonal();
    return MK_OK;
}

void warn(mk_ident_result &r, const std::string &text)
{
    if (r.warning_count < MK_MAX_FIT_WARNINGS)
        snprintf(r.warning[r.warning_count++], sizeof r.warning[0], "%s", text.c_str());
}

void Regression::fill(const Sums &sums, const Eigen::VectorXd &p, const Eigen::MatrixXd &inverse,
                      mk_ident_result &r) const
{
    r.cost = std::max(sums.square - p.dot(sums.right), 0.0);
    Eigen::MatrixXd cov = inverse * sums.spread * inverse;
    // The level of the noise is what the residuals show.
    double expected = sums.expected - (inverse * sums.spread).trace();
    cov *= r.cost / std::max(expected, 1e-300);
    r.rows = sums.rows * (size_t)form.equations;
    r.converged = true;
    for (int i = 0; i < r.parameter_count; i++)
        r.parameter[i].fixed = std::find(free.begin(), free.end(), i) == free.end();
    for (size_t i = 0; i < free.size(); i++) {
        mk_ident_parameter &out = r.parameter[free[i]];
        out.value = p((long)i);
        double variance = cov((long)i, (long)i);
        out.std_error = std::isfinite(variance) && variance >= 0.0 ? std::sqrt(variance) : UNKNOWN;
        out.excited = out.std_error < std::fabs(out.value);
        if (!out.excited)
            warn(r, std::string("the data say little about ") + out.name +
                        ": excite it more or fix it");
        mk_model_set_parameter(&r.model, free[i], out.value);
        for (size_t k = 0; k < free.size(); k++)
            r.covariance[free[i] * r.parameter_count + free[k]] = cov((long)i, (long)k);
    }
}

enum mk_status Regression::run(mk_ident_result &r, mk_error *err)
{
    tracks = tracks_of(problem);
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        r.noise[j] = j < mk_model_joints(&model) ? tracks[0].noise[j] : UNKNOWN;
    Eigen::VectorXd p;
    Eigen::MatrixXd inverse;
    for (r.iterations = 0; r.iterations < method.rounds; r.iterations++) {
        Sums sums = gather(r.iterations);
        enum mk_status st = solve(sums, p, inverse, r, err);
        if (st != MK_OK)
            return st;
        if (r.iterations == 0 && sums.square > 2.0 * p.dot(sums.right))
            warn(r, "the plant's equations explain less than half of the command: is it this rig?");
        for (size_t i = 0; i < free.size(); i++)
            model.parameter[free[i]] = p((long)i);
        residual = sums.residual / (double)sums.rows;
        if (r.iterations + 1 == method.rounds)
            fill(sums, p, inverse, r);
    }
    return MK_OK;
}

} // namespace

enum mk_status regress(const LinearMethod &method, const IdentProblem &problem, mk_ident_result &r,
                       mk_error *err)
{
    Regression g(method, problem);
    if (g.free.empty())
        return mk_error_set(err, MK_ERR_RANGE, "every parameter is held: there is nothing to fit");
    enum mk_status st = g.run(r, err);
    if (st != MK_OK)
        return st;
    if (problem.model.effect_count > 0)
        warn(r, "effects of the model are left out: this method knows the plant alone");
    if (mk_model_check(&r.model, err) != MK_OK)
        return mk_error_set(err, MK_ERR_NUMERIC,
                            "the parameters that fit best make no physical rig: the data do not "
                            "determine them; try output-error");
    return MK_OK;
}

} // namespace mk
