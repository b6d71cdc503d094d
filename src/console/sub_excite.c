/* mechkit excite: an input that tells most about a rig's parameters. */
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "console/sub.h"
#include "mechkit/excite.h"
#include "mechkit/json.h"
#include "mechkit/number.h"

struct options {
    const char *model, *out, *json;
};

enum { Q1 = 256, Q2, V1, V2 };

static const struct option names[] = {
    {"model", required_argument, NULL, 'm'},     {"out", required_argument, NULL, 'o'},
    {"json", required_argument, NULL, 'j'},      {"criterion", required_argument, NULL, 'c'},
    {"seconds", required_argument, NULL, 's'},   {"rate", required_argument, NULL, 'r'},
    {"harmonics", required_argument, NULL, 'n'}, {"u-max", required_argument, NULL, 'u'},
    {"q1", required_argument, NULL, Q1},         {"q2", required_argument, NULL, Q2},
    {"v1", required_argument, NULL, V1},         {"v2", required_argument, NULL, V2},
    {"drift", required_argument, NULL, 'd'},     {"spread", required_argument, NULL, 'p'},
    {"fix", required_argument, NULL, 'f'},       {"against", required_argument, NULL, 'a'},
    {"tries", required_argument, NULL, 't'},     {"seed", required_argument, NULL, 'S'},
    {"threads", required_argument, NULL, 'T'},   {NULL, 0, NULL, 0}};

/* Files come first: the model says what the other options start from. */
static int parse_files(int argc, char **argv, struct options *o)
{
    int c;
    opterr = 0;
    optind = 1;
    while ((c = getopt_long(argc, argv, ":", names, NULL)) != -1) {
        if (c == ':')
            return report_usage("excite", "%s needs a value", argv[optind - 1]);
        if (c == '?')
            return report_usage("excite", "unknown option '%s'", argv[optind - 1]);
        if (c == 'm')
            o->model = optarg;
        else if (c == 'o')
            o->out = optarg;
        else if (c == 'j')
            o->json = optarg;
    }
    if (optind < argc)
        return report_usage("excite", "'%s' is too much", argv[optind]);
    if (!o->model)
        return report_usage("excite", "--model is missing");
    return o->out || o->json ? EXIT_OK : report_usage("excite", "--out or --json is missing");
}

static bool parse_range(const char *text, double *low, double *high)
{
    const char *colon = strchr(text, ':');
    return colon && mk_parse_double(text, colon, low) && mk_parse_double_z(colon + 1, high) &&
           *low < *high;
}

static bool fix_parameter(const struct mk_model *model, const char *wanted, bool *fixed)
{
    for (int i = 0; i < mk_model_parameter_count(model); i++) {
        char name[64];
        mk_model_parameter_info(model, i, name, sizeof name);
        if (strcmp(name, wanted) == 0)
            return fixed[i] = true;
    }
    return false;
}

/* One option that is a number; NULL for another. */
static double *number_option(int c, struct mk_excite_options *e)
{
    switch (c) {
    case 's':
        return &e->seconds;
    case 'r':
        return &e->rate_hz;
    case 'u':
        return &e->u_max;
    case 'd':
        return &e->drift;
    case 'p':
        return &e->spread;
    case V1:
        return &e->v_max[0];
    case V2:
        return &e->v_max[1];
    default:
        return NULL;
    }
}

static bool whole(const char *text, double most, double *out)
{
    return mk_parse_double_z(text, out) && *out >= 0.0 && *out <= most && *out == floor(*out);
}

