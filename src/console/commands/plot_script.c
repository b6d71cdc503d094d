/* The panels of a plot, and where they go. On a terminal they come one below the other. */
#include "console/commands/plot.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "console/commands/gnuplot.h"
#include "console/commands/plot_data.h"
#include "mechkit/ctrl.h"
#include "mechkit/loop.h"
#include "mechkit/model.h"
#include "mechkit/sim.h"

struct layout {
    FILE *f;
    const struct plot *p;
    bool wheel[2];
    const char *unit[MK_MAX_JOINTS]; /* of the positions */
    int joints;
    int ref_column; /* of the blocks: what the reference is for; 0: none is drawn */
    double caught;  /* time of the hand-over; NaN: none, or several logs */
};

/* --- pieces ------------------------------------------------------------------------------ */

static void put_terminal(const struct layout *l)
{
    const struct plot *p = l->p;
    if (p->out)
        gnuplot_picture(l->f, p->out, p->width, p->height);
    else
        fprintf(l->f, "set terminal dumb nofeed noenhanced size %d,%d\n", p->width - 1, p->height);
}

/* Colours that most eyes tell apart: Okabe and Ito. */
static void put_styles(FILE *f, bool picture)
{
    static const char *const colours[] = {"0072b2", "d55e00", "009e73", "cc79a7",
                                          "56b4e9", "e69f00", "000000", "f0e442"};
    for (int i = 0; i < PLOT_MAX_LOGS; i++)
        fprintf(f, "set style line %d lc rgb '#%s' lw 1.6 pt 7 ps 0.4\n", i + 1, colours[i]);
    fputs("set style line 20 lc rgb '#777777' lw 1.2 dt 2\n"
          "set style line 21 lc rgb '#000000' lw 1.0 dt 3\n"
          "set style line 22 lc rgb '#cc79a7' lw 1.0 dt 4\n"
          "set style line 23 lc rgb '#000000' lw 1.0 dt 2\n"
          "set border 3 lc rgb '#555555'\nset tics nomirror\nset lmargin 11\n"
          "set key above horizontal samplen 2\n",
          f);
    if (!picture)
        fputs("set tmargin 1\nset bmargin 1\n", f); /* rows are few */
    else
        fputs("set grid lc rgb '#e4e4e4' lt 1\n", f);
}

static const char *on_a(const char *rig)
{
    return strchr("aeio", rig[0]) ? " on an " : " on a ";
}

static void put_title(const struct layout *l)
{
    const struct mk_log *log = l->p->logs[0];
    const char *rig = mk_log_find_meta(log, "rig"), *setup = mk_log_find_meta(log, "setup");
    char title[200];
    if (setup && rig && strcmp(setup, rig) == 0)
        setup = NULL; /* "furuta", not "furuta on a furuta" */
    if (l->p->count > 1)
        snprintf(title, sizeof title, "%d runs%s%s", l->p->count, rig ? on_a(rig) : "",
                 rig ? rig : "");
    else
        snprintf(title, sizeof title, "%s%s%s", setup ? setup : "", setup && rig ? on_a(rig) : "",
                 rig ? rig : "");
    if (!l->p->out)
        return;
    fputs("set multiplot title ", l->f);
    gnuplot_quote(l->f, l->p->title ? l->p->title : title[0] ? title : l->p->names[0]);
    fputs(" font ',14'\n", l->f);
}

/* Where the next panel goes: shares of the picture from its left lower corner. */
static void place(const struct layout *l, double x, double y, double width, double height)
{
    if (l->p->out)
        fprintf(l->f, "set origin %g,%g\nset size %g,%g\n", x, y * 0.94, width, height * 0.94);
}

/* What comes after "plot": every log's block, columns x and y of it, one line style a log (first +
 * i). */
