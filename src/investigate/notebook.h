/* The notebook of an investigation, for people: DIR/notebook.html (self-contained) and
 * DIR/notebook.md. */
#ifndef MECHKIT_INVESTIGATE_NOTEBOOK_H
#define MECHKIT_INVESTIGATE_NOTEBOOK_H

#include "investigate/journal.h"

MK_NODISCARD enum mk_status notebook_write(const struct journal *j, struct mk_error *err);

#endif
