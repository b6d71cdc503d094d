// What the files of gain design share: the C border (arrays in, status out, no exception through)
// and the decompositions. Those are compiled once, in design_matrix.cpp: they are most of Eigen's
// cost in compile time and memory. Only the design*.cpp files include this.
#ifndef MECHKIT_CTRL_DESIGN_PRIV_HPP
#define MECHKIT_CTRL_DESIGN_PRIV_HPP

#include "mechkit/design.h"

#include <Eigen/Core>
#include <complex>
#include <new>

namespace mk::design
{

using Complex = std::complex<double>;
using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;
using CMatrix = Eigen::MatrixXcd;
using CVector = Eigen::VectorXcd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

inline Matrix matrix_from(const double *data, Eigen::Index rows, Eigen::Index cols)
{
    return Eigen::Map<const RowMajor>(data, rows, cols);
}

// A NULL target is a result that the caller does not want.
inline void matrix_to(double *data, const Matrix &m)
{
    if (data)
        Eigen::Map<RowMajor>(data, m.rows(), m.cols()) = m;
}

// Runs f, which returns a status; what it throws becomes one.
template <class F>
enum mk_status guarded(mk_error *err, F &&f)
{
    try {
        return f();
    } catch (const std::bad_alloc &) {
        return mk_error_set(err, MK_ERR_NOMEM, "out of memory");
    } catch (...) {
        return mk_error_set(err, MK_ERR_NUMERIC, "the design failed");
    }
}

// 1 <= n <= MK_DESIGN_MAX, A and B (NULL: not looked at) finite.
enum mk_status check_system(int n, const double *a, const double *b, mk_error *err);

CVector eigenvalues(const Matrix &a);
Vector singular_values(const CMatrix &m);

// exp(A) by scaling and squaring of a Pade approximant (N. J. Higham 2005).
Matrix exponential(const Matrix &a);

// A = U T U* with T upper triangular; false when it does not converge.
bool schur_form(const Matrix &a, CMatrix &t, CMatrix &u);

// x of a x = b, by LU with partial pivoting.
CMatrix solve(const CMatrix &a, const CMatrix &b);

// Moves the eigenvalue at `from` up to `to` in a Schur form; those between slide down by one.
// `extra`, if any, is a vector in the coordinates of U.
void move_up(CMatrix &t, CMatrix &u, Eigen::Index from, Eigen::Index to, CVector *extra);

// Hautus: the mode `lambda` of A is out of reach of B exactly when [A - lambda I, B] loses rank.
// Returns its smallest singular value, relative to the size of A; B is scaled to that size first,
// since a weak motor still reaches. With A', Q' in place of A, B: whether Q sees the mode.
double reach(const Matrix &a, const Matrix &b, Complex lambda);

// Below this a mode counts as out of reach: rounding alone leaves about n eps.
constexpr double OUT_OF_REACH = 1e-13;

// A' P + P A = -Q for symmetric Q; false when singular.
bool solve_lyapunov(const Matrix &a, const Matrix &q, Matrix &p);

} // namespace mk::design

#endif
