// DOP853 over a scalar: a double, SIMD lanes that share one step size, or dual numbers.
#ifndef MECHKIT_SIM_DOP853_HPP
#define MECHKIT_SIM_DOP853_HPP

#include "model/simd.hpp"
#include "sim/dop853_tableau.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

inline double largest(double x)
{
    return x;
}
template <int W>
inline double largest(const Pack<W> &x)
{
    double m = x.v[0];
    for (int i = 1; i < W; i++)
        m = x.v[i] > m || x.v[i] != x.v[i] ? x.v[i] : m;
    return m;
}

// y' = f(t, y), N states. F is called as f(t, y, dy) with t a double.
template <class S, int N, class F>
class Dop853
{
    F &f_;
    double rtol_, atol_, t_ = 0.0, h_ = 0.0, h_last_ = 0.0;
    S y_[N], old_[N];
    S k_[dop853::EXTENDED][N];
    S dense_[7][N];
    bool dense_ready_ = false;

  public:
    uint64_t steps = 0, evaluations = 0, rejected = 0;

    Dop853(F &f, double rtol, double atol) : f_(f), rtol_(rtol), atol_(atol) {}

    void start(double t, const S *y)
    {
        t_ = t;
        for (int i = 0; i < N; i++)
            y_[i] = y[i];
        evaluate(t_, y_, k_[0]);
        if (h_ == 0.0)
            h_ = first_step();
    }
    // The right-hand side has jumped (an edge of the command): the state stays, its slope does not.
    void edge() { evaluate(t_, y_, k_[0]); }

    double time() const { return t_; }
    double begin() const { return t_ - h_last_; }
    const S *state() const { return y_; }

    // One accepted step, not beyond t_end. False: the step size has underflown or the state is not
    // a number.
    bool step(double t_end)
    {
        constexpr double SAFETY = 0.9, SHRINK = 0.333, GROW = 6.0;
        for (int tries = 0; tries < 60; tries++) {
            bool last = t_ + 1.0000001 * h_ >= t_end;
            double h = last ? t_end - t_ : h_;
            S next[N];
            double error = attempt(h, next);
            if (!(error < 1e300) || h <= 1e-14 * (__builtin_fabs(t_) + 1e-3)) {
                if (!(error == error) && h > 1e-14 * (__builtin_fabs(t_) + 1e-3)) {
                    h_ = 0.1 * h;
                    continue;
                }
                if (!(error <= 1.0))
                    return false;
            }
            double root = __builtin_sqrt(__builtin_sqrt(__builtin_sqrt(error))); // error^(1/8)
            double factor = root > SAFETY / GROW ? SAFETY / root : GROW;
            if (error > 1.0) {
                rejected++;
                h_ = h * (factor < SHRINK ? SHRINK : factor);
                continue;
            }
            accept(h, last ? t_end : t_ + h, next);
            // A step cut short by the end says little about the next one.
            double wanted = h * factor;
            h_ = last && wanted < h_ && factor >= 1.0 ? h_ : wanted;
            return true;
        }
        return false;
    }

    // State inside the last step, order 7.
    void interpolate(double t, S *y)
    {
        if (!dense_ready_)
            prepare_dense();
        double x = (t - begin()) / h_last_, rest = 1.0 - x;
        for (int i = 0; i < N; i++) {
            S sum = dense_[6][i] * x;
            sum = (sum + dense_[5][i]) * rest;
            sum = (sum + dense_[4][i]) * x;
            sum = (sum + dense_[3][i]) * rest;
            sum = (sum + dense_[2][i]) * x;
            sum = (sum + dense_[1][i]) * rest;
            y[i] = old_[i] + (sum + dense_[0][i]) * x;
        }
    }

  private:
    // Not inlined: sixteen copies of a right-hand side cost more than sixteen calls.
    __attribute__((noinline)) void evaluate(double t, const S *y, S *dy)
    {
        f_(t, y, dy);
        evaluations++;
    }

    template <int I>
    void stage(double h, int into, S *y)
    {
        for (int i = 0; i < N; i++) {
            S sum = dop853::A[I][0] * k_[0][i];
#pragma GCC unroll 16
            for (int j = 1; j < I; j++)
                if (dop853::A[I][j] != 0.0)
                    sum += dop853::A[I][j] * k_[j][i];
            y[i] = old_[i] + h * sum;
        }
        if (into >= 0)
            evaluate(begin_of(h) + dop853::C[I] * h, y, k_[into]);
    }
    double begin_of(double) const
    {
        return base_;
    }

