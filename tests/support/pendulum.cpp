#include "support/pendulum.hpp"

#include <check.h>
#include <cmath>
#include <cstring>

namespace made_up
{

static double acceleration(const Hidden &h, double q, double v, double u)
{
    double command = std::fabs(u) <= h.dead ? 0.0 : u - std::copysign(h.dead, u);
    double torque = command - MGL * std::sin(q - h.tilt) - C * v - F * std::tanh(15.0 * v);
    torque -= h.drag * v * std::fabs(v) + h.cubic * v * v * v;
    if (h.bumper && q > 0.6)
        torque -= std::fmax(0.0, 60.0 * (q - 0.6) + 0.4 * v);
    return torque / J;
}

// Midpoint rule.
void step(const Hidden &h, double &q, double &v, double command)
{
    const double a = acceleration(h, q, v, command);
    const double vm = v + 0.5 * STEP * a, qm = q + 0.5 * STEP * v;
    q += STEP * vm;
    v += STEP * acceleration(h, qm, vm, command);
}

double command_at(double t, int kind)
{
    if (t < 0.0)
        return 0.0;
    if (kind == 0)
        return 3.0 * std::sin(7.3 * t) + 2.0 * std::sin(11.9 * t + 0.7) + std::sin(4.1 * t);
    return 4.5 * std::sin((3.0 + 1.1 * t) * t);
}

mk_log *record(const Hidden &h, int kind, double seconds)
{
    size_t rows = (size_t)(seconds * RATE);
    mk_log *log = nullptr;
    ck_assert_int_eq(mk_log_create(rows, &log), MK_OK);
    double *t = mk_log_add_column(log, "t"), *y = mk_log_add_column(log, "q1");
    double *u = mk_log_add_column(log, "u");
    double q = 0.0, v = 0.0, correction = 0.0;
    int per_row = (int)std::lround(1.0 / (RATE * STEP));
    for (size_t k = 0; k < rows; k++) {
        t[k] = (double)k / RATE;
        u[k] = command_at(t[k], kind);
        if (k == rows / 3 || k == rows / 2)
            correction += k == rows / 3 ? h.missed_count : -h.missed_count;
        y[k] = COUNT * std::round((q + correction) / COUNT);
        for (int i = 0; i < per_row; i++) {
            // The command is held from row to row; what acts is what was sent a delay ago.
            double held = std::floor((t[k] + i * STEP - h.delay) * RATE + 1e-9) / RATE;
            step(h, q, v, command_at(held, kind));
        }
    }
    return log;
}

mk_model pendulum(bool exact)
{
    mk_model model;
    mk_model_default(MK_PLANT_PENDULUM, &model);
    const double truth[4] = {J, MGL, C, F};
    for (int i = 0; i < 4; i++)
        model.parameter[i] = truth[i] * (exact ? 1.0 : i % 2 ? 1.1 : 0.92);
    return model;
}

mk_explanation explained(const mk_model &model, mk_log *train, mk_log *hold, double most_s,
                         bool keep_all)
{
    mk_explanation e;
    mk_error err = MK_ERROR_INIT;
    mk_explain_options options = {};
    options.threads = 2;
    options.most_s = most_s;
    options.rows.keep_all = keep_all;
    enum mk_status st = mk_explain(&model, &train, 1, &hold, hold ? 1 : 0, &options, &e, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    mk_log_free(train);
    mk_log_free(hold);
    return e;
}

mk_explanation explained(const Hidden &h, bool exact, double most_s)
{
    return explained(pendulum(exact), record(h, 0, 6.0), record(h, 1, 5.0), most_s);
}

bool named(const mk_explanation &e, const char *name)
{
    for (int i = 0; i < e.cause_count; i++)
        if (strcmp(e.cause[i].effect->name, name) == 0)
            return true;
    for (int i = 0; i < e.rival_count; i++)
        if (!e.rival[i].distinguishable && strcmp(e.rival[i].effect->name, name) == 0)
            return true;
    return false;
}

} // namespace made_up
