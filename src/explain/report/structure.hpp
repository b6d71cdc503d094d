// What is missing, as a formula.
#ifndef MECHKIT_EXPLAIN_REPORT_STRUCTURE_HPP
#define MECHKIT_EXPLAIN_REPORT_STRUCTURE_HPP

#include <string>

#include "mechkit/explain.h"

namespace mk
{

// The causes of an explanation as the torque that they add to the equation of each joint, such as
// "joint 2: -0.013*dq2*abs(dq2)".
std::string describe_structure(const mk_explanation &explanation, const mk_plant_info &plant);

} // namespace mk
#endif
