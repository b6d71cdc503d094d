/* mechkit excite: an input that tells most about a rig's parameters. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/out_file.h"
#include "console/commands/fix.h"
#include "console/commands/options.h"
#include "console/commands/progress.h"
#include "console/script/session.h"
#include "mechkit/excite.h"
#include "mechkit/json.h"
#include "mechkit/number.h"

struct options {
    const char *model, *out, *json;
    struct option_texts fixed;
    struct option_range q[MK_MAX_JOINTS];
    struct mk_excite_options search;
};

static bool take_criterion(const char *value, void *target)
{
    enum mk_excite_criterion criterion = mk_excite_criterion_by_name(value);
    *(enum mk_excite_criterion *)target = criterion;
    return criterion != MK_EXCITE_CRITERION_COUNT;
}

#define RANGE .take = option_take_range, .wants = "LOW:HIGH in the joint's unit, as -1:0.5"

static const struct option_row option_rows[] = {
    {"model", OPTION_TEXT(model), "M.ini", "the rig, as far as it is known", .required = true},
    {"out", OPTION_OUTPUT(out), "NAME.cmd", "the command file"},
    {"criterion", OPTION_CALL(search.criterion), "NAME",
     "worst, a, d: largest standard error, trace or determinant of the covariance; the input is a "
     "multisine. condition, condition-unscaled: of the regressor along a trajectory (rigs with a "
     "motor on every joint)\ndefault: condition where it can be, else worst",
     .take = take_criterion, .wants = "worst, a, d, condition or condition-unscaled"},
    {"seconds", OPTION_NUMBER(search.seconds), "S", "default 10", 1, 600},
    {"rate", OPTION_NUMBER(search.rate_hz), "HZ", "of the loop; default 500", 50, 10000},
    {"harmonics", OPTION_COUNT(search.harmonics), "N",
     "2 .. 12; default 5 for a trajectory, 8 for an input", 2, MK_EXCITE_MAX_HARMONICS},
    {"u-max", OPTION_NUMBER(search.u_max), "U", "limit of the command; default 70 % of the rig's"},
    {"q1", OPTION_CALL(q[0]), "LO:HI",
     "limits of the angle, rad (m where it slides); default half a turn either way, 31 mm", RANGE},
    {"q2", OPTION_CALL(q[1]), "LO:HI", "the same of joint 2", RANGE},
    {"v1", OPTION_NUMBER(search.v_max[0]), "V", "limit of the speed, rad/s or m/s"},
    {"v2", OPTION_NUMBER(search.v_max[1]), "V", "the same of joint 2"},
    {"drift", OPTION_NUMBER(search.process_noise), "D",
     "process noise that the rig may have, rad/s per sqrt(s); default 1e-4; where a joint slides a "
     "hundredth of it, m/s per sqrt(s)",
     0, 1e6},
    {"spread", OPTION_NUMBER(search.spread), "P",
     "how far the parameters may be off, as 0.1; default 0: trust the model", 0, 0.5},
    {"fix", OPTION_TEXTS(fixed), "NAME", "a parameter that will not be fitted; may be repeated"},
    {"against", OPTION_TEXT(search.against), "SIGNAL", "input to compare with; default U*sin(6*t)"},
    {"tries", OPTION_COUNT(search.evaluations), "N", "inputs to try; default 9000", 100, 1e7},
    {"seed", OPTION_SEED(search.seed), "N", "of the search; default 1", 0, 9e15},
    {"json", OPTION_FIGURES(json), "FILE", "the result; \"-\": standard output"},
    {"threads", OPTION_COUNT(search.threads), "N", "default: all processors", 1, 256},
    {0}};

static int run(int argc, char **argv);

const struct subcommand sub_excite = {
    .name = "excite",
    .summary = "find the input that tells most about a rig's parameters",
    .synopsis = "--model M.ini --out NAME.cmd [options]",
    .about =
        "Searches for an experiment of a given length and within limits, and writes it as a "
        "command\n"
        "file. The foreseen standard errors are relative, those of output-error fits of its log.",
    .options = option_rows,
    .argument = "model",
    .run = run,
};

static void take_limits(struct options *o)
{
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        if (isnan(o->q[j].low))
            continue;
        o->search.q_min[j] = o->q[j].low;
        o->search.q_max[j] = o->q[j].high;
    }
}

/* What the model, and not the table, says of a value. */
static int check_values(const struct options *o, const struct mk_model *model)
{
    const struct mk_plant_info *plant = mk_plant(model->plant);
    struct mk_signal *signal = NULL;
    struct mk_error err = MK_ERROR_INIT;
    if (o->search.u_max > model->u_max)
        return report_usage("excite", "--u-max %g: expected a number above 0, at most the rig's %g",
                            o->search.u_max, model->u_max);
    for (int j = 0; j < plant->joints; j++)
        if (!plant->joint_is_wheel[j] && !isnan(o->q[j].low) &&
            !(o->q[j].low < plant->rest[j] && plant->rest[j] < o->q[j].high))
            return report_usage("excite", "--q%d %g:%g: rest at %.4g %s must lie within it", j + 1,
                                o->q[j].low, o->q[j].high, plant->rest[j],
                                mk_model_unit(model, j, "rad"));
    if (!o->search.against)
        return EXIT_OK;
    enum mk_status st = mk_signal_create(o->search.against, &signal, &err);
    if (st == MK_OK)
        st = session_check_signal(signal, 0.0, o->search.seconds, &err);
    mk_signal_destroy(signal);
    return st == MK_OK ? EXIT_OK : report_usage("excite", "--against: %s", err.message);
}

