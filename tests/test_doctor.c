/* The doctor, on rigs made ill on purpose: each illness is named, and what to do about it. */
#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "console/commands/doctor.h"

static struct mk_model model, rig; /* what is believed; what is there */
static struct mk_clock clock_;
static struct mk_board *board;
static struct mk_board_ops ill; /* the virtual board with something wrong */
static struct doctor doctor;
static char report[8192];

static void note_line(void *user, enum doctor_verdict verdict, const char *what, const char *found,
                      const char *advice)
{
    (void)user;
    size_t used = strlen(report);
    snprintf(report + used, sizeof report - used, "%c %s: %s -> %s\n", "+!-"[verdict], what, found,
             advice);
    ck_assert_int_eq(verdict == DOCTOR_PROBLEM, advice[0] != '\0');
}

static int asked; /* requests so far */
static double asked_at;
static void note_request(void *user, const char *what)
{
    (void)user;
    (void)what;
    asked++;
    asked_at = 1e-9 * (double)mk_clock_now_ns(&clock_);
}

static void setup(void)
{
    mk_model_default(MK_PLANT_PENDUBOT, &model);
    rig = model;
    mk_clock_init_simulated(&clock_);
    ill = *mk_board_backend_by_name("virtual");
    doctor = (struct doctor){.line = note_line, .ask = note_request};
    board = NULL;
    report[0] = '\0';
    asked = 0;
}

static void teardown(void)
{
    mk_board_close(board);
}

static void open_rig(double angle)
{
    struct mk_error err = MK_ERROR_INIT;
    const struct mk_board_config config = {.model = &rig, .clock = &clock_, .start = {0, angle}};
    ck_assert_msg(mk_board_open(&ill, &config, &board, &err) == MK_OK, "%s", err.message);
}

static void ck_assert_says(const char *text)
{
    ck_assert_msg(strstr(report, text) != NULL, "no '%s' in:\n%s", text, report);
}

/* --- what is wrong with it ----------------------------------------------------------------------
 */

static enum mk_status well_exchange(struct mk_board *b, double u, struct mk_board_sample *out)
{
    return mk_board_backend_by_name("virtual")->exchange(b, u, out);
}

static enum mk_status swapped_exchange(struct mk_board *b, double u, struct mk_board_sample *out)
{
    enum mk_status st = well_exchange(b, u, out);
    int32_t first = out->count[0];
    out->count[0] = out->count[1];
    out->count[1] = first;
    return st;
}
static enum mk_status encoder_1_backwards(struct mk_board *b, double u, struct mk_board_sample *out)
{
    enum mk_status st = well_exchange(b, u, out);
    out->count[0] = -out->count[0];
    return st;
}
static enum mk_status encoder_2_backwards(struct mk_board *b, double u, struct mk_board_sample *out)
{
    enum mk_status st = well_exchange(b, u, out);
    out->count[1] = -out->count[1];
    return st;
}
static enum mk_status motor_backwards(struct mk_board *b, double u, struct mk_board_sample *out)
{
    enum mk_status st = well_exchange(b, -u, out);
    out->u_applied = u;
    return st;
}
static enum mk_status motor_off(struct mk_board *b, double u, struct mk_board_sample *out)
{
    enum mk_status st = well_exchange(b, 0.0, out);
    out->u_applied = u;
    return st;
}
static enum mk_status loses_some(struct mk_board *b, double u, struct mk_board_sample *out)
{
    static int n;
    return n++ % 50 == 7 ? MK_ERR_TIMEOUT : well_exchange(b, u, out);
}
static enum mk_status toothless(struct mk_board *b, unsigned ms, struct mk_error *err)
{
    (void)ms;
    return mk_board_backend_by_name("virtual")->set_watchdog(b, 0, err);
}

/* --- board
 * ---------------------------------------------------------------------------------------- */

START_TEST(a_healthy_board_passes)
{
    open_rig(0);
    ck_assert(doctor_board(&doctor, board, &model));
    ck_assert_msg(doctor.problems == 0, "%s", report);
    ck_assert_says("+ watchdog: bites after 20 ms");
}
END_TEST

START_TEST(a_watchdog_that_does_not_bite_is_found)
{
    ill.set_watchdog = toothless;
    open_rig(0);
    doctor_board(&doctor, board, &model);
    ck_assert_says("! watchdog: did not bite");
}
END_TEST

START_TEST(lost_exchanges_are_counted)
{
    ill.exchange = loses_some;
    open_rig(0);
    doctor_board(&doctor, board, &model);
    ck_assert_says("! exchanges: 400");
    ck_assert_says("8 lost, 0 gaps");
}
END_TEST

