/* A joint that slides: metres, newtons and kilograms from the file to the report. */
#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mechkit/ident.h"
#include "mechkit/log.h"
#include "mechkit/model.h"
#include "mechkit/safety.h"
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

/* 12 s of the carriage at 500 Hz by Runge and Kutta's method with steps of 20 us: position in
 * units of 1 m over `size` as a linear scale of 1 um reads it, force in N, held for a sample. */
static const char *axis(const char *name, double size, double more)
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
        fprintf(f, "%.3f,%.9f,%.6f\n", t, size * 1e-6 * round(x / 1e-6 + 0.4 * sin(1e4 * t * t)),
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
    const char *log = imported(axis("axis.csv", 1e3, 0.0)), *fitted = scratch("axis_fitted.ini");
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
    const char *log = imported(axis("one_way.csv", 1e3, 80.0)), *to = scratch("axis_report");
    char report[512];
    int code = run_mechkit(out, sizeof out, "explain --model %s --out %s %s",
                           guess("joint_unit = m\nencoder_resolution = 1e-6\n"), to, log);
    ck_assert_msg(code == 0, "%d %s", code, out);
    const char *named = strstr(out, "viscous-asymmetry at joint 1: difference ");
    double difference = 0.0;
    ck_assert_msg(named && strstr(out, "rms in mm"), "%s", out);
    ck_assert_int_eq(sscanf(named, "viscous-asymmetry at joint 1: difference %lf", &difference), 1);
    ck_assert_double_eq_tol(difference, 80.0, 1.0);
    ck_assert_msg(!strstr(out, "rad") && strstr(out, "N rms"), "%s", out);
    ck_assert_ptr_nonnull(strstr(named, "N s/m"));
    snprintf(report, sizeof report, "%s/report.json", to);
    json = slurp_file(report);
    const char *budget = strstr(json, "\"budget\"");
    ck_assert_ptr_nonnull(budget);
    const char *unit = strstr(budget, "\"unit\"");
    ck_assert_msg(unit && strcspn(unit, "m") < strcspn(unit, "]") && !strstr(json, "N m s/rad"),
                  "%.200s", budget);
    free(json);
    snprintf(report, sizeof report, "%s/report.html", to);
    char *html = slurp_file(report);
    ck_assert_ptr_nonnull(strstr(html, "q1 simulated - measured, m<"));
    ck_assert_ptr_nonnull(strstr(html, "speed of the joint, m/s"));
    ck_assert_ptr_nonnull(strstr(html, "position of the joint, m<"));
    free(html);
}
END_TEST

START_TEST(a_log_in_metres_is_not_taken_for_radians)
{
    char out[4096];
    const char *log = imported(axis("axis.csv", 1e3, 0.0));
    int code = run_mechkit(out, sizeof out, "identify --model %s --out %s %s", guess(""),
                           scratch("never.ini"), log);
    ck_assert_msg(code != 0 && strstr(out, "joint 1 is in m in the log, in rad in the model"),
                  "%d %s", code, out);
}
END_TEST

static void lacks_turns(const char *text)
{
    ck_assert_msg(!strstr(text, "rad") && !strstr(text, "N m"), "%s", text);
}

/* The record of a log, its positions multiplied by `size`; fitted from the same guess in the new
 * unit. */
