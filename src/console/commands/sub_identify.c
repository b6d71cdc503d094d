/* mechkit identify: parameters of a model from logs. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/out_file.h"
#include "console/commands/data_checks.h"
#include "console/commands/fix.h"
#include "console/commands/left_out.h"
#include "console/commands/options.h"
#include "console/commands/progress.h"
#include "experiment/data_check_json.h"
#include "ident/input_report.h"
#include "ident/left_out_json.h"
#include "mechkit/ident.h"
#include "mechkit/json.h"

#define MAX_FILES 64
/* Rows of a log in free runs: what more would take is for no gain. */
#define MOST_COMPARED 1000000

struct options {
    const char *model, *out, *json;
    const char *column; /* --input */
    struct option_texts fixed, validate;
    struct arguments input;
    struct mk_ident_options ident;
};

static bool take_method(const char *value, void *target)
{
    *(const char **)target = value;
    return mk_ident_method_by_name(value) != NULL;
}

static bool take_column(const char *value, void *target)
{
    *(const char **)target = value;
    return strcmp(value, "measured") == 0 || strcmp(value, "commanded") == 0 ||
           strcmp(value, "compare") == 0;
}

static const struct option_row option_rows[] = {
    {"model", OPTION_TEXT(model), "M.ini", "the model to fit; values may be orders off, or `?`",
     .required = true},
    {"out", OPTION_OUTPUT(out), "FITTED.ini", "the fitted model, with standard errors",
     .replaces = "model"},
    {"method", OPTION_CALL(ident.method), "NAME",
     "output-error (default): maximum likelihood of the measured angles; olsen, swevers, wls, sls, "
     "energy: linear, base parameters only",
     .take = take_method, .wants = "output-error, olsen, swevers, wls, sls or energy"},
    {"input", OPTION_CALL(column), "COLUMN",
     "what drives the model: measured (u, tau, ...), commanded (u_cmd, tau_cmd, ...) or compare: "
     "the "
     "one that predicts logs better that were left out. Default: what the model says; else "
     "compare, "
     "where two logs or more have both",
     .take = take_column, .wants = "measured, commanded or compare"},
    {"json", OPTION_FIGURES(json), "FILE", "the result with covariance; \"-\": standard output"},
    {"fix", OPTION_TEXTS(fixed), "NAME",
     "hold a parameter, as p5 or effect.backlash.width; may be repeated"},
    {"validate", OPTION_TEXTS(validate), "V.csv",
     "free-run error on a log that was not fitted; may be repeated"},
    {"cutoff", OPTION_NUMBER(ident.cutoff_hz), "HZ",
     "linear methods: averaging over windows of 1 / HZ; default 3", .wants = "Hz above 0"},
    {"force", OPTION_FLAG(ident.force), NULL,
     "go on in spite of a fatal finding of the data check"},
    LEFT_OUT_OPTIONS(ident.rows, ", and times that scatter"),
    {"threads", OPTION_COUNT(ident.threads), "N", "default: all processors", 1, 256},
    {0}};

static int run(int argc, char **argv);

const struct subcommand sub_identify = {
    .name = "identify",
    .summary = "fit a model's parameters to logs",
    .synopsis = "--model M.ini --out FITTED.ini [options] LOG.csv...",
    .about = "Fits [parameters], and those of the effects in the model, and says how well they are "
             "known.\n"
             "Data without a torque, free swings, tell ratios of parameters: p1 then keeps its "
             "value.",
    .options = option_rows,
    .argument = "log",
    .least = 1,
    .most = MAX_FILES,
    .run = run,
};

static double correlation(const struct mk_ident_result *r, size_t i, size_t k)
{
    size_t n = (size_t)r->parameter_count;
    return r->covariance[i * n + k] /
           sqrt(r->covariance[i * n + i] * r->covariance[k * n + k]); /* NaN: held */
}

/* The two parameters that the data tell apart least. */
static void print_correlation(const struct mk_ident_result *r)
{
    double most = 0.0;
    size_t a = 0, b = 0;
    for (size_t i = 0; i < (size_t)r->parameter_count; i++)
        for (size_t k = 0; k < i; k++)
            if (fabs(correlation(r, i, k)) > fabs(most))
                most = correlation(r, i, k), a = k, b = i;
    if (most != 0.0)
        printf("  largest correlation: %.3f, of %s and %s\n", most, r->parameter[a].name,
               r->parameter[b].name);
}

