// Balance of energy (report, appendix 5, with T + V as it must be): what was stored between two
// times and what friction took equals the motors' work. The two times are averages, and a window
// moves over the whole log; no accelerations are needed.
#include "ident/regression.hpp"

namespace mk
{

namespace
{

constexpr LinearMethod LAW = {true, 4, true, nullptr};

enum mk_status run(const IdentProblem &problem, mk_ident_result &result, mk_error *err)
{
    return regress(LAW, problem, result, err);
}

} // namespace

const IdentMethod method_energy = {
    {"energy", "energy balance over windows, no accelerations", "report, appendix 5", false}, run};

} // namespace mk
