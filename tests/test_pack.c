/* What is installed: the shared library and what a user builds with it. */
#include "suites.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "support/files.h"
#include "support/program.h"

/* Folder of the build variant under test, as "build/release", and its name. */
static const char *variant(void)
{
    static char folder[512];
    snprintf(folder, sizeof folder, "%s", MK_TEST_APP);
    *strrchr(folder, '/') = 0;
    return strrchr(folder, '/') + 1;
}

static bool have_shared_library(const char *test)
{
    if (strcmp(variant(), "release") == 0 || strcmp(variant(), "debug") == 0)
        return have_program("nm", test) && have_program("pkg-config", test);
    fprintf(stderr, "%s: skipped, no shared library with sanitizers\n", test);
    return false;
}

START_TEST(the_program_is_hardened_as_packages_are)
{
    static char out[16384];
    if (strcmp(variant(), "release") != 0 || !have_program("readelf", "hardening"))
        return;
    run_command(out, sizeof out,
                "readelf -Wld %s | grep -E 'GNU_RELRO|BIND_NOW|NOW|Type: *DYN|DYN \\('",
                MK_TEST_APP);
    ck_assert_msg(strstr(out, "GNU_RELRO") && strstr(out, "NOW"), "%s", out);
    run_command(out, sizeof out,
                "readelf -W --dyn-syms %s | grep -oE '__(stack_chk_fail|[a-z]+_chk)'", MK_TEST_APP);
    ck_assert_msg(strstr(out, "__stack_chk_fail") && strstr(out, "printf_chk"), "%s", out);
}
END_TEST

START_TEST(make_without_the_libraries_says_what_to_do)
{
    char out[4096];
    int code =
        run_command(out, sizeof out, "make -C %s --no-print-directory BUILD=%s PKGCONFIG=false all",
                    MK_SOURCE_DIR, scratch("bare"));
    ck_assert_msg(code != 0 && strstr(out, "'make deps' installs them"), "%d %s", code, out);
    ck_assert_ptr_null(strstr(out, "compilation terminated"));
}
END_TEST

/* A program in the place of the tests, with the suites log and tui, which goes by the clock. */
static const char *two_suites(const char *each)
{
    static char script[300];
    char text[500];
    snprintf(text, sizeof text, "#!/bin/sh\n[ $1 != --list ] || { echo log; echo tui; exit; }\n%s",
             each);
    snprintf(script, sizeof script, "%s", scratch_text("tests.sh", text));
    run_command(NULL, 0, "chmod +x %s", script);
    return script;
}

START_TEST(suites_are_totalled_with_what_they_skipped_and_a_failure_stays_one)
{
    static const char *const fails[] = {"none", "log", "tui"};
    char out[4096], each[300];
    for (int i = 0; i < 3; i++) {
        snprintf(each, sizeof each,
                 "echo $1: skipped, no $1 >&2\n[ $1 = log ] && n=3 || n=4\n"
                 "echo \"33%%: Checks: $n, Failures: 1, Errors: 2\"\n"
                 "[ $1 != %s ] || { echo test_x.c:7:F:case:$1_is_wrong:0: no; exit 7; }\n",
                 fails[i]);
        int code = run_command(out, sizeof out, "%s/tools/run-tests.sh %s %s", MK_SOURCE_DIR,
                               two_suites(each), i == 2 ? "asan" : "release");
        ck_assert_msg(code == (i == 0 ? 0 : 7), "%d %s", code, out);
        ck_assert_msg(strstr(out, "7 checks, 2 failures, 4 errors"), "%s", out);
        ck_assert_msg(strstr(out, "2 skipped:\n  log: skipped, no log\n  tui: skipped"), "%s", out);
        const char *failed = strstr(out, "failed: ");
        ck_assert_msg(i == 0 ? !failed : failed && strncmp(failed + 8, fails[i], 3) == 0, "%s",
                      out);
        ck_assert_msg(i == 0 || strstr(failed, "\n  test_x.c:7:F:case:"), "%s", out);
    }
}
END_TEST

