/* mechkit simulate: free-run prediction of a log. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "console/commands/data_checks.h"
#include "console/commands/left_out.h"
#include "console/commands/options.h"
#include "ident/left_out_json.h"
#include "mechkit/ident.h"
#include "mechkit/json.h"
#include "mechkit/signals.h"
#include "mechkit/sim.h"
#include "sim/predict.h"
#include "sim/stiffness.h"

struct left_out {
    struct mk_left_out list[MK_MAX_LEFT_OUT];
    int count;
};

struct options {
    const char *model, *input, *out, *json;
    struct mk_predict_options predict;
    struct mk_row_choice rows;
    bool states;
};

static bool take_solver(const char *value, void *target)
{
    enum mk_solver solver = mk_solver_by_name(value);
    *(enum mk_solver *)target = solver;
    return solver != MK_SOLVER_COUNT;
}

static const struct option_row option_rows[] = {
    {"model", OPTION_TEXT(model), "M.ini", "the rig", .required = true},
    {"input", OPTION_TEXT(input), "LOG.csv", "the log whose command drives it", .required = true},
    {"out", OPTION_OUTPUT(out), "PRED.csv", "the prediction, on the log's own time base"},
    {"window", OPTION_NUMBER(predict.window_s), "S",
     "start again from the data every S seconds; adds a column window", .low = 1e-3, .high = 1e6},
    LEFT_OUT_OPTIONS(rows, ""),
    {"solver", OPTION_CALL(predict.sim.solver), "NAME",
     "arkode-erk (default), cvode-adams, cvode-bdf, dop853", .take = take_solver,
     .wants = "arkode-erk, cvode-adams, cvode-bdf or dop853"},
    {"states", OPTION_FLAG(states), NULL,
     "also columns x1, x2, ...: joints, their speeds, the effects' states"},
    {"json", OPTION_FIGURES(json), "FILE",
     "figures per joint (rms, nrmse); \"-\": standard output"},
    {0}};

static int run(int argc, char **argv);

const struct subcommand sub_simulate = {
    .name = "simulate",
    .summary = "predict a log by driving a model with its command",
    .synopsis = "--model M.ini --input LOG.csv [--out PRED.csv] [options]",
    .about =
        "Drives the model by the log's command (zero-order hold) from the log's start and writes\n"
        "t,q1,q2,dq1,dq2 on the log's own time base. The start state of a window is fitted to the\n"
        "readings of that window (without --window: of the first second), so that what is left is\n"
        "the model's error. It is printed beside the scatter of the readings themselves, which no\n"
        "model predicts.",
    .options = option_rows,
    .argument = "log",
    .run = run,
};

/* Scatter of a joint's readings about the smooth curve that is most likely behind them; NAN where
 * there are too few. No model predicts them better. */
static double reading_noise(const struct mk_log *log, const char *column)
{
    const double *t = mk_log_get(log, "t"), *q = mk_log_get(log, column);
    const struct mk_smooth_options options = {0};
    struct mk_smooth_figures found = {.noise = (double)NAN};
    double *smooth = q ? calloc(log->rows, sizeof *smooth) : NULL;
    if (!smooth || mk_smooth(t, q, log->rows, &options, smooth, NULL, NULL, NULL, &found) != MK_OK)
        found.noise = (double)NAN;
    free(smooth);
    return found.noise;
}

/* Readings of a joint that hardly moves do not scatter as their steps do: rounding to counts leaves
 * a twelfth of a count squared all the same. */
static void find_noise(const struct mk_log *log, const struct mk_model *model,
                       double noise[MK_MAX_JOINTS])
{
    static const char *const columns[MK_MAX_JOINTS] = {"q1", "q2"};
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        noise[j] = (double)NAN;
    for (int j = 0; j < mk_model_joints(model); j++)
        noise[j] = fmax(reading_noise(log, columns[j]), mk_model_count(model, j) / sqrt(12.0));
}

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void add_own_values(cJSON *root, const struct mk_model *model,
                           const struct mk_predict_figures *f)
{
    if (f->own_count == 0)
        return;
    cJSON *list = cJSON_AddArrayToObject(root, "own_values");
    for (int i = 0; i < f->own_count; i++) {
        const struct mk_own_estimate *own = &f->own[i];
        const struct mk_effect_use *use = &model->effect[own->effect];
        cJSON *one = cJSON_CreateObject();
        cJSON_AddStringToObject(one, "effect", mk_effect(use->index)->name);
        cJSON_AddItemToObject(one, "joint",
                              use->joint > 0 ? mk_json_number(use->joint) : cJSON_CreateNull());
        cJSON_AddStringToObject(one, "parameter",
                                mk_effect(use->index)->parameter[own->parameter].name);
        cJSON_AddItemToObject(one, "value", mk_json_number(own->value));
        cJSON_AddItemToObject(one, "stderr", mk_json_number(own->std_error));
        cJSON_AddItemToArray(list, one);
    }
}

