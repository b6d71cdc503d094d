// Weighted least squares: each equation by the variance of its own error, the diagonal of the
// report's S^2 (3.8).
#include "ident/regression.hpp"

namespace mk
{

namespace
{

Block weight(const RowNoise &noise)
{
    Block w = Block::Zero(noise.full.rows(), noise.full.rows());
    w.diagonal() = noise.full.diagonal().cwiseMax(1e-300).cwiseInverse();
    return w;
}

constexpr LinearMethod LAW = {false, 4, false, weight};

enum mk_status run(const IdentProblem &problem, mk_ident_result &result, mk_error *err)
{
    return regress(LAW, problem, result, err);
}

} // namespace

const IdentMethod method_wls = {
    {"wls", "the same, each equation weighted by its own variance", "report, ch. 3", false}, run};

} // namespace mk
