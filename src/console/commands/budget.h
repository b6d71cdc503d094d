/* The budget of the gap as a table for people. */
#ifndef MECHKIT_CONSOLE_COMMANDS_BUDGET_H
#define MECHKIT_CONSOLE_COMMANDS_BUDGET_H

#include <stdio.h>

#include "mechkit/explain.h"

/* What free runs on held-out data get wrong, what that is due to, and what is left. */
void budget_print(FILE *out, const struct mk_explanation *e);

#endif
