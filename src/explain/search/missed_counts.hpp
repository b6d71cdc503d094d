// Lost encoder pulses: a reading that jumps by the same step now and then and stays there.
#ifndef MECHKIT_EXPLAIN_SEARCH_MISSED_COUNTS_HPP
#define MECHKIT_EXPLAIN_SEARCH_MISSED_COUNTS_HPP

#include "ident/fit_log.hpp"

namespace mk
{

struct MissedCount {
    size_t log, row; // first row after it
    double step;     // rad; of the size that all have
    double distinct; // how many times better than an impulse explains it
    double size;     // its own, rad
};

// Jumps of joint j's readings that no motion makes: local parabolas before and after differ by many
// counts, and all by nearly the same amount.
std::vector<MissedCount> find_missed_counts(const std::vector<const FitLog *> &logs, int joint);

// Whether a step is of that size, give or take what the readings' noise does to it.
bool is_step_of(double step, double size, double count);

// Whether these are steps of the readings whatever the model makes of them: an impulse that the
// model lacks would have left the joint where it was.
bool surely_steps(const std::vector<MissedCount> &found);

// The log with the steps taken back.
FitLog with_corrected_counts(const FitLog &log, size_t index, int joint,
                             const std::vector<MissedCount> &missed);

} // namespace mk
#endif
