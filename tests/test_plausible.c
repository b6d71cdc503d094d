/* Whether an imported log can be true: wrong mappings are found out, right ones are not. */
#include "suites.h"

#include <glob.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "mechkit/exchange.h"
#include "support/files.h"
#include "support/program.h"
#include "support/spawn.h"

#define MAPS MK_SOURCE_DIR "/models/measured/"

struct mistake {
    const char *name;
    void (*make)(struct mk_import_map *map);
};

static struct mk_import_column *at(struct mk_import_map *map, const char *to)
{
    struct mk_import_column *c = mk_import_map_find(map, to);
    ck_assert_msg(c != NULL, "no [%s]", to);
    return c;
}

static struct mk_import_column *command(struct mk_import_map *map)
{
    static const char *const names[] = {"u", "tau", "tau1"};
    for (int i = 0; i < 3; i++)
        if (mk_import_map_find(map, names[i]))
            return at(map, names[i]);
    ck_abort_msg("no command");
}

static void turn_q1(struct mk_import_map *m)
{
    at(m, "q1")->sign = -1.0;
}
static void turn_q2(struct mk_import_map *m)
{
    at(m, "q2")->sign = -1.0;
}
static void turn_command(struct mk_import_map *m)
{
    command(m)->sign = -1.0;
}
static void take_degrees(struct mk_import_map *m)
{
    strcpy(at(m, "q1")->unit, "deg");
    if (mk_import_map_find(m, "q2"))
        strcpy(at(m, "q2")->unit, "deg");
}
static void take_degrees_of_q2(struct mk_import_map *m)
{
    strcpy(at(m, "q2")->unit, "deg");
}
static void take_milliseconds(struct mk_import_map *m)
{
    strcpy(at(m, "t")->unit, "ms");
}
static void take_microseconds(struct mk_import_map *m)
{
    strcpy(at(m, "t")->unit, "us");
}
static void swap_joints(struct mk_import_map *m)
{
    char keep[64];
    strcpy(keep, at(m, "q1")->from);
    strcpy(at(m, "q1")->from, at(m, "q2")->from);
    strcpy(at(m, "q2")->from, keep);
}
static void swap_command(struct mk_import_map *m)
{
    char keep[64];
    strcpy(keep, at(m, "q1")->from);
    strcpy(at(m, "q1")->from, command(m)->from);
    strcpy(command(m)->from, keep);
}
static void shift_q1(struct mk_import_map *m)
{
    at(m, "q1")->offset += M_PI / 2;
}

static const struct mistake mistakes[] = {
    {"q1 turned", turn_q1},
    {"command turned", turn_command},
    {"degrees", take_degrees},
    {"milliseconds", take_milliseconds},
    {"microseconds", take_microseconds},
    {"q1 and command swapped", swap_command},
    {"q1 from elsewhere", shift_q1},
    {"q2 turned", turn_q2}, /* from here on of rigs with two joints */
    {"q2 in degrees", take_degrees_of_q2},
    {"joints swapped", swap_joints},
};
#define MISTAKES (sizeof mistakes / sizeof mistakes[0])
#define FIRST_OF_TWO 7

static bool same_unit(const char *a, const char *b, const char *native)
{
    return strcmp(*a ? a : native, *b ? b : native) == 0;
}

/* Whether two maps say the same about the columns of the motion. */
static bool same_motion(struct mk_import_map *a, struct mk_import_map *b)
{
    static const char *const names[] = {"t", "q1", "q2", "u", "tau", "tau1"};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        struct mk_import_column *x = mk_import_map_find(a, names[i]);
        struct mk_import_column *y = mk_import_map_find(b, names[i]);
        if (!x)
            continue;
        double turns = (x->offset - y->offset) / (2 * M_PI);
        if (strcmp(x->from, y->from) != 0 || x->sign != y->sign ||
            !same_unit(x->unit, y->unit, names[i][0] == 't' && !names[i][1] ? "s" : "rad") ||
            fabs(turns - round(turns)) > 1e-9)
            return false;
    }
    return true;
}