static int parse(int argc, char **argv, const struct mk_model *model, struct mk_excite_options *e)
{
    int c;
    optind = 1;
    while ((c = getopt_long(argc, argv, ":", names, NULL)) != -1) {
        double *number = number_option(c, e), count = 0.0;
        const char *name = argv[optind - 1] == optarg ? argv[optind - 2] : argv[optind - 1];
        bool fine = true;
        if (number)
            fine = mk_parse_double_z(optarg, number) && isfinite(*number);
        switch (c) {
        case 'c':
            e->criterion = mk_excite_criterion_by_name(optarg);
            fine = e->criterion != MK_EXCITE_CRITERION_COUNT;
            break;
        case Q1:
        case Q2:
            fine = parse_range(optarg, &e->q_min[c - Q1], &e->q_max[c - Q1]);
            break;
        case 'n':
            fine = whole(optarg, MK_EXCITE_MAX_HARMONICS, &count);
            e->harmonics = (int)count;
            break;
        case 't':
            fine = whole(optarg, 1e7, &count);
            e->evaluations = (int)count;
            break;
        case 'S':
            fine = whole(optarg, 9e15, &count);
            e->seed = (uint64_t)count;
            break;
        case 'T':
            fine = whole(optarg, 256, &count) && count > 0;
            e->threads = (int)count;
            break;
        case 'a':
            e->against = optarg;
            break;
        case 'f':
            if (!fix_parameter(model, optarg, e->fixed))
                return report_usage("excite", "--fix %s: the model has no such parameter", optarg);
            break;
        default:
            break;
        }
        if (!fine)
            return report_usage("excite", "%s: '%s' is not understood", name, optarg);
    }
    return EXIT_OK;
}

static bool show_progress(void *context, double done, const char *what)
{
    int *shown = context;
    int percent = (int)(100.0 * done);
    if (percent != *shown)
        fprintf(stderr, "\r%s: %3d %%", what, *shown = percent);
    return true;
}

static void print_row(const char *name, double best, double other, const char *unit)
{
    printf("  %-28s %12.4g %12.4g %s\n", name, best, other, unit);
}

static void print_result(const struct mk_excitation *e)
{
    const struct mk_excite_figures *f = &e->figures, *g = &e->against_figures;
    const struct mk_plant_info *plant = mk_plant(e->model.plant);
    printf("%s, criterion %s: %d inputs tried in %.1f s\n", plant->name,
           mk_excite_criterion_name(e->criterion), e->evaluations, e->seconds_taken);
    if (e->input[0])
        printf("  u = %s\n", e->input);
    else
        printf("  a trajectory with a period of %.4g s for %.4g s; condition number of its "
               "regressor %.5g,\n  columns scaled %.5g\n",
               e->period, e->seconds, e->regressor_condition, e->regressor_condition_scaled);
    printf("  %-28s %12s %12s  against u = %s\n", "foreseen over the run", "this", "that",
           e->against);
    for (int i = 0; i < mk_model_parameter_count(&e->model); i++) {
        char name[64], title[80];
        mk_model_parameter_info(&e->model, i, name, sizeof name);
        snprintf(title, sizeof title, "standard error %s", name);
        if (!isnan(f->std_error[i]))
            print_row(title, 100.0 * f->std_error[i], 100.0 * g->std_error[i], "%");
    }
    print_row("largest", 100.0 * f->worst, 100.0 * g->worst, "%");
    print_row("condition, scaled", f->condition_scaled, g->condition_scaled, "");
    print_row("largest command", f->u_max, g->u_max, "");
    for (int j = 0; j < plant->joints; j++)
        printf("  joint %d: %.3g .. %.3g rad, up to %.3g rad/s\n", j + 1, f->q_min[j], f->q_max[j],
               f->v_max[j]);
    if (!isnan(e->worst_of_rigs))
        printf("  with parameters off by up to the spread: up to %.4g %%\n",
               100.0 * e->worst_of_rigs);
    if (g->worst > 0.0)
        printf("  the largest standard error is %.3g times smaller\n", g->worst / f->worst);
}

