// A wheel, or an arm that turns level, may be anywhere when its counter is zeroed: its law does not
// depend on the angle. What magnets, teeth or a commutation do depends on it, as
//     A sin(n q + phi) ,
// and in log l, zeroed at z_l, is read as A sin(n (q + z_l) + phi): a phase of its own in every
// log, and no cause for a search that has one phase for all. So each log is asked by itself for
// what repeats with its angle. Where all name the same A and n,
//     z_l - z_1 = (phi_l - phi_1) / n ,   known but for multiples of 1/n of a turn ,
// and with the readings shifted by it one phase is right for all. The search then begins anew; it
// alone says whether there is such an effect.
//
// A shift that is wrong would take from the logs what they have in common, as a cable's rest. So
// what repeats must show in every log, alike, and promise more than any cause that is common to
// all.
#include "explain/search/places.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>

#include "explain/policy.hpp"
#include "explain/search/causes.hpp"
#include "sim/record_check.hpp"

namespace mk
{

namespace
{

// The parameter of an effect that is its phase; -1: it has none.
// MK_FIT_ANGLE marks a phase: 2 pi periodic, of an amplitude.
int phase_of(const mk_effect_info *effect)
{
    for (int k = 0; k < effect->parameter_count; k++)
        if (effect->parameter[k].fit == MK_FIT_ANGLE)
            return k;
    return -1;
}

// Whether the law does not depend on where the joint is. With x(q, v) the rig's state and e the
// joint's unit vector, asked is for turns d of 0.4, 1.3 and 2.9 rad (or as much of a joint that
// slides) whether
//     f(x(q + d e, v), u) = f(x(q, v), u)      every derivative of the state, to SAME ,
//     h(x(q + d e, v)) = h(x(q, v)) + d        the joint's reading .
// The one state that is looked at has unlike angles, speeds and a command of PUSH times the
// largest, so that no term is 0 by symmetry. Effects of the model count: one that depends on the
// angle, as a cable, makes the place matter.
bool place_is_free(const mk_model &m, int joint)
{
    constexpr double SAME = 1e-9, PUSH = 0.3;
    const double size = mk_model_joint_scale(&m, joint), u[MK_MAX_INPUTS] = {PUSH * m.u_max, 0.0};
    const int n = mk_model_joints(&m), states = mk_model_state_count(&m);
    for (double turn : {0.4, 1.3, 2.9}) {
        double q[MK_MAX_JOINTS] = {0.2, 0.5}, v[MK_MAX_JOINTS] = {1.1, -0.7};
        double x[MK_MAX_STATES], here[MK_MAX_STATES], there[MK_MAX_STATES];
        double read[MK_MAX_JOINTS], read_there[MK_MAX_JOINTS];
        for (int j = 0; j < n; j++)
            q[j] *= mk_model_joint_scale(&m, j), v[j] *= mk_model_joint_scale(&m, j);
        mk_model_initial_state(&m, q, v, x);
        mk_model_rhs(&m, 0.0, x, u, here);
        mk_model_measure(&m, 0.0, x, read);
        q[joint] += turn * size;
        mk_model_initial_state(&m, q, v, x);
        mk_model_rhs(&m, 0.0, x, u, there);
        mk_model_measure(&m, 0.0, x, read_there);
        if (!(std::fabs(read_there[joint] - read[joint] - turn * size) <= SAME * size))
            return false;
        for (int i = 0; i < states; i++)
            if (!(std::fabs(here[i] - there[i]) <= SAME * (1.0 + std::fabs(here[i]))))
                return false;
    }
    return true;
}

// One log by itself.
//
// `refit` is the shared model with its states, noise and process noise fitted to this log alone.
// Amplitude (in the unit of the candidate's size, never negative), phase and its standard error
// (rad) are those of what repeats, after measure(). Each stage returns false where it fails, and
// the log is then of no use: find_places() finds nothing.
struct OneLog {
    std::vector<FitLog> pieces;
    std::unique_ptr<Search> search;
    Hypothesis refit;
    double amplitude = 0.0, phase = 0.0, phase_error = 0.0;

