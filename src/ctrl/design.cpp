// Gain design with Eigen behind a C door. Matrices up to 8 x 8 live on the stack; no exception and
// no Eigen type crosses the border.
#include "mechkit/design.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>
#include <unsupported/Eigen/MatrixFunctions>
#include <vector>

namespace
{

constexpr int N = MK_DESIGN_MAX;
using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 2 * N + 2, 2 * N + 2>;
using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 2 * N + 2, 1>;
using CMatrix =
    Eigen::Matrix<std::complex<double>, Eigen::Dynamic, Eigen::Dynamic, 0, 2 * N + 2, 2 * N + 2>;
using CVector = Eigen::Matrix<std::complex<double>, Eigen::Dynamic, 1, 0, 2 * N + 2, 1>;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Complex = std::complex<double>;

Matrix matrix_from(const double *data, int rows, int cols)
{
    return Eigen::Map<const RowMajor>(data, rows, cols);
}

void matrix_to(double *data, const Matrix &m)
{
    if (data)
        Eigen::Map<RowMajor>(data, m.rows(), m.cols()) = m;
}

bool good_size(int n)
{
    return n >= 1 && n <= N;
}

enum mk_status check(int n, const double *a, const double *b, mk_error *err)
{
    if (!good_size(n))
        return mk_error_set(err, MK_ERR_INVALID, "a design has 1 to %d states, not %d", N, n);
    if (!matrix_from(a, n, n).allFinite() || (b && !matrix_from(b, n, 1).allFinite()))
        return mk_error_set(err, MK_ERR_INVALID, "A and B must be finite");
    return MK_OK;
}

// Columns are scaled to unit length first: A^k B grows with the power, which says nothing about
// controllability.
Matrix controllability_matrix(const Matrix &a, const Vector &b)
{
    Matrix q(a.rows(), a.rows());
    Vector column = b;
    for (int i = 0; i < a.rows(); i++) {
        q.col(i) = column;
        column = a * column;
    }
    return q;
}

bool conjugate_pairs(int n, const double *re, const double *im)
{
    std::vector<bool> used(static_cast<size_t>(n), false);
    for (int i = 0; i < n; i++) {
        if (used[static_cast<size_t>(i)] || im[i] == 0.0)
            continue;
        int partner = -1;
        for (int j = 0; j < n; j++)
            if (j != i && !used[static_cast<size_t>(j)] && re[j] == re[i] && im[j] == -im[i])
                partner = j;
        if (partner < 0)
            return false;
        used[static_cast<size_t>(i)] = used[static_cast<size_t>(partner)] = true;
    }
    return true;
}

enum mk_status check_poles(int n, const double *re, const double *im, mk_error *err)
{
    for (int i = 0; i < n; i++)
        if (!std::isfinite(re[i]) || !std::isfinite(im[i]))
            return mk_error_set(err, MK_ERR_INVALID, "pole %d is not finite", i + 1);
    if (!conjugate_pairs(n, re, im))
        return mk_error_set(err, MK_ERR_INVALID, "complex poles must come in conjugate pairs");
    return MK_OK;
}

// --- complex Schur form --------------------------------------------------------------------------

// Exchanges the neighbouring diagonal elements k and k + 1 of an upper triangular T = U* A U by a
// rotation (Golub, Van Loan, Matrix Computations, 7.6.2). `extra`, if any, is a vector in the
// coordinates of U.
void swap_neighbours(CMatrix &t, CMatrix &u, int k, CVector *extra)
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

// Moves diagonal element `from` up to `to`.
void move_up(CMatrix &t, CMatrix &u, int from, int to, CVector *extra)
{
    for (int k = from - 1; k >= to; k--)
        swap_neighbours(t, u, k, extra);
}

// --- equations -----------------------------------------------------------------------------------

// A' P + P A = -Q by vectorisation: at most 8 x 8, so the dense system is small.
bool solve_lyapunov(const Matrix &a, const Matrix &q, Matrix &p)
{
    const Eigen::Index n = a.rows();
    Eigen::MatrixXd big = Eigen::MatrixXd::Zero(n * n, n * n);
    for (Eigen::Index j = 0; j < n; j++)
        for (Eigen::Index i = 0; i < n; i++)
            for (Eigen::Index k = 0; k < n; k++) {
                big(i + j * n, k + j * n) += a(k, i);
                big(i + j * n, i + k * n) += a(k, j);
            }
    Eigen::VectorXd rhs(n * n);
    for (Eigen::Index j = 0; j < n; j++)
        for (Eigen::Index i = 0; i < n; i++)
            rhs(i + j * n) = -q(i, j);
    Eigen::VectorXd solution = big.partialPivLu().solve(rhs);
    if (!solution.allFinite())
        return false;
    p.resize(n, n);
    for (Eigen::Index j = 0; j < n; j++)
        for (Eigen::Index i = 0; i < n; i++)
            p(i, j) = 0.5 * (solution(i + j * n) + solution(j + i * n));
    return true;
}

// Largest real part of the eigenvalues / largest modulus.
double abscissa(const Matrix &a)
{
    return Eigen::MatrixXd(a).eigenvalues().real().maxCoeff();
}
double radius(const Matrix &a)
{
    return Eigen::MatrixXd(a).eigenvalues().cwiseAbs().maxCoeff();
}

enum mk_status check_weights(const Matrix &q, double r, mk_error *err)
{
    if (!q.allFinite() || (q - q.transpose()).norm() > 1e-9 * (1.0 + q.norm()))
        return mk_error_set(err, MK_ERR_INVALID, "Q must be finite and symmetric");
    if (!(r > 0.0) || !std::isfinite(r))
        return mk_error_set(err, MK_ERR_INVALID, "r must be positive");
    Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eig(Eigen::MatrixXd(q), Eigen::EigenvaluesOnly);
    if (eig.eigenvalues().minCoeff() < -1e-9 * (1.0 + q.norm()))
        return mk_error_set(err, MK_ERR_INVALID, "Q must not be indefinite");
    return MK_OK;
}

// Stable invariant subspace of the Hamiltonian (A. J. Laub 1979).
bool riccati_by_schur(const Matrix &a, const Vector &b, const Matrix &q, double r, Matrix &p)
{
    const int n = static_cast<int>(a.rows());
    CMatrix h(2 * n, 2 * n);
    h.topLeftCorner(n, n) = a.cast<Complex>();
    h.topRightCorner(n, n) = (-(b * b.transpose()) / r).cast<Complex>();
    h.bottomLeftCorner(n, n) = (-q).cast<Complex>();
    h.bottomRightCorner(n, n) = (-a.transpose()).cast<Complex>();
    Eigen::ComplexSchur<Eigen::MatrixXcd> schur{Eigen::MatrixXcd(h)};
    if (schur.info() != Eigen::Success)
        return false;
    CMatrix t = schur.matrixT(), u = schur.matrixU();
    int placed = 0;
    for (int i = 0; i < 2 * n; i++)
        if (t(i, i).real() < 0.0)
            move_up(t, u, i, placed++, nullptr);
    if (placed != n)
        return false;
    Eigen::MatrixXcd x = u.topLeftCorner(n, n), y = u.bottomLeftCorner(n, n);
    Eigen::MatrixXcd solution = x.transpose().partialPivLu().solve(y.transpose()).transpose();
    p = solution.real();
    p = Matrix(0.5 * (p + p.transpose()));
    return p.allFinite();
}

// Structure-preserving doubling for P = A'P(I + GP)^-1 A + Q, G = B B'/r (E. K.-W. Chu, H.-Y. Fan,
// W.-W. Lin, C.-S. Wang 2004): converges quadratically.
bool discrete_riccati(const Matrix &a0, const Vector &b, const Matrix &q, double r, Matrix &p)
{
    const Eigen::Index n = a0.rows();
    Matrix a = a0, g = b * b.transpose() / r, h = q, eye = Matrix::Identity(n, n);
    for (int step = 0; step < 60; step++) {
        Eigen::PartialPivLU<Eigen::MatrixXd> w(Eigen::MatrixXd(eye + g * h));
        Matrix wa = w.solve(Eigen::MatrixXd(a)), wg = w.solve(Eigen::MatrixXd(g));
        Matrix more = a.transpose() * h * wa;
        g = Matrix(g + a * wg * a.transpose());
        a = Matrix(a * wa);
        h = Matrix(h + more);
        h = Matrix(0.5 * (h + h.transpose()));
        g = Matrix(0.5 * (g + g.transpose()));
        if (!h.allFinite())
            return false;
        if (more.norm() <= 1e-15 * h.norm())
            break;
    }
    p = h;
    return true;
}

Matrix discrete_gain(const Matrix &a, const Vector &b, double r, const Matrix &p)
{
    return (b.transpose() * p * a) / (r + (b.transpose() * p * b)(0, 0));
}

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

} // namespace

