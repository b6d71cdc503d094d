// A record made ready for a fit (ident/fit_log.hpp): its rows, commands and weights.
//
// A fit takes a log as rows one period T apart, each with a command. Reading k of joint j counts
// with a weight w_k, 0 to 1 (ident/fit_shoot.cpp):
//     r_k = w_k (y_k - h(x(t_k))) / sigma_j ,   sum_k w_k^2 independent readings in all .
// Four things lie between a record and that.
//     rows      that are missing come back, without readings (Builder::fill_gap);
//     commands  that are missing are interpolated (Builder::bridge), and FitLog::doubt says by how
//               much that may be wrong: the fit adds it to the variance of the speeds;
//     glitches  single readings that no motion makes become missing ones (drop_glitches);
//     weights   rounding repeats its error as long as a reading stays on its count, so that such
//               readings are not independent (weigh).
// A missing reading is NaN and has the weight 0. No command is NaN once fit_log() has returned.
#include "ident/fit_log.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "mechkit/loop.h"
#include "sim/period.hpp"

namespace mk
{

namespace
{

constexpr double MISSING = std::numeric_limits<double>::quiet_NaN();
// Of the usual period. pieces_of() cuts a record at longer holes, so that no piece has one: a
// command that is guessed for longer says nothing about the motion behind it.
constexpr double LONGEST_HOLE = 51.0; // that is bridged, periods

// The upper median; 0 of nothing.
double median_of(std::vector<double> v)
{
    if (v.empty())
        return 0.0;
    auto mid = v.begin() + (std::ptrdiff_t)(v.size() / 2);
    std::nth_element(v.begin(), mid, v.end());
    return *mid;
}

// Command of a row, held over rows that lack it.
double command(const mk_record &rec, int input, size_t row)
{
    if (!rec.u[input])
        return 0.0;
    for (size_t k = row + 1; k-- > 0;)
        if (!std::isnan(rec.u[input][k]))
            return rec.u[input][k];
    return 0.0;
}

// Copies rows [begin, end) of a record into a log and fills the holes between them. The rows of the
// log are those of the record and the ones that are put in between, so that numbers of rows differ:
// `row` counts in the record, k in the log. copy_rows() comes first, then the first command of each
// input is made known by the caller, then fill_commands() is called.
class Builder
{
  public:
    Builder(const mk_record &record, FitLog &out, size_t first, size_t last)
        : rec(record), log(out), begin(first), end(last)
    {
    }

    void copy_rows()
    {
        for (size_t k = begin; k < end; k++) {
            if (k > begin)
                fill_gap(k - 1, k);
            add(time(k), k);
        }
    }

    // A command that was not recorded is taken between its neighbours; how far off that may be
    // shows in how badly it continues either side. The doubt of row k, in units of the command, is
    // the sum of
    //     |u_k - u_(k-1)|     where the row came late and the log does not say how late: the older
    //                         command went on for an unknown part of the period ,
    //     what bridge() says  where the command is missing.
    // A hole that ends with a row before which the loop stood still is filled without doubt (hold).
    void fill_commands()
    {
        size_t n = log.rows();
        log.doubt.assign(n, 0.0);
        for (size_t k = 1; k < n; k++)
            if (held[k] && !std::isnan(log.u[0][k])) // else it is a hole, see below
                log.doubt[k] = std::fabs(log.u[0][k] - last_command(k));
        for (int i = 0; i < MK_MAX_INPUTS; i++) {
            for (size_t k = 0; k < n; k++) {
                if (!std::isnan(log.u[i][k]))
                    continue;
                // A hole: rows [k, stop).
                size_t stop = k;
                while (stop < n && std::isnan(log.u[i][stop]))
                    stop++;
                if (stop < n && after_stop[stop])
                    hold(log.u[i], k, stop);
                else
                    bridge(log.u[i], k, stop);
                k = stop;
            }
        }
    }

  private:
    const mk_record &rec;
    FitLog &log;
    size_t begin, end;
    std::vector<bool> held;       // by row: an older command was held, who knows for how long
    std::vector<bool> after_stop; // by row: the loop may have stood still before it

