// Causes by what predicts: chosen by logs left out, claimed by data that chose nothing, and no law
// more than the data tell. Data are those of an independent simulator.
#include "explain/search/causes.hpp"

#include "suites.h"

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "support/cases.hpp"

namespace
{

constexpr size_t LOGS = 4;
constexpr double WINDOW = 0.5; // s

// Friction of the base model does not make up for it, as it would for a drag.
const truth::Effect COGGING = {
    "cogging", 1, {{"amplitude", 0.05}, {"cycles", 4.0}, {"phase", 0.7}}};

using Effects = std::vector<truth::Effect>;

// Zeros of the encoder in the logs, rad.
constexpr double ZERO[LOGS] = {0.05, -0.04, 0.02, -0.06};

Effects with_zero(Effects effects, size_t log)
{
    effects.push_back({"encoder-offset", 1, {{"offset", ZERO[log]}}});
    return effects;
}

truth::OwnedLog record(const Effects &effects, uint64_t seed, const char *input = nullptr)
{
    return truth::usual_log(MK_PLANT_PENDULUM, effects, seed, input);
}

// Logs to learn from, with all that a search over them needs.
struct Learning {
    mk_model model;
    std::vector<truth::OwnedLog> logs;
    std::vector<std::vector<const mk_log *>> folds;
    std::vector<mk::FitLog> fit_logs;
    std::unique_ptr<mk::Search> search;
    std::unique_ptr<mk::FreeRuns> runs;
    std::unique_ptr<mk::PredictionSearch> found;

    explicit Learning(const Effects &effects, bool zeros_differ = false)
    {
        mk_model_default(MK_PLANT_PENDULUM, &model);
        for (size_t i = 0; i < LOGS; i++) {
            mk_record rows;
            logs.push_back(record(zeros_differ ? with_zero(effects, i) : effects, 61 + i));
            folds.push_back({logs.back().get()});
            ck_assert_int_eq(mk_record_from_log(logs.back().get(), &model, &rows, nullptr), MK_OK);
            fit_logs.push_back(mk::fit_log(rows, model, 0, rows.rows, (int)i));
        }
        std::vector<const mk::FitLog *> views;
        for (const mk::FitLog &log : fit_logs)
            views.push_back(&log);
        mk::SearchOptions options;
        options.given = &model;
        search = std::make_unique<mk::Search>(views, options);
        mk::Hypothesis refit;
        ck_assert(search->refit(model, nullptr, refit));
        runs = std::make_unique<mk::FreeRuns>(folds, model, WINDOW, options.threads);
        found = std::make_unique<mk::PredictionSearch>(*search, *runs, refit.point.model);
        ck_assert(found->run());
        found->decide();
    }
    bool names(const char *effect) const
    {
        return std::any_of(found->causes.begin(), found->causes.end(), [&](const mk::Carrier &c) {
            return c.cause.effect->name == std::string(effect);
        });
    }
    bool suspects(const char *effect) const
    {
        return std::any_of(found->suspects.begin(), found->suspects.end(), [&](const mk::Asked &a) {
            return a.cause.effect->name == std::string(effect);
        });
    }
    void claim(const std::vector<truth::Effect> &effects, const char *input = nullptr)
    {
        const truth::OwnedLog one = record(effects, 71, input), other = record(effects, 72, input);
        const std::vector<const mk_log *> held = {one.get(), other.get()};
        found->claim(mk::HeldOut(held, WINDOW, false, 2));
    }
};

// A log of a pendubot, and what a search over it alone needs.
struct OneLog {
    truth::OwnedLog log;
    mk_model model;
    mk_record rows;
    mk::FitLog fit_log;
    mk::SearchOptions options;

    explicit OneLog(const Effects &effects) : log(truth::usual_log(MK_PLANT_PENDUBOT, effects, 81))
    {
        mk_model_default(MK_PLANT_PENDUBOT, &model);
        ck_assert_int_eq(mk_record_from_log(log.get(), &model, &rows, nullptr), MK_OK);
        fit_log = mk::fit_log(rows, model, 0, rows.rows);
        options.given = &model;
    }
    OneLog(const OneLog &) = delete; // options point into it
    OneLog &operator=(const OneLog &) = delete;
};

} // namespace

