/* What the steps of an investigation share: what they tell, whether they are to go on, what the
 * journal says was done and spent. */
#include "investigate/investigation.h"

#include <stdarg.h>
#include <stdio.h>
#include <time.h>

#include "investigate/notebook.h"

void investigation_say(const struct investigation *v, const char *format, ...)
{
    char line[1400];
    va_list args;
    va_start(args, format);
    vsnprintf(line, sizeof line, format, args);
    va_end(args);
    if (v->o->say)
        v->o->say(v->o->user, line);
}

bool investigation_cancelled(const struct investigation *v)
{
    return v->o->cancel && __atomic_load_n(v->o->cancel, __ATOMIC_ACQUIRE);
}

bool investigation_goes_on(void *context, double done, const char *what)
{
    const struct investigation *v = context;
    if (v->o->progress)
        (void)v->o->progress(v->o->user, done, what);
    return !investigation_cancelled(v);
}

double investigation_now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

enum mk_status investigation_save(struct investigation *v, struct mk_error *err)
{
    enum mk_status st = journal_save(v->j, err);
    return st == MK_OK ? notebook_write(v->j, err) : st;
}

struct experiment *investigation_last(const struct investigation *v)
{
    return v->j->count > 0 ? &v->j->experiment[v->j->count - 1] : NULL;
}

int investigation_counted(const struct journal *j)
{
    int n = 0;
    for (int i = 0; i < j->count; i++)
        n += !j->experiment[i].broken_off;
    return n;
}

int investigation_faults(const struct journal *j)
{
    int n = 0;
    for (int i = 0; i < j->count; i++)
        n += j->experiment[i].fault[0] != '\0' && !j->experiment[i].broken_off;
    return n;
}

double investigation_spent_s(const struct journal *j)
{
    double s = j->look_s;
    for (int i = 0; i < j->count; i++)
        s += j->experiment[i].rig_s + j->experiment[i].compute_s;
    return s;
}
