// The torque that each equation of a plant lacks along measured motion, block by block, without a
// fit of trajectories: smoothed motion, the plant's regressor and what usual errors of a model add
// (offset, friction, a cable, zeros of encoders, effects of the model), by iteratively reweighted
// least squares (Holland, Welsch 1977). Parameters that are off do not matter, and stretches in
// which something else takes part do not bend the fit as long as they are few.
#ifndef MECHKIT_IDENT_RESIDUAL_TORQUE_HPP
#define MECHKIT_IDENT_RESIDUAL_TORQUE_HPP

#include <vector>

#include "mechkit/sim.h"

namespace mk
{

struct ResidualTorques {
    // By block: the log it is from, its middle (s from the log's first row), whether no hole is in
    // it.
    std::vector<size_t> log;
    std::vector<double> t;
    std::vector<char> measured;
    double block_s = 0.0; // longest block
    int joints = 0;

    struct Equation {
        std::vector<double> angle;    // by block: the joint's mean reading, rad
        std::vector<double> residual; // by block, torque units of the model; NaN where unknown
        // By block: half the sum of what acts in the equation, sign aside. A torque that nothing in
        // the model balances is twice as large as this at most.
        std::vector<double> acting;
        double usual = 0.0; // what acts at busy times (upper quartile); 0: nothing is known
    } equation[MK_MAX_JOINTS];

    size_t blocks() const { return t.size(); }
};

// Records too short, too slow, without readings or without motion have no blocks. At most the first
// million rows are looked at. Throws std::bad_alloc.
ResidualTorques residual_torques(const mk_model &model, const std::vector<mk_record> &records);

} // namespace mk
#endif
