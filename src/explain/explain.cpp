// From data to a verdict: the road of stages of explain (docs/explain.md, "How it decides").
//
// In come a model, logs to learn from, logs held out and options; out goes an mk_explanation, which
// owns nothing. mk_explain() checks the data and leaves rows out; Explainer::run() does the rest:
//
//     stage            takes                makes                                 by
//     load_and_fit     logs, model          data, folds, search, start, masses,   likelihood
//                                           refit: the model without a cause
//     correct_sure_    refit                logs without missed counts            readings
//     counts
//     put_in_place     refit                logs with one zero of the counter     likelihood
//     refit_beside_    refit, logs          values: what differs from log to      both
//     values                                log; the column of the command
//     find_causes      values               correction: missed counts put back;   both
//                                           causes: rounds and the best model
//     conclude         causes, held-out     verdict, standard errors, gain,       held-out
//                      data                 budget, next experiment               data
//
// Why in this order: what is about the data comes before what is about the rig. A zero that differs
// from log to log, a column that is late, a count that was missed would be found as a cause that is
// none. The other way round a strong cause can show as zeros and a delay: where one says more than
// both, ask_causes_first() turns the order round. Each stage that changes the data begins with
// load_and_fit() again, so that all later stages see one set of data. Held-out data are asked last:
// as long as they have chosen nothing, what they say is a measurement. They have a say against
// causes (claim, reject_misleading), and for one only among rivals (let_held_out_choose).
//
// Two judges take turns. Likelihood (CauseSearch) is right where a model nearly follows its data:
// then every reading is evidence. Where the best model still needs a process noise above
// policy::FAINT it gains thousands by whatever bends to the data, and predictions of data left out
// (PredictionSearch) decide.
//
// Who refers to whom: search and folds point into data, causes and PredictionSearches into search
// and free runs, free runs into folds. load_and_fit() replaces data, folds and search; what refers
// to them is made anew behind it.
#include "mechkit/explain.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>

#include "base/parallel.hpp"
#include "explain/control_gain.h"
#include "explain/evidence/budget.hpp"
#include "explain/evidence/detection.hpp"
#include "explain/evidence/gain.hpp"
#include "explain/evidence/held_out_say.hpp"
#include "explain/evidence/innovations.hpp"
#include "explain/given_logs.hpp"
#include "explain/policy.hpp"
#include "explain/report/next_experiment.hpp"
#include "explain/report/residual_torque.hpp"
#include "explain/search/final_fit.hpp"
#include "explain/search/first_fit.hpp"
#include "explain/search/log_values.hpp"
#include "explain/search/places.hpp"
#include "explain/stage_clock.hpp"
#include "ident/held_out.hpp"
#include "ident/left_out.hpp"
#include "ident/scale.hpp"

namespace mk
{

namespace
{

// A model less its effects from `first` up to before `last`.
mk_model without_effects(mk_model m, int first, int last)
{
    for (int e = last; e < m.effect_count; e++)
        m.effect[first + e - last] = m.effect[e];
    m.effect_count -= last - first;
    return m;
}

// Delay and lag of the command, s, as they are with all causes in the model, with standard errors
// sqrt(C_ii), C the covariance of the free parameters; NaN of one that was not fitted. Nothing
// changes unless the commanded column was taken in place of the model's.
void describe_input(const Hypothesis &best, mk_input_comparison &input)
{
    const mk_model &m = best.point.model;
    if (!input.changed || input.taken != MK_INPUT_COMMANDED)
        return;
    const std::vector<int> free = fitted_parameters(m);
    const Eigen::MatrixXd cov = Fit::covariance(m, best.quadratic, free);
    int number = mk_plant(m.plant)->parameter_count;
    for (int e = 0; e < m.effect_count; e++) {
        const mk_effect_info *info = mk_effect(m.effect[e].index);
        const auto place = std::find(free.begin(), free.end(), number);
        const long at = place - free.begin();
        const double error = place == free.end() ? std::nan("") : std::sqrt(cov(at, at));
        if (std::strcmp(info->name, "input-delay") == 0)
            input.delay = m.effect[e].value[0], input.delay_error = error;
        if (std::strcmp(info->name, "actuator-lag") == 0)
            input.lag = m.effect[e].value[0], input.lag_error = error;
        number += info->parameter_count;
    }
}

class Explainer
{
  public:
    Explainer(const mk_model &model_in, mk_explanation &out_in,
              const mk_explain_options &options_in)
        : asked(model_in), model(model_in), start(model_in), out(out_in), options(options_in),
          clock(out_in)
    {
    }

