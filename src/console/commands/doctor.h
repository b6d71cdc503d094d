/* The doctor: looks at a machine, a board and the rig on it, a line a finding. Every check works on
 * the board interface and the board's clock alone, so that simulated rigs can be examined, in
 * simulated time, and made ill on purpose. */
#ifndef MECHKIT_CONSOLE_COMMANDS_DOCTOR_H
#define MECHKIT_CONSOLE_COMMANDS_DOCTOR_H

#include "mechkit/board.h"

enum doctor_verdict { DOCTOR_OK, DOCTOR_PROBLEM, DOCTOR_SKIPPED };

struct doctor {
    /* A finding: what was looked at, what was found, what to do ("" when nothing). */
    void (*line)(void *user, enum doctor_verdict verdict, const char *what, const char *found,
                 const char *advice);
    /* Asks the person at the rig to do something; the doctor then watches the encoders. */
    void (*ask)(void *user, const char *what);
    void *user;
    volatile int *cancel; /* may be NULL */
    int problems;
};

void doctor_say(struct doctor *d, enum doctor_verdict verdict, const char *what, const char *advice,
                const char *found, ...) MK_PRINTF(5, 6);

/* --- doctor_machine.c: nothing moves -----------------------------------------------------------
 */

/* Real-time priority, memory, and how late a 1 kHz loop wakes, measured for so long. */
void doctor_machine(struct doctor *d, double seconds);
/* Who the board is, how long exchanges take, whether its watchdog bites. False: it is of no use to
 * go on. */
bool doctor_board(struct doctor *d, struct mk_board *board, const struct mk_model *model);

/* --- doctor_rig.c ------------------------------------------------------------------------------
 */

/* Do the links hang still? Motor off. False: they do not. */
bool doctor_rest(struct doctor *d, struct mk_board *board, const struct mk_model *model);
/* Somebody turns the joints: does each encoder count, both ways, and is it the right one? */
void doctor_by_hand(struct doctor *d, struct mk_board *board, const struct mk_model *model);
/* The motor gives two short pushes: do the encoders answer as the model's would? False: no. */
bool doctor_push(struct doctor *d, struct mk_board *board, const struct mk_model *model);
/* The motor leads its joint slowly to and fro: does anything drag that the model does not know? */
void doctor_sweep(struct doctor *d, struct mk_board *board, const struct mk_model *model);

#endif
