/* Spectra against signals whose spectra are known, and plots as a user gets them. */
#include "suites.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/spectrum.h"
#include "console/commands/step_response.h"
#include "support/files.h"
#include "support/program.h"
#include "support/spawn.h"

enum { N = 16384 };

static double noise(void)
{
    static unsigned long long state = 7;
    state = state * 6364136223846793005ULL + 1442695040888963407ULL;
    return (double)(state >> 11) / 9007199254740992.0 - 0.5;
}

START_TEST(a_transform_is_the_sum_that_defines_it)
{
    enum { M = 64 };
    double re[M], im[M], was_re[M], was_im[M];
    for (int i = 0; i < M; i++) {
        was_re[i] = re[i] = noise();
        was_im[i] = im[i] = noise();
    }
    mk_fft(re, im, M);
    for (int k = 0; k < M; k++) {
        double r = 0, m = 0;
        for (int i = 0; i < M; i++) {
            double c = cos(2 * M_PI * i * k / M), s = -sin(2 * M_PI * i * k / M);
            r += was_re[i] * c - was_im[i] * s;
            m += was_re[i] * s + was_im[i] * c;
        }
        ck_assert_double_eq_tol(re[k], r, 1e-12);
        ck_assert_double_eq_tol(im[k], m, 1e-12);
    }
}
END_TEST

START_TEST(a_spectrum_holds_the_power_of_its_signal_at_its_frequency)
{
    static double x[N], y[N];
    const double rate = 1000, f = 62.5, amplitude = 3;
    struct mk_spectrum s;
    for (int i = 0; i < N; i++) {
        x[i] = amplitude * sin(2 * M_PI * f * i / rate) + 5; /* a mean is no power */
        y[i] = noise();
    }
    ck_assert_int_eq(mk_spectrum_welch(x, y, N, rate, 1024, &s), MK_OK);
    ck_assert_uint_eq(s.count, 512);
    ck_assert_double_eq_tol(s.f[s.count - 1], rate / 2, 1e-9);
    double px = 0, py = 0, near = 0;
    for (size_t k = 0; k < s.count; k++) {
        px += s.xx[k] * s.f[0];
        py += s.yy[k] * s.f[0];
        near += fabs(s.f[k] - f) < 2.5 * s.f[0] ? s.xx[k] * s.f[0] : 0;
    }
    ck_assert_double_eq_tol(px, amplitude * amplitude / 2, 1e-6);
    ck_assert_double_eq_tol(near, px, 1e-6);
    ck_assert_double_eq_tol(py, 1.0 / 12, 0.003);
    mk_spectrum_free(&s);
}
END_TEST

START_TEST(the_response_of_a_filter_is_its_own)
{
    static double x[N], y[N];
    struct mk_spectrum s;
    double state = 0;
    for (int i = 0; i < N; i++) {
        x[i] = noise();
        y[i] = state; /* one sample late: the phase runs beyond -180 degrees */
        state = 0.9 * state + 0.1 * x[i];
    }
    ck_assert_int_eq(mk_spectrum_welch(x, y, N, 1000, 512, &s), MK_OK);
    for (size_t k = 20; k < s.count; k += 10) {
        double w = 2 * M_PI * s.f[k] / 1000;
        double re = 1 - 0.9 * cos(w), im = 0.9 * sin(w), phase = -atan2(im, re) - w;
        ck_assert_double_eq_tol(s.gain[k], 0.1 / hypot(re, im), 0.02 * 0.1 / hypot(re, im));
        ck_assert_double_eq_tol(s.phase[k], phase, 0.02);
        ck_assert_double_gt(s.coherence[k], 0.98);
    }
    mk_spectrum_free(&s);
    ck_assert_int_eq(mk_spectrum_welch(x, y, 8, 1000, 0, &s), MK_ERR_RANGE);
}
END_TEST

/* --- plots ------------------------------------------------------------------------------- */

static bool no_gnuplot(const char *test)
{
    return !have_program("gnuplot", test);
}

