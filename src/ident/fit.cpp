// Fit: shooting, the elimination of states, and the cost.
#include "ident/fit.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/dense.hpp"
#include "base/parallel.hpp"
#include "ident/fit_priv.hpp"
#include "ident/scale.hpp"

namespace mk
{

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace
{

constexpr double HIDDEN_STD = 0.05;   // of an effect's state at the start of a log
constexpr double MOUNT = 0.1;         // what a base does, of what the other states do
constexpr double POSITION_STD = 1e-5; // continuity of angles between shooting intervals, rad
constexpr double RELATIVE = 1e-6;     // drift of a wheel per speed, 1/sqrt(s)
constexpr double PASS_STEP = 2.5e-3;  // of the passes that work is counted in, s
constexpr double LOOSE = 1e-3;        // the same, and of effects' states, per unit of process noise

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
        if (model.effect[e].joint > 0)
            freedom.segment(at, info->state_count) *=
                mk_model_joint_scale(&model, model.effect[e].joint - 1);
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
    const int held = model.no_motor ? scale_holder(model, nullptr) : -1;
    int n = mk_model_parameter_count(&model);
    for (int i = 0; i < n; i++) {
        char name[64];
        const mk_parameter_info *info = mk_model_parameter_info(&model, i, name, sizeof name);
        // Most library terms have no frequency.
        bool idle = strcmp(info->name, "frequency") == 0 && strstr(name, "custom-wave") &&
                    mk_model_parameter(&model, i - 1) < 8.0;
        if (info->fit != MK_FIT_FIXED && info->fit != MK_FIT_INTEGER && !idle && i != held)
            free.push_back(i);
    }
    return free;
}

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
        if (!point.own.empty())
            d.model = model_of_source(point, logs[l]->source);
        d.shoot.rows = logs[l]->rows();
        d.shoot.start = logs[l]->start;
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

// Buffers of shooting intervals that are shot together.
struct Fit::Batch {
    std::vector<ShootTask> task;
    std::vector<double> jac, scale;
};

// Shooting intervals first .. last - 1 of `jobs`.
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
        const ShootingNodes &nodes = point.nodes[l];
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
        task.model = &model_of(point, l);
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
    // Those of one model go side by side.
    for (size_t done = 0, next = 0; done < batch.task.size(); done = next) {
        while (next < batch.task.size() && batch.task[next].model == batch.task[done].model)
            next++;
        shoot(&batch.task[done], (int)(next - done));
    }
    for (const Job *job = first; job < last; job++)
        compress(batch.task[(size_t)(job - first)], point.noise, job->first, job->second);
}

// What a shooting interval's fit needs to know of how it went.
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
    constexpr double READING_CHANGE = 0.02; // of the noise: so much may long steps change a reading
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
        if (correct(point, fine, *all) < READING_CHANGE) {
            all->step = coarse.step;
            correction = all;
            return;
        }
    }
}

// What makes of the work's shooting intervals fine ones. Returns its root mean square, in readings'
// standard deviations.
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

// --- the local quadratic model ---

// What is not known of the command (rows that were not recorded, digits that were not written)
// moves the speeds: variances by joint at the end of a shooting interval.
void Fit::add_input_uncertainty(const FitPoint &point, size_t l, size_t node)
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
    double loose = std::max(POSITION_STD,
                            LOOSE * std::max(options.process_noise[0], options.process_noise[1]));
    VectorXd q = (loose * state_freedom(m)).cwiseAbs2();
    for (long j = 0; j < joints; j++) {
        const double size = mk_model_joint_scale(&m, (int)j);
        q(j) *= size * size;
        q(joints + j) = std::pow(options.process_noise[j] * size, 2) * span;
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
double Fit::surprise(const mk_model &near, const mk_model &model, int number, double &slope)
{
    constexpr double SPREAD = 1.0, NOTHING = 0.05;
    slope = 0.0;
    if (number >= mk_plant(model.plant)->parameter_count)
        return 0.0;
    double known = near.parameter[number], now = model.parameter[number];
    if (!(known > 0.0) || !(now >= 0.0))
        return 0.0;
    const double unit = scale_of(model, number) / ((now + NOTHING * known) * SPREAD);
    const double far = std::log((now + NOTHING * known) / (known + NOTHING * known)) / SPREAD;
    // Half the square of what is returned is log(1 + far^2) / 2, of a Student distribution with one
    // degree of freedom: near the known value a square, far from it nearly flat. It decides what
    // data leave open and holds nothing off that they say: the pull is half a standard deviation at
    // most.
    const double square = far * far, heard = std::sqrt(std::log1p(square));
    slope = heard > 1e-4 ? unit * std::fabs(far) / ((1.0 + square) * heard) : unit;
    return std::copysign(heard, far);
}

double Fit::surprise(const FitPoint &point, int number, double &slope) const
{
    slope = 0.0;
    return options.near ? surprise(*options.near, point.model, number, slope) : 0.0;
}

void Fit::add_surprise(const FitPoint &point, const std::vector<int> &free,
                       QuadraticModel &out) const
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
        mk_model_initial_state(&model_of(point, l), x0.data(), x0.data() + joints, rest);
        for (long s = 2 * joints; s < x0.size(); s++)
            sum += 0.5 * std::pow((x0(s) - rest[s]) / (HIDDEN_STD * freedom(s)), 2);
    }
    sum += own_cost(point);
    return std::isfinite(sum) ? sum : HUGE_VAL;
}

