#include "console/script/host.h"

#include <errno.h>
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "console/script/cmd.h"
#include "console/script/cmdfile.h"

#define QUEUE 32
#define LINE 1024
#define EVENTS 256
#define TAP_SAMPLES 16384
#define PERIOD_NS 20000000L /* looks at the run and at the encoders so often */
#define STILL_LOOKS 25      /* half a second of them */
#define STILL_RAD 0.008     /* as the check before a start */
#define FAST_S 0.2          /* of simulated time a period: ten times the clock */
#define TAIL_S 1.0          /* a run that has a fault ends within */

struct host {
    struct session session; /* the thread's */
    pthread_t thread;
    struct mk_ring *tap;
    volatile int cancel; /* enum session_cancel */

    pthread_mutex_t lock; /* of all below */
    pthread_cond_t wake;
    char queue[QUEUE][LINE];
    int first, count;
    bool ending, executing;
    struct host_status status;
    struct host_event event[EVENTS];
    uint64_t events;
    struct host_show show;

    /* The thread's: */
    int looks;
    double low[MK_MAX_JOINTS], high[MK_MAX_JOINTS]; /* of the angles, since they stand still */
    bool was_running;
    const struct mk_ctrl *designed_for;
    double designed[MK_CTRL_MAX_PARAMS];
};

/* --- events ---------------------------------------------------------------------------------- */

static void add_event(struct host *h, enum host_event_kind kind, const char *text)
{
    pthread_mutex_lock(&h->lock);
    struct host_event *e = &h->event[h->events++ % EVENTS];
    e->when = time(NULL);
    e->kind = kind;
    snprintf(e->text, sizeof e->text, "%s", text);
    pthread_mutex_unlock(&h->lock);
}

void host_note(struct host *h, enum host_event_kind kind, const char *fmt, ...)
{
    char text[HOST_TEXT];
    va_list args;
    va_start(args, fmt);
    vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    add_event(h, kind, text);
}

bool host_get_event(struct host *h, uint64_t index, struct host_event *out)
{
    pthread_mutex_lock(&h->lock);
    bool there = index < h->events;
    if (there && h->events - index <= EVENTS)
        *out = h->event[index % EVENTS];
    else
        memset(out, 0, sizeof *out);
    pthread_mutex_unlock(&h->lock);
    return there;
}

static void on_say(void *user, const char *line)
{
    add_event(user, HOST_SAYS, line);
}

static void report_error(struct host *h, const struct mk_error *err)
{
    char text[HOST_TEXT];
    mk_error_format(err, text, sizeof text);
    add_event(h, HOST_ERROR, text);
}

static void on_file_error(void *user, const struct mk_error *err)
{
    report_error(user, err);
}

/* --- what the screen sees -------------------------------------------------------------------- */

static double free_megabytes(const struct session *s)
{
    struct statvfs v;
    const char *folder = s->options.out ? s->options.out : ".";
    if (access(folder, W_OK) != 0 || statvfs(folder, &v) != 0)
        return -1.0;
    return (double)v.f_bavail * (double)v.f_frsize / 1e6;
}

static void publish(struct host *h)
{
    struct session *s = &h->session;
    struct mk_loop_snapshot snap;
    struct mk_loop_stats stats;
    if (s->loop) {
        mk_loop_get_snapshot(s->loop, &snap);
        mk_loop_get_stats(s->loop, &stats);
    }
    if (s->ctrl && s->ctrl != h->designed_for)
        memcpy(h->designed, s->value, sizeof h->designed);
    h->designed_for = s->ctrl;
    pthread_mutex_lock(&h->lock);
    struct host_status *st = &h->status;
    st->backend = s->backend;
    st->fast = s->options.fast;
    st->setup = s->ctrl ? s->setup : NULL;
    st->model = s->model;
    if (s->ctrl)
        st->nominal = s->ctrl->model;
    memcpy(st->value, s->value, sizeof st->value);
    memcpy(st->initial, h->designed, sizeof st->initial);
    st->config = s->config;
    st->have_loop = s->loop != NULL;
    st->running = s->running;
    if (s->loop) {
        st->snap = snap;
        st->stats = stats;
    }
    snprintf(st->log_path, sizeof st->log_path, "%s", s->log_path);
    st->saved = s->saved;
    snprintf(st->record_path, sizeof st->record_path, "%s", s->record_path);
    pthread_mutex_unlock(&h->lock);
}

