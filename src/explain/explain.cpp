// From data to a verdict: refit, search, second and third causes, check on held-out data.
#include "mechkit/explain.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <thread>

#include "explain/causes.hpp"
#include "explain/held_out.hpp"
#include "explain/innovations.hpp"
#include "explain/mending.hpp"
#include "explain/next_experiment.hpp"
#include "explain/pushes.hpp"
#include "explain/statistics.hpp"
#include "explain/structure.hpp"
#include "explain/training.hpp"

namespace mk
{

namespace
{

constexpr double MOST_DATA = 30.0;  // s to search in, if not said otherwise
constexpr double INSEPARABLE = 5.0; // log likelihood between rivals that data cannot tell apart
constexpr double UNKNOWN = std::numeric_limits<double>::quiet_NaN();

class Explainer
{
  public:
    Explainer(const mk_model &model_in, mk_explanation &out_in,
              const mk_explain_options &options_in)
        : model(model_in), out(out_in), options(options_in)
    {
    }

    enum mk_status run(const mk_log *const *logs, size_t log_count, const mk_log *const *holdouts,
                       size_t holdout_count, mk_error *err)
    {
        enum mk_status st =
            data.load(model, options, logs, log_count, holdouts, holdout_count, out, err);
        if (st != MK_OK)
            return st;
        for (const FitLog &log : data.logs)
            training.push_back(&log);
        SearchOptions so;
        so.given = &model;
        so.threads = options.threads;
        so.progress = options.progress;
        so.progress_context = options.progress_context;
        search = std::make_unique<Search>(training, so);
        Hypothesis refit;
        if (!search->refit(model, nullptr, refit))
            return mk_error_set(
                err, search->cancelled ? MK_ERR_INTR : MK_ERR_NUMERIC,
                "the model cannot follow the data: are rig, units and signs right?");
        put_back_lost_counts(so, refit);
        search_causes(refit);
        if (lost.joint > 0 && !causes->rounds.empty() && tune_lost_counts(so, refit))
            search_causes(refit);
        look_closer(so);
        causes->polish_rivals();
        ask_held_out();
        shed_what_misleads();
        out.tried = causes->tried();
        if (search->cancelled)
            return mk_error_set(err, MK_ERR_INTR, "stopped");
        decide();
        find_pushes(training, model, causes->refit, causes->best, options.threads, out);
        test_innovations(training, causes->refit, causes->best, out);
        enum mk_status measured = measure(err);
        if (measured == MK_OK)
            propose_experiment(model, training, causes->best, rival_fit, options.next, out);
        return measured;
    }

  private:
    const mk_model &model;
    mk_explanation &out;
    mk_explain_options options;
    TrainingData data;
    std::vector<const FitLog *> training; // of `data`, or with lost counts put back
    std::unique_ptr<Search> search;
    LostCounts lost;
    std::unique_ptr<CauseSearch> causes;

