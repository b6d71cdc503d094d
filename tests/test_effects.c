/* Effects against their laws written out by hand, and derivatives against finite differences. */
#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mechkit/model.h"

static struct mk_model with_effect(enum mk_plant_kind kind, const char *name, int joint)
{
    struct mk_model m;
    struct mk_error err = MK_ERROR_INIT;
    mk_model_default(kind, &m);
    ck_assert_msg(mk_model_add_effect(&m, name, joint, &err) == MK_OK, "%s", err.message);
    return m;
}

/* What an effect adds to the right-hand side of joint j, by inverse dynamics of what it does. */
static double added_torque(const struct mk_model *m, const double *x, double u, int joint)
{
    int n = mk_model_joints(m);
    double dx[MK_MAX_STATES], tau[2], command[2] = {u, 0};
    mk_model_rhs(m, 0.3, x, command, dx);
    mk_plant_inverse_dynamics(m, x, x + n, dx + n, tau);
    double motor = mk_plant(m->plant)->motor_joint == joint - 1 ? u : 0.0;
    return tau[joint - 1] - motor;
}

static double sign_of(double k, double v)
{
    return 1.0 - 2.0 / (exp(2.0 * k * v) + 1.0);
}

START_TEST(torque_effects_follow_their_laws)
{
    static const struct {
        const char *name;
        double p[3];
    } cases[] = {{"viscous", {0.03}},
                 {"coulomb", {0.4, 33}},
                 {"stribeck", {0.2, 0.7, 21}},
                 {"quadratic-drag", {0.01}},
                 {"cable-stiffness", {0.5, -1.2}},
                 {"cogging", {0.15, 6, 0.4}},
                 {"coulomb-asymmetry", {0.3, 9}},
                 {"viscous-asymmetry", {-0.06}},
                 {"torque-offset", {-0.7}}};
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++)
        for (int joint = 1; joint <= 2; joint++)
            for (double v = -0.9; v < 1.0; v += 0.3) {
                struct mk_model m = with_effect(MK_PLANT_PENDUBOT, cases[c].name, joint);
                const double *p = cases[c].p;
                memcpy(m.effect[0].value, p, 3 * sizeof *p);
                double x[4] = {0.4, -1.1, v, -0.5 * v}, q = x[joint - 1], w = x[1 + joint];
                double want[] = {-p[0] * w,
                                 -p[0] * sign_of(p[1], w),
                                 -p[0] * exp(-w * w / (p[1] * p[1])) * sign_of(p[2], w),
                                 -p[0] * w * fabs(w),
                                 -p[0] * (q - p[1]),
                                 -p[0] * sin(p[1] * q + p[2]),
                                 -0.5 * p[0] * pow(sign_of(p[1], w), 2.0),
                                 w > 0.0 ? -0.5 * p[0] * w : 0.5 * p[0] * w,
                                 p[0]};
                ck_assert_double_eq_tol(added_torque(&m, x, 1.7, joint), want[c], 1e-10);
                ck_assert_double_eq_tol(added_torque(&m, x, 1.7, 3 - joint), 0.0, 1e-10);
            }
}
END_TEST

/* The point mass of base parameters m l and m l^2 at the end of link 2, on its way with even speeds
 * of the joints; the pivot's own acceleration is felt too. */
static void place_of_mass(const struct mk_model *m, const double *x, double t, double *r)
{
    const double *p = m->parameter, a = x[0] + t * x[2], b = x[1] + t * x[3];
    if (m->plant == MK_PLANT_PENDUBOT) {
        double l = p[1] / p[4], arm = p[2] / p[4];
        r[0] = arm * cos(a) + l * cos(a + b);
        r[1] = 0.0;
        r[2] = arm * sin(a) + l * sin(a + b);
    } else if (m->plant == MK_PLANT_REACTION_WHEEL) {
        double l = p[0] / p[2];
        r[0] = l * sin(a), r[1] = 0.0, r[2] = -l * cos(a);
    } else {
        double l = 4.0 * p[2] / p[3], arm = 0.5 * p[1] / p[3];
        r[0] = arm * cos(a) - l * sin(b) * sin(a);
        r[1] = arm * sin(a) + l * sin(b) * cos(a);
        r[2] = l * cos(b);
    }
}

