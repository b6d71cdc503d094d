// Which input would tell two hypotheses apart.
#ifndef MECHKIT_EXPLAIN_REPORT_NEXT_EXPERIMENT_HPP
#define MECHKIT_EXPLAIN_REPORT_NEXT_EXPERIMENT_HPP

#include <string>

#include "explain/search/search.hpp"
#include "mechkit/explain.h"

namespace mk
{

// What an experiment must keep to.
struct ExperimentLimits {
    double u_max;                                      // command units
    double q_min[MK_MAX_JOINTS], q_max[MK_MAX_JOINTS]; // rad; not for wheels
    double v_max[MK_MAX_JOINTS];                       // rad/s
    double period;                                     // s between samples
};

struct Experiment {
    std::string input;    // as after `input` in a command file; empty: none within the limits
    double seconds = 0.0; // how long
    // By how much the log likelihood of the true hypothesis is expected to exceed the other's after
    // its parameters have been fitted again to all data.
    double odds = 0.0;
};

// The most telling input of a family (multisines, chirps, steps, ramps, kicks, holds): that under
// which, `a` being true, `b` fits worst (T-optimal: Atkinson, Fedorov 1975; Box, Hill 1967).
Experiment most_telling(const Hypothesis &a, const Hypothesis &b, const ExperimentLimits &limits);

// Fills out.next for the nearest rival that the data leave open, or the nearest of all if asked
// for. `rival_fit`: by rival of `out`.
void propose_experiment(const mk_model &model, const std::vector<const FitLog *> &training,
                        const Hypothesis &best, const Hypothesis *const *rival_fit, bool asked,
                        mk_explanation &out);

} // namespace mk
#endif
