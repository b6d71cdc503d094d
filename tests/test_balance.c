/* The four setups that balance, closed on the simulated plant they believe. */
#include "suites.h"

#include <math.h>
#include <string.h>

#include "support/closed.h"

#define BALANCING_COUNT 4
static const char *const balancing[BALANCING_COUNT] = {"pendubot-mid", "pendubot-top",
                                                       "reaction-wheel", "furuta"};

/* The upright link's angle from the upward vertical. */
static double tilt(const struct closed *c)
{
    const double *x = closed_state(c);
    double angle = c->rig.plant == MK_PLANT_PENDUBOT         ? x[0] + x[1] - 0.5 * M_PI
                   : c->rig.plant == MK_PLANT_REACTION_WHEEL ? x[0] - M_PI
                                                             : x[1];
    return fabs(remainder(angle, 2.0 * M_PI));
}

static void open_balanced(struct closed *c, const char *setup)
{
    closed_open(c, setup, NULL);
    ck_assert_double_lt(closed_until(c, MK_PHASE_BALANCE, 4.0), 4.0);
    closed_run(c, 1.0);
    ck_assert_int_eq(c->out.phase, MK_PHASE_BALANCE);
}

START_TEST(it_is_caught_within_four_seconds_and_held_for_twenty)
{
    struct closed c;
    closed_open(&c, balancing[_i], NULL);
    ck_assert_double_lt(closed_until(&c, MK_PHASE_BALANCE, 4.0), 4.0);
    ck_assert(closed_stays(&c, MK_PHASE_BALANCE, 2.0));
    for (int k = 0; k < 9000; k++) {
        closed_tick(&c);
        ck_assert_int_eq(c.out.phase, MK_PHASE_BALANCE);
        ck_assert_msg(tilt(&c) < 0.03, "tilt %g rad at %g s", tilt(&c), c.in.t);
    }
    closed_close(&c);
}
END_TEST

START_TEST(the_swing_up_starts_as_swing_up)
{
    struct closed c;
    closed_open(&c, balancing[_i], NULL);
    ck_assert(closed_stays(&c, MK_PHASE_SWINGUP, 0.5));
    closed_close(&c);
}
END_TEST

START_TEST(what_was_knocked_over_is_caught_again)
{
    struct closed c;
    open_balanced(&c, balancing[_i]);
    /* Hanging, the driven joint displaced and swinging: no balance to hold. */
    const double *rest = mk_plant(c.rig.plant)->rest;
    bool wheel = c.rig.plant == MK_PLANT_REACTION_WHEEL;
    closed_put(&c, rest[0] + (wheel ? 0.2 : 0.6), rest[1], wheel ? 1.0 : -2.0, 3.0);
    ck_assert_double_lt(closed_until(&c, MK_PHASE_SWINGUP, 0.2), INFINITY);
    double from = c.in.t, caught = INFINITY;
    while (c.in.t < from + 15.0 && isinf(caught)) {
        double t = closed_until(&c, MK_PHASE_BALANCE, 15.0);
        if (closed_stays(&c, MK_PHASE_BALANCE, 5.0))
            caught = t;
    }
    ck_assert_double_lt(caught, from + 15.0);
    closed_close(&c);
}
END_TEST

START_TEST(a_push_while_balancing_is_absorbed)
{
    struct closed c;
    open_balanced(&c, balancing[_i]);
    const double *x = closed_state(&c);
    double push = c.rig.plant == MK_PLANT_REACTION_WHEEL ? 0.4 : 1.0; /* rad/s */
    closed_put(&c, x[0], x[1], x[2] + 0.3 * push, x[3] + push);
    ck_assert(closed_stays(&c, MK_PHASE_BALANCE, 3.0));
    ck_assert_double_lt(tilt(&c), 0.03);
    closed_close(&c);
}
END_TEST

