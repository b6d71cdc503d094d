// A free run of a model over a window of a log, from the state that fits the window's readings
// best.
#ifndef MECHKIT_SIM_WINDOW_FIT_HPP
#define MECHKIT_SIM_WINDOW_FIT_HPP

#include <Eigen/Dense>
#include <vector>

#include "sim/shoot.hpp"
#include "sim/start_state.h"

// A log as free runs see it, and the model.
struct mk_start_finder {
    const mk_record *record;
    const mk_model *model; // may be exchanged for one of the same structure
    std::vector<double> t, u[MK_MAX_INPUTS], w[MK_MAX_JOINTS];
    double oldest = 0.0; // age of the oldest reading (sensor delays), s
    mk::ShootData data;
};

namespace mk
{

// What the readings of a window say about what a run starts from and about some parameters.
struct WindowNormal {
    Eigen::MatrixXd H; // J'J, columns: start state, then parameters
    Eigen::VectorXd g; // J'r
    double squares;    // r'r
    size_t readings;
};

class WindowFit
{
  public:
    // Rows [from_row, to_row).
    WindowFit(const mk_start_finder &finder, size_t from_row, size_t to_row);
    // Columns of the normal equations beyond the start state: parameters by number, and the units
    // of their derivatives. Both must outlive the fit.
    void differentiate_by(const std::vector<int> &parameters, const std::vector<double> &units);

    // From x to the least squares over the window; hidden states near those of x. False, and x as
    // it was, if the model runs away from there even over a short beginning.
    bool solve(Eigen::VectorXd &x);
    // Sum of squares over the window; infinite where the model runs away.
    double cost(const Eigen::VectorXd &x);
    // The normal equations about the trajectory from x, what is known of hidden states included.
    bool normal_at(const Eigen::VectorXd &x, WindowNormal &out);
    // Where the trajectory from x is at a row.
    bool carry(Eigen::VectorXd &x, size_t row);

  private:
    const mk_start_finder &f;
    const int ns;
    size_t from, to;
    const std::vector<int> *free = nullptr;
    const std::vector<double> *unit = nullptr;
    std::vector<double> residual, jac, x_end, jac_end;

    bool descend(Eigen::VectorXd &x, const Eigen::VectorXd &known, size_t last, double settled);
    bool normal_equations(const Eigen::VectorXd &x, const Eigen::VectorXd &known, size_t last,
                          WindowNormal &out);
    bool linearise(const Eigen::VectorXd &x, size_t last, bool parameters, WindowNormal &out);
    ShootTask task_from(const Eigen::VectorXd &x, double end, int columns);
};

// Angles and speeds by polynomial at `row`, no reading at `last` or later; states of effects by a
// run of the model up to there. False where there are too few readings.
bool first_guess(const mk_start_finder &f, size_t last, size_t row, Eigen::VectorXd &x);

} // namespace mk
#endif
