#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ctrl/fault_line.h"
#include "mechkit/safety.h"
#include "support/files.h"

#define DT 0.002

static struct mk_model model;
static struct mk_safety safety;
static struct mk_safety_limits limits;

static void use_plant(enum mk_plant_kind kind)
{
    mk_model_default(kind, &model);
    mk_safety_default(&model, DT, &limits);
    mk_safety_init(&safety, &model, &limits);
}

static void setup(void)
{
    use_plant(MK_PLANT_PENDUBOT);
}

/* One sample of a pendubot near (q1, q2). */
static enum mk_fault look(double t, double q1, double q2, double v1, double v2, double u)
{
    const double q[MK_MAX_JOINTS] = {q1, q2}, v[MK_MAX_JOINTS] = {v1, v2};
    return mk_safety_check(&safety, t, DT, q, v, u);
}

START_TEST(every_fault_has_a_name_and_a_text)
{
    for (int f = 0; f < MK_FAULT_COUNT; f++) {
        ck_assert_str_ne(mk_fault_name((enum mk_fault)f), "?");
        ck_assert_str_ne(mk_fault_text((enum mk_fault)f), "unknown fault");
        for (int g = 0; g < f; g++)
            ck_assert_str_ne(mk_fault_name((enum mk_fault)f), mk_fault_name((enum mk_fault)g));
    }
    ck_assert_str_eq(mk_fault_name(MK_FAULT_COUNT), "?");
}
END_TEST

START_TEST(a_fault_of_no_joint_names_none)
{
    char line[MK_FAULT_LINE];
    mk_fault_line(MK_FAULT_LINK, 0, 1.25, line);
    ck_assert_str_eq(line, "link at 1.25 s");
    mk_fault_line(MK_FAULT_JUMP, 2, 1.25, line);
    ck_assert_str_eq(line, "encoder-jump, joint 2, at 1.25 s");
}
END_TEST

START_TEST(a_healthy_motion_trips_nothing)
{
    /* Two turns of link 1 at 10 rad/s, driven the right way round. */
    for (int k = 0; k < 600; k++) {
        double t = k * DT;
        ck_assert_int_eq(look(t, -M_PI_2 + 10.0 * t, 0.0, 10.0, 0.0, 2.0), MK_FAULT_NONE);
    }
}
END_TEST

START_TEST(the_first_fault_stays_until_cleared)
{
    mk_safety_latch(&safety, MK_FAULT_ESTOP, 1.5, 0);
    ck_assert_int_eq(mk_safety_latch(&safety, MK_FAULT_SPEED, 2.0, 1), MK_FAULT_ESTOP);
    ck_assert_double_eq(safety.fault_t, 1.5);
    ck_assert_int_eq(look(2.0, 1e9, 0, 0, 0, 0), MK_FAULT_ESTOP);
    mk_safety_clear(&safety);
    ck_assert_int_eq(safety.fault, MK_FAULT_NONE);
    ck_assert_double_eq(safety.limits.dt_s, DT);
    ck_assert_int_eq(look(0.0, -M_PI_2, 0, 0, 0, 0), MK_FAULT_NONE);
}
END_TEST

START_TEST(travel_beyond_either_limit_trips)
{
    for (int side = -1; side <= 1; side += 2) {
        mk_safety_clear(&safety);
        safety.limits.q_min[1] = -3.0;
        safety.limits.q_max[1] = 3.0;
        look(0, -M_PI_2, side * 2.99, 0, 0, 0);
        ck_assert_int_eq(look(DT, -M_PI_2, side * 3.0, 0, 0, 0), MK_FAULT_NONE);
        ck_assert_int_eq(look(2 * DT, -M_PI_2, side * 3.01, 0, 0, 0), MK_FAULT_TRAVEL);
        ck_assert_int_eq(safety.fault_joint, 2);
        ck_assert_double_eq(safety.fault_t, 2 * DT);
    }
}
END_TEST

