// Maximum likelihood of measured angles: multiple shooting with a Gauss-Newton method.
//
// Unknowns are the parameters and, for each shooting interval of each log, the state it starts
// from. The trajectory of a shooting interval must end where the next one starts, up to a process
// noise that acts on the speeds (`process_noise`, an intensity): nearly none makes it one
// trajectory per log, still solvable when that is chaotic because every shooting interval is pinned
// by its own readings; more lets a wrong model follow the data and shows where it had to be pushed.
// Shooting intervals are eliminated one after the other (a square-root-free information filter and
// smoother with the parameters as a border), so that the work grows with the length of the data. H.
// G. Bock 1987; J. Rauch, F. Tung, C. Striebel 1965.
//
// A parameter that the model says to have a value of its own in every log (a spread above 0) is a
// random effect: value_l = mean + b_l, b_l ~ N(0, spread^2). The mean is one of the free
// parameters, the b_l are eliminated log by log as states are, and the spread is where the
// likelihood with the b_l integrated out is largest (Pinheiro, Bates: Mixed-Effects Models, 2000).
// docs/identification.md.
#ifndef MECHKIT_IDENT_FIT_HPP
#define MECHKIT_IDENT_FIT_HPP

#include <Eigen/Core>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "ident/fit_log.hpp"
#include "ident/mass_range.hpp"
#include "mechkit/ident.h"

namespace mk
{

struct ShootTask;

struct FitOptions {
    double process_noise[MK_MAX_JOINTS] = {1e-4,
                                           1e-4}; // process noise of the speeds, rad/s per sqrt(s)
    double interval = 0.25;                       // s
    double hidden_interval = 60.0; // s, of models that hide one side of a joint from the readings
    double step = 5e-3;            // longest integration step, s
    double tolerance = 1e-3;       // stop when a step gains less, in log likelihood
    int max_iterations = 40;
    // Most work of one minimisation, in passes over the data with steps of 2.5 ms and without
    // derivatives: what a hopeless fit may cost. Counted, not timed: answers stay the same.
    double max_passes = HUGE_VAL;
    // Cost that is worth the work: a minimisation whose pace does not lead below it by its last
    // iteration is given up, and fails; so does one that has it far out of reach where it begins.
    double worth = HUGE_VAL;
    int threads = 1;
    // Model whose base parameters are right within a factor of some three, must outlive the fit: it
    // keeps values that the data do not determine from running away, and is not heard against what
    // they do determine. NULL: nothing is known.
    const mk_model *near = nullptr;
    // How far inertias and moments may go, must outlive the fit. NULL: anywhere.
    const MassRange *masses = nullptr;
};

// Where the shooting intervals of one log start, and the states there.
struct ShootingNodes {
    std::vector<size_t> row; // of the FitLog
    Eigen::MatrixXd x;       // states x nodes
};

// A point of the search: model with its parameters, and all states.
struct FitPoint {
    mk_model model;
    std::vector<ShootingNodes> nodes; // one a log
    // By source: what its own values are beyond the model's, in the order of own_parameters(model).
    std::vector<Eigen::VectorXd> own;
    double noise[MK_MAX_JOINTS] = {0.0, 0.0};
    double step = 0.0; // longest integration step that is short enough here, s; 0: as the options
    double cost = 0.0; // minus log likelihood, up to a constant
};

// Local quadratic model of the cost around a point in the free parameters, states eliminated:
// cost(d) = cost - gradient' d + d' information d / 2, per scaled parameter.
struct QuadraticModel {
    Eigen::MatrixXd information;
    Eigen::VectorXd gradient;
    double cost = 0.0;
    // What the states alone would take off the cost, the parameters as they are.
    double state_decrease = 0.0;
    // Negative log marginal likelihood of the readings, the states integrated out by Laplace's
    // method, up to a constant: nlml = cost + log_determinant. Comparable between process noises,
    // readings' noises and models; less is better.
    double nlml = 0.0;
    double log_determinant = 0.0; // half that of the states' information, and the noises' norms
    bool finite = false;
};

// What is left at a point.
struct FitResiduals {
    // Continuity defects, by log: the state at each shooting node less the end of the interval
    // before it (states x nodes; of the first one 0).
    std::vector<Eigen::MatrixXd> defect;
    double chi2[MK_MAX_JOINTS] = {0.0, 0.0}; // sum of squares of the weighted residuals
};

// Numbers (mechkit/ident.h) of the parameters that a fit may move: no constants of a law, no
// counts, no parameter that its term does not use, and of a rig that nothing drives not the one
// that holds the scale (scale.hpp).
std::vector<int> fitted_parameters(const mk_model &model);

// Numbers of the parameters that have a value of their own in every log.
std::vector<int> own_parameters(const mk_model &model);
// The model with the own values of one source in it, within their ranges; no spread any more.
mk_model model_of_source(const FitPoint &point, int source);

// An own value of a source: its deviation b from the mean, mean + b, and their standard errors.
struct OwnValue {
    int number, source;
    double deviation, deviation_error;
    double value, std_error;
    // Of how far it is from the others' average, the means held. A torque scale that all logs share
    // is nothing but another unit of torque, which leaves its mean and what the values have in
    // common open; how far they are apart is known all the same.
    double apart_error;
};

class Fit
{
  public:
    // The logs must outlive the fit.
    Fit(std::vector<const FitLog *> logs, const FitOptions &options);