static void put_curves(const struct layout *l, const char *block, int x, int y, const char *with,
                       int first)
{
    for (int i = 0; i < l->p->count; i++) {
        fprintf(l->f, "%s%s%d using %d:%d with %s ls %d title ", i ? ", " : "", block, i, x, y,
                with, (first + i - 1) % PLOT_MAX_LOGS + 1);
        gnuplot_quote(l->f, l->p->names[i]);
    }
}

static void mark_hand_over(const struct layout *l, bool label)
{
    if (isnan(l->caught))
        return;
    fprintf(l->f, "set arrow 1 from first %.6g, graph 0 to first %.6g, graph 1 nohead ls 21\n",
            l->caught, l->caught);
    if (label) /* in front of the curves; characters of a terminal round onto the line */
        fprintf(l->f,
                "set label 1 'caught at %.2f s' at first %.6g, graph %g offset character %d,0 "
                "font ',9' front\n",
                l->caught, l->caught, l->p->out ? 0.94 : 0.8, l->p->out ? 1 : 2);
    else
        fputs("unset label 1\n", l->f);
}

/* Where new parameters took effect in a run: a line each, arrows from number FIRST_CHANGE on. */
#define FIRST_CHANGE 2
#define MOST_CHANGES 40
static int mark_changes(const struct layout *l, bool label)
{
    const struct mk_log *log = l->p->logs[0];
    const double *flags = mk_log_get(log, "flags"), *t = mk_log_get(log, "t");
    int count = 0;
    for (size_t r = 0; flags && l->p->count == 1 && r < log->rows && count < MOST_CHANGES; r++) {
        if (isnan(flags[r]) || !((unsigned)flags[r] & MK_FLAG_PARAMS))
            continue;
        int id = FIRST_CHANGE + count++;
        fprintf(l->f, "set arrow %d from first %.6g, graph 0 to first %.6g, graph 1 nohead ls 22\n",
                id, t[r], t[r]);
        if (label)
            fprintf(l->f,
                    "set label %d 'gains' at first %.6g, graph 0.06 offset character %d,0 "
                    "font ',9' front\n",
                    id, t[r], l->p->out ? 1 : 2);
        else
            fprintf(l->f, "unset label %d\n", id);
    }
    return count;
}

static void clear_marks(const struct layout *l, int changes)
{
    fputs("unset arrow 1\n", l->f);
    for (int i = 0; i < changes; i++)
        fprintf(l->f, "unset arrow %d\nunset label %d\n", FIRST_CHANGE + i, FIRST_CHANGE + i);
}

/* --- panels ------------------------------------------------------------------------------ */

static void put_angle(const struct layout *l, int j)
{
    int column = (l->wheel[j] ? PLOT_DQ1 : PLOT_Q1) + j, first = l->p->count > 1 ? 1 : 1 + j;
    fprintf(l->f, "set ylabel '%s%d [%s%s]'\n", l->wheel[j] ? "wheel speed dq" : "q", j + 1,
            l->unit[j], l->wheel[j] ? "/s" : "");
    fputs("plot ", l->f);
    for (int i = 0; column == l->ref_column && i < l->p->count; i++)
        fprintf(l->f, "$log%d using %d:%d with %s %s, ", i, PLOT_T, PLOT_REF,
                l->p->out ? "steps ls 23" : "points pt '-'", i ? "notitle" : "title 'reference'");
    put_curves(l, "$log", PLOT_T, column, "lines", first);
    if (l->p->with)
        fprintf(l->f, ", $with using %d:%d with lines ls 20 title 'model'", PLOT_T, column);
    fputc('\n', l->f);
}

static void put_command(const struct layout *l)
{
    const char *label = "command";
    plot_command(l->p->logs[0], &label);
    fprintf(l->f, "set ylabel '%s'\nplot ", label);
    put_curves(l, "$log", PLOT_T, PLOT_U, "steps", l->p->count > 1 ? 1 : 3);
    fputc('\n', l->f);
}

