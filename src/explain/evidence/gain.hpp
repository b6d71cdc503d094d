// How much better the extended model predicts data that were not fitted.
#ifndef MECHKIT_EXPLAIN_EVIDENCE_GAIN_HPP
#define MECHKIT_EXPLAIN_EVIDENCE_GAIN_HPP

#include "explain/evidence/verdict.hpp"
#include "explain/training.hpp"

namespace mk
{

// Held-out data whose error is so many times their readings' noise show what others do not.
constexpr double FAR_FROM_READ = 10.0;

// Free runs of the given, the refitted and the extended model on the held-out data, and what they
// say of the verdict: an extension that predicts worse is withdrawn, one that predicts all is
// confirmed. Fills the figures of `out`.
enum mk_status measure_gain(const mk_model &model, const mk_explain_options &options,
                            const TrainingData &data, const CauseSearch &causes,
                            const FinalFit &last, Verdict &verdict, mk_explanation &out,
                            mk_error *err);

} // namespace mk
#endif