static void check_svg(const char *args, const char *const *texts)
{
    char out[4096];
    const char *svg = scratch("plot.svg");
    int code = run_mechkit(out, sizeof out, "plot %s --out %s", args, svg);
    ck_assert_msg(code == 0 && !*out, "%s: %s", args, out);
    char *text = slurp_file(svg);
    ck_assert_ptr_nonnull(text);
    for (; *texts; texts++)
        ck_assert_msg(strstr(text, *texts) != NULL, "%s: no '%s' in the plot", args, *texts);
    ck_assert_ptr_nonnull(strstr(text, "</svg>"));
    free(text);
}

START_TEST(every_kind_of_plot_is_drawn)
{
    if (no_gnuplot("every_kind_of_plot_is_drawn"))
        return;
    char args[1200], one[256], two[256];
    snprintf(one, sizeof one, "%s", open_loop_log("pendubot", "1.5*sin(6*t)", 1.0));
    snprintf(two, sizeof two, "%s", open_loop_log("furuta", "1.5*sin(9*t)", 1.0));
    check_svg(one, (const char *const[]){"q1 [rad]", "q2 [rad]", "u [command units]", "dq2 [rad/s]",
                                         "open-loop on a pendubot", NULL});
    snprintf(args, sizeof args, "%s %s --title 'it''s two'", one, two);
    check_svg(args, (const char *const[]){"pendubot.csv", "furuta.csv", "its two", NULL});
    snprintf(args, sizeof args, "%s --spectrum", one);
    check_svg(args, (const char *const[]){"coherence", "phase [deg]", "q2 [rad^2/Hz]", NULL});
    snprintf(args, sizeof args, "%s %s --phase --size 900x400", one, two);
    check_svg(args, (const char *const[]){"dq1 [rad/s]", "dq2 [rad/s]", "2 runs", NULL});
    char out[4096];
    int code = run_mechkit(
        out, sizeof out, "simulate --model %s/models/pendubot.ini --input %s --out %s --window 0.5",
        MK_SOURCE_DIR, one, scratch("pred.csv"));
    ck_assert_msg(code == 0, "%s", out);
    snprintf(args, sizeof args, "%s --with %s", one, scratch("pred.csv"));
    check_svg(args, (const char *const[]){"model", "error [rad]", NULL});
}
END_TEST

START_TEST(a_plot_without_a_file_is_drawn_in_the_terminal)
{
    if (no_gnuplot("a_plot_without_a_file_is_drawn_in_the_terminal"))
        return;
    static char out[16384];
    const char *log = open_loop_log("pendulum", "1.5*sin(6*t)", 1.0);
    int code = run_mechkit(out, sizeof out, "plot %s --size 60x15", log);
    ck_assert_int_eq(code, 0);
    int lines = 0, longest = 0;
    for (const char *line = out; *line; line += strcspn(line, "\n") + 1, lines++)
        longest = (int)strcspn(line, "\n") > longest ? (int)strcspn(line, "\n") : longest;
    ck_assert_int_le(longest, 60);
    ck_assert_int_eq(lines, 2 * 15);
    ck_assert_ptr_null(strchr(out, '\f'));
}
END_TEST

/* `script` from util-linux gives the program a terminal of 24 x 80. */
START_TEST(a_plot_in_a_terminal_fits_it)
{
    static char out[32768];
    if (no_gnuplot("a_plot_in_a_terminal_fits_it") ||
        !have_program("script", "a_plot_in_a_terminal_fits_it"))
        return;
    const char *log = open_loop_log("pendubot", "1.5*sin(6*t)", 1.0);
    int code = run_command(out, sizeof out,
                           "script -qec 'stty rows 24 cols 80; %s plot %s' /dev/null </dev/null",
                           MK_TEST_APP, log);
    ck_assert_msg(code == 0, "%s", out);
    int lines = 0, longest = 0;
    for (const char *line = out; *line; line += strcspn(line, "\n") + 1, lines++)
        longest = (int)strcspn(line, "\r\n") > longest ? (int)strcspn(line, "\r\n") : longest;
    ck_assert_int_le(longest, 80);
    ck_assert_int_ge(lines, 3 * 7);
    ck_assert_int_le(lines, 23); /* a row is the prompt's */
}
END_TEST

