/* Logs that a killed program left. */
#ifndef MECHKIT_INVESTIGATE_SALVAGE_H
#define MECHKIT_INVESTIGATE_SALVAGE_H

#include "investigate/journal.h"

/* A log that is there already is kept, and its experiment not run again: *found, and the experiment
 * is filled with how long it ran. One without a row was not run: it is put aside under another
 * name. MK_ERR_IO; MK_ERR_STATE: a hundred were put aside already. */
MK_NODISCARD enum mk_status salvage_log(struct experiment *x, const char *path, bool *found,
                                        struct mk_error *err);

#endif
