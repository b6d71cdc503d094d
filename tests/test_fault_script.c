#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "driver/fault_script.h"
#include "support/files.h"

static struct mk_fault_script script;
static struct mk_error err;

static void setup(void)
{
    err = (struct mk_error)MK_ERROR_INIT;
}

static struct mk_fault_effects at(uint64_t sample)
{
    struct mk_fault_effects fx;
    mk_fault_script_at(&script, sample, &fx);
    return fx;
}

static void read_ok(const char *text)
{
    enum mk_status st = mk_fault_script_read(text, 2, &script, &err);
    ck_assert_msg(st == MK_OK, "%s: %s", text, err.message);
}

START_TEST(no_script_asks_for_nothing)
{
    read_ok(NULL);
    ck_assert_int_eq(script.count, 0);
    read_ok("");
    struct mk_fault_effects fx = at(0);
    ck_assert(!fx.drop && !fx.mute && !fx.alarm && !fx.disconnect);
    ck_assert(isinf(fx.u_limit));
    ck_assert_double_eq(fx.delay_s, 0.0);
}
END_TEST

START_TEST(a_rule_holds_for_its_samples_and_no_other)
{
    static const struct {
        const char *text;
        uint64_t first, end;
    } rows[] = {
        {"at 5 drop", 5, 6},        {"at 5 drop 3", 5, 8}, {"at 5 drop for 3", 5, 8},
        {"from 5 to 9 drop", 5, 9}, {"at 0 drop", 0, 1},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        read_ok(rows[i].text);
        for (uint64_t n = 0; n < 20; n++)
            ck_assert_int_eq(at(n).drop, n >= rows[i].first && n < rows[i].end);
    }
}
END_TEST

START_TEST(a_count_may_be_as_large_as_it_is_said_to_be)
{
    read_ok("at 1000000000000 drop 1000000000000");
    ck_assert(at(1000000000000).drop && at(1999999999999).drop && !at(2000000000000).drop);
}
END_TEST

START_TEST(lasting_faults_last)
{
    read_ok("at 7 stuck 2; at 7 disconnect; at 7 noise 2; at 7 alarm; at 7 saturate 3");
    ck_assert(!at(6).stuck[1] && !at(6).disconnect && !at(6).alarm);
    struct mk_fault_effects fx = at(UINT64_MAX - 1);
    ck_assert(fx.stuck[1] && !fx.stuck[0] && fx.disconnect && fx.alarm);
    ck_assert_double_eq(fx.noise_counts, 2.0);
    ck_assert_double_eq(fx.u_limit, 3.0);
    read_ok("at 7 stuck 2 for 2;");
    ck_assert(at(8).stuck[1] && !at(9).stuck[1]);
}
END_TEST

START_TEST(times_have_units)
{
    static const struct {
        const char *text;
        double s;
    } rows[] = {{"at 1 delay 5ms", 5e-3},
                {"at 1 delay 200us", 2e-4},
                {"at 1 delay 0.25s", 0.25},
                {"at 1 delay 1500ns", 1.5e-6}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        read_ok(rows[i].text);
        ck_assert_double_eq_tol(at(1).delay_s, rows[i].s, 1e-15);
    }
}
END_TEST

START_TEST(rules_of_one_sample_add_up)
{
    read_ok("at 3 jump 1 by 200; at 3 jump 1 by -50; at 3 delay 1ms; at 3 delay 2ms;"
            "at 3 saturate 5; at 3 saturate 4; at 3 noise 3; at 3 noise 4");
    struct mk_fault_effects fx = at(3);
    ck_assert_int_eq(fx.slip[0], 150);
    ck_assert_double_eq_tol(fx.delay_s, 3e-3, 1e-15);
    ck_assert_double_eq(fx.u_limit, 4.0);
    ck_assert_double_eq_tol(fx.noise_counts, 5.0, 1e-12);
    ck_assert_int_eq(at(4).slip[0], 0);
}
END_TEST

START_TEST(comments_blank_lines_and_semicolons_are_allowed)
{
    read_ok("# all of it\n\n  at 1 drop ; # the rest of this line; at 2 drop\n;;\n"
            "\tat 4\tmute 2\r\n");
    ck_assert_int_eq(script.count, 2);
    ck_assert(at(1).drop && !at(2).drop && at(5).mute);
}
END_TEST

START_TEST(a_file_is_read_like_a_text)
{
    char path[] = "/tmp/mechkit-test-faults-XXXXXX";
    int fd = mkstemp(path);
    const char text[] = "\xef\xbb\xbf# one\nat 10 drop 2\nat 20 stuck 3\n";
    ck_assert_int_eq(write(fd, text, sizeof text - 1), (ssize_t)sizeof text - 1);
    close(fd);
    ck_assert_int_eq(mk_fault_script_read(path, 2, &script, &err), MK_ERR_RANGE);
    ck_assert_str_eq(err.file, path);
    ck_assert_int_eq(err.line, 3);
    ck_assert_int_eq(err.column, 13);
    unlink(path);
    ck_assert_int_eq(mk_fault_script_read(path, 2, &script, &err), MK_ERR_NOTFOUND);
}
END_TEST

