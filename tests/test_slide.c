/* A joint in metres, from the mapping to the report. The carriage of these tests is integrated
 * here, with dry friction that truly sticks. */
#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mechkit/ident.h"
#include "mechkit/json.h"
#include "mechkit/log.h"
#include "mechkit/model.h"
#include "mechkit/safety.h"
#include "mechkit/sim.h"
#include "support/files.h"
#include "support/program.h"

#define MASS 18.0    /* kg */
#define VISCOUS 70.0 /* N s/m */
#define COULOMB 6.5  /* N */
#define COUNT 1e-6   /* m */
#define RATE_HZ 500.0
#define SECONDS 12.0

static const char rig[] = "[rig]\nkind = inertia-wheel\njoint_unit = m\nu_max = 100\n"
                          "u_to_torque = 1\nencoder_resolution = 1e-6\n"
                          "[parameters]\np1 = %g\np2 = %g\np3 = %g\n";

static const char *model_file(const char *name, double p1, double p2, double p3)
{
    char text[400];
    snprintf(text, sizeof text, rig, p1, p2, p3);
    return scratch_text(name, text);
}

static double force_at(double t, double phase)
{
    return 20.0 * sin(4.0 * t + phase) + 13.0 * sin(11.0 * t) + 11.0 * sin(1.3 * t + phase);
}

/* Friction more viscous forwards than backwards by `difference`. Steps of 20 us. */
static void step(double force, double difference, double *q, double *v)
{
    const double h = 2e-5;
    double viscous = VISCOUS + (*v > 0.0 ? 0.5 : -0.5) * difference;
    double next = *v + h * (force - viscous * *v) / MASS, loss = h * COULOMB / MASS;
    next = fabs(next) <= loss ? 0.0 : next - copysign(loss, next);
    *q += 0.5 * h * (*v + next);
    *v = next;
}

/* Writes the carriage's record; positions are multiplied by `size` and stand below the head. */
static const char *record(const char *name, const char *head, double size, double difference,
                          double phase)
{
    const char *path = scratch(name);
    FILE *f = fopen(path, "w");
    ck_assert_ptr_nonnull(f);
    fputs(head, f);
    double q = 0.0, v = 0.0;
    for (int k = 0; k < (int)(SECONDS * RATE_HZ); k++) {
        double t = k / RATE_HZ, force = force_at(t, phase);
        fprintf(f, "%.6g,%.12g,%.9g\n", t, size * COUNT * floor(q / COUNT + 0.5), force);
        for (int i = 0; i < 100; i++)
            step(force, difference, &q, &v);
    }
    fclose(f);
    return path;
}

static const char *axis_log(const char *name, double difference, double phase)
{
    return record(name,
                  "# mechkit-log: 1\n# rig: inertia-wheel\n# joint_unit: m\n"
                  "# encoder_resolution: 1e-6\nt,q1,tau\n",
                  1.0, difference, phase);
}

static void lacks(const char *text, const char *const *words)
{
    for (; *words; words++)
        ck_assert_msg(!strstr(text, *words), "'%s' in\n%s", *words, text);
}

static void says(const char *text, const char *const *words)
{
    for (; *words; words++)
        ck_assert_msg(strstr(text, *words) != NULL, "no '%s' in\n%s", *words, text);
}

static double parameter_of(const cJSON *all, const char *name, const char *unit)
{
    const cJSON *one = cJSON_GetObjectItem(cJSON_GetObjectItem(all, "parameters"), name);
    const char *has = cJSON_GetStringValue(cJSON_GetObjectItem(one, "unit"));
    ck_assert_msg(has && strcmp(has, unit) == 0, "%s is in %s", name, has ? has : "nothing");
    return cJSON_GetNumberValue(cJSON_GetObjectItem(one, "value"));
}

static cJSON *read_json(const char *path)
{
    cJSON *json = NULL;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_json_read(path, &json, &err) == MK_OK, "%s", err.message);
    return json;
}

START_TEST(a_carriage_is_identified_in_metres)
{
    char out[8192], log[80], model[80];
    snprintf(log, sizeof log, "%s", axis_log("axis.csv", 0.0, 0.0));
    snprintf(model, sizeof model, "%s", model_file("guess.ini", 10.0, 120.0, 2.0));
    int code = run_mechkit(out, sizeof out, "identify --model %s --out %s --json %s %s", model,
                           "/dev/null", scratch("slide.json"), log);
    ck_assert_msg(code == 0, "%s", out);
    says(out, (const char *const[]){"noise of q1", " m\n", NULL});
    lacks(out, (const char *const[]){"rad", NULL});
    cJSON *json = read_json(scratch("slide.json"));
    ck_assert_double_eq_tol(parameter_of(json, "p1", "kg"), MASS, 0.01 * MASS);
    ck_assert_double_eq_tol(parameter_of(json, "p2", "N s/m"), VISCOUS, 0.01 * VISCOUS);
    ck_assert_double_eq_tol(parameter_of(json, "p3", "N"), COULOMB, 0.01 * COULOMB);
    cJSON_Delete(json);
}
END_TEST