static void direction_of_link(const struct mk_model *m, const double *x, double *d)
{
    double a = x[0], b = x[1];
    double pendubot[] = {cos(a + b), 0.0, sin(a + b)}, wheel[] = {sin(a), 0.0, -cos(a)};
    double furuta[] = {-sin(b) * sin(a), sin(b) * cos(a), cos(b)};
    const double *of = m->plant == MK_PLANT_PENDUBOT         ? pendubot
                       : m->plant == MK_PLANT_REACTION_WHEEL ? wheel
                                                             : furuta;
    memcpy(d, of, 3 * sizeof *d);
}

START_TEST(friction_of_a_passive_bearing_grows_with_what_presses_on_it)
{
    static const enum mk_plant_kind kinds[] = {MK_PLANT_PENDUBOT, MK_PLANT_REACTION_WHEEL,
                                               MK_PLANT_FURUTA};
    enum mk_plant_kind kind = kinds[_i];
    int passive = kind == MK_PLANT_REACTION_WHEEL ? 1 : 2;
    struct mk_model m = with_effect(kind, "load-friction", passive);
    const double mu = 0.04, k = 12.0, h = 1e-4;
    m.effect[0].value[0] = mu, m.effect[0].value[1] = k;
    double weight = kind == MK_PLANT_PENDUBOT         ? m.parameter[4]
                    : kind == MK_PLANT_REACTION_WHEEL ? m.parameter[2]
                                                      : m.parameter[3];
    for (int n = 0; n < 40; n++) {
        double x[4] = {0.3 * n, 1.7 - 0.41 * n, 3.0 * sin(n), 4.0 * cos(1.3 * n)};
        double r[3][3], d[3], along = 0.0, v = x[1 + passive];
        for (int i = 0; i < 3; i++)
            place_of_mass(&m, x, h * (i - 1), r[i]);
        direction_of_link(&m, x, d);
        for (int i = 0; i < 3; i++)
            along -= d[i] * ((r[0][i] - 2.0 * r[1][i] + r[2][i]) / (h * h) + (i == 2 ? m.g : 0.0));
        double want = -mu * weight * fabs(along) * sign_of(k, v);
        ck_assert_double_eq_tol(added_torque(&m, x, 1.7, passive), want, 1e-5);
        ck_assert_double_eq_tol(added_torque(&m, x, 1.7, 3 - passive), 0.0, 1e-9);
    }
}
END_TEST

START_TEST(torque_scale_is_a_gain_of_the_motor)
{
    struct mk_model m = with_effect(MK_PLANT_INERTIA_WHEEL, "torque-scale", 0);
    m.effect[0].value[0] = 0.07;
    double x[2] = {0, 0}, dx[2], u[2] = {-4.0, 0};
    mk_model_rhs(&m, 0, x, u, dx);
    ck_assert_double_eq_tol(m.parameter[0] * dx[1], -4.28, 1e-12);
}
END_TEST

/* Of its energy, which turns once around with the joint. */
START_TEST(a_place_that_draws_a_link_is_the_slope_of_a_bell)
{
    const double depth = 0.2, centre = 0.9, width = 0.35, h = 1e-5;
    for (int joint = 1; joint <= 2; joint++)
        for (double off = -7.0; off < 7.0; off += 0.31) {
            struct mk_model m = with_effect(MK_PLANT_PENDUBOT, "custom-well", joint);
            const double value[] = {depth, centre, width};
            memcpy(m.effect[0].value, value, sizeof value);
            double x[4] = {0.4, -1.1, 0.7, -0.2}, energy[2];
            x[joint - 1] = centre + off;
            for (int side = 0; side < 2; side++) {
                double chord = 2.0 * sin(0.5 * (off + (side ? h : -h)));
                energy[side] = -depth * width * exp(-0.5 * chord * chord / (width * width));
            }
            double want = -(energy[1] - energy[0]) / (2.0 * h);
            ck_assert_double_eq_tol(added_torque(&m, x, 1.7, joint), want, 1e-8);
        }
}
END_TEST

