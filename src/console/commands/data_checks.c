#include "console/commands/data_checks.h"

#include "console/commands/options.h"

enum mk_status log_read_all(const char *const *paths, size_t count, struct mk_log **logs,
                            struct mk_error *err)
{
    enum mk_status st = MK_OK;
    for (size_t i = 0; i < count && st == MK_OK; i++) {
        st = mk_log_read(paths[i], &logs[i], err);
        if (st == MK_OK && logs[i]->truncated)
            fprintf(stderr, "mechkit: %s: the last line is incomplete and was left out\n",
                    show_name(paths[i]));
    }
    return st;
}

void log_take_even_times(struct mk_log **logs, size_t count, const struct mk_model *model)
{
    for (size_t i = 0; i < count; i++)
        if (mk_data_take_even_times(model, logs[i]))
            fprintf(stderr, "mechkit: %s: even times are taken (--keep-all keeps its own)\n",
                    show_name(logs[i]->path));
}

static void print_finding(FILE *out, const char *before, const struct mk_data_finding *f,
                          const char *severity)
{
    fprintf(out, "%s%s: %s", before, severity, show_name(f->file));
    if (f->line > 0)
        fprintf(out, ":%d", f->line);
    fprintf(out, ": %s\n%s  to do: %s\n", show_name(f->what), before, show_name(f->remedy));
}

void data_checks_print(FILE *out, const struct mk_data_check *check)
{
    if (check->count > 0)
        fprintf(out, "Data check:\n");
    for (int i = 0; i < check->count; i++)
        print_finding(out, "  ", &check->finding[i],
                      mk_data_severity_name(check->finding[i].severity));
}

void data_checks_warn(const struct mk_data_check *check)
{
    for (int i = 0; i < check->count; i++)
        print_finding(stderr, "mechkit: ", &check->finding[i],
                      mk_data_severity_name(check->finding[i].severity));
}

void data_checks_tell(const struct mk_data_check *check)
{
    for (int i = 0; i < check->count; i++) {
        const struct mk_data_finding *f = &check->finding[i];
        print_finding(stderr, "mechkit: ", f, f->severity == MK_DATA_FATAL ? "certain" : "doubt");
    }
}

int data_checks_say(const struct mk_data_check *check, bool force)
{
    data_checks_warn(check);
    if (!mk_data_check_fatal(check))
        return EXIT_OK;
    fprintf(stderr, force ? "mechkit: fatal findings are passed over: --force\n"
                          : "mechkit: such data would make every answer meaningless; --force goes "
                            "on all the same\n");
    return force ? EXIT_OK : EXIT_RUN_FAILED;
}
