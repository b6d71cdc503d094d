#include "ident/repeats.hpp"

namespace mk
{

std::vector<Track> tracks_of(const IdentProblem &problem)
{
    std::vector<Track> tracks;
    for (const mk_record &record : problem.records)
        tracks.push_back(track_of_record(record, problem.model));
    return tracks;
}

} // namespace mk
