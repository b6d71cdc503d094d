/* mechkit measure: simple experiments. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "console/commands/options.h"
#include "mechkit/json.h"
#include "mechkit/measure.h"

#define MAX_FILES 64

struct options {
    const char *kind, *model, *out, *json;
    struct arguments input;
    struct mk_measure_options measure;
};

static const struct option_row option_rows[] = {
    {"model", OPTION_TEXT(model), "M.ini", "the rig, as far as it is known", .required = true},
    {"known", OPTION_NUMBER(measure.known), "X",
     "inertia (kg m^2) or m g l (N m) from scales and drawing: inertia and torque then give the "
     "torque constant"},
    {"out", OPTION_OUTPUT(out), "M.ini", "the model with what was measured", .replaces = "model"},
    {"json", OPTION_FIGURES(json), "FILE",
     "the result with all pieces of the logs; \"-\": standard output"},
    {0}};

static int run(int argc, char **argv);

const struct subcommand sub_measure = {
    .name = "measure",
    .summary = "simple experiments: friction, inertia, free swings, torque constant",
    .synopsis = "KIND --model M.ini [options] LOG.csv...",
    .about =
        "Reads a number or two off the logs of a simple experiment (scripts/measure-*.cmd). KIND:\n"
        "\n"
        "  friction  Coulomb and viscous, both ways: inertia wheel, runs at constant speed\n"
        "  inertia   inertia wheel, runs at constant acceleration\n"
        "  swing     natural frequency and inertia: pendulum or reaction wheel, free swings\n"
        "  torque    m g l in command units: pendulum, slow sweep",
    .options = option_rows,
    .argument = "kind",
    .argument_is_name = true,
    .most = 1 + MAX_FILES,
    .run = run,
};

/* The first argument says what is measured, the others are the logs. */
static int take_kind(struct options *o)
{
    o->kind = o->input.count > 0 ? o->input.text[0] : "";
    if (!mk_measure_by_name(o->kind))
        return report_usage("measure", "expected friction, inertia, swing or torque%s%s",
                            *o->kind ? ", not " : "", o->kind);
    o->input.text++;
    o->input.count--;
    return o->input.count > 0 ? EXIT_OK : report_usage("measure", "which log?");
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
        printf("  note: %s\n", show_name(m->warning[i]));
}

static void add_runs(cJSON *root, const struct options *o, const struct mk_measurement *m)
{
    cJSON *runs = cJSON_AddArrayToObject(root, "runs");
    for (int i = 0; i < m->run_count; i++) {
        const struct mk_measure_run *r = &m->run[i];
        cJSON *one = cJSON_CreateObject();
        cJSON_AddStringToObject(one, "file", o->input.text[r->log]);
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

static enum mk_status write_model(const struct options *o, const struct mk_measurement *m,
                                  struct mk_error *err)
{
    char comment[80];
    snprintf(comment, sizeof comment, "measured by mechkit measure %s", o->kind);
    return mk_model_write(o->out, &m->model, comment, err);
}

static int run(int argc, char **argv)
{
    struct options o = {0};
    int code = options_parse(&sub_measure, argc, argv, &o, &o.input);
    if (code == EXIT_OK)
        code = take_kind(&o);
    if (code != EXIT_OK)
        return code;
    static struct mk_measurement result;
    struct mk_error err = MK_ERROR_INIT;
    struct mk_model model;
    struct mk_log *logs[MAX_FILES] = {NULL};
    enum mk_status st = mk_model_read(o.model, &model, &err);
    for (int i = 0; i < o.input.count && st == MK_OK; i++)
        st = mk_log_read(o.input.text[i], &logs[i], &err);
    if (st == MK_OK)
        st = mk_measure(o.kind, &model, (const struct mk_log *const *)logs, (size_t)o.input.count,
                        &o.measure, &result, &err);
    const bool writing = st == MK_OK;
    if (st == MK_OK && o.out)
        st = write_model(&o, &result, &err);
    if (st == MK_OK && o.json)
        st = write_json(&o, &result, &err);
    if (st == MK_OK && !is_standard_output(o.json))
        print_measurement(&result);
    for (size_t i = 0; i < MAX_FILES; i++)
        mk_log_free(logs[i]);
    return report_end(st, writing, &err);
}
