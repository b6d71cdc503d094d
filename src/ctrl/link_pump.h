/* Energy swing-up of a free second link through the acceleration of the driven first one: the
 * pendubot's and the Furuta pendulum's.
 *
 * Collocated partial feedback linearisation makes a1 = v1 (report (2.13)-(2.17)). The free link is
 * then a pendulum whose pivot is moved at will, and its energy
 *     E = J w^2 / 2 + m g l (cos of its angle from upright - 1),   0 upright and at rest,
 * changes by dE/dt = -c w a1 + .., w its absolute speed and c the coupling of the two links. So
 *     v1 = A sat(k E c w) pumps |E| down from either side (Astroem and Furuta 2000).
 * What the report misses in its own swing-up, the motion of the second link, is all this law looks
 * at. To that come: a hold of link 1 at its target that grows as the pump has less to do
 * (1 - |sat|), so that link 1 is in place when link 2 arrives; a weak centring that is always on;
 * the hold alone when link 1 has strayed beyond `reach`, or is still on its way up. A run that has
 * not been caught for `patience` seconds goes on with another strength and another energy: friction
 * and wrong parameters can make a limit cycle of one strength, hardly of four. */
#ifndef MECHKIT_CTRL_LINK_PUMP_H
#define MECHKIT_CTRL_LINK_PUMP_H

#include "mechkit/ctrl.h"

/* Rows that a setup has in its table for it, from row `first` on. */
enum {
    MK_PUMP_STRENGTH,
    MK_PUMP_GAIN,
    MK_PUMP_ENERGY,
    MK_PUMP_REACH,
    MK_PUMP_PATIENCE,
    MK_PUMP_HOLD_P,
    MK_PUMP_HOLD_D,
    MK_PUMP_SPEED,
    MK_PUMP_CENTRE_P,
    MK_PUMP_CENTRE_D,
    MK_PUMP_ROWS
};

/* clang-format off */
/* `unit` of the joint that the motor drives, `link` its name; the starting values in the order of
 * the enumeration. */
#define MK_PUMP_ROWS_OF(first, unit, link, strength, gain, energy, reach, patience, hold_p, hold_d,\
                        speed, centre_p, centre_d)                                                 \
    [(first) + MK_PUMP_STRENGTH] = {"pump", unit "/s^2",                                           \
        "acceleration of " link " that pumps energy", 0.0, 500.0, strength, false},                \
    [(first) + MK_PUMP_GAIN] = {"pump_gain", "",                                                   \
        "how sharply the pump switches", 0.1, 1000.0, gain, false},                                \
    [(first) + MK_PUMP_ENERGY] = {"pump_energy", "",                                               \
        "energy aimed at above upright rest, in m g l", -1.0, 1.0, energy, false},                 \
    [(first) + MK_PUMP_REACH] = {"reach", unit,                                                    \
        link " pumps within this of its target", (reach) < 1.0 ? 0.01 : 0.1, 3.0, reach, false},   \
    [(first) + MK_PUMP_PATIENCE] = {"patience", "s",                                               \
        "not caught for so long: pump with another strength", 0.5, 60.0, patience, false},         \
    [(first) + MK_PUMP_HOLD_P] = {"hold_p", "1/s^2",                                               \
        "stiffness with which " link " is held", 0.0, 2000.0, hold_p, false},                      \
    [(first) + MK_PUMP_HOLD_D] = {"hold_d", "1/s",                                                 \
        "damping of that", 0.1, 200.0, hold_d, false},                                             \
    [(first) + MK_PUMP_SPEED] = {"hold_speed", unit "/s",                                          \
        "speed at which " link " goes to its target", 0.1, 50.0, speed, false},                    \
    [(first) + MK_PUMP_CENTRE_P] = {"centre_p", "1/s^2",                                           \
        "stiffness that is always on", 0.0, 500.0, centre_p, false},                               \
    [(first) + MK_PUMP_CENTRE_D] = {"centre_d", "1/s",                                             \
        "damping that is always on", 0.0, 100.0, centre_d, false}
#define MK_PUMP_PARAMS(first, strength, gain, energy, patience, hold_p, hold_d, speed, centre_p,   \
                       centre_d)                                                                   \
    MK_PUMP_ROWS_OF(first, "rad", "link 1", strength, gain, energy, 1.2, patience, hold_p, hold_d, \
                    speed, centre_p, centre_d)
/* clang-format on */

/* Command that makes the driven joint accelerate by v1 in state x (joint order): collocated partial
 * feedback linearisation, friction included. `model` is the law's world, of which effects with no
 * memory act as they do at time 0, or the textbook plant. RT. */
double mk_pfl_command(const struct mk_model *model, const double *x, double v1);

/* Energy of the free link as above, in units of m g l: -2 hanging, 0 upright. RT. */
double mk_link_energy(const struct mk_model *model, const double *x);

/* Acceleration v1 for state x, link 1 to be near `target`, `since_s` after the swing-up began;
 * `lift` is the energy that the free link has beside that of the plant (mk_lift_share). `row` are
 * the MK_PUMP_ROWS values. RT. */
double mk_link_pump(const struct mk_model *model, const double *x, double target, double since_s,
                    double lift, const double *row);

#endif
