#include "support/truth.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <stdexcept>

namespace truth
{

const std::vector<std::string> foreign_effects = {
    "cubic-drag",      "position-friction", "normal-load-friction", "magnet",
    "hardening-cable", "floor-shake",       "relative-drag",        "square-root-drag",
    "bent-gain",       "speed-gain",        "one-way-drag",         "wind",
    "warming-drag",    "creeping-pull"};

namespace
{

constexpr double PI = 3.14159265358979323846;
constexpr double LONGEST_STEP = 1e-4; // s

double soft_sign(double v)
{
    return std::tanh(15.0 * v);
}

enum class Kind { inertia_wheel, pendulum, pendubot, reaction_wheel, furuta };

Kind kind_of(const std::string &name)
{
    static const std::map<std::string, Kind> kinds = {{"inertia-wheel", Kind::inertia_wheel},
                                                      {"pendulum", Kind::pendulum},
                                                      {"pendubot", Kind::pendubot},
                                                      {"reaction-wheel", Kind::reaction_wheel},
                                                      {"furuta", Kind::furuta}};
    auto it = kinds.find(name);
    if (it == kinds.end())
        throw std::invalid_argument("no rig is called " + name);
    return it->second;
}

// Bodies: 0 and 1 are the rig's links, LIGHT the shaft or rotor on the encoder's side of a play,
// BASE what the rig stands on.
enum { LINK1, LINK2, LIGHT, BASE, BODIES };

constexpr int MOST_EFFECTS = 8;

struct State {
    double y[BODIES] = {0.0, 0.0, 0.0, 0.0}, v[BODIES] = {0.0, 0.0, 0.0, 0.0};
    double lag = 0.0;
    double memory[MOST_EFFECTS] = {}; // of the effect at the same place in the list
};

struct Forces {
    double on[BODIES] = {0.0, 0.0, 0.0, 0.0};
};

class Machine
{
  public:
    Machine(const Rig &r) : rig(r), kind(kind_of(r.kind)), p(r.p)
    {
        if (r.effects.size() > MOST_EFFECTS)
            throw std::invalid_argument("a rig hides 8 effects at most");
        play = find("backlash");
        rocking = find("base-compliance");
        two = joints_of(r.kind) == 2;
        motor = kind == Kind::reaction_wheel ? 2 : 1;
    }
    const Rig &rig;
    Kind kind;
    const std::vector<double> &p;
    const Effect *play, *rocking;
    bool two;
    int motor;
    double extra_damping = 0.0; // while the rig comes to rest before a run

    const Effect *find(const char *name) const
    {
        for (const Effect &e : rig.effects)
            if (e.name == name)
                return &e;
        return nullptr;
    }
    bool wheel_play() const
    {
        return play && (kind == Kind::inertia_wheel || kind == Kind::reaction_wheel);
    }
    // Angle and speed of a joint, as its encoder's shaft turns.
    double angle(const State &s, int joint) const { return turn(s.y, joint); }
    double speed(const State &s, int joint) const { return turn(s.v, joint); }
    double turn(const double *x, int joint) const
    {
        int far = play && (joint == 2 || !two) ? LIGHT : joint == 1 ? LINK1 : LINK2;
        if (joint == 1)
            return x[far] - x[BASE];
        return x[far] - (kind == Kind::furuta ? 0.0 : x[LINK1]);
    }
    // A torque between the two sides of a joint.
    void twist(Forces &f, int joint, double torque) const
    {
        int far = wheel_play() && (joint == 2 || !two) ? LIGHT : joint == 1 ? LINK1 : LINK2;
        f.on[far] += torque;
        if (joint == 1)
            f.on[BASE] -= torque;
        else if (kind != Kind::furuta)
            f.on[LINK1] -= torque;
    }

    State at(const double *q) const
    {
        State s;
        s.y[LINK1] = q[0];
        if (two)
            s.y[LINK2] = kind == Kind::furuta ? q[1] : q[0] + q[1];
        s.y[LIGHT] = two ? s.y[LINK2] : s.y[LINK1];
        return s;
    }

    State derivative(const State &s, double t, double command) const;
    State step(const State &s, double t, double h, double command) const;

