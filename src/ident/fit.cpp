// Fit: the cost of a point, what it is made of, and its local quadratic model.
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
// whose matrix is block tridiagonal in the states, with p as a border. ident/fit_shoot.cpp gives r,
// F_i and their derivatives, ident/fit_eliminate.cpp takes the states out of the quadratic and puts
// them back, ident/fit_own.cpp does the same for random effects ("own values") of several logs, and
// ident/fit_minimise.cpp makes the steps.
//
// Symbols in the code: y, w in LogData; sigma_j point.noise[j]; h(x(t_k)) and derivatives from
// sim/shoot.hpp; F_i x_end; c_i gap; Q_i process_variance() (diagonal); x_i column i of nodes.x;
// dF/dx F, dF/dp B. Derivatives by p are per unit of scale_of(): p = p0 + scale dp, so that dp has
// no unit.
#include "ident/fit.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/dense.hpp"
#include "ident/fit_priv.hpp"
#include "ident/scale.hpp"

namespace mk
{

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace
{

// How much less the states of a moving base may jump at a shooting node than those of the joints
// (ratio of standard deviations).
constexpr double MOUNT = 0.1;
// And at no more process noise than this, rad/s per sqrt(s): a base that is kicked as hard as a
// model far from its data needs its joints to be would swing by itself, and explain whatever has
// its period.
constexpr double MOUNT_STILL = 0.1;
// Least standard deviation of the continuity defect of an angle, rad. Not 0: Q_i must have an
// inverse.
constexpr double POSITION_STD = 1e-5;
// Process-noise intensity of a wheel's speed per its largest speed, 1/sqrt(s).
constexpr double RELATIVE = 1e-6;
// Standard deviation of the continuity defect of angles and of effects' states, per unit of
// process-noise intensity: at 1 rad/s per sqrt(s) an angle may jump by 1e-3 rad.
constexpr double LOOSE = 1e-3;

} // namespace

// f(effect, its joint, where its states begin) for every effect of a model.
template <class F>
static void for_effects(const mk_model &model, F f)
{
    long at = 2 * mk_model_joints(&model);
    for (int e = 0; e < model.effect_count; e++) {
        const mk_effect_info &info = *mk_effect(model.effect[e].index);
        f(info, model.effect[e].joint, at);
        at += info.state_count;
    }
}

VectorXd state_freedom(const mk_model &model)
{
    VectorXd freedom = VectorXd::Ones(mk_model_state_count(&model));
    for_effects(model, [&](const mk_effect_info &info, int joint, long at) {
        if (info.stages & MK_STAGE_FRAME)
            freedom.segment(at, info.state_count).setConstant(MOUNT);
        if (joint > 0)
            freedom.segment(at, info.state_count) *= mk_model_joint_scale(&model, joint - 1);
    });
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
        bool idle = !mk_parameter_applies(info, model.plant) ||
                    (strcmp(info->name, "frequency") == 0 && strstr(name, "custom-wave") &&
                     mk_model_parameter(&model, i - 1) < 8.0);
        if (info->fit != MK_FIT_FIXED && info->fit != MK_FIT_INTEGER && !idle && i != held)
            free.push_back(i);
    }
    return free;
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

// --- process noise and priors ---

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
    //     effect's state  (freedom max(POSITION_STD, LOOSE D))^2 ,   min(D, MOUNT_STILL) in place
    //     of
    //                     D for a moving base .
    // The speed's is a random walk: white acceleration of intensity D integrates to D^2 times the
    // span.
    const mk_model &m = point.model;
    long joints = mk_model_joints(&m);
    const Segment &s = work[l][node];
    double span = s.end - s.begin;
    const double most = std::max(options.process_noise[0], options.process_noise[1]);
    const auto jump = [](double d) { return std::max(POSITION_STD, LOOSE * d); };
    VectorXd q = (jump(most) * state_freedom(m)).cwiseAbs2();
    const double base = std::pow(MOUNT * jump(std::min(most, MOUNT_STILL)), 2);
    for_effects(m, [&](const mk_effect_info &info, int, long at) {
        if (info.stages & MK_STAGE_FRAME)
            q.segment(at, info.state_count).setConstant(base);
    });
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
static double surprise_of_value(const mk_model &near, const mk_model &model, int number,
                                double &slope)
{
    constexpr double SPREAD = 1.0, NOTHING = 0.05;
    slope = 0.0;
    double known = near.parameter[number], now = model.parameter[number];
    if (!(known > 0.0) || !(now >= 0.0))
        return 0.0;
    const double unit = Fit::scale_of(model, number) / ((now + NOTHING * known) * SPREAD);
    const double far = std::log((now + NOTHING * known) / (known + NOTHING * known)) / SPREAD;
    const double square = far * far, heard = std::sqrt(std::log1p(square));
    slope = heard > 1e-4 ? unit * std::fabs(far) / ((1.0 + square) * heard) : unit;
    return std::copysign(heard, far);
}

// With w how far a mass is outside of its range, h and w are one residual:
//     r = sqrt(h^2 + w^2) ,   dr/dp = (h dh/dp + w dw/dp) / r .
double Fit::surprise(const mk_model &near, const MassRange *masses, const mk_model &model,
                     int number, double &slope)
{
    slope = 0.0;
    if (number >= mk_plant(model.plant)->parameter_count)
        return 0.0;
    const double heard = surprise_of_value(near, model, number, slope);
    double steep = 0.0;
    const double outside = masses ? masses->excess(model, number, steep) : 0.0;
    if (outside == 0.0)
        return heard;
    const double both = std::hypot(heard, outside);
    slope = (heard * slope + outside * steep * scale_of(model, number)) / both;
    return both;
}

double Fit::surprise(const FitPoint &point, int number, double &slope) const
{
    slope = 0.0;
    return options.near ? surprise(*options.near, options.masses, point.model, number, slope) : 0.0;
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

// --- a point and its quadratic model ---

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

// Diagonal entries of H differ by many orders of magnitude. With R = diag(H)^(-1/2) the matrix
// U = R H R has a unit diagonal, and H^-1 = R U^-1 R.
MatrixXd inverse_of(const MatrixXd &information)
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

} // namespace mk
