// Foreign contact (ident/contact.hpp): an outlier test on the torque that each equation of the
// plant lacks.
//
// Blocks k of 50 ms have a residual torque r_k and what acts in the equation, a_k
// (ident/residual_torque.hpp). Averages over some blocks are weighed by
//     m_k = mean r / sqrt(1 + (mean a / usual)^2) ,   size_k = |m_k| / s ,
// s the robust standard deviation of all m: errors of a model are a part of what acts, so that more
// is tolerated where more acts. A stretch is foreign if it is far out of proportion to what usually
// remains (PEAK), to what remains anywhere else (EXCESS), and to what acts at that time (SHARE),
// the last two multiplied PRODUCT at least. An error of the model is a part of what acts, and comes
// again wherever the rig does the same again; a hand does neither.
//
// For each equation of the plant, and averages over each of WIDTHS blocks: the stretches of largest
// size are taken one after another (Sizes::take), those before the largest drop in their peaks
// belong together (EquationSearch::largest), and all of these are foreign or none is
// (EquationSearch::foreign). What is found in several equations or widths is united at the end.
//
// Five things look like a touch and are none: what takes up much of the motion or of a log, what
// pushes back from the end of the travel each time, what is small against busy times, what changes
// its sign within a few blocks, and what the given model predicts as it is.
#include "ident/contact.hpp"

#include <algorithm>
#include <cmath>
#include <memory>

#include "ident/quantiles.hpp"
#include "ident/residual_torque.hpp"
#include "sim/effect_memory.hpp"

namespace mk
{

namespace
{

// How far out of proportion a residual torque must be. Calibrated on 1000 made-up sets without a
// touch, every effect of the catalogue and fourteen others hidden in them, 180 with one, and the
// nine measured rigs.
constexpr double PEAK = 8.0;       // standard deviations of what usually remains
constexpr double SHARE = 0.6;      // of what acts then, counted as in ResidualTorques (2 at most)
constexpr double PRODUCT = 4.0;    // of that share and of the excess over all that is elsewhere
constexpr double EXCESS = 2.0;     // over all that is elsewhere
constexpr double RELEVANT = 0.3;   // of what acts at busy times
constexpr double MOST_DATA = 0.3;  // more than this share of the motion is the rule, not foreign
constexpr double MOST_LOG = 0.5;   // longer than this share of its log it is that log's nature
constexpr double FLANK = 4.0;      // standard deviations at which a touch begins and ends
constexpr double TRAIL = 0.05;     // of the peak: less of it is the smoother's
constexpr double GAP = 0.3;        // s: touches nearer each other are one
constexpr double CORE = 1.0 / 3.0; // of the peak: where its share is counted
// The end of a joint's travel, as a share of its range over all logs: what pushes it back from
// there is a stop.
constexpr double TRAVEL_END = 0.05;
constexpr double STOP_APART = 1.5; // s between two visits
// A reading that slips pushes and pulls within two blocks; a touch of that length pushes.
constexpr double SHORT = 0.45, ONE_WAY = 0.2; // s; sum over sum of sizes
constexpr double MARGIN = 1.0;                // blocks on either side
constexpr double LOG_END = 0.25;              // s: nearer to a log's end it lasts to there
constexpr size_t WIDTHS[] = {1, 2, 4};        // blocks that are averaged
// Where the smoother cannot follow, its errors push and pull from block to block. What single
// blocks show must therefore show in averages over two, of which this share of PRODUCT is asked.
constexpr double CONFIRMED = 0.9;

// Blocks [first, last) with the largest size among them.
struct Stretch {
    size_t first, last;
    double peak;
};

// Sizes of one equation's residual torque, averaged over some blocks: in standard deviations of
// what usually remains, more tolerated where more acts.
class Sizes
{
  public:
    // A block has the largest size of the averages that it is in: one that lasts for `width` blocks
    // shows in all of them. 0 where nothing is known, and everywhere if the usual size is 0.
    Sizes(const ResidualTorques &r, const ResidualTorques::Equation &e, size_t width)
        : all(r), equation(e), size(r.blocks(), 0.0)
    {
        std::vector<double> means;
        for (size_t k = 0; k + width <= r.blocks(); k++) {
            const double mean = tolerated_mean(k, width);
            if (std::isnan(mean))
                continue;
            means.push_back(mean);
            for (size_t i = k; i < k + width; i++)
                size[i] = std::max(size[i], std::fabs(mean));
        }
        // Robust standard deviation of the averages.
        const double usual =
            deviation(Eigen::Map<Eigen::VectorXd>(means.data(), (long)means.size()));
        for (double &x : size)
            x = usual > 0.0 ? x / usual : 0.0;
        left = size;
    }
    double at(size_t block) const { return size[block]; }
    // The largest that is left, with what belongs to it; it is no longer left then. From its peak
    // it reaches to either side over blocks above FLANK standard deviations, and over gaps between
    // those of up to GAP seconds, within its log. Its flanks are those of all sizes, also of what
    // another stretch has taken. Where nothing is left the peak is 0.
    Stretch take()
    {
        const size_t gap = std::max<size_t>(1, (size_t)(GAP / all.block_s));
        const size_t top = (size_t)(std::max_element(left.begin(), left.end()) - left.begin());
        Stretch s = {top, top + 1, left[top]};
        for (size_t k = top + 1; k < all.blocks() && same_log(k, top) && k < s.last + gap; k++)
            if (size[k] > FLANK)
                s.last = k + 1;
        for (size_t k = top; k-- > 0 && same_log(k, top) && k + gap >= s.first;)
            if (size[k] > FLANK)
                s.first = k;
        std::fill(left.begin() + (long)s.first, left.begin() + (long)s.last, 0.0);
        return s;
    }