START_TEST(what_held_out_data_confirm_is_claimed)
{
    Learning learning({COGGING});
    ck_assert(learning.names("cogging"));
    learning.claim({COGGING});
    ck_assert(learning.names("cogging"));
}
END_TEST

START_TEST(what_held_out_data_do_not_confirm_is_a_suspect_and_no_claim)
{
    Learning learning({COGGING});
    ck_assert(learning.names("cogging"));
    learning.claim({});
    ck_assert(!learning.names("cogging"));
    ck_assert(learning.suspects("cogging"));
}
END_TEST

START_TEST(held_out_data_in_which_a_limit_is_not_met_have_no_say_against_it)
{
    const Effects limit = {{"saturation", 0, {{"limit", 4.0}}}};
    Learning learning(limit);
    ck_assert(learning.names("saturation"));
    learning.claim(limit, "free");
    ck_assert(learning.names("saturation"));
}
END_TEST

START_TEST(a_law_of_friction_gives_way_to_the_one_that_is_likelier_beside_what_was_found_later)
{
    // As if Stribeck friction had been found before anybody knew of the cogging.
    const Learning learning({COGGING, {"quadratic-drag", 1, {{"coefficient", 2e-3}}}});
    const std::vector<mk::Candidate> coggings =
        learning.search->starts(learning.model, "cogging", 1);
    const auto cogging = std::find_if(coggings.begin(), coggings.end(), [](const mk::Candidate &c) {
        return c.value[mk_effect_parameter_index(c.effect, "cycles")] == COGGING.value.at("cycles");
    });
    ck_assert(cogging != coggings.end());
    const mk::Candidate wrong = learning.search->starts(learning.model, "stribeck", 1).front();
    mk_model with, both;
    ck_assert(mk::with_candidate(learning.model, wrong, with));
    ck_assert(mk::with_candidate(with, *cogging, both));
    mk::PredictionSearch begun(*learning.search, *learning.runs, learning.model);
    ck_assert(begun.take(both, both.effect, {{wrong}, {*cogging}}, 1));
    begun.decide();
    const auto named = [&](const char *effect) {
        return std::any_of(begun.causes.begin(), begun.causes.end(), [&](const mk::Carrier &c) {
            return c.cause.effect->name == std::string(effect);
        });
    };
    ck_assert(named("cogging"));
    ck_assert(named("quadratic-drag"));
    ck_assert(!named("stribeck"));
}
END_TEST

START_TEST(where_the_model_predicts_to_its_noise_nothing_is_chosen)
{
    const Learning learning({});
    ck_assert(learning.found->causes.empty());
}
END_TEST

// The same causes beside zeros of the logs' own, and what these say then.
static mk::Carried zeros_beside_causes(const Learning &learning, double &gain)
{
    mk_model own = learning.found->refitted().point.model;
    ck_assert_int_eq(mk_model_add_effect(&own, "encoder-offset", 1, nullptr), MK_OK);
    own.effect[own.effect_count - 1].spread[0] = 0.02;
    mk::PredictionSearch beside(*learning.search, *learning.runs, own);
    ck_assert(beside.take(*learning.found));
    ck_assert_uint_eq(beside.causes.size(), learning.found->causes.size());
    return beside.against(*learning.found, gain);
}

START_TEST(zeros_that_differ_are_missed_beside_causes_that_were_found_first)
{
    const Learning learning({COGGING}, true);
    ck_assert_uint_ge(learning.found->causes.size(), 1);
    double gain;
    const mk::Carried zeros = zeros_beside_causes(learning, gain);
    ck_assert_msg(mk::carry_over::enough(zeros, 1, gain), "mean %g +- %g, gain %g", zeros.mean,
                  zeros.error, gain);
}
END_TEST

START_TEST(zeros_that_are_the_same_are_not)
{
    const Learning learning({COGGING});
    ck_assert_uint_ge(learning.found->causes.size(), 1);
    double gain;
    ck_assert(!mk::carry_over::enough(zeros_beside_causes(learning, gain), 1, gain));
}
END_TEST

