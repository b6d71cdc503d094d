#include "ctrl/swingup_solve.hpp"

#include <algorithm>
#include <cmath>

#include "model/dual.hpp"
#include "model/rhs.hpp"

namespace mk::swing
{
namespace
{

constexpr int N = MK_CTRL_STATES;

using Derived = Dual<N + 1>; // with derivatives by x and u

// dx/dt of the textbook plant over a scalar S: D a + h = tau (docs/theory.md), the motor's friction
// at its joint as everywhere.
template <class S>
void slope(const Dynamics &d, const S *parameter, const S *x, const S &u, S *dx)
{
    const int np = mk_plant(d.model.plant)->parameter_count;
    Motion<S> m = motion_of(2, x, x + 2);
    Assembler<S> sum(parameter);
    with_plant(d.model.plant, [&](auto law) { law.law(m, d.model.g, sum); });
    S tau[2] = {S(0.0), S(0.0)};
    tau[d.motor] = u - parameter[np - 2] * m.v[d.motor] -
                   parameter[np - 1] * smooth_sign(d.model.friction_sharpness, m.v[d.motor]);
    dx[0] = x[2], dx[1] = x[3];
    solve_joints(2, sum.m11, sum.m12, sum.m22, tau[0] - sum.f1, tau[1] - sum.f2, dx + 2);
}

// x after h seconds: one step of the classical Runge-Kutta method.
template <class S>
void runge_kutta(const Dynamics &d, const S *parameter, S *x, const S &u, double h)
{
    S k1[N], k2[N], k3[N], k4[N], y[N];
    slope(d, parameter, x, u, k1);
    for (int i = 0; i < N; i++)
        y[i] = x[i] + k1[i] * (0.5 * h);
    slope(d, parameter, y, u, k2);
    for (int i = 0; i < N; i++)
        y[i] = x[i] + k2[i] * (0.5 * h);
    slope(d, parameter, y, u, k3);
    for (int i = 0; i < N; i++)
        y[i] = x[i] + k3[i] * h;
    slope(d, parameter, y, u, k4);
    for (int i = 0; i < N; i++)
        x[i] += (k1[i] + (k2[i] + k3[i]) * 2.0 + k4[i]) * (h / 6.0);
}

template <class S>
void move_by(const Dynamics &d, S *x, const S &u, double h)
{
    S parameter[MK_MAX_PARAMETERS];
    for (int i = 0; i < MK_MAX_PARAMETERS; i++)
        parameter[i] = S(d.model.parameter[i]);
    int steps = std::max(1, (int)std::ceil(h / d.step_s - 1e-9));
    for (int i = 0; i < steps; i++)
        runge_kutta(d, parameter, x, u, h / steps);
}

} // namespace

// The fastest mode is that of friction's smoothed sign at rest.
Dynamics::Dynamics(const mk_model &nominal, double longest_s)
    : model(nominal), motor(mk_plant(nominal.plant)->motor_joint)
{
    constexpr double STABLE = 2.0; // of Runge-Kutta's 2.78
    double a[N * N], b[N];
    mk_plant_linearise(&model, mk_plant(model.plant)->rest, true, a, b);
    double rate = std::max(std::fabs(a[N * 2 + 2] + a[N * 3 + 3]), 1e-9); // the sum of all modes
    step_s = std::min(longest_s, STABLE / rate);
}

State Dynamics::move(const State &x, double u, double h) const
{
    State y = x;
    move_by(*this, y.data(), u, h);
    return y;
}

State Dynamics::move(const State &x, double u, double h, StateMatrix &a, State &b) const
{
    Derived y[N];
    for (int i = 0; i < N; i++)
        y[i] = Derived::variable(x(i), i);
    move_by(*this, y, Derived::variable(u, N), h);
    State out;
    for (int i = 0; i < N; i++) {
        out(i) = y[i].v;
        for (int j = 0; j < N; j++)
            a(i, j) = y[i].d[j];
        b(i) = y[i].d[N];
    }
    return out;
}

namespace
{

constexpr double STALLED = 0.7;      // of the miss two rounds before
constexpr double RANGE_WEIGHT = 3e3; // of p: (excess / unit)^2 / 2, 1/s

// p(x) and its derivatives, which are diagonal.
double range_cost(const Problem &p, const State &x, State *gradient = nullptr,
                  State *curvature = nullptr)
{
    double sum = 0.0;
    for (int i = 0; i < N; i++) {
        double scale = std::isfinite(p.unit(i)) ? p.unit(i) : 1.0;
        double over = (std::max(x(i) - p.high(i), 0.0) - std::max(p.low(i) - x(i), 0.0)) / scale;
        sum += 0.5 * RANGE_WEIGHT * over * over;
        if (gradient) {
            (*gradient)(i) = RANGE_WEIGHT * over / scale;
            (*curvature)(i) = over != 0.0 ? RANGE_WEIGHT / (scale * scale) : 0.0;
        }
    }
    return sum;
}

class Solver
{
    const Problem &p_;
    Path &path_;
    size_t n_;
    State lambda_ = State::Zero(); // multipliers of the goal, in units
    double mu_ = 1.0;              // weight of its square
    double ridge_ = 1e-6;          // added to the curvature over u, in units of u_lim
    std::vector<StateMatrix> a_;
    std::vector<State> b_, gain_;
    std::vector<double> feed_;
    double expected_ = 0.0; // first-order decrease of the whole step

