// Position, speed and acceleration from readings by a fixed-interval smoother.
//
// The motion is a triple integrator driven by white jerk of intensity sqrt(j) (`jerk2` = j), the
// readings have noise of variance r (`noise2`):
//     x = (q, v, a) ,   x_k = F x_(k-1) + w ,   w ~ N(0, Q) ,   y_k = q_k + e ,   e ~ N(0, r) .
// No model of the rig takes part: what comes out may be held against one. The smoothed position is
// a quintic smoothing spline (G. Wahba 1978); its bandwidth w follows from j / r (most_likely).
//
// Forwards a Kalman filter, backwards the recursion of A. Bryson and M. Frazier (1963), which
// inverts scalars only: that of Rauch, Tung and Striebel would invert P, which is nearly singular
// where the filter is sure. Noise and jerk, if not given, are those of largest likelihood of the
// filter's innovations.
#include "mechkit/signals.h"

#include <algorithm>
#include <cmath>
#include <new>
#include <vector>

#include <Eigen/Core>

#include "sim/period.hpp"

namespace
{

using Vector = Eigen::Vector3d;
using Matrix = Eigen::Matrix3d;

// Standard deviations of the state before anything was read, rad (rad/s) and rad/s^2: more than a
// wheel's speed, a light wheel's acceleration.
constexpr double START_SPEED = 300.0, START_ACCELERATION = 1e4;
// Rows of which the filtered states are kept; the others are filtered again on the way back.
constexpr size_t BLOCK = 2048;
// Rows that the likelihood looks at, in stretches spread over the data.
constexpr size_t STRETCHES = 8, STRETCH = 1024;

struct Series {
    const double *t, *q;
    size_t rows;
};

struct Law {
    double noise2; // variance of a reading
    double jerk2;  // intensity of the white jerk, squared
};

// What the filter knows at a row, after its reading.
struct Belief {
    Vector x;
    Matrix p;
};

// What it learnt there.
struct Surprise {
    double error = 0.0, variance = 0.0; // variance 0: no reading
    Vector gain = Vector::Zero();
};

//     F = (1 dt dt^2/2; 0 1 dt; 0 0 1) .
Matrix transition(double dt)
{
    Matrix f;
    f << 1.0, dt, 0.5 * dt * dt, 0.0, 1.0, dt, 0.0, 0.0, 1.0;
    return f;
}

// Covariance of what white jerk makes of the state in dt (h = dt):
//     Q = j (h^5/20 h^4/8 h^3/6; . h^3/3 h^2/2; . . h) .
Matrix growth(double dt, double jerk2)
{
    double d2 = dt * dt, d3 = d2 * dt;
    Matrix q;
    q << d3 * d2 / 20.0, d2 * d2 / 8.0, d3 / 6.0, d2 * d2 / 8.0, d3 / 3.0, d2 / 2.0, d3 / 6.0,
        d2 / 2.0, dt;
    return jerk2 * q;
}

Belief beginning(const Series &s)
{
    size_t first = 0;
    while (first + 1 < s.rows && std::isnan(s.q[first]))
        first++;
    double square = START_SPEED * START_SPEED;
    return {{s.q[first], 0.0, 0.0},
            Vector(square, square, START_ACCELERATION * START_ACCELERATION).asDiagonal()};
}

// Takes the belief at row k - 1 to row k and its reading. With H = (1 0 0),
//     x = F x ,  P = F P F' + Q ,   e = y - H x ,  s = H P H' + r ,  K = P H' / s ,  x <- x + K e .
Surprise advance(const Series &s, const Law &law, size_t k, Belief &b)
{
    if (k > 0) {
        double dt = s.t[k] - s.t[k - 1];
        Matrix f = transition(dt);
        b.x = f * b.x;
        b.p = f * b.p * f.transpose() + growth(dt, law.jerk2);
    }
    Surprise out;
    if (std::isnan(s.q[k]))
        return out;
    out.error = s.q[k] - b.x(0);
    out.variance = b.p(0, 0) + law.noise2;
    out.gain = b.p.col(0) / out.variance;
    b.x += out.gain * out.error;
    // Joseph's form, P <- (1 - K H) P (1 - K H)' + r K K': stays positive however sure the filter
    // is.
    Matrix keep = Matrix::Identity();
    keep.col(0) -= out.gain;
    b.p = keep * b.p * keep.transpose() + law.noise2 * out.gain * out.gain.transpose();
    return out;
}

// Likelihood of a law (r, j) that is known up to a common factor c of both. Innovations e_k are
// independent with variance c s_k, so that
//     log likelihood = -1/2 sum_k (log(c s_k) + e_k^2 / (c s_k)) ,
// which is largest at c = mean(e_k^2 / s_k) = factor(), where it is value() up to a constant. So
// only the ratio j / r has to be searched.
struct Likelihood {
    double square = 0.0, logs = 0.0;
    size_t count = 0;

