/* mechkit import: logs from other people's files, and whether they can be what they are said to be.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/text.h"
#include "console/commands/options.h"
#include "mechkit/exchange.h"
#include "mechkit/json.h"

struct options {
    const char *file, *out, *map, *rig, *fixed, *json;
    bool force;
};

static const struct option_row option_rows[] = {
    {"map", OPTION_TEXT(map), "M.map", "what the columns mean (docs/formats.md)"},
    {"rig", OPTION_TEXT(rig), "KIND",
     "instead of a mapping: the kind of rig (docs/formats.md); the columns go by their names"},
    {"out", OPTION_OUTPUT(out), "LOG.csv", "the log"},
    {"write-map", OPTION_OUTPUT(fixed), "M.map", "the mapping, with what is proposed",
     .replaces = "map"},
    {"force", OPTION_FLAG(force), NULL, "write the log whatever speaks against it"},
    {"json", OPTION_FIGURES(json), "FILE", "what was assumed and found; \"-\": standard output"},
    {0}};

static int run(int argc, char **argv);

const struct subcommand sub_import = {
    .name = "import",
    .summary = "logs from other people's files, and whether they can be true",
    .synopsis = "FILE --map M.map|--rig KIND [--out LOG.csv] [options]",
    .about =
        "Reads text with columns (also .gz) or a .mat file. A mapping says which column is what, "
        "in\n"
        "which unit, sign and offset (docs/formats.md); without one the names of the columns do.\n"
        "Says what was assumed and checks it against how rigs move: unit of time and angles,\n"
        "gravity, sign of the command, joints swapped. What cannot be is not written, and a mend\n"
        "is proposed: exit code 1. What is only doubted is said, and the log is written.",
    .options = option_rows,
    .argument = "file",
    .least = 1,
    .most = 1,
    .run = run,
};

static int check(const struct options *o)
{
    if (!o->map && !o->rig)
        return report_usage("import", "--map or --rig is missing");
    if (o->rig && !mk_plant_by_name(o->rig))
        return report_usage("import", "--rig %s: expected %s", o->rig, mk_plant_names());
    if (o->map && o->rig)
        return report_usage("import", "the rig stands in the map: --map or --rig, not both");
    if (!o->out && !o->fixed && !o->json)
        return report_usage("import", "--out, --write-map or --json is missing");
    return EXIT_OK;
}

/* --- what was assumed ------------------------------------------------------------------- */

/* The unit of a column of the log; "": none that import knows. */
static const char *unit_of(const struct mk_import_map *map, const char *column)
{
    const int motor = mk_plant(map->rig)->motor_joint;
    if (strcmp(column, "t") == 0)
        return "s";
    if (strcmp(column, "u") == 0 || strcmp(column, "u_cmd") == 0)
        return "units of the command";
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        const char *const names[][2] = {{"q1", "q2"}, {"dq1", "dq2"}, {"tau1", "tau2"}};
        const char *const units[][2] = {{"rad", "m"}, {"rad/s", "m/s"}, {"N m", "N"}};
        for (int k = 0; k < 3; k++)
            if (strncmp(column, names[k][j], strlen(names[k][j])) == 0)
                return units[k][map->joint_linear[j]];
    }
    return strncmp(column, "tau", 3) == 0 ? map->joint_linear[motor] ? "N" : "N m" : "";
}

/* From where to where a column goes, in the log's unit: whether it was taken rightly is seen there.
 */
static void print_range(const struct mk_import_map *map, const struct mk_log *log,
                        const char *column)
{
    const double *x = mk_log_get(log, column);
    double low = (double)INFINITY, high = (double)-INFINITY;
    for (size_t k = 0; x && k < log->rows; k++)
        low = fmin(low, x[k]), high = fmax(high, x[k]);
    if (low <= high)
        printf("  (%.4g .. %.4g%s%s)", low, high, *unit_of(map, column) ? " " : "",
               unit_of(map, column));
}

static void print_column(const struct mk_import_column *c, const struct mk_import_map *map,
                         const struct mk_log *log)
{
    char from[4 * sizeof c->from];
    printf("  %-5s = ", c->to);
    if (c->sign == -1.0)
        fputs("-", stdout);
    else if (c->sign != 1.0)
        printf("%g * ", c->sign);
    if (c->sign != 1.0 && (*c->plus || *c->minus))
        fputs("(", stdout);
    fputs(mk_show_text(from, sizeof from, c->from), stdout);
    if (*c->plus)
        printf(" + %s", mk_show_text(from, sizeof from, c->plus));
    if (*c->minus)
        printf(" - %s", mk_show_text(from, sizeof from, c->minus));
    if (c->sign != 1.0 && (*c->plus || *c->minus))
        fputs(")", stdout);
    if (*c->unit)
        printf(" [%s]", show_name(c->unit));
    if (c->offset != 0.0)
        printf(" %c %.6g", c->offset < 0.0 ? '-' : '+', c->offset < 0.0 ? -c->offset : c->offset);
    print_range(map, log, c->to);
    putchar('\n');
}

static void print_map(const struct options *o, const struct mk_import_map *map,
                      const struct mk_table *table, const struct mk_log *log)
{
    printf("%s: %zu rows, taken for those of the %s%s\n", show_name(o->file), table->rows,
           mk_plant(map->rig)->name, o->map ? "" : ", columns by their names");
    for (int i = 0; i < map->count; i++)
        print_column(&map->column[i], map, log);
    if (map->no_input)
        puts("  no command: nothing drove the rig");
    if (*table->left_out)
        printf("  left out: %s\n", show_name(table->left_out));
}