START_TEST(encoders_of_another_resolution_are_found)
{
    rig.encoder_cpr[1] = 5000;
    open_rig(0);
    doctor_board(&doctor, board, &model);
    ck_assert_says("! encoder counts: joint 2: board 5000 a turn, model 4000");
}
END_TEST

/* --- rig, by motor
 * --------------------------------------------------------------------------------- */

START_TEST(links_that_swing_are_told_to_come_to_rest)
{
    open_rig(0.1);
    ck_assert(!doctor_rest(&doctor, board, &model));
    ck_assert_says("! links: joint 2 moves by");
}
END_TEST

static const struct {
    enum mk_status (*exchange)(struct mk_board *, double, struct mk_board_sample *);
    const char *says;
} wirings[] = {
    {well_exchange, "+ motor and encoders: a push moved joint"},
    {swapped_exchange, "! motor and encoders: the encoders are swapped"},
    {encoder_1_backwards, "! motor and encoders: encoder 1 counts backwards"},
    {encoder_2_backwards, "! motor and encoders: encoder 2 counts backwards"},
    {motor_backwards, "! motor and encoders: the motor turns backwards"},
    {motor_off, "! motor and encoders: a push moved the joints by +0.000"},
};
#define WIRINGS ((int)(sizeof wirings / sizeof wirings[0]))

static void check_wiring(enum mk_plant_kind plant, int i)
{
    mk_model_default(plant, &model);
    rig = model;
    rig.parameter[0] *= 1.1; /* not quite what is believed, as in life */
    ill.exchange = wirings[i].exchange;
    open_rig(0);
    ck_assert_int_eq(doctor_push(&doctor, board, &model), i == 0);
    ck_assert_says(wirings[i].says);
}

START_TEST(two_pushes_tell_how_a_pendubot_is_wired)
{
    check_wiring(MK_PLANT_PENDUBOT, _i);
}
END_TEST

START_TEST(two_pushes_tell_how_a_reaction_wheel_is_wired)
{
    check_wiring(MK_PLANT_REACTION_WHEEL, _i);
}
END_TEST

START_TEST(two_pushes_tell_how_a_furuta_pendulum_is_wired)
{
    check_wiring(MK_PLANT_FURUTA, _i);
}
END_TEST

START_TEST(two_pushes_tell_how_a_cart_pole_is_wired)
{
    check_wiring(MK_PLANT_CART_POLE, _i);
}
END_TEST

START_TEST(two_pushes_tell_how_an_acrobot_is_wired)
{
    check_wiring(MK_PLANT_ACROBOT, _i);
}
END_TEST

START_TEST(what_a_push_moved_is_said_in_the_unit_of_each_joint)
{
    mk_model_default(MK_PLANT_CART_POLE, &model);
    rig = model;
    ill.exchange = motor_off;
    open_rig(0);
    ck_assert(!doctor_push(&doctor, board, &model));
    ck_assert_says(" m and ");
    ck_assert_says(" rad, as no wiring explains");
}
END_TEST

static const enum mk_plant_kind swept[] = {MK_PLANT_PENDUBOT, MK_PLANT_FURUTA, MK_PLANT_PENDULUM,
                                           MK_PLANT_ACROBOT, MK_PLANT_CART_POLE};
#define SWEPT ((int)(sizeof swept / sizeof swept[0]))

START_TEST(a_slow_sweep_finds_nothing_on_a_healthy_rig)
{
    mk_model_default(swept[_i], &model);
    rig = model;
    open_rig(0);
    doctor_sweep(&doctor, board, &model);
    ck_assert_msg(doctor.problems == 0, "%s", report);
    ck_assert_says("+ cable drag");
}
END_TEST

START_TEST(a_slow_sweep_finds_a_cable_that_drags)
{
    mk_model_default(swept[_i], &model);
    rig = model;
    int coulomb = mk_plant(swept[_i])->parameter_count - 1;
    rig.parameter[coulomb] += 0.5;
    open_rig(0);
    doctor_sweep(&doctor, board, &model);
    ck_assert_says("! cable drag: friction of");
}
END_TEST

START_TEST(a_wheel_has_no_cable_to_drag)
{
    mk_model_default(MK_PLANT_REACTION_WHEEL, &model);
    rig = model;
    open_rig(0);
    doctor_sweep(&doctor, board, &model);
    ck_assert_says("- cable drag");
    ck_assert_int_eq(doctor.problems, 0);
}
END_TEST

static int driven; /* exchanges with a command */

static enum mk_status count_commands(struct mk_board *b, double u, struct mk_board_sample *out)
{
    driven += u != 0.0;
    return well_exchange(b, u, out);
}