// A caller who stops the search.
START_TEST(a_search_that_is_stopped_finds_nothing)
{
    Learning learning({COGGING});
    learning.search->cancelled = true;
    mk::PredictionSearch again(*learning.search, *learning.runs,
                               learning.found->refitted().point.model);
    ck_assert(!again.run());
    ck_assert(again.causes.empty());
}
END_TEST

// What a fit of the logs says of the size of an effect, over its value.
static double error_of(const char *effect, const Effects &effects)
{
    const Learning learning(effects);
    const mk::Candidate start = learning.search->starts(learning.model, effect, 1).front();
    mk_model with;
    ck_assert(mk::with_candidate(learning.model, start, with));
    mk::RunFit fit;
    fit.point = learning.runs->start(with);
    ck_assert(learning.runs->converge(fit.point, mk::fitted_parameters(with), 2, fit.quadratic));
    mk::Hypothesis said;
    said.point.model = fit.point.model;
    learning.found->judge(fit, said);
    return mk::Search::relative_error(said, 0, start.size);
}

START_TEST(the_size_of_what_is_not_there_is_open)
{
    ck_assert_double_lt(error_of("cogging", {COGGING}), 0.1);
    ck_assert_double_gt(error_of("cogging", {}), 1.0);
}
END_TEST

START_TEST(an_imbalance_is_there_for_sure_though_gravity_can_be_any_part_of_it)
{
    const truth::Effect imbalance = {"imbalance", 1, {{"moment", 0.2}, {"phase", 1.2}}};
    ck_assert_double_lt(error_of("imbalance", {imbalance}), 0.1);
}
END_TEST

START_TEST(a_model_that_stays_far_behind_another_is_no_rival_of_it)
{
    constexpr double FEW_PASSES = 50.0; // over the data; to its end it takes twice as many
    const OneLog one({{"cogging", 1, {{"amplitude", 0.5}, {"cycles", 4.0}, {"phase", 0.7}}}});
    const auto cogs = [](const mk::Candidate &c) { return c.value[1] == 4.0; };
    mk::Search search({&one.fit_log}, one.options);
    mk::Hypothesis with, h;
    const std::vector<mk::Candidate> starts = search.starts(one.model, "cogging", 1);
    mk_model right, more;
    ck_assert(
        mk::with_candidate(one.model, *std::find_if(starts.begin(), starts.end(), cogs), right));
    ck_assert(search.refit(right, nullptr, with));
    // What differs by little is one.
    ck_assert(
        mk::with_candidate(with.point.model, search.starts(right, "viscous", 2).front(), more));
    ck_assert(search.refit_at(more, with, with.process_noise, h));
    const double before = search.work_done();
    ck_assert(!search.refit_at(one.model, with, with.process_noise, h));
    ck_assert_double_lt(search.work_done() - before, FEW_PASSES);
    // With as much process noise as it takes it is a fit like any other.
    ck_assert(search.refit_at(one.model, with, 1.0, h));
}
END_TEST

START_TEST(a_law_whose_shape_the_data_leave_open_gives_way_to_a_simpler_one)
{
    // Where a joint never comes near the speed from which Stribeck friction falls, it is dry
    // friction.
    const OneLog one({{"coulomb", 2, {{"level", 0.003}}}});
    const mk_model &m = one.model;
    mk::Search search({&one.fit_log}, one.options);
    mk::Hypothesis refit, with;
    ck_assert(search.refit(m, nullptr, refit));
    with.added = search.starts(m, "stribeck", 2).front();
    with.added.value[mk_effect_parameter_index(with.added.effect, "velocity")] = 1e6;
    mk_model more;
    ck_assert(mk::with_candidate(m, with.added, more));
    ck_assert(search.refit(more, nullptr, with));
    mk::CauseSearch causes(m, search, refit);
    // As it is found, and as a rival of another cause that takes its place.
    mk::Hypothesis other = with;
    other.added = search.starts(m, "viscous", 2).front();
    for (const bool rival : {false, true}) {
        causes.best = rival ? other : with;
        causes.rounds.clear();
        causes.rounds.push_back({{causes.best, with}, {}});
        if (rival)
            causes.let_lead(1);
        else
            causes.simplify();
        ck_assert_str_eq(causes.rounds[0].ranked[0].added.effect->name, "coulomb");
    }
    ck_assert_double_lt(causes.best.penalised_nlml, with.penalised_nlml);
    ck_assert_double_eq_tol(causes.best.point.model.effect[0].value[0], 0.003, 3e-4);
}
END_TEST

