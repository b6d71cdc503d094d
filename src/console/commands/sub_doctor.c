/* mechkit doctor and mechkit boards: what is there, and is it well? */
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "console/commands/doctor.h"
#include "console/commands/options.h"
#include "console/commands/signals.h"

#define BOARDS_MAX 16

/* --- boards ------------------------------------------------------------------------------------
 */

static void print_board(const struct mk_board_ops *ops, const struct mk_board_found *f)
{
    printf("%-8s %-20s %-18s %-24s %s\n", ops->name, f->device, f->name, f->where,
           f->status == MK_OK ? "ok" : mk_strerror(f->status));
    if (f->note[0])
        printf("         %s\n", f->note);
}

/* Prints the boards of one kind; returns how many. */
static int list_kind(const struct mk_board_ops *ops)
{
    struct mk_board_found found[BOARDS_MAX];
    struct mk_error err = MK_ERROR_INIT;
    if (ops->capabilities & MK_BOARD_CAP_ADDRESSED) {
        printf("%-8s %-20s %-18s %-24s %s\n", ops->name, "HOST:PORT", "-", "network",
               "not searched for");
        printf("         mechkit doctor --board %s --device HOST:PORT looks at one\n", ops->name);
        return 0;
    }
    if (!ops->find) {
        printf("%-8s %-20s %-18s %-24s %s\n", ops->name, "-", "built in", "-", "ok");
        return 0;
    }
    int n = ops->find(found, BOARDS_MAX, &err);
    if (n < 0) {
        printf("%-8s %s\n", ops->name, show_name(err.message));
        return 0;
    }
    for (int i = 0; i < n && i < BOARDS_MAX; i++)
        print_board(ops, &found[i]);
    if (n == 0)
        printf("%-8s none\n", ops->name);
    return n;
}

static int run_boards(int argc, char **argv)
{
    struct arguments none;
    int code = options_parse(&sub_boards, argc, argv, NULL, &none);
    if (code != EXIT_OK)
        return code;
    printf("%-8s %-20s %-18s %-24s %s\n", "--board", "--device", "name", "where", "state");
    const struct mk_board_ops *ops;
    for (int i = 0; (ops = mk_board_backend(i)) != NULL; i++)
        list_kind(ops);
    return EXIT_OK;
}

const struct subcommand sub_boards = {
    .name = "boards",
    .summary = "which boards are there, and may they be used",
    .synopsis = "",
    .about = "Lists the boards of every kind with what --board and --device take, and what stands "
             "in the\n"
             "way of using them. Moves nothing.",
    .argument = "board",
    .argument_is_name = true,
    .run = run_boards,
};

/* --- doctor ------------------------------------------------------------------------------------
 */

struct options {
    const char *board, *device, *model;
    bool drive, hand, fast;
};

static const struct option_row option_rows[] = {
    {"board", OPTION_TEXT(board), "NAME", "usb, parport, tcp, serial, virtual (default)"},
    {"device", OPTION_TEXT(device), "NAME",
     "which board, when there are several; with tcp HOST:PORT"},
    {"model", OPTION_TEXT(model), "M.ini",
     "the rig; default: the pendubot with Meesters' parameters"},
    {"hand", OPTION_FLAG(hand), NULL,
     "asks for the joints to be turned by hand: does each encoder count?"},
    {"drive", OPTION_FLAG(drive), NULL,
     "two short pushes and a slow sweep: wiring, swapped encoders, cable drag"},
    {"fast", OPTION_FLAG(fast), NULL,
     "in simulated time: the virtual board, or one that says it is simulated"},
    {0}};

/* Set by a signal: what is under way ends, the motor goes off. */
static volatile int cancelled;

static void on_signal(int number)
{
    (void)number;
    cancelled = 1;
}

static int run_doctor(int argc, char **argv);

