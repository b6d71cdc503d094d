#include "ident/residual_torque.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "base/dense.hpp"
#include "ident/fit_log.hpp"
#include "ident/quantiles.hpp"
#include "ident/track.hpp"
#include "sim/period.hpp"

namespace mk
{

namespace
{

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double BLOCK = 0.05;         // s: shorter than a touch, longer than a sample
constexpr double LONGEST_PERIOD = 0.1; // s: readings farther apart show no touch
constexpr size_t FEWEST_BLOCKS = 40;   // with fewer nothing is usual
constexpr size_t MOST_ROWS = 1000000;  // what a fit uses at most as well
constexpr double MOTION = 5.0;         // counts: less is rest
constexpr double BUSY = 0.75;          // quantile

// What is in an equation beside the plant's terms and the effects of the model.
enum Nuisance { OFFSET, VISCOUS, COULOMB, CABLE, ROTOR, NUISANCES };
constexpr double ZERO_STEP = 0.1; // rad: how far zeros are moved for a difference

// The torque in each equation that one effect of the model makes: mass times the acceleration that
// it changes. Effects that remember something are at rest.
void effect_torque(const mk_model &model, int effect, const double *q, const double *v,
                   const double *u, double t, double *torque)
{
    const int n = mk_model_joints(&model);
    mk_model bare = model, with = model;
    bare.effect_count = 0;
    with.effect_count = 1;
    with.effect[0] = model.effect[effect];
    double x[MK_MAX_STATES], changed[MK_MAX_STATES], plain[MK_MAX_STATES];
    double mass[MK_MAX_JOINTS * MK_MAX_JOINTS], h[MK_MAX_JOINTS];
    mk_model_initial_state(&with, q, v, x);
    mk_model_rhs(&with, t, x, u, changed);
    mk_model_initial_state(&bare, q, v, x);
    mk_model_rhs(&bare, t, x, u, plain);
    mk_plant_mass(&bare, q, v, mass, h);
    for (int e = 0; e < n; e++) {
        torque[e] = 0.0;
        for (int j = 0; j < n; j++)
            torque[e] -= mass[e * n + j] * (changed[n + j] - plain[n + j]);
    }
}

// Terms of all equations at one row of a track: base parameters, zeros of the encoders, nuisances,
// effects.
class Terms
{
  public:
    explicit Terms(const mk_model &m)
        : model(m), joints(mk_model_joints(&m)), parameters(mk_plant(m.plant)->parameter_count),
          nuisances(parameters + joints), effects(nuisances + NUISANCES),
          count(effects + m.effect_count)
    {
    }
    const mk_model &model;
    const int joints, parameters, nuisances, effects, count;

    void at(const Track &track, size_t row, std::vector<double> *out) const
    {
        double q[MK_MAX_JOINTS] = {}, v[MK_MAX_JOINTS] = {}, a[MK_MAX_JOINTS] = {};
        double u[MK_MAX_INPUTS] = {}, torque[MK_MAX_JOINTS];
        double phi[MK_MAX_JOINTS * MK_MAX_PARAMETERS];
        for (int j = 0; j < joints; j++)
            q[j] = track.q[j][row], v[j] = track.v[j][row], a[j] = track.a[j][row];
        for (int i = 0; i < MK_MAX_INPUTS; i++)
            if (!track.u[i].empty())
                u[i] = track.u[i][row];
        mk_plant_regressor(&model, q, v, a, phi);
        for (int e = 0; e < joints; e++) {
            std::copy_n(phi + e * parameters, parameters, out[e].begin());
            add_nuisances(e, q, v, a, &out[e][(size_t)nuisances]);
        }
        for (int j = 0; j < joints; j++)
            add_zero(j, q, v, a, out);
        for (int k = 0; k < model.effect_count; k++) {
            effect_torque(model, k, q, v, u, track.period * (double)row, torque);
            for (int e = 0; e < joints; e++)
                out[e][(size_t)(effects + k)] = torque[e];
        }
    }
    double drive(const Track &track, int e, size_t row) const
    {
        double u = 0.0;
        if (e == mk_plant(model.plant)->motor_joint && !track.u[0].empty())
            u += track.u[0][row];
        if (e == 1 && !track.u[1].empty())
            u += track.u[1][row];
        return u;
    }

