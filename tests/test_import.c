/* Other people's files: formats and mappings. */
#include "suites.h"

#include <glob.h>
#include <math.h>
#include <matio.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mechkit/exchange.h"
#include "support/files.h"
#include "support/program.h"

#define MAPS MK_SOURCE_DIR "/models/measured/"

/* --- formats ----------------------------------------------------------------------------- */

static void check_file(const char *name, const char *text, const char *rig)
{
    char out[2048];
    struct mk_log *log;
    const char *csv = scratch("imported.csv");
    int code = run_mechkit(out, sizeof out, "import %s --rig %s --force --out %s",
                           scratch_text(name, text), rig, csv);
    ck_assert_msg(code == 0, "%s: %s", name, out);
    ck_assert_int_eq(mk_log_read(csv, &log, NULL), MK_OK);
    ck_assert_str_eq(mk_log_find_meta(log, "rig"), rig);
    const double *t = mk_log_get(log, "t"), *q1 = mk_log_get(log, "q1"), *u = mk_log_get(log, "u");
    ck_assert_msg(t && q1 && u, "%s: %s", name, out);
    ck_assert_uint_eq(log->rows, 3);
    ck_assert_double_eq_tol(t[0], 0.0, 1e-12);
    ck_assert_double_eq_tol(t[2], 0.004, 1e-12);
    ck_assert_double_eq_tol(q1[1], 0.5, 1e-9);
    ck_assert_double_eq_tol(u[2], -1.5, 1e-12);
    if (strcmp(rig, "pendubot") == 0)
        ck_assert(isnan(mk_log_get(log, "q2")[1]));
    mk_log_free(log);
}

START_TEST(files_are_read_as_their_writers_wrote_them)
{
    check_file("plain.csv", "t,q1,u\n0,0,0\n0.002,0.5,1\n0.004,1,-1.5\n", "pendulum");
    check_file("spreadsheet.csv",
               "Zeit;Winkel;theta;Voltage\n5,000;9;0;0\n5,002;9;0,5;1\n"
               "5,004;9;1,0;-1,5\n",
               "pendulum");
    check_file("units.csv", "time_ms,Theta [deg],u\n0,0,0\n2,28.64788975654116,1\n4,57,-1.5\n",
               "pendulum");
    check_file("unit_row.csv",
               "% by a colleague\ntime\tposition\tcommand\nms\tdeg\tV\n0\t0\t0\n"
               "2\t28.64788975654116\t1\n4\t57\t-1.5\n",
               "pendulum");
    check_file("blanks.txt",
               "time   theta1 theta2  u\r\n0 0 0 0\r\n  0.002 0.5 nan 1\r\n"
               "0.004 1 0 -1.5\r\n",
               "pendubot");
    check_file("gaps.csv",
               "\"timestamp\",\"q1\",\"q2\",\"u\"\n0,0,0,0\n0.002,0.5,,1\n"
               "0.004,1,0,-1.5\n",
               "pendubot");
}
END_TEST

START_TEST(a_file_without_names_goes_by_numbers_of_columns)
{
    char out[2048];
    const char *file = scratch_text("bare.csv", "0,9,7,1\n2,9,8,1\n4,9,9,2\n");
    const char *map = scratch_text("bare.map", "[rig]\nkind = pendulum\nu_to_torque = 0.5\n"
                                               "[t]\ncolumn = 1\nunit = ms\n[q1]\ncolumn = 3\n"
                                               "sign = -1\noffset = 0.25\n[u]\ncolumn = 4\n"
                                               "unit = Nm\n");
    ck_assert_int_eq(run_mechkit(out, sizeof out, "import %s --rig pendulum --json -", file), 3);
    ck_assert_msg(strstr(out, "which column is time") && strstr(out, "1, 2, 3, 4"), "%s", out);
    int code = run_mechkit(out, sizeof out, "import %s --map %s --out %s", file, map,
                           scratch("bare_log.csv"));
    ck_assert_msg(code == 0, "%s", out);
    code = run_mechkit(out, sizeof out, "import %s --map %s --out %s", file, map, file);
    ck_assert_msg(code == 2 && strstr(out, "that is a file to be read"), "%s", out);
    char *log = slurp_file(scratch("bare_log.csv"));
    ck_assert_ptr_nonnull(strstr(log, "t,q1,u\n0,-6.75,2\n0.002,-7.75,2\n0.004,-8.75,4\n"));
    free(log);
}
END_TEST

