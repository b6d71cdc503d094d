/* Logs: what is read is what was written; what is wrong is named with its place. */
#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "mechkit/log.h"
#include "support/comma_locale.h"
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
    ck_assert_int_eq(log->first_row_line, 5);
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

START_TEST(when_a_run_began_is_a_time_before_its_rows)
{
    static const char *const no_times[] = {"nan", "inf", "-inf", "abc", "0x10", "", "1 s"};
    static const char *const far[] = {"1e300", "-1e18", "5.001", "-99999996"};
    static const char *const good[] = {"5", "0", "-3.5", "-99999994"};
    char text[200];
    for (size_t i = 0; i < sizeof no_times / sizeof no_times[0]; i++) {
        snprintf(text, sizeof text, "# rig: pendulum\n# begins_s: %s\nt,q1\n5,0\n6,1\n",
                 no_times[i]);
        expect_error(text, MK_ERR_PARSE, 2, 0, "expected when the run began");
    }
    for (size_t i = 0; i < sizeof far / sizeof far[0]; i++) {
        snprintf(text, sizeof text, "# rig: pendulum\n# begins_s: %s\nt,q1\n5,0\n6,1\n", far[i]);
        expect_error(text, MK_ERR_PARSE, 2, 0, "not later than the first row (5 s)");
    }
    for (size_t i = 0; i < sizeof good / sizeof good[0]; i++) {
        snprintf(text, sizeof text, "# begins_s: %s\nt,q1\n5,0\n6,1\n", good[i]);
        mk_log_free(read_text(text));
    }
}
END_TEST

START_TEST(metadata_and_comments_may_stand_between_rows)
{
    struct mk_log *log = read_text("# a plain comment\nt,q1\n0,1\n#event:gains 1 2: 3\n"
                                   "  # event: halt  \n\n1,2\n#\n");
    ck_assert_uint_eq(log->rows, 2);
    ck_assert_int_eq(log->first_row_line, 3);
    ck_assert_uint_eq(log->meta_count, 4);
    ck_assert_str_eq(log->meta[0].key, "");
    ck_assert_str_eq(log->meta[0].value, "a plain comment");
    ck_assert_str_eq(mk_log_find_meta(log, "event"), "gains 1 2: 3");
    ck_assert_str_eq(log->meta[2].value, "halt");
    mk_log_free(log);
}
END_TEST

START_TEST(numbers_of_every_form_are_read)
{
    struct mk_log *log =
        read_text("u,\"t\",q1,tick\n+1,0,NaN,3\n1e3,1,inf,4\n,2, -0 ,5\n,,,\n.5,3,,6\n");
    const double *q1 = mk_log_get(log, "q1"), *u = mk_log_get(log, "u");
    ck_assert_uint_eq(log->rows, 4); /* the one of commas alone is no sample */
    ck_assert(mk_log_get(log, "t")[3] == 3 && mk_log_get(log, "tick")[3] == 6);
    ck_assert(u[0] == 1 && u[1] == 1000 && isnan(u[2]) && u[3] == 0.5);
    ck_assert(isnan(q1[0]) && isinf(q1[1]) && q1[2] == 0 && signbit(q1[2]) && isnan(q1[3]));
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
    expect_error("t,q1\ninf,1\n", MK_ERR_PARSE, 2, 1, "time is infinite");
    expect_error("t;q1;u\n0;1;2\n", MK_ERR_PARSE, 1, 0, "separated by commas");
    expect_error("# mechkit-log: 2\nt,q1\n0,1\n", MK_ERR_PARSE, 1, 0, "reads version 1");
    expect_error("t,q1,u\n0,1,2\n1,2,3,4", MK_ERR_PARSE, 3, 4, "4 fields, the header names 3");
    expect_error("t,q1\n0,1,5\n0.1,2,3\n", MK_ERR_PARSE, 2, 3, "3 fields, the header names 2");
    expect_error("t,q1\n0,1.5 2\n", MK_ERR_PARSE, 2, 2, "'1.5 2' is not a number (column q1)");
    expect_error("t\x01,q1\n0,1\n", MK_ERR_PARSE, 1, 1, "is this a log?");
    expect_error("t,q1\n0,\x1b[31m\n", MK_ERR_PARSE, 2, 2, "'?[31m' is not a number");
}
END_TEST

