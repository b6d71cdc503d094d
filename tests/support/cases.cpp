#include "support/cases.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <stdexcept>

namespace truth
{

const std::vector<std::string> rig_kinds = {"inertia-wheel", "pendulum", "pendubot",
                                            "reaction-wheel", "furuta"};

namespace
{

constexpr double PI = 3.14159265358979323846;

// What is large at a joint: a torque that matters, and a usual speed.
struct Scale {
    double torque, speed;
};

bool is(const std::string &a, const char *b)
{
    return a == b;
}

int motor_joint(const std::string &rig)
{
    return is(rig, "reaction-wheel") ? 2 : 1;
}

bool is_wheel(const std::string &rig, int joint)
{
    return is(rig, "inertia-wheel") || (is(rig, "reaction-wheel") && joint == 2);
}

Scale scale_of(const Rig &rig, int joint)
{
    if (is(rig.kind, "inertia-wheel"))
        return {0.5, 80.0};
    if (is(rig.kind, "pendulum"))
        return {1.0, 6.0};
    if (is(rig.kind, "reaction-wheel"))
        return joint == 1 ? Scale{1.5, 3.0} : Scale{0.5, 80.0};
    if (is(rig.kind, "pendubot"))
        return joint == 1 ? Scale{1.0, 4.0} : Scale{0.25, 6.0};
    return joint == 1 ? Scale{0.7, 3.0} : Scale{0.1 * rig.p[3] * rig.g, 8.0};
}

// One row an entry: at which joints it can hide, and its values.
struct Row {
    const char *name;
    bool (*possible)(const std::string &rig, int joint);
    std::map<std::string, double> (*values)(const Rig &rig, int joint, Draw &draw, double size);
    bool on_request = false; // came later: drawn where it is wished for, so that seeds stay
};
using Values = std::map<std::string, double>;

// A size or shape, log-uniform. Where the ranges are stretched (Wish::stretch), so are both its
// ends.
double about(Draw &draw, double low, double high)
{
    const double from = low / draw.stretch, to = high * draw.stretch;
    return from * std::pow(to / from, draw.unit());
}
// A shape (a time constant, a frequency, a number of cycles): uniform in the usual range,
// log-uniform in a stretched one.
double shape(Draw &draw, double low, double high)
{
    return draw.stretch > 1.0 ? about(draw, low, high) : draw.between(low, high);
}
bool nowhere_in_particular(const std::string &, int joint)
{
    return joint == 0;
}
bool any_joint(const std::string &, int joint)
{
    return joint > 0;
}
bool passive_joint(const std::string &rig, int joint)
{
    return joint > 0 && joint != motor_joint(rig);
}
bool driven_joint(const std::string &rig, int joint)
{
    return joint == motor_joint(rig);
}
bool link(const std::string &rig, int joint)
{
    return joint > 0 && !is_wheel(rig, joint);
}

const Row rows[] = {
    {"viscous", passive_joint,
     [](const Rig &r, int j, Draw &d, double k) -> Values {
         Scale s = scale_of(r, j);
         return {{"coefficient", k * about(d, 0.02, 0.3) * s.torque / s.speed}};
     }},
    {"coulomb", passive_joint,
     [](const Rig &r, int j, Draw &d, double k) -> Values {
         return {{"level", k * about(d, 0.02, 0.25) * scale_of(r, j).torque}};
     }},
    {"coulomb-asymmetry", any_joint,
     [](const Rig &r, int j, Draw &d, double k) -> Values {
         return {{"difference", d.sign() * k * about(d, 0.06, 0.3) * scale_of(r, j).torque}};
     }},
    {"stribeck", any_joint,
     [](const Rig &r, int j, Draw &d, double k) -> Values {
         return {{"level", k * about(d, 0.08, 0.3) * scale_of(r, j).torque},
                 {"velocity", about(d, 0.25, 1.5)}};
     }},
    {"quadratic-drag", any_joint,
     [](const Rig &r, int j, Draw &d, double k) -> Values {
         Scale s = scale_of(r, j);
         return {{"coefficient", k * about(d, 0.05, 0.4) * s.torque / (s.speed * s.speed)}};
     }},
    {"stiction", passive_joint,
     [](const Rig &r, int j, Draw &d, double k) -> Values {
         double level = k * about(d, 0.08, 0.3) * scale_of(r, j).torque;
         double stiffness = level / about(d, 0.01, 0.05);
         return {{"stiffness", stiffness}, {"damping", 0.02 * stiffness}, {"level", level}};
     }},
    {"cable-stiffness", link,
     [](const Rig &r, int j, Draw &d, double k) -> Values {
         double hang = is(r.kind, "pendubot") && j == 1 ? -0.5 * PI
                       : is(r.kind, "furuta") && j == 2 ? PI
                                                        : 0.0;
         return {{"stiffness", k * about(d, 0.1, 0.8) * scale_of(r, j).torque},
                 {"rest", hang + d.between(-0.2, 0.2)}};
     }},
    {"cable-hysteresis", link,
     [](const Rig &r, int j, Draw &d, double k) -> Values {
         double yield = about(d, 0.05, 0.3);
         return {{"stiffness", k * about(d, 0.06, 0.25) * scale_of(r, j).torque / yield},
                 {"yield", yield}};
     }},
    {"cogging", any_joint,
     [](const Rig &r, int j, Draw &d, double k) -> Values {
         return {{"amplitude", k * about(d, 0.04, 0.25) * scale_of(r, j).torque},
                 {"cycles", std::floor(shape(d, 2.0, 14.0))},
                 {"phase", d.between(-PI, PI)}};
     }},
    {"imbalance",
     [](const std::string &rig, int joint) {
         return joint > 0 && !(is(rig, "furuta") && joint == 1);
     },
     [](const Rig &r, int j, Draw &d, double k) -> Values {
         return {{"moment", k * about(d, 0.05, 0.3) * scale_of(r, j).torque},
                 {"phase", d.between(-PI, PI)}};
     }},
    {"viscous-asymmetry", any_joint,
     [](const Rig &r, int j, Draw &d, double k) -> Values {
         Scale s = scale_of(r, j);
         return {{"difference", d.sign() * k * about(d, 0.06, 0.3) * s.torque / s.speed}};
     },
     true},
    {"torque-offset", any_joint,
     [](const Rig &r, int j, Draw &d, double k) -> Values {
         return {{"level", d.sign() * k * about(d, 0.03, 0.2) * scale_of(r, j).torque}};
     },
     true},
    {"load-friction", any_joint,
     [](const Rig &r, int j, Draw &d, double k) -> Values {
         bool driven = driven_joint(r.kind, j);
         return {{"coefficient", k * (driven ? about(d, 0.02, 0.12) : about(d, 0.01, 0.05))}};
     }},
    {"reflected-inertia", [](const std::string &, int joint) { return joint == 2; },
     [](const Rig &r, int, Draw &d, double k) -> Values {
         double own = is(r.kind, "furuta") ? 4.0 * r.p[2] : r.p[1];
         return {{"inertia", k * about(d, 0.04, 0.25) * own}};
     }},
    {"end-stop", link,
     [](const Rig &r, int j, Draw &d, double) -> Values {
         double hang = is(r.kind, "pendubot") && j == 1 ? -0.5 * PI
                       : is(r.kind, "furuta") && j == 2 ? PI
                                                        : 0.0;
         double reach = is(r.kind, "reaction-wheel") ? 0.2 : 0.7;
         return {{"limit", hang + reach * d.between(0.6, 1.0)},
                 {"stiffness", about(d, 30.0, 100.0) * scale_of(r, j).torque},
                 {"damping", about(d, 0.2, 0.8) * scale_of(r, j).torque}};
     }},
    {"backlash",
     [](const std::string &rig, int joint) { return joint == (is(rig, "inertia-wheel") ? 1 : 2); },
     [](const Rig &r, int, Draw &d, double k) -> Values {
         bool wheel = is_wheel(r.kind, is(r.kind, "inertia-wheel") ? 1 : 2);
         double whole = is(r.kind, "inertia-wheel") ? r.p[0]
                        : is(r.kind, "furuta")      ? 4.0 * r.p[2]
                                                    : r.p[1];
         double share = wheel ? 0.2 : 0.075, stiffness = share * whole * 22000.0;
         return {{"width", k * about(d, 0.008, 0.05)},
                 {"stiffness", stiffness},
                 {"damping", stiffness * 0.0015},
                 {"share", share},
                 {"rub", wheel ? 0.0 : 4.0 * share * whole}};
     }},
    {"input-delay", nowhere_in_particular,
     [](const Rig &, int, Draw &d, double k) -> Values {
         return {{"delay", k * about(d, 0.002, 0.012)}};
     }},
    {"actuator-lag", nowhere_in_particular,
     [](const Rig &, int, Draw &d, double k) -> Values {
         return {{"time-constant", k * about(d, 0.004, 0.03)}};
     }},
    {"deadband", nowhere_in_particular,
     [](const Rig &, int, Draw &d, double k) -> Values {
         return {{"width", k * about(d, 0.06, 0.4)}};
     }},
    {"gain-asymmetry", nowhere_in_particular,
     [](const Rig &, int, Draw &d, double k) -> Values {
         return {{"ratio", d.sign() * k * about(d, 0.015, 0.08)}};
     }},
    {"gain-drift", nowhere_in_particular,
     [](const Rig &, int, Draw &d, double k) -> Values {
         return {{"loss", k * about(d, 0.04, 0.2)}, {"time-constant", shape(d, 1.5, 6.0)}};
     }},
    {"torque-ripple",
     [](const std::string &rig, int joint) { return joint == 0 && !is(rig, "reaction-wheel"); },
     [](const Rig &, int, Draw &d, double k) -> Values {
         return {{"ratio", k * about(d, 0.03, 0.12)},
                 {"cycles", std::max(std::floor(shape(d, 1.0, 9.0)), 1.0)},
                 {"phase", d.between(-PI, PI)}};
     }},
    {"saturation", nowhere_in_particular,
     [](const Rig &, int, Draw &d, double) -> Values {
         return {{"limit", shape(d, 1.2, 2.2)}};
     }},
    {"back-emf-limit", nowhere_in_particular,
     [](const Rig &r, int, Draw &d, double) -> Values {
         Scale s = scale_of(r, motor_joint(r.kind));
         return {{"stall", shape(d, 2.5, 5.0)}, {"no-load-speed", s.speed * shape(d, 1.3, 3.0)}};
     }},
    {"encoder-offset",
     [](const std::string &rig, int joint) {
         return joint > 0 && !is_wheel(rig, joint) && !(is(rig, "furuta") && joint == 1);
     },
     [](const Rig &, int, Draw &d, double k) -> Values {
         return {{"offset", d.sign() * k * about(d, 0.006, 0.04)}};
     }},
    {"encoder-eccentricity", any_joint,
     [](const Rig &, int, Draw &d, double k) -> Values {
         return {{"amplitude", k * about(d, 0.006, 0.03)}, {"phase", d.between(-PI, PI)}};
     }},
    {"encoder-scale", link,
     [](const Rig &, int, Draw &d, double k) -> Values {
         return {{"ratio", d.sign() * k * about(d, 0.008, 0.04)}};
     }},
    {"sensor-delay",
     [](const std::string &rig, int joint) { return joint > 0 || is(rig, "pendubot"); },
     [](const Rig &, int, Draw &d, double k) -> Values {
         return {{"delay", k * about(d, 0.002, 0.01)}};
     }},
    {"missed-counts", link,
     [](const Rig &, int, Draw &d, double k) -> Values {
         return {{"step", k * about(d, 0.015, 0.06)}, {"rate", shape(d, 0.25, 0.6)}};
     }},
    {"base-tilt",
     [](const std::string &rig, int joint) { return joint == 0 && !is(rig, "inertia-wheel"); },
     [](const Rig &r, int, Draw &d, double k) -> Values {
         const double angle = d.sign() * k * about(d, 0.008, 0.05);
         if (!is(r.kind, "furuta"))
             return {{"angle", angle}};
         return {{"angle", angle}, {"arm", shape(d, 0.5, 1.6)}}; // a hub, or a weight at its end
     }},
    {"base-compliance",
     [](const std::string &rig, int joint) {
         return joint == 0 && (is(rig, "pendulum") || is(rig, "pendubot") || is(rig, "furuta"));
     },
     [](const Rig &, int, Draw &d, double k) -> Values {
         return {{"frequency", shape(d, 3.0, 14.0)},
                 {"damping-ratio", shape(d, 0.02, 0.08)},
                 {"gain", k * about(d, 0.04, 0.2)}};
     }},
    {"friction-drift",
     [](const std::string &rig, int joint) { return joint == 1 && motor_joint(rig) == 1; },
     [](const Rig &, int, Draw &d, double k) -> Values {
         return {{"change", d.sign() * k * shape(d, 0.25, 0.6)},
                 {"time-constant", shape(d, 1.5, 6.0)}};
     }},
};

// What the catalogue lacks, sized like what it has.
Effect foreign_effect(const std::string &name, const Rig &rig, Draw &draw, double k)
{
    int joint = joints_of(rig.kind) == 2 ? 1 + (int)draw.below(2) : 1;
    bool pivot = is(rig.kind, "pendubot") || is(rig.kind, "furuta");
    if (name == "normal-load-friction" || (name == "position-friction" && pivot))
        joint = pivot ? 2 : 1;
    if (name == "bent-gain" || name == "speed-gain")
        joint = motor_joint(rig.kind);
    Scale s = scale_of(rig, joint);
    double size = k * about(draw, 0.15, 0.6) * s.torque, angle = draw.between(-PI, PI);
    Values v;
    if (name == "cubic-drag")
        v = {{"coefficient", size / std::pow(s.speed, 3)}};
    else if (name == "position-friction")
        v = {{"level", size}, {"centre", angle}};
    else if (name == "normal-load-friction")
        v = {{"mu", draw.between(0.01, 0.04)}};
    else if (name == "magnet")
        v = {{"strength", size},
             {"centre", is(rig.kind, "pendubot") && joint == 1 ? -0.5 * PI + 0.4 : 0.4},
             {"reach", draw.between(0.2, 0.5)}};
    else if (name == "hardening-cable")
        v = {{"stiffness", 2.0 * size},
             {"rest", is(rig.kind, "pendubot") && joint == 1 ? -0.5 * PI
                      : is(rig.kind, "furuta") && joint == 2 ? PI
                                                             : 0.0}};
    else if (name == "floor-shake")
        v = {{"amplitude", size}, {"frequency", draw.between(0.8, 6.0)}, {"phase", angle}};
    else if (name == "relative-drag")
        v = {{"coefficient", size / (s.speed * scale_of(rig, 3 - joint).speed)}};
    else if (name == "bent-gain")
        v = {{"coefficient", k * draw.between(0.05, 0.15) / 9.0}}; // commands reach 3 to 5
    else if (name == "speed-gain")
        v = {{"coefficient", k * draw.between(0.1, 0.3) / s.speed}};
    else if (name == "one-way-drag")
        v = {{"coefficient", size / s.speed}};
    else if (name == "wind")
        v = {{"coefficient", size / (s.speed * s.speed)},
             {"speed", draw.sign() * draw.between(0.2, 0.6) * s.speed}};
    else if (name == "warming-drag")
        v = {{"coefficient", size / s.speed}, {"time-constant", draw.between(1.5, 6.0)}};
    else if (name == "creeping-pull")
        v = {{"rate", draw.sign() * 0.05 * size}};
    else
        v = {{"coefficient", size / std::sqrt(s.speed)}};
    return {name, joint, v};
}

// Laws that the catalogue has come to have under another name; no names: it lacks the effect.
std::vector<std::vector<Name>> since_in_catalogue(const Effect &e)
{
    if (e.name == "one-way-drag") // half of it is viscous, and half has another sign backwards
        return {{{"viscous-asymmetry", e.joint}, {"viscous", e.joint}}};
    if (e.name == "normal-load-friction")
        return {{{"load-friction", e.joint}}};
    return {};
}

bool foreign_possible(const std::string &name, const std::string &rig)
{
    bool two = joints_of(rig) == 2, wheel = is(rig, "inertia-wheel");
    if (name == "normal-load-friction")
        return is(rig, "pendubot") || is(rig, "furuta");
    if (name == "relative-drag")
        return two && !is(rig, "reaction-wheel");
    if (name == "magnet" || name == "hardening-cable")
        return !wheel && !is(rig, "reaction-wheel");
    return true;
}

const Row *row_of(const std::string &name)
{
    for (const Row &row : rows)
        if (name == row.name)
            return &row;
    return nullptr;
}

std::vector<int> places(const Row &row, const std::string &rig)
{
    std::vector<int> joints;
    for (int j = 0; j <= joints_of(rig); j++)
        if (row.possible(rig, j))
            joints.push_back(j);
    return joints;
}

// What a seed draws from.
std::vector<std::string> drawn(const std::string &rig)
{
    std::vector<std::string> names;
    for (const Row &row : rows)
        if (!row.on_request && !places(row, rig).empty())
            names.push_back(row.name);
    return names;
}

Effect hidden_effect(const Row &row, const Rig &rig, int joint, Draw &draw, double size)
{
    std::vector<int> joints = places(row, rig.kind);
    if (joints.empty())
        throw std::invalid_argument(std::string(row.name) + " cannot hide in " + rig.kind);
    if (std::find(joints.begin(), joints.end(), joint) == joints.end() || joint == 0)
        joint = joints[draw.below(joints.size())];
    return {row.name, joint, row.values(rig, joint, draw, size)};
}

// The effect's name, and other names of the same thing on this rig.
std::vector<Name> right_names(const Rig &rig, const Effect &e)
{
    std::vector<Name> names = {{e.name, e.joint}};
    bool swings =
        is(rig.kind, "pendubot") || is(rig.kind, "pendulum") || is(rig.kind, "reaction-wheel");
    bool mount = e.name == "base-tilt" || (e.name == "encoder-offset" && e.joint == 1);
    bool pendulum_mass = is(rig.kind, "pendulum") && e.name == "imbalance";
    if ((swings && mount) || pendulum_mass) {
        names.push_back({"base-tilt", 0});
        names.push_back({"encoder-offset", 1});
        if (is(rig.kind, "pendulum"))
            names.push_back({"imbalance", 1});
    }
    if (e.name == "input-delay")
        names.push_back({"sensor-delay", 0});
    if (e.name == "sensor-delay" && (e.joint == 0 || joints_of(rig.kind) == 1))
        names.push_back({"input-delay", 0});
    bool one = e.name == "imbalance" || (e.name == "cogging" && e.value.at("cycles") == 1.0);
    if (one && e.joint == 1 && (is(rig.kind, "inertia-wheel") || is(rig.kind, "pendubot"))) {
        names.push_back({"cogging", 1});
        names.push_back({"imbalance", 1});
    }
    return names;
}

std::vector<std::string> inputs_for(const std::string &rig)
{
    if (is(rig, "inertia-wheel"))
        return {"multisine", "chirp", "steps", "rep2"};
    if (is(rig, "reaction-wheel"))
        return {"multisine", "steps", "release", "free"};
    std::vector<std::string> all = {"multisine", "chirp", "steps", "release", "pump", "rep2"};
    all.push_back(is(rig, "pendubot") ? "rep1" : "free");
    return all;
}

Recording draw_recording(const Recording &noise, const std::string &input, Draw &draw)
{
    Recording how = noise;
    how.input = input;
    how.seconds = draw.between(8.0, 13.0);
    how.seed = 1 + draw.below(1u << 30);
    return how;
}

} // namespace

std::vector<std::string> hideable(const std::string &rig)
{
    std::vector<std::string> names;
    for (const Row &row : rows)
        if (!places(row, rig).empty())
            names.push_back(row.name);
    return names;
}

OwnedLog as_log(const Log &made, const Rig &rig, const Recording &how)
{
    mk_log *log = nullptr;
    size_t rows_made = made.t.size();
    if (mk_log_create(rows_made, &log) != MK_OK)
        throw std::bad_alloc();
    OwnedLog owned(log);
    char text[64];
    snprintf(text, sizeof text, "%g %g", how.cpr[0], how.cpr[1]);
    bool fine = mk_log_set_meta(log, "rig", rig.kind.c_str()) == MK_OK &&
                mk_log_set_meta(log, "encoder_cpr", text) == MK_OK;
    snprintf(text, sizeof text, "%g", how.rate);
    fine = fine && mk_log_set_meta(log, "sample_rate_hz", text) == MK_OK;
    auto add = [&](const char *name, const std::vector<double> &from) {
        double *to = mk_log_add_column(log, name);
        fine = fine && to;
        if (to)
            std::copy(from.begin(), from.end(), to);
    };
    add("t", made.t);
    add("q1", made.reading[0]);
    if (!made.reading[1].empty())
        add("q2", made.reading[1]);
    add("u", made.u);
    if (!fine)
        throw std::bad_alloc();
    return owned;
}

OwnedLog usual_log(enum mk_plant_kind kind, const std::vector<Effect> &effects, uint64_t seed,
                   const char *input)
{
    Rig rig;
    Recording how;
    mk_model m;
    mk_model_default(kind, &m);
    rig.kind = mk_plant(kind)->name;
    rig.p.assign(m.parameter, m.parameter + mk_plant(kind)->parameter_count);
    rig.effects = effects;
    how.rate = 250.0;
    how.seconds = 4.0;
    how.input = input ? input : seed % 2 ? "multisine" : "chirp";
    how.seed = seed;
    return as_log(record(rig, how), rig, how);
}

Case make_case(const Wish &wish)
{
    Draw draw(wish.seed);
    draw.stretch = wish.stretch;
    Case c;
    c.rig.kind = wish.rig.empty() ? rig_kinds[draw.below(rig_kinds.size())] : wish.rig;
    // A rig that was not asked for is one that can have the effect.
    const Row *wished = row_of(wish.effect);
    while (wish.rig.empty() && wished && places(*wished, c.rig.kind).empty())
        c.rig.kind = rig_kinds[draw.below(rig_kinds.size())];
    double lot = draw.unit();
    c.kind = !wish.kind.empty()     ? wish.kind
             : !wish.effect.empty() ? "single"
             : lot < 0.1            ? "none"
             : lot < 0.2            ? "parameters"
             : lot < 0.8            ? "single"
             : lot < 0.9            ? "pair"
                                    : "off";
    const mk_plant_info *plant = mk_plant_by_name(c.rig.kind.c_str());
    if (!plant)
        throw std::invalid_argument("no rig is called " + c.rig.kind);
    mk_model_default(plant->kind, &c.given);
    const mk_model usual = c.given;
    mk_model real = usual;
    do {
        c.rig.p.clear();
        for (int i = 0; i < plant->parameter_count; i++) {
            c.rig.p.push_back(usual.parameter[i] * draw.between(0.8, 1.25));
            double off = c.kind == "none" ? 0.0 : draw.sign() * draw.between(0.03, 0.2);
            real.parameter[i] = c.rig.p.back();
            c.given.parameter[i] = c.rig.p.back() * (1.0 + off);
        }
    } while (mk_model_check(&real, nullptr) != MK_OK || mk_model_check(&c.given, nullptr) != MK_OK);
    const bool several = c.kind == "several";
    size_t effects = c.kind == "single" ? 1
                     : c.kind == "pair" ? 2
                     : several          ? 3 + draw.below(3)
                                        : 0;
    std::vector<std::string> possible = drawn(c.rig.kind);
    for (size_t i = 0; i < effects; i++) {
        std::string name =
            i == 0 && !wish.effect.empty() ? wish.effect : possible[draw.below(possible.size())];
        bool again = i == 1 && (name == c.rig.effects[0].name || name == "missed-counts" ||
                                name == "backlash" || c.rig.effects[0].name == "backlash");
        if (several && (name == "missed-counts" || name == "backlash" ||
                        std::any_of(c.rig.effects.begin(), c.rig.effects.end(),
                                    [&](const Effect &e) { return e.name == name; }))) {
            i--;
            continue;
        }
        if (!several && again && wish.effect.empty()) {
            i--;
            if (c.rig.effects[0].name == "backlash" || c.rig.effects[0].name == "missed-counts")
                c.rig.effects.clear(), i = (size_t)-1, c.right.clear();
            continue;
        }
        const Row *row = row_of(name);
        if (!row)
            throw std::invalid_argument("no effect is called " + name);
        // Of several one is as large as is usual, and the others are smaller.
        const double size = several && i > 0 ? wish.size * about(draw, 0.08, 0.6) : wish.size;
        c.rig.effects.push_back(hidden_effect(*row, c.rig, wish.joint, draw, size));
        c.right.push_back(right_names(c.rig, c.rig.effects.back()));
    }
    if (c.kind == "off") {
        // Drawn even if wished for, so that a wish changes nothing else of a seed's case.
        const std::string drawn = foreign_effects[draw.below(foreign_effects.size())];
        std::string name = wish.effect.empty() ? drawn : wish.effect;
        while (!foreign_possible(name, c.rig.kind))
            name = foreign_effects[draw.below(foreign_effects.size())];
        c.rig.effects.push_back(foreign_effect(name, c.rig, draw, wish.size));
        c.right = since_in_catalogue(c.rig.effects.back());
        c.kind = c.right.empty() ? "off" : "single";
    }
    static const double rates[] = {200.0, 250.0, 400.0, 500.0};
    static const double counts[] = {2048.0, 4000.0, 4000.0, 8192.0};
    Recording noise;
    noise.rate = rates[draw.below(4)];
    if (wish.rate > 0.0)
        noise.rate = wish.rate;
    for (double &cpr : noise.cpr)
        cpr = counts[draw.below(4)];
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        c.given.encoder_cpr[j] = (int)noise.cpr[j];
    noise.jitter = draw.unit() < 0.5 ? 0.3 : 0.0;
    noise.dropped = draw.unit() < 0.3 ? 0.005 : 0.0;
    std::vector<std::string> inputs = inputs_for(c.rig.kind);
    size_t logs = 2 + draw.below(2);
    if (wish.runs >= 2)
        logs = wish.runs;
    for (size_t i = 0; i < logs; i++) {
        size_t pick = draw.below(inputs.size());
        // A log without a command shows too little to learn from alone.
        if (i == 0)
            while (inputs[pick] == "free")
                pick = draw.below(inputs.size());
        c.how.push_back(draw_recording(noise, inputs[pick], draw));
        if (wish.seconds > 0.0)
            c.how.back().seconds = wish.seconds;
        inputs.erase(inputs.begin() + (long)pick);
        if (inputs.empty() || (inputs.size() == 1 && inputs[0] == "free"))
            inputs = inputs_for(c.rig.kind);
        if (!wish.logs)
            continue;
        OwnedLog log = as_log(record(c.rig, c.how.back()), c.rig, c.how.back());
        if (i + 1 < logs)
            c.train.push_back(std::move(log));
        else
            c.holdout = std::move(log);
    }
    return c;
}

} // namespace truth
