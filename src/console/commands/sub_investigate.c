/* mechkit investigate: experiments of its own until a model predicts the rig. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "console/commands/options.h"
#include "console/commands/progress.h"
#include "console/commands/signals.h"
#include "investigate/investigate.h"
#include "mechkit/loop.h"
#include "mechkit/number.h"

/* Set by a signal: what is under way ends, the motor goes off, the journal is whole. */
static volatile int cancelled;

static void on_signal(int number)
{
    (void)number;
    cancelled = 1;
}

struct options {
    const char *model, *out, *resume, *board, *device, *rig, *faults;
    bool fast, stream, control, quiet;
    int experiments, threads, tries;
    double minutes, seconds, rate_hz, u_max, v_max[MK_MAX_JOINTS], model_off;
    struct option_range q[MK_MAX_JOINTS];
    uint64_t seed;
};

#define RANGE .take = option_take_range, .wants = "LOW:HIGH in the joint's unit, as -1:0.5"

static const struct option_row option_rows[] = {
    {"model", OPTION_TEXT(model), "M.ini", "the rig as a textbook has it"},
    {"out", OPTION_OUTPUT(out), "DIR",
     "where journal, logs, models and notebook go; made if missing; the same command again goes on "
     "where it was"},
    {"resume", OPTION_TEXT(resume), "DIR",
     "goes on with what began there, by its journal; in place of --model and --out"},
    {"board", OPTION_TEXT(board), "NAME",
     "virtual (default), usb, parport, tcp, serial (docs/boards.md)"},
    {"device", OPTION_TEXT(device), "NAME",
     "which board, when there are several; tcp: HOST:PORT. With --resume: where it is now"},
    {"rig", OPTION_TEXT(rig), "R.ini",
     "what the virtual board simulates, which the investigation does not look at; default: the "
     "model"},
    {"fast", OPTION_FLAG(fast), NULL,
     "in simulated time: the virtual board, or one whose clock can be stepped"},
    {"experiments", OPTION_COUNT(experiments), "N",
     "at most so many, the last of them a test; default 8", 1, JOURNAL_EXPERIMENTS},
    {"minutes", OPTION_NUMBER(minutes), "M",
     "at most so long, pauses and calculation included; default 60"},
    {"seconds", OPTION_NUMBER(seconds), "S", "length of an experiment; default 10", 2, 600},
    {"u-max", OPTION_NUMBER(u_max), "U", "limit of the command; default 70 % of the rig's"},
    {"q1", OPTION_CALL(q[0]), "LO:HI",
     "where a run is stopped, rad (m where it slides); default: as every run, and planned for half "
     "a turn either way",
     RANGE},
    {"q2", OPTION_CALL(q[1]), "LO:HI", "the same of joint 2", RANGE},
    {"v1", OPTION_NUMBER(v_max[0]), "V", "the same of the speed, rad/s or m/s"},
    {"v2", OPTION_NUMBER(v_max[1]), "V", "the same of joint 2"},
    {"model-off", OPTION_NUMBER(model_off), "P",
     "how far the textbook model may be off before a reading that contradicts it is a fault; 1: "
     "readings are not held against it; default 0.5, and 0.25 once the model was fitted",
     0.05, 1},
    {"control", OPTION_FLAG(control), NULL,
     "at the end run the rig's set-ups, believing the given and the final model"},
    {"rate", OPTION_NUMBER(rate_hz), "HZ", "samples per second, 100 .. 2000; default 500",
     MK_LOOP_RATE_MIN_HZ, MK_LOOP_RATE_MAX_HZ},
    {"stream", OPTION_FLAG(stream), NULL, "samples by the board's clock (docs/boards.md)"},
    {"seed", OPTION_SEED(seed), "N", "of the search and of the virtual rig's noise; default 1", 0,
     9e15},
    {"tries", OPTION_COUNT(tries), "N", "inputs to try for the first experiment; default 400", 100,
     1e6},
    {"faults", OPTION_TEXT(faults), "SCRIPT", "of the virtual board (docs/faults.md)"},
    {"quiet", OPTION_FLAG(quiet), NULL, "print errors only"},
    {"threads", OPTION_COUNT(threads), "N", "default: all processors", 1, 256},
    {0}};

static int run(int argc, char **argv);

