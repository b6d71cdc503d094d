// Which experiment tells most next. An input is predicted by running the model under it; the square
// sensitivities of the readings to the parameters, over their noise, are the information that it
// gives (Fisher; V. Fedorov, Theory of Optimal Experiments, 1972). That of several experiments
// adds. Parameters that are not known well are counted by the logarithm of their standard errors,
// down to where knowing them better is of no use.
#include "investigate/plan.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "base/dense.hpp"
#include "base/random.h"
#include "ident/excite_cost.hpp"
#include "ident/fit.hpp"
#include "ident/information.hpp"
#include "mechkit/signal.h"

namespace mk
{

namespace
{

using Eigen::MatrixXd;
using Eigen::VectorXd;

// Relative standard errors below which nothing is gained by knowing more.
constexpr double KNOWN_BASE = 0.005, KNOWN_EFFECT = 0.03, KNOWN_SUSPECT = 0.3;
constexpr double PREDICTION_PRIOR = 30.0; // of predict_experiment(), relative
constexpr double SUSPECT_SHARE = 0.1;     // of the usual size of an effect, put into the model
constexpr double SEARCH_RATE_HZ = 200.0;
constexpr int RIGS = 2;             // around the model that must keep to the limits as well
constexpr double FIRST_SHARE = 0.6; // of the command's limit, while only a textbook model is there
constexpr int WEAKER = 3;           // times half of that, where no such input keeps to the limits
constexpr double TEST_SHARE = 0.5;  // of it, at least
constexpr double FIRST_PROCESS_NOISE = 1e-3; // a rig is far from its textbook

struct Form {
    const char *text, *kind; // of amplitude one
};
const Form forms[] = {
    {"multisine(0.2,12,1)", "many frequencies at once"},
    {"multisine(0.4,10,2)", "many frequencies at once"},
    {"multisine(0.1,6,3)", "many low frequencies"},
    {"chirp(0.3,4,10)", "a rising frequency"},
    {"chirp(0.1,1.5,10)", "a slowly rising frequency"},
    {"square(0.25)", "reversals, with time to settle between"},
    {"square(0.7)", "quick reversals"},
    {"sin(0.8*t)", "slow ramps both ways"},
    {"(step(0.2)-step(0.2+2)-step(5)+step(7))", "steps with rests between"},
    {"(pulse(0,0.4)-pulse(5,5.4))", "pushes, then free swings"},
    {"sin(3*t)", "a sine"},
    {"sin(6*t)", "a quick sine"},
};
constexpr double shares[] = {0.12, 0.25, 0.5, 1.0}; // of the command's limit

// Which of them show what goes with a thing, the best first.
struct Shows {
    const char *with;
    int form[4];
};
const Shows shows[] = {
    {"sign(d", {7, 5, 6, 10}}, // friction: slow, through zero speed
    {"d", {9, 3, 11, 0}},      // what grows with speed: free swings, quick motion
    {"u", {8, 5, 6, 0}},       // amplifier and delay: steps
    {"q", {7, 4, 2, 9}},       // of the place: slowly over all of it
    {"t", {10, 1, 9, 0}},      {"", {5, 7, 8, 9}},
};

struct Known {
    mk_model model;        // with suspects in it
    std::vector<int> free; // numbers of parameters
    std::vector<double> enough;
    std::vector<std::string> name;
    MatrixXd information; // of what was run, each parameter over its scale; prior included
};

std::string place(const mk_effect_info &effect, int joint)
{
    return effect.name + (joint > 0 ? " at joint " + std::to_string(joint) : std::string());
}

bool has(const mk_model &m, const mk_effect_info *effect, int joint)
{
    for (int e = 0; e < m.effect_count; e++)
        if (mk_effect(m.effect[e].index) == effect && m.effect[e].joint == joint)
            return true;
    return false;
}

// Puts a small one of it into the model; its size alone is asked for. A torque that vanishes with
// its first parameter: of other laws a little can be a great change (an end stop at hand).
void suspect(Known &k, const mk_effect_info *effect, int joint)
{
    mk_model with = k.model;
    if (!effect || effect->parameter_count == 0 || effect->stages != MK_STAGE_TORQUE ||
        !(effect->parameter[0].initial > 0.0) || has(k.model, effect, joint) ||
        mk_model_add_effect(&with, effect->name, joint, nullptr) != MK_OK)
        return;
    const int number = mk_model_parameter_count(&k.model);
    with.effect[with.effect_count - 1].value[0] *= SUSPECT_SHARE;
    if (mk_model_check(&with, nullptr) != MK_OK)
        return;
    k.model = with;
    k.free.push_back(number);
    k.enough.push_back(KNOWN_SUSPECT / SUSPECT_SHARE);
    k.name.push_back(place(*effect, joint));
}

Known describe(const plan_query &q)
{
    Known k = {*q.model, fitted_parameters(*q.model), {}, {}, {}};
    const int base = mk_plant(q.model->plant)->parameter_count;
    for (int number : k.free) {
        char name[64];
        mk_model_parameter_info(q.model, number, name, sizeof name);
        k.enough.push_back(number < base ? KNOWN_BASE : KNOWN_EFFECT);
        k.name.push_back(name);
    }
    const mk_plant_info *plant = mk_plant(q.model->plant);
    for (int i = 0; i < q.suspect_count; i++)
        suspect(k, q.suspect[i].effect, q.suspect[i].joint);
    for (int j = 0; j < plant->joints; j++) {
        if (j == plant->motor_joint) // its friction is the plant's own
            continue;
        suspect(k, mk_effect_by_name("coulomb"), j + 1);
        suspect(k, mk_effect_by_name("viscous"), j + 1);
    }
    return k;
}

using SignalPtr = std::unique_ptr<mk_signal, void (*)(mk_signal *)>;

std::vector<double> sampled(const char *input, double seconds, double rate, double u_max)
{
    mk_signal *made = nullptr;
    std::vector<double> u;
    if (mk_signal_create(input, &made, nullptr) != MK_OK)
        return u;
    SignalPtr signal(made, mk_signal_destroy);
    for (size_t i = 0; i < (size_t)std::lround(seconds * rate); i++) {
        double value = mk_signal_at(made, (double)i / rate);
        u.push_back(std::isfinite(value) ? std::min(std::max(value, -u_max), u_max) : 0.0);
    }
    return u;
}

class Planner
{
  public:
    explicit Planner(const plan_query &query)
        : q(query), rate(std::min(query.rate_hz, SEARCH_RATE_HZ)), known(describe(query))
    {
        for (int j = 0; j < MK_MAX_JOINTS; j++)
            readings.noise[j] = q.noise[j];
        readings.readings_a_row = q.rate_hz / rate;
        readings.process_noise = q.process_noise;
        draw_rigs();
        const long n = (long)known.free.size();
        known.information = MatrixXd::Identity(n, n);
        for (int i = 0; i < q.past_count; i++) {
            const PredictedExperiment f = see(known.model, q.past[i], q.past_s[i], known.free);
            if (f.finite())
                known.information += information_of(f);
        }
        before = covariance_of(known.information);
    }

