// Optimal state feedback: continuous, discrete, and sampled from the continuous problem.
#include "ctrl/design_priv.hpp"

#include <algorithm>
#include <cmath>

#include "base/dense.hpp"

using namespace mk::design;
using namespace mk::dense;

namespace
{

// A problem x' or x+ = A x + B u with cost x'Qx + r u^2.
struct Problem {
    Matrix a, b, q;
    double r;
};

struct Solution {
    Matrix k, p;
};

enum mk_status read_problem(int n, const double *a, const double *b, const double *q, double r,
                            Problem &out, mk_error *err)
{
    out = {matrix_from(a, n, n), matrix_from(b, n, 1), matrix_from(q, n, n), r};
    if (!out.q.allFinite() || (out.q - out.q.transpose()).norm() > 1e-9 * out.q.norm())
        return mk_error_set(err, MK_ERR_INVALID, "Q must be finite and symmetric");
    if (!(r > 0.0) || !std::isfinite(r))
        return mk_error_set(err, MK_ERR_INVALID, "r must be positive");
    if (mk::design::eigenvalues(out.q).real().minCoeff() < -1e-9 * out.q.norm())
        return mk_error_set(err, MK_ERR_INVALID, "Q must not be indefinite");
    return MK_OK;
}

// A stabilising solution exists exactly when B reaches every mode that does not decay, and Q sees
// every mode on the border of stability. `growth` of a mode is > 0 when it grows, 0 on the border.
template <class Growth>
enum mk_status check_solvable(const Problem &s, Growth growth, mk_error *err)
{
    constexpr double BORDER = 1e-7; // a double mode there splits by the root of rounding
    for (Complex mode : mk::design::eigenvalues(s.a)) {
        double g = growth(mode);
        const char *lack = nullptr;
        if (g >= 0.0 && !(reach(s.a, s.b, mode) > OUT_OF_REACH))
            lack = "B does not reach";
        else if (std::abs(g) <= BORDER && !(reach(s.a.transpose(), s.q, mode) > OUT_OF_REACH))
            lack = "Q does not see";
        if (lack)
            return mk_error_set(err, MK_ERR_NUMERIC,
                                "no feedback is optimal: %s the mode at %.4g%+.4gi", lack,
                                mode.real(), mode.imag());
    }
    return MK_OK;
}

enum mk_status no_solution(mk_error *err)
{
    return mk_error_set(err, MK_ERR_NUMERIC, "the Riccati equation could not be solved");
}

// --- continuous ----------------------------------------------------------------------------------

// Stable invariant subspace of the Hamiltonian by ordered Schur vectors (A. J. Laub 1979).
bool riccati_by_schur(const Problem &s, Matrix &p)
{
    const Eigen::Index n = s.a.rows();
    Matrix h(2 * n, 2 * n);
    h.topLeftCorner(n, n) = s.a;
    h.topRightCorner(n, n) = product_transpose(s.b, s.b) / -s.r;
    h.bottomLeftCorner(n, n) = -s.q;
    h.bottomRightCorner(n, n) = -s.a.transpose();
    CMatrix t, u;
    if (!schur_form(h, t, u))
        return false;
    Eigen::Index stable = 0;
    for (Eigen::Index i = 0; i < 2 * n; i++)
        if (t(i, i).real() < 0.0)
            move_up(t, u, i, stable++, nullptr);
    if (stable != n)
        return false;
    const CMatrix x = u.topLeftCorner(n, n).transpose(), y = u.bottomLeftCorner(n, n).transpose();
    Matrix raw = mk::design::solve(x, y).real();
    p = 0.5 * (raw + raw.transpose());
    return p.allFinite();
}

enum mk_status solve_lqr(const Problem &s, Solution &out, mk_error *err)
{
    double size = std::max(s.a.norm(), 1e-300);
    enum mk_status st = check_solvable(
        s, [&](Complex mode) { return mode.real() / size; }, err);
    if (st != MK_OK)
        return st;
    if (!riccati_by_schur(s, out.p))
        return no_solution(err);
    // Newton's method (D. L. Kleinman 1968) squares what error is left.
    for (int i = 0; i < 2; i++) {
        Matrix gain = transpose_product(s.b, out.p) / s.r, next;
        if (!solve_lyapunov(s.a - product(s.b, gain), s.q + transpose_product(gain, gain) * s.r,
                            next))
            break;
        out.p = next;
    }
    out.k = transpose_product(s.b, out.p) / s.r;
    if (!(mk::design::eigenvalues(s.a - product(s.b, out.k)).real().maxCoeff() < 0.0))
        return no_solution(err);
    return MK_OK;
}

// --- discrete ------------------------------------------------------------------------------------

// Structure-preserving doubling for P = A'P(I + GP)^-1 A + Q, G = B B'/r (E. K.-W. Chu, H.-Y. Fan,
// W.-W. Lin, C.-S. Wang 2004): each step doubles the horizon.
bool riccati_by_doubling(const Problem &s, Matrix &p)
{
    const Eigen::Index n = s.a.rows();
    Matrix a = s.a, g = product_transpose(s.b, s.b) / s.r, h = s.q, eye = Matrix::Identity(n, n);
    for (int step = 0; step < 60; step++) {
        const Matrix w = eye + product(g, h), wa = solve(w, a), wg = solve(w, g);
        Matrix more = product(transpose_product(a, h), wa),
               moreg = product_transpose(product(a, wg), a);
        a = product(a, wa);
        h += 0.5 * (more + more.transpose());
        g += 0.5 * (moreg + moreg.transpose());
        if (!h.allFinite())
            return false;
        if (more.norm() <= 1e-15 * h.norm()) {
            p = h;
            return true;
        }
    }
    return false;
}

enum mk_status solve_dlqr(const Problem &s, Solution &out, mk_error *err)
{
    enum mk_status st = check_solvable(
        s, [](Complex mode) { return std::abs(mode) - 1.0; }, err);
    if (st != MK_OK)
        return st;
    if (!riccati_by_doubling(s, out.p))
        return no_solution(err);
    Matrix pb = product(out.p, s.b);
    out.k = transpose_product(pb, s.a) / (s.r + transpose_product(s.b, pb)(0, 0));
    if (!(mk::design::eigenvalues(s.a - product(s.b, out.k)).cwiseAbs().maxCoeff() < 1.0))
        return no_solution(err);
    return MK_OK;
}

// The continuous cost over one sample (C. F. Van Loan 1978):
// integral of x'Qx + r u^2 = [x u]' W [x u] with x and the held u at the sample's start.
Matrix sampled_cost(const Problem &s, double dt)
{
    const Eigen::Index n = s.a.rows(), m = n + 1;
    Matrix f = Matrix::Zero(m, m), w = f, big = Matrix::Zero(2 * m, 2 * m);
    f.topLeftCorner(n, n) = s.a;
    f.topRightCorner(n, 1) = s.b;
    w.topLeftCorner(n, n) = s.q;
    w(n, n) = s.r;
    big.topLeftCorner(m, m) = -f.transpose() * dt;
    big.topRightCorner(m, m) = w * dt;
    big.bottomRightCorner(m, m) = f * dt;
    Matrix e = exponential(big);
    Matrix cost = transpose_product(e.bottomRightCorner(m, m), Matrix(e.topRightCorner(m, m)));
    return 0.5 * (cost + cost.transpose());
}

// The problem at the samples, x+ = A_d x + B_d u with cost [x u]' W [x u]. u = v - N'x/R takes the
// cross term N away; P stays the same.
enum mk_status solve_sampled(const Matrix &ad, const Matrix &bd, const Matrix &w, Solution &out,
                             mk_error *err)
{
    const Eigen::Index n = ad.rows();
    double r = w(n, n);
    Matrix shift = w.bottomLeftCorner(1, n) / r;
    Problem s = {ad - product(bd, shift), bd,
                 w.topLeftCorner(n, n) - transpose_product(shift, shift) * r, r};
    enum mk_status st = solve_dlqr(s, out, err);
    if (st == MK_OK)
        out.k += shift;
    return st;
}

// A command that acts one sample late acts on x+ = [A_d B_d] [x u], which is known when it is
// given: the optimal command is the one without delay, of the state to come.
void look_ahead(const Matrix &ad, const Matrix &bd, const Matrix &w, Solution &s)
{
    Matrix ahead(ad.rows(), ad.cols() + 1);
    ahead.leftCols(ad.cols()) = ad;
    ahead.rightCols(1) = bd;
    s.k = product(s.k, ahead);
    s.p = w + product(transpose_product(ahead, s.p), ahead);
}

} // namespace