    // The road of a question, as at the head of this file. Borrows the logs until it returns. The
    // first stage that fails ends it; `out` is then of no use.
    enum mk_status run(const mk_log *const *logs, size_t log_count, const mk_log *const *holdouts,
                       size_t holdout_count, mk_error *err)
    {
        SearchOptions so;
        so.given = &start;
        so.masses = &masses;
        so.threads = options.threads;
        so.progress = options.progress;
        so.progress_context = options.progress_context;
        LogList learn(logs, logs + log_count), held(holdouts, holdouts + holdout_count);
        Hypothesis refit;
        clock.enter("refit");
        enum mk_status st = load_and_fit(learn, held, so, refit, err);
        if (st == MK_OK)
            st = correct_sure_counts(learn, held, so, refit, err);
        if (st == MK_OK)
            st = put_in_place(learn, held, so, refit, err);
        if (st == MK_OK)
            st = refit_beside_values(learn, held, so, refit, err);
        if (st == MK_OK)
            st = find_causes(learn, held, so, err);
        return st == MK_OK ? conclude(so, err) : st;
    }

  private:
    // Missed counts that the readings show beyond doubt, of a model that is too far from its data
    // to say more of them (correct_counts asks one that is near): put back in the logs before all
    // else, since all else would stand in for them. Fitted again then.
    enum mk_status correct_sure_counts(LogList &learn, LogList &held, SearchOptions &so,
                                       Hypothesis &refit, mk_error *err)
    {
        clock.enter("missed counts");
        if (!surely_missed(training))
            return MK_OK;
        sure_correction = find_count_correction(model, training, so, refit, policy::ACCEPT_FIRST,
                                                policy::FAR_FROM_DATA);
        if (search->cancelled)
            return mk_error_set(err, MK_ERR_INTR, "stopped");
        if (!sure_correction.sure || sure_correction.fit.process_noise <= policy::FAR_FROM_DATA) {
            sure_correction = {};
            return MK_OK;
        }
        sure_correction.logs.clear();
        int steps = 0;
        for (LogList *list : {&learn, &held})
            correct_logs(*list, sure_correction, corrected_logs,
                         list == &held ? out.held_counts_corrected : steps);
        clock.enter("refit");
        return load_and_fit(learn, held, so, refit, err);
    }
    // The logs with missed counts are replaced by those without, which `made` keeps.
    void correct_logs(LogList &logs, const CountCorrection &by, std::vector<OwnedLog> &made,
                      int &steps) const
    {
        for (const mk_log *&log : logs)
            if (OwnedLog better = log_with_corrected_counts(*log, model, by, steps)) {
                log = better.get();
                made.push_back(std::move(better));
            }
    }
    // Logs in which a counter was zeroed elsewhere, brought to one zero; fitted again then.
    enum mk_status put_in_place(LogList &learn, LogList &held, SearchOptions &so, Hypothesis &refit,
                                mk_error *err)
    {
        clock.enter("zeros");
        const Places places = find_places(learn, held, *search, refit);
        if (search->cancelled)
            return mk_error_set(err, MK_ERR_INTR, "stopped");
        if (places.joint == 0)
            return MK_OK;
        describe_places(places, out);
        for (LogList *list : {&learn, &held}) {
            const std::vector<Place> &theirs = list == &learn ? places.learn : places.held;
            for (OwnedLog &log : mk::put_in_place(*list, places.joint, theirs))
                in_place.push_back(std::move(log));
            std::transform(in_place.end() - (long)list->size(), in_place.end(), list->begin(),
                           [](const OwnedLog &log) { return log.get(); });
        }
        clock.enter("refit");
        return load_and_fit(learn, held, so, refit, err);
    }
    // Whether figures are those of second halves: of the first ones it is known where the log was
    // zeroed, or what else it has of its own.
    bool on_second_halves(bool own_values) const { return own_values || !in_place.empty(); }
    // The refitted model, what differs from log to log, and the column of the command: before all
    // causes, unless a single cause says more than both (ask_causes_first).
    enum mk_status refit_beside_values(const LogList &learn, const LogList &held, SearchOptions &so,
                                       Hypothesis &refit, mk_error *err)
    {
        enum mk_status st = MK_OK;
        given = model;
        given_refit = refit.point.model;
        clock.enter("values per log");
        values = find_log_values(model, learn, out.window_s, *search, refit);
        clock.enter("column of the command");
        st = choose_input(learn, held, err);
        clock.enter("refit");
        if (st == MK_OK && out.input.changed)
            st = load_and_fit(learn, held, so, refit, err);
        if (st != MK_OK)
            return st;
        clock.enter("values per log");
        if (out.input.changed)
            values = values.found.empty()
                         ? find_log_values(model, learn, out.window_s, *search, refit)
                         : with_log_values(model, values.found, *search, refit);
        if (!values.found.empty() || out.input.changed)
            st = ask_causes_first(learn, held, so, refit, err);
        plain = refit;
        return st;
    }
    // The causes beside the values per log and the column: makes `causes` and `correction`. Twice
    // where values per log turn out to have stood for a part of a cause (reject_log_values), and
    // again where the causes came first and the column is another one beside them.
    enum mk_status find_causes(const LogList &learn, const LogList &held, SearchOptions &so,
                               mk_error *err)
    {
        search_beside_values(so);
        if (reject_log_values(so))
            search_beside_values(so);
        enum mk_status st = MK_OK;
        if (causes_first && !search->cancelled)
            st = ask_input_again(learn, held, so, plain, err);
        if (st != MK_OK)
            return st;
        out.tried = causes->tried();
        return search->cancelled ? mk_error_set(err, MK_ERR_INTR, "stopped") : MK_OK;
    }
    // What is said of what was found, and measured on data that nothing was fitted to:
    //     last fit          all data in place of the windows that were searched: parameters and
    //                       standard errors are best known so ;
    //     verdict           causes, evidence and rivals from the search, values from the last fit ;
    //     detection limits, residual torques, one-step predictions: what the last fit leaves ;
    //     held-out data     may take the extension back, or raise the verdict ;
    //     budget, next      of what is still claimed, so behind it .
    // A failure on held-out data is that of the whole.
    enum mk_status conclude(SearchOptions &so, mk_error *err)
    {
        clock.enter("last fit");
        // Where no cause was found none can bend what the rig weighs.
        if (causes->rounds.empty() && !masses_kept)
            masses = {};
        FinalFit last(data, training, *causes, *search);
        if (by_predictions) {
            last.fit_runs(data, so, all_runs ? *all_runs : *free_runs);
        } else if (correction.joint == 0 && !data.whole.empty()) {
            last.fit_all(data, so, out.window_s);
        }
        const CountCorrection &told = sure_correction.joint > 0 ? sure_correction : correction;
        Verdict verdict(values.model, *causes, last, told, out);
        verdict.decide();
        tell_given();
        if (!values.found.empty() || out.input.changed)
            out.refit = given_refit; // without any of it
        describe_input(last.best, out.input);
        describe_log_values(values, last.best, last.logs(), options.threads, out);
        if (out.log_value_count + out.input.changed > 0)
            verdict.add_data_causes();
        clock.enter("detection limits");
        find_detection_limits(last.search(), last.best, out);
        clock.enter("residuals");
        find_residual_torques(last.logs(), model, last.refit, last.best, options.threads, out);
        test_innovations(last.logs(), last.refit, last.best, out);
        clock.enter("held-out data");
        TrainingRuns runs(data, last, out);
        enum mk_status measured =
            measure_gain(values.model, options, data, *causes, last, runs, verdict, out, err);
        verdict.describe_suspects();
        clock.enter("budget");
        if (measured == MK_OK)
            make_budget(data, *causes, options.threads, runs, out);
        clock.enter("next experiment");
        if (measured == MK_OK && !model.no_motor)
            propose_experiment(values.model, last.logs(), last.best, verdict.rivals(), options.next,
                               out);
        clock.stop();
        return measured;
    }

