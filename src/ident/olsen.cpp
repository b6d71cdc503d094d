// Olsen and Petersen (2001): maximum likelihood with the whole covariance of angles, speeds and
// accelerations, the report's (3.7) in its right form, b' {B sigma^2 B'}^-1 b. The command is exact
// and adds nothing to S^2 = B sigma^2 B', which is regular all the same.
#include "ident/regression.hpp"

namespace mk
{

namespace
{

constexpr LinearMethod LAW = {false, 4, true, nullptr};

enum mk_status run(const IdentProblem &problem, mk_ident_result &result, mk_error *err)
{
    return regress(LAW, problem, result, err);
}

} // namespace

const IdentMethod method_olsen = {{"olsen", "weighted by the whole covariance of the signals",
                                   "Olsen and Petersen 2001; report (3.7)", false},
                                  run};

} // namespace mk