/* Makes each mistake and wants it found, and the right map proposed. */
static void check_mistakes(const char *path, const char *map_path)
{
    struct mk_import_map right;
    struct mk_table *table;
    struct mk_error err = MK_ERROR_INIT;
    struct mk_import_finding f[MK_IMPORT_FINDINGS];
    ck_assert_msg(mk_import_map_read(map_path, &right, &err) == MK_OK, "%s", err.message);
    ck_assert_msg(mk_import_open(path, &right, &table, &err) == MK_OK, "%s", err.message);
    int found = mk_import_check(table, path, &right, f);
    ck_assert_msg(found == 0, "%s: %s: %s", path, f[0].what, f[0].proposal);
    size_t count = mk_import_map_find(&right, "q2") ? MISTAKES : FIRST_OF_TWO;
    for (size_t i = 0; i < count; i++) {
        struct mk_import_map wrong = right;
        if (mistakes[i].make == shift_q1 && right.rig == MK_PLANT_FURUTA)
            continue; /* where the arm's zero is makes no difference */
        mistakes[i].make(&wrong);
        found = mk_import_check(table, path, &wrong, f);
        ck_assert_msg(found > 0, "%s: %s: nothing was found", path, mistakes[i].name);
        ck_assert_msg(same_motion(&f[found - 1].fixed, &right), "%s: %s: %s, proposed %s", path,
                      mistakes[i].name, f[0].what, f[0].proposal);
    }
    mk_table_free(table);
}

START_TEST(ten_wrong_mappings_of_a_rig_are_found_and_put_right)
{
    static const char *const rigs[] = {"pendubot", "furuta", "pendulum"};
    const char *map =
        scratch_text("own.map", _i == 2 ? "[rig]\nkind = pendulum\n[t]\ncolumn = t\n[q1]\ncolumn = "
                                          "q1\n[dq1]\ncolumn = dq1\n[u]\ncolumn = u\n"
                                        : "[rig]\nkind = pendubot\n[t]\ncolumn = t\n[q1]\ncolumn = "
                                          "q1\n[q2]\ncolumn = q2\n[u]\ncolumn = u\n");
    if (_i == 1)
        map = scratch_text("own.map", "[rig]\nkind = furuta\n[t]\ncolumn = t\n[q1]\ncolumn = q1\n"
                                      "[q2]\ncolumn = q2\n[dq1]\ncolumn = dq1\n[u]\ncolumn = u\n");
    check_mistakes(open_loop_log(rigs[_i], "4*sin(5*t)+2*sin(13*t)", 8.0), map);
}
END_TEST

START_TEST(measured_files_import_with_their_mappings)
{
    static const char *const sets[][2] = {{"double-pendulum-dfki-a0", "double-pendulum-dfki.map"},
                                          {"pendubot-dfki-c1-sysid", "double-pendulum-dfki.map"},
                                          {"pendubot-dfki-c1-swingup", "double-pendulum-dfki.map"},
                                          {"furuta-qube-servo1", "furuta-qube-servo1.map"},
                                          {"single-pendulum-dfki", "pendulum-dfki.map"}};
    char pattern[1100], out[4096];
    const char *data = shared_path("data");
    if (!data) {
        fprintf(stderr, "measured_files_import_with_their_mappings: skipped, no ../shared/data\n");
        return;
    }
    snprintf(pattern, sizeof pattern, "%s/%s/*.csv", data, sets[_i][0]);
    glob_t found;
    ck_assert_int_eq(glob(pattern, 0, NULL, &found), 0);
    for (size_t k = 0; k < found.gl_pathc; k++) {
        int code = run_mechkit(out, sizeof out, "import %s --map " MAPS "%s --out %s",
                               found.gl_pathv[k], sets[_i][1], scratch("log.csv"));
        ck_assert_msg(code == 0, "%s", out);
    }
    globfree(&found);
}
END_TEST

