/* A server in another language (tools/rig_server.py, written from docs/protocol.md, with equations
 * of its own) in front of the program: whatever it does well or badly, the investigation finds the
 * rig behind it, or says what is wrong, and goes on when that is put right. Needs Python. */
#include "suites.h"

#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "mechkit/model.h"
#include "support/files.h"
#include "support/journals.h"
#include "support/program.h"

#define SHORT "--seconds 5 --tries 100"
#define PENDULUM "--plant pendulum"

static char said[16384], device[64], folder[512], output[256];
static struct journal journal;
static pid_t server;

static bool skipped(void)
{
    return !have_program("python3", "foreign");
}

static const char *server_said(void)
{
    static char text[8192];
    char *read = slurp_file(output);
    snprintf(text, sizeof text, "%s", read ? read : "");
    free(read);
    return text;
}

/* Waits until the server has said it. */
static const char *server_says(const char *text)
{
    const char *at = NULL;
    for (int k = 0; k < 2000 && !(at = strstr(server_said(), text)); k++)
        usleep(5000);
    ck_assert_msg(at != NULL, "no '%s' in: %s", text, server_said());
    return at;
}

static void serve(const char *options)
{
    char command[1024];
    snprintf(command, sizeof command, "exec python3 %s/tools/rig_server.py %s", MK_SOURCE_DIR,
             options);
    snprintf(output, sizeof output, "%s", scratch("server.txt"));
    unlink(output);
    server = fork();
    ck_assert_int_ge(server, 0);
    if (server == 0) {
        int fd = open(output, O_WRONLY | O_CREAT | O_TRUNC, 0600);
        dup2(fd, STDOUT_FILENO);
        dup2(fd, STDERR_FILENO);
        execl("/bin/sh", "sh", "-c", command, (char *)NULL);
        _exit(127);
    }
    snprintf(device, sizeof device, "%s", server_says("listening on ") + 13);
    device[strcspn(device, "\n")] = '\0';
}

static void end_server(void)
{
    if (server > 0) {
        kill(server, SIGKILL);
        waitpid(server, NULL, 0);
    }
    server = 0;
}

static void new_folder(const char *name)
{
    snprintf(folder, sizeof folder, "%s", scratch(name));
    run_command(NULL, 0, "rm -rf %s", folder);
}

static int investigate_rig(const char *model, const char *options)
{
    return run_mechkit(said, sizeof said,
                       "investigate --model %s/models/%s.ini --board tcp --device %s --out %s "
                       "%s " SHORT,
                       MK_SOURCE_DIR, model, device, folder, options);
}

static void ck_assert_says(const char *text)
{
    ck_assert_msg(strstr(said, text) != NULL, "no '%s' in:\n%s", text, said);
}

/* The parameters that tools/rig_server.py has. */
static void ck_assert_knows(const double *p, int n)
{
    char path[700];
    struct mk_model model;
    snprintf(path, sizeof path, "%s/model.ini", folder);
    ck_assert_int_eq(mk_model_read(path, &model, NULL), MK_OK);
    for (int i = 0; i < n; i++)
        ck_assert_double_eq_tol(model.parameter[i], p[i], 0.01 * p[i]);
}

/* --- what is found ---------------------------------------------------------------------------- */

static const double pendulum[] = {0.0660, 7.3, 0.0105, 0.34};

START_TEST(a_rig_behind_a_server_in_another_language_is_known_to_a_percent)
{
    static const char *const lines[] = {PENDULUM, PENDULUM " --cut 1",
                                        PENDULUM " --cpr 2048,2048 --bits 16"};
    if (skipped())
        return;
    serve(lines[_i]);
    new_folder("known");
    int code = investigate_rig("pendulum", "--fast");
    ck_assert_msg(code == 0, "%d: %s", code, said);
    if (_i == 2)
        ck_assert_says("The board counts 2048 a turn at joint 1, the model has 4000: the board is "
                       "believed.");
    read_journal_of(folder, &journal);
    ck_assert_str_eq(journal.stopped, "validated");
    ck_assert_int_eq(last_finding_of(&journal)->causes, 0);
    ck_assert_knows(pendulum, 4);
    server_says("gone: command 0,");
}
END_TEST

START_TEST(a_cause_behind_it_is_named)
{
    if (skipped())
        return;
    serve("--plant furuta --set coulomb=0.03");
    new_folder("named");
    int code = investigate_rig("furuta", "--fast");
    ck_assert_msg(code == 0, "%d: %s", code, said);
    read_journal_of(folder, &journal);
    ck_assert_int_eq(last_finding_of(&journal)->causes, 1);
    ck_assert_int_eq(
        strncmp(last_finding_of(&journal)->cause[0], "coulomb at joint 2: level 0.03", 30), 0);
}
END_TEST

