/* The program as a user meets it: exit codes, messages, what a command file does. */
#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "console/commands/progress.h"
#include "mechkit/log.h"
#include "mechkit/model.h"
#include "support/files.h"
#include "support/spawn.h"

START_TEST(help_and_version_go_to_standard_output)
{
    const char *subs[] = {"run", "console", "simulate", "design", "summary", "plot", "robustness"};
    for (size_t i = 0; i < sizeof subs / sizeof subs[0]; i++) {
        struct outcome o = MECHKIT(subs[i], "--help");
        ck_assert_int_eq(o.code, 0);
        ck_assert_ptr_nonnull(strstr(o.out, "usage: mechkit"));
        ck_assert_str_eq(o.err, "");
    }
    ck_assert_int_eq(MECHKIT("--help").code, 0);
    ck_assert_ptr_nonnull(strstr(MECHKIT("--version").out, "mechkit "));
    ck_assert_ptr_nonnull(strstr(MECHKIT("run", "--commands").out, "pendubot-mid"));
}
END_TEST

START_TEST(help_manual_and_docs_agree_on_the_exit_codes)
{
    static const char *const files[] = {"man/mechkit.1.in", "docs/formats.md"};
    const char *says = "or an output cannot be written, 2 wrong usage, 3 bad input file.";
    ck_assert_ptr_nonnull(strstr(MECHKIT("--help").out, says));
    for (size_t i = 0; i < sizeof files / sizeof files[0]; i++) {
        char path[512];
        snprintf(path, sizeof path, MK_SOURCE_DIR "/%s", files[i]);
        char *text = slurp_file(path);
        ck_assert_msg(text && strstr(text, says), "%s", files[i]);
        free(text);
    }
}
END_TEST

START_TEST(wrong_usage_is_2_and_a_bad_file_3)
{
    const char *script = scratch_text("bad.cmd", "setup pi-speed\nfly\n");
    const char *model = scratch_text("bad.ini", "[rig]\nkind = kite\n");
    const char *log = scratch_text("bad.csv", "t,q1,u\n0,0,0\n0,1,2\n");
    ck_assert_int_eq(MECHKIT("fly").code, 2);
    ck_assert_int_eq(MECHKIT("run").code, 2);
    ck_assert_int_eq(MECHKIT("run", "--warp", "x.cmd").code, 2);
    ck_assert_int_eq(MECHKIT("simulate", "--model", model).code, 2);
    struct outcome o = MECHKIT("run", script, "--fast");
    ck_assert_int_eq(o.code, 3);
    ck_assert_ptr_nonnull(strstr(o.err, "bad.cmd:2: there is no command 'fly'"));
    o = MECHKIT("simulate", "--model", model, "--input", log, "--json", "-");
    ck_assert_int_eq(o.code, 3);
    ck_assert_ptr_nonnull(strstr(o.err, "bad.ini:2: kind = 'kite'"));
    o = MECHKIT("simulate", "--model", MK_SOURCE_DIR "/models/pendulum.ini", "--input", log,
                "--json", "-");
    ck_assert_int_eq(o.code, 3);
    ck_assert_ptr_nonnull(strstr(o.err, "bad.csv:3:"));
    ck_assert_int_eq(strncmp(o.err, "mechkit: ", 9), 0);
    ck_assert_int_eq(MECHKIT("run", "/no/such.cmd").code, 3);
}
END_TEST

/* What no board is needed for is told before one moves, with its line. */
static const struct {
    const char *text, *says;
} known_before[] = {
    {"rate 5000\n", ":1: rate 5000: must be 100 .. 2000 Hz"},
    {"seed 1.5\n", ":1: seed 1.5: must be a whole number from 0 to 9e+15"},
    {"faults at 5 frob\n", ":1: (fault script):1:6: fault script: "},
    {"faults nowhere.txt\n", ":1: nowhere.txt: cannot open"},
    {"setup frob\n", ":1: there is no setup 'frob'; there are pendubot-mid, "},
    {"setup furuta\nlimit frob 3\n", ":2: there is no limit 'frob'; there are q1_min, q1_max, "},
    {"setup furuta\nset nosuch 3\n", ":2: setup furuta has no parameter 'nosuch'"},
    {"setup furuta\nset level 7\n", ":2: furuta: level = 7 is outside 0"},
    {"setup furuta\ngains 1 2\n", ":2: setup furuta takes 4 gains, not 2"},
    {"setup pi-speed\nrepeat 2\nsetup furuta\nend\ngains 1 2\n",
     ":5: setup furuta takes 4 gains, not 2"},
    {"set level 0.5\n", ":1: choose a setup first"},
    {"gains 1 2\n", ":1: choose a setup first"},
    {"limit stuck_s 1\n", ":1: choose a setup first"},
    {"start\n", ":1: choose a setup first"},
    {"model nowhere.ini\n", ":1: nowhere.ini: cannot open"},
    {"believe kite.ini\n", "kite.ini:2: kind = 'kite'"},
    {"model furuta.ini\nsetup pendubot-mid\n",
     ":2: setup pendubot-mid is for pendubot, not for furuta"},
    {"believe furuta.ini\nsetup pendubot-mid\n",
     ":2: setup pendubot-mid is for pendubot, not for furuta"},
    {"setup open-loop\n", ":1: setup open-loop runs on several rigs"},
    {"wait -1\n", ":1: expected seconds from 0 to 10000000, not '-1'"},
    {"wait 1e8\n", ":1: expected seconds from 0 to 10000000, not '1e8'"},
    {"wait-until balanced within -3\n",
     ":1: expected seconds from 0 to 10000000 after 'within', not '-3'"},
    {"wait-until balanced within 5 s\n",
     ":1: expected seconds from 0 to 10000000 after 'within', not '5 s'"},
    {"wait-until q1 > 1 within inf\n",
     ":1: expected seconds from 0 to 10000000 after 'within', not 'inf'"},
    {"expect balanced for x\n", ":1: expected seconds from 0 to 10000000 after 'for', not 'x'"},
    {"expect |q2| < 0.1 for\n", ":1: expected seconds from 0 to 10000000 after 'for'\n"},
    {"wait-until q1 within 2 50\n", ":1: condition 'q1 within 2 50': expected 'of'"},
    {"expect q9 > 1 for x\n", ":1: condition 'q9 > 1 for x': unknown name"},
    {"input @nowhere.csv\n", ":1: nowhere.csv: cannot"},
};