    // Where values are unknown the fit may have begun with others all over, which were not given.
    void tell_given()
    {
        out.given = given;
        const int count = mk_plant(given.plant)->parameter_count;
        std::copy_n(options.unknown, count, out.unknown);
        if (std::none_of(out.unknown, out.unknown + count, [](bool unknown) { return unknown; }))
            return;
        for (int i = 0; i < count; i++)
            if (!out.unknown[i])
                out.given.parameter[i] = asked.parameter[i];
    }

    const mk_model asked;        // as the caller gave it
    mk_model model;              // as given; where values of it are unknown, as the fit starts
    mk_model start;              // base parameters right to within a factor of some three
    MassRange masses;            // between `start` and the refitted model, and some way beyond
    bool masses_kept = false;    // by the first fit, which would have gone further
    mk_model given, given_refit; // by the column that the model names, without values per log
    mk_explanation &out;
    mk_explain_options options;
    StageClock clock;
    CountCorrection sure_correction;      // missed counts that were put back before all else
    std::vector<OwnedLog> corrected_logs; // the logs with them put back
    std::vector<OwnedLog> in_place;       // the logs with one zero, where they had several
    TrainingData data;
    std::vector<const FitLog *> training; // of `data`, or with missed counts put back
    std::unique_ptr<Search> search;
    Hypothesis plain; // the refitted model without values per log
    LogValues values;
    CountCorrection correction;
    std::unique_ptr<CauseSearch> causes;
    std::unique_ptr<Folds> folds;        // of `data`
    std::unique_ptr<FreeRuns> free_runs; // over the same data
    std::unique_ptr<FreeRuns> all_runs;  // over all to learn from
    bool by_predictions = false;         // have causes been found
    bool closed_by_predictions = false;  // most of the gap, before likelihood was asked
    bool causes_first = false;           // they say more than what is asked before them
    bool begun_to_end = false;           // `begun` has all its causes
    std::unique_ptr<PredictionSearch> begun, decided; // over free_runs, over all_runs

