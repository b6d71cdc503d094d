// The budget of the gap: which item closes how much of it (explain/evidence/budget.hpp).
//
// With MSE_j(S) the mean squared error of free runs on held-out data, joint j, of the extended
// model with the set S of items only, all else fitted again, and n_j^2 that of the readings' noise,
// S closes
//     v(S) = mean_j (MSE_j(none) - MSE_j(S)) / (MSE_j(none) - n_j^2) .
// The share of item i is its Shapley value (L. Shapley 1953): what it adds to what is closed when
// it is added, averaged over orders of adding,
//     share_i = mean over orders of c(before i and i) - c(before i) ,
//     c = max of v over none and the sets so far in that order, at most v(all);  c(all) = v(all) .
// An item that is added can be fitted to nothing, so that a set closes no less than a part of it;
// where free runs on other data say less, the fit did not carry over without the items to come. The
// shares do not depend on the order in which the search found items, and add up to v(all) in every
// single order. An item is a cause, what differs from log to log, or the command's other column
// with its delay.
//
// Sets are bit masks; v of each is computed once (`figures`), since it takes a fit. It is fitted to
// the free runs of the training data, since v measures free runs.
#include "explain/evidence/budget.hpp"

#include <algorithm>
#include <bitset>
#include <cmath>
#include <cstring>
#include <map>
#include <memory>
#include <numeric>

#include "explain/evidence/resamples.hpp"
#include "explain/policy.hpp"
#include "ident/held_out.hpp"

namespace mk
{

namespace
{

// Bit i stands for items[i]; there are MK_MAX_BUDGET at most, far fewer than bits.
using Set = unsigned; // of items, one bit each

// What causes and log values close, by which of them a model has.
// v(S) and what follows from it. Keeps two caches: `figures` has the held-out errors of every set
// that was asked for, each of which but none and all took a fit; `orders` the orders over which
// shares are averaged. Neither depends on a resample, so that intervals take no further fits.
class Shares
{
  public:
    Shares(const TrainingData &data, int threads, TrainingRuns &training_in,
           const mk_explanation &out_in)
        : held(data.held, out_in.window_s, data.second_half, threads), training(training_in),
          out(out_in), joints(mk_model_joints(&out_in.given))
    {
        find_items();
    }
    struct Item {
        mk_budget_item entry;
        // The effects by which the item differs from the refitted model. Of the command's other
        // column they are its delay and lag, and may be none.
        std::vector<int> effects; // of the extended model
    };
    std::vector<Item> items;

    // Held-out errors of the extended model with these items only, all else fitted again.
    // A set whose model cannot be run over the held-out logs counts as the refitted one. The
    // reference stays valid: `figures` is a map.
    const HeldOutFigures &of(Set set)
    {
        auto known = figures.find(set);
        if (known != figures.end())
            return known->second;
        // v of no items is the refitted model, v of all the extended one: both are fitted already.
        HeldOutFigures &f = figures[set];
        if (set == everything())
            (void)!held.figures(out.extended, f, nullptr);
        else if (set == 0)
            (void)!held.figures(out.refit, f, nullptr);
        else if (held.figures(model_with(set), f, nullptr) != MK_OK)
            f = of(0); // a model that runs away closes nothing
        return f;
    }
    Set everything() const { return (1u << items.size()) - 1u; }

    // v(S), or of a resample in which window w counts times[w]. Mean over the joints that have a
    // gap: squared error above the noise by more than policy::A_GAP of it.
    // A joint without a gap has a denominator near 0 and would decide alone. Below 0 where the
    // model with the set is further off than the refitted one; 0 where no joint has a gap.
    double closed(Set set, const Times *times = nullptr)
    {
        double sum = 0.0;
        int judged = 0;
        for (int j = 0; j < joints; j++) {
            const double before = mean_square(of(0), j, times),
                         now = mean_square(of(set), j, times);
            const double floor = out.floor[j] * out.floor[j];
            if (!(before - floor > policy::A_GAP * floor))
                continue;
            sum += (before - now) / (before - floor);
            judged++;
        }
        return judged ? sum / judged : 0.0;
    }
    // sum_j MSE_j(S) / n_j^2: joints in different units add up, and unlike v it is not a share of a
    // gap that may be small.
    double in_noise(Set set)
    {
        double sum = 0.0;
        for (int j = 0; j < joints; j++)
            if (out.floor[j] > 0.0)
                sum += mean_square(of(set), j, nullptr) / (out.floor[j] * out.floor[j]);
        return sum;
    }
    // Of every item, its share, in the order of `items`; of a resample of the windows where `times`
    // is given. In each order of adding
    //     c_0 = 0 ,   c_k = max(c_(k-1), min(v(first k items), v(all))) ,   c_n = v(all) ,
    // item k gets c_k - c_(k-1), so that an order sums up to v(all) whatever the sets in between
    // say. All shares are at least 0 if v(all) is; else the last item of each order bears what is
    // lost.
    std::vector<double> shares(const Times *times = nullptr)
    {
        if (orders.empty())
            find_orders();
        // v by set: every order passes many sets that another one has passed.
        std::map<Set, double> v;
        const auto closed_by = [&](Set set) {
            const auto [at, fresh] = v.try_emplace(set, 0.0);
            if (fresh)
                at->second = closed(set, times);
            return at->second;
        };
        const double all = closed_by(everything());
        std::vector<double> share(items.size(), 0.0);
        for (const std::vector<size_t> &order : orders) {
            Set set = 0;
            double before = 0.0;
            for (size_t item : order) {
                set |= 1u << item;
                const double now =
                    set == everything() ? all : std::max(before, std::min(closed_by(set), all));
                share[item] += (now - before) / (double)orders.size();
                before = now;
            }
        }
        return share;
    }
    const HeldOut &runs() const { return held; }

