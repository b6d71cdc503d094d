// Lost encoder pulses put back before the search.
#ifndef MECHKIT_EXPLAIN_SEARCH_COUNT_CORRECTION_HPP
#define MECHKIT_EXPLAIN_SEARCH_COUNT_CORRECTION_HPP

#include "explain/search/search.hpp"

namespace mk
{

struct CountCorrection {
    int joint = 0;                      // 1-based; 0: none were lost
    double step = 0.0, std_error = 0.0; // rad
    double count = 0.0;                 // how many times
    double gain = 0.0;                  // in log likelihood, after the penalty
    std::vector<FitLog> logs;           // the data with them put back
    Hypothesis fit;                     // the model refitted to that
};

// To every model lost pulses look like kicks: they are taken for what they are if putting them back
// explains the data better than `refit` by more than `enough`. Not where the model then still needs
// more than `most_process_noise` of process noise with the steps as the readings show them.
CountCorrection find_count_correction(const mk_model &model,
                                      const std::vector<const FitLog *> &training,
                                      const SearchOptions &options, const Hypothesis &refit,
                                      double enough, double most_process_noise);

} // namespace mk
#endif
