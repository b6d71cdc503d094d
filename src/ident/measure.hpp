// One simple experiment: a row of the table in measure.cpp.
#ifndef MECHKIT_IDENT_MEASURE_HPP
#define MECHKIT_IDENT_MEASURE_HPP

#include <Eigen/Core>
#include <string>
#include <vector>

#include "mechkit/measure.h"
#include "mechkit/sim.h"
#include "model/plants.hpp"

namespace mk
{

struct MeasureProblem {
    mk_model model;
    std::vector<const mk_log *> logs;
    std::vector<mk_record> records; // one a log
    mk_measure_options options;
};

struct Measure {
    mk_measure_info info;
    enum mk_status (*run)(const MeasureProblem &problem, mk_measurement &out, mk_error *err);
};

extern const Measure measure_friction, measure_inertia, measure_swing, measure_torque;

// --- what they share ---

// A stretch of a log that a polynomial of second degree in time describes.
struct Section {
    size_t log;
    double begin, end;     // s
    double q, v, a;        // in its middle
    double u;              // mean command
    double v_begin, v_end; // at its ends
    double misfit;         // rms of the readings to the polynomial, rad
};

// Cuts the logs into pieces of `seconds`, readings of joint 1. Pieces with dropped samples at their
// ends or with fewer than 8 readings are left out.
std::vector<Section> cut(const MeasureProblem &problem, double seconds);

// Weighted mean and its error: the larger of what the single errors make and what the scatter
// shows.
mk_quantity weighted_mean(const std::vector<double> &value, const std::vector<double> &error);

// Least squares; covariance from the residuals' scatter. Columns without data make it fail.
struct Regressed {
    Eigen::VectorXd value, residual;
    Eigen::MatrixXd covariance;
    bool determined;
};
Regressed regress_plain(const Eigen::MatrixXd &x, const Eigen::VectorXd &y);

void add_quantity(mk_measurement &out, const char *name, const char *unit, double value,
                  double std_error, double given);
void add_run(mk_measurement &out, size_t log, double begin, double end, double x, double y,
             double misfit);
void add_warning(mk_measurement &out, const std::string &text);

} // namespace mk
#endif