START_TEST(the_driven_link_keeps_within_one_and_a_half_turns)
{
    struct closed c;
    closed_open(&c, balancing[_i], NULL);
    double rest = mk_plant(c.rig.plant)->rest[0], farthest = 0.0;
    for (int k = 0; k < 5000; k++) {
        closed_tick(&c);
        farthest = fmax(farthest, fabs(closed_state(&c)[0] - rest));
    }
    ck_assert_msg(farthest < 3.0 * M_PI, "%g rad", farthest);
    closed_close(&c);
}
END_TEST

/* --- gains ------------------------------------------------------------------------------- */

static const struct {
    const char *setup, *source;
    double gain[4];
} published[] = {
    {"pendubot-mid", "(4.6)", {48.23, 5.25, 62.4, 7.86}},
    {"pendubot-mid", "(4.12)", {122.61, 13.11, 152.29, 19.88}},
    {"pendubot-top", "(4.7)", {-61.3, -10.47, -62.4, -7.86}},
    {"pendubot-top", "(4.14)", {-160.78, -26.92, -158.72, -20.81}},
    {"reaction-wheel", "(4.16)", {-400.0, -35.0, -0.07}},
    {"reaction-wheel", "errata 5.4, first", {-400.0, -45.08, -0.07}},
    {"reaction-wheel", "errata 5.4, second", {-310.6, -35.0, -0.07}},
};
#define PUBLISHED_COUNT 7

static void take_gains(struct closed *c, const double *gain)
{
    const struct mk_ctrl_ops *ops = c->ctrl->ops;
    for (int i = 0, n = 0; i < ops->param_count; i++)
        if (ops->param[i].gain)
            closed_set(c, ops->param[i].name, gain[n++]);
}

START_TEST(published_gains_swing_up_and_hold)
{
    struct closed c;
    closed_open(&c, published[_i].setup, NULL);
    take_gains(&c, published[_i].gain);
    double caught = closed_until(&c, MK_PHASE_BALANCE, 6.0);
    ck_assert_msg(caught < 6.0, "%s", published[_i].source);
    ck_assert_msg(closed_stays(&c, MK_PHASE_BALANCE, 10.0), "%s", published[_i].source);
    ck_assert_double_lt(tilt(&c), 0.03);
    closed_close(&c);
}
END_TEST

START_TEST(gains_change_in_flight_without_a_fall)
{
    struct closed c;
    open_balanced(&c, published[_i].setup);
    double before = c.ctrl->value[0];
    take_gains(&c, published[_i].gain);
    ck_assert_double_ne(c.ctrl->value[0], before);
    ck_assert(closed_stays(&c, MK_PHASE_BALANCE, 5.0));
    ck_assert_double_lt(tilt(&c), 0.03);
    closed_close(&c);
}
END_TEST

START_TEST(gains_take_effect_at_the_next_sample)
{
    struct closed c, twin;
    open_balanced(&c, "furuta");
    open_balanced(&twin, "furuta");
    closed_tick(&twin);
    static const double none[4] = {0.0, 0.0, 0.0, 0.0};
    take_gains(&c, none);
    closed_tick(&c);
    ck_assert_double_eq(c.out.u, 0.0);
    ck_assert_double_ne(twin.out.u, 0.0);
    closed_close(&c);
    closed_close(&twin);
}
END_TEST

START_TEST(gains_that_do_not_balance_never_take_over)
{
    static const double none[4] = {0.0, 0.0, 0.0, 0.0};
    struct closed c;
    closed_open(&c, balancing[_i], NULL);
    take_gains(&c, none);
    /* The level set is that of the designed gains; outside of it the look-ahead must see through
     * gains that hold nothing. */
    closed_set(&c, "level", 0.01);
    ck_assert(closed_stays(&c, MK_PHASE_SWINGUP, 6.0));
    closed_close(&c);
}
END_TEST

/* --- the report's swing-up
 * ------------------------------------------------------------------------- */

