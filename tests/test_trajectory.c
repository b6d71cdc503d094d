/* Time-optimal swing-ups: the search, the file, and set-ups that follow it. The trajectories are
 * those of models/. */
#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "experiment/robustness.h"
#include "mechkit/sim.h"
#include "mechkit/swingup.h"
#include "support/closed.h"
#include "support/files.h"
#include "support/heap.h"

#define MODELS MK_SOURCE_DIR "/models/"
#define RATE_HZ 500.0

/* Catches within 1.5 times the shortest swing-up; for the pendubot by its known bounds. */
static const struct {
    const char *file, *setup;
    int equilibrium;
    double known_s;       /* a swing-up that takes no longer is known for |u| <= 10 */
    double caught_within; /* s */
} rigs[] = {{"pendubot-mid", "pendubot-mid", 1, 0.91, 1.35},
            {"pendubot-top", "pendubot-top", 2, 0.78, 1.17},
            {"furuta-top", "furuta", 1, 0.60, 0.87},
            {"reaction-wheel-top", "reaction-wheel", 1, 3.10, 4.57},
            {"cart-pole-top", "cart-pole", 1, 1.15, 1.67},
            {"acrobot-top", "acrobot", 1, 0.53, 0.78}};
#define RIGS ((int)(sizeof rigs / sizeof rigs[0]))
#define ROBUST (RIGS - 1) /* the acrobot's energy swing-up misses one rig in eight */

static const char *file_of(int rig)
{
    static char path[300];
    snprintf(path, sizeof path, MODELS "%s-swingup.csv", rigs[rig].file);
    return path;
}

static struct mk_swingup *load(int rig)
{
    struct mk_swingup *s;
    struct mk_error err = MK_ERROR_INIT;
    enum mk_status st = mk_swingup_read(file_of(rig), &s, &err);
    ck_assert_msg(st == MK_OK, "%s:%d: %s", err.file, err.line, err.message);
    return s;
}

/* --- the trajectory ---------------------------------------------------------------------------
 */

static void must_arrive(const struct mk_swingup *s, double tolerance)
{
    struct mk_sim_config config = {.rtol = 1e-11, .atol = 1e-12};
    struct mk_sim *sim;
    ck_assert_int_eq(mk_sim_create(&s->model, &config, &sim, NULL), MK_OK);
    ck_assert_int_eq(mk_sim_reset(sim, 0.0, s->x, NULL), MK_OK);
    for (size_t k = 0; k < s->count; k++) {
        double u[MK_MAX_INPUTS] = {s->u[k], 0.0};
        ck_assert_double_le(fabs(s->u[k]), s->limit * (1.0 + 1e-12));
        ck_assert_int_eq(mk_sim_advance(sim, (double)(k + 1) / s->rate_hz, u, NULL), MK_OK);
    }
    const struct mk_plant_info *plant = mk_plant(s->model.plant);
    const double *x = mk_sim_state(sim);
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        double off = x[j] - plant->equilibrium[s->equilibrium].q[j];
        if (j != plant->motor_joint)
            off = remainder(off, 2.0 * M_PI);
        if (!mk_model_turns_freely(&s->model, j))
            ck_assert_double_lt(fabs(off), tolerance);
        ck_assert_double_lt(fabs(x[2 + j]), 20.0 * tolerance);
    }
    mk_sim_destroy(sim);
}

START_TEST(sundials_integrates_the_commands_to_the_equilibrium)
{
    struct mk_swingup *s = load(_i);
    ck_assert_double_le(s->optimum_s, rigs[_i].known_s);
    ck_assert_double_ge((double)s->count / s->rate_hz, 0.98 * s->optimum_s);
    must_arrive(s, 0.003);
    mk_swingup_free(s);
}
END_TEST

