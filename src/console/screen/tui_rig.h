/* A drawing of the rig as its encoders see it. */
#ifndef MECHKIT_CONSOLE_SCREEN_TUI_RIG_H
#define MECHKIT_CONSOLE_SCREEN_TUI_RIG_H

#include "console/screen/tui_canvas.h"
#include "mechkit/model.h"

/* `q` as in a log (docs/formats.md). */
void rig_draw(struct canvas *c, struct tui_rect r, enum mk_plant_kind plant, const double *q);

#endif