// --- analysis ------------------------------------------------------------------------------------

int mk_design_controllability(int n, const double *a, const double *b, double tolerance,
                              double *condition)
{
    if (!good_size(n))
        return 0;
    Matrix q = controllability_matrix(matrix_from(a, n, n), matrix_from(b, n, 1));
    for (int i = 0; i < n; i++)
        if (q.col(i).norm() > 0.0)
            q.col(i).normalize();
    Eigen::JacobiSVD<Eigen::MatrixXd> svd{Eigen::MatrixXd(q)};
    const auto &s = svd.singularValues();
    double limit = (tolerance > 0.0 ? tolerance : n * 2.3e-16) * s(0);
    int rank = 0;
    for (int i = 0; i < n; i++)
        rank += s(i) > limit;
    if (condition)
        *condition = s(n - 1) > 0.0 ? s(0) / s(n - 1) : HUGE_VAL;
    return rank;
}

enum mk_status mk_design_poles(int n, const double *a, const double *b, const double *k, double *re,
                               double *im, mk_error *err)
{
    enum mk_status st = check(n, a, k ? b : nullptr, err);
    if (st != MK_OK)
        return st;
    return guarded(err, [&] {
        Matrix closed = matrix_from(a, n, n);
        if (k)
            closed -= matrix_from(b, n, 1) * matrix_from(k, 1, n);
        if (!closed.allFinite())
            return mk_error_set(err, MK_ERR_INVALID, "the gains must be finite");
        Eigen::VectorXcd poles = Eigen::MatrixXd(closed).eigenvalues();
        std::sort(poles.data(), poles.data() + n, [](Complex x, Complex y) {
            return x.real() != y.real() ? x.real() < y.real() : x.imag() < y.imag();
        });
        for (int i = 0; i < n; i++)
            re[i] = poles(i).real(), im[i] = poles(i).imag();
        return MK_OK;
    });
}

