#include "episode.h"

#include <errno.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "console/script/cmd.h"
#include "console/script/cmdfile.h"
#include "mechkit/log.h"

#define KILLED_AFTER_MS 400

const char *const episode_name[EPISODE_KINDS] = {"simulated", "full disk", "killed", "clock steps",
                                                 "garbage"};

struct play {
    struct session session;
    struct mk_random random;
    struct script script;
    const char *folder;
    struct tally *tally;
    struct violation *violation;
    bool full_disk, clock;
};

/* --- logs ----------------------------------------------------------------------------------- */

/* `ended_well`: the run was halted and nobody complained. Else the log may end anywhere, but what
 * is there must be whole. */
static void check_rows(const char *path, const struct mk_log *log, bool ended_well,
                       const struct mk_loop_snapshot *snap, struct violation *v)
{
    const double *u = mk_log_get(log, "u"), *flags = mk_log_get(log, "flags"),
                 *tick = mk_log_get(log, "tick");
    bool faulted = false;
    if (!u || !flags || !tick) {
        violate(v, "%s: columns are missing", path);
        return;
    }
    for (size_t k = 0; k < log->rows; k++) {
        faulted = faulted || ((int)flags[k] & MK_FLAG_FAULT);
        if (faulted && u[k] != 0.0)
            violate(v, "%s: row %zu has a command after the fault", path, k);
        if (k > 0 && tick[k] != tick[k - 1] + 1.0 && !((int)flags[k] & MK_FLAG_OVERRUN))
            violate(v, "%s: row %zu: samples are missing and no overrun is marked", path, k);
    }
    if (ended_well && (log->truncated || log->rows != snap->ticks))
        violate(v, "%s: %zu rows of a run of %llu samples", path, log->rows,
                (unsigned long long)snap->ticks);
}

static void check_log(const char *path, bool ended_well, const struct mk_loop_snapshot *snap,
                      struct tally *tally, struct violation *v)
{
    struct mk_log *log = NULL;
    struct mk_error err = MK_ERROR_INIT;
    struct stat info;
    if (ended_well && snap->ticks == 0)
        return; /* halted before its first sample: a log without rows */
    enum mk_status st = mk_log_read(path, &log, &err);
    if (st == MK_OK) {
        check_rows(path, log, ended_well, snap, v);
        tally->rows += (long)log->rows;
    } else if (ended_well || (st != MK_ERR_PARSE && stat(path, &info) == 0)) {
        violate(v, "%s: cannot be read: %s", path, err.message);
    }
    mk_log_free(log);
}

/* --- commands ------------------------------------------------------------------------------- */

static void limit_files(rlim_t bytes)
{
    struct rlimit r;
    getrlimit(RLIMIT_FSIZE, &r);
    r.rlim_cur = bytes < r.rlim_max ? bytes : r.rlim_max;
    setrlimit(RLIMIT_FSIZE, &r);
}

static void after_run(struct play *p, enum mk_status st)
{
    struct mk_loop_snapshot snap;
    struct session *s = &p->session;
    mk_loop_get_snapshot(s->loop, &snap);
    p->tally->runs++;
    p->tally->latched[snap.fault]++;
    *(s->options.fast ? &p->tally->simulated_s : &p->tally->real_s) += snap.sample.t;
    if (s->log_path[0] && s->log_on)
        check_log(s->log_path, st == MK_OK && snap.fault != MK_FAULT_LOG, &snap, p->tally,
                  p->violation);
}

/* Executes a line; true when the script ends. */
static bool play_line(struct play *p, const char *text)
{
    char copy[sizeof p->script.line[0]];
    struct cmd_line line;
    struct mk_error err = MK_ERROR_INIT;
    bool ran = p->session.running;
    snprintf(copy, sizeof copy, "%s", text);
    int st = cmd_parse(copy, NULL, &line, &err);
    if (st == MK_OK)
        st = cmd_execute(&p->session, &line, &err);
    p->tally->commands++;
    p->tally->refused += st < 0;
    watch_check(&p->session, p->violation, text);
    if (ran && !p->session.running)
        after_run(p, (enum mk_status)st);
    if (p->clock && strncmp(text, "setup", 5) == 0)
        watch_clock(&p->session);
    if (p->clock && p->session.running && draw_below(&p->random, 3) == 0) {
        watch_step_clock(pow(10.0, draw_between(&p->random, -4.0, 2.0)));
        p->tally->clock_steps++;
    }
    return st == CMD_QUIT;
}

static void say_nothing(void *user, const char *line)
{
    (void)user, (void)line;
}

