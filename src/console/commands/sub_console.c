/* mechkit console: the screen over a session. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "console/commands/guard.h"
#include "console/screen/history.h"
#include "console/screen/tui.h"
#include "console/script/host.h"
#include "console/script/mark.h"
#include "console/script/session_args.h"

#define FRAME_MS 50

struct options {
    const char *script, *setup, *replay;
    struct term_options term;
    struct session_options session;
};

static const struct option_row option_rows[] = {
    SESSION_OPTIONS("the rig; default: the rig of the setup with Meesters' parameters",
                    "in simulated time, ten times as fast as the clock: the virtual board, or one "
                    "that says it is simulated"),
    {"setup", OPTION_TEXT(setup), "NAME", "choose this setup at once"},
    {"replay", OPTION_TEXT(replay), "LOG", "show a log; no board is needed"},
    {"mono", OPTION_FLAG(term.mono), NULL, "no colours (also with NO_COLOR in the environment)"},
    {"ascii", OPTION_FLAG(term.ascii), NULL, "no characters beyond ASCII"},
    {0}};

static int run(int argc, char **argv);

const struct subcommand sub_console = {
    .name = "console",
    .summary = "the operator's screen",
    .synopsis = "[SCRIPT.cmd] [options]",
    .about =
        "A text screen over a board: setup, start, halt, gains, save, identify, explain. Executes "
        "the\n"
        "command file first if there is one. Keys: ? lists them; Space stops the motor at once.",
    .options = option_rows,
    .argument = "command file",
    .most = 1,
    .run = run,
};

/* --- the door from the screen to the session ------------------------------------------------- */

static void door_post(void *user, const char *line)
{
    if (!host_post(user, line))
        host_note(user, HOST_ERROR, "too many commands wait; this one was dropped: %.100s", line);
}

static void door_halt(void *user)
{
    host_halt(user);
}

static void door_estop(void *user)
{
    host_estop(user);
}

static void door_cancel(void *user)
{
    host_cancel(user);
}

/* --- frames ---------------------------------------------------------------------------------- */

static double monotonic_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

struct screen {
    struct tui tui;
    struct host *host;
    uint64_t events; /* taken over */
    struct mark mark;
};

static void take_news(struct screen *s)
{
    struct host_status status;
    struct host_event event;
    struct mk_sample sample;
    struct host_show show;
    host_get_status(s->host, &status);
    tui_set_status(&s->tui, &status);
    if (!guard_crashed())
        mark_run(&s->mark, status.running, status.log_path);
    while (host_get_event(s->host, s->events, &event)) {
        s->events++;
        if (event.when)
            tui_add_event(&s->tui, &event);
    }
    while (mk_ring_pop(host_samples(s->host), &sample))
        tui_add_sample(&s->tui, &sample);
    if (host_take_show(s->host, &show))
        tui_show_log(&s->tui, &show);
}

static void draw(struct screen *s)
{
    int rows, cols;
    term_size(&rows, &cols);
    tui_tick(&s->tui, monotonic_s());
    if (s->tui.redraw)
        term_redraw();
    s->tui.redraw = false;
    tui_draw(&s->tui, rows, cols);
    term_show(&s->tui.canvas);
}

/* Motor off and the log complete before the shell has its terminal back. */
static void suspend(struct screen *s)
{
    s->tui.suspend = false;
    host_halt(s->host);
    for (int k = 0; k < 200 && (!host_is_idle(s->host) || host_is_running(s->host)); k++)
        nanosleep(&(struct timespec){.tv_nsec = 10000000}, NULL);
    host_note(s->host, HOST_WARNING, "stopped by Ctrl-Z: the motor went off before");
    term_suspend();
    guard_beat();
}

/* Keys until the next picture is due. False: the terminal is gone. */
static bool take_keys(struct screen *s)
{
    double until = monotonic_s() + FRAME_MS * 1e-3;
    for (;;) {
        double left = until - monotonic_s();
        int key = term_key(left > 0.0 ? (int)(left * 1e3 + 0.5) : 0);
        if (key == TK_GONE)
            return false;
        if (key != TK_NONE)
            tui_key(&s->tui, key);
        if (left <= 0.0 || s->tui.leave || s->tui.suspend)
            return true;
    }
}

static const char *show_until_end(struct screen *s)
{
    const char *why = NULL;
    bool there = true;
    while (there && !s->tui.leave && !s->tui.status.quit && !why) {
        guard_beat();
        take_news(s);
        draw(s);
        there = take_keys(s);
        if (s->tui.suspend || guard_wants_stop())
            suspend(s);
        why = guard_wants_end();
    }
    return there ? why : "the terminal is gone";
}

/* --- beginning and end ----------------------------------------------------------------------- */

static void post_first_commands(const struct options *o, struct host *host)
{
    char line[SESSION_PATH + 16];
    const struct {
        const char *name, *value;
    } rows[] = {{"setup", o->setup}, {"replay", o->replay}, {"source", o->script}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        snprintf(line, sizeof line, "%s %s", rows[i].name, rows[i].value ? rows[i].value : "");
        if (rows[i].value)
            door_post(host, line);
    }
}

static void set_mark(struct screen *s, const char *folder)
{
    char last[HOST_TEXT];
    mark_set(&s->mark, folder, last, sizeof last);
    if (last[0])
        host_note(s->host, HOST_WARNING, "%s", last);
}

static enum mk_status run_screen(const struct options *o, struct host *host, const char **why,
                                 struct mk_error *err)
{
    struct screen *s = calloc(1, sizeof *s);
    const struct tui_door door = {host, door_post, door_halt, door_estop, door_cancel};
    if (!s)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for the screen");
    s->host = host;
    enum mk_status st = tui_init(&s->tui, &door);
    if (st == MK_OK)
        st = term_open(&o->term, err);
    else
        mk_error_set(err, st, "no memory for the screen");
    if (st == MK_OK) {
        s->tui.canvas.unicode = term_unicode();
        st = guard_start(host, term_restore_in_crash, err);
    }
    if (st == MK_OK) {
        set_mark(s, o->session.out);
        history_load(&s->tui.prompt);
        post_first_commands(o, host);
        *why = show_until_end(s);
        host_finish(host);
        history_save(&s->tui.prompt);
        take_news(s);
        mark_end(&s->mark, *why);
    }
    term_close();
    tui_free(&s->tui);
    free(s);
    return st;
}

static int run(int argc, char **argv)
{
    struct options o = {.session = {.seed = 1}};
    struct mk_error err = MK_ERROR_INIT;
    struct host *host;
    const char *why = NULL;
    struct arguments script;
    int code = options_parse(&sub_console, argc, argv, &o, &script);
    if (code != EXIT_OK)
        return code;
    o.script = script.count > 0 ? script.text[0] : NULL;
    guard_take_signals();
    enum mk_status st = host_create(&o.session, &host, &err);
    if (st == MK_OK)
        st = run_screen(&o, host, &why, &err);
    host_finish(host);
    guard_stop();
    host_destroy(host);
    if (st != MK_OK)
        return report_error_of(&err, o.session.out);
    if (why)
        fprintf(stderr, "mechkit: ended by %s; motor off, log kept\n", why);
    return why ? EXIT_RUN_FAILED : EXIT_OK;
}
