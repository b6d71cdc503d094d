/* Logs: what is read is what was written; what is wrong is named with its place. */
#include "suites.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>
#include <zlib.h>

#include "mechkit/log.h"
#include "support/files.h"

static struct mk_log *read_text(const char *text)
{
    struct mk_log *log;
    struct mk_error err = MK_ERROR_INIT;
    enum mk_status st = mk_log_read(scratch_text("in.csv", text), &log, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    return log;
}

static void expect_error(const char *text, enum mk_status status, int line, int column,
                         const char *says)
{
    struct mk_log *log;
    struct mk_error err = MK_ERROR_INIT;
    enum mk_status st = mk_log_read(scratch_text("bad.csv", text), &log, &err);
    ck_assert_msg(st == status, "'%s' gave %s: %s", text, mk_status_name(st), err.message);
    ck_assert_ptr_null(log);
    ck_assert_msg(err.line == line && err.column == column, "'%s' at %d:%d: %s", text, err.line,
                  err.column, err.message);
    ck_assert_msg(strstr(err.message, says) != NULL, "%s", err.message);
}

START_TEST(a_log_is_read_with_metadata_and_gaps)
{
    struct mk_log *log = read_text("# mechkit-log: 1\n# rig: pendubot\n# encoder_cpr: 4000 4000\n"
                                   "t,q1,q2,u\n0,-1.57,0,1\n0.002,,nan,\n0.004,-1.5,0.1,2\n");
    ck_assert_uint_eq(log->rows, 3);
    ck_assert_uint_eq(log->column_count, 4);
    ck_assert_str_eq(mk_log_find_meta(log, "rig"), "pendubot");
    ck_assert_str_eq(mk_log_find_meta(log, "encoder_cpr"), "4000 4000");
    ck_assert_ptr_null(mk_log_find_meta(log, "none"));
    const double *q1 = mk_log_get(log, "q1"), *q2 = mk_log_get(log, "q2");
    ck_assert(q1[0] == -1.57 && isnan(q1[1]) && isnan(q2[1]) && q1[2] == -1.5);
    ck_assert(isnan(mk_log_get(log, "u")[1]));
    ck_assert_ptr_null(mk_log_get(log, "tau"));
    ck_assert(!log->truncated);
    mk_log_free(log);
}
END_TEST

START_TEST(other_people_s_line_ends_and_marks_are_understood)
{
    struct mk_log *log = read_text("\xef\xbb\xbft, q1 ,u\r\n0,1,2\r\n\r\n1, 2 ,3");
    ck_assert_uint_eq(log->rows, 2);
    ck_assert(mk_log_get(log, "q1")[1] == 2 && mk_log_get(log, "u")[1] == 3);
    mk_log_free(log);
}
END_TEST

START_TEST(bad_logs_are_refused_with_line_and_column)
{
    expect_error("", MK_ERR_PARSE, 0, 0, "no header line");
    expect_error("# rig: x\n", MK_ERR_PARSE, 0, 0, "no header line");
    expect_error("t,q1\n", MK_ERR_PARSE, 0, 0, "no rows");
    expect_error("q1,u\n0,1\n", MK_ERR_PARSE, 1, 0, "no column t");
    expect_error("t,q1,q1\n0,1,2\n", MK_ERR_PARSE, 1, 3, "twice");
    expect_error("0,1,2\n1,2,3\n", MK_ERR_PARSE, 1, 1, "name a column");
    expect_error("t,,u\n0,1,2\n", MK_ERR_PARSE, 1, 2, "without a name");
    expect_error("t,q1\n0,1\n1,2,3\n2,1\n", MK_ERR_PARSE, 3, 3, "3 fields, the header names 2");
    expect_error("t,q1,u\n0,1\n1,2,3\n", MK_ERR_PARSE, 2, 2, "2 fields, the header names 3");
    expect_error("t,q1\n0,1\n0.1,x7\n1,2\n", MK_ERR_PARSE, 3, 2, "'x7' is not a number");
    expect_error("t,q1\n0,1\n0.2,1\n0.1,2\n", MK_ERR_PARSE, 4, 1, "time must increase");
    expect_error("t,q1\n0,1\n0,1\n", MK_ERR_PARSE, 3, 1, "time must increase");
    expect_error("t,q1\n0,1\n,2\n1,1\n", MK_ERR_PARSE, 3, 1, "time is missing");
    expect_error("t,q1\nnan,1\n", MK_ERR_PARSE, 2, 1, "time is missing");
}
END_TEST

START_TEST(what_cannot_be_read_says_why)
{
    struct mk_log *log;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(mk_log_read(scratch("none.csv"), &log, &err), MK_ERR_NOTFOUND);
    ck_assert_int_eq(mk_log_read("/tmp", &log, &err), MK_ERR_IO);
    const char *path = scratch("zero.csv");
    FILE *f = fopen(path, "wb");
    fwrite("t,q1\n0,\0\n", 1, 9, f);
    fclose(f);
    ck_assert_int_eq(mk_log_read(path, &log, &err), MK_ERR_PARSE);
    ck_assert_ptr_nonnull(strstr(err.message, "no text file"));
}
END_TEST

START_TEST(a_crash_while_writing_costs_the_last_line_only)
{
    struct mk_log *log = read_text("# mechkit-log: 1\nt,q1\n0,1\n1,2\n2,3.1");
    ck_assert_uint_eq(log->rows, 2); /* 3.1 may have been 3.14 */
    ck_assert(log->truncated);
    mk_log_free(log);
    log = read_text("t,q1,u\n0,1,5\n1,2,6\n2,3");
    ck_assert_uint_eq(log->rows, 2);
    ck_assert(log->truncated);
    mk_log_free(log);
}
END_TEST

START_TEST(unknown_columns_survive_a_round_trip)
{
    struct mk_log *log = read_text("t,mood,q1,temp\n0,1,5,20.5\n1,good,6,\n2,,7,21\n"), *back;
    struct mk_error err = MK_ERROR_INIT;
    const char *path = scratch("trip.csv");
    ck_assert_int_eq(mk_log_write(path, log, &err), MK_OK);
    ck_assert_int_eq(mk_log_read(path, &back, &err), MK_OK);
    ck_assert_uint_eq(back->column_count, 4);
    ck_assert_str_eq(back->columns[1].name, "mood");
    ck_assert_str_eq(back->columns[1].text[0], "1");
    ck_assert_str_eq(back->columns[1].text[1], "good");
    ck_assert_str_eq(back->columns[1].text[2], "");
    ck_assert(mk_log_get(back, "temp")[2] == 21 && isnan(mk_log_get(back, "temp")[1]));
    mk_log_free(log);
    mk_log_free(back);
}
END_TEST

static struct mk_log *random_log(size_t rows)
{
    struct mk_log *log;
    ck_assert_int_eq(mk_log_create(rows, &log), MK_OK);
    double *t = mk_log_add_column(log, "t"), *q = mk_log_add_column(log, "q1");
    double *u = mk_log_add_column(log, "u");
    srand(3);
    for (size_t i = 0; i < rows; i++) {
        t[i] = (double)i * 0.002;
        q[i] = rand() / 3.0e9 - 0.3;
        u[i] = i % 100 ? exp(rand() / 1e8) : (double)NAN;
    }
    return log;
}

static void expect_equal(const struct mk_log *a, const struct mk_log *b)
{
    ck_assert_uint_eq(a->rows, b->rows);
    for (size_t c = 0; c < a->column_count; c++)
        for (size_t r = 0; r < a->rows; r++) {
            double x = a->columns[c].data[r], y = b->columns[c].data[r];
            ck_assert(memcmp(&x, &y, sizeof x) == 0 || (isnan(x) && isnan(y)));
        }
}

START_TEST(a_round_trip_is_exact_plain_and_compressed)
{
    struct mk_log *log = random_log(30000), *back;
    struct mk_error err = MK_ERROR_INIT;
    const char *paths[] = {scratch("r.csv"), scratch("r.csv.gz")};
    ck_assert_int_eq(mk_log_set_meta(log, "rig", "pendulum"), MK_OK);
    for (int i = 0; i < 2; i++) {
        ck_assert_int_eq(mk_log_write(paths[i], log, &err), MK_OK);
        ck_assert_msg(mk_log_read(paths[i], &back, &err) == MK_OK, "%s", err.message);
        expect_equal(log, back);
        ck_assert_str_eq(mk_log_find_meta(back, "rig"), "pendulum");
        mk_log_free(back);
    }
    struct stat plain, packed;
    stat(paths[0], &plain), stat(paths[1], &packed);
    ck_assert(packed.st_size < plain.st_size);
    /* Half a compressed file is damaged, not short. */
    ck_assert_int_eq(truncate(paths[1], packed.st_size / 2), 0);
    ck_assert_int_eq(mk_log_read(paths[1], &back, &err), MK_ERR_IO);
    mk_log_free(log);
}
END_TEST

START_TEST(a_full_disk_keeps_the_old_file)
{
    struct mk_log *log = random_log(30000), *back;
    struct mk_error err = MK_ERROR_INIT;
    const char *path = scratch_text("old.csv", "t,q1\n0,1\n");
    struct rlimit limit;
    signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &limit);
    limit.rlim_cur = 100000;
    setrlimit(RLIMIT_FSIZE, &limit);
    ck_assert_int_eq(mk_log_write(path, log, &err), MK_ERR_NOSPACE);
    ck_assert_int_eq(mk_log_read(path, &back, &err), MK_OK);
    ck_assert_uint_eq(back->rows, 1);
    mk_log_free(back);
    mk_log_free(log);
}
END_TEST

