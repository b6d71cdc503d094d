/* Time-optimal swing-up: a trajectory from hanging rest to an equilibrium, and its use by a set-up.
 *
 * The trajectory is that of the textbook plant with the motor's friction, which is what controllers
 * see of a rig: what a model has in effects is made up for (docs/theory.md, section 6). The command
 * is held from one sample to the next. docs/swingup.md has the problem and its solution.
 *
 * Nothing here is RT-safe; a set-up that follows a trajectory allocates nothing while it does.
 */
#ifndef MECHKIT_SWINGUP_H
#define MECHKIT_SWINGUP_H

#include <stddef.h>

#include "mechkit/ctrl.h"
#include "mechkit/model.h"
#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

#define MK_SWINGUP_STATES 4 /* q1 q2 v1 v2 */

struct mk_swingup_options {
    double rate_hz; /* of the loop that will follow it, 100 .. 2000; default 500 */
    /* Share of the command that the trajectory leaves to whoever follows it, 0 .. 0.6: its bound is
     * (1 - reserve) u_max. 0 is the time-optimal one, which nothing can correct. */
    double reserve;
    /* By which share it takes longer than the shortest with that bound, 0 .. 1: time that it uses
     * for less command where that costs least. */
    double slack;
};
/* MK_LOOP_RATE_HZ, a reserve of 0.25, a slack of 0.1. */
void mk_swingup_default(struct mk_swingup_options *out);

struct mk_swingup {
    struct mk_model model; /* the textbook plant that it is of: no effects */
    int equilibrium;       /* where it ends: index into the plant's equilibria */
    double rate_hz;
    double limit;     /* largest |u| that it was allowed */
    double optimum_s; /* the shortest swing-up that was found for |u| <= u_max */
    size_t count;     /* samples for which a command is held */
    double *u;        /* count commands */
    double *x;        /* (count + 1) * MK_SWINGUP_STATES: the states at the samples */
};

/* Finds the trajectory to equilibrium number `equilibrium` of the model's plant: travel and speed
 * stay within 90 % of the plant's safety limits. Takes seconds on all processors; the same problem
 * gives the same answer. MK_ERR_NOTSUP: not a rig of two joints, or nothing has to be swung up to
 * that equilibrium; MK_ERR_RANGE: an option; MK_ERR_NUMERIC: no swing-up was found; MK_ERR_NOMEM.
 * On success the caller owns *out: mk_swingup_free. */
MK_NODISCARD enum mk_status mk_swingup_design(const struct mk_model *model, int equilibrium,
                                              const struct mk_swingup_options *options,
                                              struct mk_swingup **out, struct mk_error *err);
void mk_swingup_free(struct mk_swingup *swingup); /* NULL allowed */

/* As a log (docs/formats.md, "Swing-up trajectory"): columns t, u, q1, q2, dq1, dq2, and metadata
 * that say what it is for. MK_ERR_IO, MK_ERR_NOSPACE, MK_ERR_PERM, MK_ERR_NOMEM. */
MK_NODISCARD enum mk_status mk_swingup_write(const char *path, const struct mk_swingup *swingup,
                                             struct mk_error *err);
/* Errors name file and line: those of mk_log_read, and MK_ERR_PARSE for what is no trajectory:
 * metadata that are missing or wrong, samples that are not equally spaced, commands beyond the
 * bound, a start or an end elsewhere, a row that does not follow from the one before. */
MK_NODISCARD enum mk_status mk_swingup_read(const char *path, struct mk_swingup **out,
                                            struct mk_error *err);

/* From its next reset on the set-up follows the trajectory of the file first, by a time-varying
 * LQR, and swings up by energy where it is thrown off it. Between runs. MK_ERR_INVALID, with file
 * and line, for a trajectory of another rig, to another equilibrium, of other parameters, or for
 * another sample rate; the errors of mk_swingup_read; MK_ERR_NOMEM. path NULL: by energy from the
 * start. */
MK_NODISCARD enum mk_status mk_ctrl_load_swingup(struct mk_ctrl *ctrl, const char *path,
                                                 struct mk_error *err);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