START_TEST(what_is_known_without_a_board_is_told_before)
{
    struct mk_model model;
    char script[256], says[200];
    mk_model_default(MK_PLANT_FURUTA, &model);
    ck_assert_int_eq(mk_model_write(scratch("furuta.ini"), &model, NULL, NULL), MK_OK);
    scratch_text("kite.ini", "[rig]\nkind = kite\n");
    snprintf(script, sizeof script, "%s", scratch_text("before.cmd", known_before[_i].text));
    snprintf(says, sizeof says, "%s%s", known_before[_i].says[0] == ':' ? "before.cmd" : "",
             known_before[_i].says);
    struct outcome o = MECHKIT("run", "--check", script);
    ck_assert_msg(o.code == 3 && strstr(o.err, says), "%s: %d: %s", known_before[_i].text, o.code,
                  o.err);
    ck_assert_msg(strstr(o.err, "before.cmd:"), "%s", o.err);
    o = MECHKIT("run", script, "--fast", "--out", scratch("before"));
    ck_assert_msg(o.code == 3 && strstr(o.err, says), "%s: %d: %s", known_before[_i].text, o.code,
                  o.err);
}
END_TEST

/* What the lines before may change, or what is given besides the file, is left to the run. */
START_TEST(what_only_the_run_can_tell_is_left_to_it)
{
    static const char *const rows[] = {
        "setup furuta\nstart\nhalt\nidentify f.ini\nbelieve f.ini\nsetup furuta\n",
        "setup pi-speed\nstart\nhalt\nsave s.csv\nsetup pi-speed\nref @s.csv\n",
        "model furuta.ini\nsetup open-loop\n",
        "compare nowhere.csv\n",
        "expect balanced\tfor  2\nwait-until balanced within  2\n",
        "wait-until dq1 within 2% of 50\nexpect q1 within 1 of 2 for 3\n",
        "wait 1\n",
        "setup furuta\ngains 1 2 3 4\nset level 0.5\nlimit stuck_s 1\nfaults at 5 drop\n"};
    struct mk_model model;
    char script[256], given[256];
    mk_model_default(MK_PLANT_FURUTA, &model);
    snprintf(given, sizeof given, "%s", scratch("furuta.ini"));
    ck_assert_int_eq(mk_model_write(given, &model, NULL, NULL), MK_OK);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        snprintf(script, sizeof script, "%s", scratch_text("later.cmd", rows[i]));
        struct outcome o = MECHKIT("run", "--check", script);
        ck_assert_msg(o.code == 0, "%s: %d: %s", rows[i], o.code, o.err);
    }
    snprintf(script, sizeof script, "%s",
             scratch_text("aside.cmd", "model nowhere.ini\nsetup open-loop\n"));
    ck_assert_int_eq(MECHKIT("run", "--check", script).code, 3);
    ck_assert_int_eq(MECHKIT("run", "--check", script, "--model", given).code, 0);
    struct outcome o = MECHKIT("run", "--check", script, "--model", scratch("none.ini"));
    ck_assert_msg(o.code == 3 && strstr(o.err, "none.ini: cannot open"), "%d: %s", o.code, o.err);
    snprintf(script, sizeof script, "%s", scratch_text("other.cmd", "setup pendubot-mid\n"));
    ck_assert_int_eq(MECHKIT("run", "--check", script).code, 0);
    o = MECHKIT("run", "--check", script, "--believe", given);
    ck_assert_msg(o.code == 3 && strstr(o.err, "other.cmd:1: setup pendubot-mid is for pendubot"),
                  "%d: %s", o.code, o.err);
}
END_TEST

