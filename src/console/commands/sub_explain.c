/* mechkit explain: what the simulation gets wrong, and why. */
#include <limits.h>
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/origin.h"
#include "base/temporary.h"
#include "console/commands/data_checks.h"
#include "console/commands/explanation.h"
#include "console/commands/left_out.h"
#include "console/commands/options.h"
#include "console/commands/progress.h"
#include "console/commands/signals.h"
#include "mechkit/explain.h"
#include "mechkit/number.h"

#define MAX_FILES 64

struct options {
    const char *model, *out;
    struct option_texts holdout;
    struct arguments input;
    struct mk_explain_options explain;
    bool timing;
};

static bool take_seconds(const char *value, void *target)
{
    double *s = target;
    if (strcmp(value, "all") != 0)
        return mk_parse_double_z(value, s) && *s > 0.0 && isfinite(*s);
    *s = HUGE_VAL;
    return true;
}

static const struct option_row option_rows[] = {
    {"model", OPTION_TEXT(model), "M.ini", "the model as it is believed", .required = true},
    {"out", OPTION_OUTPUT(out), "DIR", "where the reports go; made if missing", .required = true},
    {"holdout", OPTION_TEXTS(holdout), "V.csv", "a log to measure on; may be repeated"},
    {"next", OPTION_FLAG(explain.next), NULL,
     "propose an experiment even where no rival is left open"},
    {"window", OPTION_NUMBER(explain.window_s), "S",
     "length of the free runs that are compared, how far ahead the model has to predict; default "
     "1, "
     "better 0.25 for a rig that is held upright",
     .low = 1e-3, .high = 1e6},
    {"seconds", OPTION_CALL(explain.most_s), "S|all",
     "most data to search in, in windows spread over the logs; default 30", .take = take_seconds,
     .wants = "seconds above 0, or all"},
    {"force", OPTION_FLAG(explain.force), NULL,
     "go on in spite of a fatal finding of the data check"},
    LEFT_OUT_OPTIONS(explain.rows, ", and times that scatter"),
    {"timing", OPTION_FLAG(timing), NULL, "print how long each stage took"},
    {"threads", OPTION_COUNT(explain.threads), "N", "default: all processors", 1, 256},
    {0}};

static int run(int argc, char **argv);

const struct subcommand sub_explain = {
    .name = "explain",
    .summary = "find out what the simulation gets wrong, and why",
    .synopsis = "--model M.ini --out DIR [--holdout V.csv]... LOG.csv...",
    .about =
        "Compares the model with the logs, names what it lacks, extends it, and measures the gain "
        "on\n"
        "the hold-out logs (without any, on the end of the last log). Writes report.html,\n"
        "report.json and extended.ini to DIR, and next.cmd where an experiment would tell more.\n"
        "What is doubted of the logs is said first; a flipped sign, swapped columns or a wrong "
        "unit\n"
        "ends the run (exit code 1) unless --force is given.",
    .options = option_rows,
    .argument = "log",
    .least = 1,
    .most = MAX_FILES,
    .run = run,
};

static bool same_column(const struct mk_log *a, const struct mk_log *b, const char *name)
{
    const double *x = mk_log_get(a, name), *y = mk_log_get(b, name);
    return x && y && memcmp(x, y, a->rows * sizeof *x) == 0;
}

static bool same_data(const struct mk_log *a, const struct mk_log *b)
{
    return a->rows == b->rows && same_column(a, b, "t") && same_column(a, b, "q1");
}

/* What was learned from tells nothing about the gain, and the same evidence counts once. */
static void warn_of_repeats(struct mk_log *const *logs, size_t count,
                            struct mk_log *const *holdouts, size_t holdout_count)
{
    for (size_t k = 1; k < count; k++)
        for (size_t i = 0; i < k; i++)
            if (same_data(logs[i], logs[k])) {
                fprintf(stderr, "mechkit: %s: the same data as %s: they count twice\n",
                        show_name(logs[k]->path), show_name(logs[i]->path));
                break;
            }
    for (size_t i = 0; i < count; i++)
        for (size_t h = 0; h < holdout_count; h++)
            if (same_data(logs[i], holdouts[h]))
                fprintf(stderr,
                        "mechkit: %s: the same data as %s, which is learned from: what is measured "
                        "on it says nothing of other runs\n",
                        show_name(holdouts[h]->path), show_name(logs[i]->path));
}

