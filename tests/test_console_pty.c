/* The console in a real terminal: keys go in, the screen is read. */
#include "suites.h"

#include <glob.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <termios.h>
#include <unistd.h>

#include "mechkit/log.h"
#include "support/files.h"
#include "support/pty.h"

/* Sanitizers and a busy machine: what takes a second may take many. */
#define SOON 20.0
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define LATER 600.0
#define SLOWED_DOWN true
#else
#define LATER 120.0
#define SLOWED_DOWN false
#endif

static char folder[512];
static struct pty term;

static void in_new_folder(void)
{
    snprintf(folder, sizeof folder, "%s", scratch("console"));
    mkdir(folder, 0777);
    memset(&term, 0, sizeof term);
    term.fd = -1;
    term.ended = true;
}

static void end_all(void)
{
    pty_end(&term);
}

static const char *in_folder(const char *name)
{
    static char path[600];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    return path;
}

/* The console with these options (ended by NULL). */
static void console_at(int rows, int cols, const char *language, const char *const *options)
{
    const char *argv[20] = {MK_TEST_APP, "console"};
    for (int i = 0; options[i]; i++)
        argv[i + 2] = options[i];
    pty_start(&term, rows, cols, folder, language, argv);
}

static void console(const char *const *options)
{
    console_at(24, 80, "C.UTF-8", options);
}

/* Runs in real time end with a fault where the machine stands still for 20 ms, as they should. Such
 * a machine cannot tell anything about the screen; but that it stood still must have been seen here
 * too, else it was the program that did. A sanitizer stops the threads of a program by itself. */
static void skip_on_a_stalled_machine(void)
{
    static const char *const runs[] = {"run-001.csv", "run-002.csv", "run-003.csv"};
    for (int i = 0; i < 3; i++) {
        char *text = slurp_file(in_folder(runs[i]));
        bool fault =
            text && (strstr(text, "# fault: watchdog") || strstr(text, "# fault: overrun"));
        free(text);
        if (fault && (SLOWED_DOWN || term.overslept_us > 10000)) {
            printf(
                "console_pty: skipped, the machine stood still for %ld ms and the watchdog bit\n",
                term.overslept_us / 1000);
            fflush(stdout);
            pty_end(&term);
            exit(0);
        }
    }
}

static void shows(const char *text)
{
    if (pty_shows(&term, text, SOON))
        return;
    skip_on_a_stalled_machine();
    ck_abort_msg("the screen never shows '%s'", text);
}

static void run_pendubot(void)
{
    shows("READY");
    pty_type(&term, "r");
    shows("RUNNING");
}

/* Reads a log and the last of its metadata of that key; the log must be whole. */
static void check_log(const char *name, const char *key, const char *value)
{
    struct mk_log *log;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_log_read(in_folder(name), &log, &err) == MK_OK, "%s", err.message);
    const char *found = mk_log_find_meta(log, key);
    ck_assert_msg(found && strstr(found, value), "%s: %s", key, found ? found : "(none)");
    mk_log_free(log);
}

static void ends_with(int code)
{
    ck_assert_int_eq(pty_exit_code(&term, SOON), code);
    pty_run(&term, 0.1);
    ck_assert(!term.vt.alternate);
    ck_assert(term.vt.cursor_shown);
}

/* --- what an operator does ------------------------------------------------------------------- */

