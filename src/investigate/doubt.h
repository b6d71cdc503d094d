/* Readings that a fault puts in doubt, which nothing is learned from. */
#ifndef MECHKIT_INVESTIGATE_DOUBT_H
#define MECHKIT_INVESTIGATE_DOUBT_H

#include "mechkit/log.h"
#include "mechkit/model.h"

/* Cuts a log where its readings can no longer be believed: at the fault that ended its run, and
 * where an encoder stood still or jumped, after its last reading that was another than the one
 * before. Nobody knows since when it stood still while its joint moved. */
void doubt_cut(struct mk_log *log, const struct mk_model *model);

#endif