    // The first PLACE_ASKED_S seconds of what is between holes, from the first half of the rows if
    // `half`: second halves of logs that are held back are for judging.
    bool load(const mk_log &log, const mk_model &model, bool half)
    {
        mk_record record;
        double hole = 0.0, left = policy::PLACE_ASKED_S;
        if (mk_record_from_log(&log, &model, &record, nullptr) != MK_OK)
            return false;
        for (const Piece &p : pieces_of(record, half ? record.rows / 2 : record.rows, hole)) {
            if (!(left > 0.0))
                break;
            pieces.push_back(beginning_of(fit_log(record, model, p.first, p.last), left));
            left -= pieces.back().duration();
        }
        return !pieces.empty();
    }
    // The refitted model follows the log with states and process noise of its own; what each cause
    // promises beyond it.
    // The promise of a cause is the gain in log likelihood that its slope shows, after the penalty
    // (Search::promises); no fit is made for it.
    // What repeats with the angle comes again later than in a usual shooting interval, and process
    // noise would take it from there: intervals are LONGER, and need so much more of it at first.
    bool ask(const Hypothesis &shared, const SearchOptions &usual,
             const std::vector<Candidate> &asked, std::vector<double> &promise)
    {
        constexpr double LONGER = 0.25, MORE = 10.0; // s; factor on the process noise
        SearchOptions options = usual;
        options.interval = LONGER;
        std::vector<const FitLog *> all;
        for (const FitLog &piece : pieces)
            all.push_back(&piece);
        search = std::make_unique<Search>(all, options);
        if (!search->follow(shared.point.model, nullptr, MORE * shared.process_noise, refit))
            return false;
        promise = search->promises(refit, asked);
        return true;
    }
    // Amplitude and phase of what repeats, in a full fit.
    // A negative size is a positive one half a period on: A sin(x) = -A sin(x + pi). The error
    // comes from the covariance of all fitted parameters, so that what the phase shares with them
    // is in it.
    bool measure(const Candidate &by)
    {
        const std::vector<Candidate> only = {by};
        ExtendOptions how;
        how.only = &only;
        const std::vector<Hypothesis> found = search->extend(refit, how);
        if (found.empty() || Search::discredited(found[0]))
            return false;
        const mk_model &m = found[0].point.model;
        const mk_effect_use &use = m.effect[m.effect_count - 1];
        const int number =
            mk_model_parameter_count(&m) - by.effect->parameter_count + phase_of(by.effect);
        const std::vector<int> free = fitted_parameters(m);
        const auto place = std::find(free.begin(), free.end(), number);
        if (place == free.end())
            return false;
        const long at = place - free.begin();
        amplitude = std::fabs(use.value[by.size]);
        phase = use.value[phase_of(by.effect)] + (use.value[by.size] < 0.0 ? M_PI : 0.0);
        phase_error = std::sqrt(Fit::covariance(m, found[0].quadratic, free)(at, at));
        return std::isfinite(phase_error);
    }
};

// Causes that repeat with the angle of the joint.
// An effect without a joint, as a ripple of the motor's torque, is one of the motor joint. Only
// linear candidates can be asked by their slope. Terms of the library name nothing.
std::vector<Candidate> that_repeat(const std::vector<Candidate> &all, const mk_model &m, int joint)
{
    std::vector<Candidate> some;
    for (const Candidate &c : all) {
        const bool here =
            c.joint == joint + 1 || (c.joint == 0 && joint == mk_plant(m.plant)->motor_joint);
        if (here && c.linear && phase_of(c.effect) >= 0 && !is_library(c.effect))
            some.push_back(c);
    }
    return some;
}

// Keeps of `asked`, in place, those that promise more than ACCEPT_FIRST in a log and at least
// PLACE_NEAR_THE_BEST of the most that any promises there. together[i] is the sum of the promises
// of asked[i] over the logs to learn from so far (`learned`: this is one); both stay of one length.
// What is left after all logs showed in every one.
void keep_promising(const std::vector<double> &promise, bool learned, std::vector<Candidate> &asked,
                    std::vector<double> &together)
{
    const double most = *std::max_element(promise.begin(), promise.end());
    size_t kept = 0;
    for (size_t c = 0; c < asked.size(); c++) {
        if (!(promise[c] > policy::ACCEPT_FIRST &&
              promise[c] >= policy::PLACE_NEAR_THE_BEST * most))
            continue;
        together[kept] = together[c] + (learned ? promise[c] : 0.0);
        asked[kept++] = asked[c];
    }
    asked.resize(kept);
    together.resize(kept);
}

// One rig has one amplitude: the largest of all logs is less than ALIKE times the least.
bool alike(const std::vector<OneLog> &logs)
{
    const auto [least, most] =
        std::minmax_element(logs.begin(), logs.end(), [](const OneLog &a, const OneLog &b) {
            return a.amplitude < b.amplitude;
        });
    return most->amplitude < policy::ALIKE * least->amplitude;
}

// The shift of a log against the first one, and its standard error:
//     shift = (phi - phi_1) / n   within half a period, +-pi / n ,
//     error = sqrt(error_phi^2 + error_phi_1^2) / n .
// `moved` is set where it is more than a count and PLACE_SIGNIFICANT errors: less than that is the
// same zero. All logs having the same zero, there is nothing to find.
Place place_of(const OneLog &log, const OneLog &first, double cycles, double count, bool &moved)
{
    const double error = std::hypot(log.phase_error, first.phase_error) / cycles;
    const double shift = std::remainder(log.phase - first.phase, 2.0 * M_PI) / cycles;
    moved = moved || std::fabs(shift) > std::max(count, policy::PLACE_SIGNIFICANT * error);
    return {shift, error};
}

// Looks at one joint after another. `refit` is the fit to all logs to learn from and `all` what
// could be added to its model. Logs are numbered through: those to learn from, then those held
// back.
class Finder
{
  public:
    Finder(const std::vector<const mk_log *> &learn_in, const std::vector<const mk_log *> &held_in,
           Search &search_in, const Hypothesis &refit_in)
        : learn(learn_in), held(held_in), search(search_in), refit(refit_in),
          model(refit_in.point.model), all(search_in.candidates_of(refit_in.point.model))
    {
    }
    // In turn: which candidates show in every log (each log leaves fewer to ask the next one
    // about); the one that promises most over the logs to learn from; its amplitude and phase in
    // every log; the shifts. True, and `out` filled, where some log has moved, amplitudes are alike
    // and no common cause promises as much.
    bool at(int joint, Places &out)
    {
        std::vector<Candidate> asked = that_repeat(all, model, joint);
        std::vector<double> together(asked.size(), 0.0);
        logs = std::vector<OneLog>(learn.size() + held.size());
        for (size_t l = 0; l < logs.size() && !asked.empty(); l++)
            if (!ask(l, asked, together))
                return false;
        if (asked.empty())
            return false;
        const auto best = std::max_element(together.begin(), together.end());
        const Candidate by = asked[(size_t)(best - together.begin())];
        for (OneLog &log : logs)
            if (search.cancelled || !log.measure(by))
                return false;
        bool moved = false;
        std::vector<Place> places = {{0.0, 0.0}};
        const double count = search.training()[0]->count[joint];
        for (size_t l = 1; l < logs.size(); l++)
            places.push_back(
                place_of(logs[l], logs[0], cycles_a_turn(*by.effect, by.value), count, moved));
        if (!moved || !alike(logs) || !says_most(*best))
            return false;
        out.joint = joint + 1;
        out.by = by.effect;
        out.cycles = cycles_a_turn(*by.effect, by.value);
        const auto border = places.begin() + (long)learn.size();
        out.learn.assign(places.begin(), border);
        out.held.assign(border, places.end());
        return true;
    }

