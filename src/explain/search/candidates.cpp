// The catalogue as a search sees it: for each effect, at each joint where it makes sense, values to
// start a fit from.
//
// A start has two parts. The size of the effect (a torque, mostly) is taken small against what acts
// in the rig: for an effect that vanishes with its size the likelihood's slope there says how much
// is to be gained (search by score test, trials.cpp), and a fit is linear in it. The shape (a
// speed, a place, a yield, a frequency) is taken at several values that cover what the data can
// tell apart, since a likelihood has one optimum for each.
//
// The comment above each function gives the law where its name does not say it, the parameters in
// their order, and their starts. Parameters that a start leaves out keep the effect's usual values
// (sharpness, drag). Laws are torques at the joint, v its speed, S_k(v) = tanh(k v) the smoothed
// sign of friction, u the command.
// Symbols: T = torque() the rig's usual torque, V = speed() the joint's largest speed, L = size() a
// motion of 1 rad in the joint's unit (1; 0.01 m where it slides), I = inertia() that of the
// joint's body.
#include "explain/search/candidates.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "model/effects_custom.hpp"
#include "model/plant_facts.h"

namespace mk
{

namespace
{

// What a start is made from.
struct Setting {
    // Without a joint only wheel(), slides(), size(), motor(), torque() and speed() may be asked.
    const mk_plant_info *plant;
    const mk_model *model;
    const DataRange *range;
    int j; // 0-based; -1: no joint
    double inertia() const { return mk_plant_body_inertia(model, j); }
    bool wheel() const { return j >= 0 && mk_model_turns_freely(model, j); }
    // Gravity does nothing at it.
    bool level() const { return slides() || plant->joint_is_level[j]; }
    // In a plane that does not move itself, in which gravity pulls.
    bool upright_plane() const
    {
        return j == 0 ? !plant->joint_is_level[0] : !plant->joints_parallel;
    }
    bool slides() const { return j >= 0 && model->joint_linear[j]; }
    // Of a motion of 1 rad, in the joint's unit.
    double size() const { return j >= 0 ? mk_model_joint_scale(model, j) : 1.0; }
    bool motor() const { return j == plant->motor_joint; }
    // There is a motor at it, whether or not the plant's command is its own.
    bool has_motor() const { return motor() || (j == 1 && range->two_motors); }
    // T and V. A joint that hardly moves has a tenth of L per second, so that sizes over a speed
    // stay finite.
    double torque() const { return range->torque; }
    double speed() const { return std::max(range->v_max[std::max(j, 0)], 0.1 * size()); }
};

// Fastest rate of bristles or a cable that readings could tell from a jump, 1/s: speed over yield.
constexpr double TOO_FAST = 3000.0;

// Starts, and in each the values of the first parameters of the effect.
using Starts = std::vector<std::vector<double>>;

// One row an effect: starting values for a joint, empty where there is nothing to look for.
struct Row {
    const char *name;
    bool linear;
    Starts (*starts)(const Setting &);
    double most = HUGE_VAL; // a larger size is no such fault of any rig
    int shape = -1;         // parameter that says little before the size is about right
    bool friction = false;  // a law of the joint's speed, against it
};
constexpr Row friction(Row row)
{
    row.friction = true;
    return row;
}

// All pairs (a, b).
Starts product(std::initializer_list<double> first, std::initializer_list<double> second)
{
    Starts all;
    for (double a : first)
        for (double b : second)
            all.push_back({a, b});
    return all;
}

// T / 100: fits are linear in an amplitude as small as that.
double small(const Setting &s)
{
    return 0.01 * s.torque();
}

// Friction of the motor joint is a base parameter already, on every plant.
// -c v: c V = T/100. Likewise -F S_k(v), and the differences dF and dc between the directions.
Starts viscous(const Setting &s)
{
    return s.motor() ? Starts{} : Starts{{small(s) / s.speed()}};
}
Starts coulomb(const Setting &s)
{
    return s.motor() ? Starts{} : Starts{{small(s)}};
}
Starts coulomb_asymmetry(const Setting &s)
{
    return {{small(s)}};
}
Starts viscous_asymmetry(const Setting &s)
{
    return {{small(s) / s.speed()}};
}
// A constant torque.
Starts torque_offset(const Setting &s)
{
    return {{small(s)}};
}
// -Fs exp(-(v/vs)^2) S_k(v) beside Coulomb friction: Fs, vs.
// Level T/50, speeds of 0.1, 0.4, 1.5 L per second.
Starts stribeck(const Setting &s)
{
    const double k = s.size();
    return product({2.0 * small(s)}, {0.1 * k, 0.4 * k, 1.5 * k});
}
// -d v |v|: d V^2 = T/100.
Starts quadratic_drag(const Setting &s)
{
    return {{small(s) / (s.speed() * s.speed())}};
}
// Bristles (LuGre): stiffness, damping, level g = T/50. They bend by g / stiffness = bend before
// they slide.
Starts stiction(const Setting &s)
{
    Starts all;
    for (double turn : {0.008, 0.04, 0.2}) {
        const double bend = turn * s.size();
        // Bristles that bend and slip thousands of times a second cannot be told from Coulomb's.
        if (s.speed() / bend > TOO_FAST || (turn > 0.1 && !s.wheel()))
            continue;
        double g = 2.0 * small(s);
        all.push_back({g / bend, 0.02 * g / bend, g});
    }
    return all;
}
// -mu |load| S_k(v): mu.
Starts load_friction(const Setting &s)
{
    bool loaded = s.motor() || s.plant->joints == 2;
    return loaded ? Starts{{0.01}} : Starts{};
}
// 1 + c (1 - exp(-t/T)) times the Coulomb level of the motor joint: c, T in s.
Starts friction_drift(const Setting &s)
{
    return s.motor() ? Starts{{0.05, 1.5}, {0.05, 6.0}} : Starts{};
}
// -s (q - q0): stiffness T/100 per unit of the joint, its rest q0 a twentieth of L off the joint's.
Starts cable_stiffness(const Setting &s)
{
    return s.wheel() ? Starts{} : Starts{{small(s), s.plant->rest[s.j] + 0.05 * s.size()}};
}
// -s z with yield zy: stiffness and yield, s zy = T/50 the torque at which it yields. One that
// yields beyond the motion is a spring that rests where the log begins, and creeps.
Starts cable_hysteresis(const Setting &s)
{
    Starts all;
    for (double turn : {0.03, 0.1, 0.3, 1.0, 3.0}) {
        const double yield = turn * s.size();
        if (!s.wheel() && s.speed() / yield < TOO_FAST)
            all.push_back({2.0 * small(s) / yield, yield});
    }
    return all;
}
// -A sin(n q + phi): amplitude T/100, n cycles a turn (searched, not fitted), phase.
Starts cogging(const Setting &s)
{
    Starts all;
    // Where the joint turns in a plane that does not move itself, once a revolution is an
    // imbalance. A bearing or gear of a joint without a motor has teeth, not one. A motor has
    // magnets, powered or not: that nothing drives the rig says nothing of them.
    const int first = s.upright_plane() || !s.has_motor() ? 2 : 1;
    for (int n = first; n <= 48; n++)
        // Of high numbers the even ones.
        if (n <= 16 || n % 2 == 0)
            all.push_back({small(s), (double)n, 0.3});
    return all;
}
// -m sin(q - phi), q the absolute angle of the body: m, phi.
Starts imbalance(const Setting &s)
{
    return s.level() ? Starts{} : Starts{{small(s), 0.3}};
}
// Place: so much of the range of the data within its end. With the rate w of the rig against the
// stop, stiffness k = I w^2 and damping 0.8 k / w = 0.8 I w.
Starts end_stop(const Setting &s)
{
    if (s.wheel())
        return {};
    double span = s.range->q_max[s.j] - s.range->q_min[s.j];
    Starts all;
    for (double rate : {40.0, 12.0}) // 1/s, of the rig against the stop
        for (double in : {0.02, 0.08, 0.2}) {
            double k = s.inertia() * rate * rate;
            all.push_back({s.range->q_max[s.j] - in * span, k, 0.8 * k / rate});
        }
    return all;
}
// Inertia: 2 % of the joint's.
Starts reflected_inertia(const Setting &s)
{
    // At joint 1 of every rig, and at any single joint, it is part of a base parameter.
    return s.j == 0 ? Starts{} : Starts{{0.02 * s.inertia()}};
}
// Gap width, contact stiffness k = J w^2 of the light side J = share I with w = 150 1/s, contact
// damping 30 J, share of the joint's inertia, and drag.
Starts backlash(const Setting &s)
{
    if (s.j != 1 && s.plant->joints == 2)
        return {};
    double share = s.motor() ? 0.2 : 0.08, light = share * s.inertia();
    double k = light * 150.0 * 150.0;
    Starts all;
    for (double width : {0.006, 0.02, 0.06})
        all.push_back({width * s.size(), k, 30.0 * light, share, 3.8});
    return all;
}
// Delay, s.
Starts input_delay(const Setting &)
{
    return {{0.002}, {0.008}};
}
// Half width, of the largest command.
Starts deadband(const Setting &s)
{
    return {{0.01 * s.range->u_max}, {0.08 * s.range->u_max}};
}
// Gain 1 + a for u > 0, 1 - a for u < 0: a.
Starts gain_asymmetry(const Setting &)
{
    return {{0.005}};
}
// Gain 1 - a (1 - exp(-t/T)): a, T in s.
Starts gain_drift(const Setting &)
{
    return {{0.02, 1.5}, {0.02, 6.0}};
}
// Gain 1 + a sin(n q + phi): a, n, phi.
Starts torque_ripple(const Setting &)
{
    Starts all;
    for (double n : {1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 12.0, 14.0, 16.0})
        all.push_back({0.01, n, 0.3});
    return all;
}
// Time constant, s.
Starts actuator_lag(const Setting &)
{
    return {{0.004}, {0.02}};
}
// Limit of the command.
Starts saturation(const Setting &s)
{
    Starts all;
    for (double share : {0.95, 0.75, 0.5})
        all.push_back({share * s.range->u_max});
    return all;
}
// |u| <= stall (1 - |w| / w0): stall and w0, of the largest command and speed.
Starts back_emf_limit(const Setting &s)
{
    double v = s.range->v_max[s.plant->motor_joint];
    return product({1.2 * s.range->u_max, 0.8 * s.range->u_max}, {1.3 * v, 3.0 * v});
}
// Relative error of the scale.
Starts encoder_scale(const Setting &)
{
    return {{0.002}};
}
// q + A sin(q + phi): A, phi.
Starts encoder_eccentricity(const Setting &s)
{
    return s.slides() ? Starts{} : Starts{{0.002, 0.3}};
}
// Reading q + offset.
Starts encoder_offset(const Setting &s)
{
    // An angle that nothing depends on has no zero.
    bool free = s.plant->joint_is_wheel[s.j] || s.plant->joint_is_level[s.j];
    return free ? Starts{} : Starts{{0.001 * s.size()}};
}
// Reading q(t - delay): delay, s.
Starts sensor_delay(const Setting &)
{
    return {{0.002}, {0.008}};
}
// Gravity turned in the plane of joint 1: angle, rad.
Starts base_tilt(const Setting &)
{
    return {{0.001}};
}
// One mode of what the rig stands on, an oscillator driven by minus the motor joint's torque:
// natural frequency, damping ratio, gain. The gain is its size.
// Frequencies in Hz, from 1.5 to 26, in steps of 7 %: as near as the width of a lightly damped
// resonance.
Starts base_compliance(const Setting &)
{
    Starts all;
    for (double f = 1.5; f < 26.0; f *= 1.07)
        all.push_back({f, 0.05, 0.02});
    return all;
}

// Terms that are laws of the catalogue by now.
// A constant torque and an asymmetry of viscous friction.
bool catalogued(int term)
{
    return strcmp(Custom::about(term).text, "1") == 0 ||
           strcmp(Custom::about(term).text, "abs(v)") == 0;
}

// -c f(q, v, w, u, t) with the term f by its number, w the speed of the other joint: c, number.
// Library terms: coefficients that make a small torque at the speeds and angles of the data.
Starts custom(const Setting &s)
{
    Starts all;
    const bool two = s.plant->joints == 2;
    const int other = two ? 1 - s.j : 0;
    const double w = std::max(s.range->v_max[other], 0.1 * mk_model_joint_scale(s.model, other));
    for (int n = 1; n <= Custom::TERMS; n++) {
        const CustomTerm &term = Custom::about(n);
        if ((strchr(term.text, 'w') && !two) || (term.q > 0.0 && s.wheel()) || catalogued(n))
            continue;
        // The term is v^a w^b u^c t^d: its size at the largest values of the data. Angles are of
        // the order of one. The coefficient makes a torque of T / 1000 of it.
        const double size = std::pow(s.speed(), term.v) * std::pow(w, term.w) *
                            std::pow(s.range->u_max, term.u) * std::pow(s.range->seconds, term.t);
        all.push_back({0.1 * small(s) / size, (double)n});
    }
    return all;
}
// -A f sin(angle + phi): A, phi, the number of f and angle, frequency in Hz. Terms 3 and 7 are of
// two joints; term 8 is a shake, sin(2 pi f t), and the only one with a frequency.
Starts custom_wave(const Setting &s)
{
    Starts all;
    for (int n = 1; n <= 7; n++)
        if (s.plant->joints == 2 || (n != 3 && n != 7))
            all.push_back({0.1 * small(s), 0.3, (double)n, 1.0});
    // A record of ten seconds tells frequencies a tenth of a hertz apart, and a fit that starts
    // further off ends elsewhere.
    const double apart = std::min(std::max(1.0 / s.range->seconds, 0.04), 0.15);
    for (double hz = 0.5; hz < 8.0; hz += apart)
        all.push_back({0.1 * small(s), 0.3, 8.0, hz});
    return all;
}
// -(A/w) sin(q - c) exp(-(1 - cos(q - c)) / w^2), a torque about one place: A, place c, width w.
// Places as near each other as they are wide, over the angles of the data.
Starts custom_well(const Setting &s)
{
    constexpr double TURN = 6.2831853;
    Starts all;
    const double low = s.range->q_min[s.j], span = std::min(s.range->q_max[s.j] - low, TURN);
    for (double width : {0.25, 0.6})
        for (double at = 0.5 * width; at < span; at += width)
            all.push_back({0.1 * small(s), low + at, width});
    return all;
}

// Name, linear, starts; the largest size that any rig has; the number of the parameter that is held
// until the size is about right. friction(): where several of one joint leave a rest, they are
// pieces of one law that the catalogue lacks.
const Row rows[] = {friction({"viscous", true, viscous}),
                    friction({"coulomb", true, coulomb}),
                    friction({"coulomb-asymmetry", true, coulomb_asymmetry}),
                    friction({"viscous-asymmetry", true, viscous_asymmetry}),
                    friction({"stribeck", true, stribeck}),
                    friction({"quadratic-drag", true, quadratic_drag}),
                    friction({"stiction", false, stiction}),
                    friction({"load-friction", true, load_friction}),
                    friction({"friction-drift", true, friction_drift}),
                    {"cable-stiffness", true, cable_stiffness},
                    {"cable-hysteresis", false, cable_hysteresis, HUGE_VAL, 1},
                    {"torque-offset", true, torque_offset},
                    {"cogging", true, cogging},
                    {"imbalance", true, imbalance},
                    {"end-stop", false, end_stop},
                    {"reflected-inertia", true, reflected_inertia},
                    {"backlash", false, backlash},
                    {"input-delay", false, input_delay},
                    {"deadband", false, deadband},
                    {"gain-asymmetry", true, gain_asymmetry, 0.5},
                    {"gain-drift", true, gain_drift, 0.7},
                    {"torque-ripple", true, torque_ripple, 0.5},
                    {"actuator-lag", false, actuator_lag},
                    {"saturation", false, saturation},
                    {"back-emf-limit", false, back_emf_limit, HUGE_VAL, 1},
                    {"encoder-scale", true, encoder_scale, 0.2},
                    {"encoder-eccentricity", true, encoder_eccentricity, 0.15},
                    {"encoder-offset", true, encoder_offset},
                    {"sensor-delay", false, sensor_delay},
                    {"base-tilt", true, base_tilt, 0.35},
                    {"base-compliance", true, base_compliance},
                    {"custom", true, custom},
                    {"custom-wave", true, custom_wave},
                    {"custom-well", true, custom_well}};

// `joint` as in mk_effect_use. Values do not matter.
bool present(const mk_model &model, const mk_effect_info *effect, int joint)
{
    for (int e = 0; e < model.effect_count; e++)
        if (mk_effect(model.effect[e].index) == effect && model.effect[e].joint == joint)
            return true;
    return false;
}

} // namespace

// q_min > q_max where a joint has no reading. The usual torque is the rms of the command, but at
// least a twentieth of what gravity asks for at joint 1 with both angles at 0.5, so that a swing
// without a motor has one.
DataRange data_range(const mk_model &model, const std::vector<const FitLog *> &logs)
{
    DataRange r = {};
    double sum = 0.0, count = 0.0;
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        r.q_min[j] = HUGE_VAL, r.q_max[j] = -HUGE_VAL;
    for (const FitLog *log : logs) {
        r.seconds = std::max(r.seconds, log->start + log->duration());
        for (int j = 0; j < log->joints; j++) {
            const std::vector<double> &q = log->q[j];
            r.v_max[j] = std::max(r.v_max[j], log->v_max[j]);
            for (size_t k = 0; k < q.size(); k++) {
                if (std::isnan(q[k]))
                    continue;
                r.q_min[j] = std::min(r.q_min[j], q[k]);
                r.q_max[j] = std::max(r.q_max[j], q[k]);
            }
        }
        for (double u : log->u[0]) {
            r.u_max = std::max(r.u_max, std::fabs(u));
            sum += u * u;
            count += 1.0;
        }
        for (double u : log->u[1])
            r.two_motors = r.two_motors || (std::isfinite(u) && u != 0.0);
    }
    // Root mean square of the command.
    r.torque = count > 0.0 ? std::sqrt(sum / count) : 0.0;
    // A rig that only swings has no command to measure by.
    double q[MK_MAX_JOINTS] = {0.5, 0.5}, zero[MK_MAX_JOINTS] = {0.0, 0.0}, g[MK_MAX_JOINTS];
    mk_plant_inverse_dynamics(&model, q, zero, zero, g);
    r.torque = std::max({r.torque, 0.05 * std::fabs(g[0]), 1e-9});
    r.u_max = std::max(r.u_max, 1e-9);
    return r;
}

// Of the library: terms with the speed v of the joint in them. Else what the table says.
bool is_friction(const mk_effect_info *effect, const double *values)
{
    if (std::strcmp(effect->name, "custom") == 0)
        return std::strchr(Custom::about((int)values[1]).text, 'v') != nullptr;
    if (std::strcmp(effect->name, "custom-wave") == 0)
        return std::strchr(CustomWave::text((int)values[2]), 'v') != nullptr;
    return std::any_of(std::begin(rows), std::end(rows), [&](const Row &row) {
        return row.friction && std::strcmp(effect->name, row.name) == 0;
    });
}

double cycles_a_turn(const mk_effect_info &effect, const double *values)
{
    for (int k = 0; k < effect.parameter_count; k++)
        if (effect.parameter[k].fit == MK_FIT_INTEGER)
            return values[k];
    return 1.0;
}

bool is_library(const mk_effect_info *effect)
{
    return strncmp(effect->name, "custom", 6) == 0;
}

bool same_cause(const Candidate &a, const Candidate &b)
{
    if (a.effect != b.effect || a.joint != b.joint)
        return false;
    // Terms of the library are causes of their own.
    int term = mk_effect_parameter_index(a.effect, "term");
    return term < 0 || a.value[term] == b.value[term];
}

// Of an effect with states, starts whose first parameters (a frequency) are more than a factor of
// 1.3 apart are different ones.
bool same_start(const Candidate &a, const Candidate &b)
{
    bool resonance = a.effect->state_count > 0;
    return same_cause(a, b) &&
           !(resonance && std::fabs(std::log(a.value[0] / b.value[0])) > std::log(1.3));
}

// It alone has both states and surfaces where its law switches; an end stop has no states.
bool is_backlash(const mk_effect_info *effect)
{
    return effect->event_count > 0 && effect->state_count > 0;
}

// The effect becomes the model's last one. Values are put into their ranges; the spread is that of
// the parameter with own values.
bool with_candidate(const mk_model &model, const Candidate &c, mk_model &out)
{
    out = model;
    if (mk_model_add_effect(&out, c.effect->name, c.joint, nullptr) != MK_OK)
        return false;
    mk_effect_use &use = out.effect[out.effect_count - 1];
    for (int i = 0; i < c.effect->parameter_count; i++)
        use.value[i] =
            std::min(std::max(c.value[i], c.effect->parameter[i].min), c.effect->parameter[i].max);
    use.spread[c.own >= 0 ? c.own : c.size] = c.spread;
    return true;
}

// All starts of all rows, in the order of the table, then of joints. Left out is what does not
// exist on this plant, what the model has at this joint already (terms of the library may be there
// several times), and what does not fit into the model. An effect whose joint is optional is asked
// for all joints together (0) and for each; on a rig with one joint for that one only.
std::vector<Candidate> candidates(const mk_model &model, const DataRange &range)
{
    std::vector<Candidate> all;
    const mk_plant_info *plant = mk_plant(model.plant);
    for (const Row &row : rows) {
        const mk_effect_info *effect = mk_effect_by_name(row.name);
        if (!effect || !(effect->plants & (1u << model.plant)))
            continue;
        // All joints are one where there is but one.
        bool some = effect->joint_rule != MK_EFFECT_JOINT_NONE && plant->joints == 1;
        int first = effect->joint_rule == MK_EFFECT_JOINT_ANY || some ? 1 : 0;
        int last = effect->joint_rule == MK_EFFECT_JOINT_NONE ? 0 : plant->joints;
        for (int joint = first; joint <= last; joint++) {
            if (!is_library(effect) && present(model, effect, joint))
                continue;
            mk_model alone = model; // for what an effect has where its row says nothing
            alone.effect_count = 0;
            if (mk_model_add_effect(&alone, effect->name, joint, nullptr) != MK_OK)
                continue;
            Setting setting = {plant, &model, &range, joint - 1};
            for (const std::vector<double> &start : row.starts(setting)) {
                Candidate c = {effect,
                               joint,
                               {},
                               row.linear,
                               std::max(mk_effect_parameter_index(effect, "gain"), 0),
                               row.most,
                               row.shape};
                for (int i = 0; i < effect->parameter_count; i++)
                    c.value[i] =
                        i < (int)start.size() ? start[(size_t)i] : alone.effect[0].value[i];
                all.push_back(c);
            }
        }
    }
    return all;
}

// Leaves `parameter` and `spread` as they are where there is no such place.
bool place_set_by_hand(const mk_effect_info *effect, int &parameter, double &spread)
{
    struct Place {
        const char *effect, *parameter;
        double spread; // in the parameter's unit
    };
    constexpr Place places[] = {{"cable-stiffness", "rest", 0.05}};
    for (const Place &place : places)
        if (std::strcmp(place.effect, effect->name) == 0) {
            parameter = mk_effect_parameter_index(effect, place.parameter);
            spread = place.spread;
            return true;
        }
    return false;
}

// The place is the parameter with own values (Candidate::own) and its usual spread the one to start
// from. Such a candidate has no slope at size 0 that would show the spread, so it is not linear.
std::vector<Candidate> with_own_places(const std::vector<Candidate> &candidates)
{
    constexpr double STIFFER = 5.0; // a place shows nothing where the effect is next to nothing
    std::vector<Candidate> all;
    for (Candidate c : candidates) {
        if (!place_set_by_hand(c.effect, c.own, c.spread))
            continue;
        c.linear = false;
        c.value[c.size] *= STIFFER;
        all.push_back(c);
    }
    return all;
}

} // namespace mk