static void play_script(struct play *p)
{
    struct session_options options = {
        .out = p->folder, .fast = !p->clock, .seed = 1, .say = say_nothing};
    struct mk_error err = MK_ERROR_INIT;
    if (session_open(&p->session, &options, &err) != MK_OK) {
        violate(p->violation, "a session cannot be opened: %s", err.message);
        session_close(&p->session);
        return;
    }
    watch_session(&p->session, p->violation);
    int full_at = p->full_disk ? draw_below(&p->random, p->script.count) : -1;
    for (int i = 0; i < p->script.count && !p->violation->seen; i++) {
        if (i == full_at) {
            limit_files((rlim_t)pow(10.0, draw_between(&p->random, 0.0, 6.0)));
            p->tally->full_disks++;
        }
        if (play_line(p, p->script.line[i]))
            break;
    }
    session_close(&p->session);
    if (watch_motor_on())
        violate(p->violation, "the motor is on after the session's end");
    limit_files(RLIM_INFINITY);
    p->tally->rules += p->script.faults;
    p->tally->changes += p->script.changes;
}

/* --- a command file ------------------------------------------------------------------------- */

static bool write_script(const struct script *s, const char *path)
{
    FILE *f = fopen(path, "w");
    for (int i = 0; f && i < s->count; i++)
        fprintf(f, "%s\n", s->line[i]);
    return f && fclose(f) == 0;
}

static void ignore_error(void *user, const struct mk_error *err)
{
    (void)user, (void)err;
}

static void change_bytes(struct play *p)
{
    for (int n = 1 + draw_below(&p->random, 6); n > 0; n--) {
        char *line = p->script.line[draw_below(&p->random, p->script.count)];
        line[draw_below(&p->random, (int)strlen(line) + 1)] =
            (char)(32 + draw_below(&p->random, 95));
    }
}

/* Reads the script as a file and executes it as `mechkit run` does. */
static void play_file(struct play *p)
{
    static const struct cmd_known nothing;
    char path[600];
    struct cmdfile *file;
    struct session_options options = {
        .out = p->folder, .fast = true, .seed = 1, .say = say_nothing};
    snprintf(path, sizeof path, "%s/script.cmd", p->folder);
    if (!write_script(&p->script, path)) {
        violate(p->violation, "%s: %s", path, strerror(errno));
        return;
    }
    if (cmdfile_read(path, &nothing, ignore_error, NULL, &file, NULL) != MK_OK) {
        p->tally->refused++;
        return;
    }
    if (session_open(&p->session, &options, NULL) == MK_OK) {
        watch_session(&p->session, p->violation);
        p->tally->refused += cmdfile_execute(file, &p->session, NULL) != MK_OK;
    }
    session_close(&p->session);
    if (watch_motor_on())
        violate(p->violation, "the motor is on after a command file's end");
    cmdfile_free(file);
}

/* --- killed --------------------------------------------------------------------------------- */

static void play_killed(struct play *p)
{
    pid_t child = fork();
    if (child == 0) {
        play_script(p);
        _exit(p->violation->seen);
    }
    double ms = draw_between(&p->random, 0.0, KILLED_AFTER_MS);
    nanosleep(&(struct timespec){0, (long)(ms * 1e6)}, NULL);
    kill(child, SIGKILL);
    int status = 0;
    while (waitpid(child, &status, 0) < 0 && errno == EINTR)
        continue;
    p->tally->kills += WIFSIGNALED(status) != 0;
    if (WIFEXITED(status) && WEXITSTATUS(status) != 0)
        violate(p->violation, "a violation in a process that was to be killed");
    if (WIFSIGNALED(status) && WTERMSIG(status) != SIGKILL)
        violate(p->violation, "it died of signal %d before it was killed", WTERMSIG(status));
    for (int i = 1; i < 20; i++) {
        char path[600];
        snprintf(path, sizeof path, "%s/run-%03d.csv", p->folder, i);
        if (access(path, F_OK) == 0)
            check_log(path, false, NULL, p->tally, p->violation);
    }
}

void episode_play(enum episode_kind kind, uint64_t seed, const char *folder, struct tally *tally,
                  struct violation *v)
{
    struct play p = {.random = {seed},
                     .folder = folder,
                     .tally = tally,
                     .violation = v,
                     .full_disk = kind == EPISODE_FULL_DISK,
                     .clock = kind == EPISODE_CLOCK};
    script_draw(&p.script, &p.random, p.clock);
    tally->episodes[kind]++;
    if (kind == EPISODE_KILLED) {
        play_killed(&p);
    } else if (kind == EPISODE_GARBAGE) {
        change_bytes(&p);
        play_file(&p);
    } else {
        play_script(&p);
    }
}