/* A pipe that nobody writes to would be waited for. */
START_TEST(what_is_no_file_is_not_waited_for)
{
    static const char *const other[] = {NULL, "/dev/zero", "/tmp"};
    static const char *const says[] = {"it is a pipe, not a file", "it is a device",
                                       "it is a folder"};
    const char *pipe = scratch("faults");
    ck_assert_int_eq(mkfifo(pipe, 0600), 0);
    for (size_t i = 0; i < sizeof other / sizeof other[0]; i++) {
        const char *path = other[i] ? other[i] : pipe;
        ck_assert_int_eq(mk_fault_script_read(path, 2, &script, &err), MK_ERR_PARSE);
        ck_assert_str_eq(err.file, path);
        ck_assert_msg(strstr(err.message, says[i]) != NULL, "%s", err.message);
    }
}
END_TEST

START_TEST(mistakes_are_named_with_line_and_column)
{
    static const struct {
        const char *text;
        enum mk_status st;
        int line, column;
        const char *says;
    } rows[] = {
        {"at 5 explode", MK_ERR_PARSE, 1, 6, "expected drop"},
        {"at 5 drop\nat five drop", MK_ERR_PARSE, 2, 4, "number of a sample"},
        {"at 5 drop; when 6 drop", MK_ERR_PARSE, 1, 12, "expected 'at'"},
        {"at -5 drop", MK_ERR_PARSE, 1, 4, "number of a sample"},
        {"at 5", MK_ERR_PARSE, 1, 4, "end of rule"},
        {"at 5 stuck", MK_ERR_PARSE, 1, 6, "number of a joint"},
        {"at 5 stuck 3", MK_ERR_RANGE, 1, 12, "joints 1 and 2"},
        {"at 5 stuck 0", MK_ERR_RANGE, 1, 12, "joints 1 and 2"},
        {"at 5 jump 1 200", MK_ERR_PARSE, 1, 13, "'by'"},
        {"at 5 jump 1 by far", MK_ERR_PARSE, 1, 16, "counts"},
        {"at 5 delay 5", MK_ERR_PARSE, 1, 12, "5ms"},
        {"at 5 delay ms", MK_ERR_PARSE, 1, 12, "5ms"},
        {"at 5 delay 11s", MK_ERR_RANGE, 1, 12, "10s"},
        {"at 5 noise -1", MK_ERR_RANGE, 1, 12, "from 0 on"},
        {"at 5 drop 3 times", MK_ERR_PARSE, 1, 13, "usage: drop"},
        {"at 5 stuck 1 for 0", MK_ERR_RANGE, 1, 18, "starts at 1"},
        {"at 5 drop 0", MK_ERR_RANGE, 1, 11, "starts at 1"},
        {"at 5 drop 0 times", MK_ERR_RANGE, 1, 11, "not '0'"},
        {"at 1 mute;\nat 5 mute 0", MK_ERR_RANGE, 2, 11, "starts at 1"},
        {"at 5 drop 1000000000001", MK_ERR_RANGE, 1, 11, "ends at 1000000000000"},
        {"at 5 drop 18446744073709551615", MK_ERR_RANGE, 1, 11, "ends at 1000000000000"},
        {"at 5 alarm for 18446744073709551612", MK_ERR_RANGE, 1, 16, "ends at 1000000000000"},
        {"at 18446744073709551615 drop", MK_ERR_RANGE, 1, 4, "from 0 to 1000000000000"},
        {"from 1 to 18446744073709551615 drop", MK_ERR_RANGE, 1, 11, "from 0 to 1000000000000"},
        {"from 1 to 5 drop 2", MK_ERR_PARSE, 1, 18, "expected no more"},
        {"from 9 to 9 drop", MK_ERR_RANGE, 1, 11, "after the first"},
        {"from 9 until 12 drop", MK_ERR_PARSE, 1, 8, "'to'"},
        {"from 1 to 5 stuck 1 for 2", MK_ERR_PARSE, 1, 21, "expected no more"},
        {"at 99999999999999999999999 drop", MK_ERR_PARSE, 1, 4, "number of a sample"},
        {"at 1 a b c d e f g h i j k l", MK_ERR_PARSE, 1, 26, "12 words"},
        {"at 1 a b c d e f g h i j", MK_ERR_PARSE, 1, 6, "expected drop"},
        {"at 5 jump 1 by 8388608", MK_ERR_RANGE, 1, 16, "counts"},
        {"at 5 jump 1 by -8388609", MK_ERR_RANGE, 1, 16, "counts"},
        {"at 5 saturate 1000001", MK_ERR_RANGE, 1, 15, "from 0 on"},
        {"at 5 delay 10.1s", MK_ERR_RANGE, 1, 12, "10s"},
        {"at 5 delay 5 ms", MK_ERR_PARSE, 1, 12, "5ms"},
        {"at 5 delay", MK_ERR_PARSE, 1, 6, "5ms, 200us or 0.1s, not 'end of rule'"},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        enum mk_status st = mk_fault_script_read(rows[i].text, 2, &script, &err);
        ck_assert_msg(st == rows[i].st, "%s: %s", rows[i].text, mk_status_name(st));
        ck_assert_msg(err.line == rows[i].line && err.column == rows[i].column, "%s: %d:%d",
                      rows[i].text, err.line, err.column);
        ck_assert_msg(strstr(err.message, rows[i].says) != NULL, "%s: %s", rows[i].text,
                      err.message);
    }
}
END_TEST