// Likelihood goes on from a cause that predictions found, and finds nothing more: what came next
// there is fitted in its place before the two are compared.
START_TEST(a_runner_up_of_predictions_leads_only_where_it_is_likelier)
{
    Learning learning({COGGING});
    ck_assert_uint_eq(learning.found->causes.size(), 1);
    const mk_model &all = learning.found->extended().point.model;
    mk::PredictionSearch kept(*learning.search, *learning.runs, learning.model);
    const mk::Candidate rival =
        learning.search->starts(learning.model, "viscous-asymmetry", 1).front();
    ck_assert(kept.take(all, all.effect, {{learning.found->causes[0].cause, rival}}, 1));
    mk::Hypothesis refit;
    ck_assert(learning.search->refit(learning.model, nullptr, refit));
    mk::CauseSearch causes(learning.model, *learning.search, refit);
    ck_assert(causes.go_on(kept));
    causes.polish_rivals();
    ck_assert_uint_eq(causes.rounds.size(), 1);
    const std::vector<mk::Hypothesis> &ranked = causes.rounds[0].ranked;
    ck_assert_str_eq(ranked[0].added.effect->name, "cogging");
    ck_assert_double_eq(ranked[0].penalised_nlml, causes.best.penalised_nlml);
    for (size_t i = 1; i < ranked.size(); i++)
        ck_assert_double_gt(ranked[i].penalised_nlml, ranked[0].penalised_nlml);
}
END_TEST

START_TEST(where_a_search_starts_follows_from_its_data_before_any_fit)
{
    const OneLog one({});
    const mk_model &m = one.model;
    mk::Search fresh({&one.fit_log}, one.options), used({&one.fit_log}, one.options);
    mk::Hypothesis refit;
    ck_assert(used.refit(m, nullptr, refit));
    const std::vector<mk::Candidate> some = fresh.candidates_of(m), same = used.candidates_of(m);
    ck_assert_uint_gt(some.size(), 50);
    ck_assert_uint_eq(some.size(), same.size());
    for (size_t i = 0; i < some.size(); i++)
        for (int k = 0; k < some[i].effect->parameter_count; k++)
            ck_assert_double_eq(some[i].value[k], same[i].value[k]);
}
END_TEST

Suite *suite_predictions(void)
{
    Suite *s = suite_create("predictions");
    TCase *t = tcase_create("claims");
    tcase_set_timeout(t, 120);
    tcase_add_test(t, what_held_out_data_confirm_is_claimed);
    tcase_add_test(t, what_held_out_data_do_not_confirm_is_a_suspect_and_no_claim);
    tcase_add_test(t, held_out_data_in_which_a_limit_is_not_met_have_no_say_against_it);
    tcase_add_test(
        t, a_law_of_friction_gives_way_to_the_one_that_is_likelier_beside_what_was_found_later);
    tcase_add_test(t, an_imbalance_is_there_for_sure_though_gravity_can_be_any_part_of_it);
    tcase_add_test(t, where_the_model_predicts_to_its_noise_nothing_is_chosen);
    tcase_add_test(t, zeros_that_differ_are_missed_beside_causes_that_were_found_first);
    tcase_add_test(t, zeros_that_are_the_same_are_not);
    tcase_add_test(t, a_search_that_is_stopped_finds_nothing);
    tcase_add_test(t, the_size_of_what_is_not_there_is_open);
    tcase_add_test(t, a_model_that_stays_far_behind_another_is_no_rival_of_it);
    tcase_add_test(t, a_law_whose_shape_the_data_leave_open_gives_way_to_a_simpler_one);
    tcase_add_test(t, a_runner_up_of_predictions_leads_only_where_it_is_likelier);
    tcase_add_test(t, where_a_search_starts_follows_from_its_data_before_any_fit);
    suite_add_tcase(s, t);
    return s;
}
