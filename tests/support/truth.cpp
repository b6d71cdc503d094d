#include "support/truth.hpp"
#include "support/truth_machine.hpp"

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

constexpr double LONGEST_STEP = 1e-4; // s

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
