#include "ident/stepper.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/dense.hpp"

namespace mk
{

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double FARTHEST = 2.5; // times its value, in one step
constexpr double TURN = 0.5;     // rad, of a zero or a tilt in one step

Stepper::Stepper(const mk_model &m, const std::vector<int> &f) : model(m), free(f)
{
    long n = (long)f.size();
    scale.resize(n), low.resize(n), high.resize(n);
    for (long i = 0; i < n; i++) {
        char name[64];
        int number = f[(size_t)i];
        const mk_parameter_info *info = mk_model_parameter_info(&m, number, name, sizeof name);
        double v = mk_model_parameter(&m, number);
        scale(i) = Fit::scale_of(m, number);
        low(i) = (info->min - v) / scale(i);
        high(i) = (info->max - v) / scale(i);
        // What cannot be nothing (a time constant, a speed) is known by its order of magnitude:
        // no straight line reaches far in it.
        if (info->min > 0.0) {
            low(i) = std::max(low(i), (1.0 / FARTHEST - 1.0) * v / scale(i));
            high(i) = std::min(high(i), (FARTHEST - 1.0) * v / scale(i));
        }
    }
    turn.setIdentity(n, n);
    keep_zeros_near();
    find_pairs();
}

// The zero of an encoder, the direction of gravity: half a turn further there is another optimum,
// with moments of the other sign, which no step may leap to.
void Stepper::keep_zeros_near()
{
    int number = mk_plant(model.plant)->parameter_count;
    for (int e = 0; e < model.effect_count; e++) {
        const mk_effect_info *info = mk_effect(model.effect[e].index);
        for (int k = 0; k < info->parameter_count; k++, number++) {
            const mk_parameter_info &p = info->parameter[k];
            const long i = place_of(number);
            if (i < 0 || p.fit != MK_FIT_FREE || std::strcmp(p.unit, "rad") != 0 || p.min >= 0.0)
                continue;
            const int joint = model.effect[e].joint;
            const double far = TURN * (joint > 0 ? mk_model_joint_scale(&model, joint - 1) : 1.0);
            low(i) = std::max(low(i), -far / scale(i));
            high(i) = std::min(high(i), far / scale(i));
        }
    }
}

VectorXd Stepper::solve(const QuadraticModel &p, double damping) const
{
    MatrixXd information = dense::product(dense::transpose_product(turn, p.information), turn);
    VectorXd gradient = dense::transpose_product(turn, p.gradient);
    long n = gradient.size();
    VectorXd step = VectorXd::Zero(n);
    std::vector<bool> held((size_t)n, false);
    for (long round = 0; round <= n; round++) {
        std::vector<long> open;
        for (long i = 0; i < n; i++)
            if (!held[(size_t)i])
                open.push_back(i);
        long m = (long)open.size();
        if (m == 0)
            break;
        MatrixXd H(m, m);
        VectorXd g(m);
        for (long i = 0; i < m; i++) {
            g(i) = gradient(open[(size_t)i]);
            for (long j = 0; j < n; j++)
                if (held[(size_t)j])
                    g(i) -= information(open[(size_t)i], j) * step(j);
            for (long j = 0; j < m; j++)
                H(i, j) = information(open[(size_t)i], open[(size_t)j]);
            H(i, i) += damping * std::max(H(i, i), 1e-12) + 1e-12;
        }
        VectorXd s = dense::solve_symmetric(H, g);
        bool inside = true;
        for (long i = 0; i < m; i++) {
            long k = open[(size_t)i];
            step(k) = std::min(std::max(s(i), low(k)), high(k));
            if (step(k) != s(i)) {
                held[(size_t)k] = true;
                inside = false;
            }
        }
        if (inside)
            break;
    }
    return step;
}

void Stepper::apply(mk_model &m, const VectorXd &step) const
{
    std::vector<double> v;
    for (long i = 0; i < step.size(); i++)
        v.push_back(mk_model_parameter(&m, free[(size_t)i]) + step(i) * scale(i));
    for (const Pair &p : pairs) {
        double a = mk_model_parameter(&m, free[(size_t)p.size]);
        double b = mk_model_parameter(&m, free[(size_t)p.other]);
        double da = step(p.size) * scale(p.size), db = step(p.other) * scale(p.size);
        double &size = v[(size_t)p.size], &other = v[(size_t)p.other];
        if (p.polar) {
            double x = a * std::cos(b) + da, y = a * std::sin(b) + db;
            size = std::hypot(x, y);
            other = std::atan2(y, x);
        } else {
            size = std::max(a + da, 1e-3 * scale(p.size));
            other = p.reference + (a * (b - p.reference) + db) / size;
        }
    }
    for (long i = 0; i < step.size(); i++) {
        char name[64];
        int number = free[(size_t)i];
        const mk_parameter_info *info = mk_model_parameter_info(&m, number, name, sizeof name);
        mk_model_set_parameter(&m, number, std::min(std::max(v[(size_t)i], info->min), info->max));
    }
}

long Stepper::place_of(int number) const
{
    auto it = std::find(free.begin(), free.end(), number);
    return it == free.end() ? -1 : (long)(it - free.begin());
}

void Stepper::find_pairs()
{
    int first = mk_plant(model.plant)->parameter_count;
    for (int e = 0; e < model.effect_count; e++) {
        const mk_effect_info *info = mk_effect(model.effect[e].index);
        for (int k = 1; k < info->parameter_count; k++) {
            bool polar = info->parameter[k].fit == MK_FIT_ANGLE;
            bool centre = info->parameter[k].fit == MK_FIT_CENTRE;
            long size = place_of(first), other = place_of(first + k);
            if ((polar || centre) && size >= 0 && other >= 0)
                add(e, size, other, polar);
        }
        first += info->parameter_count;
    }
}

void Stepper::add(int e, long size, long other, bool polar)
{
    int j = std::max(model.effect[e].joint - 1, 0);
    Pair p = {size, other, polar, mk_plant(model.plant)->rest[j]};
    double a = mk_model_parameter(&model, free[(size_t)size]);
    double b = mk_model_parameter(&model, free[(size_t)other]);
    double s = scale(size), t = scale(other);
    a = std::max(std::fabs(a), 1e-6 * s);
    if (polar) {
        turn(size, size) = std::cos(b);
        turn(size, other) = std::sin(b);
        turn(other, size) = -std::sin(b) / a * s / t;
        turn(other, other) = std::cos(b) / a * s / t;
        low(size) = -HUGE_VAL, high(size) = HUGE_VAL;
    } else {
        turn(other, size) = -(b - p.reference) / a * s / t;
        turn(other, other) = 1.0 / a * s / t;
    }
    low(other) = -HUGE_VAL, high(other) = HUGE_VAL;
    pairs.push_back(p);
}

} // namespace mk
