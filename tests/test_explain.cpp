// Effects hidden in data, which explain must find: verdicts, causes and shares of the gap. The data
// come from a simulator of their own (support/pendulum.hpp).
#include "explain/search/candidates.hpp"

#include "suites.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

#include "explain/evidence/verdict.hpp"
#include "explain/search/log_values.hpp"
#include "ident/held_out.hpp"
#include "mechkit/explain.h"
#include "support/pendulum.hpp"
extern "C" {
#include "support/files.h"
#include "support/program.h"
}

using namespace made_up;

// The least probability by chance of all tests of what a model leaves.
static double least_chance(const mk_explanation &e, bool extended)
{
    double p = 1.0;
    for (int i = 0; i < e.residual_test_count; i++) {
        const mk_residual_test &t = e.residual_test[i];
        p = std::fmin(p, extended ? t.p_after : t.p_before);
    }
    return p * e.residual_test_count;
}

// A free run from the catch of a double inverted pendulum grows from the smallest error at its
// start, in the training data as well as in held-out data.
START_TEST(upright_runs_of_the_exact_model_raise_no_doubt)
{
    static char out[16384];
    std::string folder = scratch("upright"), model = MK_SOURCE_DIR "/models/pendubot.ini";
    for (const char *hold : {"1", "2"}) {
        std::string text = "setup pendubot-top\nstart\nwait-until balanced within 15\nwait ";
        text = text + hold + "\nhalt\nsave t" + hold + ".csv\n";
        std::string script = scratch_text("upright.cmd", text.c_str());
        ck_assert_int_eq(run_mechkit(out, sizeof out, "run %s --fast --model %s --out %s",
                                     script.c_str(), model.c_str(), folder.c_str()),
                         0);
    }
    int code = run_mechkit(out, sizeof out,
                           "explain --model %s --out %s/report --holdout %s/t1.csv %s/t2.csv",
                           model.c_str(), folder.c_str(), folder.c_str(), folder.c_str());
    ck_assert_msg(code == 0 && strstr(out, "The model explains the data."), "%s", out);
    ck_assert_msg(!strstr(out, "far worse than they are read"), "%s", out);
}
END_TEST

START_TEST(one_step_predictions_of_a_right_model_leave_white_noise)
{
    mk_explanation right = explained({}, true);
    ck_assert_int_gt(right.residual_test_count, 0);
    ck_assert_double_gt(least_chance(right, true), 0.01);
    ck_assert_double_eq_tol(right.one_step_extended[0], 1.0, 0.05);
    Hidden h;
    h.drag = 0.05;
    mk_explanation e = explained(h);
    ck_assert_double_lt(least_chance(e, false), 1e-6);
    ck_assert_double_gt(e.one_step_refit[0], 2.0);
    ck_assert_double_gt(least_chance(e, true), 0.01);
    ck_assert_double_eq_tol(e.one_step_extended[0], 1.0, 0.05);
}
END_TEST

START_TEST(a_right_model_raises_no_alarm)
{
    mk_explanation e = explained({}, true);
    ck_assert_str_eq(mk_verdict_name(e.verdict), "none");
    ck_assert_int_eq(e.cause_count, 0);
}
END_TEST

START_TEST(wrong_values_are_told_from_missing_physics)
{
    mk_explanation e = explained({});
    ck_assert_str_eq(mk_verdict_name(e.verdict), "parameters");
    ck_assert_double_eq_tol(e.extended.parameter[0], J, 4.0 * e.std_error[0]);
    ck_assert_double_lt(e.after[0], 0.2 * e.before[0]);
}
END_TEST

// Quantiles of the chi-square distribution at 1 - 1e-4, from tables.
START_TEST(values_are_called_wrong_where_one_data_set_in_ten_thousand_would_say_so)
{
    static const struct {
        int parameters;
        double quantile;
    } row[] = {{1, 15.137}, {2, 18.421}, {5, 25.745}, {7, 29.878}, {10, 35.564}};
    for (const auto &r : row) {
        ck_assert(!mk::beyond_chance(0.0, r.parameters));
        ck_assert(!mk::beyond_chance(r.quantile - 0.02, r.parameters));
        ck_assert(mk::beyond_chance(r.quantile + 0.02, r.parameters));
    }
}
END_TEST

