// From data to a verdict: refit, search, second and third causes, check on held-out data.
#include "mechkit/explain.h"

#include <algorithm>
#include <cctype>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <thread>

#include "explain/next_experiment.hpp"
#include "explain/owned_log.hpp"
#include "explain/search.hpp"
#include "explain/slips.hpp"
#include "model/effects_custom.hpp"

namespace mk
{

namespace
{

constexpr double ENOUGH = 12.0;     // log likelihood (after penalty) a cause must gain to be named
constexpr double AGAIN = 20.0;      // the same for a second cause and further ones
constexpr size_t FEWEST = 40;       // rows of a log
constexpr size_t MOST = 3;          // causes looked for
constexpr double CATALOGUE = 10.0;  // by how much a library term must beat the catalogue
constexpr double INSEPARABLE = 5.0; // log likelihood between rivals that data cannot tell apart
constexpr double IMMATERIAL = 2.0e-3; // drift that does not matter within a second of free run
constexpr double ROUGH = 2.0e-2;      // drift that contact may leave,
constexpr double SMALL_PART = 0.02;   // at most this share of the refitted model's
constexpr double UNKNOWN = std::numeric_limits<double>::quiet_NaN();

// Rows [first, last) of a log, with its metadata and the columns a model needs.
OwnedLog slice(const mk_log &log, size_t first, size_t last)
{
    mk_log *made = nullptr;
    if (mk_log_create(last - first, &made) != MK_OK)
        throw std::bad_alloc();
    OwnedLog out(made);
    for (size_t c = 0; c < log.column_count; c++) {
        if (!log.columns[c].data)
            continue;
        double *data = mk_log_add_column(made, log.columns[c].name);
        if (!data)
            throw std::bad_alloc();
        std::copy(log.columns[c].data + first, log.columns[c].data + last, data);
    }
    for (size_t m = 0; m < log.meta_count; m++)
        if (log.meta[m].key[0] &&
            mk_log_set_meta(made, log.meta[m].key, log.meta[m].value) == MK_ERR_NOMEM)
            throw std::bad_alloc();
    return out;
}

// Probability that chi-square with k degrees of freedom exceeds x.
double chi2_tail(double x, int k)
{
    if (x <= 0.0)
        return 1.0;
    // Series in steps of two degrees (Abramowitz, Stegun 26.4.4, 26.4.5).
    double half = 0.5 * x, sum = 0.0, term = k % 2 ? std::sqrt(x) : 1.0;
    for (int i = k % 2 ? 1 : 0; i < k - 1; i += 2) {
        sum += term;
        term *= x / (double)(i + 2);
    }
    if (k % 2)
        return std::erfc(std::sqrt(half)) +
               std::sqrt(2.0 / 3.14159265358979) * std::exp(-half) * sum;
    return std::exp(-half) * sum;
}

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
        enum mk_status st = load(logs, log_count, holdouts, holdout_count, err);
        if (st != MK_OK)
            return st;
        SearchOptions so;
        so.threads = options.threads;
        so.progress = options.progress;
        so.progress_context = options.progress_context;
        search = std::make_unique<Search>(training, so);
        if (!search->refit(model, nullptr, refit))
            return mk_error_set(
                err, search->cancelled ? MK_ERR_INTR : MK_ERR_NUMERIC,
                "the model cannot follow the data: are rig, units and signs right?");
        look_for_slips(so);
        find_causes();
        polish_rivals();
        if (search->cancelled)
            return mk_error_set(err, MK_ERR_INTR, "stopped");
        decide();
        find_pushes();
        enum mk_status measured = measure(err);
        if (measured == MK_OK)
            propose_experiment();
        return measured;
    }

  private:
    struct Round {
        std::vector<Hypothesis> field; // what competed for a place, best first
    };
    const mk_model &model;
    mk_explanation &out;
    mk_explain_options options;
    std::vector<FitLog> fit_logs;
    std::vector<const FitLog *> training;
    std::vector<OwnedLog> made;
    std::vector<const mk_log *> held;
    std::unique_ptr<Search> search;
    Hypothesis refit, best;
    std::vector<Round> rounds; // one a cause of `best`, in its order

