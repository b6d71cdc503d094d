/* Feed-forward from the effects of the nominal model. */
#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "base/random.h"
#include "console/commands/explanation.h"
#include "ctrl/compensate.h"
#include "ctrl/equilibrium.h"
#include "ctrl/lift.h"
#include "ctrl/roa.h"
#include "experiment/robustness.h"
#include "explain/control_gain.h"
#include "model/plant_facts.h"
#include "support/closed.h"

/* `value` is NULL or has MK_MAX_EFFECT_PARAMETERS values: an effect's row may gain a parameter. */
static void add(struct mk_model *m, const char *name, int joint, const double *value)
{
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_model_add_effect(m, name, joint, &err) == MK_OK, "%s", err.message);
    struct mk_effect_use *use = &m->effect[m->effect_count - 1];
    for (int k = 0; k < mk_effect(use->index)->parameter_count && value; k++)
        if (value[k] != 0.0 || !mk_effect(use->index)->parameter[k].optional)
            use->value[k] = value[k];
}

static struct mk_model textbook(enum mk_plant_kind plant)
{
    struct mk_model m;
    mk_model_default(plant, &m);
    return m;
}

static struct mk_model textbook_with(enum mk_plant_kind plant, const char *effect, int joint,
                                     const double *value)
{
    struct mk_model m = textbook(plant);
    add(&m, effect, joint, value);
    return m;
}

/* --- the command --------------------------------------------------------------------------- */

/* Effects that a command at the motor joint cancels, with values that show. */
static const struct cancelled {
    const char *name;
    bool at_joint;
    double value[MK_MAX_EFFECT_PARAMETERS];
} cancelled[] = {
    {"viscous", true, {0.2}},
    {"coulomb", true, {0.8}},
    {"coulomb-asymmetry", true, {0.4}},
    {"viscous-asymmetry", true, {0.15}},
    {"torque-offset", true, {0.3}},
    {"stribeck", true, {0.5, 0.8}},
    {"quadratic-drag", true, {0.05}},
    {"stiction", true, {60.0, 0.4, 0.6}},
    {"load-friction", true, {0.3}},
    {"friction-drift", true, {0.9, 2.0}},
    {"cable-stiffness", true, {0.7, 0.2}},
    {"cable-hysteresis", true, {1.5, 0.2}},
    {"cogging", true, {0.4, 6.0, 0.3}},
    {"imbalance", true, {0.5, 0.4}},
    {"reflected-inertia", true, {0.3}},
    {"deadband", false, {0.7}},
    {"torque-scale", false, {0.25}},
    {"gain-asymmetry", false, {0.2}},
    {"gain-drift", false, {0.3, 2.0}},
    {"torque-ripple", false, {0.2, 5.0, 0.4}},
    {"custom", true, {0.02, 1.0}},
    {"custom-wave", true, {0.3, 0.2, 1.0, 1.0}},
    {"custom-well", true, {0.2, 0.3, 0.4}},
};
#define CANCELLED_COUNT (sizeof cancelled / sizeof cancelled[0])

/* The weight of an eccentric body behind a free joint is carried by the link below: out of reach of
 * a motor between the two. */
static bool out_of_reach(enum mk_plant_kind plant, const char *name)
{
    return mk_plant(plant)->motor_joint == 1 && strcmp(name, "imbalance") == 0;
}

static double motor_acceleration(const struct mk_model *m, double t, const double *x, double u)
{
    double dx[MK_MAX_STATES], input[MK_MAX_INPUTS] = {u, 0.0};
    mk_model_rhs(m, t, x, input, dx);
    return dx[mk_model_joints(m) + mk_plant(m->plant)->motor_joint];
}

static void random_state(struct mk_random *random, int joints, double *x)
{
    for (int i = 0; i < MK_MAX_STATES; i++) {
        double span = i < joints ? 3.0 : i < 2 * joints ? 4.0 : 0.01;
        x[i] = span * (2.0 * mk_random_uniform(random) - 1.0);
    }
}

/* The values are in N m of a motor of 10 N m, which the rig is given; an inertia is a share of the
 * joint's own. */
static struct mk_model with_cancelled(enum mk_plant_kind plant, size_t which)
{
    const struct cancelled *c = &cancelled[which];
    const int motor = mk_plant(plant)->motor_joint;
    struct mk_model m = textbook_with(plant, c->name, c->at_joint ? motor + 1 : 0, c->value);
    if (strcmp(c->name, "reflected-inertia") == 0)
        m.effect[0].value[0] *= mk_plant_body_inertia(&m, motor);
    m.u_max = 10.0;
    return m;
}

/* One random state and wish; false when the motor is too weak for it. */
static bool check_acceleration(const struct mk_model *full, struct mk_random *random)
{
    struct mk_model plant = *full;
    plant.effect_count = 0;
    double x[MK_MAX_STATES], wish = 8.0 * mk_random_uniform(random) - 4.0;
    random_state(random, mk_model_joints(full), x);
    double u = mk_compensate(full, &plant, 1.5, x, wish);
    double got = motor_acceleration(full, 1.5, x, u);
    double want = motor_acceleration(&plant, 1.5, x, wish);
    double scale = fmax(fabs(want), fabs(motor_acceleration(&plant, 1.5, x, 1.0) -
                                         motor_acceleration(&plant, 1.5, x, 0.0)));
    if (fabs(u) == full->u_max)
        return false;
    ck_assert_msg(fabs(got - want) <= 1e-6 * scale, "%s on %s: %g, not %g",
                  mk_effect(full->effect[0].index)->name, mk_plant(full->plant)->name, got, want);
    return true;
}

