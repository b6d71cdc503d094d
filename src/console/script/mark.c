#include "console/script/mark.h"

#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "console/commands/summary.h"

static void write_mark(const struct mark *m, const char *ended)
{
    char next[sizeof m->path + 8], when[40];
    time_t now = time(NULL);
    struct tm parts;
    if (!m->path[0])
        return;
    localtime_r(&now, &parts);
    strftime(when, sizeof when, "%Y-%m-%d %H:%M:%S", &parts);
    snprintf(next, sizeof next, "%s.new", m->path);
    FILE *f = fopen(next, "w");
    if (!f)
        return; /* a folder that cannot be written to: logs will say so */
    fprintf(f, "process: %ld\nwritten: %s\nrunning: %s\nlog: %s\n", (long)getpid(), when,
            m->running ? "yes" : "no", m->log);
    if (ended)
        fprintf(f, "ended: %s\n", ended);
    if (fclose(f) != 0 || rename(next, m->path) != 0)
        unlink(next);
}

struct old {
    long process;
    bool running;
    char when[40], log[SESSION_PATH], ended[80];
};

static void take(char *out, size_t size, const char *line, const char *key)
{
    size_t n = strlen(key);
    if (strncmp(line, key, n) == 0)
        snprintf(out, size, "%.*s", (int)strcspn(line + n, "\n"), line + n);
}

static bool read_mark(const char *path, struct old *o)
{
    char line[SESSION_PATH + 32], number[24] = "", running[8] = "";
    FILE *f = fopen(path, "r");
    memset(o, 0, sizeof *o);
    if (!f)
        return false;
    while (fgets(line, sizeof line, f)) {
        take(number, sizeof number, line, "process: ");
        take(running, sizeof running, line, "running: ");
        take(o->when, sizeof o->when, line, "written: ");
        take(o->log, sizeof o->log, line, "log: ");
        take(o->ended, sizeof o->ended, line, "ended: ");
    }
    fclose(f);
    o->process = strtol(number, NULL, 10);
    o->running = strcmp(running, "yes") == 0;
    return o->process > 0;
}

static bool is_alive(long process)
{
    return process != (long)getpid() && (kill((pid_t)process, 0) == 0 || errno == EPERM);
}

static void tell(const struct old *o, char *out, size_t size)
{
    struct run_summary r;
    size_t used;
    if (o->ended[0])
        used = (size_t)snprintf(out, size, "the last session was ended by %s, %s; the motor is off",
                                o->ended, o->when);
    else
        used = (size_t)snprintf(out, size, "the last session (%s) did not end properly%s", o->when,
                                o->running ? "; it ended in mid run, and the motor with it" : "");
    if (o->log[0] && used < size && summarise(o->log, &r, NULL) == MK_OK)
        snprintf(out + used, size - used, "; its log is kept: %s, %.1f s", o->log, r.seconds);
}

void mark_set(struct mark *m, const char *folder, char *last, size_t size)
{
    struct old o;
    *m = (struct mark){.running = false};
    last[0] = '\0';
    snprintf(m->path, sizeof m->path, "%s/%s", folder ? folder : ".", MARK_NAME);
    if (read_mark(m->path, &o)) {
        if (!o.ended[0] && is_alive(o.process)) {
            snprintf(last, size, "another console works in this folder (process %ld)", o.process);
            m->path[0] = '\0';
        } else {
            tell(&o, last, size);
        }
    }
    write_mark(m, NULL);
}

void mark_run(struct mark *m, bool running, const char *log)
{
    if (running == m->running && strcmp(log, m->log) == 0)
        return;
    m->running = running;
    snprintf(m->log, sizeof m->log, "%s", log);
    write_mark(m, NULL);
}

void mark_end(struct mark *m, const char *why)
{
    m->running = false;
    if (why)
        write_mark(m, why);
    else if (m->path[0])
        unlink(m->path);
}
