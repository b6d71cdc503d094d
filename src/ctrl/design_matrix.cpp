// The decompositions behind gain design.
#include "ctrl/design_priv.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <unsupported/Eigen/MatrixFunctions>

#include "base/dense.hpp"

namespace mk::design
{

CVector eigenvalues(const Matrix &a)
{
    return a.eigenvalues();
}

Vector singular_values(const CMatrix &m)
{
    return Eigen::JacobiSVD<CMatrix>(m).singularValues();
}

Matrix exponential(const Matrix &a)
{
    return a.exp();
}

bool schur_form(const Matrix &a, CMatrix &t, CMatrix &u)
{
    Eigen::ComplexSchur<CMatrix> schur(a.cast<Complex>());
    if (schur.info() != Eigen::Success)
        return false;
    t = schur.matrixT();
    u = schur.matrixU();
    return true;
}

CMatrix solve(const CMatrix &a, const CMatrix &b)
{
    return a.partialPivLu().solve(b);
}

// Exchanges the neighbouring eigenvalues k and k + 1 by a rotation (G. H. Golub, C. F. Van Loan,
// Matrix Computations, 7.6.2).
static void swap_neighbours(CMatrix &t, CMatrix &u, Eigen::Index k, CVector *extra)
{
    Eigen::JacobiRotation<Complex> rotation;
    rotation.makeGivens(t(k, k + 1), t(k + 1, k + 1) - t(k, k));
    t.applyOnTheLeft(k, k + 1, rotation.adjoint());
    t.applyOnTheRight(k, k + 1, rotation);
    u.applyOnTheRight(k, k + 1, rotation);
    if (extra)
        extra->applyOnTheLeft(k, k + 1, rotation.adjoint());
    t(k + 1, k) = 0.0;
}

void move_up(CMatrix &t, CMatrix &u, Eigen::Index from, Eigen::Index to, CVector *extra)
{
    for (Eigen::Index k = from - 1; k >= to; k--)
        swap_neighbours(t, u, k, extra);
}

double reach(const Matrix &a, const Matrix &b, Complex lambda)
{
    const Eigen::Index n = a.rows();
    double size = a.norm() > 0.0 ? a.norm() : 1.0, input = b.norm();
    CMatrix pencil(n, n + b.cols());
    pencil.leftCols(n) = a.cast<Complex>() - lambda * CMatrix::Identity(n, n);
    pencil.rightCols(b.cols()) = (b * (input > 0.0 ? size / input : 0.0)).cast<Complex>();
    return singular_values(pencil).minCoeff() / size;
}

// By vectorisation: at most 64 unknowns, so the dense system is small.
bool solve_lyapunov(const Matrix &a, const Matrix &q, Matrix &p)
{
    const Eigen::Index n = a.rows();
    Matrix big = Matrix::Zero(n * n, n * n);
    for (Eigen::Index j = 0; j < n; j++)
        for (Eigen::Index i = 0; i < n; i++)
            for (Eigen::Index k = 0; k < n; k++) {
                big(i + j * n, k + j * n) += a(k, i);
                big(i + j * n, i + k * n) += a(k, j);
            }
    Vector solution = dense::solve(big, Vector(-Eigen::Map<const Vector>(q.data(), n * n)));
    if (!solution.allFinite())
        return false;
    Eigen::Map<const Matrix> x(solution.data(), n, n);
    p = 0.5 * (x + x.transpose());
    return true;
}

} // namespace mk::design