static void on_tick(void *user)
{
    publish(user);
}

static bool on_progress(void *user, double done, const char *what)
{
    struct host *h = user;
    pthread_mutex_lock(&h->lock);
    h->status.progress = done;
    snprintf(h->status.progress_what, sizeof h->status.progress_what, "%s", what);
    pthread_mutex_unlock(&h->lock);
    return session_cancelled(&h->session) == SESSION_GO;
}

static void free_show(struct host_show *show)
{
    mk_log_free(show->log);
    mk_log_free(show->model);
    *show = (struct host_show){NULL, NULL, false};
}

static void on_show(void *user, struct mk_log *log, struct mk_log *model, bool play)
{
    struct host *h = user;
    pthread_mutex_lock(&h->lock);
    free_show(&h->show);
    h->show = (struct host_show){log, model, play};
    pthread_mutex_unlock(&h->lock);
}

bool host_take_show(struct host *h, struct host_show *out)
{
    pthread_mutex_lock(&h->lock);
    *out = h->show;
    h->show = (struct host_show){NULL, NULL, false};
    pthread_mutex_unlock(&h->lock);
    return out->log != NULL;
}

/* --- the run, seen from outside -------------------------------------------------------------- */

static void execute(struct host *h, const char *text, bool echo);

/* Are the links still? From looks in a row. */
static void look(struct host *h)
{
    double q[MK_MAX_JOINTS] = {0};
    bool zeroed = false, ok = session_look(&h->session, q, &zeroed) == MK_OK;
    bool moved = !ok;
    const struct mk_model *model = &h->session.model;
    for (int j = 0; ok && j < mk_model_joints(model); j++) {
        h->low[j] = h->looks ? fmin(h->low[j], q[j]) : q[j];
        h->high[j] = h->looks ? fmax(h->high[j], q[j]) : q[j];
        double least = STILL_RAD * mk_model_joint_scale(model, j);
        bool wheel = mk_plant(model->plant)->joint_is_wheel[j];
        moved = moved || (!wheel && h->high[j] - h->low[j] > least);
    }
    h->looks = moved ? 0 : h->looks + 1;
    pthread_mutex_lock(&h->lock);
    h->status.looked = ok;
    h->status.zeroed = zeroed;
    h->status.still = h->looks > STILL_LOOKS;
    memcpy(h->status.q, q, sizeof q);
    pthread_mutex_unlock(&h->lock);
}

/* A fault has ended the run: its tail is logged, then it is over. */
static void end_faulted_run(struct host *h)
{
    struct session *s = &h->session;
    struct mk_error err = MK_ERROR_INIT;
    if (session_wait(s, TAIL_S, NULL, NULL, &err) == MK_ERR_FAULT)
        report_error(h, &err);
    execute(h, "halt", false);
}

/* Nobody's clock drives a simulated run but this one. A fault shows in the snapshot. */
static void fast_forward(struct session *s)
{
    enum mk_status st = mk_loop_wait(s->loop, FAST_S, NULL, NULL, NULL, NULL);
    (void)st;
}

static void watch(struct host *h)
{
    struct session *s = &h->session;
    struct mk_loop_snapshot snap;
    if (s->running && s->options.fast)
        fast_forward(s);
    if (s->running) {
        mk_loop_get_snapshot(s->loop, &snap);
        if (snap.fault)
            end_faulted_run(h);
    } else if (s->board) {
        look(h);
    }
}

/* The run that has ended; a fault that a full disk kept out of its log is known from the loop. */
static bool sum_up(struct host *h, struct run_summary *out)
{
    struct session *s = &h->session;
    struct mk_error err = MK_ERROR_INIT;
    struct mk_loop_snapshot snap = {0};
    if (!s->log_path[0])
        return false;
    if (summarise(s->log_path, out, &err) != MK_OK) {
        report_error(h, &err);
        return false;
    }
    if (s->loop)
        mk_loop_get_snapshot(s->loop, &snap);
    if (snap.fault && !out->fault[0]) {
        snprintf(out->fault, sizeof out->fault, "%s at %.4f s", mk_fault_name(snap.fault),
                 snap.fault_t);
        out->balanced_at_end = false;
    }
    return true;
}

