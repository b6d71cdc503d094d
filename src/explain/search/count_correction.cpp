#include "explain/search/count_correction.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "explain/policy.hpp"

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

double error_of_mean(const std::vector<double> &values)
{
    const double n = (double)values.size();
    double mean = 0.0, squares = 0.0;
    for (double x : values)
        mean += x / n;
    for (double x : values)
        squares += (x - mean) * (x - mean);
    return n > 1.0 ? std::sqrt(squares / (n * (n - 1.0)))
                   : std::numeric_limits<double>::quiet_NaN();
}

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
    // As they are.
    Corrected unchanged() const { return correct(0.0); }
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
            s.step = s.step < 0.0 ? -step : step;
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

bool surely_missed(const std::vector<const FitLog *> &training)
{
    for (int j = 0; j < training[0]->joints; j++)
        if (surely_steps(find_missed_counts(training, j)))
            return true;
    return false;
}

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
        std::vector<double> sizes;
        for (const MissedCount &s : missed)
            sizes.push_back(s.size);
        double std_error = error_of_mean(sizes);
        const CountCorrector corrector(model, training, options, j, missed);
        Corrected corrected = corrector.first();
        // A step that is off by a part of a count leaves errors of that size. Where the model needs
        // far more than that, what looks like steps may be what it lacks; and where they surely are
        // steps, it does not know their size better than the readings around them do.
        const bool sure = surely_steps(missed);
        const bool near = corrected.fitted && corrected.fit.process_noise <= most_process_noise;
        if (!near && !sure)
            continue;
        if (near)
            corrected = corrector.tune(std::move(corrected), std_error);
        double penalty = 0.5 * std::log(corrected.readings) * (double)(missed.size() + 1);
        double gain = refit.penalised_nlml - corrected.penalised_nlml() - penalty;
        if (!(gain > enough))
            continue;
        found.joint = j + 1;
        found.missed = missed;
        found.sure = sure;
        found.step = corrected.step;
        found.std_error = std_error;
        found.count = (double)missed.size();
        for (const FitLog *log : training)
            found.seconds += log->duration();
        found.gain = gain;
        found.logs = std::move(corrected.logs);
        found.fit = corrected.fit;
        return found;
    }
    return found;
}

CountCorrection tuned(const mk_model &model, const std::vector<const FitLog *> &logs,
                      const SearchOptions &options, const CountCorrection &before)
{
    CountCorrection after = before;
    const CountCorrector corrector(model, logs, options, before.joint - 1, before.missed);
    Corrected corrected = corrector.tune(corrector.unchanged(), after.std_error);
    after.step += corrected.step;
    after.logs = std::move(corrected.logs);
    after.fit = corrected.fit;
    return after;
}

OwnedLog log_with_corrected_counts(const mk_log &log, const mk_model &model,
                                   const CountCorrection &correction, int &steps)
{
    const int j = correction.joint - 1;
    mk_record record;
    double longest = 0.0;
    if (mk_record_from_log(&log, &model, &record, nullptr) != MK_OK)
        return nullptr;
    const std::vector<Piece> pieces = pieces_of(record, record.rows, longest);
    std::vector<FitLog> parts;
    for (const Piece &piece : pieces)
        parts.push_back(fit_log(record, model, piece.first, piece.last));
    std::vector<const FitLog *> views;
    for (const FitLog &part : parts)
        views.push_back(&part);
    std::vector<MissedCount> found = find_missed_counts(views, j);
    found.erase(std::remove_if(found.begin(), found.end(),
                               [&](const MissedCount &s) {
                                   return !(s.distinct > policy::STEP_DISTINCT) ||
                                          !is_step_of(s.step, correction.step, parts[0].count[j]);
                               }),
                found.end());
    if (found.empty())
        return nullptr;
    OwnedLog corrected = rows_of_log(log, 0, log.rows);
    for (size_t c = 0; c < log.column_count; c++) {
        if (log.columns[c].data != record.q[j])
            continue;
        double *q = corrected->columns[c].data;
        for (const MissedCount &s : found) {
            // Rows of a piece may be more than the log's, where some are missing: times tell.
            const double at =
                record.t[pieces[s.log].first] + parts[s.log].t[s.row] - 0.5 * parts[s.log].period;
            for (size_t k = 0; k < log.rows; k++)
                if (record.t[k] > at)
                    q[k] -= std::copysign(correction.step, s.step);
        }
        steps += (int)found.size();
        return corrected;
    }
    return nullptr;
}

} // namespace mk