    // Whether the model and those around it keep to the limits.
    bool keeps(const char *input, PredictedExperiment *own) const
    {
        mk_excite_options o;
        mk_excite_default(q.model, &o);
        std::copy(q.limits.q_min, q.limits.q_min + MK_MAX_JOINTS, o.q_min);
        std::copy(q.limits.q_max, q.limits.q_max + MK_MAX_JOINTS, o.q_max);
        std::copy(q.limits.v_max, q.limits.v_max + MK_MAX_JOINTS, o.v_max);
        for (const mk_model &rig : rigs) {
            const PredictedExperiment f = see(rig, input, q.seconds, fitted_parameters(rig));
            if (!f.finite() || beyond_limits(rig, o, extent_of(f)) > 0.0)
                return false;
        }
        if (own)
            *own = see(known.model, input, q.seconds, known.free);
        return !own || own->finite();
    }

    // Gain about what is not known well enough; `out` says about what most.
    double gain(const PredictedExperiment &f, plan &out) const
    {
        const VectorXd after = deviations(covariance_of(known.information + information_of(f)));
        const VectorXd now = deviations(before);
        double sum = 0.0, most = 0.0;
        for (long i = 0; i < now.size(); i++) {
            const double enough = known.enough[(size_t)i];
            const double less = std::log(std::max(now(i), enough) / std::max(after(i), enough));
            sum += less;
            if (less > most) {
                most = less;
                snprintf(out.about, sizeof out.about, "%s", known.name[(size_t)i].c_str());
                out.before = now(i);
                out.after = after(i);
            }
        }
        return sum;
    }