START_TEST(text_where_a_number_should_be_is_told_with_its_line)
{
    static const struct {
        const char *text, *says; /* NULL: it is read, all rows of it */
    } files[] = {
        {"t,q1,q2,u\n0,0,abc,0\n0.1,0,0,0\n0.2,0,0,0\n", ":2: 'abc' in column q2 is no number"},
        {"t,q1,q2,u\n0,0,0,0\n0.1,0,0,0\n0.2,1.2.3,0,0\n", ":4: '1.2.3' in column q1"},
        {"t,q1,q2,u\n0,0,0,0\n0.1,0,0,0\ninf,0,0,0\n", "row 3: time is infinite"},
        {"t,q1,q2,u\n-1e308,0,0,0\n0,0,0,0\n1.5e308,0,0,0\n", "row 3: time is infinite"},
        {"t,q1,q2,u,phase\n0,0,0,0,swing up\n0.1,NA,nan,0,swing up\n0.2,0,-,0,\n", NULL},
        {"t,q1,q2,u\n[s],rad,,1\n0,0,0,0\n0.1,0,0,0\n0.2,0,0,0\n", NULL}};
    for (size_t i = 0; i < sizeof files / sizeof files[0]; i++) {
        char out[2048];
        int code = run_mechkit(out, sizeof out, "import %s --rig pendubot --force --out %s",
                               scratch_text("text.csv", files[i].text), scratch("text_log.csv"));
        ck_assert_msg(files[i].says ? code == 3 && strstr(out, files[i].says)
                                    : code == 0 && strstr(out, "3 rows"),
                      "%zu: %d %s", i, code, out);
    }
}
END_TEST

/* Row 2 of what a file with degrees and milliseconds in its header becomes. */
static void expect_second_row(const char *keys_of_q1, const char *row)
{
    char map[300];
    snprintf(map, sizeof map,
             "[rig]\nkind = pendulum\n[t]\ncolumn = Time\n[q1]\ncolumn = Arm angle\n%s"
             "[u]\ncolumn = Voltage\n",
             keys_of_q1);
    const char *file = scratch_text("header.csv", "Time [ms],Arm angle [deg],Voltage (V)\n"
                                                  "0,0,0\n10,90,1\n20,180,1\n");
    char out[2048];
    int status = run_mechkit(out, sizeof out, "import %s --map %s --force --out %s", file,
                             scratch_text("header.map", map), scratch("header_log.csv"));
    ck_assert_msg(status == 0, "%s", out);
    char *log = slurp_file(scratch("header_log.csv"));
    ck_assert_msg(strstr(log, row), "%s", log);
    free(log);
}

START_TEST(a_mapping_without_a_unit_takes_that_of_the_header)
{
    expect_second_row("", "\n0.01,1.5707963267948966,1\n");
    expect_second_row("sign = -1\n", "\n0.01,-1.5707963267948966,1\n");
    /* What it says itself goes first: a unit, or a factor in the place of one. */
    expect_second_row("unit = rad\n", "\n0.01,90,1\n");
    expect_second_row("sign = 0.01\n", "\n0.01,0.9,1\n");
}
END_TEST

START_TEST(an_infinite_value_is_refused)
{
    char out[2048];
    const char *file = scratch_text("inf.csv", "t,q1,u\n0,0,0\n0.01,1,1e999\n0.02,2,1\n");
    int status = run_mechkit(out, sizeof out, "import %s --rig pendulum --force --out %s", file,
                             scratch("inf_log.csv"));
    ck_assert_msg(status == 3 && strstr(out, "row 2: u is infinite"), "%d %s", status, out);
}
END_TEST

START_TEST(a_mapping_takes_counts_of_an_encoder)
{
    char out[2048];
    const char *file = scratch_text("counts.csv", "t,enc,u\n0,0,0\n0.01,500,1\n0.02,1000,1\n");
    static const char map[] = "[rig]\nkind = pendulum\n%s[t]\ncolumn = t\n[q1]\ncolumn = enc\n"
                              "unit = counts\nsign = -1\n[u]\ncolumn = u\n";
    char text[300];
    snprintf(text, sizeof text, map, "encoder_cpr = 2000\n");
    int status = run_mechkit(out, sizeof out, "import %s --map %s --force --out %s", file,
                             scratch_text("counts.map", text), scratch("counts_log.csv"));
    ck_assert_msg(status == 0, "%s", out);
    char *log = slurp_file(scratch("counts_log.csv"));
    ck_assert_msg(strstr(log, "\n0.01,-1.5707963267948966,1\n"), "%s", log);
    free(log);
    snprintf(text, sizeof text, map, "");
    status = run_mechkit(out, sizeof out, "import %s --map %s --force --out %s", file,
                         scratch_text("counts.map", text), scratch("counts_log.csv"));
    ck_assert_msg(status == 3 && strstr(out, "Give [rig] encoder_cpr, counts a turn"), "%d %s",
                  status, out);
}
END_TEST

