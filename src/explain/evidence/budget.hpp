// The budget of the gap: of what free runs of the refitted model get wrong on held-out data, how
// much is due to what, how sure that is, and what remains (docs/explain.md).
#ifndef MECHKIT_EXPLAIN_EVIDENCE_BUDGET_HPP
#define MECHKIT_EXPLAIN_EVIDENCE_BUDGET_HPP

#include "explain/evidence/training_runs.hpp"
#include "explain/search/causes.hpp"
#include "explain/training.hpp"

namespace mk
{

// Fills out.budget from what was found. Shares are order-free: what a cause closes when it is
// added, averaged over orders of adding the causes (Shapley 1953), with all else fitted again.
void make_budget(const TrainingData &data, const CauseSearch &causes, int threads,
                 TrainingRuns &training, mk_explanation &out);

} // namespace mk
#endif