START_TEST(a_carriage_is_stopped_before_the_end_of_its_track)
{
    use_plant(MK_PLANT_CART_POLE);
    const double track = mk_plant(MK_PLANT_CART_POLE)->joint_travel[0]; /* m */
    ck_assert(track > 0.1 && track < 1.0);
    for (int side = -1; side <= 1; side += 2) {
        mk_safety_clear(&safety);
        look(0, side * (track - 2e-3), M_PI, side * 1.0, 0, 0);
        ck_assert_int_eq(look(DT, side * (track - 1e-4), M_PI, side * 1.0, 0, 0), MK_FAULT_NONE);
        ck_assert_int_eq(look(2 * DT, side * (track + 1e-3), M_PI, side * 1.0, 0, 0),
                         MK_FAULT_TRAVEL);
        ck_assert_int_eq(safety.fault_joint, 1);
    }
    /* Its speeds are those of a swing-up, and a jump of a decimetre is one. */
    mk_safety_clear(&safety);
    ck_assert_int_eq(look(0, 0, M_PI, 3.0, 0, 0), MK_FAULT_NONE);
    ck_assert_int_eq(look(DT, 0.1, M_PI, 3.0, 0, 0), MK_FAULT_JUMP);
}
END_TEST

START_TEST(a_wheel_may_turn_for_ever)
{
    use_plant(MK_PLANT_REACTION_WHEEL);
    look(0, 0, 1e6, 0, 0, 0);
    ck_assert_int_eq(look(DT, 0, 1e6 + 0.1, 0, 50, 0), MK_FAULT_NONE);
}
END_TEST

START_TEST(speed_beyond_the_limit_trips_either_way)
{
    for (int side = -1; side <= 1; side += 2) {
        mk_safety_clear(&safety);
        ck_assert_int_eq(look(0, -M_PI_2, 0, side * limits.v_max[0], 0, 0), MK_FAULT_NONE);
        ck_assert_int_eq(look(DT, -M_PI_2, 0, side * limits.v_max[0] * 1.01, 0, 0), MK_FAULT_SPEED);
        ck_assert_int_eq(safety.fault_joint, 1);
    }
}
END_TEST

START_TEST(a_speed_or_an_angle_that_is_no_number_trips)
{
    look(0, -M_PI_2, 0, 0, 0, 0);
    ck_assert_int_eq(look(DT, -M_PI_2, 0, NAN, 0, 0), MK_FAULT_SPEED);
    mk_safety_clear(&safety);
    look(0, -M_PI_2, 0, 0, 0, 0);
    ck_assert_int_eq(look(DT, -M_PI_2, NAN, 0, 0, 0), MK_FAULT_JUMP);
}
END_TEST

START_TEST(a_joint_may_go_as_far_in_a_sample_as_the_limit_says)
{
    for (int side = -1; side <= 1; side += 2) {
        mk_safety_clear(&safety);
        safety.limits.jump_rad[1] = 0.25;
        look(0, -M_PI_2, 0, 0, 0, 0);
        ck_assert_int_eq(look(DT, -M_PI_2, side * 0.25, 0, 0, 0), MK_FAULT_NONE);
        ck_assert_int_eq(look(2 * DT, -M_PI_2, side * 0.501, 0, 0, 0), MK_FAULT_JUMP);
    }
}
END_TEST

START_TEST(a_jump_trips_and_names_its_joint)
{
    look(0, -M_PI_2, 0, 0, 0, 0);
    ck_assert_int_eq(look(DT, -M_PI_2, 0.9 * limits.jump_rad[1], 0, 0, 0), MK_FAULT_NONE);
    ck_assert_int_eq(look(2 * DT, -M_PI_2, 2.5 * limits.jump_rad[1], 0, 0, 0), MK_FAULT_JUMP);
    ck_assert_int_eq(safety.fault_joint, 2);
}
END_TEST

START_TEST(after_lost_samples_a_joint_may_have_moved_further)
{
    const double q[] = {-M_PI_2, 0}, far[] = {-M_PI_2, 2.5 * limits.jump_rad[1]}, v[] = {0, 0};
    mk_safety_check(&safety, 0, DT, q, v, 0);
    ck_assert_int_eq(mk_safety_check(&safety, 3 * DT, 3 * DT, far, v, 0), MK_FAULT_NONE);
}
END_TEST

/* Host and board each have a clock: a sample may seem to come early. */
START_TEST(a_sample_that_comes_early_may_have_moved_as_far_as_another)
{
    const double q[] = {-M_PI_2, 0}, far[] = {-M_PI_2, 0.9 * limits.jump_rad[1]}, v[] = {0, 0};
    mk_safety_check(&safety, 0, DT, q, v, 0);
    ck_assert_int_eq(mk_safety_check(&safety, 0.5 * DT, 0.5 * DT, far, v, 0), MK_FAULT_NONE);
}
END_TEST

