// Models fitted to the free runs of the training data.
//
// What explain says of a gap is measured in free runs, and likelihood fits a model that lacks much
// to each next reading: its free runs may end further off than they must. What is compared there
// is fitted there, so that no cause is credited with what a better fit would have closed.
#ifndef MECHKIT_EXPLAIN_EVIDENCE_TRAINING_RUNS_HPP
#define MECHKIT_EXPLAIN_EVIDENCE_TRAINING_RUNS_HPP

#include <memory>

#include "explain/search/final_fit.hpp"
#include "explain/training.hpp"

namespace mk
{

class TrainingRuns
{
  public:
    // `out` has the verdict's models. All must outlive it.
    TrainingRuns(const TrainingData &data, const FinalFit &last, const mk_explanation &out);
    // out.refit, with values from free runs. As it is where the last fit was by free runs and it is
    // the refitted model of that.
    mk_model refit();
    // A part of out.extended, fitted again; `given_column`: driven as the given model says. Start
    // states and own values are taken over from the extended model's runs, parameters begin at its
    // values. A fit that fails leaves the parameters as they were.
    mk_model part(const mk_model &model, bool given_column);

  private:
    const TrainingData &data;
    const FinalFit &last;
    const mk_explanation &out;
    // Free runs, and the extended model in them.
    struct Runs {
        std::unique_ptr<FreeRuns> made;
        const FreeRuns *runs = nullptr;
        RunPoint extended;
        double window_s = 0.0;
    };
    Runs made[2]; // by whether the given column drives them

    int threads() const { return last.search().settings().threads; }
    const Runs &runs_of(bool given_column);
};

} // namespace mk
#endif
