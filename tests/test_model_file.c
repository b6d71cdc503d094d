/* Model files: what is written reads back; what is wrong is named with its line. */
#include "suites.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "mechkit/model.h"
#include "support/files.h"

#define WHEEL "[rig]\nkind = inertia-wheel\n[parameters]\np1 = 0.0045\np2 = 0.0112\np3 = 0.35\n"

static struct mk_model read_text(const char *text)
{
    struct mk_model m;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_model_read(scratch_text("m.ini", text), &m, &err) == MK_OK, "%s", err.message);
    return m;
}

static void expect_error(const char *text, enum mk_status status, int line, const char *says)
{
    struct mk_model m;
    struct mk_error err = MK_ERROR_INIT;
    enum mk_status st = mk_model_read(scratch_text("bad.ini", text), &m, &err);
    ck_assert_msg(st == status, "'%s' gave %s: %s", text, mk_status_name(st), err.message);
    ck_assert_msg(err.line == line, "'%s': line %d: %s", text, err.line, err.message);
    ck_assert_msg(strstr(err.message, says) != NULL, "%s", err.message);
}

START_TEST(a_model_that_is_written_reads_back_equal)
{
    struct mk_model m, back;
    struct mk_error err = MK_ERROR_INIT;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    m.parameter[0] = 1.0 / 3.0 * 0.2;
    m.parameter_stderr[2] = 1e-5 / 3.0;
    m.g = 9.80;
    m.encoder_cpr[1] = 5000;
    const char *names[] = {"viscous", "backlash", "viscous", "input-delay"};
    int joints[] = {1, 2, 2, 0};
    for (int i = 0; i < 4; i++)
        ck_assert_int_eq(mk_model_add_effect(&m, names[i], joints[i], &err), MK_OK);
    m.effect[2].value[0] = 0.1 / 7.0;
    m.effect[2].spread[0] = 0.01 / 7.0;
    const char *path = scratch("w.ini");
    ck_assert_int_eq(mk_model_write(path, &m, "two lines\nof comment", &err), MK_OK);
    ck_assert_msg(mk_model_read(path, &back, &err) == MK_OK, "%s", err.message);
    ck_assert_int_eq(memcmp(m.parameter, back.parameter, sizeof m.parameter), 0);
    ck_assert(back.parameter_stderr[2] == m.parameter_stderr[2] && back.g == 9.80);
    ck_assert_int_eq(back.encoder_cpr[1], 5000);
    ck_assert_int_eq(back.effect_count, 4);
    for (int i = 0; i < 4; i++) {
        bool found = false;
        for (int k = 0; k < 4; k++)
            found =
                found ||
                (back.effect[k].index == m.effect[i].index &&
                 back.effect[k].joint == m.effect[i].joint &&
                 memcmp(back.effect[k].value, m.effect[i].value, sizeof m.effect[i].value) == 0 &&
                 memcmp(back.effect[k].spread, m.effect[i].spread, sizeof m.effect[i].spread) == 0);
        ck_assert(found);
    }
}
END_TEST

START_TEST(a_joint_that_slides_reads_back_equal)
{
    struct mk_model m, back;
    struct mk_error err = MK_ERROR_INIT;
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &m);
    ck_assert_int_eq(mk_model_set_linear(&m, 0, true, &err), MK_OK);
    ck_assert_double_eq(m.friction_sharpness, 1500.0);
    m.encoder_resolution[0] = 5e-8;
    ck_assert_int_eq(mk_model_add_effect(&m, "coulomb-asymmetry", 1, &err), MK_OK);
    ck_assert_int_eq(mk_model_add_effect(&m, "stribeck", 1, &err), MK_OK);
    ck_assert_double_eq(m.effect[0].value[1], 1500.0);
    m.effect[1].value[2] = 800.0;
    const char *path = scratch("slide.ini");
    ck_assert_int_eq(mk_model_write(path, &m, NULL, &err), MK_OK);
    char *text = slurp_file(path);
    ck_assert_ptr_nonnull(strstr(text, "joint_unit = m\n"));
    ck_assert_ptr_nonnull(strstr(text, "encoder_resolution = 5e-08\n"));
    ck_assert_ptr_nonnull(strstr(text, "sharpness = 800\n"));
    /* What follows from the unit is not written. */
    ck_assert_ptr_null(strstr(text, "1500"));
    ck_assert_ptr_null(strstr(text, "encoder_cpr"));
    free(text);
    ck_assert_msg(mk_model_read(path, &back, &err) == MK_OK, "%s", err.message);
    ck_assert(back.joint_linear[0] && back.friction_sharpness == 1500.0);
    ck_assert_double_eq(mk_model_count(&back, 0), 5e-8);
    ck_assert_int_eq(memcmp(back.effect, m.effect, 2 * sizeof m.effect[0]), 0);
}
END_TEST