/* --- the folder ----------------------------------------------------------------------------- */

static char *made_folder; /* by us, and nothing is in it yet */

/* Signals that end the program wait until *before is put back. */
static void hold_signals(sigset_t *before)
{
    sigset_t enders;
    const struct ending_signal *s;
    sigemptyset(&enders);
    for (int i = 0; (s = signals_ending(i)) != NULL; i++)
        sigaddset(&enders, s->number);
    pthread_sigmask(SIG_BLOCK, &enders, before);
}

/* The folder is there from now on; a search that is ended leaves none behind. */
static enum mk_status make_folder(const char *path, struct mk_error *err)
{
    bool made = false;
    sigset_t before;
    hold_signals(&before);
    enum mk_status st = explanation_make_folder(path, &made, err);
    made_folder = made ? strdup(path) : NULL;
    mk_temporary_add(made_folder);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return st;
}

static void remove_folder(void)
{
    if (made_folder)
        (void)rmdir(made_folder);
    mk_temporary_done(made_folder);
    made_folder = NULL;
}

/* Takes a moment only, so that a signal can wait for all files to be there. */
static enum mk_status write_reports(const struct options *o, const struct mk_explanation *e,
                                    const struct mk_log *shown, struct mk_error *err)
{
    const char *last = o->input.text[o->input.count - 1];
    bool given = o->holdout.count > 0;
    sigset_t before;
    hold_signals(&before);
    enum mk_status st = explanation_write(o->out, o->model, e, given ? o->holdout.text : &last,
                                          given ? o->holdout.count : 1, shown, err);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return st;
}

/* --- the command ---------------------------------------------------------------------------- */

struct job {
    struct options o;
    struct mk_model model;
    struct mk_log *logs[MAX_FILES], *holdouts[MAX_FILES];
    struct mk_data_check data_check;
    struct mk_explanation e;
    struct mk_origin origin;
    char date[MK_DATE_TEXT], command[4096];
};

static enum mk_status read_input(struct job *j, struct mk_error *err)
{
    enum mk_status st = mk_model_read_open(j->o.model, &j->model, j->o.explain.unknown, err);
    if (st == MK_OK)
        st = log_read_all((const char *const *)j->o.input.text, (size_t)j->o.input.count, j->logs,
                          err);
    if (st == MK_OK)
        st = log_read_all(j->o.holdout.text, j->o.holdout.count, j->holdouts, err);
    return st;
}

/* An exit code. */
static int check_input(struct job *j)
{
    struct mk_error err = MK_ERROR_INIT;
    warn_of_repeats(j->logs, (size_t)j->o.input.count, j->holdouts, j->o.holdout.count);
    enum mk_status st = mk_data_check_logs(&j->model, (const struct mk_log *const *)j->logs,
                                           (size_t)j->o.input.count, MK_DATA_EXPLAIN,
                                           j->o.explain.threads, &j->data_check, &err);
    if (st == MK_OK)
        st = mk_data_check_logs(&j->model, (const struct mk_log *const *)j->holdouts,
                                j->o.holdout.count, MK_DATA_HOLD_OUT, j->o.explain.threads,
                                &j->data_check, &err);
    if (st != MK_OK)
        return report_error(&err);
    j->o.explain.data_check = &j->data_check;
    const int code = data_checks_say(&j->data_check, j->o.explain.force);
    if (code == EXIT_OK && !j->o.explain.rows.keep_all) {
        log_take_even_times(j->logs, (size_t)j->o.input.count, &j->model);
        log_take_even_times(j->holdouts, j->o.holdout.count, &j->model);
    }
    return code;
}