/* The unit in a header need not be repeated in a mapping, where no other column has the name. */
START_TEST(a_column_is_found_without_the_unit_in_its_header)
{
    char out[2048];
    const char *map = scratch_text("unit.map", "[rig]\nkind = pendulum\n[t]\ncolumn = Time\n[q1]\n"
                                               "column = Arm angle\nunit = deg\n[u]\n"
                                               "column = Voltage\n");
    const char *file = scratch_text(
        "unit.csv", "Time [s],Arm angle [deg],Voltage (V)\n0,0,0\n0.01,90,1\n0.02,180,1\n");
    int code = run_mechkit(out, sizeof out, "import %s --map %s --force --out %s", file, map,
                           scratch("unit_log.csv"));
    ck_assert_msg(code == 0, "%s", out);
    char *log = slurp_file(scratch("unit_log.csv"));
    ck_assert_msg(strstr(log, "0.01,1.57079") != NULL, "%s", log);
    free(log);
    /* Of two that differ in the unit alone neither is taken. */
    file = scratch_text("unit.csv", "Time [s],Arm angle [deg],Arm angle [rad],Voltage\n"
                                    "0,0,0,0\n0.01,90,1.57,1\n0.02,180,3.14,1\n");
    code = run_mechkit(out, sizeof out, "import %s --map %s --force --out %s", file, map,
                       scratch("unit_log.csv"));
    ck_assert_msg(
        code == 3 &&
            strstr(out, "there is no column 'Arm angle', from which the mapping takes q1") &&
            strstr(out, "Arm angle [rad]"),
        "%d %s", code, out);
    /* A misspelt key. */
    map = scratch_text("unit.map", "[rig]\nkind = pendulum\n[t]\ncolum = Time\n");
    code = run_mechkit(out, sizeof out, "import %s --map %s --force --out %s", file, map,
                       scratch("unit_log.csv"));
    ck_assert_msg(code == 3 && strstr(out, "did you mean column?"), "%d %s", code, out);
}
END_TEST

START_TEST(of_two_columns_of_one_name_the_mapping_says_which)
{
    char out[2048];
    const char *file =
        scratch_text("twice.csv", "t,q1,q1,q2,u\n0,1,2,0,0\n0.1,1,2,0,0\n0.2,1,2,0,0\n");
    int code = run_mechkit(out, sizeof out, "import %s --rig pendubot --out %s", file,
                           scratch("twice_log.csv"));
    ck_assert_msg(code == 3 && strstr(out, "2 columns are called q1") && strstr(out, "column = 2"),
                  "%d %s", code, out);
    const char *map = scratch_text("twice.map", "[rig]\nkind = pendubot\n[t]\ncolumn = t\n[q1]\n"
                                                "column = 3\n[q2]\ncolumn = q2\n[u]\ncolumn = u\n");
    code = run_mechkit(out, sizeof out, "import %s --map %s --force --out %s", file, map,
                       scratch("twice_log.csv"));
    ck_assert_msg(code == 0, "%s", out);
    char *log = slurp_file(scratch("twice_log.csv"));
    ck_assert_msg(strstr(log, "t,q1,q2,u\n0,2,0,0\n") != NULL, "%s", log);
    free(log);
}
END_TEST

START_TEST(a_name_that_no_mapping_can_have_goes_by_its_number)
{
    char out[4096], map[512];
    const char *file = scratch_text("odd.csv", "t,\"Theta 1 \",q\x01"
                                               "2,u\n0,1,2,0\n0.1,1,2,0\n0.2,1,2,0\n");
    snprintf(map, sizeof map, "%s", scratch("odd.map"));
    int code =
        run_mechkit(out, sizeof out, "import --rig pendubot --force --write-map %s %s", map, file);
    ck_assert_msg(code == 0, "%d: %s", code, out);
    char *text = slurp_file(map);
    ck_assert_msg(strstr(text, "[q1]\ncolumn = 2\n") && strstr(text, "[q2]\ncolumn = 3\n"), "%s",
                  text);
    free(text);
    code = run_mechkit(out, sizeof out, "import --map %s --force --out %s %s", map,
                       scratch("odd_log.csv"), file);
    ck_assert_msg(code == 0, "%d: %s", code, out);
}
END_TEST

START_TEST(control_characters_in_names_of_columns_are_shown)
{
    static const struct {
        const char *text, *says;
        int code;
    } rows[] = {
        {"when\x1b[2J,q1,u\n0,0,0\n1,0,1\n2,0,0\n", "there are: when\\x1b[2J, q1, u", 3},
        {"t\x07,q1,u,1\n0,0,0,9\n1,0,1,9\n2,0,0,9\n", "t     = t\\x07  (0 .. 2 s)\n", 0},
        {"t\x07,t\x07,q1,u,1\n0,9,0,0,9\n1,9,0,1,9\n2,9,0,0,9\n", "are called t\\x07: which", 3},
        {"t,q\x1b[1,u,2\n0,a\x1b[b,0,9\n1,0,1,9\n", ":2: 'a\\x1b[b' in column q\\x1b[1 is", 3}};
    char out[2048];
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        int code = run_mechkit(out, sizeof out, "import %s --rig pendulum --force --out %s",
                               scratch_text("names.csv", rows[i].text), scratch("names_log.csv"));
        ck_assert_msg(code == rows[i].code && strstr(out, rows[i].says), "%zu: %d %s", i, code,
                      out);
        ck_assert_msg(!strpbrk(out, "\x1b\x07"), "%zu: %s", i, out);
    }
}
END_TEST

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define LITTLE_MEMORY "" /* sanitizers reserve terabytes, and say themselves what is too much */
#else
#define LITTLE_MEMORY "ulimit -v 4000000; "
#endif

