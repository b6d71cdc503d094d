/* Gain design for linear state feedback u = -K x (Eigen behind a C door).
 *
 * Matrices are plain arrays, row-major: A n x n, B n x 1 (one motor), K 1 x n, n <= MK_DESIGN_MAX.
 * Nothing is RT-safe; nothing is kept. Numerical failures are MK_ERR_NUMERIC with a reason.
 */
#ifndef MECHKIT_DESIGN_H
#define MECHKIT_DESIGN_H

#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

#define MK_DESIGN_MAX 8

/* Rank of the controllability matrix [B AB .. A^(n-1) B] (report 4.3, errata 4.2) by singular
 * values relative to `tolerance` (0: n * eps), and its condition number (NULL allowed). 0 when A
 * or B is not finite. */
int mk_design_controllability(int n, const double *a, const double *b, double tolerance,
                              double *condition);

/* Eigenvalues of A - B K (K NULL: of A), sorted by real part, then imaginary part. */
MK_NODISCARD enum mk_status mk_design_poles(int n, const double *a, const double *b,
                                            const double *k, double *re, double *im,
                                            struct mk_error *err);

/* Ackermann's formula. Poles come in conjugate pairs. MK_ERR_INVALID when they do not,
 * MK_ERR_NUMERIC when (A, B) is not controllable. */
MK_NODISCARD enum mk_status mk_design_ackermann(int n, const double *a, const double *b,
                                                const double *re, const double *im, double *k,
                                                struct mk_error *err);

/* Pole placement by unitary transformations of the Schur form, one pole at a time (Varga 1981):
 * accurate where Ackermann is not. Codes as Ackermann's. */
MK_NODISCARD enum mk_status mk_design_place(int n, const double *a, const double *b,
                                            const double *re, const double *im, double *k,
                                            struct mk_error *err);

/* Continuous LQR: minimises integral x'Qx + r u^2; q is n x n, symmetric >= 0, r > 0. Riccati by
 * the ordered Schur vectors of the Hamiltonian, refined by Newton-Kleinman steps. `p` (n x n) may
 * be NULL. MK_ERR_NUMERIC when B does not reach a mode that does not decay, or Q does not see one
 * on the border of stability. */
MK_NODISCARD enum mk_status mk_design_lqr(int n, const double *a, const double *b, const double *q,
                                          double r, double *k, double *p, struct mk_error *err);

/* Zero-order-hold discretisation: A_d = exp(A dt), B_d = int_0^dt exp(A s) ds B. */
MK_NODISCARD enum mk_status mk_design_c2d(int n, const double *a, const double *b, double dt,
                                          double *ad, double *bd, struct mk_error *err);

/* Discrete LQR for x+ = A x + B u by a structure-preserving doubling algorithm; else as the
 * continuous one. */
MK_NODISCARD enum mk_status mk_design_dlqr(int n, const double *a, const double *b, const double *q,
                                           double r, double *k, double *p, struct mk_error *err);

/* Discrete LQR of the continuous problem (as lqrd: cost, plant and `delay` samples of input delay,
 * 0 or 1, sampled with period dt). With a delay of one sample the state is [x, u_previous]: k has
 * n + 1 entries and p (n + 1)^2. */
MK_NODISCARD enum mk_status mk_design_lqrd(int n, const double *a, const double *b, const double *q,
                                           double r, double dt, int delay, double *k, double *p,
                                           struct mk_error *err);

/* Solves A' P + P A = -Q (Lyapunov), Q symmetric. MK_ERR_NUMERIC when A is not Hurwitz. */
MK_NODISCARD enum mk_status mk_design_lyapunov(int n, const double *a, const double *q, double *p,
                                               struct mk_error *err);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
