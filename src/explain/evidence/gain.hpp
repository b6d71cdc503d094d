// How much better the extended model predicts data that were not fitted.
#ifndef MECHKIT_EXPLAIN_EVIDENCE_GAIN_HPP
#define MECHKIT_EXPLAIN_EVIDENCE_GAIN_HPP

#include "explain/evidence/training_runs.hpp"
#include "explain/evidence/verdict.hpp"
#include "explain/policy.hpp"
#include "explain/training.hpp"

namespace mk
{

// Free runs of the given, the refitted and the extended model on the held-out data, and what they
// say of the verdict: an extension that predicts worse is withdrawn, one that predicts all is
// confirmed. Fills the figures of `out`. The refitted model that an extension is compared with is
// fitted to free runs before, `runs`.
enum mk_status measure_gain(const mk_model &model, const mk_explain_options &options,
                            const TrainingData &data, const CauseSearch &causes,
                            const FinalFit &last, TrainingRuns &runs, Verdict &verdict,
                            mk_explanation &out, mk_error *err);

} // namespace mk
#endif