START_TEST(a_hidden_effect_is_named_and_measured)
{
    struct {
        const char *name;
        Hidden hidden;
        double value;
    } rows[] = {{"quadratic-drag", {}, 0.012},
                {"deadband", {}, 0.25},
                {"input-delay", {}, 0.0062},
                {"end-stop", {}, 0.6}};
    rows[0].hidden.drag = 0.012;
    rows[1].hidden.dead = 0.25;
    rows[2].hidden.delay = 0.0062;
    rows[3].hidden.bumper = true;
    mk_explanation e = explained(rows[_i].hidden);
    ck_assert_msg(e.verdict == MK_VERDICT_EFFECT, "%s: %s %s", rows[_i].name,
                  mk_verdict_name(e.verdict), e.structure);
    ck_assert_msg(named(e, rows[_i].name), "%s was called %s", rows[_i].name,
                  e.cause[0].effect->name);
    if (strcmp(e.cause[0].effect->name, rows[_i].name) == 0)
        ck_assert_double_eq_tol(e.cause[0].value[0], rows[_i].value, 0.05 * rows[_i].value);
    ck_assert_double_gt(e.closed, 0.9);
}
END_TEST

START_TEST(tilt_and_encoder_offset_are_declared_inseparable)
{
    Hidden h;
    h.tilt = 0.02;
    mk_explanation e = explained(h);
    ck_assert_int_eq(e.verdict, MK_VERDICT_EFFECT);
    ck_assert(named(e, "base-tilt"));
    ck_assert(named(e, "encoder-offset"));
}
END_TEST

START_TEST(a_cause_that_no_entry_names_is_unknown_and_gets_a_formula)
{
    Hidden h;
    h.cubic = 2e-3;
    mk_explanation e = explained(h);
    ck_assert_str_eq(mk_verdict_name(e.verdict), "unknown");
    ck_assert_msg(strstr(e.structure, "dq1^3") != nullptr, "%s", e.structure);
    ck_assert_double_gt(e.closed, 0.5);
}
END_TEST

START_TEST(shares_of_the_gap_add_up_to_what_is_closed)
{
    Hidden h;
    h.drag = 0.012;
    h.dead = 0.8;
    const mk_explanation e = explained(h);
    const mk_budget &b = e.budget;
    ck_assert_str_eq(mk_verdict_name(e.verdict), "effect");
    ck_assert_int_eq(b.item_count, 2);
    double sum = 0.0;
    for (int i = 0; i < b.item_count; i++) {
        ck_assert_double_le(b.item[i].low, b.item[i].share);
        ck_assert_double_ge(b.item[i].high, b.item[i].share);
        sum += b.item[i].share;
    }
    ck_assert_double_eq_tol(sum, b.closed, 1e-9);
    ck_assert_double_eq_tol(b.closed + b.rest, 1.0, 1e-9);
    ck_assert_double_gt(b.closed, 0.95);
    // The last line of the table is the extended model; what came before it is further off.
    ck_assert_double_eq_tol(b.item[1].rms[0], b.extended[0], 1e-9);
    ck_assert_double_gt(b.item[0].rms[0], 2.0 * b.extended[0]);
    ck_assert_int_eq(b.rest_joint, 0);
}
END_TEST

// What is left of a rig's causes is fitted to free runs before it is judged by them: with the
// values that it has beside the drag a dead zone alone is off by far more than the refitted model.
START_TEST(a_part_of_the_causes_is_judged_at_its_best)
{
    Hidden h;
    h.drag = 0.012;
    h.dead = 0.8;
    const mk_explanation e = explained(h);
    const mk_budget &b = e.budget;
    ck_assert_int_eq(b.item_count, 2);
    ck_assert_double_lt(b.item[0].rms[0], 1.5 * b.refit[0]);
}
END_TEST

// Squared error of free runs over the data that were learnt from.
static double training_error(const mk_explanation &e, const Hidden &h, const mk_model &model)
{
    mk_log *learnt = record(h, 0, 6.0);
    const std::vector<const mk_log *> logs = {learnt};
    mk::HeldOutFigures figures;
    ck_assert_int_eq(mk::HeldOut(logs, e.window_s, false, 2).figures(model, figures, nullptr),
                     MK_OK);
    mk_log_free(learnt);
    return figures.total();
}

