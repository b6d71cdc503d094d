/* The board interface: what a control loop needs of the electronics, and the table of back ends.
 *
 * Timeline of a sample: at tick k the loop calls exchange() once. The board, in one transaction,
 * latches both counters and its own clock, and starts to apply the command that came with the call.
 * So the command applied at tick k was computed from readings of tick k-1 at the latest: one sample
 * of delay, always the same, which the controllers know about. The board holds a command until the
 * next exchange, or until its watchdog zeroes it.
 *
 * A board that streams (slot stream) samples by its own clock instead. exchange() then hands in the
 * command and waits for the next sample, at whose latch the command begins to act: the same delay
 * of one sample, without the host's jitter.
 *
 * Ownership: mk_board_open allocates the handle with the back end's private data behind it;
 * mk_board_close frees it. Threads: one at a time; safe_state may also be called from another
 * thread while the loop thread is known to be stopped. Slots marked RT allocate, lock and print
 * nothing.
 */
#ifndef MECHKIT_BOARD_H
#define MECHKIT_BOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "mechkit/clock.h"
#include "mechkit/model.h"
#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

enum mk_board_capability {
    MK_BOARD_CAP_WATCHDOG = 1,  /* zeroes the command by itself */
    MK_BOARD_CAP_TIMESTAMP = 2, /* board_ns is the board's own clock */
    MK_BOARD_CAP_SIMULATED = 4, /* no motor anywhere */
    MK_BOARD_CAP_FAST = 8,      /* can run on a simulated clock */
    MK_BOARD_CAP_NO_RIG = 16,   /* its counters stand still whatever it is told */
    MK_BOARD_CAP_ADDRESSED = 32 /* not searched for: mk_board_config.device says where it is */
};

/* Bits of mk_board_sample.status. */
enum mk_board_status {
    MK_BOARD_ST_WATCHDOG = 1,  /* the watchdog has fired; the command is 0 until cleared */
    MK_BOARD_ST_SATURATED = 2, /* the applied command differs from the one sent */
    MK_BOARD_ST_FAULT = 4,     /* the board has latched a fault of its own */
    MK_BOARD_ST_OWN = 16       /* a controller of the board's own runs; the commands are ignored */
};

struct mk_board_identity {
    char name[32];                  /* back end and product */
    char firmware[32];              /* version text */
    char serial[32];                /* "" when it has none */
    int counter_bits;               /* counters wrap at 2^bits */
    int encoder_cpr[MK_MAX_JOINTS]; /* 0: the board does not know */
};

struct mk_board_sample {
    int64_t board_ns;             /* board's clock when the counters were latched */
    int32_t count[MK_MAX_JOINTS]; /* sign-extended from counter_bits */
    uint32_t status;              /* enum mk_board_status */
    uint32_t sequence;            /* +1 each exchange; a gap means lost samples */
    double u_applied;             /* command in force from this latch on, command units */
};

struct mk_board_config {
    const struct mk_model *model; /* the rig (virtual: what is simulated); copied */
    struct mk_clock *clock;       /* kept, not owned; must outlive the board */
    uint64_t seed;                /* virtual: noise */
    double count_noise;           /* virtual: counts */
    const char *fault_script;     /* virtual: see docs/faults.md; NULL: none; copied */
    const char *device;           /* which of several (docs/boards.md); NULL: the first */
    double start[MK_MAX_JOINTS];  /* virtual: start angles relative to rest, rad */
};

/* A board that is plugged in, used or not. */
struct mk_board_found {
    char device[64];       /* what mk_board_config.device takes */
    char name[48];         /* product, "" when it may not be asked */
    char where[48];        /* bus and port */
    enum mk_status status; /* MK_OK: can be opened; MK_ERR_PERM, MK_ERR_BUSY, ... */
    char note[256];        /* why not, and what to do; "" when all is well */
};

struct mk_board;

/* One row of the table of back ends. NULL slots marked optional mean "not supported". */
struct mk_board_ops {
    const char *name; /* as in --board */
    const char *help;
    unsigned capabilities; /* enum mk_board_capability */
    size_t private_size;   /* bytes the core allocates, zeroed, behind the handle */

    /* Lists the boards of this kind that are there, motor untouched; at most `max`. Returns how
     * many, or a negative mk_status. Optional: a back end without it has exactly one, or cannot
     * know (MK_BOARD_CAP_ADDRESSED). */
    int (*find)(struct mk_board_found *out, int max, struct mk_error *err);