const struct subcommand sub_doctor = {
    .name = "doctor",
    .summary = "look at machine, board and rig: what is well, what is not, what to do",
    .synopsis = "[options]",
    .about =
        "A line a finding: ok, problem with what to do, or skipped. Exit code 1 when there is a\n"
        "problem. Without --drive the motor stays off.",
    .options = option_rows,
    .argument = "board",
    .argument_is_name = true,
    .run = run_doctor,
};

static void print_line(void *user, enum doctor_verdict verdict, const char *what, const char *found,
                       const char *advice)
{
    static const char *const word[] = {"ok", "problem", "skipped"};
    (void)user;
    printf("%-8s %-20s %s\n", word[verdict], what, show_name(found));
    if (advice[0])
        printf("%-8s %-20s -> %s\n", "", "", advice);
    fflush(stdout);
}

static void print_request(void *user, const char *what)
{
    (void)user;
    printf("please   %s\n", what);
    fflush(stdout);
}

static void examine(struct doctor *d, struct mk_board *board, const struct mk_model *model,
                    const struct options *o)
{
    if (!doctor_board(d, board, model))
        return;
    if (cancelled)
        return;
    if (o->hand)
        doctor_by_hand(d, board, model);
    else
        doctor_say(d, DOCTOR_SKIPPED, "encoders by hand", "", "--hand looks at them");
    if (cancelled)
        return;
    bool still = doctor_rest(d, board, model);
    if (cancelled)
        return;
    if (!o->drive)
        doctor_say(d, DOCTOR_SKIPPED, "motor, cable drag", "",
                   "--drive moves the rig a little and looks at them");
    else if (!still)
        doctor_say(d, DOCTOR_SKIPPED, "motor, cable drag", "", "not before the links hang still");
    else if (doctor_push(d, board, model))
        doctor_sweep(d, board, model);
}

static int open_and_examine(struct doctor *d, const struct mk_board_ops *ops,
                            const struct mk_model *model, const struct options *o)
{
    struct mk_clock clock;
    struct mk_board *board;
    struct mk_error err = MK_ERROR_INIT;
    if (o->fast)
        mk_clock_init_simulated(&clock);
    else
        mk_clock_init_monotonic(&clock);
    const struct mk_board_config config = {
        .model = model, .clock = &clock, .seed = 1, .device = o->device};
    if (mk_board_open(ops, &config, &board, &err) != MK_OK) {
        doctor_say(d, DOCTOR_PROBLEM, "board", "docs/boards.md: each error and what to do", "%s",
                   err.message);
        return EXIT_RUN_FAILED;
    }
    doctor_say(d, DOCTOR_OK, "board", "", "%s answers", ops->name);
    examine(d, board, model, o);
    mk_board_close(board);
    return d->problems > 0 ? EXIT_RUN_FAILED : EXIT_OK;
}

static int run_doctor(int argc, char **argv)
{
    struct options o = {.board = "virtual"};
    struct mk_error err = MK_ERROR_INIT;
    struct mk_model model;
    struct arguments none;
    int code = options_parse(&sub_doctor, argc, argv, &o, &none);
    if (code != EXIT_OK)
        return code;
    const struct mk_board_ops *ops = mk_board_backend_by_name(o.board);
    if (!ops)
        return report_usage(
            "doctor", "--board %s: there is no such board; `mechkit boards` lists them", o.board);
    mk_model_default(mk_plant_by_name("pendubot")->kind, &model);
    if (o.model && mk_model_read(o.model, &model, &err) != MK_OK)
        return report_error(&err);
    signals_catch(on_signal);
    struct doctor d = {.line = print_line, .ask = print_request, .cancel = &cancelled};
    doctor_machine(&d, o.fast ? 0.1 : 2.0);
    code = open_and_examine(&d, ops, &model, &o);
    if (cancelled) {
        printf("broken off by a signal, motor off\n");
        return EXIT_RUN_FAILED;
    }
    printf(d.problems ? "%d problem%s\n" : "all is well\n", d.problems, d.problems == 1 ? "" : "s");
    return code;
}