START_TEST(text_in_any_known_column_is_refused)
{
    static const char *const known[] = {
        "q1",    "q2",      "u",        "tau",      "u1",    "u2",     "tau1",   "tau2",
        "dq1",   "dq2",     "enc1",     "enc2",     "ref",   "phase",  "tick",   "late_us",
        "flags", "tau_cmd", "tau1_cmd", "tau2_cmd", "u_cmd", "u1_cmd", "u2_cmd", "left_out"};
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++) {
        char text[64];
        snprintf(text, sizeof text, "t,%s\n0,1\n1,here\n", known[i]);
        expect_error(text, MK_ERR_PARSE, 3, 2, known[i]);
    }
    expect_error("t,q1\nhere,1\n", MK_ERR_PARSE, 2, 1, "column t");
}
END_TEST

START_TEST(what_cannot_be_read_says_why)
{
    struct mk_log *log;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(mk_log_read(scratch("none.csv"), &log, &err), MK_ERR_NOTFOUND);
    ck_assert_str_eq(err.file, scratch("none.csv"));
    ck_assert_int_eq(mk_log_read("/tmp", &log, &err), MK_ERR_IO);
    ck_assert_ptr_nonnull(strstr(err.message, "directory"));
    ck_assert_int_eq(mk_log_read("/dev/null", &log, &err), MK_ERR_PARSE);
    ck_assert_int_eq(mk_log_read("/dev/zero", &log, &err), MK_ERR_PARSE);
    ck_assert_ptr_nonnull(strstr(err.message, "no text file"));
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
    static const char *const cut[] = {"2,3", "2,3,", "2", "2,-,6", "2,3,1e", "2,3,n"};
    for (size_t i = 0; i < sizeof cut / sizeof cut[0]; i++) {
        char text[64];
        snprintf(text, sizeof text, "t,q1,u\n0,1,5\n1,2,6\n%s", cut[i]);
        log = read_text(text);
        ck_assert_msg(log->rows == 2 && log->truncated, "%s", cut[i]);
        mk_log_free(log);
    }
    /* Elsewhere the last newline may be missing for good. */
    log = read_text("t,q1,note\n0,1,a\n1,2,b");
    ck_assert(log->rows == 2 && !log->truncated);
    mk_log_free(log);
    expect_error("t,q1,u\n0,1", MK_ERR_PARSE, 0, 0, "the only one is incomplete");
    expect_error("# mechkit-log: 1\nt,q1", MK_ERR_PARSE, 0, 0, "no rows");
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

/* What a log becomes on its way through a file. */
static char *round_trip(const char *text)
{
    struct mk_log *log = read_text(text);
    struct mk_error err = MK_ERROR_INIT;
    const char *path = scratch("round.csv");
    ck_assert_msg(mk_log_write(path, log, &err) == MK_OK, "%s", err.message);
    mk_log_free(log);
    return slurp_file(path);
}

START_TEST(names_that_are_quotes_and_blanks_survive_a_round_trip)
{
    static const char *const names[] = {"t", "\"\"", " b", "\"x\"", "\"", "c "};
    struct mk_log *log =
        read_text("t,\"\"\"\",\" b\",\"\"x\"\",\",\"c \"\n0,1,2,3,4,5\n1,2,3,4,5,6\n");
    for (int again = 0; again < 3; again++) {
        struct mk_error err = MK_ERROR_INIT;
        ck_assert_uint_eq(log->column_count, 6);
        for (size_t i = 0; i < 6; i++) {
            ck_assert_str_eq(log->columns[i].name, names[i]);
            ck_assert(mk_log_get(log, names[i])[0] == (double)i);
        }
        ck_assert_int_eq(mk_log_write(scratch("names.csv"), log, &err), MK_OK);
        mk_log_free(log);
        ck_assert_msg(mk_log_read(scratch("names.csv"), &log, &err) == MK_OK, "%s", err.message);
    }
    mk_log_free(log);
}
END_TEST

START_TEST(unknown_text_survives_to_the_letter)
{
    static const char *const texts[] = {
        /* text from the first row on, and after rows that could be numbers */
        "# mechkit-log: 1\nt,who\n0,007\n1,1.50\n2,\n3, Bond \n4,nan\n",
        "# mechkit-log: 1\nt,who,q1\n0,Bond,1\n1,007,2\n",
        "# mechkit-log: 1\na,b,t\n0.10,0.10,0\nx,0.20,1\n1e5,y,2\n",
        /* a double would lose the last digits */
        "# mechkit-log: 1\nt,stamp_ns\n0,17\n1,1700000000123456789\n",
        "# mechkit-log: 1\n# rig: pendubot\n# a comment\nt,q1\n0,0.1\n1,\n",
    };
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        char *back = round_trip(texts[i]);
        ck_assert_str_eq(back, texts[i]);
        free(back);
    }
    struct mk_log *log = read_text("t,who,k\n0,1,1\n1,x,2\n");
    ck_assert_ptr_null(mk_log_get(log, "who")); /* text is no number column */
    ck_assert_ptr_null(log->columns[1].data);
    ck_assert_str_eq(log->columns[1].text[0], "1");
    ck_assert(mk_log_get(log, "k")[1] == 2);
    mk_log_free(log);
}
END_TEST

