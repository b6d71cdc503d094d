#include "console/script/session.h"
#include "base/text.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/log_copy.h"
#include "base/out_file.h"
#include "base/temporary.h"
#include "console/script/log_origin.h"

#include "mechkit/number.h"
#include "mechkit/swingup.h"

#define TICK_S 0.05 /* how often options.tick is called during waits */
#define LOOK_S 1e-3 /* between two looks at a signal that is checked */
#define LOOKS 1e5   /* at most; of a longer time there are longer steps */

void session_say(struct session *s, const char *fmt, ...)
{
    char line[1024];
    va_list args;
    if (!s->options.say)
        return;
    va_start(args, fmt);
    vsnprintf(line, sizeof line, fmt, args);
    va_end(args);
    s->options.say(s->options.user, line);
}

/* --- opening ----------------------------------------------------------------------------- */

/* Logs are written there: better to learn now that it is a file, or belongs to others, than when
 * the rig hangs ready. */
static enum mk_status check_directory(const char *path, struct mk_error *err)
{
    struct stat st;
    if (stat(path, &st) == 0 && !S_ISDIR(st.st_mode))
        errno = ENOTDIR;
    else if (access(path, W_OK | X_OK) == 0)
        return MK_OK;
    return mk_error_errno(err, errno, path, "cannot write logs there");
}

static enum mk_status make_directory(const char *path, struct mk_error *err)
{
    char part[SESSION_PATH];
    if (strlen(path) >= sizeof part - 64)
        return mk_error_at(err, MK_ERR_INVALID, path, 0, 0, "the path is too long");
    strcpy(part, path);
    for (char *slash = part + 1;; slash++) {
        if (*slash != '/' && *slash != '\0')
            continue;
        char end = *slash;
        *slash = '\0';
        if (mkdir(part, 0777) != 0 && errno != EEXIST)
            return mk_error_errno(err, errno, path, "cannot make the directory");
        *slash = end;
        if (!end)
            return check_directory(path, err);
    }
}

static enum mk_status open_board_kind(struct session *s, struct mk_error *err)
{
    const char *name = s->options.board ? s->options.board : "virtual";
    s->backend = mk_board_backend_by_name(name);
    if (!s->backend)
        return mk_error_set(err, MK_ERR_USAGE,
                            "--board %s: there is no such board; `mechkit boards` lists them",
                            name);
    if (s->options.fast && !mk_board_may_be_fast(s->backend))
        return mk_error_set(err, MK_ERR_USAGE, "board %s runs in real time only: leave out --fast",
                            name);
    return MK_OK;
}

const char *session_beside(const char *folder, const char *path, char *buf, size_t size)
{
    if (path[0] != '/' && folder && folder[0]) {
        int n = snprintf(buf, size, "%s/%s", folder, path);
        if (n > 0 && (size_t)n < size && access(buf, F_OK) == 0)
            return buf;
    }
    snprintf(buf, size, "%s", path);
    return buf;
}

const char *session_find(const struct session *s, const char *path, char *buf, size_t size)
{
    return session_beside(s->script_dir, path, buf, size);
}

const char *session_signal(const char *folder, const char *text, char *buf, size_t size)
{
    const char *at = text + strspn(text, " \t");
    if (*at != '@')
        return text;
    buf[0] = '@';
    session_beside(folder, at + 1, buf + 1, size - 1);
    return buf;
}

enum mk_status session_load_model(struct session *s, const char *path, bool nominal,
                                  struct mk_error *err)
{
    struct mk_model model;
    enum mk_status st = mk_model_read(path, &model, err);
    if (st != MK_OK)
        return st;
    char *named = nominal ? s->nominal_path : s->model_path;
    snprintf(named, SESSION_PATH, "%s", path);
    if (nominal) {
        s->nominal = model;
        s->have_nominal = true;
    } else {
        s->model = model;
        s->have_model = true;
    }
    return MK_OK;
}