    void search_causes(const Hypothesis &refit)
    {
        causes = std::make_unique<CauseSearch>(model, *search, refit);
        causes->give_up_early = lost.joint == 0; // look_closer() goes on
        causes->run();
    }
    void put_back_lost_counts(const SearchOptions &so, Hypothesis &refit)
    {
        lost = find_lost_counts(model, training, so, refit, ENOUGH);
        if (lost.joint > 0)
            use_mended_logs(so, refit);
    }
    // How large the steps are was seen by a model that lacked other causes: again with those. True
    // if that makes another search worth while.
    bool tune_lost_counts(const SearchOptions &so, Hypothesis &refit)
    {
        constexpr double SAME = 0.05; // counts
        std::vector<const FitLog *> raw;
        for (const FitLog &log : data.logs)
            raw.push_back(&log);
        const mk_model extended = causes->best.point.model;
        LostCounts again = find_lost_counts(extended, raw, so, causes->refit, -HUGE_VAL);
        double moved = std::fabs(again.step - lost.step);
        if (again.joint != lost.joint || moved < SAME * training[0]->count[lost.joint - 1])
            return false;
        again.gain = lost.gain;
        lost = std::move(again);
        use_mended_logs(so, refit);
        return true;
    }
    void use_mended_logs(const SearchOptions &so, Hypothesis &refit)
    {
        training.clear();
        for (const FitLog &log : lost.logs)
            training.push_back(&log);
        causes.reset();
        search = std::make_unique<Search>(training, so);
        if (!search->refit(model, nullptr, refit))
            refit = lost.fit;
    }
    void add_lost_counts()
    {
        if (lost.joint == 0 || out.cause_count >= MK_MAX_CAUSES)
            return;
        double seconds = 0.0;
        for (const FitLog *log : training)
            seconds += log->duration();
        const mk_effect_info *effect = mk_effect_by_name("missed-counts");
        mk_cause &c = out.cause[out.cause_count++];
        c = {};
        c.effect = effect;
        c.joint = lost.joint;
        c.value[0] = lost.step;
        c.value[1] = lost.count / seconds;
        c.std_error[0] = lost.std_error;
        c.std_error[1] = std::sqrt(lost.count) / seconds;
        c.delta_bic = 2.0 * lost.gain;
        c.p_value = 0.0;
        c.confidence = 1.0 / (1.0 + std::exp(-lost.gain));
        std::stable_sort(
            out.cause, out.cause + out.cause_count,
            [](const mk_cause &a, const mk_cause &b) { return a.delta_bic > b.delta_bic; });
        if (mk_model_add_effect(&out.extended, effect->name, c.joint, nullptr) == MK_OK) {
            mk_effect_use &use = out.extended.effect[out.extended.effect_count - 1];
            use.value[0] = lost.step;
            use.value[1] = lost.count / seconds;
        }
    }

    // A model that does not follow its data bends within a stretch, and what it misses there is
    // taken for noise of the readings, of which there seem to be thousands: nearly anything can
    // earn a place that way. With stretches so short that the drift between them makes up for it,
    // evidence counts again. Done only where needed: it takes longer.
    void look_closer(SearchOptions so)
    {
        constexpr double SHORTEST = 0.03, SHORT = 0.12; // s
        const Hypothesis &left = causes->best;
        if (lost.joint > 0 || causes->follows(left) || mk_model_hides_joint(&left.point.model))
            return;
        double noise = HUGE_VAL;
        for (int j = 0; j < mk_model_joints(&model); j++)
            noise = std::min(noise, left.point.noise[j]);
        so.stretch = std::max(SHORTEST, std::pow(noise / left.drift, 2.0 / 3.0));
        if (so.stretch > SHORT)
            return;
        auto closer = std::make_unique<Search>(training, so);
        Hypothesis refit, same;
        if (!closer->refit(causes->refit.point.model, nullptr, refit) ||
            !closer->refit(left.point.model, nullptr, same))
            return;
        auto again = std::make_unique<CauseSearch>(model, *closer, refit);
        again->run();
        if (closer->cancelled)
            search->cancelled = true;
        // The first causes may come to the same once they are fitted closer.
        constexpr double EVEN = 10.0;
        if (again->best.score > same.score + EVEN)
            return;
        causes = std::move(again);
        search = std::move(closer);
    }

    // Of rivals that the training data cannot tell apart, the one that predicts held-out data
    // clearly better.
    void ask_held_out()
    {
        if (causes->rounds.size() != 1 || search->cancelled)
            return;
        const HeldOut held(data.held, out.window_s);
        std::vector<Hypothesis> &field = causes->rounds[0].field;
        HeldOutFigures best;
        if (is_library(field[0].added.effect) ||
            held.figures(field[0].point.model, best, nullptr) != MK_OK)
            return;
        size_t chosen = 0;
        for (size_t i = 1; i < field.size(); i++) {
            HeldOutFigures other;
            // A field may be from when there was another cause beside.
            if (is_library(field[i].added.effect) ||
                field[i].point.model.effect_count != field[0].point.model.effect_count ||
                field[i].score > field[0].score + INSEPARABLE ||
                held.figures(field[i].point.model, other, nullptr) != MK_OK ||
                !clearly_worse(best, other))
                continue;
            best = other;
            chosen = i;
        }
        if (chosen == 0)
            return;
        std::swap(field[0], field[chosen]);
        causes->best = field[0];
    }

