/* mechkit simulate: predictions of logs and what is said of them. */
#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mechkit/json.h"
#include "mechkit/log.h"
#include "support/files.h"
#include "support/spawn.h"

START_TEST(simulate_writes_the_log_s_own_time_base)
{
    const char *script =
        scratch_text("o.cmd", "model " MK_SOURCE_DIR "/models/pendubot.ini\n"
                              "setup open-loop\ninput 1.5*sin(6*t)\nstart\nwait 2\n"
                              "halt\nsave o.csv\n");
    char out[256], log[300], prediction[300], json[300];
    snprintf(out, sizeof out, "%s", scratch("o"));
    snprintf(log, sizeof log, "%s/o.csv", out);
    snprintf(prediction, sizeof prediction, "%s/p.csv", out);
    snprintf(json, sizeof json, "%s/p.json", out);
    ck_assert_int_eq(MECHKIT("run", script, "--fast", "--out", out).code, 0);
    struct outcome o =
        MECHKIT("simulate", "--model", MK_SOURCE_DIR "/models/pendubot.ini", "--input", log,
                "--out", prediction, "--window", "0.5", "--json", json);
    ck_assert_msg(o.code == 0, "%s", o.err);
    struct mk_log *a, *b;
    cJSON *figures;
    ck_assert_int_eq(mk_log_read(log, &a, NULL), MK_OK);
    ck_assert_int_eq(mk_log_read(prediction, &b, NULL), MK_OK);
    ck_assert_uint_eq(a->rows, b->rows);
    ck_assert_int_eq(memcmp(mk_log_get(a, "t"), mk_log_get(b, "t"), a->rows * sizeof(double)), 0);
    const char *columns[] = {"q1", "q2", "dq1", "dq2", "window"};
    for (int i = 0; i < 5; i++)
        ck_assert_ptr_nonnull(mk_log_get(b, columns[i]));
    ck_assert_int_eq(mk_json_read(json, &figures, NULL), MK_OK);
    ck_assert_double_lt(cJSON_GetArrayItem(cJSON_GetObjectItem(figures, "nrmse"), 0)->valuedouble,
                        0.1);
    cJSON_Delete(figures);
    mk_log_free(a);
    mk_log_free(b);
}
END_TEST

/* Whether an error is large is seen beside what no model can predict. */
START_TEST(simulate_prints_figures_beside_the_noise_with_or_without_a_file)
{
    const char *script = scratch_text(
        "no.cmd", "setup open-loop\ninput 1.5*sin(6*t)\nstart\nwait 3\nhalt\nsave no.csv\n");
    const char *model = MK_SOURCE_DIR "/models/pendulum.ini";
    ck_assert_int_eq(
        MECHKIT("run", script, "--fast", "--model", model, "--out", scratch("no")).code, 0);
    struct outcome o = MECHKIT("simulate", "--model", model, "--input", scratch("no/no.csv"));
    ck_assert_msg(o.code == 0, "%s", o.err);
    const char *error = strstr(o.out, "q1: rms error "), *noise = strstr(o.out, "own noise ");
    ck_assert_msg(error && noise, "%s", o.out);
    double rms = strtod(error + 14, NULL), own = strtod(noise + 10, NULL);
    /* The model is the rig: its error is the noise. */
    ck_assert_msg(rms > 0.5 * own && rms < 2.0 * own, "%s", o.out);
}
END_TEST

/* The same log is another motion by the column of what was sent. */
START_TEST(simulate_says_which_column_drives_the_model_and_doubts_metadata)
{
    const char *model = MK_SOURCE_DIR "/models/pendulum.ini";
    char text[20000] = "# u_to_torque: 7\nt,q1,u,u_cmd\n", log[300], sent[300];
    for (int k = 0; k < 300; k++)
        snprintf(text + strlen(text), sizeof text - strlen(text), "%.2f,%.4f,%.3f,%.3f\n", 0.01 * k,
                 0.1 * sin(0.03 * k), sin(0.05 * k), sin(0.05 * k + 0.1));
    snprintf(log, sizeof log, "%s", scratch_text("both.csv", text));
    struct outcome o = MECHKIT("simulate", "--model", model, "--input", log, "--window", "0.5");
    ck_assert_msg(o.code == 0 && strstr(o.out, "driven by the command as it was measured"), "%s",
                  o.out);
    ck_assert_msg(strstr(o.err, "u_to_torque is 7 here"), "%s", o.err);
    char *ini = slurp_file(model), with[4000];
    char *rig = strstr(ini, "[rig]\n");
    ck_assert_ptr_nonnull(rig);
    snprintf(with, sizeof with, "[rig]\ninput = commanded\n%s", rig + 6);
    free(ini);
    snprintf(sent, sizeof sent, "%s", scratch_text("sent.ini", with));
    o = MECHKIT("simulate", "--model", sent, "--input", log, "--window", "0.5");
    ck_assert_msg(o.code == 0 && strstr(o.out, "driven by the command as it was sent"), "%s%s",
                  o.out, o.err);
}
END_TEST

