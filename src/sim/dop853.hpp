// DOP853 over a scalar: a double, SIMD lanes that share one step size, or dual numbers.
#ifndef MECHKIT_SIM_DOP853_HPP
#define MECHKIT_SIM_DOP853_HPP

#include "model/simd.hpp"
#include "sim/dop853_tableau.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

// The N states of one system, added and scaled together.
template <class S, int N>
struct States {
    S x[N];

    States &operator+=(const States &b)
    {
        for (int i = 0; i < N; i++)
            x[i] += b.x[i];
        return *this;
    }
    template <class F>
    static States each(F &&f)
    {
        States r;
        for (int i = 0; i < N; i++)
            r.x[i] = f(i);
        return r;
    }
    friend States operator+(const States &a, const States &b)
    {
        return each([&](int i) { return a.x[i] + b.x[i]; });
    }
    friend States operator-(const States &a, const States &b)
    {
        return each([&](int i) { return a.x[i] - b.x[i]; });
    }
    friend States operator*(const States &a, const States &b)
    {
        return each([&](int i) { return a.x[i] * b.x[i]; });
    }
    friend States operator*(double a, const States &b)
    {
        return each([&](int i) { return a * b.x[i]; });
    }
};
template <class S, int N>
inline S add_up(const States<S, N> &a)
{
    S sum = a.x[0];
    for (int i = 1; i < N; i++)
        sum += a.x[i];
    return sum;
}
// 1 / (atol + rtol max(|a|, |b|)).
template <class S, int N>
inline States<S, N> inverse_scale(double atol, double rtol, const States<S, N> &a,
                                  const States<S, N> &b)
{
    return States<S, N>::each([&](int i) {
        const S size = fabs(a.x[i]), other = fabs(b.x[i]);
        return 1.0 / (atol + rtol * if_positive(other - size, other, size));
    });
}

// Of one system in plain doubles they are the lanes of a register.
template <int N>
inline Pack<N> inverse_scale(double atol, double rtol, const Pack<N> &a, const Pack<N> &b)
{
    const Pack<N> size = fabs(a), other = fabs(b);
    return 1.0 / (atol + rtol * if_positive(other - size, other, size));
}
template <class S, int N>
struct StatesOf {
    using Type = States<S, N>;
};
#if defined(MK_ISA) && defined(__AVX__)
template <>
struct StatesOf<double, 2> {
    using Type = Pack<2>;
};
template <>
struct StatesOf<double, 4> {
    using Type = Pack<4>;
};
#endif

// y' = f(t, y), N states. F is called as f(t, y, dy) with t a double.
template <class S, int N, class F>
class Dop853
{
    using Y = typename StatesOf<S, N>::Type;
    static_assert(sizeof(Y) == N * sizeof(S));

    F &f_;
    double rtol_, atol_, t_ = 0.0, h_ = 0.0, h_last_ = 0.0;
    S state_[N];
    Y y_, old_;
    Y k_[dop853::EXTENDED];
    Y dense_[7];
    bool dense_ready_ = false;

  public:
    uint64_t steps = 0, evaluations = 0, rejected = 0;

    Dop853(F &f, double rtol, double atol) : f_(f), rtol_(rtol), atol_(atol) {}

    void start(double t, const S *y)
    {
        t_ = t;
        __builtin_memcpy(&y_, y, sizeof y_);
        edge();
        if (h_ == 0.0)
            h_ = first_step();
    }
    // The right-hand side has jumped (an edge of the command): the state stays, its slope does not.
    void edge() { k_[0] = evaluate(t_, y_); }

    double time() const { return t_; }
    double begin() const { return t_ - h_last_; }
    const S *state()
    {
        __builtin_memcpy(state_, &y_, sizeof state_);
        return state_;
    }

