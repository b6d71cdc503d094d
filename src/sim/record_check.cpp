#include "sim/record_check.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "sim/period.hpp"

namespace mk
{

namespace
{

constexpr double TURN = 6.283185307179586; // rad
// No amplifier is overdriven so far.
constexpr double MOST_COMMAND = 10e3; // of u_max
// No rig here can be followed with readings farther apart, s.
constexpr double LONGEST_PERIOD = 0.2;
// Less is rest: an encoder that stands still moves by a count, one that shakes by two or three.
constexpr double MOTION = 5.0; // counts

// A column of a log, under the name that a message gives it.
struct Column {
    const double *x;
    const char *name;
};

// The columns of a record that a model of `joints` goes with.
std::vector<Column> columns_of(const mk_record &record, int joints)
{
    std::vector<Column> all;
    for (int j = 0; j < joints; j++)
        all.push_back({record.q[j], mk_log_angle(j)});
    for (int i = 0; i < MK_MAX_INPUTS; i++)
        if (record.u[i])
            all.push_back({record.u[i], i ? "the second command" : "the command"});
    return all;
}

enum mk_status check_sizes(const Column &c, double most, const char *unit, const mk_log &log,
                           mk_error *err)
{
    for (size_t k = 0; k < log.rows; k++) {
        if (std::fabs(c.x[k]) > most)
            return mk_error_at(err, MK_ERR_RANGE, log.path, log.first_row_line + (int)k, 0,
                               "%s is %.3g: no rig goes beyond %g%s; a missing value is an empty "
                               "field or nan",
                               c.name, c.x[k], most, unit);
    }
    return MK_OK;
}

enum mk_status check_count(const Column &c, size_t fewest, const mk_log &log, mk_error *err)
{
    size_t values = 0;
    for (size_t k = 0; k < log.rows; k++)
        values += !std::isnan(c.x[k]);
    if (values == 0)
        return mk_error_at(err, MK_ERR_RANGE, log.path, 0, 0, "%s has no values", c.name);
    if (values < fewest)
        return mk_error_at(err, MK_ERR_RANGE, log.path, 0, 0,
                           "%zu values of %s are too few to learn anything from: %zu at least",
                           values, c.name, fewest);
    return MK_OK;
}

} // namespace

double duration_of(const mk_record &record)
{
    return record.rows > 0 ? record.t[record.rows - 1] - record.t[0] : 0.0;
}

enum mk_status check_finite(const mk_record &record, const mk_model &model, const mk_log &log,
                            mk_error *err)
{
    for (const Column &c : columns_of(record, mk_model_joints(&model)))
        for (size_t k = 0; k < log.rows; k++)
            if (std::isinf(c.x[k]))
                return mk_error_at(err, MK_ERR_RANGE, log.path, log.first_row_line + (int)k, 0,
                                   "%s is infinite; a missing value is an empty field or nan",
                                   c.name);
    return MK_OK;
}

enum mk_status check_record(const mk_record &record, const mk_model &model, const mk_log &log,
                            size_t fewest, mk_error *err)
{
    if (record.rows < fewest)
        return mk_error_at(err, MK_ERR_RANGE, log.path, 0, 0,
                           "%zu row%s too few to learn anything from: %zu at least", record.rows,
                           record.rows == 1 ? " is" : "s are", fewest);
    const double period = median_period(record.t, record.rows);
    if (period > LONGEST_PERIOD)
        return mk_error_at(err, MK_ERR_RANGE, log.path, 0, 0,
                           "readings %.3g s apart show nothing of how a rig moves (%g s at most): "
                           "is t in seconds?",
                           period, LONGEST_PERIOD);
    enum mk_status st = check_finite(record, model, log, err);
    const std::vector<Column> all = columns_of(record, mk_model_joints(&model));
    for (int i = 0; i < (int)all.size() && st == MK_OK; i++) {
        st = i < mk_model_joints(&model)
                 ? check_sizes(all[i], MOST_ANGLE, model.joint_linear[i] ? " m" : " rad", log, err)
                 : check_sizes(all[i], MOST_COMMAND * model.u_max,
                               ", ten thousand times the model's u_max", log, err);
        if (st == MK_OK)
            st = check_count(all[i], fewest, log, err);
    }
    return st;
}

bool joint_moves(const mk_record &record, const mk_model &model, int joint)
{
    double low = HUGE_VAL, high = -HUGE_VAL;
    for (size_t k = 0; k < record.rows; k++) {
        low = std::fmin(low, record.q[joint][k]); // fmin passes a NaN over
        high = std::fmax(high, record.q[joint][k]);
    }
    return high - low >= MOTION * mk_model_count(&model, joint);
}

bool record_moves(const mk_record &record, const mk_model &model)
{
    bool moves = false;
    for (int j = 0; j < mk_model_joints(&model); j++)
        moves = moves || joint_moves(record, model, j);
    return moves;
}

// --- times ---------------------------------------------------------------------------------------

namespace
{

// Generalised force of the plant at rest at hanging but for joint `j`, which is off by `angle` and
// has a speed: gravity and friction.
double force(const mk_model &model, int j, double angle, double speed)
{
    double q[MK_MAX_JOINTS], v[MK_MAX_JOINTS] = {0.0, 0.0}, a[MK_MAX_JOINTS] = {0.0, 0.0};
    double tau[MK_MAX_JOINTS] = {0.0, 0.0};
    std::copy_n(mk_plant(model.plant)->rest, MK_MAX_JOINTS, q);
    q[j] += angle;
    v[j] = speed;
    mk_plant_inverse_dynamics(&model, q, v, a, tau);
    return tau[j];
}

double inertia(const mk_model &model, int j)
{
    double mass[MK_MAX_JOINTS * MK_MAX_JOINTS], h[MK_MAX_JOINTS];
    const double v[MK_MAX_JOINTS] = {0.0, 0.0};
    mk_plant_mass(&model, mk_plant(model.plant)->rest, v, mass, h);
    return mass[j * mk_model_joints(&model) + j];
}

} // namespace

double slowest_motion(const mk_model &model, const char **what)
{
    constexpr double ANGLE_STEP = 1e-3;         // rad
    constexpr double FAST = 100.0;              // rad/s, where dry friction is level
    constexpr double NO_GRAVITY = 1e-9;         // of the inertia, 1/s^2
    constexpr double LONGEST_OF_INTEREST = 1e3; // s
    double longest = 0.0;
    for (int j = 0; j < mk_model_joints(&model); j++) {
        const double m = inertia(model, j);
        const double k = (force(model, j, ANGLE_STEP, 0.0) - force(model, j, -ANGLE_STEP, 0.0)) /
                         (2 * ANGLE_STEP);
        const double d = (force(model, j, 0.0, 2 * FAST) - force(model, j, 0.0, FAST)) / FAST;
        const bool swings = k > NO_GRAVITY * m;
        const double time =
            swings ? TURN * std::sqrt(m / k) : m / std::max(d, m / LONGEST_OF_INTEREST);
        if (time > longest) {
            longest = time;
            *what = swings ? "a swing about hanging" : "running down by viscous friction";
        }
    }
    return longest;
}

// A motor that spins down for ten seconds shows what it does in one, and numbers of a model that
// are orders of magnitude off must not refuse good data.
constexpr double LEAST_TO_EXPLAIN = 0.3, MOST_ASKED_FOR = 1.0; // s
// A quarter is what is held back of a log where no other is given.
constexpr double HELD_OUT = 0.25;

double least_to_explain(const mk_model &model)
{
    const char *what = nullptr;
    return std::min(std::max(slowest_motion(model, &what), LEAST_TO_EXPLAIN), MOST_ASKED_FOR);
}

double least_to_hold_out(const mk_model &model)
{
    return HELD_OUT * least_to_explain(model);
}

} // namespace mk