/* Of parameters with a value of their own in every log. */
static void print_own_values(const struct mk_ident_result *r, const char *const *files)
{
    for (int i = 0; i < r->parameter_count; i++) {
        const double spread = mk_model_parameter_spread(&r->model, i);
        if (!(spread > 0.0))
            continue;
        printf("  %s, a value of its own in every log, %.3g %s from log to log:\n",
               r->parameter[i].name, spread, r->parameter[i].unit);
        for (int k = 0; k < r->own_count; k++)
            if (r->own[k].parameter == i)
                printf("    %-40s %12.5g +- %.2g\n", show_name(files[r->own[k].log]),
                       r->own[k].value, r->own[k].std_error);
    }
}

static void print_ratios(const struct mk_ident_result *r)
{
    if (!r->scale_free)
        return;
    const struct mk_ident_parameter *held = &r->parameter[r->scale_holder];
    printf("  the scale is free: these data show no torque, so inertias, weights and frictions may "
           "all\n"
           "  be multiplied by one number. %s is held at %g; what the data determine are ratios:\n",
           held->name, held->value);
    for (int i = 0; i < r->ratio_count; i++) {
        const struct mk_ident_ratio *p = &r->ratio[i];
        printf("  %-28s %14.8g %12.3g %8.3f   %s\n", p->name, p->value, p->std_error,
               100.0 * p->std_error / fabs(p->value), p->unit);
    }
}

static void print_result(const struct mk_ident_result *r, const char *const *files)
{
    data_checks_print(stdout, &r->data_check);
    printf("%s: %zu readings, %d iterations, %.2f s\n", r->method, r->rows, r->iterations,
           r->seconds);
    printf("  %-28s %14s %12s %8s   %s\n", "parameter", "value", "std error", "%", "given");
    for (int i = 0; i < r->parameter_count; i++) {
        const struct mk_ident_parameter *p = &r->parameter[i];
        if (!mk_parameter_applies(mk_model_parameter_info(&r->model, i, NULL, 0), r->model.plant))
            continue;
        printf("  %-28s %14.8g ", p->name, p->value);
        if (p->fixed)
            printf("%12s %8s", "held", "");
        else if (r->scale_free && isnan(p->std_error))
            printf("%12s %8s", "see below", "");
        else
            printf("%12.3g %8.3f", p->std_error, 100.0 * p->std_error / fabs(p->value));
        if (isnan(p->initial))
            printf("   ?\n");
        else
            printf("   %.6g\n", p->initial);
    }
    print_ratios(r);
    print_own_values(r, files);
    for (int j = 0; j < mk_model_joints(&r->model); j++)
        printf("  noise of q%d: %.3g %s\n", j + 1, r->noise[j], mk_model_unit(&r->model, j, "rad"));
    printf("  condition number %.3g, scaled %.3g\n", r->condition_number,
           r->condition_number_scaled);
    print_correlation(r);
    for (int i = 0; i < r->warning_count; i++)
        printf("  warning: %s\n", show_name(r->warning[i]));
}

/* Free runs of the given (NULL: it has unknown values) and the fitted model over a log, or over the
 * beginning of a very long one. */
