// Fit: shooting, the cost of a point, and its local quadratic model with the states eliminated.
//
// The method is multiple shooting (H. G. Bock 1987) with a Gauss-Newton step. Unknowns are the
// parameters p and the states x_i at the shooting nodes. With F_i(x_i, p) the end of the trajectory
// of shooting interval i, as the kernel integrates it, the cost is the negative log likelihood up
// to a constant:
//
//     cost = 1/2 sum_k r_k^2 + 1/2 sum_i c_i' Q_i^-1 c_i + priors ,
//     r_k  = w_k (y_k - h(x(t_k), p)) / sigma_j        residual of reading k, of joint j ,
//     c_i  = F_i(x_i, p) - x_(i+1)                     continuity defect, c_i ~ N(0, Q_i) .
//
// About a point all r and c are linear in the steps (dx_i, dp), so that the cost is a quadratic
// whose matrix is block tridiagonal in the states, with p as a border. The states are eliminated
// one after the other (eliminate_log), which is an information filter; the way back (substitute) is
// the smoother of J. Rauch, F. Tung, C. Striebel 1965. What is left is a dense quadratic in dp.
//
// Symbols in the code: y, w in LogData; sigma_j point.noise[j]; h(x(t_k)) and derivatives from
// sim/shoot.hpp; F_i x_end; c_i gap; Q_i process_variance() (diagonal); x_i column i of nodes.x;
// dF/dx F, dF/dp B. Derivatives by p are per unit of scale_of(): p = p0 + scale dp, so that dp has
// no unit. Random effects ("own values") of several logs are eliminated last (eliminate_own).
//
// Decompositions are those of base/dense.hpp; ident/fit_minimise.cpp makes the steps.
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

// Standard deviation of the prior on the state of an effect at the start of a log, in the state's
// own unit (rad, rad/s) and times state_freedom(). The prior's mean is the effect's state at rest.
constexpr double HIDDEN_STD = 0.05;
// How much less the states of a moving base may jump at a shooting node than those of the joints
// (ratio of standard deviations).
constexpr double MOUNT = 0.1;
// Least standard deviation of the continuity defect of an angle, rad. Not 0: Q_i must have an
// inverse.
constexpr double POSITION_STD = 1e-5;
// Process-noise intensity of a wheel's speed per its largest speed, 1/sqrt(s).
constexpr double RELATIVE = 1e-6;
// Step of the passes over the data in which work is counted (FitOptions::max_passes), s.
constexpr double PASS_STEP = 2.5e-3;
// Standard deviation of the continuity defect of angles and of effects' states, per unit of
// process-noise intensity: at 1 rad/s per sqrt(s) an angle may jump by 1e-3 rad.
constexpr double LOOSE = 1e-3;

} // namespace
// Factors on the standard deviations of the states: 1 for angles and speeds, MOUNT for the states
// of a moving base, and the joint's scale for the states of an effect at a joint (0.01 where it
// slides and states are in m).
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
    //     scale = max(|p|, |p_initial| / 10) ,   0.01 where both are nothing.
    //
    // One unit of a scaled step then changes the parameter by about its own size. The second term
    // keeps the scale away from 0 where a fit drives p there.
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

// Weights of a log's readings at a point: w_k / sigma_j, so that the kernel's residuals are r_k.
// The weight w_k, 0 to 1, is the square root of the share of an independent reading that reading k
// is worth (ident/fit_log.hpp); a missing reading has 0.
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
    // Columns of the jacobian: the ns start states of the interval, then the free parameters.
    // Sensors that are late show the state as it was: of a reading at t the model's state is at t -
    // late, so that an interval sees rows up to `late` behind its end.
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
        // The kernel writes ns rows of `columns` numbers, row-major. Eigen's default is
        // column-major, so that the matrix here is the transpose: jac_end(c, s) = d x_end(s) / d
        // column c.
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

// Reduces what shooting gave of an interval to its normal equations. With J_rc = - d r_r / d column
// c and d = (dx_i, dp),
//     1/2 |r - J d|^2 = 1/2 r'r - (J'r)' d + 1/2 d' (J'J) d ,
// so that cost = r'r / 2, right = J'r and normal = J'J are all that the elimination needs. J itself
// is given up: it has as many rows as the interval has readings.
void Fit::compress(const ShootTask &task, const double *noise, size_t l, size_t i)
{
    Segment &s = work[l][i];
    // Each column of derivatives is counted as a sixth of what a step costs without any.
    s.effort = (double)task.steps * (1.0 + task.columns / 6.0);
    s.finite = task.finite;
    size_t n = task.finite ? task.row_count : 0;
    s.residual.resize(n);
    s.joint.resize(n);
    const Correction *c = correction ? &correction->by_log[l][i] : nullptr;
    // Residuals with steps of length h differ from those with short ones by a nearly constant
    // amount near the point that the correction was taken at:
    //     r(p) = r_h(p) + (r_short - r_h)(p0) ,   F_i likewise.
    // The correction is kept in rad, so that it outlives a change of sigma. States of further
    // effects come after those of that point; they have no correction.
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
    // In passes: steps taken, derivatives counted in, over the steps of PASS_STEP that all logs
    // have.
    work_done += effort / usual;
}