// --- pole placement ------------------------------------------------------------------------------

enum mk_status mk_design_ackermann(int n, const double *a_in, const double *b_in, const double *re,
                                   const double *im, double *k, mk_error *err)
{
    enum mk_status st = check(n, a_in, b_in, err);
    if (st == MK_OK)
        st = check_poles(n, re, im, err);
    if (st != MK_OK)
        return st;
    return guarded(err, [&] {
        Matrix a = matrix_from(a_in, n, n), q = controllability_matrix(a, matrix_from(b_in, n, 1));
        if (mk_design_controllability(n, a_in, b_in, 1e-12, nullptr) < n)
            return mk_error_set(err, MK_ERR_NUMERIC, "the system is not controllable");
        // phi(A) factor by factor; conjugate factors make the product real.
        CMatrix phi = CMatrix::Identity(n, n);
        for (int i = 0; i < n; i++)
            phi = CMatrix(phi *
                          (a.cast<Complex>() - Complex(re[i], im[i]) * CMatrix::Identity(n, n)));
        // Last row of Q^-1 times phi(A).
        Eigen::VectorXd unit = Eigen::VectorXd::Unit(n, n - 1);
        Eigen::VectorXd row = Eigen::MatrixXd(q.transpose()).fullPivLu().solve(unit);
        matrix_to(k, Matrix(row.transpose() * phi.real()));
        return MK_OK;
    });
}

