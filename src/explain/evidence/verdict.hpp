// What is said of the outcome of a search: verdict, causes with their evidence, rivals.
#ifndef MECHKIT_EXPLAIN_EVIDENCE_VERDICT_HPP
#define MECHKIT_EXPLAIN_EVIDENCE_VERDICT_HPP

#include <vector>

#include "explain/search/count_correction.hpp"
#include "explain/search/final_fit.hpp"
#include "mechkit/explain.h"

namespace mk
{

// Whether given values of `free_count` parameters that are as far from their estimate as
// distance2, in its own covariance, are wrong beyond chance: less than one in 10 000 data sets of a
// rig that has them is so far off.
bool beyond_chance(double distance2, int free_count);

class Verdict
{
  public:
    // All must outlive it.
    Verdict(const mk_model &given, CauseSearch &found, const FinalFit &last_fit,
            const CountCorrection &count_correction, mk_explanation &out_in)
        : model(given), causes(found), last(last_fit), correction(count_correction), out(out_in)
    {
    }
    void decide();
    // What differs from log to log and the command's other column are causes as well, found before
    // all others: where these leave a rest without a name, they are named all the same.
    void add_data_causes();
    // What predicts held-out data worse than the refitted model is not offered, and no cause is
    // claimed: the formula, if any, stays as an observation.
    void reject();
    // What to look at where a rest has no name; once it is known what is claimed.
    void describe_suspects();
    // Whether the given values, or the sharpness of friction, are wrong beyond chance.
    bool values_off() const;
    // Whether each cause by itself is known to be there. Laws that nearly cancel make up a shape
    // that none of them has.
    bool established() const;
    bool carries_over() const;
    // By rival of the explanation.
    const Hypothesis *const *rivals() const { return rival_fit; }

  private:
    const mk_model &model;
    CauseSearch &causes;  // evidence
    const FinalFit &last; // and values
    const CountCorrection &correction;
    mk_explanation &out;
    const Hypothesis *rival_fit[MK_MAX_RIVALS] = {};

    double distance_of_given() const;
    static std::vector<double> standard_errors(const Hypothesis &h);
    bool is_lone_wave(int effect) const;
    double error_of_size(int first, const mk_effect_info &info, int size, bool alone) const;
    void set_structure();
    void describe_causes();
    void sort_causes();
    bool hangs_on_what_has_no_name(const mk_cause &c) const;
    bool is_one_law_without_a_name() const;
    void find_pieces();
    void weigh(int cause, int fitted, mk_cause &c);
    void add_missed_counts();
    int place_of(const Candidate &chosen) const;
    void describe_rivals();
};

} // namespace mk
#endif
