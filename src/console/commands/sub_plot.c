/* mechkit plot: logs as SVG or PNG, or in the terminal, drawn by gnuplot. */
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "console/commands/gnuplot.h"
#include "console/commands/options.h"
#include "console/commands/plot.h"

/* Fewer rows have no room for a curve between title and tics. */
#define PANEL_LEAST_ROWS 7

struct size {
    int width, height;
};

struct options {
    const char *out, *with, *title;
    struct size size;
    bool spectrum, phase;
};

static bool take_size(const char *value, void *target)
{
    struct size *s = target;
    char rest;
    return sscanf(value, "%dx%d%c", &s->width, &s->height, &rest) == 2 && s->width >= 20 &&
           s->width <= 20000 && s->height >= 5 && s->height <= 20000;
}

static const struct option_row option_rows[] = {
    {"out", OPTION_OUTPUT(out), "FILE", "a .svg or .png; default: drawn in the terminal"},
    {"with", OPTION_TEXT(with), "PRED.csv",
     "a prediction over the angles (mechkit simulate), and its error"},
    {"spectrum", OPTION_FLAG(spectrum), NULL,
     "spectra of command and angles, and the response between them: gain, phase and coherence "
     "(Welch)"},
    {"phase", OPTION_FLAG(phase), NULL, "phase plane of every joint"},
    {"title", OPTION_TEXT(title), "TEXT", "default: setup and rig"},
    {"size", OPTION_CALL(size), "WxH", "pixels, or characters of a panel in the terminal",
     .take = take_size, .wants = "WIDTHxHEIGHT, as 1100x760"},
    {0}};

static int run(int argc, char **argv);

const struct subcommand sub_plot = {
    .name = "plot",
    .summary = "draw logs as SVG, PNG or in the terminal (needs gnuplot)",
    .synopsis = "LOG.csv... [--out FILE.svg|FILE.png] [options]",
    .about = "Angles, reference, command and phase plane of up to eight runs over each other; the\n"
             "hand-over of a single one is marked, and where its gains changed. In a terminal the "
             "panels\n"
             "come one below the other, as high as the terminal has room for; the phase plane with "
             "--phase.",
    .options = option_rows,
    .argument = "log",
    .least = 1,
    .most = PLOT_MAX_LOGS,
    .run = run,
};

static bool ends_with(const char *text, const char *end)
{
    size_t n = strlen(text), m = strlen(end);
    return n >= m && strcmp(text + n - m, end) == 0;
}

/* Options that do not go together; 0 when they do. */
static int check(const struct options *o, int logs)
{
    if (o->out && !ends_with(o->out, ".svg") && !ends_with(o->out, ".png"))
        return report_usage("plot", "--out %s: expected a name that ends in .svg or .png", o->out);
    if (o->with && logs > 1)
        return report_usage("plot", "--with is for one log");
    if (o->spectrum && (o->with || o->phase))
        return report_usage("plot", "--spectrum and --%s do not go together",
                            o->with ? "with" : "phase");
    return EXIT_OK;
}

/* What a picture or a terminal has room for, where the user does not say. All panels of a run and
 * the prompt after them fit a terminal of ordinary size. */
static void find_size(struct plot *p)
{
    struct winsize window;
    if (p->width > 0)
        return;
    p->width = 1100, p->height = 760;
    if (p->out)
        return;
    p->width = 100, p->height = 22;
    if (ioctl(STDOUT_FILENO, TIOCGWINSZ, &window) != 0 || window.ws_col < 40)
        return;
    p->width = window.ws_col;
    p->height = (window.ws_row - 1) / plot_panels(p);
    p->height = p->height < PANEL_LEAST_ROWS ? PANEL_LEAST_ROWS : p->height;
}

static enum mk_status write_script(FILE *f, const void *plot, struct mk_error *err)
{
    return plot_script(f, plot, err);
}

static const char *base_name(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

static int run(int argc, char **argv)
{
    struct options o = {0};
    struct arguments paths;
    struct mk_log *logs[PLOT_MAX_LOGS] = {NULL}, *with = NULL;
    struct mk_error err = MK_ERROR_INIT;
    enum mk_status st = MK_OK;
    int code = options_parse(&sub_plot, argc, argv, &o, &paths);
    if (code == EXIT_OK)
        code = check(&o, paths.count);
    if (code != EXIT_OK)
        return code;
    struct plot plot = {.kind = o.spectrum ? PLOT_SPECTRUM
                                : o.phase  ? PLOT_PHASE
                                           : PLOT_RUN,
                        .count = paths.count,
                        .title = o.title,
                        .out = o.out,
                        .width = o.size.width,
                        .height = o.size.height};
    for (int i = 0; st == MK_OK && i < plot.count; i++) {
        plot.names[i] = base_name(paths.text[i]);
        st = mk_log_read(paths.text[i], &logs[i], &err);
        plot.logs[i] = logs[i];
    }
    if (st == MK_OK && o.with)
        st = mk_log_read(o.with, &with, &err);
    plot.with = with;
    if (st == MK_OK)
        find_size(&plot);
    if (st == MK_OK)
        st = gnuplot_run(plot.out, write_script, &plot, &err);
    for (int i = 0; i < plot.count; i++)
        mk_log_free(logs[i]);
    mk_log_free(with);
    if (st == MK_OK)
        return EXIT_OK;
    return report_error_of(&err, o.out);
}
