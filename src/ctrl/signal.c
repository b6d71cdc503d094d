#include "mechkit/signal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "ctrl/signal_priv.h"
#include "mechkit/log.h"

/* --- creation ---------------------------------------------------------------------------- */

static enum mk_status load_samples(struct mk_signal *s, const char *path, struct mk_error *err)
{
    enum mk_status st = mk_log_read(path, &s->log, err);
    if (st != MK_OK)
        return st;
    s->t = mk_log_get(s->log, "t");
    s->u = mk_log_get(s->log, "u");
    s->rows = s->log->rows;
    if (!s->u)
        return mk_error_at(err, MK_ERR_PARSE, path, 0, 0, "a sampled signal needs columns t and u");
    for (size_t i = 0; i < s->rows; i++)
        if (!isfinite(s->u[i]))
            return mk_error_at(err, MK_ERR_PARSE, path, s->log->first_row_line + (int)i, 0,
                               "u must be a number in every row");
    return MK_OK;
}

enum mk_status mk_signal_create(const char *text, struct mk_signal **out, struct mk_error *err)
{
    *out = NULL;
    struct mk_signal *s = calloc(1, sizeof *s);
    if (!s || !(s->text = strdup(text))) {
        free(s);
        return mk_error_set(err, MK_ERR_NOMEM, "out of memory");
    }
    const char *at = text + strspn(text, " \t");
    enum mk_status st = *at == '@' ? load_samples(s, at + 1, err) : mk_signal_parse(s, text, err);
    if (st != MK_OK)
        mk_signal_destroy(s);
    else
        *out = s;
    return st;
}

void mk_signal_destroy(struct mk_signal *signal)
{
    if (!signal)
        return;
    mk_log_free(signal->log);
    free(signal->text);
    free(signal);
}

const char *mk_signal_text(const struct mk_signal *signal)
{
    return signal->text;
}

double mk_signal_duration(const struct mk_signal *signal)
{
    return signal->log ? signal->t[signal->rows - 1] : (double)INFINITY;
}

/* --- evaluation -------------------------------------------------------------------------- */

/* Value held since the last sample at or before t; 0 before the first and after the last. */
static double sample_at(const struct mk_signal *s, double t)
{
    /* Half a nanosecond: the loop's clock and the file's decimals round differently. */
    t += 5e-10;
    if (!(t >= s->t[0]) || t > s->t[s->rows - 1] + 1e-9)
        return 0.0;
    size_t low = 0, high = s->rows;
    while (high - low > 1) {
        size_t mid = low + (high - low) / 2;
        if (s->t[mid] <= t)
            low = mid;
        else
            high = mid;
    }
    return s->u[low];
}

double mk_signal_at(const struct mk_signal *s, double t)
{
    return s->log ? sample_at(s, t) : mk_signal_execute(s->code, s->count, t);
}
