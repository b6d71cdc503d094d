// The shooting kernel's derivatives over a step. A part of shoot_kernel.cc, which alone includes
// it.
//
// Exact derivatives take the stages of the Runge-Kutta method, with dk/dc in the place of k.
//
// Close ones know that the columns X solve a linear equation,
//     dX/dt = A X + B ,   A = df/dx , B = df/dp dp/dc ,
// and take A and B in the middle of the step for all of it (the exponential midpoint rule; M.
// Hochbruck, A. Ostermann, Exponential integrators, Acta Numerica 2010):
//     X <- X + h phi(hA) (A X + B) ,
//     phi(Z) = (exp(Z) - 1) / Z ~ 1 + Z/2 + Z^2/6 + Z^3/24 ,
// which of exp(hA) leaves the terms that the Runge-Kutta method has of it. For motion of frequency
// w they are off by (hw)^2/24 of X: 7e-5 at 10 rad/s and steps of 4 ms. A start state,
// and what effects remember up to there, is found as well with them. Parameters are not: near a
// kink, or where they make up for each other, close derivatives are not the slope of the cost, and
// make data tell more of them than they do.
#ifndef MECHKIT_SIM_SHOOT_COLUMNS_HPP
#define MECHKIT_SIM_SHOOT_COLUMNS_HPP

namespace mk
{
inline namespace MK_KERNEL_NS
{

// --- exact ---

// stage_sum is k1 + 2 k2 + 2 k3.
template <class Law>
inline void Shooter<Law>::exact_runge_kutta(const Base &h)
{
    Base half = 0.5 * h, sixth = (1.0 / 6.0) * h, mid = now + half;
    first_stage(half);
    derivative(mid, y, stage);
    next_stage(half, f0);
    derivative(mid, y, stage);
    next_stage(h, stage_sum);
    derivative(now + h, y, stage);
    for (int i = 0; i < ns; i++)
        y.v[i] = x.v[i] + sixth * (stage_sum.v[i] + stage.v[i]);
    for (int i = 0; i < ns * columns; i++)
        y.d[i] = x.d[i] + sixth * (stage_sum.d[i] + stage.d[i]);
}

// y = x + h k1.
template <class Law>
inline void Shooter<Law>::first_stage(const Base &h)
{
    for (int i = 0; i < ns; i++)
        y.v[i] = x.v[i] + h * f0.v[i];
    for (int i = 0; i < ns * columns; i++)
        y.d[i] = x.d[i] + h * f0.d[i];
}

// y = x + h k, k the slope of the stage before; `sum` is that of the slopes before it.
template <class Law>
inline void Shooter<Law>::next_stage(const Base &h, const Point &sum)
{
    for (int i = 0; i < ns; i++)
        stage_sum.v[i] = sum.v[i] + 2.0 * stage.v[i], y.v[i] = x.v[i] + h * stage.v[i];
    for (int i = 0; i < ns * columns; i++)
        stage_sum.d[i] = sum.d[i] + 2.0 * stage.d[i], y.d[i] = x.d[i] + h * stage.d[i];
}

// --- close ---

template <class Law>
inline void Shooter<Law>::close_runge_kutta(const Base &h)
{
    stages(h, y.v, [this](const Base &t, const Base *at, Base *f) { linearise(t, at, f); });
    move_columns(h);
}

// f with A and B.
template <class Law>
inline void Shooter<Law>::linearise(const Base &t, const Base *at, Base *f)
{
    look_at(at);
    rhs_of<Law>(c, in_log(t), seen, u, linear.f);
    for (int i = 0; i < ns; i++)
        f[i] = base_of(linear.f[i]);
}

// y = x + h phi V, V = A x + B, in the columns. For few of them the brackets of phi are applied to
// V one after the other, for many phi is made first.
template <class Law>
inline void Shooter<Law>::move_columns(const Base &h)
{
#if MK_DERIVATIVES
    Base *V = f0.d;
    for (int i = 0; i < ns; i++)
        chain(linear.f[i], x, V + i * columns);
    if (columns <= 2 * ns) {
        brackets(h, V, columns, between.d);
        for (int i = 0; i < ns * columns; i++)
            y.d[i] = x.d[i] + h * between.d[i];
        return;
    }
    Base phi[MK_MAX_STATES * MK_MAX_STATES];
    brackets(h, linear.unity, ns, phi);
    const Base *from[MK_MAX_STATES];
    Base by[MK_MAX_STATES];
    for (int s = 0; s < ns; s++)
        from[s] = V + s * columns;
    for (int i = 0; i < ns; i++) {
        for (int s = 0; s < ns; s++)
            by[s] = h * phi[i * ns + s];
        weigh_all(ns, by, from, columns, y.d + i * columns);
        for (int d = i * columns; d < (i + 1) * columns; d++)
            y.d[d] += x.d[d];
    }
#else
    (void)h;
#endif
}

// out = phi(hA) V = (1 + hA/2 (1 + hA/3 (1 + hA/4))) V from the innermost bracket on; ns x count.
template <class Law>
inline void Shooter<Law>::brackets(const Base &h, const Base *V, int count, Base *out) const
{
#if MK_DERIVATIVES
    constexpr double SHARES[] = {1.0 / 4.0, 1.0 / 3.0, 1.0 / 2.0};
    Base product[2 * MK_MAX_STATES * MK_MAX_STATES];
    for (int i = 0; i < ns * count; i++)
        out[i] = V[i];
    for (double share : SHARES) {
        for (int i = 0; i < ns; i++)
            weigh_states(
                linear.f[i], [&](int s) { return out + s * count; }, count, product + i * count);
        for (int i = 0; i < ns * count; i++)
            out[i] = V[i] + share * h * product[i];
    }
#else
    (void)h, (void)V, (void)count, (void)out;
#endif
}

// Row i of A X + B at an end of the step, into out.d.
template <class Law>
inline void Shooter<Law>::slope_row(int i, const Point &at, Point &out) const
{
#if MK_DERIVATIVES
    chain(linear.f[i], at, out.d + i * columns);
#else
    (void)i, (void)at, (void)out;
#endif
}

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
