/* How well a setup does on rigs that are not what its controller believes: trials of the whole
 * chain (virtual board, loop, controller) in simulated time, repeatable by seed. */
#ifndef MECHKIT_CONSOLE_ROBUSTNESS_H
#define MECHKIT_CONSOLE_ROBUSTNESS_H

#include <stdbool.h>
#include <stdint.h>

#include "mechkit/ctrl.h"
#include "mechkit/model.h"

struct trial_spread {
    double parameters;    /* plant parameters are off by up to this share */
    double friction;      /* and the friction of the motor joint by up to this */
    double offset_counts; /* zero of each encoder, by up to this */
    int delay_samples;    /* more than the board's own */
    double rate_hz;
    double catch_s, hold_s; /* caught within, then held for */
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
    char fault[64]; /* "": none */
};

/* The upright link's angle from the upward vertical. */
double trial_tilt(enum mk_plant_kind plant, const double *q);

/* The rig of a seed: `believed` with its parameters, friction, encoders and delay off. */
MK_NODISCARD enum mk_status trial_rig(const struct mk_model *believed,
                                      const struct trial_spread *spread, uint64_t seed,
                                      struct mk_model *out, struct mk_error *err);

/* One run from hanging rest. A run that fails is an outcome, not an error. */
MK_NODISCARD enum mk_status trial_run(const struct mk_ctrl_ops *setup,
                                      const struct mk_model *believed,
                                      const struct trial_spread *spread, uint64_t seed,
                                      struct trial *out, struct mk_error *err);

#endif