/* A variable of a million million numbers in a file of 200 bytes; and one whose numbers are cut
 * off.
 */
START_TEST(a_mat_file_that_claims_what_it_does_not_hold_is_refused)
{
    uint8_t file[200] = "MATLAB 5.0 MAT-file";
    const uint32_t variable[] = {14, 64, 6, 8, 6, 0, 5, 8, 1000000, 1000000, 0x10001, 't', 9, 0};
    file[125] = 1;
    memcpy(file + 126, "IM", 2);
    memcpy(file + 128, variable, sizeof variable);
    for (int k = 0; k < 2; k++) {
        char out[4096];
        const char *path = scratch("claims.mat");
        FILE *f = fopen(path, "wb");
        ck_assert_ptr_nonnull(f);
        fwrite(file, 1, sizeof file, f);
        fclose(f);
        int code = run_command(out, sizeof out,
                               LITTLE_MEMORY MK_TEST_APP " import --rig pendulum --out %s %s",
                               scratch("claims.csv"), path);
        ck_assert_msg(code == 3 && strstr(out, "no vectors of numbers"), "%d: %s", code, out);
        const uint32_t smaller = 1;
        memcpy(file + 128 + 4 * 9, &smaller, 4);
    }
}
END_TEST

/* A struct whose field names would begin where the file ends. */
START_TEST(a_mat_file_without_names_of_fields_is_refused)
{
    char out[2048];
    uint8_t file[208] = "MATLAB 5.0 MAT-file";
    const uint32_t variable[] = {14,         480, 6, 8,        2, 0,       5, 8, 1,
                                 0x02010000, 1,   3, 0x6e7572, 0, 0x40005, 8, 1, 24};
    file[125] = 1;
    memcpy(file + 126, "IM", 2);
    memcpy(file + 128, variable, sizeof variable);
    const char *path = scratch("names.mat");
    FILE *f = fopen(path, "wb");
    ck_assert_ptr_nonnull(f);
    fwrite(file, 1, sizeof file, f);
    fclose(f);
    int code = run_mechkit(out, sizeof out, "import --rig pendulum --out %s %s",
                           scratch("names.csv"), path);
    ck_assert_msg(code == 3 && strstr(out, "no vectors of numbers"), "%d: %s", code, out);
}
END_TEST

/* libhdf5 dies of some of these files and prints pages about others: what import says is one line
 * that names the file, whatever is wrong in it. */
START_TEST(a_damaged_mat_file_of_version_73_is_read_or_refused_in_a_line)
{
    char out[4096];
    int refused = 0;
    const char *log = open_loop_log("pendulum", "0", 0.2);
    int code = run_mechkit(out, sizeof out, "export %s --columns t,q1,u --format v7.3 --out %s",
                           log, scratch("whole.mat"));
    ck_assert_msg(code == 0, "%s", out);
    static char whole[1 << 20];
    FILE *from = fopen(scratch("whole.mat"), "rb");
    ck_assert_ptr_nonnull(from);
    const size_t size = fread(whole, 1, sizeof whole, from);
    fclose(from);
    ck_assert_uint_gt(size, 9000);
    ck_assert_uint_lt(size, sizeof whole);
    const char *path = scratch("damaged.mat");
    for (size_t k = 0; k < 24; k++) {
        /* A wrong byte and a wrong word in turn, spread over 8 kB behind the header. */
        size_t at = 512 + k * 311 % 8000, bytes = k % 2 ? 8 : 1;
        char *copy = memcpy(malloc(size), whole, size);
        memset(copy + at, 0xff, bytes);
        FILE *f = fopen(path, "wb");
        ck_assert_ptr_nonnull(f);
        ck_assert_uint_eq(fwrite(copy, 1, size, f), size);
        fclose(f);
        free(copy);
        code = run_mechkit(out, sizeof out, "import --rig pendulum --force --out %s %s",
                           scratch("damaged.csv"), path);
        ck_assert_msg(code == 0 || code == 3, "byte %zu: %d: %s", at, code, out);
        ck_assert_msg(!strstr(out, "HDF5"), "byte %zu: %s", at, out);
        if (code == 3) {
            ck_assert_msg(strstr(out, "damaged.mat") && strchr(out, '\n') == strrchr(out, '\n'),
                          "byte %zu: %s", at, out);
            refused++;
        }
    }
    ck_assert_int_gt(refused, 3);
}
END_TEST

