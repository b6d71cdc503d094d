// Plain least squares: every row of every equation counts alike.
#include "ident/regression.hpp"

namespace mk
{

namespace
{

Block weight(const RowNoise &noise)
{
    return Block::Identity(noise.full.rows(), noise.full.rows());
}

constexpr LinearMethod LAW = {false, 2, false, weight};

enum mk_status run(const IdentProblem &problem, mk_ident_result &result, mk_error *err)
{
    return regress(LAW, problem, result, err);
}

} // namespace

const IdentMethod method_sls = {
    {"sls", "least squares on the torque equations", "report, ch. 3", false}, run};

} // namespace mk
