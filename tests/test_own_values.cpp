// Parameters with a value of their own in every log: found log by log and as a spread, by fits and
// by predictions of a new log; logs are those of an independent simulator.
#include "suites.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <vector>

#include "mechkit/explain.h"
#include "mechkit/ident.h"
#include "mechkit/sim.h"
#include "support/cases.hpp"

namespace
{

constexpr double ZERO[][2] = {
    {0.031, -0.012}, {-0.018, 0.004}, {0.006, 0.022}, {-0.044, -0.015}, {0.012, 0.001}};
constexpr int LOGS = 5;

mk_model pendubot()
{
    mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    return m;
}

truth::OwnedLog record(const double *zero, uint64_t seed, double friction = 0.0,
                       double seconds = 6.0)
{
    truth::Rig rig;
    truth::Recording how;
    const mk_model m = pendubot();
    rig.kind = "pendubot";
    rig.p.assign(m.parameter, m.parameter + 7);
    for (int j = 1; j <= 2; j++)
        rig.effects.push_back({"encoder-offset", j, {{"offset", zero[j - 1]}}});
    if (friction > 0.0)
        rig.effects.push_back({"coulomb", 2, {{"level", friction}}});
    how.seconds = seconds;
    how.input = seed % 2 ? "multisine" : "chirp";
    how.seed = seed;
    return truth::as_log(truth::record(rig, how), rig, how);
}

// With free zeros in every log, or one for all.
mk_model with_zeros(double spread)
{
    mk_model m = pendubot();
    for (int i = 0; i < 7; i++)
        m.parameter[i] *= i % 2 ? 1.05 : 0.96;
    for (int j = 1; j <= 2; j++) {
        ck_assert_int_eq(mk_model_add_effect(&m, "encoder-offset", j, nullptr), MK_OK);
        mk_effect_use &use = m.effect[m.effect_count - 1];
        use.value[0] = 0.0;
        use.spread[0] = spread;
    }
    return m;
}

std::unique_ptr<mk_ident_result> fitted(const mk_model &m, const std::vector<truth::OwnedLog> &logs)
{
    auto r = std::make_unique<mk_ident_result>();
    std::vector<const mk_log *> view;
    mk_error err = MK_ERROR_INIT;
    for (const truth::OwnedLog &log : logs)
        view.push_back(log.get());
    ck_assert_msg(mk_identify(&m, view.data(), view.size(), nullptr, r.get(), &err) == MK_OK, "%s",
                  err.message);
    return r;
}

START_TEST(a_fit_finds_the_zero_of_every_log_and_how_they_spread)
{
    std::vector<truth::OwnedLog> logs;
    for (int i = 0; i < LOGS; i++)
        logs.push_back(record(ZERO[i], 11 + (uint64_t)i));
    const auto r = fitted(with_zeros(0.03), logs);
    ck_assert_int_eq(r->own_count, 2 * LOGS);
    double squares = 0.0, mean = 0.0;
    for (int i = 0; i < r->own_count; i++) {
        const mk_own_value &own = r->own[i];
        const int joint = own.parameter - 7;
        const double zero = ZERO[own.log][joint];
        ck_assert_msg(std::fabs(own.value - zero) < 4.0 * own.std_error + 5e-5,
                      "log %zu joint %d: %g for %g", own.log, joint + 1, own.value, zero);
        ck_assert_double_lt(own.std_error, 5e-4);
        if (joint == 0)
            mean += zero / LOGS;
    }
    for (const double *zero : ZERO)
        squares += std::pow(zero[0] - mean, 2) / (LOGS - 1);
    ck_assert_double_eq_tol(r->model.effect[0].spread[0], std::sqrt(squares), 1e-3);
    // What the values of one log are does not say where the mean of all logs is.
    ck_assert_double_gt(r->parameter[7].std_error, 0.3 * std::sqrt(squares / LOGS));
    const mk_model right = pendubot();
    for (int i = 0; i < 7; i++)
        ck_assert_msg(std::fabs(r->parameter[i].value / right.parameter[i] - 1.0) < 0.01,
                      "p%d = %g", i + 1, r->parameter[i].value);
    // One zero for all logs does not do.
    const auto one = fitted(with_zeros(0.0), logs);
    ck_assert_int_eq(one->own_count, 0);
    const auto follows = [](const mk_ident_result &fit) {
        for (int i = 0; i < fit.warning_count; i++)
            if (std::strstr(fit.warning[i], "follow"))
                return false;
        return true;
    };
    ck_assert(follows(*r) && !follows(*one));
}
END_TEST

START_TEST(logs_that_do_not_differ_are_left_without_a_spread)
{
    std::vector<truth::OwnedLog> logs;
    const double zero[2] = {0.01, -0.01};
    for (int i = 0; i < LOGS; i++)
        logs.push_back(record(zero, 21 + (uint64_t)i));
    const auto r = fitted(with_zeros(0.03), logs);
    for (int j = 0; j < 2; j++) {
        ck_assert_double_lt(r->model.effect[j].spread[0], 5e-4);
        ck_assert_double_eq_tol(r->model.effect[j].value[0], zero[j], 5e-4);
    }
}
END_TEST

START_TEST(a_new_logs_own_values_come_from_its_first_half)
{
    mk_model m = with_zeros(0.03);
    std::copy_n(pendubot().parameter, 7, m.parameter);
    mk_model plain = m;
    plain.effect_count = 0;
    const truth::OwnedLog log = record(ZERO[0], 31);
    mk_predict_options o = {};
    o.window_s = 0.5;
    o.second_half = true;
    mk_predict_figures own, without;
    mk_log *out = nullptr;
    ck_assert_int_eq(mk_predict(&m, log.get(), &o, &out, &own, nullptr, nullptr), MK_OK);
    mk_log_free(out);
    ck_assert_int_eq(mk_predict(&plain, log.get(), &o, &out, &without, nullptr, nullptr), MK_OK);
    mk_log_free(out);
    ck_assert_int_eq(own.own_count, 2);
    ck_assert_double_eq_tol(own.from_s, 3.0, 0.01);
    ck_assert_double_eq(own.from_s, without.from_s);
    for (int j = 0; j < 2; j++) {
        ck_assert_int_eq(own.own[j].effect, j);
        ck_assert_double_eq_tol(own.own[j].value, ZERO[0][j], 4.0 * own.own[j].std_error);
        ck_assert_double_lt(own.own[j].std_error, 1.5e-3);
        // The readings' own rounding is 0.45 mrad.
        ck_assert_double_lt(own.rms[j], 9e-4);
        ck_assert_double_gt(without.rms[j], 2.0 * own.rms[j]);
    }
    // What comes later cannot matter.
    for (size_t k = log->rows / 2 + 2; k < log->rows; k++)
        log->columns[1].data[k] += 0.05;
    mk_predict_figures again;
    ck_assert_int_eq(mk_predict(&m, log.get(), &o, &out, &again, nullptr, nullptr), MK_OK);
    mk_log_free(out);
    for (int j = 0; j < 2; j++)
        ck_assert_double_eq(own.own[j].value, again.own[j].value);
}
END_TEST

// What explain says of logs with these zeros on a rig whose joint 2 rubs, which its model lacks.
std::unique_ptr<mk_explanation> explained(const double (*zero)[2], double friction)
{
    std::vector<truth::OwnedLog> logs;
    std::vector<const mk_log *> view, held;
    for (int i = 0; i < LOGS; i++)
        logs.push_back(record(zero[i], 41 + (uint64_t)i, friction, 4.0));
    for (int i = 0; i + 1 < LOGS; i++)
        view.push_back(logs[(size_t)i].get());
    held.push_back(logs.back().get());
    auto e = std::make_unique<mk_explanation>();
    mk_model m = with_zeros(0.0);
    m.effect_count = 0;
    mk_error err = MK_ERROR_INIT;
    ck_assert_msg(
        mk_explain(&m, view.data(), view.size(), held.data(), 1, nullptr, e.get(), &err) == MK_OK,
        "%s", err.message);
    return e;
}

START_TEST(explain_tells_zeros_of_every_log_from_a_cause)
{
    const auto e = explained(ZERO, 0.02);
    ck_assert_int_eq(e->verdict, MK_VERDICT_EFFECT);
    ck_assert_int_eq(e->log_value_count, 2);
    ck_assert_int_eq(e->cause_count, 1);
    ck_assert_str_eq(e->cause[0].effect->name, "coulomb");
    ck_assert_int_eq(e->cause[0].joint, 2);
    ck_assert_int_eq(e->per_log_count, 2 * (LOGS - 1));
    for (int i = 0; i < e->per_log_count; i++)
        ck_assert_double_eq_tol(e->per_log[i].value,
                                ZERO[e->per_log[i].log][e->per_log[i].joint - 1], 1e-3);
    for (int j = 0; j < 2; j++) {
        ck_assert_str_eq(e->log_value[j].effect->name, "encoder-offset");
        ck_assert_double_gt(e->log_value[j].spread[0], 5e-3);
        ck_assert_double_lt(e->after[j], 0.5 * e->refitted[j]);
    }
    ck_assert(e->offered && mk_model_has_own_values(&e->extended));
}
END_TEST

START_TEST(explain_claims_no_zeros_where_logs_do_not_differ)
{
    const double same[LOGS][2] = {{0.0, 0.0}, {0.0, 0.0}, {0.0, 0.0}, {0.0, 0.0}, {0.0, 0.0}};
    const auto with_friction = explained(same, 0.02), clean = explained(same, 0.0);
    ck_assert_int_eq(with_friction->log_value_count, 0);
    ck_assert_int_eq(with_friction->verdict, MK_VERDICT_EFFECT);
    ck_assert_int_eq(clean->log_value_count, 0);
    ck_assert_int_eq(clean->verdict, MK_VERDICT_PARAMETERS);
}
END_TEST

// A wheel whose amplifier has this much more gain than its model in each log; the last is held out.
std::unique_ptr<mk_explanation> explained_wheel(const std::vector<double> &gain)
{
    std::vector<truth::OwnedLog> logs;
    std::vector<const mk_log *> view;
    mk_model m;
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &m);
    for (size_t i = 0; i < gain.size(); i++) {
        truth::Rig rig;
        truth::Recording how;
        rig.kind = "inertia-wheel";
        rig.p.assign(m.parameter, m.parameter + mk_plant(m.plant)->parameter_count);
        rig.effects.push_back({"torque-scale", 0, {{"ratio", gain[i]}}});
        how.seconds = 6.0;
        how.input = i % 2 ? "multisine" : "chirp";
        how.seed = 51 + i;
        logs.push_back(truth::as_log(truth::record(rig, how), rig, how));
    }
    for (size_t i = 0; i + 1 < gain.size(); i++)
        view.push_back(logs[i].get());
    const mk_log *held = logs.back().get();
    auto e = std::make_unique<mk_explanation>();
    mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_explain(&m, view.data(), view.size(), &held, 1, nullptr, e.get(), &err) ==
                      MK_OK,
                  "%s", err.message);
    return e;
}

