/* The checker of the tree's rules finds what it is for, and the bench tells no figure that the
 * machine disturbed. */
#include "suites.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>

#include "support/files.h"
#include "support/program.h"

/* A small tree with `line` in `file`; what tools/floors.sh says of it. */
static int check_tree(const char *file, const char *line, char *said, size_t size)
{
    static const char *const folders[] = {
        "src",         "src/base",           "src/model",  "src/ctrl", "src/sim",
        "src/console", "src/console/screen", "src/driver", "include",  "include/mechkit"};
    for (size_t i = 0; i < sizeof folders / sizeof folders[0]; i++)
        mkdir(scratch(folders[i]), 0755);
    scratch_text("include/mechkit/status.h", "#include <stddef.h>\n");
    scratch_text("include/mechkit/loop.h", "#include \"mechkit/status.h\"\n");
    scratch_text("src/ctrl/loop.c", "#include \"mechkit/loop.h\"\n#include \"base/random.h\"\n");
    scratch_text("src/sim/sundials.cpp", "#include <cvode/cvode.h>\n");
    scratch_text("src/console/screen/tui_term.c", "#include <ncursesw/curses.h>\n");
    if (file)
        scratch_text(file, line);
    char command[1024];
    snprintf(command, sizeof command, "%s/tools/floors.sh %s 2>&1", MK_SOURCE_DIR, scratch(""));
    FILE *out = popen(command, "r");
    said[fread(said, 1, size - 1, out)] = '\0';
    int status = pclose(out);
    if (file)
        remove(scratch(file));
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

START_TEST(whatever_is_forbidden_is_found)
{
    static const struct {
        const char *file, *line, *says;
    } rows[] = {
        {"src/model/a.c", "#include \"ctrl/ctrl_priv.h\"\n", "src/model must not include src/ctrl"},
        {"src/ctrl/a.c", "#include \"sim/fast.hpp\"\n", "src/ctrl must not include src/sim"},
        {"src/base/a.h", "  #  include \"../model/rhs.hpp\"\n",
         "src/base must not include src/model"},
        {"src/base/a.c", "#include \"mechkit/loop.h\"\n", "must not include mechkit/loop.h"},
        {"include/mechkit/log.h", "#include \"mechkit/loop.h\"\n",
         "must not include mechkit/loop.h"},
        {"include/mechkit/sim.h", "#include \"sim/fast.hpp\"\n", "public headers"},
        {"src/sim/a.cpp", "#include <sundials/sundials_types.h>\n", "SUNDIALS"},
        {"src/console/a.c", "#include <cjson/cJSON.h>\n", "cJSON"},
        {"src/ctrl/a.h", "#include <Eigen/Core>\n", "Eigen"},
        {"src/console/a.c", "#include <curses.h>\n", "curses"},
        {"src/console/screen/tui_view.c", "#include <ncurses.h>\n", "curses"},
        {"src/console/a.c", "#include <ncursesw/panel.h>\n", "curses"},
        {"src/sim/a.c", "#include <zlib.h>\n", "zlib"},
        {"src/console/a.c", "#include <libusb-1.0/libusb.h>\n", "libusb"},
        {"src/ctrl/a.c", "#include <ini.h>\n", "inih"},
        {"src/console/a.c", "if (plant == MK_PLANT_FURUTA)\n", "name a plant"},
        {"src/sim/a.hpp", "struct Piece {\n};\nclass Piece final\n{\n};\n", "one header"},
    };
    char said[2048];
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        int status = check_tree(rows[i].file, rows[i].line, said, sizeof said);
        ck_assert_msg(status == 1 && strstr(said, rows[i].says) && strstr(said, rows[i].file),
                      "%s: %s gave %d: %s", rows[i].file, rows[i].line, status, said);
    }
}
END_TEST

/* Two objects that call each other, with their sources, in a tree of their own. */
START_TEST(files_that_need_each_other_are_found_and_others_pass)
{
    char command[2048], said[2048];
    mkdir(scratch("src"), 0755);
    mkdir(scratch("src/base"), 0755);
    mkdir(scratch("tools"), 0755);
    scratch_text("src/base/a.c", "int b(void);\nint a(void);\nint a(void) { return b(); }\n");
    scratch_text("src/base/b.c", "int a(void);\nint b(void);\nint b(void) { return a(); }\n");
    scratch_text("src/base/c.c", "int a(void);\nint c(void);\nint c(void) { return a(); }\n");
    for (int apart = 0; apart < 2; apart++) {
        if (apart)
            scratch_text("src/base/b.c", "int b(void);\nint b(void) { return 0; }\n");
        snprintf(
            command, sizeof command,
            "cd %s && cp %s/tools/circles.sh tools && mkdir -p out/src/base && for f in a b c; do "
            "cc -c -o out/src/base/$f.o src/base/$f.c || exit 9; done; "
            "tools/circles.sh out 2>&1",
            scratch(""), MK_SOURCE_DIR);
        FILE *out = popen(command, "r");
        said[fread(said, 1, sizeof said - 1, out)] = '\0';
        const int status = pclose(out);
        ck_assert_msg(WIFEXITED(status) && WEXITSTATUS(status) == !apart, "%s", said);
        if (!apart)
            ck_assert(strstr(said, "base/a") && strstr(said, "base/b") && !strstr(said, "base/c"));
    }
}
END_TEST