START_TEST(commands_that_are_missing_are_not_made_up)
{
    const char *model = MK_SOURCE_DIR "/models/pendulum.ini";
    static char text[200000];
    for (int step = 6; step <= 501;
         step += 495) { /* every sixth command is missing, or 4 of 2000 */
        char *at = text + sprintf(text, "t,q1,u\n");
        for (int i = 0; i < 2000; i++)
            at += i % step == step - 1 ? sprintf(at, "%.3f,%.4f,\n", i * 0.002, sin(i * 0.01))
                                       : sprintf(at, "%.3f,%.4f,1\n", i * 0.002, sin(i * 0.01));
        const char *log = scratch_text("missing.csv", text);
        struct outcome o = MECHKIT("simulate", "--model", model, "--input", log, "--out",
                                   scratch("missing_p.csv"));
        ck_assert_msg(o.code == (step == 6 ? 3 : 0), "%d %s", o.code, o.err);
        ck_assert_msg(strstr(o.err, step == 6 ? "missing in 333 of 2000 rows: at most 1 %"
                                              : "missing in 3 of 2000 rows: held from before"),
                      "%s", o.err);
    }
}
END_TEST

START_TEST(a_joint_at_rest_has_no_error_in_units_of_its_motion)
{
    static char text[20000];
    char *at = text + sprintf(text, "t,q1,u\n");
    for (int i = 0; i < 400; i++)
        at += sprintf(at, "%.3f,0,0\n", i * 0.002);
    struct outcome o = MECHKIT("simulate", "--model", MK_SOURCE_DIR "/models/inertia-wheel.ini",
                               "--input", scratch_text("rest.csv", text));
    ck_assert_msg(o.code == 0, "%d %s", o.code, o.err);
    ck_assert_msg(strstr(o.out, "the log has it at rest") && !strstr(o.out, "nan"), "%s", o.out);
}
END_TEST

/* The sums that errors are made of would be no numbers. */
START_TEST(simulate_refuses_a_log_with_an_infinite_reading_or_command)
{
    static const struct {
        const char *row, *says;
    } bad[] = {{"inf,1", ":102: q1 is infinite; a missing value is an empty field or nan"},
               {"-inf,1", ":102: q1 is infinite; a missing value is an empty field or nan"},
               {"1e999,1", ":102: q1"},
               {"0,inf", ":102: the command is infinite; a missing value is an empty field or nan"},
               {"nan,1", NULL},
               {",1", NULL}};
    static char text[400 * 40];
    const char *model = MK_SOURCE_DIR "/models/pendulum.ini";
    for (size_t b = 0; b < sizeof bad / sizeof bad[0]; b++) {
        char *at = text + sprintf(text, "t,q1,u\n");
        for (int i = 0; i < 400; i++)
            at += i == 100 ? sprintf(at, "%.3f,%s\n", i * 0.002, bad[b].row)
                           : sprintf(at, "%.3f,%.4f,1\n", i * 0.002, sin(i * 0.01));
        struct outcome o =
            MECHKIT("simulate", "--model", model, "--input", scratch_text("infinite.csv", text));
        ck_assert_msg(o.code == (bad[b].says ? 3 : 0), "%s: %d %s", bad[b].row, o.code, o.err);
        ck_assert_msg(!bad[b].says || (strstr(o.err, bad[b].says) && !*o.out), "%s: %s%s",
                      bad[b].row, o.out, o.err);
        ck_assert_ptr_null(strstr(o.out, "nan"));
    }
}
END_TEST

/* The log of a run as a motor with its wires turned round would have recorded it. */
static const char *with_flipped_command(const char *path)
{
    static const char *const columns[] = {"t", "q1", "q2", "u"};
    struct mk_log *log, *turned;
    ck_assert_int_eq(mk_log_read(path, &log, NULL), MK_OK);
    ck_assert_int_eq(mk_log_create(log->rows, &turned), MK_OK);
    for (int c = 0; c < 4; c++) {
        const double *from = mk_log_get(log, columns[c]);
        double *to = mk_log_add_column(turned, columns[c]);
        for (size_t k = 0; k < log->rows; k++)
            to[k] = c == 3 ? -from[k] : from[k];
    }
    const char *flipped = scratch("flipped.csv");
    ck_assert_int_eq(mk_log_write(flipped, turned, NULL), MK_OK);
    mk_log_free(turned);
    mk_log_free(log);
    return flipped;
}

