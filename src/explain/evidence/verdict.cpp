// Verdict, evidence of each cause, and rivals (explain/evidence/verdict.hpp).
//
// With L the penalised nlml (explain/search/search.cpp) and nlml the same without its penalty, a
// cause has
//     gain       = L(without it) - L(best) ,                 delta BIC = 2 gain ,
//     raw        = nlml(without it) - nlml(best) ,
//     p          = P(chi-square_k > 2 raw) times the number of candidates tried ,
// k its fitted parameters: the likelihood ratio test (S. Wilks 1938), corrected after Bonferroni,
// and
//     confidence = 0.99 / (1 + exp(-a)) ,   a = min(gain, L(best rival) - L(cause)) ,
// the posterior probability of the better of two hypotheses with equal priors, 0.99 at most.
//
// Standard errors are those of the last fit, all base parameters fitted along.
#include "explain/evidence/verdict.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "explain/evidence/statistics.hpp"
#include "explain/policy.hpp"
#include "explain/report/structure.hpp"

namespace mk
{

namespace
{
// A standard error or figure that does not exist.
constexpr double UNKNOWN = std::numeric_limits<double>::quiet_NaN();

// 1 / (1 + exp(-ahead)) is the probability of the better of two hypotheses by log likelihood.
// However far ahead, one cause in a hundred of those hidden in generated data was something else,
// since no hypothesis was right: policy::LAPSE.
double confidence_of(double ahead)
{
    return (1.0 - policy::LAPSE) / (1.0 + std::exp(-ahead));
}
} // namespace

void Verdict::decide()
{
    out.given = model;
    out.refit = last.refit.point.model;
    out.extended = last.best.point.model;
    out.process_noise_refit = last.refit.process_noise;
    out.process_noise_extended = last.best.process_noise;
    out.gain_refit = 0.5 * distance_of_given();
    out.gain_extended = causes.refit.quadratic.nlml - causes.best.quadratic.nlml;
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        out.noise[j] = j < mk_model_joints(&model) ? causes.noise(j) : UNKNOWN;
    // none or parameters: no cause, and the data are followed. effect: named causes explain them,
    // each surely there. partial: causes carry over, and a rest stays. unknown: neither.
    if (causes.rounds.empty() && causes.explained() && correction.joint == 0)
        out.verdict = values_off() ? MK_VERDICT_PARAMETERS : MK_VERDICT_NONE;
    else if ((correction.joint > 0 || !causes.rounds.empty()) && causes.explained() &&
             established())
        out.verdict = MK_VERDICT_EFFECT;
    else if (carries_over())
        out.verdict = MK_VERDICT_PARTIAL;
    else
        out.verdict = MK_VERDICT_UNKNOWN;
    describe_causes();
    add_missed_counts();
    find_pieces();
    if (out.verdict == MK_VERDICT_PARTIAL && out.piece_count == out.cause_count)
        out.verdict = MK_VERDICT_UNKNOWN;
    describe_rivals();
    if (out.verdict >= MK_VERDICT_PARTIAL)
        set_structure();
}

// A law of friction with a name, beside others of its joint that have none. Where it would be
// another one without one of these, they are pieces of a law that the catalogue lacks: with s its
// size as it is and s' as the fit without the nameless one has it, it stands by itself if
//     |s' - s| <= policy::SAME_SIZE |s| .
bool Verdict::hangs_on_what_has_no_name(const mk_cause &c) const
{
    const auto size_in = [&](const mk_model &m, int size) {
        for (int e = model.effect_count; e < m.effect_count; e++)
            if (mk_effect(m.effect[e].index) == c.effect && m.effect[e].joint == c.joint)
                return m.effect[e].value[size];
        return 0.0;
    };
    const auto chosen = [](const Round &r) -> const Candidate & { return r.ranked[0].added; };
    const auto own = std::find_if(causes.rounds.begin(), causes.rounds.end(), [&](const Round &r) {
        return chosen(r).effect == c.effect && chosen(r).joint == c.joint;
    });
    if (own == causes.rounds.end())
        return false;
    const int size = chosen(*own).size;
    const double now = size_in(causes.best.point.model, size);
    for (size_t i = 0; i < causes.rounds.size(); i++) {
        const Candidate &other = chosen(causes.rounds[i]);
        if (is_library(other.effect) && other.joint == c.joint &&
            is_friction(other.effect, other.value) &&
            !(std::fabs(size_in(causes.without(i).model, size) - now) <=
              policy::SAME_SIZE * std::fabs(now)))
            return true;
    }
    return false;
}

// Whether all that was found is two laws of friction at one joint, one of them without a name. One
// law that the catalogue lacks is the simpler reading of that: two of friction at one joint that
// share all there is, where one of them is nowhere written, are an odd coincidence.
bool Verdict::is_one_law_without_a_name() const
{
    if (causes.rounds.size() != 2 || correction.joint > 0)
        return false;
    const Candidate &a = causes.rounds[0].ranked[0].added, &b = causes.rounds[1].ranked[0].added;
    return a.joint == b.joint && is_library(a.effect) != is_library(b.effect) &&
           is_friction(a.effect, a.value) && is_friction(b.effect, b.value);
}

// What has no name, and what hangs on it where the data decided by likelihood. Not what predicts
// data that it was not fitted to by itself.
void Verdict::find_pieces()
{
    const bool asked = out.verdict == MK_VERDICT_PARTIAL && causes.carried.empty(),
               one_law = asked && is_one_law_without_a_name();
    for (int i = 0; i < out.cause_count; i++) {
        mk_cause &c = out.cause[i];
        c.piece = one_law || is_library(c.effect) ||
                  (asked && is_friction(c.effect, c.value) && hangs_on_what_has_no_name(c));
    }
    sort_causes();
}

// Whether pulses were surely lost, or there is a cause with a name, and all predict data that they
// were not fitted to, or together follow those that they were without cancelling each other.
bool Verdict::carries_over() const
{
    if (correction.sure)
        return true;
    return !causes.rounds.empty() &&
           (causes.carried.size() == causes.rounds.size() ||
            (causes.follows(causes.best) && established())) &&
           std::any_of(causes.rounds.begin(), causes.rounds.end(),
                       [](const Round &r) { return !is_library(r.ranked[0].added.effect); });
}

// d'H d, d the given values less the estimate in scaled units and H the information of the refit:
// chi-square distributed with as many degrees of freedom as parameters if the given values are
// right.
double Verdict::distance_of_given() const
{
    std::vector<int> free = fitted_parameters(last.refit.point.model);
    Eigen::VectorXd off((long)free.size());
    for (long i = 0; i < off.size(); i++)
        off(i) = (mk_model_parameter(&model, free[(size_t)i]) -
                  mk_model_parameter(&last.refit.point.model, free[(size_t)i])) /
                 Fit::scale_of(last.refit.point.model, free[(size_t)i]);
    return off.dot(last.refit.quadratic.information * off);
}

bool beyond_chance(double distance2, int free_count)
{
    // Probability of a false alarm.
    return chi2_tail(distance2, free_count) < policy::BY_CHANCE;
}

bool Verdict::values_off() const
{
    return out.refit.friction_sharpness != model.friction_sharpness ||
           beyond_chance(distance_of_given(), last.refit.free_count);
}

void Verdict::set_structure()
{
    snprintf(out.structure, sizeof out.structure, "%s",
             describe_structure(out, *mk_plant(model.plant)).c_str());
    out.partly_named = out.cause_count > 0;
    for (int i = 0; i < out.cause_count; i++)
        out.partly_named = out.partly_named && !is_library(out.cause[i].effect);
}

// Of all parameters of a hypothesis; NaN for those that were not fitted.
std::vector<double> Verdict::standard_errors(const Hypothesis &h)
{
    std::vector<int> free = fitted_parameters(h.point.model);
    Eigen::MatrixXd cov = Fit::covariance(h.point.model, h.quadratic, free);
    std::vector<double> error((size_t)mk_model_parameter_count(&h.point.model), UNKNOWN);
    for (size_t i = 0; i < free.size(); i++)
        error[(size_t)free[i]] = std::sqrt(std::max(cov((long)i, (long)i), 0.0));
    return error;
}

static bool is_wave(const mk_effect_info &info)
{
    return std::any_of(info.parameter, info.parameter + info.parameter_count,
                       [](const mk_parameter_info &p) { return p.fit == MK_FIT_ANGLE; });
}

// Whether no other cause of its joint is a wave that repeats as often: then none of them cancels it
// for a part.
bool Verdict::is_lone_wave(int effect) const
{
    const mk_model &m = last.best.point.model;
    const auto cycles = [](const mk_effect_use &use) {
        return cycles_a_turn(*mk_effect(use.index), use.value);
    };
    const mk_effect_use &own = m.effect[effect];
    return is_wave(*mk_effect(own.index)) &&
           std::count_if(m.effect + model.effect_count, m.effect + m.effect_count,
                         [&](const mk_effect_use &use) {
                             return use.joint == own.joint && is_wave(*mk_effect(use.index)) &&
                                    cycles(use) == cycles(own);
                         }) == 1;
}

// Every cause's size is policy::ESTABLISHED standard errors from 0. Laws that nearly cancel have
// large errors: together they make up a shape that none of them has.
bool Verdict::established() const
{
    const mk_model &m = last.best.point.model;
    int first = mk_plant(m.plant)->parameter_count;
    for (int e = 0; e < m.effect_count; e++) {
        const mk_effect_info &info = *mk_effect(m.effect[e].index);
        const int cause = e - model.effect_count;
        if (cause >= 0 && cause < (int)causes.rounds.size()) {
            const int size = causes.rounds[(size_t)cause].ranked[0].added.size;
            // A size without an error (not fitted) passes.
            const double error = error_of_size(first, info, size, is_lone_wave(e));
            if (std::fabs(m.effect[e].value[size]) < policy::ESTABLISHED * error)
                return false;
        }
        first += info.parameter_count;
    }
    return true;
}

// Standard error of an effect's size: the root of the diagonal of the inverse information, of the
// rows and columns that are kept. Rows left out are parameters held:
//     those of the effect's own shape, unless the law is linear in them and the size (phase,
//     centre) ;
//     base parameters, of a wave that none cancels (`alone`) .
// Which part of a lone wave a base parameter could take, as gravity's of an imbalance, does not
// matter: something of it is there. NaN where the size was not fitted.
double Verdict::error_of_size(int first, const mk_effect_info &info, int size, bool alone) const
{
    const Hypothesis &h = last.best;
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
        else if (alone && free[i] < mk_plant(model.plant)->parameter_count)
            continue;
        kept.push_back(free[i]);
        place.push_back((int)i);
    }
    QuadraticModel quadratic;
    quadratic.information = h.quadratic.information(place, place);
    return at < 0 ? UNKNOWN : std::sqrt(Fit::covariance(h.point.model, quadratic, kept)(at, at));
}