    enum mk_status load(const mk_log *const *logs, size_t log_count, const mk_log *const *holdouts,
                        size_t holdout_count, mk_error *err)
    {
        held.assign(holdouts, holdouts + holdout_count);
        for (size_t i = 0; i < log_count; i++) {
            mk_record record;
            enum mk_status st = mk_record_from_log(logs[i], &model, &record, err);
            if (st != MK_OK)
                return st;
            size_t last = record.rows;
            if (record.rows < FEWEST)
                return mk_error_at(err, MK_ERR_RANGE, logs[i]->path, 0, 0,
                                   "%zu rows are too few to explain anything: %zu at least",
                                   record.rows, FEWEST);
            if (holdout_count == 0 && i + 1 == log_count) {
                last = record.rows - record.rows / 4;
                out.held_back = true;
                out.held_from = record.t[last] - record.t[0];
                made.push_back(slice(*logs[i], last, record.rows));
                held.push_back(made.back().get());
            }
            fit_logs.push_back(fit_log(record, model, 0, last));
            st = check_motion(fit_logs.back(), logs[i], err);
            if (st != MK_OK)
                return st;
        }
        for (const FitLog &log : fit_logs)
            training.push_back(&log);
        return MK_OK;
    }
    static enum mk_status check_motion(const FitLog &log, const mk_log *source, mk_error *err)
    {
        for (int j = 0; j < log.joints; j++) {
            double low = HUGE_VAL, high = -HUGE_VAL;
            for (double q : log.q[j])
                if (!std::isnan(q))
                    low = std::min(low, q), high = std::max(high, q);
            if (high - low >= 5.0 * log.count[j])
                return MK_OK;
        }
        return mk_error_at(err, MK_ERR_RANGE, source->path, 0, 0,
                           "nothing moves in this log: there is nothing to explain");
    }

    // Lost pulses would look like kicks to every model: if taking the steps back explains far more,
    // the search goes on without them.
    void look_for_slips(const SearchOptions &so)
    {
        for (int j = 0; j < mk_model_joints(&model); j++) {
            std::vector<Slip> slips = find_slips(training, j);
            if (slips.empty())
                continue;
            Mended best_so_far = mend(so, j, slips, std::fabs(slips[0].step));
            double bend = 0.0, side = 0.0;
            // The jumps alone do not tell the step to a fraction of a count; the fit does. A
            // parabola through three of them, twice: the second one about the best.
            for (int round = 0; round < 2; round++) {
                side = (round == 0 ? 0.6 : 0.2) * training[0]->count[j];
                Mended less = mend(so, j, slips, best_so_far.step - side);
                Mended more = mend(so, j, slips, best_so_far.step + side);
                bend = less.score() - 2.0 * best_so_far.score() + more.score();
                double shift =
                    bend > 0.0 ? 0.5 * side * (less.score() - more.score()) / bend : side;
                shift = std::min(std::max(shift, -2.0 * side), 2.0 * side);
                Mended there = mend(so, j, slips, best_so_far.step + shift);
                for (Mended *m : {&less, &more, &there})
                    if (m->score() < best_so_far.score())
                        best_so_far = std::move(*m);
            }
            double penalty = 0.5 * std::log(search->readings()) * (double)(slips.size() + 1);
            double gain = refit.score - best_so_far.score() - penalty;
            if (!(gain > ENOUGH))
                continue;
            slipped = {j + 1, best_so_far.step, bend > 0.0 ? side / std::sqrt(bend) : UNKNOWN,
                       (double)slips.size(), 2.0 * gain};
            fit_logs = std::move(best_so_far.logs);
            training.clear();
            for (const FitLog &log : fit_logs)
                training.push_back(&log);
            search = std::make_unique<Search>(training, so);
            if (search->refit(model, nullptr, best_so_far.fit))
                refit = best_so_far.fit;
            return;
        }
    }
    // The training data with lost pulses put back, and what a refit makes of them.
    struct Mended {
        double step = 0.0;
        std::vector<FitLog> logs;
        Hypothesis fit;
        bool fitted = false;
        double score() const { return fitted ? fit.score : HUGE_VAL; }
    };
    Mended mend(const SearchOptions &so, int joint, std::vector<Slip> slips, double step) const
    {
        Mended m;
        m.step = step;
        for (Slip &s : slips)
            s.step = std::copysign(step, s.step);
        std::vector<const FitLog *> views;
        for (size_t l = 0; l < training.size(); l++)
            m.logs.push_back(without_slips(*training[l], l, joint, slips));
        for (const FitLog &log : m.logs)
            views.push_back(&log);
        Search other(views, so);
        m.fitted = other.refit(model, nullptr, m.fit);
        return m;
    }
    struct {
        int joint;
        double step, std_error, count, delta_bic;
    } slipped = {0, 0.0, 0.0, 0.0, 0.0};

