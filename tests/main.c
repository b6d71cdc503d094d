/* Runs the suites: all, those named on the command line, or with --but first all others. */
#include <check.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "suites.h"

static const struct {
    const char *name;
    Suite *(*make)(void);
} suites[] = {
#define MK_SUITE_ROW(name) {#name, suite_##name},
    MK_SUITES(MK_SUITE_ROW)
#undef MK_SUITE_ROW
};

static int wanted(const char *name, int argc, char **argv)
{
    if (argc < 2)
        return 1;
    const int others = strcmp(argv[1], "--but") == 0;
    for (int i = 1 + others; i < argc; i++)
        if (strcmp(argv[i], name) == 0)
            return !others;
    return others;
}

int main(int argc, char **argv)
{
    SRunner *runner = srunner_create(NULL);
    int count = 0;
    for (size_t i = 0; i < sizeof suites / sizeof suites[0]; i++) {
        if (!wanted(suites[i].name, argc, argv))
            continue;
        srunner_add_suite(runner, suites[i].make());
        count++;
    }
    if (count == 0) {
        fprintf(stderr, "no suite of that name\n");
        srunner_free(runner);
        return EXIT_FAILURE;
    }
    srunner_run_all(runner, CK_NORMAL);
    int failed = srunner_ntests_failed(runner);
    srunner_free(runner);
    return failed ? EXIT_FAILURE : EXIT_SUCCESS;
}
