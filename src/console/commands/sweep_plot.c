/* Pictures of sweeps: the share of good outcomes over what was varied. */
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "console/commands/gnuplot.h"
#include "console/commands/sweep_report.h"

#define LINES_MAX 8

struct picture {
    const struct sweep_journal *journal;
    const char *path;
    int x, y;         /* axes; y -1: lines over x */
    const int *good;  /* by point */
    const int *group; /* by point: which line it is on */
    int groups;
};

static int named_apart(const struct sweep *s, int axis)
{
    return s->axis[axis].word == NULL && s->axis[axis].count > 1;
}

/* The axes of numbers with most values; -1: none. */
static void choose_axes(const struct sweep *s, int *x, int *y)
{
    *x = *y = -1;
    for (int i = 0; i < s->axis_count; i++) {
        if (!named_apart(s, i))
            continue;
        if (*x < 0 || s->axis[i].count > s->axis[*x].count) {
            *y = *x;
            *x = i;
        } else if (*y < 0 || s->axis[i].count > s->axis[*y].count) {
            *y = i;
        }
    }
    /* A map wants many values both ways; and the first one given across. */
    if (*y >= 0 && s->axis[*y].count < 6)
        *y = -1;
    if (*y >= 0 && *y < *x) {
        int first = *y;
        *y = *x;
        *x = first;
    }
}

/* What a point has besides the axes of the picture, as text. */
static void rest_of_point(const struct picture *p, size_t point, char *text, size_t size)
{
    const struct sweep *s = p->journal->sweep;
    char value[SWEEP_WORD];
    *text = '\0';
    for (int i = 0; i < s->axis_count; i++) {
        const struct sweep_axis *a = &s->axis[i];
        if (a->count < 2 || i == p->x || i == p->y)
            continue;
        size_t used = strlen(text);
        sweep_value_text(a, sweep_at(s, point * (size_t)s->runs, i), value);
        snprintf(text + used, size - used, "%s%s%s%s", used ? ", " : "",
                 a->word ? "" : strchr(a->name, '.') + 1, a->word ? "" : " ", value);
    }
}

/* Which points belong together; the first LINES_MAX groups are drawn. */
static int find_groups(const struct picture *p, int *group)
{
    char(*known)[200] = calloc(LINES_MAX, sizeof *known), text[200];
    int n = 0;
    for (size_t k = 0; known && k < p->journal->sweep->points; k++) {
        int i = 0;
        rest_of_point(p, k, text, sizeof text);
        while (i < n && strcmp(known[i], text) != 0)
            i++;
        if (i == n && n < LINES_MAX)
            strcpy(known[n++], text);
        group[k] = i < n ? i : -1;
    }
    free(known);
    return n;
}

static double at(const struct picture *p, size_t point, int axis)
{
    const struct sweep *s = p->journal->sweep;
    return s->axis[axis].value[sweep_at(s, point * (size_t)s->runs, axis)];
}

static void put_data(FILE *f, const struct picture *p)
{
    const struct sweep *s = p->journal->sweep;
    for (int g = 0; g < p->groups; g++) {
        double last = 0.0;
        bool first = true;
        fprintf(f, "$g%d << EOD\n", g);
        for (size_t k = 0; k < s->points; k++) {
            if (p->group[k] != g)
                continue;
            double x = at(p, k, p->x), share = 100.0 * p->good[k] / s->runs;
            if (p->y >= 0 && !first && x != last)
                fputc('\n', f); /* a row of a map ends */
            fprintf(f, "%.17g %.17g %.17g\n", x, p->y >= 0 ? at(p, k, p->y) : share, share);
            last = x;
            first = false;
        }
        fputs("EOD\n", f);
    }
}

static void put_titles(FILE *f, const struct picture *p)
{
    const struct sweep *s = p->journal->sweep;
    char text[300];
    fputs("set xlabel ", f);
    gnuplot_quote(f, strchr(s->axis[p->x].name, '.') + 1);
    fputs("\nset ylabel ", f);
    gnuplot_quote(f, p->y >= 0 ? strchr(s->axis[p->y].name, '.') + 1 : "%");
    snprintf(text, sizeof text, "%s%s, %% of %d run%s", s->kind->outcome[0],
             s->kind->successes > 1 ? " or tied" : "", s->runs, s->runs > 1 ? "s a point" : "");
    fputs("\nset title ", f);
    gnuplot_quote(f, text);
    fputc('\n', f);
    const struct sweep_axis *x = &s->axis[p->x];
    if (x->value[0] > 0.0 && x->value[x->count - 1] > 30.0 * x->value[0])
        fputs("set logscale x\n", f);
}

static void put_plot(FILE *f, const struct picture *p)
{
    char text[200];
    if (p->y >= 0)
        fprintf(f,
                "set palette defined (0 '#f7f7f7', 1 '#0072b2')\nset cbrange [0:100]\n"
                "set autoscale fix\nset view map\nset tics out\nset multiplot layout 1,%d\n",
                p->groups);
    else
        fputs("set yrange [-3:103]\nset grid lc rgb '#e4e4e4' lt 1\nset key bottom right\nplot ",
              f);
    for (int g = 0; g < p->groups; g++) {
        size_t k = 0;
        while (p->group[k] != g)
            k++;
        rest_of_point(p, k, text, sizeof text);
        if (p->y >= 0) {
            fputs("set label 1 ", f);
            gnuplot_quote(f, text);
            fprintf(f, " at graph 0.02,0.97 front\nplot $g%d using 1:2:3 with image notitle\n", g);
        } else {
            fprintf(f, "%s$g%d using 1:2 with linespoints lw 1.6 pt 7 ps 0.5 title ", g ? ", " : "",
                    g);
            gnuplot_quote(f, text);
        }
    }
    fputs(p->y >= 0 ? "unset multiplot\n" : "\n", f);
}

static enum mk_status put_script(FILE *f, const void *user, struct mk_error *err)
{
    const struct picture *p = user;
    (void)err;
    gnuplot_picture(f, p->path, p->y >= 0 ? 460 * p->groups + 160 : 800, 520);
    fputs("set border 3 lc rgb '#555555'\nset tics nomirror\n", f);
    put_data(f, p);
    put_titles(f, p);
    put_plot(f, p);
    return MK_OK;
}

enum mk_status sweep_plot(const struct sweep_journal *j, const char *path, struct mk_error *err)
{
    const struct sweep *s = j->sweep;
    struct picture p = {.journal = j, .path = path};
    choose_axes(s, &p.x, &p.y);
    if (p.x < 0)
        return mk_error_set(err, MK_ERR_NOTSUP,
                            "%s: nothing to draw over: no number in the spec has several values",
                            path);
    int *good = calloc(s->points, sizeof *good), *group = calloc(s->points, sizeof *group);
    enum mk_status st = MK_OK;
    if (!good || !group)
        st = mk_error_set(err, MK_ERR_NOMEM, "no memory for a picture");
    for (size_t i = 0; st == MK_OK && i < s->total; i++)
        good[sweep_point(s, i)] += j->result[i].outcome < s->kind->successes;
    if (st == MK_OK) {
        p.groups = find_groups(&p, group);
        p.good = good;
        p.group = group;
        st = gnuplot_run(p.path, put_script, &p, err);
    }
    free(good);
    free(group);
    return st;
}