static void after_command(struct host *h)
{
    struct session *s = &h->session;
    struct run_summary summary;
    bool ended = h->was_running && !s->running;
    bool have = ended && sum_up(h, &summary);
    double disk = free_megabytes(s);
    h->was_running = s->running;
    h->looks = 0;
    pthread_mutex_lock(&h->lock);
    h->status.disk_free_mb = disk;
    if (s->running || ended || !s->ctrl)
        h->status.have_summary = have;
    if (have)
        h->status.summary = summary;
    if (!s->ctrl || s->running)
        h->status.looked = false;
    pthread_mutex_unlock(&h->lock);
}

/* --- commands -------------------------------------------------------------------------------- */

static const char *after_source(const char *text)
{
    text += strspn(text, " \t");
    if (strncmp(text, "source", 6) != 0 || !strchr(" \t", text[6]) || !text[6])
        return NULL;
    return text + 6 + strspn(text + 6, " \t");
}

static int execute_file(struct host *h, const char *path, struct mk_error *err)
{
    const struct session *s = &h->session;
    const struct cmd_known known = {
        .keep_model = s->options.keep_model && s->options.model,
        .have_setup = s->ctrl != NULL,
        .have_model = s->have_model,
        .have_nominal = s->have_nominal,
        .running = s->running,
        .run_s = session_run_time(s),
        .setup = s->setup,
        .model = s->have_model ? mk_plant(s->model.plant) : NULL,
        .nominal = s->have_nominal ? mk_plant(s->nominal.plant) : NULL,
    };
    struct cmdfile *file;
    /* Each error is reported with its line, so nothing is left to say. */
    if (cmdfile_source(path, &known, on_file_error, h, &file, NULL) != MK_OK)
        return MK_OK;
    int st = (int)cmdfile_execute(file, &h->session, err);
    cmdfile_free(file);
    h->session.script_dir[0] = '\0';
    return st;
}

static int execute_text(struct host *h, const char *text, struct mk_error *err)
{
    char line[LINE];
    struct cmd_line parsed;
    snprintf(line, sizeof line, "%s", text);
    const char *path = after_source(line);
    if (path && *path)
        return execute_file(h, path, err);
    int st = (int)cmd_parse(line, NULL, &parsed, err);
    return st == MK_OK ? cmd_execute(&h->session, &parsed, err) : st;
}

static void execute(struct host *h, const char *text, bool echo)
{
    struct mk_error err = MK_ERROR_INIT;
    if (echo)
        add_event(h, HOST_COMMAND, text);
    int st = execute_text(h, text, &err);
    if (st < 0)
        report_error(h, &err);
    after_command(h);
    pthread_mutex_lock(&h->lock);
    h->status.commands++;
    h->status.progress = -1.0;
    h->status.quit = h->status.quit || st == CMD_QUIT;
    pthread_mutex_unlock(&h->lock);
}

/* Waits for a command, a period at most. False: the end. */
static bool next_command(struct host *h, char *line)
{
    struct timespec until;
    clock_gettime(CLOCK_MONOTONIC, &until);
    until.tv_nsec += PERIOD_NS;
    if (until.tv_nsec >= 1000000000L) {
        until.tv_nsec -= 1000000000L;
        until.tv_sec++;
    }
    line[0] = '\0';
    pthread_mutex_lock(&h->lock);
    h->executing = false;
    h->status.doing[0] = '\0';
    while (h->count == 0 && !h->ending &&
           pthread_cond_timedwait(&h->wake, &h->lock, &until) != ETIMEDOUT)
        ;
    bool more = !h->ending || h->count > 0;
    if (h->count > 0) {
        snprintf(line, LINE, "%s", h->queue[h->first]);
        h->first = (h->first + 1) % QUEUE;
        h->count--;
        h->executing = true;
        snprintf(h->status.doing, sizeof h->status.doing, "%.79s", line);
    }
    /* What was pressed before this command was asked for does not concern it. */
    __atomic_store_n(&h->cancel, SESSION_GO, __ATOMIC_RELEASE);
    pthread_mutex_unlock(&h->lock);
    return more;
}

static void *host_thread(void *user)
{
    struct host *h = user;
    char line[LINE];
    while (next_command(h, line)) {
        if (line[0])
            execute(h, line, true);
        else
            watch(h);
        publish(h);
    }
    execute(h, "halt", false);
    publish(h);
    return NULL;
}