  private:
    const ResidualTorques &all;
    const ResidualTorques::Equation &equation;
    std::vector<double> size, left;

    bool same_log(size_t a, size_t b) const { return all.log[a] == all.log[b]; }
    // m of blocks [first, first + width); NaN across logs, and where a residual torque is unknown.
    double tolerated_mean(size_t first, size_t width) const
    {
        double torque = 0.0, acting = 0.0;
        for (size_t i = first; i < first + width; i++) {
            if (!same_log(i, first))
                return std::nan("");
            torque += equation.residual[i] / (double)width;
            acting += equation.acting[i] / (double)width;
        }
        return torque / std::hypot(1.0, acting / equation.usual);
    }
};

// What a stretch is made of where it is near its peak: over the blocks k of it with a size above
// CORE times the peak,
//     share   = sum |r_k| / sum a_k ,   2 at most, where nothing in the model balances r (a_k is
//               half of what acts, sign aside) ,
//     one_way = |sum r_k| / sum |r_k| ,
//     angle   = sum q_k |r_k| / sum |r_k| ,   q_k the joint's mean reading ,
// torques in the model's units. All 0 where no block has a torque.
struct Core {
    double share = 0.0;   // of what acts
    double one_way = 0.0; // 1: all in one direction
    double largest = 0.0; // torque of a block
    double sum = 0.0;     // of the blocks' torques
    double angle = 0.0;   // mean

    Core(const ResidualTorques::Equation &e, const Sizes &sizes, const Stretch &s)
    {
        double total = 0.0, acting = 0.0;
        for (size_t k = s.first; k < s.last; k++) {
            if (!(sizes.at(k) > CORE * s.peak) || std::isnan(e.residual[k]))
                continue;
            sum += e.residual[k];
            total += std::fabs(e.residual[k]);
            angle += e.angle[k] * std::fabs(e.residual[k]);
            acting += e.acting[k];
            largest = std::max(largest, std::fabs(e.residual[k]));
        }
        if (total > 0.0) {
            share = total / acting;
            angle /= total;
            one_way = std::fabs(sum) / total;
        }
    }
};

// By block: whether a joint moves on from the one before by more than a count of its encoder.
std::vector<char> moving_blocks(const mk_model &model, const ResidualTorques &r)
{
    std::vector<char> moves(r.blocks(), 0);
    for (int j = 0; j < r.joints; j++)
        for (size_t k = 1; k < r.blocks(); k++)
            if (r.log[k] == r.log[k - 1] &&
                std::fabs(r.equation[j].angle[k] - r.equation[j].angle[k - 1]) >
                    mk_model_count(&model, j))
                moves[k] = 1;
    return moves;
}

// What is foreign in one equation. Borrows everything.
class EquationSearch
{
  public:
    EquationSearch(const ResidualTorques &r, const std::vector<char> &moving, int e)
        : all(r), moves(moving), number(e), equation(r.equation[e]), narrow(r, equation, 1)
    {
    }
    // Adds what is found to `out`; the same touch may come once for each width.
    void find(std::vector<Contact> &out) const
    {
        for (size_t width : WIDTHS) {
            const Found f = largest(width);
            if (foreign(f, PRODUCT, ONE_WAY) &&
                (width > 1 || foreign(largest(2), CONFIRMED * PRODUCT, 0.0)))
                for (const Stretch &s : f.stretches)
                    out.push_back(contact(s, f.sizes, f.excess));
        }
    }

  private:
    // What is largest in averages of some blocks, above all that is elsewhere.
    struct Found {
        Sizes sizes;
        std::vector<Stretch> stretches;
        double excess;
    };

    const ResidualTorques &all;
    const std::vector<char> &moves;
    const int number;
    const ResidualTorques::Equation &equation;
    const Sizes narrow;