static void fit(const struct mk_log *log, const struct mk_model *model, double *p)
{
    static struct mk_ident_result result;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_identify(model, &log, 1, NULL, &result, &err) == MK_OK, "%s", err.message);
    memcpy(p, result.model.parameter, 3 * sizeof *p);
}

/* The same positions a hundred times as large, as the angles of a wheel: a mass counts a hundredth,
 * friction without a speed in it the same. */
START_TEST(an_answer_does_not_depend_on_the_unit)
{
    struct mk_error err = MK_ERROR_INIT;
    struct mk_log *metres = NULL, *large = NULL;
    struct mk_model slides, turns;
    char path[80];
    snprintf(
        path, sizeof path, "%s",
        record("large.csv", "# mechkit-log: 1\n# rig: inertia-wheel\nt,q1,tau\n", 100.0, 0.0, 0.0));
    ck_assert_int_eq(mk_log_read(axis_log("small.csv", 0.0, 0.0), &metres, &err), MK_OK);
    ck_assert_int_eq(mk_log_read(path, &large, &err), MK_OK);
    ck_assert_int_eq(mk_model_read(model_file("m.ini", 10.0, 120.0, 2.0), &slides, &err), MK_OK);
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &turns);
    turns.u_max = 100.0, turns.u_to_torque = 1.0;
    turns.encoder_cpr[0] = 0, turns.encoder_resolution[0] = 100.0 * COUNT;
    turns.parameter[0] = 0.1, turns.parameter[1] = 1.2, turns.parameter[2] = 2.0;
    double a[3], b[3];
    fit(metres, &slides, a);
    fit(large, &turns, b);
    ck_assert_double_eq_tol(a[0], 100.0 * b[0], 1e-4 * a[0]);
    ck_assert_double_eq_tol(a[1], 100.0 * b[1], 1e-4 * a[1]);
    ck_assert_double_eq_tol(a[2], b[2], 1e-4 * a[2]);
    mk_log_free(metres);
    mk_log_free(large);
}
END_TEST

START_TEST(what_a_carriage_lacks_is_told_in_newtons_and_metres)
{
    static const char *const no_turns[] = {"rad", "N m", NULL};
    char out[16384], log[80], held[80], model[80], dir[80], path[120];
    snprintf(log, sizeof log, "%s", axis_log("lacks.csv", 30.0, 0.0));
    snprintf(held, sizeof held, "%s", axis_log("held.csv", 30.0, 1.1));
    snprintf(model, sizeof model, "%s", model_file("plain.ini", MASS, VISCOUS, COULOMB));
    snprintf(dir, sizeof dir, "%s", scratch("slide_report"));
    int code = run_mechkit(out, sizeof out, "explain --model %s --out %s --holdout %s %s", model,
                           dir, held, log);
    ck_assert_msg(code == 0, "%s", out);
    says(out, (const char *const[]){"viscous-asymmetry at joint 1", "N s/m", "rms in mm", "N rms",
                                    NULL});
    lacks(out, no_turns);
    snprintf(path, sizeof path, "%s/report.json", dir);
    cJSON *json = read_json(path);
    char *text = slurp_file(path);
    lacks(text, no_turns);
    says(text, (const char *const[]){"\"m\"", "N s/m", NULL});
    const cJSON *cause = cJSON_GetArrayItem(cJSON_GetObjectItem(json, "causes"), 0);
    ck_assert_str_eq(cJSON_GetStringValue(cJSON_GetObjectItem(cause, "name")), "viscous-asymmetry");
    const cJSON *difference =
        cJSON_GetObjectItem(cJSON_GetObjectItem(cause, "parameters"), "difference");
    ck_assert_double_eq_tol(cJSON_GetNumberValue(cJSON_GetObjectItem(difference, "value")), 30.0,
                            1.0);
    cJSON_Delete(json);
    free(text);
    snprintf(path, sizeof path, "%s/report.html", dir);
    text = slurp_file(path);
    says(text, (const char *const[]){"simulated - measured, m", "speed of the joint, m/s",
                                     "position of the joint, m", NULL});
    free(text);
}
END_TEST