/* The reference that the setup follows, and the sample from which new gains held. */
START_TEST(a_plot_has_the_reference_and_the_changes_of_gains)
{
    static char out[4096];
    if (no_gnuplot("a_plot_has_the_reference_and_the_changes_of_gains"))
        return;
    const char *script = scratch_text("ref.cmd", "setup pi-speed\nref 20\nstart\nwait 0.5\n"
                                                 "gains 0.1 1\nwait 0.5\nhalt\nsave ref.csv\n");
    ck_assert_int_eq(
        run_mechkit(out, sizeof out, "run %s --fast --out %s", script, scratch("refs")), 0);
    check_svg(scratch("refs/ref.csv"), (const char *const[]){"reference", "gains", NULL});
    const char *undriven =
        scratch_text("in.cmd", "setup open-loop\ninput 1\nstart\nwait 0.5\nhalt\nsave in.csv\n");
    ck_assert_int_eq(run_mechkit(out, sizeof out,
                                 "run %s --fast --model %s/models/pendulum.ini --out %s", undriven,
                                 MK_SOURCE_DIR, scratch("refs")),
                     0);
    ck_assert_int_eq(
        run_mechkit(out, sizeof out, "plot %s --out %s", scratch("refs/in.csv"), scratch("in.svg")),
        0);
    char *svg = slurp_file(scratch("in.svg"));
    ck_assert_ptr_null(strstr(svg, "reference"));
    ck_assert_ptr_null(strstr(svg, "gains"));
    free(svg);
}
END_TEST

/* --- steps ------------------------------------------------------------------------------- */

enum { STEP_ROWS = 4000 };
static double step_t[STEP_ROWS], step_ref[STEP_ROWS], step_y[STEP_ROWS];

/* Of a first-order lag: rise T ln 9, settled to 2 % after T ln 50, no overshoot. */
START_TEST(the_step_of_a_lag_has_the_figures_of_the_textbook)
{
    struct step_response s[4];
    const double lag = 0.2;
    for (int i = 0; i < STEP_ROWS; i++) {
        step_t[i] = 1e-3 * i;
        bool after = step_t[i] >= 1.0;
        step_ref[i] = after ? 30.0 : 10.0;
        step_y[i] = after ? 30.0 - 20.0 * exp(-(step_t[i] - 1.0) / lag) : 10.0;
    }
    step_y[1100] = (double)NAN;
    ck_assert_uint_eq(step_responses(step_t, step_ref, step_y, STEP_ROWS, s, 4), 1);
    ck_assert_double_eq_tol(s[0].t, 1.0, 1e-9);
    ck_assert_double_eq(s[0].from, 10.0);
    ck_assert_double_eq(s[0].to, 30.0);
    ck_assert_double_eq_tol(s[0].rise_s, lag * log(9.0), 1e-3);
    ck_assert_double_eq_tol(s[0].settle_s, lag * log(50.0), 1.1e-3);
    ck_assert_double_eq(s[0].overshoot, 0.0);
}
END_TEST

/* Of a second-order lag with damping 0.5: 16.3 % overshoot, downwards as well as upwards. */
START_TEST(the_overshoot_of_a_step_has_its_textbook_s_size)
{
    struct step_response s[4];
    const double w = 20.0, z = 0.5, wd = w * sqrt(1.0 - z * z);
    for (int i = 0; i < STEP_ROWS; i++) {
        step_t[i] = 1e-3 * i;
        double x = fmod(step_t[i], 2.0), size = step_t[i] < 2.0 ? 8.0 : -8.0;
        step_ref[i] = step_t[i] < 2.0 ? 8.0 : 0.0;
        step_y[i] = (size > 0 ? 0.0 : 8.0) +
                    size * (1.0 - exp(-z * w * x) * (cos(wd * x) + z * w / wd * sin(wd * x)));
    }
    ck_assert_uint_eq(step_responses(step_t, step_ref, step_y, STEP_ROWS, s, 4), 2);
    for (int k = 0; k < 2; k++)
        ck_assert_double_eq_tol(s[k].overshoot, exp(-M_PI * z / sqrt(1.0 - z * z)), 1e-3);
}
END_TEST