  private:
    static double at_(const Effect &e, const char *name)
    {
        auto it = e.value.find(name);
        if (it == e.value.end())
            throw std::invalid_argument(e.name + " needs " + name);
        return it->second;
    }
    double amplifier(const State &s, double t, double command) const;
    void gravity(const State &s, Forces &f) const;
    void joint_torques(const State &s, double t, double drive, Forces &f, State &d) const;
    double foreign(const Effect &e, const State &s, double t, double drive) const;
    double normal_force(const State &s) const;
    double touch(const Effect &e, double q, double v, double t) const;
    void contact(const State &s, Forces &f) const;
    void accelerate(const State &s, const Forces &f, State &d) const;
};

// Between the command and the motor.
double Machine::amplifier(const State &s, double t, double command) const
{
    double u = find("actuator-lag") ? s.lag : command;
    if (const Effect *e = find("deadband")) {
        double b = at_(*e, "width");
        u = std::fabs(u) <= b ? 0.0 : u - std::copysign(b, u);
    }
    if (const Effect *e = find("gain-asymmetry"))
        u *= u > 0.0 ? 1.0 + at_(*e, "ratio") : 1.0 - at_(*e, "ratio");
    if (const Effect *e = find("torque-scale"))
        u *= 1.0 + at_(*e, "ratio");
    if (const Effect *e = find("gain-drift"))
        u *= 1.0 - at_(*e, "loss") * (1.0 - std::exp(-t / at_(*e, "time-constant")));
    if (const Effect *e = find("torque-ripple"))
        u *= 1.0 + at_(*e, "ratio") * std::sin(at_(*e, "cycles") * angle(s, 1) + at_(*e, "phase"));
    if (const Effect *e = find("saturation"))
        u = std::min(std::max(u, -at_(*e, "limit")), at_(*e, "limit"));
    if (const Effect *e = find("back-emf-limit")) {
        double turning = std::fabs(speed(s, motor)) / at_(*e, "no-load-speed");
        double limit = at_(*e, "stall") * std::max(0.0, 1.0 - turning);
        u = std::min(std::max(u, -limit), limit);
    }
    return u;
}

// The pendulum of a Furuta rig, a thin rod, as three masses in space (exact: Simpson's rule), at
// `reach` from the axis.
struct Rod {
    double reach, mass[3], radius[3];
    explicit Rod(const std::vector<double> &p)
    {
        double half = 3.0 * p[2] / p[3], whole = p[3] / half;
        reach = 0.5 * p[1] / p[3];
        for (int i = 0; i < 3; i++) {
            mass[i] = whole * (i == 1 ? 4.0 : 1.0) / 6.0;
            radius[i] = half * i;
        }
    }
    double about_axis() const // of the arm's tip if all were there
    {
        return (mass[0] + mass[1] + mass[2]) * reach * reach;
    }
    // Of one mass: columns d(position)/d(arm), d(position)/d(rod); and what speeds alone accelerate
    // it by.
    void motion(int i, double a, double b, double va, double vb, double J[3][2],
                double bias[3]) const
    {
        double ca = std::cos(a), sa = std::sin(a), cb = std::cos(b), sb = std::sin(b);
        double length = radius[i];
        J[0][0] = -reach * sa - length * sb * ca;
        J[1][0] = reach * ca - length * sb * sa;
        J[2][0] = 0.0;
        J[0][1] = -length * cb * sa;
        J[1][1] = length * cb * ca;
        J[2][1] = -length * sb;
        bias[0] = va * va * (-reach * ca + length * sb * sa) - 2.0 * va * vb * length * cb * ca +
                  vb * vb * length * sb * sa;
        bias[1] = va * va * (-reach * sa - length * sb * ca) - 2.0 * va * vb * length * cb * sa -
                  vb * vb * length * sb * ca;
        bias[2] = -vb * vb * length * cb;
    }
};

void Machine::gravity(const State &s, Forces &f) const
{
    const Effect *tilt = find("base-tilt");
    double lean = tilt ? at_(*tilt, "angle") : 0.0, g = rig.g;
    switch (kind) {
    case Kind::inertia_wheel:
        break;
    case Kind::pendulum:
        f.on[LINK1] -= p[1] * std::sin(s.y[LINK1] - lean);
        break;
    case Kind::pendubot:
        f.on[LINK1] -= p[3] * g * std::cos(s.y[LINK1] - lean);
        f.on[LINK2] -= p[4] * g * std::cos(s.y[LINK2] - lean);
        break;
    case Kind::reaction_wheel:
        f.on[LINK1] -= p[2] * g * std::sin(s.y[LINK1] - lean);
        break;
    case Kind::furuta: {
        Rod rod(p);
        double J[3][2], bias[3], down[3] = {0.0, -g * std::sin(lean), -g * std::cos(lean)};
        for (int n = 0; n < 3; n++) {
            rod.motion(n, s.y[LINK1], s.y[LINK2], 0.0, 0.0, J, bias);
            for (int i = 0; i < 3; i++)
                for (int k = 0; k < 2; k++)
                    f.on[k] += rod.mass[n] * down[i] * J[i][k];
        }
        // The arm is a uniform rod too, unless its mass sits further in or out: what all masses
        // come to about the axis is then `arm` times as much.
        const double tip = rod.about_axis(), uniform = (tip + 1.5 * (p[0] - tip)) / rod.reach;
        const double moment =
            (tilt && tilt->value.count("arm") ? at_(*tilt, "arm") : 1.0) * uniform;
        f.on[LINK1] += (moment - tip / rod.reach) * down[1] * std::cos(s.y[LINK1]);
        break;
    }
    }
    for (const Effect &e : rig.effects)
        if (e.name == "imbalance") {
            int body = e.joint == 1 ? LINK1 : LINK2;
            f.on[body] -= at_(e, "moment") * std::sin(s.y[body] - at_(e, "phase"));
        }
}

// What presses on the bearing of the passive joint along the link that hangs there: the weight of a
// point mass and what holds it on its way, without the part of the accelerations; a torque, as by
// the mass's distance.
double Machine::normal_force(const State &s) const
{
    const Effect *tilt = find("base-tilt");
    double lean = tilt ? at_(*tilt, "angle") : 0.0;
    if (kind == Kind::reaction_wheel)
        return std::fabs(p[0] * s.v[LINK1] * s.v[LINK1] +
                         p[2] * rig.g * std::cos(s.y[LINK1] - lean));
    if (kind == Kind::pendubot) {
        double w = s.v[LINK2] * s.v[LINK2], v = s.v[LINK1] * s.v[LINK1];
        return std::fabs(p[1] * w + p[2] * v * std::cos(s.y[LINK2] - s.y[LINK1]) -
                         p[4] * rig.g * std::sin(s.y[LINK2] - lean));
    }
    if (kind != Kind::furuta)
        return 0.0;
    // In space: what holds the masses of the rod, seen along it.
    Rod rod(p);
    double a = s.y[LINK1], b = s.y[LINK2], pull = 0.0;
    double along[3] = {-std::sin(b) * std::sin(a), std::sin(b) * std::cos(a), std::cos(b)};
    for (int n = 0; n < 3; n++) {
        double J[3][2], bias[3];
        rod.motion(n, a, b, s.v[LINK1], s.v[LINK2], J, bias);
        for (int i = 0; i < 3; i++)
            pull -= rod.mass[n] * rod.radius[n] * along[i] * (bias[i] + (i == 2 ? rig.g : 0.0));
    }
    return std::fabs(pull);
}

double Machine::foreign(const Effect &e, const State &s, double t, double drive) const
{
    double q = angle(s, e.joint), v = speed(s, e.joint);
    if (e.name == "cubic-drag")
        return -at_(e, "coefficient") * v * v * v;
    if (e.name == "position-friction")
        return -0.5 * at_(e, "level") * (1.0 + std::cos(q - at_(e, "centre"))) * soft_sign(v);
    if (e.name == "normal-load-friction")
        return -at_(e, "mu") * normal_force(s) * soft_sign(v);
    if (e.name == "magnet") {
        double off = std::remainder(q - at_(e, "centre"), 2.0 * PI) / at_(e, "reach");
        return -at_(e, "strength") * off * std::exp(-0.5 * off * off);
    }
    if (e.name == "hardening-cable") {
        double off = q - at_(e, "rest");
        return -at_(e, "stiffness") * off * off * off;
    }
    if (e.name == "floor-shake")
        return at_(e, "amplitude") * std::sin(2.0 * PI * at_(e, "frequency") * t + at_(e, "phase"));
    if (e.name == "relative-drag") // air carried along by the other link
        return -at_(e, "coefficient") * v * std::fabs(speed(s, 3 - e.joint));
    if (e.name == "square-root-drag")
        return -at_(e, "coefficient") * std::copysign(std::sqrt(std::fabs(v)), v);
    if (e.name == "bent-gain") // an amplifier that gives way before its limit
        return -at_(e, "coefficient") * drive * drive * drive;
    if (e.name == "speed-gain") // a motor that is weaker while it turns
        return -at_(e, "coefficient") * drive * std::fabs(v);
    if (e.name == "one-way-drag")
        return -at_(e, "coefficient") * std::max(v, 0.0);
    if (e.name == "wind") {
        double past = v - at_(e, "speed");
        return -at_(e, "coefficient") * past * std::fabs(past);
    }
    if (e.name == "warming-drag")
        return -at_(e, "coefficient") * v * (1.0 - std::exp(-t / at_(e, "time-constant")));
    if (e.name == "creeping-pull")
        return at_(e, "rate") * t;
    throw std::invalid_argument("no effect is called " + e.name);
}

void Machine::joint_torques(const State &s, double t, double drive, Forces &f, State &d) const
{
    double level = p[p.size() - 1], v_motor = speed(s, motor);
    if (const Effect *e = find("friction-drift"))
        level *= 1.0 + at_(*e, "change") * (1.0 - std::exp(-t / at_(*e, "time-constant")));
    twist(f, motor, drive - p[p.size() - 2] * v_motor - level * soft_sign(v_motor));
    for (int joint = 1; joint <= (two ? 2 : 1); joint++)
        twist(f, joint, -extra_damping * speed(s, joint));
    for (size_t i = 0; i < rig.effects.size(); i++) {
        const Effect &e = rig.effects[i];
        if (e.joint == 0)
            continue;
        double q = angle(s, e.joint), v = speed(s, e.joint), torque = 0.0;
        double z = s.memory[i], &dz = d.memory[i];
        if (e.name == "viscous") {
            torque = -at_(e, "coefficient") * v;
        } else if (e.name == "coulomb") {
            torque = -at_(e, "level") * soft_sign(v);
        } else if (e.name == "coulomb-asymmetry") {
            torque = -0.5 * at_(e, "difference") * soft_sign(v) * soft_sign(v);
        } else if (e.name == "viscous-asymmetry") {
            torque = -0.5 * at_(e, "difference") * (v > 0.0 ? v : -v);
        } else if (e.name == "torque-offset") {
            torque = at_(e, "level");
        } else if (e.name == "stribeck") {
            double slow = v / at_(e, "velocity");
            torque = -at_(e, "level") * std::exp(-slow * slow) * soft_sign(v);
        } else if (e.name == "quadratic-drag") {
            torque = -at_(e, "coefficient") * v * std::fabs(v);
        } else if (e.name == "stiction") {
            dz = v - at_(e, "stiffness") * std::fabs(v) * z / at_(e, "level");
            torque = -(at_(e, "stiffness") * z + at_(e, "damping") * dz);
        } else if (e.name == "cable-stiffness") {
            torque = -at_(e, "stiffness") * (q - at_(e, "rest"));
        } else if (e.name == "cable-hysteresis") {
            double yield = at_(e, "yield");
            dz = v - std::fabs(v) * z * std::fabs(z) / (yield * yield);
            torque = -at_(e, "stiffness") * z;
        } else if (e.name == "cogging") {
            torque = -at_(e, "amplitude") * std::sin(at_(e, "cycles") * q + at_(e, "phase"));
        } else if (e.name == "load-friction") {
            double load = e.joint == motor ? std::fabs(drive) : normal_force(s);
            torque = -at_(e, "coefficient") * load * soft_sign(v);
        } else if (e.name == "end-stop") {
            double in = q - at_(e, "limit");
            if (in > 0.0)
                torque = -std::max(0.0, at_(e, "stiffness") * in + at_(e, "damping") * v);
        } else if (e.name == "hand" || e.name == "kick") {
            torque = touch(e, q, v, t);
        } else if (std::find(foreign_effects.begin(), foreign_effects.end(), e.name) !=
                   foreign_effects.end()) {
            torque = foreign(e, s, t, drive);
        }
        twist(f, e.joint, torque);
    }
}

// Somebody at the rig from a time to another: a hand that holds a joint at a place, or leads it on
// from there, or a blow.
double Machine::touch(const Effect &e, double q, double v, double t) const
{
    const double from = at_(e, "from"), to = at_(e, "to");
    if (t < from || t >= to)
        return 0.0;
    if (e.name == "kick")
        return at_(e, "level") * std::sin(PI * (t - from) / (to - from));
    const double off = q - at_(e, "place") - at_(e, "rate") * (t - from);
    return -at_(e, "stiffness") * off - at_(e, "damping") * (v - at_(e, "rate"));
}

// The two halves of a play push each other once the gap is used up. The shaft that carries the
// encoder rubs in its bearing.
void Machine::contact(const State &s, Forces &f) const
{
    int heavy = two ? LINK2 : LINK1;
    double half = 0.5 * at_(*play, "width"), open = s.y[LIGHT] - s.y[heavy],
           closing = s.v[LIGHT] - s.v[heavy], push = 0.0;
    if (open > half)
        push = std::max(0.0,
                        at_(*play, "stiffness") * (open - half) + at_(*play, "damping") * closing);
    else if (open < -half)
        push = std::min(0.0,
                        at_(*play, "stiffness") * (open + half) + at_(*play, "damping") * closing);
    f.on[heavy] += push;
    f.on[LIGHT] -= push;
    if (!wheel_play()) {
        double rub = at_(*play, "rub") * soft_sign(speed(s, 2));
        f.on[LIGHT] -= rub;
        if (kind == Kind::pendubot)
            f.on[LINK1] += rub;
    }
}

void Machine::accelerate(const State &s, const Forces &f, State &d) const
{
    double M[2][2] = {{p[0], 0.0}, {0.0, 1.0}}, r[2] = {f.on[LINK1], f.on[LINK2]};
    if (kind == Kind::pendubot) {
        double between = s.y[LINK2] - s.y[LINK1];
        M[0][1] = M[1][0] = p[2] * std::cos(between);
        M[1][1] = p[1];
        r[0] += p[2] * std::sin(between) * s.v[LINK2] * s.v[LINK2];
        r[1] -= p[2] * std::sin(between) * s.v[LINK1] * s.v[LINK1];
    } else if (kind == Kind::reaction_wheel) {
        M[1][1] = p[1];
    } else if (kind == Kind::furuta) {
        Rod rod(p);
        double J[3][2], bias[3];
        M[0][0] = p[0] - rod.about_axis();
        M[1][1] = 0.0;
        for (int n = 0; n < 3; n++) {
            rod.motion(n, s.y[LINK1], s.y[LINK2], s.v[LINK1], s.v[LINK2], J, bias);
            for (int i = 0; i < 3; i++)
                for (int k = 0; k < 2; k++) {
                    r[k] -= rod.mass[n] * bias[i] * J[i][k];
                    for (int l = 0; l < 2; l++)
                        M[k][l] += rod.mass[n] * J[i][k] * J[i][l];
                }
        }
    }
    if (play) {
        int heavy = two ? LINK2 : LINK1;
        double whole = !two ? p[0] : kind == Kind::furuta ? 4.0 * p[2] : p[1];
        double light = at_(*play, "share") * whole;
        M[heavy][heavy] -= light;
        d.v[LIGHT] = f.on[LIGHT] / light;
    }
    for (const Effect &e : rig.effects)
        if (e.name == "reflected-inertia") {
            double rotor = at_(e, "inertia");
            if (e.joint == 1 || kind == Kind::furuta) {
                M[e.joint - 1][e.joint - 1] += rotor;
            } else {
                M[0][0] += rotor, M[1][1] += rotor;
                M[0][1] -= rotor, M[1][0] -= rotor;
            }
        }
    double det = M[0][0] * M[1][1] - M[0][1] * M[1][0];
    d.v[LINK1] = (M[1][1] * r[0] - M[0][1] * r[1]) / det;
    d.v[LINK2] = two ? (M[0][0] * r[1] - M[1][0] * r[0]) / det : 0.0;
    if (rocking) {
        double heavy = p[0] / at_(*rocking, "gain"), w = 2.0 * PI * at_(*rocking, "frequency");
        d.v[BASE] = f.on[BASE] / heavy - w * w * s.y[BASE] -
                    2.0 * at_(*rocking, "damping-ratio") * w * s.v[BASE];
    }
}

State Machine::derivative(const State &s, double t, double command) const
{
    State d;
    for (int i = 0; i < BODIES; i++)
        d.y[i] = s.v[i];
    if (const Effect *e = find("actuator-lag"))
        d.lag = (command - s.lag) / at_(*e, "time-constant");
    Forces f;
    gravity(s, f);
    joint_torques(s, t, amplifier(s, t, command), f, d);
    if (play)
        contact(s, f);
    accelerate(s, f, d);
    return d;
}

State along(const State &s, const State &d, double h)
{
    State r = s;
    for (int i = 0; i < BODIES; i++)
        r.y[i] += h * d.y[i], r.v[i] += h * d.v[i];
    r.lag += h * d.lag;
    for (int i = 0; i < MOST_EFFECTS; i++)
        r.memory[i] += h * d.memory[i];
    return r;
}

// Classical Runge-Kutta.
State Machine::step(const State &s, double t, double h, double command) const
{
    State a = derivative(s, t, command), b = derivative(along(s, a, 0.5 * h), t + 0.5 * h, command),
          c = derivative(along(s, b, 0.5 * h), t + 0.5 * h, command),
          d = derivative(along(s, c, h), t + h, command);
    State r = along(s, a, h / 6.0);
    r = along(r, b, h / 3.0);
    r = along(r, c, h / 3.0);
    return along(r, d, h / 6.0);
}

// --- commands ---

double strength_of(Kind kind)
{
    switch (kind) {
    case Kind::furuta:
        return 0.6;
    case Kind::reaction_wheel:
        return 1.2;
    case Kind::pendulum:
        return 1.1;
    default:
        return 1.0;
    }
}

// A command that depends on time, or on the motor joint's speed.
class Command
{
  public:
    Command(const Recording &how_in, Kind kind, Draw &draw) : how(how_in)
    {
        size = strength_of(kind) * draw.between(0.8, 1.25);
        wheel = kind == Kind::inertia_wheel;
        const std::string &name = how.input;
        if (name == "multisine" || name == "release") {
            size_t lines = name == "release" ? 4 : 8;
            for (size_t i = 0; i < lines; i++) {
                frequency.push_back(draw.between(0.1, name == "release" ? 3.0 : 4.5));
                weight.push_back(draw.between(0.3, 1.0));
                phase.push_back(draw.between(0.0, 2.0 * PI));
            }
        } else if (name == "steps") {
            for (double t = 0.0; t < how.seconds; t += draw.between(0.3, 0.9)) {
                edge.push_back(t);
                weight.push_back(draw.between(-4.0, 4.0));
            }
        } else if (name == "chirp") {
            frequency = {draw.between(0.3, 0.6), draw.between(3.0, 4.5)};
        } else if (name == "pump") {
            frequency = {draw.between(0.4, 0.7)};
        } else if (name != "free" && name != "rep1" && name != "rep2" && how.given.empty()) {
            throw std::invalid_argument("no input is called " + name);
        }
    }
    double at(size_t row, double t, double v) const
    {
        if (!how.given.empty())
            return how.given[row];
        double u = shape(t, v);
        return std::min(std::max(u, -10.0), 10.0);
    }

