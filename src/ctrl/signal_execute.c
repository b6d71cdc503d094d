/* The functions that a signal may call, and the stack machine that runs it. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "ctrl/signal_priv.h"

/* --- functions --------------------------------------------------------------------------- */

#define UNARY(name, expression)                                                                    \
    static double f_##name(double t, const double *a)                                              \
    {                                                                                              \
        (void)t;                                                                                   \
        return (expression);                                                                       \
    }
UNARY(sin, sin(a[0]))
UNARY(cos, cos(a[0]))
UNARY(tan, tan(a[0]))
UNARY(exp, exp(a[0]))
UNARY(log, log(a[0]))
UNARY(sqrt, sqrt(a[0]))
UNARY(abs, fabs(a[0]))
UNARY(sign, (a[0] > 0.0) - (a[0] < 0.0))
UNARY(tanh, tanh(a[0]))
UNARY(min, fmin(a[0], a[1]))
UNARY(max, fmax(a[0], a[1]))

static double f_step(double t, const double *a)
{
    return t >= a[0] ? 1.0 : 0.0;
}
static double f_ramp(double t, const double *a)
{
    return t > a[0] ? t - a[0] : 0.0;
}
static double f_pulse(double t, const double *a)
{
    return t >= a[0] && t < a[1] ? 1.0 : 0.0;
}
static double f_square(double t, const double *a)
{
    double x = a[0] * t;
    return x - floor(x) < 0.5 ? 1.0 : -1.0;
}
static double f_saw(double t, const double *a)
{
    double x = a[0] * t;
    return 2.0 * (x - floor(x)) - 1.0;
}

/* Phase is the integral of the swept frequency, so that the sweep ends in a steady sine. */
static double f_chirp(double t, const double *a)
{
    double f0 = a[0], f1 = a[1], length = a[2] > 0.0 ? a[2] : 1e-9;
    double s = fmin(fmax(t, 0.0), length);
    double cycles = f0 * s + 0.5 * (f1 - f0) * s * s / length + f1 * fmax(t - length, 0.0);
    return sin(2.0 * M_PI * cycles);
}

/* A number in [0, 1) from two integers: the same on every machine. */
static double hashed(uint64_t a, uint64_t b)
{
    uint64_t x = a * 0x9e3779b97f4a7c15u + b * 0xbf58476d1ce4e5b9u + 0x94d049bb133111ebu;
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
    return (double)((x ^ (x >> 31)) >> 11) * 0x1p-53;
}

static uint64_t seed_of(double x)
{
    return isfinite(x) ? (uint64_t)(int64_t)fmin(fmax(x, -9e15), 9e15) : 0;
}

/* Schroeder phases keep the peak near that of one sine (M. R. Schroeder 1970): n harmonics of
 * amplitude 1/sqrt(n) peak between 1.2 and 1.5. Divided by 1.2, a peak of 1 to 1.26. */
static double f_multisine(double t, const double *a)
{
    int n = (int)fmin(fmax(a[1], 1.0), 200.0);
    double shift = 2.0 * M_PI * hashed(seed_of(a[2]), 1), sum = 0.0;
    for (int k = 1; k <= n; k++) {
        double phase = -M_PI * k * (k - 1) / n + shift * k;
        sum += cos(2.0 * M_PI * a[0] * k * t + phase);
    }
    return sum / (n == 1 ? 1.0 : 1.2 * sqrt(n));
}

/* Random values at multiples of 1/(2 f), joined by raised cosines: nothing above about f. */
static double f_noise(double t, const double *a)
{
    double x = 2.0 * fabs(a[0]) * t, k = floor(x), s = 0.5 - 0.5 * cos(M_PI * (x - k));
    uint64_t seed = seed_of(a[1]), i = seed_of(k);
    double left = 2.0 * hashed(seed, i) - 1.0, right = 2.0 * hashed(seed, i + 1) - 1.0;
    return left + s * (right - left);
}

const struct signal_function mk_signal_functions[] = {
    {"sin", 1, "sin(x)", f_sin, false},
    {"cos", 1, "cos(x)", f_cos, false},
    {"tan", 1, "tan(x)", f_tan, false},
    {"exp", 1, "exp(x)", f_exp, false},
    {"log", 1, "log(x)", f_log, false},
    {"sqrt", 1, "sqrt(x)", f_sqrt, false},
    {"abs", 1, "abs(x)", f_abs, false},
    {"sign", 1, "sign(x)", f_sign, false},
    {"tanh", 1, "tanh(x)", f_tanh, false},
    {"min", 2, "min(x, y)", f_min, false},
    {"max", 2, "max(x, y)", f_max, false},
    {"step", 1, "step(t0): 0 before, 1 from t0 on", f_step, true},
    {"ramp", 1, "ramp(t0): t - t0 from t0 on", f_ramp, true},
    {"pulse", 2, "pulse(t0, t1): 1 in between", f_pulse, true},
    {"square", 1, "square(f): +-1 at f Hz", f_square, true},
    {"saw", 1, "saw(f): -1 to 1 at f Hz", f_saw, true},
    {"chirp", 3, "chirp(f0, f1, T): sweep from f0 to f1 Hz in T s", f_chirp, true},
    {"multisine", 3, "multisine(f0, n, seed): n harmonics of f0 Hz", f_multisine, true},
    {"noise", 2, "noise(f, seed): band-limited to about f Hz", f_noise, true},
};
const int mk_signal_function_count = sizeof mk_signal_functions / sizeof mk_signal_functions[0];

/* --- the machine --------------------------------------------------------------------------- */

double mk_signal_execute(const struct instruction *code, int count, double t)
{
    double stack[SIGNAL_MAX_DEPTH + 1];
    int top = -1;
    for (int i = 0; i < count; i++) {
        const struct instruction *in = &code[i];
        switch (in->op) {
        case OP_NUMBER:
            stack[++top] = in->value;
            break;
        case OP_TIME:
            stack[++top] = t;
            break;
        case OP_ADD:
            top--, stack[top] += stack[top + 1];
            break;
        case OP_SUB:
            top--, stack[top] -= stack[top + 1];
            break;
        case OP_MUL:
            top--, stack[top] *= stack[top + 1];
            break;
        case OP_DIV:
            top--, stack[top] /= stack[top + 1];
            break;
        case OP_POW:
            top--, stack[top] = pow(stack[top], stack[top + 1]);
            break;
        case OP_NEG:
            stack[top] = -stack[top];
            break;
        case OP_CALL:
            top -= mk_signal_functions[in->function].arguments - 1;
            stack[top] = mk_signal_functions[in->function].call(t, &stack[top]);
            break;
        }
    }
    return stack[0];
}
