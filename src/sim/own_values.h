/* What a log has of its own of parameters that differ from log to log. */
#ifndef MECHKIT_SIM_OWN_VALUES_H
#define MECHKIT_SIM_OWN_VALUES_H

#include "mechkit/sim.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Estimates the own values of the record's rows [0, rows) of `model`, by free runs over windows of
 * `window_s`. *out is the model with them in it and no spread any more; `found` has room for
 * MK_MAX_OWN_ESTIMATES. Values that the rows say nothing about stay at their means. MK_ERR_NOMEM.
 */
enum mk_status mk_find_own_values(const struct mk_record *record, const struct mk_model *model,
                                  size_t rows, double window_s, struct mk_model *out,
                                  struct mk_own_estimate *found, int *count, struct mk_error *err);

#ifdef __cplusplus
}
#endif
#endif