START_TEST(a_device_that_never_ends_a_line_is_no_model_file)
{
    struct mk_model m;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(mk_model_read("/dev/zero", &m, &err), MK_ERR_PARSE);
    ck_assert_msg(strstr(err.message, "too long") != NULL, "%s", err.message);
}
END_TEST

START_TEST(the_sharpness_of_friction_is_the_rig_s_unless_an_effect_has_its_own)
{
    static const char text[] = "[rig]\nkind = pendubot\nfriction_sharpness = 40\n[parameters]\n"
                               "p1=1\np2=1\np3=0\np4=1\np5=1\np6=0\np7=0.3\n"
                               "[effect.coulomb]\njoint = 1\nlevel = 0.1\n"
                               "[effect.coulomb.2]\njoint = 2\nlevel = 0.1\n"
                               "[effect.coulomb.3]\njoint = 2\nlevel = 0.1\nsharpness = 70\n";
    struct mk_model m;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_model_read(scratch_text("sharp.ini", text), &m, &err) == MK_OK, "%s",
                  err.message);
    ck_assert_double_eq(m.effect[0].value[1], 40.0); /* the motor joint: the rig's */
    ck_assert_double_eq(m.effect[1].value[1], 15.0); /* elsewhere: the default of its unit */
    ck_assert_double_eq(m.effect[2].value[1], 70.0);
    ck_assert_double_eq_tol(mk_plant_friction(&m, 0.02), 0.3 * tanh(0.8), 1e-12);
}
END_TEST

/* Where the arm's mass sits matters to a Furuta pendulum alone. */
START_TEST(a_parameter_that_does_nothing_on_a_rig_is_neither_written_nor_fitted)
{
    for (int arm = 0; arm < 2; arm++) {
        struct mk_model m, back;
        struct mk_error err = MK_ERROR_INIT;
        mk_model_default(arm ? MK_PLANT_FURUTA : MK_PLANT_PENDUBOT, &m);
        ck_assert_int_eq(mk_model_add_effect(&m, "base-tilt", 0, &err), MK_OK);
        const struct mk_parameter_info *info = &mk_effect(m.effect[0].index)->parameter[1];
        ck_assert_str_eq(info->name, "arm");
        ck_assert_double_eq(m.effect[0].value[1], 1.0);
        ck_assert(mk_parameter_applies(info, m.plant) == arm);
        ck_assert(mk_parameter_goes_without_saying(info, m.plant) != arm);
        m.effect[0].value[1] = arm ? 0.7 : 1.0;
        const char *path = scratch("tilted.ini");
        ck_assert_int_eq(mk_model_write(path, &m, NULL, &err), MK_OK);
        char *text = slurp_file(path), *line = strstr(text, "\narm = 0.7\n");
        ck_assert(!strstr(text, "\narm =") == !arm && (!arm || line));
        ck_assert_int_eq(mk_model_read(path, &back, &err), MK_OK);
        ck_assert_double_eq(back.effect[0].value[1], m.effect[0].value[1]);
        if (!arm) {
            char set[4000];
            snprintf(set, sizeof set, "%s\narm = 0.7\n", text);
            ck_assert_int_eq(mk_model_read(scratch_text("set.ini", set), &back, &err),
                             MK_ERR_PARSE);
            ck_assert_msg(strstr(err.message, "arm") != NULL, "%s", err.message);
        }
        if (line) { /* left out, it is that of a uniform rod */
            memmove(line, line + strlen("\narm = 0.7"), strlen(line + strlen("\narm = 0.7")) + 1);
            ck_assert_int_eq(mk_model_read(scratch_text("rod.ini", text), &back, &err), MK_OK);
            ck_assert_double_eq(back.effect[0].value[1], 1.0);
        }
        free(text);
    }
}
END_TEST