    void add(const Series &s, const Law &law)
    {
        Belief b = beginning(s);
        size_t seen = 0;
        for (size_t k = 0; k < s.rows; k++) {
            Surprise e = advance(s, law, k, b);
            if (e.variance > 0.0 && ++seen > 3) { // the first three make the state
                square += e.error * e.error / e.variance;
                logs += std::log(e.variance);
                count++;
            }
        }
    }

    double factor() const { return count ? square / (double)count : 0.0; }
    double value() const
    {
        return -0.5 * ((double)count * std::log(std::max(factor(), 1e-300)) + logs);
    }
};

Likelihood likelihood(const Series &s, const Law &law)
{
    Likelihood l;
    if (s.rows <= STRETCHES * STRETCH) {
        l.add(s, law);
        return l;
    }
    for (size_t i = 0; i < STRETCHES; i++) {
        size_t first = (s.rows - STRETCH) / (STRETCHES - 1) * i;
        l.add({s.t + first, s.q + first, STRETCH}, law);
    }
    return l;
}

// Golden section for the ratio of jerk to noise by the bandwidth w, then the level of both. A
// smoother of this kind passes frequencies up to w with
//     j / r = w^6 dt ,
// dt the time between readings; w dt is searched between 1e-3 and 20, to 5 %. A given noise keeps
// the ratio that was found.
Law most_likely(const Series &s, const mk_smooth_options &o)
{
    double dt = mk::median_period(s.t, s.rows);
    // Bandwidth w of the smoother: jerk2 / noise2 = w^6 dt.
    auto law = [&](double bandwidth) { return Law{1.0, std::pow(bandwidth / dt, 6.0) * dt}; };
    auto value = [&](double log_bandwidth) {
        return likelihood(s, law(std::exp(log_bandwidth))).value();
    };
    const double golden = 0.6180339887498949;
    double low = std::log(1e-3), high = std::log(20.0);
    double left = high - golden * (high - low), right = low + golden * (high - low);
    double at_left = value(left), at_right = value(right);
    while (high - low > 0.05) {
        if (at_left < at_right) {
            low = left, left = right, at_left = at_right;
            right = low + golden * (high - low), at_right = value(right);
        } else {
            high = right, right = left, at_right = at_left;
            left = high - golden * (high - low), at_left = value(left);
        }
    }
    Law best = law(std::exp(0.5 * (low + high)));
    double factor = std::max(likelihood(s, best).factor(), 1e-24);
    best.noise2 *= factor;
    best.jerk2 *= factor;
    if (o.noise > 0.0)
        best = {o.noise * o.noise, best.jerk2 * o.noise * o.noise / best.noise2};
    return best;
}

struct Out {
    double *q, *v, *a, *cov;