START_TEST(a_mat_file_of_our_own_comes_back)
{
    char out[2048];
    struct mk_log *was, *is;
    const char *log = open_loop_log("pendubot", "1.5*sin(6*t)", 0.5);
    for (int v = 0; v < 2; v++) {
        int code = run_mechkit(out, sizeof out,
                               "export %s --columns t:ms,q1:deg,q2,u --format %s "
                               "--out %s",
                               log, v ? "v7.3" : "v5", scratch("a.mat"));
        ck_assert_msg(code == 0, "%s", out);
        const char *map = scratch_text(
            "mat.map", "[rig]\nkind = pendubot\n[t]\ncolumn = mk.signals.t\nunit = ms\n"
                       "[q1]\ncolumn = Y2\nunit = deg\n[q2]\ncolumn = mk.signals.q2\n"
                       "[u]\ncolumn = mk.Y(:,4)\n");
        code = run_mechkit(out, sizeof out, "import %s --map %s --out %s --force", scratch("a.mat"),
                           map, scratch("back.csv"));
        ck_assert_int_eq(code, 3);
        ck_assert_msg(strstr(out, "there is no column 'Y2', from which the mapping takes q1"), "%s",
                      out);
        map = scratch_text("mat.map",
                           "[rig]\nkind = pendubot\n[t]\ncolumn = mk.signals.t\nunit = ms\n"
                           "[q1]\ncolumn = mk.Y(:,2)\nunit = deg\n"
                           "[q2]\ncolumn = mk.signals.q2\n[u]\ncolumn = mk.Y(:,4)\n");
        code = run_mechkit(out, sizeof out, "import %s --map %s --out %s --force", scratch("a.mat"),
                           map, scratch("back.csv"));
        ck_assert_msg(code == 0, "%s", out);
        ck_assert_int_eq(mk_log_read(log, &was, NULL), MK_OK);
        ck_assert_int_eq(mk_log_read(scratch("back.csv"), &is, NULL), MK_OK);
        for (size_t r = 0; r < was->rows; r++) {
            ck_assert_double_eq_tol(mk_log_get(is, "t")[r], mk_log_get(was, "t")[r], 1e-12);
            ck_assert_double_eq_tol(mk_log_get(is, "q1")[r], mk_log_get(was, "q1")[r], 1e-12);
            ck_assert_double_eq(mk_log_get(is, "u")[r], mk_log_get(was, "u")[r]);
        }
        mk_log_free(was);
        mk_log_free(is);
    }
}
END_TEST

START_TEST(of_several_runs_in_a_mat_file_the_mapping_says_which)
{
    char out[4096], first[512];
    struct mk_log *log;
    snprintf(first, sizeof first, "%s", scratch("first.csv"));
    run_command(NULL, 0, "cp %s %s", open_loop_log("pendubot", "1.5*sin(6*t)", 0.5), first);
    const char *second = open_loop_log("pendubot", "sin(6*t)", 0.8);
    int code =
        run_mechkit(out, sizeof out, "export %s %s --out %s", first, second, scratch("two.mat"));
    ck_assert_msg(code == 0, "%s", out);
    code = run_mechkit(out, sizeof out, "import %s --rig pendubot --force --out %s",
                       scratch("two.mat"), scratch("two.csv"));
    ck_assert_msg(code == 0 && strstr(out, "= mk(") && strstr(out, "left out: mk("), "%s", out);
    const char *map =
        scratch_text("two.map", "[rig]\nkind = pendubot\n[t]\ncolumn = mk(1).time\n[q1]\n"
                                "column = mk(1).signals.q1\n[q2]\ncolumn = mk(1).Y(:,3)\n"
                                "[u]\ncolumn = mk(1).signals.u\n");
    code = run_mechkit(out, sizeof out, "import %s --map %s --force --out %s", scratch("two.mat"),
                       map, scratch("two.csv"));
    ck_assert_msg(code == 0 && strstr(out, "250 rows"), "%s", out);
    ck_assert_int_eq(mk_log_read(scratch("two.csv"), &log, NULL), MK_OK);
    ck_assert_uint_eq(log->rows, 250);
    mk_log_free(log);
}
END_TEST

static void put_matrix(mat_t *mat, const char *name, size_t rows, size_t columns, double step)
{
    size_t dims[2] = {rows, columns};
    double *data = malloc(sizeof *data * rows * columns);
    for (size_t i = 0; i < rows * columns; i++)
        data[i] = step * (double)i;
    matvar_t *v = Mat_VarCreate(name, MAT_C_DOUBLE, MAT_T_DOUBLE, 2, dims, data, 0);
    ck_assert_int_eq(Mat_VarWrite(mat, v, MAT_COMPRESSION_NONE), 0);
    Mat_VarFree(v);
    free(data);
}

