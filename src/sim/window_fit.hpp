// A free run of a model over a window of a log, from the state that fits the window's readings
// best.
#ifndef MECHKIT_SIM_WINDOW_FIT_HPP
#define MECHKIT_SIM_WINDOW_FIT_HPP

#include <Eigen/Core>
#include <algorithm>
#include <memory>
#include <vector>

#include "sim/shoot.hpp"
#include "sim/start_state.h"

namespace mk
{
// Angles and speeds by polynomial at rows of a log that are a few hundredths of a second apart.
struct Way {
    std::vector<size_t> row;
    std::vector<size_t> begin; // row where the readings begin that lead there without a hole
    std::vector<Eigen::VectorXd> x;
    // The last place at or before a row; the first one of a row before all. There must be one.
    size_t place_before(size_t to) const
    {
        const auto after = std::upper_bound(row.begin(), row.end(), to);
        return after == row.begin() ? 0 : (size_t)(after - row.begin()) - 1;
    }
};
// What a model's effects remember along a way (sim/effect_memory.hpp).
struct Memory {
    Eigen::MatrixXd z;     // states of effects by place
    Eigen::MatrixXd slope; // and their derivatives by p parameters: p columns a place
    Eigen::VectorXd usual; // rms of each state about its mean; empty: nothing is known
};
} // namespace mk

// A log as free runs see it, and the model.
struct mk_start_finder {
    const mk_record *record;
    const mk_model *model; // may be exchanged for one of the same structure
    std::vector<double> t, u[MK_MAX_INPUTS], w[MK_MAX_JOINTS];
    double step = 2.5e-3;      // longest integration step, s
    bool edges_differ = false; // as of mk::ShootTask
    mk::ShootData data;
    // Where the readings are along the way, and what effects remember there; empty where they
    // remember nothing, or hide a joint from the readings.
    std::shared_ptr<const mk::Way> way;
    mk::Memory memory;
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

// What the readings of a window say about parameters alone, joint by joint, with the start state
// following them: it is where the combined least squares of all joints have it. A step d of the
// parameters leaves squares - 2 g'd + d'Hd of the joint, and moves the start state by
// shift - follow d.
struct WindowQuadratic {
    Eigen::MatrixXd H[MK_MAX_JOINTS];
    Eigen::VectorXd g[MK_MAX_JOINTS];
    double squares[MK_MAX_JOINTS]; // after the shift
    double before[MK_MAX_JOINTS];  // from the start state as it was
    size_t readings[MK_MAX_JOINTS];
    Eigen::VectorXd shift;
    Eigen::MatrixXd follow;
    bool finite;
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
    // The same for several windows of one model, whose trajectories are integrated side by side.
    // Which of them were solved.
    static std::vector<char> solve(std::vector<WindowFit> &fits, std::vector<Eigen::VectorXd> &x);
    // The same from states that are near: over the whole window at once; `rough`: to a hundredth of
    // the squared error.
    enum class Care { rough, usual };
    static std::vector<char> solve_near(std::vector<WindowFit> &fits,
                                        std::vector<Eigen::VectorXd> &x, Care care);
    // Sum of squares over the window; infinite where the model runs away.
    double cost(const Eigen::VectorXd &x);
    // Angles of the trajectories from x, at rows of the windows that have a reading; others stay.
    // Of several windows of one model. Which of them could be run to their ends.
    static std::vector<char> angles(std::vector<WindowFit> &fits,
                                    const std::vector<Eigen::VectorXd> &x,
                                    double *const q[MK_MAX_JOINTS]);
    // Sums of squares of several windows of one model.
    static std::vector<double> costs(std::vector<WindowFit> &fits,
                                     const std::vector<Eigen::VectorXd> &x);
    // The normal equations of several windows of one model about the trajectories from x, what is
    // known of hidden states included. Which of them could be run.
    static std::vector<char> normals_at(std::vector<WindowFit> &fits,
                                        const std::vector<Eigen::VectorXd> &x,
                                        std::vector<WindowNormal> &out);
    // What is known of hidden states at the start; where nobody says, it is what a fit begins with,
    // and linearise() takes them for right. `slope`: their derivatives by the parameters that this
    // fit differentiates by, per unit; empty: none.
    void expect(const Eigen::VectorXd &hidden, const Eigen::MatrixXd &slope = {})
    {
        expected = hidden, expected_slope = slope;
    }
    // Quadratics of several windows of one model in the parameters that each differentiates by,
    // about the trajectories from x.
    static void linearise(std::vector<WindowFit> &fits, const std::vector<Eigen::VectorXd> &x,
                          std::vector<WindowQuadratic> &out);
    // Where the trajectory from x is at a row.
    bool carry(Eigen::VectorXd &x, size_t row);

  private:
    const mk_start_finder &f;
    const int ns;
    size_t from, to;
    const std::vector<int> *free = nullptr;
    const std::vector<double> *unit = nullptr;
    std::vector<double> residual, jac, x_end, jac_end;
    std::vector<int> joint;
    Eigen::VectorXd expected; // of hidden states, where that is known
    Eigen::MatrixXd expected_slope;
    Eigen::VectorXd known; // of hidden states: 1 / variance of what is known of them at `from`

    // Where the search for a window's start state is: which trajectory it wants next.
    struct Progress {
        Eigen::VectorXd begun_at;  // what is known of hidden states is there
        Eigen::VectorXd best;      // of the horizons so far
        Eigen::VectorXd at, trial; // of this horizon, and where it looks next
        WindowNormal now;          // about `at`
        double horizon, damping;   // s, Levenberg's
        double settled;            // relative decrease at which the whole window is done
        size_t last;               // row behind the horizon
        int steps, most_steps;     // of this horizon
        bool begun;                // `now` is known
        bool whole, running, any;  // the horizon is the window; it goes on; one was solved
    };
    Progress begin(const Eigen::VectorXd &x) const;
    static std::vector<char> solve_all(std::vector<WindowFit> &fits, std::vector<Progress> &all,
                                       std::vector<Eigen::VectorXd> &x);
    void begin_horizon(Progress &p) const;
    void end_horizon(Progress &p) const;
    void propose(Progress &p) const;
    static double settled_below(const Progress &p);
    void take(const ShootTask &task, Progress &p) const;
    void add_known(const Progress &p, WindowNormal &out) const;
    ShootTask task_over(const Eigen::VectorXd &x, size_t last, int columns);
    void angles_of(const ShootTask &task, double *const q[MK_MAX_JOINTS]) const;
    bool normal_of(const ShootTask &task, WindowNormal &out) const;
    void quadratic_of(const ShootTask &task, WindowQuadratic &out) const;
    ShootTask task_from(const Eigen::VectorXd &x, double end, int columns);
};

// A run of the finder's model from x at row `from` to the time `end` (s from the start of the log),
// without derivatives or results yet. The finder and x must outlive it.
ShootTask task_of(const mk_start_finder &finder, const double *x, size_t from, double end);

// A finder without a way. Throws std::bad_alloc.
std::unique_ptr<mk_start_finder> basic_finder(const mk_record &record, const mk_model &model);

} // namespace mk
#endif
