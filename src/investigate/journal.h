/* The journal of an investigation: what was planned, run and learned, in DIR/journal.json. It is
 * written whole at every step (temporary file and rename), before and after the rig moves, so that
 * a program that is killed is gone on with where it was. Whoever has it open holds the folder's
 * lock. */
#ifndef MECHKIT_INVESTIGATE_JOURNAL_H
#define MECHKIT_INVESTIGATE_JOURNAL_H

#include <stdbool.h>
#include <stdint.h>

#include "investigate/plan.h"
#include "mechkit/model.h"
#include "mechkit/status.h"

#define JOURNAL_EXPERIMENTS 64
#define JOURNAL_PATH 512
#define JOURNAL_DATE 32
#define JOURNAL_TEXT 480
#define JOURNAL_ITEMS 12
#define JOURNAL_CONTROLS 8

enum experiment_kind {
    EXPERIMENT_FIRST,  /* tells most about a rig of which a textbook model is known */
    EXPERIMENT_RIVALS, /* between causes that the data cannot tell apart */
    EXPERIMENT_REST,   /* about a rest without a name */
    EXPERIMENT_KNOW,   /* about what is known least */
    EXPERIMENT_TEST,   /* of the model: nothing was fitted to it before it was judged */
    EXPERIMENT_KINDS
};
const char *experiment_kind_name(enum experiment_kind kind); /* "first", ... */

enum experiment_state {
    EXPERIMENT_PLANNED, /* its prediction is on the disk; it may have been begun */
    EXPERIMENT_RUN,     /* its log is whole, or as whole as it will be */
    EXPERIMENT_JUDGED,  /* its prediction was held against the log */
    EXPERIMENT_LEARNED, /* the model has been explained with it, or need not be */
    EXPERIMENT_STATES
};

/* A line of the budget of the gap. */
struct journal_item {
    char name[160];
    double share, low, high; /* of the gap */
};

/* What was made of all logs so far. */
struct journal_finding {
    char verdict[16]; /* "": none was made */
    double given[MK_MAX_JOINTS], refit[MK_MAX_JOINTS], extended[MK_MAX_JOINTS],
        noise[MK_MAX_JOINTS]; /* rms of free runs on what was held back */
    double closed;
    int items;
    struct journal_item item[JOURNAL_ITEMS];
    char rest[160]; /* where the rest is and with what it goes; "" */
    int causes;
    char cause[JOURNAL_ITEMS][160]; /* with values and standard errors */
    char open[200];                 /* rivals that are not told apart; "" */
};

struct experiment {
    enum experiment_kind kind;
    enum experiment_state state;
    char input[PLAN_INPUT];
    double seconds;
    char why[JOURNAL_TEXT], expected[JOURNAL_TEXT], came[JOURNAL_TEXT];
    char planned_at[JOURNAL_DATE], run_at[JOURNAL_DATE];
    /* Once it was run: */
    double origin[MK_MAX_JOINTS]; /* its zero, counted from that of the first (struct rig) */
    double ran_s;                 /* of the log */
    bool broken_off;              /* before its end */
    bool used;                    /* learned from */
    bool left_out;                /* no longer: it contradicts the others */
    char fault[160];              /* "": none */
    double window_s;              /* of the free runs that the prediction is judged by */
    double error[MK_MAX_JOINTS], noise[MK_MAX_JOINTS]; /* their rms; of a reading */
    double whole[MK_MAX_JOINTS]; /* rms of the prediction that was written down, from rest */
    bool passed;                 /* predicted to within twice the noise */
    struct journal_finding finding;
    double rig_s, compute_s; /* what it cost: pauses included; planning and learning */
};

/* A setup on the rig, believing a model. */
struct journal_control {
    char setup[32], nominal[16]; /* "given", "final" */
    char log[64];
    bool held;
    double caught_s, sway,
        effort; /* s, rad (of a speed that is tracked: rad/s), rms of the command */
    char fault[160];
};

struct journal_settings {
    char board[32], device[64];
    char rig[JOURNAL_PATH]; /* of the virtual board; "": the model itself */
    bool fast, stream;
    double seconds, rate_hz;
    uint64_t seed;
    struct plan_limits limits; /* the operator's; NAN: the rig's own */
    double model_off;
    int tries;
};

struct journal {
    char folder[JOURNAL_PATH];
    int lock; /* of the folder; -1: not open */
    char program[64], begun_at[JOURNAL_DATE];
    char model_path[JOURNAL_PATH]; /* as it was given; a copy is DIR/given.ini */
    struct mk_model given;
    struct journal_settings settings;
    char looked_at[JOURNAL_DATE]; /* at the rig; "": not yet */
    char looked[200];
    double look_s;
    int count;
    struct experiment experiment[JOURNAL_EXPERIMENTS];
    char stopped[24], stopped_why[JOURNAL_TEXT]; /* "": it goes on */
    char final_model[64];                        /* file in the folder; "" */
    int controls;
    struct journal_control control[JOURNAL_CONTROLS];
    double control_s;
};

/* A file of the folder. Returns buf, "" where it does not fit. */
const char *journal_file(const struct journal *j, char buf[JOURNAL_PATH], const char *name);
/* "exp-03.csv" and the like: `number` from 0. */
const char *journal_name(char buf[64], int number, const char *end);

/* Adds to a text, as far as there is room. */
void journal_put(char text[JOURNAL_TEXT], const char *format, ...) MK_PRINTF(2, 3);

/* Opens the folder, made if it is missing, and takes its lock: MK_ERR_BUSY where another process
 * has it. *found: there is a journal in it, which was read. MK_ERR_PARSE: a file of that name is
 * none. */
MK_NODISCARD enum mk_status journal_open(struct journal *j, const char *folder, bool make,
                                         bool *found, struct mk_error *err);
MK_NODISCARD enum mk_status journal_save(const struct journal *j, struct mk_error *err);
void journal_close(struct journal *j);

/* NULL where the journal is that of an investigation of this model with these settings, else what
 * is another. Counts a turn are left out, for the board's are believed, and the device, for what
 * was unplugged may come back under another name. */
const char *journal_another(const struct journal *j, const struct mk_model *model,
                            const struct journal_settings *s);

#endif
