// The logs as explain searches in them, and what is held back.
#ifndef MECHKIT_EXPLAIN_TRAINING_HPP
#define MECHKIT_EXPLAIN_TRAINING_HPP

#include <vector>

#include "ident/fit_log.hpp"
#include "ident/owned_log.hpp"
#include "mechkit/explain.h"

namespace mk
{

struct TrainingData {
    std::vector<FitLog> logs;         // to search in
    std::vector<const mk_log *> rows; // the same rows, one a FitLog
    // For the last fit, where `logs` are windows of long ones; else empty.
    std::vector<FitLog> whole;
    std::vector<const mk_log *> whole_rows;
    std::vector<const mk_log *> held; // to measure on
    std::vector<OwnedLog> made;       // those of `rows` and `held` that were cut off
    bool second_half = false; // figures are those of second halves: logs have values of their own

    // Takes at most options.most_s of the logs; without hold-out logs the end of the last one is
    // held back. Fills what `out` says of the data. MK_ERR_RANGE: too little of it, or no motion.
    enum mk_status load(const mk_model &model, const mk_explain_options &options,
                        const mk_log *const *given, size_t count, const mk_log *const *holdouts,
                        size_t holdout_count, mk_explanation &out, mk_error *err);

    // All rows to learn from, by log.
    std::vector<std::vector<const mk_log *>> rows_by_log() const;

  private:
    enum mk_status hold_back(const mk_log &log, const mk_record &record, const mk_model &model,
                             size_t &last, mk_explanation &out, mk_error *err);
};

} // namespace mk
#endif