START_TEST(a_rotor_behind_a_gear_adds_to_its_own_joint_alone)
{
    for (int joint = 1; joint <= 2; joint++) {
        struct mk_model m = with_effect(MK_PLANT_PENDUBOT, "reflected-inertia", joint);
        m.effect[0].value[0] = 0.02;
        double x[4] = {0.4, -1.1, 0.7, -0.2}, dx[4], u[2] = {1.7, 0};
        mk_model_rhs(&m, 0, x, u, dx);
        ck_assert_double_eq_tol(added_torque(&m, x, 1.7, joint), -0.02 * dx[1 + joint], 1e-10);
        ck_assert_double_eq_tol(added_torque(&m, x, 1.7, 3 - joint), 0.0, 1e-10);
    }
}
END_TEST

START_TEST(back_emf_limits_torque_by_speed)
{
    struct mk_model m = with_effect(MK_PLANT_INERTIA_WHEEL, "back-emf-limit", 0);
    m.effect[0].value[0] = 8.0;
    m.effect[0].value[1] = 100.0;
    double speeds[] = {0, 50, -50, 99, 130}, limit[] = {8, 4, 4, 0.08, 0};
    for (int i = 0; i < 5; i++) {
        double x[2] = {0, speeds[i]}, dx[2], u[2] = {9.0, 0};
        mk_model_rhs(&m, 0, x, u, dx);
        double torque = m.parameter[0] * dx[1] + mk_plant_friction(&m, speeds[i]);
        ck_assert_double_eq_tol(torque, limit[i], 1e-9);
    }
}
END_TEST

/* An amplifier's gain comes before its limit, whichever is named first. */
START_TEST(effects_act_in_their_physical_order_whatever_the_order_in_the_model)
{
    static const char *const order[2][2] = {{"saturation", "gain-asymmetry"},
                                            {"gain-asymmetry", "saturation"}};
    for (int i = 0; i < 2; i++) {
        struct mk_model m = with_effect(MK_PLANT_INERTIA_WHEEL, order[i][0], 0);
        ck_assert_int_eq(mk_model_add_effect(&m, order[i][1], 0, NULL), MK_OK);
        m.effect[i].value[0] = 3.0;     /* limit */
        m.effect[1 - i].value[0] = 0.2; /* ratio */
        double x[2] = {0, 0}, dx[2], u[2] = {5.0, 0};
        mk_model_rhs(&m, 0, x, u, dx);
        ck_assert_double_eq_tol(m.parameter[0] * dx[1], 3.0, 1e-9);
        u[0] = 2.0;
        mk_model_rhs(&m, 0, x, u, dx);
        ck_assert_double_eq_tol(m.parameter[0] * dx[1], 2.4, 1e-9);
    }
}
END_TEST

START_TEST(the_command_is_limited)
{
    struct mk_model m;
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &m);
    double x[2] = {0, 0}, a[2], b[2], over[2] = {25, 0}, at[2] = {10, 0};
    mk_model_rhs(&m, 0, x, over, a);
    mk_model_rhs(&m, 0, x, at, b);
    ck_assert_double_eq(a[1], b[1]);
}
END_TEST

START_TEST(encoder_offset_is_added_and_taken_away)
{
    struct mk_model m = with_effect(MK_PLANT_FURUTA, "encoder-offset", 2);
    m.effect[0].value[0] = 0.02;
    double x[4] = {0.1, 3.0, 0, 0}, y[2], q[2];
    mk_model_measure(&m, 0, x, y);
    ck_assert_double_eq_tol(y[0], 0.1, 1e-15);
    ck_assert_double_eq_tol(y[1], 3.02, 1e-15);
    mk_model_unmeasure(&m, 0, y, q);
    ck_assert_double_eq_tol(q[1], 3.0, 1e-14);
}
END_TEST

START_TEST(lag_acts_on_both_motors)
{
    struct mk_model m = with_effect(MK_PLANT_PENDUBOT, "actuator-lag", 0);
    const double late = 0.02;
    m.effect[0].value[0] = late;
    double q[2] = {0.4, -1.1}, v[2] = {0.7, -0.2}, x[6], dx[6], tau[2], u[2] = {1.7, -0.6};
    ck_assert_int_eq(mk_model_state_count(&m), 6);
    mk_model_initial_state(&m, q, v, x);
    ck_assert(x[4] == 0.0 && x[5] == 0.0);
    x[4] = 0.9, x[5] = 0.3;
    mk_model_rhs(&m, 0.0, x, u, dx);
    mk_plant_inverse_dynamics(&m, q, v, dx + 2, tau);
    for (int i = 0; i < 2; i++) {
        ck_assert_double_eq_tol(tau[i], x[4 + i], 1e-12);
        ck_assert_double_eq_tol(dx[4 + i], (u[i] - x[4 + i]) / late, 1e-12);
    }
}
END_TEST