    // The data as the model's column drives them, and the fit to them that all else starts from.
    enum mk_status load_and_fit(const LogList &logs, const LogList &holdouts, SearchOptions &so,
                                Hypothesis &refit, mk_error *err)
    {
        search.reset();
        training.clear();
        data = {};
        out.given_s = out.searched_s = 0.0;
        enum mk_status st = data.load(model, options, logs.data(), logs.size(), holdouts.data(),
                                      holdouts.size(), out, err);
        if (st != MK_OK)
            return st;
        for (const FitLog &log : data.logs)
            training.push_back(&log);
        folds = std::make_unique<Folds>(data, out.window_s);
        masses = {};
        FirstFit first(asked, model, start, training, options, so);
        search = first.run(logs);
        first.adapt_sharpness(*search);
        masses_kept = first.keep_known_masses(*search, *folds, out.window_s, masses);
        if (first.fitted) {
            if (masses_kept)
                masses = {start, first.refit.point.model};
            else
                first.agree_on_masses(*search, *folds, out.window_s, masses);
            refit = std::move(first.refit);
            return MK_OK;
        }
        return mk_error_set(err, search->cancelled ? MK_ERR_INTR : MK_ERR_NUMERIC,
                            "the model cannot follow the data: are rig, units and signs right?");
    }
    // Values per log and the column come before all causes, because causes would be sought in the
    // place of what they miss. Where a single cause says more than both together it is they that
    // stand in for it: then it comes first, and they are asked beside it. With s(m) minus the log
    // likelihood of independent errors of free runs, with a penalty for parameters,
    //     s(given model and its first cause) < s(values per log and column) .
    // For that the data are loaded as the given column drives them, and if the cause does not say
    // more they are loaded as before: fits are repeatable, so that nothing else changes. Then
    // `refit`, `values`, model and start are as they were; else they are those of the given model,
    // and `begun` has the cause.
    enum mk_status ask_causes_first(const LogList &logs, const LogList &holdouts, SearchOptions &so,
                                    Hypothesis &refit, mk_error *err)
    {
        if (!folds->enough() || CauseSearch::likelihood_counts(values.fit) ||
            mk_model_hides_joint(&given))
            return MK_OK;
        clock.enter("predictions");
        const double with_them = surprise_of(values.fit.point.model);
        const mk_model taken = model, taken_start = start;
        const mk_input_comparison input = out.input;
        const std::vector<LogValue> found = values.found;
        enum mk_status st = MK_OK;
        if (input.changed) {
            model = start = given;
            out.input = {};
            st = load_and_fit(logs, holdouts, so, refit, err);
        }
        if (st != MK_OK)
            return st;
        begun = predictions_of(refit.point.model);
        if (begun->start() && begun->add_one() && begun->surprise() < with_them) {
            values = {model, refit, {}};
            causes_first = true;
            return MK_OK;
        }
        begun.reset();
        if (!input.changed)
            return MK_OK;
        model = taken;
        start = taken_start;
        out.input = input;
        st = load_and_fit(logs, holdouts, so, refit, err);
        if (st == MK_OK)
            values = with_log_values(model, found, *search, refit);
        return st;
    }
    // The column once more, beside causes that came before it. Where it is the other one now, the
    // data are loaded with it and the causes taken over and fitted there; the search by predictions
    // has then come to its end already. `their_search` keeps alive what `before` refers to.
    enum mk_status ask_input_again(const LogList &logs, const LogList &holdouts, SearchOptions &so,
                                   Hypothesis &refit, mk_error *err)
    {
        if (!by_predictions || causes->rounds.empty())
            return MK_OK;
        clock.enter("column of the command");
        const std::vector<LogValue> found = values.found;
        const mk_model own = values.model;
        values.model = causes->best.point.model;
        enum mk_status st = choose_input(logs, holdouts, err);
        values.model = own;
        if (st != MK_OK || !out.input.changed)
            return st;
        const std::unique_ptr<PredictionSearch> before = std::move(decided);
        const std::unique_ptr<Search> their_search = std::move(search);
        causes.reset();
        st = load_and_fit(logs, holdouts, so, refit, err);
        if (st != MK_OK)
            return st;
        plain = refit;
        values = found.empty() ? LogValues{model, refit, {}}
                               : with_log_values(model, found, *search, refit);
        clock.enter("predictions");
        begun = predictions_of(values.fit.point.model);
        begun_to_end = begun->take(*before);
        if (!begun_to_end)
            begun.reset();
        search_beside_values(so);
        return MK_OK;
    }
    // A search by predictions over the folds, from a base model. It refers to `free_runs`, which is
    // replaced here: a search that was made before keeps its results, but must not go on.
    std::unique_ptr<PredictionSearch> predictions_of(const mk_model &base)
    {
        free_runs = std::make_unique<FreeRuns>(folds->by_fold(), start, out.window_s,
                                               options.threads, &masses);
        return std::make_unique<PredictionSearch>(*search, *free_runs, base);
    }
    // s(base), fitted to free runs; infinite where it cannot be run.
    double surprise_of(const mk_model &base)
    {
        const std::unique_ptr<PredictionSearch> fitted = predictions_of(base);
        return fitted->start() ? fitted->surprise() : HUGE_VAL;
    }
    // The column that drives the model comes before all causes: what the wrong one misses would be
    // sought in the rig. What differs from log to log hides which one is right, so it is in the
    // model meanwhile, and looked for again afterwards. Logs that the column cannot be asked of are
    // told of later, if at all.
    enum mk_status choose_input(const LogList &logs, const LogList &holdouts, mk_error *err)
    {
        const auto both = [this](const mk_log *log) { return mk_log_has_both_inputs(log, &model); };
        if (!std::all_of(logs.begin(), logs.end(), both) ||
            !std::all_of(holdouts.begin(), holdouts.end(), both))
            return MK_OK;
        mk_ident_options o = {};
        std::copy(std::begin(options.unknown), std::end(options.unknown), o.unknown);
        o.rows.keep_all = true; // they are left out already
        o.threads = options.threads;
        o.progress = options.progress;
        o.progress_context = options.progress_context;
        const enum mk_status st =
            mk_compare_inputs(&values.model, logs.data(), logs.size(), &o, &out.input, err);
        if (st == MK_OK && out.input.changed)
            start = model =
                without_effects(out.input.model, model.effect_count, values.model.effect_count);
        return st == MK_ERR_RANGE || st == MK_ERR_NUMERIC ? MK_OK : st;
    }
    // The search itself, with what differs from log to log in the model.
    //     1. Of long logs, or where a search has begun: by predictions. Where they close most of
    //     the
    //        gap and leave more than policy::FAR_FROM_NOISE times the noise, likelihood is not
    //        asked, which would only take longer to fail. Where they close little it is asked as
    //        of short logs.
    //     2. Missed counts: steps in the readings look like kicks to every law, so before causes.
    //     3. By likelihood; once more where the causes change the size of the missed counts.
    //     4. Where that does not speak for itself: predictions decide (decide_by), or at least
    //        confirm causes beside a rest without a name (ask_what_carries_over).
    //     5. Where likelihood has decided: rivals, and what held-out data say of them and of terms.
    void search_beside_values(SearchOptions &so)
    {
        by_predictions = false;
        Hypothesis refit = values.fit;
        clock.enter("missed counts");
        data.second_half = on_second_halves(!values.found.empty());
        // Of long logs windows are searched: there a search by likelihood takes long to fail.
        std::unique_ptr<PredictionSearch> prediction;
        if (!data.whole.empty() || begun)
            prediction = search_predictions(refit);
        clock.enter("missed counts");
        closed_by_predictions = prediction && closes_most(*prediction);
        const bool far =
            closed_by_predictions && prediction->times_noise() > policy::FAR_FROM_NOISE;
        if (!far)
            correct_counts(so, refit);
        clock.enter("search");
        search_causes(refit, far);
        if (!causes->rounds.empty() && (correction.joint > 0 ? tune_count_correction(so, refit)
                                                             : tune_sure_correction(so, refit)))
            search_causes(refit, false);
        if (!speaks_for_itself()) {
            if (!prediction)
                prediction = search_predictions(refit);
            clock.enter("predictions");
            by_predictions = prediction && decide_by(prediction, refit);
        }
        if (!by_predictions && !followed())
            by_predictions = ask_what_carries_over(refit);
        data.second_half = on_second_halves(!own_parameters(causes->best.point.model).empty());
        if (by_predictions)
            return;
        clock.enter("rivals");
        causes->polish_rivals();
        hear_held_out();
    }
    void hear_held_out()
    {
        const HeldOut held(data.held, out.window_s, data.second_half, options.threads);
        if (!search->cancelled) {
            let_held_out_choose(*causes, held);
            reject_misleading(*causes, held);
        }
    }
    static bool closes_most(const PredictionSearch &found)
    {
        return found.closed() > policy::CLOSED_BY_PREDICTIONS &&
               found.times_noise() < policy::NEAR_THE_NOISE;
    }
    // Causes that predict are those that are said, unless likelihood goes on from them. Where none
    // does, or none is confirmed, likelihood is asked to the end, and says what it is where it
    // speaks for itself. True where predictions have decided.
    bool decide_by(std::unique_ptr<PredictionSearch> &prediction, Hypothesis &refit)
    {
        if (go_on_from(*prediction, refit))
            return false;
        if (!is_asked_of_all())
            prediction->decide();
        if (prediction->causes.empty())
            go_on_without_predictions();
        if (speaks_for_itself())
            return false;
        begin_with_likely_causes(prediction, refit);
        std::unique_ptr<CauseSearch> likely = std::move(causes);
        const bool taken = take_predictions(prediction, refit);
        if (taken && !causes->rounds.empty())
            return true;
        std::swap(causes, likely);
        if (!taken)
            return false;
        go_on_without_predictions();
        if (speaks_for_itself())
            return false;
        std::swap(causes, likely);
        return true;
    }
    // Several causes can hide each other so well that none predicts by itself, and only all
    // together do. Likelihood, which looks no further ahead than a shooting interval, may have
    // found them: a search that begins with them takes the place of `prediction` where it ends
    // likelier, those that do not carry over left out. Where likelihood has given up its causes say
    // nothing.
    void begin_with_likely_causes(std::unique_ptr<PredictionSearch> &prediction,
                                  const Hypothesis &refit)
    {
        auto beside = std::make_unique<PredictionSearch>(*search, *free_runs, refit.point.model);
        const auto is_likelier = [&] {
            return beside->surprise() < prediction->surprise() - policy::BETTER_IN_PLACE;
        };
        if (causes->rounds.empty() || causes->gives_up() || !causes->hand_over(*beside) ||
            !is_likelier())
            return;
        beside->decide();
        const bool others = std::any_of(beside->causes.begin(), beside->causes.end(),
                                        [&](auto &c) { return !prediction->has_cause(c.cause); });
        if ((!others && !is_likelier()) || !beside->go_on() || !is_likelier())
            return;
        beside->decide();
        prediction = std::move(beside);
    }
    // Whether likelihood has found what is missing, or most of it.
    bool speaks_for_itself() const
    {
        return correction.joint > 0 || causes->follows(causes->best) ||
               CauseSearch::likelihood_counts(causes->best);
    }
    // Whether there is no rest beside the causes of likelihood that predictions could be asked
    // about.
    bool followed() const
    {
        return correction.joint > 0 || causes->rounds.empty() || causes->follows(causes->best);
    }
    // Likelihood has found most of what is missing, and something stays that has no name: which of
    // it is sure all the same, data say that are left out. Where nothing is, or held-out data
    // confirm none of it by itself, likelihood's causes stay.
    bool ask_what_carries_over(const Hypothesis &refit)
    {
        if (!folds->enough() || mk_model_hides_joint(&causes->best.point.model))
            return false;
        clock.enter("predictions");
        mk_model base = refit.point.model;
        base.friction_sharpness = causes->best.point.model.friction_sharpness;
        std::unique_ptr<PredictionSearch> found = predictions_of(base);
        if (!causes->hand_over(*found))
            return false;
        found->decide();
        std::unique_ptr<CauseSearch> likely = std::move(causes);
        if (!found->causes.empty() && take_predictions(found, refit) && !causes->rounds.empty())
            return true;
        causes = std::move(likely);
        return false;
    }
    // Where what improves predictions brings the model near to its data, likelihood says the rest.
    bool go_on_from(const PredictionSearch &found, const Hypothesis &refit)
    {
        auto more = std::make_unique<CauseSearch>(values.model, *search, refit);
        if (found.causes.empty() || !more->go_on(found))
            return false;
        causes = std::move(more);
        return true;
    }
    // Where nothing predicts, likelihood is asked to the end. Not of several logs, of which those
    // that are left out have said that nothing carries over, nor where it says nothing either.
    void go_on_without_predictions()
    {
        if (!causes->gives_up() || causes->is_hopeless() || folds->sources() >= Folds::FEWEST)
            return;
        clock.enter("search");
        causes->run_to_the_end();
    }
    // The causes of a search by predictions become `causes`: confirmed on all logs, then against
    // held-out data. False where one of both cannot be done; `causes` is then as it was.
    bool take_predictions(std::unique_ptr<PredictionSearch> &found, const Hypothesis &refit)
    {
        auto carried = std::make_unique<CauseSearch>(values.model, *search, refit);
        if (!confirm(found))
            return false;
        found->claim(HeldOut(data.held, out.window_s, data.second_half, options.threads));
        if (!carried->take_over(*found))
            return false;
        causes = std::move(carried);
        decided = std::move(found);
        return true;
    }
    // What improves predictions, where the refitted model is so far from its data that likelihood
    // does not say what is missing. NULL: it does, or the data are too few to leave some out.
    std::unique_ptr<PredictionSearch> search_predictions(Hypothesis &refit)
    {
        if (!folds->enough() || CauseSearch::likelihood_counts(refit) ||
            mk_model_hides_joint(&refit.point.model))
            return nullptr;
        clock.enter("predictions");
        const bool has_begun = begun != nullptr;
        std::unique_ptr<PredictionSearch> found =
            has_begun ? std::move(begun) : predictions_of(refit.point.model);
        const bool to_the_end = has_begun && begun_to_end;
        if (!to_the_end && !(has_begun ? found->go_on() : found->run()))
            return nullptr;
        ask_values_again(found, refit);
        return found;
    }
    // Whether logs have values of their own was asked when no cause was known, and what the model
    // lacked could hide it or stand in for it: again beside the causes.
    void ask_values_again(std::unique_ptr<PredictionSearch> &found, Hypothesis &refit)
    {
        if (found->causes.empty() || folds->sources() < 2)
            return;
        const bool had = !values.found.empty();
        std::vector<LogValue> usual = usual_log_values(model);
        LogValues other =
            had ? LogValues{model, plain, {}} : with_log_values(model, usual, *search, plain);
        if (!had && other.found.empty())
            return;
        auto beside =
            std::make_unique<PredictionSearch>(*search, *free_runs, other.fit.point.model);
        if (!beside->take(*found))
            return;
        const PredictionSearch &with = had ? *found : *beside, &less = had ? *beside : *found;
        double gain;
        const Carried carried = with.against(less, gain);
        if (carry_over::enough(carried, 1, gain) == had)
            return;
        for (LogValue &v : other.found)
            v.gain = gain;
        values = std::move(other);
        refit = values.fit;
        data.second_half = on_second_halves(!values.found.empty());
        found = std::move(beside);
        // What likelihood has found was beside the values as they were.
        if (causes)
            search_causes(refit, false);
    }
    // Whether what windows of longer logs say is asked of all their data, log by log: then those
    // decide.
    bool is_asked_of_all() const
    {
        return !data.whole.empty() && data.rows_by_log().size() >= Folds::FEWEST;
    }
    // Where windows of longer logs were searched: once more over all of them. What remembers the
    // past is known better there.
    bool confirm(std::unique_ptr<PredictionSearch> &found)
    {
        all_runs.reset();
        if (data.whole.empty())
            return true;
        all_runs = std::make_unique<FreeRuns>(data.rows_by_log(), start, out.window_s,
                                              options.threads, &masses);
        if (!is_asked_of_all()) {
            RunPoint at = all_runs->start(found->refitted().point.model);
            all_runs->take_scale(at);
            return true;
        }
        auto again =
            std::make_unique<PredictionSearch>(*search, *all_runs, found->refitted().point.model);
        if (!again->confirm(*found))
            return false;
        found = std::move(again);
        return true;
    }
    // What differs from log to log is looked for before the causes, and can then stand in for a
    // part of one. With the causes in the model it no longer differs, and the search is to be
    // repeated without it. True if so.
    bool reject_log_values(SearchOptions &so)
    {
        if (values.found.empty() || search->cancelled || !causes->follows(causes->best))
            return false;
        const std::vector<LogValue> left =
            that_still_differ(values, causes->best, training, search->usual_options());
        if (left.size() == values.found.size())
            return false;
        correction = {};
        training.clear();
        for (const FitLog &log : data.logs)
            training.push_back(&log);
        causes.reset();
        search = std::make_unique<Search>(training, so);
        values = with_log_values(model, left, *search, plain);
        return true;
    }
    // A new search by likelihood from `refit`; with `far` it stays at that model. It gives up early
    // only where predictions can take over: there are folds, and no missed counts, which free runs
    // do not know. It does so after one cause (two where there are only one or two logs that
    // predictions have not been of use for) if the model still says nothing within a shooting
    // interval and, but where predictions have closed most of the gap, the causes gain less than
    // policy::LIKELIHOOD_SAYS_LITTLE a reading.
    void search_causes(const Hypothesis &refit, bool far)
    {
        causes = std::make_unique<CauseSearch>(values.model, *search, refit);
        causes->give_up_after = folds->sources() < Folds::FEWEST && !closed_by_predictions ? 2 : 1;
        if (correction.joint == 0 && folds->enough())
            causes->gives_up_below =
                closed_by_predictions ? HUGE_VAL : policy::LIKELIHOOD_SAYS_LITTLE;
        if (!far)
            causes->run();
    }
    // Looks for missed counts with the model as it is; what is found is put back into the logs, and
    // `refit` is the fit to those.
    void correct_counts(const SearchOptions &so, Hypothesis &refit)
    {
        correction = find_count_correction(values.model, training, so, refit, policy::ACCEPT_FIRST,
                                           policy::FAR_FROM_DATA);
        // Where the model still misses its data, what look like steps may make up for that.
        if (correction.joint > 0 && !correction.sure &&
            !CauseSearch::likelihood_counts(correction.fit))
            correction = {};
        if (correction.joint > 0)
            use_corrected_logs(so, refit);
        // Missed counts are no fault of a model that is measured on them.
        if (correction.sure)
            correct_logs(data.held, correction, data.made, out.held_counts_corrected);
    }
    // How large the steps are was seen by a model that lacked other causes: again with those. True
    // if that makes another search worth while.
    static constexpr double SAME_STEP = 0.05; // counts
    bool tune_count_correction(const SearchOptions &so, Hypothesis &refit)
    {
        std::vector<const FitLog *> raw;
        for (const FitLog &log : data.logs)
            raw.push_back(&log);
        const mk_model extended = causes->best.point.model;
        CountCorrection again =
            find_count_correction(extended, raw, so, causes->refit, -HUGE_VAL, HUGE_VAL);
        double moved = std::fabs(again.step - correction.step);
        if (again.joint != correction.joint ||
            moved < SAME_STEP * training[0]->count[correction.joint - 1])
            return false;
        again.gain = correction.gain;
        correction = std::move(again);
        use_corrected_logs(so, refit);
        return true;
    }
    // The same of those that were put back before all else, as soon as causes bring the model near
    // to its data.
    bool tune_sure_correction(const SearchOptions &so, Hypothesis &refit)
    {
        if (sure_correction.joint == 0 || !CauseSearch::likelihood_counts(causes->best))
            return false;
        CountCorrection again = tuned(causes->best.point.model, training, so, sure_correction);
        if (std::fabs(again.step - sure_correction.step) <
            SAME_STEP * training[0]->count[sure_correction.joint - 1])
            return false;
        correction = std::move(again);
        sure_correction = {};
        use_corrected_logs(so, refit);
        return true;
    }
    // `training` become the logs of `correction`. The model is fitted anew from the base parameters
    // of the start: those of a fit to logs with steps in them may be far off.
    void use_corrected_logs(const SearchOptions &so, Hypothesis &refit)
    {
        training.clear();
        for (const FitLog &log : correction.logs)
            training.push_back(&log);
        causes.reset();
        search = std::make_unique<Search>(training, so);
        mk_model from = values.model;
        std::copy_n(start.parameter, MK_MAX_PARAMETERS, from.parameter);
        if (!search->refit(from, nullptr, refit))
            refit = correction.fit;
    }
};

} // namespace

} // namespace mk

