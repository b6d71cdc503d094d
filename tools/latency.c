/* How late the loop's samples come, beside cyclictest on the same machine: `make latency`.
 *
 * The loop runs the pendubot on the virtual board in real time at 1 kHz, with its log; cyclictest
 * runs at the same period and priority. First one after the other; then in short slices in turn and
 * at the same time, so that a noisy minute of the machine does not fall on one side alone.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "mechkit/loop.h"

#define RATE_HZ 1000.0
#define PRIORITY 80
#define SLICE_S 2.0
#define CYCLICTEST_MAX_US 20000

/* Lateness in whole us, as cyclictest counts it. */
struct tally {
    const char *name;
    unsigned long bin[CYCLICTEST_MAX_US + 1];
    unsigned long samples, lost;
    double max_us;
};

static void tally_clear(struct tally *t, const char *name)
{
    memset(t, 0, sizeof *t);
    t->name = name;
}

static void tally_add(struct tally *t, double us, unsigned long n)
{
    int i = us < CYCLICTEST_MAX_US ? (int)us : CYCLICTEST_MAX_US;
    t->bin[i] += n;
    t->samples += n;
    if (n > 0 && us > t->max_us)
        t->max_us = us;
}

static double percentile(const struct tally *t, double p)
{
    unsigned long seen = 0;
    for (int i = 0; i <= CYCLICTEST_MAX_US; i++) {
        seen += t->bin[i];
        if (seen > 0 && (double)seen >= p * (double)t->samples)
            return i;
    }
    return CYCLICTEST_MAX_US;
}

static void report(const struct tally *t)
{
    printf("  %-10s %8lu samples %4lu lost   p50 %4.0f  p99 %4.0f  p99.9 %4.0f  max %5.0f us\n",
           t->name, t->samples, t->lost, percentile(t, 0.50), percentile(t, 0.99),
           percentile(t, 0.999), floor(t->max_us));
}

static void compare(const struct tally *loop, const struct tally *cyclic)
{
    report(loop);
    if (cyclic->samples == 0)
        return;
    report(cyclic);
    /* Both are whole microseconds: less than one is not a smaller number but no number. */
    double a = fmax(1.0, percentile(loop, 0.999)), b = fmax(1.0, percentile(cyclic, 0.999));
    printf("  ratio of p99.9: %.2f\n", a / b);
}

/* --- the loop -------------------------------------------------------------------------------- */

struct rig {
    struct mk_model model;
    struct mk_clock clock;
    struct mk_board *board;
    struct mk_signal *signal;
    struct mk_ctrl *ctrl;
    struct mk_loop *loop;
    char path[64];
};

static int fail(const struct mk_error *err)
{
    char text[800];
    fprintf(stderr, "latency: %s\n", mk_error_format(err, text, sizeof text));
    return 1;
}

static int rig_open(struct rig *r)
{
    struct mk_error err = MK_ERROR_INIT;
    struct mk_loop_config config;
    mk_model_default(MK_PLANT_PENDUBOT, &r->model);
    mk_clock_init_monotonic(&r->clock);
    mk_loop_config_default(&r->model, &config);
    config.rate_hz = RATE_HZ;
    config.priority = PRIORITY;
    mk_safety_default(&r->model, 1.0 / RATE_HZ, &config.limits);
    /* This measures the machine; the run must not end because the machine is slow. */
    config.limits.late_limit = 1 << 30;
    config.watchdog_ms = 0;
    const struct mk_board_config board = {.model = &r->model, .clock = &r->clock};
    if (mk_board_open(mk_board_backend_by_name("virtual"), &board, &r->board, &err) ||
        mk_signal_create("1.5*sin(6*t)", &r->signal, &err) ||
        mk_ctrl_create(mk_ctrl_setup_by_name("open-loop"), &r->model, 1.0 / RATE_HZ, r->signal,
                       &r->ctrl, &err) ||
        mk_loop_create(r->board, r->ctrl, &config, &r->loop, &err))
        return fail(&err);
    snprintf(r->path, sizeof r->path, "/tmp/mechkit-latency-%ld.csv", (long)getpid());
    return 0;
}

static void rig_close(struct rig *r)
{
    mk_loop_destroy(r->loop);
    mk_ctrl_destroy(r->ctrl);
    mk_signal_destroy(r->signal);
    mk_board_close(r->board);
    unlink(r->path);
}

