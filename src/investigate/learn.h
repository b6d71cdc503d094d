/* What a log says: how well a model foresaw it, and, with all logs so far, what the model lacks. */
#ifndef MECHKIT_INVESTIGATE_LEARN_H
#define MECHKIT_INVESTIGATE_LEARN_H

#include "investigate/doubt.h"
#include "investigate/journal.h"
#include "mechkit/explain.h"

/* Writes down what `model` predicts of an experiment from rest, before it is run, in its log's own
 * frame. MK_ERR_NUMERIC: the model runs away. */
MK_NODISCARD enum mk_status learn_write_prediction(const char *path, const struct mk_model *model,
                                                   const struct experiment *x, double rate_hz,
                                                   struct mk_error *err);

/* The log of an experiment, as far as it can be believed (*doubt, which may be NULL), its angles
 * counted from the first one's zero. */
MK_NODISCARD enum mk_status learn_read_log(const char *path, const struct experiment *x,
                                           const struct mk_model *model, struct mk_log **out,
                                           struct doubt *doubt, struct mk_error *err);

/* Holds the log of an experiment against the model that foresaw it and what was written down: fills
 * error, whole, passed. `x->window_s` and `x->noise` say how; the latter becomes what a rig that is
 * the model would be predicted with, where that is more. */
MK_NODISCARD enum mk_status learn_judge(struct experiment *x, const struct mk_model *model,
                                        const char *log_path, const char *prediction_path,
                                        struct mk_error *err);

/* Of a reading: as found in the data (NULL: none yet), but no less than rounding to counts. */
void learn_noise(const struct mk_model *model, const struct mk_explanation *e,
                 double noise[MK_MAX_JOINTS]);

/* The largest error of an experiment over its noise; *joint (0-based) whose. */
double learn_worst(const struct experiment *x, const struct mk_model *model, int *joint);

/* Whether the motor's joint stood still while the prediction that was written down moves it;
 * *command: the range of the command meanwhile. */
bool learn_motor_is_dead(const char *log_path, const struct mk_model *model,
                         const char *prediction_path, double *command);

/* The largest error of free runs over each log, over the noise. False: one cannot be followed. */
bool learn_errors(const struct mk_model *model, const struct mk_log *const *logs, size_t n,
                  const double noise[MK_MAX_JOINTS], double window_s, double *error);

/* What an explanation found, in the journal's words. `given`: the model without the zeros that it
 * was explained with (zeros.h). */
void learn_finding(const struct mk_explanation *e, const struct mk_model *given,
                   struct journal_finding *out);

/* Whether the best model leaves free runs on held-back data wrong by more than twice the noise;
 * *joint (0-based) of most of it. */
bool learn_has_rest(const struct mk_explanation *e, int *joint);

#endif