static enum mk_status compare(const struct mk_model *const models[2], const char *path,
                              const struct mk_log *log, cJSON *list, bool prints,
                              struct mk_error *err)
{
    struct mk_predict_figures f[2];
    struct mk_predict_options o = {.window_s = 1.0};
    struct mk_log beginning = *log;
    if (beginning.rows > MOST_COMPARED)
        beginning.rows = MOST_COMPARED;
    size_t n = (size_t)mk_model_joints(models[1]);
    for (int i = 0; i < 2; i++) {
        struct mk_log *made = NULL;
        /* Where values are unknown there is nothing to compare with, and ones that are far off may
         * run away in every window. */
        f[i] = (struct mk_predict_figures){.nrmse = {(double)NAN, (double)NAN}};
        enum mk_status st =
            models[i] ? mk_predict(models[i], &beginning, &o, &made, &f[i], NULL, err) : MK_OK;
        mk_log_free(made);
        if (st != MK_OK && i == 1)
            return st;
    }
    if (prints)
        printf("  %s, free runs of 1 s%s, nrmse:", show_name(path),
               beginning.rows < log->rows ? " over its first million rows" : "");
    for (size_t j = 0; j < n && prints; j++)
        printf("  q%zu %.4g -> %.4g", j + 1, f[0].nrmse[j], f[1].nrmse[j]);
    if (prints)
        printf("\n");
    cJSON *o1 = cJSON_CreateObject();
    cJSON_AddStringToObject(o1, "file", path);
    cJSON_AddItemToObject(o1, "nrmse_given", mk_json_numbers(f[0].nrmse, n));
    cJSON_AddItemToObject(o1, "nrmse_fitted", mk_json_numbers(f[1].nrmse, n));
    cJSON_AddItemToArray(list, o1);
    return MK_OK;
}

static void add_own_values(cJSON *to, const struct mk_ident_result *r, int parameter,
                           const char *const *files)
{
    const double spread = mk_model_parameter_spread(&r->model, parameter);
    if (!(spread > 0.0))
        return;
    cJSON_AddItemToObject(to, "spread", mk_json_number(spread));
    cJSON *list = cJSON_AddArrayToObject(to, "own_values");
    for (int k = 0; k < r->own_count; k++) {
        if (r->own[k].parameter != parameter)
            continue;
        cJSON *one = cJSON_CreateObject();
        cJSON_AddStringToObject(one, "file", files[r->own[k].log]);
        cJSON_AddItemToObject(one, "value", mk_json_number(r->own[k].value));
        cJSON_AddItemToObject(one, "stderr", mk_json_number(r->own[k].std_error));
        cJSON_AddItemToArray(list, one);
    }
}

static void add_ratios(cJSON *to, const struct mk_ident_result *r)
{
    cJSON_AddStringToObject(to, "scale", r->scale_free ? "free" : "known");
    if (!r->scale_free)
        return;
    cJSON_AddStringToObject(to, "scale_held", r->parameter[r->scale_holder].name);
    cJSON *all = cJSON_AddArrayToObject(to, "ratios");
    for (int i = 0; i < r->ratio_count; i++) {
        const struct mk_ident_ratio *p = &r->ratio[i];
        cJSON *one = cJSON_CreateObject();
        cJSON_AddStringToObject(one, "name", p->name);
        cJSON_AddItemToObject(one, "value", mk_json_number(p->value));
        cJSON_AddItemToObject(one, "stderr", mk_json_number(p->std_error));
        cJSON_AddStringToObject(one, "unit", p->unit);
        cJSON_AddItemToArray(all, one);
    }
}