START_TEST(a_link_that_friction_holds_off_its_rest_does_not_start_again)
{
    struct mk_model model;
    char path[200], text[600];
    mk_model_default(MK_PLANT_PENDULUM, &model);
    model.parameter[2] = model.parameter[3] = 3.0; /* viscous, Coulomb */
    snprintf(path, sizeof path, "%s", scratch("stiff.ini"));
    ck_assert_int_eq(mk_model_write(path, &model, NULL, NULL), MK_OK);
    snprintf(text, sizeof text,
             "model %s\nlog off\nsetup open-loop\ninput 7*pulse(0,0.35)\nstart\nwait 4\n"
             "expect |q1| > 0.12\nhalt\nstart\n",
             path);
    struct outcome o = MECHKIT("run", scratch_text("again.cmd", text), "--fast");
    ck_assert_int_eq(o.code, 1);
    ck_assert_msg(strstr(o.err, "not-hanging: joint 1 is 0.1") != NULL, "%s", o.err);
}
END_TEST

START_TEST(a_setup_that_takes_no_signal_has_no_reference_in_its_log)
{
    struct mk_log *log;
    const char *script =
        scratch_text("two.cmd", "model models/pendubot.ini\nsetup open-loop\ninput 0.1*sin(6*t)\n"
                                "start\nwait 0.1\nhalt\nsetup pendubot-mid\nstart\nwait 0.1\n"
                                "halt\nsetup open-loop\nstart\nwait 0.1\nhalt\n");
    char folder[200];
    snprintf(folder, sizeof folder, "%s", scratch("refs"));
    struct outcome o = MECHKIT("run", script, "--fast", "--out", folder);
    ck_assert_msg(o.code == 0, "%s", o.err);
    ck_assert_int_eq(mk_log_read(scratch("refs/run-002.csv"), &log, NULL), MK_OK);
    ck_assert_str_eq(mk_log_find_meta(log, "setup"), "pendubot-mid");
    ck_assert_ptr_null(mk_log_find_meta(log, "reference"));
    mk_log_free(log);
    ck_assert_int_eq(mk_log_read(scratch("refs/run-003.csv"), &log, NULL), MK_OK);
    ck_assert_str_eq(mk_log_find_meta(log, "reference"), "0.1*sin(6*t)");
    mk_log_free(log);
}
END_TEST

START_TEST(bytes_that_are_no_text_are_refused_and_do_not_steer_the_terminal)
{
    static const char zeros[] = "setup pi-speed\n\0\0\0";
    const char *path = scratch("zeros.cmd");
    FILE *f = fopen(path, "wb");
    ck_assert_ptr_nonnull(f);
    fwrite(zeros, 1, sizeof zeros - 1, f);
    fclose(f);
    struct outcome o = MECHKIT("run", path, "--fast");
    ck_assert_int_eq(o.code, 3);
    ck_assert_ptr_nonnull(strstr(o.err, "zeros.cmd:2: a zero byte: this is no text file"));
    o = MECHKIT("run", scratch_text("steer.cmd", "\x1b[2J\x07\n"), "--fast");
    ck_assert_int_eq(o.code, 3);
    ck_assert_ptr_nonnull(strstr(o.err, "there is no command '\\x1b[2J\\x07'"));
}
END_TEST

START_TEST(a_failing_command_is_1_with_its_line)
{
    const char *script =
        scratch_text("f.cmd", "setup pi-speed\nstart\nwait 0.5\nexpect dq1 > 1000\nhalt\n");
    struct outcome o = MECHKIT("run", script, "--fast", "--out", scratch("out"));
    ck_assert_int_eq(o.code, 1);
    ck_assert_ptr_nonnull(strstr(o.err, "f.cmd:4: expect: expected dq1 > 1000"));
    script = scratch_text("g.cmd", "setup pi-speed\nexpect running  for 2\n");
    o = MECHKIT("run", script, "--fast", "--out", scratch("out"));
    ck_assert_msg(strstr(o.err, "g.cmd:2: expect: expected running, but"), "%s", o.err);
    const char *idle = scratch_text("i.cmd", "wait 1\n");
    ck_assert_int_eq(MECHKIT("run", idle, "--fast").code, 1);
}
END_TEST

/* Steps while it runs: logged sample by sample, and marked where they begin. */
START_TEST(references_and_inputs_change_while_it_runs)
{
    const char *script = scratch_text("r.cmd", "setup pi-speed\nref 20\nstart\nwait 2\nref 60\n"
                                               "wait 2\nhalt\nsave r.csv\n"
                                               "setup open-loop\ninput 1\nstart\nwait 1\n"
                                               "input 0.25\nwait 1\nhalt\nsave i.csv\n");
    struct outcome o = MECHKIT("run", script, "--fast", "--out", scratch("refs"), "--model",
                               MK_SOURCE_DIR "/models/inertia-wheel.ini");
    ck_assert_msg(o.code == 0, "%s", o.err);
    struct mk_log *log;
    ck_assert_int_eq(mk_log_read(scratch("refs/r.csv"), &log, NULL), MK_OK);
    const double *ref = mk_log_get(log, "ref"), *v = mk_log_get(log, "dq1");
    ck_assert_double_eq(ref[999], 20.0);
    ck_assert_double_eq(ref[1000], 60.0);
    ck_assert_double_eq_tol(v[999], 20.0, 1.0);
    ck_assert_double_eq_tol(v[log->rows - 1], 60.0, 1.0);
    ck_assert_str_eq(mk_log_find_meta(log, "changed"), "at 2.000000 s: reference 60");
    mk_log_free(log);
    ck_assert_int_eq(mk_log_read(scratch("refs/i.csv"), &log, NULL), MK_OK);
    const double *u = mk_log_get(log, "u");
    ck_assert_double_eq_tol(u[500], 1.0, 1e-3);
    ck_assert_double_eq_tol(u[502], 0.25, 1e-3);
    mk_log_free(log);
}
END_TEST

