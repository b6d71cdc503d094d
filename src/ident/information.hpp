// What an experiment would tell: the covariance that parameters estimated from it can have at best
// (Cramer-Rao), from the model alone. The start state counts as unknown, and the rig as driven by a
// little process noise: what a chaotic motion would tell through its memory of long ago is not
// counted, for no real rig follows a model that long.
#ifndef MECHKIT_IDENT_INFORMATION_HPP
#define MECHKIT_IDENT_INFORMATION_HPP

#include <Eigen/Core>
#include <vector>

#include "mechkit/model.h"

namespace mk
{

struct InformationOptions {
    double noise[MK_MAX_JOINTS]; // standard deviation of a reading, rad
    double readings_a_row = 1.0; // readings that one row stands for
    double process_noise = 1e-3; // process noise of the speeds, rad/s per sqrt(s)
    double interval = 0.25;      // s between its pushes
    double step = 5e-3;          // longest integration step, s
};

// The experiment as predicted. Empty covariance: the trajectory ran away.
struct PredictedExperiment {
    // Of the free parameters, each over its scale (Fit::scale_of): standard errors are relative.
    Eigen::MatrixXd covariance;
    // Of the sensitivity matrix, in the parameters' units and with columns of unit norm.
    double condition = 0.0, condition_scaled = 0.0;
    std::vector<double> q[MK_MAX_JOINTS]; // readings at the rows, rad
    double q_min[MK_MAX_JOINTS] = {}, q_max[MK_MAX_JOINTS] = {}, v_max[MK_MAX_JOINTS] = {};

    bool finite() const { return covariance.size() > 0; }
};

// From rest, hanging. `u` is held from row to row, `period` s apart. Re-entrant.
PredictedExperiment predict_experiment(const mk_model &model, const std::vector<double> &u,
                                       double period, const std::vector<int> &free,
                                       const InformationOptions &options);

} // namespace mk
#endif