START_TEST(each_effect_within_reach_leaves_the_acceleration_wished_for)
{
    struct mk_random random = {7};
    for (int kind = 0; kind < MK_PLANT_COUNT; kind++) {
        enum mk_plant_kind plant = (enum mk_plant_kind)kind;
        if (!(mk_effect_by_name(cancelled[_i].name)->plants & (1u << kind)))
            continue;
        struct mk_model nominal = with_cancelled(plant, (size_t)_i), full;
        mk_compensated_model(&nominal, &full);
        if (out_of_reach(plant, cancelled[_i].name)) {
            ck_assert_int_eq(full.effect_count, 0);
            continue;
        }
        ck_assert_int_eq(full.effect_count, 1);
        int within = 0;
        for (int n = 0; n < 200; n++)
            within += check_acceleration(&full, &random);
        ck_assert_int_gt(within, 100);
    }
}
END_TEST

START_TEST(all_effects_together_leave_the_acceleration_wished_for)
{
    struct mk_random random = {8};
    struct mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    static const char *const some[] = {"coulomb",  "stiction",       "cable-stiffness",
                                       "deadband", "gain-asymmetry", "torque-ripple",
                                       "cogging",  "load-friction"};
    for (size_t i = 0; i < sizeof some / sizeof some[0]; i++)
        for (size_t k = 0; k < CANCELLED_COUNT; k++)
            if (strcmp(cancelled[k].name, some[i]) == 0)
                add(&m, some[i], cancelled[k].at_joint, cancelled[k].value);
    int within = 0;
    for (int n = 0; n < 2000; n++)
        within += check_acceleration(&m, &random);
    ck_assert_int_gt(within, 1000);
}
END_TEST

START_TEST(who_says_to_be_invertible_is_tried)
{
    for (int i = 0; i < mk_effect_count(); i++) {
        bool tried = false;
        for (size_t k = 0; k < CANCELLED_COUNT; k++)
            tried = tried || strcmp(mk_effect(i)->name, cancelled[k].name) == 0;
        ck_assert_msg(tried == mk_effect(i)->invertible, "%s", mk_effect(i)->name);
    }
}
END_TEST

START_TEST(effects_elsewhere_are_left_alone)
{
    static const struct {
        const char *name;
        int joint;
    } other[] = {{"viscous", 2},          {"coulomb", 2},       {"stiction", 2},
                 {"cable-hysteresis", 2}, {"imbalance", 2},     {"input-delay", 0},
                 {"actuator-lag", 0},     {"saturation", 0},    {"end-stop", 1},
                 {"backlash", 2},         {"base-tilt", 0},     {"sensor-delay", 0},
                 {"encoder-offset", 1},   {"back-emf-limit", 0}};
    for (size_t i = 0; i < sizeof other / sizeof other[0]; i++) {
        const struct mk_model m =
            textbook_with(MK_PLANT_PENDUBOT, other[i].name, other[i].joint, NULL);
        struct mk_model full;
        mk_compensated_model(&m, &full);
        ck_assert_msg(full.effect_count == 0, "%s", other[i].name);
    }
}
END_TEST

START_TEST(what_takes_more_than_the_limit_gets_the_limit)
{
    static const double level[MK_MAX_EFFECT_PARAMETERS] = {30.0};
    const struct mk_model plant = textbook(MK_PLANT_PENDUBOT),
                          full = textbook_with(MK_PLANT_PENDUBOT, "coulomb", 1, level);
    double x[MK_MAX_STATES] = {0.1, 0.2, 2.0, 0.0};
    ck_assert_double_eq(mk_compensate(&full, &plant, 0.0, x, 3.0), plant.u_max);
    x[2] = -2.0;
    ck_assert_double_eq(mk_compensate(&full, &plant, 0.0, x, 3.0), -plant.u_max);
}
END_TEST

START_TEST(a_command_that_does_nothing_stays_as_wished)
{
    static const double width[MK_MAX_EFFECT_PARAMETERS] = {50.0};
    const struct mk_model plant = textbook(MK_PLANT_PENDUBOT),
                          full = textbook_with(MK_PLANT_PENDUBOT, "deadband", 0, width);
    double x[MK_MAX_STATES] = {0.1, 0.2, 0.3, 0.0};
    ck_assert_double_eq(mk_compensate(&full, &plant, 0.0, x, 3.0), 3.0);
}
END_TEST

/* --- the equilibrium ----------------------------------------------------------------------- */

static double acceleration_at_rest(const struct mk_model *m, const double *q, double u)
{
    static const double still[MK_MAX_JOINTS];
    double x[MK_MAX_STATES], dx[MK_MAX_STATES], input[MK_MAX_INPUTS] = {u, 0.0}, worst = 0.0;
    int n = mk_model_joints(m);
    mk_model_initial_state(m, q, still, x);
    mk_model_rhs(m, 0.0, x, input, dx);
    for (int j = 0; j < n; j++)
        worst = fmax(worst, fabs(dx[n + j]));
    return worst;
}

