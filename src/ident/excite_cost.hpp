// What a trajectory or an input is worth, and by how much it leaves its limits.
#ifndef MECHKIT_IDENT_EXCITE_COST_HPP
#define MECHKIT_IDENT_EXCITE_COST_HPP

#include <Eigen/Core>

#include "ident/information.hpp"
#include "ident/waveforms.hpp"
#include "mechkit/excite.h"

namespace mk
{

struct Extent {
    double q_min[MK_MAX_JOINTS] = {}, q_max[MK_MAX_JOINTS] = {}, v_max[MK_MAX_JOINTS] = {};
};
Extent extent_of(const PredictedExperiment &f);

// By how much of itself a value lies beyond a limit.
double excess(double value, double limit);
// The same of all angles (by their range) and speeds, summed.
double beyond_limits(const mk_model &model, const mk_excite_options &o, const Extent &e);

// A one-joint plant led along a series for one period: its regressor, squared and summed.
struct Led {
    Eigen::MatrixXd normal;
    Extent extent;
    double u_max = 0.0; // command that the motion needs

    double condition(bool scaled) const; // of the regressor, columns of unit norm or as they are
};
Led lead(const mk_model &model, const Series &series, int points);

// Of the covariance of relative errors.
double value_of(enum mk_excite_criterion criterion, const Eigen::MatrixXd &covariance);

} // namespace mk
#endif
