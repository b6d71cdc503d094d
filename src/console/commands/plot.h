/* Plots of logs as gnuplot scripts. */
#ifndef MECHKIT_CONSOLE_COMMANDS_PLOT_H
#define MECHKIT_CONSOLE_COMMANDS_PLOT_H

#include <stdio.h>

#include "mechkit/log.h"
#include "mechkit/status.h"

#define PLOT_MAX_LOGS 8

enum plot_kind {
    PLOT_RUN,      /* angles, command, phase plane */
    PLOT_SPECTRUM, /* spectra, and the response of angles to the command */
    PLOT_PHASE     /* phase plane of every joint */
};

struct plot {
    enum plot_kind kind;
    const struct mk_log *logs[PLOT_MAX_LOGS];
    const char *names[PLOT_MAX_LOGS];
    int count;
    const struct mk_log *with; /* a prediction of the first log; NULL: none */
    const char *title;         /* NULL: what the first log says it is */
    const char *out;           /* FILE.svg, FILE.png; NULL: a terminal */
    int width, height;         /* pixels, or characters of a panel in a terminal */
};

/* Panels that come one below the other in a terminal; the logs have been read. */
int plot_panels(const struct plot *plot);
/* Writes the script. MK_ERR_PARSE: a log has no angle, or spectra are wanted of too few samples;
 * MK_ERR_NOMEM. */
MK_NODISCARD enum mk_status plot_script(FILE *f, const struct plot *plot, struct mk_error *err);

#endif
