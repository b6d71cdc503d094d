/* Logs for other programs: what a MATLAB user finds in a file, columns and units, and the functions
 * of tools/matlab_export run by Octave. */
#include "suites.h"

#include <math.h>
#include <matio.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "mechkit/exchange.h"
#include "support/files.h"
#include "support/program.h"

static const char *const small =
    "# mechkit-log: 1\n# rig: pendubot\n# u_to_torque: 0.005\n# gains: 48.2 5.25 62.4 7.86\n"
    "# parameters: kp=150 kd=21\n# sample_rate_hz: 500\n"
    "t,q1,q2,u,note\n0,-1.5,0.25,2,a\n0.002,-1.25,,4,b\n0.004,-1,0.5,-10,c\n";

static void close_to(double got, double want)
{
    ck_assert_double_eq_tol(got, want, 1e-12 * fmax(1.0, fabs(want)));
}

/* --- MAT --------------------------------------------------------------------------------- */

static matvar_t *field(matvar_t *owner, const char *name, size_t index)
{
    matvar_t *v = Mat_VarGetStructFieldByName(owner, name, index);
    ck_assert_msg(v != NULL, "no field %s", name);
    return v;
}

static double number_at(matvar_t *v, size_t index)
{
    ck_assert_int_eq(v->class_type, MAT_C_DOUBLE);
    return ((double *)v->data)[index];
}

static void ck_text(const matvar_t *v, const char *want)
{
    ck_assert_int_eq(v->class_type, MAT_C_CHAR);
    ck_assert_uint_eq(v->dims[0] * v->dims[1], strlen(want));
    /* One or two bytes a character, as the version has it. */
    for (size_t i = 0; want[i]; i++)
        ck_assert_int_eq(v->data_size == 1 ? ((const char *)v->data)[i]
                                           : ((const unsigned short *)v->data)[i],
                         want[i]);
}

static void check_mat(const char *path, enum mat_ft version)
{
    mat_t *mat = Mat_Open(path, MAT_ACC_RDONLY);
    ck_assert_ptr_nonnull(mat);
    ck_assert_int_eq(Mat_GetVersion(mat), version);
    matvar_t *mk = Mat_VarRead(mat, "mk");
    ck_assert_ptr_nonnull(mk);
    ck_assert_uint_eq(mk->dims[1], 2);
    for (size_t run = 0; run < 2; run++) {
        matvar_t *signals = field(mk, "signals", run), *model = field(mk, "model", run);
        ck_text(field(mk, "rig", run), "pendubot");
        ck_text(field(field(mk, "units", run), "q1", 0), "rad");
        ck_text(field(field(mk, "metadata", run), "sample_rate_hz", 0), "500");
        close_to(number_at(field(mk, "time", run), 2), 0.004);
        close_to(number_at(field(signals, "q1", 0), 1), -1.25);
        ck_assert(isnan(number_at(field(signals, "q2", 0), 1)));
        ck_assert_ptr_null(Mat_VarGetStructFieldByName(signals, "note", 0));
        matvar_t *y = field(mk, "Y", run), *names = field(mk, "Y_names", run);
        ck_assert_uint_eq(y->dims[0], 3);
        ck_assert_uint_eq(y->dims[1], 4);
        close_to(number_at(y, 3 * 3 + 2), -10);
        ck_text(Mat_VarGetCell(names, 0), "t");
        ck_text(Mat_VarGetCell(names, 3), "u");
        matvar_t *gains = field(mk, "gains", run);
        ck_assert_uint_eq(gains->dims[1], 4);
        close_to(number_at(gains, 2), 62.4);
        close_to(number_at(field(field(mk, "parameters", run), "kd", 0), 0), 21);
        ck_text(field(model, "kind", 0), "pendubot");
        close_to(number_at(field(field(model, "parameters", 0), "p4", 0), 0), 0.7805);
        matvar_t *effects = field(model, "effects", 0);
        ck_assert_uint_eq(effects->dims[1], 1);
        ck_text(field(effects, "name", 0), "backlash");
        close_to(number_at(field(field(effects, "parameters", 0), "width", 0), 0), 0.03);
    }
    Mat_VarFree(mk);
    Mat_Close(mat);
}

static const char *model_with_backlash(void)
{
    struct mk_model model;
    const char *path = scratch("played.ini");
    mk_model_default(MK_PLANT_PENDUBOT, &model);
    ck_assert_int_eq(mk_model_add_effect(&model, "backlash", 2, NULL), MK_OK);
    model.effect[0].value[0] = 0.03;
    ck_assert_int_eq(mk_model_write(path, &model, NULL, NULL), MK_OK);
    return path;
}

