/* mechkit explain: what the simulation gets wrong, and why. */
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "console/explanation.h"
#include "console/sub.h"
#include "mechkit/explain.h"

#define MAX_FILES 64

struct options {
    const char *model, *out;
    const char *holdout[MAX_FILES], *input[MAX_FILES];
    size_t holdout_count, input_count;
    struct mk_explain_options explain;
};

static int parse(int argc, char **argv, struct options *o)
{
    static const struct option names[] = {
        {"model", required_argument, NULL, 'm'},   {"out", required_argument, NULL, 'o'},
        {"holdout", required_argument, NULL, 'h'}, {"window", required_argument, NULL, 'w'},
        {"threads", required_argument, NULL, 't'}, {"next", no_argument, NULL, 'n'},
        {"seconds", required_argument, NULL, 's'}, {NULL, 0, NULL, 0}};
    int c;
    char *end;
    opterr = 0;
    optind = 1;
    while ((c = getopt_long(argc, argv, ":", names, NULL)) != -1) {
        switch (c) {
        case 'm':
            o->model = optarg;
            break;
        case 'o':
            o->out = optarg;
            break;
        case 'h':
            if (o->holdout_count == MAX_FILES)
                return report_usage("explain", "at most %d hold-out logs", MAX_FILES);
            o->holdout[o->holdout_count++] = optarg;
            break;
        case 'w':
            o->explain.window_s = strtod(optarg, &end);
            if (*end || !(o->explain.window_s > 0.0) || !isfinite(o->explain.window_s))
                return report_usage("explain", "--window %s: expected seconds", optarg);
            break;
        case 't':
            o->explain.threads = (int)strtol(optarg, &end, 10);
            if (*end || o->explain.threads < 1 || o->explain.threads > 256)
                return report_usage("explain", "--threads %s: expected 1 .. 256", optarg);
            break;
        case 'n':
            o->explain.next = true;
            break;
        case 's':
            o->explain.most_s = strcmp(optarg, "all") == 0 ? HUGE_VAL : strtod(optarg, &end);
            if (!(o->explain.most_s > 0.0) || (o->explain.most_s < HUGE_VAL && *end))
                return report_usage("explain", "--seconds %s: expected seconds or 'all'", optarg);
            break;
        case ':':
            return report_usage("explain", "%s needs a value", argv[optind - 1]);
        default:
            return report_usage("explain", "unknown option '%s'", argv[optind - 1]);
        }
    }
    for (; optind < argc; optind++) {
        if (o->input_count == MAX_FILES)
            return report_usage("explain", "at most %d logs", MAX_FILES);
        o->input[o->input_count++] = argv[optind];
    }
    if (!o->model)
        return report_usage("explain", "--model is missing");
    if (!o->out)
        return report_usage("explain", "--out DIR is missing");
    if (o->input_count == 0)
        return report_usage("explain", "a log is missing");
    return EXIT_OK;
}

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

static enum mk_status write_reports(const struct options *o, const struct mk_explanation *e,
                                    const struct mk_log *shown, struct mk_error *err)
{
    bool given = o->holdout_count > 0;
    return explanation_write(o->out, o->model, e,
                             given ? o->holdout : &o->input[o->input_count - 1],
                             given ? o->holdout_count : 1, shown, err);
}

int sub_explain(int argc, char **argv)
{
    struct options o = {0};
    int rc = parse(argc, argv, &o);
    if (rc != EXIT_OK)
        return rc;
    struct mk_error err = MK_ERROR_INIT;
    struct mk_model model;
    struct mk_log *logs[MAX_FILES] = {NULL}, *holdouts[MAX_FILES] = {NULL};
    static struct mk_explanation e;
    int percent = -1;
    if (isatty(STDERR_FILENO)) {
        o.explain.progress = show_progress;
        o.explain.progress_context = &percent;
    }
    enum mk_status st = mk_model_read(o.model, &model, &err);
    if (st == MK_OK)
        st = read_all(o.input, o.input_count, logs, &err);
    if (st == MK_OK)
        st = read_all(o.holdout, o.holdout_count, holdouts, &err);
    if (st == MK_OK)
        st = mk_explain(&model, (const struct mk_log *const *)logs, o.input_count,
                        (const struct mk_log *const *)holdouts, o.holdout_count, &o.explain, &e,
                        &err);
    if (percent >= 0)
        fprintf(stderr, "\r%30s\r", "");
    if (st == MK_OK)
        st = write_reports(&o, &e, o.holdout_count ? holdouts[0] : logs[o.input_count - 1], &err);
    if (st == MK_OK)
        explanation_print(stdout, &e);
    for (size_t i = 0; i < MAX_FILES; i++) {
        mk_log_free(logs[i]);
        mk_log_free(holdouts[i]);
    }
    return st == MK_OK ? EXIT_OK : report_error(&err);
}