    // Where not all is explained, a term that helps the training data alone may spoil for held-out
    // data what the others gain.
    void shed_what_misleads()
    {
        const HeldOut held(data.held, out.window_s);
        HeldOutFigures refitted, all;
        if (causes->rounds.size() < 2 || search->cancelled || explained() ||
            held.figures(causes->refit.point.model, refitted, nullptr) != MK_OK)
            return;
        const bool runs = held.figures(causes->best.point.model, all, nullptr) == MK_OK;
        if (runs && all.total() <= refitted.total() && !clearly_worse(all, refitted))
            return;
        HeldOutFigures least = refitted;
        Hypothesis better;
        size_t at = causes->rounds.size();
        for (size_t i = 0; i < causes->rounds.size(); i++) {
            Hypothesis less;
            HeldOutFigures left;
            if (!causes->fit_without(i, less) ||
                held.figures(less.point.model, left, nullptr) != MK_OK ||
                left.total() >= least.total() || clearly_worse(left, refitted))
                continue;
            least = left;
            better = std::move(less);
            at = i;
        }
        if (at < causes->rounds.size())
            causes->shed(at, std::move(better));
    }

    // --- verdict -----------------------------------------------------------------------------

    void decide()
    {
        out.given = model;
        out.refit = causes->refit.point.model;
        out.extended = causes->best.point.model;
        out.drift_refit = causes->refit.drift;
        out.drift_extended = causes->best.drift;
        out.gain_refit = 0.5 * distance_of_given();
        out.gain_extended = causes->refit.picture.evidence - causes->best.picture.evidence;
        for (int j = 0; j < MK_MAX_JOINTS; j++)
            out.noise[j] = causes->best.point.noise[j];
        if (causes->rounds.empty() && explained() && lost.joint == 0)
            out.verdict = values_off() ? MK_VERDICT_PARAMETERS : MK_VERDICT_NONE;
        else if ((lost.joint > 0 || !causes->rounds.empty()) && explained() && established())
            out.verdict = MK_VERDICT_EFFECT;
        else
            out.verdict = MK_VERDICT_UNKNOWN;
        describe_causes();
        add_lost_counts();
        describe_rivals();
        if (out.verdict == MK_VERDICT_UNKNOWN)
            set_structure();
    }
    bool all_named() const
    {
        const std::vector<Round> &rounds = causes->rounds;
        return std::none_of(rounds.begin(), rounds.end(),
                            [](const Round &r) { return is_library(r.field[0].added.effect); });
    }
    bool explained() const { return causes->follows(causes->best) && all_named(); }
    void set_structure()
    {
        snprintf(out.structure, sizeof out.structure, "%s",
                 describe_structure(out, *mk_plant(model.plant)).c_str());
        out.partly_named = out.cause_count > 0;
        for (int i = 0; i < out.cause_count; i++)
            out.partly_named = out.partly_named && !is_library(out.cause[i].effect);
    }
    // How far the given values are from the estimate, in its own covariance: chi-square distributed
    // if they are right.
    double distance_of_given() const
    {
        std::vector<int> free = fitted_parameters(causes->refit.point.model);
        Eigen::VectorXd off((long)free.size());
        for (long i = 0; i < off.size(); i++)
            off(i) = (mk_model_parameter(&model, free[(size_t)i]) -
                      mk_model_parameter(&causes->refit.point.model, free[(size_t)i])) /
                     Fit::scale_of(causes->refit.point.model, free[(size_t)i]);
        return off.dot(causes->refit.picture.information * off);
    }
    bool values_off() const
    {
        return chi2_tail(distance_of_given(), causes->refit.free_count) < 1e-4;
    }
    // Of all parameters of a hypothesis; NaN for those that were not fitted.
    static std::vector<double> standard_errors(const Hypothesis &h)
    {
        std::vector<int> free = fitted_parameters(h.point.model);
        Eigen::MatrixXd cov = Fit::covariance(h.point.model, h.picture, free);
        std::vector<double> error((size_t)mk_model_parameter_count(&h.point.model), UNKNOWN);
        for (size_t i = 0; i < free.size(); i++)
            error[(size_t)free[i]] = std::sqrt(std::max(cov((long)i, (long)i), 0.0));
        return error;
    }
    // Whether each cause by itself is known to be there. Laws that nearly cancel make up a shape
    // that none of them has.
    bool established() const
    {
        constexpr double SURE = 4.0; // standard errors
        const mk_model &m = causes->best.point.model;
        int first = mk_plant(m.plant)->parameter_count;
        for (int e = 0; e < m.effect_count; e++) {
            const mk_effect_info &info = *mk_effect(m.effect[e].index);
            const int cause = e - model.effect_count;
            if (cause >= 0 && cause < (int)causes->rounds.size()) {
                const int size = causes->rounds[(size_t)cause].field[0].added.size;
                const double error = error_of_size(first, info, size);
                if (std::fabs(m.effect[e].value[size]) < SURE * error)
                    return false;
            }
            first += info.parameter_count;
        }
        return true;
    }
    // Standard error of an effect's size, other parameters of it as they are unless the law is
    // linear in them and the size. NaN where it was not fitted.
    double error_of_size(int first, const mk_effect_info &info, int size) const
    {
        const Hypothesis &h = causes->best;
        const std::vector<int> free = fitted_parameters(h.point.model);
        std::vector<int> kept, place;
        long at = -1;
        for (size_t i = 0; i < free.size(); i++) {
            const int own = free[i] - first;
            if (own == size)
                at = (long)kept.size();
            else if (own >= 0 && own < info.parameter_count &&
                     info.parameter[own].fit != MK_FIT_ANGLE &&
                     info.parameter[own].fit != MK_FIT_CENTRE)
                continue;
            kept.push_back(free[i]);
            place.push_back((int)i);
        }
        FitPicture picture;
        picture.information = h.picture.information(place, place);
        return at < 0 ? UNKNOWN : std::sqrt(Fit::covariance(h.point.model, picture, kept)(at, at));
    }
    void describe_causes()
    {
        const std::vector<double> error = standard_errors(causes->best);
        int base = mk_plant(model.plant)->parameter_count, first = base;
        for (int i = 0; i < base; i++)
            out.std_error[i] = error[(size_t)i];
        for (int e = 0; e < causes->best.point.model.effect_count; e++) {
            const mk_effect_use &use = causes->best.point.model.effect[e];
            const mk_effect_info *info = mk_effect(use.index);
            int cause = e - model.effect_count;
            if (cause >= 0 && cause < MK_MAX_CAUSES && cause < (int)causes->rounds.size()) {
                mk_cause &c = out.cause[cause];
                c = {};
                c.effect = info;
                c.joint = use.joint;
                int fitted = 0;
                for (int k = 0; k < info->parameter_count; k++) {
                    c.value[k] = use.value[k];
                    c.std_error[k] = error[(size_t)(first + k)];
                    fitted += !std::isnan(c.std_error[k]);
                }
                weigh(cause, fitted, c);
                out.cause_count = cause + 1;
            }
            first += info->parameter_count;
        }
        std::stable_sort(
            out.cause, out.cause + out.cause_count,
            [](const mk_cause &a, const mk_cause &b) { return a.delta_bic > b.delta_bic; });
    }
    void weigh(int cause, int fitted, mk_cause &c)
    {
        const Lack lack = causes->without((size_t)cause);
        double gain = lack.score - causes->best.score,
               raw = lack.evidence - causes->best.picture.evidence;
        c.delta_bic = 2.0 * gain;
        double p = chi2_tail(2.0 * raw, std::max(fitted, 1));
        c.p_value = std::min(1.0, p * std::max(out.tried, 1));
        double rival = HUGE_VAL;
        const std::vector<Hypothesis> &field = causes->rounds[(size_t)cause].field;
        for (size_t i = 1; i < field.size(); i++)
            rival = std::min(rival, field[i].score - field[0].score);
        c.confidence = 1.0 / (1.0 + std::exp(-std::min(rival, gain)));
    }
    // Causes are listed by importance, rounds in the order of the model.
    int place_of(const Candidate &chosen) const
    {
        for (int i = 0; i < out.cause_count; i++)
            if (out.cause[i].effect == chosen.effect && out.cause[i].joint == chosen.joint)
                return i;
        return 0;
    }
    void describe_rivals()
    {
        struct Entry {
            mk_rival rival;
            double behind;
            const Hypothesis *fit;
        };
        std::vector<Entry> all;
        for (size_t r = 0; r < causes->rounds.size(); r++) {
            const std::vector<Hypothesis> &field = causes->rounds[r].field;
            for (size_t i = 1; i < field.size(); i++) {
                double behind = field[i].score - field[0].score;
                if (is_library(field[i].added.effect) && out.verdict != MK_VERDICT_UNKNOWN &&
                    behind > INSEPARABLE)
                    continue;
                Entry e = {{field[i].added.effect, field[i].added.joint, place_of(field[0].added),
                            2.0 * behind, behind > INSEPARABLE},
                           behind,
                           &field[i]};
                all.push_back(e);
            }
        }
        std::stable_sort(all.begin(), all.end(),
                         [](const Entry &a, const Entry &b) { return a.behind < b.behind; });
        for (const Entry &e : all) {
            // Terms of the library have one name: the best at a joint speaks for the others.
            const bool listed =
                std::any_of(out.rival, out.rival + out.rival_count, [&](const mk_rival &r) {
                    return r.effect == e.rival.effect && r.joint == e.rival.joint &&
                           r.instead_of == e.rival.instead_of;
                });
            if (listed || out.rival_count == MK_MAX_RIVALS)
                continue;
            rival_fit[out.rival_count] = e.fit;
            out.rival[out.rival_count++] = e.rival;
        }
    }
    const Hypothesis *rival_fit[MK_MAX_RIVALS] = {};