START_TEST(a_log_in_another_unit_than_the_model_is_refused)
{
    char out[2048], log[80], model[80];
    snprintf(log, sizeof log, "%s", axis_log("unit.csv", 0.0, 0.0));
    snprintf(model, sizeof model, "%s",
             scratch_text("turns.ini", "[rig]\nkind = inertia-wheel\nu_to_torque = 1\nu_max = 100\n"
                                       "[parameters]\np1 = 18\np2 = 70\np3 = 6\n"));
    int code = run_mechkit(out, sizeof out, "identify --model %s --out /dev/null %s", model, log);
    ck_assert_msg(code == 3 && strstr(out, "joint 1 is in m in the log, in rad in the model"), "%s",
                  out);
    snprintf(log, sizeof log, "%s",
             scratch_text("rad.csv", "# joint_unit: rad\nt,q1,tau\n0,0,0\n0.1,0,1\n"));
    snprintf(model, sizeof model, "%s", model_file("slides.ini", 18.0, 70.0, 6.0));
    code =
        run_mechkit(out, sizeof out, "simulate --model %s --input %s --out /dev/null", model, log);
    ck_assert_msg(code == 3 && strstr(out, "joint 1 is in rad in the log, in m in the model"), "%s",
                  out);
}
END_TEST

static const char map[] = "[rig]\nkind = inertia-wheel\njoint_unit = m\n"
                          "encoder_resolution = 1e-6\n[t]\ncolumn = time\n"
                          "[q1]\ncolumn = x\nunit = %s\n[tau]\ncolumn = force\nunit = %s\n";

START_TEST(a_foreign_file_comes_in_by_metres_or_millimetres)
{
    static const struct {
        const char *length, *force;
        double size;
    } units[] = {{"m", "N", 1.0}, {"mm", "N", 1e3}};
    char text[2][65536], out[2048], path[80], map_path[80];
    for (int i = 0; i < 2; i++) {
        snprintf(out, sizeof out, map, units[i].length, units[i].force);
        snprintf(map_path, sizeof map_path, "%s", scratch_text("axis.map", out));
        snprintf(path, sizeof path, "%s",
                 record("foreign.csv", "time,x,force\n", units[i].size, 0.0, 0.0));
        int code = run_mechkit(out, sizeof out, "import %s --map %s --out %s", path, map_path,
                               scratch("axis_in.csv"));
        ck_assert_msg(code == 0, "%s", out);
        char *log = slurp_file(scratch("axis_in.csv"));
        says(log,
             (const char *const[]){"# joint_unit: m\n", "# encoder_resolution: 1e-06\n", NULL});
        struct mk_log *read = NULL;
        struct mk_error err = MK_ERROR_INIT;
        ck_assert_int_eq(mk_log_read(scratch("axis_in.csv"), &read, &err), MK_OK);
        snprintf(text[i], sizeof text[i], "%.9g %.9g", mk_log_get(read, "q1")[700],
                 mk_log_get(read, "tau")[700]);
        mk_log_free(read);
        free(log);
    }
    ck_assert_str_eq(text[0], text[1]);
    snprintf(out, sizeof out, map, "deg", "N");
    int code = run_mechkit(text[0], sizeof text[0], "import %s --map %s --out /dev/null", path,
                           scratch_text("deg.map", out));
    ck_assert_msg(code == 3 && strstr(text[0], "deg is no unit of q1: m, cm, mm or um"), "%s",
                  text[0]);
}
END_TEST

START_TEST(limits_of_a_carriage_are_a_hundredth_of_a_wheel_s)
{
    struct mk_model wheel, carriage;
    struct mk_safety_limits turning, sliding;
    struct mk_error err = MK_ERROR_INIT;
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &wheel);
    carriage = wheel;
    ck_assert_int_eq(mk_model_set_linear(&carriage, 0, true, &err), MK_OK);
    mk_safety_default(&wheel, 0.002, &turning);
    mk_safety_default(&carriage, 0.002, &sliding);
    ck_assert_double_eq_tol(sliding.v_max[0], 0.01 * turning.v_max[0], 1e-12);
    ck_assert_double_eq_tol(sliding.rest_tolerance[0], 0.01 * turning.rest_tolerance[0], 1e-12);
    ck_assert_double_eq_tol(sliding.jump_rad[0], 1.25 * sliding.v_max[0] * 0.002 + 4e-6, 1e-12);
}
END_TEST

