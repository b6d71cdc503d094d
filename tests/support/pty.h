/* A program in a terminal: keys go in, the screen can be read. */
#ifndef MECHKIT_TESTS_SUPPORT_PTY_H
#define MECHKIT_TESTS_SUPPORT_PTY_H

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <sys/types.h>

#include "support/vt.h"

#define PTY_SLEEPERS 64

struct pty {
    struct vt vt;
    int fd; /* our side; -1: closed */
    pid_t child;
    int status; /* of waitpid, once it has ended */
    bool ended;
    size_t written; /* bytes that the program has written */
    /* A thread on each processor that does nothing but sleep, and by how much they overslept at
     * most: a processor that is taken away is seen by its own sleeper alone. */
    struct pty_sleeper {
        struct pty *pty;
        int cpu;
        pthread_t thread;
    } sleepers[PTY_SLEEPERS];
    int n_sleepers;
    _Atomic long overslept_us;
    atomic_bool awake;
};

/* Starts argv (ended by NULL) in `folder`, in a terminal of this size. `language` is LC_ALL. */
void pty_start(struct pty *p, int rows, int cols, const char *folder, const char *language,
               const char *const *argv);
void pty_type(struct pty *p, const char *keys);
void pty_resize(struct pty *p, int rows, int cols);
/* Reads what comes for so long. */
void pty_run(struct pty *p, double seconds);
/* Until the screen has (or has no more) this text; false: not in time. */
bool pty_shows(struct pty *p, const char *text, double seconds);
bool pty_hides(struct pty *p, const char *text, double seconds);
/* Until the program ends; its exit code, 128 + a signal's number, or -1: it does not end. */
int pty_exit_code(struct pty *p, double seconds);
/* Closes our side, as a terminal window does. */
void pty_hang_up(struct pty *p);
/* Kills what is left, frees. */
void pty_end(struct pty *p);

#endif
