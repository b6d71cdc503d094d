// A whole model evaluated over a scalar: plant, friction of the motor joint, effects.
#ifndef MECHKIT_MODEL_RHS_HPP
#define MECHKIT_MODEL_RHS_HPP

#include "model/effects_list.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

// Resolves a model's structure; the numbers are converted from double, so for lanes and derivatives
// the caller overwrites p and effect[].p afterwards.
template <class S>
inline Compiled<S> compile(const mk_model &model)
{
    const mk_plant_info *plant = mk_plant(model.plant);
    Compiled<S> c;
    c.plant = model.plant;
    c.joints = plant->joints;
    c.parallel = plant->joints_parallel;
    c.motor = plant->motor_joint;
    c.parameter_count = plant->parameter_count;
    c.mass_count = plant->mass_count;
    c.g = model.g;
    c.u_max = model.u_max;
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        c.sharpness[j] = mk_model_sharpness(&model, j);
    c.effect_count = model.effect_count;
    c.state_count = 2 * c.joints;
    c.event_count = 0;
    for (int i = 0; i < c.parameter_count; i++)
        c.p[i] = S(model.parameter[i]);
    for (int i = 0; i < c.effect_count; i++) {
        const mk_effect_use &use = model.effect[i];
        const mk_effect_info *info = mk_effect(use.index);
        typename Compiled<S>::Effect &e = c.effect[i];
        e.index = use.index;
        e.joint = use.joint - 1;
        e.state = c.state_count;
        e.event = c.event_count;
        c.state_count += info->state_count;
        c.event_count += info->event_count;
        for (int k = 0; k < info->parameter_count; k++)
            e.p[k] = S(use.value[k]);
    }
    // Insertion sort by the table's order.
    for (int i = 0; i < c.effect_count; i++) {
        int k = i;
        for (; k > 0 && c.at(k - 1).index > c.effect[i].index; k--)
            c.acting[k] = c.acting[k - 1];
        c.acting[k] = i;
    }
    return c;
}

// Friction of the motor joint, the same form on every plant: viscous, then Coulomb.
// Report (2.2), (2.3).
template <class S>
inline S motor_friction(const Compiled<S> &c, const S &speed, const S &coulomb_scale)
{
    return c.p[c.mass_count] * speed +
           c.p[c.mass_count + 1] * coulomb_scale * smooth_sign(c.sharpness[c.motor], speed);
}

template <class S>
inline EffectArgs<S> args_of(const typename Compiled<S>::Effect &e, const S *x)
{
    return {e.joint, e.p, x + e.state};
}

// Fills a frame up to the command and frame stages. Commands and time are scalars S, or, where
// nothing is differentiated by them, numbers that S is made of.
template <class S, class U>
inline void frame_begin(Frame<S> &f, const Compiled<S> &c, const U &t, const S *x, const U *u)
{
    f.c = &c;
    f.t = S(t);
    set_motion(f.m, c.joints, x, x + c.joints);
    f.command[0] = S(clamp(u[0], U(-c.u_max), U(c.u_max)));
    f.command[1] = c.joints == 2 && c.motor == 0 ? S(u[1]) : S(0.0); // a second motor, if any
    f.motor_speed = f.m.v[c.motor];
    f.coulomb_scale = S(1.0);
    f.motor_detached = false;
    f.base_acceleration = S(0.0);
    f.base_moves = false;
    for (int i = 0; i < c.effect_count; i++)
        if (auto *stage = effect_ops<S>(c.at(i).index).frame)
            stage(f, args_of(c.at(i), x));
    for (int i = 0; i < c.effect_count; i++)
        if (auto *stage = effect_ops<S>(c.at(i).index).command)
            stage(f, args_of(c.at(i), x));
}

// Accelerations of the joints from right-hand sides tau, mass matrix and h.
template <class S>
inline void solve_joints(int joints, const S &m11, const S &m12, const S &m22, const S &r1,
                         const S &r2, S *a)
{
    if (joints == 1) {
        a[0] = r1 / m11;
        a[1] = S(0.0);
        return;
    }
    S inv = 1.0 / (m11 * m22 - m12 * m12);
    a[0] = (m22 * r1 - m12 * r2) * inv;
    a[1] = (m11 * r2 - m12 * r1) * inv;
}

