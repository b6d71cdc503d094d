// The scale of a model: what data without a torque cannot tell.
//
// Every plant's equations are sums of base parameters times known functions of the motion, equal to
// the command (docs/theory.md). Where the command is 0, inertias, weights, frictions and
// stiffnesses may all be multiplied by any one number and nothing that is measured changes: the
// information matrix has a null direction along the vector of those parameters. Such data determine
// ratios. One of the parameters is then held, which fixes the number, and the others are known
// relative to it.
#ifndef MECHKIT_IDENT_SCALE_HPP
#define MECHKIT_IDENT_SCALE_HPP

#include <string>

#include "ident/method.hpp"

namespace mk
{

// Exponents of a parameter's unit; angles have none.
struct Dimension {
    int mass = 0, length = 0, time = 0;
};
Dimension dimension_of(const char *unit); // of SI text: "N m s/rad"
std::string unit_of(const Dimension &d);  // "1/s^2"; "" for a pure number

// Whether a parameter scales with torque: an inertia, weight, friction, stiffness.
bool scales_with_torque(const mk_model &model, int number);

// Whether the accelerations that a model without a command makes stay the same when all parameters
// that scale with torque are doubled.
bool is_homogeneous(const mk_model &model);

// The parameter that holds the scale where nothing else does: the first inertia of the plant, or of
// those whose value is known if that one's is not (`unknown` by number, may be NULL).
int scale_holder(const mk_model &model, const bool *unknown);

// Whether a parameter that scales with torque, and is not 0, is held already.
bool scale_is_held(const mk_model &model, const bool *fixed);

// Whether no command acts in any of the records and the model leaves the scale open.
bool scale_is_free(const mk_model &model, const std::vector<mk_record> &records);

// Whether a fit in which no parameter is held left the scale open: all parameters that scale with
// torque are known far worse than their ratios to `holder`.
bool scale_was_not_found(const mk_ident_result &r, int holder);

// Ratios to the held parameter, with their standard errors. The parameters themselves are known no
// better than the held one, by the standard error that the model gives it.
void tell_ratios(int holder, mk_ident_result &r);

} // namespace mk
#endif
