// One-step predictions: is what they miss white, and does it go with something?
#ifndef MECHKIT_EXPLAIN_EVIDENCE_INNOVATIONS_HPP
#define MECHKIT_EXPLAIN_EVIDENCE_INNOVATIONS_HPP

#include <vector>

#include "explain/search/search.hpp"
#include "mechkit/explain.h"

namespace mk
{

// Whether what a model leaves, at its own process noise, is as a right model would leave it: all
// tests passed at 1 % together. False where they cannot be made.
bool leaves_white_noise(const std::vector<const FitLog *> &training, const Hypothesis &h);

// Each reading as an extended Kalman filter predicts it from those before, with the same process
// noise for the refitted model and the best one: what a right model would need. Fills one_step and
// the tests. L. Ljung, System Identification, 1999, section 16.6.
void test_innovations(const std::vector<const FitLog *> &training, const Hypothesis &refit,
                      const Hypothesis &best, mk_explanation &out);

} // namespace mk
#endif