/* Hold-out logs that are left out are none. */
static void drop_unused(struct job *j)
{
    size_t kept = 0;
    for (size_t i = 0; i < j->o.holdout.count; i++) {
        struct mk_log *log = j->holdouts[i];
        const char *name = j->o.holdout.text[i];
        j->holdouts[i] = NULL;
        if (!mk_data_check_uses(&j->model, log, MK_DATA_HOLD_OUT)) {
            mk_log_free(log);
            continue;
        }
        j->holdouts[kept] = log;
        j->o.holdout.text[kept++] = name;
    }
    j->o.holdout.count = kept;
}

static enum mk_status search(struct job *j, struct mk_error *err)
{
    size_t count = (size_t)j->o.input.count;
    struct progress progress;
    j->o.explain.control = true;
    if (progress_begin(&progress)) {
        j->o.explain.progress = progress_show;
        j->o.explain.progress_context = &progress;
    }
    enum mk_status st = mk_explain(&j->model, (const struct mk_log *const *)j->logs, count,
                                   (const struct mk_log *const *)j->holdouts, j->o.holdout.count,
                                   &j->o.explain, &j->e, err);
    progress_end(&progress);
    return st;
}

static void print_timing(const struct mk_explanation *e)
{
    printf("Of that, by stage:\n");
    for (int i = 0; i < e->stage_count; i++)
        printf("  %7.2f s  %s\n", e->stage[i].seconds, e->stage[i].name);
}

/* A second round in the folder of the first one keeps the model that it is given. */
static int check_folder(const struct options *o)
{
    char extended[PATH_MAX];
    snprintf(extended, sizeof extended, "%s/extended.ini", o->out);
    return same_file(o->model, extended)
               ? report_usage("explain", "--out %s: extended.ini there is the model to be read",
                              o->out)
               : EXIT_OK;
}

/* Returns an exit code. */
static int explain(struct job *j)
{
    struct mk_error err = MK_ERROR_INIT;
    if (check_folder(&j->o) != EXIT_OK)
        return EXIT_WRONG_USAGE;
    if (read_input(j, &err) != MK_OK)
        return report_error(&err);
    if (make_folder(j->o.out, &err) != MK_OK)
        return report_output_error(&err);
    const int code = check_input(j);
    if (code != EXIT_OK) {
        remove_folder();
        return code;
    }
    drop_unused(j);
    if (search(j, &err) != MK_OK) {
        remove_folder();
        return report_error(&err);
    }
    j->origin.date = mk_date_text(j->date);
    j->origin.command = j->command;
    j->origin.model = j->o.model;
    j->origin.logs = (const char *const *)j->o.input.text;
    j->origin.log_count = (size_t)j->o.input.count;
    j->e.origin = &j->origin;
    left_out_warn(j->e.left_out, j->e.left_out_count);
    const size_t count = (size_t)j->o.input.count;
    if (left_out_apply(j->logs, count, 0, j->e.left_out, j->e.left_out_count, &err) != MK_OK ||
        left_out_apply(j->holdouts, j->o.holdout.count, count, j->e.left_out, j->e.left_out_count,
                       &err) != MK_OK) {
        remove_folder();
        return report_error(&err);
    }
    const struct mk_log *shown =
        j->o.holdout.count ? j->holdouts[0] : j->logs[j->o.input.count - 1];
    if (write_reports(&j->o, &j->e, shown, &err) != MK_OK) {
        remove_folder();
        return report_output_error(&err);
    }
    explanation_print(stdout, &j->e);
    if (j->o.timing)
        print_timing(&j->e);
    return EXIT_OK;
}

static int run(int argc, char **argv)
{
    static struct job j;
    /* Before options are taken out of their order. */
    int n = snprintf(j.command, sizeof j.command, "mechkit ");
    mk_command_text(j.command + n, sizeof j.command - (size_t)n, argc, (const char *const *)argv);
    int rc = options_parse(&sub_explain, argc, argv, &j.o, &j.o.input);
    if (rc == EXIT_OK)
        rc = explain(&j);
    for (size_t i = 0; i < MAX_FILES; i++) {
        mk_log_free(j.logs[i]);
        mk_log_free(j.holdouts[i]);
    }
    return rc;
}
