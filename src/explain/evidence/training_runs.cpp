// Models fitted to the free runs of the training data (explain/evidence/training_runs.hpp).
#include "explain/evidence/training_runs.hpp"

#include <algorithm>
#include <iterator>

namespace mk
{

TrainingRuns::TrainingRuns(const TrainingData &data_in, const FinalFit &last_in,
                           const mk_explanation &out_in)
    : data(data_in), last(last_in), out(out_in)
{
}

// The training data as the given model's column of the command drives them, or the extended
// one's. What errors are usual there are those of the refitted model.
// Made once for each column. Where the last fit was by free runs, its own runs are used.
const TrainingRuns::Runs &TrainingRuns::runs_of(bool given_column)
{
    Runs &over = made[given_column];
    if (over.runs && over.window_s == out.window_s)
        return over;
    over.window_s = out.window_s;
    if (last.runs() && !given_column) {
        over.runs = last.runs();
        over.extended = last.extended_run();
        return over;
    }
    mk_model model = out.extended, refit = out.refit;
    if (given_column)
        model.input = out.given.input;
    refit.input = model.input;
    over.made = std::make_unique<FreeRuns>(data.rows_by_log(), model, out.window_s, threads());
    RunPoint at = over.made->start(refit);
    over.made->take_scale(at);
    over.extended = over.made->start(model);
    over.runs = over.made.get();
    return over;
}

mk_model TrainingRuns::refit()
{
    constexpr int ITERATIONS = 10;
    const mk_model &fitted = last.refit.point.model;
    if (last.runs() && out.refit.input == fitted.input &&
        std::equal(std::begin(fitted.parameter), std::end(fitted.parameter), out.refit.parameter))
        return out.refit;
    const FreeRuns &runs = *runs_of(out.input.changed).runs;
    RunPoint point = runs.start(out.refit);
    RunQuadraticModel quadratic;
    return runs.minimise(point, fitted_parameters(out.refit), ITERATIONS, threads(), quadratic)
               ? point.model
               : out.refit;
}

mk_model TrainingRuns::part(const mk_model &model, bool given_column)
{
    // A further one moves what is closed by less than a hundredth; intervals are ten times as
    // wide.
    constexpr int ITERATIONS = 4;
    const Runs &over = runs_of(given_column);
    RunPoint point = over.runs->adopt(over.extended, model, threads());
    RunQuadraticModel quadratic;
    return over.runs->minimise(point, fitted_parameters(model), ITERATIONS, threads(), quadratic)
               ? point.model
               : model;
}

} // namespace mk