void Verdict::describe_causes()
{
    const std::vector<double> error = standard_errors(last.best);
    int base = mk_plant(model.plant)->parameter_count, first = base;
    for (int i = 0; i < base; i++)
        out.std_error[i] = error[(size_t)i];
    for (int e = 0; e < last.best.point.model.effect_count; e++) {
        const mk_effect_use &use = last.best.point.model.effect[e];
        const mk_effect_info *info = mk_effect(use.index);
        int cause = e - model.effect_count;
        if (cause >= 0 && cause < MK_MAX_CAUSES && cause < (int)causes.rounds.size()) {
            mk_cause &c = out.cause[cause];
            c = {};
            c.effect = info;
            c.joint = use.joint;
            int fitted = 0;
            for (int k = 0; k < info->parameter_count; k++) {
                c.value[k] = use.value[k];
                c.spread[k] = use.spread[k];
                c.std_error[k] = error[(size_t)(first + k)];
                fitted += !std::isnan(c.std_error[k]);
            }
            weigh(cause, fitted, c);
            out.cause_count = cause + 1;
        }
        first += info->parameter_count;
    }
    sort_causes();
}

// By importance, pieces last.
void Verdict::sort_causes()
{
    std::stable_sort(out.cause, out.cause + out.cause_count,
                     [](const mk_cause &a, const mk_cause &b) {
                         return a.piece != b.piece ? b.piece : a.delta_bic > b.delta_bic;
                     });
    out.piece_count = (int)std::count_if(out.cause, out.cause + out.cause_count,
                                         [](const mk_cause &c) { return c.piece; });
}

