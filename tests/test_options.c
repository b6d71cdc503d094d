/* The tables of options: what is told of a command line that does not fit, and that help, man pages
 * and completion know every row. */
#include "suites.h"

#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "console/commands/options.h"
#include "support/files.h"
#include "support/program.h"
#include "support/spawn.h"

/* --- a table of every kind ------------------------------------------------------------------ */

struct options {
    const char *out;
    struct option_texts fixed;
    double rate, window;
    int threads;
    uint64_t seed;
    char separator;
    bool fast;
    const char *model, *fitted, *json;
};

static bool take_separator(const char *value, void *target)
{
    *(char *)target = value[0];
    return strlen(value) == 1;
}

static const struct option_row rows[] = {
    {"out", OPTION_TEXT(out), "FILE", "where it goes", .required = true},
    {"fix", OPTION_TEXTS(fixed), "NAME", "may be repeated"},
    {"rate", OPTION_NUMBER(rate), "HZ", "samples per second", 100, 2000},
    {"window", OPTION_NUMBER(window), "S", "length of a window"},
    {"threads", OPTION_COUNT(threads), "N", "at once", 1, 256},
    {"seed", OPTION_SEED(seed), "N", "of the noise", 0, 9e15},
    {"separator", OPTION_CALL(separator), "C", "one character", .take = take_separator,
     .wants = "one character"},
    {"fast", OPTION_FLAG(fast), NULL, "without waiting"},
    {"model", OPTION_TEXT(model), "M.ini", "the rig"},
    {"fitted", OPTION_OUTPUT(fitted), "M.ini", "the model", .replaces = "model"},
    {"json", OPTION_FIGURES(json), "FILE", "figures"},
    {0}};

static const struct subcommand sample = {.name = "sample",
                                         .synopsis = "LOG... --out FILE",
                                         .about = "A sample.",
                                         .options = rows,
                                         .argument = "log",
                                         .least = 1,
                                         .most = 2};

/* Parses a line of words; they live until the next one. */
static int parse(struct options *o, struct arguments *rest, const char *line)
{
    static char text[2048], *argv[32];
    int argc = 0;
    snprintf(text, sizeof text, "sample %s", line);
    for (char *word = strtok(text, " "); word && argc < 31; word = strtok(NULL, " "))
        argv[argc++] = word;
    argv[argc] = NULL;
    *o = (struct options){.rate = 500};
    return options_parse(&sample, argc, argv, o, rest);
}

/* Words of the command line are divided by blanks, and scratch paths have none. */
START_TEST(no_output_takes_the_place_of_an_input_or_of_another_output)
{
    struct options o;
    struct arguments rest;
    char line[1024], log[300], model[300], fresh[300];
    snprintf(log, sizeof log, "%s", scratch_text("a.csv", "t\n"));
    snprintf(model, sizeof model, "%s", scratch_text("m.ini", "[rig]\n"));
    snprintf(fresh, sizeof fresh, "%s", scratch("fresh"));
    const char *beside = strrchr(fresh, '/');
    const struct {
        const char *option, *path, *more;
        int code;
    } rows_of[] = {{"fitted", log, "", EXIT_WRONG_USAGE},
                   {"json", log, "", EXIT_WRONG_USAGE},
                   {"json", model, "", EXIT_WRONG_USAGE},
                   {"fitted", model, "", EXIT_OK},
                   {"fitted", fresh, "", EXIT_OK},
                   {"fitted", "word", "--fix word", EXIT_OK}, /* names no file */
                   {"json", "-", "--fitted other", EXIT_OK},
                   {"json", "/dev/null", "--fitted /dev/null", EXIT_OK},
                   {"json", "", "", EXIT_WRONG_USAGE},
                   {"fitted", "-", "", EXIT_WRONG_USAGE}};
    for (size_t i = 0; i < sizeof rows_of / sizeof rows_of[0]; i++) {
        snprintf(line, sizeof line, "%s --model %s --out x --%s=%s %s", log, model,
                 rows_of[i].option, rows_of[i].path, rows_of[i].more);
        ck_assert_msg(parse(&o, &rest, line) == rows_of[i].code, "%s", line);
    }
    snprintf(line, sizeof line, "%s --out x --fitted %s --json %.*s/.%s", log, fresh,
             (int)(beside - fresh), fresh, beside);
    ck_assert_int_eq(parse(&o, &rest, line), EXIT_WRONG_USAGE);
    snprintf(line, sizeof line, "%s --out x --fix %s --json %s", log, model, model);
    ck_assert_int_eq(parse(&o, &rest, line), EXIT_WRONG_USAGE);
    snprintf(line, sizeof line, "%s --out x --fitted %s --json %s.json", log, fresh, fresh);
    ck_assert_int_eq(parse(&o, &rest, line), EXIT_OK);
}
END_TEST

