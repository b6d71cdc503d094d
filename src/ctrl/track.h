/* Following a swing-up trajectory by a time-varying LQR.
 *
 * About the trajectory x*(t), u*(t) the error e = x - x* obeys e_{k+1} = A_k e_k + B_k (u_k -
 * u*_k). The gains minimise e_n' S_n e_n + sum (e' Q e + r (u - u*)^2) backward from the end, K_k =
 * (r + B' S B)^-1 B' S A,   S_k = Q + A' S (A - B K_k),   S = S_{k+1}, with S_n = P / level, the
 * region of attraction of the set-up's balancing law: e' S e is 1 at its border. u = u*_k - K_k e.
 * Where e' S_k e has grown beyond what the gains can bring back, the trajectory has been lost, and
 * for good until the next reset.
 */
#ifndef MECHKIT_CTRL_TRACK_H
#define MECHKIT_CTRL_TRACK_H

#include <stdbool.h>

#include "ctrl/roa.h"
#include "mechkit/swingup.h"

#ifdef __cplusplus
extern "C" {
#endif

struct mk_track;

/* Takes the gains of `s` for `model`, whose equilibrium `roa` is of. `s` is not kept. MK_ERR_NOMEM,
 * MK_ERR_NUMERIC. */
MK_NODISCARD enum mk_status mk_track_create(const struct mk_swingup *s, const struct mk_roa *roa,
                                            struct mk_track **out, struct mk_error *err);
void mk_track_destroy(struct mk_track *track); /* NULL allowed */
void mk_track_reset(struct mk_track *track);   /* NULL allowed; RT */

/* The command at tick time t (s) for the state x in which it will act, `ahead_s` after the state
 * that the trajectory has then. False: there is no trajectory (NULL allowed), or it is over or
 * lost, and *u is as it was. RT. */
bool mk_track_follow(struct mk_track *track, const double *x, double t, double ahead_s, double *u);

#ifdef __cplusplus
}
#endif
#endif
