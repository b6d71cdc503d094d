// The two weak forms of a plant: its torque equations, and its balance of energy.
#include <algorithm>
#include <cmath>

#include "ident/weak.hpp"
#include "model/dual.hpp"
#include "model/plants.hpp"

namespace mk
{

namespace
{

constexpr int N = MK_MAX_JOINTS;

struct State {
    double q[N] = {}, v[N] = {}, a[N] = {};

    State(const Track &t, size_t k)
    {
        for (int j = 0; j < t.joints; j++)
            q[j] = t.q[j][k], v[j] = t.v[j][k], a[j] = t.a[j][k];
    }
};

// Mean of the command around a row: half of the hold on either side.
double around(const std::vector<double> &u, size_t k)
{
    return u.empty() ? 0.0 : 0.5 * (u[k] + u[k > 0 ? k - 1 : 0]);
}

// --- torques ---------------------------------------------------------------------------------

// Derivatives of D a + h by angles, speeds and accelerations, in this order.
void derivatives(const mk_model &model, const State &s, int joints, WeakSample &out)
{
    using D = Dual<2 * N>;
    const mk_plant_info *plant = mk_plant(model.plant);
    D p[MK_MAX_PARAMETERS], q[N], v[N];
    std::copy_n(model.parameter, plant->parameter_count, p);
    for (int j = 0; j < joints; j++)
        q[j] = D::variable(s.q[j], j), v[j] = D::variable(s.v[j], N + j);
    Assembler<D> sum(p);
    auto motion = motion_of(joints, q, v);
    with_plant(model.plant, [&](auto law) { law.law(motion, model.g, sum); });
    D torque[N] = {sum.m11 * s.a[0] + sum.m12 * s.a[1] + sum.f1,
                   sum.m12 * s.a[0] + sum.m22 * s.a[1] + sum.f2};
    const D &turn = v[plant->motor_joint];
    torque[plant->motor_joint] +=
        p[plant->mass_count] * turn +
        p[plant->mass_count + 1] * smooth_sign(model.friction_sharpness, turn);
    const double mass[N][N] = {{sum.m11.v, sum.m12.v}, {sum.m12.v, sum.m22.v}};
    for (int e = 0; e < joints; e++)
        for (int j = 0; j < joints; j++) {
            out.flow_q[e][j] = torque[e].d[j];
            out.flow_v[e][j] = torque[e].d[N + j];
            out.flow_a[e][j] = mass[e][j];
        }
}

void torque_sample(const mk_model &model, const Track &t, size_t k, WeakSample &out)
{
    const mk_plant_info *plant = mk_plant(model.plant);
    double phi[N * MK_MAX_PARAMETERS];
    State s(t, k);
    mk_plant_regressor(&model, s.q, s.v, s.a, phi);
    for (int j = 0; j < t.joints; j++)
        std::copy_n(phi + j * plant->parameter_count, plant->parameter_count, out.flow[j]);
    out.source[plant->motor_joint] = around(t.u[0], k);
    out.source[1] += around(t.u[1], k);
    derivatives(model, s, t.joints, out);
}

// --- energy ----------------------------------------------------------------------------------

// Kinetic energy is half of D v . v: the mass matrix's terms at a = v.
template <class S>
struct KineticTerms {
    S v1, v2;
    S term[MK_MAX_PARAMETERS] = {};
    void d11(int i) { term[i] += 0.5 * v1 * v1; }
    void d12(int i) { term[i] += v1 * v2; }
    void d22(int i) { term[i] += 0.5 * v2 * v2; }
    void d11(int i, const S &c) { term[i] += 0.5 * c * v1 * v1; }
    void d12(int i, const S &c) { term[i] += c * v1 * v2; }
    void d22(int i, const S &c) { term[i] += 0.5 * c * v2 * v2; }
    void h1(int, const S &) {}
    void h2(int, const S &) {}
};

// Energy by parameter, with derivatives by angles and speeds.
void stored(const mk_model &model, const State &s, int joints, WeakSample &out)
{
    using D = Dual<2 * N>;
    int count = mk_plant(model.plant)->parameter_count;
    D q[N], v[N], unit[MK_MAX_PARAMETERS];
    for (int j = 0; j < joints; j++)
        q[j] = D::variable(s.q[j], j), v[j] = D::variable(s.v[j], N + j);
    KineticTerms<D> kinetic{v[0], v[1]};
    auto motion = motion_of(joints, q, v);
    with_plant(model.plant, [&](auto law) { law.law(motion, model.g, kinetic); });
    for (int i = 0; i < count; i++) {
        unit[i] = 1.0;
        D energy = kinetic.term[i] + with_plant(model.plant, [&](auto law) {
                       return law.potential(unit, q, model.g);
                   });
        unit[i] = 0.0;
        out.stock[i] = energy.v;
        for (int j = 0; j < joints; j++) {
            out.stock_q[j] += model.parameter[i] * energy.d[j];
            out.stock_v[j] += model.parameter[i] * energy.d[N + j];
        }
    }
}

// Sums of the balance by parts stand for differences from the row before to the row after, so what
// flows is the mean over that time. The command's work is the held command times the way: exact,
// however fast the joint turns.
double power(const Track &t, const std::vector<double> &u, int joint, size_t k)
{
    if (u.empty())
        return 0.0;
    size_t before = k > 0 ? k - 1 : 0, after = std::min(k + 1, t.rows() - 1);
    const std::vector<double> &q = t.q[joint];
    return (u[k] * (q[after] - q[k]) + u[before] * (q[k] - q[before])) /
           (t.period * (double)(after - before));
}

struct Loss {
    double viscous, coulomb; // for a parameter of 1
};

Loss loss_at(double sharpness, double speed)
{
    return {speed * speed, speed * smooth_sign(sharpness, speed)};
}

// By Simpson's rule; at a log's ends by the trapezoidal one.
Loss loss_around(double sharpness, const std::vector<double> &v, size_t k)
{
    size_t before = k > 0 ? k - 1 : 0, after = std::min(k + 1, v.size() - 1);
    Loss a = loss_at(sharpness, v[before]), b = loss_at(sharpness, v[k]),
         c = loss_at(sharpness, v[after]);
    double middle = after - before == 2 ? 4.0 : 0.0, all = middle + 2.0;
    return {(a.viscous + middle * b.viscous + c.viscous) / all,
            (a.coulomb + middle * b.coulomb + c.coulomb) / all};
}

// d/dt (T + V) + friction's loss = motors' power.
void energy_sample(const mk_model &model, const Track &t, size_t k, WeakSample &out)
{
    const mk_plant_info *plant = mk_plant(model.plant);
    int m = plant->motor_joint, f = plant->mass_count;
    State s(t, k);
    stored(model, s, t.joints, out);
    double speed = s.v[m], sharpness = model.friction_sharpness,
           sign = smooth_sign(sharpness, speed);
    Loss loss = loss_around(sharpness, t.v[m], k);
    out.flow[0][f] = loss.viscous;
    out.flow[0][f + 1] = loss.coulomb;
    out.source[0] = power(t, t.u[0], m, k) + power(t, t.u[1], 1, k);
    out.flow_v[0][m] = 2.0 * model.parameter[f] * speed +
                       model.parameter[f + 1] * (sign + sharpness * speed * (1.0 - sign * sign)) -
                       around(t.u[0], k);
    out.flow_v[0][1] -= around(t.u[1], k);
}

} // namespace

WeakForm torque_equations(const mk_model &model)
{
    return {mk_model_joints(&model), false, torque_sample};
}

WeakForm energy_balance(const mk_model &)
{
    return {1, true, energy_sample};
}

} // namespace mk
