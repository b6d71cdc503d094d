// Swevers and others (1997): speeds and accelerations count as known, the errors are those of the
// torques. A command that is known has none, so what motors and model leave in the equations stands
// for it; the angles' errors come on top, as in the report.
#include "base/dense.hpp"
#include "ident/regression.hpp"

namespace mk
{

namespace
{

Block weight(const RowNoise &noise)
{
    Block s = noise.angles;
    s.diagonal() += noise.residual.diagonal().cwiseMax(1e-300);
    return dense::inverse(s);
}

constexpr LinearMethod LAW = {false, 4, false, weight};

enum mk_status run(const IdentProblem &problem, mk_ident_result &result, mk_error *err)
{
    return regress(LAW, problem, result, err);
}

} // namespace

const IdentMethod method_swevers = {
    {"swevers", "weighted by torque noise and angles, derivatives taken as exact",
     "Swevers et al. 1997; report, ch. 3", false},
    run};

} // namespace mk
