#include "explain/carry_over.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

#include "base/parallel.hpp"
#include "base/random.h"

namespace mk
{

namespace
{

constexpr size_t USUAL_FOLDS = 4;
constexpr int STATE_STEPS = 6;        // to where the states of a fold stand still, parameters given
constexpr double SURE = 2.0;          // standard errors, of one model asked
constexpr double LEAST_SHARE = 0.05;  // of the gap, or
constexpr double LEAST_OF_REST = 0.1; // of what is left of it

struct Part {
    FitPicture picture;
    bool known = false;
};

} // namespace

// The folds are the logs; where they are too few, the windows of them that are searched, or blocks
// of those with some windows of prediction in each.
CarryOver::CarryOver(const mk_model &model, const TrainingData &data, double window,
                     const FitOptions &fit_options)
    : window_s(window), options(fit_options)
{
    constexpr double WINDOWS = 2.0;
    std::set<int> sources;
    for (const FitLog &log : data.logs)
        sources.insert(log.source);
    const bool by_log = sources.size() >= FEWEST_FOLDS;
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
                folds.emplace_back();
            add_block(model, rows, folds.back());
        }
    }
    options.max_iterations = STATE_STEPS;
}

void CarryOver::add_block(const mk_model &model, const mk_log *rows, Fold &fold)
{
    mk_record record;
    if (mk_record_from_log(rows, &model, &record, nullptr) != MK_OK)
        return;
    fold.logs.push_back(rows);
    fold.fit_logs.push_back(fit_log(record, model, 0, record.rows, (int)folds.size() - 1));
    all.push_back(rows);
}

std::vector<std::vector<const mk_log *>> CarryOver::logs_by_fold() const
{
    std::vector<std::vector<const mk_log *>> logs;
    for (const Fold &fold : folds)
        logs.push_back(fold.logs);
    return logs;
}

bool CarryOver::errors(const Hypothesis &h, bool halves, HeldOutFigures &out) const
{
    const mk_model &m = h.point.model;
    if (mk_model_hides_joint(&m))
        return false;
    const std::vector<int> free = fitted_parameters(m);
    std::vector<Part> parts(folds.size());
    const int threads = std::max(1, options.threads);
    parallel_for(threads, folds.size(), [&](size_t f) {
        FitOptions o = options;
        o.threads = 1;
        o.near = nullptr;
        std::fill(std::begin(o.drift), std::end(o.drift), h.drift);
        std::vector<const FitLog *> view;
        for (const FitLog &log : folds[f].fit_logs)
            view.push_back(&log);
        Fit fit(view, o);
        FitPoint point = fit.start(m);
        std::copy(std::begin(h.point.noise), std::end(h.point.noise), std::begin(point.noise));
        if (!fit.minimise(point, {}))
            return;
        parts[f].picture = fit.picture(point, free);
        parts[f].known = parts[f].picture.finite;
    });
    const long n = (long)free.size();
    Eigen::MatrixXd information = Eigen::MatrixXd::Zero(n, n);
    Eigen::VectorXd slope = Eigen::VectorXd::Zero(n);
    for (const Part &part : parts) {
        if (!part.known)
            return false;
        information += part.picture.information;
        slope += part.picture.gradient;
    }
    std::vector<HeldOutFigures> by_fold(folds.size());
    std::vector<char> fine(folds.size(), 0);
    parallel_for(threads, folds.size(), [&](size_t f) {
        mk_model without;
        const HeldOut held(folds[f].logs, window_s, halves);
        FitPicture others;
        others.information = information - parts[f].picture.information;
        others.gradient = slope - parts[f].picture.gradient;
        fine[f] = Fit::step(m, others, free, without) &&
                  held.figures(without, by_fold[f], nullptr) == MK_OK;
    });
    out = {};
    for (size_t f = 0; f < folds.size(); f++) {
        if (!fine[f])
            return false;
        by_fold[f].log.assign(by_fold[f].window.size(), (int)f);
        out.append(by_fold[f]);
    }
    return true;
}

// In how many resamples of the folds, and of the windows in each, it would still be chosen.
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

Carried CarryOver::compare(const HeldOutFigures &with, const HeldOutFigures &without,
                           const HeldOutFigures &refit, const double *floor, int joints)
{
    Carried c;
    double all = 0.0, squares = 0.0, windows = 0.0;
    const size_t count = std::min(with.window.size(), without.window.size());
    std::vector<std::vector<double>> ratios; // by fold and window
    for (size_t first = 0; first < count;) {
        const int fold = with.log[first];
        std::vector<double> ratio;
        for (; first < count && with.log[first] == fold; first++)
            if (with.window[first] > 0.0 && without.window[first] > 0.0)
                ratio.push_back(std::log(with.window[first] / without.window[first]));
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
    }
    for (double mean : c.by_fold)
        spread += (mean - c.mean) * (mean - c.mean);
    // Of few folds the scatter among them can be small by chance: never less than that of windows.
    const double centre = all / windows;
    const double by_window = (squares / windows - centre * centre) / windows;
    c.error = std::sqrt(std::max(spread / (c.folds * (c.folds - 1.0)), by_window));
    int judged = 0;
    for (int j = 0; j < joints; j++) {
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
    return c;
}

static bool closes(const Carried &c)
{
    return c.share > LEAST_SHARE || c.rest_share > LEAST_OF_REST;
}

bool CarryOver::promising(const Carried &c)
{
    return c.folds >= 2 && c.mean < -c.error && 2 * c.better > c.folds && closes(c);
}

bool CarryOver::enough(const Carried &c, int tried)
{
    // Of many models that change nothing one passes by chance: 2 ln(n) is the square of the largest
    // of n normal deviates, about.
    const double z = std::sqrt(SURE * SURE + 2.0 * std::log(std::max(1.0, (double)tried)));
    // The same quantile of Student's distribution, the error being one of few folds.
    const double t = z * (1.0 + (z * z + 1.0) / (4.0 * std::max(c.folds - 1.0, 1.0)));
    return promising(c) && c.mean < -t * c.error;
}

void CarryOver::floor_of(const mk_model &model, const double *noise, double *floor) const
{
    const HeldOut held(all, window_s);
    for (int j = 0; j < mk_model_joints(&model); j++) {
        const double sd = held.deviation(model, j);
        floor[j] = sd > 0.0 ? noise[j] / sd : 0.0;
    }
}

} // namespace mk