START_TEST(units_that_do_not_go_together_are_refused)
{
#define SLIDE(more) "[rig]\nkind = inertia-wheel\n" more "[parameters]\np1 = 1\np2 = 0\np3 = 0\n"
    expect_error(SLIDE("joint_unit = m\nencoder_cpr = 4000\n"), MK_ERR_PARSE, 4,
                 "give encoder_resolution");
    expect_error(SLIDE("encoder_cpr = 4000\nencoder_resolution = 1e-3\n"), MK_ERR_PARSE, 3,
                 "give one");
    expect_error(SLIDE("joint_unit = mm\n"), MK_ERR_PARSE, 3, "rad or m for each joint");
    expect_error(SLIDE("friction_sharpness = 0\n"), MK_ERR_RANGE, 3, "must be positive");
    expect_error("[rig]\nkind = pendulum\njoint_unit = m\n", MK_ERR_PARSE, 3,
                 "joint 1 of the pendulum turns");
    expect_error("[rig]\nkind = pendubot\njoint_unit = rad\n", MK_ERR_PARSE, 3,
                 "rad or m for each joint");
}
END_TEST

START_TEST(units_follow_the_joint_and_the_command)
{
    struct mk_model m;
    struct mk_error err = MK_ERROR_INIT;
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &m);
    ck_assert_str_eq(mk_model_unit(&m, 0, "N m s/rad"), "u s/rad");
    m.u_to_torque = 1.0;
    ck_assert_str_eq(mk_model_unit(&m, 0, "N m s/rad"), "N m s/rad");
    ck_assert_int_eq(mk_model_set_linear(&m, 0, true, &err), MK_OK);
    ck_assert_str_eq(mk_model_unit(&m, -1, "N m s/rad"), "N s/m");
    ck_assert_str_eq(mk_model_unit(&m, 0, "kg m^2"), "kg");
    ck_assert_str_eq(mk_model_unit(&m, 0, "mrad"), "mm");
    ck_assert_str_eq(mk_model_unit(&m, 0, "s"), "s");
    m.u_to_torque = 2.0;
    ck_assert_str_eq(mk_model_unit(&m, 0, "N m s/rad"), "u s/m");
}
END_TEST

START_TEST(the_column_that_drives_the_rig_is_read_and_written)
{
    static const char *const names[MK_INPUT_COUNT] = {NULL, "measured", "commanded"};
    struct mk_model m, back;
    struct mk_error err = MK_ERROR_INIT;
    const char *path = scratch("input.ini");
    char text[8192];
    mk_model_default(MK_PLANT_PENDULUM, &m);
    ck_assert_int_eq(m.input, MK_INPUT_UNSAID);
    for (int i = 0; i < MK_INPUT_COUNT; i++) {
        m.input = (enum mk_input)i;
        ck_assert_int_eq(mk_model_write(path, &m, NULL, &err), MK_OK);
        ck_assert_msg(mk_model_read(path, &back, &err) == MK_OK, "%s", err.message);
        ck_assert_int_eq(back.input, m.input);
        FILE *file = fopen(path, "r");
        ck_assert_ptr_nonnull(file);
        text[fread(text, 1, sizeof text - 1, file)] = '\0';
        fclose(file);
        char line[64];
        snprintf(line, sizeof line, "\ninput = %s\n", names[i] ? names[i] : "");
        ck_assert_msg(names[i] ? strstr(text, line) != NULL : !strstr(text, "input ="), "%s", text);
    }
    expect_error(WHEEL "[rig]\ninput = sent\n", MK_ERR_PARSE, 8, "measured or commanded");
}
END_TEST

START_TEST(comments_blanks_and_line_ends_of_all_kinds_are_understood)
{
    struct mk_model m =
        read_text("\xef\xbb\xbf# head\r\n; too\r\n[rig]\r\n  kind = pendulum  # which\r\n"
                  "\tg=9.8 ; there\r\nencoder_cpr = 2048\r\n\r\n[parameters]\r\n"
                  "p1 = 1e-2\np2=3\np3 = 0\np4 = .5");
    ck_assert_int_eq(m.plant, MK_PLANT_PENDULUM);
    ck_assert(m.g == 9.8 && m.parameter[0] == 0.01 && m.parameter[3] == 0.5);
    ck_assert_int_eq(m.encoder_cpr[0], 2048);
    ck_assert(m.u_max == 10 && m.u_to_torque == 0.00494 && m.rtol == 1e-8);
}
END_TEST

START_TEST(a_rig_without_a_motor_says_so_and_stays_so)
{
    struct mk_model m = read_text(WHEEL), back;
    ck_assert(!m.no_motor);
    m = read_text("[rig]\nkind = pendulum\nmotor = none\n[parameters]\np1=1\np2=3\np3=0\np4=0");
    ck_assert(m.no_motor);
    ck_assert_int_eq(mk_model_write(scratch("passive.ini"), &m, NULL, NULL), MK_OK);
    ck_assert_int_eq(mk_model_read(scratch("passive.ini"), &back, NULL), MK_OK);
    ck_assert(back.no_motor);
    expect_error("[rig]\nkind = pendulum\nmotor = two\n", MK_ERR_PARSE, 3, "expected none");
}
END_TEST

