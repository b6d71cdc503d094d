// What the files of a fit share. Private to them.
#ifndef MECHKIT_IDENT_FIT_PRIV_HPP
#define MECHKIT_IDENT_FIT_PRIV_HPP

#include "ident/fit.hpp"

namespace mk
{

constexpr double SHORTER = 0.4; // from one step length to the next

// Standard deviation of the prior on the state of an effect at the start of a log, in the state's
// own unit (rad, rad/s) and times state_freedom(). The prior's mean is the effect's state at rest.
constexpr double HIDDEN_STD = 0.05;

// Factors on the standard deviations of the states: 1 for angles and speeds, less for the states of
// a moving base, and the joint's scale for the states of an effect at a joint (0.01 where it slides
// and states are in m).
Eigen::VectorXd state_freedom(const mk_model &model);

// The covariance of what `information` belongs to.
Eigen::MatrixXd inverse_of(const Eigen::MatrixXd &information);

// One log as the kernel takes it.
struct Fit::LogData {
    ShootData shoot;
    mk_model model; // with the log's own values, where there are any
    std::vector<double> weight[MK_MAX_JOINTS];
};

// One shooting interval: what shooting gave, compressed to normal equations in (start state,
// parameters).
struct Fit::Segment {
    double begin = 0.0, end = 0.0;
    bool last = false, finite = false;
    double doubt[MK_MAX_JOINTS] = {0.0, 0.0}; // of the speeds, from the command's: variance
    Eigen::VectorXd x_end;
    Eigen::MatrixXd jac_end; // d x_end / d (state, parameters)
    // Of the readings of each joint, at the noise of Fit::slopes: J'J, J'r.
    Eigen::MatrixXd normal[MK_MAX_JOINTS];
    Eigen::VectorXd right[MK_MAX_JOINTS];
    std::vector<double> residual;
    std::vector<int> joint;
    double sum2[MK_MAX_JOINTS] = {0.0, 0.0};
    double cost = 0.0, effort = 0.0;
    // From the elimination, for the way back.
    Eigen::MatrixXd F, P, C, A_next, G;
    Eigen::VectorXd a, mu;
};

// The own values of one source, beside the quadratic of its logs in the free parameters p:
//     p' D p / 2 - d' p ,  D and d with the logs' states eliminated.
// An own value b adds to its mean, so that it sees the same derivatives: with E the columns of the
// means, p stands for p + E b here, and b has the prior b0 + b ~ N(0, spread^2).
struct Fit::Source {
    Eigen::MatrixXd D;
    Eigen::VectorXd d;
    std::vector<long> place;   // of each own value's mean among the free parameters
    std::vector<size_t> which; // and the own value's number
    // After elimination: b = P (beta - K' p), P = (E'DE + 1/spread^2)^-1, K = D E.
    Eigen::MatrixXd P, K;
    Eigen::VectorXd beta;
};

// What short steps change in a shooting interval.
struct Correction {
    Eigen::VectorXd x_end;
    std::vector<double> residual; // rad
};
struct Fit::Corrections {
    double step = 0.0; // the long one, s
    std::vector<std::vector<Correction>> by_log;
};

// The point, the columns and the correction with which derivatives were taken.
struct Fit::Slopes {
    FitPoint point;
    std::vector<int> free;
    std::shared_ptr<const Corrections> correction;
};

} // namespace mk
#endif
