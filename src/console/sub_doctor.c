/* mechkit doctor and mechkit boards: what is there, and is it well? */
#include <getopt.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "console/doctor.h"
#include "console/sub.h"

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
    if (!ops->find) {
        printf("%-8s %-20s %-18s %-24s %s\n", ops->name, "-", "built in", "-", "ok");
        return 0;
    }
    int n = ops->find(found, BOARDS_MAX, &err);
    if (n < 0) {
        printf("%-8s %s\n", ops->name, err.message);
        return 0;
    }
    for (int i = 0; i < n && i < BOARDS_MAX; i++)
        print_board(ops, &found[i]);
    if (n == 0)
        printf("%-8s none\n", ops->name);
    return n;
}

int sub_boards(int argc, char **argv)
{
    if (argc > 1)
        return report_usage("boards", "'%s' is too much", argv[1]);
    printf("%-8s %-20s %-18s %-24s %s\n", "--board", "--device", "name", "where", "state");
    const struct mk_board_ops *ops;
    for (int i = 0; (ops = mk_board_backend(i)) != NULL; i++)
        list_kind(ops);
    return EXIT_OK;
}

/* --- doctor ------------------------------------------------------------------------------------
 */

struct options {
    const char *board, *device, *model;
    bool drive, hand, fast;
};

static void print_line(void *user, enum doctor_verdict verdict, const char *what, const char *found,
                       const char *advice)
{
    static const char *const word[] = {"ok", "problem", "skipped"};
    (void)user;
    printf("%-8s %-20s %s\n", word[verdict], what, found);
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

static int parse(int argc, char **argv, struct options *o)
{
    static const struct option names[] = {{"board", required_argument, NULL, 'b'},
                                          {"device", required_argument, NULL, 'd'},
                                          {"model", required_argument, NULL, 'm'},
                                          {"drive", no_argument, NULL, 'D'},
                                          {"hand", no_argument, NULL, 'H'},
                                          {"fast", no_argument, NULL, 'f'},
                                          {NULL, 0, NULL, 0}};
    int c;
    opterr = 0;
    optind = 1;
    while ((c = getopt_long(argc, argv, ":", names, NULL)) != -1) {
        switch (c) {
        case 'b':
            o->board = optarg;
            break;
        case 'd':
            o->device = optarg;
            break;
        case 'm':
            o->model = optarg;
            break;
        case 'D':
            o->drive = true;
            break;
        case 'H':
            o->hand = true;
            break;
        case 'f':
            o->fast = true;
            break;
        case ':':
            return report_usage("doctor", "%s needs a value", argv[optind - 1]);
        default:
            return report_usage("doctor", "unknown option '%s'", argv[optind - 1]);
        }
    }
    if (optind < argc)
        return report_usage("doctor", "'%s' is too much", argv[optind]);
    return EXIT_OK;
}

static void examine(struct doctor *d, struct mk_board *board, const struct mk_model *model,
                    const struct options *o)
{
    if (!doctor_board(d, board, model))
        return;
    if (o->hand)
        doctor_by_hand(d, board, model);
    else
        doctor_say(d, DOCTOR_SKIPPED, "encoders by hand", "", "--hand looks at them");
    bool still = doctor_rest(d, board, model);
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
        doctor_say(d, DOCTOR_PROBLEM, "board", "`mechkit boards` lists what is there", "%s",
                   err.message);
        return EXIT_RUN_FAILED;
    }
    doctor_say(d, DOCTOR_OK, "board", "", "%s answers", ops->name);
    examine(d, board, model, o);
    mk_board_close(board);
    return d->problems > 0 ? EXIT_RUN_FAILED : EXIT_OK;
}

int sub_doctor(int argc, char **argv)
{
    struct options o = {.board = "virtual"};
    struct mk_error err = MK_ERROR_INIT;
    struct mk_model model;
    int code = parse(argc, argv, &o);
    if (code != EXIT_OK)
        return code;
    const struct mk_board_ops *ops = mk_board_backend_by_name(o.board);
    if (!ops)
        return report_usage("doctor", "there is no board '%s'", o.board);
    mk_model_default(MK_PLANT_PENDUBOT, &model);
    if (o.model && mk_model_read(o.model, &model, &err) != MK_OK)
        return report_error(&err);
    struct doctor d = {.line = print_line, .ask = print_request};
    doctor_machine(&d, o.fast ? 0.1 : 2.0);
    code = open_and_examine(&d, ops, &model, &o);
    printf(d.problems ? "%d problem%s\n" : "all is well\n", d.problems, d.problems == 1 ? "" : "s");
    return code;
}
