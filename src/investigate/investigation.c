/* What the steps of an investigation tell, and whether they are to go on. */
#include <stdarg.h>
#include <stdio.h>

#include "investigate/investigation.h"

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
