/* mechkit explain: what the simulation gets wrong, and why. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "console/control_gain.h"
#include "console/explanation.h"
#include "console/options.h"
#include "mechkit/explain.h"
#include "mechkit/number.h"

#define MAX_FILES 64

struct options {
    const char *model, *out;
    struct option_texts holdout;
    struct arguments input;
    struct mk_explain_options explain;
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
    {"out", OPTION_TEXT(out), "DIR", "where the reports go; made if missing", .required = true},
    {"holdout", OPTION_TEXTS(holdout), "V.csv", "a log to measure on; may be repeated"},
    {"next", OPTION_FLAG(explain.next), NULL,
     "propose an experiment even where no rival is left open"},
    {"window", OPTION_NUMBER(explain.window_s), "S",
     "length of the free runs that are compared; default 1", .wants = "seconds above 0"},
    {"seconds", OPTION_CALL(explain.most_s), "S|all",
     "most data to search in, from the starts of the logs; default 30", .take = take_seconds,
     .wants = "seconds above 0, or all"},
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
        "report.json and extended.ini to DIR, and next.cmd where an experiment would tell more.",
    .options = option_rows,
    .argument = "log",
    .least = 1,
    .most = MAX_FILES,
    .run = run,
};

static bool show_progress(void *context, double done, const char *what)
{
    int *last = context;
    int percent = (int)(100.0 * done);
    if (percent != *last)
        fprintf(stderr, "\r%3d %% %-24s", percent, what);
    *last = percent;
    return true;
}

static enum mk_status read_all(const char *const *paths, size_t count, struct mk_log **logs,
                               struct mk_error *err)
{
    enum mk_status st = MK_OK;
    for (size_t i = 0; i < count && st == MK_OK; i++) {
        st = mk_log_read(paths[i], &logs[i], err);
        if (st == MK_OK && logs[i]->truncated)
            fprintf(stderr, "mechkit: %s: the last line is incomplete and was left out\n",
                    paths[i]);
    }
    return st;
}

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
                        logs[k]->path, logs[i]->path);
                break;
            }
    for (size_t i = 0; i < count; i++)
        for (size_t h = 0; h < holdout_count; h++)
            if (same_data(logs[i], holdouts[h]))
                fprintf(stderr,
                        "mechkit: %s: the same data as %s, which is learned from: what is measured "
                        "on it says nothing of other runs\n",
                        holdouts[h]->path, logs[i]->path);
}

static enum mk_status write_reports(const struct options *o, const struct mk_explanation *e,
                                    const struct mk_log *shown, struct mk_error *err)
{
    const char *last = o->input.text[o->input.count - 1];
    bool given = o->holdout.count > 0;
    return explanation_write(o->out, o->model, e, given ? o->holdout.text : &last,
                             given ? o->holdout.count : 1, shown, err);
}

static int run(int argc, char **argv)
{
    struct options o = {0};
    int rc = options_parse(&sub_explain, argc, argv, &o, &o.input);
    if (rc != EXIT_OK)
        return rc;
    struct mk_error err = MK_ERROR_INIT;
    struct mk_model model;
    struct mk_log *logs[MAX_FILES] = {NULL}, *holdouts[MAX_FILES] = {NULL};
    static struct mk_explanation e;
    size_t count = (size_t)o.input.count;
    int percent = -1;
    if (isatty(STDERR_FILENO)) {
        o.explain.progress = show_progress;
        o.explain.progress_context = &percent;
    }
    bool made = false;
    enum mk_status st = mk_model_read(o.model, &model, &err);
    if (st == MK_OK)
        st = read_all((const char *const *)o.input.text, count, logs, &err);
    if (st == MK_OK)
        st = read_all(o.holdout.text, o.holdout.count, holdouts, &err);
    if (st == MK_OK)
        st = explanation_make_folder(o.out, &made, &err);
    if (st == MK_OK)
        warn_of_repeats(logs, count, holdouts, o.holdout.count);
    if (st == MK_OK)
        st = mk_explain(&model, (const struct mk_log *const *)logs, count,
                        (const struct mk_log *const *)holdouts, o.holdout.count, &o.explain, &e,
                        &err);
    if (st == MK_OK)
        st = control_gain_measure(&e, &err);
    if (percent >= 0)
        fprintf(stderr, "\r%30s\r", "");
    if (st == MK_OK)
        st = write_reports(&o, &e, o.holdout.count ? holdouts[0] : logs[count - 1], &err);
    if (st == MK_OK)
        explanation_print(stdout, &e);
    if (st != MK_OK && made)
        (void)rmdir(o.out); /* nothing is in it */
    for (size_t i = 0; i < MAX_FILES; i++) {
        mk_log_free(logs[i]);
        mk_log_free(holdouts[i]);
    }
    return st == MK_OK ? EXIT_OK : report_error(&err);
}
