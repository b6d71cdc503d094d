#include "base/dense.hpp"

#include <Eigen/Dense>

namespace mk::dense
{

VectorXd solve_symmetric(const MatrixXd &a, const VectorXd &b)
{
    return a.ldlt().solve(b);
}

MatrixXd solve_symmetric(const MatrixXd &a, const MatrixXd &b)
{
    return a.ldlt().solve(b);
}

VectorXd pivots(const MatrixXd &a)
{
    return a.ldlt().vectorD();
}

double invert_positive(const MatrixXd &a, MatrixXd &inverse)
{
    Eigen::LLT<MatrixXd> factor(a);
    inverse = factor.solve(MatrixXd::Identity(a.rows(), a.cols()));
    return factor.matrixLLT().diagonal().array().log().sum();
}

MatrixXd solve_by_root(const MatrixXd &a, const MatrixXd &b)
{
    Eigen::LLT<MatrixXd> factor(a);
    return factor.matrixL().solve(b);
}

MatrixXd lower_root(const MatrixXd &wide, Eigen::Index n)
{
    Eigen::HouseholderQR<MatrixXd> qr(wide.transpose());
    return qr.matrixQR().topRows(n).triangularView<Eigen::Upper>().transpose();
}

MatrixXd product(const MatrixXd &a, const MatrixXd &b)
{
    return a * b;
}

VectorXd product(const MatrixXd &a, const VectorXd &b)
{
    return a * b;
}

MatrixXd transpose_product(const MatrixXd &a, const MatrixXd &b)
{
    return a.transpose() * b;
}

VectorXd transpose_product(const MatrixXd &a, const VectorXd &b)
{
    return a.transpose() * b;
}

MatrixXd product_transpose(const MatrixXd &a, const MatrixXd &b)
{
    return a * b.transpose();
}

MatrixXd inverse(const MatrixXd &a)
{
    return a.inverse();
}

MatrixXd solve(const MatrixXd &a, const MatrixXd &b)
{
    return a.partialPivLu().solve(b);
}

VectorXd solve(const MatrixXd &a, const VectorXd &b)
{
    return a.partialPivLu().solve(b);
}

VectorXd eigenvalues(const MatrixXd &a)
{
    return Eigen::SelfAdjointEigenSolver<MatrixXd>(a).eigenvalues();
}

void eigen(const MatrixXd &a, VectorXd &values, MatrixXd &vectors)
{
    Eigen::SelfAdjointEigenSolver<MatrixXd> solver(a);
    values = solver.eigenvalues();
    vectors = solver.eigenvectors();
}

bool least_squares(const MatrixXd &x, const VectorXd &y, double threshold, VectorXd &b)
{
    Eigen::ColPivHouseholderQR<MatrixXd> qr(x);
    qr.setThreshold(threshold);
    if (qr.rank() < x.cols())
        return false;
    b = qr.solve(y);
    return true;
}

VectorXd shortest_solution(const MatrixXd &x, const VectorXd &y)
{
    return x.completeOrthogonalDecomposition().solve(y);
}

} // namespace mk::dense
