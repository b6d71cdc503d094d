// Where the counter of a joint was zeroed in each log, where the law does not care: found from what
// repeats with the angle.
#ifndef MECHKIT_EXPLAIN_SEARCH_PLACES_HPP
#define MECHKIT_EXPLAIN_SEARCH_PLACES_HPP

#include <vector>

#include "explain/search/search.hpp"
#include "ident/owned_log.hpp"
#include "mechkit/explain.h"

namespace mk
{

struct Place {
    double shift;     // of the readings, to the zero of the first log; the joint's unit
    double std_error; // 0 for the first log
};

struct Places {
    int joint = 0;                      // 1-based; 0: nothing found, or all logs have the same zero
    const mk_effect_info *by = nullptr; // what repeats with the angle
    double cycles = 1.0;            // how often in a turn: shifts are known but for 1/cycles of it
    std::vector<Place> learn, held; // by log
};

// `search` and `refit`: of the model fitted to all logs to learn from. Of logs held back the first
// halves are asked, and of the last log to learn from where none is. Nothing is found in fewer than
// two logs, or where the refitted model follows its data. Throws std::bad_alloc.
Places find_places(const std::vector<const mk_log *> &learn,
                   const std::vector<const mk_log *> &held, Search &search,
                   const Hypothesis &refit);

// Copies of the logs with the joint's readings shifted.
std::vector<OwnedLog> put_in_place(const std::vector<const mk_log *> &logs, int joint,
                                   const std::vector<Place> &places);

void describe_places(const Places &places, mk_explanation &out);

} // namespace mk
#endif