START_TEST(sections_may_come_in_any_order)
{
    struct mk_model m =
        read_text("[effect.coulomb]\nlevel = 0.1\njoint = 1\n[parameters]\np3 = 0.35\n"
                  "p1 = 0.0045\np2 = 0.0112\n[rig]\nkind = inertia-wheel\n");
    ck_assert_int_eq(m.effect_count, 1);
    ck_assert_double_eq(m.effect[0].value[0], 0.1);
}
END_TEST

START_TEST(bad_models_are_refused_with_their_line)
{
    expect_error("", MK_ERR_PARSE, 0, "kind is missing");
    expect_error("[rig]\nkind = acrobat\n", MK_ERR_PARSE, 2, "pendubot");
    expect_error("[rig]\nkind = pendulum\n[parameters]\np1 = 1\n", MK_ERR_PARSE, 0,
                 "p2 is missing");
    expect_error(WHEEL "p4 = 1\n", MK_ERR_PARSE, 7, "unknown key 'p4'");
    expect_error(WHEEL "[rig]\ncolour = red\n", MK_ERR_PARSE, 8, "unknown key 'colour'");
    expect_error(WHEEL "[wheels]\nn = 1\n", MK_ERR_PARSE, 8, "unknown section [wheels]");
    expect_error(WHEEL "p1 = 2\n", MK_ERR_PARSE, 7, "twice");
    const char *friction = WHEEL "[effect.coulomb]\njoint = 1\nlevel = 0.1\n";
    char text[512];
    snprintf(text, sizeof text, "%slevel_spread = -0.1\n", friction);
    expect_error(text, MK_ERR_RANGE, 10, "from log to log");
    snprintf(text, sizeof text, "%slevel_spread = some\n", friction);
    expect_error(text, MK_ERR_PARSE, 10, "number");
    expect_error(WHEEL "[effect.cogging]\njoint = 1\namplitude = 0.1\ncycles = 4\n"
                       "cycles_spread = 1\nphase = 0\n",
                 MK_ERR_PARSE, 11, "cannot differ from log to log");
    expect_error(WHEEL "[effect.warp]\nx = 1\n", MK_ERR_PARSE, 8, "no effect 'warp'");
    expect_error(WHEEL "[bogus]\n", MK_ERR_PARSE, 7, "unknown section [bogus]");
    expect_error(WHEEL "[effect.backlash]\n", MK_ERR_PARSE, 7, "joint is missing");
    expect_error(WHEEL "[effect.warp] ; none\n[simulation]\nrtol = 1e-6\n", MK_ERR_PARSE, 7,
                 "no effect 'warp'");
    expect_error(WHEEL "[effect.input-delay]\n", MK_ERR_PARSE, 7, "delay is missing");
    expect_error(WHEEL "[effect.viscous] joint = 1\ncoefficient = 1\n", MK_ERR_PARSE, 7,
                 "nothing else in the line");
    expect_error(WHEEL "[effect.a-name-that-is-longer-than-any-there-is-by-far]\n", MK_ERR_PARSE, 7,
                 "longer than 49 characters");
    expect_error(WHEEL "[effect.coulomb]\nlevel = 0.1\n", MK_ERR_PARSE, 8,
                 "[effect.coulomb] joint is missing: joint = 1");
    expect_error(WHEEL "[effect.coulomb]\njoint = 0\nlevel = 0.1\n", MK_ERR_PARSE, 8,
                 "needs joint = 1, not 0");
    expect_error(WHEEL "[effect.cogging]\njoint = 1\namplitude = 0.1\ncycles = 1.5\nphase = 0\n",
                 MK_ERR_PARSE, 10, "cycles = '1.5': expected a whole number");
    expect_error(WHEEL "[effect.coulomb.99999999999999999999]\njoint = 1\nlevel = 0.1\n",
                 MK_ERR_PARSE, 8, "unknown section [effect.coulomb.9999");
    read_text(WHEEL "[stderr]\n[simulation]\n");
    read_text(WHEEL "[simulation]\nrtol = 0.1\natol = 0.1\n");
    expect_error(WHEEL "[simulation]\nrtol = 1e300\n", MK_ERR_RANGE, 8, "at most 0.1");
    expect_error(WHEEL "[simulation]\natol = 1\n", MK_ERR_RANGE, 8, "at most 0.1");
    expect_error(WHEEL "[simulation]\natol = 0\n", MK_ERR_RANGE, 8, "must be positive");
    expect_error(WHEEL "[effect.viscous]\njoint = 1\n", MK_ERR_PARSE, 8, "coefficient is missing");
    expect_error(WHEEL "[effect.viscous]\njoint = 3\ncoefficient = 1\n", MK_ERR_PARSE, 8, "joint");
    expect_error(WHEEL "[effect.viscous]\njoint = 1\ncoefficient = 1\nspeed = 2\n", MK_ERR_PARSE,
                 10, "unknown key 'speed'");
    expect_error(WHEEL "[effect.viscous]\njoint = 1\ncoefficient = -1\n", MK_ERR_RANGE, 9,
                 "at least");
    expect_error(WHEEL "[effect.input-delay]\ndelay = 3\n", MK_ERR_RANGE, 8, "between");
    expect_error("[rig]\nkind = inertia-wheel\n[parameters]\np1 = -1\np2 = 0\np3 = 0\n",
                 MK_ERR_RANGE, 4, "at least");
    expect_error("[rig]\nkind = inertia-wheel\n[parameters]\np1 = heavy\np2 = 0\np3 = 0\n",
                 MK_ERR_PARSE, 4, "a finite number");
    expect_error("[rig]\nkind = inertia-wheel\n[parameters]\np1 = inf\np2 = 0\np3 = 0\n",
                 MK_ERR_PARSE, 4, "a finite number");
    expect_error("[rig]\nkind = inertia-wheel\ng = 0\n[parameters]\np1 = 1\np2 = 0\np3 = 0\n",
                 MK_ERR_RANGE, 3, "positive");
    expect_error("[rig]\nkind = inertia-wheel\n[parameters]\np1 = 1\np2 = 1e30\np3 = 0\n",
                 MK_ERR_RANGE, 5, "p2 = 1e30: no rig has more than 1e+09");
    expect_error(WHEEL "[effect.viscous]\njoint = 1\ncoefficient = 1e30\n", MK_ERR_RANGE, 9,
                 "no rig has more than");
    expect_error("[rig]\nkind = inertia-wheel\ng = 1e30\n[parameters]\np1 = 1\np2 = 0\np3 = 0\n",
                 MK_ERR_RANGE, 3, "no rig has more than");
    expect_error(
        "[rig]\nkind = inertia-wheel\nencoder_cpr = 0\n[parameters]\np1 = 1\np2 = 0\np3 = 0\n",
        MK_ERR_RANGE, 3, "must be 1 .. 1e+08");
    expect_error("[rig]\nkind = inertia-wheel\nencoder_cpr = 4000 x\n[parameters]\np1 = 1\np2 = 0\n"
                 "p3 = 0\n",
                 MK_ERR_PARSE, 3, "whole number");
    expect_error("[rig]\nkind = pendubot\n[parameters]\np1=1\np2=1\np3=2\np4=1\np5=1\np6=0\np7=0\n",
                 MK_ERR_RANGE, 0, "p1 p2 must be larger");
    expect_error(WHEEL "nonsense\n", MK_ERR_PARSE, 7, "key = value");
    expect_error(WHEEL "[effect.viscous.x]\njoint = 1\n", MK_ERR_PARSE, 8, "unknown section");
}
END_TEST