START_TEST(a_whole_experiment_goes_by_keys)
{
    console((const char *const[]){"--fast", NULL});
    shows("NO SETUP");
    pty_type(&term, "s");
    shows("choose a setup");
    pty_type(&term, "\r");
    shows("READY");
    shows("simulated time");
    pty_type(&term, "r");
    shows("RUNNING  balance"); /* see it catch */
    pty_type(&term, "g");
    shows("gains of pendubot-mid, RUNNING");
    pty_type(&term, "\x1b[B9.5\rd"); /* second gain, another value, download */
    shows("sent");
    pty_type(&term, "90\rd");
    shows("UNSTABLE with these gains"); /* is asked once more, and not sent */
    pty_type(&term, "u");
    pty_type(&term, "\x1b[A90");
    shows("k_q1");
    pty_type(&term, "\r");
    shows("> "); /* pending */
    pty_type(&term, "u");
    pty_type(&term, "\x1b");
    pty_run(&term, 0.3);
    pty_type(&term, "h");
    shows("after the run");
    shows("caught");
    pty_type(&term, "w");
    shows("save pendubot-mid.csv");
    pty_type(&term, "\r");
    shows("saved pendubot-mid.csv");
    pty_type(&term, "e");
    ck_assert(pty_shows(&term, "believe pendubot-mid-explain/extended.ini", LATER));
    pty_type(&term, "q");
    ends_with(0);
    ck_assert_int_eq(access(in_folder("pendubot-mid.csv"), R_OK), 0);
    ck_assert_int_eq(access(in_folder("pendubot-mid-explain/report.html"), R_OK), 0);
    check_log("pendubot-mid.csv", "changed", "k_dq1=9.5");
    ck_assert_int_eq(access(in_folder(".mechkit-console"), F_OK), -1);
}
END_TEST

START_TEST(a_blank_stops_the_motor_from_anywhere)
{
    const char *open[] = {"", "g", "?", ":", "q", ":echo a"};
    for (size_t i = 0; i < sizeof open / sizeof open[0]; i++) {
        console((const char *const[]){"--fast", "--setup", "pendubot-mid", NULL});
        run_pendubot();
        pty_type(&term, open[i]);
        pty_run(&term, 0.2);
        pty_type(&term, i == 5 ? "  " : " "); /* after a letter, a blank is typed */
        if (open[i][0])
            pty_type(&term, open[i][0] == ':' ? "\x1b" : "");
        shows("FAULT");
        shows("e-stop");
        pty_end(&term);
    }
}
END_TEST

START_TEST(the_command_line_completes_recalls_and_reports_errors)
{
    console((const char *const[]){"--fast", NULL});
    pty_type(&term, ":setup pendubot-t\t\r");
    shows("READY");
    shows("pendubot-top");
    pty_type(&term, ":sav\t");
    shows("save!");
    pty_type(&term, "\x15set nothing 1\r");
    shows("ERROR setup pendubot-top has no parameter 'nothing'");
    pty_type(&term, ":\x1b[A\x1b[A");
    shows(":setup pendubot-top");
    pty_type(&term, "\x1b");
    pty_run(&term, 0.3);
    pty_type(&term, ":quit\r");
    ends_with(0);
}
END_TEST

START_TEST(a_line_is_recalled_in_the_next_session)
{
    for (int session = 0; session < 3; session++) {
        console((const char *const[]){NULL});
        shows("NO SETUP");
        pty_type(&term, session ? ":\x1bOA\x1bOA" : ":show limits\r");
        if (session) /* the newest is the `quit` of the last session */
            shows(":show limits");
        pty_type(&term, session ? "\x03:quit\r" : ":quit\r");
        ends_with(0);
        pty_end(&term);
    }
    char *text = slurp_file(in_folder("state/mechkit/history"));
    ck_assert_str_eq(text, "show limits\nquit\n");
    free(text);
}
END_TEST

START_TEST(a_history_that_cannot_be_kept_is_no_trouble)
{
    fclose(fopen(in_folder("state"), "w")); /* a file where the folder should be */
    console((const char *const[]){NULL});
    shows("NO SETUP");
    pty_type(&term, ":show limits\r");
    pty_type(&term, ":quit\r");
    ends_with(0);
}
END_TEST