/* Through `run`: gains, a speed in m/s, a log that says its unit, a limit that trips. */
START_TEST(a_virtual_carriage_is_driven_in_metres)
{
    char out[4096], model[80], script[80], path[120];
    snprintf(model, sizeof model, "%s", model_file("drive.ini", MASS, VISCOUS, COULOMB));
    snprintf(script, sizeof script, "%s",
             scratch_text("drive.cmd", "setup pi-speed\nshow gains\nset speed 0.2\nstart\nwait 2\n"
                                       "expect dq1 within 2% of 0.2\nhalt\nsave! drive.csv\n"));
    int code = run_mechkit(out, sizeof out, "run %s --model %s --fast --out %s", script, model,
                           scratch("slide_runs"));
    ck_assert_msg(code == 0, "%s", out);
    says(out, (const char *const[]){" s/m ", "0.5 m/s", "m/s rms", NULL});
    lacks(out, (const char *const[]){"rad", NULL});
    snprintf(path, sizeof path, "%s/drive.csv", scratch("slide_runs"));
    char *log = slurp_file(path);
    ck_assert_ptr_nonnull(log);
    says(log, (const char *const[]){"# joint_unit: m\n", "# encoder_resolution: 1e-06\n", NULL});
    free(log);
    snprintf(script, sizeof script, "%s",
             scratch_text("fast.cmd", "setup pi-speed\nlimit dq1_max 0.1\nstart\nwait 2\n"));
    code = run_mechkit(out, sizeof out, "run %s --model %s --fast --out %s", script, model,
                       scratch("slide_runs"));
    ck_assert_msg(code == 1 && strstr(out, "fault speed (joint 1)"), "%s", out);
    if (!have_program("gnuplot", "labels of a plot"))
        return;
    code = run_mechkit(out, sizeof out, "plot %s --phase --out %s", path, scratch("slide.svg"));
    ck_assert_msg(code == 0, "%s", out);
    char *svg = slurp_file(scratch("slide.svg"));
    says(svg, (const char *const[]){"q1 [m]", "dq1 [m/s]", NULL});
    lacks(svg, (const char *const[]){"rad", NULL});
    free(svg);
}
END_TEST

START_TEST(simple_experiments_of_a_carriage_are_in_its_units)
{
    char out[4096], model[80], script[80];
    snprintf(model, sizeof model, "%s", model_file("simple.ini", MASS, VISCOUS, COULOMB));
    snprintf(script, sizeof script, "%s",
             scratch_text("simple.cmd",
                          "setup pi-speed\nref 0.3*step(0)-0.1*step(3)-0.4*step(6)-0.1*step(9)\n"
                          "start\nwait 12\nhalt\nsave! simple.csv\n"));
    int code = run_mechkit(out, sizeof out, "run %s --model %s --fast --out %s", script, model,
                           scratch("simple_runs"));
    ck_assert_msg(code == 0, "%s", out);
    code = run_mechkit(out, sizeof out, "measure friction --model %s %s/simple.csv --json %s",
                       model, scratch("simple_runs"), scratch("simple.json"));
    ck_assert_msg(code == 0, "%s", out);
    cJSON *json = read_json(scratch("simple.json"));
    const cJSON *p2 =
        cJSON_GetObjectItem(cJSON_GetObjectItem(json, "quantities"), "p2, mean of both ways");
    ck_assert_str_eq(cJSON_GetStringValue(cJSON_GetObjectItem(p2, "unit")), "N s/m");
    ck_assert_double_eq_tol(cJSON_GetNumberValue(cJSON_GetObjectItem(p2, "value")), VISCOUS,
                            0.02 * VISCOUS);
    cJSON_Delete(json);
}
END_TEST

Suite *suite_slide(void)
{
    Suite *s = suite_create("slide");
    TCase *t = tcase_create("metres");
    tcase_set_timeout(t, 120);
    tcase_add_test(t, a_carriage_is_identified_in_metres);
    tcase_add_test(t, an_answer_does_not_depend_on_the_unit);
    tcase_add_test(t, what_a_carriage_lacks_is_told_in_newtons_and_metres);
    tcase_add_test(t, a_log_in_another_unit_than_the_model_is_refused);
    tcase_add_test(t, a_foreign_file_comes_in_by_metres_or_millimetres);
    tcase_add_test(t, limits_of_a_carriage_are_a_hundredth_of_a_wheel_s);
    tcase_add_test(t, a_virtual_carriage_is_driven_in_metres);
    tcase_add_test(t, simple_experiments_of_a_carriage_are_in_its_units);
    suite_add_tcase(s, t);
    return s;
}