START_TEST(what_is_broken_off_drives_nothing_and_finds_nothing)
{
    int cancel = 1;
    ill.exchange = count_commands;
    driven = 0;
    open_rig(0);
    doctor.cancel = &cancel;
    ck_assert(!doctor_push(&doctor, board, &model));
    doctor_sweep(&doctor, board, &model);
    doctor_by_hand(&doctor, board, &model);
    ck_assert_int_eq(driven, 0);
    ck_assert_str_eq(report, "");
}
END_TEST

/* --- by hand: a board whose encoders follow somebody who does as he is asked
 * ------------------------ */

static struct hand {
    bool swapped, dead, backwards;
} hand;

static enum mk_status hand_exchange(struct mk_board *b, double u, struct mk_board_sample *out)
{
    static const int joint[] = {1, 1, 0, 0};
    static const double sign[] = {1, -1, 1, -1};
    static double angle[2];
    static int done;
    ck_assert_double_eq(u, 0.0);
    double t = 1e-9 * (double)mk_clock_now_ns(&clock_);
    if (asked > done && asked <= 4 && t > asked_at + 1.0) {
        angle[joint[asked - 1]] += sign[asked - 1] * 0.01; /* 5 rad/s from a second later on */
        if (t > asked_at + 1.4)
            done = asked;
    }
    enum mk_status st = well_exchange(b, 0.0, out);
    for (int j = 0; j < 2; j++) {
        double q = hand.dead ? 0.0 : hand.backwards ? -angle[j] : angle[j];
        out->count[hand.swapped ? 1 - j : j] = (int32_t)lround(q * 4000 / (2 * M_PI));
    }
    return st;
}

static void check_by_hand(struct hand how)
{
    hand = how;
    ill.exchange = hand_exchange;
    open_rig(0);
    doctor_by_hand(&doctor, board, &model);
}

START_TEST(encoders_that_count_both_ways_pass)
{
    check_by_hand((struct hand){0});
    ck_assert_msg(doctor.problems == 0, "%s", report);
    ck_assert_says("+ encoder 2: counts both ways");
    ck_assert_says("+ encoder 1: counts both ways");
}
END_TEST

START_TEST(swapped_encoders_are_found_by_hand)
{
    check_by_hand((struct hand){.swapped = true});
    ck_assert_says("! encoder 2: encoder 1 counts instead: they are swapped");
}
END_TEST

START_TEST(a_dead_encoder_is_found_by_hand)
{
    check_by_hand((struct hand){.dead = true});
    ck_assert_says("! encoder 2: no count within 30 s");
    ck_assert_says("! encoder 1: no count within 30 s");
}
END_TEST

START_TEST(an_encoder_that_counts_backwards_is_found_by_hand)
{
    check_by_hand((struct hand){.backwards = true});
    ck_assert_says("! encoder 2: counts backwards");
}
END_TEST

Suite *suite_doctor(void)
{
    Suite *s = suite_create("doctor");
    TCase *t = tcase_create("doctor");
    tcase_add_checked_fixture(t, setup, teardown);
    tcase_add_test(t, a_healthy_board_passes);
    tcase_add_test(t, a_watchdog_that_does_not_bite_is_found);
    tcase_add_test(t, lost_exchanges_are_counted);
    tcase_add_test(t, encoders_of_another_resolution_are_found);
    tcase_add_test(t, links_that_swing_are_told_to_come_to_rest);
    tcase_add_loop_test(t, two_pushes_tell_how_a_pendubot_is_wired, 0, WIRINGS);
    tcase_add_loop_test(t, two_pushes_tell_how_a_reaction_wheel_is_wired, 0, WIRINGS);
    tcase_add_loop_test(t, two_pushes_tell_how_a_furuta_pendulum_is_wired, 0, WIRINGS);
    tcase_add_loop_test(t, two_pushes_tell_how_a_cart_pole_is_wired, 0, WIRINGS);
    tcase_add_loop_test(t, two_pushes_tell_how_an_acrobot_is_wired, 0, WIRINGS);
    tcase_add_test(t, what_a_push_moved_is_said_in_the_unit_of_each_joint);
    tcase_add_loop_test(t, a_slow_sweep_finds_nothing_on_a_healthy_rig, 0, SWEPT);
    tcase_add_loop_test(t, a_slow_sweep_finds_a_cable_that_drags, 0, SWEPT);
    tcase_add_test(t, a_wheel_has_no_cable_to_drag);
    tcase_add_test(t, what_is_broken_off_drives_nothing_and_finds_nothing);
    tcase_add_test(t, encoders_that_count_both_ways_pass);
    tcase_add_test(t, swapped_encoders_are_found_by_hand);
    tcase_add_test(t, a_dead_encoder_is_found_by_hand);
    tcase_add_test(t, an_encoder_that_counts_backwards_is_found_by_hand);
    suite_add_tcase(s, t);
    return s;
}