void Verdict::weigh(int cause, int fitted, mk_cause &c)
{
    const Lack lack = causes.without((size_t)cause);
    // Rivals count by the distance to the chosen one when they competed, so with the same other
    // causes beside them.
    double gain = lack.penalised_nlml - causes.best.penalised_nlml,
           raw = lack.nlml - causes.best.quadratic.nlml;
    c.delta_bic = 2.0 * gain;
    double p = chi2_tail(2.0 * raw, std::max(fitted, 1));
    c.p_value = std::min(1.0, p * std::max(out.tried, 1));
    double rival = HUGE_VAL;
    const std::vector<Hypothesis> &ranked = causes.rounds[(size_t)cause].ranked;
    for (size_t i = 1; i < ranked.size(); i++)
        rival = std::min(rival, ranked[i].penalised_nlml - ranked[0].penalised_nlml);
    c.confidence = confidence_of(std::min(rival, gain));
}

void Verdict::add_missed_counts()
{
    if (correction.joint == 0 || out.cause_count >= MK_MAX_CAUSES)
        return;
    const double seconds = correction.seconds;
    const mk_effect_info *effect = mk_effect_by_name("missed-counts");
    mk_cause &c = out.cause[out.cause_count++];
    c = {};
    c.effect = effect;
    c.joint = correction.joint;
    c.value[0] = correction.step;
    // Rate of lost pulses, 1/s, a Poisson count: its standard error is the root of the count.
    c.value[1] = correction.count / seconds;
    c.std_error[0] = correction.std_error;
    c.std_error[1] = std::sqrt(correction.count) / seconds;
    c.delta_bic = 2.0 * correction.gain;
    c.p_value = 0.0;
    c.confidence = confidence_of(correction.gain);
    sort_causes();
    if (mk_model_add_effect(&out.extended, effect->name, correction.joint, nullptr) == MK_OK) {
        mk_effect_use &use = out.extended.effect[out.extended.effect_count - 1];
        use.value[0] = correction.step;
        use.value[1] = correction.count / seconds;
    }
}