START_TEST(a_function_of_more_than_80_lines_is_found_and_one_of_80_is_not)
{
    char text[1000], said[2048];
    for (int lines = 79; lines <= 80; lines++) {
        size_t n = (size_t)snprintf(text, sizeof text, "int f(void)\n{\n");
        for (int i = 0; i < lines; i++)
            n += (size_t)snprintf(text + n, sizeof text - n, "    ;\n");
        snprintf(text + n, sizeof text - n, "}\n");
        const int status = check_tree("src/ctrl/a.c", text, said, sizeof said);
        ck_assert_msg(status == (lines > 79) && (status == 0) == !strstr(said, "a.c"), "%d: %s",
                      lines, said);
    }
}
END_TEST

START_TEST(a_function_of_more_than_15_paths_is_found_and_one_of_15_is_not)
{
    /* What is in texts and comments, or behind a case, makes no path. */
    static const char begin[] = "int f(int a)\n{\n    /* if (a) && || ? */ // while\n"
                                "    g(\"if ? \\\" && ||\", '?', '\"');\n"
                                "#if A && B\n#endif\n    /* for\n     * while (a && b)\n     */\n"
                                "    switch (a) {\n    case 1:\n    case 2:\n    case 3:\n"
                                "    default:\n        break;\n    }\n";
    static const char *const ways[] = {"    if (a)\n",
                                       "    for (;;)\n",
                                       "    while (a)\n",
                                       "    a = a && 1;\n",
                                       "    a = a || 1;\n",
                                       "    a = a ? 1 : 2;\n",
                                       "    a = a /* is */ && 1;\n"};
    char text[1000], said[2048];
    for (size_t way = 0; way < sizeof ways / sizeof ways[0]; way++)
        for (int paths = 15; paths <= 16; paths++) {
            size_t n = (size_t)snprintf(text, sizeof text, "%s", begin);
            for (int i = 2; i < paths; i++) /* the function and its switch are 2 */
                n += (size_t)snprintf(text + n, sizeof text - n, "%s", ways[way]);
            snprintf(text + n, sizeof text - n, "}\n");
            const int status = check_tree("src/ctrl/a.c", text, said, sizeof said);
            ck_assert_msg(status == (paths > 15) && (status == 0) == !strstr(said, "a.c:2: 16"),
                          "%s%d: %s", ways[way], paths, said);
        }
}
END_TEST

START_TEST(an_exported_function_without_a_comment_is_found)
{
    static const struct {
        const char *header;
        bool told;
    } rows[] = {
        {"/* What it does. */\nint mk_one(int a);\n", true},
        {"/* What it does,\n * and how. */\nint mk_one(int a,\n           int b);\n", true},
        {"int mk_one(int a); /* what it does */\n", true},
        {"int mk_one(int a,\n           int b); /* what it does,\n * and how */\n", true},
        {"int mk_one(int a);\n", false},
        {"/* What it does. */\nint mk_other(int a);\nint mk_one(int a);\n", false},
        {"/* --- a section --- */\n\nint mk_one(int a);\n", false},
        {"int mk_other(void); /* what it does,\n * and how */\nint mk_one(int a);\n", false},
        {"struct mk_thing {\n    int a; /* what it is */\n};\nint mk_one(int a);\n", false}};
    char said[2048];
    check_tree("src/libmechkit.map", "", said, sizeof said);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        scratch_text("src/libmechkit.map",
                     "MECHKIT_0.1 {\nglobal:\n    mk_one;\nlocal:\n    *;\n};\n");
        const int status = check_tree("include/mechkit/sim.h", rows[i].header, said, sizeof said);
        ck_assert_msg(status == !rows[i].told && !strstr(said, "sim.h") == rows[i].told,
                      "%s gave %d: %s", rows[i].header, status, said);
    }
    /* Who is not exported may stay without. */
    scratch_text("src/libmechkit.map", "MECHKIT_0.1 {\nglobal:\n    mk_two;\n};\n");
    ck_assert_int_eq(check_tree("include/mechkit/sim.h", "int mk_one(int a);\n", said, sizeof said),
                     0);
    remove(scratch("src/libmechkit.map"));
}
END_TEST

START_TEST(what_is_allowed_passes)
{
    char said[2048];
    int status = check_tree(NULL, NULL, said, sizeof said);
    ck_assert_msg(status == 0 && !said[0], "%d: %s", status, said);
}
END_TEST

