/* Prediction with the whole state, and how finely, for those who go on from it elsewhere. */
#ifndef MECHKIT_SIM_PREDICT_H
#define MECHKIT_SIM_PREDICT_H

#include "mechkit/sim.h"

#ifdef __cplusplus
extern "C" {
#endif

/* As mk_predict; *out also has columns x1, x2, ...: the model's state in its own order. */
MK_NODISCARD enum mk_status
mk_predict_states(const struct mk_model *model, const struct mk_log *log,
                  const struct mk_predict_options *options, struct mk_log **out,
                  struct mk_predict_figures *figures, size_t *failed, struct mk_error *err);

/* As mk_predict, by the fixed steps of fits instead of a solver with error control, which takes a
 * twentieth of the time; options->sim is not looked at. *out has angles only of rows that have
 * a reading, and speeds only where a run begins. For comparing models, all of them by the same
 * steps. */
MK_NODISCARD enum mk_status
mk_predict_angles(const struct mk_model *model, const struct mk_log *log,
                  const struct mk_predict_options *options, struct mk_log **out,
                  struct mk_predict_figures *figures, size_t *failed, struct mk_error *err);

/* Tolerances at which a free run of the model agrees with others to 1e-6 rad: its own, and a
 * thousandth of them where there is contact, since every impact multiplies the errors made before
 * it. */
void mk_free_run_tolerances(const struct mk_model *model, double *rtol, double *atol);

#ifdef __cplusplus
}
#endif
#endif