START_TEST(a_cable_at_the_free_joint_moves_the_equilibrium)
{
    static const double mid[] = {-0.5 * M_PI, M_PI}, cable[MK_MAX_EFFECT_PARAMETERS] = {0.3, 1.5};
    const struct mk_model m = textbook_with(MK_PLANT_PENDUBOT, "cable-stiffness", 2, cable);
    double q[MK_MAX_JOINTS], u;
    ck_assert(mk_nearest_equilibrium(&m, mid, true, q, &u));
    ck_assert_double_lt(acceleration_at_rest(&m, q, u), 1e-6);
    ck_assert_double_gt(fabs(q[1] - mid[1]) + fabs(q[0] - mid[0]), 0.02);
    /* At rest gravity and cable balance at joint 2. */
    double weight = m.parameter[4] * m.g * cos(q[0] + q[1]);
    ck_assert_double_eq_tol(weight, -cable[0] * (q[1] - cable[1]), 1e-6);
}
END_TEST

START_TEST(a_tilted_pendubot_hangs_along_gravity)
{
    static const double hanging[] = {-0.5 * M_PI, 0.0}, tilt[MK_MAX_EFFECT_PARAMETERS] = {0.05};
    const struct mk_model m = textbook_with(MK_PLANT_PENDUBOT, "base-tilt", 0, tilt);
    double q[MK_MAX_JOINTS], u;
    ck_assert(mk_nearest_equilibrium(&m, hanging, false, q, &u));
    ck_assert_double_eq_tol(q[0], hanging[0] + tilt[0], 1e-9);
    ck_assert_double_eq_tol(q[1], 0.0, 1e-9);
    ck_assert_double_eq(u, 0.0);
}
END_TEST

START_TEST(a_cable_at_the_free_joint_holds_elsewhere_after_a_turn)
{
    static const double mid[] = {-0.5 * M_PI, M_PI}, cable[MK_MAX_EFFECT_PARAMETERS] = {0.1, 0.0};
    const struct mk_model m = textbook_with(MK_PLANT_PENDUBOT, "cable-stiffness", 2, cable);
    struct mk_equilibria e;
    mk_equilibria_find(&m, mid, &e);
    const double left[] = {mid[0] - 0.1, -2.5}, right[] = {mid[0] + 0.1, 2.5};
    const double *at[] = {left, right};
    for (int k = 0; k < 2; k++) {
        const struct mk_standing *s = mk_equilibria_at(&e, at[k]);
        double q[] = {mid[0] + s->shift[0], (k ? M_PI : -M_PI) + s->shift[1]};
        ck_assert(s->found);
        ck_assert_double_lt(acceleration_at_rest(&m, q, s->u), 1e-6);
        ck_assert_double_gt((q[1] - (k ? M_PI : -M_PI)) * q[1], 0.0); /* leans against the pull */
    }
    /* As far to one side as to the other: the cable is slack between them. */
    ck_assert_double_eq_tol(mk_equilibria_at(&e, left)->shift[1],
                            -mk_equilibria_at(&e, right)->shift[1], 1e-9);
    const double wound[] = {mid[0], 100.0}, unknown[] = {mid[0], NAN};
    ck_assert_ptr_eq(mk_equilibria_at(&e, wound), &e.winding[MK_WINDINGS - 1]);
    ck_assert(!mk_equilibria_at(&e, unknown)->found);
}
END_TEST

/* Energy that link 2 must have at rest at q to be aimed at what a swing-up aims at, less its own.
 */
static double missing_at(const struct mk_model *m, const struct mk_lift *lift, double q1, double q2)
{
    const double q[] = {q1, q2}, top[] = {q1, M_PI};
    return -mk_lift_energy(lift, q) - mk_plant_potential(m, q) + mk_plant_potential(m, top);
}

/* A cable that is slack at 1 rad pulls harder on the way up to the left than to the right. */
START_TEST(a_swing_up_aims_at_the_lower_of_two_uprights_from_either_side)
{
    static const double mid[] = {-0.5 * M_PI, M_PI}, cable[MK_MAX_EFFECT_PARAMETERS] = {0.1, 1.0};
    const struct mk_model m = textbook_with(MK_PLANT_PENDUBOT, "cable-stiffness", 2, cable);
    struct mk_equilibria e;
    struct mk_lift lift;
    mk_equilibria_find(&m, mid, &e);
    mk_lift_find(&m, mid, &e, &lift);
    const double eps = 1e-6;
    ck_assert_double_eq_tol(missing_at(&m, &lift, mid[0], -eps), missing_at(&m, &lift, mid[0], eps),
                            1e-4);
    const struct mk_standing *right = mk_equilibria_at(&e, mid);
    ck_assert(right->found);
    /* Upright to the right nothing is missing; to the left the cable has taken more than that. */
    ck_assert_double_eq_tol(missing_at(&m, &lift, mid[0], M_PI + right->shift[1] - eps), 0.0, 0.02);
    ck_assert_double_lt(missing_at(&m, &lift, mid[0], -2.9), -0.3);
    /* Where it has gone round, the lower one is the one that it came from. */
    ck_assert_double_eq_tol(missing_at(&m, &lift, mid[0], 2.0 * M_PI - eps),
                            missing_at(&m, &lift, mid[0], 2.0 * M_PI + eps), 1e-4);
}
END_TEST

