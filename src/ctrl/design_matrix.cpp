// The decompositions behind gain design.
#include "ctrl/design_priv.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>

#include "base/dense.hpp"

// Eigen's own ways from a matrix to its eigenvalues, Schur form or exponential also build what
// large matrices need, or eigenvectors, or a choice of preconditioners. A design has a few states:
// here the same steps are taken one by one, which halves the time that the compiler needs.

namespace mk::design
{

using Hessenberg = Eigen::HessenbergDecomposition<Matrix>;

// Those of a real Schur form, whose diagonal has a block of two for each conjugate pair.
static CVector diagonal_eigenvalues(const Matrix &t)
{
    const Eigen::Index n = t.rows();
    CVector out(n);
    for (Eigen::Index i = 0; i < n; i++) {
        if (i == n - 1 || t(i + 1, i) == 0.0) {
            out(i) = t(i, i);
            continue;
        }
        double p = 0.5 * (t(i, i) - t(i + 1, i + 1)), below = t(i + 1, i), above = t(i, i + 1);
        double most = std::max(std::abs(p), std::max(std::abs(below), std::abs(above)));
        double share = p / most;
        double z = most * std::sqrt(std::abs(share * share + below / most * (above / most)));
        out(i) = Complex(t(i + 1, i + 1) + p, z);
        out(i + 1) = Complex(t(i + 1, i + 1) + p, -z);
        i++;
    }
    return out;
}

CVector eigenvalues(const Matrix &a)
{
    double size = a.cwiseAbs().maxCoeff();
    if (size < std::numeric_limits<double>::min())
        return CVector::Zero(a.rows());
    const Matrix h = Hessenberg(a / size).matrixH();
    Eigen::RealSchur<Matrix> schur(a.rows());
    schur.computeFromHessenberg(h, h, false);
    return diagonal_eigenvalues(schur.matrixT() * size);
}

// Of a square matrix.
Vector singular_values(const CMatrix &m)
{
    return Eigen::JacobiSVD<CMatrix, Eigen::NoQRPreconditioner>(m).singularValues();
}

// U and V of the approximant (V - U)^-1 (V + U), of a degree up to 9.
static void pade_low(const Matrix &a, int degree, const double *b, Matrix &u, Matrix &v)
{
    const int half = degree / 2;
    Matrix power[5]; // A^0, A^2, ..
    power[0] = Matrix::Identity(a.rows(), a.cols());
    power[1] = dense::product(a, a);
    for (int k = 2; k <= half; k++)
        power[k] = dense::product(power[k - 1], power[1]);
    Matrix odd = b[degree] * power[half];
    v = b[degree - 1] * power[half];
    for (int k = half - 1; k >= 0; k--) {
        odd += b[2 * k + 1] * power[k];
        v += b[2 * k] * power[k];
    }
    u = dense::product(a, odd);
}

// The same of degree 13, with two products less.
static void pade_13(const Matrix &a, const double *b, Matrix &u, Matrix &v)
{
    const Matrix eye = Matrix::Identity(a.rows(), a.cols()), a2 = dense::product(a, a);
    const Matrix a4 = dense::product(a2, a2), a6 = dense::product(a4, a2);
    auto sum = [](double x6, const Matrix &m6, double x4, const Matrix &m4, double x2,
                  const Matrix &m2) { return Matrix(x6 * m6 + x4 * m4 + x2 * m2); };
    Matrix odd = dense::product(a6, sum(b[13], a6, b[11], a4, b[9], a2));
    odd += sum(b[7], a6, b[5], a4, b[3], a2) + b[1] * eye;
    u = dense::product(a, odd);
    v = dense::product(a6, sum(b[12], a6, b[10], a4, b[8], a2));
    v += sum(b[6], a6, b[4], a4, b[2], a2) + b[0] * eye;
}

Matrix exponential(const Matrix &a)
{
    // The norm up to which each degree is exact to rounding.
    static const struct {
        int degree;
        double norm;
    } choices[] = {{3, 1.495585217958292e-002},
                   {5, 2.539398330063230e-001},
                   {7, 9.504178996162932e-001},
                   {9, 2.097847961257068e+000},
                   {13, 5.371920351148152}};
    const double norm = a.cwiseAbs().colwise().sum().maxCoeff();
    int choice = 0, squarings = 0;
    while (choice < 4 && !(norm < choices[choice].norm))
        choice++;
    const int degree = choices[choice].degree;
    double b[14];
    b[degree] = 1.0;
    for (int j = degree - 1; j >= 0; j--)
        b[j] = b[j + 1] * ((2 * degree - j) * (j + 1)) / (degree - j);
    Matrix u, v;
    if (degree < 13) {
        pade_low(a, degree, b, u, v);
    } else {
        std::frexp(norm / choices[choice].norm, &squarings);
        squarings = std::max(squarings, 0);
        pade_13(a * std::ldexp(1.0, -squarings), b, u, v);
    }
    Matrix result = dense::solve(v - u, Matrix(u + v));
    for (int i = 0; i < squarings; i++)
        result = dense::product(result, result);
    return result;
}

bool schur_form(const Matrix &a, CMatrix &t, CMatrix &u)
{
    const Eigen::Index n = a.rows();
    const Hessenberg hessenberg(a);
    const Matrix packed = hessenberg.packedMatrix(), h = hessenberg.matrixH();
    Matrix q = Matrix::Identity(n, n);
    Vector workspace(n);
    for (Eigen::Index k = n - 2; k >= 0; k--)
        q.bottomRightCorner(n - k - 1, n - k - 1)
            .applyHouseholderOnTheLeft(packed.col(k).tail(n - k - 2),
                                       hessenberg.householderCoefficients()(k), workspace.data());
    Eigen::ComplexSchur<CMatrix> schur(n);
    schur.computeFromHessenberg(CMatrix(h.cast<Complex>()), CMatrix(q.cast<Complex>()));
    if (schur.info() != Eigen::Success)
        return false;
    t = schur.matrixT();
    u = schur.matrixU();
    return true;
}

Matrix solve_real(const CMatrix &a, const CMatrix &b)
{
    // As twice as many real equations.
    const Eigen::Index n = a.rows();
    Matrix big(2 * n, 2 * n), right(2 * n, b.cols());
    big.topLeftCorner(n, n) = a.real();
    big.topRightCorner(n, n) = -a.imag();
    big.bottomLeftCorner(n, n) = a.imag();
    big.bottomRightCorner(n, n) = a.real();
    right.topRows(n) = b.real();
    right.bottomRows(n) = b.imag();
    return dense::solve(big, right).topRows(n);
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
    // Rows of zeros make it square; their singular values come last.
    CMatrix pencil = CMatrix::Zero(n + b.cols(), n + b.cols());
    pencil.topLeftCorner(n, n) = a.cast<Complex>() - lambda * CMatrix::Identity(n, n);
    pencil.topRightCorner(n, b.cols()) = (b * (input > 0.0 ? size / input : 0.0)).cast<Complex>();
    return singular_values(pencil)(n - 1) / size;
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
