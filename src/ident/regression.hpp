// Linear regression on a plant's equations in weak form: what the linear methods share. A method is
// how rows are weighted; the table of them is identify.cpp's, each in its own file.
#ifndef MECHKIT_IDENT_REGRESSION_HPP
#define MECHKIT_IDENT_REGRESSION_HPP

#include <Eigen/Core>

#include "ident/method.hpp"
#include "ident/weak.hpp"

namespace mk
{

// Equations x equations, no heap.
using Block =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, MAX_EQUATIONS, MAX_EQUATIONS>;

// What is known about the errors of one row's equations.
struct RowNoise {
    Block full;     // B sigma^2 B^T of the report's (3.8): covariance, everything propagated
    Block angles;   // the same of the angles' errors alone
    Block residual; // mean square of what the round before left; identity in the first
};

struct LinearMethod {
    bool energy; // on the balance of energy instead of the torque equations
    int rounds;  // least squares, each weighted at the parameters of the one before; 2 at least
    // Whole covariance, of rows that share readings too: the maximum likelihood of Olsen and
    // Petersen. `weight` is not asked then.
    bool whole;
    Block (*weight)(const RowNoise &noise);
};

enum mk_status regress(const LinearMethod &method, const IdentProblem &problem,
                       mk_ident_result &result, mk_error *err);

} // namespace mk
#endif
