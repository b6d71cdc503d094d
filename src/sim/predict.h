/* Prediction with the whole state, for those who go on from it elsewhere. */
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

#ifdef __cplusplus
}
#endif
#endif