START_TEST(input_delay_is_for_the_simulation)
{
    struct mk_model m = with_effect(MK_PLANT_PENDULUM, "input-delay", 0);
    m.effect[0].value[0] = 0.007;
    ck_assert_double_eq(mk_model_command_delay(&m), 0.007);
    ck_assert(mk_model_is_smooth(&m));
}
END_TEST

/* --- play -------------------------------------------------------------------------------- */

START_TEST(backlash_passes_nothing_inside_the_gap_and_a_spring_beyond)
{
    struct mk_model m = with_effect(MK_PLANT_PENDUBOT, "backlash", 2);
    double *p = m.effect[0].value;
    p[0] = 0.02, p[1] = 100.0, p[2] = 0.0, p[3] = 0.01, p[4] = 0.0;
    ck_assert(!mk_model_is_smooth(&m));
    ck_assert_int_eq(mk_model_state_count(&m), 6);
    ck_assert_int_eq(mk_model_event_count(&m), 2);
    double q[2] = {-1, 0.3}, v[2] = {0, 0}, x[6], g[2], u[2] = {0, 0}, dx[6];
    mk_model_initial_state(&m, q, v, x);
    double offsets[] = {0.0, 0.009, 0.03, -0.03};
    for (int i = 0; i < 4; i++) {
        x[4] = x[1] + offsets[i];
        mk_model_events(&m, 0, x, u, g);
        ck_assert_int_eq(g[0] > 0, offsets[i] > 0.01);
        ck_assert_int_eq(g[1] < 0, offsets[i] < -0.01);
        mk_model_rhs(&m, 0, x, u, dx);
        double reach = fmax(fabs(offsets[i]) - 0.01, 0.0),
               push = copysign(100.0 * reach, offsets[i]);
        /* The light shaft accelerates by what it pushes with, against link 1's acceleration. */
        double light = 0.01 * m.parameter[1];
        ck_assert_double_eq_tol(dx[5] + dx[2], -push / light, 1e-6);
    }
    double y[2];
    mk_model_measure(&m, 0, x, y);
    ck_assert_double_eq(y[1], x[4]);
}
END_TEST

START_TEST(backlash_conserves_momentum_and_energy)
{
    /* Wheel behind a gap: rotor and wheel exchange momentum through the contact and nothing is lost
     * without damping and friction. */
    struct mk_model m = with_effect(MK_PLANT_INERTIA_WHEEL, "backlash", 1);
    m.parameter[1] = m.parameter[2] = 0.0;
    m.effect[0].value[2] = 0.0;
    m.effect[0].value[3] = 0.2;
    double x[4] = {0, 0, 0.05, 3.0}, dx[4], u[2] = {0, 0};
    double rotor = 0.2 * m.parameter[0], load = 0.8 * m.parameter[0];
    mk_model_rhs(&m, 0, x, u, dx);
    ck_assert_double_eq_tol(load * dx[1] + rotor * dx[3], 0.0, 1e-12);
    ck_assert_double_gt(load * dx[1], 0.0);
}
END_TEST

START_TEST(reaction_wheel_backlash_keeps_angular_momentum)
{
    struct mk_model m = with_effect(MK_PLANT_REACTION_WHEEL, "backlash", 2);
    m.effect[0].value[3] = 0.2;
    m.g = 1e-300; /* no gravity: the momentum of all three bodies stays */
    double x[6] = {0.2, 0.0, 0.4, 5.0, 0.05, 9.0}, dx[6], u[2] = {3.0, 0};
    mk_model_rhs(&m, 0, x, u, dx);
    double p1 = m.parameter[0], rotor = 0.2 * m.parameter[1], load = 0.8 * m.parameter[1];
    double rate = p1 * dx[2] + load * (dx[2] + dx[3]) + rotor * (dx[2] + dx[5]);
    ck_assert_double_eq_tol(rate, 0.0, 1e-9);
}
END_TEST

