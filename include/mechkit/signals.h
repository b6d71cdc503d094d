/* Signals from measured angles: filters, derivatives with their covariance, means of repeated runs.
 *
 * Two differentiators. The report's: a zero-phase second-order Butterworth low-pass, then central
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

#define MK_CUTOFF_HZ 10.0 /* of the report, chapter 3 */

/* --- even rows ------------------------------------------------------------------------------ */

/* Second-order Butterworth low-pass run forwards and backwards: gain |H|^2 (one half at the
 * cut-off), no phase. The ends are continued by reflection through their end points, so that a
 * straight line passes unchanged. A cut-off of half the sample rate or more passes everything.
 * `out` may be `x`. MK_ERR_INVALID (period, cut-off not positive), MK_ERR_NOMEM. */
MK_NODISCARD enum mk_status mk_filter_zero_phase(const double *x, size_t rows, double period_s,
                                                 double cutoff_hz, double *out);

/* The report's differentiation: the filter above (cutoff_hz 0: MK_CUTOFF_HZ), then central
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

#ifdef __cplusplus
}
#endif
#endif