static cJSON *result_json(const struct mk_ident_result *r, const char *const *files)
{
    cJSON *o = cJSON_CreateObject();
    cJSON_AddItemToObject(o, "data_checks", data_check_json(&r->data_check));
    cJSON *all = cJSON_AddObjectToObject(o, "parameters");
    for (int i = 0; i < r->parameter_count; i++) {
        const struct mk_ident_parameter *p = &r->parameter[i];
        const struct mk_parameter_info *info = mk_model_parameter_info(&r->model, i, NULL, 0);
        if (!mk_parameter_applies(info, r->model.plant))
            continue;
        cJSON *one = cJSON_AddObjectToObject(all, p->name);
        cJSON_AddItemToObject(one, "value", mk_json_number(p->value));
        /* A whole number that the model says is held, and known. */
        bool whole = info->fit == MK_FIT_INTEGER;
        cJSON_AddItemToObject(one, "stderr", mk_json_number(whole ? 0.0 : p->std_error));
        if (whole)
            cJSON_AddTrueToObject(one, "integer");
        cJSON_AddItemToObject(one, "initial", mk_json_number(p->initial));
        cJSON_AddItemToObject(one, "crb", mk_json_number(p->crb));
        cJSON_AddBoolToObject(one, "fixed", p->fixed);
        cJSON_AddStringToObject(one, "unit", p->unit);
        add_own_values(one, r, i, files);
    }
    cJSON_AddStringToObject(o, "method", r->method);
    add_ratios(o, r);
    cJSON_AddItemToObject(o, "condition_number", mk_json_number(r->condition_number));
    cJSON_AddItemToObject(o, "condition_number_scaled", mk_json_number(r->condition_number_scaled));
    cJSON_AddItemToObject(o, "cost", mk_json_number(r->cost));
    cJSON_AddItemToObject(o, "noise",
                          mk_json_numbers(r->noise, (size_t)mk_model_joints(&r->model)));
    cJSON *rows = cJSON_AddArrayToObject(o, "covariance");
    size_t n = (size_t)r->parameter_count;
    for (size_t i = 0; i < n; i++)
        cJSON_AddItemToArray(rows, mk_json_numbers(r->covariance + i * n, n));
    rows = cJSON_AddArrayToObject(o, "correlation");
    for (size_t i = 0; i < n; i++) {
        cJSON *row = cJSON_CreateArray();
        for (size_t k = 0; k < n; k++)
            cJSON_AddItemToArray(row, mk_json_number(correlation(r, i, k)));
        cJSON_AddItemToArray(rows, row);
    }
    cJSON *warnings = cJSON_AddArrayToObject(o, "warnings");
    for (int i = 0; i < r->warning_count; i++)
        cJSON_AddItemToArray(warnings, cJSON_CreateString(r->warning[i]));
    cJSON_AddItemToObject(o, "rows", mk_json_number((double)r->rows));
    cJSON_AddItemToObject(o, "seconds", mk_json_number(r->seconds));
    return o;
}

struct job {
    struct mk_left_out left_out[2 * MK_MAX_LEFT_OUT]; /* of logs, then of those to validate on */
    int left_out_count;
    struct options o;
    struct mk_model model; /* as given, with the column that is taken */
    struct mk_model given;
    struct mk_input_comparison input;
    struct mk_log *logs[MAX_FILES], *validation[MAX_FILES];
    struct mk_data_check data_check;
    struct mk_ident_result result;
    cJSON *json;
};

static enum mk_status read_logs(struct job *j, struct mk_error *err)
{
    const size_t count = (size_t)j->o.input.count, checks = j->o.validate.count;
    enum mk_status st = log_read_all((const char *const *)j->o.input.text, count, j->logs, err);
    if (st == MK_OK)
        st = log_read_all(j->o.validate.text, checks, j->validation, err);
    if (st == MK_OK)
        st = mk_data_check_logs(&j->model, (const struct mk_log *const *)j->logs, count,
                                MK_DATA_IDENTIFY, j->o.ident.threads, &j->data_check, err);
    if (st == MK_OK)
        st = mk_data_check_logs(&j->model, (const struct mk_log *const *)j->validation, checks,
                                MK_DATA_HOLD_OUT, j->o.ident.threads, &j->data_check, err);
    j->o.ident.data_check = &j->data_check;
    if (st == MK_OK && !j->o.ident.rows.keep_all) {
        log_take_even_times(j->logs, count, &j->model);
        log_take_even_times(j->validation, checks, &j->model);
    }
    return st;
}

static bool all_have_both(const struct job *j)
{
    bool both = true;
    for (int i = 0; i < j->o.input.count; i++)
        both = both && mk_log_has_both_inputs(j->logs[i], &j->model);
    for (size_t i = 0; i < j->o.validate.count; i++)
        both = both && mk_log_has_both_inputs(j->validation[i], &j->model);
    return both;
}

/* Whether the columns are to be compared: where it is asked for, or nobody has said anything and it
 * can be done. */
static bool compares(const struct job *j)
{
    const struct mk_ident_method_info *method =
        mk_ident_method_by_name(j->o.ident.method ? j->o.ident.method : "output-error");
    if (j->o.column)
        return strcmp(j->o.column, "compare") == 0;
    return j->model.input == MK_INPUT_UNSAID && method->fits_effects && j->o.input.count > 1 &&
           all_have_both(j);
}