/* --- row by row -------------------------------------------------------------------------- */

static struct mk_log_writer *open_writer(const char *path)
{
    static const char *const columns[] = {"t", "q1", "u"};
    char key[] = "rig", value[] = "pendulum";
    struct mk_log_meta meta[] = {{key, value}};
    struct mk_log_writer *w;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_log_writer_open(path, false, meta, 1, columns, 3, &w, &err) == MK_OK, "%s",
                  err.message);
    return w;
}

START_TEST(rows_written_during_a_run_are_a_log)
{
    const char *path = scratch("run.csv");
    struct mk_log_writer *w = open_writer(path);
    struct mk_error err = MK_ERROR_INIT;
    for (int i = 0; i < 5000; i++) {
        double row[] = {i * 0.1, i % 7 ? i / 3.0 : (double)NAN, -i};
        ck_assert_int_eq(mk_log_writer_row(w, row), MK_OK);
        if (i == 2500)
            ck_assert_int_eq(mk_log_writer_note(w, "event", "gains\nchanged"), MK_OK);
    }
    ck_assert_int_eq(mk_log_writer_close(w, &err), MK_OK);
    struct mk_log *log;
    ck_assert_msg(mk_log_read(path, &log, &err) == MK_OK, "%s", err.message);
    ck_assert_uint_eq(log->rows, 5000);
    ck_assert_str_eq(mk_log_find_meta(log, "event"), "gains changed");
    ck_assert(mk_log_get(log, "q1")[4] == 4 / 3.0);
    mk_log_free(log);
    static const char *const columns[] = {"t"};
    ck_assert_int_ne(mk_log_writer_open(path, false, NULL, 0, columns, 1, &w, &err), MK_OK);
}
END_TEST

