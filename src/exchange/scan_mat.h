/* The vectors of numbers that a MAT file holds, of whatever lengths. */
#ifndef MECHKIT_EXCHANGE_SCAN_MAT_H
#define MECHKIT_EXCHANGE_SCAN_MAT_H

#include <stdbool.h>
#include <stddef.h>

#include "mechkit/status.h"

struct mat_vector {
    char name[64]; /* "run.signals.q1", "Y(:,2)" */
    size_t rows;
    double *data;
};

struct mat_scan {
    struct mat_vector *vector;
    size_t count, room;
    char left_out[200]; /* what was, and why */
    bool failed;        /* no memory */
};

/* Scans a file of `size` bytes. MK_ERR_PARSE: it is none that can be read. mat_scan_free also after
 * a failure. */
MK_NODISCARD enum mk_status mat_scan(const char *path, size_t size, struct mat_scan *c,
                                     struct mk_error *err);
/* The same by a process of its own, which says nothing: what reads version 7.3 dies of some damaged
 * files, and prints a page of its own about others. MK_ERR_PARSE then. */
MK_NODISCARD enum mk_status mat_scan_apart(const char *path, size_t size, struct mat_scan *c,
                                           struct mk_error *err);
void mat_scan_free(struct mat_scan *c);
/* Notes that a vector of that name was left out. */
void mat_scan_leave_out(struct mat_scan *c, const char *name, const char *why);

#endif
