// Angles, speeds and accelerations of a log on even rows, as the regressions need them.
#ifndef MECHKIT_IDENT_TRACK_HPP
#define MECHKIT_IDENT_TRACK_HPP

#include <vector>

#include "mechkit/sim.h"

namespace mk
{

struct Track {
    double period; // s, even
    int joints;
    std::vector<double> q[MK_MAX_JOINTS], v[MK_MAX_JOINTS], a[MK_MAX_JOINTS];
    std::vector<double> u[MK_MAX_INPUTS]; // held from each row to the next; empty: no such motor
    std::vector<char> measured;           // 0 where the row bridges a hole in the data
    double noise[MK_MAX_JOINTS];          // standard deviation of a reading, rad

    size_t rows() const { return measured.size(); }
};

// Smooths the readings (mechkit/signals.h), rougher than most likely: what is left of the noise
// averages out in the equations, what the smoother bends does not. Throws std::bad_alloc; needs 5
// readings of each joint.
Track track_of_record(const mk_record &record, const mk_model &model);

} // namespace mk
#endif
