// Fit: shooting, the elimination of states, and the cost.
#include "ident/fit.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/parallel.hpp"
#include "ident/fit_priv.hpp"

namespace mk
{

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace
{

constexpr double HIDDEN_STD = 0.05;   // of an effect's state at the start of a log
constexpr double MOUNT = 0.1;         // what a base does, of what the other states do
constexpr double POSITION_STD = 1e-5; // continuity of angles between stretches, rad
constexpr double RELATIVE = 1e-6;     // drift of a wheel per speed, 1/sqrt(s)
constexpr double PASS_STEP = 2.5e-3;  // of the passes that work is counted in, s
constexpr double LOOSE = 1e-3;        // the same, and of effects' states, per unit of drift

} // namespace
// How far effects' states are left to themselves: standard deviations over those of a joint's
// parts.
static VectorXd state_freedom(const mk_model &model)
{
    VectorXd freedom = VectorXd::Ones(mk_model_state_count(&model));
    long at = 2 * mk_model_joints(&model);
    for (int e = 0; e < model.effect_count; e++) {
        const mk_effect_info *info = mk_effect(model.effect[e].index);
        if (info->stages & MK_STAGE_FRAME)
            freedom.segment(at, info->state_count).setConstant(MOUNT);
        at += info->state_count;
    }
    return freedom;
}

Fit::Fit(std::vector<const FitLog *> logs_in, const FitOptions &options_in)
    : options(options_in), logs(std::move(logs_in))
{
}
Fit::~Fit() = default;

std::vector<int> fitted_parameters(const mk_model &model)
{
    std::vector<int> free;
    int n = mk_model_parameter_count(&model);
    for (int i = 0; i < n; i++) {
        char name[64];
        const mk_parameter_info *info = mk_model_parameter_info(&model, i, name, sizeof name);
        // Most library terms have no frequency.
        bool idle = strcmp(info->name, "frequency") == 0 && strstr(name, "custom-wave") &&
                    mk_model_parameter(&model, i - 1) < 8.0;
        if (info->fit != MK_FIT_FIXED && info->fit != MK_FIT_INTEGER && !idle)
            free.push_back(i);
    }
    return free;
}

double Fit::scale_of(const mk_model &model, int number)
{
    char name[64];
    const mk_parameter_info *info = mk_model_parameter_info(&model, number, name, sizeof name);
    double v = std::fabs(mk_model_parameter(&model, number)), usual = std::fabs(info->initial);
    double scale = std::max(v, 0.1 * usual);
    return scale > 1e-9 ? scale : 0.01;
}

// --- start ---

static double sensor_delay(const mk_model &model)
{
    double longest = 0.0;
    for (int e = 0; e < model.effect_count; e++)
        if (mk_effect(model.effect[e].index)->stages & MK_STAGE_SENSOR_DELAY)
            longest += model.effect[e].value[0];
    return longest;
}

// Weights of a log's readings at a point.
void Fit::lay_data(const FitPoint &point)
{
    int joints = mk_model_joints(&point.model);
    data.resize(logs.size());
    for (size_t l = 0; l < logs.size(); l++) {
        LogData &d = data[l];
        d.shoot = {};
        d.shoot.rows = logs[l]->rows();
        d.shoot.t = logs[l]->t.data();
        for (int i = 0; i < MK_MAX_INPUTS; i++)
            d.shoot.u[i] = logs[l]->u[i].data();
        for (int j = 0; j < joints; j++) {
            d.weight[j] = logs[l]->weight[j];
            for (double &w : d.weight[j])
                w /= point.noise[j];
            d.shoot.q[j] = logs[l]->q[j].data();
            d.shoot.w[j] = d.weight[j].data();
        }
    }
}

// Buffers of stretches that are shot together.
struct Fit::Batch {
    std::vector<ShootTask> task;
    std::vector<double> jac, scale;
};

// Stretches first .. last - 1 of `jobs`.
void Fit::shoot_some(const FitPoint &point, const std::vector<int> &free, const Job *first,
                     const Job *last, bool derivatives)
{
    static thread_local Batch batch;
    int ns = mk_model_state_count(&point.model), joints = mk_model_joints(&point.model);
    int columns = derivatives ? ns + (int)free.size() : 0;
    double late = sensor_delay(point.model);
    const double own = point.step > 0.0 ? point.step : longest_step(point.model);
    const double step = correction ? correction->step : own;
    batch.scale.clear();
    for (int number : free)
        batch.scale.push_back(scale_of(point.model, number));
    batch.task.clear();
    size_t rows = 0;
    for (const Job *job = first; job < last; job++) {
        const auto [l, i] = *job;
        Segment &s = work[l][i];
        const FitNodes &nodes = point.nodes[l];
        size_t stop = s.last ? logs[l]->rows() : nodes.row[i + 1];
        while (stop < logs[l]->rows() && logs[l]->t[stop] < s.end + late + 1e-6)
            stop++;
        size_t capacity = (stop - nodes.row[i] + 2) * (size_t)joints;
        rows += capacity;
        s.residual.resize(capacity);
        s.joint.resize(capacity);
        s.x_end.resize(ns);
        s.jac_end.resize(columns ? columns : 1, ns); // transposed: row-major for the kernel
        ShootTask task = {};
        task.model = &point.model;
        task.data = &data[l].shoot;
        task.begin = s.begin;
        task.end = s.end;
        task.last = s.last;
        task.x = nodes.x.data() + (long)i * ns;
        task.step = step;
        task.free_count = derivatives ? (int)free.size() : 0;
        task.free = free.data();
        task.scale = batch.scale.data();
        task.columns = columns;
        task.x_end = s.x_end.data();
        task.jac_end = s.jac_end.data();
        task.row_capacity = capacity;
        task.residual = s.residual.data();
        task.joint_of = s.joint.data();
        batch.task.push_back(task);
    }
    batch.jac.resize(rows * (size_t)std::max(columns, 1));
    double *jac = batch.jac.data();
    for (ShootTask &task : batch.task) {
        task.jac = jac;
        jac += task.row_capacity * (size_t)columns;
    }
    shoot(batch.task.data(), (int)batch.task.size());
    for (const Job *job = first; job < last; job++)
        compress(batch.task[(size_t)(job - first)], point.noise, job->first, job->second);
}

// What a stretch's fit needs to know of how it went.
void Fit::compress(const ShootTask &task, const double *noise, size_t l, size_t i)
{
    Segment &s = work[l][i];
    s.effort = (double)task.steps * (1.0 + task.columns / 6.0);
    s.finite = task.finite;
    size_t n = task.finite ? task.row_count : 0;
    s.residual.resize(n);
    s.joint.resize(n);
    const Correction *c = correction ? &correction->by_log[l][i] : nullptr;
    // States of further effects come after those of the point that the correction is from.
    if (c && n == c->residual.size() && s.x_end.size() >= c->x_end.size()) {
        for (size_t r = 0; r < n; r++)
            s.residual[r] += c->residual[r] / noise[s.joint[r]];
        s.x_end.head(c->x_end.size()) += c->x_end;
    }
    s.sum2[0] = s.sum2[1] = 0.0;
    for (size_t r = 0; r < n; r++) {
        s.sum2[s.joint[r]] += s.residual[r] * s.residual[r];
    }
    s.cost = 0.5 * (s.sum2[0] + s.sum2[1]);
    if (task.columns == 0 || !s.finite)
        return;
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    Eigen::Map<const RowMajor> J(task.jac, (long)n, task.columns);
    Eigen::Map<const VectorXd> r(s.residual.data(), (long)n);
    s.normal.setZero(task.columns, task.columns);
    s.normal.selfadjointView<Eigen::Lower>().rankUpdate(J.transpose());
    s.normal.triangularView<Eigen::StrictlyUpper>() = s.normal.transpose();
    s.right = J.transpose() * r;
}

void Fit::shoot_one(const FitPoint &point, size_t l, size_t i)
{
    const Job job = {l, i};
    shoot_some(point, {}, &job, &job + 1, false);
}

void Fit::shoot_all(const FitPoint &point, const std::vector<int> &free, bool derivatives)
{
    // Enough to keep all lanes busy, few enough to stay near the processor. What is shot together
    // must not depend on the number of threads.
    constexpr size_t FEW = 16, MANY = 64;
    prepare(point);
    std::vector<Job> jobs;
    for (size_t l = 0; l < logs.size(); l++)
        for (size_t i = 0; i < work[l].size(); i++)
            jobs.emplace_back(l, i);
    size_t parts = jobs.size() < FEW ? 1 : 2 * ((jobs.size() + 2 * MANY - 1) / (2 * MANY));
    parallel_for(options.threads, parts, [&](size_t part) {
        const Job *all = jobs.data();
        shoot_some(point, free, all + jobs.size() * part / parts,
                   all + jobs.size() * (part + 1) / parts, derivatives);
    });
    double effort = 0.0, usual = 0.0;
    for (size_t l = 0; l < logs.size(); l++) {
        usual += logs[l]->duration() / PASS_STEP;
        for (const Segment &s : work[l])
            effort += s.effort;
    }
    work_done += effort / usual;
}

// What touches may come and go within a long step.
double Fit::longest_step(const mk_model &model) const
{
    constexpr double CONTACT = 2.5e-3;
    return mk_model_event_count(&model) > 0 ? std::min(options.step, CONTACT) : options.step;
}

void Fit::coarsen(const FitPoint &point)
{
    constexpr double SMALL = 0.02; // of the noise: so much may long steps change a reading
    correction.reset();
    const double longest = longest_step(point.model);
    if (!(point.step > 0.0 && point.step < longest))
        return;
    shoot_all(point, {}, false);
    const std::vector<std::vector<Segment>> fine = work;
    auto all = std::make_shared<Corrections>();
    FitPoint coarse = point;
    for (coarse.step = longest; coarse.step > 1.1 * point.step; coarse.step *= SHORTER) {
        shoot_all(coarse, {}, false);
        if (correct(point, fine, *all) < SMALL) {
            all->step = coarse.step;
            correction = all;
            return;
        }
    }
}

// What makes of the work's stretches fine ones. Returns its root mean square, in readings' standard
// deviations.
double Fit::correct(const FitPoint &point, const std::vector<std::vector<Segment>> &fine,
                    Corrections &out) const
{
    double sum = 0.0, count = 1e-300;
    out.by_log.assign(work.size(), {});
    for (size_t l = 0; l < work.size(); l++)
        for (size_t i = 0; i < work[l].size(); i++) {
            const Segment &a = fine[l][i], &b = work[l][i];
            Correction c;
            if (!a.finite || !b.finite || a.residual.size() != b.residual.size())
                return HUGE_VAL;
            c.x_end = a.x_end - b.x_end;
            for (size_t r = 0; r < a.residual.size(); r++) {
                const double change = a.residual[r] - b.residual[r];
                sum += change * change, count += 1.0;
                c.residual.push_back(change * point.noise[a.joint[r]]);
            }
            out.by_log[l].push_back(std::move(c));
        }
    return std::sqrt(sum / count);
}

// --- the quadratic picture ---

// What is not known of the command (rows that were not recorded, digits that were not written)
// moves the speeds: variances by joint at the end of a stretch.
void Fit::doubt_command(const FitPoint &point, size_t l, size_t node)
{
    Segment &s = work[l][node];
    const FitLog &log = *logs[l];
    double rounding = log.u_step / std::sqrt(12.0);
    double doubt = rounding * rounding * (s.end - s.begin) / log.period;
    size_t stop = s.last ? log.rows() : point.nodes[l].row[node + 1];
    for (size_t k = point.nodes[l].row[node]; k < stop; k++)
        doubt += log.doubt[k] * log.doubt[k];
    s.doubt[0] = s.doubt[1] = 0.0;
    if (!(doubt > 0.0))
        return;
    // The motor's torque meets the mass matrix alone.
    mk_model bare = point.model;
    bare.effect_count = 0;
    const int joints = mk_model_joints(&bare);
    const double none[MK_MAX_INPUTS] = {0.0, 0.0}, some[MK_MAX_INPUTS] = {0.5 * bare.u_max, 0.0};
    double without[MK_MAX_STATES], with[MK_MAX_STATES];
    const double *x = &point.nodes[l].x(0, (long)node);
    mk_model_rhs(&bare, s.begin, x, none, without);
    mk_model_rhs(&bare, s.begin, x, some, with);
    for (int j = 0; j < joints; j++) {
        double dv = (with[joints + j] - without[joints + j]) / some[0] * log.period;
        s.doubt[j] = dv * dv * doubt;
    }
}

VectorXd Fit::process_variance(const FitPoint &point, size_t l, size_t node) const
{
    const mk_model &m = point.model;
    long joints = mk_model_joints(&m);
    const Segment &s = work[l][node];
    double span = s.end - s.begin;
    double loose = std::max(POSITION_STD, LOOSE * std::max(options.drift[0], options.drift[1]));
    VectorXd q = (loose * state_freedom(m)).cwiseAbs2();
    for (long j = 0; j < joints; j++) {
        q(joints + j) = options.drift[j] * options.drift[j] * span;
    }
    // A wheel at full speed shows the digits in which a simulation or a board computes.
    for (long j = 0; j < joints; j++)
        if (mk_plant(m.plant)->joint_is_wheel[j])
            q(joints + j) += std::pow(RELATIVE * logs[l]->v_max[j], 2) * span;
    for (long j = 0; j < joints; j++)
        q(joints + j) += s.doubt[j];
    return q;
}

// Of a base parameter, in standard deviations: its logarithm against that of the known value. One
// that vanishes is no great surprise: a friction may. The slope is per scaled parameter.
double Fit::surprise(const FitPoint &point, int number, double &slope) const
{
    constexpr double SPREAD = 1.0, NOTHING = 0.05;
    slope = 0.0;
    if (!options.near || number >= mk_plant(point.model.plant)->parameter_count)
        return 0.0;
    double known = options.near->parameter[number], now = point.model.parameter[number];
    if (!(known > 0.0) || !(now >= 0.0))
        return 0.0;
    slope = scale_of(point.model, number) / ((now + NOTHING * known) * SPREAD);
    return std::log((now + NOTHING * known) / (known + NOTHING * known)) / SPREAD;
}

void Fit::add_surprise(const FitPoint &point, const std::vector<int> &free, FitPicture &out) const
{
    for (size_t i = 0; i < free.size(); i++) {
        double slope = 0.0, s = surprise(point, free[i], slope);
        out.information((long)i, (long)i) += slope * slope;
        out.gradient((long)i) -= slope * s;
    }
}

double Fit::total_cost(const FitPoint &point) const
{
    double sum = 0.0;
    const VectorXd freedom = state_freedom(point.model);
    for (int i = 0; i < mk_plant(point.model.plant)->parameter_count; i++) {
        double slope = 0.0, s = surprise(point, i, slope);
        sum += 0.5 * s * s;
    }
    int joints = mk_model_joints(&point.model);
    for (size_t l = 0; l < logs.size(); l++) {
        for (size_t i = 0; i < work[l].size(); i++) {
            const Segment &s = work[l][i];
            if (!s.finite)
                return HUGE_VAL;
            sum += s.cost;
            if (!s.last) {
                VectorXd gap = s.x_end - point.nodes[l].x.col((long)i + 1);
                sum += 0.5 * gap.cwiseAbs2().cwiseQuotient(process_variance(point, l, i)).sum();
            }
        }
        VectorXd x0 = point.nodes[l].x.col(0);
        double rest[MK_MAX_STATES];
        mk_model_initial_state(&point.model, x0.data(), x0.data() + joints, rest);
        for (long s = 2 * joints; s < x0.size(); s++)
            sum += 0.5 * std::pow((x0(s) - rest[s]) / (HIDDEN_STD * freedom(s)), 2);
    }
    return std::isfinite(sum) ? sum : HUGE_VAL;
}

// log of the square root of the determinant.
static double log_root_det(const Eigen::LLT<MatrixXd> &factor)
{
    return MatrixXd(factor.matrixL()).diagonal().array().log().sum();
}

FitPicture Fit::eliminate(const FitPoint &point, int free_count, double damping)
{
    FitPicture out;
    long ns = mk_model_state_count(&point.model), nf = free_count;
    int joints = mk_model_joints(&point.model);
    out.information.setZero(nf, nf);
    out.gradient.setZero(nf);
    const VectorXd freedom = state_freedom(point.model);
    MatrixXd &D = out.information;
    VectorXd &d = out.gradient;
    for (size_t l = 0; l < logs.size(); l++) {
        VectorXd x0 = point.nodes[l].x.col(0);
        double rest[MK_MAX_STATES];
        mk_model_initial_state(&point.model, x0.data(), x0.data() + joints, rest);
        MatrixXd A = MatrixXd::Identity(ns, ns) * 1e-9, C = MatrixXd::Zero(ns, nf);
        VectorXd a = VectorXd::Zero(ns);
        for (long s = 2 * joints; s < ns; s++) {
            double std = HIDDEN_STD * freedom(s);
            A(s, s) += 1.0 / (std * std);
            a(s) += (rest[s] - x0(s)) / (std * std);
        }
        for (size_t i = 0; i < work[l].size(); i++) {
            Segment &s = work[l][i];
            if (!s.finite)
                return out;
            A += s.normal.topLeftCorner(ns, ns);
            C += s.normal.topRightCorner(ns, nf);
            D += s.normal.bottomRightCorner(nf, nf);
            a += s.right.head(ns);
            if (damping > 0.0)
                A.diagonal() += damping * s.normal.diagonal().head(ns);
            d += s.right.tail(nf);
            Eigen::LLT<MatrixXd> factor(A);
            s.P = factor.solve(MatrixXd::Identity(ns, ns));
            out.volume += log_root_det(factor);
            s.C = C;
            s.a = a;
            D -= C.transpose() * s.P * C;
            d -= C.transpose() * s.P * a;
            out.relief += 0.5 * a.dot(s.P * a);
            if (s.last)
                break;
            s.F = s.jac_end.topRows(ns).transpose();
            const MatrixXd &F = s.F;
            MatrixXd B = s.jac_end.bottomRows(nf).transpose();
            VectorXd gap = s.x_end - point.nodes[l].x.col((long)i + 1);
            MatrixXd S = F * s.P * F.transpose();
            const VectorXd push = process_variance(point, l, i);
            S.diagonal() += push;
            Eigen::LLT<MatrixXd> spread(S);
            s.A_next = spread.solve(MatrixXd::Identity(ns, ns));
            out.volume += log_root_det(spread);
            s.mu = gap + F * s.P * a;
            out.relief +=
                0.5 * (gap.cwiseAbs2().cwiseQuotient(push).sum() - s.mu.dot(s.A_next * s.mu));
            s.G = B - F * s.P * C;
            D += s.G.transpose() * s.A_next * s.G;
            d -= s.G.transpose() * s.A_next * s.mu;
            A = s.A_next;
            C = -s.A_next * s.G;
            a = s.A_next * s.mu;
        }
    }
    D = 0.5 * (D + D.transpose().eval());
    for (size_t l = 0; l < logs.size(); l++)
        for (int j = 0; j < joints; j++)
            for (double w : logs[l]->weight[j])
                out.volume += w * w * std::log(point.noise[j]);
    out.finite = D.allFinite() && d.allFinite() && std::isfinite(out.volume);
    return out;
}

// Moves the states along with a step of the parameters (backward sweep).
void Fit::substitute(FitPoint &point, const VectorXd &step, double length) const
{
    for (size_t l = 0; l < logs.size(); l++) {
        VectorXd next;
        for (size_t i = work[l].size(); i-- > 0;) {
            const Segment &s = work[l][i];
            VectorXd right = length * s.a - s.C * step;
            if (!s.last) {
                right += s.F.transpose() * (s.A_next * (next - length * s.mu - s.G * step));
            }
            next = s.P * right;
            point.nodes[l].x.col((long)i) += next;
        }
    }
}

// --- minimising ---

double Fit::cost(const FitPoint &point)
{
    shoot_all(point, {}, false);
    return total_cost(point);
}

FitPicture Fit::picture(const FitPoint &point, const std::vector<int> &free)
{
    shoot_all(point, free, true);
    FitPicture p = eliminate(point, (int)free.size(), 0.0);
    add_surprise(point, free, p);
    p.cost = total_cost(point);
    p.evidence = p.cost + p.volume;
    return p;
}

MatrixXd Fit::covariance(const mk_model &model, const FitPicture &picture,
                         const std::vector<int> &free)
{
    long n = (long)free.size();
    // Parameters differ by many orders of magnitude: solved with a unit diagonal.
    VectorXd root(n), scale(n);
    for (long i = 0; i < n; i++) {
        root(i) = std::sqrt(std::max(picture.information(i, i), 1e-300));
        scale(i) = scale_of(model, free[(size_t)i]) / root(i);
    }
    MatrixXd unit =
        root.cwiseInverse().asDiagonal() * picture.information * root.cwiseInverse().asDiagonal();
    MatrixXd inverse = unit.ldlt().solve(MatrixXd::Identity(n, n));
    return scale.asDiagonal() * inverse * scale.asDiagonal();
}

FitResiduals Fit::residuals(const FitPoint &point)
{
    FitResiduals out;
    int ns = mk_model_state_count(&point.model), joints = mk_model_joints(&point.model);
    shoot_all(point, {}, false);
    for (size_t l = 0; l < logs.size(); l++) {
        MatrixXd jump = MatrixXd::Zero(ns, (long)work[l].size());
        for (size_t i = 0; i < work[l].size(); i++) {
            const Segment &s = work[l][i];
            for (int j = 0; j < joints; j++)
                out.chi2[j] += s.sum2[j];
            if (!s.last && s.finite)
                jump.col((long)i + 1) = point.nodes[l].x.col((long)i + 1) - s.x_end;
        }
        out.jump.push_back(std::move(jump));
    }
    return out;
}

double Fit::update_noise(FitPoint &point)
{
    FitResiduals r = residuals(point);
    double change = 0.0;
    for (int j = 0; j < mk_model_joints(&point.model); j++) {
        double weight = 0.0;
        for (const FitLog *log : logs)
            for (double w : log->weight[j])
                weight += w * w;
        if (!(weight > 20.0))
            continue;
        double ratio = std::sqrt(r.chi2[j] / weight);
        double next = std::max(point.noise[j] * ratio, 1e-9);
        change = std::max(change, std::fabs(next / point.noise[j] - 1.0));
        point.noise[j] = next;
    }
    return change;
}

} // namespace mk