START_TEST(a_command_line_fills_the_struct)
{
    struct options o;
    struct arguments rest;
    ck_assert_int_eq(parse(&o, &rest,
                           "a.csv --out x --fix=p1 --rate 1e3 --fast --fix p2 --threads 4 --seed "
                           "9e15 --separator ; -- --b.csv"),
                     EXIT_OK);
    ck_assert_str_eq(o.out, "x");
    ck_assert_uint_eq(o.fixed.count, 2);
    ck_assert_str_eq(o.fixed.text[0], "p1");
    ck_assert_str_eq(o.fixed.text[1], "p2");
    ck_assert_double_eq(o.rate, 1000);
    ck_assert_double_eq(o.window, 0);
    ck_assert_int_eq(o.threads, 4);
    ck_assert_uint_eq(o.seed, 9000000000000000u);
    ck_assert_int_eq(o.separator, ';');
    ck_assert(o.fast);
    ck_assert_int_eq(rest.count, 2);
    ck_assert_str_eq(rest.text[0], "a.csv");
    ck_assert_str_eq(rest.text[1], "--b.csv");
    /* A second line starts anew. */
    ck_assert_int_eq(parse(&o, &rest, "--out y c.csv"), EXIT_OK);
    ck_assert_str_eq(o.out, "y");
    ck_assert_int_eq(rest.count, 1);
}
END_TEST