START_TEST(random_text_does_no_harm)
{
    static const char *const pieces[] = {"[rig]\n",
                                         "kind = pendubot\n",
                                         "[effect.",
                                         "backlash]\n",
                                         "p1 = ",
                                         "1e400\n",
                                         "=",
                                         "\n",
                                         "[",
                                         "]",
                                         "\x01",
                                         "joint = 2",
                                         "[parameters]",
                                         "encoder_cpr = -1\n",
                                         "#",
                                         ";",
                                         " "};
    srand(4);
    for (int i = 0; i < 3000; i++) {
        char text[1200] = "";
        struct mk_model m;
        for (int k = rand() % 40; k > 0; k--)
            strcat(text, pieces[(size_t)rand() % (sizeof pieces / sizeof pieces[0])]);
        (void)!mk_model_read(scratch_text("fuzz.ini", text), &m, NULL);
    }
    char longer[3000];
    memset(longer, 'a', sizeof longer - 1);
    longer[sizeof longer - 1] = '\0';
    expect_error(longer, MK_ERR_PARSE, 1, "too long");
}
END_TEST

START_TEST(a_full_disk_keeps_the_old_model)
{
    struct mk_model m, back;
    struct mk_error err = MK_ERROR_INIT;
    const char *path = scratch_text("old.ini", WHEEL);
    struct rlimit limit;
    signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &limit);
    limit.rlim_cur = 40;
    setrlimit(RLIMIT_FSIZE, &limit);
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    ck_assert_int_eq(mk_model_write(path, &m, NULL, &err), MK_ERR_NOSPACE);
    ck_assert_int_eq(mk_model_read(path, &back, &err), MK_OK);
    ck_assert_int_eq(back.plant, MK_PLANT_INERTIA_WHEEL);
    ck_assert_int_eq(mk_model_read(scratch("none.ini"), &back, &err), MK_ERR_NOTFOUND);
    ck_assert_int_eq(mk_model_write("/no/such/place.ini", &m, NULL, &err), MK_ERR_NOTFOUND);
}
END_TEST

