// Free runs on data that were not fitted.
#ifndef MECHKIT_EXPLAIN_HELD_OUT_HPP
#define MECHKIT_EXPLAIN_HELD_OUT_HPP

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
    std::vector<double> window; // squared error by window, over the variance of the readings
    double nrmse(int j) const { return std::sqrt(square[j] / std::max(rows[j], 1.0)); }
    double total() const { return nrmse(0) * nrmse(0) + nrmse(1) * nrmse(1); }
};

class HeldOut
{
  public:
    // The logs must outlive it. Windows of `window_s` seconds.
    HeldOut(const std::vector<const mk_log *> &held, double window) : logs(held), window_s(window)
    {
    }
    enum mk_status figures(const mk_model &model, HeldOutFigures &f, mk_error *err) const;
    // Standard deviation of a joint's readings, rad.
    double deviation(const mk_model &model, int joint) const;

  private:
    const std::vector<const mk_log *> &logs;
    double window_s;

    void add_windows(const mk_model &m, const mk_log &log, const mk_log &prediction,
                     HeldOutFigures &f) const;
};

// Whether `a` predicts worse than `b` beyond chance: by the ratio of errors window by window, so
// that a window from which nobody can predict does not decide.
bool clearly_worse(const HeldOutFigures &a, const HeldOutFigures &b);

} // namespace mk
#endif
