/* mechkit serve: a virtual rig for programs that must not know what it is. */
#include <stdio.h>
#include <string.h>

#include "console/commands/options.h"
#include "console/commands/signals.h"
#include "driver/serve.h"

struct options {
    const char *model, *listen;
    uint64_t seed;
    bool once, quiet;
};

static const struct option_row option_rows[] = {
    {"model", OPTION_TEXT(model), "M.ini",
     "the rig; default: the pendubot with Meesters' parameters"},
    {"listen", OPTION_TEXT(listen), "WHERE",
     "HOST:PORT (port 0: any that is free), or pty: a pseudo-terminal, for --board serial; "
     "default: 127.0.0.1:0"},
    {"once", OPTION_FLAG(once), NULL, "end when the first client has gone"},
    {"seed", OPTION_SEED(seed), "N", "of the rig's noise; default 1", 0, 9e15},
    {"quiet", OPTION_FLAG(quiet), NULL, "say where it listens and nothing more"},
    {0}};

static int run(int argc, char **argv);

const struct subcommand sub_serve = {
    .name = "serve",
    .summary = "put a virtual rig behind the wire protocol, as a board for others",
    .synopsis = "[options]",
    .about =
        "A board that is not there, with a rig that whoever drives it need not know: over TCP "
        "or a\n"
        "pseudo-terminal, by docs/protocol.md. One client at a time. The motor goes off when it "
        "hangs up\n"
        "or, by the board's watchdog, stays silent; the rig goes on. A client may step the "
        "clock\n"
        "(`--fast` of run, console, doctor, standalone): the rig then begins anew.",
    .options = option_rows,
    .notes = "    mechkit serve --model hidden.ini --listen 127.0.0.1:7000\n"
             "    mechkit run script.cmd --model believed.ini --board tcp --device 127.0.0.1:7000 "
             "--fast\n\n"
             "Whoever can reach the address can drive the rig: there is no password.",
    .argument = "rig",
    .argument_is_name = true,
    .run = run,
};

/* Set by a signal. */
static volatile int stopped;

static void on_signal(int number)
{
    (void)number;
    stopped = 1;
}

static void say(void *user, const char *line)
{
    const struct options *o = user;
    if (o->quiet)
        return;
    print_lines(stdout, line);
    fflush(stdout);
}

static int run(int argc, char **argv)
{
    struct options o = {.listen = "127.0.0.1:0", .seed = 1};
    struct mk_error err = MK_ERROR_INIT;
    struct mk_model model;
    struct mk_server *server;
    struct arguments none;
    int code = options_parse(&sub_serve, argc, argv, &o, &none);
    if (code != EXIT_OK)
        return code;
    mk_model_default(mk_plant_by_name("pendubot")->kind, &model);
    if (o.model && mk_model_read(o.model, &model, &err) != MK_OK)
        return report_error(&err);
    const struct mk_serve_config config = {.model = &model,
                                           .seed = o.seed,
                                           .listen = o.listen,
                                           .once = o.once,
                                           .stop = &stopped,
                                           .say = say,
                                           .user = &o};
    signals_catch(on_signal);
    enum mk_status st = mk_serve_open(&config, &server, &err);
    if (st == MK_ERR_USAGE)
        return report_usage("serve", "--listen %s", err.message);
    if (st != MK_OK)
        return report_error_of(&err, NULL);
    printf("listening on %s: --board %s --device %s\n", mk_serve_device(server),
           mk_serve_board(server), mk_serve_device(server));
    fflush(stdout);
    st = mk_serve_run(server, &err);
    mk_serve_close(server);
    return st == MK_OK ? EXIT_OK : report_error(&err);
}
