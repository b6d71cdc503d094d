/* Which value of every axis a run of a sweep has, and a line of its result. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "experiment/sweep.h"
#include "mechkit/number.h"

int sweep_find(const struct sweep *s, const char *name)
{
    for (int i = 0; i < s->axis_count; i++)
        if (strcmp(s->axis[i].name, name) == 0)
            return i;
    return -1;
}

int sweep_at(const struct sweep *s, size_t index, int axis)
{
    size_t point = sweep_point(s, index);
    while (s->axis[axis].with_last)
        axis--;
    for (int i = s->axis_count - 1; i > axis; i--)
        point /= s->axis[i].with_last ? 1 : (size_t)s->axis[i].count;
    return (int)(point % (size_t)s->axis[axis].count);
}

double sweep_number(const struct sweep *s, size_t index, const char *name, double otherwise)
{
    int axis = sweep_find(s, name);
    return axis < 0 ? otherwise : s->axis[axis].value[sweep_at(s, index, axis)];
}

const char *sweep_word(const struct sweep *s, size_t index, const char *name, const char *otherwise)
{
    int axis = sweep_find(s, name);
    return axis < 0 ? otherwise : s->axis[axis].word[sweep_at(s, index, axis)];
}

const char *sweep_value_text(const struct sweep_axis *a, int at, char buf[SWEEP_WORD])
{
    if (a->word)
        snprintf(buf, SWEEP_WORD, "%s", a->word[at]);
    else
        mk_format_double(buf, a->value[at]);
    return buf;
}

void sweep_put(char text[SWEEP_LINE], int column, double x)
{
    char number[MK_NUMBER_MAX] = "";
    if (!isnan(x))
        mk_format_double(number, x);
    size_t used = strlen(text);
    snprintf(text + used, SWEEP_LINE - used, "%s%s", column ? "," : "", number);
}

enum mk_status sweep_refuse(const struct sweep *s, const struct sweep_axis *a, struct mk_error *err,
                            const char *fmt, ...)
{
    char text[400];
    va_list args;
    va_start(args, fmt);
    vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    return mk_error_at(err, MK_ERR_PARSE, s->path, a->line, 0, "%s: %s", a->name, text);
}