  public:
    Solver(const Problem &problem, Path &path)
        : p_(problem), path_(path), n_(path.u.size()), a_(n_), b_(n_), gain_(n_), feed_(n_)
    {
    }

    bool run(double tolerance, int iterations)
    {
        swing::run(p_, path_);
        double cost = cost_of(path_), before = HUGE_VAL, last = HUGE_VAL;
        for (int outer = 0; outer < 20 && std::isfinite(cost); outer++) {
            cost = minimise(cost, iterations);
            measure();
            if (path_.miss <= tolerance)
                return path_.excess <= 0.02;
            // Two rounds that hardly came nearer: there is no such swing-up near by.
            if (path_.miss > STALLED * before)
                return false;
            before = last, last = path_.miss;
            // Multipliers follow the error; the weight grows while there is one.
            lambda_ += mu_ * error(path_.x[n_]);
            mu_ *= 4.0;
            cost = cost_of(path_);
        }
        return false;
    }

  private:
    State error(const State &x) const
    {
        State e;
        for (int i = 0; i < N; i++)
            e(i) = std::isfinite(p_.unit(i)) ? (x(i) - p_.goal(i)) / p_.unit(i) : 0.0;
        return e;
    }

    void measure()
    {
        path_.miss = error(path_.x[n_]).cwiseAbs().maxCoeff();
        path_.excess = 0.0;
        for (const State &x : path_.x)
            path_.excess =
                std::max(path_.excess, std::sqrt(2.0 * range_cost(p_, x) / RANGE_WEIGHT));
    }

    double cost_of(const Path &path) const
    {
        double sum = 0.0;
        for (size_t k = 0; k < n_; k++) {
            double share = path.u[k] / p_.limit;
            sum += p_.h * (0.5 * p_.smoothness * share * share + range_cost(p_, path.x[k]));
        }
        State e = error(path.x[n_]);
        return sum + lambda_.dot(e) + 0.5 * mu_ * e.squaredNorm();
    }

    double minimise(double cost, int iterations)
    {
        int poor = 0;
        for (int i = 0; i < iterations && poor < 3; i++) {
            derivatives();
            while (!backward() && ridge_ < 1e10)
                ridge_ *= 8.0;
            double better = forward(cost);
            if (!(better < cost)) {
                if ((ridge_ *= 8.0) > 1e10)
                    break;
                continue;
            }
            ridge_ = std::max(ridge_ / 4.0, 1e-9);
            poor = cost - better < 1e-4 * (1e-3 + std::fabs(better)) ? poor + 1 : 0;
            cost = better;
        }
        ridge_ = std::min(ridge_, 1e-3);
        return cost;
    }

