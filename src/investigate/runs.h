/* Runs on the rig: coming to rest, an open-loop experiment, a setup that catches and holds. Each by
 * the control loop with all its safety rules; the motor is off before and after. */
#ifndef MECHKIT_INVESTIGATE_RUNS_H
#define MECHKIT_INVESTIGATE_RUNS_H

#include "ctrl/fault_line.h"
#include "investigate/plan.h"
#include "mechkit/board.h"
#include "mechkit/loop.h"

struct rig {
    struct mk_board *board;
    struct mk_clock clock;
    const struct mk_model *given; /* units and plant */
    double rate_hz;
    bool stream;
    struct plan_limits limits;      /* beyond which a run is stopped; NAN: the loop's own */
    bool calms;                     /* what follows says how; else nothing is done */
    double brake;                   /* command per speed of the motor joint */
    double calm[2 * MK_MAX_JOINTS]; /* gains about hanging: command per state */
    /* Where the joints that rest anywhere (arms that turn level, carriages, wheels) were at the
     * last rest, counted from the start of the first run: every run zeroes the counters anew. The
     * limits are counted from there as well. 0 where counters are too short to know. */
    double origin[MK_MAX_JOINTS];
    double zeroed_at[MK_MAX_JOINTS]; /* the same, of the last run's zero */
    bool framed;                     /* there was a first run */
    const volatile int *cancel;
    /* How far a run or a rest is (of its time), and what it is; false ends it. NULL: nobody asks.
     */
    mk_progress_fn progress;
    void *progress_context;
};

/* `model`: what is simulated where the board is virtual, else the given one. */
MK_NODISCARD enum mk_status rig_open(struct rig *r, const struct mk_board_ops *ops,
                                     const struct mk_board_config *config, bool fast,
                                     struct mk_error *err);
void rig_close(struct rig *r);           /* motor off */
double rig_seconds(const struct rig *r); /* of the board's clock */

/* Lets the motor help a rig to rest from here on: not before the signs of motor and encoders are
 * known. */
void rig_let_calm(struct rig *r);
/* Waits with the motor off until the links hang still. Links that swing on are calmed now and then,
 * if that is let: the motor then only brakes its joint, which can bring no energy in.
 * MK_ERR_TIMEOUT: they do not rest within five minutes; MK_ERR_NODEV, MK_ERR_INTR. */
MK_NODISCARD enum mk_status rig_rest(struct rig *r, struct mk_error *err);

struct rig_run {
    const struct mk_model *nominal;
    double model_off;    /* share by which it may be off before a reading that contradicts it is a
                            fault; 0: the loop's own */
    const char *log;     /* path; an empty file there is written over */
    double ran_s;        /* out: of the run's own time */
    enum mk_fault fault; /* out: what ended it */
    char fault_text[MK_FAULT_LINE];
};

/* An input from rest. MK_OK also where a fault ended it (run->fault), unless there is no log of it.
 * MK_ERR_INTR: cancelled; MK_ERR_NOSPACE, MK_ERR_IO: the log is not whole. */
MK_NODISCARD enum mk_status rig_experiment(struct rig *r, struct rig_run *run, const char *input,
                                           double seconds, struct mk_error *err);

struct rig_figures {
    bool held;
    double caught_s; /* NAN: never, or nothing to catch */
    double sway;     /* rms of the upright link about its mean, from 1 s after the catch, rad; of a
                        speed that is tracked the rms error, rad/s */
    double effort;   /* rms of the command meanwhile */
};

/* A setup from rest: caught within `catch_s`, then held for `hold_s`. */
MK_NODISCARD enum mk_status rig_control(struct rig *r, struct rig_run *run,
                                        const struct mk_ctrl_ops *setup, double catch_s,
                                        double hold_s, struct rig_figures *out,
                                        struct mk_error *err);

/* A joint (0-based) that rests anywhere. */
bool rig_rests_anywhere(const struct mk_model *model, int joint);

/* The cable, the board or the machine, not the rig: nothing is learned by another try. */
bool rig_fault_is_of_the_board(enum mk_fault fault);

#endif
