// Whether a cause improves the prediction of data that it was not fitted to
// (explain/evidence/carry_over.hpp).
//
// With e_w the squared error that a model leaves in window w of a fold that it was not fitted to,
// each window gives
//     r_w = log((e_w(with) + c) / (e_w(without) + c)) ,
// c a tenth of the mean error without. Ratios, not differences: windows differ by orders of
// magnitude, and the largest would decide alone. c: a window in which next to nothing is missed
// says next to nothing. With m_f the mean of r_w over fold f, and F folds,
//     mean  = 1/F sum_f m_f ,
//     error = sqrt(max(sum_f (m_f - mean)^2 / (F (F - 1)), var(r_w) / number of windows)) .
// The second is the standard error as if windows were independent: of few folds the scatter among
// them can be small by chance. A cause is there if mean is enough standard errors below 0, folds
// agree, and the gap that it closes has a size.
#include "explain/evidence/carry_over.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

#include "base/random.h"
#include "explain/policy.hpp"

namespace mk
{

namespace
{

// Folds that are made where there are too few logs.
constexpr size_t USUAL_FOLDS = 4;

} // namespace

// The folds are the logs; where they are too few, the windows of them that are searched, or blocks
// of those with some windows of prediction in each.
Folds::Folds(const TrainingData &data, double window_s)
{
    // Least length of a block, in windows of prediction.
    constexpr double WINDOWS = 2.0;
    std::set<int> sources;
    for (const FitLog &log : data.logs)
        sources.insert(log.source);
    of_logs = sources.size();
    const bool by_log = sources.size() >= FEWEST;
    const size_t wanted = by_log ? 1 : (USUAL_FOLDS + data.rows.size() - 1) / data.rows.size();
    for (size_t i = 0; i < data.rows.size(); i++) {
        const bool same = by_log && i > 0 && data.logs[i].source == data.logs[i - 1].source;
        const double seconds = data.logs[i].duration();
        size_t blocks = wanted;
        while (blocks > 1 && seconds / (double)blocks < WINDOWS * window_s)
            blocks--;
        for (size_t b = 0; b < blocks; b++) {
            const mk_log *rows = data.rows[i];
            if (blocks > 1) {
                made.push_back(
                    rows_of_log(*rows, b * rows->rows / blocks, (b + 1) * rows->rows / blocks));
                rows = made.back().get();
            }
            if (!same)
                logs.emplace_back();
            logs.back().push_back(rows);
        }
    }
}

// In how many resamples of the folds, and of the windows in each, it would still be chosen: mean
// below 0 and most folds better (bootstrap of two levels; B. Efron 1979).
static double inclusion_of(const std::vector<std::vector<double>> &ratios)
{
    constexpr int RESAMPLES = 200;
    mk_random random = {1};
    auto any = [&](size_t count) { return (size_t)(mk_random_next(&random) % count); };
    int chosen = 0;
    for (int i = 0; i < RESAMPLES; i++) {
        int better = 0;
        double mean = 0.0;
        for (size_t f = 0; f < ratios.size(); f++) {
            const std::vector<double> &fold = ratios[any(ratios.size())];
            double sum = 0.0;
            for (size_t w = 0; w < fold.size(); w++)
                sum += fold[any(fold.size())];
            mean += sum / (double)fold.size();
            better += sum < 0.0;
        }
        chosen += mean < 0.0 && 2 * better > (int)ratios.size();
    }
    return (double)chosen / RESAMPLES;
}

std::vector<double> carry_over::log_ratios(const HeldOutFigures &with,
                                           const HeldOutFigures &without)
{
    const size_t count = std::min(with.window.size(), without.window.size());
    double missed = 0.0, judged = 0.0;
    for (size_t w = 0; w < count; w++)
        missed += without.window[w], judged += without.window[w] > 0.0;
    const double negligible = policy::NEXT_TO_NOTHING * missed / std::max(judged, 1.0);
    std::vector<double> ratios(count, std::nan(""));
    for (size_t w = 0; w < count; w++)
        if (with.window[w] > 0.0 && without.window[w] > 0.0)
            ratios[w] = std::log((with.window[w] + negligible) / (without.window[w] + negligible));
    return ratios;
}

Carried carry_over::compare(const HeldOutFigures &with, const HeldOutFigures &without,
                            const HeldOutFigures &refit, const double *floor, int joints)
{
    Carried c;
    double all = 0.0, squares = 0.0, windows = 0.0;
    const std::vector<double> window_ratios = log_ratios(with, without);
    std::vector<std::vector<double>> ratios; // by fold and window
    for (size_t first = 0; first < window_ratios.size();) {
        const int fold = with.log[first];
        std::vector<double> ratio;
        for (; first < window_ratios.size() && with.log[first] == fold; first++)
            if (!std::isnan(window_ratios[first]))
                ratio.push_back(window_ratios[first]);
        for (double r : ratio)
            all += r, squares += r * r, windows += 1.0;
        if (!ratio.empty()) {
            c.by_fold.push_back(std::accumulate(ratio.begin(), ratio.end(), 0.0) /
                                (double)ratio.size());
            ratios.push_back(std::move(ratio));
        }
    }
    c.folds = (int)c.by_fold.size();
    if (c.folds < 2)
        return c;
    c.inclusion = inclusion_of(ratios);
    double spread = 0.0;
    for (double mean : c.by_fold) {
        c.mean += mean / c.folds;
        c.better += mean < 0.0;
        c.worse += mean > policy::WORSE_FOLD;
    }
    for (double mean : c.by_fold)
        spread += (mean - c.mean) * (mean - c.mean);
    // Of few folds the scatter among them can be small by chance: never less than that of windows.
    const double centre = all / windows;
    const double by_window = std::max(squares / windows - centre * centre, 0.0) / windows;
    c.window_error = std::sqrt(by_window);
    c.error = std::sqrt(std::max(spread / (c.folds * (c.folds - 1.0)), by_window));
    int judged = 0, known = 0;
    // Per joint, with s the nrmse of a model and n that of the noise,
    //     closed     = s_without^2 - s_with^2 ,
    //     share      = closed / (s_refit^2 - n^2) ,
    //     rest_share = closed / (s_without^2 - n^2) ,
    // means over the joints at which the refitted model is farther than twice the noise from its
    // data (s^2 - n^2 > 3 n^2).
    double over_noise = 0.0;
    for (int j = 0; j < joints; j++) {
        if (floor[j] > 0.0)
            over_noise += std::pow(with.nrmse(j) / floor[j], 2), known++;
        const double room = refit.nrmse(j) * refit.nrmse(j) - floor[j] * floor[j];
        if (!(room > 3.0 * floor[j] * floor[j]))
            continue; // at twice the noise: nothing to close
        const double closed = without.nrmse(j) * without.nrmse(j) - with.nrmse(j) * with.nrmse(j);
        const double rest = without.nrmse(j) * without.nrmse(j) - floor[j] * floor[j];
        c.share += closed / room;
        c.rest_share += rest > 3.0 * floor[j] * floor[j] ? closed / rest : 0.0;
        judged++;
    }
    c.share /= std::max(judged, 1);
    c.rest_share /= std::max(judged, 1);
    c.judged = judged > 0;
    if (known > 0)
        c.times_noise = std::sqrt(over_noise / known);
    return c;
}

static bool closes(const Carried &c, double part)
{
    return c.share > part * policy::LEAST_SHARE || c.rest_share > part * policy::LEAST_OF_REST;
}

bool carry_over::worth_naming(const Carried &c)
{
    return c.share > policy::LEAST_SHARE ||
           (c.rest_share > policy::LEAST_OF_REST && c.times_noise < policy::NEAR_THE_NOISE);
}

bool carry_over::promising(const Carried &c, double part)
{
    return c.folds >= 2 && c.mean < -c.error && c.better > c.worse && closes(c, part);
}

bool carry_over::enough(const Carried &c, int tried, double gain, double part)
{
    const bool none_worse = c.worse == 0 && c.folds >= (int)Folds::FEWEST;
    // Where the likelihood leaves no doubt and no fold is worse it is all in some of the windows,
    // and the others say nothing: a limit that is seldom met, in half of the folds at least.
    if (gain > policy::NO_DOUBT && none_worse && 2 * c.better >= c.folds && c.mean < 0.0 &&
        closes(c, part))
        return true;
    if (gain < policy::LEAST_GAIN || !promising(c, part))
        return false;
    // Of `tried` models that change nothing one passes by chance: 2 log(tried) is about the square
    // of the largest of so many normal deviates. So
    //     z^2 = policy::SURE^2 + 2 log(tried) .
    const double z =
        std::sqrt(policy::SURE * policy::SURE + 2.0 * std::log(std::max(1.0, (double)tried)));
    // The same quantile of Student's distribution with nu = F - 1 degrees of freedom, the error
    // being one of few folds, by the first term of its expansion (Abramowitz, Stegun 26.7.5): t = z
    // + (z^3 + z) / (4 nu).
    const double t = z * (1.0 + (z * z + 1.0) / (4.0 * std::max(c.folds - 1.0, 1.0)));
    // Where no fold is worse the scatter among folds is that of how much is gained, not of whether:
    // windows say what chance would do. With a likelihood that leaves no doubt a fold may be worse
    // as well, if most are better and windows say so.
    const bool most_better = c.better > 2 * c.worse && c.folds >= (int)Folds::FEWEST;
    const bool by_windows = none_worse || (gain > policy::NO_DOUBT && most_better);
    return c.mean < -(by_windows ? z * c.window_error : t * c.error);
}

} // namespace mk