static enum mk_status compare_inputs(struct job *j, struct mk_error *err)
{
    enum mk_status st = mk_compare_inputs(&j->model, (const struct mk_log *const *)j->logs,
                                          (size_t)j->o.input.count, &j->o.ident, &j->input, err);
    if (st == MK_OK)
        j->model = j->input.model;
    /* Nobody asked for it: then what can be fitted is. */
    const bool vain = st == MK_ERR_RANGE || st == MK_ERR_NUMERIC;
    return vain && !j->o.column ? MK_OK : st;
}

static enum mk_status fit(struct job *j, struct mk_error *err)
{
    struct progress progress;
    if (progress_begin(&progress)) {
        j->o.ident.progress = progress_show;
        j->o.ident.progress_context = &progress;
    }
    enum mk_status compared = compares(j) ? compare_inputs(j, err) : MK_OK;
    if (compared != MK_OK) {
        progress_end(&progress);
        return compared;
    }
    enum mk_status st = mk_identify(&j->model, (const struct mk_log *const *)j->logs,
                                    (size_t)j->o.input.count, &j->o.ident, &j->result, err);
    progress_end(&progress);
    return st;
}

/* Of the logs as the fit found it, of those to validate on as all logs together show it. */
static enum mk_status leave_out(struct job *j, struct mk_error *err)
{
    const struct mk_log *all[2 * MAX_FILES];
    struct mk_left_out found[MK_MAX_LEFT_OUT];
    const size_t count = (size_t)j->o.input.count, checks = j->o.validate.count;
    int of_all = 0;
    memcpy(j->left_out, j->result.left_out, sizeof j->result.left_out);
    j->left_out_count = j->result.left_out_count;
    for (size_t i = 0; i < count + checks; i++)
        all[i] = i < count ? j->logs[i] : j->validation[i - count];
    enum mk_status st = MK_OK;
    if (checks > 0)
        st =
            mk_find_left_out(&j->model, all, count + checks, &j->o.ident.rows, found, &of_all, err);
    for (int i = 0; i < of_all; i++)
        if (found[i].log >= count)
            j->left_out[j->left_out_count++] = found[i];
    if (st == MK_OK)
        st = left_out_apply(j->logs, count, 0, j->left_out, j->left_out_count, err);
    return st == MK_OK
               ? left_out_apply(j->validation, checks, count, j->left_out, j->left_out_count, err)
               : st;
}

/* Where the JSON goes to standard output nothing else does. */
static bool prints(const struct job *j)
{
    return !(j->o.json && strcmp(j->o.json, "-") == 0);
}

static enum mk_status compare_all(struct job *j, struct mk_error *err)
{
    const struct mk_model *models[2] = {&j->given, &j->result.model};
    for (int i = 0; i < j->result.parameter_count; i++)
        if (j->o.ident.unknown[i])
            models[0] = NULL;
    enum mk_status st = MK_OK;
    cJSON *data = cJSON_AddArrayToObject(j->json, "data");
    for (int i = 0; i < j->o.input.count && st == MK_OK; i++)
        if (mk_data_check_uses(&j->model, j->logs[i], MK_DATA_IDENTIFY))
            st = compare(models, j->o.input.text[i], j->logs[i], data, prints(j), err);
    cJSON *check = cJSON_AddArrayToObject(j->json, "validation");
    for (size_t i = 0; i < j->o.validate.count && st == MK_OK; i++)
        if (mk_data_check_uses(&j->model, j->validation[i], MK_DATA_HOLD_OUT))
            st = compare(models, j->o.validate.text[i], j->validation[i], check, prints(j), err);
    return st;
}

static enum mk_status write_output(const struct job *j, struct mk_error *err)
{
    char comment[200];
    snprintf(comment, sizeof comment, "fitted by mechkit identify, method %s, %zu readings",
             j->result.method, j->result.rows);
    enum mk_status st = j->o.out ? mk_model_write(j->o.out, &j->result.model, comment, err) : MK_OK;
    return st == MK_OK && j->o.json ? mk_json_write(j->o.json, j->json, err) : st;
}