START_TEST(text_of_any_length_survives_in_every_column)
{
    const size_t length = 300000;
    char *text = malloc(2 * length + 100), *at = text;
    at += sprintf(text, "# mechkit-log: 1\nt,who,why\n0,");
    memset(at, 'x', length);
    at[length] = ',';
    memset(at + length + 1, 'y', length);
    strcpy(at + 2 * length + 1, "\n");
    char *back = round_trip(text);
    ck_assert(strcmp(back, text) == 0);
    free(back);
    free(text);
}
END_TEST

START_TEST(a_pipe_is_read_like_a_file)
{
    int ends[2];
    char path[32];
    struct mk_log *log;
    struct mk_error err = MK_ERROR_INIT;
    static const char text[] = "t,q1,note\n0,1,5\n1,2,\n2,3,late\n";
    ck_assert_int_eq(pipe(ends), 0);
    ck_assert(write(ends[1], text, strlen(text)) == (ssize_t)strlen(text));
    close(ends[1]);
    snprintf(path, sizeof path, "/dev/fd/%d", ends[0]);
    ck_assert_msg(mk_log_read(path, &log, &err) == MK_OK, "%s", err.message);
    ck_assert_uint_eq(log->rows, 3);
    ck_assert_str_eq(log->columns[2].text[0], "5");
    ck_assert_str_eq(log->columns[2].text[1], "");
    ck_assert_str_eq(log->columns[2].text[2], "late");
    mk_log_free(log);
}
END_TEST

START_TEST(metadata_can_be_set_and_found)
{
    struct mk_log *log;
    char key[16];
    ck_assert_int_eq(mk_log_create(2, &log), MK_OK);
    ck_assert_uint_eq(log->rows, 2);
    for (int i = 0; i < 100; i++) {
        snprintf(key, sizeof key, "k%d", i);
        ck_assert_int_eq(mk_log_set_meta(log, key, "old"), MK_OK);
        ck_assert_int_eq(mk_log_set_meta(log, key, key), MK_OK);
    }
    ck_assert_uint_eq(log->meta_count, 100);
    ck_assert_str_eq(mk_log_find_meta(log, "k57"), "k57");
    ck_assert_int_eq(mk_log_set_meta(log, "", "x"), MK_ERR_INVALID);
    ck_assert_int_eq(mk_log_set_meta(log, "a:b", "x"), MK_ERR_INVALID);
    ck_assert_int_eq(mk_log_set_meta(log, "a\nb", "x"), MK_ERR_INVALID);
    mk_log_free(log);
    mk_log_free(NULL);
}
END_TEST