START_TEST(ten_wrong_mappings_of_a_measured_file_are_found_and_put_right)
{
    static const char *const files[][2] = {
        {"data/pendubot-dfki-c1-sysid/run_143601.csv", MAPS "double-pendulum-dfki.map"},
        {"data/pendubot-dfki-c1-swingup/tvlqr_04.csv", MAPS "double-pendulum-dfki.map"},
        {"data/double-pendulum-dfki-a0/sysid_00.csv", MAPS "double-pendulum-dfki.map"},
        {"data/double-pendulum-dfki-a0/sysid_11.csv", MAPS "double-pendulum-dfki.map"},
        {"data/single-pendulum-dfki/direct_collocation.csv", MAPS "pendulum-dfki.map"},
        {"data/single-pendulum-dfki/energy_shaping.csv", MAPS "pendulum-dfki.map"},
        {"data/furuta-qube-servo1/ep_150615.csv", MAPS "furuta-qube-servo1.map"},
        {"data/furuta-qube-servo1/ep_163955.csv", MAPS "furuta-qube-servo1.map"}};
    const char *path = shared_path(files[_i][0]);
    if (!path) {
        fprintf(stderr, "wrong mappings of a measured file: skipped, no ../shared/data\n");
        return;
    }
    char keep[1024];
    snprintf(keep, sizeof keep, "%s", path);
    check_mistakes(keep, files[_i][1]);
}
END_TEST

/* Rows [first, last) of a log in a file of its own, with the columns of its motion. */
static const char *piece_of(const char *path, double from, double to)
{
    static char piece[512];
    static const char *const names[] = {"t", "q1", "q2", "u"};
    struct mk_log *log, *part;
    ck_assert_int_eq(mk_log_read(path, &log, NULL), MK_OK);
    size_t first = (size_t)(from * (double)log->rows), last = (size_t)(to * (double)log->rows);
    ck_assert_int_eq(mk_log_create(last - first, &part), MK_OK);
    for (size_t i = 0; i < 4; i++) {
        double *data = mk_log_add_column(part, names[i]);
        memcpy(data, mk_log_get(log, names[i]) + first, (last - first) * sizeof *data);
    }
    snprintf(piece, sizeof piece, "%s", scratch("piece.csv"));
    ck_assert_int_eq(mk_log_write(piece, part, NULL), MK_OK);
    mk_log_free(log);
    mk_log_free(part);
    return piece;
}

/* Balanced upright against dry friction, it moves little and says little: no reason to refuse it,
 * and none to propose anything. */
START_TEST(a_piece_of_a_good_log_that_says_little_is_written)
{
    char out[4096], model[2048], log[512];
    char *furuta = slurp_file(MK_SOURCE_DIR "/models/furuta.ini");
    snprintf(model, sizeof model, "%s\n[effect.stribeck]\njoint = 1\nlevel = 0.4\nvelocity = 0.3\n",
             furuta);
    free(furuta);
    char path[512], script[1024];
    snprintf(path, sizeof path, "%s", scratch_text("rubs.ini", model));
    snprintf(script, sizeof script,
             "model %s\nsetup furuta\nstart\nwait 20\nhalt\nsave rubs.csv\nquit\n", path);
    const char *cmd = scratch_text("rubs.cmd", script);
    int code = run_mechkit(out, sizeof out, "run %s --fast --quiet --out %s", cmd, scratch("."));
    ck_assert_msg(code == 0, "%s", out);
    snprintf(log, sizeof log, "%s", scratch("rubs.csv"));
    code = run_mechkit(out, sizeof out, "import %s --rig furuta --out %s",
                       piece_of(log, 1.0 / 3.0, 2.0 / 3.0), scratch("piece_log.csv"));
    ck_assert_msg(code == 0 && !strstr(out, "mapping: "), "%d %s", code, out);
}
END_TEST

