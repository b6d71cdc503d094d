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
constexpr double LONGEST_HOLE = 51.0; // that is bridged, periods

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
    // shows in how badly it continues either side.
    void fill_commands()
    {
        size_t n = log.rows();
        log.doubt.assign(n, 0.0);
        for (size_t k = 1; k < n; k++)
            if (held[k])
                log.doubt[k] = std::fabs(log.u[0][k] - last_command(k));
        for (int i = 0; i < MK_MAX_INPUTS; i++) {
            for (size_t k = 0; k < n; k++) {
                if (!std::isnan(log.u[i][k]))
                    continue;
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
    bool flagged(size_t row) const
    {
        constexpr unsigned OFF = MK_FLAG_LATE | MK_FLAG_OVERRUN | MK_FLAG_LOST | MK_FLAG_GAP;
        return rec.flags && rec.flags[row] >= 0.0 && ((unsigned)rec.flags[row] & OFF);
    }
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
    void fill_gap(size_t before, size_t after)
    {
        double gap = time(after) - time(before);
        double count = std::round(gap / log.period) - 1.0;
        if (!(count >= 1.0) || count >= LONGEST_HOLE)
            return;
        for (double i = 1.0; i <= count; i++)
            add(time(before) + gap * i / (count + 1.0), SIZE_MAX);
    }
    double last_command(size_t row) const
    {
        while (row-- > 0)
            if (!std::isnan(log.u[0][row]))
                return log.u[0][row];
        return 0.0;
    }
    // The loop stood still, and with it the command.
    void hold(std::vector<double> &u, size_t first, size_t last)
    {
        for (size_t k = first; k < last; k++)
            u[k] = first > 0 ? u[first - 1] : u[last];
    }
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
constexpr double NEAR = 0.25;

// How readings go from count to count where they hardly change.
struct Flicker {
    bool noisy =
        false; // to and fro within a few rows, which rounding of a smooth motion never does
    bool rounded = false; // readings come twice

    Flicker(const std::vector<double> &q, double count)
    {
        constexpr size_t SOON = 4, FEWEST = 3; // rows; zigzags
        constexpr double SMALL = 1.5, SHARE = 0.008, SAME = 1e-3;
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
// count to the other, and comes again with every swing. Where noise decides how long
// they last, short ones are readings like all others: else those that stick out would weigh most.
void weigh(FitLog &log, int j)
{
    const std::vector<double> &q = log.q[j];
    std::vector<double> &w = log.weight[j];
    w.assign(q.size(), 0.0);
    const Flicker flicker(q, log.count[j]);
    const bool noisy = flicker.noisy;
    // Of noise of a third of a count; less of it leaves more.
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

// A single reading far off both neighbours' line is a glitch.
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

static bool says_something(const mk_record &record, size_t row)
{
    bool reads = false;
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        reads = reads || (record.q[j] && !std::isnan(record.q[j][row]));
    return reads && !(record.u[0] && std::isnan(record.u[0][row]));
}

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

double beyond_scatter(const std::vector<const FitLog *> &logs, const double *noise)
{
    double most = 0.0;
    for (int j = 0; !logs.empty() && j < logs[0]->joints; j++)
        most = std::max(most, noise[j] / scatter_of(logs, j));
    return most;
}

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
    for (size_t first = 0, k = 1; k <= places.size(); k++)
        if (k == places.size() || places[k] != places[first]) {
            visits.insert(visits.end(), k - first, (double)(k - first));
            first = k;
        }
    return (size_t)median_of(std::move(visits));
}

} // namespace mk
