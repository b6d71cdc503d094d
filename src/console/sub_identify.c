/* mechkit identify: parameters of a model from logs. */
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "console/sub.h"
#include "mechkit/ident.h"
#include "mechkit/json.h"

#define MAX_FILES 64

struct options {
    const char *model, *out, *json;
    const char *fixed[MK_MAX_FIT_PARAMETERS], *validate[MAX_FILES], *input[MAX_FILES];
    int fixed_count;
    size_t validate_count, input_count;
    struct mk_ident_options ident;
};

static int parse(int argc, char **argv, struct options *o)
{
    static const struct option names[] = {{"model", required_argument, NULL, 'm'},
                                          {"out", required_argument, NULL, 'o'},
                                          {"method", required_argument, NULL, 'M'},
                                          {"json", required_argument, NULL, 'j'},
                                          {"fix", required_argument, NULL, 'f'},
                                          {"cutoff", required_argument, NULL, 'c'},
                                          {"validate", required_argument, NULL, 'v'},
                                          {"threads", required_argument, NULL, 't'},
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
        case 'M':
            if (!mk_ident_method_by_name(optarg))
                return report_usage("identify", "there is no method '%s'", optarg);
            o->ident.method = optarg;
            break;
        case 'j':
            o->json = optarg;
            break;
        case 'f':
            if (o->fixed_count == MK_MAX_FIT_PARAMETERS)
                return report_usage("identify", "too many --fix");
            o->fixed[o->fixed_count++] = optarg;
            break;
        case 'c':
            o->ident.cutoff_hz = strtod(optarg, &end);
            if (*end || !(o->ident.cutoff_hz > 0.0) || !isfinite(o->ident.cutoff_hz))
                return report_usage("identify", "--cutoff %s: expected Hz", optarg);
            break;
        case 'v':
            if (o->validate_count == MAX_FILES)
                return report_usage("identify", "at most %d validation logs", MAX_FILES);
            o->validate[o->validate_count++] = optarg;
            break;
        case 't':
            o->ident.threads = (int)strtol(optarg, &end, 10);
            if (*end || o->ident.threads < 1 || o->ident.threads > 256)
                return report_usage("identify", "--threads %s: expected 1 .. 256", optarg);
            break;
        case ':':
            return report_usage("identify", "%s needs a value", argv[optind - 1]);
        default:
            return report_usage("identify", "unknown option '%s'", argv[optind - 1]);
        }
    }
    for (; optind < argc; optind++) {
        if (o->input_count == MAX_FILES)
            return report_usage("identify", "at most %d logs", MAX_FILES);
        o->input[o->input_count++] = argv[optind];
    }
    if (!o->model)
        return report_usage("identify", "--model is missing");
    if (!o->out && !o->json)
        return report_usage("identify", "--out or --json is missing");
    return o->input_count ? EXIT_OK : report_usage("identify", "a log is missing");
}

/* Parameters named by --fix; the usage error names one that is not there. */
static int fix_parameters(struct options *o, const struct mk_model *model)
{
    for (int f = 0; f < o->fixed_count; f++) {
        bool found = false;
        for (int i = 0; i < mk_model_parameter_count(model); i++) {
            char name[64];
            mk_model_parameter_info(model, i, name, sizeof name);
            if (strcmp(name, o->fixed[f]) == 0)
                o->ident.fixed[i] = found = true;
        }
        if (!found)
            return report_usage("identify", "--fix %s: the model has no such parameter",
                                o->fixed[f]);
    }
    return EXIT_OK;
}

static bool show_progress(void *context, double done, const char *what)
{
    static const char wheel[] = "|/-\\";
    int *turn = context;
    (void)done;
    fprintf(stderr, "\r%c %-20s", wheel[++*turn & 3], what);
    return true;
}

static void print_result(const struct mk_ident_result *r)
{
    printf("%s: %zu readings, %d iterations, %.2f s\n", r->method, r->rows, r->iterations,
           r->seconds);
    printf("  %-28s %14s %12s %8s   %s\n", "parameter", "value", "std error", "%", "given");
    for (int i = 0; i < r->parameter_count; i++) {
        const struct mk_ident_parameter *p = &r->parameter[i];
        printf("  %-28s %14.8g ", p->name, p->value);
        if (p->fixed)
            printf("%12s %8s", "held", "");
        else
            printf("%12.3g %8.3f", p->std_error, 100.0 * p->std_error / fabs(p->value));
        printf("   %.6g\n", p->initial);
    }
    for (int j = 0; j < mk_model_joints(&r->model); j++)
        printf("  noise of q%d: %.3g rad\n", j + 1, r->noise[j]);
    printf("  condition number %.3g, scaled %.3g\n", r->condition_number,
           r->condition_number_scaled);
    for (int i = 0; i < r->warning_count; i++)
        printf("  warning: %s\n", r->warning[i]);
}

