/* A sweep's result summed up, in words and as a picture. */
#ifndef MECHKIT_CONSOLE_COMMANDS_SWEEP_REPORT_H
#define MECHKIT_CONSOLE_COMMANDS_SWEEP_REPORT_H

#include "experiment/sweep_journal.h"

/* Tables on standard output: outcomes by point; for explain what was taken for what, and the size
 * from which on an effect is named. */
void sweep_report(const struct sweep_journal *j);

/* A picture (.svg, .png) of the share of good outcomes: over the two axes of numbers with most
 * values as a map, over one as lines. MK_ERR_NOTSUP: no gnuplot, or nothing but words varies. */
MK_NODISCARD enum mk_status sweep_plot(const struct sweep_journal *j, const char *path,
                                       struct mk_error *err);

#endif