/* --- derivatives ------------------------------------------------------------------------- */

static double *parameter_at(struct mk_model *m, int k)
{
    int np = mk_plant(m->plant)->parameter_count;
    if (k < np)
        return &m->parameter[k];
    k -= np;
    for (int e = 0; e < m->effect_count; e++) {
        int count = mk_effect(m->effect[e].index)->parameter_count;
        if (k < count)
            return &m->effect[e].value[k];
        k -= count;
    }
    return NULL;
}

static void check_jacobian(struct mk_model *m)
{
    int ns = mk_model_state_count(m), np = mk_model_parameter_count(m);
    double x[MK_MAX_STATES], u[2] = {1.3, 0.2}, fx[MK_MAX_STATES * MK_MAX_STATES];
    double fu[MK_MAX_STATES * 2], fp[MK_MAX_STATES * 64], h = 1e-6;
    double q[2] = {0.4, -1.1}, v[2] = {0.31, -0.6};
    mk_model_initial_state(m, q, v, x);
    for (int i = 2 * mk_model_joints(m); i < ns; i++)
        x[i] += 0.05; /* effects away from rest */
    mk_model_jacobian(m, 0.1, x, u, fx, fu, fp);
    for (int k = 0; k < ns + 2 + np; k++) {
        double *at = k < ns ? &x[k] : k < ns + 2 ? &u[k - ns] : parameter_at(m, k - ns - 2);
        double keep = *at, step = h * (1.0 + fabs(keep)), up[MK_MAX_STATES], down[MK_MAX_STATES];
        *at = keep + step;
        mk_model_rhs(m, 0.1, x, u, up);
        *at = keep - step;
        mk_model_rhs(m, 0.1, x, u, down);
        *at = keep;
        for (int row = 0; row < ns; row++) {
            double slope = (up[row] - down[row]) / (2 * step);
            double got = k < ns       ? fx[row * ns + k]
                         : k < ns + 2 ? fu[row * 2 + k - ns]
                                      : fp[row * np + k - ns - 2];
            ck_assert_msg(fabs(got - slope) <= 1e-5 * (1.0 + fabs(slope)),
                          "%s: row %d, variable %d: %g against %g", mk_plant(m->plant)->name, row,
                          k, got, slope);
        }
    }
}

START_TEST(jacobians_of_every_effect_agree_with_finite_differences)
{
    const struct mk_effect_info *info = mk_effect(_i);
    for (int kind = 0; kind < MK_PLANT_COUNT; kind++) {
        if (!(info->plants & (1u << kind)))
            continue;
        int joint = info->joint_rule == MK_EFFECT_JOINT_NONE ? 0 : mk_plant(kind)->joints;
        struct mk_model m = with_effect((enum mk_plant_kind)kind, info->name, joint);
        check_jacobian(&m);
    }
}
END_TEST

START_TEST(the_table_of_effects_is_consistent)
{
    for (int i = 0; i < mk_effect_count(); i++) {
        const struct mk_effect_info *e = mk_effect(i);
        ck_assert_ptr_eq(mk_effect_by_name(e->name), e);
        ck_assert_int_eq((e->stages & MK_STAGE_STATE) != 0, e->state_count > 0);
        ck_assert_int_eq((e->stages & MK_STAGE_EVENT) != 0, e->event_count > 0);
        ck_assert(!e->holds_still || mk_effect_parameter_index(e, "level") >= 0);
        for (int k = 0; k < e->parameter_count; k++) {
            ck_assert_double_le(e->parameter[k].min, e->parameter[k].initial);
            ck_assert_double_ge(e->parameter[k].max, e->parameter[k].initial);
            ck_assert_int_eq(mk_effect_parameter_index(e, e->parameter[k].name), k);
        }
    }
    ck_assert(mk_effect_by_name("coulomb")->holds_still);
    ck_assert(!mk_effect_by_name("torque-offset")->holds_still); /* has a level too */
    ck_assert_ptr_null(mk_effect_by_name("no-such-effect"));
    ck_assert_ptr_null(mk_effect(-1));
}
END_TEST