START_TEST(what_is_done_is_recorded_as_a_command_file)
{
    console((const char *const[]){"--fast", "--setup", "pi-speed", NULL});
    shows("READY");
    pty_type(&term, ":record done.cmd\r");
    shows("recording to done.cmd");
    run_pendubot();
    shows("track");
    pty_type(&term, ":set speed 20\r");
    shows(": set speed 20");
    pty_type(&term, "h");
    shows("after the run");
    pty_type(&term, "R");
    shows("recorded to done.cmd");
    pty_type(&term, "q");
    ends_with(0);
    char *text = slurp_file(in_folder("done.cmd"));
    ck_assert_ptr_nonnull(text);
    ck_assert_msg(strncmp(text, "setup pi-speed\nstart\nwait ", 26) == 0, "%s", text);
    ck_assert_msg(strstr(text, "\nset speed 20\n") && strstr(text, "\nhalt\n"), "%s", text);
    free(text);
}
END_TEST

START_TEST(a_log_is_replayed_and_compared_on_the_same_screen)
{
    console((const char *const[]){"--fast", "--setup", "pendubot-mid", NULL});
    run_pendubot();
    shows("balance");
    pty_type(&term, "h");
    shows("after the run");
    pty_type(&term, "m");
    shows("dotted: model");
    pty_type(&term, "p");
    shows("REPLAY");
    pty_type(&term, "f");
    shows(" LOG ");
    pty_type(&term, "\x1b[D");
    shows("cursor");
    pty_type(&term, "q");
    ends_with(0);
}
END_TEST

/* --- what goes wrong ------------------------------------------------------------------------- */

START_TEST(a_closed_terminal_ends_the_run_and_the_next_start_says_so)
{
    console((const char *const[]){"--setup", "pendubot-mid", NULL});
    run_pendubot();
    pty_run(&term, 0.5);
    pty_hang_up(&term);
    ck_assert_int_eq(pty_exit_code(&term, SOON), 1);
    check_log("run-001.csv", "summary", "samples");
    pty_end(&term);
    console((const char *const[]){NULL});
    shows("the last session was ended by");
    shows("run-001.csv");
    pty_type(&term, "q");
    ends_with(0);
}
END_TEST

START_TEST(a_signal_ends_the_run_and_gives_the_terminal_back)
{
    static const int numbers[] = {SIGTERM, SIGHUP, SIGUSR1};
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++) {
        struct termios before, after;
        console((const char *const[]){"--setup", "pendubot-mid", NULL});
        tcgetattr(term.fd, &before);
        run_pendubot();
        ck_assert_int_eq(tcgetattr(term.fd, &after), 0);
        ck_assert(!(after.c_lflag & ECHO));
        kill(term.child, numbers[i]);
        shows("motor off, log kept");
        ck_assert_int_eq(tcgetattr(term.fd, &after), 0);
        ck_assert((after.c_lflag & (ECHO | ICANON | ISIG)) == (ECHO | ICANON | ISIG));
        ends_with(1);
        pty_end(&term);
    }
    check_log("run-002.csv", "summary", "samples");
}
END_TEST

START_TEST(ctrl_z_stops_the_motor_before_the_program)
{
    int status;
    console((const char *const[]){"--setup", "pendubot-mid", NULL});
    run_pendubot();
    pty_type(&term, "\x1a");
    pty_run(&term, 0.8);
    ck_assert_int_eq(waitpid(term.child, &status, WUNTRACED), term.child);
    ck_assert(WIFSTOPPED(status));
    ck_assert(!term.vt.alternate);
    check_log("run-001.csv", "summary", "samples");
    kill(term.child, SIGCONT);
    shows("stopped by Ctrl-Z");
    shows("READY");
    pty_type(&term, "q");
    ends_with(0);
}
END_TEST

START_TEST(a_crash_leaves_the_motor_off_the_log_and_the_terminal)
{
    console((const char *const[]){"--setup", "pendubot-mid", NULL});
    run_pendubot();
    kill(term.child, SIGSEGV);
    shows("crashed; motor off, log kept");
    int code = pty_exit_code(&term, SOON);
    ck_assert_msg(code != 0 && code != -1, "%d", code);
    ck_assert(!term.vt.alternate);
    check_log("run-001.csv", "fault", "e-stop");
    pty_end(&term);
    console((const char *const[]){NULL});
    shows("did not end properly");
    shows("ended in mid run");
    pty_type(&term, "q");
    ends_with(0);
}
END_TEST

