// What the files of a fit share. Private to them.
#ifndef MECHKIT_IDENT_FIT_PRIV_HPP
#define MECHKIT_IDENT_FIT_PRIV_HPP

#include "ident/fit.hpp"

namespace mk
{

constexpr double SHORTER = 0.4; // from one step length to the next

// One log as the kernel takes it.
struct Fit::LogData {
    ShootData shoot;
    std::vector<double> weight[MK_MAX_JOINTS];
};

// One stretch: what shooting gave, compressed to normal equations in (start state, parameters).
struct Fit::Segment {
    double begin = 0.0, end = 0.0;
    bool last = false, finite = false;
    double doubt[MK_MAX_JOINTS] = {0.0, 0.0}; // of the speeds, from the command's: variance
    Eigen::VectorXd x_end;
    Eigen::MatrixXd jac_end; // d x_end / d (state, parameters)
    Eigen::MatrixXd normal;  // J'J
    Eigen::VectorXd right;   // J'r
    std::vector<double> residual;
    std::vector<int> joint;
    double sum2[MK_MAX_JOINTS] = {0.0, 0.0};
    double cost = 0.0, effort = 0.0;
    // From the elimination, for the way back.
    Eigen::MatrixXd F, P, C, A_next, G;
    Eigen::VectorXd a, mu;
};

// What short steps change in a stretch.
struct Correction {
    Eigen::VectorXd x_end;
    std::vector<double> residual; // rad
};
struct Fit::Corrections {
    double step = 0.0; // the long one, s
    std::vector<std::vector<Correction>> by_log;
};

} // namespace mk
#endif
