// What held-out data say of causes while they can still be exchanged: among rivals, and against
// what misleads.
#ifndef MECHKIT_EXPLAIN_EVIDENCE_HELD_OUT_SAY_HPP
#define MECHKIT_EXPLAIN_EVIDENCE_HELD_OUT_SAY_HPP

#include "explain/search/causes.hpp"
#include "ident/held_out.hpp"

namespace mk
{

// Of rivals that the training data cannot tell apart, the one that predicts held-out data clearly
// better leads.
void let_held_out_choose(CauseSearch &causes, const HeldOut &held);

// Where not all is explained, a term that helps the training data alone may spoil for held-out data
// what the others gain: such causes go.
void reject_misleading(CauseSearch &causes, const HeldOut &held);

} // namespace mk
#endif
