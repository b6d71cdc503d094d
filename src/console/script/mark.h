/* A file beside the logs that says a screen is at work there. What is left of it tells the next
 * start how the last session ended. */
#ifndef MECHKIT_CONSOLE_SCRIPT_MARK_H
#define MECHKIT_CONSOLE_SCRIPT_MARK_H

#include <stdbool.h>
#include <stddef.h>

#include "console/script/session.h"

#define MARK_NAME ".mechkit-console"

struct mark {
    char path[SESSION_PATH + 32]; /* "": another session's is there, it is left alone */
    bool running;
    char log[SESSION_PATH];
};

/* Sets the mark in `folder` (NULL: the current one). `last`: a sentence about the session before,
 * "" if it ended as it should. */
void mark_set(struct mark *m, const char *folder, char *last, size_t size);
/* What goes on; written down when it changes. */
void mark_run(struct mark *m, bool running, const char *log);
/* NULL: a proper end, nothing is left to say. Else why it ended. */
void mark_end(struct mark *m, const char *why);

#endif