/* The model says what the other options start from: the command line is read for it first, then
 * again. */
static int parse(int argc, char **argv, struct options *o, struct mk_model *model)
{
    struct arguments none;
    struct mk_error err = MK_ERROR_INIT;
    int code = options_parse(&sub_excite, argc, argv, o, &none);
    if (code != EXIT_OK)
        return code;
    if (!o->out && !o->json)
        return report_usage("excite", "--out or --json is missing");
    if (mk_model_read(o->model, model, &err) != MK_OK)
        return report_error(&err);
    *o = (struct options){.q = {{NAN, NAN}, {NAN, NAN}}};
    mk_excite_default(model, &o->search);
    code = options_parse(&sub_excite, argc, argv, o, &none);
    take_limits(o);
    if (code == EXIT_OK)
        code = check_values(o, model);
    return code == EXIT_OK ? fix_parameters("excite", &o->fixed, model, o->search.fixed) : code;
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
        printf("  joint %d: %.3g .. %.3g %s, up to %.3g %s\n", j + 1, f->q_min[j], f->q_max[j],
               mk_model_unit(&e->model, j, "rad"), f->v_max[j],
               mk_model_unit(&e->model, j, "rad/s"));
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

static int run(int argc, char **argv)
{
    struct options o = {0};
    struct mk_model model;
    struct mk_excitation result = {0};
    struct mk_error err = MK_ERROR_INIT;
    struct progress progress;
    int code = parse(argc, argv, &o, &model);
    if (code != EXIT_OK)
        return code;
    if (mk_out_file_check(o.out, &err) != MK_OK || mk_out_file_check(o.json, &err) != MK_OK)
        return report_output_error(&err);
    if (progress_begin(&progress)) {
        o.search.progress = progress_show;
        o.search.progress_context = &progress;
    }
    enum mk_status st = mk_excite(&model, &o.search, &result, &err);
    progress_end(&progress);
    if (st == MK_ERR_NOTSUP)
        return report_usage("excite", "--criterion: %s", err.message);
    if (st == MK_ERR_RANGE)
        return report_usage("excite", o.fixed.count > 0 ? "--fix: %s" : "%s", err.message);
    const bool writing = st == MK_OK;
    if (st == MK_OK && o.out)
        st = mk_excitation_write(&result, o.out, o.model, &err);
    if (st == MK_OK && o.json)
        st = write_json(&result, o.json, &err);
    if (st == MK_OK && !is_standard_output(o.json))
        print_result(&result);
    mk_excitation_clear(&result);
    return report_end(st, writing, &err);
}