  private:
    const Recording &how;
    double size;
    bool wheel;
    std::vector<double> frequency, weight, phase, edge;

    double shape(double t, double v) const
    {
        const std::string &name = how.input;
        double sum = 0.0;
        if (name == "multisine" || name == "release") {
            for (size_t i = 0; i < frequency.size(); i++)
                sum += weight[i] * std::sin(2.0 * PI * frequency[i] * t + phase[i]);
            return (name == "release" ? 1.1 : 1.5) * size * sum;
        }
        if (name == "steps") {
            size_t i = (size_t)(std::upper_bound(edge.begin(), edge.end(), t) - edge.begin());
            return size * weight[i - 1];
        }
        if (name == "chirp") {
            double rise = (frequency[1] - frequency[0]) / how.seconds;
            return 2.6 * size * std::sin(2.0 * PI * (frequency[0] + 0.5 * rise * t) * t);
        }
        if (name == "pump") {
            double kick = t < 0.3 ? 2.0 : 1.4 * std::tanh(3.0 * v);
            return size * (kick + 0.6 * std::sin(2.0 * PI * frequency[0] * t));
        }
        if (name == "rep1")
            return 1.5 * std::sin(6.0 * t);
        if (name == "rep2")
            return 2.5 * std::sin(t) - std::cos(4.0 * t);
        return 0.0;
    }
};

// --- a run ---

const double rests[5][2] = {{0.0, 0.0}, {0.0, 0.0}, {-0.5 * PI, 0.0}, {0.0, 0.0}, {0.0, PI}};

State start_of(Machine &m, const Recording &how, Draw &draw)
{
    const double *rest = rests[(int)m.kind];
    double q[2] = {rest[0], rest[1]};
    if (how.start_given)
        return m.at(how.start);
    if (how.input == "free" || how.input == "release") {
        if (m.kind != Kind::furuta)
            q[0] += draw.sign() * draw.between(0.4, 1.4);
        if (m.kind == Kind::pendubot || m.kind == Kind::furuta)
            q[1] += draw.sign() * draw.between(0.5, 2.0);
        return m.at(q);
    }
    // At rest where the rig hangs by itself.
    State s = m.at(q);
    m.extra_damping = 0.3;
    for (int i = 0; i < 60000; i++)
        s = m.step(s, 0.0, LONGEST_STEP, 0.0);
    m.extra_damping = 0.0;
    for (double &v : s.v)
        v = 0.0;
    return s;
}

// What an encoder with its faults shows of an angle.
double shown(const Rig &rig, int joint, double q)
{
    for (const Effect &e : rig.effects) {
        if (e.joint != joint)
            continue;
        if (e.name == "encoder-eccentricity")
            q += e.value.at("amplitude") * std::sin(q + e.value.at("phase"));
        else if (e.name == "encoder-scale")
            q *= 1.0 + e.value.at("ratio");
        else if (e.name == "encoder-offset")
            q += e.value.at("offset");
    }
    return q;
}

double sensor_lateness(const Rig &rig, int joint)
{
    double late = 0.0;
    for (const Effect &e : rig.effects)
        if (e.name == "sensor-delay" && (e.joint == 0 || e.joint == joint))
            late += e.value.at("delay");
    return late;
}

// Fine history of the joints' angles.
struct Trace {
    std::vector<double> t, q[2];
    double at(int joint, double when) const
    {
        if (when <= t[0])
            return q[joint][0];
        size_t i = (size_t)(std::lower_bound(t.begin(), t.end(), when - 1e-12) - t.begin());
        i = std::min(std::max<size_t>(i, 1), t.size() - 1);
        double share = (when - t[i - 1]) / (t[i] - t[i - 1]);
        return q[joint][i - 1] + share * (q[joint][i] - q[joint][i - 1]);
    }
};

void read_encoders(const Rig &rig, const Recording &how, Draw &draw, Log &log)
{
    for (int j = 0; j < joints_of(rig.kind); j++) {
        double count = 2.0 * PI / how.cpr[j], slip = 0.0;
        const Effect *lost = nullptr;
        for (const Effect &e : rig.effects)
            if (e.name == "missed-counts" && e.joint == j + 1)
                lost = &e;
        for (size_t k = 0; k < log.t.size(); k++) {
            if (lost && draw.unit() < lost->value.at("rate") / how.rate)
                slip += draw.sign() * lost->value.at("step");
            double shaken = draw.between(-how.jitter, how.jitter);
            double seen = std::round((log.angle[j][k] + slip) / count + shaken) * count;
            log.reading[j].push_back(seen);
        }
    }
    for (size_t k = 1; k < log.t.size(); k++)
        if (draw.unit() < how.dropped)
            for (std::vector<double> &reading : log.reading)
                if (!reading.empty())
                    reading[k] = std::numeric_limits<double>::quiet_NaN();
}

} // namespace

int joints_of(const std::string &kind)
{
    Kind k = kind_of(kind);
    return k == Kind::inertia_wheel || k == Kind::pendulum ? 1 : 2;
}

Log record(const Rig &rig, const Recording &how)
{
    Machine m(rig);
    Draw draw(how.seed);
    Command command(how, m.kind, draw);
    State s = start_of(m, how, draw);
    int joints = joints_of(rig.kind);
    const Effect *delay = m.find("input-delay");
    double late = delay ? delay->value.at("delay") : 0.0;
    Log log;
    Trace trace;
    auto note = [&](double t) {
        trace.t.push_back(t);
        for (int j = 0; j < joints; j++)
            trace.q[j].push_back(m.angle(s, j + 1));
    };
    note(0.0);
    size_t rows = how.given.empty() ? (size_t)(how.seconds * how.rate) : how.given.size();
    double period = 1.0 / how.rate;
    for (size_t k = 0; k < rows; k++) {
        double t = (double)k * period;
        log.t.push_back(t);
        log.u.push_back(command.at(k, t, m.speed(s, m.motor)));
        // The command that acts changes when one sent a delay ago arrives.
        double now = t, end = t + period;
        while (now < end - 1e-12) {
            long sent = std::lround(std::floor((now - late) / period + 1e-9));
            double acting = sent < 0 ? 0.0 : log.u[(size_t)std::min(sent, (long)k)];
            double next = std::min(end, (double)(sent + 1) * period + late);
            if (next - now < 1e-9)
                next = std::min(end, next + period);
            int steps = (int)std::ceil((next - now) / LONGEST_STEP - 1e-9);
            double h = (next - now) / steps;
            for (int i = 0; i < steps; i++) {
                s = m.step(s, now + i * h, h, acting);
                note(now + (i + 1) * h);
            }
            now = next;
        }
    }
    for (int j = 0; j < joints; j++)
        for (double t : log.t)
            log.angle[j].push_back(shown(rig, j + 1, trace.at(j, t - sensor_lateness(rig, j + 1))));
    read_encoders(rig, how, draw, log);
    return log;
}

// --- a rig that lives ---

struct Live::Inside {
    Rig rig;
    Machine m;
    Draw draw;
    double cpr[2], jitter;
    State s, hanging;
    double t = 0.0;    // since the last zero
    double cold = 0.0; // of it before the first command
    double late = 0.0;
    std::deque<std::pair<double, double>> sent;    // commands with their times, the oldest acts
    std::deque<std::pair<double, double>> past[2]; // times and angles, as far back as a sensor lags
    double slip[2] = {0.0, 0.0};
    int64_t zeroed[2] = {0, 0};

