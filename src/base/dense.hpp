// Decompositions of dense matrices, compiled once. Eigen's are templates: a file that calls one of
// them builds it again, which takes the compiler seconds for each. The arithmetic is Eigen's.
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

// a'b.
MatrixXd transpose_product(const MatrixXd &a, const MatrixXd &b);
VectorXd transpose_product(const MatrixXd &a, const VectorXd &b);

MatrixXd inverse(const MatrixXd &a); // LU with partial pivoting

// Of a symmetric matrix, in rising order.
VectorXd eigenvalues(const MatrixXd &a);
void eigen(const MatrixXd &a, VectorXd &values, MatrixXd &vectors);

// Least squares of x b = y by QR with column pivoting; false where columns depend on one another to
// within `threshold`.
bool least_squares(const MatrixXd &x, const VectorXd &y, double threshold, VectorXd &b);

} // namespace mk::dense
#endif