static void put_difference(const struct layout *l)
{
    bool mixed = l->joints == 2 && strcmp(l->unit[0], l->unit[1]) != 0;
    fprintf(l->f, "set ylabel 'error [%s]'\nplot ", mixed ? "rad, m" : l->unit[0]);
    for (int j = 0; j < l->joints; j++)
        fprintf(l->f, "%s$difference using 1:%d with lines ls %d title 'q%d'", j ? ", " : "",
                PLOT_DIFFERENCE + j, j + 1, j + 1);
    fputc('\n', l->f);
}

/* Tics that leave room for their numbers under a narrow panel: five or so. */
static void put_few_tics(const struct layout *l, int j)
{
    const double *q = mk_log_get(l->p->logs[0], j ? "q2" : "q1");
    double low = INFINITY, high = -INFINITY;
    for (size_t r = 0; r < l->p->logs[0]->rows; r++) {
        low = fmin(low, q[r]);
        high = fmax(high, q[r]);
    }
    double rough = (high - low) / 5.0;
    if (!l->p->out || !(rough > 0.0) || isinf(rough))
        return;
    double power = pow(10.0, floor(log10(rough))), lead = rough / power;
    fprintf(l->f, "set xtics %g\n",
            power * (lead < 1.5   ? 1
                     : lead < 3.5 ? 2
                     : lead < 7.5 ? 5
                                  : 10));
}

static void put_phase_plane(const struct layout *l, int j)
{
    put_few_tics(l, j);
    fprintf(l->f, "set xlabel 'q%d [%s]'\nset ylabel 'dq%d [%s/s]'\n", j + 1, l->unit[j], j + 1,
            l->unit[j]);
    fputs("plot ", l->f);
    put_curves(l, "$log", PLOT_Q1 + j, PLOT_DQ1 + j, "lines", l->p->count > 1 ? 1 : 1 + j);
    if (!isnan(l->caught))
        fprintf(l->f,
                ", $log0 using ($1>=%.9g?$%d:NaN):%d with lines lc rgb '#000000' lw 1.6 notitle",
                l->caught, PLOT_Q1 + j, PLOT_DQ1 + j);
    if (l->p->with)
        fprintf(l->f, ", $with using %d:%d with lines ls 20 title 'model'", PLOT_Q1 + j,
                PLOT_DQ1 + j);
    fputs("\nunset xlabel\nset xtics autofreq\n", l->f);
}

/* --- whole plots ------------------------------------------------------------------------- */

static void put_run(const struct layout *l)
{
    /* In a terminal a row for the names is dear: '-' is the reference. */
    bool several = l->p->count > 1 || l->p->with || (l->ref_column && l->p->out);
    int changes = 0;
    int panels = plot_panels(l->p);
    double height = 1.0 / panels, y = 1.0;
    fputs(several ? "set key on\n" : "set key off\n", l->f);
    if (l->p->out)
        fputs("set format x ''\n", l->f);
    for (int j = 0; j < l->joints; j++) {
        place(l, 0, y -= height, 0.66, height);
        mark_hand_over(l, j == 0);
        changes = mark_changes(l, j == 0);
        put_angle(l, j);
        fputs("set key off\n", l->f); /* once is enough */
    }
    if (l->p->with) {
        place(l, 0, y -= height, 0.66, height);
        fputs("unset label 1\nset key on\n", l->f);
        changes = mark_changes(l, false);
        put_difference(l);
        fputs("set key off\n", l->f);
    }
    place(l, 0, 0, 0.66, y);
    fputs("unset label 1\nset format x '%g'\nset xlabel 't [s]'\n", l->f);
    if (!l->p->out)
        fputs("set bmargin 3\n", l->f);
    changes = mark_changes(l, false);
    put_command(l);
    clear_marks(l, changes);
    fputs("unset xlabel\n", l->f);
    if (!l->p->out)
        return; /* a terminal has no place beside; --phase draws it */
    fputs("set title 'phase plane' font ',10'\n", l->f);
    place(l, 0.66, 0.2, 0.34, 0.62);
    put_phase_plane(l, l->joints == 2 && !l->wheel[1] ? 1 : 0);
}