START_TEST(an_error_names_the_option_and_what_would_be_right)
{
    static const struct {
        const char *line, *says;
    } bad[] = {
        {"export --outt x", "unknown option '--outt': did you mean --out?"},
        {"export --colums=t x", "unknown option '--colums': did you mean --columns?"},
        {"export --frobnicate x", "unknown option '--frobnicate' ("},
        {"export -x", "unknown option '-x'"},
        {"export a.csv", "--out is missing: --out FILE"},
        {"export a.csv --out", "--out needs a value: --out FILE"},
        {"export --format v6 --out x", "--format v6: expected v5 or v7.3"},
        {"run a.cmd --fast=yes", "--fast takes no value"},
        {"run a.cmd --rate 5", "--rate 5: expected a number from 100 to 2000"},
        {"run a.cmd --rate nan", "--rate nan: expected a number from 100 to 2000"},
        {"run a.cmd --seed 1.5", "--seed 1.5: expected a whole number from 0"},
        {"run a.cmd b.cmd", "one command file at a time: 'b.cmd' is too much"},
        {"identify --model m --threads 1e9 x", "--threads 1e9: expected a whole number from 1 to"},
        {"identify --model m --out o --input both x",
         "--input both: expected measured, commanded or compare"},
        {"identify --model m --out o --input x", "--input x: expected measured"},
        {"simulate --model m --input l --window 0", "--window 0: expected a number from 0.001 to"},
        {"simulate --model m --input l --window inf",
         "--window inf: expected a number from 0.001 to"},
        {"simulate --model m --input l --solver rk4", "expected arkode-erk, cvode-adams"},
        {"simulate --model m --input l x", "'x' is too much"},
        {"explain --model m --out d --window 1e-320 x", "expected a number from 0.001 to 1000000"},
        {"excite --model m --out c --drift inf",
         "--drift inf: expected a number from 0 to 1000000"},
        {"explain --model m --out d --seconds none x", "expected seconds above 0, or all"},
        {"excite --model m --q1 3 --out x", "--q1 3: expected LOW:HIGH"},
        {"excite --model m --q1 -inf:1 --out x", "--q1 -inf:1: expected LOW:HIGH"},
        {"investigate --model m --out d --q2 0:1e999", "--q2 0:1e999: expected LOW:HIGH"},
        {"excite --model m --out c --tries 50", "--tries 50: expected a whole number from 100 to"},
        {"excite --model m --out c --seconds inf", "--seconds inf: expected a number from 1 to"},
        {"excite --model models/furuta.ini --out c --against 1e999",
         "--against: this number is too large"},
        {"excite --model models/furuta.ini --out c --against '1/(t-1)'",
         "is not a finite number at"},
        {"excite --model models/furuta.ini --out c --against 'sin(x)'", "--against: unknown name"},
        {"excite --model models/furuta.ini --out c --u-max 1e9",
         "--u-max 1e+09: expected a number"},
        {"excite --model models/furuta.ini --out c --q1 2:3", "--q1 2:3: rest at 0 rad must lie"},
        {"standalone pi-speed --gains inf", "--gains inf: expected 1 to 24 finite numbers"},
        {"standalone pi-speed --gains 1e300", "--gains 1e300: expected 1 to 24 finite numbers"},
        {"standalone pi-speed --gains 1,x", "--gains 1,x: expected 1 to 24 finite numbers"},
        {"design --model models/furuta.ini --lqr 1,1,1,1,1e999", "--lqr '1,1,1,1,1e999': expected"},
        {"design --model models/furuta.ini --lqrd 1,1,nan,1,1", "--lqrd '1,1,nan,1,1': expected 4"},
        {"design --model models/furuta.ini --gains 1,inf,1,1", "--gains '1,inf,1,1': expected 4"},
        {"design --model models/furuta.ini --poles -1,-2,-3,-inf", "--poles '-1,-2,-3,-inf': exp"},
        {"doctor --board warp", "--board warp: there is no such board"},
        {"standalone pi-speed --board warp", "--board warp: there is no such board"},
        {"export models/furuta-top-swingup.csv --out x.csv --columns zz",
         "--columns: models/furuta"},
        {"export models/furuta-top-swingup.csv --out x.csv --columns u:lb",
         "--columns: u:lb: the "},
        {"export a.csv b.csv --out x.csv", "--out x.csv: one log a CSV file"},
        {"export --model models/furuta.ini --out 1x.c", "--out 1x.c: the file's name is the"},
        {"excite --model models/furuta.ini --out x --criterion condition",
         "--criterion: the furuta"},
        {"summary", "which log?"},
        {"import a b --rig pendulum", "one file at a time: 'b' is too much"},
        {"boards usb", "'usb' is too much"},
        {"exprot a.csv", "there is no command 'exprot': did you mean export?"},
        {"help fly", "there is no command 'fly' ("},
        {"export rig.ini --out rig.m", "rig.ini is a model: --model rig.ini"},
    };
    char out[1024];
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        int code = run_mechkit(out, sizeof out, "%s", bad[i].line);
        ck_assert_msg(code == EXIT_WRONG_USAGE && strstr(out, bad[i].says), "%s: %d %s",
                      bad[i].line, code, out);
        ck_assert_msg(strchr(out, '\n') == strrchr(out, '\n'), "%s: %s", bad[i].line, out);
    }
}
END_TEST

