// Whether a log can be learned from at all: enough rows and values of a possible size, something
// that moves, for as long as the rig takes to show what it does.
#ifndef MECHKIT_SIM_RECORD_CHECK_HPP
#define MECHKIT_SIM_RECORD_CHECK_HPP

#include "mechkit/sim.h"

namespace mk
{

// No wheel turns a hundred thousand times in a run.
constexpr double MOST_ANGLE = 1e6; // rad

// Refuses a log with a reading or a command that is infinite: MK_ERR_RANGE with file and line. A
// missing one is a NaN.
enum mk_status check_finite(const mk_record &record, const mk_model &model, const mk_log &log,
                            mk_error *err);

// Refuses a log with fewer rows, or values in a column, than `fewest`, rows too far apart for any
// rig, a value that is infinite, or one that no rig reaches: MK_ERR_RANGE with file and line.
enum mk_status check_record(const mk_record &record, const mk_model &model, const mk_log &log,
                            size_t fewest, mk_error *err);

// Whether a joint (0-based), or any, turns by more than a few counts of its encoder.
bool joint_moves(const mk_record &record, const mk_model &model, int joint);
bool record_moves(const mk_record &record, const mk_model &model);

// The longest time that a joint takes to show what it does, s: the period of small swings about
// hanging, or, where gravity does not act, inertia over viscous friction. *what (static) says
// which.
double slowest_motion(const mk_model &model, const char **what);

// Least seconds of data that tell a cause from another, and that a gain is measured on.
double least_to_explain(const mk_model &model);
double least_to_hold_out(const mk_model &model);

double duration_of(const mk_record &record); // s

} // namespace mk
#endif