START_TEST(a_log_that_could_not_be_read_back_is_not_written)
{
    static const char *const bad[] = {"q1", "t", "a,b", "a\nb", ""};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct mk_log *log;
        struct mk_error err = MK_ERROR_INIT;
        ck_assert_int_eq(mk_log_create(1, &log), MK_OK);
        ck_assert_ptr_nonnull(mk_log_add_column(log, i ? "t" : "u"));
        ck_assert_ptr_nonnull(mk_log_add_column(log, bad[i]));
        ck_assert_int_eq(mk_log_write(scratch("never.csv"), log, &err), MK_ERR_INVALID);
        ck_assert_int_eq(count_files("never.csv*"), 0);
        mk_log_free(log);
    }
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

/* Shortest digits of a large double are those of a whole number. */
START_TEST(an_unknown_column_of_large_numbers_stays_one_of_numbers)
{
    struct mk_log *log = read_text("t,x\n0,6.666666666666017e17\n1,-1e20\n2,1e15\n"), *back;
    struct mk_error err = MK_ERROR_INIT;
    const char *path = scratch("large.csv");
    ck_assert_int_eq(mk_log_write(path, log, &err), MK_OK);
    ck_assert_int_eq(mk_log_read(path, &back, &err), MK_OK);
    ck_assert(mk_log_get(back, "x") != NULL);
    expect_equal(log, back);
    mk_log_free(log);
    mk_log_free(back);
}
END_TEST

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
    mk_log_free(log);
}
END_TEST

START_TEST(a_million_rows_come_back_bit_for_bit_in_the_memory_of_their_columns)
{
    enum { ROWS = 1000000, COLUMNS = 3 };
    struct mk_log *log = random_log(ROWS), *back;
    struct mk_error err = MK_ERROR_INIT;
    struct rusage before, after;
    const char *path = scratch("million.csv");
    ck_assert_int_eq(mk_log_write(path, log, &err), MK_OK);
    getrusage(RUSAGE_SELF, &before);
    ck_assert_msg(mk_log_read(path, &back, &err) == MK_OK, "%s", err.message);
    getrusage(RUSAGE_SELF, &after);
    expect_equal(log, back);
    mk_log_free(log);
    mk_log_free(back);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    long columns_kb = ROWS * COLUMNS * (long)sizeof(double) / 1024;
    ck_assert_int_lt(after.ru_maxrss - before.ru_maxrss, 2 * columns_kb);
#endif
}
END_TEST

/* The whole of a file, with room for damage. */
static long load(const char *path, char *bytes, size_t size)
{
    FILE *f = fopen(path, "rb");
    size_t n = fread(bytes, 1, size, f);
    fclose(f);
    return (long)n;
}

static void store(const char *path, const char *bytes, long n)
{
    FILE *f = fopen(path, "wb");
    ck_assert(fwrite(bytes, 1, (size_t)n, f) == (size_t)n && fclose(f) == 0);
}

START_TEST(a_damaged_compressed_file_is_refused_wherever_the_damage_is)
{
    static char bytes[200000], bad[200000];
    struct mk_log *log = random_log(3000), *back;
    struct mk_error err = MK_ERROR_INIT;
    const char *path = scratch("d.csv.gz");
    ck_assert_int_eq(mk_log_write(path, log, &err), MK_OK);
    mk_log_free(log);
    long size = load(path, bytes, sizeof bytes);
    for (long at = size / 20; at < size; at += size / 20) {
        store(path, bytes, at); /* cut off */
        ck_assert_int_eq(mk_log_read(path, &back, &err), MK_ERR_IO);
        ck_assert_ptr_nonnull(strstr(err.message, "damaged"));
        ck_assert_ptr_nonnull(strstr(err.message, "it ends too early"));
        ck_assert_str_eq(err.file, path);
        memcpy(bad, bytes, (size_t)size); /* flipped */
        bad[at] = (char)~bad[at];
        store(path, bad, size);
        enum mk_status st = mk_log_read(path, &back, &err);
        ck_assert_msg(st == MK_ERR_IO || st == MK_ERR_PARSE, "flip at %ld", at);
        ck_assert_msg(!strstr(err.message, "fd:") && !strstr(err.message, "line 0"), "%s",
                      err.message);
        ck_assert_ptr_null(back);
    }
    store(path, bytes, size - 1);
    ck_assert_int_eq(mk_log_read(path, &back, &err), MK_ERR_IO);
}
END_TEST

