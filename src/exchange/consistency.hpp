// How well the columns of a log go together as the motion of one rig: a fit of the textbook model
// to smoothed accelerations.
#ifndef MECHKIT_EXCHANGE_CONSISTENCY_HPP
#define MECHKIT_EXCHANGE_CONSISTENCY_HPP

#include <vector>

#include "mechkit/log.h"
#include "mechkit/model.h"

namespace mk
{

struct Consistency {
    bool known = false; // enough motion to say anything
    // Squared error of the accelerations over their variance, mean over joints, of the best rig
    // with no negative mass, stiffness or friction; and of the best parameters of any sign.
    double error = 1.0, free_error = 1.0;
    int wrong_sign = -1; // parameter that comes out negative beyond doubt and must not; -1: none
    bool counts = true;  // steps of the readings are those of an encoder
    int astray = 0;      // joints whose speed came along and is not the slope of its angle
    bool hangs = true;   // where it stands still at the start without a command, it hangs
};

Consistency consistency(const mk_log &log, const mk_model &rig);

// Whether dq1 or dq2 (joint 0, 1) runs against the slope of its angle, and whether it is there and
// is something else than the slope.
bool speed_is_against(const mk_log &log, int joint);
bool speed_is_astray(const mk_log &log, int joint);

// Median spacing of the samples, s.
double sample_time(const mk_log &log);

} // namespace mk
#endif
