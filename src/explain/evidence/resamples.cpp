// Bootstrap of two levels (B. Efron, The Annals of Statistics 7, 1979): a resample draws as many
// logs as there are, with replacement, and from each as many windows as it has. Windows of one log
// hang together, as logs differ in what they excite: windows alone would make intervals too narrow.
// A resample is told by how often each window counts (Times); what depends on it is a weighted mean
// of errors that are computed once.
//
// The generator starts from the same seed each time, so that answers are repeatable.
#include "explain/evidence/resamples.hpp"

#include <algorithm>

#include "base/random.h"

namespace mk
{

namespace
{

// Resamples, and the quantiles of their figures that are the ends of an interval: 90 % lie between.
constexpr int RESAMPLES = 400;
constexpr double LOW = 0.05, HIGH = 0.95;

// Windows that were judged, by log.
std::vector<std::vector<size_t>> windows_by_log(const HeldOutFigures &f)
{
    std::vector<std::vector<size_t>> by_log;
    for (size_t w = 0; w < f.window.size(); w++) {
        if (!(f.window[w] > 0.0))
            continue;
        if ((size_t)f.log[w] >= by_log.size())
            by_log.resize((size_t)f.log[w] + 1);
        by_log[(size_t)f.log[w]].push_back(w);
    }
    by_log.erase(std::remove_if(by_log.begin(), by_log.end(),
                                [](const std::vector<size_t> &l) { return l.empty(); }),
                 by_log.end());
    return by_log;
}

} // namespace

// Without `times` the mean square over all readings. With them
//     sum_w times_w S_w / (sum_w times_w  mean readings of a window) ,
// S_w the squared error of window w. Windows of different length are taken for equally long.
double mean_square(const HeldOutFigures &f, int joint, const Times *times)
{
    if (!times)
        return f.nrmse(joint) * f.nrmse(joint);
    const std::vector<double> &part = f.part[joint];
    double sum = 0.0, count = 0.0;
    for (size_t w = 0; w < std::min(times->size(), part.size()); w++) {
        sum += (*times)[w] * part[w];
        count += (*times)[w];
    }
    const double mean_rows = f.rows[joint] / (double)std::max<size_t>(part.size(), 1);
    return count > 0.0 ? sum / (count * mean_rows) : 0.0;
}

std::vector<Interval> intervals_of(const HeldOutFigures &f,
                                   const std::function<std::vector<double>(const Times &)> &figures)
{
    mk_random random = {1};
    const auto any = [&](size_t count) { return (size_t)(mk_random_next(&random) % count); };
    const std::vector<std::vector<size_t>> by_log = windows_by_log(f);
    std::vector<std::vector<double>> drawn;
    for (int i = 0; i < RESAMPLES; i++) {
        Times times(f.window.size(), 0.0);
        for (size_t l = 0; l < by_log.size(); l++) {
            const std::vector<size_t> &log = by_log[any(by_log.size())];
            for (size_t w = 0; w < log.size(); w++)
                times[log[any(log.size())]] += 1.0;
        }
        const std::vector<double> now = figures(times);
        drawn.resize(now.size());
        for (size_t k = 0; k < now.size(); k++)
            drawn[k].push_back(now[k]);
    }
    std::vector<Interval> out;
    for (std::vector<double> &one : drawn) {
        std::sort(one.begin(), one.end());
        out.push_back({one[(size_t)(LOW * RESAMPLES)], one[(size_t)(HIGH * RESAMPLES)]});
    }
    return out;
}

} // namespace mk