START_TEST(a_kill_leaves_a_log_that_can_be_read)
{
    console((const char *const[]){"--setup", "pendubot-mid", NULL});
    run_pendubot();
    pty_run(&term, 0.5);
    kill(term.child, SIGKILL);
    ck_assert_int_eq(pty_exit_code(&term, SOON), 128 + SIGKILL);
    check_log("run-001.csv", "setup", "pendubot-mid");
    pty_end(&term);
    console((const char *const[]){NULL});
    shows("did not end properly");
    pty_type(&term, "q");
    ends_with(0);
}
END_TEST

/* Nobody reads: the screen cannot write any more, and lets go of the motor. */
START_TEST(a_terminal_that_stands_still_loses_the_motor)
{
    console((const char *const[]){"--setup", "pendubot-mid", NULL});
    run_pendubot();
    bool tripped = false;
    for (int k = 0; k < 200 && !tripped; k++) {
        usleep(100000);
        char *text = slurp_file(in_folder("run-001.csv"));
        tripped = text && strstr(text, "# fault: e-stop");
        free(text);
    }
    if (!tripped)
        skip_on_a_stalled_machine();
    ck_assert(tripped);
    shows("the screen stood still");
    shows("acknowledge");
    pty_type(&term, "q");
    ends_with(0);
}
END_TEST

START_TEST(a_stuck_terminal_does_not_keep_the_program_from_ending)
{
    console((const char *const[]){"--setup", "pendubot-mid", NULL});
    run_pendubot();
    usleep(1500000); /* enough for what a terminal holds back */
    kill(term.child, SIGTERM);
    bool ended = false;
    for (int k = 0; k < 200 && !ended; k++) {
        usleep(50000);
        ended = waitpid(term.child, &term.status, WNOHANG) == term.child;
    }
    term.ended = ended;
    ck_assert(ended);
    check_log("run-001.csv", "summary", "samples");
}
END_TEST

/* --- terminals ------------------------------------------------------------------------------- */

START_TEST(it_outlives_a_storm_of_sizes)
{
    static const int sizes[][2] = {{24, 80},  {60, 200}, {1, 1},   {5, 20},  {16, 60}, {15, 59},
                                   {40, 120}, {3, 300},  {100, 3}, {24, 79}, {25, 81}};
    console((const char *const[]){"--setup", "furuta", NULL});
    run_pendubot();
    for (int k = 0; k < 110; k++) {
        pty_resize(&term, sizes[k % 11][0], sizes[k % 11][1]);
        pty_type(&term, k % 5 == 0 ? "g" : k % 5 == 1 ? "\x1b" : k % 5 == 2 ? "?" : "x");
        pty_run(&term, 0.02);
    }
    pty_type(&term, "\x1b");
    pty_resize(&term, 24, 80);
    pty_type(&term, "\x0c");
    shows("E-STOP");
    pty_type(&term, "h");
    shows("READY");
    pty_type(&term, "q");
    ends_with(0);
    ck_assert_uint_eq(term.vt.unknown, 0);
}
END_TEST

START_TEST(a_plain_terminal_gets_plain_characters_and_mono_no_colours)
{
    console_at(24, 80, "C", (const char *const[]){"--mono", "--setup", "pendubot-mid", NULL});
    run_pendubot();
    shows("balance");
    for (int i = 0; i < 24 * 80; i++) {
        struct vt_cell c = term.vt.cell[i];
        ck_assert_msg(c.ch >= ' ' && c.ch < 0x7f, "character %x", (unsigned)c.ch);
        ck_assert(c.fg == -1 && c.bg == -1);
    }
    pty_type(&term, "h");
    shows("READY");
    pty_type(&term, "q");
    ends_with(0);
}
END_TEST

START_TEST(a_terminal_that_cannot_place_the_cursor_is_refused)
{
    pty_start(
        &term, 24, 80, folder, "C.UTF-8",
        (const char *const[]){"/bin/sh", "-c", "TERM=dumb exec \"$0\" console", MK_TEST_APP, NULL});
    shows("TERM=vt100");
    ck_assert_int_eq(pty_exit_code(&term, SOON), 1);
}
END_TEST