const struct subcommand sub_investigate = {
    .name = "investigate",
    .summary = "run experiments of its own until a model predicts the rig",
    .synopsis = "--model M.ini --out DIR [options]\n--resume DIR [options]",
    .about =
        "Looks whether the rig hangs still and is wired as the model has it, then designs an\n"
        "experiment, runs it, explains what all logs so far show, and goes on with the one that "
        "is\n"
        "expected to tell most, until a fresh experiment is predicted to within twice its noise.\n"
        "DIR/notebook.html tells it all. The motor turns: stay within reach of the switch.",
    .options = option_rows,
    .notes =
        "Exit code 0: a test was passed. 1: the budget is spent, nothing more is to be gained,\n"
        "a signal or a fault ended it; the same command goes on where that makes sense.\n",
    .argument = "model",
    .run = run,
};

struct telling {
    struct progress progress;
    bool shows, quiet;
};

static void say(void *user, const char *line)
{
    struct telling *t = user;
    if (t->quiet)
        return;
    if (t->shows)
        progress_end(&t->progress);
    print_lines(stdout, line);
    fflush(stdout);
    if (t->shows)
        t->shows = progress_begin(&t->progress);
}

static bool show(void *user, double done, const char *what)
{
    struct telling *t = user;
    return !t->shows || progress_show(&t->progress, done, what);
}

static bool put_text(char *to, size_t size, const char *text)
{
    return !text || snprintf(to, size, "%s", text) < (int)size;
}

/* False: a name is too long. */
static bool put_settings(const struct options *o, struct journal_settings *s)
{
    s->fast = o->fast;
    s->stream = o->stream;
    s->seconds = o->seconds;
    s->rate_hz = o->rate_hz;
    s->seed = o->seed;
    s->model_off = o->model_off;
    s->tries = o->tries;
    s->limits.u_max = o->u_max;
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        s->limits.q_min[j] = o->q[j].low;
        s->limits.q_max[j] = o->q[j].high;
        s->limits.v_max[j] = o->v_max[j];
    }
    return put_text(s->board, sizeof s->board, o->board) &&
           put_text(s->device, sizeof s->device, o->device) &&
           put_text(s->rig, sizeof s->rig, o->rig);
}

static int report(const struct mk_error *err, const char *folder)
{
    const size_t n = strlen(folder);
    const bool inside = strncmp(err->file, folder, n) == 0;
    if (inside && (err->status == MK_ERR_NOTFOUND || err->status == MK_ERR_PARSE))
        return report_error(err);
    return inside ? report_output_error(err) : report_error(err);
}

static int finish(const struct journal *j, const struct options *o)
{
    const bool well = strcmp(j->stopped, "validated") == 0;
    if (!o->quiet)
        printf("%s/notebook.html, %s/model.ini\n", show_name(j->folder), show_name(j->folder));
    return well ? EXIT_OK : EXIT_RUN_FAILED;
}

static int run(int argc, char **argv)
{
    static struct journal journal;
    struct investigate_options io;
    struct arguments none;
    struct mk_error err = MK_ERROR_INIT;
    investigate_default(&io);
    struct options o = {.q = {{NAN, NAN}, {NAN, NAN}},
                        .u_max = NAN,
                        .v_max = {NAN, NAN},
                        .experiments = io.experiments,
                        .minutes = io.minutes,
                        .seconds = io.settings.seconds,
                        .rate_hz = io.settings.rate_hz,
                        .model_off = io.settings.model_off,
                        .tries = io.settings.tries,
                        .seed = io.settings.seed};
    int code = options_parse(&sub_investigate, argc, argv, &o, &none);
    if (code != EXIT_OK)
        return code;
    if (o.resume ? o.model || o.out : !o.model || !o.out)
        return report_usage("investigate", "give --model and --out, or --resume alone");
    if (!put_settings(&o, &io.settings))
        return report_usage("investigate", "--board, --device or --rig: the name is too long");
    struct telling telling = {.quiet = o.quiet};
    telling.shows = progress_begin(&telling.progress);
    io.folder = o.resume ? o.resume : o.out;
    io.resume = o.resume != NULL;
    io.model = o.model;
    io.experiments = o.experiments;
    io.minutes = o.minutes;
    io.control = o.control;
    io.faults = o.faults;
    io.threads = o.threads;
    io.cancel = &cancelled;
    io.say = say;
    io.progress = show;
    io.user = &telling;
    signals_catch(on_signal);
    const enum mk_status st = investigate(&io, &journal, &err);
    if (telling.shows)
        progress_end(&telling.progress);
    return st == MK_OK ? finish(&journal, &o) : report(&err, io.folder);
}
