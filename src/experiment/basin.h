/* From where does a setup balance? A run from a state near the upright position, the controller
 * switched on at that moment, in simulated time. */
#ifndef MECHKIT_EXPERIMENT_BASIN_H
#define MECHKIT_EXPERIMENT_BASIN_H

#include "experiment/linear.h"
#include "experiment/robustness.h"

struct basin_start {
    double off[2 * MK_MAX_JOINTS]; /* q1 q2 v1 v2, off the equilibrium at rest */
    double within_s;               /* caught after at most so long */
    double hold_s;                 /* and not let go of for so long */
};

enum basin_end { BASIN_HELD, BASIN_NOT_CAUGHT, BASIN_FELL };

struct basin_run {
    enum basin_end end;
    double caught_s; /* NAN: not */
    double u_peak;   /* command units */
    double tilt_rad; /* largest tilt of the upright link */
};

/* `spread` and `seed` say what rig it is, as in trial_run. */
MK_NODISCARD enum mk_status basin_run(const struct mk_ctrl_ops *setup,
                                      const struct mk_model *nominal,
                                      const struct trial_spread *spread,
                                      const struct basin_start *start, uint64_t seed,
                                      struct basin_run *out, struct mk_error *err);

#endif