// Causes are listed by importance, rounds in the order of the model.
int Verdict::place_of(const Candidate &chosen) const
{
    for (int i = 0; i < out.cause_count; i++)
        if (out.cause[i].effect == chosen.effect && out.cause[i].joint == chosen.joint)
            return i;
    return 0;
}

void Verdict::describe_rivals()
{
    struct Entry {
        mk_rival rival;
        double behind;
        const Hypothesis *fit;
    };
    std::vector<Entry> all;
    for (size_t r = 0; r < causes.rounds.size(); r++) {
        const std::vector<Hypothesis> &ranked = causes.rounds[r].ranked;
        for (size_t i = 1; i < ranked.size(); i++) {
            // Of a ranking from when there were fewer causes beside, none is comparable.
            if (ranked[i].point.model.effect_count != causes.best.point.model.effect_count)
                continue;
            // delta BIC of a rival is twice the log likelihood by which it is behind; within
            // policy::INSEPARABLE data cannot tell them apart.
            double behind = ranked[i].penalised_nlml - causes.best.penalised_nlml;
            if (is_library(ranked[i].added.effect) && out.verdict != MK_VERDICT_UNKNOWN &&
                behind > policy::INSEPARABLE)
                continue;
            const int cause = place_of(ranked[0].added);
            // Worse than nothing in the cause's place: its fit has not come to anything.
            if (cause < out.cause_count && 2.0 * behind >= out.cause[cause].delta_bic &&
                behind > policy::INSEPARABLE)
                continue;
            Entry e = {{ranked[i].added.effect, ranked[i].added.joint, cause, 2.0 * behind,
                        behind > policy::INSEPARABLE},
                       behind,
                       &ranked[i]};
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

void Verdict::describe_suspects()
{
    out.suspect_count = 0;
    if (out.verdict < MK_VERDICT_PARTIAL)
        return;
    std::vector<Asked> all = causes.suspects;
    // Surest first: mean over standard error, of the log ratios of data left out.
    std::stable_sort(all.begin(), all.end(), [](const Asked &a, const Asked &b) {
        return a.carried.mean / a.carried.error < b.carried.mean / b.carried.error;
    });
    for (const Asked &a : all) {
        const auto is_it = [&](const auto &c) {
            return c.effect == a.cause.effect && c.joint == a.cause.joint;
        };
        if (out.suspect_count == MK_MAX_SUSPECTS || a.carried.share < policy::SUSPECT_SHARE ||
            std::any_of(out.cause, out.cause + out.cause_count, is_it) ||
            std::any_of(out.log_value, out.log_value + out.log_value_count, is_it) ||
            std::any_of(out.suspect, out.suspect + out.suspect_count, is_it))
            continue;
        out.suspect[out.suspect_count++] = {a.cause.effect, a.cause.joint, a.carried.share,
                                            a.carried.folds, a.carried.better};
    }
}

void Verdict::add_data_causes()
{
    if (out.verdict < MK_VERDICT_EFFECT)
        out.verdict = MK_VERDICT_EFFECT;
    if (out.verdict != MK_VERDICT_UNKNOWN)
        return;
    out.verdict = MK_VERDICT_PARTIAL;
    for (int i = 0; i < out.cause_count; i++)
        out.cause[i].piece = true;
    out.piece_count = out.cause_count;
}

void Verdict::reject()
{
    out.extended = last.refit.point.model;
    std::vector<double> error = standard_errors(last.refit);
    std::copy(error.begin(), error.begin() + mk_plant(model.plant)->parameter_count, out.std_error);
    out.process_noise_extended = last.refit.process_noise;
    if (out.verdict == MK_VERDICT_PARTIAL) {
        out.verdict = MK_VERDICT_UNKNOWN;
        set_structure();
    }
    if (out.verdict != MK_VERDICT_EFFECT)
        return;
    if (CauseSearch::matters(causes.refit.process_noise)) {
        out.verdict = MK_VERDICT_UNKNOWN;
        set_structure();
        return;
    }
    out.verdict = values_off() ? MK_VERDICT_PARAMETERS : MK_VERDICT_NONE;
    out.cause_count = out.rival_count = 0;
}

} // namespace mk