    Inside(const Rig &r, const double c[2], double shaken, uint64_t seed)
        : rig(with_room(r)), m(rig), draw(seed), cpr{c[0], c[1]}, jitter(shaken)
    {
        Recording at_rest;
        hanging = start_of(m, at_rest, draw);
        if (const Effect *e = m.find("input-delay"))
            late = e->value.at("delay");
        begin();
    }
    void begin()
    {
        s = hanging;
        t = cold = 0.0;
        sent.assign(1, {-1.0, 0.0});
        for (int j = 0; j < 2; j++) {
            past[j].clear();
            slip[j] = 0.0;
            zeroed[j] = 0;
        }
        let_go();
        note();
    }
    // For a hand: the machine keeps where its effects are.
    static Rig with_room(Rig r)
    {
        r.effects.reserve(MOST_EFFECTS);
        return r;
    }
    void note()
    {
        for (int j = 0; j < joints_of(rig.kind); j++) {
            const double oldest = t - sensor_lateness(rig, j + 1);
            past[j].emplace_back(t, m.angle(s, j + 1));
            while (past[j].size() > 2 && past[j][1].first <= oldest)
                past[j].pop_front();
        }
    }
    void lose_counts(double h)
    {
        for (const Effect &e : rig.effects)
            if (e.name == "missed-counts" && std::fabs(m.speed(s, e.joint)) > 0.2 &&
                draw.unit() < e.value.at("rate") * h)
                slip[e.joint - 1] += draw.sign() * e.value.at("step");
    }
    // Until `end`, or until a command that was sent earlier begins to act.
    double piece(double end)
    {
        while (sent.size() > 1 && sent[1].first + late <= t + 1e-12)
            sent.pop_front();
        return sent.size() > 1 ? std::min(end, sent[1].first + late) : end;
    }
    void advance(double seconds, double command)
    {
        if (command != sent.back().second)
            sent.emplace_back(t, command);
        if (command == 0.0 && cold == t)
            cold = t + seconds;
        const double before = std::min(cold, t);
        for (const double end = t + seconds; t < end - 1e-12;) {
            const double until = piece(end), begin = t;
            const int steps = (int)std::ceil((until - begin) / LONGEST_STEP - 1e-9);
            const double h = (until - begin) / std::max(steps, 1);
            for (int i = 0; i < steps; i++) {
                s = m.step(s, begin + i * h - before, h, sent.front().second);
                t = begin + (i + 1) * h;
                note();
            }
            lose_counts(until - begin);
            t = until;
        }
    }
    int64_t position(int j, double shaken)
    {
        const double when = t - sensor_lateness(rig, j + 1);
        const auto &a = past[j].front(), &b = past[j].size() > 1 ? past[j][1] : past[j].front();
        const double share = b.first > a.first ? (when - a.first) / (b.first - a.first) : 0.0;
        const double q = a.second + std::min(std::max(share, 0.0), 1.0) * (b.second - a.second);
        const double count = 2.0 * PI / cpr[j];
        return std::llround((shown(rig, j + 1, q) + slip[j]) / count + shaken);
    }
    void zero()
    {
        for (int j = 0; j < joints_of(rig.kind); j++) {
            zeroed[j] = position(j, 0.0);
            for (auto &one : past[j])
                one.first -= t;
        }
        for (auto &one : sent)
            one.first -= t;
        t = cold = 0.0;
        let_go();
    }
    void let_go()
    {
        if (!rig.effects.empty() && rig.effects.back().name == "hand")
            rig.effects.pop_back();
    }
    void hold(int joint, double from, double to)
    {
        let_go();
        if (rig.effects.size() < rig.effects.capacity())
            rig.effects.push_back({"hand",
                                   joint,
                                   {{"from", from},
                                    {"to", to},
                                    {"place", m.angle(s, joint)},
                                    {"rate", 0.0},
                                    {"stiffness", 5.0},
                                    {"damping", 0.5}}});
    }
};

Live::Live(const Rig &rig, const double cpr[2], double jitter, uint64_t seed)
    : inside(new Inside(rig, cpr, jitter, seed))
{
}

Live::~Live() = default;

void Live::advance(double seconds, double command)
{
    inside->advance(seconds, command);
}

void Live::begin()
{
    inside->begin();
}

void Live::zero()
{
    inside->zero();
}

void Live::counts(int32_t out[2])
{
    out[0] = out[1] = 0;
    for (int j = 0; j < joints_of(inside->rig.kind); j++) {
        const double shaken = inside->draw.between(-inside->jitter, inside->jitter);
        out[j] = (int32_t)(inside->position(j, shaken) - inside->zeroed[j]);
    }
}

void Live::hold(int joint, double from, double to)
{
    inside->hold(joint, from, to);
}

} // namespace truth