  private:
    void add_nuisances(int e, const double *q, const double *v, const double *a, double *out) const
    {
        out[OFFSET] = 1.0;
        out[VISCOUS] = v[e];
        out[COULOMB] = std::tanh(mk_model_sharpness(&model, e) * v[e]);
        out[CABLE] = mk_model_turns_freely(&model, e) ? 0.0 : q[e];
        out[ROTOR] = 0.0;
        for (int k = 0; k < model.effect_count; k++)
            if ((mk_effect(model.effect[k].index)->stages & MK_STAGE_INERTIA) &&
                model.effect[k].joint == e + 1)
                out[ROTOR] = a[e];
    }
    void add_zero(int joint, const double *q, const double *v, const double *a,
                  std::vector<double> *out) const
    {
        double off[MK_MAX_JOINTS] = {q[0], q[1]}, moved[MK_MAX_JOINTS], there[MK_MAX_JOINTS];
        off[joint] += ZERO_STEP;
        mk_plant_inverse_dynamics(&model, off, v, a, moved);
        mk_plant_inverse_dynamics(&model, q, v, a, there);
        for (int e = 0; e < joints; e++)
            out[e][(size_t)(parameters + joint)] = (moved[e] - there[e]) / ZERO_STEP;
    }
};

// Means over blocks of all logs: the terms of each equation, and what drives it.
class Blocks
{
  public:
    Blocks(const mk_model &model, ResidualTorques &r) : terms(model), out(r)
    {
        for (int e = 0; e < terms.joints; e++)
            row[e].resize((size_t)terms.count);
    }
    void add(size_t log, const mk_record &record)
    {
        const Track track = track_of_record(record, terms.model);
        const size_t wide = std::max<size_t>(2, (size_t)std::lround(BLOCK / track.period));
        out.block_s = std::max(out.block_s, track.period * (double)wide);
        for (size_t k = 0; k + wide <= track.rows(); k += wide)
            add_block(log, track, k, wide);
    }
    double term(int e, size_t block, int column) const
    {
        return sums[e][block * (size_t)terms.count + (size_t)column];
    }
    double drive(int e, size_t block) const { return driven[e][block]; }

    const Terms terms;

  private:
    ResidualTorques &out;
    std::vector<double> row[MK_MAX_JOINTS];
    std::vector<double> sums[MK_MAX_JOINTS], driven[MK_MAX_JOINTS];

    void add_block(size_t log, const Track &track, size_t first, size_t wide)
    {
        const double share = 1.0 / (double)wide;
        const size_t columns = (size_t)terms.count;
        out.log.push_back(log);
        out.t.push_back(track.period * ((double)first + 0.5 * (double)(wide - 1)));
        out.measured.push_back(1);
        for (int e = 0; e < terms.joints; e++) {
            sums[e].resize(sums[e].size() + columns, 0.0);
            driven[e].push_back(0.0);
            out.equation[e].angle.push_back(0.0);
        }
        for (size_t k = first; k < first + wide; k++) {
            terms.at(track, k, row);
            if (!track.measured[k])
                out.measured.back() = 0;
            for (int e = 0; e < terms.joints; e++) {
                double *sum = &sums[e][sums[e].size() - columns];
                for (size_t c = 0; c < columns; c++)
                    sum[c] += share * row[e][c];
                driven[e].back() += share * terms.drive(track, e, k);
                out.equation[e].angle.back() += share * track.q[e][k];
            }
        }
    }
};

VectorXd solve(const MatrixXd &x, const VectorXd &y, const VectorXd &w)
{
    constexpr double RIDGE = 1e-7; // of terms that these data cannot tell apart
    const MatrixXd weighted = w.asDiagonal() * x;
    MatrixXd normal = dense::transpose_product(weighted, x);
    normal.diagonal().array() += RIDGE * normal.diagonal().maxCoeff() + 1e-300;
    return dense::solve_symmetric(normal, dense::transpose_product(x, VectorXd(w.cwiseProduct(y))));
}

// One equation as a regression y = x beta, of the blocks without holes.
class Regression
{
  public:
    Regression(const Blocks &b, const ResidualTorques &r, int e) : blocks(b), equation(e)
    {
        for (size_t k = 0; k < r.blocks(); k++)
            if (r.measured[k])
                rows.push_back(k);
        if (rows.size() >= FEWEST_BLOCKS)
            build();
    }
    bool known() const { return x.cols() > 0 && y.squaredNorm() > 0.0; }

