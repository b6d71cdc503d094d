// A record with as many rows as a free run can tell apart: commands as means over short stretches,
// and one reading of each joint in every stretch.
#ifndef MECHKIT_IDENT_THIN_RECORD_HPP
#define MECHKIT_IDENT_THIN_RECORD_HPP

#include <vector>

#include "mechkit/sim.h"

namespace mk
{

// Owns what its record points to; moving it along keeps that valid, copying does not.
struct ThinRecord {
    std::vector<double> t, q[MK_MAX_JOINTS], u[MK_MAX_INPUTS], left_out;
    mk_record record;
    ThinRecord() = default;
    ThinRecord(ThinRecord &&) = default;
    ThinRecord &operator=(ThinRecord &&) = default;
    ThinRecord(const ThinRecord &) = delete;
    ThinRecord &operator=(const ThinRecord &) = delete;
};

// A record cut into stretches of at least `held` seconds, or of single rows where those are further
// apart. No stretch crosses a border of rows that are left out. The rows of the result are
//     the first row of each stretch ,
//     of each joint the first row in the stretch that has a reading of it , and
//     the record's last row ;
// other readings are missing (NaN). The command of each is the mean of what the record held over
// the stretch,
//     sum_k u_k (t_(k+1) - t_k) / (t_last - t_first) ,
// so that its integral stays what it was; commands that are missing do not count, and the mean is
// missing where all are. `joints` of the record are looked at. Lateness and flags are not kept.
ThinRecord thinned(const mk_record &record, int joints, double held);

} // namespace mk
#endif