    // Sizes of separate stretches, largest first, p_1 >= p_2 >= ...: those before the place where
    // p_i / max(p_(i+1), FLANK) is largest, which is the excess. Twice the number of logs at most.
    // So several touches do not hide each other, as they would if each were held against the next:
    // a hand that lifts the pendulum at the start of every log makes as many peaks as logs. FLANK
    // keeps a drop among sizes that are nothing from counting.
    Found largest(size_t width) const
    {
        Found f = {Sizes(all, equation, width), {}, 0.0};
        const size_t most = 2 * (all.log.back() + 1);
        for (size_t i = 0; i <= most; i++)
            f.stretches.push_back(f.sizes.take());
        size_t count = 0;
        for (size_t i = 0; i < most; i++) {
            const double drop = f.stretches[i].peak / std::max(f.stretches[i + 1].peak, FLANK);
            if (drop > f.excess)
                f.excess = drop, count = i + 1;
        }
        f.stretches.resize(count);
        return f;
    }

    // What is left is the command less what the motion needs, so what pushes back from the upper
    // end of the travel is above 0. A stop does so each time that the joint comes there.
    bool is_stop(const Stretch &s, const Core &core) const
    {
        const auto [low, high] = std::minmax_element(equation.angle.begin(), equation.angle.end());
        const double near = TRAVEL_END * (*high - *low), side = core.sum > 0.0 ? 1.0 : -1.0;
        const double end = core.sum > 0.0 ? *high - near : -*low - near;
        bool again = false;
        for (size_t k = 0; k < all.blocks() && side * core.angle > end; k++) {
            const bool apart =
                all.log[k] != all.log[s.first] || std::fabs(all.t[k] - all.t[s.first]) > STOP_APART;
            again = again || (apart && side * equation.angle[k] > end &&
                              side * equation.residual[k] > 0.0 && narrow.at(k) > FLANK);
        }
        return again;
    }
    size_t blocks_of_log(const Stretch &s) const
    {
        return (size_t)std::count(all.log.begin(), all.log.end(), all.log[s.first]);
    }
    // Whether the stretches of `f` are foreign, all or none. Each has to be, by its core; together
    // they have to take up less than MOST_DATA of the blocks in which something moves, and must not
    // all be stops. `least_product` and `least_one_way` stand for PRODUCT and ONE_WAY.
    bool foreign(const Found &f, double least_product, double least_one_way) const
    {
        size_t moving = 0, stops = 0;
        if (f.stretches.empty() || f.excess < EXCESS || f.stretches.back().peak < PEAK)
            return false;
        for (const Stretch &s : f.stretches) {
            const Core core(equation, f.sizes, s);
            const double seconds = all.block_s * (double)(s.last - s.first);
            moving +=
                (size_t)std::count(moves.begin() + (long)s.first, moves.begin() + (long)s.last, 1);
            stops += is_stop(s, core);
            if ((double)(s.last - s.first) > MOST_LOG * (double)blocks_of_log(s))
                return false;
            if (core.share < SHARE || core.share * f.excess < least_product ||
                core.largest < RELEVANT * equation.usual ||
                (seconds < SHORT && core.one_way < least_one_way))
                return false;
        }
        const auto motion = (double)std::count(moves.begin(), moves.end(), 1);
        return stops < f.stretches.size() && (double)moving < MOST_DATA * motion;
    }
    // Averages reach beyond a touch: its ends are those of single blocks, where they show it.
    Contact contact(Stretch s, const Sizes &sizes, double excess) const
    {
        const Core core(equation, sizes, s);
        size_t first = s.first, last = s.last;
        double peak = 0.0;
        for (size_t k = first; k < last; k++)
            peak = std::max(peak, narrow.at(k));
        const double flank = std::max(FLANK, TRAIL * peak);
        while (first < last && narrow.at(first) <= flank)
            first++;
        while (last > first && narrow.at(last - 1) <= flank)
            last--;
        if (first < last)
            s.first = first, s.last = last;
        const double margin = (0.5 + MARGIN) * all.block_s;
        double from = all.t[s.first] - margin, to = all.t[s.last - 1] + margin;
        size_t end = s.last;
        while (end < all.blocks() && all.log[end] == all.log[s.first])
            end++;
        if (from < LOG_END)
            from = 0.0;
        if (to > all.t[end - 1] + 0.5 * all.block_s - LOG_END)
            to = HUGE_VAL;
        return {all.log[s.first], from, to, number + 1, core.largest, excess};
    }
};

// Those that overlap, or are within GAP of each other, are one: from the first beginning to the
// last end, with joint, torque and excess of the one with the larger excess.
void unite(std::vector<Contact> &all)
{
    std::sort(all.begin(), all.end(), [](const Contact &a, const Contact &b) {
        return a.log != b.log ? a.log < b.log : a.from_s < b.from_s;
    });
    std::vector<Contact> out;
    for (const Contact &c : all) {
        if (out.empty() || out.back().log != c.log || c.from_s > out.back().to_s + GAP) {
            out.push_back(c);
            continue;
        }
        Contact &last = out.back();
        const double from = last.from_s, to = std::max(last.to_s, c.to_s);
        if (c.times > last.times)
            last = c;
        last.from_s = from, last.to_s = to;
    }
    all = std::move(out);
}

// Squared residuals of the straight line through the readings of rows [first, last), counts^2, sum
// over joints: with centred sums,
//     S_yy - S_xy^2 / S_xx .
double off_a_line(const mk_model &model, const mk_record &r, size_t first, size_t last)
{
    double sum = 0.0;
    for (int j = 0; j < mk_model_joints(&model); j++) {
        double n = 0.0, t = 0.0, q = 0.0, tt = 0.0, tq = 0.0, qq = 0.0;
        for (size_t k = first; k < last; k++) {
            const double y = (r.q[j][k] - r.q[j][first]) / mk_model_count(&model, j);
            const double x = r.t[k] - r.t[first];
            if (std::isnan(y))
                continue;
            n += 1.0, t += x, q += y, tt += x * x, tq += x * y, qq += y * y;
        }
        const double xx = tt - t * t / n, xy = tq - t * q / n, yy = qq - q * q / n;
        sum += xx > 0.0 ? std::max(yy - xy * xy / xx, 0.0) : 0.0;
    }
    return sum;
}

// Whether the model as it is predicts the stretch: of what turns its motion off straight lines, in
// windows of WINDOW_S, free runs from the best start states leave less than NEXT_TO_NOTHING
// (squared), or less than a count a reading. Then nothing that is foreign acts there, however much
// a smoother makes of it. A stretch that is shorter than a window is looked at in one that begins
// with it. With S_w the squared error of the free run over window w and L_w that of the straight
// line through its readings, counts^2, and n readings in all:
//     sum_w S_w < max(NEXT_TO_NOTHING sum_w L_w , A_COUNT n) .
// Both fits have two free values a joint, so that the ratio asks what the model's accelerations
// add. False where no window can be looked at.
bool is_predicted(const mk_model &model, const mk_record &record, const Contact &c)
{
    constexpr double WINDOW_S = 0.2, NEXT_TO_NOTHING = 0.04, A_COUNT = 1.0;
    constexpr size_t FEWEST_ROWS = 12;
    const std::unique_ptr<mk_start_finder> finder = basic_finder(record, model);
    std::vector<WindowFit> fits;
    std::vector<Eigen::VectorXd> x;
    double straight = 0.0, readings = 0.0;
    const auto look_at = [&](size_t first, size_t last) {
        Eigen::VectorXd begin(mk_model_state_count(&model));
        if (last - first < FEWEST_ROWS || !first_guess(*finder, last, first, begin))
            return;
        fits.emplace_back(*finder, first, last);
        x.push_back(std::move(begin));
        straight += off_a_line(model, record, first, last);
        readings += (double)((last - first) * (size_t)mk_model_joints(&model));
    };
    const auto window_end = [&](size_t first) {
        size_t last = first + 1;
        while (last < record.rows && record.t[last] - record.t[first] < WINDOW_S)
            last++;
        return last;
    };
    size_t begins = record.rows; // the stretch
    for (size_t first = 0, last; first < record.rows; first = last) {
        last = window_end(first);
        if (record.t[first] - record.t[0] >= c.from_s && record.t[last - 1] - record.t[0] <= c.to_s)
            look_at(first, last);
    }
    while (begins > 0 && record.t[begins - 1] - record.t[0] >= c.from_s)
        begins--;
    if (fits.empty() && begins < record.rows)
        look_at(begins, window_end(begins));
    if (fits.empty())
        return false;
    WindowFit::solve(fits, x);
    double left = 0.0;
    for (double squares : WindowFit::costs(fits, x))
        left += squares;
    return left < std::max(NEXT_TO_NOTHING * straight, A_COUNT * readings);
}

} // namespace

// The costly question comes last, of what is left: is_predicted() runs the model.
std::vector<Contact> find_contacts(const mk_model &model, const std::vector<mk_record> &records)
{
    const ResidualTorques all = residual_torques(model, records);
    const std::vector<char> moves = moving_blocks(model, all);
    std::vector<Contact> out;
    for (int e = 0; e < all.joints; e++)
        if (all.equation[e].usual > 0.0)
            EquationSearch(all, moves, e).find(out);
    unite(out);
    out.erase(
        std::remove_if(out.begin(), out.end(),
                       [&](const Contact &c) { return is_predicted(model, records[c.log], c); }),
        out.end());
    return out;
}

} // namespace mk