static void fit_scaled(const char *path, double size, double *p)
{
    static struct mk_ident_result result;
    struct mk_error err = MK_ERROR_INIT;
    struct mk_log *log = NULL, *scaled = NULL;
    struct mk_model m;
    ck_assert_int_eq(mk_log_read(path, &log, &err), MK_OK);
    ck_assert_int_eq(mk_log_create(log->rows, &scaled), MK_OK);
    static const char *const names[] = {"t", "q1", "tau"};
    for (int i = 0; i < 3; i++) {
        double *to = mk_log_add_column(scaled, names[i]);
        const double *from = mk_log_get(log, names[i]);
        for (size_t k = 0; k < log->rows; k++)
            to[k] = from[k] * (i == 1 ? size : 1.0);
    }
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &m);
    ck_assert_int_eq(mk_model_set_linear(&m, 0, size == 1.0, &err), MK_OK);
    m.u_max = 400.0, m.u_to_torque = 1.0;
    m.encoder_cpr[0] = 0, m.encoder_resolution[0] = 1e-6 * size;
    m.parameter[0] = 60.0 / size, m.parameter[1] = 100.0 / size, m.parameter[2] = 10.0;
    const struct mk_log *const logs[] = {scaled};
    ck_assert_msg(mk_identify(&m, logs, 1, NULL, &result, &err) == MK_OK, "%s", err.message);
    memcpy(p, result.model.parameter, 3 * sizeof *p);
    mk_log_free(log);
    mk_log_free(scaled);
}

/* A hundred times the positions, as angles of a wheel. */
START_TEST(an_answer_does_not_depend_on_the_unit)
{
    const char *log = imported(axis("axis.csv", 1e3, 0.0));
    double metres[3], radians[3];
    fit_scaled(log, 1.0, metres);
    fit_scaled(log, 100.0, radians);
    ck_assert_double_eq_tol(metres[0], 100.0 * radians[0], 1e-4 * MASS);
    ck_assert_double_eq_tol(metres[1], 100.0 * radians[1], 1e-4 * VISCOUS);
    ck_assert_double_eq_tol(metres[2], radians[2], 1e-4 * COULOMB);
}
END_TEST

static const char axis_map[] = "[rig]\nkind = inertia-wheel\njoint_unit = m\n"
                               "encoder_resolution = 1e-6\n[t]\ncolumn = t\n[q1]\ncolumn = x\n"
                               "unit = %s\n[tau]\ncolumn = force\n";

START_TEST(metres_and_millimetres_make_the_same_log)
{
    static const struct {
        const char *unit;
        double size;
    } units[] = {{"m", 1.0}, {"mm", 1e3}};
    char map[400], out[2048], to[80];
    double q[2];
    for (int i = 0; i < 2; i++) {
        snprintf(map, sizeof map, axis_map, units[i].unit);
        snprintf(to, sizeof to, "%s", scratch("length_log.csv"));
        int code = run_mechkit(out, sizeof out, "import %s --map %s --out %s",
                               axis("length.csv", units[i].size, 0.0),
                               scratch_text("length.map", map), to);
        ck_assert_msg(code == 0, "%s", out);
        struct mk_log *log = NULL;
        ck_assert_int_eq(mk_log_read(to, &log, NULL), MK_OK);
        ck_assert_str_eq(mk_log_find_meta(log, "joint_unit"), "m");
        ck_assert_str_eq(mk_log_find_meta(log, "encoder_resolution"), "1e-06");
        q[i] = mk_log_get(log, "q1")[3000];
        mk_log_free(log);
    }
    ck_assert(fabs(q[0]) > 1e-3);
    ck_assert_double_eq_tol(q[0], q[1], 1e-9);
    snprintf(map, sizeof map, axis_map, "deg");
    int code = run_mechkit(out, sizeof out, "import %s --map %s --out %s", scratch("length.csv"),
                           scratch_text("deg.map", map), to);
    ck_assert_msg(code == 3 && strstr(out, "deg is no unit of q1: m, cm, mm or um"), "%s", out);
}
END_TEST

START_TEST(a_log_in_radians_is_not_taken_for_metres)
{
    char out[2048], log[80];
    snprintf(log, sizeof log, "%s",
             scratch_text("rad.csv", "# joint_unit: rad\nt,q1,tau\n0,0,0\n0.1,0,1\n"));
    int code = run_mechkit(out, sizeof out, "simulate --model %s --input %s --out %s",
                           guess("joint_unit = m\n"), log, scratch("never.csv"));
    ck_assert_msg(code == 3 && strstr(out, "joint 1 is in rad in the log, in m in the model"), "%s",
                  out);
}
END_TEST