/* What --input says. */
static int take_input(struct job *j)
{
    const char *column = j->o.column;
    const struct mk_ident_method_info *method =
        mk_ident_method_by_name(j->o.ident.method ? j->o.ident.method : "output-error");
    if (column && strcmp(column, "compare") == 0 && !method->fits_effects)
        return report_usage("identify",
                            "--input compare: method %s cannot fit how late a command acts; say "
                            "measured or commanded, or take output-error",
                            method->name);
    j->given = j->model;
    for (int i = MK_INPUT_MEASURED; column && i < MK_INPUT_COUNT; i++)
        if (strcmp(column, mk_input_name((enum mk_input)i)) == 0)
            j->model.input = j->given.input = (enum mk_input)i;
    return EXIT_OK;
}

static bool has_delay(const struct mk_model *model)
{
    for (int e = 0; e < model->effect_count; e++)
        if (mk_effect(model->effect[e].index) == mk_effect_by_name("input-delay"))
            return true;
    return false;
}

/* Which column drives the fitted model, and why; nothing where there is one only. */
static void say_input(const struct job *j)
{
    char what[400];
    if (!j->input.made && j->model.input == MK_INPUT_UNSAID)
        return;
    snprintf(what, sizeof what, "the %s column, as %s says", mk_input_name(j->model.input),
             j->o.column ? "--input" : "the model");
    if (j->input.made)
        mk_input_sentence(&j->input, what, sizeof what);
    printf("input: %s\n", what);
    if (!j->input.made && j->model.input == MK_INPUT_COMMANDED && !has_delay(&j->model))
        puts("  as if it acted at once: --input compare fits how late it acts");
}

static cJSON *input_json(const struct job *j)
{
    if (j->input.made)
        return mk_input_json(&j->input);
    cJSON *o = cJSON_CreateObject();
    cJSON_AddStringToObject(o, "taken", mk_input_name(j->model.input));
    cJSON_AddFalseToObject(o, "changed");
    return o;
}

/* Returns an exit code. */
static int identify(struct job *j)
{
    struct mk_error err = MK_ERROR_INIT;
    if (mk_model_read_open(j->o.model, &j->model, j->o.ident.unknown, &err) != MK_OK)
        return report_error(&err);
    int rc = fix_parameters("identify", &j->o.fixed, &j->model, j->o.ident.fixed);
    if (rc != EXIT_OK)
        return rc;
    rc = take_input(j);
    if (rc != EXIT_OK)
        return rc;
    if (read_logs(j, &err) != MK_OK)
        return report_error(&err);
    rc = data_checks_say(&j->data_check, j->o.ident.force);
    if (rc != EXIT_OK)
        return rc;
    if (mk_out_file_check(j->o.out, &err) != MK_OK || mk_out_file_check(j->o.json, &err) != MK_OK)
        return report_output_error(&err);
    if (fit(j, &err) != MK_OK)
        return report_error(&err);
    if (leave_out(j, &err) != MK_OK)
        return report_error(&err);
    left_out_warn(j->left_out, j->left_out_count);
    if (prints(j)) {
        left_out_print(stdout, j->left_out, j->left_out_count);
        say_input(j);
        print_result(&j->result, (const char *const *)j->o.input.text);
    }
    j->json = result_json(&j->result, (const char *const *)j->o.input.text);
    cJSON_AddItemToObject(j->json, "left_out", left_out_json(j->left_out, j->left_out_count));
    cJSON_AddItemToObject(j->json, "input", input_json(j));
    if (compare_all(j, &err) != MK_OK)
        return report_error(&err);
    return write_output(j, &err) == MK_OK ? EXIT_OK : report_output_error(&err);
}

static int check_names(const struct options *o)
{
    if (!o->out && !o->json)
        return report_usage("identify", "--out or --json is missing");
    return EXIT_OK;
}

static int run(int argc, char **argv)
{
    static struct job j;
    int rc = options_parse(&sub_identify, argc, argv, &j.o, &j.o.input);
    if (rc == EXIT_OK)
        rc = check_names(&j.o);
    if (rc == EXIT_OK)
        rc = identify(&j);
    for (size_t i = 0; i < MAX_FILES; i++) {
        mk_log_free(j.logs[i]);
        mk_log_free(j.validation[i]);
    }
    cJSON_Delete(j.json);
    return rc;
}
