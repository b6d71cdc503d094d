/* mechkit robustness: many rigs a setup, none what the controller believes. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/out_file.h"
#include "console/commands/options.h"
#include "ctrl/ctrl_rig.h"
#include "experiment/linear.h"
#include "experiment/robustness.h"
#include "mechkit/json.h"
#include "mechkit/loop.h"

#define SEEDS_MAX 100000
#define PASS_SHARE 0.95

struct options {
    const char *setup, *json;
    int seeds;
    uint64_t first;
    struct trial_spread spread;
};

struct outcome {
    const struct mk_ctrl_ops *setup;
    struct mk_model nominal_model;
    struct trial nominal;
    struct trial *trial; /* `count` of them */
    int count, held, falls;
    double median_s, p95_s, longest_s; /* time of the catch that held; NAN: none held */
    double u_peak;
    double seconds; /* of the machine's time */
};

/* The setups of the command: those that hold an equilibrium. */
static bool balances(const struct mk_ctrl_ops *setup)
{
    return linear_equilibrium(mk_ctrl_first_rig(setup), setup->name) != NULL;
}

static bool take_setup(const char *value, void *target)
{
    const struct mk_ctrl_ops *setup = mk_ctrl_setup_by_name(value);
    *(const char **)target = value;
    return setup && balances(setup);
}

static const struct option_row option_rows[] = {
    {"setup", OPTION_CALL(setup), "NAME", "one setup; default: all that balance",
     .take = take_setup, .wants = "a setup that balances: pendubot-mid, furuta, ..."},
    {"swingup", OPTION_TEXT(spread.swingup), "FILE",
     "the trajectory that the setup follows, with --setup (docs/swingup.md)"},
    {"seeds", OPTION_COUNT(seeds), "N", "rigs a setup; default 200", 1, SEEDS_MAX},
    {"first", OPTION_SEED(first), "N", "seed of the first; default 1", 1, 9e15},
    {"delay", OPTION_COUNT(spread.delay_samples), "N",
     "samples of delay beyond the board's own; default 1", 0, 100},
    {"rate", OPTION_NUMBER(spread.rate_hz), "HZ", "samples per second; default 500",
     MK_LOOP_RATE_MIN_HZ, MK_LOOP_RATE_MAX_HZ},
    {"json", OPTION_FIGURES(json), "FILE", "the figures; \"-\": standard output"},
    {0}};

static int run(int argc, char **argv);

const struct subcommand sub_robustness = {
    .name = "robustness",
    .summary = "catch and hold rigs that differ from what the controller believes",
    .synopsis = "[options]",
    .about =
        "Runs each balancing setup on the virtual board, in simulated time, on rigs whose "
        "parameters\n"
        "are 10 % and friction 30 % off, with one more sample of delay and encoders zeroed up to "
        "2\n"
        "counts off. Prints how many were caught within 15 s and held for 10 s, and what failed.\n"
        "Exit code 1 when a setup holds less than 95 %.",
    .options = option_rows,
    .argument = "setup",
    .argument_is_name = true,
    .run = run,
};

static int by_size(const void *a, const void *b)
{
    double d = *(const double *)a - *(const double *)b;
    return (d > 0.0) - (d < 0.0);
}

/* The catch times of the runs that held, summed up. */
static enum mk_status sum_up(struct outcome *o, struct mk_error *err)
{
    double *times = malloc((size_t)o->count * sizeof *times);
    if (!times)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for %d runs", o->count);
    for (int i = 0; i < o->count; i++) {
        const struct trial *t = &o->trial[i];
        o->falls += t->falls;
        o->u_peak = fmax(o->u_peak, t->u_peak);
        if (t->end == TRIAL_HELD)
            times[o->held++] = t->caught_s;
    }
    qsort(times, (size_t)o->held, sizeof *times, by_size);
    o->median_s = o->held ? times[o->held / 2] : (double)NAN;
    o->p95_s = o->held ? times[(int)ceil(0.95 * o->held) - 1] : (double)NAN;
    o->longest_s = o->held ? times[o->held - 1] : (double)NAN;
    free(times);
    return MK_OK;
}

static enum mk_status run_setup(const struct mk_ctrl_ops *setup, const struct options *options,
                                struct outcome *o, struct mk_error *err)
{
    memset(o, 0, sizeof *o);
    o->setup = setup;
    mk_model_default(mk_ctrl_first_rig(o->setup), &o->nominal_model);
    o->trial = calloc((size_t)options->seeds, sizeof *o->trial);
    if (!o->trial)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for %d runs", options->seeds);
    clock_t start = clock();
    enum mk_status st =
        trial_run(o->setup, &o->nominal_model, &options->spread, 0, &o->nominal, err);
    for (int i = 0; i < options->seeds && st == MK_OK; i++, o->count++)
        st = trial_run(o->setup, &o->nominal_model, &options->spread, options->first + (uint64_t)i,
                       &o->trial[i], err);
    o->seconds = (double)(clock() - start) / CLOCKS_PER_SEC;
    return st == MK_OK ? sum_up(o, err) : st;
}

/* --- report ------------------------------------------------------------------------------ */

static void print_heading(const struct options *o)
{
    const struct trial_spread *s = &o->spread;
    printf(
        "%d rig%s a setup: parameters +-%g %%, friction +-%g %%, encoder zero +-%g counts, "
        "%d sample%s more delay, %g Hz\n"
        "held: caught within %g s and then held for %g s; nominal: caught, then held for 20 s\n\n"
        "%-15s %8s %9s %9s %7s %7s %7s %6s %6s %8s\n",
        o->seeds, o->seeds == 1 ? "" : "s", 100.0 * s->parameters, 100.0 * s->friction,
        s->offset_counts, s->delay_samples, s->delay_samples == 1 ? "" : "s", s->rate_hz,
        s->catch_s, s->hold_s, "setup", "nominal", "held", "share", "median", "p95", "longest",
        "falls", "peak", "took");
}

