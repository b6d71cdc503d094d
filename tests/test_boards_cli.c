/* mechkit boards, doctor and standalone as a user meets them. */
#include "suites.h"

#include <stdio.h>
#include <string.h>
#include <sys/wait.h>

#include "mechkit/log.h"
#include "support/files.h"

static char said[8192];

/* Runs `mechkit ARGS`; returns the exit code. */
static int mechkit(const char *args)
{
    char command[1024];
    snprintf(command, sizeof command, "%s %s 2>&1", MK_TEST_APP, args);
    FILE *f = popen(command, "r");
    ck_assert_ptr_nonnull(f);
    said[fread(said, 1, sizeof said - 1, f)] = '\0';
    int status = pclose(f);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

static void ck_assert_says(const char *text)
{
    ck_assert_msg(strstr(said, text) != NULL, "no '%s' in:\n%s", text, said);
}

START_TEST(boards_lists_every_kind)
{
    ck_assert_int_eq(mechkit("boards"), 0);
    ck_assert_says("virtual");
    ck_assert_says("usb");
    ck_assert_says("parport");
    ck_assert_says("tcp      HOST:PORT");
    ck_assert_says("serial");
    ck_assert_int_eq(mechkit("boards nonsense"), 2);
}
END_TEST

START_TEST(doctor_finds_the_virtual_rig_well)
{
    mechkit("doctor --fast --drive"); /* the machine's own permissions decide on the exit code */
    ck_assert_says("ok       watchdog");
    ck_assert_says("ok       links");
    ck_assert_says("ok       motor and encoders");
    ck_assert_says("ok       cable drag");
}
END_TEST

START_TEST(doctor_without_a_board_says_where_to_look)
{
    ck_assert_int_eq(mechkit("doctor --fast --board usb --device nowhere"), 1);
    ck_assert_int_eq(mechkit("doctor --fast --board tcp"), 1);
    ck_assert_says("--device HOST:PORT");
    ck_assert_int_eq(mechkit("doctor --fast --board serial --device /dev/null"), 1);
    ck_assert_says("not a serial port");
    ck_assert_int_eq(mechkit("doctor --board warp"), 2);
    ck_assert_int_eq(mechkit("doctor --model nowhere.ini"), 3);
    ck_assert_int_eq(mechkit("doctor --unknown"), 2);
}
END_TEST

START_TEST(standalone_writes_what_the_board_recorded)
{
    char line[300];
    struct mk_log *log;
    const char *path = scratch("wheel.csv");
    snprintf(line, sizeof line,
             "standalone pi-speed --gains '0.2 1 30' --seconds 4 --fast --out %s", path);
    ck_assert_msg(mechkit(line) == 0, "%s", said);
    ck_assert_int_eq(mk_log_read(path, &log, NULL), MK_OK);
    ck_assert_str_eq(mk_log_find_meta(log, "setup"), "pi-speed, stand-alone");
    const double *q = mk_log_get(log, "q1"), *t = mk_log_get(log, "t");
    size_t n = log->rows;
    ck_assert_uint_gt(n, 1900);
    ck_assert_double_eq_tol((q[n - 1] - q[n - 101]) / (t[n - 1] - t[n - 101]), 30.0, 0.3);
    mk_log_free(log);
}
END_TEST

START_TEST(a_wheel_s_angle_goes_on_when_its_counter_wraps)
{
    char line[300];
    struct mk_log *log;
    const char *path = scratch("wrap.csv");
    /* 2^23 counts of 4000 a turn are reached after 132 s. */
    snprintf(line, sizeof line,
             "standalone pi-speed --gains '0.2 1 100' --seconds 140 --fast --out %s", path);
    ck_assert_msg(mechkit(line) == 0, "%s", said);
    ck_assert_int_eq(mk_log_read(path, &log, NULL), MK_OK);
    const double *q = mk_log_get(log, "q1"), *count = mk_log_get(log, "enc1");
    for (size_t k = 1; k < log->rows; k++) {
        ck_assert_double_ge(q[k], q[k - 1]);
        ck_assert_double_ge(count[k], count[k - 1]);
    }
    ck_assert_double_gt(count[log->rows - 1], 8388608.0);
    mk_log_free(log);
}
END_TEST

START_TEST(the_times_of_a_standalone_run_are_those_of_the_board)
{
    char line[300];
    struct mk_log *log;
    const char *path = scratch("rate.csv");
    snprintf(line, sizeof line, "standalone pi-speed --rate 300 --seconds 4 --fast --out %s", path);
    ck_assert_msg(mechkit(line) == 0, "%s", said);
    ck_assert_int_eq(mk_log_read(path, &log, NULL), MK_OK);
    /* The board was told whole microseconds. */
    ck_assert_double_eq_tol(mk_log_get(log, "t")[1000], 1000 * 0.003333, 1e-9);
    mk_log_free(log);
}
END_TEST

START_TEST(standalone_says_what_it_cannot_do)
{
    ck_assert_int_eq(mechkit("standalone"), 2);
    ck_assert_int_eq(mechkit("standalone somersault"), 2);
    ck_assert_int_eq(mechkit("standalone pi-speed --seconds 0"), 2);
    ck_assert_int_eq(mechkit("standalone pi-speed --fast --gains ' '"), 2);
    ck_assert_says("expected 1 to 24 finite numbers");
    ck_assert_int_eq(mechkit("standalone pi-speed --fast --gains '1 2 3 4'"), 1);
    ck_assert_says("--gains: 4 numbers, and the setup has 3 gains");
    ck_assert_int_eq(mechkit("standalone pi-speed --board null"), 1);
    ck_assert_says("no controllers of its own");
}
END_TEST

Suite *suite_boards_cli(void)
{
    Suite *s = suite_create("boards_cli");
    TCase *t = tcase_create("boards_cli");
    tcase_set_timeout(t, 60);
    tcase_add_test(t, boards_lists_every_kind);
    tcase_add_test(t, doctor_finds_the_virtual_rig_well);
    tcase_add_test(t, doctor_without_a_board_says_where_to_look);
    tcase_add_test(t, standalone_writes_what_the_board_recorded);
    tcase_add_test(t, a_wheel_s_angle_goes_on_when_its_counter_wraps);
    tcase_add_test(t, the_times_of_a_standalone_run_are_those_of_the_board);
    tcase_add_test(t, standalone_says_what_it_cannot_do);
    suite_add_tcase(s, t);
    return s;
}
