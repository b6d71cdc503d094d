// Decompositions and products of dense matrices, compiled once. Eigen's are templates: a file that
// calls one of them builds it again, which takes the compiler seconds for each. The arithmetic is
// Eigen's.
#ifndef MECHKIT_BASE_DENSE_HPP
#define MECHKIT_BASE_DENSE_HPP

#include <Eigen/Core>

namespace mk::dense
{

using Eigen::MatrixXd;
using Eigen::VectorXd;

// x of a x = b, a symmetric: LDL'.
VectorXd solve_symmetric(const MatrixXd &a, const VectorXd &b);
MatrixXd solve_symmetric(const MatrixXd &a, const MatrixXd &b);
// D of LDL'.
VectorXd pivots(const MatrixXd &a);

// Inverse of a symmetric positive definite matrix, by LL'; returns the log of the square root of
// its determinant.
double invert_positive(const MatrixXd &a, MatrixXd &inverse);
// x of L x = b, where a = LL'.
MatrixXd solve_by_root(const MatrixXd &a, const MatrixXd &b);

// Lower triangular L (n x n) with LL' = wide wide', by QR of its transpose.
MatrixXd lower_root(const MatrixXd &wide, Eigen::Index n);

// Products of whole matrices are as dear as decompositions where they are built.
MatrixXd product(const MatrixXd &a, const MatrixXd &b); // a b
VectorXd product(const MatrixXd &a, const VectorXd &b);
MatrixXd transpose_product(const MatrixXd &a, const MatrixXd &b); // a'b
VectorXd transpose_product(const MatrixXd &a, const VectorXd &b);
MatrixXd product_transpose(const MatrixXd &a, const MatrixXd &b); // a b'

// By LU with partial pivoting.
MatrixXd inverse(const MatrixXd &a);
MatrixXd solve(const MatrixXd &a, const MatrixXd &b); // x of a x = b
VectorXd solve(const MatrixXd &a, const VectorXd &b);

// Of a symmetric matrix, in rising order.
VectorXd eigenvalues(const MatrixXd &a);
void eigen(const MatrixXd &a, VectorXd &values, MatrixXd &vectors);

// Least squares of x b = y by QR with column pivoting; false where columns depend on one another to
// within `threshold`.
bool least_squares(const MatrixXd &x, const VectorXd &y, double threshold, VectorXd &b);
// The shortest of the least squares solutions of x b = y, where columns may depend on one another.
VectorXd shortest_solution(const MatrixXd &x, const VectorXd &y);

} // namespace mk::dense
#endif