/* A caller's own limits may say nothing of a sample time. */
START_TEST(a_jump_is_one_where_the_limits_are_for_no_sample_time)
{
    const double q[] = {-M_PI_2, 0}, far[] = {-M_PI_2, 1.1 * limits.jump_rad[1]}, v[] = {0, 0};
    safety.limits.dt_s = 0.0;
    mk_safety_check(&safety, 0, DT, q, v, 0);
    ck_assert_int_eq(mk_safety_check(&safety, DT, DT, far, v, 0), MK_FAULT_JUMP);
}
END_TEST

/* Between two samples its reading changes by nothing or by a count, however slow it is. */
START_TEST(a_coarse_encoder_does_not_jump_by_a_few_counts)
{
    static const struct {
        int counts;
        enum mk_fault fault;
    } rows[] = {{3, MK_FAULT_NONE}, {-3, MK_FAULT_NONE}, {6, MK_FAULT_JUMP}, {-6, MK_FAULT_JUMP}};
    mk_model_default(MK_PLANT_PENDUBOT, &model);
    model.encoder_cpr[1] = 16;
    const double count = mk_model_count(&model, 1);
    mk_safety_default(&model, DT, &limits);
    ck_assert_double_lt(1.25 * limits.v_max[1] * DT, count);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        mk_safety_init(&safety, &model, &limits);
        look(0, -M_PI_2, 0, 0, 0, 0);
        ck_assert_int_eq(look(DT, -M_PI_2, rows[i].counts * count, 0, 0, 0), rows[i].fault);
    }
}
END_TEST

/* What stands in the arrays behind its joint is nobody's reading. */
START_TEST(of_a_rig_with_one_joint_nothing_else_is_looked_at)
{
    use_plant(MK_PLANT_PENDULUM);
    const struct mk_plant_info *plant = mk_plant(MK_PLANT_PENDULUM);
    const double rest[] = {plant->rest[0], 0.0};
    ck_assert_int_eq(plant->joints, 1);
    for (int k = 0; k < 10; k++)
        ck_assert_int_eq(look(k * DT, rest[0], 1e3 * k, 0, 1e6, 0), MK_FAULT_NONE);
    const double q[] = {rest[0], 2.0};
    const bool is_wheel[] = {false, false};
    ck_assert_int_eq(mk_safety_check_rest(&safety, q, rest, is_wheel), MK_FAULT_NONE);
}
END_TEST

START_TEST(a_silent_encoder_under_a_hard_command_is_stuck)
{
    double t = 0;
    for (int k = 0; k * DT < limits.stuck_s - DT; k++, t += DT)
        ck_assert_int_eq(look(t, -M_PI_2, 0, 0, 0, limits.stuck_u), MK_FAULT_NONE);
    for (int k = 0; k < 4; k++, t += DT)
        look(t, -M_PI_2, 0, 0, 0, limits.stuck_u);
    ck_assert_int_eq(safety.fault, MK_FAULT_STUCK);
    ck_assert_int_eq(safety.fault_joint, 1);
}
END_TEST

/* In times that binary fractions hold to the bit. */
START_TEST(a_silent_encoder_is_found_at_the_time_that_the_limit_says)
{
    const double dt = 1.0 / 512.0;
    safety.limits.stuck_s = 64 * dt;
    double q[] = {-M_PI_2, 0}, v[] = {0, 0};
    for (int k = 0; k < 64; k++)
        ck_assert_int_eq(mk_safety_check(&safety, k * dt, dt, q, v, 9), MK_FAULT_NONE);
    ck_assert_int_eq(mk_safety_check(&safety, 64 * dt, dt, q, v, 9), MK_FAULT_STUCK);
}
END_TEST

START_TEST(a_silent_encoder_under_a_weak_command_is_a_resting_link)
{
    for (int k = 0; k < 5000; k++)
        ck_assert_int_eq(look(k * DT, -M_PI_2, 0, 0, 0, 0.9 * limits.stuck_u), MK_FAULT_NONE);
}
END_TEST

/* A wheel of 0.0045 under command u whose encoder is wired with `sign`. */
static enum mk_fault drive_wheel(double u, int sign)
{
    use_plant(MK_PLANT_INERTIA_WHEEL);
    enum mk_fault fault = MK_FAULT_NONE;
    for (int k = 0; k < 200 && fault == MK_FAULT_NONE; k++) {
        double t = k * DT, v = sign * u / 0.0045 * t, q = 0.5 * v * t;
        fault = mk_safety_check(&safety, t, DT, &q, &v, u);
    }
    return fault;
}