    void row(size_t k, const Vector &x, const Matrix &p) const
    {
        q[k] = x(0);
        if (v)
            v[k] = x(1);
        if (a)
            a[k] = x(2);
        if (cov) {
            const double c[MK_SMOOTH_COV] = {p(0, 0), p(0, 1), p(0, 2), p(1, 1), p(1, 2), p(2, 2)};
            std::copy_n(c, MK_SMOOTH_COV, cov + k * MK_SMOOTH_COV);
        }
    }
};

// What later readings say about the state at a row: gradient lambda (`pull`) and curvature Lambda
// (`weight`) of their negative log likelihood by the filtered state. Bryson and Frazier's recursion
// over a row with a reading,
//     lambda <- (1 - K H)' lambda - H' e / s ,   Lambda <- (1 - K H)' Lambda (1 - K H) + H' H / s ,
// then over the time before it, lambda <- F' lambda, Lambda <- F' Lambda F. The smoothed state is
//     x - P lambda ,   with covariance   P - P Lambda P ,
// x and P those of the filter after the row's own reading.
struct Later {
    Vector pull = Vector::Zero();
    Matrix weight = Matrix::Zero();

    void back(const Surprise &e, double dt)
    {
        if (e.variance > 0.0) {
            Matrix keep = Matrix::Identity();
            keep.col(0) -= e.gain;
            pull = keep.transpose() * pull;
            weight = keep.transpose() * weight * keep;
            pull(0) -= e.error / e.variance;
            weight(0, 0) += 1.0 / e.variance;
        }
        Matrix f = transition(dt);
        pull = f.transpose() * pull;
        weight = f.transpose() * weight * f;
    }
};

// Filtered states of all rows would take 12 numbers each. They are kept at the start of each block
// only, and filtered again block by block on the way back.
void smooth(const Series &s, const Law &law, const Out &out)
{
    std::vector<Belief> starts; // before each block
    Belief b = beginning(s);
    for (size_t k = 0; k < s.rows; k++) {
        if (k % BLOCK == 0)
            starts.push_back(b);
        advance(s, law, k, b);
    }
    std::vector<Belief> belief(BLOCK);
    std::vector<Surprise> surprise(BLOCK);
    Later later;
    for (size_t block = starts.size(); block-- > 0;) {
        size_t first = block * BLOCK, last = std::min(first + BLOCK, s.rows);
        b = starts[block];
        for (size_t k = first; k < last; k++) {
            surprise[k - first] = advance(s, law, k, b);
            belief[k - first] = b;
        }
        for (size_t k = last; k-- > first;) {
            const Belief &at = belief[k - first];
            out.row(k, at.x - at.p * later.pull, at.p - at.p * later.weight * at.p);
            if (k > 0)
                later.back(surprise[k - first], s.t[k] - s.t[k - 1]);
        }
    }
}

} // namespace

enum mk_status mk_smooth(const double *t, const double *q, size_t rows,
                         const mk_smooth_options *options, double *q_out, double *v, double *a,
                         double *cov, mk_smooth_figures *found)
try {
    mk_smooth_options o = options ? *options : mk_smooth_options{};
    size_t readings = 0;
    for (size_t k = 0; k < rows; k++) {
        readings += !std::isnan(q[k]);
        if (k > 0 && !(t[k] > t[k - 1]))
            return MK_ERR_RANGE;
    }
    if (readings < 5)
        return MK_ERR_RANGE;
    std::vector<double> copy; // readings that the results would overwrite
    if (q_out == q)
        copy.assign(q, q + rows);
    Series s = {t, copy.empty() ? q : copy.data(), rows};
    Law law = o.noise > 0.0 && o.jerk > 0.0 ? Law{o.noise * o.noise, 0.0} : most_likely(s, o);
    if (o.jerk > 0.0)
        law.jerk2 = o.jerk * o.jerk;
    if (o.roughness > 0.0)
        law.jerk2 *= o.roughness * o.roughness;
    smooth(s, law, {q_out, v, a, cov});
    if (found)
        *found = {std::sqrt(law.noise2), std::sqrt(law.jerk2), readings};
    return MK_OK;
} catch (const std::bad_alloc &) {
    return MK_ERR_NOMEM;
}
