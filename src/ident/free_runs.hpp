// Free runs of a model over windows of logs, as least squares: the errors that a model is judged by
// are what its parameters are fitted to.
//
// About a point every window's squared error is a quadratic in a step of the parameters, its start
// state eliminated (sim/window_fit.hpp). From these come Gauss-Newton steps, and what a fit to all
// logs but one would predict of that one: a solution of a small linear system for each log.
//
// Parameters with a spread have a value of their own in every fold (random effects, as in
// ident/fit.hpp); of a fold that is left out they come from the first halves of its logs, and the
// second halves are judged.
#ifndef MECHKIT_IDENT_FREE_RUNS_HPP
#define MECHKIT_IDENT_FREE_RUNS_HPP

#include <memory>
#include <vector>

#include "ident/fit.hpp"
#include "ident/held_out.hpp"
#include "ident/thin_record.hpp"
#include "sim/window_fit.hpp"

namespace mk
{

struct RunPoint {
    mk_model model;
    std::vector<Eigen::VectorXd> own; // by fold: own values less their means, as own_parameters()
    std::vector<Eigen::VectorXd> x;   // by window: its start state,
    std::vector<Eigen::VectorXd> z;   // and what is known of hidden states there, if there are any,
    std::vector<Eigen::MatrixXd> dz;  // with its derivatives by the parameters of
    std::vector<int> remembering;     // effects that remember (by number, per scale)
    std::vector<Memory> memory;       // by log: what they remember along its way
    double cost = HUGE_VAL;           // minus log likelihood, up to a constant
};

// Errors about a point, in the scaled parameters `free` (numbers as in mechkit/ident.h).
struct RunQuadraticModel {
    std::vector<int> free;
    size_t stride = 1; // one in so many windows is looked at
    std::vector<WindowQuadratic> window;
};

class FreeRuns
{
  public:
    // `folds`: logs by fold, must outlive it; `near`: base parameters are somewhere near these;
    // `masses`: how far those of them go, must outlive it (NULL: anywhere).
    FreeRuns(const std::vector<std::vector<const mk_log *>> &folds, const mk_model &near,
             double window_s, int threads, const MassRange *masses = nullptr);

    // Start states fitted to the readings of every window.
    RunPoint start(const mk_model &model) const;
    // The same windows and states for a model with other effects.
    RunPoint adopt(const RunPoint &from, const mk_model &model, int threads) const;
    // The same for effects that are next to nothing: where they remember nothing themselves, what
    // the others remember is as it was.
    RunPoint adopt_traces(const RunPoint &from, const mk_model &model, int threads) const;
    // What errors are usual, by joint, is from here on what they are at this point. By how much
    // that changes at most, as a logarithm of squared errors.
    double take_scale(RunPoint &point);
    // An error in a joint's unit over the deviation of its readings.
    double relative(int joint, double error) const;

    // False where too many windows cannot be run. `converge`: start states that are not where they
    // fit best are fitted again.
    bool linearise(RunPoint &point, const std::vector<int> &free, bool converge, int threads,
                   RunQuadraticModel &out) const;
    double cost(const RunPoint &point, const RunQuadraticModel &quadratic) const;
    // Gauss-Newton in parameters, own values and start states together; the quadratic model is that
    // of where it ends.
    bool minimise(RunPoint &point, const std::vector<int> &free, int iterations, int threads,
                  RunQuadraticModel &quadratic) const;
    // The same until nothing is gained any more, from start states that are found anew where those
    // of the point are stuck.
    bool converge(RunPoint &point, const std::vector<int> &free, int threads,
                  RunQuadraticModel &quadratic) const;
    // Errors that fits to all folds but one leave in that one, one step from the point in those of
    // the quadratic model's parameters that are `wanted`. `halves`: in second halves.
    bool left_out(const RunPoint &point, const RunQuadraticModel &quadratic,
                  const std::vector<int> &wanted, bool halves, HeldOutFigures &out) const;
    // What the errors about a point say of the quadratic model's parameters, own values eliminated;
    // its evidence does not depend on the scale.
    QuadraticModel information(const RunPoint &point, const RunQuadraticModel &quadratic) const;
    // Errors that are worth one each.
    double independent_errors() const;

  private:
    struct Log {
        ThinRecord thin;
        int fold;
        std::shared_ptr<const Way> way;
    };
    struct Window {
        int log, fold;
        size_t first, last;
        bool second_half;
    };
    struct Normal; // of a fold
    struct Step;
    std::vector<Log> logs;
    std::vector<Window> windows;
    size_t folds;
    mk_model near;
    const MassRange *masses;
    int threads;
    double scale[MK_MAX_JOINTS] = {1.0, 1.0};     // usual squared error of a reading, counts^2
    double deviation[MK_MAX_JOINTS] = {1.0, 1.0}; // of the readings, counts
    double independent = 1.0;                     // errors per reading

    using Finder = std::unique_ptr<mk_start_finder>;
    Finder finder_of(const RunPoint &point, const mk_model &model, size_t log) const;
    // Of every log; `models` by fold, must outlive them.
    std::vector<Finder> finders_of(const RunPoint &point, const std::vector<mk_model> &models,
                                   int threads) const;
    std::vector<std::vector<size_t>> together(const RunPoint &point,
                                              const std::vector<size_t> &which) const;
    void recall(RunPoint &point, int threads) const;
    Eigen::MatrixXd memory_slope(const RunPoint &point, size_t window,
                                 const std::vector<int> &free) const;
    void find_states(RunPoint &point, int threads) const;
    double prior(const RunPoint &point, const std::vector<int> &free) const;
    double error_of(const WindowQuadratic &q, const double *squares) const;
    double rows_of(size_t window) const;
    void usual_errors(const RunQuadraticModel &quadratic, double *usual) const;
    double surprise_of_readings(const RunQuadraticModel &quadratic) const;
    void update_spreads(RunPoint &point, const RunQuadraticModel &quadratic) const;
    std::vector<Normal> normals_of(const RunPoint &point, const RunQuadraticModel &quadratic,
                                   const std::vector<int> &wanted) const;
    double surprise(const mk_model &model, int number, double &slope) const;
    void add_windows(int log, double window_s);
    void measure_readings();
    std::vector<mk_model> models_of(const RunPoint &point) const;
    Normal normal_of(const RunQuadraticModel &quadratic, const std::vector<long> &columns,
                     size_t fold, bool first_half) const;
    void eliminate_own(const RunPoint &point, const std::vector<int> &wanted, Normal &n) const;
    QuadraticModel whole(const RunPoint &point, const std::vector<int> &wanted,
                         const std::vector<Normal> &parts, size_t but) const;
    Step step_of(const RunPoint &point, const RunQuadraticModel &quadratic, double damping) const;
    RunPoint moved(const RunPoint &from, const RunQuadraticModel &quadratic,
                   const Step &step) const;
    // Which start state a window is linearised from: its own, one fitted from there, or one fitted
    // from what its readings say.
    enum class Pass { AS_THEY_ARE, NEAR, ANEW };
    void linearise_some(RunPoint &point, const std::vector<Finder> &finders,
                        const std::vector<double> &unit, const std::vector<size_t> &which,
                        Pass pass, RunQuadraticModel &out) const;
    bool off_its_best(const WindowQuadratic &q) const;
    bool first_state(const mk_start_finder &finder, const RunPoint &point, size_t window,
                     Eigen::VectorXd &x) const;
    void add_errors(const RunQuadraticModel &quadratic, const std::vector<long> &columns,
                    size_t fold, bool halves, const Eigen::VectorXd &step,
                    HeldOutFigures &out) const;
};

} // namespace mk
#endif