START_TEST(kill_9_leaves_whole_lines)
{
    char path[256];
    snprintf(path, sizeof path, "%s", scratch("killed.csv"));
    int ready[2];
    ck_assert_int_eq(pipe(ready), 0);
    pid_t child = fork();
    if (child == 0) {
        struct mk_log_writer *w = open_writer(path);
        for (long i = 0;; i++) {
            double row[] = {i * 0.001, i / 3.0, i};
            if (mk_log_writer_row(w, row) != MK_OK)
                _exit(1);
            if (i == 20000 && write(ready[1], "x", 1) != 1)
                _exit(1);
        }
    }
    char c;
    ck_assert_int_eq(read(ready[0], &c, 1), 1);
    kill(child, SIGKILL);
    waitpid(child, NULL, 0);
    struct mk_log *log;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_log_read(path, &log, &err) == MK_OK, "%s", err.message);
    ck_assert_uint_gt(log->rows, 10000);
    for (size_t i = 0; i < log->rows; i++)
        ck_assert(mk_log_get(log, "u")[i] == (double)i);
    mk_log_free(log);
}
END_TEST

START_TEST(a_full_disk_is_reported_and_leaves_whole_lines)
{
    const char *path = scratch("full.csv");
    struct rlimit limit;
    signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &limit);
    limit.rlim_cur = 300000;
    setrlimit(RLIMIT_FSIZE, &limit);
    struct mk_log_writer *w = open_writer(path);
    enum mk_status st = MK_OK;
    for (int i = 0; st == MK_OK && i < 1000000; i++) {
        double row[] = {i * 0.001, i / 3.0, i};
        st = mk_log_writer_row(w, row);
    }
    ck_assert_int_eq(st, MK_ERR_NOSPACE);
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(mk_log_writer_close(w, &err), MK_ERR_NOSPACE);
    struct mk_log *log;
    ck_assert_msg(mk_log_read(path, &log, &err) == MK_OK, "%s", err.message);
    ck_assert(!log->truncated);
    ck_assert_uint_gt(log->rows, 1000);
    mk_log_free(log);
}
END_TEST

Suite *suite_log(void)
{
    Suite *s = suite_create("log");
    TCase *t = tcase_create("files");
    tcase_set_timeout(t, 30);
    tcase_add_test(t, a_log_is_read_with_metadata_and_gaps);
    tcase_add_test(t, other_people_s_line_ends_and_marks_are_understood);
    tcase_add_test(t, bad_logs_are_refused_with_line_and_column);
    tcase_add_test(t, what_cannot_be_read_says_why);
    tcase_add_test(t, a_crash_while_writing_costs_the_last_line_only);
    tcase_add_test(t, unknown_columns_survive_a_round_trip);
    tcase_add_test(t, a_round_trip_is_exact_plain_and_compressed);
    tcase_add_test(t, a_full_disk_keeps_the_old_file);
    tcase_add_test(t, rows_written_during_a_run_are_a_log);
    tcase_add_test(t, kill_9_leaves_whole_lines);
    tcase_add_test(t, a_full_disk_is_reported_and_leaves_whole_lines);
    suite_add_tcase(s, t);
    return s;
}
