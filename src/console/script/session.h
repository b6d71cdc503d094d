/* A session: one board, one setup, one loop, and what connects them. Command files and the screen
 * drive it through the table of commands (cmd.h). One thread, but for session_estop. */
#ifndef MECHKIT_CONSOLE_SCRIPT_SESSION_H
#define MECHKIT_CONSOLE_SCRIPT_SESSION_H

#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "mechkit/board.h"
#include "mechkit/ctrl.h"
#include "mechkit/log.h"
#include "mechkit/loop.h"
#include "mechkit/signal.h"

#define SESSION_PATH 512

enum session_cancel {
    SESSION_GO,
    SESSION_CANCEL, /* waits and calculations end */
    SESSION_ESTOP   /* besides, a start that is under way ends in an e-stop */
};

struct session_options {
    const char *board;   /* name of the back end; NULL: virtual */
    const char *device;  /* NULL: the first */
    const char *model;   /* file; NULL: the setup's rig with default parameters */
    bool keep_model;     /* `model` stays, whatever the command `model` says */
    const char *believe; /* file; NULL: the model */
    const char *out;     /* directory for logs; NULL: the current one */
    bool fast;
    bool stream;    /* the board's clock makes the samples */
    double rate_hz; /* 0: default */
    uint64_t seed;
    volatile int *cancel; /* enum session_cancel, set from outside; may be NULL */
    /* What commands have to say (a line without newline). */
    void (*say)(void *user, const char *line);
    void *user;
    void (*tick)(void *user); /* called now and then during waits; may be NULL */
    struct mk_ring *tap;      /* gets every sample (struct mk_sample) while it runs; NULL: none */
    /* How far a long calculation is; false ends it. NULL: nobody asks. */
    bool (*progress)(void *user, double done, const char *what);
    /* A screen that shows logs; NULL: there is none. Takes both over; `model` (a prediction of the
     * same rows) may be NULL. `play`: from its start, at its own pace. */
    void (*show)(void *user, struct mk_log *log, struct mk_log *model, bool play);
};

struct session {
    struct session_options options;
    const struct mk_board_ops *backend;
    struct mk_clock clock;
    struct mk_model model, nominal;
    bool have_model, have_nominal;
    char script_dir[SESSION_PATH]; /* of the command file that runs; "": none */
    char faults[SESSION_PATH];     /* fault script of the virtual board; "": none */
    char swingup[SESSION_PATH];    /* trajectory that setups follow; "": they swing up by energy */
    const struct mk_ctrl_ops *setup;
    struct mk_signal *signal; /* reference or open-loop command */
    /* Signals that this run has had before: the loop's log still names them. */
    struct mk_signal **old_signal;
    size_t old_signals;
    struct mk_loop_config config;
    bool log_on;
    /* Only between `setup` and the next one: */
    struct mk_board *board;
    struct mk_ctrl *ctrl;
    struct mk_loop *loop;
    double value[MK_CTRL_MAX_PARAMS];
    int runs;
    bool running;
    char model_path[SESSION_PATH], nominal_path[SESSION_PATH]; /* "": none was read */
    char log_path[SESSION_PATH];                               /* of the newest run; "": none */
    bool saved; /* log_path has been given a name by `save` */
    char record_path[SESSION_PATH];
    FILE *record;              /* commands are written down here; NULL: nowhere */
    double record_t;           /* of the run, when the last one was */
    pthread_mutex_t loop_lock; /* held while `loop` changes, and by session_estop */
};

/* Checks the options and reads the models. The session must be closed even when this fails. */
MK_NODISCARD enum mk_status session_open(struct session *s, const struct session_options *options,
                                         struct mk_error *err);
/* Motor off, log complete, everything released. */
void session_close(struct session *s);

/* Chooses a setup: opens the board, builds controller and loop. */
MK_NODISCARD enum mk_status session_setup(struct session *s, const char *name,
                                          struct mk_error *err);
MK_NODISCARD enum mk_status session_start(struct session *s, struct mk_error *err);
MK_NODISCARD enum mk_status session_halt(struct session *s, struct mk_error *err);
/* mk_loop_wait, with options.tick and options.cancel. */
MK_NODISCARD enum mk_status session_wait(struct session *s, double seconds,
                                         bool (*until)(const struct mk_loop_snapshot *, void *),
                                         void *user, struct mk_error *err);
int session_cancelled(const struct session *s); /* enum session_cancel */
/* Motor off at once, fault e-stop. From any thread, between session_open and session_close. A
 * `start` that is under way is stopped if *options.cancel was set to SESSION_ESTOP before. */
void session_estop(struct session *s);
/* Reads the encoders while nothing runs (the command is 0): angles from rest in `q`. `zeroed`: from
 * a rest that a start has found; else from where the board was switched on. MK_ERR_STATE while it
 * runs, before the first setup, or on a simulated clock. */
MK_NODISCARD enum mk_status session_look(struct session *s, double *q, bool *zeroed);
/* Takes over value[] into the controller, now or in flight. */
MK_NODISCARD enum mk_status session_apply(struct session *s, struct mk_error *err);
/* Gives the newest log a name: a name that exists gets -2, -3, ... unless `overwrite`. */
MK_NODISCARD enum mk_status session_save(struct session *s, const char *name, bool overwrite,
                                         char *saved, size_t size, struct mk_error *err);
/* Of the run that goes on, s; 0 where none does. */
double session_run_time(const struct session *s);
/* Whether a signal is a finite number from one time to another, s, as far as a look every
 * millisecond tells; MK_ERR_RANGE names the first time at which it is not. */
MK_NODISCARD enum mk_status session_check_signal(const struct mk_signal *signal, double from_s,
                                                 double to_s, struct mk_error *err);
/* Between runs or in flight: between two samples then. MK_ERR_RANGE: it is no number there. */
MK_NODISCARD enum mk_status session_set_signal(struct session *s, const char *text,
                                               struct mk_error *err);
/* The trajectory that setups follow from now on, also the one that is chosen; NULL: none. Errors as
 * mk_ctrl_load_swingup; MK_ERR_STATE while it runs. */
MK_NODISCARD enum mk_status session_set_swingup(struct session *s, const char *path,
                                                struct mk_error *err);
/* A file that a command names: beside the command file if it is there, else as given. Returns buf.
 */
const char *session_find(const struct session *s, const char *path, char *buf, size_t size);
/* The same beside any folder; NULL or "": none. */
const char *session_beside(const char *folder, const char *path, char *buf, size_t size);
/* Whether a setup (NULL: not known yet) goes by a signal; MK_ERR_USAGE says what it holds instead.
 */
MK_NODISCARD enum mk_status session_takes_signal(const struct mk_ctrl_ops *setup,
                                                 struct mk_error *err);
/* The text of a signal, its file (@FILE) looked for in this way: `text` or buf. */
const char *session_signal(const char *folder, const char *text, char *buf, size_t size);
/* MK_ERR_NOTFOUND (and *out NULL) says which setups there are. */
MK_NODISCARD enum mk_status session_find_setup(const char *name, const struct mk_ctrl_ops **out,
                                               struct mk_error *err);
/* The rig of a setup where no model says which; MK_ERR_USAGE: it runs on several. */
MK_NODISCARD enum mk_status session_own_rig(const struct mk_ctrl_ops *ops, enum mk_plant_kind *out,
                                            struct mk_error *err);
MK_NODISCARD enum mk_status session_load_model(struct session *s, const char *path, bool nominal,
                                               struct mk_error *err);

void session_say(struct session *s, const char *fmt, ...) MK_PRINTF(2, 3);

#endif