START_TEST(a_motor_wired_backwards_runs_away)
{
    for (double u = 1.5; u <= 10.0; u += 0.5) {
        ck_assert_int_ne(drive_wheel(u, 1), MK_FAULT_RUNAWAY);
        ck_assert_int_eq(drive_wheel(u, -1), MK_FAULT_RUNAWAY);
        ck_assert_int_eq(drive_wheel(-u, -1), MK_FAULT_RUNAWAY);
    }
}
END_TEST

START_TEST(a_joint_that_runs_away_is_named_wherever_it_started)
{
    static const struct {
        enum mk_plant_kind plant;
        double q[MK_MAX_JOINTS];
        int joint;
    } rows[] = {{MK_PLANT_INERTIA_WHEEL, {5.0}, 1},
                {MK_PLANT_INERTIA_WHEEL, {-5.0}, 1},
                {MK_PLANT_PENDUBOT, {-M_PI_2, 0.0}, 1},
                {MK_PLANT_ACROBOT, {-M_PI_2, 0.5}, 2}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        double q[] = {rows[i].q[0], rows[i].q[1]}, v[MK_MAX_JOINTS] = {0};
        const int motor = rows[i].joint - 1;
        use_plant(rows[i].plant);
        for (int k = 0; k < 50 && !safety.fault; k++) {
            double t = k * DT;
            v[motor] = -100.0 * t;
            q[motor] = rows[i].q[motor] - 50.0 * t * t;
            mk_safety_check(&safety, t, DT, q, v, 5.0);
        }
        ck_assert_int_eq(safety.fault, MK_FAULT_RUNAWAY);
        ck_assert_int_eq(safety.fault_joint, rows[i].joint);
    }
}
END_TEST

START_TEST(motion_against_the_command_after_a_good_start_is_no_runaway)
{
    use_plant(MK_PLANT_PENDUBOT);
    double t = 0, q1 = -M_PI_2;
    for (int k = 0; k < 50; k++, t += DT, q1 += 0.005)
        look(t, q1, 0, 2.5, 0, 3.0);
    for (int k = 0; k < 100; k++, t += DT, q1 -= 0.005)
        ck_assert_int_eq(look(t, q1, 0, -2.5, 0, 3.0), MK_FAULT_NONE);
}
END_TEST

/* Commands of one sample, and weak ones, turn nothing: what moves the joint is something else. */
START_TEST(a_joint_that_is_moved_while_the_motor_hardly_drives_is_no_runaway)
{
    static const struct {
        double u;
        int samples;
        enum mk_fault fault;
    } rows[] = {{-0.5, 20, MK_FAULT_NONE},
                {-1.0, 20, MK_FAULT_RUNAWAY}, /* a tenth of what there is */
                {-5.0, 1, MK_FAULT_NONE},
                {-5.0, 3, MK_FAULT_RUNAWAY}};
    for (int i = 0; i < 4; i++) {
        use_plant(MK_PLANT_INERTIA_WHEEL);
        double q = 0.0, v = 50.0;
        for (int k = 0; k < 20; k++)
            ck_assert_int_eq(mk_safety_check(&safety, k * DT, DT, &q, &v,
                                             20 - k <= rows[i].samples ? rows[i].u : 0.0),
                             MK_FAULT_NONE);
        q = 0.1;
        ck_assert_int_eq(mk_safety_check(&safety, 20 * DT, DT, &q, &v, rows[i].u), rows[i].fault);
    }
}
END_TEST

/* In times and ways that binary fractions hold to the bit. */
START_TEST(a_joint_runs_away_after_the_time_and_the_way_that_the_limits_say)
{
    const double dt = 1.0 / 512.0, v = 0.0;
    static const struct {
        int samples; /* under the command */
        double q;
        enum mk_fault fault;
    } rows[] = {{8, -0.0625, MK_FAULT_NONE},
                {8, -0.0703125, MK_FAULT_RUNAWAY},
                {7, -0.0703125, MK_FAULT_NONE}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        double q = 0.0;
        use_plant(MK_PLANT_INERTIA_WHEEL);
        safety.runaway_travel = 0.0625;
        safety.limits.runaway_s = 8 * dt;
        for (int k = 0; k < rows[i].samples; k++)
            mk_safety_check(&safety, k * dt, dt, &q, &v, 5.0);
        q = rows[i].q;
        ck_assert_int_eq(mk_safety_check(&safety, 1.0, dt, &q, &v, 5.0), rows[i].fault);
    }
}
END_TEST