/* The suite "tui" goes by the clock and "log" does not. */
START_TEST(what_goes_by_the_clock_and_fails_beside_others_is_tried_once_more_by_itself)
{
    static const char fails_once[] = "n=1; [ $1 = %s ] && [ ! -e $0.once ] && n=0 && : >$0.once\n"
                                     "[ $1 = log ] && sleep 0.3; echo $1 ends\n"
                                     "echo \"Checks done: $n\"\n[ $n = 1 ] || exit 7\n";
    char out[4096], each[400];
    for (int i = 0; i < 2; i++) {
        snprintf(each, sizeof each, fails_once, i == 0 ? "tui" : "log");
        const char *suites = two_suites(each);
        int code = run_command(out, sizeof out, "rm -f %s.once; %s/tools/run-tests.sh %s release",
                               suites, MK_SOURCE_DIR, suites);
        const char *again = strstr(out, "tui failed beside other suites");
        ck_assert_msg(code == (i == 0 ? 0 : 7), "%d %s", code, out);
        ck_assert_msg(i == 0 ? again && strstr(again, "tui ends") && !strstr(again, "log ends") &&
                                   !strstr(out, "failed: ")
                             : !again && strstr(out, "failed: log"),
                      "%s", out);
    }
}
END_TEST

START_TEST(what_a_suite_prints_stays_in_one_piece)
{
    char out[4096];
    int code = run_command(out, sizeof out, "%s/tools/run-tests.sh %s release", MK_SOURCE_DIR,
                           two_suites("for i in 1 2 3; do echo $1 $i; sleep 0.1; done\n"));
    ck_assert_msg(code == 0 && strstr(out, "log 1\nlog 2\nlog 3\n") &&
                      strstr(out, "tui 1\ntui 2\ntui 3\n"),
                  "%d %s", code, out);
}
END_TEST

START_TEST(who_ends_the_run_ends_its_suites)
{
    char out[4096];
    const char *script = two_suites("echo $$ >$0.$1\nexec sleep 100\n");
    int code = run_command(out, sizeof out,
                           "sh -c '%s/tools/run-tests.sh %s release & run=$!; i=0; "
                           "until [ -s %s.log -a -s %s.tui ] || [ $((i += 1)) = 100 ]; do "
                           "sleep 0.1; done; kill $run; wait $run; echo ended with $?; "
                           "for pid in $(cat %s.log %s.tui); do kill -0 $pid && echo alive; done'",
                           MK_SOURCE_DIR, script, script, script, script, script);
    ck_assert_msg(code != 0 && strstr(out, "ended with 130") && strstr(out, "No such process") &&
                      !strstr(out, "alive"),
                  "%d %s", code, out);
}
END_TEST

/* --- symbols -------------------------------------------------------------------------------- */

#define LIBRARY "$(ls \"$(dirname " MK_TEST_APP ")\"/libmechkit.so.*)"

START_TEST(the_library_exports_what_the_headers_declare_and_nothing_else)
{
    char out[4096];
    if (!have_shared_library("pack"))
        return;
    int code = run_command(out, sizeof out, "%s/tools/abi.sh %s", MK_SOURCE_DIR, LIBRARY);
    ck_assert_msg(code == 0, "%s", out);
}
END_TEST

START_TEST(a_function_that_is_not_exported_and_one_that_is_gone_are_found)
{
    char out[4096];
    if (!have_shared_library("pack"))
        return;
    const char *headers = scratch("include");
    run_command(NULL, 0, "mkdir -p %s && cp -r %s/include/mechkit %s", headers, MK_SOURCE_DIR,
                headers);
    run_command(NULL, 0, "sed -i 's/^int mk_effect_count/int mk_effect_number/' %s/mechkit/model.h",
                headers);
    int code = run_command(out, sizeof out, "%s/tools/abi.sh %s %s/mechkit %s/src/libmechkit.map",
                           MK_SOURCE_DIR, LIBRARY, headers, MK_SOURCE_DIR);
    ck_assert_int_eq(code, 1);
    ck_assert_ptr_nonnull(strstr(out, "missing in the map: mk_effect_number"));
    ck_assert_ptr_nonnull(strstr(out, "declared in no header: mk_effect_count"));
}
END_TEST

/* --- an installed mechkit ------------------------------------------------------------------- */

static const char *install(void)
{
    const char *prefix = scratch("usr");
    char out[8192];
    int code = run_command(out, sizeof out,
                           "env -u MAKEFLAGS -u MAKELEVEL make -s -C %s VARIANT=%s "
                           "BUILD=\"$(dirname \"$(dirname %s)\")\" PREFIX=%s install",
                           MK_SOURCE_DIR, variant(), MK_TEST_APP, prefix);
    ck_assert_msg(code == 0, "%s", out);
    return prefix;
}