// The states of one log are eliminated one after the other: with (A, C, a) what is known of the
// next state x and its coupling to the parameters p,
//     x'A x/2 + x'C p - a'x ,
// each shooting interval adds its normal equations, x is eliminated, and what is known is carried
// through the shooting interval's end (jacobian F) and widened by the process noise.
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
    MatrixXd A = MatrixXd::Identity(ns, ns) * 1e-9, C = MatrixXd::Zero(ns, nf);
    VectorXd a = VectorXd::Zero(ns);
    for (long s = 2 * joints; s < ns; s++) {
        double std = HIDDEN_STD * freedom(s);
        A(s, s) += 1.0 / (std * std);
        a(s) += (rest[s] - x0(s)) / (std * std);
    }
    for (size_t i = 0; i < work[l].size(); i++) {
        Segment &s = work[l][i];
        A += s.normal.topLeftCorner(ns, ns);
        C += s.normal.topRightCorner(ns, nf);
        D += s.normal.bottomRightCorner(nf, nf);
        a += s.right.head(ns);
        if (damping > 0.0)
            A.diagonal() += damping * s.normal.diagonal().head(ns);
        d += s.right.tail(nf);
        out.log_determinant += dense::invert_positive(A, s.P);
        s.C = C;
        s.a = a;
        D -= C.transpose() * s.P * C;
        d -= C.transpose() * s.P * a;
        out.state_decrease += 0.5 * a.dot(s.P * a);
        if (s.last)
            break;
        s.F = s.jac_end.topRows(ns).transpose();
        const MatrixXd &F = s.F;
        MatrixXd B = s.jac_end.bottomRows(nf).transpose();
        VectorXd gap = s.x_end - point.nodes[l].x.col((long)i + 1);
        MatrixXd S = F * s.P * F.transpose();
        const VectorXd variance = process_variance(point, l, i);
        S.diagonal() += variance;
        out.log_determinant += dense::invert_positive(S, s.A_next);
        s.mu = gap + F * s.P * a;
        out.state_decrease +=
            0.5 * (gap.cwiseAbs2().cwiseQuotient(variance).sum() - s.mu.dot(s.A_next * s.mu));
        s.G = B - F * s.P * C;
        D += s.G.transpose() * s.A_next * s.G;
        d -= s.G.transpose() * s.A_next * s.mu;
        A = s.A_next;
        C = -s.A_next * s.G;
        a = s.A_next * s.mu;
    }
}

QuadraticModel Fit::eliminate(const FitPoint &point, const std::vector<int> &free, double damping)
{
    QuadraticModel out;
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
    MatrixXd &D = out.information;
    D = 0.5 * (D + D.transpose().eval());
    for (size_t l = 0; l < logs.size(); l++)
        for (int j = 0; j < mk_model_joints(&point.model); j++)
            for (double w : logs[l]->weight[j])
                out.log_determinant += w * w * std::log(point.noise[j]);
    out.finite = D.allFinite() && out.gradient.allFinite() && std::isfinite(out.log_determinant);
    return out;
}

// Steps of own values are in the same scaled units as those of their means.
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
        MatrixXd M = s.D(s.place, s.place);
        s.K = s.D(Eigen::all, s.place);
        s.beta = s.d(s.place);
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
        out.information -= s.K * s.P * s.K.transpose();
        out.gradient -= s.K * s.P * s.beta;
        out.state_decrease += 0.5 * s.beta.dot(s.P * s.beta);
    }
}

// The prior of the own values.
double Fit::own_cost(const FitPoint &point) const
{
    double sum = 0.0;
    const std::vector<int> own = own_parameters(point.model);
    for (const VectorXd &b : point.own)
        for (size_t i = 0; i < own.size(); i++)
            sum += 0.5 * std::pow(b((long)i) / mk_model_parameter_spread(&point.model, own[i]), 2);
    return sum;
}