    /* Finds and claims the device, motor off. Called once; may block up to a few seconds. On
     * failure it must have released what it took (close is then not called). */
    enum mk_status (*open)(struct mk_board *board, const struct mk_board_config *config,
                           struct mk_error *err);
    /* Who is there. May block up to 1 s. */
    enum mk_status (*identify)(struct mk_board *board, struct mk_board_identity *out,
                               struct mk_error *err);
    /* Zeroes both counters where the links are now. May block up to 1 s. */
    enum mk_status (*zero_counters)(struct mk_board *board, struct mk_error *err);
    /* One transaction, see above. |u| <= u_max, finite (the core has checked). RT. Returns MK_OK,
     * MK_ERR_TIMEOUT or MK_ERR_PROTO (this sample is lost, the next may work; *out is untouched),
     * MK_ERR_NODEV (gone for good), MK_ERR_NUMERIC (simulation failed). */
    enum mk_status (*exchange)(struct mk_board *board, double u, struct mk_board_sample *out);
    /* From now on the board samples every `period_us` by its own clock (0: no longer), first at
     * once. safe_state ends it too. Optional: MK_ERR_NOTSUP from boards that refuse. */
    enum mk_status (*stream)(struct mk_board *board, uint32_t period_us, struct mk_error *err);
    /* Zero torque now, and clears nothing. Callable at any time between open and close, also after
     * an error. RT; a board that does not answer is waited for up to 20 ms (one that is simulated
     * and follows a simulated clock: a few seconds). */
    enum mk_status (*safe_state)(struct mk_board *board);
    /* Zero torque by the board itself when no exchange came for `timeout_ms` (0: off); also clears
     * a watchdog that has fired and every fault that the board has latched: the loop calls it when
     * a run begins, which no run does before its last fault was acknowledged. Optional. */
    enum mk_status (*set_watchdog)(struct mk_board *board, unsigned timeout_ms,
                                   struct mk_error *err);
    /* Motor off, everything released. Always called exactly once after a successful open. */
    void (*close)(struct mk_board *board);
    /* Of a back end that does not know beforehand whether its board can run on a simulated clock
     * (no MK_BOARD_CAP_FAST): asks the board, which from here on follows board->clock. Called once,
     * after open. MK_ERR_NOTSUP: the board is a real one. Optional. */
    enum mk_status (*follow)(struct mk_board *board, struct mk_error *err);
};

struct mk_board {
    const struct mk_board_ops *ops;
    double u_max; /* limit of the command, from the model */
    struct mk_clock *clock;
    bool gone;  /* exchange has returned MK_ERR_NODEV */
    void *priv; /* the back end's private data */
};

/* Whether a back end may run on a simulated clock: its board may still refuse. */
static inline bool mk_board_may_be_fast(const struct mk_board_ops *ops)
{
    return (ops->capabilities & MK_BOARD_CAP_FAST) != 0 || ops->follow != NULL;
}

/* Table of back ends, index from 0; NULL out of range. Static. */
const struct mk_board_ops *mk_board_backend(int index);
/* The back end of that name ("virtual", "usb" ...); NULL: unknown. Static. */
const struct mk_board_ops *mk_board_backend_by_name(const char *name);

/* Opens a board; nothing moves. The caller closes it; the clock must outlive it. On failure *out is
 * NULL: MK_ERR_INVALID (no back end, model or clock, a limit u_max that is not above 0, a device of
 * a kind that has only one board), MK_ERR_NOTSUP (a simulated clock, and the board runs in real
 * time only), MK_ERR_NOMEM, and what the back end's open() returns. */
MK_NODISCARD enum mk_status mk_board_open(const struct mk_board_ops *ops,
                                          const struct mk_board_config *config,
                                          struct mk_board **out, struct mk_error *err);
void mk_board_close(struct mk_board *board); /* motor off first; NULL allowed */

struct mk_rig;
/* Tests and demos: the rig behind a virtual board (NULL for others), at the board's time. Borrowed
 * until the board is closed. */
struct mk_rig *mk_board_virtual_rig(struct mk_board *board);

/* Exchange with the checks every back end relies on: a command that is not finite or beyond u_max
 * is MK_ERR_RANGE and puts the board into its safe state; a board that is gone stays gone. RT.
 * Inline, so that the loop needs nothing of the driver but this table. */
static inline enum mk_status mk_board_exchange(struct mk_board *board, double u,
                                               struct mk_board_sample *out)
{
    if (board->gone)
        return MK_ERR_NODEV;
    if (!(u <= board->u_max && u >= -board->u_max)) {
        (void)board->ops->safe_state(board);
        return MK_ERR_RANGE;
    }
    enum mk_status st = board->ops->exchange(board, u, out);
    if (st == MK_ERR_NODEV)
        board->gone = true;
    return st;
}

/* Difference of two wrapped counters, the short way round. RT. */
static inline int32_t mk_counter_difference(int32_t now, int32_t before, int bits)
{
    uint32_t d = ((uint32_t)now - (uint32_t)before) << (32 - bits);
    return (int32_t)d >> (32 - bits);
}

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