START_TEST(the_reports_path_for_mid_is_tracked_while_the_command_suffices)
{
    struct closed c;
    closed_open(&c, "pendubot-mid", NULL);
    closed_set(&c, "method", 1);
    double worst = 0.0;
    for (int k = 0; k < 500; k++) {
        closed_tick(&c);
        if (c.in.t > 0.3 && c.out.phase == MK_PHASE_SWINGUP)
            worst = fmax(worst, fabs(c.in.q[0] - c.out.ref));
        double expected = 1.65 * sin(5.5 * c.in.t) - 0.5 * M_PI;
        if (c.out.phase == MK_PHASE_SWINGUP)
            ck_assert_double_eq_tol(c.out.ref, expected, 1e-9);
    }
    ck_assert_msg(worst < 0.25, "%g rad off the path", worst);
    closed_close(&c);
}
END_TEST

START_TEST(the_reports_swing_up_reaches_the_top_in_its_first_attempt)
{
    struct closed c;
    closed_open(&c, "pendubot-top", NULL);
    closed_set(&c, "method", 1);
    closed_run(&c, 0.3);
    ck_assert_double_eq(c.out.u, -3.0); /* open loop in the wrong direction */
    ck_assert_double_lt(closed_until(&c, MK_PHASE_BALANCE, 1.2), INFINITY);
    ck_assert(closed_stays(&c, MK_PHASE_BALANCE, 10.0));
    closed_close(&c);
}
END_TEST

START_TEST(where_the_reports_path_misses_the_energy_method_goes_on)
{
    struct closed c;
    closed_open(&c, "pendubot-top", NULL);
    closed_set(&c, "method", 1);
    closed_set(&c, "back_time", 0.2); /* a duration that misses */
    ck_assert(closed_stays(&c, MK_PHASE_SWINGUP, 2.5));
    double caught = closed_until(&c, MK_PHASE_BALANCE, 12.0);
    ck_assert_double_lt(caught, 14.0);
    ck_assert(closed_stays(&c, MK_PHASE_BALANCE, 5.0));
    closed_close(&c);
}
END_TEST

Suite *suite_balance(void)
{
    Suite *s = suite_create("balance");
    TCase *t = tcase_create("closed loop");
    tcase_set_timeout(t, 180);
    tcase_add_loop_test(t, it_is_caught_within_four_seconds_and_held_for_twenty, 0,
                        BALANCING_COUNT);
    tcase_add_loop_test(t, the_swing_up_starts_as_swing_up, 0, BALANCING_COUNT);
    tcase_add_loop_test(t, what_was_knocked_over_is_caught_again, 0, BALANCING_COUNT);
    tcase_add_loop_test(t, a_push_while_balancing_is_absorbed, 0, BALANCING_COUNT);
    tcase_add_loop_test(t, the_driven_link_keeps_within_one_and_a_half_turns, 0, BALANCING_COUNT);
    suite_add_tcase(s, t);

    t = tcase_create("gains");
    tcase_set_timeout(t, 180);
    tcase_add_loop_test(t, published_gains_swing_up_and_hold, 0, PUBLISHED_COUNT);
    tcase_add_loop_test(t, gains_change_in_flight_without_a_fall, 0, PUBLISHED_COUNT);
    tcase_add_test(t, gains_take_effect_at_the_next_sample);
    tcase_add_loop_test(t, gains_that_do_not_balance_never_take_over, 0, BALANCING_COUNT);
    suite_add_tcase(s, t);

    t = tcase_create("report");
    tcase_set_timeout(t, 120);
    tcase_add_test(t, the_reports_path_for_mid_is_tracked_while_the_command_suffices);
    tcase_add_test(t, the_reports_swing_up_reaches_the_top_in_its_first_attempt);
    tcase_add_test(t, where_the_reports_path_misses_the_energy_method_goes_on);
    suite_add_tcase(s, t);
    return s;
}
