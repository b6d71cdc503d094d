// How much better the extended model predicts data that were not fitted
// (explain/evidence/gain.hpp, docs/explain.md, "How to read a report").
//
// Free runs over windows of the held-out logs (ident/held_out.hpp) give each model m and joint j
//     s_mj = nrmse = rms error / sd_j ,   total_m = sum_j s_mj^2 ,
// sd_j the standard deviation of the joint's held-out readings. m is one of
//     before     the given model ,
//     refitted   the given model with its values fitted to the data to learn from ,
//     after      the extended model: with causes, values per log, the command's other column .
// With n_j = noise_j / sd_j what the readings' noise leaves, the gap is what lies between
// `refitted` and the noise, and
//     closed = 1 - (total_after - sum_j floor_j^2) / (total_refitted - sum_j floor_j^2) ,
//     floor_j = min(n_j, s_refitted,j, s_after,j) .
//
// The held-out data have chosen nothing, so that they have the last word on what is offered:
//     clearly worse   mean over windows of log(error after / error refitted) above two standard
//                     errors and above log(1.02): the extension is taken back ,
//     misleads        it widens the gap, though a joint or most windows gain: the same ,
//     confirms        it closes nearly all of the gap, though the data to learn from were not
//                     followed to the last digit: the verdict is raised to `effect` .
// Thresholds and where they come from: explain/policy.hpp.
#include "explain/evidence/gain.hpp"

#include <algorithm>
#include <cmath>

#include "explain/evidence/innovations.hpp"
#include "explain/policy.hpp"
#include "ident/held_out.hpp"

namespace mk
{

namespace
{

// The data and results of one explanation, all borrowed; `out` and `verdict` are changed.
struct Gain {
    const mk_model &model;
    const mk_explain_options &options;
    const TrainingData &data;
    const CauseSearch &causes;
    const FinalFit &last;
    TrainingRuns &runs;
    Verdict &verdict;
    mk_explanation &out;

