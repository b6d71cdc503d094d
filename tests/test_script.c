/* Command files and the conditions in them: what they mean, and how they are refused. */
#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "console/script/cmd.h"
#include "console/script/cmdfile.h"
#include "console/script/condition.h"
#include "console/script/host.h"
#include "support/files.h"
#include "support/program.h"

/* --- conditions -------------------------------------------------------------------------- */

START_TEST(conditions_mean_what_they_say)
{
    struct mk_loop_snapshot s;
    memset(&s, 0, sizeof s);
    s.state = MK_LOOP_RUNNING;
    s.sample.t = 5, s.sample.q[0] = -1.5, s.sample.q[1] = 0.25, s.sample.v[0] = 49.5;
    s.sample.u = -2, s.sample.ref = 50;
    s.balanced_since = 4.0, s.caught_t = 1.5;
    const char *yes[] = {"running",
                         "balanced",
                         "no-fault",
                         "q1 < -1",
                         "|q1| >= 1.5",
                         "u == -2",
                         "q2 != 0",
                         "|q1 - q2| > 1.7",
                         "dq1 within 2% of 50",
                         "dq1 within 1 of ref",
                         "running and q2 > 0.2 and caught < 2",
                         "t > 4.9",
                         "-q1 > 1",
                         "q1 + q2 < 0"};
    const char *no[] = {"idle",
                        "faulted",
                        "unplugged",
                        "q1 > 0",
                        "dq1 within 0.5% of 50",
                        "running and idle",
                        "overruns > 0"};
    for (size_t i = 0; i < sizeof yes / sizeof yes[0]; i++) {
        ck_assert_int_eq(condition_check(yes[i], NULL), MK_OK);
        ck_assert_msg(condition_holds(yes[i], &s), "%s", yes[i]);
    }
    for (size_t i = 0; i < sizeof no / sizeof no[0]; i++) {
        ck_assert_int_eq(condition_check(no[i], NULL), MK_OK);
        ck_assert_msg(!condition_holds(no[i], &s), "%s", no[i]);
    }
    s.sample.ref = s.balanced_since = (double)NAN;
    ck_assert(!condition_holds("balanced", &s) && !condition_holds("ref < 1", &s) &&
              !condition_holds("ref >= 1", &s));
    s.fault = MK_FAULT_JUMP;
    ck_assert(condition_holds("encoder-jump", &s) && condition_holds("faulted", &s));
}
END_TEST

START_TEST(bad_conditions_are_refused_at_their_character)
{
    const char *bad[] = {"",
                         "q3 < 1",
                         "q1",
                         "q1 <",
                         "q1 < 1 or q2",
                         "|q1 < 1",
                         "q1 within 2 50",
                         "balanced and",
                         "1 = 1",
                         "q1 << 1",
                         "((((",
                         "q1 < 1 2",
                         "q1 within -5% of 0",
                         "q1 within - 0.1 of 2"};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct mk_error err = MK_ERROR_INIT;
        ck_assert_msg(condition_check(bad[i], &err) == MK_ERR_PARSE, "%s", bad[i]);
        ck_assert_int_gt(err.column, 0);
    }
    static const char alphabet[] = "q12du <>=|+-.%andwithof0 9e";
    struct mk_loop_snapshot s;
    memset(&s, 0, sizeof s);
    srand(6);
    for (int i = 0; i < 20000; i++) {
        char text[40];
        int n = rand() % 30;
        for (int k = 0; k < n; k++)
            text[k] = alphabet[(size_t)rand() % (sizeof alphabet - 1)];
        text[n] = 0;
        (void)condition_holds(text, &s);
    }
}
END_TEST

/* --- command files ----------------------------------------------------------------------- */

struct complaints {
    int count, line[16];
    char first[600];
};

static void collect(void *user, const struct mk_error *err)
{
    struct complaints *c = user;
    if (c->count == 0)
        snprintf(c->first, sizeof c->first, "%s", err->message);
    if (c->count < 16)
        c->line[c->count] = err->line;
    c->count++;
}