/* A limit that cannot be one would switch its check off, or stop every run. */
START_TEST(limits_that_make_no_sense_are_refused_with_their_range)
{
    static const struct {
        const char *limit, *says;
        bool of_rig; /* what the rig alone can tell, when the line is run */
    } rows[] = {{"model_share -1", "limit model_share is -1, it must be 0 .. 1", false},
                {"model_share 1e300", "it must be 0 .. 1", false},
                {"stuck_s -5", "limit stuck_s is -5, it must be 0.001 .. 60", false},
                {"runaway_s 61", "it must be 0 .. 60", false},
                {"jump1 -1", "limit jump1 is -1, it must be 1e-06 .. 1e+06", false},
                {"dq1_max -3", "limit dq1_max is -3, it must be 1e-06 .. 1e+06", false},
                {"rest2 -0.1", "it must be 0 .. inf", false},
                {"stuck_u 11", "limit stuck_u is 11, it must be 0 .. 10", true},
                {"q1_max -1000", "limit q1_max is -1000, it must be -1.5708 .. inf", true},
                {"q1_min 0", "limit q1_min is 0, it must be -inf .. -1.5708", true}};
    static const char *const fine[] = {"model_share 1", "model_share 0", "stuck_u 10", "q1_max 3",
                                       "q1_min -4",     "jump1 0.1",     "rest2 0"};
    char script[100];
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        snprintf(script, sizeof script, "setup pendubot-mid\nlimit %s\n", rows[i].limit);
        const char *path = scratch_text("limit.cmd", script);
        struct outcome o = MECHKIT("run", "--fast", path);
        ck_assert_int_ne(o.code, 0);
        ck_assert_msg(strstr(o.err, rows[i].says), "%s: %s", rows[i].limit, o.err);
        o = MECHKIT("run", "--check", path);
        ck_assert_int_eq(o.code != 0, !rows[i].of_rig);
    }
    for (size_t i = 0; i < sizeof fine / sizeof fine[0]; i++) {
        snprintf(script, sizeof script, "setup pendubot-mid\nlimit %s\n", fine[i]);
        struct outcome o = MECHKIT("run", "--fast", scratch_text("limit.cmd", script));
        ck_assert_msg(o.code == 0, "%s: %s", fine[i], o.err);
    }
}
END_TEST

/* Whatever has a name: what is near to it is offered. */
START_TEST(a_misspelt_name_is_met_with_the_one_that_was_meant)
{
    static const struct {
        const char *script, *says;
    } rows[] = {{"setpu furuta\n", "did you mean setup?"},
                {"setup furuat\n", "did you mean furuta?"},
                {"setup furuta\nset fricton 1\n", "did you mean friction?"},
                {"setup furuta\nlimit q1max 1\n", "did you mean q1_max?"},
                {"setup furuta\nstart\nwait-until balancd within 5\n", "did you mean balanced?"},
                {"setup furuta\nstart\nexpect encoder-jmp\n", "did you mean encoder-jump?"},
                {"setup open-loop\ninput sinn(t)\n", "did you mean sin?"},
                {"setup furuta\nset friction 0,5\n", "decimals come after a point: 0.5"}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct outcome o = MECHKIT("run", "--check", scratch_text("meant.cmd", rows[i].script));
        ck_assert_int_eq(o.code, 3);
        ck_assert_msg(strstr(o.err, rows[i].says), "%s: %s", rows[i].script, o.err);
    }
    /* What is near to nothing is not guessed at. */
    struct outcome o = MECHKIT("run", "--check", scratch_text("meant.cmd", "xyzzy 3\n"));
    ck_assert_msg(!strstr(o.err, "did you mean"), "%s", o.err);
}
END_TEST

/* A report is what explain writes; the thesis that laws and numbers come from has its author's
 * name. */
/* Phases of a calculation count anew; the line does not. */
START_TEST(progress_only_rises_and_tells_the_time)
{
    struct progress p = {0};
    char text[120];
    static const double done[] = {0.0, 0.02, 0.2, 0.1, 0.4, 0.3, 0.95, 1.2};
    double last = 0.0;
    for (size_t i = 0; i < sizeof done / sizeof done[0]; i++) {
        progress_text(&p, 10.0, done[i], "fitting", text, sizeof text);
        double share = strstr(text, "%") ? strtod(text, NULL) : 0.0;
        ck_assert_msg(share >= last && share <= 100.0, "%s", text);
        last = share;
    }
    p = (struct progress){0};
    ck_assert_str_eq(progress_text(&p, 12.0, 0.0, "fitting", text, sizeof text), "12 s: fitting");
    ck_assert_str_eq(progress_text(&p, 12.0, 0.4, "fitting", text, sizeof text),
                     " 40 %, 12 s of about 30 s: fitting");
    ck_assert_str_eq(progress_text(&p, 16.0, 0.1, "holding out", text, sizeof text),
                     " 40 %, 16 s of about 40 s: holding out");
}
END_TEST

