/* mechkit export: logs and models for MATLAB, Octave, C, Python and spreadsheets. */
#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "console/sub.h"
#include "mechkit/exchange.h"

struct options {
    const char *out, *columns, *model, *variable;
    enum mk_mat_version version;
    char separator;
    bool plain;
    char **logs;
    int log_count;
};

static int parse(int argc, char **argv, struct options *o)
{
    static const struct option names[] = {
        {"out", required_argument, NULL, 'o'},   {"columns", required_argument, NULL, 'c'},
        {"model", required_argument, NULL, 'm'}, {"format", required_argument, NULL, 'f'},
        {"name", required_argument, NULL, 'n'},  {"separator", required_argument, NULL, 's'},
        {"plain", no_argument, NULL, 'p'},       {NULL, 0, NULL, 0}};
    int c;
    opterr = 0;
    optind = 1;
    while ((c = getopt_long(argc, argv, ":", names, NULL)) != -1) {
        switch (c) {
        case 'o':
            o->out = optarg;
            break;
        case 'c':
            o->columns = optarg;
            break;
        case 'm':
            o->model = optarg;
            break;
        case 'f':
            if (strcmp(optarg, "v5") != 0 && strcmp(optarg, "v7.3") != 0)
                return report_usage("export", "--format %s: expected v5 or v7.3", optarg);
            o->version = strcmp(optarg, "v5") == 0 ? MK_MAT_5 : MK_MAT_73;
            break;
        case 'n':
            o->variable = optarg;
            break;
        case 's':
            if (strcmp(optarg, "tab") == 0)
                optarg = (char[]){"\t"};
            if (strlen(optarg) != 1 || !strchr(",;\t ", optarg[0]))
                return report_usage("export", "--separator: expected , or ; or tab");
            o->separator = optarg[0];
            break;
        case 'p':
            o->plain = true;
            break;
        case ':':
            return report_usage("export", "%s needs a value", argv[optind - 1]);
        default:
            return report_usage("export", "unknown option '%s'", argv[optind - 1]);
        }
    }
    if (!o->out)
        return report_usage("export", "--out is missing");
    o->logs = argv + optind;
    o->log_count = argc - optind;
    return EXIT_OK;
}

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
        fprintf(stderr, "mechkit: %s: the last line is incomplete and was left out\n", path);
    if (st == MK_OK)
        st = mk_table_from_log(*log, o->columns, mk_log_u_to_torque(*log, model), table, err);
    *run = (struct mk_mat_run){base_name(path), *log, *table, model};
    return st;
}

static enum mk_status export_logs(const struct options *o, const struct mk_model *model,
                                  struct mk_error *err)
{
    size_t n = (size_t)o->log_count;
    struct mk_mat_run *runs = calloc(n, sizeof *runs);
    struct mk_log **logs = calloc(n, sizeof *logs);
    struct mk_table **tables = calloc(n, sizeof *tables);
    enum mk_status st = MK_OK;
    if (!runs || !logs || !tables)
        st = mk_error_set(err, MK_ERR_NOMEM, "out of memory");
    for (size_t i = 0; st == MK_OK && i < n; i++)
        st = load(o, o->logs[i], model, &runs[i], &logs[i], &tables[i], err);
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
    if (!csv && !ends_with(o->out, ".mat"))
        return report_usage("export", "--out %s: logs go to a .mat or .csv file", o->out);
    if (csv && o->log_count > 1)
        return report_usage("export", "one log a CSV file, please");
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

int sub_export(int argc, char **argv)
{
    struct options o = {.variable = "mk", .separator = ','};
    int code = parse(argc, argv, &o);
    if (code != EXIT_OK)
        return code;
    code = o.log_count > 0 ? check_logs(&o) : check_model(&o);
    if (code != EXIT_OK)
        return code;
    struct mk_model model;
    struct mk_error err = MK_ERROR_INIT;
    enum mk_status st = o.model ? mk_model_read(o.model, &model, &err) : MK_OK;
    if (st == MK_OK)
        st = o.log_count > 0 ? export_logs(&o, o.model ? &model : NULL, &err)
                             : export_model(&o, &model, &err);
    if (st == MK_OK)
        return EXIT_OK;
    return st == MK_ERR_USAGE ? report_usage("export", "%s", err.message) : report_error(&err);
}