    void derivatives()
    {
        for (size_t k = 0; k < n_; k++)
            p_.dynamics->move(path_.x[k], path_.u[k], p_.h, a_[k], b_[k]);
    }

    // From the end: V = the cost to go to second order, and from it the step of u_k that is best
    // within the bound, du = feed + gain dx.
    bool backward()
    {
        State e = error(path_.x[n_]), vx;
        StateMatrix vxx = StateMatrix::Zero();
        for (int i = 0; i < N; i++) {
            double inverse = std::isfinite(p_.unit(i)) ? 1.0 / p_.unit(i) : 0.0;
            vx(i) = (lambda_(i) + mu_ * e(i)) * inverse;
            vxx(i, i) = mu_ * inverse * inverse;
        }
        expected_ = 0.0;
        double r = p_.h * p_.smoothness / (p_.limit * p_.limit);
        for (size_t k = n_; k-- > 0;) {
            State gradient, curvature;
            range_cost(p_, path_.x[k], &gradient, &curvature);
            const StateMatrix &a = a_[k];
            const State &b = b_[k];
            State vb = vxx * b;
            double qu = r * path_.u[k] + b.dot(vx);
            double quu = r + b.dot(vb) + ridge_ / (p_.limit * p_.limit);
            if (!(quu > 0.0) || !std::isfinite(qu))
                return false;
            State qux = a.transpose() * vb;
            double low = -p_.limit - path_.u[k], high = p_.limit - path_.u[k], wish = -qu / quu;
            feed_[k] = std::clamp(wish, low, high);
            bool bound = feed_[k] != wish;
            gain_[k] = bound ? State(State::Zero()) : State(-qux / quu);
            expected_ += qu * feed_[k];
            State qx = p_.h * gradient + a.transpose() * vx;
            StateMatrix qxx = a.transpose() * vxx * a;
            qxx.diagonal() += p_.h * curvature;
            double plain = quu - ridge_ / (p_.limit * p_.limit);
            vx = qx + gain_[k] * (plain * feed_[k] + qu) + qux * feed_[k];
            StateMatrix cross = gain_[k] * qux.transpose();
            vxx = qxx + plain * gain_[k] * gain_[k].transpose() + cross + cross.transpose();
        }
        return vxx.allFinite();
    }

    // Takes as much of the step as lessens the cost.
    double forward(double cost)
    {
        Path trial = path_;
        for (double share = 1.0; share > 1e-4; share *= 0.5) {
            bool finite = true;
            for (size_t k = 0; k < n_ && finite; k++) {
                double du = share * feed_[k] + gain_[k].dot(trial.x[k] - path_.x[k]);
                trial.u[k] = std::clamp(path_.u[k] + du, -p_.limit, p_.limit);
                trial.x[k + 1] = p_.dynamics->move(trial.x[k], trial.u[k], p_.h);
                finite = trial.x[k + 1].cwiseAbs().maxCoeff() < 1e5;
            }
            double now = finite ? cost_of(trial) : HUGE_VAL;
            if (now < cost + 1e-4 * share * std::min(expected_, 0.0)) {
                path_ = trial;
                return now;
            }
        }
        return cost;
    }
};

} // namespace

void run(const Problem &problem, Path &path)
{
    path.x.resize(path.u.size() + 1);
    path.x[0] = problem.start;
    for (size_t k = 0; k < path.u.size(); k++)
        path.x[k + 1] = problem.dynamics->move(path.x[k], path.u[k], problem.h);
}

bool solve(const Problem &problem, double tolerance, int iterations, Path &path)
{
    return Solver(problem, path).run(tolerance, iterations);
}

} // namespace mk::swing
