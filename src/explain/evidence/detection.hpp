// What the data would have shown: of every cause that was looked for and not found, the smallest
// size that would have been named.
#ifndef MECHKIT_EXPLAIN_EVIDENCE_DETECTION_HPP
#define MECHKIT_EXPLAIN_EVIDENCE_DETECTION_HPP

#include "explain/search/search.hpp"
#include "mechkit/explain.h"

namespace mk
{

// Fills out.detection_limit: of causes whose effect on the motion is linear in their size where
// that is next to nothing, in the order of the catalogue. `best` is what the search ended with.
void find_detection_limits(Search &search, const Hypothesis &best, mk_explanation &out);

} // namespace mk
#endif
