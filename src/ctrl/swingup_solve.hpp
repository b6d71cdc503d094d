// A swing-up of fixed duration as an optimal control problem, and its solution.
//
// The command is held for n intervals of h seconds. With x_0 at hanging rest and x_{k+1} = F(x_k,
// u_k),
//
//     minimise  J = sum_k h [ r/2 (u_k / u_lim)^2 + p(x_k) ]     subject to  |u_k| <= u_lim,  x_n =
//     goal,
//
// where p penalises joints beyond their travel and speed. r only makes the solution unique: a
// swing-up exists for the duration n h where the constraint x_n = goal can be met, and the shortest
// such duration is the time-optimal swing-up of this sampled command.
//
// Solved by differential dynamic programming with the command's bound in the backward pass (Tassa,
// Mansard and Todorov, Control-limited differential dynamic programming, ICRA 2014) and an
// augmented Lagrangian for the goal (Howell, Jackson and Manchester, ALTRO, IROS 2019). Second
// derivatives of F are left out (Gauss-Newton).
#ifndef MECHKIT_CTRL_SWINGUP_SOLVE_HPP
#define MECHKIT_CTRL_SWINGUP_SOLVE_HPP

#include "ctrl/observer.h"
#include "mechkit/model.h"

#include <Eigen/Core>
#include <vector>

namespace mk::swing
{

using State = Eigen::Matrix<double, MK_CTRL_STATES, 1>;
using StateMatrix = Eigen::Matrix<double, MK_CTRL_STATES, MK_CTRL_STATES>;

// Of the trajectories that are handed out: an unstable motion multiplies what a step is off by.
constexpr double FINE_STEP_S = 5e-4;

// A textbook plant under a command, as the problem sees it.
struct Dynamics {
    mk_model model; // no effects, no limit of its own to the command
    int motor;      // 0-based joint
    double step_s;  // the longest Runge-Kutta step

    // Steps of at most `longest_s`, and short enough for the motor's friction.
    explicit Dynamics(const mk_model &nominal, double longest_s = FINE_STEP_S);
    // x after h seconds under the command u, by equal Runge-Kutta steps of order 4.
    State move(const State &x, double u, double h) const;
    // The same, with a = dx+/dx and b = dx+/du.
    State move(const State &x, double u, double h, StateMatrix &a, State &b) const;
};

struct Problem {
    const Dynamics *dynamics;
    State start, goal;
    State unit;        // sizes by which the error at the goal is divided; infinite: does not count
    State low, high;   // joints' travel and speed; infinite: no limit
    double limit;      // of |u|
    double h;          // s
    double smoothness; // r, 1/s; 1 is much, 0.01 little
};

struct Path {
    std::vector<double> u;  // n
    std::vector<State> x;   // n + 1
    double miss = HUGE_VAL; // largest error at the goal, in units
    double excess = 0.0;    // largest excess of a limit of travel or speed, in units
};

// Improves `path` (its u is the first guess, its x is computed) until the goal is met to
// `tolerance` units or no more is gained. True when it is met within the limits.
bool solve(const Problem &problem, double tolerance, int iterations, Path &path);

// The states along path.u.
void run(const Problem &problem, Path &path);

} // namespace mk::swing

#endif