static enum mk_status write_figures(const struct options *o, const struct mk_model *model,
                                    const struct mk_predict_figures *f, const struct left_out *left,
                                    const double *noise, size_t failed, double seconds,
                                    struct mk_error *err)
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
    cJSON_AddStringToObject(root, "start_states",
                            o->predict.window_s > 0.0
                                ? "fitted to the readings of each window"
                                : "fitted to the readings of the first second");
    cJSON_AddItemToObject(root, "windows", mk_json_number((double)f->windows));
    cJSON_AddItemToObject(root, "failed", mk_json_number((double)failed));
    cJSON_AddItemToObject(root, "rows", mk_json_number((double)f->rows));
    cJSON_AddItemToObject(root, "rms", mk_json_numbers(f->rms, n));
    cJSON_AddItemToObject(root, "nrmse", mk_json_numbers(f->nrmse, n));
    cJSON_AddItemToObject(root, "noise", mk_json_numbers(noise, n));
    if (f->from_s > 0.0)
        cJSON_AddItemToObject(root, "from_s", mk_json_number(f->from_s));
    add_own_values(root, model, f);
    cJSON_AddItemToObject(root, "left_out", left_out_json(left->list, left->count));
    cJSON_AddItemToObject(root, "seconds", mk_json_number(seconds));
    enum mk_status st = mk_json_write(o->json, root, err);
    cJSON_Delete(root);
    return st;
}

/* Of a log that has both columns of the command it is said which one drove the model. */
static void print_figures(const struct options *o, const struct mk_model *model,
                          const struct mk_log *log, const struct mk_predict_figures *f,
                          const double *noise, size_t failed)
{
    printf("%s: %zu rows, %zu window%s", show_name(o->input), f->rows, f->windows,
           f->windows == 1 ? "" : "s");
    if (mk_log_has_both_inputs(log, model))
        printf(model->input == MK_INPUT_COMMANDED
                   ? ", driven by the command as it was sent (input = commanded in the model)"
                   : ", driven by the command as it was measured");
    puts("");
    for (int i = 0; i < f->own_count; i++) {
        const struct mk_own_estimate *own = &f->own[i];
        const struct mk_effect_use *use = &model->effect[own->effect];
        const struct mk_effect_info *info = mk_effect(use->index);
        printf("  %s", info->name);
        if (use->joint > 0)
            printf(" at joint %d", use->joint);
        printf(": %s of this log %.4g +- %.2g, from its first half\n",
               info->parameter[own->parameter].name, own->value, own->std_error);
    }
    if (f->from_s > 0.0)
        printf("  errors of the second half, from %.3g s on:\n", f->from_s);
    for (int j = 0; j < mk_model_joints(model); j++) {
        printf("  q%d: rms error %.4g %s", j + 1, f->rms[j], mk_model_unit(model, j, "rad"));
        if (isfinite(f->nrmse[j]))
            printf(", %.4g of its standard deviation", f->nrmse[j]);
        else
            printf("; the log has it at rest");
        if (isnan(noise[j]))
            puts("");
        else
            printf("; readings' own noise %.3g %s\n", noise[j], mk_model_unit(model, j, "rad"));
    }
    if (failed)
        printf("  %zu window%s ended early: the model leaves every bound\n", failed,
               failed == 1 ? "" : "s");
}

/* A free run goes on whatever the values are. */
static enum mk_status say_extremes(const struct mk_model *model, const struct mk_log *log,
                                   struct mk_error *err)
{
    static struct mk_data_check check;
    enum mk_status st = mk_data_check_logs(model, &log, 1, MK_DATA_SIMULATE, 1, &check, err);
    if (st == MK_OK)
        data_checks_tell(&check);
    return st;
}

/* Beyond this share of a joint's motion a prediction is no better than a joint that stands still.
 */
#define USELESS 1.0

/* A prediction that is useless may be one of data that are not what they are taken for, a flipped
 * sign for one: what is certain is said. */
static void say_why_useless(const struct mk_model *model, const struct mk_log *log,
                            const struct mk_predict_figures *figures)
{
    static struct mk_data_check check;
    struct mk_error ignored;
    bool useless = false;
    for (int j = 0; j < mk_model_joints(model); j++)
        useless = useless || figures->nrmse[j] > USELESS;
    if (useless &&
        mk_data_check_logs(model, &log, 1, MK_DATA_IDENTIFY, 1, &check, &ignored) == MK_OK &&
        mk_data_check_fatal(&check))
        data_checks_tell(&check);
}

/* A few commands that are missing are held from before; of more, the prediction would be made up.
 */
#define MAX_MISSING_COMMANDS 0.01 /* share of the rows that are not left out */

