/* Spectra of sampled signals by Welch's method: the mean over overlapping segments under a Hann
 * window. */
#ifndef MECHKIT_BASE_SPECTRUM_H
#define MECHKIT_BASE_SPECTRUM_H

#include <stddef.h>

#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Of an input x and an output y, at `count` frequencies; all arrays in one block of memory. */
struct mk_spectrum {
    size_t count;
    size_t segments;
    double *f;         /* Hz, from one step above 0 to half the rate */
    double *xx, *yy;   /* power spectral densities, one-sided: unit^2 / Hz */
    double *gain;      /* |y / x| of the response that least squares gives */
    double *phase;     /* rad, unwrapped */
    double *coherence; /* 0..1: share of y that x explains */
};

/* Samples at even spacing; both of `rows` values, finite. `segment` is made a power of two, at most
 * `rows`; 0: such that there are some eight segments. MK_ERR_RANGE: fewer than 16 rows. */
MK_NODISCARD enum mk_status mk_spectrum_welch(const double *x, const double *y, size_t rows,
                                              double rate_hz, size_t segment,
                                              struct mk_spectrum *out);
void mk_spectrum_free(struct mk_spectrum *s);

/* Forward transform in place, radix 2: re + i im of n values, n a power of two. */
void mk_fft(double *re, double *im, size_t n);

#ifdef __cplusplus
}
#endif
#endif