// The parameters of a wheel in units of the command scale with the gain, so that its mean is open.
START_TEST(explain_finds_a_gain_of_every_log_where_its_mean_is_another_unit_of_torque)
{
    const std::vector<double> gain = {0.0, -0.15, 0.0, -0.07};
    const auto e = explained_wheel(gain);
    ck_assert_int_eq(e->verdict, MK_VERDICT_EFFECT);
    ck_assert_int_eq(e->cause_count, 0);
    ck_assert_int_eq(e->log_value_count, 1);
    ck_assert_str_eq(e->log_value[0].effect->name, "torque-scale");
    ck_assert_int_eq(e->per_log_count, 3);
    for (int i = 0; i < 3; i++) {
        ck_assert(e->per_log[i].mean_open);
        ck_assert_double_lt(e->per_log[i].std_error, 0.02);
        const double ratio = (1.0 + e->per_log[i].value) / (1.0 + e->per_log[0].value);
        ck_assert_double_eq_tol(ratio, (1.0 + gain[e->per_log[i].log]) / (1.0 + gain[0]), 2e-3);
    }
    ck_assert_double_lt(e->after[0], 0.1 * e->refitted[0]);
    // One-step predictions are made with each log's own gain.
    ck_assert_double_lt(e->one_step_extended[0], 1.2);
}
END_TEST