static void print_outcome(const struct outcome *o)
{
    char nominal[24];
    if (o->nominal.end == TRIAL_HELD)
        snprintf(nominal, sizeof nominal, "%.2f s", o->nominal.caught_s);
    else
        snprintf(nominal, sizeof nominal, "%s", "FAILED");
    printf("%-15s %8s %4d/%-4d %7.1f %% %5.2f s %5.2f s %5.2f s %6d %6.2f %6.1f s\n",
           o->setup->name, nominal, o->held, o->count, 100.0 * o->held / o->count, o->median_s,
           o->p95_s, o->longest_s, o->falls, o->u_peak, o->seconds);
}

static void print_failures(const struct outcome *o)
{
    const struct mk_plant_info *plant = mk_plant(o->nominal_model.plant);
    for (int i = 0; i < o->count; i++) {
        const struct trial *t = &o->trial[i];
        if (t->end == TRIAL_HELD)
            continue;
        printf("  seed %llu: %s%s%s, %d falls; rig:", (unsigned long long)t->seed,
               trial_end_name(t->end), t->fault[0] ? " " : "", t->fault, t->falls);
        for (int k = 0; k < plant->parameter_count; k++)
            printf(" %s %+.0f %%", plant->parameter[k].name,
                   100.0 * (t->rig.parameter[k] / o->nominal_model.parameter[k] - 1.0));
        putchar('\n');
    }
}

static cJSON *failures_json(const struct outcome *o)
{
    cJSON *list = cJSON_CreateArray();
    for (int i = 0; i < o->count; i++) {
        const struct trial *t = &o->trial[i];
        if (t->end == TRIAL_HELD)
            continue;
        cJSON *row = cJSON_CreateObject();
        cJSON_AddItemToObject(row, "seed", mk_json_number((double)t->seed));
        cJSON_AddStringToObject(row, "why", trial_end_name(t->end));
        cJSON_AddStringToObject(row, "fault", t->fault);
        cJSON_AddItemToObject(row, "falls", mk_json_number(t->falls));
        cJSON_AddItemToArray(list, row);
    }
    return list;
}

static cJSON *outcome_json(const struct outcome *o)
{
    cJSON *row = cJSON_CreateObject();
    cJSON_AddStringToObject(row, "setup", o->setup->name);
    cJSON_AddItemToObject(row, "nominal_caught_s", mk_json_number(o->nominal.caught_s));
    cJSON_AddItemToObject(row, "rigs", mk_json_number(o->count));
    cJSON_AddItemToObject(row, "held", mk_json_number(o->held));
    cJSON_AddItemToObject(row, "share", mk_json_number((double)o->held / o->count));
    cJSON_AddItemToObject(row, "caught_median_s", mk_json_number(o->median_s));
    cJSON_AddItemToObject(row, "caught_p95_s", mk_json_number(o->p95_s));
    cJSON_AddItemToObject(row, "caught_longest_s", mk_json_number(o->longest_s));
    cJSON_AddItemToObject(row, "falls", mk_json_number(o->falls));
    cJSON_AddItemToObject(row, "peak_command", mk_json_number(o->u_peak));
    cJSON_AddItemToObject(row, "seconds", mk_json_number(o->seconds));
    cJSON_AddItemToObject(row, "failures", failures_json(o));
    return row;
}

static bool passed(const struct outcome *o)
{
    return o->nominal.end == TRIAL_HELD && o->held >= PASS_SHARE * o->count;
}

/* Whether the setup is asked for, or could be meant. */
static bool is_meant(const struct options *o, const struct mk_ctrl_ops *setup)
{
    return balances(setup) && (!o->setup || strcmp(o->setup, setup->name) == 0);
}

/* All trials of a setup, printed and added to the report. `code`: how the program ends, which a
 * setup that does not pass makes EXIT_RUN_FAILED. */
static enum mk_status try_setup(const struct options *o, const struct mk_ctrl_ops *setup,
                                cJSON *root, int *code, struct mk_error *err)
{
    struct outcome outcome;
    enum mk_status st = run_setup(setup, o, &outcome, err);
    if (st == MK_OK && !is_standard_output(o->json)) {
        print_outcome(&outcome);
        print_failures(&outcome);
        fflush(stdout);
    }
    if (st == MK_OK) {
        cJSON_AddItemToArray(root, outcome_json(&outcome));
        *code = passed(&outcome) ? *code : EXIT_RUN_FAILED;
    }
    free(outcome.trial);
    return st;
}

static int run(int argc, char **argv)
{
    struct options o = {.seeds = 200, .first = 1};
    trial_spread_default(&o.spread);
    struct arguments none;
    int code = options_parse(&sub_robustness, argc, argv, &o, &none);
    if (code != EXIT_OK)
        return code;
    if (o.spread.swingup && !o.setup)
        return report_usage("robustness", "--swingup goes with --setup: it is a trajectory of one");
    struct mk_error err = MK_ERROR_INIT;
    if (mk_out_file_check(o.json, &err) != MK_OK)
        return report_output_error(&err);
    cJSON *root = cJSON_CreateArray();
    if (!is_standard_output(o.json))
        print_heading(&o);
    const struct mk_ctrl_ops *setup;
    for (int i = 0; (setup = mk_ctrl_setup(i)) != NULL; i++)
        if (is_meant(&o, setup) && try_setup(&o, setup, root, &code, &err) != MK_OK) {
            code = report_error(&err);
            break;
        }
    if (o.json && mk_json_write(o.json, root, &err) != MK_OK)
        code = report_output_error(&err);
    cJSON_Delete(root);
    return code;
}