START_TEST(a_ramp_is_no_step_and_what_never_arrives_is_not_settled)
{
    struct step_response s[4];
    for (int i = 0; i < STEP_ROWS; i++) {
        step_t[i] = 1e-3 * i;
        step_ref[i] = step_t[i];
        step_y[i] = 0.0;
    }
    ck_assert_uint_eq(step_responses(step_t, step_ref, step_y, STEP_ROWS, s, 4), 0);
    for (int i = STEP_ROWS / 2; i < STEP_ROWS; i++)
        step_ref[i] = step_ref[STEP_ROWS / 2]; /* nor is its end */
    ck_assert_uint_eq(step_responses(step_t, step_ref, step_y, STEP_ROWS, s, 4), 0);
    for (int i = 0; i < STEP_ROWS; i++)
        step_ref[i] = 5.0, step_y[i] = i ? 2.0 : 0.0;
    ck_assert_uint_eq(step_responses(step_t, step_ref, step_y, STEP_ROWS, s, 4), 1);
    ck_assert(isnan(s[0].rise_s) && isnan(s[0].settle_s));
}
END_TEST

START_TEST(the_summary_of_a_run_has_its_steps)
{
    static char out[4096];
    const char *script = scratch_text("st.cmd", "setup pi-speed\nref 20\nstart\nwait 1\nref 40\n"
                                                "wait 1\nhalt\nsave st.csv\n");
    ck_assert_int_eq(
        run_mechkit(out, sizeof out, "run %s --fast --out %s", script, scratch("steps")), 0);
    ck_assert_msg(strstr(out, "step at 1.00 s, 20"), "%s", out);
    ck_assert_int_eq(run_mechkit(out, sizeof out, "summary %s", scratch("steps/st.csv")), 0);
    ck_assert_msg(strstr(out, "step at 0.00 s, 0 to 20 rad/s: rise 0."), "%s", out);
    ck_assert_msg(strstr(out, "step at 1.00 s, 20") && strstr(out, "within 2 % after 0."), "%s",
                  out);
}
END_TEST

START_TEST(the_summary_of_a_log_has_its_command_whatever_it_is_called)
{
    static const struct {
        const char *log, *says;
    } logs[] = {
        {"t,q1,u\n0,0,1\n1,0,-2.5\n", "|u| <= 2.50\n"},
        {"# rig: pendulum\nt,q1,tau\n0,0,0.0125\n1,0,-0.001\n", "|tau| <= 0.0125 N m\n"},
        {"# rig: cart-pole\n# joint_unit: m rad\nt,q1,q2,tau1\n0,0,0,3\n1,0,0,1\n",
         "|tau1| <= 3 N\n"},
        {"t,q1,q2,tau1,tau2\n0,0,0,3,1\n1,0,0,1,0.5\n", "|tau1| <= 3 N m  |tau2| <= 1 N m\n"},
        {"t,q1,tau_cmd\n0,0,\n1,0,1\n", "|tau_cmd| <= 1 N m (1 missing)\n"},
        {"t,q1,u\n0,0,\n1,0,nan\n", "u has no values\n"},
        {"t,q1\n0,0\n1,0\n", "no column for the command\n"},
        {"# input: none\nt,q1\n0,0\n1,0\n", "nothing drives it\n"},
        {"t,q1,u,flags\n0,0,0,4\n1,0,0,0\n", " 1 sample lost or late\n"},
    };
    char out[4096];
    for (size_t i = 0; i < sizeof logs / sizeof logs[0]; i++) {
        int code = run_mechkit(out, sizeof out, "summary %s", scratch_text("c.csv", logs[i].log));
        ck_assert_msg(code == 0 && strstr(out, logs[i].says), "%s: %d %s", logs[i].log, code, out);
    }
}
END_TEST

START_TEST(the_summary_of_a_log_refuses_what_is_infinite)
{
    static const struct {
        const char *log, *says;
    } logs[] = {{"t,q1,u\n0,0,1\n1,0,inf\n", "c.csv:3: u is infinite; a missing value is"},
                {"t,q1,tau2_cmd,tau1_cmd\n0,0,-inf,0\n1,0,0,0\n", "c.csv:2: tau2_cmd is infinite"},
                {"t,q1,u\n0,1e999,1\n1,0,0\n", "c.csv:2: q1 is infinite"},
                {"t,q1,u,spare\n0,0,1,inf\n1,0,0,1\n", NULL}};
    char out[4096];
    for (size_t i = 0; i < sizeof logs / sizeof logs[0]; i++) {
        int code = run_mechkit(out, sizeof out, "summary %s", scratch_text("c.csv", logs[i].log));
        ck_assert_msg(code == (logs[i].says ? 3 : 0), "%s: %d %s", logs[i].log, code, out);
        ck_assert_msg(!logs[i].says || strstr(out, logs[i].says), "%s: %s", logs[i].log, out);
        ck_assert_ptr_null(strstr(out, "<= inf"));
    }
}
END_TEST