    // When readings were taken and the command changed; rows are numbered by when that should have
    // been.
    // The column late_us is taken only where the result lies between 0 and T: after samples that
    // were left out, the delay counts from the first of those, and whole periods between the two
    // rows are taken off.
    double time(size_t row) const
    {
        double late = rec.late_us && row > begin ? 1e-6 * rec.late_us[row] : 0.0;
        // The delay is that of the first of the samples that were left out.
        if (late > log.period && flagged(row))
            late -= log.period * (std::round((rec.t[row] - rec.t[row - 1]) / log.period) - 1.0);
        // Later than the next sample nothing came: such a column means something else.
        bool sane = late > 0.0 && late < log.period;
        return rec.t[row] - rec.t[begin] + (sane ? late : 0.0);
    }
    // Whether the loop calls the row's sample late, or the first after others were left out.
    // NaN in the column of flags says nothing.
    bool flagged(size_t row) const
    {
        constexpr unsigned OFF = MK_FLAG_LATE | MK_FLAG_OVERRUN | MK_FLAG_LOST | MK_FLAG_GAP;
        return rec.flags && rec.flags[row] >= 0.0 && ((unsigned)rec.flags[row] & OFF);
    }
    // Appends a row at the time t: row `row` of the record, or, with SIZE_MAX, one that has neither
    // readings nor commands. A late row whose delay is unknown loses its readings, since nobody
    // knows when they were taken; on a board's own clock readings are on time whatever the flags
    // say.
    void add(double t, size_t row)
    {
        const bool real = row != SIZE_MAX;
        const bool late = real && !rec.late_us && !rec.board_clock && flagged(row);
        log.t.push_back(t);
        for (int i = 0; i < MK_MAX_INPUTS; i++)
            log.u[i].push_back(!rec.u[i] ? 0.0 : real ? rec.u[i][row] : MISSING);
        for (int j = 0; j < log.joints; j++)
            log.q[j].push_back(real && !late ? rec.q[j][row] : MISSING);
        held.push_back(late);
        after_stop.push_back(real && row > begin && (flagged(row) || flagged(row - 1)));
    }
    // Rows that are missing altogether (the board kept its pace, the log did not).
    // With n = round(gap / T) - 1 rows missing, they are put at equal distances gap / (n + 1).
    void fill_gap(size_t before, size_t after)
    {
        double gap = time(after) - time(before);
        double count = std::round(gap / log.period) - 1.0;
        if (!(count >= 1.0) || count >= LONGEST_HOLE)
            return;
        for (double i = 1.0; i <= count; i++)
            add(time(before) + gap * i / (count + 1.0), SIZE_MAX);
    }
    // The last command before a row of the log that is known.
    double last_command(size_t row) const
    {
        while (row-- > 0)
            if (!std::isnan(log.u[0][row]))
                return log.u[0][row];
        return 0.0;
    }
    // The loop stood still, and with it the command.
    // Rows [first, last) have the command before them. Adds no doubt.
    void hold(std::vector<double> &u, size_t first, size_t last)
    {
        for (size_t k = first; k < last; k++)
            u[k] = first > 0 ? u[first - 1] : u[last];
    }
    // Rows [first, last), whose command nobody recorded. With x in rows from the last known
    // command, u_a and u_b the commands before and behind the hole and n = last - first + 1 their
    // distance,
    //     straight(x) = u_a + x / n (u_b - u_a) ,
    //     cubic(x)    = sum_i y_i prod_(j != i) (x - x_j) / (x_i - x_j)    (Lagrange) ,
    // through x_i = -1, 0, n, n + 1. A signal whose slopes at both ends are d_a and d_b is taken to
    // be smooth across the hole if
    //     |u_b - u_a| <= 1.5 n max(|d_a|, |d_b|) ,
    // that is, if its slopes carry it over with half as much again to spare. The doubt that is
    // added is
    //     0.1 |cubic - straight|                    of a smooth signal ,
    //     |cubic - straight| + |u_b - u_a| / 2      else: it may have stepped anywhere in the hole.
    // At the ends of the log the one neighbour that there is goes on unchanged.
    void bridge(std::vector<double> &u, size_t first, size_t last)
    {
        size_t n = u.size();
        double left = first > 0 ? u[first - 1] : last < n ? u[last] : 0.0;
        double right = last < n ? u[last] : left;
        double before = first > 1 ? u[first - 2] : left;
        double after = last + 1 < n && !std::isnan(u[last + 1]) ? u[last + 1] : right;
        // A cubic through two commands on either side, where they go on smoothly; a straight line,
        // and doubt, where one may have stepped.
        double wide = (double)(last - first + 1), dl = left - before, dr = after - right;
        double step = std::fabs(right - left) - 1.5 * wide * std::max(std::fabs(dl), std::fabs(dr));
        bool smooth = step <= 0.0 && first > 1 && last + 1 < n;
        for (size_t k = first; k < last; k++) {
            double x = (double)(k - first + 1), straight = left + x / wide * (right - left);
            double cubic = 0.0;
            const double at[4] = {-1.0, 0.0, wide, wide + 1.0}, y[4] = {before, left, right, after};
            for (int i = 0; i < 4; i++) {
                double share = y[i];
                for (int j = 0; j < 4; j++)
                    share *= j == i ? 1.0 : (x - at[j]) / (at[i] - at[j]);
                cubic += share;
            }
            u[k] = smooth ? cubic : straight;
            log.doubt[k] += smooth ? 0.1 * std::fabs(cubic - straight)
                                   : std::fabs(cubic - straight) + 0.5 * std::fabs(right - left);
        }
    }
};

// The last decimal place that the values use, when it is a coarse one.
// That is the largest of 0.1, 0.01 ... 1e-8 of which all values are multiples, to a thousandth of
// it; 0 where they are written more finely. Its rounding has the variance step^2 / 12.
double last_digit(const std::vector<double> &v)
{
    for (double step = 1e-1; step > 5e-9; step *= 0.1) {
        bool all = true;
        for (size_t k = 0; k < v.size() && all; k++)
            all = std::isnan(v[k]) || std::fabs(v[k] / step - std::round(v[k] / step)) < 1e-3;
        if (all)
            return step;
    }
    return 0.0;
}

// Two readings on one count.
// Part of a count. Readings that come as counts differ by whole ones; those that were scaled or
// filtered on their way differ by a little.
constexpr double NEAR = 0.25;

// How readings go from count to count where they hardly change.
//
// A move is a change by more than NEAR from one reading to the next. Three moves in a row that
// alternate in sign, each of less than 1.5 counts and at most SOON readings after the one before
// it, are a zigzag. A smooth motion that turns makes two moves that alternate, not three. Noise is
// seen where there are FEWEST zigzags at least, and more than SHARE of the readings that stay on
// their count.
struct Flicker {
    bool noisy =
        false; // to and fro within a few rows, which rounding of a smooth motion never does
    bool rounded = false; // readings come twice

