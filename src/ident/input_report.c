#include "ident/input_report.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* "the command, 9.1 +- 0.07 ms late, following with a time constant of 2 +- 0.1 ms" */
static void name_command(const struct mk_input_comparison *input, char *text, size_t size)
{
    const double ms = 1e3;
    int n = snprintf(text, size, "the command");
    if (input->delay > 0.0)
        n += snprintf(text + n, size - (size_t)n, ", %.3g +- %.1g ms late", ms * input->delay,
                      ms * input->delay_error);
    if (input->lag > 0.0)
        n += snprintf(text + n, size - (size_t)n,
                      ", followed with a time constant of %.3g +- %.1g ms", ms * input->lag,
                      ms * input->lag_error);
}

void mk_input_short(const struct mk_input_comparison *input, char *text, size_t size)
{
    if (input->taken == MK_INPUT_COMMANDED)
        name_command(input, text, size);
    else
        snprintf(text, size, "the measured command");
}

/* "squared error of free runs of 0.5 s down by 60 %, 4 of 4 logs" for the column that is taken, or
 * for the other. */
static void tell_error(const struct mk_input_comparison *input, bool of_commanded, char *text,
                       size_t size)
{
    const double ratio = of_commanded ? input->ratio : 1.0 / input->ratio;
    snprintf(text, size, "squared error of free runs of %g s %s by %.0f %%, less in %d of %d logs",
             input->window_s, ratio < 1.0 ? "down" : "up", 100.0 * fabs(ratio - 1.0),
             of_commanded ? input->better : input->logs - input->better, input->logs);
}

void mk_input_sentence(const struct mk_input_comparison *input, char *text, size_t size)
{
    static const char measured[] = "what was measured of it";
    const bool commanded = input->taken == MK_INPUT_COMMANDED;
    char command[160], error[120];
    name_command(input, command, sizeof command - 1);
    if (input->delay > 0.0 || input->lag > 0.0)
        strcat(command, ",");
    tell_error(input, commanded == input->changed, error, sizeof error);
    if (input->changed && commanded)
        snprintf(text, size, "%s predicts the logs left out better than %s: %s", command, measured,
                 error);
    else if (input->changed)
        snprintf(text, size,
                 "the measured command predicts the logs left out better than %s sent: %s",
                 "what was", error);
    else if (commanded)
        snprintf(text, size,
                 "%s is taken, as the model says: %s does not surely predict the logs left out "
                 "better (%s)",
                 command, measured, error);
    else
        snprintf(text, size,
                 "the measured command is taken: %s does not surely predict the logs left out "
                 "better (%s)",
                 command, error);
}

static void add_late(cJSON *to, const char *name, double value, double error)
{
    cJSON *o = cJSON_AddObjectToObject(to, name);
    cJSON_AddItemToObject(o, "value", mk_json_number(value));
    cJSON_AddItemToObject(o, "stderr", mk_json_number(error));
    cJSON_AddStringToObject(o, "unit", "s");
}

cJSON *mk_input_json(const struct mk_input_comparison *input)
{
    char what[400];
    cJSON *o = cJSON_CreateObject();
    const size_t joints = (size_t)mk_model_joints(&input->model);
    mk_input_sentence(input, what, sizeof what);
    cJSON_AddStringToObject(o, "taken", mk_input_name(input->taken));
    cJSON_AddBoolToObject(o, "changed", input->changed);
    cJSON_AddStringToObject(o, "what", what);
    cJSON *left_out = cJSON_AddObjectToObject(o, "logs_left_out");
    cJSON_AddItemToObject(left_out, "logs", cJSON_CreateNumber(input->logs));
    cJSON_AddItemToObject(left_out, "commanded_better", cJSON_CreateNumber(input->better));
    cJSON_AddItemToObject(left_out, "window_s", mk_json_number(input->window_s));
    for (int i = MK_INPUT_MEASURED; i < MK_INPUT_COUNT; i++) {
        char name[32];
        snprintf(name, sizeof name, "nrmse_%s", mk_input_name((enum mk_input)i));
        cJSON_AddItemToObject(left_out, name, mk_json_numbers(input->nrmse[i], joints));
    }
    cJSON_AddItemToObject(left_out, "squared_error_ratio", mk_json_number(input->ratio));
    cJSON_AddItemToObject(left_out, "squared_error_ratio_log_stderr",
                          mk_json_number(input->log_error));
    if (input->delay > 0.0)
        add_late(o, "delay", input->delay, input->delay_error);
    if (input->lag > 0.0)
        add_late(o, "lag", input->lag, input->lag_error);
    return o;
}