START_TEST(a_mat_file_with_lying_signals_and_a_picture_is_read)
{
    char out[4096];
    mat_t *mat = Mat_CreateVer(scratch("lying.mat"), NULL, MAT_FT_MAT5);
    ck_assert_ptr_nonnull(mat);
    put_matrix(mat, "picture", 300, 1200, 1.0);
    put_matrix(mat, "t", 1, 50, 0.01);
    put_matrix(mat, "Y", 2, 50, 0.01);
    put_matrix(mat, "u", 49, 1, 0.0);
    Mat_Close(mat);
    int code = run_mechkit(out, sizeof out, "import %s --rig pendubot --force --out %s",
                           scratch("lying.mat"), scratch("lying.csv"));
    ck_assert_msg(code == 3 && strstr(out, "there are: t, Y(1,:), Y(2,:); left out: "
                                           "picture (300 x 1200), u (49 values, not 50)"),
                  "%d %s", code, out);
    const char *map = scratch_text("lying.map", "[rig]\nkind = pendubot\n[t]\ncolumn = t\n"
                                                "[q1]\ncolumn = Y(1,:)\n[q2]\ncolumn = Y(2,:)\n"
                                                "[u]\ncolumn = t\n");
    code = run_mechkit(out, sizeof out, "import %s --map %s --force --out %s", scratch("lying.mat"),
                       map, scratch("lying.csv"));
    ck_assert_msg(code == 0, "%s", out);
    char *log = slurp_file(scratch("lying.csv"));
    ck_assert_msg(strstr(log, "t,q1,q2,u\n0,0,0.01,0\n0.01,0.02,0.03,0.01\n") != NULL, "%s", log);
    free(log);
}
END_TEST

/* The first thing that is left out, and already too long to say. */
START_TEST(a_name_that_fills_the_line_is_left_out_of_the_list)
{
    char out[4096], name[200];
    memset(name, 'n', sizeof name - 1);
    name[sizeof name - 1] = '\0';
    mat_t *mat = Mat_CreateVer(scratch("long.mat"), NULL, MAT_FT_MAT5);
    ck_assert_ptr_nonnull(mat);
    put_matrix(mat, name, 50, 1, 1.0);
    put_matrix(mat, "t", 1, 50, 0.01);
    put_matrix(mat, "u", 49, 1, 0.0);
    Mat_Close(mat);
    int code = run_mechkit(out, sizeof out, "import %s --rig pendubot --force --out %s",
                           scratch("long.mat"), scratch("long.csv"));
    ck_assert_msg(code == 3 && strstr(out, "there are: t; left out: ..., u (49 values, not 50)"),
                  "%d %s", code, out);
}
END_TEST