// Moves the states and the own values along with a step of the parameters (backward sweep).
void Fit::substitute(FitPoint &point, const VectorXd &step, double length) const
{
    std::vector<VectorXd> own_step; // of the parameters as a source sees them
    const std::vector<int> own = own_parameters(point.model);
    for (size_t n = 0; n < sources.size(); n++) {
        const Source &s = sources[n];
        VectorXd seen = step;
        if (!s.place.empty()) {
            const VectorXd b = s.P * (length * s.beta - s.K.transpose() * step);
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
            VectorXd right = length * s.a - s.C * by;
            if (!s.last) {
                right += s.F.transpose() * (s.A_next * (next - length * s.mu - s.G * by));
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

QuadraticModel Fit::quadratic(const FitPoint &point, const std::vector<int> &free)
{
    shoot_all(point, free, true);
    QuadraticModel p = eliminate(point, free, 0.0);
    add_surprise(point, free, p);
    p.cost = total_cost(point);
    p.nlml = p.cost + p.log_determinant;
    return p;
}

// Parameters differ by many orders of magnitude: inverted with a unit diagonal.
static MatrixXd inverse_of(const MatrixXd &information)
{
    const VectorXd root = information.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    const MatrixXd unit = root.asDiagonal() * information * root.asDiagonal();
    const MatrixXd inverse =
        dense::solve_symmetric(unit, MatrixXd(MatrixXd::Identity(unit.rows(), unit.cols())));
    return root.asDiagonal() * inverse * root.asDiagonal();
}

MatrixXd Fit::covariance(const mk_model &model, const QuadraticModel &quadratic,
                         const std::vector<int> &free)
{
    VectorXd scale((long)free.size());
    for (size_t i = 0; i < free.size(); i++)
        scale((long)i) = scale_of(model, free[i]);
    return scale.asDiagonal() * inverse_of(quadratic.information) * scale.asDiagonal();
}

FitResiduals Fit::residuals(const FitPoint &point)
{
    FitResiduals out;
    int ns = mk_model_state_count(&point.model), joints = mk_model_joints(&point.model);
    shoot_all(point, {}, false);
    for (size_t l = 0; l < logs.size(); l++) {
        MatrixXd defect = MatrixXd::Zero(ns, (long)work[l].size());
        for (size_t i = 0; i < work[l].size(); i++) {
            const Segment &s = work[l][i];
            for (int j = 0; j < joints; j++)
                out.chi2[j] += s.sum2[j];
            if (!s.last && s.finite)
                defect.col((long)i + 1) = point.nodes[l].x.col((long)i + 1) - s.x_end;
        }
        out.defect.push_back(std::move(defect));
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

std::vector<OwnValue> Fit::own_values(const FitPoint &point, const QuadraticModel &quadratic) const
{
    std::vector<OwnValue> all;
    const std::vector<int> own = own_parameters(point.model);
    const MatrixXd cov = own.empty() ? MatrixXd() : inverse_of(quadratic.information);
    for (size_t n = 0; n < sources.size(); n++) {
        const Source &s = sources[n];
        if (s.place.empty())
            continue;
        // b = P (beta - K'p): var b = P + P K' cov K P, var (p + b) likewise with p in the bracket.
        const MatrixXd by = -s.P * s.K.transpose();
        for (size_t i = 0; i < s.place.size(); i++) {
            const long k = (long)i;
            const double unit = scale_of(point.model, own[s.which[i]]);
            VectorXd of_b = by.row(k), of_value = of_b;
            of_value(s.place[i]) += 1.0;
            OwnValue v;
            v.number = own[s.which[i]];
            v.source = (int)n;
            v.deviation = point.own[n]((long)s.which[i]);
            v.deviation_error = unit * std::sqrt(std::max(s.P(k, k) + of_b.dot(cov * of_b), 0.0));
            v.value = mk_model_parameter(&point.model, v.number) + v.deviation;
            v.std_error = unit * std::sqrt(std::max(s.P(k, k) + of_value.dot(cov * of_value), 0.0));
            all.push_back(v);
        }
    }
    return all;
}

// The spread of largest marginal likelihood, by MacKay's fixed point: spread^2 = sum b^2 / sum
// (1 - var b / spread^2), the numerator what the own values are, the denominator how many of them
// the data determine. (With well determined values and a free mean: the sample variance.)
double Fit::update_spreads(FitPoint &point, const QuadraticModel &quadratic)
{
    constexpr double LEAST = 1e-3; // of the parameter's scale: next to no spread
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