START_TEST(limits_of_a_carriage_are_a_hundredth_of_a_wheel_s)
{
    struct mk_model wheel, carriage;
    struct mk_safety_limits turning, sliding;
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &wheel);
    carriage = wheel;
    ck_assert_int_eq(mk_model_set_linear(&carriage, 0, true, NULL), MK_OK);
    mk_safety_default(&wheel, 0.002, &turning);
    mk_safety_default(&carriage, 0.002, &sliding);
    ck_assert_double_eq_tol(sliding.v_max[0], 0.01 * turning.v_max[0], 1e-12);
    ck_assert_double_eq_tol(sliding.rest_tolerance[0], 0.01 * turning.rest_tolerance[0], 1e-12);
    ck_assert_double_eq_tol(sliding.jump_rad[0], 1.25 * sliding.v_max[0] * 0.002 + 4e-6, 1e-12);
}
END_TEST

static const char *driven(const char *commands, int wanted, char *out, size_t size)
{
    char script[80], model[80];
    snprintf(script, sizeof script, "%s", scratch_text("drive.cmd", commands));
    snprintf(model, sizeof model, "%s", guess("joint_unit = m\nencoder_resolution = 1e-6\n"));
    int code = run_mechkit(out, size, "run %s --model %s --fast --out %s", script, model,
                           scratch("slide_runs"));
    ck_assert_msg(code == wanted, "%d %s", code, out);
    return scratch("slide_runs/drive.csv");
}

/* Through `run`: gains, a speed in m/s, a log that says its unit, a limit that trips, a plot. */
START_TEST(a_virtual_carriage_is_driven_in_metres)
{
    char out[4096], path[120];
    driven("setup pi-speed\nlimit dq1_max 0.1\nstart\nwait 2\n", 1, out, sizeof out);
    ck_assert_msg(strstr(out, "fault speed (joint 1)") != NULL, "%s", out);
    snprintf(path, sizeof path, "%s",
             driven("setup pi-speed\nshow gains\nset speed 0.2\nstart\nwait 2\n"
                    "expect dq1 within 2% of 0.2\nhalt\nsave! drive.csv\n",
                    0, out, sizeof out));
    ck_assert_msg(strstr(out, " s/m ") && strstr(out, " m/s rms"), "%s", out);
    lacks_turns(out);
    struct mk_log *log = NULL;
    ck_assert_int_eq(mk_log_read(path, &log, NULL), MK_OK);
    ck_assert_str_eq(mk_log_find_meta(log, "joint_unit"), "m");
    ck_assert_str_eq(mk_log_find_meta(log, "encoder_resolution"), "1e-06");
    mk_log_free(log);
    if (!have_program("gnuplot", "a_virtual_carriage_is_driven_in_metres: labels of its plot"))
        return;
    int code = run_mechkit(out, sizeof out, "plot %s --phase --out %s", path, scratch("slide.svg"));
    ck_assert_msg(code == 0, "%s", out);
    char *svg = slurp_file(scratch("slide.svg"));
    ck_assert_msg(strstr(svg, "q1 [m]") && strstr(svg, "dq1 [m/s]") && !strstr(svg, "[rad"), "%s",
                  svg);
    free(svg);
}
END_TEST

START_TEST(simple_experiments_of_a_carriage_are_in_its_units)
{
    char out[8192], path[120], model[80];
    snprintf(path, sizeof path, "%s",
             driven("setup pi-speed\nref 0.3*step(0)-0.1*step(3)-0.4*step(6)-0.1*step(9)\n"
                    "start\nwait 12\nhalt\nsave! drive.csv\n",
                    0, out, sizeof out));
    snprintf(model, sizeof model, "%s", guess("joint_unit = m\nencoder_resolution = 1e-6\n"));
    int code = run_mechkit(out, sizeof out, "measure friction --model %s %s", model, path);
    ck_assert_msg(code == 0, "%s", out);
    const char *found = strstr(out, "p2, mean of both ways");
    double viscous = 0.0;
    ck_assert_msg(found && sscanf(found, "p2, mean of both ways %lf", &viscous) == 1, "%s", out);
    ck_assert_double_eq_tol(viscous, 100.0, 2.0);
    ck_assert_msg(strstr(found, "N s/m") != NULL, "%s", out);
    lacks_turns(out);
}
END_TEST