/* What Python prints of these lines, run among the bench's modules. */
static void python(const char *lines, char *said, size_t size)
{
    char command[4096];
    scratch_text("try.py", lines);
    snprintf(command, sizeof command, "cd %s/tools/bench && PYTHONPATH=. python3 -B %s 2>&1",
             MK_SOURCE_DIR, scratch("try.py"));
    FILE *out = popen(command, "r");
    said[fread(said, 1, size - 1, out)] = '\0';
    ck_assert_msg(pclose(out) == 0, "%s", said);
}

START_TEST(a_figure_of_the_bench_that_scatters_is_not_told)
{
    char said[4096];
    if (!have_program("python3", "floors"))
        return;
    /* Rounds of a machine that halves its pace: times say nothing, ratios within a round do. */
    python("import harness\n"
           "pace = iter([1, 1, 2, 2, 1, 2, 1] * harness.TRIES)\n"
           "now = [1]\n"
           "def seconds(run, level):\n"
           "    if run(level) == 1:\n"
           "        now[0] = next(pace)\n"
           "    return 1e-3 * run(level) * now[0]\n"
           "harness.seconds_of = seconds\n"
           "rows = harness.measure({'ours': harness.Program(lambda _: 1),\n"
           "                        'peer': harness.Program(lambda _: 3)})\n"
           "harness.table('title', rows, 'ours', 5)\n"
           "print([r['ms'] for r in rows.values()])\n",
           said, sizeof said);
    ck_assert_msg(strstr(said, "cannot be told"), "%s", said);
    ck_assert_msg(strstr(said, "[None, None]"), "%s", said);
    ck_assert_msg(strstr(said, "3.00"), "%s", said);
    /* Programs that did not take turns have no rounds in common. */
    python("import harness\n"
           "own = {'beside': ['a'], 'ms': None, 'rounds_ms': [1.0, 2.0, 2.0]}\n"
           "other = {'beside': ['b'], 'ms': 3.0, 'rounds_ms': [3.0, 6.0, 6.0]}\n"
           "print(harness.ratio(other, own), harness.ratio(other, dict(own, ms=2.0)))\n",
           said, sizeof said);
    ck_assert_msg(strstr(said, "None 1.5"), "%s", said);
    /* A quiet one tells both. */
    python("import harness\n"
           "harness.seconds_of = lambda run, level: 1e-3 * run(level)\n"
           "rows = harness.measure({'ours': harness.Program(lambda _: 2)})\n"
           "harness.table('title', rows, 'ours', 1)\n"
           "harness.table('title', rows, 'ours', 5)\n",
           said, sizeof said);
    ck_assert_msg(strstr(said, "2.0000") && strstr(said, "missed") && strstr(said, ": met"), "%s",
                  said);
}
END_TEST

START_TEST(the_history_of_the_bench_outlives_a_line_that_was_cut_short)
{
    char said[4096];
    if (!have_program("python3", "floors"))
        return;
    python("import history, machine, os, tempfile\n"
           "path = os.path.join(tempfile.mkdtemp(), 'h.jsonl')\n"
           "met = machine.look()\n"
           "assert met['processor'] and met['governor'] and met['processors'] > 0\n"
           "row = {'quiet': {'ms': 2.0}, 'noisy': {'ms': None}}\n"
           "history.append(path, met, {'s': row, 'deep': {'write': row}, 'other': [1]})\n"
           "open(path, 'a').write('{\"date\": ')\n"
           "open(path, 'a').write('\\n')\n"
           "history.append(path, met, {'s': row})\n"
           "print([sorted(run['ms']) for run in history.read(path)])\n",
           said, sizeof said);
    ck_assert_msg(strstr(said, "h.jsonl:2: not a run"), "%s", said);
    ck_assert_msg(strstr(said, "[['deep write: quiet', 's: quiet'], ['s: quiet']]"), "%s", said);
}
END_TEST

Suite *suite_floors(void)
{
    Suite *s = suite_create("floors");
    TCase *t = tcase_create("tree");
    tcase_set_timeout(t, 60);
    tcase_set_tags(t, "long"); /* a sanitizer sees nothing of a script */
    tcase_add_test(t, whatever_is_forbidden_is_found);
    tcase_add_test(t, what_is_allowed_passes);
    tcase_add_test(t, a_function_of_more_than_80_lines_is_found_and_one_of_80_is_not);
    tcase_add_test(t, a_function_of_more_than_15_paths_is_found_and_one_of_15_is_not);
    tcase_add_test(t, an_exported_function_without_a_comment_is_found);
    tcase_add_test(t, files_that_need_each_other_are_found_and_others_pass);
    tcase_add_test(t, a_figure_of_the_bench_that_scatters_is_not_told);
    tcase_add_test(t, the_history_of_the_bench_outlives_a_line_that_was_cut_short);
    suite_add_tcase(s, t);
    return s;
}
