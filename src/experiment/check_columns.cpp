// What the columns and the metadata of a log say by themselves.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <vector>

#include "experiment/findings.hpp"
#include "mechkit/number.h"
#include "sim/period.hpp"
#include "sim/record_check.hpp"

namespace mk
{

namespace
{

constexpr double TURN = 6.283185307179586; // rad

// --- wrapped angles ------------------------------------------------------------------------------

// The row whose reading is a whole turn from where the readings before and after it point; 0: there
// is none. What was wrapped stays within one turn, which sets it apart from pulses that were lost.
size_t wrapped_at(const double *q, size_t rows, double turn)
{
    double low = HUGE_VAL, high = -HUGE_VAL;
    for (size_t k = 0; k < rows; k++)
        low = std::fmin(low, q[k]), high = std::fmax(high, q[k]); // pass a NaN over
    if (!(high - low > 0.9 * turn && high - low < 1.001 * turn))
        return 0;
    for (size_t k = 2; k + 1 < rows; k++) {
        const double step = q[k] - q[k - 1], rest = std::remainder(step, turn);
        const double before = std::remainder(q[k - 1] - q[k - 2], turn);
        const double after = std::remainder(q[k + 1] - q[k], turn);
        if (std::fabs(step) > 0.9 * turn &&
            std::fabs(rest - 0.5 * (before + after)) < 0.05 * turn &&
            std::fabs(before - after) < 0.1 * turn)
            return k;
    }
    return 0;
}

void check_wrapping(const CheckedLog &c, int joint, Findings &out)
{
    const double turns[] = {TURN, 360.0};
    if (c.model.joint_linear[joint])
        return;
    const double *q = c.record.q[joint];
    for (int i = 0; i < 2; i++) {
        const size_t row = wrapped_at(q, c.record.rows, turns[i]);
        if (row == 0)
            continue;
        out.fatal(text("%s jumps from %.6g to %.6g: it is wrapped to one turn%s",
                       mk_log_angle(joint), q[row - 1], q[row], i ? ", and in degrees" : ""),
                  "unwrap it first, so that turns are counted on (numpy.unwrap, MATLAB's unwrap)",
                  c.log.first_row_line + (int)row);
    }
}

// --- units ---------------------------------------------------------------------------------------

// Whether the readings step by `size` and whole multiples of it.
bool steps_by(const double *q, size_t rows, double size)
{
    size_t steps = 0, multiples = 0;
    for (size_t k = 1; k < rows; k++) {
        const double step = std::fabs(q[k] - q[k - 1]) / size;
        if (!(step > 1e-6))
            continue;
        steps++;
        multiples += step > 0.5 && step < 1e6 && std::fabs(step - std::round(step)) < 0.05;
    }
    return steps >= 50 && multiples * 100 >= steps * 98;
}

// Number `joint` of a list in the log's metadata; 0 where there is none.
double listed(const CheckedLog &c, const char *key, int joint)
{
    const char *text = mk_log_find_meta(&c.log, key);
    for (int j = 0; text && *text; j++) {
        char *end;
        const double value = std::strtod(text, &end);
        if (end == text || !(value > 0.0 && value <= 1e8))
            break;
        if (j == joint)
            return value;
        text = end + std::strspn(end, " \t,");
    }
    return 0.0;
}

// Size of a count in the joint's unit, after the log itself or, where it says nothing sensible, the
// model.
double count_of(const CheckedLog &c, int joint)
{
    const double cpr = listed(c, "encoder_cpr", joint);
    const double size = listed(c, "encoder_resolution", joint);
    return size > 0.0 ? size : cpr >= 1.0 ? TURN / cpr : mk_model_count(&c.model, joint);
}

// Steps of an encoder in another unit than rad are 57 times or hundreds of times as large as they
// should be: no encoder, and no error of its scale, is off by so much.
void check_unit(const CheckedLog &c, int joint, Findings &out)
{
    constexpr double FEWEST_COUNTS = 100.0; // a coarser sensor's counts may be rad by chance
    if (c.model.joint_linear[joint])        // neither degrees nor counts a turn
        return;
    const double counts = TURN / count_of(c, joint);
    const double *q = c.record.q[joint];
    const bool in_degrees = steps_by(q, c.record.rows, 360.0 / counts);
    if (!in_degrees && (counts < FEWEST_COUNTS || !steps_by(q, c.record.rows, 1.0)))
        return;
    const char *name = mk_log_angle(joint);
    out.fatal(
        text("%s: steps of %g are those of %g counts a turn in %s, but angles are in rad", name,
             in_degrees ? 360.0 / counts : 1.0, counts, in_degrees ? "degrees" : "raw counts"),
        in_degrees
            ? text("convert it: mechkit import --map with [%s] unit = deg", name)
            : text("convert it: mechkit import --map with [%s] sign = %.10g", name, TURN / counts));
}

// --- what is there -------------------------------------------------------------------------------

double missing_share(const double *x, size_t rows)
{
    return (double)std::count_if(x, x + rows, [](double v) { return std::isnan(v); }) /
           (double)rows;
}

// Of what was sent and what was measured of it; NaN where one of them stands still.
double correlation_of(const double *a, const double *b, size_t rows)
{
    double n = 0.0, sa = 0.0, sb = 0.0, aa = 0.0, ab = 0.0, bb = 0.0;
    for (size_t k = 0; k < rows; k++) {
        if (std::isnan(a[k]) || std::isnan(b[k]))
            continue;
        n += 1.0, sa += a[k], sb += b[k];
        aa += a[k] * a[k], ab += a[k] * b[k], bb += b[k] * b[k];
    }
    return (n * ab - sa * sb) / std::sqrt((n * aa - sa * sa) * (n * bb - sb * sb));
}

void check_input_pairs(const CheckedLog &c, Findings &out)
{
    constexpr double AGAINST = -0.5;
    for (const char *name : {"u", "tau", "u1", "tau1", "u2", "tau2"}) {
        const std::string sent = std::string(name) + "_cmd";
        const double *a = mk_log_get(&c.log, name), *b = mk_log_get(&c.log, sent.c_str());
        if (a && b && correlation_of(a, b, c.log.rows) < AGAINST)
            out.doubt(
                text("%s runs against %s: one of them has the wrong sign", sent.c_str(), name),
                text("if it is what was sent, mechkit import --map with [%s] sign = -1",
                     sent.c_str()));
    }
}

void check_missing(const CheckedLog &c, Findings &out)
{
    constexpr double MANY = 0.1; // of the rows
    for (int j = 0; j < mk_model_joints(&c.model); j++) {
        const double share = missing_share(c.record.q[j], c.record.rows);
        if (share > MANY)
            out.doubt(
                text("%.0f %% of the readings of %s are missing", 100.0 * share, mk_log_angle(j)),
                "look for lost samples at the board or in the conversion of the file");
    }
    const double share = c.record.u[0] ? missing_share(c.record.u[0], c.record.rows) : 0.0;
    if (share > MANY)
        out.doubt(text("%.0f %% of the commands are missing, and made up from those before and "
                       "after",
                       100.0 * share),
                  "record the command in every row");
}

// --- time ----------------------------------------------------------------------------------------

double median(std::vector<double> values)
{
    auto middle = values.begin() + (std::ptrdiff_t)(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

// Samples that lie between two rows: by the numbers that a loop gives its samples, or the rate that
// the log says it was sampled at.
double samples_a_row(const CheckedLog &c, double rate)
{
    const double *tick = mk_log_get(&c.log, "tick");
    if (!tick)
        return rate * median_period(c.record.t, c.record.rows);
    std::vector<double> steps;
    for (size_t k = 1; k < c.record.rows; k++)
        if (std::isfinite(tick[k] - tick[k - 1]))
            steps.push_back(tick[k] - tick[k - 1]);
    return steps.empty() ? 1.0 : median(steps);
}

void check_rate(const CheckedLog &c, Findings &out)
{
    constexpr double NEAR = 0.05; // of a sample
    const double period = median_period(c.record.t, c.record.rows);
    const char *meta = mk_log_find_meta(&c.log, "sample_rate_hz");
    double rate = 0.0;
    if (meta && !(mk_parse_double_z(meta, &rate) && rate > 0.0)) {
        out.doubt(text("sample_rate_hz: '%.40s' is no number above 0", meta),
                  "correct or remove the line; the times of the rows are taken");
        rate = 0.0;
    }
    const double each = samples_a_row(c, rate), whole = std::round(each);
    if (whole >= 2.0 && std::fabs(each - whole) < NEAR * whole)
        out.doubt(text("the log is thinned: its rows, %.4g s apart, are one in %.0f of those that "
                       "were taken",
                       period, whole),
                  "give the log as it was recorded: what happens between rows (delays, backlash, "
                  "lost counts, the command's steps) cannot be seen");
    else if (rate > 0.0 && std::fabs(rate * period - 1.0) > NEAR)
        out.doubt(text("sample_rate_hz is %g, but the rows are %.4g s apart (%.4g Hz)", rate,
                       period, 1.0 / period),
                  "correct the line, or the times; the times are taken");
}

// Time stamps that are all multiples of a step which is not far below the time between rows, and
// steps between them that are not even: they were rounded.
void check_time_grid(const CheckedLog &c, Findings &out)
{
    constexpr double COARSE = 0.15; // of the time between rows
    constexpr double ON_IT = 1e-3;  // of the step
    constexpr double OFTEN = 0.1;   // of the rows
    const double *t = c.record.t;
    const size_t rows = c.record.rows;
    const double period = median_period(t, rows);
    for (double step : {0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001, 5e-4, 2e-4, 1e-4}) {
        size_t off = 0, uneven = 0;
        if (step < COARSE * period || step > 0.99 * period)
            continue;
        for (size_t k = 1; k < rows; k++) {
            off += std::fabs(std::remainder(t[k] - t[0], step)) > ON_IT * step;
            // Rows that were dropped leave steps of whole periods.
            uneven += std::fabs(std::remainder(t[k] - t[k - 1], period)) > 0.5 * step;
        }
        if (off > 0)
            continue;
        if ((double)uneven > OFTEN * (double)rows)
            out.doubt(text("time stamps are rounded to %g s, with rows %.4g s apart", step,
                           (t[rows - 1] - t[0]) / (double)(rows - 1)),
                      "write times with more digits: rounding them is noise on every speed");
        return;
    }
}

// How far four readings are from any parabola over their times, sum_i w_i q_i with
//     w_i = prod_(k != i) 1 / (t_i - t_k) ,   |w| = 1 :
// the divided difference of third order, which is 0 of a parabola.
double roughness(const double *q, const double *t)
{
    double sum = 0.0, squares = 0.0;
    for (int i = 0; i < 4; i++) {
        double w = 1.0;
        for (int k = 0; k < 4; k++)
            w /= k == i ? 1.0 : t[i] - t[k];
        sum += w * q[i];
        squares += w * w;
    }
    return sum / std::sqrt(squares);
}

// Mean of all but the largest tenth, which a single reading that is off would make up.
double trimmed_mean(std::vector<double> values)
{
    const size_t kept = values.size() - values.size() / 10;
    std::nth_element(values.begin(), values.begin() + (std::ptrdiff_t)(kept - 1), values.end());
    double sum = 0.0;
    for (size_t i = 0; i < kept; i++)
        sum += values[i];
    return sum / (double)kept;
}

// Mean square of the roughness at the times as they are over that at even steps; NaN where too few
// rows are evenly spaced but for a scatter, or nothing moves.
double rougher_as_stamped(const double *q, const double *t, size_t rows, double period)
{
    constexpr size_t FEW = 200;
    constexpr double SAME_STEP = 0.5; // of the period
    std::vector<double> stamped, even;
    for (size_t k = 0; k + 3 < rows; k++) {
        double at[4];
        bool one_each = true;
        for (size_t i = 0; i < 4; i++) {
            at[i] = period * (double)i;
            one_each = one_each && std::isfinite(q[k + i]) &&
                       (i == 0 || std::fabs(t[k + i] - t[k + i - 1] - period) < SAME_STEP * period);
        }
        if (!one_each || q[k] == q[k + 3])
            continue;
        stamped.push_back(std::pow(roughness(q + k, t + k), 2));
        even.push_back(std::pow(roughness(q + k, at), 2));
    }
    if (even.size() < FEW)
        return std::nan("");
    const double least = trimmed_mean(std::move(even));
    return least > 0.0 ? trimmed_mean(std::move(stamped)) / least : std::nan("");
}

// Times that scatter about even steps where the readings do not: they were taken evenly, and
// stamped by another clock when they arrived. A rig that really was read at uneven times is smooth
// at those.
struct Scatter {
    double period;  // s
    double rms;     // of the times, s
    double rougher; // times, as stamped, in the rms
};

bool times_scatter(const CheckedLog &c, Scatter &out)
{
    constexpr double ROUGHER = 2.0;
    constexpr double CONTRARY = 0.8; // mean square: this joint was read when the times say
    const double *t = c.record.t;
    const size_t rows = c.record.rows;
    out.period = median_period(t, rows);
    out.rougher = 0.0;
    for (int j = 0; j < mk_model_joints(&c.model); j++) {
        const double ratio = rougher_as_stamped(c.record.q[j], t, rows, out.period);
        if (ratio < CONTRARY) // not of NaN
            return false;
        out.rougher = std::fmax(out.rougher, std::sqrt(ratio));
    }
    double squares = 0.0;
    for (size_t k = 1; k < rows; k++)
        squares += std::pow(std::remainder(t[k] - t[k - 1], out.period), 2);
    // A step has the scatter of two times.
    out.rms = std::sqrt(0.5 * squares / (double)(rows - 1));
    return out.rougher >= ROUGHER;
}

// Number of steps of about `period` before each row: 0, and rising by one at least. A row that was
// stamped so late that it seems to be the next one goes back when that comes.
// The times are followed by their phase, which a single late row hardly moves.
std::vector<double> numbers_of(const std::vector<double> &t, double period)
{
    constexpr double FOLLOW = 0.05, MOST = 0.5; // of an error; of the period
    std::vector<double> n(t.size(), 0.0);
    double at = t[0]; // where row k - 1 is expected
    for (size_t k = 1; k < t.size(); k++) {
        const double steps = std::round((t[k] - at) / period);
        n[k] = n[k - 1] + steps;
        for (size_t i = k; i > 1 && n[i] <= n[i - 1] && n[i - 1] > n[i - 2] + 1.0; i--)
            n[i - 1] -= 1.0;
        n[k] = std::fmax(n[k], n[k - 1] + 1.0);
        at += steps * period;
        const double off = t[k] - at;
        at += FOLLOW * std::fmin(std::fmax(off, -MOST * period), MOST * period);
    }
    return n;
}

// Least squares of t_k = a + b n_k: no drift is added. Empty where a time would move by more than a
// step, as where a clock was set while it ran.
std::vector<double> even_times(const std::vector<double> &t, double period)
{
    // The median of steps that were rounded may be well off their mean.
    double steps = 0.0;
    for (size_t k = 1; k < t.size(); k++)
        steps += std::fmax(1.0, std::round((t[k] - t[k - 1]) / period));
    const std::vector<double> n = numbers_of(t, (t.back() - t[0]) / steps);
    const double rows = (double)t.size();
    double mean_n = 0.0, mean_t = 0.0, nn = 0.0, nt = 0.0;
    for (size_t k = 0; k < t.size(); k++)
        mean_n += n[k] / rows, mean_t += t[k] / rows;
    for (size_t k = 0; k < t.size(); k++) {
        nn += (n[k] - mean_n) * (n[k] - mean_n);
        nt += (n[k] - mean_n) * (t[k] - mean_t);
    }
    std::vector<double> even(t.size());
    for (size_t k = 0; k < t.size(); k++) {
        even[k] = mean_t + nt / nn * (n[k] - mean_n);
        if (std::fabs(even[k] - t[k]) > period)
            return {};
    }
    return even;
}

void check_scattered_times(const CheckedLog &c, Findings &out)
{
    Scatter s;
    if (!times_scatter(c, s))
        return;
    const bool can = !even_times({c.record.t, c.record.t + c.record.rows}, s.period).empty();
    out.doubt(text("the times of the rows scatter by %.2g ms about even steps of %.4g ms, but the "
                   "readings are %.2g times as smooth at even steps: they were not read when the "
                   "times say",
                   1e3 * s.rms, 1e3 * s.period, s.rougher),
              text("%swrite the times of the clock that the rig was read by",
                   can ? "identify and explain take even steps, unless --keep-all; better " : ""));
}

} // namespace

void check_columns(const CheckedLog &log, Findings &out)
{
    for (int j = 0; j < mk_model_joints(&log.model); j++) {
        check_wrapping(log, j, out);
        check_unit(log, j, out);
    }
    check_input_pairs(log, out);
    check_missing(log, out);
    check_rate(log, out);
    check_time_grid(log, out);
    check_scattered_times(log, out);
}

namespace
{

// A command may overshoot where it is clipped for real; by so much it is another unit or garbage.
void check_clipping(const CheckedLog &c, Findings &out)
{
    constexpr double MANY = 0.01, MOST = 0.5; // of the rows
    constexpr double FAR = 10.0;              // times the limit
    size_t beyond = 0, far = 0;
    double most = 0.0;
    for (size_t k = 0; c.record.u[0] && k < c.record.rows; k++) {
        const double u = std::fabs(c.record.u[0][k]);
        beyond += u > c.model.u_max * (1.0 + 1e-9);
        far += u > FAR * c.model.u_max;
        most = std::fmax(most, u);
    }
    const double rows = (double)c.record.rows;
    if (far == 0 && !((double)beyond > MANY * rows))
        return;
    const std::string what =
        text("the command reaches %.3g and is beyond the model's u_max = %g in "
             "%zu of %zu rows, where it is taken as clipped",
             most, c.model.u_max, beyond, c.record.rows);
    const char *remedy = "convert the command to the model's unit, or correct u_max in the model";
    if ((double)far > MOST * rows)
        out.fatal(what, remedy);
    else
        out.doubt(what, remedy);
}

} // namespace

void check_extremes(const CheckedLog &c, Findings &out)
{
    check_clipping(c, out);
    for (int j = 0; j < mk_model_joints(&c.model); j++) {
        double reach = 0.0;
        for (size_t k = 0; k < c.record.rows; k++)
            reach = std::fmax(reach, std::fabs(c.record.q[j][k])); // passes a NaN over
        if (reach > MOST_ANGLE)
            out.doubt(text("%s reaches %.3g %s: that is no %s of a rig", mk_log_angle(j), reach,
                           mk_model_unit(&c.model, j, "rad"),
                           c.model.joint_linear[j] ? "position" : "angle"),
                      "look at the column, and at its unit");
    }
}

// What is listed of each joint must be a number of the range that listed() takes; it passes over
// the rest.
static void check_list(const CheckedLog &c, const char *key, const char *wanted, double least,
                       Findings &out)
{
    const char *text_of_list = mk_log_find_meta(&c.log, key), *at = text_of_list;
    for (int j = 0; at && j < mk_model_joints(&c.model); j++) {
        at += std::strspn(at, " \t,");
        if (!*at)
            return;
        const size_t length = std::strcspn(at, " \t,");
        double value = 0.0;
        if (!mk_parse_double(at, at + length, &value) || !(value >= least && value <= 1e8)) {
            out.doubt(text("%s: '%.40s' is no %s for each joint", key, text_of_list, wanted),
                      "correct or remove the line; the model's is taken");
            return;
        }
        at += length;
    }
}

void check_metadata(const CheckedLog &c, Findings &out)
{
    const char *meta = mk_log_find_meta(&c.log, "u_to_torque");
    double value = 0.0;
    if (meta && !c.record.si) {
        if (!mk_parse_double_z(meta, &value) || !(value > 0.0))
            out.doubt(text("u_to_torque: '%.40s' is no number above 0", meta),
                      text("correct the line; the model's %g is taken", c.model.u_to_torque));
        else if (std::fabs(value / c.model.u_to_torque - 1.0) > 1e-3)
            out.doubt(text("u_to_torque is %g here, %g in the model", value, c.model.u_to_torque),
                      "correct the one that is wrong: torques in N m differ by as much. The "
                      "model's is taken");
    }
    check_list(c, "encoder_cpr", "number of counts a revolution, 1 .. 1e8,", 1.0, out);
    check_list(c, "encoder_resolution", "size of a count above 0", 1e-12, out);
    for (int j = 0; j < mk_model_joints(&c.model); j++) {
        const double here = count_of(c, j), there = mk_model_count(&c.model, j);
        const char *remedy = "correct the one that is wrong; the model's is taken";
        if (c.model.encoder_cpr[j] > 0 && std::fabs(TURN / here - TURN / there) > 0.5)
            out.doubt(text("encoder_cpr of joint %d is %g here, %d in the model", j + 1,
                           TURN / here, c.model.encoder_cpr[j]),
                      remedy);
        if (c.model.encoder_cpr[j] == 0 && std::fabs(here / there - 1.0) > 1e-4)
            out.doubt(text("a count of joint %d is %g %s here, %g in the model", j + 1, here,
                           mk_model_unit(&c.model, j, "rad"), there),
                      remedy);
    }
}

} // namespace mk

bool mk_data_take_even_times(const mk_model *model, mk_log *log)
try {
    using namespace mk;
    mk_record record;
    Scatter s;
    if (mk_record_from_log(log, model, &record, nullptr) != MK_OK || record.rows < 2 ||
        !times_scatter({*log, *model, record}, s))
        return false;
    const std::vector<double> even = even_times({record.t, record.t + record.rows}, s.period);
    if (even.empty())
        return false;
    mk_log_replace(log, "t", even.data());
    return true;
} catch (const std::bad_alloc &) {
    return false; // the times stay as they are
}