START_TEST(garbage_is_refused_and_never_read_past_its_end)
{
    /* Random bytes, and logs with random bytes in them, in blocks of exact size for the sanitizer.
     */
    static const char good[] = "# mechkit-log: 1\nt,q1,x\n0,1,a\n1,2,b\n2,3,4\n";
    const char *path = scratch("garbage.csv");
    srand(11);
    for (int round = 0; round < 2000; round++) {
        char bytes[256];
        long n = round % 2 ? rand() % (long)sizeof bytes : (long)strlen(good);
        if (round % 2)
            for (long i = 0; i < n; i++)
                bytes[i] = (char)rand();
        else
            memcpy(bytes, good, (size_t)n);
        for (int hits = round % 2 ? 0 : 1 + rand() % 4; hits > 0; hits--)
            bytes[rand() % n] = ",\n\r\0#x-. \xff"[rand() % 10];
        store(path, bytes, n);
        struct mk_log *log;
        struct mk_error err = MK_ERROR_INIT;
        enum mk_status st = mk_log_read(path, &log, &err);
        ck_assert((st == MK_OK) == (log != NULL));
        ck_assert(st == MK_OK || (st == MK_ERR_PARSE && err.message[0] && err.file[0]));
        if (st == MK_OK) {
            ck_assert_uint_gt(log->rows, 0);
            ck_assert_int_eq(mk_log_write("/dev/null", log, &err), MK_OK);
        }
        mk_log_free(log);
    }
}
END_TEST

START_TEST(a_locale_with_a_decimal_comma_does_not_matter)
{
    static const char text[] = "# mechkit-log: 1\nt,q1,x\n0,0.5,a\n0.25,1234567.5,b\n";
    if (!use_comma_locale())
        return;
    char *back = round_trip(text);
    ck_assert_str_eq(back, text);
    free(back);
}
END_TEST

START_TEST(a_line_as_long_as_none_is_refused)
{
    const char *path = scratch("long.csv");
    FILE *f = fopen(path, "w");
    for (int i = 0; i < 3000000; i++)
        fputc('x', f);
    fclose(f);
    struct mk_log *log;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(mk_log_read(path, &log, &err), MK_ERR_PARSE);
    ck_assert_ptr_nonnull(strstr(err.message, "no text file"));
    ck_assert_int_eq(err.line, 1);
}
END_TEST

START_TEST(a_log_of_comments_or_columns_without_end_is_refused_at_its_line)
{
    struct mk_log *log;
    struct mk_error err = MK_ERROR_INIT;
    const char *path = scratch("comments.csv");
    FILE *f = fopen(path, "w");
    for (int i = 0; i < 200000; i++)
        fputs("#\n", f);
    fclose(f);
    ck_assert_int_eq(mk_log_read(path, &log, &err), MK_ERR_PARSE);
    ck_assert_msg(err.line == 100001 && strstr(err.message, "comments"), "%s", err.message);
    path = scratch("long_comments.csv");
    f = fopen(path, "w");
    for (int i = 0; i < 20; i++)
        fprintf(f, "# key: %0*d\n", 1000000, 1);
    fclose(f);
    ck_assert_int_eq(mk_log_read(path, &log, &err), MK_ERR_PARSE);
    ck_assert_msg(err.line == 17 && strstr(err.message, "16 MB"), "%s", err.message);
    path = scratch("columns.csv");
    f = fopen(path, "w");
    fputs("t", f);
    for (int i = 0; i < 100000; i++)
        fprintf(f, ",c%d", i);
    fputs("\n", f);
    fclose(f);
    ck_assert_int_eq(mk_log_read(path, &log, &err), MK_ERR_PARSE);
    ck_assert_msg(err.line == 1 && strstr(err.message, "at most 4096"), "%s", err.message);
}
END_TEST

