/* mechkit summary: a line a log. */
#include <limits.h>
#include <stdio.h>

#include "console/options.h"
#include "console/summary.h"

static int run(int argc, char **argv)
{
    struct arguments logs;
    int code = options_parse(&sub_summary, argc, argv, NULL, &logs);
    for (int i = 0; code != EXIT_WRONG_USAGE && i < logs.count; i++) {
        struct run_summary r;
        struct mk_error err = MK_ERROR_INIT;
        char line[300];
        if (summarise(logs.text[i], &r, &err) != MK_OK)
            code = report_error(&err);
        else if (logs.count > 1)
            printf("%s: %s\n", logs.text[i], summary_line(&r, line, sizeof line));
        else
            puts(summary_line(&r, line, sizeof line));
    }
    return code;
}

const struct subcommand sub_summary = {
    .name = "summary",
    .summary = "what happened in runs, a line a log",
    .synopsis = "LOG.csv...",
    .about = "Prints for each log: setup, length, when it was caught, how still it was held, "
             "command, and\n"
             "lateness of the loop.",
    .argument = "log",
    .least = 1,
    .most = INT_MAX,
    .run = run,
};
