/* mechkit explain: what the simulation gets wrong, and why. */
#include <errno.h>
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

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
    static const struct option names[] = {{"model", required_argument, NULL, 'm'},
                                          {"out", required_argument, NULL, 'o'},
                                          {"holdout", required_argument, NULL, 'h'},
                                          {"window", required_argument, NULL, 'w'},
                                          {"threads", required_argument, NULL, 't'},
                                          {"next", no_argument, NULL, 'n'},
                                          {NULL, 0, NULL, 0}};
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

static void print_cause(const struct mk_cause *c)
{
    printf("  %s", c->effect->name);
    if (c->joint > 0)
        printf(" at joint %d", c->joint);
    printf(": ");
    for (int k = 0; k < c->effect->parameter_count; k++) {
        printf("%s%s %.4g", k ? ", " : "", c->effect->parameter[k].name, c->value[k]);
        if (isfinite(c->std_error[k]))
            printf(" +- %.2g", c->std_error[k]);
        if (c->effect->parameter[k].unit[0])
            printf(" %s", c->effect->parameter[k].unit);
    }
    printf("\n    evidence: BIC %.0f better with it than without; confidence %.3f\n", c->delta_bic,
           c->confidence);
}

static void print_rivals(const struct mk_explanation *e)
{
    int shown = 0;
    for (int i = 0; i < e->rival_count && shown < 4; i++) {
        const struct mk_rival *r = &e->rival[i];
        printf("  %s %s", shown ? "      " : "rivals:", r->effect->name);
        if (r->joint > 0)
            printf(" at joint %d", r->joint);
        printf(r->distinguishable ? ", BIC %.0f worse\n"
                                  : ", BIC %.1f apart: the data cannot tell them apart\n",
               r->delta_bic);
        shown++;
    }
}

static void print_explanation(const struct mk_explanation *e)
{
    static const char *const sentences[] = {
        "The model explains the data.",
        "Only values of parameters were wrong; the structure of the model is right.",
        "Something is missing in the model:",
        "Something is missing in the model that no known effect explains:"};
    printf("%s\n", sentences[e->verdict]);
    if (e->verdict == MK_VERDICT_UNKNOWN)
        printf("  %s\n", e->structure);
    if (e->verdict == MK_VERDICT_EFFECT)
        for (int i = 0; i < e->cause_count; i++)
            print_cause(&e->cause[i]);
    print_rivals(e);
    if (e->verdict >= MK_VERDICT_EFFECT)
        for (int j = 0; j < mk_model_joints(&e->given); j++)
            printf("  missing torque in the equation of joint %d: %.3g rms\n", j + 1,
                   e->missing[j]);
    printf("Free runs of %g s on held-out data, error over standard deviation:\n", e->window_s);
    for (int j = 0; j < mk_model_joints(&e->given); j++)
        printf("  q%d: given %.4g, refitted %.4g, extended %.4g (noise %.2g)\n", j + 1,
               e->before[j], e->refitted[j], e->after[j], e->floor[j]);
    if (e->offered)
        printf("  The extension closes %.1f %% of what refitting leaves.\n", 100.0 * e->closed);
    else if (e->cause_count > 0)
        printf("  It predicts no better than the refitted model there, and is not offered.\n");
    if (e->next.why[0])
        printf("Next: %s\n", e->next.why);
    printf("%.1f s\n", e->seconds);
}

static enum mk_status make_directory(const char *path, struct mk_error *err)
{
    if (mkdir(path, 0777) == 0 || errno == EEXIST)
        return MK_OK;
    return mk_error_errno(err, errno, path, "cannot make the folder");
}

static enum mk_status write_reports(const struct options *o, const struct mk_explanation *e,
                                    const struct mk_log *shown, struct mk_error *err)
{
    char path[4096], comment[256];
    enum mk_status st = make_directory(o->out, err);
    snprintf(comment, sizeof comment, "mechkit explain: verdict %s, from %s",
             mk_verdict_name(e->verdict), o->model);
    snprintf(path, sizeof path, "%s/extended.ini", o->out);
    if (st == MK_OK)
        st = mk_model_write(path, &e->extended, comment, err);
    snprintf(path, sizeof path, "%s/report.json", o->out);
    bool given = o->holdout_count > 0;
    if (st == MK_OK)
        st = mk_explanation_write_json(e, path, given ? o->holdout : &o->input[o->input_count - 1],
                                       given ? o->holdout_count : 1, err);
    snprintf(path, sizeof path, "%s/next.cmd", o->out);
    /* One of an earlier report would not belong to this one. */
    if (st == MK_OK && !e->next.input[0] && unlink(path) != 0 && errno != ENOENT)
        st = mk_error_errno(err, errno, path, "cannot remove the earlier proposal");
    if (st == MK_OK)
        st = mk_explanation_write_next(e, path, "extended.ini", err);
    snprintf(path, sizeof path, "%s/report.html", o->out);
    if (st == MK_OK)
        st = mk_explanation_write_html(e, path, shown, err);
    return st;
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
        print_explanation(&e);
    for (size_t i = 0; i < MAX_FILES; i++) {
        mk_log_free(logs[i]);
        mk_log_free(holdouts[i]);
    }
    return st == MK_OK ? EXIT_OK : report_error(&err);
}