static void put_portraits(const struct layout *l)
{
    fputs(l->p->count > 1 || l->p->with ? "set key on\n" : "set key off\n", l->f);
    for (int j = 0; j < l->joints; j++) {
        place(l, (double)j / l->joints, 0, 1.0 / l->joints, 1.0);
        put_phase_plane(l, j);
    }
}

/* One of the rows of put_spectra, for joint j. */
static void put_spectrum_panel(const struct layout *l, int j, int column)
{
    char block[32], label[48];
    snprintf(block, sizeof block, "$joint%d_", j + 1);
    snprintf(label, sizeof label, l->wheel[j] ? "dq%d [(%s/s)^2/Hz]" : "q%d [%s^2/Hz]", j + 1,
             l->unit[j]);
    const char *text = column == PLOT_PSD_U       ? "command [1/Hz]"
                       : column == PLOT_PSD_Q     ? label
                       : column == PLOT_GAIN      ? "gain"
                       : column == PLOT_PHASE_LAG ? "phase [deg]"
                                                  : "coherence";
    bool bottom = column == PLOT_COHERENCE, dots = column == PLOT_GAIN || column == PLOT_PHASE_LAG;
    fprintf(l->f, "set ylabel '%s'\nset autoscale y\nset ytics autofreq\n", text);
    fputs(column <= PLOT_GAIN ? "set logscale y\n" : "unset logscale y\n", l->f);
    if (column == PLOT_PHASE_LAG)
        fputs("set yrange [-180:180]\nset ytics 90\n", l->f);
    if (bottom)
        fputs("set yrange [0:1]\nset ytics 0.5\nset xlabel 'f [Hz]'\n", l->f);
    fputs(bottom || !l->p->out ? "set format x '%g'\n" : "set format x ''\n", l->f);
    fputs("plot ", l->f);
    put_curves(l, block, PLOT_F, column, dots ? "points" : "lines", 1 + (l->p->count > 1 ? 0 : j));
    fputs("\nunset xlabel\nset key off\n", l->f);
}

static void put_spectra(const struct layout *l)
{
    static const int rows[] = {PLOT_PSD_U, PLOT_PSD_Q, PLOT_GAIN, PLOT_PHASE_LAG, PLOT_COHERENCE};
    const int count = (int)(sizeof rows / sizeof rows[0]);
    fputs("set logscale x\nset format y '%g'\n", l->f);
    fputs(l->p->count > 1 ? "set key on\n" : "set key off\n", l->f);
    for (int j = 0; j < l->joints; j++)
        for (int k = 0; k < count; k++) {
            place(l, (double)j / l->joints, 1.0 - (double)(k + 1) / count, 1.0 / l->joints,
                  1.0 / count);
            put_spectrum_panel(l, j, rows[k]);
        }
}

int plot_panels(const struct plot *plot)
{
    int joints = mk_log_get(plot->logs[0], "q2") ? 2 : 1;
    switch (plot->kind) {
    case PLOT_PHASE:
        return joints;
    case PLOT_SPECTRUM:
        return 1; /* too many for one screen: each has all of it */
    default:
        return joints + 1 + (plot->with != NULL);
    }
}

static enum mk_status put_data(const struct layout *l, struct mk_error *err)
{
    const struct plot *p = l->p;
    char name[48];
    enum mk_status st = MK_OK;
    for (int i = 0; st == MK_OK && i < p->count; i++) {
        snprintf(name, sizeof name, "$log%d", i);
        if (p->kind != PLOT_SPECTRUM)
            plot_put_log(l->f, name, p->logs[i]);
        for (int j = 0; st == MK_OK && p->kind == PLOT_SPECTRUM && j < l->joints; j++) {
            snprintf(name, sizeof name, "$joint%d_%d", j + 1, i);
            st = plot_put_spectrum(l->f, name, p->logs[i], j, l->wheel[j], err);
        }
    }
    if (p->with) {
        plot_put_log(l->f, "$with", p->with);
        plot_put_difference(l->f, "$difference", p->logs[0], p->with);
    }
    return st;
}

