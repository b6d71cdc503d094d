/* mechkit export: logs and models for MATLAB, Octave, C, Python and spreadsheets. */
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "console/commands/options.h"
#include "mechkit/exchange.h"

struct options {
    const char *out, *columns, *model, *variable;
    enum mk_mat_version version;
    char separator;
    bool plain;
    struct arguments logs;
};

static bool take_version(const char *value, void *target)
{
    *(enum mk_mat_version *)target = strcmp(value, "v5") == 0 ? MK_MAT_5 : MK_MAT_73;
    return strcmp(value, "v5") == 0 || strcmp(value, "v7.3") == 0;
}

static bool take_separator(const char *value, void *target)
{
    *(char *)target = strcmp(value, "tab") == 0 ? '\t' : value[0];
    return strcmp(value, "tab") == 0 || (strlen(value) == 1 && strchr(",;\t ", value[0]));
}

static const struct option_row option_rows[] = {
    {"out", OPTION_OUTPUT(out), "FILE", "where it goes; its ending says what it is",
     .required = true},
    {"columns", OPTION_TEXT(columns), "LIST",
     "which, in which unit: t:ms,q1:deg,u:Nm; default: all, in the log's units"},
    {"format", OPTION_CALL(version), "NAME", "of a .mat file: v5 (default) or v7.3 (HDF5)",
     .take = take_version, .wants = "v5 or v7.3"},
    {"name", OPTION_TEXT(variable), "NAME", "of the struct array; default mk"},
    {"model", OPTION_TEXT(model), "M.ini",
     "put the model in; says also how many N m a unit of command is"},
    {"separator", OPTION_CALL(separator), "C",
     "of a CSV: , (default), tab, or ; with decimal commas", .take = take_separator,
     .wants = ", or ; or tab"},
    {"plain", OPTION_FLAG(plain), NULL, "a CSV without # lines of metadata"},
    {0}};

static int run(int argc, char **argv);

const struct subcommand sub_export = {
    .name = "export",
    .summary = "logs and models for MATLAB, Octave, C and others",
    .synopsis = "LOG.csv... --out FILE.mat|FILE.csv [options]\n"
                "--model M.ini --out NAME.m|NAME.c|NAME.fmu",
    .about =
        "A .mat file holds a struct array, an element a log: time, signals, units, parameters,\n"
        "gains, metadata, and the matrix Y with its column names. A .csv file holds one log.\n"
        "\n"
        "Without logs the model itself is written: as a function for Octave and MATLAB (.m), as\n"
        "C with an integrator (.c and .h), or as an FMU for co-simulation (FMI 2.0).\n"
        "docs/matlab.md says how they are used.",
    .options = option_rows,
    .argument = "log",
    .most = INT_MAX,
    .run = run,
};

static bool ends_with(const char *text, const char *end)
{
    size_t n = strlen(text), m = strlen(end);
    return n >= m && strcmp(text + n - m, end) == 0;
}

static const char *base_name(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

static enum mk_status load(const struct options *o, const char *path, const struct mk_model *model,
                           struct mk_mat_run *run, struct mk_log **log, struct mk_table **table,
                           struct mk_error *err)
{
    enum mk_status st = mk_log_read(path, log, err);
    if (st == MK_OK && (*log)->truncated)
        fprintf(stderr, "mechkit: %s: the last line is incomplete and was left out\n",
                show_name(path));
    if (st == MK_OK)
        st = mk_table_from_log(*log, o->columns, mk_log_u_to_torque(*log, model), table, err);
    *run = (struct mk_mat_run){base_name(path), *log, *table, model};
    return st;
}

static enum mk_status export_logs(const struct options *o, const struct mk_model *model,
                                  struct mk_error *err)
{
    size_t n = (size_t)o->logs.count;
    struct mk_mat_run *runs = calloc(n, sizeof *runs);
    struct mk_log **logs = calloc(n, sizeof *logs);
    struct mk_table **tables = calloc(n, sizeof *tables);
    enum mk_status st = MK_OK;
    if (!runs || !logs || !tables)
        st = mk_error_set(err, MK_ERR_NOMEM, "out of memory");
    for (size_t i = 0; st == MK_OK && i < n; i++)
        st = load(o, o->logs.text[i], model, &runs[i], &logs[i], &tables[i], err);
    if (st == MK_OK && ends_with(o->out, ".mat"))
        st = mk_mat_write(o->out, o->version, o->variable, runs, n, err);
    else if (st == MK_OK)
        st = mk_table_write_csv(o->out, tables[0], o->plain ? NULL : logs[0], o->separator, err);
    for (size_t i = 0; i < n; i++) {
        if (logs)
            mk_log_free(logs[i]);
        if (tables)
            mk_table_free(tables[i]);
    }
    free(runs);
    free(logs);
    free(tables);
    return st;
}

static enum mk_status export_model(const struct options *o, const struct mk_model *model,
                                   struct mk_error *err)
{
    if (ends_with(o->out, ".m"))
        return mk_export_octave(o->out, model, err);
    if (ends_with(o->out, ".c"))
        return mk_export_c(o->out, model, err);
    bool compiled = true;
    enum mk_status st = mk_export_fmu(o->out, model, &compiled, err);
    if (st == MK_OK && !compiled)
        fputs("mechkit: there is no C compiler: the FMU has its sources alone\n", stderr);
    return st;
}

static int check_logs(const struct options *o)
{
    bool csv = ends_with(o->out, ".csv");
    if (ends_with(o->logs.text[0], ".ini"))
        return report_usage("export", "%s is a model: --model %s", o->logs.text[0],
                            o->logs.text[0]);
    if (!csv && !ends_with(o->out, ".mat"))
        return report_usage("export", "--out %s: logs go to a .mat or .csv file", o->out);
    if (csv && o->logs.count > 1)
        return report_usage("export", "--out %s: one log a CSV file, please", o->out);
    return EXIT_OK;
}

static int check_model(const struct options *o)
{
    if (!o->model)
        return report_usage("export", "which log, or which --model?");
    if (!ends_with(o->out, ".m") && !ends_with(o->out, ".c") && !ends_with(o->out, ".fmu"))
        return report_usage("export", "--out %s: a model goes to a .m, .c or .fmu file", o->out);
    return EXIT_OK;
}

static int run(int argc, char **argv)
{
    struct options o = {.variable = "mk", .separator = ','};
    int code = options_parse(&sub_export, argc, argv, &o, &o.logs);
    if (code != EXIT_OK)
        return code;
    code = o.logs.count > 0 ? check_logs(&o) : check_model(&o);
    if (code != EXIT_OK)
        return code;
    struct mk_model model;
    struct mk_error err = MK_ERROR_INIT;
    enum mk_status st = o.model ? mk_model_read(o.model, &model, &err) : MK_OK;
    bool writing = st == MK_OK && o.logs.count == 0;
    if (st == MK_OK)
        st = o.logs.count > 0 ? export_logs(&o, o.model ? &model : NULL, &err)
                              : export_model(&o, &model, &err);
    if (st == MK_OK)
        return EXIT_OK;
    if (st == MK_ERR_USAGE) /* of a log's columns, or of the name of a function */
        return report_usage("export", o.logs.count > 0 ? "--columns: %s" : "--out %s", err.message);
    writing |= strcmp(err.file, o.out) == 0;
    return writing ? report_output_error(&err) : report_error(&err);
}
