// Repeated runs among logs: found by their commands, averaged before anything nonlinear is formed.
#ifndef MECHKIT_IDENT_REPEATS_HPP
#define MECHKIT_IDENT_REPEATS_HPP

#include <vector>

#include "ident/method.hpp"
#include "ident/track.hpp"

namespace mk
{

// A track for every log that stands alone, and one for the mean of every set of repeated runs.
std::vector<Track> tracks_of(const IdentProblem &problem);

} // namespace mk
#endif