// One eigenvalue at a time on the complex Schur form: the last one is shifted by feedback of the
// last coordinate alone and moved up out of the way (A. Varga 1981, for one input). Only unitary
// transformations are used, so the closed loop is exact for a nearby A, B.
enum mk_status mk_design_place(int n, const double *a_in, const double *b_in, const double *re,
                               const double *im, double *k, mk_error *err)
{
    enum mk_status st = check(n, a_in, b_in, err);
    if (st == MK_OK)
        st = check_poles(n, re, im, err);
    if (st != MK_OK)
        return st;
    return guarded(err, [&] {
        Eigen::ComplexSchur<Eigen::MatrixXcd> schur{
            Eigen::MatrixXcd(matrix_from(a_in, n, n).cast<Complex>())};
        if (schur.info() != Eigen::Success)
            return mk_error_set(err, MK_ERR_NUMERIC, "the Schur form of A did not converge");
        CMatrix t = schur.matrixT(), u = schur.matrixU();
        CVector b = u.adjoint() * matrix_from(b_in, n, 1).cast<Complex>();
        CMatrix gain = CMatrix::Zero(1, n);
        double scale = b.norm();
        for (int i = 0; i < n; i++) {
            if (!(std::abs(b(n - 1)) > 1e-13 * scale))
                return mk_error_set(err, MK_ERR_NUMERIC, "the system is not controllable");
            Complex shift = (t(n - 1, n - 1) - Complex(re[i], im[i])) / b(n - 1);
            t.col(n - 1) -= b * shift;
            gain += shift * u.col(n - 1).adjoint();
            move_up(t, u, n - 1, i, &b);
        }
        matrix_to(k, Matrix(gain.real()));
        return MK_OK;
    });
}

// --- optimal feedback ----------------------------------------------------------------------------

enum mk_status mk_design_lqr(int n, const double *a_in, const double *b_in, const double *q_in,
                             double r, double *k, double *p_out, mk_error *err)
{
    enum mk_status st = check(n, a_in, b_in, err);
    if (st != MK_OK)
        return st;
    return guarded(err, [&] {
        Matrix a = matrix_from(a_in, n, n), q = matrix_from(q_in, n, n), p;
        Vector b = matrix_from(b_in, n, 1);
        enum mk_status ok = check_weights(q, r, err);
        if (ok != MK_OK)
            return ok;
        if (!riccati_by_schur(a, b, q, r, p))
            return mk_error_set(err, MK_ERR_NUMERIC,
                                "no stabilising solution: is (A, B) stabilisable and (A, Q) "
                                "detectable?");
        // Newton (D. L. Kleinman 1968) squares what error is left.
        for (int i = 0; i < 2; i++) {
            Matrix gain = b.transpose() * p / r, closed = a - b * gain, next;
            if (!solve_lyapunov(closed, q + gain.transpose() * r * gain, next))
                break;
            p = next;
        }
        Matrix gain = b.transpose() * p / r;
        if (!(abscissa(a - b * gain) < 0.0))
            return mk_error_set(err, MK_ERR_NUMERIC, "the optimal feedback does not stabilise");
        matrix_to(k, gain);
        matrix_to(p_out, p);
        return MK_OK;
    });
}

enum mk_status mk_design_c2d(int n, const double *a, const double *b, double dt, double *ad,
                             double *bd, mk_error *err)
{
    enum mk_status st = check(n, a, b, err);
    if (st != MK_OK)
        return st;
    if (!(dt > 0.0) || !std::isfinite(dt))
        return mk_error_set(err, MK_ERR_INVALID, "the sample time must be positive");
    return guarded(err, [&] {
        Eigen::MatrixXd m = Eigen::MatrixXd::Zero(n + 1, n + 1);
        m.topLeftCorner(n, n) = matrix_from(a, n, n) * dt;
        m.topRightCorner(n, 1) = matrix_from(b, n, 1) * dt;
        Eigen::MatrixXd e = m.exp();
        if (!e.allFinite())
            return mk_error_set(err, MK_ERR_NUMERIC, "exp(A dt) overflows");
        matrix_to(ad, Matrix(e.topLeftCorner(n, n)));
        matrix_to(bd, Matrix(e.topRightCorner(n, 1)));
        return MK_OK;
    });
}

static enum mk_status solve_dlqr(const Matrix &a, const Vector &b, const Matrix &q, double r,
                                 Matrix &gain, Matrix &p, mk_error *err)
{
    if (!discrete_riccati(a, b, q, r, p))
        return mk_error_set(err, MK_ERR_NUMERIC, "no stabilising solution of the Riccati equation");
    gain = discrete_gain(a, b, r, p);
    if (!(radius(a - b * gain) < 1.0))
        return mk_error_set(err, MK_ERR_NUMERIC, "the optimal feedback does not stabilise");
    return MK_OK;
}

