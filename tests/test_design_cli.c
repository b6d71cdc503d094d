/* mechkit design as a user meets it: numbers, the order of gains, exit codes. */
#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>

#include "mechkit/ctrl.h"
#include "mechkit/json.h"
#include "support/files.h"

#define MODELS MK_SOURCE_DIR "/models/"

/* Runs `mechkit design ARGS`; what it prints goes to `out` (may be NULL). Returns the exit code. */
static int design(const char *args, char *out, size_t size)
{
    char command[1024];
    snprintf(command, sizeof command, "%s design %s 2>&1", MK_TEST_APP, args);
    FILE *f = popen(command, "r");
    ck_assert_ptr_nonnull(f);
    char local[8192];
    size_t n = fread(local, 1, sizeof local - 1, f);
    local[n] = 0;
    if (out)
        snprintf(out, size, "%s", local);
    int status = pclose(f);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

static cJSON *design_json(const char *args)
{
    char line[900], out[8192];
    snprintf(line, sizeof line, "%s --json -", args);
    ck_assert_msg(design(line, out, sizeof out) == 0, "%s: %s", args, out);
    cJSON *root = cJSON_Parse(out);
    ck_assert_msg(root != NULL, "%s", out);
    return root;
}

static double number(const cJSON *root, const char *name, int index)
{
    const cJSON *item = cJSON_GetArrayItem(cJSON_GetObjectItem(root, name), index);
    ck_assert_msg(cJSON_IsNumber(item), "%s %d", name, index);
    return item->valuedouble;
}

static double pole(const cJSON *root, const char *name, int index, int part)
{
    const cJSON *pair = cJSON_GetArrayItem(cJSON_GetObjectItem(root, name), index);
    ck_assert_int_eq(cJSON_GetArraySize(pair), 2);
    return cJSON_GetArrayItem(pair, part)->valuedouble;
}

/* The model of (3.32) with the g of the report's numbers. */
static const char *report_pendubot(void)
{
    return scratch_text("report.ini", "[rig]\nkind = pendubot\ng = 9.80\nu_max = 10\n"
                                      "u_to_torque = 0.00494\nencoder_cpr = 4000 4000\n"
                                      "[parameters]\np1 = 0.0540\np2 = 0.0540\np3 = 0.0286\n"
                                      "p4 = 0.7805\np5 = 0.3284\np6 = 0.1346\np7 = 0.2014\n");
}

START_TEST(the_report_s_gains_come_out_in_its_order)
{
    static const double want[2][4] = {{48.232, 5.250, 62.400, 7.858},
                                      {-61.270, -10.465, -62.400, -7.858}};
    for (int top = 0; top < 2; top++) {
        char args[600];
        snprintf(args, sizeof args, "--model %s --at %s --poles '-10 -10 -10 -10'",
                 report_pendubot(), top ? "top" : "mid");
        cJSON *root = design_json(args);
        for (int i = 0; i < 4; i++)
            ck_assert_double_eq_tol(number(root, "gains", i), want[top][i], 1e-3);
        ck_assert_double_eq(cJSON_GetObjectItem(root, "controllability_rank")->valuedouble, 4);
        cJSON_Delete(root);
    }
}
END_TEST

START_TEST(complex_poles_are_placed_where_they_are_written)
{
    char args[600];
    snprintf(args, sizeof args, "--model %s --poles '-7+2i, -7-2i -20 -30'", report_pendubot());
    cJSON *root = design_json(args);
    static const double re[4] = {-30, -20, -7, -7}, im[4] = {0, 0, -2, 2};
    for (int i = 0; i < 4; i++) {
        ck_assert_double_eq_tol(pole(root, "closed_loop_poles", i, 0), re[i], 1e-6);
        ck_assert_double_eq_tol(pole(root, "closed_loop_poles", i, 1), im[i], 1e-6);
    }
    cJSON_Delete(root);
}
END_TEST

START_TEST(gains_are_printed_in_the_order_of_the_command)
{
    static const struct {
        const char *model, *setup;
    } rigs[] = {
        {"pendubot", "pendubot-top"}, {"reaction-wheel", "reaction-wheel"}, {"furuta", "furuta"}};
    /* What each setup calls its gains, for the states that design prints. */
    static const char *const rows[3][4] = {{"k_q1", "k_dq1", "k_q2", "k_dq2"},
                                           {"k_pp", "k_dp", "k_dr", NULL},
                                           {"k_a", "k_da", "k_b", "k_db"}};
    static const char *const states[3][4] = {
        {"q1", "dq1", "q2", "dq2"}, {"q1", "dq1", "dq1+dq2", NULL}, {"q1", "dq1", "q2", "dq2"}};
    for (int r = 0; r < 3; r++) {
        char args[600], out[4096];
        const struct mk_ctrl_ops *ops = mk_ctrl_setup_by_name(rigs[r].setup);
        int n = mk_ctrl_gain_count(ops);
        snprintf(args, sizeof args, "--model " MODELS "%s.ini --poles '-9 -10 -11 %s'",
                 rigs[r].model, n == 4 ? "-12" : "");
        cJSON *root = design_json(args);
        ck_assert_str_eq(cJSON_GetObjectItem(root, "at")->valuestring, "top");
        ck_assert_int_eq(cJSON_GetArraySize(cJSON_GetObjectItem(root, "gains")), n);
        const cJSON *names = cJSON_GetObjectItem(root, "states");
        for (int i = 0, row = 0; i < n; row++)
            if (ops->param[row].gain) {
                ck_assert_str_eq(ops->param[row].name, rows[r][i]);
                ck_assert_str_eq(cJSON_GetArrayItem(names, i)->valuestring, states[r][i]);
                i++;
            }
        cJSON_Delete(root);
        ck_assert_int_eq(design(args, out, sizeof out), 0);
        ck_assert_ptr_nonnull(strstr(out, rigs[r].setup));
    }
}
END_TEST

START_TEST(the_reaction_wheel_s_poles_are_those_of_its_absolute_wheel_speed)
{
    /* Errata 5.2 for g = 9.80; the model's 9.81 moves them by less than the tolerance. */
    cJSON *root = design_json("--model " MODELS "reaction-wheel.ini --gains '-400 -35 -0.07'");
    ck_assert_double_eq_tol(pole(root, "closed_loop_poles", 0, 0), -10.68, 0.02);
    ck_assert_double_eq_tol(fabs(pole(root, "closed_loop_poles", 0, 1)), 13.75, 0.02);
    ck_assert_double_eq_tol(pole(root, "closed_loop_poles", 2, 0), -4.04, 0.02);
    cJSON_Delete(root);
}
END_TEST

START_TEST(friction_is_left_out_unless_asked_for)
{
    cJSON *plain = design_json("--model " MODELS "pendulum.ini");
    cJSON *rough = design_json("--model " MODELS "pendulum.ini --friction");
    const cJSON *a = cJSON_GetArrayItem(cJSON_GetObjectItem(plain, "A"), 1);
    const cJSON *b = cJSON_GetArrayItem(cJSON_GetObjectItem(rough, "A"), 1);
    ck_assert_double_eq(cJSON_GetArrayItem(a, 1)->valuedouble, 0.0);
    /* -(p3 + 15 p4) / p1: viscous, and the slope of the Coulomb sigmoid at rest. */
    ck_assert_double_eq_tol(cJSON_GetArrayItem(b, 1)->valuedouble,
                            -(0.0111 + 15 * 0.3575) * number(plain, "B", 1), 1e-6);
    cJSON_Delete(plain);
    cJSON_Delete(rough);
}
END_TEST

START_TEST(a_sample_of_delay_costs_a_gain_and_no_pole)
{
    const char *now = "--model " MODELS "pendubot.ini --lqrd '10 1 10 1; 0.5' --rate 250";
    const char *late = "--model " MODELS "pendubot.ini --lqrd '10,1,10,1,0.5' --rate 250 --delay";
    cJSON *a = design_json(now), *b = design_json(late);
    ck_assert_int_eq(cJSON_GetArraySize(cJSON_GetObjectItem(a, "gains")), 4);
    ck_assert_int_eq(cJSON_GetArraySize(cJSON_GetObjectItem(b, "gains")), 5);
    ck_assert_double_eq_tol(pole(b, "closed_loop_poles_z", 0, 0), 0.0, 1e-9);
    for (int i = 0; i < 4; i++) {
        ck_assert_double_eq_tol(pole(b, "closed_loop_poles_z", i + 1, 0),
                                pole(a, "closed_loop_poles_z", i, 0), 1e-6);
        ck_assert_double_lt(
            hypot(pole(a, "closed_loop_poles_z", i, 0), pole(a, "closed_loop_poles_z", i, 1)), 1.0);
    }
    cJSON_Delete(a);
    cJSON_Delete(b);
}
END_TEST

START_TEST(what_cannot_be_designed_is_said_in_a_line)
{
    static const struct {
        const char *args;
        int code;
        const char *says;
    } cases[] = {
        {"", 2, "--model is missing"},
        {"--model " MODELS "pendubot.ini --at up", 2, "are hanging, mid, top"},
        {"--model " MODELS "pendubot.ini --poles '-1 -2 -3'", 2, "expected 4 poles"},
        {"--model " MODELS "pendubot.ini --poles '-1 -2 -3 x'", 2, "expected 4 poles"},
        {"--model " MODELS "pendubot.ini --poles '-1 -2 -3+i -4'", 2, "expected 4 poles"},
        {"--model " MODELS "pendubot.ini --poles '-1 -2 -3+1i -4'", 1, "conjugate pairs"},
        {"--model " MODELS "pendubot.ini --lqr '1 1 1 1; 0'", 1, "r must be positive"},
        {"--model " MODELS "pendubot.ini --lqr '1 1 1 1'", 2, "expected 4 weights for the states"},
        {"--model " MODELS "pendubot.ini --lqr '1 1 1 1 1' --gains '1 1 1 1'", 2, "at a time"},
        {"--model " MODELS "pendubot.ini --lqr '1 1 1 1 1' --delay", 2, "goes with --lqrd"},
        {"--model " MODELS "pendubot.ini --rate 0", 2, "samples per second"},
        {"--model " MODELS "furuta.ini --lqr '0 0 0 0; 1'", 1, "Q does not see the mode"},
        {"--model /no/such.ini", 3, "/no/such.ini"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char out[4096];
        int code = design(cases[i].args, out, sizeof out);
        ck_assert_msg(code == cases[i].code, "%s: %d %s", cases[i].args, code, out);
        ck_assert_msg(strncmp(out, "mechkit: ", 9) == 0, "%s", out);
        ck_assert_msg(strstr(out, cases[i].says) != NULL, "%s: %s", cases[i].args, out);
    }
}
END_TEST

START_TEST(a_swing_up_is_a_design_of_its_own)
{
    char out[4096];
    ck_assert_int_eq(design("--model " MODELS "furuta.ini --out x.csv", out, sizeof out), 2);
    ck_assert_msg(strstr(out, "--out goes with swingup"), "%s", out);
    ck_assert_int_eq(
        design("swingup --model " MODELS "furuta.ini --lqr '1 1 1 1 1'", out, sizeof out), 2);
    ck_assert_int_eq(design("swingdown --model " MODELS "furuta.ini", out, sizeof out), 2);
    ck_assert_int_eq(design("swingup --at hanging --model " MODELS "furuta.ini", out, sizeof out),
                     1);
    ck_assert_msg(strstr(out, "nothing to swing up"), "%s", out);
}
END_TEST

Suite *suite_design_cli(void)
{
    Suite *s = suite_create("design_cli");
    TCase *t = tcase_create("program");
    tcase_set_timeout(t, 20);
    tcase_add_test(t, a_swing_up_is_a_design_of_its_own);
    tcase_add_test(t, the_report_s_gains_come_out_in_its_order);
    tcase_add_test(t, complex_poles_are_placed_where_they_are_written);
    tcase_add_test(t, gains_are_printed_in_the_order_of_the_command);
    tcase_add_test(t, the_reaction_wheel_s_poles_are_those_of_its_absolute_wheel_speed);
    tcase_add_test(t, friction_is_left_out_unless_asked_for);
    tcase_add_test(t, a_sample_of_delay_costs_a_gain_and_no_pole);
    tcase_add_test(t, what_cannot_be_designed_is_said_in_a_line);
    suite_add_tcase(s, t);
    return s;
}