START_TEST(an_effect_that_does_not_fit_is_refused)
{
    struct mk_model m;
    struct mk_error err = MK_ERROR_INIT;
    mk_model_default(MK_PLANT_PENDULUM, &m);
    ck_assert_int_eq(mk_model_add_effect(&m, "viscous", 2, &err), MK_ERR_INVALID);
    ck_assert_int_eq(mk_model_add_effect(&m, "viscous", 0, &err), MK_ERR_INVALID);
    ck_assert_int_eq(mk_model_add_effect(&m, "backlash", 1, &err), MK_ERR_INVALID);
    ck_assert_int_eq(mk_model_add_effect(&m, "input-delay", 1, &err), MK_ERR_INVALID);
    ck_assert_int_eq(mk_model_add_effect(&m, "warp-drive", 1, &err), MK_ERR_NOTFOUND);
    for (int i = 0; i < MK_MAX_EFFECTS; i++)
        ck_assert_int_eq(mk_model_add_effect(&m, "viscous", 1, &err), MK_OK);
    ck_assert_int_eq(mk_model_add_effect(&m, "viscous", 1, &err), MK_ERR_RANGE);
    ck_assert_int_eq(m.effect_count, MK_MAX_EFFECTS);
}
END_TEST

START_TEST(every_effect_says_what_it_is_and_what_to_do_about_it)
{
    for (int i = 0; i < mk_effect_count(); i++) {
        const struct mk_effect_info *effect = mk_effect(i);
        const struct mk_effect_words *words = mk_effect_in_words(effect);
        if (strncmp(effect->name, "custom", 6) == 0) { /* terms of the library have no name */
            ck_assert_ptr_null(words->title);
            continue;
        }
        ck_assert_msg(words->title && words->usual && words->remedy, "%s", effect->name);
        const char *sentences[] = {words->usual, words->remedy};
        for (int k = 0; k < 2; k++)
            ck_assert_msg(sentences[k][strlen(sentences[k]) - 1] == '.', "%s", effect->name);
    }
}
END_TEST

START_TEST(every_effect_has_a_row_in_the_documented_table)
{
    char text[64000], row[80];
    FILE *f = fopen(MK_SOURCE_DIR "/docs/effects.md", "r");
    ck_assert_ptr_nonnull(f);
    text[fread(text, 1, sizeof text - 1, f)] = '\0';
    fclose(f);
    for (int i = 0; mk_effect(i); i++) {
        snprintf(row, sizeof row, "\n| `%s` |", mk_effect(i)->name);
        ck_assert_msg(strstr(text, row) != NULL, "%s", mk_effect(i)->name);
    }
}
END_TEST

Suite *suite_effects(void)
{
    Suite *s = suite_create("effects");
    TCase *t = tcase_create("laws");
    tcase_add_test(t, torque_effects_follow_their_laws);
    tcase_add_test(t, every_effect_says_what_it_is_and_what_to_do_about_it);
    tcase_add_test(t, every_effect_has_a_row_in_the_documented_table);
    tcase_add_loop_test(t, friction_of_a_passive_bearing_grows_with_what_presses_on_it, 0, 3);
    tcase_add_test(t, torque_scale_is_a_gain_of_the_motor);
    tcase_add_test(t, a_place_that_draws_a_link_is_the_slope_of_a_bell);
    tcase_add_test(t, a_rotor_behind_a_gear_adds_to_its_own_joint_alone);
    tcase_add_test(t, back_emf_limits_torque_by_speed);
    tcase_add_test(t, the_command_is_limited);
    tcase_add_test(t, effects_act_in_their_physical_order_whatever_the_order_in_the_model);
    tcase_add_test(t, encoder_offset_is_added_and_taken_away);
    tcase_add_test(t, lag_acts_on_both_motors);
    tcase_add_test(t, input_delay_is_for_the_simulation);
    tcase_add_test(t, backlash_passes_nothing_inside_the_gap_and_a_spring_beyond);
    tcase_add_test(t, backlash_conserves_momentum_and_energy);
    tcase_add_test(t, reaction_wheel_backlash_keeps_angular_momentum);
    tcase_add_loop_test(t, jacobians_of_every_effect_agree_with_finite_differences, 0,
                        mk_effect_count());
    tcase_add_test(t, the_table_of_effects_is_consistent);
    tcase_add_test(t, an_effect_that_does_not_fit_is_refused);
    suite_add_tcase(s, t);
    return s;
}