/* Builds the example by what pkg-config says, and runs it. */
static void build_and_run_example(const char *prefix, const char *how, const char *libs)
{
    char out[8192];
    int code = run_command(
        out, sizeof out,
        "cd %s && export PKG_CONFIG_PATH=lib/pkgconfig && cc -std=c11 -Wall -Wextra -Werror "
        "-o swing_up share/doc/mechkit/examples/swing_up.c $(pkg-config --cflags mechkit) %s && "
        "LD_LIBRARY_PATH=lib ./swing_up share/mechkit/models/pendubot.ini run.csv",
        prefix, libs);
    ck_assert_msg(code == 0, "%s: %s", how, out);
    ck_assert_msg(strstr(out, "caught after 1.9") != NULL, "%s: %s", how, out);
    ck_assert_msg(strstr(out, "model against log: rms 0.000") != NULL, "%s: %s", how, out);
}

/* With debug information the program alone has 35 MB. */
/* Every setup, a prediction and an explanation, and one page that needs nothing beside it. */
START_TEST(the_demo_ends_in_a_page_of_what_was_run)
{
    char out[8192];
    if (strcmp(variant(), "release") != 0 ||
        !have_program("gnuplot", "the_demo_ends_in_a_page_of_what_was_run"))
        return;
    int code = run_command(out, sizeof out, "sh %s/tools/demo.sh %s %s 2>&1", MK_SOURCE_DIR,
                           scratch("demo"), MK_TEST_APP);
    ck_assert_msg(code == 0 && strstr(out, "stribeck at joint 2"), "%s", out);
    char *page = slurp_file(scratch("demo/index.html"));
    ck_assert_ptr_nonnull(page);
    static const char *const setups[] = {"pendubot-mid",   "pendubot-top", "furuta",
                                         "reaction-wheel", "pi-speed",     "open-loop"};
    for (size_t i = 0; i < sizeof setups / sizeof setups[0]; i++) {
        char text[80];
        snprintf(text, sizeof text, "alt=\"plot of %s\" src=\"data:image/svg+xml;base64,",
                 setups[i]);
        ck_assert_msg(strstr(page, text) != NULL, "%s", text);
    }
    ck_assert_ptr_nonnull(strstr(page, "srcdoc=\"&lt;!doctype html&gt;"));
    ck_assert_ptr_nonnull(strstr(page, "Something is missing in the model, and has a name."));
    ck_assert_ptr_null(strstr(page, "src=\"http"));
    free(page);
}
END_TEST

START_TEST(an_installed_program_has_10_mb_at_most)
{
    struct stat info;
    if (!have_shared_library("pack"))
        return;
    const char *prefix = install();
    char path[600];
    snprintf(path, sizeof path, "%s/bin/mechkit", prefix);
    ck_assert_int_eq(stat(path, &info), 0);
    ck_assert_int_le(info.st_size, 10000000);
}
END_TEST

START_TEST(the_example_builds_and_runs_with_what_is_installed)
{
    if (!have_shared_library("pack"))
        return;
    const char *prefix = install();
    char out[512];
    run_command(out, sizeof out, "cat %s/etc/security/limits.d/mechkit.conf", prefix);
    ck_assert_msg(strstr(out, "rtprio 80") && strstr(out, "memlock unlimited"), "%s", out);
    build_and_run_example(prefix, "shared", "$(pkg-config --libs mechkit)");
    build_and_run_example(
        prefix, "static",
        "$(pkg-config --static --libs mechkit | sed 's/-lmechkit/-l:libmechkit.a/')");
}
END_TEST

START_TEST(the_package_ships_the_limits_of_real_time)
{
    char *files = slurp_file(MK_SOURCE_DIR "/debian/mechkit.install");
    ck_assert_ptr_nonnull(files);
    ck_assert_ptr_nonnull(strstr(files, "etc/security/limits.d/mechkit.conf\n"));
    free(files);
}
END_TEST

