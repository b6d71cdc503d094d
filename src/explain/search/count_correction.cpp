#include "explain/search/count_correction.hpp"

#include <limits>

#include "explain/search/missed_counts.hpp"

namespace mk
{

namespace
{

// The training data with lost pulses put back, and what a refit makes of them.
struct Mended {
    double step = 0.0;
    std::vector<FitLog> logs;
    Hypothesis fit;
    bool fitted = false;
    double readings = 0.0;
    double score() const { return fitted ? fit.score : HUGE_VAL; }
};

class Mender
{
  public:
    Mender(const mk_model &model_in, const std::vector<const FitLog *> &logs_in,
           const SearchOptions &options_in, int joint_in, const std::vector<Slip> &slips_in)
        : model(model_in), logs(logs_in), options(options_in), joint(joint_in), slips(slips_in)
    {
    }
    // The step as the jumps show it.
    Mended first() const { return mend(std::fabs(slips[0].step)); }
    // The jumps alone do not tell the step to a fraction of a count; the fit does: a parabola
    // through three of them, twice, the second one about the best.
    Mended tune(Mended best, double &std_error) const
    {
        std_error = std::numeric_limits<double>::quiet_NaN();
        for (double part : {0.6, 0.2}) {
            double side = part * logs[0]->count[joint];
            Mended less = mend(best.step - side), more = mend(best.step + side);
            double bend = less.score() - 2.0 * best.score() + more.score();
            double shift = bend > 0.0 ? 0.5 * side * (less.score() - more.score()) / bend : side;
            Mended there = mend(best.step + std::min(std::max(shift, -2.0 * side), 2.0 * side));
            for (Mended *m : {&less, &more, &there})
                if (m->score() < best.score())
                    best = std::move(*m);
            std_error =
                bend > 0.0 ? side / std::sqrt(bend) : std::numeric_limits<double>::quiet_NaN();
        }
        return best;
    }

  private:
    const mk_model &model;
    const std::vector<const FitLog *> &logs;
    const SearchOptions &options;
    int joint; // 0-based
    const std::vector<Slip> &slips;

    Mended mend(double step) const
    {
        Mended m;
        m.step = step;
        std::vector<Slip> even = slips;
        for (Slip &s : even)
            s.step = std::copysign(step, s.step);
        for (size_t l = 0; l < logs.size(); l++)
            m.logs.push_back(without_slips(*logs[l], l, joint, even));
        std::vector<const FitLog *> views;
        for (const FitLog &log : m.logs)
            views.push_back(&log);
        Search search(views, options);
        m.fitted = search.refit(model, nullptr, m.fit);
        m.readings = search.readings();
        return m;
    }
};

} // namespace

LostCounts find_lost_counts(const mk_model &model, const std::vector<const FitLog *> &training,
                            const SearchOptions &options, const Hypothesis &refit, double enough,
                            double most_drift)
{
    LostCounts found;
    for (int j = 0; j < mk_model_joints(&model); j++) {
        const std::vector<Slip> slips = find_slips(training, j);
        if (slips.empty())
            continue;
        double std_error = 0.0;
        const Mender mender(model, training, options, j, slips);
        Mended mended = mender.first();
        // A step that is off by a part of a count leaves errors of that size. Where the model needs
        // far more than that, what looks like steps is what it lacks.
        if (mended.fitted && mended.fit.drift > most_drift)
            continue;
        mended = mender.tune(std::move(mended), std_error);
        double penalty = 0.5 * std::log(mended.readings) * (double)(slips.size() + 1);
        double gain = refit.score - mended.score() - penalty;
        if (!(gain > enough))
            continue;
        found.joint = j + 1;
        found.step = mended.step;
        found.std_error = std_error;
        found.count = (double)slips.size();
        found.gain = gain;
        found.logs = std::move(mended.logs);
        found.fit = mended.fit;
        return found;
    }
    return found;
}

} // namespace mk