/* --- a carriage that carries a pole ------------------------------------------------------- */

/* A rod of 0.2 kg and 0.6 m on a cart of 0.8 kg. With the pivot's forces h along the track and n
 * upwards, A and B the accelerations of cart and rod, w the rod's speed,
 *     CART A = drive - h,    ROD_INERTIA B = HALF (n sin - h cos) - POLE_VISCOUS w,
 *     h = POLE (A + HALF (B cos - w^2 sin)),    n = POLE (9.81 - HALF (B sin + w^2 cos));
 * h and n are eliminated below. */
#define CART 0.8
#define POLE 0.2
#define HALF 0.3
#define ROD_INERTIA (POLE * 0.36 / 12.0)
#define CART_VISCOUS 4.0
#define CART_COULOMB 0.5
#define POLE_VISCOUS 2e-3

static void cart_pole_motion(double force, const double *x, double *dx)
{
    double s = sin(x[1]), c = cos(x[1]), w = x[3];
    double drive = force - CART_VISCOUS * x[2] - CART_COULOMB * tanh(1500.0 * x[2]);
    double m11 = CART + POLE, m12 = POLE * HALF * c, m22 = ROD_INERTIA + POLE * HALF * HALF;
    double r1 = drive + POLE * HALF * s * w * w;
    double r2 = POLE * 9.81 * HALF * s - POLE_VISCOUS * w;
    double det = m11 * m22 - m12 * m12;
    dx[0] = x[2];
    dx[1] = w;
    dx[2] = (m22 * r1 - m12 * r2) / det;
    dx[3] = (m11 * r2 - m12 * r1) / det;
}

static void rk4(double h, double force, double *x)
{
    double a[4], b[4], c[4], d[4], y[4];
    cart_pole_motion(force, x, a);
    for (int i = 0; i < 4; i++)
        y[i] = x[i] + 0.5 * h * a[i];
    cart_pole_motion(force, y, b);
    for (int i = 0; i < 4; i++)
        y[i] = x[i] + 0.5 * h * b[i];
    cart_pole_motion(force, y, c);
    for (int i = 0; i < 4; i++)
        y[i] = x[i] + h * c[i];
    cart_pole_motion(force, y, d);
    for (int i = 0; i < 4; i++)
        x[i] += h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]);
}

/* 12 s at 500 Hz from rest below, position in mm and the angle in degrees from hanging, the other
 * way round. */
static const char *cart_pole_file(void)
{
    enum { ROWS = 6000, STEPS = 50 };
    const char *path = scratch("cart_pole_file.csv");
    FILE *f = fopen(path, "w");
    ck_assert_ptr_nonnull(f);
    fprintf(f, "t,x,angle,force\n");
    double x[4] = {0.0, M_PI, 0.0, 0.0};
    for (int k = 0; k < ROWS; k++) {
        double t = 2e-3 * k, force = 5.0 * sin(4.6 * t) + 3.0 * sin(2.1 * t + 0.3 * t * t);
        double read[2] = {1e-5 * round(x[0] / 1e-5 + 0.3 * sin(1e4 * t)),
                          1e-3 * round((M_PI - x[1]) / 1e-3 + 0.3 * cos(1e4 * t))};
        fprintf(f, "%.3f,%.4f,%.6f,%.6f\n", t, 1e3 * read[0], read[1] * 180.0 / M_PI, force);
        for (int i = 0; i < STEPS; i++)
            rk4(2e-3 / STEPS, force, x);
    }
    ck_assert_int_eq(fclose(f), 0);
    return path;
}