START_TEST(what_does_not_arrive_on_a_full_disk_is_a_failure)
{
    char out[256];
    static const char *const lines[] = {"--help", "--version", "plot --help", "run --commands"};
    for (size_t i = 0; i < sizeof lines / sizeof lines[0]; i++) {
        int code = run_command(out, sizeof out, "{ %s %s >/dev/full; }", MK_TEST_APP, lines[i]);
        ck_assert_msg(code == 1 && strstr(out, "cannot write to standard output: No space"),
                      "%s: %d %s", lines[i], code, out);
    }
    ck_assert_int_eq(run_command(out, sizeof out, "%s --help | head -1", MK_TEST_APP), 0);
    ck_assert_ptr_null(strstr(out, "cannot write"));
}
END_TEST

START_TEST(a_directory_in_place_of_a_file_is_named)
{
    static const char *const lines[] = {"run %s", "import x.csv --map %s --out y", "summary %s",
                                        "export --model %s --out rig.m"};
    char out[1024], line[600], dir[512];
    snprintf(dir, sizeof dir, "%s", scratch("."));
    for (size_t i = 0; i < sizeof lines / sizeof lines[0]; i++) {
        snprintf(line, sizeof line, "%.*s%s%s", (int)(strstr(lines[i], "%s") - lines[i]), lines[i],
                 dir, strstr(lines[i], "%s") + 2);
        int code = run_mechkit(out, sizeof out, "%s", line);
        ck_assert_msg(code == 3 && strstr(out, "Is a directory"), "%s: %d %s", line, code, out);
    }
}
END_TEST

/* It is no bad input: nothing is wrong with what was read. */
START_TEST(an_output_that_cannot_be_written_is_a_failure)
{
    static const char *const lines[] = {
        "simulate --model $M --input $LOG --out $OUT.csv",
        "simulate --model $M --input $LOG --json $OUT.json",
        "import $LOG --rig pendulum --force --out $OUT.csv",
        "import $LOG --rig pendulum --force --write-map $OUT.map",
        "export $LOG --out $OUT.csv",
        "export $LOG --out $OUT.mat",
        "export --model $M --out $OUT.c",
        "identify --model $M --out $OUT.ini $LOG",
        "design --model $M --json $OUT.json",
        "excite --model $M --out $OUT.cmd",
        "robustness --setup furuta --json $OUT.json",
        "sweep scripts/sweep-basin.ini --out $OUT.csv",
    };
    const char *log = open_loop_log("pendulum", "2*sin(5*t)", 2.0);
    char out[4096];
    for (size_t i = 0; i < sizeof lines / sizeof lines[0]; i++) {
        int code = run_command(out, sizeof out, "M=%s LOG=%s OUT=%s/none/x; " MK_TEST_APP " %s",
                               MK_SOURCE_DIR "/models/pendulum.ini", log, scratch("."), lines[i]);
        ck_assert_msg(code == 1 && strstr(out, "cannot write"), "%s: %d %s", lines[i], code, out);
    }
}
END_TEST

/* No command makes a file or a folder named "-" of what a user takes for standard output. */
START_TEST(a_dash_is_no_output_where_it_is_none)
{
    const struct subcommand *sub;
    int outputs = 0;
    char line[300], out[1024], says[100];
    for (int i = 0; (sub = subcommand_at(i)) != NULL; i++)
        for (const struct option_row *r = sub->options; r && r->name; r++) {
            const bool named = strcmp(r->name, "out") == 0 || strcmp(r->name, "plot") == 0;
            ck_assert_msg(!named || r->kind == OPTION_KIND_OUTPUT, "%s --%s", sub->name, r->name);
            if (r->kind != OPTION_KIND_OUTPUT)
                continue;
            for (int empty = 0; empty < 2; empty++) {
                snprintf(line, sizeof line, "%s --%s %s", sub->name, r->name, empty ? "''" : "-");
                snprintf(says, sizeof says,
                         empty ? "--%s: the name is empty" : "--%s -: expected a", r->name);
                int code = run_mechkit(out, sizeof out, "%s", line);
                ck_assert_msg(code == EXIT_WRONG_USAGE && strstr(out, says), "%s: %d %s", line,
                              code, out);
            }
            outputs++;
        }
    ck_assert_int_ge(outputs, 14);
}
END_TEST