// dx/dt of a model without effects. Nothing passes through a frame, and what the plant's row says
// is known when this is compiled: the chain from a state to its slope stays in registers.
template <class Law, class S, class U>
inline void bare_rhs_of(const Compiled<S> &c, const S *x, const U *u, S *dx)
{
    constexpr int J = Law::joints, MOTOR = Law::info.motor_joint;
    constexpr bool SECOND_MOTOR = J == 2 && MOTOR == 0;
    const Motion<S> m = motion_of(J, x, x + J);
    Assembler<S> sum(c.p);
    Law::law(m, c.g, sum);
    const S torque =
        S(clamp(u[0], U(-c.u_max), U(c.u_max))) - motor_friction(c, m.v[MOTOR], S(1.0));
    S a[2], r1 = -sum.f1, r2 = SECOND_MOTOR ? S(u[1]) - sum.f2 : -sum.f2;
    (MOTOR == 0 ? r1 : r2) += torque;
    solve_joints(J, sum.m11, sum.m12, sum.m22, r1, r2, a);
    if constexpr (J == 2)
        write(dx, m.v[0], m.v[1], a[0], a[1]);
    else
        dx[0] = m.v[0], dx[1] = a[0];
}

// dx/dt with the law known at compile time; *power (if wanted) is what the motors put in.
template <class Law, class S, class U>
inline void rhs_of(const Compiled<S> &c, const U &t, const S *x, const U *u, S *dx,
                   S *power = nullptr)
{
    if (c.effect_count == 0 && !power) {
        bare_rhs_of<Law>(c, x, u, dx);
        return;
    }
    Frame<S> f;
    frame_begin(f, c, t, x, u);
    Assembler<S> sum(c.p);
    Law::law(f.m, c.g, sum);
    f.motor_torque = f.command[0] - motor_friction(c, f.motor_speed, f.coulomb_scale);
    if (power)
        *power = f.command[0] * f.motor_speed + f.command[1] * f.m.v[1];
    f.tau[0] = S(0.0);
    f.tau[1] = f.command[1];
    if (!f.motor_detached)
        f.tau[c.motor] += f.motor_torque;
    f.m11 = sum.m11, f.m12 = sum.m12, f.m22 = sum.m22;
    for (int i = 0; i < c.effect_count; i++) {
        const EffectOps<S> &ops = effect_ops<S>(c.at(i).index);
        EffectArgs<S> e = args_of(c.at(i), x);
        if (ops.torque)
            ops.torque(f, e);
        if (ops.inertia)
            ops.inertia(f, e);
    }
    S r1 = f.tau[0] - sum.f1, r2 = f.tau[1] - sum.f2;
    if (f.base_moves) {
        r1 -= sum.m11 * f.base_acceleration;
        r2 -= sum.m12 * f.base_acceleration;
    }
    constexpr int J = Law::joints;
    solve_joints(J, f.m11, f.m12, f.m22, r1, r2, f.a);
    if constexpr (J == 2)
        write(dx, x[2], x[3], f.a[0], f.a[1]);
    else
        dx[0] = x[1], dx[1] = f.a[0];
    for (int i = 0; i < c.effect_count; i++)
        if (auto *stage = effect_ops<S>(c.at(i).index).derivative)
            stage(f, args_of(c.at(i), x), dx + c.at(i).state);
}

template <class S>
inline void rhs(const Compiled<S> &c, const S &t, const S *x, const S *u, S *dx, S *power = nullptr)
{
    with_plant(c.plant, [&](auto law) { rhs_of<decltype(law)>(c, t, x, u, dx, power); });
}

// Switching functions at a state.
template <class S, class U>
inline void events(const Compiled<S> &c, const U &t, const S *x, S *g)
{
    Frame<S> f;
    U u[MK_MAX_INPUTS] = {U(0.0), U(0.0)};
    frame_begin(f, c, t, x, u);
    for (int i = 0; i < c.effect_count; i++)
        if (auto *stage = effect_ops<S>(c.at(i).index).events)
            stage(f, args_of(c.at(i), x), g + c.at(i).event);
}

// The fastest rate that effects bring in at a state, 1/s.
template <class S, class U>
inline double fastest_rate(const Compiled<S> &c, const U &t, const S *x)
{
    Frame<S> f;
    U u[MK_MAX_INPUTS] = {U(0.0), U(0.0)};
    frame_begin(f, c, t, x, u);
    double fastest = 0.0;
    for (int i = 0; i < c.effect_count; i++)
        if (auto *rate = effect_ops<S>(c.at(i).index).rate) {
            double r = rate(f, args_of(c.at(i), x));
            fastest = r > fastest ? r : fastest;
        }
    return fastest;
}

template <class S, class U>
inline void measure(const Compiled<S> &c, const U &t, const S *x, S *y)
{
    bool plain = true;
    for (int i = 0; i < c.effect_count; i++)
        plain = plain && !effect_ops<S>(c.at(i).index).measure;
    for (int j = 0; j < c.joints; j++)
        y[j] = x[j];
    if (plain)
        return;
    Frame<S> f;
    U u[MK_MAX_INPUTS] = {U(0.0), U(0.0)};
    frame_begin(f, c, t, x, u);
    for (int i = 0; i < c.effect_count; i++)
        if (auto *stage = effect_ops<S>(c.at(i).index).measure)
            stage(f, args_of(c.at(i), x), y);
}

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
