#include "investigate/doubt.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "mechkit/loop.h"

static const char *const angle[MK_MAX_JOINTS] = {"q1", "q2"};

/* The row that saw the fault; all of them: there is none. */
static size_t fault_row(const struct mk_log *log)
{
    const double *flags = mk_log_get(log, "flags");
    for (size_t k = 0; flags && k < log->rows; k++)
        if (flags[k] >= 0.0 && (unsigned)flags[k] & MK_FLAG_FAULT)
            return k;
    return log->rows;
}

static bool is_of(const char *noted, enum mk_fault fault)
{
    const char *name = mk_fault_name(fault);
    const size_t n = strlen(name);
    return strncmp(noted, name, n) == 0 && noted[n] == ' ';
}

/* How many of the first `rows` rows end with a reading that is another than the one before. */
static size_t until_it_stood_still(const double *q, size_t rows)
{
    size_t last = rows; /* the newest reading that there is */
    for (size_t k = rows; k-- > 0;) {
        if (isnan(q[k]))
            continue;
        if (last < rows && q[k] != q[last])
            return last + 1;
        last = k;
    }
    return 0;
}

void doubt_cut(struct mk_log *log, const struct mk_model *model)
{
    const char *noted = mk_log_find_meta(log, "fault");
    size_t rows = fault_row(log);
    int joint = 0; /* 1-based; 0: any */
    if (rows == log->rows)
        return;
    if (noted && (is_of(noted, MK_FAULT_STUCK) || is_of(noted, MK_FAULT_JUMP))) {
        const char *told = strstr(noted, " joint ");
        (void)(told && sscanf(told, " joint %d", &joint));
        for (int j = 0; j < mk_model_joints(model); j++) {
            const double *q = mk_log_get(log, angle[j]);
            if (q && (joint == 0 || joint == j + 1)) {
                const size_t moved = until_it_stood_still(q, rows);
                rows = moved < rows ? moved : rows;
            }
        }
    }
    log->rows = rows;
}