enum mk_status mk_design_dlqr(int n, const double *a, const double *b, const double *q, double r,
                              double *k, double *p, mk_error *err)
{
    enum mk_status st = check(n, a, b, err);
    if (st == MK_OK)
        st = check_weights(matrix_from(q, n, n), r, err);
    if (st != MK_OK)
        return st;
    return guarded(err, [&] {
        Matrix gain, solution;
        enum mk_status ok = solve_dlqr(matrix_from(a, n, n), matrix_from(b, n, 1),
                                       matrix_from(q, n, n), r, gain, solution, err);
        if (ok == MK_OK) {
            matrix_to(k, gain);
            matrix_to(p, solution);
        }
        return ok;
    });
}

// The continuous cost over one sample (C. F. Van Loan 1978):
// integral of [x u]' diag(Q, r) [x u] = [x u]' W [x u] with x, u at the sample's start.
static Eigen::MatrixXd sampled_cost(const Matrix &a, const Vector &b, const Matrix &q, double r,
                                    double dt)
{
    const Eigen::Index n = a.rows(), m = n + 1;
    Eigen::MatrixXd f = Eigen::MatrixXd::Zero(m, m), w = f,
                    big = Eigen::MatrixXd::Zero(2 * m, 2 * m);
    f.topLeftCorner(n, n) = a;
    f.topRightCorner(n, 1) = b;
    w.topLeftCorner(n, n) = q;
    w(n, n) = r;
    big.topLeftCorner(m, m) = -f.transpose() * dt;
    big.topRightCorner(m, m) = w * dt;
    big.bottomRightCorner(m, m) = f * dt;
    Eigen::MatrixXd e = big.exp();
    return e.bottomRightCorner(m, m).transpose() * e.topRightCorner(m, m);
}

enum mk_status mk_design_lqrd(int n, const double *a_in, const double *b_in, const double *q_in,
                              double r, double dt, int delay, double *k, double *p_out,
                              mk_error *err)
{
    enum mk_status st = check(n, a_in, b_in, err);
    if (st == MK_OK)
        st = check_weights(matrix_from(q_in, n, n), r, err);
    if (st == MK_OK && (delay < 0 || delay > 1 || n + delay > N))
        st = mk_error_set(err, MK_ERR_INVALID, "the delay is 0 or 1 sample");
    double ad_data[N * N], bd_data[N];
    if (st == MK_OK)
        st = mk_design_c2d(n, a_in, b_in, dt, ad_data, bd_data, err);
    if (st != MK_OK)
        return st;
    return guarded(err, [&] {
        Matrix ad = matrix_from(ad_data, n, n), gain, p;
        Vector bd = matrix_from(bd_data, n, 1);
        Eigen::MatrixXd w = sampled_cost(matrix_from(a_in, n, n), matrix_from(b_in, n, 1),
                                         matrix_from(q_in, n, n), r, dt);
        enum mk_status ok;
        if (delay == 0) {
            // u = v - R^-1 N' x takes the cross term N away.
            Vector cross = w.topRightCorner(n, 1);
            double rd = w(n, n);
            Matrix shift = cross.transpose() / rd;
            ok = solve_dlqr(ad - bd * shift, bd,
                            w.topLeftCorner(n, n) - cross * cross.transpose() / rd, rd, gain, p,
                            err);
            gain = Matrix(gain + shift);
        } else {
            // The command on its way is a state: its cost is counted when it acts. A command issued
            // now costs next to nothing until then.
            Matrix a = Matrix::Zero(n + 1, n + 1);
            a.topLeftCorner(n, n) = ad;
            a.topRightCorner(n, 1) = bd;
            Vector b = Vector::Unit(n + 1, n);
            ok = solve_dlqr(a, b, w, 1e-6 * w(n, n), gain, p, err);
        }
        if (ok == MK_OK) {
            matrix_to(k, gain);
            matrix_to(p_out, p);
        }
        return ok;
    });
}

enum mk_status mk_design_lyapunov(int n, const double *a_in, const double *q, double *p,
                                  mk_error *err)
{
    enum mk_status st = check(n, a_in, nullptr, err);
    if (st != MK_OK)
        return st;
    return guarded(err, [&] {
        Matrix a = matrix_from(a_in, n, n), solution;
        if (!(abscissa(a) < 0.0))
            return mk_error_set(err, MK_ERR_NUMERIC, "A is not stable: no such P exists");
        if (!solve_lyapunov(a, matrix_from(q, n, n), solution))
            return mk_error_set(err, MK_ERR_NUMERIC, "the Lyapunov equation is singular");
        matrix_to(p, solution);
        return MK_OK;
    });
}
