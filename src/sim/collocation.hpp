// Collocation for q'' = a(t, q, v), the points of a step side by side in registers: of one
// trajectory, what an explicit method works out one stage after the other is done at once.
//
// Over a step of length h from t0 the acceleration is the polynomial p of degree 7 that equals it
// at the eight Gauss points t0 + c_i h, and speed and angle are its integrals:
//     v_i = v0 + h sum_j A_ij a_j,    q_i = q0 + h c_i v0 + h^2 sum_j B_ij a_j,    B = A^2,
//     a_i = a(t0 + c_i h, q_i, v_i).
// Iterating these equations contracts by about h/10 times the Lipschitz constant of a; it starts
// from the last step's polynomial, continued. At the end of a step the order is 16, in between 9.
// E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., Springer
// 1993, II.7; P. J. van der Houwen, B. P. Sommeijer, "Parallel iteration of high-order Runge-Kutta
// methods with stepsize control", J. Comput. Appl. Math. 29 (1990).
#ifndef MECHKIT_SIM_COLLOCATION_HPP
#define MECHKIT_SIM_COLLOCATION_HPP

#include "model/simd.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{
namespace gauss
{

constexpr int N = 8;
// Positive roots of P_8 and their weights. M. Abramowitz, I. Stegun, Handbook of Mathematical
// Functions, table 25.4.
constexpr double ROOT[N / 2] = {0.18343464249564980494, 0.52553240991632898582,
                                0.79666647741362673959, 0.96028985649753623168};
constexpr double WEIGHT[N / 2] = {0.36268378337836198297, 0.31370664587788728734,
                                  0.22238103445337447054, 0.10122853629037625915};

struct Table {
    // [j][i]: what a_j gives to point i, so that a column fills a register.
    alignas(64) double a[N][N], b[N][N];
    // [j][k]: what a_j gives to the coefficient of the Legendre polynomial P_k.
    alignas(64) double legendre[N][N];
    alignas(64) double c[N]; // points in 0..1
    double v[N], q[N];       // v1 = v0 + h sum v_j a_j, q1 = q0 + h v0 + h^2 sum q_j a_j
};

constexpr Table make_table()
{
    Table t = {};
    double p[N][N + 1] = {}; // P_k at point i
    for (int i = 0; i < N; i++) {
        const double x = i < N / 2 ? -ROOT[N / 2 - 1 - i] : ROOT[i - N / 2];
        const double w = i < N / 2 ? WEIGHT[N / 2 - 1 - i] : WEIGHT[i - N / 2];
        t.c[i] = 0.5 * (1.0 + x);
        t.v[i] = 0.5 * w;
        t.q[i] = 0.25 * w * (1.0 - x);
        p[i][0] = 1.0, p[i][1] = x;
        for (int k = 2; k <= N; k++)
            p[i][k] = ((2.0 * k - 1.0) * x * p[i][k - 1] - (k - 1.0) * p[i][k - 2]) / k;
        for (int k = 0; k < N; k++)
            t.legendre[i][k] = (k + 0.5) * w * p[i][k];
    }
    // The integral of P_k from -1 is (P_{k+1} - P_{k-1}) / (2 k + 1), that of P_0 is x + 1.
    for (int j = 0; j < N; j++)
        for (int i = 0; i < N; i++) {
            t.a[j][i] = t.legendre[j][0] * t.c[i];
            for (int k = 1; k < N; k++)
                t.a[j][i] += t.legendre[j][k] * (p[i][k + 1] - p[i][k - 1]) / (2.0 * (2 * k + 1));
        }
    for (int j = 0; j < N; j++)
        for (int i = 0; i < N; i++)
            for (int k = 0; k < N; k++)
                t.b[j][i] += t.a[k][i] * t.a[j][k];
    return t;
}
alignas(64) constexpr Table TABLE = make_table();

} // namespace gauss

// J joints, W lanes. F has the command at W times, f.command(t), once an attempt, and is called as
// f(u, x, a) with x = [q, v] and the accelerations a[j] of W points.
template <int J, int W, class F>
class Collocation
{
    using P = Pack<W>;
    static constexpr int N = gauss::N, R = N / W; // points, registers of them
    static_assert(R * W == N, "points fill registers");

    // Values at the points of a step, or coefficients of Legendre polynomials.
    struct Points {
        P at[R];

        static Points from(const double *x)
        {
            Points p;
            memcpy(p.at, x, sizeof p.at);
            return p;
        }
        void store(double *x) const { memcpy(x, at, sizeof at); }
    };

    // Degree up to which a polynomial is continued beyond its step; the last ones grow too fast.
    static constexpr int CONTINUED = 6;
    // Share of the tolerance that iterating may leave.
    static constexpr double LEFT = 0.03;
    static constexpr double SAFETY = 0.85, SHRINK = 0.3, GROW = 1.5;
    static constexpr int MOST_ITERATIONS = 14, MANY_ITERATIONS = 7;

