// How sharply the motor joint's dry friction changes its sign: k in tanh(k v).
//
// k is a convention of the model, not a number that anybody measures. A rig's friction mostly
// changes its sign faster, and what is left then looks like a friction that falls with speed.
#ifndef MECHKIT_EXPLAIN_SEARCH_SHARPNESS_HPP
#define MECHKIT_EXPLAIN_SEARCH_SHARPNESS_HPP

#include "explain/search/search.hpp"

namespace mk::sharpness
{

// How far k goes, times what is given, and to within which factor it is found: at first, and where
// it matters.
constexpr double FEWEST = 1.0 / 8.0, MOST = 64.0, ROUGHLY = 1.1, FINELY = 1.01;
// Fits `h` with the k of least nlml at its process noise, roughly, where that gains `least` (log
// likelihood). True if so. `given`: what FEWEST and MOST are times of.
bool adapt(Search &search, double given, double least, Hypothesis &h);
// The same, then finely, and all parameters and the process noise fitted anew. Not where k gains
// less than policy::SHARPNESS_SAYS a reading: that is what a model gains by bending.
bool adapt_and_refit(Search &search, double given, Hypothesis &h);
// Goes to a better k near that of `h`, at its process noise: by factors from 1.4 down to `last`.
void come_nearer(Search &search, Hypothesis &h, double last);
// The model with k times as large: its own, and that of laws of friction of the motor's joint that
// have the same.
mk_model with_sharpness(const mk_model &model, double times);
bool has_dry_friction(const mk_model &model);

} // namespace mk::sharpness
#endif