    Flicker(const std::vector<double> &q, double count)
    {
        constexpr size_t SOON = 4, FEWEST = 3; // rows; zigzags
        constexpr double SMALL = 1.5, SHARE = 0.008, SAME = 1e-3;
        // SMALL: counts that a move of noise is less than. SAME: difference, in counts, of readings
        // that are one value written twice.
        size_t zigzags = 0, repeats = 0, same = 0, row = 0;
        size_t at[3] = {0, 0, 0}; // rows of the last moves, newest first
        double move[3] = {0.0, 0.0, 0.0}, previous = MISSING;
        for (double x : q) {
            if (std::isnan(x))
                continue;
            const double d = (x - previous) / count;
            previous = x;
            row++;
            repeats += std::fabs(d) <= NEAR;
            same += std::fabs(d) <= SAME;
            if (!(std::fabs(d) > NEAR))
                continue;
            for (int i = 2; i > 0; i--)
                move[i] = move[i - 1], at[i] = at[i - 1];
            // A large move counts as 0, which has no sign: it ends a zigzag.
            move[0] = std::fabs(d) < SMALL ? d : 0.0, at[0] = row;
            zigzags += move[0] * move[1] < 0.0 && move[1] * move[2] < 0.0 &&
                       at[0] - at[1] <= SOON && at[1] - at[2] <= SOON;
        }
        noisy = zigzags >= FEWEST && (double)zigzags > SHARE * (double)repeats;
        rounded = 2 * same > repeats;
    }
};

// Whether readings go through a value rather than turning at it.
bool passes(double before, double at, double after)
{
    return (before < at && at < after) || (before > at && at > after);
}

// Readings that stay on one count.
struct Stay {
    size_t first, end;   // rows; missing readings do not end it
    size_t members;      // readings
    bool passed = false; // on the way through
    size_t way = 0;      // stays that are passed one after another, this one among them
};

// The stays of a log in their order; together they have all readings, and each reading is in one. A
// stay ends where a reading is further than `near` (in the joint's unit) from its first one, so
// that a slow drift does not carry a stay along. The first and the last stay are not passed: on one
// side nobody knows. `way` of n stays passed in a row is n for each of them, 0 for a stay that is
// not passed.
std::vector<Stay> stays_of(const std::vector<double> &q, double near)
{
    std::vector<Stay> stays;
    for (size_t k = 0, stop; k < q.size(); k = stop) {
        stop = k + 1;
        if (std::isnan(q[k]))
            continue;
        size_t members = 1;
        for (; stop < q.size() && (std::isnan(q[stop]) || std::fabs(q[stop] - q[k]) <= near);
             stop++)
            members += !std::isnan(q[stop]);
        stays.push_back({k, stop, members});
    }
    for (size_t i = 1; i + 1 < stays.size(); i++)
        stays[i].passed = passes(q[stays[i - 1].first], q[stays[i].first], q[stays[i + 1].first]);
    for (size_t i = 0, stop; i < stays.size(); i = stop) {
        stop = i + 1;
        while (stays[i].passed && stop < stays.size() && stays[stop].passed)
            stop++;
        for (size_t k = i; k < stop; k++)
            stays[k].way = stays[i].passed ? stop - i : 0;
    }
    return stays;
}

// Readings that stay on one count without passing through it (rest, a turning point) share one
// rounding error: together they are worth one. In passing, errors even out, unless that is a rest
// between two slips: long stays are worth no more than short ones. Nor do they where the way from
// one turn to the next is a few counts: how fast it goes there is not the same from one side of a
// count to the other, and comes again with every swing. Where noise decides how long they last,
// short ones are readings like all others: else those that stick out would weigh most. So a stay of
// m readings is worth
//     min(16, m)          with noise ,
//     min(8, m, way)      where it is passed on a way of as many stays ,
//     1                   else ,
// independent readings, and each of its readings has w^2 = worth / m.
void weigh(FitLog &log, int j)
{
    const std::vector<double> &q = log.q[j];
    std::vector<double> &w = log.weight[j];
    w.assign(q.size(), 0.0);
    const Flicker flicker(q, log.count[j]);
    const bool noisy = flicker.noisy;
    // LEFT: FitLog::repeating with noise of a third of a count; less noise leaves more. With noise
    // and readings that are not rounded to counts nothing repeats.
    constexpr double LEFT = 0.02;
    log.repeating[j] = !noisy ? 1.0 : flicker.rounded ? LEFT : 0.0;
    const double most = noisy ? 16.0 : 8.0;
    for (const Stay &stay : stays_of(q, NEAR * log.count[j])) {
        const double members = (double)stay.members;
        const double worth = noisy         ? std::min(most, members)
                             : stay.passed ? std::min({most, members, (double)stay.way})
                                           : 1.0;
        for (size_t i = stay.first; i < stay.end; i++)
            w[i] = std::isnan(q[i]) ? 0.0 : std::sqrt(worth / members);
    }
}

// Over steps of 20 ms, so that a count is not a speed.
// Missing readings make NaN, which is passed over.
double largest_speed(const FitLog &log, int j)
{
    const std::vector<double> &q = log.q[j];
    size_t step = std::max<size_t>(1, (size_t)std::lround(0.02 / log.period));
    double largest = 0.0;
    for (size_t k = 0; k + step < q.size(); k++) {
        double v = std::fabs(q[k + step] - q[k]) / (log.t[k + step] - log.t[k]);
        if (!std::isnan(v))
            largest = std::max(largest, v);
    }
    return largest;
}

// A single reading far off both neighbours' line is a glitch. With second differences
//     b_k = |q_(k-1) - 2 q_k + q_(k+1)| ,   limit = 8 max(99 % quantile of b, 3 noise) ,
// reading k goes if it is further than `limit` from the mean of its neighbours, b_k / 2 > limit,
// and these are within half of that distance of each other: what really moved that far takes its
// next reading along. The quantile is of all rows, so that fast motion raises the limit and single
// glitches do not. Fewer than ten differences say nothing, and all readings stay. Beside a reading
// that went, the next one stays: NaN compares false.
void drop_glitches(FitLog &log, int j, double noise)
{
    std::vector<double> &q = log.q[j];
    std::vector<double> bend;
    for (size_t k = 1; k + 1 < q.size(); k++)
        if (!std::isnan(q[k - 1] + q[k] + q[k + 1]))
            bend.push_back(std::fabs(q[k - 1] - 2.0 * q[k] + q[k + 1]));
    if (bend.size() < 10)
        return;
    std::sort(bend.begin(), bend.end());
    double usual = bend[bend.size() * 99 / 100], limit = 8.0 * std::max(usual, 3.0 * noise);
    for (size_t k = 1; k + 1 < q.size(); k++) {
        double off = q[k] - 0.5 * (q[k - 1] + q[k + 1]);
        if (std::fabs(off) > limit && std::fabs(q[k + 1] - q[k - 1]) < 0.5 * std::fabs(off))
            q[k] = MISSING;
    }
}

} // namespace

// Whether a row has a reading of any joint, and its command, if the record has commands at all.
static bool says_something(const mk_record &record, size_t row)
{
    bool reads = false;
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        reads = reads || (record.q[j] && !std::isnan(record.q[j][row]));
    return reads && !(record.u[0] && std::isnan(record.u[0][row]));
}

// `before` is the last row that says something, `first` the row where the piece begins. A piece
// ends with `before` where rows that are left out follow, or where the next row that says something
// is more than LONGEST_HOLE periods away; the last one ends with the record. The period is the
// median over all rows. `longest` is raised by holes that cut, also where the piece in front of
// them is too short to be kept.
std::vector<Piece> pieces_of(const mk_record &record, size_t rows, double &longest)
{
    std::vector<Piece> pieces;
    const double most = LONGEST_HOLE * median_period(record.t, rows);
    size_t first = 0, before = 0;
    bool cut = false; // rows since `before` are left out
    for (size_t k = 0; k <= rows; k++) {
        const bool end = k == rows;
        cut = cut || (!end && record.left_out && record.left_out[k] != 0.0);
        if (!end && !says_something(record, k))
            continue;
        const double hole = end || cut ? 0.0 : record.t[k] - record.t[before];
        if (end || cut || hole > most) {
            const size_t last = end && !cut ? k : before + 1;
            if (last - first >= Piece::FEWEST_ROWS)
                pieces.push_back({first, last});
            longest = std::max(longest, hole);
            first = k;
        }
        before = k;
        cut = false;
    }
    return pieces;
}

// The order of the steps matters: the last digit is that of commands as they were logged, before
// any is interpolated; fill_commands() needs a first command, which is the one that the record held
// when the piece began (0: the motor was off); glitches go before weights are given, so that they
// have none.
//
// Requires first + 2 <= last <= record.rows, and a `record` that has the joints of `model`. Times
// are from the first row of the piece, `start` is where that is in the run, s.
FitLog fit_log(const mk_record &record, const mk_model &model, size_t first, size_t last,
               int source)
{
    FitLog log;
    log.source = source;
    log.start = record.t[first] - record.begins;
    log.joints = mk_model_joints(&model);
    log.period = median_period(record.t + first, last - first);
    Builder builder(record, log, first, last);
    builder.copy_rows();
    log.u_step = last_digit(log.u[0]);
    for (int i = 0; i < MK_MAX_INPUTS; i++)
        if (std::isnan(log.u[i][0]))
            log.u[i][0] = first > 0 ? command(record, i, first - 1) : 0.0;
    builder.fill_commands();
    for (int j = 0; j < log.joints; j++) {
        log.count[j] = mk_model_count(&model, j);
        drop_glitches(log, j, log.count[j]);
        weigh(log, j);
        log.v_max[j] = largest_speed(log, j);
    }
    return log;
}

// Rows with t <= seconds. What belongs to the log as a whole (period, count, u_step, v_max,
// repeating) stays as it is, so that fits to beginnings of different lengths compare.
FitLog beginning_of(const FitLog &log, double seconds)
{
    FitLog part = log;
    const size_t rows =
        (size_t)(std::upper_bound(log.t.begin(), log.t.end(), seconds) - log.t.begin());
    part.t.resize(rows);
    part.doubt.resize(std::min(rows, log.doubt.size()));
    for (std::vector<double> &u : part.u)
        u.resize(std::min(rows, u.size()));
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        part.q[j].resize(std::min(rows, part.q[j].size()));
        part.weight[j].resize(std::min(rows, part.weight[j].size()));
    }
    return part;
}