/* The gains of the textbook plant do not hold it: link 1 drifts away. */
START_TEST(a_spring_at_the_free_joint_is_held_by_gains_that_are_made_for_it)
{
    static const double spring[MK_MAX_EFFECT_PARAMETERS] = {0.2114, -0.066};
    const struct mk_model m = textbook_with(MK_PLANT_PENDUBOT, "cable-stiffness", 2, spring);
    struct closed c;
    closed_open_rig(&c, "pendubot-top", &m, NULL);
    ck_assert_ptr_nonnull(c.ctrl->roa->really);
    closed_put(&c, 0.5 * M_PI, 0.02, 0.0, 0.0);
    ck_assert_double_lt(closed_until(&c, MK_PHASE_BALANCE, 0.1), 0.1);
    ck_assert(closed_stays(&c, MK_PHASE_BALANCE, 6.0));
    ck_assert_double_lt(fabs(closed_state(&c)[0] - 0.5 * M_PI), 0.1);
    closed_close(&c);
}
END_TEST

START_TEST(a_wheel_may_stand_anywhere)
{
    static const double upright[] = {M_PI, 0.0}, tilt[MK_MAX_EFFECT_PARAMETERS] = {-0.03};
    const struct mk_model m = textbook_with(MK_PLANT_REACTION_WHEEL, "base-tilt", 0, tilt);
    double q[MK_MAX_JOINTS], u;
    ck_assert(mk_nearest_equilibrium(&m, upright, true, q, &u));
    ck_assert_double_eq_tol(q[0], M_PI + tilt[0], 1e-9);
    ck_assert_double_eq_tol(q[1], 0.0, 1e-9);
    ck_assert_double_eq_tol(u, 0.0, 1e-9);
    static const double hanging[] = {0.0, 0.0};
    ck_assert(mk_nearest_equilibrium(&m, hanging, false, q, &u));
    ck_assert_double_eq_tol(q[0], tilt[0], 1e-9);
}
END_TEST

START_TEST(where_nothing_stands_still_there_is_no_equilibrium)
{
    static const double hanging[] = {-0.5 * M_PI, 0.0};
    static const double strong[MK_MAX_EFFECT_PARAMETERS] = {
        60.0, 5.0}; /* more than the links weigh, slack far away */
    const struct mk_model m = textbook_with(MK_PLANT_PENDUBOT, "cable-stiffness", 2, strong);
    double q[MK_MAX_JOINTS], u;
    ck_assert(!mk_nearest_equilibrium(&m, hanging, false, q, &u));
    ck_assert_mem_eq(q, hanging, sizeof hanging);
    ck_assert_double_eq(u, 0.0);
}
END_TEST

/* --- the step ------------------------------------------------------------------------------ */

static const char *const setups[] = {"pendubot-mid", "pendubot-top", "reaction-wheel", "furuta",
                                     "pi-speed"};
#define SETUP_COUNT (sizeof setups / sizeof setups[0])

START_TEST(without_effects_no_bit_of_the_command_changes)
{
    struct closed c, off;
    closed_open(&c, setups[_i], NULL);
    closed_open(&off, setups[_i], NULL);
    closed_set(&off, "compensate", 0.0);
    ck_assert_ptr_null(c.ctrl->compensator);
    for (int k = 0; k < 2000; k++) {
        closed_tick(&c);
        closed_tick(&off);
        ck_assert_mem_eq(&c.out.u, &off.out.u, sizeof c.out.u);
    }
    closed_close(&c);
    closed_close(&off);
}
END_TEST

static struct mk_model many_effects(enum mk_plant_kind plant)
{
    struct mk_model m = textbook(plant);
    int motor = mk_plant(plant)->motor_joint + 1;
    static const double bristle[MK_MAX_EFFECT_PARAMETERS] = {60.0, 0.2, 0.1},
                        dead[MK_MAX_EFFECT_PARAMETERS] = {0.2},
                        eccentric[MK_MAX_EFFECT_PARAMETERS] = {0.01, 0.3},
                        gain[MK_MAX_EFFECT_PARAMETERS] = {0.05},
                        creep[MK_MAX_EFFECT_PARAMETERS] = {0.2, 0.2};
    add(&m, "stiction", motor, bristle);
    add(&m, "deadband", 0, dead);
    add(&m, "encoder-eccentricity", 1, eccentric);
    add(&m, "gain-asymmetry", 0, gain);
    add(&m, "cable-hysteresis", motor, creep);
    if (mk_plant(plant)->joints > 1)
        add(&m, "base-tilt", 0, gain);
    return m;
}

static enum mk_plant_kind plant_of(const char *setup)
{
    unsigned plants = mk_ctrl_setup_by_name(setup)->plants;
    int kind = 0;
    while (!(plants & (1u << kind)))
        kind++;
    return (enum mk_plant_kind)kind;
}

