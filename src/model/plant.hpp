// What plants are written with: the motion that a law sees, the sinks that take its terms, and what
// a plant has unless it says otherwise.
//
// A plant is one struct in its own file (plant_<name>.hpp), an include and a row in plants.hpp.
// Every plant is linear in its base parameters p_i and in its accelerations:
//     sum_i p_i (D_i(q) a + h_i(q, v)) = right-hand side,
// so a law states, term by term, what p_i is multiplied with: entries of the symmetric mass matrix
// (d11, d12, d22) and of h = C v + G (h1, h2). A "sink" receives the terms: Assembler sums them to
// D and h, Regressor keeps them apart as columns of Phi. Rows are in Lagrangian form: row j is the
// equation of the generalised coordinate q_j, so a torque inside joint j appears in row j alone.
//
// Friction of the motor joint has the same form on every plant (the two parameters behind those of
// masses) and is added by the model (rhs.hpp): what turns with the motor's shaft need not be the
// joint (backlash).
//
// A plant states
//     info                   its row: mechkit/model.h says what each field means. The first
//                            parameter is an inertia (a mass, of a joint that slides) that the
//                            torques can be counted in: it holds the scale where no command acts,
//                            and a base that rocks is pushed by the motor's torque over it. The
//                            rest is where the potential is lowest, and flat just where a joint is
//                            level or a wheel.
//     joints                 1 or 2, known when the kernels are compiled
//     law, potential         the equations of motion
//     bearing_load           the force that the bearing of the passive joint takes along the link
//                            that hangs on it, outwards positive, times the lever of that link's
//                            centre of mass: of a point mass that swings as the link does, from its
//                            weight and from what holds it on its path. The part of the other
//                            joint's acceleration, which friction itself would change, is left out.
//                            0 without a passive joint.
//     body_inertia(p, j)     about what a force at joint j has to move, for starts of a search
//     least_inertia(p, j)    the least inertia that a force at joint j meets, over all positions
//     gap_inertia(p, j)      the inertia of which backlash at joint j cuts a share off
// and, where the default of `Plant` is not right, mass_sides, tilt, free_link, swing, sketch.
#ifndef MECHKIT_MODEL_PLANT_HPP
#define MECHKIT_MODEL_PLANT_HPP

#include "mechkit/model.h"
#include "model/plant_facts.h"
#include "model/scalar.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

// What a law sees of the motion. w1 and qg1 differ from v[0] and q[0] only on a base that moves or
// is tilted.
template <class S>
struct Motion {
    S q[2], v[2]; // joint angles and speeds
    S w1;         // inertial speed of joint 1's body
    S qg1;        // angle of joint 1's body against gravity, in the convention of q1
};

template <class S>
inline void set_motion(Motion<S> &m, int joints, const S *q, const S *v)
{
    m.q[0] = q[0];
    m.v[0] = v[0];
    if (joints > 1) {
        m.q[1] = q[1];
        m.v[1] = v[1];
    } else {
        m.q[1] = m.v[1] = S(0.0);
    }
    m.w1 = v[0];
    m.qg1 = q[0];
}
template <class S>
inline Motion<S> motion_of(int joints, const S *q, const S *v)
{
    Motion<S> m;
    set_motion(m, joints, q, v);
    return m;
}

// --- sinks ---------------------------------------------------------------------------------------

template <class S>
struct Assembler {
    const S *p;
    S m11 = S(0.0), m12 = S(0.0), m22 = S(0.0), f1 = S(0.0), f2 = S(0.0);
    explicit Assembler(const S *parameters) : p(parameters) {}
    void d11(int i) { m11 += p[i]; }
    void d12(int i) { m12 += p[i]; }
    void d22(int i) { m22 += p[i]; }
    void d11(int i, const S &c) { add_product(m11, p[i], c); }
    void d12(int i, const S &c) { add_product(m12, p[i], c); }
    void d22(int i, const S &c) { add_product(m22, p[i], c); }
    void h1(int i, const S &c) { add_product(f1, p[i], c); }
    void h2(int i, const S &c) { add_product(f2, p[i], c); }
};

template <class S>
struct Regressor {
    S a1, a2;
    S phi[2][MK_MAX_PARAMETERS] = {};
    Regressor(const S &acc1, const S &acc2) : a1(acc1), a2(acc2) {}
    void d11(int i) { phi[0][i] += a1; }
    void d12(int i) { phi[0][i] += a2, phi[1][i] += a1; }
    void d22(int i) { phi[1][i] += a2; }
    void d11(int i, const S &c) { phi[0][i] += c * a1; }
    void d12(int i, const S &c) { phi[0][i] += c * a2, phi[1][i] += c * a1; }
    void d22(int i, const S &c) { phi[1][i] += c * a2; }
    void h1(int i, const S &c) { phi[0][i] += c; }
    void h2(int i, const S &c) { phi[1][i] += c; }
};

// --- what a plant has unless it says otherwise ---------------------------------------------------

struct Plant {
    // The mass matrix is positive definite everywhere where sides[0] > sides[1].
    static void mass_sides(const double *, double sides[2]) { sides[0] = 1.0, sides[1] = 0.0; }
    // Adds to tau what gravity does beyond the law when the base is tilted by e[0]; `e` are the
    // parameters of base-tilt. Where the law takes its gravity from qg1, which has been turned
    // already, nothing.
    template <class S>
    static void tilt(const Motion<S> &, const S *, double, const S *, S *)
    {
    }
    // The free link as a pendulum whose pivot the motor moves; false: there is none.
    static bool free_link(const double *, double, const double *, mk_free_link *) { return false; }
    // The plant as a pendulum that swings freely; false: it does not.
    static bool swing(const double *, double, mk_free_swing *) { return false; }
};

// A constant of the rows.
constexpr double PLANT_PI = 3.14159265358979323846;
constexpr double PLANT_INF = MK_PARAMETER_MOST;
constexpr double PLANT_TINY = 1e-12; // "positive": an inertia of zero makes no mass matrix
// Safety limits of a joint. A driven link carries the cable of the encoder behind it; a free link
// has a slip ring or no cable at all. A wheel at full command ends where friction or voltage holds
// it; links fall and swing.
constexpr double PLANT_CABLE_TRAVEL = 6.0 * PLANT_PI, PLANT_FREE_TRAVEL = 20.0 * PLANT_PI; // rad
constexpr double PLANT_LINK_SPEED = 60.0, PLANT_WHEEL_SPEED = 900.0;                       // rad/s

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