static const char *cart_pole_model(const char *name, const char *rig)
{
    char text[400];
    snprintf(text, sizeof text,
             "[rig]\nkind = cart-pole\n%su_max = 10\nencoder_resolution = 1e-5 1e-3\n"
             "[parameters]\np1 = 1.4\np2 = 0.04\np3 = 0.02\np4 = 2\np5 = 0.2\n"
             "[effect.viscous]\njoint = 2\ncoefficient = 1e-3\n",
             rig);
    return scratch_text(name, text);
}

START_TEST(a_cart_pole_s_log_gives_its_masses_back)
{
    char out[8192];
    struct mk_model m;
    const char *log = scratch("cart_pole.csv"), *fitted = scratch("cart_pole_fitted.ini");
    const char *map = scratch_text(
        "cart_pole.map",
        "[rig]\nkind = cart-pole\nencoder_resolution = 1e-5 1e-3\n[t]\ncolumn = t\n[q1]\n"
        "column = x\nunit = mm\n[q2]\ncolumn = angle\nunit = deg\nsign = -1\n"
        "offset = 3.14159265358979\n[tau]\ncolumn = force\n");
    int code =
        run_mechkit(out, sizeof out, "import %s --map %s --out %s", cart_pole_file(), map, log);
    ck_assert_msg(code == 0, "%s", out);
    code = run_mechkit(out, sizeof out, "identify --model %s --out %s %s",
                       cart_pole_model("cart_pole.ini", ""), fitted, log);
    ck_assert_msg(code == 0, "%s", out);
    ck_assert_int_eq(mk_model_read(fitted, &m, NULL), MK_OK);
    const double want[5] = {CART + POLE, POLE * HALF, ROD_INERTIA + POLE * HALF * HALF,
                            CART_VISCOUS, CART_COULOMB};
    for (int i = 0; i < 5; i++)
        ck_assert_msg(fabs(m.parameter[i] / want[i] - 1.0) < 0.01, "p%d = %g, not %g", i + 1,
                      m.parameter[i], want[i]);
    ck_assert_double_eq_tol(m.effect[0].value[0], POLE_VISCOUS, 0.05 * POLE_VISCOUS);
}
END_TEST

START_TEST(a_cart_pole_slides_at_joint_1_whether_its_file_says_so_or_not)
{
    struct mk_model said, unsaid;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(
        mk_model_read(cart_pole_model("said.ini", "joint_unit = m rad\n"), &said, &err), MK_OK);
    ck_assert_int_eq(mk_model_read(cart_pole_model("unsaid.ini", ""), &unsaid, &err), MK_OK);
    ck_assert_mem_eq(said.joint_linear, unsaid.joint_linear, sizeof said.joint_linear);
    ck_assert(unsaid.joint_linear[0] && !unsaid.joint_linear[1]);
    ck_assert_double_eq(unsaid.friction_sharpness, MK_FRICTION_SHARPNESS_SLIDING);
    ck_assert_double_eq(unsaid.u_to_torque, 1.0);
    int status =
        mk_model_read(cart_pole_model("turned.ini", "joint_unit = rad rad\n"), &said, &err);
    ck_assert_int_eq(status, MK_ERR_PARSE);
    ck_assert_ptr_nonnull(strstr(err.message, "joint 1 of the cart-pole slides: its unit is m"));
}
END_TEST

START_TEST(a_cart_that_runs_away_is_stopped_on_its_track)
{
    char out[4096];
    const char *script = scratch_text("away.cmd", "setup open-loop\nref 6\nstart\nwait 3\n");
    int code =
        run_mechkit(out, sizeof out, "run %s --fast --model %s/models/cart-pole.ini --out %s",
                    script, MK_SOURCE_DIR, scratch(""));
    ck_assert_msg(code == 1 && strstr(out, "fault travel (joint 1)"), "%d %s", code, out);
}
END_TEST

