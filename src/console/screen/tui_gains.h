/* The gains editor: values in force, values to be sent, and what they do to the loop. */
#ifndef MECHKIT_CONSOLE_SCREEN_TUI_GAINS_H
#define MECHKIT_CONSOLE_SCREEN_TUI_GAINS_H

#include "console/commands/poles.h"
#include "console/screen/tui_canvas.h"
#include "console/script/host.h"

struct tui_gains {
    const struct mk_ctrl_ops *setup;
    bool pending[MK_CTRL_MAX_PARAMS];
    double value[MK_CTRL_MAX_PARAMS]; /* where pending */
    int row, top;
    char edit[32]; /* number being typed; "": none */
    bool sure;     /* unstable gains: asked once */
    char note[120];
};

struct tui;
void gains_open(struct tui *t);
void gains_key(struct tui *t, int key);
/* Columns of the form on a screen of `cols`; it stands beside the scope, so that a change and its
 * effect are seen at once. */
int gains_columns(int cols);
void gains_draw(struct tui *t, struct tui_rect r);

#endif