/* A prediction is told as it is, and why it is useless where that is certain. */
START_TEST(simulate_says_that_a_useless_prediction_is_one_of_a_flipped_command)
{
    const char *script = scratch_text(
        "f.cmd", "setup open-loop\ninput 1.5*sin(6*t)\nstart\nwait 6\nhalt\nsave f.csv\n");
    const char *model = MK_SOURCE_DIR "/models/pendubot.ini";
    ck_assert_int_eq(MECHKIT("run", script, "--fast", "--model", model, "--out", scratch("f")).code,
                     0);
    char log[300];
    snprintf(log, sizeof log, "%s", scratch("f/f.csv"));
    struct outcome o = MECHKIT("simulate", "--model", model, "--input", log);
    ck_assert_msg(o.code == 0 && !strstr(o.err, "sign = -1"), "%s", o.err);
    o = MECHKIT("simulate", "--model", model, "--input", with_flipped_command(log));
    ck_assert_msg(o.code == 0 && strstr(o.out, "q1: rms error "), "%s", o.out);
    ck_assert_msg(strstr(o.err, "[u] sign = -1") && !strstr(o.err, "--force"), "%s", o.err);
    ck_assert_msg(strstr(o.err, "mechkit: certain: ") && !strstr(o.err, "fatal"), "%s", o.err);
}
END_TEST

START_TEST(simulate_says_where_readings_are_of_no_state_to_begin_from)
{
    char text[8192] = "t,q1,u\n", log[300];
    for (int k = 0; k < 300; k++)
        snprintf(text + strlen(text), sizeof text - strlen(text), "%g,1e308,0\n", 0.01 * k);
    snprintf(log, sizeof log, "%s", scratch_text("huge.csv", text));
    struct outcome o = MECHKIT("simulate", "--model", MK_SOURCE_DIR "/models/pendulum.ini",
                               "--input", log, "--window", "1");
    ck_assert_int_eq(o.code, 1);
    ck_assert_msg(strstr(o.err, "are of no state to begin a run from"), "%s", o.err);
}
END_TEST

/* A solver that gives up after a minute says neither which effect it was nor what to do. */
START_TEST(a_model_that_is_too_stiff_is_refused_with_what_makes_it_so)
{
    static const struct {
        const char *part, *says;
    } models[] = {
        {"p1 = 0.06\np2 = 7\np3 = 0.01\np4 = 0.3\n[effect.stiction]\njoint = 1\nstiffness = 1e9\n"
         "damping = 1\nlevel = 1\n",
         "too stiff to be simulated: effect stiction makes it change at "},
        {"p1 = 1e-9\np2 = 7\np3 = 0.01\np4 = 0.3\n",
         "too stiff to be simulated: the plant's parameters make it change at "},
    };
    char text[400], log[300];
    snprintf(log, sizeof log, "%s",
             scratch_text("stiff.csv", "t,q1,u\n0,0,0\n0.01,0,0\n0.02,0,0\n"));
    for (size_t i = 0; i < sizeof models / sizeof models[0]; i++) {
        snprintf(text, sizeof text, "[rig]\nkind = pendulum\n[parameters]\n%s", models[i].part);
        struct outcome o =
            MECHKIT("simulate", "--model", scratch_text("stiff.ini", text), "--input", log);
        ck_assert_msg(o.code == 3 && strstr(o.err, "stiff.ini: the model is") &&
                          strstr(o.err, models[i].says),
                      "%d %s", o.code, o.err);
    }
}
END_TEST

Suite *suite_simulate_cli(void)
{
    Suite *s = suite_create("simulate_cli");
    TCase *t = tcase_create("simulate");
    tcase_set_timeout(t, 40);
    tcase_add_test(t, simulate_writes_the_log_s_own_time_base);
    tcase_add_test(t, simulate_prints_figures_beside_the_noise_with_or_without_a_file);
    tcase_add_test(t, simulate_says_which_column_drives_the_model_and_doubts_metadata);
    tcase_add_test(t, commands_that_are_missing_are_not_made_up);
    tcase_add_test(t, a_joint_at_rest_has_no_error_in_units_of_its_motion);
    tcase_add_test(t, simulate_refuses_a_log_with_an_infinite_reading_or_command);
    tcase_add_test(t, simulate_says_that_a_useless_prediction_is_one_of_a_flipped_command);
    tcase_add_test(t, simulate_says_where_readings_are_of_no_state_to_begin_from);
    tcase_add_test(t, a_model_that_is_too_stiff_is_refused_with_what_makes_it_so);
    suite_add_tcase(s, t);
    return s;
}
