// What differs from log to log before any cause is looked for: where the encoders' zeros are, and
// whatever else the catalogue lets a log have of its own.
#ifndef MECHKIT_EXPLAIN_SEARCH_LOG_VALUES_HPP
#define MECHKIT_EXPLAIN_SEARCH_LOG_VALUES_HPP

#include <vector>

#include "explain/search/search.hpp"
#include "mechkit/explain.h"

namespace mk
{

// A parameter that was found to have a value of its own in every log.
struct LogValue {
    const mk_effect_info *effect;
    int joint, parameter;
    double gain;   // log likelihood beyond one value for all logs, after the penalty
    double spread; // to start a fit from, in the parameter's unit
};

struct LogValues {
    mk_model model; // the given one with these effects, to start further fits from
    Hypothesis fit; // and fitted
    std::vector<LogValue> found;
};

// Groups of parameters are tried one after another. A group is accepted if the likelihood asks for
// a value in every log beyond one for all, and if values from the first halves of the logs predict
// the second halves better. `refit`: the given model, fitted. Nothing is found in fewer than two
// logs, or where the refitted model follows its data.
LogValues find_log_values(const mk_model &given, const std::vector<const mk_log *> &logs,
                          double window_s, Search &search, const Hypothesis &refit);

// Of a model whose latest effect acts at a place that was set by hand before each log, as a cable's
// rest: the same with a value of its own in every log. False if there is no such place.
bool with_own_place(const mk_model &model, mk_model &out);

// For each effect of a fit whether its values in the logs really differ: their spread has a size,
// and is more than they are uncertain by.
std::vector<bool> differ(const std::vector<const FitLog *> &training, const Hypothesis &h,
                         const FitOptions &options);

// Those of `values` that still differ from log to log in `best`, which has causes beside them.
std::vector<LogValue> that_still_differ(const LogValues &values, const Hypothesis &best,
                                        const std::vector<const FitLog *> &training,
                                        const FitOptions &options);

// `found` and no others in the given model, of which `refit` is the fit.
LogValues with_log_values(const mk_model &given, const std::vector<LogValue> &found, Search &search,
                          const Hypothesis &refit);

// What usually differs from log to log in such a rig: the zeros of joints that hang.
std::vector<LogValue> usual_log_values(const mk_model &model);

// Describes what was found, log by log, and how far friction holds each joint off.
void describe_log_values(const LogValues &values, const Hypothesis &best,
                         const std::vector<const FitLog *> &training, int threads,
                         mk_explanation &out);

} // namespace mk
#endif