    // Training data with bad times, or contact and backlash, are hard to follow to the last digit;
    // held-out data that the named causes alone predict confirm them all the same.
    void confirm(const HeldOut &held, const HeldOutFigures &after)
    {
        const bool named = !causes.rounds.empty() && causes.all_named();
        bool touches = mk_model_event_count(&last.best.point.model) > mk_model_event_count(&model);
        bool as_read = true;
        for (int j = 0; j < mk_model_joints(&model); j++)
            as_read = as_read && after.nrmse(j) < policy::AS_READ * noise_share(held, j);
        if (out.verdict < MK_VERDICT_PARTIAL || !named || !out.offered || !verdict.established() ||
            !(out.closed > policy::CONFIRMED))
            return;
        const auto nothing_left = [&] {
            return out.closed > policy::ALL_BUT && leaves_white_noise(last.logs(), last.best);
        };
        if (!touches && !as_read && !nothing_left())
            return;
        out.verdict = MK_VERDICT_EFFECT;
        out.structure[0] = 0;
    }
    bool only_missed_counts() const
    {
        return out.cause_count == 1 && out.cause[0].effect == mk_effect_by_name("missed-counts");
    }
    bool finds_anything() const
    {
        return out.cause_count + out.log_value_count + out.input.changed > 0;
    }
    // Figures of the three models over the same windows, the refitted one at its best in free runs
    // if anything is compared with it. Their length is out.window_s; where the
    // caller named none (options.window_s is 0) it is halved while at some joint both the refitted
    // and the extended model are worse than a constant (s_mj > 1), to SHORTEST at least, and
    // out.window_s says what it came to. The error of a model that no window can be run by is
    // MK_ERR_NUMERIC; of the extended one it counts as an infinite error instead.
    enum mk_status predict_held_out(HeldOutFigures &before, HeldOutFigures &refitted,
                                    HeldOutFigures &after, mk_error *err)
    {
        // Where no model can say anything so far ahead, as of an unstable rig, less far.
        constexpr double SHORTEST = 0.1, SHORTER = 0.5; // s, share
        if (finds_anything())
            out.refit = runs.refit();
        // A simulation does not slip: then both models are one.
        if (only_missed_counts() && out.verdict == MK_VERDICT_PARTIAL)
            std::copy_n(out.refit.parameter, MK_MAX_PARAMETERS, out.extended.parameter);
        for (;; out.window_s = std::max(SHORTEST, SHORTER * out.window_s)) {
            const HeldOut held(data.held, out.window_s, data.second_half, options.threads);
            before = refitted = after = {};
            enum mk_status st = held.figures(out.refit, refitted, err);
            // An extension that runs away everywhere is a bad one, not an error.
            if (st == MK_OK && (st = held.figures(out.extended, after, err)) == MK_ERR_NUMERIC) {
                after.square[0] = HUGE_VAL;
                st = MK_OK;
            }
            bool lost_track = false;
            for (int j = 0; j < mk_model_joints(&model); j++)
                lost_track = lost_track || (after.nrmse(j) > 1.0 && refitted.nrmse(j) > 1.0);
            if (st == MK_OK && lost_track && !options.window_s && out.window_s > SHORTEST)
                continue;
            return st == MK_OK ? held.figures(out.given, before, err) : st;
        }
    }
    // Whether held-out data are predicted nearly as well as they are read,
    //     s_j sd_j < c noise_j   at every joint ,
    // c = policy::RIGHT, or RIGHT_WITH_TRACE where the refitted model needs only a trace of process
    // noise and leaves white noise. A trace of process noise that nothing explains says nothing
    // then: long chaotic motion leaves one, and so does a rig that is balanced for long, whose free
    // run besides grows from any error at its start.
    bool at_noise(const HeldOut &held, const HeldOutFigures &f) const
    {
        const bool trace = last.refit.process_noise <= policy::TRACE &&
                           leaves_white_noise(last.logs(), last.refit);
        const double nearly = trace ? policy::RIGHT_WITH_TRACE : policy::RIGHT;
        bool near = true;
        for (int j = 0; j < mk_model_joints(&model); j++)
            near = near && f.nrmse(j) * held.deviation(model, j) < nearly * noise(j);
        return near;
    }
    // Whether the data that were learnt from show what those held out do not: the refitted model is
    // farther than policy::FAR_FROM_READ times the noise from them,
    //     s_j sd_j > policy::FAR_FROM_READ noise_j   at some joint .
    bool misses_training() const
    {
        const HeldOut training(data.rows, out.window_s, data.second_half, options.threads);
        HeldOutFigures figures;
        if (training.figures(out.refit, figures, nullptr) != MK_OK)
            return true;
        for (int j = 0; j < mk_model_joints(&model); j++)
            if (figures.nrmse(j) * training.deviation(model, j) > policy::FAR_FROM_READ * noise(j))
                return true;
        return false;
    }
    // s_j <= times n_j at every joint.
    bool within(double times, const HeldOut &held, const HeldOutFigures &f) const
    {
        for (int j = 0; j < mk_model_joints(&model); j++)
            if (!(f.nrmse(j) <= times * noise_share(held, j)))
                return false;
        return true;
    }
    // Whether held-out data, to which nothing is fitted but states and noise, are likelier by the
    // extension than by the refitted model: nlml(refitted) - nlml(extended) > 0. Each has at most
    // the process noise that the data to learn from left it. No penalty for parameters, since none
    // is fitted here. False where one of both cannot follow the data.
    bool likelier_on_held_out() const
    {
        std::vector<FitLog> logs;
        for (size_t i = 0; i < data.held.size(); i++) {
            mk_record record;
            double longest = 0.0;
            if (mk_record_from_log(data.held[i], &model, &record, nullptr) != MK_OK)
                return false;
            for (const Piece &piece : pieces_of(record, record.rows, longest))
                logs.push_back(fit_log(record, model, piece.first, piece.last, (int)i));
        }
        std::vector<const FitLog *> all;
        for (const FitLog &log : logs)
            all.push_back(&log);
        if (all.empty())
            return false;
        SearchOptions how;
        how.given = &model;
        how.threads = options.threads;
        Search search(all, how);
        Hypothesis without, with;
        return search.follow(out.refit, nullptr, last.refit.process_noise, without) &&
               search.follow(out.extended, nullptr, last.best.process_noise, with) &&
               with.quadratic.nlml < without.quadratic.nlml;
    }
    double noise(int j) const { return out.noise[j]; }
    // n_j; 0 of a joint that stands still.
    double noise_share(const HeldOut &held, int j) const
    {
        const double sd = held.deviation(model, j);
        return sd > 0.0 ? noise(j) / sd : 0.0;
    }
    // What the readings' own noise leaves of the error. No model is below it: a joint that comes
    // out so moved little, and the noise that the fits saw was not all its own there.
    double floor_of(const HeldOut &held, int j, const HeldOutFigures &refitted,
                    const HeldOutFigures &after) const
    {
        const double sd = held.deviation(model, j);
        return std::min({sd > 0.0 ? out.noise[j] / sd : 0.0, refitted.nrmse(j), after.nrmse(j)});
    }
    // Where there is something to close, an extension that widens it is not what is missing,
    // however well it does in most windows or at one joint. A joint that hardly moves shows noise:
    // below c = policy::NOISE_SQUARES times the noise squared nothing counts. With
    //     x_mj = max(s_mj^2 - c n_j^2, 0) ,   gap = sum_j x_refitted,j ,
    // it misleads if
    //     gap > A_GAP sum_j n_j^2   and   sum_j (x_after,j - x_refitted,j) > WIDER gap .
    bool misleads(const HeldOut &held, const HeldOutFigures &refitted,
                  const HeldOutFigures &after) const
    {
        double floor = 0.0, gap = 0.0, wider = 0.0;
        for (int j = 0; j < mk_model_joints(&model); j++) {
            const double share = noise_share(held, j),
                         noise = policy::NOISE_SQUARES * share * share;
            const double error = refitted.nrmse(j) * refitted.nrmse(j);
            const double left = after.nrmse(j) * after.nrmse(j);
            floor += share * share;
            gap += std::max(error - noise, 0.0);
            wider += std::max(left - noise, 0.0) - std::max(error - noise, 0.0);
        }
        return gap > policy::A_GAP * floor && wider > policy::WIDER * gap;
    }
    // Without the causes what they were found beside may do: values that differ from log to log,
    // the command's other column. Else these are no findings either, and the refitted model is all
    // that there is.
    void offer_data_causes(const HeldOut &held, const HeldOutFigures &refitted,
                           HeldOutFigures &after)
    {
        if (out.log_value_count + out.input.changed == 0) {
            out.extended = out.refit;
            after = refitted;
            return;
        }
        if (clearly_worse(after, refitted) || misleads(held, refitted, after)) {
            out.log_value_count = out.per_log_count = 0;
            out.input.changed = false;
            out.input.taken =
                out.given.input == MK_INPUT_COMMANDED ? MK_INPUT_COMMANDED : MK_INPUT_MEASURED;
            out.extended = out.refit;
            after = refitted;
            return;
        }
        out.offered = true;
        out.cause_count = out.piece_count = out.rival_count = 0;
        std::fill(std::begin(out.declined), std::end(out.declined), 0.0);
        verdict.add_data_causes();
    }
    // Largest command held out over the largest one to learn from; 0 where none acts there.
    double command_beyond(const HeldOut &held) const
    {
        const HeldOut learnt(data.whole_rows.empty() ? data.rows : data.whole_rows, out.window_s,
                             false, options.threads);
        const double most = learnt.largest_command(model);
        return most > 0.0 ? held.largest_command(model) / most : 0.0;
    }
    // All of it in order: predictions; whether the extension is offered, and if not what is left of
    // it; the verdict, where likelihood saw a rest that does not matter in free runs; figures;
    // confirmation. An extension is taken back before the verdict is looked at, since both depend
    // on what is still claimed.
    enum mk_status measure(mk_error *err)
    {
        HeldOutFigures before, refitted, after;
        const bool found = finds_anything();
        enum mk_status st = predict_held_out(before, refitted, after, err);
        if (st != MK_OK)
            return st;
        const HeldOut held(data.held, out.window_s, data.second_half, options.threads);
        out.command_beyond = command_beyond(held);
        out.offered = found && earns_its_place(held, refitted, after);
        if (found && !out.offered)
            st = decline(held, refitted, after, err);
        if (st != MK_OK)
            return st;
        for (int i = 0; i < mk_plant(model.plant)->parameter_count; i++)
            out.extended.parameter_stderr[i] =
                std::isfinite(out.std_error[i]) ? out.std_error[i] : 0.0;
        if (!found && out.verdict == MK_VERDICT_UNKNOWN && at_noise(held, refitted) &&
            !misses_training()) {
            // A model that bends to its data leaves its values open, and what it predicts does not.
            const bool off = verdict.values_off() || clearly_worse(before, refitted);
            out.verdict = off ? MK_VERDICT_PARAMETERS : MK_VERDICT_NONE;
            out.structure[0] = 0;
        }
        judge_given_values(before, refitted);
        if (out.verdict == MK_VERDICT_NONE) {
            out.extended = out.given;
            after = before;
        }
        keep_figures(held, before, refitted, after);
        confirm(held, after);
        return compare_with_training(held, err);
    }
    // Whether the extension is to be offered, by what it predicts of held-out data. Beside the two
    // reasons above it must have
    //     total_after <= most total_refitted ,
    // most = 1 for a formula without a name, 1 - LEAST_GAIN_OF_PART for causes beside which a rest
    // stays, and no bound for causes that explain the data to learn from.
    bool earns_its_place(const HeldOut &held, const HeldOutFigures &refitted,
                         const HeldOutFigures &after) const
    {
        if (clearly_worse(after, refitted) || misleads(held, refitted, after))
            return false;
        // No model says when pulses are lost; what shows them is in the readings.
        if (only_missed_counts())
            return true;
        // A formula is worth having for what it predicts only, and where much is left without a
        // name so is a cause.
        const double most = out.verdict == MK_VERDICT_UNKNOWN   ? 1.0
                            : out.verdict == MK_VERDICT_PARTIAL ? 1.0 - policy::LEAST_GAIN_OF_PART
                                                                : HUGE_VAL;
        if (after.total() > most * refitted.total())
            return false;
        // Where next to nothing is missing likelihood may take the readings' own steps for a cause.
        // It must predict held-out data better, if by ever so little, or be likelier there.
        return !within(policy::AT_NOISE, held, refitted) || after.total() <= refitted.total() ||
               likelier_on_held_out();
    }
    // Takes the extension back; `after` is then of what is left of it.
    enum mk_status decline(const HeldOut &held, const HeldOutFigures &refitted,
                           HeldOutFigures &after, mk_error *err)
    {
        for (int j = 0; j < mk_model_joints(&model); j++)
            out.declined[j] = after.nrmse(j);
        verdict.reject();
        after = {};
        enum mk_status st = held.figures(out.extended, after, err);
        if (st == MK_OK)
            offer_data_causes(held, refitted, after);
        return st;
    }
    // Values that differ by more than chance but predict no better are as good as right, unless
    // they predict nothing at all, if in a window or two only.
    void judge_given_values(const HeldOutFigures &before, const HeldOutFigures &refitted)
    {
        if (out.verdict == MK_VERDICT_PARAMETERS && !clearly_worse(before, refitted))
            out.verdict = MK_VERDICT_NONE;
        if (out.verdict == MK_VERDICT_NONE &&
            before.total() > policy::PREDICTS_NOTHING * refitted.total())
            out.verdict = MK_VERDICT_PARAMETERS;
    }
    // closed = 1 - (after - floor) / (refitted - floor), of squared errors summed over joints. 1:
    // at the noise; 0: no better than refitted; below 0: worse. 0 as well where there is no gap.
    void keep_figures(const HeldOut &held, const HeldOutFigures &before,
                      const HeldOutFigures &refitted, const HeldOutFigures &after)
    {
        double floor = 0.0;
        for (int j = 0; j < mk_model_joints(&model); j++) {
            out.before[j] = before.nrmse(j);
            out.refitted[j] = refitted.nrmse(j);
            out.after[j] = after.nrmse(j);
            out.floor[j] = floor_of(held, j, refitted, after);
            floor += out.floor[j] * out.floor[j];
        }
        const double room = refitted.total() - floor;
        out.closed = room > 0.0 ? 1.0 - (after.total() - floor) / room : 0.0;
    }
    // How well the data are predicted that the models were fitted to, where held-out data are not:
    // if both are missed alike the model is at fault, if only the held-out data are, these show
    // something that the others do not. s sd(training) / sd(held out) puts both in one unit. A
    // model that runs away on the training data leaves 0 there, and is no error.
    enum mk_status compare_with_training(const HeldOut &held, mk_error *err)
    {
        bool far = false;
        for (int j = 0; j < mk_model_joints(&model); j++)
            far = far || out.after[j] > policy::FAR_FROM_READ * out.floor[j];
        if (!far)
            return MK_OK;
        const HeldOut training(data.rows, out.window_s, data.second_half, options.threads);
        HeldOutFigures figures;
        enum mk_status st = training.figures(out.extended, figures, err);
        for (int j = 0; st == MK_OK && j < mk_model_joints(&model); j++) {
            const double sd = held.deviation(model, j);
            out.trained[j] = sd > 0.0 ? figures.nrmse(j) * training.deviation(model, j) / sd : 0.0;
        }
        return st == MK_ERR_NUMERIC ? MK_OK : st;
    }
};

} // namespace

enum mk_status measure_gain(const mk_model &model, const mk_explain_options &options,
                            const TrainingData &data, const CauseSearch &causes,
                            const FinalFit &last, TrainingRuns &runs, Verdict &verdict,
                            mk_explanation &out, mk_error *err)
{
    Gain gain = {model, options, data, causes, last, runs, verdict, out};
    return gain.measure(err);
}

} // namespace mk