START_TEST(numbers_may_be_as_large_as_they_may_be)
{
    read_ok("at 5 jump 1 by 8388607; at 5 jump 2 by -8388608; at 5 saturate 1000000");
    struct mk_fault_effects fx = at(5);
    ck_assert_int_eq(fx.slip[0], 8388607);
    ck_assert_int_eq(fx.slip[1], -8388608);
    ck_assert_double_eq(fx.u_limit, 1e6);
    read_ok("at 5 delay 10s; at 5 saturate 0; at 6 drop 1");
    ck_assert_double_eq(at(5).delay_s, 10.0);
    ck_assert_double_eq(at(5).u_limit, 0.0);
    ck_assert(at(6).drop && !at(7).drop);
}
END_TEST

/* In a file and as it stands. */
START_TEST(a_script_is_as_long_as_it_is_said_that_it_may_be)
{
    static char text[65536 + 2];
    memset(text, '\n', sizeof text - 1);
    memcpy(text, "at 1 drop", 9);
    for (size_t length = 65536; length <= 65537; length++) {
        const enum mk_status st = length == 65536 ? MK_OK : MK_ERR_RANGE;
        text[length] = '\0';
        const char *path = scratch_text("long", text);
        ck_assert_int_eq(mk_fault_script_read(text, 2, &script, &err), st);
        ck_assert_int_eq(mk_fault_script_read(path, 2, &script, &err), st);
        text[length] = '\n';
    }
    ck_assert_ptr_nonnull(strstr(err.message, "larger than 65536 bytes"));
}
END_TEST

START_TEST(a_file_with_a_zero_in_it_is_no_script)
{
    char path[] = "/tmp/mechkit-test-faults-XXXXXX";
    int fd = mkstemp(path);
    ck_assert_int_eq(write(fd, "at 1 drop\n\0", 11), 11);
    close(fd);
    ck_assert_int_eq(mk_fault_script_read(path, 2, &script, &err), MK_ERR_PARSE);
    ck_assert_ptr_nonnull(strstr(err.message, "not a text file"));
    unlink(path);
}
END_TEST

START_TEST(a_rig_of_one_joint_has_no_second)
{
    ck_assert_int_eq(mk_fault_script_read("at 5 stuck 2", 1, &script, &err), MK_ERR_RANGE);
    ck_assert_ptr_nonnull(strstr(err.message, "joint 1 only"));
}
END_TEST

START_TEST(too_many_rules_are_refused)
{
    char text[16 * (MK_FAULT_RULES_MAX + 1)] = "";
    for (int i = 0; i < MK_FAULT_RULES_MAX; i++)
        strcat(text, "at 1 drop;");
    read_ok(text);
    strcat(text, "at 1 drop");
    ck_assert_int_eq(mk_fault_script_read(text, 2, &script, &err), MK_ERR_RANGE);
}
END_TEST

Suite *suite_fault_script(void)
{
    Suite *s = suite_create("fault_script");
    TCase *t = tcase_create("rules");
    tcase_add_checked_fixture(t, setup, NULL);
    tcase_add_test(t, no_script_asks_for_nothing);
    tcase_add_test(t, a_rule_holds_for_its_samples_and_no_other);
    tcase_add_test(t, a_count_may_be_as_large_as_it_is_said_to_be);
    tcase_add_test(t, lasting_faults_last);
    tcase_add_test(t, times_have_units);
    tcase_add_test(t, rules_of_one_sample_add_up);
    tcase_add_test(t, comments_blank_lines_and_semicolons_are_allowed);
    tcase_add_test(t, a_file_is_read_like_a_text);
    tcase_add_test(t, what_is_no_file_is_not_waited_for);
    tcase_add_test(t, mistakes_are_named_with_line_and_column);
    tcase_add_test(t, numbers_may_be_as_large_as_they_may_be);
    tcase_add_test(t, a_script_is_as_long_as_it_is_said_that_it_may_be);
    tcase_add_test(t, a_file_with_a_zero_in_it_is_no_script);
    tcase_add_test(t, a_rig_of_one_joint_has_no_second);
    tcase_add_test(t, too_many_rules_are_refused);
    suite_add_tcase(s, t);
    return s;
}