  private:
    const std::vector<const mk_log *> &learn, &held;
    Search &search;
    const Hypothesis &refit;
    const mk_model &model;
    const std::vector<Candidate> all;
    std::vector<OneLog> logs;

    // Of a log that is held back, and of the last one to learn from where none is, the first half
    // is asked.
    bool ask(size_t l, std::vector<Candidate> &asked, std::vector<double> &together)
    {
        std::vector<double> promise;
        const bool known = l < learn.size();
        const bool half = !known || (held.empty() && l + 1 == learn.size());
        const mk_log &log = known ? *learn[l] : *held[l - learn.size()];
        if (search.cancelled || !logs[l].load(log, model, half) ||
            !logs[l].ask(refit, search.settings(), asked, promise))
            return false;
        keep_promising(promise, known, asked, together);
        return true;
    }
    // Whether it promises more, log by log, than any cause that is common to all logs.
    // Let loose in every log, a law has more freedom than one that all logs share. So `apart`, the
    // sum of its promises, must be ahead of the best common one by ACCEPT_FIRST.
    bool says_most(double apart)
    {
        const std::vector<double> common = search.promises(refit, all);
        return apart > *std::max_element(common.begin(), common.end()) + policy::ACCEPT_FIRST;
    }
};

} // namespace

// Ends with the first joint at which something is found. Neither `search` nor `refit` is changed
// but for the search's work; the fits of single logs are their own searches.
Places find_places(const std::vector<const mk_log *> &learn,
                   const std::vector<const mk_log *> &held, Search &search, const Hypothesis &refit)
{
    Places out;
    if (learn.size() < 2 || search.complete(refit) || !CauseSearch::matters(refit.process_noise))
        return out;
    Finder finder(learn, held, search, refit);
    for (int j = 0; j < mk_model_joints(&refit.point.model); j++)
        if (place_is_free(refit.point.model, j) && finder.at(j, out))
            break;
    return out;
}

// After it all logs read as if zeroed where the first was: q <- q + z_l - z_1. `joint` is 1-based,
// places[l] belongs to logs[l].
std::vector<OwnedLog> put_in_place(const std::vector<const mk_log *> &logs, int joint,
                                   const std::vector<Place> &places)
{
    std::vector<OwnedLog> out;
    for (size_t l = 0; l < logs.size(); l++) {
        out.push_back(rows_of_log(*logs[l], 0, logs[l]->rows));
        mk_log_shift(out.back().get(), mk_log_angle(joint - 1), places[l].shift);
    }
    return out;
}

// Logs to learn from come first; told.learned counts them. Logs beyond MK_MAX_PLACES are not told
// of.
void describe_places(const Places &places, mk_explanation &out)
{
    mk_places &told = out.places;
    told = {};
    told.joint = places.joint;
    told.by = places.by;
    told.cycles = places.cycles;
    for (const std::vector<Place> *list : {&places.learn, &places.held})
        for (const Place &p : *list) {
            if (told.count >= MK_MAX_PLACES)
                break;
            told.shift[told.count] = p.shift;
            told.std_error[told.count++] = p.std_error;
            told.learned += list == &places.learn;
        }
}

} // namespace mk
