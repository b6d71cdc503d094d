/* mechkit design swingup: the time-optimal swing-up as a file, integrated once more by another
 * solver. */
#ifndef MECHKIT_CONSOLE_COMMANDS_DESIGN_SWINGUP_H
#define MECHKIT_CONSOLE_COMMANDS_DESIGN_SWINGUP_H

#include "mechkit/swingup.h"

struct swingup_request {
    struct mk_swingup_options options;
    const char *model_path;
    const char *out;  /* NULL: beside the model */
    const char *json; /* NULL: none */
};

/* Returns an exit code: EXIT_RUN_FAILED besides when the independent integration does not arrive.
 */
int design_swingup(const struct swingup_request *request, const struct mk_model *model,
                   const struct mk_equilibrium *to);

#endif
