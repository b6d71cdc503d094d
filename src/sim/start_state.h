// The state of the rig at a row of a log, by running the model through the readings around it.
#ifndef MECHKIT_SIM_START_STATE_H
#define MECHKIT_SIM_START_STATE_H

#include "mechkit/sim.h"

#ifdef __cplusplus
extern "C" {
#endif

struct mk_start_finder;

/* Borrows both. NULL when there is no memory. */
struct mk_start_finder *mk_start_finder_create(const struct mk_record *record,
                                               const struct mk_model *model);
void mk_start_finder_destroy(struct mk_start_finder *finder);

/* State at `row` from the readings within a quarter second around it, none at `last` or later. The
 * model is run through them from half way back; where it cannot follow them as closely as a
 * polynomial can, fewer are used, in the end the polynomial alone (mk_record_state_at). */
enum mk_status mk_start_state(struct mk_start_finder *finder, size_t last, size_t row, double *x,
                              struct mk_error *err);

#ifdef __cplusplus
}
#endif
#endif
