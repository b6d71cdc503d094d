/* How well a setup does on rigs that are not what its controller believes: trials of the whole
 * chain (virtual board, loop, controller) in simulated time, repeatable by seed. */
#ifndef MECHKIT_EXPERIMENT_ROBUSTNESS_H
#define MECHKIT_EXPERIMENT_ROBUSTNESS_H

#include <stdbool.h>
#include <stdint.h>

#include "ctrl/fault_line.h"
#include "mechkit/ctrl.h"
#include "mechkit/model.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A parameter of the setup that is not what the setup gives it. */
struct trial_change {
    int index;
    double value;
};

struct trial_spread {
    double parameters;    /* plant parameters are off by up to this share */
    double friction;      /* and the friction of the motor joint by up to this */
    double offset_counts; /* zero of each encoder, by up to this */
    int delay_samples;    /* more than the board's own */
    double rate_hz;
    double catch_s, hold_s; /* caught within, then held for */
    const char *swingup;    /* file of a trajectory that is followed; NULL: none */
    int change_count;
    struct trial_change change[MK_CTRL_MAX_PARAMS];
};
void trial_spread_default(struct trial_spread *out);

enum trial_end { TRIAL_HELD, TRIAL_NEVER_CAUGHT, TRIAL_FELL, TRIAL_NOT_STILL, TRIAL_FAULT };
const char *trial_end_name(enum trial_end end);

struct trial {
    uint64_t seed; /* 0: the rig is exactly what the controller believes, no delay, no offset */
    struct mk_model rig;
    enum trial_end end;
    double caught_s; /* when the catch that held was made; NAN: none */
    int falls;       /* catches that did not hold */
    double u_peak;   /* command units */
    double tilt_rad; /* largest tilt of the upright link while held, from 1 s after the catch */
    double travel_rad;
    /* While held, from 1 s after the catch, of the true motion; NAN: never for so long. */
    double sway_rad;    /* rms of the upright link about its own mean */
    double off_rad;     /* rms of the motor joint from where the textbook plant would be held; of a
                           wheel's pendulum the same as its tilt */
    double effort;      /* rms of the command; of a setup that tracks over all of the run */
    double track_radps; /* rms error of such a setup's speed; NAN: it balances */
    char fault[MK_FAULT_LINE]; /* "": none */
};

/* A run on a rig that need not be what the controller believes. */
struct trial_setting {
    const struct mk_model *rig;
    double rate_hz, catch_s, hold_s;
    double start_rad[MK_MAX_JOINTS]; /* from hanging rest */
    double count_noise;              /* standard deviation, counts */
    uint64_t seed;                   /* of that */
};

/* Puts the changes into a controller. MK_ERR_RANGE names the parameter. */
MK_NODISCARD enum mk_status trial_make_changes(const struct trial_spread *spread,
                                               struct mk_ctrl *ctrl, struct mk_error *err);

/* The upright link's angle from the upward vertical. */
double trial_tilt(enum mk_plant_kind plant, const double *q);

/* The rig of a seed: `nominal` with its parameters, friction, encoders and delay off. */
MK_NODISCARD enum mk_status trial_rig(const struct mk_model *nominal,
                                      const struct trial_spread *spread, uint64_t seed,
                                      struct mk_model *out, struct mk_error *err);

/* One run from hanging rest. A run that fails is an outcome, not an error. */
MK_NODISCARD enum mk_status trial_run(const struct mk_ctrl_ops *setup,
                                      const struct mk_model *nominal,
                                      const struct trial_spread *spread, uint64_t seed,
                                      struct trial *out, struct mk_error *err);

/* One run of a controller, which goes through it from its reset; for `hold_s` if it does not
 * balance. */
MK_NODISCARD enum mk_status trial_run_on(struct mk_ctrl *ctrl, const struct trial_setting *setting,
                                         struct trial *out, struct mk_error *err);

/* The model's angles count from the vertical, the counters from where the links hang: where effects
 * such as a tilted base or a cable make these two, the rig gets encoder offsets for the difference
 * and starts where it hangs. MK_ERR_NUMERIC when it hangs nowhere near. */
MK_NODISCARD enum mk_status trial_hang(const struct mk_model *model, struct mk_model *rig,
                                       double *start_rad, struct mk_error *err);

#ifdef __cplusplus
}
#endif

#endif