    void add_slips()
    {
        if (slipped.joint == 0 || out.cause_count >= MK_MAX_CAUSES)
            return;
        double seconds = 0.0;
        for (const FitLog *log : training)
            seconds += log->duration();
        const mk_effect_info *effect = mk_effect_by_name("missed-counts");
        mk_cause &c = out.cause[out.cause_count++];
        c = {};
        c.effect = effect;
        c.joint = slipped.joint;
        c.value[0] = slipped.step;
        c.value[1] = slipped.count / seconds;
        c.std_error[0] = slipped.std_error;
        c.std_error[1] = std::sqrt(slipped.count) / seconds;
        c.delta_bic = slipped.delta_bic;
        c.p_value = 0.0;
        c.confidence = 1.0 / (1.0 + std::exp(-0.5 * slipped.delta_bic));
        std::stable_sort(
            out.cause, out.cause + out.cause_count,
            [](const mk_cause &a, const mk_cause &b) { return a.delta_bic > b.delta_bic; });
        if (mk_model_add_effect(&out.extended, effect->name, c.joint, nullptr) == MK_OK) {
            mk_effect_use &use = out.extended.effect[out.extended.effect_count - 1];
            use.value[0] = slipped.step;
            use.value[1] = slipped.count / seconds;
        }
    }

    // --- causes ------------------------------------------------------------------------------

    // The first of a field, catalogue before library unless the library is clearly better.
    static size_t pick(const std::vector<Hypothesis> &field)
    {
        for (size_t i = 0; i < field.size(); i++)
            if (!is_library(field[i].added.effect))
                return field[i].score < field[0].score + CATALOGUE ? i : 0;
        return 0;
    }
    void find_causes()
    {
        search->polish(refit, true);
        best = refit;
        while (rounds.size() < MOST && !search->cancelled) {
            // Nameless terms that already follow the data will not become a name.
            bool nameless = std::any_of(rounds.begin(), rounds.end(), [](const Round &r) {
                return is_library(r.field[0].added.effect);
            });
            if (nameless && follows(best))
                return;
            // On top of a play every trial is slow, and little is left that is not the play's own.
            if (mk_model_hides_joint(&best.point.model) && !rounds.empty())
                return;
            Round round;
            double needed = rounds.empty() ? ENOUGH : AGAIN;
            round.field = search->extend(best, nullptr, !follows(best));
            // If something little is there, what is slow to fit may be it as well.
            if (follows(best) && !round.field.empty() && round.field[0].score < best.score - needed)
                round.field = search->extend(best, nullptr, true);
            out.tried = std::max(out.tried, search->tried());
            if (round.field.empty())
                return;
            size_t chosen = pick(round.field);
            // A nameless term on top of named causes that already follow the data names nothing.
            bool idle =
                !rounds.empty() && follows(best) && is_library(round.field[chosen].added.effect);
            if (idle || round.field[chosen].score > best.score - needed)
                return;
            std::swap(round.field[0], round.field[chosen]);
            search->polish(round.field[0], true);
            const Hypothesis before = best;
            best = round.field[0];
            rounds.push_back(std::move(round));
            if (rounds.size() > 1 && idle_without_last(before))
                return;
            if (rounds.size() == 2)
                reconsider();
        }
    }
    // Whether the causes so far do as well without the latest one once they are given its fit to
    // start from: then it is dropped.
    bool idle_without_last(const Hypothesis &before)
    {
        Hypothesis without;
        if (!remove(rounds.size() - 1, without))
            return false;
        search->polish(without, true);
        if (without.score - best.score >= AGAIN)
            return false;
        best = without.score < before.score ? without : before;
        best.added = before.added;
        rounds.pop_back();
        return true;
    }
    // What a model that follows its data leaves does not matter within a second of free run.
    // Contact leaves a little more, by the instants at which a simulation or a rig touches.
    bool follows(const Hypothesis &h) const
    {
        bool touches = mk_model_event_count(&h.point.model) > mk_model_event_count(&model);
        double rough = mk_model_hides_joint(&h.point.model) ? 5.0 * ROUGH : ROUGH;
        double most = touches ? std::min(rough, SMALL_PART * refit.drift) : 0.0;
        return h.drift <= std::max(IMMATERIAL, most);
    }
    // An earlier choice was made while another cause was still missing: would something else be
    // better in its place now, or nothing?
    void reconsider()
    {
        for (size_t i = 0; i + 1 < rounds.size(); i++) {
            Hypothesis without;
            if (!remove(i, without))
                continue;
            std::vector<Candidate> others;
            for (const Round &r : rounds)
                for (const Hypothesis &h : r.field)
                    others.push_back(h.added);
            std::vector<Hypothesis> field = search->extend(without, &others, true);
            if (field.empty())
                continue;
            size_t chosen = pick(field);
            std::swap(field[0], field[chosen]);
            search->polish(field[0], true);
            if (without.score < field[0].score + ENOUGH && without.score < best.score + ENOUGH) {
                best = without; // not needed any more
                rounds.erase(rounds.begin() + (std::ptrdiff_t)i);
                i--;
                continue;
            }
            bool better = field[0].score < best.score - 1e-6;
            if (better) {
                // The new one sits last in the model; rounds follow the model's order.
                best = field[0];
                rounds.erase(rounds.begin() + (std::ptrdiff_t)i);
                rounds.push_back({std::move(field)});
            } else {
                rounds[i].field = std::move(field);
            }
        }
    }
    bool remove(size_t cause, Hypothesis &without)
    {
        mk_model m = best.point.model;
        int at = model.effect_count + (int)cause;
        for (int e = at; e + 1 < m.effect_count; e++)
            m.effect[e] = m.effect[e + 1];
        m.effect_count--;
        return search->refit(m, &best, without);
    }

