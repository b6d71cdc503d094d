#include "sim/stiffness.h"

#include <cmath>
#include <cstring>

#include "model/rhs.hpp"

namespace
{

constexpr double MOTION = 10.0; // rad/s

// Squarings of the matrix: ||A^64||^(1/64) is within a few per cent of the largest |eigenvalue|,
// where the norm of A itself may be off by orders (an oscillator's is its stiffness).
constexpr int SQUARINGS = 6;

double largest(const double *a, int n)
{
    double norm = 0.0;
    for (int i = 0; i < n * n; i++)
        norm = std::fmax(norm, std::fabs(a[i]));
    return norm;
}

void square(double *a, int n)
{
    double b[MK_MAX_STATES * MK_MAX_STATES] = {0.0};
    for (int i = 0; i < n; i++)
        for (int k = 0; k < n; k++)
            for (int j = 0; j < n; j++)
                b[i * n + j] += a[i * n + k] * a[k * n + j];
    std::memcpy(a, b, (size_t)(n * n) * sizeof *a);
}

// With the scale taken out before each squaring: A^m = std::exp(log_scale) a.
double spectral_radius(double *a, int n)
{
    double log_scale = 0.0, power = 1.0;
    for (int k = 0; k <= SQUARINGS; k++) {
        double norm = largest(a, n);
        if (!(norm > 0.0) || !std::isfinite(norm))
            return norm;
        log_scale += std::log(norm) / power;
        for (int i = 0; i < n * n; i++)
            a[i] /= norm;
        square(a, n);
        power *= 2.0;
    }
    return std::exp(log_scale);
}

double rate_at(const mk_model *model, const double *v)
{
    double x[MK_MAX_STATES], jacobian[MK_MAX_STATES * MK_MAX_STATES];
    const mk::Compiled<double> compiled = mk::compile<double>(*model);
    const double u[MK_MAX_INPUTS] = {0.0, 0.0};
    mk_model_initial_state(model, mk_plant(model->plant)->rest, v, x);
    mk_model_jacobian(model, 0.0, x, u, jacobian, NULL, NULL);
    // Of effects with states the Jacobian at rest says too little.
    return std::fmax(spectral_radius(jacobian, mk_model_state_count(model)),
                     mk::fastest_rate(compiled, 0.0, x));
}

} // namespace

double mk_model_fastest_rate(const mk_model *model)
{
    double still[MK_MAX_JOINTS] = {0.0, 0.0}, fastest = rate_at(model, still);
    for (int j = 0; j < mk_model_joints(model); j++)
        for (int side = -1; side <= 1; side += 2) {
            double v[MK_MAX_JOINTS] = {0.0, 0.0};
            v[j] = side * MOTION * mk_model_joint_scale(model, j);
            fastest = std::fmax(fastest, rate_at(model, v));
        }
    return fastest;
}

// Index of the effect that makes the model fast; -1: the base parameters do.
static int culprit(const mk_model *model)
{
    int found = -1;
    double slowest = mk_model_fastest_rate(model);
    for (int i = 0; i < model->effect_count; i++) {
        mk_model without = *model;
        without.effect_count--;
        std::memmove(without.effect + i, without.effect + i + 1,
                     (size_t)(without.effect_count - i) * sizeof without.effect[0]);
        double rate = mk_model_fastest_rate(&without);
        if (rate < 0.9 * slowest) {
            slowest = rate;
            found = i;
        }
    }
    return found;
}

enum mk_status mk_model_check_stiffness(const mk_model *model, mk_error *err)
{
    double rate = mk_model_fastest_rate(model);
    if (rate <= MK_FASTEST_RATE)
        return MK_OK;
    int i = culprit(model);
    return mk_error_set(err, MK_ERR_RANGE,
                        "the model is too stiff to be simulated: %s%s %s it change at %.2g /s, at "
                        "most %.2g /s can be "
                        "followed",
                        i < 0 ? "the plant's parameters" : "effect ",
                        i < 0 ? "" : mk_effect(model->effect[i].index)->name,
                        i < 0 ? "make" : "makes", rate, MK_FASTEST_RATE);
}