START_TEST(the_thesis_is_not_called_a_report)
{
    static const char *const setups[] = {"pendubot-mid", "pendubot-top", "reaction-wheel", "furuta",
                                         "pi-speed"};
    for (size_t i = 0; i < sizeof setups / sizeof setups[0]; i++) {
        char text[100];
        snprintf(text, sizeof text, "setup %s\nshow gains\n", setups[i]);
        struct outcome o = MECHKIT("run", scratch_text("th.cmd", text), "--fast");
        ck_assert_int_eq(o.code, 0);
        ck_assert_msg(!strstr(o.out, "report"), "%s", o.out);
        ck_assert_msg(i > 2 || strstr(o.out, "Meesters' box"), "%s", o.out);
    }
    static const char *const subs[] = {"run", "console", "standalone", "doctor"};
    for (size_t i = 0; i < sizeof subs / sizeof subs[0]; i++)
        ck_assert_ptr_null(strstr(MECHKIT(subs[i], "--help").out, "the report's"));
}
END_TEST

START_TEST(a_misspelt_model_is_met_with_what_was_meant)
{
    static const struct {
        const char *lines, *says;
    } rows[] = {{"[effect.stribek]\njoint = 2\n", "did you mean stribeck?"},
                {"[effect.coulomb]\njoint = 2\nlevell = 1\n", "did you mean level?"},
                {"[rig]\nu_mx = 5\n", "did you mean u_max?"},
                {"[effect.coulomb]\njoint = 2\nlevel = 0,054\n", "after a point: 0.054"}};
    const char *script = scratch_text("any.cmd", "setup furuta\nstart\nwait 0.1\nhalt\n");
    char *whole = slurp_file(MK_SOURCE_DIR "/models/furuta.ini"), text[6000], path[256];
    snprintf(path, sizeof path, "%s", script);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        snprintf(text, sizeof text, "%s\n%s", whole, rows[i].lines);
        struct outcome o =
            MECHKIT("run", "--check", path, "--model", scratch_text("meant.ini", text));
        ck_assert_int_eq(o.code, 3);
        ck_assert_msg(strstr(o.err, rows[i].says), "%s: %s", rows[i].lines, o.err);
    }
    free(whole);
}
END_TEST

START_TEST(another_program_s_file_is_sent_to_import)
{
    const char *model = MK_SOURCE_DIR "/models/furuta.ini";
    static const char *const files[] = {"Time [s],Arm [deg],Voltage\n0,0,180\n0.01,0.1,180\n",
                                        "Zeit;Arm\n0,01;1,5\n0,02;1,6\n",
                                        "t,arm,pendulum,u\n0,0,0,0\n0.01,0,0,0\n0.02,0,0,1\n"};
    for (size_t i = 0; i < 3; i++) {
        char log[256];
        snprintf(log, sizeof log, "%s", scratch_text("foreign.csv", files[i]));
        struct outcome o = MECHKIT("identify", "--model", model, "--out", scratch("f.ini"), log);
        ck_assert_int_eq(o.code, 3);
        ck_assert_msg(strstr(o.err, "mechkit import"), "%s", o.err);
        o = MECHKIT("explain", "--model", model, "--out", scratch("f"), log);
        ck_assert_msg(o.code == 3 && strstr(o.err, "mechkit import"), "%s", o.err);
        o = MECHKIT("simulate", "--model", model, "--input", log);
        ck_assert_msg(o.code == 3 && strstr(o.err, "mechkit import"), "%s", o.err);
    }
}
END_TEST

START_TEST(a_fault_is_told_with_its_value_its_limit_and_its_log)
{
    const char *script =
        scratch_text("fv.cmd", "setup pi-speed\nlimit dq1_max 30\nref 50\nstart\nwait 5\nhalt\n");
    struct outcome o = MECHKIT("run", script, "--fast", "--out", scratch("fv"));
    ck_assert_int_eq(o.code, 1);
    const char *value = strstr(o.err, "dq1 3"); /* just above */
    ck_assert_msg(value && strtod(value + 4, NULL) > 30.0 && strtod(value + 4, NULL) < 35.0, "%s",
                  o.err);
    ck_assert_msg(strstr(o.err, "limit 30 rad/s"), "%s", o.err);
    ck_assert_msg(strstr(o.err, "log ") && strstr(o.err, "fv/run-001.csv"), "%s", o.err);
    script = scratch_text("ft.cmd", "setup furuta\nlimit q2_max 3.2\nstart\nwait 5\nhalt\n");
    o = MECHKIT("run", script, "--fast", "--out", scratch("fv"));
    ck_assert_msg(strstr(o.err, "q2 3.2") && strstr(o.err, ".. 3.2 rad"), "%s", o.err);
    /* The pendulum's encoder dies under a command that is nowhere near hard. */
    script = scratch_text("fs.cmd", "faults at 4000 stuck 2\nsetup furuta\nstart\nwait 20\nhalt\n");
    o = MECHKIT("run", script, "--fast", "--out", scratch("fv"));
    ck_assert_msg(strstr(o.err, "encoder-stuck (joint 2)") && strstr(o.err, "q2 stands at") &&
                      strstr(o.err, "must have gone by the model"),
                  "%s", o.err);
}
END_TEST