/* Thirds of runs of double pendulums, of which many say little. */
START_TEST(pieces_of_measured_files_import_with_their_mappings)
{
    static const char *const files[] = {
        "double-pendulum-dfki-a0/swingup_balance_174435", "double-pendulum-dfki-a0/sysid_12",
        "pendubot-dfki-c1-sysid/run_143704", "pendubot-dfki-c1-swingup/tvlqr_02",
        "pendubot-dfki-c1-swingup/tvlqr_05"};
    char path[512], out[4096];
    snprintf(path, sizeof path, "data/%s.csv", files[_i]);
    const char *found = shared_path(path);
    if (!found) {
        fprintf(stderr, "pieces of measured files: skipped, no ../shared/data\n");
        return;
    }
    struct mk_import_map map;
    struct mk_table *table;
    struct mk_import_finding f[MK_IMPORT_FINDINGS];
    ck_assert_int_eq(mk_import_map_read(MAPS "double-pendulum-dfki.map", &map, NULL), MK_OK);
    snprintf(out, sizeof out, "%s", found);
    ck_assert_int_eq(mk_import_open(out, &map, &table, NULL), MK_OK);
    const size_t rows = table->rows / 3;
    for (size_t k = 0; k < 3; k++) {
        table->rows = rows;
        int count = mk_import_check(table, out, &map, f);
        for (int i = 0; i < count; i++)
            ck_assert_msg(!f[i].certain, "%s, third %zu: %s", files[_i], k + 1, f[i].what);
        for (size_t c = 0; c < table->count; c++) /* those behind come to the front */
            memmove(table->column[c].data, table->column[c].data + rows,
                    (2 - k) * rows * sizeof(double));
    }
    mk_table_free(table);
}
END_TEST

/* Speeds need no model of the rig: they are the slopes of their angles, or something is wrong. */
START_TEST(speeds_that_are_no_slopes_of_their_angles_are_found)
{
    static const struct {
        const char *dq1, *proposal; /* NULL: nothing is wrong */
    } cases[] = {{"dq1", NULL},
                 {"dq2", "[dq1] column = dq1, [dq2] column = dq2"},
                 {"dq1\nunit = deg/s", "[dq1] unit = rad/s"},
                 {"dq1\nunit = rpm", "[dq1] unit = rad/s"},
                 {"dq1\nsign = -1", "[dq1] sign = 1"}};
    const char *log = open_loop_log("pendubot", "4*sin(5*t)+2*sin(13*t)", 8.0);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char out[2048], map[512];
        snprintf(map, sizeof map,
                 "[rig]\nkind = pendubot\n[t]\ncolumn = t\n[q1]\ncolumn = q1\n[q2]\ncolumn = q2\n"
                 "[u]\ncolumn = u\n[dq1]\ncolumn = %s\n[dq2]\ncolumn = %s\n",
                 cases[i].dq1, i == 1 ? "dq1" : "dq2");
        int code = run_mechkit(out, sizeof out, "import %s --map %s --out %s", log,
                               scratch_text("speeds.map", map), scratch("speeds.csv"));
        if (cases[i].proposal)
            ck_assert_msg(code == 1 && strstr(out, cases[i].proposal), "%zu: %d %s", i, code, out);
        else
            ck_assert_msg(code == 0, "%d %s", code, out);
    }
}
END_TEST

START_TEST(a_wheel_that_turns_evenly_is_no_encoder_of_few_counts)
{
    char out[4096];
    const char *cmd = scratch_text("even.cmd", "setup pi-speed\nref 100\nstart\nwait 8\nhalt\n"
                                               "save even.csv\nquit\n");
    int code = run_mechkit(out, sizeof out, "run %s --fast --out %s", cmd, scratch("."));
    ck_assert_msg(code == 0, "%s", out);
    char log[512];
    snprintf(log, sizeof log, "%s", scratch("even.csv"));
    code = run_mechkit(out, sizeof out, "import %s --rig inertia-wheel --out %s", log,
                       scratch("even_log.csv"));
    ck_assert_msg(code == 0, "%s", out);
}
END_TEST