    // --- held-out data -----------------------------------------------------------------------

    // What predicts held-out data worse than the refitted model is not offered, and no cause is
    // claimed: the formula, if any, stays as an observation.
    void withdraw()
    {
        out.extended = causes->refit.point.model;
        std::vector<double> error = standard_errors(causes->refit);
        std::copy(error.begin(), error.begin() + mk_plant(model.plant)->parameter_count,
                  out.std_error);
        out.drift_extended = causes->refit.drift;
        if (out.verdict != MK_VERDICT_EFFECT)
            return;
        if (CauseSearch::matters(causes->refit.drift)) {
            out.verdict = MK_VERDICT_UNKNOWN;
            set_structure();
            return;
        }
        out.verdict = values_off() ? MK_VERDICT_PARAMETERS : MK_VERDICT_NONE;
        out.cause_count = out.rival_count = 0;
    }
    // Training data with bad times, or contact and play, are hard to follow to the last digit;
    // held-out data that the named causes alone predict confirm them all the same.
    void confirm(const HeldOut &held, const HeldOutFigures &after)
    {
        constexpr double CONFIRMED = 0.9; // of what refitting leaves
        constexpr double NEARLY = 1.5;    // of the noise
        const bool named = !causes->rounds.empty() && all_named();
        bool touches =
            mk_model_event_count(&causes->best.point.model) > mk_model_event_count(&model);
        bool as_read = true;
        for (int j = 0; j < mk_model_joints(&model); j++)
            as_read = as_read && after.nrmse(j) < NEARLY * noise_share(held, j);
        if (out.verdict != MK_VERDICT_UNKNOWN || !named || !out.offered || !established() ||
            !(out.closed > CONFIRMED) || !(touches || as_read))
            return;
        out.verdict = MK_VERDICT_EFFECT;
        out.structure[0] = 0;
    }
    enum mk_status predict_held_out(HeldOutFigures &before, HeldOutFigures &refitted,
                                    HeldOutFigures &after, mk_error *err)
    {
        // Where no model can say anything so far ahead, as of an unstable rig, less far.
        constexpr double SHORTEST = 0.1, SHORTER = 0.5; // s, share
        for (;; out.window_s = std::max(SHORTEST, SHORTER * out.window_s)) {
            const HeldOut held(data.held, out.window_s);
            before = refitted = after = {};
            enum mk_status st = held.figures(causes->refit.point.model, refitted, err);
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
            return st == MK_OK ? held.figures(model, before, err) : st;
        }
    }
    // Whether held-out data are predicted nearly as well as they are read. A trace of drift that
    // nothing explains says nothing then: long chaotic motion leaves one, and so does a rig that is
    // balanced for long, whose free run besides grows from any error at its start.
    bool at_noise(const HeldOut &held, const HeldOutFigures &f) const
    {
        constexpr double TRACE = 5e-3; // drift
        const bool trace =
            causes->refit.drift <= TRACE && leaves_white_noise(training, causes->refit);
        const double nearly = trace ? 6.0 : 3.0;
        bool near = true;
        for (int j = 0; j < mk_model_joints(&model); j++)
            near = near && f.nrmse(j) * held.deviation(model, j) < nearly * out.noise[j];
        return near;
    }
    double noise_share(const HeldOut &held, int j) const
    {
        const double sd = held.deviation(model, j);
        return sd > 0.0 ? out.noise[j] / sd : 0.0;
    }
    double floor_of(const HeldOut &held) const
    {
        double sum = 0.0;
        for (int j = 0; j < mk_model_joints(&model); j++)
            sum += noise_share(held, j) * noise_share(held, j);
        return sum;
    }
    // Where there is something to close, an extension that widens it is not what is missing,
    // however well it does in most windows or at one joint. A joint that hardly moves shows noise.
    bool misleads(const HeldOut &held, const HeldOutFigures &refitted,
                  const HeldOutFigures &after) const
    {
        constexpr double SOMETHING = 0.2, WIDER = 0.1; // of the noise, of the gap
        constexpr double NOISE = 2.0;                  // in squares
        double floor = 0.0, gap = 0.0, wider = 0.0;
        for (int j = 0; j < mk_model_joints(&model); j++) {
            const double share = noise_share(held, j), noise = NOISE * share * share;
            const double error = refitted.nrmse(j) * refitted.nrmse(j);
            const double left = after.nrmse(j) * after.nrmse(j);
            floor += share * share;
            gap += std::max(error - noise, 0.0);
            wider += std::max(left - noise, 0.0) - std::max(error - noise, 0.0);
        }
        return gap > SOMETHING * floor && wider > WIDER * gap;
    }
    enum mk_status measure(mk_error *err)
    {
        HeldOutFigures before, refitted, after;
        enum mk_status st = predict_held_out(before, refitted, after, err);
        if (st != MK_OK)
            return st;
        const HeldOut held(data.held, out.window_s);
        out.offered = out.cause_count > 0 && !clearly_worse(after, refitted) &&
                      !misleads(held, refitted, after);
        // A formula is worth having for what it predicts only.
        if (out.verdict == MK_VERDICT_UNKNOWN && after.total() > refitted.total())
            out.offered = false;
        if (out.cause_count > 0 && !out.offered) {
            for (int j = 0; j < mk_model_joints(&model); j++)
                out.declined[j] = after.nrmse(j);
            withdraw();
            after = refitted;
        }
        for (int i = 0; i < mk_plant(model.plant)->parameter_count; i++)
            out.extended.parameter_stderr[i] =
                std::isfinite(out.std_error[i]) ? out.std_error[i] : 0.0;
        if (out.verdict == MK_VERDICT_UNKNOWN && out.cause_count == 0 && at_noise(held, refitted)) {
            out.verdict = values_off() ? MK_VERDICT_PARAMETERS : MK_VERDICT_NONE;
            out.structure[0] = 0;
        }
        // Values that differ by more than chance but predict no better are as good as right.
        if (out.verdict == MK_VERDICT_PARAMETERS && !clearly_worse(before, refitted))
            out.verdict = MK_VERDICT_NONE;
        // Unless they predict nothing at all, if in a window or two only.
        constexpr double NOTHING = 100.0; // in squares
        if (out.verdict == MK_VERDICT_NONE && before.total() > NOTHING * refitted.total())
            out.verdict = MK_VERDICT_PARAMETERS;
        if (out.verdict == MK_VERDICT_NONE) {
            out.extended = model;
            after = before;
        }
        for (int j = 0; j < mk_model_joints(&model); j++) {
            out.before[j] = before.nrmse(j);
            out.refitted[j] = refitted.nrmse(j);
            out.after[j] = after.nrmse(j);
            out.floor[j] = noise_share(held, j);
        }
        const double floor = floor_of(held);
        double room = refitted.total() - floor;
        out.closed = room > 0.0 ? 1.0 - (after.total() - floor) / room : 0.0;
        confirm(held, after);
        return MK_OK;
    }
};

} // namespace

} // namespace mk