START_TEST(a_reference_for_a_setup_without_one_is_refused)
{
    const char *script = scratch_text("n.cmd", "setup furuta\nref 0.3\nstart\nhalt\n");
    struct outcome o = MECHKIT("run", "--check", script);
    ck_assert_int_eq(o.code, 3);
    ck_assert_msg(strstr(o.err, "n.cmd:2") && strstr(o.err, "takes no signal"), "%s", o.err);
}
END_TEST

/* Where "a pendubot" stood, the inertia wheel was "a inertia-wheel". */
START_TEST(the_article_suits_every_rig)
{
    const char *model = MK_SOURCE_DIR "/models/inertia-wheel.ini";
    const char *script =
        scratch_text("w.cmd", "setup pi-speed\nref 10\nstart\nwait 1\nhalt\nsave w.csv\n");
    char out[256], log[300];
    struct mk_model wheel;
    struct mk_error err = MK_ERROR_INIT;
    snprintf(out, sizeof out, "%s", scratch("wheel"));
    snprintf(log, sizeof log, "%s/w.csv", out);
    struct outcome o = MECHKIT("run", script, "--fast", "--out", out);
    ck_assert_msg(strstr(o.out, "setup pi-speed on the inertia-wheel, board"), "%s", o.out);
    o = MECHKIT("design", "--model", model, "--at", "nowhere");
    ck_assert_msg(strstr(o.err, "equilibria of the inertia-wheel are rest"), "%s", o.err);
    o = MECHKIT("measure", "swing", "--model", model, log);
    ck_assert_msg(strstr(o.err, "swing cannot be measured on the inertia-wheel"), "%s", o.err);
    o = MECHKIT("import", log, "--rig", "inertia-wheel", "--out", scratch("i.csv"));
    ck_assert_msg(strstr(o.out, "rows, taken for those of the inertia-wheel,"), "%s%s", o.out,
                  o.err);
    /* What a column was taken for is seen by where it goes. */
    ck_assert_msg(strstr(o.out, "t     = t  (0 .. ") && strstr(o.out, " rad)\n") &&
                      strstr(o.out, " units of the command)\n"),
                  "%s", o.out);
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &wheel);
    ck_assert_int_eq(mk_model_add_effect(&wheel, "base-tilt", 0, &err), MK_ERR_INVALID);
    ck_assert_msg(strstr(err.message, "makes no sense on the inertia-wheel"), "%s", err.message);
}
END_TEST

START_TEST(a_command_file_looks_at_its_own_run)
{
    const char *fitted = scratch("fitted.ini"), *done = scratch("done.cmd");
    char text[1000], script[256], out[256];
    snprintf(text, sizeof text,
             "record %s\nsetup pendubot-mid\nstart\nwait 3\nexpect |u| <= 10 and q1 < 3\nhalt\n"
             "record off\ncompare\nidentify %s\n",
             done, fitted);
    snprintf(script, sizeof script, "%s", scratch_text("after.cmd", text));
    snprintf(out, sizeof out, "%s", scratch("after"));
    struct outcome o = MECHKIT("run", script, "--fast", "--out", out);
    ck_assert_msg(o.code == 0, "%s", o.err);
    ck_assert_msg(strstr(o.out, "q2: simulated 1 s from the data each time, off by 0.00"), "%s",
                  o.out);
    ck_assert_ptr_nonnull(strstr(o.out, "  p1 "));
    struct mk_model model;
    ck_assert_int_eq(mk_model_read(fitted, &model, NULL), MK_OK);
    ck_assert_double_eq_tol(model.parameter[0], 0.054, 1e-4);
    /* What was recorded does the same again: the same log. */
    o = MECHKIT("run", done, "--fast", "--out", out);
    ck_assert_msg(o.code == 0, "%s", o.err);
    char *first = slurp_file(scratch("after/run-001.csv"));
    char *again = slurp_file(scratch("after/run-002.csv"));
    ck_assert(first && again && strcmp(first, again) == 0);
    free(first);
    free(again);
}
END_TEST

/* A name that is mistaken costs nothing: not the log, not the script. */
START_TEST(identify_in_a_script_replaces_models_and_nothing_else)
{
    char script[300], log[300], model[300], text[1600];
    snprintf(log, sizeof log, "%s", scratch("kept/k.csv"));
    snprintf(script, sizeof script, "%s", scratch("kept.cmd"));
    snprintf(model, sizeof model, "%s", scratch("kept-fitted.ini"));
    const char *const targets[] = {log, script, model, model};
    for (size_t i = 0; i < sizeof targets / sizeof targets[0]; i++) {
        snprintf(text, sizeof text,
                 "setup open-loop\ninput 2*sin(6*t)\nstart\nwait 2\nhalt\nsave! k.csv\n"
                 "identify %s\n",
                 targets[i]);
        scratch_text("kept.cmd", text);
        struct outcome o = MECHKIT("run", script, "--model", MK_SOURCE_DIR "/models/pendulum.ini",
                                   "--fast", "--out", scratch("kept"));
        ck_assert_msg(o.code == (i < 2 ? 1 : 0), "%s: %d %s", targets[i], o.code, o.err);
        ck_assert(i >= 2 || strstr(o.err, "this file is no model and is not replaced"));
        char *now = slurp_file(script);
        ck_assert_str_eq(now, text);
        free(now);
        struct mk_log *kept;
        ck_assert_int_eq(mk_log_read(log, &kept, NULL), MK_OK);
        mk_log_free(kept);
    }
    struct mk_model fitted;
    ck_assert_int_eq(mk_model_read(model, &fitted, NULL), MK_OK);
}
END_TEST

