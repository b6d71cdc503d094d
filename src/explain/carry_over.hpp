// Evidence that carries over: whether a cause improves the prediction of logs that it was not
// fitted to.
//
// Every training log (or block of a log, where they are few) is left out once. What a fit to the
// others would be is known from the second-order picture that each of them has of the cost: with
// information H = sum H_l and slope G = sum G_l, the fit without log f is off by
// (H - H_f)^-1 (G - G_f), one Gauss-Newton step. Free runs over windows of f then tell how far that
// model ends from readings that had no part in it.
#ifndef MECHKIT_EXPLAIN_CARRY_OVER_HPP
#define MECHKIT_EXPLAIN_CARRY_OVER_HPP

#include <vector>

#include "explain/search.hpp"
#include "explain/training.hpp"
#include "ident/held_out.hpp"

namespace mk
{

// What leaving out says of a model against one with less.
struct Carried {
    double mean = 0.0;       // over the folds, of the mean log ratio of squared errors of windows
    double error = HUGE_VAL; // its standard error
    double share = 0.0; // of the gap between refitted model and noise, closed; mean over joints
    double rest_share = 0.0; // of what the model with less leaves of it
    int folds = 0, better = 0;
    double inclusion = 0.0;      // share of resamples of folds and windows that would choose it
    bool judged = false;         // there is something to close beyond the noise
    std::vector<double> by_fold; // mean log ratio of each
};

class CarryOver
{
  public:
    // `data` must outlive it.
    CarryOver(const mk_model &model, const TrainingData &data, double window_s,
              const FitOptions &options);
    bool possible() const { return folds.size() >= FEWEST_FOLDS; }
    double window() const { return window_s; }
    // The logs of every fold; they live as long as this.
    std::vector<std::vector<const mk_log *>> logs_by_fold() const;

    // Errors in every fold of the model that the others lead to, `halves`: in its second half, with
    // own values from the first. False where that has no answer: the model cannot be integrated, or
    // hides a joint's other side from the readings.
    bool errors(const Hypothesis &h, bool halves, HeldOutFigures &out) const;

    // `floor`: what noise leaves of each joint's nrmse, `refit`: of the refitted model.
    static Carried compare(const HeldOutFigures &with, const HeldOutFigures &without,
                           const HeldOutFigures &refit, const double *floor, int joints);
    // Whether that is enough to go on from, and to be claimed where `tried` models were asked.
    static bool promising(const Carried &carried);
    static bool enough(const Carried &carried, int tried);
    // Noise over the deviation of the readings, by joint.
    void floor_of(const mk_model &model, const double *noise, double *floor) const;

    static constexpr size_t FEWEST_FOLDS = 3;

  private:
    struct Fold {
        std::vector<const mk_log *> logs; // windows of one log as given, or a block of one
        std::vector<FitLog> fit_logs;     // the same
    };
    std::vector<OwnedLog> made;
    std::vector<Fold> folds;
    std::vector<const mk_log *> all; // of all folds
    double window_s;
    FitOptions options;

    void add_block(const mk_model &model, const mk_log *rows, Fold &fold);
};

} // namespace mk
#endif