  private:
    const HeldOut held;
    TrainingRuns &training;
    const mk_explanation &out;
    int joints;
    std::map<Set, HeldOutFigures> figures;
    std::vector<std::vector<size_t>> orders; // of items

    // The effects beyond the given model's, one item each. A cause is known by effect, joint and
    // first value, what differs from log to log by effect and joint, which takes precedence.
    // Effects that are neither came with the other column of the command: with it they are one
    // item, the last.
    void find_items()
    {
        const mk_budget_item none = {-1, -1, false, 0.0, 0.0, 0.0, std::nan(""), {}};
        Item late = {none, {}}; // what comes with the other column of the command
        for (int e = out.given.effect_count; e < out.extended.effect_count; e++) {
            const mk_effect_use &use = out.extended.effect[e];
            Item item = {none, {e}};
            for (int i = 0; i < out.cause_count; i++)
                if (out.cause[i].effect == mk_effect(use.index) &&
                    out.cause[i].joint == use.joint && out.cause[i].value[0] == use.value[0])
                    item.entry.cause = i;
            for (int i = 0; i < out.log_value_count; i++)
                if (out.log_value[i].effect == mk_effect(use.index) &&
                    out.log_value[i].joint == use.joint)
                    item.entry.log_value = i, item.entry.cause = -1;
            if (item.entry.cause >= 0 || item.entry.log_value >= 0)
                items.push_back(item);
            else
                late.effects.push_back(e);
        }
        late.entry.input = true;
        if (out.input.changed)
            items.push_back(late);
    }
    // The extended model less the effects of all items that are not in the set, fitted again, to
    // what v measures.
    // Effects go from the highest number down, so that lower numbers stay valid.
    mk_model model_with(Set set)
    {
        mk_model m = out.extended;
        bool given_column = false;
        std::vector<int> gone;
        for (size_t i = 0; i < items.size(); i++) {
            if (set & (1u << i))
                continue;
            gone.insert(gone.end(), items[i].effects.begin(), items[i].effects.end());
            given_column = given_column || items[i].entry.input;
        }
        std::sort(gone.rbegin(), gone.rend());
        for (int effect : gone) {
            for (int e = effect; e + 1 < m.effect_count; e++)
                m.effect[e] = m.effect[e + 1];
            m.effect_count--;
        }
        if (given_column)
            m.input = out.given.input;
        return training.part(m, given_column);
    }
    // All n! orders up to ALL_ORDERS items, which take 2^n fits; else the model's order and its
    // reverse, which take 2 n at most.
    void find_orders()
    {
        std::vector<size_t> order(items.size());
        std::iota(order.begin(), order.end(), 0u);
        if (items.size() <= ALL_ORDERS) {
            do
                orders.push_back(order);
            while (std::next_permutation(order.begin(), order.end()));
        } else {
            orders.push_back(order);
            orders.emplace_back(order.rbegin(), order.rend());
        }
    }
    static constexpr size_t ALL_ORDERS = 4;
};

// The same windows and times for all sets: errors of windows are computed once, and a resample only
// weighs them.
// low and high of each item: 90 % of resamples of the held-out logs and their windows
// (explain/evidence/resamples.hpp).
void find_intervals(Shares &shares)
{
    const std::vector<Interval> found =
        intervals_of(shares.of(0), [&](const Times &times) { return shares.shares(&times); });
    for (size_t k = 0; k < found.size(); k++) {
        shares.items[k].entry.low = found[k].low;
        shares.items[k].entry.high = found[k].high;
    }
}

// Causes by in_noise(all but the cause), what their absence leaves, all else fitted again; pieces
// of what has no name stay last.
void sort_causes(Shares &shares, mk_explanation &out)
{
    if (out.cause_count < 2)
        return;
    double worth[MK_MAX_CAUSES] = {};
    const Set all = shares.everything();
    for (size_t k = 0; k < shares.items.size(); k++)
        if (shares.items[k].entry.cause >= 0)
            worth[shares.items[k].entry.cause] = shares.in_noise(all & ~(1u << k));
    std::vector<int> order((size_t)out.cause_count);
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(), [&](int x, int y) {
        return out.cause[x].piece != out.cause[y].piece ? out.cause[y].piece : worth[x] > worth[y];
    });
    // place[i] is where cause i is now: rivals and items know causes by number.
    int place[MK_MAX_CAUSES];
    mk_cause sorted[MK_MAX_CAUSES];
    for (int i = 0; i < out.cause_count; i++) {
        sorted[i] = out.cause[order[(size_t)i]];
        place[order[(size_t)i]] = i;
    }
    std::copy_n(sorted, out.cause_count, out.cause);
    for (int i = 0; i < out.rival_count; i++)
        out.rival[i].instead_of = place[out.rival[i].instead_of];
    for (Shares::Item &item : shares.items)
        if (item.entry.cause >= 0)
            item.entry.cause = place[item.entry.cause];
}

// The joint with the largest rest, if its error is more than twice the noise, and what that error
// goes with: tests of one-step predictions (innovations.cpp) below policy::TEST_LEVEL over all
// tests (Bonferroni), the strongest first.
void tell_rest(const mk_explanation &e, mk_budget &b)
{
    // left_j = MSE_j(all) - n_j^2, over MSE_j(refit).
    b.rest = 1.0 - b.closed;
    double most = 0.0;
    for (int j = 0; j < mk_model_joints(&e.given); j++) {
        const double left = b.extended[j] * b.extended[j] - b.noise[j] * b.noise[j];
        const double of = left / std::max(b.refit[j] * b.refit[j], 1e-300);
        if (b.extended[j] > 2.0 * b.noise[j] && of > most)
            most = of, b.rest_joint = j + 1;
    }
    std::vector<const mk_residual_test *> tests;
    for (int i = 0; i < e.residual_test_count; i++) {
        const mk_residual_test &t = e.residual_test[i];
        if (t.joint == b.rest_joint && std::strcmp(t.with, "itself") != 0 &&
            t.p_after < policy::TEST_LEVEL / e.residual_test_count)
            tests.push_back(&t);
    }
    std::stable_sort(tests.begin(), tests.end(),
                     [](const mk_residual_test *x, const mk_residual_test *y) {
                         return std::fabs(x->after) > std::fabs(y->after);
                     });
    for (const mk_residual_test *t : tests)
        if (b.goes_with_count < (int)(sizeof b.goes_with / sizeof b.goes_with[0]))
            b.goes_with[b.goes_with_count++] = t->with;
}

} // namespace

