// Lost encoder pulses: a reading that jumps by the same step now and then and stays there.
#ifndef MECHKIT_EXPLAIN_SEARCH_MISSED_COUNTS_HPP
#define MECHKIT_EXPLAIN_SEARCH_MISSED_COUNTS_HPP

#include "ident/fit_log.hpp"

namespace mk
{

struct Slip {
    size_t log, row; // first row after it
    double step;     // rad
};

// Jumps of joint j's readings that no motion makes: local parabolas before and after differ by many
// counts, and all by nearly the same amount.
std::vector<Slip> find_slips(const std::vector<const FitLog *> &logs, int joint);

// The log with the steps taken back.
FitLog without_slips(const FitLog &log, size_t index, int joint, const std::vector<Slip> &slips);

} // namespace mk
#endif