START_TEST(a_log_of_nothing_without_end_is_refused_but_gaps_are_none)
{
    enum { MB = 1 << 20 };
    static char empty[MB];
    struct mk_log *log;
    struct mk_error err = MK_ERROR_INIT;
    static const struct {
        const char *line;
        int mb;
        bool good;
    } rows[] = {{"\n", 15, true}, {"\n", 17, false}, {",\n", 15, true}, {",\n", 17, false}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        size_t length = strlen(rows[i].line);
        for (size_t k = 0; k < MB; k++)
            empty[k] = rows[i].line[k % length];
        const char *path = scratch("empty.csv");
        FILE *f = fopen(path, "w");
        fputs("t,q1\n0,1\n", f);
        for (int k = 0; k < rows[i].mb; k++)
            fwrite(empty, 1, MB, f);
        fputs("1,2\n", f);
        fclose(f);
        enum mk_status st = mk_log_read(path, &log, &err);
        ck_assert_msg(st == (rows[i].good ? MK_OK : MK_ERR_PARSE), "%zu: %s", i, err.message);
        ck_assert_msg(rows[i].good || (strstr(err.message, "16 MB of empty lines") &&
                                       err.line > (16 << 20) / (int)length),
                      "%s", err.message);
        if (rows[i].good)
            ck_assert_uint_eq(log->rows, 2);
        mk_log_free(log);
    }
    /* Where every row has some, there may be more of them in all. */
    const char *path = scratch("gaps.csv");
    FILE *f = fopen(path, "w");
    fputs("t,q1\n", f);
    for (int k = 0; k < 40000; k++) {
        fprintf(f, "%d,1\n", k);
        fwrite(empty, 1, 600, f); /* commas: 24 MB of them */
    }
    fclose(f);
    ck_assert_msg(mk_log_read(path, &log, &err) == MK_OK, "%s", err.message);
    ck_assert_uint_eq(log->rows, 40000);
    mk_log_free(log);
}
END_TEST

START_TEST(a_wide_log_is_read_and_written)
{
    enum { COLUMNS = 2000 };
    struct mk_log *log, *back;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(mk_log_create(40, &log), MK_OK);
    for (int c = 0; c < COLUMNS; c++) {
        char name[32];
        snprintf(name, sizeof name, "a_rather_long_name_%d", c);
        double *x = mk_log_add_column(log, c ? name : "t");
        for (int row = 0; row < 40; row++)
            x[row] = row + c / 7.0;
    }
    ck_assert_int_eq(mk_log_write(scratch("wide.csv"), log, &err), MK_OK);
    ck_assert_int_eq(mk_log_read(scratch("wide.csv"), &back, &err), MK_OK);
    expect_equal(log, back);
    mk_log_free(log);
    mk_log_free(back);
}
END_TEST

START_TEST(a_full_disk_keeps_the_old_file)
{
    struct mk_log *log = random_log(30000), *back;
    struct mk_error err = MK_ERROR_INIT;
    const char *path = scratch_text("old.csv", "t,q1\n0,1\n");
    limit_file_size(100000);
    enum mk_status plain = mk_log_write(path, log, &err);
    enum mk_status packed = mk_log_write(scratch("new.csv.gz"), log, &err);
    limit_file_size(0);
    ck_assert_int_eq(plain, MK_ERR_NOSPACE);
    ck_assert_int_eq(packed, MK_ERR_NOSPACE);
    ck_assert_int_eq(count_files("old.csv*") + count_files("new.csv*"), 1);
    ck_assert_int_eq(mk_log_read(path, &back, &err), MK_OK);
    ck_assert_uint_eq(back->rows, 1);
    mk_log_free(back);
    mk_log_free(log);
}
END_TEST

