/* What the real-time thread pays for a row of the log: the hand-over to the thread that writes,
 * with every processor busy: `make handover`.
 *
 * At 1 kHz a record like the loop's goes into a ring like the loop's, and the clock is read before
 * and after. Another thread empties the ring and writes the rows. The load is that of stress-ng,
 * or, where that is missing, a process for each processor that goes through 8 MB of memory.
 */
#include <math.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "ctrl/loop_priv.h"

#define PRIORITY 80
#define PERIOD_NS 1000000L
#define BIN_NS 50
#define BINS 400 /* up to 20 us; the last one has all beyond */
#define MOST_CHILDREN 64
#define MEMORY (8u << 20)

static int64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

/* --- load ------------------------------------------------------------------------------------ */

static pid_t children[MOST_CHILDREN];
static int child_count;

static void busy_for_ever(void)
{
    volatile char *memory = malloc(MEMORY);
    for (size_t i = 0; memory; i = (i + 64) % MEMORY)
        memory[i]++;
    _exit(1);
}

static const char *start_load(double seconds)
{
    const long processors = sysconf(_SC_NPROCESSORS_ONLN);
    const int have_stress_ng = system("command -v stress-ng >/dev/null 2>&1") == 0;
    for (long i = 0; i < (have_stress_ng ? 1 : processors) && child_count < MOST_CHILDREN; i++) {
        const pid_t child = fork();
        if (child == 0 && have_stress_ng) {
            char timeout[32], count[32];
            snprintf(timeout, sizeof timeout, "%.0f", ceil(seconds) + 5.0);
            snprintf(count, sizeof count, "%ld", processors);
            execlp("stress-ng", "stress-ng", "--quiet", "--cpu", count, "--vm", count, "--vm-bytes",
                   "8M", "--timeout", timeout, (char *)NULL);
            _exit(1);
        }
        if (child == 0)
            busy_for_ever();
        if (child > 0)
            children[child_count++] = child;
    }
    return have_stress_ng ? "stress-ng" : "busy processes (stress-ng is not installed)";
}

static void stop_load(void)
{
    for (int i = 0; i < child_count; i++) {
        kill(children[i], SIGTERM);
        waitpid(children[i], NULL, 0);
    }
}

/* --- the thread that writes ------------------------------------------------------------------ */

struct drain {
    struct mk_ring *ring;
    struct mk_log_writer *log;
    atomic_bool stop;
    unsigned long rows;
};

static void *drain(void *context)
{
    struct drain *d = context;
    struct mk_loop_record record;
    for (;;) {
        const bool last = atomic_load(&d->stop);
        while (mk_ring_pop(d->ring, &record)) {
            const double row[] = {record.sample.t, record.sample.u, record.sample.q[0]};
            d->rows += mk_log_writer_row(d->log, row) == MK_OK;
        }
        if (last)
            return NULL;
        usleep(20000);
    }
}

/* --- the real-time thread -------------------------------------------------------------------- */

struct tally {
    unsigned long bin[BINS], rows, full;
    int64_t most_ns;
};

static void hand_over(struct mk_ring *ring, double seconds, struct tally *tally)
{
    struct mk_loop_record record = {.fault = MK_FAULT_NONE};
    struct timespec next;
    clock_gettime(CLOCK_MONOTONIC, &next);
    for (long k = 0; (double)k * 1e-9 * PERIOD_NS < seconds; k++) {
        next.tv_nsec += PERIOD_NS;
        if (next.tv_nsec >= 1000000000) {
            next.tv_nsec -= 1000000000;
            next.tv_sec++;
        }
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, NULL) != 0)
            ;
        record.sample.t = (double)k * 1e-9 * PERIOD_NS;
        const int64_t begin = now_ns();
        tally->full += !mk_ring_push(ring, &record);
        const int64_t took = now_ns() - begin;
        tally->bin[took < BIN_NS * (BINS - 1) ? took / BIN_NS : BINS - 1]++;
        tally->rows++;
        tally->most_ns = took > tally->most_ns ? took : tally->most_ns;
    }
}

/* Upper end of the bin in which the share `p` of all rows is reached, ns. */
static int percentile(const struct tally *t, double p)
{
    unsigned long seen = 0;
    for (int i = 0; i < BINS; i++) {
        seen += t->bin[i];
        if ((double)seen >= p * (double)t->rows)
            return BIN_NS * (i + 1);
    }
    return BIN_NS * BINS;
}

static void report(const struct tally *t)
{
    const int width = 50;
    unsigned long highest = 1;
    for (int i = 0; i < BINS; i++)
        highest = t->bin[i] > highest ? t->bin[i] : highest;
    printf("  %8s %8s\n", "below ns", "rows");
    for (int i = 0; i < BINS; i++)
        if (t->bin[i] > 0) {
            /* By the logarithm: what is rare is what matters. */
            const int bar =
                1 + (int)(width * log((double)t->bin[i]) / fmax(1.0, log((double)highest)));
            printf("  %s%7d %8lu %.*s\n", i + 1 < BINS ? " " : ">", BIN_NS * (i + (i + 1 < BINS)),
                   t->bin[i], bar > width ? width : bar,
                   "##################################################");
        }
    printf("  rows %lu  full %lu  p50 %d  p99 %d  p99.9 %d  max %lld ns\n", t->rows, t->full,
           percentile(t, 0.5), percentile(t, 0.99), percentile(t, 0.999), (long long)t->most_ns);
}

static int fail(const struct mk_error *err)
{
    char text[800];
    fprintf(stderr, "handover: %s\n", mk_error_format(err, text, sizeof text));
    return 1;
}

static int measure(double seconds)
{
    static const char *const names[] = {"t", "u", "q1"};
    struct mk_error err = MK_ERROR_INIT;
    static struct tally tally;
    struct drain d = {.rows = 0};
    pthread_t writer;
    char path[64];
    snprintf(path, sizeof path, "/tmp/mechkit-handover-%ld.csv", (long)getpid());
    if (mk_ring_create(4096, sizeof(struct mk_loop_record), &d.ring))
        return 1;
    int failed = 1;
    if (mk_log_writer_open(path, true, NULL, 0, names, 3, &d.log, &err)) {
        fail(&err);
    } else if (pthread_create(&writer, NULL, drain, &d) == 0) {
        /* The load first: children inherit the priority. */
        const char *load = start_load(seconds);
        const struct sched_param priority = {.sched_priority = PRIORITY};
        const bool locked = mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
        const bool first = pthread_setschedparam(pthread_self(), SCHED_FIFO, &priority) == 0;
        printf("%.0f s at 1 kHz under %s; %s, %s\n", seconds, load,
               first ? "real-time priority" : "real-time priority not granted",
               locked ? "memory locked" : "memory not locked");
        hand_over(d.ring, seconds, &tally);
        stop_load();
        atomic_store(&d.stop, true);
        pthread_join(writer, NULL);
        failed = mk_log_writer_close(d.log, &err) ? fail(&err) : 0;
        if (d.rows + tally.full != tally.rows) {
            fprintf(stderr, "handover: %lu rows went in and %lu came out\n", tally.rows, d.rows);
            failed = 1;
        }
        report(&tally);
    }
    unlink(path);
    mk_ring_destroy(d.ring);
    return failed;
}

int main(int argc, char **argv)
{
    double seconds = argc > 1 ? atof(argv[1]) : 60.0;
    if (!(seconds >= 1.0 && seconds <= 86400.0)) {
        fprintf(stderr, "handover: usage: handover [SECONDS]\n");
        return 2;
    }
    return measure(seconds);
}
