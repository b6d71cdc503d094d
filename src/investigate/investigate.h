/* An investigation: from a textbook model to one that predicts this rig, by experiments that are
 * designed, run by the safe loop, and learned from, until a fresh experiment is predicted to within
 * twice its noise. DIR has the journal (journal.h), every log with the prediction that was written
 * down before it, the models, and the notebook. docs/investigate.md. */
#ifndef MECHKIT_INVESTIGATE_INVESTIGATE_H
#define MECHKIT_INVESTIGATE_INVESTIGATE_H

#include "investigate/journal.h"

struct investigate_options {
    const char *folder;
    /* What an investigation goes on with is what it began with; these two are then ignored, but for
     * the device. */
    bool resume;       /* one must have begun in the folder */
    const char *model; /* file */
    struct journal_settings settings;
    int experiments; /* the budget */
    double minutes;
    bool control;       /* at the end the rig's setups, with the given and the final model */
    const char *faults; /* script of the virtual board (docs/faults.md); NULL: none */
    int threads;
    const volatile int *cancel;
    void (*say)(void *user, const char *line); /* a line without newline */
    mk_progress_fn progress;                   /* may be NULL */
    void *user;                                /* of both */
};
void investigate_default(struct investigate_options *out);

/* Runs until it is done, cancelled (MK_ERR_INTR) or cannot go on; the journal then says where it
 * is, and the same call goes on. `out` is the journal as it is, closed; it may be filled on failure
 * as well. MK_ERR_STATE: another investigation is in the folder; MK_ERR_BUSY: another process is at
 * it; MK_ERR_EXPECT: the rig does not answer as a rig of this model would, whatever its wiring;
 * MK_ERR_FAULT: a run was ended by the board's, the machine's or too many faults. */
MK_NODISCARD enum mk_status investigate(const struct investigate_options *options,
                                        struct journal *out, struct mk_error *err);

#endif
