// The last fit: what was found, fitted to all data.
//
// Causes are searched for in windows of long logs, and where a model does not follow its data in
// shooting intervals of it so short that little can be missed within each. That tells causes apart.
// How far free runs end from the readings depends on the parameters, and these are best known from
// all data, in shooting intervals in which what the model says adds up to something.
#ifndef MECHKIT_EXPLAIN_SEARCH_FINAL_FIT_HPP
#define MECHKIT_EXPLAIN_SEARCH_FINAL_FIT_HPP

#include <memory>
#include <vector>

#include "explain/search/causes.hpp"
#include "explain/training.hpp"

namespace mk
{

class FinalFit
{
  public:
    // As the search has left it. All must outlive it.
    FinalFit(const TrainingData &data, const std::vector<const FitLog *> &training,
             const CauseSearch &causes, Search &searched);
    // Fits both models again, unless free runs over the training data then end further from the
    // readings. `usual`: with the shooting interval of a usual search.
    void fit_all(const TrainingData &data, const SearchOptions &usual, double window_s);

    // The same where free runs have decided: over all data, and parameters from them.
    void fit_runs(const TrainingData &data, const SearchOptions &usual, const FreeRuns &runs);
    // Which runs these were; NULL: none.
    const FreeRuns *runs() const { return decided; }
    // The extended model in them.
    const RunPoint &extended_run() const { return run; }

    const std::vector<const FitLog *> &logs() const { return views; }
    // The rows that each of them has, as they were read.
    const std::vector<const mk_log *> &rows() const { return sources; }
    Search &search() const { return own ? *own : *used; }

    Hypothesis refit, best; // with nodes in logs()

  private:
    std::vector<const FitLog *> views;
    std::vector<const mk_log *> sources;
    Search *used;
    std::unique_ptr<Search> own;
    const FreeRuns *decided = nullptr;
    RunPoint run; // of the best fit, where free runs have decided

    void take_all(const TrainingData &data, const SearchOptions &usual);
};

} // namespace mk
#endif
