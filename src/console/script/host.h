/* The session of a screen in a thread of its own: the screen hands in command lines and looks at a
 * copy of the state, so that neither a command that waits nor a terminal that stands still holds
 * the other up. What must not wait in the queue - halt and e-stop - goes past it. */
#ifndef MECHKIT_CONSOLE_SCRIPT_HOST_H
#define MECHKIT_CONSOLE_SCRIPT_HOST_H

#include <time.h>

#include "console/commands/summary.h"
#include "console/script/session.h"
#include "mechkit/ring.h"

struct host;

#define HOST_TEXT 240

enum host_event_kind { HOST_SAYS, HOST_COMMAND, HOST_ERROR, HOST_WARNING };
struct host_event {
    time_t when;
    enum host_event_kind kind;
    char text[HOST_TEXT];
};

/* Everything a screen shows of a session, whole. */
struct host_status {
    const struct mk_board_ops *backend;
    const struct mk_ctrl_ops *setup; /* NULL: none chosen */
    bool fast;
    struct mk_model model, nominal; /* valid with a setup */
    double value[MK_CTRL_MAX_PARAMS];
    double initial[MK_CTRL_MAX_PARAMS]; /* designed or given, as after `setup` */
    struct mk_loop_config config;
    bool have_loop, running;
    struct mk_loop_snapshot snap; /* with have_loop */
    struct mk_loop_stats stats;
    bool looked;             /* encoders read while nothing runs: */
    bool zeroed;             /* their zero is a rest that a start has found */
    bool still;              /* for half a second */
    double q[MK_MAX_JOINTS]; /* angles */
    char log_path[SESSION_PATH];
    bool saved;
    bool have_summary; /* of log_path */
    struct run_summary summary;
    char record_path[SESSION_PATH]; /* commands are written down there; "": nowhere */
    char doing[80];                 /* command under way; "": none */
    double progress;                /* 0..1 of a calculation; < 0: none */
    char progress_what[40];
    double disk_free_mb; /* where logs go; < 0: none can be written */
    uint64_t commands;   /* executed so far */
    bool quit;           /* `quit` was executed */
};

/* Logs to show, handed over to whoever takes them. */
struct host_show {
    struct mk_log *log, *model;
    bool play;
};

/* Opens the session (board and models are checked) and starts the thread. `options`' callbacks and
 * cancel are the host's. */
MK_NODISCARD enum mk_status host_create(const struct session_options *options, struct host **out,
                                        struct mk_error *err);
/* Motor off, log complete, thread ended; what is left answers questions. NULL allowed. */
void host_finish(struct host *h);
void host_destroy(struct host *h); /* finishes first */

/* Queues a command line. False: too many wait. */
bool host_post(struct host *h, const char *line);
/* Drops what waits, ends a wait or a calculation; host_halt then halts. */
void host_cancel(struct host *h);
void host_halt(struct host *h);
/* Motor off at once. Any thread, at any time. */
void host_estop(struct host *h);
/* The same from a signal handler of a crash. */
void host_estop_in_crash(struct host *h);
/* An event of the screen's own. */
void host_note(struct host *h, enum host_event_kind kind, const char *fmt, ...) MK_PRINTF(3, 4);

void host_get_status(struct host *h, struct host_status *out);
/* Event number `index` (0 is the first ever). False: there is none yet; too old ones read as empty.
 */
bool host_get_event(struct host *h, uint64_t index, struct host_event *out);
/* Takes over what a command wants shown; false: nothing. */
bool host_take_show(struct host *h, struct host_show *out);
/* Samples (struct mk_sample) as they are made; one reader. */
struct mk_ring *host_samples(struct host *h);
/* True when nothing waits and nothing is being executed. */
bool host_is_idle(struct host *h);
/* Whether the motor may be driven now: for the guard, never waits for the session. */
bool host_is_running(struct host *h);

#endif
