/* --fix NAME of the subcommands that fit. */
#ifndef MECHKIT_CONSOLE_COMMANDS_FIX_H
#define MECHKIT_CONSOLE_COMMANDS_FIX_H

#include "console/commands/options.h"
#include "mechkit/model.h"

/* Sets fixed[i] for every parameter i of the model that is named. Returns EXIT_OK, or 2 when the
 * model has no parameter of a name, which has been reported. */
int fix_parameters(const char *command, const struct option_texts *names,
                   const struct mk_model *model, bool *fixed);

#endif
