/* What the balancing setups share: when to hand over to the linear law, and when to give up.
 *
 * A setup tells its law; this part holds the state observer, the guard and its parameters. The
 * guard is the estimated region of attraction (roa.h), Meesters' box, or both. */
#ifndef MECHKIT_CTRL_BALANCE_H
#define MECHKIT_CTRL_BALANCE_H

#include "ctrl/compensate.h"
#include "ctrl/ctrl_priv.h"
#include "ctrl/lift.h"
#include "ctrl/observer.h"
#include "ctrl/roa.h"

/* Rows that a balancing setup has in its table, from row `first` on. */
enum {
    MK_BALANCE_FRICTION,
    MK_BALANCE_COMPENSATE,
    MK_BALANCE_GUARD,
    MK_BALANCE_LEVEL,
    MK_BALANCE_HORIZON,
    MK_BALANCE_RESERVE,
    MK_BALANCE_DOUBT,
    MK_BALANCE_OBSERVER,
    MK_BALANCE_LEAD,
    MK_BALANCE_ROWS
};

enum { MK_GUARD_BOX = 0, MK_GUARD_ROA = 1, MK_GUARD_BOTH = 2 };

/* clang-format off */
#define MK_BALANCE_PARAMS(first, friction, level, horizon, reserve)                                \
    [(first) + MK_BALANCE_FRICTION] = {"friction", "",                                             \
        "share of the believed friction compensated while balancing", 0.0, 1.0, friction, false},  \
    [(first) + MK_BALANCE_COMPENSATE] = {MK_COMPENSATE_ROW},                                       \
    [(first) + MK_BALANCE_GUARD] = {"guard", "",                                                   \
        "hand-over: 0 Meesters' box, 1 region of attraction, 2 both", 0.0, 2.0, 1.0, false},    \
    [(first) + MK_BALANCE_LEVEL] = {"level", "",                                                   \
        "share of the estimated region's level that is trusted", 0.01, 1.0, level, false},         \
    [(first) + MK_BALANCE_HORIZON] = {"horizon", "s",                                              \
        "how far the guard looks ahead with the believed model", 0.0, 1.0, horizon, false},        \
    [(first) + MK_BALANCE_RESERVE] = {"reserve", "",                                               \
        "share of the command that looking ahead leaves unused", 0.0, 0.9, reserve, false},        \
    [(first) + MK_BALANCE_DOUBT] = {"doubt", "",                                                   \
        "share by which looking ahead also varies the speeds", 0.0, 0.5, 0.05, false},             \
    [(first) + MK_BALANCE_OBSERVER] = {"observer", "Hz",                                           \
        "bandwidth of the state observer", 5.0, 100.0, 35.0, false},                               \
    [(first) + MK_BALANCE_LEAD] = {"lead", "samples",                                              \
        "delay that is made up for by prediction: the board's own is 1", 0.0, 4.0, 1.5, false}
/* clang-format on */

struct mk_balance {
    struct mk_observer observer;
    struct mk_model world;           /* what the law predicts with: `remaining`, or the plant */
    struct mk_model remaining;       /* mk_remaining_model of what is believed */
    struct mk_equilibria equilibria; /* of that */
    struct mk_lift lift;             /* energy that the world has beside the plant's */
    bool bent;                       /* it has effects, and the law holds it */
    struct mk_roa roa;
    double fallen[MK_MAX_JOINTS]; /* rad: an error beyond this has been lost; 0: no limit */
    /* May the box take over at x? Of the setup; RT. */
    bool (*in_box)(const struct mk_ctrl *ctrl, const double *x);
    int first; /* row of the parameters above */
};

/* Calibrates the region of attraction around `equilibrium` with the form P (joint order). The law
 * gets the ctrl as its user. Fill in `fallen`, `in_box` and `first` before. */
MK_NODISCARD enum mk_status mk_balance_prepare(struct mk_balance *b, struct mk_ctrl *ctrl,
                                               const double *equilibrium, const double *p,
                                               mk_roa_law law, struct mk_error *err);
/* Reset, and new parameters: RT. */
void mk_balance_reset(struct mk_balance *b);
void mk_balance_changed(struct mk_balance *b, const struct mk_ctrl *ctrl);

/* State at the time when the command that is computed now will act. False when the readings lead to
 * nothing finite: then x is not to be used. RT. */
bool mk_balance_observe(struct mk_balance *b, const struct mk_ctrl *ctrl,
                        const struct mk_ctrl_input *in, double *x);
/* How far the equilibrium where x is lies from the textbook plant's, in the angle of `joint`. RT.
 */
double mk_balance_lean(const struct mk_balance *b, const double *x, int joint);
/* Whether a trajectory (mechkit/swingup.h) says the command of the swing-up in state x: then it is
 * *u. RT. */
bool mk_balance_follow(const struct mk_balance *b, const struct mk_ctrl *ctrl,
                       const struct mk_ctrl_input *in, const double *x, double *u);
/* Next phase, from the present one: catches, falls, or stays. RT. */
enum mk_phase mk_balance_phase(const struct mk_balance *b, const struct mk_ctrl *ctrl,
                               enum mk_phase phase, const double *x);

/* LQR of the law's world without friction, sampled, where it stands near `equilibrium`: of what the
 * nominal model leaves to the law (mk_remaining_model), or of the textbook plant when that is
 * nothing or no gains can be made for it. Weights and k in joint order, P for the region of
 * attraction. `r` weighs the command of a rig with |u| <= 10. */
MK_NODISCARD enum mk_status mk_balance_design(const struct mk_ctrl *ctrl, const double *equilibrium,
                                              const double *weight, double r, double *k, double *p,
                                              struct mk_error *err);

#endif
