/* The virtual rig: a simulated model behind quantised, wrapping counters and an amplifier.
 *
 * It is what a board sees of a rig: counts in, a command out. One thread at a time. After creation
 * nothing is allocated. With the same model, seed and calls the counts are the same, bit for bit.
 */
#ifndef MECHKIT_RIG_H
#define MECHKIT_RIG_H

#include <stdint.h>

#include "mechkit/model.h"
#include "mechkit/sim.h"
#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

#define MK_COUNTER_BITS 24 /* the counters wrap at +-2^23 */

struct mk_rig_config {
    struct mk_sim_config sim;
    uint64_t seed;                 /* of the count noise */
    double count_noise;            /* standard deviation of reading jitter, counts; default 0 */
    double start[MK_MAX_JOINTS];   /* true start angles relative to hanging rest, rad; default 0 */
    double start_v[MK_MAX_JOINTS]; /* start speeds, rad/s */
};
/* All zero: at rest where the rig hangs, readings without jitter, mk_sim's default solver. */
void mk_rig_config_default(struct mk_rig_config *config);

struct mk_rig;

/* A rig at its start position; the caller destroys it. The model is copied; `config` NULL: the
 * defaults. MK_ERR_RANGE for a model too stiff to be followed, MK_ERR_NOMEM, and what mk_sim_create
 * returns.
 */
MK_NODISCARD enum mk_status mk_rig_create(const struct mk_model *model,
                                          const struct mk_rig_config *config, struct mk_rig **out,
                                          struct mk_error *err);
/* Frees a rig. NULL allowed. */
void mk_rig_destroy(struct mk_rig *rig);

/* Back to the start position at time 0, counters as at power-up. Allocates; on failure the rig can
 * only be destroyed or restarted. */
MK_NODISCARD enum mk_status mk_rig_restart(struct mk_rig *rig, struct mk_error *err);

/* Lets `dt_s` (>= 0) pass under command u (limited to +-u_max). RT. MK_ERR_NUMERIC. */
MK_NODISCARD enum mk_status mk_rig_advance(struct mk_rig *rig, double dt_s, double u,
                                           struct mk_error *err);

/* Encoder counters now: quantised, noisy, wrapped to 24 bits (sign-extended). A count of c means an
 * angle of c * mk_model_count() relative to where the counter was zeroed. RT. */
void mk_rig_counts(struct mk_rig *rig, int32_t count[MK_MAX_JOINTS]);

/* Zeroes the counters where the links truly are now: what the model says about the encoders (an
 * `encoder-offset`) stays in the readings. A new log begins: parameters with a value of their own
 * in every log (a spread) get one, normally distributed about the model's, by the seed; within
 * their ranges. RT. */
void mk_rig_zero(struct mk_rig *rig);

/* Truth, for tests and demos: time since the start, s. */
double mk_rig_time(const struct mk_rig *rig);
/* The true state, mk_model_state_count() values. Borrowed, valid until the rig is advanced. */
const double *mk_rig_state(const struct mk_rig *rig);
/* With the values of the present log in it, no spread. */
const struct mk_model *mk_rig_model(const struct mk_rig *rig);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