START_TEST(numbers_that_no_rig_makes_are_not_taken_for_a_log)
{
    char out[2048];
    const char *path = scratch_text("huge.csv", "t,q1,q2,u\n0,1,2,0\n0.1,-1e300,2,0\n0.2,1,2,0\n");
    const char *to = scratch("huge_log.csv");
    int code = run_mechkit(out, sizeof out, "import %s --rig pendubot --out %s", path, to);
    ck_assert_msg(code == 1 && strstr(out, "q1 reaches 1e+300 rad"), "%d %s", code, out);
    ck_assert_int_ne(access(to, F_OK), 0);
    code = run_mechkit(out, sizeof out, "import %s --rig pendubot --out %s", scratch("."), to);
    ck_assert_msg(code == 3 && strstr(out, "Is a directory"), "%d %s", code, out);
    run_command(NULL, 0, "mkdir %s", scratch("folder.mat"));
    code = run_mechkit(out, sizeof out, "import %s --rig pendubot --out %s", scratch("folder.mat"),
                       to);
    ck_assert_msg(code == 3 && strstr(out, "Is a directory"), "%d %s", code, out);
}
END_TEST

START_TEST(what_cannot_be_is_not_written_unless_forced)
{
    char out[4096];
    const char *log = open_loop_log("pendubot", "4*sin(5*t)+2*sin(13*t)", 8.0);
    const char *map = scratch_text("wrong.map", "[rig]\nkind = pendubot\n[t]\ncolumn = t\n[q1]\n"
                                                "column = q1\n[q2]\ncolumn = q2\n[u]\ncolumn = u\n"
                                                "sign = -1\n");
    const char *to = scratch("never.csv"), *mended = scratch("mended.map");
    int code = run_mechkit(out, sizeof out, "import %s --map %s --out %s --write-map %s", log, map,
                           to, mended);
    ck_assert_msg(code == 1 && strstr(out, "fatal: ") &&
                      strstr(out, "change the mapping: [u] sign = 1"),
                  "%d %s", code, out);
    ck_assert_int_ne(access(to, F_OK), 0);
    struct outcome o = MECHKIT("import", log, "--map", map, "--out", to);
    ck_assert_msg(o.code == 1 && strstr(o.err, "mechkit: fatal: ") && strstr(o.err, "  to do: ") &&
                      strstr(o.err, "never.csv: not written: mend the map, or use --force\n"),
                  "%d %s", o.code, o.err);
    ck_assert_msg(strstr(o.out, " rows, taken for those of"), "%s", o.out);
    ck_assert_ptr_null(strstr(o.out, "fatal"));
    o = MECHKIT("import", log, "--map", map, "--json", "-");
    ck_assert_msg(o.code == 1 && o.out[0] == '{' && strstr(o.err, "fatal: "), "%s%s", o.out, o.err);
    code = run_mechkit(out, sizeof out, "import %s --map %s --out %s", log, mended, to);
    ck_assert_msg(code == 0 && access(to, F_OK) == 0, "%s", out);
    code = run_mechkit(out, sizeof out, "import %s --map %s --out %s --force", log, map, to);
    ck_assert_msg(code == 0 && strstr(out, "fatal: "), "%s", out);
}
END_TEST

/* Angles of two pendulums from the upward vertical, the first alone in "a", both in "a" and "b". */
static const char *free_swing(const char *name)
{
    static char text[200000];
    size_t used = (size_t)snprintf(text, sizeof text, "t,a,b\n");
    double a = M_PI + 1.2, b = M_PI - 0.4, va = 0.0, vb = 0.0;
    for (int k = 0; k < 3000; k++) {
        used +=
            (size_t)snprintf(text + used, sizeof text - used, "%.3f,%.9f,%.9f\n", 0.002 * k, a, b);
        for (int i = 0; i < 20; i++) {
            va += 1e-4 * (64.0 * sin(a) - 0.07 * va);
            vb += 1e-4 * (30.0 * sin(b) - 0.05 * vb);
            a += 1e-4 * va;
            b += 1e-4 * vb;
        }
    }
    return scratch_text(name, text);
}