// Else what a better fit closes would be counted as the causes'. Fitted by likelihood this rig's
// refitted model would gain 1.5 % of its squared error from 1 % less inertia alone.
START_TEST(no_step_of_the_refitted_model_takes_its_free_runs_nearer_to_the_data)
{
    Hidden h;
    h.dead = 0.5;
    h.delay = 0.008;
    const mk_explanation e = explained(h);
    ck_assert(e.offered);
    const double own = training_error(e, h, e.refit);
    for (int i = 0; i < mk_plant(e.refit.plant)->parameter_count; i++)
        for (const double factor : {0.97, 0.99, 1.01, 1.03}) {
            mk_model other = e.refit;
            other.parameter[i] *= factor;
            ck_assert_msg(training_error(e, h, other) > 0.995 * own, "%s by %g: %g, %g of it",
                          mk_plant(e.refit.plant)->parameter[i].name, factor,
                          training_error(e, h, other), training_error(e, h, other) / own);
        }
}
END_TEST

START_TEST(no_share_of_the_gap_is_negative_or_beyond_what_is_closed)
{
    Hidden h; // three that hang together so much that a part of them predicts worse than none
    h.tilt = 0.2;
    h.delay = 0.012;
    h.drag = 0.03;
    const mk_explanation e = explained(h);
    const mk_budget &b = e.budget;
    ck_assert_int_gt(b.item_count, 1);
    double sum = 0.0;
    for (int i = 0; i < b.item_count; i++) {
        ck_assert_double_ge(b.item[i].share, 0.0);
        ck_assert_double_le(b.item[i].share, b.closed + 1e-9);
        sum += b.item[i].share;
    }
    ck_assert_double_eq_tol(sum, b.closed, 1e-9);
}
END_TEST

// What is found of `named` causes that have a name and of v^3, which has none.
static mk_explanation found_beside_a_cube(const Hidden &h, mk_verdict verdict, int named)
{
    const mk_explanation e = explained(pendulum(false), record(h, 0, 9.0), record(h, 1, 5.0));
    ck_assert_msg(e.verdict == verdict && e.cause_count - e.piece_count == named, "%s: %s",
                  mk_verdict_name(e.verdict), e.structure);
    ck_assert_msg(std::strstr(e.structure, "dq1^3") != nullptr, "%s", e.structure);
    return e;
}

static void check_is_named(const mk_explanation &e, const char *name, double size)
{
    const mk_cause *c = std::find_if(e.cause, e.cause + e.cause_count, [&](const mk_cause &one) {
        return std::strcmp(one.effect->name, name) == 0;
    });
    ck_assert_msg(c != e.cause + e.cause_count && !c->piece, "%s", name);
    ck_assert_double_eq_tol(c->value[0], size, 0.05 * size);
}

START_TEST(a_named_cause_beside_one_without_a_name_is_a_part)
{
    Hidden h;
    h.dead = 0.4;
    h.cubic = 0.03;
    const mk_explanation e = found_beside_a_cube(h, MK_VERDICT_PARTIAL, 1);
    check_is_named(e, "deadband", h.dead);
    char name[160];
    for (int i = 0; i < e.budget.item_count; i++) {
        mk_budget_item_name(&e, &e.budget.item[i], name, sizeof name);
        ck_assert_ptr_nonnull(
            std::strstr(name, e.budget.item[i].cause == 0 ? "deadband" : "dq1^3"));
    }
}
END_TEST

// Drag that grows with v|v| and with v^3, on a rig with a dead zone: the first is there whatever
// stands for the second.
START_TEST(a_friction_keeps_its_name_beside_a_smaller_one_that_has_none)
{
    Hidden h;
    h.drag = 0.06;
    h.cubic = 3e-3;
    h.dead = 0.2;
    const mk_explanation e = found_beside_a_cube(h, MK_VERDICT_PARTIAL, 2);
    check_is_named(e, "quadratic-drag", h.drag);
    check_is_named(e, "deadband", h.dead);
}
END_TEST

// The same without the dead zone: one law that the catalogue lacks may be all there is.
START_TEST(a_friction_that_a_law_with_a_name_and_a_term_make_up_by_themselves_has_no_name)
{
    Hidden h;
    h.drag = 0.06;
    h.cubic = 3e-3;
    found_beside_a_cube(h, MK_VERDICT_UNKNOWN, 0);
}
END_TEST

