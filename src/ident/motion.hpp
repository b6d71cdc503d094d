// Angles, speeds and accelerations of a log by zero-phase filtering and central differences, as the
// linear methods need them.
#ifndef MECHKIT_IDENT_MOTION_HPP
#define MECHKIT_IDENT_MOTION_HPP

#include <vector>

#include "mechkit/sim.h"

namespace mk
{

struct Motion {
    double period; // s, even
    int joints;
    std::vector<double> q[MK_MAX_JOINTS], v[MK_MAX_JOINTS], a[MK_MAX_JOINTS];
    std::vector<double> u[MK_MAX_INPUTS]; // filtered alike; the mean of the holds around a row
    std::vector<char> measured;           // 0 where the row bridges a hole in the readings

    size_t rows() const { return measured.size(); }
};

// Holes and uneven rows are interpolated linearly; rows next to a hole are marked not measured.
Motion motion_of_record(const mk_record &record, const mk_model &model, double cutoff_hz);

} // namespace mk
#endif