START_TEST(a_run_that_ends_late_without_real_time_says_what_to_do)
{
    char out[4096];
    if (!have_program("setpriv", "real time"))
        return;
    const char *script =
        scratch_text("late.cmd", "faults from 20 to 400 delay 3500us\nsetup pendubot-top\n"
                                 "start\nwait 5\n");
    /* A plain user has none of these capabilities, and may not say so. */
    const char *less = geteuid() == 0 ? "setpriv --bounding-set=-sys_nice,-ipc_lock " : "";
    int code = run_command(out, sizeof out, "%sprlimit --rtprio=0 %s run %s --out %s", less,
                           MK_TEST_APP, script, scratch("late"));
    ck_assert_msg(code == 1 && strstr(out, "the motor is off"), "%d %s", code, out);
    ck_assert_msg(strstr(out, "no real-time priority") && strstr(out, "join plugdev") &&
                      strstr(out, "docs/boards.md"),
                  "%s", out);
}
END_TEST

/* --- documentation -------------------------------------------------------------------------- */

/* Every href and src of the pages in `folder` that is no address elsewhere is a file there, and
 * every anchor is in it. */
#define CHECK_LINKS                                                                                \
    "cd %s && for page in *.html; do grep -oE '(href|src)=\"[^\"]*\"' $page | "                    \
    "sed 's/^[a-z]*=\"//; s/\"$//' | grep -v '^[a-z]*:' | sort -u | while read -r link; do "       \
    "file=${link%%%%#*}; file=${file:-$page}; test -s \"$file\" || echo \"$page: $link\"; "        \
    "case $link in *'#'*) grep -q \"id=\\\"${link##*#}\\\"\" \"$file\" || echo \"$page: $link\" "  \
    ";; "                                                                                          \
    "esac; done; done"

START_TEST(the_pages_are_complete_and_every_link_leads_somewhere)
{
    char out[8192];
    if (!have_program("pandoc", "pack") || !have_program("gnuplot", "pack"))
        return;
    const char *folder = scratch("html");
    int code = run_command(out, sizeof out, "%s/tools/html/build.sh %s %s", MK_SOURCE_DIR,
                           MK_TEST_APP, folder);
    ck_assert_msg(code == 0 && strstr(out, " 9 plots"), "%s", out);
    run_command(out, sizeof out, CHECK_LINKS, folder);
    ck_assert_msg(!*out, "%s", out);
    /* The check itself finds what is broken: */
    run_command(NULL, 0, "rm %s/gallery/phase.svg; sed -i 's/id=\"gallery/id=\"x/' %s/gallery.html",
                folder, folder);
    run_command(out, sizeof out, CHECK_LINKS, folder);
    ck_assert_msg(strstr(out, "gallery.html: gallery/phase.svg") != NULL, "%s", out);
}
END_TEST

Suite *suite_pack(void)
{
    Suite *s = suite_create("pack");
    TCase *symbols = tcase_create("symbols");
    tcase_set_timeout(symbols, 30);
    tcase_add_test(symbols, the_library_exports_what_the_headers_declare_and_nothing_else);
    tcase_add_test(symbols, a_function_that_is_not_exported_and_one_that_is_gone_are_found);
    TCase *made = tcase_create("made");
    tcase_set_timeout(made, 60);
    tcase_add_test(made, the_program_is_hardened_as_packages_are);
    tcase_add_test(made, make_without_the_libraries_says_what_to_do);
    tcase_add_test(made, suites_are_totalled_with_what_they_skipped_and_a_failure_stays_one);
    tcase_add_test(made,
                   what_goes_by_the_clock_and_fails_beside_others_is_tried_once_more_by_itself);
    tcase_add_test(made, what_a_suite_prints_stays_in_one_piece);
    tcase_add_test(made, who_ends_the_run_ends_its_suites);
    suite_add_tcase(s, made);
    suite_add_tcase(s, symbols);
    TCase *installed = tcase_create("installed");
    tcase_set_timeout(installed, 120);
    tcase_add_test(installed, the_package_ships_the_limits_of_real_time);
    tcase_add_test(installed, a_run_that_ends_late_without_real_time_says_what_to_do);
    tcase_add_test(installed, an_installed_program_has_10_mb_at_most);
    tcase_add_test(installed, the_example_builds_and_runs_with_what_is_installed);
    suite_add_tcase(s, installed);
    /* A sanitizer sees nothing of them that another test does not show. */
    TCase *pages = tcase_create("pages");
    tcase_set_timeout(pages, 120);
    tcase_set_tags(pages, "long");
    tcase_add_test(pages, the_demo_ends_in_a_page_of_what_was_run);
    tcase_add_test(pages, the_pages_are_complete_and_every_link_leads_somewhere);
    suite_add_tcase(s, pages);
    return s;
}
