#include "explain/search/first_fit.hpp"

#include <algorithm>
#include <cmath>

#include "explain/policy.hpp"
#include "explain/search/causes.hpp"
#include "explain/search/prediction_search.hpp"
#include "explain/search/sharpness.hpp"
#include "ident/first_values.hpp"
#include "ident/scale.hpp"

namespace mk
{

FirstFit::FirstFit(const mk_model &asked_in, mk_model &model_in, mk_model &start_in,
                   const std::vector<const FitLog *> &training_in,
                   const mk_explain_options &options_in, SearchOptions &usual_in)
    : asked(asked_in), model(model_in), start(start_in), training(training_in), options(options_in),
      usual(usual_in)
{
}

bool FirstFit::any_unknown() const
{
    return std::any_of(std::begin(options.unknown), std::end(options.unknown),
                       [](bool unknown) { return unknown; });
}

// Values that the data had to tell agree with a fit to the same data, whatever it is. Friction may
// be unknown where masses are not.
bool FirstFit::starts_as_given() const
{
    const mk_plant_info &plant = *mk_plant(model.plant);
    for (int i = 0; i < plant.parameter_count; i++) {
        const bool mass = i < plant.mass_count;
        if (options.unknown[i] ? mass : start.parameter[i] != asked.parameter[i])
            return false;
    }
    return true;
}

// The given model, or one that follows the data where that is orders of magnitude off or unknown.
mk_model FirstFit::start_values(const std::vector<const mk_log *> &logs) const
{
    IdentProblem problem = {};
    problem.model = model;
    std::copy(std::begin(options.unknown), std::end(options.unknown), problem.options.unknown);
    if (model.no_motor)
        problem.options.fixed[scale_holder(model, nullptr)] = true;
    for (const mk_log *log : logs) {
        mk_record record;
        if (mk_record_from_log(log, &model, &record, nullptr) != MK_OK)
            return model;
        problem.logs.push_back(log);
        problem.records.push_back(record);
    }
    for (const FitLog *log : training)
        for (int j = 0; j < log->joints; j++)
            problem.moves[j] = problem.moves[j] || log->v_max[j] > 0.0;
    FitOptions fit;
    fit.threads = options.threads;
    return first_values(problem, training, fit, BETTER_PRIOR).front();
}

std::unique_ptr<Search> FirstFit::run(const std::vector<const mk_log *> &logs)
{
    usual.interval = SearchOptions().interval;
    return fit_closer(fit(logs));
}

// An effect alone can leave the given values far from the data and those of a linear method near,
// and yet make the given ones the better place to search from.
std::unique_ptr<Search> FirstFit::fit(const std::vector<const mk_log *> &logs)
{
    const bool known = !any_unknown();
    const mk_model other = start_values(logs);
    if (!known)
        model = other;
    start = model;
    auto search = std::make_unique<Search>(training, usual);
    fitted = search->refit(start, nullptr, refit);
    const bool same = std::equal(std::begin(other.parameter), std::end(other.parameter),
                                 std::begin(model.parameter));
    if (!known || same || search->cancelled)
        return search;
    const mk_model given_start = start;
    Hypothesis again;
    start = other;
    auto second = std::make_unique<Search>(training, usual);
    if (second->refit(start, nullptr, again) &&
        (!fitted || again.penalised_nlml < refit.penalised_nlml - policy::ACCEPT_FIRST)) {
        refit = std::move(again);
        fitted = true;
        return second;
    }
    start = given_start;
    return search;
}

// What the model misses within a shooting interval has no other place to go than the noise of the
// readings. Where that comes out at policy::PASSES_FOR_NOISE times what the readings scatter by
// themselves, it hides all but the largest cause, and whatever bends within an interval, as a base
// that rocks, is a cause of it.
bool FirstFit::passes_for_noise() const
{
    for (int j = 0; j < mk_model_joints(&start); j++)
        if (refit.point.noise[j] > policy::PASSES_FOR_NOISE * least_scatter(training, j))
            return true;
    return false;
}

// In intervals half as long it is a quarter of that.
std::unique_ptr<Search> FirstFit::fit_closer(std::unique_ptr<Search> search)
{
    if (!fitted || search->cancelled || !passes_for_noise() || mk_model_hides_joint(&start))
        return search;
    const double longer = usual.interval;
    usual.interval = 0.5 * longer;
    auto closer = std::make_unique<Search>(training, usual);
    Hypothesis again;
    if (closer->refit(start, nullptr, again)) {
        refit = std::move(again);
        return closer;
    }
    usual.interval = longer;
    return search;
}

void FirstFit::adapt_sharpness(Search &search)
{
    Hypothesis adapted = refit;
    if (!fitted || search.complete(refit) ||
        !sharpness::adapt_and_refit(search, asked.friction_sharpness, adapted) ||
        !CauseSearch::likelihood_counts(adapted))
        return;
    start.friction_sharpness = adapted.point.model.friction_sharpness;
    refit = std::move(adapted);
}

bool FirstFit::keep_known_masses(Search &search, const Folds &folds, double window_s,
                                 MassRange &masses)
{
    const MassRange known(start, start);
    masses = {};
    if (!fitted || known.holds(refit.point.model) || !starts_as_given() || !folds.enough() ||
        CauseSearch::likelihood_counts(refit) || mk_model_hides_joint(&start))
        return false;
    masses = known;
    Hypothesis kept;
    const bool can = search.refit(start, nullptr, kept);
    FreeRuns runs(folds.by_fold(), start, window_s, options.threads, &masses);
    PredictionSearch within(search, runs, kept.point.model);
    const bool followed = can && within.start();
    masses = {};
    if (!followed)
        return false;
    PredictionSearch anywhere(search, runs, refit.point.model);
    double gain;
    if (anywhere.start() && carry_over::enough(anywhere.against(within, gain), 1, gain))
        return false;
    refit = std::move(kept);
    return true;
}

void FirstFit::agree_on_masses(Search &search, const Folds &folds, double window_s,
                               MassRange &masses) const
{
    masses = {};
    if (!starts_as_given())
        return;
    MassRange agreed(start, refit.point.model);
    if (folds.enough() && !CauseSearch::likelihood_counts(refit) && !mk_model_hides_joint(&start)) {
        FreeRuns runs(folds.by_fold(), start, window_s, options.threads);
        PredictionSearch anywhere(search, runs, refit.point.model);
        if (anywhere.start())
            agreed.include(anywhere.refitted().point.model);
    }
    masses = agreed;
}

} // namespace mk