START_TEST(a_mat_file_has_what_the_log_has_in_both_versions)
{
    const char *log = scratch_text("small.csv", small), *model = model_with_backlash();
    static const struct {
        const char *name;
        enum mat_ft version;
    } formats[] = {{"v5", MAT_FT_MAT5}, {"v7.3", MAT_FT_MAT73}};
    for (int i = 0; i < 2; i++) {
        char out[1024];
        const char *mat = scratch("small.mat");
        int code = run_mechkit(out, sizeof out, "export %s %s --model %s --format %s --out %s", log,
                               log, model, formats[i].name, mat);
        ck_assert_msg(code == 0, "%s", out);
        check_mat(mat, formats[i].version);
    }
}
END_TEST

START_TEST(a_mat_file_that_cannot_be_written_leaves_the_old_one)
{
    char out[1024];
    const char *log = scratch_text("small.csv", small), *mat = scratch("kept.mat");
    const char *large = open_loop_log("pendulum", "1.5*sin(6*t)", 0.5), *full = scratch("full.mat");
    ck_assert_int_eq(run_mechkit(out, sizeof out, "export %s --out %s", log, mat), 0);
    ck_assert_int_eq(run_command(out, sizeof out,
                                 "ulimit -f 4; %s export %s --plain --columns t,q1 --out %s.csv",
                                 MK_TEST_APP, large, mat),
                     1);
    ck_assert_int_eq(symlink("/dev/full", full), 0);
    for (int i = 0; i < 2; i++) {
        ck_assert_int_eq(run_mechkit(out, sizeof out, "export %s --format %s --out %s", large,
                                     i ? "v5" : "v7.3", full),
                         1);
        ck_assert_msg(strstr(out, "full.mat: ") && strstr(out, "No space left"), "%s", out);
    }
    /* matio goes on, and HDF5 crashes, where there is no room: neither is let begin. */
    for (int i = 0; i < 2; i++) {
        int code = run_command(out, sizeof out, "ulimit -f 16; %s export %s --format %s --out %s",
                               MK_TEST_APP, large, i ? "v5" : "v7.3", mat);
        ck_assert_msg(code == 1 && strstr(out, "kept.mat: cannot write"), "%d %s", code, out);
    }
    mat_t *file = Mat_Open(mat, MAT_ACC_RDONLY);
    ck_assert_ptr_nonnull(file);
    matvar_t *mk = Mat_VarRead(file, "mk");
    ck_assert_ptr_nonnull(mk);
    ck_assert_uint_eq(mk->dims[1], 1);
    Mat_VarFree(mk);
    Mat_Close(file);
    ck_assert_int_eq(count_files("kept.mat*"), 1);
    ck_assert_int_eq(run_mechkit(out, sizeof out, "export %s --out /nowhere/at/all/x.mat", log), 1);
}
END_TEST

/* --- CSV --------------------------------------------------------------------------------- */

static void check_csv(const char *args, const char *want)
{
    char out[1024];
    const char *csv = scratch("out.csv");
    int code = run_mechkit(out, sizeof out, "export %s %s --out %s",
                           scratch_text("small.csv", small), args, csv);
    ck_assert_msg(code == 0, "%s: %s", args, out);
    char *got = slurp_file(csv);
    ck_assert_str_eq(got, want);
    free(got);
}

START_TEST(columns_and_units_are_the_user_s)
{
    check_csv("--plain --columns t:ms,u", "t_ms,u\n0,2\n2,4\n4,-10\n");
    check_csv("--plain --columns 'q1:rev, u:mNm'",
              "q1_rev,u_mNm\n-0.238732414637843,10\n-0.1989436788648692,20\n"
              "-0.15915494309189535,-50\n");
    check_csv("--plain --columns t,q2 --separator ';'", "t;q2\n0;0,25\n0,002;\n0,004;0,5\n");
    check_csv("--plain", "t,q1,q2,u\n0,-1.5,0.25,2\n0.002,-1.25,,4\n0.004,-1,0.5,-10\n");
}
END_TEST

START_TEST(a_csv_in_the_log_s_units_is_a_log_again)
{
    char out[1024];
    const char *csv = scratch("again.csv");
    int code = run_mechkit(out, sizeof out, "export %s --columns t,q1,q2,u --out %s",
                           scratch_text("small.csv", small), csv);
    ck_assert_msg(code == 0, "%s", out);
    struct mk_log *log;
    ck_assert_int_eq(mk_log_read(csv, &log, NULL), MK_OK);
    ck_assert_str_eq(mk_log_find_meta(log, "rig"), "pendubot");
    close_to(mk_log_get(log, "u")[2], -10);
    mk_log_free(log);
}
END_TEST