START_TEST(explain_claims_no_gains_where_logs_do_not_differ)
{
    const auto e = explained_wheel({-0.1, -0.1, -0.1, -0.1});
    ck_assert_int_eq(e->log_value_count, 0);
    ck_assert_int_eq(e->verdict, MK_VERDICT_PARAMETERS);
}
END_TEST

} // namespace

Suite *suite_own_values(void)
{
    Suite *s = suite_create("own_values");
    TCase *t = tcase_create("logs");
    tcase_set_timeout(t, 120);
    tcase_add_test(t, a_new_logs_own_values_come_from_its_first_half);
    suite_add_tcase(s, t);
    t = tcase_create("fits and searches");
    tcase_set_tags(t, "long");
    tcase_set_timeout(t, 120);
    tcase_add_test(t, a_fit_finds_the_zero_of_every_log_and_how_they_spread);
    tcase_add_test(t, logs_that_do_not_differ_are_left_without_a_spread);
    tcase_add_test(t, explain_tells_zeros_of_every_log_from_a_cause);
    tcase_add_test(t, explain_claims_no_zeros_where_logs_do_not_differ);
    tcase_add_test(t, explain_finds_a_gain_of_every_log_where_its_mean_is_another_unit_of_torque);
    tcase_add_test(t, explain_claims_no_gains_where_logs_do_not_differ);
    suite_add_tcase(s, t);
    return s;
}
