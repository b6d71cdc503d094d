// What the files of free runs share. Private to them.
#ifndef MECHKIT_IDENT_FREE_RUNS_PRIV_HPP
#define MECHKIT_IDENT_FREE_RUNS_PRIV_HPP

#include "ident/free_runs.hpp"

namespace mk
{

// Variance of a reading that is rounded to counts, counts^2: uniform over one count.
constexpr double ROUNDING = 1.0 / 12.0;
// Damping relative to the diagonal: parameters may be collinear.
constexpr double TRACE = 1e-6;

// Places of the wanted parameters among the free ones.
std::vector<long> columns_of(const std::vector<int> &wanted, const std::vector<int> &free);

// rho'(e) of a window's mean squared error e in units of the usual one: its weight in iteratively
// reweighted least squares.
double weight_of(double e);

// p'Ap/2 - a'p of a fold in the wanted parameters, and what own values b make of it: b = M (beta -
// K'p) once they are eliminated.
struct FreeRuns::Normal {
    Eigen::MatrixXd A;
    Eigen::VectorXd a;
    Eigen::MatrixXd M, K;
    Eigen::VectorXd beta;
};

// A step: in the stepper's coordinates, as scaled parameters see it, and of the own values.
struct FreeRuns::Step {
    Eigen::VectorXd coordinates, scaled; // of the parameters
    std::vector<Eigen::VectorXd> own;    // by fold, scaled
};

} // namespace mk
#endif