    // Largest error over lanes, relative to the tolerance; `next` is the state at the end.
    double attempt(double h, S *next)
    {
        base_ = t_;
        for (int i = 0; i < N; i++)
            old_[i] = y_[i];
        S y[N];
        stage<1>(h, 1, y), stage<2>(h, 2, y), stage<3>(h, 3, y), stage<4>(h, 4, y);
        stage<5>(h, 5, y), stage<6>(h, 6, y), stage<7>(h, 7, y), stage<8>(h, 8, y);
        stage<9>(h, 9, y), stage<10>(h, 10, y), stage<11>(h, 11, y);
        stage<12>(h, -1, next);
        S e5 = S(0.0), e3 = S(0.0);
        for (int i = 0; i < N; i++) {
            S a = S(0.0), b = S(0.0);
#pragma GCC unroll 16
            for (int j = 0; j < dop853::STAGES; j++) {
                if (dop853::E5[j] != 0.0)
                    a += dop853::E5[j] * k_[j][i];
                if (dop853::E3[j] != 0.0)
                    b += dop853::E3[j] * k_[j][i];
            }
            S size = fabs(old_[i]), size2 = fabs(next[i]);
            S scale = atol_ + rtol_ * if_positive(size2 - size, size2, size);
            S inverse = 1.0 / scale;
            a *= inverse, b *= inverse;
            e5 += a * a, e3 += b * b;
        }
        S sum = (e5 + 0.01 * e3) * double(N);
        S safe = if_positive(sum, sum, S(1.0));
        return __builtin_fabs(h) * largest(e5 / sqrt(safe));
    }

    void accept(double h, double t_next, const S *next)
    {
        h_last_ = h;
        t_ = t_next;
        for (int i = 0; i < N; i++)
            y_[i] = next[i];
        // Slope at the old begin is needed by the dense output: keep it beside the new one.
        for (int i = 0; i < N; i++)
            begin_slope_[i] = k_[0][i];
        evaluate(t_, y_, k_[12]);
        dense_ready_ = false;
        steps++;
        pending_ = true;
    }

  public:
    // Between interpolation and the next step: the slope at the end becomes that at the begin.
    void advance()
    {
        if (!pending_)
            return;
        for (int i = 0; i < N; i++)
            k_[0][i] = k_[12][i];
        pending_ = false;
    }

  private:
    void prepare_dense()
    {
        double h = h_last_;
        base_ = begin();
        S y[N];
        for (int i = 0; i < N; i++)
            k_[0][i] = begin_slope_[i];
        stage<13>(h, 13, y), stage<14>(h, 14, y), stage<15>(h, 15, y);
        for (int i = 0; i < N; i++) {
            S change = y_[i] - old_[i];
            dense_[0][i] = change;
            dense_[1][i] = h * k_[0][i] - change;
            dense_[2][i] = 2.0 * change - h * (k_[12][i] + k_[0][i]);
            for (int r = 0; r < 4; r++) {
                S sum = S(0.0);
#pragma GCC unroll 16
                for (int j = 0; j < dop853::EXTENDED; j++)
                    if (dop853::D[r][j] != 0.0)
                        sum += dop853::D[r][j] * k_[j][i];
                dense_[3 + r][i] = h * sum;
            }
        }
        dense_ready_ = true;
    }

    // Hairer, Norsett, Wanner, II.4: small enough for an explicit Euler step to mean something.
    double first_step()
    {
        S d0 = S(0.0), d1 = S(0.0);
        for (int i = 0; i < N; i++) {
            S inverse = 1.0 / (atol_ + rtol_ * fabs(y_[i]));
            S a = y_[i] * inverse, b = k_[0][i] * inverse;
            d0 += a * a, d1 += b * b;
        }
        double size = largest(d0), slope = largest(d1);
        double h = slope > 1e-10 && size > 1e-10 ? 0.01 * __builtin_sqrt(size / slope) : 1e-6;
        return h > 1e-3 || !(h > 0.0) ? 1e-3 : h;
    }

    double base_ = 0.0;
    bool pending_ = false;
    S begin_slope_[N];
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
