/* What an extended model is worth to a controller: the rig's setups on a virtual rig that is the
 * extended model, believing the given, the refitted and the extended one. */
#ifndef MECHKIT_EXPLAIN_CONTROL_GAIN_H
#define MECHKIT_EXPLAIN_CONTROL_GAIN_H

#include "mechkit/explain.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Fills in e->control, where an extension is offered. A setup that cannot be tried (no gains can be
 * designed, the rig does not hang still) is left out; the same explanation gives the same figures,
 * with any number of threads. */
MK_NODISCARD enum mk_status control_gain_measure(struct mk_explanation *e, int threads,
                                                 struct mk_error *err);

#ifdef __cplusplus
}
#endif

#endif
