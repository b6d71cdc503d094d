// What could be missing: every effect of the catalogue at every joint where it makes sense, with
// the values from which a search for it starts.
#ifndef MECHKIT_EXPLAIN_SEARCH_CANDIDATES_HPP
#define MECHKIT_EXPLAIN_SEARCH_CANDIDATES_HPP

#include <string>
#include <vector>

#include "ident/fit.hpp"

namespace mk
{

// Ranges that the data cover; starting values are taken relative to them.
struct DataRange {
    double q_min[MK_MAX_JOINTS], q_max[MK_MAX_JOINTS], v_max[MK_MAX_JOINTS];
    double u_max;    // largest command
    double seconds;  // of the longest log
    double torque;   // of the rig: rms of the command, or what gravity asks for
    bool two_motors; // a torque on joint 2 was recorded as well
};
DataRange data_range(const mk_model &model, const std::vector<const FitLog *> &logs);

struct Candidate {
    const mk_effect_info *effect;
    int joint; // 1-based; 0: none or all
    double value[MK_MAX_EFFECT_PARAMETERS];
    // Vanishes with parameter `size`: its likelihood gain can be seen from the slope where it is
    // next to nothing.
    bool linear;
    int size;
    double most = HUGE_VAL; // of it, for any rig
    int shape = -1;         // parameter that says little before the size is about right
    double spread = 0.0;    // of `own` from log to log; 0: all logs share it
    int own = -1;           // parameter that has a value of its own in every log; -1: `size`
};

// All candidates for a model that may have effects already.
std::vector<Candidate> candidates(const mk_model &model, const DataRange &range);

// A term of the library rather than an entry of the catalogue.
bool is_library(const mk_effect_info *effect);
// A law of friction: of a joint's speed, against it. `values`: the effect's.
bool is_friction(const mk_effect_info *effect, const double *values);

// How often in a turn of its joint a wave repeats: the effect's parameter that is a whole number; 1
// for an effect that has none. `values`: the effect's.
double cycles_a_turn(const mk_effect_info &effect, const double *values);

// Two bodies that touch now and then.
bool is_backlash(const mk_effect_info *effect);

// Where an effect acts from, if that is set by hand before each log, as a cable's rest: which of
// its parameters, and how far apart they are in different logs, to start a fit from.
bool place_set_by_hand(const mk_effect_info *effect, int &parameter, double &spread);

// Of candidates those that act at a place, or from one, that is set by hand before each log: with a
// place of its own in every log.
std::vector<Candidate> with_own_places(const std::vector<Candidate> &candidates);

// The same effect at the same joint, with whatever values. Terms of the library are causes of their
// own.
bool same_cause(const Candidate &a, const Candidate &b);
// Starts of the same cause that are not worth a try each: resonances apart are.
bool same_start(const Candidate &a, const Candidate &b);

// The model with one more effect; false when it does not fit in.
bool with_candidate(const mk_model &model, const Candidate &candidate, mk_model &out);

} // namespace mk
#endif
