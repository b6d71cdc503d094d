#include "ident/whiten.hpp"

#include <cmath>

namespace mk
{

namespace
{

// Cholesky factor; a pivot that rounding ate becomes a small one: that row then says little.
Block root_of(Block s, const Block &whole)
{
    long n = s.rows();
    Block l = Block::Zero(n, n);
    for (long j = 0; j < n; j++) {
        double pivot = s(j, j) - l.row(j).head(j).squaredNorm();
        l(j, j) = std::sqrt(std::max(pivot, std::max(1e-9 * whole(j, j), 1e-300)));
        for (long i = j + 1; i < n; i++)
            l(i, j) = (s(i, j) - l.row(i).head(j).dot(l.row(j).head(j))) / l(j, j);
    }
    return l;
}

} // namespace

Eigen::MatrixXd Whitener::push(const Eigen::MatrixXd &values, const std::vector<Block> &before,
                               const Block &self)
{
    Row row;
    size_t reach = before.size();
    row.factor.resize(reach);
    row.values = values;
    Block rest = self;
    // From the farthest on: L_ij = (S_ij - sum over k before j of L_ik L_jk^T) L_jj^-T.
    for (size_t j = reach; j-- > 0;) {
        const Row &other = rows[j];
        Block s = before[j];
        for (size_t k = j + 1; k < reach && k - j - 1 < other.factor.size(); k++)
            s -= row.factor[k] * other.factor[k - j - 1].transpose();
        row.factor[j] = other.root.triangularView<Eigen::Lower>().solve(s.transpose()).transpose();
        rest -= row.factor[j] * row.factor[j].transpose();
        row.values -= row.factor[j] * other.values;
    }
    row.root = root_of(rest, self);
    row.root.triangularView<Eigen::Lower>().solveInPlace(row.values);
    rows.push_front(row);
    if (rows.size() > reach + 1)
        rows.resize(reach + 1);
    return row.values;
}

} // namespace mk