/* A command that has just changed its sign has not turned anything round yet. */
START_TEST(a_joint_that_leaves_with_the_command_before_is_no_runaway)
{
    use_plant(MK_PLANT_INERTIA_WHEEL);
    double q = 0.0, v = 5.0;
    for (int k = 0; k < 20; k++)
        mk_safety_check(&safety, k * DT, DT, &q, &v, k < 19 ? 5.0 : -5.0);
    q = 0.1;
    ck_assert_int_eq(mk_safety_check(&safety, 20 * DT, DT, &q, &v, -5.0), MK_FAULT_NONE);
}
END_TEST

START_TEST(a_wheel_that_already_spins_may_be_braked)
{
    use_plant(MK_PLANT_INERTIA_WHEEL);
    for (int k = 0; k < 100; k++) {
        double q = 50.0 * k * DT, v = 50.0;
        ck_assert_int_eq(mk_safety_check(&safety, k * DT, DT, &q, &v, k ? -5.0 : 0.0),
                         MK_FAULT_NONE);
    }
}
END_TEST

START_TEST(late_samples_in_a_row_trip_at_the_limit)
{
    for (int round = 0; round < 3; round++) {
        for (int k = 0; k < limits.late_limit - 1; k++)
            ck_assert_int_eq(mk_safety_timing(&safety, 0, true), MK_FAULT_NONE);
        for (int k = 0; k < limits.late_limit - 1; k++)
            ck_assert_int_eq(mk_safety_timing(&safety, 0, false), MK_FAULT_NONE);
    }
    for (int k = 0; k < limits.late_limit; k++)
        mk_safety_timing(&safety, 3.0, true);
    ck_assert_int_eq(safety.fault, MK_FAULT_OVERRUN);
}
END_TEST

START_TEST(lost_samples_in_a_row_trip_at_the_limit)
{
    for (int k = 0; k < limits.lost_limit - 1; k++)
        ck_assert_int_eq(mk_safety_link(&safety, 0, true), MK_FAULT_NONE);
    for (int k = 0; k < 4 * limits.lost_limit; k++)
        ck_assert_int_eq(mk_safety_link(&safety, 0, false), MK_FAULT_NONE);
    for (int k = 0; k < limits.lost_limit - 1; k++)
        ck_assert_int_eq(mk_safety_link(&safety, 0, true), MK_FAULT_NONE);
    ck_assert_int_eq(mk_safety_link(&safety, 4.0, true), MK_FAULT_LINK);
    ck_assert_double_eq(safety.fault_t, 4.0);
}
END_TEST

/* Samples until the fault where `bad` of every `of` are bad; 100000 when it does not come. */
static int samples_until(enum mk_fault (*count)(struct mk_safety *, double, bool), int bad, int of)
{
    mk_safety_clear(&safety);
    for (int k = 0; k < 100000; k++)
        if (count(&safety, 0, k % of < bad) != MK_FAULT_NONE)
            return k;
    return 100000;
}

START_TEST(a_link_that_loses_more_than_every_fifth_exchange_trips)
{
    ck_assert_int_le(samples_until(mk_safety_link, 4, 5), 6);
    ck_assert_int_le(samples_until(mk_safety_link, 1, 2), 14);
    ck_assert_int_le(samples_until(mk_safety_link, 1, 4), 80);
    ck_assert_int_eq(samples_until(mk_safety_link, 1, 6), 100000);
}
END_TEST

START_TEST(a_machine_that_is_late_more_than_every_second_time_trips)
{
    ck_assert_int_le(samples_until(mk_safety_timing, 9, 10), 12);
    ck_assert_int_le(samples_until(mk_safety_timing, 2, 3), 30);
    ck_assert_int_eq(samples_until(mk_safety_timing, 1, 2), 100000);
}
END_TEST

