/* mechkit plot: a run as SVG or PNG, drawn by gnuplot. */
#include <errno.h>
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "console/sub.h"
#include "mechkit/ctrl.h"
#include "mechkit/log.h"
#include "mechkit/model.h"

struct options {
    const char *log, *out, *with, *title;
};

static int parse(int argc, char **argv, struct options *o)
{
    static const struct option names[] = {{"out", required_argument, NULL, 'o'},
                                          {"with", required_argument, NULL, 'w'},
                                          {"title", required_argument, NULL, 't'},
                                          {NULL, 0, NULL, 0}};
    int c;
    opterr = 0;
    optind = 1;
    while ((c = getopt_long(argc, argv, ":", names, NULL)) != -1) {
        switch (c) {
        case 'o':
            o->out = optarg;
            break;
        case 'w':
            o->with = optarg;
            break;
        case 't':
            o->title = optarg;
            break;
        case ':':
            return report_usage("plot", "%s needs a value", argv[optind - 1]);
        default:
            return report_usage("plot", "unknown option '%s'", argv[optind - 1]);
        }
    }
    if (optind + 1 != argc)
        return report_usage("plot", optind < argc ? "one log at a time" : "which log?");
    o->log = argv[optind];
    if (!o->out)
        return report_usage("plot", "--out is missing");
    return EXIT_OK;
}

/* --- script ------------------------------------------------------------------------------ */

static bool ends_with(const char *text, const char *end)
{
    size_t n = strlen(text), m = strlen(end);
    return n >= m && strcmp(text + n - m, end) == 0;
}

/* Text in a single-quoted gnuplot string: quotes doubled, control characters gone. */
static void quote(FILE *f, const char *text)
{
    fputc('\'', f);
    for (; *text; text++) {
        if (*text == '\'')
            fputc('\'', f);
        fputc((unsigned char)*text < ' ' ? ' ' : *text, f);
    }
    fputc('\'', f);
}

static void put_value(FILE *f, const double *column, size_t row)
{
    if (!column || isnan(column[row]))
        fputs(" NaN", f);
    else
        fprintf(f, " %.9g", column[row]);
}

/* A block of data: t q1 q2 u dq1 dq2 ref. */
static void put_data(FILE *f, const char *name, const struct mk_log *log)
{
    static const char *const columns[] = {"t", "q1", "q2", "u", "dq1", "dq2", "ref"};
    size_t step = log->rows / 4000 + 1; /* more points than pixels help nobody */
    fprintf(f, "%s << EOD\n", name);
    for (size_t r = 0; r < log->rows; r += step) {
        for (size_t c = 0; c < sizeof columns / sizeof columns[0]; c++)
            put_value(f, mk_log_get(log, columns[c]), r);
        fputc('\n', f);
    }
    fputs("EOD\n", f);
}

/* First row of the last stretch of balancing; NAN: there is none. */
static double hand_over(const struct mk_log *log)
{
    const double *phase = mk_log_get(log, "phase"), *t = mk_log_get(log, "t");
    for (size_t r = 0; phase && r < log->rows; r++)
        if (phase[r] == MK_PHASE_BALANCE)
            return t[r];
    return (double)NAN;
}

static void put_styles(FILE *f, const struct options *o)
{
    if (ends_with(o->out, ".png"))
        fputs("set terminal pngcairo size 1100,760 font 'DejaVu Sans,11' background '#ffffff'\n",
              f);
    else
        fputs("set terminal svg size 1100,760 dynamic font 'DejaVu Sans,12' background '#ffffff'\n",
              f);
    fputs("set output ", f);
    quote(f, o->out);
    fputs("\nset style line 1 lc rgb '#0072b2' lw 1.6\n"
          "set style line 2 lc rgb '#d55e00' lw 1.6\n"
          "set style line 3 lc rgb '#009e73' lw 1.2\n"
          "set style line 4 lc rgb '#777777' lw 1.2 dt 2\n"
          "set style line 5 lc rgb '#000000' lw 1.0 dt 3\n"
          "set grid lc rgb '#e4e4e4' lt 1\nset border 3 lc rgb '#555555'\nset tics nomirror\n"
          "set key top right opaque samplen 2 spacing 1.1\n",
          f);
}

static void put_angle_panel(FILE *f, int joint, bool wheel, bool with)
{
    const char *what = wheel ? "wheel speed dq" : "q";
    int column = wheel ? 4 + joint : 1 + joint;
    fprintf(f, "set ylabel '%s%d [rad%s]'\nplot $run using 1:%d with lines ls %d title '%s%d'",
            what, joint, wheel ? "/s" : "", column, joint, wheel ? "dq" : "q", joint);
    if (with)
        fprintf(f, ", $with using 1:%d with lines ls 4 title 'model'", column);
    fputc('\n', f);
}