START_TEST(a_full_disk_is_told_in_the_summary)
{
    static const char script[] =
        "ulimit -f 100; trap '' XFSZ; exec \"$0\" console --setup pendubot-mid";
    pty_start(&term, 24, 80, folder, "C.UTF-8",
              (const char *const[]){"/bin/sh", "-c", script, MK_TEST_APP, NULL});
    run_pendubot();
    shows("FAULT     log at");
    pty_type(&term, "q");
    ends_with(0);
}
END_TEST

START_TEST(a_log_that_is_gone_is_told)
{
    console((const char *const[]){"--setup", "pendubot-mid", NULL});
    run_pendubot();
    shows("balance");
    ck_assert_int_eq(unlink(in_folder("run-001.csv")), 0);
    pty_type(&term, "h");
    shows("ERROR run-001.csv");
    pty_type(&term, "q");
    ends_with(0);
}
END_TEST

START_TEST(without_a_terminal_it_says_what_to_use_instead)
{
    char command[1200];
    snprintf(command, sizeof command, "cd %s && %s console </dev/null 2>err.txt", folder,
             MK_TEST_APP);
    int status = system(command);
    ck_assert(WIFEXITED(status) && WEXITSTATUS(status) == 1);
    char *text = slurp_file(in_folder("err.txt"));
    ck_assert_msg(text && strstr(text, "mechkit run"), "%s", text);
    free(text);
}
END_TEST

/* --- chance ---------------------------------------------------------------------------------- */

/* Seconds of it; ten minutes on demand. */
static double monkey_seconds(void)
{
    const char *text = getenv("MECHKIT_MONKEY_S");
    return text ? strtod(text, NULL) : 3.0;
}

/* No slash: nothing outside of the folder. */
static void type_anything(unsigned *seed)
{
    static const char *const words[] = {"\x1b",
                                        "\x1bOA",
                                        "\x1bOB",
                                        "\x1bOC",
                                        "\x1bOD",
                                        "\x1b[5~",
                                        "\x1b[6~",
                                        "\r",
                                        "\t",
                                        "r",
                                        "r",
                                        "h",
                                        " ",
                                        "a",
                                        "s",
                                        "g",
                                        "d",
                                        ":",
                                        "s2\r",
                                        "s4\r",
                                        "s5\r",
                                        "\xc3\xa9",
                                        "\x1b[Z",
                                        "\x0c",
                                        "i",
                                        "m",
                                        "p",
                                        "w\r",
                                        ":wait 1\r",
                                        ":set ",
                                        "f",
                                        "t",
                                        "]",
                                        "[",
                                        "R\r",
                                        "e",
                                        ":gains 1 2 3 4\r",
                                        "+",
                                        "\x03",
                                        ":show gains\r",
                                        ":rate 1000\r"};
    unsigned n = (unsigned)rand_r(seed);
    char one[2] = {(char)(n / 64 % 95 + ' '), '\0'};
    if (n % 3 == 0 && one[0] != '/' && one[0] != 'q')
        pty_type(&term, one);
    else
        pty_type(&term, words[n / 64 % (sizeof words / sizeof words[0])]);
}

/* Whatever has been typed: h halts, and then nothing runs. */
static void check_halt(void)
{
    pty_type(&term, "\x1b");
    pty_run(&term, 0.15);
    pty_type(&term, "\x1b");
    pty_run(&term, 0.15);
    pty_type(&term, "\x1b");
    pty_run(&term, 0.15);
    pty_type(&term, "h");
    ck_assert(pty_hides(&term, " RUNNING ", LATER));
}

/* Every run left a log, and every log is whole. */
static int check_all_logs(void)
{
    glob_t found;
    int runs = glob(in_folder("*.csv"), 0, NULL, &found) == 0 ? (int)found.gl_pathc : 0;
    for (int i = 0; i < runs; i++) {
        struct mk_log *log;
        struct mk_error err = MK_ERROR_INIT;
        ck_assert_msg(mk_log_read(found.gl_pathv[i], &log, &err) == MK_OK, "%s", err.message);
        ck_assert(!log->truncated);
        mk_log_free(log);
    }
    if (runs > 0)
        globfree(&found);
    return runs;
}

