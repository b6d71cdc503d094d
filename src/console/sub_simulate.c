/* mechkit simulate: free-run prediction of a log. */
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "console/sub.h"
#include "mechkit/json.h"
#include "mechkit/number.h"
#include "mechkit/sim.h"
#include "sim/predict.h"

struct options {
    const char *model, *input, *out, *json;
    struct mk_predict_options predict;
    bool states;
};

static int parse(int argc, char **argv, struct options *o)
{
    static const struct option names[] = {
        {"model", required_argument, NULL, 'm'},  {"input", required_argument, NULL, 'i'},
        {"out", required_argument, NULL, 'o'},    {"window", required_argument, NULL, 'w'},
        {"solver", required_argument, NULL, 's'}, {"json", required_argument, NULL, 'j'},
        {"states", no_argument, NULL, 'x'},       {NULL, 0, NULL, 0}};
    int c;
    opterr = 0;
    optind = 1;
    while ((c = getopt_long(argc, argv, ":", names, NULL)) != -1) {
        switch (c) {
        case 'm':
            o->model = optarg;
            break;
        case 'i':
            o->input = optarg;
            break;
        case 'o':
            o->out = optarg;
            break;
        case 'j':
            o->json = optarg;
            break;
        case 'w':
            if (!mk_parse_double_z(optarg, &o->predict.window_s) || !(o->predict.window_s > 0.0) ||
                !isfinite(o->predict.window_s))
                return report_usage("simulate", "--window %s: expected seconds", optarg);
            break;
        case 'x':
            o->states = true;
            break;
        case 's':
            o->predict.sim.solver = mk_solver_by_name(optarg);
            if (o->predict.sim.solver == MK_SOLVER_COUNT)
                return report_usage("simulate", "there is no solver '%s'", optarg);
            break;
        case ':':
            return report_usage("simulate", "%s needs a value", argv[optind - 1]);
        default:
            return report_usage("simulate", "unknown option '%s'", argv[optind - 1]);
        }
    }
    if (optind < argc)
        return report_usage("simulate", "'%s' is too much", argv[optind]);
    if (!o->model || !o->input)
        return report_usage("simulate", "--%s is missing", o->model ? "input" : "model");
    if (!o->out && !o->json)
        return report_usage("simulate", "--out or --json is missing");
    return EXIT_OK;
}

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static enum mk_status write_figures(const struct options *o, const struct mk_model *model,
                                    const struct mk_predict_figures *f, size_t failed,
                                    double seconds, struct mk_error *err)
{
    cJSON *root = cJSON_CreateObject();
    size_t n = (size_t)mk_model_joints(model);
    cJSON_AddStringToObject(root, "model", o->model);
    cJSON_AddStringToObject(root, "input", o->input);
    cJSON_AddStringToObject(root, "rig", mk_plant(model->plant)->name);
    cJSON_AddStringToObject(root, "solver", mk_solver_name(o->predict.sim.solver));
    cJSON_AddItemToObject(root, "window_s",
                          o->predict.window_s > 0.0 ? mk_json_number(o->predict.window_s)
                                                    : cJSON_CreateNull());
    cJSON_AddItemToObject(root, "windows", mk_json_number((double)f->windows));
    cJSON_AddItemToObject(root, "failed", mk_json_number((double)failed));
    cJSON_AddItemToObject(root, "rows", mk_json_number((double)f->rows));
    cJSON_AddItemToObject(root, "rms", mk_json_numbers(f->rms, n));
    cJSON_AddItemToObject(root, "nrmse", mk_json_numbers(f->nrmse, n));
    cJSON_AddItemToObject(root, "seconds", mk_json_number(seconds));
    enum mk_status st = mk_json_write(o->json, root, err);
    cJSON_Delete(root);
    return st;
}

static void print_figures(const struct options *o, const struct mk_model *model,
                          const struct mk_predict_figures *f, size_t failed)
{
    printf("%s: %zu rows, %zu window%s\n", o->input, f->rows, f->windows,
           f->windows == 1 ? "" : "s");
    for (int j = 0; j < mk_model_joints(model); j++)
        printf("  q%d: rms error %.4g rad, %.4g of its standard deviation\n", j + 1, f->rms[j],
               f->nrmse[j]);
    if (failed)
        printf("  %zu window%s ended early: the model leaves every bound\n", failed,
               failed == 1 ? "" : "s");
}

int sub_simulate(int argc, char **argv)
{
    struct options o = {0};
    int code = parse(argc, argv, &o);
    if (code != EXIT_OK)
        return code;
    struct mk_model model;
    struct mk_log *log = NULL, *prediction = NULL;
    struct mk_predict_figures figures;
    struct mk_error err = MK_ERROR_INIT;
    size_t failed = 0;
    enum mk_status st = mk_model_read(o.model, &model, &err);
    if (st == MK_OK)
        st = mk_log_read(o.input, &log, &err);
    if (st == MK_OK && log->truncated)
        fprintf(stderr, "mechkit: %s: the last line is incomplete and was left out\n", o.input);
    double start = now();
    if (st == MK_OK)
        st = (o.states ? mk_predict_states : mk_predict)(&model, log, &o.predict, &prediction,
                                                         &figures, &failed, &err);
    double seconds = now() - start;
    if (st == MK_OK && o.out)
        st = mk_log_write(o.out, prediction, &err);
    if (st == MK_OK && o.json)
        st = write_figures(&o, &model, &figures, failed, seconds, &err);
    if (st == MK_OK && !(o.json && strcmp(o.json, "-") == 0))
        print_figures(&o, &model, &figures, failed);
    mk_log_free(prediction);
    mk_log_free(log);
    return st == MK_OK ? EXIT_OK : report_error(&err);
}
