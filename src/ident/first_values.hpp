// Where a fit by output error starts.
//
// Given parameters may be orders of magnitude off, or unknown. The linear methods need no start:
// their equations are linear in the parameters, and what they find is within a few percent. Where
// they cannot be used (a joint that does not move, data shorter than their windows) inertias,
// weights and frictions are tried over two orders of magnitude. Models are compared by how well
// they follow the first rows of the data with states free at the start of every shooting interval.
#ifndef MECHKIT_IDENT_FIRST_VALUES_HPP
#define MECHKIT_IDENT_FIRST_VALUES_HPP

#include <vector>

#include "ident/fit.hpp"
#include "ident/method.hpp"

namespace mk
{

// Models to start from, best first, one at least. The given one, with values that fit beside it
// where some of it are unknown, is the first where it follows the data, or no other has `better`
// times less squared error; none where all of it is unknown.
std::vector<mk_model> first_values(const IdentProblem &problem,
                                   const std::vector<const FitLog *> &logs,
                                   const FitOptions &options, double better);

// For a fit, whose end does not depend on where it starts as long as it comes there; and for a
// search, whose prior is about the start: what a model lacks, a zero or a lag, may cost as much as
// wrong values do, and values that make up for it are no better than the given ones.
constexpr double BETTER_START = 4.0, BETTER_PRIOR = 100.0;

} // namespace mk
#endif