enum mk_status session_open(struct session *s, const struct session_options *options,
                            struct mk_error *err)
{
    memset(s, 0, sizeof *s);
    pthread_mutex_init(&s->loop_lock, NULL);
    s->options = *options;
    s->log_on = true;
    enum mk_status st = open_board_kind(s, err);
    if (st == MK_OK && options->model)
        st = session_load_model(s, options->model, false, err);
    if (st == MK_OK && options->believe)
        st = session_load_model(s, options->believe, true, err);
    if (st == MK_OK && options->out)
        st = make_directory(options->out, err);
    return st;
}

/* `loop` as others may see it, from now on. */
static void show_loop(struct session *s, struct mk_loop *loop)
{
    pthread_mutex_lock(&s->loop_lock);
    s->loop = loop;
    pthread_mutex_unlock(&s->loop_lock);
}

static void destroy_loop(struct session *s)
{
    struct mk_loop *loop = s->loop;
    show_loop(s, NULL);
    mk_loop_destroy(loop); /* halts */
}

int session_cancelled(const struct session *s)
{
    return s->options.cancel ? __atomic_load_n(s->options.cancel, __ATOMIC_ACQUIRE) : SESSION_GO;
}

void session_estop(struct session *s)
{
    pthread_mutex_lock(&s->loop_lock);
    if (s->loop)
        mk_loop_estop(s->loop);
    pthread_mutex_unlock(&s->loop_lock);
}

/* After a run. */
static void forget_old_signals(struct session *s)
{
    for (size_t i = 0; i < s->old_signals; i++)
        mk_signal_destroy(s->old_signal[i]);
    free(s->old_signal);
    s->old_signal = NULL;
    s->old_signals = 0;
}

static void close_setup(struct session *s)
{
    destroy_loop(s);
    forget_old_signals(s);
    mk_board_close(s->board); /* motor off */
    mk_ctrl_destroy(s->ctrl);
    s->board = NULL;
    s->ctrl = NULL;
    s->running = false;
}

void session_close(struct session *s)
{
    close_setup(s);
    mk_signal_destroy(s->signal);
    s->signal = NULL;
    if (s->record)
        fclose(s->record);
    s->record = NULL;
    pthread_mutex_destroy(&s->loop_lock);
}

/* --- setup ------------------------------------------------------------------------------- */

enum mk_status session_find_setup(const char *name, const struct mk_ctrl_ops **out,
                                  struct mk_error *err)
{
    char known[300] = "", text[80];
    struct mk_meant meant = {.word = name};
    const struct mk_ctrl_ops *row;
    *out = mk_ctrl_setup_by_name(name);
    if (*out)
        return MK_OK;
    for (int i = 0; (row = mk_ctrl_setup(i)) != NULL; i++) {
        size_t used = strlen(known);
        snprintf(known + used, sizeof known - used, "%s%s", i ? ", " : "", row->name);
        mk_meant_try(&meant, row->name);
    }
    return mk_error_set(err, MK_ERR_NOTFOUND, "there is no setup '%s'%s%s %s", name,
                        mk_meant_text(&meant, text, sizeof text),
                        meant.name ? " There are" : "; there are", known);
}

enum mk_status session_own_rig(const struct mk_ctrl_ops *ops, enum mk_plant_kind *out,
                               struct mk_error *err)
{
    int kind = -1, kinds = 0;
    for (int k = 0; k < MK_PLANT_COUNT; k++)
        if (ops->plants & (1u << k)) {
            kind = kinds ? kind : k;
            kinds++;
        }
    if (kinds != 1)
        return mk_error_set(err, MK_ERR_USAGE,
                            "setup %s runs on several rigs: say which one with --model or the "
                            "command model",
                            ops->name);
    *out = (enum mk_plant_kind)kind;
    return MK_OK;
}

static enum mk_status choose_model(struct session *s, const struct mk_ctrl_ops *ops,
                                   struct mk_error *err)
{
    enum mk_plant_kind kind;
    if (s->have_model)
        return MK_OK;
    enum mk_status st = session_own_rig(ops, &kind, err);
    if (st == MK_OK)
        mk_model_default(kind, &s->model);
    return st;
}