START_TEST(mistakes_in_a_mapping_are_told_with_their_line)
{
    static const struct {
        const char *text, *says;
    } bad[] = {
        {"[rig]\nkind = segway\n", ":2: [rig] kind: expected inertia-wheel"},
        {"[rig]\nkind = pendulum\n[t]\ncolumn = t\nunit = deg\n",
         ":5: [t] unit: deg is no unit of t"},
        {"[rig]\nkind = pendulum\n[t]\ncolumn = t\n[q1]\ncolumn = q\nsign = up\n",
         ":7: [q1] sign: expected"},
        {"[t]\ncolumn = t\nsign = nan\n", ":3: [t] sign: expected"},
        {"[t]\ncolumn = t\nsign = inf\n", ":3: [t] sign: expected"},
        {"[q1]\noffset = nan\n", ":2: [q1] offset: expected"},
        {"[q1]\noffset = -inf\n", ":2: [q1] offset: expected"},
        {"[rig]\nu_to_torque = inf\n", ":2: [rig] u_to_torque: expected"},
        {"[rig]\nencoder_cpr = 99999999999\n", ":2: [rig] encoder_cpr: expected"},
        {"[rig]\nencoder_cpr = 4000 0\n", ":2: [rig] encoder_cpr: expected"},
        {"[rig]\nencoder_cpr = 4000 many\n", ":2: [rig] encoder_cpr: expected"},
        {"[rig]\nencoder_cpr = 4000.5\n", ":2: [rig] encoder_cpr: expected"},
        {"[rig]\nencoder_cpr = 1 2 3\n", ":2: [rig] encoder_cpr: expected"},
        {"[rig]\nkind = pendulum\n[t]\nfrom = t\n", ":4: [t] from: unknown key"},
        {"[rig]\nkind = pendulum\n[t]\ncolumn = t\n[q1]\ncolumn = q\n",
         "[u] (or [tau]) is missing"},
        {"[rig]\nkind = pendubot\n[t]\ncolumn = t\n[q1]\ncolumn = q\n", "[q2] is missing"},
        {"[t]\ncolumn = t\n", "[rig] kind is missing"},
        {"[rig]\nkind = pendulum\n[q3]\n[t]\ncolumn = t\n", ":3: [q3] column is missing"},
        {"\xef\xbb\xbf[q3]\n[rig]\nkind = pendulum\n", ":1: [q3] column is missing"},
        {"[rig]\nkind = pendulum\n[u]\n", ":3: [u] column is missing"},
        {"[a name that is longer than any column of a log]\n", ":1: too long a name"},
        {"[source]\nseparator = dash\n", ":2: [source] separator"},
        {"kind\n", ":1: expected"},
        {"kind = pendulum\n", ":1: [] kind: a key before the first [section]"},
        {"[rig]\nkind = pendulum\nkind = pendubot\n",
         ":3: key 'kind' is there twice in [rig]; the first is in line 2"},
        {"[t]\ncolumn = a name that is longer than any column of a measured log has, by far\n",
         ":2: [t] column: too long a name"},
        {"[t]\ncolumn =;t\n", ":2: [t] column: a value cannot begin with ;"},
        {"[t]\ncolumn = t\fs\n", ":2: [t] column: there is a control character"},
        {"[t]\ncolumn = t\n  sgn = -1\n", ":3: [t] sgn: unknown key"},
        {"[t]\ncolumn = t\n\f= q ;= 1\n", ":3: [t] : unknown key"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        char out[1024];
        int code = run_mechkit(out, sizeof out, "import %s --map %s --json -",
                               scratch_text("x.csv", "t,q,u\n0,0,0\n1,1,1\n"),
                               scratch_text("bad.map", bad[i].text));
        ck_assert_msg(code == 3 && strstr(out, bad[i].says), "%s: %d %s", bad[i].text, code, out);
    }
}
END_TEST

START_TEST(a_mapping_reads_back_as_it_was_written)
{
    struct mk_import_map map, again;
    ck_assert_int_eq(mk_import_map_read(MAPS "pendulum-dfki.map", &map, NULL), MK_OK);
    map.separator = ';', map.decimal = ',';
    map.column[1].sign = -0.1;
    ck_assert_int_eq(mk_import_map_write(scratch("copy.map"), &map, "two\nlines", NULL), MK_OK);
    ck_assert_int_eq(mk_import_map_read(scratch("copy.map"), &again, NULL), MK_OK);
    ck_assert_int_eq(memcmp(&map, &again, sizeof map), 0);
}
END_TEST

/* Blanks before a key make it no part of the value above; a comment may be of any length. */
START_TEST(an_indented_mapping_reads_as_a_plain_one)
{
    struct mk_import_map plain, indented;
    struct mk_error err = MK_ERROR_INIT;
    char text[1024] = "# ";
    memset(text + 2, 'x', 500);
    strcpy(text + 502, "\n  [rig]\n\tkind = pendulum\n[t]\n  column = t ; seconds\n [q1]\n"
                       " \t column = q\n    sign = -1\n[u]\n    column = u #1");
    ck_assert_int_eq(
        mk_import_map_read(scratch_text("plain.map", "[rig]\nkind = pendulum\n[t]\ncolumn = t\n"
                                                     "[q1]\ncolumn = q\nsign = -1\n[u]\n"
                                                     "column = u #1\n"),
                           &plain, &err),
        MK_OK);
    ck_assert_str_eq(mk_import_map_find(&plain, "u")->from, "u #1");
    ck_assert_msg(mk_import_map_read(scratch_text("in.map", text), &indented, &err) == MK_OK, "%s",
                  err.message);
    ck_assert_int_eq(memcmp(&plain, &indented, sizeof plain), 0);
}
END_TEST

START_TEST(a_part_of_a_line_is_not_taken_for_a_line_of_a_mapping)
{
    struct mk_import_map map;
    struct mk_error err = MK_ERROR_INIT;
    char text[300] = "[t]\ncolumn = t\nunit = ";
    size_t start = strlen(text);
    memset(text + start, ' ', 190);
    strcpy(text + start + 190, "sign = -1\n");
    ck_assert_int_eq(mk_import_map_read(scratch_text("long.map", text), &map, &err), MK_ERR_PARSE);
    ck_assert_int_eq(err.line, 3);
    ck_assert_msg(strstr(err.message, "too long") != NULL, "%s", err.message);
    static const char zero[] = "[t]\ncolumn = t\0s\n";
    FILE *f = fopen(scratch("zero.map"), "w");
    ck_assert_uint_eq(fwrite(zero, 1, sizeof zero - 1, f), sizeof zero - 1);
    ck_assert_int_eq(fclose(f), 0);
    ck_assert_int_eq(mk_import_map_read(scratch("zero.map"), &map, &err), MK_ERR_PARSE);
    ck_assert_int_eq(err.line, 2);
    ck_assert_msg(strstr(err.message, "zero byte") != NULL, "%s", err.message);
}
END_TEST

START_TEST(an_angle_may_be_the_difference_or_sum_of_columns)
{
    char out[2048];
    const char *map =
        scratch_text("sum.map", "[rig]\nkind = pendubot\n[t]\ncolumn = t\n[q1]\n"
                                "column = a\n[q2]\ncolumn = b\nminus = a\nunit = deg\n"
                                "sign = -1\noffset = 1\n[u]\ncolumn = a\nplus = b\n");
    const char *file = scratch_text("sum.csv", "t,a,b\n0,1,91\n0.1,2,182\n0.2,3,273\n");
    const char *to = scratch("sum_log.csv"), *copy = scratch("sum_copy.map");
    int code = run_mechkit(out, sizeof out, "import %s --map %s --out %s --write-map %s --force",
                           file, map, to, copy);
    ck_assert_msg(code == 0 && strstr(out, "-(b - a) [deg] + 1"), "%d %s", code, out);
    struct mk_log *log;
    ck_assert_int_eq(mk_log_read(to, &log, NULL), MK_OK);
    for (int k = 0; k < 3; k++) {
        ck_assert_double_eq_tol(mk_log_get(log, "q2")[k], 1.0 - 0.5 * M_PI * (k + 1), 1e-12);
        ck_assert_double_eq_tol(mk_log_get(log, "u")[k], 92.0 * (k + 1), 1e-12);
    }
    mk_log_free(log);
    struct mk_import_map back;
    ck_assert_int_eq(mk_import_map_read(copy, &back, NULL), MK_OK);
    ck_assert_str_eq(mk_import_map_find(&back, "q2")->minus, "a");
    ck_assert_str_eq(mk_import_map_find(&back, "u")->plus, "b");
    map = scratch_text("sum.map", "[rig]\nkind = pendulum\ninput = none\n[t]\ncolumn = t\n[q1]\n"
                                  "column = a\nminus = c\n");
    code = run_mechkit(out, sizeof out, "import %s --map %s --out %s", file, map, to);
    ck_assert_msg(code == 3 &&
                      strstr(out, "there is no column 'c', from which the mapping takes q1"),
                  "%d %s", code, out);
}
END_TEST

/* Models of rigs that others measured, and how their logs are read, lie beside each other. */
START_TEST(every_mapping_and_model_of_a_measured_rig_is_read)
{
    glob_t files;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(glob(MK_SOURCE_DIR "/models/measured/*.map", 0, NULL, &files), 0);
    for (size_t i = 0; i < files.gl_pathc; i++) {
        struct mk_import_map map;
        ck_assert_msg(mk_import_map_read(files.gl_pathv[i], &map, &err) == MK_OK, "%s",
                      err.message);
    }
    globfree(&files);
    ck_assert_int_eq(glob(MK_SOURCE_DIR "/models/measured/*.ini", 0, NULL, &files), 0);
    for (size_t i = 0; i < files.gl_pathc; i++) {
        struct mk_model model;
        ck_assert_msg(mk_model_read(files.gl_pathv[i], &model, &err) == MK_OK, "%s", err.message);
    }
    globfree(&files);
}
END_TEST

Suite *suite_import(void)
{
    Suite *s = suite_create("import");
    TCase *c = tcase_create("files");
    tcase_set_timeout(c, 60);
    tcase_add_test(c, files_are_read_as_their_writers_wrote_them);
    tcase_add_test(c, every_mapping_and_model_of_a_measured_rig_is_read);
    tcase_add_test(c, a_file_without_names_goes_by_numbers_of_columns);
    tcase_add_test(c, text_where_a_number_should_be_is_told_with_its_line);
    tcase_add_test(c, of_two_columns_of_one_name_the_mapping_says_which);
    tcase_add_test(c, a_column_is_found_without_the_unit_in_its_header);
    tcase_add_test(c, an_infinite_value_is_refused);
    tcase_add_test(c, a_mapping_takes_counts_of_an_encoder);
    tcase_add_test(c, a_mapping_without_a_unit_takes_that_of_the_header);
    tcase_add_test(c, a_name_that_no_mapping_can_have_goes_by_its_number);
    tcase_add_test(c, control_characters_in_names_of_columns_are_shown);
    tcase_add_test(c, a_damaged_mat_file_of_version_73_is_read_or_refused_in_a_line);
    tcase_add_test(c, a_mat_file_that_claims_what_it_does_not_hold_is_refused);
    tcase_add_test(c, a_mat_file_without_names_of_fields_is_refused);
    tcase_add_test(c, a_mat_file_of_our_own_comes_back);
    tcase_add_test(c, of_several_runs_in_a_mat_file_the_mapping_says_which);
    tcase_add_test(c, a_mat_file_with_lying_signals_and_a_picture_is_read);
    tcase_add_test(c, a_name_that_fills_the_line_is_left_out_of_the_list);
    tcase_add_test(c, mistakes_in_a_mapping_are_told_with_their_line);
    tcase_add_test(c, a_mapping_reads_back_as_it_was_written);
    tcase_add_test(c, an_indented_mapping_reads_as_a_plain_one);
    tcase_add_test(c, a_part_of_a_line_is_not_taken_for_a_line_of_a_mapping);
    tcase_add_test(c, an_angle_may_be_the_difference_or_sum_of_columns);
    suite_add_tcase(s, c);
    return s;
}