    F &f_;
    double rtol_, atol_, t_ = 0.0, h_ = 1e-3;
    double q_[J], v_[J];
    // The last polynomial that was found, by its Legendre coefficients, and its step.
    double begin_ = 0.0, length_ = 0.0, q0_[J], v0_[J];
    double coefficient_[J][N];
    Points u_, a_[J];
    int iterations_ = 0;

  public:
    uint64_t steps = 0;

    Collocation(F &f, double rtol, double atol) : f_(f), rtol_(rtol), atol_(atol) {}

    // From x = [q, v].
    void start(double t, const double *x)
    {
        t_ = t;
        for (int j = 0; j < J; j++)
            q_[j] = x[j], v_[j] = x[J + j];
    }
    double time() const { return t_; }

    // One accepted step, not beyond t_end. False: the step size has underflown or the state is not
    // a number.
    bool step(double t_end)
    {
        for (int tries = 0; tries < 60; tries++) {
            const bool last = t_ + 1.0000001 * h_ >= t_end;
            const double h = last ? t_end - t_ : h_;
            if (!(h > 1e-14 * (__builtin_fabs(t_) + 1e-3)))
                return false;
            guess(h);
            if (!solve(h)) {
                h_ = 0.5 * h;
                continue;
            }
            const double error = describe(h);
            // error^(1/8)
            const double root = __builtin_sqrt(__builtin_sqrt(__builtin_sqrt(error)));
            const double most = iterations_ >= MANY_ITERATIONS ? 1.0 : GROW;
            double factor = root > SAFETY / most ? SAFETY / root : most;
            factor = factor < SHRINK ? SHRINK : factor;
            if (!(error <= 1.0)) {
                h_ = h * factor;
                continue;
            }
            accept(h, last ? t_end : t_ + h);
            // A step cut short by the end says little about the next one.
            h_ = last && h * factor < h_ && factor >= 1.0 ? h_ : h * factor;
            return true;
        }
        return false;
    }

    // [q, v] at W times inside the last step.
    void interpolate(const P &t, P *x) const
    {
        const P at = (2.0 / length_) * (t - begin_) - 1.0;
        P p[N + 2], once[N + 1], twice[N]; // Legendre polynomials and their integrals from -1
        polynomials<N + 1>(at, p);
        once[0] = at + 1.0;
        twice[0] = 0.5 * once[0] * once[0];
#pragma GCC unroll 16
        for (int k = 1; k <= N; k++)
            once[k] = (p[k + 1] - p[k - 1]) * (1.0 / (2 * k + 1));
#pragma GCC unroll 16
        for (int k = 1; k < N; k++)
            twice[k] = (once[k + 1] - once[k - 1]) * (1.0 / (2 * k + 1));
        const double half = 0.5 * length_;
        for (int j = 0; j < J; j++) {
            P speed = coefficient_[j][0] * once[0], angle = coefficient_[j][0] * twice[0];
#pragma GCC unroll 16
            for (int k = 1; k < N; k++) {
                speed += coefficient_[j][k] * once[k];
                angle += coefficient_[j][k] * twice[k];
            }
            x[j] = q0_[j] + half * (v0_[j] * once[0] + half * angle);
            x[J + j] = v0_[j] + half * speed;
        }
    }

  private:
    // P_0 .. P_HIGHEST.
    template <int HIGHEST>
    static void polynomials(const P &x, P *p)
    {
        p[0] = P(1.0), p[1] = x;
#pragma GCC unroll 16
        for (int k = 2; k <= HIGHEST; k++)
            p[k] = ((2.0 * k - 1.0) / k) * x * p[k - 1] - ((k - 1.0) / k) * p[k - 2];
    }
    // sum_j matrix[j] a_j
    static Points product(const double (&matrix)[N][N], const double *a)
    {
        Points sum;
        for (int r = 0; r < R; r++)
            sum.at[r] = P(0.0);
#pragma GCC unroll 8
        for (int j = 0; j < N; j++) {
            const Points column = Points::from(matrix[j]);
            for (int r = 0; r < R; r++)
                sum.at[r] += a[j] * column.at[r];
        }
        return sum;
    }
    // The registers' chains do not wait for each other where they stand side by side.
    __attribute__((noinline, flatten)) void evaluate(const Points *q, const Points *v, Points *a)
    {
#pragma GCC unroll 4
        for (int r = 0; r < R; r++) {
            P at[2 * J], slope[J];
            for (int j = 0; j < J; j++)
                at[j] = q[j].at[r], at[J + j] = v[j].at[r];
            f_(u_.at[r], at, slope);
            for (int j = 0; j < J; j++)
                a[j].at[r] = slope[j];
        }
    }

