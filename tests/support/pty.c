#include "support/pty.h"

#include <errno.h>
#include <poll.h>
#include <pty.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

static double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void *sleep_on(void *sleeper)
{
    const struct pty_sleeper *own = sleeper;
    struct pty *p = own->pty;
    cpu_set_t cpu;
    CPU_ZERO(&cpu);
    CPU_SET((size_t)own->cpu, &cpu);
    pthread_setaffinity_np(pthread_self(), sizeof cpu, &cpu);
    while (!p->awake) {
        const double due = now_s() + 1e-3;
        usleep(1000);
        long late_us = (long)(1e6 * (now_s() - due));
        long most_us = p->overslept_us;
        while (late_us > most_us &&
               !atomic_compare_exchange_weak(&p->overslept_us, &most_us, late_us))
            ;
    }
    return NULL;
}

/* On each processor that this process may use. */
static void start_sleepers(struct pty *p)
{
    cpu_set_t allowed;
    if (sched_getaffinity(0, sizeof allowed, &allowed) != 0)
        return;
    for (int cpu = 0; cpu < CPU_SETSIZE && p->n_sleepers < PTY_SLEEPERS; cpu++) {
        struct pty_sleeper *s = &p->sleepers[p->n_sleepers];
        s->pty = p;
        s->cpu = cpu;
        if (CPU_ISSET((size_t)cpu, &allowed) && pthread_create(&s->thread, NULL, sleep_on, s) == 0)
            p->n_sleepers++;
    }
}

void pty_start(struct pty *p, int rows, int cols, const char *folder, const char *language,
               const char *const *argv)
{
    struct winsize size = {.ws_row = (unsigned short)rows, .ws_col = (unsigned short)cols};
    char state[600];
    snprintf(state, sizeof state, "%s/state", folder);
    memset(p, 0, sizeof *p);
    vt_init(&p->vt, rows, cols);
    p->child = forkpty(&p->fd, NULL, NULL, &size);
    if (p->child == 0) {
        setenv("TERM", "xterm-256color", 1);
        setenv("LC_ALL", language, 1);
        setenv("XDG_STATE_HOME", state, 1); /* what it keeps between sessions */
        unsetenv("NO_COLOR");
        unsetenv("LINES");
        unsetenv("COLUMNS");
        if (chdir(folder) == 0)
            execvp(argv[0], (char *const *)(uintptr_t)argv);
        _exit(127);
    }
    start_sleepers(p);
}

static bool read_some(struct pty *p, double seconds)
{
    char bytes[8192];
    struct pollfd fd = {.fd = p->fd, .events = POLLIN};
    if (p->fd < 0 || poll(&fd, 1, (int)(seconds * 1e3) + 1) <= 0)
        return p->fd >= 0;
    ssize_t n = read(p->fd, bytes, sizeof bytes);
    if (n <= 0)
        return false; /* EIO: the program has gone */
    p->written += (size_t)n;
    vt_write(&p->vt, bytes, (size_t)n);
    return true;
}

void pty_run(struct pty *p, double seconds)
{
    double end = now_s() + seconds, left;
    while ((left = end - now_s()) > 0.0)
        if (!read_some(p, left))
            usleep(10000);
}

void pty_type(struct pty *p, const char *keys)
{
    size_t n = strlen(keys);
    while (n > 0 && p->fd >= 0) {
        ssize_t done = write(p->fd, keys, n);
        if (done < 0)
            return;
        keys += done;
        n -= (size_t)done;
    }
}

void pty_resize(struct pty *p, int rows, int cols)
{
    struct winsize size = {.ws_row = (unsigned short)rows, .ws_col = (unsigned short)cols};
    vt_resize(&p->vt, rows, cols);
    ioctl(p->fd, TIOCSWINSZ, &size);
}

static bool on_screen(struct pty *p, const char *text)
{
    char *screen = vt_text(&p->vt);
    bool found = strstr(screen, text) != NULL;
    free(screen);
    return found;
}

static bool wait_for(struct pty *p, const char *text, bool there, double seconds)
{
    double end = now_s() + seconds;
    while (on_screen(p, text) != there) {
        if (now_s() > end || !read_some(p, 0.02)) {
            char *screen = vt_text(&p->vt);
            fprintf(stderr, "'%s' %s within %g s:\n%s\n", text,
                    there ? "does not appear" : "does not go", seconds, screen);
            free(screen);
            return false;
        }
    }
    return true;
}

bool pty_shows(struct pty *p, const char *text, double seconds)
{
    return wait_for(p, text, true, seconds);
}

bool pty_hides(struct pty *p, const char *text, double seconds)
{
    return wait_for(p, text, false, seconds);
}

int pty_exit_code(struct pty *p, double seconds)
{
    double end = now_s() + seconds;
    while (!p->ended && now_s() < end) {
        if (!read_some(p, 0.02))
            usleep(5000);
        p->ended = waitpid(p->child, &p->status, WNOHANG) == p->child;
    }
    if (!p->ended)
        return -1;
    return WIFEXITED(p->status) ? WEXITSTATUS(p->status) : 128 + WTERMSIG(p->status);
}

void pty_hang_up(struct pty *p)
{
    if (p->fd >= 0)
        close(p->fd);
    p->fd = -1;
}

void pty_end(struct pty *p)
{
    if (!p->ended) {
        kill(p->child, SIGKILL);
        waitpid(p->child, &p->status, 0);
        p->ended = true;
    }
    pty_hang_up(p);
    vt_free(&p->vt);
    p->awake = true;
    for (int i = 0; i < p->n_sleepers; i++)
        pthread_join(p->sleepers[i].thread, NULL);
    p->n_sleepers = 0;
}
