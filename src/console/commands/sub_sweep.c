/* mechkit sweep: many runs over grids of values, on all processors and machines. */
#include <inttypes.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "base/out_file.h"
#include "console/commands/gnuplot.h"
#include "console/commands/options.h"
#include "console/commands/sweep_report.h"
#include "experiment/sweep_journal.h"
#include "experiment/sweep_work.h"

#define PROGRESS_S 1.0

struct options {
    const char *spec, *out, *plot;
    char out_made[600]; /* beside the spec, where --out is not given */
    int threads;        /* 0: as many as there are processors */
    bool quiet;
};

/* A signal ends the sweep between two runs; the journal keeps what there is. */
static volatile sig_atomic_t stopped;

static void on_signal(int number)
{
    (void)number;
    stopped = 1;
}

static void catch_signals(void)
{
    signal(SIGINT, on_signal);
    signal(SIGTERM, on_signal);
    if (signal(SIGHUP, SIG_IGN) != SIG_IGN) /* of nohup: it goes on without a terminal */
        signal(SIGHUP, on_signal);
}

static const struct option_row option_rows[] = {
    {"out", OPTION_OUTPUT(out), "FILE.csv",
     "default: the spec's name with .csv, in the current directory"},
    {"plot", OPTION_OUTPUT(plot), "FILE",
     "the share of good outcomes over what varies, .svg or .png (needs gnuplot)"},
    {"threads", OPTION_COUNT(threads), "N", "of each process; default: the processors it may use",
     1, 1024},
    {"quiet", OPTION_FLAG(quiet), NULL, "no progress, no tables"},
    {0}};

static int run(int argc, char **argv);

const struct subcommand sub_sweep = {
    .name = "sweep",
    .summary = "many runs over grids of values, on all processors and machines",
    .synopsis = "SPEC.ini [options]",
    .about =
        "Runs robustness trials, start states or explain on made-up logs for every combination of\n"
        "the values in a spec file (docs/sweep.md), prints tables and writes a row a run as CSV: "
        "the\n"
        "same file whatever the number of threads or processes. A sweep that was stopped or "
        "killed\n"
        "goes on where it was when the same command is given again.",
    .options = option_rows,
    .notes = "Over several processes and machines: mpirun -n 8 mechkit sweep SPEC.ini [options]",
    .argument = "spec file",
    .least = 1,
    .most = 1,
    .run = run,
};

/* DIR/NAME.ini gives NAME.csv where one stands. */
static int name_result(struct options *o)
{
    const char *slash = strrchr(o->spec, '/'), *name = slash ? slash + 1 : o->spec;
    const char *dot = strrchr(name, '.');
    int length = dot && dot > name ? (int)(dot - name) : (int)strlen(name);
    if (o->out)
        return EXIT_OK;
    if (snprintf(o->out_made, sizeof o->out_made, "%.*s.csv", length, name) >=
        (int)sizeof o->out_made)
        return report_usage("sweep", "%s: too long a name", o->spec);
    o->out = o->out_made;
    return strcmp(o->out, name) == 0 ? report_usage("sweep", "--out is missing") : EXIT_OK;
}

static int parse(int argc, char **argv, struct options *o)
{
    struct arguments spec;
    int code = options_parse(&sub_sweep, argc, argv, o, &spec);
    if (code != EXIT_OK)
        return code;
    const char *end = o->plot ? strrchr(o->plot, '.') : NULL;
    if (o->plot && !(end && (strcmp(end, ".svg") == 0 || strcmp(end, ".png") == 0)))
        return report_usage("sweep", "--plot %s: expected a name that ends in .svg or .png",
                            o->plot);
    o->spec = spec.text[0];
    return name_result(o);
}

/* Processors that this process may use, its share of them where several run on the machine. */
static int usable_processors(const struct sweep_ranks *r)
{
    cpu_set_t set;
    int mine = sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : 1;
    int share = (int)sysconf(_SC_NPROCESSORS_ONLN) / r->local;
    share = share > 1 ? share : 1;
    return mine < share ? mine : share;
}

/* --- the work ------------------------------------------------------------------------------- */

struct progress {
    struct sweep_journal *journal;
    struct timespec begin, told;
    size_t before; /* done when this began */
    bool show;
};

static double seconds_since(const struct timespec *then)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)(now.tv_sec - then->tv_sec) + 1e-9 * (double)(now.tv_nsec - then->tv_nsec);
}

static void tell(struct progress *p)
{
    const struct sweep_journal *j = p->journal;
    double rate = (double)(j->done - p->before) / seconds_since(&p->begin);
    if (!p->show || seconds_since(&p->told) < PROGRESS_S)
        return;
    clock_gettime(CLOCK_MONOTONIC, &p->told);
    fprintf(stderr, "\r%zu of %zu runs, %.3g runs/s, %.0f s to go   ", j->done, j->sweep->total,
            rate, (double)(j->sweep->total - j->done) / rate);
}

static enum mk_status take_result(void *user, size_t index, int outcome, const char *text,
                                  struct mk_error *err)
{
    struct progress *p = user;
    enum mk_status st = sweep_journal_add(p->journal, index, outcome, text, err);
    tell(p);
    return st;
}

