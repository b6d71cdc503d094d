// Residual torque: what the model lacks, without a hypothesis about its cause.
#ifndef MECHKIT_EXPLAIN_REPORT_RESIDUAL_TORQUE_HPP
#define MECHKIT_EXPLAIN_REPORT_RESIDUAL_TORQUE_HPP

#include "explain/search/search.hpp"
#include "mechkit/explain.h"

namespace mk
{

// The model with the base parameters of `best` but without its causes follows the data only if it
// is pushed from one short shooting interval to the next: by this torque, spread over the interval.
// Fills the residual torques and their rms.
void find_residual_torques(const std::vector<const FitLog *> &training, const mk_model &given,
                           const Hypothesis &refit, const Hypothesis &best, int threads,
                           mk_explanation &out);

} // namespace mk
#endif
