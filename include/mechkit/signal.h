/* Signals for the open-loop setup and for references: an expression in t, or samples from a file.
 *
 * Expression: + - * / ^, parentheses, numbers, t, pi, and sin cos tan exp log sqrt abs sign tanh
 * min max, step(t0) (0 before, 1 from t0 on), ramp(t0), pulse(t0, t1), square(f), saw(f), chirp(f0,
 * f1, T) (linear sweep from f0 to f1 Hz over T s, then held at f1), multisine(f0, n, seed) (n
 * harmonics of f0 Hz, equal amplitude, Schroeder phases shifted by seed, scaled to a peak near 1),
 * noise(f, seed) (band-limited, repeatable). Sampled: `@FILE` reads columns t,u and holds each
 * value (zero-order hold); 0 after the end. Parsed once into a small program; evaluation is RT-safe
 * and allocates nothing.
 */
#ifndef MECHKIT_SIGNAL_H
#define MECHKIT_SIGNAL_H

#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

struct mk_signal;

/* Parses `text`. MK_ERR_PARSE with err->column = 1-based character; file errors as mk_log_read. */
MK_NODISCARD enum mk_status mk_signal_create(const char *text, struct mk_signal **out,
                                             struct mk_error *err);
/* Frees a signal. NULL allowed. */
void mk_signal_destroy(struct mk_signal *signal);
double mk_signal_at(const struct mk_signal *signal,
                    double t); /* RT; NaN only if the expression is */
/* The text that it was made of. Borrowed. */
const char *mk_signal_text(const struct mk_signal *signal);
/* Last time of a sampled signal, INFINITY for an expression. */
double mk_signal_duration(const struct mk_signal *signal);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