    // Start: states from local polynomials through the readings, noise from their scatter.
    FitPoint start(const mk_model &model);
    // Takes over the parameters and states of a fit with another set of effects: states that are
    // new start at rest.
    FitPoint adopt(const FitPoint &from, const mk_model &model);

    // Minimises over states and the free parameters (numbers as in mechkit/ident.h), within their
    // ranges. False when the model cannot even be integrated from the start.
    bool minimise(FitPoint &point, const std::vector<int> &free);
    // Cost and its quadratic model at a point. Columns: `free`.
    QuadraticModel quadratic(const FitPoint &point, const std::vector<int> &free);
    double cost(const FitPoint &point);
    // From here on quadratic models near this point are made with long steps, corrected by what the
    // point's own step changes here: slopes are good enough that way, readings are met as before.
    void coarsen(const FitPoint &point);
    void coarsen_as(const Fit &other) { correction = other.correction; } // near the same point
    FitResiduals residuals(const FitPoint &point);
    // Sets the noise of each joint to what the residuals show; returns the largest relative change.
    double update_noise(FitPoint &point);
    // The same for the spreads of own values, after a quadratic model of the point.
    double update_spreads(FitPoint &point, const QuadraticModel &quadratic);
    // Own values at a point of which a quadratic model has just been taken.
    std::vector<OwnValue> own_values(const FitPoint &point, const QuadraticModel &quadratic) const;

    FitOptions options;
    int iterations = 0;     // of the last minimise
    double work_done = 0.0; // in passes, see FitOptions::max_passes, since the fit was made
    // Of the last minimise: where it began, and what its quadratic models promised beyond where it
    // ended.
    double start_cost = 0.0, left = 0.0;
    bool converged = false;
    mk_progress_fn progress = nullptr;
    void *progress_context = nullptr;
    bool cancelled = false;

    // Minimises with less and less process noise, re-estimating the noise, and ends at the process
    // noise with the best evidence: an honest model ends with next to none, a wrong one with what
    // it lacks. `last` is the least process noise tried. The quadratic model belongs to the result.
    bool continue_over_process_noise(FitPoint &point, const std::vector<int> &free, double first,
                                     double last, QuadraticModel &result);
    // The same from the first process noise to the last at once: true where that is the best there
    // is, so for honest models.
    bool solve_directly(FitPoint &point, const std::vector<int> &free, double first, double last,
                        QuadraticModel &result);
    // With less and less process noise nlml that has risen twice above the least so far does not
    // come back down; nor does one that has risen far once, and that is where fits take longest.
    // `rise`: above the least, of `readings` independent ones. Returns how often that counts, of
    // RISES_IN_A_ROW.
    static constexpr int RISES_IN_A_ROW = 2;
    static int rises(double rise, double readings);
    // One step of both: minimum at a given process noise, noise re-estimated. False when it fails.
    bool solve_at(FitPoint &point, const std::vector<int> &free, double process_noise,
                  QuadraticModel &result);

