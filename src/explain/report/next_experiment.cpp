#include "explain/report/next_experiment.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>

#include "base/dense.hpp"
#include "base/out_file.h"
#include "explain/policy.hpp"
#include "mechkit/explain.h"
#include "mechkit/signal.h"

namespace mk
{

namespace
{

constexpr double SECONDS = 10.0;

// Of amplitude one.
const char *const family[] = {"multisine(0.2,12,1)",
                              "multisine(0.4,10,2)",
                              "multisine(0.1,6,3)",
                              "chirp(0.3,4,10)",
                              "chirp(0.1,1.5,10)",
                              "square(0.25)",
                              "square(0.7)",
                              "saw(0.2)",
                              "(t/5-1)",
                              "pulse(0,0.4)",
                              "step(0.2)",
                              "sin(6*t)"};
constexpr double shares[] = {0.25, 0.5, 1.0}; // of the largest command

// What readings a model predicts from rest under a command, with derivatives by its parameters;
// both over the noise.
struct Forecast {
    Eigen::VectorXd y;
    Eigen::MatrixXd jacobian; // rows as y; columns: the fitted parameters, scaled
};

struct Trial {
    std::vector<double> t, u, zero, weight[MK_MAX_JOINTS];
};

// Where the rig hangs by itself with the motor off: the angles at which nothing accelerates, by
// Newton's method from the plant's rest. Wheels stay where they are.
void settle_at_rest(const mk_model &m, double *q)
{
    constexpr double SIDE = 1e-5; // rad
    const mk_plant_info *plant = mk_plant(m.plant);
    int joints = plant->joints;
    std::copy(plant->rest, plant->rest + joints, q);
    auto pull = [&](const Eigen::VectorXd &at) {
        const double still[MK_MAX_JOINTS] = {0.0, 0.0}, none[MK_MAX_INPUTS] = {0.0, 0.0};
        double x[MK_MAX_STATES], dx[MK_MAX_STATES];
        mk_model_initial_state(&m, at.data(), still, x);
        mk_model_rhs(&m, 0.0, x, none, dx);
        return Eigen::VectorXd(Eigen::Map<Eigen::VectorXd>(dx + joints, joints));
    };
    Eigen::VectorXd at = Eigen::Map<Eigen::VectorXd>(q, joints);
    for (int round = 0; round < 5; round++) {
        Eigen::VectorXd a = pull(at);
        Eigen::MatrixXd slope(joints, joints);
        for (int j = 0; j < joints; j++) {
            Eigen::VectorXd beside = at;
            beside(j) += SIDE;
            slope.col(j) = (pull(beside) - a) / SIDE;
        }
        Eigen::VectorXd step = -dense::shortest_solution(slope, a);
        if (!step.allFinite() || step.norm() > 0.3)
            return; // not near: the plant's own rest will do
        at += step;
    }
    std::copy(at.data(), at.data() + joints, q);
}

bool forecast(const Hypothesis &h, const Trial &trial, bool derivatives, Forecast &out)
{
    const mk_model &m = h.point.model;
    int joints = mk_model_joints(&m), ns = mk_model_state_count(&m);
    ShootData data = {};
    data.rows = trial.t.size();
    data.t = trial.t.data();
    data.u[0] = trial.u.data();
    data.u[1] = trial.zero.data();
    for (int j = 0; j < joints; j++) {
        data.q[j] = trial.zero.data();
        data.w[j] = trial.weight[j].data();
    }
    std::vector<int> free = derivatives ? fitted_parameters(m) : std::vector<int>();
    std::vector<double> scale;
    for (int number : free)
        scale.push_back(Fit::scale_of(m, number));
    const double still[MK_MAX_JOINTS] = {0.0, 0.0};
    std::vector<double> x((size_t)ns), x_end((size_t)ns);
    double hanging[MK_MAX_JOINTS];
    settle_at_rest(m, hanging);
    mk_model_initial_state(&m, hanging, still, x.data());
    int columns = derivatives ? ns + (int)free.size() : 0;
    size_t capacity = data.rows * (size_t)joints + 8;
    std::vector<double> residual(capacity), jac(capacity * (size_t)std::max(columns, 1)),
        jac_end((size_t)(ns * std::max(columns, 1)));
    ShootTask task = {};
    task.model = &m;
    task.data = &data;
    task.end = trial.t.back();
    task.last = true;
    task.x = x.data();
    task.step = 2.5e-3;
    task.free_count = (int)free.size();
    task.free = free.data();
    task.scale = scale.data();
    task.columns = columns;
    task.x_end = x_end.data();
    task.jac_end = jac_end.data();
    task.row_capacity = capacity;
    task.residual = residual.data();
    task.jac = jac.data();
    shoot(task);
    if (!task.finite)
        return false;
    long n = (long)task.row_count;
    out.y = -Eigen::Map<Eigen::VectorXd>(residual.data(), n);
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    if (derivatives)
        out.jacobian = Eigen::Map<RowMajor>(jac.data(), n, columns).rightCols((long)free.size());
    return out.y.allFinite();
}

Trial make_trial(const mk_signal *signal, const Hypothesis &h, const ExperimentLimits &limits)
{
    Trial trial;
    size_t rows = (size_t)(SECONDS / limits.period);
    for (size_t k = 0; k < rows; k++) {
        double t = (double)k * limits.period, u = mk_signal_at(signal, t);
        trial.t.push_back(t);
        trial.u.push_back(std::min(std::max(u, -limits.u_max), limits.u_max));
    }
    trial.zero.assign(rows, 0.0);
    for (int j = 0; j < mk_model_joints(&h.point.model); j++)
        trial.weight[j].assign(rows, 1.0 / h.point.noise[j]);
    return trial;
}

// Readings come joint by joint within a step: told apart by running with the other joint unseen.
bool within(const Hypothesis &h, Trial trial, const ExperimentLimits &limits)
{
    const mk_plant_info *plant = mk_plant(h.point.model.plant);
    int joints = mk_model_joints(&h.point.model);
    std::vector<double> weight[MK_MAX_JOINTS];
    for (int j = 0; j < joints; j++)
        weight[j] = trial.weight[j];
    for (int j = 0; j < joints; j++) {
        for (int i = 0; i < joints; i++)
            trial.weight[i].assign(trial.t.size(), i == j ? 1.0 : 0.0);
        Forecast f;
        if (!forecast(h, trial, false, f))
            return false;
        for (long k = 0; k < f.y.size(); k++) {
            double v = k > 0 ? (f.y(k) - f.y(k - 1)) / limits.period : 0.0;
            bool far =
                !plant->joint_is_wheel[j] && (f.y(k) < limits.q_min[j] || f.y(k) > limits.q_max[j]);
            if (far || std::fabs(v) > limits.v_max[j])
                return false;
        }
    }
    return true;
}

// Log likelihood by which `b`, fitted again, stays behind when `a` is what the rig does.
double distance(const Hypothesis &a, const Hypothesis &b, const Trial &trial)
{
    Forecast fa, fb;
    if (!forecast(a, trial, false, fa) || !forecast(b, trial, true, fb) ||
        fa.y.size() != fb.y.size())
        return 0.0;
    Eigen::VectorXd d = fa.y - fb.y;
    // What the parameters of `b` can make good, as far as present data let them.
    Eigen::MatrixXd H =
        dense::transpose_product(fb.jacobian, fb.jacobian) + b.quadratic.information;
    Eigen::VectorXd g = dense::transpose_product(fb.jacobian, d);
    Eigen::VectorXd root = H.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    Eigen::MatrixXd unit = root.asDiagonal() * H * root.asDiagonal();
    unit.diagonal().array() += 1e-9;
    Eigen::VectorXd scaled = root.asDiagonal() * g;
    return 0.5 * (d.squaredNorm() - scaled.dot(dense::solve_symmetric(unit, scaled)));
}

} // namespace

Experiment most_telling(const Hypothesis &a, const Hypothesis &b, const ExperimentLimits &limits)
{
    Experiment best;
    for (const char *form : family)
        for (double share : shares) {
            char text[64];
            // Rounded, so that the file says what was reckoned with.
            double size = std::round(100.0 * share * limits.u_max) / 100.0;
            snprintf(text, sizeof text, "%g*%s", size, form);
            mk_signal *made = nullptr;
            if (mk_signal_create(text, &made, nullptr) != MK_OK)
                continue;
            std::unique_ptr<mk_signal, void (*)(mk_signal *)> signal(made, mk_signal_destroy);
            Trial trial = make_trial(signal.get(), a, limits);
            // Either may be the true one.
            double odds = std::min(distance(a, b, trial), distance(b, a, trial));
            if (odds > best.odds && within(a, trial, limits) && within(b, trial, limits)) {
                best.odds = odds;
                best.input = text;
                best.seconds = SECONDS;
            }
        }
    return best;
}

namespace
{

std::string place(const mk_effect_info &effect, int joint)
{
    return effect.name + (joint > 0 ? " at joint " + std::to_string(joint) : std::string());
}

ExperimentLimits limits_of(const mk_model &model, const std::vector<const FitLog *> &training)
{
    ExperimentLimits l = {};
    DataRange range = data_range(model, training);
    l.u_max = std::min(model.u_max, std::max(range.u_max, 0.3 * model.u_max));
    for (int j = 0; j < mk_model_joints(&model); j++) {
        double rest = mk_plant(model.plant)->rest[j];
        double reach = 1.3 * std::max(range.q_max[j] - rest, rest - range.q_min[j]);
        l.q_min[j] = rest - reach;
        l.q_max[j] = rest + reach;
        l.v_max[j] = 1.5 * range.v_max[j];
    }
    l.period = training[0]->period;
    return l;
}

} // namespace

void propose_experiment(const mk_model &model, const std::vector<const FitLog *> &training,
                        const Hypothesis &best, const Hypothesis *const *rival_fit, bool asked,
                        mk_explanation &out)
{
    out.next.rival = -1;
    for (int i = 0; i < out.rival_count && out.next.rival < 0; i++) {
        bool comparable =
            rival_fit[i] && rival_fit[i]->point.model.effect_count == best.point.model.effect_count;
        if (comparable && (asked || !out.rival[i].distinguishable))
            out.next.rival = i;
    }
    if (out.next.rival < 0 || out.verdict != MK_VERDICT_EFFECT) {
        if (asked)
            snprintf(out.next.why, sizeof out.next.why, "no experiment is proposed: %s",
                     out.verdict == MK_VERDICT_EFFECT
                         ? "no rival of what was named is left to tell it from"
                         : "nothing was named that explains all of the data, so that there are no "
                           "rivals to tell apart");
        out.next.rival = -1;
        return;
    }
    const mk_rival &rival = out.rival[out.next.rival];
    const mk_cause &cause = out.cause[rival.instead_of];
    Experiment e = most_telling(best, *rival_fit[out.next.rival], limits_of(model, training));
    out.next.odds = e.odds;
    std::string either =
        place(*cause.effect, cause.joint) + " or " + place(*rival.effect, rival.joint);
    if (e.odds < policy::TELLING) {
        snprintf(out.next.why, sizeof out.next.why,
                 "%s: no input within the limits of these logs is expected to tell; look at the "
                 "rig itself",
                 either.c_str());
        return;
    }
    out.next.seconds = e.seconds;
    snprintf(out.next.input, sizeof out.next.input, "%s", e.input.c_str());
    // Far apart the estimate, linear in the parameters, is no more than an order of magnitude.
    char odds[32];
    if (e.odds > 1000.0)
        snprintf(odds, sizeof odds, "more than 1000");
    else
        snprintf(odds, sizeof odds, "%.2g", e.odds);
    snprintf(out.next.why, sizeof out.next.why,
             "%s: %g s of %s from rest are expected to favour the right one by %s in log "
             "likelihood (next.cmd)",
             either.c_str(), e.seconds, e.input.c_str(), odds);
}

} // namespace mk

enum mk_status mk_explanation_write_next(const mk_explanation *e, const char *path,
                                         const char *model, mk_error *err)
{
    if (!e->next.input[0])
        return MK_OK;
    // By stream: a path may be long.
    struct mk_out_text out;
    enum mk_status st = mk_out_text_open(&out, path, err);
    if (st != MK_OK)
        return st;
    fprintf(out.stream,
            "# %s.\nmodel %s\nsetup open-loop\ninput %s\nstart\nwait %g\nexpect no-fault\nhalt\n"
            "save next.csv\nquit\n",
            e->next.why, model, e->next.input, e->next.seconds);
    return mk_out_text_save(&out, err);
}