START_TEST(what_a_killed_program_left_is_removed_the_next_time)
{
    char left[300], alive[300], other[300];
    pid_t gone = fork();
    if (gone == 0)
        _exit(0);
    waitpid(gone, NULL, 0);
    snprintf(left, sizeof left, "out.csv.%ld-0.tmp", (long)gone);
    snprintf(alive, sizeof alive, "out.csv.%ld-7.tmp", (long)getppid());
    snprintf(other, sizeof other, "old.csv.%ld-0.tmp", (long)gone);
    scratch_text(other, "half of another log");
    scratch_text(left, "half a log");
    scratch_text(alive, "another program is at it");
    scratch_text("out.csv.mine.tmp", "not ours");
    scratch_text("out.csv.12-tmp", "not ours");
    struct mk_log *log = read_text("t,q1,u\n0,1,2\n1,2,3\n");
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_log_write(scratch("out.csv"), log, &err) == MK_OK, "%s", err.message);
    mk_log_free(log);
    ck_assert_int_ne(access(scratch(left), F_OK), 0);
    ck_assert_int_eq(access(scratch(alive), F_OK), 0);
    ck_assert_int_eq(access(scratch(other), F_OK), 0);
    ck_assert_int_eq(access(scratch("out.csv.mine.tmp"), F_OK), 0);
    ck_assert_int_eq(access(scratch("out.csv.12-tmp"), F_OK), 0);
}
END_TEST

START_TEST(writing_replaces_files_alone_and_follows_links)
{
    struct mk_log *log = random_log(3000), *back;
    struct mk_error err = MK_ERROR_INIT;
    struct stat info;
    ck_assert_int_eq(mk_log_write("/dev/full", log, &err), MK_ERR_NOSPACE);
    ck_assert_int_eq(mk_log_write("/dev/null", log, &err), MK_OK);
    ck_assert(stat("/dev/null", &info) == 0 && S_ISCHR(info.st_mode));
    ck_assert_int_eq(mk_log_write("/tmp", log, &err), MK_ERR_IO);
    ck_assert_int_eq(mk_log_write(scratch("no/place.csv"), log, &err), MK_ERR_NOTFOUND);
    const char *file = scratch_text("file.csv", "old\n"), *link = scratch("link.csv");
    ck_assert(chmod(file, 0640) == 0 && symlink(file, link) == 0);
    ck_assert_int_eq(mk_log_write(link, log, &err), MK_OK);
    ck_assert(lstat(link, &info) == 0 && S_ISLNK(info.st_mode));
    ck_assert(stat(file, &info) == 0 && (info.st_mode & 0777) == 0640);
    ck_assert_int_eq(mk_log_read(file, &back, &err), MK_OK);
    expect_equal(log, back);
    mk_log_free(back);
    mk_log_free(log);
}
END_TEST

/* The link is the user's: what it points to comes to be where it says, and the link stays. */
START_TEST(a_link_to_a_file_that_is_not_there_yet_stays_a_link)
{
    struct mk_log *log = random_log(30);
    struct mk_error err = MK_ERROR_INIT;
    struct stat info;
    char outer[300], inner[300];
    snprintf(outer, sizeof outer, "%s", scratch("outer.csv"));
    snprintf(inner, sizeof inner, "%s", scratch("inner.csv"));
    ck_assert(symlink("inner.csv", outer) == 0 && symlink(scratch("made.csv"), inner) == 0);
    ck_assert_msg(mk_log_write(outer, log, &err) == MK_OK, "%s", err.message);
    ck_assert(lstat(outer, &info) == 0 && S_ISLNK(info.st_mode));
    ck_assert(lstat(inner, &info) == 0 && S_ISLNK(info.st_mode));
    ck_assert(lstat(scratch("made.csv"), &info) == 0 && S_ISREG(info.st_mode));
    ck_assert(unlink(inner) == 0 && symlink("outer.csv", inner) == 0);
    ck_assert_int_eq(mk_log_write(outer, log, &err), MK_ERR_IO);
    ck_assert(lstat(outer, &info) == 0 && S_ISLNK(info.st_mode));
    mk_log_free(log);
}
END_TEST

START_TEST(an_empty_mark_of_left_out_rows_leaves_nothing_out)
{
    struct mk_log *log = read_text("t,q1,left_out,u\n0,1,,1\n1,2,1,1\n2,3,nan,\n3,3,0,1\n");
    const double *mark = mk_log_get(log, "left_out");
    ck_assert(mark[0] == 0.0 && mark[1] == 1.0 && mark[2] == 0.0 && mark[3] == 0.0);
    ck_assert(isnan(mk_log_get(log, "u")[2]));
    mk_log_free(log);
}
END_TEST

