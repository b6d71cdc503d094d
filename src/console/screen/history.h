/* What was typed on the command line, kept between sessions in
 * $XDG_STATE_HOME/mechkit/history (~/.local/state/mechkit/history): the newest lines, oldest first.
 * A convenience: where it cannot be read or written there is none, and nobody is told. */
#ifndef MECHKIT_CONSOLE_SCREEN_HISTORY_H
#define MECHKIT_CONSOLE_SCREEN_HISTORY_H

#include "console/screen/tui_prompt.h"

/* Before anything has been typed. */
void history_load(struct tui_prompt *p);
/* Adds what this session has typed to what is in the file by now: there may be two sessions. */
void history_save(const struct tui_prompt *p);

#endif