START_TEST(a_run_in_real_time_needs_no_clock_that_can_be_stepped)
{
    if (skipped())
        return;
    serve(PENDULUM " --no-step --no-stream");
    new_folder("real");
    ck_assert_int_eq(investigate_rig("pendulum", "--fast"), 1);
    ck_assert_says("does not say that it is simulated, so it runs in real time only");
    /* What the doctor thinks of this machine is another matter. */
    run_mechkit(said, sizeof said, "doctor --board tcp --device %s --model %s/models/pendulum.ini",
                device, MK_SOURCE_DIR);
    ck_assert_says("rig_server, firmware 1");
    ck_assert_says("bites after 20 ms");
}
END_TEST

/* --- what is wrong with it -------------------------------------------------------------------- */

/* Before anything was driven but the two short pushes. */
START_TEST(wrong_wires_are_told_with_what_to_do)
{
    static const char *const wires[][2] = {
        {"--signs=1,-1", "encoder 2 counts backwards: exchange its A and B wires"},
        {"--signs=-1,1", "encoder 1 counts backwards: exchange its A and B wires"},
        {"--signs=-1,-1", "the motor turns backwards: exchange its two wires"},
        {"--swap", "the encoders are swapped: exchange their plugs at the board"},
        {"--swap --signs=-1,-1", "the encoders are swapped: exchange their plugs at the board"},
    };
    char options[100];
    if (skipped())
        return;
    snprintf(options, sizeof options, "--plant furuta %s", wires[_i][0]);
    serve(options);
    new_folder("wires");
    ck_assert_int_eq(investigate_rig("furuta", "--fast"), 1);
    ck_assert_says(wires[_i][1]);
    server_says("gone: command 0,");
    read_journal_of(folder, &journal);
    ck_assert_int_eq(journal.count, 0);
}
END_TEST

START_TEST(a_board_that_answers_too_slowly_is_not_taken_for_a_rig_at_rest)
{
    if (skipped())
        return;
    serve(PENDULUM " --slow 10");
    new_folder("slow");
    ck_assert_int_eq(investigate_rig("pendulum", ""), 1);
    ck_assert_says("exchanges in time: it, or the line, is too slow");
}
END_TEST

START_TEST(a_server_that_hangs_up_and_comes_back_elsewhere_is_gone_on_with)
{
    if (skipped())
        return;
    serve(PENDULUM " --leave-after 5000"); /* within the first run */
    new_folder("back");
    ck_assert_int_eq(investigate_rig("pendulum", "--fast"), 1);
    ck_assert_says("unplugged");
    server_says("gone: command 0,");
    end_server();
    serve(PENDULUM);
    int code =
        run_mechkit(said, sizeof said, "investigate --resume %s --device %s", folder, device);
    ck_assert_msg(code == 0, "%d: %s", code, said);
    ck_assert_says("The rig is now at ");
    read_journal_of(folder, &journal);
    ck_assert_str_eq(journal.stopped, "validated");
    ck_assert_str_eq(journal.settings.device, device);
}
END_TEST

START_TEST(a_motor_that_gives_nothing_ends_it_and_what_was_learned_stays)
{
    if (skipped())
        return;
    serve(PENDULUM " --dead-motor 2");
    new_folder("dead");
    ck_assert_int_eq(investigate_rig("pendulum", "--fast"), 1);
    ck_assert_says("experiment 2: nothing moved");
    read_journal_of(folder, &journal);
    ck_assert(journal.experiment[1].broken_off);
    end_server();
    serve(PENDULUM);
    ck_assert_int_eq(investigate_rig("pendulum", "--fast"), 0);
    read_journal_of(folder, &journal);
    ck_assert_str_eq(journal.stopped, "validated");
    ck_assert_knows(pendulum, 4);
}
END_TEST

/* Gone in the middle of a run, the first or a test: its fault does not yet say that it was the
 * motor. */
START_TEST(a_motor_that_dies_in_a_run_is_no_cause)
{
    if (skipped())
        return;
    serve(_i == 0 ? PENDULUM " --dead-motor 1:2" : PENDULUM " --dead-motor 2:1");
    new_folder("fuse");
    ck_assert_int_eq(investigate_rig("pendulum", "--fast"), 1);
    ck_assert_says("nothing moved");
    read_journal_of(folder, &journal);
    ck_assert_str_ne(journal.experiment[_i].fault, "");
    ck_assert(!journal.experiment[_i].used);
    ck_assert_str_eq(journal.experiment[_i].finding.verdict, "");
    end_server();
    serve(PENDULUM);
    ck_assert_int_eq(investigate_rig("pendulum", "--fast"), 0);
    read_journal_of(folder, &journal);
    ck_assert_str_eq(journal.stopped, "validated");
    ck_assert_int_eq(last_finding_of(&journal)->causes, 0);
    ck_assert_knows(pendulum, 4);
}
END_TEST

/* A wire of an encoder: before the first run and in it, right again or off by what was missed, for
 * a moment or for good. */