/* A model that is wrong about the encoders makes every speed and every prediction wrong. */
static enum mk_status check_encoders(const struct session *s, struct mk_error *err)
{
    struct mk_board_identity id;
    enum mk_status st = s->board->ops->identify(s->board, &id, err);
    for (int j = 0; j < mk_model_joints(&s->model) && st == MK_OK; j++) {
        const int board = id.encoder_cpr[j], model = s->model.encoder_cpr[j];
        if (board > 0 && model > 0 && board != model)
            st = mk_error_set(err, MK_ERR_INVALID,
                              "%s: encoder_cpr of joint %d is %d, but the board counts %d a turn: "
                              "correct it in the model, or choose the right model",
                              s->model_path[0] ? s->model_path : "the default model", j + 1, model,
                              board);
    }
    return st;
}

static enum mk_status open_board(struct session *s, struct mk_error *err)
{
    if (s->options.fast)
        mk_clock_init_simulated(&s->clock);
    else
        mk_clock_init_monotonic(&s->clock);
    struct mk_board_config config = {.model = &s->model,
                                     .clock = &s->clock,
                                     .seed = s->options.seed,
                                     .fault_script = s->faults[0] ? s->faults : NULL,
                                     .device = s->options.device};
    enum mk_status st = mk_board_open(s->backend, &config, &s->board, err);
    return st == MK_OK ? check_encoders(s, err) : st;
}

/* The signal is kept for the next setup that takes one. */
static const struct mk_signal *own_signal(const struct session *s)
{
    return s->setup->takes_signal ? s->signal : NULL;
}

enum mk_status session_setup(struct session *s, const char *name, struct mk_error *err)
{
    const struct mk_ctrl_ops *ops;
    enum mk_status st = session_find_setup(name, &ops, err);
    if (st != MK_OK)
        return st;
    st = s->running ? session_halt(s, err) : MK_OK;
    close_setup(s);
    s->setup = ops;
    if (st == MK_OK)
        st = choose_model(s, ops, err);
    if (st != MK_OK)
        return st;
    mk_loop_config_default(&s->model, &s->config);
    if (s->options.rate_hz > 0.0)
        s->config.rate_hz = s->options.rate_hz;
    s->config.tap = s->options.tap;
    s->config.stream = s->options.stream;
    s->config.cancel = s->options.cancel;
    mk_safety_default(&s->model, 1.0 / s->config.rate_hz, &s->config.limits);
    const struct mk_model *nominal = s->have_nominal ? &s->nominal : &s->model;
    st = mk_ctrl_create(ops, nominal, 1.0 / s->config.rate_hz, own_signal(s), &s->ctrl, err);
    if (st == MK_OK && s->swingup[0])
        st = mk_ctrl_load_swingup(s->ctrl, s->swingup, err);
    if (st == MK_OK)
        st = open_board(s, err);
    if (st == MK_OK)
        memcpy(s->value, s->ctrl->value, sizeof s->value);
    if (st != MK_OK)
        close_setup(s);
    return st;
}

/* --- running ----------------------------------------------------------------------------- */

static enum mk_status path_in_out(const struct session *s, const char *name,
                                  char path[SESSION_PATH], struct mk_error *err)
{
    const bool inside = s->options.out && name[0] != '/';
    int n = snprintf(path, SESSION_PATH, "%s%s%s", inside ? s->options.out : "", inside ? "/" : "",
                     name);
    if (n < SESSION_PATH)
        return MK_OK;
    return mk_error_set(err, MK_ERR_RANGE,
                        "the name of the log and its folder have %d characters, "
                        "at most %d",
                        n, SESSION_PATH - 1);
}

