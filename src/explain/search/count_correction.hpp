// Lost encoder pulses put back before the search.
#ifndef MECHKIT_EXPLAIN_SEARCH_COUNT_CORRECTION_HPP
#define MECHKIT_EXPLAIN_SEARCH_COUNT_CORRECTION_HPP

#include "explain/search/missed_counts.hpp"
#include "explain/search/search.hpp"
#include "ident/owned_log.hpp"

namespace mk
{

struct CountCorrection {
    int joint = 0;                      // 1-based; 0: none were lost
    double step = 0.0, std_error = 0.0; // rad
    double count = 0.0, seconds = 0.0;  // how many times, in how much data
    double gain = 0.0;                  // in log likelihood, after the penalty
    bool sure = false;                  // steps whatever the model makes of them
    std::vector<MissedCount> missed;    // each of them
    std::vector<FitLog> logs;           // the data with them put back
    Hypothesis fit;                     // the model refitted to that
};

// Whether readings show missed counts whatever the model makes of them.
bool surely_missed(const std::vector<const FitLog *> &training);

// To every model lost pulses look like kicks: they are taken for what they are if putting them back
// explains the data better than `refit` by more than `enough`. Where they are not surely steps, not
// if the model then still needs more than `most_process_noise` of process noise with the steps as
// the readings show them.
CountCorrection find_count_correction(const mk_model &model,
                                      const std::vector<const FitLog *> &training,
                                      const SearchOptions &options, const Hypothesis &refit,
                                      double enough, double most_process_noise);

// The same counts by a model that knows more, of `logs`, in which `before` has been put
// back: by how much the steps were off. `logs` of it are without that.
CountCorrection tuned(const mk_model &model, const std::vector<const FitLog *> &logs,
                      const SearchOptions &options, const CountCorrection &before);

// A copy of a log in which the readings of that joint are put back wherever they surely jump by
// about as much; `steps` is raised by how often. NULL where they never do. Throws std::bad_alloc.
OwnedLog log_with_corrected_counts(const mk_log &log, const mk_model &model,
                                   const CountCorrection &correction, int &steps);

} // namespace mk
#endif