START_TEST(an_encoder_with_a_loose_wire_is_no_cause)
{
    static const char *const loose[] = {"0:1:1.4:1", "1:1.5:1.7:1", "1:2:2.3:1:lost", "1:3:9:1",
                                        "2:1:1.05:1:lost"};
    char options[100];
    if (skipped())
        return;
    snprintf(options, sizeof options, PENDULUM " --loose %s", loose[_i]);
    serve(options);
    new_folder("loose");
    int code = investigate_rig("pendulum", "--fast");
    ck_assert_msg(code == 0, "%d: %s", code, said);
    read_journal_of(folder, &journal);
    ck_assert_str_eq(journal.stopped, "validated");
    ck_assert_int_eq(last_finding_of(&journal)->causes, 0);
    ck_assert_knows(pendulum, 4);
}
END_TEST

/* Each in the first run, with the motor driving: it ends with the motor off, and the same command
 * goes on. */
START_TEST(a_board_that_is_not_itself_ends_it_and_the_same_command_goes_on)
{
    static const char *const trouble[][2] = {
        {"--stall 1:1.5:3", "silent: command 0, was "}, {"--reboot 1:1.5", "reboot: was "},
        {"--stop-clock 1:1.5:9", "gone: command 0,"},   {"--leave 0:0.5", "gone: command 0,"},
        {"--leave 0:1.55", "gone: command 0,"}, /* in a push */
    };
    char options[100];
    if (skipped())
        return;
    snprintf(options, sizeof options, PENDULUM " %s", trouble[_i][0]);
    serve(options);
    new_folder("trouble");
    ck_assert_int_eq(investigate_rig("pendulum", "--fast"), 1);
    ck_assert_msg(strstr(said, "he same command goes on"), "%s", said);
    server_says(trouble[_i][1]);
    server_says("gone: command 0,");
    int code = investigate_rig("pendulum", "--fast");
    ck_assert_msg(code == 0, "%d: %s", code, said);
    read_journal_of(folder, &journal);
    ck_assert_str_eq(journal.stopped, "validated");
    ck_assert_int_eq(last_finding_of(&journal)->causes, 0);
}
END_TEST

START_TEST(a_run_in_which_somebody_held_the_rig_is_left_out)
{
    if (skipped())
        return;
    serve(PENDULUM " --hold 1:2:3.5");
    new_folder("held");
    int code = investigate_rig("pendulum", "--fast");
    ck_assert_msg(code == 0, "%d: %s", code, said);
    read_journal_of(folder, &journal);
    ck_assert(journal.experiment[0].left_out && !journal.experiment[0].used);
    ck_assert_int_eq(last_finding_of(&journal)->causes, 0);
    ck_assert_knows(pendulum, 4);
}
END_TEST

Suite *suite_foreign(void)
{
    Suite *s = suite_create("foreign");
    TCase *found = tcase_create("found");
    tcase_set_timeout(found, 240);
    tcase_set_tags(found, "long");
    tcase_add_checked_fixture(found, NULL, end_server);
    tcase_add_loop_test(found, a_rig_behind_a_server_in_another_language_is_known_to_a_percent, 0,
                        3);
    tcase_add_test(found, a_cause_behind_it_is_named);
    tcase_add_test(found, a_run_in_real_time_needs_no_clock_that_can_be_stepped);
    suite_add_tcase(s, found);
    TCase *wrong = tcase_create("wrong");
    tcase_set_timeout(wrong, 240);
    tcase_add_checked_fixture(wrong, NULL, end_server);
    tcase_add_loop_test(wrong, wrong_wires_are_told_with_what_to_do, 0, 5);
    tcase_add_test(wrong, a_board_that_answers_too_slowly_is_not_taken_for_a_rig_at_rest);
    tcase_add_test(wrong, a_server_that_hangs_up_and_comes_back_elsewhere_is_gone_on_with);
    tcase_add_test(wrong, a_motor_that_gives_nothing_ends_it_and_what_was_learned_stays);
    tcase_add_loop_test(wrong, a_motor_that_dies_in_a_run_is_no_cause, 0, 1);
    tcase_add_loop_test(wrong, an_encoder_with_a_loose_wire_is_no_cause, 0, 1);
    tcase_add_loop_test(wrong, a_board_that_is_not_itself_ends_it_and_the_same_command_goes_on, 0,
                        1);
    suite_add_tcase(s, wrong);
    TCase *more = tcase_create("more that is wrong");
    tcase_set_timeout(more, 240);
    tcase_set_tags(more, "long patient");
    tcase_add_checked_fixture(more, NULL, end_server);
    tcase_add_loop_test(more, a_motor_that_dies_in_a_run_is_no_cause, 1, 2);
    tcase_add_loop_test(more, an_encoder_with_a_loose_wire_is_no_cause, 1, 5);
    tcase_add_loop_test(more, a_board_that_is_not_itself_ends_it_and_the_same_command_goes_on, 1,
                        5);
    suite_add_tcase(s, more);
    TCase *held = tcase_create("held"); /* a search for what is not there takes its time */
    tcase_set_timeout(held, 900);
    tcase_set_tags(held, "long patient");
    tcase_add_checked_fixture(held, NULL, end_server);
    tcase_add_test(held, a_run_in_which_somebody_held_the_rig_is_left_out);
    suite_add_tcase(s, held);
    return s;
}