START_TEST(a_choice_that_does_not_fit_is_refused_with_what_would)
{
    static const struct {
        const char *args, *says;
        int code;
    } bad[] = {{"--columns t,speed", "no column of numbers 'speed'", 2},
               {"--columns t,note", "no column of numbers 'note'", 2},
               {"--columns q1:ms", "units of q1 are: rad, mrad, deg or rev", 2},
               {"--columns q1:furlong", "units of q1 are", 2},
               {"--columns ,", "which columns", 2},
               {"--format v4", "expected v5 or v7.3", 2},
               {"--separator x", "expected , or ; or tab", 2}};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        char out[1024];
        int code = run_mechkit(out, sizeof out, "export %s %s --out %s",
                               scratch_text("small.csv", small), bad[i].args, scratch("no.csv"));
        ck_assert_msg(code == bad[i].code && strstr(out, bad[i].says), "%s: %d, %s", bad[i].args,
                      code, out);
    }
    char out[1024];
    const char *bare = scratch_text("bare.csv", "t,q1,u\n0,1,2\n1,2,3\n");
    ck_assert_int_eq(
        run_mechkit(out, sizeof out, "export %s --columns u:Nm --out %s", bare, scratch("no.csv")),
        2);
    ck_assert_ptr_nonnull(strstr(out, "give --model"));
    ck_assert_int_eq(run_mechkit(out, sizeof out, "export %s --out x.xls", bare), 2);
    ck_assert_int_eq(run_mechkit(out, sizeof out, "export --out x.csv"), 2);
}
END_TEST

/* --- Octave ------------------------------------------------------------------------------ */

START_TEST(octave_runs_the_functions_on_logs_of_every_rig)
{
    if (!have_program("octave-cli", "octave_runs_the_functions_on_logs_of_every_rig"))
        return;
    static const char *const rigs[] = {"inertia-wheel", "pendulum", "pendubot", "reaction-wheel",
                                       "furuta"};
    char list[2048] = "", out[8192];
    for (size_t i = 0; i < sizeof rigs / sizeof rigs[0]; i++)
        snprintf(list + strlen(list), sizeof list - strlen(list), " %s",
                 open_loop_log(rigs[i], "1.5*sin(6*t)", 1.0));
    const char *real = shared_path("data/pendubot-dfki-c1-swingup/tvlqr_02.csv");
    if (real)
        snprintf(list + strlen(list), sizeof list - strlen(list), " %s", real);
    else
        fprintf(stderr, "no measured logs in ../shared: Octave saw those of the virtual rigs\n");
    int code = run_mechkit(out, sizeof out, "export %s --out %s", list, scratch("all.mat"));
    ck_assert_msg(code == 0, "%s", out);
    code = run_mechkit(out, sizeof out, "export %.*s --columns t:ms,q1:deg,u:mNm --out %s",
                       (int)strcspn(list + 1, " ") + 1, list, scratch("all_deg.mat"));
    ck_assert_msg(code == 0, "%s", out);
    code = run_command(out, sizeof out,
                       "octave-cli --no-gui --quiet --no-init-file --path %s/tools/matlab_export "
                       "%s/tests/octave/test_tools.m %s %s",
                       MK_SOURCE_DIR, MK_SOURCE_DIR, scratch("all.mat"), list);
    ck_assert_msg(code == 0 && strstr(out, "all functions ran"), "%s", out);
}
END_TEST

Suite *suite_exchange(void)
{
    Suite *s = suite_create("exchange");
    TCase *c = tcase_create("export");
    tcase_set_timeout(c, 60);
    tcase_add_test(c, a_mat_file_has_what_the_log_has_in_both_versions);
    tcase_add_test(c, a_mat_file_that_cannot_be_written_leaves_the_old_one);
    tcase_add_test(c, columns_and_units_are_the_user_s);
    tcase_add_test(c, a_csv_in_the_log_s_units_is_a_log_again);
    tcase_add_test(c, a_choice_that_does_not_fit_is_refused_with_what_would);
    suite_add_tcase(s, c);
    c = tcase_create("octave");
    tcase_set_timeout(c, 300);
    tcase_add_test(c, octave_runs_the_functions_on_logs_of_every_rig);
    suite_add_tcase(s, c);
    return s;
}
