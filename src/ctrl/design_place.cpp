// Pole placement: Ackermann's formula, and one eigenvalue at a time on the Schur form.
#include "ctrl/design_priv.hpp"

#include <cmath>

#include "base/dense.hpp"

using namespace mk::design;

static bool conjugate_pairs(int n, const double *re, const double *im)
{
    bool used[MK_DESIGN_MAX] = {};
    for (int i = 0; i < n; i++) {
        if (used[i] || im[i] == 0.0)
            continue;
        int partner = i + 1;
        while (partner < n && (used[partner] || re[partner] != re[i] || im[partner] != -im[i]))
            partner++;
        if (partner == n)
            return false;
        used[partner] = true;
    }
    return true;
}

static enum mk_status check_poles(int n, const double *re, const double *im, mk_error *err)
{
    for (int i = 0; i < n; i++)
        if (!std::isfinite(re[i]) || !std::isfinite(im[i]))
            return mk_error_set(err, MK_ERR_INVALID, "pole %d is not finite", i + 1);
    if (!conjugate_pairs(n, re, im))
        return mk_error_set(err, MK_ERR_INVALID, "complex poles must come in conjugate pairs");
    return MK_OK;
}

// Every pole can be moved only if every mode is in reach.
static enum mk_status check_reach(const Matrix &a, const Matrix &b, const CVector &modes,
                                  mk_error *err)
{
    for (Complex mode : modes)
        if (!(reach(a, b, mode) > OUT_OF_REACH))
            return mk_error_set(err, MK_ERR_NUMERIC,
                                "the system is not controllable: B does not reach the mode at "
                                "%.4g%+.4gi",
                                mode.real(), mode.imag());
    return MK_OK;
}

// K = e_n' [B AB .. A^(n-1) B]^-1 phi(A), phi the wanted polynomial (J. Ackermann 1972).
enum mk_status mk_design_ackermann(int n, const double *a_in, const double *b_in, const double *re,
                                   const double *im, double *k, mk_error *err)
{
    enum mk_status st = check_system(n, a_in, b_in, err);
    if (st == MK_OK)
        st = check_poles(n, re, im, err);
    if (st != MK_OK)
        return st;
    return guarded(err, [&] {
        Matrix a = matrix_from(a_in, n, n), b = matrix_from(b_in, n, 1), q(n, n);
        enum mk_status reached = check_reach(a, b, eigenvalues(a), err);
        if (reached != MK_OK)
            return reached;
        q.col(0) = b;
        for (int i = 1; i < n; i++)
            q.col(i) = mk::dense::product(a, Vector(q.col(i - 1)));
        // Columns of unit length: pivots then compare like with like.
        Vector size = q.colwise().norm();
        q.array().rowwise() /= size.transpose().array();
        Vector last = Vector::Unit(n, n - 1) / size(n - 1);
        Vector first = mk::dense::solve(q.transpose(), last);
        // phi(A) factor by factor; conjugate factors make the product real.
        CMatrix row = first.transpose().cast<Complex>(), ac = a.cast<Complex>();
        for (int i = 0; i < n; i++)
            row = (row * ac - Complex(re[i], im[i]) * row).eval();
        Matrix gain = row.real();
        if (!gain.allFinite())
            return mk_error_set(err, MK_ERR_NUMERIC,
                                "the controllability matrix is too near singular");
        matrix_to(k, gain);
        return MK_OK;
    });
}

// One eigenvalue at a time (A. Varga 1981, for one input): on the complex Schur form, feedback of
// the last coordinate shifts the last eigenvalue alone, which is then moved up out of the way. Only
// unitary transformations are used, where Ackermann's formula inverts a matrix of powers of A.
enum mk_status mk_design_place(int n, const double *a_in, const double *b_in, const double *re,
                               const double *im, double *k, mk_error *err)
{
    enum mk_status st = check_system(n, a_in, b_in, err);
    if (st == MK_OK)
        st = check_poles(n, re, im, err);
    if (st != MK_OK)
        return st;
    return guarded(err, [&] {
        Matrix a = matrix_from(a_in, n, n), input = matrix_from(b_in, n, 1);
        CMatrix t, u;
        if (!schur_form(a, t, u))
            return mk_error_set(err, MK_ERR_NUMERIC, "the Schur form of A did not converge");
        enum mk_status reached = check_reach(a, input, t.diagonal(), err);
        if (reached != MK_OK)
            return reached;
        CVector b = u.adjoint() * input.cast<Complex>();
        CMatrix gain = CMatrix::Zero(1, n);
        for (int i = 0; i < n; i++) {
            Complex shift = (t(n - 1, n - 1) - Complex(re[i], im[i])) / b(n - 1);
            t.col(n - 1) -= b * shift;
            gain += shift * u.col(n - 1).adjoint();
            move_up(t, u, n - 1, i, &b);
        }
        if (!gain.allFinite())
            return mk_error_set(err, MK_ERR_NUMERIC, "the system is too nearly uncontrollable");
        matrix_to(k, gain.real());
        return MK_OK;
    });
}
