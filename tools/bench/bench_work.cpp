// What tools/bench times besides one trajectory: a plain loop to compare with, derivatives, logs.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <vector>

#include "base/random.h"
#include "bench_pendubot.hpp"
#include "mechkit/log.h"
#include "sim/shoot.hpp"

namespace
{

// The equations as one would write them down.
void slope(double t, const double *x, double *dx)
{
    const double g = 9.81;
    double c2 = std::cos(x[1]), s2 = std::sin(x[1]), v1 = x[2], v2 = x[3];
    double d11 = P[0] + P[1] + 2 * P[2] * c2, d12 = P[1] + P[2] * c2, d22 = P[1];
    double gc12 = P[4] * g * std::cos(x[0] + x[1]);
    double r1 = 1.5 * std::sin(6 * t) - P[5] * v1 - P[6] * std::tanh(15 * v1) +
                P[2] * s2 * (2 * v1 * v2 + v2 * v2) - P[3] * g * std::cos(x[0]) - gc12;
    double r2 = -P[2] * s2 * v1 * v1 - gc12, det = d11 * d22 - d12 * d12;
    dx[0] = v1, dx[1] = v2;
    dx[2] = (d22 * r1 - d12 * r2) / det;
    dx[3] = (d11 * r2 - d12 * r1) / det;
}

void runge_kutta(double t, double *x, double h)
{
    double a[4], b[4], c[4], d[4], y[4];
    slope(t, x, a);
    for (int i = 0; i < 4; i++)
        y[i] = x[i] + 0.5 * h * a[i];
    slope(t + 0.5 * h, y, b);
    for (int i = 0; i < 4; i++)
        y[i] = x[i] + 0.5 * h * b[i];
    slope(t + 0.5 * h, y, c);
    for (int i = 0; i < 4; i++)
        y[i] = x[i] + h * c[i];
    slope(t + h, y, d);
    for (int i = 0; i < 4; i++)
        x[i] += h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]);
}

} // namespace

// Fixed steps of 5 ms / substeps; out: 2001 x 4.
EXPORT void bench_rk4(int substeps, double *out)
{
    double x[4] = {-PI / 2, 0, 0, 0}, h = DT / substeps;
    for (int k = 0; k <= SAMPLES; k++) {
        memcpy(out + 4 * k, x, sizeof x);
        for (int s = 0; s < substeps; s++)
            runge_kutta(DT * k + h * s, x, h);
    }
}

namespace
{

// Shooting over `rows` samples of 5 ms with derivatives by all parameters and start values;
// `jac` (rows - 1 times 2 x 11, may be NULL) gets them.
bool derivatives(size_t rows, double step, double *jac)
{
    mk_model model = pendubot(P);
    std::vector<double> t(rows), u(rows), zero(rows, 0.0), one(rows, 1.0);
    for (size_t k = 0; k < rows; k++) {
        t[k] = DT * (double)k;
        u[k] = 1.5 * std::sin(6.0 * t[k]);
    }
    one[0] = 0.0; // the first row is the start
    mk::ShootData data = {};
    data.rows = rows;
    data.t = t.data();
    data.u[0] = u.data();
    for (int j = 0; j < 2; j++)
        data.q[j] = zero.data(), data.w[j] = one.data();
    int number[7];
    double scale[7], x[4] = {-PI / 2, 0, 0, 0}, x_end[4], jac_end[4 * 11];
    for (int i = 0; i < 7; i++)
        number[i] = i, scale[i] = 1.0;
    std::vector<double> residual(2 * rows), own(jac ? 0 : 2 * rows * 11);
    mk::ShootTask k = {};
    k.model = &model;
    k.data = &data;
    k.end = t.back();
    k.last = true;
    k.x = x;
    k.step = step;
    k.free_count = 7;
    k.free = number;
    k.scale = scale;
    k.columns = 11;
    k.x_end = x_end;
    k.jac_end = jac_end;
    k.row_capacity = 2 * rows;
    k.residual = residual.data();
    k.jac = jac ? jac : own.data();
    mk::shoot(k);
    return k.finite && k.row_count == 2 * (rows - 1);
}

} // namespace

EXPORT int bench_derivatives(double step, double *jac)
{
    return derivatives(SAMPLES + 1, step, jac);
}

// Started anew every 500 s: beyond, derivatives by the start values fade to denormal numbers, which
// take the processor many times as long.
EXPORT int bench_shoot(int rows)
{
    constexpr int STRETCH = 100000;
    bool fine = true;
    for (int done = 0; fine && done < rows; done += STRETCH)
        fine = derivatives((size_t)std::min(rows - done, STRETCH), DT, nullptr);
    return fine;
}

// --- logs ----------------------------------------------------------------------------------------

// Time in the first column, then doubles with all their digits.
EXPORT void bench_numbers(int rows, int columns, double *out)
{
    mk_random random = {7};
    for (int k = 0; k < rows; k++)
        for (int i = 0; i < columns; i++)
            out[(size_t)k * (size_t)columns + (size_t)i] =
                i == 0 ? 0.002 * k : 20.0 * mk_random_uniform(&random) - 10.0;
}

EXPORT int bench_log_write(const char *path, int rows, int columns, const double *numbers)
{
    static const char *const names[] = {"t", "q1", "q2", "u", "dq1", "dq2", "ref", "x", "y", "z"};
    mk_log_writer *w;
    if (mk_log_writer_open(path, true, nullptr, 0, names, (size_t)columns, &w, nullptr) != MK_OK)
        return 0;
    bool fine = true;
    for (int k = 0; k < rows; k++)
        fine = mk_log_writer_row(w, numbers + (size_t)k * (size_t)columns) == MK_OK && fine;
    return mk_log_writer_close(w, nullptr) == MK_OK && fine;
}

EXPORT int bench_log_fprintf(const char *path, int rows, int columns, const double *numbers)
{
    FILE *f = fopen(path, "w");
    for (int k = 0; f && k < rows; k++)
        for (int i = 0; i < columns; i++)
            fprintf(f, "%.17g%c", numbers[(size_t)k * (size_t)columns + (size_t)i],
                    i + 1 < columns ? ',' : '\n');
    return f && fclose(f) == 0;
}

// Rows read; 0: failed.
EXPORT int bench_log_read(const char *path)
{
    mk_log *log;
    if (mk_log_read(path, &log, nullptr) != MK_OK)
        return 0;
    int rows = (int)log->rows;
    mk_log_free(log);
    return rows;
}