START_TEST(only_what_is_put_up_by_hand_has_a_place_of_its_own_in_every_log)
{
    mk_model own, m = pendulum(true);
    ck_assert_int_eq(mk_model_add_effect(&m, "coulomb", 1, nullptr), MK_OK);
    ck_assert(!mk::with_own_place(m, own));
    ck_assert_int_eq(mk_model_add_effect(&m, "cable-stiffness", 1, nullptr), MK_OK);
    ck_assert(mk::with_own_place(m, own));
    const int rest = mk_effect_parameter_index(mk_effect_by_name("cable-stiffness"), "rest");
    ck_assert_double_gt(own.effect[1].spread[rest], 0.0);
    ck_assert_double_eq(own.effect[0].spread[0], 0.0);
}
END_TEST

START_TEST(one_law_has_one_name_at_every_joint)
{
    // Cogging once a revolution and an imbalance are the same torque at some joints.
    const auto plant = (enum mk_plant_kind)_i;
    mk_model bare;
    mk_model_default(plant, &bare);
    mk::DataRange range = {};
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        range.q_min[j] = -2.0, range.q_max[j] = 2.0, range.v_max[j] = 10.0;
    range.u_max = 1.0, range.seconds = 10.0, range.torque = 0.5;
    std::vector<mk::Candidate> waves, weights;
    for (const mk::Candidate &c : mk::candidates(bare, range)) {
        if (std::strcmp(c.effect->name, "cogging") == 0 && c.value[1] == 1.0)
            waves.push_back(c);
        if (std::strcmp(c.effect->name, "imbalance") == 0)
            weights.push_back(c);
    }
    ck_assert_uint_gt(weights.size(), 0);
    for (mk::Candidate wave : waves)
        for (mk::Candidate weight : weights) {
            if (wave.joint != weight.joint)
                continue;
            mk_model one, other;
            wave.value[0] = weight.value[0] = 0.1;
            wave.value[2] = -0.4, weight.value[1] = 0.4;
            ck_assert(mk::with_candidate(bare, wave, one));
            ck_assert(mk::with_candidate(bare, weight, other));
            double apart = 0.0;
            for (int k = 0; k < 5; k++) {
                const double x[4] = {0.3 + 0.5 * k, -0.7 * k, 1.0 - 0.3 * k, 0.2 * k}, u[2] = {0.1};
                double a[4], b[4];
                mk_model_rhs(&one, 0.0, x, u, a);
                mk_model_rhs(&other, 0.0, x, u, b);
                for (int i = 0; i < mk_model_state_count(&bare); i++)
                    apart = std::max(apart, std::fabs(a[i] - b[i]));
            }
            ck_assert_msg(apart > 1e-3, "%s at joint %d", mk_plant(plant)->name, wave.joint);
        }
}
END_TEST

// Values of the first two parameters of an effect are as in the catalogue's row.
static int detents_offered(const mk_model &rig, int joint, double least_cycles, double most_cycles,
                           bool two_motors = false)
{
    mk::DataRange range = {};
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        range.q_min[j] = -2.0, range.q_max[j] = 2.0, range.v_max[j] = 10.0;
    range.u_max = 1.0, range.seconds = 10.0, range.torque = 0.5;
    range.two_motors = two_motors;
    int count = 0;
    for (const mk::Candidate &c : mk::candidates(rig, range))
        count += std::strcmp(c.effect->name, "cogging") == 0 && c.joint == joint &&
                 c.value[1] >= least_cycles && c.value[1] <= most_cycles;
    return count;
}

// A torque that repeats with the angle comes from a motor's magnets, or from teeth.
START_TEST(a_detent_is_looked_for_where_a_motor_or_a_gear_can_be)
{
    mk_model rig;
    mk_model_default(MK_PLANT_FURUTA, &rig); // arm driven, pendulum free
    ck_assert_int_eq(detents_offered(rig, 1, 1.0, 1.0), 1);
    ck_assert_int_eq(detents_offered(rig, 2, 1.0, 1.0), 0);
    mk_model_default(MK_PLANT_PENDUBOT,
                     &rig); // joint 2 is free, in a plane that turns with joint 1
    ck_assert_int_eq(detents_offered(rig, 2, 1.0, 1.0), 0);
    ck_assert_int_gt(detents_offered(rig, 2, 2.0, 48.0), 20);
    ck_assert_int_eq(detents_offered(rig, 2, 1.0, 1.0, true), 1); // with its torque recorded
    mk_model_default(MK_PLANT_ACROBOT, &rig);                     // joint 2 is driven
    ck_assert_int_eq(detents_offered(rig, 2, 1.0, 1.0), 1);
    rig.no_motor = true; // as in a free swing, with the motor unpowered
    ck_assert_int_eq(detents_offered(rig, 2, 1.0, 1.0), 1);
}
END_TEST

