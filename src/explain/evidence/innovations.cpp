// One-step predictions of an extended Kalman filter, and tests of whether their errors are white.
//
// With state x, covariance P and the reading of joint j at row k, y = h(x) + noise N(0, sigma_j^2):
//     e = y - h(x^-) ,   s = H P H' + sigma_j^2 ,   H = dh/dx ,
//     x = x^- + P H' e / s ,   P <- P - P H' H P / s                    update ,
//     x^-(t_(k+1)) = F(x) ,    P <- F_x P F_x' + Q (t_(k+1) - t_k)      prediction .
// Readings are taken in one at a time. F is the trajectory over one sample and F_x its derivative,
// both by the shooting kernel. For a right model the innovations e / sqrt(s) are independent and of
// variance 1 (L. Ljung, System Identification, 1999, 16.6; A. Jazwinski, Stochastic Processes and
// Filtering Theory, 1970). Three things are asked of them: their rms, their autocorrelation (Ljung,
// Box 1978), and their correlation with what a missing law would depend on (Fisher's z, samples
// counted after Bartlett).
//
// The filter takes start state, noise sigma_j and process noise from the fit (ident/fit.hpp).
// Parameters are as they were fitted; that they took something of the data for themselves is left
// out.
#include "explain/evidence/innovations.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <iterator>

#include "base/dense.hpp"
#include "explain/evidence/statistics.hpp"

namespace mk
{

namespace
{

using Eigen::MatrixXd;
using Eigen::VectorXd;

// Longest integration step, s.
constexpr double STEP = 2.5e-3;
// Time until the filter has forgotten its start, s: innovations before it are not judged.
constexpr double SETTLING = 0.5;
// Standard deviation of the speeds at the start, rad/s (times the joint's scale).
constexpr double START_SPEED = 0.3;
// Process-noise intensity of effects' states, per sqrt(s).
constexpr double HIDDEN = 1e-3;
// Least motion from one sample to the next, counts, for a reading to be judged.
constexpr double CREEP = 0.3;
// Autocorrelations tested.
constexpr int LAGS = 20;

// One joint's innovations e / sqrt(s), and beside each what it is held against.
struct Series {
    std::vector<double> error;
    std::vector<std::vector<double>> with; // as `regressors`
    double squares = 0.0;
};

// What an innovation may go with: by name in the report.
struct Regressor {
    const char *name;
    int joint; // of q, v; -1: none
    double (*value)(double q, double v, double u, double t);
};
const Regressor regressors[] = {
    {"q1", 0, [](double q, double, double, double) { return q; }},
    {"dq1", 0, [](double, double v, double, double) { return v; }},
    {"sign(dq1)", 0, [](double, double v, double, double) { return v > 0.0 ? 1.0 : -1.0; }},
    {"q2", 1, [](double q, double, double, double) { return q; }},
    {"dq2", 1, [](double, double v, double, double) { return v; }},
    {"sign(dq2)", 1, [](double, double v, double, double) { return v > 0.0 ? 1.0 : -1.0; }},
    {"u", -1, [](double, double, double u, double) { return u; }},
    {"t", -1, [](double, double, double, double t) { return t; }},
};

static_assert(MK_MAX_JOINTS * (1 + std::size(regressors)) <= MK_MAX_RESIDUAL_TESTS);

// The filter over one log. `noise` is sigma_j by joint, rad; `process_noise` the intensity of the
// speeds, rad/s per sqrt(s). The kernel's weights are 1 for a reading and 0 for a missing one, so
// that its residuals are y - h(x) in rad. A log's own values are in its model.
class Filter
{
  public:
    Filter(const FitLog &log_in, const Hypothesis &h, const double *noise_in,
           double process_noise_in)
        : log(log_in), model(model_of_source(h.point, log_in.source)), noise(noise_in),
          process_noise(process_noise_in), joints(mk_model_joints(&model)),
          ns(mk_model_state_count(&model))
    {
        data = {};
        data.rows = log.rows();
        data.start = log.start;
        data.t = log.t.data();
        for (int i = 0; i < MK_MAX_INPUTS; i++)
            data.u[i] = log.u[i].empty() ? nullptr : log.u[i].data();
        for (int j = 0; j < joints; j++) {
            unit[j].assign(log.rows(), 1.0);
            for (size_t k = 0; k < log.rows(); k++)
                if (std::isnan(log.q[j][k]))
                    unit[j][k] = 0.0;
            data.q[j] = log.q[j].data();
            data.w[j] = unit[j].data();
            moved[j] = -HUGE_VAL;
        }
    }

    // Over all rows of the log. P at the start is diagonal: angles are known to the noise of a
    // reading, speeds to START_SPEED, effects' states to 0.05. False when the model runs away.
    bool run(const VectorXd &start, Series *series)
    {
        VectorXd x = start;
        MatrixXd P = MatrixXd::Zero(ns, ns);
        for (int s = 0; s < ns; s++)
            P(s, s) = std::pow(s < joints       ? noise[s]
                               : s < 2 * joints ? START_SPEED * size_of(s)
                                                : 0.05,
                               2);
        for (size_t k = 0; k + 1 < log.rows(); k++)
            if (!step(k, x, P, series))
                return false;
        return true;
    }

