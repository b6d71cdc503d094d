/* mechkit run: a command file, headless. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "console/commands/signals.h"
#include "console/script/cmd.h"
#include "console/script/cmdfile.h"
#include "console/script/session_args.h"

/* Set by a signal: every wait ends, the script stops, the motor goes off. */
static volatile int cancelled;

static void on_signal(int number)
{
    (void)number;
    cancelled = 1;
}

struct options {
    const char *script;
    bool check, commands, quiet;
    struct session_options session;
};

static const struct option_row option_rows[] = {
    SESSION_OPTIONS("the rig, before what the file says; default: the rig of the setup with the "
                    "Meesters' parameters",
                    "in simulated time, as fast as it goes: the virtual board, or one that says it "
                    "is simulated"),
    {"check", OPTION_FLAG(check), NULL,
     "report every mistake in the script that shows without a board, run nothing"},
    {"commands", OPTION_FLAG(commands), NULL, "list commands, conditions and setups"},
    {"quiet", OPTION_FLAG(quiet), NULL, "print errors only"},
    {0}};

static int run(int argc, char **argv);

const struct subcommand sub_run = {
    .name = "run",
    .summary = "execute a command file on a board",
    .synopsis = "SCRIPT.cmd [options]",
    .about = "Executes a command file headless (\"-\": standard input).",
    .options = option_rows,
    .argument = "command file",
    .most = 1,
    .run = run,
};

static void say(void *user, const char *line)
{
    const struct options *o = user;
    if (!o->quiet) {
        print_lines(stdout, line);
        fflush(stdout);
    }
}

static void report_script_error(void *user, const struct mk_error *err)
{
    (void)user;
    report_error(err);
}

static int list_commands(void)
{
    const struct cmd *c;
    for (int i = 0; (c = cmd_at(i)) != NULL; i++)
        printf("  %-11s %-20s %s\n", c->name, c->usage, c->help);
    printf("  %-11s %-20s %s\n", "repeat", "N ... end", "a block of lines, N times");
    printf("  %-11s %-20s %s\n", "source", "FILE", "another command file");
    puts(
        "\nConditions: balanced, running, idle, faulted, no-fault, a fault's name; comparisons of\n"
        "t q1 q2 dq1 dq2 u ref late overruns lost ticks caught, e.g. |q2| < 0.1, u >= -2,\n"
        "dq1 within 2% of 50; joined by `and`.\n\nSetups:");
    const struct mk_ctrl_ops *ops;
    for (int i = 0; (ops = mk_ctrl_setup(i)) != NULL; i++)
        printf("  %-22s %s\n", ops->name, ops->help);
    return EXIT_OK;
}

/* What the options say before the first line does. */
static enum mk_status know_options(const struct session_options *o, struct cmd_known *known,
                                   struct mk_error *err)
{
    struct mk_model model;
    enum mk_status st = MK_OK;
    *known = (struct cmd_known){.keep_model = o->keep_model && o->model,
                                .have_model = o->model != NULL,
                                .have_nominal = o->believe != NULL};
    if (o->model && (st = mk_model_read(o->model, &model, err)) == MK_OK)
        known->model = mk_plant(model.plant);
    if (o->believe && st == MK_OK && (st = mk_model_read(o->believe, &model, err)) == MK_OK)
        known->nominal = mk_plant(model.plant);
    return st;
}

static int execute(struct options *o, const struct cmdfile *file)
{
    struct session session;
    struct mk_error err = MK_ERROR_INIT;
    o->session.say = say;
    o->session.user = o;
    o->session.cancel = &cancelled;
    signals_catch(on_signal);
    enum mk_status st = session_open(&session, &o->session, &err);
    int code = st == MK_OK ? EXIT_OK : report_error_of(&err, o->session.out);
    if (st == MK_OK) {
        st = cmdfile_execute(file, &session, &err);
        if (st != MK_OK) {
            report_error(&err);
            code = EXIT_RUN_FAILED;
        }
        /* Whatever happened: motor off and the log complete before anything else. */
        struct mk_error late = MK_ERROR_INIT;
        if (session_halt(&session, &late) != MK_OK && st == MK_OK) {
            report_error(&late);
            code = EXIT_RUN_FAILED;
        }
    }
    session_close(&session);
    return code;
}

static int run(int argc, char **argv)
{
    struct options o = {.session = {.seed = 1, .keep_model = true}};
    struct arguments script;
    int code = options_parse(&sub_run, argc, argv, &o, &script);
    if (code != EXIT_OK)
        return code;
    if (o.commands)
        return list_commands();
    if (script.count == 0)
        return report_usage("run", "which command file?");
    o.script = script.text[0];
    struct cmdfile *file;
    struct mk_error err = MK_ERROR_INIT;
    struct cmd_known known;
    if (know_options(&o.session, &known, &err) != MK_OK)
        return report_error(&err);
    if (cmdfile_read(o.script, &known, report_script_error, NULL, &file, &err) != MK_OK)
        return EXIT_BAD_FILE;
    if (o.check)
        printf("%s: %zu commands, no errors\n", show_name(o.script), cmdfile_command_count(file));
    else
        code = execute(&o, file);
    cmdfile_free(file);
    return code;
}
