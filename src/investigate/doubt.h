/* Readings that are in doubt, which nothing is learned from. */
#ifndef MECHKIT_INVESTIGATE_DOUBT_H
#define MECHKIT_INVESTIGATE_DOUBT_H

#include "mechkit/log.h"
#include "mechkit/model.h"

/* A reading that stood still while its joint cannot have: it stopped, or went on, faster than the
 * rig can. */
struct doubt {
    int joint;   /* 1-based; 0: there is none */
    double at_s; /* since when */
};

/* Cuts a log where its readings can no longer be believed: at the fault that ended its run; where
 * that says that an encoder stood still or jumped, after its last reading that was another than the
 * one before, for nobody knows since when it stood still while its joint moved; and where a reading
 * is in doubt though no fault was seen (the result). */
struct doubt doubt_cut(struct mk_log *log, const struct mk_model *model);

#endif