static int read_lateness(const char *path, struct tally *t)
{
    struct mk_error err = MK_ERROR_INIT;
    struct mk_log *log;
    if (mk_log_read(path, &log, &err))
        return fail(&err);
    const double *late = mk_log_get(log, "late_us"), *tick = mk_log_get(log, "tick"),
                 *q = mk_log_get(log, "q1");
    for (size_t k = 0; k < log->rows; k++) {
        tally_add(t, late[k], 1);
        t->lost += isnan(q[k]) != 0;
    }
    t->lost += (unsigned long)tick[log->rows - 1] + 1 - (unsigned long)log->rows;
    mk_log_free(log);
    return 0;
}

/* A rig of its own each time: at the end of the last run the links still swing. */
static int run_loop(double seconds, struct tally *t, struct mk_loop_stats *stats)
{
    struct mk_error err = MK_ERROR_INIT;
    struct rig r = {.path = ""};
    int failed = rig_open(&r);
    if (!failed &&
        (mk_loop_start(r.loop, r.path, NULL, 0, &err) ||
         mk_loop_wait(r.loop, seconds, NULL, NULL, NULL, &err) || mk_loop_halt(r.loop, &err)))
        failed = fail(&err);
    if (!failed) {
        mk_loop_get_stats(r.loop, stats);
        failed = read_lateness(r.path, t);
    }
    rig_close(&r);
    return failed;
}

/* --- cyclictest ------------------------------------------------------------------------------ */

static FILE *start_cyclictest(double seconds)
{
    char command[160];
    snprintf(command, sizeof command, "cyclictest -q -m -t1 -p%d -i%.0f -l%.0f -h%d 2>/dev/null",
             PRIORITY, 1e6 / RATE_HZ, seconds * RATE_HZ, CYCLICTEST_MAX_US);
    return popen(command, "r");
}

/* Lines of the histogram are "US COUNT"; the rest starts with '#'. */
static int finish_cyclictest(FILE *pipe, struct tally *t)
{
    char line[256];
    if (!pipe)
        return 1;
    while (fgets(line, sizeof line, pipe)) {
        unsigned long us, n, max;
        if (sscanf(line, "%lu %lu", &us, &n) == 2)
            tally_add(t, (double)us, n);
        else if (sscanf(line, "# Max Latencies: %lu", &max) == 1 && (double)max > t->max_us)
            t->max_us = (double)max;
    }
    return pclose(pipe) == 0 && t->samples > 0 ? 0 : 1;
}

/* --- the comparisons ------------------------------------------------------------------------- */

static struct tally loop, cyclic;

static void begin(const char *what)
{
    printf("%s\n", what);
    fflush(stdout);
    tally_clear(&loop, "mechkit");
    tally_clear(&cyclic, "cyclictest");
}

static int one_after_the_other(double seconds, int *have_cyclictest)
{
    struct mk_loop_stats stats;
    if (run_loop(seconds, &loop, &stats))
        return 1;
    if (*have_cyclictest && finish_cyclictest(start_cyclictest(seconds), &cyclic))
        *have_cyclictest = 0;
    compare(&loop, &cyclic);
    printf("  a tick takes %.1f us on average, %.1f at most; %s\n", stats.busy_mean_us,
           stats.busy_max_us, stats.note[0] ? stats.note : "real-time priority, memory locked");
    return 0;
}

static int in_turn(double seconds)
{
    struct mk_loop_stats stats;
    for (double t = 0.0; t < seconds; t += SLICE_S)
        if (run_loop(SLICE_S, &loop, &stats) ||
            finish_cyclictest(start_cyclictest(SLICE_S), &cyclic))
            return 1;
    compare(&loop, &cyclic);
    return 0;
}

static int at_the_same_time(double seconds)
{
    struct mk_loop_stats stats;
    FILE *pipe = start_cyclictest(seconds);
    int failed = run_loop(seconds, &loop, &stats);
    if (finish_cyclictest(pipe, &cyclic) || failed)
        return 1;
    compare(&loop, &cyclic);
    return 0;
}

int main(int argc, char **argv)
{
    double seconds = argc > 1 ? atof(argv[1]) : 60.0;
    if (!(seconds >= 1.0 && seconds <= 86400.0)) {
        fprintf(stderr, "latency: usage: latency [SECONDS]\n");
        return 2;
    }
    int have_cyclictest = system("command -v cyclictest >/dev/null 2>&1") == 0;
    printf("%.0f s each at %.0f Hz, priority %d\n", seconds, RATE_HZ, PRIORITY);
    begin("one after the other");
    if (one_after_the_other(seconds, &have_cyclictest))
        return 1;
    if (!have_cyclictest) {
        printf("  skipped: cyclictest not installed or not permitted\n");
        return 0;
    }
    begin("in turn, slices of 2 s");
    if (in_turn(seconds))
        return 1;
    begin("at the same time");
    return at_the_same_time(seconds);
}
