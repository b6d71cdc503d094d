// What differs from log to log, found before any cause (docs/explain.md).
//
// A rig is zeroed where friction left it hanging, a drive is warm or cold: one value for all logs
// cannot say that, and what the search would find in its place is a cause that is none. A parameter
// theta of a group gets a random effect,
//     theta_l = theta + b_l ,   b_l ~ N(0, spread^2) ,   l the log (ident/fit.hpp),
// and a group is accepted if three things agree:
//     gain     L(one value) - L(own values) >= policy::ACCEPT_FIRST ,
//     size     spread > policy::SPREAD_SIGNIFICANT times the largest standard error of a log's
//              value; or, of a model that is near its data, values that are apart by that many of
//              a log's distance from their average (their mean may be open),
//              and > policy::SPREAD_NO_SIZE of the usual one ,
//     predict  values from first halves of logs predict second halves surely better
//              (ident/held_out.hpp) ,
// L the penalised nlml (explain/search/search.cpp), both models fitted from the same point at the
// same process noise.
#include "explain/search/log_values.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "explain/evidence/statistics.hpp"
#include "explain/policy.hpp"
#include "explain/search/causes.hpp"
#include "ident/held_out.hpp"

namespace mk
{

namespace
{

// Parameters that are asked for together: an effect of the catalogue, at which joints, which of its
// parameters, and a spread to start from.
struct Group {
    const char *effect, *parameter;
    bool hanging_joints; // at each joint with a zero that matters; else at the motor's, or the rig
    double spread;       // in the parameter's unit
    double least;        // spread that has a physical size
};
constexpr Group groups[] = {
    {"encoder-offset", "offset", true, 0.02, policy::SPREAD_NO_SIZE * 0.02},
    {"torque-scale", "ratio", false, 0.05, policy::SPREAD_OF_A_GAIN},
};

// `joint` is 1-based; 0 of an effect of the rig.
bool has(const mk_model &m, const mk_effect_info *effect, int joint)
{
    for (int e = 0; e < m.effect_count; e++)
        if (mk_effect(m.effect[e].index) == effect && m.effect[e].joint == joint)
            return true;
    return false;
}

// The effects of a group that the model does not have yet: at each joint that hangs, or at
// the motor's.
std::vector<Candidate> members(const Group &group, const mk_model &model)
{
    std::vector<Candidate> all;
    const mk_effect_info *effect = mk_effect_by_name(group.effect);
    const mk_plant_info *plant = mk_plant(model.plant);
    if (!effect || !(effect->plants & (1u << model.plant)))
        return all;
    for (int joint = 1; joint <= plant->joints; joint++) {
        const bool rig = effect->joint_rule == MK_EFFECT_JOINT_NONE;
        const bool hangs = !plant->joint_is_wheel[joint - 1] && !plant->joint_is_level[joint - 1];
        if (group.hanging_joints ? !hangs : joint != plant->motor_joint + 1)
            continue;
        Candidate c = {};
        c.effect = effect;
        c.joint = rig ? 0 : joint;
        c.size = mk_effect_parameter_index(effect, group.parameter);
        c.spread = group.spread;
        if (c.size >= 0 && !has(model, effect, c.joint))
            all.push_back(c);
    }
    return all;
}

// The model with all of `added`, with a spread of their own (`own`: each log has its value) or
// without (one value for all logs). Values begin at 0, clamped to the parameter's range. False
// where they do not all fit in.
bool with_members(const mk_model &model, const std::vector<Candidate> &added, bool own,
                  mk_model &out)
{
    out = model;
    for (Candidate c : added) {
        const mk_model before = out;
        c.spread = own ? c.spread : 0.0;
        if (!with_candidate(before, c, out))
            return false;
    }
    return true;
}

// Which effect of a model the parameter with this number belongs to.
// Requires the number of an effect's parameter: numbers count the plant's parameters first, then
// those of the effects in order (mechkit/ident.h).
int effect_of(const mk_model &m, int number)
{
    int e = 0;
    number -= mk_plant(m.plant)->parameter_count;
    while (number >= mk_effect(m.effect[e].index)->parameter_count)
        number -= mk_effect(m.effect[e++].index)->parameter_count;
    return e;
}

// The least spread that has a physical size.
// That of its group, or SPREAD_NO_SIZE times the usual one at a place that is set by hand; 0 for
// any other effect.
double least_spread(const mk_effect_info *effect)
{
    for (const Group &group : groups)
        if (std::strcmp(group.effect, effect->name) == 0)
            return group.least;
    int parameter;
    double spread;
    return place_set_by_hand(effect, parameter, spread) ? policy::SPREAD_NO_SIZE * spread : 0.0;
}

// How far a parameter's values in the logs are from their average, rms with n - 1: the fitted
// spread is that from their mean, to which the data may add what all of them share.
double apart_from_average(const std::vector<OwnValue> &own, int number)
{
    double n = 0.0, sum = 0.0, squares = 0.0;
    for (const OwnValue &v : own)
        if (v.number == number)
            n += 1.0, sum += v.deviation;
    for (const OwnValue &v : own)
        if (v.number == number)
            squares += (v.deviation - sum / n) * (v.deviation - sum / n);
    return n > 1.0 ? std::sqrt(squares / (n - 1.0)) : 0.0;
}

} // namespace

// By effect of the model. An effect's error is the largest standard error of its values, so that
// one log that says little of its value counts against the whole. What is known only apart from
// what the values have in common counts where the model is near its data: of one that is far from
// them a gain of each log stands in for whatever goes with the amplitude (a saturation, a dead
// zone). All false where the quadratic model cannot be made.
std::vector<bool> differ(const std::vector<const FitLog *> &training, const Hypothesis &h,
                         const FitOptions &options)
{
    const mk_model &m = h.point.model;
    std::vector<bool> yes((size_t)m.effect_count, false);
    Fit fit(training, options);
    for (double &d : fit.options.process_noise)
        d = h.process_noise;
    const std::vector<int> free = fitted_parameters(m);
    // The fit's own values and their standard errors come with a quadratic model of the point
    // (Fit::own_values).
    const QuadraticModel quadratic = fit.quadratic(h.point, free);
    if (!quadratic.finite)
        return yes;
    const std::vector<OwnValue> own = fit.own_values(h.point, quadratic);
    std::vector<double> error(yes.size(), 0.0), apart_error(yes.size(), 0.0);
    for (const OwnValue &v : own) {
        const size_t e = (size_t)effect_of(m, v.number);
        error[e] = std::max(error[e], v.std_error);
        apart_error[e] = std::max(apart_error[e], v.apart_error);
    }
    for (const OwnValue &v : own) {
        const size_t e = (size_t)effect_of(m, v.number);
        const double least = least_spread(mk_effect(m.effect[e].index));
        const auto is_spread = [&](double by, double known_to) {
            return by > least && by > policy::SPREAD_SIGNIFICANT * known_to;
        };
        yes[e] = is_spread(mk_model_parameter_spread(&m, v.number), error[e]) ||
                 (h.process_noise <= policy::FAR_FROM_DATA &&
                  is_spread(apart_from_average(own, v.number), apart_error[e]));
    }
    return yes;
}

bool with_own_place(const mk_model &model, mk_model &out)
{
    out = model;
    mk_effect_use &latest = out.effect[out.effect_count - 1];
    int parameter;
    double spread;
    if (!place_set_by_hand(mk_effect(latest.index), parameter, spread))
        return false;
    latest.spread[parameter] = spread;
    return true;
}

// Which of a model's effects differ. With its own values a model may need far less process noise
// than the one that it was compared with, and they are known by as much better: where one does not
// seem to differ, `own` is fitted there first.
static std::vector<bool> differ_at_best(Search &search, Hypothesis &own)
{
    const std::vector<bool> keep = differ(search.training(), own, search.usual_options());
    const std::vector<int> numbers = own_parameters(own.point.model);
    const bool all = std::all_of(numbers.begin(), numbers.end(), [&](int number) {
        return keep[(size_t)effect_of(own.point.model, number)];
    });
    Hypothesis nearer;
    if (all || !search.refit(own.point.model, &own, nearer) ||
        nearer.penalised_nlml >= own.penalised_nlml)
        return keep;
    own = std::move(nearer);
    return differ(search.training(), own, search.usual_options());
}

// Asks for values of their own in every log of `added`, beside what was found, and takes them into
// `out` where they predict second halves better. True where only some of them differ: `added` are
// those then.
// Three stages, cheapest first: the gain of both fits; which members differ, by their spreads and
// errors; free runs over second halves. A failed fit accepts nothing.
static bool ask_group(const mk_model &given, const HeldOut &halves, Search &search,
                      std::vector<Candidate> &added, LogValues &out)
{
    mk_model own_model, one_model;
    Hypothesis own, one;
    if (!with_members(out.fit.point.model, added, true, own_model) ||
        !with_members(out.fit.point.model, added, false, one_model) ||
        !search.refit_at(own_model, out.fit, out.fit.process_noise, own) ||
        !search.refit_at(one_model, out.fit, out.fit.process_noise, one))
        return false;
    // `one` has the same effects with one value for all logs, so that the gain is what the spread
    // adds.
    const double gain = one.penalised_nlml - own.penalised_nlml;
    if (gain < policy::ACCEPT_FIRST)
        return false;
    // The members are the last effects of the model, in the order of `added`.
    const std::vector<bool> keep = differ_at_best(search, own);
    const size_t first = keep.size() - added.size();
    std::vector<Candidate> fewer;
    for (size_t i = 0; i < added.size(); i++)
        if (keep[first + i])
            fewer.push_back(added[i]);
    if (fewer.size() < added.size()) {
        added = std::move(fewer);
        return true;
    }
    HeldOutFigures with, without;
    if (halves.figures(own.point.model, with, nullptr) != MK_OK ||
        halves.figures(one.point.model, without, nullptr) != MK_OK ||
        !surely_better(ratio_by_log(with, without)))
        return false;
    // The model to go on from has the group at its fitted values and the base parameters as given.
    out.model = own.point.model;
    std::copy_n(given.parameter, MK_MAX_PARAMETERS, out.model.parameter);
    out.model.friction_sharpness = given.friction_sharpness;
    out.fit = std::move(own);
    for (const Candidate &c : added)
        out.found.push_back({c.effect, c.joint, c.size, gain, c.spread});
    return false;
}

LogValues find_log_values(const mk_model &given, const std::vector<const mk_log *> &logs,
                          double window_s, Search &search, const Hypothesis &refit)
{
    LogValues out = {given, refit, {}};
    // Nothing is asked where the refitted model follows its data: then nothing differs that
    // matters.
    if (logs.size() < 2 || search.complete(refit) || !CauseSearch::matters(refit.process_noise))
        return out;
    // The logs as held out: own values from first halves, errors of second halves.
    const HeldOut halves(logs, window_s, true, search.settings().threads);
    for (const Group &group : groups) {
        // A later group is asked beside those that were accepted before it.
        std::vector<Candidate> added = members(group, out.model);
        // Members whose values do not differ leave the group; the others are asked once more
        // without them.
        while (!added.empty() && !search.cancelled && ask_group(given, halves, search, added, out))
            continue;
    }
    return out;
}

// A cause that is found later may be what made a value differ: `best` has both, fitted together.
std::vector<LogValue> that_still_differ(const LogValues &values, const Hypothesis &best,
                                        const std::vector<const FitLog *> &training,
                                        const FitOptions &options)
{
    const mk_model &m = best.point.model;
    const std::vector<bool> keep = differ(training, best, options);
    std::vector<LogValue> left;
    for (const LogValue &v : values.found)
        for (int e = 0; e < m.effect_count; e++)
            if (keep[(size_t)e] && mk_effect(m.effect[e].index) == v.effect &&
                m.effect[e].joint == v.joint)
                left.push_back(v);
    return left;
}

// Takes them as they are: none of the three conditions is asked. Where the fit fails nothing is
// found, and the result is that of the refitted model.
LogValues with_log_values(const mk_model &given, const std::vector<LogValue> &found, Search &search,
                          const Hypothesis &refit)
{
    LogValues out = {given, refit, {}};
    std::vector<Candidate> added;
    for (const LogValue &v : found) {
        Candidate c = {};
        c.effect = v.effect, c.joint = v.joint, c.size = v.parameter, c.spread = v.spread;
        added.push_back(c);
    }
    mk_model model;
    Hypothesis fit;
    if (added.empty() || !with_members(refit.point.model, added, true, model) ||
        !search.refit_at(model, refit, refit.process_noise, fit))
        return out;
    out.model = fit.point.model;
    std::copy_n(given.parameter, MK_MAX_PARAMETERS, out.model.parameter);
    out.model.friction_sharpness = given.friction_sharpness;
    out.fit = std::move(fit);
    out.found = found;
    return out;
}

std::vector<LogValue> usual_log_values(const mk_model &model)
{
    std::vector<LogValue> all;
    for (const Group &group : groups)
        if (group.hanging_joints)
            for (const Candidate &c : members(group, model))
                all.push_back({c.effect, c.joint, c.size, 0.0, c.spread});
    return all;
}

// How far dry friction can hold a joint from where it hangs. With G_j(q) the joint's torque at
// rest, its stiffness is
//     K = (G_j(q0 + h) - G_j(q0 - h)) / (2 h) ,
// about the rest q0, by central differences; friction of level F balances it up to F / K. NaN where
// gravity does not pull the joint back (K <= 0).
static double held_off(const mk_model &m, int joint)
{
    // h, rad.
    constexpr double SIDE = 1e-4;
    const mk_plant_info *plant = mk_plant(m.plant);
    double q[MK_MAX_JOINTS], still[MK_MAX_JOINTS] = {0.0, 0.0}, a[MK_MAX_JOINTS] = {},
                             b[MK_MAX_JOINTS] = {};
    std::copy_n(plant->rest, MK_MAX_JOINTS, q);
    q[joint] += SIDE;
    mk_plant_inverse_dynamics(&m, q, still, still, a);
    q[joint] -= 2.0 * SIDE;
    mk_plant_inverse_dynamics(&m, q, still, still, b);
    // Inverse dynamics at rest give the torque that holds the rig there, G_j(q). K is in N m/rad,
    // or N/m of a joint that slides.
    const double stiffness = (a[joint] - b[joint]) / (2.0 * SIDE);
    // F: Coulomb friction of the plant's motor joint, and the levels of dry
    // friction among the effects.
    double friction = joint == plant->motor_joint ? m.parameter[plant->mass_count + 1] : 0.0;
    for (int e = 0; e < m.effect_count; e++) {
        const mk_effect_info *info = mk_effect(m.effect[e].index);
        if (info->holds_still && m.effect[e].joint == joint + 1)
            friction += m.effect[e].value[mk_effect_parameter_index(info, "level")];
    }
    return stiffness > 1e-9 ? friction / stiffness : std::nan("");
}

// What was found to differ from log to log as it is told: the common value, the spread, and the
// evidence for the spread. `std_error`: of the effect's parameters.
static mk_cause as_cause(const LogValue &found, const mk_effect_use &use, const double *std_error)
{
    mk_cause c = {};
    c.effect = found.effect, c.joint = found.joint;
    for (int k = 0; k < found.effect->parameter_count; k++) {
        c.value[k] = use.value[k];
        c.spread[k] = use.spread[k];
        c.std_error[k] = std_error[k];
    }
    // delta BIC = 2 gain; p: chi-square of one degree of freedom, of 2 gain; confidence as in
    // verdict.cpp, nothing being the rival.
    c.delta_bic = 2.0 * found.gain;
    c.p_value = chi2_tail(2.0 * found.gain, 1);
    c.confidence = 0.99 / (1.0 + std::exp(-found.gain));
    return c;
}

// What each log has of its own of an effect whose parameters have the numbers from `first` on.
// Where the data leave open what the logs have in common, by more than they are apart, the error is
// that of how far the log is from the others.
static void add_own_values(const std::vector<OwnValue> &own, const mk_effect_use &use, int first,
                           mk_explanation &out)
{
    const mk_effect_info *info = mk_effect(use.index);
    for (const OwnValue &o : own) {
        const bool its = o.number >= first && o.number < first + info->parameter_count;
        if (!its || out.per_log_count == MK_MAX_PER_LOG)
            continue;
        const int parameter = o.number - first;
        const bool open = o.std_error > use.spread[parameter];
        out.per_log[out.per_log_count++] = {o.source,  info,    use.joint,
                                            parameter, o.value, open ? o.apart_error : o.std_error,
                                            open};
    }
}

void describe_log_values(const LogValues &values, const Hypothesis &best,
                         const std::vector<const FitLog *> &training, int threads,
                         mk_explanation &out)
{
    const mk_model &m = best.point.model;
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        out.held_off[j] = j < mk_model_joints(&m) ? held_off(m, j) : std::nan("");
    if (own_parameters(m).empty())
        return;
    FitOptions options;
    options.threads = threads;
    Fit fit(training, options);
    for (double &d : fit.options.process_noise)
        d = best.process_noise;
    const std::vector<int> free = fitted_parameters(m);
    // Covariance and own values are those of a quadratic model of the point, at the process noise
    // that it was fitted with; nothing is fitted here.
    const QuadraticModel quadratic = fit.quadratic(best.point, free);
    if (!quadratic.finite)
        return;
    const Eigen::MatrixXd cov = Fit::covariance(m, quadratic, free);
    const std::vector<OwnValue> own = fit.own_values(best.point, quadratic);
    // Number of the first parameter of effect e. A parameter that is not fitted has no error: NaN.
    int number = mk_plant(m.plant)->parameter_count;
    for (int e = 0; e < m.effect_count; e++) {
        const mk_effect_info *info = mk_effect(m.effect[e].index);
        double std_error[MK_MAX_EFFECT_PARAMETERS] = {};
        for (int k = 0; k < info->parameter_count; k++) {
            const auto place = std::find(free.begin(), free.end(), number + k);
            const long at = place - free.begin();
            std_error[k] = place == free.end() ? std::nan("") : std::sqrt(cov(at, at));
        }
        for (const LogValue &v : values.found)
            if (v.effect == info && v.joint == m.effect[e].joint &&
                out.log_value_count < MK_MAX_LOG_VALUES)
                out.log_value[out.log_value_count++] = as_cause(v, m.effect[e], std_error);
        add_own_values(own, m.effect[e], number, out);
        number += info->parameter_count;
    }
}

} // namespace mk
