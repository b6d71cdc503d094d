/* What a sweep has done so far: in memory by index, and in a file beside the result, a line a run
 * as it comes, so that a sweep that was killed goes on where it stopped. */
#ifndef MECHKIT_EXPERIMENT_SWEEP_JOURNAL_H
#define MECHKIT_EXPERIMENT_SWEEP_JOURNAL_H

#include "experiment/sweep.h"

struct sweep_result {
    char *text; /* columns behind the outcome; NULL: not done yet */
    int outcome;
};

struct sweep_journal {
    char path[600];
    int fd;
    size_t size;                 /* of the file's whole lines */
    const struct sweep *sweep;   /* borrowed */
    struct sweep_result *result; /* sweep->total of them */
    size_t done;
};

/* Opens OUT.journal and reads what is there; an incomplete last line is cut off. MK_ERR_BUSY: some
 * other process is at it; MK_ERR_STATE: it belongs to another sweep. sweep_journal_close also after
 * a failure. */
MK_NODISCARD enum mk_status sweep_journal_open(struct sweep_journal *j, const struct sweep *s,
                                               const char *out, struct mk_error *err);
/* Takes a result in; one thread at a time. */
MK_NODISCARD enum mk_status sweep_journal_add(struct sweep_journal *j, size_t index, int outcome,
                                              const char *text, struct mk_error *err);
/* `finished`: removes the file. */
void sweep_journal_close(struct sweep_journal *j, bool finished);

/* "index,outcome,columns\n"; in the file a checksum stands before it. Returns the length. */
int sweep_line(char *line, size_t size, size_t index, int outcome, const char *text);
/* Takes such a line apart (without its end, in place). False: it is none of this sweep. */
bool sweep_split(const struct sweep *s, char *line, size_t *index, int *outcome,
                 const char **columns);

/* Writes the result, whole or not at all: runs in order, with their values. */
MK_NODISCARD enum mk_status sweep_write_csv(const struct sweep_journal *j, const char *path,
                                            struct mk_error *err);

#endif