// Motion that is a cubic in time within five rows has no fourth difference; what is left is noise,
//     d_k = q_k - 4 q_(k+1) + 6 q_(k+2) - 4 q_(k+3) + q_(k+4) ,   var d = 70 sigma^2 ,
// and the median of |d| does not see contacts, reversals and glitches. Readings that hardly leave
// their count give next to 0 (1e-9 rad is the least): scatter_of() adds what rounding makes.
double fit_log_noise(const FitLog &log, int j)
{
    const std::vector<double> &q = log.q[j];
    std::vector<double> scatter;
    for (size_t k = 0; k + 4 < q.size(); k++) {
        double d = q[k] - 4.0 * q[k + 1] + 6.0 * q[k + 2] - 4.0 * q[k + 3] + q[k + 4];
        if (!std::isnan(d))
            scatter.push_back(std::fabs(d));
    }
    // Fourth differences of white noise have 70 times its variance; 0.6745: median of |normal|.
    double fast = median_of(std::move(scatter)) / (0.6745 * std::sqrt(70.0));
    return std::max(fast, 1e-9);
}

// sigma_j = max over logs of (fit_log_noise, count / sqrt(12)): the second is the standard
// deviation of an error that is uniform over one count.
double scatter_of(const std::vector<const FitLog *> &logs, int joint)
{
    double scatter = 0.0;
    for (const FitLog *log : logs)
        scatter =
            std::max({scatter, fit_log_noise(*log, joint), log->count[joint] / std::sqrt(12.0)});
    return scatter;
}