static struct cmdfile *parse(const char *text, struct complaints *c)
{
    static const struct cmd_known nothing;
    struct cmdfile *file;
    memset(c, 0, sizeof *c);
    enum mk_status st =
        cmdfile_read(scratch_text("s.cmd", text), &nothing, collect, c, &file, NULL);
    ck_assert_int_eq(st == MK_OK, c->count == 0);
    return file;
}

START_TEST(a_good_file_is_understood)
{
    struct complaints c;
    struct cmdfile *file =
        parse("# comment\n\n  setup pi-speed   # trailing\necho it's # not shown\n"
              "repeat 3\n repeat 2\nwait 0.1\nend\nend\nsave \"a name.csv\"\n",
              &c);
    ck_assert_msg(c.count == 0, "%s", c.first);
    ck_assert_uint_eq(cmdfile_command_count(file), 4);
    cmdfile_free(file);
}
END_TEST

START_TEST(a_mark_that_an_editor_puts_first_is_no_command)
{
    struct complaints c;
    char text[300];
    snprintf(text, sizeof text, "\xef\xbb\xbfsource %s\n",
             scratch_text("marked.cmd", "\xef\xbb\xbfsetup pi-speed\r\n"));
    struct cmdfile *file = parse(text, &c);
    ck_assert_msg(c.count == 0, "%s", c.first);
    ck_assert_uint_eq(cmdfile_command_count(file), 1);
    cmdfile_free(file);
    cmdfile_free(parse("setup pi-speed\n\xef\xbb\xbfhalt\n", &c)); /* in mid file it is text */
    ck_assert_int_eq(c.count, 1);
}
END_TEST

/* A command that is no number is 0 in the loop, which nobody would see. */
START_TEST(a_signal_that_is_no_number_during_the_run_is_refused_with_its_time)
{
    static const struct {
        const char *lines;
        int line; /* 0: it is well */
        const char *says;
    } scripts[] = {
        {"input 2+1e999\n", 2, "this number is too large at character 3"},
        {"expect q1 < 1e999\n", 2, "this number is too large at character 6"},
        {"input 1/0\n", 2, "1/0 is not a finite number at t = 0 s"},
        {"input 0/0\nstart\nwait 1\nhalt\n", 2, "at t = 0 s"},
        {"input sqrt(0-t)\nstart\nwait 0.3\nhalt\n", 4, "at t = 0.001 s"},
        {"input sqrt(2-t)\nstart\nwait 1\nwait 0.9\nhalt\nstart\nwait 1.9\nhalt\n", 0, ""},
        {"input sqrt(2-t)\nstart\nwait 1\nwait-until t > 9 within 20\nwait 1.5\nhalt\n", 6,
         "at t = 2.001 s"},
        {"start\nwait 1\ninput 1/t\nwait 1\nhalt\n", 0, ""},
        {"start\nwait 1\ninput 1/(t-1)\nwait 1\nhalt\n", 4, "at t = 1 s"},
        {"input sqrt(2-t)\nsetup pendubot-mid\nstart\nwait 5\nhalt\n", 0, ""},
        {"input sqrt(2-t)\nsetup pi-speed\nstart\nwait 5\nhalt\n", 5, "at t = 2.001 s"},
        {"input sqrt(2e6-t)\nstart\nwait 1000000\nhalt\n", 0, ""},
    };
    char text[400];
    for (size_t i = 0; i < sizeof scripts / sizeof scripts[0]; i++) {
        struct complaints c;
        snprintf(text, sizeof text, "setup pi-speed\n%s", scripts[i].lines);
        cmdfile_free(parse(text, &c));
        ck_assert_msg(c.count == (scripts[i].line > 0), "%s: %d %s", text, c.count, c.first);
        ck_assert_msg(c.count == 0 ||
                          (c.line[0] == scripts[i].line && strstr(c.first, scripts[i].says)),
                      "%s: %d %s", text, c.line[0], c.first);
    }
}
END_TEST