START_TEST(links_away_from_rest_do_not_hang)
{
    const struct mk_plant_info *plant = mk_plant(MK_PLANT_PENDUBOT);
    const double hanging[] = {-M_PI_2, 0}, turned[] = {-M_PI_2 + 2 * M_PI, -4 * M_PI},
                 leaning[] = {-M_PI_2, 0.2};
    ck_assert_int_eq(mk_safety_check_rest(&safety, hanging, plant->rest, plant->joint_is_wheel),
                     MK_FAULT_NONE);
    ck_assert_int_eq(mk_safety_check_rest(&safety, turned, plant->rest, plant->joint_is_wheel),
                     MK_FAULT_NONE);
    ck_assert_int_eq(mk_safety_check_rest(&safety, leaning, plant->rest, plant->joint_is_wheel),
                     MK_FAULT_NOT_HANGING);
    ck_assert_int_eq(safety.fault_joint, 2);
}
END_TEST

START_TEST(a_joint_that_a_rig_does_not_have_has_no_limits)
{
    struct mk_model m;
    struct mk_safety_limits of;
    mk_model_default(MK_PLANT_PENDULUM, &m);
    mk_safety_default(&m, 0.002, &of);
    ck_assert(isinf(of.q_max[1]) && isinf(of.q_min[1]));
    ck_assert(isfinite(of.q_max[0]) && isfinite(of.v_max[0]));
}
END_TEST

START_TEST(wheels_and_what_is_level_rest_anywhere)
{
    const double q[] = {2.0, M_PI};
    use_plant(MK_PLANT_FURUTA);
    const struct mk_plant_info *furuta = mk_plant(MK_PLANT_FURUTA);
    ck_assert_int_eq(mk_safety_check_rest(&safety, q, furuta->rest, furuta->joint_is_wheel),
                     MK_FAULT_NONE);
    use_plant(MK_PLANT_REACTION_WHEEL);
    use_plant(MK_PLANT_CART_POLE);
    const double along[] = {0.3, M_PI};
    ck_assert_int_eq(mk_safety_check_rest(&safety, along, furuta->rest, furuta->joint_is_wheel),
                     MK_FAULT_NONE);
    use_plant(MK_PLANT_REACTION_WHEEL);
    const struct mk_plant_info *wheel = mk_plant(MK_PLANT_REACTION_WHEEL);
    const double spun[] = {0.0, 2.0};
    ck_assert_int_eq(mk_safety_check_rest(&safety, spun, wheel->rest, wheel->joint_is_wheel),
                     MK_FAULT_NONE);
}
END_TEST

/* Whole turns do not matter to a link; six metres and 28 centimetres do. */
START_TEST(a_carriage_whose_rest_is_limited_rests_there_and_not_a_turn_further)
{
    use_plant(MK_PLANT_CART_POLE);
    const struct mk_plant_info *plant = mk_plant(MK_PLANT_CART_POLE);
    safety.limits.rest_tolerance[0] = 0.1;
    for (int run = 0; run < 2; run++) { /* cleared as well as new */
        const double near[] = {0.1, plant->rest[1]}, far[] = {2.0 * M_PI, plant->rest[1]};
        ck_assert_int_eq(mk_safety_check_rest(&safety, near, plant->rest, plant->joint_is_wheel),
                         MK_FAULT_NONE);
        ck_assert_int_eq(mk_safety_check_rest(&safety, far, plant->rest, plant->joint_is_wheel),
                         MK_FAULT_NOT_HANGING);
        ck_assert_int_eq(safety.fault_joint, 1);
        mk_safety_clear(&safety);
    }
}
END_TEST

/* --- the hazard table of docs/safety.md --- */

/* Names in backquotes: `test_file`, `test_file: a_test`, or `a_test` of the file named last. */
static void check_named(const char *name, char *file, size_t size)
{
    char wanted[256];
    const char *test = name;
    if (strncmp(name, "test_", 5) == 0) {
        snprintf(file, size, "%s/tests/%.*s.c", MK_SOURCE_DIR, (int)strcspn(name, ":"), name);
        test = strstr(name, ": ");
        test = test ? test + 2 : "";
    }
    char *text = slurp_file(file);
    ck_assert_msg(text != NULL, "%s: there is no %s", name, file);
    snprintf(wanted, sizeof wanted, "START_TEST(%s", test);
    ck_assert_msg(strstr(text, wanted) != NULL, "%s has no test '%s'", file, test);
    free(text);
}

