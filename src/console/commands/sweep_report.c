#include "console/commands/sweep_report.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define POINTS_SHOWN 60
#define NAMED 0.5 /* share of cases: from there on an effect counts as seen */

struct tally {
    int count[SWEEP_OUTCOMES];
    int runs;
};

static int good(const struct sweep *s, const struct tally *t)
{
    int n = 0;
    for (int i = 0; i < s->kind->successes; i++)
        n += t->count[i];
    return n;
}

static void count_in(struct tally *t, const struct sweep_result *r)
{
    t->count[r->outcome]++;
    t->runs++;
}

/* 95 % interval of a share (Wilson 1927). */
static void interval(int n, int of, double *low, double *high)
{
    const double z = 1.96;
    double p = (double)n / of, zz = z * z / of;
    double middle = (p + 0.5 * zz) / (1.0 + zz);
    double half = z / (1.0 + zz) * sqrt(p * (1.0 - p) / of + 0.25 * zz / of);
    *low = fmax(0.0, middle - half);
    *high = fmin(1.0, middle + half);
}

static void put_tally(const struct sweep *s, const struct tally *t)
{
    double low, high;
    int n = good(s, t);
    interval(n, t->runs, &low, &high);
    printf("%6d of %-6d %5.1f %% (%.1f .. %.1f)", n, t->runs, 100.0 * n / t->runs, 100.0 * low,
           100.0 * high);
    for (int i = s->kind->successes > 1 ? 1 : s->kind->successes; s->kind->outcome[i]; i++)
        if (t->count[i] > 0)
            printf("  %s %d", s->kind->outcome[i], t->count[i]);
    putchar('\n');
}

static const char *column(const struct sweep_axis *a)
{
    return strchr(a->name, '.') + 1;
}

static void report_points(const struct sweep_journal *j, const struct tally *tally)
{
    const struct sweep *s = j->sweep;
    char text[SWEEP_WORD];
    for (int i = 0; i < s->axis_count; i++)
        if (s->axis[i].count > 1)
            printf("%-16s ", column(&s->axis[i]));
    printf("%s%s\n", s->kind->outcome[0], s->kind->successes > 1 ? " or tied" : "");
    for (size_t p = 0; p < s->points; p++) {
        for (int i = 0; i < s->axis_count; i++) {
            int at = sweep_at(s, p * (size_t)s->runs, i);
            if (s->axis[i].count > 1)
                printf("%-16.16s ", sweep_value_text(&s->axis[i], at, text));
        }
        put_tally(s, &tally[p]);
    }
}

/* --- explain -------------------------------------------------------------------------------- */

/* A row of the confusion table: what was hidden, what was said, how often. */
struct mistake {
    const char *hidden;
    char said[SWEEP_LINE];
    int count;
};

static int by_hidden(const void *a, const void *b)
{
    const struct mistake *x = a, *y = b;
    int order = strcmp(x->hidden, y->hidden);
    return order ? order : strcmp(x->said, y->said);
}

static int by_count(const void *a, const void *b)
{
    const struct mistake *x = a, *y = b;
    int order = strcmp(x->hidden, y->hidden);
    return order ? order : x->count != y->count ? y->count - x->count : strcmp(x->said, y->said);
}

static void report_confusion(const struct sweep_journal *j)
{
    const struct sweep *s = j->sweep;
    struct mistake *m = calloc(s->total, sizeof *m);
    size_t kept = 0;
    if (!m)
        return;
    for (size_t i = 0; i < s->total; i++) {
        m[i].hidden = sweep_word(s, i, "case.effect", "");
        snprintf(m[i].said, sizeof m[i].said, "%.*s", (int)strcspn(j->result[i].text, ","),
                 j->result[i].text);
        m[i].count = 1;
    }
    qsort(m, s->total, sizeof *m, by_hidden);
    for (size_t i = 0; i < s->total; i++) {
        if (kept > 0 && by_hidden(&m[kept - 1], &m[i]) == 0)
            m[kept - 1].count++;
        else
            m[kept++] = m[i];
    }
    qsort(m, kept, sizeof *m, by_count);
    printf("\nhidden, and what was said\n");
    for (size_t i = 0; i < kept; i++)
        printf("  %-24s %-40s %5d\n",
               i && strcmp(m[i].hidden, m[i - 1].hidden) == 0 ? "" : m[i].hidden, m[i].said,
               m[i].count);
    free(m);
}

