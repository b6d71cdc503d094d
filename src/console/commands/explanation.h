/* What `explain` found, for people and into files. */
#ifndef MECHKIT_CONSOLE_COMMANDS_EXPLANATION_H
#define MECHKIT_CONSOLE_COMMANDS_EXPLANATION_H

#include <stdio.h>

#include "mechkit/explain.h"

void explanation_print(FILE *out, const struct mk_explanation *e);
/* The folder a report goes to, before time is spent on what goes in; `made`: it was not there. */
MK_NODISCARD enum mk_status explanation_make_folder(const char *path, bool *made,
                                                    struct mk_error *err);
/* report.html, report.json, extended.ini and next.cmd into a folder, which is made. `model` names
 * where the model came from, `holdouts` the logs that were held out, `shown` is one of them. Either
 * all of them or, on failure, none: an earlier report then stays. */
MK_NODISCARD enum mk_status explanation_write(const char *folder, const char *model,
                                              const struct mk_explanation *e,
                                              const char *const *holdouts, size_t holdout_count,
                                              const struct mk_log *shown, struct mk_error *err);

#endif
