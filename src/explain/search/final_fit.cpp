#include "explain/search/final_fit.hpp"

#include "ident/held_out.hpp"

namespace mk
{

FinalFit::FinalFit(const TrainingData &data, const std::vector<const FitLog *> &training,
                   const CauseSearch &causes, Search &searched)
    : refit(causes.refit), best(causes.best), views(training), sources(data.rows), used(&searched)
{
}

void FinalFit::fit_all(const TrainingData &data, const SearchOptions &usual, double window_s)
{
    const std::vector<FitLog> &all = data.whole.empty() ? data.logs : data.whole;
    std::vector<const FitLog *> whole;
    for (const FitLog &log : all)
        whole.push_back(&log);
    auto search = std::make_unique<Search>(whole, usual);
    const bool extended = best.point.model.effect_count > refit.point.model.effect_count;
    Hypothesis refit_again, best_again;
    if (!search->refit(refit.point.model, nullptr, refit_again) ||
        (extended && !search->refit(best.point.model, nullptr, best_again)))
        return;
    // The same data for both, so the same fit: else what one was spared would seem to be a gain.
    const std::vector<const mk_log *> &rows = data.whole.empty() ? data.rows : data.whole_rows;
    const HeldOut runs(rows, window_s, data.second_half, usual.threads);
    HeldOutFigures before, after;
    Hypothesis &last = extended ? best_again : refit_again;
    if (runs.figures(last.point.model, after, nullptr) != MK_OK ||
        (runs.figures(best.point.model, before, nullptr) == MK_OK &&
         before.total() < after.total()))
        return;
    refit = std::move(refit_again);
    best = extended ? std::move(best_again) : refit;
    views = std::move(whole);
    sources = rows;
    own = std::move(search);
}

void FinalFit::take_all(const TrainingData &data, const SearchOptions &usual)
{
    views.clear();
    for (const FitLog &log : data.whole)
        views.push_back(&log);
    sources = data.whole_rows;
    own = std::make_unique<Search>(views, usual);
}

// One by free runs, and the states that follow from it.
static bool fit_by_runs(const FreeRuns &runs, Search &search, const Hypothesis &from,
                        bool same_data, RunPoint &point, Hypothesis &out)
{
    constexpr int ITERATIONS = 10;
    point = runs.start(from.point.model);
    RunQuadraticModel quadratic;
    if (!runs.minimise(point, fitted_parameters(point.model), ITERATIONS, search.settings().threads,
                       quadratic))
        return false;
    Hypothesis fitted = from;
    if (!search.follow(point.model, same_data ? &from : nullptr, from.process_noise, fitted))
        return false;
    if (fitted.point.own.size() == point.own.size())
        fitted.point.own = point.own;
    judge_by_runs(runs, point, quadratic, fitted);
    out = std::move(fitted);
    return true;
}

void FinalFit::fit_runs(const TrainingData &data, const SearchOptions &usual, const FreeRuns &runs)
{
    decided = &runs;
    if (!data.whole.empty())
        take_all(data, usual);
    const bool extended = best.point.model.effect_count > refit.point.model.effect_count;
    Hypothesis refit_again, best_again;
    if (!fit_by_runs(runs, search(), refit, !own, run, refit_again) ||
        (extended && !fit_by_runs(runs, search(), best, !own, run, best_again)))
        return;
    refit = std::move(refit_again);
    best = extended ? std::move(best_again) : refit;
}

} // namespace mk