  private:
    const FitLog &log;
    const mk_model model;
    const double *noise;
    double process_noise;
    int joints, ns;
    ShootData data;
    std::vector<double> unit[MK_MAX_JOINTS];
    double moved[MK_MAX_JOINTS];

    double size_of(int state) const { return mk_model_joint_scale(&model, state % joints); }

    // From the prediction at row k: update by the row's readings, then prediction of row k + 1. P
    // is ns x ns, F dx(t_(k+1)) / dx(t_k), H one row a reading. False where the model runs away.
    bool step(size_t k, VectorXd &x, MatrixXd &P, Series *series)
    {
        using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
        VectorXd x_end(ns), residual(2);
        RowMajor F(ns, ns), H(2, ns);
        int joint_of[2];
        ShootTask task = {};
        task.model = &model;
        task.data = &data;
        task.begin = log.t[k];
        task.end = log.t[k + 1];
        task.x = x.data();
        task.step = STEP;
        task.columns = ns;
        task.x_end = x_end.data();
        task.jac_end = F.data();
        task.row_capacity = 2;
        task.residual = residual.data();
        task.jac = H.data();
        task.joint_of = joint_of;
        shoot(task);
        if (!task.finite || !x_end.allFinite())
            return false;
        // The kernel gives residual y - h(x) and H about the state x before any of the row's
        // readings. The joints' readings are taken in one after the other, with scalar divisions
        // only: after the first, x has moved by `correction`, and the second one's innovation is
        //     e = y - h(x) - H correction   (to first order) .
        VectorXd correction = VectorXd::Zero(ns);
        for (size_t r = 0; r < task.row_count; r++) {
            const int j = joint_of[r];
            VectorXd h = H.row((long)r).transpose();
            VectorXd ph = dense::product(P, h);
            // Rounding may leave a little less than nothing of what is known well.
            double s = std::max(h.dot(ph), 0.0) + noise[j] * noise[j];
            double e = residual((long)r) - h.dot(correction);
            note(k, j, x + correction, e / std::sqrt(s), series);
            correction += ph * (e / s);
            P -= ph * ph.transpose() / s;
        }
        // The trajectory started from the uncorrected x; its end moves with the correction to first
        // order.
        x = x_end + F * correction;
        // Symmetric but for rounding, which would grow.
        const MatrixXd carried = dense::product_transpose(dense::product(F, P), F);
        P = 0.5 * (carried + carried.transpose());
        // Q: white accelerations of intensity `process_noise` (times the joint's scale), and HIDDEN
        // for effects' states. Angles get none: they follow from the speeds.
        const double span = log.t[k + 1] - log.t[k];
        for (int s = joints; s < ns; s++)
            P(s, s) +=
                (s < 2 * joints ? std::pow(process_noise * size_of(s), 2) : HIDDEN * HIDDEN) * span;
        return x.allFinite();
    }
    // Takes an innovation into the series, if it may count as a sample of its own. Readings that
    // stay on their count repeat their rounding error; where they creep from one count to the next
    // it is the same each time. So the speed must carry the joint over CREEP counts a sample, and
    // over one count since the last innovation taken.
    void note(size_t k, int j, const VectorXd &x, double error, Series *series)
    {
        const double t = log.t[k];
        const double speed = std::fabs(x(joints + j));
        if (t < SETTLING || speed * log.period < CREEP * log.count[j] ||
            speed * (t - moved[j]) < log.count[j])
            return;
        moved[j] = t;
        series[j].error.push_back(error);
        series[j].squares += error * error;
        size_t i = 0;
        series[j].with.resize(std::size(regressors));
        for (const Regressor &r : regressors) {
            double q = r.joint >= 0 && r.joint < joints ? x(r.joint) : 0.0,
                   v = r.joint >= 0 && r.joint < joints ? x(joints + r.joint) : 0.0;
            series[j].with[i++].push_back(r.value(q, v, log.u[0][k], log.start + t));
        }
    }
};

// x <- (x - mean) / standard deviation; nothing where all values are the same.
void standardise(std::vector<double> &x)
{
    double mean = 0.0, square = 0.0;
    for (double v : x)
        mean += v / (double)x.size();
    for (double &v : x)
        v -= mean, square += v * v / (double)x.size();
    for (double &v : x)
        v = square > 0.0 ? v / std::sqrt(square) : 0.0;
}

// r(lag) = 1/n sum_k a_k b_(k - lag), of standardised series.
double correlation(const std::vector<double> &a, const std::vector<double> &b, size_t lag)
{
    double sum = 0.0;
    for (size_t k = lag; k < a.size(); k++)
        sum += a[k] * b[k - lag];
    return sum / (double)a.size();
}

// Ljung, Box 1978: of a white series of n values
//     n (n + 2) sum_(lag = 1)^LAGS r(lag)^2 / (n - lag)
// is chi-square with LAGS degrees of freedom. Returns the rms of the autocorrelations; p is the
// probability of such a sum or a larger one by chance.
double whiteness(const std::vector<double> &e, double &p)
{
    double n = (double)e.size(), sum = 0.0, squares = 0.0;
    for (int lag = 1; lag <= LAGS; lag++) {
        double r = correlation(e, e, (size_t)lag);
        sum += r * r / (n - lag);
        squares += r * r;
    }
    p = chi2_tail(n * (n + 2.0) * sum, LAGS);
    return std::sqrt(squares / LAGS);
}

// Fisher's z: with r the correlation of n independent pairs, atanh(r) sqrt(n - 3) is standard
// normal where there is none. Both series hang together from sample to sample, so that n pairs are
// worth (Bartlett)
//     n / (1 + 2 sum_lag r_e(lag) r_x(lag)) ,
// lags up to 100 or a quarter of the series; never more than n. |r| = 1 is kept out of atanh.
double dependence(const std::vector<double> &e, const std::vector<double> &x, double &p)
{
    double n = (double)e.size(), overlap = 1.0;
    for (size_t lag = 1; lag <= std::min<size_t>(100, e.size() / 4); lag++)
        overlap += 2.0 * correlation(e, e, lag) * correlation(x, x, lag);
    double r = correlation(e, x, 0), samples = n / std::max(overlap, 1.0);
    p = normal_tails(std::atanh(std::min(std::max(r, -0.999999), 0.999999)) *
                     std::sqrt(std::max(samples - 3.0, 1.0)));
    return r;
}

// Innovations of all logs in one series a joint. Parameters and start states are those of h; noise
// and process noise those of `best`.
bool errors_of(const std::vector<const FitLog *> &training, const Hypothesis &h,
               const Hypothesis &best, Series *series)
{
    for (size_t l = 0; l < training.size(); l++) {
        Filter filter(*training[l], h, best.point.noise, best.process_noise);
        if (!filter.run(h.point.nodes[l].x.col(0), series))
            return false;
    }
    return true;
}

struct Test {
    const char *with;
    double figure, p;
};

// Whiteness first, then each regressor that the rig has. Empty where fewer than FEW innovations
// count: the joint moved too little to judge by.
// Standardises the series in place; Series::squares, from which the rms comes, stays.
std::vector<Test> tests_of(Series &s, int joints)
{
    constexpr size_t FEW = 100;
    std::vector<Test> all;
    if (s.error.size() < FEW)
        return all;
    double p;
    standardise(s.error);
    const double autocorrelation = whiteness(s.error, p);
    all.push_back({"itself", autocorrelation, p});
    for (size_t i = 0; i < std::size(regressors); i++) {
        if (regressors[i].joint >= joints)
            continue;
        standardise(s.with[i]);
        const double r = dependence(s.error, s.with[i], p);
        all.push_back({regressors[i].name, r, p});
    }
    return all;
}

} // namespace

bool leaves_white_noise(const std::vector<const FitLog *> &training, const Hypothesis &h)
{
    Series series[MK_MAX_JOINTS];
    if (mk_model_hides_joint(&h.point.model) || !errors_of(training, h, h, series))
        return false;
    // Of n tests the least p is below 0.01 / n by chance in 1 % of cases at most (Bonferroni).
    const int joints = mk_model_joints(&h.point.model);
    double least = 1.0;
    size_t count = 0;
    for (int j = 0; j < joints; j++) {
        const std::vector<Test> tests = tests_of(series[j], joints);
        if (tests.empty())
            return false;
        count += tests.size();
        for (const Test &t : tests)
            least = std::min(least, t.p);
    }
    return least * (double)count > 0.01;
}

void test_innovations(const std::vector<const FitLog *> &training, const Hypothesis &refit,
                      const Hypothesis &best, mk_explanation &out)
{
    // Both models with the process noise and reading noise of the better one, so that errors
    // compare. A model that hides a joint from its readings has no innovations that could be white.
    out.residual_test_count = 0;
    if (mk_model_hides_joint(&best.point.model))
        return;
    Series before[MK_MAX_JOINTS], after[MK_MAX_JOINTS];
    if (!errors_of(training, refit, best, before) || !errors_of(training, best, best, after))
        return;
    const int joints = mk_model_joints(&best.point.model);
    for (int j = 0; j < joints; j++) {
        const std::vector<Test> refitted = tests_of(before[j], joints),
                                extended = tests_of(after[j], joints);
        if (refitted.empty() || extended.empty())
            continue;
        out.one_step_refit[j] = std::sqrt(before[j].squares / (double)before[j].error.size());
        out.one_step_extended[j] = std::sqrt(after[j].squares / (double)after[j].error.size());
        for (size_t i = 0; i < refitted.size(); i++)
            out.residual_test[out.residual_test_count++] = {
                j + 1,         refitted[i].with, refitted[i].figure, extended[i].figure,
                refitted[i].p, extended[i].p};
    }
}

} // namespace mk