const char *mk_verdict_name(enum mk_verdict verdict)
{
    static const char *const names[] = {"none", "parameters", "effect", "unknown"};
    return names[verdict];
}

bool mk_explanation_doubts_logs(const mk_explanation *e)
{
    constexpr double FAR = 4.0, NOISE = 9.0; // in squares
    double before = 0.0, refitted = 0.0, floor = 0.0;
    for (int j = 0; j < mk_model_joints(&e->given); j++) {
        before += e->before[j] * e->before[j];
        refitted += e->refitted[j] * e->refitted[j];
        floor += e->floor[j] * e->floor[j];
    }
    return refitted > FAR * before && refitted > NOISE * floor;
}

bool mk_explanation_misses_held_out(const mk_explanation *e)
{
    constexpr double NOISE = 10.0;
    bool misses = false;
    for (int j = 0; j < mk_model_joints(&e->given); j++)
        misses = misses || std::min(e->before[j], e->refitted[j]) > NOISE * e->floor[j];
    return misses && e->verdict <= MK_VERDICT_PARAMETERS;
}

enum mk_status mk_explain(const mk_model *model, const mk_log *const *logs, size_t log_count,
                          const mk_log *const *holdouts, size_t holdout_count,
                          const mk_explain_options *options, mk_explanation *out, mk_error *err)
try {
    auto begin = std::chrono::steady_clock::now();
    mk_explain_options o = options ? *options : mk_explain_options{};
    if (o.threads <= 0)
        o.threads = std::max(1, (int)std::thread::hardware_concurrency());
    auto result = std::make_unique<mk_explanation>();
    result->window_s = o.window_s > 0.0 ? o.window_s : 1.0;
    if (!(o.most_s > 0.0))
        o.most_s = mk::MOST_DATA;
    if (log_count == 0)
        return mk_error_set(err, MK_ERR_INVALID, "explain needs a log at least");
    enum mk_status st = mk_model_check(model, err);
    if (st != MK_OK)
        return st;
    mk::Explainer explainer(*model, *result, o);
    st = explainer.run(logs, log_count, holdouts, holdout_count, err);
    if (st != MK_OK)
        return st;
    result->seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    *out = *result;
    return MK_OK;
} catch (const std::bad_alloc &) {
    return mk_error_set(err, MK_ERR_NOMEM, "no memory to explain this much data");
}