START_TEST(what_a_log_says_of_itself_does_not_steer_the_terminal)
{
    char out[4096];
    const char *log = scratch_text("esc.csv", "# setup: a\x1b]0;b\x07\n# fault: \xff\xfe\xc2\x9b\n"
                                              "t,q1,u\n0,0,0\n1,0,0\n");
    ck_assert_int_eq(run_mechkit(out, sizeof out, "summary %s", log), 0);
    ck_assert_msg(strstr(out, "a\\x1b]0;b\\x07 ") && strstr(out, "FAULT \\xff\\xfe\\xc2\\x9b"),
                  "%s", out);
    log = scratch_text("esc.csv", "# rig: \xff\x1bm\nt,q1,u\n0,0,0\n1,0,0\n");
    ck_assert_int_eq(
        run_mechkit(out, sizeof out, "simulate --model models/pendulum.ini --input %s", log), 3);
    ck_assert_msg(strstr(out, "the rig \\xff\\x1bm, the model"), "%s", out);
}
END_TEST

/* The line of the catch is drawn after the label beside it, and columns are rounded. */
START_TEST(the_line_of_the_catch_leaves_its_label_alone)
{
    enum { ROWS = 100 };
    static char text[ROWS * 40], out[16384], says[40];
    if (no_gnuplot("the_line_of_the_catch_leaves_its_label_alone"))
        return;
    for (int caught = 5; caught < ROWS; caught += 7) {
        char *at = text + sprintf(text, "t,q1,u,phase\n");
        for (int i = 0; i < ROWS; i++)
            at +=
                sprintf(at, "%.2f,%.3f,%d,%d\n", i * 0.1, sin(i * 0.3), i % 2, i < caught ? 1 : 2);
        int code =
            run_mechkit(out, sizeof out, "plot %s --size 80x20", scratch_text("c.csv", text));
        snprintf(says, sizeof says, "caught at %.2f s", caught * 0.1);
        ck_assert_msg(code == 0 && strstr(out, says), "%s: %d\n%.2000s", says, code, out);
    }
}
END_TEST

/* Two logs, so that their names are in the legend. */
START_TEST(logs_of_any_name_are_plotted_whatever_the_user_s_settings)
{
    static const char *const names[] = {"'quoted'.csv", "\"two\".csv", "`id`.csv", "@x\\n$y.csv",
                                        "no\xff\xc3utf8.csv"};
    char out[1024], home[256], picture[256], other[256];
    if (!have_program("gnuplot", "logs_of_any_name_are_plotted_whatever_the_user_s_settings"))
        return;
    snprintf(home, sizeof home, "%s", scratch(".gnuplot"));
    scratch_text(".gnuplot", "this is an error\n");
    setenv("HOME", scratch("."), 1);
    snprintf(picture, sizeof picture, "%s", scratch("names.svg"));
    snprintf(other, sizeof other, "%s", scratch_text("o.csv", "t,q1,u\n0,1,2\n1,2,3\n2,0,1\n"));
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        setenv("ODD", scratch_text(names[i], "t,q1,u\n0,1,2\n1,2,3\n2,1,1\n"), 1);
        int code = run_command(out, sizeof out, "%s plot \"$ODD\" %s --out %s", MK_TEST_APP, other,
                               picture);
        ck_assert_msg(code == 0, "%s: %d %s", names[i], code, out);
        code = run_command(out, sizeof out, "iconv -f UTF-8 -t UTF-8 %s >/dev/null", picture);
        ck_assert_msg(code == 0, "%s: %s", names[i], out);
    }
    char *text = slurp_file(picture);
    ck_assert_ptr_nonnull(strstr(text, "no\\xff\\xc3utf8.csv"));
    free(text);
}
END_TEST