/* A setup is a word: that a file has the same name does not make it one to be read. */
START_TEST(a_file_named_as_a_setup_is_written_twice)
{
    char folder[512];
    ck_assert_ptr_nonnull(getcwd(folder, sizeof folder));
    ck_assert_int_eq(chdir(scratch(".")), 0);
    for (int time = 0; time < 2; time++) {
        struct outcome o =
            MECHKIT("standalone", "pi-speed", "--fast", "--seconds", "0.1", "--out", "pi-speed");
        ck_assert_msg(o.code == 0, "%d: %s", time, o.err);
    }
    ck_assert_int_eq(chdir(folder), 0);
}
END_TEST

/* A report is put together in a folder of its own, which a killed program leaves. */
START_TEST(what_a_killed_explain_left_is_gone_with_the_next_report)
{
    char log[300], report[300], left[400];
    snprintf(log, sizeof log, "%s", open_loop_log("pendulum", "2*sin(5*t)", 2.0));
    snprintf(report, sizeof report, "%s", scratch("again"));
    pid_t dead = fork();
    if (dead == 0)
        _exit(0);
    ck_assert_int_eq(waitpid(dead, NULL, 0), dead);
    snprintf(left, sizeof left, "%s/.report.%ld-0.tmp", report, (long)dead);
    ck_assert_int_eq(mkdir(report, 0777) | mkdir(left, 0777), 0);
    strcat(left, "/extended.ini");
    close(open(left, O_WRONLY | O_CREAT, 0600));
    struct outcome o = MECHKIT("explain", "--model", MK_SOURCE_DIR "/models/pendulum.ini", "--out",
                               report, "--seconds", "1", log);
    ck_assert_msg(o.code == 0, "%s", o.err);
    ck_assert_int_eq(count_files("again/report.json"), 1);
    ck_assert_int_eq(count_files("again/.report*"), 0);
}
END_TEST

/* Names come from archives and from other people: they must not steer the terminal. */
START_TEST(a_name_does_not_steer_the_terminal_whatever_prints_it)
{
    char log[300], ini[300], out[300], cmd[300], dir[300];
    const char *plain = open_loop_log("pendulum", "2*sin(5*t)", 2.0);
    char *text = slurp_file(plain), *model = slurp_file(MK_SOURCE_DIR "/models/pendulum.ini");
    snprintf(log, sizeof log, "%s", scratch_text("l\x1b[31m\n.csv", text));
    snprintf(ini, sizeof ini, "%s", scratch_text("m\x1b[31m.ini", model));
    snprintf(cmd, sizeof cmd, "%s",
             scratch_text("c\x1b[31m.cmd", "setup open-loop\necho \x1b]0;x\x07\nfly \x1b[2J\n"));
    snprintf(out, sizeof out, "%s", scratch("o\x1b[31m.csv"));
    snprintf(dir, sizeof dir, "%s", scratch("d\x1b[31m"));
    const char *const lines[][10] = {
        {"simulate", "--model", ini, "--input", log, "--out", out},
        {"simulate", "--model", ini, "--input", out},
        {"simulate", "--model", ini, "--input", ini},
        {"summary", log, plain},
        {"identify", "--model", ini, "--json", out, "--validate", log, log},
        {"identify", "--model", ini, "--out", log, log},
        {"explain", "--model", ini, "--out", dir, "--holdout", log, "--seconds", "1", plain},
        {"import", log, "--rig", "pendulum", "--write-map", out},
        {"export", log, "--out", log},
        {"export", ini, "--out", "x.mat"},
        {"export", "--model", ini, "--out", "\x1b[31m.c"},
        {"plot", log, "--out", "\x1b[31m.pdf"},
        {"measure", "\x1b[31m", "--model", ini, log},
        {"sweep", ini, "--out", out},
        {"design", "--model", ini, "--at", "\x1b[31m"},
        {"run", cmd, "--model", ini, "--fast"},
        {"doctor", "--board", "serial", "--device", "/dev/\x1b[31m"},
        {"standalone", "\x1b[31m"},
        {"robustness", "--setup", "\x1b[31m"},
        {"--\x1b[31m"},
        {"help", "\x1b[31m"},
    };
    for (size_t i = 0; i < sizeof lines / sizeof lines[0]; i++) {
        const char *argv[12] = {"mechkit"};
        memcpy(argv + 1, lines[i], sizeof lines[i]);
        struct outcome o = mechkit(argv);
        ck_assert_msg(!strchr(o.out, '\x1b') && !strchr(o.err, '\x1b'), "%s %zu: %s%s", argv[1], i,
                      o.out, o.err);
        ck_assert_msg(strstr(o.out, "\\x1b[31m") || strstr(o.err, "\\x1b[31m") || o.code == 0,
                      "%s %zu: %s%s", argv[1], i, o.out, o.err);
        ck_assert_msg(!strstr(o.out, "\n.csv") && !strstr(o.err, "\n.csv"), "%s %zu: %s%s", argv[1],
                      i, o.out, o.err);
    }
    free(text);
    free(model);
}
END_TEST

