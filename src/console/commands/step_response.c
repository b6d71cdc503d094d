#include "console/commands/step_response.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>

/* Smaller jumps, as a share of what is left to go, are rounding. */
#define JUMP_LEAST 1e-9
/* Times the change from one sample to the next of a ramp that ends there. */
#define RAMP_CORNER 3.0

/* The readings of one step: rows [first, last) with the same reference. */
struct stretch {
    const double *t, *y;
    size_t first, last;
    double from, to;
};

/* How far the step has come at a row: 0 where it began, 1 at the new reference. */
static double progress(const struct stretch *s, size_t row)
{
    return (s->y[row] - s->from) / (s->to - s->from);
}

/* Time at which the step first comes so far, between rows; NAN: never. */
static double time_of(const struct stretch *s, double share)
{
    double t0 = s->t[s->first], p0 = 0.0;
    for (size_t i = s->first; i < s->last; i++) {
        double p = progress(s, i);
        if (isnan(p))
            continue;
        if (p >= share)
            return p > p0 ? t0 + (s->t[i] - t0) * (share - p0) / (p - p0) : s->t[i];
        t0 = s->t[i];
        p0 = p;
    }
    return (double)NAN;
}

static double overshoot(const struct stretch *s)
{
    double most = 1.0;
    for (size_t i = s->first; i < s->last; i++)
        most = fmax(most, progress(s, i));
    return most - 1.0;
}

static double settling(const struct stretch *s)
{
    size_t since = s->last;
    for (size_t i = s->last; i-- > s->first;) {
        double off = fabs(progress(s, i) - 1.0);
        if (off > STEP_BAND)
            break;
        if (!isnan(off))
            since = i;
    }
    return since < s->last ? s->t[since] - s->t[s->first] : (double)NAN;
}

/* What was measured before the jump: the last reading at or before its row. */
static double value_at(const double *y, size_t row)
{
    while (row > 0 && isnan(y[row]))
        row--;
    return y[row];
}

/* A jump; not the corner where a ramp ends, which changes as much as the samples before it. */
static bool is_jump(const double *ref, size_t row)
{
    if (isnan(ref[row]))
        return false;
    if (row == 0 || isnan(ref[row - 1]))
        return true;
    double change = fabs(ref[row] - ref[row - 1]);
    double before = row > 1 ? fabs(ref[row - 1] - ref[row - 2]) : 0.0;
    return change > JUMP_LEAST * (fabs(ref[row]) + fabs(ref[row - 1])) &&
           !(change <= RAMP_CORNER * before);
}

static struct step_response measure(const struct stretch *s)
{
    return (struct step_response){.t = s->t[s->first],
                                  .from = s->from,
                                  .to = s->to,
                                  .rise_s = time_of(s, 0.9) - time_of(s, 0.1),
                                  .overshoot = overshoot(s),
                                  .settle_s = settling(s)};
}

size_t step_responses(const double *t, const double *ref, const double *y, size_t rows,
                      struct step_response *out, size_t room)
{
    size_t count = 0;
    for (size_t i = 0, end; i < rows; i = end) {
        end = i + 1;
        if (!is_jump(ref, i))
            continue;
        while (end < rows && ref[end] == ref[i])
            end++;
        struct stretch s = {t, y, i, end, value_at(y, i), ref[i]};
        bool moves = fabs(s.to - s.from) > JUMP_LEAST * fabs(s.to);
        if (t[end - 1] - t[i] < STEP_HOLD_S || isnan(s.from) || !moves)
            continue;
        if (count < room)
            out[count] = measure(&s);
        count++;
    }
    return count;
}

const char *step_response_line(const struct step_response *s, const char *unit, char *buf,
                               size_t size)
{
    char rise[40] = "not reached", settled[60] = "not settled";
    if (!isnan(s->rise_s))
        snprintf(rise, sizeof rise, "rise %.3f s", s->rise_s);
    if (!isnan(s->settle_s))
        snprintf(settled, sizeof settled, "within %.0f %% after %.3f s", 100.0 * STEP_BAND,
                 s->settle_s);
    snprintf(buf, size, "step at %.2f s, %.4g to %.4g %s: %s, overshoot %.1f %%, %s", s->t, s->from,
             s->to, unit, rise, 100.0 * s->overshoot, settled);
    return buf;
}
