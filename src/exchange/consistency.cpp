#include "exchange/consistency.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/dense.hpp"
#include "model/scalar.hpp"

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace mk
{
namespace
{

constexpr double HALF_WINDOW = 0.08; // s of readings on either side that give an acceleration
constexpr size_t MOST_POINTS = 800;
constexpr double BEYOND_DOUBT = 4.0; // standard errors

struct Point {
    double q[2] = {0, 0}, v[2] = {0, 0}, a[2] = {0, 0}, u[2] = {0, 0};
};

struct Columns {
    const double *t, *q[2], *u[2];
    size_t rows;
};

Columns columns_of(const mk_log &log)
{
    Columns c = {mk_log_get(&log, "t"),
                 {mk_log_get(&log, mk_log_angle(0)), mk_log_get(&log, mk_log_angle(1))},
                 {},
                 log.rows};
    static const char *const names[][2] = {{"u1", "u2"}, {"tau1", "tau2"}, {"u", ""}, {"tau", ""}};
    for (const auto &pair : names)
        if (!c.u[0] && mk_log_get(&log, pair[0])) {
            c.u[0] = mk_log_get(&log, pair[0]);
            c.u[1] = mk_log_get(&log, pair[1]);
        }
    return c;
}

// A weight over the readings within `half` of t0, (1 - s^2)^5, and its first two derivatives.
// Applied to both sides of an equation of motion it needs no derivative of a reading: value, speed
// and acceleration of the same smoothed motion.
struct Window {
    size_t first, last; // rows [first, last)
    double t0, half;
};

// Value, slope and curvature of column y seen through the window; false where a reading is missing.
bool look(const double *t, const double *y, const Window &w, double *out)
{
    double sum[3] = {0, 0, 0}, area = 0.0, base = y[(w.first + w.last) / 2];
    for (size_t r = w.first; r < w.last; r++) {
        double s = (t[r] - w.t0) / w.half, c = 1.0 - s * s;
        double width = 0.5 * (t[r + 1] - t[r - 1]), c3 = c * c * c;
        double weight = c3 * c * c, first = -10.0 * s * c3 * c, second = c3 * (90.0 * s * s - 10.0);
        if (!std::isfinite(y[r]))
            return false;
        area += width * weight;
        sum[0] += width * weight * (y[r] - base);
        sum[1] -= width * first * (y[r] - base);
        sum[2] += width * second * (y[r] - base);
    }
    out[0] = base + sum[0] / area;
    out[1] = sum[1] / (area * w.half);
    out[2] = sum[2] / (area * w.half * w.half);
    return w.last - w.first >= 7 && std::isfinite(out[2]);
}

std::vector<Point> points_of(const Columns &c, int joints)
{
    std::vector<Point> points;
    double span = c.t[c.rows - 1] - c.t[0], dt = span / static_cast<double>(c.rows - 1);
    double half = std::max(HALF_WINDOW, 5.0 * dt);
    size_t stride = std::max<size_t>(1, c.rows / MOST_POINTS), first = 0, last = 0;
    for (size_t r = 0; r < c.rows; r += stride) {
        while (first < r && c.t[first] < c.t[r] - half)
            first++;
        while (last < c.rows && c.t[last] <= c.t[r] + half)
            last++;
        if (c.t[r] - half < c.t[0] || c.t[r] + half > c.t[c.rows - 1])
            continue;
        Point p;
        double f[3];
        bool good = first > 0 && last < c.rows;
        const Window w = {first, last, c.t[r], half};
        for (int j = 0; j < joints && good; j++) {
            good = look(c.t, c.q[j], w, f);
            p.q[j] = f[0], p.v[j] = f[1], p.a[j] = f[2];
        }
        for (int i = 0; i < 2 && good; i++)
            if (c.u[i]) {
                good = look(c.t, c.u[i], w, f);
                p.u[i] = f[0];
            }
        if (good)
            points.push_back(p);
    }
    return points;
}

// The textbook plant, with friction of its own at a joint that no motor of the plant drives.
class Fit
{
  public:
    Fit(const mk_model &rig, const std::vector<Point> &points) : points_(points), model_(rig)
    {
        plant_ = mk_plant(rig.plant);
        n_ = plant_->joints;
        np_ = plant_->parameter_count;
        extra_ = n_ == 2 ? 2 : 0;
        undriven_ = std::all_of(points.begin(), points.end(), [](const Point &p) {
            return std::fabs(p.u[0]) + std::fabs(p.u[1]) == 0.0;
        });
    }
    bool solve(double span);
    // After solve(): the same with no mass, stiffness or friction below zero, as a rig can be at
    // best.
    void solve_physical();
    double acceleration_error() const;
    // A parameter that must be positive and is negative beyond doubt.
    int wrong_sign() const;

  private:
    const std::vector<Point> &points_;
    mk_model model_;
    const mk_plant_info *plant_;
    int n_, np_, extra_;
    VectorXd p_, deviation_, right_;
    MatrixXd gram_;
    // Nothing drives the rig: both sides of its equations may be multiplied by anything. The first
    // parameter, an inertia on every plant, is then 1, and the others are counted in it.
    bool undriven_ = false;

    int passive() const { return 1 - plant_->motor_joint; }
    double passive_sign(const Point &p) const
    {
        return smooth_sign(mk_model_sharpness(&model_, passive()), p.v[passive()]);
    }
    void rows(const Point &p, double phi[2][MK_MAX_PARAMETERS + 2], double tau[2]) const;
};

void Fit::rows(const Point &p, double phi[2][MK_MAX_PARAMETERS + 2], double tau[2]) const
{
    double flat[2 * MK_MAX_PARAMETERS];
    mk_plant_regressor(&model_, p.q, p.v, p.a, flat);
    for (int j = 0; j < n_; j++) {
        std::memset(phi[j], 0, sizeof phi[j]);
        std::copy(flat + j * np_, flat + (j + 1) * np_, phi[j]);
        tau[j] = j == plant_->motor_joint ? p.u[0] : p.u[1];
    }
    if (n_ == 2) {
        phi[passive()][np_] = p.v[passive()];
        phi[passive()][np_ + 1] = passive_sign(p);
    }
    if (plant_->motor_joint == 1)
        tau[0] = 0.0;
    for (int j = 0; j < n_ && undriven_; j++) {
        tau[j] -= phi[j][0];
        phi[j][0] = 0.0;
    }
}

MatrixXd scaled(const MatrixXd &a, const VectorXd &scale)
{
    return scale.asDiagonal() * a * scale.asDiagonal();
}

bool Fit::solve(double span)
{
    const int unknowns = np_ + extra_;
    gram_ = MatrixXd::Zero(unknowns, unknowns);
    right_ = VectorXd::Zero(unknowns);
    MatrixXd &gram = gram_;
    VectorXd &right = right_;
    double squares = 0.0;
    for (const Point &p : points_) {
        double row[2][MK_MAX_PARAMETERS + 2], tau[2];
        rows(p, row, tau);
        for (int j = 0; j < n_; j++) {
            Eigen::Map<VectorXd> phi(row[j], unknowns);
            gram += phi * phi.transpose();
            right += phi * tau[j];
            squares += tau[j] * tau[j];
        }
    }
    VectorXd scale = gram.diagonal().cwiseSqrt();
    for (double &x : scale)
        x = x > 0.0 && std::isfinite(x) ? 1.0 / x : 1.0;
    VectorXd values;
    MatrixXd vectors;
    dense::eigen(scaled(gram, scale), values, vectors);
    // Directions that the motion says nothing about stay at zero, their deviation at a large
    // number.
    VectorXd inverse = values, variance = values;
    for (int i = 0; i < unknowns; i++) {
        bool seen = values[i] > 1e-10 * values[unknowns - 1];
        inverse[i] = seen ? 1.0 / values[i] : 0.0;
        variance[i] = seen ? 1.0 / values[i] : 1e10 / values[unknowns - 1];
    }
    const MatrixXd axes = scale.asDiagonal() * vectors;
    p_ =
        dense::product(axes, VectorXd(inverse.cwiseProduct(dense::transpose_product(axes, right))));
    if (!p_.allFinite())
        return false;
    if (undriven_)
        p_[0] = 1.0;
    // Neighbouring points share their readings: as many of them count as windows fit in.
    double windows = std::max(1.0, span / (2.0 * HALF_WINDOW));
    double independent = std::min(windows, static_cast<double>(points_.size())) * n_;
    double rest = std::max(0.0, squares - 2.0 * p_.dot(right) + p_.dot(dense::product(gram, p_)));
    double share = independent / (static_cast<double>(points_.size()) * n_);
    double noise = rest * share / std::max(1.0, independent - unknowns);
    deviation_ = ((axes * variance.asDiagonal()).cwiseProduct(axes).rowwise().sum() * noise / share)
                     .cwiseSqrt();
    return true;
}

// The unconstrained optimum of the unknowns that are off zero, or as far towards it as the first of
// them comes back to zero; true when none does.
bool step_towards(const MatrixXd &h, const VectorXd &b, std::vector<bool> &off_zero, VectorXd &x)
{
    std::vector<long> in;
    for (size_t i = 0; i < off_zero.size(); i++)
        if (off_zero[i])
            in.push_back(static_cast<long>(i));
    const long count = static_cast<long>(in.size());
    MatrixXd h_in(count, count);
    VectorXd b_in(count);
    for (long i = 0; i < count; i++) {
        b_in(i) = b(in[i]);
        for (long k = 0; k < count; k++)
            h_in(i, k) = h(in[i], in[k]);
    }
    const VectorXd optimum = dense::shortest_solution(h_in, b_in);
    double reach = 1.0;
    long first = -1;
    for (size_t k = 0; k < in.size(); k++) {
        const double now = x(in[k]), then = optimum(static_cast<long>(k));
        if (then <= 0.0 && (first < 0 || now / (now - then) < reach)) {
            reach = now > 0.0 ? now / (now - then) : 0.0;
            first = in[k];
        }
    }
    for (size_t k = 0; k < in.size(); k++)
        x(in[k]) += reach * (optimum(static_cast<long>(k)) - x(in[k]));
    if (first < 0)
        return true;
    x(first) = 0.0;
    off_zero[static_cast<size_t>(first)] = false;
    return false;
}

// Least squares with no unknown below zero (Lawson and Hanson 1974, ch. 23): unknowns are let off
// zero one after another, the one first that improves the fit most, and put back where they would
// go below. What is no sum of masses is friction, which is not negative either.
void Fit::solve_physical()
{
    constexpr double NEGLIGIBLE = 1e-9; // of the scaled gradient
    const long n = right_.size();
    VectorXd scale = gram_.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    const MatrixXd h = scaled(gram_, scale);
    const VectorXd b = scale.cwiseProduct(right_);
    VectorXd x = VectorXd::Zero(n);
    std::vector<bool> off_zero(static_cast<size_t>(n), false);
    for (long step = 0; step < 10 * n; step++) {
        VectorXd slope = b - dense::product(h, x);
        long best = -1;
        for (long i = 0; i < n; i++)
            if (!off_zero[static_cast<size_t>(i)] &&
                slope(i) > NEGLIGIBLE * b.cwiseAbs().maxCoeff() &&
                (best < 0 || slope(i) > slope(best)))
                best = i;
        if (best < 0)
            break;
        off_zero[static_cast<size_t>(best)] = true;
        while (!step_towards(h, b, off_zero, x)) {
        }
    }
    p_ = scale.cwiseProduct(x);
    if (undriven_)
        p_[0] = 1.0;
}

int Fit::wrong_sign() const
{
    int worst = -1;
    double most = BEYOND_DOUBT;
    for (int i = 0; i < np_; i++) {
        double doubt = -p_[i] / deviation_[i];
        // With angles as in docs/formats.md they are sums of masses, lengths, inertias.
        if (i < plant_->mass_count && doubt > most) {
            most = doubt;
            worst = i;
        }
    }
    return worst;
}

// Mean of what is left when the largest tenth is out: where the fitted mass matrix is all but
// singular, single accelerations go anywhere.
double trimmed_mean(std::vector<double> &values)
{
    size_t keep = values.size() - values.size() / 10;
    std::nth_element(values.begin(), values.begin() + static_cast<long>(keep) - 1, values.end());
    double sum = 0.0;
    for (size_t i = 0; i < keep; i++)
        sum += values[i];
    return sum / static_cast<double>(keep);
}

double Fit::acceleration_error() const
{
    mk_model m = model_;
    std::copy(p_.data(), p_.data() + np_, m.parameter);
    std::vector<double> error[2], motion[2];
    for (const Point &p : points_) {
        double tau[2] = {p.u[0], p.u[1]}, a[2];
        if (plant_->motor_joint == 1)
            tau[0] = 0.0, tau[1] = p.u[0];
        if (n_ == 2)
            tau[passive()] -= p_[np_] * p.v[passive()] + p_[np_ + 1] * passive_sign(p);
        mk_plant_acceleration(&m, p.q, p.v, tau, a);
        for (int j = 0; j < n_; j++) {
            double e = (a[j] - p.a[j]) * (a[j] - p.a[j]);
            error[j].push_back(std::isfinite(e) ? e : HUGE_VAL);
            motion[j].push_back(p.a[j] * p.a[j]);
        }
    }
    double total = 0.0;
    for (int j = 0; j < n_; j++) {
        double e = trimmed_mean(error[j]) / trimmed_mean(motion[j]);
        total += e < 2.0 ? e : 2.0; // NaN counts as the worst
    }
    return total / n_;
}

// Counts per revolution that the steps of a column speak of: the smallest step that readings make.
// 0: they are not in steps.
double counts_of(const double *y, size_t rows)
{
    std::vector<double> steps;
    for (size_t r = 1; r < rows; r++) {
        double step = std::fabs(y[r] - y[r - 1]);
        if (step > 1e-9)
            steps.push_back(step);
    }
    if (steps.size() < 20)
        return 0.0;
    // Rounded text blurs the steps: a low quantile is the step if many are within a tenth of it.
    std::sort(steps.begin(), steps.end());
    double step = steps[steps.size() / 50];
    size_t like_it = 0;
    for (double s : steps)
        like_it += std::fabs(s - step) < 0.1 * step;
    if (like_it * 50 <= steps.size())
        return 0.0;
    // A wheel that turns evenly also makes steps of one size. Where they are counts, steps of
    // different numbers of them follow each other.
    size_t changes = 0;
    for (size_t r = 2; r < rows; r++)
        changes += std::fabs(y[r] - 2.0 * y[r - 1] + y[r - 2]) > 0.5 * step;
    return changes * 10 > steps.size() ? 2.0 * M_PI / step : 0.0;
}

// Encoders have from 100 to 100000 counts. A linear scale may have any.
bool counts_can_be(const Columns &c, const mk_model &rig)
{
    for (int j = 0; j < mk_model_joints(&rig); j++) {
        if (rig.joint_linear[j])
            continue;
        double counts = counts_of(c.q[j], c.rows);
        if (counts != 0.0 && (counts < 100.0 || counts > 1e5))
            return false;
    }
    return true;
}

// Rows of the first tenth of a second.
size_t first_rows(const Columns &c)
{
    size_t rows = 0;
    while (rows < c.rows && c.t[rows] - c.t[0] < 0.1)
        rows++;
    return rows;
}

// Whether a command acts in the first rows: over a twentieth of the largest.
bool is_driven(const Columns &c, size_t first)
{
    double most = 0.0;
    for (size_t r = 0; c.u[0] && r < c.rows; r++)
        if (std::isfinite(c.u[0][r]))
            most = std::max(most, std::fabs(c.u[0][r]));
    for (size_t r = 0; c.u[0] && r < first; r++)
        if (std::isfinite(c.u[0][r]) && std::fabs(c.u[0][r]) > 0.05 * most)
            return true;
    return false;
}

// Standing still for the first tenth of a second without a command, a rig hangs.
bool hangs(const Columns &c, const mk_model &rig)
{
    const mk_plant_info *plant = mk_plant(rig.plant);
    const size_t rows = first_rows(c);
    if (rows <= 3 || is_driven(c, rows))
        return true;
    for (int j = 0; j < plant->joints; j++) {
        double low = HUGE_VAL, high = -HUGE_VAL;
        for (size_t r = 0; r < rows; r++) {
            low = std::fmin(low, c.q[j][r]);
            high = std::fmax(high, c.q[j][r]);
        }
        bool level = plant->joint_is_wheel[j] || rig.joint_linear[j] || plant->joint_is_level[j];
        double off = std::remainder(0.5 * (low + high) - plant->rest[j], 2.0 * M_PI);
        if (high - low < 0.02 && !level && std::fabs(off) > 0.5)
            return false;
    }
    return true;
}

} // namespace

namespace
{

// How a speed that came along goes with the slope of its angle.
struct SlopeMatch {
    bool known = false;
    double correlation = 0.0, size = 0.0; // size: of the speed over that of the slope
};

SlopeMatch match_slope(const mk_log &log, int joint)
{
    SlopeMatch m;
    const double *t = mk_log_get(&log, "t"), *q = mk_log_get(&log, mk_log_angle(joint));
    const double *v = mk_log_get(&log, mk_log_speed(joint));
    if (!t || !q || !v)
        return m;
    // Slopes over a hundredth of a second: over one sample they are counts.
    size_t step = static_cast<size_t>(0.005 / std::max(1e-6, sample_time(log))) + 1;
    double vv = 0.0, vs = 0.0, ss = 0.0;
    for (size_t r = step; r + step < log.rows; r++) {
        double slope = (q[r + step] - q[r - step]) / (t[r + step] - t[r - step]);
        if (!std::isfinite(slope) || !std::isfinite(v[r]))
            continue;
        vv += v[r] * v[r], vs += v[r] * slope, ss += slope * slope;
    }
    m.known = vv > 0.0 && ss > 0.0;
    if (m.known) {
        m.correlation = vs / std::sqrt(vv * ss);
        m.size = std::sqrt(vv / ss);
    }
    return m;
}

} // namespace

bool speed_is_against(const mk_log &log, int joint)
{
    SlopeMatch m = match_slope(log, joint);
    return m.known && m.correlation < -0.5;
}

bool speed_is_astray(const mk_log &log, int joint)
{
    SlopeMatch m = match_slope(log, joint);
    return m.known && !(m.correlation > 0.8 && m.size > 0.7 && m.size < 1.4);
}

double sample_time(const mk_log &log)
{
    const double *t = mk_log_get(&log, "t");
    std::vector<double> dt;
    for (size_t r = 1; r < log.rows; r++)
        dt.push_back(t[r] - t[r - 1]);
    if (dt.empty())
        return 0.0;
    std::nth_element(dt.begin(), dt.begin() + static_cast<long>(dt.size() / 2), dt.end());
    return dt[dt.size() / 2];
}

Consistency consistency(const mk_log &log, const mk_model &rig)
{
    Consistency out;
    const mk_plant_info *plant = mk_plant(rig.plant);
    Columns c = columns_of(log);
    for (int j = 0; j < plant->joints; j++)
        if (!c.q[j])
            return out;
    const char *input = mk_log_find_meta(&log, "input");
    if (!c.t || (!c.u[0] && !(input && std::strcmp(input, "none") == 0)) || c.rows < 50)
        return out;
    out.hangs = hangs(c, rig);
    out.astray = speed_is_astray(log, 0) + speed_is_astray(log, 1);
    out.counts = counts_can_be(c, rig);
    std::vector<Point> points = points_of(c, plant->joints);
    Fit fit(rig, points);
    if (points.size() < 60 || !fit.solve(c.t[c.rows - 1] - c.t[0]))
        return out;
    out.known = true;
    out.free_error = fit.acceleration_error();
    out.wrong_sign = fit.wrong_sign();
    fit.solve_physical();
    out.error = fit.acceleration_error();
    return out;
}

} // namespace mk