START_TEST(a_log_of_a_rig_that_nothing_drives_says_so)
{
    char out[2048];
    struct mk_log *log;
    const char *file = free_swing("swing.csv"), *to = scratch("swing_log.csv");
    const char *map = scratch_text("swing.map", "[rig]\nkind = pendulum\ninput = none\n[t]\n"
                                                "column = t\n[q1]\ncolumn = a\n"
                                                "offset = -3.141592653589793\n");
    int code = run_mechkit(out, sizeof out, "import %s --map %s --out %s", file, map, to);
    ck_assert_msg(code == 0 && strstr(out, "nothing drove the rig"), "%d %s", code, out);
    ck_assert_int_eq(mk_log_read(to, &log, NULL), MK_OK);
    ck_assert_str_eq(mk_log_find_meta(log, "input"), "none");
    ck_assert_ptr_null(mk_log_get(log, "u"));
    mk_log_free(log);
    code = run_mechkit(out, sizeof out, "import %s --rig pendulum --out %s", file, to);
    ck_assert_int_eq(code, 3);
    map = scratch_text("swing.map", "[rig]\nkind = pendulum\n[t]\ncolumn = t\n[q1]\ncolumn = a\n");
    code = run_mechkit(out, sizeof out, "import %s --map %s --out %s", file, map, to);
    ck_assert_msg(code == 3 && strstr(out, "input = none"), "%d %s", code, out);
    map = scratch_text("swing.map", "[rig]\nkind = pendulum\ninput = none\n[t]\ncolumn = t\n[q1]\n"
                                    "column = a\n[u]\ncolumn = b\n");
    code = run_mechkit(out, sizeof out, "import %s --map %s --out %s", file, map, to);
    ck_assert_msg(code == 3 && strstr(out, "one of the two is wrong"), "%d %s", code, out);
}
END_TEST

START_TEST(without_a_command_gravity_still_tells_a_wrong_zero)
{
    char out[2048];
    const char *map = scratch_text("up.map", "[rig]\nkind = pendulum\ninput = none\n[t]\n"
                                             "column = t\n[q1]\ncolumn = a\n");
    int code = run_mechkit(out, sizeof out, "import %s --map %s --out %s", free_swing("up.csv"),
                           map, scratch("up_log.csv"));
    ck_assert_msg(code == 1 && strstr(out, "q1 is counted from elsewhere") &&
                      strstr(out, "[q1] offset = 3.14159"),
                  "%d %s", code, out);
}
END_TEST

Suite *suite_plausible(void)
{
    Suite *s = suite_create("plausible");
    TCase *c = tcase_create("plausibility");
    tcase_set_timeout(c, 240);
    tcase_add_loop_test(c, ten_wrong_mappings_of_a_rig_are_found_and_put_right, 2, 3);
    tcase_add_loop_test(c, measured_files_import_with_their_mappings, 3, 5);
    tcase_add_loop_test(c, ten_wrong_mappings_of_a_measured_file_are_found_and_put_right, 4, 6);
    tcase_add_test(c, a_piece_of_a_good_log_that_says_little_is_written);
    tcase_add_loop_test(c, pieces_of_measured_files_import_with_their_mappings, 0, 5);
    tcase_add_test(c, speeds_that_are_no_slopes_of_their_angles_are_found);
    tcase_add_test(c, a_wheel_that_turns_evenly_is_no_encoder_of_few_counts);
    tcase_add_test(c, numbers_that_no_rig_makes_are_not_taken_for_a_log);
    tcase_add_test(c, what_cannot_be_is_not_written_unless_forced);
    tcase_add_test(c, a_log_of_a_rig_that_nothing_drives_says_so);
    tcase_add_test(c, without_a_command_gravity_still_tells_a_wrong_zero);
    suite_add_tcase(s, c);
    c = tcase_create("more wrong mappings");
    tcase_set_timeout(c, 240);
    tcase_set_tags(c, "long");
    tcase_add_loop_test(c, measured_files_import_with_their_mappings, 0, 3);
    tcase_add_loop_test(c, ten_wrong_mappings_of_a_rig_are_found_and_put_right, 0, 2);
    tcase_add_loop_test(c, ten_wrong_mappings_of_a_measured_file_are_found_and_put_right, 0, 4);
    tcase_add_loop_test(c, ten_wrong_mappings_of_a_measured_file_are_found_and_put_right, 6, 8);
    suite_add_tcase(s, c);
    return s;
}