enum mk_status mk_design_lqr(int n, const double *a, const double *b, const double *q, double r,
                             double *k, double *p, mk_error *err)
{
    enum mk_status st = check_system(n, a, b, err);
    if (st != MK_OK)
        return st;
    return guarded(err, [&] {
        Problem problem;
        Solution solution;
        enum mk_status ok = read_problem(n, a, b, q, r, problem, err);
        if (ok == MK_OK)
            ok = solve_lqr(problem, solution, err);
        if (ok != MK_OK)
            return ok;
        matrix_to(k, solution.k);
        matrix_to(p, solution.p);
        return MK_OK;
    });
}

enum mk_status mk_design_dlqr(int n, const double *a, const double *b, const double *q, double r,
                              double *k, double *p, mk_error *err)
{
    enum mk_status st = check_system(n, a, b, err);
    if (st != MK_OK)
        return st;
    return guarded(err, [&] {
        Problem problem;
        Solution solution;
        enum mk_status ok = read_problem(n, a, b, q, r, problem, err);
        if (ok == MK_OK)
            ok = solve_dlqr(problem, solution, err);
        if (ok != MK_OK)
            return ok;
        matrix_to(k, solution.k);
        matrix_to(p, solution.p);
        return MK_OK;
    });
}

enum mk_status mk_design_lqrd(int n, const double *a, const double *b, const double *q, double r,
                              double dt, int delay, double *k, double *p, mk_error *err)
{
    double ad_data[MK_DESIGN_MAX * MK_DESIGN_MAX], bd_data[MK_DESIGN_MAX];
    enum mk_status st = mk_design_c2d(n, a, b, dt, ad_data, bd_data, err);
    if (st == MK_OK && (delay < 0 || delay > 1))
        st = mk_error_set(err, MK_ERR_INVALID, "the delay is 0 or 1 sample, not %d", delay);
    if (st != MK_OK)
        return st;
    return guarded(err, [&] {
        Problem problem;
        Solution solution;
        enum mk_status ok = read_problem(n, a, b, q, r, problem, err);
        if (ok != MK_OK)
            return ok;
        Matrix ad = matrix_from(ad_data, n, n), bd = matrix_from(bd_data, n, 1);
        Matrix w = sampled_cost(problem, dt);
        ok = w.allFinite() ? solve_sampled(ad, bd, w, solution, err) : no_solution(err);
        if (ok != MK_OK)
            return ok;
        if (delay)
            look_ahead(ad, bd, w, solution);
        matrix_to(k, solution.k);
        matrix_to(p, solution.p);
        return MK_OK;
    });
}
