/* The one line on a terminal that says how far a calculation is. */
#ifndef MECHKIT_CONSOLE_COMMANDS_PROGRESS_H
#define MECHKIT_CONSOLE_COMMANDS_PROGRESS_H

#include <stdbool.h>
#include <stddef.h>

struct progress {
    double begin_s; /* monotonic */
    double most;    /* share done, the largest so far: the line only rises */
    int percent, second;
    bool shown;
};

/* False: standard error is no terminal, nobody is told. */
bool progress_begin(struct progress *p);
/* The callback of calculations; `context` is a struct progress. Returns true: go on. */
bool progress_show(void *context, double done, const char *what);
/* Takes the line away. */
void progress_end(struct progress *p);

/* What the line says `passed_s` after the beginning: share, time passed and, once enough is done to
 * tell, expected. Returns buf. */
const char *progress_text(struct progress *p, double passed_s, double done, const char *what,
                          char *buf, size_t size);

#endif
