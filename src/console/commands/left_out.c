#include "console/commands/left_out.h"

#include <math.h>

#include "console/commands/sub.h"
#include "mechkit/number.h"

bool left_out_take_seconds(const char *value, void *target)
{
    double *s = target;
    return mk_parse_double_z(value, s) && *s >= 0.0 && isfinite(*s);
}

void left_out_warn(const struct mk_left_out *all, int count)
{
    for (int i = 0; i < count; i++)
        if (all[i].joint > 0)
            fprintf(stderr,
                    "mechkit: %s: %.2f to %.2f s are left out: %s (--keep-all keeps them)\n",
                    show_name(all[i].file), all[i].from_s, all[i].to_s, all[i].why);
}

void left_out_print(FILE *out, const struct mk_left_out *all, int count)
{
    for (int i = 0; i < count; i++) {
        fprintf(out, "Left out: %s, %.2f to %.2f s", show_name(all[i].file), all[i].from_s,
                all[i].to_s);
        if (all[i].joint > 0)
            fprintf(out, " (foreign contact at joint %d)", all[i].joint);
        fprintf(out, "\n");
    }
}

enum mk_status left_out_apply(struct mk_log **logs, size_t log_count, size_t first,
                              const struct mk_left_out *all, int count, struct mk_error *err)
{
    for (size_t i = 0; i < log_count; i++) {
        struct mk_log *copy = NULL;
        enum mk_status st = mk_leave_out(logs[i], first + i, all, count, &copy, err);
        if (st != MK_OK)
            return st;
        if (!copy)
            continue;
        mk_log_free(logs[i]);
        logs[i] = copy;
    }
    return MK_OK;
}
