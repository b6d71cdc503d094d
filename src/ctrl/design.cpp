// Gain design: analysis of a linear system, discretisation, the Lyapunov equation.
#include "ctrl/design_priv.hpp"

#include <algorithm>
#include <cmath>

#include "base/dense.hpp"

namespace mk::design
{

static bool all_finite(const double *x, int count)
{
    return std::all_of(x, x + count, [](double v) { return std::isfinite(v); });
}

static bool good_size(int n)
{
    return n >= 1 && n <= MK_DESIGN_MAX;
}

enum mk_status check_system(int n, const double *a, const double *b, mk_error *err)
{
    if (!good_size(n))
        return mk_error_set(err, MK_ERR_INVALID, "a design has 1 to %d states, not %d",
                            MK_DESIGN_MAX, n);
    if (!all_finite(a, n * n) || (b && !all_finite(b, n)))
        return mk_error_set(err, MK_ERR_INVALID, "A and B must be finite");
    return MK_OK;
}

} // namespace mk::design

using namespace mk::design;

int mk_design_controllability(int n, const double *a_in, const double *b_in, double tolerance,
                              double *condition)
{
    int rank = 0;
    double ratio = HUGE_VAL;
    if (check_system(n, a_in, b_in, nullptr) == MK_OK)
        // Out of memory leaves rank 0: nothing is known to be controllable.
        (void)guarded(nullptr, [&] {
            // A^k B grows with k, which says nothing about controllability: columns of unit length.
            Matrix a = matrix_from(a_in, n, n), column = matrix_from(b_in, n, 1), q(n, n);
            for (int i = 0; i < n; i++) {
                column.stableNormalize();
                q.col(i) = column;
                column = mk::dense::product(a, column);
            }
            Vector s = singular_values(q.cast<Complex>());
            double limit = (tolerance > 0.0 ? tolerance : n * 2.3e-16) * s(0);
            rank = static_cast<int>((s.array() > limit).count());
            if (s(n - 1) > 0.0)
                ratio = s(0) / s(n - 1);
            return MK_OK;
        });
    if (condition)
        *condition = ratio;
    return rank;
}

enum mk_status mk_design_poles(int n, const double *a, const double *b, const double *k, double *re,
                               double *im, mk_error *err)
{
    enum mk_status st = check_system(n, a, k ? b : nullptr, err);
    if (st == MK_OK && k && !all_finite(k, n))
        st = mk_error_set(err, MK_ERR_INVALID, "the gains must be finite");
    if (st != MK_OK)
        return st;
    return guarded(err, [&] {
        Matrix closed = matrix_from(a, n, n);
        if (k)
            closed -= mk::dense::product(matrix_from(b, n, 1), matrix_from(k, 1, n));
        CVector poles = eigenvalues(closed);
        std::sort(poles.data(), poles.data() + n, [](Complex x, Complex y) {
            return x.real() != y.real() ? x.real() < y.real() : x.imag() < y.imag();
        });
        for (int i = 0; i < n; i++)
            re[i] = poles(i).real(), im[i] = poles(i).imag();
        return MK_OK;
    });
}

// exp([A B; 0 0] dt) = [A_d B_d; 0 1].
enum mk_status mk_design_c2d(int n, const double *a, const double *b, double dt, double *ad,
                             double *bd, mk_error *err)
{
    enum mk_status st = check_system(n, a, b, err);
    if (st == MK_OK && (!(dt > 0.0) || !std::isfinite(dt)))
        st = mk_error_set(err, MK_ERR_INVALID, "the sample time must be positive");
    if (st != MK_OK)
        return st;
    return guarded(err, [&] {
        Matrix m = Matrix::Zero(n + 1, n + 1);
        m.topLeftCorner(n, n) = matrix_from(a, n, n) * dt;
        m.topRightCorner(n, 1) = matrix_from(b, n, 1) * dt;
        Matrix e = exponential(m);
        if (!e.allFinite())
            return mk_error_set(err, MK_ERR_NUMERIC, "exp(A dt) overflows");
        matrix_to(ad, e.topLeftCorner(n, n));
        matrix_to(bd, e.topRightCorner(n, 1));
        return MK_OK;
    });
}

enum mk_status mk_design_lyapunov(int n, const double *a_in, const double *q_in, double *p,
                                  mk_error *err)
{
    enum mk_status st = check_system(n, a_in, nullptr, err);
    if (st != MK_OK)
        return st;
    return guarded(err, [&] {
        Matrix a = matrix_from(a_in, n, n), q = matrix_from(q_in, n, n), solution;
        if (!q.allFinite() || (q - q.transpose()).norm() > 1e-9 * q.norm())
            return mk_error_set(err, MK_ERR_INVALID, "Q must be finite and symmetric");
        if (!(eigenvalues(a).real().maxCoeff() < 0.0))
            return mk_error_set(err, MK_ERR_NUMERIC, "A is not stable: no such P exists");
        if (!solve_lyapunov(a, q, solution))
            return mk_error_set(err, MK_ERR_NUMERIC, "the Lyapunov equation is singular");
        matrix_to(p, solution);
        return MK_OK;
    });
}
