/* How a run followed the steps of its reference. */
#ifndef MECHKIT_CONSOLE_COMMANDS_STEP_RESPONSE_H
#define MECHKIT_CONSOLE_COMMANDS_STEP_RESPONSE_H

#include <stddef.h>

/* Settled: within this share of the step, for good. */
#define STEP_BAND 0.02

struct step_response {
    double t; /* s, when the reference jumped */
    double from,
        to;        /* from what was measured there to the new reference, in the reference's unit */
    double rise_s; /* from 10 to 90 % of the step; NAN: it did not get there */
    double overshoot; /* beyond the new reference, as a share of the step; 0: none */
    double settle_s;  /* from the jump on until within STEP_BAND of the step; NAN: not settled */
};

/* Steps of a reference `ref` that `y` is to follow, at times `t`: the first `room` of them. A step
 * is a jump to a value that is held for STEP_HOLD_S at least; ramps and sines have none. Lost
 * readings (NAN) are passed over. Returns how many there are. */
#define STEP_HOLD_S 0.2
size_t step_responses(const double *t, const double *ref, const double *y, size_t rows,
                      struct step_response *out, size_t room);
/* One line for people; returns buf. `unit`: of the reference. */
const char *step_response_line(const struct step_response *s, const char *unit, char *buf,
                               size_t size);

#endif