// Errors of out.before, refitted, after and floor are shares of the deviation of the held-out
// readings; those of the budget are rms in the joint's unit. An extension that is not offered has
// no shares, only a rest.
void make_budget(const TrainingData &data, const CauseSearch &causes, int threads,
                 TrainingRuns &training, mk_explanation &out)
{
    mk_budget &b = out.budget;
    b = {};
    Shares shares(data, threads, training, out);
    const int joints = mk_model_joints(&out.given);
    double deviation[MK_MAX_JOINTS] = {};
    for (int j = 0; j < joints; j++) {
        deviation[j] = shares.runs().deviation(out.given, j);
        b.given[j] = out.before[j] * deviation[j];
        b.refit[j] = out.refitted[j] * deviation[j];
        b.extended[j] = out.after[j] * deviation[j];
        b.noise[j] = out.floor[j] * deviation[j];
    }
    if (out.offered && !shares.items.empty()) {
        b.closed = shares.closed(shares.everything());
        const std::vector<double> share = shares.shares();
        for (size_t i = 0; i < shares.items.size(); i++) {
            Shares::Item &item = shares.items[i];
            item.entry.share = share[i];
            // causes.carried is in the order of the causes' effects, which come after those of the
            // refitted model.
            const int first = causes.refit.point.model.effect_count;
            const int round = item.entry.cause >= 0 ? item.effects[0] - first : -1;
            if (round >= 0 && round < (int)causes.carried.size())
                item.entry.inclusion = causes.carried[(size_t)round].inclusion;
        }
        find_intervals(shares);
        sort_causes(shares, out);
        std::vector<size_t> order(shares.items.size());
        std::iota(order.begin(), order.end(), 0u);
        std::stable_sort(order.begin(), order.end(), [&](size_t x, size_t y) {
            return shares.items[x].entry.share > shares.items[y].entry.share;
        });
        // The waterfall: errors with the items of the largest shares first, one more each.
        Set set = 0;
        for (size_t i : order) {
            set |= 1u << i;
            mk_budget_item &entry = b.item[b.item_count++];
            entry = shares.items[i].entry;
            for (int j = 0; j < joints; j++)
                entry.rms[j] = shares.of(set).nrmse(j) * deviation[j];
        }
    }
    tell_rest(out, b);
}

} // namespace mk
