// What tools/bench/bench.py times: one simulation by every solver of ours behind one C function,
// and a reference by an independent method (extrapolation in long double, equations written out
// again).
#include <cmath>
#include <cstring>
#include <vector>

#include "bench_pendubot.hpp"

namespace
{

// --- reference -----------------------------------------------------------------------------------

typedef long double Real;

void slope(Real t, const Real *x, Real *dx)
{
    Real p1 = P[0], p2 = P[1], p3 = P[2], p4 = P[3], p5 = P[4], p6 = P[5], p7 = P[6], g = 9.81L;
    Real c2 = cosl(x[1]), s2 = sinl(x[1]), v1 = x[2], v2 = x[3];
    Real d11 = p1 + p2 + 2 * p3 * c2, d12 = p2 + p3 * c2, d22 = p2;
    Real r1 = 1.5L * sinl(6 * t) - p6 * v1 - p7 * tanhl(15 * v1) +
              p3 * s2 * (2 * v1 * v2 + v2 * v2) - p4 * g * cosl(x[0]) - p5 * g * cosl(x[0] + x[1]);
    Real r2 = -p3 * s2 * v1 * v1 - p5 * g * cosl(x[0] + x[1]);
    Real det = d11 * d22 - d12 * d12;
    dx[0] = v1, dx[1] = v2;
    dx[2] = (d22 * r1 - d12 * r2) / det;
    dx[3] = (d11 * r2 - d12 * r1) / det;
}

// Modified midpoint with n substeps (Gragg).
void midpoint(Real t, const Real *x, Real h, int n, Real *out)
{
    Real a[4], b[4], d[4], s = h / n;
    slope(t, x, d);
    for (int i = 0; i < 4; i++)
        a[i] = x[i], b[i] = x[i] + s * d[i];
    for (int k = 1; k < n; k++) {
        slope(t + k * s, b, d);
        for (int i = 0; i < 4; i++) {
            Real next = a[i] + 2 * s * d[i];
            a[i] = b[i], b[i] = next;
        }
    }
    slope(t + h, b, d);
    for (int i = 0; i < 4; i++)
        out[i] = 0.5L * (a[i] + b[i] + s * d[i]);
}

// One step of order 16 by extrapolation over n = 2, 4, .. 16 substeps (Bulirsch, Stoer).
void extrapolate(Real t, Real *x, Real h)
{
    constexpr int ROWS = 8;
    // Neville on the squares of the substep.
    Real work[ROWS][4];
    for (int j = 0; j < ROWS; j++)
        midpoint(t, x, h, 2 * (j + 1), work[j]);
    for (int level = 1; level < ROWS; level++)
        for (int j = ROWS - 1; j >= level; j--) {
            Real ratio = Real(j + 1) / Real(j + 1 - level);
            for (int i = 0; i < 4; i++)
                work[j][i] += (work[j][i] - work[j - 1][i]) / (ratio * ratio - 1);
        }
    memcpy(x, work[ROWS - 1], sizeof work[ROWS - 1]);
}

} // namespace

// out: 2001 x 4, [q1 q2 v1 v2].
EXPORT void bench_reference(double *out)
{
    Real x[4] = {-PI / 2, 0, 0, 0};
    for (int k = 0; k <= SAMPLES; k++) {
        for (int i = 0; i < 4; i++)
            out[k * 4 + i] = static_cast<double>(x[i]);
        for (int s = 0; s < 4; s++)
            extrapolate(k * Real(DT) + s * Real(DT) / 4, x, Real(DT) / 4);
    }
}

// `count` trajectories by the fast path, each from a start of its own; out is the first one, from
// hanging.
EXPORT int bench_many(int count, double tolerance, double *out)
{
    static std::vector<double> x;
    std::vector<double> x0;
    for (int i = 0; i < count; i++)
        x0.insert(x0.end(), {-PI / 2 + 1e-4 * i, -1e-4 * i, 0, 0});
    std::vector<mk_model> models((size_t)count, pendubot(P));
    mk_sine drive = {1.5, 6.0, 0.0};
    mk_batch b = batch_of(models, x0, DT, SAMPLES, tolerance, x);
    b.drive = &drive;
    if (mk_simulate_batch(&b, nullptr) != MK_OK)
        return 0;
    memcpy(out, x.data(), sizeof(double) * (SAMPLES + 1) * 4);
    return 1;
}

// 10 s under u held for 2 ms, as the virtual board runs; solver as in enum mk_solver. The command
// is sampled here, so the result is another trajectory: compare solvers of this function only.
EXPORT int bench_held(int solver, double tolerance, double *out)
{
    mk_model m = pendubot(P);
    mk_sim_config c = {static_cast<enum mk_solver>(solver), tolerance, tolerance * 1e-2};
    mk_sim *sim;
    double x[4] = {-PI / 2, 0, 0, 0};
    if (mk_sim_create(&m, &c, &sim, nullptr) != MK_OK)
        return 0;
    int ok = mk_sim_reset(sim, 0.0, x, nullptr) == MK_OK;
    for (int k = 0; ok && k < 5000; k++) {
        double u[2] = {1.5 * std::sin(6.0 * 0.002 * k), 0.0};
        ok = mk_sim_advance(sim, 0.002 * (k + 1), u, nullptr) == MK_OK;
        memcpy(out + 4 * k, mk_sim_state(sim), sizeof x);
    }
    mk_sim_destroy(sim);
    return ok;
}

// The same held command by the fast path.
EXPORT int bench_fast_held(double tolerance, double *out)
{
    static std::vector<double> u, x;
    if (u.empty())
        for (int k = 0; k < 5000; k++)
            u.insert(u.end(), {1.5 * std::sin(6.0 * 0.002 * k), 0.0});
    const std::vector<mk_model> models = {pendubot(P)};
    const std::vector<double> x0 = {-PI / 2, 0, 0, 0};
    mk_batch b = batch_of(models, x0, 0.002, 5000, tolerance, x);
    b.u = u.data();
    if (mk_simulate_batch(&b, nullptr) != MK_OK)
        return 0;
    memcpy(out, x.data() + 4, sizeof(double) * 5000 * 4);
    return 1;
}
