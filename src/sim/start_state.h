// The state from which a free run of a model over a window of a log starts.
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

/* Rows [first, last). */
struct mk_row_range {
    size_t first, last;
};

/* State at row `first` from which a free run of the model fits the readings of rows [first, last)
 * best: least squares of all joints' readings in counts, over all states. Where the model runs away
 * within them, over as many as it lasts. Later rows are never looked at; earlier ones tell where
 * effects that remember the past stand. MK_ERR_RANGE when there are too few readings, MK_ERR_NOMEM.
 */
enum mk_status mk_start_state(struct mk_start_finder *finder, size_t first, size_t last, double *x,
                              struct mk_error *err);
/* The same for several windows of a log at once, which takes a fraction of the time: x has
 * MK_MAX_STATES values for each, `status` what came of it. MK_ERR_NOMEM: of none. */
enum mk_status mk_start_states(struct mk_start_finder *finder, const struct mk_row_range *windows,
                               size_t count, double *x, enum mk_status *status,
                               struct mk_error *err);
/* Angles of the free runs over windows from states x (as mk_start_states has them), q[j] by row of
 * the log: by the fixed steps that start states are found with, all windows side by side. Rows
 * without a reading stay as they are, and so do those behind where the model runs away; windows
 * whose status is not MK_OK are not run, and the others' is MK_ERR_NUMERIC where it does.
 * MK_ERR_NOMEM: none was run. */
enum mk_status mk_free_angles(struct mk_start_finder *finder, const struct mk_row_range *windows,
                              size_t count, const double *x, enum mk_status *status,
                              double *const q[MK_MAX_JOINTS], struct mk_error *err);

#ifdef __cplusplus
}
#endif
#endif