/* Free runs of the given and the fitted model over a log. */
static enum mk_status compare(const struct mk_model *given, const struct mk_model *fitted,
                              const char *path, const struct mk_log *log, cJSON *list,
                              struct mk_error *err)
{
    struct mk_predict_figures f[2];
    const struct mk_model *models[2] = {given, fitted};
    struct mk_predict_options o = {.window_s = 1.0};
    size_t n = (size_t)mk_model_joints(given);
    for (int i = 0; i < 2; i++) {
        struct mk_log *made = NULL;
        enum mk_status st = mk_predict(models[i], log, &o, &made, &f[i], NULL, err);
        mk_log_free(made);
        if (st != MK_OK)
            return st;
    }
    printf("  %s, free runs of 1 s, nrmse:", path);
    for (size_t j = 0; j < n; j++)
        printf("  q%zu %.4g -> %.4g", j + 1, f[0].nrmse[j], f[1].nrmse[j]);
    printf("\n");
    cJSON *o1 = cJSON_CreateObject();
    cJSON_AddStringToObject(o1, "file", path);
    cJSON_AddItemToObject(o1, "nrmse_given", mk_json_numbers(f[0].nrmse, n));
    cJSON_AddItemToObject(o1, "nrmse_fitted", mk_json_numbers(f[1].nrmse, n));
    cJSON_AddItemToArray(list, o1);
    return MK_OK;
}

static cJSON *result_json(const struct mk_ident_result *r)
{
    cJSON *o = cJSON_CreateObject(), *all = cJSON_AddObjectToObject(o, "parameters");
    for (int i = 0; i < r->parameter_count; i++) {
        const struct mk_ident_parameter *p = &r->parameter[i];
        cJSON *one = cJSON_AddObjectToObject(all, p->name);
        cJSON_AddItemToObject(one, "value", mk_json_number(p->value));
        cJSON_AddItemToObject(one, "stderr", mk_json_number(p->std_error));
        cJSON_AddItemToObject(one, "initial", mk_json_number(p->initial));
        cJSON_AddItemToObject(one, "crb", mk_json_number(p->crb));
        cJSON_AddBoolToObject(one, "fixed", p->fixed);
        cJSON_AddStringToObject(one, "unit", p->unit);
    }
    cJSON_AddStringToObject(o, "method", r->method);
    cJSON_AddItemToObject(o, "condition_number", mk_json_number(r->condition_number));
    cJSON_AddItemToObject(o, "condition_number_scaled", mk_json_number(r->condition_number_scaled));
    cJSON_AddItemToObject(o, "cost", mk_json_number(r->cost));
    cJSON_AddItemToObject(o, "noise",
                          mk_json_numbers(r->noise, (size_t)mk_model_joints(&r->model)));
    cJSON *rows = cJSON_AddArrayToObject(o, "covariance");
    size_t n = (size_t)r->parameter_count;
    for (size_t i = 0; i < n; i++)
        cJSON_AddItemToArray(rows, mk_json_numbers(r->covariance + i * n, n));
    cJSON *warnings = cJSON_AddArrayToObject(o, "warnings");
    for (int i = 0; i < r->warning_count; i++)
        cJSON_AddItemToArray(warnings, cJSON_CreateString(r->warning[i]));
    cJSON_AddItemToObject(o, "rows", mk_json_number((double)r->rows));
    cJSON_AddItemToObject(o, "seconds", mk_json_number(r->seconds));
    return o;
}

static enum mk_status finish(const struct options *o, const struct mk_model *given,
                             const struct mk_ident_result *r, struct mk_log *const *logs,
                             struct mk_log *const *validation, struct mk_error *err)
{
    char comment[200];
    enum mk_status st = MK_OK;
    cJSON *json = result_json(r);
    snprintf(comment, sizeof comment, "fitted by mechkit identify, method %s, %zu readings",
             r->method, r->rows);
    print_result(r);
    cJSON *data = cJSON_AddArrayToObject(json, "data");
    for (size_t i = 0; i < o->input_count && st == MK_OK; i++)
        st = compare(given, &r->model, o->input[i], logs[i], data, err);
    cJSON *check = cJSON_AddArrayToObject(json, "validation");
    for (size_t i = 0; i < o->validate_count && st == MK_OK; i++)
        st = compare(given, &r->model, o->validate[i], validation[i], check, err);
    if (st == MK_OK && o->out)
        st = mk_model_write(o->out, &r->model, comment, err);
    if (st == MK_OK && o->json)
        st = mk_json_write(o->json, json, err);
    cJSON_Delete(json);
    return st;
}

int sub_identify(int argc, char **argv)
{
    struct options o = {0};
    int rc = parse(argc, argv, &o), turn = 0;
    if (rc != EXIT_OK)
        return rc;
    struct mk_error err = MK_ERROR_INIT;
    struct mk_model model;
    struct mk_log *logs[MAX_FILES] = {NULL}, *validation[MAX_FILES] = {NULL};
    static struct mk_ident_result result;
    enum mk_status st = mk_model_read(o.model, &model, &err);
    if (st == MK_OK && (rc = fix_parameters(&o, &model)) != EXIT_OK)
        return rc;
    for (size_t i = 0; i < o.input_count && st == MK_OK; i++)
        st = mk_log_read(o.input[i], &logs[i], &err);
    for (size_t i = 0; i < o.validate_count && st == MK_OK; i++)
        st = mk_log_read(o.validate[i], &validation[i], &err);
    if (isatty(STDERR_FILENO)) {
        o.ident.progress = show_progress;
        o.ident.progress_context = &turn;
    }
    if (st == MK_OK)
        st = mk_identify(&model, (const struct mk_log *const *)logs, o.input_count, &o.ident,
                         &result, &err);
    if (turn > 0)
        fprintf(stderr, "\r%30s\r", "");
    if (st == MK_OK)
        st = finish(&o, &model, &result, logs, validation, &err);
    for (size_t i = 0; i < MAX_FILES; i++) {
        mk_log_free(logs[i]);
        mk_log_free(validation[i]);
    }
    return st == MK_OK ? EXIT_OK : report_error(&err);
}