START_TEST(every_row_of_the_hazard_table_names_tests_that_exist)
{
    char *text = slurp_file(MK_SOURCE_DIR "/docs/safety.md");
    ck_assert_ptr_nonnull(text);
    char *row = strstr(text, "| what can go wrong"), *end = strstr(text, "\n\nSamples that");
    ck_assert(row && end && row < end);
    *end = '\0';
    int named = 0, without = 0;
    for (row = strtok(row, "\n"); row; row = strtok(NULL, "\n")) {
        char *cell = strrchr(row, '|'), file[512] = "";
        ck_assert_msg(cell != NULL && cell > row, "%s", row);
        *cell = '\0';
        cell = strrchr(row, '|');
        without += strcmp(cell, "| - ") == 0;
        for (char *c = strchr(cell, '`'); c; c = strchr(c + 1, '`')) {
            char *name = c + 1;
            c = strchr(name, '`');
            ck_assert_msg(c != NULL, "%s", row);
            *c = '\0';
            if (strncmp(name, "make ", 5) != 0) {
                check_named(name, file, sizeof file);
                named++;
            }
        }
    }
    ck_assert_int_ge(named, 25);
    ck_assert_int_eq(without, 2); /* what no software can stop */
    free(text);
}
END_TEST

Suite *suite_safety(void)
{
    Suite *s = suite_create("safety");
    TCase *t = tcase_create("limits");
    tcase_add_checked_fixture(t, setup, NULL);
    tcase_add_test(t, every_fault_has_a_name_and_a_text);
    tcase_add_test(t, a_fault_of_no_joint_names_none);
    tcase_add_test(t, a_healthy_motion_trips_nothing);
    tcase_add_test(t, the_first_fault_stays_until_cleared);
    tcase_add_test(t, travel_beyond_either_limit_trips);
    tcase_add_test(t, a_carriage_is_stopped_before_the_end_of_its_track);
    tcase_add_test(t, a_wheel_may_turn_for_ever);
    tcase_add_test(t, speed_beyond_the_limit_trips_either_way);
    tcase_add_test(t, a_speed_or_an_angle_that_is_no_number_trips);
    tcase_add_test(t, a_joint_may_go_as_far_in_a_sample_as_the_limit_says);
    tcase_add_test(t, a_jump_trips_and_names_its_joint);
    tcase_add_test(t, after_lost_samples_a_joint_may_have_moved_further);
    tcase_add_test(t, a_sample_that_comes_early_may_have_moved_as_far_as_another);
    tcase_add_test(t, a_jump_is_one_where_the_limits_are_for_no_sample_time);
    tcase_add_test(t, a_coarse_encoder_does_not_jump_by_a_few_counts);
    tcase_add_test(t, of_a_rig_with_one_joint_nothing_else_is_looked_at);
    tcase_add_test(t, a_silent_encoder_under_a_hard_command_is_stuck);
    tcase_add_test(t, a_silent_encoder_is_found_at_the_time_that_the_limit_says);
    tcase_add_test(t, a_silent_encoder_under_a_weak_command_is_a_resting_link);
    tcase_add_test(t, a_motor_wired_backwards_runs_away);
    tcase_add_test(t, a_joint_that_runs_away_is_named_wherever_it_started);
    tcase_add_test(t, motion_against_the_command_after_a_good_start_is_no_runaway);
    tcase_add_test(t, a_joint_that_is_moved_while_the_motor_hardly_drives_is_no_runaway);
    tcase_add_test(t, a_joint_runs_away_after_the_time_and_the_way_that_the_limits_say);
    tcase_add_test(t, a_joint_that_leaves_with_the_command_before_is_no_runaway);
    tcase_add_test(t, a_wheel_that_already_spins_may_be_braked);
    tcase_add_test(t, late_samples_in_a_row_trip_at_the_limit);
    tcase_add_test(t, lost_samples_in_a_row_trip_at_the_limit);
    tcase_add_test(t, a_link_that_loses_more_than_every_fifth_exchange_trips);
    tcase_add_test(t, a_machine_that_is_late_more_than_every_second_time_trips);
    tcase_add_test(t, links_away_from_rest_do_not_hang);
    tcase_add_test(t, a_joint_that_a_rig_does_not_have_has_no_limits);
    tcase_add_test(t, wheels_and_what_is_level_rest_anywhere);
    tcase_add_test(t, a_carriage_whose_rest_is_limited_rests_there_and_not_a_turn_further);
    suite_add_tcase(s, t);
    t = tcase_create("table");
    tcase_add_test(t, every_row_of_the_hazard_table_names_tests_that_exist);
    suite_add_tcase(s, t);
    return s;
}