    // Half the logarithm of how much the volume of what is possible shrinks (D-optimality): the
    // more, the less sure the model was of these readings.
    double surprise(const PredictedExperiment &f) const
    {
        auto log_det = [](const MatrixXd &m) {
            const VectorXd d = dense::pivots(m).cwiseMax(1e-300);
            return d.array().log().sum();
        };
        return 0.5 * (log_det(known.information + information_of(f)) - log_det(known.information));
    }

    bool was_run(const char *input) const
    {
        for (int i = 0; i < q.past_count; i++)
            if (strcmp(q.past[i], input) == 0)
                return true;
        return false;
    }

    // An input of the family; rounded, so that the file says what was reckoned with.
    std::string input(const Form &form, double share) const
    {
        char text[128];
        const double size = std::round(100.0 * share * q.limits.u_max) / 100.0;
        snprintf(text, sizeof text, "%g*%s", size, form.text);
        return text;
    }

  private:
    const plan_query &q;
    double rate;
    Known known;
    MatrixXd before;
    std::vector<mk_model> rigs;
    InformationOptions readings = {};

    void draw_rigs()
    {
        rigs.assign(1, *q.model);
        mk_random random = {q.seed};
        for (int tries = 0; tries < 50 && q.spread > 0.0 && (int)rigs.size() <= RIGS; tries++) {
            mk_model rig = *q.model;
            for (int i = 0; i < mk_plant(rig.plant)->parameter_count; i++)
                rig.parameter[i] *= 1.0 + q.spread * (2.0 * mk_random_uniform(&random) - 1.0);
            if (mk_model_check(&rig, nullptr) == MK_OK)
                rigs.push_back(rig);
        }
    }

    PredictedExperiment see(const mk_model &m, const char *input, double seconds,
                            const std::vector<int> &free) const
    {
        const std::vector<double> u = sampled(input, seconds, rate, q.limits.u_max);
        return u.size() < 4 ? PredictedExperiment()
                            : predict_experiment(m, u, 1.0 / rate, free, readings);
    }

    static MatrixXd covariance_of(const MatrixXd &information)
    {
        const VectorXd root = information.diagonal().cwiseSqrt().cwiseInverse();
        const MatrixXd unit = root.asDiagonal() * information * root.asDiagonal();
        const MatrixXd one = MatrixXd::Identity(unit.rows(), unit.cols());
        const MatrixXd inverse = dense::solve_symmetric(unit, one);
        return root.asDiagonal() * inverse * root.asDiagonal();
    }

    static MatrixXd information_of(const PredictedExperiment &f)
    {
        const long n = f.covariance.rows();
        MatrixXd i = covariance_of(f.covariance);
        i.diagonal().array() -= 1.0 / (PREDICTION_PRIOR * PREDICTION_PRIOR);
        return 0.5 * (i + i.transpose()) + 1e-9 * MatrixXd::Identity(n, n);
    }

    static VectorXd deviations(const MatrixXd &covariance)
    {
        return covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
    }
};

// The best of the family by what `worth` says (0: not taken).
template <class Worth>
bool best_of_family(const Planner &p, double least_share, const Worth &worth, plan &out)
{
    double best = 0.0;
    for (const Form &form : forms)
        for (double share : shares) {
            if (share < least_share)
                continue;
            const std::string text = p.input(form, share);
            PredictedExperiment f;
            if (p.was_run(text.c_str()) || !p.keeps(text.c_str(), &f))
                continue;
            plan one = {};
            const double value = worth(f, one);
            if (!(value > best))
                continue;
            best = value;
            snprintf(one.input, sizeof one.input, "%s", text.c_str());
            snprintf(one.kind, sizeof one.kind, "%s", form.kind);
            out = one;
        }
    return best > 0.0;
}

const int *forms_for(const char *with)
{
    for (const Shows &s : shows)
        if (with && strncmp(with, s.with, strlen(s.with)) == 0)
            return s.form;
    return shows[std::size(shows) - 1].form;
}

} // namespace
} // namespace mk

