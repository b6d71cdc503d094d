/* mechkit summary: a line a log, and one for each step of a reference. */
#include <limits.h>
#include <stdio.h>

#include "console/commands/options.h"
#include "console/commands/summary.h"

static void print_steps(const struct run_summary *r)
{
    char line[200];
    for (size_t i = 0; i < r->steps && i < SUMMARY_STEPS; i++)
        printf("  %s\n", step_response_line(&r->step[i], summary_speed_unit(r), line, sizeof line));
    if (r->steps > SUMMARY_STEPS)
        printf("  and %zu more steps\n", r->steps - SUMMARY_STEPS);
}

static int run(int argc, char **argv)
{
    struct arguments logs;
    int code = options_parse(&sub_summary, argc, argv, NULL, &logs);
    for (int i = 0; code != EXIT_WRONG_USAGE && i < logs.count; i++) {
        struct run_summary r;
        struct mk_error err = MK_ERROR_INIT;
        char line[300];
        if (summarise(logs.text[i], &r, &err) != MK_OK) {
            code = report_error(&err);
            continue;
        }
        if (logs.count > 1)
            printf("%s: ", show_name(logs.text[i]));
        puts(summary_line(&r, line, sizeof line));
        print_steps(&r);
    }
    return code;
}

const struct subcommand sub_summary = {
    .name = "summary",
    .summary = "what happened in runs, a line a log",
    .synopsis = "LOG.csv...",
    .about = "Prints for each log: setup, length, when it was caught, how still it was held, "
             "command, and\n"
             "lateness of the loop. Of a speed that follows steps besides, for each step: rise "
             "time (10 to\n"
             "90 %), overshoot, and the time after which it stays within 2 % of the step.",
    .argument = "log",
    .least = 1,
    .most = INT_MAX,
    .run = run,
};