    // Covariance of the free parameters in their units, from their information.
    static Eigen::MatrixXd covariance(const mk_model &model, const QuadraticModel &quadratic,
                                      const std::vector<int> &free);
    // The model one Gauss-Newton step further, within the ranges of its parameters; false where
    // that makes no rig.
    static bool step(const mk_model &model, const QuadraticModel &quadratic,
                     const std::vector<int> &free, mk_model &out);
    // Scale of a parameter's derivative and steps.
    static double scale_of(const mk_model &model, int number);
    // How far a base parameter of `now` is from that of `near`, in standard deviations of the prior
    // that FitOptions::near stands for and outside of the range of masses (NULL: there is none),
    // and its slope per scaled parameter. 0 for any other number.
    static double surprise(const mk_model &near, const MassRange *masses, const mk_model &now,
                           int number, double &slope);

  private:
    struct Segment;     // one shooting interval at one point
    struct Batch;       // shooting intervals that are shot together
    struct Corrections; // of what long steps make
    struct Slopes;      // what the derivatives in `work` belong to
    struct LogData;
    struct Source; // of own values, at one point

    std::vector<const FitLog *> logs;
    std::vector<LogData> data;              // by log
    std::vector<std::vector<Segment>> work; // by log
    std::unique_ptr<const Slopes> slopes;   // NULL: `work` has no derivatives
    std::vector<Source> sources;            // by number
    std::shared_ptr<const Corrections> correction;
    double work_limit = HUGE_VAL; // work_done at which solve_at() shall have an end

    double correct(const FitPoint &point, const std::vector<std::vector<Segment>> &fine,
                   Corrections &out) const;

    void prepare(const FitPoint &point);
    void lay_data(const FitPoint &point);
    void adopt_own(const FitPoint &from, FitPoint &to) const;
    void add_input_uncertainty(const FitPoint &point, size_t log, size_t node);
    void carry_states(FitPoint &point, size_t log);
    void carry_apart(FitPoint &point, size_t log);
    void thin(ShootingNodes &nodes) const;
    struct Descent;
    bool is_hopeless(const FitPoint &point, const Descent &d) const;
    bool step_down(FitPoint &point, const std::vector<int> &free, QuadraticModel &p, Descent &d);
    void accept(FitPoint &point, FitPoint trial, double length, Descent &d);
    bool minimise_finely(FitPoint &point, const std::vector<int> &free);
    bool refine_step(FitPoint &point, bool needs_process_noise);
    double longest_step(const mk_model &model) const;
    using Job = std::pair<size_t, size_t>; // log, node
    void shoot_some(const FitPoint &point, const std::vector<int> &free, const Job *first,
                    const Job *last, bool derivatives);
    size_t rows_in_view(const FitPoint &point, const Job &job) const;
    ShootTask task_of(const FitPoint &point, const Job &job, int columns);
    void compress(const ShootTask &task, const double *noise, size_t log, size_t node);
    void shoot_one(const FitPoint &point, size_t log, size_t node); // without derivatives
    void shoot_all(const FitPoint &point, const std::vector<int> &free, bool derivatives);
    bool has_slopes(const FitPoint &point, const std::vector<int> &free) const;
    double total_cost(const FitPoint &point) const;
    double surprise(const FitPoint &point, int number, double &slope) const;
    void add_surprise(const FitPoint &point, const std::vector<int> &free,
                      QuadraticModel &out) const;
    Eigen::VectorXd process_variance(const FitPoint &point, size_t log, size_t node) const;
    QuadraticModel eliminate(const FitPoint &point, const std::vector<int> &free, double damping);
    void eliminate_log(const FitPoint &point, size_t log, double damping, QuadraticModel &out);
    void eliminate_own(const FitPoint &point, const std::vector<int> &free, QuadraticModel &out);
    const mk_model &model_of(const FitPoint &point, size_t log) const;
    double own_cost(const FitPoint &point) const;
    Eigen::MatrixXd with_means_held(const Eigen::MatrixXd &information) const;
    void substitute(FitPoint &point, const Eigen::VectorXd &step, double length) const;

  public:
    ~Fit();
    Fit(const Fit &) = delete;
    Fit &operator=(const Fit &) = delete;
};

} // namespace mk
#endif
