// Free swings: the natural frequency from the times between turning points, corrected for the
// amplitude, and from a fit of the pendulum's law.
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "base/dense.hpp"
#include "ident/measure.hpp"
#include "mechkit/ident.h"

namespace mk
{

namespace
{

constexpr double PI = 3.14159265358979323846;
constexpr double SMALLEST_SWING = 0.03; // rad: below, counts and friction decide
constexpr double LARGEST_SWING = 1.5;   // rad: beyond, half swings differ too much
constexpr double STILL = 0.3;           // rad/s, of a wheel that is locked by its friction

struct Turn {
    double t, q;
};

// A part of a log without command, from its first turning point to its last.
struct Swing {
    size_t log;
    std::vector<Turn> turns;
    std::vector<double> t, q; // readings from the first turn on
};

// Rigs that do not swing freely have been refused by the table.
mk_free_swing pendulum_of(const mk_model &m)
{
    mk_free_swing swing = {};
    mk_plant_free_swing(&m, &swing);
    return swing;
}

double omega_of(const mk_model &m)
{
    mk_free_swing swing = pendulum_of(m);
    return std::sqrt(swing.moment / swing.inertia);
}

bool free_row(const MeasureProblem &problem, const mk_record &rec, size_t k)
{
    return !rec.u[0] || std::isnan(rec.u[0][k]) ||
           std::fabs(rec.u[0][k]) < 1e-3 * problem.model.u_max;
}

// The joint that has to stands still, a wheel on its pendulum, over the tenth of a second from row
// k on.
bool locked_row(const MeasureProblem &problem, const mk_record &rec, size_t k)
{
    int j = pendulum_of(problem.model).locked_joint;
    if (j < 0)
        return true;
    size_t last = k;
    while (last + 1 < rec.rows && rec.t[last] < rec.t[k] + 0.1)
        last++;
    double v = (rec.q[j][last] - rec.q[j][k]) / (rec.t[last] - rec.t[k]);
    return last == k || !(std::fabs(v) > STILL);
}

// Vertex of a cubic through the readings within `half` of row k; false: none near.
bool vertex(const std::vector<double> &t, const std::vector<double> &q, size_t k, double half,
            Turn &out)
{
    Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
    Eigen::Vector4d right = Eigen::Vector4d::Zero();
    for (size_t i = k; i-- > 0 && t[i] > t[k] - half;) {
        double s = (t[i] - t[k]) / half;
        Eigen::Vector4d row(1.0, s, s * s, s * s * s);
        normal += row * row.transpose();
        right += (q[i] - q[k]) * row;
    }
    for (size_t i = k; i < t.size() && t[i] < t[k] + half; i++) {
        double s = (t[i] - t[k]) / half;
        Eigen::Vector4d row(1.0, s, s * s, s * s * s);
        normal += row * row.transpose();
        right += (q[i] - q[k]) * row;
    }
    Eigen::Vector4d c = dense::solve_symmetric(normal, Eigen::VectorXd(right));
    double s = 0.0;
    for (int i = 0; i < 8; i++)
        s -= (c(1) + s * (2.0 * c(2) + 3.0 * s * c(3))) / (2.0 * c(2) + 6.0 * s * c(3));
    out.t = t[k] + half * s;
    out.q = q[k] + c(0) + s * (c(1) + s * (c(2) + s * c(3)));
    return std::isfinite(s) && std::fabs(s) < 0.7;
}

// Turning points: the farthest readings between passages through the middle of the swing.
std::vector<Turn> turning_points(const std::vector<double> &t, const std::vector<double> &q,
                                 double period)
{
    std::vector<Turn> turns;
    double half = period / 10.0;
    size_t reach = 0;
    while (reach < t.size() && t[reach] < t[0] + 0.2 * period)
        reach++;
    for (size_t k = reach; k + reach < q.size(); k++) {
        auto first = q.begin() + (std::ptrdiff_t)(k - reach);
        auto last = q.begin() + (std::ptrdiff_t)(k + reach + 1);
        auto low = std::min_element(first, last), high = std::max_element(first, last);
        Turn turn;
        bool turned = low - q.begin() == (std::ptrdiff_t)k || high - q.begin() == (std::ptrdiff_t)k;
        if (!turned || *high - *low < 0.3 * SMALLEST_SWING || !vertex(t, q, k, half, turn))
            continue;
        if (turns.empty() || turn.t > turns.back().t + 0.3 * period)
            turns.push_back(turn);
    }
    return turns;
}

// Leaves what lies between the first and the last turn of usable swings.
bool trim(Swing &s, double period)
{
    s.turns = turning_points(s.t, s.q, period);
    std::vector<Turn> &turns = s.turns;
    auto swing = [&](size_t i) { return 0.5 * std::fabs(turns[i + 1].q - turns[i].q); };
    size_t first = 0, last;
    while (first + 1 < turns.size() && swing(first) > LARGEST_SWING)
        first++;
    for (last = first; last + 1 < turns.size() && swing(last) > SMALLEST_SWING; last++)
        ;
    if (last < first + 2)
        return false;
    turns.assign(turns.begin() + (std::ptrdiff_t)first, turns.begin() + (std::ptrdiff_t)last + 1);
    std::vector<double> t, q;
    for (size_t k = 0; k < s.t.size(); k++)
        if (s.t[k] >= turns.front().t && s.t[k] <= turns.back().t) {
            t.push_back(s.t[k]);
            q.push_back(s.q[k]);
        }
    s.t = std::move(t);
    s.q = std::move(q);
    return s.t.size() > 20;
}

std::vector<Swing> find_swings(const MeasureProblem &problem)
{
    std::vector<Swing> swings;
    double period = 2.0 * PI / omega_of(problem.model);
    for (size_t l = 0; l < problem.records.size(); l++) {
        const mk_record &rec = problem.records[l];
        Swing s = {l, {}, {}, {}};
        for (size_t k = 0; k <= rec.rows; k++) {
            bool going = k < rec.rows && free_row(problem, rec, k) && locked_row(problem, rec, k);
            if (going && !std::isnan(rec.q[0][k])) {
                s.t.push_back(rec.t[k]);
                s.q.push_back(rec.q[0][k]);
            }
            if (going || s.t.empty())
                continue;
            if (trim(s, period))
                swings.push_back(s);
            s = {l, {}, {}, {}};
        }
    }
    return swings;
}

// Small-swing frequency of a half swing: with the amplitude a the pendulum's period grows as
// 1 / agm(1, cos(a / 2)) = 1 + a^2/16 + 11 a^4/3072 + ... (C. F. Gauss).
double corrected(double seconds, double a)
{
    double x = 1.0, y = std::cos(0.5 * a);
    for (int i = 0; i < 6; i++) {
        double mean = 0.5 * (x + y);
        y = std::sqrt(x * y);
        x = mean;
    }
    return PI / (seconds * x);
}

// From the turning points; `raw` as read off, without correction, over the first three periods.
mk_quantity by_turns(const Swing &s, const MeasureProblem &problem, mk_measurement &out,
                     mk_quantity &raw)
{
    std::vector<double> omega, error;
    double noise = mk_model_count(&problem.model, 0) / std::sqrt(12.0);
    for (size_t i = 0; i + 1 < s.turns.size(); i++) {
        double seconds = s.turns[i + 1].t - s.turns[i].t;
        double a = 0.5 * std::fabs(s.turns[i + 1].q - s.turns[i].q);
        omega.push_back(corrected(seconds, a));
        error.push_back(omega.back() * noise / a);
    }
    mk_quantity q = weighted_mean(omega, error);
    for (size_t i = 0; i < omega.size(); i++)
        add_run(out, s.log, s.turns[i].t, s.turns[i + 1].t,
                0.5 * std::fabs(s.turns[i + 1].q - s.turns[i].q), omega[i], omega[i] - q.value);
    size_t first = std::min<size_t>(6, s.turns.size() - 1);
    raw.value = PI * (double)first / (s.turns[first].t - s.turns[0].t);
    raw.std_error = q.std_error;
    return q;
}

struct LogFree {
    void operator()(mk_log *log) const { mk_log_free(log); }
};

// By output error: a pendulum with m g l = 1, so that p1 = 1 / omega^2, friction and the place of
// its rest free.
enum mk_status by_fit(const Swing &s, const MeasureProblem &problem, double start, mk_quantity &q,
                      mk_error *err)
{
    mk_log *made = nullptr;
    enum mk_status st = mk_log_create(s.t.size(), &made);
    std::unique_ptr<mk_log, LogFree> log(made);
    double *t = st == MK_OK ? mk_log_add_column(made, "t") : nullptr;
    double *angle = t ? mk_log_add_column(made, mk_log_angle(0)) : nullptr;
    double *u = angle ? mk_log_add_column(made, "u") : nullptr;
    if (!u)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for a swing");
    std::copy(s.t.begin(), s.t.end(), t);
    std::copy(s.q.begin(), s.q.end(), angle);
    std::fill(u, u + s.t.size(), 0.0);

    mk_model m;
    mk_model_default(mk::Pendulum::info.kind, &m);
    m.encoder_cpr[0] = problem.model.encoder_cpr[0];
    m.encoder_resolution[0] = problem.model.encoder_resolution[0];
    m.friction_sharpness = problem.model.friction_sharpness;
    const double first[4] = {1.0 / (start * start), 1.0, 1e-3, 1e-2};
    std::copy(first, first + 4, m.parameter);
    st = mk_model_add_effect(&m, "encoder-offset", 1, err);
    if (st != MK_OK)
        return st;
    m.effect[0].value[0] = 0.0;
    mk_ident_options o = {};
    o.fixed[1] = true;
    o.threads = problem.options.threads;
    auto r = std::make_unique<mk_ident_result>();
    const mk_data_check made_here = {}; // no columns of a file to be doubted
    o.data_check = &made_here;
    const mk_log *logs[1] = {made};
    st = mk_identify(&m, logs, 1, &o, r.get(), err);
    if (st != MK_OK)
        return st;
    q.value = 1.0 / std::sqrt(r->parameter[0].value);
    q.std_error = 0.5 * q.value * r->parameter[0].std_error / r->parameter[0].value;
    return MK_OK;
}

void report(const MeasureProblem &problem, const mk_quantity &raw, const mk_quantity &turns,
            const mk_quantity &fit, mk_measurement &out)
{
    const mk_free_swing pendulum = pendulum_of(problem.model);
    double given = omega_of(problem.model);
    add_quantity(out, "first swings as read", "rad/s", raw.value, raw.std_error, given);
    add_quantity(out, "corrected for amplitude", "rad/s", turns.value, turns.std_error, given);
    add_quantity(out, "fitted", "rad/s", fit.value, fit.std_error, given);
    add_quantity(out, "frequency, fitted", "Hz", fit.value / (2.0 * PI), fit.std_error / (2.0 * PI),
                 given / (2.0 * PI));
    // With the given m g l taken for true.
    double inertia = pendulum.moment / (fit.value * fit.value);
    double error = 2.0 * inertia * fit.std_error / fit.value;
    add_quantity(out, pendulum.name, "u s^2/rad", inertia, error, pendulum.inertia);
    out.model.parameter[0] = inertia - pendulum.carried;
    out.model.parameter_stderr[0] = error;
    if (pendulum.locked_joint >= 0)
        add_warning(out,
                    "friction locks the wheel to the pendulum: the swing carries both, p1 + p2");
}

enum mk_status run(const MeasureProblem &problem, mk_measurement &out, mk_error *err)
{
    std::vector<Swing> swings = find_swings(problem);
    if (swings.empty())
        return mk_error_set(err, MK_ERR_RANGE,
                            "no free swing: a stretch without command and with two turning points "
                            "%g rad or more from the middle is needed",
                            SMALLEST_SWING);
    std::vector<double> value[3], error[3];
    for (const Swing &s : swings) {
        mk_quantity q[3] = {};
        q[1] = by_turns(s, problem, out, q[0]);
        enum mk_status st = by_fit(s, problem, q[1].value, q[2], err);
        if (st != MK_OK)
            return st;
        for (int i = 0; i < 3; i++) {
            bool known = std::isfinite(q[i].std_error) && q[i].std_error > 0.0;
            value[i].push_back(q[i].value);
            error[i].push_back(known ? q[i].std_error : 0.1 * q[i].value);
        }
    }
    report(problem, weighted_mean(value[0], error[0]), weighted_mean(value[1], error[1]),
           weighted_mean(value[2], error[2]), out);
    return MK_OK;
}

} // namespace

const Measure measure_swing = {{"swing", "natural frequency of free swings, with it the inertia",
                                "report (3.23), (3.35)", plants_measured_by("swing"), "amplitude",
                                "rad", "frequency", "rad/s", nullptr},
                               run};

} // namespace mk
