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
    // The same for several windows of one log, whose trajectories are integrated side by side.
    // Which of them were solved.
    static std::vector<char> solve(std::vector<WindowFit> &fits, std::vector<Eigen::VectorXd> &x);
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

    // Where the search for a window's start state is: which trajectory it wants next.
    struct Progress {
        Eigen::VectorXd known;     // where it began
        Eigen::VectorXd best;      // of the horizons so far
        Eigen::VectorXd at, trial; // of this horizon, and where it looks next
        WindowNormal now;          // about `at`
        double horizon, damping;   // s, Levenberg's
        size_t last;               // row behind the horizon
        int steps;                 // of this horizon
        bool begun;                // `now` is known
        bool whole, running, any;  // the horizon is the window; it goes on; one was solved
    };
    Progress begin(const Eigen::VectorXd &x) const;
    void begin_horizon(Progress &p) const;
    void end_horizon(Progress &p) const;
    void propose(Progress &p) const;
    void take(const ShootTask &task, Progress &p) const;
    void add_known(const Progress &p, WindowNormal &out) const;
    ShootTask task_over(const Eigen::VectorXd &x, size_t last, int columns);
    bool normal_of(const ShootTask &task, WindowNormal &out) const;
    bool linearise(const Eigen::VectorXd &x, size_t last, bool parameters, WindowNormal &out);
    ShootTask task_from(const Eigen::VectorXd &x, double end, int columns);
};

// Angles and speeds by polynomial at `row`, no reading at `last` or later; states of effects by a
// run of the model up to there. False where there are too few readings.
bool first_guess(const mk_start_finder &f, size_t last, size_t row, Eigen::VectorXd &x);

} // namespace mk
#endif