/* An arm is what a Furuta pendulum has. */
START_TEST(identify_tells_the_parameters_that_do_something_on_the_rig)
{
    static const char *const rigs[] = {"pendubot", "furuta"};
    for (int arm = 0; arm < 2; arm++) {
        char path[300], text[4096], model[300];
        snprintf(path, sizeof path, MK_SOURCE_DIR "/models/%s.ini", rigs[arm]);
        char *rig = slurp_file(path);
        snprintf(text, sizeof text, "%s\n[effect.base-tilt]\nangle = 0.001\n", rig);
        free(rig);
        snprintf(model, sizeof model, "%s", scratch_text("tilted.ini", text));
        const char *script = scratch_text("tell.cmd", "setup open-loop\ninput 2*sin(6*t)\nstart\n"
                                                      "wait 3\nhalt\nsave! tell.csv\nidentify\n");
        struct outcome o =
            MECHKIT("run", script, "--model", model, "--fast", "--out", scratch("tell"));
        ck_assert_msg(o.code == 0 && strstr(o.out, "base-tilt.angle"), "%s %s", o.out, o.err);
        ck_assert(!strstr(o.out, "base-tilt.arm") == !arm);
        o = MECHKIT("identify", "--model", model, "--out", scratch("tell.ini"), "--json",
                    scratch("tell.json"), scratch("tell/tell.csv"));
        ck_assert_msg(o.code == 0 && strstr(o.out, "base-tilt.angle"), "%s %s", o.out, o.err);
        ck_assert(!strstr(o.out, "base-tilt.arm") == !arm);
        char *json = slurp_file(scratch("tell.json"));
        ck_assert(!strstr(json, "base-tilt.arm") == !arm);
        free(json);
    }
}
END_TEST

START_TEST(line_ends_of_old_machines_are_told_and_not_taken_for_one_line)
{
    char script[300];
    snprintf(script, sizeof script, "%s",
             scratch_text("cr.cmd", "setup pi-speed\rref 5\rstart\rwait 1\rhalt\r"));
    struct outcome o = MECHKIT("run", script, "--fast", "--out", scratch("cr"));
    ck_assert_msg(o.code != 0 && strstr(o.err, "cr.cmd:1: a carriage return within a line"),
                  "%d %s", o.code, o.err);
    scratch_text("cr.cmd", "setup pi-speed\r\nref 5\r\nstart\r\nwait 0.1\r\nhalt\r\n");
    o = MECHKIT("run", script, "--fast", "--out", scratch("cr"));
    ck_assert_msg(o.code == 0, "%s", o.err);
}
END_TEST

START_TEST(what_needs_a_run_or_a_screen_says_so)
{
    static const struct {
        const char *text, *says;
    } rows[] = {{"identify\n", "there is no run yet"},
                {"explain\n", "there is no run yet"},
                {"compare nowhere.csv\n", "nowhere.csv"},
                {"replay\n", "there is no screen"},
                {"record off\n", "nothing is recorded"},
                {"record /tmp\n", "/tmp: this is a folder: record to a file"},
                {"record /dev/null\n", "/dev/null: this is no regular file"},
                {"setup pi-speed\nstart\nidentify\n", "halt first"}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        char script[256];
        snprintf(script, sizeof script, "%s", scratch_text("needs.cmd", rows[i].text));
        struct outcome o = MECHKIT("run", script, "--fast", "--out", scratch("needs"));
        ck_assert_int_eq(o.code, 1);
        ck_assert_msg(strstr(o.err, rows[i].says), "%s: %s", rows[i].text, o.err);
    }
}
END_TEST

START_TEST(a_model_on_the_command_line_goes_before_the_file_s)
{
    const char *script = scratch_text("both.cmd", "model " MK_SOURCE_DIR "/models/pendubot.ini\n"
                                                  "setup open-loop\nstart\nwait 0.1\nhalt\n"
                                                  "save both.csv\n");
    char out[256], path[300];
    snprintf(out, sizeof out, "%s", scratch("both"));
    snprintf(path, sizeof path, "%s/both.csv", out);
    struct outcome o = MECHKIT("run", script, "--fast", "--out", out, "--model",
                               MK_SOURCE_DIR "/models/furuta.ini");
    ck_assert_msg(o.code == 0, "%s", o.err);
    ck_assert_ptr_nonnull(strstr(o.out, "is left aside: --model"));
    struct mk_log *log;
    ck_assert_int_eq(mk_log_read(path, &log, NULL), MK_OK);
    ck_assert_str_eq(mk_log_find_meta(log, "rig"), "furuta");
    mk_log_free(log);
}
END_TEST