    // Accelerations to iterate from: of the last polynomial, or, at the very beginning, a constant.
    void guess(double h)
    {
        const Points c = Points::from(gauss::TABLE.c);
        for (int r = 0; r < R; r++)
            u_.at[r] = f_.command(t_ + h * c.at[r]);
        if (length_ == 0.0) {
            Points q[J], v[J];
            for (int j = 0; j < J; j++)
                for (int r = 0; r < R; r++)
                    q[j].at[r] = P(q_[j]), v[j].at[r] = P(v_[j]);
            evaluate(q, v, a_);
            return;
        }
        // An attempt that was too long covers this one.
        const bool inside = begin_ == t_;
        for (int r = 0; r < R; r++) {
            P p[N];
            polynomials<N - 1>((2.0 / length_) * ((t_ - begin_) + h * c.at[r]) - 1.0, p);
            for (int j = 0; j < J; j++) {
                P sum(coefficient_[j][0]);
#pragma GCC unroll 8
                for (int k = 1; k <= CONTINUED; k++)
                    sum += coefficient_[j][k] * p[k];
                for (int k = CONTINUED + 1; k < N && inside; k++)
                    sum += coefficient_[j][k] * p[k];
                a_[j].at[r] = sum;
            }
        }
    }

    // What an acceleration of joint j that is off all through a step of length h does to its speed
    // and angle, over the tolerance.
    double weight(int j, double h) const
    {
        const double of_v = h / (atol_ + rtol_ * __builtin_fabs(v_[j]));
        const double of_q = h * h / (atol_ + rtol_ * __builtin_fabs(q_[j]));
        return of_v > of_q ? of_v : of_q;
    }

    // Iterates the equations of collocation. False: they do not contract.
    bool solve(double h)
    {
        constexpr double SLOW = 0.7, ROUNDING = 1e-13;
        double before = 0.0;
        for (iterations_ = 1; iterations_ <= MOST_ITERATIONS; iterations_++) {
            Points q[J], v[J], a[J];
            place(h, q, v);
            evaluate(q, v, a);
            double change = 0.0, size = 0.0;
            for (int j = 0; j < J; j++) {
                P most(0.0), sum(0.0); // what is no number shows in the sum
                for (int r = 0; r < R; r++) {
                    const P d = fabs(a[j].at[r] - a_[j].at[r]);
                    most = if_positive(d - most, d, most);
                    sum += fabs(a[j].at[r]);
                }
                a_[j] = a[j];
                const double w = weight(j, h), d = w * largest(most);
                change = d > change ? d : change;
                size += w * add_up(sum);
            }
            if (!(size < 1e300))
                return false;
            // The next change would be `rate` times this one, and so on.
            const double rate = before > 0.0 ? change / before : 1.0;
            if ((rate < SLOW && rate * change < LEFT) || change <= ROUNDING * size)
                return true;
            if (iterations_ > 3 && rate > SLOW)
                return false;
            before = change;
        }
        return false;
    }
    // Angles and speeds at the points that follow from the accelerations there.
    void place(double h, Points *q, Points *v) const
    {
        const Points c = Points::from(gauss::TABLE.c);
        for (int j = 0; j < J; j++) {
            alignas(64) double a[N];
            a_[j].store(a);
            const Points once = product(gauss::TABLE.a, a), twice = product(gauss::TABLE.b, a);
            for (int r = 0; r < R; r++) {
                v[j].at[r] = v_[j] + h * once.at[r];
                q[j].at[r] = q_[j] + h * (v_[j] * c.at[r] + h * twice.at[r]);
            }
        }
    }

    // Takes over the polynomial of this step; its error over the tolerance. A coefficient of P_7
    // integrates to 1/16 of it; where p is even about the middle that of P_6 stands for it.
    double describe(double h)
    {
        double error = 0.0;
        for (int j = 0; j < J; j++) {
            alignas(64) double a[N];
            a_[j].store(a);
            product(gauss::TABLE.legendre, a).store(coefficient_[j]);
            const double seventh = __builtin_fabs(coefficient_[j][N - 1]);
            const double sixth = __builtin_fabs(coefficient_[j][N - 2]);
            const double e = weight(j, h) * (sixth > seventh ? sixth : seventh) / (2 * N);
            error = e > error || e != e ? e : error;
            q0_[j] = q_[j], v0_[j] = v_[j];
        }
        begin_ = t_;
        length_ = h;
        return error;
    }
    void accept(double h, double t_next)
    {
        for (int j = 0; j < J; j++) {
            alignas(64) double a[N];
            a_[j].store(a);
            double speed = 0.0, angle = 0.0;
            for (int i = 0; i < N; i++)
                speed += gauss::TABLE.v[i] * a[i], angle += gauss::TABLE.q[i] * a[i];
            q_[j] += h * (v_[j] + h * angle);
            v_[j] += h * speed;
        }
        t_ = t_next;
        steps++;
    }
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