START_TEST(random_keys_break_nothing_and_halt_halts)
{
    const char *wanted = getenv("MECHKIT_MONKEY_SEED");
    double left = monkey_seconds();
    unsigned seed = wanted ? (unsigned)strtoul(wanted, NULL, 10) : 1;
    int halts = 1;
    console((const char *const[]){"--setup", "pendubot-mid", NULL});
    shows("READY");
    int keys = 0;
    for (; left > 0.0; left -= 0.02) {
        type_anything(&seed);
        pty_run(&term, 0.02);
        if (++keys % 100 == 0) {
            check_halt();
            halts++;
        }
        ck_assert_msg(waitpid(term.child, &term.status, WNOHANG) == 0, "it has ended: %d",
                      term.status);
    }
    check_halt();
    pty_type(&term, ":quit\r");
    ends_with(0);
    ck_assert_uint_eq(term.vt.unknown, 0);
    int runs = check_all_logs();
    if (getenv("MECHKIT_MONKEY_S"))
        printf("random keys: %d typed, %d halts, motor off after each, %d logs whole\n", keys,
               halts, runs);
}
END_TEST

Suite *suite_console_pty(void)
{
    Suite *s = suite_create("console_pty");
    TCase *keys = tcase_create("keys"), *trouble = tcase_create("trouble");
    TCase *kinds = tcase_create("terminals");
    TCase *const all[] = {keys, trouble, kinds};
    for (int i = 0; i < 3; i++) {
        tcase_add_checked_fixture(all[i], in_new_folder, end_all);
        tcase_set_timeout(all[i], 120);
        suite_add_tcase(s, all[i]);
    }
    tcase_add_test(keys, a_whole_experiment_goes_by_keys);
    tcase_add_test(keys, a_blank_stops_the_motor_from_anywhere);
    tcase_add_test(keys, the_command_line_completes_recalls_and_reports_errors);
    tcase_add_test(keys, a_line_is_recalled_in_the_next_session);
    tcase_add_test(keys, a_history_that_cannot_be_kept_is_no_trouble);
    tcase_add_test(keys, what_is_done_is_recorded_as_a_command_file);
    tcase_add_test(keys, a_log_is_replayed_and_compared_on_the_same_screen);
    tcase_add_test(trouble, a_closed_terminal_ends_the_run_and_the_next_start_says_so);
    tcase_add_test(trouble, a_signal_ends_the_run_and_gives_the_terminal_back);
    tcase_add_test(trouble, ctrl_z_stops_the_motor_before_the_program);
    tcase_add_test(trouble, a_crash_leaves_the_motor_off_the_log_and_the_terminal);
    tcase_add_test(trouble, a_kill_leaves_a_log_that_can_be_read);
    tcase_add_test(trouble, a_terminal_that_stands_still_loses_the_motor);
    tcase_add_test(trouble, a_stuck_terminal_does_not_keep_the_program_from_ending);
    tcase_add_test(kinds, it_outlives_a_storm_of_sizes);
    tcase_add_test(kinds, a_plain_terminal_gets_plain_characters_and_mono_no_colours);
    tcase_add_test(kinds, a_terminal_that_cannot_place_the_cursor_is_refused);
    tcase_add_test(kinds, a_full_disk_is_told_in_the_summary);
    tcase_add_test(kinds, a_log_that_is_gone_is_told);
    tcase_add_test(kinds, without_a_terminal_it_says_what_to_use_instead);
    TCase *random = tcase_create("chance");
    tcase_add_checked_fixture(random, in_new_folder, end_all);
    tcase_set_timeout(random, 120.0 + 4.0 * monkey_seconds());
    tcase_add_test(random, random_keys_break_nothing_and_halt_halts);
    suite_add_tcase(s, random);
    return s;
}
