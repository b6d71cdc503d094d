#include "explain/search/count_correction.hpp"

#include <limits>

#include "explain/search/missed_counts.hpp"

namespace mk
{

namespace
{

// The training data with lost pulses put back, and what a refit makes of them.
struct Corrected {
    double step = 0.0;
    std::vector<FitLog> logs;
    Hypothesis fit;
    bool fitted = false;
    double readings = 0.0;
    double penalised_nlml() const { return fitted ? fit.penalised_nlml : HUGE_VAL; }
};

class CountCorrector
{
  public:
    CountCorrector(const mk_model &model_in, const std::vector<const FitLog *> &logs_in,
                   const SearchOptions &options_in, int joint_in,
                   const std::vector<MissedCount> &missed_in)
        : model(model_in), logs(logs_in), options(options_in), joint(joint_in), missed(missed_in)
    {
    }
    // The step as the jumps show it.
    Corrected first() const { return correct(std::fabs(missed[0].step)); }
    // The jumps alone do not tell the step to a fraction of a count; the fit does: a parabola
    // through three of them, twice, the second one about the best.
    Corrected tune(Corrected best, double &std_error) const
    {
        std_error = std::numeric_limits<double>::quiet_NaN();
        for (double part : {0.6, 0.2}) {
            double side = part * logs[0]->count[joint];
            Corrected less = correct(best.step - side), more = correct(best.step + side);
            double bend =
                less.penalised_nlml() - 2.0 * best.penalised_nlml() + more.penalised_nlml();
            double shift = bend > 0.0
                               ? 0.5 * side * (less.penalised_nlml() - more.penalised_nlml()) / bend
                               : side;
            Corrected there =
                correct(best.step + std::min(std::max(shift, -2.0 * side), 2.0 * side));
            for (Corrected *m : {&less, &more, &there})
                if (m->penalised_nlml() < best.penalised_nlml())
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
    const std::vector<MissedCount> &missed;

    Corrected correct(double step) const
    {
        Corrected m;
        m.step = step;
        std::vector<MissedCount> even = missed;
        for (MissedCount &s : even)
            s.step = std::copysign(step, s.step);
        for (size_t l = 0; l < logs.size(); l++)
            m.logs.push_back(with_corrected_counts(*logs[l], l, joint, even));
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

CountCorrection find_count_correction(const mk_model &model,
                                      const std::vector<const FitLog *> &training,
                                      const SearchOptions &options, const Hypothesis &refit,
                                      double enough, double most_process_noise)
{
    CountCorrection found;
    for (int j = 0; j < mk_model_joints(&model); j++) {
        const std::vector<MissedCount> missed = find_missed_counts(training, j);
        if (missed.empty())
            continue;
        double std_error = 0.0;
        const CountCorrector corrector(model, training, options, j, missed);
        Corrected corrected = corrector.first();
        // A step that is off by a part of a count leaves errors of that size. Where the model needs
        // far more than that, what looks like steps is what it lacks.
        if (corrected.fitted && corrected.fit.process_noise > most_process_noise)
            continue;
        corrected = corrector.tune(std::move(corrected), std_error);
        double penalty = 0.5 * std::log(corrected.readings) * (double)(missed.size() + 1);
        double gain = refit.penalised_nlml - corrected.penalised_nlml() - penalty;
        if (!(gain > enough))
            continue;
        found.joint = j + 1;
        found.step = corrected.step;
        found.std_error = std_error;
        found.count = (double)missed.size();
        found.gain = gain;
        found.logs = std::move(corrected.logs);
        found.fit = corrected.fit;
        return found;
    }
    return found;
}

} // namespace mk