START_TEST(the_search_finds_a_swing_up_that_holds_and_is_as_short_as_is_known)
{
    struct mk_model model;
    struct mk_swingup_options options;
    struct mk_swingup *s;
    struct mk_error err = MK_ERROR_INIT;
    mk_model_default(MK_PLANT_FURUTA, &model);
    mk_swingup_default(&options);
    enum mk_status st = mk_swingup_design(&model, 1, &options, &s, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    ck_assert_double_le(s->optimum_s, 0.60);
    ck_assert_double_ge(s->optimum_s, 0.55);
    /* Travel of the arm stays within the safety limits, with a tenth to spare. */
    for (size_t k = 0; k <= s->count; k++)
        ck_assert_double_le(fabs(s->x[4 * k]), 0.92 * mk_plant(MK_PLANT_FURUTA)->joint_travel[0]);
    must_arrive(s, 0.003);
    mk_swingup_free(s);
}
END_TEST

START_TEST(what_has_no_swing_up_is_refused)
{
    struct mk_model model;
    struct mk_swingup_options options;
    struct mk_swingup *s;
    struct mk_error err = MK_ERROR_INIT;
    mk_swingup_default(&options);
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &model);
    ck_assert_int_eq(mk_swingup_design(&model, 0, &options, &s, &err), MK_ERR_NOTSUP);
    mk_model_default(MK_PLANT_PENDUBOT, &model);
    ck_assert_int_eq(mk_swingup_design(&model, 0, &options, &s, &err), MK_ERR_NOTSUP);
    options.reserve = 0.7;
    ck_assert_int_eq(mk_swingup_design(&model, 1, &options, &s, &err), MK_ERR_RANGE);
    ck_assert_ptr_null(s);
}
END_TEST

/* --- the file ---------------------------------------------------------------------------------
 */

START_TEST(a_written_trajectory_reads_back_equal)
{
    struct mk_swingup *s = load(0), *again;
    const char *path = scratch("again.csv");
    ck_assert_int_eq(mk_swingup_write(path, s, NULL), MK_OK);
    ck_assert_int_eq(mk_swingup_read(path, &again, NULL), MK_OK);
    ck_assert_uint_eq(again->count, s->count);
    ck_assert_mem_eq(again->u, s->u, s->count * sizeof *s->u);
    ck_assert_mem_eq(again->x, s->x, (s->count + 1) * 4 * sizeof *s->x);
    ck_assert_double_eq(again->optimum_s, s->optimum_s);
    ck_assert_int_eq(again->equilibrium, s->equilibrium);
    mk_swingup_free(s);
    mk_swingup_free(again);
}
END_TEST

/* The file of the pendubot's middle with `from` in `line` replaced by `to`, and what is told. */
static void must_tell(int line, const char *from, const char *to, const char *told)
{
    FILE *in = fopen(file_of(0), "r");
    ck_assert_ptr_nonnull(in);
    const char *path = scratch("bad.csv");
    FILE *out = fopen(path, "w");
    char text[400];
    for (int n = 1; fgets(text, sizeof text, in); n++) {
        char *at = n == line ? strstr(text, from) : NULL;
        ck_assert_msg(n != line || at, "line %d has no '%s': %s", n, from, text);
        if (at)
            fprintf(out, "%.*s%s%s", (int)(at - text), text, to, at + strlen(from));
        else
            fputs(text, out);
    }
    fclose(in);
    fclose(out);
    struct mk_error err = MK_ERROR_INIT;
    struct closed c;
    closed_open(&c, "pendubot-mid", NULL);
    ck_assert_int_ne(mk_ctrl_load_swingup(c.ctrl, path, &err), MK_OK);
    ck_assert_ptr_null(c.ctrl->track);
    ck_assert_msg(strstr(err.message, told), "line %d '%s': %s", line, to, err.message);
    ck_assert_str_eq(err.file, path);
    ck_assert_int_eq(err.line, line);
    closed_close(&c);
}

START_TEST(a_file_that_does_not_fit_is_told_with_its_line)
{
    must_tell(3, "pendubot", "windmill", "expected a rig");
    must_tell(4, "mid", "side", "expected an equilibrium");
    must_tell(6, "500", "fast", "expected a number");
    must_tell(11, "15", "fifteen", "expected a number");
    must_tell(100, ",", ",1", "");
}
END_TEST

