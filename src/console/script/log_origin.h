/* Metadata by which the log of a run can be filed: when, where and on which model it was made. */
#ifndef MECHKIT_CONSOLE_SCRIPT_LOG_ORIGIN_H
#define MECHKIT_CONSOLE_SCRIPT_LOG_ORIGIN_H

#include "console/script/session.h"

#define LOG_ORIGIN_ROWS 6

struct log_origin {
    struct mk_log_meta row[LOG_ORIGIN_ROWS]; /* point into `text` */
    size_t count;
    size_t used;
    char text[8192];
};

/* What is to be said of a run that begins now. In simulated time nothing that differs from one time
 * to the next, so that the same seed gives the same log: no date but that of SOURCE_DATE_EPOCH, and
 * no host. */
void log_origin_of(struct log_origin *origin, const struct session *s);

#endif