    // Rivals near the best get the same care as the best before they are compared.
    void polish_rivals()
    {
        constexpr double NEAR = 25.0;
        for (Round &r : rounds) {
            for (size_t i = 1; i < r.field.size() && i <= 3; i++)
                if (r.field[i].score < r.field[0].score + NEAR)
                    search->polish(r.field[i], false);
            std::stable_sort(
                r.field.begin() + 1, r.field.end(),
                [](const Hypothesis &a, const Hypothesis &b) { return a.score < b.score; });
        }
        if (rounds.size() == 1 && rounds[0].field.size() > 1 &&
            !is_library(rounds[0].field[1].added.effect) &&
            rounds[0].field[1].score < rounds[0].field[0].score) {
            std::swap(rounds[0].field[0], rounds[0].field[1]);
            best = rounds[0].field[0];
        }
    }

    // --- verdict -----------------------------------------------------------------------------

    void decide()
    {
        out.given = model;
        out.refit = refit.point.model;
        out.extended = best.point.model;
        out.drift_refit = refit.drift;
        out.drift_extended = best.drift;
        out.gain_refit = 0.5 * distance_of_given();
        out.gain_extended = refit.picture.evidence - best.picture.evidence;
        for (int j = 0; j < MK_MAX_JOINTS; j++)
            out.noise[j] = best.point.noise[j];
        bool library = false;
        for (const Round &r : rounds)
            library = library || is_library(r.field[0].added.effect);
        bool faithful = follows(best);
        if (rounds.empty() && faithful && slipped.joint == 0)
            out.verdict = values_off() ? MK_VERDICT_PARAMETERS : MK_VERDICT_NONE;
        else if ((slipped.joint > 0 || !rounds.empty()) && !library && faithful)
            out.verdict = MK_VERDICT_EFFECT;
        else
            out.verdict = MK_VERDICT_UNKNOWN;
        describe_causes();
        add_slips();
        describe_rivals();
        if (out.verdict == MK_VERDICT_UNKNOWN)
            describe_structure();
    }
    // How far the given values are from the estimate, in its own covariance: chi-square distributed
    // if they are right.
    double distance_of_given() const
    {
        std::vector<int> free = fitted_parameters(refit.point.model);
        Eigen::VectorXd off((long)free.size());
        for (long i = 0; i < off.size(); i++)
            off(i) = (mk_model_parameter(&model, free[(size_t)i]) -
                      mk_model_parameter(&refit.point.model, free[(size_t)i])) /
                     Fit::scale_of(refit.point.model, free[(size_t)i]);
        return off.dot(refit.picture.information * off);
    }
    bool values_off() const { return chi2_tail(distance_of_given(), refit.free_count) < 1e-4; }
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
    void describe_causes()
    {
        const std::vector<double> error = standard_errors(best);
        int base = mk_plant(model.plant)->parameter_count, first = base;
        for (int i = 0; i < base; i++)
            out.std_error[i] = error[(size_t)i];
        for (int e = 0; e < best.point.model.effect_count; e++) {
            const mk_effect_use &use = best.point.model.effect[e];
            const mk_effect_info *info = mk_effect(use.index);
            int cause = e - model.effect_count;
            if (cause >= 0 && cause < MK_MAX_CAUSES && cause < (int)rounds.size()) {
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
        Hypothesis without;
        double lost = refit.score - best.score,
               raw = refit.picture.evidence - best.picture.evidence;
        if (rounds.size() > 1 && remove((size_t)cause, without)) {
            lost = without.score - best.score;
            raw = without.picture.evidence - best.picture.evidence;
        }
        c.delta_bic = 2.0 * lost;
        double p = chi2_tail(2.0 * raw, std::max(fitted, 1));
        c.p_value = std::min(1.0, p * std::max(out.tried, 1));
        double rival = HUGE_VAL;
        const std::vector<Hypothesis> &field = rounds[(size_t)cause].field;
        for (size_t i = 1; i < field.size(); i++)
            rival = std::min(rival, field[i].score - field[0].score);
        c.confidence = 1.0 / (1.0 + std::exp(-std::min(rival, lost)));
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
        for (size_t r = 0; r < rounds.size(); r++) {
            const std::vector<Hypothesis> &field = rounds[r].field;
            for (size_t i = 1; i < field.size(); i++) {
                double behind = field[i].score - field[0].score;
                if (is_library(field[i].added.effect) && out.verdict != MK_VERDICT_UNKNOWN)
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
        for (const Entry &e : all)
            if (out.rival_count < MK_MAX_RIVALS) {
                rival_fit[out.rival_count] = e.fit;
                out.rival[out.rival_count++] = e.rival;
            }
    }
    const Hypothesis *rival_fit[MK_MAX_RIVALS] = {};

    // --- the next experiment -----------------------------------------------------------------

    static std::string place(const mk_effect_info &effect, int joint)
    {
        return effect.name + (joint > 0 ? " at joint " + std::to_string(joint) : std::string());
    }
    ExperimentLimits limits() const
    {
        ExperimentLimits l = {};
        DataRange range = data_range(model, training);
        l.u_max = std::min(model.u_max, std::max(range.u_max, 0.3 * model.u_max));
        for (int j = 0; j < mk_model_joints(&model); j++) {
            double rest = mk_plant(model.plant)->rest[j];
            double reach = 1.3 * std::max(range.q_max[j] - rest, rest - range.q_min[j]);
            l.q_min[j] = rest - reach;
            l.q_max[j] = rest + reach;
            l.v_max[j] = 1.5 * range.v_max[j];
        }
        l.period = training[0]->period;
        return l;
    }
    // For the nearest rival that the data leave open, or the nearest of all if asked for.
    void propose_experiment()
    {
        out.next.rival = -1;
        for (int i = 0; i < out.rival_count && out.next.rival < 0; i++) {
            bool comparable = rival_fit[i] && rival_fit[i]->point.model.effect_count ==
                                                  best.point.model.effect_count;
            if (comparable && (options.next || !out.rival[i].distinguishable))
                out.next.rival = i;
        }
        if (out.next.rival < 0 || out.verdict != MK_VERDICT_EFFECT)
            return;
        const mk_rival &rival = out.rival[out.next.rival];
        const mk_cause &cause = out.cause[rival.instead_of];
        Experiment e = most_telling(best, *rival_fit[out.next.rival], limits());
        out.next.odds = e.odds;
        std::string either =
            place(*cause.effect, cause.joint) + " or " + place(*rival.effect, rival.joint);
        constexpr double TELLING = 3.0; // twenty to one
        if (e.odds < TELLING) {
            snprintf(
                out.next.why, sizeof out.next.why,
                "%s: no input within the limits of these logs is expected to tell; look at the "
                "rig itself",
                either.c_str());
            return;
        }
        out.next.seconds = e.seconds;
        snprintf(out.next.input, sizeof out.next.input, "%s", e.input.c_str());
        // Far apart the estimate, linear in the parameters, is no more than an order of magnitude.
        char odds[32];
        if (e.odds > 1000.0)
            snprintf(odds, sizeof odds, "more than 1000");
        else
            snprintf(odds, sizeof odds, "%.2g", e.odds);
        snprintf(out.next.why, sizeof out.next.why,
                 "%s: %g s of %s from rest are expected to favour the right one by %s in log "
                 "likelihood (next.cmd)",
                 either.c_str(), e.seconds, e.input.c_str(), odds);
    }
    void describe_structure();

    // --- what pushes the rig -----------------------------------------------------------------

    // The model with the final base parameters but without the causes follows the data only if it
    // is pushed between short stretches: by this torque, spread over the stretch.
    void find_pushes()
    {
        FitOptions o;
        o.threads = options.threads;
        o.stretch = 0.06;
        o.max_iterations = 8;
        for (double &d : o.drift)
            d = std::max(refit.drift, 1.0);
        mk_model bare = best.point.model;
        bare.effect_count = model.effect_count;
        Fit fit(training, o);
        FitPoint point = fit.start(bare);
        std::copy(std::begin(best.point.noise), std::end(best.point.noise),
                  std::begin(point.noise));
        if (!fit.minimise(point, {}))
            return;
        FitResiduals r = fit.residuals(point);
        int n = mk_model_joints(&model);
        size_t total = 0, index = 0;
        for (const FitNodes &nodes : point.nodes)
            total += nodes.row.size();
        size_t skip = total / MK_MAX_PUSHES + 1;
        double squares[MK_MAX_JOINTS] = {0.0, 0.0};
        for (size_t l = 0; l < training.size(); l++) {
            const FitNodes &nodes = point.nodes[l];
            for (size_t i = 1; i < nodes.row.size(); i++) {
                double span = training[l]->t[nodes.row[i]] - training[l]->t[nodes.row[i - 1]];
                double mass[4], h[2], q[2] = {0.0, 0.0}, v[2] = {0.0, 0.0}, a[2] = {0.0, 0.0};
                for (int j = 0; j < n; j++) {
                    q[j] = 0.5 * (nodes.x(j, (long)i) + nodes.x(j, (long)i - 1));
                    v[j] = 0.5 * (nodes.x(n + j, (long)i) + nodes.x(n + j, (long)i - 1));
                    a[j] = r.jump[l](n + j, (long)i) / span;
                }
                mk_plant_mass(&bare, q, v, mass, h);
                mk_push push = {};
                push.t = training[l]->t[nodes.row[i]] - 0.5 * span;
                push.u = training[l]->u[0][(nodes.row[i] + nodes.row[i - 1]) / 2];
                for (int j = 0; j < n; j++) {
                    push.q[j] = q[j];
                    push.v[j] = v[j];
                    for (int k = 0; k < n; k++)
                        push.torque[j] += mass[j * n + k] * a[k];
                    squares[j] += push.torque[j] * push.torque[j];
                }
                if (index++ % skip == 0 && out.push_count < MK_MAX_PUSHES)
                    out.push[out.push_count++] = push;
            }
        }
        for (int j = 0; j < n; j++)
            out.missing[j] = std::sqrt(squares[j] / std::max<double>((double)index, 1.0));
    }

    // --- held-out data -----------------------------------------------------------------------

    struct Figures {
        double square[MK_MAX_JOINTS] = {0.0, 0.0};
        double rows = 0.0;
        std::vector<double> window; // squared error by window, over the variance of the readings
        double nrmse(int j) const { return std::sqrt(square[j] / std::max(rows, 1.0)); }
        double total() const { return (square[0] + square[1]) / std::max(rows, 1.0); }
    };
    enum mk_status figures_of(const mk_model &m, Figures &f, mk_error *err) const
    {
        for (const mk_log *log : held) {
            mk_predict_options o = {};
            o.window_s = out.window_s;
            mk_predict_figures figures = {};
            mk_log *prediction = nullptr;
            enum mk_status st = mk_predict(&m, log, &o, &prediction, &figures, nullptr, err);
            if (st == MK_OK)
                add_windows(m, *log, *prediction, f);
            mk_log_free(prediction);
            if (st != MK_OK)
                return st;
            for (int j = 0; j < mk_model_joints(&m); j++)
                if (std::isfinite(figures.nrmse[j]))
                    f.square[j] += figures.nrmse[j] * figures.nrmse[j] * (double)figures.rows;
            f.rows += (double)figures.rows;
        }
        return MK_OK;
    }
    void add_windows(const mk_model &m, const mk_log &log, const mk_log &prediction,
                     Figures &f) const
    {
        mk_record record;
        const double *window = mk_log_get(&prediction, "window");
        if (!window || mk_record_from_log(&log, &m, &record, nullptr) != MK_OK)
            return;
        const size_t first = f.window.size();
        for (int j = 0; j < mk_model_joints(&m); j++) {
            const double *q = mk_log_get(&prediction, j == 0 ? "q1" : "q2");
            double sd = deviation(j);
            for (size_t k = 0; q && sd > 0.0 && k < record.rows; k++) {
                double off = (q[k] - record.q[j][k]) / sd;
                size_t place = first + (size_t)window[k];
                if (place >= f.window.size())
                    f.window.resize(place + 1, 0.0);
                if (std::isfinite(off))
                    f.window[place] += off * off;
            }
        }
    }
    // Whether `a` predicts worse than `b` beyond chance: by the ratio of errors window by window,
    // so that a window from which nobody can predict does not decide.
    static bool clearly_worse(const Figures &a, const Figures &b)
    {
        double sum = 0.0, squares = 0.0, n = 0.0;
        for (size_t i = 0; i < std::min(a.window.size(), b.window.size()); i++) {
            if (!(a.window[i] > 0.0) || !(b.window[i] > 0.0))
                continue;
            double ratio = std::log(a.window[i] / b.window[i]);
            sum += ratio, squares += ratio * ratio, n += 1.0;
        }
        if (n < 2.0)
            return a.total() > b.total();
        double mean = sum / n, error = std::sqrt(std::max(squares / n - mean * mean, 0.0) / n);
        return mean > std::max(2.0 * error, std::log(1.02));
    }
    double deviation(int joint) const
    {
        double sum = 0.0, squares = 0.0, n = 0.0;
        for (const mk_log *log : held) {
            mk_record record;
            if (mk_record_from_log(log, &model, &record, nullptr) != MK_OK)
                continue;
            for (size_t k = 0; k < record.rows; k++) {
                double q = record.q[joint][k];
                if (std::isnan(q))
                    continue;
                sum += q, squares += q * q, n += 1.0;
            }
        }
        return n > 1.0 ? std::sqrt(std::max(squares / n - sum / n * (sum / n), 0.0)) : 0.0;
    }
    // What predicts held-out data worse than the refitted model is not offered, and no cause is
    // claimed: the formula, if any, stays as an observation.
    void withdraw()
    {
        out.extended = refit.point.model;
        std::vector<double> error = standard_errors(refit);
        std::copy(error.begin(), error.begin() + mk_plant(model.plant)->parameter_count,
                  out.std_error);
        out.drift_extended = refit.drift;
        if (out.verdict != MK_VERDICT_EFFECT)
            return;
        if (refit.drift > IMMATERIAL) {
            out.verdict = MK_VERDICT_UNKNOWN;
            describe_structure();
            return;
        }
        out.verdict = values_off() ? MK_VERDICT_PARAMETERS : MK_VERDICT_NONE;
        out.cause_count = out.rival_count = 0;
    }
    // Contact and play are hard to follow to the last digit of the training data; held-out data
    // that the named causes alone predict confirm them all the same.
    void confirm_contact()
    {
        constexpr double CONFIRMED = 0.9; // of what refitting leaves
        bool named = std::none_of(rounds.begin(), rounds.end(), [](const Round &r) {
            return is_library(r.field[0].added.effect);
        });
        bool touches = mk_model_event_count(&best.point.model) > mk_model_event_count(&model);
        if (out.verdict != MK_VERDICT_UNKNOWN || !named || !touches || !out.offered ||
            !(out.closed > CONFIRMED))
            return;
        out.verdict = MK_VERDICT_EFFECT;
        out.structure[0] = 0;
    }
    enum mk_status measure(mk_error *err)
    {
        Figures before, refitted, after;
        enum mk_status st = figures_of(model, before, err);
        if (st == MK_OK)
            st = figures_of(refit.point.model, refitted, err);
        if (st == MK_OK)
            st = figures_of(out.extended, after, err);
        if (st != MK_OK)
            return st;
        out.offered = out.cause_count > 0 && !clearly_worse(after, refitted);
        if (out.cause_count > 0 && !out.offered) {
            withdraw();
            after = refitted;
        }
        for (int i = 0; i < mk_plant(model.plant)->parameter_count; i++)
            out.extended.parameter_stderr[i] =
                std::isfinite(out.std_error[i]) ? out.std_error[i] : 0.0;
        if (out.verdict == MK_VERDICT_NONE) {
            out.extended = model;
            after = before;
        }
        double floor = 0.0;
        for (int j = 0; j < mk_model_joints(&model); j++) {
            double sd = deviation(j);
            out.before[j] = before.nrmse(j);
            out.refitted[j] = refitted.nrmse(j);
            out.after[j] = after.nrmse(j);
            out.floor[j] = sd > 0.0 ? out.noise[j] / sd : 0.0;
            floor += out.floor[j] * out.floor[j];
        }
        double room = refitted.total() - floor;
        out.closed = room > 0.0 ? 1.0 - (after.total() - floor) / room : 0.0;
        confirm_contact();
        return MK_OK;
    }
};

} // namespace

// --- the missing term as a formula ------------------------------------------------------------

// A library term with its joint's variables: 'v' and 'w' are the speeds of the joint and of the
// other, 'q' the angle (of `custom`: from rest), 'a' the sum of both angles.
static std::string with_variables(const char *text, int joint, double rest)
{
    std::string s;
    for (const char *c = text; *c; c++) {
        // A letter of a function's name is no variable.
        bool word =
            std::isalpha((unsigned char)c[1]) || (c != text && std::isalpha((unsigned char)c[-1]));
        if (word || !strchr("vwqa", *c)) {
            s += *c;
            continue;
        }
        char one[32];
        int other = 3 - joint;
        if (*c == 'a')
            snprintf(one, sizeof one, "(q1+q2)");
        else if (*c == 'q' && rest != 0.0)
            snprintf(one, sizeof one, "(q%d%+.5g)", joint, -rest);
        else
            snprintf(one, sizeof one, "%s%d", *c == 'q' ? "q" : "dq", *c == 'w' ? other : joint);
        s += one;
    }
    return s;
}

static std::string formula_of(const mk_cause &cause, const mk_plant_info &plant)
{
    const double *v = cause.value;
    const mk_effect_info &info = *cause.effect;
    int joint = cause.joint;
    char text[200];
    if (strcmp(info.name, "custom") == 0) {
        std::string term = with_variables(Custom::text((int)v[1]), joint, plant.rest[joint - 1]);
        snprintf(text, sizeof text, "%+.4g*%s", -v[0], term.c_str());
    } else if (strcmp(info.name, "custom-wave") == 0) {
        std::string term = with_variables(CustomWave::text((int)v[2]), joint, 0.0);
        if ((int)v[2] == CustomWave::IN_TIME)
            snprintf(text, sizeof text, "%+.4g*sin(2*pi*%.4g*t%+.3g)", -v[0], v[3], v[1]);
        else
            snprintf(text, sizeof text, "%+.4g*%s%+.3g)", -v[0], term.c_str(), v[1]);
    } else if (strcmp(info.name, "viscous") == 0) {
        snprintf(text, sizeof text, "%+.4g*dq%d", -v[0], joint);
    } else if (strcmp(info.name, "coulomb") == 0) {
        snprintf(text, sizeof text, "%+.4g*sign(dq%d)", -v[0], joint);
    } else if (strcmp(info.name, "quadratic-drag") == 0) {
        snprintf(text, sizeof text, "%+.4g*dq%d*abs(dq%d)", -v[0], joint, joint);
    } else {
        std::string values;
        for (int k = 0; k < info.parameter_count; k++) {
            char one[64];
            snprintf(one, sizeof one, "%s%s=%.4g", k ? ", " : "", info.parameter[k].name, v[k]);
            values += one;
        }
        return "+ " + std::string(info.name) + "(" + values + ")";
    }
    return text;
}

void Explainer::describe_structure()
{
    std::string all;
    for (int joint = 0; joint <= MK_MAX_JOINTS; joint++) {
        std::string terms;
        for (int i = 0; i < out.cause_count; i++)
            if (out.cause[i].joint == joint)
                terms +=
                    (terms.empty() ? "" : " ") + formula_of(out.cause[i], *mk_plant(model.plant));
        if (terms.empty())
            continue;
        if (!all.empty())
            all += "; ";
        all += joint > 0 ? "joint " + std::to_string(joint) + ": " + terms : terms;
    }
    if (all.empty())
        all = "no term of the library explains it";
    snprintf(out.structure, sizeof out.structure, "%s", all.c_str());
}

} // namespace mk

const char *mk_verdict_name(enum mk_verdict verdict)
{
    static const char *const names[] = {"none", "parameters", "effect", "unknown"};
    return names[verdict];
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
