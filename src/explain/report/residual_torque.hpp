// The torque that is missing, without a hypothesis about its cause.
#ifndef MECHKIT_EXPLAIN_REPORT_RESIDUAL_TORQUE_HPP
#define MECHKIT_EXPLAIN_REPORT_RESIDUAL_TORQUE_HPP

#include "explain/search/search.hpp"
#include "mechkit/explain.h"

namespace mk
{

// The model with the base parameters of `best` but without its causes follows the data only if it
// is pushed between short stretches: by this torque, spread over the stretch. Fills the pushes and
// their rms.
void find_pushes(const std::vector<const FitLog *> &training, const mk_model &given,
                 const Hypothesis &refit, const Hypothesis &best, int threads, mk_explanation &out);

} // namespace mk
#endif