/* --- the tables of the program -------------------------------------------------------------- */

START_TEST(the_tables_are_sound)
{
    const struct subcommand *sub;
    int commands = 0;
    for (; (sub = subcommand_at(commands)) != NULL; commands++) {
        ck_assert(sub->name && sub->summary && sub->synopsis && sub->about && sub->argument);
        ck_assert_int_le(sub->least, sub->most);
        for (const struct option_row *r = sub->options; r && r->name; r++) {
            ck_assert_msg(r->help && *r->help, "%s --%s", sub->name, r->name);
            ck_assert_msg((r->kind == OPTION_KIND_FLAG) == (r->argument == NULL), "%s --%s",
                          sub->name, r->name);
            ck_assert_msg((r->kind == OPTION_KIND_CALL) == (r->take != NULL), "%s --%s", sub->name,
                          r->name);
            ck_assert_msg(!r->take || r->wants, "%s --%s", sub->name, r->name);
            ck_assert_msg(r->low <= r->high, "%s --%s", sub->name, r->name);
            for (const struct option_row *q = sub->options; q < r; q++)
                ck_assert_msg(strcmp(q->name, r->name) != 0, "%s --%s twice", sub->name, r->name);
        }
    }
    ck_assert_int_ge(commands, 16);
    ck_assert_ptr_null(subcommand_at(-1));
}
END_TEST

/* Whether a line of `text` starts with `--name` after `lead`. */
static bool has_option(const char *text, const char *lead, const char *name)
{
    char mark[96];
    snprintf(mark, sizeof mark, "\n%s%s", lead, name);
    const char *at = strstr(text, mark);
    size_t n = strlen(mark);
    while (at && !strchr(" \n", at[n]))
        at = strstr(at + 1, mark);
    return at != NULL;
}

