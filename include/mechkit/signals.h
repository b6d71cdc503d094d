/* Signals from measured angles: filters, derivatives with their covariance, means of repeated runs.
 *
 * Two differentiators. Meesters': a zero-phase second-order Butterworth low-pass, then central
 * differences. It needs even rows and a cut-off, and says nothing about its error. And a smoother
 * (Kalman filter forwards, Bryson-Frazier backwards) that takes the jerk for white noise: it gives
 * position, speed and acceleration together with their covariance at every row, finds its bandwidth
 * and the noise of the readings by maximum likelihood, and takes uneven rows and holes as they are.
 *
 * Angles rad, times s. Pure functions: may run at the same time. They allocate; not RT-safe.
 */
#ifndef MECHKIT_SIGNALS_H
#define MECHKIT_SIGNALS_H

#include <stddef.h>

#include "mechkit/model.h"
#include "mechkit/sim.h"
#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

#define MK_CUTOFF_HZ 10.0 /* of the report, chapter 3 */

/* --- even rows ------------------------------------------------------------------------------ */

/* Second-order Butterworth low-pass run forwards and backwards: gain |H|^2 (one half at the
 * cut-off), no phase. The ends are continued by reflection through their end points, so that a
 * straight line passes unchanged. A cut-off of half the sample rate or more passes everything.
 * `out` may be `x`. MK_ERR_INVALID (period, cut-off not positive), MK_ERR_NOMEM. */
MK_NODISCARD enum mk_status mk_filter_zero_phase(const double *x, size_t rows, double period_s,
                                                 double cutoff_hz, double *out);

/* Meesters' differentiation: the filter above (cutoff_hz 0: MK_CUTOFF_HZ), then central
 * differences; the end rows repeat their neighbours. Each of q_out, v, a has `rows` values; q_out
 * may be q. MK_ERR_RANGE: fewer than 3 rows. */
MK_NODISCARD enum mk_status mk_differentiate(const double *q, size_t rows, double period_s,
                                             double cutoff_hz, double *q_out, double *v, double *a);

/* --- smoothing ------------------------------------------------------------------------------ */

struct mk_smooth_options {
    double noise;     /* standard deviation of a reading, rad; 0: maximum likelihood */
    double jerk;      /* intensity of the white jerk, rad/s^3 per sqrt(Hz); 0: maximum likelihood */
    double roughness; /* factor on that intensity; 0: 1. Above 1: less bias, more noise */
};

/* Covariance of (q, v, a) at a row: qq, qv, qa, vv, va, aa. */
#define MK_SMOOTH_COV 6

struct mk_smooth_figures {
    double noise, jerk; /* as given or found; jerk with the roughness in it */
    size_t readings;    /* rows with a reading */
};

/* Position, speed and acceleration at the rows of t (strictly increasing) from the readings q, NaN
 * where there is none. v, a and cov (rows x MK_SMOOTH_COV) may be NULL, as may options and found.
 * q_out may be q. MK_ERR_RANGE: fewer than 5 readings, or time that does not increase.
 * MK_ERR_NOMEM. Memory besides the results: a few thousand rows. */
MK_NODISCARD enum mk_status mk_smooth(const double *t, const double *q, size_t rows,
                                      const struct mk_smooth_options *options, double *q_out,
                                      double *v, double *a, double *cov,
                                      struct mk_smooth_figures *found);

/* --- repeated runs -------------------------------------------------------------------------- */

#define MK_MAX_SIGNALS (MK_MAX_JOINTS + MK_MAX_INPUTS)

/* Mean of runs of the same experiment, row by row, on the time base of the first. */
struct mk_repeats {
    size_t runs;
    struct mk_log *mean; /* t, q1, (q2,) and the command under its name; NaN: no run has a value */
    double *shift_s;     /* by run: its time less that of the first, from either's first row */
    int signals;         /* angles, then commands */
    /* Sample covariance between the signals of one run (that of the mean is 1 / runs of it):
     * rows x signals x signals, NaN where fewer than two runs have all of them. */
    double *covariance;
    double pooled[MK_MAX_SIGNALS * MK_MAX_SIGNALS]; /* its mean over the rows */
    double rms[MK_MAX_SIGNALS];                     /* of each signal of the mean about its mean */
};

/* Averages `count` logs (2 at least) that fit `model`. Runs are shifted in time by whole rows, up
 * to a second, to where all their signals agree best with the first run's. Whether they are repeats
 * at all is for the caller to judge, by `pooled` beside `rms`. MK_ERR_PARSE (a log does not fit the
 * model), MK_ERR_RANGE (fewer than 2 runs, different sample rates, less than half in common),
 * MK_ERR_NOMEM. The caller frees *out. */
MK_NODISCARD enum mk_status mk_average_runs(const struct mk_model *model,
                                            const struct mk_log *const *logs, size_t count,
                                            struct mk_repeats **out, struct mk_error *err);
void mk_repeats_free(struct mk_repeats *repeats); /* NULL allowed */

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
