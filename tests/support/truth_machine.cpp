#include "support/truth_machine.hpp"

#include <algorithm>
#include <cmath>

namespace truth
{

namespace
{

double soft_sign(double v)
{
    return std::tanh(15.0 * v);
}

} // namespace

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

namespace
{

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

} // namespace

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

static State along(const State &s, const State &d, double h)
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

} // namespace truth
