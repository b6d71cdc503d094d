/* Is the board to be believed? Its readings say more than angles: which command is in force, how
 * many exchanges there have been, what its clock shows. Each of them is known beforehand.
 *
 * Caller's memory; everything RT.
 */
#ifndef MECHKIT_CTRL_BOARD_WATCH_H
#define MECHKIT_CTRL_BOARD_WATCH_H

#include <stdbool.h>
#include <stdint.h>

#include "mechkit/board.h"
#include "mechkit/safety.h"

/* Commands that may be in force: of a board that streams, an answer that is late acts later. */
#define MK_BOARD_WATCH_SENT 4

struct mk_board_watch {
    double sent[MK_BOARD_WATCH_SENT]; /* the last commands, the newest at [0] */
    int sent_count;                   /* of them that may be in force: 1, or all with a stream */
    bool primed;                      /* a sample has come */
    uint32_t sequence;                /* of the last one */
    int64_t board_ns;                 /* its clock .. */
    int64_t since_board_ns, since_host_ns; /* .. and both clocks when the comparison began */
    int strange;                           /* level of what does not go on, see safety.h */
    int limit;                             /* strange ones in a row */
};

/* Clocks that disagree weigh as much as so many samples that do not go on. */
#define MK_BOARD_CLOCK_WEIGHT 5

/* One sample, and what goes with it. */
struct mk_board_watch_sample {
    const struct mk_board_sample *reading;
    double sent;     /* the command that its exchange carried */
    uint64_t unseen; /* exchanges that the host knows to have missed */
    int64_t host_ns; /* host's clock at the exchange */
};

/* `limit`: of struct mk_safety_limits, stale_limit. */
void mk_board_watch_reset(struct mk_board_watch *w, bool streaming, int limit);
/* An exchange without a sample: its command may act all the same, and later. */
void mk_board_watch_miss(struct mk_board_watch *w, double sent);
/* DISOBEYED, STALE or NONE. */
enum mk_fault mk_board_watch_step(struct mk_board_watch *w, const struct mk_board_watch_sample *s);

/* Whether a command in force can come from one that was sent: it is that, or less of it. */
bool mk_board_watch_obeys(double sent, double applied);

#endif