static enum mk_status load_into(const char *setup, const struct mk_model *model, double dt,
                                const char *file, struct mk_error *err)
{
    struct mk_ctrl *ctrl;
    ck_assert_int_eq(mk_ctrl_create(mk_ctrl_setup_by_name(setup), model, dt, NULL, &ctrl, err),
                     MK_OK);
    enum mk_status st = mk_ctrl_load_swingup(ctrl, file, err);
    mk_ctrl_destroy(ctrl);
    return st;
}

START_TEST(another_rig_equilibrium_parameter_or_rate_is_refused_with_file_and_line)
{
    struct mk_error err = MK_ERROR_INIT;
    struct mk_model model;
    mk_model_default(MK_PLANT_FURUTA, &model);
    ck_assert_int_eq(load_into("furuta", &model, 0.002, file_of(0), &err), MK_ERR_INVALID);
    ck_assert_int_eq(err.line, 3);
    mk_model_default(MK_PLANT_PENDUBOT, &model);
    ck_assert_int_eq(load_into("pendubot-top", &model, 0.002, file_of(0), &err), MK_ERR_INVALID);
    ck_assert_int_eq(err.line, 4);
    ck_assert_int_eq(load_into("pendubot-mid", &model, 0.001, file_of(0), &err), MK_ERR_INVALID);
    ck_assert_int_eq(err.line, 6);
    ck_assert_ptr_nonnull(strstr(err.message, "rate_hz = 500, but here it is 1000"));
    model.parameter[2] *= 1.01;
    ck_assert_int_eq(load_into("pendubot-mid", &model, 0.002, file_of(0), &err), MK_ERR_INVALID);
    ck_assert_ptr_nonnull(strstr(err.message, "p3"));
    ck_assert_int_eq(err.line, 14);
    ck_assert_ptr_nonnull(strstr(err.file, "pendubot-mid-swingup.csv"));
}
END_TEST

/* --- following it -----------------------------------------------------------------------------
 */