START_TEST(a_number_column_is_shifted_and_nothing_else)
{
    struct mk_log *log = read_text("t,q1,q2,name\n0,1,,a\n1,2,1,b\n");
    mk_log_shift(log, mk_log_angle(1), 0.5);
    mk_log_shift(log, mk_log_speed(0), 0.5); /* not there */
    mk_log_shift(log, "name", 0.5);
    ck_assert(isnan(mk_log_get(log, "q2")[0]) && mk_log_get(log, "q2")[1] == 1.5);
    ck_assert(mk_log_get(log, "q1")[0] == 1.0 && mk_log_get(log, "t")[1] == 1.0);
    ck_assert_uint_eq(log->column_count, 4);
    ck_assert_str_eq(log->columns[3].text[1], "b");
    ck_assert_str_eq(mk_log_speed(1), "dq2");
    ck_assert_str_eq(mk_log_angle(2), "");
    ck_assert_str_eq(mk_log_angle(-1), "");
    mk_log_free(log);
}
END_TEST

Suite *suite_log(void)
{
    Suite *s = suite_create("log");
    TCase *t = tcase_create("files");
    tcase_set_timeout(t, 30);
    tcase_add_test(t, a_log_is_read_with_metadata_and_gaps);
    tcase_add_test(t, a_number_column_is_shifted_and_nothing_else);
    tcase_add_test(t, other_people_s_line_ends_and_marks_are_understood);
    tcase_add_test(t, when_a_run_began_is_a_time_before_its_rows);
    tcase_add_test(t, metadata_and_comments_may_stand_between_rows);
    tcase_add_test(t, numbers_of_every_form_are_read);
    tcase_add_test(t, bad_logs_are_refused_with_line_and_column);
    tcase_add_test(t, text_in_any_known_column_is_refused);
    tcase_add_test(t, what_cannot_be_read_says_why);
    tcase_add_test(t, a_crash_while_writing_costs_the_last_line_only);
    tcase_add_test(t, unknown_columns_survive_a_round_trip);
    tcase_add_test(t, an_unknown_column_of_large_numbers_stays_one_of_numbers);
    tcase_add_test(t, names_that_are_quotes_and_blanks_survive_a_round_trip);
    tcase_add_test(t, unknown_text_survives_to_the_letter);
    tcase_add_test(t, text_of_any_length_survives_in_every_column);
    tcase_add_test(t, a_pipe_is_read_like_a_file);
    tcase_add_test(t, metadata_can_be_set_and_found);
    tcase_add_test(t, a_log_that_could_not_be_read_back_is_not_written);
    tcase_add_test(t, a_round_trip_is_exact_plain_and_compressed);
    tcase_add_test(t, a_million_rows_come_back_bit_for_bit_in_the_memory_of_their_columns);
    tcase_add_test(t, a_damaged_compressed_file_is_refused_wherever_the_damage_is);
    tcase_add_test(t, garbage_is_refused_and_never_read_past_its_end);
    tcase_add_test(t, a_locale_with_a_decimal_comma_does_not_matter);
    tcase_add_test(t, a_line_as_long_as_none_is_refused);
    tcase_add_test(t, a_log_of_comments_or_columns_without_end_is_refused_at_its_line);
    tcase_add_test(t, a_log_of_nothing_without_end_is_refused_but_gaps_are_none);
    tcase_add_test(t, a_wide_log_is_read_and_written);
    tcase_add_test(t, a_full_disk_keeps_the_old_file);
    tcase_add_test(t, what_a_killed_program_left_is_removed_the_next_time);
    tcase_add_test(t, writing_replaces_files_alone_and_follows_links);
    tcase_add_test(t, a_link_to_a_file_that_is_not_there_yet_stays_a_link);
    tcase_add_test(t, an_empty_mark_of_left_out_rows_leaves_nothing_out);
    suite_add_tcase(s, t);
    return s;
}