START_TEST(faults_after_a_setup_say_when_they_begin)
{
    struct outcome o =
        MECHKIT("run", scratch_text("late.cmd", "faults at 5 drop\nsetup pi-speed\n"), "--fast");
    ck_assert_msg(o.code == 0 && !strstr(o.out, "next setup"), "%s%s", o.out, o.err);
    o = MECHKIT("run", scratch_text("late.cmd", "setup pi-speed\nfaults at 5 drop\n"), "--fast");
    ck_assert_msg(o.code == 0 && strstr(o.out, "at the next setup"), "%s%s", o.out, o.err);
}
END_TEST

START_TEST(a_swing_up_that_does_not_fit_is_told_with_file_and_line)
{
    /* No such file is found before anything runs; one of another setup when the setup is chosen. */
    const char *none = scratch_text("none.cmd", "swingup none.csv\nsetup furuta\nquit\n");
    struct outcome o = MECHKIT("run", "--check", none);
    ck_assert_int_ne(o.code, 0);
    ck_assert_msg(strstr(o.err, "none.csv"), "%s", o.err);
    const char *other =
        scratch_text("other.cmd", "swingup " MK_SOURCE_DIR
                                  "/models/pendubot-mid-swingup.csv\nsetup pendubot-top\nquit\n");
    o = MECHKIT("run", other, "--fast", "--out", scratch("other"));
    ck_assert_int_ne(o.code, 0);
    ck_assert_msg(strstr(o.err, "pendubot-mid-swingup.csv:4"), "%s", o.err);
    ck_assert_msg(strstr(o.err, "leads to mid"), "%s", o.err);
    const char *energy = scratch_text(
        "energy.cmd", "swingup " MK_SOURCE_DIR "/models/pendubot-mid-swingup.csv\n"
                      "setup pendubot-mid\nswingup energy\nstart\nwait 1.2\nexpect q2 < 2.5\n"
                      "halt\nquit\n");
    o = MECHKIT("run", energy, "--fast", "--out", scratch("energy"));
    ck_assert_msg(o.code == 0, "%s", o.err);
}
END_TEST

START_TEST(the_command_files_that_ship_do_what_they_promise)
{
    static const char *const names[] = {"pendubot-mid",     "pendubot-top", "reaction-wheel",
                                        "furuta",           "pi-speed",     "open-loop",
                                        "pendubot-mid-fast"};
    char path[512];
    snprintf(path, sizeof path, MK_SOURCE_DIR "/scripts/%s.cmd", names[_i]);
    struct outcome o = MECHKIT("run", path, "--fast", "--out", scratch("ship"));
    ck_assert_msg(o.code == 0, "%s", o.err);
}
END_TEST

Suite *suite_console(void)
{
    Suite *s = suite_create("console");
    TCase *t = tcase_create("program");
    tcase_set_timeout(t, 40);
    tcase_add_test(t, help_and_version_go_to_standard_output);
    tcase_add_test(t, help_manual_and_docs_agree_on_the_exit_codes);
    tcase_add_test(t, wrong_usage_is_2_and_a_bad_file_3);
    tcase_add_loop_test(t, what_is_known_without_a_board_is_told_before, 0,
                        (int)(sizeof known_before / sizeof known_before[0]));
    tcase_add_test(t, what_only_the_run_can_tell_is_left_to_it);
    tcase_add_test(t, a_link_that_friction_holds_off_its_rest_does_not_start_again);
    tcase_add_test(t, a_setup_that_takes_no_signal_has_no_reference_in_its_log);
    tcase_add_test(t, bytes_that_are_no_text_are_refused_and_do_not_steer_the_terminal);
    tcase_add_test(t, a_failing_command_is_1_with_its_line);
    tcase_add_test(t, references_and_inputs_change_while_it_runs);
    tcase_add_test(t, limits_that_make_no_sense_are_refused_with_their_range);
    tcase_add_test(t, a_misspelt_name_is_met_with_the_one_that_was_meant);
    tcase_add_test(t, progress_only_rises_and_tells_the_time);
    tcase_add_test(t, the_thesis_is_not_called_a_report);
    tcase_add_test(t, a_misspelt_model_is_met_with_what_was_meant);
    tcase_add_test(t, another_program_s_file_is_sent_to_import);
    tcase_add_test(t, a_fault_is_told_with_its_value_its_limit_and_its_log);
    tcase_add_test(t, a_reference_for_a_setup_without_one_is_refused);
    tcase_add_test(t, the_article_suits_every_rig);
    tcase_add_test(t, faults_after_a_setup_say_when_they_begin);
    tcase_add_test(t, a_command_file_looks_at_its_own_run);
    tcase_add_test(t, identify_in_a_script_replaces_models_and_nothing_else);
    tcase_add_test(t, identify_tells_the_parameters_that_do_something_on_the_rig);
    tcase_add_test(t, line_ends_of_old_machines_are_told_and_not_taken_for_one_line);
    tcase_add_test(t, what_needs_a_run_or_a_screen_says_so);
    tcase_add_test(t, a_model_on_the_command_line_goes_before_the_file_s);
    tcase_add_test(t, a_swing_up_that_does_not_fit_is_told_with_file_and_line);
    tcase_add_loop_test(t, the_command_files_that_ship_do_what_they_promise, 0, 7);
    suite_add_tcase(s, t);
    return s;
}
