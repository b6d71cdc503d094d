/* mechkit summary: a line a log. */
#include <stdio.h>

#include "console/sub.h"
#include "console/summary.h"

int sub_summary(int argc, char **argv)
{
    if (argc < 2)
        return report_usage("summary", "which log?");
    int code = EXIT_OK;
    for (int i = 1; i < argc; i++) {
        struct run_summary r;
        struct mk_error err = MK_ERROR_INIT;
        char line[300];
        if (argv[i][0] == '-')
            return report_usage("summary", "unknown option '%s'", argv[i]);
        if (summarise(argv[i], &r, &err) != MK_OK)
            code = report_error(&err);
        else
            puts(summary_line(&r, line, sizeof line));
    }
    return code;
}