bool host_post(struct host *h, const char *line)
{
    pthread_mutex_lock(&h->lock);
    bool room = h->count < QUEUE && strlen(line) < LINE;
    if (room) {
        snprintf(h->queue[(h->first + h->count) % QUEUE], LINE, "%s", line);
        h->count++;
        pthread_cond_signal(&h->wake);
    }
    pthread_mutex_unlock(&h->lock);
    return room;
}

static void drop_and(struct host *h, enum session_cancel cancel)
{
    pthread_mutex_lock(&h->lock);
    h->count = 0;
    __atomic_store_n(&h->cancel, cancel, __ATOMIC_RELEASE);
    pthread_mutex_unlock(&h->lock);
}

void host_cancel(struct host *h)
{
    drop_and(h, SESSION_CANCEL);
}

void host_halt(struct host *h)
{
    host_cancel(h);
    (void)host_post(h, "halt");
}

void host_estop(struct host *h)
{
    drop_and(h, SESSION_ESTOP);
    session_estop(&h->session);
}

/* The lock may be held by the thread that crashed; the loop is not about to change then. */
void host_estop_in_crash(struct host *h)
{
    struct mk_loop *loop = h->session.loop;
    if (loop)
        mk_loop_estop(loop);
}

void host_get_status(struct host *h, struct host_status *out)
{
    pthread_mutex_lock(&h->lock);
    *out = h->status;
    pthread_mutex_unlock(&h->lock);
}

struct mk_ring *host_samples(struct host *h)
{
    return h->tap;
}

bool host_is_idle(struct host *h)
{
    pthread_mutex_lock(&h->lock);
    bool idle = h->count == 0 && !h->executing;
    pthread_mutex_unlock(&h->lock);
    return idle;
}

bool host_is_running(struct host *h)
{
    pthread_mutex_lock(&h->lock);
    bool running = h->status.running;
    pthread_mutex_unlock(&h->lock);
    return running;
}

/* --- its life -------------------------------------------------------------------------------- */

/* Signals are the guard's affair. */
static int create_thread(struct host *h)
{
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    int rc = pthread_create(&h->thread, NULL, host_thread, h);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return rc;
}

static void release(struct host *h)
{
    session_close(&h->session);
    mk_ring_destroy(h->tap);
    free_show(&h->show);
    pthread_cond_destroy(&h->wake);
    pthread_mutex_destroy(&h->lock);
    free(h);
}

enum mk_status host_create(const struct session_options *options, struct host **out,
                           struct mk_error *err)
{
    struct host *h = calloc(1, sizeof *h);
    *out = NULL;
    if (!h)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for the session");
    pthread_condattr_t attr;
    pthread_condattr_init(&attr);
    pthread_condattr_setclock(&attr, CLOCK_MONOTONIC);
    pthread_cond_init(&h->wake, &attr);
    pthread_condattr_destroy(&attr);
    pthread_mutex_init(&h->lock, NULL);
    h->status.progress = h->status.disk_free_mb = -1.0;

    struct session_options o = *options;
    o.say = on_say;
    o.tick = on_tick;
    o.progress = on_progress;
    o.show = on_show;
    o.user = h;
    o.cancel = &h->cancel;
    enum mk_status st = mk_ring_create(TAP_SAMPLES, sizeof(struct mk_sample), &h->tap);
    o.tap = h->tap;
    if (st == MK_OK)
        st = session_open(&h->session, &o, err);
    publish(h);
    if (st == MK_OK && create_thread(h) != 0)
        st = mk_error_set(err, MK_ERR_NOMEM, "cannot create the session's thread");
    if (st != MK_OK) {
        release(h);
        return st;
    }
    *out = h;
    return MK_OK;
}

void host_finish(struct host *h)
{
    if (!h)
        return;
    pthread_mutex_lock(&h->lock);
    bool first = !h->ending;
    if (first) {
        h->count = 0;
        h->ending = true;
        __atomic_store_n(&h->cancel, SESSION_CANCEL, __ATOMIC_RELEASE);
        pthread_cond_signal(&h->wake);
    }
    pthread_mutex_unlock(&h->lock);
    if (first)
        pthread_join(h->thread, NULL);
}

void host_destroy(struct host *h)
{
    if (!h)
        return;
    host_finish(h);
    release(h);
}