/* Where the doubts of other commands go: standard output is for what was taken from the file. */
static void print_findings(const struct options *o, const struct mk_import_finding *findings,
                           int count)
{
    for (int i = 0; i < count; i++) {
        fprintf(stderr, "mechkit: %s: %s: %s\n", findings[i].certain ? "fatal" : "doubt",
                show_name(o->file), show_name(findings[i].what));
        fprintf(stderr, "mechkit:   to do: %s%s\n",
                *findings[i].proposal ? "if so, change the mapping: " : "look at the data",
                show_name(findings[i].proposal));
    }
}

static bool is_fatal(const struct mk_import_finding *findings, int count)
{
    bool fatal = false;
    for (int i = 0; i < count; i++)
        fatal = fatal || findings[i].certain;
    return fatal;
}

static enum mk_status write_report(const struct options *o, const struct mk_import_map *map,
                                   const struct mk_import_finding *findings, int count,
                                   struct mk_error *err)
{
    cJSON *root = cJSON_CreateObject(), *columns = cJSON_AddObjectToObject(root, "columns");
    cJSON *list = cJSON_AddArrayToObject(root, "findings");
    cJSON_AddStringToObject(root, "file", o->file);
    cJSON_AddStringToObject(root, "rig", mk_plant(map->rig)->name);
    for (int i = 0; i < map->count; i++) {
        const struct mk_import_column *c = &map->column[i];
        cJSON *item = cJSON_AddObjectToObject(columns, c->to);
        cJSON_AddStringToObject(item, "column", c->from);
        if (*c->plus)
            cJSON_AddStringToObject(item, "plus", c->plus);
        if (*c->minus)
            cJSON_AddStringToObject(item, "minus", c->minus);
        cJSON_AddStringToObject(item, "unit", c->unit);
        cJSON_AddItemToObject(item, "sign", mk_json_number(c->sign));
        cJSON_AddItemToObject(item, "offset", mk_json_number(c->offset));
    }
    for (int i = 0; i < count; i++) {
        cJSON *item = cJSON_CreateObject();
        cJSON_AddStringToObject(item, "severity", findings[i].certain ? "fatal" : "doubt");
        cJSON_AddStringToObject(item, "what", findings[i].what);
        cJSON_AddStringToObject(item, "proposal", findings[i].proposal);
        cJSON_AddItemToArray(list, item);
    }
    enum mk_status st = mk_json_write(o->json, root, err);
    cJSON_Delete(root);
    return st;
}

/* --- the command ------------------------------------------------------------------------ */

static void use_rig(struct mk_import_map *map, const struct mk_plant_info *plant)
{
    map->rig = plant->kind;
    for (int j = 0; j < plant->joints; j++)
        map->joint_linear[j] = plant->joint_motion[j] == MK_JOINT_SLIDES;
}

static enum mk_status find_map(const struct options *o, struct mk_import_map *map,
                               struct mk_table **table, struct mk_error *err)
{
    enum mk_status st = MK_OK;
    memset(map, 0, sizeof *map);
    if (o->map)
        st = mk_import_map_read(o->map, map, err);
    else
        use_rig(map, mk_plant_by_name(o->rig));
    if (st == MK_OK)
        st = mk_import_open(o->file, map, table, err);
    if (st == MK_OK && !o->map)
        st = mk_import_guess(*table, o->file, map, err);
    return st;
}

static enum mk_status write_outputs(const struct options *o, const struct mk_log *log,
                                    const struct mk_import_map *map,
                                    const struct mk_import_finding *findings, int count,
                                    struct mk_error *err)
{
    enum mk_status st = MK_OK;
    if (o->out && (!is_fatal(findings, count) || o->force))
        st = mk_log_write(o->out, log, err);
    if (st == MK_OK && o->fixed)
        st = mk_import_map_write(o->fixed, count > 0 ? &findings[count - 1].fixed : map, NULL, err);
    if (st == MK_OK && o->json)
        st = write_report(o, map, findings, count, err);
    if (st == MK_OK && count > 0 && o->out)
        fprintf(stderr, "mechkit: %s: %s\n", show_name(o->out),
                o->force || !is_fatal(findings, count)
                    ? "written all the same"
                    : "not written: mend the map, or use --force");
    return st;
}

static int run(int argc, char **argv)
{
    struct options o = {0};
    struct arguments files;
    int code = options_parse(&sub_import, argc, argv, &o, &files);
    if (code == EXIT_OK)
        code = check(&o);
    if (code != EXIT_OK)
        return code;
    o.file = files.text[0];
    struct mk_import_map map;
    struct mk_import_finding findings[MK_IMPORT_FINDINGS];
    struct mk_table *table = NULL;
    struct mk_log *log = NULL;
    struct mk_error err = MK_ERROR_INIT;
    int count = 0;
    enum mk_status st = find_map(&o, &map, &table, &err);
    if (st == MK_OK)
        st = mk_import_apply(table, o.file, &map, &log, &err);
    const bool writing = st == MK_OK;
    if (st == MK_OK) {
        count = mk_import_check(table, o.file, &map, findings);
        if (!is_standard_output(o.json))
            print_map(&o, &map, table, log);
        fflush(stdout);
        print_findings(&o, findings, count);
        st = write_outputs(&o, log, &map, findings, count, &err);
    }
    mk_log_free(log);
    mk_table_free(table);
    if (st != MK_OK)
        return report_end(st, writing, &err);
    return is_fatal(findings, count) && !o.force ? EXIT_RUN_FAILED : EXIT_OK;
}
