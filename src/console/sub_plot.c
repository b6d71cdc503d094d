/* mechkit plot: logs as SVG or PNG, or in the terminal, drawn by gnuplot. */
#include <errno.h>
#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "console/plot.h"
#include "console/sub.h"

struct options {
    struct plot plot;
    const char *with;
};

static int parse_options(int argc, char **argv, struct options *o)
{
    static const struct option names[] = {{"out", required_argument, NULL, 'o'},
                                          {"with", required_argument, NULL, 'w'},
                                          {"title", required_argument, NULL, 't'},
                                          {"size", required_argument, NULL, 's'},
                                          {"spectrum", no_argument, NULL, 'f'},
                                          {"phase", no_argument, NULL, 'p'},
                                          {NULL, 0, NULL, 0}};
    int c;
    opterr = 0;
    optind = 1;
    while ((c = getopt_long(argc, argv, ":", names, NULL)) != -1) {
        switch (c) {
        case 'o':
            o->plot.out = optarg;
            break;
        case 'w':
            o->with = optarg;
            break;
        case 't':
            o->plot.title = optarg;
            break;
        case 's': {
            char rest;
            if (sscanf(optarg, "%dx%d%c", &o->plot.width, &o->plot.height, &rest) != 2 ||
                o->plot.width < 20 || o->plot.width > 20000 || o->plot.height < 5 ||
                o->plot.height > 20000)
                return report_usage("plot", "--size %s: expected WIDTHxHEIGHT", optarg);
            break;
        }
        case 'f':
            o->plot.kind = PLOT_SPECTRUM;
            break;
        case 'p':
            o->plot.kind = PLOT_PHASE;
            break;
        case ':':
            return report_usage("plot", "%s needs a value", argv[optind - 1]);
        default:
            return report_usage("plot", "unknown option '%s'", argv[optind - 1]);
        }
    }
    return EXIT_OK;
}

static bool ends_with(const char *text, const char *end)
{
    size_t n = strlen(text), m = strlen(end);
    return n >= m && strcmp(text + n - m, end) == 0;
}

static int parse(int argc, char **argv, struct options *o)
{
    int code = parse_options(argc, argv, o);
    if (code != EXIT_OK)
        return code;
    struct plot *p = &o->plot;
    p->count = argc - optind;
    if (p->count < 1)
        return report_usage("plot", "which log?");
    if (p->count > PLOT_MAX_LOGS)
        return report_usage("plot", "at most %d logs in one plot", PLOT_MAX_LOGS);
    for (int i = 0; i < p->count; i++) {
        const char *slash = strrchr(argv[optind + i], '/');
        p->names[i] = slash ? slash + 1 : argv[optind + i];
    }
    if (p->out && !ends_with(p->out, ".svg") && !ends_with(p->out, ".png"))
        return report_usage("plot", "--out %s: expected a name that ends in .svg or .png", p->out);
    if (o->with && p->count > 1)
        return report_usage("plot", "--with is for one log");
    if (o->with && p->kind == PLOT_SPECTRUM)
        return report_usage("plot", "--with and --spectrum do not go together");
    return EXIT_OK;
}

/* What a picture or a terminal has room for, where the user does not say. */
static void find_size(struct plot *p)
{
    struct winsize window;
    if (p->width > 0)
        return;
    p->width = 1100, p->height = 760;
    if (p->out)
        return;
    p->width = 100, p->height = 22;
    if (ioctl(STDOUT_FILENO, TIOCGWINSZ, &window) == 0 && window.ws_col >= 40)
        p->width = window.ws_col;
}

/* --- gnuplot ----------------------------------------------------------------------------- */

static enum mk_status run_gnuplot(const char *script, struct mk_error *err)
{
    fflush(stdout);
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

static enum mk_status draw(const struct plot *plot, struct mk_error *err)
{
    char path[] = "/tmp/mechkit-plot-XXXXXX";
    int fd = mkstemp(path);
    FILE *f = fd < 0 ? NULL : fdopen(fd, "w");
    if (!f)
        return mk_error_errno(err, errno, path, "cannot make a temporary file");
    enum mk_status st = plot_script(f, plot, err);
    if (fclose(f) != 0 && st == MK_OK)
        st = mk_error_errno(err, errno, path, "cannot write");
    if (st == MK_OK)
        st = run_gnuplot(path, err);
    unlink(path);
    return st;
}

int sub_plot(int argc, char **argv)
{
    struct options o = {0};
    struct mk_log *logs[PLOT_MAX_LOGS] = {NULL}, *with = NULL;
    struct mk_error err = MK_ERROR_INIT;
    enum mk_status st = MK_OK;
    int code = parse(argc, argv, &o);
    if (code != EXIT_OK)
        return code;
    char **paths = argv + optind;
    find_size(&o.plot);
    for (int i = 0; st == MK_OK && i < o.plot.count; i++) {
        st = mk_log_read(paths[i], &logs[i], &err);
        o.plot.logs[i] = logs[i];
    }
    if (st == MK_OK && o.with)
        st = mk_log_read(o.with, &with, &err);
    o.plot.with = with;
    if (st == MK_OK)
        st = draw(&o.plot, &err);
    for (int i = 0; i < o.plot.count; i++)
        mk_log_free(logs[i]);
    mk_log_free(with);
    return st == MK_OK ? EXIT_OK : report_error(&err);
}
