/* Data of plots: blocks of a gnuplot script. */
#ifndef MECHKIT_CONSOLE_COMMANDS_PLOT_DATA_H
#define MECHKIT_CONSOLE_COMMANDS_PLOT_DATA_H

#include <stdbool.h>
#include <stdio.h>

#include "mechkit/log.h"

/* Columns of a block of a log, counted as gnuplot does. */
enum {
    PLOT_T = 1,
    PLOT_Q1 = 2, /* + joint */
    PLOT_U = 4,
    PLOT_DQ1 = 5, /* + joint */
    PLOT_REF = 7
};
/* Columns of a block of differences: t, then a joint each. */
enum { PLOT_DIFFERENCE = 2 };
/* Columns of a block of spectra. */
enum { PLOT_F = 1, PLOT_PSD_U, PLOT_PSD_Q, PLOT_GAIN, PLOT_PHASE_LAG, PLOT_COHERENCE };

/* The command under whichever name; NULL when there is none. *label (may be NULL) is for an axis.
 */
const double *plot_command(const struct mk_log *log, const char **label);

/* "$name << EOD": t q1 q2 u dq1 dq2 ref. Speeds that the log lacks are slopes of the angles. A
 * blank line where a window of a prediction ends. */
void plot_put_log(FILE *f, const char *name, const struct mk_log *log);
/* Prediction minus log at the log's times. */
void plot_put_difference(FILE *f, const char *name, const struct mk_log *log,
                         const struct mk_log *with);
/* Spectra of the command and of joint `joint`'s angle (speed for a wheel), and the response between
 * them. */
MK_NODISCARD enum mk_status plot_put_spectrum(FILE *f, const char *name, const struct mk_log *log,
                                              int joint, bool speed, struct mk_error *err);

#endif
