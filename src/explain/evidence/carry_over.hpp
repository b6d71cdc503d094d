// Evidence that carries over: whether a cause improves the prediction of logs that it was not
// fitted to. Every training log (or block of a log, where they are few) is left out once; what fits
// to all others leave there is compared window by window.
#ifndef MECHKIT_EXPLAIN_EVIDENCE_CARRY_OVER_HPP
#define MECHKIT_EXPLAIN_EVIDENCE_CARRY_OVER_HPP

#include <vector>

#include "explain/policy.hpp"
#include "explain/training.hpp"
#include "ident/held_out.hpp"

namespace mk
{

// What leaving out says of a model against one with less.
struct Carried {
    double mean = 0.0;       // over the folds, of the mean log ratio of squared errors of windows
    double error = HUGE_VAL; // its standard error
    double window_error = HUGE_VAL; // as if all windows were of one fold
    double share = 0.0; // of the gap between refitted model and noise, closed; mean over joints
    double rest_share = 0.0;              // of what the model with less leaves of it
    double times_noise = HUGE_VAL;        // error of the model with it; rms over joints
    int folds = 0, better = 0, worse = 0; // of the folds; some are neither
    double inclusion = 0.0;      // share of resamples of folds and windows that would choose it
    bool judged = false;         // there is something to close beyond the noise
    std::vector<double> by_fold; // mean log ratio of each
};

// The training data in parts that are left out in turn: the logs, or blocks of them.
class Folds
{
  public:
    static constexpr size_t FEWEST = 3;

    // `data` must outlive it. Windows of prediction of `window_s` fit into every block.
    Folds(const TrainingData &data, double window_s);
    bool enough() const { return logs.size() >= FEWEST; }
    // How many logs they are of.
    size_t sources() const { return of_logs; }
    // The logs of every fold; they live as long as this.
    const std::vector<std::vector<const mk_log *>> &by_fold() const { return logs; }

  private:
    std::vector<OwnedLog> made;
    std::vector<std::vector<const mk_log *>> logs;
    size_t of_logs = 0;
};

namespace carry_over
{

// By window the logarithm of the squared error `with` over that `without`; NaN where one of them is
// not judged. A window in which next to nothing is missed, of what is usual, says next to nothing.
std::vector<double> log_ratios(const HeldOutFigures &with, const HeldOutFigures &without);
// `floor`: what noise leaves of each joint's nrmse, `refit`: of the refitted model.
Carried compare(const HeldOutFigures &with, const HeldOutFigures &without,
                const HeldOutFigures &refit, const double *floor, int joints);
// Whether that is enough to go on from, and to be claimed where `tried` models were asked and the
// log likelihood of independent errors is better by `gain`. `part` of the least share of the gap is
// enough.
bool promising(const Carried &carried, double part = 1.0);
// Whether it is a finding: a good part of the gap, or of the little that is left of it where the
// model with it all but predicts to the noise. A small part of a rest that nobody understands is
// none.
bool worth_naming(const Carried &carried);
bool enough(const Carried &carried, int tried, double gain, double part = 1.0);

} // namespace carry_over

} // namespace mk
#endif