static void put_panels(FILE *f, const struct options *o, const struct mk_log *log, bool with)
{
    const char *rig = mk_log_find_meta(log, "rig"), *setup = mk_log_find_meta(log, "setup");
    const struct mk_plant_info *plant = rig ? mk_plant_by_name(rig) : NULL;
    bool two = mk_log_get(log, "q2") != NULL;
    bool wheel1 = plant && plant->joint_is_wheel[0], wheel2 = plant && plant->joint_is_wheel[1];
    int phase = wheel2 || !two ? 1 : 2;
    char title[200];
    snprintf(title, sizeof title, "%s%s%s", setup ? setup : "", setup && rig ? " on a " : "",
             rig ? rig : "");
    fputs("set multiplot title ", f);
    quote(f, o->title ? o->title : title[0] ? title : o->log);
    fputs(" font ',14'\nset lmargin 9\n", f);
    if (!with)
        fputs("set key off\n", f); /* the axes say it */
    double caught = hand_over(log);
    if (!isnan(caught)) {
        fprintf(f, "set arrow 1 from first %.6g, graph 0 to first %.6g, graph 1 nohead ls 5\n",
                caught, caught);
        fprintf(f, "set label 1 ' caught at %.2f s' at first %.6g, graph 0.94 font ',9'\n", caught,
                caught);
    }
    double height = two ? 0.30 : 0.45, y = 0.94 - height;
    fprintf(f, "set size 0.66,%g\nset format x ''\n", height);
    for (int j = 1; j <= (two ? 2 : 1); j++, y -= height) {
        fprintf(f, "set origin 0,%g\n", y);
        put_angle_panel(f, j, j == 1 ? wheel1 : wheel2, with);
        fputs("unset label 1\n", f);
    }
    fprintf(f, "set format x '%%g'\nset xlabel 't [s]'\nset size 0.66,%g\nset origin 0,0\n",
            y + height);
    fputs("set ylabel 'u [command units]'\nplot $run using 1:4 with steps ls 3 title 'u'\n", f);
    fputs("unset arrow 1\nset size 0.34,0.60\nset origin 0.66,0.2\nset lmargin 8\n", f);
    fprintf(
        f,
        "set xlabel 'q%d [rad]'\nset ylabel 'dq%d [rad/s]'\nset key off\nset title 'phase plane' "
        "font ',10'\n",
        phase, phase);
    fprintf(f, "plot $run using %d:%d with lines ls %d", 1 + phase, 4 + phase, phase);
    if (!isnan(caught))
        fprintf(f, ", $run using ($1>=%.9g?$%d:NaN):%d with lines lc rgb '#000000' lw 1.6", caught,
                1 + phase, 4 + phase);
    fputs("\nunset multiplot\nunset output\n", f);
}

static enum mk_status write_script(const char *path, const struct options *o,
                                   const struct mk_log *log, const struct mk_log *with,
                                   struct mk_error *err)
{
    FILE *f = fopen(path, "w");
    if (!f)
        return mk_error_errno(err, errno, path, "cannot write");
    put_styles(f, o);
    put_data(f, "$run", log);
    if (with)
        put_data(f, "$with", with);
    put_panels(f, o, log, with != NULL);
    if (fclose(f) != 0)
        return mk_error_errno(err, errno, path, "cannot write");
    return MK_OK;
}

/* --- gnuplot ----------------------------------------------------------------------------- */

static enum mk_status run_gnuplot(const char *script, struct mk_error *err)
{
    pid_t child = fork();
    if (child < 0)
        return mk_error_errno(err, errno, NULL, "cannot start gnuplot");
    if (child == 0) {
        execlp("gnuplot", "gnuplot", script, (char *)NULL);
        _exit(errno == ENOENT ? 127 : 126);
    }
    int status = 0;
    while (waitpid(child, &status, 0) < 0 && errno == EINTR)
        continue;
    if (WIFEXITED(status) && WEXITSTATUS(status) == 0)
        return MK_OK;
    if (WIFEXITED(status) && WEXITSTATUS(status) == 127)
        return mk_error_set(err, MK_ERR_NOTSUP, "gnuplot is not installed: install gnuplot-nox");
    return mk_error_set(err, MK_ERR_EXPECT, "gnuplot failed");
}

static enum mk_status draw(const struct options *o, const struct mk_log *log,
                           const struct mk_log *with, struct mk_error *err)
{
    char path[] = "/tmp/mechkit-plot-XXXXXX";
    int fd = mkstemp(path);
    if (fd < 0)
        return mk_error_errno(err, errno, path, "cannot make a temporary file");
    close(fd);
    enum mk_status st = write_script(path, o, log, with, err);
    if (st == MK_OK)
        st = run_gnuplot(path, err);
    unlink(path);
    return st;
}

int sub_plot(int argc, char **argv)
{
    struct options o = {0};
    int code = parse(argc, argv, &o);
    if (code != EXIT_OK)
        return code;
    if (!ends_with(o.out, ".svg") && !ends_with(o.out, ".png"))
        return report_usage("plot", "--out %s: expected a name that ends in .svg or .png", o.out);
    struct mk_log *log = NULL, *with = NULL;
    struct mk_error err = MK_ERROR_INIT;
    enum mk_status st = mk_log_read(o.log, &log, &err);
    if (st == MK_OK && !mk_log_get(log, "q1"))
        st = mk_error_at(&err, MK_ERR_PARSE, o.log, 0, 0, "the log has no column q1");
    if (st == MK_OK && o.with)
        st = mk_log_read(o.with, &with, &err);
    if (st == MK_OK)
        st = draw(&o, log, with, &err);
    mk_log_free(log);
    mk_log_free(with);
    return st == MK_OK ? EXIT_OK : report_error(&err);
}