// Within one long step a contact may begin and end unseen, since the kernel looks for a change of
// sign from one end of the step to the other. So models with contact take shorter ones.
double Fit::longest_step(const mk_model &model) const
{
    // Longest step of models with switching surfaces, s.
    constexpr double CONTACT = 2.5e-3;
    return mk_model_event_count(&model) > 0 ? std::min(options.step, CONTACT) : options.step;
}

void Fit::coarsen(const FitPoint &point)
{
    constexpr double READING_CHANGE = 0.02; // of the noise: so much may long steps change a reading
    correction.reset();
    // Finds the longest step h, from `longest` down by factors of SHORTER, whose residuals differ
    // from those of the point's own step by less than READING_CHANGE in the rms:
    //     sqrt(mean_k (r_k(short) - r_k(h))^2) < READING_CHANGE .
    // From then on all shooting takes h and adds the difference. Jacobians are those of h: they
    // only have to be good enough for a step.
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

// What makes residuals and ends of fine shooting intervals of the coarse ones that `work` holds.
// Returns the root mean square of the change of the residuals, in the readings' standard
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

// --- the local quadratic model ---

// What is not known of the command moves the speeds. An error e_k of the command in row k, held for
// one period T, changes the speed by (da/du) T e_k. Errors of different rows are independent, so
// the variance that they add up to at the end of the shooting interval is
//     s.doubt[j] = (da_j/du T)^2 sum_k s_k^2 ,
// with s_k = log.doubt[k] for rows that were not recorded, and s_k = u_step / sqrt(12) in every row
// for the last digit that the log writes (uniform rounding). How the dynamics carry a change of
// speed through the rest of the interval is left out. It adds to Q_i.
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
    // da_j/du at the node's state, by the difference between no and half of the full command:
    // exact, because accelerations are linear in the torque. Effects are left out: friction and
    // contact do not change how torque meets the mass matrix, and some of them are not linear in u.
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
    // Q_i is diagonal. With D the process-noise intensity of the speeds and s the joint's scale (1;
    // 0.01 for a joint that slides),
    //     angle           (s max(POSITION_STD, LOOSE D))^2
    //     speed           (s D)^2 (t_(i+1) - t_i) + (RELATIVE v_max)^2 (t_(i+1) - t_i) + doubt
    //     effect's state  (freedom max(POSITION_STD, LOOSE D))^2 .
    // The speed's is a random walk: white acceleration of intensity D integrates to D^2 times the
    // span.
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

// Prior on a base parameter with known value k, heavy-tailed as Student's distribution, of the
// logarithm: its density in f is proportional to (1 + f^2)^(-1/2). With nu = NOTHING,
//     f    = log((p + nu k) / (k + nu k)) / SPREAD ,
//     cost = log(1 + f^2) / 2 = h^2 / 2 ,   h = sign(f) sqrt(log(1 + f^2)) .
// h is returned: a residual like all others, so that h^2 / 2 joins the cost and (dh/dp)^2 the
// information. nu k keeps f finite at p = 0, which is no great surprise: a friction may vanish.
//
// Near k the cost is f^2 / 2, far from it nearly flat. Its slope by f is f / (1 + f^2), 1/2 at
// most: it decides what the data leave open and holds nothing off that they say.
//
// The slope is per scaled parameter: df/dp scale = scale / ((p + nu k) SPREAD) = unit, and
//     dh/df = |f| / ((1 + f^2) |h|)  ->  1  as f -> 0 .
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

// The cost at a point whose intervals have just been shot: sums of squares of residuals, continuity
// defects in units of Q_i, the prior of effects' states at the start of each log
//     1/2 sum_s ((x_0s - rest_s) / (HIDDEN_STD freedom_s))^2 ,
// that of base parameters (surprise) and that of own values. HUGE_VAL where a trajectory ran away.
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

// Eliminates the states of one log, first to last. Before interval i, all that earlier intervals
// say of the step x of node i and of the parameters p is the quadratic
//     x'A x/2 + x'C p - a'x  +  p'D p/2 - d'p .
// A is ns x ns, C is ns x nf, and D, d are out.information and out.gradient, which gather what is
// left of p. One interval takes three operations.
//
// 1. Add the interval's normal equations: blocks of J'J to A, C, D and of J'r to a, d.
//
// 2. Eliminate x. Given p, x ~ N(P (a - C p), P) with P = A^-1. Put in, this leaves
//     D <- D - C'P C ,   d <- d - C'P a .
//
// 3. Carry on through x_next = c + F x + B p + w, w ~ N(0, Q). Given p, x_next is normal with
//     mean        mu + G p ,   mu = c + F P a ,   G = B - F P C ,
//     covariance  S = F P F' + Q ,
// which in the form above is, for the next node,
//     A = S^-1 ,   C = -S^-1 G ,   a = S^-1 mu ,   D += G'S^-1 G ,   d -= G'S^-1 mu .
// Only S is inverted, never Q: next to no process noise is no trouble.
//
// Laplace's integral over the states (for nlml) has the determinant of the whole state matrix H_xx
// and the norms of the continuity defects. They come along without H_xx ever being formed, because
// |A| |Q + F A^-1 F'| = |Q| |A + F'Q^-1 F|:
//     1/2 log|H_xx| + 1/2 sum_i log|Q_i| = 1/2 sum_i (log|A_i| + log|S_i|) .
//
// With p held, the cost falls by out.state_decrease when the states step to their best:
//     sum_i (a'P a + c'Q^-1 c - mu'S^-1 mu) / 2 .
//
// `damping` is Levenberg-Marquardt's on the states, in units of what the interval's own readings
// say.
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
    // Before the first interval: the prior of effects' states. 1e-9 (a standard deviation of 3e4)
    // keeps A regular where no reading sees a state.
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
        // invert_positive returns log sqrt(determinant), half of the logarithm that the formula
        // has.
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
    // Sum over logs. Where parameters have own values, the logs of one source see other values of p
    // than those of the next: their quadratics are first added by source, and the own values
    // eliminated from each. A trajectory that ran away has no derivatives: `finite` stays false.
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
    // Rounding makes D a little unsymmetric; LDL' reads one half of it.
    MatrixXd &D = out.information;
    D = 0.5 * (D + D.transpose().eval());
    for (size_t l = 0; l < logs.size(); l++)
        for (int j = 0; j < mk_model_joints(&point.model); j++)
            for (double w : logs[l]->weight[j])
                out.log_determinant += w * w * std::log(point.noise[j]);
    out.finite = D.allFinite() && out.gradient.allFinite() && std::isfinite(out.log_determinant);
    return out;
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

// Moves the states and the own values along with a step of the parameters, last node to first (the
// smoother of Rauch, Tung, Striebel). With the next node's step known,
//     dx_i = P (a - C dp + F' S^-1 (dx_(i+1) - mu - G dp)) ;
// the last interval has no such term. `step` is dp as it is taken, already shortened to `length` of
// the full one: a, mu and beta, which are not proportional to dp, are shortened here, so that all
// unknowns go the same share of the way.
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

//     nlml = cost + 1/2 log|H_xx| + 1/2 sum_i log|Q_i| + sum_k w_k^2 log sigma_j + own values ,
// Laplace's approximation of the negative log marginal likelihood, the states integrated out, up to
// a constant; `own values` is what eliminate_own adds.
QuadraticModel Fit::quadratic(const FitPoint &point, const std::vector<int> &free)
{
    shoot_all(point, free, true);
    QuadraticModel p = eliminate(point, free, 0.0);
    add_surprise(point, free, p);
    p.cost = total_cost(point);
    p.nlml = p.cost + p.log_determinant;
    return p;
}

// Diagonal entries of the information H differ by many orders of magnitude. With R = diag(H)^(-1/2)
// the matrix U = R H R has a unit diagonal, and H^-1 = R U^-1 R.
static MatrixXd inverse_of(const MatrixXd &information)
{
    const VectorXd root = information.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    const MatrixXd unit = root.asDiagonal() * information * root.asDiagonal();
    const MatrixXd inverse =
        dense::solve_symmetric(unit, MatrixXd(MatrixXd::Identity(unit.rows(), unit.cols())));
    return root.asDiagonal() * inverse * root.asDiagonal();
}

// Gauss-Newton's H is the Fisher information of the scaled parameters, so that S H^-1 S with S =
// diag(scale) is the Cramer-Rao bound in the parameters' own units. Its roots are the standard
// errors.
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

// Maximum likelihood of sigma_j with everything else held. The terms in it,
//     chi2_j / 2 + sum_k w_k^2 log sigma_j ,   chi2_j = sum_k r_k^2 ~ 1 / sigma_j^2 ,
// are least where sigma_j^2 grows by the factor chi2_j / sum_k w_k^2. A joint with fewer than 20
// independent readings keeps its noise; 1e-9 rad is the least.
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
        // Given p, b = P (beta - K'p) with covariance P; p itself has the covariance `cov`. So
        //     var b       = P + M cov M' ,              M = -P K' ,
        //     var (p + b) = P + (E' + M) cov (E' + M)' ,
        // E' + M being row i of M with 1 added in the column of its own mean.
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