START_TEST(every_mistake_is_reported_with_its_line)
{
    struct complaints c;
    parse("setup nowhere\nfly\nwait\nwait -1\ngains one\nrepeat 0\nend\nexpect q9 > 1\nsave 'x\n"
          "input 1+\nwait 1 2\n",
          &c);
    int want[] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11};
    ck_assert_int_eq(c.count, 11);
    for (int i = 0; i < 11; i++)
        ck_assert_int_eq(c.line[i], want[i]);
    parse("repeat 2\nwait 1\n", &c);
    ck_assert_int_eq(c.count, 1);
    ck_assert_int_eq(c.line[0], 1);
    parse("source nothing.cmd\n", &c);
    ck_assert_int_eq(c.count, 1);
}
END_TEST

/* Each line that brings a file in again would multiply what is read at every depth. */
START_TEST(files_that_source_each_other_come_to_an_end)
{
    struct complaints c;
    parse("source s.cmd\nwait 1\nsource s.cmd\n", &c);
    ck_assert_int_eq(c.count, 2);
    ck_assert_msg(strstr(c.first, "sources itself") != NULL, "%s", c.first);
    ck_assert_int_eq(c.line[0], 1);
    ck_assert_int_eq(c.line[1], 3);
    scratch_text("other.cmd", "source s.cmd\n");
    parse("source other.cmd\n", &c);
    ck_assert_int_eq(c.count, 1);
    ck_assert_msg(strstr(c.first, "sources itself") != NULL, "%s", c.first);
    char name[32], text[64];
    for (int i = 0; i < 12; i++) {
        snprintf(name, sizeof name, "f%d.cmd", i);
        snprintf(text, sizeof text, "source f%d.cmd\nsource f%d.cmd\n", i + 1, i + 1);
        scratch_text(name, i < 11 ? text : "wait 1\n");
    }
    parse("source f0.cmd\n", &c);
    ck_assert_int_eq(c.count, 1);
    ck_assert_msg(strstr(c.first, "1000 files") != NULL, "%s", c.first);
    scratch_text("f5.cmd", "wait 1\n");
    struct cmdfile *file = parse("source f0.cmd\nsource f0.cmd\n", &c);
    ck_assert_msg(c.count == 0, "%s", c.first);
    ck_assert_uint_eq(cmdfile_command_count(file), 64);
    cmdfile_free(file);
    for (int i = 0; i < 18; i++) {
        snprintf(name, sizeof name, "f%d.cmd", i);
        snprintf(text, sizeof text, "source f%d.cmd\n", i + 1);
        scratch_text(name, text);
    }
    parse("source f0.cmd\n", &c);
    ck_assert_int_eq(c.count, 1);
    ck_assert_msg(strstr(c.first, "too deeply") != NULL, "%s", c.first);
}
END_TEST

/* They may never end, or never begin. */
START_TEST(what_is_sourced_is_a_file)
{
    static const struct {
        const char *name, *says;
    } rows[] = {{"pipe", "it is a pipe"},
                {"/dev/zero", "it is a device"},
                {"/tmp", "it is a folder"},
                {"-", "cannot read"}};
    struct complaints c;
    char text[64];
    unlink(scratch("pipe"));
    ck_assert_int_eq(mkfifo(scratch("pipe"), 0600), 0);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        snprintf(text, sizeof text, "wait 1\nsource %s\n", rows[i].name);
        parse(text, &c);
        ck_assert_int_eq(c.count, 1);
        ck_assert_int_eq(c.line[0], 2);
        ck_assert_msg(strstr(c.first, rows[i].says) != NULL, "%s", c.first);
    }
    static const struct cmd_known nothing;
    struct cmdfile *file;
    memset(&c, 0, sizeof c);
    ck_assert_int_eq(cmdfile_source(scratch("pipe"), &nothing, collect, &c, &file, NULL),
                     MK_ERR_PARSE);
    ck_assert_int_eq(cmdfile_source("-", &nothing, collect, &c, &file, NULL), MK_ERR_NOTFOUND);
    ck_assert_int_eq(c.count, 2);
    ck_assert_msg(strstr(c.first, "it is a pipe") != NULL, "%s", c.first);
    ck_assert_int_eq(unlink(scratch("pipe")), 0);
}
END_TEST

