/* mechkit: the program. Finds the subcommand; each lives in a file sub_NAME.c. */
#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/text.h"
#include "console/commands/options.h"
#include "console/commands/signals.h"

static void print_help(FILE *out)
{
    fputs("mechkit " MK_VERSION ": driver and operator console for underactuated lab rigs\n\n"
          "usage: mechkit COMMAND [options]\n\n",
          out);
    const struct subcommand *sub;
    for (int i = 0; (sub = subcommand_at(i)) != NULL; i++)
        fprintf(out, "  %-10s  %s\n", sub->name, sub->summary);
    fputs("\n`mechkit COMMAND --help` says more. Exit codes: 0 success, 1 the run or the check "
          "failed,\n"
          "or an output cannot be written, 2 wrong usage, 3 bad input file.\n",
          out);
}

static bool is_help(const char *word)
{
    return strcmp(word, "--help") == 0 || strcmp(word, "-h") == 0;
}

static bool asks_for_help(int argc, char **argv)
{
    for (int i = 1; i < argc && strcmp(argv[i], "--") != 0; i++)
        if (is_help(argv[i]))
            return true;
    return false;
}

/* What was printed must have arrived: a full disk behind `>` is a failure too. A pipe whose reader
 * has seen enough is none. */
static int finish(int code)
{
    struct stat out;
    bool failed = fflush(stdout) != 0 || ferror(stdout);
    if (!failed || (fstat(STDOUT_FILENO, &out) == 0 && S_ISFIFO(out.st_mode)))
        return code;
    fprintf(stderr, "mechkit: cannot write to standard output: %s\n",
            errno ? strerror(errno) : "some of it was lost");
    return code == EXIT_OK ? EXIT_RUN_FAILED : code;
}

static const struct subcommand *find_subcommand(const char *name)
{
    const struct subcommand *sub;
    for (int i = 0; (sub = subcommand_at(i)) != NULL; i++)
        if (strcmp(name, sub->name) == 0)
            return sub;
    return NULL;
}

static const char *nearest_subcommand(const char *name)
{
    const struct subcommand *sub;
    struct mk_meant meant = {.word = name};
    for (int i = 0; (sub = subcommand_at(i)) != NULL; i++)
        mk_meant_try(&meant, sub->name);
    return meant.name;
}

static int no_subcommand(const char *name)
{
    const char *meant = nearest_subcommand(name);
    return report_usage("", "there is no command '%s'%s%s%s", name, meant ? ": did you mean " : "",
                        meant ? meant : "", meant ? "?" : "");
}

int main(int argc, char **argv)
{
    /* A full disk or a closed pipe must come back as an error, not end the program in mid run. */
    signal(SIGXFSZ, SIG_IGN);
    signal(SIGPIPE, SIG_IGN);
    signals_clean_up();
    if (argc < 2) {
        print_help(stderr);
        return EXIT_WRONG_USAGE;
    }
    if (strcmp(argv[1], "--version") == 0) {
        puts("mechkit " MK_VERSION);
        return finish(EXIT_OK);
    }
    bool help = strcmp(argv[1], "help") == 0; /* `help NAME` is `NAME --help` */
    if (is_help(argv[1]) || (help && argc == 2)) {
        print_help(stdout);
        return finish(EXIT_OK);
    }
    const struct subcommand *sub = find_subcommand(argv[help ? 2 : 1]);
    if (sub && (help || asks_for_help(argc - 1, argv + 1))) {
        options_help(sub, stdout);
        return finish(EXIT_OK);
    }
    if (sub)
        return finish(sub->run(argc - 1, argv + 1));
    return no_subcommand(argv[help ? 2 : 1]);
}
