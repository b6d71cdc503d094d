// The rig of the independent simulator: bodies, what acts on them, and a step of its integration.
// For truth.cpp, which commands it and reads its encoders.
#ifndef MECHKIT_TESTS_SUPPORT_TRUTH_MACHINE_HPP
#define MECHKIT_TESTS_SUPPORT_TRUTH_MACHINE_HPP

#include <stdexcept>

#include "support/truth.hpp"

namespace truth
{

constexpr double PI = 3.14159265358979323846;

enum class Kind { inertia_wheel, pendulum, pendubot, reaction_wheel, furuta };

// std::invalid_argument: there is no such rig.
Kind kind_of(const std::string &name);

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
    explicit Machine(const Rig &r) : rig(r), kind(kind_of(r.kind)), p(r.p)
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

} // namespace truth

#endif