START_TEST(writing_follows_links_and_replaces_no_device)
{
    struct mk_model m, back;
    struct mk_error err = MK_ERROR_INIT;
    struct stat info;
    const char *file = scratch_text("file.ini", WHEEL), *link = scratch("link.ini");
    const char *device = scratch("device.ini");
    ck_assert(chmod(file, 0640) == 0 && symlink(file, link) == 0);
    ck_assert(symlink("/dev/null", device) == 0);
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    ck_assert_int_eq(mk_model_write(link, &m, NULL, &err), MK_OK);
    ck_assert(lstat(link, &info) == 0 && S_ISLNK(info.st_mode));
    ck_assert(stat(file, &info) == 0 && (info.st_mode & 0777) == 0640);
    ck_assert_int_eq(mk_model_read(file, &back, &err), MK_OK);
    ck_assert_int_eq(back.plant, MK_PLANT_PENDUBOT);
    ck_assert_int_eq(mk_model_write(device, &m, NULL, &err), MK_OK);
    ck_assert(lstat(device, &info) == 0 && S_ISLNK(info.st_mode));
    ck_assert_int_eq(mk_model_write("/dev/full", &m, NULL, &err), MK_ERR_NOSPACE);
}
END_TEST

START_TEST(the_models_that_ship_are_the_defaults)
{
    for (int kind = 0; kind < MK_PLANT_COUNT; kind++) {
        char path[512];
        struct mk_model m, want;
        struct mk_error err = MK_ERROR_INIT;
        snprintf(path, sizeof path, MK_SOURCE_DIR "/models/%s.ini",
                 mk_plant((enum mk_plant_kind)kind)->name);
        ck_assert_msg(mk_model_read(path, &m, &err) == MK_OK, "%s", err.message);
        mk_model_default((enum mk_plant_kind)kind, &want);
        ck_assert_int_eq(memcmp(m.parameter, want.parameter, sizeof m.parameter), 0);
    }
}
END_TEST

Suite *suite_model_file(void)
{
    Suite *s = suite_create("model_file");
    TCase *t = tcase_create("files");
    tcase_set_timeout(t, 20);
    tcase_add_test(t, a_joint_that_slides_reads_back_equal);
    tcase_add_test(t, a_device_that_never_ends_a_line_is_no_model_file);
    tcase_add_test(t, the_sharpness_of_friction_is_the_rig_s_unless_an_effect_has_its_own);
    tcase_add_test(t, a_parameter_that_does_nothing_on_a_rig_is_neither_written_nor_fitted);
    tcase_add_test(t, units_that_do_not_go_together_are_refused);
    tcase_add_test(t, units_follow_the_joint_and_the_command);
    tcase_add_test(t, a_model_that_is_written_reads_back_equal);
    tcase_add_test(t, the_column_that_drives_the_rig_is_read_and_written);
    tcase_add_test(t, comments_blanks_and_line_ends_of_all_kinds_are_understood);
    tcase_add_test(t, a_rig_without_a_motor_says_so_and_stays_so);
    tcase_add_test(t, sections_may_come_in_any_order);
    tcase_add_test(t, bad_models_are_refused_with_their_line);
    tcase_add_test(t, random_text_does_no_harm);
    tcase_add_test(t, a_full_disk_keeps_the_old_model);
    tcase_add_test(t, writing_follows_links_and_replaces_no_device);
    tcase_add_test(t, the_models_that_ship_are_the_defaults);
    suite_add_tcase(s, t);
    return s;
}
