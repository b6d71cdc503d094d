#include "console/commands/guard.h"

#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "base/temporary.h"
#include "console/commands/signals.h"
#include "console/script/host.h"

#define LOOK_NS 100000000L
#define END_PATIENCE_S 2.0 /* for the screen to end by itself after a signal */

/* Signals have one owner in a process. */
static struct {
    struct host *host;
    void (*restore)(void);
    pthread_t thread;
    bool started;
    atomic_bool stop;
    atomic_int ending; /* number of the signal */
    atomic_bool stopping, crashed;
    atomic_llong beat_ns;
} guard;

static void signals(sigset_t *set)
{
    const struct ending_signal *s;
    sigemptyset(set);
    for (int i = 0; (s = signals_ending(i)) != NULL; i++)
        sigaddset(set, s->number);
    sigaddset(set, SIGTSTP);
}

void guard_take_signals(void)
{
    sigset_t set;
    signals(&set);
    pthread_sigmask(SIG_BLOCK, &set, NULL);
    signal(SIGTTOU, SIG_IGN); /* a background process may restore its terminal */
    signal(SIGTTIN, SIG_IGN);
}

static long long now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

static double silent_s(void)
{
    return (double)(now_ns() - atomic_load(&guard.beat_ns)) * 1e-9;
}

void guard_beat(void)
{
    atomic_store(&guard.beat_ns, now_ns());
}

const char *guard_wants_end(void)
{
    const struct ending_signal *s;
    int number = atomic_load(&guard.ending);
    for (int i = 0; (s = signals_ending(i)) != NULL; i++)
        if (s->number == number)
            return s->name;
    return NULL;
}

bool guard_wants_stop(void)
{
    return atomic_exchange(&guard.stopping, false);
}

bool guard_crashed(void)
{
    return atomic_load(&guard.crashed);
}

/* --- a crash --------------------------------------------------------------------------------- */

/* The loop's thread still runs: it zeroes the motor and its log is written out before the process
 * ends as it would have without us. */
static void on_crash(int number)
{
    static const char text[] = "mechkit: crashed; motor off, log kept\n";
    signal(number, SIG_DFL);
    atomic_store(&guard.crashed, true);
    host_estop_in_crash(guard.host);
    const struct timespec tail = {.tv_nsec = 350000000};
    nanosleep(&tail, NULL);
    guard.restore();
    if (write(STDERR_FILENO, text, sizeof text - 1) < 0)
        _exit(1);
    raise(number);
}

static void watch_for_crashes(void)
{
    static const int numbers[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = on_crash;
    sigemptyset(&action.sa_mask);
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++)
        sigaction(numbers[i], &action, NULL);
}

/* --- the thread ------------------------------------------------------------------------------ */

/* The screen does not come back: a terminal that takes no more characters, most likely. The motor
 * is off since the signal; what is left is to end. */
static void end_without_screen(void)
{
    host_finish(guard.host);
    tcflush(STDOUT_FILENO, TCOFLUSH);
    guard.restore();
    mk_temporary_remove();
    _exit(1);
}

static void on_signal(int number)
{
    host_halt(guard.host);
    if (number == SIGTSTP)
        atomic_store(&guard.stopping, true);
    else
        atomic_store(&guard.ending, number);
}

static void *guard_thread(void *user)
{
    (void)user;
    sigset_t set;
    const struct timespec pause = {.tv_nsec = LOOK_NS};
    long long ending_since = 0;
    bool silent = false;
    signals(&set);
    while (!atomic_load(&guard.stop)) {
        int number = sigtimedwait(&set, NULL, &pause);
        if (number > 0)
            on_signal(number);
        if (!silent && silent_s() > GUARD_PATIENCE_S && host_is_running(guard.host)) {
            host_estop(guard.host);
            host_note(guard.host, HOST_WARNING, "the screen stood still for %.0f s: motor off",
                      GUARD_PATIENCE_S);
        }
        silent = silent_s() > GUARD_PATIENCE_S;
        if (atomic_load(&guard.ending) && !ending_since)
            ending_since = now_ns();
        if (ending_since && (double)(now_ns() - ending_since) * 1e-9 > END_PATIENCE_S)
            end_without_screen();
    }
    return NULL;
}

enum mk_status guard_start(struct host *host, void (*restore)(void), struct mk_error *err)
{
    guard.host = host;
    guard.restore = restore;
    atomic_store(&guard.stop, false);
    atomic_store(&guard.ending, 0);
    guard_beat();
    int rc = pthread_create(&guard.thread, NULL, guard_thread, NULL);
    if (rc != 0)
        return mk_error_errno(err, rc, NULL, "cannot create the guard's thread");
    guard.started = true;
    watch_for_crashes();
    return MK_OK;
}

void guard_stop(void)
{
    if (!guard.started)
        return;
    atomic_store(&guard.stop, true);
    pthread_join(guard.thread, NULL);
    guard.started = false;
}