static enum mk_status check_commands(const struct mk_model *model, const struct mk_log *log,
                                     struct mk_error *err)
{
    struct mk_record rec;
    enum mk_status st = mk_record_from_log(log, model, &rec, err);
    for (int i = 0; st == MK_OK && i < MK_MAX_INPUTS && rec.u[i]; i++) {
        size_t rows = 0, missing = 0;
        for (size_t k = 0; k < rec.rows; k++) {
            if (rec.left_out && rec.left_out[k] != 0.0)
                continue;
            rows++;
            missing += isnan(rec.u[i][k]) != 0;
        }
        if ((double)missing > MAX_MISSING_COMMANDS * (double)rows)
            st = mk_error_at(
                err, MK_ERR_PARSE, log->path, 0, 0,
                "the command is missing in %zu of %zu rows: at most %g %% may be; "
                "leave these rows out (--from, --to, a column left_out) or fill them in",
                missing, rows, 100.0 * MAX_MISSING_COMMANDS);
        else if (missing)
            fprintf(stderr,
                    "mechkit: %s: the command is missing in %zu of %zu rows: held from "
                    "before\n",
                    show_name(log->path), missing, rows);
    }
    return st;
}

/* Takes what is left out from the log. */
static enum mk_status leave_out(const struct options *o, const struct mk_model *model,
                                struct mk_log **log, struct left_out *left, struct mk_error *err)
{
    enum mk_status st = mk_find_left_out(model, (const struct mk_log *const *)log, 1, &o->rows,
                                         left->list, &left->count, err);
    if (st == MK_OK)
        left_out_warn(left->list, left->count);
    return st == MK_OK ? left_out_apply(log, 1, 0, left->list, left->count, err) : st;
}

/* The solver would give up after minutes, and could not say why. */
static enum mk_status check_stiffness(const struct options *o, const struct mk_model *model,
                                      struct mk_error *err)
{
    struct mk_error why = MK_ERROR_INIT;
    enum mk_status st = mk_model_check_stiffness(model, &why);
    return st == MK_OK ? MK_OK : mk_error_at(err, st, o->model, 0, 0, "%s", why.message);
}

/* Reads model and log, and looks whether the log is fit to drive the model. */
static enum mk_status read_inputs(const struct options *o, struct mk_model *model,
                                  struct mk_log **log, struct left_out *left, struct mk_error *err)
{
    enum mk_status st = mk_model_read(o->model, model, err);
    if (st == MK_OK)
        st = check_stiffness(o, model, err);
    if (st == MK_OK)
        st = mk_log_read(o->input, log, err);
    if (st == MK_OK && (*log)->truncated)
        fprintf(stderr, "mechkit: %s: the last line is incomplete and was left out\n",
                show_name(o->input));
    if (st == MK_OK)
        st = say_extremes(model, *log, err);
    if (st == MK_OK)
        st = leave_out(o, model, log, left, err);
    return st == MK_OK ? check_commands(model, *log, err) : st;
}

/* What is written and printed of a prediction. */
static enum mk_status write_outputs(const struct options *o, const struct mk_model *model,
                                    const struct mk_log *log, const struct mk_log *prediction,
                                    const struct mk_predict_figures *figures,
                                    const struct left_out *left, size_t failed, double seconds,
                                    struct mk_error *err)
{
    double noise[MK_MAX_JOINTS];
    find_noise(log, model, noise);
    enum mk_status st = o->out ? mk_log_write(o->out, prediction, err) : MK_OK;
    if (st == MK_OK && o->json)
        st = write_figures(o, model, figures, left, noise, failed, seconds, err);
    if (st == MK_OK && !is_standard_output(o->json)) {
        left_out_print(stdout, left->list, left->count);
        print_figures(o, model, log, figures, noise, failed);
    }
    return st;
}

static int run(int argc, char **argv)
{
    struct left_out left = {.count = 0};
    struct options o = {0};
    struct arguments none;
    int code = options_parse(&sub_simulate, argc, argv, &o, &none);
    if (code != EXIT_OK)
        return code;
    struct mk_model model;
    struct mk_log *log = NULL, *prediction = NULL;
    struct mk_predict_figures figures;
    struct mk_error err = MK_ERROR_INIT;
    size_t failed = 0;
    enum mk_status st = read_inputs(&o, &model, &log, &left, &err);
    double start = now();
    if (st == MK_OK)
        st = (o.states ? mk_predict_states : mk_predict)(&model, log, &o.predict, &prediction,
                                                         &figures, &failed, &err);
    double seconds = now() - start;
    const bool writing = st == MK_OK;
    if (st == MK_OK)
        say_why_useless(&model, log, &figures);
    if (st == MK_OK)
        st = write_outputs(&o, &model, log, prediction, &figures, &left, failed, seconds, &err);
    mk_log_free(prediction);
    mk_log_free(log);
    return report_end(st, writing, &err);
}
