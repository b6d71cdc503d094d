/* The machine and the board: nothing of this moves the rig. */
#include <errno.h>
#include <math.h>
#include <pthread.h>
#include <sched.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include "console/commands/doctor.h"

#define PRIORITY 80
#define JITTER_HZ 1000.0
#define JITTER_GOOD_US 500.0 /* half a period at 1 kHz: what the loop calls late */
#define ROUND_TRIPS 400
#define ROUND_TRIP_GOOD_US 1000.0
#define WATCHDOG_MS 20

void doctor_say(struct doctor *d, enum doctor_verdict verdict, const char *what, const char *advice,
                const char *found, ...)
{
    char text[400];
    va_list args;
    va_start(args, found);
    vsnprintf(text, sizeof text, found, args);
    va_end(args);
    d->problems += verdict == DOCTOR_PROBLEM;
    d->line(d->user, verdict, what, text, advice);
}

static int by_size(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* --- the machine -------------------------------------------------------------------------------
 */

struct jitter {
    size_t n;
    double *late_us;
    int refused; /* errno of asking for SCHED_FIFO */
};

static void *wake_up_often(void *arg)
{
    struct jitter *j = arg;
    const struct sched_param param = {.sched_priority = PRIORITY};
    j->refused = pthread_setschedparam(pthread_self(), SCHED_FIFO, &param);
    struct mk_clock clock;
    mk_clock_init_monotonic(&clock);
    int64_t start_ns = mk_clock_now_ns(&clock) + 1000000;
    for (size_t k = 0; k < j->n; k++) {
        int64_t deadline_ns = start_ns + (int64_t)((double)k * 1e9 / JITTER_HZ);
        mk_clock_sleep_until(&clock, deadline_ns);
        j->late_us[k] = 1e-3 * (double)(mk_clock_now_ns(&clock) - deadline_ns);
    }
    return NULL;
}

static void say_priority(struct doctor *d, const struct jitter *j)
{
    if (j->refused == 0)
        doctor_say(d, DOCTOR_OK, "real-time priority", "", "SCHED_FIFO %d granted", PRIORITY);
    else
        doctor_say(d, DOCTOR_PROBLEM, "real-time priority",
                   "install udev/mechkit-limits.conf as /etc/security/limits.d/mechkit.conf (the "
                   "package does), join the group plugdev, log in again",
                   "SCHED_FIFO %d refused: %s", PRIORITY, strerror(j->refused));
}

static void say_memory(struct doctor *d)
{
    struct rlimit limit = {0};
    getrlimit(RLIMIT_MEMLOCK, &limit);
    if (geteuid() == 0 || limit.rlim_cur == RLIM_INFINITY)
        doctor_say(d, DOCTOR_OK, "locked memory", "", "no limit");
    else
        doctor_say(d, DOCTOR_PROBLEM, "locked memory",
                   "ulimit -l unlimited, or the same file and group", "limited to %llu kB",
                   (unsigned long long)limit.rlim_cur / 1024);
}

void doctor_machine(struct doctor *d, double seconds)
{
    struct jitter j = {.n = (size_t)(seconds * JITTER_HZ) + 1};
    pthread_t thread;
    j.late_us = calloc(j.n, sizeof *j.late_us);
    if (!j.late_us || pthread_create(&thread, NULL, wake_up_often, &j) != 0) {
        doctor_say(d, DOCTOR_PROBLEM, "jitter", "close other programs", "no memory or no thread");
        free(j.late_us);
        return;
    }
    pthread_join(thread, NULL);
    say_priority(d, &j);
    say_memory(d);
    qsort(j.late_us, j.n, sizeof *j.late_us, by_size);
    double p99 = j.late_us[j.n * 99 / 100];
    bool good = p99 < JITTER_GOOD_US;
    doctor_say(d, good ? DOCTOR_OK : DOCTOR_PROBLEM, "jitter",
               good ? "" : "close other programs, allow real-time priority, take a lower --rate",
               "%.2g s at 1 kHz: late by %.0f us (median), %.0f us (99 %%), %.0f us (worst)",
               seconds, j.late_us[j.n / 2], p99, j.late_us[j.n - 1]);
    free(j.late_us);
}

/* --- the board ---------------------------------------------------------------------------------
 */

static bool say_identity(struct doctor *d, struct mk_board *board, const struct mk_model *model)
{
    struct mk_board_identity id;
    struct mk_error err = MK_ERROR_INIT;
    if (board->ops->identify(board, &id, &err) != MK_OK) {
        doctor_say(d, DOCTOR_PROBLEM, "identity", "switch the board off and on", "%s", err.message);
        return false;
    }
    doctor_say(d, DOCTOR_OK, "identity", "", "%s, firmware %s, serial number %s, %d-bit counters",
               id.name, id.firmware, id.serial[0] ? id.serial : "-", id.counter_bits);
    for (int j = 0; j < mk_model_joints(model); j++)
        if (id.encoder_cpr[j] > 0 && model->encoder_cpr[j] > 0 &&
            id.encoder_cpr[j] != model->encoder_cpr[j])
            doctor_say(d, DOCTOR_PROBLEM, "encoder counts",
                       "correct encoder_cpr in the model, or choose the right model",
                       "joint %d: board %d a turn, model %d", j + 1, id.encoder_cpr[j],
                       model->encoder_cpr[j]);
    return true;
}

static void say_round_trips(struct doctor *d, struct mk_board *board)
{
    static const char advice[] = "check cable and hub; no other heavy traffic on the bus";
    struct mk_board_sample s;
    double us[ROUND_TRIPS];
    uint32_t before = 0;
    int lost = 0, gaps = 0, n = 0;
    int64_t start_ns = mk_clock_now_ns(board->clock);
    for (int k = 0; k < ROUND_TRIPS; k++) {
        mk_clock_sleep_until(board->clock, start_ns + (int64_t)k * 2000000);
        int64_t t_ns = mk_clock_now_ns(board->clock);
        if (mk_board_exchange(board, 0.0, &s) != MK_OK) {
            lost++;
            continue;
        }
        us[n++] = 1e-3 * (double)(mk_clock_now_ns(board->clock) - t_ns);
        gaps += n > 1 && s.sequence != before + 1;
        before = s.sequence;
    }
    if (n == 0) {
        doctor_say(d, DOCTOR_PROBLEM, "exchanges", advice, "none of %d came back", ROUND_TRIPS);
        return;
    }
    qsort(us, (size_t)n, sizeof *us, by_size);
    bool good = lost == 0 && gaps == 0 && us[n * 99 / 100] < ROUND_TRIP_GOOD_US;
    doctor_say(d, good ? DOCTOR_OK : DOCTOR_PROBLEM, "exchanges", good ? "" : advice,
               "%d: %.0f us (median), %.0f us (99 %%), %.0f us (worst); %d lost, %d gaps",
               ROUND_TRIPS, us[n / 2], us[n * 99 / 100], us[n - 1], lost, gaps);
}

/* With a command of 0: the motor stays still whether the watchdog works or not. */
static void say_watchdog(struct doctor *d, struct mk_board *board)
{
    static const char advice[] = "do not drive the rig with this board";
    const struct mk_board_ops *ops = board->ops;
    struct mk_board_sample quiet = {0}, late = {0};
    if (!ops->set_watchdog) {
        doctor_say(d, DOCTOR_PROBLEM, "watchdog", advice, "this board has none");
        return;
    }
    enum mk_status st = ops->set_watchdog(board, WATCHDOG_MS, NULL);
    if (st == MK_OK)
        st = mk_board_exchange(board, 0.0, &quiet);
    mk_clock_sleep_until(board->clock,
                         mk_clock_now_ns(board->clock) + 2 * WATCHDOG_MS * INT64_C(1000000));
    if (st == MK_OK)
        st = mk_board_exchange(board, 0.0, &late);
    bool bites = !(quiet.status & MK_BOARD_ST_WATCHDOG) && (late.status & MK_BOARD_ST_WATCHDOG);
    if (ops->set_watchdog(board, 0, NULL) != MK_OK || st != MK_OK)
        doctor_say(d, DOCTOR_PROBLEM, "watchdog", "check cable and power", "the board fell silent");
    else if (bites)
        doctor_say(d, DOCTOR_OK, "watchdog", "", "bites after %d ms without an exchange",
                   WATCHDOG_MS);
    else
        doctor_say(d, DOCTOR_PROBLEM, "watchdog", advice, "did not bite");
}

bool doctor_board(struct doctor *d, struct mk_board *board, const struct mk_model *model)
{
    if (!say_identity(d, board, model))
        return false;
    say_round_trips(d, board);
    say_watchdog(d, board);
    struct mk_board_sample s;
    bool alive = mk_board_exchange(board, 0.0, &s) == MK_OK;
    if (alive && s.status & MK_BOARD_ST_FAULT)
        doctor_say(d, DOCTOR_PROBLEM, "board's own faults", "look at amplifier and power supply",
                   "a fault comes back after it was cleared");
    else if (alive)
        doctor_say(d, DOCTOR_OK, "board's own faults", "", "none");
    return alive;
}