double least_scatter(const std::vector<const FitLog *> &logs, int joint)
{
    double least = HUGE_VAL;
    for (const FitLog *log : logs)
        least = std::min(least, scatter_of({log}, joint));
    return least;
}

double independent_readings(const std::vector<const FitLog *> &logs)
{
    double sum = 0.0;
    for (const FitLog *log : logs)
        for (int j = 0; j < log->joints; j++)
            for (double w : log->weight[j])
                sum += w * w;
    return sum;
}

// max_j noise_j / scatter_j; 0 without logs.
double beyond_scatter(const std::vector<const FitLog *> &logs, const double *noise)
{
    double most = 0.0;
    for (int j = 0; !logs.empty() && j < logs[0]->joints; j++)
        most = std::max(most, noise[j] / scatter_of(logs, j));
    return most;
}

// A place is the pair of counts of both joints, rounded; of one joint, its count now and BEFORE
// rows ago. Of each reading in motion `visits` has how many readings in motion, of all logs, are at
// its place; the result is their median, 0 where nothing moves. Beyond 1e9 counts a number is no
// reading, and would not fit into 32 bits.
size_t usual_visits(const std::vector<const FitLog *> &logs)
{
    constexpr size_t BEFORE = 4;   // rows: what tells speeds apart where there is one joint only
    constexpr double MOVING = 8.0; // counts in that time
    using Place = std::pair<int32_t, int32_t>;
    std::vector<Place> places;
    for (const FitLog *log : logs) {
        const size_t other = (size_t)log->joints - 1;
        for (size_t k = BEFORE; k < log->rows(); k++) {
            double now[2], before[2];
            for (size_t j : {(size_t)0, other}) {
                now[j] = log->q[j][k] / log->count[j];
                before[j] = log->q[j][k - BEFORE] / log->count[j];
            }
            const double second = other ? now[1] : before[0];
            const double way =
                std::fabs(now[0] - before[0]) + std::fabs(now[other] - before[other]);
            if (way > MOVING && std::fabs(now[0]) < 1e9 && std::fabs(second) < 1e9)
                places.emplace_back((int32_t)std::lround(now[0]), (int32_t)std::lround(second));
        }
    }
    std::sort(places.begin(), places.end());
    std::vector<double> visits;
    // Sorted, equal places lie side by side: runs [first, k) of them, each reading of which counts
    // k - first visits.
    for (size_t first = 0, k = 1; k <= places.size(); k++)
        if (k == places.size() || places[k] != places[first]) {
            visits.insert(visits.end(), k - first, (double)(k - first));
            first = k;
        }
    return (size_t)median_of(std::move(visits));
}

} // namespace mk