/* Sizes and shares of an effect on a rig, by size. */
struct power {
    double size;
    int named, of;
};

static int by_size(const void *a, const void *b)
{
    double d = ((const struct power *)a)->size - ((const struct power *)b)->size;
    return (d > 0.0) - (d < 0.0);
}

/* The size from which on at least half are named, between two sizes by the logarithm. */
static void put_limit(const struct power *p, int n)
{
    int i = n;
    while (i > 0 && p[i - 1].named >= NAMED * p[i - 1].of)
        i--;
    if (i == n)
        printf("not named reliably up to %g\n", p[n - 1].size);
    else if (i == 0)
        printf("named from the smallest on, %g\n", p[0].size);
    else {
        double below = (double)p[i - 1].named / p[i - 1].of, above = (double)p[i].named / p[i].of;
        double share = (NAMED - below) / (above - below);
        double limit = p[i - 1].size > 0.0 ? p[i - 1].size * pow(p[i].size / p[i - 1].size, share)
                                           : p[i].size * share;
        printf("named from %.3g on (%d of %d at %g, %d of %d at %g)\n", limit, p[i - 1].named,
               p[i - 1].of, p[i - 1].size, p[i].named, p[i].of, p[i].size);
    }
}

static void limit_of(const struct sweep_journal *j, int rig, const char *effect)
{
    const struct sweep *s = j->sweep;
    int rig_axis = sweep_find(s, "rig.kind"), size_axis = sweep_find(s, "case.size");
    const struct sweep_axis *sizes = &s->axis[size_axis];
    struct power *p = calloc((size_t)sizes->count, sizeof *p);
    int n = 0;
    for (size_t run = 0; p && run < s->total; run++) {
        if (sweep_at(s, run, rig_axis) != rig ||
            strcmp(sweep_word(s, run, "case.effect", ""), effect) != 0)
            continue;
        double size = fabs(sizes->value[sweep_at(s, run, size_axis)]);
        int i = 0;
        while (i < n && p[i].size != size)
            i++;
        n += i == n;
        p[i].size = size;
        p[i].of++;
        p[i].named += j->result[run].outcome < s->kind->successes;
    }
    if (n > 0) {
        qsort(p, (size_t)n, sizeof *p, by_size);
        printf("  %-16s %-24s ", s->axis[rig_axis].word[rig], effect);
        put_limit(p, n);
    }
    free(p);
}

static void report_limits(const struct sweep_journal *j)
{
    const struct sweep *s = j->sweep;
    const struct sweep_axis *rigs = &s->axis[sweep_find(s, "rig.kind")];
    const struct sweep_axis *effects = &s->axis[sweep_find(s, "case.effect")];
    printf("\ndetection limits: the size of the first parameter from which on half are named\n");
    for (int r = 0; r < rigs->count; r++)
        for (int e = 0; e < effects->count; e++)
            if (strcmp(effects->word[e], "none") != 0 &&
                (e == 0 || strcmp(effects->word[e], effects->word[e - 1]) != 0))
                limit_of(j, r, effects->word[e]);
}

void sweep_report(const struct sweep_journal *j)
{
    const struct sweep *s = j->sweep;
    struct tally all = {{0}, 0}, *tally = calloc(s->points, sizeof *tally);
    if (!tally)
        return;
    for (size_t i = 0; i < s->total; i++) {
        count_in(&all, &j->result[i]);
        count_in(&tally[sweep_point(s, i)], &j->result[i]);
    }
    if (s->points > 1 && s->points <= POINTS_SHOWN)
        report_points(j, tally);
    printf("all: ");
    put_tally(s, &all);
    free(tally);
    if (s->kind == &sweep_explain) {
        report_limits(j);
        report_confusion(j);
    }
}