START_TEST(a_cart_pole_s_logs_and_gains_say_metres_and_radians)
{
    char out[8192], path[120];
    snprintf(path, sizeof path, "%s", scratch("held.csv"));
    const char *script = scratch_text("held.cmd", "setup cart-pole\nstart\nwait-until balanced "
                                                  "within 6\nexpect balanced for 3\nexpect q1 "
                                                  "within 0.1 of 0\nhalt\nsave! held.csv\n");
    int code = run_mechkit(out, sizeof out, "run %s --fast --out %s", script, scratch(""));
    ck_assert_msg(code == 0, "%s", out);
    struct mk_log *log = NULL;
    ck_assert_int_eq(mk_log_read(path, &log, NULL), MK_OK);
    ck_assert_str_eq(mk_log_find_meta(log, "rig"), "cart-pole");
    ck_assert_str_eq(mk_log_find_meta(log, "joint_unit"), "m rad");
    const double *x = mk_log_get(log, "q1"), track = mk_plant(MK_PLANT_CART_POLE)->joint_travel[0];
    for (size_t k = 0; k < log->rows; k++)
        ck_assert_double_le(fabs(x[k]), track);
    mk_log_free(log);
    code = run_mechkit(out, sizeof out, "design --model %s/models/cart-pole.ini", MK_SOURCE_DIR);
    ck_assert_msg(code == 0 && strstr(out, "q1 = 0 m, q2 = 0 rad"), "%s", out);
}
END_TEST

START_TEST(a_cart_pole_s_parameters_are_in_the_units_of_their_joints)
{
    struct mk_model m;
    mk_model_default(MK_PLANT_CART_POLE, &m);
    static const char *const si[] = {"kg", "kg m", "kg m^2", "N s/m", "N"};
    static const char *const by_command[] = {"u s^2/m", "u s^2", "u m s^2/rad", "u s/m", "u"};
    for (int i = 0; i < 5; i++)
        ck_assert_str_eq(mk_model_parameter_unit(&m, i), si[i]);
    m.u_to_torque = 6.21;
    for (int i = 0; i < 5; i++)
        ck_assert_str_eq(mk_model_parameter_unit(&m, i), by_command[i]);
    ck_assert_str_eq(mk_model_unit(&m, 1, "N m s/rad"), "u m s/rad");
}
END_TEST

Suite *suite_slides(void)
{
    Suite *s = suite_create("slides");
    TCase *t = tcase_create("metres");
    tcase_set_timeout(t, 120);
    tcase_add_test(t, a_carriage_is_identified_in_kilograms_and_newtons);
    tcase_add_test(t, a_log_in_metres_is_not_taken_for_radians);
    tcase_add_test(t, an_answer_does_not_depend_on_the_unit);
    tcase_add_test(t, metres_and_millimetres_make_the_same_log);
    tcase_add_test(t, a_log_in_radians_is_not_taken_for_metres);
    tcase_add_test(t, limits_of_a_carriage_are_a_hundredth_of_a_wheel_s);
    tcase_add_test(t, a_virtual_carriage_is_driven_in_metres);
    tcase_add_test(t, simple_experiments_of_a_carriage_are_in_its_units);
    tcase_add_test(t, a_cart_pole_slides_at_joint_1_whether_its_file_says_so_or_not);
    tcase_add_test(t, a_cart_pole_s_parameters_are_in_the_units_of_their_joints);
    tcase_add_test(t, a_cart_that_runs_away_is_stopped_on_its_track);
    tcase_add_test(t, a_cart_pole_s_logs_and_gains_say_metres_and_radians);
    suite_add_tcase(s, t);
    t = tcase_create("searches in metres");
    tcase_set_timeout(t, 120);
    tcase_set_tags(t, "long");
    tcase_add_test(t, what_a_carriage_s_model_lacks_is_told_in_its_units);
    tcase_add_test(t, a_cart_pole_s_log_gives_its_masses_back);
    suite_add_tcase(s, t);
    return s;
}