    // First the least sum of sizes, then without what is far off (Tukey's biweight). Errors of a
    // model grow with what acts.
    void fit(ResidualTorques::Equation &out)
    {
        constexpr int SIZES = 20, ROUNDS = 40;
        constexpr double FAR = 4.685; // 95 % efficiency where errors are normal
        VectorXd w = VectorXd::Ones(y.size()), r, acting;
        for (int round = 0; round < ROUNDS; round++) {
            const VectorXd beta = solve(x, y, w);
            r = y - x * beta;
            acting =
                0.5 * (y.cwiseAbs() + x.leftCols(base).cwiseAbs() * beta.head(base).cwiseAbs());
            out.usual = std::max(quantile(acting, BUSY), 1e-300);
            VectorXd tolerance(y.size());
            for (long i = 0; i < y.size(); i++)
                tolerance(i) = std::hypot(1.0, acting(i) / out.usual);
            const VectorXd off = r.cwiseAbs().cwiseQuotient(tolerance);
            const double scale = std::max(deviation(off), 1e-12 * y.norm());
            for (long i = 0; i < y.size(); i++) {
                const double far = off(i) / scale;
                const double tukey = far < FAR ? std::pow(1.0 - far * far / (FAR * FAR), 2) : 0.0;
                w(i) = (round < SIZES ? 1.0 / std::max(far, 1.0) : tukey) /
                       (tolerance(i) * tolerance(i));
            }
        }
        for (size_t i = 0; i < rows.size(); i++) {
            out.residual[rows[i]] = r((long)i);
            out.acting[rows[i]] = acting((long)i);
        }
    }

  private:
    const Blocks &blocks;
    const int equation;
    std::vector<size_t> rows;
    MatrixXd x;
    VectorXd y;
    long base = 0; // columns of base parameters

    VectorXd column(int c) const
    {
        VectorXd out((long)rows.size());
        for (size_t i = 0; i < rows.size(); i++)
            out((long)i) = blocks.term(equation, rows[i], c);
        return out;
    }
    // An equation that nothing drives says ratios only: the parameter that matters most is held.
    int held() const
    {
        const Terms &terms = blocks.terms;
        for (size_t row : rows)
            if (blocks.drive(equation, row) != 0.0)
                return -1;
        double most = 0.0;
        int found = -1;
        for (int p = 0; p < terms.parameters; p++) {
            const double size = column(p).norm() * std::fabs(terms.model.parameter[p]);
            if (size > most)
                most = size, found = p;
        }
        return found;
    }
    void build()
    {
        constexpr double SAME = 0.999; // correlation with what is held: it would explain anything
        const Terms &terms = blocks.terms;
        const int fixed = held();
        if (fixed >= 0) {
            y = -terms.model.parameter[fixed] * column(fixed);
        } else {
            y.resize((long)rows.size());
            for (size_t i = 0; i < rows.size(); i++)
                y((long)i) = blocks.drive(equation, rows[i]);
        }
        x.resize(y.size(), terms.count);
        long kept = 0;
        for (int c = 0; c < terms.count; c++) {
            x.col(kept) = column(c);
            const double size = x.col(kept).norm();
            // A cable would stand for the weight where nothing else is known.
            if (c == fixed || (fixed >= 0 && c == terms.nuisances + CABLE) || !(size > 0.0) ||
                !std::isfinite(size) || std::fabs(x.col(kept).dot(y)) > SAME * size * y.norm())
                continue;
            x.col(kept++) /= size;
            if (c < terms.parameters)
                base = kept;
        }
        x.conservativeResize(Eigen::NoChange, kept);
    }
};

bool moves(const mk_record &r, const mk_model &model)
{
    for (int j = 0; j < mk_model_joints(&model); j++) {
        double low = HUGE_VAL, high = -HUGE_VAL;
        for (size_t k = 0; k < r.rows; k++)
            if (std::isfinite(r.q[j][k]))
                low = std::min(low, r.q[j][k]), high = std::max(high, r.q[j][k]);
        if (high - low >= MOTION * mk_model_count(&model, j))
            return true;
    }
    return false;
}

bool worth_reading(const mk_record &r, const mk_model &model)
{
    if (r.rows < Piece::FEWEST_ROWS || median_period(r.t, r.rows) > LONGEST_PERIOD)
        return false;
    for (int j = 0; j < mk_model_joints(&model); j++) {
        size_t readings = 0;
        for (size_t k = 0; k < r.rows; k++)
            readings += std::isfinite(r.q[j][k]);
        if (readings < Piece::FEWEST_ROWS)
            return false;
    }
    return moves(r, model);
}

} // namespace

ResidualTorques residual_torques(const mk_model &model, const std::vector<mk_record> &records)
{
    ResidualTorques out;
    out.joints = mk_model_joints(&model);
    Blocks blocks(model, out);
    size_t left = MOST_ROWS;
    for (size_t i = 0; i < records.size() && left > 0; i++) {
        mk_record part = records[i];
        part.rows = std::min(part.rows, left);
        left -= part.rows;
        if (worth_reading(part, model))
            blocks.add(i, part);
    }
    for (int e = 0; e < out.joints; e++) {
        ResidualTorques::Equation &equation = out.equation[e];
        equation.residual.assign(out.blocks(), std::nan(""));
        equation.acting.assign(out.blocks(), std::nan(""));
        Regression regression(blocks, out, e);
        if (regression.known())
            regression.fit(equation);
    }
    return out;
}

} // namespace mk