START_TEST(a_plot_that_cannot_be_written_says_so)
{
    char out[1024];
    if (!have_program("gnuplot", "a_plot_that_cannot_be_written_says_so"))
        return;
    const char *log = open_loop_log("pendubot", "1.5*sin(6*t)", 2.0);
    run_command(NULL, 0, "ln -s /dev/full %s", scratch("full.svg")); /* a disk without room */
    int code = run_mechkit(out, sizeof out, "plot %s --out %s", log, scratch("full.svg"));
    ck_assert_msg(code == 1 && strstr(out, "full.svg: cannot write: No space"), "%d %s", code, out);
    code = run_mechkit(out, sizeof out, "plot %s --out %s/none/x.svg", log, scratch("."));
    ck_assert_msg(code == 1 && strstr(out, "x.svg: cannot write: No such file"), "%d %s", code,
                  out);
    code = run_mechkit(out, sizeof out, "plot %s --out %s",
                       scratch_text("one.csv", "t,q1,q2,u\n0,1,2,3\n"), scratch("one.svg"));
    ck_assert_msg(code == 1 && strstr(out, "gnuplot cannot draw this: all points"), "%d %s", code,
                  out);
}
END_TEST

/* A script that is found in place of gnuplot. */
static void put_gnuplot(const char *script)
{
    char path[4096];
    ck_assert_int_eq(chmod(scratch_text("gnuplot", script), 0700), 0);
    snprintf(path, sizeof path, "%s:%s", scratch("."), getenv("PATH"));
    setenv("PATH", path, 1);
}

/* A shell and the loader end with the same code, 127. */
START_TEST(a_gnuplot_that_cannot_start_is_not_told_to_be_missing)
{
    char svg[256], log[256];
    snprintf(svg, sizeof svg, "%s", scratch("never.svg"));
    snprintf(log, sizeof log, "%s", scratch_text("never.csv", "t,q1,q2,u\n0,1,2,3\n1,2,3,4\n"));
    put_gnuplot("#!/bin/sh\necho 'gnuplot: error while loading shared libraries' >&2\nexit 127\n");
    struct outcome o = MECHKIT("plot", log, "--out", svg);
    ck_assert_int_eq(o.code, 1);
    ck_assert_msg(strstr(o.err, "error while loading") && !strstr(o.err, "install"), "%s", o.err);
    setenv("PATH", "/nowhere", 1);
    o = MECHKIT("plot", log, "--out", svg);
    ck_assert_int_eq(o.code, 1);
    ck_assert_msg(strstr(o.err, "gnuplot is not installed: install gnuplot-nox"), "%s", o.err);
    ck_assert_int_eq(count_files("never.svg*"), 0);
}
END_TEST

/* A gnuplot that takes its time: by then the picture's file has been begun. */
START_TEST(a_signal_while_it_is_drawn_leaves_nothing)
{
    static const int numbers[] = {SIGTERM, SIGINT, SIGHUP};
    char out[256], err[256], svg[256], begun[300], script[400], log[256];
    snprintf(out, sizeof out, "%s", scratch("out"));
    snprintf(err, sizeof err, "%s", scratch("err"));
    snprintf(svg, sizeof svg, "%s", scratch("ended.svg"));
    snprintf(begun, sizeof begun, "%s", scratch("begun"));
    snprintf(log, sizeof log, "%s", scratch_text("ended.csv", "t,q1,q2,u\n0,1,2,3\n1,2,3,4\n"));
    snprintf(script, sizeof script, "#!/bin/sh\ntouch %s\nexec sleep 3\n", begun);
    put_gnuplot(script);
    const char *const argv[] = {"mechkit", "plot", log, "--out", svg, NULL};
    pid_t child = spawn(argv, out, err);
    for (int i = 0; i < 2000 && access(begun, F_OK) != 0; i++)
        usleep(10000);
    ck_assert_int_eq(count_files("ended.svg*"), 1);
    kill(child, numbers[_i]);
    struct outcome o = finish(child, out, err);
    ck_assert_int_eq(o.code, -numbers[_i]);
    ck_assert_int_eq(count_files("ended.svg*"), 0);
}
END_TEST

START_TEST(a_temporary_file_that_cannot_be_written_is_said_to_be_one)
{
    char out[1024];
    const char *log = scratch_text("x.csv", "t,q1,q2,u\n0,0,0,0\n1,1,2,1\n");
    int code = run_command(out, sizeof out, "ulimit -f 0; " MK_TEST_APP " plot %s", log);
    ck_assert_msg(strstr(out, "cannot write a temporary file in /tmp: File too large"), "%d %s",
                  code, out);
}
END_TEST