/* The next free run-NNN.csv, made empty so that no other program takes it for free as well. */
static enum mk_status name_log(struct session *s, struct mk_error *err)
{
    char name[64];
    int fd;
    do {
        snprintf(name, sizeof name, "run-%03d.csv", ++s->runs);
        enum mk_status st = path_in_out(s, name, s->log_path, err);
        if (st != MK_OK)
            return st;
        fd = open(s->log_path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    } while (fd < 0 && errno == EEXIST);
    if (fd < 0)
        return mk_error_errno(err, errno, s->log_path, "cannot write the log");
    close(fd);
    s->saved = false;
    return MK_OK;
}

/* No run was written to the name that was taken for it. */
static void give_log_back(struct session *s)
{
    struct stat info;
    if (s->log_path[0] && stat(s->log_path, &info) == 0 && info.st_size == 0)
        unlink(s->log_path);
    s->log_path[0] = '\0';
}

static enum mk_status create_loop(struct session *s, struct mk_error *err)
{
    struct mk_loop *loop;
    s->config.zeroed = s->loop && mk_loop_is_zeroed(s->loop);
    destroy_loop(s);
    enum mk_status st = mk_loop_create(s->board, s->ctrl, &s->config, &loop, err);
    if (st != MK_OK)
        return st;
    show_loop(s, loop);
    /* A stop that came while there was no loop to take it. */
    if (session_cancelled(s) == SESSION_ESTOP)
        mk_loop_estop(loop);
    return MK_OK;
}

enum mk_status session_start(struct session *s, struct mk_error *err)
{
    if (!s->ctrl)
        return mk_error_set(err, MK_ERR_STATE, "choose a setup first");
    if (s->running)
        return mk_error_set(err, MK_ERR_STATE, "it runs already: halt first");
    if (s->loop) {
        struct mk_loop_snapshot snap;
        mk_loop_get_snapshot(s->loop, &snap);
        if (snap.state == MK_LOOP_FAULTED)
            return mk_error_set(err, MK_ERR_FAULT, "fault %s is latched: acknowledge it with ack",
                                mk_fault_name(snap.fault));
    }
    s->ctrl->ref = own_signal(s);
    enum mk_status st = create_loop(s, err);
    if (st != MK_OK)
        return st;
    s->log_path[0] = '\0';
    if (s->log_on)
        st = name_log(s, err);
    if (st != MK_OK)
        return st;
    struct log_origin origin;
    log_origin_of(&origin, s);
    st = mk_loop_start(s->loop, s->log_on ? s->log_path : NULL, origin.row, origin.count, err);
    s->running = st == MK_OK;
    if (st != MK_OK)
        give_log_back(s);
    return st;
}

enum mk_status session_halt(struct session *s, struct mk_error *err)
{
    if (!s->loop)
        return MK_OK;
    s->running = false;
    enum mk_status st = mk_loop_halt(s->loop, err);
    forget_old_signals(s);
    return st;
}

enum mk_status session_wait(struct session *s, double seconds,
                            bool (*until)(const struct mk_loop_snapshot *, void *), void *user,
                            struct mk_error *err)
{
    struct mk_loop_snapshot snap;
    if (!s->options.tick)
        return mk_loop_wait(s->loop, seconds, until, user, s->options.cancel, err);
    mk_loop_get_snapshot(s->loop, &snap);
    double end_t = (snap.ticks ? snap.sample.t : 0.0) + seconds, left = seconds;
    for (;;) {
        double piece = fmin(left, TICK_S);
        enum mk_status st = mk_loop_wait(s->loop, piece, until, user, s->options.cancel, err);
        s->options.tick(s->options.user);
        mk_loop_get_snapshot(s->loop, &snap);
        left = end_t - (snap.ticks ? snap.sample.t : 0.0);
        bool over = left <= 1e-6;
        if (until ? st != MK_ERR_TIMEOUT || over : st != MK_OK || over)
            return st;
    }
}

enum mk_status session_look(struct session *s, double *q, bool *zeroed)
{
    struct mk_board_sample b;
    if (!s->board || s->running || s->options.fast)
        return MK_ERR_STATE;
    enum mk_status st = mk_board_exchange(s->board, 0.0, &b);
    for (int j = 0; st == MK_OK && j < mk_model_joints(&s->model); j++)
        q[j] = mk_plant(s->model.plant)->rest[j] + b.count[j] * mk_model_count(&s->model, j);
    *zeroed = s->loop && mk_loop_is_zeroed(s->loop);
    return st;
}

enum mk_status session_apply(struct session *s, struct mk_error *err)
{
    if (s->running)
        return mk_loop_set_params(s->loop, s->value, s->setup->param_count, err);
    memcpy(s->ctrl->value, s->value, sizeof s->value);
    if (s->setup->changed)
        s->setup->changed(s->ctrl);
    return MK_OK;
}

enum mk_status session_takes_signal(const struct mk_ctrl_ops *setup, struct mk_error *err)
{
    if (!setup || setup->takes_signal)
        return MK_OK;
    return mk_error_set(err, MK_ERR_USAGE,
                        "setup %s takes no signal: it holds its equilibrium; pi-speed follows a "
                        "reference, open-loop drives the motor with it",
                        setup->name);
}

/* The run goes on with another signal; the old one is kept until its end. */
static enum mk_status exchange_signal(struct session *s, const struct mk_signal *made,
                                      struct mk_error *err)
{
    struct mk_signal **more = realloc(s->old_signal, (s->old_signals + 1) * sizeof *s->old_signal);
    if (!more)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for the signal");
    s->old_signal = more;
    enum mk_status st = mk_loop_set_signal(s->loop, made, err);
    if (st == MK_OK)
        s->old_signal[s->old_signals++] = s->signal;
    return st;
}

enum mk_status session_check_signal(const struct mk_signal *signal, double from_s, double to_s,
                                    struct mk_error *err)
{
    const double looks = fmin(ceil((to_s - from_s) / LOOK_S), LOOKS);
    for (double i = 0.0; i <= looks; i++) {
        const double t = looks > 0.0 ? from_s + (to_s - from_s) * i / looks : from_s;
        if (!isfinite(mk_signal_at(signal, t)))
            return mk_error_set(err, MK_ERR_RANGE,
                                "%.200s is not a finite number at t = %.6g s: expected one at any "
                                "time of the run",
                                mk_signal_text(signal), t);
    }
    return MK_OK;
}

double session_run_time(const struct session *s)
{
    struct mk_loop_snapshot snap;
    if (!s->running)
        return 0.0;
    mk_loop_get_snapshot(s->loop, &snap);
    return snap.ticks ? snap.sample.t : 0.0;
}

enum mk_status session_set_signal(struct session *s, const char *text, struct mk_error *err)
{
    struct mk_signal *made;
    char found[SESSION_PATH + 1];
    enum mk_status st = session_takes_signal(s->setup, err);
    if (st != MK_OK)
        return st;
    st = mk_signal_create(session_signal(s->script_dir, text, found, sizeof found), &made, err);
    if (st == MK_OK)
        st = session_check_signal(made, session_run_time(s), session_run_time(s), err);
    if (st == MK_OK && s->running)
        st = exchange_signal(s, made, err);
    if (st != MK_OK) {
        mk_signal_destroy(made);
        return st;
    }
    if (s->ctrl && !s->running)
        s->ctrl->ref = made;
    if (!s->running)
        mk_signal_destroy(s->signal);
    s->signal = made;
    return MK_OK;
}

enum mk_status session_set_swingup(struct session *s, const char *path, struct mk_error *err)
{
    char found[SESSION_PATH] = "";
    struct mk_swingup *read = NULL;
    if (s->running)
        return mk_error_set(err, MK_ERR_STATE, "halt first");
    if (path)
        session_find(s, path, found, sizeof found);
    enum mk_status st = MK_OK;
    if (s->ctrl && (path || s->ctrl->track))
        st = mk_ctrl_load_swingup(s->ctrl, path ? found : NULL, err);
    else if (path)
        st = mk_swingup_read(found, &read, err); /* what is wrong with it is said now */
    mk_swingup_free(read);
    if (st == MK_OK)
        strcpy(s->swingup, found);
    return st;
}

/* --- saving ------------------------------------------------------------------------------ */

/* Where a name's ending begins: ".csv", ".csv.gz", or its end. */
static const char *ending(const char *path)
{
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path;
    const char *end = name + strlen(name), *dot = strrchr(name, '.');
    if (!dot || strcmp(dot, ".gz") != 0)
        return dot ? dot : end;
    for (const char *at = dot; at > name; at--)
        if (at[-1] == '.')
            return at - 1;
    return dot;
}

/* "dir/name.csv" with `n` (from 2 on) to "dir/name-2.csv". */
static void numbered(const char *path, int n, char *out, size_t size)
{
    const char *dot = ending(path);
    if (n < 2)
        snprintf(out, size, "%s", path);
    else
        snprintf(out, size, "%.*s-%d%s", (int)(dot - path), path, n, dot);
}

/* Another name for the same data; a copy where the file system has no links, or where `name`, which
 * `to` is going to have, says that the log is compressed, or no longer is. */
static int link_or_copy(const char *from, const char *to, const char *name)
{
    if (!mk_log_paths_agree(from, name))
        return mk_log_copy_new(from, to, name);
    if (link(from, to) == 0)
        return 0;
    return errno == EEXIST ? EEXIST : mk_copy_new(from, to);
}

/* Whether two names lead to one file, as "a.csv" and "./a.csv" do. */
static bool is_same_file(const char *one, const char *other)
{
    struct stat a, b;
    return stat(one, &a) == 0 && stat(other, &b) == 0 && a.st_dev == b.st_dev &&
           a.st_ino == b.st_ino;
}

/* Puts the log under a name that may exist: the old file stays until the new one is safe. EINVAL:
 * it is no file; ENOEXEC: it is no log, but a model or a command file, say. */
static int replace(const char *log, const char *path)
{
    struct stat old;
    if (lstat(path, &old) != 0)
        return errno == ENOENT ? link_or_copy(log, path, path) : errno;
    if (!S_ISREG(old.st_mode))
        return EINVAL;
    if (!mk_log_may_replace(path))
        return ENOEXEC;
    char beside[SESSION_PATH + 32];
    snprintf(beside, sizeof beside, "%s.%ld-0.tmp", path, (long)getpid());
    mk_temporary_clean(path);
    int why = link_or_copy(log, beside, path);
    if (!why && rename(beside, path) != 0)
        why = errno;
    if (why && why != EEXIST)
        unlink(beside);
    return why;
}

/* Saves under the first of name, name-2, name-3 ... that is free. A number at the name of a folder
 * or a device would make a file that nobody meant. */
static int link_under_free_name(const char *log, const char *path, char *saved, size_t size)
{
    int why = EEXIST;
    struct stat old;
    if (stat(path, &old) == 0 && !S_ISREG(old.st_mode))
        return EINVAL;
    for (int n = 1; why == EEXIST && n < 10000; n++) {
        numbered(path, n, saved, size);
        why = link_or_copy(log, saved, path);
    }
    return why;
}

static enum mk_status cannot_save(const char *path, int why, struct mk_error *err)
{
    const char *what = why == EINVAL ? "this is no regular file" : "this file is no log";
    if (why != EINVAL && why != ENOEXEC)
        return mk_error_errno(err, why, path, "cannot save the log");
    return mk_error_at(err, MK_ERR_INVALID, path, 0, 0,
                       "%s and is not replaced: choose another name", what);
}

/* Whether the next run may read this file: its trajectory, or the samples of its signal. */
static bool is_read(const struct session *s, const char *path)
{
    const char *signal = s->signal ? mk_signal_text(s->signal) : "";
    signal += strspn(signal, " \t");
    return is_same_file(s->swingup, path) || (*signal == '@' && is_same_file(signal + 1, path));
}

enum mk_status session_save(struct session *s, const char *name, bool overwrite, char *saved,
                            size_t size, struct mk_error *err)
{
    if (s->running)
        return mk_error_set(err, MK_ERR_STATE, "the log grows still: halt first");
    if (!s->log_path[0])
        return mk_error_set(err, MK_ERR_STATE, "there is no run to save");
    if (strcmp(name, "-") == 0)
        return mk_error_set(err, MK_ERR_INVALID, "a log is saved to a file: '-' is no name of one");
    char path[SESSION_PATH];
    enum mk_status st = path_in_out(s, name, path, err);
    if (st != MK_OK)
        return st;
    if (overwrite && is_read(s, path))
        return mk_error_at(err, MK_ERR_INVALID, path, 0, 0,
                           "the setup reads this file: save the log under another name");
    const bool there = overwrite && is_same_file(s->log_path, path);
    numbered(path, 1, saved, size);
    int why = there       ? 0
              : overwrite ? replace(s->log_path, path)
                          : link_under_free_name(s->log_path, path, saved, size);
    if (why)
        return cannot_save(path, why, err);
    /* The first name replaces run-NNN.csv; later ones are added. */
    if (!s->saved && !there)
        unlink(s->log_path);
    snprintf(s->log_path, sizeof s->log_path, "%s", saved);
    s->saved = true;
    return MK_OK;
}