// Two seconds never come near the speed from which Stribeck friction would fall, and the little
// that is held back of them is predicted a little better by whichever law was fitted last.
START_TEST(dry_friction_is_not_called_by_a_law_whose_shape_two_seconds_leave_open)
{
    static const struct {
        const char *rig, *level, *input;
    } cases[] = {{"pendubot", "0.02", "2*sin(4.4*t)+1.2*sin(6.9*t)"},
                 {"furuta", "0.03", "2*sin(4.4*t)+1.2*sin(6.9*t)"}};
    char said[16384], truth[512];
    const char *rig = cases[_i].rig;
    const std::string log = scratch("short.csv");
    run_command(nullptr, 0, "rm -f %s", log.c_str());
    char *textbook = slurp_file((std::string(MK_SOURCE_DIR "/models/") + rig + ".ini").c_str());
    const std::string hidden =
        std::string(textbook) + "\n[effect.coulomb]\njoint = 2\nlevel = " + cases[_i].level + "\n";
    free(textbook);
    std::snprintf(truth, sizeof truth, "%s", scratch_text("truth.ini", hidden.c_str()));
    const std::string run = std::string("setup open-loop\ninput ") + cases[_i].input +
                            "\nstart\nwait 1.9\nhalt\nsave " + log + "\n";
    const char *script = scratch_text("short.cmd", run.c_str());
    ck_assert_int_eq(run_mechkit(said, sizeof said, "run %s --model %s --fast", script, truth), 0);
    ck_assert_int_eq(run_mechkit(said, sizeof said, "explain --model %s/models/%s.ini --out %s %s",
                                 MK_SOURCE_DIR, rig, scratch("report"), log.c_str()),
                     0);
    ck_assert_msg(std::strstr(said, "\n  coulomb at joint 2: level 0.0"), "%s", said);
}
END_TEST

Suite *suite_explain(void)
{
    Suite *s = suite_create("explain");
    TCase *t = tcase_create("hidden effects");
    tcase_set_timeout(t, 120);
    tcase_add_test(t, a_right_model_raises_no_alarm);
    tcase_add_test(t, wrong_values_are_told_from_missing_physics);
    tcase_add_test(t, values_are_called_wrong_where_one_data_set_in_ten_thousand_would_say_so);
    tcase_add_test(t, a_cause_that_no_entry_names_is_unknown_and_gets_a_formula);
    tcase_add_test(t, only_what_is_put_up_by_hand_has_a_place_of_its_own_in_every_log);
    tcase_add_test(t, a_detent_is_looked_for_where_a_motor_or_a_gear_can_be);
    tcase_add_loop_test(t, one_law_has_one_name_at_every_joint, 0, MK_PLANT_COUNT);
    suite_add_tcase(s, t);

    t = tcase_create("more hidden effects");
    tcase_set_timeout(t, 120);
    tcase_set_tags(t, "long");
    tcase_add_test(t, upright_runs_of_the_exact_model_raise_no_doubt);
    tcase_add_test(t, one_step_predictions_of_a_right_model_leave_white_noise);
    tcase_add_test(t, tilt_and_encoder_offset_are_declared_inseparable);
    tcase_add_test(t, shares_of_the_gap_add_up_to_what_is_closed);
    tcase_add_test(t, a_part_of_the_causes_is_judged_at_its_best);
    tcase_add_test(t, no_step_of_the_refitted_model_takes_its_free_runs_nearer_to_the_data);
    tcase_add_test(t, no_share_of_the_gap_is_negative_or_beyond_what_is_closed);
    tcase_add_test(t, a_named_cause_beside_one_without_a_name_is_a_part);
    tcase_add_test(t, a_friction_keeps_its_name_beside_a_smaller_one_that_has_none);
    tcase_add_test(t,
                   a_friction_that_a_law_with_a_name_and_a_term_make_up_by_themselves_has_no_name);
    tcase_add_loop_test(t, a_hidden_effect_is_named_and_measured, 0, 4);
    tcase_add_loop_test(t, dry_friction_is_not_called_by_a_law_whose_shape_two_seconds_leave_open,
                        0, 2);
    suite_add_tcase(s, t);
    return s;
}