/* Readings of every size, lost ticks, spoilt numbers. */
static void wild_input(struct mk_random *random, int k, struct mk_ctrl_input *in)
{
    static const double size[] = {1.0, 1e3, 1e9, 1e-300, 1e300};
    in->tick += 1 + (uint64_t)(k % 50 == 0) * 100;
    in->t = (double)in->tick * in->dt;
    double s = k % 20 == 0 ? size[(k / 20) % 5] : 1.0;
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        in->q[j] = s * (2.0 * mk_random_uniform(random) - 1.0);
        in->v[j] = 5.0 * s * (2.0 * mk_random_uniform(random) - 1.0);
    }
    in->u = k % 33 == 0 ? (double)NAN : 20.0 * mk_random_uniform(random) - 10.0;
}

static struct mk_ctrl *make_ctrl(const char *setup, const struct mk_model *nominal)
{
    struct mk_ctrl *ctrl;
    struct mk_error err = MK_ERROR_INIT;
    enum mk_status st =
        mk_ctrl_create(mk_ctrl_setup_by_name(setup), nominal, 0.002, NULL, &ctrl, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    return ctrl;
}

START_TEST(a_step_is_bounded_whatever_is_read)
{
    struct mk_random random = {3};
    struct mk_model m = many_effects(plant_of(setups[_i]));
    struct mk_ctrl *ctrl = make_ctrl(setups[_i], &m);
    ck_assert_ptr_nonnull(ctrl->compensator);
    struct mk_ctrl_input in = {.dt = 0.002};
    struct mk_ctrl_output out;
    clock_t start = clock();
    for (int k = 0; k < 2000; k++) {
        wild_input(&random, k, &in);
        mk_ctrl_step(ctrl, &in, &out);
        ck_assert_msg(isfinite(out.u), "step %d", k);
    }
    printf("  %s with effects: %.0f us a step\n", setups[_i],
           1e6 / 2000.0 * (double)(clock() - start) / CLOCKS_PER_SEC);
    mk_ctrl_destroy(ctrl);
}
END_TEST

START_TEST(a_step_remembers_nothing_after_a_reset)
{
    struct mk_model m = many_effects(plant_of(setups[_i]));
    struct closed c, again;
    double u[800];
    closed_open_rig(&c, setups[_i], &m, NULL);
    for (int k = 0; k < 800; k++) {
        closed_tick(&c);
        u[k] = c.out.u;
    }
    closed_open_rig(&again, setups[_i], &m, NULL);
    struct mk_ctrl *fresh = again.ctrl;
    again.ctrl = c.ctrl;
    mk_ctrl_reset(again.ctrl);
    for (int k = 0; k < 800; k++) {
        closed_tick(&again);
        ck_assert_double_eq(again.out.u, u[k]);
    }
    again.ctrl = fresh;
    closed_close(&again);
    closed_close(&c);
}
END_TEST

START_TEST(open_loop_stays_open)
{
    struct mk_model m = many_effects(MK_PLANT_PENDUBOT);
    struct closed c;
    closed_open_rig(&c, "open-loop", &m, NULL);
    ck_assert_ptr_null(c.ctrl->compensator);
    closed_close(&c);
}
END_TEST

/* --- what it is good for ------------------------------------------------------------------- */

enum figure { SWAY, OFF, EFFORT };

/* On a rig with the effect, by a controller that knows it and one that does not: the figure that
 * suffers, and the share of it that must be left at most. */
static const struct improvement {
    const char *setup, *effect;
    int joint;
    double value[MK_MAX_EFFECT_PARAMETERS];
    enum figure figure;
    double at_most;
} improved[] = {
    {"pendubot-mid", "coulomb", 1, {0.3}, SWAY, 0.6},
    {"pendubot-mid", "coulomb", 1, {0.3}, OFF, 0.7},
    {"pendubot-mid", "stiction", 1, {60.0, 0.2, 0.3}, SWAY, 0.7},
    {"pendubot-mid", "cable-stiffness", 2, {0.1, 1.0}, OFF, 0.3},
    {"pendubot-mid", "base-tilt", 0, {0.03}, OFF, 0.3},
    {"pendubot-mid", "encoder-offset", 2, {0.02}, EFFORT, 0.7},
    {"pendubot-top", "base-tilt", 0, {0.03}, OFF, 0.4},
    {"pendubot-top", "encoder-offset", 1, {0.03}, OFF, 0.4},
    {"furuta", "coulomb", 1, {0.3}, SWAY, 0.5},
    {"furuta", "stiction", 1, {60.0, 0.2, 0.3}, SWAY, 0.7},
    {"furuta", "cable-stiffness", 1, {1.0, 0.0}, OFF, 0.5},
    {"furuta", "deadband", 0, {0.3}, SWAY, 0.7},
    {"reaction-wheel", "deadband", 0, {0.3}, SWAY, 0.8},
    {"reaction-wheel", "base-tilt", 0, {0.03}, EFFORT, 0.8},
    {"reaction-wheel", "encoder-offset", 1, {0.03}, EFFORT, 0.8},
};
#define IMPROVED_COUNT ((int)(sizeof improved / sizeof improved[0]))

static double figure_of(const struct trial *t, enum figure figure)
{
    return figure == SWAY ? t->sway_rad : figure == OFF ? t->off_rad : t->effort;
}

static struct trial run_trial(struct mk_ctrl *ctrl, const struct mk_model *rig,
                              const double *start_rad, double catch_s, uint64_t seed)
{
    struct mk_error err = MK_ERROR_INIT;
    struct trial_setting setting = {.rig = rig,
                                    .rate_hz = 500.0,
                                    .catch_s = catch_s,
                                    .hold_s = 4.0,
                                    .count_noise = 0.3,
                                    .seed = seed};
    struct trial t;
    memcpy(setting.start_rad, start_rad, sizeof setting.start_rad);
    ck_assert_msg(trial_run_on(ctrl, &setting, &t, &err) == MK_OK, "%s", err.message);
    return t;
}

static bool is_held(const struct trial *t)
{
    return t->end == TRIAL_HELD || t->end == TRIAL_NOT_STILL;
}

/* A rig that is as this model says, and where it hangs at rest. */
static struct mk_model hang(const struct mk_model *known, double start_rad[MK_MAX_JOINTS])
{
    struct mk_model rig;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_msg(trial_hang(known, &rig, start_rad, &err) == MK_OK, "%s", err.message);
    return rig;
}

/* Mean of three runs on `rig`; all of them are held. */
static double balanced(const char *setup, const struct mk_model *rig, const double *start_rad,
                       const struct mk_model *nominal, enum figure figure)
{
    struct mk_ctrl *ctrl = make_ctrl(setup, nominal);
    double sum = 0.0;
    for (uint64_t seed = 1; seed <= 3; seed++) {
        const double from[MK_MAX_JOINTS] = {start_rad[0] + 0.001 * (double)seed, start_rad[1]};
        const struct trial t = run_trial(ctrl, rig, from, 10.0, seed);
        ck_assert_msg(is_held(&t), "%s %s", trial_end_name(t.end), t.fault);
        sum += figure_of(&t, figure);
    }
    mk_ctrl_destroy(ctrl);
    return sum / 3.0;
}

START_TEST(who_knows_the_effect_balances_better)
{
    static const char *const figures[] = {"sway, rad", "joint 1 off, rad", "command, rms"};
    const struct improvement *i = &improved[_i];
    const enum mk_plant_kind plant = plant_of(i->setup);
    const struct mk_model simple = textbook(plant),
                          known = textbook_with(plant, i->effect, i->joint, i->value);
    double start_rad[MK_MAX_JOINTS] = {0.0, 0.0};
    const struct mk_model rig = hang(&known, start_rad);
    double without = balanced(i->setup, &rig, start_rad, &simple, i->figure);
    double with = balanced(i->setup, &rig, start_rad, &known, i->figure);
    printf("  %-14s %-16s %-16s %.5f -> %.5f\n", i->setup, i->effect, figures[i->figure], without,
           with);
    ck_assert_msg(with < i->at_most * without, "%g, not below %g of %g", with, i->at_most, without);
}
END_TEST

/* Rigs whose free joint something pulls at, and more with it: what is believed and what is true
 * differ in what the command can and cannot make up for. */
static const struct pulled {
    const char *setup;
    struct {
        const char *effect;
        int joint;
        double value[MK_MAX_EFFECT_PARAMETERS];
    } part[3];
} pulled[] = {
    {"pendubot-top",
     {{"custom", 2, {0.00368, 5.0}}, /* a cubic spring */
      {"cable-hysteresis", 1, {1.43, 0.16}},
      {"sensor-delay", 0, {0.003}}}},
    {"pendubot-top",
     {{"custom", 2, {0.006, 5.0}},
      {"cable-hysteresis", 1, {1.13, 0.24}},
      {"sensor-delay", 0, {0.003}}}},
    {"pendubot-top",
     {{"custom", 2, {0.0105, 5.0}},
      {"cable-hysteresis", 1, {1.43, 0.16}},
      {"sensor-delay", 0, {0.003}}}},
    {"pendubot-mid", {{"custom", 2, {0.006, 5.0}}, {"cable-hysteresis", 1, {1.2, 0.2}}}},
    {"pendubot-mid", {{"cable-stiffness", 2, {0.1, 1.0}}}},
    {"furuta", {{"custom", 2, {0.015, 5.0}}, {"sensor-delay", 0, {0.003}}}},
    {"reaction-wheel", {{"custom", 1, {0.0919, 5.0}}}},
    {"reaction-wheel", {{"cable-stiffness", 1, {0.3, 0.1}}}},
};
#define PULLED_COUNT ((int)(sizeof pulled / sizeof pulled[0]))
#define LOST_S 15.0 /* what a run counts that is not caught and held */

/* Mean time of the catches that hold, of eight runs. */
static double caught_on_average(const char *setup, const struct mk_model *rig,
                                const double *start_rad, const struct mk_model *nominal)
{
    enum { RUNS = 8 };
    struct mk_ctrl *ctrl = make_ctrl(setup, nominal);
    double sum = 0.0;
    for (uint64_t seed = 1; seed <= RUNS; seed++) {
        struct mk_random random = {seed};
        double from[MK_MAX_JOINTS];
        for (int j = 0; j < MK_MAX_JOINTS; j++)
            from[j] = start_rad[j] + 0.004 * mk_random_uniform(&random) - 0.002;
        const struct trial t = run_trial(ctrl, rig, from, LOST_S, seed);
        sum += is_held(&t) ? t.caught_s : LOST_S;
    }
    mk_ctrl_destroy(ctrl);
    return sum / RUNS;
}

START_TEST(who_believes_the_true_model_catches_no_later)
{
    const struct pulled *p = &pulled[_i];
    const struct mk_model simple = textbook(plant_of(p->setup));
    struct mk_model known = simple;
    double start_rad[MK_MAX_JOINTS] = {0.0, 0.0};
    for (int k = 0; k < 3 && p->part[k].effect; k++)
        add(&known, p->part[k].effect, p->part[k].joint, p->part[k].value);
    const struct mk_model rig = hang(&known, start_rad);
    double without = caught_on_average(p->setup, &rig, start_rad, &simple);
    double with = caught_on_average(p->setup, &rig, start_rad, &known);
    printf("  %-14s %-16s caught after %.2f -> %.2f s\n", p->setup, p->part[0].effect, without,
           with);
    ck_assert_msg(with < without + 0.5 && with < 5.0, "%g s, not %g s", with, without);
}
END_TEST

static struct mk_explanation offered(enum mk_plant_kind plant, const char *effect, double value)
{
    struct mk_explanation e = {.offered = true};
    mk_model_default(plant, &e.given);
    e.refit = e.extended = e.given;
    add(&e.extended, effect, 1, NULL);
    e.extended.effect[0].value[0] = value;
    return e;
}

START_TEST(the_gain_in_control_is_the_same_each_time_and_with_any_number_of_threads)
{
    struct mk_explanation e = offered(MK_PLANT_FURUTA, "coulomb", 0.3), again = e;
    ck_assert_int_eq(control_gain_measure(&e, 1, NULL), MK_OK);
    ck_assert_int_eq(control_gain_measure(&again, 3, NULL), MK_OK);
    ck_assert_int_eq(e.control_count, 1);
    ck_assert_str_eq(e.control[0].setup, "furuta");
    ck_assert_mem_eq(&e.control[0].refit, &again.control[0].refit, sizeof e.control[0].refit);
    ck_assert_mem_eq(&e.control[0].extended, &again.control[0].extended,
                     sizeof e.control[0].extended);
    ck_assert_double_eq(e.control[0].extended.held, 1.0);
    ck_assert_double_lt(e.control[0].extended.error, 0.6 * e.control[0].refit.error);
    ck_assert_double_eq(e.control[0].given.error, e.control[0].refit.error);
}
END_TEST

/* A trial like one that was seen: held 3, 3 and 1 of 5. */
static struct mk_explanation tried(double given, double refit, double extended)
{
    struct mk_explanation e = offered(MK_PLANT_PENDUBOT, "coulomb", 0.1);
    e.verdict = MK_VERDICT_EFFECT;
    e.control_count = 1;
    e.control[0] = (struct mk_control_gain){"pendubot-top",
                                            5,
                                            {given / 5.0, 2.0, 0.001, 0.02, 1.0, 9.0},
                                            {refit / 5.0, 2.0, 0.001, 0.02, 1.0, 9.0},
                                            {extended / 5.0, 2.0, 0.001, 0.02, 1.0, 9.0}};
    return e;
}

static bool printed_to_warn(const struct mk_explanation *e)
{
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    ck_assert_ptr_nonnull(out);
    explanation_print(out, e);
    fclose(out);
    bool warns = strstr(text, "for simulation only") != NULL;
    free(text);
    return warns;
}

START_TEST(a_model_that_controls_worse_is_not_recommended_to_controllers)
{
    const char *believing;
    struct mk_explanation e = tried(3, 3, 1);
    ck_assert_str_eq(mk_control_gain_worse(&e.control[0], &believing), "holds fewer runs");
    ck_assert_str_eq(believing, "refitted");
    ck_assert(mk_explanation_misleads_control(&e) && printed_to_warn(&e));
    e = tried(4, 2, 3);
    ck_assert_str_eq(mk_control_gain_worse(&e.control[0], &believing), "holds fewer runs");
    ck_assert_str_eq(believing, "given");
    e = tried(5, 5, 5);
    e.control[0].extended.caught_s = 2.6;
    ck_assert_str_eq(mk_control_gain_worse(&e.control[0], &believing), "catches later");
    e.control[0].extended.caught_s = 2.4;
    ck_assert_ptr_null(mk_control_gain_worse(&e.control[0], &believing));
    e.control[0].extended.error = 0.0016;
    ck_assert_str_eq(mk_control_gain_worse(&e.control[0], &believing), "sways more");
    e.control[0].extended.error = 0.0014;
    ck_assert(!mk_explanation_misleads_control(&e) && !printed_to_warn(&e));
    e = tried(3, 3, 4); /* holds more: that it takes longer is no reason against it */
    e.control[0].extended.caught_s = 6.0;
    ck_assert(!mk_explanation_misleads_control(&e) && !printed_to_warn(&e));
    e.control_count = 0;
    ck_assert(!mk_explanation_misleads_control(&e));
}
END_TEST

START_TEST(the_page_does_not_recommend_such_a_model_either)
{
    char path[] = "/tmp/mechkit-test-XXXXXX", text[200000];
    struct mk_log *log = NULL;
    struct mk_error err = MK_ERROR_INIT;
    int file = mkstemp(path);
    ck_assert_int_ge(file, 0);
    for (int worse = 0; worse < 2; worse++) {
        struct mk_explanation e = tried(3, 3, worse ? 1 : 5);
        e.cause_count = 0;
        ck_assert_int_eq(mk_log_create(100, &log), MK_OK);
        ck_assert_msg(mk_explanation_write_html(&e, path, log, &err) == MK_OK, "%s", err.message);
        mk_log_free(log);
        FILE *in = fopen(path, "r");
        ck_assert_ptr_nonnull(in);
        text[fread(text, 1, sizeof text - 1, in)] = '\0';
        fclose(in);
        ck_assert_int_eq(strstr(text, "Use extended.ini from now on") == NULL, worse);
        ck_assert_int_eq(strstr(text, "Leave controllers the model") != NULL, worse);
    }
    close(file);
    unlink(path);
}
END_TEST

START_TEST(speed_control_gains_too)
{
    struct mk_explanation e = offered(MK_PLANT_INERTIA_WHEEL, "coulomb", 0.4);
    ck_assert_int_eq(control_gain_measure(&e, 1, NULL), MK_OK);
    ck_assert_int_eq(e.control_count, 1);
    ck_assert_str_eq(e.control[0].setup, "pi-speed");
    ck_assert_double_lt(e.control[0].extended.error, 0.9 * e.control[0].refit.error);
    ck_assert(isnan(e.control[0].extended.caught_s));
}
END_TEST

START_TEST(nothing_is_measured_where_there_is_nothing_to_offer_or_to_control)
{
    struct mk_explanation e = offered(MK_PLANT_FURUTA, "coulomb", 0.3);
    e.offered = false;
    ck_assert_int_eq(control_gain_measure(&e, 1, NULL), MK_OK);
    ck_assert_int_eq(e.control_count, 0);
    e = offered(MK_PLANT_PENDULUM, "coulomb", 0.01);
    ck_assert_int_eq(control_gain_measure(&e, 1, NULL), MK_OK);
    ck_assert_int_eq(e.control_count, 0);
}
END_TEST

Suite *suite_compensate(void)
{
    Suite *s = suite_create("compensate");
    TCase *t = tcase_create("command");
    tcase_add_loop_test(t, each_effect_within_reach_leaves_the_acceleration_wished_for, 0,
                        (int)CANCELLED_COUNT);
    tcase_add_test(t, all_effects_together_leave_the_acceleration_wished_for);
    tcase_add_test(t, who_says_to_be_invertible_is_tried);
    tcase_add_test(t, effects_elsewhere_are_left_alone);
    tcase_add_test(t, what_takes_more_than_the_limit_gets_the_limit);
    tcase_add_test(t, a_command_that_does_nothing_stays_as_wished);
    suite_add_tcase(s, t);

    t = tcase_create("equilibrium");
    tcase_add_test(t, a_cable_at_the_free_joint_moves_the_equilibrium);
    tcase_add_test(t, a_tilted_pendubot_hangs_along_gravity);
    tcase_add_test(t, a_cable_at_the_free_joint_holds_elsewhere_after_a_turn);
    tcase_add_test(t, a_swing_up_aims_at_the_lower_of_two_uprights_from_either_side);
    tcase_add_test(t, a_spring_at_the_free_joint_is_held_by_gains_that_are_made_for_it);
    tcase_add_test(t, a_wheel_may_stand_anywhere);
    tcase_add_test(t, where_nothing_stands_still_there_is_no_equilibrium);
    suite_add_tcase(s, t);

    t = tcase_create("step");
    tcase_set_timeout(t, 60);
    tcase_add_loop_test(t, without_effects_no_bit_of_the_command_changes, 0, (int)SETUP_COUNT);
    tcase_add_loop_test(t, a_step_is_bounded_whatever_is_read, 0, 3);
    tcase_add_loop_test(t, a_step_remembers_nothing_after_a_reset, 0, 1);
    tcase_add_test(t, open_loop_stays_open);
    suite_add_tcase(s, t);

    t = tcase_create("gain");
    tcase_set_tags(t, "long");
    tcase_set_timeout(t, 120);
    tcase_add_loop_test(t, a_step_is_bounded_whatever_is_read, 3, (int)SETUP_COUNT);
    tcase_add_loop_test(t, a_step_remembers_nothing_after_a_reset, 1, (int)SETUP_COUNT);
    tcase_add_loop_test(t, who_knows_the_effect_balances_better, 0, IMPROVED_COUNT);
    tcase_add_loop_test(t, who_believes_the_true_model_catches_no_later, 0, PULLED_COUNT);
    tcase_add_test(t, the_gain_in_control_is_the_same_each_time_and_with_any_number_of_threads);
    tcase_add_test(t, a_model_that_controls_worse_is_not_recommended_to_controllers);
    tcase_add_test(t, the_page_does_not_recommend_such_a_model_either);
    tcase_add_test(t, speed_control_gains_too);
    tcase_add_test(t, nothing_is_measured_where_there_is_nothing_to_offer_or_to_control);
    suite_add_tcase(s, t);
    return s;
}
