#include "ident/regression.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>

#include "base/dense.hpp"
#include "ident/repeats.hpp"
#include "ident/whiten.hpp"

namespace mk
{

namespace
{

constexpr double UNKNOWN = std::numeric_limits<double>::quiet_NaN();
constexpr double DEFAULT_CUTOFF_HZ = 3.0;
constexpr double ROWS_PER_WINDOW = 10.0;
// Fewer of them and noise bends the parameters by more than the errors say.
constexpr double FEWEST_WINDOWS = 2.0;
// Residuals over what the readings' noise leaves in the equations; a right model's are near 1.
constexpr double SUSPICIOUS_LEVEL = 5.0;

// Beyond so many rows of a log standard errors of noise are below what the smoother bends.
constexpr size_t MANY_ROWS = 1000000;

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

// Covariance of two rows' errors, a not before b; the readings' noise is white.
using NoiseMap = std::vector<double> (WeakRow::*)[MAX_EQUATIONS][MK_MAX_JOINTS];
Block covariance(const WeakRow &a, const WeakRow &b, NoiseMap map, int equations, int joints)
{
    Block c = Block::Zero(equations, equations);
    size_t shift = a.centre - b.centre;
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
    Block weight_of(const WeakRow &row, const Block &self, int round) const;
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

Block Regression::weight_of(const WeakRow &row, const Block &self, int round) const
{
    if (round == 0)
        return Block::Identity(form.equations, form.equations);
    return method.weight(
        {self, covariance(row, row, &WeakRow::angle_noise, form.equations, mk_model_joints(&model)),
         residual});
}

// Row `values` (X and y) with a weight of its own; `shared` is its covariance with the rows before.
Eigen::MatrixXd add_weighted(const Eigen::MatrixXd &values, const Block &weight, const Block &self,
                             const std::vector<Block> &shared, const std::deque<Past> &past,
                             Sums &sums)
{
    long n = values.cols() - 1;
    const Eigen::MatrixXd x = values.leftCols(n);
    const Eigen::VectorXd y = values.col(n);
    Eigen::MatrixXd weighted = dense::product(weight, x);
    sums.normal += dense::transpose_product(x, weighted);
    sums.right += dense::transpose_product(weighted, y);
    sums.square += y.dot(dense::product(weight, y));
    sums.expected += (weight * self).trace();
    sums.spread +=
        dense::product(dense::transpose_product(weighted, Eigen::MatrixXd(self)), weighted);
    for (size_t i = 0; i < shared.size(); i++) {
        const Eigen::MatrixXd between =
            dense::transpose_product(weighted, Eigen::MatrixXd(shared[i]));
        const Eigen::MatrixXd half = dense::product(between, past[i].weighted);
        sums.spread += half + half.transpose();
    }
    return weighted;
}

// A row whose error is independent of all others and of unit variance.
void add_white(const Eigen::MatrixXd &values, Sums &sums)
{
    long n = values.cols() - 1;
    const Eigen::MatrixXd x = values.leftCols(n);
    sums.normal += dense::transpose_product(x, x);
    sums.right += dense::transpose_product(x, Eigen::VectorXd(values.col(n)));
    sums.square += values.col(n).squaredNorm();
    sums.expected += (double)values.rows();
    sums.spread = sums.normal;
}

Sums Regression::gather(int round) const
{
    int joints = mk_model_joints(&model);
    long n = (long)free.size();
    bool last = round + 1 == method.rounds, white = round > 0 && method.whole;
    Sums sums(n, form.equations);
    Eigen::VectorXd before = parameters();
    std::deque<Past> past; // nearest first
    Whitener whitener;
    each_weak_row(form, model, tracks, window, [&](const WeakRow &row) {
        if (row.starts_log)
            past.clear(), whitener.clear();
        while (!past.empty() && row.centre - past.back().row.centre >= row.noise[0][0].size())
            past.pop_back();
        Eigen::MatrixXd values = reduced(row), weighted;
        Eigen::VectorXd left = values.col(n) - dense::product(values.leftCols(n), before);
        sums.residual += left * left.transpose();
        sums.rows++;
        Block self = covariance(row, row, &WeakRow::noise, form.equations, joints);
        std::vector<Block> shared;
        for (size_t i = 0; i < past.size() && (last || white); i++)
            shared.push_back(covariance(row, past[i].row, &WeakRow::noise, form.equations, joints));
        if (white)
            add_white(whitener.push(values, shared, self), sums);
        else
            weighted = add_weighted(values, weight_of(row, self, round), self, shared, past, sums);
        past.push_front({row, weighted});
    });
    return sums;
}

double condition(const Eigen::MatrixXd &normal)
{
    Eigen::VectorXd e = dense::eigenvalues(normal);
    return e(0) > 0.0 ? std::sqrt(e(e.size() - 1) / e(0)) : HUGE_VAL;
}

enum mk_status Regression::solve(const Sums &sums, Eigen::VectorXd &p, Eigen::MatrixXd &inverse,
                                 mk_ident_result &r, mk_error *err) const
{
    if (sums.rows * (size_t)form.equations < 2 * free.size())
        return mk_error_set(err, MK_ERR_RANGE,
                            "%zu windows of %.3g s without a hole are too few for %zu parameters: "
                            "output-error bridges holes",
                            sums.rows, window.seconds, free.size());
    if (!(sums.square > 0.0))
        return mk_error_set(err, MK_ERR_RANGE,
                            "the command is 0 throughout: free motion shows ratios of parameters "
                            "only; hold one of them");
    Eigen::VectorXd scale = sums.normal.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    Eigen::MatrixXd unit = scale.asDiagonal() * sums.normal * scale.asDiagonal();
    double scaled = condition(unit);
    if (!(scaled < 1e7))
        return mk_error_set(err, MK_ERR_RANGE,
                            "these data cannot tell the parameters apart: move every joint, or "
                            "hold some parameters");
    if (r.iterations == 0) {
        r.condition_number = condition(sums.normal);
        r.condition_number_scaled = scaled;
    }
    p = scale.cwiseProduct(
        dense::solve_symmetric(unit, Eigen::VectorXd(scale.cwiseProduct(sums.right))));
    inverse = scale.asDiagonal() *
              dense::solve_symmetric(
                  unit, Eigen::MatrixXd(Eigen::MatrixXd::Identity(p.size(), p.size()))) *
              scale.asDiagonal();
    return MK_OK;
}

void Regression::fill(const Sums &sums, const Eigen::VectorXd &p, const Eigen::MatrixXd &inverse,
                      mk_ident_result &r) const
{
    r.cost = std::max(sums.square - p.dot(sums.right), 0.0);
    Eigen::MatrixXd cov = dense::product(dense::product(inverse, sums.spread), inverse);
    // The level of the noise is what the residuals show.
    double expected = sums.expected - (inverse * sums.spread).trace();
    double level2 = r.cost / std::max(expected, 1e-300);
    cov *= level2;
    if (level2 > SUSPICIOUS_LEVEL * SUSPICIOUS_LEVEL)
        warn(r,
             "the plant's equations miss these data by %.0f times what noise explains: is it "
             "this rig? What does it lack?",
             std::sqrt(level2));
    size_t rows = 0;
    for (const Track &track : tracks)
        rows += track.rows();
    if (rows > MANY_ROWS)
        warn(r, "standard errors are those of noise: with this much data the smoother bends the "
                "parameters by more, some 0.1 %%");
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
        warn_if_not_excited(r, out);
        mk_model_set_parameter(&r.model, free[i], out.value);
        for (size_t k = 0; k < free.size(); k++)
            r.covariance[free[i] * r.parameter_count + free[k]] = cov((long)i, (long)k);
    }
}

enum mk_status Regression::run(mk_ident_result &r, mk_error *err)
{
    tracks = tracks_of(problem);
    double longest = 0.0;
    for (const Track &track : tracks)
        longest = std::max(longest, track.period * (double)track.rows());
    if (longest < FEWEST_WINDOWS * window.seconds)
        return mk_error_set(err, MK_ERR_RANGE,
                            "%.3g s of data are too few for windows of %.3g s: twice that at least",
                            longest, window.seconds);
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
    for (int j = 0; j < mk_model_joints(&problem.model); j++)
        if (!problem.moves[j])
            return mk_error_set(err, MK_ERR_RANGE,
                                "q%d does not move in these data: is the joint stuck, or its "
                                "encoder? output-error can fit what the rest shows",
                                j + 1);
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