bool plan_telling(const plan_query *q, plan *out)
{
    const mk::Planner p(*q);
    const auto worth = [&](const mk::PredictedExperiment &f, plan &one) {
        return one.gain = p.gain(f, one);
    };
    return mk::best_of_family(p, 0.0, worth, *out);
}

bool plan_test(const plan_query *q, plan *out)
{
    const mk::Planner p(*q);
    const auto worth = [&](const mk::PredictedExperiment &f, plan &one) {
        p.gain(f, one);
        return one.gain = p.surprise(f);
    };
    // A test that hardly moves the rig is none, if there is another.
    return mk::best_of_family(p, mk::TEST_SHARE, worth, *out) ||
           mk::best_of_family(p, 0.0, worth, *out);
}

bool plan_probe(const plan_query *q, const char *with, plan *out)
{
    const mk::Planner p(*q);
    const int *form = mk::forms_for(with);
    for (int i = 0; i < 4; i++)
        for (size_t s = std::size(mk::shares); s-- > 1;) {
            const mk::Form &f = mk::forms[form[i]];
            const std::string text = p.input(f, mk::shares[s]);
            mk::PredictedExperiment seen;
            if (p.was_run(text.c_str()) || !p.keeps(text.c_str(), &seen))
                continue;
            *out = {};
            out->gain = p.gain(seen, *out);
            snprintf(out->input, sizeof out->input, "%s", text.c_str());
            snprintf(out->kind, sizeof out->kind, "%s", f.kind);
            return true;
        }
    return false;
}

bool plan_keeps(const plan_query *q, const char *input)
{
    return mk::Planner(*q).keeps(input, nullptr);
}

// What an excitation is asked for the first experiment.
static mk_excite_options first_options(const plan_query &q, const mk::Known &k)
{
    mk_excite_options o;
    mk_excite_default(&k.model, &o);
    o.criterion = MK_EXCITE_D;
    o.seconds = q.seconds;
    o.rate_hz = q.rate_hz;
    o.harmonics = 8;
    o.spread = q.spread;
    o.process_noise = mk::FIRST_PROCESS_NOISE;
    o.u_max = mk::FIRST_SHARE * q.limits.u_max;
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        o.q_min[j] = q.limits.q_min[j];
        o.q_max[j] = q.limits.q_max[j];
        o.v_max[j] = q.limits.v_max[j];
        o.noise[j] = q.noise[j];
    }
    std::fill(o.fixed, o.fixed + MK_MAX_FIT_PARAMETERS, true);
    for (int number : k.free)
        o.fixed[number] = false;
    o.evaluations = q.tries;
    o.seed = q.seed;
    o.threads = q.threads;
    o.progress = q.progress;
    o.progress_context = q.progress_context;
    return o;
}

enum mk_status plan_first(const plan_query *q, plan *out, mk_error *err)
{
    const mk::Known k = mk::describe(*q);
    mk_excite_options o = first_options(*q, k);
    mk_excitation e = {};
    enum mk_status st = mk_excite(&k.model, &o, &e, err);
    // A light link is driven over the top by next to any input of that strength.
    for (int i = 0; i < mk::WEAKER && st == MK_ERR_NUMERIC; i++) {
        o.u_max *= 0.5;
        st = mk_excite(&k.model, &o, &e, err);
    }
    if (st != MK_OK)
        return st;
    *out = {};
    snprintf(out->input, sizeof out->input, "%s", e.input);
    snprintf(out->kind, sizeof out->kind, "many frequencies at once");
    for (size_t i = 0; i < k.free.size(); i++) {
        const double error = e.figures.std_error[k.free[i]];
        if (!(error > out->after))
            continue;
        out->after = error;
        out->before = 1.0;
        snprintf(out->about, sizeof out->about, "%s", k.name[i].c_str());
    }
    mk_excitation_clear(&e);
    return MK_OK;
}