static enum mk_status work_off(struct progress *p, struct sweep_ranks *ranks, const size_t *todo,
                               size_t count, int threads, struct mk_error *err)
{
    struct sweep_queue q;
    struct sweep_team team;
    sweep_queue_init(&q, p->journal->sweep, todo, count, take_result, p);
    q.cancel = &stopped;
    enum mk_status st = sweep_team_start(&team, &q, threads, err);
    if (st != MK_OK)
        sweep_queue_fail(&q, st, err->message);
    sweep_ranks_serve(ranks, &q);
    if (st == MK_OK)
        sweep_team_join(&team);
    st = q.status;
    if (st != MK_OK)
        *err = q.err;
    else if (stopped)
        st = mk_error_set(err, MK_ERR_INTR,
                          "stopped: %zu of %zu runs are done and kept in %s; the same command goes "
                          "on from there",
                          p->journal->done, p->journal->sweep->total, p->journal->path);
    sweep_queue_destroy(&q);
    return st;
}

static enum mk_status run_rest(struct progress *p, struct sweep_ranks *ranks, int threads,
                               struct mk_error *err)
{
    struct sweep_journal *j = p->journal;
    size_t n = 0, *todo = malloc(j->sweep->total * sizeof *todo);
    if (!todo)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for %zu runs", j->sweep->total);
    for (size_t i = 0; i < j->sweep->total; i++)
        if (!j->result[i].text)
            todo[n++] = i;
    enum mk_status st = work_off(p, ranks, todo, n, threads, err);
    free(todo);
    if (p->show)
        fputc('\n', stderr);
    return st;
}

static void sum_up(const struct options *o, const struct progress *p,
                   const struct sweep_ranks *ranks, int threads)
{
    const struct sweep_journal *j = p->journal;
    double seconds = seconds_since(&p->begin);
    size_t ran = j->done - p->before;
    if (o->quiet)
        return;
    sweep_report(j);
    printf("%s: %zu runs", show_name(o->out), j->done);
    if (p->before > 0)
        printf(", %zu of them from before", p->before);
    printf("; %.1f s, %.4g runs/s, %d thread%s", seconds, (double)ran / seconds, threads,
           threads > 1 ? "s" : "");
    if (ranks->count > 1)
        printf(" in each of %d processes", ranks->count);
    putchar('\n');
}

/* What would be found wrong only when all is done. */
static enum mk_status check_outputs(const struct options *o, const struct sweep *s,
                                    struct mk_error *err)
{
    for (int kind = 0; kind < MK_PLANT_COUNT; kind++)
        for (int plot = 0; plot < 2; plot++)
            if (same_file(plot ? o->plot : o->out, s->model_path[kind]))
                return mk_error_set(err, MK_ERR_USAGE, "--%s %s: that is a model of the sweep",
                                    plot ? "plot" : "out", plot ? o->plot : o->out);
    enum mk_status st = mk_out_file_check(o->out, err);
    if (st == MK_OK)
        st = mk_out_file_check(o->plot, err);
    if (st == MK_OK && o->plot)
        st = gnuplot_check(err);
    return st;
}

/* Rank 0, or the only one. */
static int lead(const struct options *o, struct sweep *s, struct sweep_ranks *ranks, int threads,
                enum mk_status st, struct mk_error *err)
{
    const bool spec_is_good = st == MK_OK;
    struct sweep_journal j = {.fd = -1};
    struct progress p = {.journal = &j, .show = !o->quiet && isatty(STDERR_FILENO)};
    if (st == MK_OK)
        st = check_outputs(o, s, err);
    if (st == MK_OK)
        st = sweep_journal_open(&j, s, o->out, err);
    if (!sweep_ranks_agree(ranks, st == MK_OK, s->fingerprint, threads) && st == MK_OK)
        st = mk_error_set(err, MK_ERR_STATE,
                          "the other processes cannot take part: they need the same program, spec "
                          "and models under the same names");
    p.before = j.done;
    clock_gettime(CLOCK_MONOTONIC, &p.begin);
    if (st == MK_OK)
        st = run_rest(&p, ranks, threads, err);
    if (st == MK_OK)
        st = sweep_write_csv(&j, o->out, err);
    const bool finished = st == MK_OK;
    if (finished)
        sum_up(o, &p, ranks, threads);
    if (finished && o->plot)
        st = sweep_plot(&j, o->plot, err);
    sweep_journal_close(&j, finished);
    if (st == MK_OK)
        return EXIT_OK;
    /* A journal that is damaged is bad input; one that cannot be written is not. */
    return spec_is_good && st != MK_ERR_PARSE ? report_output_error(err) : report_error(err);
}

static int run(int argc, char **argv)
{
    struct options o = {0};
    struct sweep_ranks ranks;
    struct mk_error err = MK_ERROR_INIT;
    int code = parse(argc, argv, &o);
    if (code != EXIT_OK)
        return code;
    if (sweep_ranks_open(&ranks, &err) != MK_OK)
        return report_error(&err);
    struct sweep *s = calloc(1, sizeof *s);
    if (!s) {
        mk_error_set(&err, MK_ERR_NOMEM, "no memory for a sweep");
        return report_error(&err);
    }
    catch_signals();
    enum mk_status st = sweep_read(o.spec, s, &err);
    int threads = o.threads ? o.threads : usable_processors(&ranks);
    if (ranks.rank == 0)
        code = lead(&o, s, &ranks, threads, st, &err);
    else if (sweep_ranks_agree(&ranks, st == MK_OK, s->fingerprint, threads))
        code = sweep_ranks_help(&ranks, s, threads, &err) == MK_OK ? EXIT_OK : EXIT_RUN_FAILED;
    else
        code = EXIT_RUN_FAILED;
    sweep_free(s);
    free(s);
    sweep_ranks_close(&ranks);
    return code;
}
