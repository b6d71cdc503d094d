/* mechkit measure: simple experiments. */
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "console/sub.h"
#include "mechkit/json.h"
#include "mechkit/measure.h"
#include "mechkit/number.h"

#define MAX_FILES 64

struct options {
    const char *kind, *model, *out, *json;
    const char *input[MAX_FILES];
    size_t input_count;
    struct mk_measure_options measure;
};

static int parse(int argc, char **argv, struct options *o)
{
    static const struct option names[] = {{"model", required_argument, NULL, 'm'},
                                          {"out", required_argument, NULL, 'o'},
                                          {"json", required_argument, NULL, 'j'},
                                          {"known", required_argument, NULL, 'k'},
                                          {NULL, 0, NULL, 0}};
    int c;
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
        case 'j':
            o->json = optarg;
            break;
        case 'k':
            if (!mk_parse_double_z(optarg, &o->measure.known) || !(o->measure.known > 0.0) ||
                !isfinite(o->measure.known))
                return report_usage("measure", "--known %s: expected a value above 0", optarg);
            break;
        case ':':
            return report_usage("measure", "%s needs a value", argv[optind - 1]);
        default:
            return report_usage("measure", "unknown option '%s'", argv[optind - 1]);
        }
    }
    if (optind < argc)
        o->kind = argv[optind++];
    if (!o->kind || !mk_measure_by_name(o->kind))
        return report_usage("measure", "expected friction, inertia, swing or torque%s%s",
                            o->kind ? ", not " : "", o->kind ? o->kind : "");
    for (; optind < argc; optind++) {
        if (o->input_count == MAX_FILES)
            return report_usage("measure", "at most %d logs", MAX_FILES);
        o->input[o->input_count++] = argv[optind];
    }
    if (!o->model)
        return report_usage("measure", "--model is missing");
    return o->input_count ? EXIT_OK : report_usage("measure", "a log is missing");
}

static void print_measurement(const struct mk_measurement *m)
{
    printf("%s, from %d pieces of the logs\n", m->kind->help, m->run_count);
    printf("  %-28s %14s %12s %8s   %s\n", "", "value", "std error", "%", "given");
    for (int i = 0; i < m->quantity_count; i++) {
        const struct mk_quantity *q = &m->quantity[i];
        printf("  %-28s %14.8g %12.3g %8.3f   ", q->name, q->value, q->std_error,
               100.0 * q->std_error / fabs(q->value));
        if (isnan(q->given))
            printf("%-12s %s\n", "", q->unit);
        else
            printf("%-12.6g %s\n", q->given, q->unit);
    }
    for (int i = 0; i < m->warning_count; i++)
        printf("  note: %s\n", m->warning[i]);
}

static void add_runs(cJSON *root, const struct options *o, const struct mk_measurement *m)
{
    cJSON *runs = cJSON_AddArrayToObject(root, "runs");
    for (int i = 0; i < m->run_count; i++) {
        const struct mk_measure_run *r = &m->run[i];
        cJSON *one = cJSON_CreateObject();
        cJSON_AddStringToObject(one, "file", o->input[r->log]);
        cJSON_AddItemToObject(one, "begin", mk_json_number(r->begin));
        cJSON_AddItemToObject(one, "end", mk_json_number(r->end));
        cJSON_AddItemToObject(one, m->kind->x_name, mk_json_number(r->x));
        cJSON_AddItemToObject(one, m->kind->y_name, mk_json_number(r->y));
        cJSON_AddItemToObject(one, "misfit", mk_json_number(r->misfit));
        cJSON_AddItemToArray(runs, one);
    }
}

static enum mk_status write_json(const struct options *o, const struct mk_measurement *m,
                                 struct mk_error *err)
{
    cJSON *root = cJSON_CreateObject();
    cJSON_AddStringToObject(root, "measurement", m->kind->name);
    cJSON_AddStringToObject(root, "rig", mk_plant(m->model.plant)->name);
    cJSON *all = cJSON_AddObjectToObject(root, "quantities");
    for (int i = 0; i < m->quantity_count; i++) {
        const struct mk_quantity *q = &m->quantity[i];
        cJSON *one = cJSON_AddObjectToObject(all, q->name);
        cJSON_AddItemToObject(one, "value", mk_json_number(q->value));
        cJSON_AddItemToObject(one, "stderr", mk_json_number(q->std_error));
        cJSON_AddItemToObject(one, "given", mk_json_number(q->given));
        cJSON_AddStringToObject(one, "unit", q->unit);
    }
    add_runs(root, o, m);
    cJSON *notes = cJSON_AddArrayToObject(root, "notes");
    for (int i = 0; i < m->warning_count; i++)
        cJSON_AddItemToArray(notes, cJSON_CreateString(m->warning[i]));
    enum mk_status st = mk_json_write(o->json, root, err);
    cJSON_Delete(root);
    return st;
}

int sub_measure(int argc, char **argv)
{
    struct options o = {0};
    int code = parse(argc, argv, &o);
    if (code != EXIT_OK)
        return code;
    static struct mk_measurement result;
    struct mk_error err = MK_ERROR_INIT;
    struct mk_model model;
    struct mk_log *logs[MAX_FILES] = {NULL};
    enum mk_status st = mk_model_read(o.model, &model, &err);
    for (size_t i = 0; i < o.input_count && st == MK_OK; i++)
        st = mk_log_read(o.input[i], &logs[i], &err);
    if (st == MK_OK)
        st = mk_measure(o.kind, &model, (const struct mk_log *const *)logs, o.input_count,
                        &o.measure, &result, &err);
    if (st == MK_OK && o.out) {
        char comment[80];
        snprintf(comment, sizeof comment, "measured by mechkit measure %s", o.kind);
        st = mk_model_write(o.out, &result.model, comment, &err);
    }
    if (st == MK_OK && o.json)
        st = write_json(&o, &result, &err);
    if (st == MK_OK && !(o.json && strcmp(o.json, "-") == 0))
        print_measurement(&result);
    for (size_t i = 0; i < MAX_FILES; i++)
        mk_log_free(logs[i]);
    return st == MK_OK ? EXIT_OK : report_error(&err);
}