static cJSON *figures_json(const struct mk_excitation *e, const struct mk_excite_figures *f)
{
    cJSON *o = cJSON_CreateObject(), *errors = cJSON_AddObjectToObject(o, "std_error");
    size_t joints = (size_t)mk_model_joints(&e->model);
    for (int i = 0; i < mk_model_parameter_count(&e->model); i++) {
        char name[64];
        mk_model_parameter_info(&e->model, i, name, sizeof name);
        cJSON_AddItemToObject(errors, name, mk_json_number(f->std_error[i]));
    }
    cJSON_AddItemToObject(o, "worst", mk_json_number(f->worst));
    cJSON_AddItemToObject(o, "a", mk_json_number(f->a));
    cJSON_AddItemToObject(o, "d", mk_json_number(f->d));
    cJSON_AddItemToObject(o, "condition_number", mk_json_number(f->condition));
    cJSON_AddItemToObject(o, "condition_number_scaled", mk_json_number(f->condition_scaled));
    cJSON_AddItemToObject(o, "u_max", mk_json_number(f->u_max));
    cJSON_AddItemToObject(o, "q_min", mk_json_numbers(f->q_min, joints));
    cJSON_AddItemToObject(o, "q_max", mk_json_numbers(f->q_max, joints));
    cJSON_AddItemToObject(o, "v_max", mk_json_numbers(f->v_max, joints));
    return o;
}

static enum mk_status write_json(const struct mk_excitation *e, const char *path,
                                 struct mk_error *err)
{
    cJSON *o = cJSON_CreateObject();
    cJSON_AddStringToObject(o, "rig", mk_plant(e->model.plant)->name);
    cJSON_AddStringToObject(o, "criterion", mk_excite_criterion_name(e->criterion));
    cJSON_AddItemToObject(o, "duration_s", mk_json_number(e->seconds));
    cJSON_AddItemToObject(o, "rate_hz", mk_json_number(e->rate_hz));
    cJSON_AddItemToObject(o, "input",
                          e->input[0] ? cJSON_CreateString(e->input) : cJSON_CreateNull());
    cJSON_AddItemToObject(o, "period_s", mk_json_number(e->period));
    cJSON_AddItemToObject(o, "regressor_condition_number", mk_json_number(e->regressor_condition));
    cJSON_AddItemToObject(o, "regressor_condition_number_scaled",
                          mk_json_number(e->regressor_condition_scaled));
    cJSON_AddItemToObject(o, "figures", figures_json(e, &e->figures));
    cJSON_AddItemToObject(o, "worst_of_rigs", mk_json_number(e->worst_of_rigs));
    cJSON_AddStringToObject(o, "against", e->against);
    cJSON_AddItemToObject(o, "against_figures", figures_json(e, &e->against_figures));
    cJSON_AddItemToObject(o, "evaluations", mk_json_number(e->evaluations));
    cJSON_AddItemToObject(o, "seconds", mk_json_number(e->seconds_taken));
    enum mk_status st = mk_json_write(path, o, err);
    cJSON_Delete(o);
    return st;
}

int sub_excite(int argc, char **argv)
{
    struct options o = {0};
    struct mk_model model;
    struct mk_excite_options e;
    struct mk_excitation result = {0};
    struct mk_error err = MK_ERROR_INIT;
    int shown = -1, code = parse_files(argc, argv, &o);
    if (code != EXIT_OK)
        return code;
    if (mk_model_read(o.model, &model, &err) != MK_OK)
        return report_error(&err);
    mk_excite_default(&model, &e);
    code = parse(argc, argv, &model, &e);
    if (code != EXIT_OK)
        return code;
    if (isatty(STDERR_FILENO)) {
        e.progress = show_progress;
        e.progress_context = &shown;
    }
    enum mk_status st = mk_excite(&model, &e, &result, &err);
    if (shown >= 0)
        fprintf(stderr, "\r%30s\r", "");
    if (st == MK_ERR_RANGE || st == MK_ERR_NOTSUP)
        return report_usage("excite", "%s", err.message);
    if (st == MK_OK && o.out)
        st = mk_excitation_write(&result, o.out, o.model, &err);
    if (st == MK_OK && o.json)
        st = write_json(&result, o.json, &err);
    if (st == MK_OK && !(o.json && strcmp(o.json, "-") == 0))
        print_result(&result);
    mk_excitation_clear(&result);
    return st == MK_OK ? EXIT_OK : report_error(&err);
}
