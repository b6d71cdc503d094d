// Free runs on data that were not fitted.
#ifndef MECHKIT_IDENT_HELD_OUT_HPP
#define MECHKIT_IDENT_HELD_OUT_HPP

#include <algorithm>
#include <cmath>
#include <vector>

#include "mechkit/log.h"
#include "mechkit/model.h"
#include "mechkit/status.h"

namespace mk
{

// Errors of free runs over windows of the held-out logs.
struct HeldOutFigures {
    double square[MK_MAX_JOINTS] = {0.0, 0.0}; // over the variance of the readings
    double rows[MK_MAX_JOINTS] = {0.0, 0.0};
    std::vector<double> window; // squared error by window, over the variance of the readings; 0:
                                // not judged
    std::vector<double> part[MK_MAX_JOINTS]; // squared error by window and joint, over the variance
    std::vector<int> log;                    // by window: number of its log
    double nrmse(int j) const { return std::sqrt(square[j] / std::max(rows[j], 1.0)); }
    void append(const HeldOutFigures &other); // of other logs
    double total() const { return nrmse(0) * nrmse(0) + nrmse(1) * nrmse(1); }
};

class HeldOut
{
  public:
    // The logs must outlive it. Windows of `window_s` seconds; `second_half`: those of the logs'
    // second halves, so that models with values of their own in every log can be compared.
    HeldOut(const std::vector<const mk_log *> &held, double window, bool second_half,
            int threads_in)
        : logs(held), window_s(window), half(second_half), threads(threads_in)
    {
    }
    enum mk_status figures(const mk_model &model, HeldOutFigures &f, mk_error *err) const;
    // Those of one log, added to f.
    enum mk_status add_log(const mk_model &model, size_t number, HeldOutFigures &f,
                           mk_error *err) const;
    // Standard deviation of a joint's readings, rad.
    double deviation(const mk_model &model, int joint) const;
    // Largest magnitude of the command, in the unit of the logs; 0: none acts.
    double largest_command(const mk_model &model) const;

  private:
    const std::vector<const mk_log *> &logs;
    double window_s;
    bool half;
    int threads;

    void add_windows(const mk_model &m, int number, const mk_log &prediction, double from_s,
                     HeldOutFigures &f) const;
};

// How much better `a` predicts than `b`: mean over logs of the log's mean of log(error of a / error
// of b) of its windows, and the standard error of that mean.
struct LogRatio {
    double mean = 0.0, error = HUGE_VAL;
    double window_error = HUGE_VAL; // as if all windows were of one log
    int logs = 0, better = 0;       // in how many of them it is below 0
};
LogRatio ratio_by_log(const HeldOutFigures &a, const HeldOutFigures &b);

// Whether that is better beyond doubt: by 5 % of the squared error, and in all logs, or in a
// majority of them and by two standard errors of the mean over logs. Both of two logs may be better
// by chance: then the mean over their windows has to be so by two standard errors as well.
bool surely_better(const LogRatio &ratio);

// Whether `a` predicts worse than `b` beyond chance: by the ratio of errors window by window, so
// that a window from which nobody can predict does not decide.
bool clearly_worse(const HeldOutFigures &a, const HeldOutFigures &b);

} // namespace mk
#endif