START_TEST(a_script_may_come_from_a_pipe_but_not_for_ever)
{
    char out[4096];
    int code =
        run_command(out, sizeof out, "echo 'setup pi-speed' | " MK_TEST_APP " run --check -");
    ck_assert_msg(code == 0, "%d: %s", code, out);
    code = run_command(out, sizeof out,
                       "mkfifo %s && (echo 'setup pi-speed' >%s & " MK_TEST_APP " run --check %s)",
                       scratch("script"), scratch("script"), scratch("script"));
    ck_assert_msg(code == 0, "%d: %s", code, out);
    code = run_command(out, sizeof out, "yes '' | " MK_TEST_APP " run --check -");
    ck_assert_msg(code == 3 && strstr(out, "standard input:1000001: more than 1000000 lines"),
                  "%d: %s", code, out);
}
END_TEST

START_TEST(a_model_is_looked_for_beside_the_file_that_names_it)
{
    struct mk_model model;
    struct complaints c;
    mk_model_default(MK_PLANT_FURUTA, &model);
    mkdir(scratch("sub"), 0700);
    ck_assert_int_eq(mk_model_write(scratch("sub/m.ini"), &model, NULL, NULL), MK_OK);
    scratch_text("sub/part.cmd", "model m.ini\nsetup furuta\n");
    struct cmdfile *file = parse("source sub/part.cmd\ngains 1 2 3 4\n", &c);
    ck_assert_msg(c.count == 0, "%s", c.first);
    cmdfile_free(file);
    parse("source sub/part.cmd\nmodel m.ini\ngains 1 2\n", &c);
    ck_assert_int_eq(c.count, 2);
    ck_assert_int_eq(c.line[0], 2);
    ck_assert_int_eq(c.line[1], 3);
}
END_TEST

/* --- looking at the links -------------------------------------------------------------------- */

static void finish_commands(struct host *h)
{
    const struct timespec pause = {.tv_nsec = 10000000};
    while (!host_is_idle(h))
        nanosleep(&pause, NULL);
}

START_TEST(a_slide_that_creeps_is_not_said_to_stand_still)
{
    static const char *const lines[] = {"model models/cart-pole.ini",
                                        "faults from 60 to 1000 jump 1 by 4",
                                        "log off",
                                        "setup open-loop",
                                        "start",
                                        "wait 0.05",
                                        "halt"};
    const struct session_options options = {.seed = 1};
    const struct timespec second = {.tv_sec = 1};
    struct host_status status;
    struct host *h;
    ck_assert_int_eq(host_create(&options, &h, NULL), MK_OK);
    for (size_t i = 0; i < sizeof lines / sizeof lines[0]; i++)
        ck_assert(host_post(h, lines[i]));
    finish_commands(h);
    /* A look every 20 ms, a tenth of a millimetre each. */
    nanosleep(&second, NULL);
    host_get_status(h, &status);
    host_destroy(h);
    ck_assert(status.looked);
    ck_assert_double_gt(status.q[0], 1e-3);
    ck_assert(!status.still);
}
END_TEST

Suite *suite_script(void)
{
    Suite *s = suite_create("script");
    TCase *t = tcase_create("command files");
    tcase_set_timeout(t, 40);
    tcase_add_test(t, conditions_mean_what_they_say);
    tcase_add_test(t, bad_conditions_are_refused_at_their_character);
    tcase_add_test(t, a_good_file_is_understood);
    tcase_add_test(t, a_mark_that_an_editor_puts_first_is_no_command);
    tcase_add_test(t, a_signal_that_is_no_number_during_the_run_is_refused_with_its_time);
    tcase_add_test(t, every_mistake_is_reported_with_its_line);
    tcase_add_test(t, files_that_source_each_other_come_to_an_end);
    tcase_add_test(t, what_is_sourced_is_a_file);
    tcase_add_test(t, a_script_may_come_from_a_pipe_but_not_for_ever);
    tcase_add_test(t, a_model_is_looked_for_beside_the_file_that_names_it);
    tcase_add_test(t, a_slide_that_creeps_is_not_said_to_stand_still);
    suite_add_tcase(s, t);
    return s;
}