static struct trial trial_of(int rig, uint64_t seed)
{
    struct trial_spread spread;
    struct mk_model nominal;
    struct mk_error err = MK_ERROR_INIT;
    struct trial t;
    const struct mk_ctrl_ops *setup = mk_ctrl_setup_by_name(rigs[rig].setup);
    trial_spread_default(&spread);
    spread.swingup = file_of(rig);
    struct mk_swingup *s = load(rig);
    nominal = s->model;
    mk_swingup_free(s);
    enum mk_status st = trial_run(setup, &nominal, &spread, seed, &t, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    return t;
}

START_TEST(the_nominal_rig_is_caught_within_one_and_a_half_times_the_optimum)
{
    struct trial t = trial_of(_i, 0);
    struct mk_swingup *s = load(_i);
    ck_assert_msg(t.end == TRIAL_HELD, "%s %s", trial_end_name(t.end), t.fault);
    ck_assert_double_le(t.caught_s, rigs[_i].caught_within);
    ck_assert_double_le(t.caught_s, 1.5 * s->optimum_s);
    ck_assert_int_eq(t.falls, 0);
    mk_swingup_free(s);
}
END_TEST

START_TEST(rigs_off_the_model_are_caught_and_held)
{
    int held = 0;
    for (uint64_t seed = 1; seed <= 8; seed++) {
        struct trial t = trial_of(_i, seed);
        held += t.end == TRIAL_HELD;
        ck_assert_double_le(t.u_peak, t.rig.u_max);
        ck_assert_msg(t.end != TRIAL_FAULT, "seed %d: %s", (int)seed, t.fault);
    }
    ck_assert_int_ge(held, 7);
}
END_TEST

START_TEST(thrown_off_it_swings_up_by_energy)
{
    struct closed c;
    struct mk_error err = MK_ERROR_INIT;
    /* From another state: the same commands as without a trajectory, from the first tick on. */
    closed_open(&c, rigs[_i].setup, NULL);
    struct closed plain;
    closed_open(&plain, rigs[_i].setup, NULL);
    ck_assert_int_eq(mk_ctrl_load_swingup(c.ctrl, file_of(_i), &err), MK_OK);
    mk_ctrl_reset(c.ctrl);
    const double *rest = mk_plant(c.rig.plant)->rest;
    int free = 1 - mk_plant(c.rig.plant)->motor_joint;
    double q[2] = {rest[0], rest[1]};
    q[free] += 2.0;
    closed_put(&c, q[0], q[1], 0.0, 0.0);
    closed_put(&plain, q[0], q[1], 0.0, 0.0);
    for (int k = 0; k < 200; k++) {
        closed_tick(&c);
        closed_tick(&plain);
        ck_assert_double_eq(c.out.u, plain.out.u);
    }
    closed_close(&c);
    closed_close(&plain);

    /* Held up on its way, so that it loses the trajectory: still caught. */
    closed_open(&c, rigs[_i].setup, NULL);
    ck_assert_int_eq(mk_ctrl_load_swingup(c.ctrl, file_of(_i), &err), MK_OK);
    mk_ctrl_reset(c.ctrl);
    closed_run(&c, 0.3);
    closed_put(&c, rest[0], rest[1], 0.0, 0.0);
    double caught = closed_until(&c, MK_PHASE_BALANCE, 14.0);
    ck_assert_double_lt(caught, 14.0);
    closed_close(&c);
}
END_TEST

START_TEST(a_tick_along_the_trajectory_allocates_nothing)
{
    struct closed c;
    struct mk_error err = MK_ERROR_INIT;
    closed_open(&c, "pendubot-mid", NULL);
    ck_assert_int_eq(mk_ctrl_load_swingup(c.ctrl, file_of(0), &err), MK_OK);
    mk_ctrl_reset(c.ctrl);
    for (int k = 0; k < 200; k++) {
        closed_tick(&c);
        struct mk_ctrl_output out;
        struct mk_ctrl_input in = c.in;
        unsigned long before = heap_allocations();
        mk_ctrl_step(c.ctrl, &in, &out);
        ck_assert_uint_eq(heap_allocations(), before);
        ck_assert_int_eq(out.phase, MK_PHASE_SWINGUP);
    }
    closed_close(&c);
}
END_TEST

Suite *suite_trajectory(void)
{
    Suite *s = suite_create("trajectory");
    TCase *t = tcase_create("trajectory");
    tcase_set_timeout(t, 240);
    tcase_add_loop_test(t, sundials_integrates_the_commands_to_the_equilibrium, 0, RIGS);
    tcase_add_test(t, what_has_no_swing_up_is_refused);
    suite_add_tcase(s, t);

    t = tcase_create("file");
    tcase_set_timeout(t, 60);
    tcase_add_test(t, a_written_trajectory_reads_back_equal);
    tcase_add_test(t, a_file_that_does_not_fit_is_told_with_its_line);
    tcase_add_test(t, another_rig_equilibrium_parameter_or_rate_is_refused_with_file_and_line);
    suite_add_tcase(s, t);

    t = tcase_create("following");
    tcase_set_timeout(t, 120);
    tcase_add_loop_test(t, the_nominal_rig_is_caught_within_one_and_a_half_times_the_optimum, 0,
                        RIGS);
    tcase_add_loop_test(t, thrown_off_it_swings_up_by_energy, 0, ROBUST);
    tcase_add_test(t, a_tick_along_the_trajectory_allocates_nothing);
    suite_add_tcase(s, t);

    t = tcase_create("figures");
    tcase_set_timeout(t, 240);
    tcase_set_tags(t, "long");
    tcase_add_test(t, the_search_finds_a_swing_up_that_holds_and_is_as_short_as_is_known);
    tcase_add_loop_test(t, rigs_off_the_model_are_caught_and_held, 0, ROBUST);
    suite_add_tcase(s, t);
    return s;
}
