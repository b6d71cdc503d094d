/* A joint that slides: metres, newtons and kilograms from the file to the report. */
#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mechkit/model.h"
#include "support/files.h"
#include "support/program.h"

#define MASS 95.0     /* kg */
#define VISCOUS 200.0 /* N s/m */
#define COULOMB 20.0  /* N */

/* Acceleration of a carriage under a force, with `more` viscous friction forwards than backwards.
 */
static double acceleration(double force, double v, double more)
{
    return (force - VISCOUS * v - 0.5 * more * fabs(v) - COULOMB * tanh(1500.0 * v)) / MASS;
}

/* 12 s of the carriage at 500 Hz by Runge and Kutta's method with steps of 20 us: position in mm as
 * a linear scale of 1 um reads it, force in N, held for a sample. */
static const char *axis(const char *name, double more)
{
    enum { ROWS = 6000, STEPS = 100 };
    const double h = 2e-3 / STEPS;
    const char *path = scratch(name);
    FILE *f = fopen(path, "w");
    ck_assert_ptr_nonnull(f);
    fprintf(f, "t,x,force\n");
    double x = 0.0, v = 0.0;
    for (int k = 0; k < ROWS; k++) {
        double t = 2e-3 * k, force = 90.0 * sin(3.1 * t) + 60.0 * sin(1.3 * t + 0.4 * t * t);
        fprintf(f, "%.3f,%.3f,%.6f\n", t, 1e3 * 1e-6 * round(x / 1e-6 + 0.4 * sin(1e4 * t * t)),
                force);
        for (int i = 0; i < STEPS; i++) {
            double a = acceleration(force, v, more);
            double b = acceleration(force, v + 0.5 * h * a, more);
            double c = acceleration(force, v + 0.5 * h * b, more);
            double d = acceleration(force, v + h * c, more);
            x += h * (v + h / 6.0 * (a + b + c));
            v += h / 6.0 * (a + 2.0 * b + 2.0 * c + d);
        }
    }
    ck_assert_int_eq(fclose(f), 0);
    return path;
}

static const char *imported(const char *file)
{
    char out[4096];
    const char *to = scratch("axis_log.csv");
    const char *map =
        scratch_text("axis.map", "[rig]\nkind = inertia-wheel\njoint_unit = m\n"
                                 "encoder_resolution = 1e-6\n[t]\ncolumn = t\n[q1]\ncolumn = x\n"
                                 "unit = mm\n[tau]\ncolumn = force\n");
    int code = run_mechkit(out, sizeof out, "import %s --map %s --out %s", file, map, to);
    ck_assert_msg(code == 0, "%s", out);
    return to;
}

static const char *guess(const char *unit)
{
    char text[300];
    snprintf(text, sizeof text,
             "[rig]\nkind = inertia-wheel\n%su_max = 400\nu_to_torque = 1\n"
             "[parameters]\np1 = 60\np2 = 100\np3 = 10\n",
             unit);
    return scratch_text("axis.ini", text);
}

START_TEST(a_carriage_is_identified_in_kilograms_and_newtons)
{
    char out[8192];
    struct mk_model m;
    const char *log = imported(axis("axis.csv", 0.0)), *fitted = scratch("axis_fitted.ini");
    int code = run_mechkit(out, sizeof out, "identify --model %s --out %s %s",
                           guess("joint_unit = m\nencoder_resolution = 1e-6\n"), fitted, log);
    ck_assert_msg(code == 0 && strstr(out, "noise of q1: ") && strstr(out, " m\n"), "%d %s", code,
                  out);
    ck_assert_int_eq(mk_model_read(fitted, &m, NULL), MK_OK);
    ck_assert_double_eq_tol(m.parameter[0], MASS, 0.002 * MASS);
    ck_assert_double_eq_tol(m.parameter[1], VISCOUS, 0.005 * VISCOUS);
    ck_assert_double_eq_tol(m.parameter[2], COULOMB, 0.005 * COULOMB);
}
END_TEST

START_TEST(what_a_carriage_s_model_lacks_is_told_in_its_units)
{
    char out[16384], *json;
    const char *log = imported(axis("one_way.csv", 80.0)), *to = scratch("axis_report");
    char report[512];
    int code = run_mechkit(out, sizeof out, "explain --model %s --out %s %s",
                           guess("joint_unit = m\nencoder_resolution = 1e-6\n"), to, log);
    ck_assert_msg(code == 0, "%d %s", code, out);
    const char *named = strstr(out, "viscous-asymmetry at joint 1: difference ");
    double difference = 0.0;
    ck_assert_msg(named && strstr(out, "rms in mm"), "%s", out);
    ck_assert_int_eq(sscanf(named, "viscous-asymmetry at joint 1: difference %lf", &difference), 1);
    ck_assert_double_eq_tol(difference, 80.0, 1.0);
    ck_assert_ptr_nonnull(strstr(named, "N s/m"));
    snprintf(report, sizeof report, "%s/report.json", to);
    json = slurp_file(report);
    const char *budget = strstr(json, "\"budget\"");
    ck_assert_ptr_nonnull(budget);
    const char *unit = strstr(budget, "\"unit\"");
    ck_assert_msg(unit && strcspn(unit, "m") < strcspn(unit, "]") && !strstr(json, "N m s/rad"),
                  "%.200s", budget);
    free(json);
}
END_TEST

START_TEST(a_log_in_metres_is_not_taken_for_radians)
{
    char out[4096];
    const char *log = imported(axis("axis.csv", 0.0));
    int code = run_mechkit(out, sizeof out, "identify --model %s --out %s %s", guess(""),
                           scratch("never.ini"), log);
    ck_assert_msg(code != 0 && strstr(out, "joint 1 is in m in the log, in rad in the model"),
                  "%d %s", code, out);
}
END_TEST

Suite *suite_slides(void)
{
    Suite *s = suite_create("slides");
    TCase *t = tcase_create("metres");
    tcase_set_timeout(t, 120);
    tcase_add_test(t, a_carriage_is_identified_in_kilograms_and_newtons);
    tcase_add_test(t, a_log_in_metres_is_not_taken_for_radians);
    suite_add_tcase(s, t);
    t = tcase_create("searches in metres");
    tcase_set_timeout(t, 120);
    tcase_set_tags(t, "long");
    tcase_add_test(t, what_a_carriage_s_model_lacks_is_told_in_its_units);
    suite_add_tcase(s, t);
    return s;
}