/* First row of balancing; NaN: there is none. */
static double hand_over(const struct mk_log *log)
{
    const double *phase = mk_log_get(log, "phase"), *t = mk_log_get(log, "t");
    for (size_t r = 0; phase && r < log->rows; r++)
        if (phase[r] == MK_PHASE_BALANCE)
            return t[r];
    return (double)NAN;
}

/* The column of the blocks that the log's setup has its reference for. */
static int reference_column(const struct mk_log *log)
{
    static const struct {
        const char *name;
        int column;
    } columns[] = {{"q1", PLOT_Q1}, {"q2", PLOT_Q1 + 1}, {"dq1", PLOT_DQ1}, {"dq2", PLOT_DQ1 + 1}};
    const char *name = mk_log_find_meta(log, "setup");
    const struct mk_ctrl_ops *setup = name ? mk_ctrl_setup_by_name(name) : NULL;
    const double *ref = mk_log_get(log, "ref");
    size_t row = 0;
    while (ref && row < log->rows && isnan(ref[row]))
        row++;
    if (!ref || row == log->rows || !setup || !setup->output)
        return 0;
    for (size_t i = 0; i < sizeof columns / sizeof columns[0]; i++)
        if (strcmp(columns[i].name, setup->output) == 0)
            return columns[i].column;
    return 0;
}

/* Joints and their units, after the first log. */
static void find_joints(struct layout *l, const struct mk_log *log)
{
    const char *rig = mk_log_find_meta(log, "rig");
    const struct mk_plant_info *plant = rig ? mk_plant_by_name(rig) : NULL;
    l->joints = mk_log_get(log, "q2") ? 2 : 1;
    for (int j = 0; j < l->joints; j++) {
        bool slides = mk_record_joint_slides(log, j);
        l->wheel[j] = plant && plant->joint_is_wheel[j] && !slides;
        l->unit[j] = slides ? "m" : "rad";
    }
}

static bool has_numbers(const struct mk_log *log, const char *column)
{
    const double *value = mk_log_get(log, column);
    size_t row = 0;
    while (value && row < log->rows && !isfinite(value[row]))
        row++;
    return value && row < log->rows;
}

/* All logs must have the angles of the first one, and some of them as numbers. */
static enum mk_status check_logs(const struct layout *l, struct mk_error *err)
{
    for (int i = 0; i < l->p->count; i++) {
        const struct mk_log *log = l->p->logs[i];
        const bool one = mk_log_get(log, "q1") != NULL;
        if (!one || (l->joints == 2 && !mk_log_get(log, "q2")))
            return mk_error_at(err, MK_ERR_PARSE, log->path, 0, 0, "the log has no column %s",
                               one ? "q2" : "q1");
        if (!has_numbers(log, "q1") && !has_numbers(log, "q2"))
            return mk_error_at(err, MK_ERR_PARSE, log->path, 0, 0,
                               "nothing to draw: no angle of this log is a number");
    }
    return MK_OK;
}

enum mk_status plot_script(FILE *f, const struct plot *plot, struct mk_error *err)
{
    struct layout l = {.f = f, .p = plot};
    find_joints(&l, plot->logs[0]);
    l.ref_column = reference_column(plot->logs[0]);
    l.caught = plot->count == 1 ? hand_over(plot->logs[0]) : (double)NAN;
    enum mk_status st = check_logs(&l, err);
    if (st != MK_OK)
        return st;
    put_terminal(&l);
    put_styles(f, plot->out != NULL);
    st = put_data(&l, err);
    if (st != MK_OK)
        return st;
    put_title(&l);
    if (plot->kind == PLOT_RUN)
        put_run(&l);
    else if (plot->kind == PLOT_PHASE)
        put_portraits(&l);
    else
        put_spectra(&l);
    if (plot->out)
        fputs("unset multiplot\nunset output\n", f);
    return MK_OK;
}