START_TEST(a_log_without_a_number_to_draw_is_named)
{
    const char *log = scratch_text("missing.csv", "# input: none\nt,q1\n0,\n1,nan\n2,\n");
    struct outcome o = MECHKIT("plot", log, "--out", scratch("missing.svg"));
    ck_assert_msg(o.code == 3 && strstr(o.err, "missing.csv: nothing to draw"), "%d %s", o.code,
                  o.err);
    ck_assert_int_eq(count_files("missing.svg"), 0);
}
END_TEST

START_TEST(a_plot_that_cannot_be_is_refused_before_it_is_drawn)
{
    const char *no_angle = scratch_text("no_angle.csv", "t,u\n0,1\n1,2\n");
    const char *no_command = scratch_text("no_command.csv", "t,q1\n0,1\n1,2\n");
    static const struct {
        const char *args, *says;
        int code;
    } bad[] = {{"", "which log", 2},
               {"x.csv --out x.pdf", "ends in .svg or .png", 2},
               {"x.csv --size big", "expected WIDTHxHEIGHT", 2},
               {"x.csv y.csv --with z.csv", "--with is for one log", 2},
               {"1 2 3 4 5 6 7 8 9", "at most 8 logs", 2},
               {"/nowhere.csv", "nowhere", 3}};
    char out[2048];
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        int code = run_mechkit(out, sizeof out, "plot %s", bad[i].args);
        ck_assert_msg(code == bad[i].code && strstr(out, bad[i].says), "%s: %d %s", bad[i].args,
                      code, out);
    }
    ck_assert_int_eq(run_mechkit(out, sizeof out, "plot %s", no_angle), 3);
    ck_assert_ptr_nonnull(strstr(out, "no column q1"));
    ck_assert_int_eq(run_mechkit(out, sizeof out, "plot %s --spectrum", no_command), 3);
    ck_assert_ptr_nonnull(strstr(out, "spectra need a command"));
}
END_TEST

Suite *suite_plot(void)
{
    Suite *s = suite_create("plot");
    TCase *c = tcase_create("spectrum");
    tcase_add_test(c, a_transform_is_the_sum_that_defines_it);
    tcase_add_test(c, a_spectrum_holds_the_power_of_its_signal_at_its_frequency);
    tcase_add_test(c, the_response_of_a_filter_is_its_own);
    suite_add_tcase(s, c);
    c = tcase_create("plots");
    tcase_set_timeout(c, 120);
    tcase_add_test(c, every_kind_of_plot_is_drawn);
    tcase_add_test(c, a_plot_without_a_file_is_drawn_in_the_terminal);
    tcase_add_test(c, a_plot_in_a_terminal_fits_it);
    tcase_add_test(c, a_plot_has_the_reference_and_the_changes_of_gains);
    tcase_add_test(c, the_step_of_a_lag_has_the_figures_of_the_textbook);
    tcase_add_test(c, the_overshoot_of_a_step_has_its_textbook_s_size);
    tcase_add_test(c, a_ramp_is_no_step_and_what_never_arrives_is_not_settled);
    tcase_add_test(c, the_summary_of_a_run_has_its_steps);
    tcase_add_test(c, the_summary_of_a_log_refuses_what_is_infinite);
    tcase_add_test(c, the_summary_of_a_log_has_its_command_whatever_it_is_called);
    tcase_add_test(c, what_a_log_says_of_itself_does_not_steer_the_terminal);
    tcase_add_test(c, the_line_of_the_catch_leaves_its_label_alone);
    tcase_add_test(c, logs_of_any_name_are_plotted_whatever_the_user_s_settings);
    tcase_add_test(c, a_plot_that_cannot_be_written_says_so);
    tcase_add_test(c, a_gnuplot_that_cannot_start_is_not_told_to_be_missing);
    tcase_add_loop_test(c, a_signal_while_it_is_drawn_leaves_nothing, 0, 3);
    tcase_add_test(c, a_temporary_file_that_cannot_be_written_is_said_to_be_one);
    tcase_add_test(c, a_log_without_a_number_to_draw_is_named);
    tcase_add_test(c, a_plot_that_cannot_be_is_refused_before_it_is_drawn);
    suite_add_tcase(s, c);
    return s;
}