    // One accepted step, not beyond t_end. False: the step size has underflown or the state is not
    // a number.
    bool step(double t_end)
    {
        constexpr double SAFETY = 0.9, SHRINK = 0.333, GROW = 6.0;
        for (int tries = 0; tries < 60; tries++) {
            bool last = t_ + 1.0000001 * h_ >= t_end;
            double h = last ? t_end - t_ : h_;
            Y next;
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
        const double x = (t - begin()) / h_last_, rest = 1.0 - x;
        Y sum = x * dense_[6];
        sum = rest * (sum + dense_[5]);
        sum = x * (sum + dense_[4]);
        sum = rest * (sum + dense_[3]);
        sum = x * (sum + dense_[2]);
        sum = rest * (sum + dense_[1]);
        sum = old_ + x * (sum + dense_[0]);
        __builtin_memcpy(y, &sum, sizeof sum);
    }

  private:
    // Not inlined: sixteen copies of a right-hand side cost more than sixteen calls.
    __attribute__((noinline)) Y evaluate(double t, const Y &y)
    {
        S at[N], slope[N];
        Y dy;
        __builtin_memcpy(at, &y, sizeof at);
        f_(t, at, slope);
        evaluations++;
        __builtin_memcpy(&dy, slope, sizeof dy);
        return dy;
    }

    // sum_j b_j k_j over the stages with b_j != 0.
    template <int COUNT>
    Y weighed(const double *b) const
    {
        Y sum = b[0] * k_[0];
#pragma GCC unroll 16
        for (int j = 1; j < COUNT; j++)
            if (b[j] != 0.0)
                sum += b[j] * k_[j];
        return sum;
    }
    template <int I>
    Y place(double h) const
    {
        return old_ + h * weighed<I>(dop853::A[I]);
    }
    template <int I>
    void stage(double h)
    {
        k_[I] = evaluate(base_ + dop853::C[I] * h, place<I>(h));
    }

    // Largest error over lanes, relative to the tolerance; `next` is the state at the end.
    double attempt(double h, Y &next)
    {
        base_ = t_;
        old_ = y_;
        stage<1>(h), stage<2>(h), stage<3>(h), stage<4>(h), stage<5>(h), stage<6>(h);
        stage<7>(h), stage<8>(h), stage<9>(h), stage<10>(h), stage<11>(h);
        next = place<12>(h);
        const Y inverse = inverse_scale(atol_, rtol_, old_, next);
        const Y a = inverse * weighed<dop853::STAGES>(dop853::E5);
        const Y b = inverse * weighed<dop853::STAGES>(dop853::E3);
        const S e5 = add_up(a * a), e3 = add_up(b * b);
        const S sum = (e5 + 0.01 * e3) * double(N);
        const S safe = if_positive(sum, sum, S(1.0));
        return __builtin_fabs(h) * largest(e5 / sqrt(safe));
    }

    void accept(double h, double t_next, const Y &next)
    {
        h_last_ = h;
        t_ = t_next;
        y_ = next;
        // Slope at the old begin is needed by the dense output: keep it beside the new one.
        begin_slope_ = k_[0];
        k_[12] = evaluate(t_, y_);
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
        k_[0] = k_[12];
        pending_ = false;
    }

  private:
    void prepare_dense()
    {
        const double h = h_last_;
        base_ = begin();
        k_[0] = begin_slope_;
        stage<13>(h), stage<14>(h), stage<15>(h);
        const Y change = y_ - old_;
        dense_[0] = change;
        dense_[1] = h * k_[0] - change;
        dense_[2] = 2.0 * change - h * (k_[12] + k_[0]);
        for (int r = 0; r < 4; r++)
            dense_[3 + r] = h * weighed<dop853::EXTENDED>(dop853::D[r]);
        dense_ready_ = true;
    }

    // Hairer, Norsett, Wanner, II.4: small enough for an explicit Euler step to mean something.
    double first_step() const
    {
        const Y inverse = inverse_scale(atol_, rtol_, y_, y_);
        const Y a = y_ * inverse, b = k_[0] * inverse;
        const double size = largest(add_up(a * a)), slope = largest(add_up(b * b));
        const double h = slope > 1e-10 && size > 1e-10 ? 0.01 * __builtin_sqrt(size / slope) : 1e-6;
        return h > 1e-3 || !(h > 0.0) ? 1e-3 : h;
    }

    double base_ = 0.0;
    bool pending_ = false;
    Y begin_slope_;
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
