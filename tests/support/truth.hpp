// Rigs as they are, for tests that hide an effect in data: a simulator with a formulation of its
// own. Bodies have absolute angles (the Furuta pendulum is masses in space), torques act
// between bodies, play is two bodies and a gap, a delay is a buffer of held commands, steps are at
// most 0.1 ms. It shares no code with the program under test; the laws are those of docs/effects.md
// and docs/theory.md, read from there.
#ifndef MECHKIT_TESTS_TRUTH_HPP
#define MECHKIT_TESTS_TRUTH_HPP

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace truth
{

// An effect of the catalogue, one of those that it lacks (names in `foreign_effects`), or somebody
// at the rig: a `hand` (from, to, place, rate, stiffness, damping) or a `kick` (from, to, level).
// `joint` 0: none.
struct Effect {
    std::string name;
    int joint = 0;
    std::map<std::string, double> value;
};

struct Rig {
    std::string kind;      // as in a model file
    std::vector<double> p; // base parameters, in the order of docs/theory.md
    double g = 9.81, u_max = 10.0;
    std::vector<Effect> effects;
};

// How a log is made.
struct Recording {
    double rate = 500.0, seconds = 10.0;
    double cpr[2] = {4000.0, 4000.0};
    double jitter = 0.0;       // counts, uniform to both sides, before rounding
    double dropped = 0.0;      // share of rows without readings
    std::string input;         // multisine chirp steps free release pump rep1 rep2
    std::vector<double> given; // or this command, row by row
    bool start_given = false;  // with `start` as the joints' angles, at rest
    double start[2] = {0.0, 0.0};
    uint64_t seed = 1;
};

// Angles are by joint. `angle` is what perfect encoders would show where the real ones sit;
// `reading` has quantisation, jitter, slips and holes (NaN).
struct Log {
    std::vector<double> t, u, angle[2], reading[2];
};

int joints_of(const std::string &kind);
Log record(const Rig &rig, const Recording &how);

// The same machine while it lives, behind counters, for programs that drive it. It begins at rest
// where it hangs by itself. What changes with time (drift, warming) begins anew with the first
// command after every zero: a motor cools while a rig comes to rest. Counts slip only while their
// joint turns.
class Live
{
  public:
    // `jitter`: as in a Recording.
    Live(const Rig &rig, const double cpr[2], double jitter, uint64_t seed);
    ~Live();
    // Time passes under a command that is given now (and acts when its delay is over).
    void advance(double seconds, double command);
    void begin(); // again, from rest
    // The counters are 0 where they are now, whatever their encoders' faults.
    void zero();
    void counts(int32_t out[2]);
    // Somebody holds a joint where it is now, from a time to another, both since the first
    // command after the last zero. Gone with the next zero.
    void hold(int joint, double from, double to);

  private:
    struct Inside;
    std::unique_ptr<Inside> inside;
};

// Effects that no catalogue has: each missing from every table of the program.
extern const std::vector<std::string> foreign_effects;

// Uniform and other draws from a seed, the same on every machine.
class Draw
{
  public:
    explicit Draw(uint64_t seed) : state(seed * 0x9e3779b97f4a7c15ull + 0x632be59bd9b4e019ull) {}
    double unit()
    {
        state += 0x9e3779b97f4a7c15ull;
        uint64_t z = state;
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
        return (double)((z ^ (z >> 31)) >> 11) * 0x1p-53;
    }
    double between(double low, double high) { return low + (high - low) * unit(); }
    double sign() { return unit() < 0.5 ? -1.0 : 1.0; }
    size_t below(size_t n) { return (size_t)(unit() * (double)n); }

    double stretch = 1.0; // for who draws from ranges: by how much to widen them at both ends

  private:
    uint64_t state;
};

} // namespace truth
#endif