// Before the road: checks of the data, rows with foreign contact left out, logs in which nothing
// moves dropped. Behind it: what the caller's model says of a motor, and trials in control if asked
// for. The result is made apart, so that *out is untouched by a failure.
enum mk_status mk_explain(const mk_model *model, const mk_log *const *logs, size_t log_count,
                          const mk_log *const *holdouts, size_t holdout_count,
                          const mk_explain_options *options, mk_explanation *out, mk_error *err)
try {
    auto begin = std::chrono::steady_clock::now();
    mk_explain_options o = options ? *options : mk_explain_options{};
    o.threads = mk::threads_for(o.threads);
    auto result = std::make_unique<mk_explanation>();
    result->window_s = o.window_s > 0.0 ? o.window_s : 1.0;
    if (!(o.most_s > 0.0))
        o.most_s = mk::policy::MOST_DATA;
    if (log_count == 0)
        return mk_error_set(err, MK_ERR_INVALID, "explain needs a log at least");
    enum mk_status st = mk_model_check(model, err);
    if (st != MK_OK)
        return st;
    st = mk::check_data(*model, {logs, log_count}, {holdouts, holdout_count}, o, result->data_check,
                        err);
    if (st != MK_OK)
        return st;
    std::vector<const mk_log *> all(logs, logs + log_count);
    all.insert(all.end(), holdouts, holdouts + holdout_count);
    std::vector<mk::OwnedLog> made;
    st = mk::leave_out(*model, o.rows, all, made, result->left_out, &result->left_out_count, err);
    if (st != MK_OK)
        return st;
    const mk::LogList learn = mk::used_logs(*model, {all.data(), log_count}, MK_DATA_EXPLAIN);
    const mk::LogList held =
        mk::used_logs(*model, {all.data() + log_count, holdout_count}, MK_DATA_HOLD_OUT);
    if (learn.empty())
        return mk_error_at(err, MK_ERR_RANGE, logs[0]->path, 0, 0,
                           "nothing moves in this log: there is nothing to explain");
    // For the fits a rig that nothing drove in these logs is one without a motor.
    mk_model as_driven = *model;
    as_driven.no_motor = mk::nothing_drives(*model, all);
    mk::Explainer explainer(as_driven, *result, o);
    st = explainer.run(learn.data(), learn.size(), held.data(), held.size(), err);
    if (st != MK_OK)
        return st;
    result->scale_free = as_driven.no_motor;
    result->scale_holder = mk::scale_holder(*model, nullptr);
    for (mk_model *m : {&result->given, &result->refit, &result->extended})
        m->no_motor = model->no_motor;
    if (o.control) {
        mk::StageClock clock(*result);
        clock.enter("trials in control");
        st = control_gain_measure(result.get(), o.threads, err);
        clock.stop();
        if (st != MK_OK)
            return st;
    }
    result->seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    *out = *result;
    return MK_OK;
} catch (const std::bad_alloc &) {
    return mk_error_set(err, MK_ERR_NOMEM, "no memory to explain this much data");
}