START_TEST(help_and_man_page_have_every_option_and_lines_fit)
{
    char out[16384], dir[256], path[600];
    snprintf(dir, sizeof dir, "%s", scratch("man"));
    int code = run_command(out, sizeof out, "%s/tools/man-pages.sh %s %s", MK_SOURCE_DIR,
                           MK_TEST_APP, dir);
    ck_assert_msg(code == 0 && !*out, "%s", out);
    const struct subcommand *sub;
    for (int i = 0; (sub = subcommand_at(i)) != NULL; i++) {
        ck_assert_int_eq(run_mechkit(out, sizeof out, "%s --help", sub->name), 0);
        snprintf(path, sizeof path, "%s/mechkit-%s.1", dir, sub->name);
        char *page = slurp_file(path);
        ck_assert_msg(page != NULL, "no page of %s", sub->name);
        for (const struct option_row *r = sub->options; r && r->name; r++) {
            ck_assert_msg(has_option(out, "  --", r->name), "%s --help: %s", sub->name, r->name);
            ck_assert_msg(has_option(page, ".It Fl \\&-", r->name), "%s: %s", path, r->name);
        }
        free(page);
        for (char *line = strtok(out, "\n"); line; line = strtok(NULL, "\n"))
            ck_assert_msg(strlen(line) <= 100, "%s --help: %s", sub->name, line);
    }
    char *all = slurp_file(strcat(strcpy(path, dir), "/mechkit.1"));
    ck_assert_ptr_nonnull(all);
    for (int i = 0; (sub = subcommand_at(i)) != NULL; i++)
        ck_assert_msg(has_option(all, ".It Cm ", sub->name), "mechkit.1: %s", sub->name);
    ck_assert_ptr_null(strchr(all, '@'));
    free(all);
}
END_TEST

/* What completion offers for the last word of a line. */
static void complete(char *out, size_t size, const char *words, int last)
{
    int code = run_command(out, size,
                           "bash -c '. %s/tools/mechkit.bash; COMP_WORDS=(%s %s); COMP_CWORD=%d; "
                           "_mechkit; echo; printf \"%%s\\n\" \"${COMPREPLY[@]}\"'",
                           MK_SOURCE_DIR, MK_TEST_APP, words, last);
    ck_assert_int_eq(code, 0);
}

START_TEST(completion_offers_every_command_and_option)
{
    char out[8192], words[128];
    const struct subcommand *sub;
    if (!have_program("bash", "completion_offers_every_command_and_option"))
        return;
    complete(out, sizeof out, "\"\"", 1);
    for (int i = 0; (sub = subcommand_at(i)) != NULL; i++)
        ck_assert_msg(has_option(out, "", sub->name), "%s is missing in: %s", sub->name, out);
    for (int i = 0; (sub = subcommand_at(i)) != NULL; i++) {
        snprintf(words, sizeof words, "%s --", sub->name);
        complete(out, sizeof out, words, 2);
        size_t wanted = 1;
        for (const struct option_row *r = sub->options; r && r->name; r++) {
            wanted += strlen(r->name) + 3;
            ck_assert_msg(has_option(out, "--", r->name), "%s: %s is missing in: %s", sub->name,
                          r->name, out);
        }
        ck_assert_msg(strlen(out) == wanted || !sub->options, "%s: more than that: %s", sub->name,
                      out);
    }
    complete(out, sizeof out, "export --form", 2);
    ck_assert_str_eq(out, "\n--format\n");
}
END_TEST

Suite *suite_options(void)
{
    Suite *s = suite_create("options");
    TCase *c = tcase_create("options");
    tcase_set_timeout(c, 60);
    tcase_add_test(c, a_command_line_fills_the_struct);
    tcase_add_test(c, no_output_takes_the_place_of_an_input_or_of_another_output);
    tcase_add_test(c, a_file_named_as_a_setup_is_written_twice);
    tcase_add_test(c, an_error_names_the_option_and_what_would_be_right);
    tcase_add_test(c, what_does_not_arrive_on_a_full_disk_is_a_failure);
    tcase_add_test(c, a_directory_in_place_of_a_file_is_named);
    tcase_add_test(c, an_output_that_cannot_be_written_is_a_failure);
    tcase_add_test(c, what_a_killed_explain_left_is_gone_with_the_next_report);
    tcase_add_test(c, a_name_does_not_steer_the_terminal_whatever_prints_it);
    tcase_add_test(c, a_dash_is_no_output_where_it_is_none);
    tcase_add_test(c, the_tables_are_sound);
    tcase_add_test(c, help_and_man_page_have_every_option_and_lines_fit);
    tcase_add_test(c, completion_offers_every_command_and_option);
    suite_add_tcase(s, c);
    return s;
}
