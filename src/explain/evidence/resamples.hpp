// Bootstrap of figures of held-out data: over logs, where there are several, and the windows in
// each.
#ifndef MECHKIT_EXPLAIN_EVIDENCE_RESAMPLES_HPP
#define MECHKIT_EXPLAIN_EVIDENCE_RESAMPLES_HPP

#include <functional>
#include <vector>

#include "ident/held_out.hpp"

namespace mk
{

// How often each window counts in a resample.
using Times = std::vector<double>;

// Mean squared error of a joint, over the variance of its readings; `times`: of a resample, or
// NULL.
double mean_square(const HeldOutFigures &f, int joint, const Times *times);

// Between these 90 % of the resamples lie.
struct Interval {
    double low, high;
};

// Of several figures at once, which `figures` makes of a resample of the windows of `f`.
std::vector<Interval>
intervals_of(const HeldOutFigures &f,
             const std::function<std::vector<double>(const Times &)> &figures);

} // namespace mk
#endif
